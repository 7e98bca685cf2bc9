# SPDX-License-Identifier: BSD-3-Clause
"""Times that are saved at unequal distances: the states of a run that saves every step, bit for bit."""

import numpy as np
import pytest
import symsde as ss
from symsde.batch import dry
from symsde.batch.dry import need
from symsde.batch.execute import Task
from symsde.batch.pieces import Piece
from symsde.cli import command_line
from symsde.errors import IncompatibleError, InvalidArgumentError, WrongShapeError, WrongTypeError

KUBO = ss.models.kubo()
RUN = {"q0": ss.states.normal(1.0, 0.1), "p0": 0.0, "step": 0.1, "steps": 60, "paths": 300, "seed": 5}
STEPS = [0, 2, 6, 40]
TIMES = [0.0, 0.2, 0.6, 4.0]


def test_states_of_every_step():
    """Saves those steps of a run that saves them all; the end is known beside."""
    every, found = ss.simulate(KUBO, **RUN), ss.simulate(KUBO, **RUN, save_at=TIMES)
    for name in ("t", "q", "p"):
        assert np.array_equal(getattr(found, name), getattr(every, name)[STEPS])
    assert np.array_equal(found.last_q, every.last_q) and found.report.counters == every.report.counters
    assert np.array_equal(found.energy, every.energy[STEPS])
    exact, known = ss.diagnose.exact(found), ss.diagnose.exact(every)
    assert np.array_equal(exact[0], known[0][STEPS])
    more = found.extend(20)
    assert np.array_equal(more.q[-1], every.extend(20).q[-1]) and len(more.t) == 2
    late = ss.simulate(KUBO, **RUN, save_at=[4.0])
    assert np.array_equal(late.q[0], every.q[40]) and late.t.tolist() == [every.t[40]]
    back = ss.simulate(KUBO, **(RUN | {"step": -0.1}), save_at=[-0.1, -6.0])
    assert np.array_equal(back.q, ss.simulate(KUBO, **(RUN | {"step": -0.1})).q[[1, 60]])
    shifted = RUN | {"first_step": 10, "t0": 2.0}
    assert np.array_equal(ss.simulate(KUBO, **shifted, save_at=[3.2]).q[0], ss.simulate(KUBO, **shifted).q[2])


def test_moments_of_every_step(tmp_path):
    """Keeps the moments at these times, in one run, shards, sweeps and files."""
    shown = {"observables": {"r": "q**2 + p**2"}}
    every, found = ss.moments(KUBO, **RUN, **shown), ss.moments(KUBO, **RUN, **shown, save_at=TIMES)
    for kind in ("mean", "var", "se_mean"):
        assert np.array_equal(found.table(kind), every.table(kind)[STEPS])
    assert np.array_equal(found.mean["r"], every.mean["r"][STEPS]) and np.array_equal(found.t, every.t[STEPS])
    shards = ss.ensemble(KUBO, **RUN, **shown, save_at=TIMES, shard_paths=256)
    assert np.array_equal(shards.var_q, found.var_q) and np.array_equal(shards.t, found.t)
    swept = ss.sweep(KUBO, {"sigma": [0.1, 0.3]}, **(RUN | {"paths": 20}), save_at=TIMES)
    known = ss.sweep(KUBO, {"sigma": [0.1, 0.3]}, **(RUN | {"paths": 20}))
    assert np.array_equal(swept.mean_q, known.mean_q[STEPS]) and np.array_equal(swept.t, found.t)
    found.save(tmp_path / "found.npz")
    assert np.array_equal(ss.load(tmp_path / "found.npz").mean_q, found.mean_q)


@pytest.mark.parametrize("checkpoint", [False, True], ids=["whole", "segments"])
def test_scenes(tmp_path, monkeypatch, checkpoint):
    """Saves these times of scenes, and goes on from any state of a long path."""
    monkeypatch.chdir(tmp_path)
    if checkpoint:
        monkeypatch.setattr("symsde.batch.execute._FIRST", 900)
    for name, when in (("some", "save_at = [0.2, 0.6, 4.0]"), ("every", "save_every = 1")):
        (tmp_path / f"{name}.toml").write_text(
            f'[model]\nname = "kubo"\n[run]\nstep = 0.1\nsteps = 60\n{when}\npaths = 300\nseed = 5\n'
            'initial = {law = "normal", mean = 1.0, sd = 0.1}\n[output]\npaths = "all"\n'
        )
        assert command_line.main(["run", f"{name}.toml", "--out", name, "--quiet"]) == 0
    some, every = ss.open_run("some"), ss.open_run("every")
    assert np.array_equal(some.moments.mean_q, every.moments.mean_q[STEPS[1:]])
    assert np.array_equal(some.run.q, every.run.q[STEPS[1:]]) and np.array_equal(some.run.t, every.run.t[STEPS[1:]])
    assert np.array_equal(some.run.last_q, every.run.last_q)
    assert command_line.main(["run", "some.toml", "--out", "some", "--paths", "600", "--quiet"]) == 0
    assert np.array_equal(ss.open_run("some").run.q[..., :300], some.run.q)
    text = (tmp_path / "some.toml").read_text().replace("[0.2, 0.6, 4.0]", "[0.2, 0.6, 4.0, 5.0]")
    (tmp_path / "some.toml").write_text(text)
    grow = ["run", "some.toml", "--out", "some", "--paths", "600", "--grow", "--quiet"]
    assert command_line.main(grow) == 0
    assert np.array_equal(ss.open_run("some").run.q[3, :, :300], every.run.q[50])


def test_foretold():
    """Counts what moments hold between unequal times, and the steps at which a pilot run collects them."""
    asked = {"steps": 10**6, "paths": 256, "q0": 1.0, "p0": 0.0, "step": 0.1}
    whole = ss.moments(KUBO, **(asked | {"paths": 1}))
    held = sum(x.nbytes for x in (whole.t, whole.n_ok, whole.m2, *whole._tables.values()))
    needs = []
    for times in ([0.0, 1e5], [0.0, 0.1, 1e5]):
        task = Task(KUBO, asked | {"save_at": times}, {}, {})
        needs.append(need(task, [Piece("m", "moments", 0, 256, 256 * 10**6)], 256, len(times)))
    assert needs[0].memory < 1e8 and held < needs[1].memory - needs[0].memory < 4 * held


@pytest.mark.parametrize("times", [[0.0, 0.2, 6.0], [0.0, 0.7, 5.6], [6.0]])
def test_pilot(times, monkeypatch):
    """Collects moments in a pilot run as often as the run does, as soon as it has as many steps."""
    seen = []

    def watched(model, **options):
        seen.append((options["steps"], options["save_every"]))
        return ss.moments(model, **options)

    monkeypatch.setattr(dry, "moments", watched)
    monkeypatch.setattr(dry, "_PILOT", 1e9)
    steps = round(times[-1] / 0.1)
    every = np.gcd.reduce([*(round(x / 0.1) for x in times), steps])
    task = Task(KUBO, RUN | {"steps": steps, "save_at": times}, {}, {})
    need(task, [Piece("m", "moments", 0, 256, 256 * steps)], 256, len(times))
    assert seen[-1] == (steps, every)
    assert all((n % every == 0 and x == every) or n == x < every for n, x in seen)


@pytest.mark.parametrize(
    ("given", "kind", "word"),
    [
        ({"save_at": [0.25]}, InvalidArgumentError, "nearest is 0.2"),
        ({"save_at": [0.1, 6.1]}, InvalidArgumentError, "nearest is 6"),
        ({"save_at": [-0.1]}, InvalidArgumentError, "no step of this run"),
        ({"save_at": [0.2, 0.1]}, InvalidArgumentError, "order"),
        ({"save_at": [0.2, 0.2]}, InvalidArgumentError, "twice"),
        ({"save_at": []}, WrongShapeError, "one time"),
        ({"save_at": 0.1}, WrongShapeError, "one time"),
        ({"save_at": [np.nan]}, InvalidArgumentError, "finite"),
        ({"save_at": [0.1], "save_every": 2}, WrongTypeError, "give one"),
    ],
)
def test_refusals(given, kind, word):
    """Refuses times that no step reaches, with a sentence."""
    with pytest.raises(kind, match=word):
        ss.simulate(KUBO, **RUN, **given)


def test_other_doors():
    """Refuses what needs equal distances."""
    few = RUN | {"paths": 3}
    with pytest.raises(IncompatibleError, match="observers"):
        ss.moments(KUBO, **few, save_at=TIMES, observers={"x": ss.observe.Histogram("q_1", -3, 3, 6)})
    with pytest.raises(IncompatibleError, match="derivatives"):
        ss.gradient(KUBO, "q", ["sigma"], **few, save_at=TIMES)
    with pytest.raises(IncompatibleError, match="save_at"):
        ss.diagnose.action(ss.simulate(KUBO, **few, save_at=[0.1, 0.2, 0.4, 0.5]))
