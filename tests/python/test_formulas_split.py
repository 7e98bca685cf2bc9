# SPDX-License-Identifier: BSD-3-Clause
"""Formulas find the quadratic part of H whose flow stands between kicks, or are told it by split=."""

import pickle

import numpy as np
import pytest
import symsde as ss
from symsde import errors
from symsde.model.formulas.formula_scenes import from_table

pytestmark = pytest.mark.usefixtures("quick_compiler")

FIELD = "((p1 + b*q2)**2 + (p2 - b*q1)**2)/2"
STATE = {"q0": [1.0, 0.0], "p0": [0.0, 0.5], "seed": 3, "step": 0.05, "steps": 40, "paths": 20}
VALUES = {"b": 1.5, "s": 0.3}
SPRINGS = "p1**2/2 + p2**2/2 + k*(q1 - q2)**2/2"


def field_of(b, stiffness=0.0):
    square = np.array([[b * b, 0, 0, -b], [0, b * b, b, 0], [0, b, 1, 0], [-b, 0, 0, 1]])
    return square + np.diag([stiffness, stiffness, 0, 0])


@pytest.mark.parametrize(
    ("potential", "stiffness"),
    [
        ("(q1**2 + q2**2)/2 + (q1**4 + q2**4)/4", 1.0),  # bounded motion at rest: kicks by the quartic alone
        ("-(q1**2 + q2**2)/2 + (q1**4 + q2**4)/4", 0.0),  # two wells: kicks by all of it, which vanish in a well
        ("(q1**4 + q2**4)/4", 0.0),
    ],
)
def test_the_split_that_leaves_less_is_taken(potential, stiffness):
    model = ss.model_from_sympy(f"{FIELD} + {potential}", ["s*q1", "s*q2"], params=VALUES)
    np.testing.assert_allclose(model.traits.split, field_of(1.5, stiffness), rtol=1e-14)
    assert model.traits.kicked
    assert model.formula.structure.split == model.traits.split


@pytest.mark.parametrize("noise", [["s*q1", "s*q2"], ["s*sin(q1)", "s*cos(q2)"]])
@pytest.mark.parametrize("scheme", ["gauss_dkdkd", "verlet_kdk", "chin4a", "gauss_dkdkd_strong2"])
@pytest.mark.parametrize("sign", [1, -1])
def test_whole_steps_are_those_of_the_library(noise, scheme, sign):
    """Generated steps and the library's, blocks and single paths, and those of a model of functions with this S."""
    potential = "q1**4/4 + cos(q2 - q1)"
    model = ss.model_from_sympy(f"{FIELD} + {potential}", noise, params=VALUES)
    given = {**STATE, "step": sign * 0.05, "scheme": scheme}
    run, oracle = ss.simulate(model, **given), ss.simulate(model, general=True, **given)
    assert ("whole steps" in run.report.stepper) == (
        scheme == "gauss_dkdkd" or (scheme == "verlet_kdk" and noise[0] == "s*q1")
    )
    assert "kicks between flows of a quadratic part" in oracle.report.stepper
    np.testing.assert_allclose([run.q, run.p], [oracle.q, oracle.p], rtol=0, atol=2e-13)
    one = ss.simulate(model, **given | {"paths": 1}, first_path=7)
    np.testing.assert_array_equal([one.q[:, :, 0], one.p[:, :, 0]], [run.q[:, :, 7], run.p[:, :, 7]])
    assert ss.diagnose.symplecticity(model, scheme, q=[0.6, 0.2], p=[0.3, -0.4], step=0.2)[0] < 5e-14


def test_other_values_have_a_split_of_their_own():
    formula = f"{FIELD} + k*(q1**4 + q2**4) + cos(q1)"
    values = {**VALUES, "k": 0.4}
    model = ss.model_from_sympy(formula, ["s*q1"], params=values)
    for more in ({"b": 2.0}, {"k": 0.1}, {"b": 1.0}, {"b": 0.0}, {"b": -0.5, "k": 3.0}):
        other, new = model.with_parameters(**more), ss.model_from_sympy(formula, ["s*q1"], params=values | more)
        assert other.traits.split == new.traits.split
        runs = [ss.simulate(x, scheme="gauss_dkdkd", **STATE) for x in (other, new)]
        np.testing.assert_array_equal(runs[0].q, runs[1].q)
    assert model.with_parameters(b=0.0).traits.split is None
    again = pickle.loads(pickle.dumps(model.with_parameters(b=2.0)))
    assert again.traits.split == model.with_parameters(b=2.0).traits.split


def test_parameters_by_path():
    """Arrays may not decide on S, which is that of all paths: where V holds some, split= says S. Then paths have the
    numbers of their own model."""
    k = np.linspace(0.1, 0.4, 20)
    formula = f"{FIELD} + k*q1**4"
    model = ss.model_from_sympy(formula, ["s*q1"], params={**VALUES, "k": k}, split=FIELD)
    run = ss.simulate(model, scheme="gauss_dkdkd", **STATE)
    one = ss.simulate(model.with_parameters(k=float(k[7])), scheme="gauss_dkdkd", **STATE | {"paths": 1}, first_path=7)
    np.testing.assert_allclose(one.q[:, :, 0], run.q[:, :, 7], rtol=0, atol=1e-13)
    for more in ({"b": k}, {"k": k}):
        by_field = ss.model_from_sympy(formula, ["s*q1"], params={"s": 0.3, "k": 0.1, "b": 1.5, **more})
        assert by_field.traits.split is None
        with pytest.raises(errors.IncompatibleError, match="parameters that differ by path"):
            ss.simulate(by_field, scheme="gauss_dkdkd", **STATE)


def test_stiff_springs_by_hand():
    """A spring of frequency 28 at h = .1, taken exactly: the error is that of the soft force, as of a soft spring."""
    formula, noise = f"{SPRINGS} + q1**4/4 + q2**4/4", ["s*q1", "s*q2"]

    def error(stiffness, split):
        model = ss.model_from_sympy(formula, noise, params={"k": stiffness, "s": 0.1}, split=split)
        found = []
        for level in (0, 6):
            steps = 20 * 2**level
            given = {"step": 2 / steps, "steps": steps, "save_every": steps, "refine": 6 - level, "paths": 100}
            run = ss.simulate(model, q0=[0.6, 0.5], p0=[0.0, 0.3], seed=4, scheme="gauss_dkdkd", **given)
            found.append(np.concatenate([run.q[-1], run.p[-1] / np.sqrt(stiffness)]))
        return np.sqrt(((found[0] - found[1]) ** 2).sum(axis=0).mean())

    with pytest.warns(errors.DoubtfulRunWarning, match=r"h\*omega"):
        free = error(400.0, None)
    exact = error(400.0, SPRINGS)  # without a warning
    assert exact < 3e-3 < 0.01 * free, (exact, free)


def test_a_scene_says_the_split():
    table = {"H": f"{SPRINGS} + q1**4/4", "noise": ["s*q1"], "params": {"k": 9.0, "s": 0.1}, "split": SPRINGS}
    second = np.diag([0.0, 0.0, 1.0, 1.0])
    second[:2, :2] = 9 * np.array([[1, -1], [-1, 1]])
    np.testing.assert_array_equal(from_table(table).traits.split, second)
    with pytest.raises(errors.InvalidArgumentError, match="write formulas"):
        from_table(table | {"split": 1.0})


@pytest.mark.parametrize(
    ("split", "told"),
    [
        (f"{SPRINGS} + q1**4", "no quadratic form"), (f"{SPRINGS} + q1", "no quadratic form"),
        (f"{SPRINGS} + t*q1**2", "no quadratic form"), ("p1**2/2", "depends on a momentum"),
        (f"{SPRINGS} + p1**2", "depends on a momentum"), ("x", "not given"),
    ],
)  # fmt: skip
def test_wrong_splits_are_refused(split, told):
    with pytest.raises(errors.InvalidArgumentError, match=told):
        ss.model_from_sympy(f"{SPRINGS} + q1**4/4", ["s*q1"], params={"k": 9.0, "s": 0.1}, split=split)


@pytest.mark.parametrize(
    ("hamiltonian", "noise", "told"),
    [
        ("p1**2*(1 + q2**2)/2 + p2**2/2 + q1*p2", "q1", "not quadratic in what holds momenta.*q_2"),
        ("p1**2/2 + p2**2/2 + q1*p2 + q2**4", "p1*q1", r"the noise 'p1\*q1' holds momenta and does not commute"),
        ("p1**2/2 + p2**2/2 + q1*p2 + p1 + q2**4", "q1", "linear in p alone"),
        ("p1**2/2 + p2**2/2 + cos(t)*q1*p2 + q2**4", "q1", "second derivative by p has t"),
    ],
)
def test_what_is_in_the_way_of_a_split_is_named(hamiltonian, noise, told):
    model = ss.model_from_sympy(hamiltonian, [noise])
    assert model.traits.split is None
    with pytest.raises(errors.IncompatibleError, match=told):
        ss.simulate(model, scheme="gauss_dkdkd", **STATE)


def test_sums_over_sites_take_no_split():
    with pytest.raises(errors.InvalidArgumentError, match="models of n sites take no quadratic part"):
        ss.model_from_sympy("Sum(p[i]**2/2 + q[i]**4, i)", [], n=8, split="p1**2")
