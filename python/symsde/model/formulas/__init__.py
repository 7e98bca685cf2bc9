# SPDX-License-Identifier: BSD-3-Clause
"""Formulas in, compiled models out.

formula_model        `model_from_sympy`
formula_code         formulas derived and compiled, for all values of parameters of a kind
parameters           values of parameters, numbers or arrays by path
warn                 warnings about formulas that are taken
formula_scenes       models from formulas in scenes
formula_observables  observables from formulas, for any model
path_formula         a formula of the end of a path, with its derivatives
path_sums            derivatives of a formula of sums over sites
wide                 parameters as positions that do not move
wide_flows           linear flows of models with parameters as positions
wide_forces          forces and friction of models with parameters as positions
parse                reads formulas from text without executing it
named_formulas       the given formulas, checked and renamed to internal names
derivatives          gradients and Hessians of weighted sums, as nodes of one graph
graph                expressions in which equal parts are one node
scaled               exponentials that do not overflow inside quotients and logarithms
tails                derivatives that stay accurate where a function is near its limit
matrices             matrices as coordinates and momenta
kinks                functions with kinks and jumps as cases
quadratic            the quadratic part of H whose flow is exact between kicks
structure            traits and invariants, derived from formulas
emit_c               C for the callbacks of the library
emit_flow            C for whole steps of a scheme; the steps are in the headers flow_*.h
emit_lane            C for one lane of such a step: derivatives, kicks and drifts, eliminations
chain                chains: densities of sums over sites, and what is derived from them
sites                reads texts about sites into chains
site_ends            the ends of a chain: free, fixed, periodic
site_reader          texts about sites: q[i + 1], m[i], Sum(.., i), Sum(.., i < j)
site_traits          traits of sums over sites
site_parts           the quadratic part of sums over sites whose flow is exact between kicks
site_loops           C for one site of a density
pair_loops           C for all sites, or all pairs of sites, of a density
emit_pull            C for covectors over several steps, of models with parameters as positions
emit_sites           C for the callbacks of a chain
emit_rows            C for the rows of a chain that couples neighbours only
emit_chain_flow      C for whole steps of such a chain; the steps are in flow_chain.h
collective           Hamiltonians that are functions of sums over sites
emit_collective      C for these functions
sums                 observables that are functions of sums over sites
forces               forces beside the Hamiltonians
rates                rates of damping
actions              functions of the actions beside a quadratic part of H
compiler             the system's compiler
cache                the folder of compiled formulas, with checks that loading from it is safe
in_numpy             the callbacks without a compiler
"""

from .formula_code import Formula
from .formula_model import FormulaModel, model_from_sympy
from .structure import Structure

__all__ = ["Formula", "FormulaModel", "Structure", "model_from_sympy"]
