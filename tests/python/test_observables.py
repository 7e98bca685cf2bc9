# SPDX-License-Identifier: BSD-3-Clause
"""Observables from formulas and functions: values against saved paths, the same bits for any division, values that are
NaN."""

import pickle
import warnings
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np
import pytest
import symsde as ss
from conftest import moments_of
from symsde import observe
from symsde.batch import scene
from symsde.cli import command_line
from symsde.errors import FalseTraitError, InvalidArgumentError, SceneError, WrongShapeError, WrongTypeError

pytestmark = pytest.mark.optimised  # as in the processes that these tests start

RUN = {"q0": [0.3, 0.2], "p0": [0.1, 0.0], "step": 0.05, "steps": 60, "save_every": 20, "paths": 1500, "seed": 3}
FORMULAS = {
    "r^2": "q1**2 + q_2**2",
    "angle": "atan(p1/(2 + q1)) + tanh(q2)*exp(-t)",
    "alpha * q": "alpha*q_1 - sigma1",
    "three": "3",
}
OBSERVERS = {
    "hist": observe.Histogram("r^2", 0, 0.4, 10),
    "cov": observe.Covariance(("r^2", "angle")),
    "far": observe.Extremes("angle"),
    "loss": observe.Passage("r^2", high=0.3, absorb=False),
    "some": observe.Paths((0, 700), of=("alpha * q", "q_1")),
}


def model():
    return ss.models.henon_heiles(alpha=1.2, sigma1=0.07)


@pytest.fixture(scope="module")
def found():
    return ss.moments(model(), observables=FORMULAS, observers=OBSERVERS, **RUN)


@pytest.fixture(scope="module")
def run():
    saved = ss.simulate(model(), **RUN)
    assert saved.report.failed == 0
    return saved


def values(run):
    """Values of the formulas by hand, (time, path) each."""
    q, p, t = run.q.swapaxes(0, 1), run.p.swapaxes(0, 1), run.t[:, None]
    return {
        "r^2": q[0] ** 2 + q[1] ** 2,
        "angle": np.arctan(p[0] / (2 + q[0])) + np.tanh(q[1]) * np.exp(-t),
        "alpha * q": 1.2 * q[0] - 0.07,
        "three": np.full(q[0].shape, 3.0),
    }


def test_formulas_are_what_they_say(found, run):
    for name, x in values(run).items():
        np.testing.assert_allclose(found.mean[name], x.mean(axis=1), rtol=1e-12, atol=1e-15, err_msg=name)
        np.testing.assert_allclose(found.var[name], x.var(axis=1, ddof=1), rtol=1e-9, atol=1e-25, err_msg=name)
    assert found.columns()[-4:] == list(FORMULAS)


def test_observers_see_formulas(found, run):
    x = values(run)
    hist, some = found.observed["hist"], found.observed["some"]
    for i, radius in enumerate(x["r^2"]):
        np.testing.assert_array_equal(hist.counts[i], np.histogram(radius[radius < 0.4], hist.edges)[0])
    np.testing.assert_allclose(some.values[1, :, 0], x["alpha * q"][:, 700], rtol=1e-14)
    far = np.maximum.accumulate(x["angle"], axis=0).mean(axis=1)
    np.testing.assert_allclose(found.observed["far"].mean_highest, far, rtol=1e-12)
    covariance = [np.cov(a, b) for a, b in zip(x["r^2"], x["angle"], strict=True)]
    np.testing.assert_allclose(found.observed["cov"].covariance[1:], covariance[1:], rtol=1e-9)


def test_passages_of_formulas(found):
    """Passages are checked after every step, not only at saved times; without bridges, since the noise of a formula
    is unknown.
    """
    every = ss.simulate(model(), **{**RUN, "save_every": 1})
    outside = every.q[:, 0] ** 2 + every.q[:, 1] ** 2 >= 0.3  # (step, path)
    lost = np.logical_or.accumulate(outside, axis=0)[::20].mean(axis=1)
    loss = found.observed["loss"]
    assert 0.05 < lost[-1] < 0.95
    np.testing.assert_allclose(loss.lost, lost, rtol=1e-14)
    assert loss.bridged is None
    first = np.argmax(outside, axis=0)[loss.path]
    np.testing.assert_array_equal(loss.step, first)
    assert (loss.step % 20 != 0).sum() > 50  # steps other than saved ones


def test_bridges_that_are_missing_are_told(found, tmp_path, capsys):
    """Results, files and the screen say if noise may act on a value without Brownian bridges."""
    sentence = "r^2 is checked only at the ends of steps, since only q and p have Brownian bridges"
    assert found.remarks() == [f"loss: {found.observed['loss'].remarks()[0]}"]
    assert sentence in found.remarks()[0] and sentence in found.attributes()["remarks"]
    start = {"q0": 0.0, "p0": 0.4, "step": 0.1, "steps": 20, "paths": 300}
    kubo = ss.models.kubo(sigma=1.0)  # noise on q and p
    for name, wanted, told, bridges in (
        ("q_1", {}, 0, True),
        ("energy", {}, 1, False),
        ("energy", {"bridge": False}, 0, False),
        ("r", {}, 1, False),
    ):
        watched = {"loss": observe.Passage(name, high=0.3, absorb=False, **wanted)}
        mine = ss.moments(kubo, observables={"r": "q*p"}, observers=watched, **start)
        assert len(mine.remarks()) == told, name
        loss = mine.observed["loss"]
        mine.save(tmp_path / "moments.npz")
        with np.load(tmp_path / "moments.npz") as data:
            assert ("loss_bridged" in data) == bridges
            assert not bridges or data["loss_bridged"] == loss.bridged > 0
    without = ss.model_from_sympy("p**2/2 + q**2/2")
    assert ss.moments(without, observables={"r": "q*p"}, observers=watched, **start).remarks() == []
    file = write(tmp_path / "scene.toml")
    assert command_line.main(["run", file, "--out", str(tmp_path / "out")]) == 0
    assert f"symsde: loss: {sentence}" in capsys.readouterr().err
    if pytest.importorskip("netCDF4"):
        assert sentence in pytest.importorskip("xarray").open_dataset(tmp_path / "out" / "moments.nc").attrs["remarks"]


def same(one, other):
    for name in ("n_ok", "m2"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)
    np.testing.assert_array_equal(one.to_arrays()[0], other.to_arrays()[0])
    for name, part in one.kept.items():
        np.testing.assert_array_equal(part.counts, other.kept[name].counts, err_msg=name)
        np.testing.assert_array_equal(part.sums, other.kept[name].sums, err_msg=name)


@pytest.mark.parametrize("options", [{"threads": 3}, {"lanes": 8}, {"lanes": 64, "threads": 2}, {"general": False}])
def test_the_same_bits_for_any_threads_and_blocks(options, found):
    same(ss.moments(model(), observables=FORMULAS, observers=OBSERVERS, **RUN, **options), found)


@pytest.mark.parametrize("kind", ["here", "processes"])
def test_the_same_bits_for_any_shards(kind, found):
    wanted = {"observables": FORMULAS, "observers": OBSERVERS, "shard_paths": 256}
    if kind == "here":
        same(ss.ensemble(model(), **wanted, **RUN), found)
        return
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as executor:
        same(ss.ensemble(model(), **wanted, executor=executor, **RUN), found)


def total(q, p):
    return q[0] + q[1]


def test_formulas_beside_functions(found):
    """Values come in the given order; formulas know the time of each saved point, functions do not."""
    mixed = {"r^2": FORMULAS["r^2"], "total": total, **{name: FORMULAS[name] for name in list(FORMULAS)[1:]}}
    both = ss.moments(model(), observables=mixed, **RUN)
    for name in FORMULAS:
        np.testing.assert_array_equal(both.mean[name], found.mean[name], err_msg=name)
    np.testing.assert_allclose(both.mean["total"], both.mean_q.sum(axis=1), rtol=1e-12)
    told = both.attributes()["observables"]
    assert '"r^2": "q1**2 + q_2**2"' in told and '"total": "Python: ' in told and "total" in told
    assert pickle.loads(pickle.dumps(both)).mean["total"][-1] == both.mean["total"][-1]


def test_the_time_within_a_sum_is_that_of_the_state():
    run = ss.simulate(model(), **(few := {**RUN, "paths": 1}))  # functions get several states of the only path at once
    found = ss.moments(model(), observables={"sum": "Sum(cos(t)*q[i], i)", "total": total}, **few)
    np.testing.assert_allclose(found.mean["sum"], np.cos(run.t) * run.q[..., 0].sum(axis=1), rtol=1e-12)


def test_functions_are_watched_too(found):
    def square(q, p):
        return q[0] ** 2 + q[1] ** 2

    loss = {"loss": observe.Passage("square", high=0.3, absorb=False)}
    mine = ss.moments(model(), observables={"square": square}, observers=loss, **RUN)
    np.testing.assert_array_equal(mine.observed["loss"].lost, found.observed["loss"].lost)


def test_without_a_compiler(found, monkeypatch):
    monkeypatch.setenv("SYMSDE_CC", "")
    monkeypatch.setattr("symsde.model.formulas.compiler.command", lambda: None)
    from symsde.model.formulas import formula_observables

    formula_observables._read.cache_clear()
    try:
        slow = ss.moments(model(), observables=FORMULAS, **RUN)
    finally:
        formula_observables._read.cache_clear()
    for name in FORMULAS:
        np.testing.assert_allclose(slow.mean[name], found.mean[name], rtol=1e-13, atol=1e-15, err_msg=name)


def test_names_are_those_of_the_model():
    """Coordinates and parameters have the names of the model's formulas; q_1, p_1 work beside them."""
    mine = ss.model_from_sympy("px**2/2 + k*x**2/2", ["s*x"], q="x", p="px", params={"k": 2.0, "s": 0.1})
    run = {"q0": 1.0, "p0": 0.5, "step": 0.1, "steps": 10, "paths": 20}
    wanted = {"a": "k*x*px", "b": "2*q_1*p_1", "c": "2*q1*p"}
    found = ss.moments(mine, observables=wanted, **run)
    saved = ss.simulate(mine, **run)
    np.testing.assert_allclose(found.mean["a"], (2 * saved.q[:, 0] * saved.p[:, 0]).mean(axis=1), rtol=1e-12)
    for name in "bc":
        np.testing.assert_allclose(found.mean[name], found.mean["a"], rtol=1e-14)
    other = mine.with_parameters(k=4.0)
    again = ss.moments(other, observables={"k": "k"}, **run)
    assert (again.mean["k"] == 4.0).all()


def test_expressions_of_sympy():
    sympy = pytest.importorskip("sympy")
    x, y = sympy.symbols("x y")
    mine = ss.model_from_sympy(y**2 / 2 + x**4, [x], q=x, p=y)
    run = {"q0": 1.0, "p0": 0.5, "step": 0.1, "steps": 10, "paths": 20}
    found = ss.moments(mine, observables={"e": y**2 / 2 + x**4, "xy": x * y}, **run)
    np.testing.assert_allclose(found.mean["e"], found.mean_energy, rtol=1e-12)


BAD = {
    "__import__('os')": "calls __import__",
    "q3": "'q3'|q3",
    "q1 +": "written as a formula",
    "": "written as a formula",
    "q[1]": "index in brackets",
    "1/0": "not a finite real number",
    "sqrt(-1)": "real",
    "I*q1": "holds I, which is not given: there are q_1",
    "q1 > 0": "comparison",
    "foo(q1)": "foo",
    "9**9**9**9": "power or quotient of constants",
    "-" * 60 + "q1": "deep|nested",
    "energy": "energy.*there are.*q_1.*p2$",
    "sigma9": "sigma",
}


@pytest.mark.parametrize(("formula", "sentence"), BAD.items())
def test_bad_formulas_are_refused(formula, sentence):
    with pytest.raises(InvalidArgumentError, match=f"(?s)observable 'x'.*({sentence})"):
        ss.moments(model(), observables={"x": formula}, **RUN)


@pytest.mark.parametrize("given", [3, None, [1], {"a": 1}, b"q1"])
def test_what_is_no_observable(given):
    with pytest.raises(WrongTypeError, match="observable 'x' cannot be called: give f"):
        ss.moments(model(), observables={"x": given}, **RUN)


def test_what_is_no_number_is_said():
    """log(q1) of paths below zero: means are NaN, and the warning names the observable and the times."""
    start = np.full((1, 20), 1.0)
    start[0, 3] = -1.0
    run = {"q0": start, "p0": 0.0, "step": 0.1, "steps": 4, "save_every": 2, "paths": 20}
    wanted = {"fine": "q1**2", "log": "log(q1)", "late": "1/(t - 0.2)"}
    watched = {
        "hist": observe.Histogram("log", -1, 1, 4),
        "far": observe.Extremes("log"),
        "loss": observe.Passage("log", high=5.0, absorb=False),
    }
    pendulum = ss.models.pendulum()
    with pytest.warns(ss.NotANumberWarning) as warned:
        found = ss.moments(pendulum, observables=wanted, observers={"hist": watched["hist"]}, **run)
    told = [str(w.message) for w in warned]
    assert len(told) == 2 and told == found.doubts()
    assert told[0].startswith("log is not a finite number for some paths at 3 of 3 saved times, first at t = 0:")
    assert "late is not a finite number for some paths at 1 of 3 saved times, first at t = 0.2" in told[1]
    assert np.isnan(found.mean["log"]).all() and np.isfinite(found.mean["fine"]).all()
    np.testing.assert_array_equal(found.observed["hist"].not_a_number, 1)
    with pytest.warns(ss.NotANumberWarning, match="log is not .* at 3 of 3 saved times"):  # also of the only path
        ss.moments(pendulum, observables={"log": "log(q1)"}, **{**run, "q0": -1.0, "paths": 1})
    with pytest.warns(ss.NotANumberWarning, match="log|late"):
        far = ss.moments(pendulum, observables=wanted, observers={"far": watched["far"]}, **run).observed["far"]
    assert np.isnan(far.mean_highest).all() and np.isnan(far.mean_lowest).all()
    with pytest.warns(ss.PathsFailedWarning, match="1 path failed"):
        lost = ss.moments(pendulum, observables={"log": "log(q1)"}, observers={"loss": watched["loss"]}, **run)
    assert lost.failed.tolist() == [3] and lost.failed_step.tolist() == [0]
    assert ss.status_text(int(lost.failed_status[0])) == ss.status_text(3)
    assert (lost.n_ok == 19).all() and np.isfinite(lost.mean["log"]).all()


def test_no_number_spreads_to_errors_and_quantiles():
    """A NaN value gives a NaN error, and no quantile leaves it out."""
    start = np.full((1, 20), 1.0)
    start[0, 3] = -1.0
    wanted = {
        "c": observe.Covariance(("log", "q_1")),
        "a": observe.Autocorrelation("log", 2),
        "x": observe.Quantiles("log", (0.5,)),
        "y": observe.Quantiles("q_1", (0.5,)),
    }
    with pytest.warns(ss.NotANumberWarning):
        found = ss.moments(
            ss.models.pendulum(), q0=start, p0=0.0, step=0.1, steps=4, save_every=2, paths=20,
            observables={"log": "log(q1)"}, observers=wanted,
        ).observed  # fmt: skip
    assert np.isnan(found["c"].se_covariance[:, 0]).all() and np.isfinite(found["c"].se_covariance[:, 1, 1]).all()
    assert np.isnan(found["a"].covariance).all() and np.isnan(found["a"].se_covariance).all()
    assert np.isnan(found["x"].quantile).all() and np.isnan(found["x"].se_quantile).all()
    assert np.isfinite(found["y"].quantile).all()


@pytest.mark.parametrize(
    ("function", "words"),
    [
        (lambda q, p: np.sum(q**2 + p**2), "is one number for all paths: return one for each"),
        (lambda q, p: 3.0, "is one number for all paths"),
        (lambda q, p: np.ma.masked_array(q[0], q[0] < 2), "masked values"),
    ],
)
def test_a_function_gives_a_number_for_each_path(function, words):
    """A sum over all paths of a block would depend on the block's size."""
    with pytest.raises((WrongShapeError, WrongTypeError), match=words):
        ss.moments(ss.models.kubo(), q0=1.0, p0=0.0, step=0.1, steps=4, paths=100, observables={"x": function})


@pytest.mark.parametrize("line", ['kind = ["histogram"]', 'kind = "extremes"\nname = ["x"]\nof = "q_1"'])
def test_tables_of_observers_with_lists_for_names(line, tmp_path):
    file = tmp_path / "scene.toml"
    file.write_text(f'[model]\nname = "kubo"\n[run]\nstep = 0.1\nsteps = 4\nq0 = 1.0\np0 = 0.0\n[[observe]]\n{line}\n')
    assert command_line.main(["check", str(file)]) == command_line.BAD_INPUT


SCENE = """
[model]
name = "henon_heiles"
alpha = 1.2
sigma1 = 0.07
[run]
step = 0.05
steps = 60
save_every = 20
paths = 1500
seed = 3
q0 = [0.3, 0.2]
p0 = [0.1, 0.0]
[observables]
"r^2" = "q1**2 + q_2**2"
angle = "atan(p1/(2 + q1)) + tanh(q2)*exp(-t)"
[[observe]]
kind = "passage"
name = "loss"
of = "r^2"
high = 0.3
absorb = false
"""


def write(path, text=SCENE, old="", new=""):
    assert old in text
    path.write_text(text.replace(old, new) if old else text)
    return str(path)


def test_scenes_with_formulas(found, tmp_path, capsys):
    file = write(tmp_path / "scene.toml")
    for size in (256, 2048):
        out = tmp_path / f"out{size}"
        assert command_line.main(["run", file, "--out", str(out), "--shard-paths", str(size), "--quiet"]) == 0
        mine = ss.open_run(out).moments
        for name in ("r^2", "angle"):
            np.testing.assert_array_equal(mine.mean[name], found.mean[name])
            np.testing.assert_array_equal(mine.se_mean[name], found.se_mean[name])
        np.testing.assert_array_equal(mine.observed["loss"].lost, found.observed["loss"].lost)
    np.testing.assert_array_equal(moments_of(scene.load(file)).m2, mine.m2)
    other = write(tmp_path / "other.toml", old="q_2**2", new="q_2**4")
    assert command_line.main(["run", other, "--out", str(out), "--quiet"]) == command_line.BAD_INPUT
    assert "observables.r^2 = 'q1**2 + q_2**2' there, 'q1**2 + q_2**4' here" in capsys.readouterr().err


def test_scenes_say_what_is_no_number(tmp_path, capsys):
    file = write(tmp_path / "scene.toml", old="q1**2 + q_2**2", new="log(q1 - 0.3)")
    text = (tmp_path / "scene.toml").read_text().partition("[[observe]]")[0]
    file = write(tmp_path / "scene.toml", text)
    assert command_line.main(["run", file, "--out", str(tmp_path / "out"), "--quiet"]) == command_line.PATHS_FAILED
    assert "symsde: r^2 is not a finite number for some paths at 4 of 4 saved times" in capsys.readouterr().err


HOSTILE = {
    '"r^2" = 3': r"\[observables\] r\^2 = 3: give a formula as text",
    '"r^2" = ["q1"]': "give a formula as text",
    '"r^2" = {python = "os:system"}': "python = 'os:system' would execute code: say --allow-python",
    '"r^2" = {python = "os:system", a = 1}': "give a formula as text",
    '"r^2" = ""': r"\[observables\]: observable 'r\^2'",
    "\"r^2\" = \"__import__('os').system('false')\"": r"observable 'r\^2'",
    'q_1 = "q2"\n"r^2" = "1"': "q_1.*taken",
    '"" = "q2"\n"r^2" = "1"': "cannot be a name in a file",
    '"a/b" = "q2"\n"r^2" = "1"': "cannot be a name in a file",
    '"r^2" = "q7"': "q7",
    '"R^2" = "q1"': "no such value: there are",
}


@pytest.mark.parametrize(("line", "sentence"), HOSTILE.items())
def test_hostile_scenes(line, sentence, tmp_path):
    file = write(tmp_path / "scene.toml", old='"r^2" = "q1**2 + q_2**2"', new=line)
    with pytest.raises(SceneError, match=f"scene.toml: .*{sentence}"):
        scene.load(file)


CLASHES = {
    (
        "x",
        "passage",
        "x_lost",
        "histogram",
    ): "observer 'x_lost' would call a variable of files x_lost_below, as the obs",
    ("failed", "passage", "other", "extremes"): "files failed_step, as what every file holds does",
    ("mean_log", "histogram", "other", "extremes"): "files mean_log_count, as the observable 'log_count' does",
}


@pytest.mark.parametrize(("names", "sentence"), CLASHES.items())
def test_names_that_files_would_hold_twice(names, sentence):
    """One of two equal names would overwrite the other in a file."""
    kinds = {
        "passage": observe.Passage("q_1", within=1.0),
        "histogram": observe.Histogram("q_1", -1, 1, 4),
        "extremes": observe.Extremes("q_1"),
    }
    wanted = dict(zip(names[::2], (kinds[kind] for kind in names[1::2]), strict=True))
    with pytest.raises(InvalidArgumentError, match=sentence):
        ss.moments(model(), observables={"log_count": "q1"}, observers=wanted, **RUN)


def test_observables_need_moments(tmp_path):
    file = write(tmp_path / "scene.toml", SCENE.partition("[[observe]]")[0] + "[output]\nmoments = false\npaths=[0]\n")
    with pytest.raises(SceneError, match=r"\[observables\] go with moments"):
        scene.load(file)


def middle(x):
    """Distance from the mean over paths."""
    return (x - x.mean()) ** 2


MIXING = {
    "mean": lambda q, p: middle(q[0]),
    "mean alone": lambda q, p: np.full_like(q[0], q[0].mean()),
    "rank": lambda q, p: np.argsort(np.argsort(p[0])) * 1.0,
    "above": lambda q, p: q[0] > np.median(q[0]),
    "neighbour": lambda q, p: np.roll(q[0], 3),
    "sum so far": lambda q, p: np.cumsum(q[1]),
    "chance": lambda q, p: np.random.default_rng().random(q.shape[1]),
    "no number": lambda q, p: np.where(q[0] == q[0].max(), np.nan, q[0]),
}
ALONE = r"mixes paths: it is .* for a path among different ones, and .* among copies of it"


@pytest.mark.parametrize("name", MIXING)
def test_what_mixes_paths_is_refused(name):
    """Functions that mix paths would depend on blocks, `lanes` and shards; every function of states is checked."""
    chosen, start = MIXING[name], {"q0": RUN["q0"], "p0": RUN["p0"]}
    as_numbers = {"fine": "q1**2", "mine": lambda q, p: chosen(q, p) * 1.0}
    with pytest.raises(FalseTraitError, match="^observable 'mine' " + ALONE):
        ss.moments(model(), observables=as_numbers, observers={"far": observe.Extremes("mine")}, **RUN)
    with pytest.raises(FalseTraitError, match="^observable 'f' " + ALONE):
        ss.expect(model(), chosen, horizon=1.0, abs=0.1, **start)
    with pytest.raises(FalseTraitError, match=ALONE):
        ss.mlmc(model(), chosen, horizon=1.0, abs=0.1, **start)


def test_invariants_that_mix_paths_are_refused():
    mixing, start = {"mine": MIXING["mean"]}, {"q0": RUN["q0"], "p0": RUN["p0"]}
    with pytest.raises(FalseTraitError, match="^observable 'mine' " + ALONE):
        ss.work_precision(model=model(), schemes=["midpoint"], steps=[4, 8], paths=40, invariants=mixing, **start)


def test_what_takes_each_path_by_itself_is_not():
    """Sums over degrees of freedom, jumps, values that are zero or NaN at the start, and rounding alone are all
    accepted.
    """
    mine, at = model(), (np.array(RUN["q0"])[:, None], np.array(RUN["p0"])[:, None])
    first = mine.value(*at)[0]
    fine = {
        "sum": lambda q, p: np.sum(q**2 + p**2, axis=0),
        "drift": lambda q, p: mine.value(q, p) - first,
        "jump": lambda q, p: (q[0] > RUN["q0"][0]) * 1.0,
        "rounding": lambda q, p: np.sin(q[0]) ** 2 + np.cos(q[0]) ** 2 - 1,
        "no number": lambda q, p: np.log(q[0] - RUN["q0"][0]),
    }
    with np.errstate(all="ignore"), pytest.warns(ss.NotANumberWarning):
        ss.moments(mine, observables=fine, **RUN)


@pytest.mark.parametrize("entry", ["moments", "ensemble"])
@pytest.mark.parametrize("lost", ["none", "one", "all but one", "all"])
@pytest.mark.parametrize("late", [False, True])
@pytest.mark.parametrize("paths", [1, 20])
def test_doubts_are_of_paths_that_count(paths, late, lost, entry, tmp_path):
    """If no path is left, means are NaN; but no warning names a value as the cause, since the paths failed."""
    gone = {"none": [], "one": [0], "all but one": range(paths - 1), "all": range(paths)}[lost]
    start = np.full((1, paths), 1.0)
    start[0, list(gone)] = -1.0
    observables = {"x": "log(q1) + 0*t" if not late else "log(q1 + 2*(1 + tanh(100*(0.15 - t))))"}
    watched = {"loss": observe.Passage("x", high=50.0, absorb=False)}
    run = {"q0": start, "p0": 0.0, "step": 0.1, "steps": 4, "paths": paths, "observables": observables}
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        found = getattr(ss, entry)(ss.models.pendulum(), observers=watched, **run)
    assert [x.category for x in said] == [ss.PathsFailedWarning] * bool(len(gone))
    assert found.doubts() == [] and found.failed.tolist() == list(gone)
    left = found.n_ok > 0
    assert left.all() == (len(gone) < paths) and left.any() == (late or left.all())
    assert (np.isfinite(found.mean_q[:, 0]) == left).all() and (np.isfinite(found.mean["x"]) == left).all()
