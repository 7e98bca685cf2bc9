# SPDX-License-Identifier: BSD-3-Clause
"""The user's names of coordinates appear wherever results name a coordinate; a text counts as one name."""

import copy
import pickle

import numpy as np
import pytest
import sympy
import symsde as ss
from symsde import observe
from symsde.cli import command_line
from symsde.errors import InvalidArgumentError, UnknownNameError, WrongTypeError

H = "(px**2 + py**2)/2 + x**2/2 + k*y**2"
NAMES = ["x", "y", "px", "py"]
START = {"q0": [0.5, 0.2], "p0": [0.0, 0.3], "step": 0.05, "steps": 20, "paths": 40, "save_every": 5}
OBSERVERS = {
    "hist": observe.Histogram("x", -1, 1, 8),
    "left": observe.Passage("y", high=0.25, absorb=False),
    "some": observe.Paths((3,)),
    "cov": observe.Covariance(("x", "p_2")),
}


@pytest.fixture(scope="module")
def model():
    return ss.model_from_sympy(H, noise="s*x*y", q="x y", p="px, py", params={"s": 0.3, "k": 1.0})


@pytest.fixture(scope="module")
def run(model):
    return ss.simulate(model, **START)


@pytest.fixture(scope="module")
def moments(model):
    return ss.moments(model, observers=OBSERVERS, observables={"r": "x**2 + q_2**2"}, **START)


def labels(figure):
    return [(axes.get_xlabel(), axes.get_ylabel()) for axes in figure.axes]


def drawn(figure, panel=0):
    return [line.get_xydata().T for line in figure.axes[panel].get_lines()]


def test_names_may_stand_in_one_text(model):
    for q, p in (("x y", "px py"), (" x,y ", "px ,  py"), (["x", "y"], ("px", "py")), (sympy.symbols("x y"), "px py")):
        assert ss.model_from_sympy(H, q=q, p=p, params={"k": 1.0}).coordinates == tuple(NAMES)
    assert pickle.loads(pickle.dumps(model)).coordinates == model.with_parameters(s=0.1).coordinates == tuple(NAMES)


def test_results_have_the_names_of_the_model(run, moments):
    pandas = pytest.importorskip("pandas")
    assert run.columns() == [*NAMES, "energy"] and moments.columns() == [*NAMES, "energy", "r"]
    assert list(run.to_pandas().columns) == NAMES
    assert isinstance(moments.to_pandas(), pandas.DataFrame) and "se_mean py" in moments.to_pandas().columns
    for page, names in ((run._repr_html_(), NAMES), (moments._repr_html_(), ["mean x", "mean px", "mean energy"])):
        assert all(f"{name}</th>" in page for name in names) and "q_1" not in page
    assert "x, y, px, py, energy, r at" in repr(moments)
    left = moments.observed["left"]
    assert left.names == ("t", *NAMES) and list(left.mean) == ["t", *NAMES] and repr(left).startswith("<passage of y")
    assert moments.observed["some"].names == tuple(NAMES) and moments.observed["cov"].names == ("x", "py")
    with pytest.raises(UnknownNameError, match="histogram of 'z': there is no such value: there are x, y, px, py"):
        ss.moments(run.model, observers={"h": observe.Histogram("z", 0, 1)}, **START)
    copied = copy.deepcopy(moments)
    assert copied.columns() == moments.columns()


def test_figures_have_the_names_of_the_model(run, moments):
    pytest.importorskip("matplotlib")
    assert labels(run.plot()) == [("t", name) for name in ("x", "px", "y", "py")]
    assert labels(run.plot(what="phase")) == [("x", "px"), ("y", "py")]
    assert labels(run.plot(what="phase", of="py")) == [("y", "py")]
    assert labels(moments.plot()) == [("t", f"mean {name}") for name in ("x", "px", "y", "py", "energy", "r")]
    assert labels(moments.observed["hist"].plot())[0][0] == "x"
    (_, mean) = drawn(moments.plot(of="q_2"))[0]
    np.testing.assert_array_equal(mean, moments.mean_q[:, 1])


def test_a_trajectory_is_one_value_over_another(run):
    pytest.importorskip("matplotlib")
    for i, (x, y) in enumerate(drawn(run.plot(what="trajectory"))):
        np.testing.assert_array_equal(x, run.q[:, 0, i])
        np.testing.assert_array_equal(y, run.q[:, 1, i])
    figure = run.plot(what="trajectory", of=["energy", "px"], most=1)
    assert labels(figure) == [("energy", "px")]
    ((x, y),) = drawn(figure)
    np.testing.assert_array_equal(x, run.energy[:, 0])
    np.testing.assert_array_equal(y, run.p[:, 0, 0])
    assert run.plot(what="trajectory").axes[0].get_aspect() == 1.0 and figure.axes[0].get_aspect() == "auto"


def test_a_text_is_one_name(run, moments):
    """A text is not split into letters, and the only drawn value needs no other name."""
    pytest.importorskip("matplotlib")
    assert labels(run.plot(of="px")) == [("t", "px")] and labels(moments.plot(of="r")) == [("t", "mean r")]
    short = ss.moments(run.model, observables={"r": "x", "rr": "y"}, **START)
    assert labels(short.plot(of="rr")) == [("t", "mean rr")]
    for found in (run, moments):
        with pytest.raises(UnknownNameError, match="there is no value 'rr': there are"):
            found.plot(of="rr")
        with pytest.raises(UnknownNameError, match="there is no value 'xy': there are"):
            found.plot(of="xy")
        with pytest.raises(
            InvalidArgumentError, match="of = 'px' beside what = 'energy', which draws the energy alone"
        ):
            found.plot(what="energy", of="px")
        with pytest.raises(UnknownNameError, match="there is no value 'r_1'"):
            found.plot(what="energy", of="r_1")
        assert len(found.plot(what="energy", of="energy").axes) == 1
        for wrong in (3, [], [1, 2]):
            with pytest.raises(WrongTypeError, match="holds no names: give one name, or a list of one or more"):
                found.plot(of=wrong)
        with pytest.raises(UnknownNameError, match="no value 'pq': there are q, p"):
            found.plot(what="map", of="pq")
        assert found.plot(what="map", of="p").axes[0].get_ylabel() == "degree of freedom"
    with pytest.raises(InvalidArgumentError, match=r"of = \['x'\]: a trajectory is drawn in a plane: give two values"):
        run.plot(what="trajectory", of="x")
    with pytest.raises(InvalidArgumentError, match="of = 'energy' has no momentum"):
        run.plot(what="phase", of="energy")
    assert observe.Covariance("px").names(moments.values) == observe.Covariance({"px": 1}).names(moments.values)


def test_titles_are_whole(model):
    """However long the titles: no line is wider than its figure."""
    pytest.importorskip("matplotlib")
    long = ss.model_from_sympy("p**2/2 + q**2/2", name="a_model_with_a_long_name_" * 4)
    found = ss.moments(long, q0=1.0, p0=0.0, step=0.1, steps=2, paths=10)
    for page in (found.plot(), found.plot(of="q")):
        renderer = page._get_renderer()
        page.draw(renderer)
        assert page._suptitle.get_window_extent(renderer).width < page.bbox.width
        assert page.get_suptitle().replace("\n", " ").endswith("bands: two standard errors, standard deviation")


FALLBACKS = [
    ({"q": ["energy"], "p": ["t"]}, ("q_1", "p_1")),
    ({"q": ["energy", "x"], "p": ["u", "v"]}, ("q_1", "x", "u", "v")),
    ({"q": ["q", "r"], "p": ["p", "s"]}, ("q_1", "r", "p_1", "s")),
    ({"q": sympy.symbols(["a/b"]), "p": sympy.symbols(["P"])}, ("q_1", "P")),
]


@pytest.mark.parametrize(("names", "columns"), FALLBACKS)
def test_names_that_columns_have_for_something_else(names, columns):
    """Two columns never have one name, and every name is allowed in a file."""
    symbols = {key: [sympy.Symbol(str(x)) for x in given] for key, given in names.items()}
    found = ss.model_from_sympy(sum(x**2 for given in symbols.values() for x in given) / 2, **symbols)
    assert found.coordinates == columns
    with pytest.raises(InvalidArgumentError, match=f"observable '{columns[-1]}': this name is taken"):
        ss.moments(found, q0=1.0, p0=0.0, step=0.1, steps=1, observables={columns[-1]: "1 + 0*q_1"})


def test_functions_of_time_have_their_name():
    t = sympy.Symbol("t")
    x = sympy.Function("x")(t)
    found = ss.model_from_sympy(sympy.Symbol("u") ** 2 / 2 + x**2 / 2, q=[x], p="u")
    assert found.coordinates == ("x", "u")
    mean = ss.moments(found, q0=2.0, p0=0.0, step=0.1, steps=1, observables={"o": "x**2"}).mean["o"]
    assert mean[0] == 4.0


SCENE = f"""
[model]
H = "{H}"
q = "x y"
p = ["px", "py"]
noise = ["s*x"]
params = {{s = 0.3, k = 1.0}}
[run]
step = 0.1
steps = 20
paths = 64
q0 = 0.5
p0 = 0.0
[output]
moments = true
paths = [0, 1]
[[observe]]
kind = "histogram"
of = "y"
low = -1
high = 1
"""


def test_files_have_the_names_of_the_model(tmp_path, capsys):
    """Files written by the command line have the model's names, also when they are loaded again."""
    (tmp_path / "scene.toml").write_text(SCENE, encoding="utf-8")
    out = tmp_path / "out"
    assert command_line.main(["run", str(tmp_path / "scene.toml"), "--out", str(out), "--error-check"]) == 0
    told = capsys.readouterr().out
    assert "mean x " in told and "mean px^2" in told and "q_1" not in told
    for name in ("moments.csv", "moments.nc", "moments.npz"):
        if (out / name).exists():
            assert ss.load(out / name).columns() == [*NAMES, "energy"], name
            assert ss.load(out / name).values.called("q_2") == "y"
    run = next(file for file in (out / "run.nc", out / "run.npz") if file.exists())
    assert list(ss.load(run).to_pandas().columns) == NAMES
    assert "se_mean y^2" in (out / "error-check.csv").read_text(encoding="utf-8")
    if pytest.importorskip("matplotlib"):
        for source in (out, run):
            given = [
                "plot",
                str(source),
                "--what",
                "trajectory",
                "--of",
                "y",
                "--of",
                "px",
                "--out",
                str(out / "f.svg"),
            ]
            assert command_line.main(given) == 0
        assert command_line.main(["plot", str(out), "--of", "z"]) == command_line.BAD_INPUT
        assert "there is no value 'z': there are x, y, px, py, energy, histogram" in capsys.readouterr().err
        assert command_line.main(["plot", str(out), "--of", "q_2"]) == 0
        written = capsys.readouterr().out
        assert "observed-histogram.png" in written and "trajectory.png" not in written


def test_an_animation_shows_the_ensemble_at_saved_times(run, tmp_path):
    """One frame for each saved time with the paths as points; the limits contain all points."""
    pytest.importorskip("matplotlib")
    for of, (x, y) in {None: (run.q[:, 0], run.p[:, 0]), ("x", "y"): (run.q[:, 0], run.q[:, 1])}.items():
        found = run.animate(of=of, most=30)
        axes = found._fig.axes[0]
        (points,) = axes.get_lines()
        frames = list(found.new_frame_seq())
        assert len(frames) == len(run.t)
        for i in (3, 0, 4):
            found._draw_frame(frames[i])
            np.testing.assert_array_equal(points.get_xdata(), x[i, :30])
            np.testing.assert_array_equal(points.get_ydata(), y[i, :30])
            assert axes.get_title() == f"formula by midpoint, 30 paths, t = {run.t[i]:g}"
        for values, (low, high) in ((x, axes.get_xlim()), (y, axes.get_ylim())):
            assert low < values[:, :30].min() and values[:, :30].max() < high
        found._draw_was_started = True  # nothing is drawn on a screen
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("x", "y")
    images = pytest.importorskip("PIL.Image")
    run.animate(tmp_path / "moving.gif", rate=10)
    with images.open(tmp_path / "moving.gif") as file:
        assert file.n_frames == len(run.t) and file.info["duration"] == 100
    with pytest.raises(InvalidArgumentError, match=r"no ending of an animation: give \.gif"):
        run.animate(tmp_path / "moving.avi")
    for wrong, words in (({"rate": 0.0}, "rate = 0.0"), ({"of": "x"}, "give two values"), ({"most": 0}, "most = 0")):
        with pytest.raises(InvalidArgumentError, match=words):
            run.animate(**wrong)
