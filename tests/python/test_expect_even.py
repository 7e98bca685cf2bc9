# SPDX-License-Identifier: BSD-3-Clause
"""Sobol points: their increments, levels and plans; and the bias that differences show."""

import itertools
import math

import numpy as np
import pytest
import symsde as ss
from symsde.answers.expectation import bias, choice, estimators
from symsde.answers.expectation.candidates import SHARPEST, suitable
from symsde.answers.expectation.estimators import Plain, Quasi
from symsde.answers.expectation.interval import BIAS_SHARE, Tally
from symsde.answers.expectation.problem import make_problem
from symsde.answers.expectation.trial import OF_JUMPS, USUAL, Even, Trial, _as_if_one_differed
from symsde.answers.linear_stability import stable_up_to
from symsde.schemes import as_scheme
from test_expect import FakeTrial, units


@pytest.fixture
def nonlinear():
    return ss.models.synchrotron(sigma1=0.8, sigma2=0.5)


def even_of(variances, *, level=0, path=1e-6, once=0.0, usual=USUAL):
    """A level with measured variances of units of 2^6 and 2^9 points by scrambling."""
    tallies = {points: Tally(8, 0.0, 7 * x) for points, x in zip((6, 9), variances, strict=True)}
    return Even(level, tallies, tallies, path, once, usual)


def test_sobol_points_end_at_2_to_the_30():
    """A measured variance that does not fall is taken to fall as 1/points; SciPy refuses more than 2^30 points. Falling
    by 8 each time gives a slope of 2.13, and six such falls one of 2.6."""
    trial = FakeTrial(0.25)
    trial.even = {0: even_of((1.0, 1.0))}
    assert points_of(trial, 0, 0, 2.0**-21) == [30] and points_of(trial, 0, 0, 2.0**-21.1) is None
    trial.even = {0: even_of((1.0, 2.0**-9))}
    assert points_of(trial, 0, 0, 2.0**-9 * 2.0**-4.25) == [11] and points_of(trial, 0, 0, 2.0**-9 * 2.0**-4.28) == [12]
    wide = {6: Tally(8, 0.0, 7.0), 12: Tally(8, 0.0, 7 * 2.0**-18)}
    assert even_of((1.0, 1.0)).fall(wide) == pytest.approx(2.614, abs=1e-3)


def points_of(trial, coarsest, finest, needed):
    """log2 of the points on each level, if the variances of the units may add up to `needed`."""
    found = choice._points(trial, coarsest, finest, math.sqrt(needed / 16 / (1 - BIAS_SHARE)))
    return found and found[2]


def test_points_are_doubled_where_variance_over_cost_is_largest():
    """Level 0 has variance 1 by 2^9 points, falling as points^-1.7; level 1 has 1/4, falling as points^-1.3; a point
    costs 1 us on level 0 and 30 us on level 1. From 2^5 points on the variances are 115 and 9, then 1 (2^9) and 3.7
    (2^6), and doubling level 0 is cheaper. Level 2 was not measured and gets a quarter of level 1's variance, as for
    paths."""
    trial = FakeTrial(0.25)
    trial.even = {0: even_of((64.0, 1.0), once=0.5), 1: even_of((2.0, 0.25), level=1, path=3e-5, once=0.25)}
    seconds, coarsest, points = choice._points(trial, 0, 1, math.sqrt(4.5 / 16 / 0.9))
    assert points == [10, 6] and coarsest == 0
    assert seconds == pytest.approx(0.75 + 16 * (1e-6 * 2**10 + 3e-5 * 2**6))
    assert points_of(trial, 0, 1, 1e-280) is None
    trial.spread = lambda level: 4.0**-level
    assert points_of(trial, 0, 2, 5.1) == [10, 6, 5]  # 0.31 + 3.66 + 1.11, which falls as points^-1.15
    assert points_of(trial, 0, 2, 5.0) == [10, 7, 5]
    del trial.even[1]
    assert points_of(trial, 0, 1, 4.5) is None


def test_points_of_an_f_that_jumps_gain_less():
    """Variance 1 by 2^6 points and 2^-4.5 by 2^9, each known to a half: a slope of 1.5 if f is smooth, of 1.27 if f
    jumps, which needs more points. If all scramblings agree, a jump may lie between their points, so one point is taken
    to have met it."""
    pytest.importorskip("scipy")
    smooth, jumping = (even_of((1.0, 2.0**-4.5), usual=usual) for usual in (USUAL, OF_JUMPS))
    assert smooth.fall(smooth.fine) == pytest.approx(1.5)
    assert jumping.fall(smooth.fine) == pytest.approx((1.5 * 8.01 + 1.1 * 11.11) / 19.12, abs=1e-3)
    model, place = ss.models.linear_oscillator(), {"q0": 1.0, "p0": 0.0, "horizon": 2.0}
    for f, usual in ((lambda q, p: q[0] > 0.5, 1.1), ("q", 1.5)):
        trial = Trial(make_problem(model, f, **place, threads=1), as_scheme("chin4a"), 2, 256)
        trial.look_at_points(0)
        assert trial.even[0].usual == usual
    same = _as_if_one_differed(Tally(8, 0.5, 0.0), 9, 0.25)
    assert same.variance == pytest.approx(0.25 / 8 / 2.0**18)
    assert _as_if_one_differed(Tally(8, 0.5, 7.0), 9, 0.25).variance == 1.0


@pytest.mark.parametrize(("scheme", "columns"), [("midpoint", 1), ("gauss_dkdkd", 2), ("chin4a", 3)])
def test_sobol_points_drive_what_a_scheme_takes(nonlinear, scheme, columns):
    """dW, dZ and K: the mean is that of independent paths within 4.5 standard errors (7e-6), the variance below a
    third of theirs. tests/mutants has dZ and K of the wrong size."""
    pytest.importorskip("scipy")
    problem = make_problem(nonlinear, "q**2", q0=1.0, p0=0.0, horizon=2.0)
    assert estimators.columns(problem, as_scheme(scheme)) == columns
    even = Quasi(problem, as_scheme(scheme), 2, 0, log2_points=11)
    assert even.dimension == 2 * 2 * columns
    even, plain = even.draw(24).units, units(Plain, problem, scheme, 2, 200_000)
    assert abs(even.mean - plain.mean) < 4.5 * math.hypot(plain.error, even.error)
    assert even.variance < plain.variance / 2**11 / 3


def test_dz_and_k_have_their_law():
    """The map is linear in the normals: covariances h, h^3/3, h/720, and h^2/2 between dW and dZ, exactly."""
    bridge, h = estimators.Bridge(4, horizon=2.0), 0.5
    normals = np.eye(12).reshape(3, 4, 1, 12)
    rows = bridge.increments(normals)
    assert rows.shape == (4, 3, 12)
    found = np.einsum("sci,tdi->cdst", rows, rows)
    law = np.array([[h, h**2 / 2, 0], [h**2 / 2, h**3 / 3, 0], [0, 0, h / 720]])
    np.testing.assert_allclose(found, law[:, :, None, None] * np.eye(4), atol=1e-14)


def test_differences_of_levels_telescope(nonlinear):
    """Sobol points at h and 2h on one path: the means of f and of its changes sum to that of the finest level, within
    4.5 standard errors (7e-6); the change itself is not 0."""
    pytest.importorskip("scipy")
    problem = make_problem(nonlinear, "q**2", q0=1.0, p0=0.0, horizon=2.0)
    scheme = as_scheme("gauss_dkdkd")
    levels = [Quasi(problem, scheme, 4 << i, i, log2_points=9, differences=i > 0).draw(24).units for i in range(3)]
    finest = Quasi(problem, scheme, 16, 9, log2_points=11).draw(24).units
    error = math.sqrt(sum(x.error**2 for x in [*levels, finest]))
    assert abs(sum(x.mean for x in levels) - finest.mean) < 4.5 * error
    assert abs(levels[1].mean) > 4.5 * levels[1].error


def test_bias_of_two_orders_is_told_from_one():
    """Differences of 1e-2 h + h^2 from h = 1/2 on fall by nearly four: the remaining bias is that of the h term,
    within 1 %.
    """
    left = [1e-2 * h + h**2 for h in (0.5, 0.25, 0.125, 0.0625)]
    means = [a - b for a, b in itertools.pairwise(left)]
    for extra in (0, 1, 3):
        h = 0.0625 / 2**extra
        value, error = bias.left(means, [1e-9] * 3, 1.0, extra)
        assert value == pytest.approx(1e-2 * h + h**2, rel=1e-2) and error < 1e-2 * value
    assert abs(bias.estimate(means, [1e-9] * 3, 2.0)[0] / left[-1] - 1) > 0.05  # the estimate with a single power of h
    cubic = [a + h**3 for a, h in zip(left, (0.5, 0.25, 0.125, 0.0625), strict=True)]
    value, error = bias.left([a - b for a, b in itertools.pairwise(cubic)], [1e-9] * 3, 1.0)
    assert error == pytest.approx(abs(value - cubic[-1]), rel=1e-6)  # the error is the effect of the third power
    assert bias.left(means, [1.0] * 3, 1.0) == bias.estimate(means, [1.0] * 3, 1.0)  # smaller than its noise


def test_the_longest_step_that_is_tried_is_stable_with_every_scheme():
    """0.8 of the smallest limit among the schemes that are tried by default: 2, of Verlet's rule and of
    lobatto2_swapped.
    """
    problem = make_problem(ss.models.synchrotron(), "q**2", q0=1.0, p0=0.0, horizon=2.0)
    limits = {scheme.name: stable_up_to(scheme.name)[0] for scheme in suitable(problem)}
    assert limits["lobatto2_swapped"] == pytest.approx(2.0, rel=1e-5)
    assert pytest.approx(0.8 * min(limits.values()), rel=1e-5) == SHARPEST
