# SPDX-License-Identifier: BSD-3-Clause
"""`symsde advise`: scheme and step for a scene and a tolerance."""

from __future__ import annotations

import argparse
import sys

from ..answers.advice.advise import advise
from ..answers.advice.wants import KINDS
from ..answers.expectation.problem import OPTIONS, Problem, make_problem
from ..batch import scene
from ..errors import SceneError, SymsdeError

HELP = "Find the scheme and the step that keep a tolerance at the lowest cost on a scene."


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument("scene", metavar="SCENE.toml")
    parser.add_argument("--tolerance", metavar="X", type=float, required=True, help="error at the end of the run")
    wants = "of what: " + ", ".join(KINDS) + " (%(default)s)"
    parser.add_argument("--want", metavar="WHAT", default="paths", help=wants)
    parser.add_argument("--horizon", metavar="T", type=float, help="time of the run (default: steps times step)")
    parser.add_argument("--quiet", action="store_true", help="no progress")


def run(options: argparse.Namespace) -> int:
    """Execute the verb and return the exit code."""
    chosen = scene.load(options.scene)
    asked = question(chosen, "advise", options.horizon)
    progress = sys.stderr.isatty() and not options.quiet
    try:
        print(advise(chosen.model, tolerance=options.tolerance, want=options.want, progress=progress, **asked))
    except SymsdeError as error:
        raise type(error)(f"{options.scene}: {error}") from error
    return 0


def question(chosen: scene.Scene, verb: str, horizon: float | None = None) -> dict:
    """Initial state, horizon, seed and options of a scene, as arguments of `advise` and similar functions."""
    run_of = chosen.run
    scene.require_schemes_alone(chosen.file, verb, run_of, horizon is not None)
    wanted = abs(run_of["step"]) * run_of["steps"] if horizon is None else horizon
    return {"horizon": wanted, **{key: run_of[key] for key in (*OPTIONS, "q0", "p0", "seed") if key in run_of}}


def problem_of(chosen: scene.Scene, verb: str) -> Problem:
    """The scene as a checked problem without requested results."""
    try:
        return make_problem(chosen.model, lambda q, _p: 0.0 * q[0], **question(chosen, verb))
    except SymsdeError as error:
        raise SceneError(f"{chosen.file}: {error}") from error
