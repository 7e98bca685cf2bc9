# SPDX-License-Identifier: BSD-3-Clause
"""How a scheme reproduces a heat bath: contraction, the exact stationary law of an oscillator, free particles.

A step of a linear model is x <- M x + N xi, with numbers xi of variance one for dW, dZ and K. M and N are read off
steps of the library itself, from unit states and unit functionals. So the law S = M S M^T + N N^T, three equations for
<q^2>, <q p> and <p^2>, is the law of the code, exact in h.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..errors import IncompatibleError, InvalidArgumentError
from ..model.definition import Model
from ..native import checks
from ..schemes import Order, Scheme, as_scheme
from ..show import tables
from .simulate import simulate

_STATES = np.array([[0.3, -0.4], [1.7, 0.8], [-2.4, 1.1], [0.9, -1.6]]).T  #: (q or p, point): where M is looked at
_NOISE = np.array([0.4, -0.3, 0.7, 0.1])  #: normal numbers of dW at these points
_SHIFT = 1e-5  #: shift of central differences, which find M to some 1e-10
_SEEN = 1e-8  #: a smaller difference counts as zero


@dataclass(frozen=True)
class BathLaw:
    """The law of a scheme in a heat bath; every ratio is one for the exact flow."""

    scheme: str  #: name of the scheme
    step: float  #: h
    gamma: float  #: rate of the momenta
    omega: float  #: frequency of the oscillator
    friction: str  #: "damping", or "force" for F = -gamma p
    contraction: str  #: the factor of dp ^ dq in a step
    defect: float  #: largest distance of this factor from exp(-gamma h) at four states of a pendulum
    q_squared: float  #: beta omega^2 <q^2>
    q_p: float  #: beta omega <q p>, which is zero for the exact flow
    p_squared: float  #: beta <p^2>
    free_temperature: float  #: beta <p^2> of a free particle
    free_diffusion: float  #: diffusion of a free particle over 1/(beta gamma)
    strong_order: Order  #: for additive noise, as the noise of a bath is

    def __str__(self) -> str:
        """A line for each number, with its evidence."""
        lines = {
            "scheme": f"{self.scheme}, h = {self.step:g}, gamma = {self.gamma:g}, omega = {self.omega:g}"
            + (", F = -gamma p as a force" if self.friction == "force" else ""),
            "dp ^ dq": f"{self.contraction}",
            "omega^2 <q^2>": f"{_rounded(self.q_squared)}/beta",
            "omega <q p>": f"{_rounded(self.q_p)}/beta",
            "<p^2>": f"{_rounded(self.p_squared)}/beta",
            "free <p^2>": f"{_rounded(self.free_temperature)}/beta",
            "free diffusion": f"{_rounded(self.free_diffusion)}/(beta gamma)",
            "strong order": f"{self.strong_order.value:g} ({self.strong_order.evidence}), as without damping",
            "evidence": "dp ^ dq by differences of steps at four states of a pendulum; laws by S = M S M^T + Q, with M",
            "": "and Q of the library's own steps",
        }
        return tables.facts(lines.items(), 16)


def _rounded(x: float) -> str:
    """Round to twelve digits; numbers that are rounding errors of zero become zero."""
    return f"{x if abs(x) > 1e-13 else 0.0:.12g}"


def bath_law(
    scheme: str | Scheme, *, step: float, gamma: float, omega: float = 1.0, friction: str = "damping"
) -> BathLaw:
    """The law of a scheme in a heat bath, exact in h: see `BathLaw`.

    - step, gamma: h [time] and the rate of the momenta [1/time], above zero
    - omega: the frequency of the oscillator H = p^2/2 + omega^2 q^2/2 [1/time], above zero
    - friction: "damping", of ``model.damped``, or "force", F = -gamma p of ``model.forced``, [WHSB] (16)-(17)

    IncompatibleError: the scheme does not run such models, or its steps have no stationary law at this h omega.
    UnknownNameError: another name of friction.
    """
    checks.choice("friction", friction, list(_FRICTION))
    chosen = as_scheme(scheme)
    h, rate, frequency = (checks.number(key, x) for key, x in (("step", step), ("gamma", gamma), ("omega", omega)))
    for key, value in (("step", h), ("gamma", rate), ("omega", frequency)):
        if not value > 0:
            raise InvalidArgumentError(f"{key} = {value:g}: give a number above zero")
    sigma = math.sqrt(2 * rate)
    lossy = _FRICTION[friction]
    m, noise = _linear_step(lossy(_bound(frequency**2, sigma), rate), chosen, h)
    if not np.abs(np.linalg.eigvals(m)).max() < 1:
        raise IncompatibleError(
            f"steps of {chosen.name} grow at omega h = {frequency * h:g}, gamma h = {rate * h:g}: there is no "
            "stationary law; give a smaller step"
        )
    s = np.linalg.solve(np.eye(4) - np.kron(m, m), (noise @ noise.T).ravel())
    with checks.unwarned():  # of gamma h the first step has warned
        free, kicks = _linear_step(lossy(_bound(0.0, sigma), rate), chosen, h)
        contraction, defect = _contraction(chosen, h, rate, lossy(_pendulum(), rate))
    temperature = (kicks[1] ** 2).sum() / (1 - free[1, 1] ** 2)
    # q + m_qp/(1 - m_pp) p moves by its noise alone.
    moved = kicks[0] + free[0, 1] / (1 - free[1, 1]) * kicks[1]
    return BathLaw(
        scheme=chosen.name,
        step=h,
        gamma=rate,
        omega=frequency,
        friction=friction,
        contraction=contraction,
        defect=defect,
        q_squared=float(s[0] * frequency**2),
        q_p=float(s[1] * frequency),
        p_squared=float(s[3]),
        free_temperature=float(temperature),
        free_diffusion=float((moved**2).sum() * rate / (2 * h)),
        strong_order=chosen.info.orders["additive"],
    )


def _bound(square: float, sigma: float) -> Model:
    """H = p^2/2 + square q^2/2, H_1 = -sigma q."""

    def gradient(t, w, q, p):
        return square * w[0] * q - sigma * w[1], w[0] * p

    def hessian(t, w, q, p):
        one = np.ones((1, 1, 1)) * w[0]
        return square * one, 0 * one, one

    traits = dict.fromkeys(("separable", "additive", "position_noise", "quadratic", "identity_mass"), True)
    turn = [float(np.sqrt(square))]
    return Model(ndof=1, nnoise=1, gradient=gradient, hessian=hessian, name="oscillator", rotation=turn, **traits)


def _pendulum() -> Model:
    """H = p^2/2 - cos q, H_1 = -q: its steps depend on the state."""

    def gradient(t, w, q, p):
        return w[0] * np.sin(q) - w[1], w[0] * p

    def hessian(t, w, q, p):
        one = np.ones((1, 1, 1)) * w[0]
        return one * np.cos(q)[0], 0 * one, one

    traits = dict.fromkeys(("separable", "additive", "position_noise", "identity_mass"), True)
    return Model(ndof=1, nnoise=1, gradient=gradient, hessian=hessian, name="pendulum", rotation=[1.0], **traits)


def _damped(model: Model, rate: float) -> Model:
    """The model with damping."""
    return model.damped(rate)


def _forced(model: Model, rate: float) -> Model:
    """The model with F = -rate p as a force without declared properties."""

    def slopes(q, p, t):
        return np.zeros((1, 1, q.shape[-1])), np.full((1, 1, q.shape[-1]), -rate)

    return model.forced(lambda q, p, t: -rate * p, force_derivative=slopes)


_FRICTION = {"damping": _damped, "force": _forced}


def _step(model: Model, scheme: Scheme, h: float, states: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """One step from states (2, point), driven by normal numbers (3, point) of dW, a = dZ/h - dW/2 and K."""
    dw, a, stt = normals * np.sqrt(h / np.array([[1.0], [12.0], [720.0]]))
    columns = [dw, *([h * (a + dw / 2)] if scheme.info.uses_dz else []), *([stt] if scheme.info.uses_stt_area else [])]
    run = simulate(model, q0=states[:1], p0=states[1:], paths=states.shape[1], step=h, steps=1, scheme=scheme,
                   increments=np.array(columns)[np.newaxis])  # fmt: skip
    return np.array([run.q[1, 0], run.p[1, 0]])


def _linear_step(model: Model, scheme: Scheme, h: float) -> tuple[np.ndarray, np.ndarray]:
    """M (2, 2) and N (2, 3) of x <- M x + N xi."""
    found = _step(model, scheme, h, np.eye(2, 5), np.eye(3, 5, 2))
    return found[:, :2], found[:, 2:]


def _contraction(scheme: Scheme, h: float, gamma: float, model: Model) -> tuple[str, float]:
    """The factors by which a step multiplies dp ^ dq at four states, and the largest distance from exp(-gamma h)."""
    noise = np.vstack([_NOISE, np.zeros((2, _NOISE.size))])

    def derivative(axis: int) -> np.ndarray:
        shift = _SHIFT * np.eye(2)[:, [axis]]
        ahead, behind = (_step(model, scheme, h, _STATES + x, noise) for x in (shift, -shift))
        return (ahead - behind) / (2 * _SHIFT)

    by_q, by_p = derivative(0), derivative(1)
    factors = by_q[0] * by_p[1] - by_q[1] * by_p[0]
    z, spread = gamma * h, float(np.ptp(factors))
    forms = {
        "exp(-gamma h)": math.exp(-z),
        "(1 - z/2)/(1 + z/2)": (1 - z / 2) / (1 + z / 2),
        "1/(1 + z)": 1 / (1 + z),
        "1 - z": 1 - z,
    }
    distance = {text: float(np.abs(factors - value).max()) for text, value in forms.items()}
    defect = distance["exp(-gamma h)"]
    near = [text for text, far in distance.items() if far < _SEEN]
    if len(near) > 1:
        return f"times {factors[0]:.8g}, where gamma h = {z:g} is too small to tell {near[0]} from {near[1]}", defect
    if near and near[0] == "exp(-gamma h)":
        return f"times exp(-gamma h) = {math.exp(-z):.12g}, exactly", defect
    if near:
        return f"times {near[0]} = {forms[near[0]]:.10g} with z = gamma h, at all of them", defect
    if spread > _SEEN:
        return f"times {factors.min():.6g} to {factors.max():.6g}: it depends on the state", defect
    return f"times {factors[0]:.10g}, at all of them", defect
