# SPDX-License-Identifier: BSD-3-Clause
"""Sweeps in folders: ranges and columns of files as parameters by path, and moments of every value."""

import csv

import numpy as np
import pytest
import symsde as ss
from symsde.cli import command_line

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
    """Require the moments of a run of every point alone, with its paths."""
    assert [tuple(point.values()) for point, _ in found] == points
    for i, ((_, mine), (k, s)) in enumerate(zip(found, points, strict=True)):
        observers = {"x": ss.observe.Histogram("q_1", -3, 3)}
        alone = ss.moments(
            model(k, s), paths=paths, first_path=i * paths, observables={"r": "q**2"}, observers=observers, **RUN
        )
        for kind in ("mean", "var", "se_mean"):
            assert np.array_equal(mine.table(kind), alone.table(kind))
        assert np.array_equal(mine.observed["x"].share, alone.observed["x"].share)


def test_ranges(tmp_path, monkeypatch):
    """Gives moments and observers of every combination, with the bits of its run alone, also from parts."""
    monkeypatch.chdir(tmp_path)
    write()
    for part in ("1/2", "2/2"):
        assert command_line.main(["run", "scene.toml", "--shard", part, "--out", f"part-{part[0]}", "--quiet"]) == 0
    assert command_line.main(["merge", "part-1", "part-2", "--out", "out", "--quiet"]) == 0
    points = [(k, s) for k in (1.0, 2.0) for s in np.linspace(0.1, 0.3, 3).tolist()]
    found = ss.open_run("out").by_value
    require(found, 512, points)
    lines = (tmp_path / "out" / "moments-by-value.csv").read_text().splitlines()
    rows = list(csv.DictReader(x for x in lines if not x.startswith("#")))
    assert [(float(x["k"]), float(x["s"])) for x in rows] == [point for point in points for _ in range(3)]
    assert [float(x["mean r"]) for x in rows] == np.concatenate([x.mean["r"] for _, x in found]).tolist()


def test_columns_of_files(tmp_path, monkeypatch):
    """Takes columns of a file row by row, which a folder keeps."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "values.csv").write_text("s,note,stiffness\n0.1,1,1.0\n0.3,1,2.5\n")
    write('{csv = "values.csv", column = "stiffness"}', '{csv = "values.csv"}', paths=512)
    assert command_line.main(["run", "scene.toml", "--out", "out", "--quiet"]) == 0
    (tmp_path / "values.csv").unlink()
    require(ss.open_run("out").by_value, 256, [(1.0, 0.1), (2.5, 0.3)])
    (tmp_path / "values.csv").write_text("s,note,stiffness\n0.1,1,1.0\n0.3,1,2.525\n")
    assert command_line.main(["run", "scene.toml", "--out", "out", "--quiet"]) == command_line.BAD_INPUT


def test_few_paths_are_told(tmp_path, monkeypatch, capfd):
    """Says why there are no moments by value if shards hold several values."""
    monkeypatch.chdir(tmp_path)
    write(paths=600)
    assert command_line.main(["run", "scene.toml", "--out", "out", "--quiet"]) == 0
    assert "give a multiple of 256 for each value" in capfd.readouterr().err
    assert not (tmp_path / "out" / "moments-by-value.csv").exists() and ss.open_run("out").by_value == []


@pytest.mark.parametrize(
    ("k", "word"),
    [
        ('{csv = "absent.csv"}', "absent.csv"),
        ('{csv = "values.csv"}', "no column k: its columns are s, x"),
        ('{csv = "values.csv", column = 3}', "give {csv"),
        ('{csv = "values.csv", colum = "s"}', "give {csv"),
        ('{csv = "bare.csv", column = "s"}', "no names of columns"),
        ("{from = 1, to = 2}", "give a number, a list"),
        ('{csv = "values.csv", column = "x"}', "columns of 2 and of 3 rows"),
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
