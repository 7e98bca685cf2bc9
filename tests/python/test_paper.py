# SPDX-License-Identifier: BSD-3-Clause
"""`symsde paper --quick`: the numbers in results.json against the mathematics, and the files.

The bounds here come from the formulas again, not from the command's own checks. Statistical ones
are five standard errors wide (a false alarm in two million), and the seeds are fixed.
"""

import contextlib
import dataclasses
import io
import json
import math
import re

import pytest
import symsde as ss

pytest.importorskip("matplotlib")

FIGURES = ("kubo", "linear_oscillator", "figure_4_1", "figure_4_2", "symplecticity", "euler_lagrange", "kubo_invariant")
KEYS = FIGURES[:6]
SYMPLECTIC = (
    "midpoint",
    "Gauss 2",
    "Lobatto 3",
    "Stoermer-Verlet",
    *(f"{name}, {form}" for name in ("sympl. Euler", "adjoint") for form in ("none", "mean", "increments")),
)


@pytest.fixture(scope="module")
def outcome(tmp_path_factory):
    from symsde.studies import paper

    out = tmp_path_factory.mktemp("paper")
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        code = paper.run(out, quick=True)
    return out, code, printed.getvalue()


@pytest.fixture(scope="module")
def results(outcome):
    return json.loads((outcome[0] / "results.json").read_text(encoding="utf-8"))


def test_exit_code_and_no_failed_expectation(outcome, results):
    failed = [check["quantity"] for part in results.values() for check in part["checks"] if check["passed"] is False]
    assert failed == []
    assert outcome[1] == 0


def test_every_experiment_says_where_its_numbers_come_from(results):
    assert tuple(results) == KEYS
    for part in results.values():
        assert part["version"] == ss.__version__
        assert part["compiler"]
        assert part["quick"] is True
        assert part["parameters"]


def test_seeds_are_those_of_the_runs(results):
    """Normals drawn with the seed in the file reproduce the numbers of an experiment."""
    from symsde.studies.paper import figure_4_1

    part = results["euler_lagrange"]
    given, case = part["parameters"], part["synchrotron, midpoint"]
    common = {key: given[key] for key in ("step", "steps", "paths")}
    model = ss.models.synchrotron(**given["synchrotron"])
    run = ss.simulate(model, q0=0.0, p0=0.0, seed=part["seed"], **common)
    assert case["largest_state"] == pytest.approx(max(abs(run.q).max(), abs(run.p).max()), rel=1e-12)
    first = results["figure_4_1"]["seeds"][0]
    assert first["seed"] == results["figure_4_1"]["seed"] == results["figure_4_1"]["parameters"]["seeds"][0]
    model = ss.models.get("synchrotron", **{key: value for key, value in results["figure_4_1"]["parameters"].items()
                                            if key in ss.models.parameters("synchrotron")})  # fmt: skip
    fine, rough = (figure_4_1.simulate(model, first["seed"], finer=n).q[:, 0, 0] for n in (figure_4_1.LEVELS, 0))
    assert first["midpoint_fine"] == pytest.approx(abs(fine - rough).max(), rel=1e-12)


def test_the_printed_table_is_that_of_the_file(outcome, results):
    """The printed table agrees line by line with the file: equations, quantity, measured, expected and verdict, cut
    at the columns of the table's rule.
    """
    verdicts = {True: "ok", False: "FAILED", None: "-"}
    lines = iter(outcome[2].splitlines())
    for part in results.values():
        rule = next(line for line in lines if line.startswith("  ---"))
        columns = [match.span() for match in re.finditer("-+", rule)]
        for check in part["checks"]:
            expected = [check[key] for key in ("equations", "quantity", "measured", "expected")]
            line = next(lines)
            assert [line[i:j].rstrip() for i, j in columns] == [*expected, verdicts[check["passed"]]]
    met = [check["passed"] for part in results.values() for check in part["checks"]]
    assert outcome[2].splitlines()[-1] == f"{met.count(True)} expectations met, {met.count(False)} failed"


@pytest.mark.parametrize("name", FIGURES)
def test_figures_are_png_of_half_a_page(outcome, name):
    data = (outcome[0] / f"{name}.png").read_bytes()
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    width, height = (int.from_bytes(data[at : at + 4], "big") for at in (16, 20))
    assert width == {"kubo_invariant": 920}.get(name, 1100)  # 5.5 in at 200 dpi; one figure has 4.6 in, for phones
    assert 500 <= height <= 900


def test_kubo_order_constant_and_invariant(results):
    kubo = results["kubo"]
    assert len(kubo["order_steps"]) >= 7
    low, high = kubo["order_interval"]
    assert low < kubo["order"] < high
    assert abs(kubo["order"] - 1) < 0.05
    # sum of (x - 2 atan(x/2)), x = a h + sigma dW: mean square (h/12)^2 ((3 a sigma^2)^2 + 15 sigma^6) at t = 1
    a, sigma = kubo["parameters"]["a"], kubo["parameters"]["sigma"]
    constant = math.sqrt((3 * a * sigma**2) ** 2 + 15 * sigma**6) / 12
    assert kubo["error_constant"] == pytest.approx(constant, rel=0.08)  # 1000 paths: one standard error is 3 %
    assert 0 < kubo["invariant_drift"] < 1e-11
    assert 1e-3 < kubo["max_error"] < 0.2


def test_linear_oscillator_means_and_slopes(results):
    part = results["linear_oscillator"]
    sigma = part["parameters"]["sigma"]
    growth = part["growth"]
    for t, mean, error in zip(growth["t"][1:], growth["mean"][1:], growth["standard_error"][1:], strict=True):
        assert abs(mean - (1 + sigma**2 * t)) < 5 * error
        # p^2 + q^2 has variance (sigma^2 t)^2 (chi-square, two degrees of freedom) up to lower order
        assert error == pytest.approx(sigma**2 * t / math.sqrt(part["parameters"]["paths"]), rel=0.25)
    rows = {row["step"]: row for row in part["slopes"]}
    for step, row in rows.items():
        assert abs(row["slope"] - sigma**2 / (1 + step**2 / 4)) < 5 * row["standard_error"]
    for step in (1.0, 2.0):  # 0.8 and 0.5 instead of 1
        assert abs(rows[step]["slope"] - sigma**2) > 5 * rows[step]["standard_error"]
    blow_up = part["euler_maruyama"]
    h, n = blow_up["step"], round(blow_up["t"][-1] / blow_up["step"])
    assert blow_up["mean"][-1] == pytest.approx((1 + h**2) ** n * (1 + sigma**2 / h) - sigma**2 / h, rel=0.05)


def test_figure_4_1_differences_and_iterations(results):
    part = results["figure_4_1"]
    assert [row["seed"] for row in part["seeds"]] == part["parameters"]["seeds"]
    for row in part["seeds"]:
        assert row["midpoint_fine"] > row["midpoint_eighth_fine"] > 0
        # triangle inequality of three computations on one path; on different paths distances would be as large as the
        # amplitude
        assert row["midpoint_reference"] <= row["midpoint_fine"] + row["reference_fine"]
    middle = sorted(row["midpoint_fine"] for row in part["seeds"])[len(part["seeds"]) // 2]
    assert middle < 0.2
    many = part["many_paths"]
    assert 0.02 < many["quantiles_50_90_99"][0] < 0.06
    assert many["above_1"] <= many["above_0.2"] <= many["above_0.1"] < 0.5
    assert part["reference_is_adjoint_step"] < 1e-14
    assert part["newton_fixed_point_difference"] < 1e-9
    assert part["work"]["fixed_point_100"]["iterations"] == pytest.approx(100)
    assert 1 < part["work"]["newton"]["iterations"] < 4
    assert part["fixed_point_iterations_needed"] < 12
    assert part["fixed_point_differences"][0] > 1e-6


@pytest.mark.parametrize("case", ["one_noise", "two_noises"])
@pytest.mark.parametrize("scheme", ["symplectic_euler", "symplectic_euler_adjoint"])
def test_figure_4_2_errors_and_order(results, case, scheme):
    part = results["figure_4_2"][case]
    errors, sizes = part[scheme]["max_errors"], part[scheme]["largest_q"]
    for error, size in zip(errors, sizes, strict=True):
        assert 0.02 < error < 0.6
        assert error < 0.05 * size
    assert abs(part[scheme]["order"] - 1) < 0.05
    value, standard_error = part["exact_second_moment"]["value"]
    expected = {"one_noise": 20.0, "two_noises": 40.0}[case]  # (gamma^2 + sigma^2) t at t = 20
    assert abs(value - expected) < 5 * standard_error


def test_symplectic_schemes_keep_area_and_the_contrasts_do_not(results):
    table = results["symplecticity"]["table"]
    for name in SYMPLECTIC:
        assert table[name]["det_defect"] < 1e-14, name
        assert table[name]["tangent_defect"] < 1e-13, name
    # rms of x^4/4 (Heun), of (1 - s/2)^2 + x^2 - 1 with s = sigma^2 h (Euler-Maruyama): Gaussian moments of x
    a, sigma, h = results["symplecticity"]["parameters"]["a"], results["symplecticity"]["parameters"]["sigma"], 0.1
    heun = math.sqrt(_moment(8, a * h, sigma**2 * h)) / 4
    shift = (1 - sigma**2 * h / 2) ** 2 - 1
    second, fourth = (_moment(k, a * h, sigma**2 * h) for k in (2, 4))
    euler = math.sqrt(shift**2 + 2 * shift * second + fourth)
    assert table["Heun"]["det_defect"] == pytest.approx(heun, rel=0.6)  # from 1000 points with a heavy tail
    assert table["Euler-Maruyama"]["det_defect"] == pytest.approx(euler, rel=0.25)
    assert table["midpoint, 3 iterations"]["det_defect"] > 1e-3
    assert 1e-9 < table["midpoint, 10 iterations"]["det_defect"] < 1e-5


def _moment(k, mean, variance):
    """E x^k of a normal x by recursion."""
    moments = [1.0, mean]
    for j in range(2, k + 1):
        moments.append(mean * moments[-1] + (j - 1) * variance * moments[-2])
    return moments[k]


def test_invariant_in_the_long_run(results):
    table = results["symplecticity"]["table"]
    for name in ("midpoint", "Gauss 2"):
        assert table[name]["max_deviation"] < 1e-11
    assert table["Lobatto 3"]["max_deviation"] < 2e-3
    assert table["Stoermer-Verlet"]["max_deviation"] < 0.3
    assert abs(table["sympl. Euler, increments"]["mean_final"] - 1) < 0.3
    assert table["sympl. Euler, none"]["mean_final"] > 1.1  # 2.22 +- 0.48 over seeds: false alarms 1e-3
    assert table["Heun"]["mean_final"] > 1.2
    assert table["Euler-Maruyama"]["mean_final"] > 20
    assert table["midpoint, 3 iterations"]["mean_final"] < 0.9
    for name, row in table.items():
        assert row["step_difference"] < 1e-14, name
        assert row["path_difference"] < 1e-11, name


@pytest.mark.parametrize(
    "case", ["Kubo, midpoint", "synchrotron, midpoint", "two noises, (89)-(90)", "two noises, (91)-(92)"]
)
def test_residuals_vanish_on_paths_and_grow_beside_them(results, case):
    part = results["euler_lagrange"][case]
    for key in ("euler_lagrange_q", "euler_lagrange_p", "legendre_left", "legendre_right"):
        assert part[key] < 1e-14 * max(1, 10 * part["largest_state"]), key
    for eps, residual in zip(part["epsilons"], part["perturbed_residual"], strict=True):
        assert 0.3 * eps < residual < 10 * eps
    assert part["residual_exponent"] == pytest.approx(1, abs=0.02)
    assert part["action_exponent"] == pytest.approx(2, abs=0.02)
    assert part["lagrangian_difference"] < 1e-14
    assert part["boundary_form_difference"] < 1e-7


#: number of equations in each case, without the wrong print
PRINTED = {"Kubo, midpoint": 5, "synchrotron, midpoint": 3, "two noises, (89)-(90)": 2, "two noises, (91)-(92)": 5}


def test_steps_satisfy_the_printed_equations(results):
    for case, count in PRINTED.items():
        found = dict(results["euler_lagrange"][case]["printed_residuals"])
        if case == "synchrotron, midpoint":  # sigma1 dW/2 (cos(q_n/2) - cos((q_n + q_{n+1})/2)): of order 0.1 * 0.3
            assert 0.01 < found.pop("(80), second print") < 0.2
        assert len(found) == count
        assert max(found.values()) < 4e-14


@pytest.mark.parametrize("case", PRINTED)
def test_a_coefficient_one_per_cent_off_fails_the_printed_equations(case):
    """A coefficient that is one per cent off fails each equation that contains it; (79) contains none."""
    from symsde.studies.paper import euler_lagrange
    from symsde.studies.paper.experiment import Experiment

    given = next(one for one in euler_lagrange._cases() if one.label == case)
    without = {"sigma": {"(89)", "(91)", "adjoint of (89)"}, "gamma": {"(90)", "(92)", "adjoint of (90)"}}
    for name, value in given.model.parameters.items():

        def wrong(*ends, name=name, value=value, **coefficients):
            return given.printed(*ends, **coefficients | {name: 1.01 * value})

        experiment = Experiment("twin", "")
        euler_lagrange.printed_equations(experiment, dataclasses.replace(given, printed=wrong))
        unaffected = without.get(name, set()) if "two" in case else {"(79)", "(80), second print"}
        verdicts = {check.about: check.passed for check in experiment.checks if "step put in" in check.quantity}
        assert {about for about, passed in verdicts.items() if passed} == unaffected & set(verdicts)


def test_failed_expectation_gives_a_failing_exit_code(tmp_path, monkeypatch, capsys):
    """The command notices a wrong library, here a midpoint rule with a single fixed-point iteration."""
    from symsde.studies import paper

    simulate = ss.simulate

    def careless(model, **options):
        return simulate(model, **options | ({"fixed_point": 1} if options.get("scheme") == "midpoint" else {}))

    monkeypatch.setattr(ss, "simulate", careless)
    monkeypatch.setattr(paper, "EXPERIMENTS", (paper.kubo,))
    assert paper.run(tmp_path, quick=True) == 1
    assert "FAILED" in capsys.readouterr().out


def test_command_line_passes_arguments_on(tmp_path, monkeypatch, capsys):
    from symsde.cli import command_line
    from symsde.studies import paper

    monkeypatch.setattr(paper, "EXPERIMENTS", (paper.euler_lagrange,))
    assert command_line.main(["paper", "--out", str(tmp_path / "deep" / "er"), "--quick"]) == 0
    assert list(json.loads((tmp_path / "deep" / "er" / "results.json").read_text())) == ["euler_lagrange"]
    assert "(47)" in capsys.readouterr().out
