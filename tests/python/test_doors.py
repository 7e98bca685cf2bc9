# SPDX-License-Identifier: BSD-3-Clause
"""Options are refused with one sentence wherever they are given, and have one default wherever it is stated."""

import ast
import ctypes
import importlib
import inspect
import pkgutil
import re
from pathlib import Path

import numpy as np
import pytest
import symsde as ss
from symsde.native import abi, handles
from symsde.native.checks import address
from symsde.native.library import library
from symsde.run import options as run_options
from symsde.schemes import as_scheme

HERE = Path(ss.__file__).parent
START = {"q0": 1.0, "p0": 0.0}
#: options with one wrong value each, in the forms of C and Python
OF_STEPS = [{"steps": -1}, {"save_every": 0}, {"save_every": -2}, {"save_every": 3}, {"steps": 2**48}]
OF_BEGINNING = [{"first_path": -1}, {"first_step": -1}, {"first_path": 2**47}, {"first_step": 2**48}]
OF_ALL = [
    {"step": 0.0},
    {"step": float("nan")},
    {"step": 1e307, "first_step": 2**20},
    {"t0": float("inf")},
    {"t0": 2.0**60},
    {"paths": 0},
    {"paths": -4},
    {"refine": 31},
    {"refine": -31},
    {"lanes": 3},
    {"lanes": 2**20},
    {"area_time": -1.0},
    {"max_iter": 0},
    {"max_iter": 10**6},
    {"fixed_point": -1},
    {"areas": 1, "area_time": 1.0},
    {"areas": 1, "refine": -1},
]
ONLY_IN_C = [{"threads": -1}, {"threads": 2000}, {"areas": 7}]  # Python has no such values, or refuses them itself
WRONG = [*OF_STEPS, *OF_BEGINNING, *OF_ALL]
GOOD = {"step": 0.1, "steps": 4}


def told(wrong):
    """The name of a case."""
    return ",".join(f"{key}={value}" for key, value in wrong.items())


def options_of(**given):
    """The struct of the C interface with these options."""
    options = handles.new(abi.Options, "options")
    for name, value in {**GOOD, **given}.items():
        setattr(options, name, value)
    return options


def sentence_of(**given):
    """The message of the library about these options."""
    error = abi.Error()
    assert library.symsde_options_check(ctypes.byref(options_of(**given)), ctypes.byref(error)) < 0, given
    return error.message.decode()


def calls_in_c():
    """Every function of C that takes options: name -> a call with these options."""
    model, scheme = ss.models.kubo(), as_scheme("midpoint")
    room = np.ones(64)
    at = address(room)
    handle = model._handles.take()
    m, s = handle.pointer, scheme._handle.pointer
    start = handles.new(abi.Input, "input")
    start.q0 = start.p0 = at
    input_ = ctypes.byref(start)
    paths = handles.new(abi.Paths, "paths")
    for name in ("t", "q", "p", "status", "failed_step"):
        setattr(paths, name, at)
    moments = handles.new(abi.Moments, "moments")
    for name in ("t", "n_ok", "mean", "variance", "se_mean"):
        setattr(moments, name, at)
    observer = handles.new(abi.Observer, "observer")
    observer.kind = 1
    value = abi.PathFunction(lambda *_: 0)
    keep = model, handle, scheme, room, start, paths, moments, observer, value
    seen = ctypes.byref(observer)
    one = np.zeros(8, np.int64)
    run = ctypes.c_void_p()
    return keep, {
        "options_check": lambda o, e: (o, e),
        "saved_times": lambda o, e: (o, at, e),
        "simulate": lambda o, e: (m, s, o, input_, ctypes.byref(paths), None, e),
        "path_gradient": lambda o, e: (m, m, s, o, input_, 0, 1, at, value, None, *5 * [at], None, e),
        "path_tangent": lambda o, e: (m, m, s, o, input_, 0, 1, at, 1, 0, *6 * [at], None, e),
        "compute_moments": lambda o, e: (m, s, o, input_, ctypes.byref(moments), None, e),
        "run_new": lambda o, e: (m, s, o, input_, ctypes.byref(run), e),
        "increments": lambda o, e: (m, s, o, at, e),
        "observer_sizes": lambda o, e: (m, o, 0, seen, address(one), e),
        "observer_merge": lambda o, e: (m, o, 0, seen, seen, e),
        "observer_answer": lambda o, e: (m, o, 0, seen, at, at, e),
        "symplecticity": lambda o, e: (m, s, o, 1, at, at, at, at, e),
        "discrete_action": lambda o, e: (m, s, o, at, at, at, at, e),
        "euler_lagrange_residual": lambda o, e: (m, s, o, at, at, at, at, e),
        "stationary_path": lambda o, e: (m, s, o, at, at, at, None, None, at, at, address(one), e),
        "exact_solution": lambda o, e: (m, s, o, input_, at, at, e),
    }


def test_every_function_of_c_that_takes_options_is_called_here():
    """No function of C is left out: the types of arguments show which functions take options."""
    taking = {name for name, types in abi.FUNCTIONS.items() if ctypes.POINTER(abi.Options) in types}
    assert taking - {"options_init"} == set(calls_in_c()[1])


@pytest.mark.parametrize("wrong", [*WRONG, *ONLY_IN_C], ids=told)
def test_functions_of_c_refuse_with_one_sentence(wrong):
    """All functions of C refuse a wrong option with the same sentence. A prepared run takes its steps later, and checks
    options for a million steps."""
    _keep, calls = calls_in_c()
    sentence = sentence_of(**wrong)
    options = ctypes.byref(options_of(**wrong))
    for name, arguments in calls.items():
        error = abi.Error()
        code = getattr(library, f"symsde_{name}")(*arguments(options, ctypes.byref(error)))
        if name == "run_new" and wrong in OF_STEPS:
            assert code == 0
        elif name == "run_new":
            assert code < 0 and error.message.decode() == sentence_of(**{"steps": 10**6, **wrong})
        else:
            assert code < 0 and error.message.decode() == sentence, name


@pytest.mark.parametrize("wrong", WRONG, ids=told)
def test_functions_of_python_refuse_with_the_sentence_of_the_library(wrong):
    """Functions of Python refuse wrong options with the sentence of the library, before anything is allocated by a
    size in them.
    """
    model = ss.models.kubo()
    told_to = {**wrong, "areas": abi.AREAS[wrong["areas"]]} if "areas" in wrong else wrong
    given = {**GOOD, **told_to}
    sentence = sentence_of(**wrong)
    for call in (ss.simulate, ss.moments):
        with pytest.raises(ss.SymsdeError) as refused:
            call(model, **START, **given)
        assert str(refused.value) == sentence
    if wrong in OF_STEPS:
        prepared = ss.prepare(model, **START, step=0.1)
        run = ss.simulate(model, **START, **GOOD)
        steps, every = given["steps"], given.get("save_every", 1)
        for call in (prepared.run, lambda n, k: run.extend(n, save_every=k)):
            with pytest.raises(ss.SymsdeError) as refused:
                call(steps, every)
            assert str(refused.value).startswith(sentence[:20])
        assert prepared.next_step == 0 and prepared.run(4).t.shape == (5,)
        return
    with pytest.raises(ss.SymsdeError) as refused:
        ss.prepare(model, **START, **{"step": 0.1, **told_to})
    assert str(refused.value) == sentence_of(**{**wrong, "steps": 0})
    if wrong in OF_BEGINNING:
        prepared = ss.prepare(model, **START, step=0.1)
        with pytest.raises(ss.SymsdeError) as refused:
            prepared.reset(**wrong)
        assert str(refused.value) == sentence_of(**{**wrong, "steps": 0})
        assert prepared.next_step == 0
    if "save_every" not in wrong and not {"areas", "area_time"} & set(wrong) and "lanes" not in wrong:
        allowed = set(inspect.signature(ss.increments).parameters) & set(given)
        if set(wrong) <= allowed:
            with pytest.raises(ss.SymsdeError) as refused:
                ss.increments(model, **{key: given[key] for key in allowed})
            assert str(refused.value) == sentence


def stated():
    """The defaults of all options: those of the library, and the defaults of options for which the library has none."""
    return {**run_options.DEFAULTS, "scheme": "midpoint", "threads": None, "lanes": None}


def test_the_library_has_the_defaults():
    """The library has these defaults, which Python reads from it: a change of src/ensemble/options.f90 must be made
    here, too.
    """
    options = handles.new(abi.Options, "options")
    assert (options.step, options.steps) == (0, 0)  # are required
    assert (options.paths, options.save_every, options.seed) == (1, 1, 0)
    for name, value in run_options.DEFAULTS.items():
        if type(value) in (int, float, bool):
            assert getattr(options, name) == value and type(value) is not str
    assert set(stated()) == set(inspect.signature(ss.simulate).parameters) - {
        *("model", "q0", "p0", "step", "steps", "increments", "progress", "q0_low", "p0_low", "save_at")
    }


#: functions in which an argument of this name has another meaning or another default, such as none or the default of a
#: study
OF_THEIR_OWN = {
    *(("expect", "scheme"), ("mlmc", "scheme"), ("cite", "scheme")),
    ("matched", "scheme"),  # without it: of the flow
    *((law, "seed") for law in ("normal", "uniform", "matched", "canonical", "formula", "table")),  # the run's seed
    *(("convergence", "paths"), ("work_precision", "paths"), ("frequency", "paths"), ("merged_report", "threads")),
}


def functions():
    """Functions of the package, by name."""
    for found in pkgutil.walk_packages(ss.__path__, "symsde."):
        if found.name == "symsde.__main__":
            continue
        module = importlib.import_module(found.name)
        for name, function in inspect.getmembers(module, inspect.isfunction):
            if function.__module__ == found.name:
                yield f"{found.name}.{name}", function


def test_functions_state_the_defaults_of_the_library():
    """Every argument that is an option of a run by its name, and has a default, has the default of the library."""
    seen = 0
    for name, function in functions():
        for key, parameter in inspect.signature(function).parameters.items():
            default = parameter.default
            if key in stated() and default is not parameter.empty and (function.__name__, key) not in OF_THEIR_OWN:
                seen += 1
                assert (default, type(default)) == (stated()[key], type(stated()[key])), f"{name}: {key}"
    assert seen > len(stated())


def literals_of_get():
    """x.get("option", literal) in the package: file, option, literal."""
    for file in HERE.rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text())):
            if (
                isinstance(node, ast.Call)
                and isinstance(node.func, ast.Attribute)
                and node.func.attr == "get"
                and len(node.args) == 2
                and all(isinstance(part, ast.Constant) for part in node.args)
            ):
                yield file.name, node.args[0].value, node.args[1].value


def test_options_that_are_looked_up_have_these_defaults():
    """Scenes and plans use these defaults for options that are missing."""
    found = [(file, key, value) for file, key, value in literals_of_get() if key in stated()]
    assert len(found) > 5
    for file, key, value in found:
        assert value == stated()[key], f"{file}: {key}"


def test_the_page_of_scenes_states_the_defaults():
    """`key` (default) of the table of [run]."""
    page = Path(__file__).parents[2] / "docs" / "scenes.md"
    table = page.read_text().split("## `[run]`")[1].split("\n## ")[0]
    words = {"none": None, "derived": None, "false": False, "[]": ()}
    found = dict(re.findall(r"`(\w+)` \(([^)]+)\)", table))
    assert len(found) >= 12
    for key, text in found.items():
        value = words[text] if text in words else ast.literal_eval(text)
        assert value == stated()[key], key
