# SPDX-License-Identifier: BSD-3-Clause
"""`symsde stability`: how long a step of a scene may be; without a scene all scenarios, with tables and figures."""

from __future__ import annotations

import argparse
import functools
import importlib
import math
from pathlib import Path

from ..answers.advice.advise import candidates
from ..answers.expectation.candidates import frequency
from ..answers.linear_stability import stable_up_to
from ..batch import scene
from ..errors import InvalidArgumentError
from ..model.definition import Model
from ..native import files
from ..schemes import as_scheme
from ..show import tables
from ..studies import expectations, pages
from .advise_command import problem_of

HELP = "How long a step of a scene may be; without a scene, run stiff and extreme cases and compare with expectations."
_LEFT = ("quick", "out", "markdown")  #: options for the scenarios, not for a scene
FAILED = 1
_PATHS = 64  #: number of paths of a scene on which the fastest frequency is measured


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument("scene", metavar="SCENE.toml", nargs="?", help="print the limits of its schemes")
    parser.add_argument("--quick", action="store_true", help="fewer paths and steps, under twenty seconds")
    parser.add_argument("--out", metavar="DIR", help="directory of the results (default: out/stability)")
    parser.add_argument("--markdown", metavar="FILE", help="write this page, and figures/ beside it")


def run(options: argparse.Namespace) -> int:
    """Execute the verb; return 0, or 1 if a criterion failed."""
    if options.scene is not None:
        if given := [f"--{name}" for name in _LEFT if getattr(options, name)]:
            raise InvalidArgumentError(f"{', '.join(given)} is for the cases of symsde: leave it out beside a scene")
        print(of_scene(options.scene))
        return 0
    files.optional("matplotlib", "plot")
    stability = importlib.import_module("symsde.studies.stability")
    page = importlib.import_module("symsde.studies.stability.stability_page")
    with files.folder(options.out or "out/stability") as directory:
        return _scenarios(stability, page, directory, options)


def of_scene(file: str) -> str:
    """A table of the schemes that suit a scene: limit of omega h, longest step, and whether the scene's step is
    stable."""
    chosen = scene.load(file)
    problem = problem_of(chosen, "stability")
    own, h = as_scheme(chosen.run.get("scheme", "midpoint")).name, abs(chosen.run["step"])
    omega = frequency(problem, _PATHS)
    ways = f"the fastest of {_PATHS} paths" if problem.model.nnoise else "the fastest along its path"
    told = [
        f"{file}: {problem.model!r} by {own}, step {h:g}",
        f"frequency {omega:.4g}, {ways} to t = {problem.horizon:g}: omega h = {omega * h:.3g}",
    ]
    rates = _rates(problem.model)
    lines = [["scheme", "omega h", "longest step", " this step"]]
    for name in dict.fromkeys([own, *(scheme.name for scheme in candidates(problem))]):
        limit = min(stable_up_to(name, rate / omega)[0] for rate in rates)
        ends = ("every", "every") if limit == math.inf else (f"{limit:.3g}", f"{limit / omega:.3g}")
        verdict = "stable" if omega * h < limit else "never stable" if not limit else "too long"
        lines.append([name, *ends, f" {verdict}"])
    damped = f" damped by gamma = {' and '.join(f'{rate:.4g}' for rate in rates)}" if any(rates) else ""
    last = (
        f"limits are those of a linear oscillator{damped} without noise; where springs harden, stay below 0.65 of them"
    )
    return "\n".join([*told, tables.aligned(lines, (-26, 8, 13, 0)), last])


def _rates(model: Model) -> tuple[float, ...]:
    """The rates of damping for which limits are found, the smallest and the largest one: zero for a closed system, a
    matrix of friction, rates that change, and rates that add energy.
    """
    damping = () if model.has_friction or model._varying else model.damping
    return tuple(dict.fromkeys((max(0.0, min(damping, default=0.0)), max(0.0, max(damping, default=0.0)))))


def _scenarios(stability, page, directory: Path, options: argparse.Namespace) -> int:
    """Write every scenario into an existing folder."""
    print(f"{pages.made_by()}: stiff and extreme cases{' (quick)' if options.quick else ''}")
    cases = (functools.partial(function, options.quick) for function in stability.SCENARIOS)
    found = expectations.carry_out(cases, "case")
    page.write(directory / "stability.md", found, options.quick)
    if options.markdown:
        page.write(Path(options.markdown), found, options.quick)
    print(f"\nwritten to {options.markdown or directory}\n{expectations.summary(found)}")
    return FAILED if expectations.count(found, False) else 0
