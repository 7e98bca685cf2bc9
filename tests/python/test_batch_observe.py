# SPDX-License-Identifier: BSD-3-Clause
"""Observers in scenes, shards and ensembles: the bits of one run for any division."""

import numpy as np
import pytest
import symsde as ss
from conftest import moments_of
from symsde.batch import manifest, scene
from symsde.cli import command_line
from symsde.run.observers import requests

SCENE = """
[model]
name = "henon_heiles"
sigma1 = 0.2
[run]
scheme = "midpoint"
step = 0.05
steps = 120
paths = 1500
first_path = 256
seed = 9
q0 = [0.45, 0.4]
p0 = [0.1, 0.0]
save_every = 40
[[observe]]
kind = "histogram"
name = "x"
of = "q_1"
low = -1
high = 1
bins = 20
[[observe]]
kind = "covariance"
of = ["q_1", "energy"]
[[observe]]
kind = "passage"
of = "q_2"
within = 0.9
absorb = false
[[observe]]
kind = "extremes"
of = "p_1"
[[observe]]
kind = "paths"
paths = [300, 1000]
"""  # some of these paths escape and fail
NAMES = ["x", "covariance", "passage", "extremes", "paths"]


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text(SCENE)
    return path


def same_kept(found, whole):
    assert list(found.kept) == list(whole.kept) == NAMES
    for name in NAMES:
        np.testing.assert_array_equal(found.kept[name].counts, whole.kept[name].counts, err_msg=name)
        np.testing.assert_array_equal(found.kept[name].sums, whole.kept[name].sums, err_msg=name)


def run(*arguments):
    return command_line.main(["run", *map(str, arguments), "--quiet"])


@pytest.mark.filterwarnings("ignore::symsde.PathsFailedWarning")
def test_any_division_keeps_the_same(file, tmp_path):
    whole = moments_of(scene.load(file))
    for size in (256, 1024, 4096):
        out = tmp_path / f"out{size}"
        assert run(file, "--out", out, "--shard-paths", size) == command_line.PATHS_FAILED
        same_kept(ss.open_run(out).moments, whole)
    data = pytest.importorskip("xarray").open_dataset(out / "moments.nc")
    np.testing.assert_array_equal(data["x_count"], whole.observed["x"].counts)
    np.testing.assert_array_equal(data["covariance_se_covariance"], whole.observed["covariance"].se_covariance)
    assert data["covariance_value"].values.tolist() == ["q_1", "energy"]
    data.close()


@pytest.mark.filterwarnings("ignore::symsde.PathsFailedWarning")
def test_parts_on_their_own_merge(file, tmp_path):
    whole = moments_of(scene.load(file))
    parts = [tmp_path / f"part{i}" for i in (1, 2, 3)]
    for i, part in enumerate(parts):
        run(file, "--shard", f"{i + 1}/3", "--out", part, "--shard-paths", 256)
    assert (
        command_line.main(["merge", *map(str, parts), "--out", str(tmp_path / "whole"), "--quiet"])
        == command_line.PATHS_FAILED
    )
    same_kept(ss.open_run(tmp_path / "whole").moments, whole)


@pytest.mark.filterwarnings("ignore::symsde.PathsFailedWarning")
def test_ensembles(file):
    loaded = scene.load(file)
    whole = moments_of(loaded)
    found = ss.ensemble(loaded.model, observers=loaded.observers, shard_paths=256, **loaded.run)
    same_kept(found, whole)
    np.testing.assert_array_equal(found.observed["x"].share, whole.observed["x"].share)


def test_other_observers_are_another_run(file, tmp_path, capsys):
    assert run(file, "--out", tmp_path / "out") == command_line.PATHS_FAILED
    file.write_text(SCENE.replace("within = 0.9", "within = 0.8"))
    assert run(file, "--out", tmp_path / "out") == command_line.BAD_INPUT
    assert "holds another run" in capsys.readouterr().err
    plain = SCENE.split("[[observe]]", maxsplit=1)[0]
    file.write_text(plain)
    assert "observe" not in manifest.of_scene(scene.load(file), 256)["inputs"]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (('of = "q_2"', 'of = "q_3"'), "[[observe]]: passage of 'q_3': there is no such value"),
        (('kind = "extremes"', 'kind = "extreme"'), "kind = 'extreme' does not exist: there are extremes"),
        (("within = 0.9", "wthin = 0.9"), "'wthin' is no key of passage: there are within"),
        (("high = 1", ""), "the observer 'x' lacks high"),
        (("bins = 20", "bins = 0"), "bins = 0 is out of range"),
        (('name = "x"', 'name = "passage"'), "two observers of the name 'passage'"),
        (("[[observe]]\nkind", "[observe]\nkind"), "is not TOML"),
        (("[[observe]]", "[output]\nmoments = false\n[[observe]]"), "goes with moments"),
    ],
)
def test_bad_tables_are_refused(change, said, file, capsys):
    file.write_text(SCENE.replace(*change, 1))
    assert command_line.main(["check", str(file)]) == command_line.BAD_INPUT
    assert said in capsys.readouterr().err


def test_a_single_table_is_refused(file, capsys):
    file.write_text(SCENE.split("[[observe]]", maxsplit=1)[0] + '[observe]\nkind = "extremes"\nof = "q_1"\n')
    assert command_line.main(["check", str(file)]) == command_line.BAD_INPUT
    assert "as a table [[observe]]" in capsys.readouterr().err


def test_dry_runs_count_observers(file, tmp_path, capsys):
    assert command_line.main(["run", str(file), "--dry-run", "--out", str(tmp_path / "out")]) == command_line.OK
    assert "shards" in capsys.readouterr().out


def test_observers_by_name():
    assert set(requests.KINDS) == {"histogram", "quantiles", "covariance", "autocorrelation", "extremes",
                                           "passage", "paths"}  # fmt: skip
