# SPDX-License-Identifier: BSD-3-Clause
"""Tests of parameters of formulas as data: other values need no other code, and values that differ from path to path.

Path i of a run has the bits of a run of path i alone whose parameters are arrays with one value, and agrees to 1e-13
with a run whose parameters are numbers.
"""

import copy
import functools
import pickle
import warnings

import numpy as np
import pytest
import symsde as ss
from symsde.batch import scene
from symsde.cli import command_line
from symsde.errors import IncompatibleError, InvalidArgumentError, WrongShapeError, WrongTypeError
from symsde.model.formulas import formula_code

pytestmark = pytest.mark.usefixtures("quick_compiler")

PATHS = 300
X = 1 + 0.4 * np.sin(1.3 * np.arange(PATHS))  # neighbours differ by much
SYNCHROTRON = {"H": "p**2/2 - omega**2*cos(q)", "noise": ["s1*sin(q)", "-s2*cos(q)"]}
MODELS = {
    "synchrotron": (SYNCHROTRON, {"omega": 2.1 * X, "s1": 0.2 * X[::-1], "s2": 0.1}),
    "kubo": ({"H": "a*(p**2 + q**2)/2", "noise": ["s*(p**2 + q**2)/2"]}, {"a": X, "s": 0.3 * X}),
    "pendulum": ({"H": "p**2/2 - cos(q)", "noise": ["s*(p**2 + q**2)/2"]}, {"s": 0.4 * X}),
    "morse": (
        {"H": "p**2/(2*m) + d*(1 - exp(-b*q))**2", "noise": ["s*q**2"]},
        {"m": X, "d": 2.0 * X, "b": 0.6 * X[::-1], "s": 0.1 * X},
    ),
    "driven": (
        {"H": "p**2/2 - k*(1 + e*cos(nu*t))*cos(q)", "noise": ["s*(1 + e*t)*q"]},
        {"k": X, "e": 0.3, "nu": X, "s": 0.2},
    ),
    "mixed": ({"H": "p**2/2*(1 + k*q**2) + exp(-k)*q**2/2", "noise": ["s*p*q"]}, {"k": 0.3 * X, "s": 0.1 * X}),
    "henon": (
        {"H": "(p1**2 + p2**2 + q1**2 + q2**2)/2 + a*(q1**2*q2 - q2**3/3)", "noise": ["s*q1", "s*q2"]},
        {"a": X, "s": 0.1 * X},
    ),
    "three": (
        {
            "H": "(p1**2 + p2**2 + p3**2)/2 + k*(1 - cos(q1 - q2)) + k*(q2 - q3)**2/2 + q3**4/4",
            "noise": ["s*q1", "s*q2*q3"],
        },
        {"k": X, "s": 0.1 * X},
    ),
}
SCHEMES = (
    *("midpoint", "symplectic_euler", "symplectic_euler_adjoint", "stormer_verlet", "gauss2", "lobatto3", "heun"),
    *("chin4a", "gauss_dkdkd", "verlet_kdk", "gauss2_strong32", "euler_maruyama", "verlet_dz"),
)
RUN = {"q0": 0.4, "p0": 0.3, "step": 0.05, "steps": 24, "save_every": 8, "seed": 3, "first_path": 256}


def alone(kind, i, *, as_array, **options):
    """The run of path i alone."""
    values = MODELS[kind][1]
    one = {key: (x[i : i + 1] if as_array else x[i]) if np.ndim(x) else x for key, x in values.items()}
    return ss.simulate(made(kind).with_parameters(**one), **{**RUN, **options, "paths": 1, "first_path": 256 + i})


@functools.cache
def made(kind):
    """The model whose parameters are numbers."""
    given, values = MODELS[kind]
    return ss.model_from_sympy(**given, params={key: np.ravel(x)[0] for key, x in values.items()})


def of_all(kind, **options):
    """The run of all paths, each with its own values of the parameters."""
    return ss.simulate(made(kind).with_parameters(**MODELS[kind][1]), **{**RUN, "paths": PATHS, **options})


def require_paths(kind, run, **options):
    """Require that the paths of a run equal the paths of runs of one path."""
    for i in (0, 1, 7, 8, 130, 255, 256, 299):
        mine = np.array([run.q[:, :, i], run.p[:, :, i]])
        array, number = (alone(kind, i, as_array=x, **options) for x in (True, False))
        assert np.array_equal(mine, [array.q[:, :, 0], array.p[:, :, 0]], equal_nan=True), (kind, i, options)
        np.testing.assert_allclose(mine, [number.q[:, :, 0], number.p[:, :, 0]], rtol=1e-13, atol=1e-13)


@pytest.mark.parametrize("kind", MODELS)
def test_bits_of_paths_alone(kind):
    """Paths have the bits of paths run alone, for every kind of stepper that takes the model: whole steps, stages,
    kicks, brackets; in blocks and as single paths.
    """
    ran = 0
    for scheme in SCHEMES:
        try:
            run = of_all(kind, scheme=scheme)
        except ss.errors.SymsdeError as refusal:
            if kind == "kubo" and scheme in ("gauss_dkdkd", "verlet_kdk"):  # quadratic parts have numbers alone
                continue
            with pytest.raises(type(refusal)):  # numbers are refused likewise
                alone(kind, 0, as_array=False, scheme=scheme)
            continue
        assert not run.status.any()
        require_paths(kind, run, scheme=scheme)
        ran += 1
    assert ran >= 5


def test_neighbours_differ():
    """The twin: a shift of values by one path, or an error of 1 % in one value, would be found."""
    run = of_all("synchrotron")
    given, values = MODELS["synchrotron"]
    for wrong in (values["omega"][8], values["omega"][7] * 1.01):
        model = ss.model_from_sympy(**given, params={"omega": wrong, "s1": values["s1"][7], "s2": 0.1})
        other = ss.simulate(model, **{**RUN, "paths": 1, "first_path": 256 + 7})
        assert abs(other.q[-1, 0, 0] - run.q[-1, 0, 7]) > 1e-3


@pytest.mark.optimised
@pytest.mark.parametrize("kind", ["synchrotron", "morse", "henon"])
def test_threads_and_lanes(kind):
    """Neither threads nor the size of blocks change a bit."""
    for scheme in ("midpoint", "stormer_verlet", "lobatto3"):
        found = [of_all(kind, scheme=scheme, threads=n, lanes=m) for n, m in ((1, None), (2, None), (1, 8), (2, 64))]
        assert all(np.array_equal(x.q, found[0].q) and np.array_equal(x.p, found[0].p) for x in found)


@pytest.mark.parametrize("scheme", ["midpoint", "stormer_verlet", "gauss2", "lobatto3", "heun"])
def test_narrower_blocks(scheme):
    """When most paths have failed, the remaining paths keep their own values in narrower blocks."""
    given = {"H": "p**2/2 + k*q**2/2 - c*q**4", "noise": ["s*q"]}
    c = np.where(np.arange(PATHS) % 5 == 0, 0.01, 2.0 * X)  # four of five escape
    model = ss.model_from_sympy(**given, params={"k": X, "c": c, "s": 0.1 * X})
    options = {**RUN, "q0": 1.5, "steps": 80, "scheme": scheme}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        run = ss.simulate(model, **options | {"paths": PATHS})
        assert 100 < np.count_nonzero(run.status) < 260
        for i in (0, 1, 5, 130, 255, 295):
            one = model._part(slice(i, i + 1))
            single = ss.simulate(one, **options | {"paths": 1, "first_path": 256 + i})
            assert single.status[0] == run.status[i]
            assert np.array_equal(single.q[:, :, 0], run.q[:, :, i], equal_nan=True)


def test_moments_shards_and_extension():
    """Moments, shards of an ensemble, a prepared run and a run that is extended use the values of their paths."""
    given, values = MODELS["synchrotron"]
    values = {"omega": np.tile(values["omega"], 4)[:1000], "s1": 0.2, "s2": np.linspace(0.05, 0.3, 1000)}
    model = ss.model_from_sympy(**given, params=values)
    options = {**RUN, "paths": 1000}
    run, moments = ss.simulate(model, **options), ss.moments(model, **options)
    np.testing.assert_allclose(moments.mean_q, run.q.mean(axis=2), rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(moments.mean_energy, run.energy.mean(axis=1), rtol=1e-12)
    energy = run.p[-1, 0] ** 2 / 2 - values["omega"] ** 2 * np.cos(run.q[-1, 0])
    np.testing.assert_allclose(run.energy[-1], energy, rtol=1e-13)
    shards = ss.ensemble(model, **options, shard_paths=256)
    assert np.array_equal(shards.mean_q, moments.mean_q)
    half = ss.simulate(model, **options | {"steps": 8}).extend(16)
    assert np.array_equal(half.q[-1], run.q[-1])
    prepared = ss.prepare(model, **{key: x for key, x in options.items() if key not in ("steps", "save_every")})
    for _ in range(24):
        prepared.step()
    assert np.array_equal(prepared.q, run.q[-1])
    prepared.reset(first_path=512)
    prepared.step()
    later = ss.simulate(model, **options | {"first_path": 512, "steps": 1, "save_every": 1})
    assert np.array_equal(prepared.q, later.q[-1])


def test_other_values_share_the_code(monkeypatch):
    """with_parameters derives no formula again; its model has the bits of a model that is made with these values."""
    given, _ = MODELS["synchrotron"]
    model = ss.model_from_sympy(**given, params={"omega": 2.1, "s1": 0.2, "s2": 0.1})
    fresh = ss.model_from_sympy(**given, params={"omega": 1.7, "s1": 0.2, "s2": 0.3})
    arrays = model.with_parameters(omega=[2.0, 1.9])
    monkeypatch.setattr(formula_code, "Derivatives", None)
    other = model.with_parameters(omega=1.7, s2=0.3)
    assert other.traits == fresh.traits and other.formula.structure == fresh.formula.structure
    assert other.parameters == fresh.parameters == {"omega": 1.7, "s1": 0.2, "s2": 0.3}
    assert model.parameters["omega"] == 2.1 and model.traits.rotation == (2.1,)
    for scheme in ("midpoint", "verlet_kdk", "lobatto3"):
        a, b = (ss.simulate(x, **RUN, scheme=scheme, paths=9) for x in (other, fresh))
        assert np.array_equal(a.q, b.q)
    assert arrays.with_parameters(s1=0.5).paths == 2
    back = arrays.with_parameters(omega=1.7, s2=0.3)
    assert np.array_equal(ss.simulate(back, **RUN, paths=9).q, ss.simulate(fresh, **RUN, paths=9).q)
    monkeypatch.undo()
    silent = model.with_parameters(s1=0.0)  # formulas fold 0, 1 and -1
    assert silent.traits.silent == (1,)
    assert model.with_parameters(omega=1.7).damped(0.1).with_parameters(omega=2.2).damping == (0.1,)


def test_copies_and_texts():
    """Pickles and copies keep values; the caller's array is not kept; descriptions are short."""
    given, _ = MODELS["kubo"]
    values = np.linspace(0.5, 2, 40)
    model = ss.model_from_sympy(**given, params={"a": values, "s": 0.3})
    values[:] = 7
    assert model.paths == 40 and model.parameters["a"][0] == 0.5
    with pytest.raises(ValueError):
        model.parameters["a"][0] = 1
    run = ss.simulate(model, **RUN, paths=40)
    again = ss.simulate(pickle.loads(pickle.dumps(model)), **RUN, paths=40)
    assert np.array_equal(again.q, run.q) and copy.copy(model) is model
    assert "a=[0.5, .. 2; 40 paths]" in repr(model) and "40 paths" in model._repr_html_()
    assert np.array_equal(pickle.loads(pickle.dumps(run)).q, run.q)


def test_refusals():
    """Arguments that cannot be run are refused with a sentence that says what is allowed."""
    given, _ = MODELS["synchrotron"]
    plain = {"omega": 2.1, "s1": 0.2, "s2": 0.1}
    model = ss.model_from_sympy(**given, params=plain)
    two = model.with_parameters(omega=[1.0, 2.0])
    with pytest.raises(WrongShapeError, match=r"omega of model formula has 2 values.*run has 3 paths"):
        ss.simulate(two, **RUN, paths=3)
    with pytest.raises(WrongShapeError, match="omega for 2, s1 for 3"):
        two.with_parameters(s1=[1.0, 2.0, 3.0])
    with pytest.raises(WrongShapeError, match=r"shape \(1, 2\)"):
        model.with_parameters(omega=[[1.0, 2.0]])
    with pytest.raises(WrongShapeError, match=r"shape \(0,\)"):
        model.with_parameters(omega=[])
    for bad in (np.nan, np.inf):
        with pytest.raises(InvalidArgumentError, match=r"omega is .* at path 1: give finite numbers"):
            model.with_parameters(omega=[1.0, bad])
    with pytest.raises(WrongTypeError, match="omega"):
        model.with_parameters(omega=["1", "2"])
    with pytest.raises(ss.errors.UnknownNameError, match=r"omga.*omega"):
        model.with_parameters(omga=[1.0, 2.0])
    with pytest.raises(WrongShapeError, match="parameters for 2 paths, and there are 3 points"):
        two.value([[1.0, 2.0, 3.0]], 0.0)
    assert two.value(0.3, 0.0) == model.with_parameters(omega=1.0).value(0.3, 0.0)
    with pytest.raises(WrongShapeError, match=r"k has 2 values for 4 sites.*for each site.*a run for each value"):
        ss.model_from_sympy("Sum(p[i]**2/2 + k*q[i]**4, i)", n=4, params={"k": [1.0, 2.0]})
    with pytest.raises(IncompatibleError, match="observable 'o' holds omega, whose values differ"):
        ss.moments(two, **RUN, paths=2, observables={"o": "omega*q"})
    with pytest.warns(ss.errors.UnusedParameterWarning, match="no formula holds the parameter g"):
        ss.model_from_sympy(**given, params={**plain, "g": np.ones(3)})


SCENE = """\
[model]
{model}
[run]
step = 0.05
steps = 20
save_every = 20
paths = {paths}
seed = 1
q0 = 1.0
p0 = 0.0
[output]
moments = true
paths = [0, 3, 700]
"""
FORMULA = """\
H = "p**2/2 - omega**2*cos(q)"
noise = ["s1*sin(q)"]
[model.params]
omega = {from = 1.0, to = 2.0, count = 3}
s1 = {from = 0.1, to = 0.4, count = 4}"""


@pytest.mark.parametrize("model", [FORMULA, 'name = "kubo"\na = {from = 1.0, to = 2.0, count = 3}\nsigma = 0.2'])
def test_scenes(tmp_path, model):
    """With ranges in a scene every combination of values gets the same number of paths; shards, saved paths and
    energies use these values."""
    file, out = tmp_path / "a.toml", tmp_path / "out"
    file.write_text(SCENE.format(model=model, paths=1200))
    assert command_line.main(["run", str(file), "--out", str(out), "--quiet"]) == 0
    opened = ss.open_run(out)
    asked = {"q0": 1.0, "p0": 0.0, "step": 0.05, "steps": 20, "save_every": 20, "seed": 1, "keep_paths": True}
    first = np.linspace(1.0, 2.0, 3)
    if "kubo" in model:
        found = ss.sweep(ss.models.kubo(sigma=0.2), {"a": first}, **asked, paths=400)
    else:
        plain = ss.model_from_sympy(SYNCHROTRON["H"], noise=["s1*sin(q)"], params={"omega": 1.5, "s1": 0.2})
        found = ss.sweep(plain, {"omega": first, "s1": np.linspace(0.1, 0.4, 4)}, **asked, paths=100)
    q = found.q.reshape(2, 1, 1200)
    np.testing.assert_allclose(opened.moments.mean_q, q.mean(2), rtol=1e-12)
    assert np.array_equal(opened.run.q, q[:, :, [0, 3, 700]])
    energies = opened.run.model.value(opened.run.q[-1], opened.run.p[-1])
    np.testing.assert_allclose(opened.run.energy[-1], energies, rtol=1e-15)
    assert len(set(opened.run.energy[0])) == 2  # the first two paths have the same value and the same state
    for wrong, told in (
        ("paths = 1200", "paths = 1000"),
        ("count = 3}", "count = 3, log = true}"),
        ("count = 3}", "count = 0}"),
    ):
        bad = file.read_text().replace(wrong, told)
        file.with_name("bad.toml").write_text(bad)
        with pytest.raises(
            ss.errors.SceneError, match=r"not a multiple of|give a number, a list|count of .* out of range"
        ):
            scene.load(file.with_name("bad.toml"))


def test_lists_in_scenes(tmp_path):
    """A list in a scene has one value for each path."""
    file = tmp_path / "a.toml"
    file.write_text(SCENE.format(model='name = "kubo"\nsigma = [0.1, 0.2, 0.3]', paths=3).replace("[0, 3, 700]", "[0]"))
    assert scene.load(file).model.parameters["sigma"].tolist() == [0.1, 0.2, 0.3]
    file.write_text(file.read_text().replace("paths = 3", "paths = 4"))
    with pytest.raises(ss.errors.SceneError, match="paths = 4 is not a multiple of 3, the number of values of sigma"):
        scene.load(file)


W = np.where(np.arange(12) < 9, 0.0, 3.0)  # noise is constant on the first eight paths, and changes on the last


@pytest.mark.parametrize("values", [W, W[::-1]], ids=["last", "first"])
@pytest.mark.parametrize("scheme", ["verlet_dz", "averaged_shift_midpoint", "gauss2_strong32", "gauss2_strong32_areas"])
def test_noise_that_changes_in_time_on_some_paths(scheme, values):
    """Each path has its own bits where the noises of others change in time, and its own do not."""
    noises = [["s*q*cos(w*t)"]]
    if "strong" in scheme:
        noises = [["s*q**2*cos(w*t)"], ["s*q1*q2*cos(w*t)", "s*q1*(1 + w*t)"]]
    for noise in noises:
        h = "p**2/2 + q**2/2" if len(noise) == 1 else "(p1**2 + p2**2 + q1**2)/2 + q2**2"
        model = ss.model_from_sympy(h, noise, params={"s": 0.3, "w": 1.0})
        run = {**RUN, "scheme": scheme, "first_path": 0}
        whole = ss.simulate(model.with_parameters(w=values), **run, paths=12)
        for i, w in enumerate(values):
            mine = ss.simulate(model.with_parameters(w=values[i : i + 1]), **{**run, "first_path": i}, paths=1)
            assert np.array_equal(whole.q[:, :, i], mine.q[:, :, 0]), (i, w)
            number = ss.simulate(model.with_parameters(w=w), **{**run, "first_path": i}, paths=1)
            np.testing.assert_allclose(mine.q, number.q, rtol=1e-12, atol=1e-14)


def test_warnings_of_all_paths():
    """The largest frequency and the strongest noise of all paths are warned of, and named."""
    model = made("synchrotron")
    omega, s1 = np.ones(5000), np.full(5000, 0.1)
    omega[-1], s1[2730] = 30.0, 0.4  # 4096 of 5000 are looked at
    found = ss.simulate(model.with_parameters(omega=omega), **{**RUN, "paths": 5000}).report.warnings
    assert any("with the parameters of value 5000) exceeds 1" in x for x in found)
    s1[2730] = 40.0
    found = ss.simulate(model.with_parameters(s1=s1), **{**RUN, "steps": 8, "paths": 5000}).report.warnings
    assert any("with the parameters of value 2731) is so strong" in x for x in found)
    for s1, share in (([40.0, 0.1], "up to"), ([0.1, 40.0], "up to"), ([40.0, 40.0], "about")):
        found = ss.simulate(model.with_parameters(s1=s1), **{**RUN, "steps": 8, "paths": 2}).report.warnings
        assert any(f", {share} 7.99854 of" in x and "is so strong" in x for x in found), (s1, found)
    assert not ss.simulate(model.with_parameters(omega=omega[:-1]), **{**RUN, "paths": 4999}).report.warnings


EXACT = {
    "kubo": lambda s: ss.models.kubo(a=s),
    "built in": lambda s: ss.models.linear_oscillator(sigma=s),
    "damped": lambda s: ss.models.linear_oscillator(sigma=s).damped(0.4),
    "formula": lambda s: ss.model_from_sympy("p**2/2 + s*q**2/2", ["-0.3*q"], params={"s": s}),
}


@pytest.mark.parametrize("name", EXACT)
def test_exact_solutions_of_each_path(name):
    """Each path has the exact solution of its own parameters."""
    make, values, run = EXACT[name], np.array([0.4, 1.3, 0.7]), {**RUN, "save_every": 6}
    q, p = ss.diagnose.exact(ss.simulate(make(values), **run, paths=3))
    for i, x in enumerate(values):
        alone = {**run, "first_path": run["first_path"] + i, "paths": 1}
        array, number = (ss.diagnose.exact(ss.simulate(make(s), **alone)) for s in ([x], x))
        assert np.array_equal([y[..., 0] for y in array], [q[..., i], p[..., i]])
        beyond_k = 1e-5 if name == "built in" else 1e-13  # with further normals in two forms of one law
        np.testing.assert_allclose(array, number, rtol=0, atol=beyond_k)
    assert np.ptp(q[-1]) > 0.01


def test_results_of_one_model():
    """Tangents are those of each path, or of an array of one; what has no path is refused, where paths differ."""
    model, values = ss.model_from_sympy("p**2/2 + s*q**4/4", ["0.2*s*q**2"], params={"s": 1.0}), [0.5, 1.0, 1.5]
    arrays, numbers = model.with_parameters(s=values), [model.with_parameters(s=x) for x in values]
    at = {"q": 0.5, "p": 0.1, "step": 0.3, "dw": np.full((1, 3), 0.2)}
    defects = ss.diagnose.symplecticity(arrays, "heun", by="tangent", **at)
    wanted = [ss.diagnose.symplecticity(x, "heun", by="tangent", **at)[i] for i, x in enumerate(numbers)]
    np.testing.assert_allclose(defects, wanted, rtol=1e-12)
    assert np.ptp(wanted) > 1e-3
    asked = {"q0": 1.0, "p0": 0.0, "step": 0.1, "steps": 40}
    one, other = (ss.lyapunov(model.with_parameters(s=s), **asked).exponents for s in ([1.0], 1.0))
    np.testing.assert_allclose(one, other, rtol=1e-12)
    ends = {"q_start": 0.0, "q_end": 0.3, "step": 0.1, "steps": 5, "paths": 3}
    linear = ss.models.linear_oscillator(sigma=values)
    for call in (
        lambda: ss.diagnose.symplecticity(arrays, **at),
        lambda: ss.diagnose.stationary_path(arrays, **ends),
        lambda: ss.diagnose.exact_moments(linear, q0=0.0, p0=0.0, t=1.0),
    ):
        with pytest.raises(IncompatibleError, match="differ from path to path"):
            call()


def test_brackets_of_all_paths():
    """Noises commute where those of every path do."""
    model = ss.model_from_sympy("p**2/2 + q**2/2", ["s*p**2/2", "0.2*q**2"], params={"s": 0.0})
    for values, commutative in (([0.0, 0.0], True), ([0.0, 0.5], False), ([0.5, 0.0], False)):
        assert ss.commutator(model.with_parameters(s=values)).commutative == commutative


def test_areas_of_all_paths():
    """Areas by the path are refused where paths halve their steps differently often, and each path has its own bits
    where they do not."""
    model = ss.model_from_sympy("(p**2 + q**2)/2", ["a*p**2/2", "b*q**2/2"], params={"a": 0.5, "b": 0.5})
    run = {**RUN, "scheme": "midpoint_areas", "first_path": 0}
    with pytest.raises(IncompatibleError, match=r"6 for the first values and 2\.42102 for value 3: give"):
        ss.simulate(model.with_parameters(b=[0.5, -0.5, 1.0]), **run, paths=3)
    for b, options in (([0.5, -0.5, 0.51], {}), ([0.5, 3.0, 0.0], {"area_time": 6.0}), ([0.5, 3.0], {"areas": "law"})):
        whole = ss.simulate(model.with_parameters(b=b), **run, **options, paths=len(b))
        for i, x in enumerate(b):
            mine = ss.simulate(model.with_parameters(b=[x]), **{**run, "first_path": i}, **options, paths=1)
            assert np.array_equal(whole.q[:, :, i], mine.q[:, :, 0])
