# SPDX-License-Identifier: BSD-3-Clause
"""Mean-square stability of a scheme on linear stochastic equations: how second moments grow in one step."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np

from . import _checks
from .errors import IncompatibleError
from .mlmc.sampler import driven_by_more
from .model import Model
from .schemes import Scheme, as_scheme
from .step import step as make_step

MOST_NOISES = 2
_NODES = (48, 67)  #: of Gauss and Hermite; where the two disagree, the moments are infinite
_AGREE = 1e-4


@dataclass(frozen=True)
class MeanSquare:
    """Second moments S = E z z^T without the constant terms go to E M S M^T in a step."""

    growth: float  #: spectral radius of that map; infinite where a step has no second moments
    exact: float  #: the same of the equations themselves over the step; of a negative one, backward along their noise
    mean: float  #: spectral radius of E M
    matrix: np.ndarray  #: E M x M, ((2 dof)^2, (2 dof)^2), of z = (q, p)

    @property
    def excess(self) -> float:
        """log(growth/exact): what the scheme adds in a step."""
        return math.log(self.growth / self.exact) if self.growth > 0 else -math.inf


def mean_square(model: Model, scheme: str | Scheme = "midpoint", *, step: float, t: float = 0.0) -> MeanSquare:
    """How second moments grow in one step of a scheme, exactly, for a model whose Hamiltonians are quadratic.

    The step is the library's own: its linear map M(dW) at the nodes of a Gauss-Hermite rule gives E M, E M x M. Noise
    of H_k bilinear in (q, p) makes M random; linear terms of additive noise add constants, which do not matter for
    stability. Where a step may meet a singular matrix, as midpoint's under noise on the stiffness, its second moments
    are infinite: growth says so where increments that matter do it, two rules disagreeing; truncate them then.
    Everything is dimensionless.

    IncompatibleError for other models, for schemes that take more of the path than increments, and for more than two
    noises that are not additive.
    """
    chosen = as_scheme(scheme)
    step, t = _checks.finite("step", step), _checks.finite("t", t)
    _refuse(model, chosen)
    moments = [_moments(model, chosen, step, t, nodes) for nodes in _NODES]
    first, second = (pair[1] for pair in moments)
    size = 2 * model.ndof
    known = bool(np.isfinite(second).all() and np.abs(first - second).max() < _AGREE * (1 + np.abs(second).max()))
    growth = _radius(second) if known else math.inf
    exact = _radius(_exponential(_generator(model, step, t)))
    mean = _radius(moments[1][0]) if np.isfinite(moments[1][0]).all() else math.inf
    return MeanSquare(growth, exact, mean, second.reshape(size * size, size * size))


def _refuse(model: Model, scheme: Scheme) -> None:
    if not model.traits.quadratic:
        raise IncompatibleError(f"model {model.name} is not quadratic: linear equations alone have such a matrix")
    if driven_by_more(scheme) or scheme.info.law != "Gaussian":
        raise IncompatibleError(
            f"scheme {scheme.name} takes more than Gaussian increments, over which this averages: give midpoint"
        )
    if not model.traits.additive and model.nnoise > MOST_NOISES:
        raise IncompatibleError(f"model {model.name} has {model.nnoise} noises: {MOST_NOISES} are allowed")


def _moments(model: Model, scheme: Scheme, step: float, t: float, nodes: int) -> tuple[np.ndarray, np.ndarray]:
    """E M and E M x M over the increments."""
    size, noises = 2 * model.ndof, 0 if model.traits.additive else model.nnoise
    x, weight = np.polynomial.hermite_e.hermegauss(nodes)
    weight = weight / weight.sum()
    grid = list(itertools.product(range(nodes), repeat=noises))
    dw = np.zeros((model.nnoise, len(grid)))
    weights = np.ones(len(grid))
    for column, indices in enumerate(grid):
        for k, i in enumerate(indices):
            dw[k, column] = math.sqrt(abs(step)) * x[i]
            weights[column] *= weight[i]
    points = np.concatenate([np.zeros((size, 1)), np.eye(size)], axis=1)  # the origin, then every direction
    z = np.tile(points, len(grid))
    driven = np.repeat(dw, size + 1, axis=1) if model.nnoise else 0.0
    with np.errstate(all="ignore"):
        q, p = make_step(model, scheme, z[: model.ndof], z[model.ndof :], step, driven, t)
    ends = np.concatenate([q, p]).reshape(size, len(grid), size + 1)
    maps = (ends[:, :, 1:] - ends[:, :, :1]).transpose(1, 0, 2)
    pairs = np.einsum("n,nij,nkl->ikjl", weights, maps, maps)
    return np.einsum("n,nij->ij", weights, maps), pairs.reshape(size * size, size * size)


def _generator(model: Model, step: float, t: float) -> np.ndarray:
    """Of second moments of the Stratonovich equations over a step: h (A x 1 + 1 x A) + |h| sum_k (B_k x B_k + C_k x 1
    + 1 x C_k), C_k = B_k^2/2 the Ito term: increments have the variance |h| backward, too.
    """
    size = 2 * model.ndof
    flows = []
    for j in range(model.nnoise + 1):
        w = np.zeros(model.nnoise + 1)
        w[j] = 1
        qq, qp, pp = (block[:, :, 0] for block in model.hessian(np.zeros(model.ndof), np.zeros(model.ndof), w, t))
        flows.append(np.block([[qp, pp], [-qq, -qp.T]]))
    zero, one = np.zeros((size, size)), np.eye(size)
    drift = step * flows[0] + abs(step) * sum((b @ b for b in flows[1:]), zero) / 2
    pairs = abs(step) * sum((np.kron(b, b) for b in flows[1:]), np.kron(zero, zero))
    return np.kron(drift, one) + np.kron(one, drift) + pairs


def _exponential(matrix: np.ndarray) -> np.ndarray:
    """By scaling, Taylor and squaring: the matrices are small."""
    halvings = max(0, math.ceil(math.log2(max(np.abs(matrix).sum(axis=1).max(), 1e-300))) + 4)
    scaled, term = matrix / 2**halvings, np.eye(len(matrix))
    result = term.copy()
    for k in range(1, 14):
        term = term @ scaled / k
        result += term
    for _ in range(halvings):
        result = result @ result
    return result


def _radius(matrix: np.ndarray) -> float:
    return float(np.abs(np.linalg.eigvals(matrix)).max())
