# SPDX-License-Identifier: BSD-3-Clause
"""What reports of runs tell of a heat bath: both temperatures, where the momenta stand; friction as a formula."""

import pickle
import re

import numpy as np
import pytest
import symsde as ss
from symsde.batch import scene
from symsde.errors import IncompatibleError

WELL = ss.model_from_sympy("p**2/(2*m) + k*q**4/4", params={"m": 2.5, "k": 1.3})
BATH = ss.thermostat(WELL, beta=2.0, gamma=0.7)
RUN = {"q0": 0.4, "p0": 0.3, "step": 0.2, "steps": 30, "save_every": 30, "seed": 2}


def numbers(text):
    """Kinetic temperature, its error, configurational temperature, its error, of the bath, time."""
    found = re.search(
        r"kinetic (\S+) \+- (\S+), configurational (\S+) \+- (\S+), of the bath kT = (\S+), at t = (\S+) over", text
    )
    return [float(x) for x in found.groups()]


@pytest.mark.parametrize("scheme", ["gauss_dkdkd", "word:BAOAB", "gjf", "midpoint"])
def test_reports_tell_both_temperatures(scheme):
    """Means over the last states with their errors, and that momenta stand at the ends of whole steps."""
    run = ss.simulate(BATH, scheme=scheme, paths=400, **RUN)
    q, p = run.q[-1], run.p[-1]
    kinetic, force, stiffness = p[0] ** 2 / 2.5, (1.3 * q[0] ** 3) ** 2, 3.9 * q[0] ** 2
    ratio = force.mean() / stiffness.mean()
    expected = [kinetic.mean(), kinetic.std(ddof=1) / 20, ratio,
                (force - ratio * stiffness).std(ddof=1) / 20 / stiffness.mean(), 0.5, 6.0]  # fmt: skip
    found = numbers(run.report.temperature)
    np.testing.assert_allclose(found, expected, rtol=0.03)  # errors have two digits
    np.testing.assert_allclose(found[::2], expected[::2], rtol=2e-4)
    assert run.report.temperature.endswith("positions and momenta stand at the same times, the ends of whole steps")
    assert "\ntemperature kinetic " in str(run.report)
    # the state that BAOAB, kicks and tableaux save is the one after the whole step: half a step more is another state
    other = ss.simulate(BATH, scheme=scheme, paths=400, **{**RUN, "steps": 31, "save_every": 31})
    assert numbers(other.report.temperature)[0] != numbers(run.report.temperature)[0]


def test_moments_tell_what_they_hold():
    """Kinetic temperature from <p^2>, both from the observables; nothing of models without a bath."""
    mom = ss.moments(BATH, scheme="gauss_dkdkd", paths=300, **RUN)
    kinetic = (mom.mean_p[-1, 0] ** 2 + mom.var_p[-1, 0] * 299 / 300) / 2.5
    assert f"kinetic {kinetic:.4g}, of the bath kT = 0.5, at t = 6" in mom.report.temperature
    assert "observables=ss.observe.temperature(model) collects both" in mom.report.temperature
    both = ss.moments(BATH, scheme="gauss_dkdkd", paths=300, observables=ss.observe.temperature(BATH), **RUN)
    seen = ss.observe.temperatures(both)
    assert f"kinetic {seen.kinetic[-1]:.4g} +-" in both.report.temperature
    assert f"configurational {seen.configurational[-1]:.4g} +- {seen.se_configurational[-1]:.2g}" in (
        both.report.temperature
    )
    for model in (WELL, WELL.damped(0.7)):
        assert ss.simulate(model, paths=3, **RUN).report.temperature == ""
        assert ss.moments(model, paths=3, **RUN).report.temperature == ""
    several = ss.thermostat(ss.models.henon_heiles(sigma1=0.0, sigma2=0.0), beta=[1.0, 4.0], gamma=1.0)
    assert "kT = 0.25 to 1, " in ss.simulate(several, q0=0.1, p0=0.1, step=0.1, steps=3, paths=5).report.temperature


def test_a_report_survives_functions_that_fail():
    """A model whose functions fail at the last state tells so, and its run stands."""

    def gradient(t, w, q, p):
        if t > 0.96:
            raise ValueError("beyond the end")
        return w[0] * q, w[0] * p

    own = ss.Model(ndof=1, nnoise=0, gradient=gradient, separable=True, identity_mass=True)
    run = ss.simulate(ss.thermostat(own, beta=1.0, gamma=1.0), q0=0.1, p0=0.0, step=0.1, steps=10, paths=3,
                      scheme="midpoint")  # fmt: skip
    assert run.report.status == 0
    assert "not known: at the last states" in run.report.temperature


FIELD = {"params": {"s": 0.9, "m": 1.7}}
NOISES = ["s*sin(q)", "s*q**2/4"]


def test_friction_of_noises_is_a_formula(tmp_path):
    """It pickles, takes other values of parameters, is derived and compiled, and stands in scenes."""
    bare = ss.model_from_sympy("p**2/(2*m) + q**4/4", noise=NOISES, **FIELD)
    friction = "-(s**2*cos(q)**2 + s**2*q**2/4)*p/m"
    by_hand = ss.model_from_sympy("p**2/(2*m) + q**4/4", noise=NOISES, force=[friction], **FIELD)
    bath = ss.thermostat(bare, beta=2.0)
    assert not bath.in_python
    run = {"q0": 0.7, "p0": 0.3, "step": 0.05, "steps": 20, "seed": 5, "paths": 20}
    for changed in ({}, {"s": 0.4}):
        known = ss.simulate(by_hand.with_parameters(**changed), **run)
        again = pickle.loads(pickle.dumps(bath.with_parameters(**changed)))
        for model in (bath.with_parameters(**changed), again, again.damped(0.5).damped(0.0)):
            found = ss.simulate(model, **run)
            np.testing.assert_allclose(found.p, known.p, rtol=0, atol=1e-13)
            assert found.report.counters["iterations"] == known.report.counters["iterations"]
    assert "bath at beta=2" in repr(again)
    assert "of the bath kT = 0.5" in found.report.temperature
    with pytest.raises(IncompatibleError, match="the friction of a bath is found from noises of Hamiltonians"):
        ss.thermostat(bath, beta=2.0)
    file = tmp_path / "scene.toml"
    file.write_text(
        '[model]\nH = "p**2/(2*m) + q**4/4"\nnoise = ["s*sin(q)", "s*q**2/4"]\nthermostat = {beta = 2.0}\n'
        "[model.params]\ns = 0.9\nm = 1.7\n[run]\nstep = 0.05\nsteps = 20\nq0 = 0.7\np0 = 0.3\nseed = 5\npaths = 20\n",
        encoding="utf-8",
    )
    read = scene.load(file)
    np.testing.assert_array_equal(ss.simulate(read.model, **read.run).p, ss.simulate(bath, **run).p)


def test_friction_of_any_hamiltonian_noise_is_stationary():
    """F = -beta/2 sum_k H_k,q (H_k,q . H_p) of two degrees of freedom and a mass that depends on q: the Fokker-Planck
    equation of exp(-beta H) holds in numbers, sum over i of d/dp_i ((F_i + beta/2 D_ij H_p_j) exp(-beta H)) = 0."""
    text = "(p1**2*(1 + q2**2) + p2**2)/2 + p1*p2/5 + q1**4/4 + q2**2"
    bath = ss.thermostat(ss.model_from_sympy(text, noise=["sin(q1*q2)", "q1**2 - q2"]), beta=1.5)
    q, p = np.array([[0.4, -0.8], [0.7, 0.3]]), np.array([[0.2, 0.5], [-0.6, 0.9]])
    hp = bath.gradient(q, p)[1]
    rows = [bath.gradient(q, p, np.eye(3)[k])[0] for k in (1, 2)]
    expected = -0.75 * sum(r * (r * hp).sum(axis=0) for r in rows)
    step = 1e-6
    run = ss.simulate(bath, scheme="heun", q0=q, p0=p, paths=2, step=step, steps=1, increments=np.zeros((1, 2, 2)))
    pull = (run.p[1] - run.p[0]) / step + bath.gradient(q, p)[0]
    np.testing.assert_allclose(pull, expected, rtol=0, atol=2e-4)
