# SPDX-License-Identifier: BSD-3-Clause
"""A user's own pair of exact flows, drift and kick: steps made of them, probes that refute false ones, refusals."""

import math

import numba
import numpy as np
import pytest
import symsde as ss

N, HOP, PULL, NOISE = 4, 0.5, 1.3, 0.6  # ring of N sites
_ring = np.roll(np.eye(N), 1, axis=0) + np.roll(np.eye(N), -1, axis=0)
_rates, _modes = np.linalg.eigh(_ring)

Q0, P0 = np.array([0.9, -0.4, 0.3, 0.7]), np.array([0.2, 0.5, -0.8, 0.1])
RUN = {"scheme": "gauss_dkdkd", "q0": Q0, "p0": P0, "step": 1 / 32, "steps": 32, "seed": 3}


def turned(tau):
    """cos(HOP tau R) and sin(HOP tau R) of the ring's matrix R: psi = q + ip -> exp(i HOP tau R) psi."""
    angle = HOP * tau * _rates
    return (_modes * np.cos(angle)) @ _modes.T, (_modes * np.sin(angle)) @ _modes.T


def drift(_t, tau, q, p):
    """D = -HOP sum_k (q_k q_{k+1} + p_k p_{k+1})."""
    c, s = turned(tau)
    return c @ q - s @ p, c @ p + s @ q


def kick(_t, w, q, p):
    """K_0 = PULL sum_k (q_k^2 + p_k^2)^2/4, K_k = NOISE (q_k^2 + p_k^2)/2."""
    angle = w[0] * PULL * (q * q + p * p) + NOISE * w[1:]
    c, s = np.cos(angle), np.sin(angle)
    return c * q + s * p, c * p - s * q


@numba.cfunc(ss.numba_signature("drift"))
def compiled_drift(nlane, ndof, _t, tau, q_, p_, qn_, pn_, _user):  # noqa: PLR0917
    """The same."""
    q, p = numba.carray(q_, (ndof, nlane)), numba.carray(p_, (ndof, nlane))
    qn, pn = numba.carray(qn_, (ndof, nlane)), numba.carray(pn_, (ndof, nlane))
    for i in range(ndof):
        for lane in range(nlane):
            x, y = 0.0, 0.0
            for j in range(ndof):
                a, b = 0.0, 0.0
                for k in range(ndof):
                    m = _modes[i, k] * _modes[j, k]
                    a += m * math.cos(HOP * tau * _rates[k])
                    b += m * math.sin(HOP * tau * _rates[k])
                x += a * q[j, lane] - b * p[j, lane]
                y += a * p[j, lane] + b * q[j, lane]
            qn[i, lane], pn[i, lane] = x, y
    return 0


@numba.cfunc(ss.numba_signature("kick"))
def compiled_kick(nlane, ndof, nham, _t, w_, q_, p_, qn_, pn_, _user):  # noqa: PLR0917
    """The same."""
    w = numba.carray(w_, (nham, nlane))
    q, p = numba.carray(q_, (ndof, nlane)), numba.carray(p_, (ndof, nlane))
    qn, pn = numba.carray(qn_, (ndof, nlane)), numba.carray(pn_, (ndof, nlane))
    for i in range(ndof):
        for lane in range(nlane):
            angle = w[0, lane] * PULL * (q[i, lane] ** 2 + p[i, lane] ** 2) + NOISE * w[1 + i, lane]
            c, s = math.cos(angle), math.sin(angle)
            qn[i, lane] = c * q[i, lane] + s * p[i, lane]
            pn[i, lane] = c * p[i, lane] - s * q[i, lane]
    return 0


COMPILED = ss.Model(ndof=N, nnoise=N, drift=compiled_drift, kick=compiled_kick)
PYTHON = ss.Model(ndof=N, nnoise=N, drift=drift, kick=kick)


def ring_of_formulas():
    """The same system by the library's own split: exact linear flows and kicks that turn planes."""
    sites = range(1, N + 1)
    hop = " + ".join(f"-{HOP}*(q{k}*q{k % N + 1} + p{k}*p{k % N + 1})" for k in sites)
    pull = " + ".join(f"{PULL}*(q{k}**2 + p{k}**2)**2/4" for k in sites)
    noise = [f"{NOISE}*(q{k}**2 + p{k}**2)/2" for k in sites]
    return ss.model_from_sympy(f"{hop} + {pull}", noise=noise, split=hop)


@pytest.mark.parametrize("model", [COMPILED, PYTHON], ids=["compiled", "Python"])
@pytest.mark.parametrize("paths, step", [(1, 1 / 32), (5, -1 / 32), (300, 1 / 32)])
def test_steps_are_those_of_the_librarys_own_split(model, paths, step):
    """Both sides take the same weights and exact flows: they agree to rounding, on every path, forward and back."""
    options = {**RUN, "step": step, "paths": paths}
    mine, theirs = ss.simulate(model, **options), ss.simulate(ring_of_formulas(), **options)
    assert mine.report.stepper == "kicks and drifts by the model's own flows"
    assert "turn the planes" in theirs.report.stepper
    assert abs(mine.q - theirs.q).max() < 2e-13
    assert abs(mine.p - theirs.p).max() < 2e-13
    norm = np.sum(mine.q**2 + mine.p**2, axis=1)
    assert abs(norm - norm[0]).max() < 5e-13


def test_one_kick_by_the_whole_increment():
    """verlet_dkd_weak2 is drift, kick, drift with its three-point dW, which driving increments tell."""
    run = ss.simulate(PYTHON, **{**RUN, "scheme": "verlet_dkd_weak2", "paths": 3})
    dw = ss.diagnose.driving_increments(run)
    q, p = (np.repeat(x[:, None], 3, axis=1) for x in (Q0, P0))
    h = RUN["step"]
    for n in range(RUN["steps"]):
        q, p = drift(0, h / 2, q, p)
        q, p = kick(0, np.concatenate([np.full((1, 3), h), dw[n]]), q, p)
        q, p = drift(0, h / 2, q, p)
    assert abs(run.q[-1] - q).max() < 1e-13
    assert abs(run.p[-1] - p).max() < 1e-13


def test_a_path_has_the_same_bits_in_any_company():
    """Blocks, threads and lanes change no bits; compiled functions of numba are known to take any lanes."""
    whole = ss.simulate(COMPILED, **RUN, paths=300)
    for first, paths, threads in ((0, 1, 1), (7, 5, 1), (0, 300, 2)):
        part = ss.simulate(COMPILED, **RUN, first_path=first, paths=paths, threads=threads)
        assert np.array_equal(part.q, whole.q[:, :, first : first + paths])
    assert np.array_equal(ss.simulate(COMPILED, **RUN, paths=300, save_every=8).q, whole.q[::8])


B = 2.0  # magnetic field


def charge_drift(_t, tau, q, p):
    """D = |p + B (q_2, -q_1)/2|^2/2, a charge that circles: velocities turn by the angle B tau."""
    v1, v2 = p[0] + B / 2 * q[1], p[1] - B / 2 * q[0]
    s, c = np.sin(B * tau), np.cos(B * tau)
    x, y = q[0] + (s * v1 + (1 - c) * v2) / B, q[1] + (s * v2 - (1 - c) * v1) / B
    return (x, y), (c * v1 + s * v2 - B / 2 * y, c * v2 - s * v1 + B / 2 * x)


def charge_kick(_t, w, q, p):
    """K_0 = |q|^4/4, K_k = .3 sin q_k."""
    r = q[0] ** 2 + q[1] ** 2
    return q, p - w[0] * r * q - 0.3 * w[1:] * np.cos(q)


def test_charges_in_a_magnetic_field():
    """D of q and p and kicks by functions of q: the steps of the formula with split."""
    model = ss.Model(
        ndof=2, nnoise=2, drift=lambda *given: tuple(map(np.array, charge_drift(*given))), kick=charge_kick
    )
    D = f"(p1 + {B / 2}*q2)**2/2 + (p2 - {B / 2}*q1)**2/2"
    formula = ss.model_from_sympy(f"{D} + (q1**2 + q2**2)**2/4", noise=["0.3*sin(q1)", "0.3*sin(q2)"], split=D)
    options = {**RUN, "q0": [0.6, -0.3], "p0": [0.1, 0.8], "paths": 40}
    mine, theirs = ss.simulate(model, **options), ss.simulate(formula, **options)
    assert theirs.report.stepper != mine.report.stepper
    assert abs(mine.q - theirs.q).max() < 1e-13
    assert abs(mine.p - theirs.p).max() < 1e-13


def fast_drift(_t, tau, q, p):
    """D = sqrt(1 + p^2), which is not quadratic."""
    return q + tau * p / np.sqrt(1 + p * p), p


def bent_kick(_t, w, q, p):
    """K_0 = q^4/4, K_1 = .8 cos q, K_2 = .5 q^2."""
    return q, p - w[0] * q**3 + 0.8 * w[1] * np.sin(q) - w[2] * q


def test_strong_order_where_the_drift_is_not_quadratic():
    """Slopes of 400 paths against 2048 steps on the same Brownian paths; the fault of exchanged kicks has slope 1.

    Local slopes of such errors scatter by about .1: 1.3 lies between both orders.
    """
    model = ss.Model(ndof=1, nnoise=2, drift=fast_drift, kick=bent_kick)
    found = ss.convergence(
        model, "gauss_dkdkd", q0=0.7, p0=0.4, horizon=1.0, steps=(16, 32, 64, 128), paths=400, seed=5
    )
    assert 1.35 < found.order < 2.0


def test_drift_and_kick_are_told_the_time():
    """D = (1 + .5 sin t) p^2/2 and K_0 = cos(t) q^4/4, against a further pair (s, r) with s = t, r its momentum."""
    phase = lambda t, tau: tau + 0.5 * (np.cos(t) - np.cos(t + tau))  # noqa: E731

    def of_time(t, tau, q, p):
        return q + phase(t, tau) * p, p

    def kick_of_time(t, w, q, p):
        return q, p - w[0] * np.cos(t) * q**3 - w[1] * np.cos(t) * 0.4 * np.cos(q)

    def wide(_t, tau, q, p):
        bent = -0.5 * (np.sin(q[1] + tau) - np.sin(q[1])) * p[0] ** 2 / 2
        return (q[0] + phase(q[1], tau) * p[0], q[1] + tau), (p[0], p[1] + bent)

    def wide_kick(_t, w, q, p):
        x, s = q
        a, b = w[0] * np.cos(s) * x**3, w[1] * np.cos(s) * 0.4 * np.cos(x)
        c, d = w[0] * np.sin(s) * x**4 / 4, w[1] * np.sin(s) * 0.4 * np.sin(x)
        return q, (p[0] - a - b, p[1] + c + d)

    options = {**RUN, "steps": 60, "t0": 0.3, "paths": 9}
    one = ss.simulate(ss.Model(ndof=1, nnoise=1, drift=of_time, kick=kick_of_time), **{**options, "q0": 0.8, "p0": 0.2})
    more = ss.Model(ndof=2, nnoise=1, drift=as_arrays(wide), kick=as_arrays(wide_kick))
    two = ss.simulate(more, **{**options, "t0": 0.0, "q0": [0.8, 0.3], "p0": [0.2, 0.0]})
    assert abs(one.q[:, 0] - two.q[:, 0]).max() < 1e-13
    assert abs(one.p[:, 0] - two.p[:, 0]).max() < 1e-13


def as_arrays(function):
    """A function whose results are arrays."""
    return lambda *given: tuple(np.array(x) for x in function(*given))


def pendulum(*, drifts=None, kicks=None, **more):
    """D = p^2/2, K_0 = q^4/4, K_1 = .5 sin q."""

    def right_drift(_t, tau, q, p):
        return q + tau * p, p

    def right_kick(_t, w, q, p):
        return q, p - w[0] * q**3 - 0.5 * w[1] * np.cos(q)

    return ss.Model(ndof=1, nnoise=1, drift=drifts or right_drift, kick=kicks or right_kick, **more)


def gradient(_t, w, q, p):
    """The gradient of the pendulum."""
    return w[0] * q**3 + 0.5 * w[1] * np.cos(q), w[0] * p


FALSE = {
    "a time that is bent": ({"drifts": lambda t, tau, q, p: (q + tau * (1 + 0.01 * tau) * p, p)}, "drift over tau"),
    "a time without sign": ({"drifts": lambda t, tau, q, p: (q + abs(tau) * p, p)}, "and back"),
    "a time of another clock": (
        {"drifts": lambda t, tau, q, p: (q + (tau + 0.01 * (np.sin(t + tau) - np.sin(t)) * tau) * p, p)},
        "drift over tau",
    ),
    "a loss": ({"drifts": lambda t, tau, q, p: (q + tau * p, p * np.exp(-0.01 * tau))}, "drift over tau"),
    "a loss in a flow": (
        {"drifts": lambda t, tau, q, p: (q + (1 - np.exp(-0.01 * tau)) / 0.01 * p, p * np.exp(-0.01 * tau))},
        "drift changes the area",
    ),
    "a kick that is bent": (
        {"kicks": lambda t, w, q, p: (q, p - w[0] * q**3 - 0.5 * w[1] * (1 + 0.01 * w[1]) * np.cos(q))},
        "K_1 alone",
    ),
    "a kick of a force": (
        {"kicks": lambda t, w, q, p: (q * np.exp(0.01 * w[0]), p - w[1] * 0.5)},
        "kick changes the area",
    ),
    "noises that do not commute": (
        {"kicks": lambda t, w, q, p: (q + 0.01 * w[1], p - w[0] * (q + 0.01 * w[1]) ** 3)},
        "K_0 and then by K_1 .* in the other order",
    ),
    "weights of another lane": (
        {"kicks": lambda t, w, q, p: (q, p - w[0] * q**3 - 0.5 * w[1, :1] * np.cos(q))},
        "differ from lane to lane",
    ),
    "another mass than H": (
        {"drifts": lambda t, tau, q, p: (q + 1.01 * tau * p, p), "gradient": gradient},
        "drift and kick by H_0 .* gradient of H_0",
    ),
    "another noise than H_1": (
        {"kicks": lambda t, w, q, p: (q, p - w[0] * q**3 - 0.505 * w[1] * np.cos(q)), "gradient": gradient},
        "kick by noises .* gradient of H_1",
    ),
    "another sign than H_1": (
        {"kicks": lambda t, w, q, p: (q, p - w[0] * q**3 + 0.5 * w[1] * np.cos(q)), "gradient": gradient},
        "kick by noises .* gradient of H_1",
    ),
}


@pytest.mark.parametrize("fault", FALSE)
def test_false_flows_are_refused(fault):
    """Faults of one per cent, in one weight, sign or lane: the probe says which property is missing."""
    given, words = FALSE[fault]
    with pytest.raises(ss.errors.FalseTraitError, match=words):
        ss.simulate(pendulum(**given), **{**RUN, "q0": 0.5, "p0": 0.3})


@numba.cfunc(ss.numba_signature("drift"))
def forgetful_drift(nlane, ndof, _t, tau, q_, p_, qn_, _pn, _user):  # noqa: PLR0917
    """Leaves p as it finds it."""
    q, p = numba.carray(q_, (ndof, nlane)), numba.carray(p_, (ndof, nlane))
    qn = numba.carray(qn_, (ndof, nlane))
    for lane in range(nlane):
        qn[0, lane] = q[0, lane] + tau * p[0, lane]
    return 0


@numba.cfunc(ss.numba_signature("drift"))
def writing_drift(nlane, ndof, _t, tau, q_, p_, qn_, pn_, _user):  # noqa: PLR0917
    """Moves its inputs."""
    q, p = numba.carray(q_, (ndof, nlane)), numba.carray(p_, (ndof, nlane))
    qn, pn = numba.carray(qn_, (ndof, nlane)), numba.carray(pn_, (ndof, nlane))
    for lane in range(nlane):
        q[0, lane] += tau * p[0, lane]
        qn[0, lane], pn[0, lane] = q[0, lane], p[0, lane]
    return 0


def test_outputs_are_written_and_inputs_are_not():
    """A compiled function that leaves an output, or moves its inputs, is told so."""
    with pytest.raises(ss.errors.FalseTraitError, match="drift does not write p_1"):
        ss.simulate(pendulum(drifts=forgetful_drift), **{**RUN, "q0": 0.5, "p0": 0.3})
    with pytest.raises(ss.errors.FalseTraitError, match="drift writes into q or p"):
        ss.simulate(pendulum(drifts=writing_drift), **{**RUN, "q0": 0.5, "p0": 0.3})


@pytest.mark.parametrize("unit", [1e-15, 1e-4, 1e6, 1e12])
def test_units_of_time_do_not_matter(unit):
    """True flows pass, and a false one is refused, whatever a unit of time is; and where one of the parts is zero."""
    turn = lambda t, tau, q, p: (  # noqa: E731
        q * np.cos(tau / unit) + p * np.sin(tau / unit),
        p * np.cos(tau / unit) - q * np.sin(tau / unit),
    )
    noise = lambda t, w, q, p: (q, p - w[0] / unit * q**3 - w[1] / unit**0.5 * np.cos(q))  # noqa: E731
    bent = lambda t, w, q, p: (q, p - w[0] / unit * q**3 - w[1] / unit**0.5 * np.cos(q + 0.01 * w[0] / unit))  # noqa: E731
    still = lambda t, tau, q, p: (q, p)  # noqa: E731
    for drifts in (turn, still):
        pendulum(drifts=drifts, kicks=noise).probe()
        pendulum(drifts=drifts, kicks=lambda t, w, q, p: (q, p)).probe()
        with pytest.raises(ss.errors.FalseTraitError, match="K_0"):
            pendulum(drifts=drifts, kicks=bent).probe()
    faster = lambda t, tau, q, p: turn(t, tau * (1 + 0.01 * tau / unit), q, p)  # noqa: E731
    with pytest.raises(ss.errors.FalseTraitError, match="drift over tau"):
        pendulum(drifts=faster, kicks=noise).probe()


REFUSED = {
    "verlet_kdk": "second derivatives D_pp",
    "chin4a": "second derivatives D_pp",
    "gauss_dkdkd_strong2": "second derivatives D_pp",
    "verlet_kdk_strong2": "second derivatives D_pp",
    "midpoint": "gradients of the Hamiltonians",
    "stormer_verlet": "gradients of the Hamiltonians",
    "gauss_dkdkd_midpoint": "gradients of the Hamiltonians",
    "gauss_dkdkd_rotation": "gradients of the Hamiltonians",
    "gauss2_strong32": "gradients of the Hamiltonians",
    "heun": "gradients of the Hamiltonians",
}


@pytest.mark.parametrize("scheme", REFUSED)
def test_schemes_that_take_more_than_flows_are_refused(scheme):
    """The sentence says what the flows lack and what to do."""
    with pytest.raises(ss.errors.IncompatibleError, match=rf"{REFUSED[scheme]}.*gauss_dkdkd"):
        ss.simulate(PYTHON, **{**RUN, "scheme": scheme})


def test_results_that_take_derivatives_are_refused():
    """Gradients, Hessians, brackets and derivatives of steps are not there, and it is said."""
    start = {"q0": Q0, "p0": P0}
    with pytest.raises(ss.errors.MissingOperationError, match="no gradient"):
        PYTHON.gradient(Q0, P0)
    with pytest.raises(ss.errors.MissingOperationError, match="no gradient"):
        PYTHON.hessian(Q0, P0)
    with pytest.raises(ss.errors.MissingOperationError, match="no gradient"):
        ss.commutator(PYTHON)
    with pytest.raises(ss.errors.MissingOperationError, match="Hessian"):
        ss.lyapunov(PYTHON, **RUN)
    with pytest.raises(ss.errors.IncompatibleError, match="gradient"):
        ss.advise(PYTHON, **start, horizon=1.0, tolerance=0.05)
    with pytest.raises(ss.errors.MissingOperationError, match="no gradient"):
        ss.Model(ndof=1, nnoise=0, drift=fast_drift, kick=bent_kick, split=np.eye(2)).probe()


@pytest.mark.parametrize(
    "options, words",
    [({"compensated": True}, "no increments"), ({"general": True}, "general"), ({"fixed_point": 3}, "iterate nothing")],
)
def test_options_that_steps_of_flows_do_not_have_are_refused(options, words):
    """Each sentence names the option."""
    with pytest.raises(ss.errors.IncompatibleError, match=f"drift and kick.*{words}"):
        ss.simulate(PYTHON, **RUN, **options)


def test_open_systems_are_refused():
    """Flows are those of a closed system; forces do not commute with kicks, and a bath takes a mass."""
    with pytest.raises(ss.errors.IncompatibleError, match="is damped, and its flows drift and kick"):
        ss.simulate(PYTHON.damped(0.3), **RUN)
    with pytest.raises(ss.errors.IncompatibleError, match="a system without forces"):
        ss.simulate(PYTHON.forced(lambda q, p, t: -q, position_force=True), **RUN)
    with pytest.raises(ss.errors.IncompatibleError, match="kinetic energy"):
        ss.thermostat(PYTHON, beta=1.0, gamma=1.0)


def test_beside_a_gradient_other_schemes_run_and_the_flows_come_first():
    """With a gradient and its traits the library compares the steps of the flows with its own before a run."""
    model = pendulum(gradient=gradient, identity_mass=True, position_noise=True, separable=True)
    options = {**RUN, "q0": 0.5, "p0": 0.3, "paths": 5}
    mine = ss.simulate(model, **options)
    assert mine.report.stepper == "kicks and drifts by the model's own flows"
    plain = ss.Model(ndof=1, nnoise=1, gradient=gradient, identity_mass=True, position_noise=True, separable=True)
    assert abs(mine.q - ss.simulate(plain, **options).q).max() < 1e-14
    for scheme in ("verlet_kdk", "gauss_dkdkd_strong2", "stormer_verlet"):
        taken = {**options, "scheme": scheme}
        assert np.array_equal(ss.simulate(model, **taken).q, ss.simulate(plain, **taken).q)
    for more in ({"compensated": True}, {"general": True}):
        assert np.array_equal(ss.simulate(model, **options, **more).q, ss.simulate(plain, **options, **more).q)
    damped = ss.simulate(model.damped(0.3), **options)
    assert np.array_equal(damped.q, ss.simulate(plain.damped(0.3), **options).q)


def test_silent_noises_and_none():
    """Without noise, or with silent ones beside a gradient, kicks have the weights b h alone."""
    bare = ss.Model(ndof=1, nnoise=0, drift=fast_drift, kick=lambda t, w, q, p: (q, p - w[0] * q**3))

    def slope(_t, w, q, p):
        return w[0] * q**3, w[0] * p / np.sqrt(1 + p * p)

    both = {"drift": fast_drift, "kick": lambda t, w, q, p: (q, p - w[0] * q**3), "gradient": slope}
    quiet = ss.Model(ndof=1, nnoise=1, silent=[1], **both)
    options = {**RUN, "q0": 0.5, "p0": 0.3, "paths": 2}
    assert np.array_equal(ss.simulate(quiet, **options).q, ss.simulate(bare, **options).q)


def test_declarations_that_nothing_can_test_are_refused():
    """Of a model without gradients; and one flow alone, and other functions without gradient."""
    flows = {"drift": fast_drift, "kick": bent_kick}
    with pytest.raises(ss.errors.IncompatibleError, match="declares separable, which nothing could test"):
        ss.Model(ndof=1, nnoise=2, separable=True, **flows)
    with pytest.raises(ss.errors.WrongTypeError, match="go together"):
        ss.Model(ndof=1, nnoise=2, drift=fast_drift)
    with pytest.raises(ss.errors.WrongTypeError, match="hessian without gradient"):
        ss.Model(ndof=1, nnoise=2, hessian=bent_kick, **flows)
    with pytest.raises(ss.errors.WrongTypeError, match=r"f\(t, tau, q, p\)"):
        ss.Model(ndof=1, nnoise=2, drift=lambda tau, q, p: (q, p), kick=bent_kick)
    with pytest.raises(ss.errors.IncompatibleError, match="beside drift and kick"):
        ss.Model(ndof=1, nnoise=2, flows={"gauss_dkdkd": None}, **flows)


def test_values_give_energies_and_exceptions_are_raised():
    """value needs no gradient; an exception of a flow ends the run and is raised again."""
    model = pendulum(value=lambda t, w, q, p: (w[0] * (p**2 / 2 + q**4 / 4) + 0.5 * w[1] * np.sin(q))[0])
    run = ss.simulate(model, **{**RUN, "q0": 0.5, "p0": 0.3})
    assert np.allclose(run.energy, run.p[:, 0] ** 2 / 2 + run.q[:, 0] ** 4 / 4, rtol=1e-14)
    calls = []

    def failing(t, tau, q, p):
        calls.append(t)
        if t > 0.5:
            raise ZeroDivisionError("at this time")
        return q + tau * p, p

    with pytest.raises(ZeroDivisionError, match="at this time"):
        ss.simulate(pendulum(drifts=failing), **{**RUN, "q0": 0.5, "p0": 0.3})
    with pytest.raises(ss.errors.WrongTypeError, match=r"drift\(\) returned ndarray"):
        ss.simulate(pendulum(drifts=lambda t, tau, q, p: q), **{**RUN, "q0": 0.5, "p0": 0.3})


def test_steps_are_symplectic():
    """The tangent map of one step, by differences of eighth order."""
    defect = ss.diagnose.symplecticity(PYTHON, "gauss_dkdkd", q=Q0, p=P0, step=0.1)
    assert defect.max() < 1e-10
