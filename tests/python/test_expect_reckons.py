# SPDX-License-Identifier: BSD-3-Clause
"""The estimates that `expect` gives before its work: the work takes about as long."""

import logging
import re
import time
from types import SimpleNamespace

import pytest
import symsde as ss
from clock import WorkClock
from symsde.answers.expectation import choice, problem, watch
from symsde.answers.expectation.carry_out import Execution
from symsde.answers.expectation.estimators import Plain
from symsde.answers.expectation.problem import make_problem
from symsde.answers.expectation.trial import Trial
from symsde.answers.expectation.watch import Watch
from symsde.schemes import as_scheme

PLACE = {"q0": 1.0, "p0": 0.0, "horizon": 2.0}


@pytest.fixture
def plans(caplog):
    caplog.set_level(logging.INFO, logger="symsde")
    return caplog


def told_and_taken(plans, model, f, place=None, **tolerance):
    """The estimates told before the work and when the plan grew, and the seconds that the work took."""
    answer = ss.expect(model, f, **(place or PLACE), **tolerance, threads=1)
    line, *grown = plans.messages
    plans.clear()
    assert line.startswith("plan after") and f"{answer.method} by {answer.scheme}, h = " in line and answer.why in line
    said = [float(found[1]) for found in (re.search(r"estimated at (\S+) s", text) for text in [line, *grown]) if found]
    return said, answer.cost - answer.pilot


def test_a_plan_that_grows_says_so(monkeypatch, plans):
    """The pilot plans four levels and two more are needed: the second estimate is right, the first was not."""
    WorkClock(monkeypatch)
    model = ss.models.noncommutative_oscillator(s1=0.5, s2=0.5)
    place = {**PLACE, "horizon": 1.0}
    told, taken = told_and_taken(plans, model, "q**2", place, abs=2e-3, method="multilevel")
    assert len(told) == 2 and told[0] < taken / 1.5 and told[1] / 1.5 < taken < 1.5 * told[1]


def test_short_work_is_promised_no_number(monkeypatch, plans):
    """Work of less than a tenth of a second is announced without a number. A plan of independent paths counts at least
    as many units as an interval needs."""
    WorkClock(monkeypatch)
    told, taken = told_and_taken(plans, ss.models.kubo(), "q", abs=0.1, method="plain")
    assert not told and taken < 0.1
    assert watch.told(0.099) == "estimated under 0.1 s" and watch.told(0.101) == "estimated at 0.1 s"
    found = make_problem(ss.models.kubo(), "q", **PLACE, seed=0, threads=1)
    trial = Trial(found, as_scheme("midpoint"), 8, 256)
    assert choice.plain(trial, 1.0, 0).seconds == Plain.least_units * trial.seconds(0)


def test_the_plan_is_said_before_the_work(monkeypatch, plans, capsys):
    """The plan is written to the log, or beside the progress bar if the log is not shown."""

    def stop(_work):
        raise RuntimeError("at work")

    monkeypatch.setattr(Execution, "_by_units", stop)
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
    """Work that exceeds its estimate 1.5 times plus half a second warns once, with the total expected from the share
    done.
    """
    now = SimpleNamespace(seconds=10.0)
    monkeypatch.setattr(time, "process_time", lambda: now.seconds)
    clock = Watch(None, progress=False)
    clock.announce("plan", 2.0)
    now.seconds += 3.4
    clock.tell(0.5)  # no warning
    now.seconds += 0.2
    with pytest.warns(
        ss.BudgetWarning, match=r"the 2 s of the processor that were estimated: 3\.6 s so far, about 12 s"
    ):
        clock.tell(0.3)
    now.seconds += 100.0
    clock.tell(0.4)  # the only warning
    clock = Watch(None, progress=False)
    clock.announce("plan", 2.0)
    now.seconds += 4.0
    with pytest.warns(ss.BudgetWarning, match="4 s so far, about 4 s in all"):
        clock.tell(33.0)  # a part held more units than wanted


def test_short_calls_take_one_thread(monkeypatch):
    """In short calls threads that wait for each other cost more than they gain; measured steps show which calls are
    short.
    """
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
