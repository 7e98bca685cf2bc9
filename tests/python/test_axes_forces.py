# SPDX-License-Identifier: BSD-3-Clause
"""Every scheme that takes forces, along all axes and damped, too, against its equations in NumPy (reference.py)."""

import axes
import numpy as np
import pytest
import reference
import symsde as ss
from symsde.errors import IncompatibleError
from test_axes_steps import GALERKIN, KINDS, NO_GENERAL, ONE_SIDED, PATHS, ROWS, STEPS, TABLEAUS

#: drifts and kicks: forces F(q,t) and f_k(q,t); of midpoint steps between kicks of noises F may depend on p
KICKED = ("gauss_dkdkd", "verlet_kdk", "chin4a", "gauss_dkdkd_strong2", "verlet_kdk_strong2", "chin4a_strong2",
          "gauss_dkdkd_rotation", "verlet_kdk_midpoint", "gauss_dkdkd_midpoint", "verlet_dz")  # fmt: skip
SCHEMES = (*(x for x in TABLEAUS if x not in {"euler_maruyama", "midpoint_weak1"}), *ONE_SIDED, *GALERKIN, *KICKED)
RATES = {"none": None, "one": (8.0, 8.0, 8.0), "each": (0.5, 1.2, 3.0)}


def design(scheme):
    """Rows for a scheme; `forces` is what acts."""
    kinds = tuple(x for x in KINDS[scheme] if x in {"kick", "position", "mass", "any", "coupled"})
    chosen = {**axes.AXES, "kind": kinds, "force": axes.FORCES, "damping": tuple(RATES)}
    if scheme in ONE_SIDED:
        chosen["correction"] = ("auto", "mean", "none")
    if scheme in KICKED:
        chosen["force"] = ("curl",) if scheme == "verlet_dz" else ("curl", "curls")
        if scheme == "gauss_dkdkd_midpoint":
            chosen["force"] += ("drag",)
    if scheme in GALERKIN:
        chosen["damping"] = ("none",)  # damping is refused where these are no tableau
    rows = axes.covering(**chosen)
    if scheme in GALERKIN:  # of which noises are in position
        rows = [{**row, "force": "drag"} if row["force"] == "all" else row for row in rows]
    if scheme in ONE_SIDED:
        rows = [{**row, "damping": "one"} if row["damping"] == "each" else row for row in rows]
    return rows


CASES = [(scheme, row) for scheme in SCHEMES for row in design(scheme)]


def forced(row, kind):
    """The ridges with forces, for the reference and for the library."""
    ridges = axes.ridges_of(kind, row["ndof"], row["nnoise"], row["time"])
    pulled = reference.Forced(ridges, axes.pulls_of(row["force"], row["ndof"], row["nnoise"]))
    free = row["force"] in {"curl", "curls"}
    model = axes.model_of(ridges, kind).forced(
        pulled.force,
        noise_force=pulled.noise_force if row["force"] in {"curls", "all"} else None,
        position_force=free,
        position_noise_force=free,
    )
    return pulled, model


@pytest.mark.filterwarnings("ignore::symsde.errors.DoubtfulRunWarning")
@pytest.mark.parametrize(("scheme", "row"), CASES, ids=[f"{scheme}-{axes.ident(row)}" for scheme, row in CASES])
def test_forced_steps_are_those_of_the_equations(scheme, row):
    kind, h, t0 = row["kind"], 0.1 * row["sign"], 0.3
    pulled, model = forced(row, kind)
    rates = RATES[row["damping"]] and RATES[row["damping"]][: row["ndof"]]
    if rates:
        model = model.damped(rates)
    q0, p0 = axes.start(row["ndof"], PATHS)
    rows = axes.rows_of(h, STEPS, ROWS, row["nnoise"], PATHS)
    given = {"step": h, "steps": STEPS, "t0": t0, "scheme": scheme, "refine": 2}
    given |= {x: row[x] for x in ("first_step", "first_path", "correction") if x in row}
    run = ss.simulate(model, q0=q0, p0=p0, paths=PATHS, increments=rows, **given)

    x = np.concatenate([q0, p0])
    how = {"correction": ({"auto": "increments"} | {x: x for x in ("mean", "none")})[row.get("correction", "auto")]}
    if scheme == "gauss_dkdkd_rotation":
        how["rotation"] = axes.rotation_of(kind, row["ndof"])
    for n in range(STEPS):
        t = t0 + (row["first_step"] + n) * h
        drive = reference.polygon(h, rows[ROWS * n : ROWS * (n + 1)])
        if rates:
            x = reference.damped_step(scheme, pulled, t, drive, x, rates=rates, **how)
        else:
            x = reference.step(scheme, pulled, t, drive, x, **how)
        room = 2e-10 if how["correction"] != "none" and scheme in ONE_SIDED else 5e-12
        if scheme.startswith(("verlet_kdk", "chin4a", "gauss_dkdkd_strong2")):
            room = 2e-11  # derivatives of forces are differences
        room *= max(1, np.abs(x).max())
        np.testing.assert_allclose(np.concatenate([run.q[n + 1], run.p[n + 1]]), x, rtol=0, atol=room)
    if scheme not in NO_GENERAL:
        general = ss.simulate(model, q0=q0, p0=p0, paths=PATHS, increments=rows, general=True, **given)
        np.testing.assert_allclose([general.q, general.p], [run.q, run.p], rtol=0, atol=room)
    one = ss.simulate(model, q0=q0[:, 3:4], p0=p0[:, 3:4], paths=1, increments=rows[:, :, 3:4], **given)
    np.testing.assert_array_equal([one.q[:, :, 0], one.p[:, :, 0]], [run.q[:, :, 3], run.p[:, :, 3]])


@pytest.mark.parametrize("scheme", KICKED)
def test_kicks_refuse_forces_of_momenta(scheme):
    """A force that depends on p, or is not declared free of it, by every scheme of kicks but that of midpoint steps."""
    row = {"ndof": 2, "nnoise": 1, "time": "", "force": "drag"}
    model = forced(row, "kick")[1]
    run = {"q0": 0.1, "p0": 0.2, "step": 0.1, "steps": 1, "scheme": scheme}
    if scheme == "gauss_dkdkd_midpoint":
        assert ss.simulate(model, **run).report.status == 0
    else:
        with pytest.raises(IncompatibleError, match=r"kicks momenta at given positions, .* without p \(declare"):
            ss.simulate(model, **run)
    noisy = forced({**row, "force": "all"}, "kick")[1]
    with pytest.raises(IncompatibleError, match=r"forces act on model|forces f_k of noises that depend"):
        ss.simulate(noisy, **run)
