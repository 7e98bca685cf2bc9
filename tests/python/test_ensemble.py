# SPDX-License-Identifier: BSD-3-Clause
"""Ensembles on executors and on ranks of MPI: the bits of one run, and the estimated cost of a run."""

import csv
import importlib.util
import os
import re
import shutil
import subprocess
import sys
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pytest
import symsde as ss
from conftest import rotation_gradient, rotation_value, table_of
from symsde.cli import command_line
from symsde.errors import InvalidArgumentError, SymsdeError

RUN = {"q0": [0.45, 0.4], "p0": [0.1, 0.0], "step": 0.05, "steps": 120, "save_every": 40, "seed": 9}
RUN |= {"paths": 3000, "first_path": 768, "scheme": "stormer_verlet"}


def radius(q, p):
    """An observable that other processes import by its name."""
    return q[0] ** 2 + p[0] ** 2


OBSERVABLES = {"radius": radius}
ALLOWED = {"OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1", "SYMSDE_NUM_THREADS": "1"}


@pytest.fixture(scope="module")
def known():
    with pytest.warns(ss.PathsFailedWarning, match="paths failed"):
        return ss.moments(ss.models.henon_heiles(sigma1=0.2), observables=OBSERVABLES, **RUN)


def check_same(found, known):
    for name in ("t", "n_ok", "m2", "failed", "failed_status", "failed_step", "var_q", "se_mean_p", "mean_energy"):
        np.testing.assert_array_equal(getattr(found, name), getattr(known, name), err_msg=name)
    np.testing.assert_array_equal(found.mean["radius"], known.mean["radius"])
    np.testing.assert_array_equal(found.to_arrays()[0], known.to_arrays()[0])
    assert found.columns() == known.columns() and found.setup.attributes() == known.setup.attributes()
    for name in ("failed", "stopped", "stepper", "outcome"):
        assert getattr(found.report, name) == getattr(known.report, name), name
    assert found.report.counters["path_steps"] == known.report.counters["path_steps"]


@pytest.mark.parametrize("size", [256, 1024, None])
@pytest.mark.parametrize("kind", ["here", "threads", "processes"])
def test_any_executor_gives_the_bits_of_one_run(kind, size, known):
    model = ss.models.henon_heiles(sigma1=0.2)
    make = {
        "here": lambda: None,
        "threads": lambda: ThreadPoolExecutor(3),
        "processes": lambda: ProcessPoolExecutor(2, mp_context=get_context("spawn")),
    }[kind]
    executor = make()
    with pytest.warns(ss.PathsFailedWarning, match="paths failed") as warned:
        found = ss.ensemble(model, observables=OBSERVABLES, executor=executor, shard_paths=size, **RUN)
    assert len([w for w in warned if w.category is ss.PathsFailedWarning]) == 1
    check_same(found, known)
    if executor:
        assert executor.submit(abs, -1).result() == 1  # the caller's executor was not shut down
        executor.shutdown()


FORMULAS = {"radius": "q1**2 + p1**2"}  # formulas need no import in other processes


@pytest.fixture(scope="module")
def by_formula():
    with pytest.warns(ss.PathsFailedWarning, match="paths failed"):
        return ss.moments(ss.models.henon_heiles(sigma1=0.2), observables=FORMULAS, **RUN)


@pytest.mark.filterwarnings("ignore")  # warnings of Dask
def test_dask_gives_the_bits_of_one_run(by_formula):
    """Two processes of a local cluster, through the client's executor."""
    if importlib.util.find_spec("distributed") is None:
        pytest.skip("Dask is not installed: pip install 'dask[distributed]'")
    distributed = importlib.import_module("distributed")
    options = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": None, "processes": True}
    with distributed.LocalCluster(**options) as cluster, distributed.Client(cluster) as client:
        executor = client.get_executor()
        model = ss.models.henon_heiles(sigma1=0.2)
        found = ss.ensemble(model, observables=FORMULAS, executor=executor, shard_paths=512, **RUN)
    check_same(found, by_formula)


ON_RANKS = """
import sys, warnings
import numpy as np
import symsde as ss
from mpi4py.futures import MPIPoolExecutor
warnings.simplefilter("ignore")
if __name__ == "__main__":
    run = eval(sys.argv[1])
    with MPIPoolExecutor() as executor:
        found = ss.ensemble(ss.models.henon_heiles(sigma1=0.2), executor=executor, shard_paths=512, **run)
        assert executor.num_workers == 2
    np.savez(sys.argv[2], m2=found.m2, mean=found.to_arrays()[0], n_ok=found.n_ok)
"""


def test_mpi4py_futures_give_the_bits_of_one_run(by_formula, tmp_path):
    """Rank 0 collects the shards, which two other ranks compute."""
    if importlib.util.find_spec("mpi4py") is None or launcher() is None:
        pytest.skip("mpi4py and mpirun are not installed: pip install mpi4py mpich")
    (tmp_path / "on_ranks.py").write_text(ON_RANKS)
    given = [launcher(), "-n", "3", sys.executable, "-m", "mpi4py.futures", str(tmp_path / "on_ranks.py")]
    given += [repr({**RUN, "observables": FORMULAS}), str(tmp_path / "found.npz")]
    done = subprocess.run(given, env={**os.environ, **ALLOWED}, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    with np.load(tmp_path / "found.npz") as found:
        np.testing.assert_array_equal(found["m2"], by_formula.m2)
        np.testing.assert_array_equal(found["mean"], by_formula.to_arrays()[0])
        np.testing.assert_array_equal(found["n_ok"], by_formula.n_ok)


def test_columns_of_initial_states_and_models_in_python():
    q0 = np.linspace(-1, 1, 700)[None, :]
    model = ss.Model(ndof=1, nnoise=1, gradient=rotation_gradient, value=rotation_value, separable=True, quadratic=True)
    run = {"q0": q0, "p0": 0.2, "step": 0.1, "steps": 10, "paths": 700, "seed": 2}
    known = ss.moments(model, **run)
    found = ss.ensemble(model, shard_paths=256, **run)
    np.testing.assert_array_equal(found.to_arrays()[0], known.to_arrays()[0])
    np.testing.assert_array_equal(found.m2, known.m2)


def test_prescribed_increments_of_each_path():
    dw = np.random.default_rng(1).normal(size=(10, 1, 600)) * 0.3
    run = {"q0": 1.0, "p0": 0.2, "step": 0.1, "steps": 10, "paths": 600, "increments": dw}
    found, known = (f(ss.models.kubo(), **run) for f in (ss.ensemble, ss.moments))
    np.testing.assert_array_equal(found.m2, known.m2)
    np.testing.assert_array_equal(ss.ensemble(ss.models.kubo(), shard_paths=256, **run).m2, known.m2)


def test_progress_is_told_and_may_stop():
    told = []

    def progress(done, total):
        told.append((done, total))
        return done > total / 10

    run = {"q0": 1.0, "p0": 0.0, "step": 0.01, "steps": 1000, "paths": 2**20, "threads": 1, "shard_paths": 1024}
    found = ss.ensemble(ss.models.kubo(), progress=progress, **run)
    assert told[0][1] == 1000 * 2**20 and told[-1][0] > told[0][0]
    assert found.report.outcome == "stopped on request" and found.report.stopped == 2**20 - found.n_ok[-1] > 0
    assert found.n_ok[-1] % 1024 == 0 and found.n_ok[-1] > 0
    with pytest.raises(SymsdeError, match="stopped before any"):
        ss.ensemble(ss.models.kubo(), progress=lambda *_: True, **{**run, "shard_paths": 2**20, "steps": 10**7})


def test_errors_of_a_piece_are_raised():
    def bad(q, p):
        raise RuntimeError("planted")

    with pytest.raises(RuntimeError, match="planted"):
        ss.ensemble(ss.models.kubo(), observables={"bad": bad}, q0=1.0, p0=0.0, step=0.1, steps=5, paths=1000)
    with pytest.raises(InvalidArgumentError, match="not a power of two"):
        ss.ensemble(ss.models.kubo(), q0=1.0, p0=0.0, step=0.1, steps=5, shard_paths=300)


SCENE = """
[model]
name = "synchrotron"
[run]
step = 0.02
steps = 400
paths = 3000
seed = 4
q0 = 0.0
p0 = 0.1
save_every = 100
[output]
paths = [3, 4, 2000]
"""


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text(SCENE)
    return path


def launcher():
    """The mpirun of the Python environment, or else the system's."""
    beside = Path(sys.executable).with_name("mpirun")
    return str(beside) if beside.exists() else shutil.which("mpirun")


@pytest.mark.parametrize("ranks", [1, 2, 3])
def test_ranks_give_the_bits_of_one_process(ranks, file, tmp_path):
    if importlib.util.find_spec("mpi4py") is None or launcher() is None:
        pytest.skip("mpi4py and mpirun are not installed: pip install mpi4py mpich")
    given = ["run", str(file), "--shard-paths", "256", "--out"]
    assert command_line.main([*given, str(tmp_path / "alone"), "--quiet"]) == 0
    command = [launcher(), "-n", str(ranks), sys.executable, "-m", "symsde", *given, str(tmp_path / "out")]
    done = subprocess.run(command, env={**os.environ, **ALLOWED}, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("written to") == 1  # rank 0 alone
    names = sorted(path.name for path in (tmp_path / "alone" / "shards").iterdir())
    assert names == sorted(path.name for path in (tmp_path / "out" / "shards").iterdir()) and len(names) == 14
    for name in (f"shards/{name}" for name in names):
        assert (tmp_path / "alone" / name).read_bytes() == (tmp_path / "out" / name).read_bytes(), name
    assert table_of(tmp_path / "alone" / "moments.csv") == table_of(tmp_path / "out" / "moments.csv")


def test_what_a_run_takes(file, tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("SYMSDE_NUM_THREADS", "1")
    assert command_line.main(["run", str(file), "--out", str(tmp_path / "out"), "--dry-run"]) == 0
    shown = dict(line.split(None, 1) for line in capsys.readouterr().out.splitlines())
    assert not (tmp_path / "out").exists()
    assert float(shown["path-steps"]) == pytest.approx(3003 * 400, rel=1e-3)
    assert re.match(r"3, of 4096 paths at most", shown["shards"]), shown
    assert command_line.main(["run", str(file), "--out", str(tmp_path / "out"), "--quiet"]) == 0
    disk = sum(path.stat().st_size for path in (tmp_path / "out").rglob("*") if path.is_file())
    text, unit = shown["disk"].partition(",")[0].split()[1:3]
    assert 0.2 * disk < float(text) * {"bytes": 1, "kB": 1e3}[unit] < 2 * disk
    assert 0 < float(shown["time"].split()[1]) < 60


def test_half_the_step_on_the_same_paths(file, tmp_path, capsys):
    """Midpoint has strong order 1 here: half the step halves the distance; on unrelated paths the distance would not
    change.
    """
    distances = []
    for step, steps, every in ((0.04, 200, 50), (0.02, 400, 100)):
        text = SCENE.replace("step = 0.02\nsteps = 400", f"step = {step}\nsteps = {steps}")
        file.write_text(text.replace("save_every = 100", f"save_every = {every}"))
        out = tmp_path / str(step)
        capsys.readouterr()
        assert command_line.main(["run", str(file), "--out", str(out), "--error-check"]) == 0
        shown = capsys.readouterr().out
        assert "half the step on the same paths (3000 of them" in shown and "mean q_1^2" in shown
        names, *rows = csv.reader(table_of(out / "error-check.csv"))
        rows = dict(zip(names, np.array(rows, dtype=float).T, strict=True))
        assert rows["t"].tolist() == [0, 2, 4, 6, 8] and (rows["paths"] == 3000).all() and rows["rms"][0] == 0
        distances.append(rows["rms"][-1])
        assert abs(rows["mean p_1"][-1]) < 6 * rows["se_mean p_1"][-1] + 0.1 * step
    assert 1.7 < distances[0] / distances[1] < 2.4


def test_differences_are_those_of_the_paths():
    """The differences are also computed by hand, with a path that fails in one of the two runs."""
    from symsde.batch.error_check import compare

    run = {"q0": np.array([[0.3, 0.5, 0.2]]), "p0": 0.0, "steps": 4, "paths": 3, "save_every": 2, "seed": 3}
    full = ss.simulate(ss.models.pendulum(), step=0.2, **run)
    half = ss.simulate(ss.models.pendulum(), step=0.1, refine=-1, **{**run, "steps": 8, "save_every": 4})
    half.q[2, 0, 1] = np.nan
    found = compare(full, half, (1.0, 2.0))
    assert found.names == ("q_1", "p_1", "energy", "q_1^2", "p_1^2") and found.n.tolist() == [3, 3, 2]
    dq, dp = (full.q - half.q)[2, 0, [0, 2]], (full.p - half.p)[2, 0, [0, 2]]
    np.testing.assert_allclose(found.rms[2], np.sqrt(np.mean(dq**2 + dp**2)), rtol=1e-14)
    np.testing.assert_allclose(found.mean[2, :2], [dq.mean(), dp.mean()], rtol=1e-13)
    np.testing.assert_allclose(found.se_mean[2, 0], np.std(dq, ddof=1) / np.sqrt(2), rtol=1e-13)
    energy = full.model.value(full.q[1], full.p[1]) - full.model.value(half.q[1], half.p[1])
    np.testing.assert_allclose(found.mean[1, 2], energy.mean(), rtol=1e-12)
    lines = str(found).splitlines()
    assert lines[0] == "half the step on the same paths (3 of them, 1 s and 2 s):"
    assert lines[1].endswith(f"rms: {found.rms[2]:.3g} at t = 0.8, at most {found.rms.max():.3g}")
    error = np.std(dp, ddof=1) / np.sqrt(2)
    assert lines[3].split() == ["mean", "p_1", "differs", "by", f"{dp.mean():.3g}", "+-", f"{error:.2g}"]


def test_observables_are_compared_too(tmp_path, capsys):
    """Differences of observables are computed by hand from the paths of both runs; the screen and the table name the
    observables that are not compared.
    """
    file = tmp_path / "scene.toml"
    run = "step = 0.1\nsteps = 20\nsave_every = 10\npaths = 50\nseed = 3\nq0 = 0.3\np0 = 0.0\n"
    file.write_text(
        f'[model]\nname = "kubo"\n[run]\n{run}[observables]\n"q_1^2" = "q**2*p + t"\nlog = "log(q - 0.3*cos(t))"\n'
        '[[observe]]\nkind = "passage"\nname = "loss"\nof = "q_1"\nwithin = 5.0\n'
        '[[observe]]\nkind = "extremes"\nof = "p_1"\n'
    )
    assert (
        command_line.main(["run", str(file), "--out", str(tmp_path / "out"), "--error-check"])
        == command_line.PATHS_FAILED
    )
    shown = capsys.readouterr().out
    names, *rows = csv.reader(table_of(tmp_path / "out" / "error-check.csv"))
    kinds = ["q_1", "p_1", "energy", "observable q_1^2", "log", "q_1^2", "p_1^2"]
    assert names == ["t", "paths", "rms", *(f"{x} {name}" for x in ("mean", "se_mean") for name in kinds)]
    rows = dict(zip(names, np.array(rows, dtype=float).T, strict=True))
    given = {"q0": 0.3, "p0": 0.0, "paths": 50, "seed": 3}
    full = ss.simulate(ss.models.kubo(), step=0.1, steps=20, save_every=10, **given)
    half = ss.simulate(ss.models.kubo(), step=0.05, steps=40, save_every=20, refine=-1, **given)
    difference = (full.q**2 * full.p - half.q**2 * half.p)[:, 0]
    np.testing.assert_allclose(rows["mean observable q_1^2"], difference.mean(axis=1), rtol=1e-9, atol=1e-17)
    errors = difference.std(axis=1, ddof=1) / np.sqrt(50)
    np.testing.assert_allclose(rows["se_mean observable q_1^2"], errors, rtol=1e-9, atol=1e-17)
    assert np.isnan(rows["mean log"][1:]).all() and (rows["paths"] == 50).all()
    assert np.isfinite(rows["mean energy"]).all() and "mean observable q_1^2 differs by" in shown
    told = (
        "not compared: what [[observe]] keeps (loss, extremes)",
        "paths that loss would absorb go on here: the means are those without absorption",
    )
    text = (tmp_path / "out" / "error-check.csv").read_text()
    for sentence in told:
        assert f"  {sentence}\n" in shown and f"#   {sentence}\n" in text
