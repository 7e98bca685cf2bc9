# SPDX-License-Identifier: BSD-3-Clause
"""The rooms of the library: which families of modules use which, and which modules are private to a family.

check_rooms.py ROOT         one line per finding; exit 1 where there is one
check_rooms.py ROOT --draw  write the picture of CONTRIBUTING.md anew
check_rooms.py --self-test  plants a violation of every rule and requires that each is found

A room is a folder below an area (src/step/midpoint); a file that stands directly in an area is a room of its own.
Arrows between rooms make no circle. A module whose header says "Private to its family." is used in its room alone; so
is a body (.inc), except those of src/solve.

Steppers get Hhat from the one-step Hamiltonian: below src/step, files outside the room hamiltonian may call the model
itself, for single H_j, only as often as ASKS_MODEL allows.

The rooms of the Python package are its folders and the modules that stand directly in it: arrows between them make no
circle, whether imported at the top, inside a function or by name. The package itself, which hands out the names of all
rooms, is no room.

The docstring of an __init__.py is a map if its lines begin with names of modules and two spaces. A map names the
modules and the folders beside it, all of them and no others.
"""

import ast
import re
import sys
import tempfile
from collections import defaultdict
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

from bodies import INCLUDE

PRIVATE = re.compile(r"^!> Private to its family\.$", re.M)
BY_NAME = re.compile(r'(?:import_module|__import__)\(\s*f?"symsde\.(\w+)')
MAP = re.compile(r"^([a-z]\w*(?:, [a-z]\w*)*)  +\S", re.M)
# Files below src/step that call a model for derivatives themselves: how often, and why.
OPERATION = r"(?:value|gradient|hessian|third_derivative|force_stiffness)\w*"
ASKS = re.compile(rf"^[^!'\n]*(?:\bmodel%{OPERATION}|\bdifference_(?:default|along))\(", re.M)
ASKS_MODEL = {
    "explicit/tableau_gradients.inc": (2, "the Ito drift takes the gradient of one H_k and its Hessian times a vector"),
    "one_dof/brackets.f90": (4, "brackets are made of derivatives of each H_j, third ones too where they nest"),
    "one_dof/brackets_kinetic.f90": (3, "the same, of every U_j, or of sums with weights of their own"),
    "splitting/derivatives.inc": (
        3,
        "kicks are flows of the part of Hhat that depends on q: sums of U and H_k, or each, with derivatives of forces",
    ),
    "splitting/products.inc": (5, "products in kicks: Hess V M^-1 V_q, and Hess H_k with gradients of other H_l"),
}
BEGIN, END = "<!-- rooms: written by tests/house/check_rooms.py -->\n", "<!-- end of rooms -->\n"


def read(root):
    """The modules below src, as name -> (area, room, text)."""
    found = {}
    for file in sorted((root / "src").rglob("*.f90")):
        parts = file.relative_to(root / "src").parts
        if len(parts) > 1:
            room = parts[1] if len(parts) > 2 else file.stem
            name = "_".join(("symsde", *parts[:-1], file.stem))
            found[name] = (parts[0], room, file.read_text(encoding="utf-8"))
    return found


def used(text):
    """The modules of the library that a file uses."""
    return re.findall(r"^\s*use\s+(symsde_\w+)", text, re.M)


def arrows(modules):
    """Room -> the rooms that it uses, as (area, room)."""
    graph = defaultdict(set)
    for area, room, text in modules.values():
        graph[area, room] |= {modules[name][:2] for name in used(text) if name in modules} - {(area, room)}
    return graph


def imported(text, package):
    """Modules of the Python package that a file imports, as tuples of names below it; `package` is the package of the
    file."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            paths = [name.name.split(".") for name in node.names]
        elif isinstance(node, ast.ImportFrom):
            above = ("symsde", *package)[: len(package) + 2 - node.level] if node.level else ()
            paths = [(*above, *(node.module or "").split("."), name.name) for name in node.names]
        else:
            continue
        yield from (tuple(filter(None, path[1:])) for path in paths if path[0] == "symsde" and path[1:])


def packages(root):
    """Room of the Python package -> the rooms that it imports."""
    graph = defaultdict(set)
    top = root / "python" / "symsde"
    rooms = {path.stem for path in top.iterdir() if path.stem != "__init__"}
    for file in sorted(top.rglob("*.py")):
        parts = file.relative_to(top).parts
        room = parts[0].removesuffix(".py")
        if room in rooms:
            text = file.read_text(encoding="utf-8")
            used_here = {path[0] for path in imported(text, parts[:-1])} | set(BY_NAME.findall(text))
            graph[room] |= used_here & rooms - {room}
    return graph


def maps(root):
    """Modules in a map that do not exist, and modules missing from a map."""
    for file in sorted((root / "python" / "symsde").rglob("__init__.py")):
        lines = MAP.findall(ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))) or "")
        named = {name for line in lines for name in line.split(", ")}
        if not named:
            continue
        there = {path.stem for path in file.parent.glob("*.py")} - {"__init__"}
        there |= {path.parent.name for path in file.parent.glob("*/__init__.py")}
        shown = file.relative_to(root)
        yield from (f"{shown} names the module {name}, which is not there" for name in sorted(named - there))
        yield from (f"{shown} does not name the module {name}" for name in sorted(there - named))


def folders(root):
    """The folders below each area."""
    areas = sorted(path for path in (root / "src").iterdir() if path.is_dir())
    return {area.name: sorted(path.name for path in area.iterdir() if path.is_dir()) for area in areas}


def reached(graph, start):
    """The rooms that a room uses indirectly, through others."""
    found, left = set(), [room for first in graph[start] for room in graph[first]]
    while left:
        room = left.pop()
        if room not in found:
            found.add(room)
            left += graph[room]
    return found


def picture(root):
    """For each area with rooms, a Mermaid diagram of the arrows that do not follow from other arrows."""
    graph = arrows(read(root))
    lines = ["```mermaid", "flowchart BT"]
    for area, rooms in folders(root).items():
        if not rooms:
            continue
        lines.append(f"   subgraph {area}")
        lines += [f"      {area}_{room}[{room}]" for room in rooms]
        lines += [
            f"      {area}_{room} --> {area}_{to}"
            for room in rooms
            for to in rooms
            if (area, to) in graph[area, room] - reached(graph, (area, room))
        ]
        lines.append("   end")
    return "\n".join([*lines, "```", ""])


def with_picture(root):
    """CONTRIBUTING.md with the diagrams of the present tree."""
    before, rest = (root / "CONTRIBUTING.md").read_text(encoding="utf-8").split(BEGIN)
    return before + BEGIN + picture(root) + END + rest.split(END)[1]


def findings(root):
    """Every finding, as a line of text."""
    modules = read(root)
    try:
        TopologicalSorter(arrows(modules)).prepare()
    except CycleError as error:
        yield "rooms in a circle: " + " -> ".join("/".join(room) for room in error.args[1])
    for name, (area, room, text) in modules.items():
        for other in used(text):
            if other in modules and modules[other][:2] != (area, room) and PRIVATE.search(modules[other][2]):
                yield f"{name} uses {other}, which is private to its family"
        for body in INCLUDE.findall(text):
            if "/" in body and "/solve/" not in body:
                yield f"{name} includes {body}, which is a body of another family"
    step = root / "src" / "step"
    for file in sorted(path for path in step.rglob("*") if path.suffix in (".f90", ".inc")):
        shown = str(file.relative_to(step))
        calls, allowed = len(ASKS.findall(file.read_text(encoding="utf-8"))), ASKS_MODEL.get(shown, (0, ""))[0]
        if calls > allowed and not shown.startswith("hamiltonian/"):
            yield (
                f"src/step/{shown} asks the model itself, {calls} times, {allowed} are allowed: ask the one-step "
                "Hamiltonian (src/step/hamiltonian/one_step.f90), or say in ASKS_MODEL why a single H_j is needed"
            )
    try:
        TopologicalSorter(packages(root)).prepare()
    except CycleError as error:
        yield "packages in a circle: " + " -> ".join(error.args[1])
    yield from maps(root)
    if with_picture(root) != (root / "CONTRIBUTING.md").read_text(encoding="utf-8"):
        yield "CONTRIBUTING.md: the picture of the rooms is not as the tree is: run tests/house/check_rooms.py . --draw"


def planted(root, files, python):
    """Write a tree of modules, path -> names that they use or include; names in capitals are private. python:
    likewise.
    """
    for path, uses in files.items():
        file = root / "src" / path.lower()
        file.parent.mkdir(parents=True, exist_ok=True)
        head = "!> Private to its family.\n" if path != path.lower() else ""
        lines = (
            f"   include '{it}'\n" if ".inc" in it else f"   {it}\n" if " " in it else f"   use symsde_{it}, only: x\n"
            for it in uses
        )
        file.write_text(head + "".join(lines))
    for path, text in python.items():
        file = root / "python" / "symsde" / path
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
    (root / "CONTRIBUTING.md").write_text(BEGIN + END)
    (root / "CONTRIBUTING.md").write_text(with_picture(root))


def self_test():
    """A sound tree gives no finding, and every planted violation is found by its own rule."""
    sound = {"step/a/X.f90": (), "step/a/y.f90": ("step_a_x",), "step/b/z.f90": ("step_a_y",), "step/c.f90": ()}
    cases = {
        "": sound,
        "in a circle": {**sound, "step/a/y.f90": ("step_c",), "step/c.f90": ("step_b_z",)},
        "is private": {**sound, "step/b/z.f90": ("step_a_x",)},
        "b/z.f90 asks the model itself": {**sound, "step/b/z.f90": ("call ham%model%gradient(n, hq)",)},
        "c.f90 asks the model itself": {**sound, "step/c.f90": ("call difference_default(model, n)",)},
        "of another family": {**sound, "step/b/z.f90": ("step_a_y", "../a/x.inc")},
    }
    python = {"run/x.py": "from ..model.y import z\n", "model/y.py": ""}
    circle = {**python, "model/y.py": "def f():\n    from .. import run\n"}
    named = {**python, "model/y.py": 'import_module("symsde.run.html")\n'}
    formatted = {**python, "model/y.py": 'importlib.import_module(\n    f"symsde.run.{name}")\n'}
    absolute = {**python, "model/y.py": "import symsde.run.x\n"}
    whole = {**python, "model/y.py": "from symsde import run\n"}
    direct = {**python, "run/x.py": "from .. import models\n", "models.py": "def f():\n    from .run import x\n"}
    mapped = {**python, "run/__init__.py": '"""Runs.\n\nx, part  what is run\n"""\n', "run/part/__init__.py": ""}
    misnamed = {**mapped, "run/__init__.py": '"""Runs.\n\nx, z     what is run\npart     more\n"""\n'}
    unnamed = {**mapped, "run/y.py": ""}
    cases = [(wanted, files, mapped) for wanted, files in cases.items()]
    cases += [("packages in a circle: ", sound, modules) for modules in (circle, absolute, whole, named, formatted)]
    cases += [("models -> run", sound, direct)]
    cases += [("names the module z,", sound, misnamed), ("does not name the module y", sound, unnamed)]
    for wanted, files, modules in cases:
        with tempfile.TemporaryDirectory() as folder:
            planted(Path(folder), files, modules)
            found = list(findings(Path(folder)))
            if (found != []) if wanted == "" else not any(wanted in line for line in found):
                yield f"planted '{wanted}', found {found}"
            (Path(folder) / "src/step/b/z.f90").write_text("")
            if wanted == "" and not any("--draw" in line for line in findings(Path(folder))):
                yield "a picture of another tree was not found"


def main():
    """Run the check, its self-test, or draw."""
    if sys.argv[1:] == ["--self-test"]:
        found = list(self_test())
    elif "--draw" in sys.argv:
        root = Path(sys.argv[1])
        (root / "CONTRIBUTING.md").write_text(with_picture(root), encoding="utf-8")
        return 0
    else:
        found = list(findings(Path(sys.argv[1])))
    print("\n".join(found) if found else "nothing to report")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
