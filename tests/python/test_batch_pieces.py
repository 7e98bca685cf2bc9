# SPDX-License-Identifier: BSD-3-Clause
"""The division of a run into pieces, and long pieces that resume from their checkpoints."""

import dataclasses
import threading
import warnings
from types import SimpleNamespace

import numpy as np
import pytest
import symsde as ss
from symsde import errors
from symsde.batch import execute, folder, shard_file, share
from symsde.batch import pieces as plan
from symsde.cli import command_line, run_command


class Memory:
    """A store in memory."""

    seconds = 10.0

    def __init__(self):
        self.states = []

    def read(self):
        return shard_file.from_bytes(self.states[-1], "memory") if self.states else None

    def write(self, state):
        self.states.append(shard_file.to_bytes(state))


def never(_done, _total):
    """Do not stop."""
    return False


def interrupted(task, piece, after):
    """The shard of a piece that is stopped repeatedly, each time after this many calls of its monitor."""
    store, sittings = Memory(), 0
    while True:
        asked = []

        def tell(_done, _total, asked=asked):
            asked.append(0)
            return len(asked) > after

        sittings += 1
        assert sittings < 1000
        if (found := execute.compute(task, piece, 1, tell, store)) is not None:
            return found, sittings


OTHER = {"run": None, "name": "paths-000002", "kind": "moments", "first": 512, "paths": 128}


@pytest.mark.parametrize("what", OTHER)
def test_a_checkpoint_of_another_is_not_taken(what, tmp_path):
    """A checkpoint of another run or piece is not used, since the piece would then continue that run and count its
    steps as done.
    """
    (tmp_path / "shards").mkdir()
    piece = plan.Piece("paths-000001", "paths", 256, 256, 1000)
    records = [{"inputs": {"seed": seed}} for seed in (1, 2 if what == "run" else 1)]
    one, other = (folder.RunFolder(tmp_path, record, [piece]) for record in records)
    one.checkpoint(piece).write(shard_file.Shard({"q": np.ones(3)}, {"step": 7}))
    assert one.checkpoint(piece).read().facts["step"] == 7
    changed = piece if what == "run" else dataclasses.replace(piece, **{what: OTHER[what]})
    other.checkpoint_path(piece).rename(moved := other.checkpoint_path(changed))
    assert moved.exists() and other.checkpoint(changed).read() is None


@pytest.mark.parametrize("compensated", [False, True])
@pytest.mark.parametrize(("steps", "every"), [(600, 50), (601, 601), (600, 1)])
def test_long_paths_go_on_from_their_checkpoints(steps, every, compensated, monkeypatch):
    """A long piece is stopped at every segment, some of which end between saved points; failed paths stay failed."""
    monkeypatch.setattr(execute, "_FIRST", 7 * 4 * 2)
    monkeypatch.setattr(execute._Clock, "next_length", lambda _, length: 11 - length % 5)
    q0 = np.full((2, 4), 0.1)
    q0[:, 2] = 0.75
    options = {"q0": q0, "p0": 0.0, "step": 0.05, "steps": steps, "save_every": every, "seed": 5, "t0": 0.3}
    options |= {"compensated": compensated, "scheme": "stormer_verlet", "first_step": 3, "paths": 4}
    model = ss.models.henon_heiles(sigma1=0.02, sigma2=0.02)
    piece = plan.Piece("paths-000001", "paths", 0, 4, 4 * steps)
    with pytest.warns(ss.PathsFailedWarning):
        known = ss.simulate(model, **options)
        found, sittings = interrupted(execute.Task(model, options), piece, 4)
    assert sittings > 10 and known.failed_step[2] > 30 and (known.status == 0).sum() == 3
    names = ["t", "q", "p", "status", "failed_step", "last_q", "last_p", *(["q_low", "p_low"] if compensated else [])]
    for name in names:
        np.testing.assert_array_equal(found.arrays[name], getattr(known, name), err_msg=name)
    assert found.facts["failed"] == 1
    assert found.facts["counters"]["path_steps"] == known.report.counters["path_steps"]


@pytest.mark.parametrize(("takes", "after"), [(0, [11, 22, 33, 44, 55]), (2, [11, 52])])
def test_checkpoints_come_as_soon_as_they_may(takes, after, monkeypatch):
    """A checkpoint is written once the set time has passed, and also twenty times the time that writing the last
    checkpoint took. A step takes a second here.
    """
    now = 0.0

    def one_step(_clock, _length):
        nonlocal now
        now += 1
        return 1

    class Slow(Memory):
        def write(self, state):
            nonlocal now
            now += takes
            super().write(state)

    monkeypatch.setattr(execute, "_FIRST", 1)
    monkeypatch.setattr(execute._Clock, "next_length", one_step)
    monkeypatch.setattr(execute.time, "monotonic", lambda: now)
    options = {"q0": 1.0, "p0": 0.0, "step": 0.1, "steps": 60, "paths": 1}
    store = Slow()
    execute.compute(execute.Task(ss.models.kubo(), options), plan.Piece("one", "paths", 0, 1, 60), 1, never, store)
    assert [shard_file.from_bytes(state, "memory").facts["step"] for state in store.states] == after


def test_shares_are_all_pieces_once():
    pieces = plan.plan(plan.Extent(512, 10000, 100, 3, 1), 512, moments=True, saved=[600, 601, 9000])
    assert sum(piece.paths for piece in pieces if piece.kind == "moments") == 10000
    assert [(piece.first, piece.paths) for piece in pieces if piece.kind == "paths"] == [(600, 2), (9000, 1)]
    assert all(piece.first % 512 == 0 for piece in pieces if piece.kind == "moments")
    for n in (1, 2, 7, 100):
        parts = [name.name for i in range(n) for name in share.Share(i + 1, n).of(pieces)]
        assert sorted(parts) == sorted(piece.name for piece in pieces)


@pytest.mark.parametrize("paths", [1, 255, 257, 10**6, 10**9])
@pytest.mark.parametrize("steps", [0, 1, 10**4, 10**9])
def test_pieces_are_neither_crumbs_nor_mountains(paths, steps):
    size = plan.shard_paths(plan.Extent(0, paths, steps, 2, 3))
    assert size >= 256 and size & (size - 1) == 0
    count = -(-paths // size)
    assert count <= 2**14
    if size > 256:
        assert size * steps * 3 <= max(2**29, 2 * paths * steps * 3 / 2**14)


def test_a_folder_holds_no_more_than_its_shards():
    """The size of a shard is rounded up to a power of two: rounded down, there would be up to twice as many shards."""
    assert plan.shard_paths(plan.Extent(0, 2**22 * 3, 2**22, 2, 1)) == 1024  # with 512 there would be 24576 shards


def test_a_stretch_of_many_saved_paths_is_cut_by_what_it_holds():
    pieces = plan.plan(plan.Extent(0, 10**6, 10, 2**20, 1), 2**20, moments=False, saved=range(10))
    assert [piece.paths for piece in pieces] == [4, 4, 2]


def test_a_path_that_failed_stays_where_it_was():
    """A failed path stays failed, even if its last good state could be continued; here the failure is planted."""
    run = {"step": 0.1, "steps": 2, "paths": 2, "seed": 1}
    first = ss.simulate(ss.models.kubo(), q0=1.0, p0=0.0, **run)
    first.status[1], first.failed_step[1] = 3, 1
    later = ss.simulate(ss.models.kubo(), q0=first.last_q, p0=first.last_p, first_step=2, **run)
    known = later.q[1:, :, 0].copy()
    saved = execute._Saved()
    saved.add(first, 2, keeps_last=True)
    saved.add(later, 2, keeps_last=True)
    found = saved.shard(**saved.counted(0))
    for name in "qp":
        assert np.isnan(found.arrays[name][3:, :, 1]).all() and np.isfinite(found.arrays[name][..., 0]).all()
    np.testing.assert_array_equal(found.arrays["q"][3:, :, 0], known)
    np.testing.assert_array_equal(found.arrays["last_q"][:, 1], first.last_q[:, 1])
    assert found.arrays["status"].tolist() == [0, 3] and found.arrays["failed_step"].tolist() == [-1, 1]
    assert found.facts["failed"] == 1 and found.facts["counters"] == {"path_steps": 5}


@pytest.mark.parametrize("kind", ["paths", "moments"])
def test_who_computes_a_piece_says_nothing_of_failed_paths(kind):
    """The main thread suppresses warnings of failed paths; since filters of warnings belong to the process, other
    threads do not change them, and give the warning.
    """
    given = {"q0": 1e200, "p0": 0.0, "step": 0.1, "steps": 2, "paths": 2, "seed": 1}
    task, piece = execute.Task(ss.models.henon_heiles(), given), plan.Piece("a", kind, 0, 2, 2)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert execute.compute(task, piece).facts["failed"] == 2
    beside = threading.Thread(target=execute.compute, args=(task, piece))
    with pytest.warns(errors.PathsFailedWarning):
        beside.start()
        beside.join()


def test_the_line_that_goes_on_trusts_what_the_first_one_did(tmp_path, capsys):
    given = {"paths": "4000", "steps": None, "grow": False, "keep_last": True}
    options = SimpleNamespace(scene="a b.toml", shard="1/2", allow_python=True, error_check=False, **given)
    folder = SimpleNamespace(pieces=[1, 2], path=tmp_path)
    assert run_command._stopped(SimpleNamespace(reason="SIGTERM"), options, folder, [1], None) == 4
    asked = f"`symsde run 'a b.toml' --out {tmp_path} --shard 1/2 --paths 4000 --allow-python --keep-last`"
    assert asked in capsys.readouterr().err


def test_an_empty_part_is_refused(tmp_path, capsys):
    (tmp_path / "a.toml").write_text('[model]\nname = "kubo"\n[run]\nstep = 0.1\nsteps = 1\nq0 = 1.0\np0 = 0.0\n')
    assert command_line.main(["run", str(tmp_path / "a.toml"), "--shard", "", "--out", str(tmp_path / "out")]) == 2
    assert "is no part of a run" in capsys.readouterr().err and not (tmp_path / "out").exists()
