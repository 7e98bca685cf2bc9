# SPDX-License-Identifier: BSD-3-Clause
"""The cost of a study, by a known clock, and studies that continue where an earlier one stopped."""

import json
import re
from types import SimpleNamespace

import numpy as np
import pytest
import symsde as ss
from symsde.answers.error_plan import make_plan
from symsde.studies import study
from symsde.studies.study import study_scenes, timing

GIVEN = {"q0": 1.0, "p0": 0.3, "steps": [4, 8, 16], "horizon": 1.0, "paths": 120, "schemes": ["midpoint", "heun"]}
GIVEN |= {"repeats": 5}


class Clock:
    """A clock that the runs of a plan alone advance."""

    def __init__(self):
        self.now, self.busy = 100.0, 50.0

    def perf_counter(self):
        return self.now

    def process_time(self):
        return self.busy


def test_costs_of_a_machine_that_is_known(monkeypatch):
    """A known machine: a set-up takes 3 s, each path and step 2 ms; repeats are slower by 0, 1, 2, ... %; elapsed
    time is twice the processor time.
    """
    clock, runs = Clock(), []
    plan = make_plan(ss.models.kubo(), **GIVEN)
    monkeypatch.setattr(timing, "time", clock)
    monkeypatch.setattr(timing, "TARGET", 2.0)
    counters = {
        "path_steps": 4000,
        "normals": 4000,
        "gradients": 8000,
        "hessians": 2000,
        "iterations": 6000,
        "solves": 1000,
    }

    def run(scheme, steps, *, shared, paths, threads):
        assert not shared and threads == 1
        runs.append(paths)
        slower = 1 + 0.01 * max(0, len(runs) - 3)  # the first run counts paths, the second warms up
        seconds = 3.0 + 2e-3 * paths * steps * slower
        clock.busy += seconds
        clock.now += 2 * seconds
        return SimpleNamespace(report=SimpleNamespace(threads=1, counters=counters))

    def set_up(scheme, steps, paths):
        clock.busy += 3.0
        clock.now += 3.0

    monkeypatch.setattr(plan, "run", run)
    monkeypatch.setattr(plan, "set_up", set_up)
    found = timing.cost(plan, plan.schemes[0], 4)
    paths = runs[-1]
    assert found["timing_paths"] == paths and found["repeats"] == 5 and found["threads"] == 1
    assert found["seconds"] == pytest.approx(8e-3 * 1.02)
    assert found["seconds_low"] == pytest.approx(8e-3 * 1.01) and found["seconds_high"] == pytest.approx(8e-3 * 1.03)
    assert found["elapsed"] == pytest.approx(2 * (3 / paths + 8e-3 * 1.02))
    expected = {"normals": 1, "gradients": 2, "hessians": 0.5, "iterations": 1.5, "solves": 0.25}
    assert {name: found[name] for name in expected} == expected


def test_number_of_paths_of_a_timed_run(monkeypatch):
    """A timed run takes enough blocks for TARGET seconds, whole blocks, at most 1024."""
    plan = make_plan(ss.models.kubo(), **GIVEN)
    for block_seconds, blocks in ((1e-3, 20), (1.0, 1), (1e-9, 1024)):
        clock = Clock()

        def run(*_, paths, clock=clock, block_seconds=block_seconds, **__):
            clock.busy += block_seconds * paths / 256
            return SimpleNamespace(report=SimpleNamespace(threads=1, counters=dict.fromkeys(
                ("path_steps", *timing.COUNTERS), 1)))  # fmt: skip

        monkeypatch.setattr(timing, "time", clock)
        monkeypatch.setattr(plan, "run", run)
        monkeypatch.setattr(plan, "set_up", lambda *_: None)
        assert timing.cost(plan, plan.schemes[0], 4)["timing_paths"] == 256 * blocks


def test_progress_counts_the_points(capsys, monkeypatch):
    monkeypatch.setattr(study, "cost", lambda *_: {"seconds": 1.0, "seconds_low": 1.0, "seconds_high": 1.0})
    ss.work_precision(model=ss.models.kubo(), **GIVEN | {"steps": [4, 8]}, name="mine", progress=True)
    told = re.findall(r"(\d/\d) mine: (\w+), (\d) steps", capsys.readouterr().err)
    names, steps = ["midpoint", "midpoint", "heun", "heun"], ["4", "8", "4", "8"]
    assert told == list(zip(["1/4", "2/4", "3/4", "4/4"], names, steps, strict=True))


OTHER_STUDIES = [
    {"seed": 6}, {"t0": 0.25}, {"truncation": (4.0, 1.0)}, {"compensated": True}, {"q0": 1.5}, {"p0": 0.1},
    {"paths": 61}, {"horizon": 3.0}, {"repeats": 6}, {"model": ss.models.kubo(sigma=0.2)},
    {"invariants": {"r": lambda q, p: q[0]}}, {"reference": "gauss2_strong32"},
    {"reference": "gauss2_strong32", "reference_steps": 1024},
]  # fmt: skip


@pytest.mark.parametrize("changed", OTHER_STUDIES, ids=" ".join)
def test_a_study_goes_on_only_where_it_is_the_same(changed, tmp_path, monkeypatch):
    """A kept point is used again only if everything that it depends on is the same."""
    monkeypatch.setattr(study, "cost", lambda *_: {"seconds": 1.0, "seconds_low": 1.0, "seconds_high": 1.0})
    monkeypatch.setattr(study.WorkPrecision, "save", lambda *_: None)
    given = {"q0": 1.0, "p0": 0.0, "t0": 0.0, "steps": [4, 8], "paths": 60, "schemes": ["midpoint"], "seed": 5}
    given |= {"model": ss.models.kubo(), "repeats": 5, "name": "mine", "out": tmp_path}
    first = ss.work_precision(**given)
    other = {**given, **changed}
    assert ss.work_precision(**given).resumed == 2
    fresh = ss.work_precision(**other)
    assert fresh.resumed == 0
    assert ss.work_precision(**other).resumed == 2 and ss.work_precision(**given).resumed == 2
    alone = ss.work_precision(**{**other, "out": None})
    assert [row["err_strong"] for row in alone.rows] == [row["err_strong"] for row in fresh.rows]
    if not {"repeats", "invariants", "t0", "truncation"} & set(changed):  # all other changes affect errors
        assert [row["err_strong"] for row in first.rows] != [row["err_strong"] for row in fresh.rows]


def mine(strength: float, **changed) -> ss.Model:
    """A user's model, always with the same name, parameters and traits."""

    def gradient(t, w, q, p):
        return (w[0] + strength * w[1]) * q, w[0] * p

    return ss.Model(**{"ndof": 1, "nnoise": 1, "gradient": gradient, "separable": True, "name": "mine", **changed})


@pytest.mark.parametrize(
    "changed",
    [
        {"model": mine(0.2)},
        {"model": mine(0.1, position_noise=True)},
        {"invariants": {"r": lambda q, p: q[0] + 1}},
        {"schemes": [ss.schemes.from_quadrature([0.5], [1.0], degree=1, name="own")]},
    ],
    ids=["function", "traits", "invariant", "scheme"],
)  # fmt: skip
def test_a_study_knows_functions_apart(changed, tmp_path, monkeypatch):
    """Models, invariants and schemes of users are distinguished by their values, not by their names."""
    monkeypatch.setattr(study, "cost", lambda *_: {"seconds": 1.0, "seconds_low": 1.0, "seconds_high": 1.0})
    monkeypatch.setattr(study.WorkPrecision, "save", lambda *_: None)
    own = ss.schemes.from_quadrature([0.5 - 0.75**0.5 / 3, 0.5 + 0.75**0.5 / 3], [0.5, 0.5], degree=2, name="own")
    given = {"q0": 1.0, "p0": 0.0, "steps": [4, 8], "paths": 60, "schemes": [own], "seed": 5, "repeats": 5}
    given |= {"model": mine(0.1), "name": "mine", "out": tmp_path, "reference": "midpoint"}
    given |= {"invariants": {"r": lambda q, p: q[0]}}
    ss.work_precision(**given)
    assert ss.work_precision(**given).resumed == 2
    assert ss.work_precision(**{**given, **changed}).resumed == 0


@pytest.mark.parametrize("model", [ss.models.kubo(), ss.models.synchrotron()])
def test_a_column_for_each_of_many_paths(model, monkeypatch):
    """There are more paths than a block has; q0 has a column for each path, p0 has one for all."""
    monkeypatch.setattr(timing, "TARGET", 0.0)
    q0 = np.linspace(0.5, 1.0, 300)[np.newaxis]
    found = ss.work_precision(model, q0=q0, p0=0.0, schemes=["midpoint"], steps=[4, 8], paths=300, repeats=5)
    assert [row["timing_paths"] for row in found.rows] == [300, 300] and found.rows[0]["failed"] == 0


def test_invariants_that_are_no_numbers():
    """An invariant that is NaN at the beginning is refused; NaN at the end does not count as conserved."""
    given = {"q0": 1.0, "p0": 0.0, "schemes": ["midpoint"], "steps": [4, 8], "paths": 40, "repeats": 5}
    for function in (lambda q, p: q, lambda q, p: np.log(-q[0]), lambda q, p: q[0] * 1j):
        with (
            pytest.raises(ss.errors.InvalidArgumentError, match="the invariant 'x'"),
            np.errstate(all="ignore"),
        ):
            ss.work_precision(ss.models.kubo(), **given, invariants={"x": function})
    late = {"x": lambda q, p: np.sqrt(q[0] - 0.9), "r": lambda q, p: (q * q + p * p)[0]}
    for invariants in (late, dict(reversed(late.items()))):
        with np.errstate(all="ignore"):
            found = ss.work_precision(ss.models.kubo(), **given, invariants=invariants)
        assert all(np.isnan(row["drift"]) for row in found.rows)
        assert "No scheme keeps the invariant, and at worst changed by midpoint by nan" in found.words()


def test_a_file_of_state_that_cannot_be_read_costs_only_time(tmp_path, monkeypatch):
    monkeypatch.setattr(study, "cost", lambda *_: {"seconds": 1.0, "seconds_low": 1.0, "seconds_high": 1.0})
    monkeypatch.setattr(study.WorkPrecision, "save", lambda *_: None)
    given = {"q0": 1.0, "p0": 0.0, "steps": [4, 8], "paths": 60, "schemes": ["midpoint"], "out": tmp_path}
    state = tmp_path / "state.json"
    for text in ("", "{", "[1]", '"x"', "no rows"):
        known = text == "no rows" and json.dumps(dict.fromkeys(json.loads(state.read_text()), 3))
        state.write_text(known or text)
        assert ss.work_precision(ss.models.kubo(), **given).resumed == 0
        assert ss.work_precision(ss.models.kubo(), **given).resumed == 2


def test_the_error_of_a_reference_is_that_of_the_paths_that_it_follows():
    """Paths of the reference that escape are not compared; if most paths escape, there is no reference."""
    model = ss.models.henon_heiles(sigma1=0.5, sigma2=0.5)
    given = {"q0": 0.2, "p0": 0.0, "steps": [64, 128], "reference": "chin4a", "reference_steps": 512, "paths": 200}
    table = ss.convergence(model, "stormer_verlet", horizon=6.0, **given)
    assert 80 < table.paths < 200 and np.isfinite(table.reference_error)
    with pytest.raises(ss.errors.NumericalError, match="paths fail with the reference"):
        ss.convergence(model, "stormer_verlet", horizon=30.0, **given)


def test_a_scene_with_a_column_for_each_path(tmp_path):
    """The scene and its study use the same initial states."""
    file = tmp_path / "columns.toml"
    text = '[model]\nname = "kubo"\n[run]\nstep = 0.1\nsteps = 8\nq0 = [{}]\np0 = 0.0\npaths = 50\n'
    file.write_text(
        text.format([1.0 + i / 50 for i in range(50)]) + '[study]\nschemes = ["midpoint"]\nsteps = [4, 8]\n'
    )
    found = study_scenes.study(file)
    assert {row["paths"] for row in found.rows} == {50} and found.rows[0]["failed"] == 0
    with pytest.raises(ss.errors.SceneError, match="q0 has shape"):
        study_scenes.study(file, paths=100)


def test_a_scene_that_goes_backward_needs_a_horizon(tmp_path):
    file = tmp_path / "back.toml"
    file.write_text('[model]\nname = "kubo"\n[run]\nstep = -0.1\nsteps = 8\nq0 = 1.0\np0 = 0.0\n')
    with pytest.raises(ss.errors.SceneError, match="goes backward"):
        study_scenes.check(file)
    study_scenes.check(file, horizon=0.8)
    file.write_text(file.read_text() + "fixed_point = 3\n")
    with pytest.raises(ss.errors.SceneError, match=r"fixed_point = 3 of \[run\] would have no effect"):
        study_scenes.check(file, horizon=0.8)


def test_the_table_tells_what_made_it(tmp_path):
    """The table begins with the model, initial states, options and the scene's text."""
    file = tmp_path / "told.toml"
    file.write_text(
        '# one\n[model]\nname = "kubo"\nsigma = 0.3\n[run]\nstep = 0.1\nsteps = 8\nq0 = 1.5\np0 = 0.0\nseed = 9\n'
        '[study]\nschemes = ["midpoint"]\nsteps = [4, 8]\npaths = 50\n'
    )
    study_scenes.study(file, out=tmp_path / "out")
    said = [line[2:] for line in (tmp_path / "out" / "work-precision.csv").read_text().splitlines() if line[0] == "#"]
    told = dict(line.split(": ", 1) for line in said if ": " in line)
    assert (told["model"], told["q0"], told["p0"]) == ("kubo", "[1.5]", "[0.0]")
    assert json.loads(told["parameters"])["sigma"] == 0.3 and json.loads(told["options"])["seed"] == 9
    assert float(told["horizon"]) == pytest.approx(0.8) and told["symsde_version"] == ss.__version__
    text = file.read_text().splitlines()
    at = said.index("scene_text:") + 1
    assert [line[2:] for line in said[at : at + len(text)]] == text


def test_what_is_compared_unless_told(monkeypatch):
    """Schemes may be the second argument; without any, kicks and drifts are included if the model allows them."""
    made = []
    monkeypatch.setattr(study, "_measured", lambda plan, *_: made.append([scheme.name for scheme in plan.schemes]))
    place = {"q0": 0.3, "p0": 0.1, "steps": [4, 8], "paths": 40}
    ss.work_precision(ss.models.kubo(), ["midpoint", "heun"], **place)
    ss.work_precision(ss.models.pendulum(), **place)
    ss.work_precision(ss.models.synchrotron(), **place)
    others = ["midpoint", "symplectic_euler", "stormer_verlet", "gauss2", "heun"]
    assert made == [["midpoint", "heun"], others, [*others, "gauss_dkdkd", "chin4a"]]
