# SPDX-License-Identifier: BSD-3-Clause
"""Gradients of E f(path): equal to differences of runs with the same noise, with the same bits in any pieces."""

import numpy as np
import pytest
import symsde as ss
from symsde.errors import (
    IncompatibleError,
    InvalidArgumentError,
    MissingOperationError,
    PathsFailedWarning,
    UnknownNameError,
    WrongShapeError,
    WrongTypeError,
)
from symsde.native import abi, callbacks
from symsde.run import gradient as module

RUN = {"q0": 0.7, "p0": 0.3, "step": 0.1, "steps": 30, "paths": 20, "seed": 3}
STENCIL = ((1, 3 / 4), (2, -3 / 20), (3, 1 / 60))  #: a central difference of sixth order
SCHEMES = ("stormer_verlet", "symplectic_euler", "symplectic_euler_adjoint", "midpoint", "gauss2", "gauss3", "lobatto3")


def pendulum(**values):
    """A pendulum with two noises in position."""
    values = {"k": 1.3, "sigma": 0.4} | values
    return ss.model_from_sympy("p**2/2 - k*cos(q)", ["sigma*sin(q)", "-0.3*q"], params=values)


def mass(**values):
    """A model with a parameter of the kinetic energy, and noises in p, too: the Hessian has all blocks."""
    values = {"m": 1.2, "s": 0.3} | values
    return ss.model_from_sympy("p**4/(12*m) + p**2/(2*m) - cos(q)", ["s*p", "0.2*q**2"], params=values)


def mixed(**values):
    """A Hamiltonian and a noise that are not separable."""
    values = {"a": 0.4, "s": 0.2} | values
    return ss.model_from_sympy("p**2/2 + q**2/2 + a*q**2*p**2", ["s*q*p", "-0.3*q"], params=values)


def two(**values):
    """Two degrees of freedom with two noises."""
    values = {"alpha": 0.3, "sigma1": 0.1, "sigma2": 0.2} | values
    return ss.models.henon_heiles(**values)


def driven(**values):
    """Potential and noises depend on time."""
    return ss.models.driven_pendulum(**{"nu": 1.7, "alpha": 0.5} | values)


def f_of(model, f, run):
    """f of each path."""
    return ss.gradient(model, f, ["q0"], **run).f


def differences(make, f, name, run, size=3e-3):
    """Central differences of f of each path by a parameter, or by one of q0 and p0."""
    model, total = make(), 0
    for k, weight in STENCIL:
        sides = []
        for h in (k * size, -k * size):
            if name in ("q0", "p0"):
                sides.append(f_of(model, f, {**run, name: run[name] + h}))
            else:
                sides.append(f_of(make(**{name: model.parameters[name] + h}), f, run))
        total = total + weight * (sides[0] - sides[1]) / size
    return total


def require_gradient(make, f, names, **run):
    """All derivatives of each path are right to 1e-9 of the largest."""
    run = RUN | run
    found = ss.gradient(make(), f, [*names, "q0", "p0"], **run)
    for name in (*names, "q0", "p0"):
        right = differences(make, f, name, run)
        mine = found.by_path[name]
        mine = mine.sum(axis=0) if mine.ndim == 2 else mine  # q0 + h moves all degrees of freedom
        assert abs(mine - right).max() < 1e-9 * abs(right).max(), name
        assert abs(1.01 * mine - right).max() > 1e-4 * abs(right).max()
    return found


@pytest.mark.parametrize("scheme", SCHEMES)
def test_position_noise(scheme):
    """Steps of kicks around a drift, and with implicit stages; f holds a parameter itself."""
    found = require_gradient(pendulum, "q**2 + k*p", ["k", "sigma"], scheme=scheme)
    n = found.f.size
    for name, x in found.by_path.items():
        np.testing.assert_allclose(found.values[name], x.mean(axis=-1), rtol=1e-14)
        np.testing.assert_allclose(found.se[name], x.std(axis=-1, ddof=1) / n**0.5, rtol=1e-14)
    assert found.value == found.f.mean() and found.failed == 0 and "d/dk" in repr(found)


@pytest.mark.parametrize("scheme", ["stormer_verlet", "midpoint", "gauss2"])
@pytest.mark.parametrize(
    ("make", "names"), [(mass, ["m", "s"]), (two, ["alpha", "sigma2"]), (driven, ["omega", "nu", "sigma1"])]
)
def test_models(make, names, scheme):
    """Models with parameters of the mass, several degrees of freedom, or time; built-in models by their formulas."""
    require_gradient(make, "q_1**2 + sin(p_1)", names, scheme=scheme)


@pytest.mark.parametrize("scheme", ["midpoint", "gauss2", "stormer_verlet", "lobatto3"])
def test_not_separable(scheme):
    """All blocks of the Hessian contribute."""
    require_gradient(mixed, "q*p + q**3", ["a", "s"], scheme=scheme, steps=10)


def coupled(**values):
    """Two masses that are coupled, and noises of which two meet and two do not."""
    values = {"a": 0.3, "s": 0.4} | values
    h = "p1**2/2 + p2**2/3 + 0.3*p1*p2 + q1**2/2 + q2**2 + a*q1**2*q2*sin(1 + t)"
    return ss.model_from_sympy(h, ["s*sin(q1)", "0.2*q2**2 + 0.1*s*q1*q2", "0.2*cos(q2)*a"], params=values)


@pytest.mark.parametrize("scheme", ["chin4a", "verlet_kdk", "gauss_dkdkd_strong2", "chin4a_strong2"])
def test_products_of_gradients(scheme):
    """Kicks add products of gradients, whose derivatives hold third ones."""
    require_gradient(coupled, "q_1**2 + sin(p_2)", ["a", "s"], scheme=scheme, steps=10)
    require_tangent(coupled(), ["a", "s"], scheme=scheme, steps=10)
    defects = [ss.tangent(m, **RUN, scheme=scheme).defect().max() for m in (coupled(), ss.models.henon_heiles())]
    assert max(defects) < 1e-13


@pytest.mark.parametrize("scheme", ["gauss_dkdkd", "verlet_kdk", "chin4a", "gauss_dkdkd_strong2"])
def test_kicks_between_drifts_that_decay(scheme):
    """Momenta decay in drifts, and weights of noises change with the rate."""
    for make, name in ((pendulum, "sigma"), (coupled, "a")):
        require_gradient(lambda **x: make(**x).damped(0.5), "q_1**2 + p_1", [name], scheme=scheme, steps=10)  # noqa: B023
        maps = ss.tangent(make().damped(0.5), **RUN | {"scheme": scheme, "steps": 10})
        assert maps.defect(np.exp(-0.5 * 10 * RUN["step"])).max() < 1e-13
    for damping, told in (([0.5, 0.2], "decay by several rates"), ([[0.5, 0.1], [0.1, 0.5]], "matrix of friction")):
        with pytest.raises(IncompatibleError, match=told):
            ss.gradient(coupled().damped(damping), "q_1", **RUN, scheme=scheme)


def test_damped_drifts_without_derivatives():
    """Rational functions of rates, and noise of damping by "path" or another scheme's "law3", are refused."""
    model = pendulum().damped(0.5)
    for options, words in (
        ({"scheme": "gjf"}, "gjf multiplies momenta by rational functions"),
        ({"scheme": "gauss_dkdkd", "damping_noise": "law3"}, 'gauss_dkdkd takes damping_noise "law", "law2"'),
        ({"scheme": "chin4a", "damping_noise": "path"}, 'chin4a takes damping_noise "law", "law2"'),
    ):
        run = RUN | options
        for call in (
            lambda: ss.gradient(model, "q", ["q0"], **run),  # noqa: B023
            lambda: ss.tangent(model, **run),  # noqa: B023
            lambda: ss.lyapunov(model, **run),  # noqa: B023
        ):
            with pytest.raises(IncompatibleError, match=words):
                call()
    taken = (("gauss_dkdkd", "law"), ("verlet_kdk", "law2"), ("gauss_dkdkd", "polynomial"), ("chin4a", "law3"))
    for scheme, noise in taken:
        run = RUN | {"scheme": scheme, "damping_noise": noise}
        require_gradient(lambda **x: pendulum(**x).damped(0.5), "q**2", ["sigma"], **run)
    require_gradient(pendulum, "q**2", ["sigma"], scheme="gjf")


@pytest.mark.parametrize("scheme", ["midpoint", "gauss2", "stormer_verlet"])
def test_damped(scheme):
    """Damped momenta, whose decays differ between stages."""
    require_gradient(lambda **x: pendulum(**x).damped(0.5), "q**2", ["k", "sigma"], scheme=scheme)


def spring(**values):
    """A stiffening spring, whose steps have one solution however strong damping is."""
    return ss.model_from_sympy("p**2/2 + k*q**2/2 + q**4/4", ["s*sin(q)"], params={"k": 1.3, "s": 0.4} | values)


@pytest.mark.filterwarnings("ignore:gamma.h = ")
@pytest.mark.parametrize("z", [6.8, 7.0, 20.0, 60.0])
@pytest.mark.parametrize("scheme", ["midpoint", "gauss2"])
@pytest.mark.parametrize("make", [spring, mixed])
def test_strong_damping(make, scheme, z):
    """Where gamma h = z is large, p behind a step holds no digit of the forces in it."""
    run, damped = RUN | {"scheme": scheme, "steps": 5}, lambda **x: make(**x).damped(z / RUN["step"])
    right = differences(damped, "q", "s", run)
    found = ss.gradient(damped(), "q", ["s"], **run).by_path["s"]
    assert abs(found - right).max() < 1e-11 * abs(right).max()
    if z <= 20:
        maps = ss.tangent(damped(), ["s"], **run)
        assert abs(maps.by["s"][0] - right).max() < 1e-11 * abs(right).max()


@pytest.mark.optimised
@pytest.mark.parametrize(("paths", "options"), [(1, {}), (3, {"refine": 2}), (3, {"refine": -1}), (300, {"lanes": 8})])
def test_runs(paths, options):
    """Single paths, refined noise and blocks of eight lanes."""
    require_gradient(pendulum, "q**2", ["k"], scheme="stormer_verlet", **RUN | {"paths": paths} | options)


def test_prescribed_increments():
    """Increments are prescribed, also in a run that is cut into pieces."""
    dw = 0.1 * np.cos(np.arange(2 * 1500 * 3.0)).reshape(1500, 2, 3)
    run = {"q0": 0.7, "p0": 0.3, "step": 0.01, "scheme": "stormer_verlet", "paths": 3}
    whole = ss.gradient(pendulum(), "q", ["k"], **run, steps=500, increments=dw[:500])
    right = differences(pendulum, "q", "k", run | {"steps": 500, "increments": dw[:500]})
    np.testing.assert_allclose(whole.by_path["k"], right, rtol=1e-9)
    wide = ss.gradient(pendulum(), "q", ["k"], **run, steps=1500, increments=dw, lanes=4096)
    narrow = ss.gradient(pendulum(), "q", ["k"], **run, steps=1500, increments=dw)
    assert np.array_equal(wide.by_path["k"], narrow.by_path["k"])


def squares(t, q, p):
    """A running cost."""
    return (q**2).sum(axis=(0, 1)) + p[-1, 0] * t[-1]


def slopes(t, q, p):
    """The derivatives of the running cost."""
    fp = np.zeros_like(p)
    fp[-1, 0] = t[-1]
    return 2 * q, fp


@pytest.mark.parametrize("scheme", ["stormer_verlet", "midpoint", "gauss2"])
@pytest.mark.parametrize("every", [1, 10, 30])
def test_functions_of_the_path(scheme, every):
    """f and its derivative are given as functions, at several saved times."""
    require_gradient(pendulum, (squares, slopes), ["k", "sigma"], scheme=scheme, save_every=every)


def test_functions_that_hold_parameters():
    """Derivatives of f by parameters are given in the order of wrt, beside arrays that go by path."""
    model = pendulum(sigma=np.linspace(0.1, 0.5, 20))

    def df(t, q, p):
        fp = np.zeros_like(p)
        fp[-1] = 1.3
        return np.zeros_like(q), fp, p[-1]

    mine = ss.gradient(model, (lambda t, q, p: 1.3 * p[-1, 0], df), ["k"], **RUN, scheme="midpoint")
    theirs = ss.gradient(model, "k*p", ["k"], **RUN, scheme="midpoint")
    assert np.array_equal(mine.by_path["k"], theirs.by_path["k"]) and (mine.by_path["k"] != 0).all()


@pytest.mark.optimised
@pytest.mark.parametrize("scheme", ["stormer_verlet", "midpoint"])
@pytest.mark.parametrize(("steps", "every"), [(2000, 2000), (1999, 1999), (2000, 1000), (2000, 10), (2000, 400)])
def test_pieces(scheme, steps, every):
    """Whether a run is kept as a whole or in pieces changes no bit, nor do other lanes and threads."""
    run = RUN | {"steps": steps, "step": 0.01, "paths": 300, "save_every": every, "scheme": scheme}
    names = ["k", "sigma", "q0", "p0"]
    pieces = ss.gradient(pendulum(), (squares, slopes), names, **run)
    whole = ss.gradient(pendulum(), (squares, slopes), names, **run, lanes=8, threads=2)
    assert all(np.array_equal(pieces.by_path[name], whole.by_path[name]) for name in names)
    assert np.array_equal(pieces.f, whole.f)
    part = ss.gradient(pendulum(), (squares, slopes), names, **run | {"paths": 44, "first_path": 256})
    assert all(np.array_equal(part.by_path[name], whole.by_path[name][..., 256:]) for name in names)


@pytest.mark.optimised
def test_groups(monkeypatch):
    """Groups of paths, whose states are held at once, change no bit."""
    start = np.linspace(0.1, 0.9, 600)[np.newaxis]
    run = RUN | {"paths": 600, "q0": start, "scheme": "stormer_verlet"}
    model = pendulum(sigma=np.linspace(0.1, 0.5, 600))
    whole = ss.gradient(model, "q**2", ["k", "sigma", "q0"], **run)
    monkeypatch.setattr(module, "_NUMBERS", 1)
    groups = ss.gradient(model, "q**2", ["k", "sigma", "q0"], **run)
    assert all(np.array_equal(groups.by_path[name], x) for name, x in whole.by_path.items())


@pytest.mark.optimised
def test_parameters_by_path():
    """Path i with its value has the derivatives of path i alone with that number."""
    sigma = np.linspace(0.1, 0.5, 20)
    for scheme in ("stormer_verlet", "gauss2"):
        found = ss.gradient(pendulum(sigma=sigma), "q**2", ["k", "sigma"], **RUN, scheme=scheme)
        for i in (0, 7, 19):
            one = ss.gradient(
                pendulum(sigma=sigma[i]), "q**2", ["k", "sigma"], **RUN | {"paths": 1}, scheme=scheme, first_path=i
            )
            for name in ("k", "sigma"):
                np.testing.assert_allclose(found.by_path[name][i], one.by_path[name][0], rtol=1e-11)


def test_kubo_exact():
    """Kubo's oscillator turns by a t + sigma W: dq/da = -t p on each path, to the order of the scheme."""
    run = {"q0": 1.0, "p0": 0.0, "step": 0.01, "steps": 100, "paths": 50, "scheme": "gauss3"}
    found = ss.gradient(ss.models.kubo(), "q", ["a", "sigma"], **run)
    driven = ss.simulate(ss.models.kubo(), **run)
    w = ss.diagnose.driving_increments(driven).sum(axis=(0, 1))
    np.testing.assert_allclose(found.by_path["a"], driven.p[-1, 0], rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(found.by_path["sigma"], w * driven.p[-1, 0], rtol=1e-6, atol=1e-8)


def test_own_model():
    """A model of functions has derivatives by its initial state, if it has a Hessian."""
    own = {"ndof": 1, "nnoise": 1, "gradient": lambda t, w, q, p: (w[0] * q**3 + w[1] * q, w[0] * p)}

    def hessian(t, w, q, p):
        return (3 * w[0] * q**2 + w[1])[np.newaxis], 0 * q[np.newaxis], (w[0] + 0 * q)[np.newaxis]

    model = ss.Model(**own, hessian=hessian, name="own", identity_mass=True, separable=True, position_noise=True)
    formulas = ss.model_from_sympy("p**2/2 + q**4/4", ["q**2/2"])
    for scheme in ("stormer_verlet", "midpoint", "gauss2"):
        mine, theirs = (ss.gradient(x, "q*p", **RUN, scheme=scheme) for x in (model, formulas))
        for name in ("q0", "p0"):
            np.testing.assert_allclose(mine.by_path[name], theirs.by_path[name], rtol=1e-9)
    with pytest.raises(IncompatibleError, match="products of gradients to its kicks, and model own has no third"):
        ss.gradient(model, "q", **RUN, scheme="chin4a")
    with pytest.raises(MissingOperationError, match="no Hessian"):
        ss.gradient(ss.Model(**own), "q", **RUN)
    with pytest.raises(IncompatibleError, match="has none: make it by model_from_sympy"):
        ss.gradient(ss.models.fpu_chain(4), "q_1", ["beta"], **RUN)


@pytest.mark.parametrize(
    ("scheme", "why"),
    [
        ("gauss2_strong32", "brackets"),
        ("euler_maruyama", "Ito form"),
        ("verlet_dz", "frame"),
    ],
)
def test_refused_schemes(scheme, why):
    """Schemes without exact derivatives are refused with the reason."""
    model = ss.models.linear_oscillator() if scheme == "verlet_dz" else pendulum()
    with pytest.raises(IncompatibleError, match=why):
        ss.gradient(model, "q", **RUN, scheme=scheme)


def rubbed(damping="g*(1 + k)", force=None, **values):
    """A pendulum with rates of damping that depend on parameters."""
    params = {"k": 1.3, "g": 0.4, "s": 0.5} | values
    return ss.model_from_sympy("p**2/2 - k*cos(q)", ["s*sin(q)"], params=params, damping=damping, force=force)


def rubbed_pair(**values):
    """Two degrees of freedom with a rate each, and a Hamiltonian that is not separable."""
    params = {"a": 0.3, "s": 0.2, "g": 0.3} | values
    h = "p1**2/2 + p2**2/2 + q1**2/2 + q2**2 + a*q1*p2 + q1**2*q2"
    return ss.model_from_sympy(h, ["s*q1*p1", "0.3*q2"], params=params, damping=["g", "2*g + a"])


def require_tangent(model, names, **run):
    """Tangent maps have the derivatives of gradients."""
    maps, found = ss.tangent(model, names, **RUN | run), ss.gradient(model, "q_1**2", names, **RUN | run)
    for name in names:
        np.testing.assert_allclose(2 * maps.q[0] * maps.by[name][0], found.by_path[name], rtol=1e-8, atol=1e-10)


@pytest.mark.parametrize("scheme", [*SCHEMES[3:], "stormer_verlet", "P2N2Q2Lob", "lobatto2_swapped"])
def test_rates_of_damping(scheme):
    """Derivatives by parameters that rates of damping depend on."""
    require_gradient(rubbed, "q**2 + p", ["k", "g", "s"], scheme=scheme)
    require_gradient(rubbed_pair, "q_1*p_2", ["a", "g"], scheme=scheme, steps=10)
    for model in (rubbed(), rubbed_pair()):
        require_tangent(model, ["g"], scheme=scheme, steps=10)


def test_friction_that_becomes_damping():
    """A force -g p is damping, but for g = 0; a rate of zero has the derivative of rates nearby."""
    made = {"damping": None, "force": ["-g*p"]}
    for scheme in ("midpoint", "stormer_verlet"):
        require_gradient(lambda **x: rubbed(**made, **x), "q**2", ["g", "k"], scheme=scheme)
        at, near = (ss.gradient(rubbed(g=g), "q**2", ["g"], **RUN, scheme=scheme).by_path["g"] for g in (0.0, 1e-8))
        np.testing.assert_allclose(at, near, rtol=1e-6)
        with pytest.raises(IncompatibleError, match=r"traits at g = 0 \(friction\) that it loses"):
            ss.gradient(rubbed(**made, g=0.0), "q**2", ["g"], **RUN, scheme=scheme)


@pytest.mark.filterwarnings("ignore::symsde.errors.OwnNoiseWarning")
def test_baths():
    """Rates that belong to noises and masses change with them; noises that the bath brings change with masses."""

    def heavy(gamma=None, **values):
        params = {"k": 1.3, "m": 1.5, "s": 0.5} | values
        model = ss.model_from_sympy("p**2/(2*m) - k*cos(q)", ["s*m*q"], params=params)
        return ss.thermostat(model, beta=1.0, gamma=gamma)

    def pair(**values):
        params = {"k": 1.3, "s": 0.5} | values
        h = "p1**2/2 + p2**2/2 - k*cos(q1) + q2**2/2 + q1**2*q2**2/4"
        return ss.thermostat(ss.model_from_sympy(h, ["s*sin(q1)"], params=params), beta=2.0, gamma=[0.2, 0.5])

    for scheme in ("midpoint", "stormer_verlet"):
        require_gradient(heavy, "q**2", ["k", "s", "m"], scheme=scheme)
        require_gradient(lambda **x: heavy(0.3, **x), "q**2", ["k", "s"], scheme=scheme)
        require_gradient(pair, "q_1*p_2", ["k", "s"], scheme=scheme, steps=10)
    for call in (ss.tangent, lambda model, names, **run: ss.gradient(model, "q", names, **run)):
        with pytest.raises(IncompatibleError, match="the noises of the bath of model formula would change with m"):
            call(heavy(0.3), ["m"], **RUN)


def drag(**values):
    """A pendulum with a force of drag, and noise forces."""
    params = {"k": 1.3, "s": 0.4, "g": 0.5} | values
    forces = {"force": "-g*p**3 + 0.2*q*k", "noise_force": ["0", "g*cos(q) + 0.1*p"]}
    return ss.model_from_sympy("p**2/2 - k*cos(q)", ["s*sin(q)", "0"], params=params, **forces)


def whirl(**values):
    """Two degrees of freedom whose forces are no gradients."""
    params = {"k": 0.3, "s": 0.4, "g": 0.5} | values
    h = "p1**2/2 + p2**2/2 + k*q1**2*q2 + q1**4/4 + q2**4/4"
    return ss.model_from_sympy(h, ["s*q1*q2"], params=params, force=["g*q2 - g*p1*p2", "-0.4*q1*p1"], damping=0.2)


@pytest.mark.parametrize("scheme", ["midpoint", "stormer_verlet", "gauss2", "lobatto3", "P2N2Q2Lob"])
def test_forces(scheme):
    """Forces and noise forces, by formulas and by parameters in them."""
    require_gradient(drag, "q**2 + p", ["k", "s", "g"], scheme=scheme, steps=10)
    require_gradient(whirl, "q_1*p_2", ["k", "s", "g"], scheme=scheme, steps=10)
    for model in (drag(), whirl()):
        require_tangent(model, ["g", "k"], scheme=scheme, steps=10)


def _compiled_drag():
    """The force -p^3 and its derivatives, as compiled functions have them."""

    def made(kind, terms):
        def called(n, ndof, nham, _t, w, _q, p, *out):
            weights, momenta = view(w, (nham, n)), view(p, (ndof, n))
            for address, x in zip(out, terms(weights, momenta), strict=False):
                view(address, x.shape)[...] = x
            return 0

        return abi.CALLBACKS[kind](called)

    view = callbacks.view.__wrapped__
    return {
        "force": made("force", lambda w, p: [-w[:1] * p**3]),
        "force_derivative": made("force_derivative", lambda w, p: [0 * p[np.newaxis], -3 * w[0] * p[np.newaxis] ** 2]),
    }


def test_forces_that_are_functions():
    """Forces given as functions have derivatives by the state if they give theirs."""
    slopes = {"force_derivative": lambda q, p, t: (0 * q[np.newaxis], -3 * p[np.newaxis] ** 2)}
    forces = {"force": lambda q, p, t: -(p**3), **slopes}
    forced = pendulum().forced(**forces)
    formulas = ss.model_from_sympy("p**2/2 - 1.3*cos(q)", ["0.4*sin(q)", "-0.3*q"], force="-p**3")
    mine, theirs = (ss.gradient(x, "q*p", **RUN, scheme="midpoint") for x in (forced, formulas))
    for name in ("q0", "p0"):
        np.testing.assert_allclose(mine.by_path[name], theirs.by_path[name], rtol=1e-9)
    compiled = _compiled_drag()
    for scheme in ("midpoint", "stormer_verlet"):
        run = {"scheme": scheme, "steps": 10}
        require_gradient(lambda **x: pendulum(**x).forced(**forces), "q*p", ["k", "sigma"], **run)
        mine, theirs = (
            ss.gradient(pendulum().forced(**x), "q*p", ["k"], **RUN, scheme=scheme) for x in (forces, compiled)
        )
        np.testing.assert_allclose(mine.by_path["k"], theirs.by_path["k"], rtol=1e-12)
    pushed = ss.model_from_sympy("p**2/2 - 1.3*cos(q)", ["0.4*sin(q)"], force="-0.2*q")
    with pytest.raises(IncompatibleError, match="forces act between the drifts"):
        ss.gradient(pushed, "q", **RUN, scheme="gauss_dkdkd")


def test_refused_inputs():
    """Bad input is refused with a sentence."""
    run = RUN | {"scheme": "stormer_verlet"}
    for wrt, error, words in (
        (["kk"], UnknownNameError, "there are k, sigma"),
        ([], InvalidArgumentError, "wrt is empty"),
        (["k", "k"], InvalidArgumentError, "twice"),
    ):
        with pytest.raises(error, match=words):
            ss.gradient(pendulum(), "q", wrt, **run)
    for f, error, words in (
        (squares, WrongTypeError, "has no derivative"),
        ((squares, 3), WrongTypeError, "has no derivative"),
        ("q**", InvalidArgumentError, "f: the formula"),
        ("z", InvalidArgumentError, "z"),
        ((squares, lambda t, q, p: q), WrongTypeError, "no pair"),
        ((squares, lambda t, q, p: (q[0], p)), WrongShapeError, "fq has shape"),
        ((lambda t, q, p: q.sum(), slopes), WrongShapeError, "f has shape"),
    ):
        with pytest.raises(error, match=words):
            ss.gradient(pendulum(), f, **run)
    with pytest.raises(IncompatibleError, match="compensated"):
        ss.gradient(pendulum(), "q", **run, compensated=True)
    with pytest.raises(IncompatibleError, match="iterations"):
        ss.gradient(pendulum(), "q", **RUN, scheme="midpoint", fixed_point=2)
    for damping, words in (([[0.5]], "matrix of friction"), (lambda q: 0.1 + q**2, "are functions")):
        for scheme in ("midpoint", "gauss_dkdkd"):
            with pytest.raises(IncompatibleError, match=f"{words}; give rates of the momenta as numbers"):
                ss.gradient(pendulum().damped(damping), "q", **RUN, scheme=scheme)
    forced = pendulum().forced(force=lambda q, p, t: -p)
    with pytest.raises(IncompatibleError, match=r"forces of model .* have no derivatives"):
        ss.gradient(forced, "q", **RUN, scheme="midpoint")


def test_special_values():
    """Where a parameter is 0 or 1, formulas are simpler than beside it: the derivative is right, or refused."""
    require_gradient(mass, "q", ["m"], scheme="stormer_verlet", steps=5)
    for scheme in ("stormer_verlet", "midpoint"):
        one = lambda **x: ss.model_from_sympy(  # noqa: E731
            "p**2/(2*m) - cos(q)", ["s*sin(q)"], params={"m": 1.0, "s": 0.3} | x
        )
        require_gradient(one, "q", ["m", "s"], scheme=scheme)
    silent = pendulum(sigma=0.0)
    with pytest.raises(IncompatibleError, match=r"traits at sigma = 0 \(\w+\) that it loses"):
        ss.gradient(silent, "q", ["sigma"], **RUN)
    ss.gradient(silent, "q", ["k"], **RUN)
    turned = ss.model_from_sympy("p**2/2 + q**2/2 + a*q**2*p**2", ["-0.3*q"], params={"a": 0.0})
    with pytest.raises(IncompatibleError, match="give a value nearby"):
        ss.gradient(turned, "q", ["a"], **RUN, scheme="stormer_verlet")
    with pytest.raises(IncompatibleError, match=r"nearby|not drawn"):
        ss.gradient(ss.models.linear_oscillator(sigma=0.0), "q", ["sigma"], **RUN)


@pytest.mark.parametrize("scheme", ["gauss_dkdkd", "verlet_dkd_weak2"])
@pytest.mark.parametrize(("make", "names"), [(pendulum, ["k", "sigma"]), (driven, ["omega", "nu"]), (two, ["alpha"])])
def test_kicks(make, names, scheme):
    """Drifts and kicks with dZ, at their own times."""
    require_gradient(make, "q_1**2 + p_1", names, scheme=scheme)


def test_kicks_of_a_heavy_mass():
    """M^-1 by the model."""
    heavy = lambda **x: ss.model_from_sympy(  # noqa: E731
        "p1**2/3 + p2**2/5 + k*cos(q1 - q2) + q1**2/2", ["s*sin(q1)", "0.3*q2"], params={"k": 1.3, "s": 0.3} | x
    )
    require_gradient(heavy, "q_1*p_2", ["k", "s"], scheme="gauss_dkdkd")
    with pytest.raises(IncompatibleError, match="kinetic energy"):
        ss.gradient(
            ss.model_from_sympy("p**2/(2*m) + q**4", ["0.3*q"], params={"m": 1.3}),
            "q",
            ["m"],
            **RUN,
            scheme="gauss_dkdkd",
        )


def test_growing_paths(monkeypatch):
    """Paths that grow beyond all bounds are warned of and counted, in groups of any size."""
    model = ss.model_from_sympy("p**2/2 + k*q**2/2", noise=["0.1*q"], params={"k": 1e4})
    options = {"q0": 1.0, "p0": 0.0, "step": 0.1, "steps": 50, "scheme": "stormer_verlet", "paths": 600}
    for numbers in (2**23, 1):
        monkeypatch.setattr(module, "_NUMBERS", numbers)
        with pytest.warns(ss.errors.DoubtfulRunWarning, match="600 paths grew 1e6-fold"):
            assert ss.gradient(model, "q", ["k"], **options).report.grown == 600


def test_failed_paths():
    """Failed paths are refused, or left out on request, with their share."""
    start = np.where(np.arange(20) % 4 == 0, 60.0, 0.5)[np.newaxis]
    model = ss.model_from_sympy("p**2/2 + q**4/4", ["0.1*q"])
    run = RUN | {"q0": start, "steps": 60, "scheme": "stormer_verlet"}
    with pytest.raises(IncompatibleError, match=r"0\.25 of the paths failed"):
        ss.gradient(model, "q", **run)
    with pytest.warns(PathsFailedWarning, match="left out"):
        found = ss.gradient(model, "q", **run, allow_failed=True)
    assert found.failed == 0.25 and np.isnan(found.by_path["q0"][0, ::4]).all()
    ok = ss.gradient(model, "q", **run | {"q0": 0.5})
    assert np.array_equal(found.by_path["q0"][:, 1::4], ok.by_path["q0"][:, 1::4])
