# SPDX-License-Identifier: BSD-3-Clause
"""One name has one meaning, in formulas, columns, observers and f, or is refused."""

import numpy as np
import pytest
import sympy
import symsde as ss

MICRO, MU = "\u00b5", "\u03bc"  # two characters, of which Python's parser reads both as the second
OSCILLATORS = "({0}**2 + {1}**2)/2 + {2}**2/2 + 2*{3}**2"
START = {"q0": [1.0, 2.0], "p0": [0.3, 0.4], "step": 0.1, "steps": 4, "paths": 8}


def model(q, p, **more):
    """Two oscillators with these names of coordinates."""
    return ss.model_from_sympy(OSCILLATORS.format(*p, *q), q=q, p=p, **more)


NAMES = [
    (["q_1", "q_2"], ["p_1", "p_2"]),
    (["q1", "q2"], ["p1", "p2"]),
    (["x", "y"], ["u", "v"]),
    (["q", "r"], ["p", "s"]),
]


@pytest.mark.parametrize(("q", "p"), NAMES, ids=[names[0][1] for names in NAMES])
def test_a_name_is_one_coordinate_everywhere(q, p):
    mine = model(q, p)
    every = [*zip(q, ("q_1", "q_2"), strict=True), *zip(p, ("p_1", "p_2"), strict=True)]
    names = {name: column for own, column in every for name in (own, column, column.replace("_", ""))}
    own = {column: column if own[0] in "qp" else own for own, column in every}  # the name in results
    assert [*own.values(), "energy"] == list(ss.simulate(mine, **START).columns())
    observables = {f"my_{name}": name for name in names}
    of = {f"h_{column}": ss.observe.Quantiles(column, shares=[0.5]) for column in set(names.values())}
    found = ss.moments(mine, **START, observables=observables, observers=of)
    run = ss.simulate(mine, **START)
    for name, column in names.items():
        states, k = getattr(run, column[0]), int(column[-1]) - 1
        expected = states[:, k].mean(axis=1)
        np.testing.assert_allclose(found.mean[f"my_{name}"], expected, rtol=1e-14)
        np.testing.assert_allclose(found.table("mean")[:, found.columns().index(own[column])], expected, rtol=1e-14)
        np.testing.assert_allclose(found.observed[f"h_{column}"].quantile[:, 0], expected, rtol=0.02)
        start = {key: START[key] for key in ("q0", "p0")}
        answer = ss.mlmc(mine, name, **start, horizon=0.4, steps=4, abs=0.01)
        assert answer.value == pytest.approx(expected[-1], abs=0.02)


REFUSED = [
    (["q_0", "q_1"], ["p_0", "p_1"], "q_0 is at place 1 of q, which results, observables and files call q_1"),
    (["q0", "q1"], ["p0", "p1"], "q0 is at place 1 of q"),
    (["q2", "q1"], ["p2", "p1"], "q2 is at place 1 of q"),
    (["x", "q1"], ["u", "v"], "q1 is at place 2 of q"),
    (["x", "y"], ["u", "p_1"], "p_1 is at place 2 of p"),
    (["p", "y"], ["q", "v"], "p is at place 1 of q"),
]


@pytest.mark.parametrize(("q", "p", "words"), REFUSED, ids=[str(case[0]) for case in REFUSED])
def test_coordinates_are_counted_as_columns_are(q, p, words):
    with pytest.raises(ss.errors.InvalidArgumentError, match=words):
        model(q, p)


def test_functions_of_time_are_counted_so_too():
    t = sympy.Symbol("t")
    q, p = ([sympy.Function(f"{x}{i}")(t) for i in (0, 1)] for x in "qp")
    with pytest.raises(ss.errors.InvalidArgumentError, match="place 1 of q"):
        ss.model_from_sympy(sum(x**2 for x in (*q, *p)), q=q, p=p)


@pytest.mark.parametrize("n", [None, 3])
def test_no_parameter_has_the_name_of_a_column(n):
    H = "k*q**2 + p**2*q_1" if n is None else "Sum(k*q[i]**2 + p[i]**2*q_1, i)"
    with pytest.raises(ss.errors.InvalidArgumentError, match="give the parameter another name"):
        ss.model_from_sympy(H, params={"k": 1.0, "q_1": 2.0}, n=n)
    if n is None:
        with pytest.raises(ss.errors.InvalidArgumentError, match="give the time another name"):
            ss.model_from_sympy("q**2 + p**2*cos(q_1)", t="q_1")


def test_a_parameter_q_is_that_for_f_as_for_observables():
    charged = ss.model_from_sympy("y**2/2 + q*x**2/2", q="x", p="y", params={"q": 4.0})
    start = {"q0": 1.0, "p0": 0.0}
    found = ss.moments(charged, **start, step=0.1, steps=2, observables={"o": "q"})
    assert found.mean["o"].tolist() == [4.0] * 3
    assert ss.mlmc(charged, "q + 0*x", **start, horizon=0.2, abs=0.1).value == 4.0


def test_no_observable_has_the_name_that_formulas_have_for_a_coordinate():
    start = {"q0": 1.0, "p0": 0.0, "step": 0.1, "steps": 2}
    with pytest.raises(
        ss.errors.InvalidArgumentError, match="observable 'q1': this name is taken, results and formulas call"
    ):
        ss.moments(ss.models.kubo(), **start, observables={"q1": "p"})
    assert ss.moments(ss.models.kubo(), **start, observables={"q2": "q**2"}).mean["q2"][0] == 1.0


def test_letters_that_fold_into_one_are_one_name():
    q, p = sympy.symbols("q p")
    for params, own in ((MICRO, MU), (MU, MICRO)):
        for H in (f"p**2/2 + {own}*q**2", p**2 / 2 + sympy.Symbol(own) * q**2):
            mine = ss.model_from_sympy(H, params={params: 3.0})
            assert mine.value(1.0, 0.0)[0] == 3.0 and list(mine.parameters) == [MU]
            assert mine.with_parameters(**{own: 5.0}).value(1.0, 0.0)[0] == 5.0


def test_two_names_that_fold_into_one_are_refused():
    q, p = sympy.symbols("q p")
    with pytest.raises(ss.errors.InvalidArgumentError, match=f"the name '{MU}' is given twice"):
        ss.model_from_sympy(f"p**2/2 + {MICRO}*q**2", params={MICRO: 1.0, MU: 2.0})
    with pytest.raises(ss.errors.InvalidArgumentError, match=f"holds {MICRO} and {MU}, which are one name"):
        ss.model_from_sympy(p**2 / 2 + sympy.Symbol(MICRO) * q**2 + sympy.Symbol(MU) * q, params={MU: 2.0})
    mine = ss.model_from_sympy(f"p**2/2 + {MICRO}*q**2", params={MU: 2.0})
    with pytest.raises(ss.errors.InvalidArgumentError, match="some are the same name"):
        mine.with_parameters(**{MICRO: 1.0, MU: 2.0})
