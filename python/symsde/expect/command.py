# SPDX-License-Identifier: BSD-3-Clause
"""`symsde expect`: the means that the table [expect] of a scene asks for."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from .. import scene
from ..errors import SceneError, SymsdeError
from .answer import Answer
from .expect import expect
from .problem import OPTIONS

HELP = "Compute the mean of a function of the final state to a tolerance, by the cheapest way there is."
STOPPED = 4  #: exit code where an interval is wider than asked


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument("scene", metavar="SCENE.toml")
    parser.add_argument("--abs", metavar="X", type=float, help="half width of the 95 %% interval")
    parser.add_argument("--rel", metavar="X", type=float, help="the same, over the value")
    parser.add_argument("--max-time", metavar="S", type=float, help="seconds, after which the interval is given as is")
    parser.add_argument("--quiet", action="store_true", help="value and interval alone, no progress")


def run(options: argparse.Namespace) -> int:
    """Do it; the exit code."""
    given: dict[str, Any] = {"max_time": options.max_time, "progress": sys.stderr.isatty() and not options.quiet}
    if options.abs is not None or options.rel is not None:
        given |= {"abs": options.abs, "rel": options.rel}
    answers = of_scene(options.scene, **given)
    for f, answer in answers.items():
        low, high = answer.interval
        print(f"E {f} = " + (f"{answer.value:.12g} [{low:.12g}, {high:.12g}]" if options.quiet else str(answer)))
    return 0 if all(answer.reached for answer in answers.values()) else STOPPED


def of_scene(file: str | Path, **given: Any) -> dict[str, Answer]:
    """The answer of each formula of [expect]; arguments of `expect` that are given replace those of the scene."""
    chosen = scene.load(file)
    if "f" not in chosen.expect:
        raise SceneError(f'{file}: [expect] lacks f, a formula such as "q**2", or a list of formulas')
    run_of = chosen.run
    known = {"horizon": abs(run_of["step"]) * run_of["steps"]}
    known |= {key: run_of[key] for key in (*OPTIONS, "q0", "p0", "seed") if key in run_of}
    known |= chosen.expect
    if "abs" in given or "rel" in given:
        known.pop("abs", None), known.pop("rel", None)
    known |= {key: value for key, value in given.items() if value is not None}
    wanted = known.pop("f")
    try:
        return {str(f): expect(chosen.model, f, **known) for f in (wanted if isinstance(wanted, list) else [wanted])}
    except SymsdeError as error:
        raise SceneError(f"{file}: [expect]: {error}") from error
