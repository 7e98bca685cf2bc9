# SPDX-License-Identifier: BSD-3-Clause
"""All inputs of a run, checked and in the form of the C interface."""

from __future__ import annotations

import ctypes
import dataclasses
import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import InvalidArgumentError, RepeatedNoiseWarning, WrongShapeError, WrongTypeError
from ..model.definition import Model
from ..native import abi, checks
from ..native import handles as _handles
from ..native.checks import address, addresses
from ..native.progress import Monitor
from ..schemes import Scheme, as_scheme
from .increments import increments_array, put_increments
from .options import checked, noises, options_of
from .states.law import States

_COUNT = 2**47  # number of values of the random generator's counter of steps
_ON_GRID = 1e-6  # distance from a step, in steps, of times that are typed
_WHOLE = 1e-9  # relative error of times that are typed, or sums of steps
_INPUT_SIZE = _handles.new(abi.Input, "input").struct_size


@dataclass
class Setup:
    """Model, scheme, options and arrays of one run; the result keeps it, so that the run can be analysed later."""

    model: Model
    scheme: Scheme
    options: abi.Options
    q0: np.ndarray  #: (dof, 1 or path)
    p0: np.ndarray
    increments: np.ndarray | None = None  #: (row, noise, 1 or path)
    q0_low: np.ndarray | None = None  #: (dof, path)
    p0_low: np.ndarray | None = None
    by_path: bool = False  #: whether the start has a column for each path, as final states have
    saved: np.ndarray | None = None  #: (time,), steps after which the run is saved, if they are not every save_every

    def first_state(self) -> tuple[np.ndarray, np.ndarray]:
        """The state of the first path, (dof, 1) each."""
        return self.q0[:, :1], self.p0[:, :1]

    def start(self) -> dict[str, np.ndarray | States]:
        """The initial states as they were given: arrays, or laws."""
        return {"q0": self.q0, "p0": self.p0}

    @property
    def ntime(self) -> int:
        """Number of saved times."""
        return self.options.steps // self.options.save_every + 1 if self.saved is None else len(self.saved)

    @property
    def rows(self) -> np.ndarray:
        """Which of the states that the library saves are those of `saved`."""
        return self.saved // self.options.save_every

    def whole(self) -> Setup:
        """The run that the library makes for a run with unequal saved times: saved every save_every steps."""
        return dataclasses.replace(self, saved=None)

    @property
    def kicks(self) -> bool:
        """Whether steps are kicks, which may add products of gradients."""
        return self.scheme.info.form == "drifts and kicks"

    @property
    def paths(self) -> int:
        """Number of paths."""
        return self.options.paths

    def input(self, monitor: Monitor | None = None) -> abi.Input:
        """Arrays and callback in the form of the C interface; they live as long as this setup."""
        q0, p0 = self.q0, self.p0
        given = abi.Input(_INPUT_SIZE, *addresses((q0, p0)), q0.shape[1], p0.shape[1])  # zero members: none
        if self.increments is not None:
            put_increments(given, self.increments)
        if self.q0_low is not None:
            given.q0_low = address(self.q0_low)
        if self.p0_low is not None:
            given.p0_low = address(self.p0_low)
        if monitor is not None:
            given.progress, given.warn = monitor.callback, monitor.warning
        return given

    def handles(self) -> tuple:
        """The leading arguments of a run in the C interface, after the model."""
        return self.scheme._handle.pointer, ctypes.byref(self.options)

    def from_here(self, first_step: int, steps: int, save_every: int, state: Sequence[np.ndarray | None]) -> Setup:
        """The same setup from a later state, (q, p, q_low, p_low), which is copied, over this many steps with their
        noise.
        """
        options = abi.Options.from_buffer_copy(self.options)
        options.first_step, options.steps, options.save_every = first_step, steps, save_every
        q0, p0, *low = (None if part is None else part.copy() for part in state)
        return Setup(self.model, self.scheme, checked(options), q0, p0, None, *low)

    def repeated_noise(self) -> str:
        """A warning if states of paths begin whole steps after time 0 but with the noise of step 0; else empty."""
        options = self.options
        if not (options.t0 and self.by_path and options.steps) or options.first_step or self.increments is not None:
            return ""
        before = options.t0 / options.step
        if not (0.5 < before < _COUNT and abs(before - round(before)) < _WHOLE * before and self.model.nnoise):
            return ""
        return (
            f"t0 = {options.t0:g} is {checks.counted(round(before), 'step')} after 0, and each path has a state of its "
            "own, as where a run goes on: but with first_step = 0 the noise is that of the first steps of this seed "
            f"again. Give first_step={round(before)} and t0=0, which mean the same times, or call run.extend(steps)"
        )

    def warn_of_repeated_noise(self) -> None:
        """Issue this warning."""
        if text := self.repeated_noise():
            checks.warn(text, RepeatedNoiseWarning)

    def attributes(self) -> dict[str, str]:
        """Origin of the run, as text for files."""
        left_out = {"struct_size", "threads", "lanes", "progress", "progress_user"}
        left_out |= {name for name in ("noise_paths", "damping_noise") if not getattr(self.options, name)}
        left_out |= {"row_paths"} if self.options.row_paths == 1 else set()
        names = [name for name, *_ in abi.Options._fields_ if name not in left_out]
        chosen = {name: getattr(self.options, name) for name in names}
        chosen["areas"] = abi.AREAS[self.options.areas]
        if "damping_noise" in chosen:
            chosen["damping_noise"] = abi.DAMPING_NOISES[self.options.damping_noise]
        chosen["common_noise"] = list(noises(self.options))
        chosen["correction"] = abi.CORRECTIONS[self.options.correction]
        return {
            "model": self.model.name,
            "parameters": json.dumps({key: np.asarray(x).tolist() for key, x in self.model.parameters.items()}),
            **({"damping": json.dumps(self.model._told_damping())} if self.model.damping else {}),
            **({"forces": json.dumps(self.model._forces.told())} if self.model._forces else {}),
            **({"bath": json.dumps(self.model._bath)} if self.model._bath else {}),
            **({"names": json.dumps(self.model._coordinates)} if self.model._coordinates else {}),
            "scheme": self.scheme.name,
            "options": json.dumps(chosen),
            **({} if self.saved is None else {"saved_steps": json.dumps(self.saved.tolist())}),
            "increments": "Brownian" if self.increments is None else "prescribed",
            **({"hamiltonians": json.dumps(self.model.formula.hamiltonians)} if hasattr(self.model, "formula") else {}),
        }


def kind_of_setup(q0: object, p0: object) -> type[Setup]:
    """The class of the setup of these initial states."""
    return DrawnSetup if isinstance(q0, States) or isinstance(p0, States) else Setup


class DrawnSetup(Setup):
    """A setup whose states are drawn from laws when they are first asked for: parts of a run draw theirs alone."""

    @property
    def q0(self) -> np.ndarray:
        """(dof, 1 or path)."""
        return self._state(0)

    @q0.setter
    def q0(self, given: np.ndarray | States) -> None:
        self._begin(0, given)

    @property
    def p0(self) -> np.ndarray:
        """(dof, 1 or path)."""
        return self._state(1)

    @p0.setter
    def p0(self, given: np.ndarray | States) -> None:
        self._begin(1, given)

    def _begin(self, place: int, given: np.ndarray | States) -> None:
        self.__dict__.setdefault("_given", [None, None])[place] = given
        self.__dict__.setdefault("_found", [None, None])[place] = None if isinstance(given, States) else given

    def _state(self, place: int) -> np.ndarray:
        if self._found[place] is None:
            options = self.options
            some = options.noise_paths or options.paths
            for i, x in enumerate(self._drawn(some)):
                if x is not None:
                    self._found[i] = np.tile(x, options.paths // some) if some < options.paths else x
        return self._found[place]

    def _drawn(self, paths: int) -> list[np.ndarray | None]:
        """Both states of the first paths, from their laws; None where an array is given."""
        options, (q, p) = self.options, self._given
        about = {"seed": options.seed, "first_path": options.first_path, "t": options.t0}
        if q is p:
            return list(q.draw(self.model, paths, **about))
        laws = ((x, letter) for x, letter in ((q, "q"), (p, "p")))
        return [
            x.draw(self.model, paths, letters=letter, **about)[place] if isinstance(x, States) else None
            for place, (x, letter) in enumerate(laws)
        ]

    def first_state(self) -> tuple[np.ndarray, np.ndarray]:
        """The state of the first path, (dof, 1) each."""
        return tuple(x[:, :1] if y is None else y for x, y in zip(self._given, self._drawn(1), strict=True))

    def start(self) -> dict[str, np.ndarray | States]:
        """The initial states as they were given: arrays, or laws."""
        return dict(zip(("q0", "p0"), self._given, strict=True))

    def __getstate__(self) -> dict[str, Any]:
        """The state for pickle: states that were drawn are drawn again."""
        left = [None if isinstance(x, States) else x for x in self._given]
        return {**self.__dict__, "_found": left}


def make_setup(model: Model, *, q0: object, p0: object, **given: Any) -> Setup:
    """Check all inputs of a run: arguments of `simulate`, and in_python for Python functions besides the model's."""
    return setup_of({"model": model, "q0": q0, "p0": p0, **given})


def setup_of(given: dict[str, Any]) -> Setup:
    """Make a setup from a dictionary, which is consumed."""
    take = given.pop
    model, q0, p0, scheme = take("model"), take("q0"), take("p0"), take("scheme", "midpoint")
    increments, q0_low, p0_low = take("increments", None), take("q0_low", None), take("p0_low", None)
    save_at, rows = take("save_at", None), take("row_paths", 1)
    chosen = options_of(model, given, take("in_python", False))
    if save_at is not None and chosen.save_every != 1:
        raise WrongTypeError("save_at has the times that are saved, and save_every the steps between them: give one")
    saved = None if save_at is None else _saved_steps(save_at, chosen)
    ndof, paths = model.traits.ndof, chosen.paths
    chosen.row_paths = rows
    if model.paths * rows not in (0, paths):
        raise _other_paths(model, paths)
    laws = isinstance(q0, States), isinstance(p0, States)
    shaped = (
        q0 if laws[0] else checks.state("q0", q0, ndof, paths),
        p0 if laws[1] else checks.state("p0", p0, ndof, paths),
    )
    is_one = not any(laws) and checks.is_one(q0) and checks.is_one(p0)
    q0, p0 = shaped
    if model.check_start is not None and is_one:
        model.check_start(q0, p0, chosen.t0)
    return kind_of_setup(q0, p0)(
        model,
        as_scheme(scheme),
        chosen,
        q0,
        p0,
        None if increments is None else increments_array(increments),
        None if q0_low is None else _low("q0_low", q0_low, ndof, paths),
        None if p0_low is None else _low("p0_low", p0_low, ndof, paths),
        not is_one and not any(laws) and paths in (q0.shape[1], p0.shape[1]),
        saved,
    )


def _saved_steps(times: object, options: abi.Options) -> np.ndarray:
    """The numbers of steps after which these times are reached, ascending; makes save_every their common divisor."""
    t = checks.real_array("save_at", times)
    if t.ndim != 1 or not t.size:
        raise WrongShapeError(f"save_at has shape {t.shape}: give (time,), one time at least")
    if not np.isfinite(t).all():
        raise InvalidArgumentError("save_at is not finite: give times of the run")
    steps = (t - options.t0) / options.step - options.first_step
    whole = np.round(steps)
    for i in np.flatnonzero((np.abs(steps - whole) > _ON_GRID) | (whole < 0) | (whole > options.steps))[:1]:
        near = options.t0 + options.step * (options.first_step + min(max(whole[i], 0), options.steps))
        raise InvalidArgumentError(
            f"save_at holds {t[i]:.12g}, which no step of this run reaches: its times are t0 + n*step, n = "
            f"{options.first_step} .. {options.first_step + options.steps}, and the nearest is {near:.12g}"
        )
    if (np.diff(whole) <= 0).any():
        raise InvalidArgumentError("save_at is not in the order of the run, or holds a time twice: give each time once")
    saved = whole.astype(np.int64)
    options.save_every = max(1, int(np.gcd.reduce([*saved.tolist(), options.steps])))
    return saved


def _other_paths(model: Model, paths: int) -> WrongShapeError:
    """The error if arrays of parameters do not fit the paths of a run."""
    arrays = [name for name, x in model.parameters.items() if isinstance(x, np.ndarray) and x.size > 1]
    return WrongShapeError(
        f"the parameter{'s' if len(arrays) > 1 else ''} {', '.join(arrays)} of model {model.name} "
        f"{'have' if len(arrays) > 1 else 'has'} {model.paths} values, one for each path, and the run has "
        f"{checks.counted(paths, 'path')}: give paths={model.paths}, or as many values as paths"
    )


def _low(name: str, value: object, ndof: int, paths: int) -> np.ndarray:
    """Low parts of a compensated state, with a column for every path."""
    return checks.full(checks.state(name, value, ndof, paths), paths)
