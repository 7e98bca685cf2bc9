# SPDX-License-Identifier: BSD-3-Clause
"""What stands beside formulas: parameters of value 0, 1 and -1, unused ones, arguments that do not exist."""

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
    """As an expression it is a number for which no sympy object stands."""
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
    "damping": (lambda: ss.model_from_sympy("p**2/2", damping=0.1), errors.WrongTypeError, r"'damping'.*params="),
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
