# SPDX-License-Identifier: BSD-3-Clause
"""gauss2_weak2_areas: weak order two for noises that do not commute, without sampling.

A step has 3^m increments and 2^(m(m-1)/2) signs of areas: its mean is a finite sum over the library's own steps, and of
polynomials f the exact mean is e^{hL} f, a series of polynomials.
"""

import functools
import itertools
import math
from fractions import Fraction

import numpy as np
import pytest
import symsde as ss

sympy = pytest.importorskip("sympy")
Q, P = sympy.symbols("q p")
RING, X, Y = sympy.ring("x,y", sympy.QQ)
THREE = ((-math.sqrt(3), 1 / 6), (0.0, 2 / 3), (math.sqrt(3), 1 / 6))


def outcomes(noises):
    """(normals, signs, probability) of all outcomes of a step."""
    pairs = noises * (noises - 1) // 2
    for drawn in itertools.product(THREE, repeat=noises):
        for signs in itertools.product((-1, 1), repeat=pairs):
            weight = math.prod(w for _, w in drawn) / 2**pairs
            yield np.array([x for x, _ in drawn]), signs, weight


def rows(dw, areas):
    """Rows of a polygon with these increments and areas: a square for every pair of noises, then a straight line."""
    noises = len(dw)
    pairs = [(k, el) for el in range(noises) for k in range(el)]
    found = np.zeros((16, noises))
    for i, ((k, el), area) in enumerate(zip(pairs, areas, strict=True)):
        side = math.sqrt(abs(area))
        found[4 * i : 4 * i + 4, k] = side, 0, -side, 0
        found[4 * i : 4 * i + 4, el] = 0, math.copysign(side, area), 0, -math.copysign(side, area)
    found[12:] = dw / 4
    return found


def ends(model, scheme, h, q0, p0):
    """The states (2, outcome) after a step from one point, and the probabilities of the outcomes."""
    found = list(outcomes(model.nnoise))
    dw = np.stack([rows(math.sqrt(abs(h)) * x, [s * abs(h) / 2 for s in signs]) for x, signs, _ in found], axis=-1)
    run = ss.simulate(model, q0=q0, p0=p0, scheme=scheme, step=h, steps=1, paths=len(found), increments=dw, refine=4)
    assert not run.status.any()
    return np.stack([run.q[-1, 0], run.p[-1, 0]]), np.array([w for *_, w in found])


def second_moments(model, scheme, h):
    """E M x M of a linear step."""
    first, weight = ends(model, scheme, h, 1.0, 0.0)
    second, _ = ends(model, scheme, h, 0.0, 1.0)
    maps = np.stack([first, second], axis=1)
    return np.einsum("n,ijn,kln->ikjl", weight, maps, maps).reshape(4, 4)


@pytest.mark.parametrize(("scheme", "order"), [("gauss2_weak2_areas", 2.0), ("gauss2_weak2", 1.0)])
def test_second_moments_of_a_linear_problem(scheme, order):
    """Second moments of H = (p^2 + q^2)/2, H_1 = s1 p^2/2, H_2 = s2 q^2/2 at t = 1, against the exponential of the
    generator.
    """
    s1, s2 = 0.7, 0.9
    model = ss.models.noncommutative_oscillator(s1=s1, s2=s2)
    noise = [np.array([[0, s1], [0, 0]]), np.array([[0, 0], [-s2, 0]])]
    drift = np.array([[0.0, 1], [-1, 0]]) + sum(b @ b for b in noise) / 2
    one = np.eye(2)
    exact = series(np.kron(drift, one) + np.kron(one, drift) + sum(np.kron(b, b) for b in noise))
    errors = [
        np.abs(np.linalg.matrix_power(second_moments(model, scheme, 1 / n), n) - exact).max() for n in (16, 32, 64)
    ]
    slopes = -np.diff(np.log2(errors))
    assert slopes == pytest.approx(order, abs=0.07)
    assert slopes[-1] == pytest.approx(order, abs=0.035)


def series(matrix):
    """exp of a small matrix."""
    result = term = np.eye(len(matrix))
    for k in range(1, 40):
        term = term @ matrix / k
        result = result + term
    return result


H = P**2 / 2 + Q**2 / 2 + Q**4 / 8
NOISES = (sympy.Rational(3, 5) * Q**3 / 3, sympy.Rational(1, 2) * P**2 / 2, sympy.Rational(2, 5) * Q * P)


def coupled(count):
    """H with the first `count` noises, and their derivatives by SymPy."""
    parts = (H, *NOISES[:count])
    first = [[sympy.lambdify((Q, P), sympy.diff(f, x)) for f in parts] for x in (Q, P)]
    second = [[sympy.lambdify((Q, P), sympy.diff(f, x, y)) for f in parts] for x, y in ((Q, Q), (Q, P), (P, P))]

    def total(w, functions, q, p):
        return sum(rate * f(q, p) for rate, f in zip(w, functions, strict=True))

    def gradient(t, w, q, p):
        return tuple(total(w, functions, q, p) + 0 * q for functions in first)

    def hessian(t, w, q, p):
        return tuple((total(w, functions, q, p) + 0 * q)[None] for functions in second)

    return ss.Model(ndof=1, nnoise=count, gradient=gradient, hessian=hessian)


def along(f, g):
    """{f, g}: the change of f along the field of g."""
    return f.diff(X) * g.diff(Y) - f.diff(Y) * g.diff(X)


@functools.cache
def derivatives(f, count, q0, p0):
    """f, L f, L^2 f, .. at a point, with L f = {f, H} + sum_k {{f, H_k}, H_k}/2."""
    energy, *noises = (RING.from_expr(one.subs({Q: "x", P: "y"})) for one in (H, *NOISES[:count]))
    term, found = RING.from_expr(f.subs({Q: "x", P: "y"})), []
    for _ in range(7):
        found.append(float(term.evaluate([(X, Fraction(q0)), (Y, Fraction(p0))])))
        term = along(term, energy) + sum((along(along(term, g), g) for g in noises), RING.zero) / 2
    return found


def exact_mean(f, count, h, q0, p0):
    """e^{hL} f at a point; the next term is below 1e-12."""
    return sum(term * h**k / math.factorial(k) for k, term in enumerate(derivatives(f, count, q0, p0)))


@pytest.mark.parametrize("count", [2, 3])
@pytest.mark.parametrize(("scheme", "order"), [("gauss2_weak2_areas", 3.0), ("gauss2_weak2", 2.0)])
def test_error_of_one_step(count, scheme, order):
    """Errors of E q^2, q p, p^2, q^3 after one step fall as h^3, which is order two; without areas and brackets of
    noises they fall as h^2.
    """
    model, start = coupled(count), (0.6, 0.4)
    sizes = (1 / 32, 1 / 64)
    errors = []
    for h in sizes:
        z, weight = ends(model, scheme, h, *start)
        q, p = z
        found = [(Q**2, q**2), (Q * P, q * p), (P**2, p**2), (Q**3, q**3)]
        errors.append([abs(weight @ value - exact_mean(f, count, h, *start)) for f, value in found])
    slopes = np.log2(np.array(errors[0]) / np.array(errors[1]))
    if order == 3:
        assert (slopes > 2.8).all(), slopes
    else:
        assert slopes.min() < 2.2, slopes


def test_runs_draw_what_the_order_wants():
    """E q^2 and E p^2 at t = 1 in eight steps, 2^18 paths, within 4.5 standard errors (two in 10^5) of the exact mean;
    the twin, the scheme without areas, is not."""
    model = ss.models.noncommutative_oscillator(s1=0.7, s2=0.9)
    moments = {}
    for scheme in ("gauss2_weak2_areas", "gauss2_weak2"):
        moments[scheme] = np.linalg.matrix_power(second_moments(model, scheme, 1 / 8), 8)[:, 0]
    run = ss.simulate(model, q0=1.0, p0=0.0, scheme="gauss2_weak2_areas", step=1 / 8, steps=8, save_every=8,
                      paths=2**18, seed=4)  # fmt: skip
    z = np.stack([run.q[-1, 0], run.p[-1, 0]])
    pairs = np.einsum("in,jn->ijn", z, z).reshape(4, -1)
    error = pairs.std(axis=1) / math.sqrt(z.shape[1])
    off = {name: np.abs(pairs.mean(axis=1) - expected) / error for name, expected in moments.items()}
    assert off["gauss2_weak2_areas"].max() < 4.5 < off["gauss2_weak2"].max()


def test_what_is_said_of_it():
    scheme = ss.schemes.get("gauss2_weak2_areas")
    assert scheme.info.crosses_noises and scheme.info.uses_areas and scheme.info.law == "three-point"
    assert "2.0" in scheme.certificate() and "for every noise" in scheme.certificate()
    assert not ss.schemes.get("gauss2_weak2").info.crosses_noises
    model = ss.models.noncommutative_oscillator()
    assert "2 from gauss2_weak2_areas" in str(ss.commutator(model))
    given = {"q0": 1.0, "p0": 0.0, "step": 0.1, "steps": 2, "scheme": scheme}
    with pytest.raises(ss.errors.IncompatibleError, match="areas of two values"):
        ss.simulate(model, areas="law", **given)
    with pytest.raises(ss.errors.IncompatibleError, match="three-point"):
        ss.simulate(model, refine=-1, **given)
    with pytest.raises(ss.errors.IncompatibleError, match="needs areas"):
        ss.simulate(model, increments=np.zeros((2, 2, 1)), **given)
