# SPDX-License-Identifier: BSD-3-Clause
"""Models from formulas."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np

from ...errors import IncompatibleError, InvalidArgumentError, UnknownNameError
from ...native import callbacks, checks, handles
from ..definition import Model
from ..forces import Forces
from ..rates import Rates, rates_of
from ..user_handles import ModelHandle, derived, with_kernels
from . import compiler, emit_c, emit_chain_flow, emit_flow, formula_code, in_numpy, matrices, parameters, warn
from . import forces as _forces
from . import rates as _rates
from .chain import Chain
from .derivatives import Derivatives
from .formula_code import Code, Formula
from .named_formulas import MAX_DOF, default_names, named, quoted, several
from .parse import folded
from .sites import by_site


class FormulaModel(Model):
    """A model from formulas. `formula` tells what was derived and generated."""

    formula: Formula
    _derivatives: Derivatives | None  #: nodes of all derivatives; None for sums over sites
    _chain: Chain | None  #: sums over sites
    _direct: tuple | None  #: compiled gradient and value, their user pointer, and weights 1 of all Hamiltonians
    _code: Code  #: what this model shares with those of other values
    _friction: tuple[float, ...] = ()  #: rates of a force that is proved to be linear friction, part of damping
    _by_formula: _rates.Asked | None = None  #: formulas of damping, if there are any

    @property
    def kinked(self) -> tuple[int, ...]:
        """Numbers j of the H_j with kinks or jumps in the state."""
        structure = self.formula.structure
        return self._chain.kinked if structure is None else structure.kinked

    @property
    def standing(self) -> tuple[str, ...]:
        """Momenta of sites that H lacks, since free ends leave out the summand that holds them."""
        return self._chain.standing() if self._chain else ()

    def call(self, name: str, *arguments, allow: tuple[int, ...] = ()) -> int:
        """Call the library as for every model; errors about the model name its formulas."""
        try:
            return super().call(name, *arguments, allow=allow)
        except IncompatibleError as error:
            apart = "(split)" in str(error) or "position_noise" in str(error)
            why = (self.formula.structure or self._chain).unsplit if apart else ""
            raise type(error)(f"{error} ({why or self._quoted()})") from None

    def check_start(self, q0: np.ndarray, p0: np.ndarray, t0: float) -> None:
        """Refuse an initial state of all paths at which a Hamiltonian or its derivative is singular: every scheme
        would fail.
        """
        if self._is_finite_at(q0, p0, t0):
            return
        if not (math.isfinite(t0) and np.isfinite(q0).all() and np.isfinite(p0).all()):
            return  # the library reports which state is not finite
        found = np.empty(2 * self.ndof + 1)  # one state: calling model.gradient and .value took twice as long
        hq, hp, value = found[: self.ndof], found[self.ndof : -1], found[-1:]
        w, x, y = (np.ascontiguousarray(a, dtype=float) for a in (np.ones(self.nnoise + 1), q0, p0))
        self._evaluate("gradient", 1, t0, w, x, y, hq, hp)
        self._evaluate("value", 1, t0, w, x, y, value)
        if not np.isfinite(found).all():
            at = f"q0 = {_shown(q0)}, p0 = {_shown(p0)}"
            if self.formula.structure is None or self.formula.structure.time_dependent:
                at += f", t0 = {t0:g}"
            raise InvalidArgumentError(
                f"a Hamiltonian or its derivative is not finite at {at}: begin elsewhere ({self._quoted()})"
            )

    def _is_finite_at(self, q0: np.ndarray, p0: np.ndarray, t0: float) -> bool:
        """Whether the compiled functions are finite at the state. They are called directly: through the library it
        took longer.
        """
        if self._direct is None:
            return False
        gradient, value, user, w = self._direct
        found = np.empty(2 * self.ndof + 1)
        at = 1, self.ndof, self.nnoise + 1, t0, *map(checks.address, (w, q0, p0))
        hq = checks.address(found)
        hp, energy = hq + found.itemsize * self.ndof, hq + 2 * found.itemsize * self.ndof
        return not (gradient(*at, hq, hp, user) or value(*at, energy, user)) and bool(np.isfinite(found).all())

    def _quoted(self) -> str:
        texts = (f"{'H' if j == 0 else f'H_{j}'} = {quoted(h)}" for j, h in enumerate(self.formula.hamiltonians[:4]))
        return ", ".join([*texts, *(["..."] if len(self.formula.hamiltonians) > 4 else [])])

    def with_parameters(self, **values: Any) -> FormulaModel:
        """The same model with other values of some parameters, each a number or an array (path,).

        Nothing is derived or compiled again, except once where a parameter becomes 0, 1 or -1, which formulas fold, and
        where the first parameter becomes an array. In a heat bath with gamma the noise follows the masses.
        """
        if self._bathed:
            return self._bathed_again(lambda bare: bare.with_parameters(**values))
        chosen = {self._parameter(key): value for key, value in values.items()}
        if len(chosen) < len(values):
            raise InvalidArgumentError(f"of {', '.join(values)} some are the same name: give each value once")
        each = "site" if self._chain else "path"
        chosen = {key: parameters.value_of(key, value, each) for key, value in chosen.items()}
        for key in self._chain.arrays if self._chain else ():
            if key in chosen:
                chosen[key] = by_site(key, chosen[key], self._chain.n)
        values = {**self._parameters, **chosen}
        rates = self._asked_if_any
        self._require_own_friction()
        if self._code.pulls.acts:
            _, (given,) = self._remade
            return self._forced_too(_with_forces(self._code, {**given, "params": values, "damping": rates}))
        return self._forced_too(_of_values(self._code, values, rates))

    def _forced_too(self, other: FormulaModel) -> FormulaModel:
        """Another model with the forces that `forced` gave this one; it has those of its formulas already."""
        return other._with_forces(self._forces) if self._forces and not self._has_written_forces else other

    @property
    def _has_written_forces(self) -> bool:
        """Whether its forces stand in its formulas, or are derived from them."""
        _, (given,) = self._remade
        return bool(given["force"] or given["noise_force"] or given.get("bath"))

    def _without_written_forces(self) -> FormulaModel:
        """See `Model._without_written_forces`; its code holds none either, so that other values bring none back."""
        if not self._has_written_forces:
            return self
        make, (given,) = self._remade
        bare = make({**given, "force": None, "noise_force": None, "bath": None, "damping": None})
        rates = self._asked_if_any
        return bare if rates is None else bare.damped(rates, allow_gain=True)

    def _with_forces(self, forces: Forces) -> FormulaModel:
        """As of every model; rates that are formulas stay formulas."""
        if not self._by_formula:
            return super()._with_forces(forces)
        other = _damped(self._closed._with_forces(forces), self._code, self._by_formula)
        return other._in_bath(self._bath, self._fluctuating, self._bathed) if self._bath else other

    def _part(self, where: slice | np.ndarray) -> FormulaModel:
        """See `Model._part`."""
        if not self.paths or self._bathed:
            return super()._part(where)
        values = {key: x[where] if np.size(x) > 1 else x for key, x in self._parameters.items()}
        return self._forced_too(_of_values(self._code, values, self._by_formula or self.damping or None))

    def _rubbed_by_noises(self, beta: float) -> Model:
        """See `Model._rubbed_by_noises`; derived as formulas, which hold for other values of parameters, too."""
        if self._derivatives is None:
            return super()._rubbed_by_noises(beta)
        make, (given,) = self._remade
        return make({**given, "bath": beta})

    def damped(self, damping, *, allow_gain: bool = False, each: bool = False) -> FormulaModel:
        """As of every model; beside friction that its formulas hold."""
        if not isinstance(damping, _rates.Asked):
            damping = _rates.asked(damping, allow_gain=checks.flag("allow_gain", allow_gain))
        make, (given,) = (self if self._friction else self._closed or self)._remade
        if isinstance(damping, _rates.Asked):
            return self._forced_too(make({**given, "damping": damping}))
        if self._friction:
            varying = rates_of(damping, each, allow_gain, self.ndof)
            if varying or np.ndim(damping) == 2:  # the force stays one
                super().damped(damping, allow_gain=allow_gain, each=each)  # refuses damping that no model takes
                make, (given,) = self._remade
                return make({**given, "damping": varying or damping})
        other = super().damped(damping, allow_gain=allow_gain, each=each)
        return other._with_friction(self._friction, self._remade) if self._friction else other

    def _with_constant_forces(self, strengths: np.ndarray) -> FormulaModel | None:
        """By formulas, if these have whole steps: the noises are derived and compiled with the model."""
        code = self._code
        if self._forces or not (code.compiled and code.whole_steps):
            return None
        make, (given,) = self._remade
        texts = [x for x in (given["H"], *given["noise"], *given["invariants"]) if isinstance(x, str)]
        places = [str(x) for x in given["q"] or named("q", default_names("q", texts))]
        names = [f"bath_{i + 1}" for i in range(len(places))]
        taken = {*self._parameters, *places, *map(str, given["p"] or ()), str(given["t"])}
        if len(places) != self.ndof or not all(x.isidentifier() for x in places) or taken & {*names}:
            return None
        noise = [*given["noise"], *(f"-{x}*{place}" for x, place in zip(names, places, strict=True))]
        values = dict(zip(names, np.broadcast_to(strengths, self.ndof).tolist(), strict=True))
        return make({**given, "noise": noise, "params": {**given["params"], **values}})

    def _damped_from(self, rates: np.ndarray) -> Callable[[], ModelHandle]:
        """As of every model; with one rate its whole steps decay, by code of their own."""
        root = None
        if rates.ndim == 1 and len({*rates.tolist()}) == 1 and rates.all() and not self._forces:
            root = _decaying(self._code)
        made = parameters.valued(root, self._code, self._parameters) if root else self
        return made._handles.made

    def _with_friction(self, friction: tuple[float, ...], remade: tuple) -> FormulaModel:
        """The model with friction that its formulas hold, beside damping."""
        other = Model.damped(self, np.add(self.damping or 0.0, friction), allow_gain=True)
        if other.damping:
            other._friction, other._remade = friction, remade
        return other

    def __reduce__(self) -> tuple:
        """For pickle."""
        if self._by_formula:
            return _damped_by, (self._closed, self._by_formula)
        if not self._friction:
            return super().__reduce__()
        make, (given,) = self._remade
        return make, ({**given, "damping": self._asked if self._asked.any() else None},)

    @property
    def _asked(self) -> np.ndarray | Rates | _rates.Asked:
        """The damping that was asked for, beside friction in formulas."""
        if self._by_formula or self._varying:
            return self._by_formula or self._varying
        return np.subtract(self.damping or 0.0, self._friction or 0.0)

    @property
    def _asked_if_any(self) -> np.ndarray | Rates | _rates.Asked | None:
        """The same; None where nothing was asked for."""
        asked = self._asked
        return (asked if self.damping and asked.any() else None) if isinstance(asked, np.ndarray) else asked

    def _parameter(self, name: str) -> str:
        """The internal name of a parameter."""
        known = list(self.parameters)
        if not known:
            raise UnknownNameError(
                f"there is no parameter {checks.shown(name)}: the formulas have none ({self._quoted()})"
            )
        if name in {"beta", "gamma"} - set(known):
            raise UnknownNameError(
                f"there is no parameter {name!r}: there are {', '.join(known)}; where {name} is that of a heat "
                f"bath, give a function that makes the bath, as lambda {name}: ss.thermostat(model, {name}={name}, ..)"
            )
        return known[checks.choice("parameter", folded(name), known)]


@checks.hinted(
    told="; the value of a symbol stands in params, as params={{'{key}': 0.2}}, where H or a noise holds {key}"
)
def model_from_sympy(
    H: Any,
    noise: Any = (),
    *,
    q: Any = None,
    p: Any = None,
    params: Mapping[str, Any] | None = None,
    t: Any = None,
    invariants: Any = (),
    n: int | None = None,
    ends: str = "free",
    damping: Any = None,
    allow_gain: bool = False,
    force: Any = None,
    noise_force: Any = None,
    split: Any = None,
    name: str = "formula",
) -> FormulaModel:
    """A model from its Hamiltonians H(q, p, t) and H_1 .. H_m (noise), given as expressions of sympy or as texts.

        dp = -H_q dt - sum_k H_{k,q} o dW_k        dq = H_p dt + sum_k H_{k,p} o dW_k     [WHSB] (3)-(4)

    - q, p: symbols of coordinates and momenta, or their names, as a list or as a text such as "x y"; functions of
      time as from `dynamicsymbols` work too, and a Matrix of symbols, or a MatrixSymbol q, whose elements are called
      q1, q2, .. row by row; formulas may then hold products of matrices. By default they are q and p, or q1, q2, ..
      and p1, p2, .. as the texts use them. Results, figures and files have these names; instead of q, q1, .. they have
      q_1, q_2, ..
    - params: values of all other symbols, by name: numbers, or arrays (path,) with a value for each path of a run;
      with n arrays (n,) with a value for each site
    - t: the symbol of time, by default t
    - invariants: candidates I. For each it is proved, or not, that I_t + {I, H} = 0 and {I, H_k} = 0
      (``model.formula.structure.invariants``)
    - n: the formulas are texts about n sites: sums such as `Sum((q[i+1] - q[i])**2/2, i)`, which stay loops for any n,
      and noises such as "-sigma*q[k]", one for each site. `Sum(.., i < j)` is over all pairs of sites. With q="x y z",
      p="u v w" a site has these coordinates, x[i], y[i], .., and states have one site after the other. A parameter that
      is an array (n,) has a number for each site, m[i]
    - ends: of sums over neighbours. "free" leaves out what would reach beyond an end, "fixed" takes q and p beyond both
      ends as zero, so that the bond before the first site counts as the one behind the last, and "periodic" closes the
      ring: a sum over q[i+1] - q[i] has n - 1, n + 1 or n terms, for n = 3 these are 2, 4 or 3
    - damping: rates gamma_i [1/time] of dp_i = .. - gamma_i p_i dt, one number or one for each degree of freedom, or
      formulas gamma(q, t) such as "g0*(1 + q**2)", or a symmetric matrix of friction on velocities; see `Model.damped`
    - allow_gain: whether rates of damping, or eigenvalues of friction, may be negative, which feeds energy in
    - force: F(q, p, t), one formula for each degree of freedom, which act as dp = .. + F dt; noise_force: for each
      noise a list f_k(q, p, t) of as many, dp = .. + f_k o dW_k. See `Model.forced`. An F that is proved to be
      -gamma_i p_i with constants becomes damping

    - split: a quadratic part D of H, as "p1**2/2 + p2**2/2 + w*(q2*p1 - q1*p2)", whose flow is taken exactly between
      kicks by the rest, a function of q (``gauss_dkdkd``, ``verlet_kdk``, ``chin4a``) or of the actions
      (q_k^2 + p_k^2)/2 (``gauss_dkdkd``); with n it holds sums over sites. By default it is found where H couples q and
      p, or no mass is constant (``model.traits.split``, ``model.traits.kicks``)

    Texts such as `"p**2/2 - omega**2*cos(q)"` are read by a parser of arithmetic, which executes nothing. Derivatives
    and traits are derived. C code is generated, compiled by the system's compiler and kept on disk (SYMSDE_CACHE).
    Values of parameters are passed to it when it runs. ``model.formula`` describes all of this. An InvalidArgumentError
    quotes the formula that is wrong. All quantities are dimensionless.
    """
    allow_gain = checks.flag("allow_gain", allow_gain)
    damping = _rates.asked(damping, allow_gain=allow_gain)
    by_formulas = isinstance(damping, _rates.Asked)
    given = {
        "H": H,
        "noise": noise,
        "q": q,
        "p": p,
        "params": params,
        "t": t,
        "invariants": invariants,
        "n": n,
        "ends": ends,
        "damping": damping if by_formulas else None,
        "force": force,
        "noise_force": noise_force,
        "split": split,
        "name": name,
    }
    given = matrices.in_symbols(given)
    model = _made(given)
    if not (by_formulas or damping is None):
        model = model.damped(damping, allow_gain=allow_gain)
    warn.of_kinks(model)
    warn.of_standing_sites(model)
    acting = [x for row in _forces.rows_of(given["force"], given["noise_force"]) for x in row]
    acting += damping.formulas if by_formulas else ()
    others = (x for key in ("noise", "invariants", "split") for x in several(key, given[key]))
    warn.of_unused(params, [given["H"], *others, *acting])
    return model


def _made(given: dict[str, Any]) -> FormulaModel:
    """A model from the arguments of `model_from_sympy`."""
    given = {**given, **{key: several(key, given[key]) for key in ("noise", "invariants")}}
    given |= {key: named(key, given[key]) for key in "qp" if given[key] is not None}
    rows = _forces.rows_of(given["force"], given["noise_force"], given.get("most", MAX_DOF))  # copies
    given |= {"force": rows[0] or None, "noise_force": rows[1:] or None}
    code = formula_code.derived(given, {})
    if not code.pulls.acts:
        return _of_values(code, code.parameters, given["damping"])
    return _with_forces(code, {**given, "params": code.parameters})


def _with_forces(code: Code, given: dict[str, Any]) -> FormulaModel:
    """A model with forces from the arguments of `model_from_sympy`; what is proved of forces holds for all values of
    one kind."""
    values = given["params"]
    pulls = code.pulls.at(values) if parameters.kind_of(values) == code.kind else None
    if pulls is None:
        return _made(given)
    model = _of_values(code, values, None)
    made = {**code.given, "params": values, "damping": None}
    model._remade = (_made, ({**made, "force": None, "noise_force": None, "bath": None},))
    model = _acted_upon(model, pulls, formula_code.pulled(code, values), None, (_made, (made,)))
    if beta := given.get("bath"):
        model._derives_bath, model._bath = True, (beta,)
    return _damped(model, code, given["damping"]) if given["damping"] is not None else model


def _damped(model: FormulaModel, code: Code, damping: Any) -> FormulaModel:
    """The model with damping: numbers, functions, or the formulas of its code."""
    if not isinstance(damping, _rates.Asked):
        return model.damped(damping, allow_gain=True)
    found = code.rates.at(model._parameters, code.compiled)
    if isinstance(found, list) and not any(found):  # for these values of parameters
        damped = _of_values(code, model._parameters, None)
        damped._closed = model
    else:
        damped = Model.damped(model, found, allow_gain=damping.allow_gain)
    damped._by_formula = damping
    return damped


def _damped_by(closed: FormulaModel, formulas: _rates.Asked) -> FormulaModel:
    """Make a model with formulas of damping again from its pickle."""
    return closed.damped(formulas)


def _acted_upon(
    model: FormulaModel, pulls: _forces.Found, pulled: dict[str, Any], damping: Any, remade: tuple
) -> FormulaModel:
    """The model with its forces and damping; the arguments that make it again hold both."""
    if pulled:
        model = model.forced(**pulled, **pulls.proved)
    if not pulls.friction:
        model._remade = remade
    if damping is not None:
        model = model.damped(damping, allow_gain=True)
    return model._with_friction(pulls.friction, remade) if pulls.friction else model


def _of_values(code: Code, values: dict[str, Any], damping: Any) -> FormulaModel:
    """A model with these values of all parameters, and damped momenta if there are rates."""
    kind = parameters.kind_of(values)
    if kind != code.kind:
        code = code.kinds.get(kind) or formula_code.derived({**code.given, "params": values}, code.kinds)
    if code.compiled is None:
        parameters.require_numbers(values, "without a C compiler")
        model = _plain(code, in_numpy.InNumpy(code.derivatives, values).functions())
    else:
        root = code.root or _root(code)
        model = parameters.valued(root, code, values)
        if code.root is None:  # further models take no time for derivatives and compilation
            root.formula = replace(root.formula, seconds_derivatives=0.0, seconds_compilation=0.0)
            code.root = root
    model._parameters = values
    model._remade = (_made, ({**code.given, "params": values, "damping": None},))
    return model if damping is None else _damped(model, code, damping)


def _decaying(code: Code) -> FormulaModel | None:
    """The root with whole steps of momenta damped by one rate beside its own; None if its formulas have none.

    They are a file of their own, since most models are closed and their compilation takes long.
    """
    made = code.derivatives
    schemes = emit_flow.flows(made, damped=True) if code.compiled and code.whole_steps else []
    if code.decaying is None and schemes:
        compiled = compiler.build(emit_c.preamble(made) + emit_flow.source(made, damped=True))
        addresses = {x: formula_code.address(compiled, f"formula_flow_{x}") for x in schemes}
        code.decaying = _root(code, {emit_flow.named(x, damped=True): place for x, place in addresses.items()})
    return code.decaying


def _root(code: Code, more: Mapping[str, Any] = MappingProxyType({})) -> FormulaModel:
    """A model of compiled functions that knows no values of its parameters; more: whole steps beside its own."""
    functions = {**formula_code.functions(code.compiled), "accepts_null": True, "any_lanes": True}
    flows = code.whole_steps
    found = {emit_flow.named(x): formula_code.address(code.compiled, f"formula_flow_{x}") for x in flows}
    for scheme in emit_chain_flow.flows(code.chain) if code.chain else []:
        names = [emit_flow.named(scheme, damped=x) for x in (False, True)]
        found |= dict.fromkeys(names, formula_code.address(code.compiled, f"formula_flow_{scheme}"))
    if code.kicks:
        kicks, schemes = code.kicks
        found |= {x: formula_code.address(kicks, f"formula_flow_{x}") for x in schemes}
    same = emit_flow.same_steps(code.derivatives) if found and code.derivatives else {}
    found |= {x: found[other] for x, other in same.items() if other in found}
    functions["flows"] = found | {**more}
    pair = (callbacks.compiled(x, functions[x])[0] for x in ("gradient", "value"))
    code.direct = (*pair, np.ones(code.traits["nnoise"] + 1))
    return _plain(code, functions)


def _plain(code: Code, functions: dict[str, Any]) -> FormulaModel:
    """A model of functions."""
    model = FormulaModel(name=code.given["name"], derived=True, **code.traits, **functions)
    there = [x for x in ("squares", "pull") if code.compiled and hasattr(code.compiled.library, f"formula_{x}")]
    if there:
        kernels = {x: formula_code.address(code.compiled, f"formula_{x}") for x in there}
        make = functools.partial(with_kernels, model._handles.made, kernels)
        model._handles = handles.Pool(functools.partial(derived, make))
    model.formula, model._derivatives, model._chain = code.formula, code.derivatives, code.chain
    model._coordinates, model._code, model._direct = code.columns, code, None
    model._hamiltonians = [
        f"{'H' if j == 0 else f'H_{j}'} = {text}" for j, text in enumerate(code.formula.hamiltonians)
    ]
    return model


def _shown(state: np.ndarray) -> str:
    """The first numbers of a state as text."""
    numbers = ", ".join(f"{x:g}" for x in state[:4, 0])
    return numbers if len(state) == 1 else f"[{numbers}{', ..' if len(state) > 4 else ''}]"
