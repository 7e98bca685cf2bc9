# SPDX-License-Identifier: BSD-3-Clause
"""Formulas that are proved to be a quadratic coupling beside functions of the actions (q_k^2 + p_k^2)/2."""

import pickle

import numpy as np
import pytest
import symsde as ss
from symsde import errors

pytestmark = pytest.mark.optimised

START = np.linspace(0.3, 1.0, 5)


def lattice(n=5, *, nonlinear="g*(q{k}**2 + p{k}**2)**2/4", noise="s*(q{k}**2 + p{k}**2)/2"):
    """A ring with energies of its own at each site."""
    sites = range(1, n + 1)
    terms = [nonlinear.format(k=k) for k in sites]
    terms += [f"e{k}*(q{k}**2 + p{k}**2)/2 - J*(q{k}*q{k % n + 1} + p{k}*p{k % n + 1})" for k in sites]
    values = {"g": 0.8, "J": 0.7, "s": 0.6} | {f"e{k}": 0.3 * (-1) ** k + 0.1 * k for k in sites}
    held = {x: y for x, y in values.items() if x in " + ".join(terms) + noise}
    return ss.model_from_sympy(" + ".join(terms), [noise.format(k=k) for k in sites], params=held)


def coupling(n, values):
    """Second derivatives of the linear part of the lattice."""
    near = np.roll(np.eye(n), 1, axis=0)
    energies = np.diag([values[f"e{k + 1}"] for k in range(n)]) if "e1" in values else 0
    return np.kron(np.eye(2), energies - values["J"] * (near + near.T))


def run(model, **more):
    given = {"q0": START, "p0": 0 * START, "step": 1 / 32, "steps": 32, "paths": 40, "seed": 3, "scheme": "gauss_dkdkd"}
    return ss.simulate(model, **given | more)


def distance(a, b):
    """Root-mean-square distance of the ends of two runs."""
    return np.sqrt(((a.q[-1] - b.q[-1]) ** 2 + (a.p[-1] - b.p[-1]) ** 2).sum(axis=0).mean())


@pytest.mark.parametrize("nonlinear", ["g*(q{k}**2 + p{k}**2)**2/4", "g*log(1 + q{k}**2 + p{k}**2)"])
@pytest.mark.parametrize("noise", ["s*(q{k}**2 + p{k}**2)/2", "s*sin(t)*(q{k}**2 + p{k}**2)*(q1**2 + p1**2)"])
def test_split_is_found_and_solves_the_equation(nonlinear, noise):
    model = lattice(nonlinear=nonlinear, noise=noise)
    assert model.traits.turned
    assert model.formula.structure.kicks == ("actions" if "sin" in noise else "phases")
    extra = 2 * 0.8 if "log" in nonlinear else 0
    exact = coupling(5, model.parameters) + extra * np.eye(10)
    np.testing.assert_allclose(model.traits.split, exact, rtol=0, atol=1e-15)
    kicked = run(model)
    norm = (kicked.q**2 + kicked.p**2).sum(axis=1)
    assert np.abs(norm - norm[0]).max() < 2e-14
    near = run(model, step=1 / 2048, steps=2048, scheme="gauss2_strong32")
    close = run(model, step=1 / 2048, steps=2048)
    assert distance(near, close) < 3e-4


@pytest.mark.parametrize("scheme", ["gauss_dkdkd", "gauss_dkdkd_strong2"])
@pytest.mark.parametrize("sign", [1, -1])
def test_paths_have_their_bits_alone(scheme, sign):
    """Forth and back in time: a path alone turns its planes side by side."""
    given = {"scheme": scheme, "step": sign / 32, "steps": 8}
    block = run(lattice(), **given)
    alone = run(lattice(), **given, first_path=23, paths=1)
    np.testing.assert_array_equal([alone.q[:, :, 0], alone.p[:, :, 0]], [block.q[:, :, 23], block.p[:, :, 23]])


@pytest.mark.parametrize("scheme", ["verlet_dkd_weak2", "gauss_dkdkd", "verlet_kdk"])
@pytest.mark.parametrize("split", [None, "0.4*(q**2 + p**2)/2"])
def test_planes_turn_where_q_and_p_are_separable(scheme, split):
    # nothing is left of steps that alternate with free drifts: without coupling every path is one exact rotation
    model = ss.model_from_sympy("w*(q**2 + p**2)/2", ["s*(q**2 + p**2)/2"], params={"w": 1.3, "s": 0.5}, split=split)
    turned = run(model, q0=0.6, p0=0.8, scheme=scheme, paths=2000, steps=16, step=1 / 8)
    assert np.abs(turned.q**2 + turned.p**2 - 1).max() < 1e-13
    angle = np.unwrap(np.arctan2(-turned.p[:, 0], turned.q[:, 0]), axis=0)
    gained = (angle[-1] - angle[0]) / 2
    assert abs(gained.mean() - 1.3) < 5 * 0.5 / np.sqrt(2 * 2000)  # five standard errors


@pytest.mark.filterwarnings("ignore::symsde.errors.DoubtfulRunWarning")
@pytest.mark.parametrize(
    ("g", "coupling", "step", "rate"),
    [
        (0.8, 0.7, 1.24, None),
        (0.8, 0.7, 1.26, 0.8),
        (50.0, 0.7, 0.71, None),
        (50.0, 0.7, 0.72, 1.4),
        (1e-3, 0.7, 50.0, None),
        (0.8, 0.0, 50.0, None),
    ],
)
def test_steps_too_long_for_both_parts_are_doubtful(g, coupling, step, rate):
    # rates: g q^2 of the turns, 1 at most of q, and 2 J of the coupling; energies of sites turn planes, too
    model = lattice().with_parameters(g=g, J=coupling)
    warned = [x for x in run(model, step=step, steps=2).report.warnings if "exceeds 1: steps alternate" in x]
    assert len(warned) == (rate is not None)
    if rate:
        assert f"h*omega = {step * rate:g} (omega of the slower part of H" in warned[0]


def test_values_of_parameters_change_the_split():
    model = lattice()
    for changed in ({"J": 0.2}, {"J": 0.0}, {"J": 1.0, "e2": 2.0}):
        other = model.with_parameters(**changed)
        np.testing.assert_allclose(other.traits.split, coupling(5, other.parameters), rtol=0, atol=1e-15)
        np.testing.assert_array_equal(other.formula.structure.split, other.traits.split)
        still = {"step": 1 / 256, "steps": 256, "paths": 1, "refine": 1, "increments": np.zeros((512, 5, 1))}
        assert distance(run(other, scheme="gauss4", **still), run(other, **still)) < 2e-5
        again = pickle.loads(pickle.dumps(other))
        assert again.traits.split == other.traits.split
        np.testing.assert_array_equal(run(again).q, run(other).q)


def test_coefficients_by_path_have_no_split():
    """A matrix of each path would be another flow of each: such parameters are refused, those of kicks are not."""
    model = lattice()
    by_path = model.with_parameters(J=np.linspace(0.1, 1, 40))
    assert by_path.traits.split is None
    with pytest.raises(errors.IncompatibleError, match="position_noise"):
        run(by_path)
    strengths = model.with_parameters(s=np.linspace(0.1, 1, 40))
    assert strengths.traits.turned
    one = run(model.with_parameters(s=strengths.parameters["s"][7]))
    np.testing.assert_array_equal(run(strengths).q[:, :, 7], one.q[:, :, 7])


def test_sums_over_sites_have_the_bits_of_their_terms():
    """A ring and an open chain of sums, and the same formulas site by site; bits but for the order of sums."""
    for ends in ("periodic", "free"):
        model = ss.model_from_sympy(
            "g*Sum((q[i]**2 + p[i]**2)**2/4, i) - J*Sum(q[i]*q[i+1] + p[i]*p[i+1], i) + .15*Sum(q[i]**2 + p[i]**2, i)",
            noise="s*(q[k]**2 + p[k]**2)/2", params={"g": 0.8, "J": 0.7, "s": 0.6}, n=5, ends=ends,
        )  # fmt: skip
        assert model.traits.turned
        near = np.roll(np.eye(5), 1, axis=0) if ends == "periodic" else np.eye(5, k=1)
        exact = np.kron(np.eye(2), 0.3 * np.eye(5) - 0.7 * (near + near.T))
        np.testing.assert_allclose(model.traits.split, exact, rtol=0, atol=1e-15)
        other = model.with_parameters(J=0.2)
        np.testing.assert_allclose(other.traits.split, exact + np.kron(np.eye(2), 0.5 * (near + near.T)), atol=1e-15)
    ring = ss.model_from_sympy(
        "Sum(g*(q[i]**2 + p[i]**2)**2/4 - J*(q[i]*q[i+1] + p[i]*p[i+1]), i)",
        noise="s*(q[k]**2 + p[k]**2)/2", params={"g": 0.8, "J": 0.7, "s": 0.6}, n=5, ends="periodic",
    )  # fmt: skip
    alike = lattice().with_parameters(**{f"e{k}": 0.0 for k in range(1, 6)})
    np.testing.assert_allclose(run(ring).q, run(alike).q, rtol=0, atol=1e-13)


def test_energies_of_sites_may_be_left_to_kicks_by_hand():
    """D is the hopping alone, then with one half of an energy; norms stay, and paths are those of the split found."""
    found = lattice()
    texts = found.formula.hamiltonians
    hops = "-J*(" + " + ".join(f"q{k}*q{k % 5 + 1} + p{k}*p{k % 5 + 1}" for k in range(1, 6)) + ")"
    for form, left in ((hops, np.zeros(5)), (f"{hops} + .1*(q1**2 + p1**2)", np.eye(5)[0] * 0.2)):
        model = ss.model_from_sympy(texts[0], list(texts[1:]), params=found.parameters, split=form)
        assert model.traits.turned
        near = -0.7 * (np.roll(np.eye(5), 1, axis=0) + np.roll(np.eye(5), -1, axis=0))
        np.testing.assert_allclose(model.traits.split, np.kron(np.eye(2), near + np.diag(left)), rtol=0, atol=1e-15)
        kicked = run(model, step=1 / 512, steps=512)
        norm = (kicked.q**2 + kicked.p**2).sum(axis=1)
        assert np.abs(norm - norm[0]).max() < 2e-13
        assert distance(kicked, run(found, step=1 / 512, steps=512)) < 2e-4
    with pytest.raises(errors.InvalidArgumentError, match="depends on a momentum"):
        ss.model_from_sympy(texts[0], list(texts[1:]), params=found.parameters, split=f"{hops} + q1**2")


@pytest.mark.parametrize(
    ("nonlinear", "noise"),
    [
        ("g*q{k}**4", "s*(q{k}**2 + p{k}**2)/2"),  # no function of the actions
        ("g*(q{k}**2 + p{k}**2)**2 + t*q{k}*p{k}", "s*(q{k}**2 + p{k}**2)/2"),  # D depends on time
        ("g*sqrt(q{k}**2 + p{k}**2)", "s*(q{k}**2 + p{k}**2)/2"),  # no derivatives at rest
        ("g*(q{k}**2 + p{k}**2)**2 + q{k}", "s*(q{k}**2 + p{k}**2)/2"),  # a force
    ],
)
def test_what_is_no_function_of_the_actions(nonlinear, noise):
    model = lattice(nonlinear=nonlinear, noise=noise)
    assert not model.traits.turned
    with pytest.raises(errors.IncompatibleError, match="position_noise"):
        run(model, q0=START + 0.1, p0=START)


def test_a_noise_that_does_not_commute_is_named():
    with pytest.raises(errors.IncompatibleError, match=r"with which the noise 's\*q1' does not commute"):
        run(lattice(noise="s*q{k}"), paths=1)


def test_chains_with_other_noise_or_functions_of_sums_are_not_split():
    for H, noise in (
        ("Sum((q[i]**2 + p[i]**2)**2, i)", "s*q[k]"),
        ("Sum((q[i]**2 + p[i]**2)**2, i) + Sum(q[i]**2 + p[i]**2, i)**2", "s*(q[k]**2 + p[k]**2)"),
        ("Sum((q[i]**2 + p[i]**2)**2 + t*q[i]*p[i], i)", "s*(q[k]**2 + p[k]**2)"),
        ("Sum(q[i]**4 + p[i]**2/2, i)", "s*(q[k]**2 + p[k]**2)"),
    ):
        assert not ss.model_from_sympy(H, noise=noise, params={"s": 0.2}, n=4, ends="periodic").traits.turned


def test_advice_knows_the_kicks():
    advice = ss.advise(lattice(), q0=START, p0=0 * START, horizon=1.0, tolerance=1e-3, seed=1, seconds=1000.0)
    assert advice.scheme == "gauss_dkdkd"
