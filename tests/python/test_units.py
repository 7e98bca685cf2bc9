# SPDX-License-Identifier: BSD-3-Clause
"""The same paths in other units of length, momentum and time: powers of two, so that they differ by rounding alone."""

import re

import numpy as np
import pytest
import symsde as ss
from symsde import errors

pytestmark = [
    pytest.mark.usefixtures("quick_compiler"),
    pytest.mark.filterwarnings("error:noise of Lipschitz constant"),  # which is small in all of these
]

#: units of q, p and t: metres, seconds and kilograms for an atom; a heavy body; a small one with the mass one; an ion
UNITS = {
    "atom": (2.0**-34, 2.0**-70, 2.0**-50),
    "heavy": (2.0**-10, 2.0**70, 2.0**-10),
    "small": (2.0**-30, 2.0**20, 2.0**-50),
    "slow": (2.0**10, 2.0**-40, 2.0**50),
    "ion": (2.0**-20, 2.0**-86, 2.0**-23),
}
ONE = (1.0, 1.0, 1.0)
WELL = "P1**2/2 + P2**2/3 + Q1**2*Q2**2/2 + Q1**2/2 + Q2**2"
OSCILLATORS = "P1**2/2 + P2**2/3 + Q1**2/2 + Q2**2 + Q1*Q2/5"
#: H and noises of Q, P and T without units, and rates, a matrix of friction, a force or a bath at (beta, gamma)
MODELS = {
    "closed": (WELL, ["0.3*sin(Q1)*cos(T)", "0.2*Q2**2"], {}),
    "wells": (WELL + " - 1.3*(Q1**2 + Q2**2)/2 + (Q1**4 + Q2**4)/4", ["0.3*Q1", "0.2*Q2**2"], {}),
    "rates": (WELL, ["0.3*Q1", "0.2*Q2 + 0.1*Q1"], {"damping": [0.5, 0.2]}),
    "matrix": (WELL, ["0.3*Q1", "0.2*Q2 + 0.1*Q1"], {"damping": [[0.7, 0.2], [0.2, 0.4]]}),
    "in time": (WELL, ["0.3*(1 + cos(T)/100)*Q1", "0.2*Q2"], {"damping": [0.5, 0.2]}),
    "bath": (WELL, [], {"bath": (2.0, [0.5, 0.0])}),
    "force": (WELL, ["0.3*sin(Q1)"], {"force": ["0.3*Q2 - 0.1*Q1**2", "-0.3*Q1"]}),
    "field": ("((P1 + Q2)**2 + (P2 - Q1)**2)/2 + Q1**4/4 + Q1**2*Q2**2/4", ["0.3*sin(Q1)", "0.2*Q2"], {}),
}
LINEAR = {
    "constant": (OSCILLATORS, ["0.3*Q1", "0.2*Q2 + 0.1*Q1"], {}),
    "rates": (OSCILLATORS, ["0.3*Q1", "0.2*Q2 + 0.1*Q1"], {"damping": [0.7, 0.2]}),
    "matrix": (OSCILLATORS, ["0.3*Q1", "0.2*Q2 + 0.1*Q1"], {"damping": [[0.7, 0.2], [0.2, 0.4]]}),
    "bath": (OSCILLATORS, [], {"bath": (2.0, [0.5, 0.0])}),
    "kubo": ("(P1**2 + Q1**2 + P2**2 + Q2**2)/2", ["0.3*(P1**2 + Q1**2)/2", "0.1*(P2**2 + Q2**2)"], {}),
}
SPRING = ("(P1**2 + Q1**2 + P2**2 + Q2**2)/2", ["0.3*Q1**2/2"], {})  # moments, but no exact paths


def in_units(case, units):
    """The model in which q, p and t are numbers of these units."""
    drift, noises, more = case
    length, momentum, time = units
    energy = length * momentum / time

    def told(text, factor):
        text = re.sub(r"Q(\d)", r"(a*q\1)", re.sub(r"P(\d)", r"(b*p\1)", text.replace("T", "(c*t)")))
        return f"{factor}*({text})"

    given = {"params": {"a": 1 / length, "b": 1 / momentum, "e": energy, "s": energy * np.sqrt(time)}}
    if any("T" in x for x in noises):
        given["params"]["c"] = 1 / time
    if not noises:
        del given["params"]["s"]
    if "damping" in more:
        rates = np.array(more["damping"])
        given["damping"] = rates / time if rates.ndim == 1 else rates * momentum / length
    if "force" in more:
        given["force"] = [told(x, "f") for x in more["force"]]
        given["params"]["f"] = momentum / time
    model = ss.model_from_sympy(told(drift, "e"), [told(x, "s") for x in noises], **given)
    if "bath" in more:
        beta, gamma = more["bath"]
        model = ss.thermostat(model, beta=beta / energy, gamma=np.array(gamma) / time)
    return model


def run(case, units, scheme, **more):
    """Some steps from the same state."""
    length, momentum, time = units
    q0, p0 = np.array([0.5, 0.3]) * length, np.array([0.2, -0.4]) * momentum
    given = {"q0": q0, "p0": p0, "step": 0.1 * time, "steps": 8, "paths": 6, "seed": 5, **more}
    return ss.simulate(in_units(case, units), scheme=scheme, **given)


def states(q, p, units):
    return np.concatenate([q / units[0], p / units[1]], axis=1)


SCHEMES = ("midpoint", "stormer_verlet", "gauss2", "gauss2_strong32", "gauss_dkdkd", "verlet_kdk", "chin4a",
           "gauss_dkdkd_strong2", "chin4a_strong2", "gauss_dkdkd_midpoint")  # fmt: skip


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("name", MODELS)
def test_steps(name, scheme):
    """Noise of damped flows, flows of a quadratic part, brackets and kicks."""
    try:
        known = run(MODELS[name], ONE, scheme)
    except errors.IncompatibleError:
        assert scheme == "gauss2_strong32" and set(MODELS[name][2])  # of open systems
        return
    for units in UNITS.values():
        found = run(MODELS[name], units, scheme)
        assert not found.status.any()
        np.testing.assert_allclose(states(found.q, found.p, units), states(known.q, known.p, ONE), rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", LINEAR)
def test_exact_solutions(name):
    """On the path of a run: paths, and what increments do not tell of constant noise."""
    known = states(*ss.diagnose.exact(run(LINEAR[name], ONE, "midpoint")), ONE)
    for units in UNITS.values():
        found = states(*ss.diagnose.exact(run(LINEAR[name], units, "midpoint")), units)
        np.testing.assert_allclose(found, known, rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", [*LINEAR, "spring"])
def test_exact_moments(name):
    def moments(units):
        scale = np.repeat(units[:2], 2)
        model = in_units((LINEAR | {"spring": SPRING})[name], units)
        q0, p0 = np.array([0.5, 0.3]) * units[0], np.array([0.2, -0.4]) * units[1]
        found = ss.diagnose.exact_moments(model, q0=q0, p0=p0, t=np.array([0.5, 10.0]) * units[2])
        return found.mean / scale, found.covariance / np.outer(scale, scale)

    known = moments(ONE)
    for units in UNITS.values():
        for x, y in zip(moments(units), known, strict=True):
            np.testing.assert_allclose(x, y, rtol=0, atol=2e-12)


@pytest.mark.parametrize("units", [ONE, *UNITS.values()])
def test_what_has_no_exact_solution(units):
    """Flows that do not commute, and noise that changes in time."""
    with pytest.raises(errors.SymsdeError, match="flows that do not commute"):
        ss.diagnose.exact(run(SPRING, units, "midpoint"))
    with pytest.raises(errors.IncompatibleError, match="change in time"):
        model = in_units((OSCILLATORS, ["0.3*Q1*cos(T)"], {}), units)
        ss.diagnose.exact_moments(model, q0=0.0, p0=0.0, t=units[2])


def own_flows(units, gradient):
    """Exact flows of sqrt(1 + P^2), and of Q^4/4 and 0.3 sin Q, and the gradient of all."""
    length, momentum, time = units

    def drift(t, tau, q, p):
        return q + length * tau / time * (p / momentum) / np.sqrt(1 + (p / momentum) ** 2), p

    def forces(w, q):
        return momentum * (w[0] / time * (q / length) ** 3 + w[1] / np.sqrt(time) * 0.3 * np.cos(q / length))

    def kick(t, w, q, p):
        return q, p - forces(w, q)

    def slopes(t, w, q, p):
        return forces(w, q), w[0] * length / time * (p / momentum) / np.sqrt(1 + (p / momentum) ** 2)

    return ss.Model(ndof=1, nnoise=1, drift=drift, kick=kick, gradient=slopes if gradient else None)


@pytest.mark.parametrize("gradient", [False, True])
@pytest.mark.parametrize("units", [*UNITS.values(), (2.0**-30, 2.0**-26, 2.0**-50), (2.0**10, 2.0**-10, 2.0**40)])
def test_own_flows(units, gradient):
    """No flow is refused for differences without digits, nor for those of steps that are long for its momenta."""

    def run(units):
        given = {"q0": 0.8 * units[0], "p0": 0.3 * units[1], "step": 0.1 * units[2], "steps": 8, "paths": 4, "seed": 1}
        found = ss.simulate(own_flows(units, gradient), scheme="gauss_dkdkd", **given)
        return states(found.q, found.p, units)

    np.testing.assert_allclose(run(units), run(ONE), rtol=0, atol=1e-13)
