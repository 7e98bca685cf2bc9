# SPDX-License-Identifier: BSD-3-Clause
"""The clocks of long work: the time that is left and spent, and reports of progress."""

from __future__ import annotations

import contextlib
import logging
import math
import time
from collections.abc import Iterator

from ...errors import BudgetWarning, InvalidArgumentError
from ...native import checks
from ...native.progress import Progress, say, told_by
from ...native.signals import carry

log = logging.getLogger("symsde")

_TICKS = 1000  #: ticks that a progress function gets for the whole work
_LONGER, _MOMENT = 1.5, 0.5  #: no warning before the announced time is exceeded by this factor and by this many seconds
_UNTOLD = 0.1  #: fewer seconds are not announced as a number: set-up calls alone take as long
_KNOWN = 0.1  #: above this share of the work its seconds predict the total


def told(seconds: float) -> str:
    """Estimated seconds in words."""
    return f"estimated at {seconds:.2g} s" if seconds >= _UNTOLD else f"estimated under {_UNTOLD:g} s"


class Watch:
    """Compares the clock with max_time, and counts the processor's seconds since the watch was made."""

    def __init__(self, max_time: float | None, progress: Progress):
        """Start both clocks; `max_time` is in seconds of the clock, None for no limit."""
        self._bar, self._tell = told_by(progress)
        self.max_time = math.inf if max_time is None else checks.finite("max_time", max_time)
        if self.max_time <= 0:
            raise InvalidArgumentError(f"max_time = {self.max_time:g} is not allowed: give seconds above 0")
        self._begin, self._begin_of_work = time.monotonic(), time.process_time()
        self._stopped = self._ended = False
        self._reckoned = self._last_told = math.inf
        self._announced = 0.0

    @property
    def elapsed(self) -> float:
        """Seconds of the clock since the watch was made."""
        return time.monotonic() - self._begin

    @property
    def seconds(self) -> float:
        """Seconds of the processor that all threads of this process took since the watch was made."""
        return time.process_time() - self._begin_of_work

    @property
    def over(self) -> bool:
        """Whether to begin no more work: the time is over, or the progress function asked to stop."""
        return self._stopped or self._ended or self.elapsed >= self.max_time

    def room(self, seconds: float) -> float:
        """Number of units that fit into the remaining time, if each takes this many seconds of the processor.

        If other processes use the processor too, clock time is longer than processor time, by the ratio measured so
        far.
        """
        elapsed = self.elapsed
        slower = max(elapsed / max(self.seconds, 1e-9), 1.0)
        return max(self.max_time - elapsed, 0.0) / max(slower * seconds, 1e-12)

    def end(self) -> None:
        """Note that the next unit would take longer than the remaining time, so that no more work begins."""
        self._ended = True

    @property
    def why(self) -> str:
        """The reason why the work ended, as part of a sentence."""
        if self._stopped:
            return "the progress function asked to stop"
        end = "leaves no time for more" if self._ended else "was over"
        return f"max_time = {self.max_time:g} s {end}"

    def announce(self, plan: str, seconds: float) -> None:
        """Announce the plan of the work that begins now, with its estimated seconds of the processor."""
        self._reckoned, self._announced = seconds, self.seconds
        self._last_told = max(seconds, _UNTOLD)
        self._say(plan)

    def _say(self, sentence: str) -> None:
        log.info("%s", sentence)
        if self._bar is not None and not log.isEnabledFor(logging.INFO):
            say(f"symsde: {sentence}\n")

    def _tell_anew(self, spent: float, share: float) -> None:
        """Announce a new estimate if the work has grown by levels, points or units that the pilot did not predict."""
        if share >= _KNOWN and spent > _LONGER * self._last_told * share:
            self._last_told = spent / share
            self._say(f"the plan has grown: {told(self._last_told)} in all")

    def _warn_of_more(self, spent: float, share: float) -> None:
        """Warn once if the work takes much longer than was estimated."""
        if self._reckoned > 0 and spent > _LONGER * self._reckoned + _MOMENT:
            said = max(self._reckoned, _UNTOLD)
            checks.warn(
                f"the work takes longer than the {said:.3g} s of the processor that were estimated: "
                f"{spent:.3g} s so far, about {spent / max(share, 1e-3):.3g} s in all; max_time ends it earlier",
                BudgetWarning,
            )
            self._reckoned = math.inf

    def tell(self, share: float) -> None:
        """Report the share of the work that is done. The share exceeds one if a part held more units than were
        wanted.
        """
        share = min(1.0, share)
        spent = self.seconds - self._announced
        self._tell_anew(spent, share)
        self._warn_of_more(spent, share)
        if self._tell:
            self._stopped |= bool(self._tell(round(_TICKS * share), _TICKS))

    @contextlib.contextmanager
    def carrying(self, kind: type) -> Iterator[None]:
        """Let every exception of the work within have an attribute `partial`: a result of this kind, or None.

        A simulation inside sets the attribute to its own run, which is replaced by None.
        """
        try:
            yield
        except BaseException as stop:
            if not isinstance(getattr(stop, "partial", None), kind):
                carry(stop, lambda: None)
            raise
        finally:
            self.close()

    def close(self) -> None:
        """End the line on which the bar is shown."""
        if self._bar is not None:
            self._bar.close()
