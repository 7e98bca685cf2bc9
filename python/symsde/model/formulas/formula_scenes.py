# SPDX-License-Identifier: BSD-3-Clause
"""Formulas in scenes: [model] with H, noise, q, p and [model.params], all text and numbers.

[model]
H = "p**2/2 - omega**2*cos(q)"
noise = ["sigma*sin(q)"]
[model.params]
omega = 2.0
sigma = 0.2

Beside H there may be force, F_1 .. F_n, and noise_force, a list of as many for each noise, and damping, rates of the
momenta, which may be negative with allow_gain = true, and split, a quadratic part of H whose flow is exact.
"""

from __future__ import annotations

from typing import Any

from ...errors import InvalidArgumentError, UnknownNameError
from ...native import checks
from ..definition import Model
from . import rates
from .formula_model import model_from_sympy

KEYS = [
    "H",
    "noise",
    "q",
    "p",
    "t",
    "params",
    "invariants",
    "n",
    "ends",
    "name",
    "force",
    "noise_force",
    "damping",
    "allow_gain",
    "split",
]
_LISTS = ("noise", "q", "p", "invariants", "force", "noise_force")

TEMPLATE = """\
# A model from formulas: + - * / ** and sin, cos, tan, exp, log, sqrt, sinh, cosh, tanh, their inverses, erf.
# dp = -H_q dt - sum_k H_{k,q} o dW_k, dq = H_p dt + sum_k H_{k,p} o dW_k (Stratonovich); t is the time.
[model]
H = "p**2/2 - omega**2*cos(q)"
noise = ["sigma*sin(q)"]  # H_1, H_2, ..
# q = ["x", "y"], p = ["px", "py"]: names of coordinates, where they are not q, p or q1, q2, .., p1, p2, ..

[model.params]
omega = 2.0
sigma = 0.2

[run]
scheme = "midpoint"   # `symsde list` shows all
step = 0.02           # h
steps = 5000          # a multiple of save_every
q0 = 1.0              # the same for all paths, or a list of numbers, one for each coordinate
p0 = 0.0
save_every = 50       # steps between saved points
paths = 1000
seed = 1

[output]
moments = true        # moments.csv: means with standard errors
paths = [0]           # run.nc: these paths
"""


def holds_formulas(damping: object) -> bool:
    """Whether damping of a scene is given as formulas."""
    return isinstance(rates.asked(damping), rates.Asked)


def from_table(table: dict[str, Any]) -> Model:
    """The model of a table [model] that holds H."""
    for key, value in table.items():
        if key not in KEYS:
            raise UnknownNameError(
                f"{key!r} is no key beside H: there are {checks.nearest(key, KEYS)}; values stand in [model.params]"
            )
        if key in _LISTS and not isinstance(value, str | list):
            raise InvalidArgumentError(f"{key} = {checks.shown(value)}: give a text, or a list of texts")
        texts = value if isinstance(value, list) else [value]
        if key == "noise_force":  # a list for each noise
            texts = [x for row in texts for x in (row if isinstance(row, list) else [row])]
        if key not in ("params", "n", "damping", "allow_gain") and not all(isinstance(x, str) for x in texts):
            raise InvalidArgumentError(f"{key} = {checks.shown(value)}: write formulas and names as text, in quotes")
    return model_from_sympy(**table)
