# SPDX-License-Identifier: BSD-3-Clause
"""The built-in models. All quantities are dimensionless.

Each model represents the Stratonovich equations

    dp = -H_q dt - sum_k H_{k,q} o dW_k        dq = H_p dt + sum_k H_{k,p} o dW_k

[WHSB] are equation numbers of the paper. A parameter is a number, or an array (path,) with a value for each path of a
run (n of the chain: a number). Parameters that are not finite raise InvalidArgumentError.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from typing import ParamSpec

import numpy as np

from .model.definition import HAMILTONIANS, Model
from .native import checks, handles

_P = ParamSpec("_P")
Parameter = float | Sequence[float] | np.ndarray  #: a number, or numbers (path,), one for each path of a run


def names() -> list[str]:
    """Names of the built-in models."""
    return handles.text("model_names").split()


def parameters(name: str) -> dict[str, float]:
    """Parameters of a built-in model with their defaults; UnknownNameError names the nearest."""
    given = handles.encode(checks.name_of("model", name))
    if name not in (known := names()):
        raise checks.none_such("model", name, known)
    lines = handles.text("model_parameters", given, has_error=True).splitlines()
    pairs = (line.split("=") for line in lines if line.strip())
    return {key.strip(): float(value) for key, value in pairs}


def get(name: str, **values: Parameter) -> Model:
    """A built-in model by name; parameters that are not given keep their defaults."""
    return Model.builtin(name, {**parameters(name), **values})


def _built_in(make: Callable[_P, Model]) -> Callable[_P, Model]:
    """Decorate the function of a built-in model: hint at misspelt arguments; notebooks show the H of its docstring."""
    HAMILTONIANS[make.__name__] = re.findall(r"\bH(?:_\w)? = .*?(?=, H_|:|\.\s)", make.__doc__ or "")
    return checks.hinted()(make)


@_built_in
def kubo(a: Parameter = 1.0, sigma: Parameter = 0.3) -> Model:
    """Kubo oscillator [WHSB] (35)-(37): H = a (p^2 + q^2)/2, H_1 = sigma (p^2 + q^2)/2.

    The state rotates by the angle sigma W(t) + a t, so p^2 + q^2 is invariant.
    """
    return Model.builtin("kubo", {"a": a, "sigma": sigma})


@_built_in
def linear_oscillator(sigma: Parameter = 1.0) -> Model:
    """Linear stochastic oscillator [WHSB] (20)-(21): H = (p^2 + q^2)/2, H_1 = -sigma q.

    dp = -q dt + sigma dW, dq = p dt; E(p^2 + q^2) grows by sigma^2 t, [WHSB] (24).
    """
    return Model.builtin("linear_oscillator", {"sigma": sigma})


@_built_in
def synchrotron(omega: Parameter = 2.0, sigma1: Parameter = 0.2, sigma2: Parameter = 0.1) -> Model:
    """Synchrotron oscillations [WHSB] (73)-(75): H = p^2/2 - omega^2 cos q.

    H_1 = sigma1 sin q, H_2 = -sigma2 cos q.
    """
    return Model.builtin("synchrotron", {"omega": omega, "sigma1": sigma1, "sigma2": sigma2})


@_built_in
def additive_oscillator(sigma: Parameter = 0.0, gamma: Parameter = 1.0) -> Model:
    """Oscillator with two additive noises [WHSB] (84)-(86): H = (p^2 + q^2)/2.

    H_1 = sigma p, H_2 = -gamma q: dp = -q dt + gamma dW_2, dq = p dt + sigma dW_1.
    """
    return Model.builtin("additive_oscillator", {"sigma": sigma, "gamma": gamma})


@_built_in
def pendulum(sigma: Parameter = 0.5) -> Model:
    """Pendulum with multiplicative noise: H = p^2/2 - cos q, H_1 = sigma (p^2 + q^2)/2.

    One-sided schemes need their correction here.
    """
    return Model.builtin("pendulum", {"sigma": sigma})


@_built_in
def driven_pendulum(
    omega: Parameter = 1.0,
    epsilon: Parameter = 0.3,
    nu: Parameter = 2.0,
    *,
    sigma1: Parameter = 0.2,
    sigma2: Parameter = 0.1,
    alpha: Parameter = 0.5,
) -> Model:
    """Pendulum driven at its point of suspension: H = p^2/2 - omega^2 (1 + epsilon cos(nu t)) cos q.

    H_1 = -sigma1 (1 + alpha sin(nu t)) q, H_2 = -sigma2 (1 + alpha sin(nu t)) cos q.

    Potential and noises depend on time; with sigma2 = 0 the noise is additive. nu = 2 omega is the main
    parametric resonance.
    """
    values = {"omega": omega, "epsilon": epsilon, "nu": nu, "sigma1": sigma1, "sigma2": sigma2, "alpha": alpha}
    return Model.builtin("driven_pendulum", values)


@_built_in
def noncommutative_oscillator(s1: Parameter = 0.5, s2: Parameter = 0.5) -> Model:
    """Oscillator whose noises do not commute: H = (p^2 + q^2)/2, H_1 = s1 p^2/2, H_2 = s2 q^2/2.

    {H_1, H_2} = -s1 s2 p q; the moments are known exactly.
    """
    return Model.builtin("noncommutative_oscillator", {"s1": s1, "s2": s2})


@_built_in
def henon_heiles(alpha: Parameter = 1.0, sigma1: Parameter = 0.1, sigma2: Parameter = 0.1) -> Model:
    """Henon-Heiles system, two degrees of freedom: H = (p.p + q.q)/2 + alpha (q1^2 q2 - q2^3/3).

    H_1 = sigma1 q1, H_2 = sigma2 q2. The potential is unbounded below: paths escape and then fail.
    """
    return Model.builtin("henon_heiles", {"alpha": alpha, "sigma1": sigma1, "sigma2": sigma2})


@_built_in
def fpu_chain(n: int = 32, beta: float = 1.0, sigma: float = 0.1) -> Model:
    """Fermi-Pasta-Ulam chain of n masses between fixed ends, with an additive noise on every momentum.

    H = sum p_i^2/2 + sum (r_i^2/2 + beta r_i^4/4) with r_i = q_{i+1} - q_i, H_k = -sigma q_k.
    """
    return Model.builtin("fpu_chain", {"n": n, "beta": beta, "sigma": sigma})
