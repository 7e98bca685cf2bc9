# SPDX-License-Identifier: BSD-3-Clause
"""Every number of a study, its file, table, page and figure, computed a second time by other means."""

import csv
import math
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import symsde as ss
from symsde.answers import coupled_errors
from symsde.answers.expectation.interval import quantile
from symsde.studies.study import orders, study_figure, study_page, study_words, table

STUDENT = 2.0930240544082634  # 97.5 % quantile of Student's t with 19 degrees of freedom
GIVEN = {"q0": [0.4], "p0": 0.3, "t0": 0.5, "horizon": 1.0, "steps": [4, 8, 16], "paths": 120, "seed": 5}
GIVEN |= {"schemes": ["midpoint", "heun"], "reference": "gauss2_strong32", "reference_steps": 128, "repeats": 5}
INVARIANTS = {"one": lambda q, p: q[0] + 2.0, "two": lambda q, p: p[0] ** 2 + q[0] ** 2}


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    """A saved study of a model without exact solution, with invariants."""
    out = tmp_path_factory.mktemp("study")
    found = ss.work_precision(ss.models.synchrotron(), invariants=INVARIANTS, out=out, name="mine", **GIVEN)
    found_out = SimpleNamespace(study=found, out=out)
    assert [(row["scheme"], row["steps"]) for row in found.rows] == [
        (s, n) for s in GIVEN["schemes"] for n in (4, 8, 16)
    ]
    return found_out


def end(scheme, steps):
    """Final state of one run on the common paths, drawn at 128 steps."""
    refine = int(math.log2(128 // steps))
    common = {key: GIVEN[key] for key in ("q0", "p0", "t0", "paths", "seed")}
    run = ss.simulate(ss.models.synchrotron(), scheme=scheme, step=1 / steps, steps=steps, refine=refine, **common)
    return run.q[-1], run.p[-1]


@pytest.fixture(scope="module")
def by_hand():
    """The errors of each point by their definitions."""
    model = ss.models.synchrotron()
    fine, half = end("gauss2_strong32", 128), end("gauss2_strong32", 64)
    own = math.sqrt(np.mean((fine[0] - half[0]) ** 2 + (fine[1] - half[1]) ** 2))
    size = math.sqrt(np.mean(fine[0] ** 2 + fine[1] ** 2))
    rows = {}
    for scheme in GIVEN["schemes"]:
        for steps in GIVEN["steps"]:
            q, p = end(scheme, steps)
            square = ((q - fine[0]) ** 2 + (p - fine[1]) ** 2)[0]
            error = math.sqrt(square.mean())
            half_width = quantile(120) * square.std(ddof=1) / math.sqrt(120) / (2 * error)  # error of a square root
            energies = [x[1] ** 2 / 2 - 4 * np.cos(x[0]) for x in ((q, p), fine)]
            weak = {"q": q - fine[0], "p": p - fine[1], "H": energies[0] - energies[1]}
            changes = [(f(q, p) - f(np.array([0.4]), np.array([0.3]))) / f(np.array([0.4]), np.array([0.3]))
                       for f in INVARIANTS.values()]  # fmt: skip
            row = {"h": 1 / steps, "err_strong": error, "err_strong_low": max(0, error - half_width)}
            row |= {"err_strong_high": error + half_width, "size": size, "ref_error": own, "failed": 0, "paths": 120}
            row |= {f"weak_{name}": x.mean() for name, x in weak.items()}
            row |= {f"weak_{name}_ci": quantile(120) * x.std(ddof=1) / math.sqrt(120) for name, x in weak.items()}
            row["drift"] = max(math.sqrt(np.mean(x**2)) for x in changes)
            row["batches"] = square.reshape(20, 6).mean(axis=1)
            rows[scheme, steps] = row
    assert model.value(0.4, 0.3) == pytest.approx(0.3**2 / 2 - 4 * math.cos(0.4))
    return rows


def test_errors_by_their_definitions(result, by_hand):
    for row in result.study.rows:
        for name, value in by_hand[row["scheme"], row["steps"]].items():
            np.testing.assert_allclose(row[name], value, rtol=1e-7, atol=1e-13, err_msg=f"{name} of {row['scheme']}")
        assert row["reference"] == "gauss2_strong32, 128 steps" and row["scene"] == "mine" and row["status"] == "ok"


def test_orders_by_their_definition(result, by_hand):
    x = np.log([1 / n for n in GIVEN["steps"]])
    for scheme in GIVEN["schemes"]:
        points = [by_hand[scheme, n] for n in GIVEN["steps"]]
        slopes = [np.polyfit(x, np.log(np.sqrt([row["batches"][i] for row in points])), 1)[0] for i in range(20)]
        order = result.study.orders[scheme]
        assert order.value == pytest.approx(
            np.polyfit(x, np.log([row["err_strong"] for row in points]), 1)[0], rel=1e-6
        )
        assert order.half == pytest.approx(STUDENT * np.std(slopes, ddof=1) / math.sqrt(20), rel=1e-4)
        assert order.points == 3


@pytest.mark.parametrize(("factor", "holds"), [(1.0, True), (1.3, False), (1 / 1.3, False)])
def test_intervals_of_orders_cover_what_they_say(factor, holds, monkeypatch):
    """2000 made-up studies of order 1: 0.95 +- 0.03 of the intervals contain it.

    A standard error is half a per cent, and the skewness of logarithms adds one per cent; false alarms below 1e-4.
    """
    monkeypatch.setattr(orders, "quantile", lambda units: factor * quantile(units))
    chance = np.random.default_rng(7)
    held = 0
    for _ in range(2000):
        rows = []
        for k in range(4):
            square = 4.0**-k * chance.chisquare(2, 20 * 50) / 2
            batches = square.reshape(20, 50).mean(axis=1)
            rows.append(
                {"status": "ok", "h": 2.0**-k, "err_strong": math.sqrt(square.mean()), "batches": list(batches)}
            )
        order = orders.fitted(rows)
        held += abs(order.value - 1) <= order.half
    assert (abs(held / 2000 - 0.95) < 0.03) == holds


def made_up(levels, plateau, **changed):
    """Rows of order 2 down to a plateau, whose points are far off the line."""
    rows = []
    for k in range(levels):
        error = max(0.1 * 4.0**-k, plateau)
        row = {
            "h": 2.0**-k,
            "err_strong": error,
            "batches": [error**2] * 20,
            "size": 1.0,
            "failed": 0,
            "ref_error": 0.0,
        }
        rows.append(row | changed)
        rows[-1]["status"] = orders.judge(rows[-1])
    return rows


@pytest.mark.parametrize(
    ("changed", "status"),
    [({"ref_error": 2e-4}, "reference"), ({"size": 1e9}, "rounding"), ({"size": 1e-6}, "diverged")],
)
def test_plateaus_are_left_out_of_slopes(changed, status):
    """Six points fall with order 2, four lie on a plateau; least squares over all would give 1.2."""
    rows = made_up(10, 5e-4)
    assert {row["status"] for row in rows} == {"ok"}
    everything = orders.fitted(rows).value
    assert everything < 1.4
    for row in rows[4:]:
        row.update(changed)
        row["status"] = orders.judge(row)
        assert row["status"] == status
    assert orders.fitted(rows).value == pytest.approx(2) and orders.fitted(rows).points == 4


@pytest.mark.parametrize(
    ("row", "status"),
    [
        ({"err_strong": 0.1, "size": 1.0, "ref_error": 0.0249}, "ok"),
        ({"err_strong": 0.1, "size": 1.0, "ref_error": 0.0251}, "reference"),
        ({"err_strong": 0.499, "size": 1.0}, "ok"),
        ({"err_strong": 0.501, "size": 1.0}, "saturated"),
        ({"err_strong": 99.0, "size": 1.0}, "saturated"),
        ({"err_strong": 101.0, "size": 1.0}, "diverged"),
        ({"err_strong": math.nan, "size": 1.0}, "diverged"),
        ({"err_strong": 1.1e-11, "size": 1.0}, "ok"),
        ({"err_strong": 0.9e-11, "size": 1.0}, "rounding"),
        ({"err_strong": 0.1, "size": 1.0, "failed": 1}, "failed"),
        ({"size": 1.0}, "failed"),
    ],
)
def test_what_a_point_is_worth(row, status):
    assert orders.judge({"failed": 0, "ref_error": 0.0, **row}) == status


def test_the_front_is_what_nothing_beats(result):
    rows = result.study.rows
    for row in rows:
        beaten = any(other["seconds"] <= row["seconds"] and other["err_strong"] < row["err_strong"] for other in rows)
        assert row["pareto"] == (not beaten)


def read(out):
    lines = (out / "work-precision.csv").read_text().splitlines()
    return list(csv.DictReader(line for line in lines if not line.startswith("#")))


def test_the_file_holds_every_number(result):
    found = read(result.out)
    assert len(found) == len(result.study.rows) == 6
    for cells, row in zip(found, result.study.rows, strict=True):
        assert list(cells) == list(table.COLUMNS)
        for name, cell in cells.items():
            value = row[name]
            if isinstance(value, str):
                assert cell == value, name
            else:
                assert float(cell) == float(value), name


def cell(text):
    """A number in a table; per cents are divided by 100."""
    return None if text == "-" else float(text.rstrip("%"))


def test_two_references_are_told_apart(result):
    """The reference for schemes of higher order is finer, and the heading names the reference of each scheme."""
    names = [f"chin4a_strong2, {n} steps" for n in (1024, 8192)]
    rows = [{**row, "reference": names[i > 0]} for i, row in enumerate(result.study.rows)]
    head = str(replace(result.study, rows=rows)).partition("\n")[0]
    assert head.endswith(f"against {names[0]} and, for schemes of nearly its order, {names[1]}")


def test_the_table_on_the_terminal(result):
    lines = str(result.study).splitlines()
    assert lines[0].startswith(
        "mine: synchrotron(omega=2, sigma1=0.2, sigma2=0.1) to t = 1, 120 paths, against gauss2_st"
    )
    names = ["scheme", "h", "strong error", "95 %", "E q error", "+-", "E H error", "+-", "drift", "s/path", "+-",
             "grad", "hess", "iter", "norm"]  # fmt: skip
    assert re.split(r"\s{2,}", lines[1].strip()) == names
    shown = [line[2:] for line in lines[3:] if " order " not in line]
    fitted = dict(zip(GIVEN["schemes"], [line.split("order ")[1] for line in lines if " order " in line], strict=True))
    for line, row in zip(shown, result.study.rows, strict=True):
        assert (line[0] == "*") == row["pareto"]
        scheme, *cells = line[1:].split()
        half = 100 * (row["err_strong_high"] - row["err_strong_low"]) / 2 / row["err_strong"]
        spread = 100 * (row["seconds_high"] - row["seconds_low"]) / 2 / row["seconds"]
        expected = [row["h"], row["err_strong"], half, row["weak_q"], row["weak_q_ci"], row["weak_H"], row["weak_H_ci"]]
        expected += [row["drift"], row["seconds"], spread]
        expected += [row[name] for name in ("gradients", "hessians", "iterations", "normals")]
        assert scheme == row["scheme"]
        for text, value in zip(cells, expected, strict=True):
            assert cell(text) == pytest.approx(value, rel=0.06, abs=0.51 if "%" in text else 0), (line, text, value)
    for scheme, text in fitted.items():
        order = result.study.orders[scheme]
        assert text == f"{order.value:.2f} +- {order.half:.2f}"


def test_marks_in_the_table():
    row = {"scheme": "a", "h": 0.5, "status": "failed", "failed": 3, "pareto": False}
    assert table.cells(row) == ["  a", "0.5", *["-"] * 13, "FAILED: 3 paths"]
    assert table.cells({**row, "status": "saturated", "pareto": True})[::15] == ["* a", "(saturated)"]
    assert table.terminal([row], {"a": "none"}).splitlines()[-1] == "    order none"


def cost_row(scheme, h, error, seconds, **more):
    common = {"err_strong": error, "err_strong_low": 0.9 * error, "err_strong_high": 1.1 * error, "seconds": seconds}
    return {"scheme": scheme, "h": h, "status": "ok", "pareto": False, "failed": 0, **common, **more}


MADE_UP = [
    cost_row("midpoint", 0.1, 8e-3, 2.5e-6), cost_row("midpoint", 0.01, 8e-4, 25e-6),
    cost_row("gauss2", 0.2, 8e-3, 7.5e-6), cost_row("gauss2", 0.02, 8e-5, 75e-6),
    cost_row("heun", 0.05, 5e-3, 1.25e-6), cost_row("midpoint", 0.4, 2e-2, 1e-6),
]  # fmt: skip


def test_the_words_give_the_numbers():
    said = study_words.paragraph(MADE_UP)
    first = (
        "For an error of 0.01 use heun at h = 0.05: 1.25 microseconds a path, 2.0 times less than midpoint at h = 0.1."
    )
    assert first in said
    second = (
        "For an error of 0.001 use midpoint at h = 0.01: 25 microseconds a path, 3.0 times less than gauss2 at h = "
    )
    assert second + "0.02." in said
    assert "For an error of 0.0001 use gauss2 at h = 0.02: 75 microseconds a path; no other scheme reaches it" in said


def test_words_of_ties_failures_and_invariants():
    rows = [cost_row("midpoint", 0.1, 8e-3, 2.5e-6, drift=1e-13), cost_row("gauss2", 0.1, 8e-3, 2.8e-6, drift=3e-4)]
    rows += [cost_row("heun", h, 9e9, 1e-6, status="diverged") for h in (0.4, 0.2)]
    said = study_words.paragraph(rows)
    assert "2.5 microseconds a path; gauss2 costs the same within 15 %." in said
    assert "Paths fail or diverge with heun down to h = 0.2." in said
    assert "The invariant is kept to rounding by midpoint, and at worst changed by gauss2 by 3e-04." in said
    assert study_words.paragraph([{**rows[2]}]).startswith("No point of this study has an error that can be trusted")


def test_only_upper_ends_count_as_reached():
    rows = [cost_row("midpoint", 0.1, 9.5e-3, 1e-6), cost_row("gauss2", 0.1, 2e-3, 5e-6)]  # 9.5e-3 + 10 % is above 0.01
    assert [row["scheme"] for row in study_words.cheapest(rows, 0.01)] == ["gauss2"]
    assert [row["scheme"] for row in study_words.cheapest(rows, 0.0105)] == ["midpoint", "gauss2"]
    assert len(study_words.cheapest(rows, rows[0]["err_strong_high"])) == 2  # an error equal to the goal is reached


def test_the_table_of_the_page(result):
    head, _, *lines = study_page._table(result.study).splitlines()
    heads = [text.strip() for text in head.strip("|").split("|")]
    for line in lines:
        cells = dict(zip(heads, [text.strip() for text in line.strip("|").split("|")], strict=True))
        rows = [row for row in result.study.rows if row["scheme"] == cells["scheme"]]
        fine, coarse = rows[-1], rows[0]
        assert cells["slope"] == str(result.study.orders[cells["scheme"]])
        assert float(cells["ns a step"]) == pytest.approx(1e9 * fine["seconds"] / 16, rel=6e-3)
        for name, key in (("gradients", "gradients"), ("Hessians", "hessians"), ("iterations", "iterations"),
                          ("normals", "normals")):  # fmt: skip
            assert float(cells[name]) == pytest.approx(fine[key], rel=6e-3), name
        assert float(cells["worst drift"]) == pytest.approx(max(row["drift"] for row in rows), rel=0.6)
        weak, width, h = re.fullmatch(r"(\S+) \+- (\S+) \(h = (\S+)\)", cells["E H error"]).groups()
        assert float(weak) == pytest.approx(coarse["weak_H"], rel=0.06) and float(h) == coarse["h"]
        assert float(width) == pytest.approx(coarse["weak_H_ci"], rel=0.6)
        assert cells["failed"] == "0 of 3"
        for name in heads:
            if name.startswith("us to "):
                goal = float(name.removeprefix("us to "))
                reached = [row for row in rows if row["err_strong_high"] <= goal]
                if not reached:
                    assert cells[name] == "-"
                    continue
                best = min(reached, key=lambda row: row["seconds"])
                micro, h = re.fullmatch(r"\**(\S+) \(h = ([\d.]+)\)\**", cells[name]).groups()
                assert float(micro) == pytest.approx(1e6 * best["seconds"], rel=6e-3)
                assert float(h) == pytest.approx(best["h"], rel=6e-3)
                others = [row["seconds"] for row in result.study.rows if row["err_strong_high"] <= goal]
                assert cells[name].startswith("**") == (best["seconds"] == min(others))


def test_what_is_drawn(result):
    figures = pytest.importorskip("matplotlib.figure")
    left, right = figures.Figure().subplots(1, 2)
    study_figure.draw(result.study, left, right)
    floor = result.study.rows[0]["ref_error"]
    for axis, x in ((left, "seconds"), (right, "h")):
        assert len(axis.containers) == 2
        for bars, scheme in zip(axis.containers, GIVEN["schemes"], strict=True):
            rows = [row for row in result.study.rows if row["scheme"] == scheme]
            np.testing.assert_array_equal(bars[0].get_xdata(), [row[x] for row in rows])
            np.testing.assert_array_equal(bars[0].get_ydata(), [row["err_strong"] for row in rows])
            ends = np.array(bars[2][-1].get_segments())  # bars of the errors
            np.testing.assert_allclose(ends[:, 0, 1], [row["err_strong_low"] for row in rows], rtol=1e-12)
            np.testing.assert_allclose(ends[:, 1, 1], [row["err_strong_high"] for row in rows], rtol=1e-12)
            if x == "seconds":
                assert bars.get_label() == f"{scheme}, slope {result.study.orders[scheme].value:.2f}"
                across = np.array(bars[2][0].get_segments())
                np.testing.assert_allclose(across[:, 0, 0], [row["seconds_low"] for row in rows], rtol=1e-12)
                np.testing.assert_allclose(across[:, 1, 0], [row["seconds_high"] for row in rows], rtol=1e-12)
        assert floor in [line.get_ydata()[0] for line in axis.lines if len(line.get_ydata())]
    (front,) = [line for line in left.lines if line.get_label() == "best"]
    best = sorted((row["seconds"], row["err_strong"]) for row in result.study.rows if row["pareto"])
    np.testing.assert_array_equal(np.transpose([front.get_xdata(), front.get_ydata()]), best)
    assert front.get_drawstyle() == "steps-post"  # the front stays level until a better point
    assert left.get_xlabel() == "run time of a path [s]" and right.get_xlabel() == "step $h$"


def test_weak_errors_are_drawn_and_hollow_where_they_may_be_zero(result):
    """The largest error of E q, E p and E H of every point; an error that may be zero is a hollow point, with only an
    upper bar."""
    figures = pytest.importorskip("matplotlib.figure")
    made = [cost_row("a", 1.0, 0.2, 1.0, weak_q=-0.3, weak_q_ci=0.1, weak_p=0.2, weak_p_ci=0.01),
            cost_row("a", 0.5, 0.1, 2.0, weak_q=0.01, weak_q_ci=0.03, weak_p=0.0, weak_p_ci=0.2),
            cost_row("a", 0.2, 0.1, 3.0),
            cost_row("a", 2.0, 9.0, 0.5, status="diverged", weak_q=9.0, weak_q_ci=1.0)]  # fmt: skip
    for x, place in (("seconds", 0), ("h", 1)):
        axes = figures.Figure().subplots(1, 2)
        study_figure.draw_weak(SimpleNamespace(schemes=["a"], rows=made), *axes)
        (bars,) = axes[place].containers
        assert list(bars[0].get_xdata()) == [row[x] for row in made[:2]] and list(bars[0].get_ydata()) == [0.3, 0.01]
        np.testing.assert_allclose(np.array(bars[2][0].get_segments())[:, :, 1], [[0.2, 0.4], [0.01, 0.04]])
        (hollow,) = [line for line in axes[place].lines if line.get_markerfacecolor() == "white"]
        assert list(hollow.get_xdata()) == [made[1][x]]
        axes = figures.Figure().subplots(1, 2)
        study_figure.draw_weak(result.study, *axes)
        for bars, scheme in zip(axes[place].containers, GIVEN["schemes"], strict=True):
            rows = [row for row in result.study.rows if row["scheme"] == scheme]
            largest = [max(abs(row[f"weak_{name}"]) for name in "qpH") for row in rows]
            np.testing.assert_array_equal(bars[0].get_ydata(), largest)
            np.testing.assert_array_equal(bars[0].get_xdata(), [row[x] for row in rows])


def test_weak_errors_stand_below_strong_ones(result):
    pytest.importorskip("matplotlib")
    over, under = np.reshape(study_figure.plot(result.study).axes[:4], (2, 2))
    for above, below in zip(over, under, strict=True):
        assert below.get_xlabel() == above.get_xlabel() and below.get_xlim() == above.get_xlim()


def test_plateaus_are_hollow_and_failures_crossed():
    figures = pytest.importorskip("matplotlib.figure")
    rows = [cost_row("a", 1.0, 0.2, 1.0), cost_row("a", 0.5, 0.1, 2.0, status="reference"),
            cost_row("a", 2.0, 9.0, 0.5, status="diverged")]  # fmt: skip
    for row in rows:
        row |= {"seconds_low": row["seconds"], "seconds_high": row["seconds"], "ref_error": 0.0}
    study_ = SimpleNamespace(schemes=["a"], rows=rows, orders={"a": orders.Order(math.nan, math.nan, 1)})
    left, right = figures.Figure().subplots(1, 2)
    study_figure.draw(study_, left, right)
    (bars,) = right.containers
    assert list(bars[0].get_xdata()) == [1.0, 0.5]
    (hollow,) = [line for line in right.lines if line.get_markerfacecolor() == "white"]
    assert (list(hollow.get_xdata()), list(hollow.get_ydata())) == ([0.5], [0.1])
    (cross,) = [line for line in right.lines if line.get_marker() == "x"]
    assert list(cross.get_xdata()) == [2.0]


def test_drift_is_of_energy_where_every_noise_keeps_it():
    assert coupled_errors.conserves_energy(ss.models.kubo(), [0.0])
    for model in (
        ss.models.linear_oscillator(),
        ss.models.synchrotron(),
        ss.models.henon_heiles(),
        ss.models.pendulum(),
    ):
        assert not coupled_errors.conserves_energy(model, [0.0])
    assert coupled_errors.conserves_energy(ss.models.linear_oscillator(sigma=0.0), [0.0])
    without = ss.Model(ndof=1, nnoise=0, gradient=lambda t, w, q, p: (w[0] * q, w[0] * p))
    assert not coupled_errors.conserves_energy(without, [0.0])
    found = ss.work_precision(ss.models.kubo(), q0=1.0, p0=0.5, schemes=["heun"], steps=[4, 8], paths=60)
    for row, steps in zip(found.rows, (4, 8), strict=True):
        run = ss.simulate(ss.models.kubo(), scheme="heun", q0=1.0, p0=0.5, step=1 / steps, steps=steps, paths=60,
                          refine=int(math.log2(8 // steps)))  # fmt: skip
        change = (run.q[-1] ** 2 + run.p[-1] ** 2) / (1 + 0.25) - 1
        assert row["drift"] == pytest.approx(math.sqrt(np.mean(change**2)), rel=1e-9)


def driven(t, w, q, p):
    return w[0] * (q + np.sin(3 * t)), w[0] * p


def driven_value(t, w, q, p):
    return (w[0] * (p**2 / 2 + q**2 / 2 + q * np.sin(3 * t)))[0]


def test_energy_that_depends_on_time_is_taken_at_the_end():
    """H = p^2/2 + q^2/2 + q sin 3t without noise: not an invariant, so its error is taken at t0 + horizon."""
    model = ss.Model(ndof=1, nnoise=0, gradient=driven, value=driven_value, separable=True)
    assert coupled_errors.conserves_energy(model, [0.7]) and not coupled_errors.conserves_energy(model, [0.7, 1.2])
    given = {"q0": 0.0, "p0": 0.3, "t0": 0.7, "horizon": 0.5}
    found = ss.work_precision(model, schemes=["midpoint"], steps=[2, 4], paths=60, **given)
    assert found.rows[0]["drift"] is None
    runs = [ss.simulate(model, q0=0.0, p0=0.3, t0=0.7, step=0.5 / n, steps=n, scheme=scheme)
            for n, scheme in ((2, "midpoint"), (4096, "gauss2"))]  # fmt: skip
    energies = [driven_value(1.2, np.ones((1, 1)), run.q[-1], run.p[-1])[0] for run in runs]
    assert found.rows[0]["weak_H"] == pytest.approx(energies[0] - energies[1], rel=1e-4)
    assert abs(energies[0] - energies[1]) > 1e-4


def test_numbers_of_numpy_are_written_as_numbers(tmp_path):
    row = {"scheme": "a", "drift": np.float64(0.25), "pareto": True, "h": 0.1}
    table.write_csv(tmp_path / "x.csv", [row], {"model": "toy"})
    assert (tmp_path / "x.csv").read_text().startswith("# model: toy\n# date: ")
    (last,) = csv.DictReader(line for line in (tmp_path / "x.csv").read_text().splitlines() if not line.startswith("#"))
    assert (last["scheme"], last["drift"], last["pareto"], last["h"], last["weak_q"]) == ("a", "0.25", "1", "0.1", "")
