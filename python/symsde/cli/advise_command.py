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
_OPTIONS = (*OPTIONS, "seed")  #: keys of [run] that are passed on


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument("scene", metavar="SCENE.toml")
    parser.add_argument("--tolerance", metavar="X", type=float, required=True, help="error at the end of the run")
    wants = "of what: " + ", ".join(KINDS) + " (%(default)s)"
    parser.add_argument("--want", metavar="WHAT", default="paths", help=wants)
    parser.add_argument("--horizon", metavar="T", type=float, help="time of the run (default: steps times step)")
    parser.add_argument(
        "--seconds", metavar="S", type=float, default=5.0, help="processor time of the search (%(default)g)"
    )
    parser.add_argument("--quiet", action="store_true", help="no progress")


def run(options: argparse.Namespace) -> int:
    """Execute the verb and return the exit code."""
    chosen = scene.load(options.scene)
    asked = scene.for_schemes(chosen, "advise", _OPTIONS, options.horizon)
    progress = sys.stderr.isatty() and not options.quiet
    try:
        asked |= {"tolerance": options.tolerance, "want": options.want, "seconds": options.seconds}
        print(advise(chosen.model, progress=progress, **asked))
    except SymsdeError as error:
        raise type(error)(f"{options.scene}: {error}") from error
    return 0


def problem_of(chosen: scene.Scene, verb: str) -> Problem:
    """The scene as a checked problem without requested results."""
    try:
        return make_problem(chosen.model, lambda q, _p: 0.0 * q[0], **scene.for_schemes(chosen, verb, _OPTIONS))
    except SymsdeError as error:
        raise SceneError(f"{chosen.file}: {error}") from error
