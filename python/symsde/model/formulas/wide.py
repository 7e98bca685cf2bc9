# SPDX-License-Identifier: BSD-3-Clause
"""Parameters as positions that do not move: the model of (q, theta), by whose Hessian steps are differentiated."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any

import numpy as np

from ...errors import IncompatibleError, InvalidArgumentError
from ...native import checks
from ..built_in import FORMULAS
from ..definition import Model
from .formula_model import FormulaModel, _made, model_from_sympy
from .named_formulas import MAX_DOF, Problem


def wide_model(model: Model, names: Sequence[str]) -> tuple[Model, list[str]]:
    """A model of the same Hamiltonians whose further positions are these parameters and all parameters that go by path,
    and the names of these positions. Only Hessians of the wide model are asked for, and momenta of parameters stay
    zero.
    """
    structure = model.formula.structure if isinstance(model, FormulaModel) else None
    if structure is not None and structure.kinked:
        raise IncompatibleError(
            f"a formula of model {model.name} has a kink or jump, where a step is not differentiable, and means of its "
            "derivatives are no derivatives of means: write it smoothly, as sqrt(q**2 + 0.01**2) for Abs(q)"
        )
    by_path = [name for name, x in model.parameters.items() if np.ndim(x)]
    wanted = [*names, *(name for name in by_path if name not in names)]
    if not wanted:
        return model, []
    code = _formulas(model)._code
    if code.derivatives is None:
        raise IncompatibleError(
            f"{', '.join(wanted)} of model {model.name}: derivatives by parameters of sums over sites are not known; "
            "take those by q0 and p0, or write the formulas out"
        )
    problem = code.derivatives.problem
    if problem.ndof + len(wanted) > MAX_DOF:
        raise IncompatibleError(
            f"{problem.ndof} degrees of freedom and {len(wanted)} parameters are more than {MAX_DOF} together: ask for "
            "fewer parameters at a time"
        )
    others = {f"c{k}": model.parameters[x] for k, x in enumerate(problem.parameters) if x not in wanted}
    _require_generic(model, names)
    _require_own_rates(model, names, problem)
    key = tuple(wanted)
    if key not in code.wide:
        code.wide[key] = _derived(problem, wanted, others, model.name)
    return code.wide[key].with_parameters(**others), wanted


def _require_generic(model: Model, names: Sequence[str]) -> None:
    """Refuse values of parameters at which the Hamiltonians have traits that they lose beside them: steps are chosen
    by traits, and so would the derivative be.
    """
    special = [name for name in names if np.ndim(model.parameters[name]) == 0 and model.parameters[name] in (0, 1, -1)]
    if not special:
        return
    beside = model.with_parameters(**{name: model.parameters[name] + 0.1357 for name in special}).traits
    for trait in ("separable", "additive", "position_noise", "silent"):
        if getattr(beside, trait) != getattr(model.traits, trait):
            told = ", ".join(f"{name} = {model.parameters[name]:g}" for name in special)
            raise IncompatibleError(
                f"model {model.name} has traits at {told} ({trait}) that it loses beside it, and steps are chosen by "
                f"traits: give a value nearby, as {special[0]} = {model.parameters[special[0]] + 1e-6:g}"
            )


def _require_own_rates(model: Model, names: Sequence[str], problem: Problem) -> None:
    """Refuse parameters with which the damping changes: derivatives by rates of damping are not known."""
    for name in names:
        if model._fluctuating:  # the friction of a bath belongs to the noises and the masses
            H, *noise = problem.hamiltonians
            momenta = problem.coordinates("p")
            held = [*noise, *(H.diff(x) for x in H.free_symbols if x.name in momenta)]
            symbol = f"c{[*problem.parameters].index(name)}"
            changes = any(x.name == symbol for h in held for x in h.free_symbols)
        else:
            beside = model.with_parameters(**{name: np.add(model.parameters[name], 0.1357)})
            changes = beside.damping != model.damping
        if changes:
            raise IncompatibleError(
                f"the damping of model {model.name} changes with {name}, and derivatives by rates of damping are not "
                "known: ask for other parameters, or damp by numbers"
            )


def _derived(problem: Problem, wanted: list[str], others: dict[str, float], name: str) -> FormulaModel:
    """The wide model: coordinates x0, x1, .. and y0, y1, .., other parameters keep their internal names."""
    places = {name: problem.ndof + k for k, name in enumerate(wanted)}
    new = {f"{letter}{i}": f"{other}{i}" for letter, other in ("qx", "py") for i in range(problem.ndof)}
    new |= {f"c{k}": f"x{places[x]}" for k, x in enumerate(problem.parameters) if x in places}
    symbols = {x.name: x for h in problem.hamiltonians for x in h.free_symbols}
    renamed = {x: type(x)(new[c], real=True) for c, x in symbols.items() if c in new}
    H, *noise = (h.xreplace(renamed) for h in problem.hamiltonians)
    count = problem.ndof + len(wanted)
    return _made(
        {
            "H": H,
            "noise": noise,
            "q": [f"x{i}" for i in range(count)],
            "p": [f"y{i}" for i in range(count)],
            "params": others,
            "t": None,
            "invariants": (),
            "n": None,
            "ends": "free",
            "damping": None,
            "force": None,
            "noise_force": None,
            "name": name,
            "steps": False,
        }
    )


def _formulas(model: Model) -> FormulaModel:
    """The formulas of a model."""
    if isinstance(model, FormulaModel):
        return model
    if model.name in FORMULAS and model.parameters:
        return _of_built_in(model.name, tuple(model.parameters)).with_parameters(**model.parameters)
    raise IncompatibleError(
        f"derivatives by parameters need the formulas of a model, and {model.name} has none: make it by "
        "model_from_sympy, or ask for those by q0 and p0"
    )


@functools.cache
def _of_built_in(name: str, parameters: tuple[str, ...]) -> FormulaModel:
    """The formulas of a built-in model, for any values."""
    H, *noise = FORMULAS[name]
    return model_from_sympy(H, noise, params=dict.fromkeys(parameters, 0.5), name=name)


def parameter_names(model: Model, wanted: Sequence[Any]) -> list[str]:
    """Names of parameters as the model has them; refuses other names."""
    known = [*model.parameters]
    found = []
    for name in wanted:
        if not known:
            raise InvalidArgumentError(f"wrt holds {checks.shown(name)}, and model {model.name} has no parameters")
        found.append(known[checks.choice("wrt", name, known)])
    return found
