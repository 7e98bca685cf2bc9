# SPDX-License-Identifier: BSD-3-Clause
"""Heat baths: friction on momenta, and the noise that belongs to it."""

from __future__ import annotations

import ctypes
import functools
from collections.abc import Callable
from typing import Any

import numpy as np

from ..errors import IncompatibleError, InvalidArgumentError, OwnNoiseWarning, WrongShapeError
from ..native import checks, handles
from .definition import Model, require_model
from .user_handles import ModelHandle

_TOLERANCE = 1e-9  #: relative differences that are rounding, of derivatives by differences, too


@checks.hinted()
def thermostat(model: Model, *, beta: Any, gamma: Any = None) -> Model:
    """The model in a heat bath of the temperature kT = 1/beta: friction on every momentum, and the noise with it.

        dp_i = .. - gamma_i p_i dt + sigma_i dW_{m+i}      sigma_i^2 = 2 gamma_i m_i / beta

    - gamma: rates of the momenta [1/time], a number or (dof,); where it is zero, a degree of freedom feels no bath
    - beta: 1/kT [1/energy], a number, or (dof,) for baths of several temperatures

    One additive noise H_{m+i} = -sigma_i q_i for each degree of freedom stands behind the m noises of the model; masses
    m_i are taken from it. With one beta exp(-beta H) is the stationary density; with several there is a flow of heat.
    A model with noises of its own is heated by them, too: a warning says so. All parameters but masses may go by path.
    `with_parameters` gives a bath of the same gamma and beta, whose noise follows the masses.

    Without gamma the bath is made of the noises that the model has. Of H_k = -f_k.q with constant f_k it gets the
    friction on velocities that belongs to them, Gamma = beta/2 sum_k f_k f_k^T (`Model.damped`); of other noises in
    position the force -beta/2 sum_k H_k,q (H_k,q . H_p), for any H: of models of formulas it is a formula, of others a
    function of Python (`Model.forced`). A model that is damped already is given back if its friction is that one,
    sum_k f_k f_k^T = (Gamma + Gamma^T)/beta to 1e-9; InvalidArgumentError says by how much it is not.

    Refused (IncompatibleError): with gamma, a model that is damped; one that does not declare H = sum_i p_i^2/(2 m_i) +
    U(q) with constants m_i (identity_mass or constant_mass), since friction on p would not know its temperature; and
    without gamma, noises that depend on p, whose friction would move positions.
    """
    require_model(model)
    if gamma is None:
        return _by_own_noises(model, beta)
    rates, betas = (_one_or_each(key, value, model.ndof) for key, value in (("gamma", gamma), ("beta", beta)))
    bathed = _bathed(model, rates, betas)
    if model.traits.acting:
        checks.warn(
            f"model {model.name} has noises of its own, which heat it beside the bath: its temperature is above "
            "1/beta; give a model without noise, or with noises of strength zero",
            OwnNoiseWarning,
        )
    return bathed


def _bathed(model: Model, gamma: tuple[float, ...], beta: tuple[float, ...]) -> Model:
    """A model with the friction and the noises of a bath."""
    noisy = _noisy(model, gamma, beta)
    own = _by_formulas(model, gamma, beta)
    if own is not None:
        own._hamiltonians = noisy._hamiltonians
    made = _bathed, model, gamma, beta
    return (own or noisy).damped(gamma)._in_bath(beta, fluctuating="" if own is None else "noises", bathed=made)


def _by_own_noises(model: Model, beta: Any) -> Model:
    """A model with the friction that belongs to its noises, or as it is if it has that friction."""
    inverse_temperature = checks.number("beta", beta)
    if not inverse_temperature > 0:
        raise InvalidArgumentError(f"beta = {inverse_temperature:g}: give a number above zero")
    if model._forces:
        raise IncompatibleError(
            f"forces act on model {model.name}, and the friction of a bath is found from noises of Hamiltonians: give "
            "the model without forces, or gamma, too"
        )
    if model._varying:
        raise IncompatibleError(
            f"the rates of damping of model {model.name} are functions, and a bath is checked against numbers: give "
            "the model without damping to get the friction that belongs to its noises"
        )
    if model.paths:
        raise IncompatibleError(
            f"parameters of model {model.name} differ from path to path, and the friction of a bath is found for one "
            "value of each: call thermostat for each value, or give gamma, too"
        )
    found = _with_own_friction(model, inverse_temperature)
    return (
        model if found is model else found._in_bath((inverse_temperature,), "" if found._derives_bath else "friction")
    )


def _with_own_friction(model: Model, inverse_temperature: float) -> Model:
    """A model with the friction that belongs to its noises at 1/inverse_temperature, or the same model."""
    if not model.damping and not _is_linear(model) and model.traits.acting:
        return model._rubbed_by_noises(inverse_temperature)
    forces = _constant_forces(model)
    product = forces @ forces.T
    if not model.damping:
        friction = inverse_temperature / 2 * product
        masses = diagonal_masses(model)
        if masses is not None and not np.any(friction - np.diag(np.diag(friction))):
            return model.damped(np.diag(friction) / masses)  # rates, for which more schemes and laws are known
        return model.damped(friction)
    friction = np.array(model.damping)
    if not model.has_friction:
        masses = diagonal_masses(model)
        if masses is None:
            raise IncompatibleError(
                f"model {model.name} has rates of damping and a mass that is not diagonal: give it friction on "
                "velocities, a matrix"
            )
        friction = np.diag(friction * masses)
    wanted = (friction + friction.T) / inverse_temperature
    off = np.abs(product - wanted).max()
    if not off <= _TOLERANCE * np.abs(wanted).max():
        own = 2 * np.trace(friction) / np.trace(product)
        raise InvalidArgumentError(
            f"the noises of model {model.name} do not belong to its friction at beta = {inverse_temperature:g}: sum_k "
            f"f_k f_k^T differs from (Gamma + Gamma^T)/beta by {off:.3g}, where the latter is up to "
            f"{np.abs(wanted).max():.3g}; traces would agree at beta = {own:.6g}. Give the model without damping to "
            "get the friction that belongs to its noises"
        )
    return model


def _is_linear(model: Model) -> bool:
    """Whether noises are linear in q by their traits, or are not of q alone, which is refused later."""
    return model.traits.additive or not model.traits.position_noise


def _constant_forces(model: Model) -> np.ndarray:
    """f_k of noises H_k = -f_k.q, one in each column (dof, noise)."""
    traits = model.traits
    noises = traits.acting
    if not noises:
        raise IncompatibleError(
            f"model {model.name} has no noise of its own: give gamma, too, and the bath brings noise"
        )
    places = np.cos(1.0 + np.arange(3.0 * traits.ndof)).reshape(traits.ndof, 3)
    found = []
    for k in noises if traits.additive and traits.position_noise else []:
        w = np.zeros(model.nnoise + 1)
        w[k] = -1.0
        seen = np.hstack([model.gradient(places, 0.3, w, t)[0] for t in (0.0, 1.7)])
        if np.abs(seen - seen[:, :1]).max() > _TOLERANCE * np.abs(seen).max():
            break
        found.append(seen[:, 0])
    if len(found) < len(noises):
        raise IncompatibleError(
            f"the noises of model {model.name} are not all linear in q with constant factors, or depend on p (traits "
            "additive and position_noise), so that no constant friction belongs to them: give gamma and a model "
            "without noise, or noises such as -sigma*q"
        )
    return np.array(found).T


def diagonal_masses(model: Model) -> np.ndarray | None:
    """Masses m_i (dof,); None if the mass is not diagonal, or not known to be constant."""
    if model.traits.identity_mass:
        return np.ones(model.ndof)
    if not model.traits.constant_mass:
        return None
    inverse = model.hessian(np.cos(1.0 + np.arange(float(model.ndof))), 0.3)[2][:, :, 0]
    diagonal = np.diag(inverse)
    return None if np.abs(inverse - np.diag(diagonal)).max() > _TOLERANCE * diagonal.max() else 1 / diagonal


def _by_formulas(model: Model, gamma: tuple[float, ...], beta: tuple[float, ...]) -> Model | None:
    """A model with the noises of its bath, without the friction, if its formulas have whole steps with them."""
    masses = diagonal_masses(model)
    if masses is None or len({*gamma}) > 1:  # whole steps have one rate
        return None
    return model._with_constant_forces(np.sqrt(2 * np.array(gamma) * masses / np.array(beta)))


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
    noisy._forces = model._forces
    return noisy


def bath_of(model: Model) -> tuple[Model, np.ndarray] | None:
    """The model to which the library added noises of a bath, and their strengths sigma_i (dof,); None of others."""
    if model._remade is None or model._remade[0] is not _noisy:
        return None
    bare, gamma, beta = model._remade[1]
    sigma = np.sqrt(2 * np.array(gamma) * diagonal_masses(bare) / np.array(beta))
    return bare, np.broadcast_to(sigma, bare.ndof)


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
    if not np.isfinite(numbers).all() or (numbers < 0).any() or not numbers.any():
        allowed = "numbers of zero or more, not all zero" if key == "gamma" else "numbers above zero"
        raise InvalidArgumentError(f"{key} = {checks.shown(value)}: give finite {allowed}")
    return tuple(float(x) for x in numbers)
