# SPDX-License-Identifier: BSD-3-Clause
"""`symsde expect`: the answer for a scene is printed, refused, or given as far as it was computed."""

import dataclasses
import importlib
import math
import re
from pathlib import Path

import pytest
import symsde as ss
from symsde.cli.command_line import main

PLACE = {"q0": 1.0, "p0": 0.0, "horizon": 2.0}


def test_scene(tmp_path, capsys):
    scene = tmp_path / "scene.toml"
    scene.write_text(
        '[model]\nname = "kubo"\n[run]\nstep = 0.1\nsteps = 20\nq0 = 1.0\np0 = 0.0\n'
        '[expect]\nf = ["q", "q**2 + p**2"]\nabs = 0.01\nscheme = "gauss2"\n'
    )
    assert main(["expect", str(scene), "--quiet"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 2 and lines[0].startswith("E q = ") and "[" in lines[0]
    assert float(lines[1].split("=")[1].split("[")[0]) == pytest.approx(1.0)
    value, low, high = map(float, re.findall(r"-?[\d.]+", lines[0].split("=")[1]))
    assert abs(value - math.exp(-0.09) * math.cos(2)) < 0.02
    assert value - 0.0105 <= low < value < high <= value + 0.0105
    assert main(["expect", str(scene), "--abs", "-1"]) == 2
    assert "[expect]: abs = -1" in capsys.readouterr().err
    scene.write_text(scene.read_text().replace("f =", "g ="))
    assert main(["expect", str(scene)]) == 2
    assert "no key of [expect]" in capsys.readouterr().err


def test_scene_that_goes_backward_or_asks_for_nothing(tmp_path, capsys):
    scene = tmp_path / "scene.toml"
    text = '[model]\nname = "kubo"\n[run]\nstep = {}\nsteps = 20\nq0 = 1.0\np0 = 0.0\n[expect]\nf = {}\nabs = 0.1\n'
    for step, f, words in (
        (-0.1, '"q"', "goes backward"),
        (0.1, "[]", "a list of formulas"),
        (0.1, "[3]", "a formula"),
    ):
        scene.write_text(text.format(step, f))
        assert main(["expect", str(scene)]) == 2
        assert words in capsys.readouterr().err
    scene.write_text(text.format(0.1, '"q"').replace("steps = 20", "steps = 20\nmax_iter = 5"))
    assert main(["expect", str(scene)]) == 2
    assert "max_iter = 5 of [run] would have no effect" in capsys.readouterr().err
    scene.write_text(text.format(-0.1, '"q"') + "horizon = 2.0\n")
    assert main(["expect", str(scene), "--quiet"]) == 0


def test_ctrl_c_prints_what_is_known(tmp_path, capsys, monkeypatch):
    scene = tmp_path / "scene.toml"
    scene.write_text(
        '[model]\nname = "kubo"\n[run]\nstep = 0.1\nsteps = 20\nq0 = 1.0\np0 = 0.0\n'
        '[expect]\nf = ["q", "p"]\nabs = 0.1\n'
    )
    answer = ss.expect(ss.models.kubo(), "q", **PLACE, abs=0.1)

    def stopped(model, f, **_):
        if f == "q":
            return answer
        stop = KeyboardInterrupt()
        stop.partial = answer
        raise stop

    monkeypatch.setattr(importlib.import_module("symsde.cli.expect_command"), "expect", stopped)
    assert main(["expect", str(scene), "--quiet"]) == 4
    assert [line.split(" = ")[0] for line in capsys.readouterr().out.splitlines()] == ["E q", "E p"]


@pytest.fixture
def asked(tmp_path, monkeypatch):
    """A scene of two means, and the calls of `expect` that the command makes; the interval of the first mean is too
    wide."""
    scene = tmp_path / "scene.toml"
    scene.write_text(
        '[model]\nname = "kubo"\n[run]\nstep = 0.1\nsteps = 20\nq0 = 1.0\np0 = 0.0\n'
        '[expect]\nf = ["q", "p"]\nrel = 0.1\n'
    )
    answer, calls = ss.expect(ss.models.kubo(), "q", **PLACE, abs=0.1), []

    def given(model, f, **arguments):
        calls.append((f, arguments))
        return dataclasses.replace(answer, reached=f != "q")

    monkeypatch.setattr(importlib.import_module("symsde.cli.expect_command"), "expect", given)
    return str(scene), calls


@pytest.mark.parametrize(("option", "other"), [("abs", "rel"), ("rel", "abs")])
def test_a_width_on_the_command_line_replaces_that_of_the_scene(asked, option, other):
    scene, calls = asked
    main(["expect", scene, f"--{option}", "0.25", "--quiet"])
    assert [f for f, _ in calls] == ["q", "p"]
    assert all(arguments[option] == 0.25 and other not in arguments for _, arguments in calls)


def test_one_interval_that_is_too_wide_is_enough(asked, tmp_path, capsys):
    """One interval that is too wide is enough for the exit code, even if the last interval is narrow enough; a
    message says how to go on.
    """
    scene, calls = asked
    out = str(tmp_path / "out")
    assert main(["expect", scene, "--quiet", "--out", out, "--allow-python"]) == 4
    assert [str(arguments["out"]) for _, arguments in calls] == [f"{out}/mean-1", f"{out}/mean-2"]
    assert f"resume with `symsde expect {scene} --out {out} --allow-python`" in capsys.readouterr().err


def test_a_mean_by_itself_has_the_whole_folder(asked, tmp_path):
    scene, calls = asked
    Path(scene).write_text(Path(scene).read_text().replace('f = ["q", "p"]', 'f = "q"'))
    main(["expect", scene, "--quiet", "--out", str(tmp_path / "out")])
    assert [str(arguments["out"]) for _, arguments in calls] == [str(tmp_path / "out")]


def test_what_a_scene_asks_of_its_run_is_asked_of_the_mean(asked):
    """Seed, initial state and those options that `expect` has are taken from [run]."""
    scene, calls = asked
    text = Path(scene).read_text()
    Path(scene).write_text(text.replace("[expect]", "seed = 5\nt0 = 0.5\ncompensated = true\n[expect]"))
    main(["expect", scene, "--quiet"])
    wanted = {"seed": 5, "t0": 0.5, "compensated": True, "q0": 1.0, "p0": 0.0, "horizon": 2.0}
    assert len(calls) == 2 and all(wanted.items() <= given.items() for _, given in calls)
