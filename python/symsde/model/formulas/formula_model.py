# SPDX-License-Identifier: BSD-3-Clause
"""Models from formulas."""

from __future__ import annotations

import ctypes
import math
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...errors import (
    IncompatibleError,
    InvalidArgumentError,
    SlowFormulaWarning,
    UnknownNameError,
    UnusedParameterWarning,
)
from ...native import callbacks, checks
from ..definition import Model
from . import compiler, emit_c, emit_flow, emit_sites, in_numpy
from .derivatives import Derivatives
from .named_formulas import make_problem, named, quoted, several, unused
from .parse import folded
from .sites import Chain, make_chain
from .structure import Prover, Structure

KINDS = ("gradient", "value", "hessian", "hessian_vector", "gradient_hessian", "third_derivative", "chain_rows")


@dataclass(frozen=True)
class Formula:
    """A description of how the formulas of a model were derived and compiled."""

    hamiltonians: tuple[str, ...]  #: H, H_1 .. H_m as given
    structure: Structure | None  #: facts derived from the Hamiltonians; for sums over sites see the traits
    backend: str  #: "C"; "NumPy" if there is no compiler
    source: str  #: the generated code
    seconds_derivatives: float  #: seconds for derivatives and code
    seconds_compilation: float  #: seconds for the compiler; 0 = the code was compiled before
    file: str = field(default="", compare=False)  #: the compiled library


class FormulaModel(Model):
    """A model from formulas. `formula` tells what was derived and generated."""

    formula: Formula
    _derivatives: Derivatives | None  #: nodes of all derivatives; None for sums over sites
    _chain: Chain | None  #: sums over sites
    _direct: tuple | None  #: compiled gradient and value, each with its parameters, and weights of 1

    def call(self, name: str, *arguments, allow: tuple[int, ...] = ()) -> int:
        """Call the library as for every model; errors about the model name its formulas."""
        try:
            return super().call(name, *arguments, allow=allow)
        except IncompatibleError as error:
            raise type(error)(f"{error} ({self._quoted()})") from None

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
        (gradient, user), (value, _), w = self._direct
        found = np.empty(2 * self.ndof + 1)
        at = 1, self.ndof, self.nnoise + 1, t0, *map(checks.address, (w, q0, p0))
        hq = checks.address(found)
        hp, energy = hq + found.itemsize * self.ndof, hq + 2 * found.itemsize * self.ndof
        return not (gradient(*at, hq, hp, user) or value(*at, energy, user)) and bool(np.isfinite(found).all())

    def _quoted(self) -> str:
        texts = (f"{'H' if j == 0 else f'H_{j}'} = {quoted(h)}" for j, h in enumerate(self.formula.hamiltonians[:4]))
        return ", ".join([*texts, *(["..."] if len(self.formula.hamiltonians) > 4 else [])])

    def with_parameters(self, **values: float) -> FormulaModel:
        """The same model with other values of some parameters; nothing is compiled again."""
        _, (given,) = self._remade
        chosen = {self._parameter(key): value for key, value in values.items()}
        if len(chosen) < len(values):
            raise InvalidArgumentError(f"of {', '.join(values)} some are the same name: give each value once")
        return _made({**given, "params": {**self.parameters, **chosen}, "damping": self.damping or None})

    def _parameter(self, name: str) -> str:
        """The internal name of a parameter."""
        known = list(self.parameters)
        if not known:
            raise UnknownNameError(
                f"there is no parameter {checks.shown(name)}: the formulas have none ({self._quoted()})"
            )
        return known[checks.choice("the parameter", folded(name), known)]


@checks.hinted(
    told="; the value of a symbol stands in params, as params={{'{key}': 0.2}}, where H or a noise holds {key}"
)
def model_from_sympy(
    H: Any,
    noise: Any = (),
    *,
    q: Any = None,
    p: Any = None,
    params: Mapping[str, float] | None = None,
    t: Any = None,
    invariants: Any = (),
    n: int | None = None,
    ends: str = "free",
    damping: Any = None,
    name: str = "formula",
) -> FormulaModel:
    """A model from its Hamiltonians H(q, p, t) and H_1 .. H_m (noise), given as expressions of sympy or as texts.

        dp = -H_q dt - sum_k H_{k,q} o dW_k        dq = H_p dt + sum_k H_{k,p} o dW_k     [WHSB] (3)-(4)

    - q, p: symbols of coordinates and momenta, or their names, as a list or as a text such as "x y"; functions of
      time as from `dynamicsymbols` work too. By default they are q and p, or q1, q2, .. and p1, p2, .. as the texts use
      them. Results, figures and files have these names; instead of q, q1, .. they have q_1, q_2, ..
    - params: values of all other symbols, by name
    - t: the symbol of time, by default t
    - invariants: candidates I. For each it is proved, or not, that I_t + {I, H} = 0 and {I, H_k} = 0
      (``model.formula.structure.invariants``)
    - n: the formulas are texts about n sites: sums such as `Sum((q[i+1] - q[i])**2/2, i)`, which stay loops for any n,
      and noises such as "-sigma*q[k]", one for each site
    - ends: of sums over neighbours. "free" leaves out what would reach beyond an end, "fixed" takes q and p beyond both
      ends as zero, so that the bond before the first site counts as the one behind the last, and "periodic" closes the
      ring: a sum over q[i+1] - q[i] has n - 1, n + 1 or n terms, for n = 3 these are 2, 4 or 3
    - damping: rates gamma_i [1/time] of dp_i = .. - gamma_i p_i dt, one number or one for each degree of freedom, or a
      symmetric matrix of friction on velocities; see `Model.damped`

    Texts such as `"p**2/2 - omega**2*cos(q)"` are read by a parser of arithmetic, which executes nothing. Derivatives
    and traits are derived. C code is generated, compiled by the system's compiler and kept on disk (SYMSDE_CACHE).
    Values of parameters are passed to it when it runs. ``model.formula`` describes all of this. An InvalidArgumentError
    quotes the formula that is wrong. All quantities are dimensionless.
    """
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
        "damping": damping,
        "name": name,
    }
    model = _made(given)
    _warn_of_unused(params, [H, *several("noise", noise), *several("invariants", invariants)])
    return model


def _warn_of_unused(params: Mapping[str, float] | None, formulas: list[Any]) -> None:
    """Warn of parameters that occur in no formula: a misspelt name, or a forgotten noise."""
    if names := unused(params, formulas):
        one = len(names) == 1
        told = (
            f"no formula holds the parameter{'' if one else 's'} {', '.join(names)}: {'its value' if one else 'they'} "
        )
        told += "changes nothing" if one else "change nothing"
        held = sorted(set(map(folded, params)) - set(names))
        told += f"; the formulas hold {', '.join(held)}" if held else ""
        told += "" if len(formulas) > 1 else "; no noise is given: noises stand in a list, as noise=['sigma*q']"
        checks.warn(told, UnusedParameterWarning)


def _made(given: dict[str, Any]) -> FormulaModel:
    """A model from the arguments of `model_from_sympy`."""
    start = time.perf_counter()
    given = {**given, **{key: several(key, given[key]) for key in ("noise", "invariants")}}
    given |= {key: named(key, given[key]) for key in "qp" if given[key] is not None}
    chosen = {key: value for key, value in given.items() if key not in ("name", "n", "ends", "damping")}
    chain, own = None, ()
    if given["n"] is None:
        problem = make_problem(**chosen)
        prover = Prover(problem)
        structure = prover.structure()
        ndof, nnoise, parameters, traits = problem.ndof, problem.nnoise, problem.parameters, structure.traits()
        own = problem.columns
        texts = problem.texts[: nnoise + 1]
        derivatives = Derivatives(problem, prover.vanishing())
        source = emit_c.source(derivatives) + emit_flow.source(derivatives)
    else:
        chain = _chain(**chosen, n=given["n"], ends=given["ends"])
        structure, texts, source, derivatives = None, chain.texts, emit_sites.source(chain), None
        ndof, nnoise, parameters, traits = chain.n, chain.nnoise, chain.parameters, chain.traits
    derived = time.perf_counter() - start
    compiled = _compiled(source, derivatives is None)
    if compiled is None:
        functions = in_numpy.InNumpy(derivatives, parameters).functions()
    else:
        functions = {**_functions(compiled, parameters), "accepts_null": True, "any_lanes": True}
        functions["flows"] = _flows(compiled, emit_flow.flows(derivatives) if derivatives else [], parameters)
    formula = Formula(
        hamiltonians=texts,
        structure=structure,
        backend="C" if compiled else "NumPy",
        source=source,
        seconds_derivatives=derived,
        seconds_compilation=compiled.seconds if compiled else 0.0,
        file=str(compiled.path) if compiled else "",
    )
    model = FormulaModel(ndof=ndof, nnoise=nnoise, name=given["name"], derived=True, **traits, **functions)
    model.formula, model._derivatives, model._chain = formula, derivatives, chain
    model._coordinates, model._direct = own, None
    model._hamiltonians = [f"{'H' if j == 0 else f'H_{j}'} = {text}" for j, text in enumerate(texts)]
    if compiled is not None:
        model._direct = (*(callbacks.compiled(x, functions[x]) for x in ("gradient", "value")), np.ones(nnoise + 1))
    model._parameters = dict(parameters)
    sites = chain and chain.n  # numbers, where arrays may have been given
    model._remade = (_made, ({**given, "params": model._parameters, "n": sites, "damping": None},))
    return model if given["damping"] is None else model.damped(given["damping"], allow_gain=True)


def _shown(state: np.ndarray) -> str:
    """The first numbers of a state as text."""
    numbers = ", ".join(f"{x:g}" for x in state[:4, 0])
    return numbers if len(state) == 1 else f"[{numbers}{', ..' if len(state) > 4 else ''}]"


def _compiled(source: str, is_chain: bool) -> compiler.Compiled | None:
    """The compiled code; None if nothing can be compiled, with a warning about the cost."""
    compiled = compiler.build(source)
    if compiled is not None:
        return compiled
    if is_chain:
        raise InvalidArgumentError("sums over sites need a C compiler: install gcc or clang, or pip install ziglang")
    checks.warn(in_numpy.SENTENCE, SlowFormulaWarning)
    return None


def _chain(*, H, noise, q, p, params, t, invariants, n, ends) -> Chain:
    """Read sums over n sites."""
    if q is not None or p is not None or invariants:
        raise InvalidArgumentError("sums over n sites are in q[i] and p[i]: leave out q, p and invariants")
    return make_chain(H=H, noise=noise, params=params, t=t, n=n, ends=ends)


def _functions(compiled: compiler.Compiled, parameters: Mapping[str, float]) -> dict[str, Any]:
    """The compiled callbacks, each with the values of the parameters."""
    values = np.array(list(parameters.values()) or [0.0])
    there = [kind for kind in KINDS if hasattr(compiled.library, f"formula_{kind}")]
    return {kind: _with_values(compiled, f"formula_{kind}", values) for kind in there}


def _flows(compiled: compiler.Compiled, schemes: list[str], parameters: Mapping[str, float]) -> dict[str, Any]:
    """The compiled whole steps by scheme; they use the values of the parameters of the callbacks."""
    values = np.array(list(parameters.values()) or [0.0])
    return {emit_flow.named(x): _with_values(compiled, f"formula_flow_{x}", values) for x in schemes}


def _with_values(compiled: compiler.Compiled, name: str, values: np.ndarray) -> callbacks.WithData:
    address = ctypes.cast(getattr(compiled.library, name), ctypes.c_void_p)
    return callbacks.WithData(address, ctypes.c_void_p(values.ctypes.data), (values, compiled.library))
