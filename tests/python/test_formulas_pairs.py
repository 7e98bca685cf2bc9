# SPDX-License-Identifier: BSD-3-Clause
"""Sums over pairs of sites, sites of several coordinates, parameters with a number for each site."""

import pickle

import numpy as np
import pytest
import symsde as ss
from symsde.errors import IncompatibleError, InvalidArgumentError, WrongShapeError

sp = pytest.importorskip("sympy")

from symsde.model.formulas import compiler  # noqa: E402

if compiler.command() is None:
    pytest.skip("no C compiler", allow_module_level=True)

pytestmark = pytest.mark.usefixtures("quick_compiler")
KINETIC = "Sum((u[i]**2 + v[i]**2 + w[i]**2)/(2*m[i]), i)"
PAIRS = "Sum(G*m[i]*m[j]/sqrt((x[i]-x[j])**2 + (y[i]-y[j])**2 + (z[i]-z[j])**2 + e**2), i < j)"
NOISE = ["s*x[k]", "s*y[k]"]
MIXED = ["s*v[k]*y[k]*m[k]", "Sum(cos(x[i] - z[j])*m[j] + w[i]*w[j], i < j)"]
NAMES = {"q": "x y z", "p": "u v w"}


def bodies(n, noise=(), **values):
    masses = np.linspace(0.5, 1.5, n)
    return ss.model_from_sympy(
        f"{KINETIC} - {PAIRS}", noise, **NAMES, n=n, params={"G": 1.1, "e": 0.2, "s": 0.1, "m": masses, **values}
    )


def written_out(n, mixed):
    """The Hamiltonians of `bodies`, body by body, and their coordinates and momenta in the order of the states."""
    x, y, z, u, v, w = (sp.symbols(f"{a}1:{n + 1}", real=True) for a in "xyzuvw")
    m, pairs = np.linspace(0.5, 1.5, n), [(i, j) for i in range(n) for j in range(i + 1, n)]
    H = sum((u[i] ** 2 + v[i] ** 2 + w[i] ** 2) / (2 * m[i]) for i in range(n))
    for i, j in pairs:
        distance = sp.sqrt((x[i] - x[j]) ** 2 + (y[i] - y[j]) ** 2 + (z[i] - z[j]) ** 2 + 0.04)
        H -= 1.1 * m[i] * m[j] / distance
    if mixed:
        noise = [0.1 * v[k] * y[k] * m[k] for k in range(n)]
        noise.append(sum(sp.cos(x[i] - z[j]) * m[j] + w[i] * w[j] for i, j in pairs))
    else:
        noise = [0.1 * a[k] for a in (x, y) for k in range(n)]
    states = ([a[i] for i in range(n) for a in letters] for letters in ((x, y, z), (u, v, w)))
    return [H, *noise], *states


@pytest.mark.parametrize("mixed", [False, True])
def test_derivatives_are_those_of_sympy(mixed):
    """Three bodies, by sympy's own derivatives of the formula written out, for one lane, strips of lanes and others."""
    n = 3
    hams, q, p = written_out(n, mixed)
    mine = bodies(n, MIXED if mixed else NOISE)
    assert mine.nnoise == len(hams) - 1 and mine.coordinates[:4] == ("x_1", "y_1", "z_1", "x_2")
    weights = sp.symbols(f"weight0:{len(hams)}")
    total, names = sum(a * h for a, h in zip(weights, hams, strict=True)), [*q, *p]
    every = [total, *(total.diff(a) for a in names), *(total.diff(a, b) for a in names for b in names)]
    function = sp.lambdify([*names, *weights], every, cse=True)
    rng, d = np.random.default_rng(4), 3 * n
    for lanes in (1, 3, 8, 21):
        x, y = rng.normal(size=(2, d, lanes))
        weight = rng.normal(size=(len(hams), lanes))
        found = np.array([np.broadcast_to(r, (lanes,)) for r in function(*x, *y, *weight)])
        second = found[1 + 2 * d :].reshape(2 * d, 2 * d, lanes)
        close = {"rtol": 1e-12, "atol": 1e-13}
        np.testing.assert_allclose(np.ravel(mine.value(x, y, weight)), found[0], **close)
        np.testing.assert_allclose(np.concatenate(mine.gradient(x, y, weight)), found[1 : 1 + 2 * d], **close)
        for block, here in zip(
            mine.hessian(x, y, weight), (second[:d, :d], second[d:, :d], second[d:, d:]), strict=True
        ):
            np.testing.assert_allclose(block, here, **close)
    mine.probe(x[:, :1], y[:, :1])  # products and third derivatives, by differences


@pytest.mark.parametrize("scheme", ["stormer_verlet", "midpoint", "gauss2_strong32"])
@pytest.mark.parametrize("mixed", [False, True])
def test_runs_are_those_of_the_formula_written_out(mixed, scheme):
    hams, q, p = written_out(3, mixed)
    if mixed and scheme == "stormer_verlet":
        scheme = "gauss2"
    start = {"q0": np.linspace(-1, 1.4, 9), "p0": np.sin(np.arange(9.0)) / 5}
    run = {**start, "step": 0.05, "steps": 20, "paths": 11, "seed": 3, "scheme": scheme}
    mine = ss.simulate(bodies(3, MIXED if mixed else NOISE), **run)
    other = ss.simulate(ss.model_from_sympy(hams[0], hams[1:], q=q, p=p), **run)
    np.testing.assert_allclose(mine.q, other.q, rtol=0, atol=2e-11)
    np.testing.assert_allclose(mine.p, other.p, rtol=0, atol=2e-11)
    alone = ss.simulate(bodies(3, MIXED if mixed else NOISE), **{**run, "paths": 1, "first_path": 7})
    np.testing.assert_array_equal(alone.q[..., 0], mine.q[..., 7])


def test_traits():
    flags = ("separable", "additive", "position_noise", "constant_mass", "diagonal_mass", "quadratic", "bandwidth")
    found = bodies(4, NOISE).traits
    assert [getattr(found, x) for x in flags] == [True, True, True, True, True, False, None]
    assert not found.identity_mass and found.touches[:2] == ((1,), (4,))
    mixed = bodies(4, MIXED).traits
    assert not (mixed.separable or mixed.additive or mixed.position_noise)
    assert mixed.touches[0] == (1, 2, 3)[1:2] and mixed.touches[4] == tuple(x for x in range(1, 13) if x % 3 != 2)
    unit = ss.model_from_sympy("Sum((u[i]**2+v[i]**2)/2, i) + Sum((x[i]-y[j])**2, i < j)", q="x y", p="u v", n=12)
    assert unit.traits.identity_mass and unit.traits.quadratic and unit.traits.bandwidth is None
    turned = ss.model_from_sympy("Sum(u[i]**2+v[i]**2+u[i]*v[i] + x[i]**4*y[i], i)", q="x y", p="u v", n=12).traits
    assert turned.constant_mass and not turned.diagonal_mass and turned.bandwidth == 1
    halves = ss.model_from_sympy("Sum(p[i]**2/4, i) + Sum(p[i]**2/4 + q[i]**4, i)", n=3)
    assert halves.traits.identity_mass
    tied = ss.model_from_sympy("Sum(u[i]*v[i+1]/2 + x[i]*y[i], i)", q="x y", p="u v", n=12).traits
    assert not tied.constant_mass and tied.bandwidth == 3
    other = ss.model_from_sympy(
        "Sum(p[i]**2*(1 + k[i])/2, i) - Sum(g[i]*p[i]**2/2, i)", n=4, params={"k": [1.0] * 4, "g": [1.0] * 4}
    )
    assert not other.traits.identity_mass and other.traits.diagonal_mass


def test_energy_momentum_and_order():
    """A hundred bodies keep momentum and angular momentum to rounding, and the error of the energy falls as h^2."""
    n = 100
    model, rng = bodies(n, m=np.full(n, 1 / n)), np.random.default_rng(8)
    q0, p0 = rng.normal(size=3 * n), rng.normal(size=3 * n) / n / 3
    errors = []
    for steps in (10, 20, 40):
        run = ss.simulate(model, q0=q0, p0=p0, step=0.8 / steps, steps=steps, scheme="stormer_verlet")
        errors.append(np.abs(run.energy[:, 0] / run.energy[0, 0] - 1).max())
    rates = np.log2(np.divide(errors[:-1], errors[1:]))
    assert errors[-1] < 1e-4 and (abs(rates - 2) < 0.3).all(), (errors, rates)
    x, y = (a[..., 0].reshape(-1, n, 3) for a in (run.q, run.p))
    for kept in (y.sum(axis=1), np.cross(x, y).sum(axis=1)):
        np.testing.assert_allclose(kept, np.broadcast_to(kept[0], kept.shape), rtol=0, atol=1e-14)
    assert np.ptp(y, axis=0).max() > 1e-3


def test_orders():
    """Three bodies on a path whose forces bend, against a path of steps 32 times as short: 2 and 4."""
    model = bodies(3)
    start = {
        "q0": np.array([-1.0, 0, 0.1, 1, 0.3, 0, 0, 0.8, -0.5]),
        "p0": np.array([0, -0.5, 0, 0, 0.6, 0.1, 0.4, 0, 0]),
    }

    def end(scheme, steps):
        return ss.simulate(model, **start, step=1 / steps, steps=steps, save_every=steps, scheme=scheme).q[-1, :, 0]

    exact = end("chin4a", 1600)
    for scheme, order in (("stormer_verlet", 2), ("chin4a", 4)):
        errors = [np.abs(end(scheme, steps) - exact).max() for steps in (50, 100, 200)]
        np.testing.assert_allclose(np.log2(np.divide(errors[:-1], errors[1:])), order, atol=0.2)


def test_the_code_is_the_same_for_any_number_of_bodies():
    few, many = bodies(3, NOISE), bodies(100, NOISE)
    assert few.formula.source == many.formula.source and many.formula.seconds_compilation == 0
    assert many.ndof == 300 and many.nnoise == 200


def test_pairs_of_one_coordinate():
    """All cos(q_i - q_j) by pairs, and by the squares of two sums; inside of a function, too."""
    n, rng = 7, np.random.default_rng(1)
    squares = "(Sum(cos(q[i]), i)**2 + Sum(sin(q[i]), i)**2 - N)/2"
    x, y = rng.normal(size=(2, n, 9))
    for pairs, sums in (
        ("Sum(cos(q[i]-q[j]), i < j)", squares),
        ("exp(Sum(cos(q[i]-q[j]), i < j)/N)", f"exp({squares}/N)"),
    ):
        one, other = (
            ss.model_from_sympy(f"Sum(p[i]**2/2, i) - {text}", n=n, params={"N": float(n)}) for text in (pairs, sums)
        )
        for a, b in zip(
            [one.value(x, y), *one.gradient(x, y), *one.hessian(x, y)],
            [other.value(x, y), *other.gradient(x, y), *other.hessian(x, y)],
            strict=True,
        ):
            np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-12)
        one.probe(x[:, :1], y[:, :1])
        np.testing.assert_array_equal(one.gradient(x[:, 3:4], y[:, 3:4])[0][:, 0], one.gradient(x, y)[0][:, 3])


def test_far_lanes_of_pairs():
    """A lane beyond the range of a function takes that of the C library, the others keep their bits."""
    model = ss.model_from_sympy("Sum(p[i]**2/2, i) + Sum(exp(q[i]-q[j]), i < j)", n=5)
    x = np.random.default_rng(0).normal(size=(5, 20))
    far = x.copy()
    far[0, 3] = 709.5
    one, other = (model.gradient(a, 0 * a)[0] for a in (x, far))
    rest = np.arange(20) != 3
    np.testing.assert_array_equal(one[:, rest], other[:, rest])
    np.testing.assert_array_equal(model.gradient(far[:, 3:4], 0.0)[0][:, 0], other[:, 3])
    np.testing.assert_allclose(other[1, 3], -np.exp(far[0, 3] - far[1, 3]), rtol=1e-13)


@pytest.mark.parametrize("ends", ["free", "periodic"])
def test_numbers_for_each_site(ends):
    """Springs of their own, an energy of each site and noises with strengths of their own."""
    n, rng = 6, np.random.default_rng(5)
    k, b, s, x, y = *rng.uniform(0.5, 2, size=(3, n)), *rng.normal(size=(2, n))
    H = "Sum(p[i]**2/2, i) + Sum(k[i]*(q[i+1]-q[i])**4/4 + b[i+1]*q[i]**2*q[i+1], i)"
    model = ss.model_from_sympy(H, ["s[a]*q[a]"], n=n, ends=ends, params={"k": k, "b": b, "s": s})
    assert model.traits.identity_mass and model.parameters["k"] == tuple(k)

    def value(x):
        bonds = [(i, (i + 1) % n) for i in range(n if ends == "periodic" else n - 1)]
        return sum(y**2) / 2 + sum(k[i] * (x[j] - x[i]) ** 4 / 4 + b[j] * x[i] ** 2 * x[j] for i, j in bonds)

    np.testing.assert_allclose(model.value(x, y).item(), value(x), rtol=1e-14)
    slopes = [(value(x + d) - value(x - d)) / 2e-6 for d in 1e-6 * np.eye(n)]
    np.testing.assert_allclose(np.ravel(model.gradient(x, y)[0]), slopes, rtol=1e-7, atol=1e-8)
    for a in range(n):
        np.testing.assert_allclose(np.ravel(model.gradient(x, y, np.eye(n + 1)[a + 1])[0]), s[a] * np.eye(n)[a])
    other = model.with_parameters(k=2 * k)
    assert other.formula.seconds_compilation == 0 and other.parameters["b"] == tuple(b)
    new = ss.model_from_sympy(H, ["s[a]*q[a]"], n=n, ends=ends, params={"k": 2 * k, "b": b, "s": s})
    for again in (other, pickle.loads(pickle.dumps(new))):
        np.testing.assert_array_equal(again.gradient(x, y)[0], new.gradient(x, y)[0])
    assert "6 sites" in repr(model)


def test_energies_of_sites_beside_bonds_with_fixed_ends():
    """Terms of single sites are taken out of a sum of bonds, with their own numbers."""
    H = "Sum(p[i]**2/2 + k[i]*cos(q[i]) + (q[i+1]-q[i])**2/2, i)"
    x = np.array([0.3, -0.2, 0.9])
    one = ss.model_from_sympy(H, n=3, ends="fixed", params={"k": [1.0, 2.0, 3.0]})
    bonds = np.diff(np.concatenate([[0], x, [0]]))
    np.testing.assert_allclose(np.ravel(one.gradient(x, 0.0)[0]), -np.array([1, 2, 3]) * np.sin(x) - np.diff(bonds))


@pytest.mark.parametrize(
    ("H", "more", "words"),
    [
        (PAIRS, {"m": [1.0, 2.0]}, "m has 2 values for 4 sites: in sums over sites an array holds a number for each"),
        (PAIRS, {"m": 1.0}, "holds an index of m, whose value is one number: give an array"),
        ("Sum(m*x[i], i)", {}, r"takes m as a number, which is a parameter .*: write m\[i\]"),
        ("Sum(x*y[i], i)", {}, r"takes x as a number, which is a coordinate .*: write x\[i\]"),
        ("Sum(x[i]*i, i)", {}, r"takes i as a number: .* by x\[i\] or y\[i\]"),
        ("Sum(x[i]*j*x[j], i < j)", {}, "takes j as a number"),
        ("Sum(x[i+1]*x[j], i < j)", {}, r"neighbours in a sum over pairs: write x\[i\] and x\[j\]"),
        ("Sum(x[i]*x[k], i < j)", {}, "the index k, where there are i and j"),
        ("Sum(x[i]*x[j], i)", {}, r"the index j, where there is i; pairs are summed as Sum\(.., i < j\)"),
        ("Sum(x[i], i < j)", {}, "sums over pairs what does not depend on both, i and j"),
        ("Sum(m[i]*m[j], i < j)", {}, r"a sum without q\[i\] or p\[i\]"),
        ("Sum(x[i]*x[j], i <= j)", {}, "not written Sum"),
        ("Sum(x[i]*x[j], i < i)", {}, "pairs of i and itself"),
        ("Sum(x[i]*x[j], i < j < k)", {}, "not written Sum"),
        ("Sum(x[i]*x[j], i < 3)", {}, "not written Sum"),
        ("Sum(x[i]*x[e], i < e)", {}, "sums over e, which means something else, a parameter"),
        ("Sum(x[i]*x[y], i < y)", {}, "sums over y, which means something else, a coordinate"),
        ("Sum(m[i+1]*(x[i+1]-x[i])**2, i)", {"ends": "fixed"}, "none beyond fixed ends"),
        ("Sum(q[i]**2, i)", {}, r"an index of something that is not x\[i\] or y\[i\]"),
        ("Sum(x[i]**2, i)", {"p": "u v"}, "q names 3 coordinates of a site and p 2 momenta"),
        ("Sum(x[i]**2, i)", {"p": "u v x"}, "'x' is a coordinate of sites"),
        ("Sum(x[i]**2, i)", {"p": "u v e"}, "'e' is a coordinate of sites"),
        ("Sum(x[i]**2, i)", {"p": "u v 3"}, "'3' is no name"),
        ("Sum(x[i]**2, i)", {"p": None}, "leave out q, p and invariants, or name"),
        ("Sum(a0[i]**2, i)", {"q": [f"a{i}" for i in range(9)], "p": [f"b{i}" for i in range(9)]}, "allowed are 8"),
    ],
)
def test_bad_sums_get_a_sentence(H, more, words):
    given = {**NAMES, "n": 4, **{k: x for k, x in more.items() if k not in ("m",)}}
    with pytest.raises((InvalidArgumentError, WrongShapeError), match=words):
        ss.model_from_sympy(H, params={"G": 1.0, "e": 0.5, "m": more.get("m", np.ones(4))}, **given)


def test_what_else_is_told():
    model = bodies(4)
    run = {"q0": np.linspace(0, 1, 12), "p0": 0.0, "step": 0.1, "steps": 2, "paths": 3}
    two = ss.model_from_sympy("(u_1**2 + u_2**2 + x_1**2*x_2**2)/2", q=["x_1", "x_2"], p=["u_1", "u_2"])
    with pytest.raises(InvalidArgumentError, match=r"index of x: an index stands behind .* there are x_1, x_2, \.\."):
        ss.moments(two, **run | {"q0": 0.1}, observables={"o": "Sum(x[i]**2, i)"})
    with pytest.raises(InvalidArgumentError, match="m is nan at site 1"):
        model.with_parameters(m=[1.0, np.nan, 1.0, 1.0])
    with pytest.raises(InvalidArgumentError, match="m is inf at site 0"):
        bodies(2, m=[np.inf, 1.0])
    with pytest.raises(WrongShapeError, match=r"give a number, or \(site,\), a number for each site"):
        model.with_parameters(m=np.ones((4, 2)))
    with pytest.raises(WrongShapeError, match="m has 1 value for 4 sites"):
        model.with_parameters(m=1.0)
    with pytest.raises(IncompatibleError, match=r"give a function .* lambda G: model.with_parameters\(G=G\)"):
        ss.sweep(model, {"G": [1.0, 2.0]}, **run)
    with pytest.raises(IncompatibleError, match="'o' holds m, whose values differ from site to site"):
        ss.moments(model, **run, observables={"o": "m*x_1"})
    found = ss.moments(model, **run, observables={"o": "x_2 - q_4 + Sum(q[i], i)"})
    np.testing.assert_allclose(found.mean["o"][0], 1 / 11 * 3 - 3 / 11 + 6)
    run |= {"paths": 1, "scheme": "stormer_verlet"}
    slope = ss.gradient(model, "x_1**2", wrt=["q0"], **run).values["q0"]
    for i in (0, 5):
        ends = [
            ss.simulate(model, **run | {"q0": run["q0"] + d * np.eye(12)[i]}).q[-1, 0, 0] ** 2 for d in (-1e-5, 1e-5)
        ]
        np.testing.assert_allclose(slope[i], (ends[1] - ends[0]) / 2e-5, rtol=1e-7)
