# SPDX-License-Identifier: BSD-3-Clause
"""Theorems 2.3 and 3.2 in their discrete form: computed paths make the discrete action stationary.

Along a path of the scheme the discrete Euler-Lagrange equations (47)-(48) and both Legendre transforms (53)-(54),
(57)-(58) hold to round-off. As a control the path is perturbed by eps: the residuals grow like
eps, and the action (46) changes like eps^2 if the ends are fixed, and like p_N dq_N - p_0 dq_0, (60), if they move.
The discrete Lagrangians of the paper are also written down here, (61)-(62), (77)-(78), (88) and its adjoint. The
library's step is inserted into the equations that the paper derives from them, in printed.py.
"""

from copy import copy
from dataclasses import dataclass

import numpy as np

import symsde as ss

from ...show import look
from . import printed
from .experiment import Experiment, panels

STEP, STEPS, PATHS, SEED = 0.02, 500, 4, 47
A, SIGMA = 1.0, 0.5
OMEGA, SIGMA1, SIGMA2 = 2.0, 0.2, 0.1
NOISE1, NOISE2 = 1.0, 1.0  # sigma and gamma of (84)-(85)
LONG_STEP, POINTS, ROUNDING = 0.1, 64, 1e-13  # values for single steps from given states with coordinates up to three
EPSILONS = 10.0 ** -np.arange(1, 11)


def kubo(h, dw, start, end):
    """The discrete Lagrangian (61)-(62); start, end = (q, p) at t_n and t_{n+1}."""
    q, p = (start + end) / 2
    return h * (p * (end - start)[0] / h - A / 2 * (p**2 + q**2)) - SIGMA / 2 * dw[0] * (p**2 + q**2)


def synchrotron(h, dw, start, end):
    """The discrete Lagrangian (77)-(78)."""
    q, p = (start + end) / 2
    drift = h * (p * (end - start)[0] / h + OMEGA**2 * np.cos(q) - p**2 / 2)
    return drift - SIGMA1 * dw[0] * np.sin(q) + SIGMA2 * dw[1] * np.cos(q)


def two_noises(h, dw, start, end):
    """The discrete Lagrangian (88)."""
    return _one_sided(h, dw, start[0], end[1], (end - start)[0])


def two_noises_adjoint(h, dw, start, end):
    """The discrete Lagrangian (88) with p at t_n and q at t_{n+1}, which leads to (91)-(92)."""
    return _one_sided(h, dw, end[0], start[1], (end - start)[0])


def _one_sided(h, dw, q, p, difference):
    return h * (p * difference / h - (p**2 + q**2) / 2) - NOISE1 * p * dw[0] + NOISE2 * q * dw[1]


@dataclass
class Case:
    """A model with a scheme, and the discrete Lagrangian that the paper prints, or one derived from it.

    `printed` computes the equations that the paper derives from the Lagrangian; `equations` are the paper's numbers of
    the Lagrangian.
    """

    label: str
    model: object
    scheme: str
    lagrangian: object
    printed: object
    equations: str
    q0: float = 0.0
    against: str = "the printed one"


def _cases():
    oscillator = ss.models.additive_oscillator(sigma=NOISE1, gamma=NOISE2)
    synchrotron_model = ss.models.synchrotron(omega=OMEGA, sigma1=SIGMA1, sigma2=SIGMA2)
    return (
        Case("Kubo, midpoint", ss.models.kubo(a=A, sigma=SIGMA), "midpoint", kubo, printed.kubo, "(61)-(62)", q0=1.0),
        Case("synchrotron, midpoint", synchrotron_model, "midpoint", synchrotron, printed.synchrotron, "(77)-(78)"),
        Case("two noises, (89)-(90)", oscillator, "symplectic_euler", two_noises, printed.two_noises, "(88)"),
        Case(
            "two noises, (91)-(92)",
            oscillator,
            "symplectic_euler_adjoint",
            two_noises_adjoint,
            printed.two_noises_adjoint,
            "(88)",
            against="that printed, ends exchanged",
        ),
    )


def run(quick):
    """Residuals along the paths, and their growth away from the paths."""
    steps = 100 if quick else STEPS
    parameters = {
        "step": STEP, "steps": steps, "paths": PATHS, "single_step": LONG_STEP, "points": POINTS,
        "kubo": {"a": A, "sigma": SIGMA}, "synchrotron": {"omega": OMEGA, "sigma1": SIGMA1, "sigma2": SIGMA2},
        "additive_oscillator": {"sigma": NOISE1, "gamma": NOISE2},
    }  # fmt: skip
    title = f"Discrete Euler-Lagrange equations and Legendre transforms, h = {STEP}, {steps} steps, {PATHS} paths"
    experiment = Experiment("euler_lagrange", title, seed=SEED, parameters=parameters)
    for case in _cases():
        computed = ss.simulate(
            case.model, q0=case.q0, p0=0.0, step=STEP, steps=steps, scheme=case.scheme, paths=PATHS, seed=SEED
        )
        row = _residuals(experiment, case, computed) | _action(experiment, case, computed)
        row["printed_residuals"] = printed_equations(experiment, case)
        experiment.numbers[case.label] = row | _perturbed(experiment, case, computed)
    return experiment


def _residuals(experiment, case, computed):
    scale = max(np.abs(computed.q).max(), np.abs(computed.p).max())
    residual = ss.diagnose.euler_lagrange_residual(computed).max(axis=-1)
    bound = 1e-14 * max(1.0, 10.0 ** np.ceil(np.log10(scale)))
    for value, equations, text in zip(
        residual,
        ("(47)", "(48)", "(53)-(54)", "(57)-(58)"),
        ("residual in q", "  residual in p", "  Legendre transform, left end", "  Legendre transform, right end"),
        strict=True,
    ):
        label = f"{case.label}: {text}" if equations == "(47)" else text
        experiment.at_most(equations, label, value, bound)
    keys = ("euler_lagrange_q", "euler_lagrange_p", "legendre_left", "legendre_right")
    return dict(zip(keys, residual, strict=True)) | {"largest_state": scale}


def _action(experiment, case, computed):
    """Compare the library's discrete action with the printed formula, on the path and away from it."""
    dw = ss.increments(case.model, step=STEP, steps=computed.t.size - 1, paths=PATHS, seed=SEED)
    rng = np.random.default_rng(SEED)
    moved = _move(computed, *rng.uniform(-1, 1, (2, *computed.q.shape)))
    gap = 0.0
    for path in (computed, moved):
        z = np.stack([path.q[:, 0], path.p[:, 0]])
        printed = case.lagrangian(STEP, dw.swapaxes(0, 1), z[:, :-1], z[:, 1:])
        gap = max(gap, np.abs(ss.diagnose.action(path) - printed).max() / max(1.0, np.abs(printed).max()))
    experiment.at_most(case.equations, f"  discrete Lagrangian - {case.against}, relative", gap, 1e-14)
    return {"lagrangian_difference": gap}


def printed_equations(experiment, case):
    """Insert the library's step into the printed equations, from given states with given increments."""
    rng = np.random.default_rng(SEED)
    start, other = rng.uniform(-3, 3, (2, 2, POINTS))
    dw = rng.uniform(-1, 1, (case.model.nnoise, POINTS))
    dw[0, 0] = -A * LONG_STEP / SIGMA  # here the divisor of the paper, a h + sigma dW, is 0
    end = np.concatenate(ss.step(case.model, case.scheme, *start[:, None], LONG_STEP, dw=dw))
    residuals = case.printed(LONG_STEP, dw, start, end, **case.model.parameters)
    largest = {equation: np.abs(residual).max() for equation, residual in residuals.items()}
    for equation, value in largest.items():
        if equation == printed.WRONG:
            experiment.at_least(equation, "  wrong, cos(q_n/2): left side - right side", value, 1e-2)
        else:
            experiment.at_most(equation, "  the library's step put in: left side - right side", value, ROUNDING)
    if case.printed is printed.two_noises_adjoint:
        off = case.printed(LONG_STEP, dw, start, other, **case.model.parameters)
        gap = max(np.abs(off[f"adjoint of {i}"] - off[j]).max() for i, j in (("(89)", "(91)"), ("(90)", "(92)")))
        experiment.at_most("(91)-(92)", "  adjoint of (89)-(90) - (91)-(92), any two ends", gap, ROUNDING)
        largest["adjoint_difference"] = gap
    return largest


def _perturbed(experiment, case, computed):
    """Residuals and action of the path plus eps times a fixed random direction."""
    rng = np.random.default_rng(SEED + 1)
    dq, dp = rng.uniform(-1, 1, (2, *computed.q.shape))
    inner_q, inner_p = dq.copy(), dp.copy()
    inner_q[[0, -1]] = inner_p[[0, -1]] = 0
    residual, change = np.empty(EPSILONS.size), np.empty(EPSILONS.size)
    action = ss.diagnose.action(computed).sum(axis=0)
    for i, eps in enumerate(EPSILONS):
        moved = _move(computed, eps * inner_q, eps * inner_p)
        residual[i] = ss.diagnose.euler_lagrange_residual(moved)[:2].max()
        change[i] = np.abs(ss.diagnose.action(moved).sum(axis=0) - action).max()
    growth = np.polyfit(np.log(EPSILONS), np.log(residual), 1)[0]
    curvature = np.polyfit(np.log(EPSILONS[:4]), np.log(change[:4]), 1)[0]
    experiment.near("(47)-(48)", "  residual of a path moved by eps, as eps^k: k", growth, 1.0, 0.02)
    experiment.near("(46), Thm 2.3", "  change of the action, ends fixed, as eps^k: k", curvature, 2.0, 0.02)
    ends = _moving_ends(computed, dq, dp)
    experiment.at_most("(60), Thm 3.2", "  dS - (p_N dq_N - p_0 dq_0), ends moving, rel.", ends, 1e-7)
    experiment.curves[case.label] = residual, change
    return {
        "epsilons": EPSILONS, "perturbed_residual": residual, "residual_exponent": growth,
        "action_change": change, "action_exponent": curvature, "boundary_form_difference": ends,
    }  # fmt: skip


def _moving_ends(computed, dq, dp, eps=1e-4):
    up, down = (ss.diagnose.action(_move(computed, s * eps * dq, s * eps * dp)).sum(axis=0) for s in (1, -1))
    boundary = computed.p[-1, 0] * dq[-1, 0] - computed.p[0, 0] * dq[0, 0]
    return np.abs((up - down) / (2 * eps) - boundary).max() / np.abs(boundary).max()


def _move(computed, dq, dp):
    moved = copy(computed)
    moved.q, moved.p = computed.q + dq, computed.p + dp
    return moved


def draw(experiment, directory):
    """Draw the growth of residual and action away from computed paths; filled markers are midpoint's second case."""
    curves = [(case.label, *experiment.curves[case.label], look.of_scheme(case.scheme)) for case in _cases()]
    mosaic = [["residual", "action"]]
    with panels(directory / "euler_lagrange.png", mosaic, height=3.0) as axes:
        for i, (label, residual, change, style) in enumerate(curves):
            shape = {"ls": "", "fillstyle": "full" if i == 1 else "none", "ms": 2.5 if i == 1 else 5, **style}
            axes["residual"].loglog(EPSILONS, residual, label=label, **shape)
            axes["action"].loglog(EPSILONS[:6], change[:6], **shape)
        look.slope_guide(axes["residual"], EPSILONS, 4 * EPSILONS[0], 1, r"$\propto\varepsilon$")
        look.slope_guide(axes["action"], EPSILONS[:6], 30 * EPSILONS[0] ** 2, 2, r"$\propto\varepsilon^2$")
        floor = max(experiment.numbers[label]["euler_lagrange_q"] for label in experiment.curves)
        axes["residual"].axhline(floor, color=look.GREY, ls=":", label=r"computed paths, $\varepsilon=0$")
        axes["residual"].set(xlabel=r"$\varepsilon$", ylabel="residual of (47)-(48)", ylim=(1e-17, 10))
        axes["action"].set(xlabel=r"$\varepsilon$", ylabel="change of the action (46)")
        axes["residual"].legend(loc="lower right", bbox_to_anchor=(1, 0.11), fontsize=7)
        axes["action"].legend(loc="upper left")
