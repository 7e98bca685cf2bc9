# SPDX-License-Identifier: BSD-3-Clause
"""The documentation is true: generated pages are current, figures show their data, formulas are the library's."""

import importlib
import importlib.util
import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest
import symsde as ss
from symsde.cli import command_line
from symsde.show import tables
from symsde.studies import catalogue

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "docs"))
import generate  # noqa: E402
import typeset  # noqa: E402


@pytest.mark.parametrize("page", [*generate.CATALOGUES, *generate.MEASURED])
def test_generated_pages_are_current(page):
    """Tables of the catalogues, and formulas written by other programs, are current."""
    committed = (ROOT / "docs" / page).read_text(encoding="utf-8")
    assert committed == generate.pages()[page], ".venv/bin/python docs/generate.py writes it again"


@pytest.mark.parametrize("what", ["models", "schemes"])
def test_lists_are_the_tables_of_the_pages(what, capsys):
    assert command_line.main(["list", what, "--markdown"]) == 0
    shown = capsys.readouterr().out
    assert shown == "\n".join(getattr(catalogue, f"{what}_parts")().values()) + "\n"


def test_pages_list_the_same_packages():
    """Pages list the packages that ./bootstrap installs if missing; g++ includes gcc and the headers of C."""
    pages = [ROOT / "README.md", ROOT / "docs/first-ten-minutes.md", ROOT / "docs/install.md"]
    lists = [re.findall(r"apt-get install (.*)", page.read_text(encoding="utf-8")) for page in pages]
    assert lists[0] == lists[1] == lists[2] and len(lists[0]) == 1
    installed = (ROOT / "bootstrap").read_text(encoding="utf-8").partition("missing_packages()")[2].partition("\n}")[0]
    names = {*re.findall(r"\w:([\w-]+)", installed), *re.findall(r"[\w-]+-(?:dev|venv)", installed)}
    assert names - {"gcc", "libc6-dev"} | {"g++"} == {*lists[0][0].split()}


def test_every_name_has_its_rows():
    page = "\n".join(catalogue.schemes_parts().values())
    for name in ss.schemes.names():
        assert page.count(f"| `{name}` |") == 3, name
    page = catalogue.models_parts()["models"]
    for name in ss.models.names():
        assert f"\n## {name}\n" in page and f"| [`{name}`](#{name}) |" in page


def test_rows_say_what_the_library_says():
    rows = dict(re.findall(r"^\| `([^`]+)` \| (.*) \|$", catalogue.schemes_parts()["orders"], re.M))
    assert set(rows) == {*ss.schemes.names(), *catalogue.FAMILIES}
    for name, row in rows.items():
        orders = ss.schemes.get(name).info.orders
        cells = [re.match(r"-|[\d.]+", cell)[0] for cell in row.split(" | ")]
        assert [0.0 if cell == "-" else float(cell) for cell in cells[:5]] == [o.value for o in orders.values()], name
        assert [("*" in cell) for cell in row.split(" | ")[:5]] == [o.evidence == "claimed" for o in orders.values()]
    assert re.sub(r" \([^)]*\)", "", rows["euler_maruyama"]) == "1* | 0.5* | 0.5* | 0.5* | 1* | 1"
    assert re.sub(r" \([^)]*\)", "", rows["gauss2"]) == "1 | 1 | 0.5 | 2 | 1 | 4"


def test_measured_orders_reach_their_values():
    """A measured order is at most 0.1 below its value, with half-widths of at most 0.1 (a fifteenth of orders above
    1.5).
    """
    for name in (*ss.schemes.names(), *catalogue.FAMILIES):
        for kind, order in ss.schemes.get(name).info.orders.items():
            if order.measured is not None:
                assert order.value > 0, (name, kind)
                assert order.measured.order > order.value - 0.1, (name, kind)
                assert order.measured.half_width < max(0.1, order.value / 15), (name, kind)
                assert order.measured.floor < 0.25, (name, kind)  # this bound is necessary for the order to be accepted
    for name in ("midpoint", "symplectic_euler", "stormer_verlet", "gauss2"):
        assert all(order.measured for order in ss.schemes.get(name).info.orders.values())


def test_weak_orders_are_measured_without_sampling():
    """Schemes with a law of their own, by full enumeration of the law: measured again, and compared with the kept
    number.
    """
    pytest.importorskip("numba")  # measure_orders has a compiled model
    measure = load(ROOT / "docs" / "measure_orders.py")
    for name, order in (("gauss2_weak2", 2.0), ("gauss2_weak2_areas", 2.0), ("midpoint_weak1", 1.0)):
        found = measure.weak(name)
        kept = ss.schemes.get(name).info.orders["weak"].measured
        assert abs(found["order"] - order) < 0.02 and abs(found["order"] - kept.order) < 1e-3
    model, (_, noise) = ss.models.noncommutative_oscillator(s1=0.0, s2=0.8), measure.LINEAR[0]
    exact = measure.generator_map(noise)
    for scheme, agrees in (("gauss2_weak2", True), ("midpoint_weak1", False)):
        mean = np.linalg.matrix_power(measure.mean_map(model, scheme, 1 / 16), 16)
        assert (np.abs(mean - exact).max() < 1e-3) == agrees
    assert np.abs(measure.generator_map([1.01 * noise[0]]) - exact).max() > 1e-3  # the twin: a noise 1 % off


def test_the_figure_of_weak_orders_shows_what_the_library_computes():
    """Second moments are computed again; extrapolation gains one order, and both schemes of order two have it."""
    pytest.importorskip("numba")
    weak_orders = load(ROOT / "docs" / "weak_orders.py")
    kept = json.loads((ROOT / "docs" / "figures" / "weak-orders.json").read_text(encoding="utf-8"))["curves"]
    found = weak_orders.compute()["curves"]
    assert list(found) == list(kept)
    for name, errors in found.items():
        np.testing.assert_allclose(errors, kept[name], rtol=2e-3)
    slopes = {name: np.log2(errors[-2] / errors[-1]) for name, errors in kept.items()}
    orders = dict.fromkeys(weak_orders.SCHEMES, 1.0) | {"gauss2_weak2_areas": 2.0}
    for scheme, order in weak_orders.EXTRAPOLATED:
        orders[weak_orders.WORDS.format(scheme=scheme)] = order + 1.0
    assert slopes == pytest.approx(orders, abs=0.03)


def test_the_module_of_measurements_is_current():
    module = load(ROOT / "docs" / "measured_module.py")
    assert module.TARGET.read_text(encoding="utf-8") == module.module(), "docs/generate.py writes it again"


def load(path):
    """A program of docs/ as a module."""
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(("name", "noise"), [("gauss2", "commuting"), ("symplectic_euler", "commutative")])
def test_measured_orders_are_measured_again(name, noise):
    """On a quarter of the paths the orders agree within both intervals (95 % each); the paths are fixed."""
    pytest.importorskip("numba")  # measure_orders has a model of its own
    found = load(ROOT / "docs" / "measure_orders.py").strong(noise, [name], paths=200)[name]
    kept = ss.schemes.get(name).info.orders[noise].measured
    assert abs(found["order"] - kept.order) <= found["half_width"] + kept.half_width
    assert 0 < found["half_width"] < 4 * kept.half_width


def formula(text):
    """A formula in a docstring as a Python expression: 's1 p^2/2' becomes s1*p**2/2."""
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
        expected = eval(formula(text), {**values, "t": 0.6, "q": q, "p": p, "sin": np.sin, "cos": np.cos})
        given = model.value(q[None], p[None], np.eye(model.nnoise + 1)[j], t=0.6)
        np.testing.assert_allclose(given, expected, rtol=1e-14, err_msg=f"{name}: {text}")
        assert np.abs(given).max() > 0.1


def test_every_figure_has_its_data():
    pictures = {path.stem for path in (ROOT / "docs" / "figures").glob("*.png")}
    data = {path.stem for path in (ROOT / "docs" / "figures").glob("*.json")}
    assert "kubo_invariant" in data and pictures == data


@pytest.mark.parametrize("data", sorted((ROOT / "docs" / "figures").glob("*.json")), ids=lambda path: path.stem)
def test_figures_show_their_data(data, tmp_path):
    """Figures drawn again by docs/figures.py have equal pixels up to antialiasing. Metadata are not compared."""
    matplotlib, pillow = pytest.importorskip("matplotlib"), pytest.importorskip("PIL.Image")
    committed = data.with_suffix(".png")
    with pillow.open(committed) as picture:
        if picture.info.get("Software", "").partition(",")[0] != f"Matplotlib version{matplotlib.__version__}":
            pytest.skip("drawn by another version of matplotlib")
    figures = load(ROOT / "docs" / "figures.py")
    figures.draw(data, tmp_path / "again.png")
    assert difference(pillow, committed, tmp_path / "again.png") < 1e-4
    changed = json.loads(data.read_text(encoding="utf-8"))
    shift_numbers(changed)  # the twin: every number a tenth larger
    (tmp_path / data.name).write_text(json.dumps(changed), encoding="utf-8")
    figures.draw(tmp_path / data.name, tmp_path / "other.png")
    assert difference(pillow, committed, tmp_path / "other.png") > 1e-3


def test_pages_of_measurements_say_what_their_data_say():
    """Pages have the tables and words that programs would write from the kept data: nothing is measured again."""
    page, bifurcation = (
        importlib.import_module(f"symsde.studies.{x}") for x in ("study.study_page", "stability.bifurcation")
    )
    text, scenes = ((ROOT / f"docs/work-precision{x}.md").read_text(encoding="utf-8") for x in ("", "-tables"))
    studies = []
    for file in sorted((ROOT / "docs/figures").glob("work-precision-*.json")):
        study = page.of_data(json.loads(file.read_text(encoding="utf-8")))
        own = scenes.partition(f"\n## {study.name}\n")[2].partition("\n## ")[0]
        for part in page.results(study):
            assert typeset.markdown(part) in own, study.name
        studies.append(study)
    for part in page.begin(studies):
        assert typeset.markdown(part) in text.partition("\n## ")[0]
    kept = json.loads((ROOT / "docs/figures/fixed-points.json").read_text(encoding="utf-8"))
    text = (ROOT / "docs/stability.md").read_text(encoding="utf-8")
    assert typeset.markdown(tables.markdown(bifurcation.HEAD, bifurcation.table(kept))) in text


def difference(pillow, one, other):
    """Mean difference of two pictures, 0 to 1; 1 where their sizes differ."""
    with pillow.open(one) as first, pillow.open(other) as second:
        if first.size != second.size:
            return 1.0
        pixels = [np.asarray(picture.convert("RGB"), dtype=float) for picture in (first, second)]
    return np.abs(pixels[0] - pixels[1]).mean() / 255


def shift_numbers(found):
    """Make every real number a tenth larger, in place."""
    for key, value in found.items() if isinstance(found, dict) else enumerate(found):
        if isinstance(value, dict | list):
            shift_numbers(value)
        elif isinstance(value, float):
            found[key] = 1.1 * value


def test_the_first_figure_shows_what_the_library_computes():
    pytest.importorskip("matplotlib")
    kept = json.loads((ROOT / "docs" / "figures" / "kubo_invariant.json").read_text(encoding="utf-8"))
    found = importlib.import_module("symsde.studies.paper.symplecticity").invariant_curves()
    assert set(kept) == set(found)
    for label, (t, mean) in found.items():
        np.testing.assert_allclose(kept[label][0], t, rtol=1e-6)
        np.testing.assert_allclose(kept[label][1], mean, rtol=1e-5, err_msg=label)
    assert 1.2 < kept["sympl. Euler, none"][1][-1] < 1.6  # an older version of the figure had 2.9
