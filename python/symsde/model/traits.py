# SPDX-License-Identifier: BSD-3-Clause
"""Traits: what a model declares about its Hamiltonians, as users give and read it, and as the library sees it."""

from __future__ import annotations

import ctypes
import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import InvalidArgumentError, WrongShapeError, WrongTypeError
from ..native import abi, checks, handles
from .split import KICKS, Split

#: traits that are true or false; each names a property of the Hamiltonians
FLAGS = ("separable", "additive", "position_noise", "quadratic", "identity_mass", "constant_mass", "diagonal_mass")
_KNOWN = ("has_value", "has_hessian", "has_hessian_vector", "has_gradient", "has_parts")


@dataclass(frozen=True)
class Traits:
    """Properties that a model declares of its Hamiltonians H_0 = H, H_1 .. H_m; they decide what is skipped."""

    ndof: int  #: degrees of freedom
    nnoise: int  #: number m of noises
    separable: bool  #: every H_j = T_j(p) + U_j(q)
    additive: bool  #: every H_k, k >= 1, is linear in (q, p)
    position_noise: bool  #: every H_k, k >= 1, depends on q alone
    quadratic: bool  #: every H_j is a polynomial of degree two at most
    identity_mass: bool  #: H = p.p/2 + U(q)
    constant_mass: bool  #: H = p.M^-1 p/2 + U(q) with a constant matrix M
    diagonal_mass: bool  #: this matrix is diagonal
    bandwidth: int | None  #: bandwidth of every block of the Hessian; None = dense
    max_frequency: float  #: bound of the frequencies of H; 0 = not declared
    noise_lipschitz: float  #: Lipschitz constant of the noise; 0 = not declared
    #: frequencies omega_i of the stiff linear part, H = p.p/2 + sum_i omega_i^2 q_i^2/2 + V(q); None = not declared
    rotation: tuple[float, ...] | None
    silent: tuple[int, ...]  #: noises k whose H_k is zero: nothing is drawn for them
    #: for each noise the degrees of freedom i = 1 .. ndof of which q_i or p_i occur in H_k; None = not declared
    touches: tuple[tuple[int, ...], ...] | None
    split: Split | None  #: second derivatives of a quadratic part of H by (q, p), rows; None = not declared
    #: beside a split what remains of H, and every H_k, depend on "positions" or on "actions", of which H_k is a linear
    #: function where it says "phases"
    kicks: str
    has_value: bool  #: the Hamiltonians can be evaluated
    has_hessian: bool  #: Hessians are analytic
    has_hessian_vector: bool  #: products of Hessian and vector are analytic
    has_gradient: bool  #: gradients can be evaluated; without them there are drift and kick alone
    has_parts: bool  #: drift and kick are there, exact flows of two parts of H

    @property
    def kicked(self) -> bool:
        """Whether the noise depends on position, and the mass is constant or a quadratic part of H holds the momenta,
        as schemes of drifts and kicks need."""
        drifts = self.identity_mass or self.constant_mass or (self.split is not None and not self.turned)
        return self.position_noise and drifts

    @property
    def turned(self) -> bool:
        """Whether kicks beside a quadratic part are functions of the actions, which turn planes (q_k, p_k)."""
        return self.split is not None and self.kicks != KICKS[0]

    @property
    def phased(self) -> bool:
        """Whether noises beside these are linear in the actions, so that products of kicks are bonds of the split."""
        return self.turned and (self.kicks == "phases" or self.nnoise == 0)

    @property
    def acting(self) -> list[int]:
        """Numbers k of the noises that are not silent."""
        return [k for k in range(1, self.nnoise + 1) if k not in self.silent]


def declared(*, ndof, nnoise, bandwidth, max_frequency, noise_lipschitz, rotation, silent, touches, **flags):
    """Traits for the library, a `abi.Traits`, from the arguments of `Model`."""
    traits = handles.new(abi.Traits, "traits")
    traits.ndof = checks.integer("ndof", ndof, checks.INT32)
    traits.nnoise = checks.integer("nnoise", nnoise, checks.INT32)
    traits.bandwidth = -1 if bandwidth is None else checks.integer("bandwidth", bandwidth, checks.INT32)
    traits.max_frequency = checks.number("max_frequency", max_frequency)
    traits.noise_lipschitz = checks.number("noise_lipschitz", noise_lipschitz)
    traits.rotation = _frequencies(rotation, traits.ndof)
    traits.silent = _silent(silent, traits.nnoise)
    traits.touches_from, traits.touches = _supports(touches, traits.nnoise, traits.ndof)
    for trait, given in flags.items():
        setattr(traits, trait, checks.flag(trait, given))
    return traits


def of_library(given: abi.Traits, split: Split | None, kicks: str) -> Traits:
    """What the library says of a model, whose quadratic part is known here alone."""
    flags = {name: bool(getattr(given, name)) for name in (*FLAGS, *_KNOWN)}
    return Traits(
        ndof=given.ndof,
        nnoise=given.nnoise,
        bandwidth=None if given.bandwidth < 0 else given.bandwidth,
        max_frequency=given.max_frequency,
        noise_lipschitz=given.noise_lipschitz,
        rotation=tuple(given.rotation[: given.ndof]) if given.rotation else None,
        silent=tuple(k + 1 for k in range(given.nnoise) if given.silent and given.silent[k]),
        touches=_lists_of(given),
        split=split,
        kicks=kicks,
        **flags,
    )


def arguments(traits: abi.Traits) -> dict[str, Any]:
    """Declared traits as arguments of `Model`."""
    given = {name: bool(getattr(traits, name)) for name in FLAGS}
    given |= {name: getattr(traits, name) for name in ("ndof", "nnoise", "max_frequency", "noise_lipschitz")}
    given["bandwidth"] = None if traits.bandwidth < 0 else traits.bandwidth
    given["rotation"] = list(traits.rotation[: traits.ndof]) if traits.rotation else None
    given["silent"] = [k + 1 for k in range(traits.nnoise) if traits.silent and traits.silent[k]]
    given["touches"] = _lists_of(traits)
    return given


def _frequencies(rotation, ndof: int):
    """One frequency for each degree of freedom as a C array, or None."""
    if rotation is None:
        return None
    values = checks.real_array("rotation", rotation)
    if values.shape != (ndof,):
        raise WrongShapeError(f"rotation has shape {values.shape}: give ({ndof},), one frequency for each q_i")
    return (ctypes.c_double * ndof)(*values)


def _silent(silent, nnoise: int):
    """Numbers k = 1 .. nnoise of noises as one flag for each in C, or None."""
    several = checks.items(silent)
    if several is None:
        raise WrongTypeError(f"silent = {checks.shown(silent)} is no list: give numbers of noises, as in [1, 3]")
    chosen = [checks.integer("silent", k) for k in several]
    for k in chosen:
        if not 1 <= k <= nnoise:
            raise InvalidArgumentError(f"silent holds {k}: the noises are 1 to {nnoise}")
    return (ctypes.c_int32 * nnoise)(*(k + 1 in chosen for k in range(nnoise))) if chosen else None


def _supports(touches, nnoise: int, ndof: int):
    """Lists of degrees of freedom 1 .. ndof, one for each noise, as two C arrays; None, None without them."""
    if touches is None:
        return None, None
    several = checks.items(touches)
    if several is not None and len(several) != nnoise:
        raise WrongShapeError(f"touches has {len(several)} lists: give {nnoise}, one for each noise")
    for x in several or ():
        if (count := len(x) if isinstance(x, Sequence) else getattr(x, "size", 0)) > ndof:
            raise WrongShapeError(f"touches has a list of {count} numbers: name each of {ndof} degrees of freedom once")
    lists = [None] if several is None else [checks.items(x) for x in several]
    if None in lists:
        raise WrongTypeError(
            f"touches = {checks.shown(touches)} is no list of lists: give for each noise the numbers of the degrees of "
            "freedom that it touches, as in [[1], [2]]"
        )
    lists = [[checks.integer("touches", i) for i in several] for several in lists]
    for i in (i for several in lists for i in several):
        if not 1 <= i <= ndof:
            raise InvalidArgumentError(f"touches holds {i}: the degrees of freedom are 1 to {ndof}")
    places = np.cumsum([0, *map(len, lists)])
    return (ctypes.c_int32 * (nnoise + 1))(*places), (ctypes.c_int32 * max(1, places[-1]))(*itertools.chain(*lists))


def _lists_of(traits: abi.Traits) -> tuple[tuple[int, ...], ...] | None:
    """What each noise touches, from the C arrays."""
    if not traits.touches_from:
        return None
    places = traits.touches_from[: traits.nnoise + 1]
    every = traits.touches[: places[-1]] if places[-1] else []
    return tuple(tuple(every[a:b]) for a, b in itertools.pairwise(places))
