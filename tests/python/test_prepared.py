# SPDX-License-Identifier: BSD-3-Clause
"""A prepared run has the bits of simulate in any number of calls, whatever the caller does between them."""

import gc
import threading
import time
import warnings

import numpy as np
import pytest
import symsde as ss

WHERE = {"q0": 0.3, "p0": 0.1, "step": 0.02, "seed": 3}


@pytest.fixture
def model():
    """A model with two noises."""
    return ss.models.synchrotron()


@pytest.mark.parametrize("scheme", ["midpoint", "stormer_verlet", "gauss2_strong32", "chin4a"])
@pytest.mark.parametrize(("threads", "lanes"), [(1, None), (1, 8), (2, 64)])
def test_calls_make_the_bits_of_one_run(model, scheme, threads, lanes):
    """Single steps, saved steps and single steps again give one run, also from an odd step and path."""
    how = {"scheme": scheme, "paths": 77, "first_path": 5, "first_step": 3, "t0": 1.0, **WHERE}
    whole = ss.simulate(model, steps=37, **how)
    run = ss.prepare(model, threads=threads, lanes=lanes, **how)
    for _ in range(5):
        run.step()
    middle = run.run(30, save_every=10)
    for _ in range(2):
        run.step()
    assert np.array_equal(run.q, whole.q[-1]) and np.array_equal(run.p, whole.p[-1])
    assert np.array_equal(middle.q, whole.q[5:36:10]) and np.array_equal(middle.t, whole.t[5:36:10])
    assert run.next_step == 40 and run.t == whole.t[-1]
    assert run.report.counters["path_steps"] == 77 * 37


@pytest.mark.parametrize("how", [{}, {"compensated": True}, {"refine": -1}, {"truncation": (2.0, 1.0)}])
def test_options_are_those_of_simulate(model, how):
    """Compensated sums continue with their low parts."""
    whole = ss.simulate(model, steps=20, paths=9, **WHERE, **how)
    run = ss.prepare(model, paths=9, **WHERE, **how)
    for _ in range(4):
        last = run.run(5)
    assert np.array_equal(last.q, whole.q[15:])
    if how.get("compensated"):
        assert np.array_equal(run.q_low, whole.q_low) and np.array_equal(last.p_low, whole.p_low)


def test_increments_of_the_host(model):
    """Increments may be given step by step, for all steps at once, or as one set for all paths."""
    dw = ss.increments(model, step=0.02, steps=10, paths=9, seed=3)
    run = ss.prepare(model, paths=9, **WHERE)
    for row in dw:
        run.step(row)
    whole = ss.simulate(model, steps=10, paths=9, **WHERE)
    assert np.array_equal(run.q, whole.q[-1])
    run.reset()
    assert np.array_equal(run.run(10, increments=dw).q, whole.q)
    run.reset()
    run.step([0.1, -0.2])
    alone, _ = ss.step(model, "midpoint", 0.3, 0.1, 0.02, [0.1, -0.2])
    assert np.array_equal(run.q, np.broadcast_to(alone, (1, 9)))
    finer = ss.prepare(model, "gauss2_strong32", paths=2, refine=1, **WHERE)
    rows = ss.increments(model, step=0.01, steps=6, paths=2, seed=3)
    assert np.array_equal(
        finer.run(3, increments=rows).q,
        ss.simulate(model, scheme="gauss2_strong32", steps=3, paths=2, refine=1, increments=rows, **WHERE).q,
    )


def test_the_state_is_the_hosts_between_steps(model):
    """The next step begins at states written into q and p; kept arrays outlive the run."""
    run = ss.prepare(model, "stormer_verlet", paths=3, **WHERE)
    run.run(4)
    run.q[...] = [[0.3, 0.2, 0.1]]
    run.p[0, 1] = 0.7
    p0 = run.p.copy()
    run.step()
    resumed = ss.simulate(
        model, scheme="stormer_verlet", q0=[[0.3, 0.2, 0.1]], p0=p0, step=0.02, seed=3, steps=1, paths=3, first_step=4
    )
    assert np.array_equal(run.q, resumed.q[-1])
    kept, values = run.q, run.q.copy()
    del run
    gc.collect()
    assert np.array_equal(kept, values)


@pytest.mark.parametrize("seed", [2, 3, 8, 2**64 - 1])  # below the earlier seed, equal, above, and negative if signed
def test_reset_begins_anew(model, seed):
    """A reset takes the given state or another one, and other paths, seed and step."""
    run = ss.prepare(model, paths=4, **WHERE)
    first = run.run(6)
    run.reset()
    assert np.array_equal(run.run(6).q, first.q)
    other = {"seed": seed, "first_path": 256, "first_step": 11}
    run.reset(0.5, [[0.1, 0.2, 0.3, 0.4]], **other)
    found = run.run(6)
    wanted = ss.simulate(model, q0=0.5, p0=[[0.1, 0.2, 0.3, 0.4]], step=0.02, steps=6, paths=4, **other)
    assert np.array_equal(found.q, wanted.q) and np.array_equal(found.path, wanted.path)
    assert np.array_equal(ss.diagnose.action(found), ss.diagnose.action(wanted))


def test_failed_paths_rest_until_reset():
    """One path overflows: it keeps its status, step and last good state; the other paths go on."""
    model = ss.models.henon_heiles()
    q0 = np.full((2, 3), 0.1)
    q0[:, 1] = 1e200
    run = ss.prepare(model, "stormer_verlet", q0=q0, p0=0.0, step=0.1, paths=3)
    with pytest.warns(ss.PathsFailedWarning, match="1 of 3 paths failed"):
        run.step()
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # warned once
        run.step()
        saved = run.run(2)
    assert run.status.tolist() == [0, 3, 0] and run.failed_step.tolist() == [-1, 0, -1]
    assert run.report.failed == 1 and np.array_equal(run.q[:, 1], q0[:, 1])
    assert np.isnan(saved.q[:, :, 1]).all() and np.isfinite(saved.q[:, :, [0, 2]]).all()
    alone = ss.simulate(model, scheme="stormer_verlet", q0=0.1, p0=0.0, step=0.1, steps=4)
    assert np.array_equal(run.q[:, 0], alone.q[-1, :, 0])
    run.reset(0.1)
    run.run(4)
    assert not run.status.any() and np.array_equal(run.q[:, 0], alone.q[-1, :, 0])
    run.reset(q0)
    with pytest.warns(ss.PathsFailedWarning, match="1 of 3 paths failed"):  # again after a reset
        run.step()


def test_warnings_show_where_the_run_was_called():
    for act in (lambda run: run.step(), lambda run: run.run(1)):
        run = ss.prepare(ss.models.henon_heiles(), "stormer_verlet", q0=1e200, p0=0.0, step=0.1)
        with pytest.warns(ss.PathsFailedWarning) as caught:
            act(run)
        assert caught[0].filename == __file__


def test_a_stopped_run_resumes():
    """With one block done, one unfinished and one not begun, the run is finished to the same bits after two stops."""

    def gradient(t, w, q, p):
        time.sleep(0.001 * slow)
        return w[0] * q, (w[0] + 0.3 * w[1]) * p

    slow = 0
    model = ss.Model(ndof=1, nnoise=1, gradient=gradient, separable=True)
    how = {"scheme": "symplectic_euler", "correction": "none", "paths": 24, "lanes": 8, **WHERE}
    whole = ss.simulate(model, steps=60, save_every=5, **how)
    run = ss.prepare(model, **how)
    slow = 1
    stopped = run.run(60, save_every=5, progress=lambda done, total: done > 480)
    slow = 0
    assert not run.status[:8].any() and (run.status[16:] == 5).all() and run.next_step == 60
    assert np.array_equal(stopped.q[:, :, :8], whole.q[:, :, :8]) and np.isnan(stopped.q[-1, :, 16:]).all()
    for refused in (run.step, lambda: run.run(1)):
        with pytest.raises(ss.errors.IncompatibleError, match=r"stopped on its way to step 60.*resume or reset"):
            refused()
    run.resume(progress=lambda done, total: True)  # stopped again
    assert run.status.any()
    resumed = run.resume()
    assert resumed is stopped and np.array_equal(resumed.q, whole.q) and np.array_equal(run.p, whole.p[-1])
    assert not resumed.status.any() and resumed.report.status == 0
    with pytest.raises(ss.errors.IncompatibleError, match="nothing to resume"):
        run.resume()
    run.step()
    assert run.next_step == 61


@pytest.mark.parametrize("ill", [0, 1])
def test_paths_that_a_stop_cut_short_have_not_failed(ill):
    """Warnings count only paths that failed, before the stop or in the call that finishes it, and are given once."""
    q0 = np.full((2, 3), 0.1)
    q0[:, :ill] = 1e200
    run = ss.prepare(ss.models.henon_heiles(), "stormer_verlet", q0=q0, p0=0.0, step=1e-3, paths=3)
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        for call in (lambda stop: run.run(10**7, 10**7, progress=stop), lambda stop: run.resume(progress=stop)):
            call(lambda done, total: True)
            assert run.status.tolist() == [3] * ill + [5] * (3 - ill)
    assert [str(x.message).partition(":")[0] for x in said] == [f"{ill} of 3 paths failed"] * ill


@pytest.mark.parametrize("ended", ["done", "stopped", "raised", "failed"])
def test_a_reset_ends_what_was_begun(ended):
    """However earlier calls ended, a reset run has the bits, counts and refusals of a new run, in single steps and
    in calls.
    """
    how = {"q0": np.full((2, 3), 0.1), "p0": 0.2, "step": 1e-3, "paths": 3, "seed": 3}
    run = ss.prepare(ss.models.henon_heiles(), "stormer_verlet", **how)

    def ends(done, total):
        if ended == "raised":
            raise KeyError("mine")
        return ended == "stopped"

    if ended == "failed":
        run.q[:, 1] = 1e200
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            steps = 10**7 if ended in {"stopped", "raised"} else 4
            run.run(steps, steps, progress=ends)
        except KeyError:
            pass
    assert run.status.any() == (ended != "done")
    run.reset()
    with pytest.raises(ss.errors.IncompatibleError, match="nothing to resume"):
        run.resume()
    assert run.next_step == 0 and run.t == 0.0 and not run.status.any() and (run.failed_step == -1).all()
    run.step()
    found = run.run(5)
    whole = ss.simulate(ss.models.henon_heiles(), scheme="stormer_verlet", steps=6, **how)
    assert np.array_equal(found.q, whole.q[1:]) and np.array_equal(found.t, whole.t[1:])
    assert found.report.status == 0 and found.report.failed == found.report.stopped == 0


def test_what_a_call_gave_stays_as_it_is(model):
    """Results of a call do not change through later steps, calls, written states, failures or a reset."""
    run = ss.prepare(model, paths=3, compensated=True, **WHERE)
    run.run(2)
    given = run.run(4, save_every=2)

    def told():
        names = ("q", "p", "t", "path", "status", "failed_step", "last_q", "last_p", "q_low", "p_low")
        return {x: np.array(getattr(given, x)) for x in names}, given.report, given.setup.q0.copy()

    before = told()
    assert np.array_equal(before[0]["last_q"], run.q) and np.array_equal(before[0]["p_low"], run.p_low)
    run.step()
    run.run(3)
    run.q[...] = run.p[...] = 1.79e308
    run.p_low[...] = 1.0
    with pytest.warns(ss.PathsFailedWarning):
        run.step()
    run.reset(0.7)
    np.testing.assert_equal(told(), before)


def test_interrupts_and_exceptions_leave_a_run_that_goes_on():
    """An exception of the progress function stops the run and is raised; the run can be resumed."""
    model = ss.models.kubo()

    def fail(done, total):
        raise KeyError("mine")

    run = ss.prepare(model, paths=40, lanes=8, threads=1, **WHERE)
    with pytest.raises(KeyError, match="mine") as caught:
        run.run(3_000, save_every=3_000, progress=fail)
    assert caught.value.partial is run.resume()
    whole = ss.simulate(model, steps=3_000, save_every=3_000, paths=40, **WHERE)
    assert np.array_equal(run.q, whole.q[-1])


def test_models_of_python_functions():
    """Python functions are probed once, their exceptions are raised, and they cannot step their own run."""
    calls = []

    def gradient(t, w, q, p):
        calls.append(t)
        if state["fail"]:
            raise OSError("from the gradient")
        if state["again"]:
            run.step()
        return w[0] * np.sin(q) + w[1] * np.cos(q), w[0] * p

    state = {"fail": False, "again": False}
    model = ss.Model(ndof=1, nnoise=1, gradient=gradient, separable=True, position_noise=True, identity_mass=True)
    run = ss.prepare(model, "stormer_verlet", q0=1.0, p0=0.0, step=0.1)
    probes = len(calls)
    run.step()
    assert 0 < len(calls) - probes < 5 < probes
    state["again"] = True
    with pytest.raises(ss.errors.IncompatibleError, match="at work in another call"):
        run.step()
    state.update(again=False, fail=True)
    run.reset()
    with pytest.raises(OSError, match="from the gradient"):
        run.step()
    state["fail"] = False
    run.reset()
    run.step()
    assert np.array_equal(run.q, ss.simulate(model, scheme="stormer_verlet", q0=1.0, p0=0.0, step=0.1, steps=1).q[-1])


def test_model_and_scheme_may_be_forgotten():
    """The run keeps model and scheme alive."""
    run = ss.prepare(ss.Model(ndof=1, nnoise=0, gradient=lambda t, w, q, p: (w * q, w * p)), q0=1.0, p0=0.0, step=0.1)
    gc.collect()
    run.step()
    assert run.q[0, 0] == pytest.approx((1 - 0.1**2 / 4) / (1 + 0.1**2 / 4), rel=1e-12)


def test_threads_have_runs_of_their_own(model):
    """Eight threads of the caller have runs at once; one run used by two threads refuses or serves them in turn."""
    wanted = ss.simulate(model, steps=50, paths=9, **WHERE).q[-1]
    found = []

    def work():
        run = ss.prepare(model, paths=9, threads=1, **WHERE)
        for _ in range(50):
            run.step()
        found.append(np.array_equal(run.q, wanted))

    workers = [threading.Thread(target=work) for _ in range(8)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    assert found == [True] * 8


@pytest.mark.parametrize(
    ("act", "words"),
    [
        (lambda run: run.step(np.nan), "not finite"),
        (lambda run: run.step([0.1, 0.2, 0.3]), "dw has shape"),
        (lambda run: run.run(-1), "steps = -1"),
        (lambda run: run.run(3, save_every=2), "multiple of save_every"),
        (lambda run: run.run(3, increments=np.zeros((2, 2))), "needed are 3 rows"),
        (lambda run: run.reset([1.0, 2.0]), "q0 has shape"),
        (lambda run: run.reset(np.inf), "not finite"),
        (lambda run: run.reset(q0_low=0.0, p0_low=0.0), "compensated"),
        (lambda run: run.reset(first_path=-1), "first_path = -1"),
        (lambda run: run.reset(seed=-1), "seed = -1"),
        (lambda run: run.q.__setitem__((0, 1), np.nan) or run.step(), "path 1.*not finite: it was changed"),
        (lambda run: ss.prepare(run.model, q0=0.0, p0=0.0, step=0.1, steps=3), "'steps' is no option of prepare"),
        (lambda run: ss.prepare(run.model, q0=0.0, p0=0.0, step=0.0), "step = 0"),
        (lambda run: ss.prepare(1, q0=0.0, p0=0.0, step=0.1), "not a model"),
    ],
)
def test_bad_input_is_refused_and_changes_nothing(model, act, words):
    """Bad input is refused, and the run goes on unchanged."""
    run = ss.prepare(model, paths=2, **WHERE)
    run.step()
    q = run.q.copy()
    with pytest.raises((ss.SymsdeError, ValueError), match=words):
        act(run)
    run.q[...] = q
    run.step()
    assert np.array_equal(run.q, ss.simulate(model, steps=2, paths=2, **WHERE).q[-1])
