# SPDX-License-Identifier: BSD-3-Clause
"""Models from formulas."""

from __future__ import annotations

import ctypes
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .. import _callbacks, _checks
from ..model import Model
from . import compiler, emit_c
from .derivatives import Derivatives
from .problem import Problem, make_problem
from .structure import Structure, structure_of

KINDS = ("gradient", "value", "hessian", "hessian_vector", "gradient_hessian")


@dataclass(frozen=True)
class Formula:
    """What became of the formulas of a model."""

    hamiltonians: tuple[str, ...]  #: H, H_1 .. H_m as given
    structure: Structure  #: what was derived from them
    backend: str  #: "C"
    source: str  #: the generated code
    seconds_derivatives: float  #: for derivatives and code
    seconds_compilation: float  #: 0 = it was compiled before
    file: str = field(default="", compare=False)  #: the compiled library


class FormulaModel(Model):
    """A model from formulas; `formula` says what was derived and generated."""

    formula: Formula

    def with_parameters(self, **values: float) -> FormulaModel:
        """The same model with other values of some parameters; nothing is compiled again."""
        _, (given,) = self._remade
        for key in values:
            _checks.choice("the parameter", key, list(self.parameters))
        return _made({**given, "params": {**self.parameters, **values}})


def model_from_sympy(
    H: Any,
    noise: Any = (),
    *,
    q: Any = None,
    p: Any = None,
    params: Mapping[str, float] | None = None,
    t: Any = None,
    invariants: Any = (),
    name: str = "formula",
) -> FormulaModel:
    """A model from its Hamiltonians H(q, p, t) and H_1 .. H_m (noise), expressions of sympy or texts; dimensionless.

        dp = -H_q dt - sum_k H_{k,q} o dW_k        dq = H_p dt + sum_k H_{k,p} o dW_k     [WHSB] (3)-(4)

    q, p: symbols of coordinates and momenta, or their names (without them q and p, or q1, q2, .. and p1, p2, .. as
    the texts have them); functions of time as of `dynamicsymbols` too. Texts as "p**2/2 - omega**2*cos(q)" are read by
    a parser of arithmetic alone, which executes nothing. params:
    values of all other symbols, by name; t: the symbol of time, t unless told. invariants: candidates I, of each of
    which I_t + {I, H} = 0 and {I, H_k} = 0 is proved or not (``model.formula.structure.invariants``).

    Derivatives and traits are derived, C code is generated, compiled by the system's compiler and kept on disk
    (SYMSDE_CACHE); values of parameters are given when it runs. ``model.formula`` tells all that. Errors are
    InvalidArgumentError with a sentence that quotes the formula.
    """
    given = {
        "H": H,
        "noise": noise,
        "q": q,
        "p": p,
        "params": params,
        "t": t,
        "invariants": invariants,
        "name": name,
    }
    return _made(given)


def _made(given: dict[str, Any]) -> FormulaModel:
    """A model from the arguments of `model_from_sympy`."""
    start = time.perf_counter()
    name = given["name"]
    problem = make_problem(**{key: value for key, value in given.items() if key != "name"})
    structure = structure_of(problem)
    source = emit_c.source(Derivatives(problem))
    derived = time.perf_counter() - start
    compiled = compiler.build(source)
    formula = Formula(
        hamiltonians=problem.texts[: problem.nnoise + 1],
        structure=structure,
        backend="C",
        source=source,
        seconds_derivatives=derived,
        seconds_compilation=compiled.seconds,
        file=str(compiled.path),
    )
    model = FormulaModel(
        ndof=problem.ndof,
        nnoise=problem.nnoise,
        accepts_null=True,
        name=name,
        **structure.traits(),
        **_functions(compiled, problem),
    )
    model.formula = formula
    model.parameters = dict(problem.parameters)
    model._remade = (_made, (given,))
    return model


def _functions(compiled: compiler.Compiled, problem: Problem) -> dict[str, Any]:
    """The compiled callbacks, each with the values of the parameters."""
    values = np.array(list(problem.parameters.values()) or [0.0])
    functions = {}
    for kind in KINDS:
        address = ctypes.cast(getattr(compiled.library, f"formula_{kind}"), ctypes.c_void_p)
        functions[kind] = _callbacks.WithData(address, ctypes.c_void_p(values.ctypes.data), (values, compiled.library))
    return functions
