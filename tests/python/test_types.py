# SPDX-License-Identifier: BSD-3-Clause
"""Type checkers and editors: results have types, and a misspelt option is an error before a run."""

import importlib.util
import inspect
import os
import re
import shutil
import subprocess
import sys
import typing
from pathlib import Path

import pytest
import symsde as ss
from symsde.answers import error_plan
from symsde.answers.expectation import problem
from symsde.run import options as run_options

PACKAGES = Path(ss.__file__).parents[1]
RIGHT = """
from typing import assert_type
import symsde as ss
model = ss.models.kubo(sigma=0.2)
place = ss.model_from_sympy("p**2/2 + k*q**2/2", "s*q", params={"k": 1.0, "s": 0.1})
run = ss.simulate(model, q0=1.0, p0=0.0, step=0.1, steps=3, threads=None, common_noise=[1])
assert_type(run, ss.Run)
assert_type(run.extend(3), ss.Run)
assert_type(run.report.failed, int)
assert_type(ss.moments(place, q0=1.0, p0=0.0, step=0.1, steps=3, paths=10, scheme="gauss2"), ss.Moments)
assert_type(ss.ensemble(model, q0=1.0, p0=0.0, step=0.1, steps=3, paths=10, save_every=3), ss.Moments)
assert_type(ss.prepare(model, "gauss2", q0=1.0, p0=0.0, step=0.1, seed=3), ss.PreparedRun)
assert_type(ss.expect(model, "q", q0=1.0, p0=0.0, horizon=1.0, abs=0.1, t0=0.5), ss.Answer)
assert_type(ss.mlmc(model, "q", q0=1.0, p0=0.0, horizon=1.0, abs=0.1), ss.Multilevel)
assert_type(ss.advise(model, q0=1.0, p0=0.0, horizon=1.0, tolerance=0.1), ss.Advice)
assert_type(ss.convergence(model, q0=1.0, p0=0.0, seed=2), ss.Convergence)
assert_type(ss.work_precision(model, q0=1.0, p0=0.0, seed=2), ss.WorkPrecision)
assert_type(place, ss.FormulaModel)
"""
WRONG = """
import symsde as ss
model = ss.models.kubo()
ss.simulate(model, q0=1.0, p0=0.0, stepp=0.1, steps=3)
ss.simulate(model, q0=1.0, p0=0.0, step="0.1", steps=3)
ss.simulate(model, q0=1.0, p0=0.0, step=0.1, steps=3, pahts=2)
ss.moments(model, q0=1.0, p0=0.0, step=0.1, steps=3, pahts=2)
ss.ensemble(model, q0=1.0, p0=0.0, step=0.1, steps=3, pahts=2)
ss.prepare(model, q0=1.0, p0=0.0, step=0.1, steps=2)
ss.step(model, "midpoint", 1.0, 0.0, 0.1, corection="none")
ss.expect(model, "q", q0=1.0, p0=0.0, horizon=1.0, abs=0.1, thread=2)
ss.mlmc(model, "q", q0=1.0, p0=0.0, horizon=1.0, abs=0.1, paths=2)
ss.advise(model, q0=1.0, p0=0.0, horizon=1.0, tolerance=0.1, scheme="gauss2")
ss.convergence(model, q0=1.0, p0=0.0, areas="law")
ss.work_precision(model, q0=1.0, p0=0.0, step=0.1)
ss.model_from_sympy("p**2/2", parms={})
ss.Model(ndof=1, nnoise=0, gradient=abs, hesian=abs)
ss.models.kubo(sgma=0.1)
ss.simulate(model, q0=1.0, p0=0.0, step=0.1, steps=3).plot(kind="phase")
""".strip("\n")
FIRST = 3  # the line of the first mistake


def mypy(folder):
    """The command, if installed."""
    if importlib.util.find_spec("mypy"):
        return [sys.executable, "-m", "mypy", "--cache-dir", str(folder / "cache"), "--no-color-output"]
    return None


def pyright(_folder):
    """The command pyright, if it is installed; its wheel downloads Node.js in its first call, which no test makes."""
    return [found, "--pythonpath", sys.executable] if (found := shutil.which("pyright")) else None


@pytest.mark.parametrize("checker", [mypy, pyright])
def test_checkers_see_results_and_refuse_mistakes(checker, tmp_path):
    if (command := checker(tmp_path)) is None:
        pytest.skip(f"{checker.__name__} is not installed")
    (tmp_path / "right.py").write_text(RIGHT)
    (tmp_path / "wrong.py").write_text(WRONG)
    paths = {"PYTHONPATH": str(PACKAGES), "MYPYPATH": ""}
    (tmp_path / "pyrightconfig.json").write_text(f'{{"extraPaths": ["{PACKAGES}"]}}')
    ended = subprocess.run(
        [*command, "right.py", "wrong.py"], cwd=tmp_path, env={**os.environ, **paths}, capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    said = ended.stdout + ended.stderr
    found = {(m[1], int(m[2])) for m in re.finditer(r"(right|wrong)\.py:(\d+)(?::\d+)?(?: -|:) error", said)}
    assert found == {("wrong", FIRST + i) for i in range(len(WRONG.splitlines()) - FIRST + 1)}, said


def test_what_types_say_of_options_is_what_there_is():
    """The options that a function accepts are those in its type annotations."""
    known = {*run_options.OPTIONS, "increments", "q0_low", "p0_low", "scheme", "save_at"} - {"step", "steps"}
    assert set(run_options.RunOptions.__annotations__) == known
    assert set(run_options.PathOptions.__annotations__) == known - {"scheme", "save_every", "save_at", "increments"}
    types, parameters = (
        typing.get_type_hints(run_options.RunOptions),
        inspect.signature(ss.simulate, eval_str=True).parameters,
    )
    for name in known:
        assert types[name] == parameters[name].annotation, name
    assert set(problem.OPTIONS) | set(error_plan.OPTIONS) <= known


def test_what_is_seen_of_the_package_is_what_users_call():
    assert dir(ss) == sorted(ss.__all__)
    assert not {"importlib", "warnings", "cli", "native", "run"} & set(dir(ss))
    assert all(hasattr(ss, name) for name in dir(ss))
