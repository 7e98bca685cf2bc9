# SPDX-License-Identifier: BSD-3-Clause
"""Results of observers: arrays with their standard errors, and variables for files."""

from __future__ import annotations

import functools
import json
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np

from ...native.checks import counted
from ...native.files import Variables
from ...show import plot
from ...show.values import Values
from .partial_statistics import PartialStatistics, Scope, read
from .requests import KINDS, Observer

NOT_FILED = ("counts", "edges", "below", "above", "not_a_number", "kept")


def _as_they_are(dims: tuple[str, ...], *names: str) -> dict[str, tuple[str, tuple[str, ...]]]:
    """Attributes that have the same names in files."""
    return {name: (name, dims) for name in names}


class Observed:
    """The result of one observer."""

    FILED: ClassVar[dict[str, tuple[str, tuple[str, ...]]]] = {}  #: attribute -> its name and dimensions in files
    observer: Observer  #: the observer as requested
    t: np.ndarray  #: (time,), saved times
    kept: PartialStatistics  #: integers and sums as in symsde.h, from which parts of an ensemble are merged

    def __init__(self, scope: Scope, t: np.ndarray, observer: Observer, kept: PartialStatistics):
        """Compute the library's answer from kept results."""
        self.observer, self.t, self.kept = observer, t, kept
        self._names = observer.names(scope.values)
        self._take(scope, *read(scope, observer, kept))

    @property
    def looked_at(self) -> tuple[str, ...]:
        """Names of the observed values."""
        return self._names

    def _take(self, scope: Scope, values: np.ndarray, errors: np.ndarray) -> None:
        """Give the arrays of the answer their shapes."""
        raise NotImplementedError

    def variables(self, name: str) -> Variables:
        """Arrays with the names of their dimensions, for files that store the observer under this name."""
        found: dict[str, Any] = {}
        for attribute, (key, dims) in self.FILED.items():
            if (value := getattr(self, attribute)) is not None:
                array = np.array(list(value.values()) if isinstance(value, dict) else value)
                found[f"{name}_{key}"] = (tuple(x if x == "time" else f"{name}_{x}" for x in dims), array)
        return found

    @classmethod
    def filed(cls, observer: Observer, values: Values, t: np.ndarray, variables: Mapping, name: str) -> Observed:
        """Restore the result from the variables of a file that stores the observer under this name."""
        self = cls.__new__(cls)
        self.observer, self.t, self._names = observer, t, observer.names(values)
        for attribute, (key, _) in cls.FILED.items():
            if (array := variables.get(f"{name}_{key}")) is not None:
                is_text = array.dtype.kind in "OU"
                value = tuple(map(str, array)) if is_text else array if array.ndim else array.item()
                setattr(self, attribute, self._of_file(attribute, value))
        return self

    def _of_file(self, _attribute: str, value: Any) -> Any:
        """Restore an attribute from its form in a file."""
        return value

    def __getattr__(self, name: str) -> Any:
        """Raise an error for an attribute that the file does not contain."""
        if name in self.FILED:
            raise AttributeError(f"the file does not hold {name}: an older version has written it")
        if name in NOT_FILED:
            raise AttributeError(
                f"files of results do not hold {name} of {self.observer.KIND}, which takes more room than the rest: "
                "keep the result itself (pickle), or the folder of the run"
            )
        raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")

    def remarks(self) -> list[str]:
        """Sentences about values that the result leaves out."""
        return []

    def plot(self, path=None, *, ax=None, at: int = -1):
        """Draw a matplotlib figure, written if a path is given, or draw into `ax`; at: index of the saved time of a
        histogram.
        """
        return plot.observed(self, (path, ax), at)

    def __repr__(self) -> str:
        """The result in one line."""
        return f"<{self.observer.KIND} of {', '.join(self._names)} at {counted(len(self.t), 'time')}>"


class Slots(Observed):
    """Counts of values in bins."""

    edges: np.ndarray  #: (bin + 1,), ascending
    counts: np.ndarray  #: (time, bin)
    below: np.ndarray  #: (time,), counts below all bins; likewise above, not_a_number

    def _take_slots(self, edges: np.ndarray) -> None:
        slots = self.kept.counts.reshape(len(self.t), -1)
        self.edges, self.counts = edges, slots[:, 1:-2]
        self.below, self.above, self.not_a_number = slots[:, 0], slots[:, -2], slots[:, -1]


class HistogramResult(Slots):
    """A histogram at every saved time."""

    FILED = (
        {"edges": ("edge", ("edge",)), "counts": ("count", ("time", "bin"))}
        | _as_they_are(("time",), "below", "above", "not_a_number")
        | _as_they_are(("time", "bin"), "density", "se_density", "share", "se_share")
    )
    share: np.ndarray  #: (time, bin), share of all values counted at that time
    se_share: np.ndarray  #: (time, bin), binomial standard errors of share
    density: np.ndarray  #: (time, bin), share over width; likewise se_density

    def _take(self, scope: Scope, values: np.ndarray, errors: np.ndarray) -> None:
        wanted = self.observer.fields()
        self._take_slots(np.linspace(wanted["low"], wanted["high"], wanted["bins"] + 1))
        self.share, self.se_share = (x.reshape(len(self.t), -1)[:, 1:-2] for x in (values, errors))
        width = np.diff(self.edges)
        self.density, self.se_density = self.share / width, self.se_share / width


class QuantilesResult(Slots):
    """Quantiles at every saved time; their many counts are kept in shards, not in files of results."""

    FILED = {"shares": ("share", ("share",))} | _as_they_are(("time", "share"), "quantile", "se_quantile")
    shares: np.ndarray  #: (share,), shares of the paths that lie below the quantiles
    quantile: np.ndarray  #: (time, share)
    se_quantile: np.ndarray  #: (time, share), chance error (from the ranks) and half a bin combined

    def _take(self, scope: Scope, values: np.ndarray, errors: np.ndarray) -> None:
        self.shares = self.observer.fields()["shares"]
        self._take_slots(_relative_edges(**self.observer.fields()))
        self.quantile, self.se_quantile = (x.reshape(len(self.t), -1) for x in (values, errors))


def _relative_edges(low: float, high: float, bins: int, **_others: object) -> np.ndarray:
    """The edges of the library's bins: each power of two in `bins` equal parts, on both sides of zero."""
    first, last = np.floor(np.log2(low)), np.ceil(np.log2(high))
    powers = 2.0 ** np.arange(first, last)
    one_side = (powers[:, np.newaxis] * (1 + np.arange(bins) / bins)).ravel()
    one_side = np.append(one_side, 2.0**last)
    return np.concatenate([-one_side[::-1], one_side])


class CovarianceResult(Observed):
    """Covariances at every saved time."""

    FILED = (
        {"names": ("value", ("value",)), "mean": ("mean", ("time", "value"))}
        | _as_they_are(("time", "value", "value_"), "covariance", "se_covariance", "correlation")
        | _as_they_are(("time",), "n")
    )
    names: tuple[str, ...]  #: names of the values
    covariance: np.ndarray  #: (time, value, value), unbiased
    se_covariance: np.ndarray  #: (time, value, value)
    correlation: np.ndarray  #: (time, value, value), without standard errors
    n: np.ndarray  #: (time,), paths that are ok up to each time
    mean: np.ndarray  #: (time, value)

    def _take(self, scope: Scope, values: np.ndarray, errors: np.ndarray) -> None:
        self.names = self._names
        k, ntime = len(self.names), len(self.t)
        table = self.kept.sums.reshape(ntime, -1)
        self.n, self.mean = table[:, 0].astype(np.int64), np.where(table[:, :1] > 0, table[:, 1 : 1 + k], np.nan)
        self.covariance, self.se_covariance = (_square(x.reshape(ntime, -1), k) for x in (values, errors))
        spread = np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2))
        with np.errstate(divide="ignore", invalid="ignore"):
            self.correlation = self.covariance / (spread[:, :, np.newaxis] * spread[:, np.newaxis, :])


def _square(pairs: np.ndarray, k: int) -> np.ndarray:
    """Turn (time, pair) into (time, value, value)."""
    rows, columns = np.triu_indices(k)
    order = np.lexsort((rows, columns))  # (1,1), (1,2), (2,2), (1,3) ..
    found = np.empty((len(pairs), k, k))
    found[:, rows[order], columns[order]] = found[:, columns[order], rows[order]] = pairs
    return found


class AutocorrelationResult(Observed):
    """Autocorrelation of a value over time."""

    FILED = _as_they_are(
        ("lag",), "lag", "covariance", "se_covariance", "correlation", "se_correlation"
    ) | _as_they_are((), "n", "mean")
    lag: np.ndarray  #: (lag,), in units of time
    covariance: np.ndarray  #: (lag,); likewise se_covariance
    correlation: np.ndarray  #: (lag,), covariance over the covariance at lag 0; likewise se_correlation
    n: int  #: paths that were ok to the end
    mean: float  #: mean of the value over paths and times

    def _take(self, scope: Scope, values: np.ndarray, errors: np.ndarray) -> None:
        (self.covariance, self.correlation), (self.se_covariance, self.se_correlation) = (
            x.reshape(-1, 2).T for x in (values, errors)
        )
        options = scope.setup.options
        self.lag = np.arange(len(self.covariance)) * (options.step * options.save_every)
        table = self.kept.sums.reshape(len(self.lag), -1)
        self.n = int(table[0, 0])
        self.mean = float(table[0, 4] + self.observer.about) if self.n else np.nan


class ExtremesResult(Observed):
    """Lowest and highest values."""

    FILED = _as_they_are(("time",), "mean_lowest", "se_mean_lowest", "mean_highest", "se_mean_highest") | _as_they_are(
        ("value_path_time",), "lowest", "highest"
    )
    mean_lowest: np.ndarray  #: (time,), mean over paths of the lowest value so far; likewise se_mean_lowest
    mean_highest: np.ndarray  #: (time,); likewise se_mean_highest
    lowest: tuple[float, int, float]  #: value, path and time of the lowest value of all; likewise highest

    def _take(self, scope: Scope, values: np.ndarray, errors: np.ndarray) -> None:
        (self.mean_lowest, self.mean_highest), (self.se_mean_lowest, self.se_mean_highest) = (
            x.reshape(-1, 2).T for x in (values, errors)
        )
        for i, key in enumerate(("lowest", "highest")):
            path, at = (int(x) for x in self.kept.counts[2 * i : 2 * i + 2])
            setattr(self, key, (float(self.kept.sums[i]), path, float(self.t[at]) if path >= 0 else np.nan))

    def _of_file(self, attribute: str, value: Any) -> Any:
        if attribute not in ("lowest", "highest"):
            return value
        lowest, path, at = value.tolist()
        return lowest, int(path), at


class PassageResult(Observed):
    """Paths that left an interval."""

    FILED = (
        _as_they_are(
            ("time",), "lost", "se_lost", "lost_below", "lost_above", "se_lost_below", "se_lost_above", "there"
        )
        | _as_they_are(("time", "end"), "count")
        | _as_they_are(("listed",), "path", "step")
        | _as_they_are(("listed", "coordinate"), "state")
        | {"names": ("coordinate", ("coordinate",))}
        | _as_they_are(("coordinate",), "mean", "se_mean")
        | _as_they_are((), "n", "bridged")
    )
    lost: np.ndarray  #: (time,), share of all paths that have left so far; likewise se_lost, binomial
    lost_below: np.ndarray  #: (time,), through the lower end; likewise lost_above, se_lost_below, se_lost_above
    count: np.ndarray  #: (time, 2), paths that left below and above since the last saved time
    there: np.ndarray  #: (time,), paths that have not left yet
    bridged: int | None = None  #: paths that left between two steps; None if this is not checked, see `remarks`
    n: int  #: number of paths that have left
    mean: dict[str, float]  #: means of t, coordinates and momenta of these paths when they left; likewise se_mean
    path: np.ndarray  #: (listed,), global indices of the first paths that left; at most 1000
    step: np.ndarray  #: (listed,), absolute step after which each was outside
    state: np.ndarray  #: (listed, 1 + 2 dof), t, q and p after this step

    def _take(self, scope: Scope, values: np.ndarray, errors: np.ndarray) -> None:
        ntime, width = len(self.t), 1 + 2 * scope.setup.model.ndof
        self.lost_below, self.lost_above = values.reshape(ntime, 2).T
        self.se_lost_below, self.se_lost_above = errors.reshape(ntime, 2).T
        counts, sums = self.kept.counts, self.kept.sums
        slots = counts[: 3 * ntime].reshape(ntime, 3)
        self.count, self.there = slots[:, :2], slots[:, 2]
        total = slots[0].sum()
        self.lost = self.lost_below + self.lost_above
        self.se_lost = np.sqrt(np.maximum(self.lost * (1 - self.lost), 0) / total) if total else self.lost * np.nan
        self.bridged = None if counts[3 * ntime] < 0 else int(counts[3 * ntime])
        paths, steps = counts[3 * ntime + 1 :].reshape(2, -1)
        listed = paths >= 0
        table = sums[paths.size * width :]
        self._is_derived = scope.values.names.index(self._names[0]) >= width - 1 and scope.setup.model.nnoise > 0
        self.path, self.step = paths[listed], steps[listed]
        self.state = sums[: paths.size * width].reshape(-1, width)[listed]
        self.n = int(table[0])
        self.names = ("t", *scope.values.q, *scope.values.p)
        means, squares = table[1 : 1 + width], table[1 + width : 1 + 2 * width]
        with np.errstate(divide="ignore", invalid="ignore"):
            errors = np.sqrt(squares / (self.n - 1) / self.n) if self.n > 1 else np.full(width, np.nan)
        self.mean = dict(zip(self.names, (means if self.n else means * np.nan).tolist(), strict=True))
        self.se_mean = dict(zip(self.names, errors.tolist(), strict=True))

    def _of_file(self, attribute: str, value: Any) -> Any:
        return dict(zip(self.names, value.tolist(), strict=True)) if attribute in ("mean", "se_mean") else value

    def remarks(self) -> list[str]:
        """Sentences about absorbed paths, and about noise on a value that has no Brownian bridge."""
        wanted, found = self.observer, []
        if wanted.absorb:
            found.append(
                f"{counted(self.n, 'path')} left and ended there: from then on they are in no moment and no other "
                "observer (absorb=True)"
            )
        if not (wanted.bridge and self._is_derived):
            return found
        return [
            *found,
            f"{self._names[0]} is checked only at the ends of steps, since only q and p have Brownian bridges: paths "
            "that leave and return within a step are missed, a share of the order of the root of the step; halve the "
            "step to see how large it is",
        ]


class PathsResult(Observed):
    """Values of chosen paths."""

    FILED: ClassVar = {
        "path": ("path", ("path",)),
        "names": ("value", ("value",)),
        "values": ("values", ("path", "time", "value")),
    }
    path: np.ndarray  #: (path,), global indices
    names: tuple[str, ...]  #: names of the values
    values: np.ndarray  #: (path, time, value); NaN after the end of a path, or if this run does not have the path

    def _take(self, scope: Scope, values: np.ndarray, errors: np.ndarray) -> None:
        self.path, self.names = self.observer.fields()["paths"], self._names
        self.values = values.reshape(len(self.path), len(self.t), len(self.names))


RESULTS = {
    "histogram": HistogramResult,
    "quantiles": QuantilesResult,
    "covariance": CovarianceResult,
    "autocorrelation": AutocorrelationResult,
    "extremes": ExtremesResult,
    "passage": PassageResult,
    "paths": PathsResult,
}


def observed(
    scope: Scope, t: np.ndarray, observers: Mapping[str, Observer], kept: Mapping[str, PartialStatistics]
) -> dict[str, Observed]:
    """The results of all observers of a run, by their names."""
    return {name: RESULTS[observer.KIND](scope, t, observer, kept[name]) for name, observer in observers.items()}


def filed(
    values: Values, t: np.ndarray, variables: Mapping[str, np.ndarray], wanted: str, remarks: Sequence[str]
) -> dict[str, Observed]:
    """The results from the variables of a file of moments and its texts: the observers as JSON, and their remarks."""
    found = {}
    for name, fields in json.loads(wanted).items():
        kind = fields.pop("kind")
        observer = KINDS[kind](**fields)
        found[name] = RESULTS[kind].filed(observer, values, t, variables, name)
        told = [text.removeprefix(f"{name}: ") for text in remarks if text.startswith(f"{name}: ")]
        found[name].remarks = functools.partial(list, told)
    return found
