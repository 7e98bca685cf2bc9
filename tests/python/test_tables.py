# SPDX-License-Identifier: BSD-3-Clause
"""Results as tables: data frames, output in notebooks, and files that are loaded again."""

import re
from pathlib import Path

import numpy as np
import pytest
import symsde as ss
from conftest import table_of
from symsde.cli import command_line
from symsde.show import tables

START = np.full((2, 30), 0.3)
START[:, 0] = 20.0  # fails in the first steps
RUN = {"q0": START, "p0": 0.1, "step": 0.1, "steps": 40, "save_every": 10, "paths": 30, "scheme": "stormer_verlet"}


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
        return ss.moments(model, observables={"<b> & r": "q1*q1"}, **RUN)


def test_data_frames(run, moments, tmp_path):
    pandas = pytest.importorskip("pandas")
    paths, means = run.to_pandas(), moments.to_pandas()
    assert paths.shape == (30 * 5, 4) and list(paths.index.names) == ["path", "t"]
    np.testing.assert_array_equal(paths.loc[7, "p_2"], run.p[:, 1, 7])
    np.testing.assert_array_equal(paths["q_1"].xs(run.t[2], level="t"), run.q[2, 0])
    moments.save(tmp_path / "moments.csv")
    known = pandas.read_csv(tmp_path / "moments.csv", comment="#", index_col="t")
    pandas.testing.assert_frame_equal(means, known, check_exact=True)
    assert table_of(tmp_path / "moments.csv")[0].split(",")[1:] == list(means.columns)


def test_one_module_writes_tables_and_one_figures():
    """No other module of the package fills columns, makes cells, or writes what matplotlib draws."""
    marks = {
        "tables.py": r"csv\.writer|<table>|\| ---|\.[lr]just\(|\{[^{}]*:[<>]?\d+s?\}",
        "look.py": r"\.savefig\(|rc_context\(|figures\.Figure\(|layout=\"constrained\"",
    }
    package = Path(ss.__file__).parent
    sources = [file for file in package.rglob("*.py") if file.parts[-2] not in ("formulas", "export")]  # programs
    for writer, mark in marks.items():
        found = {file.name for file in sources if re.search(mark, file.read_text(encoding="utf-8"))}
        assert found == {writer}, mark


def test_cells_in_columns():
    rows = [["a", "12", "b"], ["name", "3", ""]]
    assert tables.aligned(rows, (-5, 4, 0)) == "a       12 b\nname     3"
    assert tables.aligned(rows, (-2, 1, -3), "") == "a 12b\nname3"
    assert tables.facts([("left out", "nothing"), ("", "b")]) == "left out   nothing\n           b"
    assert tables.markdown(["x"], [["a|b"]]) == "| x |\n| --- |\n| a\\|b |\n"
    assert tables.notebook(["<"], [["&"]]) == "<table>\n<tr><th>&lt;</th></tr>\n<tr><td>&amp;</td></tr>\n</table>\n"


def cells(page):
    return [re.findall(r"<t[dh]>(.*?)</t[dh]>", row) for row in re.findall(r"<tr>(.*?)</tr>", page)]


def test_what_notebooks_show(run, moments):
    header, *rows = cells(moments._repr_html_())
    assert header == ["t", "paths", "mean q_1", "mean p_1", "mean energy", "mean &lt;b&gt; &amp; r"]
    assert len(rows) == 5 and rows[-1][:2] == ["4", "29"]
    assert rows[-1][2] == f"{moments.mean_q[-1, 0]:.6g} ± {moments.se_mean_q[-1, 0]:.2g}"
    assert "<b>" not in moments._repr_html_()
    header, *rows = cells(run._repr_html_())
    assert header == ["path", "status", "last q_1", "last q_2", "last p_1", "last p_2"]
    assert len(rows) == 11 and rows[0][1].endswith(f"at step {run.failed_step[0]}") and rows[1][1] == "ok"
    assert rows[4][2:] == [f"{x:.6g}" for x in (*run.last_q[:, 4], *run.last_p[:, 4])]
    assert "and 19 paths more" in run._repr_html_()
    assert "henon_heiles" in run._repr_html_()


def test_a_failure_in_the_first_step_is_told(model):
    with pytest.warns(ss.PathsFailedWarning):
        run = ss.simulate(model, **{**RUN, "q0": 1e200, "paths": 1})
    assert run.failed_step[0] == 0 and f"<td>{ss.status_text(int(run.status[0]))} at step 0</td>" in run._repr_html_()


def test_the_energy_of_a_run(run):
    known = [run.model.value(q, p, t=t) for t, q, p in zip(run.t, run.q, run.p, strict=True)]
    np.testing.assert_array_equal(run.energy, known)
    assert run.energy.shape == (5, 30) and np.isnan(run.energy[-1, 0]) and run.has_energy
    plain = ss.Model(ndof=1, nnoise=0, gradient=lambda t, w, q, p: (w[0] * q, w[0] * p))
    found = ss.simulate(plain, q0=1.0, p0=0.0, step=0.1, steps=2)
    with pytest.raises(ss.errors.MissingOperationError, match=r"no energies of user.*value\(t, w, q, p\)"):
        _ = found.energy
    assert not found.has_energy


def test_degrees_of_freedom_and_time_are_coordinates(run, moments):
    """In datasets t is the time, as everywhere; `time`, the dimension's name, has the same values."""
    pytest.importorskip("xarray")
    for data in (run.to_xarray(), moments.to_xarray()):
        assert data.dof.to_numpy().tolist() == [1, 2] and data.dof.attrs["long_name"] == "degree of freedom"
        np.testing.assert_array_equal(data.t, run.t)
        np.testing.assert_array_equal(data.time, run.t)
    data = run.to_xarray()
    for name in ("t", "time"):
        np.testing.assert_array_equal(data.p.sel({name: 2.0, "dof": 2, "path": 7}), run.p[2, 1, 7])
    assert data.to_dataframe().q.loc[2.0, 2, 7] == run.q[2, 1, 7]


def test_long_data_frames(run):
    pytest.importorskip("pandas")
    frame = run.to_pandas(long=True)
    assert list(frame.index.names) == ["path", "t", "dof"] and list(frame.columns) == ["q", "p"]
    assert frame.shape == (30 * 5 * 2, 2) and frame.p.loc[7, 2.0, 2] == run.p[2, 1, 7]
    with pytest.raises(ss.errors.WrongTypeError, match="long = 1 is not a truth value"):
        run.to_pandas(long=1)


@pytest.mark.parametrize("ending", ["nc", "npz", "csv"])
def test_files_are_loaded_again(ending, run, moments, tmp_path):
    """A loaded run has the arrays, tables, texts and figures of the run that was saved."""
    if ending == "nc":
        pytest.importorskip("netCDF4")
    moments.scene = "first\n\n  third: x"
    moments.save(tmp_path / f"moments.{ending}")
    found = ss.load(tmp_path / f"moments.{ending}")
    assert found.columns() == moments.columns()
    for kind in ("mean", "var", "se_mean"):
        np.testing.assert_array_equal(found.table(kind), moments.table(kind))
        for name in ("q", "p", "energy"):
            np.testing.assert_array_equal(getattr(found, f"{kind}_{name}"), getattr(moments, f"{kind}_{name}"))
        np.testing.assert_array_equal(getattr(found, kind)["<b> & r"], getattr(moments, kind)["<b> & r"])
    np.testing.assert_array_equal(found.t, moments.t)
    np.testing.assert_array_equal(found.n_ok, moments.n_ok)
    told, known = found.attributes(), moments.attributes()
    assert {key: told[key].strip() for key in known if key not in ("date", "history")} == {
        key: text for key, text in known.items() if key not in ("date", "history")
    }
    assert repr(found).startswith("<saved moments of henon_heiles by stormer_verlet: q_1, q_2, p_1, p_2, energy, ")
    if ending != "csv":
        run.save(tmp_path / f"run.{ending}")
        saved = ss.load(str(tmp_path / f"run.{ending}"))
        for name in ("t", "q", "p", "path", "status", "failed_step"):
            np.testing.assert_array_equal(getattr(saved, name), getattr(run, name))
        assert saved.attributes()["scheme"] == "stormer_verlet"
        assert repr(saved) == ("<saved run of henon_heiles by stormer_verlet: 5 times, 2 degrees of freedom, 30 paths>")
    if pytest.importorskip("pandas"):
        assert found.to_pandas().equals(moments.to_pandas())
    pytest.importorskip("matplotlib")
    assert found.plot(of=["q_1"]).get_suptitle() == moments.plot(of=["q_1"]).get_suptitle()


def test_what_cannot_be_loaded(tmp_path):
    (tmp_path / "empty").mkdir()
    (tmp_path / "x.txt").touch()
    for name, words in {"none.nc": "does not exist", "empty": "holds no run", "x.txt": "no file of a run"}.items():
        with pytest.raises(ss.errors.InvalidArgumentError, match=words):
            ss.load(tmp_path / name)


def test_a_folder_is_loaded_as_it_is_opened(tmp_path):
    scene = tmp_path / "scene.toml"
    scene.write_text('[model]\nname = "kubo"\n[run]\nstep = 0.1\nsteps = 4\npaths = 20\nq0 = 1.0\np0 = 0.0\n')
    assert command_line.main(["run", str(scene), "--out", str(tmp_path / "out"), "--quiet"]) == 0
    assert repr(ss.load(tmp_path / "out")) == repr(ss.open_run(tmp_path / "out"))
