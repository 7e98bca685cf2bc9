# SPDX-License-Identifier: BSD-3-Clause
"""Schemes that an expectation may be computed with, and the weak order that may be counted on."""

from __future__ import annotations

from collections.abc import Iterable

from ...errors import SymsdeError
from ...model.commutator import commutator
from ...model.definition import Model, Traits
from ...schemes import Scheme, as_scheme
from .problem import Problem


def suitable(problem: Problem) -> list[Scheme]:
    """The schemes that are worth trying for this model."""
    return fitting(problem, _names(problem.model.traits))


def fitting(problem: Problem, names: Iterable[str]) -> list[Scheme]:
    """Those of the named schemes that the library accepts for this model and these options; each is set up once."""
    return [scheme for scheme in map(as_scheme, names) if _fits(problem, scheme)]


def best_coupled(problem: Problem) -> Scheme:
    """The scheme of multilevel Monte Carlo: gauss_dkdkd if it suits the model, else midpoint."""
    known = [scheme for scheme in suitable(problem) if scheme.name == "gauss_dkdkd"]
    return known[0] if known else as_scheme("midpoint")


def weak_order(problem: Problem, scheme: Scheme) -> float:
    """The weak order of the certificate; no more than 1 is counted on where noises do not commute."""
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
    """Whether the noises commute at time t, as far as traits and sample points tell."""
    traits = model.traits
    if model.nnoise < 2 or traits.additive or traits.position_noise:
        return True
    return commutator(model, t=t).commutative


def _names(traits: Traits) -> list[str]:
    """Names of schemes for these traits, as in the table of docs/schemes.md; the pilot begins with the first."""
    names = ["stormer_verlet", "midpoint", "lobatto2_swapped"] if traits.separable else ["midpoint"]
    if traits.kicked:
        names += ["gauss_dkdkd", "chin4a"]
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
