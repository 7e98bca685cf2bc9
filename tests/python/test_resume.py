# SPDX-License-Identifier: BSD-3-Clause
"""A run resumes only if the files of the model are the same and its functions give the same values: equal files are not
enough, since a helper may read other data."""

import json
import subprocess
import sys

import numpy as np
import pytest
import symsde as ss
from symsde.batch import computed, manifest, scene
from symsde.cli import command_line
from symsde.errors import SceneError

SCENE = """
[model]
python = "own_model:make"
[run]
step = 0.05
steps = 40
save_every = 20
paths = 700
seed = 5
q0 = 1.0
p0 = 0.1
[observables]
r = {python = "own_model:radius"}
"""
MODEL = """
import numpy as np, symsde as ss
from own_helper import sigma, power, corner
def gradient(t, w, q, p):
    return w[0]*q + w[1]*sigma() + w[0]*corner(q), w[0]*p
def make():
    return ss.Model(ndof=1, nnoise=1, gradient=gradient)
def radius(q, p):
    return np.abs(q[0])**power()
"""
HELPER = """
import json, os
from pathlib import Path
here = json.loads(Path(os.environ["OWN_SETTINGS"]).read_text())
def sigma(): return here["sigma"]
def power(): return here["power"]
def corner(q): return 0*q
"""


@pytest.fixture
def own(tmp_path, monkeypatch):
    """A scene whose model imports a helper that reads a file; and the way to run it."""
    (tmp_path / "scene.toml").write_text(SCENE)
    (tmp_path / "own_model.py").write_text(MODEL)
    (tmp_path / "own_helper.py").write_text(HELPER)
    (tmp_path / "settings.json").write_text(json.dumps({"sigma": 0.1, "power": 2}))
    monkeypatch.setenv("OWN_SETTINGS", str(tmp_path / "settings.json"))

    def run(*more, verb="run", of="scene.toml", out="out"):
        words = [sys.executable, "-m", "symsde", verb, str(tmp_path / of), "--out", str(tmp_path / out)]
        words += ["--allow-python", "--quiet", *more]
        return subprocess.run(words, capture_output=True, text=True, check=False)

    return tmp_path, run


def begin(run):
    ended = run("--shard-paths", "256", "--shard", "1/2")
    assert ended.returncode == 0, ended.stderr


CHANGES = {
    "helper": ("own_helper.py", 'return here["sigma"]', "return 0.9", "computed.noises = '0"),
    "helper's file": ("settings.json", "0.1", "0.9", "computed.noises = '0"),
    "observable": ("settings.json", "2", "3", "computed.functions.r = '"),
    "far away": ("own_helper.py", "0*q", "(abs(q) > 3)*q**3", "computed.H = '"),
    "comment": ("own_helper.py", "def power", "# else\ndef power", "python_sha256.own_helper.py = '"),
}


@pytest.mark.parametrize(("file", "old", "new", "told"), CHANGES.values(), ids=CHANGES)
def test_another_model_is_refused(file, old, new, told, own):
    """The refusal names the changed file or value, old and new; after the file is restored, the run goes on."""
    folder, run = own
    begin(run)
    text = (folder / file).read_text()
    (folder / file).write_text(text.replace(old, new))
    ended = run()
    assert ended.returncode == command_line.BAD_INPUT and f"{folder / 'out'} holds another run: " in ended.stderr
    assert told in ended.stderr and ": give another folder with --out, or remove that one" in ended.stderr
    (folder / file).write_text(text)
    assert run().returncode == command_line.OK


def test_a_folder_holds_all_that_it_needs(own):
    """A folder holds the model and its imports: a copy continues by itself, merges, and is refused if a file has
    changed.
    """
    folder, run = own
    begin(run)
    for name in ("own_helper.py", "own_model.py"):
        (folder / name).rename(folder / f"{name}.away")
    ended = run(of="out/scene.toml")
    assert ended.returncode == command_line.OK, ended.stderr
    ended = run(verb="merge", of="out", out="merged")
    assert ended.returncode == command_line.OK, ended.stderr
    (folder / "settings.json").write_text(json.dumps({"sigma": 0.9, "power": 2}))
    ended = run(verb="merge", of="out", out="again")
    assert ended.returncode == command_line.BAD_INPUT and "computed.noises = '0" in ended.stderr


PARAMETERS = """
import json, os, symsde as ss
given = json.load(open(os.environ["OWN_SETTINGS"]))
def built_in(): return ss.models.kubo(sigma=given["sigma"])
def formula():
    params = {"s": given["sigma"], "k": 1.0}
    return ss.model_from_sympy(given.get("H", "p**2/2 + k*q**2/2"), ["s*q"], params=params)
"""


@pytest.mark.parametrize(
    ("make", "changed", "told"),
    [
        ("built_in", {"sigma": 0.9}, "computed.parameters.sigma = 0.1 there, 0.9 here"),
        ("formula", {"sigma": 0.9}, "computed.parameters.s = 0.1 there, 0.9 here"),
        (
            "formula",
            {"sigma": 0.1, "H": "p**2/2 + k*q**4/4"},
            "computed.formulas = ['p**2/2 + k*q**2/2', 's*q'] there, ",
        ),
    ],
)
def test_parameters_of_a_returned_model(make, changed, told, own):
    """The function in the file is unchanged, but its parameters differ."""
    folder, run = own
    text = SCENE.partition("[observables]")[0].replace("own_model:make", f"own_parameters:{make}")
    (folder / "scene.toml").write_text(text)
    (folder / "own_parameters.py").write_text(PARAMETERS)
    begin(run)
    (folder / "settings.json").write_text(json.dumps(changed))
    ended = run()
    assert ended.returncode == command_line.BAD_INPUT and told in ended.stderr, ended.stderr
    (folder / "settings.json").write_text(json.dumps({"sigma": 0.1}))
    assert run().returncode == command_line.OK


def test_a_helper_of_another_scene_is_not_taken(tmp_path, monkeypatch):
    """Two scenes of one process whose files have equal names."""
    token = scene.PYTHON_ALLOWED.set(True)
    for name, sigma in (("one", 0.1), ("two", 0.9)):
        (tmp_path / name).mkdir()
        (tmp_path / name / "scene.toml").write_text(
            SCENE.partition("[observables]")[0].replace("own_model", f"{name}_m")
        )
        (tmp_path / name / f"{name}_m.py").write_text(
            "import symsde as ss\nfrom common_helper import sigma\ndef make(): return ss.models.kubo(sigma=sigma)\n"
        )
        (tmp_path / name / "common_helper.py").write_text(f"sigma = {sigma}\n")
    try:
        assert scene.load(tmp_path / "one" / "scene.toml").model.parameters["sigma"] == 0.1
        with pytest.raises(
            SceneError, match=r"two/common_helper.py differs from the common_helper that is here already \(.*one/"
        ):
            scene.load(tmp_path / "two" / "scene.toml")
    finally:
        scene.PYTHON_ALLOWED.reset(token)


def test_folders_of_before(tmp_path, monkeypatch, capsys):
    """Old folders can be read; continuing them is refused, since nothing says which model made them."""
    file, out = tmp_path / "scene.toml", tmp_path / "out"
    file.write_text(SCENE.partition("[observables]")[0].replace('python = "own_model:make"', 'name = "kubo"'))
    words = ["run", str(file), "--out", str(out), "--quiet"]
    with monkeypatch.context() as before:
        before.setattr(manifest, "FORMAT", 1)
        before.setattr(computed, "of", lambda *_: {})
        assert command_line.main(words) == command_line.OK
    text = (out / "manifest.json").read_text()
    assert '"format": 1' in text
    found = ss.open_run(out)
    assert found.missing == [] and found.moments.report.failed == 0
    assert command_line.main(words) == command_line.BAD_INPUT
    told = capsys.readouterr().err
    assert f"{out} was begun by a version of symsde that did not record how a run is computed" in told
    assert (
        "read it by symsde.open_run, or continue with that version; for this one give another folder with --out" in told
    )
    (out / "manifest.json").write_text(text.replace('"format": 1', '"format": 3'))
    with pytest.raises(SceneError, match="has format 3, this symsde knows 2: use the version that made it"):
        ss.open_run(out)


def of(model, scheme=None, **functions):
    start = computed.Start(np.ones((model.ndof, 1)), np.zeros((model.ndof, 1)), 0.0, 10.0)
    return computed.of(model, scheme, start, functions)


def user(force, **more):
    return ss.Model(ndof=1, nnoise=1, gradient=lambda t, w, q, p: (w[0] * force(t, q) + w[1], w[0] * p), **more)


def test_what_tells_models_apart():
    """Each of these alone distinguishes two models: a trait, the value, the time, one component of very different size.
    Rounding does not.
    """
    known = of(user(lambda t, q: q))
    assert of(user(lambda t, q: q)) == known
    assert of(user(lambda t, q: q * (1 + 1e-12) + 1e-16)) == known
    for other in (
        user(lambda t, q: q, identity_mass=True),
        user(lambda t, q: q, value=lambda t, w, q, p: q[0]),
        user(lambda t, q: q * np.cos(t)),
        user(lambda t, q: q + 1e-6),
        user(lambda t, q: q + 1e3 * (q > 3.5)),
    ):
        assert of(other) != known
    assert of(user(lambda t, q: 1 / 0))["H"].startswith("raises ZeroDivisionError, .. (")

    def pair(small):
        return ss.Model(ndof=2, nnoise=0, gradient=lambda t, w, q, p: (w[0] * q * [[1e9], [small]], w[0] * p))

    assert of(pair(1.0)) == of(pair(1.0)) != of(pair(1.001))


def test_what_tells_schemes_and_functions_apart():
    model = ss.models.kubo()
    scheme = ss.schemes.get("midpoint")
    nodes = [0.5], [1.0]
    known = [of(model, x) for x in (None, scheme, ss.schemes.from_quadrature(*nodes, 1, name="midpoint"))]
    assert all(a != b for i, a in enumerate(known) for b in known[:i])
    own = [ss.schemes.from_tableau([[x]], [[1 - x]], [1.0], name="own") for x in (0.5, 0.25)]
    parts = [ss.schemes.composition(["midpoint", "midpoint"], x, "own") for x in ([0.5, 0.5], [0.25, 0.75])]
    for a, b in (own, parts):
        assert of(model, a) == of(model, a) != of(model, b)
    one = of(model, f=lambda q, p: q[0] ** 2)
    assert one == of(model, f=lambda q, p: q[0] * q[0]) != of(model, f=lambda q, p: q[0] ** 2.001)
