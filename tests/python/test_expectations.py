# SPDX-License-Identifier: BSD-3-Clause
"""Tests of the expectations behind reports: every check with values just inside and just outside its bound; tables and
pages as text."""

import json
import math
import os

import numpy as np
import pytest
from symsde import errors
from symsde.show import tables
from symsde.studies import expectations, pages
from symsde.studies.expectations import Check, Expectations

E = 0.1  # a standard error

JUDGED = [  # kind, passing arguments, failing arguments, measured, expected
    ("at_most", (1.0, 1.0), (1.001, 1.0), "1.00e+00", "<= 1"),
    ("at_most", (-5.0, 1.5e-7), (math.nan, 1.0), "-5.00e+00", "<= 1.5e-07"),
    ("at_most", (0.5, 1.0), (-math.inf, 1.0), "5.00e-01", "<= 1"),
    ("at_least", (2.0, 2.0), (1.999, 2.0), "2", ">= 2"),
    ("at_least", (3.0, 2.0), (math.nan, 2.0), "3", ">= 2"),
    ("at_least", (2.5, 2.0), (math.inf, 2.0), "2.5", ">= 2"),
    ("between", (1.0, 1.0, 2.0), (0.999, 1.0, 2.0), "1", "1 to 2"),
    ("between", (2.0, 1.0, 2.0), (2.001, 1.0, 2.0), "2", "1 to 2"),
    ("between", (1.5, 1.0, 2.0), (math.nan, 1.0, 2.0), "1.5", "1 to 2"),
    ("near", (1.09, 1.0, 0.1), (1.11, 1.0, 0.1), "1.09", "1 +- 0.1"),
    ("near", (0.91, 1.0, 0.1), (0.89, 1.0, 0.1), "0.91", "1 +- 0.1"),
    ("near", (1.0, 1.0, 0.0), (math.nan, 1.0, 0.1), "1", "1 +- 0"),
    ("within", ((1.48, E), 1.0), ((1.5, E), 1.0), "1.48 +- 0.1", "1 within 4.9 s.e."),
    ("within", ((0.52, E), 1.0), ((0.5, E), 1.0), "0.52 +- 0.1", "1 within 4.9 s.e."),
    ("within", ((1.0, 0.0), 1.0), ((math.nan, E), 1.0), "1 +- 0", "1 within 4.9 s.e."),
    ("within", ((1.2, E), 1.0), ((1.0, math.inf), 1.0), "1.2 +- 0.1", "1 within 4.9 s.e."),
    ("within", ((1.2, E), 1.0), ((1.0, math.nan), 1.0), "1.2 +- 0.1", "1 within 4.9 s.e."),
    ("beyond", ((1.5, E), 1.0), ((1.48, E), 1.0), "1.5 +- 0.1", "not 1, beyond 4.9 s.e."),
    ("beyond", ((0.5, E), 1.0), ((0.52, E), 1.0), "0.5 +- 0.1", "not 1, beyond 4.9 s.e."),
    ("beyond", ((1.6, E), 1.0), ((math.nan, E), 1.0), "1.6 +- 0.1", "not 1, beyond 4.9 s.e."),
    ("fraction", (577, 1000, 0.5), (578, 1000, 0.5), "0.577 +- 0.02", "0.5 within 4.9 s.e."),
    ("fraction", (0, 1000, 0.0), (1, 1000, 0.0), "0 +- 0", "0 within 4.9 s.e."),
    ("same", ("a", "a"), ("b", "a"), "a", "a"),
    ("same", (True, True, "iff x > 1"), (False, True), "yes", "yes (iff x > 1)"),
    ("same", (3, 3), (math.nan, math.nan), "3", "3"),
    ("expect", (7, "odd", True), (8, "odd", np.bool_(False)), "7", "odd"),
]


@pytest.mark.parametrize(("kind", "good", "bad", "measured", "expected"), JUDGED)
def test_judges(kind, good, bad, measured, expected):
    found = Expectations("name", "A title")
    for arguments in (good, bad):
        getattr(found, kind)("a case", "a quantity", *arguments)
    assert found.checks[0] == Check("a case", "a quantity", measured, expected, True)
    assert found.checks[1].passed is False


def test_the_rate_of_false_alarms():
    """The rate for a normal mean, by summing its density."""
    x = np.linspace(4.9, 12, 200_001)
    density = np.exp(-(x**2) / 2) / math.sqrt(2 * math.pi)
    assert pytest.approx(2 * np.trapezoid(density, x), rel=1e-6) == expectations.FALSE_ALARM
    assert round(1 / expectations.FALSE_ALARM, -5) == 1_000_000


@pytest.fixture
def reports():
    good, bad = Expectations("good", "Good"), Expectations("bad", "Bad", if_failed="A known cause.")
    good.at_most("one", "  first", 0.5, 1.0)
    good.report("two", "|second|", "0.25", "0.3")
    bad.same("three", "third", 3, 4)
    return [good, bad]


def test_the_terminal(reports):
    assert expectations.block(reports[0], "case", 1.25).splitlines() == [
        "",
        "Good   [1.2 s]",
        "  case  quantity  measured  expected  verdict",
        "  ----  --------  --------  --------  -------",
        "  one     first   5.00e-01  <= 1      ok",
        "  two   |second|  0.25      0.3       -",
    ]
    assert expectations.block(reports[1], "case", 1.0).splitlines()[-1].split() == [
        "three",
        "third",
        "3",
        "4",
        "FAILED",
    ]
    assert expectations.summary(reports) == ("FAILED Bad: three third: 3, expected 4\n1 expectations met, 1 failed")
    assert [expectations.count(reports, verdict) for verdict in (True, False, None)] == [1, 1, 1]


def test_sections_of_pages(reports):
    head = "| case | quantity | measured | expected | verdict |\n| --- | --- | --- | --- | --- |\n"
    assert expectations.section(reports[0], "case") == (
        f"{head}| one |   first | 5.00e-01 | <= 1 | ok |\n| two | \\|second\\| | 0.25 | 0.3 | - |\n"
    )
    assert (
        expectations.section(reports[1], "case") == f"{head}| three | third | 3 | 4 | **FAILED** |\n\nA known cause.\n"
    )
    reports[1].checks.clear()
    assert "A known cause" not in expectations.section(reports[1], "case")


def test_numbers_end_in_line_and_texts_stand_between():
    shown = tables.terminal(("name", "x"), [["a", "1"], "    between", ["longer", "12.5"]], numbers=[1])
    assert shown.splitlines() == [
        "  name       x", "  ------  ----", "  a          1", "    between", "  longer  12.5",
    ]  # fmt: skip


def test_parts_of_a_page_are_written_whole_with_its_figures(tmp_path, monkeypatch):
    drawn = []
    target = tmp_path / "page.md"
    target.write_text("# By hand\n\n<!-- begin b: written by `x` -->\n\nold\n\n<!-- end b -->\n\nMore by hand.\n")
    page = pages.Page(target, "symsde x")
    shown = page.figure("curve", {"x": np.arange(3), "y": math.inf}, lambda *given: drawn.append(given), "A curve")
    page.put("a", "First.\n", shown)
    page.put("b", pages.wrapped("word " * 40, "  "))
    assert "\n%" not in pages.wrapped("a" * 118 + " 15 % of b")
    page.write()
    first, second = "<!-- begin {}: written by `symsde x` -->", "<!-- end {} -->"
    lines = target.read_text().splitlines()
    assert lines[:4] == ["# By hand", "", first.format("b"), ""] and lines[5].startswith("  word")
    assert lines[6:] == [
        "", second.format("b"), "", "More by hand.", "", first.format("a"), "", "First.", "",
        "![A curve](figures/curve.png)", "", second.format("a"),
    ]  # fmt: skip
    assert max(map(len, lines)) <= 120 and target.read_text() == page.text()
    assert json.loads((tmp_path / "figures" / "curve.json").read_text()) == {"x": [0, 1, 2], "y": None}
    assert drawn[0][0] == tmp_path / "figures" / "curve.png" and drawn[0][1]["y"] == math.inf

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", full)
    page.put("c", "Even more.")
    with pytest.raises(errors.NotWrittenError, match="No space left"):
        page.write()
    assert "Even" not in target.read_text() and sorted(os.listdir(tmp_path)) == ["figures", "page.md"]
