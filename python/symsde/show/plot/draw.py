# SPDX-License-Identifier: BSD-3-Clause
"""Figures of paths, moments and observers."""

from __future__ import annotations

import functools
import textwrap
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...errors import InvalidArgumentError
from ...native import checks
from ...native.checks import counted
from .. import look
from ..values import Values, chosen
from .data import Means, Paths, within

MOST_PATHS = 50
_WIDTH, _HEIGHT, _ALONE = 6.0, 2.4, 3.4  # inches; heights of one panel among several, and of a single panel
_ONE_COLUMN = 4  # most panels in one column; more panels are in two columns
_TITLE = 11  # characters of a title per inch
_FEW = 200  # most saved times that are all marked
_JUMP = 0.1  # share of a phase plot's extent: points farther apart are not joined
CHAIN = 8  # degrees of freedom from which a map shows more than curves


@dataclass(frozen=True)
class Curve:
    """One line with two bands: two standard errors, and the standard deviation."""

    label: str
    x: np.ndarray
    y: np.ndarray
    error: np.ndarray | None = None
    spread: np.ndarray | None = None


def finish(panels: Sequence[Callable], title: str, path: object = None, ax: object = None):
    """A figure of panels, each a function of axes; written if a path is given. With `ax`, one axes or one for each
    panel, the panels are drawn there, and the result is the figure of these axes."""
    target, given = look.target(path), look.axes_of(ax, len(panels), path)
    columns = 1 if len(panels) <= _ONE_COLUMN else 2
    rows = -(-len(panels) // columns)
    width = _WIDTH if columns == 1 else 1.5 * _WIDTH
    height = _HEIGHT if len(panels) > 1 else _ALONE
    with look.drawing(target, width, 0.5 + height * rows, 150, axes=given) as page:
        if given is None:
            all_axes = list(page.subplots(rows, columns, squeeze=False).ravel())
            for axes in all_axes[len(panels) :]:
                axes.remove()
            shown = all_axes[: len(panels)]
            texts = [page.suptitle(whole(title, width), fontsize=9)]
        else:
            shown, texts = given, []
            given[0].set_title(whole(title, given[0].get_window_extent().width / page.dpi), fontsize=9)
        for axes, panel in zip(shown, panels, strict=True):
            panel(axes)
        take_names_as_they_are(texts, shown)
    return page


def whole(title: str, inches: float) -> str:
    """A title on as many lines as needed."""
    return textwrap.fill(title, max(20, round(_TITLE * inches)))


def take_names_as_they_are(texts: list[Any], given: Sequence[Any]) -> None:
    """Switch off mathematics in labels: users' names may contain a $."""
    for axes in given:
        texts += [axes.xaxis.label, axes.yaxis.label, axes.title]
        texts += axes.get_legend().get_texts() if axes.get_legend() else []
    for text in texts:
        text.set_parse_math(False)


# ---- saved paths ---------------------------------------------------------------------------------------------------


def of_run(data: Paths, what: str, of: object, most: int) -> tuple[list[Callable], str]:
    """Panels and title: values along time, planes of two values, the energy, or a map."""
    what = what or ("paths" if of is not None or data.names.ndof < CHAIN else "map")
    checks.choice("what", what, ["paths", "phase", "trajectory", "energy", "map"])
    shown = which_paths(data, most)
    title = f"{data.title}, {len(shown)} of {counted(len(data.path), 'path')}"
    if what == "map":
        first = shown[0]
        tables = {"q": data.q[:, :, first], "p": data.p[:, :, first]}
        return _maps(data, tables, of), f"{data.title}, path {data.path[first]} of {len(data.path)}"
    if what == "energy":
        names = _energy_of(data.names, of, "is not known here: give the folder of the run, or a model with value")
    else:
        names = data.names.chosen("of", of)
    if what in ("phase", "trajectory"):
        pairs = [pair_of(data.names, names)] if what == "trajectory" else _planes(data.names, names)
        return [_plane(data, pair, shown, i == 0) for i, pair in enumerate(pairs)], title
    names = names or [name for i in _few(data.names.ndof) for name in (data.names.q[i], data.names.p[i])]
    return [_along(data, name, shown, i == 0) for i, name in enumerate(names)], title


def _few(ndof: int) -> range:
    """The degrees of freedom that are drawn if no names are given: all, but only the first of a chain."""
    return range(ndof if ndof < CHAIN else 1)


def _energy_of(values: Values, of: object, why_not: str) -> list[str]:
    """The panel of the energy."""
    if not values.has_energy:
        raise InvalidArgumentError(f"the energy {why_not}")
    if (values.chosen("of", of) or ["energy"]) != ["energy"]:
        raise InvalidArgumentError(
            f"of = {checks.shown(of)} beside what = 'energy', which draws the energy alone: leave out one of the two"
        )
    return ["energy"]


def _planes(values: Values, names: Sequence[str] | None) -> list[tuple[str, str]]:
    """Each coordinate with its momentum, as planes."""
    if names is None:
        return [(values.q[i], values.p[i]) for i in _few(values.ndof)]
    degrees = [values.names.index(name) % values.ndof if name != "energy" else None for name in names]
    if None in degrees:
        raise InvalidArgumentError(
            "of = 'energy' has no momentum to draw it against: give what = 'trajectory' and two values"
        )
    return [(values.q[i], values.p[i]) for i in dict.fromkeys(degrees)]


def pair_of(values: Values, names: Sequence[str] | None) -> tuple[str, str]:
    """Two values for a plane; by default the first two coordinates, or the coordinate with its momentum."""
    pair = names or ((values.q if values.ndof > 1 else values.names)[:2])
    if len(pair) != 2:
        raise InvalidArgumentError(
            f"of = {checks.shown(list(pair))}: a trajectory is drawn in a plane: give two values, as in "
            f"of={list(values.names[:2])}"
        )
    return tuple(pair)


def which_paths(data: Paths, most: int) -> np.ndarray:
    """Numbers of the paths to draw: the first among the paths that are ok at some time."""
    checks.integer("most", most, (1, 2**20))
    there = np.flatnonzero(np.isfinite(data.q).all(axis=1).any(axis=0))
    if there.size == 0:
        raise InvalidArgumentError(
            "no path has a finite value: there is nothing to draw (values above 1e300 are left out); "
            "see status and failed_step"
        )
    return there[:most]


def _maps(data: Paths | Means, tables: dict[str, np.ndarray], of: object, kind: str = "") -> list[Callable]:
    """A panel for each table, (time, dof), in colours over time and degree of freedom: red above zero, blue below."""
    t = data.t

    def panel(axes: Any, name: str) -> None:
        table = tables[name]
        end = np.nanmax(np.abs(table), initial=0.0) or 1.0
        times = t if len(t) > 1 else np.array([t[0], t[0] + 1])  # a mesh needs a nonzero extent
        mesh = axes.pcolormesh(
            times, 1 + np.arange(table.shape[1]), np.broadcast_to(table, (len(times), table.shape[1])).T,
            shading="nearest", cmap="RdBu_r", vmin=-end, vmax=end, rasterized=True,
        )  # fmt: skip
        axes.grid(visible=False)
        axes.set_xlabel("t")
        axes.set_ylabel("degree of freedom")
        axes.figure.colorbar(mesh, ax=axes, label=f"{kind}{name}")

    return [functools.partial(panel, name=name) for name in chosen("of", of, list(tables)) or tables]


def _mark(places: int) -> dict[str, str]:
    """Marks: a point if there is only one time; points if there are few, since the line between them is a guess."""
    if places == 1:
        return {"marker": "o", "linestyle": ""}
    return {"marker": "."} if places <= _FEW else {}


def _is_sparse(x: np.ndarray, y: np.ndarray) -> bool:
    """Whether lines between points would look like polygons: most are longer than a tenth of the paths' extent."""
    steps = np.hypot(*(np.diff(values, axis=0) / (np.nanmax(values) - np.nanmin(values) or 1.0) for values in (x, y)))
    seen = steps[np.isfinite(steps)]
    return seen.size > 0 and bool(np.median(seen) > _JUMP)


def _lines(axes: Any, x: np.ndarray, y: np.ndarray, path: np.ndarray, mark: dict[str, str], *, named: bool) -> None:
    """A line for each path, with these marks; labels are in the first panel, and a path has the same colour in all."""
    faint = {"alpha": 1.0 if len(path) <= len(look.COLOURS) else 0.5}
    for i, index in enumerate(path):
        along = x if x.ndim == 1 else x[:, i]
        axes.plot(along, y[:, i], color=look.COLOURS[i % len(look.COLOURS)], label=f"path {index}", **mark, **faint)
    if named and len(path) <= 8:
        axes.legend()


def _along(data: Paths, name: str, shown: np.ndarray, named: bool) -> Callable:
    values = data.values(name)[:, shown]

    def panel(axes: Any) -> None:
        _lines(axes, data.t, values, data.path[shown], _mark(len(data.t)), named=named)
        axes.set_xlabel("t")
        axes.set_ylabel(name)

    return panel


def _plane(data: Paths, pair: tuple[str, str], shown: np.ndarray, named: bool) -> Callable:
    x, y = (data.values(name)[:, shown] for name in pair)
    is_place = set(pair) <= set(data.names.q)

    def panel(axes: Any) -> None:
        mark = {"marker": ".", "linestyle": ""} if _is_sparse(x, y) else _mark(len(x))
        _lines(axes, x, y, data.path[shown], mark, named=named)
        axes.set_xlabel(pair[0])
        axes.set_ylabel(pair[1])
        if is_place:
            axes.set_aspect("equal", adjustable="datalim")

    return panel


# ---- moments -------------------------------------------------------------------------------------------------------


def of_moments(data: Means, what: str, of: object) -> tuple[list[Callable], str]:
    """Panels and title: means with bands."""
    values = data.names
    what = what or ("moments" if of is not None or values.ndof < CHAIN else "map")
    checks.choice("what", what, ["moments", "energy", "map"])
    if not (data.n_ok > 0).any():
        raise InvalidArgumentError("no path is ok at any time: there is nothing to draw; see failed and failed_step")
    mean, var, error = (data.tables[kind] for kind in ("mean", "var", "se_mean"))
    if what == "map":
        tables = {x: np.stack([mean[name] for name in getattr(values, x)], 1) for x in "qp"}
        return _maps(data, tables, of, "mean "), f"{data.title}, {_paths_of(data)}"
    if what == "energy":
        names = _energy_of(values, of, "is not known, as the model has no value: draw other moments")
    else:
        names = values.chosen("of", of) or _all_of(values)
    panels = [
        _curves("t", f"mean {name}", [Curve("mean", data.t, mean[name], error[name], np.sqrt(var[name]))])
        for name in names
    ]
    return panels, f"{data.title}, {_paths_of(data)}; bands: two standard errors, standard deviation"


def of_sweep(title: str, labels: tuple[str, str], curves: Sequence[tuple]) -> tuple[list[Callable], str]:
    """Panel and title: means over a parameter."""
    drawn = [Curve(label or "mean", x, mean, error) for label, x, mean, error in curves]
    return [_curves(labels[0], f"mean {labels[1]}", drawn)], f"{title}; band: two standard errors"


def of_fit(title: str, t: np.ndarray, rows: Sequence[tuple]) -> tuple[list[Callable], str]:
    """Panels and title: a fitted curve with its band, and the data, for each name."""

    def panel(axes: Any, row: tuple) -> None:
        name, data, errors, fitted, band = row
        there = np.isfinite(data)
        _curves("t", name, [Curve("fitted", t[there], fitted[there], band[there])])(axes)
        whiskers = {"color": look.BLACK, "linestyle": "", "marker": "o", "markersize": 3, "elinewidth": 0.7}
        axes.errorbar(t[there], data[there], 2 * errors[there], label="data", **whiskers)
        axes.legend()

    return [functools.partial(panel, row=row) for row in rows], f"{title}; two standard errors"


def _all_of(values: Values) -> list[str]:
    """Each coordinate followed by its momentum, then the energy and observables."""
    pairs = [name for i in _few(values.ndof) for name in (values.q[i], values.p[i])]
    return [*pairs, *values.names[2 * values.ndof :]]


def _paths_of(data: Means) -> str:
    """The number of paths in the moments, at the beginning and at the end."""
    first, last = data.n_ok[0], data.n_ok[-1]
    return counted(first, "path") + ("" if first == last else f", {last} at the end")


def _curves(xlabel: str, ylabel: str, curves: Sequence[Curve]) -> Callable:
    def panel(axes: Any) -> None:
        for i, curve in enumerate(curves):
            colour = look.COLOURS[i % len(look.COLOURS)]
            y = within(curve.y)
            axes.plot(curve.x, y, color=colour, label=curve.label, **_mark(len(y)))
            for width, alpha in ((curve.spread, 0.12), (curve.error, 0.35)):
                if width is not None:
                    wide = within(width if width is curve.spread else 2 * width)
                    axes.fill_between(curve.x, y - wide, y + wide, color=colour, alpha=alpha, linewidth=0)
        axes.set_xlabel(xlabel)
        axes.set_ylabel(ylabel)
        if len(curves) > 1:
            axes.legend()

    return panel


# ---- observers -----------------------------------------------------------------------------------------------------


def of_observed(found: Any, at: int = -1) -> tuple[list[Callable], str]:
    """Panels and title of an observer's results; at: number of the saved time of a histogram."""
    kind, names = found.observer.KIND, ", ".join(found.looked_at)
    if kind == "histogram":
        at = checks.integer("at", at, (-len(found.t), len(found.t) - 1))
        if not found.counts[at].any():
            raise InvalidArgumentError(f"no bin holds a path at t = {found.t[at]:g}: there is nothing to draw")
        outside = int(found.below[at] + found.above[at] + found.not_a_number[at])
        title = f"{names} at t = {found.t[at]:g}, {counted(int(found.counts[at].sum()), 'path')}, {outside} outside"
        return [_histogram(found, names, at)], title
    t, curves = found.t, _CURVES[kind](found)
    if not any(np.isfinite(curve.y).any() for curve in curves):
        raise InvalidArgumentError(f"the {kind} of {names} has no finite value: there is nothing to draw")
    xlabel = "lag" if kind == "autocorrelation" else "t"
    bands = "; bands: two standard errors" if curves[0].error is not None else ""
    return [_curves(xlabel, _YLABELS.get(kind, kind), curves)], f"{kind} of {names}, {counted(len(t), 'time')}{bands}"


def _histogram(found: Any, name: str, at: int) -> Callable:
    density, error = found.density[at], found.se_density[at]

    def panel(axes: Any) -> None:
        axes.stairs(density, found.edges, color=look.BLUE, fill=True, alpha=0.5)
        middle = (found.edges[1:] + found.edges[:-1]) / 2
        whiskers = {"color": look.BLACK, "linestyle": "", "elinewidth": 0.7, "label": "two standard errors"}
        axes.errorbar(middle, density, 2 * error, **whiskers)
        axes.legend()
        axes.set_xlabel(name)
        axes.set_ylabel("density")

    return panel


def _pairs(found: Any) -> list[Curve]:
    k = len(found.names)
    return [
        Curve(f"{found.names[i]}, {found.names[j]}", found.t, found.covariance[:, i, j], found.se_covariance[:, i, j])
        for i in range(k)
        for j in range(i, k)
    ]


_YLABELS = {"passage": "share that left", "quantiles": "quantile", "paths": "value"}
_CURVES: dict[str, Callable[[Any], list[Curve]]] = {
    "quantiles": lambda x: [
        Curve(f"{share:g}", x.t, x.quantile[:, i], x.se_quantile[:, i]) for i, share in enumerate(x.shares)
    ],
    "covariance": _pairs,
    "autocorrelation": lambda x: [Curve("correlation", x.lag, x.correlation, x.se_correlation)],
    "extremes": lambda x: [
        Curve("highest", x.t, x.mean_highest, x.se_mean_highest),
        Curve("lowest", x.t, x.mean_lowest, x.se_mean_lowest),
    ],
    "passage": lambda x: [Curve("lost", x.t, x.lost, x.se_lost)],
    "paths": lambda x: [
        Curve(f"{name} of path {path}", x.t, x.values[i, :, j])
        for i, path in enumerate(x.path)
        for j, name in enumerate(x.names)
    ],
}
