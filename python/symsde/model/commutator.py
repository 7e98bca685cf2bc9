# SPDX-License-Identifier: BSD-3-Clause
"""Test whether the noises of a model commute, and which order to expect then."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import WrongTypeError
from ..native import abi, checks
from ..native.checks import address
from ..native.progress import Monitor
from .definition import Model, require_model


@dataclass(frozen=True)
class Commutator:
    """Poisson brackets of a model's Hamiltonians at sample points. Points can refute that brackets vanish, not prove
    it."""

    commutative: bool  #: every {H_k,H_l} is constant: increments alone reach strong order 1, dZ 3/2
    flows_commute: bool  #: every {H,H_k} is constant, too, no noise changes in time, and the model is not damped
    noise: float  #: largest relative gradient of {H_k,H_l}
    drift: float  #: largest relative gradient of {H,H_k}, or change of a noise's gradient in time
    text: str  #: which strong order to expect, from which scheme

    def __str__(self) -> str:
        """The sentence about orders."""
        return self.text


def commutator(model: Model, q: Any = None, p: Any = None, t: float = 0.0) -> Commutator:
    """Test whether the noises commute, by the gradients of their Poisson brackets {F,G} = F_q.G_p - F_p.G_q.

    q, p: sample points, a number, (dof,) or (dof, point); by default 16 points spread over [-1.5, 1.5]. Of parameters
    that go by path those of up to 64 paths are tried.
    """
    require_model(model)
    if (q is None) != (p is None):
        raise WrongTypeError("only one of q and p is given: give both, or neither for 16 points chosen by symsde")
    if q is None:
        angle = np.arange(1, 16 * model.ndof + 1).reshape(model.ndof, 16)
        q, p = 1.5 * np.sin(0.7 * angle + 0.3), 1.5 * np.cos(1.3 * angle)
    points = checks.columns(q=q, p=p)
    q, p = (checks.points(name, x, model.ndof, points) for name, x in (("q", q), ("p", p)))
    gradients, commute = np.zeros(2), np.zeros(2, dtype=np.int32)
    text = ctypes.create_string_buffer(1024)
    with Monitor(progress=False) as monitor:
        model.call(
            "commutator",
            checks.number("t", t),
            points,
            *(address(x) for x in (q, p, gradients, commute)),
            text,
            len(text),
            monitor.callback,
            None,
            allow=(abi.STOPPED,),
        )
    return Commutator(
        commutative=bool(commute[0]),
        flows_commute=bool(commute[1]),
        noise=float(gradients[0]),
        drift=float(gradients[1]),
        text=text.value.decode("utf-8", "replace"),
    )
