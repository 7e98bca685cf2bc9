# SPDX-License-Identifier: BSD-3-Clause
"""Gradients through kicks between rotations, flows of a quadratic part and midpoint steps, to 1e-9 of differences."""

import numpy as np
import pytest
import symsde as ss
from symsde.errors import IncompatibleError
from symsde.model.formulas import wide_flows
from symsde.model.formulas.wide import Positions

RUN = {"q0": 0.7, "p0": 0.3, "step": 0.1, "steps": 20, "paths": 12, "seed": 3}
STENCIL = ((1, 3 / 4), (2, -3 / 20), (3, 1 / 60))  #: a central difference of sixth order
SIZE = 3e-3
OF_PART = ("gauss_dkdkd", "verlet_dkd_weak2", "verlet_kdk", "chin4a", "gauss_dkdkd_strong2", "chin4a_strong2")


def made(formula, noise, damping, values, **more):
    """A model from formulas, damped if rates are given."""
    model = ss.model_from_sympy(formula, noise, params=values, **more)
    return model if damping is None else model.damped(damping)


def charge(damping=None, **values):
    """A charge in a magnetic field, whose kicks are those of the potential."""
    values = {"B": 1.3, "k": 0.9, "s": 0.3} | values
    formula = "((p1 + B*q2/2)**2 + (p2 - B*q1/2)**2)/2.4 + k*cos(q1)*cos(q2)"
    return made(formula, ["s*sin(q1)", "-s*q2"], damping, values)


def heavy(damping=None, **values):
    """The same with a parameter of the mass, and one that is 1, where formulas fold it."""
    values = {"B": 1.3, "m": 1.2, "w": 1.0} | values
    formula = "((p1 + B*q2/2)**2 + (p2 - B*q1/2)**2)/(2*m) + w**2*q1**2/2 + q2**4/4"
    return made(formula, ["0.3*sin(q1)", "-0.2*q2"], damping, values)


def stiff(damping=None, **values):
    """A stiff spring, whose frequency depends on two parameters, with two noises."""
    values = {"w": 1.8, "c": 0.4, "s": 0.3} | values
    return made("p**2/2 + w**2*q**2/2 + c*q**2 + q**4/4", ["s*sin(q)", "-0.2*q"], damping, values)


def springs(damping=None, **values):
    """Two stiff springs, with a parameter each and a common one, which a soft one couples."""
    values = {"w": 1.8, "v": 1.1, "c": 0.4} | values
    formula = "(p1**2 + p2**2)/2 + w**2*q1**2/2 + (v**2/2 + c*w)*q2**2 + q1**2*q2**2/4"
    return made(formula, ["0.3*sin(q1)", "-0.2*q2"], damping, values)


def bent(damping=None, **values):
    """H that no splitting into drifts and kicks fits."""
    values = {"a": 0.3, "s": 0.3} | values
    return made("p**2/2*(1 + a*q**2) + q**4/4", ["s*sin(q)"], damping, values)


def lattice(damping=None, k=(2.0, 3.5, 2.6, 3.1), **values):
    """Springs with numbers of their own, as a quadratic part beside quartic wells."""
    values = {"b": 0.3, "s": 0.2} | values
    form = "Sum(p[i]**2/2 + k[i]*(q[i+1]-q[i])**2/2, i)"
    formula = f"{form} + Sum(b*q[i]**4/4, i)"
    return made(formula, ["s*sin(q[j])"], damping, {"k": np.array(k), **values}, n=4, ends="periodic", split=form)


def differences(make, damping, name, run):
    """Differences of q_1^2 + p_1 at the end by a parameter, or by all of q0 or p0."""
    model, total = make(damping), 0
    for k, weight in STENCIL:
        for h in (k * SIZE, -k * SIZE):
            moved = run | ({name: run[name] + h} if name in run else {})
            other = model if name in run else make(damping, **{name: np.add(model.parameters[name], h)})
            end = ss.simulate(other, **moved)
            total = total + np.sign(h) * weight * (end.last_q[0] ** 2 + end.last_p[0]) / SIZE
    return total


def require_gradient(make, damping=None, names=None, **run):
    """All derivatives of each path are right to 1e-9 of the largest, where a fault of 1 % is seen."""
    run, model = RUN | run, make(damping)
    names = [*model.parameters] if names is None else names
    found = ss.gradient(model, "q_1**2 + p_1", [*names, "q0", "p0"], **run)
    for name in (*names, "q0", "p0"):
        right = differences(make, damping, name, run)
        mine = found.by_path[name]
        mine = mine.sum(axis=0) if mine.ndim == 2 else mine
        assert abs(mine - right).max() < 1e-9 * abs(right).max(), name
        assert abs(1.01 * mine - right).max() > 1e-4 * abs(right).max()
    return found


@pytest.mark.parametrize("scheme", OF_PART)
@pytest.mark.parametrize("damping", [None, 0.4, [0.3, 0.5]])
def test_magnetic_field(scheme, damping):
    """The flow of the quadratic part of a charge, by the field and by the kicks beside it, with brackets of noises;
    with rates of damping that differ.
    """
    if damping and scheme == "verlet_dkd_weak2":
        pytest.skip("takes no damping")
    require_gradient(charge, damping, scheme=scheme)


@pytest.mark.parametrize("damping", [None, 0.4])
def test_mass_and_folded_values(damping):
    """A parameter of the mass changes the flow, too; a value of 1 is folded in formulas of the path, not here."""
    require_gradient(heavy, damping, scheme="gauss_dkdkd")


@pytest.mark.parametrize("scheme", ["gauss_dkdkd_rotation", "exact_rotation"])
@pytest.mark.parametrize("damping", [None, 0.4, 6.0])
@pytest.mark.filterwarnings("ignore::symsde.errors.DoubtfulRunWarning")
def test_rotations(scheme, damping):
    """Rotations by frequencies that depend on parameters, decaying or overdamped."""
    require_gradient(stiff, damping, scheme=scheme)


@pytest.mark.parametrize("damping", [None, 0.4])
def test_rotations_of_two_springs(damping):
    """Each degree of freedom turns by its own frequency, with derivatives of its own."""
    require_gradient(springs, damping, scheme="gauss_dkdkd_rotation", q0=np.array([0.7, 0.4]))


@pytest.mark.parametrize("scheme", ["gauss_dkdkd_midpoint", "verlet_kdk_midpoint"])
@pytest.mark.parametrize("damping", [None, 0.4])
@pytest.mark.parametrize("make", [stiff, bent, charge])
def test_midpoint_steps(make, damping, scheme):
    """Midpoint steps of all of H between kicks of the noises, with momenta eliminated and without."""
    if scheme == "verlet_kdk_midpoint" and make is not stiff:
        pytest.skip("needs a constant mass")
    require_gradient(make, damping, scheme=scheme)


def test_midpoint_steps_between_unequal_decays():
    require_gradient(charge, [0.3, 0.5], scheme="gauss_dkdkd_midpoint")


def test_products_of_noises_back_in_time():
    """Their mean c h |h| keeps its sign in both directions of time."""
    require_gradient(charge, scheme="verlet_kdk", step=-0.1)


@pytest.mark.parametrize("scheme", ["gauss_dkdkd", "verlet_kdk"])
def test_parameters_of_sites(scheme):
    """Derivatives by every spring of a lattice, whose sum is that by all of them."""
    found = require_gradient(lattice, scheme=scheme, paths=4, steps=10)
    assert found.by_path["k"].shape == (4, 4)
    one = np.array([0, SIZE, 0, 0])
    run, k = RUN | {"scheme": scheme, "paths": 4, "steps": 10}, lattice().parameters["k"]
    right = 0
    for i, weight in STENCIL:
        for sign in (1, -1):
            end = ss.simulate(lattice(k=k + sign * i * one), **run)
            right = right + sign * weight * (end.last_q[0] ** 2 + end.last_p[0]) / SIZE
    assert abs(found.by_path["k"][1] - right).max() < 1e-9 * abs(right).max()


def test_parameters_by_path():
    """Each path has its own stiffness of the potential beside one field, also in midpoint steps."""
    k = np.linspace(0.7, 1.1, RUN["paths"])
    form = "((p1 + B*q2/2)**2 + (p2 - B*q1/2)**2)/2.4"
    for scheme in ("gauss_dkdkd", "gauss_dkdkd_midpoint"):
        given = {"noise": ["0.3*sin(q1)"], "split": form}
        formula = f"{form} + k*cos(q1)*cos(q2)"
        model = ss.model_from_sympy(formula, params={"B": 1.3, "k": k}, **given)
        found = ss.gradient(model, "q_1**2", ["B", "k"], **RUN, scheme=scheme)
        for i in (0, 7):
            alone = ss.model_from_sympy(formula, params={"B": 1.3, "k": float(k[i])}, **given)
            right = ss.gradient(alone, "q_1**2", ["B", "k"], **RUN, scheme=scheme)
            for name in ("B", "k"):
                np.testing.assert_allclose(found.by_path[name][i], right.by_path[name][i], rtol=1e-11)


@pytest.mark.parametrize(
    ("make", "scheme"), [(charge, "gauss_dkdkd"), (charge, "verlet_kdk"), (stiff, "gauss_dkdkd_rotation"),
                         (bent, "gauss_dkdkd_midpoint"), (stiff, "exact_rotation")]
)  # fmt: skip
def test_tangent_maps(make, scheme):
    """Rows of tangent maps are gradients, which another sweep finds; they are symplectic, and by one rate conformal."""
    run = RUN | {"scheme": scheme}
    found = ss.tangent(make(), [*make().parameters], **run)
    right = ss.gradient(make(), "q_1", [*make().parameters, "q0", "p0"], **run).by_path
    row = np.concatenate((right["q0"], right["p0"]))
    assert abs(found.matrix[0] - row).max() < 1e-13 * abs(row).max()
    for name in make().parameters:
        assert abs(found.by[name][0] - right[name]).max() < 1e-13 * abs(right[name]).max()
    assert found.defect().max() < 1e-13
    damped = ss.tangent(make(0.4), **run)
    assert damped.defect(np.exp(-0.8)).max() < 1e-13 and damped.defect(np.exp(-0.81)).min() > 1e-5


def test_planted_faults(monkeypatch):
    """A slope of S, or of a square of the frequencies, that is wrong by 1 % fails the comparison."""
    right = wide_flows._slopes
    for make, scheme, name in ((charge, "gauss_dkdkd", "B"), (stiff, "gauss_dkdkd_rotation", "w")):
        monkeypatch.setattr(wide_flows, "_slopes", lambda *given: 1.01 * right(*given))
        with pytest.raises(AssertionError, match=name):
            require_gradient(make, names=[name], scheme=scheme)
        monkeypatch.setattr(wide_flows, "_slopes", right)
        require_gradient(make, names=[name], scheme=scheme)


def test_slopes_that_are_not_known():
    """Complex numbers give exact derivatives; a function of real numbers alone, and a jump, give none."""
    values, positions = {"a": 0.7, "b": 2.0}, Positions(["a", "b"])
    found = wide_flows._slopes(lambda x: np.array([x[0] ** 3 * x[1]]), values, positions)
    np.testing.assert_allclose(found, [[2 * 3 * 0.7**2], [0.7**3]], rtol=1e-15)
    assert wide_flows._slopes(lambda x: np.array([abs(x[0])]), values, positions) is None
    assert wide_flows._slopes(lambda x: np.array([x[0] * (x[1].real > 2)]), values, positions) is None


@pytest.mark.parametrize(
    ("make", "damping", "names", "scheme", "why"),
    [
        (heavy, None, ["m"], "chin4a", "over masses that a parameter changes"),
        (lambda damping: made("p**2/2 + w*q**2/2 + q**4/4", ["0.3*q"], damping, {"w": 1.3}), 0.4, ["w"],
         "gauss_dkdkd_rotation", "exact noise of damped flows"),
        (lambda _: made("q1*p2 - q2*p1 + (q1**2 + p1**2)**2/4", ["0.1*(q1**2 + p1**2)"], None, {},
                        split="q1*p2 - q2*p1"), None, [], "gauss_dkdkd", "turn planes"),
    ],
)  # fmt: skip
def test_refused(make, damping, names, scheme, why):
    """What has no derivative here is refused with its reason, and midpoint takes it."""
    with pytest.raises(IncompatibleError, match=why):
        ss.gradient(make(damping), "q_1", [*names, "q0"], **RUN, scheme=scheme)
    ss.gradient(make(damping), "q_1", [*names, "q0"], **RUN, scheme="midpoint")


def test_own_model():
    """A quadratic part of a model of functions: derivatives by the initial state, and as its formulas have them."""
    b = 1.3 / 2
    second = np.array([[b * b, 0, 0, -b], [0, b * b, b, 0], [0, b, 1, 0], [-b, 0, 0, 1]]) / 1.2

    def gradient(t, w, q, p):
        z = np.concatenate((q, p))
        rest = np.concatenate((0.9 * np.array([-np.sin(q[0]) * np.cos(q[1]), -np.cos(q[0]) * np.sin(q[1])]), 0 * p))
        whole = w[0] * (second @ z + rest)
        whole[:2] += w[1] * np.array([0.3 * np.cos(q[0]), 0 * q[0]]) + w[2] * np.array([0 * q[0], 0 * q[0] - 0.3])
        return whole[:2], whole[2:]

    def product(t, w, q, p, vq, vp):  # noqa: PLR0917
        whole = w[0] * np.tensordot(second, np.concatenate((vq, vp)), 1)
        a, b = np.cos(q[0]) * np.cos(q[1]), np.sin(q[0]) * np.sin(q[1])
        whole[0] += 0.9 * w[0] * (-a * vq[0] + b * vq[1]) - 0.3 * w[1] * np.sin(q[0]) * vq[0]
        whole[1] += 0.9 * w[0] * (b * vq[0] - a * vq[1])
        return whole[:2], whole[2:]

    split = charge().traits.split
    own = ss.Model(ndof=2, nnoise=2, gradient=gradient, hessian_vector=product, split=split, position_noise=True)
    run = RUN | {"scheme": "gauss_dkdkd"}
    found, right = (ss.gradient(x, (end, slope), ["q0", "p0"], **run) for x in (own, charge()))
    for name in ("q0", "p0"):
        np.testing.assert_allclose(found.by_path[name], right.by_path[name], rtol=1e-11)


def end(t, q, p):
    """q_1 at the end."""
    return q[-1, 0]


def slope(t, q, p):
    """Its derivatives."""
    fq = np.zeros_like(q)
    fq[-1, 0] = 1
    return fq, np.zeros_like(p)


@pytest.mark.parametrize("unit", [1e7, 1e12, 1e-7])
def test_other_units_of_time(unit):
    """With another unit of time the derivatives by the field are those in the first one, divided by it."""

    def found(u):
        model = made(
            "((p1 + B*q2/2)**2 + (p2 - B*q1/2)**2)/2 + k*(q1**4 + q2**4)/4", ["s*cos(q1)"], None,
            {"B": u, "k": 0.3 * u**2, "s": 0.2 * u**1.5},
        )  # fmt: skip
        run = {"q0": [0.4, 0.1], "p0": [0.3 * u, 0.2 * u], "step": 0.05 / u, "steps": 20, "paths": 8, "seed": 1}
        return ss.gradient(model, "q1**2", ["B"], scheme="gauss_dkdkd", **run).by_path["B"]

    right = found(1.0)
    assert abs(unit * found(unit) - right).max() < 1e-10 * abs(right).max()
