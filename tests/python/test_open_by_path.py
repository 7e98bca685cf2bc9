# SPDX-License-Identifier: BSD-3-Clause
"""Parameters by path of models with forces, damping and heat baths: each path is that of a run of it alone, or the
array is refused, and sweeps run all of them."""

import pickle

import numpy as np
import pytest
import symsde as ss
from symsde import errors

RUN = {"q0": 0.7, "p0": 0.2, "step": 0.05, "steps": 20, "seed": 5, "threads": 1}
PATHS, SOME = 11, (0, 4, 10)
VALUES = np.linspace(0.8, 2.0, PATHS)
BATH = {"beta": 2.0, "gamma": 0.5}
FORMULA = {"H": "p**2/2 - k*cos(q)", "noise": ["s*sin(q)"]}

pytestmark = pytest.mark.filterwarnings("ignore::symsde.errors.OwnNoiseWarning")


def drag(q, p, t):
    return -0.3 * p * np.abs(p)


def noisy(k=1.3, **given):
    """A pendulum with noise of its own."""
    return ss.model_from_sympy(**FORMULA, params={"k": k, "s": 0.4}, **given)


def quiet(k=1.3, m=1.0):
    """A pendulum without noise; a mass of 1 is folded."""
    return ss.model_from_sympy("p**2/(2*m) - k*cos(q)", params={"k": k, "m": m})


def synchrotron(k=1.3):
    return ss.models.synchrotron(omega=k)


OPEN = {
    "forced": lambda k=1.3: noisy(k).forced(drag),
    "damped": lambda k=1.3: noisy(k).damped(0.3),
    "matrix": lambda k=1.3: noisy(k).damped([[0.3]]),
    "function": lambda k=1.3: noisy(k).damped(lambda q: 0.3 + q[0] ** 2),
    "bath": lambda k=1.3: ss.thermostat(quiet(k), **BATH),
    "bath of a mass": lambda k=1.3: ss.thermostat(quiet(k, 1.5), **BATH),
    "bath and noise": lambda k=1.3: ss.thermostat(noisy(k), **BATH),
    "forced, then bath": lambda k=1.3: ss.thermostat(quiet(k).forced(drag), **BATH),
    "bath, then forced": lambda k=1.3: ss.thermostat(quiet(k), **BATH).forced(drag),
    "built in, forced": lambda k=1.3: synchrotron(k).forced(drag),
    "built in, bath": lambda k=1.3: ss.thermostat(synchrotron(k), **BATH),
}


@pytest.mark.usefixtures("quick_compiler")
@pytest.mark.parametrize("name", OPEN)
def test_each_path_alone(name):
    """A path has the bits of the path alone with an array of one, and is that of the model with its number;
    with_parameters, a copy from a pickle where functions have names, and a sweep have the same bits."""
    make = OPEN[name]
    key = "omega" if name.startswith("built in") else "k"
    model, schemes = make(VALUES), ["midpoint", "gauss2", *([] if "forced" in name else ["chin4a"])]
    changed = make().with_parameters(**{key: VALUES})
    assert repr(changed) == repr(model)
    for scheme in schemes:
        found = ss.simulate(model, scheme=scheme, paths=PATHS, **RUN)
        others = [changed, *([] if name == "function" else [pickle.loads(pickle.dumps(model))])]
        for other in others:
            assert np.array_equal(ss.simulate(other, scheme=scheme, paths=PATHS, **RUN).q, found.q)
        swept = ss.sweep(make(), {key: VALUES}, scheme=scheme, keep_paths=True, **RUN)
        assert np.array_equal(swept.q[..., 0], found.q)
        for i in SOME:
            alone = ss.simulate(make(VALUES[i : i + 1]), scheme=scheme, first_path=i, **RUN)
            assert np.array_equal(alone.q[..., 0], found.q[..., i]) and np.array_equal(alone.p[..., 0], found.p[..., i])
            number = ss.simulate(make(VALUES[i]), scheme=scheme, first_path=i, **RUN)
            np.testing.assert_allclose(number.q[..., 0], found.q[..., i], rtol=0, atol=1e-13)
    assert np.ptp(found.q[-1]) > 0.1


@pytest.mark.usefixtures("quick_compiler")
@pytest.mark.parametrize("name", ["bath", "forced, then bath", "bath, then forced", "built in, bath"])
def test_shards_of_baths(name):
    """Pieces of a run have the rows of their paths: the moments of the whole."""
    model = OPEN[name](np.linspace(0.8, 2.0, 512))
    given = {**RUN, "paths": 512, "save_every": 20, "scheme": "midpoint"}
    whole = ss.moments(model, **given)
    assert np.array_equal(ss.ensemble(model, shard_paths=256, **given).mean_q, whole.mean_q)


@pytest.mark.usefixtures("quick_compiler")
def test_noise_follows_masses():
    """A bath around a model of another mass has its rate and the noise of that mass, sigma^2 = 2 gamma m/beta."""
    for bath in (ss.thermostat(quiet(), **BATH), ss.thermostat(quiet().forced(drag), **BATH)):
        heavy = bath.with_parameters(m=3.0)
        sigma = -heavy.gradient(0.3, 0.1, w=[0.0, 1.0])[0].item()
        np.testing.assert_allclose(sigma**2, 2 * BATH["gamma"] * 3.0 / BATH["beta"], rtol=1e-14)
        assert heavy.damping == (BATH["gamma"],) and "bath at beta=2" in repr(heavy)
        assert bool(heavy._forces) == bool(bath._forces)
        with pytest.raises(errors.IncompatibleError, match=r"masses of model .* differ from path to path"):
            bath.with_parameters(m=VALUES)
    other = ss.thermostat(quiet(), **BATH).damped(0.1)  # another friction is that of no bath
    assert not other._bath and other._bathed is None


SWEPT = {
    "force": (lambda a=0.4: noisy_with(a, force="-a*p**3 + k*sin(t)"), "a"),
    "noise force": (lambda a=0.4: noisy_with(a, noise_force=["a*p"]), "a"),
    "friction": (lambda a=0.4: noisy_with(a, force="-a*p"), "a"),
    "damping": (lambda a=0.4: noisy_with(a, damping="a*(1 + q**2)"), "a"),
    "rate": (lambda a=0.4: noisy_with(a, damping="a"), "a"),
    "both": (lambda a=0.4: noisy_with(a, force="-a*p**3", damping="a*(1 + q**2)"), "a"),
    "bath and force": (lambda a=0.4: ss.thermostat(noisy_with(a, force="-a*p**3"), **BATH), "a"),
    "bath of masses": (lambda m=1.4: ss.thermostat(quiet(1.3, m), **BATH), "m"),
    "bath of own noises": (lambda a=1.2: ss.thermostat(noisy_with(a, H="p**2/2 - a*cos(q)"), beta=2.0), "a"),
}


def noisy_with(a, H=FORMULA["H"], **given):
    params = {"k": 1.3, "s": 0.4, "a": a}
    params = params if FORMULA["H"] == H else {name: params[name] for name in "sa"}
    return ss.model_from_sympy(H, FORMULA["noise"], params=params, **given)


@pytest.mark.usefixtures("quick_compiler")
@pytest.mark.parametrize("name", SWEPT)
def test_sweeps_run_values_one_by_one(name):
    """Where an array is refused, a sweep has the bits of a run of each value."""
    make, key = SWEPT[name]
    with pytest.raises(errors.IncompatibleError, match=r"run for each value, as ss.sweep does|bath for each mass"):
        make().with_parameters(**{key: VALUES})
    values = [VALUES[0], *VALUES[::5]]  # the first two are equal, and masses that are equal may be an array
    found = ss.sweep(make(), {key: values}, paths=3, keep_paths=True, scheme="midpoint", **RUN)
    for i, value in enumerate(values):
        alone = ss.simulate(make(value), paths=3, first_path=3 * i, scheme="midpoint", **RUN)
        assert np.array_equal(found.q[:, :, i], alone.q) and np.array_equal(found.p[:, :, i], alone.p)
        np.testing.assert_allclose(found.mean_q[-1, 0, i], alone.q[-1].mean(), rtol=1e-13)
    assert np.ptp(found.q[-1, 0, :, 0]) > 1e-3


@pytest.mark.usefixtures("quick_compiler")
def test_sweeps_over_friction_and_temperature():
    """A function makes the bath of each rate and temperature."""
    free = quiet()

    def bath(gamma, beta):
        return ss.thermostat(free, gamma=gamma, beta=beta)

    grid = {"gamma": [0.2, 1.0], "beta": [1.0, 4.0, 9.0]}
    found = ss.sweep(bath, grid, paths=3, keep_paths=True, same_noise=True, scheme="verlet_kdk", **RUN)
    assert found.q.shape == (21, 1, 2, 3, 3)
    for i, gamma in enumerate(grid["gamma"]):
        for j, beta in enumerate(grid["beta"]):
            alone = ss.simulate(bath(gamma, beta), paths=3, scheme="verlet_kdk", **RUN)
            assert np.array_equal(found.q[:, :, i, j], alone.q)


def test_what_a_sweep_cannot_change():
    """Refusals of models that take no other values, arrays or numbers, stay as they are."""
    line = ss.model_from_sympy("p**2/2 + q**2/2", noise=["-s*q"], params={"s": 1.0})
    with pytest.raises(errors.IncompatibleError, match="then call thermostat"):
        ss.sweep(ss.thermostat(line, beta=2.0), {"s": VALUES}, **RUN)
    with pytest.raises(errors.UnknownNameError, match="'z' does not exist: there are s"):
        ss.sweep(ss.thermostat(line.with_parameters(s=0.0), **BATH), {"z": VALUES}, **RUN)
