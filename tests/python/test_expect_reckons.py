# SPDX-License-Identifier: BSD-3-Clause
"""What `expect` says of its work before it begins, and that the work takes about as long."""

import logging
import time
from types import SimpleNamespace

import pytest
import symsde as ss
from clock import WorkClock
from symsde.answers.expectation import pilot, problem
from symsde.answers.expectation.carry_out import Execution
from symsde.answers.expectation.problem import make_problem
from symsde.answers.expectation.watch import Watch
from symsde.run.simulate import Run

PLACE = {"q0": 1.0, "p0": 0.0, "horizon": 2.0}


class SlowerAtShortSteps(WorkClock):
    """A processor on which paths of more than 64 steps, as a pilot makes few, take four times as long."""

    def __init__(self, monkeypatch):
        super().__init__(monkeypatch)
        fill = Run.fill

        def filled(result, *given):
            before = self.now
            fill(result, *given)
            if result.setup.options.steps > 64:
                self.now += 3 * (self.now - before - 1e-4)

        monkeypatch.setattr(Run, "fill", filled)


@pytest.fixture
def plans(caplog):
    caplog.set_level(logging.INFO, logger="symsde")
    return caplog


def told_and_taken(plans, model, f, **tolerance):
    """Seconds that were reckoned before the work, and that it took."""
    answer = ss.expect(model, f, **PLACE, **tolerance, threads=1)
    (line,) = [line for line in plans.messages if line.startswith("plan after")]
    plans.clear()
    assert f"{answer.method} by {answer.scheme}, h = " in line and answer.why in line
    return float(line.split("estimated at ")[1].split(" s")[0]), answer.cost - answer.pilot


def test_work_takes_what_was_told(monkeypatch, plans):
    """To a factor of 1.5, on a machine on which the work is slower than the pilot's runs: the seconds are those of a
    part of the work. Without this rehearsal it takes more than that."""
    model = ss.models.synchrotron(sigma1=0.8, sigma2=0.5)
    SlowerAtShortSteps(monkeypatch)
    told, taken = told_and_taken(plans, model, "q**2", abs=0.02, method="plain", scheme="midpoint")
    assert told / 1.5 < taken < 1.5 * told
    monkeypatch.setattr(pilot, "slower", lambda *_: 1.0)
    told, taken = told_and_taken(plans, model, "q**2", abs=0.02, method="plain", scheme="midpoint")
    assert taken > 1.5 * told


def test_the_plan_is_said_before_the_work(monkeypatch, plans, capsys):
    """In the log, and beside the bar where nobody reads that."""

    def stop(_work):
        raise RuntimeError("at work")

    monkeypatch.setattr(Execution, "_one_step", stop)
    monkeypatch.setattr(Execution, "_multilevel", stop)
    asked = {"abs": 0.02, "method": "plain"}
    with pytest.raises(RuntimeError, match="at work"):
        ss.expect(ss.models.kubo(), "q", **PLACE, **asked)
    assert plans.messages[-1].startswith("plan after") and "plain by" in plans.messages[-1]
    logging.getLogger("symsde").setLevel(logging.WARNING)
    with pytest.raises(RuntimeError, match="at work"):
        ss.expect(ss.models.kubo(), "q", **PLACE, **asked, progress=True)
    assert "symsde: plan after" in capsys.readouterr().err


def test_work_that_takes_longer_than_told_says_so(monkeypatch):
    """Once, beyond one and a half times and half a second more; with what it takes in all by the share that is done."""
    now = SimpleNamespace(seconds=10.0)
    monkeypatch.setattr(time, "process_time", lambda: now.seconds)
    watch = Watch(None, progress=False)
    watch.announce("plan", 2.0)
    now.seconds += 3.4
    watch.tell(0.5)  # nothing
    now.seconds += 0.2
    with pytest.warns(
        ss.BudgetWarning, match=r"the 2 s of the processor that were estimated: 3\.6 s so far, about 12 s"
    ):
        watch.tell(0.3)
    now.seconds += 100.0
    watch.tell(0.4)  # once


def test_short_calls_take_one_thread(monkeypatch):
    """Threads that wait for each other cost more than they give; what was measured of a step tells which are short."""
    asked = []
    simulate = problem.simulate
    monkeypatch.setattr(problem, "simulate", lambda *a, **k: asked.append(k.get("threads")) or simulate(*a, **k))
    clock = WorkClock(monkeypatch)
    found = make_problem(ss.models.kubo(), "q", **PLACE, seed=0)
    found.run("heun", 10, paths=100)
    before = clock.now
    found.run("heun", 10, paths=1000)
    unit = (clock.now - before) / 10**4
    enough = int(problem._WORTH / unit) // 10
    found.run("heun", 10, paths=enough - 1)
    found.run("heun", 10, paths=enough + enough // 5)
    assert asked == [1, 1, 1, None]
    chosen = make_problem(ss.models.kubo(), "q", **PLACE, seed=0, threads=2)
    chosen.run("heun", 10, paths=100)
    assert asked[-1] == 2
