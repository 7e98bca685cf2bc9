# SPDX-License-Identifier: BSD-3-Clause
"""Formulas without a compiler: each node of the graph is one NumPy operation on all lanes."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from ...native.files import optional
from .derivatives import Derivatives
from .emit_c import reachable
from .graph import Graph

SENTENCE = (
    "there is no C compiler, so that the formulas are evaluated by NumPy on one thread, which takes 40 to 70 times as "
    "long for many paths and 800 to 2000 times for one: install gcc or clang, or pip install ziglang"
)


LOG_2 = math.log(2)
#: functions of scipy.special
SPECIAL = {"gamma": "gamma", "loggamma": "gammaln", "polygamma": "polygamma"}
SPECIAL |= {"besselj": "jv", "bessely": "yv", "besseli": "iv", "besselk": "kv"}


def gauss(x: Any) -> Any:
    """exp(-x^2), corrected for the rounding error of the square."""
    x = np.clip(x, -40, 40)
    near = np.float64(np.float32(x))
    found = np.exp(-near * near)
    return found + found * np.expm1(-(x - near) * (x + near))


_OPERATIONS: dict[str, Callable] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": operator.truediv,
    "negative": operator.neg,
    "pow": np.power,
    "atan2": np.arctan2,
    "less": lambda a, b: np.where(a < b, 1.0, 0.0),
    "upto": lambda a, b: np.where(a <= b, 1.0, 0.0),
    "select": lambda chosen, a, b: np.where(chosen > 0.5, a, b),
    "fabs": np.abs,
    "floor": np.floor,
    "erf": np.vectorize(math.erf, otypes=[float]),
    "erfc": np.vectorize(math.erfc, otypes=[float]),
    "log1p": np.log1p,
    "sech": lambda x: 2 * np.exp(-abs(x)) / (1 + np.exp(-2 * abs(x))),
    "csch": lambda x: np.where(
        abs(x) < 1, 1 / np.sinh(x), np.copysign(2 * np.exp(-abs(x)), x) / -np.expm1(-2 * abs(x))
    ),
    "coth": lambda x: 1 / np.tanh(x),
    "gauss": gauss,
    "logcosh": lambda x: np.where(
        abs(x) < 1, np.log1p(2 * np.sinh(x / 2) ** 2), abs(x) - LOG_2 + np.log1p(np.exp(-2 * abs(x)))
    ),
    **{name: getattr(np, name) for name in ("sin", "cos", "tan", "exp", "log", "sqrt", "sinh", "cosh", "tanh")},
    **{f"a{name}": getattr(np, f"arc{name}") for name in ("sin", "cos", "tan", "sinh", "cosh", "tanh")},
}


def _operation(what: str) -> Callable:
    """The function of NumPy, or of scipy for those that NumPy lacks."""
    if what not in SPECIAL:
        return _OPERATIONS[what]
    function = getattr(optional("scipy.special", "fit"), SPECIAL[what])
    if what not in ("loggamma", "bessely", "besselk"):
        return function
    return lambda *given: np.where(given[-1] > 0, function(*given), np.nan)


class InNumpy:
    """The functions of a `Model`, evaluated by NumPy."""

    def __init__(self, derivatives: Derivatives, parameters: dict[str, float]):
        """Store formulas with the values of their parameters."""
        self.graph = derivatives.graph
        self.outputs = derivatives.outputs | derivatives.wanted_third()
        self.ndof = derivatives.problem.ndof
        self.parameters = {f"c{k}": value for k, value in enumerate(parameters.values())}

    def functions(self) -> dict[str, Any]:
        """The functions by the names of `Model`'s arguments."""
        names = (
            "gradient",
            "value",
            "hessian",
            "hessian_vector",
            *(["third_derivative"] if "tq" in self.outputs else []),
        )
        return {name: getattr(self, name) for name in names}

    def value(self, t, w, q, p):
        """S = sum_j w[j] H_j."""
        return self._block("value", (t, w, q, p), (1,))[0]

    def gradient(self, t, w, q, p):
        """S_q, S_p."""
        return tuple(self._block(x, (t, w, q, p), (self.ndof,)) for x in ("hq", "hp"))

    def hessian(self, t, w, q, p):
        """S_qq, S_qp, S_pp."""
        return tuple(self._block(x, (t, w, q, p), (self.ndof, self.ndof)) for x in ("hqq", "hqp", "hpp"))

    def hessian_vector(self, t, w, q, p, vq, vp):  # noqa: PLR0917 - what the library hands over
        """The Hessian times (vq, vp)."""
        qq, qp, pp = self.hessian(t, w, q, p)
        uq = np.einsum("jil,jl->il", qq, vq) + np.einsum("jil,jl->il", qp, vp)
        return uq, np.einsum("ijl,jl->il", qp, vq) + np.einsum("jil,jl->il", pp, vp)

    def third_derivative(self, t, w, q, p, aq, ap, bq, bp):  # noqa: PLR0917 - what the library hands over
        """The gradient of a^T S'' b."""
        vectors = {"aq": aq, "ap": ap, "bq": bq, "bp": bp}
        return tuple(self._block(x, (t, w, q, p), (self.ndof,), **vectors) for x in ("tq", "tp"))

    def _block(self, name: str, at: tuple, shape: tuple[int, ...], **vectors: np.ndarray) -> np.ndarray:
        """One block of outputs, with lanes as the last axis."""
        t, w, q, p = at
        given = {"t": t, **self.parameters}
        given |= {
            f"{letter}{i}": row for letter, rows in zip("wqp", (w, q, p), strict=True) for i, row in enumerate(rows)
        }
        given |= {f"{letter}{i}": row for letter, rows in vectors.items() for i, row in enumerate(rows)}
        return values_of(self.graph, self.outputs[name], given, q.shape[-1]).reshape(*shape, -1)


def values_of(graph: Graph, roots: Sequence[int], given: Mapping[str, Any], lanes: int) -> np.ndarray:
    """Values (node, lane) of nodes of a graph, from values of its leaves by name."""
    found: dict[int, Any] = {}
    with np.errstate(all="ignore"):
        for x in reachable(graph, roots):
            node = graph.nodes[x]
            if node.kind == "number":
                found[x] = float(node.value)
            elif node.kind == "leaf":
                found[x] = given[node.value]
            else:
                order = () if node.value is None else (node.value,)
                found[x] = _operation(node.kind)(*order, *(np.float64(found[a]) for a in node.arguments))
    return np.array([np.broadcast_to(found[x], (lanes,)) for x in roots])
