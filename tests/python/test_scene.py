# SPDX-License-Identifier: BSD-3-Clause
"""Scenes and the command line."""

import contextlib
import os
import pty
import random
import re
import signal
import subprocess
import sys
import termios
import tomllib
from pathlib import Path

import numpy as np
import pytest
import symsde as ss
from conftest import moments_of, paths_of, table_of
from symsde.batch import execute, scene
from symsde.cli import command_line
from symsde.errors import SceneError
from symsde.studies.study import study_scenes as scenes

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


def saved(file, folder):
    """The paths that `symsde run` saves for a scene."""
    assert command_line.main(["run", str(file), "--out", str(folder), "--quiet"]) == 0
    return ss.open_run(folder).run


@pytest.mark.parametrize(("steps", "every"), [(0, 1), (1, 1), (9, 1), (9, 3), (9, 9), (500, 50)])
def test_room_is_asked_for_all_saved_times(file, steps, every, monkeypatch):
    asked = []
    monkeypatch.setattr(scene.checks, "room", lambda shape, *_, **__: asked.append(shape) or 8)
    path = file(("steps = 500", f"steps = {steps}"), ("save_every = 50", f"save_every = {every}"))
    loaded = scene.load(path)
    last = asked[-1]
    assert last == (2, ss.simulate(loaded.model, **{**loaded.run, "paths": 3}).t.size, 1, 3)


def test_scene_is_the_run_it_says(file, tmp_path):
    moments, run = moments_of(scene.load(file())), saved(file(), tmp_path / "out")
    common = {"q0": 0.0, "p0": 0.0, "step": 0.02, "steps": 500, "seed": 1, "save_every": 50}
    model = ss.models.synchrotron()
    np.testing.assert_array_equal(moments.mean_q, ss.moments(model, paths=1000, **common).mean_q)
    whole = ss.simulate(model, paths=1000, **common)
    np.testing.assert_array_equal(run.path, [0, 1, 7])
    for name in ("q", "p", "status", "failed_step", "last_q", "last_p"):
        np.testing.assert_array_equal(getattr(run, name), getattr(whole, name)[..., [0, 1, 7]], err_msg=name)


# Every key of [run] with a value other than its default, and what must change in the run.
KEYS = {
    "step": "0.01", "steps": "550", "q0": "0.25", "p0": "-0.5", "t0": "1.5", "scheme": '"gauss2"', "paths": "1001",
    "seed": "12", "save_every": "25", "refine": "1", "first_path": "256", "first_step": "7", "correction": '"none"',
    "truncation": "[1.2, 1.0]", "compensated": "true", "threads": "1", "general": "true", "fixed_point": "9",
    "max_iter": "50", "lanes": "64", "areas": '"law"', "area_time": "2.0", "damping_noise": '"path"',
    "common_noise": "[2]", "save_at": "[0.2, 1.0, 10.0]",
}  # fmt: skip


def test_every_key_of_a_run_reaches_it(file):
    """For each key a scene: options, paths and moments equal those of the same call of `simulate`."""
    assert set(KEYS) == set(scene.RUN_KEYS)
    default = {"q0": 0.0, "p0": 0.0, "step": 0.02, "steps": 500, "seed": 1, "save_every": 50, "paths": 1000}
    for key, text in KEYS.items():
        value = tomllib.loads(f"x = {text}")["x"]
        head, _, run = SCENE.partition("[output]")[0].partition("[run]\n")
        scheme = {"areas": "midpoint_areas", "damping_noise": "gauss_dkdkd"}.get(key, "midpoint")  # uses the key
        head = head.replace("[model]\n", "[model]\ndamping = 0.5\n") if key == "damping_noise" else head
        run, default = run.replace('"midpoint"', f'"{scheme}"'), {**default, "scheme": scheme}
        gone = {key, "save_every"} if key == "save_at" else {key}  # one of both
        kept = "".join(line for line in run.splitlines(True) if line.partition(" =")[0] not in gone)
        loaded = scene.load(file(text=f'{head}[run]\n{key} = {text}\n{kept}[output]\npaths = "all"'))
        given = {name: x for name, x in default.items() if name not in gone}
        given[key] = tuple(value) if isinstance(value, list) else value
        mine, known = paths_of(loaded), ss.simulate(loaded.model, **given)
        assert mine.setup.attributes() == known.setup.attributes(), key
        for name in ("t", "path", "q", "p", "status"):
            np.testing.assert_array_equal(getattr(mine, name), getattr(known, name), err_msg=key)
        for name in ("threads", "lanes"):
            assert getattr(mine.setup.options, name) == getattr(known.setup.options, name), key
        moments = moments_of(loaded)
        np.testing.assert_array_equal(moments.mean_p, ss.moments(loaded.model, **given).mean_p, err_msg=key)
        plain = ss.simulate(loaded.model, **default)
        if key in {"q0", "p0"}:
            assert (getattr(mine, key[0])[0] == value).all()
        elif key not in {"threads", "lanes"}:
            assert mine.setup.attributes() != plain.setup.attributes(), key
        other_paths = {"paths", "seed", "refine", "first_path", "first_step", "truncation", "common_noise"}
        if key in {"q0", "p0", "step", "scheme", *other_paths}:
            assert moments.mean_p[-1, 0] != ss.moments(loaded.model, **default).mean_p[-1, 0], key


@pytest.mark.parametrize(
    ("output", "written"),
    [
        ("[output]\nmoments = false\npaths = [0]", ["run.nc"]),
        ("[output]\nmoments = true\npaths = []", ["moments.csv"]),
        ("[output]\npaths = [3]", ["moments.csv", "run.nc"]),
        ("[output]\nmoments = false", []),
        ("", ["moments.csv"]),
    ],
)
def test_only_what_is_wanted_is_computed(output, written, file, tmp_path, monkeypatch):
    pytest.importorskip("netCDF4")
    for name, wanted in (("moments_of", "moments.csv"), ("simulate", "run.nc")):
        if wanted not in written:
            monkeypatch.setattr(execute, name, lambda *_, **__: pytest.fail("not wanted"))
    path = file(text=SCENE.partition("[output]")[0] + output)
    assert command_line.main(["run", str(path), "--out", str(tmp_path / "out")]) == 0
    assert results(tmp_path / "out") == written


def results(folder):
    """The files besides the shards and their own files."""
    return sorted(set(os.listdir(folder)) - {"manifest.json", "scene.toml", "shards", ".claims"})


def test_files_of_a_run_hold_the_run(file, tmp_path, capsys):
    xarray = pytest.importorskip("xarray")
    path = file()
    assert command_line.main(["run", str(path), "--out", str(tmp_path / "out")]) == 0
    loaded = scene.load(path)
    moments, run = moments_of(loaded), paths_of(loaded)
    moments.save(tmp_path / "known.csv")
    assert table_of(tmp_path / "out" / "moments.csv") == table_of(tmp_path / "known.csv")
    with xarray.open_dataset(tmp_path / "out" / "run.nc") as data:
        np.testing.assert_array_equal(data.q, run.q)
        np.testing.assert_array_equal(data.path, [0, 1, 7])
        np.testing.assert_array_equal(data.time, run.t)


def test_paths_of_a_compensated_scene_keep_their_low_parts(file, tmp_path):
    """Saved low parts of every stretch of paths equal the low parts of a run of all paths."""
    path = file(("[run]", "[run]\ncompensated = true"))
    found, whole = saved(path, tmp_path / "out"), paths_of(scene.load(path))
    for name in ("last_q", "q_low", "p_low"):
        np.testing.assert_array_equal(getattr(found, name), getattr(whole, name), err_msg=name)


def test_check_says_what_the_run_will_do(file, capsys):
    path = file(("steps = 500", "steps = 1000000000"), ("save_every = 50", "save_every = 1000000"),
                ('"midpoint"', '"symplectic_euler"'))  # fmt: skip
    assert command_line.main(["check", str(path)]) == 0
    first, *lines = capsys.readouterr().out.splitlines()
    assert first == f"{path}: ok"
    report = ss.simulate(ss.models.synchrotron(), q0=0.0, p0=0.0, step=0.02, steps=0, scheme="symplectic_euler").report
    found = {line[:11].strip(): line[11:] for line in lines}
    assert found["model"] == "synchrotron(omega=2, sigma1=0.2, sigma2=0.1)"
    assert found["stepper"] == report.stepper
    assert found["left out"] == "correction: it vanishes for this noise; solver: the step is explicit"


def test_paths_with_states_of_their_own(file, tmp_path):
    run = saved(file(("paths = 1000", "paths = 3\nfirst_path = 256"), ("q0 = 0.0", "q0 = [[0.1, 0.2, 0.3]]"),
                      ("[0, 1, 7]", "[256, 258]")), tmp_path / "out")  # fmt: skip
    np.testing.assert_array_equal(run.q[0, 0], [0.1, 0.3])


@pytest.mark.parametrize("name", ss.models.names())
def test_templates_are_scenes(name, file):
    text = scene.template(name)
    loaded = scene.load(file(text=text))
    assert loaded.model.name == name and loaded.run["steps"] == 5000
    assert loaded.model.parameters == ss.models.parameters(name)
    assert loaded.run["step"] == 0.02 and loaded.run["save_every"] == 50 and loaded.run["scheme"] == "midpoint"
    assert (loaded.run["q0"], loaded.run["p0"]) == (0.1 if loaded.model.ndof > 1 else 1.0, 0.0)
    assert loaded.moments and list(loaded.paths) == [0]
    assert loaded.run.get("paths", 1) == (1000 if loaded.model.nnoise else 1)
    assert all("#" not in line or line.index("#") == 0 or "=" in line for line in text.splitlines())


BAD = [
    ((("scheme =", "sheme ="),), ["sheme", "scheme", "[run]"]),
    ((("omega =", "omgea ="),), ["omgea", "omega", "[model]"]),
    ((("omega =", "force ="),), ["'force'", "omega", "damping", "thermostat"]),
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
    (
        (
            (
                'name = "synchrotron"',
                'name = "synchrotron"\nthermostat = {beta = {from = 1, to = 2, count = 3}, gamma = 1}',
            ),
        ),
        ["beta of the thermostat", "from", "ss.sweep"],
    ),
]


@pytest.mark.parametrize(("replacements", "words"), BAD)
def test_bad_scenes(replacements, words, file, capsys):
    path = file(*replacements)
    with pytest.raises(SceneError) as caught:
        scene.load(path)
    for word in (*words, "scene.toml"):
        assert word in str(caught.value)
    assert command_line.main(["check", str(path)]) == 2
    assert str(caught.value) in capsys.readouterr().err


HOSTILE = [
    "-inf",
    "nan",
    "[]",
    "{}",
    "true",
    '""',
    "1e400",
    "1979-05-27",
    "'a\\b'",
    "-1",
    "0",
    "2.5",
    "{a = 1}",
    '"all"',
]
HOSTILE += ["9" * 5000, "[" * 500 + "]" * 500, "[[1, 2], [3]]", "9223372036854775808", "[1e9]", "10000000000"]


def test_whatever_a_scene_holds_there_is_a_sentence(file, capsys):
    """Every key is given every hostile value: the scene is read, or a refusal names the file; there is no other
    exception.
    """
    keys = [line.split(" =")[0] for line in SCENE.splitlines() if " = " in line]
    more = [("[run]", key) for key in scene.RUN_KEYS if key not in keys]
    more += [("[output]", key) for key in scene.OUTPUT_KEYS if key not in keys]
    more += [("[study]", key) for key in scene.STUDY_KEYS]
    cases = [(None, key, value) for key in keys for value in HOSTILE]
    cases += [(table, key, value) for table, key in more for value in HOSTILE]
    refused = 0
    for table, key, value in cases:
        text = SCENE + "[study]\n"
        if table is None:
            text = "\n".join(f"{key} = {value}" if line.startswith(f"{key} =") else line for line in text.splitlines())
        else:
            text = text.replace(table, f"{table}\n{key} = {value}")
        path = file(text=text)
        try:
            scene.load(path)
            if table == "[study]":
                scenes.check(path)
        except SceneError as error:
            assert "scene.toml" in str(error)
            refused += 1
    assert refused > 0.7 * len(cases)


def test_bytes_that_are_no_scene(tmp_path):
    """Scenes with a few wrong bytes, and halves of such scenes, are read or refused, without another exception."""
    chance = random.Random(1)
    path = tmp_path / "scene.toml"
    for _ in range(200):
        text = bytearray(SCENE.encode())
        for _ in range(chance.choice([1, 3, 10])):
            text[chance.randrange(len(text))] = chance.randrange(256)
        path.write_bytes(text[: chance.choice([len(text), len(text) // 2])])
        with contextlib.suppress(SceneError):
            scene.load(path)


def test_all_paths_are_not_listed_before_their_size_is_known(file):
    with pytest.raises(SceneError, match=r"\[output\] paths.*GB"):
        scene.load(file(("paths = 1000", "paths = 1000000000000"), ("[0, 1, 7]", '"all"')))
    assert scene.load(file(("[0, 1, 7]", '"all"'))).paths == range(1000)


def test_missing_file(tmp_path, capsys):
    assert command_line.main(["run", str(tmp_path / "none.toml")]) == 2
    assert "none.toml" in capsys.readouterr().err


def test_run(file, tmp_path, capsys, monkeypatch):
    path = file()
    monkeypatch.chdir(tmp_path)
    assert command_line.main(["check", str(path)]) == 0
    assert "ok" in capsys.readouterr().out
    assert command_line.main(["run", str(path)]) == 0
    shown = capsys.readouterr().out
    assert "mean q_1" in shown and "energy" in shown and "stepper" in shown
    assert len([line for line in shown.splitlines() if "+-" in line]) == 11
    written = results(tmp_path / "scene")
    assert written[0] == "moments.csv" and written[1] in ("run.nc", "run.npz")
    assert command_line.main(["run", str(path), "--quiet", "--out", str(tmp_path / "elsewhere")]) == 0
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize("output", ['paths = "all"', "moments = true", 'moments = false\npaths = "all"'])
def test_failed_paths(output, file, tmp_path, capsys):
    text = '[model]\nname = "henon_heiles"\n[run]\nstep = 0.1\nsteps = 100\np0 = 0.0\npaths = 3\n'
    text += 'q0 = [[20.0, 0.1, 20.0], [20.0, 0.1, 20.0]]\nscheme = "stormer_verlet"\n'
    path = file(text=f"{text}[output]\n{output}\n")
    assert command_line.main(["run", str(path), "--out", str(tmp_path / "out")]) == 3
    first, *more = capsys.readouterr().err.splitlines()
    assert first == "symsde: 2 paths failed; moments are over the others"
    if "moments = false" in output:
        assert not more
    else:  # moments contain paths that are about to fail
        assert [line[:47] for line in more] == ["symsde: energy is not a finite number for some "]
        last = (tmp_path / "out" / "moments.csv").read_text().splitlines()[-1]
        assert last.split(",")[1] == "1"


def test_failed_paths_that_are_not_saved_count_too(file, tmp_path, capsys):
    text = '[model]\nname = "henon_heiles"\n[run]\nstep = 0.1\nsteps = 100\np0 = 0.0\npaths = 3\n'
    text += 'q0 = [[20.0, 0.1, 20.0], [20.0, 0.1, 20.0]]\nscheme = "stormer_verlet"\n[output]\npaths = [1]\n'
    assert command_line.main(["run", str(file(text=text)), "--out", str(tmp_path / "out")]) == 3
    good = text.replace("[output]", "[output]\nmoments = false")
    assert command_line.main(["run", str(file(text=good)), "--out", str(tmp_path / "good")]) == 0


LONG = ("steps = 500", "steps = 1000000000"), ("save_every = 50", "save_every = 100000000")


def stopped_by(number, command, folder):
    """Exit code and terminal output of a command that gets a signal when a hundredth of it is done."""
    terminal, theirs = pty.openpty()
    termios.tcsetwinsize(theirs, (24, 80))
    process = subprocess.Popen([sys.executable, "-m", "symsde", *command], stderr=theirs, cwd=folder)
    os.close(theirs)
    shown = b""
    with contextlib.suppress(OSError):  # reading raises this at the end of a terminal's output
        while data := os.read(terminal, 1000):
            shown += data
            if number and re.search(rb"[1-9]\d* ?%", shown):  # by then the first checkpoint is written
                process.send_signal(number)
                number = None
    os.close(terminal)
    return process.wait(), shown.decode()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_stopped_run_keeps_its_checkpoint(number, file, tmp_path):
    path = file(*LONG, ("moments = true", "moments = false"), ("[0, 1, 7]", "[0, 1]"))
    code, shown = stopped_by(number, ["run", str(path), "--out", "out"], tmp_path)
    assert code == command_line.STOPPED and f"stopped by {number.name}; 0 of 1 shards are in out: resume with" in shown
    assert "Traceback" not in shown
    assert results(tmp_path / "out") == [] and os.listdir(tmp_path / "out" / "shards") == ["paths-000001.checkpoint"]


def test_signals_are_left_as_they_were(file, tmp_path):
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    assert command_line.main(["run", str(file()), "--quiet", "--out", str(tmp_path / "out")]) == 0
    assert {number: signal.getsignal(number) for number in before} == before


FOLDERS = ["/proc/self", "/proc/self/deeper", "scene.toml"]


@pytest.mark.parametrize("folder", FOLDERS)
@pytest.mark.parametrize("verb", ["run", "study", "stability", "paper"])
def test_a_folder_that_cannot_be_written_is_found_before_the_work(verb, folder, file, capsys, monkeypatch):
    """Folders in /proc take no files, even from root."""
    pytest.importorskip("matplotlib")
    from symsde.studies import paper, stability, study

    def begin(*_, **__):
        pytest.fail("the work began")

    monkeypatch.chdir(file().parent)
    for module, name in ((execute, "moments_of"), (study, "measure")):
        monkeypatch.setattr(module, name, begin)
    monkeypatch.setattr(stability, "SCENARIOS", (begin,))
    monkeypatch.setattr(paper.kubo, "run", begin)
    scenes = ["scene.toml"] if verb in {"run", "study"} else []
    assert command_line.main([verb, *scenes, "--out", folder]) == command_line.NOT_WRITTEN
    assert f"nothing can be written to {folder}" in capsys.readouterr().err


def piped(arguments, lines):
    """Exit code, standard error and first lines of a command whose reader stops after these lines."""
    command = [sys.executable, "-m", "symsde", *arguments]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        read = [process.stdout.readline() for _ in range(lines)]
        process.stdout.close()
        errors = process.stderr.read().decode()
    return process.returncode, errors, read


@pytest.mark.parametrize("command", [["list"], ["list", "--markdown"], ["--help"], ["info"], ["template", "kubo"]])
@pytest.mark.parametrize("lines", [0, 1])
def test_a_reader_may_leave(command, lines):
    assert piped(command, lines)[:2] == (0, "")


def test_a_reader_who_leaves_does_not_stop_the_run(file, tmp_path):
    assert piped(["run", str(file()), "--out", str(tmp_path / "out")], 0)[:2] == (0, "")
    assert results(tmp_path / "out") == ["moments.csv", "run.nc"]


def test_a_full_device_is_said_once():
    with open("/dev/full", "w") as full:
        command = [sys.executable, "-m", "symsde", "list"]
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == command_line.NOT_WRITTEN
    assert "No space left" in done.stderr and len(done.stderr.splitlines()) == 1


def test_other_verbs(capsys):
    assert command_line.main(["list"]) == 0
    shown = capsys.readouterr().out
    assert all(name in shown for name in (*ss.models.names(), *ss.schemes.names()))
    assert command_line.main(["info"]) == 0
    assert ss.__version__ in capsys.readouterr().out
    assert command_line.main(["template", "kubo"]) == 0
    assert command_line.main(["template", "kubbo"]) == 2
    with pytest.raises(SystemExit) as caught:
        command_line.main(["rnu"])
    assert caught.value.code == 2


def test_paper_is_dispatched(monkeypatch, tmp_path):
    pytest.importorskip("matplotlib")
    paper = pytest.importorskip("symsde.studies.paper")
    called = []
    monkeypatch.setattr(paper, "run", lambda out, quick: called.append((out, quick)) or 1)
    assert command_line.main(["paper", "--out", str(tmp_path), "--quick"]) == 1
    assert called == [(str(tmp_path), True)]


def test_a_plain_scene_needs_numpy_alone():
    """An environment as after `pip install symsde`: importing optional packages fails."""
    scene_file = Path(__file__).parents[2] / "examples" / "scenes" / "kubo.toml"
    code = (
        "import sys\n"
        "for name in ('sympy', 'symengine', 'scipy', 'numba', 'matplotlib', 'xarray', 'netCDF4', 'tqdm', 'pandas'):\n"
        "    sys.modules[name] = None\n"
        "from symsde.cli.command_line import main\n"
        f"sys.exit(main(['check', {str(scene_file)!r}]))\n"
    )
    done = subprocess.run([sys.executable, "-c", code], check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
