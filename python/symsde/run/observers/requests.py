# SPDX-License-Identifier: BSD-3-Clause
"""Requests for observers: one class for each kind; its fields are chosen by the caller."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ...errors import InvalidArgumentError, UnknownNameError, UnsaidAbsorbWarning, WrongTypeError
from ...native import abi, checks, handles
from ...native.checks import address
from ...show.values import Values


@dataclass(frozen=True)
class Observer:
    """A requested observer."""

    KIND: ClassVar[str] = ""

    def __post_init__(self) -> None:
        """Copy the arguments, which the caller may change later."""
        for field in dataclasses.fields(self):
            object.__setattr__(self, field.name, checks.fixed(getattr(self, field.name)))

    def names(self, values: Values) -> tuple[str, ...]:
        """The values to observe, among the values of the run."""
        return (values.called(checks.name_of(f"the value of {type(self).__name__}", self.of)),)

    def fields(self) -> dict[str, Any]:
        """Members of the C struct besides kind and values."""
        return {}

    def struct(self, values: Values, counts: np.ndarray | None = None, sums: np.ndarray | None = None):
        """The C struct in a run with these values; its arrays live as long as the struct."""
        names, columns = self.names(values), values.names
        for name in names:
            if name not in columns:
                raise UnknownNameError(
                    f"{self.KIND} of {name!r}: there is no such value: there are {checks.nearest(name, columns)}"
                )
        struct = handles.new(abi.Observer, "observer")
        struct.kind = abi.OBSERVERS.index(self.KIND) + 1
        keep = [np.array([columns.index(name) for name in names], np.int32)]
        struct.nvalue, struct.values = len(names), address(keep[0])
        for key, value in self.fields().items():
            is_list = isinstance(value, np.ndarray)
            if is_list:
                keep.append(value)
                setattr(struct, f"n{key.removesuffix('s')}", len(value))
            setattr(struct, key, address(value) if is_list else value)
        struct.counts, struct.sums = address(counts), address(sums)
        struct._keep = keep
        return struct


@dataclass(frozen=True)
class Histogram(Observer):
    """Counts of one value in bins of equal width from low to high (50 by default), below low and above high.

    They are counted at every saved time.
    """

    KIND: ClassVar[str] = "histogram"
    of: str
    low: float
    high: float
    bins: int = 50

    def fields(self) -> dict[str, Any]:
        """Range and bins for the C struct."""
        return {**_range(self), "bins": checks.integer("bins", self.bins, checks.INT32)}


@dataclass(frozen=True)
class Quantiles(Observer):
    """Quantiles of one value at every saved time, from counts in bins of equal relative width on both sides of zero.

    shares: the share of paths below each quantile, such as 0.5 for the median. The bins determine a quantile to
    1/(2 parts) of its value; the standard errors include this. Magnitudes below low count as zero, those above high as
    outside. Each power of two between low and high needs `parts` integers (a power of two) for each sign and saved
    time.
    """

    KIND: ClassVar[str] = "quantiles"
    of: str
    shares: tuple[float, ...] = (0.025, 0.25, 0.5, 0.75, 0.975)
    low: float = 1e-6
    high: float = 1e6
    parts: int = 64

    def fields(self) -> dict[str, Any]:
        """Shares, magnitudes and bins for the C struct."""
        shares = np.atleast_1d(checks.real_array("shares", self.shares)).astype(float)
        return {**_range(self), "bins": checks.integer("parts", self.parts, checks.INT32), "shares": shares}


@dataclass(frozen=True)
class Covariance(Observer):
    """Covariances of some values at every saved time, with standard errors from fourth moments."""

    KIND: ClassVar[str] = "covariance"
    of: tuple[str, ...]

    def names(self, values: Values) -> tuple[str, ...]:
        """The values to observe."""
        return _names("Covariance", self.of, values)


@dataclass(frozen=True)
class Autocorrelation(Observer):
    """Autocovariance and autocorrelation of one value of a stationary process over time.

    The lags are 0 .. `lags` saved points. Averages are taken over time along each path that is ok to the end, then over
    these paths. about: a number near the mean; it saves digits if the mean is large.
    """

    KIND: ClassVar[str] = "autocorrelation"
    of: str
    lags: int
    about: float = 0.0

    def fields(self) -> dict[str, Any]:
        """Lags and centre for the C struct."""
        return {"bins": checks.integer("lags", self.lags, checks.INT32), "low": checks.number("about", self.about)}


@dataclass(frozen=True)
class Extremes(Observer):
    """Lowest and highest value of each path at the saved times so far: their means over paths, and the extremes of
    all paths.
    """

    KIND: ClassVar[str] = "extremes"
    of: str


@dataclass(frozen=True)
class Passage(Observer):
    """Paths whose value leaves an interval: how many have left by each time, through which end, when and in what state.

    The value is checked after every step, not only at saved times. If it is not a number, the path fails. within=a
    stands for low=-a, high=a; one end may be infinite. absorb: a path that leaves ends there and does not count from
    then on in any moment or other observer. The default is True; beside other observers, observables or saved paths an
    UnsaidAbsorbWarning asks for an explicit value, which is required there from version 0.2 on. bridge: if noise acts
    on a coordinate or momentum, paths may also leave between two steps, by the law of a Brownian bridge; the result
    says whether this was used (`bridged`). Two-point and three-point increments have no such law, so schemes that draw
    them are refused unless bridge=False.
    """

    KIND: ClassVar[str] = "passage"
    is_unsaid: ClassVar[bool] = False  #: whether absorb was left out
    of: str
    low: float = -math.inf
    high: float = math.inf
    within: float | None = None
    absorb: bool | None = None
    bridge: bool = True

    def __post_init__(self) -> None:
        """Whether absorb was given, and its value."""
        super().__post_init__()
        object.__setattr__(self, "is_unsaid", self.absorb is None)
        if self.is_unsaid:
            object.__setattr__(self, "absorb", True)

    def fields(self) -> dict[str, Any]:
        """The interval and the two flags for the C struct."""
        found = _range(self)
        if self.within is not None:
            a = checks.number("within", self.within)
            if not a > 0 or math.isfinite(self.low) or math.isfinite(self.high):
                raise InvalidArgumentError(
                    f"within = {a}: give a positive number in the place of low and high, or these two"
                )
            found = {"low": -a, "high": a}
        return {**found, "absorbs": checks.flag("absorb", self.absorb), "bridges": checks.flag("bridge", self.bridge)}


@dataclass(frozen=True)
class Paths(Observer):
    """Values of chosen paths, by their global indices, at every saved time; by default all of q and p."""

    KIND: ClassVar[str] = "paths"
    paths: tuple[int, ...]
    of: tuple[str, ...] = ()

    def names(self, values: Values) -> tuple[str, ...]:
        """The given values; by default all of q and p."""
        return _names("Paths", self.of, values) or (*values.q, *values.p)

    def fields(self) -> dict[str, Any]:
        """The indices for the C struct, ascending."""
        given = checks.items(self.paths)
        indices = sorted({checks.integer("paths", i, (0, 2**47)) for i in ([self.paths] if given is None else given)})
        return {"paths": np.array(indices, np.int64)}


@dataclass(frozen=True)
class Means(Observer):
    """Means of all values, which moments of groups are made of."""

    KIND: ClassVar[str] = "means"

    def names(self, values: Values) -> tuple[str, ...]:
        """All values."""
        return tuple(values.names)


def _range(observer: Any) -> dict[str, float]:
    return {key: checks.number(key, getattr(observer, key)) for key in ("low", "high")}


def _names(what: str, given: object, values: Values) -> tuple[str, ...]:
    several = [given] if isinstance(given, str) else checks.items(given)
    if several is None:
        raise WrongTypeError(f"of = {checks.shown(given)} of {what} is no list: give names of values")
    return tuple(values.called(checks.name_of(f"a value of {what}", name)) for name in several)


KINDS = {cls.KIND: cls for cls in (Histogram, Quantiles, Covariance, Autocorrelation, Extremes, Passage, Paths)}


def check_observers(given: object) -> dict[str, Observer]:
    """A dict of observers whose names fit files; empty for None."""
    if given is None:
        return {}
    if not isinstance(given, Mapping):
        raise WrongTypeError(f"observers = {checks.shown(given)} is not allowed: give a dict of names and observers")
    for name, observer in given.items():
        if not isinstance(name, str) or not name.isidentifier():
            raise InvalidArgumentError(
                f"observer {checks.shown(name)}: this cannot be its name: give letters, digits and underscores"
            )
        if not isinstance(observer, Observer):
            raise WrongTypeError(
                f"observer {name!r} is {checks.shown(observer)}: give one of symsde.observe, as "
                'symsde.observe.Histogram("q_1", -3, 3, 60)'
            )
    return dict(given)


def unsaid(observers: Mapping[str, Observer], beside: bool) -> str:
    """A warning about passages that absorb by default while other results are kept; else empty."""
    names = [name for name, observer in observers.items() if getattr(observer, "is_unsaid", False)]
    if not names or not (beside or len(observers) > 1):
        return ""
    return (
        f"{', '.join(names)}: absorb is not said of this passage, and stands for absorb=True: paths that leave end "
        "there, and are in no other result from then on. Say absorb=True, or absorb=False to let them go on; from 0.2 "
        "on it must be said"
    )


def warn_of_unsaid(observers: Mapping[str, Observer], beside: bool) -> None:
    """Issue this warning."""
    if text := unsaid(observers, beside):
        checks.warn(text, UnsaidAbsorbWarning)


def from_tables(tables: object) -> dict[str, Observer]:
    """Observers from the tables [[observe]] of a scene: name, kind, and the fields of that kind."""
    if not isinstance(tables, list) or not all(isinstance(table, dict) for table in tables):
        raise InvalidArgumentError("write each observer as a table [[observe]] with keys below")
    found: dict[str, Observer] = {}
    for table in tables:
        given = dict(table)
        kind = given.pop("kind", None)
        if not isinstance(kind, str) or kind not in KINDS:
            raise UnknownNameError(f"kind = {kind!r} does not exist: there are {checks.nearest(str(kind), KINDS)}")
        name = given.pop("name", kind)
        if not isinstance(name, str):
            raise InvalidArgumentError(
                f"name = {name!r} of an observer is no text: give letters, digits and underscores"
            )
        if name in found:
            raise InvalidArgumentError(f"there are two observers of the name {name!r}: give each a name of its own")
        fields = {field.name: field for field in dataclasses.fields(KINDS[kind])}
        for key in given:
            if key not in fields:
                raise UnknownNameError(
                    f"{key!r} is no key of {kind}: there are {checks.nearest(key, ['name', 'kind', *fields])}"
                )
        for key, field in fields.items():
            if field.default is dataclasses.MISSING and key not in given:
                raise InvalidArgumentError(f"the observer {name!r} lacks {key}: a {kind} needs it")
        found[name] = KINDS[kind](**given)
    return check_observers(found)
