# SPDX-License-Identifier: BSD-3-Clause
"""Moments that go on from kept last states: every array and fact of their shards is that of one run of the whole."""

import json
import shutil

import numpy as np
import pytest
import symsde as ss
from symsde.batch import longer
from symsde.batch.folder import RunFolder
from symsde.cli import command_line
from test_growth import counted  # noqa: F401  (a fixture)

SCENE = """
[model]
{model}
[run]
step = {step}
steps = {steps}
{save}
paths = {paths}
seed = 3
first_path = 512
{run}
[output]
keep_last = {keep}
{more}
"""
START = 'q0 = {law = "normal", mean = 0.5, sd = 0.2}\np0 = 0.1\n'
GIVEN = {
    "model": 'name = "kubo"',
    "steps": 20,
    "paths": 1000,
    "run": START,
    "keep": "true",
    "more": "",
    "step": 0.05,
    "save": "save_every = 10",
}
OBSERVED = """
[observables]
r = "q_1**2 + p_1**2"
[[observe]]
kind = "histogram"
of = "q_1"
low = -3
high = 3
[[observe]]
kind = "quantiles"
of = "r"
[[observe]]
kind = "covariance"
of = ["q_1", "r"]
[[observe]]
kind = "paths"
paths = [515, 900, 1500]
"""
EXTREMES = '[[observe]]\nkind = "extremes"\nof = "q_1"\n'
#: the force is no number beyond q = 2, where paths fail
FAILING = {
    "model": 'H = "p**2/2 + q**2/2 + sqrt(2 - q)/10"\nnoise = ["9*q/20"]',
    "run": 'q0 = {law = "normal", sd = 0.3}\np0 = 0.1\nscheme = "stormer_verlet"',
    "step": 0.1,
}
#: paths over the saddles of a cubic potential grow beyond all bounds
GROWING = {
    "model": 'name = "henon_heiles"',
    "run": 'q0 = {law = "normal", sd = 0.5}\np0 = 0.1\nscheme = "stormer_verlet"',
    "step": 0.1,
}


def write(**given):
    """Write the scene."""
    with open("scene.toml", "w", encoding="utf-8") as file:
        file.write(SCENE.format(**(GIVEN | given)))


def go(*arguments, out="out", size="256"):
    """Run the scene in a folder."""
    return command_line.main(["run", "scene.toml", "--out", out, "--shard-paths", size, "--quiet", *arguments])


def shards(folder, kind="moments"):
    """Arrays and facts of the shards of a folder, by name, without the stamps of its run."""
    found = {}
    for path in sorted(folder.glob(f"shards/{kind}-*.npz")):
        with np.load(path) as data:
            arrays = {name: data[name] for name in data.files}
        facts = json.loads(str(arrays.pop("facts")))
        found[path.name] = arrays, {key: x for key, x in facts.items() if key != "run"}
    return found


def require_whole(folder, **given):
    """Require the shards of one run of the whole, bit for bit, and nothing else beside them."""
    write(**given)
    shutil.rmtree("whole", ignore_errors=True)
    code = go(out="whole")
    mine, theirs = shards(folder, "*"), shards(folder.parent / "whole", "*")
    assert list(mine) == list(theirs) and mine
    for name, (arrays, facts) in mine.items():
        told = theirs[name][1]
        # Functionals of the path need normals beyond the ends of a part.
        assert facts["counters"].pop("normals", 0) >= told["counters"].pop("normals", 0)
        assert facts == told
        assert arrays.keys() == theirs[name][0].keys()
        for key, x in arrays.items():
            np.testing.assert_array_equal(x, theirs[name][0][key], err_msg=f"{name} {key}")
    assert {x.name for x in (folder / "shards").iterdir()} == set(mine)
    return code


@pytest.fixture(autouse=True)
def place(tmp_path, monkeypatch):
    """Work in a folder of the test."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


KINDS = {
    "plain": {},
    "compensated": {"run": START + "compensated = true"},
    "implicit": {"model": 'name = "henon_heiles"', "run": START + 'scheme = "gauss2"'},
    "areas": {"model": 'name = "synchrotron"', "run": START + 'scheme = "midpoint_areas"\nrefine = -1'},
    "observed": {"more": OBSERVED},
    "damped": {
        "model": 'name = "synchrotron"\ndamping = 0.4',
        "run": START + 'scheme = "gauss_dkdkd"\nt0 = 0.3\nfirst_step = 7',
    },
    "groups": {"model": 'name = "kubo"\na = {from = 0.5, to = 2.0, count = 5}', "more": OBSERVED},
    "one state": {"run": "q0 = 0.7\np0 = -0.2"},
    "at rest": {"model": 'name = "synchrotron"', "run": "q0 = 0.0\np0 = 0.0"},
}


@pytest.mark.parametrize("given", KINDS.values(), ids=KINDS)
def test_the_shards_of_one_run(place, counted, given):  # noqa: F811
    """Takes the later steps alone, twice, and its shards are those of one run."""
    write(**given)
    assert go() == 0
    assert counted["moments"] == 1000 * 20
    for steps in (50, 60):
        assert go("--steps", f"{steps}") == 0
        assert counted["moments"] == 1000 * steps
    assert require_whole(place / "out", **given, steps=60) == 0


def test_more_paths_and_steps(place, counted):  # noqa: F811
    """New paths begin at the start, those of a shard that was not full, too; the others go on."""
    write()
    assert go() == 0
    assert go("--steps", "40", "--paths", "2000") == 0
    full = 1000 // 256 * 256
    assert counted["moments"] == 1000 * 20 + full * 20 + (2000 - full) * 40
    require_whole(place / "out", steps=40, paths=2000)


def failed(folder):
    """How many paths of each shard have failed."""
    found = shards(folder).values()
    assert all(np.count_nonzero(arrays["status"]) == facts["failed"] for arrays, facts in found)
    return np.array([facts["failed"] for _, facts in found])


def test_failing_paths(place, counted, capfd):  # noqa: F811
    """Paths that fail on the way are those of one run; shards with failed paths are computed anew."""
    write(**FAILING)
    assert go() == command_line.OK
    assert go("--steps", "30") == 3
    taken = shards(place / "out")
    assert counted["moments"] == sum(facts["counters"]["path_steps"] for _, facts in taken.values())
    assert list(failed(place / "out") > 0) == [True, False, False, True]
    assert require_whole(place / "out", **FAILING, steps=30) == 3
    counted["moments"] = 0
    assert go("--steps", "60") == 3
    whole = [facts["counters"]["path_steps"] for _, facts in shards(place / "out").values()]
    there = [0 if facts["failed"] else facts["counters"]["path_steps"] for _, facts in taken.values()]
    assert counted["moments"] == sum(whole) - sum(there)
    assert require_whole(place / "out", **FAILING, steps=60) == 3


def test_growing_paths(place, counted):  # noqa: F811
    """A shard in which a path may have grown 1e6-fold is computed anew: only one run of the whole can tell."""
    write(**GROWING)
    assert go() == command_line.OK
    assert go("--steps", "40") == 3
    grown = [facts["grown"] for _, facts in shards(place / "out").values()]
    assert sum(grown) > 0 and counted["moments"] > 1000 * 40
    assert require_whole(place / "out", **GROWING, steps=40) == 3


def test_it_says_what_it_keeps(place, counted, capfd):  # noqa: F811
    """Says beforehand whether moments go on; a folder that keeps last states goes on with that without the flag."""
    write(keep="false", steps=20)
    assert go("--keep-last") == 0
    write(keep="false", steps=40)
    assert go() == command_line.BAD_INPUT
    goes_on = "moments go on from the last states of their shards, those with failed paths are computed anew"
    assert f"or give --grow, which adds what is more: {goes_on}" in capfd.readouterr().err
    assert command_line.main(["run", "scene.toml", "--out", "out", "--grow"]) == 0
    left = "0 of 4 shards are there, the others take about 2e+04 path-steps"
    assert f"grows from 20 to 40 steps: {goes_on}; {left}" in capfd.readouterr().err
    assert counted["moments"] == 1000 * 40
    write(keep="false", steps=40, more=EXTREMES)
    assert go("--grow") == 0
    assert counted["moments"] == 2 * 1000 * 40
    write(keep="false", steps=50, more=EXTREMES)
    assert command_line.main(["run", "scene.toml", "--out", "out", "--grow"]) == 0
    assert "grows from 40 to 50 steps: moments of all paths are computed anew" in capfd.readouterr().err
    assert counted["moments"] == 1000 * (2 * 40 + 50)


def test_keeping_begins_later(place, counted, capfd):  # noqa: F811
    """Shards that are there stay without last states, and are computed anew for more steps; new ones go on."""
    write(keep="false")
    assert go() == 0
    assert command_line.main(["run", "scene.toml", "--out", "out", "--keep-last", "--paths", "1536"]) == 0
    assert "shards of moments that are there are kept as they are, without last states" in capfd.readouterr().err
    assert counted["moments"] == 1000 * 20 + (1536 - 3 * 256) * 20
    assert go("--paths", "1536", "--steps", "40") == 0
    assert counted["moments"] == 1000 * 20 + (1536 - 3 * 256) * 40 + 3 * 256 * 40
    require_whole(place / "out", paths=1536, steps=40)


def test_keeping_asks_for_nothing_else(capfd):
    """The flag lets a folder keep last states, and not grow by what the scene has changed."""
    write(keep="false")
    assert go() == 0
    write(keep="false", more=EXTREMES)
    assert go("--keep-last") == command_line.BAD_INPUT
    assert "moments of all paths are computed anew" in capfd.readouterr().err
    write(keep="false", steps=30)
    assert go("--keep-last") == command_line.BAD_INPUT
    write()
    assert go() == 0


def test_refusals(capfd):
    """Refuses what keeps no moments, and other values than true and false."""
    write(more="moments = false\npaths = [600]")
    assert go() == command_line.BAD_INPUT
    assert "keep_last keeps the last states of moments, and [output] has moments = false" in capfd.readouterr().err
    write(keep="1")
    assert go() == command_line.BAD_INPUT
    assert "[output] keep_last = 1: give true or false" in capfd.readouterr().err


def test_interrupted(place, counted, monkeypatch):  # noqa: F811
    """Goes on after an end between any two shards, and grows again from a folder whose growth was not finished."""
    write()
    assert go() == 0
    shutil.copytree("out", "before")

    class EndedError(Exception):
        """As if the process had been killed."""

    written = RunFolder.write
    for left in range(4):
        shutil.rmtree("out")
        shutil.copytree("before", "out")
        counted["moments"], done = 0, []

        def write_some(self, piece, shard, done=done, left=left):
            if len(done) == left:
                raise EndedError
            done.append(piece)
            written(self, piece, shard)

        with monkeypatch.context() as patched:
            patched.setattr(RunFolder, "write", write_some)
            with pytest.raises(EndedError):
                go("--steps", "40")
        counted["moments"] = 0
        steps = 40 if left < 2 else 60
        assert go("--steps", f"{steps}") == 0
        paths = sum(piece.paths for piece in done)
        assert counted["moments"] == 1000 * (steps - 20) - paths * 20
        require_whole(place / "out", steps=steps)
        write()


def test_parts_that_grew_are_merged(place, counted):  # noqa: F811
    """Merges parts that went on to the shards of one run, which go on from there."""
    write()
    for steps in (20, 40):
        for part in ("1", "2"):
            assert go("--shard", f"{part}/2", "--steps", f"{steps}", out=f"part-{part}") == 0
    assert counted["moments"] == 1000 * 40
    assert command_line.main(["merge", "part-1", "part-2", "--out", "out", "--quiet"]) == 0
    assert go("--steps", "60") == 0
    assert counted["moments"] == 1000 * 60
    require_whole(place / "out", steps=60)


def test_states_of_another_run_are_not_taken(place, counted, monkeypatch):  # noqa: F811
    """Last states that do not give the last row of their shard are not gone on from."""
    write()
    assert go() == 0
    options_from = longer.options_from

    def a_little_beside(options, state):
        here = options_from(options, state)
        return {**here, "q0": np.nextafter(here["q0"], 9)}

    monkeypatch.setattr(longer, "options_from", a_little_beside)
    assert go("--steps", "40") == 0
    assert counted["moments"] == 1000 * (20 + 20 + 40)
    monkeypatch.undo()
    monkeypatch.chdir(place)
    require_whole(place / "out", steps=40)


def test_what_it_takes(place, capfd):
    """A dry run counts the states, and open_run reads such a folder."""
    sizes = []
    for keep in ("false", "true"):
        write(keep=keep, run=START + "compensated = true", paths=2**20)
        assert command_line.main(["run", "scene.toml", "--out", keep, "--dry-run"]) == 0
        sizes.append(float(capfd.readouterr().out.partition("disk")[2].split()[1]))
    assert sizes == pytest.approx([sizes[0], 2**20 * 36 / 1e6], rel=0.05)
    write()
    assert go() == 0
    assert ss.open_run("out").moments.n_ok[-1] == 1000


def test_later_times_of_a_list(place, counted, capfd):  # noqa: F811
    """Times after the end of a run go on from there, of moments and of saved paths; others are computed anew."""

    def given(*times, steps, **others):
        run = f"{START}save_at = {[0.05, 0.2, 0.5, *times]}"
        return {"run": run, "steps": steps, "save": "", "more": "paths = [600, 700]", **others}

    first, second, third = given(0.9, steps=20), given(0.9, 1.05, 1.5, steps=30), given(0.9, 1.05, 1.5, steps=40)
    write(**first)
    assert go() == 0
    for chosen in (second, third):
        write(**chosen)
        assert go("--grow") == 0
    assert counted == {"moments": 1000 * 40, "simulate": 2 * 40}
    require_whole(place / "out", **third)
    # Another time in the list of the third run; one after that list, but before the end of this run.
    for finer, steps in ((given(0.9, 1.0, 1.5, 2.2, steps=50), 50), (given(0.9, 1.0, 1.5, 2.2, 2.3, steps=55), 55)):
        write(**finer)
        counted.update(moments=0, simulate=0)
        assert go() == command_line.BAD_INPUT
        assert "moments of all paths are computed anew, saved paths are computed anew" in capfd.readouterr().err
        assert go("--grow") == 0
        assert counted == {"moments": 1000 * steps, "simulate": 2 * steps}
        require_whole(place / "out", **finer)


def test_groups_of_unequal_times(place, counted, capfd):  # noqa: F811
    """Groups are collected at the common divisor of the times, which changes: all paths are computed anew."""
    how = {"model": KINDS["groups"]["model"], "save": ""}
    write(run=START + "save_at = [0.2, 1.0]", **how)
    assert go() == 0
    more = {"run": START + "save_at = [0.2, 1.0, 1.25]", "steps": 25, **how}
    write(**more)
    assert go() == command_line.BAD_INPUT
    assert "moments of all paths are computed anew" in capfd.readouterr().err
    assert go("--grow") == 0
    assert counted["moments"] == 1000 * 45
    require_whole(place / "out", **more)
