# SPDX-License-Identifier: BSD-3-Clause
"""Scenes: TOML files that describe a run. A scene is read, checked and described here; `execute` computes it."""

from __future__ import annotations

import importlib
import inspect
import os
import re
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from .. import models
from ..errors import InvalidArgumentError, SceneError, SymsdeError
from ..model.definition import Model
from ..model.formulas import formula_scenes as formulas
from ..model.thermostat import thermostat
from ..native import checks, files
from ..run.groups import Groups, refuse_sites
from ..run.moments import Moments, try_out
from ..run.observers import observables, requests
from ..run.setup import make_setup
from ..run.simulate import Run, simulate
from ..run.states.named import from_table
from . import by_path, named_functions

_NOT_IN_SCENES = {"model", "increments", "progress", "q0_low", "p0_low"}
RUN_KEYS = [key for key in inspect.signature(simulate).parameters if key not in _NOT_IN_SCENES]
_REQUIRED = ("step", "steps", "q0", "p0")
OUTPUT_KEYS = ["moments", "paths", "keep_last"]
STUDY_KEYS = ["schemes", "steps", "horizon", "paths", "reference", "reference_steps", "repeats", "interval"]
EXPECT_KEYS = ["f", "abs", "rel", "horizon", "scheme", "method", "max_time"]

#: whether scenes may name Python functions; set by --allow-python of the command line
PYTHON_ALLOWED = named_functions.ALLOWED


@dataclass
class Scene:
    """A checked scene."""

    file: str
    model: Model
    run: dict[str, Any]  #: options of `simulate`
    moments: bool  #: whether moments are wanted
    paths: list[int] | range  #: global indices of the paths to save, ascending
    study: dict[str, Any] = field(default_factory=dict)  #: options of `work_precision`
    expect: dict[str, Any] = field(default_factory=dict)  #: options of `expect`
    tables: dict[str, Any] = field(default_factory=dict)  #: tables of the file as they were read
    text: str = ""  #: text of the file
    #: observables that the user defined, by name
    observables: dict[str, observables.Observable] = field(default_factory=dict)
    observers: dict[str, requests.Observer] = field(default_factory=dict)  #: observers beside moments, by name
    groups: Groups | None = None  #: paths with the same values of parameters that go by path
    keep_last: bool = False  #: whether shards of moments hold last states, from which more steps go on

    @property
    def unsaid(self) -> str:
        """The warning about passages without `absorb` beside other results; empty if there is none."""
        return requests.unsaid(self.observers, beside=bool(self.observables) or len(self.paths) > 0)

    def try_out(self) -> Run:
        """Set everything up as for the run, but take no step; misuse raises SceneError."""
        try:
            return simulate(self.model._part(slice(1)), **self.start())
        except SymsdeError as error:
            raise SceneError(f"{self.file}: [run]: {error}") from error

    def start(self) -> dict[str, Any]:
        """The options of the run, for one path and no step."""
        setup = make_setup(self.model, **self.run)
        q, p = setup.first_state()
        return {**self.run, "steps": 0, "save_at": None, "paths": 1, "q0": q, "p0": p}


def saved_times(run: Mapping[str, Any]) -> int:
    """Number of saved times of a table [run]."""
    if run.get("save_at") is not None:
        return len(run["save_at"])
    return int(run["steps"]) // int(run.get("save_every", 1)) + 1


def load(path: str | os.PathLike, more: Mapping[str, int] | None = None, *, keep_last: bool = False) -> Scene:
    """Read and check a scene, with keys of [run] in the place of its own; SceneError names the file and the key.
    keep_last: as if [output] said so."""
    file = str(path)
    text, tables = _read(file)
    _known(file, "table", tables, ["model", "run", "output", "observables", "observe", "study", "expect"])
    for name in ("model", "run"):
        if name not in tables:
            raise SceneError(f"{file}: there is no table [{name}]: `symsde template kubo` prints a whole scene")
    for name, table in tables.items():
        if name != "observe" and not isinstance(table, dict):
            raise SceneError(f"{file}: {name} is not a table: write it as [{name}] with keys below")
    run = _with_laws(file, {**tables["run"], **(more or {})})
    _known(file, "key of [run]", run, RUN_KEYS)
    for key in _REQUIRED:
        if key not in run:
            raise SceneError(f"{file}: [run] lacks {key}: give step, steps, q0 and p0, or initial for both")
    output = dict(tables.get("output", {}))
    _known(file, "key of [output]", output, OUTPUT_KEYS)
    wants_moments, keeps = _flag(file, output, "moments", True), _flag(file, output, "keep_last", False) or keep_last
    if keeps and not wants_moments:
        raise SceneError(
            f"{file}: keep_last keeps the last states of moments, and [output] has moments = false; saved paths go on "
            "from their last states without it: leave out one of the two"
        )
    study = dict(tables.get("study", {}))
    _known(file, "key of [study]", study, STUDY_KEYS)
    expect = dict(tables.get("expect", {}))
    _known(file, "key of [expect]", expect, EXPECT_KEYS)
    table, groups = by_path.of_table(file, dict(tables["model"]), run)
    model = _model(file, table)
    try:
        refuse_sites(model, groups.grid.values if groups else ())
    except SymsdeError as error:
        raise SceneError(f"{file}: [model]: {error}") from error
    scene = Scene(file, model, run, wants_moments, [], study, expect, tables)
    scene.text, scene.groups, scene.keep_last = text, groups, keeps
    tried = scene.try_out()
    scene.paths = _paths(file, output.get("paths", []), run)
    scene.observables = _observables(file, scene)
    scene.observers = _observers(file, scene)
    try:
        shape = (2, saved_times(run), tried.model.ndof, len(scene.paths))
        checks.room(shape, "the saved paths (q and p; time, dof, path)", now=False)
    except SymsdeError as error:
        raise SceneError(f"{file}: [output] paths: {error}") from error
    return scene


def _flag(file: str, output: dict[str, Any], key: str, default: bool) -> bool:
    """A key of [output] that is true or false."""
    found = output.get(key, default)
    if not isinstance(found, bool):
        raise SceneError(f"{file}: [output] {key} = {found!r}: give true or false")
    return found


def _with_laws(file: str, run: dict[str, Any]) -> dict[str, Any]:
    """The table [run] with laws of initial states in the place of tables; initial = {..} is the law of q0 and p0."""
    try:
        if "initial" in run:
            if given := [x for x in ("q0", "p0") if x in run]:
                raise InvalidArgumentError(
                    f"initial is the law of q0 and p0, and {given[0]} is there, too: leave one out"
                )
            if not isinstance(run["initial"], dict):
                raise InvalidArgumentError(
                    f"initial = {checks.shown(run['initial'])}: give a law of q0 and p0, as "
                    '{law = "normal", sd = 0.1}, or q0 and p0'
                )
            run["q0"] = run["p0"] = run.pop("initial")
        laws = {}
        for key in ("q0", "p0"):
            if isinstance(run.get(key), dict):
                laws[id(run[key])] = laws.get(id(run[key])) or from_table(run[key], Path(file).parent)
                run[key] = laws[id(run[key])]
    except SymsdeError as error:
        raise SceneError(f"{file}: [run]: {error}") from error
    return run


def _observables(file: str, scene: Scene) -> dict[str, observables.Observable]:
    """Try out the table [observables]: formulas need sympy, which scenes without formulas do not."""
    if "observables" not in scene.tables:
        return {}
    folder = Path(file).parent
    found: dict[str, Any] = {}
    for name, given in scene.tables["observables"].items():
        if isinstance(given, dict) and list(given) == ["python"]:
            try:
                found[name] = named_functions.NamedObservable(str(folder.resolve()), given["python"])
            except SymsdeError as error:
                raise SceneError(f"{file}: [observables] {name}: {error}") from error
        elif isinstance(given, str):
            found[name] = given
        else:
            raise SceneError(
                f"{file}: [observables] {name} = {checks.shown(given)}: give a formula as text, in quotes, or "
                '{python = "module:function"}'
            )
    try:
        observables.check_observables(found)
        try_out(scene.model._part(slice(1)), found, **{**scene.start(), "first_path": 0})
    except SymsdeError as error:
        raise SceneError(f"{file}: [observables]: {error}") from error
    if found and not scene.moments:
        raise SceneError(f"{file}: [observables] go with moments: leave out moments = false of [output]")
    return found


def _observers(file: str, scene: Scene) -> dict[str, requests.Observer]:
    """Try out the tables [[observe]] on the run."""
    if "observe" not in scene.tables:
        return {}
    try:
        found = requests.from_tables(scene.tables["observe"])
        Moments(make_setup(scene.model, **scene.run), scene.observables, found, scene.groups)
    except SymsdeError as error:
        raise SceneError(f"{file}: [[observe]]: {error}") from error
    if not scene.moments:
        raise SceneError(f"{file}: [[observe]] goes with moments: leave out moments = false of [output]")
    return found


NESTED = re.compile(r"(?:[\[{][\s\w.,=]*){50}")  #: text with more open brackets in sequence than any scene has


def _read(file: str) -> tuple[str, dict[str, Any]]:
    """The text of a scene, and its content as tables."""
    tomllib = importlib.import_module("tomllib" if sys.version_info >= (3, 11) else "tomli")
    try:
        files.require_file(file)
        text = Path(file).read_text(encoding="utf-8-sig")  # some editors begin a file with a byte order mark
        if NESTED.search(text):  # deeper nesting would exhaust Python's stack
            raise RecursionError
        return text, tomllib.loads(text)
    except OSError as error:
        raise SceneError(f"{file} cannot be read: {error.strerror}") from error
    except RecursionError as error:
        raise SceneError(f"{file} is not a scene: its brackets are nested too deeply") from error
    except ValueError as error:  # invalid TOML, invalid UTF-8, or an integer of thousands of digits
        raise SceneError(f"{file} is not TOML: {error}") from error


def _known(file: str, what: str, given: dict, known: list[str]) -> None:
    for key in given:
        if key not in known:
            raise SceneError(f"{file}: {key!r} is no {what}: there are {checks.nearest(key, known)}")


def _model(file: str, table: dict[str, Any]) -> Model:
    own = "python" in table  # the function gets all other keys
    damping, bath, gains = (None if own else table.pop(key, None) for key in ("damping", "thermostat", "allow_gain"))
    if gains is not None and damping is None:
        raise SceneError(
            f"{file}: [model] allow_gain = {checks.shown(gains)} says that rates may be negative: give damping"
        )
    gains = {} if gains is None else {"allow_gain": gains}
    if "H" in table and formulas.holds_formulas(damping):  # which may hold parameters of the model
        table, damping, gains = {**table, "damping": damping, **gains}, None, {}
    model = _own_model(file, table) if "H" in table or own else _built_in(file, table)
    try:
        if damping is not None:
            model = model.damped(damping, **gains)
        return model if bath is None else thermostat(model, **_bath(file, bath))
    except SceneError:
        raise
    except SymsdeError as error:
        raise SceneError(f"{file}: [model]: {error}") from error


def _bath(file: str, given: object) -> dict[str, Any]:
    """The numbers of a heat bath."""
    if not isinstance(given, dict) or "beta" not in given:
        raise SceneError(
            f"{file}: [model] thermostat = {checks.shown(given)}: give beta and gamma, as in "
            "{beta = 1.0, gamma = 0.5}, or beta alone for the noises of the model"
        )
    _known(file, "key of thermostat", given, ["beta", "gamma"])
    for key, value in given.items():
        if isinstance(value, dict):
            raise SceneError(
                f"{file}: [model] {key} of the thermostat = {checks.shown(value)}: a bath has the same {key} on all "
                "paths: give a number, or one for each degree of freedom, and a run for each value, as ss.sweep does "
                "with a function that makes the bath"
            )
    return given


def _built_in(file: str, table: dict[str, Any]) -> Model:
    name = table.pop("name", None)
    if not isinstance(name, str):
        known = ", ".join(models.names())
        raise SceneError(f"{file}: [model] lacks name, a text: there are {known}; or give H, a formula")
    try:
        _known(file, "key of [model]", table, [*models.parameters(name), "damping", "allow_gain", "thermostat"])
        return models.get(name, **table)
    except SceneError:
        raise
    except SymsdeError as error:
        raise SceneError(f"{file}: [model]: {error}") from error


def _own_model(file: str, table: dict[str, Any]) -> Model:
    """A model that the scene defines: by formulas, or by a Python function if that is allowed."""
    try:
        return formulas.from_table(table) if "H" in table else _from_python(Path(file).parent, table)
    except SymsdeError as error:
        raise SceneError(f"{file}: [model]: {error}") from error


def _from_python(folder: Path, table: dict[str, Any]) -> Model:
    """The return value of module:function, found relative to the folder of the scene; other keys are its arguments."""
    given = {key: value for key, value in table.items() if key != "python"}
    make = named_functions.function_of(folder, table["python"])
    try:
        model = make(**given)
    except Exception as error:
        raise InvalidArgumentError(
            f"python = {table['python']!r} gives no model: {named_functions.told(error)}"
        ) from error
    if not isinstance(model, Model):
        raise InvalidArgumentError(f"python = {table['python']!r} returns {checks.shown(model)}, which is no model")
    return model


def _paths(file: str, given: object, run: dict[str, Any]) -> list[int] | range:
    """Indices of the paths to save, ascending."""
    first, count = int(run.get("first_path", 0)), int(run.get("paths", 1))
    if given == "all":
        return range(first, first + count)
    if not isinstance(given, list) or not all(type(i) is int for i in given):
        raise SceneError(f'{file}: [output] paths = {given!r}: give a list of indices, or "all"')
    for i in given:
        if not first <= i < first + count:
            raise SceneError(f"{file}: [output] paths: {i} is not among the paths {first} .. {first + count - 1}")
    return sorted(set(given))


def for_schemes(chosen: Scene, table: str, options: Iterable[str], horizon: float | None = None) -> dict[str, Any]:
    """States, options and horizon of [run] for a table or verb with several schemes, forward in time. Keys of [run]
    that it would silently ignore are refused."""
    run, file = chosen.run, chosen.file
    if run["step"] < 0 and horizon is None:
        raise SceneError(
            f"{file}: [{table}]: [run] goes backward in time, errors and means are taken forward: give horizon in "
            f"[{table}], a time above 0, counted from t0"
        )
    for key in ("fixed_point", "max_iter"):
        if key in run:
            raise SceneError(
                f"{file}: [{table}]: {key} = {run[key]} of [run] would have no effect, since [{table}] solves every "
                "scheme to rounding: leave it out"
            )
    wanted = abs(run["step"]) * run["steps"] if horizon is None else horizon
    return {"horizon": wanted, **{key: run[key] for key in (*options, "q0", "p0") if key in run}}


def template(name: str) -> str:
    """A commented scene of a built-in model, or of a formula, with all necessary keys."""
    if checks.name_of("template", name) == "formula":
        return formulas.TEMPLATE
    defaults = models.parameters(name)
    model = models.get(name)
    about = (getattr(models, name).__doc__ or "").splitlines()[0].strip()
    lines = [f"# {about}", "[model]", f'name = "{name}"']
    lines += [f"{key} = {value:.15g}" for key, value in defaults.items()]
    state = "" if model.ndof == 1 else f", or a list of {model.ndof} numbers"
    lines += [
        "",
        "[run]",
        'scheme = "midpoint"   # `symsde list` shows all',
        "step = 0.02           # h",
        "steps = 5000          # a multiple of save_every",
        f"q0 = {0.1 if model.ndof > 1 else 1.0}              # the same for all paths{state}",
        "p0 = 0.0",
        "save_every = 50       # steps between saved points",
    ]
    if model.nnoise:
        lines += ["paths = 1000", "seed = 1"]
    lines += ["", "[output]", "moments = true        # moments.csv: means with standard errors"]
    lines += ["paths = [0]           # run.nc: these paths"]
    return "\n".join(lines) + "\n"
