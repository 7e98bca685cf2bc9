# SPDX-License-Identifier: BSD-3-Clause
"""Error against run time: numbers against independent ones, bad input, failing points, resuming, pages.

Statistical checks allow 4.9 standard errors: a false alarm in a million.
"""

import csv
from pathlib import Path

import numpy as np
import pytest
import symsde as ss
from conftest import told
from symsde.answers import error_plan
from symsde.batch import scene as scene_of
from symsde.cli import command_line
from symsde.studies import study
from symsde.studies.study import orders
from symsde.studies.study import study_words as words

SCENES = Path(__file__).parents[2] / "examples" / "scenes"
SMALL = {"q0": 1.0, "p0": 0.0, "steps": [8, 16, 32, 64], "horizon": 2.0, "paths": 1000, "seed": 3}


def kubo(**given):
    return ss.work_precision(ss.models.kubo(), **{**SMALL, **given})


def point(result, scheme, steps):
    return next(row for row in result.rows if (row["scheme"], row["steps"]) == (scheme, steps))


@pytest.fixture(scope="module")
def small():
    return kubo(schemes=["midpoint", "gauss2", "heun", "symplectic_euler"])


def test_errors_are_those_of_convergence(small):
    other = ss.convergence(
        ss.models.kubo(), "midpoint", q0=1.0, p0=0.0, horizon=2.0, steps=[8, 16, 32, 64], paths=1000, seed=3
    )
    mine = [point(small, "midpoint", n) for n in (8, 16, 32, 64)]
    np.testing.assert_allclose([row["err_strong"] for row in mine], other.error, rtol=1e-9)
    np.testing.assert_allclose([row["err_strong_high"] for row in mine], other.high, rtol=1e-6)


def test_slopes(small):
    assert abs(small.orders["midpoint"].value - 1.2) < 0.2
    assert small.orders["gauss2"].value > 1.9
    assert abs(small.orders["symplectic_euler"].value - 1.0) < 0.1


def test_a_scheme_of_the_wrong_equation_does_not_converge():
    wrong = kubo(schemes=["symplectic_euler"], correction="none", steps=[64, 128, 256, 512])
    assert wrong.orders["symplectic_euler"].value < 0.5


def weak_error_of_midpoint(h, steps, sigma=0.3, factor=1.0):
    """Error of E q after n midpoint steps by Gauss-Hermite nodes: a step rotates by 2 atan(theta/2)."""
    nodes, weights = np.polynomial.hermite_e.hermegauss(40)
    turn = 2 * np.arctan((h + sigma * np.sqrt(h) * nodes) / 2)
    mean = (weights / weights.sum() * np.exp(-1j * turn)).sum()
    return factor * ((mean**steps).real - np.exp(-(sigma**2) * h * steps / 2) * np.cos(h * steps))


@pytest.mark.parametrize(("factor", "agrees"), [(1.0, True), (1.1, False)])
def test_weak_error_is_the_expectation(small, factor, agrees):
    row = point(small, "midpoint", 8)
    expected = weak_error_of_midpoint(0.25, 8, factor=factor)
    assert (abs(row["weak_q"] - expected) <= 4.9 * row["weak_q_ci"] / 1.96) == agrees


def test_costs_and_invariant(small):
    for row in small.rows:
        assert row["normals"] == 1  # increments are drawn at the step itself, without sums of finer ones
        assert 0 < row["seconds_low"] <= row["seconds"] <= row["seconds_high"]
        assert row["repeats"] >= 5
    assert point(small, "midpoint", 8)["drift"] < 1e-13
    assert point(small, "heun", 8)["drift"] > 1e-3
    # a path's set-up costs most of 8 steps here, and a busy machine is noisy
    assert point(small, "midpoint", 64)["seconds_high"] > point(small, "midpoint", 8)["seconds_low"]


def test_friction_leaves_no_invariant():
    damped = ss.models.kubo().damped(0.5)
    found = ss.work_precision(damped, schemes=["midpoint"], **{**SMALL, "paths": 50, "steps": [8, 16]})
    assert all(row["drift"] is None for row in found.rows)


def test_the_reference_shows_its_own_error():
    model, given = ss.models.synchrotron(), {**SMALL, "paths": 200, "horizon": 1.0, "steps": [8, 16]}
    good = ss.work_precision(model, schemes=["midpoint"], **given)
    assert {row["status"] for row in good.rows} == {"ok"}
    assert 0 < good.rows[0]["ref_error"] < 0.05 * good.rows[-1]["err_strong"]
    poor = ss.work_precision(model, schemes=["midpoint"], reference="euler_maruyama", reference_steps=32, **given)
    assert {row["status"] for row in poor.rows} == {"reference"}
    assert "reference" in str(poor)


def test_schemes_with_areas_follow_the_same_path():
    model = ss.models.noncommutative_oscillator()
    given = {**SMALL, "paths": 200, "horizon": 1.0, "steps": [4, 8, 16]}
    result = ss.work_precision(model, schemes=["midpoint", "midpoint_areas"], **given)
    assert abs(result.orders["midpoint"].value - 0.5) < 0.25
    assert abs(result.orders["midpoint_areas"].value - 1.0) < 0.25


def test_failing_points_are_marked_and_not_dropped():
    model = ss.models.fpu_chain(n=6, beta=1000.0)
    given = {**SMALL, "q0": [1.0, -1.0] * 3, "paths": 40, "horizon": 1.0, "steps": [8, 16, 256, 512]}
    result = ss.work_precision(model, schemes=["stormer_verlet", "heun"], **given)
    assert len(result.rows) == 8
    lost = point(result, "stormer_verlet", 8)
    assert lost["status"] == "failed" and lost["failed"] == 40 and not lost["pareto"]
    assert "FAILED: 40 paths" in str(result)
    assert "fail or diverge" in result.words()


BAD = [
    ({"steps": [10, 32]}, "not a whole divisor"),
    ({"steps": [12, 36]}, "power of two"),
    ({"steps": [16]}, "at least two"),
    ({"steps": 16}, "not a list"),
    ({"reference_steps": 64, "reference": "gauss2"}, "not finer"),
    ({"reference_steps": 96, "reference": "gauss2"}, "not finer"),
    ({"reference": "exact", "model": "pendulum"}, "no exact"),
    ({"schemes": ["P1N2Q4Gau"]}, "P1N2Q4Gau with 8 steps"),
    ({"schemes": ["gauss2_weak2"]}, "follow no Brownian path"),
    ({"schemes": ["midpoint", "midpoint"]}, "twice"),
    ({"schemes": []}, "not a list"),
    ({"schemes": ["midpiont"]}, "midpoint"),
    ({"paths": 39}, "at least 40"),
    ({"paths": 1000, "interval": 0.01}, "need 19208 paths"),
    ({"repeats": 3}, "at least 5"),
    ({"horizon": -1.0}, "above 0"),
    ({"sede": 1}, "seed"),
]


@pytest.mark.parametrize(("interval", "least"), [(0.01, 19208), (0.05, 769), (0.1, 193)])
def test_the_least_number_of_paths_is_enough(interval, least):
    assert error_plan.check_paths(least, interval) == least
    with pytest.raises(ValueError, match=f"need {least} paths"):
        error_plan.check_paths(least - 1, interval)


@pytest.mark.parametrize(("given", "words"), BAD)
def test_bad_input_is_refused_before_any_long_work(given, words, monkeypatch):
    monkeypatch.setattr(study, "measure", lambda *_: pytest.fail("a point was measured"))
    given = {**SMALL, "paths": 200, **given}
    model = ss.models.get(given.pop("model", "kubo"))
    with pytest.raises(ValueError, match=words):
        ss.work_precision(model, **given)


def test_schemes_that_do_not_fit_are_told(tmp_path):
    """Refused schemes have a line with the reason in the table, the file and the data, and change no errors."""
    chosen = ["gauss_dkdkd", "midpoint", "gauss2_weak2", "heun"]
    found = kubo(schemes=chosen, paths=100, out=tmp_path)
    alone = kubo(schemes=["midpoint", "heun"], paths=100)
    assert found.schemes == ["midpoint", "heun"]
    assert [row["err_strong"] for row in found.rows] == [row["err_strong"] for row in alone.rows]
    assert list(found.refused) == ["gauss_dkdkd", "gauss2_weak2"]
    assert alone.refused == {}
    for name, word in (("gauss_dkdkd", "with 8 steps: "), ("gauss2_weak2", "follow no Brownian path")):
        assert word in found.refused[name]
        assert f"{name} is left out: {found.refused[name]}" in str(found)
        assert f"{name} is left out: {found.refused[name][:40]}" in (tmp_path / "work-precision.csv").read_text()
    assert study.of_data(found.data()).refused == found.refused
    with pytest.raises(ValueError, match="gauss_dkdkd with 8 steps"):
        kubo(schemes=["gauss_dkdkd", "gauss2_weak2"], paths=100)


def test_schemes_that_fail_are_told(monkeypatch):
    """An error of one scheme's runs does not end the study; if all have errors, the first one does."""
    measure = study.measure

    def broken(plan, scheme, *rest):
        if scheme.name in bad:
            raise ss.errors.NumericalError(f"{scheme.name} broke")
        return measure(plan, scheme, *rest)

    monkeypatch.setattr(study, "measure", broken)
    bad = {"midpoint"}
    found = kubo(schemes=["midpoint", "heun"], paths=100)
    assert found.refused == {"midpoint": "midpoint broke"}
    assert {row["scheme"] for row in found.rows} == set(found.orders) == {"heun"}
    bad.add("heun")
    with pytest.raises(ss.errors.NumericalError, match="midpoint broke"):
        kubo(schemes=["midpoint", "heun"], paths=100)


def test_a_stopped_study_goes_on(tmp_path, monkeypatch):
    given = {"schemes": ["midpoint", "heun"], "steps": [8, 16], "paths": 60, "out": tmp_path}
    real, calls = study.cost, []

    def stop_at_third(*arguments):
        calls.append(1)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return real(*arguments)

    monkeypatch.setattr(study, "cost", stop_at_third)
    with pytest.raises(KeyboardInterrupt):
        kubo(**given)
    assert len(read(tmp_path)) == 2  # finished points are kept
    monkeypatch.setattr(study, "cost", real)
    whole = kubo(**given)
    assert whole.resumed == 2 and len(whole.rows) == 4
    again = kubo(**given)
    assert again.resumed == 4 and again.rows == whole.rows
    assert kubo(**{**given, "paths": 80}).resumed == 0  # a different study


def read(directory):
    lines = (directory / "work-precision.csv").read_text().splitlines()
    return list(csv.DictReader(line for line in lines if not line.startswith("#")))


def test_files(tmp_path):
    result = kubo(schemes=["midpoint", "heun"], steps=[8, 16], paths=60, out=tmp_path)
    rows = read(tmp_path)
    assert list(rows[0]) == list(study.table.COLUMNS)
    assert [float(row["err_strong"]) for row in rows] == [row["err_strong"] for row in result.rows]
    comments = told(tmp_path / "work-precision.csv")
    assert {name: comments[name] for name in rows[0]} == study.table.COLUMNS
    assert comments["symsde_version"] == ss.__version__ and "pytest" in comments["command"]
    assert (tmp_path / "work-precision.png").read_bytes().startswith(b"\x89PNG")


def row(scheme, h, error, seconds, **more):
    ends = {"err_strong_low": error, "err_strong_high": error, "batches": [error**2] * 20, "size": 1.0}
    common = {"scheme": scheme, "h": h, "err_strong": error, "seconds": seconds, "ref_error": 0.0, "failed": 0, **ends}
    return {**common, "status": orders.judge({**common, **more}), "drift": None, **more}


def test_front_slopes_and_plateaus():
    rows = [row("a", 2.0**-k, 0.1 * 2.0 ** (-2 * k), 2.0**k, ref_error=1e-5) for k in range(7)]
    assert [r["status"] for r in rows] == ["ok"] * 6 + ["reference"]
    assert orders.fitted(rows).value == pytest.approx(2.0)
    rows.append(row("b", 0.5, 0.2, 1.5))
    assert orders.pareto(rows) == set(range(6))
    assert orders.judge({"failed": 1, "err_strong": 0.1}) == "failed"
    assert row("c", 1.0, 500.0, 1.0)["status"] == "diverged"
    assert row("c", 1.0, 0.7, 1.0)["status"] == "saturated"


def test_words_name_the_cheapest():
    rows = [row("midpoint", 0.1, 0.009, 1.0), row("gauss2", 0.2, 0.009, 3.0)]
    said = words.paragraph(rows)
    assert "use midpoint at h = 0.1" in said and "3.0 times less than gauss2" in said
    rows[0]["seconds"] = 6.0
    assert "use gauss2 at h = 0.2" in words.paragraph(rows)


def test_command_line(tmp_path, capsys):
    common = ["study", str(SCENES / "kubo.toml"), "--schemes", "midpoint,heun", "--paths", "60", "--out", str(tmp_path)]
    assert command_line.main([*common, "--steps", "8,16"]) == command_line.OK
    assert "For an error of" in capsys.readouterr().out
    assert len(read(tmp_path)) == 4
    assert command_line.main([*common, "--steps", "8,12"]) == command_line.BAD_INPUT
    assert "kubo.toml: [study]" in capsys.readouterr().err
    assert command_line.main(["study"]) == command_line.BAD_INPUT
    assert command_line.main(["study", "--all", str(tmp_path)]) == command_line.BAD_INPUT


def test_page(tmp_path):
    folder = tmp_path / "scenes"
    folder.mkdir()
    text = (SCENES / "kubo.toml").read_text()
    head, _, _ = text.partition("[study]")
    (folder / "kubo.toml").write_text(head + '[study]\nschemes = ["midpoint", "heun"]\nsteps = [8, 16]\npaths = 60\n')
    page = tmp_path / "page.md"
    assert (
        command_line.main(["study", "--all", str(folder), "--out", str(tmp_path), "--markdown", str(page), "--quiet"])
        == command_line.OK
    )
    text = page.with_stem("page-tables").read_text()
    assert "## kubo" in text
    assert "[kubo](page-tables.md#kubo)" in page.read_text() and "\n| kubo | " in page.read_text()
    assert (tmp_path / "figures" / "work-precision-kubo.png").is_file()


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("schemes = -inf", "schemes = -inf"),
        ("steps = [16, -inf]", "steps = -inf"),
        ('schemes = ["midpiont"]', "there is no scheme 'midpiont'"),
        ("horizon = -1.0", "horizon = -1"),
    ],
)
def test_check_refuses_what_the_study_would(tmp_path, capsys, monkeypatch, line, words):
    """The values in [study] are checked, not only its keys; valid values pass."""
    monkeypatch.setattr(study, "measure", lambda *_: pytest.fail("a point was measured"))
    head, _, _ = (SCENES / "kubo.toml").read_text().partition("[study]")
    (tmp_path / "a.toml").write_text(f"{head}[study]\n{line}\n")
    assert command_line.main(["check", str(tmp_path / "a.toml")]) == command_line.BAD_INPUT
    assert f"a.toml: [study]: {words}" in capsys.readouterr().err
    assert command_line.main(["check", str(SCENES / "kubo.toml")]) == command_line.OK
    assert "ok" in capsys.readouterr().out


def test_a_bad_scene_of_a_folder_is_refused_first(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(study, "measure", lambda *_: pytest.fail("a point was measured"))
    text = (SCENES / "kubo.toml").read_text()
    (tmp_path / "a.toml").write_text(text)
    (tmp_path / "b.toml").write_text(text.replace("[8, 16, 32, 64, 128, 256]", "[8, 12]"))
    assert (
        command_line.main(["study", "--all", str(tmp_path), "--out", str(tmp_path / "out")]) == command_line.BAD_INPUT
    )
    assert "b.toml: [study]: steps: 8" in capsys.readouterr().err


# Counts of a path-step: normals, gradients, Hessians, iterations, solves, LAPACK; None if Newton iterates.
LEFT_OUT = {
    "additive_oscillator": (2, 2, 0, 0, 0, 0),
    "driven_pendulum": (2, None, None, None, None, 0),
    "fpu_chain": (64, None, None, None, None, 0),
    "henon_heiles": (2, None, None, None, None, 0),
    "kubo": (1, 0, 0, 1, 1, 0),
    "linear_oscillator": (1, 0, 0, 1, 1, 0),
    "noncommutative_oscillator": (2, 0, 0, 1, 1, 0),
    "pendulum": (1, 3, 0, 0, 0, 0),
    "stiff_chain": (64, None, None, None, None, 0),
    "synchrotron": (2, None, None, None, None, 0),
}


@pytest.mark.parametrize("scene", LEFT_OUT)
def test_what_a_scene_left_out(scene):
    chosen = scene_of.load(SCENES / f"{scene}.toml")
    run = chosen.run | {"paths": 256, "steps": 32, "save_every": 32, "threads": 1}
    run |= {key: np.asarray(run[key])[:, :1] for key in ("q0", "p0") if np.ndim(run[key]) == 2}
    report = ss.moments(chosen.model, **run).report
    counts = {name: count / report.counters["path_steps"] for name, count in report.counters.items()}
    names = ("normals", "gradients", "hessians", "iterations", "solves", "lapack_solves")
    for name, expected in zip(names, LEFT_OUT[scene], strict=True):
        if expected is not None:
            assert counts[name] == expected, name
    assert counts["hessian_vectors"] == 0
    assert counts["gradients"] == counts["hessians"] or counts["hessians"] == 0
    assert counts["iterations"] < 7
    assert counts["solves"] == counts["iterations"]


def test_every_scene_is_expected():
    assert {file.stem for file in SCENES.glob("*.toml")} == set(LEFT_OUT)
    for file in SCENES.glob("*.toml"):
        assert len(file.read_text().splitlines()) <= 40


def test_the_reference_where_flows_commute_is_above_the_scheme():
    """gauss3 has strong order 3 there, above gauss2_strong32's 2; likewise without noise."""
    given = {"q0": 0.5, "p0": 0.3, "steps": [1, 2, 4], "paths": 40, "horizon": 2.0}
    for noises in (1, 0):

        def gradient(t, w, q, p, noises=noises):
            rate = w[0] * (q**2 + p**2) + (w[1] if noises else 0)
            return rate * q, rate * p

        spin = ss.Model(ndof=1, nnoise=noises, gradient=gradient)  # H = (q^2 + p^2)^2/4, H_1 = (q^2 + p^2)/2
        found = ss.convergence(spin, "gauss3", **given)
        assert found.reference.startswith("gauss4") and found.reference_error < found.error.min() / 4, str(found)
    still = ss.convergence(ss.models.pendulum(), "midpoint", **given)
    assert still.reference.startswith("gauss2_strong32")  # flows that do not commute
