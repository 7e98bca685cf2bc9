# SPDX-License-Identifier: BSD-3-Clause
"""Users' models as NumPy functions, their failures, and threads that call one model."""

import ctypes
import gc
import math
import threading
import traceback
import weakref

import numpy as np
import pytest
import symsde as ss
from conftest import rotation_gradient
from symsde import errors

SCHEMES = ["midpoint", "symplectic_euler", "stormer_verlet", "gauss2", "heun", "euler_maruyama"]


@pytest.mark.parametrize("scheme", SCHEMES)
def test_equal_to_the_built_in_model(scheme, kubo, user_kubo, options):
    mine, known = (ss.simulate(model, scheme=scheme, **options) for model in (user_kubo, kubo))
    np.testing.assert_allclose(mine.q, known.q, rtol=0, atol=40 * 8 * np.finfo(float).eps)
    np.testing.assert_allclose(mine.p, known.p, rtol=0, atol=40 * 8 * np.finfo(float).eps)
    assert mine.report.threads == 1


def test_moments_of_a_user_model(kubo, user_kubo, options):
    mine, known = (ss.moments(model, **options) for model in (user_kubo, kubo))
    np.testing.assert_allclose(mine.mean_energy, known.mean_energy, rtol=1e-13)


def test_gradient_alone_is_enough(kubo, options):
    model = ss.Model(ndof=1, nnoise=1, gradient=rotation_gradient)
    mine, known = (ss.simulate(m, **options) for m in (model, kubo))
    np.testing.assert_allclose(mine.q, known.q, rtol=0, atol=1e-12)


def test_exact_rotation_of_a_user_model():
    def gradient(t, w, q, p):
        return w[0] * q - 0.5 * w[1], w[0] * p

    facts = {"gradient": gradient, "position_noise": True, "additive": True, "identity_mass": True}
    run = {"scheme": "exact_rotation", "q0": 0.8, "p0": -0.3, "step": 0.7, "steps": 20, "paths": 9}
    mine = ss.Model(ndof=1, nnoise=1, rotation=[1.0], **facts)
    gc.collect()  # the library keeps a copy of the frequencies
    assert mine.traits.rotation == (1.0,)
    known = ss.models.linear_oscillator(sigma=0.5)
    assert known.traits.rotation == (1.0,) and ss.models.kubo().traits.rotation is None
    np.testing.assert_allclose(ss.simulate(mine, **run).q, ss.simulate(known, **run).q, rtol=0, atol=1e-13)
    without = ss.Model(ndof=1, nnoise=1, **facts)
    assert without.traits.rotation is None
    with pytest.raises(errors.IncompatibleError, match="trait rotation"):
        ss.simulate(without, **run)
    with pytest.raises(errors.WrongShapeError, match="rotation"):
        ss.Model(ndof=1, nnoise=1, rotation=[1.0, 2.0], **facts)
    with pytest.raises(ValueError, match=r"rotation\(1\)"):
        ss.Model(ndof=1, nnoise=1, rotation=[-1.0], **facts)


def test_evaluation(user_kubo, kubo):
    q, p = np.array([[0.5, 1.0, 2.0]]), np.array([[0.1, 0.2, 0.3]])
    for name in ("value", "gradient", "hessian"):
        mine, known = (getattr(model, name)(q, p, [1.0, 2.0]) for model in (user_kubo, kubo))
        np.testing.assert_allclose(mine, known, rtol=1e-15)


def test_what_is_derived_is_probed_once_for_each_size():
    calls = []

    def gradient(t, w, q, p):
        calls.append(q.shape)
        far = q > 20  # a region in which the model is not separable
        return w[0] * (q + far * p), w[0] * (p + far * q)

    def asked(model, q0):
        calls.clear()
        ss.simulate(model, q0=q0, p0=0.1, step=0.1, steps=1, scheme="symplectic_euler")
        return len(calls)

    model, by_hand = (
        ss.Model(ndof=1, nnoise=0, gradient=gradient, separable=True, derived=derived) for derived in (True, False)
    )
    probed, once, again = asked(model, 1.0), asked(model, 1.5), asked(by_hand, 1.0)
    assert once < probed / 3
    assert again == asked(by_hand, 1.0) == probed
    assert asked(model, 5.0) == probed
    for _ in range(2):
        with pytest.raises(errors.FalseTraitError, match="separable"):
            asked(model, 40.0)
    with pytest.raises(errors.WrongTypeError, match="derived"):
        ss.Model(ndof=1, nnoise=0, gradient=gradient, derived="yes")


def lane_by_lane(ndof, nnoise, force, **traits):
    """A model like compiled functions, for any number of lanes, from force(t, w, q, p) of one lane; and its calls."""
    calls, array = [], ctypes.POINTER(ctypes.c_double)

    @ctypes.CFUNCTYPE(*(ctypes.c_int,) * 4, ctypes.c_double, *(array,) * 5, ctypes.c_void_p)
    def gradient(nlane, ndof, nham, t, w, q, p, hq, hp, user):  # noqa: PLR0917
        calls.append(nlane)
        for lane in range(nlane):
            mine = slice(lane, nlane * ndof, nlane)
            weights, momenta = w[lane : nlane * nham : nlane], p[mine]
            for k, slope in enumerate(force(t, weights, q[mine], momenta)):
                hq[k * nlane + lane] = slope
                hp[k * nlane + lane] = weights[0] * momenta[k]
        return 0

    facts = {"separable": True, "identity_mass": True, "position_noise": True, "any_lanes": True}
    return ss.Model(ndof=ndof, nnoise=nnoise, gradient=gradient, **facts, **traits), calls


@pytest.mark.parametrize("scheme", ["midpoint", "gauss2", "lobatto3"])
@pytest.mark.parametrize("ndof", [2, 3])
def test_one_path_asks_for_as_many_gradients_as_are_counted(ndof, scheme):
    model, calls = lane_by_lane(ndof, 0, lambda t, w, q, p: [w[0] * (math.sin(x) + 0.3 * sum(q)) for x in q])

    def asked_and_counted(steps):
        calls.clear()
        run = ss.simulate(model, scheme=scheme, q0=0.7, p0=0.2, step=0.05, steps=steps)
        return np.array([len(calls), run.report.counters["gradients"]])

    asked_and_counted(1)  # models of derived formulas are probed only once
    asked, counted = asked_and_counted(80) - asked_and_counted(40)
    assert asked == counted > 40 and calls[-1] == 1  # a single path


def tied(t, w, q, p):
    """H = (p.p + q.q)/2 + 0.3 q_1 p_2 q_2,  H_1 = 0.2 q_1 p_2,  H_2 = 0.1 q_2^2"""
    force = w[0] * (q[0] + 0.3 * p[1] * q[1]) + 0.2 * w[1] * p[1], w[0] * (q[1] + 0.3 * q[0] * p[1]) + 0.2 * w[2] * q[1]
    return np.array(force), np.array([w[0] * p[0], w[0] * (p[1] + 0.3 * q[0] * q[1]) + 0.2 * w[1] * q[0]])


def kicked(t, w, q, p):
    """H = p.p/2 - cos q_1 - cos q_2,  H_1 = 0.1 q_1^2,  H_2 = 0.2 q_2"""
    return np.array([w[0] * np.sin(q[0]) + 0.2 * w[1] * q[0], w[0] * np.sin(q[1]) + 0.2 * w[2]]), w[0] * p


def tied_products(t, w, q, p, vq, vp):  # noqa: PLR0917
    mixed = w[0] * 0.3 * q[1] * vp[1] + 0.2 * w[1] * vp[1], w[0] * 0.3 * (vq[0] * p[1] + q[0] * vp[1])
    uq = np.array([w[0] * (vq[0] + 0.3 * p[1] * vq[1]) + mixed[0], (w[0] + 0.2 * w[2]) * vq[1] + mixed[1]])
    return uq, np.array([w[0] * vp[0], w[0] * (vp[1] + 0.3 * (vq[0] * q[1] + q[0] * vq[1])) + 0.2 * w[1] * vq[0]])


def kicked_products(t, w, q, p, vq, vp):  # noqa: PLR0917
    return np.array([(w[0] * np.cos(q[0]) + 0.2 * w[1]) * vq[0], w[0] * np.cos(q[1]) * vq[1]]), w[0] * vp


@pytest.mark.parametrize("scheme", ss.schemes.names())
@pytest.mark.parametrize(("gradient", "product"), [(tied, tied_products), (kicked, kicked_products)])
def test_a_block_asks_for_as_many_derivatives_as_are_counted(gradient, product, scheme):
    asked = [0, 0]

    def counting(k, function):
        def called(*arguments):
            asked[k] += 8
            return function(*arguments)

        return called

    traits = dict.fromkeys(("separable", "position_noise", "identity_mass"), gradient is kicked)
    functions = {"gradient": counting(0, gradient), "hessian_vector": counting(1, product)}
    model = ss.Model(ndof=2, nnoise=2, **functions, **traits)

    def asked_and_counted(steps):
        asked[:] = 0, 0
        run = ss.simulate(model, scheme=scheme, q0=0.2, p0=0.1, step=0.02, steps=steps, paths=8, seed=3)
        return np.array([asked, [run.report.counters[x] for x in ("gradients", "hessian_vectors")]]), run

    try:
        (few, _), (many, run) = asked_and_counted(4), asked_and_counted(12)
    except errors.IncompatibleError:
        return
    (gradients, products), counted = many - few
    assert gradients == counted[0] > 0 or (gradient is kicked and 0 < gradients < counted[0])  # p is a velocity unasked
    assert products == counted[1] or run.report.counters["hessians"] > 0  # a Hessian is made of products


def ends_at_a_wall(t, w, q, p):
    """A force that is NaN beyond 0.9, but a number where the position is NaN, as minima and maxima of C return."""
    return [math.nan if q[0] > 0.9 else w[0] * (q[0] if abs(q[0]) < 2 else 2.0), w[0] * q[1]]


def rounds_by_momenta(t, w, q, p):
    return [w[0] * ((x + y) - y) for x, y in zip(q, p, strict=True)]


def shaken_in_time(t, w, q, p):
    """A force that is NaN beyond 0.9; the stepper for stiff steps is made when it is first needed, and evaluates a
    single path.
    """
    if q[0] > 0.9:
        return [math.nan] * 2
    moving = 1 + 0.3 * math.sin(1.7 * t)
    ties = 0.5 * w[0] * (q[1] - q[0])
    forces = w[0] * math.sin(q[0]) - ties + 0.3 * w[1] * math.cos(q[0]), w[0] * math.sin(q[1]) + ties
    return [moving * x for x in forces]


@pytest.mark.filterwarnings("ignore::symsde.errors.PathsFailedWarning")
@pytest.mark.parametrize(
    ("scheme", "force", "nnoise", "step"),
    [
        ("gauss2", ends_at_a_wall, 0, 0.3),
        ("lobatto3", ends_at_a_wall, 0, 0.3),
        ("gauss3", rounds_by_momenta, 0, 0.1),
        ("gauss2_strong32", shaken_in_time, 1, -0.9),
    ],
)
def test_one_path_meets_what_it_meets_in_a_block(scheme, force, nnoise, step):
    """A single path is treated as in a block: NaN is noticed, momenta are its own, and noises that depend on time
    are noticed, bit for bit.
    """
    random = np.random.default_rng(1)
    q0, p0 = np.clip(0.4 * random.normal(size=(2, 13)), -0.5, 0.5), random.normal(size=(2, 13))
    model, _ = lane_by_lane(2, nnoise, force)
    how = {"scheme": scheme, "step": step, "steps": 24, "seed": 1}
    many = ss.simulate(model, q0=q0, p0=p0, paths=13, **how)
    assert force is rounds_by_momenta or 0 < (many.status != 0).sum() < 13
    for i in range(13):
        own = slice(i, i + 1)
        one = ss.simulate(model, q0=q0[:, own], p0=p0[:, own], first_path=i, **how)
        np.testing.assert_array_equal(one.q, many.q[:, :, own])
        np.testing.assert_array_equal(one.p, many.p[:, :, own])
        assert (one.status, one.failed_step) == (many.status[i], many.failed_step[i])


def test_hessian_vector_is_used(options):
    called = []

    def hessian_vector(t, w, q, p, vq, vp):  # noqa: PLR0917
        called.append(vq.shape)
        rate = w[0] + 0.3 * w[1]
        return rate * vq, rate * vp

    model = ss.Model(ndof=1, nnoise=1, gradient=rotation_gradient, hessian_vector=hessian_vector)
    mine = ss.simulate(model, scheme="symplectic_euler", **options)
    known = ss.simulate(ss.models.kubo(), scheme="symplectic_euler", **options)
    assert called
    np.testing.assert_allclose(mine.q, known.q, rtol=0, atol=1e-12)


def test_gradient_hessian_is_used(user_kubo, options):
    called = []

    def gradient_hessian(t, w, q, p):
        called.append(q.shape)
        rate = w[0] + 0.3 * w[1]
        return rate * q, rate * p, rate, np.zeros_like(rate), rate + error

    def gradient(t, w, q, p):
        return rotation_gradient(t, w, q, p)

    error = 0.0
    model = ss.Model(ndof=1, nnoise=1, gradient=gradient, gradient_hessian=gradient_hessian)
    assert model.traits.has_hessian and model.in_python
    mine, known = (ss.simulate(m, scheme="gauss2", **options) for m in (model, user_kubo))
    np.testing.assert_allclose(mine.q, known.q, rtol=0, atol=1e-14)
    assert len(called) > options["steps"]
    np.testing.assert_array_equal(model.hessian(0.5, 0.2), user_kubo.hessian(0.5, 0.2))
    error = 0.01
    with pytest.raises(errors.FalseTraitError, match="has_hessian"):
        model.probe()
    with pytest.raises(ValueError, match=r"5 values|\(hq, hp, hqq, hqp, hpp\)"):
        bad = ss.Model(ndof=1, nnoise=1, gradient=gradient, gradient_hessian=gradient)
        ss.simulate(bad, scheme="gauss2", **options)


def test_more_threads_if_asked(user_kubo, options):
    options |= {"paths": 600}
    two, one = (ss.simulate(user_kubo, threads=n, lanes=64, **options) for n in (2, 1))
    assert two.report.threads == 2
    np.testing.assert_array_equal(two.q, one.q)


class BrokenError(Exception):
    """A planted exception."""


@pytest.mark.parametrize("threads", [1, 2])
def test_exceptions_are_raised_with_their_traceback(threads):
    def gradient(t, w, q, p):
        if t > 0.5:
            raise BrokenError("planted")
        return w[0] * q, w[0] * p

    model = ss.Model(ndof=1, nnoise=0, gradient=gradient)
    common = {"q0": 1.0, "p0": 0.0, "step": 0.1, "paths": 100, "lanes": 8, "threads": threads}
    with pytest.raises(BrokenError, match="planted") as caught:
        ss.simulate(model, steps=20, **common)
    assert "t > 0.5" not in str(caught.value)
    assert "raise BrokenError" in "".join(traceback.format_tb(caught.value.__traceback__))
    assert np.isfinite(ss.simulate(model, steps=3, **common).q).all()  # the model is still usable


def test_exception_of_an_observable(kubo, options):
    with pytest.raises(ZeroDivisionError):
        ss.moments(kubo, observables={"bad": lambda q, p: 1 / 0}, **options)
    with pytest.raises(ValueError, match=r"observable 'bad'.*\(2, 3\)"):
        ss.moments(kubo, observables={"bad": lambda q, p: np.zeros((2, 3))}, **options)


def test_exception_in_evaluation_and_probe():
    def value(t, w, q, p):
        raise BrokenError

    model = ss.Model(ndof=1, nnoise=0, gradient=lambda t, w, q, p: (w[0] * q, w[0] * p), value=value)
    with pytest.raises(BrokenError):
        model.value(1.0, 0.0)


@pytest.mark.parametrize(
    ("result", "words"),
    [
        (lambda q, p: (q[0], p[0, :-1]), ["hp of gradient()", "shape (1, "]),
        (lambda q, p: (q.T, p), ["hq of gradient()"]),
        (lambda q, p: (q, p, q), ["3 values", "(hq, hp)"]),
        (lambda q, p: None, ["NoneType", "(hq, hp)"]),
        (lambda q, p: (q, "p"), ["hp of gradient()", "real numbers"]),
        (lambda q, p: (q * 1j, p), ["hq of gradient()", "complex"]),
    ],
)
def test_wrong_results_are_named(result, words, options):
    model = ss.Model(ndof=1, nnoise=1, gradient=lambda t, w, q, p: result(q, p))
    with pytest.raises(ValueError) as caught:
        ss.simulate(model, **options)
    for word in words:
        assert word in str(caught.value)


def test_nan_fails_one_lane_only():
    def gradient(t, w, q, p):
        return w[0] * np.where(q > 5, np.nan, q), w[0] * p

    model = ss.Model(ndof=1, nnoise=0, gradient=gradient)
    start = np.array([[1.0, 6.0, 2.0]])
    with pytest.warns(ss.PathsFailedWarning):
        run = ss.simulate(model, q0=start, p0=0.0, step=0.1, steps=5, paths=3)
    assert list(run.status > 0) == [False, True, False]
    good = ss.simulate(model, q0=start[:, ::2], p0=0.0, step=0.1, steps=5, paths=2)
    np.testing.assert_array_equal(run.q[:, :, ::2], good.q)


def test_kept_state_is_a_copy(options):
    kept = []

    def gradient(t, w, q, p):
        kept.append(q)
        q *= 1.0
        return w[0] * q, w[0] * p

    ss.simulate(ss.Model(ndof=1, nnoise=1, gradient=gradient), **options)
    gc.collect()
    assert kept and all(q.flags.owndata for q in kept)


def test_models_are_freed_with_their_functions():
    class Gradient:
        def __call__(self, t, w, q, p):
            return w[0] * q, w[0] * p

    function = Gradient()
    gone = weakref.ref(function)
    model = ss.Model(ndof=1, nnoise=0, gradient=function)
    del function
    gc.collect()
    run = ss.simulate(model, q0=1.0, p0=0.0, step=0.1, steps=3)
    assert gone() is not None
    del model, run
    gc.collect()
    assert gone() is None


def test_one_model_in_two_python_threads(user_kubo, options):
    expected = ss.simulate(user_kubo, **options).q
    found = []
    workers = [threading.Thread(target=lambda: found.append(ss.simulate(user_kubo, **options).q)) for _ in range(4)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    assert len(found) == 4
    for q in found:
        np.testing.assert_array_equal(q, expected)


# Calls that an observable may make of its own model and scheme while two threads run; a lock would wait forever.
ASKS = {
    "value": lambda model, scheme: model.value,
    "gradient": lambda model, scheme: lambda q, p: model.gradient(q, p)[0][0],
    "step": lambda model, scheme: lambda q, p: ss.step(model, scheme, q, p, 0.1)[0][0],
    "run": lambda model, scheme: lambda q, p: ss.simulate(
        model, scheme=scheme, q0=q, p0=p, step=0.1, steps=2, paths=q.shape[1], lanes=8, threads=2
    ).q[-1, 0],
    "moments": lambda model, scheme: lambda q, p: ss.moments(
        model, scheme=scheme, q0=q, p0=p, step=0.1, steps=1, paths=q.shape[1], lanes=8, threads=2,
        observables={"e": model.value},
    ).mean["e"][-1] * 0 + q[0],  # the result must not contain values of other paths
}  # fmt: skip


@pytest.mark.parametrize("asked", ASKS)
@pytest.mark.parametrize("own", [False, True])
def test_observables_ask_their_own_model_from_any_thread(asked, own, kubo, user_kubo):
    def ask(threads):
        model, scheme = user_kubo if own else kubo, ss.schemes.get("gauss2")
        observables = {"asked": ASKS[asked](model, scheme)}
        run = {"q0": 1.0, "p0": 0.0, "step": 0.1, "steps": 2, "paths": 64, "lanes": 8, "scheme": scheme}
        return ss.moments(model, observables=observables, threads=threads, **run).mean["asked"]

    found = []
    worker = threading.Thread(target=lambda: found.append(ask(2)), daemon=True)
    worker.start()
    worker.join(60)
    assert not worker.is_alive(), "the run hangs"
    np.testing.assert_allclose(found[0], ask(1), rtol=1e-13)


def test_an_exception_reaches_the_call_that_caused_it(user_kubo, options):
    """Two runs use one model at the same time: only the run whose observable fails raises an exception."""

    def bad(q, p):
        raise BrokenError

    outcomes = {}

    def work(name, **more):
        try:
            outcomes[name] = ss.moments(user_kubo, **more, **options).mean_q
        except BrokenError:
            outcomes[name] = "broken"

    expected = ss.moments(user_kubo, **options).mean_q
    workers = [
        threading.Thread(target=work, args=(name,), kwargs={"observables": {"bad": bad}} if name % 2 else {})
        for name in range(8)
    ]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    for name, outcome in outcomes.items():
        if name % 2:
            assert isinstance(outcome, str)
        else:
            np.testing.assert_array_equal(outcome, expected)


def test_handles_of_a_model_are_used_again(kubo, options):
    """However many calls were made, a model has only as many handles as there were calls at one time."""
    for _ in range(20):
        ss.simulate(kubo, **options)
    assert len(kubo._handles._idle) == 1


def test_results_of_another_real_type_are_converted(options):
    """A gradient in float32 or in integers is converted."""

    def model(rounded):
        def gradient(t, w, q, p):
            return rounded(w[0] * np.sin(q) + w[1] * np.cos(q)), w[0] * p

        return ss.Model(ndof=1, nnoise=1, gradient=gradient, separable=True)

    single = ss.simulate(model(np.float32), scheme="stormer_verlet", **options)
    by_hand = ss.simulate(model(lambda x: x.astype(np.float32).astype(float)), scheme="stormer_verlet", **options)
    np.testing.assert_array_equal(single.q, by_hand.q)
    exact = ss.simulate(model(lambda x: x), scheme="stormer_verlet", **options)
    assert 0 < np.abs(single.q - exact.q).max() < 1e-5


def test_set_up_does_not_ask_for_every_noise_of_very_many():
    """Each call takes the weights of all noises; a call for each noise would make the cost quadratic."""
    calls = []

    def gradient(t, w, q, p):
        calls.append(w.shape)
        return w[0] * q + w[1] * q, w[0] * p

    for noises in (1024, 1025):
        calls.clear()
        ss.simulate(ss.Model(ndof=1, nnoise=noises, gradient=gradient), q0=1.0, p0=0.0, step=0.1, steps=1)
        assert (len(calls) > 1024) == (noises == 1024) and (noises == 1024 or len(calls) < 400)


@pytest.mark.parametrize("number", [1, 2, 3])
def test_each_noise_is_asked_for_its_traits(number):
    """A false trait of any one of three noises is found."""
    for trait, moved in (("position_noise", lambda q, p: 1.0 + 0 * p), ("additive", lambda q, p: p)):
        model = ss.Model(
            ndof=1,
            nnoise=3,
            gradient=lambda t, w, q, p, moved=moved: (
                w[0] * np.sin(q) + w[1:].sum(axis=0),
                w[0] * p + w[number] * moved(q, p),
            ),
            **{trait: True},
        )
        with pytest.raises(ss.errors.FalseTraitError, match=rf"declares {trait}, but d2?H_{number}/"):
            model.probe()
