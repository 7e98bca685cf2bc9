# SPDX-License-Identifier: BSD-3-Clause
"""Partial statistics: results of observers for some paths, in arrays that the library fills, merges and reads."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ...show.values import Values
from ..setup import Setup
from .requests import Observer

Kinds = Mapping[str, Observer]


@dataclass
class PartialStatistics:
    """Integers and sums of one observer, as in symsde_observer of symsde.h."""

    counts: np.ndarray
    sums: np.ndarray
    answers: int  #: count of numbers in the observer's answer

    def copy(self) -> PartialStatistics:
        """A copy with its own arrays."""
        return PartialStatistics(self.counts.copy(), self.sums.copy(), self.answers)


@dataclass(frozen=True)
class Scope:
    """The run that is observed: its setup, and the names of its values."""

    setup: Setup
    values: Values

    def call(self, name: str, *arguments) -> None:
        """Call a function of the C interface that begins with model, options and observables."""
        self.setup.model.call(name, ctypes.byref(self.setup.options), len(self.values.observables), *arguments)

    def room(self, observer: Observer) -> PartialStatistics:
        """Allocate arrays for the results of an observer; a request that cannot be observed is refused."""
        sizes = np.zeros(3, np.int64)
        self.call("observer_sizes", ctypes.byref(observer.struct(self.values)), sizes.ctypes.data)
        return PartialStatistics(np.zeros(sizes[0], np.int64), np.zeros(sizes[1]), int(sizes[2]))


def structs(scope: Scope, observers: Kinds, kept: Mapping[str, PartialStatistics]):
    """The observers in the form of symsde_moments: an array of addresses, and objects that must live as long."""
    made = [observer.struct(scope.values, kept[name].counts, kept[name].sums) for name, observer in observers.items()]
    addresses = (ctypes.c_void_p * len(made))(*(ctypes.addressof(struct) for struct in made))
    return addresses, made


def merge(scope: Scope, observer: Observer, left: PartialStatistics, right: PartialStatistics) -> None:
    """Merge two siblings into the left one."""
    both = [observer.struct(scope.values, part.counts, part.sums) for part in (left, right)]
    scope.call("observer_merge", *(ctypes.byref(struct) for struct in both))


def read(scope: Scope, observer: Observer, kept: PartialStatistics) -> tuple[np.ndarray, np.ndarray]:
    """The answer of an observer, and its standard errors."""
    values, errors = np.empty(kept.answers), np.empty(kept.answers)
    struct = observer.struct(scope.values, kept.counts, kept.sums)
    scope.call("observer_answer", ctypes.byref(struct), values.ctypes.data, errors.ctypes.data)
    return values, errors
