# SPDX-License-Identifier: BSD-3-Clause
"""Linear stochastic oscillator (20)-(21): E(p^2+q^2) = 1 + sigma^2 t (24), with p0 = 0, q0 = 1.

One step of the midpoint rule rotates (q, p) and adds a kick of squared length sigma^2 dW^2 / (1 + h^2/4), independent
of the state: its mean grows linearly too, at exactly sigma^2 / (1 + h^2/4). Euler-Maruyama multiplies the mean by 1 +
h^2 every step.
"""

import numpy as np

import symsde as ss

from ...show import look
from .experiment import Experiment, panels

SIGMA, TIME, SEED = 1.0, 100.0, 24
LONG_STEP = 0.1
START = {"q0": 1.0, "p0": 0.0}


def run(quick):
    """Test the growth of the second moment, its slope against the step, and the divergence of Euler-Maruyama."""
    paths, slope_paths = (10_000, 20_000) if quick else (200_000, 1_000_000)
    parameters = {
        "sigma": SIGMA, **START, "time": TIME, "paths": paths, "slope_paths": slope_paths,
        "small_step": 0.02,
    }  # fmt: skip
    title = f"Linear oscillator (20)-(21), sigma = {SIGMA:g}, t in [0, {TIME:g}], {paths} paths"
    experiment = Experiment("linear_oscillator", title, seed=SEED, parameters=parameters)
    model = ss.models.linear_oscillator(sigma=SIGMA)
    _growth(experiment, model, paths)
    _slopes(experiment, model, slope_paths, 1.0 if quick else 0.25)
    _blow_up(experiment, model, paths)
    return experiment


def second_moment(model, scheme, step, paths, save_every):
    """Times, E(p^2+q^2) and its standard error: twice the mean energy, for H = (p^2+q^2)/2."""
    found = ss.moments(
        model, **START, step=step, steps=round(TIME / step), save_every=save_every, scheme=scheme, paths=paths,
        seed=SEED,
    )  # fmt: skip
    return {"step": step, "t": found.t, "mean": 2 * found.mean_energy, "standard_error": 2 * found.se_mean_energy}


def _at(found, i):
    """Mean and standard error at one time."""
    return found["mean"][i], found["standard_error"][i]


def _growth(experiment, model, paths):
    step = experiment.parameters["small_step"]
    found = second_moment(model, "midpoint", step, paths, 250)
    t = found["t"]
    for time in (10.0, 25.0, 50.0, 100.0):
        i = int(np.argmin(np.abs(t - time)))
        text = f"E(p^2+q^2), midpoint, h = {step:g}, t = {t[i]:g}"
        experiment.within("(24)", text, _at(found, i), 1 + SIGMA**2 * t[i])
    experiment.numbers["growth"] = {**found, "expected": 1 + SIGMA**2 * t}
    # for the figure, at the step of Euler-Maruyama's divergence
    found = second_moment(model, "midpoint", LONG_STEP, paths, 50)
    expected = 1 + SIGMA**2 / (1 + LONG_STEP**2 / 4) * found["t"]
    text = f"E(p^2+q^2), midpoint, h = {LONG_STEP:g}, t = {TIME:g}: 1 + sigma^2 t/(1+h^2/4)"
    experiment.within("(20)-(21), (24)", text, _at(found, -1), expected[-1])
    experiment.numbers["growth_at_long_step"] = {**found, "expected": expected}


def _slopes(experiment, model, paths, resolved):
    """Slopes at several steps; from the step `resolved` on there are enough paths to distinguish them from sigma^2."""
    rows = []
    for step in (0.1, 0.25, 0.5, 1.0, 2.0):
        mean, error = _at(second_moment(model, "midpoint", step, paths, round(TIME / step)), -1)
        slope = (mean - 1) / TIME, error / TIME
        exact = SIGMA**2 / (1 + step**2 / 4)
        experiment.within("(20)-(21), (24)", f"midpoint's slope = sigma^2/(1+h^2/4), h = {step:g}", slope, exact)
        if step >= resolved:
            experiment.beyond("(24)", f"the same differs from sigma^2, h = {step:g}", slope, SIGMA**2)
        rows.append({"step": step, "slope": slope[0], "standard_error": slope[1], "expected": exact})
    experiment.numbers["slopes"] = rows


def _blow_up(experiment, model, paths):
    h = LONG_STEP
    found = second_moment(model, "euler_maruyama", h, paths, 50)
    expected = (1 + h**2) ** np.arange(0, found["t"].size * 50, 50) * (1 + SIGMA**2 / h) - SIGMA**2 / h
    experiment.within(
        "(20)-(21)", f"Euler-Maruyama, h = {h:g}: E(p^2+q^2) at t = {TIME:g}", _at(found, -1), expected[-1]
    )
    experiment.at_least("(24)", "  the same / (1 + sigma^2 t)", found["mean"][-1] / (1 + SIGMA**2 * TIME), 1000)
    experiment.numbers["euler_maruyama"] = {**found, "expected": expected}


def draw(experiment, directory):
    """Draw the growth next to the divergence, and the slope against the step."""
    growth, blow_up = experiment.numbers["growth_at_long_step"], experiment.numbers["euler_maruyama"]
    with panels(directory / "linear_oscillator.png", [["growth", "slope"]], height=2.9, width_ratios=[1.2, 1]) as axes:
        axis = axes["growth"]
        axis.plot(growth["t"], 1 + SIGMA**2 * np.asarray(growth["t"]), color=look.BLACK, label=r"$1+\sigma^2t$ (24)")
        every = slice(None, None, 2)
        axis.plot(growth["t"][every], growth["mean"][every], "o", color=look.colour("midpoint"), ms=3.5,
                  label=f"midpoint, $h={LONG_STEP:g}$")  # fmt: skip
        axis.plot(blow_up["t"], blow_up["mean"], "--", color=look.colour("euler_maruyama"),
                  label=f"Euler-Maruyama, $h={LONG_STEP:g}$")  # fmt: skip
        axis.set(xlabel="$t$", ylabel="$E(p^2+q^2)$", xlim=(0, TIME), ylim=(0, 200))
        axis.legend(loc="upper right", fontsize=7)
        axis = axes["slope"]
        rows = experiment.numbers["slopes"]
        h = np.linspace(0, 2.1, 100)
        axis.plot(h, SIGMA**2 / (1 + h**2 / 4), color=look.BLACK, label=r"$\sigma^2/(1+h^2/4)$")
        axis.axhline(SIGMA**2, color=look.GREY, ls=":", label=r"$\sigma^2$ (24)")
        axis.errorbar(
            [row["step"] for row in rows], [row["slope"] for row in rows],
            yerr=[5 * row["standard_error"] for row in rows], fmt="o", color=look.BLUE, capsize=2,
            label="midpoint, 5 s.e.",
        )  # fmt: skip
        axis.set(xlabel="$h$", ylabel="slope of $E(p^2+q^2)$", xlim=(0, 2.1), ylim=(0.4, 1.1))
        axis.legend(loc="lower left")
