# SPDX-License-Identifier: BSD-3-Clause
"""What explicit flows of kicks and drifts spare: work for one error, counted and not timed."""

import numpy as np
import pytest
import symsde as ss

ORDER_ONE = ("midpoint", "symplectic_euler", "stormer_verlet")
LONG, FINEST = 256, 1024  # steps of schemes of order one, and of the judge


@pytest.mark.parametrize(
    ("model", "state", "scheme", "steps", "judge"),
    [
        (ss.models.henon_heiles(), {"q0": 0.12, "p0": 0.12, "paths": 100}, "chin4a", 4, "gauss_dkdkd_strong2"),
        (ss.models.fpu_chain(n=64), {"q0": 0.1, "p0": 0.0, "paths": 16}, "gauss_dkdkd", 16, "verlet_dz"),
    ],
    ids=["henon_heiles", "fpu64"],
)
def test_kicks_take_a_fifth_of_the_work_of_order_one(model: ss.Model, state: dict, scheme: str, steps: int, judge: str):
    """Gradients and products of Hessians, of a path to T = 2; the error is smaller, too.

    Measured: Henon-Heiles 1.9e-4 by 4 steps of chin4a, 4.6e-4 and 1.1e-3 by 256 of order one; the chain 1.7e-3 by 16
    steps of gauss_dkdkd, 3.2e-3 by 256.
    """

    def end(scheme: str, steps: int) -> tuple[np.ndarray, float]:
        given = {"step": 2 / steps, "steps": steps, "save_every": steps, "refine": (FINEST // steps).bit_length() - 1}
        run = ss.simulate(model, scheme=scheme, seed=3, **given, **state)
        assert not run.status.any()
        counted = sum(run.report.counters[name] for name in ("gradients", "hessians", "hessian_vectors"))
        return np.concatenate([run.q[-1], run.p[-1]]), counted / run.q.shape[2]

    exact, _ = end(judge, FINEST)

    def error(x: np.ndarray) -> float:
        return float(np.sqrt(((x - exact) ** 2).sum(axis=0).mean()))

    x, work = end(scheme, steps)
    for plain in ORDER_ONE:
        y, more = end(plain, LONG)
        assert error(x) < error(y) and work < more / 5, (plain, error(x), error(y), work, more)
