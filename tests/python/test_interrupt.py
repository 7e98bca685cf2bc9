# SPDX-License-Identifier: BSD-3-Clause
"""Ctrl-C stops a run, and forked processes do not hang."""

import gc
import os
import signal
import subprocess
import sys
import weakref

import numpy as np
import pytest
import symsde as ss
from sender import HandledError, handled, raises, sent
from symsde.run import setup

LONG = {"q0": 1.0, "p0": 0.0, "step": 1e-3, "steps": 10**9, "save_every": 10**8}


@pytest.mark.parametrize("function", [ss.simulate, ss.moments])
@pytest.mark.parametrize("threads", [1, 2])
def test_ctrl_c(function, threads, kubo):
    before = signal.getsignal(signal.SIGINT)
    with sent(signal.SIGINT), pytest.raises(KeyboardInterrupt):
        function(kubo, paths=1000, threads=threads, **LONG)
    assert signal.getsignal(signal.SIGINT) is before
    assert np.isfinite(ss.simulate(kubo, q0=1.0, p0=0.0, step=0.1, steps=10).q).all()


def test_ctrl_c_with_python_callbacks(user_kubo):
    with sent(signal.SIGINT), pytest.raises(KeyboardInterrupt):
        ss.simulate(user_kubo, paths=10, **LONG)


@pytest.mark.parametrize("what", ["exact", "commutator", "increments", "stationary"])
def test_ctrl_c_in_what_takes_long(what, kubo):
    """Long work is stopped by Ctrl-C, and by a signal whose handler raises another exception."""
    chain = ss.models.fpu_chain(n=1000)
    endless = setup.make_setup(kubo, q0=1.0, p0=0.0, step=1e-7, steps=10**9, save_every=10**9)
    places = {"q_start": 0.1, "q_end": 0.2, "step": 0.01, "steps": 40, "paths": 20000}
    long = {
        "exact": lambda: ss.diagnose.exact_of(endless),
        "commutator": lambda: ss.commutator(chain),
        "increments": lambda: ss.increments(chain, step=0.1, steps=20, paths=20000),
        "stationary": lambda: ss.diagnose.stationary_path(ss.models.fpu_chain(n=16), "gauss4", **places),
    }
    with sent(signal.SIGINT), pytest.raises(KeyboardInterrupt):
        long[what]()
    with handled(signal.SIGUSR1, raises), sent(signal.SIGUSR1), pytest.raises(HandledError):
        long[what]()


def test_exception_of_progress(kubo):
    def progress(done, total):
        raise RuntimeError("planted")

    with pytest.raises(RuntimeError, match="planted"):
        ss.simulate(kubo, paths=10, progress=progress, **LONG)


def test_fork():
    code = """
import multiprocessing, symsde as ss
def run(seed):
    found = ss.simulate(ss.models.kubo(), q0=1.0, p0=0.0, step=0.1, steps=20, paths=600, lanes=64, threads=2, seed=seed)
    return found.report.threads, float(found.q[-1, 0, 599])
if __name__ == "__main__":
    here = [run(seed) for seed in range(4)]
    with multiprocessing.get_context("fork").Pool(2) as pool:
        there = pool.map(run, range(4))
    assert [threads for threads, _ in here] == [2] * 4, here
    assert [threads for threads, _ in there] == [1] * 4, there
    assert [x for _, x in here] == [x for _, x in there]
    print("same")
"""
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert found.stdout.strip() == "same", found.stderr


def stopping(number):
    """A progress function that sends this process a signal in its third call."""
    told = []

    def progress(done, total):
        told.append(done)
        if len(told) == 3:
            os.kill(os.getpid(), number)
            told.append("after")  # the signal is noted, and its handler runs when the run has stopped

    progress.told = told
    return progress


def test_a_stopped_run_is_given_back(kubo):
    common = {"q0": 1.0, "p0": 0.0, "step": 1e-3, "seed": 4, "threads": 1}
    progress = stopping(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt) as caught:
        ss.simulate(kubo, steps=10**9, save_every=10**4, paths=3, progress=progress, **common)
    assert progress.told[-1] == "after"
    run = caught.value.partial
    assert run.report.outcome == "stopped on request" and run.report.stopped == 3 and (run.status == 5).all()
    reached = int(np.isfinite(run.q[:, 0, 0]).sum())
    assert 1 < reached < 10**5 and np.isnan(run.q[reached:]).all()
    known = ss.simulate(kubo, steps=10**4 * (reached - 1), save_every=10**4, paths=3, **common)
    np.testing.assert_array_equal(run.q[:reached], known.q)
    np.testing.assert_array_equal(run.t[:reached], known.t)


def test_stopped_moments_are_given_back(kubo):
    common = {"q0": 1.0, "p0": 0.0, "step": 1e-3, "paths": 8, "seed": 4, "threads": 1}
    common["observables"] = {"square": lambda q, p: (q * q)[0]}  # the function gets several saved times at once
    with pytest.raises(KeyboardInterrupt) as caught:
        ss.moments(kubo, steps=10**9, save_every=10**5, progress=stopping(signal.SIGINT), **common)
    found = caught.value.partial
    reached = int((found.n_ok == 8).sum())
    assert found.report.stopped == 8 and (found.n_ok[reached:] == 0).all() and reached >= 1
    known = ss.moments(kubo, steps=10**5 * (reached - 1), save_every=10**5, **common)
    np.testing.assert_array_equal(found.mean_q[:reached], known.mean_q)
    np.testing.assert_array_equal(found.n_ok[:reached], known.n_ok)
    np.testing.assert_array_equal(found.mean["square"][:reached], known.mean["square"])


def test_what_progress_raises_carries_the_run(kubo):
    def progress(done, total):
        raise RuntimeError("planted")

    with pytest.raises(RuntimeError, match="planted") as caught:
        ss.simulate(kubo, paths=10, progress=progress, **LONG)
    assert (caught.value.partial.q[0] == 1).all()


@pytest.mark.parametrize(("function", "result"), [(ss.simulate, ss.Run), (ss.moments, ss.Moments)])
def test_what_stops_before_the_run_begins_carries_nothing(function, result, kubo, monkeypatch):
    monkeypatch.setattr(result, "fill", lambda *_: raises(0, None))
    with pytest.raises(HandledError) as caught:
        function(kubo, paths=3, **LONG)
    assert caught.value.partial is None


@pytest.mark.parametrize("times", [10**5, 2 * 10**6])
def test_moments_with_many_saved_times_show_progress_and_stop(times, kubo):
    """Blocks report steps before they are done, and saved times that no path has reached are returned without work.

    Blocks of few times may be done before the third report.
    """
    told = []

    def progress(done, total):
        told.append((done, total))
        return len(told) == 3

    found = ss.moments(kubo, q0=1.0, p0=0.0, step=1e-3, steps=times, paths=10**6, threads=1, progress=progress)
    assert len(told) == 3 and told[0][0] < told[2][0] < told[2][1] == times * 10**6
    assert found.report.outcome == "stopped on request"
    assert found.n_ok[-1] * times <= told[2][0] and (found.n_ok[-1] == 0 or times == 10**5)
    assert (np.isnan(found.mean_q[-1]) == (found.n_ok[-1] == 0)).all()
    assert 0 < found.n_ok[0] <= 10**6


def test_each_run_is_told_of_its_own_progress(kubo):
    """A progress function that runs the library itself: each function gets the progress of its own run alone, and may
    stop this run."""
    told = {"outer": set(), "inner": set()}

    def inner(done, total):
        told["inner"].add(total)
        return True

    def outer(done, total):
        told["outer"].add(total)
        part = ss.simulate(kubo, progress=inner, **LONG)
        assert part.status.tolist() == [5]
        return len(told["outer"]) > 0

    run = ss.simulate(kubo, paths=2, progress=outer, **LONG)
    assert run.report.stopped == 2
    assert told == {"outer": {2 * LONG["steps"]}, "inner": {LONG["steps"]}}


def test_no_result_waits_for_the_garbage_collector(kubo):
    """Arrays of a dropped result are freed at once."""
    gc.disable()
    try:
        for function in (ss.simulate, ss.moments):
            result = function(kubo, q0=1.0, p0=0.0, step=0.1, steps=10)
            seen = weakref.ref(result)
            del result
            assert seen() is None
    finally:
        gc.enable()


@pytest.mark.parametrize(
    ("scheme", "options"),
    [
        ("midpoint_areas", {"refine": 12, "paths": 64}),
        ("midpoint_areas", {"refine": 12, "paths": 300, "threads": 2}),
        ("midpoint_areas", {"refine": 15}),
        ("midpoint", {"refine": 30, "paths": 64}),
        ("midpoint", {"refine": 30, "paths": 2}),
        ("midpoint_weak1", {"refine": 30}),
        ("gauss2_strong32", {"refine": 30}),
    ],
)
def test_a_step_whose_draws_take_an_hour_can_be_left(scheme, options):
    """A step that is left unfinished is discarded: paths keep their states."""
    told = []
    run = ss.simulate(
        ss.models.kubo() if scheme == "gauss2_strong32" else ss.models.noncommutative_oscillator(),
        q0=1.0, p0=0.5, step=0.1, steps=4, scheme=scheme, progress=lambda *given: not told.append(given), **options,
    )  # fmt: skip
    assert told[0] == (0, 4 * run.setup.paths)
    assert run.report.stopped == run.setup.paths and (run.failed_step == 0).all()
    assert run.q[0, 0, 0] == 1.0 and np.isnan(run.q[1:]).all() and (run.last_p == 0.5).all()


@pytest.mark.parametrize(
    ("scheme", "refine", "paths"),
    [("midpoint", 8, 64), ("midpoint", 12, 2), ("gauss2_strong32", 6, 64), ("midpoint_weak1", 8, 64)],
)
def test_draws_that_were_left_are_not_counted(kubo, scheme, refine, paths):
    """Wherever a run is stopped, its normals are those of the pairs of steps that its paths began."""
    options = {"q0": 0.3, "p0": 0.1, "step": 0.1, "scheme": scheme, "paths": paths, "refine": refine, "threads": 1}
    of_pair = ss.simulate(kubo, steps=2, **options).report.counters["normals"] // paths
    long = {"steps": 4_000_000, "save_every": 4_000_000, **options}
    run = ss.simulate(kubo, progress=lambda done, total: done > 0, **long)
    assert run.report.stopped == paths and (run.failed_step > 0).all()
    assert run.report.counters["path_steps"] == run.failed_step.sum()
    assert run.report.counters["normals"] == ((run.failed_step + 1) // 2).sum() * of_pair


@pytest.mark.parametrize("refine", [12, 15])
def test_increments_that_take_an_hour_can_be_left(refine):
    model = ss.models.noncommutative_oscillator()
    with sent(signal.SIGINT), pytest.raises(KeyboardInterrupt):
        ss.increments(model, step=0.1, steps=4, paths=64, refine=refine, scheme="midpoint_areas")
