# SPDX-License-Identifier: BSD-3-Clause
# ruff: noqa: PLR0917 - callbacks of C take what they take
"""Compiled functions that return 0 in the middle of a block: unwritten lanes fail, and no lane is wrong."""

import ctypes

import numpy as np
import pytest
import symsde as ss
from symsde import errors

numba = pytest.importorskip("numba")

SINGLE = 2.0  #: q at which the functions below return early: the third of eight paths begins there
TRAITS = {"ndof": 1, "nnoise": 1, "separable": True, "additive": True, "position_noise": True, "identity_mass": True}
HOW = {"p0": 0.3, "step": 0.1, "steps": 4, "paths": 8, "seed": 1}


def starts():
    """Eight paths, the third at the place where functions return early."""
    q0 = np.linspace(0.5, 1.2, 8)
    q0[2] = SINGLE
    return q0[np.newaxis]


def functions(limit=1.5):
    """H = p^2/2 + q^2/2 + q^4/40, H_1 = q/10: all functions of the model, each of which returns 0 at a lane with q >
    limit."""

    @numba.cfunc(ss.numba_signature("gradient"))
    def gradient(nlane, ndof, nham, t, w, q, p, hq, hp, user):
        for i in range(nlane):
            if q[i] > limit:
                return 0
            hq[i] = w[i] * (q[i] + 0.1 * q[i] ** 3) + 0.1 * w[nlane + i]
            hp[i] = w[i] * p[i]
        return 0

    @numba.cfunc(ss.numba_signature("value"))
    def value(nlane, ndof, nham, t, w, q, p, value, user):
        for i in range(nlane):
            if q[i] > limit:
                return 0
            value[i] = w[i] * (p[i] ** 2 / 2 + q[i] ** 2 / 2 + q[i] ** 4 / 40) + 0.1 * w[nlane + i] * q[i]
        return 0

    @numba.cfunc(ss.numba_signature("hessian"))
    def hessian(nlane, ndof, nham, t, w, q, p, hqq, hqp, hpp, user):
        for i in range(nlane):
            if q[i] > limit:
                return 0
            hqq[i] = w[i] * (1 + 0.3 * q[i] ** 2)
            hqp[i] = 0.0
            hpp[i] = w[i]
        return 0

    @numba.cfunc(ss.numba_signature("hessian_vector"))
    def hessian_vector(nlane, ndof, nham, t, w, q, p, vq, vp, uq, up, user):
        for i in range(nlane):
            if q[i] > limit:
                return 0
            uq[i] = w[i] * (1 + 0.3 * q[i] ** 2) * vq[i]
            up[i] = w[i] * vp[i]
        return 0

    @numba.cfunc(ss.numba_signature("gradient_hessian"))
    def gradient_hessian(nlane, ndof, nham, t, w, q, p, hq, hp, hqq, hqp, hpp, user):
        for i in range(nlane):
            if q[i] > limit:
                return 0
            hq[i] = w[i] * (q[i] + 0.1 * q[i] ** 3) + 0.1 * w[nlane + i]
            hp[i] = w[i] * p[i]
            hqq[i] = w[i] * (1 + 0.3 * q[i] ** 2)
            hqp[i] = 0.0
            hpp[i] = w[i]
        return 0

    @numba.cfunc(ss.numba_signature("flow"))
    def flow(nlane, ndof, nham, nstep, every, max_iter, t, h, w, functionals, q, p, qn, pn, status, user):
        for i in range(nlane):
            if q[i] > limit:
                return 0
            x, y = q[i], p[i]
            for step in range(nstep):
                dw = w[(step * nham + 1) * nlane + i]
                y -= h * (x + 0.1 * x**3) + 0.1 * dw
                x += h * y
                if (step + 1) % every == 0:
                    qn[step // every * nlane + i] = x
                    pn[step // every * nlane + i] = y
        return 0

    found = (gradient, value, hessian, hessian_vector, gradient_hessian, flow)
    return {function.__name__: function for function in found}


def model_of(early):
    """A model in which the function of this kind returns early and all others are complete."""
    whole, cut = functions(np.inf), functions()
    kinds = {"gradient", early, *(() if early in {"gradient_hessian", "hessian_vector"} else ("hessian",))} - {"flow"}
    given = {kind: (cut if kind == early else whole)[kind] for kind in kinds}
    if early == "flow":
        given["flows"] = {"symplectic_euler": cut["flow"]}
    return ss.Model(**TRAITS, **given)


CASES = [
    ("gradient", s) for s in ("symplectic_euler", "stormer_verlet", "midpoint", "heun", "gauss2", "euler_maruyama")
]
CASES += [("hessian", "midpoint"), ("hessian", "gauss2"), ("gradient_hessian", "midpoint")]
CASES += [("flow", "symplectic_euler"), ("hessian_vector", "chin4a_strong2")]
CASES += [("hessian_vector", "gauss2")]


@pytest.mark.parametrize(("early", "scheme"), CASES)
def test_no_lane_is_silently_wrong(early, scheme):
    """Path 2 fails in the first step as nonfinite or not solved; paths before it keep their bits, and later lanes of
    the block, which the function never reached, fail, too."""
    model = model_of(early)
    whole = ss.Model(**TRAITS, **{kind: functions(np.inf)[kind] for kind in ("gradient", "hessian")})
    with pytest.warns(errors.PathsFailedWarning):
        run = ss.simulate(model, q0=starts(), scheme=scheme, **HOW)
    right = ss.simulate(whole, q0=starts(), scheme=scheme, **HOW)
    fine = run.status == 0
    assert fine[:2].all()
    np.testing.assert_allclose(run.q[..., fine], right.q[..., fine], rtol=0, atol=1e-13)
    np.testing.assert_allclose(run.p[..., fine], right.p[..., fine], rtol=0, atol=1e-13)
    assert not fine[2:].any()
    assert (run.failed_step[2:] == 0).all()
    if early in {"gradient", "flow"} and scheme in {"symplectic_euler", "stormer_verlet", "heun", "euler_maruyama"}:
        assert (run.status[2:] == 3).all()  # the status nonfinite
    assert np.isnan(run.q[1:, :, 2:]).all()


@pytest.mark.parametrize("kind", ["gradient", "value", "hessian"])
def test_what_is_asked_directly(kind):
    """Values and derivatives at points are NaN from the lane on at which the function returned."""
    model = model_of(kind)
    found = getattr(model, kind)(starts(), np.full((1, 8), 0.3))
    for x in found if isinstance(found, tuple) else (found,):
        np.testing.assert_array_equal(np.isnan(np.asarray(x).reshape(-1, 8)).any(axis=0), np.arange(8) >= 2)


def test_energies():
    """If some paths have no value, the mean over paths is NaN, and a warning says so."""
    with pytest.warns(errors.NotANumberWarning, match="energy"):
        found = ss.moments(model_of("value"), q0=starts(), **HOW)
    assert np.isnan(found.mean_energy[0])


def test_division_by_zero_of_numba():
    """numba leaves a function at a division by zero, unless error_model="numpy": then that lane alone is NaN."""

    def slope(nlane, ndof, nham, t, w, q, p, hq, hp, user):
        for i in range(nlane):
            hq[i] = w[i] * (q[i] + 0.01 / (q[i] - SINGLE)) + 0.1 * w[nlane + i]
            hp[i] = w[i] * p[i]
        return 0

    signature = ss.numba_signature("gradient")
    by_python, by_numpy = numba.cfunc(signature)(slope), numba.cfunc(signature, error_model="numpy")(slope)
    for gradient, failed in ((by_python, range(2, 8)), (by_numpy, [2])):
        model = ss.Model(**TRAITS, gradient=gradient)
        with pytest.warns(errors.PathsFailedWarning):
            run = ss.simulate(model, q0=starts(), scheme="symplectic_euler", **HOW)
        assert np.flatnonzero(run.status).tolist() == list(failed)
        assert set(run.status[list(failed)]) == {3}
        alone = [ss.simulate(model, q0=q, scheme="symplectic_euler", **{**HOW, "paths": 1}) for q in starts()[0, :2]]
        np.testing.assert_array_equal(run.q[:, 0, 0], alone[0].q[:, 0, 0])


def test_a_callback_of_ctypes_that_returns_early():
    """A callback that returns early returns 0 and writes nothing, as a function in C may."""
    pointer = ctypes.POINTER(ctypes.c_double)
    kind = ctypes.CFUNCTYPE(ctypes.c_int, *(ctypes.c_int,) * 3, ctypes.c_double, *(pointer,) * 5, ctypes.c_void_p)

    @kind
    def gradient(nlane, ndof, nham, t, w, q, p, hq, hp, user):
        for i in range(nlane):
            if q[i] == SINGLE:
                return 0
            hq[i], hp[i] = w[i] * q[i] + 0.1 * w[nlane + i], w[i] * p[i]
        return 0

    model = ss.Model(**TRAITS, gradient=gradient)
    with pytest.warns(errors.PathsFailedWarning):
        run = ss.simulate(model, q0=starts(), scheme="stormer_verlet", threads=1, **HOW)
    assert np.flatnonzero(run.status).tolist() == list(range(2, 8))
