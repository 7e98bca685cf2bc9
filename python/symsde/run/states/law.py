# SPDX-License-Identifier: BSD-3-Clause
"""A law of initial states: what setups ask of it, and the numbers that the library draws for it."""

from __future__ import annotations

import abc
from typing import Any

import numpy as np

from ...errors import IncompatibleError, InvalidArgumentError, WrongShapeError
from ...model.definition import Model, require_model
from ...native import checks, handles
from ...native.checks import address

NORMAL, UNIFORM = 1, 2  #: kinds of numbers in the library
_MOST = 2**47  #: paths of a run
TOLERANCE = 1e-12  #: relative errors of given covariances


class States(abc.ABC):
    """A law of initial states, given as q0, as p0, or as both: then q and p of a path are drawn together.

    The state of a path depends on the law, the seed and the index of the path alone: it is the same in every run, for
    any threads, shards and first_path, and independent of the noise. Without a seed of its own a law takes the run's.
    """

    def __init__(self, seed: int | None):
        """Keep the seed."""
        self.seed = None if seed is None else checks.integer("seed", seed, checks.UINT64)

    @abc.abstractmethod
    def _draw(self, model: Model, t: float, seed: int, where: tuple[int, int], letters: str) -> tuple:
        """States q and p, (dof, path) each, of the paths `where`, (first, count), as the letters "q", "p" or "qp"
        ask; a letter that is not asked for may be None.
        """

    @abc.abstractmethod
    def told(self) -> dict[str, Any]:
        """Name and numbers of the law, in types of JSON: equal texts draw equal states."""

    def draw(
        self, model: Model, paths: int, *, seed: int = 0, first_path: int = 0, t: float = 0.0, letters: str = "qp"
    ) -> tuple[np.ndarray | None, np.ndarray | None]:
        """The states q and p, (dof, path) each, of some paths of a model, as a run with this seed begins.

        - paths, first_path: global indices first_path .. first_path + paths - 1
        - seed: of the run, 0 .. 2^64 - 1; a law with a seed of its own takes that
        - t: time of the start, for laws of a Hamiltonian that depends on time
        - letters: "qp", or "q" or "p" for one of them; the other is None
        """
        require_model(model)
        paths = checks.integer("paths", paths, (1, _MOST))
        first = checks.integer("first_path", first_path, (0, _MOST))
        seed = checks.integer("seed", seed, checks.UINT64)
        checks.choice("letters", letters, ["q", "p", "qp"])
        checks.room((2, model.ndof, paths), "the initial states (q and p; dof, path)", do=_LESS)
        found = self._draw(model, t, seed if self.seed is None else self.seed, (first, paths), letters)
        return tuple(x if name in letters else None for name, x in zip("qp", found, strict=True))

    def _told(self, name: str, **numbers: Any) -> dict[str, Any]:
        """A table of JSON without what was left out."""
        plain = {key: np.asarray(x).tolist() if not isinstance(x, str | dict) else x for key, x in numbers.items()}
        return {"law": name, **{key: x for key, x in plain.items() if x is not None}, **self._seed()}

    def _seed(self) -> dict[str, int]:
        return {} if self.seed is None else {"seed": self.seed}

    def __repr__(self) -> str:
        """The law with its numbers."""
        told = self.told()
        inside = ", ".join(f"{key}={checks.shown(x)}" for key, x in told.items() if key != "law")
        return f"<initial states: {told['law']}({inside})>"


_LESS = "`symsde run` and symsde.ensemble draw the states of a part of the paths at a time"


def drawn(
    kind: int, seed: int, where: tuple[int, int], centre: np.ndarray, factor: np.ndarray, *, stream: int = 0
) -> tuple[np.ndarray, np.ndarray]:
    """centre + factor z of the library: centre (2 dof,), factor (2 dof, 2 dof) or (2 dof, 1) for deviations."""
    first, paths = where
    ndof = len(centre) // 2
    q, p = np.empty((2, ndof, paths))
    centre, factor = (np.ascontiguousarray(x, np.float64) for x in (centre, factor))
    arrays = map(address, (centre, factor, q, p))
    handles.call("draw_states", kind, seed, stream, first, paths, ndof, factor.shape[1], *arrays)
    return q, p


def of_both(name: str, value: np.ndarray, ndof: int) -> np.ndarray:
    """A number, (dof,) or (2 dof,) as (2 dof,): a number and (dof,) hold for q and for p."""
    if value.ndim == 0:
        return np.full(2 * ndof, float(value))
    if value.shape in ((ndof,), (2 * ndof,)):
        return np.tile(value, 2 * ndof // value.size)
    raise WrongShapeError(
        f"{name} of initial states has shape {value.shape}: give a number, ({ndof},) for q0 or p0, or ({2 * ndof},) "
        "for q_1 .. and then p_1 .. of both"
    )


def root_of(covariance: np.ndarray) -> np.ndarray:
    """The triangular C with C C^T = covariance, which may be singular; the same bits on every machine.

    Each number is judged beside the variances of its own row and column: coordinates have units of their own.
    """
    left, deviations = covariance.copy(), np.sqrt(np.abs(np.diag(covariance)))
    n = len(left)
    root = np.zeros((n, n))
    for k in range(n):
        pivot, column, least = left[k, k], left[k + 1 :, k], TOLERANCE * deviations[k] ** 2
        if pivot < -least or (
            pivot <= least and (np.abs(column) > np.sqrt(TOLERANCE) * deviations[k] * deviations[k + 1 :]).any()
        ):
            raise InvalidArgumentError(
                "the covariance of initial states has a negative eigenvalue: give a matrix that is not negative in any "
                "direction"
            )
        if pivot <= least:
            continue
        root[k, k] = np.sqrt(pivot)
        root[k + 1 :, k] = column / root[k, k]
        left[k + 1 :, k + 1 :] -= root[k + 1 :, k, np.newaxis] * root[k + 1 :, k]
    return root


def require_numbers(model: Model, law: str) -> None:
    """Refuse models whose parameters differ from path to path, where a law is one of the model."""
    if model.paths:
        raise IncompatibleError(
            f"parameters of model {model.name} differ from path to path, and states.{law} follows from one H: draw the "
            "states for each value, or give a law with numbers of its own"
        )
