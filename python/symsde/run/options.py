# SPDX-License-Identifier: BSD-3-Clause
"""Options of a run: their types, their defaults, and the struct of the C interface that they become."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from typing import Any, TypedDict

from ..errors import InvalidArgumentError, WrongTypeError
from ..model.definition import Model, require_model
from ..native import abi, checks
from ..native import handles as _handles
from ..native.checks import INT32, INT64, UINT64
from ..native.progress import threads_of
from ..schemes import Scheme

_LIBRARY_LANES = 64  # lanes that a block of the library has at most for large systems
_PYTHON_VALUES = 2048  # most numbers of an array passed to a Python function


class EndOptions(TypedDict, total=False):
    """Options of `simulate` that functions for final states share."""

    t0: float
    correction: str
    truncation: tuple[float, float] | None
    areas: str
    area_time: float | None
    damping_noise: str
    compensated: bool
    threads: int | None


class PathOptions(EndOptions, total=False):
    """Options of `simulate` that functions of whole paths share."""

    paths: int
    seed: int
    refine: int
    first_path: int
    first_step: int
    common_noise: int | Sequence[int]
    general: bool
    fixed_point: int
    max_iter: int
    lanes: int | None
    q0_low: Any
    p0_low: Any


class RunOptions(PathOptions, total=False):
    """Options of a run, besides model, initial state and steps."""

    scheme: str | Scheme
    save_every: int
    save_at: Any
    increments: Any


def _integer(bounds: tuple[int, int]) -> Callable:
    def read(options: abi.Options, name: str, value: object) -> None:
        setattr(options, name, checks.integer(name, value, bounds))

    return read


def _choice(known: Sequence[str]) -> Callable:
    def read(options: abi.Options, name: str, value: object) -> None:
        setattr(options, name, checks.choice(name, value, known))

    return read


def _number(options: abi.Options, name: str, value: object) -> None:
    setattr(options, name, checks.number(name, value))


def _flag(options: abi.Options, name: str, value: object) -> None:
    setattr(options, name, checks.flag(name, value))


def _truncation(options: abi.Options, _name: str, value: object) -> None:
    """Order and time scale of truncated increments; (0, 0) for none."""
    if value is None:
        return
    if not isinstance(value, tuple | list) or len(value) != 2:
        raise WrongTypeError(
            f"truncation = {checks.shown(value)} is not allowed: give None or a pair (order, time scale), as (2, 1.0)"
        )
    options.truncation = checks.finite("order of truncation", value[0])
    options.truncation_time = checks.finite("time scale of truncation", value[1])


def _area_time(options: abi.Options, name: str, value: object) -> None:
    if value is not None:
        _number(options, name, value)


def _common_noise(options: abi.Options, _name: str, value: object) -> None:
    """Set bits for the numbers of common noises."""
    several = checks.items(value)
    numbers = [checks.integer("common_noise", k, INT32) for k in ([value] if several is None else several)]
    for k in numbers:
        if not 1 <= k <= 64:
            raise InvalidArgumentError(
                f"common_noise holds {k}: noises count from 1, and those that all paths share are among the first 64"
            )
    options.common_noise = sum(1 << (k - 1) for k in set(numbers))


#: option -> a function that checks a value other than its default, and stores it
READ: dict[str, Callable] = {
    **dict.fromkeys(("paths", "save_every", "first_path", "first_step"), _integer(INT64)),
    "seed": _integer(UINT64),
    **dict.fromkeys(("refine", "fixed_point", "max_iter"), _integer(INT32)),
    "t0": _number,
    "correction": _choice(abi.CORRECTIONS),
    "truncation": _truncation,
    "areas": _choice(abi.AREAS),
    "area_time": _area_time,
    "damping_noise": _choice(abi.DAMPING_NOISES),
    "common_noise": _common_noise,
    **dict.fromkeys(("compensated", "general"), _flag),
}


def _defaults() -> dict[str, Any]:
    """The values of the options in `READ` that are used if none are given: the library's defaults."""
    given = _handles.new(abi.Options, "options")
    return {name: getattr(given, name) for name in READ} | {
        "correction": abi.CORRECTIONS[given.correction],
        "truncation": (given.truncation, given.truncation_time) if given.truncation else None,
        "areas": abi.AREAS[given.areas],
        "damping_noise": abi.DAMPING_NOISES[given.damping_noise],
        "area_time": given.area_time or None,
        "common_noise": noises(given),
        **{name: bool(getattr(given, name)) for name in ("compensated", "general")},
    }


def noises(options: abi.Options) -> tuple[int, ...]:
    """Numbers of the noises that all paths share."""
    return tuple(k for k in range(1, 65) if options.common_noise >> (k - 1) & 1)


DEFAULTS = _defaults()

#: names of the options of a run
OPTIONS = ["step", "steps", *READ, "threads", "lanes"]


def make_options(model: Model, *, in_python: bool = False, **given: object) -> abi.Options:
    """The struct of options for the C interface, from the values of `OPTIONS`."""
    return options_of(model, given, in_python)


def options_of(model: Model, given: dict[str, Any], in_python: bool) -> abi.Options:
    """Make the options from a dictionary, which is consumed; types are checked here, and all else by the library."""
    take = given.pop
    step, steps, threads, lanes = take("step", None), take("steps", None), take("threads", None), take("lanes", None)
    changed = _changed(given)
    require_model(model)
    if step is None or steps is None:
        missing = "step" if step is None else "steps"
        raise WrongTypeError(f"{missing} is missing: give step, the size h, and steps, their number")
    options = _handles.new(abi.Options, "options")
    options.step = checks.number("step", step)
    options.steps = checks.integer("steps", steps)
    for key in changed:
        READ[key](options, key, given[key])
    if lanes is not None:
        options.lanes = checks.integer("lanes", lanes, INT32)
    elif model.in_python:
        options.lanes = _lanes_for(model, options.paths)
    options.threads = threads_of(threads, in_python or model.in_python)
    return checked(options)


def checked(options: abi.Options) -> abi.Options:
    """These options, if the library accepts them: checked before any size in them is used."""
    _handles.call("options_check", ctypes.byref(options))
    return options


def _changed(given: dict[str, Any]) -> list[str]:
    """Options that differ from their defaults; only few do, and checking all would take part of the time of a short
    run.
    """
    try:
        return [key for key, value in given.items() if value is not DEFAULTS[key]]
    except KeyError as unknown:
        key = unknown.args[0]
        raise checks.no_option(key, ["scheme", *OPTIONS]) from None


def _lanes_for(model: Model, paths: int) -> int:
    """Lanes of a block for Python functions, whose calls take microseconds: more than the library's choice (0)."""
    lanes = min(_PYTHON_VALUES // model.ndof, paths + 7) // 8 * 8
    return lanes if lanes > _LIBRARY_LANES else 0
