# SPDX-License-Identifier: BSD-3-Clause
"""The command line: symsde VERB, or python -m symsde VERB."""

from __future__ import annotations

import argparse
import importlib
import importlib.util
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NoReturn

from .. import models, schemes
from ..batch import scene
from ..errors import NotWrittenError, SymsdeError, shortened
from ..native import checks, cpu, files, library
from ..native.build import build_info
from ..show import tables
from ..studies import catalogue
from . import advise_command as advise
from . import cite, merge_command, selftest
from . import expect_command as expect
from . import export_command as export
from . import plot_command as plot
from . import run_command as batch
from . import slurm_command as slurm
from . import stability_command as stability
from . import study_command as study
from .output import patient_output

OK, INTERNAL, BAD_INPUT, PATHS_FAILED, STOPPED, NOT_WRITTEN = 0, 1, 2, 3, 4, 5
_WITH_SCENES = ("run", "merge", "plot", "check", "study", "expect", "advise", "slurm", "stability")
_EPILOG = (
    "exit codes: 0 ok, 1 internal error, 2 bad input, 3 some paths failed or a value was not a finite number, "
    "4 stopped, 5 a file or folder failed"
)


def main(arguments: list[str] | None = None) -> int:
    """Run the command line and return the exit code."""
    try:
        with checks.unwarned(), _terminated_as_interrupted(), patient_output():  # failures: an exit code and a line
            parser = _parser()
            options = parser.parse_args(arguments)
            if "verb" not in options:
                parser.print_help(sys.stderr)
                return BAD_INPUT
            scene.PYTHON_ALLOWED.set(getattr(options, "allow_python", False))
            return options.verb(options)
    except (SymsdeError, OSError) as error:
        print(f"symsde: {shortened(str(error))}", file=sys.stderr)
        is_input = isinstance(error, SymsdeError) and not isinstance(error, NotWrittenError)
        return BAD_INPUT if is_input else NOT_WRITTEN
    except KeyboardInterrupt:
        print("symsde: stopped", file=sys.stderr)
        return STOPPED


@contextmanager
def _terminated_as_interrupted() -> Iterator[None]:
    """Treat SIGTERM as Ctrl-C, unless somebody else handles it, so that unfinished work is cleaned up."""
    mine = threading.current_thread() is threading.main_thread()
    if not mine or signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL:
        yield
        return
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)


class _Parser(argparse.ArgumentParser):
    """A parser whose messages have bearable length."""

    def error(self, message: str) -> NoReturn:
        """Exit with a sentence."""
        super().error(shortened(message))


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="symsde", description="Symplectic integration of stochastic Hamiltonian systems.", epilog=_EPILOG
    )
    parser.add_argument("--version", action="version", version=f"symsde {build_info().get('version', '?')}")
    verbs = parser.add_subparsers(title="verbs", metavar="VERB")

    def add(verb, function, text):
        sub = verbs.add_parser(verb, help=text, description=text, epilog=_EPILOG)
        sub.set_defaults(verb=function)
        if verb in _WITH_SCENES:
            sub.add_argument("--allow-python", action="store_true", help="let scenes name Python functions")
        return sub

    run = add("run", batch.run, "Run a scene in a folder of shards, or resume it. It ends with moments.csv and run.nc.")
    batch.arguments(run)
    merge_command.arguments(add("merge", merge_command.run, merge_command.HELP))
    plot.arguments(add("plot", plot.run, plot.HELP))
    add("check", _check, "Check a scene without running it.").add_argument("scene", metavar="SCENE.toml")
    add("template", _template, "Print a scene of a built-in model, or of a formula.").add_argument(
        "model", metavar="MODEL", help="name of a built-in model, or the word formula"
    )
    listed = add("list", _list, "List models with their parameters, and schemes.")
    listed.add_argument("what", nargs="?", choices=("models", "schemes"), help="one of the two (default: both)")
    listed.add_argument("--markdown", action="store_true", help="print the tables of the documentation")
    add("info", _info, "Print versions, compiler and optional packages.")
    add("selftest", selftest.run, selftest.HELP)
    cite.arguments(add("cite", cite.run, cite.HELP))
    export.arguments(add("export", export.run, export.HELP))
    work = add("study", study.run, study.HELP)
    study.arguments(work)
    expect.arguments(add("expect", expect.run, expect.HELP))
    advise.arguments(add("advise", advise.run, advise.HELP))
    slurm.arguments(add("slurm", slurm.run, slurm.HELP))
    extremes = add("stability", stability.run, stability.HELP)
    stability.arguments(extremes)
    paper = add("paper", _paper, "Run every experiment of the paper; write results.json and figures.")
    paper.add_argument("--out", metavar="DIR", default="out/paper", help="directory of the results (%(default)s)")
    paper.add_argument("--quick", action="store_true", help="fewer paths and steps")
    add("completion", _completion, "Print a script that completes verbs and options in a shell.").add_argument(
        "shell", choices=("bash", "zsh", "tcsh")
    )
    return parser


def _completion(options: argparse.Namespace) -> int:
    shtab = files.optional("shtab", "completion")
    print(shtab.complete(_parser(), shell=options.shell))
    return OK


def _check(options: argparse.Namespace) -> int:
    chosen = scene.load(options.scene)
    report = chosen.try_out().report
    if "study" in chosen.tables:
        importlib.import_module("symsde.studies.study.study_scenes").check(options.scene)
    print(f"{options.scene}: ok")
    told = {"model": repr(chosen.model), "stepper": report.stepper, "left out": "; ".join(report.left_out) or "nothing"}
    warnings = [("warning", sentence) for sentence in (*report.warnings, chosen.unsaid) if sentence]
    print(tables.facts([*told.items(), *warnings]))
    return OK


def _template(options: argparse.Namespace) -> int:
    print(scene.template(options.model), end="")
    return OK


def _list(options: argparse.Namespace) -> int:
    if options.what != "schemes":
        print("\n".join(catalogue.models_parts().values()) if options.markdown else _models())
    if options.what != "models":
        print("\n".join(catalogue.schemes_parts().values()) if options.markdown else _schemes())
    return OK


def _models() -> str:
    lines = ["models"]
    for name in models.names():
        parameters = ", ".join(f"{key}={value:g}" for key, value in models.parameters(name).items())
        lines.append(f"  {name}({parameters})")
    return "\n".join(lines)


def _schemes() -> str:
    rows = []
    for name in schemes.names():
        info = schemes.get(name).info
        strong = [info.orders[key].value for key in ("additive", "commutative", "general")]
        orders = f"strong order {' / '.join(f'{value:g}' for value in strong)}," if any(strong) else ""
        kind = "symplectic" if info.symplectic else "not symplectic"
        rows.append([f"  {name}", kind, orders, f"weak order {info.orders['weak'].value:g}  {info.reference}"])
    lines = ["schemes", tables.aligned(rows, (-28, -15, -30, 0))]
    lines.append(
        "  (strong orders: additive / commutative / general noise; schemes without one draw two- or three-point"
    )
    lines.append("  point increments, which follow no Brownian path; also dirk:C, lambda:X, word:W, as word:BAOAB)")
    return "\n".join(lines)


def _info(_options: argparse.Namespace) -> int:
    for key, value in build_info().items():
        kept = ("-march", "-mtune", "-mcpu")  # these options imply the hundred features that the compiler lists
        told = [word for word in value.split() if not word.startswith("-m") or word.startswith(kept)]
        print(f"{key}: {' '.join(told)}")
    print(f"library: {library.found()}")
    print(f"processor: {', '.join(cpu.levels()) or 'no levels known'} (SYMSDE_CPU chooses a variant of the library)")
    print(f"python: {sys.version.split()[0]}")
    for package in ("numpy", "xarray", "netCDF4", "matplotlib", "numba", "tqdm"):
        print(f"{package}: {'yes' if importlib.util.find_spec(package) else 'not installed'}")
    return OK


def _paper(options: argparse.Namespace) -> int:
    files.optional("matplotlib", "plot")
    paper = importlib.import_module("symsde.studies.paper")
    return int(paper.run(options.out, options.quick) or OK)
