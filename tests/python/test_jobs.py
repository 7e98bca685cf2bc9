# SPDX-License-Identifier: BSD-3-Clause
"""Work of other processes: job arrays as scripts, and ensembles that go on when a process is lost."""

import multiprocessing
import os
import subprocess
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

import numpy as np
import pytest
import symsde as ss
from symsde.cli import advise_command, command_line, slurm_command

SCENE = """
[model]
name = "synchrotron"
[run]
step = 0.1
steps = 20
save_every = 10
paths = 2000
seed = 3
q0 = 0.5
p0 = 0.0
"""
SCRIPTS = {slurm_command.PARTS, slurm_command.MERGE, slurm_command.ENVIRONMENT, slurm_command.SUBMIT}


def sh(script, folder, **variables):
    """Run a script as a node would, without Slurm."""
    return subprocess.run(
        ["sh", str(folder / script)], cwd="/", env={**os.environ, **variables}, capture_output=True, text=True,
        check=False,
    )  # fmt: skip


def written(tmp_path, *more, out="jobs of one"):
    """A scene in a folder with a space in its name, and the folder of its scripts."""
    scene = tmp_path / "my scene.toml"
    scene.write_text(SCENE)
    code = command_line.main(["slurm", str(scene), "--out", str(tmp_path / out), *more])
    return code, tmp_path / out, scene


def test_every_task_of_the_array_runs_and_the_merge_has_the_bits_of_one_run(tmp_path, capsys):
    code, folder, scene = written(tmp_path, "--parts", "5", "--time", "1-12", "--cpus", "2")
    assert code == 0 and {path.name for path in folder.iterdir()} == SCRIPTS
    assert "5 parts of at least 256 paths a shard" in capsys.readouterr().out
    for name in SCRIPTS:
        assert not subprocess.run(["bash", "-n", folder / name], capture_output=True, check=True).stderr
    text = (folder / slurm_command.PARTS).read_text()
    for told in ("--array=1-5", "--cpus-per-task=2", "--time=1-12:00:00", "--job-name=jobs_of_one"):
        assert f"\n#SBATCH {told}\n" in text
    for i in (5, 1, 2, 3, 4):
        ended = sh(slurm_command.PARTS, folder, SLURM_ARRAY_TASK_ID=str(i), SLURM_CPUS_PER_TASK="2")
        assert ended.returncode == 0 and (folder / f"part-{i}" / "shards").is_dir(), ended.stderr
    assert sh(slurm_command.MERGE, folder).returncode == 0
    whole = tmp_path / "whole"
    assert command_line.main(["run", str(scene), "--out", str(whole), "--quiet", "--shard-paths", "256"]) == 0
    one, other = (ss.load(place / "moments.csv") for place in (folder / "whole", whole))
    np.testing.assert_array_equal(one.table("mean"), other.table("mean"))
    np.testing.assert_array_equal(one.table("se_mean"), other.table("se_mean"))


def test_the_environment_is_the_users(tmp_path):
    """Scripts are written again, but not over lines added by the user for a cluster."""
    _, folder, _ = written(tmp_path, "--parts", "2")
    mine = folder / slurm_command.ENVIRONMENT
    mine.write_text(text := mine.read_text() + "module load gcc\n")
    assert written(tmp_path, "--parts", "3")[0] == 0 and mine.read_text() == text
    assert "--array=1-3" in (folder / slurm_command.PARTS).read_text()


def test_both_jobs_are_submitted_and_the_merge_waits(tmp_path, monkeypatch):
    """A command named sbatch records how it was called."""
    _, folder, _ = written(tmp_path, "--parts", "2")
    fake = tmp_path / "bin" / "sbatch"
    fake.parent.mkdir()
    fake.write_text(f'#!/bin/sh\necho "$PWD $*" >> "{tmp_path}/called"\necho "17;here"\n')
    fake.chmod(0o755)
    monkeypatch.setenv("PATH", f"{fake.parent}:{os.environ['PATH']}")
    assert sh(slurm_command.SUBMIT, folder).returncode == 0
    first, second = (tmp_path / "called").read_text().splitlines()
    assert first == f"{folder} --parsable {slurm_command.PARTS}"
    assert second == f"{folder} --dependency=afterany:17 {slurm_command.MERGE}"


def test_scripts_are_refused_where_they_would_not_work(tmp_path, capsys):
    for more, told in (
        (["--parts", "9"], "--parts = 9 are more than the 8 shards that the run can be cut into: give 8 at most"),
        (["--parts", "0"], "--parts = 0 is out of range: give an integer from 1"),
        (["--time", "soon"], "--time = 'soon' is no time"),
        (["--cpus", "-1"], "--cpus = -1 is out of range"),
    ):
        code, folder, _ = written(tmp_path, *more)
        assert code == command_line.BAD_INPUT and told in capsys.readouterr().err and not folder.exists()
    (tmp_path / "begun" / "part-1").mkdir(parents=True)
    assert written(tmp_path, out="begun")[0] == command_line.BAD_INPUT
    assert "holds part-1, so a run was begun there" in capsys.readouterr().err


def deadly(q, p):
    """An observable that ends its process once, when two shards are done."""
    mark, shards = Path(os.environ["MARK"]), Path(os.environ["SHARDS"])
    if multiprocessing.parent_process() and mark.exists() and len(list(shards.glob("*.npz"))) >= 2:
        mark.unlink()
        os._exit(9)
    return q[0] * p[0]


RUN = {"q0": [[0.5]], "p0": 0.0, "step": 0.1, "steps": 20, "save_every": 10, "paths": 2000, "seed": 3}
SEEN = {"observers": {"x": ss.observe.Histogram("q_1", -2.0, 2.0, 8)}}
MODEL = ss.models.synchrotron()


def test_an_ensemble_goes_on_when_a_process_was_lost(tmp_path, monkeypatch):
    """The ensemble goes on from the shards in its folder, which are not computed again; the bits are those of one
    run.
    """
    out = tmp_path / "kept"
    monkeypatch.setenv("MARK", str(tmp_path / "mark"))
    monkeypatch.setenv("SHARDS", str(out / "shards"))
    given = {**RUN, **SEEN, "observables": {"qp": deadly}, "shard_paths": 256, "out": out}
    (tmp_path / "mark").touch()
    with ProcessPoolExecutor(1) as pool, pytest.raises(BrokenProcessPool) as lost:
        ss.ensemble(MODEL, executor=pool, **given)
    assert not (tmp_path / "mark").exists() and lost.value.partial.n_ok[0] < 2000
    first = {path.name: path.stat().st_ino for path in (out / "shards").glob("*.npz")}
    assert 2 <= len(first) < 8 and lost.value.partial.n_ok[0] == 256 * len(first)
    told = []
    found = ss.ensemble(MODEL, **given, progress=lambda done, _total: bool(told.append(done)))
    assert min(told) >= 256 * 20 * len(first)
    assert {name: (out / "shards" / name).stat().st_ino for name in first} == first
    again = ss.ensemble(MODEL, **given)
    known = ss.moments(MODEL, **RUN, **SEEN, observables={"qp": deadly})
    for one in (found, again):
        for kind in ("mean", "var", "se_mean"):
            np.testing.assert_array_equal(one.table(kind), known.table(kind))
        np.testing.assert_array_equal(one.observed["x"].counts, known.observed["x"].counts)
        assert one.report.stopped == 0


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"q0": [[0.6]]}, "arrays.q0"),
        ({"seed": 4}, "seed = 3 there, 4 here"),
        ({"steps": 40}, "steps = 20 there, 40 here"),
        ({"observers": {"x": ss.observe.Histogram("q_1", -2.0, 2.0, 9)}}, "bins = 8 there, 9 here"),
        ({"observables": {"r": "q_1**2"}}, "r = nothing there, 'q_1**2' here"),
        ({"shard_paths": 512}, "shard_paths = 256 there, 512 here"),
        ({"model": ss.models.synchrotron(omega=3.0)}, "omega = 2.0 there, 3.0 here"),
    ],
)
def test_the_folder_of_another_ensemble_is_refused(change, told, tmp_path):
    given = {"model": MODEL, **RUN, **SEEN, "shard_paths": 256, "out": tmp_path / "kept"}
    ss.ensemble(**given)
    with pytest.raises(ss.errors.SceneError, match="holds another run") as refused:
        ss.ensemble(**{**given, **change})
    assert told in str(refused.value)


def test_the_folder_of_an_ensemble_is_no_folder_of_a_scene(tmp_path):
    ss.ensemble(MODEL, **RUN, shard_paths=1024, out=tmp_path / "kept", threads=1)
    ss.ensemble(MODEL, **RUN, shard_paths=1024, out=tmp_path / "kept", threads=2)
    with pytest.raises(ss.errors.SceneError, match="holds the shards of an ensemble: the call of"):
        ss.open_run(tmp_path / "kept")


def test_a_client_of_dask_is_told_what_to_give():
    class Client:
        def submit(self):
            """Like Dask's executor, whose futures are of another type."""

        def get_executor(self):
            """Return the executor."""

    with pytest.raises(ss.errors.WrongTypeError, match=r"is a client of Dask.*give client\.get_executor\(\)"):
        ss.ensemble(MODEL, **RUN, executor=Client())


def test_advice_for_a_scene_is_that_of_its_call(tmp_path, capsys, monkeypatch):
    """Advice for a scene asks the same question as a call; the fastest scheme is measured anew in each."""
    asked = []

    def recorded(model, **given):
        asked.append((model, given))
        return ss.advise(model, **given)

    monkeypatch.setattr(advise_command, "advise", recorded)
    scene = tmp_path / "scene.toml"
    scene.write_text(SCENE)
    assert command_line.main(["advise", str(scene), "--tolerance", "0.01"]) == 0
    said = capsys.readouterr().out
    ((model, given),) = asked
    assert (model.name, model.parameters) == (MODEL.name, MODEL.parameters) and "- pilot on " in said
    wanted = {"q0": 0.5, "p0": 0.0, "horizon": 2.0, "seed": 3, "tolerance": 0.01}
    assert {key: np.asarray(given[key]).item() for key in wanted} == wanted
    assert said.split(",")[0] in ss.schemes.names()
    for more, told in ((["--want", "path"], "want = 'path'"), (["--horizon", "-1"], "horizon = -1")):
        assert command_line.main(["advise", str(scene), "--tolerance", "0.01", *more]) == command_line.BAD_INPUT
        assert told in capsys.readouterr().err


def test_advice_tells_of_its_progress_and_can_be_stopped():
    given = {"q0": 0.5, "p0": 0.0, "horizon": 2.0, "tolerance": 0.01}
    told = []
    ss.advise(MODEL, **given, progress=lambda *seen: bool(told.append(seen)))
    done = [done for done, _ in told]
    assert done[0] == 0 and done == sorted(set(done)) and told[-1][0] == told[-1][1] > 1
    one = ss.advise(MODEL, **given, progress=lambda done, _total: done > 0)
    assert not one.alternatives and "the progress function ended the search; not measured: " in one.reasons[-1]
    with pytest.raises(ss.errors.NumericalError, match="stopped before a scheme was tried"):
        ss.advise(MODEL, **given, progress=lambda *_: True)


@pytest.mark.parametrize(("step", "verdict"), [(0.1, "stable"), (1.2, "too long")])
def test_stability_of_a_scene(step, verdict, tmp_path, capsys):
    """omega = 2 near the minimum of the potential, where stormer_verlet is stable up to omega h = 2."""
    scene = tmp_path / "scene.toml"
    scene.write_text(SCENE.replace("step = 0.1\n", f'step = {step}\nscheme = "stormer_verlet"\n'))
    assert command_line.main(["stability", str(scene)]) == 0
    lines = {line.split()[0]: line.split(maxsplit=3) for line in capsys.readouterr().out.splitlines()[3:-1]}
    assert lines["stormer_verlet"][1:] == ["2", "1", verdict] and lines["midpoint"][1:] == ["every", "every", "stable"]
    assert lines["gauss_dkdkd"][3] == "stable"
    assert command_line.main(["stability", str(scene), "--quick"]) == command_line.BAD_INPUT
    assert "--quick is for the cases of symsde: leave it out beside a scene" in capsys.readouterr().err
