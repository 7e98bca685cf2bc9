# SPDX-License-Identifier: BSD-3-Clause
"""`symsde expect`: the means requested by the table [expect] of a scene."""

from __future__ import annotations

import argparse
import shlex
import sys
from pathlib import Path
from typing import Any

import numpy as np

from ..answers.expectation.answer import Answer
from ..answers.expectation.by_value import Answers, told_point
from ..answers.expectation.expect import expect
from ..answers.expectation.problem import OPTIONS
from ..batch import scene
from ..errors import SceneError, SymsdeError
from ..model.definition import Model
from .run_command import logged

HELP = "Compute the mean of a function of the final state to a tolerance, in the cheapest way."
STOPPED = 4  #: exit code if an interval is wider than requested


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument("scene", metavar="SCENE.toml")
    parser.add_argument("--abs", metavar="X", type=float, help="half width of the 95 %% interval")
    parser.add_argument("--rel", metavar="X", type=float, help="the same, divided by the value")
    parser.add_argument("--max-time", metavar="S", type=float, help="stop after S seconds with the interval reached")
    parser.add_argument("--out", metavar="DIR", help="folder that keeps the work: the same command resumes it")
    parser.add_argument("--quiet", action="store_true", help="print value and interval only, no progress")


def run(options: argparse.Namespace) -> int:
    """Execute the verb and return the exit code."""
    given: dict[str, Any] = {"max_time": options.max_time, "progress": sys.stderr.isatty() and not options.quiet}
    if options.abs is not None or options.rel is not None:
        given |= {"abs": options.abs, "rel": options.rel}
    model, wanted, arguments = _asked(options.scene, given)
    reached = True
    for number, f in enumerate(wanted, 1):
        if options.out is not None:
            arguments["out"] = Path(options.out, f"mean-{number}") if len(wanted) > 1 else options.out
        try:
            with logged(options.quiet):
                answer = _answer(options.scene, model, f, arguments)
        except KeyboardInterrupt as stop:
            if stop.partial is not None:
                _show(f, stop.partial, options.quiet)
            _say_how_to_go_on(options)
            raise
        _show(f, answer, options.quiet)
        reached &= answer.reached
    if not reached:
        _say_how_to_go_on(options)
    return 0 if reached else STOPPED


def _say_how_to_go_on(options: argparse.Namespace) -> None:
    """Print how to continue from the folder that keeps the work."""
    if options.out is not None:
        again = ["symsde", "expect", options.scene, "--out", options.out]
        for name in ("abs", "rel"):
            if (value := getattr(options, name)) is not None:
                again += [f"--{name}", repr(value)]
        if options.allow_python:
            again.append("--allow-python")
        print(f"symsde: what was drawn is in {options.out}: resume with `{shlex.join(again)}`", file=sys.stderr)


def _show(f: str, answer: Answer | Answers, quiet: bool) -> None:
    if not quiet:
        print(f"E {f}:\n{answer}" if isinstance(answer, Answers) else f"E {f} = {answer}", flush=True)
        return
    many = isinstance(answer, Answers)
    pairs = zip(answer.points(), answer.answers, strict=True) if many else [({}, answer)]
    for point, x in pairs:
        if x is not None:
            after = f", {told_point(point)}: " if point else " = "
            print(f"E {f}{after}{x.value:.12g} [{x.interval[0]:.12g}, {x.interval[1]:.12g}]", flush=True)


def _answer(file: str, model: Model, f: str, arguments: dict[str, Any]) -> Answer | Answers:
    try:
        return expect(model, f, **arguments)
    except SymsdeError as error:
        raise SceneError(f"{file}: [expect]: {error}") from error


def _asked(file: str, given: dict[str, Any]) -> tuple[Model, list[str], dict[str, Any]]:
    """The model of a scene, the formulas of [expect], and arguments of `expect`; `given` replaces those of the scene.
    Parameters that go by path have an answer for each value."""
    chosen = scene.load(file)
    if "f" not in chosen.expect:
        raise SceneError(f'{file}: [expect] lacks f, a formula such as "q**2", or a list of formulas')
    known = scene.for_schemes(chosen, "expect", (*OPTIONS, "seed"), chosen.expect.get("horizon")) | chosen.expect
    if "abs" in given or "rel" in given:
        known.pop("abs", None), known.pop("rel", None)
    known |= {key: value for key, value in given.items() if value is not None}
    wanted = known.pop("f")
    wanted = wanted if isinstance(wanted, list) else [wanted]
    if not wanted or not all(isinstance(f, str) for f in wanted):
        raise SceneError(f'{file}: [expect] f = {wanted!r}: give a formula such as "q**2", or a list of formulas')
    if several := [name for name, x in chosen.model.parameters.items() if isinstance(x, np.ndarray) and x.size > 1]:
        known["groups"] = several
    return chosen.model, wanted, known
