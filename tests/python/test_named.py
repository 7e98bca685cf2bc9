# SPDX-License-Identifier: BSD-3-Clause
"""Python functions that scenes name as observables: by value in runs, shards, resumes; refusals."""

import os
import pickle
import subprocess
import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np
import pytest
import symsde as ss
from conftest import moments_of, table_of
from symsde.batch import scene
from symsde.cli import command_line
from symsde.errors import InvalidArgumentError, SceneError

OWN = """
import numpy as np
def radius(q, p):
    return np.sqrt(q[0]**2 + p[0]**2)
def far(q, p):
    return (np.abs(q[0]) > 0.9) * 1.0
def late(q, p):
    if (np.abs(q[0]) > 1.05).any():
        raise RuntimeError("too far")
    return q[0]
def total(q, p):
    return np.sum(q**2)
def about(q, p):
    return q[0] - q[0].mean()
def wide(q, p):
    return q**2
def text(q, p):
    return ["x"] * q.shape[1]
def chance(q, p):
    return np.random.default_rng().random(q.shape[1])
number = 3
"""
SCENE = """
[model]
name = "kubo"
[run]
step = 0.05
steps = 100
save_every = 20
paths = 700
seed = 5
q0 = 1.0
p0 = 0.1
[observables]
r = {python = "MODULE:radius"}
square = "q1**2"
far = {python = "MODULE:far"}
[[observe]]
kind = "histogram"
of = "r"
low = 0.9
high = 1.1
bins = 20
"""
RUN = {"q0": 1.0, "p0": 0.1, "step": 0.05, "steps": 100, "save_every": 20, "paths": 700, "seed": 5}


@pytest.fixture
def module(request):
    """A name that no other test uses, since modules stay loaded in a process."""
    return "own_" + "".join(x if x.isalnum() else "_" for x in request.node.name)


@pytest.fixture
def file(tmp_path, module):
    (tmp_path / f"{module}.py").write_text(OWN)
    path = tmp_path / "scene.toml"
    path.write_text(SCENE.replace("MODULE", module))
    return path


@pytest.fixture
def allowed():
    token = scene.PYTHON_ALLOWED.set(True)
    yield
    scene.PYTHON_ALLOWED.reset(token)


def run(*arguments):
    return command_line.main(["run", *map(str, arguments), "--allow-python", "--quiet"])


def test_values_in_runs_and_shards(file, module, tmp_path, allowed):
    """Values equal those from the paths, for any division into shards, also with formulas beside them; they keep
    their order, and the table records them.
    """
    for size in (256, 1024):
        assert run(file, "--out", tmp_path / str(size), "--shard-paths", size) == command_line.OK
    found = ss.open_run(tmp_path / "256").moments
    paths = ss.simulate(ss.models.kubo(), **RUN)
    radius = np.sqrt(paths.q[:, 0] ** 2 + paths.p[:, 0] ** 2)
    np.testing.assert_allclose(found.mean["r"], radius.mean(axis=1), rtol=1e-13)
    np.testing.assert_allclose(found.mean["far"], (np.abs(paths.q[:, 0]) > 0.9).mean(axis=1), rtol=1e-13)
    np.testing.assert_allclose(found.mean["square"], (paths.q[:, 0] ** 2).mean(axis=1), rtol=1e-13)
    assert found.columns() == ["q_1", "p_1", "energy", "r", "square", "far"]
    counts = [np.histogram(row, np.linspace(0.9, 1.1, 21))[0] for row in radius]
    np.testing.assert_array_equal(found.observed["histogram"].counts, counts)
    assert table_of(tmp_path / "256" / "moments.csv") == table_of(tmp_path / "1024" / "moments.csv")
    told = f'"r": "Python: {module}.radius", "square": "q1**2", "far": "Python: {module}.far"'
    assert told in (tmp_path / "256" / "moments.csv").read_text()


def test_resumed_merged_and_compared(file, module, tmp_path, capsys):
    """The file is copied into the folder, where another process continues and merges, and is an input of the run."""
    whole, part = tmp_path / "whole", tmp_path / "part"
    assert run(file, "--out", whole, "--shard-paths", 256) == command_line.OK
    assert run(file, "--out", part, "--shard-paths", 256, "--shard", "1/2") == command_line.OK
    assert (part / f"{module}.py").read_text() == OWN
    given = [sys.executable, "-m", "symsde", "run", str(part / "scene.toml"), "--out", str(part), "--quiet"]
    ended = subprocess.run([*given, "--allow-python"], capture_output=True, text=True, check=False, cwd="/")
    assert ended.returncode == 0, ended.stderr
    assert table_of(part / "moments.csv") == table_of(whole / "moments.csv")
    merged = ["merge", str(part), "--out", str(tmp_path / "merged"), "--quiet"]
    assert command_line.main(merged) == command_line.BAD_INPUT
    assert "say --allow-python" in capsys.readouterr().err
    assert command_line.main([*merged, "--allow-python"]) == command_line.OK
    assert table_of(tmp_path / "merged" / "moments.csv") == table_of(whole / "moments.csv")
    assert run(file, "--out", whole, "--error-check") == command_line.OK
    assert "mean r" in table_of(whole / "error-check.csv")[0]
    (tmp_path / f"{module}.py").write_text(OWN + "# otherwise\n")
    ended = subprocess.run(
        [*given[:4], str(file), "--out", str(whole), "--allow-python"], capture_output=True, text=True, check=False
    )
    assert ended.returncode == command_line.BAD_INPUT and f"python_sha256.{module}.py = " in ended.stderr


def test_only_where_allowed(file, module, tmp_path, capsys):
    (tmp_path / f"{module}.py").write_text(f"open({str(tmp_path / 'ran')!r}, 'w').close()\n" + OWN)
    for verb in (["run"], ["check"], ["run", "--dry-run"], ["expect"], ["study"]):
        assert command_line.main([*verb, str(file)]) == command_line.BAD_INPUT, verb
        sentence = f"[observables] r: python = '{module}:radius' would execute code: say --allow-python"
        assert sentence in capsys.readouterr().err
    with pytest.raises(SceneError, match=r"in Python symsde.batch.scene.PYTHON_ALLOWED.set\(True\)"):
        scene.load(file)
    assert not (tmp_path / "ran").exists()


BAD = {
    "nothere": "is no function (MODULE has no function of this name): write module:function",
    "number": "is no function (this is 3): write module:function",
    "total": "observable 'r' is one number for all paths: return one for each",
    "wide": "observable 'r' has shape (1, 8): return shape (8,)",
    "about": "observable 'r' mixes paths: it is",
    "chance": "observable 'r' mixes paths: it is",
    "text": "observable 'r' holds <U1 values: return an array of real numbers",
}


@pytest.mark.parametrize(("name", "sentence"), BAD.items())
def test_functions_that_do_not_fit(name, sentence, file, module, capsys):
    file.write_text(SCENE.replace("MODULE:radius", f"MODULE:{name}").replace("MODULE", module))
    assert command_line.main(["check", str(file), "--allow-python"]) == command_line.BAD_INPUT
    told = capsys.readouterr().err
    assert "[observables]" in told and sentence.replace("MODULE", module) in told


@pytest.mark.parametrize(
    "text", ["", "x", ":", "own:", ":f", "a b:f", "../own:f", "own:f:g", "own.:f", 3, ["own:f"], True]
)
def test_what_names_no_function(text, file, module, allowed):
    file.write_text(SCENE.replace('"MODULE:radius"', str(text).lower() if text is True else repr(text)))
    with pytest.raises(SceneError, match=r"\[observables\] r: python = .*: write module:function"):
        scene.load(file)


def test_files_that_cannot_be_loaded(file, module, tmp_path, capsys):
    for number, (content, sentence) in enumerate(
        (
            ("import nowhere\n", "cannot be loaded: ModuleNotFoundError: No module named 'nowhere'"),
            ("def radius(q, p:\n", "cannot be loaded: SyntaxError: "),
            ("x = 1\n1/0\n", "cannot be loaded: ZeroDivisionError: division by zero (NAME.py, line 2)"),
            ("raise SystemExit(0)\n", "cannot be loaded: SystemExit: 0"),
        )
    ):
        name = f"{module}_{number}"
        (tmp_path / f"{name}.py").write_text(content)
        file.write_text(SCENE.replace("MODULE", name))
        assert command_line.main(["check", str(file), "--allow-python"]) == command_line.BAD_INPUT
        assert sentence.replace("NAME", name) in capsys.readouterr().err
    (tmp_path / "json.py").write_text(OWN)
    file.write_text(SCENE.replace("MODULE", "json"))
    assert command_line.main(["check", str(file), "--allow-python"]) == command_line.BAD_INPUT
    assert f"{tmp_path / 'json.py'} differs from the json that is here already" in capsys.readouterr().err


def test_a_function_that_fails_on_the_way(file, module, tmp_path, capsys):
    """A function that fails gives a message with its line, and no shard of the failed part."""
    file.write_text(
        SCENE.replace("MODULE:radius", "MODULE:late").replace("MODULE", module).replace("= 0.1\n", "= 0.6\n")
    )
    assert run(file, "--out", tmp_path / "out") == command_line.BAD_INPUT
    told = capsys.readouterr().err
    assert f"python = '{module}:late' failed: RuntimeError: too far ({module}.py, line 9)" in told
    assert "Traceback" not in told and not list((tmp_path / "out" / "shards").glob("*.npz"))


def test_other_processes_load_it_again(file, module, tmp_path, allowed):
    chosen = scene.load(file)
    same = pickle.loads(pickle.dumps(chosen.observables["r"]))
    np.testing.assert_array_equal(same(np.full((1, 2), 3.0), np.full((1, 2), 4.0)), [5.0, 5.0])
    wanted = {"observables": chosen.observables, "observers": chosen.observers}
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as executor:
        found = ss.ensemble(chosen.model, **wanted, **chosen.run, executor=executor, shard_paths=256)
    np.testing.assert_array_equal(found.m2, moments_of(chosen).m2)
    assert os.path.basename(chosen.file) == "scene.toml"
    with pytest.raises(InvalidArgumentError, match="say --allow-python"):
        from symsde.batch import named_functions

        token = scene.PYTHON_ALLOWED.set(False)
        try:
            named_functions.function_of(tmp_path, f"{module}:radius")
        finally:
            scene.PYTHON_ALLOWED.reset(token)
