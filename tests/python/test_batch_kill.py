# SPDX-License-Identifier: BSD-3-Clause
"""kill -9 at random moments, again and again: what is there in the end has the bits of a run that nobody disturbed.

SYMSDE_KILLS is how many kills; a sample without it.
"""

import hashlib
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from conftest import table_of

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
MANY = SCENE.format(steps=20000, every=1000, paths="[5, 6, 700]")
LONG = SCENE.format(steps=40000000, every=2000000, paths="[5]").replace("paths = 4096", "paths = 6")
LONG = LONG.replace("moments = true", "moments = false")


def command(scene, out):
    given = [
        sys.executable,
        "-m",
        "symsde",
        "run",
        str(scene),
        "--out",
        str(out),
        "--shard-paths",
        "256",
        "--checkpoint",
        "0.05",
    ]
    return subprocess.Popen([*given, "--quiet"], start_new_session=True)


def digest(folder):
    total = hashlib.sha256()
    shards = sorted((Path(folder) / "shards").glob("*.npz"))
    for path in shards:
        total.update(path.name.encode() + path.read_bytes())
    for path in Path(folder).glob("moments.csv"):
        total.update("\n".join(table_of(path)).encode())
    return len(shards), total.hexdigest()


@pytest.mark.parametrize(("name", "text"), [("many", MANY), ("long", LONG)])
def test_killed_and_resumed(name, text, tmp_path):
    scene = tmp_path / "scene.toml"
    scene.write_text(text)
    begin = time.monotonic()
    assert command(scene, tmp_path / "known").wait(300) == 0
    whole = time.monotonic() - begin
    dice = random.Random(12)
    survived = 0
    for sitting in range(20 * KILLS):
        process = command(scene, tmp_path / "out")
        try:
            process.wait(dice.uniform(0.2, 1.0) * whole if survived < KILLS else 300)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
            survived += 1
        if process.returncode == 0:  # done: from the start again, for more kills
            assert digest(tmp_path / "out") == digest(tmp_path / "known")
            if survived >= KILLS:
                break
            os.rename(tmp_path / "out", tmp_path / f"done{sitting}")
    assert survived >= KILLS and process.returncode == 0
    left = [path.name for path in (tmp_path / "out" / "shards").iterdir() if path.suffix != ".npz"]
    assert not left


def test_a_checkpoint_beside_its_shard_goes(tmp_path):
    """Who is killed between writing the shard and that leaves it to the next one."""
    scene = tmp_path / "scene.toml"
    scene.write_text(SCENE.format(steps=2000, every=1000, paths="[5]"))
    assert command(scene, tmp_path / "out").wait(300) == 0
    shards = sorted((tmp_path / "out" / "shards").glob("*.npz"))
    for shard in shards:
        shard.with_suffix(".checkpoint").write_bytes(b"")
    assert command(scene, tmp_path / "out").wait(300) == 0
    assert shards and sorted((tmp_path / "out" / "shards").iterdir()) == shards
