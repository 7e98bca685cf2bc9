# SPDX-License-Identifier: BSD-3-Clause
"""Sweeps in folders: ranges and columns of files as parameters by path, and moments of every value."""

import csv

import numpy as np
import pytest
import symsde as ss
from symsde.cli import command_line

pytestmark = pytest.mark.optimised

SCENE = """
[model]
H = "p**2/2 + k*q**2/2"
noise = ["s*q"]
[model.params]
k = {k}
s = {s}
[run]
step = 0.1
steps = 20
save_every = 10
paths = {paths}
seed = 3
q0 = 1.0
p0 = 0.0
[observables]
r = "q**2"
[[observe]]
name = "x"
kind = "histogram"
of = "q_1"
low = -3
high = 3
"""
RUN = {"q0": 1.0, "p0": 0.0, "step": 0.1, "steps": 20, "save_every": 10, "seed": 3}
H, NOISE = "p**2/2 + k*q**2/2", ["s*q"]


def model(k, s):
    """The model of some paths."""
    return ss.model_from_sympy(H, noise=NOISE, params={"k": np.array([k]), "s": np.array([s])})


def write(k="{from = 1, to = 2, count = 2}", s="{from = 0.1, to = 0.3, count = 3}", paths=6 * 512):
    """Write the scene."""
    with open("scene.toml", "w", encoding="utf-8") as file:
        file.write(SCENE.format(k=k, s=s, paths=paths))


def require(found, paths, points):
    """Require the moments and the observer of a run of every point alone, with its paths."""
    assert [tuple(point.values()) for point in found.points()] == points
    flat = {kind: found.table(kind).reshape(4, 3, -1) for kind in ("mean", "var", "se_mean")}
    for i, (k, s) in enumerate(points):
        observers = {"x": ss.observe.Histogram("q_1", -3, 3)}
        alone = ss.moments(
            model(k, s), paths=paths, first_path=i * paths, observables={"r": "q**2"}, observers=observers, **RUN
        )
        for kind, table in flat.items():
            assert np.array_equal(table[:, :, i], alone.table(kind).T)
        assert np.array_equal(found.observed["x"][i].share, alone.observed["x"].share)


def test_ranges(tmp_path, monkeypatch):
    """Gives moments and observers of every combination, with the bits of its run alone, also from parts."""
    monkeypatch.chdir(tmp_path)
    write()
    for part in ("1/2", "2/2"):
        args = ["run", "scene.toml", "--shard", part, "--shard-paths", "1024", "--out", f"part-{part[0]}", "--quiet"]
        assert command_line.main(args) == 0
    assert command_line.main(["merge", "part-1", "part-2", "--out", "out", "--quiet"]) == 0
    points = [(k, s) for k in (1.0, 2.0) for s in np.linspace(0.1, 0.3, 3).tolist()]
    moments = ss.open_run("out").moments
    found = moments.by_group
    assert found.dims == ("k", "s") and found.mean_q.shape == (3, 1, 2, 3) and found.mean["r"].shape == (3, 2, 3)
    require(found, 512, points)
    lines = (tmp_path / "out" / "moments-by-value.csv").read_text().splitlines()
    rows = list(csv.DictReader(x for x in lines if not x.startswith("#")))
    assert [(float(x["k"]), float(x["s"])) for x in rows] == points * 3
    assert [float(x["mean r"]) for x in rows] == found.mean["r"].ravel().tolist()
    for suffix in ("nc", "npz"):
        moments.save(f"all.{suffix}")
        filed = ss.load(f"all.{suffix}")
        assert np.array_equal(filed.by_group.mean_q, found.mean_q) and filed.by_group.dims == found.dims
        shares = np.array([x.share for x in found.observed["x"]]).reshape(2, 3, 3, -1)
        assert np.array_equal(filed.variables["group_x_share"], shares)


def test_columns_of_files(tmp_path, monkeypatch):
    """Takes columns of a file row by row, which a folder keeps."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "values.csv").write_text("s,note,stiffness\n0.1,1,1.0\n0.3,1,2.5\n")
    write('{csv = "values.csv", column = "stiffness"}', '{csv = "values.csv"}', paths=512)
    assert command_line.main(["run", "scene.toml", "--out", "out", "--quiet"]) == 0
    (tmp_path / "values.csv").unlink()
    found = ss.open_run("out").moments.by_group
    assert found.dims == ("value",)
    require(found, 256, [(1.0, 0.1), (2.5, 0.3)])
    (tmp_path / "values.csv").write_text("s,note,stiffness\n0.1,1,1.0\n0.3,1,2.525\n")
    assert command_line.main(["run", "scene.toml", "--out", "out", "--quiet"]) == command_line.BAD_INPUT


def test_lists(tmp_path, monkeypatch):
    """Takes lists row by row, beside columns of files, each row for as many paths."""
    monkeypatch.chdir(tmp_path)
    write("[1.0, 2.5]", "[0.1, 0.3]", paths=512)
    assert command_line.main(["run", "scene.toml", "--out", "out", "--quiet"]) == 0
    found = ss.open_run("out").moments.by_group
    assert found.dims == ("value",)
    require(found, 256, [(1.0, 0.1), (2.5, 0.3)])
    (tmp_path / "values.csv").write_text("s\n0.1\n0.3\n")
    write("[1, 2.5]", '{csv = "values.csv"}', paths=512)
    assert command_line.main(["run", "scene.toml", "--out", "beside", "--quiet"]) == 0
    assert np.array_equal(ss.open_run("beside").moments.by_group.mean_q, found.mean_q)


def test_lists_of_paths(tmp_path, monkeypatch):
    """A list with a number for each path goes path by path; values that are repeated have moments of their own."""
    monkeypatch.chdir(tmp_path)
    k = np.where(np.arange(512) < 256, 1.0, 2.5)
    write(str(k.tolist()), "0.1", paths=512)
    assert command_line.main(["run", "scene.toml", "--out", "out", "--quiet"]) == 0
    found = ss.open_run("out").moments.by_group
    assert found.dims == ("k",)
    observers = {"x": ss.observe.Histogram("q_1", -3, 3)}
    every = ss.model_from_sympy(H, noise=NOISE, params={"k": k, "s": 0.1})
    one = ss.moments(every, paths=512, groups="k", observables={"r": "q**2"}, observers=observers, **RUN)
    assert np.array_equal(found.mean_q, one.by_group.mean_q)
    write(str(np.linspace(1.0, 2.0, 512).tolist()), "0.1", paths=512)
    assert command_line.main(["run", "scene.toml", "--out", "each", "--quiet"]) == 0
    moments = ss.open_run("each").moments
    assert moments.by_group is None and not (tmp_path / "each" / "moments-by-value.csv").exists()
    each = ss.model_from_sympy(H, noise=NOISE, params={"k": np.linspace(1.0, 2.0, 512), "s": 0.1})
    assert np.array_equal(moments.mean_q, ss.moments(each, paths=512, observables={"r": "q**2"}, **RUN).mean_q)


def test_few_paths_of_a_value(tmp_path, monkeypatch):
    """Gives moments by value where shards hold paths of several values, and values have paths in several shards."""
    monkeypatch.chdir(tmp_path)
    write(paths=1200)
    assert command_line.main(["run", "scene.toml", "--out", "out", "--shard-paths", "256", "--quiet"]) == 0
    folder = ss.open_run("out")
    found = folder.moments.by_group
    k, s = (np.repeat(x, 200) for x in (np.repeat([1.0, 2.0], 3), np.tile(np.linspace(0.1, 0.3, 3), 2)))
    every = ss.model_from_sympy(H, noise=NOISE, params={"k": k, "s": s})
    observers = {"x": ss.observe.Histogram("q_1", -3, 3)}
    one = ss.moments(
        every, paths=1200, groups=["k", "s"], observables={"r": "q**2"}, observers=observers, **RUN
    ).by_group
    assert one.dims == found.dims and len(folder._batch.of_kind("moments")) == 5
    for kind in ("mean", "var", "se_mean"):
        assert np.array_equal(found.table(kind), one.table(kind))
    for mine, theirs in zip(found.observed["x"], one.observed["x"], strict=True):
        assert np.array_equal(mine.counts, theirs.counts)
    run = ss.simulate(every, paths=1200, **RUN)
    np.testing.assert_allclose(found.mean_q[:, 0], run.q[:, 0].reshape(3, 2, 3, 200).mean(3), rtol=1e-12)


def test_unfinished(tmp_path, monkeypatch):
    """Leaves out values none of whose paths have been run: no numbers, no results of observers."""
    monkeypatch.chdir(tmp_path)
    write(paths=1200)
    args = ["run", "scene.toml", "--out", "out", "--shard-paths", "256", "--quiet", "--shard", "1/5"]
    assert command_line.main(args) == 0
    found = ss.open_run("out").moments.by_group
    assert found.n_ok[-1].ravel().tolist() == [200, 56, 0, 0, 0, 0]
    assert np.isnan(found.mean_q[..., 1, :]).all() and found.observed["x"][2] is None
    assert np.isnan(found.to_xarray()["x_share"].to_numpy()[1]).all()


@pytest.mark.parametrize(
    ("k", "word"),
    [
        ('{csv = "absent.csv"}', "absent.csv"),
        ('{csv = "values.csv"}', "no column k: its columns are s, x"),
        ('{csv = "values.csv", column = 3}', "give {csv"),
        ('{csv = "values.csv", colum = "s"}', "give {csv"),
        ('{csv = "bare.csv", column = "s"}', "no names of columns"),
        ("{from = 1, to = 2}", "give a number, a list"),
        ('{csv = "values.csv", column = "x"}', "k, s have 2 and 3 values"),
        ("[1.0, 2.0]", "k, s have 2 and 3 values"),
        ("[1.0, 2.0, 3.0, 4.0, 5.0]", "k, s have 3 and 5 values"),
    ],
)
def test_refusals(k, word, tmp_path, monkeypatch, capfd):
    """Refuses values with a sentence."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "values.csv").write_text("s,x\n0.1,1\n0.2,1\n")
    (tmp_path / "three.csv").write_text("s\n0.1\n0.2\n0.3\n")
    (tmp_path / "bare.csv").write_text("0.1,1\n")
    write(k, '{csv = "three.csv"}')
    assert command_line.main(["check", "scene.toml"]) == command_line.BAD_INPUT
    assert word in capfd.readouterr().err


@pytest.mark.parametrize("paths", [12, 4])  # 4: as many values as sites
def test_ranges_of_sums_over_sites_are_refused(paths, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scene.toml").write_text(
        '[model]\nH = "Sum(p[i]**2/2 + k*q[i]**2/2, i)"\nnoise = "0.1*q[k]"\nn = 4\n[model.params]\n'
        f"k = {{from = 1, to = 2, count = 2}}\n[run]\nstep = 0.1\nsteps = 2\npaths = {paths}\nq0 = 1.0\np0 = 0.0\n"
    )
    assert command_line.main(["check", "scene.toml"]) == command_line.BAD_INPUT
    told = capfd.readouterr().err
    assert "k = {'from': 1, 'to': 2, 'count': 2}: parameters of sums over sites are the same for all paths" in told
