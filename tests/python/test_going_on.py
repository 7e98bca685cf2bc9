# SPDX-License-Identifier: BSD-3-Clause
"""A run that continues another needs the noise of the following steps: `extend` uses it, and `simulate` warns if it may
be repeated."""

import warnings
from concurrent.futures import ProcessPoolExecutor

import numpy as np
import pytest
import symsde as ss
from symsde.errors import IncompatibleError, InvalidArgumentError, RepeatedNoiseWarning

NAMES = ("q", "p", "last_q", "last_p", "q_low", "p_low", "status", "failed_step")
RUN = {"q0": [0.1, 0.2], "p0": 0.05, "step": 0.05, "paths": 5, "seed": 3}
CASES = {
    "plain": {},
    "in the middle": {"t0": 0.3, "first_step": 7, "first_path": 11},
    "compensated": {"compensated": True},
    "sums of draws": {"refine": 2},
    "bridges": {"refine": -2},
    "common noise": {"common_noise": [2]},
    "truncated": {"truncation": (2, 1.0)},
    "with dZ": {"scheme": "chin4a", "refine": -1},
    "fixed point": {"fixed_point": 3, "general": True},
    "backwards": {"step": -0.05, "threads": 2},
}


def equal(end, whole, first):
    """Whether the run from a saved time on has the bits of the whole run."""
    np.testing.assert_array_equal(end.t, whole.t[first:])
    for name in NAMES:
        known = getattr(whole, name)
        if name in {"q", "p"}:
            known = known[first:]
        np.testing.assert_array_equal(getattr(end, name), known, err_msg=name)


@pytest.mark.parametrize("given", CASES.values(), ids=CASES)
@pytest.mark.parametrize("steps", [(9, 12), (6, 6, 9)])
def test_pieces_have_the_bits_of_one_run(given, steps):
    """The number of steps of a piece may be odd, although normals come in pairs, and there may be several pieces."""
    model = ss.models.henon_heiles(sigma1=0.1, sigma2=0.1)
    whole = ss.simulate(model, steps=sum(steps), save_every=3, **{**RUN, **given})
    run = ss.simulate(model, steps=steps[0], save_every=3, **{**RUN, **given})
    done = steps[0]
    for more in steps[1:]:
        first, run = done // 3, run.extend(more)
        equal(run, ss.simulate(model, steps=done + more, save_every=3, **{**RUN, **given}), first)
        done += more
    equal(run, whole, (done - steps[-1]) // 3)


@pytest.mark.parametrize("areas", ["path", "law"])
def test_areas_go_on(areas):
    model = ss.models.noncommutative_oscillator()
    given = {**RUN, "q0": 0.4, "scheme": "midpoint_areas", "areas": areas}
    equal(ss.simulate(model, steps=7, **given).extend(4), ss.simulate(model, steps=11, **given), 7)


def test_a_prepared_run_that_was_moved_goes_on_from_where_it_is():
    prepared = ss.prepare(ss.models.kubo(), step=0.1, q0=1.0, p0=0.0, paths=3, seed=4)
    prepared.step()
    prepared.p[...] *= 0.5
    run = prepared.run(4)
    equal(run.extend(6), prepared.run(6), 0)


def test_paths_that_failed_stay_failed():
    """Status, step and last good state of an escaped path stay, and it is counted."""
    q0 = np.full((2, 4), 0.1)
    q0[:, 2] = 0.75
    given = {"q0": q0, "p0": 0.0, "step": 0.05, "seed": 5, "scheme": "stormer_verlet", "paths": 4}
    model = ss.models.henon_heiles(sigma1=0.02, sigma2=0.02)
    with pytest.warns(ss.PathsFailedWarning):
        whole = ss.simulate(model, steps=700, **given)
        half = ss.simulate(model, steps=600, **given)
    assert half.failed_step[2] > 0 and half.status.tolist().count(0) == 3
    with pytest.warns(ss.PathsFailedWarning, match="1 path failed"):
        rest = half.extend(100)
    equal(rest, whole, 600)
    assert rest.report.failed == 1 and rest.report.outcome == whole.report.outcome


def test_other_savings_and_what_is_refused():
    model = ss.models.kubo()
    run = ss.simulate(model, q0=1.0, p0=0.0, step=0.1, steps=10, save_every=5)
    assert run.extend(20, save_every=10).t.tolist() == pytest.approx([1.0, 2.0, 3.0])
    with pytest.raises(InvalidArgumentError, match="steps = 12 is not a multiple of save_every = 5"):
        run.extend(12)
    with pytest.raises(InvalidArgumentError, match="steps = -5 is negative"):
        run.extend(-5)
    driven = ss.simulate(model, q0=1.0, p0=0.0, step=0.1, steps=2, increments=np.ones((2, 1)))
    with pytest.raises(IncompatibleError, match=r"prescribed increments.*first_step=2 and the next increments"):
        driven.extend(2)
    stopped = ss.simulate(model, q0=1.0, p0=0.0, step=0.1, steps=10**6, save_every=10**6, progress=lambda *_: True)
    with pytest.raises(IncompatibleError, match="was stopped before its end"):
        stopped.extend(2)


def piece(**given):
    """Arguments for the second half of a run, as a user might write them who gives times but no first_step."""
    first = ss.simulate(ss.models.kubo(), q0=1.0, p0=0.0, step=0.1, steps=10, paths=300)
    again = {"q0": first.q[-1], "p0": first.p[-1], "t0": first.t[-1], "step": 0.1, "steps": 10, "paths": 300}
    return {key: value for key, value in {**again, **given}.items() if value is not None}


@pytest.mark.parametrize("function", [ss.simulate, ss.moments, ss.ensemble])
@pytest.mark.parametrize("given", [{}, {"t0": 1.0}, {"p0": 0.5}, {"t0": -1.0, "step": -0.1}])
def test_repeated_noise_is_said(function, given):
    """One warning at the caller's line and in the report, which says what to give instead."""
    with pytest.warns(RepeatedNoiseWarning, match=r"first_step=10 and t0=0.*run\.extend\(steps\)") as said:
        found = function(ss.models.kubo(), **piece(**given))
    assert len(said) == 1 and said[0].filename == __file__
    assert any("is 10 steps after 0" in text for text in found.report.warnings)


QUIET = {
    "said": {"first_step": 10, "t0": 0.0},
    "another step": {"first_step": 5},
    "one state": {"q0": 1.0, "p0": np.array([0.5])},
    "one column": {"q0": [[1.0]], "p0": [[0.5]]},
    "at the beginning": {"t0": 0.0},
    "between steps": {"t0": 1.05},
    "before": {"t0": -1.0},
    "no steps": {"steps": 0},
}


@pytest.mark.parametrize("given", QUIET.values(), ids=QUIET)
@pytest.mark.parametrize("function", [ss.simulate, ss.moments])
def test_other_runs_are_not_warned(function, given):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert not function(ss.models.kubo(), **piece(**given)).report.warnings


def test_own_increments_and_no_noise_are_not_warned():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ss.simulate(ss.models.kubo(), **piece(increments=np.zeros((10, 1))))
        ss.simulate(ss.model_from_sympy("p**2/2 + q**2/2"), **piece())
        ss.expect(ss.models.kubo(), "q", q0=1.0, p0=0.0, t0=1.0, horizon=1.0, abs=0.3)
        ss.advise(ss.models.kubo(), q0=1.0, p0=0.0, t0=1.0, horizon=1.0, tolerance=0.3)
        ss.convergence(ss.models.kubo(), q0=np.ones((1, 40)), p0=0.0, t0=1.0, steps=[4, 8], paths=40)
        ss.step(ss.models.kubo(), "midpoint", np.ones((1, 3)), np.ones((1, 3)), 0.1, 0.2, t=1.0)


def test_shards_do_not_say_it_again():
    """An ensemble computed by another process warns once, in the calling process."""
    with ProcessPoolExecutor(1) as pool, pytest.warns(RepeatedNoiseWarning) as said:
        ss.ensemble(ss.models.kubo(), executor=pool, shard_paths=256, **piece())
    assert len(said) == 1
