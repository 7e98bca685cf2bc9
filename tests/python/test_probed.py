# SPDX-License-Identifier: BSD-3-Clause
"""Traits that a user's model does not declare and that a probe does not refute: advice, and `traits="probed"`."""

import pickle

import numpy as np
import pytest
import symsde as ss
from symsde import errors

RUN = {"q0": 0.8, "p0": -0.3, "step": 0.1, "steps": 6, "paths": 3, "seed": 4}
LONG = RUN | {"steps": 1000, "save_every": 1000}  #: steps from which a run probes for advice


def pendulum(t, w, q, p):
    """H = p^2/2 - cos q with H_1 = sin(q)/5."""
    return w[0] * np.sin(q) + w[1] * np.cos(q) / 5, w[0] * p


def bent(t, w, q, p):
    """H = p^2/2 + q^2/2, and a cubic wall beyond q = 5."""
    return w[0] * (q + np.maximum(q - 5, 0) ** 2), w[0] * p


def ring(t, w, q, p):
    """Springs between neighbours on a line, of masses 1, 2, 1, 2, .., and a quartic potential at each site."""
    mass = (1 + np.arange(len(q)) % 2)[:, np.newaxis]
    force = q**3
    stretch = np.diff(q, axis=0)
    force[1:] += stretch
    force[:-1] -= stretch
    return w[0] * force, w[0] * p / mass


def coupled(t, w, q, p):
    """H = (1 + q^2) p^2/2 with H_1 = q p."""
    return w[0] * q * p**2 + w[1] * p, w[0] * (1 + q**2) * p + w[1] * q


def model(gradient, ndof=1, nnoise=0, **more):
    return ss.Model(ndof=ndof, nnoise=nnoise, gradient=gradient, **more)


@pytest.mark.parametrize(
    ("scheme", "left"),
    [
        ("stormer_verlet", "all equations, since the step is explicit"),
        ("symplectic_euler", "all equations, since the step is explicit, the correction"),
        ("midpoint", "the momenta among the unknowns"),
    ],
)
def test_advice(scheme, left):
    (told,) = ss.simulate(model(pendulum, nnoise=1), scheme=scheme, **LONG).report.warnings
    assert "hold: separable, identity_mass, position_noise. " in told
    assert f"Steps of {scheme} then leave out {left}. A probe proves none" in told


@pytest.mark.parametrize("scheme", ["stormer_verlet", "symplectic_euler", "midpoint"])
def test_no_advice_where_nothing_is_saved(scheme):
    assert not ss.simulate(model(coupled, nnoise=1), scheme=scheme, **LONG | {"step": 0.001}).report.warnings
    declared = model(pendulum, nnoise=1, position_noise=True)
    assert not ss.simulate(declared, scheme=scheme, **LONG).report.warnings
    assert not ss.simulate(model(pendulum, nnoise=1, traits="probed"), scheme=scheme, **LONG).report.warnings


def test_short_runs_do_not_pay_for_advice():
    """Advice takes some tens of gradients: as many as a short run, and as ten times a single step."""
    calls = [0]

    def counted(t, w, q, p):
        calls[0] += 1
        return pendulum(t, w, q, p)

    asked, told = [], []
    for steps in (998, 999, 1000):
        calls[0] = 0
        told.append(
            ss.simulate(model(counted, nnoise=1), **RUN | {"steps": steps, "save_every": steps}).report.warnings
        )
        asked.append(calls[0])
    assert [len(x) for x in told] == [0, 0, 1]
    step, advice = np.diff(asked)
    assert step < 20 < advice - step


@pytest.mark.parametrize("scheme", ["stormer_verlet", "symplectic_euler", "midpoint", "gauss_dkdkd"])
def test_probed_traits_are_those_declared(scheme):
    probed = model(pendulum, nnoise=1, traits="probed")
    declared = model(pendulum, nnoise=1, separable=True, position_noise=True, identity_mass=True)
    assert probed.traits == declared.traits
    mine, known = (ss.simulate(x, scheme=scheme, **RUN) for x in (probed, declared))
    assert mine.report.stepper == known.report.stepper
    np.testing.assert_array_equal(mine.q, known.q)
    again = pickle.loads(pickle.dumps(probed))
    assert again.traits == probed.traits


def test_masses_and_bands():
    traits = model(ring, ndof=14, traits="probed").traits
    assert (traits.bandwidth, traits.constant_mass, traits.diagonal_mass) == (1, True, True)
    assert not traits.identity_mass and not traits.quadratic
    assert model(ring, ndof=3, traits="probed").traits.bandwidth is None
    assert model(ring, ndof=14, bandwidth=2, traits="probed").traits.bandwidth == 2
    tied = np.array([[2.0, 0.5], [0.5, 1.0]])
    traits = model(lambda t, w, q, p: (w[0] * q, w[0] * (tied @ p)), ndof=2, traits="probed").traits
    assert (traits.constant_mass, traits.diagonal_mass, traits.quadratic) == (True, False, True)


def test_coordinates_of_the_probe_differ():
    def attracted(t, w, q, p):
        with np.errstate(divide="ignore"):
            pull = w[0] / (q[0] - q[1]) ** 2
        return np.array([pull, -pull]), w[0] * p

    assert model(attracted, ndof=2, traits="probed").traits.identity_mass


def test_nothing_holds_of_a_coupled_model():
    traits = model(coupled, nnoise=1, traits="probed").traits
    held = [x for x in ("separable", "additive", "position_noise", "quadratic") if getattr(traits, x)]
    assert not held and not traits.identity_mass and not traits.constant_mass


def test_a_run_refutes_what_was_probed_elsewhere():
    probed = model(bent, traits="probed")
    assert probed.traits.quadratic
    ss.simulate(probed, scheme="midpoint", **RUN)
    with pytest.raises(errors.FalseTraitError, match="quadratic"):
        ss.simulate(probed, scheme="midpoint", **RUN | {"q0": 7.0})


def test_wrong_arguments():
    with pytest.raises(errors.UnknownNameError, match="traits = 'all' does not exist"):
        model(pendulum, nnoise=1, traits="all")
    with pytest.raises(errors.InvalidArgumentError, match="not finite at the points where its traits would be probed"):
        model(lambda t, w, q, p: (w[0] * np.nan * q, w[0] * p), traits="probed")
    with pytest.raises(ZeroDivisionError):
        model(lambda t, w, q, p: (1 // 0, p), traits="probed")
