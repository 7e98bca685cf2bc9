# SPDX-License-Identifier: BSD-3-Clause
"""Benchmarks of other packages: the equations are those of the models, and the page shows the measured numbers."""

import json
import math
import re
import sys
from pathlib import Path

import numpy as np
import pytest
import symsde as ss

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "bench"), str(ROOT / "docs")]

import typeset  # noqa: E402
from peers import compared as peers  # noqa: E402
from peers import page as peers_page  # noqa: E402
from peers.equations import PROBLEMS  # noqa: E402
from peers.models import MODELS  # noqa: E402
from peers.numpy_steps import heun_step, integrated, rk4_step  # noqa: E402


@pytest.mark.parametrize("name", PROBLEMS)
def test_slopes_are_those_of_the_models(name):
    """H_p and -H_q, weighted as in a step."""
    problem, model, rng = PROBLEMS[name], MODELS[name], np.random.default_rng(1)
    q, p = rng.standard_normal((2, problem.dof, 7))
    w = rng.standard_normal((problem.noises, 7))
    for i in range(7):
        hq, hp = model.gradient(q[:, i : i + 1], p[:, i : i + 1], np.array([0.3, *w[:, i]]))
        dq, dp = problem.slope(np, q[:, i : i + 1], p[:, i : i + 1], 0.3, w[:, i : i + 1])
        np.testing.assert_allclose(np.broadcast_to(dq, hp.shape), hp, rtol=1e-12, atol=1e-13)
        np.testing.assert_allclose(dp, -hq, rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("name", PROBLEMS)
def test_heun_is_the_library_s_and_the_numba_loop(name):
    problem, model = PROBLEMS[name], MODELS[name]
    h = problem.horizon / 16
    dw = ss.increments(model, step=h, steps=16, paths=5, seed=3)
    ours = ss.simulate(
        model, q0=np.array(problem.q0), p0=np.array(problem.p0), scheme="heun", step=h, steps=16, increments=dw, paths=5
    )
    end = np.concatenate([ours.q[-1], ours.p[-1]])
    np.testing.assert_allclose(integrated(problem, 16, dw, heun_step), end, rtol=1e-11, atol=1e-12)
    pytest.importorskip("numba")
    from peers import numba_loop

    np.testing.assert_allclose(numba_loop.heun(problem, 16, dw).run(), end, rtol=1e-11, atol=1e-12)


def test_runge_kutta_turns_kubo_s_oscillator_with_order_four():
    """The Runge-Kutta rule approaches the exact rotation by t + 0.3 W: twice the steps, with W shared evenly, leave
    1/16 of the error.
    """
    problem = PROBLEMS["kubo"]
    errors = []
    for steps in (16, 32):
        end = integrated(problem, steps, np.full((steps, 1, 1), 2.0 / steps), rk4_step)[:, 0]
        turn = 4.0 + 0.3 * 2.0
        errors.append(np.hypot(end[0] - math.cos(turn), end[1] + math.sin(turn)))
    assert 14 < errors[0] / errors[1] < 18


def rows(**curves):
    """Rows of one problem from (error, seconds)."""
    return [
        {"problem": "kubo", "package": name.partition("__")[0].replace("_", " "), "scheme": name.partition("__")[2],
         "steps": i, "error": e, "seconds": s, "first": 0.0}
        for name, points in curves.items() for i, (e, s) in enumerate(points)
    ]  # fmt: skip


def test_seconds_to_an_error_are_between_points_and_never_beyond():
    points = [(1e-1, 1.0), (1e-3, 100.0)]
    assert peers.seconds_to(points, 1e-2) == pytest.approx(10.0)
    assert peers.seconds_to(points, 10**-1.5) == pytest.approx(10**0.5)
    assert peers.seconds_to(points, 0.5) == 1.0 and peers.seconds_to(points, 1e-3) == 100.0
    assert peers.seconds_to(points, 1e-4) is None


def test_the_page_says_who_wins_and_by_how_much():
    found = rows(symsde__a=[(1e-1, 2.0), (1e-3, 200.0)], fast__b=[(1e-1, 1.0), (1e-2, 5.0)], slow__c=[(1e-2, 200.0)],
                 lost__d=[(1e-9, 1.0)])  # fmt: skip
    assert peers.compared(found, "kubo") == {
        ("fast", "b"): (pytest.approx(0.25), pytest.approx(0.5), 0),
        ("slow", "c"): (pytest.approx(10.0), pytest.approx(10.0), 0),
        ("lost", "d"): None,
    }
    said = peers.sentence(found, "kubo")
    assert "**A peer wins:** fast b is up to 4 times faster than symsde at every error" in said
    assert "slow c takes 10 times as long" in said and "lost d came to no error" in said
    without = [row for row in found if row["package"] != "fast"]
    assert peers.sentence(without, "kubo").startswith("symsde is the fastest")


def test_the_committed_page_is_that_of_its_data():
    """The committed page has the sentences about winners, and every table."""
    data = json.loads((ROOT / "docs/figures/peers.json").read_text())["peers"]
    text = re.sub(r"\s+", " ", (ROOT / "docs/peers.md").read_text())
    for part in peers_page.tables(data):
        assert re.sub(r"\s+", " ", typeset.markdown(part)) in text
    for problem in dict.fromkeys(row["problem"] for row in data):
        known = {row["package"] for row in data if row["problem"] == problem}
        assert known >= {"symsde, given", "symsde, own", "numba_loop"}


def test_other_packages_are_drawn_at_their_errors_and_seconds():
    axes = pytest.importorskip("matplotlib.figure").Figure().subplots()
    peers.draw(axes, rows(slow__c=[(1e-2, 200.0), (1e-3, 300.0), (math.inf, 1.0)], symsde__a=[(1e-1, 2.0)]))
    drawn = {line.get_label(): line for line in axes.lines}
    assert set(drawn) == {"slow c", "symsde a"}
    assert list(drawn["slow c"].get_xdata()) == [200.0, 300.0] and list(drawn["slow c"].get_ydata()) == [1e-2, 1e-3]
    assert (drawn["slow c"].get_linestyle(), drawn["symsde a"].get_linestyle()) == ("--", "-")
