# SPDX-License-Identifier: BSD-3-Clause
"""Partial statistics: results of observers for some paths, in arrays that the library fills, merges and reads."""

from __future__ import annotations

import ctypes
import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ...show.values import Values
from ..groups import Groups
from ..setup import Setup
from .requests import Observer

Kinds = Mapping[str, Observer]


@dataclass
class PartialStatistics:
    """Integers and sums of one observer, as in symsde_observer of symsde.h."""

    counts: np.ndarray
    sums: np.ndarray
    answers: int  #: count of numbers in the observer's answer
    groups: ClassVar[np.ndarray | None] = None

    def copy(self) -> PartialStatistics:
        """A copy with its own arrays."""
        return dataclasses.replace(self, counts=self.counts.copy(), sums=self.sums.copy())


@dataclass
class GroupStatistics(PartialStatistics):
    """Integers and sums of one observer for groups of paths, one group after the other."""

    groups: np.ndarray  #: (group,), numbers of the groups, ascending

    def rows(self) -> list[PartialStatistics]:
        """The statistics of each group."""
        n = len(self.groups)
        both = zip(self.counts.reshape(n, -1), self.sums.reshape(n, -1), strict=True)
        return [PartialStatistics(counts, sums, self.answers // n) for counts, sums in both]


@dataclass(frozen=True)
class Scope:
    """The run that is observed: its setup, and the names of its values."""

    setup: Setup
    values: Values
    groups: Groups | None = None  #: groups of paths, each with statistics of its own

    def call(self, name: str, *arguments) -> None:
        """Call a function of the C interface that begins with model, options and observables."""
        self.setup.model.call(name, ctypes.byref(self.setup.options), len(self.values.observables), *arguments)

    def room(self, observer: Observer) -> PartialStatistics:
        """Allocate arrays for the results of an observer; a request that cannot be observed is refused."""
        sizes, numbers = np.zeros(3, np.int64), None if self.groups is None else self.groups.numbers
        struct = observer.struct(self.values)
        struct.ngroup = 0 if numbers is None else len(numbers)
        self.call("observer_sizes", ctypes.byref(struct), sizes.ctypes.data)
        arrays = np.zeros(sizes[0], np.int64), np.zeros(sizes[1]), int(sizes[2])
        return PartialStatistics(*arrays) if numbers is None else GroupStatistics(*arrays, numbers)


def structs(scope: Scope, observers: Kinds, kept: Mapping[str, PartialStatistics]):
    """The observers in the form of symsde_moments: an array of addresses, and objects that must live as long."""
    made = [observer.struct(scope.values, kept[name].counts, kept[name].sums) for name, observer in observers.items()]
    labels = None if scope.groups is None else scope.groups.places()
    for struct in made if labels is not None else ():
        struct.ngroup, struct.labels = len(scope.groups.numbers), labels.ctypes.data
    addresses = (ctypes.c_void_p * len(made))(*(ctypes.addressof(struct) for struct in made))
    return addresses, (made, labels)


def merge(scope: Scope, observer: Observer, left: PartialStatistics, right: PartialStatistics) -> None:
    """Merge two siblings into the left one, group by group."""
    if left.groups is None or np.array_equal(left.groups, right.groups):
        _merge(scope, observer, left, right)
        return
    numbers, size = np.union1d(left.groups, right.groups), len(left.groups)
    whole = [np.empty((len(numbers), x.size // size), x.dtype) for x in (left.counts, left.sums)]
    for part in (left, right):
        for to, x in zip(whole, (part.counts, part.sums), strict=True):
            to[np.searchsorted(numbers, part.groups)] = x.reshape(len(part.groups), -1)
    twice, *places = np.intersect1d(left.groups, right.groups, return_indices=True)
    if twice.size:
        mine, other = (
            GroupStatistics(*(x.reshape(len(part.groups), -1)[at].ravel() for x in (part.counts, part.sums)), 0, twice)
            for part, at in zip((left, right), places, strict=True)
        )
        _merge(scope, observer, mine, other)
        for to, x in zip(whole, (mine.counts, mine.sums), strict=True):
            to[np.searchsorted(numbers, twice)] = x.reshape(len(twice), -1)
    left.answers = left.answers // size * len(numbers)
    left.counts, left.sums, left.groups = (*(x.ravel() for x in whole), numbers)


def _merge(scope: Scope, observer: Observer, left: PartialStatistics, right: PartialStatistics) -> None:
    both = [observer.struct(scope.values, part.counts, part.sums) for part in (left, right)]
    for struct in both:
        struct.ngroup = 0 if left.groups is None else len(left.groups)
    scope.call("observer_merge", *(ctypes.byref(struct) for struct in both))


def read(scope: Scope, observer: Observer, kept: PartialStatistics) -> tuple[np.ndarray, np.ndarray]:
    """The answer of an observer, and its standard errors."""
    values, errors = np.empty(kept.answers), np.empty(kept.answers)
    struct = observer.struct(scope.values, kept.counts, kept.sums)
    scope.call("observer_answer", ctypes.byref(struct), values.ctypes.data, errors.ctypes.data)
    return values, errors
