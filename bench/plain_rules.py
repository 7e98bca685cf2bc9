# SPDX-License-Identifier: BSD-3-Clause
"""Heun's rule and the stochastic Taylor rule of strong order 1.5 in NumPy, all paths at once, for two models."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
from symsde.answers.expectation.problem import Problem

RULES = ("heun", "taylor15")
_SEED = 7


class Plain:
    """Runs of a problem by a plain rule, with the methods of a `Problem` that `Ladder` calls."""

    def __init__(self, problem: Problem, parameters: tuple[float, ...]):
        """parameters: omega, sigma1, sigma2 for the synchrotron, a and sigma for Kubo's oscillator."""
        self.model, self.horizon, self.options = problem.model, problem.horizon, problem.options
        self.q0, self.p0, self._parameters = problem.q0, problem.p0, parameters

    def run(self, rule: str, steps: int, *, paths: int, refine: int = 0, save_every: int | None = None, increments=None,
            threads: int = 1) -> SimpleNamespace:  # fmt: skip
        """q, p (time, 1, path) and t of the saved times. `refine`: increments are sums over 2^refine finer steps, which
        are the same in all runs with as many finer steps; increments of zero switch the noise off."""
        h = self.horizon / steps
        noises = self.model.nnoise
        kind = _synchrotron if noises > 1 else _kubo
        generator = np.random.default_rng(_SEED)
        state = np.full(paths, self.q0[0]), np.full(paths, self.p0[0])
        saved = [state]
        still = np.zeros((2, noises, paths))
        for n in range(1, steps + 1):
            dw, dz = still if increments is not None else _drawn(generator, h, 2**refine, noises, paths)
            with np.errstate(over="ignore", invalid="ignore"):
                state = kind(rule, *state, h, dw, dz, *self._parameters)
            if n == steps or (save_every and n % save_every == 0):
                saved.append(state)
        q, p = (np.array(part)[:, np.newaxis] for part in zip(*saved, strict=True))
        return SimpleNamespace(q=q, p=p, t=np.linspace(0.0, self.horizon, len(saved)))


def _drawn(generator, h: float, parts: int, noises: int, paths: int) -> np.ndarray:
    """dW and dZ, the integral of W - W_n over the step, summed from so many parts: (2, noise, path)."""
    short = h / parts
    normals = generator.standard_normal((parts, 2, noises, paths))
    dw = np.sqrt(short) * normals[:, 0]
    dz = short / 2 * (dw + np.sqrt(short / 3) * normals[:, 1])
    if parts == 1:
        return np.stack([dw[0], dz[0]])
    before = np.cumsum(dw, axis=0) - dw
    return np.stack([dw.sum(axis=0), (dz + short * before).sum(axis=0)])


def _synchrotron(rule, q, p, h, dw, dz, omega, sigma1, sigma2):  # noqa: PLR0917
    """dq = p dt, dp = -omega^2 sin q dt - sigma1 cos q dW_1 - sigma2 sin q dW_2; the Ito and Stratonovich equations
    agree."""
    sin, cos = np.sin(q), np.cos(q)
    kick = h * omega**2 + sigma2 * dw[1]
    jump = -kick * sin - sigma1 * dw[0] * cos
    if rule == "heun":
        there, then = q + h * p, p + jump
        again = -kick * np.sin(there) - sigma1 * dw[0] * np.cos(there)
        return q + h / 2 * (p + then), p + (jump + again) / 2
    late = h * dw - dz  # the integral of t - t_n against dW
    bent = -(h**2 / 2 * omega**2 + sigma2 * late[1]) * cos + sigma1 * late[0] * sin
    moved = -(h**2 / 2 * omega**2 + sigma2 * dz[1]) * sin - sigma1 * dz[0] * cos
    return q + h * p + moved, p + jump + bent * p


def _kubo(rule, q, p, h, dw, dz, a, sigma):  # noqa: PLR0917
    """d(q + i p) = -i (q + i p) (a dt + sigma o dW). The Ito drift is linear, too, so that dZ cancels."""
    z, w = q + 1j * p, dw[0]
    if rule == "heun":
        turn = -1j * (a * h + sigma * w)
        z = z * (1 + turn + turn**2 / 2)
    else:
        drift, noise = -1j * a - sigma**2 / 2, -1j * sigma
        z = z * (
            1 + drift * h + noise * w + noise**2 * (w**2 - h) / 2 + drift * noise * h * w + (drift * h) ** 2 / 2
            + noise**3 * (w**2 / 3 - h) * w / 2
        )  # fmt: skip
    return z.real, z.imag
