# SPDX-License-Identifier: BSD-3-Clause
# ruff: noqa: PLR0917
"""Closed scenes that users bring, as loops in numba without symsde.

    dq = H_p dt + sum_k H_{k,p} o dW_k,   dp = -H_q dt - sum_k H_{k,q} o dW_k,   H = D + K_0,   from 0 to T = 4

D is what drifts alone, with an exact flow; K_0 and the noises H_k give kicks. Loops as an expert writes them, path
after path, with -ffast-math and NumPy's generator:

    Strang    one kick with h and dW between two drifts of half a step
    Gauss     two kicks at Gauss' nodes, with h/2 and dW_k/2 +- sqrt(3) (dZ_k/h - dW_k/2), between three drifts
    Heun      the increment of the equation at both ends of a step, for lattices without a split

A loop is `loop(name, scene)(generator, q0, p0, step, steps, paths)`. `given(name, scene, noise)` makes the same steps
on given noise: (step, noise, path), for Gauss two numbers for each noise, those of both kicks.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numba
import numpy as np

FIELD = 2.0  #: strength of the magnetic field
HOPPING = 1.0  #: of the lattice
BODIES, SOFTENING = 3, 0.1
SITES = 64
LATTICE = 16
_fast = numba.njit(fastmath=True)
_inlined = numba.njit(inline="always", fastmath=True)


@dataclass(frozen=True)
class Scene:
    """Formulas of H and of the noises, a first state, and the parts of loops."""

    H: str
    noise: tuple[str, ...]
    q0: tuple[float, ...]
    p0: tuple[float, ...]
    kick: Callable  #: kick(q, p, h, w) adds -h K_0' - sum_k w_k H_k' to p, or turns (q, p)
    loops: tuple[str, ...] = ("Strang", "Gauss")
    drift: Callable | None = None  #: drift(q, p, c) with constants c = drift_constants(t); None for q + t p
    constants: Callable = lambda t: np.array([t])
    slope: Callable | None = None  #: slope(q, p, h, w, dq, dp) writes the increment of the equation
    sites: int | None = None
    horizon: float = 4.0
    more: dict = field(default_factory=dict)  #: further arguments of the library's formulas

    @property
    def dof(self) -> int:
        """Degrees of freedom."""
        return len(self.q0)

    @property
    def noises(self) -> int:
        """Noises, one for each site where the formula is that of a site."""
        return self.sites or len(self.noise)


@_inlined
def _free(q, p, c):
    for j in range(len(q)):
        q[j] += c[0] * p[j]


# ---- scenes --------------------------------------------------------------------------------------------------------


@_inlined
def _well(q, p, h, w):
    """K_0 = q^4/4 - q^2/2, noises s q and s q^2/2."""
    p[0] += h * (q[0] - q[0] * q[0] * q[0]) - 0.5 * (w[0] + w[1] * q[0])


@_inlined
def _duffing(q, p, h, w):
    """Two Duffing oscillators with a soft spring, three noises."""
    x, y = q[0], q[1]
    pull = h * 0.5 * (x - y) + 0.1 * w[2] * (x - y)
    p[0] -= h * (x + x * x * x) + pull + 0.2 * w[0] * math.cos(x)
    p[1] -= h * (y + y * y * y) - pull + 0.2 * w[1] * y


@_inlined
def _bodies(q, p, h, w):
    """Bodies of mass one in a plane with attraction -1/sqrt(r^2 + e^2), pushed as a whole by two noises."""
    for j in range(BODIES):
        p[2 * j] -= 0.1 * w[0] * q[2 * j]
        p[2 * j + 1] -= 0.1 * w[1] * q[2 * j + 1]
        for i in range(j):
            x, y = q[2 * j] - q[2 * i], q[2 * j + 1] - q[2 * i + 1]
            r2 = x * x + y * y + SOFTENING
            pull = h / (r2 * math.sqrt(r2))
            p[2 * j] -= pull * x
            p[2 * j + 1] -= pull * y
            p[2 * i] += pull * x
            p[2 * i + 1] += pull * y


@_inlined
def _ring(q, p, h, w):
    """phi^4 on a ring, noise .1 q_k^2 at each site."""
    n = len(q)
    for j in range(n):
        left, right = q[j - 1] if j > 0 else q[n - 1], q[j + 1] if j < n - 1 else q[0]
        p[j] -= h * (2 * q[j] - left - right - q[j] + q[j] * q[j] * q[j]) + 0.2 * w[j] * q[j]


@_inlined
def _trap(q, p, h, w):
    """K_0 = (x^4 + y^4)/4 in a magnetic field, pushed by two noises."""
    p[0] -= h * q[0] * q[0] * q[0] + 0.3 * w[0]
    p[1] -= h * q[1] * q[1] * q[1] + 0.3 * w[1]


@_inlined
def _gyration(q, p, c):
    """The exact flow of ((p_1 + B q_2/2)^2 + (p_2 - B q_1/2)^2)/2: velocities turn by B t."""
    u, v = p[0] + 0.5 * FIELD * q[1], p[1] - 0.5 * FIELD * q[0]
    q[0] += c[0] * u + c[1] * v
    q[1] += c[0] * v - c[1] * u
    u, v = c[2] * u + c[3] * v, c[2] * v - c[3] * u
    p[0], p[1] = u - 0.5 * FIELD * q[1], v + 0.5 * FIELD * q[0]


def _gyration_constants(t: float) -> np.ndarray:
    """Sin(Bt)/B, (1 - cos(Bt))/B, cos(Bt), sin(Bt)."""
    z = FIELD * t
    return np.array([math.sin(z) / FIELD, (1 - math.cos(z)) / FIELD, math.cos(z), math.sin(z)])


@_inlined
def _phases(q, p, h, w):
    """Sites turn by the angle h I_k + s w_k, with I_k = (q_k^2 + p_k^2)/2."""
    for j in range(len(q)):
        angle = h * 0.5 * (q[j] * q[j] + p[j] * p[j]) + 0.3 * w[j]
        c, s = math.cos(angle), math.sin(angle)
        q[j], p[j] = c * q[j] + s * p[j], c * p[j] - s * q[j]


@_inlined
def _hop(q, p, c):
    """The exact flow of the hopping: q + ip turns by a matrix."""
    n = len(q)
    x, y = np.empty(n), np.empty(n)
    for i in range(n):
        a = b = 0.0
        for j in range(n):
            a += c[i, j].real * q[j] - c[i, j].imag * p[j]
            b += c[i, j].imag * q[j] + c[i, j].real * p[j]
        x[i], y[i] = a, b
    q[:], p[:] = x, y


def _hop_constants(t: float) -> np.ndarray:
    """exp(-i t A) of q + ip, A the matrix of neighbours times the hopping: H_p = A p, -H_q = -A q."""
    k = 2 * np.pi * np.arange(LATTICE) / LATTICE
    wave = np.exp(1j * np.outer(np.arange(LATTICE), k)) / math.sqrt(LATTICE)
    return np.ascontiguousarray((wave * np.exp(-2j * HOPPING * t * np.cos(k))) @ wave.conj().T)


@_inlined
def _lattice(q, p, h, w, dq, dp):
    """The increment of the lattice."""
    n = len(q)
    for j in range(n):
        i, k = (j - 1 if j > 0 else n - 1), (j + 1 if j < n - 1 else 0)
        rate = h * 0.5 * (q[j] * q[j] + p[j] * p[j]) + 0.3 * w[j]
        dq[j] = h * HOPPING * (p[i] + p[k]) + rate * p[j]
        dp[j] = -h * HOPPING * (q[i] + q[k]) - rate * q[j]


def _attraction() -> str:
    pairs = [(i, j) for j in range(BODIES) for i in range(j)]
    apart = "(q{}-q{})**2+(q{}-q{})**2"
    return " - ".join(
        f"1/sqrt({apart.format(2 * i + 1, 2 * j + 1, 2 * i + 2, 2 * j + 2)}+{SOFTENING})" for i, j in pairs
    )


def _squares(letter: str, indices: range) -> str:
    return "+".join(f"{letter}{i}**2" for i in indices)


_TRIANGLE = (1.0, 0.0, -0.5, 0.8, -0.5, -0.8)
_TURNING = (0.0, 0.6, -0.5, -0.3, 0.5, -0.3)
_WAVE = tuple(0.5 * math.sin(2 * math.pi * i / SITES) for i in range(SITES))
_PACKET = tuple(math.exp(-((i - 8) ** 2) / 8) for i in range(LATTICE))
SCENES = {
    "double well": Scene("p**2/2 + q**4/4 - q**2/2", ("0.5*q", "0.5*q**2/2"), (1.0,), (0.0,), _well),
    "Duffing, 2 degrees": Scene(
        "(p1**2+p2**2)/2 + (q1**2+q2**2)/2 + (q1**4+q2**4)/4 + 0.25*(q1-q2)**2",
        ("0.2*sin(q1)", "0.1*q2**2", "0.05*(q1-q2)**2"), (1.0, -0.5), (0.0, 0.3), _duffing,
    ),
    "3 bodies": Scene(
        f"({_squares('p', range(1, 7))})/2 - {_attraction()}",
        (f"0.05*({_squares('q', range(1, 7, 2))})", f"0.05*({_squares('q', range(2, 7, 2))})"),
        _TRIANGLE, _TURNING, _bodies,
    ),
    "phi^4 ring of 64": Scene(
        "Sum(p[i]**2/2 + (q[i+1]-q[i])**2/2 - q[i]**2/2 + q[i]**4/4, i)", ("0.1*q[k]**2",), _WAVE,
        (0.0,) * SITES, _ring, sites=SITES, more={"n": SITES, "ends": "periodic"},
    ),
    "magnetic field": Scene(
        f"((p1 + {FIELD / 2}*q2)**2 + (p2 - {FIELD / 2}*q1)**2)/2 + (q1**4 + q2**4)/4", ("0.3*q1", "0.3*q2"),
        (1.0, 0.0), (0.0, 0.5), _trap, drift=_gyration, constants=_gyration_constants,
    ),
    "Schroedinger lattice of 16": Scene(
        f"Sum({HOPPING}*(q[i]*q[i+1] + p[i]*p[i+1]) + (q[i]**2 + p[i]**2)**2/8, i)",
        ("0.3*(q[k]**2 + p[k]**2)/2",), _PACKET, (0.0,) * LATTICE, _phases, ("Strang", "Gauss", "Heun"),
        drift=_hop, constants=_hop_constants, slope=_lattice, sites=LATTICE, more={"n": LATTICE, "ends": "periodic"},
    ),
}  # fmt: skip


# ---- loops ---------------------------------------------------------------------------------------------------------


@_inlined
def _drawn(generator, i, length, x):
    for k in range(len(x)):
        x[k] = math.sqrt(length) * generator.standard_normal()


@_inlined
def _kicks_drawn(generator, i, length, x):
    half, m = 0.5 * math.sqrt(length), len(x) // 2
    for k in range(m):
        u, v = generator.standard_normal(), generator.standard_normal()
        x[k], x[m + k] = half * (u + v), half * (u - v)


@_inlined
def _copied(noise, i, length, x):
    x[:] = noise[i]


def _compiled(name: str, scene: Scene, draw):
    """path(source, q, p, h, steps, noises, first, middle, whole), which moves one path to its end."""
    kick, drift, slope = scene.kick, scene.drift or _free, scene.slope

    @_fast
    def strang(source, q, p, h, steps, m, first, middle, whole):
        w = np.empty(m)
        drift(q, p, middle)
        for i in range(steps):
            draw(source, i, h, w)
            kick(q, p, h, w)
            if i < steps - 1:
                drift(q, p, whole)
        drift(q, p, middle)

    @_fast
    def gauss(source, q, p, h, steps, m, first, middle, whole):
        w = np.empty(2 * m)
        drift(q, p, first)
        for i in range(steps):
            draw(source, i, h, w)
            kick(q, p, h / 2, w[:m])
            drift(q, p, middle)
            kick(q, p, h / 2, w[m:])
            if i < steps - 1:
                drift(q, p, whole)
        drift(q, p, first)

    @_fast
    def heun(source, q, p, h, steps, m, first, middle, whole):
        n, w = len(q), np.empty(m)
        a, b, c, d, x, y = np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n)
        for i in range(steps):
            draw(source, i, h, w)
            slope(q, p, h, w, a, b)
            for j in range(n):
                x[j], y[j] = q[j] + a[j], p[j] + b[j]
            slope(x, y, h, w, c, d)
            for j in range(n):
                q[j] += 0.5 * (a[j] + c[j])
                p[j] += 0.5 * (b[j] + d[j])

    return {"Strang": strang, "Gauss": gauss, "Heun": heun}[name]


def _drifts(name: str, scene: Scene, h: float) -> tuple:
    """Constants of the drifts at the ends, between kicks, and from step to step."""
    if name == "Gauss":
        c = 0.5 - math.sqrt(3) / 6
        return tuple(scene.constants(x * h) for x in (c, 1 - 2 * c, 2 * c))
    return tuple(scene.constants(x * h) for x in (0.5, 0.5, 1.0))


def loop(name: str, scene: Scene):
    """A function whose runs draw their own noise and give the sum of final positions."""
    path, noises = _compiled(name, scene, _kicks_drawn if name == "Gauss" else _drawn), scene.noises

    @_fast
    def run(generator, q0, p0, h, steps, paths, first, middle, whole):
        total, q, p = 0.0, q0.copy(), p0.copy()
        for _ in range(paths):
            q[:], p[:] = q0, p0
            path(generator, q, p, h, steps, noises, first, middle, whole)
            total += q[0]
        return total

    def run_of(generator, q0, p0, step, steps, paths):
        return run(generator, np.array(q0), np.array(p0), step, steps, paths, *_drifts(name, scene, step))

    return run_of


def given(name: str, scene: Scene, noise: np.ndarray) -> np.ndarray:
    """Final states (2 dof, path) on given noise (step, noise, path); for Gauss (step, 2 noises, path), the numbers of
    the first kick before those of the second.
    """
    steps, h = len(noise), scene.horizon / len(noise)
    path, drifts = _compiled(name, scene, _copied), _drifts(name, scene, h)
    ends = []
    for own in np.moveaxis(noise, -1, 0):
        q, p = np.array(scene.q0), np.array(scene.p0)
        path(np.ascontiguousarray(own), q, p, h, steps, scene.noises, *drifts)
        ends.append(np.concatenate([q, p]))
    return np.array(ends).T
