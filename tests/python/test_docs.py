# SPDX-License-Identifier: BSD-3-Clause
"""The documentation is true: generated pages are current, every code block runs, formulas are those of the library."""

import contextlib
import importlib
import io
import re
import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest
import symsde as ss
from symsde import cli, tables

ROOT = Path(__file__).parents[2]


def blocks(page, language):
    """Fenced blocks of a page, in order."""
    text = (ROOT / page).read_text(encoding="utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```", text, re.M | re.S)


@pytest.fixture
def elsewhere(tmp_path, monkeypatch):
    """An empty directory with the examples, so that nothing is written into the tree."""
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("page", ["models", "schemes"])
def test_generated_page_is_current(page, capsys):
    assert cli.main(["list", page, "--markdown"]) == 0
    shown = capsys.readouterr().out
    committed = (ROOT / "docs" / f"{page}.md").read_text(encoding="utf-8")
    assert shown.rstrip("\n") == committed.rstrip("\n"), ".venv/bin/python docs/generate.py writes it again"


def test_every_name_has_its_rows():
    page = tables.schemes_markdown()
    for name in ss.schemes.names():
        assert page.count(f"| `{name}` |") == 3, name
    page = tables.models_markdown()
    for name in ss.models.names():
        assert f"\n## {name}\n" in page and f"| [`{name}`](#{name}) |" in page


def test_rows_say_what_the_library_says():
    rows = dict(re.findall(r"^\| `([^`]+)` \| (.*) \|$", tables.schemes_markdown().partition("## Structure")[0], re.M))
    assert set(rows) == {*ss.schemes.names(), *tables.FAMILIES}
    for name, row in rows.items():
        info = ss.schemes.get(name).info
        claims = [info.order_additive, info.order_commutative, info.order_general]
        cells = [cell.split()[0].rstrip(",") for cell in row.split(" | ")]
        assert [0.0 if cell == "-" else float(cell) for cell in cells[:3]] == claims, name
        assert float(cells[4]) == info.order_weak, name
    assert re.sub(r" \([\d.]+\)", "", rows["euler_maruyama"]) == "1 | 0.5 | 0.5 | 0.5 | 1 | 1"
    assert re.sub(r" \([\d.]+\)", "", rows["gauss2"]) == "1 | 1 | 0.5 | 2 | 1 | 4"


def test_measured_orders_reach_the_claims():
    """Not below the claim by more than 0.1, with 95 % half-widths of at most 0.1 (a fifteenth of orders above 1.5)."""
    measured = tables.measured_orders()
    assert set(measured) == {*ss.schemes.names(), *tables.FAMILIES}, "docs/generate.py measures what is missing"
    for name, found in measured.items():
        for noise, claim in tables.strong_orders(tables.certified(ss.schemes.get(name))).items():
            if claim > 0 and found[noise] is not None:
                assert found[noise][1] > claim - 0.1, (name, noise)
                assert found[noise][2] < max(0.1, claim / 15), (name, noise)
    for noise in ("additive noise", "commutative", "general", "commuting flows"):
        assert all(measured[name][noise] for name in ("midpoint", "symplectic_euler", "stormer_verlet", "gauss2"))


@pytest.mark.parametrize(("name", "noise"), [("gauss2", "commuting flows"), ("symplectic_euler", "additive noise")])
def test_measured_orders_are_measured_again(name, noise, monkeypatch):
    """On a fifth of the paths: within the intervals of both, 95 % of which are wide enough; the paths are fixed."""
    monkeypatch.syspath_prepend(ROOT / "docs")
    measure_orders = importlib.import_module("measure_orders")
    model, order, half_width = measure_orders.measure(name, noise, paths=200)
    recorded = tables.measured_orders()[name][noise]
    assert model == recorded[0]
    assert abs(order - recorded[1]) < 2 * (half_width + recorded[2]) < 0.4


def formula(text):
    """A formula of a docstring as a Python expression: 's1 p^2/2' is s1*p**2/2."""
    tokens = re.findall(r"[A-Za-z]\w*|\d+|\*\*|[-+/()^]", text.replace("^", "**").replace(".", "*"))
    code = ""
    for before, token in zip(["", *tokens], tokens, strict=False):
        ended = before == ")" or (before.isalnum() and before not in {"sin", "cos"})
        code += ("*" if ended and (token == "(" or token.isalnum()) else " ") + token
    return re.sub(r"\b(sin|cos)\s+(\w+)", r"\1(\2)", code).strip()


def test_formula_reader():
    assert eval(formula("s1 p^2/2"), {"s1": 3.0, "p": 2.0}) == 6.0
    assert eval(formula("a (p^2 + q^2)/2"), {"a": 2.0, "p": 1.0, "q": 3.0}) == 10.0
    assert eval(formula("p^2/2 - omega^2 cos q"), {"p": 2.0, "omega": 3.0, "q": 0.0, "cos": np.cos}) == -7.0


@pytest.mark.parametrize("name", [name for name in ss.models.names() if ss.models.get(name).ndof == 1])
def test_hamiltonians_in_the_docs_are_those_of_the_library(name):
    text = getattr(ss.models, name).__doc__
    found = dict(re.findall(r"\b(H(?:_\d)?) = ([^=,:]*?)(?=[,:]|\.\s)", text))
    values = {key: 0.4 + 0.3 * i for i, key in enumerate(ss.models.parameters(name))}
    model = ss.models.get(name, **values)
    assert sorted(found) == ["H", *(f"H_{k + 1}" for k in range(model.nnoise))]
    q, p = np.array([0.7, -1.3]), np.array([0.4, 0.9])
    for j, (_, text) in enumerate(sorted(found.items())):
        expected = eval(formula(text), {**values, "q": q, "p": p, "sin": np.sin, "cos": np.cos})
        given = model.value(q[None], p[None], np.eye(model.nnoise + 1)[j])
        np.testing.assert_allclose(given, expected, rtol=1e-14, err_msg=f"{name}: {text}")
        assert np.abs(given).max() > 0.1


def test_blocks_of_the_user_guide(elsewhere):
    code = blocks("docs/python.md", "python")
    assert len(code) >= 10
    names = {}
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        for block in code:
            exec(compile(block, "docs/python.md", "exec"), names)
    text = printed.getvalue()
    for words in ("(11, 1, 100)", "10.0 20.0", "weights sum to 1.1", "increments", "additive", "midpoint", "order"):
        assert words in text, words
    assert (elsewhere / "moments.csv").exists()


def test_blocks_of_the_readme(elsewhere):
    code = blocks("README.md", "python")
    assert code
    names = {}
    with contextlib.redirect_stdout(io.StringIO()):
        for block in code:
            exec(compile(block.replace("10**6", "10**4"), "README.md", "exec"), names)
    assert names["run"].q.shape == (101, 1, 1000)
    assert np.isfinite(names["mom"].se_mean_q).all()


def test_command_lines(elsewhere, capsys):
    """Every `symsde ...` of the guide and the README; `symsde paper` has a test of its own."""
    lines = "".join(blocks("docs/python.md", "sh") + blocks("README.md", "sh")).splitlines()
    lines += re.findall(r"`(symsde [^`]+)`", (ROOT / "README.md").read_text(encoding="utf-8"))
    commands = [shlex.split(line, comments=True)[1:] for line in lines if line.startswith("symsde ")]
    assert len(commands) > 6
    for command in commands:
        if command[-1] == "--help":
            with pytest.raises(SystemExit) as caught:
                cli.main(command)
            assert caught.value.code == 0
        elif command[0] != "paper":
            assert cli.main(command) == 0, command
    assert "mean" in capsys.readouterr().out
    assert (elsewhere / "kubo" / "moments.csv").exists()
