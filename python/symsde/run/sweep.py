# SPDX-License-Identifier: BSD-3-Clause
"""Sweeps: means for many values of parameters, whose paths run side by side, as many at a time as fit into memory."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Mapping
from typing import Any, Unpack

import numpy as np

from ..errors import (
    DoubtfulRunWarning,
    IncompatibleError,
    InvalidArgumentError,
    PathsFailedWarning,
    WrongShapeError,
)
from ..model.definition import Model, require_model
from ..native import abi, checks, files
from ..native.progress import Progress, told_by
from ..schemes import as_scheme
from ..show.values import Values
from .groups import Grid, GroupedMoments, Groups, refuse_sites
from .kept_paths import KeptPaths
from .moments import Moments
from .observers.observables import (
    Observable,
    are_in_python,
    check_observables,
    described,
    refuse_coordinates,
)
from .options import RunOptions
from .report import Report, warn_of_growth
from .setup import Setup, make_setup

_NUMBERS = 2**23  #: numbers of the saved paths of some values that are run at once
_PATHS = 2**22  #: paths of some values that are run at once, if only their means are kept


class Sweep(GroupedMoments):
    """Means, variances and standard errors of means for each value of some parameters, at each saved time.

    `mean_q`, `var_q` and `se_mean_q` have the shape (time, dof, ..), like the arrays of p; those of the energy, and
    `n_ok`, have the shape (time, ..). The dots stand for one axis for each parameter, or for a single axis with zip.
    """

    status: np.ndarray  #: (.., path), 0 = ok
    q: np.ndarray | None  #: (time, dof, .., path) if paths are kept
    p: np.ndarray | None
    report: Report  #: report of the first run; failed, grown and stopped count the paths of all runs

    def __init__(self, setup: Setup, grid: Grid, paths: int, observables: Mapping[str, Observable], *, keep: bool):
        """Allocate the results."""
        self._setup, self.paths, self._observables = setup, paths, described(observables)
        refuse_coordinates(self._observables, setup.model)
        values = Values.of(setup.model.coordinates, setup.model.traits.has_value, tuple(self._observables))
        super().__init__(self, grid, values, setup.ntime)
        ntime, count, ndof = setup.ntime, grid.count, setup.model.ndof
        if keep:
            checks.room((2, ntime, ndof, count, paths), "the paths of a sweep (q and p; time, dof, point, path)")
        self._status = np.full((count, paths), -1, np.int32)
        self._q, self._p = (np.full((ntime, ndof, count, paths), np.nan) for _ in "qp") if keep else (None, None)

    def run(self, setup: Setup, functions: Mapping, points: slice, tell: Progress) -> Report:
        """Run the paths of some values, and store the moments of values whose paths have all been run."""
        count, status = points.stop - points.start, self._status[points]
        kept = KeptPaths(setup, saved=self._q is not None, status=status.reshape(-1))
        found = Moments(setup, functions, None, Groups.even(count, self.paths), kept)
        found.fill(functions, tell)
        sums, whole = found.sums_by_group(), slice(None)
        if found.report.stopped:
            was_stopped = (status == abi.STOPPED).any(axis=1)
            whole = np.flatnonzero(~was_stopped)
            status[was_stopped], points = -1, points.start + whole
        self.t = found.t
        self.put(points, sums[whole])
        for mine, theirs in ((self._q, kept.q), (self._p, kept.p)):
            if mine is not None:
                mine[:, :, points] = theirs.reshape(*theirs.shape[:2], count, -1)[:, :, whole]
        return found.report

    def finish(self) -> Sweep:
        """Make the results available as attributes by their names."""
        super().finish()
        self.status = self._status.reshape(*self._grid.shape, self.paths)
        shape = self._grid.shape
        self.q, self.p = (x if x is None else x.reshape(*x.shape[:2], *shape, -1) for x in (self._q, self._p))
        return self

    def attributes(self) -> dict[str, str]:
        """Origin of the sweep as text for files."""
        told = {name: x.tolist() for name, x in self.parameters.items()}
        return {**self._setup.attributes(), "sweep": json.dumps(told), "paths_of_a_value": str(self.paths)}

    @property
    def title(self) -> str:
        """Model and scheme."""
        return f"{self._setup.model.name} by {self._setup.scheme.name}"

    def __repr__(self) -> str:
        """One line."""
        return (
            f"<sweep of {self.title}: {self._grid.counted()}, {checks.counted(self.paths, 'path')} each, "
            f"{checks.counted(len(self.t), 'time')}, {self.report.failed} failed>"
        )

    def _variables(self) -> files.Variables:
        dims = self.dims
        found = {**super()._variables(), "status": ((*dims, "path"), self.status)}
        for letter, x in (("q", self.q), ("p", self.p)):
            if x is not None:
                found[letter] = (("time", "dof", *dims, "path"), x)
        return found


@checks.hinted(*RunOptions.__annotations__)
def sweep(
    model: Model | Callable[..., Model],
    values: Mapping[str, Any],
    *,
    q0: Any,
    p0: Any,
    step: float,
    steps: int,
    paths: int = 1,
    zip: bool = False,
    same_noise: bool = False,
    keep_paths: bool = False,
    observables: dict[str, Observable] | None = None,
    progress: Progress = False,
    **options: Unpack[RunOptions],
) -> Sweep:
    """Integrate `paths` paths for each value of some parameters, and keep means by value.

        found = ss.sweep(model, {"sigma": np.linspace(0, 1, 1000)}, q0=1.0, p0=0.0, step=0.05, steps=200, paths=100)
        found.mean_q, found.se_mean_q        # (time, dof, value)

    - model: from formulas or built in, whose parameters go by path, so that all values are run side by side; or a
      function that returns the model of its arguments, as `ss.models.fpu_chain`: values are run one after the other, as
      they are where parameters stand in formulas of forces or of damping, or are masses in a heat bath, and by schemes
      that halve steps for areas, if `area_time` is not given
    - values: name -> values of a parameter, (value,) each. All combinations are run; with zip=True the first values of
      all, then the second, ..
    - paths: of each value. Value k, counted with the last parameter fastest, has the paths first_path + k*paths .. ;
      with same_noise=True every value has the noise of the first: their differences have far smaller errors
    - q0, p0: a number, (dof,), or (dof, path) for the paths of each value
    - keep_paths: keep q and p, (time, dof, .., path), too
    - observables and the other arguments are those of `moments`; increments cannot be prescribed

    A path has the bits of a run of it alone whose values are arrays of one, or numbers where values are run one after
    the other. Failed paths are left out of means.
    A progress function that returns True ends the sweep: values that were not reached have n_ok = 0 and NaN.
    """
    bar, tell = told_by(progress)
    grid = _grid(values, checks.flag("zip", zip))
    functions = check_observables(observables)
    if bound := [name for name, x in (observables or {}).items() if hasattr(x, "of_model")]:
        raise IncompatibleError(
            f"observable {bound[0]} has the parameters of one model, and a sweep has many: take moments for each "
            "value, or give a formula"
        )
    paths = checks.integer("paths", paths, (1, 2**47))
    same_noise, keep = checks.flag("same_noise", same_noise), checks.flag("keep_paths", keep_paths)
    if options.pop("increments", None) is not None:
        raise IncompatibleError("increments are those of one run: give a seed, and same_noise=True for the same noise")
    points, count = grid.flat(), grid.count
    options |= {"q0": q0, "p0": p0, "step": step, "steps": steps, "in_python": are_in_python(functions)}
    many = isinstance(model, Model)
    if not many and not callable(model):
        require_model(model)
    if many:
        refuse_sites(model, points)
        if chained := [x for x in points if x in model.parameters and getattr(model, "_chain", None)]:
            names = ", ".join(chained)
            raise IncompatibleError(
                f"{names} of model {model.name} cannot differ from path to path, since it has sums over sites: give a "
                f"function that makes the model of a value, as lambda {names}: model.with_parameters("
                + ", ".join(f"{x}={x}" for x in chained)
                + ")"
            )
        if not _go_by_path(model, points) or _halves_steps(model, options):
            many, model = False, model.with_parameters

    def made(here: slice) -> Model:
        """The model of some values, one for as many neighbouring paths each."""
        if many:
            return model.with_parameters(**{name: x[here] for name, x in points.items()})
        found = model(**{name: float(x[here.start]) for name, x in points.items()})
        require_model(found)
        return found

    begun = make_setup(model if many and not model.paths else made(slice(0, 1)), paths=paths, **options)
    result = Sweep(begun, grid, paths, functions, keep=keep)
    most = _NUMBERS // (2 * begun.ntime * begun.model.ndof) if keep else _PATHS
    together = max(1, most // paths) if many else 1
    done, total, doubts, report, stopped = 0, count * paths * begun.options.steps, {}, None, False
    counts = dict.fromkeys(("failed", "grown"), 0)
    try:
        for k in range(0, count, together):
            here = slice(k, min(k + together, count))
            setup = _setup(made(here), options, paths, here, same_noise=same_noise)
            shown = (lambda now, _, b=done: tell(b + now, total)) if tell else False
            with checks.unwarned():
                told = result.run(setup, functions, here, shown)
            report, counts = report or told, {name: n + getattr(told, name) for name, n in counts.items()}
            if told.stopped:
                stopped = True
                break
            done += setup.paths * setup.options.steps
            doubts |= dict.fromkeys(told.warnings)
    finally:
        if bar:
            bar.close()
    return _told(result, dataclasses.replace(report, **counts), doubts, stopped=stopped)


def _go_by_path(model: Model, points: Mapping[str, np.ndarray]) -> bool:
    """Whether the model takes arrays of these parameters, which are refused by some where values differ."""
    try:
        model.with_parameters(**{name: np.sort(x)[[0, -1]] for name, x in points.items()})
    except IncompatibleError:
        return False
    except WrongShapeError:  # other parameters have arrays already
        return True
    return True


def _halves_steps(model: Model, options: Mapping[str, Any]) -> bool:
    """Whether steps are halved for areas, by a time scale that values change; arrays of other parameters stay."""
    info, traits = as_scheme(options.get("scheme", "midpoint")).info, model.traits
    crosses = model.nnoise > 1 and not (traits.additive or traits.position_noise)
    given = options.get("area_time") or options.get("areas", "path") != "path"
    return info.uses_areas and info.law == "Gaussian" and crosses and not given and not model.paths


def _told(result: Sweep, report: Report, doubts: dict[str, None], *, stopped: bool) -> Sweep:
    """The result with its report, and warnings about it."""
    missing = int(np.count_nonzero(result._status < 0)) if stopped else 0
    failed = int(np.count_nonzero(result._status > 0)) if stopped else report.failed
    result.report = dataclasses.replace(report, failed=failed, stopped=missing)
    if failed:
        checks.warn(
            f"{checks.counted(failed, 'path')} failed: they are left out of means; see status and n_ok",
            PathsFailedWarning,
        )
    warn_of_growth(report.grown)
    for doubt in doubts:
        checks.warn(doubt, DoubtfulRunWarning)
    return result.finish()


def _grid(values: Mapping[str, Any], is_zip: bool) -> Grid:
    """The values as arrays (value,)."""
    given = checks.table("values", values)
    if not given:
        raise InvalidArgumentError("values is empty: give the values of a parameter, as {'sigma': [0.1, 0.2, 0.3]}")
    arrays = {}
    for name, x in given.items():
        array = np.array(np.atleast_1d(checks.real_array(f"values of {name}", x)))
        if array.ndim != 1 or not array.size:
            raise WrongShapeError(f"values of {name} have shape {array.shape}: give (value,), one number at least")
        if not np.isfinite(array).all():
            raise InvalidArgumentError(f"values of {name} are not all finite: give finite numbers")
        arrays[checks.name_of("name of a parameter", name)] = array
    sizes = {name: x.size for name, x in arrays.items()}
    if is_zip and len(set(sizes.values())) > 1:
        told = ", ".join(f"{size} of {name}" for name, size in sizes.items())
        raise WrongShapeError(f"zip=True takes as many values of each parameter, and there are {told}")
    return Grid(arrays, is_zip)


def _setup(model: Model, options: Mapping[str, Any], paths: int, points: slice, *, same_noise: bool) -> Setup:
    """The setup of the run of some values."""
    n, here = points.stop - points.start, dict(options)
    first = checks.integer("first_path", here.pop("first_path", 0), (0, 2**47))
    here["first_path"] = first + (0 if same_noise else points.start * paths)
    for name in ("q0", "p0", "q0_low", "p0_low"):
        array = None if here.get(name) is None else np.asarray(here[name])
        if array is not None and array.ndim == 2 and array.shape[1] > 1:
            here[name] = np.tile(array, n)
    setup = make_setup(model, paths=n * paths, row_paths=paths if model.paths else 1, **here)
    if same_noise and n > 1:
        setup.options.noise_paths = paths
    return setup
