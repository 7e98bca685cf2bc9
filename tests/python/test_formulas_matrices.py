# SPDX-License-Identifier: BSD-3-Clause
"""Matrices of sympy as coordinates and momenta: the models are those of formulas in single symbols."""

import pickle

import numpy as np
import pytest
import symsde as ss
from symsde.errors import InvalidArgumentError

pytestmark = pytest.mark.usefixtures("quick_compiler")

sp = pytest.importorskip("sympy")

A = sp.Matrix([[2, 1, 0], [1, 3, 0], [0, 0, 1]])
TEXT = "p1**2/2 + p2**2/2 + p3**2/2 + k*(2*q1**2 + 2*q1*q2 + 3*q2**2 + q3**2)/2 + cos(q1 - q3)"
AT = np.array([0.3, -0.4, 0.7]), np.array([0.2, 0.5, -0.1])
K = sp.Symbol("k")


def of_matrices(q, p, **more):
    """Three coupled oscillators; H is a matrix of one element, but for the last term."""
    H = (p.T * p / 2 + K * q.T * A * q / 2)[0, 0] + sp.cos(q[0] - q[2])
    return ss.model_from_sympy(H, q=q, p=p, params={"k": 1.3}, **more)


@pytest.mark.parametrize("kind", ["Matrix", "MatrixSymbol", "mixed"])
def test_as_single_symbols(kind):
    """The same value, gradient and traits, noises and forces in matrices, and names q1, q2, .. in formulas."""
    q, p = (sp.MatrixSymbol(x, 3, 1) for x in "qp")
    if kind != "MatrixSymbol":
        p = sp.Matrix(sp.symbols("p1:4"))
    if kind == "Matrix":
        q = sp.Matrix(sp.symbols("q1:4"))
    more = {"noise": [0.2 * q[1], sp.sin(q[0])], "force": -0.1 * p - 0.1 * A * q}
    found = of_matrices(q, p, **more)
    force = ["-0.1*p1 - 0.1*(2*q1 + q2)", "-0.1*p2 - 0.1*(q1 + 3*q2)", "-0.1*p3 - 0.1*q3"]
    right = ss.model_from_sympy(TEXT, ["0.2*q2", "sin(q1)"], params={"k": 1.3}, force=force)
    assert found.traits == right.traits and found.ndof == 3
    run = {"q0": AT[0], "p0": AT[1], "step": 0.1, "steps": 20, "paths": 4, "seed": 2}
    mine, theirs = (ss.simulate(x, **run) for x in (found, right))
    np.testing.assert_allclose(mine.q, theirs.q, rtol=1e-11)
    kept = ss.moments(pickle.loads(pickle.dumps(found)), observables={"a": "q1*p3"}, **run).mean["a"]
    np.testing.assert_allclose(kept, (mine.q[:, 0] * mine.p[:, 2]).mean(axis=1), rtol=1e-12)


def test_matrices_of_one_element_and_traces():
    """H may be a matrix of one element, and hold traces and determinants; positions of bodies go row by row."""
    q, p = (sp.MatrixSymbol(x, 2, 2) for x in "qp")
    whole = sp.Trace(p * p.T) / 2 + sp.Trace(q.T * q) + sp.Determinant(q) ** 2
    found = ss.model_from_sympy(whole, q=q, p=p)
    one = ss.model_from_sympy(
        "p1**2/2 + p2**2/2 + p3**2/2 + p4**2/2 + q1**2 + q2**2 + q3**2 + q4**2 + (q1*q4 - q2*q3)**2"
    )
    at = np.array([0.3, -0.4, 0.7, 0.9])
    np.testing.assert_allclose(found.value(at, 0.5), one.value(at, 0.5), rtol=1e-14)
    np.testing.assert_allclose(found.gradient(at, 0.5)[0], one.gradient(at, 0.5)[0], rtol=1e-13)
    x, y = (sp.MatrixSymbol(name, 3, 1) for name in "xy")
    column = ss.model_from_sympy(y.T * y / 2 + x.T * A * x / 2, q=x, p=y)
    np.testing.assert_allclose(column.gradient(*AT)[0].ravel(), np.array(A.tolist(), float) @ AT[0], rtol=1e-14)
    assert column.coordinates[:3] == ("x1", "x2", "x3")


def test_refused():
    """Bad input is refused with a sentence."""
    q, p = (sp.MatrixSymbol(x, 2, 1) for x in "qp")
    n = sp.Symbol("n")
    for given, words in (
        ({"H": p.T * p + q.T * sp.MatrixSymbol("B", 2, 2) * q}, "the matrix B, which is neither q nor p"),
        ({"H": p + q}, "is no formula|no scalar formula"),
        ({"H": p[0] ** 2, "q": sp.MatrixSymbol("q", n, 1)}, "has no number of elements"),
        ({"H": p[0] ** 2, "q": sp.MatrixSymbol("q", 3, 1)}, "give as many of each"),
    ):
        with pytest.raises(InvalidArgumentError, match=words):
            ss.model_from_sympy(**{"q": q, "p": p} | given)
