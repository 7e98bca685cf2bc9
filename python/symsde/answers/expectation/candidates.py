# SPDX-License-Identifier: BSD-3-Clause
"""Candidates for the computation of an expectation: schemes, their reliable weak order, and the longest step.

The longest step follows from the largest frequency of the Hessian along the path without noise:

    omega = max_t max |eigenvalues of J H''(z(t))|,    steps >= T omega/SHARPEST

where z' = J H'(z), and small changes follow z' = J H'' z. Without mixed derivatives, and with H_pp = R R^T, the squares
of the frequencies are the eigenvalues of the symmetric matrix R^T H_qq R. Paths with noise may reach states where the
motion is faster; with `paths`, this many paths with noise are examined too.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from ...errors import IncompatibleError, SymsdeError
from ...model.commutator import commutator
from ...model.definition import Model
from ...model.traits import Traits
from ...schemes import Scheme, as_scheme
from .problem import Problem

SHARPEST = 1.6  #: omega h of the longest step that is tried: explicit schemes are unstable from 2 on
#: number of points of a path at which frequencies are computed: eight equal parts follow all but very rapid changes
_POINTS = 9
_FEW = 8  #: up to as many degrees of freedom eigenvalues of all Hessians are computed, beyond it those of one
_PRODUCTS = 32  #: products with a vector that turn it into the fastest motion, and as many that find how it grows
_STATES = 2**12  #: paths with noise times degrees of freedom
#: options of probing runs by midpoint, on which these have no effect
_PLAIN = {"areas": "path", "area_time": None, "damping_noise": "law"}


def suitable(problem: Problem) -> list[Scheme]:
    """The schemes that are worth trying for the model."""
    return fitting(problem, _names(problem.model.traits))


def fitting(problem: Problem, names: Iterable[str]) -> list[Scheme]:
    """Those of the named schemes that the library accepts for this model and these options; each is set up once."""
    return [scheme for scheme in map(as_scheme, names) if _fits(problem, scheme)]


def best_coupled(problem: Problem) -> Scheme:
    """The scheme of multilevel Monte Carlo: gauss_dkdkd if it suits the model, else midpoint."""
    known = [scheme for scheme in suitable(problem) if scheme.name == "gauss_dkdkd"]
    return known[0] if known else as_scheme("midpoint")


def weak_order(problem: Problem, scheme: Scheme) -> float:
    """The weak order of the certificate, but at most 1 if noises do not commute."""
    order = scheme.info.orders["weak"].value or 1.0
    if _splits_evenly(problem.model.traits, scheme.name):
        return 2.0
    return order if order <= 1 or commutes(problem.model, problem.options.get("t0", 0.0)) else 1.0


def of_phases(scheme: Scheme, weak: float) -> float:
    """The power of h in the error of phases: the order without noise, or the weak order if that is higher."""
    return max(float(scheme.info.order_noise_free or 0), weak)


def _splits_evenly(traits: Traits, name: str) -> bool:
    """Whether the scheme has weak order two for this model although its noises do not commute.

    Its drifts and kicks have order two, and its kicks the right mean of the second Magnus term (docs/method/weak.md).
    """
    if not traits.kicked:
        return False
    return name == "lobatto2_swapped" or (name == "stormer_verlet" and traits.additive)


def commutes(model: Model, t: float) -> bool:
    """Whether the noises commute at time t, as far as traits and sample points tell; kicks of own flows do."""
    return model._noise_commutes or not model.traits.has_gradient or commutator(model, t=t).commutative


def _names(traits: Traits) -> list[str]:
    """Names of schemes for these traits, as in the table of docs/schemes.md; the pilot begins with the first."""
    if not traits.has_gradient:
        return ["gauss_dkdkd"]
    names = ["stormer_verlet", "midpoint", "lobatto2_swapped"] if traits.separable else ["midpoint"]
    if traits.kicked:
        names += ["gauss_dkdkd", "chin4a"]
    elif traits.turned:
        names.append("gauss_dkdkd")
    elif traits.ndof <= 8:
        names += ["gauss2_strong32"]
    if traits.quadratic:
        names += ["gauss2"]
    return names


def _fits(problem: Problem, scheme: Scheme) -> bool:
    """Whether the library accepts this scheme for this model with these options."""
    try:
        problem.try_out(scheme)
    except SymsdeError:
        return False
    return True


def frequency(problem: Problem, paths: int = 0) -> float:
    """The largest frequency omega of the header, at a few times along the way; at least 1/horizon.

    paths: number of paths with noise that are examined too; fewer, 8 at least, of more than 64 degrees of freedom.
    """
    declared = problem.model.traits.max_frequency
    if not problem.model.traits.has_gradient:
        if not declared:
            raise IncompatibleError(
                f"model {problem.model.name} gives flows of two parts of H (drift, kick) alone, and the longest step "
                "is found by Hessians: declare max_frequency, give a gradient beside the flows, or choose the steps "
                "yourself, in symsde.convergence, symsde.moments or, as steps, in symsde.mlmc"
            )
        return max(declared, 1 / problem.horizon)
    paths = min(paths, max(8, _STATES // problem.model.ndof))
    ways = [*_way(problem), *(_ways(problem, paths) if paths and problem.model.nnoise else ())]
    return max(_fastest(problem, ways), declared, 1 / problem.horizon)


def mild_steps(problem: Problem) -> int:
    """Number of steps to the horizon with which multiplicative noise keeps an implicit step regular.

    I - dW J H''/2 is singular if dW times a frequency of the noise is 2, and near that the variance is infinite.
    Increments of six standard deviations stay below this limit if 3 omega sqrt(h) <= 1.
    """
    noises = problem.model.nnoise if problem.model.traits.has_gradient else 0  # flows alone are explicit
    omega = _fastest(problem, [*_way(problem)], np.minimum(np.arange(noises + 1.0), 1.0)) if noises else 0.0
    return max(1, math.ceil(9 * omega**2 * problem.horizon))


def _fastest(problem: Problem, ways: Iterable, w: np.ndarray | None = None) -> float:
    """The largest frequency of sum_j w_j H_j along paths that give (t, q, p), with q and p (dof, path).

    w (noise + 1,) are the weights; None means H alone.
    """
    found = [_steepest(*(np.moveaxis(x, 2, 0) for x in problem.model.hessian(q, p, w, t))) for t, q, p in ways]
    qq, qp, pp = _steepest(*(np.concatenate(blocks) for blocks in zip(*found, strict=True)))
    if not qp.any():
        try:
            root = np.linalg.cholesky(pp)
        except np.linalg.LinAlgError:  # pp is not positive definite
            pass
        else:
            squares = np.linalg.eigvalsh(root.transpose(0, 2, 1) @ qq @ root)
            return float(np.sqrt(np.abs(squares).max(initial=0.0)))
    flow = np.block([[qp, pp], [-qq, -qp.transpose(0, 2, 1)]])
    return float(np.abs(np.linalg.eigvals(flow)).max(initial=0.0))


def _steepest(qq: np.ndarray, qp: np.ndarray, pp: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The finite Hessians (point, dof, dof); of many degrees of freedom the one whose J H'' makes a vector grow most,
    since products with a vector cost far less than eigenvalues.
    """
    finite = np.logical_and.reduce([np.isfinite(x).all(axis=(1, 2)) for x in (qq, qp, pp)])
    qq, qp, pp = qq[finite], qp[finite], pp[finite]
    if qq.shape[1] <= _FEW or len(qq) < 2:
        return qq, qp, pp
    q, p = np.random.default_rng(1).normal(size=(2, len(qq), qq.shape[1], 1))
    grown = np.zeros(len(qq))
    for i in range(2 * _PRODUCTS):
        q, p = qp @ q + pp @ p, -(qq @ q) - qp.transpose(0, 2, 1) @ p
        size = np.sqrt((q**2 + p**2).sum(axis=(1, 2), keepdims=True)) + np.finfo(float).tiny
        q, p, grown = q / size, p / size, grown + (np.log(size[:, 0, 0]) if i >= _PRODUCTS else 0)
    most = grown.argmax()
    return qq[[most]], qp[[most]], pp[[most]]


def fewest_steps(problem: Problem) -> int:
    """The fewest steps to the horizon with which every scheme is tried: T omega/SHARPEST."""
    if "fewest steps" not in problem.known:
        problem.known["fewest steps"] = max(1, math.ceil(problem.horizon * frequency(problem) / SHARPEST))
    return problem.known["fewest steps"]


def _ways(problem: Problem, paths: int):
    """Give (t, q, p) along paths with noise at later times; paths that fail are left out."""
    rows = max(8 * (_POINTS - 1), fewest_steps(problem))
    rows += -rows % (_POINTS - 1)
    try:
        run = problem.run("midpoint", rows, paths=paths, save_every=rows // (_POINTS - 1), **_PLAIN)
    except SymsdeError:
        return
    kept = run.status == 0
    for t, q, p in zip(run.t[1:], run.q[1:], run.p[1:], strict=True):
        if kept.any():
            yield t, q[:, kept], p[:, kept]


def _way(problem: Problem):
    """Give (t, q, p) along the path without noise, from 64 steps of midpoint; only the initial state if these fail."""
    yield problem.options.get("t0", 0.0), problem.q0, problem.p0
    rows = 8 * (_POINTS - 1)
    try:
        increments = np.zeros((rows, problem.model.nnoise))
        run = problem.run("midpoint", rows, increments=increments, paths=1, save_every=8, **_PLAIN)
    except SymsdeError:
        return
    for t, q, p in zip(run.t[1:], run.q[1:], run.p[1:], strict=True):
        if np.isfinite(q).all() and np.isfinite(p).all():
            yield t, q, p
