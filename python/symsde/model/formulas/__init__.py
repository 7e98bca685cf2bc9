# SPDX-License-Identifier: BSD-3-Clause
"""Formulas in, compiled models out.

formula_model        `model_from_sympy`
formula_scenes       the same in scenes
formula_observables  values of the state, of any model
parse                formulas as text, of which nothing is executed
named_formulas       formulas as they are given, checked, in names of their own
derivatives          gradients and Hessians of weighted sums, as nodes of one graph
graph                expressions in which equal parts are one node
scaled               exponentials that do not overflow inside of quotients and logarithms
tails                derivatives that keep their digits near the limit of a function
structure            traits and invariants, derived
emit_c               C for the callbacks of the library
emit_flow            C for whole steps of a scheme; the steps themselves are the headers flow_*.h
sites                chains: sums over sites
site_loops           C for one site of a density
emit_sites           C for the callbacks of a chain
emit_rows            C for the rows of a chain that ties neighbours only
collective           Hamiltonians that are functions of sums over sites
emit_collective      C for such functions
sums                 observables that are functions of sums over sites
compiler             the system's compiler
cache                the folder of compiled formulas, and whether they may be loaded from there
in_numpy             the callbacks without a compiler
"""

from .formula_model import Formula, FormulaModel, model_from_sympy
from .structure import Structure

__all__ = ["Formula", "FormulaModel", "Structure", "model_from_sympy"]
