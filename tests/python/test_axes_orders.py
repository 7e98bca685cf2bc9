# SPDX-License-Identifier: BSD-3-Clause
"""Orders of every scheme beyond order one along all axes, path by path without sampling: one step along a polygon."""

import axes
import numpy as np
import pytest
import symsde as ss

#: orders of the error of one step of size h along a polygon, whose rows have the size sqrt(h)
ORDERS = {
    "coupled": {"midpoint": 1.0, "midpoint_areas": 1.5, "gauss2_strong32_areas": 1.5},
    "position": {
        "midpoint": 1.5,
        "gauss2_strong32": 2.0,
        "gauss_dkdkd": 2.0,
        "verlet_kdk": 2.0,
        "verlet_kdk_midpoint": 2.0,
    },
    "kick": {
        "averaged_shift_midpoint": 2.5,
        "gauss2_strong32": 2.5,
        "gauss_dkdkd": 2.5,
        "verlet_dz": 2.5,
        "chin4a": 3.5,
    },
    "any": {"gauss_dkdkd_midpoint": 2.0},
}
ROWS = axes.covering(sign=(1, -1), time=axes.AXES["time"], nnoise=(2, 3, 4), ndof=(1, 2, 3))
CASES = [(kind, scheme, row) for kind in ORDERS for scheme in ORDERS[kind] for row in ROWS]
PATHS = 5


def by_small_steps(ridges, t, h, rows, x):
    """Runge-Kutta steps along the segments of the polygon."""
    count = 12
    part = h / len(rows) / count

    def rate(t, x, w):
        return ridges.turn @ np.einsum("jl,jal->al", w, ridges.derivative(1, t, x))

    for i, w in enumerate(np.repeat(np.insert(rows, 0, h / len(rows), axis=1) / count, count, axis=0)):
        at = t + i * part
        k1 = rate(at, x, w)
        k2 = rate(at + part / 2, x + k1 / 2, w)
        k3 = rate(at + part / 2, x + k2 / 2, w)
        x = x + (k1 + 2 * k2 + 2 * k3 + rate(at + part, x + k3, w)) / 6
    return x


@pytest.mark.parametrize(("kind", "scheme", "row"), CASES, ids=[f"{k}-{s}-{axes.ident(row)}" for k, s, row in CASES])
def test_orders_of_one_step_along_a_path(kind, scheme, row):
    """The error of one step on a given path falls with the order claimed."""
    ridges = axes.ridges_of(kind, row["ndof"], row["nnoise"], row["time"])
    model, x, errors = axes.model_of(ridges, kind), axes.start(row["ndof"], PATHS), []
    for h in (0.02 * row["sign"], 0.00125 * row["sign"]):
        rows = axes.rows_of(h, 1, 8, row["nnoise"], PATHS)
        given = {"step": h, "steps": 1, "t0": 0.3, "increments": rows, "refine": 3}
        run = ss.simulate(model, q0=x[0], p0=x[1], paths=PATHS, scheme=scheme, **given)
        exact = by_small_steps(ridges, 0.3, h, rows, np.concatenate(x))
        errors.append(np.linalg.norm(np.concatenate([run.q[1], run.p[1]]) - exact))
    assert np.log2(errors[0] / errors[1]) / 4 > ORDERS[kind][scheme] - 0.15


def test_without_areas_an_order_is_lost():
    """Without areas the orders are lower, so the test above must fail."""
    row = {"sign": 1, "time": "", "nnoise": 3, "ndof": 2}
    with pytest.raises(AssertionError), pytest.MonkeyPatch.context() as patched:
        patched.setitem(ORDERS, "coupled", {"midpoint": ORDERS["coupled"]["midpoint_areas"]})
        test_orders_of_one_step_along_a_path("coupled", "midpoint", row)
