# SPDX-License-Identifier: BSD-3-Clause
"""Heun's rule and Taylor's rule of order 1.5, used for comparison in the figure of horizons, by their orders on
given paths.
"""

import json
import math
import sys
from pathlib import Path

import numpy as np
import pytest
import symsde as ss
from symsde.answers.expectation.problem import make_problem

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "bench"))

import horizons
import plain_rules

STRONG = (2.0, 0.4, 0.3)


def plain(model, parameters):
    """Runs of both rules to time 2 from (1, 0)."""
    problem = make_problem(model, lambda q, p: np.zeros(q.shape[1]), q0=1.0, p0=0.0, horizon=2.0)
    return plain_rules.Plain(problem, parameters)


def ends(runs, rule, steps, finest=2048, paths=200):
    """Final states (q and p, path) on the path that is drawn with `finest` steps."""
    run = runs.run(rule, steps, paths=paths, refine=(finest // steps).bit_length() - 1)
    return np.concatenate([run.q[-1], run.p[-1]])


def rms(difference):
    return math.sqrt(np.square(difference).sum(axis=0).mean())


def slope(errors, steps):
    return -np.polyfit(np.log(steps), np.log(errors), 1)[0]


def orders(runs, truth, steps=(32, 64, 128, 256)):
    """Measured strong orders of both rules."""
    return [slope([rms(ends(runs, rule, n) - truth) for n in steps], steps) for rule in plain_rules.RULES]


def test_orders_on_the_synchrotron_and_a_planted_dz(monkeypatch):
    """Orders against Heun's rule at the finest step, which is another rule; with half of h dW for dZ the order is 1."""
    runs = plain(ss.models.synchrotron(*STRONG), STRONG)
    truth = ends(runs, "taylor15", 2048)
    assert rms(ends(runs, "heun", 2048) - truth) < 5e-4
    found = orders(runs, truth)
    assert found[0] == pytest.approx(1.05, abs=0.15) and 1.45 < found[1] < 2.1
    drawn = plain_rules._drawn

    def without_dz(generator, h, *more):
        dw, _ = drawn(generator, h, *more)
        return np.stack([dw, h * dw / 2])

    monkeypatch.setattr(plain_rules, "_drawn", without_dz)
    assert orders(runs, truth)[1] < 1.2


def test_orders_on_kubo_s_oscillator():
    """Orders against the exact rotation with the W of the steps."""
    runs = plain(ss.models.kubo(1.0, 0.5), (1.0, 0.5))
    generator = np.random.default_rng(plain_rules._SEED)
    turn = 2.0 + 0.5 * sum(plain_rules._drawn(generator, 2.0 / 2048, 1, 1, 200)[0, 0] for _ in range(2048))
    found = orders(runs, np.array([np.cos(turn), -np.sin(turn)]))
    assert found[0] == pytest.approx(1.05, abs=0.15) and found[1] == pytest.approx(1.55, abs=0.15)


def test_heun_is_that_of_the_library(monkeypatch):
    dw = ss.increments(ss.models.synchrotron(*STRONG), step=0.125, steps=16, paths=5, seed=3)
    for model, parameters in ((ss.models.synchrotron(*STRONG), STRONG), (ss.models.kubo(1.0, 0.5), (1.0, 0.5))):
        given = iter(dw[:, : model.nnoise])
        monkeypatch.setattr(plain_rules, "_drawn", lambda *_, given=given: (next(given), None))
        found = plain(model, parameters).run("heun", 16, paths=5)
        how = {"scheme": "heun", "step": 0.125, "steps": 16, "increments": dw[:, : model.nnoise], "paths": 5}
        run = ss.simulate(model, q0=1.0, p0=0.0, **how)
        np.testing.assert_allclose([found.q[-1], found.p[-1]], [run.q[-1], run.p[-1]], rtol=1e-11, atol=1e-12)


def test_dw_and_dz_have_their_covariance():
    """Covariances h, h^2/2, h^3/3, however a step is summed: within 4.5 standard errors of 10^5 paths."""
    for parts in (1, 4):
        dw, dz = plain_rules._drawn(np.random.default_rng(1), 0.5, parts, 1, 100_000)[:, 0]
        for product, value in ((dw * dw, 0.5), (dw * dz, 0.125), (dz * dz, 0.125 / 3)):
            assert abs(product.mean() - value) < 4.5 * product.std() / math.sqrt(1e5)


def test_the_circle_of_the_invariant_law():
    """Midpoint never leaves the circle; with this number of steps Heun's rule stays within 0.01 of the circle, with
    half of it it does not.
    """
    assert horizons.cost(horizons.Circle, 0.01, 10.0, "midpoint")["steps"] < 30
    for name in ("heun", "taylor15"):
        steps = horizons.cost(horizons.Circle, 0.01, 10.0, name)["steps"]
        runs = horizons.Plain(horizons._problem(horizons.Circle, horizons.KUBO, 10.0), horizons.KUBO)
        off = []
        for n in (steps // 2, 2 * steps):
            run = runs.run(name, n, paths=256)
            off.append(rms(np.hypot(run.q[-1], run.p[-1]) - 1))
        assert off[0] > 0.01 > off[1], name


def test_the_figure_of_horizons_shows_its_rows(monkeypatch, tmp_path):
    """The figure has every scheme for every accuracy, at its horizons; accuracies that no step reaches are left out."""
    pytest.importorskip("matplotlib")
    data = json.loads((Path(__file__).resolve().parents[2] / "docs/figures/horizons.json").read_text(encoding="utf-8"))
    pages = []
    monkeypatch.setattr("symsde.show.look.readable", pages.append)
    horizons.save(tmp_path / "figure.png", data)
    assert [axes.get_title() for axes in pages[0]] == [words for _, _, words in horizons.WANTS]
    for axes in pages[0]:
        expected = {}
        for row in data["rows"]:
            if row["want"] == axes.get_title() and row["steps"]:
                expected.setdefault(row["scheme"], []).append([row["horizon"], row["microseconds"]])
        drawn = {line.get_label(): np.transpose(line.get_data()).tolist() for line in axes.lines}
        assert drawn == expected and {"heun", "taylor15"} < set(drawn)
