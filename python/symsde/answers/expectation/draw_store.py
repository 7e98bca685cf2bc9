# SPDX-License-Identifier: BSD-3-Clause
"""Stores for the draws of an answer: none, or a folder of shards, from which the work can be resumed.

A folder holds the choice of the pilot, and parts of the draws by the indices of their units. The size of a part follows
from earlier parts alone, including their seconds. So every process that reads the folder needs the same parts in the
same order, whether it runs later or at the same time; and processes that share the folder can draw ahead for each
other.
"""

from __future__ import annotations

import contextlib
import time
import uuid
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from ...batch import computed, manifest, numerics
from ...batch.folder import RunFolder
from ...batch.pieces import UNIT, Piece
from ...batch.shard_file import Shard
from ...errors import SceneError
from ...native import files
from ...run import provenance
from ...schemes import Scheme
from ..coupled import Draw
from .answer import Answer
from .choice import METHODS, Plan
from .estimators import Drawn
from .interval import Tally, Tolerance
from .problem import Problem
from .watch import Watch

_ELSEWHERE = 0.2  #: seconds between checks for the work of other processes
_AHEAD = 64  #: parts that may be drawn ahead of need while other processes draw the parts needed now
_PARTS = 64  #: the work is divided into about this many parts
LEAST = 2  #: units that an interval needs; they are drawn even if the time is over
_SHORTEST, _LONGEST = 0.5, 10.0  #: seconds of the shortest and of the longest part
CHOICE = Piece("choice", "choice", 0, 0, 0)

Part = Drawn | Draw


@dataclass
class StoredPilot:
    """The parts of a pilot that the work needs."""

    problem: Problem
    tolerance: Tolerance
    watch: Watch
    looked_at: Drawn
    seconds: float


class Nowhere:
    """A store that keeps nothing: units are drawn when they are wanted, as far as the time allows."""

    seconds = 0.0  #: processor time of parts that other processes drew

    def __init__(self, watch: Watch):
        """Store the watch that computes how many units fit into the remaining time."""
        self._watch = watch

    def more(
        self, _name: str, drawn: Part, missing: int, usual: int, draw: Callable[[int, int], Part], *,
        exactly: bool = True,
    ) -> Part | None:  # fmt: skip
        """Draw the next missing units, `usual` at a time; None if no more fit into the time.

        The seconds of the units drawn so far predict how many fit. The two units that an interval needs are always
        drawn.
        """
        first, count, least = drawn.units.n + drawn.failed, min(usual, missing), LEAST - drawn.units.n
        if least <= 0:
            count = int(min(count, self._watch.room(drawn.seconds / first)))
        elif self._watch.over:
            count = min(count, least)
        if count < 1:
            self._watch.end()
            return None
        return draw(first, count)


class InFolder:
    """A store that keeps draws in a folder, and shares them with other processes that use the folder."""

    def __init__(self, folder: RunFolder, watch: Watch):
        """Store the folder, and the watch that ends the work in time."""
        self.folder, self._watch, self.seconds = folder, watch, 0.0
        self._name = uuid.uuid4().hex  # name in the parts of this work, whose seconds are counted already

    def more(
        self, name: str, drawn: Part, missing: int, usual: int, draw: Callable[[int, int], Part], *,
        exactly: bool = False,
    ) -> Part | None:  # fmt: skip
        """The next part of the missing units, read or drawn; the part may hold more units, unless `exactly` is true."""
        first = drawn.units.n + drawn.failed
        count = self.grain(usual, missing, drawn.seconds / first if first else -1.0)
        return self.part(name, first, min(count, missing) if exactly else count, missing, draw)

    def grain(self, usual: int, count: int, seconds: float) -> int:
        """Number of units of a part, given the number of all units and the seconds of one unit (negative: not known).

        A part takes long enough to be worth a file, but not so long that killing the process would lose much.
        """
        if seconds < 0:
            return usual
        wanted = min(max(count * seconds / _PARTS, _SHORTEST), _LONGEST) / max(seconds, 1e-9)
        return usual if wanted < usual else int(wanted) // usual * usual

    def part(self, name: str, first: int, count: int, ahead: int, draw: Callable[[int, int], Part]) -> Part | None:
        """The part that begins with the unit `first`. While another process draws it, later parts are drawn here."""
        begins = range(first, first + max(1, min(ahead // count, _AHEAD)) * count, count)
        pieces = [Piece(f"{name}-{begin:012d}-{count}", "draws", begin, count, count) for begin in begins]
        while True:
            if self.folder.is_done(pieces[0]):
                shard = self.folder.read(pieces[0])
                if shard.facts["by"] != self._name:
                    self.seconds += shard.facts["seconds"]
                return _part_of(shard)
            if self._watch.over and first >= LEAST:
                return None
            if not any(self._draw(piece, draw) for piece in pieces if not self.folder.is_done(piece)):
                time.sleep(_ELSEWHERE)

    def _draw(self, piece: Piece, draw: Callable[[int, int], Part]) -> bool:
        """Draw and write this part, unless another process works on it; return whether the part exists now."""
        if not self.folder.claim(piece):
            return False
        try:
            if not self.folder.is_done(piece):
                self.folder.write(piece, _shard_of(draw(piece.first, piece.paths), self._name))
        finally:
            self.folder.release(piece)
        return True

    def choice(self, pilot: Callable[[], tuple[Any, list[Plan]]]) -> None:
        """Wait until the folder has a choice; the first process to arrive makes it."""
        while not self.folder.is_done(CHOICE):
            if not self.folder.claim(CHOICE):
                time.sleep(_ELSEWHERE)
                continue
            try:
                if not self.folder.is_done(CHOICE):
                    self.folder.write(CHOICE, _shard_of_choice(*pilot(), self._name))
            finally:
                self.folder.release(CHOICE)

    def read_choice(
        self, problem: Problem, tolerance: Tolerance, schemes: dict[str, Scheme]
    ) -> tuple[StoredPilot, list[Plan]]:
        """The choice in the folder, made by this process or by another."""
        shard = self.folder.read(CHOICE)
        pilot = StoredPilot(problem, tolerance, self._watch, _part_of(shard), shard.facts["seconds"])
        plans = [_plan_of(facts, schemes) for facts in shard.facts["plans"]]
        return pilot, plans

    def save(self, answer: Answer) -> None:
        """Write the answer as answer.json."""
        content = {key: getattr(answer, key) for key in _ANSWERED} | {"made": provenance.made()}
        text = files.json_text(content, digits=None, indent=1)
        files.write_durably(self.folder.path / "answer.json", text.encode(), keep=False)


_PLANNED = tuple(x.name for x in fields(Plan) if x.name != "trial")
_ANSWERED = (
    "value", "interval", "error", "bias", "method", "scheme", "step", "paths", "cost", "pilot", "reached", "why",
    "notes",
)  # fmt: skip


@contextlib.contextmanager
def open_folder(
    path: Any, inputs: dict[str, Any], problem: Problem, schemes: Iterable[Scheme], watch: Watch
) -> Iterator[InFolder]:
    """Make or open the folder of these inputs, by one of the schemes; a folder of other inputs is refused."""
    found = numerics.of(problem.model, schemes, _start_of(problem), step=problem.horizon / 64, **problem.options)
    record = manifest.of_inputs(inputs, problem.seed, UNIT, found)
    with RunFolder.open_to_write(path, record, [], None) as folder:
        yield InFolder(folder, watch)


def inputs_of(problem: Problem, tolerance: Tolerance, scheme: Scheme | None, method: str | None) -> dict[str, Any]:
    """All inputs that an answer depends on; functions are represented by their values at a few points."""
    model, target = problem.model, problem.target
    asked = {
        "f": target.name,
        "abs": tolerance.absolute,
        "rel": tolerance.relative,
        "horizon": problem.horizon,
        "q0": problem.q0[:, 0].tolist(),
        "p0": problem.p0[:, 0].tolist(),
        **{name: law.told() for name, law in problem.laws.items()},
        "scheme": scheme and scheme.name,
        "method": method,
        **{key: value for key, value in problem.options.items() if key != "threads"},
    }
    return {"expect": asked, "computed": computed.of(model, scheme, _start_of(problem), {target.name: target})}


def _start_of(problem: Problem) -> computed.Start:
    return computed.Start(problem.q0, problem.p0, float(problem.options.get("t0", 0.0)), problem.horizon)


def _shard_of(part: Part, by: str) -> Shard:
    tallies = [part.units] if isinstance(part, Drawn) else [part.difference, part.fine, part.coarse]
    arrays = {"tallies": np.array([[x.n, x.mean, x.m2, x.m3, x.m4] for x in tallies])}
    facts = {"seconds": part.seconds, "failed": part.failed, "by": by}
    return Shard(arrays, facts | ({"computed": part.paths} if isinstance(part, Drawn) else {}))


def _part_of(shard: Shard) -> Part:
    tallies = [Tally(int(row[0]), *map(float, row[1:])) for row in shard.arrays["tallies"]]
    seconds, failed = shard.facts["seconds"], shard.facts["failed"]
    if len(tallies) == 1:
        return Drawn(tallies[0], seconds, failed, shard.facts["computed"])
    return Draw(*tallies, seconds, failed)


def _shard_of_choice(pilot: Any, plans: list[Plan], by: str) -> Shard:
    shard = _shard_of(pilot.looked_at, by)
    kept = [{key: getattr(plan, key) for key in _PLANNED} | {"scheme": plan.scheme.name} for plan in plans]
    return Shard(shard.arrays, {**shard.facts, "seconds": pilot.seconds, "plans": kept})


def _plan_of(facts: dict[str, Any], schemes: dict[str, Scheme]) -> Plan:
    """The plan that a folder keeps; SceneError if another version of symsde made it, naming what this version lacks."""
    if facts["method"] not in METHODS or set(facts) != set(_PLANNED):
        raise SceneError(
            f"the folder holds work by {facts['method']}, planned by an earlier version of symsde: give an empty folder"
        )
    return Plan(**{**facts, "scheme": schemes[facts["scheme"]], "bias": tuple(facts["bias"])})
