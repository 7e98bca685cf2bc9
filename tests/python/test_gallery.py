# SPDX-License-Identifier: BSD-3-Clause
"""The scenes of examples/gallery, each against its exact solution and its invariants."""

import itertools
from pathlib import Path

import numpy as np
import pytest
import symsde as ss
from symsde.batch import scene

pytest.importorskip("sympy")

from symsde.model.formulas import compiler

if compiler.command() is None:
    pytest.skip("no C compiler", allow_module_level=True)

GALLERY = Path(__file__).parents[2] / "examples" / "gallery"


def load(name):
    """The model of a scene, and its run with few paths."""
    chosen = scene.load(GALLERY / f"{name}.toml")
    return chosen.model, {**chosen.run, "paths": 20}


def finer(run):
    """The run with half the step."""
    return {**run, "step": run["step"] / 2, "steps": run["steps"] * 2, "save_every": run["save_every"] * 2}


def brownian(model, run):
    """W at the saved times, (time, path)."""
    drawn = {key: run[key] for key in ("step", "steps", "paths", "seed")}
    w = np.cumsum(ss.increments(model, **drawn)[:, 0], axis=0)
    every = run["save_every"]
    return np.concatenate([np.zeros((1, w.shape[1])), w[every - 1 :: every]])


def turned(angle, x, y):
    """Points turned by an angle."""
    return np.cos(angle) * x - np.sin(angle) * y, np.sin(angle) * x + np.cos(angle) * y


def second_order(error, run):
    """The errors with a step and with half of it; the error must fall with the square of the step."""
    coarse, fine = error(run), error(finer(run))
    assert coarse < 0.02 and 3.0 < coarse / fine < 5.0, (coarse, fine)


@pytest.mark.parametrize("file", sorted(GALLERY.glob("*.toml")), ids=lambda file: file.stem)
def test_invariants_of_the_scene_are_proved(file):
    formula = getattr(scene.load(file).model, "formula", None)  # built-in models have no formula
    structure = formula and formula.structure
    assert structure is None or all(structure.invariants.values())


def test_penning_trap():
    """The axial motion is a linear oscillator whose stiffness is noisy: its second moments obey linear equations. The
    angular momentum about the field stays as it was, to rounding."""
    model, run = load("penning_trap")
    wz, s = model.parameters["wz"], model.parameters["s"]
    trap = ss.simulate(model, **{**run, "paths": 4000})
    assert "flows of a quadratic part" in trap.report.stepper or "whole steps" in trap.report.stepper
    momentum = trap.q[:, 0] * trap.p[:, 1] - trap.q[:, 1] * trap.p[:, 0]
    assert np.abs(momentum - momentum[0]).max() < 1e-13
    moments = np.array([[0, 2, 0], [-(wz**2), 0, 1], [s**2, -2 * wz**2, 0]])  # of z^2, z pz, pz^2
    values, vectors = np.linalg.eig(moments)
    z, pz = trap.q[:, 2], trap.p[:, 2]
    begin = np.linalg.solve(vectors, [z[0, 0] ** 2, z[0, 0] * pz[0, 0], pz[0, 0] ** 2])
    for n, t in enumerate(trap.t[1:], start=1):
        exact = (vectors @ (np.exp(values * t) * begin)).real
        for x, mean in zip((z[n] ** 2, z[n] * pz[n], pz[n] ** 2), exact, strict=True):
            # 15 comparisons within 4.5 standard errors: a false alarm in 1e4 runs; order two leaves 1e-3
            assert abs(x.mean() - mean) < 4.5 * x.std() / np.sqrt(x.size) + 2e-3, (t, x.mean(), mean)


def test_two_body():
    model, run = load("two_body")

    def error(run):
        found = ss.simulate(model, **run)
        angle = found.t[:, None] + 0.3 * brownian(model, run)
        x, y = found.q[:, 0], found.q[:, 1]
        assert np.abs(x * found.p[:, 1] - y * found.p[:, 0] - 1).max() < 1e-12
        return np.sqrt(np.mean((x - np.cos(angle)) ** 2 + (y - np.sin(angle)) ** 2))

    assert error(run) < 0.02
    wrong = ss.simulate(model.with_parameters(sigma=0.33), **run)
    angle = wrong.t[:, None] + 0.3 * brownian(model, run)
    assert np.sqrt(np.mean((wrong.q[:, 0] - np.cos(angle)) ** 2)) > 0.02
    second_order(lambda r: quiet_error(model, r, np.cos), run)


def quiet_error(model, run, exact):
    """Largest error of q_1 without noise."""
    found = ss.simulate(model.with_parameters(sigma=0), **{**run, "paths": 1})
    return np.abs(found.q[:, 0, 0] - exact(found.t)).max()


def test_point_vortices():
    model, run = load("point_vortices")
    found = ss.simulate(model, **run)
    angle = found.t[:, None] / (2 * np.pi) + 0.2 * brownian(model, run)
    inertia = (found.q**2 + found.p**2).sum(axis=1)
    assert np.abs(inertia - 3).max() < 1e-12
    energy = [model.value(q, p) for q, p in zip(found.q, found.p, strict=True)]
    assert np.ptp(energy) < 1e-11
    for i in range(3):
        x, y = turned(angle, found.q[0, i, 0], found.p[0, i, 0])
        assert np.sqrt(np.mean((found.q[:, i] - x) ** 2 + (found.p[:, i] - y) ** 2)) < 0.02
    # the twin: a rotation one per cent too slow would show after 20 units of time
    wrong = 0.99 * found.t[:, None] / (2 * np.pi) + 0.2 * brownian(model, run)
    x, _ = turned(wrong, 1.0, 0.0)
    assert np.abs(found.q[-1, 0] - x[-1]).mean() > 5 * np.abs(found.q[-1, 0] - turned(angle, 1.0, 0.0)[0][-1]).mean()


def test_toda_chain():
    model, run = load("toda_chain")

    def eigenvalues(q, p):
        a, n = np.exp((q - np.roll(q, -1)) / 2) / 2, len(q)
        flaschka = np.diag(-p / 2)
        for i in range(n):
            flaschka[i, (i + 1) % n] += a[i]
            flaschka[(i + 1) % n, i] += a[i]
        return np.linalg.eigvalsh(flaschka)

    def drift(run):
        found = ss.simulate(model, **{**run, "paths": 2})
        spectra = [eigenvalues(q[:, 0], p[:, 0]) for q, p in zip(found.q, found.p, strict=True)]
        return np.abs(np.array(spectra) - spectra[0]).max()

    second_order(drift, run)
    found = ss.simulate(model, **run)
    assert np.ptp(found.p.sum(axis=1)) < 1e-12
    quiet = ss.simulate(model.with_parameters(sigma=0), **run)
    np.testing.assert_allclose(found.q, quiet.q + 0.3 * brownian(model, run)[:, None], rtol=0, atol=1e-11)
    np.testing.assert_allclose(found.p, quiet.p, rtol=0, atol=1e-11)


def test_damped_oscillator():
    """False alarms: 6e-7 for the mean and for the variance (five standard errors)."""
    model, run = load("damped_oscillator")
    nu = np.sqrt(1.5**2 - 0.25**2)
    exact = lambda t: np.exp(-t / 4) * (np.cos(nu * t) + np.sin(nu * t) / (4 * nu))  # noqa: E731
    second_order(lambda r: quiet_error(model, r, exact), run)
    moments = ss.moments(model, **{**run, "paths": 4000})
    assert (np.abs(moments.mean_q[:, 0] - exact(moments.t)) < 5 * moments.se_mean_q[:, 0] + 1e-3).all()
    stationary = 0.4**2 / (2 * 0.5 * 1.5**2)
    tolerance = 5 * stationary * np.sqrt(2 / 4000)
    assert abs(moments.var_q[-1, 0] - stationary) < tolerance
    louder = ss.moments(model.with_parameters(sigma=0.46), **{**run, "paths": 4000})
    assert abs(louder.var_q[-1, 0] - stationary) > tolerance


def test_storage_ring():
    """The equilibrium emittance is sigma^2 tau/4, to .5 % for anharmonic motion and 4.9 standard errors; the standard
    error, of the square root of a determinant of normal variances, is 1/sqrt(n). With 10 % more excitation the
    emittance is 21 % larger."""
    model, run = load("storage_ring")
    observers = {"beam": ss.observe.Covariance(["phi", "p"])}
    for louder, holds in ((1.0, True), (1.1, False)):
        ring = model.with_parameters(sigma=louder * model.parameters["sigma"])
        beam = ss.moments(ring, **{**run, "paths": 4096}, observers=observers).observed["beam"]
        emittance = np.sqrt(np.linalg.det(beam.covariance[-1]))
        assert (abs(emittance / 0.0025 - 1) < 0.005 + 4.9 / np.sqrt(4096)) == holds


def test_double_well():
    """The rate is Kramers' rate to 17 % (4/beta) and 4.9 standard errors; at another temperature it differs."""
    model, run = load("double_well")
    right = {"right": "(1 + tanh(20*q))/2"}

    def rate(bath):
        found = ss.moments(bath, **{**run, "paths": 4096}, observables=right)
        left = 1 - 2 * found.mean["right"]
        span = 2 * (found.t[-1] - found.t[1])
        return np.log(left[1] / left[-1]) / span, 2 * found.se_mean["right"][-1] / left[-1] / span

    kramers = np.sqrt(2) / (2 * np.pi) * (np.sqrt(1.25) - 0.5) * np.exp(-6)
    found, error = rate(model)
    assert abs(found - kramers) < 4.9 * error + 0.17 * kramers
    hot = ss.thermostat(ss.model_from_sympy("p**2/2 + q**4/4 - q**2/2"), beta=20.0, gamma=1.0)
    found, error = rate(hot)
    assert abs(found - kramers) > 4.9 * error + 0.17 * kramers


def test_damped_chain():
    """Heat that enters at the hot end leaves at the cold one, within 4.9 standard errors of kinetic temperatures."""
    model, run = load("damped_chain")
    ends = {"hot": lambda q, p: p[0] ** 2, "cold": lambda q, p: p[-1] ** 2}
    found = ss.moments(model, **{**run, "paths": 4096}, observables=ends)
    into, out = 1.5 - found.mean["hot"][-1], found.mean["cold"][-1] - 0.5
    error = np.hypot(found.se_mean["hot"][-1], found.se_mean["cold"][-1])
    assert abs(into - out) < 4.9 * error + 0.01
    assert min(into, out) > 0.1


def test_rigid_body():
    model, run = load("rigid_body")
    found = ss.simulate(model, **run)
    assert (found.p[:, 1] == 1.0).all()
    inertia = np.array([1.0, 2.0, 3.0])

    def euler(t):
        """Euler's equations by the classical Runge-Kutta method, with steps so small that errors are 1e-11."""
        m, path = body(np.array([[0.6]]), np.array([[0.4]]))[:, 0, 0], []
        slope = lambda m: np.cross(m, m / inertia)  # noqa: E731
        h = (t[1] - t[0]) / 200
        for _ in t:
            path.append(m)
            for _ in range(200):
                a = slope(m)
                b = slope(m + h / 2 * a)
                c = slope(m + h / 2 * b)
                m = m + h / 6 * (a + 2 * b + 2 * c + slope(m + h * c))
        return np.array(path)

    def error(run):
        quiet = ss.simulate(model.with_parameters(sigma=0), **{**run, "paths": 1})
        return np.abs(body(quiet.q[:, 0], quiet.p[:, 0])[:, :, 0].T - euler(quiet.t)).max()

    second_order(error, run)


def body(angle, momentum):
    """Angular momentum in the body, (3, time, path)."""
    across = np.sqrt(1 - momentum**2)
    return np.array([across * np.sin(angle), across * np.cos(angle), momentum])


def by_kutta(slope, state, t, substeps, dw=None):
    """States at the times t by the classical Runge-Kutta method; dw (step,) is added to the second component first."""
    states, n = [np.array(state, float)], 0
    for begin, end in itertools.pairwise(t):
        y, h = states[-1], (end - begin) / substeps
        for i in range(substeps):
            at = begin + i * h
            if dw is not None:
                y = y + np.array([0.0, dw[n] / 2])
            a = slope(at, y)
            b = slope(at + h / 2, y + h / 2 * a)
            c = slope(at + h / 2, y + h / 2 * b)
            y = y + h / 6 * (a + 2 * b + 2 * c + slope(at + h, y + h * c))
            if dw is not None:
                y = y + np.array([0.0, dw[n] / 2])
            n += 1
        states.append(y)
    return np.array(states)


def test_driven_pendulum():
    model, run = load("driven_pendulum")
    a, nu = 0.1, 30.0

    def slope(t, y):
        return np.array([y[1], -(1 - a * nu**2 * np.cos(nu * t)) * np.sin(y[0])])

    def error(run):
        quiet = ss.simulate(model.with_parameters(sigma=0), **{**run, "paths": 1})
        exact = by_kutta(slope, [3.3, 0.0], quiet.t, 1000)
        return np.abs(quiet.q[:, 0, 0] - exact[:, 0]).max()

    second_order(error, run)
    noisy = ss.simulate(model, **run)
    assert np.abs(noisy.q - np.pi).max() < 1.0  # with noise it stays upright all the time; without shaking it falls
    assert np.abs(ss.simulate(model.with_parameters(a=0), **run).q - np.pi).max() > 2
    kicks = 0.02 * ss.increments(model, **{key: run[key] for key in ("step", "steps", "paths", "seed")})[:, 0, 0]
    exact = by_kutta(slope, [3.3, 0.0], noisy.t, run["save_every"], kicks)
    assert np.abs(noisy.q[:, 0, 0] - exact[:, 0]).max() < 0.01
    assert np.abs(noisy.q[:, 0, 1] - exact[:, 0]).max() > 0.02


def area(q, p):
    """Area of a polygon."""
    return 0.5 * np.abs(np.sum(q * np.roll(p, -1) - p * np.roll(q, -1)))


def test_ring():
    model, run = load("ring")
    quiet = model.with_parameters(D=0)
    angle = np.arange(400) * 2 * np.pi / 400
    curve = {"q0": 0.5 + 0.3 * np.cos(angle)[None], "p0": 0.3 * np.sin(angle)[None], "paths": 400, "steps": 400}
    found = ss.simulate(quiet, **{**run, **curve})
    areas = [area(q[0], p[0]) for q, p in zip(found.q, found.p, strict=True)]
    np.testing.assert_allclose(areas, areas[0], rtol=2e-3)  # a polygon of 400 corners
    private = ss.simulate(quiet, **{**run, **curve, "common_noise": ()})
    assert abs(area(private.q[-1, 0], private.p[-1, 0]) / areas[0] - 1) > 0.01
    # one particle at the centre: q = Omega A int sin(Omega (t-s)) dW(s); five standard errors of a variance
    law = ss.moments(quiet, **{**run, "q0": 0.0, "paths": 4000, "common_noise": (), "steps": 400})
    t = law.t[-1]
    variance = (1.3 * 0.02) ** 2 * (t / 2 - np.sin(2.6 * t) / 5.2)
    assert abs(law.var_q[-1, 0] / variance - 1) < 5 * np.sqrt(2 / 4000)
    louder = ss.moments(
        quiet.with_parameters(A=0.023), **{**run, "q0": 0.0, "paths": 4000, "common_noise": (), "steps": 400}
    )
    assert abs(louder.var_q[-1, 0] / variance - 1) > 5 * np.sqrt(2 / 4000)


def test_disordered_lattice():
    """Noise of phases alone: with H = psi^*.A psi/2 the mean of psi obeys m' = -i A m - s^2 m/2, that of psi psi^+ the
    equation of Haken and Strobl, rho' = -i [A, rho] - s^2 (rho - diag rho)."""
    model, run = load("disordered_lattice")
    n, s = model.ndof, model.parameters["s"]
    assert model.traits.turned
    found = ss.simulate(model, **{**run, "paths": 4000})
    psi = found.q + 1j * found.p
    assert np.abs((np.abs(psi) ** 2).sum(axis=1) - 1).max() < 1e-14
    matrix = np.zeros((n, n))
    for k, energy in enumerate((0.9, -0.4, 0.1, -0.8, 0.5, -0.2, 0.7, -0.6)):
        matrix[k, k], matrix[k, (k + 1) % n], matrix[(k + 1) % n, k] = energy, -1.0, -1.0
    one = np.eye(n)
    values, vectors = np.linalg.eigh(matrix)
    rates = np.kron(-1j * matrix, one) + np.kron(one, 1j * matrix) - s**2 * np.diag((1 - one).ravel())
    speeds, modes = np.linalg.eig(rates)
    begin = np.linalg.solve(modes, np.outer(one[0], one[0]).ravel().astype(complex))
    for i, t in enumerate(found.t[1:], start=1):
        mean = np.exp(-(s**2) / 2 * t) * (vectors * np.exp(-1j * values * t)) @ vectors[0]
        density = np.diag(((modes * np.exp(speeds * t)) @ begin).reshape(n, n)).real
        parts = [(psi[i].real, mean.real), (psi[i].imag, mean.imag), (np.abs(psi[i]) ** 2, density)]
        for x, exact in parts:
            # 96 comparisons within 5.5 standard errors: a false alarm in 2e5 runs; order two leaves 3e-4
            assert (np.abs(x.mean(axis=1) - exact) < 5.5 * x.std(axis=1) / np.sqrt(x.shape[1]) + 1e-3).all(), t


def test_schroedinger_lattice():
    model, run = load("schroedinger_lattice")

    def error(run):
        found = ss.simulate(model, **{**run, "paths": 20})
        norm = (found.q**2 + found.p**2).sum(axis=1)
        assert np.abs(norm - 2).max() < 1e-12
        turn = (4 * np.sin(np.pi / 8) ** 2 + 0.25) * found.t[:, None] + 0.2 * brownian(model, run)
        psi = (found.q[0] + 1j * found.p[0]) * np.exp(-1j * turn)[:, None]
        return np.abs(found.q + 1j * found.p - psi).max()

    coarse = error(run)
    assert coarse < 0.02
    quiet = model.with_parameters(sigma=0)

    def quiet_turn(run):
        found = ss.simulate(quiet, **{**run, "paths": 1})
        return np.abs(found.q[:, 0, 0] - 0.5 * np.cos((4 * np.sin(np.pi / 8) ** 2 + 0.25) * found.t)).max()

    second_order(quiet_turn, run)
    wrong = ss.simulate(model.with_parameters(g=1.05), **run)
    assert np.abs(wrong.q - ss.simulate(model, **run).q).max() > 2 * coarse


def test_peakons():
    model, run = load("peakons")
    total, energy = 1.4, (0.97**2 + 0.43**2) / 2 + 0.97 * 0.43 * np.exp(-3.25)
    spread = np.sqrt(4 * energy - total**2)
    begin = 2 / spread * np.arctanh(0.54 / spread)

    def error(run):
        found = ss.simulate(model, **run)
        exact = -spread * np.tanh(spread * (found.t - begin) / 2)
        assert np.abs(found.p.sum(axis=1) - total).max() < 1e-12
        return np.abs(found.p[:, 0] - found.p[:, 1] - exact[:, None]).max()

    second_order(error, run)
    found, quiet = ss.simulate(model, **run), ss.simulate(model.with_parameters(sigma=0), **run)
    assert np.ptp(found.p[:, 0, 0]) > 0.4  # the two particles have exchanged their speeds
    np.testing.assert_allclose(found.q, quiet.q + 0.3 * brownian(model, run)[:, None], rtol=0, atol=1e-11)
    gap = np.exp(found.q[:, 0] - found.q[:, 1])
    difference = found.p[:, 0] - found.p[:, 1]
    product = (total**2 - spread**2) / (total**2 - difference**2)  # 1 - exp(q_1 - q_2)
    assert np.abs(1 - gap - product).max() < 1e-4
