# SPDX-License-Identifier: BSD-3-Clause
"""Pages of the site are true: the table of schemes is current and names the cheapest measured points."""

import inspect
import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest
import symsde as ss

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT / "docs"), str(ROOT / "docs" / "site"), str(ROOT / "bench")]
import c_reference  # noqa: E402
import drawings  # noqa: E402
import first_screen  # noqa: E402
import fortran_reference  # noqa: E402
import notebook  # noqa: E402
import plain  # noqa: E402
import python_reference  # noqa: E402
import typeset  # noqa: E402
import which_scheme  # noqa: E402
from symsde.answers.advice import advise  # noqa: E402
from symsde.batch import scene  # noqa: E402
from symsde.model.formulas import formula_scenes  # noqa: E402


def test_which_scheme_is_current():
    for name, page in (("which-scheme", which_scheme.page), ("which-scheme-tables", which_scheme.tables)):
        committed = (ROOT / "docs" / f"{name}.md").read_text(encoding="utf-8")
        assert committed == page(), "docs/generate.py writes it again"


@pytest.mark.parametrize("data", sorted(which_scheme.FIGURES.glob("work-precision-*.json")), ids=lambda path: path.stem)
def test_the_table_names_the_cheapest_points(data):
    """Every cell of the table agrees with the rows of the measurement, searched in another way."""
    study = json.loads(data.read_text(encoding="utf-8"))
    page = (ROOT / "docs" / "which-scheme-tables.md").read_text(encoding="utf-8")
    row = next(line for line in page.splitlines() if f"| {study['name']}, to $t = " in line)
    for tolerance, cell in zip(which_scheme.TOLERANCES, row.strip("|").split(" | ")[2:], strict=True):
        assert f"(work-precision-tables.md#{study['name']})" in cell
        good = [
            (r["seconds"], r["scheme"], r["h"])
            for r in study["rows"]
            if r["status"] == "ok" and r["err_strong_high"] <= tolerance and ss.schemes.get(r["scheme"]).info.symplectic
        ]
        if not good:
            assert "[-]" in cell
            continue
        seconds, scheme, h = min(good)
        assert f"[{scheme}, h = {h:.3g}, {1e6 * seconds:.3g} us]" in cell


def test_the_first_screen_says_what_was_measured():
    """The picture asks the questions of the table, and each scheme is the fastest in the table of measurements."""
    assert json.loads((which_scheme.FIGURES / "which-scheme.json").read_text()) == which_scheme.picture()
    tables = (ROOT / "docs" / "which-scheme-tables.md").read_text(encoding="utf-8").splitlines()
    cells = {line.split(" | ")[1].partition(",")[0]: line.split(" | ")[2:] for line in tables if ", to $t = " in line}
    assert which_scheme.FIRST[0][2] in cells["noncommutative_oscillator"][1]
    assert "[gauss2," in cells["kubo"][1] and "[chin4a," in cells["synchrotron"][2]
    assert sum("[stormer_verlet," in row[0] for row in cells.values()) > len(cells) / 2


def test_the_page_of_performance_says_what_its_tables_say():
    """The page agrees with its data, and every number of its picture is in a row of the tables."""
    tables, page = ((ROOT / f"docs/performance{x}.md").read_text(encoding="utf-8") for x in ("-tables", ""))
    data = json.loads((which_scheme.FIGURES / "performance.json").read_text(encoding="utf-8"))
    assert page == first_screen.page(data, tables)
    assert "In a run of 32 paths, a step of one path takes 0.94 to 6.7 ns" in page and "334 of 357 are met" in page
    rows = [[cell.strip() for cell in line.split("|")] for line in tables.splitlines()]
    words = {"few1": "1 path", "few32": "32 paths"}
    for row in data["rows"]:
        found = next(cells for cells in rows if cells[1:3] == [words[row["group"]], row["scene"]])
        assert [float(cell) for cell in found[3:5]] == row["times"]
    loops = [{"group": row["group"], "name": row["scene"], "numbers": [*row["times"], 1.0]} for row in data["rows"]]
    assert first_screen.rows(loops) == data["rows"] and first_screen.rows(loops[1:]) is None
    assert data["brought"] == first_screen.brought(tables) and len(data["brought"]) == len(first_screen.SCENES)
    assert data["brought"][0] == {"scene": "double well", "times": [0.298, 2.35, 33.0]}  # a row of the tables


@pytest.mark.parametrize("page", drawings.BANDS)
def test_pictures_of_pages_show_what_their_code_computes(page):
    """The code run again on any build gives the picture's numbers to a tenth of its bands, or to 1 %."""
    pytest.importorskip("sympy"), pytest.importorskip("matplotlib")
    kept = json.loads((which_scheme.FIGURES / f"{page}.json").read_text(encoding="utf-8"))["panels"]
    for found, panel in zip(drawings.bands(page)["panels"], kept, strict=True):
        np.testing.assert_allclose(found["x"], panel["x"], rtol=1e-5)
        allowed = np.maximum(np.abs(panel["y"]) / 100, np.array(panel["error"] or 0.0) / 10)
        assert (np.abs(np.subtract(found["y"], panel["y"])) <= allowed + 1e-12).all() and found["law"] == panel["law"]


def unexplained(text):
    """Words whose first occurrence in the prose of a page is not linked to the page of words."""
    for pattern in (
        r"```.*?^```$",
        r"(?<=\n\n)(?: {4}.*\n+)+",
        r"`[^`]*`",
        r"<!--.*?-->",
        r"^#.*$",
        r"^\|.*$",
        r"^:::.*$",
    ):
        text = re.sub(pattern, "", text, flags=re.M | re.S if ".*?" in pattern else re.M)
    for word in ("lane", "trait", "certificate"):
        first = re.search(rf"\b{word}s?\b(?!\))", text, re.I)
        if first and not re.match(rf"\*?\]\((?:docs/|\.\./)?words\.md#{word}\)", text[first.end() :]):
            yield word


@pytest.mark.parametrize(
    "page",
    [ROOT / "README.md", *(ROOT / "docs").glob("*.md"), *(ROOT / "docs/method").glob("*.md")],
    ids=lambda x: x.stem,
)
def test_words_of_the_project_are_explained_where_they_first_stand(page):
    if page.stem != "words":
        assert not list(unexplained(page.read_text(encoding="utf-8")))
    assert list(unexplained("It has\nlanes, a [trait](words.md#trait), `certificate`.")) == ["lane"]


def test_the_notebook_of_the_project_is_current():
    assert notebook.TARGET.read_text(encoding="utf-8") == notebook.notebook(), "docs/generate.py writes it again"


def test_the_page_of_scenes_explains_every_key():
    page = (ROOT / "docs" / "scenes.md").read_text(encoding="utf-8")
    words = set(re.findall(r"`(\w+)", page))
    for keys in (scene.RUN_KEYS, scene.OUTPUT_KEYS, scene.STUDY_KEYS, scene.EXPECT_KEYS, formula_scenes.KEYS):
        assert set(keys) - words <= {"q", "p", "t"}, set(keys) - words


def test_every_scheme_has_a_use():
    text = (ROOT / "docs" / "which-scheme-tables.md").read_text(encoding="utf-8")
    page = text.partition("## Every scheme in a line")[2]
    for name in ss.schemes.names():
        assert page.count(f"| `{name}` |") == 1, name
    assert set(which_scheme.USE) <= {*ss.schemes.names(), "dirk:0.25", "lambda:0.3"}


def test_explicit_uses_are_explicit():
    """Schemes that a line calls explicit need no solver for separable models; schemes that it gives to expectations
    alone claim no strong order.
    """
    for name, text in which_scheme.USE.items():
        info = ss.schemes.get(name).info
        if "explicit" in text:
            assert info.explicit_for != "never", name
        if "no paths" in text:
            assert not any(info.orders[kind].value for kind in ("additive", "commutative", "general")), name
        assert ("not symplectic" in text) == (not info.symplectic), name


def test_candidates_are_those_of_advise():
    assert advise.scheme_names(ss.models.kubo()) == ["midpoint", "stormer_verlet", "gauss2", "gauss3"]
    assert "midpoint_areas" in advise.scheme_names(ss.models.noncommutative_oscillator())


def test_the_python_reference_holds_every_public_name(monkeypatch):
    page = python_reference.page()
    for name in ss.__all__:
        assert name in python_reference.SKIPPED or page.count(f":: symsde.{name}\n") == 1, name
    for name, members in python_reference.INTERNAL.items():
        entry = page.partition(f":: symsde.{name}\n")[2].partition("```")[0]
        assert f":exclude-members: {', '.join(members)}\n" in entry, name
        assert all(hasattr(getattr(ss, name), x) or x in inspect.getsource(getattr(ss, name)) for x in members)
    monkeypatch.setattr(ss, "__all__", [*ss.__all__, "simulated"])
    monkeypatch.setattr(ss, "simulated", ss.simulate, raising=False)
    assert "## Further" in python_reference.page()


def test_the_c_reference_holds_every_function():
    header = (ROOT / "include" / "symsde.h").read_text(encoding="utf-8")
    page = c_reference.page(header)
    names = re.findall(r"^int (symsde_\w+)\(", header, re.M)
    assert len(names) > 50
    for name in names:
        heading, _, rest = page.partition(f"`{name}`")[2].partition("```c\n")
        assert f"int {name}(" in rest.partition("```")[0], (name, heading)
    with pytest.raises(ValueError, match="symsde_lost has no heading"):
        c_reference.page(header.replace("#ifndef SYMSDE_H", "int symsde_lost(void);\n#ifndef SYMSDE_H", 1))


def test_the_cpp_reference_names_what_the_headers_have():
    headers = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "include").rglob("*.hpp"))
    named = set(re.findall(r"^\| .*$", page := (ROOT / "docs/site/cpp.md").read_text(encoding="utf-8"), re.M))
    table = set(re.findall(r"symsde::(\w+)", "".join(line.split("|")[1] for line in named)))
    outside = re.sub(r"namespace detail \{.*?\} // namespace detail", "", headers, flags=re.S)
    classes = set(re.findall(r"^(?:class|struct) (\w+)", outside, re.M)) - {"span", "rows"}
    functions = set(re.findall(r"^(?:\[\[nodiscard\]\] )?inline [\w:<>]+ (\w+)\(", outside, re.M))
    assert table >= classes and functions - table == {"check"} and "`symsde::check(" in page
    assert all(re.search(rf"\b{name}\b", headers) for name in table)


def test_the_fortran_reference_holds_what_the_facade_brings():
    page = fortran_reference.page(ROOT)
    facade = (ROOT / "src" / "symsde.f90").read_text(encoding="utf-8").partition("\nmodule symsde\n")[2]
    names = re.sub(r"!.*|&\s*", "", ", ".join(re.findall(r"only: ((?:.*&\n)*.*)", facade)))
    public = {name.partition("=>")[0].strip() for name in names.split(",")} - {""}
    assert len(public) > 100
    for name in public:
        assert (f"### `{name}`\n" in page) != (f"\n| `{name}` | `" in page), name
    assert (
        "| `status_singular` | `2` | singular linear system |" in page
        and "### `status_" not in page.partition("### `status_text`")[2]
    )
    simulate = page.partition("### `simulate`")[2].partition("###")[0]
    assert "Integrate all paths and save them" in simulate and "q0(:), p0(:)" in simulate and "recorder" not in simulate


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("H_k = sigma1 sin q, where q moves.", r"$H_k = \sigma_1\,\sin q$, where $q$ moves."),
        ("dq = H_p dt + sum_k H_{k,p} o dW_k", r"$dq = H_p\,dt + \sum_k H_{k,p} \circ dW_k$"),
        ("a bias c1 h^a + c2 h^-2.", r"a bias $c_1 h^a + c_2 h^{-2}$."),
        ("(E |z|^2 <= 4 sqrt(2 pi), see (24))", r"($\mathbb E\,\vert z\vert^2 \le 4\,\sqrt{2 \pi}$, see (24))"),
        ("all {H_k,H_l} at omega h = 3 a step turns", r"all $\lbrace H_k, H_l\rbrace$ at $\omega h = 3$ a step turns"),
        ("H = p.M^-1 p/2 + U(q) grows by exp(-gamma t)", r"$H = p\cdot M^{-1} p/2 + U(q)$ grows by $\exp(-\gamma t)$"),
        ("**0.2 (h = 0.1)** in a step", r"**0.2 $(h = 0.1)$** in a step"),
        ("-q, +-1e-3 h", r"$-q$, $\pm 10^{-3} h$"),
    ],
)
def test_formulas_are_typeset(text, shown):
    assert typeset.typeset(text) == shown and typeset.typeset(shown) == shown


@pytest.mark.parametrize(
    "text",
    [
        "a C program, e.g. in 2.5 s with n = many, (a) or i.e. x86-64",
        "`p^2` and [step, h = 2](page.md#p^2) and q0, p0, save_every",
        "the sum of a log, 1e-3 to 5.2e+43 us, 10 % in 4 steps (24) - 25",
    ],
)
def test_what_is_no_formula_stays(text):
    assert typeset.typeset(text) == text


def test_formulas_of_a_page_stay_within_their_cells_and_items():
    page = "# With h\n\n- p +\n- q\n\n| h | = q |\n\n    p^2\n\n```\np^2\n```\nfrom p^2 +\nq^2 on\n"
    shown = "# With h\n\n- $p$ +\n- $q$\n\n| $h$ | = $q$ |\n\n    p^2\n\n```\np^2\n```\nfrom $p^2 + q^2$ on\n"
    assert typeset.markdown(page) == shown
    assert typeset.linked("[WHSB] (3)-(4), (5)", "map.md") == "[[WHSB] (3)-(4)](map.md#eq-3), (5)"
    with pytest.raises(ValueError, match="not known"):
        typeset.tex("p ~ q")


def test_plain_text_becomes_markup():
    text = "One *star* and `code_`, H_k.\n\n    a = show(c)\n\n- first\n  more\n- q, p: second\n\n    a = b q  (so)"
    rest = plain.as_rest(text)
    assert "One \\*star\\* and ``code_``, :math:`H_k`." in rest and "::\n\n        a = show(c)" in rest
    assert "- first\n  more\n- ``q``, ``p``: second" in rest and ".. math::\n\n    a = b q \\qquad \\text{(so)}" in rest
    page = plain.as_markdown(text)
    assert "```text\n    a = show(c)\n```" in page and "\\*star\\* and `code_`, $H_k$" in page and "$$\na = b q" in page
    assert "(3) <../paper-map.html#eq-3>`__" in plain.as_rest("see [WHSB] (3)")
    assert "[[WHSB] (3)](../paper-map.md#eq-3)" in plain.as_markdown("see [WHSB] (3)")
