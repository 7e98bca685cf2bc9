# SPDX-License-Identifier: BSD-3-Clause
"""Streaming observers: their results agree with saved paths and have the same bits in any blocks and parts."""

import contextlib
import math
import pickle

import numpy as np
import pytest
import symsde as ss
from symsde import observe
from symsde.errors import InvalidArgumentError, SymsdeError, UnknownNameError, WrongTypeError
from symsde.run.observers import partial_statistics

RUN = {"q0": [0.1, 0.2], "p0": [0.1, 0.0], "step": 0.1, "steps": 120, "save_every": 20, "paths": 700, "seed": 3}
OBSERVERS = {
    "x": observe.Histogram("q_1", -0.4, 0.3, 14),
    "energy": observe.Quantiles("energy", (0.0, 0.1, 0.5, 0.9, 1.0), low=1e-3, high=10.0, parts=128),
    "cov": observe.Covariance(("q_1", "p_2", "energy")),
    "along": observe.Autocorrelation("q_2", lags=4, about=0.01),
    "far": observe.Extremes("p_1"),
    "loss": observe.Passage("q_1", within=0.4, absorb=False),
    "some": observe.Paths((0, 256, 699)),
}


def model():
    return ss.models.henon_heiles(sigma1=0.07, sigma2=0.05)


@pytest.fixture(scope="module")
def found():
    return ss.moments(model(), observers=OBSERVERS, **RUN)


@pytest.fixture(scope="module")
def run():
    """The same paths with all states saved; none fails."""
    saved = ss.simulate(model(), **RUN)
    assert saved.report.failed == 0
    return saved


def test_histogram(found, run):
    x = found.observed["x"]
    for i, q in enumerate(run.q[:, 0]):
        np.testing.assert_array_equal(x.counts[i], np.histogram(q[q < 0.3], x.edges)[0])
    np.testing.assert_array_equal(x.below, (run.q[:, 0] < -0.4).sum(axis=1))
    np.testing.assert_array_equal(x.above, (run.q[:, 0] >= 0.3).sum(axis=1))
    assert x.below.sum() > 20 and x.above.sum() > 20 and not x.not_a_number.any()
    share = x.counts / 700
    np.testing.assert_allclose(x.share, share, rtol=1e-15)
    np.testing.assert_allclose(x.se_share, np.sqrt(share * (1 - share) / 700), rtol=1e-14)
    np.testing.assert_allclose(x.density * 0.05, share, rtol=1e-12)


def test_quantiles(found, run):
    energy = found.observed["energy"]
    values = np.sort([model().value(q, p) for q, p in zip(run.q, run.p, strict=True)], axis=1)
    exact = np.array([values[:, max(math.ceil(700 * s) - 1, 0)] for s in energy.shares]).T
    exact[np.abs(exact) > 10] = np.nan  # one path has escaped: its rank lies below all bins
    np.testing.assert_allclose(energy.quantile, exact, rtol=1 / 256)
    assert energy.below[-1] == 1 and np.isnan(exact).sum() == 1 == np.isnan(energy.se_quantile).sum()
    known = np.isfinite(exact)
    assert (np.abs(energy.quantile - exact)[known] <= energy.se_quantile[known]).all()
    assert (np.diff(energy.edges) > 0).all() and energy.counts.sum() == values.size - 1
    for i in range(len(run.t)):
        np.testing.assert_array_equal(energy.counts[i], np.histogram(values[i], energy.edges)[0])


def test_errors_of_quantiles_are_those_of_a_sample():
    """The median of n normals has the error 1.2533/sqrt(n): the reported error agrees, to the width of bins."""
    phases = np.random.default_rng(2).standard_normal(4096)
    median = {"median": observe.Quantiles("q_1", (0.5,), low=1e-4, high=100, parts=1024)}
    still = ss.moments(ss.models.pendulum(), q0=phases[None], p0=0.0, step=0.1, steps=0, paths=4096, observers=median)
    told = still.observed["median"].se_quantile[0, 0]
    assert 0.7 < told / (math.sqrt(math.pi / 2) / 64) < 1.4  # the distance of ranks has an error, too


def test_covariance(found, run):
    cov = found.observed["cov"]
    energy = [model().value(q, p) for q, p in zip(run.q, run.p, strict=True)]
    values = np.stack([run.q[:, 0], run.p[:, 1], energy], axis=1)  # (time, value, path)
    np.testing.assert_array_equal(cov.n, 700)
    deviation = values - values.mean(axis=2, keepdims=True)
    products = deviation[:, :, None] * deviation[:, None, :]
    np.testing.assert_allclose(cov.covariance, products.sum(axis=3) / 699, rtol=1e-11, atol=1e-30)
    np.testing.assert_allclose(cov.se_covariance, products.std(axis=3) / math.sqrt(700), rtol=1e-10, atol=1e-30)
    np.testing.assert_allclose(cov.correlation[1:], [np.corrcoef(x) for x in values[1:]], rtol=1e-11)
    np.testing.assert_allclose(cov.mean, values.mean(axis=2), rtol=1e-12)
    np.testing.assert_allclose(cov.covariance[:, 0, 0], found.var_q[:, 0], rtol=1e-11, atol=1e-30)


def test_autocorrelation(found, run):
    along = found.observed["along"]
    x = run.q[:, 1]  # (time, path)
    ntime = len(x)
    mean = x.mean()
    c = np.array([((x[lag:] - mean) * (x[: ntime - lag] - mean)).mean() for lag in range(5)])
    np.testing.assert_allclose(along.covariance, c, rtol=1e-9)
    np.testing.assert_allclose(along.correlation, c / c[0], rtol=1e-9)
    np.testing.assert_allclose(along.lag, 2.0 * np.arange(5), rtol=1e-14)
    of_path = np.array([((x[lag:] - mean) * (x[: ntime - lag] - mean)).mean(axis=0) for lag in range(5)])
    np.testing.assert_allclose(along.se_covariance, of_path.std(axis=1, ddof=1) / math.sqrt(700), rtol=1e-8)
    rest = of_path - (c / c[0])[:, None] * of_path[0]
    error = rest.std(axis=1, ddof=1) / math.sqrt(700) / c[0]
    np.testing.assert_allclose(along.se_correlation, error, rtol=1e-6, atol=1e-9)
    assert along.n == 700 and abs(along.mean - mean) < 1e-14


def test_autocorrelation_of_a_rotation():
    """q = cos(w t + phase) with equally spaced phases: C(l) = cos(w l)/2 for every window, to rounding."""
    phases = 2 * np.pi * np.arange(64) / 64
    about = {"along": observe.Autocorrelation("q_1", lags=30)}
    run = {"q0": np.cos(phases)[None], "p0": np.sin(phases)[None], "step": 0.1, "steps": 200, "paths": 64}
    along = ss.moments(ss.models.kubo(a=1.0, sigma=0.0), observers=about, **run).observed["along"]
    omega = 2 * math.atan(0.05) / 0.1  # the midpoint's frequency
    np.testing.assert_allclose(along.covariance, np.cos(omega * along.lag) / 2, atol=1e-13)
    assert np.abs(along.covariance - np.cos(along.lag) / 2).max() > 1e-4  # the twin: the equation's own frequency


def test_extremes(found, run):
    far = found.observed["far"]
    low, high = np.minimum.accumulate(run.p[:, 0]), np.maximum.accumulate(run.p[:, 0])
    for values, mean, error in (
        (low, far.mean_lowest, far.se_mean_lowest),
        (high, far.mean_highest, far.se_mean_highest),
    ):
        np.testing.assert_allclose(mean, values.mean(axis=1), rtol=1e-12)
        np.testing.assert_allclose(error[1:], values.std(axis=1, ddof=1)[1:] / math.sqrt(700), rtol=1e-11, atol=1e-16)
    at = np.unravel_index(run.p[:, 0].argmin(), run.p[:, 0].shape)
    assert far.lowest == (run.p[:, 0].min(), at[1], run.t[at[0]])
    at = np.unravel_index(run.p[:, 0].argmax(), run.p[:, 0].shape)
    assert far.highest == (run.p[:, 0].max(), at[1], run.t[at[0]])


@pytest.mark.parametrize(("low", "high"), [(0.0, 1.0), (-0.7, 0.3), (1e-3, 0.9), (-1 / 3, 1e6)])
@pytest.mark.parametrize("bins", [1, 3, 10, 49, 1000])
def test_an_edge_belongs_to_the_bin_that_it_begins(low, high, bins):
    """An edge belongs to the bin that it begins, exactly, whatever the rounding of its quotient; the next smaller
    number belongs to the bin before.
    """
    found = []
    wanted = {"x": observe.Histogram("q_1", low, high, bins)}
    edges = low + np.arange(bins + 1) * ((high - low) / bins)
    edges[-1] = high
    for q0 in (edges, np.nextafter(edges, -np.inf)):
        start = {"q0": q0[np.newaxis], "p0": 0.0, "step": 0.1, "steps": 0, "paths": bins + 1}
        x = ss.moments(ss.models.kubo(), observers=wanted, **start).observed["x"]
        np.testing.assert_array_equal(x.edges, edges)
        np.testing.assert_array_equal(x.counts[0], 1)
        found.append((x.below[0], x.above[0]))
    assert found == [(0, 1), (1, 0)]


def test_equal_extremes_are_those_of_the_lowest_path_and_earliest_time():
    still = {"q0": 0.0, "p0": 0.0, "step": 0.1, "steps": 40, "paths": 600, "threads": 2, "lanes": 8}
    far = ss.moments(ss.models.kubo(), observers={"far": observe.Extremes("q_1")}, **still).observed["far"]
    assert far.lowest == far.highest == (0.0, 0, 0.0)


def first_steps_outside(x, a):
    """Index of the first step at which each path is outside, -1 = never: x (step, path)."""
    outside = np.abs(x) >= a
    return np.where(outside.any(axis=0), outside.argmax(axis=0), -1)


def test_passage(found):
    every = ss.simulate(model(), **{**RUN, "save_every": 1})
    when = first_steps_outside(every.q[:, 0], 0.4)
    loss = found.observed["loss"]
    assert loss.n == (when >= 0).sum() > 50 and loss.bridged is None
    listed = np.flatnonzero(when >= 0)
    np.testing.assert_array_equal(loss.path, listed)
    np.testing.assert_array_equal(loss.step, when[listed])
    states = [[every.t[n], *every.q[n, :, i], *every.p[n, :, i]] for i, n in zip(listed, when[listed], strict=True)]
    np.testing.assert_array_equal(loss.state, states)
    np.testing.assert_allclose(list(loss.mean.values()), np.mean(states, axis=0), rtol=1e-12)
    np.testing.assert_allclose(
        list(loss.se_mean.values()), np.std(states, axis=0, ddof=1) / math.sqrt(loss.n), rtol=1e-11
    )
    for i, n in enumerate(range(0, 121, 20)):
        until = (when >= 0) & (when <= n)
        assert loss.there[i] == 700 - until.sum()
        assert loss.lost[i] == pytest.approx(until.sum() / 700, rel=1e-14)
        assert loss.se_lost[i] == pytest.approx(math.sqrt(until.mean() * (1 - until.mean()) / 700), rel=1e-12)
    below = sum(every.q[when[i], 0, i] <= -0.4 for i in listed)
    assert loss.count[:, 0].sum() == below and loss.count[:, 1].sum() == loss.n - below


def test_absorbed_paths_count_nowhere_afterwards(run):
    every = ss.simulate(model(), **{**RUN, "save_every": 1})
    when = first_steps_outside(every.q[:, 0], 0.4)
    there = np.array([(when < 0) | (when > n) for n in range(0, 121, 20)])
    wanted = {"loss": observe.Passage("q_1", within=0.4), "x": OBSERVERS["x"], "some": observe.Paths(range(700))}
    found = ss.moments(model(), observers=wanted, **RUN)
    np.testing.assert_array_equal(found.n_ok, there.sum(axis=1))
    np.testing.assert_array_equal(found.observed["loss"].there, there.sum(axis=1))
    np.testing.assert_allclose(found.mean_q[:, 0], np.where(there, run.q[:, 0], 0).sum(axis=1) / there.sum(axis=1))
    inside = there & (np.abs(run.q[:, 0] + 0.05) < 0.35)
    np.testing.assert_array_equal(found.observed["x"].counts.sum(axis=1), inside.sum(axis=1))
    values = found.observed["some"].values  # (path, time, value)
    np.testing.assert_array_equal(values[:, :, 0], np.where(there, run.q[:, 0], np.nan).T)
    assert found.report.failed == 0 and found.report.status == 0 and len(found.failed) == 0
    assert found.report.counters["path_steps"] <= 700 * 120


def test_a_run_ends_when_all_paths_are_absorbed():
    """A free flight q = t leaves |q| < 1 at step 10 of 1000000: the remaining steps cost nothing."""
    flight = ss.Model(ndof=1, nnoise=0, gradient=lambda t, w, q, p: (0 * q, w[0] * p), value=None, separable=True)
    loss = {"loss": observe.Passage("q_1", within=1.0)}
    run = {"q0": 0.0, "p0": 1.0, "step": 0.1, "steps": 1_000_000, "paths": 20, "save_every": 1000}
    found = ss.moments(flight, observers=loss, scheme="symplectic_euler", **run)
    assert found.observed["loss"].n == 20 and set(found.observed["loss"].step) <= {10, 11}
    assert found.report.counters["path_steps"] <= 20 * 11


def brownian():
    """dq = 2 dW, which every scheme solves exactly."""
    return ss.Model(
        ndof=1,
        nnoise=1,
        gradient=lambda t, w, q, p: (np.zeros_like(q), 2 * w[1] + 0 * p),
        separable=True,
        additive=True,
        any_lanes=True,
    )


@pytest.mark.parametrize("barrier", [1.0, 3.0])
def test_passage_of_brownian_motion(barrier):
    """P(max of 2 W on (0, 1) >= a) = erfc(a/(2 sqrt 2)), with steps of 1/4 as with small ones; 5 sigma: 6e-7.

    The twin without bridges is off by a third.
    """
    run = {"q0": 0.0, "p0": 0.0, "step": 0.25, "steps": 4, "paths": 20000, "scheme": "symplectic_euler"}
    exact = math.erfc(barrier / (2 * math.sqrt(2)))
    wanted = {
        "with": observe.Passage("q_1", high=barrier, absorb=False),
        "without": observe.Passage("q_1", high=barrier, absorb=False, bridge=False),
    }
    found = ss.moments(brownian(), observers=wanted, **run).observed
    assert abs(found["with"].lost[-1] - exact) < 5 * found["with"].se_lost[-1] < 0.02
    assert abs(found["without"].lost[-1] - exact) > 15 * found["without"].se_lost[-1]
    assert found["with"].bridged > 1000 and found["without"].bridged is None
    below = ss.moments(brownian(), observers={"low": observe.Passage("q_1", low=-barrier)}, **run).observed["low"]
    assert abs(below.lost[-1] - exact) < 5 * below.se_lost[-1] and (below.lost_above == 0).all()


def test_bridges_are_told_absent_where_no_noise_acts():
    """Noise in position acts on momenta alone, so a passage of q mentions no missing bridges; a passage of the energy
    does.
    """
    wanted = {of: observe.Passage(of, within=5.0) for of in ("q_1", "p_1", "energy")}
    found = ss.moments(model(), observers=wanted, **RUN).observed
    assert found["q_1"].bridged is None and found["p_1"].bridged == 0 and found["energy"].bridged is None


def test_bridges_of_momenta():
    """dp = -2 dW by noise linear in q: p has the same law of passages."""
    turned = ss.Model(
        ndof=1, nnoise=1, gradient=lambda t, w, q, p: (2 * w[1] + 0 * q, np.zeros_like(p)), separable=True,
        additive=True, position_noise=True,
    )  # fmt: skip
    run = {"q0": 0.0, "p0": 0.0, "step": 0.25, "steps": 4, "paths": 20000, "scheme": "symplectic_euler"}
    high = ss.moments(turned, observers={"high": observe.Passage("p_1", high=1.0)}, **run).observed["high"]
    assert abs(high.lost[-1] - math.erfc(1 / (2 * math.sqrt(2)))) < 5 * high.se_lost[-1] and high.bridged > 1000


def test_chosen_paths(found, run):
    some = found.observed["some"]
    assert some.names == ("q_1", "q_2", "p_1", "p_2")
    for i, path in enumerate((0, 256, 699)):
        np.testing.assert_array_equal(some.values[i, :, :2], run.q[:, :, path])
        np.testing.assert_array_equal(some.values[i, :, 2:], run.p[:, :, path])


def bits(found):
    return {name: (part.counts.tobytes(), part.sums.tobytes()) for name, part in found.kept.items()}


@pytest.mark.parametrize(("lanes", "threads"), [(8, 1), (8, 3), (24, 2), (64, 1), (256, 2), (1000, 1)])
def test_bits_do_not_depend_on_blocks_and_threads(lanes, threads, found):
    other = ss.moments(model(), observers=OBSERVERS, lanes=lanes, threads=threads, **RUN)
    assert bits(other) == bits(found)


@pytest.mark.parametrize("absorb", [False, True])
def test_parts_merge_to_the_bits_of_the_whole(absorb):
    """The parts are three units of 256 paths and a part of one, with failed paths, and are merged from the right or
    from the left."""
    start = np.full((2, 1000), 0.1)
    start[:, 300:310] = 30.0
    how = {**RUN, "paths": 1000, "scheme": "stormer_verlet"}
    wanted = {**OBSERVERS, "loss": observe.Passage("q_1", within=0.4, absorb=absorb)}
    failing = contextlib.nullcontext() if absorb else pytest.warns(ss.PathsFailedWarning)  # absorbed at once
    with failing:
        whole = ss.moments(model(), observers=wanted, **{**how, "q0": start})
    parts = []
    for first in range(0, 1000, 256):
        here = {**how, "q0": start[:, first : first + 256], "first_path": first, "paths": min(256, 1000 - first)}
        with pytest.warns(ss.PathsFailedWarning) if first == 256 and not absorb else contextlib.nullcontext():
            parts.append(ss.moments(model(), observers=wanted, **here))
    for name, observer in wanted.items():
        left, right = parts[0].kept[name].copy(), parts[2].kept[name].copy()
        partial_statistics.merge(whole.scope, observer, right, parts[3].kept[name])
        partial_statistics.merge(whole.scope, observer, left, parts[1].kept[name])
        partial_statistics.merge(whole.scope, observer, left, right)
        np.testing.assert_array_equal(left.counts, whole.kept[name].counts, err_msg=name)
        np.testing.assert_array_equal(left.sums, whole.kept[name].sums, err_msg=name)


def test_observables_of_ones_own_are_observed():
    """Python observables wait for several saved times while steps are watched; their results equal those of q
    itself.
    """
    own = {"x": lambda q, p: q[0] + 0, "r": lambda q, p: np.hypot(q[0], q[1])}
    wanted = {
        "own": observe.Histogram("x", -0.4, 0.3, 14),
        "q": OBSERVERS["x"],
        "both": observe.Covariance(("q_1", "x", "r")),
        "far": observe.Extremes("x"),
        "far_q": observe.Extremes("q_1"),
        "loss": observe.Passage("q_1", within=0.4, absorb=False),
    }
    found = ss.moments(model(), observables=own, observers=wanted, **RUN)
    assert bits(found)["own"] == bits(found)["q"] and bits(found)["far"] == bits(found)["far_q"]
    cov = found.observed["both"].covariance
    np.testing.assert_array_equal(cov[:, 0, 0], cov[:, 1, 1])
    plain = ss.moments(model(), observers={"loss": wanted["loss"]}, **RUN)
    assert bits(plain)["loss"] == bits(found)["loss"]


def test_moments_do_not_change_when_steps_are_watched(found):
    plain = ss.moments(model(), **RUN)
    for kind in ("mean_q", "mean_p", "mean_energy", "var_q", "m2"):
        np.testing.assert_array_equal(getattr(found, kind), getattr(plain, kind), err_msg=kind)


def test_results_can_be_pickled(found):
    again = pickle.loads(pickle.dumps(found))
    assert bits(again) == bits(found)
    np.testing.assert_array_equal(again.observed["x"].share, found.observed["x"].share)
    assert "histogram of q_1" in repr(found.observed["x"])


def test_integers_are_numbers_however_large():
    found = ss.moments(model(), observers={"far": observe.Histogram("q_1", 10**30, 2 * 10**30, 4)}, **RUN)
    np.testing.assert_array_equal(found.observed["far"].edges, np.linspace(1e30, 2e30, 5))
    found = ss.moments(model(), observers={"far": observe.Quantiles("q_1", high=2**70)}, **RUN)
    assert found.observed["far"].edges[-1] == 2.0**70


@pytest.mark.parametrize(
    ("observer", "error", "said"),
    [
        (observe.Histogram("q_3", 0, 1, 5), UnknownNameError, "'q_3'.*there are q_2"),
        (observe.Histogram("q_1", 1, 0, 5), InvalidArgumentError, "no width"),
        (observe.Histogram("q_1", 0, math.inf, 5), InvalidArgumentError, "finite"),
        (observe.Histogram("q_1", 0, math.nan, 5), InvalidArgumentError, "no width"),
        (observe.Histogram("q_1", 0, 1, 0), InvalidArgumentError, "bins = 0"),
        (observe.Histogram("q_1", 0, 1, 10**6 + 1), InvalidArgumentError, "1000000"),
        (observe.Histogram("q_1", 0, 1, 2.5), WrongTypeError, "bins = 2.5"),
        (observe.Histogram(3, 0, 1, 5), WrongTypeError, "give a string"),
        (observe.Quantiles("q_1", (0.5, 1.1)), InvalidArgumentError, "between 0 and 1"),
        (observe.Quantiles("q_1", low=0.0), InvalidArgumentError, "smallest magnitude"),
        (observe.Quantiles("q_1", parts=100), InvalidArgumentError, "power of two"),
        (observe.Covariance(()), InvalidArgumentError, "0 values"),
        (observe.Covariance(5), WrongTypeError, "no list"),
        (observe.Autocorrelation("q_1", lags=7), InvalidArgumentError, "give 0 to 6"),
        (observe.Autocorrelation("q_1", lags=-1), InvalidArgumentError, "lags = -1"),
        (observe.Autocorrelation("q_1", lags=1, about=math.inf), InvalidArgumentError, "near the mean"),
        (observe.Passage("q_1", 1.0, 1.0), InvalidArgumentError, "nothing lies between"),
        (observe.Passage("q_1", within=-1.0), InvalidArgumentError, "positive"),
        (observe.Passage("q_1", low=0.0, within=1.0), InvalidArgumentError, "in the place of"),
        (observe.Paths(()), InvalidArgumentError, "no path is chosen"),
        (observe.Paths((-1,)), InvalidArgumentError, "paths = -1"),
        (observe.Paths(2.5), WrongTypeError, "paths = 2.5 is not a whole number"),
        ("histogram", WrongTypeError, "symsde.observe"),
    ],
)
def test_what_cannot_be_observed_is_refused(observer, error, said):
    with pytest.raises(error, match=said):
        ss.moments(model(), observers={"it": observer}, **RUN)


@pytest.mark.parametrize("given", [[OBSERVERS["x"]], {"a b": OBSERVERS["x"]}, {3: OBSERVERS["x"]}])
def test_names_of_observers(given):
    with pytest.raises(SymsdeError, match=r"dict of names|letters, digits"):
        ss.moments(model(), observers=given, **RUN)


def test_values_that_are_no_number_are_told():
    own = {"bad": lambda q, p: np.where(q[0] > 0.1, np.nan, np.where(q[1] > 0.2, np.inf, -np.inf))}
    wanted = {"h": observe.Histogram("bad", -1, 1, 4), "s": observe.Quantiles("bad", (0.5,))}
    found = ss.moments(model(), observables=own, observers=wanted, **RUN).observed
    for name in "hs":
        one = found[name]
        assert (one.below + one.above + one.not_a_number == 700).all() and one.not_a_number[1:].all()
        assert one.below[-1] > 0 and one.above[-1] > 0


def test_values_may_be_called_as_observables_are():
    """q1 is q_1, and so is q with one degree of freedom; with two, q is unknown."""
    kubo, start = ss.models.kubo(), {"q0": 1.0, "p0": 0.3, "step": 0.1, "steps": 4, "paths": 20}
    named = {
        "x": (observe.Histogram("q", -2, 2, 9), observe.Histogram("q_1", -2, 2, 9)),
        "y": (observe.Covariance(("p", "q1")), observe.Covariance(("p_1", "q_1"))),
        "z": (observe.Paths((3,), of="p"), observe.Paths((3,), of="p_1")),
    }
    short, full = (
        ss.moments(kubo, observers={key: both[i] for key, both in named.items()}, **start).observed for i in range(2)
    )
    for name, result in short.items():
        assert repr(result) == repr(full[name])
        np.testing.assert_array_equal(result.kept.counts, full[name].kept.counts)
        np.testing.assert_array_equal(result.kept.sums, full[name].kept.sums)
    with pytest.raises(UnknownNameError, match="histogram of 'q': there is no such value"):
        ss.moments(model(), observers={"x": observe.Histogram("q", -2, 2, 9)}, **{**RUN, "steps": 20})
    two = ss.moments(model(), observers={"x": observe.Extremes("p2")}, **{**RUN, "steps": 20})
    assert repr(two.observed["x"]).startswith("<extremes of p_2")
