# SPDX-License-Identifier: BSD-3-Clause
"""Fits of parameters and initial states to data, by least squares with exact derivatives of every step."""

from __future__ import annotations

import dataclasses
import html
from collections.abc import Mapping, Sequence
from typing import Any, Unpack

import numpy as np

from ..errors import DoubtfulRunWarning, IncompatibleError, InvalidArgumentError, SymsdeError, WrongShapeError
from ..model.definition import Model, require_model
from ..model.formulas.path_formula import PathFormula
from ..model.formulas.wide import Positions, wide_model
from ..native import checks, files
from ..show import plot, tables
from .fit_data import Data, read_data, steps_of
from .gradient import names_of, refuse_compensated
from .options import RunOptions
from .report import make_report
from .setup import Setup, make_setup
from .tangent import take_vectors

_SAME = 1e-10  #: singular values of scaled derivatives below this share of the largest count as zero


@dataclasses.dataclass(frozen=True)
class Fit:
    """Fitted values with their standard errors, to first order in the errors of data and means.

    `values["k"]` is a number, or (site,) where the model has one for each site; `values["q0"]` and `values["p0"]` have
    the shape (dof,). The data may be means over paths or their variances: `data["q"]`, `fitted["q"]` and
    `fitted_se["q"]` are (time,), NaN where none was measured.
    """

    values: dict[str, Any]  #: name -> fitted value
    se: dict[str, Any]  #: name -> standard error, the root of the sum of squares of both parts
    se_data: dict[str, Any]  #: its part from errors of the data
    se_paths: dict[str, Any]  #: its part from the number of simulated paths
    columns: tuple[str, ...]  #: names of single fitted numbers, in the order of `covariance`
    covariance: np.ndarray  #: (column, column)
    chi2: float  #: sum of squares of residuals over errors; of plain residuals if no errors are known
    freedom: int  #: number of data less that of fitted numbers
    errors_from: str  #: where errors of the data come from: "errors", "series" or "residuals"
    t: np.ndarray  #: (time,)
    data: dict[str, np.ndarray]
    errors: dict[str, np.ndarray]  #: standard errors of the data
    fitted: dict[str, np.ndarray]  #: means and variances of the fitted model
    fitted_se: dict[str, np.ndarray]  #: their standard errors, as those of the fitted values make them
    at_bound: tuple[str, ...]  #: columns that ended at a bound, whose errors mean little
    converged: bool
    evaluations: int  #: runs of the model
    model: Model  #: with the fitted parameters
    title: str

    def plot(self, path=None, *, ax=None, of: Any = None):
        """Draw the data with two standard errors, and the fitted means with a band of two.

        of: names of the data, by default all. A figure is written if a path is given; or draw into `ax`.
        """
        names = plot.draw.chosen("of", of, list(self.data)) or list(self.data)
        rows = [(x, self.data[x], self.errors[x], self.fitted[x], self.fitted_se[x]) for x in names]
        return plot.fit(self.title, self.t, rows, (path, ax))

    def _table(self) -> tuple[list[str], list[list[str]]]:
        """Head and rows: a fitted number each."""
        flat = [np.concatenate([*map(np.atleast_1d, x.values())]) for x in (self.values, self.se)]
        flat += [np.concatenate([*map(np.atleast_1d, x.values())]) for x in (self.se_data, self.se_paths)]
        rows = [
            [name, f"{x:.8g}{' (bound)' if name in self.at_bound else ''}", *(f"{e:.2g}" for e in errors)]
            for name, x, *errors in zip(self.columns, *flat, strict=True)
        ]
        return ["", "value", "error", "of data", "of paths"], rows

    def _told(self) -> str:
        """One line about the whole fit."""
        what = "sum of squares" if self.errors_from == "residuals" else "chi2"
        end = "" if self.converged else ", NOT converged"
        return (
            f"fit of {self.title}: {what} {self.chi2:.4g}, {self.freedom} degrees of freedom, errors of data from "
            f"{self.errors_from}, {checks.counted(self.evaluations, 'run')}{end}"
        )

    def __repr__(self) -> str:
        """A table of values with errors."""
        return f"{self._told()}\n{tables.terminal(*self._table(), numbers=(1, 2, 3, 4))}"

    def _repr_html_(self) -> str:
        """The table in notebooks."""
        return f"<p>{html.escape(self._told())}</p>\n{tables.notebook(*self._table())}"


@checks.hinted(*RunOptions.__annotations__)
def fit(
    model: Model,
    data: Mapping[str, Any],
    wrt: str | Sequence[str],
    *,
    t: Any,
    q0: Any,
    p0: Any,
    step: float,
    errors: Any = None,
    bounds: Mapping[str, Any] | None = None,
    tolerance: float = 1e-10,
    max_evaluations: int = 100,
    **options: Unpack[RunOptions],
) -> Fit:
    """Fit parameters, and the initial state, to measured means or series by least squares.

        found = ss.fit(model, {"q": means, "var(q)": variances}, ["k", "sigma"], t=times,
                       errors={"q": 0.01, "var(q)": 0.02}, q0=1.0, p0=0.0, step=0.05, paths=2000)
        found.values["k"], found.se["k"]

    The sum over data of ((m(theta) - d)/e)^2 is minimised, where m is the mean of a formula over the simulated paths,
    or its variance, d the datum and e its standard error. All values of theta have the noise of the seed, so m is a
    smooth function, whose derivatives are those of every step (`tangent`).

    - model: its parameters are where the search begins, for those in wrt
    - data: formula of the state, as "q", "q_1*p_2" or "p**2/2", with values of its mean, (time,), NaN where none was
      measured; or measured series, (time, series), whose means and errors are computed; "var(q)" means the variance
    - wrt: names of parameters, "q0" and "p0", one state of all paths
    - t: times of the data, (time,), at t0 or whole steps after it
    - errors: standard errors of the data (independent): name -> number or (time,), or a number for all; None: data
      are weighted alike, and their error is taken from the residuals. Series bring their own
    - bounds: name -> (lowest, highest), None for no bound, as {"sigma": (0.01, None)}
    - tolerance: relative change of theta, and of the sum of squares, at which the search ends
    - max_evaluations: most runs of the model
    - the other arguments are those of `simulate`; a model with noise needs two paths at least

    `se_data` follows from the errors of the data: with J = dm/dtheta and A = (J^T W J)^-1 J^T W, W = diag(1/e^2), it
    is the root of the diagonal of A C A^T, C the covariance of the data. `se_paths` comes from the finite number of
    paths: C is there that of the simulated means. `se` has both. Needs scipy, whose `least_squares` searches.

    Bad input raises a ValueError (`symsde.errors`). Models and schemes without exact derivatives are refused as in
    `gradient`, and so are data that do not determine the values of wrt.
    """
    optimize = files.optional("scipy.optimize", "fit")
    require_model(model)
    names, _ = names_of(wrt, model)
    if not names:
        raise InvalidArgumentError('wrt is empty: give names, as ["sigma", "q0"]')
    refuse_compensated(options)
    for name, why in (("save_every", "data have their own times, t"), ("increments", "the noise is that of the seed")):
        if name in options:
            raise InvalidArgumentError(f"{name} has no meaning here: {why}; leave it out")
    found = read_data(data, t, errors)
    setup = make_setup(model, q0=q0, p0=p0, step=step, steps=1, **options)
    problem = _Problem(setup, found, names)
    most = checks.integer("max_evaluations", max_evaluations, (1, 10**6))
    tolerance = checks.finite("tolerance", tolerance)
    if not 1e-15 <= tolerance < 1:
        raise InvalidArgumentError(f"tolerance = {tolerance:g} is not allowed: give a number from 1e-15 to below 1")
    low_high = problem.bounds(bounds)
    with checks.unwarned():
        problem.begin()
        outcome = optimize.least_squares(
            problem.residuals,
            problem.start,
            jac=problem.jacobian,
            bounds=low_high,
            x_scale="jac",
            ftol=tolerance,
            xtol=tolerance,
            gtol=1e-15,
            max_nfev=most,
        )
        answer = problem.told(outcome)
    for doubt in problem.doubts:
        checks.warn(doubt, DoubtfulRunWarning)
    if not answer.converged:
        checks.warn(f"the fit did not converge in {most} evaluations: give a better start, or more", DoubtfulRunWarning)
    return answer


class _Problem:
    """Residuals of all data and their derivatives, for values of the fitted numbers."""

    def __init__(self, setup: Setup, data: Data, names: list[str]):
        model, self.setup, self.data = setup.model, setup, data
        if model.nnoise and setup.paths < 2:
            raise InvalidArgumentError("paths = 1 tells no mean of a model with noise: give more, as paths=1000")
        self.names = names
        self.known = [x for x in self.names if x in model.parameters]
        self.columns, self.places, start = [], {}, []
        for name in self.names:
            value = self._start_of(name)
            self.places[name] = slice(len(start), len(start) + value.size)
            start.extend(value)
            several = value.size > 1
            self.columns += [f"{name}[{i}]" for i in range(value.size)] if several else [name]
        self.start = np.array(start)
        self.after = steps_of(data.t, setup.options.t0, setup.options.step)
        self.count = int(data.there.sum())
        if self.count < len(start):
            raise InvalidArgumentError(
                f"data hold {checks.counted(self.count, 'number')}, fewer than the {len(start)} that are fitted: "
                "give more data, or fit fewer"
            )
        checks.room((self.count, setup.paths), "values of the data on each path", do="take fewer paths or data")
        self.weights = self._weights()
        self.evaluations, self._last = 0, None
        self.doubts: tuple[str, ...] = ()  #: about the last run

    def _start_of(self, name: str) -> np.ndarray:
        """Where the search begins."""
        if name not in ("q0", "p0"):
            value = self.setup.model.parameters[name]
            if isinstance(value, tuple):
                return np.array(value)
            if np.ndim(value):
                raise InvalidArgumentError(f"the parameter {name} differs from path to path: give it one value to fit")
            return np.array([float(value)])
        state = getattr(self.setup, name)
        if state.shape[1] > 1:
            raise WrongShapeError(f"{name} has shape {state.shape}: give a number or (dof,), as all paths begin there")
        return state[:, 0]

    def _weights(self) -> np.ndarray:
        """1/e of each datum; data without spread count like the most exact ones with some."""
        if self.data.errors is None:
            return np.ones(self.count)
        e = self.data.errors
        least = [row[row > 0].min() if (row > 0).any() else 1.0 for row in e]
        return 1 / np.maximum(e, np.array(least)[:, np.newaxis])[self.data.there]

    def bounds(self, given: Any) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest values, around the start."""
        low, high = np.full(self.start.size, -np.inf), np.full(self.start.size, np.inf)
        for name, pair in checks.table("bounds", {} if given is None else given).items():
            if name not in self.places:
                raise InvalidArgumentError(
                    f"bounds holds {checks.shown(name)}, which is not fitted: wrt has {self.names}"
                )
            two = checks.items(pair)
            if two is None or len(two) != 2:
                raise InvalidArgumentError(f"bounds of {name} = {checks.shown(pair)}: give a pair, as (0.01, None)")
            for ends, x in ((low, two[0]), (high, two[1])):
                if x is not None:
                    ends[self.places[name]] = checks.number(f"bound of {name}", x)
            here = self.places[name]
            if not ((low[here] < self.start[here]) & (self.start[here] < high[here])).all():
                raise InvalidArgumentError(
                    f"bounds of {name} = {checks.shown(pair)} do not hold its start, {self.start[here]}: give a start "
                    "between them"
                )
        return low, high

    def begin(self) -> None:
        """Refuse a start from which the model cannot be run."""
        if not np.isfinite(self._at(self.start)[0]).all():
            raise IncompatibleError(
                "paths failed, or derivatives are not finite, where the search begins: take a smaller step, or begin "
                "with other values"
            )

    def residuals(self, theta: np.ndarray) -> np.ndarray:
        """(m - d)/e."""
        return self._at(theta)[0]

    def jacobian(self, theta: np.ndarray) -> np.ndarray:
        """Derivatives of the residuals."""
        return self._at(theta)[1]

    def _at(self, theta: np.ndarray) -> tuple[np.ndarray, ...]:
        """Residuals, their derivatives, and parts of each path in them; those of the last theta are kept."""
        if self._last is None or not np.array_equal(self._last[0], theta):
            self.evaluations += 1
            self._last = (theta.copy(), self._run(theta))
        return self._last[1]

    def model_at(self, theta: np.ndarray) -> Model:
        """The model with these parameters."""
        parts = self._named(theta)
        values = {name: parts[name] for name in self.known}
        return self.setup.model.with_parameters(**values) if values else self.setup.model

    def _run(self, theta: np.ndarray) -> tuple[np.ndarray, ...]:
        """Take the state and its derivatives from one time of the data to the next."""
        data, size, paths = self.data, theta.size, self.setup.paths
        m = np.full(data.values.shape, np.nan)
        slope = np.full((*data.values.shape, size), np.nan)
        parts = np.zeros((*data.values.shape, paths))
        nothing = np.full(self.count, np.nan), np.full((self.count, size), np.nan), np.zeros((self.count, paths))
        try:
            model = self.model_at(theta)
            wide = wide_model(model, self.known, thirds=self.setup.kicks)
        except SymsdeError:
            if self.evaluations == 1:
                raise
            return nothing
        setup, v = self._begin_at(theta, model, wide[1])
        functions = [PathFormula(model, row.formula, wide[1]) for row in data.rows]
        before = 0
        for j, now in enumerate(self.after):
            if now > before:
                here = setup.from_here(
                    self.setup.options.first_step + before, int(now - before), int(now - before), _state(setup)
                )
                found = take_vectors(here, wide, v, progress=False)
                if not before:
                    self.doubts = tuple(make_report(found.report).warnings)
                if found.status.any():
                    return nothing
                v, before = found.v, now
                setup = dataclasses.replace(here, q0=found.q, p0=found.p)
            q, p = (checks.full(x, paths)[np.newaxis] for x in (setup.q0, setup.p0))
            for i, (row, function) in enumerate(zip(data.rows, functions, strict=True)):
                if not data.there[i, j]:
                    continue
                f, fq, fp, ftheta = function(data.t[j : j + 1], q, p)
                along = np.einsum("kil,il->kl", v, np.concatenate((fq[0], fp[0])))
                along[v.shape[0] - len(wide[1]) :] += ftheta
                mean, part = row.told(f[np.newaxis])
                m[i, j], parts[i, j] = mean[0], part[0]
                slope[i, j] = along[self._order(wide[1])] @ row.weights(f)
        there, w = data.there, self.weights
        if not np.isfinite(slope[there]).all():
            return nothing
        return (
            w * (m - data.values)[there],
            w[:, np.newaxis] * slope[there],
            w[:, np.newaxis] * parts[there],
        )

    def _begin_at(self, theta: np.ndarray, model: Model, positions: Positions) -> tuple[Setup, np.ndarray]:
        """The setup that begins with theta, and tangent vectors there: those of q0, of p0, of parameters."""
        n = model.ndof
        states = {x: theta[self.places[x]][:, np.newaxis] for x in ("q0", "p0") if x in self.places}
        rows = [np.eye(2 * n)[k * n : (k + 1) * n] for k, x in enumerate(("q0", "p0")) if x in states]
        v = np.concatenate((*rows, np.zeros((len(positions), 2 * n))))
        setup = dataclasses.replace(self.setup, model=model, **states)
        return setup, np.repeat(v[:, :, np.newaxis], self.setup.paths, axis=2)

    def _order(self, positions: Positions) -> list[int]:
        """Places of the fitted numbers among tangent vectors."""
        n, first, found = self.setup.model.ndof, {}, []
        for x in ("q0", "p0"):
            if x in self.places:
                first[x] = n * len(first)
        behind = n * len(first)
        for name in self.names:
            if name in first:
                found += range(first[name], first[name] + n)
            else:
                found += [behind + k for k in positions.places([name])]
        return found

    def told(self, outcome: Any) -> Fit:
        """The answer with its errors."""
        r, J, parts = self._at(outcome.x)
        data, size = self.data, self.start.size
        turn = self._inverse(J)
        freedom = self.count - size
        squares = float(r @ r)
        spread = data.covariance(turn * self.weights)
        kind = "residuals" if spread is None else "series" if data.series else "errors"
        if spread is None:
            scale = squares / freedom if freedom else np.nan
            spread = scale * (turn @ turn.T)
        paths = parts.shape[1]
        of_paths = turn @ parts
        noise = of_paths @ of_paths.T / (paths * max(paths - 1, 1))
        both = spread + noise
        m, band = np.full((2, *data.values.shape), np.nan)
        m[data.there] = r / self.weights + data.values[data.there]
        slopes = J / self.weights[:, np.newaxis]
        band[data.there] = np.sqrt(np.einsum("ka,ab,kb->k", slopes, both, slopes))
        errors = np.sqrt(squares / freedom) if freedom else np.nan
        table = data.errors if data.errors is not None else np.full(data.values.shape, errors)
        by_row = {"data": data.values, "fitted": m, "fitted_se": band, "errors": table}
        by_row = {key: {row.name: x[i] for i, row in enumerate(data.rows)} for key, x in by_row.items()}
        model = self.model_at(outcome.x)
        return Fit(
            values=self._named(outcome.x),
            se=self._named(np.sqrt(np.diag(both))),
            se_data=self._named(np.sqrt(np.diag(spread))),
            se_paths=self._named(np.sqrt(np.diag(noise))),
            columns=tuple(self.columns),
            covariance=both,
            chi2=squares,
            freedom=freedom,
            errors_from=kind,
            t=data.t,
            at_bound=tuple(x for x, y in zip(self.columns, outcome.active_mask, strict=True) if y),
            converged=bool(outcome.status > 0),
            evaluations=self.evaluations,
            model=model,
            title=f"{model.name} by {self.setup.scheme.name}",
            **by_row,
        )

    def _named(self, x: np.ndarray) -> dict[str, Any]:
        """Values by name."""
        of_sites = {name for name, value in self.setup.model.parameters.items() if isinstance(value, tuple)}
        several = {"q0", "p0"} | of_sites
        return {name: x[at] if name in several else float(x[at][0]) for name, at in self.places.items()}

    def _inverse(self, J: np.ndarray) -> np.ndarray:
        """(J^T J)^-1 J^T; refuses directions that change no datum."""
        size = np.linalg.norm(J, axis=0)
        for name, x in zip(self.columns, size, strict=True):
            if x == 0:
                raise IncompatibleError(f"{name} changes none of the data: leave it out of wrt, or give other data")
        left, singular, right = np.linalg.svd(J / size, full_matrices=False)
        if singular[-1] < _SAME * singular[0]:
            mixed = [x for x, y in zip(self.columns, right[-1], strict=True) if abs(y) > 0.1]
            raise IncompatibleError(
                f"the data do not determine {', '.join(mixed)}: some change of these together changes none of the "
                "data; fit fewer of them, or give other data"
            )
        return (right.T / singular) @ left.T / size[:, np.newaxis]


def _state(setup: Setup) -> tuple[np.ndarray | None, ...]:
    return setup.q0, setup.p0, setup.q0_low, setup.p0_low
