# SPDX-License-Identifier: BSD-3-Clause
"""Formulas in, compiled models out.

problem        what is given, checked, in names of its own
derivatives    gradients and Hessians of weighted sums, as nodes of one graph
graph          expressions in which equal parts are one node
scaled         exponentials that do not overflow inside of quotients and logarithms
structure      traits and invariants, derived
emit_c         C for the callbacks of the library
sites          sums over the sites of a chain; site_loops, emit_sites, emit_rows their C
collective     functions of such sums; emit_collective their C
compiler       the system's compiler, and a cache on disk
in_numpy       the same callbacks without one
observables    values of the state, of any model
model          `model_from_sympy`
"""

from .formula_model import Formula, FormulaModel, model_from_sympy
from .structure import Structure

__all__ = ["Formula", "FormulaModel", "Structure", "model_from_sympy"]
