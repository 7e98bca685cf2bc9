# SPDX-License-Identifier: BSD-3-Clause
"""`symsde export`: a scene as a program in Fortran or C."""

from __future__ import annotations

import argparse
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

from ..batch import scene
from ..errors import InvalidArgumentError, NotWrittenError
from ..export import in_c, in_fortran
from ..export.given import given_of
from ..native import library as _library

HELP = "Write a scene as a program in Fortran or C: the model, with its formulas, and a run that prints its moments."
ENDING = {"fortran": ".f90", "c": ".c"}


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `symsde export`."""
    parser.add_argument("scene", metavar="SCENE.toml")
    parser.add_argument("--to", choices=tuple(ENDING), required=True, help="the language")
    parser.add_argument("--out", metavar="FILE", help="file to write (default: named after the scene, in this folder)")


def run(options: argparse.Namespace) -> int:
    """Write the program; print the line that compiles it."""
    plain = re.sub(r"\W", "_", Path(options.scene).stem, flags=re.ASCII)
    target = Path(options.out or f"{plain}{ENDING[options.to]}")
    if target.suffix != ENDING[options.to]:
        raise InvalidArgumentError(f"--out {target}: a program in {options.to} ends in {ENDING[options.to]}")
    if not re.fullmatch(r"[A-Za-z]\w*", target.stem, flags=re.ASCII):  # the name becomes part of a command line
        raise InvalidArgumentError(f"--out {target.name!r}: name programs by a letter, then letters, digits and _")
    line = compile_line(options.to, target)
    _refuse_python(options.scene)
    chosen = scene.load(options.scene)
    text = (in_fortran if options.to == "fortran" else in_c).source(given_of(chosen, target.stem[:50]), line)
    try:
        target.write_text(text, encoding="utf-8")
    except OSError as error:
        raise NotWrittenError(f"{target} cannot be written: {error.strerror}") from error
    print(line)
    if missing := left_out(chosen):
        print(f"symsde: left out, programs print moments of q, p and H alone: {', '.join(missing)}", file=sys.stderr)
    return 0


def _refuse_python(file: str) -> None:
    """Refuse a scene whose model is a Python function, before its code is executed."""
    model = scene._read(file)[1].get("model")
    if isinstance(model, dict) and "python" in model:
        raise InvalidArgumentError(f"{file}: a model that is a Python function cannot be exported: give formulas")


def left_out(chosen: scene.Scene) -> list[str]:
    """Tables and keys of a scene that request results besides moments."""
    wanted = {"[observables]": chosen.observables, "[[observe]]": chosen.observers, "paths of [output]": chosen.paths}
    return [name for name, given in wanted.items() if given]


def compile_line(language: str, target: Path) -> str:
    """The command that compiles the program: with pkg-config if it knows the library, else with this package's
    library.
    """
    compiler = "gfortran -O2 -frecursive" if language == "fortran" else "cc -O2"
    out = f"{compiler} {target.name} -o {target.stem}"
    if shutil.which("pkg-config") and not subprocess.run(["pkg-config", "--exists", "symsde"], check=False).returncode:
        return f"{out} $(pkg-config --cflags --libs symsde) -lm"
    library = Path(_library.library._name).resolve()
    folders = [library.parent / "include", *(parent / "include" for parent in library.parents)]
    wanted = "symsde/*/symsde.mod" if language == "fortran" else "symsde.h"
    found = next((file for folder in folders for file in sorted(folder.glob(wanted))), None)
    if found is None:
        return f"{out} $(pkg-config --cflags --libs symsde) -lm"
    places = (f"-I{found.parent}", str(library), f"-Wl,-rpath,{library.parent}")
    return f"{out} {shlex.join(places)} -lm"
