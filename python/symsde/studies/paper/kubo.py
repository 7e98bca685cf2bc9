# SPDX-License-Identifier: BSD-3-Clause
"""Kubo oscillator (35)-(36): the midpoint rule (71)-(72) against the exact rotation on the same Brownian path.

The exact solution rotates (q, p) by the angle a t + sigma W(t), so p^2 + q^2 is constant on every path.
"""

import numpy as np

import symsde as ss

from ...show import look
from .experiment import Experiment, panels, strong_order

A, SIGMA, SEED = 1.0, 0.5, 2024
START = {"q0": 1.0, "p0": 0.0}


def run(quick):
    """Test path, invariant and order."""
    long_steps = 10**5 if quick else 10**6
    parameters = {
        "a": A, "sigma": SIGMA, **START, "path_step": 0.02, "path_steps": 1000, "invariant_step": 0.02,
        "invariant_steps": long_steps, "order_time": 1.0, "order_paths": 1000 if quick else 3000,
        "order_seed": SEED + 1,
    }  # fmt: skip
    experiment = Experiment("kubo", f"Kubo oscillator, a = {A:g}, sigma = {SIGMA:g}", seed=SEED, parameters=parameters)
    model = ss.models.kubo(a=A, sigma=SIGMA)
    _path(experiment, model)
    _invariant(experiment, model, long_steps)
    _order(experiment, model)
    return experiment


def _path(experiment, model):
    """Compare the path, over the time of one figure, with the exact rotation and with the exact solution of
    (71)-(72).
    """
    step, steps = experiment.parameters["path_step"], experiment.parameters["path_steps"]
    options = {**START, "step": step, "steps": steps, "paths": 8, "seed": SEED}
    computed = ss.simulate(model, scheme="midpoint", **options)
    exact_q, exact_p = ss.diagnose.exact(computed)
    dw = ss.increments(model, step=step, steps=steps, paths=8, seed=SEED)[:, 0]
    x = A * step + SIGMA * dw
    q, p = _rotation(np.cumsum(x, axis=0))
    experiment.at_most("(35)-(36)", "exact solution = turn by a t + sigma W(t)", _gap(exact_q, exact_p, q, p), 1e-11)
    turned = _rotation(np.cumsum(2 * np.arctan(x / 2), axis=0))
    gap = _gap(computed.q, computed.p, *turned)
    experiment.at_most("(71)-(72)", "midpoint = turn by sum of 2 atan(x_n/2)", gap, 1e-11)
    error = _gap(computed.q, computed.p, q, p)
    lag = np.abs(np.cumsum(x - 2 * np.arctan(x / 2), axis=0)).max()
    experiment.near(
        "(71)-(72)", "largest error on [0, 20], 8 paths: that of the phase", error, 2 * np.sin(lag / 2), 1e-9
    )
    experiment.numbers |= {"max_error": error, "max_difference_from_turning_angles": gap}
    experiment.curves |= {"t": computed.t, "q": computed.q[:, 0, 0], "exact": q[:, 0]}


def _invariant(experiment, model, steps):
    """Test p^2 + q^2 over very many steps."""
    every = steps // 1000
    computed = ss.simulate(
        model, **START, step=experiment.parameters["invariant_step"], steps=steps, save_every=every,
        scheme="midpoint", paths=8, seed=SEED,
    )  # fmt: skip
    drift = np.abs(computed.q[:, 0] ** 2 + computed.p[:, 0] ** 2 - 1).max(axis=1)
    text = f"max |(p^2+q^2)/(p0^2+q0^2) - 1|, 10^{np.log10(steps):.0f} steps"
    experiment.at_most("(71)-(72)", text, drift.max(), 1e-10)
    experiment.numbers |= {"invariant_drift": drift.max(), "invariant_steps": steps}
    experiment.curves |= {"long_t": computed.t, "drift": drift}


def _order(experiment, model):
    """RMS error at t = 1 for steps 2^-7 .. 2^-13 on the same Brownian paths, and the error constant.

    A step lags by x - 2 atan(x/2) = x^3/12 + ..; with x = a h + sigma dW the sum over t/h steps has mean square
    (h/12)^2 [(3 a sigma^2 t)^2 + 15 sigma^6 t] to leading order in h.
    """
    parameters = experiment.parameters
    found = strong_order(
        experiment, "(71)-(72)", "", model, "midpoint", paths=parameters["order_paths"], levels=range(7, 14),
        time=parameters["order_time"], seed=parameters["order_seed"], **START,
    )  # fmt: skip
    expected = np.sqrt((3 * A * SIGMA**2) ** 2 + 15 * SIGMA**6) / 12
    constant = found["order_rms_errors"][-1] / found["order_steps"][-1]
    experiment.near("(71)-(72)", "rms error / h at the finest step", constant, expected, 0.04 * expected)
    experiment.numbers |= {**found, "error_constant": constant, "error_constant_expected": expected}


def _rotation(angle):
    """(q, p) from (1, 0) rotated by angles (step, path); the initial state comes first."""
    angle = np.concatenate([np.zeros((1, angle.shape[1])), angle])
    return np.cos(angle), -np.sin(angle)


def _gap(q, p, other_q, other_p):
    return np.hypot(q.reshape(other_q.shape) - other_q, p.reshape(other_p.shape) - other_p).max()


def draw(experiment, directory):
    """Draw path, invariant and order in one figure."""
    numbers, curves = experiment.numbers, experiment.curves
    with panels(directory / "kubo.png", [["path", "path"], ["invariant", "order"]], height=4.0) as axes:
        axis = axes["path"]
        axis.plot(curves["t"], curves["exact"], color=look.BLACK, lw=2.2, alpha=0.35, label="exact rotation")
        axis.plot(curves["t"], curves["q"], color=look.BLUE, lw=1, label="midpoint (71)-(72)")
        axis.set(xlabel="$t$", ylabel="$q$", xlim=(0, 20), ylim=(-1.1, 1.6))
        axis.legend(ncols=2, loc="upper right")
        axis = axes["invariant"]
        axis.plot(curves["long_t"], curves["drift"] * 1e13, color=look.BLUE)
        axis.set(xlabel="$t$", ylabel=r"$10^{13}\,\max|I/I_0-1|$", xlim=(0, curves["long_t"][-1]))
        axis = axes["order"]
        axis.loglog(numbers["order_steps"], numbers["order_rms_errors"], "o", color=look.BLUE, label="rms error, $t=1$")
        look.slope_guide(axis, numbers["order_steps"], numbers["order_rms_errors"][0], 1, "order 1")
        axis.set(xlabel="$h$", ylabel="error")
        axis.legend(loc="upper left")
