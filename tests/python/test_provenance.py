# SPDX-License-Identifier: BSD-3-Clause
"""Every table and file of a run records its origin: model, options, scene, version, date, command, paths."""

import hashlib
import json

import numpy as np
import pytest
import symsde as ss
from conftest import told
from symsde.cli import command_line
from symsde.run import provenance

SCENE = """\
# a comment with # signs, "quotes" and a µ

[model]
H = "p**2/2 + k*q**2/2"
noise = ["s*q"]
[model.params]
k = 1.5
s = 0.1
[run]
step = 0.1
steps = 20
paths = 300
first_path = 256
seed = 77
q0 = 1.0
p0 = [0.25]
save_every = 10
[output]
paths = [300, 301]
[[observe]]
kind = "histogram"
of = "q_1"
low = -2
high = 2
bins = 4
"""


def attributes_of(path):
    """Attributes of a .nc or .npz file, or of the # lines of a table."""
    if path.suffix == ".csv":
        return told(path)
    if path.suffix == ".npz":
        with np.load(path) as data:
            return json.loads(str(data["attributes"]))
    with pytest.importorskip("xarray").open_dataset(path) as data:
        return dict(data.attrs)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A run of a scene by the command line, with its error check."""
    place = tmp_path_factory.mktemp("run")
    (place / "scene.toml").write_text(SCENE, encoding="utf-8")
    with pytest.MonkeyPatch.context() as change:
        change.setenv("SOURCE_DATE_EPOCH", "86400")
        change.setattr("sys.argv", ["/somewhere/symsde", "run", "a scene.toml", "--quiet"])
        given = ["run", str(place / "scene.toml"), "--out", str(place / "out"), "--error-check", "--quiet"]
        assert command_line.main(given) == 0
        for ending in ("npz", "csv"):
            ss.open_run(place / "out").moments.save(place / "out" / f"again.{ending}")
    return place / "out"


FILES = {"moments.csv": 300, "moments.nc": 300, "run.nc": 2, "error-check.csv": 300, "again.npz": 300, "again.csv": 300}


@pytest.mark.parametrize(("name", "paths"), FILES.items())
def test_every_file_tells_what_made_it(name, paths, folder):
    if name.endswith(".nc"):
        pytest.importorskip("netCDF4")
    given = attributes_of(folder / name)
    assert given["paths_asked"] == given["paths_ok"] == str(paths)
    assert (given["seed"], given["model"], given["scheme"]) == ("77", "formula", "midpoint")
    assert json.loads(given["parameters"]) == {"k": 1.5, "s": 0.1}
    assert json.loads(given["hamiltonians"]) == ["p**2/2 + k*q**2/2", "s*q"]
    assert json.loads(given["q0"]) == [1.0] and json.loads(given["p0"]) == [0.25]
    options = json.loads(given["options"])
    assert (options["step"], options["steps"], options["save_every"], options["seed"]) == (0.1, 20, 10, 77)
    assert given["scene"].strip() == SCENE.strip()
    assert given["date"] == "1970-01-02T00:00:00+00:00"
    assert given["command"] == "symsde run 'a scene.toml' --quiet"
    assert given["history"] == f"{given['date']} {given['command']}"
    assert given["symsde_version"] == ss.__version__ and given["source"] == f"symsde {ss.__version__}"
    for key, value in ss.build_info().items():  # compiler, options, and version of the counter map
        assert given[f"symsde_{key.replace(' ', '_')}"] == value != ""
    assert "counter map of the noise" in ss.build_info() and "compiler" in ss.build_info()


def test_observers_are_told(folder):
    given = json.loads(attributes_of(folder / "moments.csv")["observers"])
    assert given == {"histogram": {"kind": "histogram", "of": "q_1", "low": -2, "high": 2, "bins": 4}}


def test_failed_paths_are_not_ok(tmp_path):
    """Two of 40 paths begin where they escape."""
    q0 = np.full((2, 40), 0.1)
    q0[:, [3, 7]] = 20.0
    run = {"q0": q0, "p0": 0.0, "step": 0.1, "steps": 60, "paths": 40, "scheme": "stormer_verlet"}
    for name, compute in (("run.npz", ss.simulate), ("moments.csv", ss.moments)):
        with pytest.warns(ss.PathsFailedWarning):
            compute(ss.models.henon_heiles(), **run).save(tmp_path / name)
        given = attributes_of(tmp_path / name)
        assert (given["paths_asked"], given["paths_ok"]) == ("40", "38")
        digest = hashlib.sha256(q0.tobytes()).hexdigest()
        assert given["q0"] == f"sha256 {digest} of 2 x 40 numbers"  # there are too many numbers to write in full
        assert "scene" not in given


@pytest.mark.parametrize("epoch", ["", "soon", "-5", "9" * 30])
def test_an_unusable_epoch_is_the_time_of_now(epoch, monkeypatch, tmp_path):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", epoch)
    ss.simulate(ss.models.kubo(), q0=1.0, p0=0.0, step=0.1, steps=1).save(tmp_path / "x.npz")
    assert attributes_of(tmp_path / "x.npz")["date"] > "2024"


def test_a_table_can_be_read_by_what_people_use(folder):
    pandas = pytest.importorskip("pandas")
    found = pandas.read_csv(folder / "moments.csv", comment="#")
    known = ss.open_run(folder).moments
    np.testing.assert_array_equal(found["mean q_1"], known.mean_q[:, 0])
    assert list(found.columns[:3]) == ["t", "n_ok", "mean q_1"]


def test_a_command_can_be_typed(monkeypatch):
    """The recorded command is `symsde` or `python -m symsde`, not the file that Python ran."""
    for argv, command in (
        (["/usr/bin/symsde", "run", "a b.toml"], "symsde run 'a b.toml'"),
        (["/somewhere/symsde/__main__.py", "run", "a.toml"], "python -m symsde run a.toml"),
    ):
        monkeypatch.setattr("sys.argv", argv)
        assert provenance.made()["command"] == command
