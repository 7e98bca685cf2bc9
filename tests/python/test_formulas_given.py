# SPDX-License-Identifier: BSD-3-Clause
"""Arguments of formulas: parameters of value 0, 1 and -1, unused parameters, arguments that do not exist."""

import warnings

import numpy as np
import pytest
import symsde as ss
from symsde import errors

sympy = pytest.importorskip("sympy")

BARE = {
    "H": {"H": "s"},
    "noise": {"H": "p**2/2 + q**2/2", "noise": ["s", "s*q"]},
    "invariant": {"H": "p**2/2 + s*q**2/2", "invariants": ["s"]},
    "chain": {"H": "Sum(p[i]**2/2, i) + s", "noise": ["s*Sum(q[i], i)"], "n": 4},
}


@pytest.mark.usefixtures("quick_compiler")
@pytest.mark.parametrize("value", [0.0, -0.0, 1.0, -1.0, 2.0])
@pytest.mark.parametrize("given", BARE.values(), ids=BARE)
def test_a_bare_parameter_of_any_value(given, value):
    """A parameter alone as expression is a plain number, not a sympy object."""
    model = ss.model_from_sympy(**given, params={"s": value})
    again = ss.model_from_sympy(**given, params={"s": 3.0}).with_parameters(s=value)
    w = np.eye(model.nnoise + 1)
    for made in (model, again):
        q = np.full((made.ndof, made.nnoise + 1), 2.0)
        found = made.value(q, np.zeros_like(q), w)
        if "invariants" in given:
            assert made.formula.structure.invariants == {"s": True}
        elif "n" in given:
            np.testing.assert_array_equal(found, [value, 8 * value])
        elif "noise" in given:
            np.testing.assert_array_equal(found, [2.0, value, 2 * value])
            assert made.formula.structure.silent == ((1, 2) if value == 0 else (1,))
        else:
            np.testing.assert_array_equal(found, [value])


REFUSED = {
    "parameter as an option": (
        lambda: ss.model_from_sympy("p**2/2 + s1*q", s1=0.2),
        errors.WrongTypeError,
        r"no option 's1'.*params=\{'s1': 0.2\}",
    ),
    "stiffness": (lambda: ss.model_from_sympy("p**2/2", stiffness=0.1), errors.WrongTypeError, r"'stiffness'.*params="),
    "slip": (lambda: ss.model_from_sympy("p**2/2", param={}), errors.WrongTypeError, r"'param'.*nearest is params"),
    "of no parameters": (
        lambda: ss.model_from_sympy("p**2/2 + q").with_parameters(z=1),
        errors.UnknownNameError,
        r"there is no parameter 'z': the formulas have none \(H = 'p\*\*2/2 \+ q'\)",
    ),
}


@pytest.mark.parametrize("case", REFUSED.values(), ids=REFUSED)
def test_refused(case):
    function, kind, words = case
    with pytest.raises(kind, match=words):
        function()


UNUSED = {
    "slip": (
        {"H": "p**2/2 + sigma*q", "params": {"sigma": 1.0, "simga": 0.3}},
        "the parameter simga: its value.*hold sigma",
    ),
    "no noise": ({"H": "p**2/2 + q**2", "params": {"sigma": 0.3}}, "the parameter sigma: .*no noise is given"),
    "two": (
        {"H": "p**2/2", "noise": ["q"], "params": {"a": 1.0, "b": 2.0}},
        "the parameters a, b: they change nothing$",
    ),
    "chain": ({"H": "Sum(p[i]**2/2, i)", "n": 3, "params": {"a": 1.0}}, "the parameter a: .*no noise is given"),
}


@pytest.mark.usefixtures("quick_compiler")
@pytest.mark.parametrize(("given", "words"), UNUSED.values(), ids=UNUSED)
def test_parameters_that_no_formula_holds_are_told(given, words):
    with pytest.warns(errors.UnusedParameterWarning, match=words):
        model = ss.model_from_sympy(**given)
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # with a new value no formula is derived again
        model.with_parameters(**dict.fromkeys(given["params"], 2.0))
        ss.model_from_sympy("p**2/2 + q*s", invariants=["E*q"], params={"s": 1.0, "E": 2.0})


@pytest.mark.parametrize(
    ("H", "noise", "words"),
    [
        (
            "Sum(p[i]**2/2 + k*q[i]**2/2, i)",
            ["-s*q[k]"],
            r"'-s\*q\[k\]'.*the index \[k\], and k is a parameter.*q\[i\]",
        ),
        (
            "Sum(p[i]**2/2, i) + Sum(s, i)**2",
            ["k*q[j]"],
            r"formula 'Sum\(p.*a sum without q\[i\] or p\[i\]: write the number",
        ),
        (
            "Sum(p[i]**2/2, i) + Sum(q[i], s)**2",
            ["k*q[j]"],
            r"formula 'Sum\(p.*sums over s, .* a parameter.*another letter",
        ),
    ],
)
def test_indices_that_are_parameters(H, noise, words):
    """The message names the formula that holds the wrong index."""
    with pytest.raises(errors.InvalidArgumentError, match=words):
        ss.model_from_sympy(H, noise, params={"k": 1.0, "s": 0.1}, n=8)


@pytest.mark.usefixtures("quick_compiler")
@pytest.mark.parametrize(
    ("number", "value"),
    [
        (sympy.Rational(2**2000 + 1, 3**1250), None),
        (sympy.Rational(1, 2**1060), 2.0**-1060),
        (-sympy.Rational(3**700, 2**1100), None),
        (2**70, 2.0**70),
        ("2**70", 2.0**70),
        ("2**-1060", 2.0**-1060),
    ],
)
def test_numbers_of_many_digits(number, value):
    """Rationals whose numerator and denominator overflow, though their quotient does not."""
    q, p = sympy.symbols("q p")
    H = f"p**2/2 + {number}*q" if isinstance(number, str) else p**2 / 2 + number * q
    expected = number.p / number.q if value is None else value
    assert ss.model_from_sympy(H, q=None if isinstance(H, str) else q).gradient(1.0, 0.0)[0][0, 0] == expected


def test_powers_of_numbers_are_bounded_by_their_value():
    for text in ("9**9**9", "2**1100", "(1 + 1/9007199254740992)**9007199254740992*2**1030"):
        with pytest.raises(errors.InvalidArgumentError, match="not a finite real number"):
            ss.model_from_sympy(f"p**2/2 + {text}*q")
    with pytest.raises(errors.InvalidArgumentError, match="exponent 70"):
        ss.model_from_sympy("p**2/2 + q**70")


@pytest.mark.usefixtures("quick_compiler")
def test_dummies_are_symbols():
    """Dummies differ even with one name; two coordinates of one name are refused."""
    x, y, a = (sympy.Dummy(name) for name in "xya")
    model = ss.model_from_sympy(y**2 / 2 + a * x**3, [x], q=x, p=y, params={a: 2.0})
    assert [x.item() for x in model.gradient(2.0, 5.0)] == [24.0, 5.0] and model.parameters == {"a": 2.0}
    assert model.with_parameters(a=1.0).gradient(2.0, 5.0)[0] == 12.0
    with pytest.raises(errors.InvalidArgumentError, match="two symbols of one name: x"):
        ss.model_from_sympy(y**2 / 2 + x * sympy.Dummy("x"), q=x, p=y)
    with pytest.raises(errors.InvalidArgumentError, match="'x' is given twice"):
        ss.model_from_sympy(y**2 / 2, q=[x, sympy.Dummy("x")], p=[y, a])
