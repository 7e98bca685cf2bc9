# SPDX-License-Identifier: BSD-3-Clause
"""Divide pieces: --shard i/n, or an MPI rank, takes every n-th piece from the i-th on."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from ..errors import InvalidArgumentError
from .pieces import Piece


@dataclass(frozen=True)
class Share:
    """Part i of n, counted from 1."""

    i: int = 1
    n: int = 1

    def of(self, pieces: Sequence[Piece]) -> list[Piece]:
        """The pieces of this part."""
        return list(pieces[self.i - 1 :: self.n])

    def __str__(self) -> str:
        """The share in the form of the command line."""
        return f"{self.i}/{self.n}"


def parse(text: str) -> Share:
    """Read a share from the text i/n."""
    match = re.fullmatch(r"\s*(\d{1,9})\s*/\s*(\d{1,9})\s*", text)
    if not match:
        raise InvalidArgumentError(f"shard = {text!r} is no part of a run: give i/n, as 1/8 for the first of eight")
    i, n = int(match[1]), int(match[2])
    if not 1 <= i <= n:
        raise InvalidArgumentError(
            f"shard = {text}: there is no part {i} of {n}: give i from 1 to n, as 1/{max(n, 1)} for the first"
        )
    return Share(i, n)


def parts_of(missing: Sequence[Piece], pieces: Sequence[Piece]) -> list[Share]:
    """The shares i/n, fewer than n, whose pieces are exactly the missing ones, with the smallest n > 1; empty if
    there are none."""
    names = {piece.name for piece in missing}
    for n in range(2, len(pieces) // 2 + 1):
        touched = [Share(i, n) for i in range(1, n + 1) if names & {piece.name for piece in pieces[i - 1 :: n]}]
        if len(touched) < n and sum(len(share.of(pieces)) for share in touched) == len(names):
            return touched
    return []
