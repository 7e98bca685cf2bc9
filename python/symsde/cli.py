# SPDX-License-Identifier: BSD-3-Clause
"""The command line: symsde VERB, or python -m symsde VERB."""

from __future__ import annotations

import argparse
import importlib
import importlib.util
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from . import _files, models, scene, schemes, tables
from ._output import patient_output
from ._setup import build_info
from .errors import PathsFailedWarning, SymsdeError
from .moments import Moments
from .simulate import Run
from .stability import command as stability
from .study import command as study

OK, INTERNAL, BAD_INPUT, PATHS_FAILED, STOPPED = 0, 1, 2, 3, 4
_EPILOG = "exit codes: 0 ok, 1 internal error, 2 bad input, 3 some paths failed, 4 stopped"


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; the exit code."""
    try:
        with warnings.catch_warnings(), _terminated_as_interrupted(), patient_output():
            warnings.simplefilter("ignore", PathsFailedWarning)  # the exit code and a line say it
            options = _parser().parse_args(arguments)
            return options.verb(options)
    except (SymsdeError, OSError) as error:
        print(f"symsde: {error}", file=sys.stderr)
        return BAD_INPUT
    except KeyboardInterrupt as stop:
        kept = getattr(stop, "kept", None)
        print(f"symsde: stopped{f'; what was computed until then is in {kept}' if kept else ''}", file=sys.stderr)
        return STOPPED


@contextmanager
def _terminated_as_interrupted() -> Iterator[None]:
    """SIGTERM, unless somebody else handles it, is treated as Ctrl-C: what was begun is tidied up."""
    mine = threading.current_thread() is threading.main_thread()
    if not mine or signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL:
        yield
        return
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="symsde", description="Symplectic integration of stochastic Hamiltonian systems.", epilog=_EPILOG
    )
    parser.add_argument("--version", action="version", version=f"symsde {build_info().get('version', '?')}")
    verbs = parser.add_subparsers(title="verbs", required=True, metavar="VERB")

    def add(verb, function, text):
        sub = verbs.add_parser(verb, help=text, description=text, epilog=_EPILOG)
        sub.set_defaults(verb=function)
        return sub

    run = add("run", _run, "Run a scene; print moments, write moments.csv and run.nc.")
    run.add_argument("scene", metavar="SCENE.toml")
    run.add_argument("--out", metavar="DIR", help="directory of the results (default: named after the scene)")
    run.add_argument("--quiet", action="store_true", help="no progress and no table")
    add("check", _check, "Check a scene without running it.").add_argument("scene", metavar="SCENE.toml")
    add("template", _template, "Print a scene of a built-in model.").add_argument("model", metavar="MODEL")
    catalogue = add("list", _list, "List models with their parameters, and schemes.")
    catalogue.add_argument("what", nargs="?", choices=("models", "schemes"), help="one of the two (default: both)")
    catalogue.add_argument("--markdown", action="store_true", help="as the page of the documentation")
    add("info", _info, "Print versions, compiler and optional packages.")
    work = add("study", study.run, study.HELP)
    study.arguments(work)
    extremes = add("stability", stability.run, stability.HELP)
    stability.arguments(extremes)
    paper = add("paper", _paper, "Run every experiment of the paper; write results.json and figures.")
    paper.add_argument("--out", metavar="DIR", default="out/paper", help="directory of the results (%(default)s)")
    paper.add_argument("--quick", action="store_true", help="fewer paths and steps")
    return parser


def _run(options: argparse.Namespace) -> int:
    chosen = scene.load(options.scene)
    progress = sys.stderr.isatty() and not options.quiet
    report, failed = None, 0
    with _files.folder(options.out or Path(options.scene).stem) as directory:
        if chosen.moments:
            moments = _saved(chosen.compute_moments, progress, directory / "moments.csv")
            report, failed = moments.report, moments.report.failed
            if not options.quiet:
                _print_moments(moments)
        if chosen.paths:
            run = _saved(chosen.compute_paths, progress, directory / ("run.nc" if _has_netcdf() else "run.npz"))
            report, failed = report or run.report, max(failed, int((run.status != 0).sum()))
    if not options.quiet:
        print(f"{report or ''}\nwritten to {directory}".lstrip())
    if failed:
        print(f"symsde: {failed} paths failed; moments are over the others", file=sys.stderr)
    return PATHS_FAILED if failed else OK


def _saved(compute: Callable[[bool], Moments | Run], progress: bool, target: Path) -> Moments | Run:
    """What was computed, in a file; after a stop what there is of it, in one whose name says so."""
    try:
        result = compute(progress)
    except KeyboardInterrupt as stop:
        if (result := getattr(stop, "partial", None)) is not None:
            stop.kept = target.with_name(f"{target.stem}.partial{target.suffix}")
            result.save(stop.kept)
        raise
    result.save(target)
    return result


def _has_netcdf() -> bool:
    return all(importlib.util.find_spec(package) for package in ("xarray", "netCDF4"))


def _print_moments(moments: Moments, rows: int = 11, columns: int = 4) -> None:
    """At most eleven times; q_1, p_1 and the energy first."""
    names = moments.columns()
    ndof = moments.setup.model.ndof
    wanted = [0, ndof, *range(2 * ndof, len(names))][:columns]
    means, errors = moments.to_arrays()
    print(f"{'t':>10s} {'paths':>9s}" + "".join(f" {'mean ' + names[j]:>24s}" for j in wanted))
    every = max(1, -(-(len(moments.t) - 1) // (rows - 1)))
    for i in sorted({*range(0, len(moments.t), every), len(moments.t) - 1}):
        values = "".join(f" {means[i, j]:12.5g} +- {errors[i, j]:8.2g}" for j in wanted)
        print(f"{moments.t[i]:10.4g} {moments.n_ok[i]:9d}{values}")


def _check(options: argparse.Namespace) -> int:
    chosen = scene.load(options.scene)
    report = chosen.try_out().report
    print(f"{options.scene}: ok")
    print(f"{'model':11s}{chosen.model!r}\n{'stepper':11s}{report.stepper}")
    print(f"{'left out':11s}{'; '.join(report.left_out) or 'nothing'}")
    return OK


def _template(options: argparse.Namespace) -> int:
    print(scene.template(options.model), end="")
    return OK


def _list(options: argparse.Namespace) -> int:
    if options.what != "schemes":
        print(tables.models_markdown() if options.markdown else _models())
    if options.what != "models":
        print(tables.schemes_markdown() if options.markdown else _schemes())
    return OK


def _models() -> str:
    lines = ["models"]
    for name in models.names():
        parameters = ", ".join(f"{key}={value:g}" for key, value in models.parameters(name).items())
        lines.append(f"  {name}({parameters})")
    return "\n".join(lines)


def _schemes() -> str:
    lines = ["schemes"]
    for name in schemes.names():
        info = schemes.get(name).info
        strong = (info.orders[key].value for key in ("additive", "commutative", "general"))
        orders = f"strong order {' / '.join(f'{value:g}' for value in strong)}"
        kind = "symplectic" if info.symplectic else "not symplectic"
        lines.append(f"  {name:26s} {kind:15s} {orders}  {info.reference}")
    lines.append("  (strong orders: additive / commutative / general noise; also dirk:C and lambda:X, as lambda:0.3)")
    return "\n".join(lines)


def _info(_options: argparse.Namespace) -> int:
    for key, value in build_info().items():
        print(f"{key}: {value}")
    print(f"python: {sys.version.split()[0]}")
    for package in ("numpy", "xarray", "netCDF4", "matplotlib", "numba", "tqdm"):
        print(f"{package}: {'yes' if importlib.util.find_spec(package) else 'not installed'}")
    return OK


def _paper(options: argparse.Namespace) -> int:
    _files.optional("matplotlib", "plot")
    paper = importlib.import_module("symsde.paper")
    return int(paper.run(options.out, options.quick) or OK)
