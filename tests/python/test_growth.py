# SPDX-License-Identifier: BSD-3-Clause
"""Runs that grow in their folder: the bits of one run of the whole, and no path-step taken twice without need."""

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import symsde as ss
from symsde.batch import execute
from symsde.batch.claims import Claims
from symsde.batch.folder import RunFolder
from symsde.cli import command_line

SCENE = """
[model]
{model}
[run]
step = 0.05
steps = {steps}
save_every = {every}
paths = {paths}
seed = 3
q0 = {{law = "normal", mean = 0.5, sd = 0.2}}
p0 = 0.0
[output]
paths = {saved}
{more}
"""
GIVEN = {"model": 'name = "kubo"', "steps": 20, "every": 10, "paths": 1024, "saved": "[0, 300, 900]", "more": ""}
HISTOGRAM = '[[observe]]\nname = "x"\nkind = "histogram"\nof = "q_1"\nlow = -3\nhigh = 3\n'


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with the run `out` of the scene, cut into shards of 256 paths."""
    monkeypatch.chdir(tmp_path)
    write()
    assert go() == 0
    return tmp_path / "out"


@pytest.fixture
def counted(monkeypatch):
    """Path-steps that shards of each kind take from now on."""
    taken = {"moments": 0, "simulate": 0}
    for name, where in (("moments", "moments_of"), ("simulate", "simulate")):
        function = getattr(execute, where)

        def call(*args, function=function, name=name, **options):
            found = function(*args, **options)
            if not found.report.stopped:  # as where the report of the whole is asked for
                taken[name] += found.report.counters["path_steps"]
            return found

        monkeypatch.setattr(execute, where, call)
    return taken


def write(**given):
    """Write the scene."""
    with open("scene.toml", "w", encoding="utf-8") as file:
        file.write(SCENE.format(**(GIVEN | given)))


def go(*arguments, out="out", size="256"):
    """Run the scene in a folder."""
    return command_line.main(["run", "scene.toml", "--out", out, "--shard-paths", size, "--quiet", *arguments])


def require_whole(folder, **given):
    """Require the results of one run of the whole, bit for bit, and the same shards but for their stamps."""
    write(**given)
    assert go(out="whole") == 0
    mine, theirs = ss.open_run(folder), ss.open_run("whole")
    assert not mine.missing
    for kind in ("mean", "var", "se_mean"):
        assert np.array_equal(mine.moments.table(kind), theirs.moments.table(kind), equal_nan=True)
    assert np.array_equal(mine.moments.n_ok, theirs.moments.n_ok)
    for name in ("t", "q", "p", "status", "last_q", "path"):
        assert np.array_equal(getattr(mine.run, name), getattr(theirs.run, name))
    for found in ("moments", "run"):
        mine_told, theirs_told = (getattr(x, found).report for x in (mine, theirs))
        assert mine_told.counters == theirs_told.counters and mine_told.warnings == theirs_told.warnings
    assert sorted(x.name for x in (folder / "shards").iterdir()) == sorted(
        x.name for x in (folder.parent / "whole" / "shards").iterdir()
    )


def test_more_paths(folder, counted):
    """Computes the new paths alone where shards are full, and the last shard again where it was not."""
    assert go("--paths", "2e3") == 0
    assert counted == {"moments": (2000 - 1024) * 20, "simulate": 0}
    assert ss.open_run(folder).moments.n_ok[0] == 2000
    assert go("--paths", "2000") == 0
    assert counted["moments"] == (2000 - 1024) * 20  # nothing is left to do
    assert go("--paths", "3000") == 0
    assert counted["moments"] == (3000 - 1024 + 2000 - 7 * 256) * 20  # 208 of the last 256 paths are taken again
    require_whole(folder, paths=3000)


def test_more_steps(folder, counted):
    """Takes saved paths on from their last states, and moments of all paths anew."""
    assert go("--steps", "50") == 0
    assert counted == {"moments": 1024 * 50, "simulate": 3 * 30}
    require_whole(folder, steps=50)


def test_more_of_both(folder, counted):
    """Grows twice, by paths and by steps and paths that are saved."""
    assert go("--paths", "1280") == 0
    write(saved='"all"', steps=40, paths=1536)
    assert go("--grow") == 0
    assert counted["simulate"] == 1536 * 40
    require_whole(folder, saved='"all"', steps=40, paths=1536)


def test_paths_and_then_an_observer(folder, counted):
    """Remembers of every earlier run what its shards are good for."""
    assert go("--paths", "1280") == 0
    write(paths=1280, more=HISTOGRAM)
    assert go("--grow") == 0
    assert counted == {"moments": (256 + 1280) * 20, "simulate": 0}
    require_whole(folder, paths=1280, more=HISTOGRAM)


def test_all_saved_paths_go_on(tmp_path, monkeypatch, counted):
    """Takes every saved path on, and adds new ones."""
    monkeypatch.chdir(tmp_path)
    write(saved='"all"', more="moments = false")
    assert go() == 0
    assert counted["simulate"] == 1024 * 20
    assert go("--steps", "30", "--paths", "1280") == 0
    assert counted["simulate"] == 1024 * 30 + 256 * 30
    found = ss.open_run("out").run
    law = ss.states.normal(0.5, 0.2)
    whole = ss.simulate(ss.models.kubo(), q0=law, p0=0.0, step=0.05, steps=30, save_every=10, paths=1280, seed=3)
    assert np.array_equal(found.q, whole.q) and np.array_equal(found.t, whole.t)


@pytest.mark.parametrize(
    ("given", "simulated"),
    [({"more": HISTOGRAM}, 0), ({"every": 5}, 3 * 20), ({"more": '[observables]\nr = "q**2 + p**2"\n'}, 0)],
    ids=["observer", "saves", "observable"],
)
def test_new_observers_and_saves(folder, counted, capfd, given, simulated):
    """Says that all paths are computed anew, refuses it without --grow, and does it with it."""
    write(**given)
    assert go() == command_line.BAD_INPUT
    assert "moments of all paths are computed anew" in capfd.readouterr().err
    assert command_line.main(["run", "scene.toml", "--out", "out", "--grow"]) == 0
    told = capfd.readouterr().err
    assert "grows by what it observes and saves: moments of all paths are computed anew" in told
    assert counted == {"moments": 1024 * 20, "simulate": simulated}
    require_whole(folder, **given)
    assert counted["moments"] == 2 * 1024 * 20


@pytest.mark.parametrize(
    "given", [{"more": HISTOGRAM}, {"every": 5}, {"steps": 30}], ids=["observer", "saves", "steps"]
)
def test_sizes_ask_for_sizes_alone(folder, capfd, given):
    """More paths on the command line let a folder grow by these, and by nothing else that the scene has changed."""
    write(**given)
    assert go("--paths", "1280") == command_line.BAD_INPUT
    assert "or give --grow, which adds what is more: moments of all paths are computed anew" in capfd.readouterr().err
    assert go("--paths", "1280", "--grow") == 0
    require_whole(folder, paths=1280, **given)


def in_another(*arguments):
    """Exit code and errors of the command line in another process, which loads the files as they are now."""
    command = [sys.executable, "-m", "symsde", *arguments, "--allow-python"]
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    return done.returncode, done.stderr


def test_observables_in_python(folder):
    """New functions, and functions that have changed, are new observables; the folder gets their files."""
    run = ("run", "scene.toml", "--quiet", "--out")
    Path("own.py").write_text("def far(q, p):\n    return 1.0 * (q[0] > 0.4)\n", encoding="utf-8")
    write(more='[observables]\nfar = {python = "own:far"}\n')
    assert in_another(*run, "out", "--grow") == (0, "")
    Path("own.py").write_text("def far(q, p):\n    return 1.0 * (q[0] > 0.2)\n", encoding="utf-8")
    assert in_another(*run, "out")[0] == command_line.BAD_INPUT
    assert in_another(*run, "out", "--grow") == (0, "")
    assert Path("out/own.py").read_bytes() == Path("own.py").read_bytes()
    assert in_another(*run, "whole", "--shard-paths", "256") == (0, "")
    rows = [
        [x for x in Path(f"{x}/moments.csv").read_text(encoding="utf-8").splitlines() if x[0] != "#"]
        for x in ("out", "whole")
    ]
    assert rows[0] == rows[1] and len(rows[0]) > 2
    assert in_another("plot", "out")[0] == 0


def test_another_model_in_python(tmp_path, monkeypatch):
    """A file that the model comes from may not change; another one may be added."""
    monkeypatch.chdir(tmp_path)
    run = ("run", "scene.toml", "--quiet", "--out")
    write(model='python = "made:kubo"')
    Path("made.py").write_text("import symsde as ss\n\n\ndef kubo():\n    return ss.models.kubo()\n", encoding="utf-8")
    assert in_another(*run, "made") == (0, "")
    Path("own.py").write_text("def far(q, p):\n    return 1.0 * (q[0] > 0.4)\n", encoding="utf-8")
    write(model='python = "made:kubo"', more='[observables]\nfar = {python = "own:far"}\n')
    assert in_another(*run, "made", "--grow") == (0, "")
    with Path("made.py").open("a", encoding="utf-8") as file:
        file.write("# a word\n")
    code, told = in_another(*run, "made", "--grow")
    assert code == command_line.BAD_INPUT and "python_sha256.made.py" in told


def test_refusals(folder, capfd):
    """Refuses to shrink, and runs that are others, with a sentence."""
    for arguments, word in (
        (("--paths", "960"), "never shrinks"),
        (("--steps", "10"), "never shrinks"),
        (("--paths", "x"), "whole number"),
        (("--paths", "0"), "whole number"),
        (("--steps", "25"), "multiple of save_every"),
    ):
        assert go(*arguments) == command_line.BAD_INPUT
        assert word in capfd.readouterr().err
    write(paths=2000)
    assert go() == command_line.BAD_INPUT
    assert (
        "or give --grow, which adds what is more: shards of the paths that are there are kept" in capfd.readouterr().err
    )
    with open("scene.toml", "a", encoding="utf-8") as file:
        file.write("[observables]\nr = 'q**2'\n")
    text = Path("scene.toml").read_text(encoding="utf-8")
    with open("scene.toml", "w", encoding="utf-8") as file:
        file.write(text.replace("seed = 3", "seed = 4"))
    assert go("--grow") == command_line.BAD_INPUT
    assert "seed = 3 there, 4 here" in capfd.readouterr().err
    assert go("--paths", "1024", "--grow") == command_line.BAD_INPUT


def test_killed_while_it_grew(folder, counted, monkeypatch):
    """Goes on after an end at any place: with the old manifest, with the new one, and between shards."""
    shutil.copytree(folder, "before")
    assert go("--steps", "40", "--paths", "1280") == 0
    shards = sorted(x.name for x in (folder / "shards").glob("*.npz"))
    for left in range(len(shards)):  # new manifest, and the first of the new shards
        shutil.rmtree("killed", ignore_errors=True)
        shutil.copytree("before", "killed")
        shutil.copy(folder / "manifest.json", "killed/manifest.json")
        for name in shards[:left]:
            shutil.copy(folder / "shards" / name, f"killed/shards/{name}")
        counted.update(moments=0, simulate=0)
        assert go("--steps", "40", "--paths", "1280", out="killed") == 0
        kept = sum(name.startswith("moments") for name in shards[:left])
        assert counted["moments"] == (5 - kept) * 256 * 40
        assert counted["simulate"] == 20 * (8 - max(left, 5))
        mine, theirs = ss.open_run("killed"), ss.open_run(folder)
        assert np.array_equal(mine.moments.mean_q, theirs.moments.mean_q) and np.array_equal(mine.run.q, theirs.run.q)
    require_whole(folder, steps=40, paths=1280)


def test_killed_before_its_scene_was_in_its_place(folder, monkeypatch):
    """A folder with the manifest of the run that grew is read with the scene of that run, and goes on."""
    Path("own.py").write_text("def far(q, p):\n    return 1.0 * (q[0] > 0.4)\n", encoding="utf-8")
    write(more='[observables]\nx = "q**2"\nfar = {python = "own:far"}\n')

    def killed(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(RunFolder, "_begin", killed)
        assert go("--grow", "--allow-python") == command_line.STOPPED
    (waiting,) = folder.glob(".grown-*")
    assert (waiting / "own.py").read_bytes() == Path("own.py").read_bytes()
    found = ss.open_run(folder)
    assert len(found.missing) == 4 and list(found.scene.observables) == ["x", "far"]
    assert go("--grow", "--allow-python") == 0
    assert not waiting.exists()
    found = ss.open_run(folder)
    assert not found.missing and (found.moments.mean["x"] > 0).all()


def test_dry_run_of_what_is_left(folder, capfd):
    """Counts the shards and the path-steps that a folder lacks."""

    def told(*arguments):
        assert command_line.main(["run", "scene.toml", "--out", "out", "--dry-run", *arguments]) == 0
        return capfd.readouterr().out

    before = sorted(x.name for x in folder.rglob("*"))
    capfd.readouterr()
    for arguments, steps, shards in (
        ((), "0\n", "0, of 256 paths at most, beside 7 that the folder holds"),
        (("--paths", "2000"), "1.952e+04\n", "4, of 256 paths at most, beside 7 that"),
        (("--steps", "40"), f"{1024 * 40 + 3 * 20:.4g}\n", "7, of 256 paths at most\n"),
        (("--steps", "40", "--shard", "1/7"), f"{256 * 40:.4g}\n", "1, of 256 paths at most\n"),
    ):
        found = told(*arguments)
        assert f"path-steps {steps}" in found and shards in found, arguments
    (folder / "shards" / "moments-000002.npz").unlink()
    assert "1, of 256 paths at most, beside 6 that" in told()
    assert sorted({*before} - {"moments-000002.npz"}) == sorted(x.name for x in folder.rglob("*"))
    assert go() == go("--keep-last") == 0


#: opens the folder `out` for the scene as it stands, grown or not, says so, and waits for a line
WORKER = """
import sys
from pathlib import Path
from symsde.batch import growth, manifest
from symsde.batch.folder import RunFolder
from symsde.batch.scene_pieces import Batch

batch = Batch.of("scene.toml", "out", None)
record = growth.record_of(manifest.read(Path("out")), batch.scene, batch.size, Path("out"), asked=True)
with RunFolder.open_to_write("out", record, batch.pieces, batch.scene) as folder:
    print(folder.path, flush=True)
    sys.stdin.readline()
"""


@pytest.mark.parametrize("keep", ["", "keep_last = true"], ids=["", "keep_last"])
def test_back_to_what_it_was(folder, counted, keep):
    """A folder whose growth was given up takes its own shards back, also those that were moved away."""
    write(more=keep)
    assert go(out="kept") == 0
    write(every=5, more=keep)
    with subprocess.Popen(
        [
            sys.executable,
            "-c",
            WORKER.replace('"out"', '"kept"').replace("as folder:", "as folder:\n    folder.missing()"),
        ],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    ) as other:
        other.communicate(b"\n")
    assert other.returncode == 0
    assert len(list(Path("kept/shards").glob("*.outgrown"))) == 7
    counted.update(moments=0, simulate=0)
    write(more=keep)
    assert go("--grow", out="kept") == 0
    assert counted == {"moments": 0 if keep else 1024 * 20, "simulate": 0}
    require_whole(folder.parent / "kept", more=keep)


def test_other_processes_work(folder, capfd):
    """Is refused while a process works in the folder, which then finds everything as it was; not beside one that has
    the same run."""
    before = {x: x.read_bytes() for x in folder.rglob("*") if x.is_file()}
    for paths, code in ((1024, command_line.BAD_INPUT), (2000, 0)):
        write(paths=paths)
        with subprocess.Popen([sys.executable, "-c", WORKER], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as other:
            assert other.stdout.readline()
            assert go("--paths", "2000") == code
            assert code == 0 or "another process works in" in capfd.readouterr().err
            assert code == 0 or before == {x: x.read_bytes() for x in folder.rglob("*") if x.is_file()}
            if code == 0:
                assert go("--paths", "3000") == command_line.BAD_INPUT
            other.communicate(b"\n")
        assert other.returncode == 0
    assert go("--paths", "3000") == 0
    require_whole(folder, paths=3000)


def test_other_processes_grow_it_first(folder, monkeypatch, capfd):
    """Leaves a folder as it is which another process has let grow since its manifest was read."""
    shutil.copytree(folder, "other")
    assert go("--paths", "1280", out="other") == 0
    theirs = Path("other/manifest.json").read_bytes()
    monkeypatch.setattr(Claims, "take_all", lambda self: (folder / "manifest.json").write_bytes(theirs) > 0)
    assert go("--paths", "2000") == command_line.BAD_INPUT
    assert "has let it grow" in capfd.readouterr().err
    assert (folder / "manifest.json").read_bytes() == theirs
    assert go("--paths", "1280") == 0


def test_parts_grow_and_merge(tmp_path, monkeypatch, capfd):
    """Merges parts that have grown to the bits of one run."""
    monkeypatch.chdir(tmp_path)
    write()
    for part in ("1/2", "2/2"):
        assert go("--shard", part, out=f"part-{part[0]}") == 0
    for part in ("1/2", "2/2"):
        assert go("--shard", part, "--paths", "2000", out=f"part-{part[0]}") == 0
    assert command_line.main(["merge", "part-1", "--out", "some", "--quiet"]) == command_line.BAD_INPUT
    asked = capfd.readouterr().err.partition("`symsde ")[2].partition("`")[0].split()
    assert "--paths=2000" in asked and command_line.main([*asked, "--quiet"]) == 0
    require_whole(tmp_path / "some", paths=2000)
    write()
    assert command_line.main(["merge", "part-1", "part-2", "--out", "out", "--quiet"]) == 0
    require_whole(tmp_path / "out", paths=2000)
