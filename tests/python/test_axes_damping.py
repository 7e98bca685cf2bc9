# SPDX-License-Identifier: BSD-3-Clause
"""Every damped scheme along all axes against its equations in NumPy (reference.py): block, oracle, single path."""

import axes
import numpy as np
import pytest
import reference
import symsde as ss
from test_axes_steps import KICKS, KINDS, NO_GENERAL, ONE_SIDED, PATHS, ROWS, STEPS, TABLEAUS

SCHEMES = (
    *(x for x in TABLEAUS if x not in {"euler_maruyama", "midpoint_weak1"}),
    *ONE_SIDED, "midpoint_areas", *(x for x in KICKS if x != "verlet_dkd_weak2"), "gauss_dkdkd_midpoint",
    "gauss_dkdkd_rotation", "exact_rotation", "verlet_dz",
)  # fmt: skip
#: rates of q_1, q_2, q_3; with one rate the first is used. Decays over a step of 0.1 reach exp(-1)
RATES = {"one": (0.8, 0.8, 0.8), "each": (0.5, 1.2, 3.0), "strong": (10.0, 10.0, 10.0), "weak": (1e-3, 1e-3, 1e-3),
         "gain": (-0.6, -0.6, -0.6)}  # fmt: skip


def design(scheme):
    """Rows for a scheme, with unequal rates only if the scheme adds no products of gradients."""
    chosen = {**axes.AXES, "kind": KINDS[scheme], "damping": tuple(RATES)}
    if scheme in ONE_SIDED:
        chosen["correction"] = ("auto", "mean", "none")
    rows = axes.covering(**chosen)
    if scheme in {*ONE_SIDED, "midpoint_areas"}:
        rows = [{**row, "damping": "one" if row["damping"] == "each" else row["damping"]} for row in rows]
    return rows


CASES = [(scheme, row) for scheme in SCHEMES for row in design(scheme)]


@pytest.mark.filterwarnings("ignore::symsde.errors.DoubtfulRunWarning")
@pytest.mark.parametrize(("scheme", "row"), CASES, ids=[f"{scheme}-{axes.ident(row)}" for scheme, row in CASES])
def test_damped_steps_are_those_of_the_equations(scheme, row):
    kind, h, t0 = row["kind"], 0.1 * row["sign"], 0.3
    rates = RATES[row["damping"]][: row["ndof"]]
    ridges = axes.ridges_of(kind, row["ndof"], row["nnoise"], row["time"])
    model = axes.model_of(ridges, kind).damped(rates, allow_gain=True)
    q0, p0 = axes.start(row["ndof"], PATHS)
    rows = axes.rows_of(h, STEPS, ROWS, row["nnoise"], PATHS)
    given = {"step": h, "steps": STEPS, "t0": t0, "scheme": scheme, "refine": 2}
    given |= {x: row[x] for x in ("first_step", "first_path", "correction") if x in row}
    run = ss.simulate(model, q0=q0, p0=p0, paths=PATHS, increments=rows, **given)

    x = np.concatenate([q0, p0])
    how = {"correction": ({"auto": "increments"} | {x: x for x in ("mean", "none")})[row.get("correction", "auto")]}
    if scheme in {"exact_rotation", "gauss_dkdkd_rotation"}:
        how["rotation"] = axes.rotation_of(kind, row["ndof"])
    for n in range(STEPS):
        t = t0 + (row["first_step"] + n) * h
        drive = reference.polygon(h, rows[ROWS * n : ROWS * (n + 1)])
        x = reference.damped_step(scheme, ridges, t, drive, x, rates=rates, **how)
        room = 5e-12 * max(1, np.abs(x).max())
        np.testing.assert_allclose(np.concatenate([run.q[n + 1], run.p[n + 1]]), x, rtol=0, atol=room)
    if scheme not in NO_GENERAL:
        general = ss.simulate(model, q0=q0, p0=p0, paths=PATHS, increments=rows, general=True, **given)
        np.testing.assert_allclose([general.q, general.p], [run.q, run.p], rtol=0, atol=room)
    one = ss.simulate(model, q0=q0[:, 3:4], p0=p0[:, 3:4], paths=1, increments=rows[:, :, 3:4], **given)
    np.testing.assert_array_equal([one.q[:, :, 0], one.p[:, :, 0]], [run.q[:, :, 3], run.p[:, :, 3]])
