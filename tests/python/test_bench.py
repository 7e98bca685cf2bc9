# SPDX-License-Identifier: BSD-3-Clause
"""The benchmarks compare like with like: scenes are the models, loops are the schemes, claims of counters hold."""

import dataclasses
import math
import sys
from pathlib import Path

import numpy as np
import pytest
import symsde as ss

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "bench"))

from plain_rules import _synchrotron
from run import replaced
from scenes import SCENES
from topics import left_out, open_systems, strong
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


def ends_of_loops(name, scene, steps, paths=1):
    """Sum of final positions of a numba loop, and the normal numbers that it drew."""
    from peers import langevin

    where = langevin.SCENES[scene]
    run = langevin.loop(name, where)
    total = run(np.random.default_rng(5), where.q0, where.p0, where.horizon / steps, steps, paths)
    return total, np.random.default_rng(5).normal(size=steps * where.dof * 2)


@pytest.mark.parametrize("scene", ["double well", "fpu64"])
@pytest.mark.parametrize("name", ["BAOAB", "Strang"])
def test_splittings_are_their_equations_and_the_library_s(name, scene):
    """Loop, NumPy and the library's word agree on the same increments; other increments give other ends."""
    pytest.importorskip("numba"), pytest.importorskip("sympy")
    from peers import langevin

    steps, where = 40, langevin.SCENES[scene]
    total, normals = ends_of_loops(name, scene, steps)
    dw = math.sqrt(0.1) * normals[: steps * where.dof].reshape(steps, where.dof, 1)
    end = langevin.given(name, where, dw)
    assert total == pytest.approx(end[0, 0], abs=1e-10)
    assert abs(langevin.given(name, where, 1.01 * dw)[0, 0] - total) > 1e-4
    if name == "BAOAB":
        how = {"q0": np.array(where.q0), "p0": 0.0, "step": 0.1, "steps": steps, "increments": dw}
        run = ss.simulate(open_systems.damped(scene), scheme="word:BAOAB", **how)
        np.testing.assert_allclose(np.concatenate([run.q[-1], run.p[-1]]), end, rtol=0, atol=1e-11)


@pytest.mark.parametrize("scene", ["double well", "fpu64"])
def test_ubu_is_made_of_exact_flights(scene):
    """One step is two flights around a kick; flights of half the length merge into one with the law of the whole."""
    pytest.importorskip("numba")
    from peers import langevin

    where, (_, _, a, b, c) = langevin.SCENES[scene], langevin.flight(2.0)
    n = where.dof
    total, normals = ends_of_loops("UBU", scene, 1)
    x, y = normals[: 2 * n].reshape(n, 2).T
    u, v = np.random.default_rng(5).normal(size=2 * n + 2)[2 * n :]
    noise = np.zeros((2, 2, n, 1))
    noise[0, :, :, 0] = a * x, b * x + c * y
    noise[1, 1, 0, 0] = b * u + c * v
    assert total == pytest.approx(langevin.given("UBU", where, noise)[0, 0], rel=1e-12)
    unit = np.array([[a, b], [0, c], [0, 0], [0, 0]])  # (normal, E or D) of the first flight, then of the second
    first = np.stack([unit, np.roll(unit, 2, axis=0)])[:, :, :, None].transpose(0, 2, 3, 1)  # (flight, 2, dof, normal)
    merged = langevin.flights(first, 2.0)[0, :, 0]
    _, _, a, b, c = langevin.flight(4.0)
    np.testing.assert_allclose(merged @ merged.T, [[a * a, a * b], [a * b, b * b + c * c]], rtol=1e-13)


def test_splittings_have_their_orders():
    """Strong orders one and two in the double well, as fitted between few steps, within 0.15."""
    pytest.importorskip("numba"), pytest.importorskip("sympy")
    for name, errors in open_systems.their_errors("double well").items():
        (n0, e0), *_, (n1, e1) = sorted(errors.items())
        order = math.log(e0 / e1) / math.log(n1 / n0)
        assert abs(order - (2 if name == "UBU" else 1)) < 0.15, name


def test_steps_to_an_error_follow_a_power_law():
    errors = {10: 1e-2, 20: 2.5e-3, 40: 6.25e-4}
    steps, beyond = strong.steps_to(errors, 1e-3)
    assert steps == pytest.approx(10 * math.sqrt(10)) and not beyond
    steps, beyond = strong.steps_to(errors, 1e-4)
    assert steps == pytest.approx(100) and beyond
    steps, beyond = strong.steps_to(errors, 4e-2)
    assert steps == pytest.approx(5) and beyond


def test_a_section_takes_the_place_of_its_old_one():
    page = "# Tables\n\n## One\n\n1\n\n## Two\n\n2\n\n### deeper\n\n3\n\n## Three\n\n4\n"
    assert replaced(page, "## Two\n\nnew") == "# Tables\n\n## One\n\n1\n\n## Two\n\nnew\n\n## Three\n\n4\n"
    assert replaced(page, "## Three\n\nnew").endswith("3\n\n## Three\n\nnew\n")
    assert replaced(page, "## Four\n\nnew") == page + "\n## Four\n\nnew\n"


def test_tables_of_damped_systems_judge_each_row():
    """A peer beside the library within its target, one beyond, and the verdicts."""
    row = {"scene": "double well", "ns": 10.0, "beyond": False, "errors": {}}
    ours = {**row, "package": "symsde", "scheme": "chin4a", "steps": 40.2, "us": 0.41}
    slow = {**row, "package": "numba", "scheme": "BAOAB", "steps": 30000.0, "us": 300.0, "beyond": True}
    near = {**row, "package": "numba", "scheme": "UBU", "steps": 200.0, "us": 2.0}
    chain = {**ours, "scene": "fpu64"}
    first, second, third, _ = open_systems.strong_table([slow, ours, near, chain]).splitlines()[2:]
    assert "| symsde chin4a | 41     | 10 " in first and "met" not in first
    assert "0.2 " in second and "missed" in second
    assert "3e+04*" in third and third.endswith("| met    |")
    cheap = {
        "package": "symsde",
        "scheme": "chin4a",
        "bias": {0.4: (1e-3, 1e-4)},
        "ns": 10.0,
        "step": 0.4,
        "cost": 25.0,
    }
    rows = [cheap, {**cheap, "package": "OpenMM", "scheme": "LangevinMiddle, CPU", "cost": 100.0}]
    text = open_systems.bias_table(rows)
    assert "+1.00 +- 0.10 at 0.4" in text and "0.25" in text and "missed" in text


BROUGHT = (
    "double well",
    "Duffing, 2 degrees",
    "3 bodies",
    "phi^4 ring of 64",
    "magnetic field",
    "Schroedinger lattice of 16",
)


@pytest.mark.parametrize("scene", BROUGHT)
def test_loops_of_brought_scenes_solve_their_formulas(scene):
    """With dW_k proportional to h the equation is an ordinary one. All loops come near to the library's solution, as
    order two does; a noise of another size is far away. A loop on its own normals is the loop on given ones.
    """
    pytest.importorskip("numba"), pytest.importorskip("sympy")
    from peers import brought
    from topics import brought as topic

    assert tuple(brought.SCENES) == BROUGHT
    where, steps, horizon = brought.SCENES[scene], 250, 0.5
    where = dataclasses.replace(where, horizon=horizon)
    h, rates = horizon / steps, np.cos(np.arange(where.noises) + 0.3)
    how = {"q0": where.q0, "p0": where.p0, "step": h, "steps": steps, "scheme": "gauss2", "correction": "none"}
    dw = np.broadcast_to(h * rates[:, None], (steps, where.noises, 1))
    run = ss.simulate(topic.model(scene), increments=dw, **how)
    known = np.concatenate([run.q[-1], run.p[-1]])
    for name in where.loops:
        parts = np.concatenate([dw / 2, dw / 2], axis=1) if name == "Gauss" else dw
        np.testing.assert_allclose(brought.given(name, where, parts), known, atol=1e-5, rtol=0)
        assert np.abs(brought.given(name, where, 1.01 * parts) - known).max() > 1e-4
        if scene != "magnetic field":  # loops of all scenes draw alike, and each takes seconds to compile
            continue
        total = brought.loop(name, where)(np.random.default_rng(5), where.q0, where.p0, h, 3, 1)
        x = np.random.default_rng(5).normal(0, math.sqrt(h), (3, where.noises, 2 if name == "Gauss" else 1))
        drawn = np.concatenate([x.sum(axis=2), x[..., 0] - x[..., 1]], axis=1) / 2 if name == "Gauss" else x[..., 0]
        short = dataclasses.replace(where, horizon=3 * h)
        assert total == pytest.approx(brought.given(name, short, drawn[..., None])[0, 0], abs=1e-12)


def test_tables_of_brought_scenes_judge_each_row():
    """The library's best scheme, and a verdict for every loop."""
    from topics import brought

    row = {"scene": "magnetic field", "ns": 10.0, "to": [(100.0, False), (1000.0, True)], "errors": {}}
    slow = {**row, "package": "symsde", "scheme": "midpoint", "us": [9.0, 90.0]}
    ours = {**row, "package": "symsde", "scheme": "gauss_dkdkd", "us": [1.1, 11.0]}
    near = {**row, "package": "numba", "scheme": "Gauss", "us": [1.0, 10.0]}
    far = {**row, "package": "numba", "scheme": "Strang", "us": [1.0, 10.0]}
    first, second, third = brought.strong_table([slow, ours, near, far], 1).splitlines()[2:]
    assert "symsde gauss_dkdkd | 1e+03* " in first and "met" not in first and "missed" not in first
    assert "| 1.1   | <= 1.2 | met" in second
    assert "| 1.1   | <= 1   | missed" in third
    verlet = {**slow, "scheme": "stormer_verlet", "alone": 25.0, "ns": 5.0}
    (line,) = brought.scheme_table([verlet, near, far]).splitlines()[2:]
    assert [x.strip() for x in line.split("|")[3:7]] == ["5", "25", "10", "0.5"]


def test_adjoint_by_hand_has_the_gradients_of_the_library():
    """On the same increments, path by path; its means are those of its own normals."""
    pytest.importorskip("numba"), pytest.importorskip("sympy")
    from peers import adjoint
    from topics import gradients

    how = {**gradients.START, "step": gradients.STEP, "steps": 50, "paths": 2, "scheme": "stormer_verlet"}
    dw = 0.1 * np.cos(0.03 * np.arange(100.0)).reshape(50, 1, 2)
    found = ss.gradient(gradients.model(), "q**2", ["k", "sigma"], **how, increments=dw)
    values, room = (*gradients.START.values(), gradients.K, gradients.SIGMA, gradients.STEP), np.empty((2, 51))
    for i in range(2):
        mine = adjoint.swept(np.ascontiguousarray(dw[:, 0, i]), *room, *values)
        np.testing.assert_allclose(mine, [found.f[i], *(found.by_path[x][i] for x in ("k", "sigma"))], rtol=1e-11)
    drawn = math.sqrt(gradients.STEP) * np.random.default_rng(5).standard_normal(50)
    mean = adjoint.run(np.random.default_rng(5), *values, 50, 1)
    np.testing.assert_allclose(mean, adjoint.swept(drawn, *room, *values), rtol=1e-11)


def test_table_of_gradients_judges_its_rows():
    """A gradient in forward runs, and a share of each peer's time."""
    from topics import gradients

    ns = {name: 10.0 for scheme in gradients.SCHEMES for name in (scheme, f"{scheme} forward")}
    ns |= {"stormer_verlet forward": 3.0, "numba, by hand": 9.0, "diffrax RecursiveCheckpointAdjoint": 600.0}
    given = {"ns": ns, "versions": ["numba 1"], "date": "2026-01-01", "cpu": "cpu"}
    text = gradients.section({**given, "sites": {"two": 1.0, "springs": 1.4}})
    first, *_, numba, diffrax = text.split("\n\n")[2].splitlines()[-7:]
    assert "1.4 of the time with two parameters (target <= 1.3: missed)" in " ".join(text.split())
    assert "3.33" in first and "missed" in first and "| 1.1 " in numba and "missed" in numba and "met" in diffrax
