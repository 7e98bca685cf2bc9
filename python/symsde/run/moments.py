# SPDX-License-Identifier: BSD-3-Clause
"""Integrate paths and keep their moments only."""

from __future__ import annotations

import ctypes
import dataclasses
import functools
import json
import math
import os
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Unpack

import numpy as np

from ..errors import FalseTraitError, IncompatibleError, InvalidArgumentError, NotANumberWarning, NotSavedWarning
from ..model.definition import Model
from ..model.thermostat import diagonal_masses
from ..native import abi, callbacks, checks, files, handles
from ..native.checks import address, addresses, counted
from ..native.progress import Monitor, Progress
from ..native.signals import carry
from ..show import tables, tabular
from ..show.values import Values
from . import bath_temperature
from .groups import KINDS, MEANS, GroupedMoments, Groups, groups_of, variables_of
from .kept_paths import KeptPaths
from .observers import observer_results, requests
from .observers.observables import Observable, are_in_python, bind, check_observables, described, refuse_coordinates
from .observers.partial_statistics import Kinds, PartialStatistics, Scope, merge, structs
from .options import RunOptions
from .report import Reported, filled
from .saved import MomentTables
from .setup import Setup, make_setup

_NONE = np.empty(0, np.int64)  #: no failed paths


class Moments(MomentTables, Reported):
    """Means, unbiased variances and standard errors of means, at each time over the paths that are ok up to then."""

    m2: np.ndarray  #: (time, value), sums of squared deviations, needed to merge parts of an ensemble exactly
    failed: np.ndarray  #: global indices of the first 1000 failed paths; likewise failed_status, failed_step
    #: sums and counts of each observer, needed to merge parts of an ensemble exactly
    kept: dict[str, PartialStatistics]

    def __init__(
        self,
        setup: Setup,
        observables: Mapping[str, Observable] | Iterable[str],
        observers: Kinds | None = None,
        groups: Groups | None = None,
        paths: KeptPaths | None = None,
    ):
        """Allocate the moments, also of these observables, and the results of these observers, of each group if there
        are groups; `fill` computes them, and what is kept of paths."""
        self.setup, self.groups, self.paths_kept = setup, groups, paths
        self.observers = dict(observers or {})
        self._asked = self.observers | ({} if groups is None else {MEANS: requests.Means()})
        if self.observers and setup.saved is not None:
            raise IncompatibleError("observers take states at equal distances: give save_every in the place of save_at")
        self._observables = described(observables)
        refuse_coordinates(self._observables, setup.model)
        self._has_energy = setup.model.traits.has_value
        ndof = setup.model.ndof
        nvalue = 2 * ndof + self._has_energy + len(self._observables)
        checks.room((3, setup.ntime, nvalue), "the moments (mean, variance, error; time, value)")
        self.t = np.empty(setup.ntime)
        self.n_ok = np.empty(setup.ntime, np.int64)
        *tables, self.m2 = np.empty((4, setup.ntime, nvalue))
        self._tables = dict(zip(KINDS, tables, strict=True))
        self.values = Values.of(setup.model.coordinates, self._has_energy, tuple(self._observables))
        scope = Scope(setup, self.values, groups)
        self.kept = {name: scope.room(observer) for name, observer in self._asked.items()}
        if self.observers:
            self._check_names()

    def _temperature(self) -> str:
        """Of the last time: from observables where they were collected, else from the moments of p."""
        model, at, none = self.setup.model, len(self.t) - 1, (math.nan, math.nan)
        if not model._bath:
            return ""
        if all(name in self.mean for name in bath_temperature.NAMES):
            values = [(self.mean[name][at], self.se_mean[name][at]) for name in bath_temperature.NAMES]
            kinetic, (force, se_force), (stiffness, se_stiffness) = values
            ratio = force / stiffness if stiffness else math.nan
            error = (se_force + abs(ratio) * se_stiffness) / abs(stiffness) if stiffness else math.nan
            return bath_temperature.of_moments(model, kinetic, (ratio, error), self.t[at])
        masses = diagonal_masses(model)
        if masses is None or not self.n_ok[at]:
            return bath_temperature.of_moments(model, none, none, self.t[at])
        squares = self.mean_p[at] ** 2 + self.var_p[at] * (1 - 1 / self.n_ok[at])
        return bath_temperature.of_moments(model, (float((squares / masses).mean()), math.nan), none, self.t[at])

    def _check_names(self) -> None:
        """Refuse names of observers and observables that would give two variables of a file the same name."""
        taken = dict.fromkeys(("n_ok", "failed", "failed_status", "failed_step"), "what every file holds")
        taken |= {f"{kind}_{name}": f"the observable {name!r}" for kind in self._tables for name in self._observables}
        scope = self.scope
        rooms = {name: scope.room(observer) for name, observer in self.observers.items()}
        for name, result in observer_results.observed(scope, np.zeros(len(self.t)), self.observers, rooms).items():
            for variable in result.variables(name):
                if variable in taken:
                    raise InvalidArgumentError(
                        f"the observer {name!r} would call a variable of files {variable}, as {taken[variable]} does: "
                        "give one of the two another name"
                    )
                taken[variable] = f"the observer {name!r}"

    @property
    def scope(self) -> Scope:
        """The setup and the names of values for observers of all paths."""
        return Scope(self.setup, self.values)

    def merge_kept(self, name: str, left: PartialStatistics, right: PartialStatistics) -> None:
        """Merge the statistics of an observer over two siblings into the left one."""
        merge(self.scope, self._asked[name], left, right)

    @functools.cached_property
    def observed(self) -> dict[str, observer_results.Observed]:
        """Results of the observers, by their names, over all paths that are in groups if there are groups."""
        return observer_results.observed(self.scope, self.t, self.observers, self._together())

    def _together(self) -> Mapping[str, PartialStatistics]:
        """The statistics of observers over all groups."""
        if self.groups is None:
            return self.kept
        found = {}
        for name in self.observers:
            first, *others = self.kept[name].rows()
            found[name] = first.copy()
            for other in others:
                self.merge_kept(name, found[name], other)
        return found

    @functools.cached_property
    def by_group(self) -> GroupedMoments | None:
        """Moments and results of observers of each group of paths; None without groups."""
        if self.groups is None:
            return None
        found = GroupedMoments(self, self.groups.grid, self.values, len(self.t))
        numbers = self.kept[MEANS].groups
        found.put(numbers, self.sums_by_group())
        found.t = self.t
        for name, observer in self.observers.items():
            results = [None] * self.groups.grid.count
            for k, part in zip(numbers.tolist(), self.kept[name].rows(), strict=True):
                results[k] = observer_results.observed(self.scope, self.t, {name: observer}, {name: part})[name]
            found.observed[name] = results
        return found.finish()

    def sums_by_group(self) -> np.ndarray:
        """(group, time, 1 + 2 value): numbers of paths, means, squares of deviations."""
        kept = self.kept[MEANS]
        rows = kept.sums.reshape(len(kept.groups), -1, 1 + 2 * len(self.values.names))
        return rows if self.setup.saved is None else rows[:, self.setup.rows]

    def fill(self, observables: dict[str, Observable], progress: Progress) -> None:
        """Let the library integrate."""
        if self.setup.saved is not None:
            self._fill_some(observables, progress)
            return
        failures = callbacks.Failures()
        moments = handles.new(abi.Moments, "moments")
        arrays = self.t, self.n_ok, self.m2, *self._tables.values()
        moments.t, moments.n_ok, moments.m2, moments.mean, moments.variance, moments.se_mean = addresses(arrays)
        _bound = bind(observables, self.setup.model, moments, failures)
        if self._asked:
            requested, _made = structs(Scope(self.setup, self.values, self.groups), self._asked, self.kept)
            moments.nobserver, moments.observers = len(self._asked), ctypes.addressof(requested)
        if self.paths_kept is not None:
            kept = self.paths_kept.struct()
            moments.paths = ctypes.addressof(kept)
        report = handles.new(abi.Report, "report")
        report.threads = 0  # stays 0 if the run does not begin
        in_python = self.setup.model.in_python or are_in_python(observables)
        with Monitor(progress, in_python=in_python) as monitor:
            try:
                self._integrate(moments, report, monitor, failures)
            finally:
                listed = moments.nfailed_listed
                for name in ("failed", "failed_status", "failed_step"):
                    setattr(self, name, np.array(getattr(moments, name)[:listed], np.int64) if listed else _NONE.copy())
                self._keep_report(report)
            self._warn_of_failures()

    def _fill_some(self, observables: dict[str, Observable], progress: Progress) -> None:
        """Let the library collect more often than wanted, at equal distances, and keep what is wanted."""
        rows, paths = self.setup.rows, self.paths_kept and self.paths_kept.of(self.setup.whole())
        whole = Moments(self.setup.whole(), observables, None, self.groups, paths)
        try:
            whole.fill(observables, progress)
        finally:
            if filled(whole):
                kept = {name: getattr(whole, name)[rows] for name in ("t", "n_ok", "m2")}
                kept["_tables"] = {kind: x[rows] for kind, x in whole._tables.items()}
                if paths is not None:
                    self.paths_kept.take_rows(paths, rows)
                self.__dict__.update({**whole.__dict__, "setup": self.setup, "paths_kept": self.paths_kept, **kept})

    def _integrate(self, moments, report, monitor, failures) -> None:
        setup = self.setup
        given = setup.input(monitor)
        refusal = None
        try:
            setup.model.call(
                "compute_moments",
                *setup.handles(),
                *(ctypes.byref(struct) for struct in (given, moments, report)),
                allow=(abi.STOPPED, abi.PATHS_FAILED),
            )
        except Exception as error:
            refusal = error
        failures.raise_stored()
        if isinstance(refusal, FalseTraitError):
            raise FalseTraitError(re.sub(r"^observable (\d+)", self._named, str(refusal)))
        if refusal is not None:
            raise refusal

    def _named(self, match: re.Match) -> str:
        """The observable's name for a message in which the library gives its number."""
        return f"observable {list(self._observables)[int(match[1]) - 1]!r}"

    def fill_from_sums(self, n_ok: np.ndarray, mean: np.ndarray, m2: np.ndarray) -> None:
        """Fill the moments from counts (time,), means and sums of squared deviations (time, value)."""
        self.n_ok[...], self.m2[...], self._tables["mean"][...] = n_ok, m2, mean
        arrays = self.n_ok, self._tables["mean"], self.m2, self._tables["var"], self._tables["se_mean"]
        handles.call("moment_errors", *self.m2.shape, *map(address, arrays))

    def _repr_html_(self) -> str:
        """Show the moments in notebooks."""
        return tabular.html_of_moments(self)

    def _variables(self) -> files.Variables:
        variables = {"n_ok": (("time",), self.n_ok), "m2": (("time", "value"), self.m2)}
        for name in ("failed", "failed_status", "failed_step"):
            variables[name] = (("listed",), getattr(self, name))
        for kind in self._tables:
            for x in "qp":
                variables[f"{kind}_{x}"] = (("time", "dof"), getattr(self, f"{kind}_{x}"))
            if self._has_energy:
                variables[f"{kind}_energy"] = (("time",), getattr(self, f"{kind}_energy"))
            for name, values in getattr(self, kind).items():
                variables[f"{kind}_{name}"] = (("time",), values)
        for name, result in self.observed.items():
            variables |= result.variables(name)
        return variables if self.by_group is None else variables | variables_of(self.by_group)

    def attributes(self) -> dict[str, str]:
        """Origin of the moments as text for files, with the observers."""
        wanted = {name: {"kind": x.KIND, **dataclasses.asdict(x)} for name, x in self.observers.items()}
        told = {"observables": self._observables, "observers": wanted, "remarks": self.remarks()}
        grid = {} if self.groups is None else {"groups": self.groups.grid.told()}
        return {**super().attributes(), **{key: json.dumps(x) for key, x in told.items() if x}, **grid}

    def remarks(self) -> list[str]:
        """Sentences about values that the results of observers leave out."""
        return [f"{name}: {text}" for name, result in self.observed.items() for text in result.remarks()]

    def to_xarray(self):
        """An xarray.Dataset with dims time and dof; t is another name of time."""
        return files.dataset(self._variables(), files.axes(self.t, self.mean_q.shape[1]), self.attributes())

    def save(self, path: str | os.PathLike) -> None:
        """Write a .nc (needs xarray and netCDF4) or .npz file, from which `symsde.load` restores the moments, or a
        table.

        A .csv table has a row for each time, and lines that begin with # describe its origin. It cannot hold the
        results of observers: a NotSavedWarning says so.
        """
        target = files.path_of("path", path)
        if target.suffix == ".csv":
            self.save_table(target)
            if self._asked:
                checks.warn(f"{target}: {self._not_in_tables()}", NotSavedWarning)
        else:
            variables = {"t": (("time",), self.t), **self._variables()}
            files.write(target, self.to_xarray, variables, self.attributes(), also=".csv, ")

    def save_table(self, target: Path) -> None:
        """Write a .csv table of all results with one value for each time."""
        columns = {"t": self.t, "n_ok": self.n_ok}
        for kind, table in self._tables.items():
            columns |= {f"{kind} {name}": x for name, x in zip(self.columns(), table.T, strict=True)}
        told = {"not in this table": self._not_in_tables()} if self._asked else {}
        tables.write(target, columns, {**self.attributes(), **told})

    def _not_in_tables(self) -> str:
        if not self.observers:
            return "a table of times cannot hold moments of groups: save those, as by_group.save(..), too"
        return (
            f"a table of times cannot hold the results of the observers {', '.join(self.observers)}: save a .nc or "
            ".npz file, too"
        )

    def _absorbed(self) -> str:
        """How many paths left through absorbing passages; empty if there are none."""
        lost = {name: x.n for name, x in self.observed.items() if getattr(x.observer, "absorb", False)}
        told = "".join(f", {n} absorbed by {name}" for name, n in lost.items())
        return f"{told}, {self.n_ok[-1]} left" if lost else ""

    def __repr__(self) -> str:
        """The moments in one line."""
        return (
            f"<moments of {self.setup.model!r} by {self.setup.scheme.name}: {', '.join(self.columns()[:8])} at "
            f"{counted(len(self.t), 'time')} from {self.t[0]:g} to {self.t[-1]:g}, "
            f"{counted(self.setup.paths, 'path')}{self._absorbed()}, {self.report.outcome}>"
        )


@checks.hinted(*RunOptions.__annotations__)
def moments(
    model: Model,
    *,
    q0: Any,
    p0: Any,
    step: float,
    steps: int,
    observables: dict[str, Observable] | None = None,
    observers: dict[str, requests.Observer] | None = None,
    groups: Any = None,
    progress: Progress = False,
    **options: Unpack[RunOptions],
) -> Moments:
    """Integrate paths and keep moments of q, p, the energy H and observables, in memory independent of paths and steps.

    - observables: name -> a formula or a function. A formula is a text such as `"q_1**2 + p_1**2"` or an expression of
      sympy, in the model's own names and parameters; it is compiled. A function of q, p, (dof, lane) each, returns
      (lane,) values. A lane is a path; if there are few paths, a call holds the lanes of several saved times
    - observers: name -> further statistics of these values, one of `symsde.observe`; the results are in `observed`
    - groups: the name of a parameter that differs from path to path, or names of some, or (path,) labels, whole
      numbers: `by_group` has the moments, and results of observers, of the paths with each value or label
    - the other arguments are those of `simulate`; first_path is a multiple of 256, so that shards merge to the same
      bits

    Bad input raises a ValueError (`symsde.errors`). An exception of an observable stops the run and is raised again. If
    a value is not finite on a path that is ok, a NotANumberWarning says so; its means are not finite either.
    """
    given = {"q0": q0, "p0": p0, "step": step, "steps": steps, **options}
    return moments_of(model, observables=observables, observers=observers, groups=groups, progress=progress, **given)


def moments_of(
    model: Model,
    *,
    observables: dict[str, Observable] | None = None,
    observers: dict[str, requests.Observer] | None = None,
    groups: Any = None,
    progress: Progress = False,
    keep_last: bool = False,
    **options: Any,
) -> Moments:
    """The moments of these arguments of `moments`; with keep_last, `paths_kept` has the last states and statuses."""
    result = None
    try:
        given = check_observables(observables)
        setup = make_setup(model, in_python=are_in_python(given), **options)
        setup.warn_of_repeated_noise()
        wanted = requests.check_observers(observers)
        requests.warn_of_unsaid(wanted, beside=bool(given))
        if groups is not None and setup.options.first_path % 256:
            raise InvalidArgumentError(
                f"first_path = {setup.options.first_path} does not begin a shard: moments need a multiple of 256"
            )
        kept = KeptPaths(setup, last=True) if keep_last else None
        result = Moments(setup, given, wanted, groups_of(groups, model, setup.paths), kept)
        result.fill(given, progress)
    except BaseException as stop:
        carry(stop, lambda: filled(result))
        raise
    for doubt in result.doubts():
        checks.warn(doubt, NotANumberWarning)
    return result


def try_out(model: Model, observables: dict[str, Observable], **options: Any) -> None:
    """Refuse observables that return no number for each path near the initial state; no step is taken."""
    with np.errstate(all="ignore"):
        setup = make_setup(model, **{**options, "steps": 0, "save_every": 1}, in_python=are_in_python(observables))
        Moments(setup, observables).fill(observables, False)
