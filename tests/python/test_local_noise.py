# SPDX-License-Identifier: BSD-3-Clause
"""Noises that touch few degrees of freedom: sums over noises that do not meet, against sums over all pairs."""

import itertools

import numpy as np
import pytest
import symsde as ss
from symsde import errors
from symsde.model.formulas import derivatives

pytestmark = pytest.mark.usefixtures("quick_compiler")

KICKED = ("verlet_kdk", "gauss_dkdkd", "chin4a", "verlet_kdk_strong2", "chin4a_strong2")
N = 6
#: noises of a ring: at sites, at bonds, and several at one site
LOCAL = {
    "sites": [[i] for i in range(N)],
    "bonds": [[i, (i + 1) % N] for i in range(N)],
    "mixed": [[0], [0, 1], [3], [], [0, 5], [2, 4]],
    "everywhere": [list(range(N))] * 3,
}
MASSES = {"one": np.eye(N), "diagonal": np.diag(1 / np.linspace(1, 2, N)), "full": np.eye(N) + 0.2}


class Ring:
    """H = p.A p/2 + sum_i (q_i - q_{i+1})^2/2 + q_i^4/4 with noises H_k = s_k cos(sum of q over what it touches)."""

    def __init__(self, lists, mass):
        self.lists, self.inverse = lists, MASSES[mass]
        self.of = np.array([[float(i in x) for i in range(N)] for x in lists])
        self.s = 0.5 + 0.1 * np.arange(len(lists))

    def slopes(self, w, q):
        return w[1:] * self.s[:, None] * np.sin(self.of @ q + 0.3)

    def gradient(self, t, w, q, p):
        hq = w[0] * (2 * q - np.roll(q, 1, 0) - np.roll(q, -1, 0) + q**3)
        return hq - self.of.T @ self.slopes(w, q), w[0] * (self.inverse @ p)

    def hessian_vector(self, t, w, *vectors):
        q, _p, vq, vp = vectors
        uq = w[0] * (2 * vq - np.roll(vq, 1, 0) - np.roll(vq, -1, 0) + 3 * q**2 * vq)
        curved = w[1:] * self.s[:, None] * np.cos(self.of @ q + 0.3)
        return uq - self.of.T @ (curved * (self.of @ vq)), w[0] * (self.inverse @ vp)

    def model(self, touches=None, **traits):
        mass = {"identity_mass": True} if (self.inverse == np.eye(N)).all() else {"constant_mass": True}
        if self.inverse[0, 1] == 0 and "constant_mass" in mass:
            mass["diagonal_mass"] = True
        given = {**mass, "separable": True, "position_noise": True, "touches": touches, **traits}
        functions = {"gradient": self.gradient, "hessian_vector": self.hessian_vector}
        return ss.Model(ndof=N, nnoise=len(self.lists), **functions, **given)


def numbered(lists):
    return [[i + 1 for i in x] for x in lists]


def both(lists, mass, scheme, **how):
    """A run whose noises say what they touch, and one whose noises do not."""
    ring, damping = Ring(LOCAL[lists], mass), how.pop("damping", None)
    given = {"q0": np.linspace(-0.5, 0.7, N), "p0": 0.2, "step": 0.2, "steps": 20, "paths": 20, "seed": 2, **how}
    models = [ring.model(numbered(LOCAL[lists])), ring.model()]
    models = models if damping is None else [x.damped(damping) for x in models]
    return [ss.simulate(x, scheme=scheme, threads=1, **given) for x in models]


@pytest.mark.parametrize("mass", MASSES)
@pytest.mark.parametrize("lists", LOCAL)
@pytest.mark.parametrize("scheme", KICKED)
def test_single_sums_are_double_sums(scheme, lists, mass):
    """Sums over sets of noises equal sums over pairs, for noises that meet and that do not, with all masses; to
    rounding.
    """
    mine, known = both(lists, mass, scheme)
    np.testing.assert_allclose(mine.q, known.q, rtol=0, atol=1e-12)
    np.testing.assert_allclose(mine.p, known.p, rtol=0, atol=1e-12)


@pytest.mark.parametrize("paths", [1, 20])
@pytest.mark.parametrize("damping", [0.4, np.linspace(0.1, 0.6, N)])
def test_of_damped_chains_and_single_paths(damping, paths):
    """Decays between kicks leave the kicks alone."""
    mine, known = both("sites", "one", "chin4a", damping=damping, paths=paths)
    np.testing.assert_allclose(mine.q, known.q, rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("lists", "mass", "colours"),
    [
        ("sites", "one", 1),
        ("sites", "diagonal", 1),
        ("sites", "full", 6),
        ("bonds", "one", 2),
        ("everywhere", "one", 3),
    ],
)
def test_calls_of_the_model_are_few(lists, mass, colours):
    """chin4a: a gradient for each kick, and one with a product for its force gradient and for each colour."""
    mine, _ = both(lists, mass, "chin4a", paths=8)
    counters, steps = mine.report.counters, 8 * 20
    assert counters["hessian_vectors"] == (1 + colours) * steps
    masses = 0 if mass == "one" else 2 + 1 + colours  # two drifts, and a velocity for each product
    assert counters["gradients"] == (4 + colours + masses) * steps


def test_formulas_say_what_noises_touch():
    """Texts of sites, expressions and parameters that are zero."""
    ring = ss.model_from_sympy("Sum(p[i]**2/3, i)", ["q[k]*q[k+1]", "Sum(q[i], i)", "p[k]"], n=3, ends="periodic")
    assert ring.traits.touches == ((1, 2), (2, 3), (1, 3), (1, 2, 3), (1,), (2,), (3,))
    assert ring.traits.diagonal_mass and ring.traits.constant_mass
    fixed = ss.model_from_sympy("Sum(p[i]**2/2, i)", ["q[k]*q[k+1] + q[k]"], n=3, ends="fixed")
    assert fixed.traits.touches == ((1, 2), (2, 3), (3,))
    sums = ss.model_from_sympy("Sum(p[i]**2/2, i)", ["Sum(q[i], i)**2", "sin(q[k])"], n=3)
    assert sums.traits.touches == ((1, 2, 3), (1,), (2,), (3,))
    few = ss.model_from_sympy(
        "p1**2/2 + a*p2**2/2 + b*p1*p2", ["q1*p2 - q1*p2 + q2", "b*q1 + p2", "1"], params={"a": 3.0, "b": 0.0}
    )
    assert few.traits.touches == few.formula.structure.touches == ((2,), (2,), ())
    assert few.traits.diagonal_mass and not few.with_parameters(b=0.1).traits.diagonal_mass
    assert few.with_parameters(b=0.1).traits.touches == ((2,), (1, 2), ())
    with pytest.warns(errors.OwnNoiseWarning):
        bath = ss.thermostat(few, beta=1.0, gamma=0.1)
    assert bath.traits.touches == ((2,), (2,), (), (1,), (2,))
    still = ss.thermostat(ss.models.fpu_chain(n=2, sigma=0.0), beta=1.0, gamma=0.1)
    assert still.traits.touches == ((), (), (1,), (2,))


@pytest.mark.parametrize("count", [3, 40])
def test_a_noise_that_touches_more_is_refused(count):
    """Of few noises and of many, by any of q and p."""

    def gradient(t, w, q, p, letter="q"):
        hidden = np.zeros((2, *q.shape))
        hidden[:, :count] = 2 * np.array([q, p])[:, :count] * w[1:]
        other = 0.1 * w[count - 1] * np.array([q, p])[:, 0] * (np.array(["q", "p"]) == letter)[:, None]
        hidden[:, 0] += other
        return w[0] * q + hidden[0], w[0] * p + hidden[1]

    given = {"ndof": count, "nnoise": count}
    honest = [[i + 1] for i in range(count)]
    honest[count - 2] = [1, count - 1]
    ss.Model(**given, gradient=gradient, touches=honest).probe(0.3, 0.4)
    for letter in "qp":

        def own(t, w, q, p, letter=letter):
            return gradient(t, w, q, p, letter)

        false = ss.Model(**given, gradient=own, touches=[[i + 1] for i in range(count)])
        with pytest.raises(errors.FalseTraitError, match=f"touches.*by {letter}_1"):
            false.probe(0.3, 0.4)


def test_a_mass_that_is_not_diagonal_is_refused():
    """diagonal_mass is probed beside constant_mass."""
    full = Ring(LOCAL["sites"], "full")
    with pytest.raises(errors.FalseTraitError, match="diagonal_mass"):
        full.model(diagonal_mass=True).probe(0.3, 0.4)
    Ring(LOCAL["sites"], "diagonal").model().probe(0.3, 0.4)


@pytest.mark.parametrize(
    ("touches", "error", "told"),
    [
        (3, errors.WrongTypeError, "list of lists"),
        ([1, 2], errors.WrongTypeError, "list of lists"),
        ([[1]], errors.WrongShapeError, "1 lists: give 2"),
        ([[1], [1] * 9], errors.WrongShapeError, "9 numbers"),
        ([[1], np.array(1)], errors.WrongTypeError, "list of lists"),
        ([[0], [1]], errors.InvalidArgumentError, "touches holds 0"),
        ([[1], [7]], errors.InvalidArgumentError, "touches holds 7"),
        ([[1], [1.5]], errors.SymsdeError, "touches"),
    ],
)
def test_lists_are_checked(touches, error, told):
    """Numbers of degrees of freedom, from 1, for each noise."""
    with pytest.raises(error, match=told):
        ss.Model(ndof=6, nnoise=2, gradient=Ring(LOCAL["sites"][:2], "one").gradient, touches=touches)


@pytest.mark.parametrize("refine", [0, 2, -1])
def test_second_terms_are_drawn_for_noises_that_meet(refine):
    """J of pairs that meet has the bits of J of all pairs, of all levels, and there is no memory of others."""
    mine, known = both("bonds", "one", "chin4a_strong2", refine=refine, paths=9)
    np.testing.assert_allclose(mine.q, known.q, rtol=0, atol=1e-12)
    assert mine.report.counters["normals"] == known.report.counters["normals"]
    assert mine.report.counters["hessian_vectors"] == (1 + 3) * 9 * 20  # a force gradient, and three colours of a ring


def test_many_sites_have_no_pairs():
    """With 3000 noises J of all pairs would take 36 MB a path and step, and so would D."""
    ring = ss.model_from_sympy("Sum(p[i]**2/2 + q[i]**4/4, i)", ["0.3*q[k]**2"], n=3000)
    run = ss.simulate(ring, q0=0.4, p0=0.1, step=0.1, steps=3, paths=64, seed=1, scheme="chin4a_strong2", threads=1)
    alone = ss.model_from_sympy("p**2/2 + q**4/4", ["0.3*q**2"])
    first = ss.simulate(alone, q0=0.4, p0=0.1, step=0.1, steps=3, paths=64, seed=1, scheme="chin4a_strong2", threads=1)
    np.testing.assert_allclose(run.q[:, 0], first.q[:, 0], rtol=1e-12)


class Line:
    """A chain, H = sum_i p_i^2 c_i/2 + q_i p_i/10 + (q_i - q_{i+1})^2/2, with noises (q_k + a p_k)^2/10 + b q_k."""

    def __init__(self, n, a=0.3, b=0.2, second=True):
        bonds = np.diff(np.eye(n), axis=0)
        self.n, zero = n, np.zeros((n, 2 * n, 2 * n))
        zero[:, np.arange(n), np.arange(n)] = np.eye(n)
        zero[:, np.arange(n), np.arange(n) + n] = zero[:, np.arange(n) + n, np.arange(n)] = a * np.eye(n)
        zero[:, np.arange(n) + n, np.arange(n) + n] = a**2 * np.eye(n)
        drift = np.block([[bonds.T @ bonds, 0.1 * np.eye(n)], [0.1 * np.eye(n), np.diag(1 + 0.1 * np.arange(n))]])
        self.matrices, self.b = np.array([drift, *(0.2 * zero * second)]), b

    def gradient(self, t, w, q, p):
        found = np.einsum("kl,kij,jl->il", w, self.matrices, np.concatenate([q, p]))
        found[: self.n] += self.b * w[1:]
        return found[: self.n], found[self.n :]

    def hessian(self, t, w, q, p):
        found, n = np.einsum("kl,kij->ijl", w, self.matrices), self.n
        return found[:n, :n], found[n:, :n], found[n:, n:]

    def model(self, touches, **traits):
        return ss.Model(
            ndof=self.n, nnoise=self.n, gradient=self.gradient, hessian=self.hessian, touches=touches, **traits
        )


BRACKETS = ("gauss2_strong32", "gauss2_strong32_areas", "gauss2_weak2", "gauss2_weak2_areas")


@pytest.mark.parametrize("mass", MASSES)
@pytest.mark.parametrize("lists", LOCAL)
def test_nested_brackets_are_sums_over_colours(lists, mass):
    """Of noises in position, with squares, differences and any mass."""
    mine, known = both(lists, mass, "gauss2_strong32", steps=6, step=0.03)
    np.testing.assert_allclose(mine.q, known.q, rtol=0, atol=1e-11)


@pytest.mark.parametrize("quadratic", [True, False])
@pytest.mark.parametrize("second", [True, False])
@pytest.mark.parametrize("scheme", BRACKETS)
def test_bands_tie_noises_of_momenta(scheme, second, quadratic):
    """Noises of neighbours have a bracket: two colours; exact brackets and differences, additive noise, all schemes."""
    line = Line(8, second=second)
    traits = {"bandwidth": 1, "quadratic": quadratic, "additive": not second, "position_noise": not second}
    given = {"q0": np.linspace(-0.5, 0.7, 8), "p0": 0.2, "step": 0.2, "steps": 4, "paths": 10, "seed": 2}
    given |= {"scheme": scheme, "threads": 1, **({"area_time": 1.0} if "areas" in scheme and second else {})}
    mine, known = (ss.simulate(line.model(x, **traits), **given) for x in ([[i + 1] for i in range(8)], None))
    np.testing.assert_allclose(mine.q, known.q, rtol=0, atol=1e-9)
    fewer = mine.report.counters["gradients"] < 0.8 * known.report.counters["gradients"]
    assert fewer or (quadratic and not second)


@pytest.mark.parametrize("noises", [["0.1*q[k]**2"], ["0.1*cos(q[k+1]+q[k])"]])
@pytest.mark.parametrize("scheme", ["gauss_dkdkd_strong2", "chin4a_strong2"])
def test_second_terms_have_their_bits_alone_and_in_blocks(scheme, noises):
    """Strips of lanes and eight steps at a time, noise by noise or all together, draw what single paths draw."""
    model = ss.model_from_sympy("Sum(p[i]**2/2 + q[i]**4/4, i)", noises, n=6, ends="periodic")
    given = {"q0": 0.3, "p0": 0.1, "step": 0.1, "steps": 21, "seed": 4, "scheme": scheme, "common_noise": 2}
    given["save_every"] = 1
    block = ss.simulate(model, paths=150, **given)
    for path in (0, 70, 149):
        alone = ss.simulate(model, paths=1, first_path=path, **given)
        assert np.array_equal(block.q[:, :, path], alone.q[:, :, 0])
        assert block.report.counters["normals"] == 150 * alone.report.counters["normals"]


@pytest.mark.parametrize("bent", [False, True])
def test_brackets_by_rows_are_gradients_and_products(bent, n=5):
    """Noises at sites of a chain with walls, which has rows, and one of all bonds, whose second derivative is no
    diagonal; in strips that are full and not, and alone, against the general stepper of formulas of single sites."""
    at = ["0", *(f"x{i}" for i in range(n)), "0"]
    pairs = [f"{b} - {a}" for a, b in itertools.pairwise(at)]
    whole = " + ".join([*(f"({x})**2/2" for x in pairs), *(f"y{i}**2/2 + x{i}**4/4" for i in range(n))])
    noises = ["Sum(0.3*cos(q[i+1] - q[i] + 0.4), i)"] * bent + ["0.3*q[k]**2 + 0.2*sin(q[k])"]
    single = [" + ".join(f"0.3*cos({x} + 0.4)" for x in pairs)] * bent
    single += [f"0.3*{x}**2 + 0.2*sin({x})" for x in at[1:-1]]
    drift = "Sum(p[i]**2/2 + q[i]**4/4, i) + Sum((q[i+1]-q[i])**2/2, i)"
    rows = ss.model_from_sympy(drift, noises, n=n, ends="fixed")
    none = ss.model_from_sympy(whole, single, q=at[1:-1], p=[f"y{i}" for i in range(n)])
    assert "formula_chain_rows" in rows.formula.source and "formula_chain_rows" not in none.formula.source
    given = {"q0": np.linspace(-0.5, 0.7, n), "p0": 0.4, "step": 0.1, "steps": 10, "seed": 3, "threads": 1}
    given["scheme"] = "gauss2_strong32"
    block, plain = (ss.simulate(x, paths=41, general=x is none, **given) for x in (rows, none))
    np.testing.assert_allclose(block.q, plain.q, rtol=0, atol=2e-13)
    np.testing.assert_allclose(block.p, plain.p, rtol=0, atol=2e-13)
    for path in (0, 17, 40):
        alone = ss.simulate(rows, paths=1, first_path=path, **given)
        assert np.array_equal(block.q[:, :, path], alone.q[:, :, 0])


def test_work_of_brackets_does_not_grow_with_sites():
    """gauss2_strong32 takes two gradients and one product an evaluation, for any number of local noises."""
    counts = []
    for n in (4, 16):
        ring = ss.model_from_sympy("Sum(p[i]**2/2 + q[i]**4/4, i)", ["0.1*q[k]**2"], n=n)
        run = ss.simulate(ring, q0=0.4, p0=0.1, step=0.1, steps=4, paths=8, seed=1, scheme="gauss2_strong32", threads=1)
        counts.append([run.report.counters[key] for key in ("gradients", "hessian_vectors")])
    for gradients, products in counts:
        assert gradients == 2 * products
    assert counts[1][0] <= 1.3 * counts[0][0]


@pytest.mark.parametrize("lists", ["sites", "bonds", "mixed"])
def test_pushes_of_noises_that_do_not_meet_are_read_together(lists):
    """The law of linear damped drifts, with unequal rates: one gradient has the pushes of all noises of a colour."""
    calls = [0]
    of = Ring(LOCAL[lists], "one").of * (0.5 + 0.1 * np.arange(N)[:, None])

    def gradient(t, w, q, p):
        calls[0] += 1
        return w[0] * q**3 + of.T @ w[1:], w[0] * p

    runs, asked = [], []
    for touches in (numbered(LOCAL[lists]), None):
        model = ss.Model(ndof=N, nnoise=N, gradient=gradient, identity_mass=True, additive=True, position_noise=True,
                         separable=True, touches=touches).damped(np.linspace(0.1, 2.0, N))  # fmt: skip
        given = {"q0": 0.3, "p0": 0.2, "step": 0.5, "paths": 4, "seed": 2, "scheme": "verlet_kdk", "threads": 1}
        run = ss.prepare(model, **given)
        calls[0] = 0
        runs.append(run.run(1))
        asked.append(calls[0])
    np.testing.assert_allclose(runs[0].q, runs[1].q, rtol=0, atol=1e-14)
    np.testing.assert_allclose(runs[0].p, runs[1].p, rtol=0, atol=1e-14)
    assert asked[1] - asked[0] == N - {"sites": 1, "bonds": 2, "mixed": 3}[lists]


MEETING = {
    "one degree": ("p**2/2 - cos(q)", [f"{0.1 / (1 + k):.4f}*sin({1 + k / 3:.4f}*q + {k / 4})" for k in range(9)]),
    "in time": ("p**2/2 - cos(q)", [f"{0.1 / (1 + k):.4f}*sin({1 + k / 3:.4f}*q + {k} + t)" for k in range(9)]),
    "two degrees": (
        "(p1**2 + p2**2)/2 + q1**2/2 + q2**2 + q1*q2**2/4",
        [f"0.05*cos({1 + k / 5:.2f}*q1 - {k / 7:.4f}*q2)" for k in range(8)] + ["0.1*q2**2"],
    ),
}


def of_formulas(name, squares, monkeypatch):
    """A model of formulas, with the squares of its noises at one pass or without."""
    monkeypatch.setattr(derivatives, "MAX_SQUARES", 1000 if squares else 0)
    model = ss.model_from_sympy(*MEETING[name])
    assert ("formula_squares" in model.formula.source) == squares
    return model


@pytest.mark.parametrize("paths", [1, 5, 70])
@pytest.mark.parametrize("scheme", ["chin4a", "verlet_kdk", "gauss2_strong32", "gauss2_weak2", "verlet_dkd_weak2"])
@pytest.mark.parametrize("name", MEETING)
def test_squares_are_products_of_single_noises(name, scheme, paths, monkeypatch):
    """Of many noises that meet: in blocks with padding and without, back in time, too, alone, in a bath."""
    step = -0.1 if paths == 5 else 0.1
    given = {"q0": 0.4, "p0": 0.1, "step": step, "steps": 12, "paths": paths, "seed": 3, "scheme": scheme}
    together, single = (of_formulas(name, squares, monkeypatch) for squares in (True, False))
    runs = [ss.simulate(model, **given) for model in (together, single)]
    assert np.abs(runs[0].q - runs[1].q).max() < 2e-13 > np.abs(runs[0].p - runs[1].p).max()
    counts = [sum(run.report.counters[x] for x in ("gradients", "hessians", "hessian_vectors")) for run in runs]
    assert counts[0] < counts[1] or scheme == "verlet_dkd_weak2"  # which has no products
    if scheme == "chin4a" and paths > 1:
        baths = [ss.simulate(ss.thermostat(x, gamma=0.3, beta=2.0), **given) for x in (together, single)]
        assert np.abs(baths[0].q - baths[1].q).max() < 2e-13
        assert not np.array_equal(baths[0].q, runs[0].q)


def test_paths_with_squares_have_their_bits_alone_and_in_blocks(monkeypatch):
    """Of padded blocks, single paths, and few lanes that Newton's iteration gathers."""
    model = of_formulas("one degree", squares=True, monkeypatch=monkeypatch)
    given = {"q0": 0.4, "p0": 0.1, "step": 0.2, "steps": 10, "seed": 3}
    for scheme in ("chin4a", "gauss2_strong32"):
        block = ss.simulate(model, scheme=scheme, paths=300, **given)
        alone = ss.simulate(model, scheme=scheme, paths=1, first_path=257, **given)
        few = ss.simulate(model, scheme=scheme, paths=3, first_path=257, **given)
        assert np.array_equal(block.q[:, :, 257:260], few.q) and np.array_equal(block.q[:, :, 257:258], alone.q)


def test_work_of_noises_that_meet_does_not_grow_with_them():
    """As many calls of the model for 18 noises on one degree of freedom as for nine; none for three on two degrees."""
    for scheme in ("chin4a", "verlet_kdk", "gauss2_weak2"):
        counts = []
        for count in (9, 18):
            model = ss.model_from_sympy("p**2/2 - cos(q)", [f"0.01*cos(q + {k})" for k in range(count)])
            counts.append(ss.simulate(model, q0=0.3, p0=0, step=0.05, steps=10, paths=9, scheme=scheme).report.counters)
        assert counts[0]["gradients"] == counts[1]["gradients"] > 0
    few = ss.model_from_sympy("(p1**2 + p2**2)/2 - cos(q1)", ["cos(q1 - q2)", "sin(q1)", "q2**3"])
    linear = ss.model_from_sympy("p**2/2 - cos(q)", [f"{k}*q" for k in range(1, 9)])
    assert "formula_squares" not in few.formula.source + linear.formula.source


def test_squares_of_parameters_that_differ_from_path_to_path():
    """Constants of each path, in blocks and alone."""
    noises = [f"s*cos(w*q + {k})/{2 + k}" for k in range(9)]
    params = {"s": np.array([0.3, 0.5, 0.7]), "w": 1.3}
    given = {"q0": 0.4, "p0": 0.1, "step": 0.1, "steps": 10, "seed": 3, "scheme": "chin4a"}
    whole = ss.simulate(ss.model_from_sympy("p**2/2 - cos(q)", noises, params=params), paths=3, **given)
    for path, s in enumerate(params["s"]):
        one = ss.model_from_sympy("p**2/2 - cos(q)", noises, params={"s": s, "w": 1.3})
        alone = ss.simulate(one, paths=1, first_path=path, **given)
        assert np.abs(whole.q[:, :, path] - alone.q[:, :, 0]).max() < 1e-13


BESIDE_MASSES = {"meet": ["-0.3*A**2*B", "0.2*cos(A + B)"], "apart": ["-0.3*A**2", "0.2*cos(B)"]}


@pytest.mark.parametrize("noises", BESIDE_MASSES)
@pytest.mark.parametrize("scheme", ["gauss2_strong32", "gauss2_weak2"])
def test_brackets_of_masses_are_those_of_scaled_positions(noises, scheme):
    """q -> sqrt(m) q and p -> p/sqrt(m) give masses of one: the same paths, in blocks and alone."""
    mass = np.array([2.0, 0.5])[:, None]
    written = ["(A**4 + B**4)/4 + A*B/3", *BESIDE_MASSES[noises]]
    plain = [x.replace("A", "q1").replace("B", "q2") for x in written]
    scaled = [x.replace("A", "(q1/sqrt(2))").replace("B", "(q2*sqrt(2))") for x in written]
    heavy = ss.model_from_sympy(f"p1**2/4 + p2**2 + {plain[0]}", plain[1:])
    one = ss.model_from_sympy(f"(p1**2 + p2**2)/2 + {scaled[0]}", scaled[1:])
    assert one.traits.identity_mass and heavy.traits.constant_mass and not heavy.traits.identity_mass
    q, p = np.array([[0.3], [0.8]]), np.array([[0.1], [-0.6]])
    given = {"step": 0.2, "steps": 10, "seed": 2, "scheme": scheme}
    for paths in (50, 1):
        mine = ss.simulate(heavy, q0=q, p0=p, paths=paths, **given)
        right = ss.simulate(one, q0=q * mass**0.5, p0=p / mass**0.5, paths=paths, **given)
        np.testing.assert_allclose(mine.q, right.q / mass**0.5, rtol=0, atol=1e-13)
        np.testing.assert_allclose(mine.p, right.p * mass**0.5, rtol=0, atol=1e-13)
        if paths == 50:
            block = mine
    assert np.array_equal(block.q[:, :, :1], mine.q)


@pytest.mark.parametrize("unit", [1e-9, 1e-3, 1e6])
def test_products_of_noises_in_other_units(unit):
    """With another unit of length no product is called false, and paths are those in the first one, times the unit."""

    def end(u):
        m = ss.model_from_sympy("p**2/2 + a*cos(q/u)", ["s*sin(q/u)"], params={"a": u**2, "s": 0.3 * u**2, "u": u})
        run = {"q0": 0.4 * u, "p0": 0.2 * u, "step": 0.05, "steps": 40, "paths": 3, "seed": 1}
        return ss.simulate(m, scheme="gauss2_strong32", **run).q[-1] / u

    np.testing.assert_allclose(end(unit), end(1.0), rtol=1e-12)


@pytest.mark.parametrize("s", [0.3, 1.0])
@pytest.mark.parametrize("noises", [("s*sin(q)", "s*cos(q)"), ("s*sin(q)", "s*sinh(q)")])
def test_products_of_noises_that_cancel(noises, s):
    """Where products of noises are a difference of equal terms, their slope is rounding, and no model is false."""
    m = ss.model_from_sympy("p**2/2 - cos(q)", noises, params={"s": s})
    for q0 in (0.0, np.pi / 2, np.pi):
        assert np.isfinite(ss.simulate(m, q0=q0, p0=0.2, step=0.01, steps=4, scheme="gauss2").q).all()
