# SPDX-License-Identifier: BSD-3-Clause
"""Sums over sites: the chain of the catalogue, every kind of ends against formulas written out, bad input."""

import ctypes
import warnings

import numpy as np
import pytest
import symsde as ss
from conftest import moments_of
from symsde import errors
from symsde.batch import scene
from symsde.native import abi

pytest.importorskip("sympy")

from symsde.model.formulas import compiler

if compiler.command() is None:
    pytest.skip("no C compiler", allow_module_level=True)

pytestmark = pytest.mark.optimised

FPU = "Sum(p[i]**2/2, i) + Sum((q[i+1]-q[i])**2/2 + beta*(q[i+1]-q[i])**4/4, i)"
PARAMS = {"beta": 0.8, "sigma": 0.1}
# mixed derivatives, three neighbours, functions, time; and terms that vanish beyond either end
DENSITY = "cos(q[{after}] - q[{before}])*p[{here}] + beta*p[{after}]**2*q[{here}]/2 + sin(t)*q[{here}]"
DENSITY += " + q[{before}]**3*(q[{here}]+1)/3 + p[{after}]**2/2"
N = 5


def fpu(n, beta=0.8):
    return ss.model_from_sympy(FPU, ["-sigma*q[k]"], params={**PARAMS, "beta": beta}, n=n, ends="fixed")


def chain(ends):
    H = "2*Sum(" + DENSITY.format(before="i-1", here="i", after="i+1") + ", i)"
    return ss.model_from_sympy(H, ["Sum(q[i]*q[i+1], i)", "p[k]*q[k]**2"], params={"beta": 0.8}, n=N, ends=ends)


def written_out(ends):
    """The same Hamiltonian, site by site."""

    def place(i):
        inside = 0 <= i < N
        return (lambda x: f"{x}{i % N + 1}") if inside or ends == "periodic" else (lambda x: "0")

    def term(text, i, reach):
        if ends == "free" and not all(0 <= i + o < N for o in reach):
            return None
        for word, o in (("before", -1), ("here", 0), ("after", 1)):
            at = place(i + o)
            text = text.replace(f"q[{{{word}}}]", at("q")).replace(f"p[{{{word}}}]", at("p"))
        return f"({text})"

    sites = range(-1, N + 1) if ends == "fixed" else range(N)
    H = [x for i in sites if (x := term(DENSITY, i, (-1, 0, 1)))]
    bonds = [x for i in sites if (x := term("q[{here}]*q[{after}]", i, (0, 1)))]
    noise = ["+".join(bonds), *(f"p{i}*q{i}**2" for i in range(1, N + 1))]
    names = {x: [f"{x}{i}" for i in range(1, N + 1)] for x in "qp"}
    return ss.model_from_sympy(f"2*({'+'.join(H)})", noise, params={"beta": 0.8}, **names)


def points(model, count=30):
    rng = np.random.default_rng(2)
    x, y = rng.normal(size=(2, model.ndof, count))
    return x, y, rng.normal(size=(model.nnoise + 1, count))


def everything(model, at):
    return [model.value(*at, t=0.7), *model.gradient(*at, t=0.7), *model.hessian(*at, t=0.7)]


def test_the_chain_of_the_catalogue():
    mine, known = fpu(16), ss.models.fpu_chain(n=16, **PARAMS)
    for a, b in zip(everything(mine, points(mine)), everything(known, points(known)), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-13, atol=1e-13)
    flags = ("separable", "additive", "position_noise", "quadratic", "identity_mass", "bandwidth", "has_hessian_vector")
    assert {k: getattr(mine.traits, k) for k in flags} == {k: getattr(known.traits, k) for k in flags}
    run = {"q0": 0.1, "p0": 0.3, "step": 0.1, "steps": 20, "paths": 20, "seed": 1}
    for scheme in ("midpoint", "symplectic_euler", "stormer_verlet", "gauss2"):
        one, other = (ss.simulate(m, scheme=scheme, **run) for m in (mine, known))
        np.testing.assert_allclose(one.q, other.q, rtol=0, atol=1e-12)
    assert not mine.traits.constant_mass and mine.traits.kicked
    wrong = ss.simulate(fpu(16, beta=0.81), **run)
    assert np.abs(wrong.q - ss.simulate(known, **run).q).max() > 1e-6


def test_the_code_is_the_same_for_any_number_of_sites():
    short, long = fpu(5), fpu(3000)
    assert short.formula.file == long.formula.file and long.nnoise == 3000
    x = np.random.default_rng(1).normal(size=(3000, 8))
    known = ss.models.fpu_chain(n=3000, **PARAMS)
    np.testing.assert_allclose(long.gradient(x, x)[0], known.gradient(x, x)[0], rtol=1e-13, atol=1e-12)


@pytest.mark.usefixtures("quick_compiler")
def test_fixed_ends_have_a_bond_before_the_first_site():
    """Fixed ends: n + 1 bonds hold n sites between two walls; free ends have n - 1 bonds, a ring has n."""
    for n in (2, 3, 7):
        for ends, bonds in (("free", n - 1), ("fixed", n + 1), ("periodic", n)):
            model = ss.model_from_sympy("Sum(cos(q[i+1] - q[i]) + p[i]**2/2, i)", n=n, ends=ends)
            assert model.value(0.0, 0.0)[0] == bonds
    three = ss.model_from_sympy("Sum((q[i+1] - q[i])**2/2 + p[i]**2/2, i)", n=3, ends="fixed")
    stiffness = three.hessian(0.0, 0.0)[0][:, :, 0]
    np.testing.assert_array_equal(stiffness, [[2, -1, 0], [-1, 2, -1], [0, -1, 2]])
    assert three.value(1.0, 0.0)[0] == 1.0


@pytest.mark.parametrize("ends", ["fixed", "periodic"])
@pytest.mark.parametrize(
    "H",
    [
        "Sum(p[i]**2/2 + beta*cos(q[i]) + beta*(q[i+1]-q[i])**4/4, i)",
        "Sum(p[i+1]**2/2 + beta*(cos(q[i+1]) + (q[i+1]-q[i])**4/4), i)",
        "beta*Sum(p[i]**2/(2*beta) + cos(q[i]) + (q[i+1]-q[i])**4/4, i)",
    ],
)
def test_one_sum_is_that_of_sites_and_that_of_bonds(H, ends):
    """Traits, rows and derivatives are those of two sums. The term of a site beyond an end has its value at zero."""
    apart = "Sum(p[i]**2/2 + beta*cos(q[i]), i) + Sum(beta*(q[i+1]-q[i])**4/4, i)"
    one, two = (ss.model_from_sympy(h, ["q[k]**2"], params={"beta": 0.8}, n=9, ends=ends) for h in (H, apart))
    assert one.traits == two.traits
    assert one.traits.identity_mass
    run = {"q0": 0.3, "p0": 0.1, "step": 0.1, "steps": 5, "paths": 3, "scheme": "chin4a"}
    assert ss.simulate(one, **run).report.stepper == ss.simulate(two, **run).report.stepper
    (value, *slopes), (known, *others) = everything(one, points(one)), everything(two, points(two))
    for a, b in zip(slopes, others, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-13, atol=1e-13)
    weights = points(one)[2][0]
    np.testing.assert_allclose(value - known, 0.8 * weights * (ends == "fixed"), rtol=0, atol=1e-13)


def test_one_sum_at_free_ends_leaves_out_the_last_site():
    """A bond that is not there takes all terms of its sum with it: the last site has no mass, and a warning says so."""
    with pytest.warns(errors.StandingSiteWarning, match=r"H holds no p\[3\], so that this site does not move"):
        one = ss.model_from_sympy("Sum(p[i]**2/2 + (q[i+1]-q[i])**2/2, i)", n=4, ends="free")
    assert not one.traits.identity_mass
    np.testing.assert_array_equal(one.gradient(0.0, 1.0)[1].ravel(), [1, 1, 1, 0])


def test_sites_that_move_give_no_warning():
    """One sum with closed ends, two sums, pairs, and no kinetic energy at all."""
    bond = "(q[i+1]-q[i])**2/2"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ss.model_from_sympy(f"Sum(p[i]**2/2 + {bond}, i)", n=4, ends="periodic")
        ss.model_from_sympy(f"Sum(p[i]**2/2, i) + Sum({bond}, i)", n=4)
        ss.model_from_sympy("Sum((p[i]-p[j])**2/2 + (q[i]-q[j])**2, i < j)", n=4)
        ss.model_from_sympy(f"Sum({bond}, i)", n=4, noise=["Sum(p[i]**2, i)"])
        ss.model_from_sympy("Sum((p[i+1]+p[i])**2/2 + q[i]**2, i)", n=4)


@pytest.mark.parametrize("ends", ["free", "fixed", "periodic"])
def test_ends_are_those_of_the_formula_written_out(ends):
    mine, known = chain(ends), written_out(ends)
    at = points(mine)
    assert mine.nnoise == known.nnoise == N + 1 and mine.traits.bandwidth is None
    mixed = everything(mine, at)
    for a, b in zip(mixed, everything(known, at), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-13, atol=1e-12)
    vq, vp = np.random.default_rng(8).normal(size=(2, N, 30))
    uq, up = hessian_vector(mine, at, vq, vp)
    np.testing.assert_allclose(uq, product(mixed[3], vq) + product(mixed[4], vp), rtol=1e-12, atol=1e-12)
    back = product(mixed[4].swapaxes(0, 1), vq) + product(mixed[5], vp)
    np.testing.assert_allclose(up, back, rtol=1e-12, atol=1e-12)
    mine.probe(t=0.7)


def product(blocks, vector):
    """sum_j blocks[j, i] vector[j]."""
    return np.einsum("jil,jl->il", blocks, vector)


def hessian_vector(model, at, vq, vp):
    library = ctypes.CDLL(model.formula.file)
    function = ctypes.cast(library.formula_hessian_vector, abi.CALLBACKS["hessian_vector"])
    x, y, weights = (np.ascontiguousarray(v) for v in at)
    uq, up, values = np.full_like(x, np.nan), np.full_like(x, np.nan), np.array([*model.parameters.values(), 0.0])
    arrays = [v.ctypes.data for v in (weights, x, y, vq, vp, uq, up, values)]
    assert function(x.shape[1], model.ndof, weights.shape[0], 0.7, *arrays) == 0
    return uq, up


ON_SITE = "Sum(p[i]**2/2 + cos(q[i])*cos(t), i)"
ROWS = [  # springs alone; with backward terms, on-site terms, time, noises of the state; noises linear in p and q
    (FPU, ["-sigma*q[k]"]),
    (f"{FPU} + Sum(exp(q[i]-q[i-1]), i) + {ON_SITE[:-4]} - p[i]**2/2, i)", ["Sum(sigma*q[i]*q[i+1], i)", "sin(q[k])"]),
    (FPU, ["sigma*p[k]", "Sum(sigma*q[i], i)"]),
]


@pytest.mark.parametrize("ends", ["free", "fixed"])
@pytest.mark.parametrize(("H", "noise"), ROWS)
@pytest.mark.parametrize("lanes", [1, 5, 16, 37])
def test_rows_are_those_of_gradient_and_hessian(H, noise, ends, lanes):
    n = 9
    model = ss.model_from_sympy(H, noise, params=PARAMS, n=n, ends=ends)
    x, _, w = points(model, lanes)
    force, _ = model.gradient(x, x, w, t=0.7)
    hessian = model.hessian(x, x, w, t=0.7)[0]
    beyond = np.zeros((1, lanes))
    padded = np.concatenate([beyond, x, beyond])
    for first, last in ((0, n - 1), (0, 0), (2, 5), (n - 1, n - 1)):
        f, k = rows(model, padded[first : last + 3], w, first, last)
        for i in range(first, last + 1):
            np.testing.assert_allclose(f[i - first], force[i], rtol=1e-13, atol=1e-13)
            np.testing.assert_allclose(k[i - first, 0], hessian[i, i], rtol=1e-13, atol=1e-13)
            if i < n - 1:
                np.testing.assert_allclose(k[i - first, 1], hessian[i + 1, i], rtol=1e-13, atol=1e-13)


@pytest.mark.parametrize("ends", ["free", "fixed"])
@pytest.mark.parametrize(("H", "noise"), ROWS)
def test_a_lane_by_itself_has_the_same_bits(H, noise, ends):
    n = 300  # one tile of rows, and a remainder
    model = ss.model_from_sympy(H, noise, params=PARAMS, n=n, ends=ends)
    x, y, w = points(model, 67)  # more lanes than a strip
    beyond = np.zeros((1, 67))
    padded = np.concatenate([beyond, x, beyond])
    force, velocity = model.gradient(x, y, w, t=0.7)
    ranges = ((0, n - 1), (0, 64), (30, n - 1), (n - 1, n - 1))
    strips = [rows(model, padded[first : last + 3], w, first, last) for first, last in ranges]
    for own in lanes_alone(model, (x, y, w), force, velocity):
        for (first, last), (f, k) in zip(ranges, strips, strict=True):
            alone = rows(model, padded[first : last + 3, own], w[:, own], first, last)
            assert (alone[0] == f[:, own]).all()
            assert (alone[1][:-1] == k[:-1, :, own]).all() and (alone[1][-1, 0] == k[-1, 0, own]).all()


def lanes_alone(model, at, force, velocity):
    """Some lanes alone have the same gradients as among all lanes."""
    for lane in (0, 15, 66):
        own = slice(lane, lane + 1)
        alone = model.gradient(*(v[:, own] for v in at), t=0.7)
        assert (alone[0] == force[:, own]).all() and (alone[1] == velocity[:, own]).all()
        yield own


@pytest.mark.parametrize(("H", "noise"), ROWS)
@pytest.mark.parametrize("n", [2, 3, 300])
def test_a_ring_is_the_middle_of_a_chain_that_goes_round_thrice(H, noise, n):
    ring = ss.model_from_sympy(H, noise, params=PARAMS, n=n, ends="periodic")
    thrice = ss.model_from_sympy(H, noise, params=PARAMS, n=3 * n, ends="fixed")
    assert "rows_of_hq" in ring.formula.source and ring.traits.bandwidth is None
    at = points(ring, 67)
    x, y, w = at
    weights = [w[:1]]
    for k, text in enumerate(noise):
        each = 1 if "Sum" in text else n
        before = 1 + sum(1 if "Sum" in other else n for other in noise[:k])
        weights += [w[before : before + each]] * (1 if each == 1 else 3)
    known = thrice.gradient(np.tile(x, (3, 1)), np.tile(y, (3, 1)), np.concatenate(weights), t=0.7)
    force, velocity = ring.gradient(*at, t=0.7)
    np.testing.assert_allclose(force, known[0][n : 2 * n], rtol=1e-13, atol=1e-13)
    np.testing.assert_allclose(velocity, known[1][n : 2 * n], rtol=1e-13, atol=1e-13)
    assert len(list(lanes_alone(ring, at, force, velocity))) == 3


@pytest.mark.parametrize("scheme", ["stormer_verlet", "midpoint"])
@pytest.mark.parametrize("n", [9, 100])
def test_one_path_of_a_chain_is_that_of_a_block(scheme, n):
    H, noise = ROWS[1]
    model = ss.model_from_sympy(H, noise, params=PARAMS, n=n, ends="fixed")
    run = {"q0": 0.3 * np.sin(np.arange(float(n))), "p0": 0.0, "step": 0.1, "steps": 10, "scheme": scheme, "seed": 3}
    many, one = ss.simulate(model, paths=21, **run), ss.simulate(model, paths=1, **run)
    assert (one.q[:, :, 0] == many.q[:, :, 0]).all() and (one.p[:, :, 0] == many.p[:, :, 0]).all()


def rows(model, q, w, first, last):
    """Force and stiffness by rows, as the library calls them."""
    function = ctypes.cast(ctypes.CDLL(model.formula.file).formula_chain_rows, abi.CALLBACKS["chain_rows"])
    q, w, values = np.ascontiguousarray(q), np.ascontiguousarray(w), np.array([*model.parameters.values(), 0.0])
    f, k = np.full((last - first + 1, q.shape[1]), np.nan), np.full((last - first + 1, 2, q.shape[1]), np.nan)
    arrays = [v.ctypes.data for v in (w, q, f, k, values)]
    assert function(q.shape[1], model.ndof, w.shape[0], first, last, 0.7, *arrays) == 0
    return f, k


@pytest.mark.usefixtures("quick_compiler")
@pytest.mark.parametrize(
    ("H", "noise", "ends"),
    [
        (FPU, ["-sigma*q[k]"], "periodic"),
        (f"{FPU} + Sum(q[i]*q[i+2], i)", ["-sigma*q[k]"], "fixed"),
        (f"{FPU} + Sum(q[i]*p[i], i)", ["-sigma*q[k]"], "fixed"),
        (FPU, ["q[k]*p[k]"], "fixed"),
        (f"{FPU} + Sum(q[i+2]*q[i+1], i)", ["-sigma*q[k]"], "free"),
        (FPU, ["q[k+1]*q[k]"], "fixed"),
    ],
)
def test_other_chains_have_no_rows(H, noise, ends):
    model = ss.model_from_sympy(H, noise, params=PARAMS, n=9, ends=ends)
    assert "formula_chain_rows" not in model.formula.source


def test_midpoint_by_rows_is_the_general_step():
    H, noise = ROWS[1]
    model = ss.model_from_sympy(H, noise, params=PARAMS, n=37, ends="fixed")
    run = {"q0": 0.3 * np.sin(np.arange(37.0)), "p0": 0.0, "step": 0.1, "steps": 10, "paths": 21, "seed": 3}
    fast, plain = ss.simulate(model, **run), ss.simulate(model, general=True, **run)
    assert "tridiagonal" in fast.report.stepper
    np.testing.assert_allclose(fast.q, plain.q, rtol=0, atol=1e-12)


def test_a_far_lane_changes_no_other():
    model = chain("periodic")
    at = points(model)
    alone = model.gradient(*at)[0]
    at[0][2, 4] = 7e5
    beside = model.gradient(*at)[0]
    others = [i for i in range(30) if i != 4]
    assert (alone[:, others] == beside[:, others]).all()
    known = written_out("periodic").gradient(*at)[0]
    np.testing.assert_allclose(beside, known, rtol=1e-12, atol=1e-9)


@pytest.mark.usefixtures("quick_compiler")
@pytest.mark.parametrize(
    ("H", "more", "words"),
    [
        (FPU, {"n": 10**9}, "n = 1000000000 sites for 'Sum.*give from 2 to 100000"),
        (FPU, {"n": 1}, "n = 1 sites"),
        (FPU, {"ends": "loose"}, "ends = 'loose' does not exist: there are"),
        (FPU, {"q": "q"}, "leave out q, p"),
        ("p**2/2", {}, r"takes p as a number, which is a coordinate .*write p\[i\]"),
        ("q[1]", {}, "an index that is not i"),
        ("q[i]", {}, r"q\[i\] outside of a sum"),
        (FPU, {"noise": ["q[k]*Sum(q[i], i)"]}, "a Sum in a Sum, or beside an index"),
        ("*".join(f"Sum(q[i]**{j}, i)" for j in range(1, 18)), {}, "17 different sums in products: allowed are 16"),
        (
            "Sum(Sum(cos(q[i]-q[j]), j), i)",
            {},
            r"a Sum in a Sum.*sums over pairs as Sum\(.., i < j\), or by products of sums",
        ),
        ("Sum(q[i]*q[j], i)", {}, "the index j, where there is i"),
        ("Sum(q[i])", {}, "not written Sum"),
        ("Sum(q[i+9], i)", {}, "an index that is not i"),
        ("Sum(q[2*i], i)", {}, "an index that is not i"),
        ("Sum(q[i+8]*q[i-8], i)", {}, "reach over 17 of 8 sites: give more"),
        ("Sum(beta, i)", {}, r"a sum without q\[i\]"),
        ("Sum(x[i], i)", {}, r"an index of something that is not q\[i\] or p\[i\], and no parameter"),
        ("Sum(i*q[i]**2, i)", {}, r"takes i as a number: a term may depend on its site only by q\[i\] or p\[i\], and"),
        ("Sum(cos(q[i]-q[j]), i, j)", {}, "over all sites by one index"),
        ("Sum(q[i], i)", {"noise": ["k*q[k]"]}, "k, which is not given|takes k as a number"),
        ("Sum(q[i], beta)", {}, "sums over beta, which means something else"),
        ("2*beta", {}, "holds no Sum"),
        (FPU, {"noise": ["q[k+1]"]}, "reaches beyond free ends"),
        ("Sum(1/q[i] + (q[i+1]-q[i])**2, i)", {"ends": "fixed"}, "is not finite beyond fixed ends.*sum of their own"),
        ("Sum(log(q[i])*q[i+1], i)", {"ends": "fixed"}, "is not finite beyond fixed ends"),
        (FPU, {"params": {"q": 1.0}}, "'q' is a coordinate of sites"),
        (3, {}, "is no text"),
    ],
)
def test_bad_sums_get_a_sentence(H, more, words):
    with pytest.raises((errors.InvalidArgumentError, errors.UnknownNameError), match=words):
        ss.model_from_sympy(H, **{"n": 8, "params": {"beta": 1.0}, **more})


@pytest.mark.usefixtures("quick_compiler")
def test_a_singular_start_of_a_chain():
    model = ss.model_from_sympy("Sum(p[i]**2/2 - log(q[i]), i)", ["0.1*q[k]"], n=5)
    with pytest.raises(errors.InvalidArgumentError, match=r"not finite at q0 = \[1, 1, 0, 1, ..\].*begin elsewhere"):
        ss.simulate(model, q0=[1.0, 1.0, 0.0, 1.0, 1.0], p0=0.0, step=0.1, steps=1)
    ss.simulate(model, q0=1.0, p0=0.0, step=0.1, steps=1)


def test_a_chain_in_a_scene(tmp_path):
    file = tmp_path / "chain.toml"
    file.write_text(
        f'[model]\nH = "{FPU}"\nnoise = ["-sigma*q[k]"]\nn = 16\nends = "fixed"\n'
        "[model.params]\nbeta = 0.8\nsigma = 0.1\n[run]\nstep = 0.1\nsteps = 10\nq0 = 0.1\np0 = 0.0\npaths = 5\n"
    )
    mine = moments_of(scene.load(file))
    known = ss.moments(ss.models.fpu_chain(n=16, **PARAMS), q0=0.1, p0=0.0, step=0.1, steps=10, paths=5)
    np.testing.assert_allclose(mine.mean_energy, known.mean_energy, rtol=1e-13)
