# SPDX-License-Identifier: BSD-3-Clause
"""An expectation to a tolerance: pilot, choice of a plan, work, interval."""

from __future__ import annotations

import os
from typing import Any, Unpack, overload

from ...model.definition import Model
from ...native import checks
from ...native.progress import Progress
from ...run.options import EndOptions
from ...schemes import Scheme, as_scheme
from .answer import Answer
from .by_value import Answers, answers_by_value, grid_of
from .candidates import suitable
from .carry_out import Execution
from .choice import ANTITHETIC, EVEN_LEVELS, METHODS, MULTILEVEL, PLAIN, Plan
from .draw_store import inputs_of, open_folder
from .interval import make_tolerance
from .pilot import Pilot
from .problem import OPTIONS, Function, make_problem
from .watch import Watch

#: name of a method until version 0.1 -> the method that replaces it
_GONE = {"control variate": (ANTITHETIC, PLAIN), "extrapolated": (MULTILEVEL,), "quasi-Monte Carlo": (EVEN_LEVELS,)}


@overload
def expect(
    model: Model,
    f: Function | str,
    *,
    q0: Any,
    p0: Any,
    horizon: float,
    abs: float | None = None,
    rel: float | None = None,
    seed: int = 0,
    scheme: str | Scheme | None = None,
    method: str | None = None,
    max_time: float | None = None,
    progress: Progress = False,
    out: str | os.PathLike | None = None,
    groups: None = None,
    **options: Unpack[EndOptions],
) -> Answer: ...
@overload
def expect(
    model: Model,
    f: Function | str,
    *,
    q0: Any,
    p0: Any,
    horizon: float,
    abs: float | None = None,
    rel: float | None = None,
    seed: int = 0,
    scheme: str | Scheme | None = None,
    method: str | None = None,
    max_time: float | None = None,
    progress: Progress = False,
    out: str | os.PathLike | None = None,
    groups: Any,
    **options: Unpack[EndOptions],
) -> Answers: ...
@checks.hinted(*OPTIONS)
def expect(
    model: Model,
    f: Function | str,
    *,
    q0: Any,
    p0: Any,
    horizon: float,
    abs: float | None = None,
    rel: float | None = None,
    seed: int = 0,
    scheme: str | Scheme | None = None,
    method: str | None = None,
    max_time: float | None = None,
    progress: Progress = False,
    out: str | os.PathLike | None = None,
    groups: Any = None,
    **options: Unpack[EndOptions],
) -> Answer | Answers:
    """Estimate E f(q, p) at t0 + horizon with a 95 % interval of the half width that you ask for, in the cheapest way.

    - f: a function of q, p, (dof, path) each, that returns (path,); or a formula as text, such as `"q**2"`
    - q0, p0: initial state of all paths, a number or (dof,)
    - abs, rel: half width of the interval, or half width over the value; give one of the two
    - scheme, method: use this one; methods are plain, antithetic, multilevel and multilevel quasi-Monte Carlo
    - max_time: seconds of the clock after which the interval reached so far is returned
    - out: a folder that keeps the choice and the draws; the same call resumes it, and several processes can share it
    - groups: the name of a parameter that has an array of values in the model, or names of all that have: an answer for
      each value, that of a model with this number, in arrays of `Answers`. max_time is for all; of values that go
      together, and of a value that is there several times, there is one answer; folders are out/value-1, ..
    - options: t0, correction, truncation, areas, area_time, damping_noise, compensated and threads of `simulate`

    A pilot measures variance, weak error and cost of a few schemes that suit the model, or of the given one. Then the
    plan with the shortest estimated time is carried out. The answer says what was chosen and why, and what the
    alternatives would have cost. The choice depends on measured times, and so do the step and the number of paths even
    if you give scheme and method. Two answers to one question therefore differ in their bits.

    Bad input raises a ValueError before long work: f of the wrong shape, with infinite variance or with values that are
    not numbers, or a tolerance below rounding. Ctrl-C raises KeyboardInterrupt. Its attribute `partial` is the answer
    until then, or None if the pilot was not finished or fewer than two scramblings were drawn.

    If f varies on too few paths, rare events may be missing from the sample. The half width is then at least 3.84/paths
    times the scale of f. If this makes the interval wider than asked, `reached` is false, and a note says so.
    """
    if groups is not None:
        asked = {"q0": q0, "p0": p0, "horizon": horizon, "abs": abs, "rel": rel, "seed": seed, "scheme": scheme}
        asked |= {"method": method, "max_time": max_time, "progress": progress, "out": out, **options}
        return answers_by_value(expect, model, f, grid_of(model, groups, "expect"), **asked)
    watch = Watch(max_time, progress)
    with watch.carrying(Answer):
        problem = make_problem(model, f, q0=q0, p0=p0, horizon=horizon, seed=seed, **options)
        tolerance = make_tolerance(abs, rel)
        methods = METHODS if method is None else _methods(method)
        schemes = suitable(problem) if scheme is None else [as_scheme(scheme)]

        def choose() -> tuple[Pilot, list[Plan]]:
            pilot = Pilot(problem, tolerance, watch, schemes, methods)
            return pilot, pilot.choose()

        if out is None:
            return Execution(*choose()).answer()
        inputs = inputs_of(problem, tolerance, None if scheme is None else schemes[0], method)
        with open_folder(out, inputs, problem, schemes, watch) as store:
            store.choice(choose)
            chosen = store.read_choice(problem, tolerance, {scheme.name: scheme for scheme in schemes})
            answer = Execution(*chosen, store).answer()
            store.save(answer)
            return answer


def _methods(name: str) -> tuple[str, ...]:
    """The methods that carry out `name`; old names warn and use the nearest method."""
    if (nearest := _GONE.get(checks.name_of("method", name))) is None:
        return (METHODS[checks.choice("method", name, METHODS)],)
    what = " or ".join(map(repr, nearest))
    checks.warn(f"method = {name!r} is no more, and is carried out by {what}: call that", DeprecationWarning)
    return nearest
