# SPDX-License-Identifier: BSD-3-Clause
"""Files that are written under temporary names: two writers never use one name, and the next writer removes files left
by a killed one."""

import os
import signal
import subprocess
import sys
import threading

import pytest
import symsde as ss
from sent_at import words
from symsde.cli import command_line
from symsde.native import files, parts

LEFT = """
import os, signal, sys
from pathlib import Path
from symsde.native import files as _files
def die(*_):
    os.kill(os.getpid(), signal.SIGKILL)
folder = Path(sys.argv[1])
if sys.argv[2] == "durable":
    os.fsync = die
    _files.write_durably(folder / "name", b"half")
_files.replace(folder / "name", lambda part: (part.write_text("half"), die()))
"""


def test_a_writer_inside_another_of_the_same_target(tmp_path):
    """Two writers in one process and thread, which no number of the system distinguishes."""
    target = tmp_path / "moments.csv"

    def outer(part):
        part.write_text("outer")
        files.replace(target, lambda other: other.write_text("inner"))
        assert target.read_text() == "inner" and part.read_text() == "outer"

    files.replace(target, outer)
    assert target.read_text() == "outer" and os.listdir(tmp_path) == ["moments.csv"]


@pytest.mark.parametrize("keep", [True, False])
def test_a_durable_writer_inside_another(keep, tmp_path, monkeypatch):
    """If existing files are kept, the second writer has no effect; otherwise the last one wins."""
    target, sync = tmp_path / "shard.npz", os.fsync

    def meanwhile(handle):
        monkeypatch.setattr(os, "fsync", sync)
        assert files.write_durably(target, b"inner", keep=keep)
        sync(handle)

    monkeypatch.setattr(os, "fsync", meanwhile)
    assert files.write_durably(target, b"outer", keep=keep) is not keep
    assert target.read_bytes() == (b"inner" if keep else b"outer") and os.listdir(tmp_path) == ["shard.npz"]


@pytest.mark.parametrize("ending", ["npz", "nc"])
def test_threads_that_save(ending, tmp_path):
    """Threads that save to one target or to several, in a process of its own, since the library of HDF5 used to
    crash.
    """
    if ending == "nc":
        pytest.importorskip("xarray")
        pytest.importorskip("netCDF4")
    program = f"""
import threading, symsde as ss
run = ss.simulate(ss.models.kubo(), q0=1.0, p0=0.0, step=0.1, steps=50, paths=20, seed=3)
start = threading.Barrier(8)
def save(i):
    start.wait()
    for k in range(6):
        run.save("one.{ending}" if k % 2 else f"own{{i}}.{ending}")
        moments.save(f"two{{i}}.{ending}")
moments = ss.moments(ss.models.kubo(), q0=1.0, p0=0.0, step=0.1, steps=50, paths=20, seed=3)
threads = [threading.Thread(target=save, args=(i,)) for i in range(8)]
failed = []
threading.excepthook = lambda x: failed.append(x.exc_value)
[x.start() for x in threads]; [x.join() for x in threads]
assert not failed, failed
"""
    ended = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr[-1000:]
    names = ["one", *(f"{x}{i}" for x in ("own", "two") for i in range(8))]
    assert sorted(os.listdir(tmp_path)) == sorted(f"{name}.{ending}" for name in names)


@pytest.mark.parametrize("writer", ["durable", "replace"])
def test_what_a_killed_writer_leaves(writer, tmp_path):
    """The next writer removes leftovers, except files in use."""
    ended = subprocess.run([sys.executable, "-c", LEFT, str(tmp_path), writer], check=False)
    assert ended.returncode == -signal.SIGKILL and len(os.listdir(tmp_path)) == 1
    with parts.beside(tmp_path / "alive") as part:
        part.write_text("mine")
        files.replace(tmp_path / "name", lambda other: other.write_text("whole"))
        assert sorted(os.listdir(tmp_path)) == sorted([part.parent.name, "name"])
        assert part.read_text() == "mine"
    assert os.listdir(tmp_path) == ["name"] and (tmp_path / "name").read_text() == "whole"


def test_the_next_run_clears_its_folder(tmp_path):
    """Folders below shards are cleared, too; only shards and their checkpoints may be there."""
    scene = tmp_path / "scene.toml"
    scene.write_text(ss.batch.scene.template("kubo").replace("steps = 5000", "steps = 50").replace("paths = 1000", ""))
    given = ["run", str(scene), "--out", str(tmp_path / "out"), "--quiet"]
    assert command_line.main(given) == command_line.OK
    for folder in ("out", "out/shards"):
        subprocess.run([sys.executable, "-c", LEFT, str(tmp_path / folder), "durable"], check=False)
        assert any(name.startswith(".part-") for name in os.listdir(tmp_path / folder))
    assert command_line.main(given) == command_line.OK
    for folder in ("out", "out/shards"):
        assert not any(name.startswith(".part-") for name in os.listdir(tmp_path / folder))


def test_parts_of_another_machine(tmp_path):
    """For parts of another machine a free lock proves nothing: they must be a day old, and the lock free."""
    with parts.beside(tmp_path / "name") as part:
        held = part.parent.rename(tmp_path / ".part-elsewhere-held")
        for name in (".part-elsewhere-young", ".part-elsewhere-old", ".part-elsewhere-bare", ".other"):
            (tmp_path / name).mkdir()
            if name != ".part-elsewhere-bare":
                (tmp_path / name / "lock").touch()
        link = tmp_path / f"{parts._OWN}link"  # a link as this machine makes them, to a folder with a free lock
        link.symlink_to(tmp_path / ".other")
        for folder in (held, *(tmp_path / f".part-elsewhere-{x}" for x in ("old", "bare"))):
            then = folder.stat().st_mtime - 90000
            os.utime(folder, (then, then))
        parts.sweep(tmp_path)
        found = {folder.name for folder in tmp_path.iterdir()}
        assert found == {".other", link.name, ".part-elsewhere-held", ".part-elsewhere-young"}
        assert (tmp_path / ".other" / "lock").exists()


def test_a_writer_that_is_killed_before_it_has_a_lock(tmp_path):
    """A writer is killed between making its folder and the lock: the next writer removes the folder, too."""
    write = "from pathlib import Path; from symsde.native import files; files.write_durably(Path('name'), b'')"
    ended = subprocess.run(words(signal.SIGKILL, 1, "/lock", "open", write), cwd=tmp_path, check=False)
    assert ended.returncode == -signal.SIGKILL and len(os.listdir(tmp_path)) == 1
    parts.sweep(tmp_path)
    assert os.listdir(tmp_path) == []


def test_a_part_that_is_taken_before_it_has_a_lock(tmp_path, monkeypatch):
    """A sweep removes the folder before the writer has its lock: the living writer makes another folder."""
    make, made = parts.tempfile.mkdtemp, []

    def late(**where):
        made.append(make(**where))
        if len(made) == 1:
            parts.sweep(tmp_path)
        return made[-1]

    monkeypatch.setattr(parts.tempfile, "mkdtemp", late)
    files.replace(tmp_path / "name", lambda part: part.write_text("whole"))
    assert len(made) == 2 and os.listdir(tmp_path) == ["name"]


@pytest.mark.parametrize("is_over", [True, False])
def test_a_part_that_is_taken_before_it_is_locked(is_over, tmp_path, monkeypatch):
    """A sweeping process takes the new folder's lock before the writer does, or has removed it already; the writer
    makes another folder.
    """
    lock, calls = parts._locked, []

    def late(handle):
        calls.append(handle)
        if len(calls) == 1 and is_over:
            parts.sweep(tmp_path)
        return lock(handle) if is_over or len(calls) > 1 else False

    monkeypatch.setattr(parts, "_locked", late)
    files.replace(tmp_path / "name", lambda part: part.write_text("whole"))
    assert len(calls) == (3 if is_over else 2)
    assert (tmp_path / "name").read_text() == "whole" and os.listdir(tmp_path) == ["name"]


def test_locks_that_nobody_can_have(tmp_path, monkeypatch):
    """If somebody else holds the lock of every new folder, writing fails after some attempts, and does not wait."""
    monkeypatch.setattr(parts, "_locked", lambda _: False)
    with pytest.raises(ss.errors.NotWrittenError, match=r"name cannot be written: locks in .* held by somebody"):
        files.replace(tmp_path / "name", lambda part: part.write_text("whole"))
    assert os.listdir(tmp_path) == []


def test_without_locks_only_age_counts(tmp_path, monkeypatch):
    """On file systems without locks, writers go on, and no young file is removed."""

    def none(*_):
        raise OSError(38, "Function not implemented")

    monkeypatch.setattr(parts.fcntl, "flock", none)
    with parts.beside(tmp_path / "name") as part:
        part.write_text("mine")
        thread = threading.Thread(target=files.replace, args=(tmp_path / "other", lambda x: x.write_text("whole")))
        thread.start()
        thread.join()
        assert part.read_text() == "mine" and (tmp_path / "other").read_text() == "whole"
