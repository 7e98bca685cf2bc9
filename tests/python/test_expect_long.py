# SPDX-License-Identifier: BSD-3-Clause
"""Whether the error of a step is known: phases over long horizons, chaos, no noise."""

import math

import numpy as np
import pytest
import symsde as ss
from symsde.answers.expectation import bias, choice, pilot
from symsde.answers.expectation.interval import half_width
from symsde.answers.expectation.problem import make_problem
from symsde.answers.expectation.trial import Trial
from symsde.schemes import as_scheme

SIGMA, LONG = math.sqrt(1 / 32), 200.0


def exact_square(t: float) -> float:
    """E q^2 of the oscillator with this noise from q = 1, p = 0."""
    return math.cos(t) ** 2 + SIGMA**2 * (t / 2 - math.sin(2 * t) / 4)


def square_by_verlet(steps: int, t: float) -> float:
    """E q^2 by Verlet's rule, from its matrix."""
    h = t / steps
    kick, drift = np.array([[1.0, 0.0], [-h / 2, 1.0]]), np.array([[1.0, h], [0.0, 1.0]])
    step, noise = kick @ drift @ kick, (kick @ drift + np.eye(2)) @ np.array([0.0, SIGMA / 2])
    mean, spread = np.array([1.0, 0.0]), np.zeros((2, 2))
    for _ in range(steps):
        mean, spread = step @ mean, step @ spread @ step.T + h * np.outer(noise, noise)
    return float(mean[0] ** 2 + spread[0, 0])


@pytest.fixture
def problem():
    """Verlet's rule with h = 1.6 to 0.2 makes the phases of 256 paths wrong by many radians."""
    model = ss.models.linear_oscillator(sigma=SIGMA)
    return make_problem(model, "q**2", q0=1.0, p0=0.0, horizon=LONG, seed=3, threads=1)


def test_phases_that_turn_are_told_from_those_that_do_not(problem):
    """Verlet's rule has a bias of 0.322 at the finest step of its ladder, and estimates it within a factor of two for
    most seeds; it predicts no smaller bias at finer steps. After two more halvings its levels are settled; the levels
    of chin4a are settled at once."""
    trial = Trial(problem, as_scheme("stormer_verlet"), 125, 256)
    left = exact_square(LONG) - square_by_verlet(1000, LONG)
    assert left == pytest.approx(-0.322, abs=1e-3)
    assert not trial.settled and trial.may_go_finer
    assert math.hypot(*trial.bias(3)) > 0.5 * abs(left) and trial.bias(5) == trial.bias(3)
    trial.go_finer()
    trial.go_finer()
    assert trial.settled and trial.steps(3) == 4000
    assert abs(trial.bias(3)[0] - (exact_square(LONG) - square_by_verlet(4000, LONG))) < 4 * trial.bias(3)[1]
    assert Trial(problem, as_scheme("chin4a"), 125, 256).settled


@pytest.mark.usefixtures("work_clock")
def test_intervals_hold_at_long_horizons(problem, monkeypatch):
    """9 or more of 12 intervals must contain the value; intervals of 94.9 % fail this with probability 3e-4. The twin
    treats every level as settled, and reports less than half of the bias."""
    held = 0
    for seed in range(12):
        given = {"q0": 1.0, "p0": 0.0, "horizon": LONG, "abs": 0.1, "seed": seed, "threads": 1}
        answer = ss.expect(problem.model, "q**2", **given)
        assert answer.reached and answer.half_width <= 0.105
        held += answer.interval[0] <= exact_square(LONG) <= answer.interval[1]
    assert held >= 9
    monkeypatch.setattr(bias, "CLOSE", math.inf)
    monkeypatch.setattr(bias, "second_powers", lambda *_: 0.0)
    trial = Trial(problem, as_scheme("stormer_verlet"), 125, 256)
    level = choice.longest(trial.bias, 0.1 / 1.96)
    left = exact_square(LONG) - square_by_verlet(trial.steps(level), LONG)
    assert math.hypot(*trial.bias(level)) < abs(left) / 2


def test_what_no_power_of_h_tells_does_not_fall():
    """If differences change their sign, the bias is the last difference or half of the difference before it, also at
    finer steps."""
    for extra in (0.0, 3.0):
        assert bias.left([-0.64, 0.91, -0.35], [0.1] * 3, 2.0, extra, settled=False) == (0.455, 0.1)
    assert not bias.settled(0.3, 1.0, [-0.64, 0.91, -0.35], [1e-3] * 3, 2.0)
    assert bias.settled(0.3, 1.0, [0.64, 0.15, 0.04], [1e-3] * 3, 2.0)  # these means fall with the order
    assert not bias.settled(0.3, 1.0, [0.64, 0.15, 0.04], [0.05] * 3, 2.0)  # smaller than its noise
    assert not bias.settled(0.3, 1.0, [0.64, 0.5, 0.04], [1e-3] * 3, 2.0)
    assert bias.settled(0.1, 1.0, [0.0] * 3, [1.0] * 3, 2.0)  # paths that end near each other


def test_second_powers_of_a_phase_are_in_the_doubt():
    """cos(phi + x) - cos(phi) with x = 0.1 at h, for the worst phi, where x and x^2 cancel in the difference from 2 h
    to h: the doubt follows from the paths' differences, D^2 = 2 (1 - cos 3 x)."""
    x, worst = 0.1, 0.0
    for phi in np.linspace(0.0, 2 * math.pi, 100):
        mean = [math.cos(phi + turned) for turned in (0.0, x, 4 * x)]
        second = bias.second_powers(2 * (1 - math.cos(3 * x)), 1.0, 2.0, 0.5)
        told, doubt = bias.left([mean[1] - mean[2]], [1e-9], 2.0, second=second)
        worst = max(worst, abs(mean[0] - mean[1] - told) / doubt)
    assert 0.8 < worst < 1.2


def test_paths_that_part_by_themselves_take_paths_not_steps():
    """Strong noise to T = 60: chin4a has no phase error at h = 0.1, but paths with different steps separate. No finer
    steps are tried, no power of h is assumed, and more paths are drawn to measure the bias."""
    model = ss.models.synchrotron(sigma1=0.8, sigma2=0.5)
    chaos = make_problem(model, "cos(q)", q0=1.0, p0=0.0, horizon=60.0, threads=1)
    trial = Trial(chaos, as_scheme("chin4a"), 75, 256)
    assert not trial.settled and not trial.may_go_finer
    told = trial.bias(3)[1]
    trial.double()
    assert trial.bias(3)[1] == pytest.approx(told / math.sqrt(2), rel=0.2)


def test_an_error_that_no_work_tells_is_in_the_interval(problem, monkeypatch):
    """If the pilot may try only one ladder, the interval covers the unknown error, and a note says why."""
    monkeypatch.setattr(Trial, "may_go_finer", False)
    monkeypatch.setattr(pilot, "_DOUBLINGS", 0)
    given = {"q0": 1.0, "p0": 0.0, "horizon": LONG, "abs": 0.1, "scheme": "stormer_verlet", "method": "plain"}
    answer = ss.expect(problem.model, "q**2", **given)
    assert not answer.reached and answer.half_width > 0.5
    assert answer.interval[0] <= exact_square(LONG) <= answer.interval[1]
    assert "the bias of the step is known only to" in str(answer)


def test_without_noise_an_interval_is_as_wide_as_its_bias():
    """Student's quantile applies to drawn values: without noise two paths know a bias as well as many."""
    assert half_width(0.0, 1.0, 2) == pytest.approx(1.96)
    assert half_width(1.0, 0.0, 2) == pytest.approx(12.7062)
    still = ss.models.synchrotron(sigma1=0.0, sigma2=0.0)
    for wanted in (1e-2, 1e-4, 1e-6):
        found = ss.expect(still, "q", q0=1.0, p0=0.0, horizon=20.0, abs=wanted)
        fine = ss.simulate(still, q0=1.0, p0=0.0, step=1 / 512, steps=20 * 512, scheme="chin4a", save_every=20 * 512)
        assert found.reached and found.half_width <= wanted
        assert abs(found.value - fine.q[-1, 0, 0]) <= found.half_width
