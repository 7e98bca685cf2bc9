# SPDX-License-Identifier: BSD-3-Clause
"""Forces on chains: implicit steps of many unknowns by sweeps and by bands, against the general stepper."""

import numpy as np
import pytest
import symsde as ss
from symsde.errors import FalseTraitError, InvalidArgumentError, WrongTypeError

pytestmark = pytest.mark.usefixtures("quick_compiler")

SITES, STEP = 24, 0.1
CHAIN = ss.models.fpu_chain(n=SITES, sigma=0.3)
START = {"q0": 0.3 * np.cos(np.arange(SITES)), "p0": 0.2 * np.sin(2 * np.arange(SITES)), "step": STEP, "seed": 3}


def drag(q, p, t):
    """On each site by itself, not linear in p."""
    return -0.7 * p * (1 + q**2) + 0.1 * np.sin(t)


def rubbing(q, p, t):
    """Between neighbours, and a curl of their positions."""
    found = 0.4 * np.roll(q, 1, axis=0) * np.cos(t)
    found[0] = 0
    rate = np.diff(p, axis=0) * 0.6
    found[:-1] += rate
    found[1:] -= rate
    return found


def stiff(q, p, t):
    """Friction that no sweep of a step of .1 contracts."""
    return -60.0 * p * (1 + 0.1 * q**2)


FORCES = {"drag": (drag, 0), "rubbing": (rubbing, 1), "stiff": (stiff, 0)}
SCHEMES = ["midpoint", "gauss2", "stormer_verlet", "lobatto3", "lobatto2_swapped", "dirk:0.25"]


@pytest.mark.parametrize("name", FORCES)
@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("paths", [1, 11])
def test_steps_are_those_of_the_general_stepper(scheme, name, paths):
    """With a bandwidth and without, damped by different rates and not; a hundredth of the force more is seen."""
    force, band = FORCES[name]
    for damping in (None, 1.5):
        found = []
        for given in ({"force_bandwidth": band}, {}):
            model = CHAIN.forced(force, **given)
            model = model if damping is None else model.damped(damping)
            run = ss.simulate(model, scheme=scheme, paths=paths, steps=3, **START)
            assert run.report.status == 0
            if scheme != "midpoint" or given:
                assert "stages, forced" in run.report.stepper
            found.append(run)
        general = ss.simulate(model, scheme=scheme, paths=paths, steps=3, general=True, **START)
        for run in found:
            np.testing.assert_allclose(run.q, general.q, rtol=0, atol=3e-12)
            np.testing.assert_allclose(run.p, general.p, rtol=0, atol=3e-12)
        more = CHAIN.forced(lambda q, p, t: 1.01 * force(q, p, t), force_bandwidth=band)
        if damping is None:
            other = ss.simulate(more, scheme=scheme, paths=paths, steps=3, **START)
            assert np.abs(other.p - general.p).max() > 1e-4


@pytest.mark.optimised
@pytest.mark.parametrize("scheme", ["midpoint", "gauss2", "stormer_verlet"])
def test_a_path_has_its_bits_in_every_block(scheme):
    """By sweeps and by bands."""
    for force, band in FORCES.values():
        model = CHAIN.forced(force, force_bandwidth=band)
        whole = ss.simulate(model, scheme=scheme, paths=19, steps=3, **START)
        alone = ss.simulate(model, scheme=scheme, paths=1, first_path=7, steps=3, **START)
        np.testing.assert_array_equal(alone.p[..., 0], whole.p[..., 7])


@pytest.mark.parametrize("scheme", ["midpoint", "gauss2", "stormer_verlet"])
def test_work_is_that_of_sweeps_and_of_bands(scheme):
    """Stages that contract form no matrix and ask for no derivative; stiff ones take few solves of bands."""
    soft = ss.simulate(CHAIN.forced(drag), scheme=scheme, paths=8, steps=4, **START).report.counters
    assert soft["hessians"] == 0
    assert soft["iterations"] <= 25 * soft["path_steps"]
    if scheme != "midpoint":  # which takes products of the Hessian where sweeps contract by less than five
        assert soft["solves"] == soft["hessian_vectors"] == 0
    stiffer = ss.simulate(CHAIN.forced(stiff, force_bandwidth=0), scheme=scheme, paths=8, steps=4, **START)
    assert 0 < stiffer.report.counters["solves"] <= 6 * stiffer.report.counters["path_steps"]
    assert stiffer.report.counters["lapack_solves"] == 0


def test_formulas_know_how_far_their_forces_reach():
    n = 12
    text = "+".join(f"p{i}**2/2 + q{i}**2/2 + (q{i % n + 1} - q{i})**4/4" for i in range(1, n))
    text += f"+ p{n}**2/2 + q{n}**2/2"
    for force, reach in (
        ([f"-0.5*p{i}**3" for i in range(1, n + 1)], 0),
        ([f"0.3*q{max(1, i - 1)}*p{i}" for i in range(1, n + 1)], 1),
        ([f"-p{n + 1 - i}" for i in range(1, n + 1)], n - 1),
    ):
        model = ss.model_from_sympy(text, noise=["-q1"], force=force)
        assert model._forces.bandwidth == reach
        run = {"q0": 0.3, "p0": 0.2, "step": 0.1, "steps": 3, "paths": 3, "seed": 1}
        for scheme in ("gauss2", "midpoint"):
            fast, slow = (ss.simulate(model, scheme=scheme, general=x, **run) for x in (False, True))
            np.testing.assert_allclose(fast.p, slow.p, rtol=0, atol=3e-12)


def test_false_bandwidths_are_refused():
    run = {"scheme": "midpoint", "steps": 1, **START}
    with pytest.raises(FalseTraitError, match=r"reaches beyond its bandwidth \(force_bandwidth\): give a larger one"):
        ss.simulate(CHAIN.forced(rubbing, force_bandwidth=0), **run)
    for wide in (5, SITES - 1, SITES, 2**31 - 1):
        assert ss.simulate(CHAIN.forced(rubbing, force_bandwidth=wide), **run).report.status == 0
    with pytest.raises(InvalidArgumentError, match="force_bandwidth = 4294967296"):
        CHAIN.forced(rubbing, force_bandwidth=2**32)
    with pytest.raises(InvalidArgumentError, match="force_bandwidth = -1: give the largest"):
        CHAIN.forced(rubbing, force_bandwidth=-1)
    with pytest.raises(WrongTypeError, match="force_bandwidth"):
        CHAIN.forced(rubbing, force_bandwidth="one")


@pytest.mark.parametrize("scheme", ["midpoint", "gauss2"])
def test_friction_that_is_linear_is_told(scheme):
    """The report advises damping where a function is -gamma p wherever it was probed; nothing is replaced."""
    model = ss.models.henon_heiles()
    run = {"scheme": scheme, "q0": [0.1, 0.2], "p0": [0.0, 0.1], "step": 0.1, "steps": 2, "seed": 1}
    told = ss.simulate(model.forced(lambda q, p, t: -0.25 * p), **run).report
    assert told.damping == (
        "by a force that is -gamma p wherever it was probed, gamma = 0.25: as damping its steps are exactly conformal, "
        "and more schemes take it"
    )
    each = ss.simulate(model.forced(lambda q, p, t: np.array([[-0.25], [-0.75]]) * p), **run).report
    assert "gamma = 0.25 to 0.75: as damping" in each.damping
    for other in (
        lambda q, p, t: -0.25 * p * (1 + 1e-6 * q**2),
        lambda q, p, t: -0.25 * p + 1e-6 * q,
        lambda q, p, t: -0.25 * p[::-1],
        lambda q, p, t: 0 * p,
    ):
        assert ss.simulate(model.forced(other), **run).report.damping == ""
    slowly = model.forced(lambda q, p, t: -0.25 * p * (1 + t))
    assert ss.simulate(slowly, **run).report.damping == ""
    damped = ss.simulate(model.forced(lambda q, p, t: -0.25 * p).damped(0.5), **run).report
    assert damped.damping.startswith("dp = .. - 0.5 p dt")
