# SPDX-License-Identifier: BSD-3-Clause
"""Figures of the reports draw the given numbers: lines, marks, panels and labels are read back."""

import math
import sys
from pathlib import Path

import numpy as np
import pytest
from symsde.show import look
from symsde.studies.stability import bifurcation, long_time, stability_figure
from symsde.studies.stability.nonlinear import MOST

pytest.importorskip("matplotlib")
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "docs"))

import contraction
import mean_square_map


@pytest.fixture
def drawn(monkeypatch, tmp_path):
    """Draw by a function; gives the axes of the figure."""
    pages = []
    monkeypatch.setattr(look, "readable", pages.append)

    def draw(save, data):
        save(tmp_path / "figure.png", data)
        return pages[-1]

    return draw


def points(line):
    return np.transpose(line.get_data()).tolist()


def lines(axis):
    """The lines with a name of their own."""
    return {line.get_label(): line for line in axis.lines if not line.get_label().startswith("_")}


CURVES = {
    "energy_input": {"h": [0.5, 3.0], "midpoint": [0.9, 0.3]},
    "euler_limit": {"h": [0.25, 1.5], "euler": [1.1, 2.2]},
    "resonances": {"x": [0.5, 2.5, 3], "midpoint": [0.01, 0.02, 0.1], "stormer_verlet": [0.03, math.inf, None]},
    "quartic_steps": {"q0": [1.0, 10.0], "h": [0.1, 1.0], "iterations": [[3, 4], [5, 6]]},
    "squeezing": {"bound": [0.5, 2.4], "wrong": [0.01, 0.4], "expected": [0.02, 0.5]},
    "invariant_drift": {"steps": [100, 400], "Newton, plain": [1e-15, 0.0], "Newton, compensated": [2e-16, 3e-16]},
}


def test_expected_and_observed(drawn):
    energy, resonances, quartic, signs, drift = drawn(stability_figure.save, CURVES)
    for name, factor in (("midpoint", lambda x: 1 / (1 + x**2 / 4)), ("Euler pair", lambda x: 1 / (1 - x**2 / 4))):
        x, y = lines(energy)[f"{name}, expected"].get_data()
        np.testing.assert_allclose(y, factor(x), rtol=1e-12)
        assert x[0] == pytest.approx(0.01) and (x[-1] > 900 if name == "midpoint" else 1.9 < x[-1] < 2)
    observed = {line.get_color(): points(line) for line in energy.lines if line.get_label() == "observed"}
    assert observed == {look.colour("midpoint"): [[0.5, 0.9], [3.0, 0.3]],
                        look.colour("symplectic_euler"): [[0.25, 1.1], [1.5, 2.2]]}  # fmt: skip
    assert lines(energy)[r"$\omega h=2$"].get_xdata() == [2, 2] == lines(resonances)[r"$\omega h=2$"].get_xdata()
    assert points(lines(resonances)["midpoint"]) == [[0.5, 0.01], [2.5, 0.02], [3, 0.1]]
    assert points(lines(resonances)["stormer_verlet"]) == [[0.5, 0.03], [2.5, 1e6], [3, 1e6]]
    assert points(lines(quartic)["$q_0$ = 10"]) == [[0.1, 5], [1.0, 6]]
    assert lines(quartic)[f"allowed: {MOST}"].get_ydata() == [MOST, MOST]
    assert points(lines(signs)["expected"]) == [[0.5, 0.02], [2.4, 0.5]]
    assert points(lines(signs)["observed"]) == [[0.5, 0.01], [2.4, 0.4]]
    assert lines(signs)["solvable below 1"].get_xdata() == [1, 1]
    assert points(lines(drift)["Newton, plain"]) == [[100, 1e-15], [400, 1e-17]]
    styles = {name: line.get_linestyle() for name, line in lines(drift).items()}
    assert styles == {"Newton, plain": "-", "Newton, compensated": "--", r"$\sqrt{\mathrm{steps}}$": ":"}
    x, y = lines(drift)[r"$\sqrt{\mathrm{steps}}$"].get_data()
    np.testing.assert_allclose(y, [3e-16, 6e-16], rtol=1e-12)
    axes = energy, resonances, quartic, signs, drift
    assert [axis.get_title(loc="left") for axis in axes] == ["(a)", "(b)", "(c)", "(d)", "(e)"]
    labels = [(axis.get_xlabel(), axis.get_ylabel()) for axis in axes]
    assert labels == [
        (r"$\omega h$", "energy input / exact"),
        (r"$\omega h$ of the fast spring", "largest change of $H$"),
        ("$h$", "Newton iterations"),
        (r"$\sigma c \sqrt{h}/2$", "wrong signs"),
        ("steps", "rms change of $p^2 + q^2$"),
    ]


def test_curves_of_contraction(drawn):
    """Every curve has its numbers; one that depends on the state has two lines."""
    low, high = [0.9, 0.5], [1.1, 1.5]
    curves = {name: [low, high] if "midpoint" in name else [low, low] for name in contraction.COLOURS}
    (axis,) = drawn(contraction.save, {"z": [0.5, 1.0], "curves": curves})
    named = lines(axis)
    assert list(named) == list(contraction.CURVES)
    for name, line in named.items():
        upper = high if "midpoint" in name else low
        assert points(line) == [[0.5, upper[0]], [1.0, upper[1]]]
    others = [line for line in axis.lines if line.get_label().startswith("_")]
    assert [points(line) for line in others] == [[[0.5, 0.9], [1.0, 0.5]]]


def test_panels_of_mean_squares(drawn):
    """Every panel shows the numbers of its equation and scheme, and a line at the limit."""
    x, y = [0.1, 0.3, 1.0], [0.01, 0.1, 0.5]
    equations = list(mean_square_map.EQUATIONS)[:2]
    excess = np.array([[1e-8, 1e-4, 1.0], [1e-3, 0.1, 100.0], [0.1, 0.2, 0.3]])
    maps = [
        {"equation": equation, "scheme": scheme, "excess": (excess * 2**i * 3**j).tolist()}
        for i, equation in enumerate(equations)
        for j, scheme in enumerate(mean_square_map.SCHEMES)
    ]
    maps[0]["excess"][2][2] = None  # no second moments here
    data = {"omega_h": x, "sigma_sqrt_h": y, "stable": 0.01, "maps": maps[::-1]}
    axes = drawn(mean_square_map.save, data)
    assert len(axes) == 11 and axes[10].get_ylabel() == "log$_{10}$ of what a step adds to log E$|z|^2$"
    count = len(mean_square_map.SCHEMES)
    first, second = axes[:count], axes[count : 2 * count]  # axes in the order drawn
    for row, i in ((first, 1), (second, 0)):
        for j, axis in enumerate(row):
            mesh, contour = axis.collections
            expected = np.clip(excess * 2**i * 3**j, 1e-6, 10)
            expected[2, 2] = 10 if i == j == 0 else expected[2, 2]
            np.testing.assert_allclose(np.ravel(mesh.get_array()), np.log10(np.ravel(expected)), rtol=1e-12)
            assert mesh.get_clim() == (-6, 1) and list(contour.levels) == [0.01]
            assert (axis.get_xscale(), axis.get_yscale()) == ("log", "log")
    assert [axis.get_title() for axis in first] == list(mean_square_map.SCHEMES)
    told = [row[0].get_ylabel().partition("\n")[0] for row in (first, second)]
    assert told == [equation.partition(",")[0] for equation in equations[::-1]]
    assert {axis.get_xlabel() for axis in second} == {r"$\omega h$"} and first[0].get_xlabel() == ""


def test_points_of_the_step(drawn):
    """Points are drawn at their omega h and q, full if stable: circles for cycles, squares for fixed points."""
    found = {scheme: [] for scheme in bifurcation.DRAWN}
    shown = found | {"stormer_verlet": [[1.5, 0.25, 1, 2]], "heun": [[2.5, -3.0, 0, 1]]}
    axes = drawn(bifurcation.save, {"points": {"hardening spring": shown, "pendulum": found}})
    of = dict(zip(bifurcation.DRAWN, axes[::2], strict=True))  # the column of the spring
    cycle, plus, minus, _ = of["stormer_verlet"].lines
    assert (points(cycle), cycle.get_marker(), cycle.get_mfc()) == ([[1.5, 0.25]], "o", cycle.get_color())
    fixed = of["heun"].lines[0]
    assert (points(fixed), fixed.get_marker(), fixed.get_mfc()) == ([[2.5, -3.0]], "s", "none")
    for line, sign in ((plus, -1), (minus, 1)):
        x, y = line.get_data()
        below = x < 2
        np.testing.assert_allclose(y[below], sign * np.sqrt(4 / x[below] ** 2 - 1), rtol=1e-12)
        assert np.isnan(y[~below]).all() and not below.all()
    assert all(points(axis.lines[-1]) == [[2, 0], [2, 1]] for axis in axes)
    told = [text.get_text() for text in axes[0].figure.legends[0].get_texts()]
    assert told[:3] == ["cycle of two steps, stable", "cycle of two steps, unstable", "fixed point, unstable"]
    shown_in = [not axis.texts for axis in axes]
    assert shown_in[::2] == [name in ("stormer_verlet", "heun") for name in bifurcation.DRAWN]
    assert shown_in[1::2] == [False] * 4
    assert [axis.get_ylabel() for axis in axes[::2]] == [f"{name}\n$q$" for name in bifurcation.DRAWN]
    assert [axis.get_title() for axis in axes[:2]] == ["hardening spring", "pendulum"]
    assert {axis.get_xlabel() for axis in axes[-2:]} == {r"$\omega h$"}


def test_labels_of_energy_over_a_long_time(drawn):
    names = [prefix + scheme for prefix in ("", "kubo_") for scheme in long_time.SCHEMES]
    curves = {"t": [1.0, 10.0], "kubo_t": [1.0, 20.0], **{name: [1e-3, 2e-3] for name in names}}
    curves["heun"] = [1e-3, 1e4]
    curves["euler_maruyama"] = [1e4, 1e5]
    energy, kubo = drawn(long_time.save, curves)
    ends = {line.get_label(): (points(line), line.get_marker()) for line in energy.lines}
    assert ends["heun"] == ([[1.0, 1e-3]], "None") and len(ends["midpoint"][0]) == 2 and ends["euler_maruyama"][0] == []
    crosses = [line for line in energy.lines if line.get_marker() == "X"]
    assert [points(cross) for cross in crosses] == [[[1.0, 1e-3]]] and crosses[0].get_color() == look.colour("heun")
    told = [text.get_text() for text in energy.figure.legends[0].get_texts()]
    assert told == [*long_time.SCHEMES, "lost from here on"]
    assert (energy.get_xlabel(), energy.get_ylabel()) == ("$t$", "$|H/H_0-1|$")
    assert (kubo.get_xlabel(), kubo.get_ylabel()) == ("$t$", "rms change of $p^2+q^2$")
