# SPDX-License-Identifier: BSD-3-Clause
"""The parts of a scene that a program needs, checked."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..batch.scene import Scene
from ..errors import InvalidArgumentError
from ..model.definition import require_closed
from ..model.formulas import FormulaModel
from ..model.split import Split
from ..native import abi
from ..run.options import make_options
from ..run.setup import make_setup

#: names of components and procedures of the type that a Fortran model extends (src/model/abstract.f90)
_TAKEN = frozenset(
    (
        *(
            "traits",
            "name",
            "damping",
            "passed",
            "paths",
            "for_paths",
            "refuse_paths",
            "failure_code",
            "clear_failure",
            "note_failure",
            "set_forces",
            "refuse_forces",
            "require_gradient",
            "forces",
            "force",
            "force_derivative",
            "force_along",
            "force_bands",
            "calls_users",
            "gradient",
            "value",
            "hessian",
        ),
        *("hessian_vector", "gradient_hessian", "hessian_banded", "force_stiffness", "third_derivative"),
    )
)
#: options of a run that programs do not set: for example the number of threads, which depends on the machine
_LEFT_OUT = {"struct_size", "progress", "progress_user", "threads", "lanes"}


@dataclass(frozen=True)
class Given:
    """A scene as needed by a program."""

    stem: str  #: name of the program and of its file
    title: tuple[str, ...]  #: lines of the comment at the top
    model: FormulaModel | None  #: model made of formulas; None = built-in
    name: str  #: name of the model
    parameters: dict[str, Any]  #: parameter name of the scene -> value, or a tuple of values for all sites
    identifiers: dict[str, str]  #: parameter name of the scene -> identifier that Fortran accepts
    scheme: str
    options: dict[str, int | float]  #: members of symsde_options that differ from their default
    q0: tuple[float, ...]
    p0: tuple[float, ...]
    ntime: int
    has_energy: bool
    third: dict[str, list[int]]  #: nodes of third derivatives, if the scheme needs them

    @property
    def is_chain(self) -> bool:
        """Whether the model holds sums over sites."""
        return self.model is not None and self.model._chain is not None


def given_of(scene: Scene, stem: str) -> Given:
    """Read a scene; features that a program cannot express are refused."""
    setup = make_setup(scene.model, **scene.run)
    model = scene.model
    require_closed(model, "programs are written")
    if any(isinstance(x, np.ndarray) for x in model.parameters.values()):
        raise InvalidArgumentError(
            f"{scene.file}: parameters of model {model.name} go by path, and a program holds one value of each"
        )
    if setup.saved is not None:
        raise InvalidArgumentError(f"{scene.file}: [run] save_at: a program saves at equal distances, give save_every")
    if any(np.shape(x)[1:] != (1,) for x in setup.start().values()):
        raise InvalidArgumentError(
            f"{scene.file}: [run] q0, p0 differ from path to path, and a program holds one state: give one for all"
        )
    default = make_options(model, step=1.0, steps=0)
    names = [name for name, *_ in abi.Options._fields_ if name not in _LEFT_OUT]
    options = {x: getattr(setup.options, x) for x in names if getattr(setup.options, x) != getattr(default, x)}
    is_formula = isinstance(model, FormulaModel)
    made = model._derivatives if is_formula else None
    takes_third = made is not None and setup.scheme.info.uses_nested_bracket and made.has_brackets()
    return Given(
        stem=stem,
        title=_title(scene, model),
        model=model if is_formula else None,
        name=harmless(model.name),
        parameters=dict(model.parameters),
        identifiers=identifiers(model.parameters),
        scheme=setup.scheme.name,
        options=options,
        q0=tuple(np.asarray(setup.q0)[:, 0].tolist()),
        p0=tuple(np.asarray(setup.p0)[:, 0].tolist()),
        ntime=setup.ntime,
        has_energy=model.traits.has_value,
        third=(takes_third and made.third()) or {},
    )


def _title(scene: Scene, model) -> tuple[str, ...]:
    lines = [f"From the scene {harmless(Path(scene.file).name)}."]
    if isinstance(model, FormulaModel):
        hamiltonians = model.formula.hamiltonians
        lines += ["", *(f"   {'H' if j == 0 else f'H_{j}'} = {harmless(h)}" for j, h in enumerate(hamiltonians))]
        for letter, what in (("q", "coordinates"), ("p", "momenta")):
            given = model._remade[1][0][letter]
            names = given if isinstance(given, list | tuple) else [given] if given is not None else []
            where = f"the rows of {letter}" + (", for one site after the other" if model._chain else "")
            lines += [f"   {what} {', '.join(harmless(x) for x in names)}: {where}"] if names else []
    return tuple(lines)


def harmless(text: str) -> str:
    """A text for comments and names: one line, without characters that could end a comment or a literal."""
    lines = (part.partition("#")[0] for part in str(text).splitlines())
    line = re.sub(r"[^A-Za-z0-9_ +\-*/().,\[\]=]", " ", " ".join(lines))
    while "*/" in line or "/*" in line:
        line = line.replace("*/", "* /").replace("/*", "/ *")
    return " ".join(line.split())[:400]


def identifiers(names: Iterable[str]) -> dict[str, str]:
    """Identifiers for Fortran, which ignores case: the user's names if possible."""
    result: dict[str, str] = {}
    used = set(_TAKEN)
    for k, name in enumerate(names):
        fits = re.fullmatch(r"(?!parameter_\d+$)[a-z][a-z0-9_]{0,30}", name.lower(), re.ASCII)
        result[name] = name if fits and name.lower() not in used else f"parameter_{k + 1}"
        used.add(result[name].lower())
    return result


_FEW = 8  #: most degrees of freedom that are written out


def columns(ndof: int, has_energy: bool) -> str:
    """Describe the columns of the output."""
    names = [f"{x}{i + 1}" if ndof > 1 else x for x in "qp" for i in range(ndof)] if ndof <= _FEW else ["all q, all p"]
    return " ".join([*names, *(["H"] if has_energy else [])])


def equal(values: tuple[float, ...]) -> bool:
    """Whether these are many numbers, all equal."""
    return len(values) > _FEW and len(set(values)) == 1


def entries(split: Split) -> list[tuple[int, int, float]]:
    """Row, column and value of the second derivatives of a quadratic part that are not zero."""
    return [(i, j, x) for i, row in enumerate(split) for j, x in enumerate(row) if x]


def supports(given: Given) -> tuple[list[int], list[int]] | None:
    """What noises touch, as places and degrees of freedom; None where all noises meet, and for sums over sites, whose
    programs are for any number of them."""
    lists = given.model.traits.touches or ()
    if given.is_chain or all(set(a) & set(b) for a, b in itertools.combinations(lists, 2)):
        return None
    return [0, *itertools.accumulate(map(len, lists))], [i for several in lists for i in several]
