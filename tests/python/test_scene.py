# SPDX-License-Identifier: BSD-3-Clause
"""Scenes and the command line."""

import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
import symsde as ss
from symsde import cli, scene
from symsde.errors import SceneError

SCENE = """
[model]
name = "synchrotron"
omega = 2.0
sigma1 = 0.2
sigma2 = 0.1
[run]
scheme = "midpoint"
step = 0.02
steps = 500
paths = 1000
seed = 1
q0 = 0.0
p0 = 0.0
save_every = 50
[output]
moments = true
paths = [0, 1, 7]
"""


@pytest.fixture
def file(tmp_path):
    """Write a scene with parts replaced."""

    def write(*replacements, text=SCENE):
        for old, new in replacements:
            assert old in text
            text = text.replace(old, new)
        path = tmp_path / "scene.toml"
        path.write_text(text)
        return path

    return write


def test_scene_is_the_run_it_says(file):
    loaded = scene.load(file())
    moments, run = loaded.compute_moments(), loaded.compute_paths()
    common = {"q0": 0.0, "p0": 0.0, "step": 0.02, "steps": 500, "seed": 1, "save_every": 50}
    model = ss.models.synchrotron()
    np.testing.assert_array_equal(moments.mean_q, ss.moments(model, paths=1000, **common).mean_q)
    whole = ss.simulate(model, paths=1000, **common)
    np.testing.assert_array_equal(run.path, [0, 1, 7])
    np.testing.assert_array_equal(run.q, whole.q[:, :, [0, 1, 7]])


def test_paths_with_states_of_their_own(file):
    loaded = scene.load(file(("paths = 1000", "paths = 3\nfirst_path = 256"), ("q0 = 0.0", "q0 = [[0.1, 0.2, 0.3]]"),
                             ("[0, 1, 7]", "[256, 258]")))  # fmt: skip
    np.testing.assert_array_equal(loaded.compute_paths().q[0, 0], [0.1, 0.3])


@pytest.mark.parametrize("name", ss.models.names())
def test_templates_are_scenes(name, file):
    text = scene.template(name)
    loaded = scene.load(file(text=text))
    assert loaded.model.name == name and loaded.run["steps"] == 5000
    assert all("#" not in line or line.index("#") == 0 or "=" in line for line in text.splitlines())


BAD = [
    ((("scheme =", "sheme ="),), ["sheme", "scheme", "[run]"]),
    ((("omega =", "omgea ="),), ["omgea", "omega", "[model]"]),
    ((('"synchrotron"', '"synchroton"'),), ["synchroton", "synchrotron"]),
    ((("[output]", "[ouput]"),), ["ouput", "output"]),
    ((("moments = true", "momnts = true"),), ["momnts", "moments"]),
    ((("moments = true", "moments = 1"),), ["moments", "true or false"]),
    ((("step = 0.02", 'step = "0.02"'),), ["[run]", "step", "number"]),
    ((("step = 0.02", "step = nan"),), ["[run]", "step", "finite"]),
    ((("step = 0.02", "step = 0.0"),), ["[run]", "step"]),
    ((("step = 0.02", ""),), ["lacks step"]),
    ((("steps = 500", "steps = 501"),), ["501", "save_every"]),
    ((("steps = 500", "steps = 5e2.0"),), ["TOML", "line"]),
    ((("sigma1 = 0.2", "sigma1 = inf"),), ["[model]", "sigma1", "finite"]),
    ((('"midpoint"', '"midpiont"'),), ["midpiont", "midpoint"]),
    ((("[0, 1, 7]", "[1000]"),), ["1000", "999"]),
    ((("[0, 1, 7]", '"some"'),), ["some", "all"]),
    ((("[model]", "[modell]"),), ["modell", "model"]),
    ((('name = "synchrotron"', ""),), ["name", "kubo"]),
    ((("q0 = 0.0", "q0 = [1.0, 2.0]"),), ["q0", "shape"]),
]


@pytest.mark.parametrize(("replacements", "words"), BAD)
def test_bad_scenes(replacements, words, file, capsys):
    path = file(*replacements)
    with pytest.raises(SceneError) as caught:
        scene.load(path)
    for word in (*words, "scene.toml"):
        assert word in str(caught.value)
    assert cli.main(["check", str(path)]) == 2
    assert str(caught.value) in capsys.readouterr().err


def test_missing_file(tmp_path, capsys):
    assert cli.main(["run", str(tmp_path / "none.toml")]) == 2
    assert "none.toml" in capsys.readouterr().err


def test_run(file, tmp_path, capsys, monkeypatch):
    path = file()
    monkeypatch.chdir(tmp_path)
    assert cli.main(["check", str(path)]) == 0
    assert "ok" in capsys.readouterr().out
    assert cli.main(["run", str(path)]) == 0
    shown = capsys.readouterr().out
    assert "mean q_1" in shown and "energy" in shown and "stepper" in shown
    assert len([line for line in shown.splitlines() if "+-" in line]) == 11
    written = sorted(p.name for p in (tmp_path / "scene").iterdir())
    assert written[0] == "moments.csv" and written[1] in ("run.nc", "run.npz")
    assert cli.main(["run", str(path), "--quiet", "--out", str(tmp_path / "elsewhere")]) == 0
    assert capsys.readouterr().out == ""


def test_failed_paths(file, tmp_path, capsys):
    text = '[model]\nname = "henon_heiles"\n[run]\nstep = 0.1\nsteps = 100\nq0 = 20.0\np0 = 0.0\npaths = 2\n'
    path = file(text=text + 'scheme = "stormer_verlet"\n[output]\npaths = "all"\n')
    assert cli.main(["run", str(path), "--out", str(tmp_path / "out")]) == 3
    assert "2 paths failed" in capsys.readouterr().err


def test_stopped(file, tmp_path):
    path = file(("steps = 500", "steps = 1000000000"), ("save_every = 50", "save_every = 100000000"))
    command = [sys.executable, "-m", "symsde", "run", str(path), "--out", str(tmp_path / "out")]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    time.sleep(1.5)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=10)
    assert process.returncode == 4 and "stopped" in errors
    assert "Traceback" not in errors
    assert os.listdir(tmp_path / "out") == []


def test_other_verbs(capsys):
    assert cli.main(["list"]) == 0
    shown = capsys.readouterr().out
    assert all(name in shown for name in (*ss.models.names(), *ss.schemes.names()))
    assert cli.main(["info"]) == 0
    assert ss.__version__ in capsys.readouterr().out
    assert cli.main(["template", "kubo"]) == 0
    assert cli.main(["template", "kubbo"]) == 2
    with pytest.raises(SystemExit) as caught:
        cli.main(["rnu"])
    assert caught.value.code == 2


def test_paper_is_dispatched(monkeypatch, tmp_path):
    pytest.importorskip("matplotlib")
    paper = pytest.importorskip("symsde.paper")
    called = []
    monkeypatch.setattr(paper, "run", lambda out, quick: called.append((out, quick)) or 1)
    assert cli.main(["paper", "--out", str(tmp_path), "--quick"]) == 1
    assert called == [(str(tmp_path), True)]
