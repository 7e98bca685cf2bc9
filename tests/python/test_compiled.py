# SPDX-License-Identifier: BSD-3-Clause
# ruff: noqa: PLR0917 - callbacks of C take what they take
"""Models of compiled functions: numba, ctypes, LowLevelCallable; wrong signatures, unwanted outputs."""

import ctypes

import numpy as np
import pytest
import symsde as ss
from symsde import errors

pytestmark = pytest.mark.optimised

SCHEMES = ["midpoint", "symplectic_euler", "stormer_verlet", "gauss2", "heun", "euler_maruyama"]


@pytest.mark.parametrize("scheme", SCHEMES)
def test_numba(scheme, kubo, options):
    numba = pytest.importorskip("numba")
    carray = numba.carray

    @numba.cfunc(ss.numba_signature("gradient"))
    def gradient(nlane, ndof, nham, t, w, q, p, hq, hp, user):
        weights = carray(w, (nham, nlane))
        for state, out in ((q, hq), (p, hp)):
            x, slope = carray(state, (ndof, nlane)), carray(out, (ndof, nlane))
            slope[0] = (weights[0] + 0.3 * weights[1]) * x[0]
        return 0

    @numba.cfunc(ss.numba_signature("value"))
    def value(nlane, ndof, nham, t, w, q, p, value, user):
        for i in range(nlane):
            value[i] = (w[i] + 0.3 * w[nlane + i]) * (q[i] ** 2 + p[i] ** 2) / 2
        return 0

    model = ss.Model(ndof=1, nnoise=1, gradient=gradient, value=value, separable=True)
    assert not model.in_python
    with pytest.raises(errors.WrongTypeError, match="gradient takes 9 arguments and not 10"):
        ss.Model(ndof=1, nnoise=1, gradient=value)
    mine, known = (ss.moments(m, scheme=scheme, **options) for m in (model, kubo))
    np.testing.assert_allclose(mine.mean_q, known.mean_q, rtol=0, atol=1e-11)
    np.testing.assert_allclose(mine.mean_energy, known.mean_energy, rtol=0, atol=1e-11)


def test_numba_gradient_hessian_and_sincos():
    numba = pytest.importorskip("numba")
    sincos = ss.numba_sincos()

    @numba.cfunc(ss.numba_signature("gradient"))
    def gradient(nlane, ndof, nham, t, w, q, p, hq, hp, user):
        force, velocity = numba.carray(hq, nlane), numba.carray(hp, nlane)
        sine, cosine = np.empty(nlane), np.empty(nlane)
        sincos(nlane, q, sine.ctypes, cosine.ctypes)
        for i in range(nlane):
            if force.ctypes.data != 0:
                force[i] = (4.0 * w[i] + 0.1 * w[2 * nlane + i]) * sine[i] + 0.2 * w[nlane + i] * cosine[i]
            if velocity.ctypes.data != 0:
                velocity[i] = w[i] * p[i]
        return 0

    @numba.cfunc(ss.numba_signature("gradient_hessian"))
    def gradient_hessian(nlane, ndof, nham, t, w, q, p, hq, hp, hqq, hqp, hpp, user):
        force, velocity, stiffness = numba.carray(hq, nlane), numba.carray(hp, nlane), numba.carray(hqq, nlane)
        mixed, mass = numba.carray(hqp, nlane), numba.carray(hpp, nlane)
        sine, cosine = np.empty(nlane), np.empty(nlane)
        sincos(nlane, q, sine.ctypes, cosine.ctypes)
        for i in range(nlane):
            a, b = 4.0 * w[i] + 0.1 * w[2 * nlane + i], 0.2 * w[nlane + i]
            if force.ctypes.data != 0:
                force[i] = a * sine[i] + b * cosine[i]
            if velocity.ctypes.data != 0:
                velocity[i] = w[i] * p[i]
            if stiffness.ctypes.data != 0:
                stiffness[i] = a * cosine[i] - b * sine[i]
            if mixed.ctypes.data != 0:
                mixed[i] = 0.0
            if mass.ctypes.data != 0:
                mass[i] = w[i]
        return 0

    declared = {"separable": True, "position_noise": True, "identity_mass": True}
    model = ss.Model(
        ndof=1, nnoise=2, gradient=gradient, gradient_hessian=gradient_hessian, accepts_null=True, **declared
    )
    run = {"q0": 1.0, "p0": 0.0, "step": 0.05, "steps": 40, "paths": 30, "seed": 7}
    for scheme in ("midpoint", "gauss2"):
        mine, known = (ss.simulate(m, scheme=scheme, **run) for m in (model, ss.models.synchrotron()))
        np.testing.assert_allclose(mine.q, known.q, rtol=0, atol=1e-12)
    with pytest.raises(errors.WrongTypeError, match="gradient_hessian takes 10 arguments and not 13"):
        ss.Model(ndof=1, nnoise=2, gradient=gradient, gradient_hessian=gradient)


def numba_functions(types, returned="int32"):
    """A gradient compiled with arrays of these types."""
    numba = pytest.importorskip("numba")
    pointers = ", ".join(f"CPointer({name})" for name in types)
    lines = ", ".join("abcdefgh"[: len(types)])
    function = eval(f"lambda nlane, ndof, nham, t, {lines}, user: 0")
    return numba.cfunc(f"{returned}(int32, int32, int32, float64, {pointers}, voidptr)")(function)


@pytest.mark.parametrize(
    ("types", "returned", "words"),
    [
        (["float64"] * 5, "float64", "gradient returns float64 and not int32"),
        (["float64"] * 5, "int64", "gradient returns int64 and not int32"),
        (
            ["float64", "float32", "float64", "float64", "float64"],
            "int32",
            r"argument 6 .* is float32\* and not float64\*",
        ),
        (["float64", "float64", "float64", "float64", "int64"], "int32", r"argument 9 .* is int64\* and not float64\*"),
        (["float64"] * 4, "int32", "takes 9 arguments and not 10"),
    ],
)
def test_numba_signatures_are_compared(types, returned, words):
    with pytest.raises(errors.WrongTypeError, match=rf"{words}.*numba_signature\('gradient'\)"):
        ss.Model(ndof=1, nnoise=0, gradient=numba_functions(types, returned))


def test_swapped_arguments_of_numba_are_refused():
    numba = pytest.importorskip("numba")
    arrays = ", ".join(["CPointer(float64)"] * 5)
    swapped = numba.cfunc(f"int32(float64, int32, int32, int32, {arrays}, voidptr)")(
        lambda t, nlane, ndof, nham, w, q, p, hq, hp, user: 0
    )
    with pytest.raises(errors.WrongTypeError, match="argument 1 of the compiled gradient is float64 and not int32"):
        ss.Model(ndof=1, nnoise=0, gradient=swapped)


@pytest.mark.parametrize(
    ("result", "arguments", "words"),
    [
        (ctypes.c_double, (ctypes.c_int,) * 3 + (ctypes.c_double,) + (ctypes.c_void_p,) * 6, "returns .*c_double"),
        (ctypes.c_int, (ctypes.c_double,) + (ctypes.c_int,) * 3 + (ctypes.c_void_p,) * 6, r"takes \(c_double, c_int"),
        (ctypes.c_int, (ctypes.c_int,) * 3 + (ctypes.c_float,) + (ctypes.c_void_p,) * 6, r"c_float, c_void_p"),
        (ctypes.c_int, (ctypes.c_int,) * 3 + (ctypes.c_double,) + (ctypes.c_void_p,) * 5, "takes"),
    ],
)
def test_ctypes_signatures_are_compared(result, arguments, words):
    pointer = ctypes.CFUNCTYPE(result, *arguments)(lambda *_: 0)
    with pytest.raises(errors.WrongTypeError, match=words):
        ss.Model(ndof=1, nnoise=0, gradient=pointer)


def test_ctypes_pointers_to_numbers_are_addresses_too():
    array = ctypes.POINTER(ctypes.c_double)
    kind = ctypes.CFUNCTYPE(
        ctypes.c_int, *(ctypes.c_int,) * 3, ctypes.c_double, *(array,) * 5, ctypes.POINTER(ctypes.c_int)
    )

    @kind
    def gradient(nlane, ndof, nham, t, w, q, p, hq, hp, user):
        for i in range(nlane):
            hq[i], hp[i] = w[i] * q[i], w[i] * p[i]
        return 0

    run = {"q0": 1.0, "p0": 0.5, "step": 0.1, "steps": 2, "threads": 1}
    mine, known = (
        ss.simulate(m, **run) for m in (ss.Model(ndof=1, nnoise=0, gradient=gradient), ss.models.kubo(sigma=0.0))
    )
    np.testing.assert_allclose(mine.q, known.q, rtol=1e-12)


def all_schemes():
    """Every scheme that accepts one noise of any kind, hence every way to solve."""
    found = [(name, {}) for name in ss.schemes.names() if ss.schemes.get(name).info.orders["commutative"].value > 0]
    return [*found, ("midpoint", {"general": True}), ("midpoint", {"fixed_point": 5}), ("gauss2", {"general": True})]


@pytest.fixture(scope="module")
def careless():
    """Kubo's oscillator in numba, with functions that write every output without checking for NULL."""
    numba = pytest.importorskip("numba")

    @numba.cfunc(ss.numba_signature("gradient"))
    def gradient(nlane, ndof, nham, t, w, q, p, hq, hp, user):
        for i in range(nlane):
            rate = w[i] + 0.3 * w[nlane + i]
            hq[i], hp[i] = rate * q[i], rate * p[i]
        return 0

    @numba.cfunc(ss.numba_signature("hessian"))
    def hessian(nlane, ndof, nham, t, w, q, p, hqq, hqp, hpp, user):
        for i in range(nlane):
            rate = w[i] + 0.3 * w[nlane + i]
            hqq[i], hqp[i], hpp[i] = rate, 0.0, rate
        return 0

    @numba.cfunc(ss.numba_signature("gradient_hessian"))
    def joint(nlane, ndof, nham, t, w, q, p, hq, hp, hqq, hqp, hpp, user):
        for i in range(nlane):
            rate = w[i] + 0.3 * w[nlane + i]
            hq[i], hp[i], hqq[i], hqp[i], hpp[i] = rate * q[i], rate * p[i], rate, 0.0, rate
        return 0

    common = {"ndof": 1, "nnoise": 1, "gradient": gradient, "separable": True}
    return {
        "gradient": ss.Model(**common),
        "hessian": ss.Model(hessian=hessian, **common),
        "joint": ss.Model(hessian=hessian, gradient_hessian=joint, **common),
        "joint alone": ss.Model(gradient_hessian=joint, **common),
    }


@pytest.mark.parametrize("offer", ["gradient", "hessian", "joint", "joint alone"])
def test_careless_compiled_functions_are_safe(offer, careless, kubo, options):
    """With NULL for an unwanted output these functions would crash the process."""
    for scheme, more in all_schemes():
        try:
            known = ss.simulate(kubo, scheme=scheme, **more, **options)
        except errors.IncompatibleError:
            continue  # this quadrature refuses multiplicative noise
        mine = ss.simulate(careless[offer], scheme=scheme, **more, **options)
        np.testing.assert_allclose(mine.q, known.q, rtol=0, atol=1e-9, err_msg=f"{scheme} {more}")
    for name in ("gradient", "hessian"):
        mine, known = (getattr(model, name)(0.3, 0.4, [1.0, 2.0]) for model in (careless[offer], kubo))
        np.testing.assert_allclose(mine, known, rtol=1e-6, atol=1e-7)


def counting(wanted):
    """A gradient in ctypes that counts calls with and without NULL outputs."""
    from symsde.native.abi import CALLBACKS

    def function(nlane, ndof, nham, t, w, q, p, hq, hp, user):
        wanted["NULL" if hq is None or hp is None else "whole"] += 1
        arrays = [np.ctypeslib.as_array((ctypes.c_double * nlane).from_address(a)) for a in (w, q, p)]
        for source, target in ((arrays[1], hq), (arrays[2], hp)):
            if target is not None:
                np.ctypeslib.as_array((ctypes.c_double * nlane).from_address(target))[:] = arrays[0] * source
        return 0

    return CALLBACKS["gradient"](function)


@pytest.mark.parametrize("accepts", [False, True])
def test_null_only_where_it_is_accepted(accepts):
    wanted = {"NULL": 0, "whole": 0}
    model = ss.Model(ndof=1, nnoise=0, gradient=counting(wanted), separable=True, accepts_null=accepts)
    ss.simulate(model, q0=1.0, p0=0.0, step=0.1, steps=10, threads=1, scheme="stormer_verlet")
    assert (wanted["NULL"] == 0) != accepts
    assert wanted["whole"] > (0 if accepts else 20)


def c_gradient():
    from symsde.native.abi import CALLBACKS

    def function(nlane, ndof, nham, t, w, q, p, hq, hp, user):
        arrays = [np.ctypeslib.as_array((ctypes.c_double * nlane).from_address(a)) for a in (w, q, p)]
        rate = arrays[0]
        for source, target in ((arrays[1], hq), (arrays[2], hp)):
            if target is not None:
                np.ctypeslib.as_array((ctypes.c_double * nlane).from_address(target))[:] = rate * source
        return 7 if user == 7 else 0

    return CALLBACKS["gradient"](function)


def test_ctypes_pointer():
    pointer = c_gradient()
    model = ss.Model(ndof=1, nnoise=0, gradient=pointer)
    run = ss.simulate(model, q0=1.0, p0=0.0, step=0.1, steps=10, threads=1)
    np.testing.assert_allclose(run.q, ss.simulate(ss.models.kubo(sigma=0.0), q0=1.0, p0=0.0, step=0.1, steps=10).q)


def test_low_level_callable_and_its_failure():
    scipy = pytest.importorskip("scipy")
    pointer = c_gradient()
    callable_ = scipy.LowLevelCallable(pointer, ctypes.c_void_p(7))
    model = ss.Model(ndof=1, nnoise=0, gradient=callable_)
    with pytest.raises(errors.CallbackError, match="7"):
        ss.simulate(model, q0=1.0, p0=0.0, step=0.1, steps=10, threads=1)


def oscillator(numba, fault=1.0, stops=False, forgets=False, scheme="midpoint", quadratic=True):
    """H = p^2/2 + q^2/2, H_1 = -q, with whole midpoint steps: dp = (dW - h (q + h p/2))/(1 + h^2/4)."""

    @numba.cfunc(ss.numba_signature("gradient"))
    def gradient(nlane, ndof, nham, t, w, q, p, hq, hp, user):
        for i in range(nlane):
            hq[i] = w[i] * q[i] - w[nlane + i]
            hp[i] = w[i] * p[i]
        return 0

    @numba.cfunc(ss.numba_signature("flow"))
    def flow(nlane, ndof, nham, nstep, every, max_iter, t, h, w, functionals, q, p, qn, pn, status, user):
        w = numba.carray(w, (nstep, nham, nlane))
        for i in range(nlane):
            x, y = q[i], p[i]
            for step in range(nstep):
                dw = w[0, 1, i] if forgets else w[step, 1, i]
                dy = (fault * dw - h * (x + 0.5 * h * y)) / (1 + 0.25 * h * h)
                x += h * (y + 0.5 * dy)
                y += dy
                if stops and abs(x) > 1.5:
                    status[i] = 1  # not converged
                if (step + 1) % every == 0:
                    qn[step // every * nlane + i] = x
                    pn[step // every * nlane + i] = y
        return 0

    traits = {"separable": True, "additive": True, "position_noise": True, "identity_mass": True}
    return ss.Model(ndof=1, nnoise=1, gradient=gradient, flows={scheme: flow}, quadratic=quadratic, **traits)


def test_whole_steps():
    numba = pytest.importorskip("numba")
    model, known = oscillator(numba), ss.models.linear_oscillator()
    how = {"q0": 0.3, "p0": 0.1, "step": 0.05, "steps": 120, "seed": 5}
    mine, theirs = (ss.simulate(m, paths=300, **how) for m in (model, known))
    assert "whole steps of midpoint" in mine.report.stepper
    np.testing.assert_allclose(mine.q, theirs.q, rtol=0, atol=1e-12)
    np.testing.assert_allclose(mine.p, theirs.p, rtol=0, atol=1e-12)
    for paths, save_every in ((1, 1), (1, 40), (3, 120), (9, 5), (300, 24)):
        few = ss.simulate(model, paths=paths, save_every=save_every, threads=2, **how)
        np.testing.assert_array_equal(few.q, mine.q[::save_every, :, :paths])
    other = ss.simulate(model, scheme="gauss2", paths=3, **how)
    assert "whole" not in other.report.stepper
    assert "whole" not in ss.simulate(model, paths=3, general=True, **how).report.stepper


@pytest.mark.parametrize("part", [0.5, 0.51])
def test_whole_steps_of_damped_momenta(part):
    """A model's own midpoint steps find gamma h and exponentials behind the functionals; steps that decay by other
    parts are refused.
    """
    numba = pytest.importorskip("numba")

    @numba.cfunc(ss.numba_signature("flow"))
    def flow(nlane, ndof, nham, nstep, every, max_iter, t, h, w, functionals, q, p, qn, pn, status, user):
        w, loss = numba.carray(w, (nstep, nham, nlane)), np.exp(-part * functionals[5][0])
        begin, end = (functionals[5][18], 1 + functionals[5][13]) if part == 0.5 else (loss, loss)
        for i in range(nlane):
            x, y = q[i], p[i]
            for step in range(nstep):
                y *= begin
                dy = (w[step, 1, i] - h * (x + 0.5 * h * y)) / (1 + 0.25 * h * h)
                x += h * (y + 0.5 * dy)
                y = end * (y + dy)
                if (step + 1) % every == 0:
                    qn[step // every * nlane + i] = x
                    pn[step // every * nlane + i] = y
        return 0

    traits = {"separable": True, "additive": True, "position_noise": True, "identity_mass": True, "quadratic": True}
    traits["gradient"] = lambda _t, w, q, p: (w[0] * q - w[1], w[0] * p)
    mine = ss.Model(ndof=1, nnoise=1, flows={"midpoint, damped": flow}, **traits)
    how = {"q0": 0.3, "p0": 0.1, "step": 0.05, "steps": 120, "seed": 5, "paths": 30}
    assert "whole" not in ss.simulate(mine, **how).report.stepper
    if part != 0.5:
        with pytest.raises(errors.FalseTraitError, match="not those of the library"):
            ss.simulate(mine.damped(1.5), **how)
        return
    run, known = (ss.simulate(m.damped(1.5), **how) for m in (mine, ss.models.linear_oscillator()))
    assert run.report.stepper == "whole steps of midpoint by the model, damped"
    np.testing.assert_allclose(run.p, known.p, rtol=0, atol=1e-13)


@pytest.mark.parametrize("of", ["midpoint", "midpoint_areas"])
def test_whole_steps_serve_the_scheme_they_are_meant_for(of):
    """Whole steps are used with discrete increments and areas of one noise only if equations are linear and have one
    root.
    """
    numba = pytest.importorskip("numba")
    for scheme in ("midpoint", "midpoint_areas", "midpoint_weak1"):
        for quadratic in (True, False):
            model = oscillator(numba, scheme=of, quadratic=quadratic)
            run = ss.simulate(model, q0=0.3, p0=0.1, step=0.05, steps=12, scheme=scheme)
            whole = scheme == of or (of == "midpoint" and quadratic)
            assert (f"whole steps of {of} " in run.report.stepper) == whole


@pytest.mark.parametrize("fault", [1.0, 1.01])
def test_whole_steps_of_many_degrees_of_freedom_are_compared(fault):
    """Forty oscillators by symplectic_euler: an oracle without dense equations refuses steps that are 1 % too long."""
    numba = pytest.importorskip("numba")

    @numba.cfunc(ss.numba_signature("flow"))
    def flow(nlane, ndof, nham, nstep, every, max_iter, t, h, w, functionals, q, p, qn, pn, status, user):
        w = numba.carray(w, (nstep, nham, nlane))
        for k in range(ndof * nlane):
            x, y = q[k], p[k]
            for step in range(nstep):
                y += w[step, 1, k % nlane] - fault * h * x
                x += h * y
                if (step + 1) % every == 0:
                    qn[step // every * ndof * nlane + k] = x
                    pn[step // every * ndof * nlane + k] = y
        return 0

    traits = {"separable": True, "additive": True, "position_noise": True, "identity_mass": True}
    traits["gradient"] = lambda _t, w, q, p: (w[0] * q - w[1], w[0] * p)
    forty = ss.Model(ndof=40, nnoise=1, flows={"symplectic_euler": flow}, **traits)
    how = {"q0": 0.3, "p0": 0.1, "step": 0.05, "steps": 12, "scheme": "symplectic_euler"}
    if fault == 1.0:
        assert "whole steps" in ss.simulate(forty, **how).report.stepper
    else:
        with pytest.raises(errors.FalseTraitError, match="not those of the library"):
            ss.simulate(forty, **how)


def test_whole_steps_are_compared_with_the_scheme():
    numba = pytest.importorskip("numba")
    how = {"q0": 0.3, "p0": 0.1, "step": 0.05, "steps": 12}
    with pytest.raises(errors.FalseTraitError, match="not those of the library"):
        ss.simulate(oscillator(numba, fault=1.01), **how)
    with pytest.raises(errors.FalseTraitError, match="one by one"):
        ss.simulate(oscillator(numba, forgets=True), **how)
    with pytest.raises(errors.WrongTypeError, match="is not compiled"):
        ss.Model(ndof=1, nnoise=1, gradient=lambda *x: x[2:], flows={"midpoint": lambda *x: 0})
    with pytest.raises(errors.SymsdeError, match="midpiont"):
        oscillator_flow_of(numba, "midpiont")


def oscillator_flow_of(numba, scheme):
    """The oscillator with whole steps of this scheme."""

    @numba.cfunc(ss.numba_signature("flow"))
    def flow(nlane, ndof, nham, nstep, every, max_iter, t, h, w, functionals, q, p, qn, pn, status, user):
        return 0

    return ss.Model(ndof=1, nnoise=1, gradient=lambda _t, w, q, p: (w[0] * q, w[0] * p), flows={scheme: flow})


def test_status_of_whole_steps_is_in_its_step():
    """A lane that the model's own solver gives up is solved by the library: nothing fails."""
    numba = pytest.importorskip("numba")
    how = {"q0": 0.3, "p0": 0.1, "step": 0.05, "steps": 160, "seed": 5, "paths": 40}
    mine, theirs = ss.simulate(oscillator(numba, stops=True), **how), ss.simulate(ss.models.linear_oscillator(), **how)
    assert np.abs(theirs.q).max() > 1.5
    assert mine.report.counters["damped"] > 0
    np.testing.assert_allclose(mine.q, theirs.q, rtol=0, atol=1e-9)


@pytest.mark.parametrize("scheme", ["midpoint", "stormer_verlet", "gauss2"])
def test_any_number_of_lanes(scheme):
    """A single path has the bits of many, though its functions are called with one lane instead of eight."""
    numba = pytest.importorskip("numba")

    @numba.cfunc(ss.numba_signature("gradient"))
    def gradient(nlane, ndof, nham, t, w, q, p, hq, hp, user):
        w, q, p = numba.carray(w, (nham, nlane)), numba.carray(q, (ndof, nlane)), numba.carray(p, (ndof, nlane))
        hq, hp = numba.carray(hq, (ndof, nlane)), numba.carray(hp, (ndof, nlane))
        for i in range(nlane):
            hq[0, i] = w[0, i] * np.sin(q[0, i] - q[1, i]) + 0.2 * w[1, i] * np.cos(q[0, i])
            hq[1, i] = w[0, i] * (np.sin(q[1, i] - q[0, i]) + q[1, i])
            hp[0, i] = w[0, i] * p[0, i]
            hp[1, i] = w[0, i] * p[1, i]
        return 0

    traits = {"separable": True, "position_noise": True, "identity_mass": True}
    how = {"q0": 0.3, "p0": 0.1, "step": 0.05, "steps": 60, "seed": 5, "scheme": scheme}
    few, all_lanes = (ss.Model(ndof=2, nnoise=1, gradient=gradient, any_lanes=x, **traits) for x in (None, False))
    many = ss.simulate(few, paths=300, **how)
    for paths in (1, 3, 8, 13):
        for model in (few, all_lanes):
            run = ss.simulate(model, paths=paths, **how)
            np.testing.assert_array_equal(run.q, many.q[:, :, :paths])
            np.testing.assert_array_equal(run.p, many.p[:, :, :paths])
    assert ss.native.callbacks.takes_any_lanes([gradient])
    fast = numba.cfunc(ss.numba_signature("gradient"), fastmath=True)(gradient._pyfunc)
    assert not ss.native.callbacks.takes_any_lanes([gradient, fast])
    assert not ss.native.callbacks.takes_any_lanes([lambda: 0])


@pytest.mark.parametrize("scheme", ["gauss3", "midpoint_areas", "stormer_verlet"])
def test_few_unequal_masses(scheme):
    """Masses are read from the model for any number of paths: three paths have the bits of 16."""
    pytest.importorskip("numba")
    pytest.importorskip("sympy")
    model = ss.model_from_sympy(
        "p1**2/2.6 + p2**2/1.4 + (q1**2 + 0.3*q2**2)**2/4 + q1*q2/5",
        noise=["s*q1*q2"], q=["q1", "q2"], p=["p1", "p2"], params={"s": 0.3},
    )  # fmt: skip
    how = {"q0": [0.25, 0.27], "p0": [0.1, 0.05], "step": 0.5, "steps": 7, "seed": 5, "scheme": scheme}
    many = ss.simulate(model, paths=16, **how)
    for paths in (1, 3, 7):
        run = ss.simulate(model, paths=paths, **how)
        np.testing.assert_array_equal(run.q, many.q[:, :, :paths])


@pytest.mark.parametrize("scheme", ["verlet_kdk_strong2", "chin4a_strong2", "verlet_kdk", "gauss_dkdkd_midpoint"])
def test_few_paths_of_kicks(scheme):
    """Products of noise gradients, weighted by functionals of the path, have the same bits for few paths."""
    pytest.importorskip("numba")
    pytest.importorskip("sympy")
    model = ss.model_from_sympy("p**2/2 + cos(q)", noise=["s*q**2", "s*cos(2*q)"], params={"s": 0.3})
    how = {"q0": 0.3, "p0": 0.1, "step": 1.7, "steps": 9, "seed": 5, "scheme": scheme}
    many = ss.simulate(model, paths=40, **how)
    for first in range(0, 39, 3):
        run = ss.simulate(model, paths=1 + first % 2, first_path=first, **how)
        np.testing.assert_array_equal(run.q, many.q[:, :, first : first + 1 + first % 2])
        np.testing.assert_array_equal(run.p, many.p[:, :, first : first + 1 + first % 2])


def test_lanes_of_the_librarys_sine():
    """The library's sine and cosine accept any number of lanes; other functions called by address are not known to."""
    numba = pytest.importorskip("numba")

    def pendulum(sines):
        @numba.cfunc(ss.numba_signature("gradient"))
        def gradient(nlane, ndof, nham, t, w, q, p, hq, hp, user):
            sine, cosine = np.empty(nlane), np.empty(nlane)
            sines(nlane, q, sine.ctypes, cosine.ctypes)
            w, p = numba.carray(w, (nham, nlane)), numba.carray(p, nlane)
            hq, hp = numba.carray(hq, nlane), numba.carray(hp, nlane)
            for i in range(nlane):
                hq[i] = w[0, i] * sine[i] + 0.3 * w[1, i] * cosine[i]
                hp[i] = w[0, i] * p[i]
            return 0

        return gradient

    mine, other = pendulum(ss.numba_sincos()), pendulum(type(ss.numba_sincos())(lambda n, x, s, c: 0))
    assert ss.native.callbacks.takes_any_lanes([mine])
    assert not ss.native.callbacks.takes_any_lanes([other])
    traits = {"separable": True, "position_noise": True, "identity_mass": True}
    model = ss.Model(ndof=1, nnoise=1, gradient=mine, **traits)
    how = {"q0": 0.3, "p0": 0.1, "step": 0.05, "steps": 60, "seed": 5, "scheme": "stormer_verlet"}
    many = ss.simulate(model, paths=300, **how)
    for paths in (1, 2, 5):
        np.testing.assert_array_equal(ss.simulate(model, paths=paths, **how).q, many.q[:, :, :paths])


def test_one_path_of_a_quadratic_model():
    """One solve a step, with the bits of many paths, for a Hamiltonian that mixes q and p and depends on time."""
    numba = pytest.importorskip("numba")

    @numba.cfunc(ss.numba_signature("gradient_hessian"))
    def gradient_hessian(nlane, ndof, nham, t, w, q, p, hq, hp, hqq, hqp, hpp, user):
        w, q, p = numba.carray(w, (nham, nlane)), numba.carray(q, nlane), numba.carray(p, nlane)
        hq, hp = numba.carray(hq, nlane), numba.carray(hp, nlane)
        hqq, hqp, hpp = numba.carray(hqq, nlane), numba.carray(hqp, nlane), numba.carray(hpp, nlane)
        for i in range(nlane):
            hqq[i], hqp[i], hpp[i] = w[0, i] * (1 + 0.5 * np.cos(t)), 0.3 * w[0, i] + 0.2 * w[1, i], w[0, i]
            hq[i] = hqq[i] * q[i] + hqp[i] * p[i] + w[0, i] * np.sin(t)
            hp[i] = hqp[i] * q[i] + hpp[i] * p[i]
        return 0

    @numba.cfunc(ss.numba_signature("gradient"))
    def gradient(nlane, ndof, nham, t, w, q, p, hq, hp, user):
        w, q, p = numba.carray(w, (nham, nlane)), numba.carray(q, nlane), numba.carray(p, nlane)
        hq, hp = numba.carray(hq, nlane), numba.carray(hp, nlane)
        for i in range(nlane):
            mixed = 0.3 * w[0, i] + 0.2 * w[1, i]
            hq[i] = w[0, i] * (1 + 0.5 * np.cos(t)) * q[i] + mixed * p[i] + w[0, i] * np.sin(t)
            hp[i] = mixed * q[i] + w[0, i] * p[i]
        return 0

    functions = {"gradient": gradient, "gradient_hessian": gradient_hessian}
    assert ss.native.callbacks.takes_any_lanes(functions.values())
    model = ss.Model(ndof=1, nnoise=1, quadratic=True, **functions)
    for scheme in ("gauss2", "gauss3", "gauss4", "lobatto3", "lobatto4_swapped"):
        how = {"q0": 0.3, "p0": 0.1, "step": 0.05, "steps": 60, "seed": 5, "scheme": scheme}
        many = ss.simulate(model, paths=300, **how)
        assert many.report.counters["solves"] == 300 * 60
        for paths in (1, 2, 5):
            run = ss.simulate(model, paths=paths, **how)
            np.testing.assert_array_equal(run.q, many.q[:, :, :paths])
            np.testing.assert_array_equal(run.p, many.p[:, :, :paths])
            assert run.report.counters["solves"] == paths * 60
        if scheme != "gauss2":
            plain = ss.simulate(model, paths=300, general=True, **how)
            np.testing.assert_allclose(many.q, plain.q, rtol=1e-12, atol=1e-13)
            np.testing.assert_allclose(many.p, plain.p, rtol=1e-12, atol=1e-13)
