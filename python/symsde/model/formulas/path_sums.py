# SPDX-License-Identifier: BSD-3-Clause
"""Derivatives of functions of sums, f = F(S_1, S_2, ..), of the state and of parameters: grad f = sum_a F_a grad S_a.

That is the gradient of a Hamiltonian of sums over sites (`collective.py`) whose parameters are positions (`wide.py`),
and its loops are generated as theirs are. Single coordinates and parameters beside the sums are sums of one term.
"""

from __future__ import annotations

import ctypes
import functools
import re
from typing import Any

import numpy as np

from ...errors import IncompatibleError
from ...native import checks
from ...native.files import optional
from ..definition import Model
from . import compiler, emit_sites, kinks
from .chain import Chain
from .collective import make_outer
from .formula_observables import Sites, known_names, letters_of, sites_of
from .parse import FormulaTextError, is_name
from .site_reader import Number, Row, SiteReader
from .site_traits import traits_of
from .sites import Owner, fixed_rows, inner_densities
from .wide import Positions


class PathSums:
    """Derivatives of f; callable as (t, q, p) of states (dof, lane) -> fq, fp, and those by positions that f holds."""

    def __init__(self, model: Model, formula: str, positions: Positions):
        """Read, differentiate and compile the formula; positions: of parameters by which it is differentiated."""
        values = model.parameters
        numbers = tuple(key for key, x in values.items() if is_name(key) and np.isscalar(x))
        sites, time, ends = sites_of(model)
        sites = sites.of(formula, model.ndof)
        fixed = tuple(name for name in dict.fromkeys(positions) if name in numbers or name in sites.arrays)
        self._chain, compiled = _compiled(formula, (letters_of(model), numbers, time, ends), sites, fixed)
        if compiled is None:
            raise IncompatibleError(
                f"f = {formula!r} is a sum over sites, whose derivatives need a C compiler: install gcc or clang, or "
                "pip install ziglang, or give a pair"
            )
        self._gradient, self._kept = compiled.library.formula_gradient, compiled
        self._values = np.array([*(values[x] for x in numbers), *(y for x in sites.arrays for y in values[x]), 0.0])
        self._theta = np.array([y for x in self._chain.fixed for y in np.atleast_1d(values[x])])
        #: places among the positions of the rows behind those of the state
        self.places = positions.places(self._chain.fixed)

    def __call__(self, t: float, q: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Derivatives by q, by p (dof, lane) and by positions (place, lane)."""
        n, lanes = q.shape
        rows = n + len(self._theta)
        place, momenta, slopes, others = np.zeros((4, rows, lanes))
        place[:n], place[n:], momenta[:n] = q, self._theta[:, np.newaxis], p
        arrays = (np.ones((1, lanes)), place, momenta, slopes, others, self._values)
        w, *state = (ctypes.c_void_p(checks.address(x)) for x in arrays)
        if self._gradient(lanes, rows, 1, ctypes.c_double(t), w, *state):
            raise MemoryError("there is no memory for derivatives of sums")
        return slopes[:n], others[:n], slopes[n:]


@functools.lru_cache(maxsize=64)
def _compiled(
    formula: str, given: tuple, sites: Sites, fixed: tuple[str, ...]
) -> tuple[Chain, compiler.Compiled | None]:
    """The sums as a chain whose only Hamiltonian is f, and its code."""
    sympy = optional("sympy", "sympy")
    letters, numbers, time, ends = given
    known, size = known_names((("f", formula),), letters, numbers, time), len(sites.components[0])
    reader = SiteReader(known.known, None, sites.components, sites.arrays)
    total = known.canonical(formula, reader)
    fixed = tuple(sorted(fixed, key=lambda x: x not in sites.arrays))
    rows = fixed_rows(fixed, sites.arrays, list(numbers))
    whole = [total, *reader.sums.values()]
    places = {x.name for e in whole for x in e.free_symbols if re.fullmatch("[qp][0-9]+", x.name)}
    rows |= {x: Row(component=int(x[1:]), fixed="at") for x in places}
    for e in whole:
        for x in sorted(e.free_symbols, key=str):
            require_derivative(sympy.diff(e, x), formula, str(x))
    alone = sorted((x for x in total.free_symbols if x.name in rows), key=str)
    new = {x: sympy.Symbol(f"q{k}", real=True) for k, x in enumerate([*reader.sums, *alone])}
    owner = Owner(formula, Number(), False, dict.fromkeys(numbers, 0.0), rows)
    try:
        bodies = [*map(kinks.in_cases, reader.sums.values()), *alone]
        densities = inner_densities(bodies, owner, ends, sites.count)
        outer = make_outer([(Number(), kinks.in_cases(total).xreplace(new), formula)], len(new), owner.parameters)
    except FormulaTextError as error:
        raise IncompatibleError(f"f = {checks.shown(formula)} has no derivatives here: {error}; give a pair") from None
    chain = Chain(
        n=sites.count,
        components=sites.components,
        arrays=sites.arrays,
        nnoise=0,
        ends=ends,
        densities=tuple(densities),
        outer=outer,
        texts=(formula,),
        parameters=owner.parameters,
        kinked=(),
        traits=traits_of(densities, outer, (sites.count, size), ends == "periodic"),
        part=None,
        fixed=fixed,
    )
    return chain, compiler.build(emit_sites.source(chain, thirds=False, hessians=False))


def require_derivative(derivative: Any, formula: object, name: str) -> None:
    """Refuse what has no derivative."""
    sympy = optional("sympy", "sympy")
    if derivative.has(sympy.Derivative, sympy.Subs, sympy.DiracDelta):
        raise IncompatibleError(f"f = {checks.shown(str(formula))} has no derivative by {name}: give a pair")
