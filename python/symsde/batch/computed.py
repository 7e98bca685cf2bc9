# SPDX-License-Identifier: BSD-3-Clause
"""Identify model, scheme and functions of a run by their values, because a function in an unchanged file may still
compute other values later. A function of a module may import other modules, read files, or look at the environment,
and a model that it returns has parameters of its own. So functions are identified by their values at points near the
start and far from it, at two times. Values are compared to eight digits, since the last digits depend on the
processor.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import warnings
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ..model.definition import Model
from ..run.step import step
from ..schemes import Scheme

_SCALES = (0.1, 1.0, 4.0)  #: sizes of the shifts from the first state to the points
_POINTS = 3  #: number of points for each size
_DIGITS = 1e8
_LEAST = 1e-5
_GOLDEN = 0.6180339887498949

Function = Callable[[np.ndarray, np.ndarray], Any]  # a function of states (dof, point)


@dataclasses.dataclass(frozen=True)
class Start:
    """The initial state, time and length of a run."""

    q: np.ndarray  #: (dof, 1)
    p: np.ndarray
    t: float
    length: float

    @property
    def times(self) -> tuple[float, float]:
        """Two times within the run."""
        return self.t, self.t + self.length / 3


def of(model: Model, scheme: Scheme | None, start: Start, functions: Mapping[str, Function]) -> dict[str, Any]:
    """Model, scheme and functions of states as JSON types; short lists of numbers are written in full."""
    model, given = model._part(slice(1)), model
    traits = dataclasses.asdict(model.traits)
    traits["rotation"] = traits["rotation"] and _hash(_rounded(np.array([traits["rotation"]])))
    traits["silent"] = list(traits["silent"])
    del traits["diagonal_mass"], traits["touches"]  # these traits only save work, and older folders lack them
    if not traits["has_parts"]:  # as older folders have it
        del traits["has_gradient"], traits["has_parts"]
    if traits["split"] is None:
        del traits["split"], traits["kicks"]
    else:
        traits["split"] = _hash(_rounded(np.array(traits["split"])))
    found = {"model": model.name, "parameters": {key: _by_path(x) for key, x in given.parameters.items()}}
    found["traits"] = traits
    if (formula := getattr(model, "formula", None)) is not None:
        found["formulas"] = list(formula.hamiltonians)
    if model.damping:
        found["damping"] = _told(_of_short_steps(model, start)) if model._varying else np.array(model.damping).tolist()
    found |= _of_hamiltonians(model, start)
    if not model.traits.has_gradient:  # flows of two parts of H alone, which make these steps
        found["flows"] = _told(_of_short_steps(model, start, "verlet_dkd_weak2"))
    if model._forces:
        found["forces"] = _told(_of_short_steps(model, start))
    if scheme is not None:
        found["scheme"] = _hash(json.dumps([_recipe(scheme), _plain(scheme.tableau())]).encode())
    if functions:
        found["functions"] = {name: _told(_of_function(function, start)) for name, function in functions.items()}
    return found


def _by_path(value: Any) -> Any:
    """The value of a parameter; for values by path or by site their number and a hash."""
    return value if np.ndim(value) == 0 else f"{np.size(value)} values ({_hash(np.asarray(value, '<f8').tobytes())})"


def _of_hamiltonians(model: Model, start: Start) -> dict[str, str]:
    """H, and a sum of the noises; nothing where neither gradients nor values are given."""
    kinds = [model.gradient] * model.traits.has_gradient + [model.value] * model.traits.has_value
    if not kinds:
        return {}
    weights = np.zeros((model.nnoise + 1, _POINTS))
    weights[0] = 1.0
    found = {"H": _told(_of_model(kinds, weights, start))}
    if model.nnoise:
        weights = 1.0 + 0.5 * _spread(model.nnoise + 1, 0)
        weights[0] = 0.0
        found["noises"] = _told(_of_model(kinds, weights, start))
    return found


def _of_model(kinds: list[Callable], weights: np.ndarray, start: Start) -> list[Any]:
    """Gradients, and values, of a weighted sum of Hamiltonians."""
    return [_tried(f, q, p, weights, t) for q, p in _points(start) for t in start.times for f in kinds]


def _of_short_steps(model: Model, start: Start, by: str = "heun") -> list[Any]:
    """Changes of the state in one short step, which flows make, and to which forces and rates of damping add."""
    size = start.length / 64
    noise = np.sqrt(abs(size)) * (1.0 + 0.5 * _spread(model.nnoise, 0))

    def moved(q: np.ndarray, p: np.ndarray, t: float) -> np.ndarray:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return np.concatenate(step(model, by, q, p, size, noise, t)) - np.concatenate((q, p))

    return [_tried(moved, q, p, t) for q, p in _points(start) for t in start.times]


def _of_function(function: Function, start: Start) -> list[Any]:
    return [_tried(function, q, p) for q, p in _points(start)]


def _points(start: Start) -> list[tuple[np.ndarray, np.ndarray]]:
    """States (dof, point) that are the same in every version of NumPy, unlike its random numbers."""
    dof = len(start.q)
    return [(start.q + x * _spread(dof, 0), start.p + x * _spread(dof, dof)) for x in _SCALES]


def _spread(rows: int, first: int) -> np.ndarray:
    """Numbers (row, point) between -1 and 1."""
    k = np.arange(1, rows * _POINTS + 1).reshape(rows, _POINTS) + first * _POINTS
    return 2.0 * np.modf(k * _GOLDEN)[0] - 1.0


def _tried(function: Callable, *arguments: Any) -> np.ndarray | str:
    """Values of the function, (component, point); if it raises, the text of its exception."""
    try:
        with np.errstate(all="ignore"):
            return np.reshape(np.asarray(function(*arguments), dtype=float), (-1, _POINTS))
    except Exception as error:
        return type(error).__name__


def _told(parts: list[np.ndarray | str]) -> str:
    """The first two numbers, and a hash of all numbers."""
    shown = [f"{x:.5g}" for x in parts[0].flat[:2]] if isinstance(parts[0], np.ndarray) else [f"raises {parts[0]}"]
    hashed = _hash(*(part.encode() if isinstance(part, str) else _rounded(part) for part in parts))
    return f"{', '.join(shown)}, .. ({hashed})"


def _rounded(values: np.ndarray) -> bytes:
    """Round values (component, point) to eight digits of the largest value of a component, or of 1e-5 of the
    largest value of all components if this is larger: smaller values may be mere rounding."""
    sizes = np.max(np.abs(values), axis=1, where=np.isfinite(values), initial=0.0)
    sizes = np.maximum(sizes, _LEAST * np.max(sizes, initial=0.0))
    units = np.array([float(f"{x:.2e}") or 1.0 for x in sizes])[:, np.newaxis] / _DIGITS
    whole = np.nan_to_num(np.round(values / units), nan=2.0**60, posinf=2.0**61, neginf=-(2.0**61))
    return f"{units.tolist()}".encode() + whole.astype("<i8").tobytes()


def _recipe(value: Any) -> Any:
    """Describe how a scheme was made, and from which coefficients."""
    if isinstance(value, Scheme):
        maker, arguments = value._made
        return [maker.__name__, *map(_recipe, arguments)]
    return [_recipe(x) for x in value] if isinstance(value, list | tuple) else _plain(value)


def _plain(value: Any) -> Any:
    """Convert arrays to lists."""
    if dataclasses.is_dataclass(value):
        return {key: _plain(x) for key, x in vars(value).items()}
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else value


def _hash(*parts: bytes) -> str:
    return hashlib.sha256(b"\0".join(parts)).hexdigest()[:16]
