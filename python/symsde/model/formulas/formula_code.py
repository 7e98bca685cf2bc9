# SPDX-License-Identifier: BSD-3-Clause
"""Formulas derived and compiled: what models share that differ in values of parameters alone."""

from __future__ import annotations

import ctypes
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ...errors import InvalidArgumentError, SlowFormulaWarning
from ...native import callbacks, checks
from ...native.files import optional
from ..rates import Rates
from ..split import KICKS
from . import (
    actions,
    compiler,
    emit_c,
    emit_flow,
    emit_pull,
    emit_sites,
    in_numpy,
    kinks,
    parameters,
    quadratic,
    site_parts,
)
from . import forces as _forces
from . import rates as _rates
from .chain import Chain
from .derivatives import Derivatives
from .graph import OF_ORDER, SCALAR
from .named_formulas import MAX_DOF, Problem, make_problem, quoted, several
from .sites import make_chain
from .structure import Prover, Structure

if TYPE_CHECKING:
    from .formula_model import FormulaModel

KINDS = ("gradient", "value", "hessian", "hessian_vector", "gradient_hessian", "third_derivative", "chain_rows")


@dataclass(frozen=True)
class Formula:
    """A description of how the formulas of a model were derived and compiled."""

    hamiltonians: tuple[str, ...]  #: H, H_1 .. H_m as given
    structure: Structure | None  #: facts derived from the Hamiltonians; for sums over sites see the traits
    backend: str  #: "C"; "NumPy" if there is no compiler
    source: str  #: the generated code
    seconds_derivatives: float  #: seconds for derivatives and code
    seconds_compilation: float  #: seconds of processor time of the compiler; 0 = the code was compiled before
    file: str = field(default="", compare=False)  #: the compiled library


@dataclass
class Code:
    """What is derived from formulas and compiled. It serves all values of parameters of one kind."""

    given: dict[str, Any]  #: arguments of `model_from_sympy`
    kind: tuple  #: of the values, see `parameters.kind_of`
    columns: tuple[str, ...]  #: the model's own names of coordinates and momenta
    parameters: dict[str, Any]  #: name -> value of the first model
    traits: dict[str, Any]
    formula: Formula
    derivatives: Derivatives | None  #: nodes of all derivatives; None for sums over sites
    chain: Chain | None  #: sums over sites
    rotation: Callable[[list], tuple[float, ...] | None]  #: values -> frequencies of the linear part
    part: (
        actions.Part | quadratic.Part | site_parts.Part | None
    )  #: values -> second derivatives of the quadratic part between kicks
    compiled: compiler.Compiled | None
    kinds: dict[tuple, Code]  #: the same formulas for other kinds of values
    pulls: _forces.Found  #: forces beside the Hamiltonians
    rates: _rates.Found | None = None  #: rates of damping that are formulas
    root: FormulaModel | None = None  #: a model of this code, of which others are copies with other values
    decaying: FormulaModel | None = None  #: the same with whole steps of damped momenta, made when they are wanted
    #: whole steps of kicks between flows of the quadratic part, and their schemes
    kicks: tuple[compiler.Compiled, list[str]] | None = None
    squares: Callable[[list], list[complex]] | None = None  #: values -> squares of these frequencies
    direct: tuple = ()  #: compiled gradient and value, and weights 1 of all Hamiltonians
    #: names -> with these parameters as positions (wide.py)
    wide: dict[tuple, FormulaModel] = field(default_factory=dict)

    @property
    def whole_steps(self) -> list[str]:
        """Schemes whose whole steps are compiled."""
        return emit_flow.flows(self.derivatives) if self.derivatives and self.given.get("steps", True) else []


def derived(given: dict[str, Any], kinds: dict[tuple, Code]) -> Code:
    """Formulas derived and compiled for the kind of the given values."""
    start = time.perf_counter()
    rows = [given["force"] or [], *(given["noise_force"] or [])]
    chosen = {key: given[key] for key in ("H", "noise", "q", "p", "params", "t", "invariants")}
    chain, own, pulls, rates, part = None, (), _forces.Found(), None, None
    formulas = given["damping"] if isinstance(given["damping"], _rates.Asked) else None
    if given["n"] is None:
        chosen["invariants"] = _read_too(given, rows, formulas)
        problem = make_problem(**chosen, most=given.get("most", MAX_DOF))
        problem, decaying = _rates.split(problem, formulas) if formulas else (problem, [])
        problem, acting = _forces.split(problem, rows)
        problem, by_hand = _split_off(problem, given["split"])
        if given.get("bath"):
            acting = _forces.friction_of_noises(problem, given["bath"])
        prover = Prover(problem)
        if acting:
            parameters.require_numbers(problem.parameters, "of models with forces")
            numbers = given["damping"] is None or not (formulas or isinstance(given["damping"], Rates))
            pulls = _forces.derive(problem, prover, acting, rates=numbers and np.ndim(given["damping"]) < 2)
        if formulas:
            parameters.require_numbers(problem.parameters, "of models with formulas of damping")
            rates = _rates.derive(problem, prover, formulas, decaying)
        _refuse_kinks([*(e for row in acting for e in row), *decaying] if acting else decaying)
        structure = prover.structure(by_hand)
        given = _told_scalars(_told_kinks(given, structure, problem.texts), problem)
        nnoise, values, traits = problem.nnoise, problem.parameters, structure.traits()
        own, rotation = problem.columns, prover.rotation if structure.rotation else _no_rotation
        part = prover.part
        texts = problem.texts[: nnoise + 1]
        derivatives = Derivatives(
            problem,
            prover.vanishing(),
            kicks=None if structure.split is None else structure.kicks,
            thirds=given.get("thirds", False),
        )
        source = emit_c.source(derivatives, hessians=given.get("hessians", True))
        source += _forces.source(pulls) + _rates.source(rates) + emit_pull.source(derivatives, given.get("moving"))
        if given.get("steps", True):
            source += emit_flow.source(derivatives)
    else:
        _forces.refuse_sites(given["force"], given["noise_force"])
        if formulas:
            raise InvalidArgumentError(
                f"damping = {checks.shown(formulas.formulas[0])}: models of n sites take no formulas of damping; give "
                "numbers, or a function of (q, t)"
            )
        chain = _chain(**chosen, n=given["n"], ends=given["ends"], split=given["split"], fixed=given.get("fixed", ()))
        structure, texts, derivatives, own, part = None, chain.texts, None, chain.columns(), chain.part
        nnoise, values, traits, rotation = chain.nnoise, chain.parameters, chain.traits, _no_rotation
        source = emit_sites.source(chain, **{x: given.get(x) for x in ("thirds", "hessians")})
    derived = time.perf_counter() - start
    compiled = _compiled(source, derivatives is None)
    formula = Formula(
        hamiltonians=texts,
        structure=structure,
        backend="C" if compiled else "NumPy",
        source=source,
        seconds_derivatives=derived,
        seconds_compilation=compiled.seconds if compiled else 0.0,
        file=str(compiled.path) if compiled else "",
    )
    sites = chain and chain.n  # numbers, where arrays may have been given
    given = {**given, "n": sites, "damping": formulas}
    kind = parameters.kind_of(values)
    told = {"ndof": problem.ndof if chain is None else chain.shape.rows(chain.n), "nnoise": nnoise, **traits}
    kinds[kind] = Code(
        given, kind, own, dict(values), told, formula, derivatives, chain, rotation, part, compiled, kinds, pulls,
        rates, kicks=_kicks_of(derivatives) if compiled and given.get("steps", True) else None,
        squares=None if rotation is _no_rotation else prover.squares,
    )  # fmt: skip
    return kinds[kind]


def pulled(code: Code, values: dict[str, Any]) -> dict[str, Any]:
    """The functions of forces, with these values of the parameters."""
    if code.compiled is None:
        return _forces.in_python(code.pulls, values)
    table = np.array(list(values.values()) or [0.0])
    user, kept = ctypes.c_void_p(table.ctypes.data), (table, code.compiled.library)
    there = [kind for kind in _forces.FUNCTIONS if hasattr(code.compiled.library, f"formula_{kind}")]
    return {x: callbacks.WithData(address(code.compiled, f"formula_{x}"), user, kept) for x in there}


def functions(compiled: compiler.Compiled) -> dict[str, Any]:
    """The compiled callbacks."""
    there = [kind for kind in KINDS if hasattr(compiled.library, f"formula_{kind}")]
    return {kind: address(compiled, f"formula_{kind}") for kind in there}


def address(compiled: compiler.Compiled, name: str) -> ctypes.c_void_p:
    """The address of a compiled function."""
    return ctypes.cast(getattr(compiled.library, name), ctypes.c_void_p)


def _told_kinks(given: dict[str, Any], structure: Structure, texts: tuple[str, ...]) -> dict[str, Any]:
    """The arguments without whole steps where there are kinks; noises that need a derivative there are refused."""
    if any(structure.kinked) and not structure.position_noise:
        raise InvalidArgumentError(kinks.REFUSED.format(quoted(texts[max(structure.kinked)])))
    return {**given, "steps": False} if structure.kinked else given


def _told_scalars(given: dict[str, Any], problem: Problem) -> dict[str, Any]:
    """The arguments without whole steps where the C library computes functions lane by lane."""
    names = (*SCALAR, *OF_ORDER)
    strange = any(
        type(x).__name__ in names for h in problem.hamiltonians for x in h.atoms(optional("sympy", "sympy").Function)
    )
    return {**given, "steps": False} if strange else given


def _refuse_kinks(expressions: list[Any]) -> None:
    """Refuse kinks of forces and of rates of damping."""
    for e in expressions:
        if kinks.moving(e):
            raise InvalidArgumentError(
                f"the force or rate {quoted(str(e))} has a kink or jump, which Hamiltonians alone may have: write it "
                "smoothly, as tanh(p/0.01) for sign(p)"
            )


def _no_rotation(_values: list) -> None:
    return None


def _read_too(given: dict[str, Any], rows: list[list[Any]], damping: _rates.Asked | None) -> list[Any]:
    """What is read in the names of H beside the noises: split, invariants, forces, rates of damping."""
    forces = (x for row in rows for x in row)
    rates = damping.formulas if damping else ()
    return [*several("split", given["split"]), *given["invariants"], *forces, *rates]


def _split_off(problem: Problem, split: Any) -> tuple[Problem, tuple[Any, str] | None]:
    """A problem without the quadratic part that stands before its invariants, and this part with its text."""
    if split is None:
        return problem, None
    m = problem.nnoise + 1
    bare = replace(problem, invariants=problem.invariants[1:], texts=(*problem.texts[:m], *problem.texts[m + 1 :]))
    return bare, (problem.invariants[0], problem.texts[m])


def _kicks_of(derivatives: Derivatives | None) -> tuple[compiler.Compiled, list[str]] | None:
    """Compiled whole steps of kicks between flows of the quadratic part; a file of their own, since their kicks are
    those of H at p = 0."""
    split = derivatives and derivatives.kicks == KICKS[0]
    source, schemes = emit_flow.source_of_kicks(derivatives) if split else ("", [])
    compiled = compiler.build(emit_c.preamble(derivatives) + source) if source else None
    return compiled and (compiled, schemes)


def _compiled(source: str, is_chain: bool) -> compiler.Compiled | None:
    """The compiled code; None if nothing can be compiled, with a warning about the cost."""
    compiled = compiler.build(source)
    if compiled is not None:
        return compiled
    if is_chain:
        raise InvalidArgumentError("sums over sites need a C compiler: install gcc or clang, or pip install ziglang")
    checks.warn(in_numpy.SENTENCE, SlowFormulaWarning)
    return None


def _chain(*, H, noise, q, p, params, t, invariants, n, ends, split, fixed) -> Chain:
    """Read sums over n sites."""
    if (q is None) != (p is None) or invariants:
        raise InvalidArgumentError(
            "sums over n sites are in q[i] and p[i]: leave out q, p and invariants, or name the coordinates of a site "
            "and as many momenta, as q='x y z', p='px py pz' for x[i], px[i], .."
        )
    components = None if q is None else (q, p)
    names = {"components": components, "split": split, "fixed": fixed}
    return make_chain(H=H, noise=noise, params=params, t=t, n=n, ends=ends, **names)
