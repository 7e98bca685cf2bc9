# SPDX-License-Identifier: BSD-3-Clause
"""What the page of the benchmark says is what the programs printed: cells, targets and verdicts, on both sides."""

import importlib
import itertools
import json
import math
import sys
from pathlib import Path

import numpy as np
import pytest
import symsde as ss

BENCH = Path(__file__).parents[2] / "bench"


@pytest.fixture
def topics(monkeypatch):
    """The sections, by name; they are a package of the benchmark's own folder."""
    monkeypatch.syspath_prepend(str(BENCH))
    yield lambda name: importlib.import_module(f"topics.{name}")
    for name in [name for name in sys.modules if name.partition(".")[0] == "topics"]:
        del sys.modules[name]


def rows_of(text):
    """Cells of every table of a section, without heads and rules."""
    lines = [[cell.strip() for cell in line.split("|")[1:-1]] for line in text.splitlines() if line.startswith("|")]
    rules = [i for i, cells in enumerate(lines) if set("".join(cells)) == {"-"}]
    return [cells for i, cells in enumerate(lines) if i not in rules and i + 1 not in rules]


def test_targets_have_two_sides(topics):
    tools = topics("tools")
    assert [tools.at_most(x, 1.5) for x in (1.4, 1.5, 1.6)] == [["<= 1.5", x] for x in ("met", "met", "missed")]
    assert [tools.at_least(x, 0.8) for x in (0.7, 0.8, 0.9)] == [[">= 0.8", x] for x in ("missed", "met", "met")]
    assert tools.at_most(1.0, None) == tools.at_most(None, 1.0) == tools.at_least(None, 1.0) == ["", ""]
    assert tools.summary([1.0, 2.0, 9.0, 0.5, 3.0]) == [2.0, 0.5, 9.0]
    assert tools.spread([2.0, 0.5, 9.0]) == "2 (0.5 .. 9)" and tools.spread(None) == "absent, skipped"
    assert tools.table(["a", "bcd"], [["ef", "g"]]) == "| a  | bcd |\n| -- | --- |\n| ef | g   |"


def test_scenes_and_models(topics):
    scene = {"name": "fpu64_midpoint", "library_ns": [10.0, 9.0, 12.0], "limit_ns": [7.5, 7.0, 8.0], "ratio": 1.333,
             "fraction": 0.75, "target": 0.7}  # fmt: skip
    found = rows_of(topics("scenes").section([scene, {**scene, "fraction": 0.65}]))
    assert found[0] == ["fpu64_midpoint", "10 (9 .. 12)", "7.5 (7 .. 8)", "1.33", "0.75", ">= 0.7", "met"]
    assert found[1][4:] == ["0.65", ">= 0.7", "missed"]
    models = topics("models")
    lines = [["model", "henon_heiles", "stormer_verlet", kind, "3.0", "2.5", "4.0", "1.3"] for kind in models.NAMES]
    rows = models.rows_of(lines)
    found = {row[2]: row for row in rows_of(models.section({"Fortran": rows, "Python": []}))}
    assert found["C functions"] == [
        "henon heiles", "stormer verlet", "C functions", "3 (2.5 .. 4)", "1.30", "<= 1.2", "missed"
    ]  # fmt: skip
    assert found["Fortran type"][5:] == ["<= 1.2", "missed"] and found["numba cfunc"][5:] == ["<= 1.5", "met"]
    assert found["C functions, plain"][5:] == ["", ""] and len(found) == len(models.NAMES)


def test_loops_are_judged_by_their_ratio_and_calls_by_their_time(topics):
    rows = [{"group": "few1", "name": "kubo", "target": 1.2, "numbers": [30.0, 20.0, 1.5, 25.0, 1.2]},
            {"group": "few1", "name": "pendulum", "target": 1.2, "numbers": [20.0, 20.0, 1.0]},
            {"group": "call", "name": "step", "target": 40.0, "numbers": [46.0, 1.0, 46.0]},
            {"group": "call", "name": "prepared", "target": 40.0, "numbers": [39.0, 0.5, 78.0]}]  # fmt: skip
    assert rows_of(topics("loops").section(rows)) == [
        ["1 path", "kubo", "30", "20", "1.50", "<= 1.2", "missed", "25", "1.20"],
        ["1 path", "pendulum", "20", "20", "1.00", "<= 1.2", "met", "", ""],
        [topics("loops").GROUPS["call"], "step", "46", "1", "46.00", "<= 40", "missed", "", ""],
        [topics("loops").GROUPS["call"], "prepared", "39", "0.5", "78.00", "<= 40", "met", "", ""],
    ]


def test_a_page_without_loops_says_why(topics, monkeypatch):
    loops = topics("loops")
    for found, words in ((object(), "No row has such a name."), (None, "numba: absent, skipped.")):
        monkeypatch.setattr(loops.importlib.util, "find_spec", lambda name, found=found: found)
        assert loops.section([]).endswith(words)


def test_stages_have_the_target_of_their_step(topics):
    row = {"model": "fpu_chain", "ndof": 16, "ns": 1234.5, "ratio": 5.0, "iterations": 3.04, "lapack": 7}
    found = topics("stages").section({
        "rows": [{**row, "h": h, "scheme": scheme} for scheme in ("gauss2", "lobatto3") for h in (0.1, 5.0)],
        "growth": [{"ndof": n, "scheme": s, "ns": n * t} for n in (8, 16) for s, t in (("midpoint", 1), ("gauss2", 3))],
    })  # fmt: skip
    rows = rows_of(found)
    assert rows[0] == [
        "fpu chain", "16", "0.1", "gauss2", "1.23e+03", "5.00", "3.0", "7", "<= 4", "missed"
    ]  # fmt: skip
    assert [row[-2:] for row in rows[1:4]] == [["<= 8", "met"], ["<= 10", "met"], ["<= 20", "met"]]
    assert "| sites | midpoint | gauss2 |" in found and rows[4:] == [["8", "8", "24"], ["16", "16", "48"]]


def test_calls_from_python(topics):
    numbers = [["call", "simulate", "1.25", "3", "2", "4", "1.75", "1.5", "2.5"],
               ["step", "ss.step", "46"], ["step", "prepared_run.step()", "9.5"],
               ["observed", "moments", "12"], ["observed", "an_observable", "17.7"],
               ["memory", "saved_paths", "800", "1.02"]]  # fmt: skip
    assert rows_of(topics("python_calls").section(numbers)) == [
        ["simulate", "3 (2 .. 4)", "1.75 (1.5 .. 2.5)", "1.250", "<= 1", "missed"],
        ["ss.step", "46.0", "<= 40", "missed"],
        ["prepared run.step()", "9.5", "<= 10", "met"],
        ["moments", "12.0", "", ""],
        ["an observable", "17.7", "<= 17.6", "missed"],
        ["saved paths", "800", "1.020", "<= 1.05", "met"],
    ]


def test_blocks_counters_generators_and_builds(topics):
    kinds = [{"kind": "block", "name": "normal", "values": [2.0, 1.0, 3.0]},
             {"kind": "machine", "name": "triad", "values": [5.0, 4.0, 6.0]}]  # fmt: skip
    text = topics("blocks").section(kinds)
    assert rows_of(text) == [["normal", "2 (1 .. 3)"], ["triad", "5 (4 .. 6)"]]
    assert text.index("normal") < text.index("the machine") < text.index("triad")
    counts = {"claim": "no_normals", "model": "kubo", "scheme": "midpoint", "counts": [0.0, 2.5, 3, 4, 5],
              "verdict": "ok"}  # fmt: skip
    text = topics("counters").section([counts])
    assert rows_of(text) == [["no normals", "kubo", "midpoint", "0", "2.5", "3", "4", "5", "ok"]]
    assert "normals | gradients | Hessians | iterations | solves" in text
    text = topics("generators").section([{"name": "symsde", "block": 256, "ns": [2.0, 1.0, 3.0]},
                                         {"name": "MKL", "block": None, "ns": None}])  # fmt: skip
    assert rows_of(text) == [["symsde", "256", "2 (1 .. 3)"], ["MKL", "", "absent, skipped"]]
    assert text.endswith("absent, skipped.")
    found = {"flags": "-mavx2", "rows": {"Kubo midpoint, path-step": ([1.0, 2.0, 4.0], [2.0, 8.0, 16.0])}}
    assert rows_of(topics("avx2").section(found)) == [
        ["Kubo midpoint, path-step", "2 (1 .. 4)", "8 (2 .. 16)", "4 (2 .. 4)", "<= 2.2", "missed"]
    ]


def test_memory_growth_and_threads(topics):
    found = [{"paths": 100, "steps": 10, "peak_kb": 2048}, {"paths": 1000, "steps": 20, "peak_kb": 2304}]
    text = topics("memory").section(found)
    assert rows_of(text) == [["100", "10", "2.00"], ["1000", "20", "2.25"]]
    assert text.endswith("Largest over least: 1.125; target <= 1.05: missed.")
    assert topics("memory").section(found[:1] * 2).endswith("Largest over least: 1.000; target <= 1.05: met.")
    growth = topics("growth")
    assert growth.slope([(x, 5 * x**1.5) for x in (1, 2, 4, 16)]) == pytest.approx(1.5)
    axis = {"axis": "paths", "scene": "Kubo", "expected": 1.0, "from": 4, "exponent": 1.014,
            "points": [(4, [0.5, 0.4, 0.75])]}  # fmt: skip
    text = growth.section([axis])
    assert rows_of(text) == [["4", "0.5", "0.4", "0.75"]] and "from 4 on: 1.01, expected 1." in text
    run = {"scene": "kubo", "inside": 0.995, "threads": [2e6, 1e6, 3e6], "processes": [4e6, 3e6, 5e6],
           "ratio": [0.5, 0.4, 0.6], "threads_ns": [8.0, 7.0, 9.0], "processes_ns": [7.6, 7.0, 8.0],
           "ns_ratio": [0.95, 0.9, 1.0]}  # fmt: skip
    text = topics("threads").section([run, {**run, "inside": 0.9876}])
    assert rows_of(text)[:2] == [
        ["kubo", "path-steps per microsecond", "2 (1 .. 3)", "4 (3 .. 5)", "0.5 (0.4 .. 0.6)", ">= 0.97", "missed"],
        ["kubo", "ns of processor time", "8 (7 .. 9)", "7.6 (7 .. 8)", "0.95 (0.9 .. 1)", "", ""],
    ]
    assert "for 98.76 % of the time" in text


@pytest.fixture
def script(monkeypatch):
    """A script of the benchmark as a module."""
    monkeypatch.syspath_prepend(str(BENCH))
    yield importlib.import_module
    for name in ("advice", "expect_coverage"):
        sys.modules.pop(name, None)


def test_the_measured_front_by_hand(script):
    """Errors of 1/n^2: a hundredth is kept by 10 steps; 1/25 on the line of logarithms between those measured."""
    advice = script("advice")
    rows = [(2, 1 / 4), (4, 1 / 16), (16, 1 / 256), (32, 1 / 1024)]
    assert [advice.fewest(rows, x) for x in (1.0, 1 / 25, 1 / 100, 1 / 1024)] == [2, 5, 10, 32]
    assert advice.fewest(rows, 1e-4) is None
    assert advice.error_at(rows, 8) == pytest.approx(1 / 64) and advice.error_at(rows, 2) == pytest.approx(1 / 4)
    assert advice.error_at(rows, 33) is advice.error_at(rows, 1) is advice.error_at([], 4) is None
    horizon, points = advice.front("kubo")
    kept = json.loads((BENCH.parent / "docs/figures/work-precision-kubo.json").read_text(encoding="utf-8"))
    assert horizon == kept["horizon"] and all(rows == sorted(rows) for rows in points.values())


def test_means_that_coverage_is_judged_by(script):
    """Each again by another way, to 1e-7 of itself; that of the last scene by paths of another scheme."""
    coverage = script("expect_coverage")
    *known, last = coverage.cases(12)
    for case in known:
        way = next(way for word, way in WAYS.items() if case.name.startswith(word))
        assert case.exact == pytest.approx(way(case), rel=1e-7), case.name
        assert case.known_to == 0
    start = {key: last.start[key] for key in ("q0", "p0")}
    run = ss.simulate(last.model, **start, step=2 / 256, steps=256, save_every=256, paths=2**12, seed=5)
    squares = run.q[-1, 0] ** 2
    error = squares.std() / 2**6
    assert last.known_to == pytest.approx(error, rel=0.1)
    assert abs(squares.mean() - last.exact) < 4.9 * math.hypot(error, last.known_to)


def of_one_turn(case):
    """Kubo's oscillator is turned by t + sigma W: a mean over a normal number."""
    x, weight = np.polynomial.hermite_e.hermegauss(40)
    q = np.cos(2.0 + 0.3 * math.sqrt(2.0) * x)
    return float(weight @ (q if case.f == "q" else q**2) / weight.sum())


def of_a_normal_law(case):
    """Mean and covariance of (q, p) by the field of the noises, turned from every time to the end."""
    s, weight = np.polynomial.legendre.leggauss(40)
    turned = [np.array([[math.cos(x), math.sin(x)], [-math.sin(x), math.cos(x)]]) for x in 1 + s]
    fields = []
    for w in np.eye(case.model.nnoise + 1)[1:]:
        hq, hp = case.model.gradient(np.zeros(1), np.zeros(1), w=w)
        fields.append(np.array([hp.item(), -hq.item()]))
    (qq, _), (_, pp) = sum(w * np.outer(a @ b, a @ b) for w, a in zip(weight, turned, strict=True) for b in fields)
    if callable(case.f):
        return math.erfc((0.5 - math.cos(2)) / math.sqrt(2 * qq)) / 2
    return math.cos(2) ** 2 + qq if case.f == "q**2" else math.sin(2) ** 2 + pp


def of_second_moments(case):
    """The powers of the map of one step, by two powers of the step."""
    found = []
    for steps in (512, 1024, 2048):
        one = ss.mean_square(case.model, "gauss2", step=1 / steps).matrix
        found.append(np.linalg.matrix_power(one, steps)[0, 0])
    once = [2 * fine - coarse for coarse, fine in itertools.pairwise(found)]
    return (4 * once[1] - once[0]) / 3


def of_ito(case):
    """H grows by half the squares of the noises' forces, which do not hang on the state here."""
    model = case.model
    q = np.linspace(-1, 2, model.ndof)[:, np.newaxis]
    forces = [model.gradient(q, 0 * q, w=w)[0] for w in np.eye(model.nnoise + 1)[1:]]
    rate = float(np.square(forces).sum()) / 2
    return float(model.value(*(np.resize(case.start[x], (model.ndof, 1)) for x in ("q0", "p0")))[0]) + 2 * rate


WAYS = {
    "Kubo": of_one_turn,
    "linear": of_a_normal_law,
    "additive": of_a_normal_law,
    "noncommutative": of_second_moments,
    "synchrotron": of_ito,
    "FPU": of_ito,
}
