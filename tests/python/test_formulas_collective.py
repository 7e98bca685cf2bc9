# SPDX-License-Identifier: BSD-3-Clause
"""Functions of sums over sites: against formulas written out, traits, any number of sites."""

import ctypes

import numpy as np
import pytest
import symsde as ss
from symsde.native import abi

pytest.importorskip("sympy")

from symsde.model.formulas import compiler
from symsde.model.formulas.sites import make_chain

if compiler.command() is None:
    pytest.skip("no C compiler", allow_module_level=True)

pytestmark = pytest.mark.optimised

N = 5
ROTATORS = "Sum(p[i]**2/2, i) - K*(Sum(cos(q[i]), i)**2 + Sum(sin(q[i]), i)**2)/(2*N)"
PARAMS = {"K": 1.2, "N": float(N), "s": 0.3, "a": 2.5}
# terms, a constant, products of sums of q and p and of neighbours, a family of noises before a noise with a function
H = ROTATORS + " + exp(Sum(q[i]*p[i+1]/9, i))*Sum(p[i], i)*sin(t) + 3*(Sum(p[i]**3/9, i) + a)"
NOISE = ["s*sin(q[k])", "s*sqrt(1 + Sum(cos(q[i]), i)**2)*Sum(p[j], j) + Sum(q[i]**2, i)"]


def mean_field(n=N, H=ROTATORS, noise=("s*q[k]",), **params):
    return ss.model_from_sympy(H, list(noise), params={**PARAMS, "N": float(n), **params}, n=n)


def written_out(ends, H=H, noise=NOISE):
    """The same Hamiltonian, site by site."""

    def total(body):
        body, index = body.rsplit(",", 1)
        index, terms = index.strip(), []
        for i in range(-1 if ends == "fixed" else 0, N + 1 if ends == "fixed" else N):
            places = {f"[{index}]": i, f"[{index}+1]": i + 1}
            text = body
            for place, j in places.items():
                for x in "qp":
                    there = 0 <= j < N or ends == "periodic"
                    if f"{x}{place}" in text and not there and ends == "free":
                        text = "0"
                    text = text.replace(f"{x}{place}", f"{x}{j % N + 1}" if there else "0")
            if any(f"{x}{j}" in text for x in "qp" for j in range(1, N + 1)):
                terms.append(f"({text})")
        return f"({'+'.join(terms)})"

    def expanded(text):
        while "Sum(" in text:
            start = text.index("Sum(")
            end, depth = start + 4, 1
            while depth:
                depth += {"(": 1, ")": -1}.get(text[end], 0)
                end += 1
            text = text[:start] + total(text[start + 4 : end - 1]) + text[end:]
        return text

    names = {x: [f"{x}{i}" for i in range(1, N + 1)] for x in "qp"}
    noises = []
    for text in noise:
        noises += [text.replace("q[k]", x) for x in names["q"]] if "[k]" in text else [expanded(text)]
    return ss.model_from_sympy(expanded(H), noises, params=PARAMS, **names)


def points(model, count=30):
    rng = np.random.default_rng(2)
    x, y = rng.normal(size=(2, model.ndof, count))
    return x, y, rng.normal(size=(model.nnoise + 1, count))


def everything(model, at):
    return [model.value(*at, t=0.7), *model.gradient(*at, t=0.7), *model.hessian(*at, t=0.7)]


@pytest.mark.usefixtures("quick_compiler")
@pytest.mark.parametrize("ends", ["free", "fixed", "periodic"])
def test_functions_of_sums_are_the_formula_written_out(ends):
    mine = ss.model_from_sympy(H, NOISE, params=PARAMS, n=N, ends=ends)
    known = written_out(ends)
    at = points(mine)
    mixed = everything(mine, at)
    for a, b in zip(mixed, everything(known, at), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-13, atol=1e-13)
    vq, vp = np.random.default_rng(8).normal(size=(2, N, 30))
    uq, up = product_by(mine, at, vq, vp)
    qq, qp, pp = mixed[3:]
    np.testing.assert_allclose(uq, times(qq, vq) + times(qp, vp), rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(up, times(qp.swapaxes(0, 1), vq) + times(pp, vp), rtol=1e-12, atol=1e-13)
    mine.probe(t=0.7)


def times(blocks, vector):
    """sum_j blocks[j, i] vector[j]."""
    return np.einsum("jil,jl->il", blocks, vector)


def product_by(model, at, vq, vp):
    """The generated product of the Hessian with a vector."""
    library = ctypes.CDLL(model.formula.file)
    function = ctypes.cast(library.formula_hessian_vector, abi.CALLBACKS["hessian_vector"])
    x, y, weights = (np.ascontiguousarray(v) for v in at)
    uq, up, values = np.full_like(x, np.nan), np.full_like(x, np.nan), np.array([*model.parameters.values(), 0.0])
    arrays = [v.ctypes.data for v in (weights, x, y, vq, vp, uq, up, values)]
    assert function(x.shape[1], model.ndof, weights.shape[0], 0.7, *arrays) == 0
    return uq, up


@pytest.mark.parametrize("scheme", ["midpoint", "gauss2", "stormer_verlet", "symplectic_euler"])
def test_runs_are_those_of_the_formula_written_out(scheme):
    noise = ["s*sin(q[k])"]
    mine = ss.model_from_sympy(ROTATORS, noise, params=PARAMS, n=N)
    known = written_out("free", ROTATORS, noise)
    given = {"q0": np.linspace(0, 2, N), "p0": 0.3, "step": 0.1, "steps": 20, "paths": 21, "seed": 1}
    one, other = (ss.simulate(m, scheme=scheme, **given) for m in (mine, known))
    np.testing.assert_allclose(one.q, other.q, rtol=0, atol=1e-12)
    alone = ss.simulate(mine, scheme=scheme, **{**given, "first_path": 7, "paths": 1})
    assert (alone.q[:, :, 0] == one.q[:, :, 7]).all()


@pytest.mark.usefixtures("quick_compiler")
def test_the_code_is_the_same_for_any_number_of_sites_and_its_work_grows_with_them():
    noise = ["s*q[k]", "s*Sum(cos(q[i]), i)**2/N"]  # the last noise's number depends on the number of sites
    short, long = mean_field(5, noise=noise), mean_field(100_000, noise=noise)
    assert short.formula.file == long.formula.file and long.nnoise == 100_001
    x, w = np.random.default_rng(1).normal(size=(100_000, 2)), np.zeros((100_002, 2))
    w[0], w[-1] = 1.0, 0.5
    c, s = (f(x).mean(axis=0) for f in (np.cos, np.sin))
    wanted = PARAMS["K"] * (np.sin(x) * c - np.cos(x) * s) - PARAMS["s"] * np.sin(x) * c
    np.testing.assert_allclose(long.gradient(x, x, w)[0], wanted, rtol=0, atol=1e-12)  # pairs would take hours


def test_many_sites_are_stepped_by_products():
    given = {"q0": np.linspace(-1, 1, 96), "p0": 0.1, "step": 0.5, "steps": 5, "paths": 8, "seed": 1}
    model = mean_field(96, K=5.0)  # stiff, so that Newton's method is used
    run, plain, block = (ss.simulate(model, **(given | more)) for more in ({}, {"general": True}, {"paths": 20}))
    assert (run.report.lanes, block.report.lanes) == (1, 24)
    np.testing.assert_array_equal(run.q, block.q[..., :8])
    assert run.report.stepper == "stages, momenta eliminated"
    assert run.report.counters["hessian_vectors"] > 0 == run.report.counters["hessians"]
    np.testing.assert_allclose(run.q, plain.q, rtol=0, atol=1e-10)
    defect = ss.diagnose.symplecticity(mean_field(8), "gauss2", q=np.linspace(0, 2, 8), p=0.1, step=0.3)
    assert defect.max() < 1e-13


FLAGS = ("separable", "additive", "position_noise", "quadratic", "identity_mass", "bandwidth")


@pytest.mark.parametrize(
    ("H", "noise", "wanted"),
    [
        (ROTATORS, "q[k]", (1, 1, 1, 0, 1, None)),
        ("Sum(p[i]**2/2, i) + Sum(q[i], i)**2", "q[k]", (1, 1, 1, 1, 1, None)),
        ("Sum(p[i]**2/2, i) + Sum(q[i]**2, i)**2", "q[k]", (1, 1, 1, 0, 1, None)),
        ("Sum(p[i]**2/2, i) + Sum(p[i], i)**2", "p[k]", (1, 1, 0, 1, 0, None)),
        ("Sum(p[i]**2/2, i) + Sum(q[i], i)*Sum(p[i], i)", "q[k]", (0, 1, 1, 1, 0, None)),
        ("Sum(p[i]**2/2, i) + exp(Sum(q[i]*p[i], i))", "q[k]", (0, 1, 1, 0, 0, None)),
        ("Sum(p[i]**2/2, i)", "Sum(q[i], i)**2", (1, 0, 1, 1, 1, None)),
        ("Sum(p[i]**2/2, i)", "Sum(p[i], i)**2", (1, 0, 0, 1, 1, None)),
        ("2*(Sum(p[i]**2/4, i) + 3*Sum(q[i]**2, i)) + a", "q[k]", (1, 1, 1, 1, 1, 0)),
        ("(Sum(q[i], i) + 1)**2 - Sum(q[i], i)**2 + Sum(p[i]**2/2, i)", "q[k]", (1, 1, 1, 1, 1, 0)),
        ("(Sum(q[i], i) + 1)**3 - Sum(q[i], i)**3 - 3*Sum(q[i], i)**2 + Sum(p[i]**2/2, i)", "q[k]", (1, 1, 1, 1, 1, 0)),
    ],
)
def test_traits(H, noise, wanted):
    traits = make_chain(H=H, noise=[noise], params={**PARAMS, "N": 9.0}, t=None, n=9, ends="free").traits
    assert tuple(traits[x] for x in FLAGS) == wanted


@pytest.mark.usefixtures("quick_compiler")
def test_a_constant_counts_in_the_value():
    model = mean_field(9, "Sum(p[i]**2/2, i) + a", ["q[k]"])
    assert model.value(0.0, 1.0) == [4.5 + PARAMS["a"]]
    assert "formula_chain_rows" not in model.formula.source


def test_a_far_lane_changes_no_other():
    model = mean_field()
    at = points(model)
    alone = model.gradient(*at)[0]
    at[0][2, 4] = 7e15  # a lane where an inexact reduction of the angle loses all digits
    beside = model.gradient(*at)[0]
    others = [i for i in range(30) if i != 4]
    assert (alone[:, others] == beside[:, others]).all()
    known = written_out("free", ROTATORS, ["s*q[k]"]).gradient(*at)[0]
    np.testing.assert_allclose(beside, known, rtol=1e-12, atol=1e-9)
