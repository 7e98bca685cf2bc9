# SPDX-License-Identifier: BSD-3-Clause
"""Expectations in a folder: draws are kept, continued, shared, and never used for another question."""

import importlib
import json
import math
import signal
import subprocess
import sys

import numpy as np
import pytest
import symsde as ss
from sent_at import PLACED, words
from symsde.answers.coupled import LevelSampler
from symsde.answers.expectation import choice, draw_store
from symsde.answers.expectation.carry_out import FIRST
from symsde.answers.expectation.draw_store import InFolder, open_folder
from symsde.answers.expectation.estimators import Drawn, Plain
from symsde.answers.expectation.interval import Tally
from symsde.answers.expectation.problem import make_problem
from symsde.answers.expectation.watch import Watch
from symsde.batch.folder import RunFolder
from symsde.batch.shard_file import read
from symsde.cli.command_line import main
from symsde.schemes import as_scheme

PLACE = {"q0": 1.0, "p0": 0.0, "horizon": 2.0}
STEADY = {"scheme": "lobatto2_swapped", "threads": 1}


@pytest.fixture
def model():
    return ss.models.synchrotron(sigma1=0.8, sigma2=0.5)


def in_folder(path, watch):
    """The folder of a question whose content does not matter."""
    problem = make_problem(ss.models.kubo(), "q", q0=1.0, p0=0.0, horizon=1.0, seed=0)
    return open_folder(path, {"expect": {}}, problem, [as_scheme("midpoint")], watch)


def shards(folder, kind):
    return sorted((folder / "shards").glob(f"{kind}-*.npz"))


@pytest.mark.filterwarnings("ignore::symsde.BudgetWarning")
def test_work_goes_on_and_counts_every_unit_once(model, tmp_path):
    """The value is the mean over units 0, 1, .. of the plan, also drawn without a folder; existing files are not
    changed, and a third call draws nothing."""
    asked = {**PLACE, **STEADY, "abs": 5e-3, "method": "plain", "out": tmp_path}
    first = ss.expect(model, "q**2", **asked, max_time=1e-9)
    there = {path: path.read_bytes() for path in shards(tmp_path, "units")}
    assert not first.reached and there and any("max_time" in note for note in first.notes)
    whole = ss.expect(model, "q**2", **asked)
    assert whole.reached and whole.paths > first.paths and whole.cost > whole.pilot > 0
    assert all(path.read_bytes() == content for path, content in there.items())
    problem = make_problem(model, "q**2", **PLACE)
    units = Plain(problem, as_scheme("lobatto2_swapped"), round(2.0 / whole.step), FIRST).draw(whole.paths).units
    assert whole.value == pytest.approx(units.mean, rel=1e-13)
    assert whole.error == pytest.approx(units.error, rel=1e-9)
    found = sum((read(path).arrays["tallies"][0][0] for path in shards(tmp_path, "units")), 0.0)
    assert whole.paths == found
    again = ss.expect(model, "q**2", **asked)
    assert (again.value, again.interval, again.paths) == (whole.value, whole.interval, whole.paths)
    kept = json.loads((tmp_path / "answer.json").read_text())
    assert kept["value"] == whole.value and kept["interval"] == list(whole.interval) and kept["reached"]
    assert kept["made"]["symsde_version"] == ss.__version__


@pytest.mark.parametrize("method", choice.METHODS)
def test_what_is_there_is_not_drawn_again(model, tmp_path, monkeypatch, method):
    if method == choice.EVEN_LEVELS:
        pytest.importorskip("scipy")
    asked = {**PLACE, **STEADY, "abs": 2e-2, "method": method, "out": tmp_path}
    whole = ss.expect(model, "q**2", **asked)

    def drawn(*_, **__):
        raise AssertionError("drawn again")

    monkeypatch.setattr(LevelSampler, "_pair", drawn)
    monkeypatch.setattr(importlib.import_module("symsde.answers.expectation.estimators").Estimator, "draw", drawn)
    again = ss.expect(model, "q**2", **asked)
    assert (again.value, again.interval, again.paths) == (whole.value, whole.interval, whole.paths)
    assert again.method == method and again.cost > again.pilot == whole.pilot > 0


def test_units_from_one_on_are_those_of_the_whole(model):
    problem = make_problem(model, "q**2", **PLACE)
    for method in ("plain", "antithetic"):
        plan = choice.Plan(method, as_scheme("stormer_verlet"), 8, 8, 0.0, 1.0, (0.0, 0.0))
        made = [plan.estimators(FIRST, problem)[0] for _ in range(2)]
        parts = made[0].draw_from(300, 200).units + made[0].draw_from(0, 300).units
        assert parts.mean == pytest.approx(made[1].draw(500).units.mean, rel=1e-13)


def test_another_question_is_refused(model, tmp_path):
    asked = {**PLACE, **STEADY, "abs": 5e-2, "method": "plain", "out": tmp_path}
    ss.expect(model, lambda q, p: q[0] ** 2, **asked)
    for change in ({"abs": 4e-2}, {"seed": 1}, {"horizon": 2.5}, {"q0": 1.5}, {"method": "antithetic"}):
        with pytest.raises(ss.errors.SceneError, match="holds another run"):
            ss.expect(model, lambda q, p: q[0] ** 2, **{**asked, **change})
    with pytest.raises(ss.errors.SceneError, match=r"computed\.functions\.<lambda> = "):
        ss.expect(model, lambda q, p: q[0] ** 2 + 1e-6, **asked)
    with pytest.raises(ss.errors.SceneError, match="sigma1"):
        ss.expect(ss.models.synchrotron(sigma1=0.7, sigma2=0.5), lambda q, p: q[0] ** 2, **asked)
    for wrong in (lambda: ss.open_run(tmp_path), lambda: main(["merge", str(tmp_path), "--out", str(tmp_path / "w")])):
        try:
            assert wrong() == 2
        except ss.errors.SceneError as error:
            assert "holds an expectation" in str(error)


def test_a_damaged_part_is_drawn_anew(model, tmp_path):
    asked = {**PLACE, **STEADY, "abs": 2e-2, "method": "plain", "out": tmp_path}
    whole = ss.expect(model, "q**2", **asked)
    part = shards(tmp_path, "units")[0]
    content = bytearray(part.read_bytes())
    content[200] ^= 1
    part.write_bytes(content)
    again = ss.expect(model, "q**2", **asked)
    assert again.value == whole.value and part.with_suffix(".damaged").exists()


def test_while_others_draw_a_part_later_ones_are_drawn_here(tmp_path, monkeypatch):
    """Another process holds the first part, for three checks; meanwhile the second and third are drawn here."""
    refused, drawn = [], []
    with in_folder(tmp_path, Watch(None, False)) as store:
        claim = store.folder.claim

        def not_the_first(piece):
            if piece.first == 0 and len(refused) < 3:
                refused.append(piece.name)
                return False
            return claim(piece)

        def draw(first, count):
            drawn.append(first)
            return Drawn(Tally.of(np.full(count, float(first))), 0.5, 0, count)

        monkeypatch.setattr(store.folder, "claim", not_the_first)
        monkeypatch.setattr(draw_store, "_ELSEWHERE", 0.01)
        parts = [store.part("units", first, 10, 30 - first, draw) for first in (0, 10, 20)]
    assert [part.units.mean for part in parts] == [0.0, 10.0, 20.0]
    assert drawn == [10, 20, 0] and len(refused) == 3
    assert store.seconds == 0.0  # this process drew all parts
    with in_folder(tmp_path, Watch(None, False)) as other:
        other.part("units", 0, 10, 30, draw)
        assert other.seconds == 0.5


def test_no_part_is_begun_when_the_time_is_over_but_the_least(tmp_path):
    watch = Watch(1e-9, False)
    with in_folder(tmp_path, watch) as store:
        drawn = store.part("units", 0, 1, 9, lambda first, count: Drawn(Tally.of(np.ones(1)), 0.0, 0, 1))
        assert drawn.units.n == 1
        assert store.part("units", 2, 1, 9, lambda first, count: None) is None


def test_parts_are_long_enough_for_a_file_and_short_enough_to_lose():
    """If the work takes a second, a part takes half a second; if the work takes an hour, a part takes ten seconds;
    parts are multiples of one computation."""
    store = InFolder(None, None)
    assert store.grain(256, 10**6, -1.0) == 256
    assert store.grain(256, 10**6, 1e-6) == 0.5e6 // 256 * 256
    assert store.grain(256, 10**9, 3.6e-6) == 10 / 3.6e-6 // 256 * 256
    assert store.grain(1, 16, 40.0) == 1
    assert store.grain(256, 10**6, 0.0) > 10**8  # this unit is too short for the clock


SCENE = """[model]
name = "synchrotron"
sigma1 = 0.8
sigma2 = 0.5
[run]
step = 0.1
steps = 20
q0 = 1.0
p0 = 0.0
threads = 1
[expect]
f = "q**2"
abs = 3e-3
scheme = "lobatto2_swapped"
method = "plain"
"""


#: a command whose parts have one call each, so that there are several parts on any machine
COMMAND = """
import sys
from symsde.answers.expectation import draw_store
from symsde.cli.command_line import main
draw_store._SHORTEST = draw_store._LONGEST = 0.0
sys.exit(main(sys.argv[1:]))
"""


def test_a_killed_command_goes_on(tmp_path):
    """kill -9 when the third part gets its name; the same command keeps the parts and reaches the interval asked
    for."""
    scene, out = tmp_path / "scene.toml", tmp_path / "out"
    scene.write_text(SCENE)
    given = ["expect", scene, "--out", out, "--quiet"]
    begun = subprocess.run(words(signal.SIGKILL, 3, "shards/units-", PLACED, COMMAND, *given), check=False)
    assert begun.returncode == -signal.SIGKILL
    there = {path: path.read_bytes() for path in shards(out, "units")}
    assert len(there) == 2
    command = [sys.executable, "-c", COMMAND, *map(str, given)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert all(path.read_bytes() == content for path, content in there.items())
    low, high = (float(x) for x in done.stdout.split("[")[1].rstrip("]\n").split(","))
    assert 3e-3 * 2.1 > high - low > 0 and abs((low + high) / 2 - 0.9995) < 8e-3
    assert not list((out / "shards").glob(".*"))  # no unfinished file


MLMC = """
import sys, symsde as ss
model = ss.models.synchrotron(omega=2.0, sigma1=0.8, sigma2=0.5)
found = ss.mlmc(model, "q**2", q0=1.0, p0=0.0, horizon=2.0, abs=4e-3, scheme="midpoint", threads=1, out=sys.argv[1])
print(found.value.hex(), found.reached)
"""


def test_multilevel_by_itself_goes_on_after_a_kill(tmp_path):
    """After kill -9, sent when a second part gets its name, existing parts stay unchanged, and the value is that of an
    undisturbed process."""
    begun, whole = tmp_path / "begun", tmp_path / "whole"
    killed = subprocess.run(words(signal.SIGKILL, 2, "shards/level-", PLACED, MLMC, begun), check=False)
    assert killed.returncode == -signal.SIGKILL
    there = {path: path.read_bytes() for path in shards(begun, "level")}
    assert len(there) == 1
    told = []
    for out in (begun, whole):
        done = subprocess.run([sys.executable, "-c", MLMC, str(out)], capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        told.append(done.stdout.split())
    assert all(path.read_bytes() == content for path, content in there.items())
    assert len(shards(begun, "level")) > len(there)
    assert told[0][1] == told[1][1] == "True"
    assert abs(float.fromhex(told[0][0]) - float.fromhex(told[1][0])) < 8e-3


def test_the_command_says_how_to_go_on(tmp_path, capsys):
    scene, out = tmp_path / "scene.toml", tmp_path / "out"
    scene.write_text(SCENE.replace('f = "q**2"', 'f = ["q", "p"]'))
    arguments = ["expect", str(scene), "--out", str(out), "--quiet", "--abs", "0.004"]
    assert main([*arguments, "--max-time", "1e-9"]) == 4
    said = capsys.readouterr().err
    assert "resume with" in said and f"--out {out} --abs 0.004" in said
    assert main(arguments) == 0
    assert (out / "mean-1" / "answer.json").exists() and (out / "mean-2" / "answer.json").exists()
    values = [json.loads((out / f"mean-{i}" / "answer.json").read_text())["value"] for i in (1, 2)]
    printed = [float(line.split("=")[1].split("[")[0]) for line in capsys.readouterr().out.splitlines()]
    assert np.allclose(values, printed, rtol=1e-11)


def test_claims_of_parts_are_by_name(tmp_path):
    """Two parts have two locks."""
    with in_folder(tmp_path, Watch(None, False)) as store:
        names = [draw_store.Piece(f"units-{i:012d}-5", "draws", i, 5, 5) for i in range(50)]
        assert len({store.folder._number(piece) for piece in names}) == 50
        assert isinstance(store.folder, RunFolder) and math.isfinite(store.folder._number(names[0]))


def test_parts_are_read_as_they_were_written():
    tallies = [Tally(7, 0.1, 2.0, -3.0, 5.0), Tally(8, 1.1, 2.5, 3.5, 4.5), Tally(9, -1.0, 0.0, 0.25, 0.5)]
    for part in (Drawn(tallies[0], 0.25, 2, 18), draw_store.Draw(*tallies, 0.5, 3)):
        assert draw_store._part_of(draw_store._shard_of(part, "me")) == part


def test_processes_share_a_folder(tmp_path):
    """Two processes at once print the same bits from parts drawn by either; every unit exists once."""
    scene, out = tmp_path / "scene.toml", tmp_path / "out"
    scene.write_text(SCENE)
    command = [sys.executable, "-c", COMMAND, "expect", str(scene), "--out", str(out), "--quiet"]
    both = [subprocess.Popen(command, stdout=subprocess.PIPE, text=True) for _ in range(2)]
    said = [process.communicate()[0] for process in both]
    assert [process.returncode for process in both] == [0, 0] and said[0] == said[1] != ""
    parts = [read(path) for path in shards(out, "units")]
    assert 1 <= len({part.facts["by"] for part in parts}) <= 2
    paths = json.loads((out / "answer.json").read_text())["paths"]
    assert 0 < paths <= sum(part.arrays["tallies"][0][0] for part in parts)


@pytest.mark.filterwarnings("ignore::symsde.BudgetWarning")
def test_multilevel_by_itself_goes_on(model, tmp_path, monkeypatch):
    """Stopped after its first levels, continued, and then read: existing parts stay, the bits are the same, and nothing
    is drawn twice. The folder is refused to mlmc with other options, to expect, and to open_run."""
    asked = {**PLACE, "scheme": "gauss_dkdkd", "threads": 1, "abs": 4e-3, "out": tmp_path}
    first = ss.mlmc(model, "q**2", **asked, max_time=1e-9)
    there = {path: path.read_bytes() for path in shards(tmp_path, "level")}
    assert not first.reached and there
    whole = ss.mlmc(model, "q**2", **asked)
    assert whole.reached and all(path.read_bytes() == content for path, content in there.items())
    assert sum(x.paths for x in whole.levels) > sum(x.paths for x in first.levels)
    found = sum(int(read(path).arrays["tallies"][0][0]) for path in shards(tmp_path, "level"))
    assert found == sum(x.paths for x in whole.levels)
    drawn = LevelSampler(make_problem(model, "q**2", **PLACE), "gauss_dkdkd", whole.levels[0].steps)
    for i, level in enumerate(whole.levels):
        assert level.mean == pytest.approx(drawn.draw(i, level.paths).difference.mean, rel=1e-12)

    def no_more(*_, **__):
        raise AssertionError("drawn again")

    monkeypatch.setattr(LevelSampler, "_pair", no_more)
    again = ss.mlmc(model, "q**2", **asked)
    assert (again.value, again.interval, again.cost > 0) == (whole.value, whole.interval, True)
    for change in ({"first": 2048}, {"antithetic": True, "scheme": "midpoint"}, {"abs": 3e-3}, {"levels": 11}):
        with pytest.raises(ss.errors.SceneError, match="holds another run"):
            ss.mlmc(model, "q**2", **{**asked, **change})
    with pytest.raises(ss.errors.SceneError, match="holds another run"):
        ss.expect(model, "q**2", **{**asked, "method": "multilevel"})
    with pytest.raises(ss.errors.SceneError, match=r"call of `symsde\.mlmc`"):
        ss.open_run(tmp_path)


@pytest.mark.parametrize(
    ("name", "other"),
    [("steps", 16), ("levels", 11), ("first", 32), ("antithetic", True), ("scheme", "gauss2"), ("seed", 2),
     ("abs", 0.6), ("horizon", 1.5), ("q0", 1.5), ("p0", 0.5), ("t0", 0.5)],
)  # fmt: skip
def test_multilevel_draws_of_another_call_are_another_run(name, other, tmp_path):
    """Each input is changed alone, so that none is hidden behind another."""
    asked = {**PLACE, "scheme": "midpoint", "steps": 8, "first": 16, "abs": 0.5, "seed": 1, "out": tmp_path}
    model = ss.models.linear_oscillator()
    ss.mlmc(model, "q**2", **asked)
    with pytest.raises(ss.errors.SceneError, match="holds another run"):
        ss.mlmc(model, "q**2", **{**asked, name: other})


@pytest.mark.parametrize(
    ("name", "other"),
    [("t0", 0.5), ("correction", "none"), ("truncation", (3.0, 50.0)), ("areas", "law"), ("area_time", 2.0),
     ("damping_noise", "path"), ("compensated", True)],
)  # fmt: skip
def test_draws_with_other_options_are_another_run(name, other, tmp_path):
    asked = {**PLACE, **STEADY, "abs": 0.1, "method": "plain", "out": tmp_path}
    kubo = ss.models.kubo()
    ss.expect(kubo, "q", **asked)
    with pytest.raises(ValueError, match=rf"holds another run: expect\.{name} = "):
        ss.expect(kubo, "q", **asked, **{name: other})
