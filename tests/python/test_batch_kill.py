# SPDX-License-Identifier: BSD-3-Clause
"""kill -9 at random points of work on files, repeatedly: the final result has the bits of an undisturbed run.

SYMSDE_KILLS is the number of kills; without it a sample is taken.
"""

import hashlib
import os
import random
import shutil
import signal
import subprocess
from pathlib import Path

import pytest
from conftest import table_of
from sent_at import words

KILLS = int(os.environ.get("SYMSDE_KILLS", "6"))

SCENE = """
[model]
name = "kubo"
[run]
step = 0.01
steps = {steps}
paths = 4096
seed = 3
q0 = 1.0
p0 = 0.0
save_every = {every}
[output]
moments = true
paths = {paths}
"""
MANY = SCENE.format(steps=8000, every=400, paths="[5, 6, 700]")
LONG = SCENE.format(steps=16000000, every=400000, paths="[5]").replace("paths = 4096", "paths = 6")
LONG = LONG.replace("moments = true", "moments = false")


def run(scene, out, at=0, more=()):
    """Exit code of a run that is killed at this event in its folder, and the number of events that it counted."""
    given = ["run", scene, "--out", out, "--shard-paths", "256", "--checkpoint", "0.005", "--quiet", *more]
    done = subprocess.run(words(signal.SIGKILL, at, out, "all", "symsde", *given), stdout=subprocess.PIPE, check=False)
    return done.returncode, int(done.stdout or at)


def digest(folder):
    total = hashlib.sha256()
    shards = sorted((Path(folder) / "shards").glob("*.npz"))
    for path in shards:
        total.update(path.name.encode() + path.read_bytes())
    for path in Path(folder).glob("moments.csv"):
        total.update("\n".join(table_of(path)).encode())
    return len(shards), total.hexdigest()


@pytest.mark.parametrize(("text", "least"), [(MANY, 180), (LONG, 36)])
def test_killed_and_resumed(text, least, tmp_path):
    scene = tmp_path / "scene.toml"
    scene.write_text(text)
    code, events = run(scene, tmp_path / "known")
    assert code == 0 and events >= least  # at least the number of events without checkpoints, which a clock triggers
    dice = random.Random(12)
    killed = 0
    while killed < KILLS:
        code, _ = run(scene, tmp_path / "out", dice.randint(1, events))
        assert code in (0, -signal.SIGKILL)
        killed += code != 0
        if code == 0:  # the run ended before the event: begin again, for more kills
            assert digest(tmp_path / "out") == digest(tmp_path / "known")
            shutil.rmtree(tmp_path / "out")
    assert run(scene, tmp_path / "out")[0] == 0
    assert digest(tmp_path / "out") == digest(tmp_path / "known")
    left = [path.name for path in (tmp_path / "out" / "shards").iterdir() if path.suffix != ".npz"]
    assert not left


def test_killed_while_it_grew(tmp_path):
    """A folder that keeps last states grows by steps and paths and is killed: its shards are those of one run."""
    scene = tmp_path / "scene.toml"
    text = MANY.replace("moments = true", "keep_last = true").replace("paths = 4096", "paths = 1100")
    scene.write_text(text)
    assert run(scene, tmp_path / "before")[0] == 0
    more = ("--steps", "9200", "--paths", "1300")
    scene.write_text(text.replace("steps = 8000", "steps = 9200").replace("paths = 1100", "paths = 1300"))
    assert run(scene, tmp_path / "known")[0] == 0
    scene.write_text(text)
    shutil.copytree(tmp_path / "before", tmp_path / "out")
    code, events = run(scene, tmp_path / "out", more=more)
    assert code == 0 and events >= 60
    dice = random.Random(13)
    killed = 0
    while killed < KILLS:
        if digest(tmp_path / "out") == digest(tmp_path / "known"):
            shutil.rmtree(tmp_path / "out")
            shutil.copytree(tmp_path / "before", tmp_path / "out")
        code, _ = run(scene, tmp_path / "out", dice.randint(1, events), more)
        assert code in (0, -signal.SIGKILL)
        killed += code != 0
    assert run(scene, tmp_path / "out", more=more)[0] == 0
    assert digest(tmp_path / "out") == digest(tmp_path / "known")
    left = [path.name for path in (tmp_path / "out" / "shards").iterdir() if path.suffix != ".npz"]
    assert not left


def test_a_checkpoint_beside_its_shard_goes(tmp_path):
    """A process killed between writing a shard and removing its checkpoint leaves the checkpoint to the next
    process.
    """
    scene = tmp_path / "scene.toml"
    scene.write_text(SCENE.format(steps=2000, every=1000, paths="[5]"))
    assert run(scene, tmp_path / "out")[0] == 0
    shards = sorted((tmp_path / "out" / "shards").glob("*.npz"))
    for shard in shards:
        shard.with_suffix(".checkpoint").write_bytes(b"")
    assert run(scene, tmp_path / "out")[0] == 0
    assert shards and sorted((tmp_path / "out" / "shards").iterdir()) == shards
