# SPDX-License-Identifier: BSD-3-Clause
"""Friction on velocities by a symmetric matrix, dp = .. - Gamma M^-1 p dt: its meaning, orders, volume, refusals."""

import pickle

import numpy as np
import pytest
import symsde as ss
from symsde.batch import scene
from symsde.errors import IncompatibleError, InvalidArgumentError, SceneError, WrongShapeError

pytestmark = pytest.mark.usefixtures("quick_compiler")

SCHEMES = ["midpoint", "symplectic_euler", "symplectic_euler_adjoint", "gauss_dkdkd", "verlet_kdk", "chin4a",
           "gauss_dkdkd_strong2", "verlet_kdk_strong2", "chin4a_strong2"]  # fmt: skip
HEAVY = ss.model_from_sympy("p1**2/2 + p2**2/6 + cos(q1 - q2) + q1**4/4", noise=["0.3*sin(q1)", "0.2*q2"])
#: M^-1 and Gamma, neither of them diagonal
INVERSE = np.array([[1.0, 0.4], [0.4, 0.5]])
FRICTION = np.array([[0.9, -0.5], [-0.5, 1.6]])
BONDS = "cos(x1 - x2) + x1**4/4 + x2**2"
NOISES = ("0.3*sin(x1) + 0.1*x2", "0.2*x2*x1")
COUPLED = ss.model_from_sympy(
    "p1**2/2 + 0.4*p1*p2 + 0.25*p2**2 + " + BONDS.replace("x", "q"), noise=[x.replace("x", "q") for x in NOISES]
)
GIVEN = {"q0": [0.7, -0.2], "p0": [0.3, 0.4], "step": 0.05, "steps": 10, "save_every": 10, "seed": 5}
#: strong orders with additive noise, and with noise in position
ORDERS = {"midpoint": (1, 1), "symplectic_euler": (1, 1), "gauss_dkdkd": (2, 1.5), "verlet_kdk": (2, 1.5),
          "chin4a": (3, 1.5), "chin4a_strong2": (3, 2)}  # fmt: skip


@pytest.mark.parametrize("scheme", SCHEMES)
def test_rates_are_a_matrix_of_rates_times_masses(scheme):
    """damping=[g1, g2] is damping=diag(g1 m1, g2 m2), for gamma h from 1e-12 to 40."""
    for rates in ([0.8, 0.3], [2e-11, 2e-8], [800.0, 3.0], [0.0, 2.0]):
        one = ss.simulate(HEAVY.damped(rates), scheme=scheme, paths=20, **GIVEN)
        for factor in (1.0, 1.01):
            matrix = ss.simulate(HEAVY.damped(factor * np.diag(rates * np.array([1.0, 3.0]))), scheme=scheme, paths=20,
                                 **GIVEN)  # fmt: skip
            difference = max(np.abs(one.q - matrix.q).max(), np.abs(one.p - matrix.p).max())
            if factor == 1.0:
                assert difference < 1e-12, rates
            elif max(rates) > 0.1:
                assert difference > 1e-5, rates


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("step", [0.05, -0.05, 0.4])
def test_a_matrix_has_rates_in_its_own_coordinates(scheme, step):
    """q = A x, p = A^-T y with A A^T = M^-1 and A^T Gamma A diagonal: the same scheme with mass one and these rates."""
    root = np.linalg.cholesky(INVERSE)
    rates, turn = np.linalg.eigh(root.T @ FRICTION @ root)
    to_q = root @ turn
    to_p = np.linalg.inv(to_q).T
    new = {f"x{i + 1}": f"({to_q[i, 0]!r}*q1 + {to_q[i, 1]!r}*q2)".replace("np.float64", "") for i in range(2)}

    def turned(text):
        for name, formula in new.items():
            text = text.replace(name, formula)
        return text

    own = ss.model_from_sympy("(p1**2 + p2**2)/2 + " + turned(BONDS), noise=[turned(x) for x in NOISES])
    dw = np.random.default_rng(1).normal(size=(6, 2, 7)) * 0.2
    how = {"step": step, "steps": 6, "scheme": scheme, "paths": 7, "seed": 3}
    if scheme in ("midpoint", "symplectic_euler", "symplectic_euler_adjoint"):
        how["increments"] = dw
    q, p = np.array(GIVEN["q0"]), np.array(GIVEN["p0"])
    one = ss.simulate(own.damped(rates), q0=np.linalg.solve(to_q, q), p0=np.linalg.solve(to_p, p), **how)
    for factor in (1.0, 1.01):
        other = ss.simulate(COUPLED.damped(factor * FRICTION), q0=q, p0=p, **how)
        assert "damped" in other.report.stepper
        difference = max(np.abs(to_q @ one.q[-1] - other.q[-1]).max(), np.abs(to_p @ one.p[-1] - other.p[-1]).max())
        assert difference < 2e-12 if factor == 1.0 else difference > 1e-4


@pytest.mark.parametrize("scheme", ORDERS)
def test_strong_orders(scheme):
    """Errors over 16 to 128 steps; the reference is another family of schemes at a sixteenth of the last step."""
    additive = ss.model_from_sympy("p1**2/2 + 0.4*p1*p2 + 0.25*p2**2 + cos(q1 - q2) + q1**4/4 + q2**2",
                                   noise=["-0.5*q1", "-0.4*q2 + 0.1*q1"])  # fmt: skip
    for which, model in enumerate((additive, COUPLED)):

        def ends(scheme, k, model=model):
            steps = 16 * 2**k
            run = ss.simulate(model.damped(FRICTION), q0=[0.7, -0.2], p0=0.3, step=1 / steps, steps=steps, seed=3,
                              save_every=steps, paths=100, scheme=scheme, refine=7 - k)  # fmt: skip
            return np.concatenate([run.q[-1], run.p[-1]])

        fine = ends("chin4a_strong2", 7)
        errors = [np.sqrt(np.mean(np.sum((ends(scheme, k) - fine) ** 2, axis=0))) for k in (0, 3)]
        slope = np.log2(errors[0] / errors[1]) / 3
        assert slope > ORDERS[scheme][which] - 0.15, (scheme, which, slope)


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("step", [0.1, -0.1, 1.0])
def test_volume_shrinks_by_the_trace(scheme, step):
    """det of a linear step is exp(-h tr Gamma M^-1), whatever the increments."""
    model = ss.model_from_sympy(
        "p1**2/2 + 0.4*p1*p2 + 0.25*p2**2 + q1**2/2 + q1*q2 + 2*q2**2", noise=["0.3*q1**2 - 0.4*q1*q2"]
    ).damped(FRICTION)
    start = np.eye(4)
    step_of = ss.simulate(model, q0=start[:2], p0=start[2:], step=step, steps=1, paths=4, scheme=scheme, seed=2,
                          common_noise=1)  # fmt: skip
    volume = np.linalg.det(np.concatenate([step_of.q[-1], step_of.p[-1]]))
    assert volume == pytest.approx(np.exp(-step * np.trace(FRICTION @ INVERSE)), rel=1e-12)


def test_friction_between_neighbours_keeps_their_momentum():
    """Gamma = g (1, -1; -1, 1) has an eigenvalue of zero: only the relative velocity is braked."""
    model = ss.model_from_sympy("(p1**2 + p2**2)/2 + (q1 - q2)**2/2").damped([[3.0, -3.0], [-3.0, 3.0]])
    for scheme in ("midpoint", "chin4a"):
        run = ss.simulate(model, q0=[0.5, -0.5], p0=[1.0, 0.0], step=0.1, steps=300, scheme=scheme)
        np.testing.assert_allclose(run.p.sum(axis=1), 1.0, rtol=0, atol=1e-12)
        assert np.abs(run.p[-1] - 0.5).max() < 1e-4


@pytest.mark.parametrize("scheme", ["midpoint", "gauss_dkdkd", "chin4a_strong2"])
@pytest.mark.parametrize("compensated", [False, True])
def test_a_path_has_its_bits(scheme, compensated):
    """A path has the same bits in blocks, alone and with any threads; a matrix of zeros gives the bits of the closed
    system.
    """
    given = {**GIVEN, "scheme": scheme, "compensated": compensated}
    for model in (HEAVY, COUPLED):
        damped = model.damped(FRICTION)
        many = ss.simulate(damped, paths=300, threads=2, **given)
        for path in (0, 7, 299):
            alone = ss.simulate(damped, paths=1, first_path=path, threads=1, **given)
            np.testing.assert_array_equal(many.q[..., path], alone.q[..., 0])
            np.testing.assert_array_equal(many.p[..., path], alone.p[..., 0])
        assert damped.damped(np.zeros((2, 2))) is model


def test_models_keep_their_friction(tmp_path):
    """Models keep their friction: in text, pickles, reports, notebooks, scenes and models of one's own, and as a
    copy of the caller's array.
    """
    given = FRICTION.copy()
    model = COUPLED.damped(given)
    first = ss.simulate(model, paths=3, **GIVEN)
    given[:] = 7.0
    assert model.damping == ((0.9, -0.5), (-0.5, 1.6)) and model.has_friction
    assert "friction (2, 2)" in repr(model) and "- Γ M⁻¹ p dt" in model._repr_html_()
    assert ">-0.5<" in model._repr_html_()
    told = "dp = .. - Gamma M^-1 p dt, friction on velocities by a matrix, which shrinks volume alone by one factor"
    assert first.report.damping == told
    for other in (model, pickle.loads(pickle.dumps(model)), COUPLED.damped([0.1, 0.2]).damped(FRICTION)):
        np.testing.assert_array_equal(ss.simulate(other, paths=3, **GIVEN).p, first.p)

    def gradient(t, w, q, p):
        return w[0] * q, w[0] * (INVERSE @ p)

    own = ss.Model(ndof=2, nnoise=0, gradient=gradient, separable=True, constant_mass=True, damping=FRICTION)
    formula = ss.model_from_sympy("p1**2/2 + 0.4*p1*p2 + 0.25*p2**2 + (q1**2 + q2**2)/2", damping=FRICTION)
    for scheme in ("gauss_dkdkd", "midpoint"):
        runs = [ss.simulate(x, scheme=scheme, **GIVEN) for x in (own, formula)]
        np.testing.assert_allclose(runs[0].p, runs[1].p, rtol=1e-10)
    file = tmp_path / "scene.toml"
    text = '[model]\nH = "(p1**2 + p2**2)/2 + q1*q2"\ndamping = {}\n[run]\nstep = 0.05\nsteps = 4\nq0 = 0.7\np0 = 0.3\n'
    file.write_text(text.format("[[0.9, -0.5], [-0.5, 1.6]]"), encoding="utf-8")
    assert scene.load(file).model.damping == model.damping
    file.write_text(text.format("[[0.9, -0.5], [0.5, 1.6]]"), encoding="utf-8")
    with pytest.raises(SceneError, match=r"scene.toml: \[model\]: a matrix of friction is not symmetric"):
        scene.load(file)


def test_tableaus_of_several_stages_stand_between_half_decays():
    """p <- exp(-h A/2) p, the closed step, p <- exp(-h A/2) p with A = Gamma M^-1; a matrix larger by 1 % shows. The
    oracle takes the same steps."""
    model, closed, h = COUPLED.damped(FRICTION), COUPLED, 0.2
    values, vectors = np.linalg.eig(FRICTION @ INVERSE)
    half, more = (np.real(vectors @ np.diag(np.exp(-h / 2 * x * values)) @ np.linalg.inv(vectors)) for x in (1, 1.01))
    dw = np.random.default_rng(1).normal(size=(1, 2, 7)) * 0.2
    how = {"step": h, "steps": 1, "paths": 7, "increments": dw}
    p0 = np.tile(np.array(GIVEN["p0"])[:, None], 7)
    for scheme in ("midpoint", "gauss2", "gauss3", "stormer_verlet", "lobatto3", "heun"):
        run = ss.simulate(model, q0=GIVEN["q0"], p0=GIVEN["p0"], scheme=scheme, **how)
        for decay in (half, more):
            inner = ss.simulate(closed, q0=GIVEN["q0"], p0=decay @ p0, scheme=scheme, **how)
            difference = max(np.abs(inner.q[-1] - run.q[-1]).max(), np.abs(decay @ inner.p[-1] - run.p[-1]).max())
            assert difference < 1e-12 if decay is half else difference > 1e-4
        general = ss.simulate(model, q0=GIVEN["q0"], p0=GIVEN["p0"], scheme=scheme, general=True, **how)
        np.testing.assert_allclose(general.p, run.p, rtol=0, atol=1e-12)


def test_refusals():
    """Matrices that are no friction, and schemes and functions that execute none, are refused with a sentence."""
    for bad, error, told in (
        ([[1.0, 0.2], [0.1, 1.0]], InvalidArgumentError, "not symmetric, rows 1 and 2 have 0.1 and 0.2 for each other"),
        ([[1.0, 2.0], [2.0, 1.0]], InvalidArgumentError, "negative eigenvalue, which would make momenta grow"),
        ([[-1.0, 0.0], [0.0, 1.0]], InvalidArgumentError, "negative eigenvalue"),
        ([[0.0, 1e-3], [1e-3, 1.0]], InvalidArgumentError, "negative eigenvalue"),
        ([[1.0, np.nan], [np.nan, 1.0]], InvalidArgumentError, "not finite"),
        (np.eye(3), WrongShapeError, r"damping has shape \(3, 3\): give a number, or \(2,\).* or \(2, 2\)"),
    ):
        with pytest.raises(error, match=told):
            COUPLED.damped(bad)
    grows = COUPLED.damped([[1.0, 2.0], [2.0, 1.0]], allow_gain=True)
    assert ss.simulate(grows, **GIVEN).report.status == 0
    with pytest.raises(InvalidArgumentError, match="513 degrees of freedom is too large, it may have 512 rows"):
        ss.models.fpu_chain(n=513).damped(np.eye(513))
    model = COUPLED.damped(FRICTION)
    mixed = ss.model_from_sympy("p1**2/2 + p2**2/2*(1 + q1**2) + q2**2").damped(FRICTION)
    with pytest.raises(IncompatibleError, match=r"does not declare H = p.M.-1 p/2 . U.q. with a constant M"):
        ss.simulate(mixed, **GIVEN)
    with pytest.raises(IncompatibleError, match="a form that a step keeps up to one factor"):
        ss.diagnose.symplecticity(model)
    with pytest.raises(IncompatibleError, match="damped"):
        ss.thermostat(ss.models.henon_heiles().damped(FRICTION), beta=1.0, gamma=1.0)
