# SPDX-License-Identifier: BSD-3-Clause
"""Heat baths: friction on momenta, and the noise that belongs to it."""

from __future__ import annotations

import ctypes
import functools
from collections.abc import Callable
from typing import Any

import numpy as np

from ..errors import InvalidArgumentError, OwnNoiseWarning, WrongShapeError
from ..native import checks, handles
from .definition import Model, ModelHandle, require_model


@checks.hinted()
def thermostat(model: Model, *, beta: Any, gamma: Any) -> Model:
    """The model in a heat bath of the temperature kT = 1/beta: friction on every momentum, and the noise with it.

        dp_i = .. - gamma_i p_i dt + sigma_i dW_{m+i}      sigma_i^2 = 2 gamma_i m_i / beta

    - gamma: rates of the momenta [1/time], a number or (dof,); where it is zero, a degree of freedom feels no bath
    - beta: 1/kT [1/energy], a number, or (dof,) for baths of several temperatures

    One additive noise H_{m+i} = -sigma_i q_i for each degree of freedom stands behind the m noises of the model; masses
    m_i are taken from it. With one beta exp(-beta H) is the stationary density; with several there is a flow of heat.
    A model with noises of its own is heated by them, too: a warning says so.

    Refused (IncompatibleError): a model that is damped, and one that does not declare H = sum_i p_i^2/(2 m_i) + U(q)
    with constants m_i (identity_mass or constant_mass), since friction on p would not know its temperature.
    """
    require_model(model)
    rates, betas = (_one_or_each(key, value, model.ndof) for key, value in (("gamma", gamma), ("beta", beta)))
    bathed = _noisy(model, rates, betas).damped(rates)
    if any(k not in model.traits.silent for k in range(1, model.nnoise + 1)):
        checks.warn(
            f"model {model.name} has noises of its own, which heat it beside the bath: its temperature is above "
            "1/beta; give a model without noise, or with noises of strength zero",
            OwnNoiseWarning,
        )
    return bathed


def _noisy(model: Model, gamma: tuple[float, ...], beta: tuple[float, ...]) -> Model:
    """A model with the noises of its bath, without the friction."""
    noisy = object.__new__(Model)
    noisy.in_python = model.in_python
    noisy.check_start = model.check_start
    noisy._remade = (_noisy, (model, gamma, beta))
    noisy._adopt(functools.partial(_noisy_handle, model._handles.made, gamma, beta), model.name, dict(model.parameters))
    noisy._coordinates = model._coordinates
    which = f"H_{model.nnoise + 1}" + (f" .. H_{noisy.nnoise}" if model.ndof > 1 else "")
    noisy._hamiltonians = [*model._hamiltonians, f"{which} = -sqrt(2 gamma_i m_i/beta) q_i"]
    noisy._bath, noisy._forces = beta, model._forces
    return noisy


def _noisy_handle(make: Callable[[], ModelHandle], gamma: tuple[float, ...], beta: tuple[float, ...]) -> ModelHandle:
    """A handle of a model with the noises of its bath, which is damped afterwards as any model is."""
    handle = make()
    rates, betas = ((ctypes.c_double * len(x))(*x) for x in (gamma, beta))
    handles.call("model_thermostat", handle.pointer, len(gamma), rates, len(beta), betas)
    handles.call("model_set_damping", handle.pointer, 1, (ctypes.c_double * 1)(0.0), 0)
    return handle


def _one_or_each(key: str, value: Any, ndof: int) -> tuple[float, ...]:
    """A number, or one for each degree of freedom."""
    numbers = np.atleast_1d(checks.real_array(key, value))
    if numbers.ndim != 1 or numbers.size not in (1, ndof):
        raise WrongShapeError(f"{key} has shape {numbers.shape}: give a number, or ({ndof},), one for each q_i and p_i")
    if not np.isfinite(numbers).all() or (numbers <= 0).all():
        raise InvalidArgumentError(f"{key} = {checks.shown(value)}: give finite numbers above zero")
    return tuple(float(x) for x in numbers)
