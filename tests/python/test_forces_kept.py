# SPDX-License-Identifier: BSD-3-Clause
"""Forces, friction of noises and masses by path survive a change of parameters, or the change is refused."""

import json
import pickle

import numpy as np
import pytest
import symsde as ss
from symsde import errors

RUN = {"q0": 0.4, "p0": 0.2, "step": 0.1, "steps": 20, "seed": 3, "threads": 1}
OSCILLATOR = ss.model_from_sympy("p**2/2 + q**2/2", noise=["-s*q"], params={"s": 1.0})


def drag(q, p, t):
    return -5 * p**3 + 10


def stronger_drag(q, p, t):
    return -5 * p**3 + 10.01


def last(model, **given):
    return ss.simulate(model, **{**RUN, **given}).q[-1]


@pytest.mark.parametrize(
    "model",
    [
        OSCILLATOR.forced(drag),
        OSCILLATOR.damped(0.3).forced(drag),
        OSCILLATOR.forced(drag).damped(0.3),
        ss.models.kubo(sigma=1.0).forced(drag).damped(0.3),
        ss.model_from_sympy("p**2/2 + q**2/2", noise=["-s*q"], params={"s": 1.0}, force="-p**3").forced(drag),
    ],
)
def test_parameters_leave_forces(model):
    """A model with the same values, or with values changed and changed back, has the same paths; so has a sweep."""
    name = next(iter({"s", "sigma"} & set(model.parameters)))
    again = model.with_parameters(**{name: 0.5}).with_parameters(**{name: 1.0})
    np.testing.assert_array_equal(last(model), last(again))
    swept = ss.sweep(model, {name: [0.5, 1.0]}, paths=2, same_noise=True, save_every=20, **RUN)
    for k, value in enumerate((0.5, 1.0)):
        alone = ss.moments(model.with_parameters(**{name: value}), paths=2, save_every=20, **RUN)
        np.testing.assert_allclose(swept.mean_q[-1].ravel()[k], alone.mean_q[-1, 0], rtol=1e-12)


def test_shards_of_forced_models_by_path():
    model = OSCILLATOR.with_parameters(s=np.linspace(0.3, 1.0, 512)).forced(drag)
    given = {**RUN, "paths": 512, "save_every": 20}
    np.testing.assert_array_equal(
        ss.ensemble(model, shard_paths=256, **given).mean_q, ss.moments(model, **given).mean_q
    )


@pytest.mark.parametrize(
    "other", [OSCILLATOR.forced(stronger_drag), OSCILLATOR, OSCILLATOR.forced(noise_force=lambda q, p, t: [p])]
)
def test_folders_refuse_other_forces(tmp_path, other):
    given = {**RUN, "paths": 256, "save_every": 20, "out": tmp_path / "run"}
    ss.ensemble(OSCILLATOR.forced(drag), **given)
    ss.ensemble(OSCILLATOR.forced(drag), **given)
    with pytest.raises(errors.SymsdeError):
        ss.ensemble(other, **given)


def test_friction_of_noises_hangs_on_parameters():
    for noise in ("-s*q", "-s*sin(q)"):
        model = ss.model_from_sympy("p**2/2 + q**2/2", noise=[noise], params={"s": 1.0})
        bath = ss.thermostat(model, beta=2.0)
        if noise == "-s*q":  # rates were found for one value; friction that is a formula goes with its parameters
            with pytest.raises(errors.IncompatibleError, match="then call thermostat"):
                bath.with_parameters(s=2.0)
        else:
            new = ss.thermostat(model.with_parameters(s=2.0), beta=2.0)
            runs = [ss.simulate(x, **RUN).p for x in (bath.with_parameters(s=2.0), new)]
            np.testing.assert_array_equal(*runs)
        with pytest.raises(errors.IncompatibleError, match="differ from path to path"):
            ss.thermostat(model.with_parameters(s=np.array([1.0, 2.0, 3.0])), beta=2.0)
        with pytest.raises(errors.IncompatibleError, match="forces act"):
            ss.thermostat(model.forced(drag), beta=2.0)


def test_a_matrix_of_friction_has_one_mass():
    model = ss.model_from_sympy("p1**2/(2*m) + p2**2/2 + s*q1*q2", params={"m": 1.0, "s": 0.1})
    gamma = [[0.5, 0.2], [0.2, 0.7]]
    with pytest.raises(errors.IncompatibleError, match="masses"):
        model.with_parameters(m=np.array([1.0, 5.0])).damped(gamma)
    with pytest.raises(errors.IncompatibleError, match="masses"):
        model.damped(gamma).with_parameters(m=np.array([1.0, 5.0]))
    many = model.with_parameters(s=np.array([0.1, 0.2])).damped(gamma)
    run = {**RUN, "scheme": "verlet_kdk"}
    alone = last(model.with_parameters(s=0.2).damped(gamma), **run)
    np.testing.assert_allclose(last(many, paths=2, **run)[:, 1], alone[:, 0], rtol=1e-12)


def test_one_model_for_all_paths():
    model = OSCILLATOR.with_parameters(s=np.array([0.5, 1.0]))
    for call in (ss.diagnose.euler_lagrange_residual, ss.diagnose.action):
        with pytest.raises(errors.IncompatibleError, match="differ from path to path"):
            call(ss.simulate(model, paths=2, **RUN))
    with pytest.raises(errors.IncompatibleError, match="differ from path to path"):
        ss.observe.temperature(model)


def test_sweeps_refuse_observables_of_one_model():
    bath = ss.model_from_sympy("p**2/(2*m) + q**2/2", noise=["-q"], params={"m": 1.0}, damping=0.5)
    with pytest.raises(errors.IncompatibleError, match="kinetic_temperature has the parameters of one model"):
        ss.sweep(bath, {"m": [1.0, 4.0]}, paths=2, observables=ss.observe.temperature(bath), **RUN)


def test_files_name_forces(tmp_path):
    model = OSCILLATOR.forced(drag)
    ss.simulate(model, **RUN).save(tmp_path / "run.npz")
    found = ss.load(tmp_path / "run.npz")
    assert json.loads(found.attributes()["forces"]) == {"force": "drag"}
    ss.simulate(OSCILLATOR, **RUN).save(tmp_path / "free.npz")
    assert "forces" not in ss.load(tmp_path / "free.npz").attributes()


def test_convergence_finds_a_reference_that_takes_forces():
    found = ss.convergence(OSCILLATOR.forced(drag), q0=0.1, p0=0.0, horizon=1.0, steps=(16, 32, 64), paths=100, seed=1)
    assert "against gauss2" in str(found)
    assert 0.7 < found.order < 1.2


def test_units_of_time_do_not_hide_forces(tmp_path):
    """Folders know a force that is 0.1 % off where times are of the order of 1e-12 or 1e12."""
    for k, unit in enumerate((1e-12, 1e12)):
        model = ss.model_from_sympy("p**2/2 + w**2*q**2/2", params={"w": 1 / unit})
        acting = [model.forced(lambda q, p, t, a=a / unit: -a * p) for a in (0.5, 0.5005)]
        given = {**RUN, "p0": 0.2 / unit, "step": 0.1 * unit, "paths": 256, "save_every": 20, "out": tmp_path / str(k)}
        ss.ensemble(acting[0], **given)
        ss.ensemble(acting[0], **given)
        with pytest.raises(errors.SymsdeError, match="holds another run"):
            ss.ensemble(acting[1], **given)


def test_pickles_refuse_other_parameters():
    bath = pickle.loads(pickle.dumps(ss.thermostat(OSCILLATOR, beta=2.0)))
    with pytest.raises(errors.IncompatibleError, match="then call thermostat"):
        bath.with_parameters(s=2.0)


def drag_of(damping=None, **values):
    """A pendulum with forces and noise forces that hold parameters."""
    params = {"k": 1.3, "s": 0.4, "g": 0.5} | values
    forces = {"force": "-g*p**3 + 0.2*q*k", "noise_force": ["0", "g*cos(q)"], "damping": damping}
    return ss.model_from_sympy("p**2/2 - k*cos(q)", ["s*sin(q)", "0"], params=params, **forces)


def rubbed(**values):
    """A force that is friction, with a rate that may vanish."""
    params = {"k": 1.3, "s": 0.4, "g": 0.5, "c": 0.7} | values
    return ss.model_from_sympy("p**2/2 - k*cos(q)", ["s*sin(q)"], params=params, force="-(g + c)*p")


def bathed(**values):
    """A model whose friction belongs to its noises."""
    model = ss.model_from_sympy("p**2/2 - k*cos(q)", ["s*sin(q)"], params={"k": 1.3, "s": 0.4} | values)
    return ss.thermostat(model, beta=2.0)


@pytest.mark.usefixtures("quick_compiler")
@pytest.mark.parametrize(
    ("make", "values"),
    [
        (drag_of, {"k": 1.7, "g": 0.9}),
        (lambda **x: drag_of(0.3, **x), {"g": 0.9}),
        (lambda **x: drag_of("g*q**2 + k", **x), {"g": 0.9}),
        (rubbed, {"g": 0.9, "k": 1.1}),
        (bathed, {"s": 0.6}),
    ],
)
def test_forces_take_values_as_data(monkeypatch, make, values):
    """Other values give the paths of a model that is made with them, and nothing is derived again."""
    model, theirs = make(), make(**values)

    def derived(*_given):
        raise AssertionError("derived again")

    monkeypatch.setattr("symsde.model.formulas.formula_code.derived", derived)
    other = model.with_parameters(**values)
    found = last(other, scheme="midpoint")
    assert np.array_equal(found, last(theirs, scheme="midpoint")) and repr(other) == repr(theirs)
    assert not np.array_equal(found, last(model, scheme="midpoint"))
    back = other.with_parameters(**{name: model.parameters[name] for name in values})
    assert np.array_equal(last(back, scheme="midpoint"), last(model, scheme="midpoint"))
    if make is drag_of:
        wide = [ss.gradient(x, "q**2", ["q0"], **RUN, scheme="midpoint", paths=3).values["q0"] for x in (other, theirs)]
        assert np.array_equal(*wide)


@pytest.mark.usefixtures("quick_compiler")
def test_friction_that_vanishes():
    """Where the rate of friction vanishes, the model has the paths of one without it."""
    gone = rubbed().with_parameters(g=-0.7)
    assert not gone.damping and np.array_equal(last(gone), last(rubbed(g=-0.7)))
    assert np.array_equal(last(gone.with_parameters(g=0.5)), last(rubbed()))


SLOPE = {"force_derivative": lambda q, p, t: (0 * q[np.newaxis], -15 * p[np.newaxis] ** 2)}


@pytest.mark.usefixtures("quick_compiler")
@pytest.mark.filterwarnings("ignore::symsde.errors.UnusedParameterWarning")
@pytest.mark.parametrize("rate", [0.0, 0.3, "g*k"])
@pytest.mark.parametrize("make", [drag_of, rubbed, bathed])
def test_functions_take_the_place_of_formulas(make, rate):
    """`forced` puts functions in the place of forces in formulas: in runs, for other values, and in derivatives."""
    written = make(g=0.5).damped(rate)
    params = {name: written.parameters[name] for name in ("k", "s", "g")}
    bare = ss.model_from_sympy("p**2/2 - k*cos(q)", ["s*sin(q)", "0"][: written.nnoise], params=params).damped(rate)
    run = {**RUN, "scheme": "midpoint", "paths": 3}
    for given in ({}, {"force": drag, **SLOPE}):
        mine, theirs = written.forced(**given), bare.forced(**given)
        for values in ({}, {"k": 1.7}, {"k": 1.1, "s": 0.6}):
            mine, theirs = mine.with_parameters(**values), theirs.with_parameters(**values)
            np.testing.assert_allclose(last(mine, **run), last(theirs, **run), rtol=1e-12)
        found, right = (ss.gradient(x, "q**2", ["k", "s", "q0"], **run).by_path for x in (mine, theirs))
        for name in found:
            np.testing.assert_allclose(found[name], right[name], rtol=1e-12)
    assert not np.array_equal(last(written, **run), last(written.forced(), **run))
    forced = written.forced(drag)
    assert np.array_equal(last(pickle.loads(pickle.dumps(forced))), last(forced))
