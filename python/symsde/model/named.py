# SPDX-License-Identifier: BSD-3-Clause
"""Functions that pickle cannot find by their names, such as lambdas: a model with such functions is refused, unless
the pickler writes their code.
"""

from __future__ import annotations

import functools
import pickle
import sys
from collections.abc import Iterable
from types import FunctionType
from typing import Any

from ..errors import WrongTypeError

_BY_NAME = ("_pickle", "pickle", "multiprocessing.reduction")  #: modules of Python's own picklers


def require_names(model: str, functions: Iterable[Any]) -> None:
    """Refuse, with a sentence, functions that plain pickle would refuse; cloudpickle and similar classes of picklers
    may accept more."""
    nameless = [f for f in functions if isinstance(f, FunctionType) and not _is_found(f)]
    if nameless and not _is_by_value():
        raise WrongTypeError(
            f"model {model!r} holds the function {nameless[0].__qualname__}, which pickle cannot find by name, so that "
            "neither the model nor its results can be pickled: define it by def at the top of a module, pickle by "
            "cloudpickle, or save the arrays (save, to_xarray)"
        )


def _is_found(function: FunctionType) -> bool:
    try:
        place = sys.modules[function.__module__]
        return functools.reduce(getattr, function.__qualname__.split("."), place) is function
    except (AttributeError, KeyError):
        return False


def _is_by_value() -> bool:
    """Whether a pickler other than Python's is active."""
    frame = sys._getframe()
    while frame is not None:
        at_work = frame.f_locals.get("self")
        if isinstance(at_work, pickle.Pickler | pickle._Pickler) and type(at_work).__module__ not in _BY_NAME:
            return True
        frame = frame.f_back
    return False
