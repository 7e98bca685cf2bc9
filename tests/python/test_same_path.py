# SPDX-License-Identifier: BSD-3-Clause
"""Runs that follow one Brownian path: recognised by the functionals that they use, and compared in every step, not only
at the end."""

import itertools

import numpy as np
import pytest
import symsde as ss
from symsde.answers import error_plan

MODEL = ss.models.synchrotron()  # noises in position, so that areas have no effect
RUN = {"q0": 0.3, "p0": 0.1, "paths": 3, "seed": 3}


def fits(scheme):
    """Whether the scheme draws a Brownian path and suits the model."""
    try:
        ss.simulate(MODEL, scheme=scheme, step=0.1, steps=0, **RUN)
    except ss.errors.IncompatibleError:
        return False
    return ss.schemes.get(scheme).info.law == "Gaussian"


GAUSSIAN = [name for name in ss.schemes.names() if fits(name)]


def driven(scheme, refine, step=0.05):
    """Increments of the path in steps of 0.05, and the functionals used beside them."""
    run = ss.simulate(MODEL, scheme=scheme, step=step, steps=round(0.8 / step), refine=refine, **RUN)
    dw = ss.diagnose.driving_increments(run)
    each = round(0.05 / step)
    return dw.reshape(len(dw) // each, each, *dw.shape[1:]), run.report.functionals


@pytest.mark.parametrize(("refine", "decide"), [(-1, {"dZ"}), (-2, {"dZ", "K"}), (-3, {"dZ", "K"})])
def test_schemes_share_a_halved_path_where_they_take_the_same_of_it(refine, decide):
    """After whole steps of the halved run all schemes share W; between whole steps W depends on the functionals drawn,
    and from the second halving on also on K, which is part of the halves' dZ."""
    found = [driven(scheme, refine, 0.05 * 2.0**refine) for scheme in GAUSSIAN]
    kinds = {taken for _, taken in found}
    assert {(), ("dZ",), ("dZ", "K")} <= kinds and len(kinds) < len(GAUSSIAN)
    for (one, takes), (other, also) in itertools.combinations(found, 2):
        np.testing.assert_allclose(one.sum(axis=1), other.sum(axis=1), rtol=0, atol=1e-15)
        apart = np.abs(one - other).max()
        assert apart == 0 if decide & {*takes} == decide & {*also} else apart > 0.02


@pytest.mark.parametrize("refine", [0, 1, 3])
def test_all_schemes_share_a_path_that_is_not_halved(refine):
    known, _ = driven("midpoint", refine)
    for scheme in GAUSSIAN:
        np.testing.assert_array_equal(driven(scheme, refine)[0], known)


def test_functionals_without_effect_are_not_drawn():
    """Areas of noises in position are not drawn, nor any functional without a noise; tables have no line for them."""
    reports = [
        ss.simulate(model, scheme="gauss2_strong32_areas", q0=0.3, p0=0.1, step=0.05, steps=2).report
        for model in (ss.models.noncommutative_oscillator(), MODEL, ss.models.kubo(sigma=0.0))
    ]
    assert [report.functionals for report in reports] == [("dZ", "areas"), ("dZ",), ()]
    assert "driven by  dW and dZ and areas\n" in str(reports[0]) and "driven by" not in str(reports[2])
    whole = ss.moments(MODEL, scheme="chin4a", q0=0.3, p0=0.1, step=0.05, steps=2, paths=300)
    parts = ss.ensemble(MODEL, scheme="chin4a", q0=0.3, p0=0.1, step=0.05, steps=2, paths=300, shard_paths=256)
    assert whole.report.functionals == parts.report.functionals == ("dZ", "K")


@pytest.mark.parametrize("name", ["convergence", "work_precision"])
def test_studies_compare_like_with_like(name, monkeypatch):
    """Whatever functionals schemes and references use, all runs that a study compares have the same finest
    increments.
    """
    seen = []
    real = error_plan.simulate

    def watched(*arguments, **given):
        run = real(*arguments, **given)
        if given["steps"] and given.get("refine", 0):
            seen.append((run.report.functionals, run.setup.options.refine, ss.diagnose.driving_increments(run)))
        return run

    monkeypatch.setattr(error_plan, "simulate", watched)
    given = {"q0": 0.3, "p0": 0.1, "steps": [4, 8], "paths": 40, "reference": "chin4a_strong2", "reference_steps": 16}
    if name == "convergence":
        for scheme in ("midpoint", "gauss_dkdkd"):
            ss.convergence(MODEL, scheme, **given)
    else:
        ss.work_precision(MODEL, ["midpoint", "gauss_dkdkd"], repeats=5, **given)
    assert {taken for taken, _, _ in seen} == {(), ("dZ",), ("dZ", "K", "J")} and all(
        refine > 0 for _, refine, _ in seen
    )
    whole = [dw.reshape(4, len(dw) // 4, *dw.shape[1:]).sum(axis=1) for _, _, dw in seen]
    for steps in whole[1:]:
        np.testing.assert_allclose(steps, whole[0], rtol=0, atol=1e-14)
