# SPDX-License-Identifier: BSD-3-Clause
"""The scenes of examples/gallery: each against its exact solution, and with its invariants."""

from pathlib import Path

import numpy as np
import pytest
import symsde as ss
from symsde import scene

pytest.importorskip("sympy")

from symsde.formulas import compiler

if compiler.command() is None:
    pytest.skip("no C compiler", allow_module_level=True)

GALLERY = Path(__file__).parents[2] / "examples" / "gallery"


def load(name):
    """The model of a scene and its run, with few paths."""
    chosen = scene.load(GALLERY / f"{name}.toml")
    return chosen.model, {**chosen.run, "paths": 20}


def finer(run):
    """Half the step."""
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
    """Errors of two steps, the second half the first: they go with the square of the step."""
    coarse, fine = error(run), error(finer(run))
    assert coarse < 0.02 and 3.0 < coarse / fine < 5.0, (coarse, fine)


@pytest.mark.parametrize("file", sorted(GALLERY.glob("*.toml")), ids=lambda file: file.stem)
def test_invariants_of_the_scene_are_proved(file):
    structure = scene.load(file).model.formula.structure
    assert structure is None or all(structure.invariants.values())


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
    # a turn that is too slow by one percent would be seen, after 20 units of time
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


def test_rigid_body():
    model, run = load("rigid_body")
    found = ss.simulate(model, **run)
    assert (found.p[:, 1] == 1.0).all()
    inertia = np.array([1.0, 2.0, 3.0])

    def euler(t):
        """Euler's equations by the classical method of order four, in steps that leave 1e-11."""
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
