# SPDX-License-Identifier: BSD-3-Clause
"""Forces beside Hamiltonians: steps by their equations, orders, laws, dp ^ dq, the discrete principle, refusals."""

import contextlib
import functools
import pickle

import numpy as np
import pytest
import symsde as ss
from symsde.batch import scene
from symsde.errors import (
    FalseTraitError,
    IncompatibleError,
    InvalidArgumentError,
    PathsFailedWarning,
    SceneError,
    SlowFormulaWarning,
    WrongShapeError,
    WrongTypeError,
)

pytestmark = pytest.mark.usefixtures("quick_compiler")

TABLEAUX = ["midpoint", "gauss2", "gauss3", "stormer_verlet", "lobatto2_swapped", "lobatto3", "heun"]
H, NOISES = 0.1, (0.23, -0.17)
START = np.array([[0.7, -0.2], [0.4, 0.5]])


def gradient(t, w, q, p):
    """H = |p|^2 (1 + q1^2)/2 + cos q1 + q1 q2^2/2, H_1 = .3 sin q1 + .2 p1 q2, H_2 = .2 q2."""
    x, y = q
    hq = [
        w[0] * (x * (p[0] ** 2 + p[1] ** 2) - np.sin(x) + y**2 / 2) + w[1] * 0.3 * np.cos(x),
        w[0] * x * y + w[1] * 0.2 * p[0] + w[2] * 0.2,
    ]
    hp = [w[0] * p[0] * (1 + x**2) + w[1] * 0.2 * y, w[0] * p[1] * (1 + x**2)]
    return np.array(hq), np.array(hp)


def force(q, p, t):
    """Drag, a curl, and a push that changes in time."""
    return np.array(
        [-0.5 * p[0] - 0.1 * p[0] ** 3 + 0.4 * q[1], -0.3 * p[1] * q[0] ** 2 - 0.4 * q[0] + 0.2 * np.sin(t)]
    )


def force_derivative(q, p, t):
    """[j, i] is dF_i by q_j, and by p_j."""
    zero, one = np.zeros_like(q[0]), np.ones_like(q[0])
    by_q = [[zero, -0.6 * p[1] * q[0] - 0.4], [0.4 * one, zero]]
    by_p = [[-0.5 - 0.3 * p[0] ** 2, zero], [zero, -0.3 * q[0] ** 2]]
    return np.array(by_q), np.array(by_p)


def noise_force(q, p, t):
    """f_1 depends on q and p, f_2 on q2."""
    return np.array([[0.4 * q[0] * q[1] + 0.1 * p[1], 0.2 * p[0]], [0.3 * np.cos(q[1]), 0.1 * q[0]]])


MODEL = ss.Model(ndof=2, nnoise=2, gradient=gradient, force=force, noise_force=noise_force, name="bent")
WITH = ss.Model(ndof=2, nnoise=2, gradient=gradient, name="bent").forced(
    force, noise_force=noise_force, force_derivative=force_derivative
)
HARMONIC = ss.model_from_sympy("p**2/2 + omega**2*q**2/2", noise=["-s*q"], params={"omega": 1.3, "s": 1.0})


def field(t, w, q, p, *, drag=1.0, kick=1.0):
    """Hhat_p, and -Hhat_q with the forces."""
    hq, hp = gradient(t, w, q, p)
    return hp, -hq + drag * w[0] * force(q, p, t) + kick * np.tensordot(w[1:], noise_force(q, p, t), 1)


def tableau_step(scheme, h, **changed):
    """A step from START at t = .3 by the equations of the tableau, by sweeps."""
    a, (q, p), t = ss.schemes.get(scheme).tableau(), START, 0.3
    w = np.array([h, *NOISES])
    force, velocity = (np.zeros((len(a.c), *q.shape)) for _ in range(2))
    for _ in range(200):
        qs, ps = q + np.tensordot(a.a, velocity, 1), p + np.tensordot(a.abar, force, 1)
        both = [field(t + c * h, w, x, y, **changed) for c, x, y in zip(a.c, qs, ps, strict=True)]
        velocity, force = (np.array([x[i] for x in both]) for i in (0, 1))
    return np.concatenate([q + np.tensordot(a.alpha, velocity, 1), p + np.tensordot(a.alpha, force, 1)])


def library_step(model, scheme, paths=1, h=H, **options):
    """The same step of the library."""
    rows = np.tile(np.reshape(NOISES, (1, -1, 1)), (1, 1, paths))
    run = ss.simulate(model, scheme=scheme, q0=START[0], p0=START[1], t0=0.3, step=h, steps=1, paths=paths,
                      increments=rows, **options)  # fmt: skip
    assert run.report.status == 0
    return np.concatenate([run.q[-1], run.p[-1]])


@pytest.mark.parametrize("scheme", TABLEAUX)
@pytest.mark.parametrize("h", [H, -H])
def test_steps_obey_their_equations(scheme, h):
    """-Hhat_q + Fhat stands in the place of -Hhat_q: nonseparable H, forces of q, p and t, one path and many."""
    expected = tableau_step(scheme, h)
    for model in (MODEL, WITH):
        for paths in (1, 20):
            assert np.abs(library_step(model, scheme, paths, h=h) - expected[:, None]).max() < 2e-14
    assert np.abs(library_step(MODEL, scheme, h=h, general=True)[:, 0] - expected).max() < 2e-14
    for changed in ({"drag": 1.01}, {"kick": 1.01}):  # 1 % of a force is seen
        assert np.abs(tableau_step(scheme, h, **changed) - expected).max() > 1e-5


@pytest.mark.parametrize("scheme", ["symplectic_euler", "symplectic_euler_adjoint"])
@pytest.mark.parametrize("correction", ["none", "increments", "mean"])
def test_one_sided_steps_are_corrected(scheme, correction):
    """(1/2 - lambda) (A_q A - A_p B, B_q A - B_p B) with A = H_k,p and B = -H_k,q + f_k is added to the step."""
    (q, p), t = START, 0.3
    adjoint = scheme.endswith("adjoint")
    half = -0.5 if adjoint else 0.5
    time = t + H if adjoint else t

    def along(w, x, y, vq, vp):
        e = 1e-5
        (a, b), (c, d) = field(time, w, x + e * vq, y + e * vp), field(time, w, x - e * vq, y - e * vp)
        return (a - c) / (2 * e), (b - d) / (2 * e)

    terms = {
        "none": [],
        "increments": [(1.0, np.array([0.0, *NOISES]))],
        "mean": [(H, np.array([0.0, 1.0, 0.0])), (H, np.array([0.0, 0.0, 1.0]))],
    }[correction]

    def corrected(x, y):
        dq, dp = field(time, np.array([H, *NOISES]), x, y)
        for factor, w in terms:
            a, b = field(time, w, x, y)
            cq, cp = along(w, x, y, a, -b)  # (A_q A - A_p B, B_q A - B_p B)
            dq, dp = dq + factor * half * cq, dp + factor * half * cp
        return dq, dp

    x, y = q, p
    for _ in range(300):
        dq, dp = corrected(*((x, p) if adjoint else (q, y)))
        x, y = q + dq, p + dp
    step = library_step(WITH, scheme, correction=correction)[:, 0]
    assert np.abs(step - [*x, *y]).max() < 1e-9
    if terms:
        plain = library_step(WITH, scheme, correction="none")[:, 0]
        assert np.abs(plain - step).max() > 1e-4


@functools.cache
def reference(finest, paths, drag=1.0):
    """Increments of 2^finest steps over the time 1, and the end of Heun's scheme with them."""
    dw = np.random.default_rng(5).standard_normal((2**finest, 1, paths)) / 2 ** (finest / 2)
    start = np.tile([[0.7], [0.3]], (1, paths))
    return dw, heun(lambda *x: commuting(*x, drag=drag), start, 1 / 2**finest, dw)


def heun(model_field, x, h, dw):
    """Heun's scheme for Stratonovich's equation, a reference of another kind: dw (step, noise, path)."""
    n = len(x) // 2
    for k in range(len(dw)):
        w = np.concatenate([np.full((1, dw.shape[2]), h), dw[k]])
        a = np.concatenate(model_field(k * h, w, x[:n], x[n:]))
        y = x + a
        b = np.concatenate(model_field((k + 1) * h, w, y[:n], y[n:]))
        x = x + (a + b) / 2
    return x


def commuting(t, w, q, p, *, drag=1.0):
    """Nonseparable H, a drag that is not linear in p, and f_1(q) beside H_1(q)."""
    hq, hp = w[0] * (p**2 * q * 0.3 + np.sin(q)), w[0] * p * (1 + 0.3 * q**2)
    return hp, -hq + w[0] * drag * (-0.6 * p - 0.2 * p**3) + w[1] * (0.5 * np.cos(q) + 0.3 * q)


ORDERED = ss.Model(
    ndof=1,
    nnoise=1,
    gradient=lambda t, w, q, p: (
        w[0] * (p**2 * q * 0.3 + np.sin(q)) - w[1] * 0.5 * np.cos(q),
        w[0] * p * (1 + 0.3 * q**2),
    ),
    force=lambda q, p, t: -0.6 * p - 0.2 * p**3,
    noise_force=lambda q, p, t: 0.3 * q[np.newaxis],
    position_noise=True,
    position_noise_force=True,
)


@pytest.mark.parametrize(
    "scheme", ["midpoint", "gauss2", "symplectic_euler", "symplectic_euler_adjoint", "stormer_verlet", "P1N2Q2Lob"]
)
def test_orders_are_those_of_the_tableau(scheme):
    """Strong order 1 against Heun's scheme with 2^13 steps, and not against one whose drag is 1 % too large."""
    paths = 60
    dw, exact = reference(13, paths)
    errors, others = [], []
    for k in (5, 7, 9):
        rows = dw.reshape(2**k, -1, 1, paths).sum(axis=1)
        run = ss.simulate(ORDERED, scheme=scheme, q0=0.7, p0=0.3, step=1 / 2**k, steps=2**k, save_every=2**k,
                          paths=paths, increments=rows)  # fmt: skip
        end = np.concatenate([run.q[-1], run.p[-1]])
        errors.append(np.sqrt(np.mean((end - exact) ** 2)))
        others.append(np.sqrt(np.mean((end - reference(13, paths, drag=1.01)[1]) ** 2)))
    slopes, wrong = (np.log2(x[:-1] / np.array(x[1:])) / 2 for x in (errors, others))
    assert slopes.min() > 0.85, (errors, slopes)
    assert wrong.min() < 0.75, (others, wrong)


def step_matrix(model, scheme, h):
    """The matrix of a step of a linear model, from (q, p) and dW to the new (q, p)."""
    columns = []
    for q0, p0, dw in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)):
        run = ss.simulate(model, scheme=scheme, q0=q0, p0=p0, step=h, steps=1, paths=1,
                          increments=np.full((1, 1, 1), dw))  # fmt: skip
        columns.append([run.q[-1, 0, 0], run.p[-1, 0, 0]])
    m = np.array(columns).T
    return m[:, :2], m[:, 2:]


@pytest.mark.parametrize("gamma", [0.5, 3.0, 30.0])
def test_laws_of_friction_as_a_force(gamma):
    """Stationary moments of F = -gamma p with fluctuation-dissipation, by the step's own recursion, exactly."""
    h, omega, beta = 0.4, 1.3, 0.7
    model = HARMONIC.with_parameters(omega=omega, s=np.sqrt(2 * gamma / beta)).forced(lambda q, p, t: -gamma * p)
    z = gamma * h
    kept = 1 - h**2 * omega**2 / 4
    #: scheme -> omega^2 <q^2> beta, <p^2> beta, and the factor of dp ^ dq
    known = {
        "midpoint": (1, 1, (4 - 2 * z + h**2 * omega**2) / (4 + 2 * z + h**2 * omega**2)),
        "lobatto2": (1, kept, (1 - z / 2) / (1 + z / 2)),
        "lobatto2_swapped": (1, 1 / kept, (1 - z / 2) / (1 + z / 2)),
    }
    for scheme, (qq, pp, factor) in known.items():
        m, n = step_matrix(model, scheme, h)
        law = np.linalg.solve(np.eye(4) - np.kron(m, m), (n @ n.T * h).ravel()).reshape(2, 2)
        assert np.abs([omega**2 * law[0, 0] * beta - qq, law[0, 1], law[1, 1] * beta - pp]).max() < 1e-11, scheme
        assert abs(np.linalg.det(m) - factor) < 1e-12


def test_lobatto_2_is_gjf():
    """The recipe of the paper for F = -gamma p gives the scheme of Gronbech-Jensen and Farago (2013)."""
    gamma, h, s = 1.7, 0.3, 0.9
    model = ss.model_from_sympy("p**2/2 + q**4/4 - q**2/2", noise=["-s*q"], params={"s": s})
    rows = np.random.default_rng(1).standard_normal((20, 1, 1)) * np.sqrt(h)
    run = ss.simulate(model.forced(lambda q, p, t: -gamma * p), scheme="lobatto2", q0=0.7, p0=0.3, step=h, steps=20,
                      paths=1, increments=rows)  # fmt: skip
    q, p, z = 0.7, 0.3, gamma * h
    for k in range(20):
        pull = -(q**3) + q
        between = (p + h * pull / 2 + s * rows[k, 0, 0] / 2) / (1 + z / 2)
        q = q + h * between
        p = (1 - z / 2) * between + h * (-(q**3) + q) / 2 + s * rows[k, 0, 0] / 2
        assert abs(run.q[k + 1, 0, 0] - q) + abs(run.p[k + 1, 0, 0] - p) < 1e-12


def test_the_discrete_principle_holds():
    """Euler-Lagrange equations and Legendre transforms with the work of the forces; not with forces of wrong sign."""
    for scheme in ("midpoint", "gauss2", "stormer_verlet", "lobatto3"):
        dw = ss.increments(WITH, step=0.05, steps=20, paths=3, seed=2)
        run = {"q0": [0.7, -0.2], "p0": [0.4, 0.5], "step": 0.05, "steps": 20, "paths": 3, "increments": dw}
        right = ss.simulate(WITH, scheme=scheme, **run)
        assert ss.diagnose.euler_lagrange_residual(right).max() < 5e-15, scheme
        for sign, size in ((-1, 1e-2), (1.01, 1e-4)):
            changed = WITH.forced(lambda q, p, t: sign * force(q, p, t), noise_force=noise_force)  # noqa: B023
            wrong = ss.simulate(changed, scheme=scheme, **run)
            right.q[...], right.p[...] = wrong.q, wrong.p
            assert ss.diagnose.euler_lagrange_residual(right).max() > size, scheme


@pytest.mark.parametrize(
    "scheme", ["midpoint", "symplectic_euler", "gauss2", "stormer_verlet", "heun", "euler_maruyama"]
)
def test_a_path_has_its_bits_anywhere(scheme):
    """A path has the same bits in blocks of any width, with any number of threads, and in a run of its own."""
    run = {"scheme": scheme, "q0": [0.7, -0.2], "p0": [0.4, 0.5], "step": 0.05, "steps": 12, "seed": 3}
    whole = ss.simulate(WITH, paths=37, threads=2, **run)
    assert whole.report.status == 0
    for first, paths, threads in ((0, 37, 1), (16, 21, 1), (35, 2, 1)):
        part = ss.simulate(WITH, paths=paths, first_path=first, threads=threads, **run)
        assert part.q.tobytes() == whole.q[..., first : first + paths].tobytes()
        assert part.p.tobytes() == whole.p[..., first : first + paths].tobytes()


def test_forces_of_positions_keep_explicit_schemes():
    """A curl of q and t leaves Verlet and Euler explicit where H is separable, with the steps of their equations."""
    model = ss.models.henon_heiles()

    def curl(q, p, t):
        return np.array([q[1] + 0 * q[0], -q[0] * np.cos(t)])

    for scheme in ("stormer_verlet", "symplectic_euler"):
        general = ss.simulate(
            model.forced(curl), scheme=scheme, q0=[0.1, 0.2], p0=[0.3, 0.1], step=0.1, steps=20, seed=1
        )
        explicit = ss.simulate(
            model.forced(curl, position_force=True),
            scheme=scheme,
            q0=[0.1, 0.2],
            p0=[0.3, 0.1],
            step=0.1,
            steps=20,
            seed=1,
        )
        assert "explicit" in explicit.report.stepper
        assert np.abs(explicit.q - general.q).max() < 1e-13
    with pytest.raises(FalseTraitError, match="changes with p"):
        ss.simulate(model.forced(lambda q, p, t: -p, position_force=True), scheme="midpoint", q0=[0.1, 0.2],
                    p0=[0.3, 0.1], step=0.1, steps=1)  # fmt: skip


def test_stiff_friction_is_solved():
    """Newton's matrix contains F_p: steps with gamma h = 200 are solved in few iterations, by derivatives and by
    differences."""
    gamma = 2000.0
    model = ss.models.henon_heiles()
    derivative = lambda q, p, t: (np.zeros((2, *q.shape)), np.tile(-gamma * np.eye(2)[..., None], q.shape[1]))  # noqa: E731
    for given in (None, derivative):
        forced = model.forced(lambda q, p, t: -gamma * p, force_derivative=given)
        for scheme in ("midpoint", "gauss2", "symplectic_euler", "P1N2Q2Lob"):
            run = ss.simulate(forced, scheme=scheme, q0=[0.1, 0.2], p0=[0.3, 0.1], step=0.1, steps=10, paths=3, seed=1)
            assert run.report.status == 0
            assert run.report.counters["iterations"] <= 6 * 10 * 3, (scheme, run.report.counters)


def test_units_of_one_s_own():
    """A system in other units is the same system: lengths times 1e9, times times 1e-6."""
    length, time = 1e9, 1e-6

    def scaled(q, p, t):
        return -0.3 * p / time * (1 + (q / length) ** 2)

    other = ss.model_from_sympy(
        "p**2/2 + (w**2)*q**2/2", noise=["-s*q"], params={"w": 1.3 / time, "s": 0.8 * length / time**1.5}
    )
    unit = HARMONIC.with_parameters(omega=1.3, s=0.8).forced(lambda q, p, t: -0.3 * p * (1 + q**2))
    run = {"paths": 5, "steps": 20, "seed": 4}
    for scheme in ("midpoint", "stormer_verlet", "gauss2"):
        one = ss.simulate(unit, scheme=scheme, q0=0.7, p0=0.3, step=0.1, **run)
        two = ss.simulate(
            other.forced(scaled), scheme=scheme, q0=0.7 * length, p0=0.3 * length / time, step=0.1 * time, **run
        )
        assert np.abs(one.q - two.q / length).max() < 1e-11
        assert np.abs(one.p - two.p / length * time).max() < 1e-11


def test_forces_and_damping():
    """Damping is exact beside forces, and F = -gamma p is another scheme of the same equation."""
    model = ss.model_from_sympy("p**2/2 + q**4/4", noise=["-q"])
    curl = model.forced(lambda q, p, t: np.sin(q + t) * 0.5)
    distances = []
    for steps in (32, 128):
        run = {"scheme": "midpoint", "q0": 0.7, "p0": 0.3, "step": 1 / steps, "steps": steps, "paths": 20, "seed": 1,
               "refine": 7 - int(np.log2(steps))}  # fmt: skip
        damped = ss.simulate(curl.damped(0.8), **run)
        both = ss.simulate(model.damped(0.8).forced(lambda q, p, t: np.sin(q + t) * 0.5), **run)
        assert damped.q.tobytes() == both.q.tobytes()
        forced = ss.simulate(model.forced(lambda q, p, t: np.sin(q + t) * 0.5 - 0.8 * p), **run)
        distances.append(np.sqrt(np.mean((damped.q[-1] - forced.q[-1]) ** 2)))
    assert 0 < distances[1] < distances[0] / 3


def test_forces_in_a_heat_bath():
    """A heat bath keeps the forces of a model, whichever of both is given first; its noises follow the noises of the
    forces.
    """
    model = ss.model_from_sympy("p**2/2 + q**4/4", noise=["-q"])
    forces = {"force": lambda q, p, t: np.sin(q + t) * 0.5, "noise_force": lambda q, p, t: 0.2 * p[None]}
    one = ss.thermostat(model.forced(**forces), beta=2.0, gamma=0.5)
    run = {"scheme": "midpoint", "q0": 0.7, "p0": 0.3, "step": 0.1, "steps": 9, "paths": 5, "seed": 1}
    bathed = ss.simulate(one, **run)
    rows = ss.increments(one, step=0.1, steps=9, paths=5, seed=1)
    noises = ss.model_from_sympy("p**2/2 + q**4/4", noise=["-q", "-s*q"], params={"s": np.sqrt(0.5)})
    forces["noise_force"] = lambda q, p, t: np.array([0.2 * p, 0 * p])
    two = ss.simulate(noises.forced(**forces).damped(0.5), **run | {"increments": rows})
    assert np.abs(bathed.q - two.q).max() < 1e-13
    # Its f_k count the noises of the bath, which are formulas here, and a view of the forced model above.
    after = ss.thermostat(model, beta=2.0, gamma=0.5).forced(**forces)
    np.testing.assert_allclose(ss.simulate(after, **run).q, bathed.q, rtol=0, atol=1e-14)
    assert "forced" in repr(one)


@pytest.mark.parametrize(
    ("scheme", "why"),
    [
        ("gauss2_strong32", "brackets"),
        ("gauss_dkdkd", "kicks momenta at given positions"),
        ("chin4a", "kicks momenta at given positions"),
        ("verlet_dz", "kicks momenta at given positions"),
        ("word:BAOAB", "kicks momenta at given positions"),
        ("averaged_shift_midpoint", "flows of Hamiltonians"),
        ("exact_rotation", "flows of Hamiltonians"),
        ("midpoint_weak1", "means alone"),
    ],
)
def test_schemes_that_cannot_are_refused(scheme, why):
    """Schemes that cannot execute forces are refused with the reason and with advice."""
    model = ss.models.linear_oscillator(sigma=1.0).forced(lambda q, p, t: -p)
    with pytest.raises(IncompatibleError, match=f"forces act on model.*{why}.*use midpoint"):
        ss.simulate(model, scheme=scheme, q0=1.0, p0=0.0, step=0.1, steps=1)


@pytest.mark.parametrize("scheme", ["gauss_dkdkd", "verlet_kdk", "verlet_dz", "drift_preserving"])
def test_advice_for_forces_on_noises_is_a_scheme_that_takes_them(scheme):
    model = ss.models.linear_oscillator(sigma=1.0).forced(None, noise_force=lambda q, p, t: p[np.newaxis])
    with pytest.raises(IncompatibleError, match=r"needs forces f_k .*does not declare it: use midpoint( \(|$)"):
        ss.simulate(model, scheme=scheme, q0=1.0, p0=0.0, step=0.1, steps=1)
    assert ss.simulate(model, scheme="midpoint", q0=1.0, p0=0.0, step=0.1, steps=1).report.status == 0


def test_areas_go_with_a_force_but_not_with_those_of_noises():
    """Brackets of two noises are those of Hamiltonians while no f_k acts."""
    model = ss.models.noncommutative_oscillator()
    run = {"scheme": "midpoint_areas", "q0": 1.0, "p0": 0.0, "step": 0.1, "steps": 2}
    assert ss.simulate(model.forced(lambda q, p, t: -p), **run).report.status == 0
    noises = model.forced(noise_force=lambda q, p, t: np.array([q] * model.nnoise))
    with pytest.raises(IncompatibleError, match=r"brackets of noises.*no Hamiltonians"):
        ss.simulate(noises, **run)


def test_what_closed_systems_have_is_refused():
    """Refused where forces act: exact solutions, boundary values, brackets, growth of moments, programs."""
    model = ss.models.linear_oscillator(sigma=1.0).forced(lambda q, p, t: -p)
    for ask in (
        lambda: ss.diagnose.exact(ss.simulate(model, q0=1.0, p0=0.0, step=0.1, steps=2)),
        lambda: ss.mean_square(model, "midpoint", step=0.1),
        lambda: ss.diagnose.stationary_path(model, q_start=0.0, q_end=1.0, step=0.1, steps=4),
    ):
        with pytest.raises(IncompatibleError, match="forces act on model"):
            ask()


def test_brackets_are_those_of_fields():
    """Two noises in position commute; a force p on one of them does not; nor does friction with additive noise."""
    model = ss.model_from_sympy("p**2/2 + q**2/2", noise=["-q", "-q**2"])
    assert ss.commutator(model).commutative
    assert not ss.commutator(model.forced(noise_force=lambda q, p, t: np.array([p, 0 * p]))).commutative
    both = model.forced(noise_force=lambda q, p, t: np.array([q**3, np.sin(q)]))
    assert ss.commutator(both).commutative
    assert "with their forces: strong order 1 from every" in ss.commutator(both).text
    kubo = ss.models.kubo()
    assert ss.commutator(kubo).flows_commute
    assert not ss.commutator(kubo.forced(lambda q, p, t: -p)).flows_commute


def test_wrong_arguments():
    """Each wrong argument is refused by its name, and the message says what is allowed."""
    free, pair = ss.models.linear_oscillator(), ss.models.henon_heiles()
    with pytest.raises(WrongTypeError, match="force = 3 cannot be called: give a function of"):
        free.forced(3)
    with pytest.raises(WrongTypeError, match="force"):
        free.forced(lambda q: q)
    with pytest.raises(InvalidArgumentError, match="force_derivative and no force"):
        free.forced(force_derivative=lambda q, p, t: (q, q))
    with pytest.raises(InvalidArgumentError, match="no noise that a force could multiply"):
        ss.Model(ndof=1, nnoise=0, gradient=lambda t, w, q, p: (w[0] * q, w[0] * p)).forced(
            noise_force=lambda q, p, t: q[None]
        ).gradient(1.0, 1.0)
    run = {"scheme": "midpoint", "q0": 1.0, "p0": 0.0, "step": 0.1, "steps": 1}
    with pytest.raises(WrongShapeError, match=r"force\(\) has shape \(3,\)"):
        ss.simulate(free.forced(lambda q, p, t: np.ones(3)), **run)
    with pytest.warns(PathsFailedWarning):  # no declaration of it can be refuted
        nowhere = ss.simulate(pair.forced(lambda q, p, t: np.array([-0.3 * p[0], np.nan * p[1]])), **run | {"p0": 0.3})
    assert nowhere.report.failed == 1
    with pytest.raises(ZeroDivisionError):
        ss.simulate(free.forced(lambda q, p, t: 1 / 0), **run)
    with pytest.raises(FalseTraitError, match="derivatives that differences refute"):
        ss.simulate(free.forced(lambda q, p, t: -p, force_derivative=lambda q, p, t: (p[None], p[None])), **run)
    assert not free.forced()._forces
    assert free.forced(lambda q, p, t: -p).forced() is free


def test_forces_may_vanish_where_a_run_begins():
    """F = -p^3/10 and its derivatives are zero at rest: a probe by differences refutes nothing there."""
    model = ss.model_from_sympy("p**2/2 + q**2/2", noise=["-0.3*q"], force="-0.1*p**3", noise_force=["0.1*p**2"])
    run = ss.simulate(model, scheme="gauss2", q0=1.0, p0=0.0, step=0.1, steps=3)
    assert run.report.status == 0


def test_no_force_is_the_model_itself():
    """A force that is zero, of drift and of noises, leaves the path as it is: to rounding, by general steps and by
    those that a scene takes."""
    for model in (ss.models.kubo(), ss.models.fpu_chain(n=24)):
        zero = model.forced(lambda q, p, t: 0 * q, noise_force=lambda q, p, t, m=model.nnoise: np.zeros((m, *q.shape)))
        run = {"q0": [0.4] * model.ndof, "p0": [0.2] * model.ndof, "step": 0.1, "steps": 10, "paths": 9}
        for scheme in ("symplectic_euler", "midpoint", "gauss2", "stormer_verlet", "heun"):
            for general in (False, True):
                free, forced = (ss.simulate(x, scheme=scheme, general=general, **run) for x in (model, zero))
                assert max(np.abs(free.q - forced.q).max(), np.abs(free.p - forced.p).max()) < 1e-15, scheme


def drag(q, p, t):
    """A force at the top of a module, where pickle finds it."""
    return -p * abs(p)


def test_models_are_pickled_with_their_forces():
    """Models are pickled with their forces if the functions have names."""
    model = ss.models.pendulum().forced(drag)
    again = pickle.loads(pickle.dumps(model.damped(0.1)))
    run = {"scheme": "midpoint", "q0": 1.0, "p0": 0.5, "step": 0.1, "steps": 5}
    assert ss.simulate(again, **run).q.tobytes() == ss.simulate(model.damped(0.1), **run).q.tobytes()
    assert "forced" in repr(model)
    with pytest.raises(WrongTypeError, match="pickle cannot find by name"):
        pickle.dumps(ss.models.pendulum().forced(lambda q, p, t: -p))


BENT = {
    "H": "(p1**2 + p2**2)*(1 + q1**2)/2 + cos(q1) + q1*q2**2/2",
    "noise": ["0.3*sin(q1) + 0.2*p1*q2", "0.2*q2"],
    "params": {"drag": 0.5},
}
PULLS = {
    "force": ["-drag*p1 - 0.1*p1**3 + 0.4*q2", "-0.3*p2*q1**2 - 0.4*q1 + 0.2*sin(t)"],
    "noise_force": [["0.4*q1*q2 + 0.1*p2", "0.2*p1"], ["0.3*cos(q2)", "0.1*q1"]],
}


@pytest.mark.parametrize("compiled", [True, False])
def test_formulas_give_the_same_steps(compiled, monkeypatch):
    """Forces as formulas give the same steps as forces as functions, with derivatives: compiled, and by NumPy."""
    if not compiled:
        monkeypatch.setattr("symsde.model.formulas.compiler.command", lambda: None)
    with contextlib.nullcontext() if compiled else pytest.warns(SlowFormulaWarning):
        model = ss.model_from_sympy(**BENT, **PULLS)
    assert model.formula.backend == ("C" if compiled else "NumPy")
    for scheme in ("midpoint", "symplectic_euler", "gauss2", "lobatto3"):
        for paths in (1, 20):
            steps = [library_step(x, scheme, paths) for x in (model, WITH)]
            assert np.abs(steps[0] - steps[1]).max() < 3e-14
    changed = library_step(model.with_parameters(drag=0.505), "midpoint")
    assert np.abs(changed - library_step(WITH, "midpoint")).max() > 1e-5
    assert (library_step(pickle.loads(pickle.dumps(model)), "gauss2") == library_step(model, "gauss2")).all()
    assert "forced" not in repr(model.forced())


@pytest.mark.parametrize("scheme", ["midpoint", "symplectic_euler", "gauss2", "stormer_verlet", "heun", "P1N2Q2Lob"])
def test_a_path_by_itself_has_the_bits_of_its_block(scheme):
    """Compiled formulas take single paths one by one, through steppers of one lane."""
    model = ss.model_from_sympy(**BENT, **PULLS)
    if scheme == "P1N2Q2Lob":
        model = ss.model_from_sympy("p1**2/2 + p2**2/2 + q1*q2**2/2", noise=["0.3*sin(q1)"], force=["-p1**3", "q1*p2"])
    run = {"scheme": scheme, "q0": [0.7, -0.2], "p0": [0.4, 0.5], "step": 0.05, "steps": 12, "seed": 3}
    whole = ss.simulate(model, paths=300, threads=2, **run)
    assert whole.report.status == 0
    for first, paths in ((299, 1), (17, 5), (0, 40)):
        part = ss.simulate(model, paths=paths, first_path=first, **run)
        assert part.q.tobytes() == whole.q[..., first : first + paths].tobytes()


def test_linear_friction_in_formulas_is_damping():
    """F = -gamma_i p_i is proved and becomes damping, beside damping that is given; other forces remain forces."""
    well = {"H": "p**2/2 + q**4/4", "noise": ["-q"], "params": {"g": 0.4}}
    run = {"scheme": "gauss_dkdkd", "q0": 0.7, "p0": 0.3, "step": 0.1, "steps": 9, "seed": 1}
    known = ss.model_from_sympy(**well, damping=0.4)
    found = ss.model_from_sympy(**well, force="-g*p*(cos(q)**2 + sin(q)**2)")
    assert found.damping == (0.4,)
    assert ss.simulate(found, **run).q.tobytes() == ss.simulate(known, **run).q.tobytes()
    assert found.with_parameters(g=0.7).damping == (0.7,)
    assert found.damped(0.1).damping == ss.model_from_sympy(**well, force="-g*p", damping=0.1).damping == (0.5,)
    assert pickle.loads(pickle.dumps(found.damped(0.1))).damping == (0.5,)
    assert found.damped(0.1).damped(0.2).with_parameters(g=1.0).damping == pytest.approx([1.2])
    assert found.damped(0.1).forced(drag).damping == pytest.approx([0.1])
    two = ss.model_from_sympy("p1**2/2 + p2**2/2 + q1*q2", force=["-p1", "-2*p2"])
    assert two.damping == (1.0, 2.0)
    for force in ("-g*p*q", "-g*p + 0.1*q", "-g*p**2", "-g*p*cos(t)"):
        assert not ss.model_from_sympy(**well, force=force).damping


def test_forces_of_positions_are_proved():
    """A force counts as a force of positions even if its text contains p and p cancels: then Verlet is explicit."""
    separable = {"H": "p1**2/2 + p2**2/2 + q1**2*q2", "noise": ["-q1"]}
    curl = ss.model_from_sympy(**separable, force=["q2 + p1 - p1", "-q1*cos(t)"], noise_force=[["sin(q1)", "0"]])
    run = {"scheme": "stormer_verlet", "q0": [0.1, 0.2], "p0": [0.3, 0.1], "step": 0.1, "steps": 3, "seed": 1}
    assert "explicit" in ss.simulate(curl, **run).report.stepper
    assert "explicit" not in ss.simulate(ss.model_from_sympy(**separable, force=["q2", "p1*q1"]), **run).report.stepper


def test_wrong_formulas_of_forces():
    """Formulas of forces with wrong shapes, names or sites are refused."""
    two = {"H": "p1**2/2 + p2**2/2 + q1*q2", "noise": ["q1"]}
    for forces, why in (
        ({"force": ["q1"]}, "force has 1 formulas: give one for each of the 2"),
        ({"noise_force": [["q1", "0"], ["0", "0"]]}, "noise_force has 2 rows for 1 noises: give one list for each"),
        ({"noise_force": [["q1"]]}, "row 1 of noise_force has 1 formulas"),
    ):
        with pytest.raises(WrongShapeError, match=why):
            ss.model_from_sympy(**two, **forces)
    with pytest.raises(InvalidArgumentError, match="holds r, which is not given"):
        ss.model_from_sympy(**two, force=["r", "0"])
    with pytest.raises(InvalidArgumentError, match="models of n sites take no forces as formulas"):
        ss.model_from_sympy("Sum(p[i]**2/2, i)", n=3, force="-p[i]**3")


SCENE = """
[model]
H = "(p1**2 + p2**2)*(1 + q1**2)/2 + cos(q1) + q1*q2**2/2"
noise = ["0.3*sin(q1) + 0.2*p1*q2", "0.2*q2"]
force = ["-drag*p1 - 0.1*p1**3 + 0.4*q2", "-0.3*p2*q1**2 - 0.4*q1 + 0.2*sin(t)"]
noise_force = [["0.4*q1*q2 + 0.1*p2", "0.2*p1"], ["0.3*cos(q2)", "0.1*q1"]]
[model.params]
drag = 0.5
[run]
scheme = "midpoint"
step = 0.1
steps = 4
q0 = [0.7, -0.2]
p0 = [0.4, 0.5]
paths = 3
"""


def test_scenes_have_forces(tmp_path):
    """The model of a scene is that of its formulas."""
    (tmp_path / "scene.toml").write_text(SCENE)
    model = scene.load(str(tmp_path / "scene.toml")).model
    assert (library_step(model, "gauss2") == library_step(ss.model_from_sympy(**BENT, **PULLS), "gauss2")).all()
    (tmp_path / "scene.toml").write_text(SCENE.replace('["0.3*cos(q2)", "0.1*q1"]', '["0.3*cos(q2)", 1]'))
    with pytest.raises(SceneError, match=r"noise_force = .*write formulas and names as text"):
        scene.load(str(tmp_path / "scene.toml"))
