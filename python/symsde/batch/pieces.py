# SPDX-License-Identifier: BSD-3-Clause
"""Cut a run into pieces. The pieces depend only on the size of the run, so all processes compute the same pieces."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from ..errors import InvalidArgumentError
from ..native.checks import integer

UNIT = 256  #: number of paths of a unit: a piece of moments has 2^k units and begins at a multiple of its size
_LEAST, _MOST = 2**27, 2**29  # path-steps times degrees of freedom of a piece: seconds, to which its file adds little
_PIECES = 32  # number of pieces, if each is large enough for a file, so that a few processes are busy until the end
FILES = 2**14  #: most files that a folder should hold
_SAVED = 2**26  # most bytes of paths in a piece


@dataclass(frozen=True)
class Piece:
    """Consecutive paths, with the kind of results wanted."""

    name: str  #: name of the shard, without ending
    kind: str  #: "moments" or "paths"
    first: int  #: global index of the first path
    paths: int
    work: int  #: number of path-steps


@dataclass(frozen=True)
class Extent:
    """The size of a run, as needed for cutting it."""

    first: int  #: global index of the first path
    paths: int
    steps: int
    saved: int  #: number of saved times
    ndof: int


def shard_paths(extent: Extent, wanted: object = None) -> int:
    """Number of paths of a shard: the wanted number, or a number large enough for a file; a power of two of units."""
    if wanted is not None:
        return _checked(wanted)
    cost = max(1, extent.steps * extent.ndof)
    total = cost * extent.paths
    target = min(max(total // _PIECES, _LEAST), _MOST)
    size = UNIT
    while size < extent.paths and (2 * size * cost <= target or extent.paths > FILES * size):
        size *= 2
    return size


def is_size(size: object) -> bool:
    """Whether a shard may have this many paths: a unit times a power of two."""
    return isinstance(size, int) and size >= UNIT and size & (size - 1) == 0


def _checked(wanted: object) -> int:
    size = integer("shard-paths", wanted, (UNIT, 2**40))
    if not is_size(size):
        below = 1 << (size.bit_length() - 1)
        raise InvalidArgumentError(
            f"shard-paths = {size} is not a power of two, as the tree of moments needs: give {below} or {2 * below}"
        )
    return size


def plan(extent: Extent, size: int, *, moments: bool, saved: Sequence[int]) -> list[Piece]:
    """The pieces of a run: moments of all its paths, and the paths to save, in ascending order."""
    pieces = []
    if moments:
        cuts = _stretches(range(extent.first, extent.first + extent.paths), size)
        pieces += [("moments", first, count) for first, count in cuts]
    each = 16 * extent.saved * extent.ndof
    pieces += [("paths", first, count) for first, count in _stretches(saved, size, max(1, _SAVED // each))]
    numbers: dict[str, int] = {}
    result = []
    for kind, first, count in pieces:
        number = numbers[kind] = numbers.get(kind, 0) + 1
        result.append(Piece(f"{kind}-{number:06d}", kind, first, count, count * extent.steps))
    return result


def _stretches(indices: Sequence[int], size: int, most: int = 2**62) -> Iterator[tuple[int, int]]:
    """Give (first, count) of consecutive indices within the same interval of `size`, at most `most` at a time."""
    if isinstance(indices, range) and most >= size:  # a range needs no loop over its indices
        first, end = indices.start, indices.stop
        while first < end:
            stop = min(end, (first // size + 1) * size)
            yield first, stop - first
            first = stop
        return
    start = count = 0
    for i in indices:
        if count and i == start + count and i % size and count < most:
            count += 1
            continue
        if count:
            yield start, count
        start, count = i, 1
    if count:
        yield start, count
