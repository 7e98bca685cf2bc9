# SPDX-License-Identifier: BSD-3-Clause
"""Heat baths: noises and masses, exact stationary laws of a harmonic oscillator, laws of ensembles, refusals."""

import copy
import pickle
import warnings

import numpy as np
import pytest
import symsde as ss
from symsde.batch import scene
from symsde.errors import IncompatibleError, InvalidArgumentError, OwnNoiseWarning, SceneError, WrongShapeError
from symsde.model import thermostat

pytestmark = pytest.mark.usefixtures("quick_compiler")

RATE = 0.8
#: H = p^2/2 + q^2/2, whose mean of q^2 and p^2 is 1/beta
OSCILLATOR = ss.model_from_sympy("p**2/2 + q**2/2")
FREE = ss.model_from_sympy("p**2/2")
#: <q^2>, <q p>, <p^2> of the oscillator at gamma = beta = 1, h = 1/2: solutions of S = M S M^T + Q in closed form
HARMONIC = {
    "verlet_kdk": (1.0221002310236824, -0.0221002310236824, 0.9600306707450751),
    "gauss_dkdkd": (1.0057668918470486, -0.000271503399757, 1.011855939830468),
    "chin4a": (0.9997965958401762, 0.000183864866367, 0.9994036074421323),
}


def linear_step(model, scheme, step, columns):
    """One step of a linear model of one degree of freedom with one noise: the matrix of (q, p), and the coefficients of
    the normal numbers of dW, a = dZ/h - dW/2 and K (the first `columns` of these)."""
    variance = np.array([step, step / 12, step / 720])
    given = np.zeros((1, columns, 2 + columns))  # each of (q, p), dW, a, K is one on a path of its own
    given[0, :, 2:] = np.diag(np.sqrt(variance[:columns]))
    if columns > 1:
        given[0, 1] = step * (given[0, 1] + given[0, 0] / 2)
    q0, p0 = np.eye(2, 2 + columns)
    run = ss.simulate(model, q0=q0[np.newaxis], p0=p0[np.newaxis], paths=2 + columns, step=step, steps=1, scheme=scheme,
                      increments=given)  # fmt: skip
    found = np.array([run.q[1, 0], run.p[1, 0]])
    return found[:, :2], found[:, 2:]


def stationary(model, scheme, step, columns=1):
    """The stationary second moments <q^2>, <q p>, <p^2> of a scheme on a linear model: S = M S M^T + Q."""
    m, noise = linear_step(model, scheme, step, columns)
    s = np.linalg.solve(np.eye(4) - np.kron(m, m), (noise @ noise.T).ravel())
    return s[0], s[1], s[3]


@pytest.mark.parametrize("scheme", HARMONIC)
def test_harmonic_laws(scheme):
    """Moments of the scheme in the bath are exact; an error of 1 % in gamma or beta is seen."""
    columns = 3 if scheme == "chin4a" else 2
    found = stationary(ss.thermostat(OSCILLATOR, beta=1.0, gamma=1.0), scheme, 0.5, columns)
    np.testing.assert_allclose(found, HARMONIC[scheme], rtol=0, atol=2e-14)
    half = stationary(ss.thermostat(OSCILLATOR, beta=2.0, gamma=1.0), scheme, 0.5, columns)
    np.testing.assert_allclose(half, np.array(HARMONIC[scheme]) / 2, rtol=0, atol=2e-14)
    for wrong in ({"beta": 1.01, "gamma": 1.0}, {"beta": 1.0, "gamma": 1.01}):
        other = stationary(ss.thermostat(OSCILLATOR, **wrong), scheme, 0.5, columns)
        assert np.abs(np.subtract(other, found)).max() > 1e-6


@pytest.mark.parametrize("scheme", HARMONIC)
@pytest.mark.parametrize("z", [1e-6, 0.3, 4.0, 20.0])
def test_free_particles_have_the_temperature(scheme, z):
    """One step maps <p^2> = m/beta to itself, for every gamma h, with a mass, too."""
    step, mass, beta = 0.5, 3.0, 0.7
    model = ss.thermostat(ss.model_from_sympy("p**2/(2*m)", params={"m": mass}), beta=beta, gamma=z / step)
    m, noise = linear_step(model, scheme, step, 3 if scheme == "chin4a" else 2)
    assert abs(m[1, 1] - np.exp(-z)) < 1e-15
    assert abs(m[1, 1] ** 2 * mass / beta + (noise[1] ** 2).sum() - mass / beta) < 1e-13


def test_noises():
    """The noises have sigma_i^2 = 2 gamma_i m_i/beta_i, and follow the noises of the model; for built-in models,
    formulas and functions.
    """
    masses = ss.model_from_sympy("p1**2/2 + p2**2/6 + cos(q1 - q2)", noise=["s*q1"], params={"s": 0.0})
    bath = ss.thermostat(masses, beta=2.0, gamma=[0.5, 0.0])
    assert (bath.nnoise, bath.damping, bath.traits.silent) == (3, (0.5, 0.0), (1, 3))
    bath = ss.thermostat(masses, beta=[2.0, 4.0], gamma=0.5)

    def gradient(t, w, q, p):
        return w[0] * np.sin(q), w[0] * p / 3.0

    own = ss.Model(ndof=1, nnoise=0, gradient=gradient, separable=True, constant_mass=True)
    cases = [
        (bath, 1, [np.sqrt(2 * 0.5 / 2), np.sqrt(2 * 0.5 * 3 / 4)]),
        (ss.thermostat(own, beta=2.0, gamma=0.25), 0, [np.sqrt(2 * 0.25 * 3 / 2)]),
        (ss.thermostat(ss.models.kubo(a=4.0, sigma=0.0), beta=1.0, gamma=0.5), 1, [np.sqrt(2 * 0.5 / 4)]),
        (ss.thermostat(ss.models.pendulum(sigma=0.0), beta=1.0, gamma=0.5), 1, [1.0]),
        (ss.thermostat(ss.models.additive_oscillator(0.0, 0.0), beta=1.0, gamma=0.5), 2, [1.0]),
        (ss.thermostat(ss.models.henon_heiles(1.0, 0.0, 0.0), beta=2.0, gamma=[1.0, 4.0]), 2, [1.0, 2.0]),
        (ss.thermostat(ss.models.fpu_chain(n=3, sigma=0.0), beta=2.0, gamma=1.0), 3, [1.0] * 3),
    ]
    for model, before, sigma in cases:
        model.probe()
        assert model.nnoise == before + model.ndof
        q = 0.3 + 0.1 * np.arange(model.ndof)
        for i, expected in enumerate(sigma):
            w = np.eye(model.nnoise + 1)[before + 1 + i]
            hq, hp = model.gradient(q, 0.7, w)
            np.testing.assert_allclose(hq[:, 0], -expected * np.eye(model.ndof)[i], rtol=1e-14, atol=1e-15)
            np.testing.assert_array_equal(hp, 0.0)
            if model.traits.has_value:
                np.testing.assert_allclose(model.value(q, 0.7, w), -expected * q[i], rtol=1e-14)


@pytest.mark.optimised
@pytest.mark.parametrize(
    "scheme", ["midpoint", "symplectic_euler", "gauss2", "stormer_verlet", "gauss_dkdkd", "chin4a"]
)
def test_a_bath_is_noise_and_damping(scheme):
    """A bath equals noise and damping written by hand; a path has the same bits alone and in a block; copies agree."""
    sums = "Sum(p[i]**2/2, i) + Sum((q[i+1]-q[i])**2/2 + (q[i+1]-q[i])**4/4, i)"
    chain = ss.models.fpu_chain(n=5, sigma=0.0)
    pairs = [
        (chain, ss.models.fpu_chain(n=5, sigma=np.sqrt(2 * RATE))),
        (ss.model_from_sympy(sums, n=5, ends="fixed"), ss.models.fpu_chain(n=5, sigma=np.sqrt(2 * RATE))),
        (
            ss.model_from_sympy("p**2/6 + q**4/4"),
            ss.model_from_sympy("p**2/6 + q**4/4", noise=["-s*q"], params={"s": np.sqrt(6 * RATE)}),
        ),
        (ss.models.linear_oscillator(sigma=0.0), ss.models.linear_oscillator(sigma=np.sqrt(2 * RATE))),
        (ss.models.henon_heiles(0.1, 0.0, 0.0), ss.models.henon_heiles(0.1, -np.sqrt(2 * RATE), -np.sqrt(2 * RATE))),
    ]
    given = {"q0": 0.1, "p0": 0.3, "step": 0.05, "steps": 12, "save_every": 6, "scheme": scheme}
    for closed, noisy in pairs:
        bath, by_hand = ss.thermostat(closed, beta=1.0, gamma=RATE), noisy.damped(RATE)
        dw = np.random.default_rng(1).normal(size=(12, bath.nnoise, 3)) * np.sqrt(0.05)
        if "dkdkd" not in scheme and scheme != "chin4a":  # kicks draw more than increments
            first = ss.simulate(bath, paths=3, increments=dw, **given)
            second = ss.simulate(by_hand, paths=3, increments=dw[:, -bath.ndof :], **given)
            np.testing.assert_allclose(first.q, second.q, rtol=0, atol=1e-12)
            np.testing.assert_allclose(first.p, second.p, rtol=0, atol=1e-12)
        many = ss.simulate(bath, paths=300, threads=2, seed=5, **given)
        if closed.nnoise == 0:
            np.testing.assert_allclose(ss.simulate(by_hand, paths=300, seed=5, **given).p, many.p, rtol=0, atol=1e-12)
        for path in (0, 299):
            alone = ss.simulate(bath, paths=1, first_path=path, seed=5, **given)
            np.testing.assert_array_equal(many.q[..., path], alone.q[..., 0])
            np.testing.assert_array_equal(many.p[..., path], alone.p[..., 0])
        for other in (pickle.loads(pickle.dumps(bath)), copy.deepcopy(bath)):
            np.testing.assert_array_equal(ss.simulate(other, paths=300, seed=5, **given).p, many.p)


def moments_of_steps(model, step):
    """Stationary covariances of (q, p) of a linear model by midpoint steps, S = M S M^T + Q."""
    n, m = model.ndof, model.nnoise
    states, noise = np.eye(2 * n, 2 * n + m), np.eye(m, 2 * n + m, 2 * n) * np.sqrt(step)
    run = ss.simulate(model, q0=states[:n], p0=states[n:], paths=2 * n + m, step=step, steps=1, scheme="midpoint",
                      increments=noise[np.newaxis])  # fmt: skip
    found = np.vstack([run.q[1], run.p[1]])
    a, b = found[:, : 2 * n], found[:, 2 * n :]
    return np.linalg.solve(np.eye(4 * n * n) - np.kron(a, a), (b @ b.T).ravel()).reshape(2 * n, 2 * n)


def restoring(t, w, q, p):
    """H = p^2/2 + q^2/2, H_k = sin q."""
    return w[0] * q + w[1:].sum(axis=0) * np.cos(q), w[0] * p


def test_friction_of_own_noises():
    """Gamma = beta/2 sum f_k f_k^T: a matrix for correlated noises, rates for others. The law is exp(-beta H) up to the
    step, h^2 = 1e-4. With 5 % more friction it is not, and such friction given by a user is refused."""
    beta = 2.0
    one = ss.thermostat(ss.models.linear_oscillator(sigma=0.6), beta=beta)
    assert one.damping == pytest.approx((beta / 2 * 0.36,), rel=1e-14)
    text = "p1**2/2 + p2**2/4 + q1**2 + q1*q2/2 + q2**2"
    alone = ss.thermostat(ss.model_from_sympy(text, noise=["-0.6*q1", "-0.8*q2"]), beta=beta)
    assert alone.damping == pytest.approx((0.36, 0.64 / 2), rel=1e-12)
    several = ss.model_from_sympy(text, noise=["-0.6*q1 - 0.3*q2", "0.8*q2", "0.5*q1 - 0.2*q2"])
    joint = ss.thermostat(several, beta=beta)
    f = np.array([[0.6, 0.3], [0.0, -0.8], [-0.5, 0.2]])
    np.testing.assert_allclose(joint.damping, beta / 2 * f.T @ f, rtol=1e-14)
    exact = np.zeros((4, 4))
    exact[:2, :2] = np.linalg.inv([[2.0, 0.5], [0.5, 2.0]]) / beta
    exact[2:, 2:] = np.diag([1.0, 2.0]) / beta
    for model in (alone, joint):
        assert np.abs(moments_of_steps(model, 0.01) - exact).max() < 1e-4
        assert ss.thermostat(model, beta=beta) is model
        rubbed = model.damped(1.05 * np.array(model.damping))
        assert np.abs(moments_of_steps(rubbed, 0.01) - exact).max() > 1e-2
        with pytest.raises(
            InvalidArgumentError, match=r"do not belong to its friction at beta = 2: .* at beta = 2\.1\."
        ):
            ss.thermostat(rubbed, beta=beta)
        assert ss.thermostat(rubbed, beta=2.1) is rubbed
    quiet = ss.Model(ndof=1, nnoise=1, gradient=restoring, position_noise=True, silent=[1])
    for model, told in (
        (FREE, "has no noise of its own: give gamma, too"),
        (ss.models.kubo(sigma=0.0), "has no noise of its own"),
        (quiet, "model user has no noise of its own"),
        (ss.models.pendulum(), "are not all linear in q with constant factors, or depend on p"),
        (ss.models.synchrotron().damped(1.0), "are not all linear in q with constant factors"),
        (ss.model_from_sympy("p**2/2", noise=["sin(t)*q"]), "are not all linear in q with constant factors"),
        (ss.model_from_sympy("p**2/2", noise=["p"]), "are not all linear in q with constant factors"),
    ):
        with pytest.raises(IncompatibleError, match=told):
            ss.thermostat(model, beta=1.0)


def test_friction_of_noises_that_are_not_linear():
    """F = -beta/2 sum H_k,q (H_k,q . H_p): equals the force written by hand, by two schemes; <p^2> is 1/beta within 4.9
    standard errors and 1e-3 of the step, and is not for twice the friction."""
    given = {"params": {"s": 0.9}}
    noises = ["s*sin(q)", "s*q**2/4"]
    bare = ss.model_from_sympy("p**2/2 + q**4/4", noise=noises, **given)
    friction = "-(s**2*cos(q)**2 + s**2*q**2/4)*p"
    by_hand = ss.model_from_sympy("p**2/2 + q**4/4", noise=noises, force=[friction], **given)
    bath = ss.thermostat(bare, beta=2.0)
    run = {"q0": 0.7, "p0": 0.3, "step": 0.05, "steps": 20, "save_every": 20, "seed": 5, "paths": 20}
    for scheme in ("midpoint", "heun"):
        found, known = (ss.simulate(x, scheme=scheme, **run) for x in (bath, by_hand))
        np.testing.assert_allclose(found.p, known.p, rtol=0, atol=1e-9)
    assert np.abs(ss.simulate(bare, **run).p - found.p).max() > 1e-2
    twice = ss.model_from_sympy("p**2/2 + q**4/4", noise=noises, force=[f"2*({friction})"], **given)
    long = {"q0": 0.0, "p0": 0.0, "step": 0.1, "steps": 300, "save_every": 300, "seed": 6, "paths": 20_000}
    square = {"square": "p**2"}
    for model, holds in ((by_hand, True), (twice, False)):
        found = ss.moments(model, scheme="midpoint", observables=square, **long)
        off = abs(found.mean["square"][-1] - 0.5)
        assert (off < 4.9 * found.se_mean["square"][-1] + 1e-3) == holds


@pytest.mark.parametrize("step", [0.1, 0.7])
def test_gjf_is_lobatto_two_with_friction_as_a_force(step):
    """P = (p + h F/2 + s W/2)/(1 + z/2), q' = q + h P/m, p' = (1 - z/2) P + h F'/2 + s W/2: the step of [WHSB] (9)-(17)
    with the trapezoid, whose contraction is (1 - z/2)/(1 + z/2) and not exp(-z)."""
    gamma, mass, s = 1.3, 2.5, 0.8
    model = ss.model_from_sympy("p**2/(2*m) - cos(q) + q**4/4", noise=["-s*q"], force=["-g*p*(1 + eps*q)"],
                                params={"g": gamma, "m": mass, "s": s, "eps": 1e-30})  # fmt: skip
    rng = np.random.default_rng(1)
    q, p, dw = rng.normal(size=(3, 30))
    pull = lambda x: -np.sin(x) - x**3  # noqa: E731
    z = gamma * step
    middle = (p + step / 2 * pull(q) + s * dw / 2) / (1 + z / 2)
    moved = q + step * middle / mass
    ended = (1 - z / 2) * middle + step / 2 * pull(moved) + s * dw / 2
    run = ss.simulate(model, q0=q[None], p0=p[None], paths=30, step=step, steps=1, scheme="lobatto2",
                      increments=dw[None, None])  # fmt: skip
    assert model.damping == ()
    np.testing.assert_allclose(run.q[1, 0], moved, rtol=0, atol=1e-12)
    np.testing.assert_allclose(run.p[1, 0], ended, rtol=0, atol=1e-12)


@pytest.mark.parametrize(("rates", "step"), [(1.0, -2.0), (1.0, -3.0), ((0.1, 1.0), -2.0), (-1.0, 2.0)])
def test_gjf_is_refused_beyond_its_pole(rates, step):
    """(1 - x)/(1 + x), x = gamma h/2, has a pole at gamma h = -2 and the wrong sign beyond; forward it has none."""
    model = ss.model_from_sympy("(p1**2 + p2**2)/2 + (q1**2 + q2**2)/200", noise=["q1"]).damped(rates, allow_gain=True)
    run = {"q0": 0.1, "p0": 0.1, "scheme": "gjf", "steps": 1}
    with pytest.raises(IncompatibleError, match="has a pole at gamma h = -2"):
        ss.simulate(model, step=step, **run)
    most = -np.multiply(rates, step).min()
    with pytest.raises(IncompatibleError, match=f"gamma h = {-most:g} by step"):
        ss.prepare(model, "gjf", step=step, q0=0.1, p0=0.1)
    for near in (1.98 / most * step, -step):
        assert np.isfinite(ss.simulate(model, step=near, **run).q).all()


def means_of_squares(beta):
    """Means of q^2 and p^2 in the quartic well with their standard errors, over 12000 paths and 1000 times of each."""
    model = ss.thermostat(ss.model_from_sympy("p**2/2 + q**4/4"), beta=beta, gamma=1.0)
    run = ss.simulate(model, q0=0.6, p0=0.5, step=0.2, steps=10_000, save_every=10, paths=12_000, seed=7,
                      scheme="chin4a")  # fmt: skip
    for x in (run.q, run.p):
        squares = (x[25:, 0] ** 2).mean(axis=0)
        yield squares.mean(), squares.std(ddof=1) / np.sqrt(squares.size)


def test_the_law_of_a_quartic_well():
    """<q^2> = .6759782401 and <p^2> = 1 at beta = 1, within 4.9 standard errors (two false alarms in a million) and
    1e-4 of the step (6e-5 by a density on a grid). A bath of beta = 1.01 has .5 % and 1 % less and fails by both."""
    for beta, holds in ((1.0, True), (1.01, False)):
        for (found, error), exact in zip(means_of_squares(beta), (0.6759782401, 1.0), strict=True):
            assert error < 5e-4
            assert (abs(found - exact) < 4.9 * error + 1e-4) == holds, (beta, exact, found, error)


def test_two_temperatures():
    """Two oscillators, each in a bath of its own: each has its temperature, within 4.9 standard errors."""
    model = ss.thermostat(ss.model_from_sympy("(p1**2 + p2**2 + q1**2 + q2**2)/2"), beta=[1.0, 4.0], gamma=[1.0, 2.0])
    run = ss.moments(model, q0=0.0, p0=0.0, step=0.1, steps=200, save_every=200, paths=20_000, seed=2, scheme="chin4a",
                     observables={"one": lambda q, p: p[0] ** 2, "two": lambda q, p: p[1] ** 2})  # fmt: skip
    for name, expected in (("one", 1.0), ("two", 0.25)):
        assert abs(run.mean[name][-1] - expected) < 4.9 * run.se_mean[name][-1] + 1e-4 * expected


def test_baths_of_formulas_take_whole_steps():
    """Baths of formulas are formulas: whole steps on the same paths as with the noises that the library adds, for
    masses, several temperatures, noises of their own and other names."""
    plane = ss.model_from_sympy("u**2/(2*m) + v**2/6 + (x**2 - 1)**2*(1 + y**2)", q="x y", p="u v", params={"m": 2.0})
    noisy = ss.model_from_sympy("p**2/2 + q**4/4", noise=["s*cos(q)"], params={"s": 0.3})
    taken = [
        ss.model_from_sympy("bath_1*p**2/2 + q**4/4", params={"bath_1": 1.0}),
        *(ss.model_from_sympy(f"{p}**2/2 + {q}**4/4", q=q, p=p) for q, p in (("bath_1", "v"), ("x", "bath_1"))),
        ss.model_from_sympy("p**2/2 + q**4*(1 + cos(bath_1))/4", t="bath_1"),
    ]
    for model, bath, whole in (
        (OSCILLATOR, {"beta": 2.0, "gamma": RATE}, True),
        (plane, {"beta": [1.0, 3.0], "gamma": RATE}, True),
        (plane, {"beta": 1.0, "gamma": [0.0, RATE]}, False),
        (noisy, {"beta": 1.0, "gamma": 0.5}, True),
        *((x, {"beta": 1.0, "gamma": 0.5}, False) for x in taken),
    ):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", OwnNoiseWarning)
            mine = ss.thermostat(model, **bath)
        rates, betas = (np.broadcast_to(bath[key], model.ndof) for key in ("gamma", "beta"))
        other = thermostat._noisy(model, tuple(rates), tuple(betas)).damped(rates)
        given = {"q0": 0.4, "p0": -0.2, "step": 0.1, "steps": 12, "seed": 3, "paths": 20}
        for scheme in ("chin4a", "stormer_verlet"):
            found, known = (ss.simulate(x, scheme=scheme, **given) for x in (mine, other))
            assert ("whole" in found.report.stepper) == whole
            np.testing.assert_allclose(found.q, known.q, rtol=0, atol=2e-13)
            np.testing.assert_allclose(found.p, known.p, rtol=0, atol=2e-13)
    assert list(mine._bath) == [1.0]
    bathed = ss.thermostat(plane, beta=1.0, gamma=RATE)
    heavy = bathed.with_parameters(m=3.0), ss.thermostat(plane.with_parameters(m=3.0), beta=1.0, gamma=RATE)
    runs = [ss.simulate(x, q0=0.4, p0=-0.2, step=0.1, steps=5, seed=3, scheme="chin4a") for x in heavy]
    np.testing.assert_array_equal(runs[0].p, runs[1].p)
    again = pickle.loads(pickle.dumps(bathed))
    runs = [ss.simulate(x, q0=0.4, p0=-0.2, step=0.1, steps=5, seed=3, scheme="chin4a") for x in (bathed, again)]
    np.testing.assert_array_equal(runs[0].p, runs[1].p)


def test_temperatures():
    """Kinetic and configurational temperature of a chain within 4.9 standard errors, and each of a known ensemble:
    states of another spread have other temperatures. With h = .6 Verlet has p too cold by h^2 omega^2/6."""
    model = ss.thermostat(ss.models.fpu_chain(n=8, sigma=0.0), beta=2.0, gamma=1.0)
    found = ss.moments(model, q0=0.0, p0=0.0, step=0.1, steps=200, save_every=100, paths=8000, seed=4, scheme="chin4a",
                       observables=ss.observe.temperature(model))  # fmt: skip
    seen = ss.observe.temperatures(found)
    for value, error in (
        (seen.kinetic[-1], seen.se_kinetic[-1]),
        (seen.configurational[-1], seen.se_configurational[-1]),
    ):
        assert abs(value - 0.5) < 4.9 * error + 1e-3
        assert error < 8e-3
    assert str(seen).splitlines()[-1] == "positions and momenta stand at the same times, the ends of whole steps"
    rng = np.random.default_rng(1)
    mass, stiffness, paths = 3.0, 2.0, 50_000
    body = ss.model_from_sympy("p**2/(2*m) + k*q**2/2", params={"m": mass, "k": stiffness})
    q, p = rng.normal(size=(2, 1, paths)) * np.sqrt(np.array([0.7 / stiffness, 0.4 * mass]))[:, None, None]
    told = ss.moments(body, q0=q, p0=p, step=0.1, steps=0, paths=paths, observables=ss.observe.temperature(body))
    seen = ss.observe.temperatures(told)
    assert abs(seen.kinetic[0] - (p**2).mean() / mass) < 1e-12
    assert abs(seen.configurational[0] - stiffness * (q**2).mean()) < 1e-12
    assert abs(seen.se_configurational[0] - stiffness * (q**2).std(ddof=1) / np.sqrt(paths)) < 1e-12
    cold = ss.moments(ss.thermostat(OSCILLATOR, beta=1.0, gamma=1.0), q0=0.0, p0=0.0, step=0.6, steps=60, save_every=60,
                      paths=80_000, seed=4, scheme="verlet_kdk",
                      observables=ss.observe.temperature(OSCILLATOR))  # fmt: skip
    seen = ss.observe.temperatures(cold)
    assert abs(seen.kinetic[-1] - (1 - 0.06)) < 0.03
    assert seen.kinetic[-1] < 0.97
    assert seen.configurational[-1] > 1.0
    with pytest.raises(InvalidArgumentError, match="temperatures are made of the moments of obs"):
        ss.observe.temperatures(ss.moments(OSCILLATOR, q0=0.0, p0=0.0, step=0.1, steps=1))


def test_models_remember_their_bath():
    """Models remember their bath in text, rates and names; another friction keeps the noise; files describe the
    bath.
    """
    chain = ss.thermostat(ss.models.fpu_chain(n=4, sigma=0.0), beta=2.0, gamma=0.5)
    assert repr(chain) == "fpu_chain(n=4, beta=1, sigma=0, damping=0.5, bath at beta=2)"
    assert chain.damped(0.0).damping == ()
    assert "bath" not in repr(chain.damped(0.0)) + repr(chain.damped(2.0))  # their temperature is not 1/beta
    assert "bath at beta=2, forced" in repr(chain.forced(lambda q, p, t: -(q**3)))
    assert pickle.loads(pickle.dumps(chain.damped(0.0))).damping == ()
    assert "H_5 .. H_8 = -sqrt(2 gamma_i m_i/beta) q_i" in chain._repr_html_()
    named = ss.thermostat(ss.model_from_sympy("y**2/2 + x**4", q="x", p="y"), beta=[1.5], gamma=[0.5])
    assert named.coordinates == ("x", "y")
    run = ss.simulate(named, q0=0.1, p0=0.0, step=0.1, steps=1)
    assert run.report.status == 0


def cubic(q, p, t):
    """A force."""
    return -(q**3)


def test_a_bath_of_own_noises_is_carried_along():
    """Pickles know of it, and so does the model with another force. Its friction does not stay behind where parameters
    change: it was found for the present ones."""
    line = ss.model_from_sympy("p**2/2 - cos(q)", noise=["s*q"], params={"s": 0.3})
    sine = ss.Model(ndof=1, nnoise=1, gradient=restoring, position_noise=True, identity_mass=True)
    for model in (ss.thermostat(line, beta=2.0), ss.thermostat(sine, beta=2.0)):
        again = pickle.loads(pickle.dumps(model))
        assert repr(again) == repr(model)
        assert "bath at beta=2" in repr(model)
        assert again._fluctuating and (again._fluctuating, again.damping) == (model._fluctuating, model.damping)
        assert "bath" not in repr(model.damped(5.0))
    forced = ss.thermostat(line, beta=2.0).forced(cubic)
    assert repr(forced) == "formula(s=0.3, damping=0.09, bath at beta=2, forced)"
    for model in (forced, pickle.loads(pickle.dumps(forced))):
        with pytest.raises(IncompatibleError, match="belongs to its noises and masses"):
            model.with_parameters(s=0.5)
    free = ss.thermostat(sine, beta=2.0).damped(0.5).forced(cubic)  # the friction of the noises was a force
    assert repr(free) == "user(ndof=1, nnoise=1, damping=0.5, forced)"
    assert not free._fluctuating


def test_functions_in_a_bath():
    """Exceptions of a model's functions are raised from inside the bath; prepared runs have a copy of both."""

    def gradient(t, w, q, p):
        if t > 1:
            raise ValueError("beyond the end")
        return w[0] * q, w[0] * p

    own = ss.Model(ndof=1, nnoise=0, gradient=gradient, separable=True, identity_mass=True)
    bath = ss.thermostat(own, beta=1.0, gamma=1.0)
    given = {"q0": 0.1, "p0": 0.0, "step": 0.125, "paths": 3, "seed": 1, "scheme": "gauss_dkdkd"}
    whole = ss.simulate(bath, steps=8, **given)
    with pytest.raises(ValueError, match="beyond the end"):
        ss.simulate(bath, steps=16, **given)
    again = ss.simulate(bath, steps=8, **given)
    np.testing.assert_array_equal(whole.p, again.p)
    prepared = ss.prepare(bath, **given)
    prepared.run(8)
    np.testing.assert_array_equal(prepared.p, whole.p[-1])


def test_scenes(tmp_path):
    """`thermostat` of [model] is the function; errors in it are reported with the name of the file."""
    text_of = '[model]\n{model}\n[run]\nstep = 0.05\nsteps = 4\nq0 = 0.7\np0 = 0.3\nseed = 5\nscheme = "midpoint"\n'
    file = tmp_path / "scene.toml"
    for text, model in (
        ('name = "pendulum"\nsigma = 0.0\nthermostat = {beta = 2.0, gamma = 0.5}', ss.models.pendulum(sigma=0.0)),
        ('H = "p**2/2 + q**4/4"\nthermostat = {beta = 2.0, gamma = [0.5]}', ss.model_from_sympy("p**2/2 + q**4/4")),
    ):
        file.write_text(text_of.format(model=text), encoding="utf-8")
        read = scene.load(file)
        bath = ss.thermostat(model, beta=2.0, gamma=0.5)
        found = ss.simulate(read.model, **read.run)
        np.testing.assert_array_equal(found.p, ss.simulate(bath, q0=0.7, p0=0.3, step=0.05, steps=4, seed=5).p)
    for wrong, told in (
        ("1.0", r"\[model\] thermostat = 1.0: give beta and gamma, as in {beta = 1.0, gamma = 0.5}, or beta alone"),
        ("{beta = 1.0}", r"\[model\]: model pendulum has no noise of its own: give gamma, too"),
        ("{beta = 1.0, gamma = 1.0, mass = 1.0}", "'mass' is no key of thermostat"),
        ("{beta = 0.0, gamma = 1.0}", r"\[model\]: beta = 0.0: give finite numbers above zero"),
    ):
        file.write_text(text_of.format(model=f'name = "pendulum"\nsigma = 0.0\nthermostat = {wrong}'), encoding="utf-8")
        with pytest.raises(SceneError, match=told):
            scene.load(file)


def test_refusals():
    """Models that have no temperature are refused with a sentence; a warning names noises beside the bath."""
    for text in ("p**2*(1 + q**2)/2", "p1**2/2 + p1*p2/4 + p2**2/2 + q1*q2", "p**4/4 + q**2", "q**2/2 - p**2/2"):
        with pytest.raises(IncompatibleError, match=r"model formula does not declare a kinetic energy .*choose"):
            ss.thermostat(ss.model_from_sympy(text), beta=1.0, gamma=1.0)
    with pytest.raises(IncompatibleError, match="model formula is damped already: give the model without damping"):
        ss.thermostat(FREE.damped(1.0), beta=1.0, gamma=1.0)
    with pytest.warns(OwnNoiseWarning, match="model kubo has noises of its own, which heat it beside the bath"):
        ss.thermostat(ss.models.kubo(), beta=1.0, gamma=1.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ss.thermostat(ss.models.kubo(sigma=0.0), beta=1.0, gamma=1.0)
    for beta, gamma, error, told in (
        (-1.0, 1.0, InvalidArgumentError, "beta = -1.0: give finite numbers above zero"),
        (1.0, 0.0, InvalidArgumentError, "gamma = 0.0: give finite numbers of zero or more, not all zero"),
        (np.nan, 1.0, InvalidArgumentError, "beta = nan: give finite numbers above zero"),
        ([1.0, 2.0], 1.0, WrongShapeError, r"beta has shape \(2,\): give a number, or \(1,\), one for each"),
        (1.0, [[1.0]], WrongShapeError, r"gamma has shape \(1, 1\)"),
    ):
        with pytest.raises(error, match=told):
            ss.thermostat(FREE, beta=beta, gamma=gamma)
    pair = ss.models.henon_heiles(sigma1=0.0, sigma2=0.0)
    with pytest.raises(
        InvalidArgumentError, match=r"gamma = \[.*\]: give finite numbers of zero or more, not all zero"
    ):
        ss.thermostat(pair, beta=1.0, gamma=[1.0, -1.0])
    assert ss.thermostat(pair, beta=1.0, gamma=[1.0, 0.0]).damping == (1.0, 0.0)
    with pytest.raises(InvalidArgumentError, match=r"beta = \[.*\]: give finite numbers above zero"):
        ss.thermostat(pair, beta=[1.0, -1.0], gamma=1.0)
    with pytest.raises(InvalidArgumentError, match="a value of beta is not a finite number above zero"):
        ss.thermostat(pair, beta=[1.0, 0.0], gamma=1.0)


@pytest.mark.parametrize("paths", [1, 20])
@pytest.mark.parametrize("scheme", ["midpoint", "symplectic_euler", "stormer_verlet", "gauss_dkdkd"])
def test_two_temperatures_of_a_built_in_model(scheme, paths):
    """Special steppers, to which the bath offers the kernels of the model inside it, agree with the general one."""
    model = ss.thermostat(ss.models.henon_heiles(sigma1=0.0, sigma2=0.0), beta=[1.0, 2.0], gamma=[0.3, 0.5])
    given = {"q0": 0.05, "p0": 0.02, "step": 0.05, "steps": 20, "scheme": scheme, "paths": paths, "seed": 1}
    fast = ss.simulate(model, **given)
    slow = ss.simulate(model, compensated=True, **given)
    np.testing.assert_allclose(fast.q, slow.q, atol=1e-13)
    np.testing.assert_allclose(fast.p, slow.p, atol=1e-13)
    if scheme != "gauss_dkdkd":
        np.testing.assert_allclose(fast.p, ss.simulate(model, general=True, **given).p, atol=1e-12)
