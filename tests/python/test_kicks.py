# SPDX-License-Identifier: BSD-3-Clause
"""Explicit flows of kicks and drifts: the work that they save, by counters; they need no noise."""

import numpy as np
import pytest
import symsde as ss

ORDER_ONE = ("midpoint", "symplectic_euler", "stormer_verlet")
LONG, FINEST = 256, 1024  # steps of schemes of order one, and of the reference


@pytest.mark.parametrize(
    ("model", "state", "scheme", "steps", "judge"),
    [
        (ss.models.henon_heiles(), {"q0": 0.12, "p0": 0.12, "paths": 100}, "chin4a", 4, "gauss_dkdkd_strong2"),
        (ss.models.fpu_chain(n=64), {"q0": 0.1, "p0": 0.0, "paths": 16}, "gauss_dkdkd", 16, "verlet_dz"),
    ],
    ids=["henon_heiles", "fpu64"],
)
def test_kicks_take_a_fifth_of_the_work_of_order_one(model: ss.Model, state: dict, scheme: str, steps: int, judge: str):
    """Kicks take a fifth of the work, counted as gradients and Hessian products of a path to T = 2, and have smaller
    errors, too.

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


KICKS = ("symplectic_euler", "symplectic_euler_adjoint", "stormer_verlet", "lobatto2_swapped", "verlet_dkd_weak2")
KICKS += ("verlet_kdk", "verlet_kdk_strong2", "gauss_dkdkd", "gauss_dkdkd_strong2", "gauss_dkdkd_rotation")


@pytest.mark.parametrize("scheme", KICKS)
@pytest.mark.parametrize("paths", [1, 3, 40])
def test_noises_that_are_silent(scheme: str, paths: int):
    """Neither dZ nor dW of a silent noise is drawn: whole steps of the model are those of the general stepper."""
    model = ss.models.henon_heiles(sigma1=0.0, sigma2=0.0)
    given = {"q0": [0.2, -0.1], "p0": [0.05, 0.3], "step": 0.1, "steps": 40, "scheme": scheme, "paths": paths}
    run, oracle = ss.simulate(model, **given), ss.simulate(model, general=True, **given)
    assert not run.status.any()
    assert np.abs(run.q - oracle.q).max() < 1e-13
    assert np.abs(run.p - oracle.p).max() < 1e-13


@pytest.mark.parametrize("moving", [False, True])
@pytest.mark.parametrize("paths", [1, 2, 3, 8, 40])
def test_a_singular_drift_is_rescued_in_one_lane_or_in_all(paths, moving):
    """At rest 1 + h^2 U''/4 = 0, so that the midpoint step between kicks is singular unless a kick moves the path."""

    def gradient(t, w, q, p):
        return w[0] * (4 * q**3 - 16 * q + 0.3) + 0.2 * w[1] * q, w[0] * p

    def hessian(t, w, q, p):
        return (w[0] * (12 * q**2 - 16) + 0.2 * w[1])[None], np.zeros((1, *q.shape)), (w[0] + 0 * p)[None]

    traits = dict.fromkeys(("separable", "position_noise", "identity_mass"), True)
    model = ss.Model(ndof=1, nnoise=1, gradient=gradient, hessian=hessian, **traits)
    rest = np.zeros((1, paths))
    q0 = np.where(moving & (np.arange(paths) % 2 == 1), 0.7, rest)
    how = {"p0": 0.0, "step": 0.5, "steps": 1, "paths": paths, "refine": 1, "increments": np.zeros((2, 1, paths))}
    run = ss.simulate(model, q0=q0, scheme="verlet_kdk_midpoint", **how)
    known = ss.simulate(model, q0=rest, scheme="midpoint", **how)
    at_rest = q0[0] == 0
    counters = run.report.counters
    assert not run.status.any() and counters["damped"] + counters["continued"] == at_rest.sum()
    np.testing.assert_allclose(run.last_q[:, at_rest], known.last_q[:, at_rest], rtol=1e-12)


@pytest.mark.parametrize("paths", [1, 16])
def test_a_drift_without_a_solution_stays_failed(paths):
    """dq = a q^2 dt, with a = 100 in the first drift alone: its midpoint equation m = q + tau a m^2/2 has a solution
    only if tau a q <= 1/2, and here this is 2.1. The second drift, which has a solution, must not hide this.
    """
    model = ss.model_from_sympy("q**2/2 + 100*p*q**2*exp(-((t - 0.0105)/0.01)**2)", ["0.2*sin(q)"])
    given = {"q0": 1.0, "p0": 0.1, "steps": 1, "paths": paths, "scheme": "gauss_dkdkd_midpoint", "seed": 1}
    assert not ss.simulate(model, step=0.1, t0=0.05, **given).status.any()
    failed = ss.simulate(model, step=0.1, **given)
    assert (failed.status != 0).all() and np.isnan(failed.q[-1]).all()
