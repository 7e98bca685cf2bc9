# SPDX-License-Identifier: BSD-3-Clause
"""Kicks between exact flows of a quadratic part of H that couples positions and momenta."""

import axes
import numpy as np
import pytest
import reference
import symsde as ss
from symsde import errors

SCHEMES = ("gauss_dkdkd", "verlet_kdk", "chin4a", "gauss_dkdkd_strong2", "verlet_kdk_strong2", "chin4a_strong2")
#: (|p - A|^2)/2 with B = 2, and a full matrix: a rotating frame with another mass
FIELD = np.array([[1.0, 0, 0, -1], [0, 1, 1, 0], [0, 1, 1, 0], [-1, 0, 0, 1]])
FRAME = np.array([[1.2, 0.2, 0.1, -0.8], [0.2, 0.6, 0.8, -0.2], [0.1, 0.8, 1.0, 0.3], [-0.8, -0.2, 0.3, 0.7]])


def ridges_with(second, nnoise=2, extra=()):
    """H = z.S z/2 + a potential, noises of q, as ridges: S by its eigenvectors."""
    n = len(second) // 2
    units = np.eye(2 * n)
    values, vectors = np.linalg.eigh(second)
    found = [(0, 2, y / 2, 0, 0, v, 0) for y, v in zip(values, vectors.T, strict=True)]
    for i in range(n):
        found += [(0, 4, 0.25, 0, 0, units[i], 0), (0, "sin", 0.4, 0, 0, units[i] - 0.7 * units[(i + 1) % n], 0.3)]
    for k in range(1, nnoise + 1):
        found += [(k, "sin", 0.3, 0, 0, units[k % n] + 0.4 * units[0], 0.2 * k)]
    return reference.Ridges(n, nnoise, [*found, *extra])


def model_of(ridges, split, **traits):
    functions = {x: getattr(ridges, x) for x in ("gradient", "hessian", "hessian_vector")}
    return ss.Model(ndof=ridges.ndof, nnoise=ridges.nnoise, position_noise=True, split=split, **functions, **traits)


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("second", [FIELD, FRAME], ids=["field", "frame"])
@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("rates", [None, (0.7, 0.2)], ids=["closed", "damped"])
def test_steps_are_those_of_the_equations(scheme, second, sign, rates):
    h, steps, rows, paths = 0.2 * sign, 2, 4, 5
    ridges = ridges_with(second)
    model = model_of(ridges, second)
    model = model if rates is None else model.damped(rates)
    q0, p0 = axes.start(2, paths)
    dw = axes.rows_of(h, steps, rows, 2, paths)
    given = {"step": h, "steps": steps, "scheme": scheme, "refine": 2}
    run = ss.simulate(model, q0=q0, p0=p0, paths=paths, increments=dw, **given)
    x = np.concatenate([q0, p0])
    for n in range(steps):
        drive = reference.polygon(h, dw[rows * n : rows * (n + 1)])
        x = reference.kicks_step(ridges, scheme, n * h, drive, x, split=second, rates=rates)
        np.testing.assert_allclose(np.concatenate([run.q[n + 1], run.p[n + 1]]), x, rtol=0, atol=5e-14)
    one = ss.simulate(model, q0=q0[:, 3:4], p0=p0[:, 3:4], paths=1, increments=dw[:, :, 3:4], **given)
    np.testing.assert_array_equal([one.q[:, :, 0], one.p[:, :, 0]], [run.q[:, :, 3], run.p[:, :, 3]])


def strong_errors(model, scheme, *, finest=11, levels=range(4, 8), end=4.0, paths=200):
    """Errors of (q, p) at the end over 200 paths, by steps of end/2^level, against the finest level by Gauss' kicks."""

    def last(scheme, level):
        given = {"step": end / 2**level, "steps": 2**level, "save_every": 2**level, "refine": finest - level}
        run = ss.simulate(model, q0=[1.0, 0.0], p0=[0.0, 0.5], seed=3, paths=paths, scheme=scheme, **given)
        assert not run.status.any()
        return np.concatenate([run.q[-1], run.p[-1]])

    exact = last("chin4a_strong2", finest)
    return np.array([np.sqrt(((last(scheme, k) - exact) ** 2).sum(axis=0).mean()) for k in levels])


class Magnet:
    """A charge in a field B = 2: H = ((p_1+q_2)^2 + (p_2-q_1)^2)/2 + |q|^2/2 + (q_1^4+q_2^4)/4, noises at each q_i."""

    def __init__(self, additive):
        self.additive = additive

    def gradient(self, _t, w, q, p):
        hq, hp = np.split(FIELD @ np.concatenate([q, p]) * w[0], 2)
        return hq + w[0] * (q + q**3) + 0.3 * w[1:] * (1 if self.additive else np.cos(q)), hp

    def hessian_vector(self, _t, w, q, *vectors):
        _p, vq, vp = vectors
        uq, up = np.split(FIELD @ np.concatenate([vq, vp]) * w[0], 2)
        return uq + w[0] * (1 + 3 * q**2) * vq - (0 if self.additive else 0.3 * w[1:] * np.sin(q) * vq), up

    def model(self, **traits):
        functions = {"gradient": self.gradient, "hessian_vector": self.hessian_vector}
        given = {"position_noise": True, "additive": self.additive, "split": FIELD, "touches": [[1], [2]]}
        return ss.Model(ndof=2, nnoise=2, **functions, **given | traits)


@pytest.mark.parametrize(
    ("additive", "scheme", "order"),
    [
        (True, "gauss_dkdkd", 2), (True, "verlet_kdk", 2), (True, "chin4a", 3),
        (False, "gauss_dkdkd", 2), (False, "gauss_dkdkd_strong2", 2), (False, "chin4a_strong2", 3),
    ],
)  # fmt: skip
def test_strong_orders_in_a_magnetic_field(additive, scheme, order):
    """Slopes over four levels of 200 fixed paths, whose errors are within a tenth of the law. With noises .3 cos q the
    error of second order hides that of order 3/2, and chin4a_strong2 has slope 3 down to its own of order 5/2."""
    errors_of = strong_errors(Magnet(additive).model(), scheme)
    slope = np.log2(errors_of[0] / errors_of[-1]) / 3
    assert abs(slope - order) < 0.12, (errors_of, slope)
    if scheme == "gauss_dkdkd":
        assert abs(errors_of[0] / (2.0e-2 if additive else 1.8e-2) - 1) < 0.1  # the numbers of another program


@pytest.mark.parametrize("scheme", SCHEMES)
def test_steps_are_symplectic(scheme):
    residual = ss.diagnose.symplecticity(Magnet(False).model(), scheme, q=[0.6, 0.2], p=[0.3, -0.4], step=0.2)
    assert residual[0] < 5e-14, residual


def test_the_quadratic_part_alone_is_exact_for_any_step():
    """With nothing beside it a step is exp(h J S), forward and back, and a step of 40 is as exact as its rounding."""
    stiff = FRAME + np.diag([400.0, 90.0, 0, 0])
    ridges = reference.Ridges(2, 0, [(0, 2, y / 2, 0, 0, v, 0) for y, v in zip(*eigen(stiff), strict=True)])
    model = model_of(ridges, stiff)
    q0, p0 = axes.start(2, 3)
    field = np.concatenate([stiff[2:], -stiff[:2]])
    values, vectors = np.linalg.eig(field)
    for h in (0.3, -0.3, 40.0):
        run = ss.simulate(model, q0=q0, p0=p0, paths=3, step=h, steps=2, scheme="gauss_dkdkd")
        exact = (vectors @ np.diag(np.exp(2 * h * values)) @ np.linalg.inv(vectors)).real @ np.concatenate([q0, p0])
        np.testing.assert_allclose(np.concatenate([run.q[-1], run.p[-1]]), exact, rtol=0, atol=3e-12 * max(1, abs(h)))


def eigen(second):
    values, vectors = np.linalg.eigh(second)
    return values, vectors.T


@pytest.mark.parametrize("step", [0.7, -0.7])
def test_a_matrix_of_friction_acts_on_velocities(step):
    """p' = -K q - Gamma M^-1 p with matrices that do not commute, exactly."""
    spring, inverse, friction = (np.array(x) for x in ([[1.2, 0.2], [0.2, 0.6]], [[1, 0.3], [0.3, 0.7]],
                                                       [[0.5, -0.2], [-0.2, 0.9]]))  # fmt: skip
    zero = np.zeros((2, 2))
    second = np.block([[spring, zero], [zero, inverse]])

    def gradient(t, w, q, p):
        return w[0] * (spring @ q), w[0] * (inverse @ p)

    model = ss.Model(ndof=2, nnoise=0, gradient=gradient, split=second, constant_mass=True, separable=True)
    how = {"q0": [0.4, -0.3], "p0": [0.2, 0.9], "step": step, "steps": 3, "scheme": "gauss_dkdkd"}
    run = ss.simulate(model.damped(friction), **how)
    flow = reference.exponential(3 * step * np.block([[zero, inverse], [-spring, -friction @ inverse]]))
    np.testing.assert_allclose([*run.q[-1, :, 0], *run.p[-1, :, 0]], flow @ [0.4, -0.3, 0.2, 0.9], rtol=0, atol=1e-14)


def test_decoupled_sites_have_the_bits_of_one():
    """A site in a field of its own has the same bits among 20 others: no rotation has more sites than are coupled."""
    count = 21
    second = np.zeros((4 * count, 4 * count))
    for i in range(count):
        place = [2 * i, 2 * i + 1, 2 * count + 2 * i, 2 * count + 2 * i + 1]
        second[np.ix_(place, place)] = FIELD

    def model(second):
        def gradient(t, w, q, p):
            hq, hp = np.split(np.array([(row[:, None] * [*q, *p]).sum(axis=0) for row in second]) * w[0], 2)
            return hq + w[0] * q**3, hp

        return ss.Model(ndof=len(second) // 2, nnoise=0, gradient=gradient, split=second)

    given = {"step": 0.2, "steps": 10, "scheme": "gauss_dkdkd", "paths": 4}
    q0, p0 = axes.start(2, 4)
    one = ss.simulate(model(FIELD), q0=q0, p0=p0, **given)
    many = ss.simulate(model(second), q0=np.tile(q0, (count, 1)), p0=np.tile(p0, (count, 1)), **given)
    np.testing.assert_allclose(many.q[:, 6:8], one.q, rtol=0, atol=1e-14)
    np.testing.assert_array_equal(many.q[:, 6:8], many.q[:, :2])


@pytest.mark.usefixtures("quick_compiler")
@pytest.mark.parametrize("ends", ["fixed", "free", "periodic"])
@pytest.mark.filterwarnings("ignore::symsde.errors.DoubtfulRunWarning")
def test_steps_are_judged_by_what_kicks_have(ends):
    """Springs whose flow is exact do not count as fast: omega^2 is b q^2 of the wells between them."""
    springs, wells = "Sum(p[i]**2/2 + k*(q[i+1]-q[i])**2/2, i)", "Sum(b*q[i]**4/12, i)"
    values = {"k": 400.0, "b": 0.3}
    model = ss.model_from_sympy(f"{springs} + {wells}", ["0.1*sin(q[j])"], params=values, n=8, ends=ends, split=springs)
    how = {"q0": 0.5, "p0": 0.0, "step": 0.1, "steps": 1, "scheme": "gauss_dkdkd"}
    assert ss.simulate(model, **how).report.warnings == ()
    told = ss.simulate(model.with_parameters(b=3000.0), **how).report.warnings
    assert told[0].startswith(f"h*omega = {np.sqrt(7.5):.6g} ")


def test_what_is_refused():
    magnet = Magnet(False)
    given = {"q0": [1.0, 0.0], "p0": [0.0, 0.5], "step": 0.1, "steps": 2}
    with pytest.raises(errors.FalseTraitError, match=r"quadratic part of H \(split\)"):
        ss.simulate(magnet.model(split=FRAME), scheme="gauss_dkdkd", **given)
    with pytest.raises(errors.IncompatibleError, match=r"quadratic D \(split\)"):
        ss.simulate(magnet.model(split=None), scheme="gauss_dkdkd", **given)
    with pytest.raises(errors.IncompatibleError, match="use gauss_dkdkd, or midpoint"):
        ss.simulate(magnet.model(), scheme="exact_rotation", **given)
    with pytest.raises(errors.WrongShapeError, match="split has shape"):
        magnet.model(split=np.eye(2))
    with pytest.raises(errors.InvalidArgumentError, match="not symmetric"):
        magnet.model(split=FIELD + np.eye(4, k=1))
    with pytest.raises(errors.InvalidArgumentError, match="not finite"):
        magnet.model(split=FIELD * np.nan)
    damped = magnet.model().damped(lambda q: 0.1 + q[0] ** 2)
    with pytest.raises(errors.IncompatibleError, match="give rates as numbers"):
        ss.simulate(damped, scheme="gauss_dkdkd", **given)
    with pytest.raises(errors.IncompatibleError, match="weights of the closed system"):
        ss.simulate(magnet.model().damped(0.3), scheme="gauss_dkdkd", damping_noise="path", **given)
    with pytest.raises(errors.IncompatibleError, match="constant mass"):
        ss.simulate(magnet.model().damped(0.3), scheme=ss.schemes.from_word("BAOAB"), **given)


def test_damped_steps_shrink_volume():
    """Momenta that decay by one rate in the flow of D: dp ^ dq shrinks by exp(-gamma h), whatever couples q and p."""
    model = Magnet(False).model().damped(0.4)
    residual = ss.diagnose.symplecticity(model, "gauss_dkdkd", q=[0.6, 0.2], p=[0.3, -0.4], step=0.2)
    assert residual[0] < 5e-14, residual


@pytest.mark.parametrize("scheme", ["word:BAOAB", "gjf", "verlet_kdk_midpoint"])
def test_other_schemes_do_not_heed_the_part(scheme):
    """Words and midpoint steps have drifts of their own: a declared part changes no bit of them."""
    traits = {"position_noise": True, "separable": True, "identity_mass": True}
    second = np.diag([4.0, 9.0, 1.0, 1.0])

    def gradient(t, w, q, p):
        return w[0] * (np.array([4.0, 9.0])[:, None] * q + q**3) + w[1:] * 0.3 * np.cos(q), w[0] * p

    found = []
    for split in (None, second):
        model = ss.Model(ndof=2, nnoise=2, gradient=gradient, split=split, **traits).damped(0.3)
        found.append(ss.simulate(model, q0=0.4, p0=0.1, step=0.1, steps=20, paths=9, scheme=scheme))
    np.testing.assert_array_equal(found[0].q, found[1].q)
