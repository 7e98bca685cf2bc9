# SPDX-License-Identifier: BSD-3-Clause
"""Figure 4.2: two additive noises (84)-(85), the pair (89)-(90), (91)-(92) against the exact recursion.

The exact solution on the grid is Y(t_{k+1}) = F Y(t_k) + u_k with F a rotation by h; u_k is drawn from its exact law
given the increments that drive the schemes, so that the comparison is path by path.
"""

import numpy as np

import symsde as ss

from ...show import look
from .experiment import Experiment, panels, strong_order

STEP, TIME, SEED, PATHS = 0.02, 200.0, 42, 10
START = {"q0": 0.0, "p0": 0.0}
SCHEMES = {"symplectic_euler": "(89)-(90)", "symplectic_euler_adjoint": "(91)-(92)"}
CASES = {"one_noise": (1.0, 0.0), "two_noises": (1.0, 1.0)}  # gamma, sigma


def run(quick):
    """Errors on the figure's interval, the order, and the growth of the exact solution's second moment."""
    order_paths = 200 if quick else 2000
    parameters = {
        "cases": {name: {"gamma": gamma, "sigma": sigma} for name, (gamma, sigma) in CASES.items()},
        **START, "step": STEP, "time": TIME, "paths": PATHS, "order_paths": order_paths,
        "moment_seed": SEED + 1, "order_seed": SEED + 2,
    }  # fmt: skip
    title = f"Figure 4.2: two additive noises, h = {STEP}, t in [0, {TIME:g}], {PATHS} paths"
    experiment = Experiment("figure_4_2", title, seed=SEED, parameters=parameters)
    for case, (gamma, sigma) in CASES.items():
        model = ss.models.additive_oscillator(sigma=sigma, gamma=gamma)
        experiment.numbers[case] = {scheme: _errors(experiment, model, case, scheme) for scheme in SCHEMES}
        _growth(experiment, model, case, order_paths)
        for scheme, equations in SCHEMES.items():
            experiment.numbers[case][scheme] |= strong_order(
                experiment, equations, f", {_text(case)}", model, scheme, paths=order_paths, levels=range(6, 13),
                time=10.24, seed=parameters["order_seed"], **START,
            )  # fmt: skip
    return experiment


def _text(case):
    gamma, sigma = CASES[case]
    return f"gamma = {gamma:g}, sigma = {sigma:g}"


def _errors(experiment, model, case, scheme):
    computed = ss.simulate(model, **START, step=STEP, steps=round(TIME / STEP), scheme=scheme, paths=PATHS, seed=SEED)
    exact, _ = ss.diagnose.exact(computed)
    errors = np.abs(computed.q[:, 0] - exact[:, 0]).max(axis=0)
    amplitudes = np.abs(exact[:, 0]).max(axis=0)
    text = f"max|q - exact|, {_text(case)}"
    experiment.between(SCHEMES[scheme], text, errors.max(), 1e-3, 1.0)
    experiment.at_most(
        SCHEMES[scheme], "  the same over the largest |q|, worst path", (errors / amplitudes).max(), 0.05
    )
    experiment.curves[case, scheme] = computed.t, computed.q[:, 0, 0], exact[:, 0, 0]
    return {"max_errors": errors, "largest_q": amplitudes}


def _growth(experiment, model, case, paths):
    """Test E(p^2+q^2) = (gamma^2 + sigma^2) t for the exact solution itself."""
    gamma, sigma = CASES[case]
    steps = 200
    computed = ss.simulate(
        model, **START, step=0.1, steps=steps, save_every=steps, scheme="symplectic_euler", paths=paths,
        seed=experiment.parameters["moment_seed"],
    )  # fmt: skip
    q, p = ss.diagnose.exact(computed)
    squares = q[-1, 0] ** 2 + p[-1, 0] ** 2
    estimate = squares.mean(), squares.std(ddof=1) / np.sqrt(paths)
    expected = (gamma**2 + sigma**2) * computed.t[-1]
    experiment.within("Y = F Y + u", f"exact: E(p^2+q^2) at t = 20, {_text(case)}", estimate, expected)
    experiment.numbers[case]["exact_second_moment"] = {"value": estimate, "expected": expected}


def draw(experiment, directory):
    """Draw path 0 in both cases, and its error below."""
    with panels(
        directory / "figure_4_2.png", [["one_noise", "two_noises"], ["one_error", "two_error"]], height=4.0,
        height_ratios=[1.5, 1], sharex=True,
    ) as axes:  # fmt: skip
        for case, name in (("one_noise", "one_error"), ("two_noises", "two_error")):
            gamma, sigma = CASES[case]
            for scheme, line in (("symplectic_euler", "-"), ("symplectic_euler_adjoint", "--")):
                colour = look.colour(scheme)
                t, q, exact = experiment.curves[case, scheme]
                if scheme == "symplectic_euler":
                    axes[case].plot(t, exact, color=look.BLACK, lw=2.2, alpha=0.35, label="exact")
                axes[case].plot(t, q, line, color=colour, lw=0.7, label=SCHEMES[scheme])
                axes[name].plot(t, q - exact, color=colour, lw=0.6, label=SCHEMES[scheme])
            top = np.abs(exact).max()
            axes[case].set(
                title=rf"$\gamma={gamma:g},\ \sigma={sigma:g}$", xlim=(0, TIME), ylim=(-1.1 * top, 1.1 * top)
            )
            axes[name].set(xlabel="$t$")
        axes["one_noise"].set(ylabel="$q$")
        axes["one_error"].set(ylabel="$q-$exact")
        axes["one_noise"].figure.legend(
            *axes["one_noise"].get_legend_handles_labels(), loc="outside lower center", ncols=3
        )
