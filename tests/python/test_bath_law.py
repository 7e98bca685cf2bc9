# SPDX-License-Identifier: BSD-3-Clause
"""Certificates of schemes in a heat bath: contraction, harmonic law, free particles, against closed forms."""

import functools
import json
import math
import re
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
import symsde as ss
from symsde.errors import IncompatibleError, InvalidArgumentError, UnknownNameError

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "docs"))
import contraction
import damping_orders

pytestmark = pytest.mark.usefixtures("quick_compiler")


@pytest.mark.parametrize("z", [0.05, 0.5, 3.0])
def test_words(z):
    """Closed forms of BAOAB and OBABO; z/2 coth(z/2) of free diffusion."""
    step, omega = 0.4, 1.5
    x = (step * omega) ** 2 / 4
    for word, q2, p2 in (("BAOAB", 1, 1 - x), ("OBABO", 1 / (1 - x), 1)):
        law = ss.diagnose.bath_law(f"word:{word}", step=step, gamma=z / step, omega=omega)
        assert "exp(-gamma h)" in law.contraction
        assert law.defect < 1e-9
        np.testing.assert_allclose(
            (law.q_squared, law.q_p, law.p_squared, law.free_temperature), (q2, 0, p2, 1), rtol=0, atol=1e-11
        )
    law = ss.diagnose.bath_law("word:BAOAB", step=step, gamma=z / step)
    assert abs(law.free_diffusion / ((z / 2) / math.tanh(z / 2)) - 1) < 1e-11


def test_kicks_and_midpoint():
    """The numbers of damped kicks at omega = gamma = 1, h = 1/2; midpoint has z/sinh z of the right temperature."""
    expected = {
        "verlet_kdk": (1.0221002310236824, -0.0221002310236824, 0.9600306707450751),
        "gauss_dkdkd": (1.0057668918470486, -0.000271503399757, 1.011855939830468),
        "chin4a": (0.9997965958401762, 0.000183864866367, 0.9994036074421323),
    }
    for scheme, moments in expected.items():
        law = ss.diagnose.bath_law(scheme, step=0.5, gamma=1.0)
        np.testing.assert_allclose((law.q_squared, law.q_p, law.p_squared), moments, rtol=0, atol=2e-13)
        assert abs(law.free_temperature - 1) < 1e-13
        assert abs(law.free_diffusion - 1) < 1e-13
        assert law.defect < 1e-9
        assert "exp(-gamma h) = 0.606530659713, exactly" in str(law)
    law = ss.diagnose.bath_law("midpoint", step=0.5, gamma=1.0)
    assert abs(law.free_temperature - 0.5 / math.sinh(0.5)) < 1e-13
    assert law.defect < 1e-9


def test_friction_as_a_force():
    """F = -gamma p by the paper's recipe: rational factors, the laws of Groenbech-Jensen and Farago, of its swapped
    twin, and of the midpoint rule, which has both temperatures right and no factor of dp ^ dq.
    """
    step, gamma, omega = 0.4, 1.5, 1.3
    z, x = gamma * step, (step * omega) ** 2 / 4
    for scheme, factor, p2 in (
        ("lobatto2", (1 - z / 2) / (1 + z / 2), 1 - x),
        ("lobatto2_swapped", (1 - z / 2) / (1 + z / 2), 1 / (1 - x)),
        ("symplectic_euler", 1 / (1 + z), None),
        ("symplectic_euler_adjoint", 1 - z, None),
    ):
        law = ss.diagnose.bath_law(scheme, step=step, gamma=gamma, omega=omega, friction="force")
        told = re.fullmatch(r"times (.*) = (0\.\d+) with z = gamma h, at all of them", law.contraction)
        assert float(told[2]) == pytest.approx(factor, abs=1e-9)
        assert eval(told[1], {"z": z}) == pytest.approx(factor, abs=1e-14)
        assert law.defect == pytest.approx(abs(factor - math.exp(-z)), abs=1e-8)
        if p2 is not None:
            found = law.q_squared, law.q_p, law.p_squared, law.free_temperature, law.free_diffusion
            np.testing.assert_allclose(found, (1, 0, p2, 1, 1), rtol=0, atol=1e-12)
    law = ss.diagnose.bath_law("midpoint", step=step, gamma=gamma, omega=omega, friction="force")
    found = law.q_squared, law.q_p, law.p_squared, law.free_temperature, law.free_diffusion
    np.testing.assert_allclose(found, (1, 0, 1, 1, 1), rtol=0, atol=1e-12)
    told = re.fullmatch(r"times (0\.\d+) to (0\.\d+): it depends on the state", law.contraction)
    factors = midpoint_factors(step, gamma)
    assert [float(x) for x in told.groups()] == pytest.approx([min(factors), max(factors)], abs=1e-6)
    assert "F = -gamma p as a force" in str(law)
    assert "strong order    1 (derived)" in str(law)


@pytest.mark.parametrize(("friction", "gamma"), [("force", 0.1), ("damping", 1e-3)])
def test_factors_that_differences_do_not_tell_apart(friction, gamma):
    """At small gamma h no factor is called exact: others are nearer to it than the differences see."""
    law = ss.diagnose.bath_law("lobatto2", step=0.01, gamma=gamma, friction=friction)
    assert law.defect < 1e-8
    assert "exactly" not in law.contraction
    assert float(law.contraction.split()[1].strip(",")) == pytest.approx(math.exp(-gamma * 0.01), abs=2e-8)
    assert "too small to tell exp(-gamma h) from (1 - z/2)/(1 + z/2)" in law.contraction


def midpoint_factors(step, gamma):
    """(4 - 2z + h^2 U'')/(4 + 2z + h^2 U'') in the middle of steps of the pendulum with F = -gamma p."""
    states = ((0.3, -0.4), (1.7, 0.8), (-2.4, 1.1), (0.9, -1.6))
    found = []
    for (q, p), normal in zip(states, (0.4, -0.3, 0.7, 0.1), strict=True):
        middle, momentum = q, p
        for _ in range(200):
            momentum = p + (step * (-math.sin(middle) - gamma * momentum) + normal * math.sqrt(step)) / 2
            middle = q + step * momentum / 2
        stiff, z = step**2 * math.cos(middle), gamma * step
        found.append((4 - 2 * z + stiff) / (4 + 2 * z + stiff))
    return found


H_MIXED = "(p1**2 + p2**2)/2 + cos(q1 - q2) + q1**4/4 + q2**2 + 0.3*p1*p2*q1 + 0.2*p1**2*cos(q2)"
STEP, POINTS = 0.4, np.random.default_rng(1).normal(size=(4, 3)) * 0.6
J = np.kron([[0.0, 1.0], [-1.0, 0.0]], np.eye(2))
LOSS = {"one rate": 2 * 0.8, "rates": 0.5 + 1.5, "matrix": 0.9 + 1.6}  #: traces


@functools.cache
def models(kind, scheme):
    """Coupled models of the kind of damping: with noise in position, which all schemes take, and not separable."""
    given = damping_orders.KINDS[kind]
    noises = "additive" if scheme in {"drift_preserving", "verlet_dz"} else "position"
    formula = damping_orders.formula_for(scheme)
    mixed = ss.model_from_sympy(H_MIXED, noise=["0.3*sin(q1) + 0.1*p1*q2", "0.2*q1*q2"])
    return [damping_orders.model(kind, noises, formula), *([] if kind == "matrix" else [mixed.damped(given)])]


def tangents(model, scheme):
    """Derivatives of a step at the points, by differences of order six, (point, 4, 4)."""
    shifts = np.array([-3, -2, -1, 1, 2, 3]) / 64
    weights = np.array([-1, 9, -45, 45, -9, 1]) * 64 / 60
    moved = POINTS[:, None, None] + np.eye(4)[:, :, None, None] * shifts[:, None]
    starts = moved.reshape(4, -1)
    run = ss.simulate(model, scheme=scheme, q0=starts[:2], p0=starts[2:], step=STEP, steps=1, seed=5,
                      paths=starts.shape[1], common_noise=(1, 2))  # fmt: skip
    ends = np.concatenate([run.q[-1], run.p[-1]]).reshape(4, 4, 6, -1)
    return np.einsum("ijsp,s->pij", ends, weights)


@pytest.mark.parametrize("scheme", [*ss.schemes.names(), "lambda:0.3", "dirk:0.25", "word:BAOAB"])
def test_certificates_say_what_damped_steps_keep(scheme):
    """For every kind of damping: the factor of the form, that of volume, to rounding or to some order, or none."""
    lines = [line for line in ss.schemes.get(scheme).certificate().splitlines() if line.startswith("damped")]
    labels = dict.fromkeys(LOSS, lines[0]) | dict(zip(LOSS, lines, strict=False))
    for kind, loss in LOSS.items():
        worst = []
        for model in models(kind, scheme):
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")
                    tangent = tangents(model, scheme)
            except IncompatibleError:
                continue
            volume = np.abs(np.linalg.det(tangent) * math.exp(loss * STEP) - 1).max()
            form = np.abs(tangent.mT @ J @ tangent - math.exp(-loss * STEP / 2) * J).max()
            worst.append((volume, form))
        told = labels[kind]
        assert (not worst) == ("refused: it" in told)
        if not worst:
            continue
        volume, form = np.max(worst, axis=0)
        assert ("dp ^ dq times exp(-gamma h)" in told) == (form < 1e-9)
        assert ("no factor" in told) == (volume > 2e-3)
        if "order of the scheme" not in told and "no factor" not in told:
            assert volume < 1e-10
        elif scheme in {"gauss2", "gauss3", "lobatto3", "lobatto4"}:  # the words are needed
            assert volume > (1e-5 if scheme == "gauss2" else 1e-9)


def test_certificates_say_the_temperature_of_a_free_particle():
    """At gamma h = 1 certificates and bath laws have one number, and orders with one rate are those measured."""
    measured = damping_orders.json.loads(damping_orders.TARGET.read_text(encoding="utf-8"))
    for scheme, orders in measured.items():
        text = ss.schemes.get(scheme).certificate()
        told = re.search(r"free particle ([\d.]+)/beta at gamma h = 1", text)
        values = orders["one rate"].values()
        for value, noise in zip(values, ("with additive noise", "with noise in position"), strict=True):
            assert isinstance(value, str) or f"{value:.2f} {noise}" in text
        if told:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                law = ss.diagnose.bath_law(scheme, step=0.5, gamma=2.0)
            assert float(told[1]) == pytest.approx(law.free_temperature, rel=1e-5), scheme
        else:
            assert "refused" in text or "no factor" in text


@pytest.fixture(scope="module")
def figure():
    """The data of the figure of docs/method/open-systems.md."""
    file = Path(contraction.__file__).parent / "figures" / "contraction.json"
    return json.loads(file.read_text(encoding="utf-8"))


def test_the_figure_of_contraction_shows_closed_forms(figure):
    """Factors over exp(-z): one, the rational functions of F = -gamma p, and their largest and least values for U''
    between -1 and 1, which states come near to.
    """
    z = np.array(figure["z"])
    curves = {name: np.array(values) for name, values in figure["curves"].items()}
    np.testing.assert_allclose(curves["damping=, all symplectic schemes"], 1, rtol=0, atol=1e-6)
    for name, factor in (("lobatto2", (1 - z / 2) / (1 + z / 2)), ("symplectic_euler", 1 / (1 + z))):
        expected = np.tile(factor * np.exp(z), (2, 1))
        np.testing.assert_allclose(curves[f"force, {name}"], expected, rtol=1e-6, atol=1e-6)
    low, high = curves["force, midpoint"]
    least, most = ((4 - 2 * z + k) / (4 + 2 * z + k) * np.exp(z) for k in (-0.25, 0.25))
    assert (low > least - 1e-6).all() and (high < most + 1e-6).all()
    assert (high - low > 0.5 * (most - least)).all()
    assert np.ptp(curves["damping=, heun"], axis=0).min() > 0.01


def test_the_figure_of_contraction_is_measured_again(figure):
    """Some points of every curve."""
    for name, (schemes, forced) in contraction.CURVES.items():
        for i in (3, 17):
            rate = figure["z"][i] / contraction.STEP
            shares = [contraction.factors(x, rate, forced) * math.exp(figure["z"][i]) for x in schemes]
            found = [np.min(shares), np.max(shares)]
            assert [of[i] for of in figure["curves"][name]] == pytest.approx(found, abs=2e-6)


def test_refusals():
    """Refused: arguments that are no numbers, schemes without damped steps, steps that grow."""
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        ss.diagnose.bath_law("midpoint", step=1.0, gamma=25.0, omega=0.1)
    assert ["gamma*h = 25" in str(x.message) for x in found] == [True]
    for wrong in ({"step": 0.0}, {"gamma": -1.0}, {"omega": 0.0}):
        with pytest.raises(InvalidArgumentError, match="give a number above zero"):
            ss.diagnose.bath_law("chin4a", **{"step": 0.1, "gamma": 1.0, **wrong})
    with pytest.raises(UnknownNameError, match="friction = 'drag' does not exist: there are damping, force"):
        ss.diagnose.bath_law("chin4a", step=0.1, gamma=1.0, friction="drag")
    with pytest.raises(IncompatibleError, match=r"its kicks are exact for forces F.q,t. without p"):
        ss.diagnose.bath_law("chin4a", step=0.1, gamma=1.0, friction="force")
    with pytest.raises(IncompatibleError, match="is damped, and scheme averaged_shift_midpoint"):
        ss.diagnose.bath_law("averaged_shift_midpoint", step=0.1, gamma=1.0)
    with pytest.raises(IncompatibleError, match=r"steps of word:BAOAB grow at omega h = 3, gamma h = 0.1"):
        ss.diagnose.bath_law("word:BAOAB", step=1.0, gamma=0.1, omega=3.0)
