# SPDX-License-Identifier: BSD-3-Clause
"""Figures and tables show the computed numbers: lines, bands and cells are read back."""

import inspect
from types import SimpleNamespace

import numpy as np
import pytest
import symsde as ss
from symsde import observe
from symsde.cli import command_line
from symsde.errors import InvalidArgumentError, SceneError, UnknownNameError, WrongTypeError
from symsde.show.plot import draw

pytest.importorskip("matplotlib")

START = np.full((2, 30), 0.3)
START[:, 0] = 20.0  # fails in the first steps
RUN = {"q0": START, "p0": 0.1, "step": 0.1, "steps": 40, "save_every": 10, "paths": 30, "scheme": "stormer_verlet"}
OBSERVERS = {
    "hist": observe.Histogram("q_1", -1, 1, 8),
    "cov": observe.Covariance(("q_1", "p_2")),
    "loss": observe.Passage("q_1", high=0.5, absorb=False),
    "far": observe.Extremes("p_1"),
    "some": observe.Paths((3, 5), of=("q_1",)),
    "mid": observe.Quantiles("energy", (0.25, 0.5), low=1e-3, high=10),
    "along": observe.Autocorrelation("q_1", lags=3),
}


@pytest.fixture(scope="module")
def model():
    return ss.models.henon_heiles(sigma1=0.2)


@pytest.fixture(scope="module")
def run(model):
    with pytest.warns(ss.PathsFailedWarning):
        return ss.simulate(model, **RUN)


@pytest.fixture(scope="module")
def moments(model):
    with pytest.warns(ss.PathsFailedWarning):
        return ss.moments(model, observables={"<b> & r": "q1*q1"}, observers=OBSERVERS, **RUN)


def lines(figure, panel=0):
    return [line.get_xydata().T for line in figure.axes[panel].get_lines()]


def band(figure, number, panel=0):
    """Lower and upper edges of a band."""
    collection = figure.axes[panel].collections[number]
    points = collection.get_paths()[0].vertices
    xs = np.unique(points[:, 0])
    return xs, *(np.array([f(points[points[:, 0] == x, 1]) for x in xs]) for f in (np.min, np.max))


def test_paths_along_time(run):
    figure = run.plot(of=["q_2", "p_1"], most=4)
    drawn = lines(figure)
    assert len(figure.axes) == 2 and len(drawn) == 4
    for i, (x, y) in enumerate(drawn):
        np.testing.assert_array_equal(x, run.t)
        np.testing.assert_array_equal(y, run.q[:, 1, i])  # the first path up to its failure
    np.testing.assert_array_equal(lines(figure, 1)[3][1], run.p[:, 0, 3])
    assert [axes.get_ylabel() for axes in figure.axes] == ["q_2", "p_1"] and figure.axes[0].get_xlabel() == "t"
    assert [text.get_text() for text in figure.axes[0].get_legend().get_texts()] == [f"path {i}" for i in range(4)]
    assert figure.axes[1].get_legend() is None  # both panels have the same colours, so the second has no legend
    assert figure.get_suptitle() == "henon_heiles by stormer_verlet, 4 of 30 paths"


def test_phase_plane_and_energy(run):
    (x, y), *_ = lines(run.plot(what="phase", of=["q_2"], most=1))
    np.testing.assert_array_equal(x, run.q[:, 1, 0])
    np.testing.assert_array_equal(y, run.p[:, 1, 0])
    for i, (x, y) in enumerate(lines(run.plot(what="energy"))):
        known = [run.model.value(q, p, t=t)[i] for t, q, p in zip(run.t, run.q, run.p, strict=True)]
        np.testing.assert_array_equal(x, run.t)
        np.testing.assert_array_equal(y, known)


def test_moments_with_bands(moments):
    figure = moments.plot(of=["q_1", "<b> & r"])
    kinds = ("mean", "var", "se_mean")
    of_q, own = [getattr(moments, f"{kind}_q")[:, 0] for kind in kinds], [moments.table(kind)[:, -1] for kind in kinds]
    for panel, (mean, var, error) in enumerate([of_q, own]):
        ((x, y),) = lines(figure, panel)
        np.testing.assert_array_equal(x, moments.t)
        np.testing.assert_array_equal(y, mean)
        for number, width in enumerate((np.sqrt(var), 2 * error)):
            xs, low, high = band(figure, number, panel)
            np.testing.assert_allclose(xs, moments.t)
            np.testing.assert_allclose(low, mean - width, rtol=1e-12)
            np.testing.assert_allclose(high, mean + width, rtol=1e-12)
    ((_, y),) = lines(moments.plot(what="energy"))
    np.testing.assert_array_equal(y, moments.mean_energy)
    assert "30 paths, 29 at the end" in figure.get_suptitle()


def test_histograms(moments):
    hist = moments.observed["hist"]
    for at in (-1, 2):
        figure = hist.plot(at=at)
        heights, edges, _ = figure.axes[0].patches[0].get_data()
        np.testing.assert_array_equal(heights, hist.density[at])
        np.testing.assert_array_equal(edges, hist.edges)
        bars = figure.axes[0].collections[0].get_segments()
        np.testing.assert_allclose([b[1, 1] - b[0, 1] for b in bars], 4 * hist.se_density[at], rtol=1e-9)
        assert f"t = {moments.t[at]:g}, {hist.counts[at].sum()} paths" in figure.get_suptitle()


def test_every_other_observer(moments):
    seen = moments.observed
    expected = {
        "cov": [seen["cov"].covariance[:, i, j] for i, j in ((0, 0), (0, 1), (1, 1))],
        "loss": [seen["loss"].lost],
        "far": [seen["far"].mean_highest, seen["far"].mean_lowest],
        "some": [seen["some"].values[i, :, 0] for i in range(2)],
        "mid": [seen["mid"].quantile[:, 0], seen["mid"].quantile[:, 1]],
        "along": [seen["along"].correlation],
    }
    assert set(expected) | {"hist"} == set(OBSERVERS)
    for name, curves in expected.items():
        figure = seen[name].plot()
        drawn = lines(figure)
        assert len(drawn) == len(curves), name
        for (x, y), known in zip(drawn, curves, strict=True):
            np.testing.assert_array_equal(x, seen["along"].lag if name == "along" else moments.t)
            np.testing.assert_array_equal(y, known, err_msg=name)
    errors = {
        "cov": [seen["cov"].se_covariance[:, i, j] for i, j in ((0, 0), (0, 1), (1, 1))],
        "loss": [seen["loss"].se_lost],
        "far": [seen["far"].se_mean_highest, seen["far"].se_mean_lowest],
        "mid": [seen["mid"].se_quantile[:, 0], seen["mid"].se_quantile[:, 1]],
        "along": [seen["along"].se_correlation],
    }
    for name, widths in errors.items():
        figure = seen[name].plot()
        for number, (width, (_, known)) in enumerate(zip(widths, lines(figure), strict=True)):
            _, low, high = band(figure, number)
            np.testing.assert_allclose(high, (known + 2 * width)[np.isfinite(known)], atol=1e-15, err_msg=name)
            np.testing.assert_allclose(low, (known - 2 * width)[np.isfinite(known)], atol=1e-15, err_msg=name)


def test_names_of_curves_and_axes(moments):
    seen = moments.observed
    expected = {
        "cov": ("t", "covariance", ["q_1, q_1", "q_1, p_2", "p_2, p_2"]),
        "loss": ("t", "share that left", []),
        "far": ("t", "extremes", ["highest", "lowest"]),
        "some": ("t", "value", ["q_1 of path 3", "q_1 of path 5"]),
        "mid": ("t", "quantile", ["0.25", "0.5"]),
        "along": ("lag", "autocorrelation", []),
        "hist": ("q_1", "density", ["two standard errors"]),
    }
    for name, (x, y, labels) in expected.items():
        axes = seen[name].plot().axes[0]
        told = [text.get_text() for text in axes.get_legend().get_texts()] if axes.get_legend() else []
        assert (axes.get_xlabel(), axes.get_ylabel(), told) == (x, y, labels), name
    assert seen["far"].plot().get_suptitle() == "extremes of p_1, 5 times; bands: two standard errors"
    assert seen["some"].plot().get_suptitle() == "paths of q_1, 5 times"


def test_paths_outside_of_a_histogram_are_counted():
    """Values below and above the histogram, and NaN, are each counted."""
    counts = np.array([[3, 4]])
    found = SimpleNamespace(
        observer=observe.Histogram("q_1", -1, 1, 2), looked_at=("q_1",), t=np.array([0.5]), counts=counts,
        below=[10], above=[200], not_a_number=[3000], density=counts / 7, se_density=counts / 70,
        edges=np.array([-1.0, 0.0, 1.0]),
    )  # fmt: skip
    assert draw.of_observed(found)[1] == "q_1 at t = 0.5, 7 paths, 3210 outside"


def test_maps_of_chains():
    """From eight degrees of freedom on a run is drawn as a map: colours over time and site, red above zero."""
    chain = ss.models.fpu_chain(n=9)
    options = {"q0": np.arange(9.0), "p0": 0.0, "step": 0.1, "steps": 40, "save_every": 10, "scheme": "stormer_verlet"}
    run = ss.simulate(chain, first_path=4, **options)
    figure = run.plot()
    for panel, (name, known) in enumerate({"q": run.q, "p": run.p}.items()):
        (mesh,) = figure.axes[panel].collections
        np.testing.assert_array_equal(np.asarray(mesh.get_array()).reshape(9, 5), known[:, :, 0].T)
        assert mesh.get_clim() == (-np.abs(known).max(), np.abs(known).max())
        edges = mesh.get_coordinates()
        np.testing.assert_allclose(edges[0, :, 0], np.linspace(-0.5, 4.5, 6))
        np.testing.assert_allclose(edges[:, 0, 1], np.arange(0.5, 10))
        assert (figure.axes[panel].get_xlabel(), figure.axes[panel].get_ylabel()) == ("t", "degree of freedom")
        assert figure.axes[2 + panel].get_ylabel() == name  # label of the colour bar
    assert figure.get_suptitle() == "fpu_chain by stormer_verlet, path 4 of 1" and len(figure.axes) == 4
    assert len(run.plot(what="map", of=["p"]).axes) == 2 and len(lines(run.plot(of=["q_3"]))) == 1
    means = ss.moments(chain, paths=40, **options)
    (mesh,) = means.plot(what="map", of=["q"]).axes[0].collections
    np.testing.assert_array_equal(np.asarray(mesh.get_array()).reshape(9, 5), means.mean_q.T)
    with pytest.raises(UnknownNameError, match=r"no value 'q_1': there are q, p"):
        run.plot(what="map", of=["q_1"])
    assert len(run.plot(what="map", of=["q"]).axes[0].collections) == 1
    assert ss.simulate(chain, **{**options, "steps": 0, "save_every": 1}).plot().axes[0].has_data()


def test_lines_do_not_hide_how_few_points_there_are(model):
    """Up to 200 saved times are marked; a phase plot joins no points farther apart than a tenth of its width."""
    oscillator = {"q0": 1.0, "p0": 0.0, "step": 0.05, "scheme": "stormer_verlet", "seed": 1}
    often = ss.simulate(ss.models.kubo(), steps=400, **oscillator)
    seldom = ss.simulate(ss.models.kubo(), steps=400, save_every=20, **oscillator)
    drawn = {
        (name, what): run.plot(what=what).axes[0].get_lines()[0]
        for name, run in {"often": often, "seldom": seldom}.items()
        for what in ("paths", "phase")
    }
    style = {key: (line.get_linestyle(), line.get_marker()) for key, line in drawn.items()}
    assert style["often", "paths"] == style["often", "phase"] == ("-", "None")
    assert style["seldom", "paths"] == ("-", ".") and style["seldom", "phase"] == ("None", ".")
    assert not draw._is_sparse(*np.ones((2, 5, 1)))


def every_result(run, moments):
    """All results with a plot and its number of panels, or those that can be drawn into given axes."""
    kubo = {"q0": 1.0, "p0": 0.0, "steps": [4, 8], "paths": 40}
    study = ss.work_precision(ss.models.kubo(), schemes=["midpoint", "heun"], repeats=5, **kubo)
    return [(run, 4), (moments, 6), *((x, 1) for x in moments.observed.values()),
            (ss.convergence(ss.models.kubo(), **kubo), 1), (study, 2)]  # fmt: skip


def test_every_plot_takes_a_file_or_axes(run, moments, tmp_path):
    """One signature: plot(path=None, *, ax=None, ..) returns the figure that it writes, or that of the axes."""
    figures = pytest.importorskip("matplotlib.figure")
    for i, (found, panels) in enumerate(every_result(run, moments)):
        assert list(inspect.signature(found.plot).parameters)[:2] == ["path", "ax"]
        assert isinstance(found.plot(), figures.Figure)
        file = tmp_path / f"{i}.svg"
        assert isinstance(found.plot(file), figures.Figure) and file.read_text().count("<svg") == 1
        page = figures.Figure()
        own = page.subplots(panels, squeeze=False)
        assert found.plot(ax=own) is page and all(axes.has_data() for axes in page.axes), found
        if panels == 1:
            assert found.plot(ax=page.axes[0]) is page
        with pytest.raises(InvalidArgumentError, match="path and ax are both given: give one"):
            found.plot(file, ax=own)
        with pytest.raises(InvalidArgumentError, match=f"ax holds 5 axes, and the figure has {panels} panel"):
            found.plot(ax=[page.axes[0]] * 5)
        with pytest.raises(WrongTypeError, match="ax = 3 is no axes of matplotlib"):
            found.plot(ax=3)
        with pytest.raises(InvalidArgumentError, match="no ending of a figure"):
            found.plot(tmp_path / "x.jpeg")


def test_axes_of_convergence_may_stand_first_until_they_go():
    axes = pytest.importorskip("matplotlib.figure").Figure().subplots()
    found = ss.convergence(ss.models.kubo(), q0=1.0, p0=0.0, steps=[4, 8], paths=40)
    for old in ((axes,), {}), ((), {"axes": axes}):
        with pytest.warns(DeprecationWarning, match=r"plot\(axes\) is now plot\(ax=axes\)"):
            assert found.plot(*old[0], **old[1]) is axes


def test_what_cannot_be_drawn(run, moments, model, tmp_path):
    with pytest.raises(UnknownNameError, match=r"no value 'q_9': there are q_2, q_1"):
        run.plot(of=["q_9"])
    with pytest.raises(UnknownNameError, match=r"'path'.*paths"):
        run.plot(what="path")
    with pytest.raises(InvalidArgumentError, match=r"no ending of a figure: give one of \.png, \.pdf, \.svg"):
        run.plot(tmp_path / "x.jpeg")
    with pytest.raises(InvalidArgumentError, match="most = 0"):
        run.plot(most=0)
    with pytest.raises(InvalidArgumentError, match="at = 5"):
        moments.observed["hist"].plot(at=5)
    plain = ss.Model(ndof=1, nnoise=0, gradient=lambda t, w, q, p: (w[0] * q, w[0] * p))
    with pytest.raises(InvalidArgumentError, match="energy is not known"):
        ss.simulate(plain, q0=1.0, p0=0.0, step=0.1, steps=2).plot(what="energy")
    with pytest.raises(InvalidArgumentError, match="the energy is not known, as the model has no value"):
        ss.moments(plain, q0=1.0, p0=0.0, step=0.1, steps=2).plot(what="energy")


def test_no_path_is_ok(model):
    """Every path has failed at the last saved time; without finite values there is nothing to draw."""
    with pytest.warns(ss.PathsFailedWarning):
        gone = ss.moments(model, **{**RUN, "q0": 20.0, "steps": 20})
    assert gone.n_ok.tolist() == [30, 30, 0]
    ((_, y),) = lines(gone.plot(of=["q_1"]))
    assert y[0] == 20.0 and np.isfinite(y).tolist() == [True, True, False]
    gone.n_ok[...] = 0
    with pytest.raises(InvalidArgumentError, match="no path is ok at any time: there is nothing to draw"):
        gone.plot()
    with pytest.warns(ss.PathsFailedWarning):
        run = ss.simulate(model, **{**RUN, "q0": 20.0, "steps": 20})
    run.q[...] = np.nan
    with pytest.raises(InvalidArgumentError, match="no path has a finite value: there is nothing to draw"):
        run.plot()


SCENE = """
[model]
name = "kubo"
[run]
step = 0.1
steps = 20
save_every = 5
paths = 300
q0 = 1.0
p0 = 0.0
[output]
paths = [1, 2]
[[observe]]
kind = "histogram"
of = "q_1"
low = -1.5
high = 1.5
bins = 6
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("drawn")
    (place / "scene.toml").write_text(SCENE)
    assert command_line.main(["run", str(place / "scene.toml"), "--out", str(place / "out"), "--quiet"]) == 0
    return place / "out"


def drawn_by(monkeypatch):
    """The figures that the command writes, by file name."""
    figures = {}
    monkeypatch.setattr("symsde.show.look.write", lambda page, target, *_: figures.__setitem__(target.name, page))
    return figures


def test_the_command_draws_a_folder(folder, monkeypatch, capsys):
    figures = drawn_by(monkeypatch)
    assert command_line.main(["plot", str(folder)]) == 0
    assert list(figures) == ["paths.png", "phase.png", "energy.png", "moments.png", "observed-histogram.png"]
    assert capsys.readouterr().out.count("written to") == 5
    found = ss.open_run(folder)
    np.testing.assert_array_equal(lines(figures["paths.png"])[1][1], found.run.q[:, 0, 1])
    assert [line.get_label() for line in figures["paths.png"].axes[0].get_lines()] == ["path 1", "path 2"]
    (phase,) = figures["phase.png"].axes
    assert (phase.get_xlabel(), phase.get_ylabel()) == ("q_1", "p_1")
    np.testing.assert_array_equal(lines(figures["moments.png"])[0][1], found.moments.mean_q[:, 0])
    heights = figures["observed-histogram.png"].axes[0].patches[0].get_data()[0]
    np.testing.assert_array_equal(heights, found.moments.observed["histogram"].density[-1])


@pytest.mark.parametrize("name", ["run.nc", "run.npz", "moments.csv", "moments.nc", "moments.npz"])
def test_the_command_draws_files(name, folder, tmp_path, monkeypatch):
    if name.endswith(".nc"):
        pytest.importorskip("netCDF4")
    found = ss.open_run(folder)
    (found.run if name.startswith("run") else found.moments).save(tmp_path / name)
    figures = drawn_by(monkeypatch)
    assert command_line.main(["plot", str(tmp_path / name)]) == 0
    if name.startswith("run"):
        assert list(figures) == ["run-paths.png", "run-phase.png"]
        np.testing.assert_array_equal(lines(figures["run-paths.png"])[0][1], found.run.q[:, 0, 0])
        np.testing.assert_array_equal(lines(figures["run-phase.png"])[1][1], found.run.p[:, 0, 1])
    else:
        figure = figures["moments-moments.png"]
        assert [axes.get_ylabel() for axes in figure.axes] == ["mean q_1", "mean p_1", "mean energy"]
        assert figure.get_suptitle().startswith("kubo by midpoint, 300 paths; bands")
        np.testing.assert_array_equal(lines(figure, 2)[0][1], found.moments.mean_energy)
        _, low, high = band(figure, 1)
        np.testing.assert_allclose(high - low, 4 * found.moments.se_mean_q[:, 0], atol=1e-14)


def test_one_figure_of_the_command(folder, tmp_path, capsys):
    given = ["plot", str(folder), "--what", "phase", "--most", "1", "--of", "q_1", "--out", str(tmp_path / "x.svg")]
    assert command_line.main(given) == 0
    assert capsys.readouterr().out == f"written to {tmp_path / 'x.svg'}\n"
    assert (tmp_path / "x.svg").read_text().count("<svg") == 1
    refused = {
        ("--what", "moment"): "--what = 'moment'",
        ("--out", "x.png"): "--out is for one figure: say which by --what, one of paths, phase",
        ("--of", "q_7"): "there is no value 'q_7'",
        ("--what", "observed-histogram", "--at", "9"): "at = 9",
    }
    for options, sentence in refused.items():
        assert command_line.main(["plot", str(folder), *options]) == command_line.BAD_INPUT
        assert sentence in capsys.readouterr().err
    (tmp_path / "bad.npz").write_bytes(b"nothing")
    (tmp_path / "bad.csv").write_text("a,b\n1,2\n")
    (tmp_path / "x.txt").write_text("")
    sentences = {
        "missing": "does not exist",
        "bad.npz": "holds neither",
        "bad.csv": "holds neither",
        "x.txt": "no file",
    }
    for name, sentence in {**sentences, ".": "holds no run"}.items():
        assert command_line.main(["plot", str(tmp_path / name)]) == command_line.BAD_INPUT, name
        assert sentence in capsys.readouterr().err, name


def test_the_command_draws_maps(tmp_path, monkeypatch):
    file = tmp_path / "scene.toml"
    file.write_text(
        '[model]\nname = "fpu_chain"\nn = 8\n[run]\nstep = 0.1\nsteps = 20\npaths = 20\nq0 = 0.3\np0 = 0.1\n'
        "[output]\npaths = [0]\n"
    )
    assert command_line.main(["run", str(file), "--out", str(tmp_path / "out"), "--quiet"]) == 0
    figures = drawn_by(monkeypatch)
    assert command_line.main(["plot", str(tmp_path / "out")]) == 0
    assert {"map.png", "moments-map.png"} < set(figures)
    assert all(len(figures[name].axes) == 4 for name in ("map.png", "moments-map.png"))


def test_figures_of_a_value(tmp_path, monkeypatch, capsys):
    """With several figures in a folder, --of selects those of one value."""
    file = tmp_path / "scene.toml"
    file.write_text(
        '[model]\nname = "kubo"\n[run]\nstep = 0.1\nsteps = 20\npaths = 50\nq0 = 0.3\np0 = 0.1\n'
        '[observables]\nr = "q*p"\n[[observe]]\nkind = "extremes"\nof = "r"\n'
        '[[observe]]\nkind = "covariance"\nof = ["q_1", "r"]\n[output]\npaths = [0]\n'
    )
    out = tmp_path / "out"
    assert command_line.main(["run", str(file), "--out", str(out), "--quiet"]) == 0
    figures = drawn_by(monkeypatch)
    chosen = {
        ("r",): ["moments", "observed-extremes", "observed-covariance"],
        ("energy",): ["paths", "energy", "moments"],
        ("q_1", "r"): ["moments", "observed-covariance"],
        ("p_1",): ["paths", "phase", "moments"],
        ("p",): ["paths", "phase", "moments"],
        ("extremes",): ["observed-extremes"],  # found by the observer's name
    }
    for names, known in chosen.items():
        figures.clear()
        assert command_line.main(["plot", str(out), *(word for name in names for word in ("--of", name))]) == 0
        assert list(figures) == [f"{name}.png" for name in known], names
    figures.clear()
    assert command_line.main(["plot", str(out), "--of", "r"]) == 0
    mean = ss.open_run(out).moments.mean["r"]
    np.testing.assert_array_equal(lines(figures["moments.png"])[0][1], mean)
    capsys.readouterr()
    refused = {
        ("--of", "s"): "there is no value 's': there are q_1, p_1, energy, r, extremes, covariance",
        ("--what", "paths", "--of", "r"): "there is no value 'r': there are q_1, p_1, energy",
        ("--what", "energy", "--of", "q_1"): "there is no value 'q_1': there are energy",
        ("--what", "observed-extremes", "--of", "q_1"): "there is no value 'q_1': there are r, extremes",
        ("--of", "r", "--out", "x.png"): "say which by --what, one of moments, observed-extremes, observed-covariance",
    }
    for options, sentence in refused.items():
        assert command_line.main(["plot", str(out), *options]) == command_line.BAD_INPUT
        assert sentence in capsys.readouterr().err, options
    assert command_line.main(["plot", str(out / "moments.csv"), "--of", "r"]) == 0
    (out / "shards" / "moments-000001.npz").unlink()
    assert command_line.main(["plot", str(out), "--of", "r"]) == command_line.BAD_INPUT
    assert "there is no value 'r': there are q_1, p_1, energy" in capsys.readouterr().err
    assert command_line.main(["plot", str(out), "--what", "observed-extremes"]) == command_line.BAD_INPUT


def test_a_folder_without_shards_has_nothing_to_draw(folder, tmp_path):
    empty = tmp_path / "empty"
    (empty / "shards").mkdir(parents=True)
    for name in ("manifest.json", "scene.toml"):
        (empty / name).write_bytes((folder / name).read_bytes())
    with pytest.raises(SceneError, match="holds no shard yet: there is nothing to draw"):
        options = command_line._parser().parse_args(["plot", str(empty)])
        options.verb(options)


def test_names_are_drawn_as_they_are(tmp_path):
    """A $ in a name does not begin mathematics; an observer named like a variance is not a value."""
    found = ss.moments(
        ss.models.kubo(), q0=1.0, p0=0.0, step=0.1, steps=4, paths=40, observables={"$x^{2$": "q**2"},
        observers={"var_h": ss.observe.Extremes("q_1")},
    )  # fmt: skip
    page = found.plot(of=["$x^{2$"])
    page.canvas.draw()
    assert "mean $x^{2$" in {text for axes in page.axes for text in (axes.get_ylabel(), axes.get_title())}
    found.save(tmp_path / "moments.npz")
    given = ["plot", str(tmp_path / "moments.npz"), "--what", "moments", "--out", str(tmp_path / "figure.png")]
    assert command_line.main(given) == 0


@pytest.mark.parametrize("size", [1e301, 1e308, 1.7e308])
def test_numbers_near_the_largest_are_left_out(size):
    """Axes overflow for numbers this large: these paths are left out, the others drawn."""
    pytest.importorskip("matplotlib")
    model = ss.Model(ndof=1, nnoise=0, gradient=lambda t, w, q, p: (0 * q, 0 * p), value=lambda t, w, q, p: q[0])
    how = {"q0": np.array([[size, 2.0, -size]]), "p0": 0.0, "step": 0.1, "steps": 3, "paths": 3}
    run = ss.simulate(model, **how)
    for what in ("paths", "phase", "energy", "map"):
        figure = run.plot(what=what)
        figure.canvas.draw()
    assert "without values above 1e+300" in figure._suptitle.get_text()
    axes = run.plot(what="paths").axes[0]
    assert axes.get_ylim()[0] < 2 < axes.get_ylim()[1] < 1e3
    for what in ("moments", "energy", "map"):
        ss.moments(model, **how).plot(what=what).canvas.draw()
    with pytest.raises(InvalidArgumentError, match="values above 1e300 are left out"):
        ss.simulate(model, **how | {"q0": size}).plot()
