# SPDX-License-Identifier: BSD-3-Clause
"""Three kinds of errors: paths, moments, invariants. Each kind measures its error at one step, coupled to half the
step."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ...errors import InvalidArgumentError
from ...model.definition import require_closed
from ...run.simulate import Run
from ...schemes import Scheme
from ..coupled import end, rms, runs_of, squares
from ..coupled_errors import conserves_energy, depends_on_time, times_of
from ..expectation.problem import Problem

_MOST_SAVED = 2**20  #: most numbers that are saved to look at invariants; a run with more numbers saves fewer steps


@dataclass(frozen=True)
class Seen:
    """Differences between the results of steps h, h/2 and h/4 on the same paths."""

    first: float  #: size of the difference between steps h and h/2; for invariants the size of the change itself
    second: float  #: size of the difference between steps h/2 and h/4
    both: float  #: size of the difference between steps h and h/4: first + second if both point the same way, else less
    noise: float = 0.0  #: size of the sampling noise in any of the three differences

    def error(self, order: float) -> float:
        """Error of step h: differences beyond h/4 fall by 2^-order per halving, with the sign of the first two."""
        fall = 2.0**-order
        aligned = 0.0
        if self.first * self.second > 0:
            aligned = (self.both**2 - self.first**2 - self.second**2) / (2 * self.first * self.second)
        aligned = min(max(aligned, 0.0), 1.0)
        left = self.second * fall / (aligned * (1 - fall) + (1 - aligned) * math.sqrt(1 - fall**2))
        return math.hypot(math.sqrt(self.both**2 + left**2 + 2 * aligned * self.both * left), self.noise)


class Paths:
    """Root mean square of the distance in (q, p) at the horizon."""

    name = "paths"
    words = "root mean square distance of paths at the horizon"
    count = 192

    def __init__(self, problem: Problem):
        """Do nothing: paths need no preparation."""
        self.problem = problem

    def see(self, scheme, steps: int) -> Seen:
        """Compare runs with this many steps, twice and four times as many."""
        ends = [end(run) for run in self._runs(scheme, steps)]
        return Seen(*(rms(squares(a, b)) for a, b in _differences(ends)))

    def claimed(self, scheme: Scheme) -> float:
        """The strong order of the certificate: the lowest one that noises such as those of the model may have."""
        kinds = ("additive",) if self.problem.model.traits.additive else ("commutative", "general")
        return min(scheme.info.orders[kind].value or math.inf for kind in kinds)

    def _runs(self, scheme, steps: int) -> Iterator[Run]:
        """Give runs with this many steps, twice and four times as many, on the same Brownian paths."""
        return runs_of(self.problem, scheme, (steps, 2 * steps, 4 * steps), paths=self.count)


class Moments(Paths):
    """The largest error of the means of q, p, and of H if the model has a value."""

    name = "moments"
    words = "largest error of the means of q, p and H at the horizon"
    count = 4096

    def claimed(self, scheme: Scheme) -> float:
        """The weak order of the certificate."""
        return scheme.info.orders["weak"].value or math.inf

    def see(self, scheme, steps: int) -> Seen:
        """Compare means on the same paths, whose noise mostly cancels in the differences."""
        ends = [self._observed(run) for run in self._runs(scheme, steps)]
        apart = [a - b for a, b in _differences(ends)]
        noise = max(x.std(axis=1, ddof=1).max() for x in apart) / math.sqrt(self.count)
        return Seen(*(float(np.abs(x.mean(axis=1)).max()) for x in apart), noise=float(noise))

    def _observed(self, run: Run) -> np.ndarray:
        rows = [run.q[-1], run.p[-1]]
        if self.problem.model.traits.has_value:
            rows.append(self.problem.model.value(run.q[-1], run.p[-1], t=run.t[-1])[np.newaxis])
        return np.concatenate(rows)


class Invariants:
    """The largest change of H along a path: with noise if the noise conserves H, else with zero increments.

    If a scheme uses brackets of its noises, a path with zero increments still contains the means of these brackets.
    """

    name = "invariants"
    count = 64

    def __init__(self, problem: Problem):
        """Find out whether H is conserved, without noise and with it."""
        self.problem = problem
        require_closed(problem.model, "invariants (want) are")
        times = times_of(problem)
        if depends_on_time(problem.model, times):
            raise InvalidArgumentError(
                "want = 'invariants': H depends on time, so that nothing keeps it: give want = 'paths' or 'moments'"
            )
        if problem.model.value(problem.q0, problem.p0)[0] == 0:
            raise InvalidArgumentError(
                "want = 'invariants': H is 0 at the initial state, and changes are relative to it: add a constant to H"
            )
        self.kept = problem.model.nnoise > 0 and conserves_energy(problem.model, times)
        where = "H, which the noises keep" if self.kept else "H with increments of zero"
        self.words = f"largest change of {where}, over its size"

    def claimed(self, scheme: Scheme) -> float:
        """The claimed order without noise, if paths have no noise. Where noises keep H no order of its change is
        claimed.
        """
        return math.inf if self.kept else float(scheme.info.order_noise_free or math.inf)

    def see(self, scheme, steps: int) -> Seen:
        """The change of H itself, which decreases with the step like a difference."""
        problem, model = self.problem, self.problem.model
        saved = max(64, _MOST_SAVED // (model.ndof * (self.count if self.kept else 1)))
        every = next(n for n in range(max(1, -(-steps // saved)), steps + 1) if steps % n == 0)
        more = (
            {"paths": self.count}
            if self.kept
            else {"increments": np.zeros((2 * steps, model.nnoise)), "refine": 1, "paths": 1}
        )
        run = problem.run(scheme, steps, save_every=every, **more)
        states = (np.moveaxis(x, 0, 1).reshape(model.ndof, -1) for x in (run.q, run.p))
        energy = model.value(*states).reshape(len(run.q), -1)
        change = np.abs(energy - energy[0]).max(axis=0) / np.abs(energy[0])
        size = math.sqrt(np.mean(change**2))
        return Seen(size, 0.0, size)


def _differences(ends: list[np.ndarray]) -> list[tuple[np.ndarray, np.ndarray]]:
    """Pairs of end states in the order of `Seen`."""
    return [(ends[0], ends[1]), (ends[1], ends[2]), (ends[0], ends[2])]


KINDS = {kind.name: kind for kind in (Paths, Moments, Invariants)}
