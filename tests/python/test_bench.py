# SPDX-License-Identifier: BSD-3-Clause
"""The benchmarks compare like with like: scenes are the models, loops are the schemes, claims of counters hold."""

import math
import sys
from pathlib import Path

import numpy as np
import pytest
import symsde as ss

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "bench"))

from plain_rules import _synchrotron
from scenes import SCENES
from topics import left_out
from topics.loops import FEW, GROUPS, SAVED, found, rows

KNOWN = {name: scene for name, scene in SCENES.items() if scene.name}
# scene and scheme for every kind of step in `loops`
STEPS = (
    "kubo midpoint",
    "linear_oscillator midpoint",
    "noncommutative_oscillator midpoint",
    "synchrotron midpoint",
    "synchrotron lobatto3",
    "synchrotron symplectic_euler",
    "driven_pendulum stormer_verlet",
    "driven_pendulum gauss2",
    "henon_heiles symplectic_euler",
    "henon_heiles stormer_verlet",
    "fpu4 midpoint",
)


def gradient(scene, q, p, w):
    """Gradients for one path by a scene's functions, which the loop uses."""
    s = scene.functions()
    if scene.ndof == 1:
        return [-s.force(w, 0.0, q[0])], s.mass(w) * p
    f = np.empty(scene.ndof)
    s.force(w, 0.0, q, f)
    return -f, s.mass(w) * p


@pytest.mark.parametrize("name", KNOWN)
def test_functions_of_scenes_are_those_of_the_models(name):
    """The functions of scenes equal the models' gradients, and derivatives of the force equal differences; other
    parameters give other numbers.
    """
    pytest.importorskip("sympy")
    scene = KNOWN[name].of(sites=5) if KNOWN[name].sites else KNOWN[name]
    draw = np.random.default_rng(3)
    q, p, w = draw.normal(size=scene.ndof), draw.normal(size=scene.ndof), draw.normal(size=1 + scene.nnoise)
    expected = [part[:, 0] for part in scene.model().gradient(q, p, w)]
    np.testing.assert_allclose(gradient(scene, q, p, w), expected, rtol=1e-12, atol=1e-13)
    parameter = next((x for x in ("sigma", "sigma1", "s1", "gamma") if scene.values.get(x)), None)
    other = scene.of(**{parameter: 7.0 * scene.values[parameter]})
    assert np.abs(np.concatenate(gradient(other, q, p, w)) - np.concatenate(expected)).max() > 1e-5
    if scene.ndof == 1:
        s, d = scene.functions("numpy"), 1e-6
        force, derivative = s.slope(w, 0.3, q[0])
        assert force == pytest.approx(s.force(w, 0.3, q[0]), rel=1e-12)
        by_difference = (s.force(w, 0.3, q[0] + d) - s.force(w, 0.3, q[0] - d)) / (2 * d)
        assert derivative == pytest.approx(by_difference, rel=1e-7, abs=1e-8)


@pytest.mark.parametrize("name", STEPS)
def test_loops_are_the_schemes_of_the_library(name):
    """A loop and the library agree to rounding on the same increments, and differ on others."""
    pytest.importorskip("numba"), pytest.importorskip("sympy")
    from loops import loop

    scene, _, scheme = found(name)
    q0, p0, step, steps = np.full(scene.ndof, 0.7), np.full(scene.ndof, -0.2), 0.05, 20
    end = loop(scene, scheme)(np.random.default_rng(5), q0, p0, step, steps, 1)
    for seed, near in ((5, True), (6, False)):
        dw = np.random.default_rng(seed).normal(0, math.sqrt(step), (steps, scene.nnoise, 1))
        how = {"scheme": scheme, "step": step, "steps": steps, "paths": 1, "correction": "none"}
        run = ss.simulate(scene.model(), q0=q0, p0=p0, increments=dw, **how)
        assert (abs(run.q[-1, 0, 0] - end) < 1e-10) == near


def test_the_loop_of_taylor_is_the_plain_rule():
    """The loop and the rule get the same normals: dW_1, dW_2, and for each noise the part of its integral that is
    independent of dW.
    """
    pytest.importorskip("numba"), pytest.importorskip("sympy")
    from loops import loop

    scene, step, steps = SCENES["synchrotron"], 0.1, 8
    end = loop(scene, "taylor")(np.random.default_rng(5), np.array([0.7]), np.array([-0.2]), step, steps, 1)
    q, p = np.array([0.7]), np.array([-0.2])
    for dw, more in np.random.default_rng(5).normal(0, math.sqrt(step), (steps, 2, 2, 1)):
        dz = step * (dw / 2 + more / math.sqrt(12))
        q, p = _synchrotron("taylor15", q, p, step, dw, dz, *(scene.values[x] for x in ("omega", "sigma1", "sigma2")))
    assert end == pytest.approx(q[0], abs=1e-12)


@pytest.mark.parametrize("how", ["NumPy", "numba", "numba, plain"])
def test_models_of_a_user_are_the_built_in_one(how):
    import user_model

    pytest.importorskip("numba" if how.startswith("numba") else "sympy")
    mine = user_model.in_numpy() if how == "NumPy" else user_model.in_numba(plain="plain" in how)
    draw = np.random.default_rng(3)
    q, p, w = draw.normal(size=(1, 9)), draw.normal(size=(1, 9)), np.array([0.3, 0.5, -0.7])
    known = user_model.SCENE.model()
    np.testing.assert_allclose(mine.gradient(q, p, w), known.gradient(q, p, w), rtol=1e-12)
    np.testing.assert_allclose(mine.hessian(q, p, w), known.hessian(q, p, w), rtol=1e-12, atol=1e-15)


def test_claims_of_counters_hold(monkeypatch):
    """A claim that does not hold is reported."""
    monkeypatch.setattr(left_out, "ROWS", (*left_out.ROWS, ("explicit_calls_no_solver", "kubo", "midpoint", {})))
    *verdicts, planted = [row["verdict"] for row in left_out.measure(None)]
    assert set(verdicts) == {"ok"} and planted == "FAILED"


def test_rows_of_loops_name_scenes():
    """Every row has a scene and a group named on the page; names are distinct."""
    assert {f"{name} {scheme}" for name, schemes in FEW.items() for scheme in schemes} >= set(SAVED)
    assert found("fpu16 gauss2")[0].nnoise == 16 and found("mean_field4 midpoint")[0].values["N"] == 4
    keys = [(row.group, row.name) for row in rows()]
    assert len(keys) == len(set(keys)) and {group for group, _ in keys} == set(GROUPS)
