# SPDX-License-Identifier: BSD-3-Clause
"""Tests of a minute each: a path of 10^8 steps, stopped and resumed, memory of 10^6 paths, full and read-only disks."""

import contextlib
import os
import subprocess
import sys

import numpy as np
import pytest
from conftest import table_of
from symsde.batch import shard_file, stop
from symsde.cli import command_line

STEPS, STOPS = 10**8, 14
LONG = f"""
[model]
name = "kubo"
[run]
step = 0.01
steps = {STEPS}
save_every = {STEPS // 100}
q0 = 1.0
p0 = 0.0
seed = 5
compensated = true
[output]
moments = false
paths = [0]
"""


def test_a_path_of_many_steps_is_resumed_to_the_same_bits(tmp_path, monkeypatch):
    """A path is stopped after every fifteenth of its steps and resumed; |q|^2 + |p|^2 changes by rounding alone."""
    (tmp_path / "scene.toml").write_text(LONG)
    given = ["run", str(tmp_path / "scene.toml"), "--quiet", "--checkpoint", "0.02", "--out"]
    assert command_line.main([*given, str(tmp_path / "whole")]) == command_line.OK
    stopped = 0
    for part in range(1, STOPS + 1):

        def gives_up(self, done, total, _begun, part=part):
            if done > part * (total // (STOPS + 1)):
                self._wish("a test")
            return bool(self._reason)

        with monkeypatch.context() as change:
            change.setattr(stop.Stop, "gives_up", gives_up)
            stopped += command_line.main([*given, str(tmp_path / "out")]) == command_line.STOPPED
    assert stopped >= 10
    assert command_line.main([*given, str(tmp_path / "out")]) == command_line.OK
    shards = [tmp_path / name / "shards" / "paths-000001.npz" for name in ("whole", "out")]
    assert shards[0].read_bytes() == shards[1].read_bytes()
    arrays = shard_file.read(shards[0]).arrays
    drift = np.abs(arrays["q"] ** 2 + arrays["p"] ** 2 - 1).max()
    print(f"resumed {stopped} times, largest change of the invariant {drift:.2g}")
    assert arrays["t"][-1] == STEPS * 0.01 and drift <= 1e-12


PEAK = """
import re, sys
import symsde as ss
wanted = {"x": ss.observe.Histogram("r", 0, 2, 50), "loss": ss.observe.Passage("q_1", low=-0.99, absorb=True)}
ss.ensemble(ss.models.kubo(sigma=0.3), q0=1.0, p0=0.0, step=0.05, steps=40, save_every=10, paths=int(sys.argv[1]),
            observables={"r": "q1**2 + p1**2"}, observers=wanted, threads=2)
print(re.search(r"VmHWM:\\s*(\\d+)", open("/proc/self/status").read())[1])  # ru_maxrss is that of the parent at least
"""


@pytest.mark.skipif(not os.path.exists("/proc/self/status"), reason="there is no /proc to ask")
def test_memory_does_not_grow_with_paths():
    """Memory for 10^4, 10^5 and 10^6 paths, in kB of the whole process. A thousand shards would add 4 MB of reports."""
    peaks = []
    for paths in (10**4, 10**5, 10**6):
        done = subprocess.run([sys.executable, "-c", PEAK, str(paths)], capture_output=True, text=True, check=True)
        peaks.append(int(done.stdout))
    print("kB at 10^4, 10^5, 10^6 paths:", peaks)
    assert peaks[2] < 1.05 * peaks[0]


MANY = """
[model]
name = "kubo"
[run]
step = 0.1
steps = 10
paths = 20000
q0 = 1.0
p0 = 0.0
"""


@contextlib.contextmanager
def mounted(place, options):
    """A small file system in memory; skipped where none may be mounted."""
    place.mkdir()
    given = ["mount", "-t", "tmpfs", "-o", options, "tmpfs", str(place)]
    if os.geteuid() != 0 or subprocess.run(given, capture_output=True, check=False).returncode != 0:
        pytest.skip("no file system can be mounted here: run as root")
    try:
        yield place
    finally:
        subprocess.run(["umount", str(place)], check=True)


def test_a_full_file_system(tmp_path, capsys):
    """A full disk ends the run with a message and complete files; with more room the run goes on to the same bits."""
    (tmp_path / "scene.toml").write_text(MANY)
    given = ["run", str(tmp_path / "scene.toml"), "--quiet", "--shard-paths", "256", "--out"]
    assert command_line.main([*given, str(tmp_path / "known")]) == command_line.OK
    with mounted(tmp_path / "small", "size=200k") as small:
        assert command_line.main([*given, str(small / "out")]) == command_line.NOT_WRITTEN
        assert "cannot be written: No space left on device" in capsys.readouterr().err
        there = sorted((small / "out" / "shards").iterdir())
        assert 2 < len(there) < 79 and all(path.suffix == ".npz" for path in there)
        for path in there:
            shard_file.read(path)
        subprocess.run(["mount", "-o", "remount,size=8m", str(small)], check=True)
        assert command_line.main([*given, str(small / "out")]) == command_line.OK
        assert table_of(small / "out" / "moments.csv") == table_of(tmp_path / "known" / "moments.csv")


def test_a_file_system_that_cannot_be_written(tmp_path, capsys):
    (tmp_path / "scene.toml").write_text(MANY)
    with mounted(tmp_path / "still", "ro,size=1m") as still:
        assert (
            command_line.main(["run", str(tmp_path / "scene.toml"), "--out", str(still / "out")])
            == command_line.NOT_WRITTEN
        )
        assert "out: Read-only file system: give another folder, or make room" in capsys.readouterr().err
