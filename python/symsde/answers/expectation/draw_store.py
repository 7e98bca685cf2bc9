# SPDX-License-Identifier: BSD-3-Clause
"""Where the draws of an answer are kept: nowhere, or as shards in a folder, from which the work goes on.

A folder holds the choice that the pilot made, and parts of the draws by the indices of their units. How many there are
to be follows from what earlier parts hold, their seconds too: so whoever finds the shards takes the same way through
them, in a later process, or beside others that draw what this one will want next.
"""

from __future__ import annotations

import contextlib
import time
import uuid
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...batch import computed, manifest
from ...batch.folder import RunFolder
from ...batch.pieces import UNIT, Piece
from ...batch.shard_file import Shard
from ...native import durable, files
from ...run import provenance
from ...schemes import Scheme
from ..coupled import Draw
from .answer import Answer
from .choice import Plan, estimator_of, even_level_of
from .estimators import Drawn, Estimator
from .problem import Problem
from .quasi import Quasi
from .tally import Tally
from .tolerance import Tolerance
from .watch import Watch

_ELSEWHERE = 0.2  #: seconds between looks at what other processes do
_AHEAD = 64  #: parts that may be drawn before they are wanted, while others draw those
_PARTS = 64  #: of the work, as many as that
LEAST = 2  #: units that an interval takes, drawn whatever the time
_SHORTEST, _LONGEST = 0.5, 10.0  #: seconds of a part
CHOICE = Piece("choice", "choice", 0, 0, 0)

Part = Drawn | Draw


@dataclass
class StoredPlan:
    """A plan as a folder keeps it."""

    method: str
    scheme: Scheme
    steps: int
    coarsest_steps: int
    seconds: float
    variance: float
    bias: tuple[float, float]
    options: dict = field(default_factory=dict)

    def estimator(self, first: int, problem: Problem) -> Estimator:
        """What draws it, from a path on."""
        return estimator_of(self.method, problem, self.scheme, self.steps, first=first, options=self.options)

    def even_level(self, index: int, first: int, problem: Problem) -> Quasi:
        """What draws a level of multilevel quasi-Monte Carlo."""
        return even_level_of(problem, self.scheme, self.coarsest_steps, index, first=first, options=self.options)


@dataclass
class StoredPilot:
    """What work takes of a pilot."""

    problem: Problem
    tolerance: Tolerance
    watch: Watch
    looked_at: Drawn
    seconds: float


class Nowhere:
    """Draws are made when they are wanted, as far as the time goes, and not kept."""

    seconds = 0.0  #: of the processor, of parts that other processes drew

    def __init__(self, watch: Watch):
        """The watch tells how many units fit into what is left."""
        self._watch = watch

    def more(
        self, _name: str, drawn: Part, missing: int, usual: int, draw: Callable[[int, int], Part], *,
        exactly: bool = True,
    ) -> Part | None:  # fmt: skip
        """The next of the units that are missing, `usual` at a time; None where the time is over, by what those took.
        As few as an interval takes are drawn whatever the time."""
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
    """Draws are kept, and shared with other processes in the same folder."""

    def __init__(self, folder: RunFolder, watch: Watch):
        """Parts that are there are read, others are drawn until the time is over."""
        self.folder, self._watch, self.seconds = folder, watch, 0.0
        self._name = uuid.uuid4().hex  # of this work: its own parts are in its own seconds

    def more(
        self, name: str, drawn: Part, missing: int, usual: int, draw: Callable[[int, int], Part], *,
        exactly: bool = False,
    ) -> Part | None:  # fmt: skip
        """The next of the units that are missing; a part may hold more than these, unless exactly these are wanted."""
        first = drawn.units.n + drawn.failed
        count = self.grain(usual, missing, drawn.seconds / first if first else -1.0)
        return self.part(name, first, min(count, missing) if exactly else count, missing, draw)

    def grain(self, usual: int, count: int, seconds: float) -> int:
        """Units that take long enough for a file, and not longer than a kill should cost."""
        if seconds < 0:
            return usual
        wanted = min(max(count * seconds / _PARTS, _SHORTEST), _LONGEST) / max(seconds, 1e-9)
        return usual if wanted < usual else int(wanted) // usual * usual

    def part(self, name: str, first: int, count: int, ahead: int, draw: Callable[[int, int], Part]) -> Part | None:
        """Of the folder; while another process draws it, later ones are drawn here."""
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
        """Whether nobody else had it, so that it is there now."""
        if not self.folder.claim(piece):
            return False
        try:
            if not self.folder.is_done(piece):
                self.folder.write(piece, _shard_of(draw(piece.first, piece.paths), self._name))
        finally:
            self.folder.release(piece)
        return True

    def choice(self, pilot: Callable[[], tuple[Any, list[Plan]]]) -> None:
        """Let there be a choice: that of the first process that comes."""
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
    ) -> tuple[StoredPilot, list[StoredPlan]]:
        """What was chosen, whoever did so."""
        shard = self.folder.read(CHOICE)
        pilot = StoredPilot(problem, tolerance, self._watch, _part_of(shard), shard.facts["seconds"])
        plans = []
        for plan in shard.facts["plans"]:
            scheme = schemes[plan["scheme"]]
            plans.append(StoredPlan(**{**plan, "scheme": scheme, "bias": tuple(plan["bias"])}))
        return pilot, plans

    def save(self, answer: Answer) -> None:
        """As answer.json."""
        content = {key: getattr(answer, key) for key in _ANSWERED} | {"made": provenance.made()}
        text = files.json_text(content, digits=None, indent=1)
        durable.write(self.folder.path / "answer.json", text.encode(), keep=False)


_ANSWERED = (
    "value", "interval", "error", "bias", "method", "scheme", "step", "paths", "cost", "pilot", "reached", "why",
    "notes",
)  # fmt: skip


@contextlib.contextmanager
def open_folder(path: Any, inputs: dict[str, Any], seed: int, watch: Watch) -> Iterator[InFolder]:
    """The folder of these inputs, made or gone on with; one of others is refused."""
    record = manifest.of_inputs(inputs, seed, UNIT)
    with RunFolder.open_to_write(path, record, [], None) as folder:
        yield InFolder(folder, watch)


def inputs_of(problem: Problem, tolerance: Tolerance, scheme: Scheme | None, method: str | None) -> dict[str, Any]:
    """What an answer depends on: of functions, their values at a few points."""
    model, target = problem.model, problem.target
    asked = {
        "f": target.name,
        "abs": tolerance.absolute,
        "rel": tolerance.relative,
        "horizon": problem.horizon,
        "q0": problem.q0[:, 0].tolist(),
        "p0": problem.p0[:, 0].tolist(),
        "scheme": scheme and scheme.name,
        "method": method,
        **{key: value for key, value in problem.options.items() if key != "threads"},
    }
    start = computed.Start(problem.q0, problem.p0, float(problem.options.get("t0", 0.0)), problem.horizon)
    return {"expect": asked, "computed": computed.of(model, scheme, start, {target.name: target})}


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
    kept = [
        {
            "method": plan.method,
            "scheme": plan.scheme.name,
            "steps": plan.steps,
            "coarsest_steps": plan.coarsest_steps,
            "seconds": plan.seconds,
            "variance": plan.variance,
            "bias": list(plan.bias),
            "options": plan.options,
        }
        for plan in plans
    ]
    return Shard(shard.arrays, {**shard.facts, "seconds": pilot.seconds, "plans": kept})
