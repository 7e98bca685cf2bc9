# SPDX-License-Identifier: BSD-3-Clause
"""Merge moments of parts of an ensemble on the library's tree: the order of merging does not change the bits."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ..native import handles
from ..native.checks import address
from ..run.observers.partial_statistics import PartialStatistics


@dataclass
class Node:
    """Counts, means and sums of squared deviations of the paths of one part."""

    n_ok: np.ndarray  #: (time,)
    mean: np.ndarray  #: (time, value)
    m2: np.ndarray  #: (time, value)
    kept: dict[str, PartialStatistics] = field(default_factory=dict)  #: sums and counts of observers, by name


MergeKept = Callable[[str, PartialStatistics, PartialStatistics], None]


class Tree:
    """Parts whose siblings have not arrived yet: as many as the levels of the tree, if parts arrive in order."""

    def __init__(self, merge_kept: MergeKept | None = None) -> None:
        """Start without parts. merge_kept: a function of the name and two parts that merges results of observers."""
        self._waiting: dict[tuple[int, int], Node] = {}
        self._merge_kept = merge_kept

    def insert(self, level: int, index: int, node: Node) -> None:
        """Insert the part of the paths index*2^level .. (index + 1)*2^level - 1; its arrays are overwritten."""
        while (sibling := self._waiting.pop((level, index ^ 1), None)) is not None:
            left, right = (node, sibling) if index % 2 == 0 else (sibling, node)
            _merge(left, right)
            for name, part in left.kept.items():
                self._merge_kept(name, part, right.kept[name])
            level, index, node = level + 1, index // 2, left
        self._waiting[level, index] = node

    def root(self) -> Node:
        """Merge all parts; a part without a sibling becomes its parent unchanged. The tree is empty
        afterwards."""
        while len(self._waiting) > 1:
            level, index = min(self._waiting)
            self.insert(level + 1, index // 2, self._waiting.pop((level, index)))
        return self._waiting.popitem()[1]


def _merge(left: Node, right: Node) -> None:
    """Merge two siblings into the left one."""
    ntime, nvalue = left.mean.shape
    arrays = (address(getattr(part, name)) for part in (left, right) for name in ("n_ok", "mean", "m2"))
    handles.call("merge_moments", ntime, nvalue, *arrays)
