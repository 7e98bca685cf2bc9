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
from ..thermostat import bath_of, diagonal_masses
from .formula_model import FormulaModel, _made, model_from_sympy
from .named_formulas import Problem, default_names, named
from .wide_flows import with_slopes_of_flows
from .wide_forces import bath_slopes, with_acting, with_slopes

MAX_POSITIONS = 256  #: of a wide model
#: positions of a wide model up to which its whole Hessian is compiled; of more, products alone
MOST_WITH_HESSIANS = 16


class Positions(list):
    """Names of the parameters that are positions of a wide model; that of a parameter of sites stands once a site."""

    of_sites: tuple[str, ...] = ()  #: parameters with a number for each site
    slopes: np.ndarray | None = None  #: (position, dof), derivatives of the rates of damping; None if no rate changes

    @property
    def rows(self) -> int:
        """Number of parameters that the library is given: behind these positions are rates that change."""
        return len(self) + (0 if self.slopes is None else self.slopes.shape[1])

    def at(self, name: str) -> int | slice:
        """The place of a parameter, or the places of its sites."""
        first, count = self.index(name), self.count(name)
        return slice(first, first + count) if name in self.of_sites else first

    def places(self, names: Sequence[str]) -> list[int]:
        """The places of parameters, one after the other."""
        every = [self.at(name) for name in names]
        return [k for x in every for k in (range(x.start, x.stop) if isinstance(x, slice) else (x,))]

    def gathered(self, rows: np.ndarray) -> np.ndarray:
        """Derivatives by positions, (position, ..), from those by positions and by rates, (rows, ..)."""
        n = len(self)
        return rows[:n] if self.slopes is None else rows[:n] + np.tensordot(self.slopes, rows[n:], 1)


def wide_model(model: Model, names: Sequence[str], *, thirds: bool = False) -> tuple[Model, Positions]:
    """A model of the same Hamiltonians and forces whose further positions are these parameters and all parameters that
    go by path, and the names of these positions. Only Hessians and derivatives of forces of the wide model are asked
    for, and third derivatives if `thirds`; momenta of parameters stay zero.
    """
    if isinstance(model, FormulaModel) and model.kinked:
        raise IncompatibleError(
            f"a formula of model {model.name} has a kink or jump, where a step is not differentiable, and means of its "
            "derivatives are no derivatives of means: write it smoothly, as sqrt(q**2 + 0.01**2) for Abs(q)"
        )
    by_path = [name for name, x in model.parameters.items() if isinstance(x, np.ndarray)]
    wanted = [*names, *(name for name in by_path if name not in names)]
    bath = bath_of(model)
    if not wanted and not (thirds and _has_formulas(bath[0] if bath else model)):
        return with_slopes(model), Positions()
    if bath:
        return _in_bath(model, *bath, names, thirds=thirds)
    code = (known := _formulas(model))._code
    if code.chain:
        return _of_sites(model, wanted, thirds=thirds)
    problem = code.derivatives.problem
    if problem.ndof + len(wanted) > MAX_POSITIONS:
        raise IncompatibleError(
            f"{problem.ndof} degrees of freedom and {len(wanted)} parameters are more than {MAX_POSITIONS} together: "
            "ask for fewer parameters at a time"
        )
    others = {f"c{k}": model.parameters[x] for k, x in enumerate(problem.parameters) if x not in wanted}
    _require_generic((model._closed or model._unforced) if model._fluctuating else model, names)
    key = (thirds, *wanted)
    if key not in code.wide:
        code.wide[key] = _derived(problem, code.pulls.rows, wanted, others, model.name, thirds=thirds)
    wide = code.wide[key].with_parameters(**others) if others else code.wide[key]
    positions = Positions(wanted)
    positions.slopes = _slopes(known, wanted, names)
    if model._fluctuating == "friction" and wide.traits.has_hessian:
        positions.slopes = _bath_slopes(model, wide, wanted)
    elif model._fluctuating:
        _require_own_bath(model, names, problem)
    wide = with_slopes_of_flows(wide, model, positions)
    return wide if code.pulls.formulas else with_acting(wide, model), positions


def _of_sites(model: FormulaModel, wanted: list[str], *, thirds: bool) -> tuple[Model, Positions]:
    """The wide model of sums over sites: loops over them, however many positions the parameters of sites are."""
    code, chain = model._code, model._chain
    _require_generic((model._closed or model._unforced) if model._fluctuating else model, wanted)
    of_sites = tuple(x for x in wanted if x in chain.arrays)
    alone = [x for x in wanted if x not in chain.arrays]
    key = (thirds, model._fluctuating, "sites", *sorted(wanted))
    if key not in code.wide:
        values = model.parameters | dict.fromkeys(alone, 0.5)  # are not read, nor folded
        more = {"params": values, "damping": None, "fixed": tuple(wanted), "thirds": thirds}
        more |= {"hessians": True} if model._fluctuating else {}
        code.wide[key] = _made({**code.given, **more})
    others = {name: x for name, x in model.parameters.items() if name not in wanted}
    wide = code.wide[key].with_parameters(**others) if others else code.wide[key]
    order = wide._chain.fixed
    positions = Positions([x for x in order for _ in range(chain.n if x in of_sites else 1)])
    positions.of_sites = of_sites
    if model._fluctuating:
        positions.slopes = _bath_slopes(model, wide, order)
    return with_acting(with_slopes_of_flows(wide, model, positions), model), positions


def _slopes(model: FormulaModel, wanted: list[str], names: Sequence[str]) -> np.ndarray | None:
    """Derivatives of the rates of damping by parameters, (position, dof); None if all vanish."""
    code, n = model._code, model.ndof
    parts = [code.pulls.rates, code.rates.rows if model._by_formula and code.rates else ()]
    places = {name: k for k, name in enumerate(model.parameters)}
    found = np.zeros((len(wanted), n))
    for rates in filter(None, parts):
        symbols = {x.name: x for rate in rates for x in getattr(rate, "free_symbols", ())}
        values = {x: model.parameters[name] for name, k in places.items() if (x := symbols.get(f"c{k}")) is not None}
        for row, name in zip(found, wanted, strict=True):
            symbol = symbols.get(f"c{places[name]}")
            if name in names and symbol is not None:
                row += [float(rate.diff(symbol).subs(values)) for rate in rates]
    return found if found.any() else None


def _require_generic(model: Model, names: Sequence[str]) -> None:
    """Refuse values of parameters at which the Hamiltonians have traits that they lose beside them: steps are chosen
    by traits, and so would the derivative be.
    """
    special = [name for name in names if np.ndim(model.parameters[name]) == 0 and model.parameters[name] in (0, 1, -1)]
    if not special:
        return
    other = model.with_parameters(**{name: model.parameters[name] + 0.1357 for name in special})
    beside, own = (
        {key: getattr(x.traits, key) for key in ("separable", "additive", "position_noise", "silent")}
        | {"friction": bool(getattr(x, "_friction", ()))}
        for x in (other, model)
    )
    for trait, value in beside.items():
        if value != own[trait]:
            told = ", ".join(f"{name} = {model.parameters[name]:g}" for name in special)
            raise IncompatibleError(
                f"model {model.name} has traits at {told} ({trait}) that it loses beside it, and steps are chosen by "
                f"traits: give a value nearby, as {special[0]} = {model.parameters[special[0]] + 1e-6:g}"
            )


def _bath_slopes(model: Model, wide: Model, names: Sequence[str]) -> np.ndarray | None:
    """Derivatives of the rates of a bath of a model's own noises by parameters, (position, dof); None if all vanish."""
    if not model.damping or model.has_friction:
        return None
    theta = [x for name in dict.fromkeys(names) for x in np.atleast_1d(model.parameters[name])]
    slopes = bath_slopes(wide, np.array(theta), model.ndof, *model._bath)
    return slopes if slopes.any() else None


def _in_bath(model: Model, bare: Model, sigma: np.ndarray, names: Sequence[str], *, thirds: bool) -> tuple:
    """The wide model of a model whose bath the library makes: its noises -sigma_i q_i are formulas here."""
    for name in names:
        moved = bare.with_parameters(**{name: np.add(bare.parameters[name], 0.0137)})
        if not np.array_equal(diagonal_masses(moved), diagonal_masses(bare)):
            raise IncompatibleError(
                f"the noises of the bath of model {model.name} would change with {name}, and derivatives by it are not "
                "known: ask for other parameters, or write noise and damping into the model"
            )
    if model._forces.noise_force is not None:
        raise IncompatibleError(
            f"forces of noises act on model {model.name} in its bath, and derivatives by parameters are not known "
            "beside both: write the noise of the bath and damping into the model"
        )
    known = _formulas(bare)
    make, (given,) = known._remade
    texts = [x for x in (given["H"], *given["noise"]) if isinstance(x, str)]
    places = [str(x) for x in given["q"] or named("q", default_names("q", texts))]
    taken = {*known.parameters, *places, *map(str, given["p"] or ()), str(given["t"])}
    letter = next(x for x in (f"bath{'_' * k}" for k in range(len(taken) + 1)) if x not in taken)
    if known._chain:
        if known._chain.size > 1:
            raise IncompatibleError(
                f"the bath of model {model.name} has a noise for each coordinate of each site in turn, which no "
                "formula says: write the noises and damping into the model for derivatives by parameters"
            )
        params = {letter: sigma}
        noise = [f"-{letter}[{letter}i]*{known._chain.components[0][0]}[{letter}i]"]
    else:
        params = {f"{letter}_{i + 1}": x for i, x in enumerate(sigma.tolist())}
        noise = [f"-{x}*{place}" for x, place in zip(params, places, strict=True)]
    twin = make({**given, "noise": [*given["noise"], *noise], "params": {**known.parameters, **params}})
    if model._forces and not twin._forces:
        twin = twin._with_forces(model._forces)
    return wide_model(twin, names, thirds=thirds)


def _require_own_bath(model: Model, names: Sequence[str], problem: Problem) -> None:
    """Refuse parameters that change the noises of a bath, which belong to masses, or the friction of noises."""
    H, *noise = problem.hamiltonians
    momenta = problem.coordinates("p")
    held = [H.diff(x) for x in H.free_symbols if x.name in momenta]
    held += noise if model._fluctuating == "friction" else []
    symbols = {x.name for h in held for x in h.free_symbols}
    for name in names:
        if f"c{[*problem.parameters].index(name)}" in symbols:
            raise IncompatibleError(
                f"the {model._fluctuating} of the bath of model {model.name} would change with {name}, and derivatives "
                "by it are not known: ask for other parameters, or write noise and damping into the model"
            )


def _derived(
    problem: Problem, forces: list[list[Any]], wanted: list[str], others: dict[str, float], name: str, *, thirds: bool
) -> FormulaModel:
    """The wide model: coordinates x0, x1, .. and y0, y1, .., other parameters keep their internal names."""
    places = {name: problem.ndof + k for k, name in enumerate(wanted)}
    new = {f"{letter}{i}": f"{other}{i}" for letter, other in ("qx", "py") for i in range(problem.ndof)}
    new |= {f"c{k}": f"x{places[x]}" for k, x in enumerate(problem.parameters) if x in places}
    zeros = [0] * len(wanted)
    forces = [[*row, *zeros] for row in forces]
    given = [x for x in (*problem.hamiltonians, *(f for row in forces for f in row)) if hasattr(x, "xreplace")]
    symbols = {x.name: x for h in given for x in h.free_symbols}
    renamed = {x: type(x)(new[c], real=True) for c, x in symbols.items() if c in new}
    H, *noise = (h.xreplace(renamed) for h in problem.hamiltonians)
    rows = [[f.xreplace(renamed) if hasattr(f, "xreplace") else f for f in row] for row in forces]
    force, *noise_force = rows or [[]]
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
            "split": None,
            "ends": "free",
            "damping": None,
            "force": force or None,
            "noise_force": noise_force or None,
            "name": name,
            "most": MAX_POSITIONS,
            "steps": False,
            "hessians": count <= MOST_WITH_HESSIANS,
            "thirds": thirds,
            "moving": problem.ndof,
        }
    )


def _has_formulas(model: Model) -> bool:
    """Whether the model has formulas, which functions of sums have not in this sense."""
    if isinstance(model, FormulaModel):
        return model._chain is None or model._chain.outer is None
    return model.name in FORMULAS and bool(model.parameters)


def _formulas(model: Model) -> FormulaModel:
    """The formulas of a model."""
    if isinstance(model, FormulaModel):
        return model
    if _has_formulas(model):
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
