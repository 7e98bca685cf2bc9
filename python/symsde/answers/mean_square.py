# SPDX-License-Identifier: BSD-3-Clause
"""Mean-square stability of a scheme on linear stochastic equations: how second moments grow in one step.

A step is z -> M z with M random. Let S = E z z^T, written as a vector. A step and the exact equations map it by

    vec S -> (E M x M) vec S,    vec S -> exp(G) vec S
    G = h (A x 1 + 1 x A) + |h| sum_k (B_k x B_k + C_k x 1 + 1 x C_k)

with x Kronecker's product, A = J H'', B_k = J H_k'' and C_k = B_k^2/2 of Stratonovich's equations. Growth is the
spectral radius of each of these two matrices. Damping is a part of A: -gamma_i in the rows of p_i, or -Gamma M^-1.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np

from ..errors import IncompatibleError, TooLargeError
from ..model.definition import Model, require_model, require_unforced
from ..native import checks
from ..run.exact_moments import exponential, linear_field
from ..run.simulate import simulate
from ..schemes import Scheme, as_scheme
from .expectation.problem import require_one_value

MOST_NOISES = 2
MOST_POINTS = 2**21  #: most points of the rules; a step that needs more is not averaged
#: most entries of the matrix of second moments: 128 MB, and a few times as much during the computation
MOST_ENTRIES = 2**24
_NODES = (48, 67)  #: numbers of Gauss-Hermite nodes of two rules; if the rules disagree, the moments are infinite
#: numbers of nodes of the two rules, for the parts of dZ and K that are independent of increments
_SHAPES = ((6, 4), (8, 5))
_AGREE = 1e-4
_LAWS = {
    "Gaussian": None,
    "three-point": ((-math.sqrt(3), 0.0, math.sqrt(3)), (1 / 6, 2 / 3, 1 / 6)),
    "two-point": ((-1.0, 1.0), (0.5, 0.5)),
}
_ROWS = 4
_MIDDLES = (np.arange(_ROWS) + 0.5) / _ROWS
#: matrix (row, 3): from dW, H = dZ/h - dW/2 = int (1/2 - s) dW and K = int (s^2 - s + 1/6)/2 dW of a step, s from 0 to
#: 1, to the increments of its _ROWS equal parts: the smallest increments that have these integrals
_OF_SHAPE = np.linalg.pinv(np.stack([np.ones(_ROWS), 0.5 - _MIDDLES, (_MIDDLES**2 - _MIDDLES + 1 / 6 + 1 / 192) / 2]))


@dataclass(frozen=True)
class MeanSquare:
    """The change of second moments S = E z z^T in one step, to E M S M^T, where M is the linear map of the step.

    Constant terms are left out.
    """

    growth: float  #: spectral radius of the map of second moments; infinite if there are none
    exact: float  #: growth of the exact equations; for a negative step, backward along their noise
    mean: float  #: spectral radius of E M
    matrix: np.ndarray | None  #: map of second moments of z = (q, p), ((2 dof)^2, (2 dof)^2); None beyond 32 dof

    @property
    def excess(self) -> float:
        """log(growth/exact): the growth that the scheme adds in one step."""
        return math.log(self.growth / self.exact) if self.growth > 0 else -math.inf


@checks.hinted()
def mean_square(model: Model, scheme: str | Scheme = "midpoint", *, step: float, t: float = 0.0) -> MeanSquare:
    """Compute exactly how second moments grow in one step of a scheme, for a model with quadratic Hamiltonians.

    A step of such a model is a linear map M. It is computed by the library's own steps at the nodes of the law of the
    increments (Gauss-Hermite nodes for Gaussian ones, and also for dZ and K). The result has the mean of M and the mean
    of the Kronecker product of M with itself. Noise with H_k bilinear in (q, p) makes M random. Additive noise only
    adds constants, which do not matter for stability; M is then one matrix, and the model may be a chain. For some
    increments the equations of an implicit step can be singular, as those of midpoint under noise on the stiffness. The
    second moments of M are then infinite. `growth` is infinite if such increments are so likely that two quadrature
    rules disagree; then truncate the increments. All quantities are dimensionless.

    Damped models are accepted, with rates or a matrix of friction, if the scheme runs them.

    IncompatibleError is raised for other models, for schemes that take J or areas, and for more than two noises that
    are not additive. TooLargeError is raised for such noises with more than 32 degrees of freedom.
    """
    require_model(model)
    chosen = as_scheme(scheme)
    step, t = checks.finite("step", step), checks.finite("t", t)
    _refuse(model, chosen)
    if model.traits.additive or model.nnoise == 0:
        return _of_one_matrix(model, chosen, step, t)
    moments = [_moments(model, chosen, step, t, rule) for rule in zip(_NODES, _SHAPES, strict=True)]
    first, second = (pair[1] for pair in moments)
    size = 2 * model.ndof
    known = bool(np.isfinite(second).all() and np.abs(first - second).max() < _AGREE * (1 + np.abs(second).max()))
    growth = _radius(second) if known else math.inf
    exact = _radius(exponential(_generator(model, step, t)))
    mean = _radius(moments[1][0]) if np.isfinite(moments[1][0]).all() else math.inf
    return MeanSquare(growth, exact, mean, second.reshape(size * size, size * size))


def _refuse(model: Model, scheme: Scheme) -> None:
    require_one_value(model)
    require_unforced(model, "growth of second moments is computed")
    if model._varying:
        raise IncompatibleError(
            f"the rates of damping of model {model.name} are functions of position or time: growth in a step is known "
            "for numbers, give model.damped(rate)"
        )
    if not model.traits.quadratic:
        raise IncompatibleError(f"model {model.name} is not quadratic: only linear equations have such a matrix")
    if model.traits.additive or model.nnoise == 0:
        return
    info = scheme.info
    if info.uses_magnus or (info.uses_areas and model.nnoise > 1 and not model.traits.position_noise):
        raise IncompatibleError(
            f"scheme {scheme.name} takes J or areas of the path, which cannot be averaged here: give midpoint"
        )
    if model.nnoise > MOST_NOISES:
        raise IncompatibleError(f"model {model.name} has {model.nnoise} noises: {MOST_NOISES} are allowed")
    points = math.prod(len(axis) for axis in _axes(scheme, (_NODES[1], _SHAPES[1]))) ** model.nnoise
    if points > MOST_POINTS:
        raise IncompatibleError(
            f"scheme {scheme.name} with {model.nnoise} noises would be averaged over {points} ways to drive a step, "
            f"{MOST_POINTS} are allowed: give a scheme of increments alone, or a model of one noise"
        )
    if (2 * model.ndof) ** 4 > MOST_ENTRIES:
        raise TooLargeError(
            f"model {model.name} has {model.ndof} degrees of freedom: the matrix of its second moments would have "
            f"(2 x {model.ndof})^4 = {(2 * model.ndof) ** 4:.3g} entries, {MOST_ENTRIES} are allowed: give at most "
            f"{math.floor(MOST_ENTRIES**0.25 / 2)} degrees of freedom, or additive noise, whose step is one matrix"
        )


def _of_one_matrix(model: Model, scheme: Scheme, step: float, t: float) -> MeanSquare:
    """The result for a step without random matrix: squares of the eigenvalues of M, and of exp(h A)."""
    size = 2 * model.ndof
    matrix = _maps(model, scheme, step, t, np.zeros((_ROWS, model.nnoise, 1)))[0]
    radius = _radius(matrix) if np.isfinite(matrix).all() else math.inf
    rates = np.linalg.eigvals(linear_field(model, 0, t)).real * step
    pairs = np.kron(matrix, matrix) if size**4 <= MOST_ENTRIES else None
    return MeanSquare(radius**2, math.exp(2 * rates.max()), radius, pairs)


def _axes(scheme: Scheme, rule: tuple[int, tuple[int, int]]) -> list[list[tuple[float, float]]]:
    """Nodes and weights of the draws of one noise in a step: dW, H, K, each of variance one; draws not made are
    zero.
    """
    info, (nodes, shapes) = scheme.info, rule
    law = _LAWS[info.law]
    rules = [_hermite(nodes) if law is None else law]
    for used, count in ((info.uses_dz, shapes[0]), (info.uses_stt_area, shapes[1])):
        rules.append(_hermite(count) if used else ((0.0,), (1.0,)))
    return [list(zip(*rule, strict=True)) for rule in rules]


def _hermite(nodes: int) -> tuple[np.ndarray, np.ndarray]:
    x, weight = np.polynomial.hermite_e.hermegauss(nodes)
    return x, weight / weight.sum()


def _moments(model: Model, scheme: Scheme, step: float, t: float, rule: tuple) -> tuple[np.ndarray, np.ndarray]:
    """E M and E M x M over the draws of a step."""
    size = 2 * model.ndof
    scale = np.sqrt(abs(step) / np.array([1, 12, 720]))
    one = list(itertools.product(*_axes(scheme, rule)))
    rows = _OF_SHAPE @ (scale[:, None] * np.array([[x for x, _ in drawn] for drawn in one]).T)  # (row, way)
    chance = np.array([math.prod(w for _, w in drawn) for drawn in one])
    grid = np.array(list(itertools.product(range(len(one)), repeat=model.nnoise)))
    maps = _maps(model, scheme, step, t, np.ascontiguousarray(rows[:, grid].transpose(0, 2, 1)))
    weights = chance[grid].prod(axis=1)
    flat = maps.reshape(len(grid), size * size)
    with np.errstate(all="ignore"):
        pairs = (weights[:, None] * flat).T @ flat
    pairs = pairs.reshape(size, size, size, size).transpose(0, 2, 1, 3)  # reorders (i, j), (k, l) as (i, k), (j, l)
    return np.einsum("n,nij->ij", weights, maps), pairs.reshape(size * size, size * size)


def _maps(model: Model, scheme: Scheme, step: float, t: float, rows: np.ndarray) -> np.ndarray:
    """The linear maps (way, size, size) of a step driven by rows (row, noise, way); NaN if the step fails."""
    size, ways = 2 * model.ndof, rows.shape[2]
    points = np.concatenate([np.zeros((size, 1)), np.eye(size)], axis=1)  # the origin, then the unit vectors
    z = np.tile(points, ways)
    given = {"increments": np.repeat(rows, size + 1, axis=2), "refine": 2} if model.nnoise else {}
    with np.errstate(all="ignore"), checks.unwarned():
        run = simulate(model, q0=z[: model.ndof], p0=z[model.ndof :], scheme=scheme, step=step, steps=1, t0=t,
                       paths=z.shape[1], **given)  # fmt: skip
    ends = np.concatenate([run.q[-1], run.p[-1]])
    ends[:, run.status != 0] = np.nan
    ends = ends.reshape(size, ways, size + 1)
    return (ends[:, :, 1:] - ends[:, :, :1]).transpose(1, 0, 2)


def _generator(model: Model, step: float, t: float) -> np.ndarray:
    """The exponent for second moments of the Stratonovich equations over a step: h (A x 1 + 1 x A) + |h| sum_k (B_k x
    B_k + C_k x 1
    + 1 x C_k), C_k = B_k^2/2 the Ito term: increments have the variance |h| backward, too.
    """
    size = 2 * model.ndof
    flows = [linear_field(model, j, t) for j in range(model.nnoise + 1)]
    zero, one = np.zeros((size, size)), np.eye(size)
    drift = step * flows[0] + abs(step) * sum((b @ b for b in flows[1:]), zero) / 2
    pairs = abs(step) * sum((np.kron(b, b) for b in flows[1:]), np.kron(zero, zero))
    return np.kron(drift, one) + np.kron(one, drift) + pairs


def _radius(matrix: np.ndarray) -> float:
    return float(np.abs(np.linalg.eigvals(matrix)).max())
