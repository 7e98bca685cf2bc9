# SPDX-License-Identifier: BSD-3-Clause
# ruff: noqa: PLR0917
"""Langevin's equation dq = p dt, dp = (-U'(q) - gamma p) dt + sqrt(2 gamma) dW by loops in numba, without symsde.

Three splittings as an expert writes them, path after path, with one force a step, -ffast-math and NumPy's generator:

    BAOAB     half kick, half drift, damping with the path's noise W sqrt((1 - exp(-2z))/2z), half drift, half kick
    Strang    Verlet kicked by forces and noise, between two half steps of damping
    UBU       kicks between exact free flights, whose noise has E = int exp(-gamma u) dW and D = int phi(u) dW

A loop is `run(generator, q0, p0, step, steps, paths)`. `given(name, ..)` makes the same steps on given noise: dW for
the first two, and for UBU the pairs (E, D) of flights of half a step.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba
import numpy as np

GAMMA = 1.0
MASSES = 64
_fast = numba.njit(fastmath=True)
_inlined = numba.njit(inline="always", fastmath=True)


@dataclass(frozen=True)
class Scene:
    """A potential and a first state; T = 4."""

    force: object  #: force(q, f) writes -U'(q) into f, or for one degree of freedom force(q)
    q0: tuple[float, ...]
    p0: tuple[float, ...]
    horizon: float = 4.0

    @property
    def dof(self) -> int:
        """Degrees of freedom."""
        return len(self.q0)


@_inlined
def _well(q):
    """-U' of U = q^4/4 - q^2/2."""
    return q - q * q * q


@_inlined
def _chain(q, f):
    """Masses between fixed ends, springs of force r + r^3."""
    n = len(q)
    before = q[0] * (1 + q[0] * q[0])
    for i in range(n - 1):
        r = q[i + 1] - q[i]
        after = r * (1 + r * r)
        f[i] = after - before
        before = after
    f[n - 1] = -q[n - 1] * (1 + q[n - 1] * q[n - 1]) - before


WAVE = tuple(math.sin(math.pi * (i + 1) / (MASSES + 1)) for i in range(MASSES))
SCENES = {"double well": Scene(_well, (1.0,), (0.0,)), "fpu64": Scene(_chain, WAVE, (0.0,) * MASSES)}


def phi(t: float) -> float:
    """(1 - exp(-gamma t))/gamma."""
    return -math.expm1(-GAMMA * t) / GAMMA


def flight(t: float) -> tuple[float, float, float, float, float]:
    """exp(-gamma t), phi, and E = a x, D = b x + c y of a flight in normal numbers x, y."""
    z = GAMMA * t
    var_e, cov = -math.expm1(-2 * z) / (2 * GAMMA), phi(t) ** 2 / 2
    var_d = (2 * z - 3 + 4 * math.exp(-z) - math.exp(-2 * z)) / (2 * GAMMA**3)
    a = math.sqrt(var_e)
    return math.exp(-z), phi(t), a, cov / a, math.sqrt(max(0.0, var_d - (cov / a) ** 2))


def constants(name: str, step: float) -> np.ndarray:
    """Constants of a step, with noise of strength sigma = sqrt(2 gamma)."""
    z, sigma = GAMMA * step, math.sqrt(2 * GAMMA)
    if name == "BAOAB":
        return np.array([math.exp(-z), math.sqrt(-math.expm1(-2 * z))])
    if name == "Strang":
        return np.array([math.exp(-z / 2), sigma * math.sqrt(step)])
    half, whole = flight(step / 2), flight(step)
    return np.array([*half[:2], *(sigma * x for x in half[2:]), *whole[:2], *(sigma * x for x in whole[2:])])


def loop(name: str, scene: Scene):
    """A function whose runs draw their own noise and give the sum of final positions."""
    run, of = _number(name, scene.force) if scene.dof == 1 else _array(name, scene.force), constants

    def run_of(generator, q0, p0, step, steps, paths):
        return run(generator, np.asarray(q0), np.asarray(p0), step, steps, paths, of(name, step))

    return run_of


def _number(name: str, force):
    """Loops of one degree of freedom."""

    @_fast
    def baoab(generator, q0, p0, h, steps, paths, c):
        total, decay, strength, half = 0.0, c[0], c[1], h / 2
        for _ in range(paths):
            q, p = q0[0], p0[0]
            f = force(q)
            for _ in range(steps):
                p += half * f
                q += half * p
                p = decay * p + strength * generator.standard_normal()
                q += half * p
                f = force(q)
                p += half * f
            total += q
        return total

    @_fast
    def strang(generator, q0, p0, h, steps, paths, c):
        total, decay, strength, half = 0.0, c[0], c[1] / 2, h / 2
        for _ in range(paths):
            q, p = q0[0], p0[0]
            f = force(q)
            for _ in range(steps):
                kick = strength * generator.standard_normal()
                p = decay * p + half * f + kick
                q += h * p
                f = force(q)
                p = decay * (p + half * f + kick)
            total += q
        return total

    @_fast
    def ubu(generator, q0, p0, h, steps, paths, c):
        total, e, move, a, b, d = 0.0, c[5], c[6], c[7], c[8], c[9]
        for _ in range(paths):
            x, y = generator.standard_normal(), generator.standard_normal()
            q, p = q0[0] + c[1] * p0[0] + c[3] * x + c[4] * y, c[0] * p0[0] + c[2] * x
            for _ in range(steps - 1):
                p += h * force(q)
                x, y = generator.standard_normal(), generator.standard_normal()
                q += move * p + b * x + d * y
                p = e * p + a * x
            p += h * force(q)
            q += c[1] * p + c[3] * generator.standard_normal() + c[4] * generator.standard_normal()
            total += q
        return total

    return {"BAOAB": baoab, "Strang": strang, "UBU": ubu}[name]


def _array(name: str, force):
    """Loops of several degrees of freedom."""

    @_fast
    def baoab(generator, q0, p0, h, steps, paths, c):
        n, total, decay, strength, half = len(q0), 0.0, c[0], c[1], h / 2
        q, p, f = np.empty(n), np.empty(n), np.empty(n)
        for _ in range(paths):
            q[:], p[:] = q0, p0
            force(q, f)
            for _ in range(steps):
                for j in range(n):
                    v = p[j] + half * f[j]
                    p[j] = decay * v + strength * generator.standard_normal()
                    q[j] += half * (v + p[j])
                force(q, f)
                for j in range(n):
                    p[j] += half * f[j]
            total += q[0]
        return total

    @_fast
    def strang(generator, q0, p0, h, steps, paths, c):
        n, total, decay, strength, half = len(q0), 0.0, c[0], c[1] / 2, h / 2
        q, p, f, kick = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
        for _ in range(paths):
            q[:], p[:] = q0, p0
            force(q, f)
            for _ in range(steps):
                for j in range(n):
                    kick[j] = strength * generator.standard_normal()
                    p[j] = decay * p[j] + half * f[j] + kick[j]
                    q[j] += h * p[j]
                force(q, f)
                for j in range(n):
                    p[j] = decay * (p[j] + half * f[j] + kick[j])
            total += q[0]
        return total

    @_fast
    def ubu(generator, q0, p0, h, steps, paths, c):
        n, total, e, move, a, b, d = len(q0), 0.0, c[5], c[6], c[7], c[8], c[9]
        q, p, f = np.empty(n), np.empty(n), np.empty(n)
        for _ in range(paths):
            for j in range(n):
                x, y = generator.standard_normal(), generator.standard_normal()
                q[j] = q0[j] + c[1] * p0[j] + c[3] * x + c[4] * y
                p[j] = c[0] * p0[j] + c[2] * x
            for _ in range(steps - 1):
                force(q, f)
                for j in range(n):
                    v = p[j] + h * f[j]
                    x, y = generator.standard_normal(), generator.standard_normal()
                    q[j] += move * v + b * x + d * y
                    p[j] = e * v + a * x
            force(q, f)
            for j in range(n):
                q[j] += c[1] * (p[j] + h * f[j])
                q[j] += c[3] * generator.standard_normal() + c[4] * generator.standard_normal()
            total += q[0]
        return total

    return {"BAOAB": baoab, "Strang": strang, "UBU": ubu}[name]


def flights(first: np.ndarray, t: float) -> np.ndarray:
    """(E, D) of pairs of flights that follow each other, each of length t: (flight/2, 2, dof, path)."""
    e, move = math.exp(-GAMMA * t), phi(t)
    (e1, d1), (e2, d2) = (np.moveaxis(first[i::2], 1, 0) for i in (0, 1))
    return np.stack([e * e1 + e2, d1 + d2 + move * e1], axis=1)


def given(name: str, scene: Scene, noise: np.ndarray) -> np.ndarray:
    """Final states (2 dof, path) on given noise, by NumPy: dW (step, dof, path), or for UBU (E, D) of half steps,
    (2 steps, 2, dof, path).
    """
    steps = len(noise) // (2 if name == "UBU" else 1)
    h, sigma, c = scene.horizon / steps, math.sqrt(2 * GAMMA), constants(name, scene.horizon / steps)
    shape = (scene.dof, noise.shape[-1])
    q, p = (np.array(np.broadcast_to(np.array(x)[:, None], shape)) for x in (scene.q0, scene.p0))
    for i in range(steps):
        if name == "BAOAB":
            v = p + h / 2 * forces(scene, q)
            q += h / 2 * v
            p = c[0] * v + c[1] / math.sqrt(h) * noise[i]
            q += h / 2 * p
            p += h / 2 * forces(scene, q)
        elif name == "Strang":
            p = c[0] * p + (h * forces(scene, q) + sigma * noise[i]) / 2
            q += h * p
            p = c[0] * (p + (h * forces(scene, q) + sigma * noise[i]) / 2)
        else:
            for k, kick in ((2 * i, h), (2 * i + 1, 0.0)):
                q += c[1] * p + sigma * noise[k, 1]
                p = c[0] * p + sigma * noise[k, 0]
                p += kick * forces(scene, q)
    return np.concatenate([q, p])


def forces(scene: Scene, q: np.ndarray) -> np.ndarray:
    """-U' of all paths, (dof, path), by NumPy."""
    if scene.dof == 1:
        return q - q**3
    r = np.diff(q, axis=0, prepend=0.0, append=0.0)
    return np.diff(r + r**3, axis=0)
