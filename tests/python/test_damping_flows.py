# SPDX-License-Identifier: BSD-3-Clause
"""Damping between kicks that are not free: rotations, midpoint steps, and Verlet with dZ."""

import numpy as np
import pytest
import symsde as ss
from mpmath import mp
from symsde.errors import DoubtfulRunWarning, IncompatibleError

pytestmark = pytest.mark.usefixtures("quick_compiler")

ROTATIONS = ("gauss_dkdkd_rotation", "exact_rotation")
FLOWS = (*ROTATIONS, "gauss_dkdkd_midpoint", "verlet_kdk_midpoint", "verlet_dz")
SPRINGS = ss.model_from_sympy("(p1**2 + p2**2)/2 + w**2*q1**2/2 + q2**2", noise=["-s*q1"], params={"w": 2.0, "s": 0.0})
SOFT = ss.model_from_sympy(
    "(p1**2 + p2**2)/2 + q1**2/2 + q2**2 + q1**4/4 + q1**2*q2**2/2", noise=["-0.5*q1", "0.4*q2 - 0.1*q1"]
)
FREE = ss.model_from_sympy("p**2/2", noise=["-q"])


def one_step(model, scheme, step, **options):
    """The matrix of one step of a linear model: a column for each state of one unit."""
    n, unit = model.ndof, np.eye(2 * model.ndof)
    run = ss.simulate(model, q0=unit[:n], p0=unit[n:], step=step, steps=1, paths=2 * n, scheme=scheme, **options)
    return np.concatenate([run.q[-1], run.p[-1]])


def exact(omega, friction, tau):
    """exp(tau A) of q'' = -omega^2 q - friction q' in 40 digits."""
    n = len(omega)
    with mp.workdps(40):
        field = mp.zeros(2 * n)
        for i in range(n):
            field[i, n + i] = 1
            field[n + i, i] = -(mp.mpf(omega[i]) ** 2)
            for j in range(n):
                field[n + i, n + j] = -mp.mpf(friction[i][j])
        return np.array(mp.expm(mp.mpf(tau) * field).tolist(), dtype=float)


@pytest.mark.filterwarnings("ignore::symsde.errors.DoubtfulRunWarning")
@pytest.mark.parametrize("rate", [1e-12, 1e-6, 0.3, 3.99999999, 4.0, 4.00000001, 4.3, 7.0, 80.0, -1.0, -5.0])
@pytest.mark.parametrize("step", [0.5, 1e-4, -0.25])
def test_rotations_decay_exactly(rate, step):
    """Rotations between kicks move springs exactly: weak, critical and strong damping, gamma h from 1e-16 to 40, and
    gain.
    """
    model = SPRINGS.damped(rate, allow_gain=True)
    known = exact((2.0, np.sqrt(2)), np.diag([rate, rate]), step)
    scale = np.maximum(1, np.abs(known).max())
    np.testing.assert_allclose(one_step(model, "gauss_dkdkd_rotation", step), known, rtol=0, atol=8e-15 * scale)
    np.testing.assert_allclose(one_step(model, "exact_rotation", step), known, rtol=0, atol=8e-15 * scale)


@pytest.mark.filterwarnings("ignore::symsde.errors.DoubtfulRunWarning")
@pytest.mark.parametrize("step", [0.5, 1e-4, -0.25])
def test_rotations_couple_by_friction(step):
    """A matrix of friction turns all degrees of freedom at once; a diagonal matrix has the effect of unequal rates."""
    for friction in ([[0.9, -0.5], [-0.5, 1.6]], [[30.0, -30.0], [-30.0, 30.0]], [[0.7, 0.0], [0.0, 2.0]]):
        known = exact((2.0, np.sqrt(2)), friction, step)
        for scheme in ROTATIONS:
            found = one_step(SPRINGS.damped(friction), scheme, step)
            np.testing.assert_allclose(found, known, rtol=0, atol=2e-14 * np.abs(known).max())
            assert np.linalg.det(found) == pytest.approx(np.exp(-step * np.trace(friction)), rel=1e-9)
    by_rates = one_step(SPRINGS.damped([0.7, 2.0]), "gauss_dkdkd_rotation", step)
    np.testing.assert_allclose(by_rates, known, rtol=0, atol=2e-14)


@pytest.mark.parametrize("scheme", FLOWS)
def test_form_and_volume(scheme):
    """One rate multiplies dp ^ dq by exp(-gamma h), unequal rates and a matrix volume by their factor, to rounding."""
    defect = ss.diagnose.symplecticity(SOFT.damped(1.7), scheme, q=[0.4, -0.3], p=[0.2, 0.5], step=0.3)
    assert defect.max() < 1e-11
    for damping, trace in (([0.5, 1.5], 2.0), ([[0.9, -0.5], [-0.5, 1.6]], 2.5)):
        matrix = one_step(SPRINGS.damped(damping), scheme, 0.3)
        assert np.linalg.det(matrix) == pytest.approx(np.exp(-0.3 * trace), rel=1e-13)


@pytest.mark.parametrize("scheme", FLOWS)
def test_no_damping_changes_no_bit(scheme):
    """gamma = 0 gives the bits of the model without damping."""
    given = {"q0": 0.3, "p0": 0.1, "step": 0.1, "steps": 10, "paths": 20, "scheme": scheme, "seed": 4}
    one, other = (ss.simulate(model, **given) for model in (SOFT, SOFT.damped(0.0)))
    np.testing.assert_array_equal(one.q, other.q)
    np.testing.assert_array_equal(one.p, other.p)


def test_stiff_springs_do_not_bound_the_step():
    """At omega h = 6 damped rotations have a small error, while kicks of the spring are unstable."""
    stiff = ss.model_from_sympy("(p1**2 + p2**2)/2 + 450*q1**2 + q2**2/2 + q1*q2**2/4 + q2**4/4", noise=["-0.3*q2"])
    stiff = stiff.damped(0.5)
    given = {"q0": [0.01, 0.7], "p0": 0.1, "paths": 20, "seed": 1}
    fine = ss.simulate(stiff, step=1 / 1280, steps=1280, save_every=1280, scheme="gauss_dkdkd", **given)
    far = ss.simulate(stiff, step=0.2, steps=5, save_every=5, scheme="gauss_dkdkd_rotation", refine=8, **given)
    assert np.sqrt(np.mean((far.q[-1, 1] - fine.q[-1, 1]) ** 2)) < 0.01
    with np.errstate(all="ignore"), pytest.warns(DoubtfulRunWarning, match="stability limit"):
        lost = ss.simulate(stiff, step=0.2, steps=5, save_every=5, scheme="gauss_dkdkd", refine=8, **given)
    assert not np.sqrt(np.mean((lost.q[-1, 1] - fine.q[-1, 1]) ** 2)) < 0.1


@pytest.mark.parametrize(("rate", "horizon"), [(2.0, 2.0), (1e-12, 1.0), (40.0, 1.0), (-1.5, 1.0), (2.0, -1.0)])
def test_verlet_with_dz_moves_free_particles_by_the_law(rate, horizon):
    """With the noise of the path a free particle ends alike at all levels; with noise in law variances are those of
    free motion, found by one step on dW and one on a.
    """
    model = FREE.damped(rate, allow_gain=True)
    given = {"q0": 0.7, "p0": 0.3, "seed": 3, "paths": 50, "scheme": "verlet_dz"}
    ends = []
    for k in (0, 2, 5, 6, 7):
        run = ss.simulate(model, step=horizon / 2**k, steps=2**k, save_every=2**k, refine=6 - k, damping_noise="path",
                          **given)  # fmt: skip
        ends.append(np.concatenate([run.q[-1], run.p[-1]]))
        np.testing.assert_allclose(ends[-1], ends[0], rtol=0, atol=3e-14 * np.abs(ends[0]).max())
    rows = np.zeros((1, 2, 2))
    rows[0, 0, 0], rows[0, 1, 0], rows[0, 1, 1] = 1.0, 0.5 * horizon, horizon  # dW = 1 with a = 0, then a = 1
    run = ss.simulate(model, q0=0.0, p0=0.0, step=horizon, steps=1, scheme="verlet_dz", increments=rows, paths=2)
    D, E = run.q[-1, 0] / horizon, run.p[-1, 0]
    z = rate * horizon
    with mp.workdps(50):
        y = mp.mpf(z)
        known = [(1 - mp.exp(-2 * y)) / (2 * y), ((1 - mp.exp(-y)) / y) ** 2 / 2,
                 (2 * y - 3 + 4 * mp.exp(-y) - mp.exp(-2 * y)) / (2 * y**3)]  # fmt: skip
    found = [E[0] ** 2 + E[1] ** 2 / 12, E[0] * D[0] + E[1] * D[1] / 12, D[0] ** 2 + D[1] ** 2 / 12]
    np.testing.assert_allclose(found, np.array(known, dtype=float), rtol=3e-13)


def test_strong_damping_of_verlet_with_dz():
    """Strong order 2 at gamma = 10 with every choice of the noise; along the path errors are smaller."""
    well = ss.model_from_sympy("p**2/2 + q**4/4 - q**2/2", noise=["-1.4*q"]).damped(10.0)
    given = {"q0": 0.7, "p0": 0.3, "seed": 3, "paths": 100}

    def end(scheme, k, noise):
        run = ss.simulate(well, step=1 / 2**k, steps=2**k, save_every=2**k, refine=10 - k, scheme=scheme,
                          damping_noise=noise, **given)  # fmt: skip
        return np.concatenate([run.q[-1], run.p[-1]])

    fine, errors = end("chin4a", 10, "path"), {}
    for noise in ("law", "path", "polynomial"):
        coarse, finer = (np.sqrt(np.mean(np.sum((end("verlet_dz", k, noise) - fine) ** 2, axis=0))) for k in (5, 7))
        assert np.log2(coarse / finer) / 2 > 1.75
        errors[noise] = coarse
    assert errors["path"] < 0.3 * errors["law"]


def test_what_is_said():
    """Polynomial weights at gamma h = 3 have a wrong temperature, of which a warning tells; where flows between
    kicks are not linear, no other noise is accepted, and between rotations none along the path.
    """
    given = {"q0": 0.1, "p0": 0.0, "step": 1.0, "steps": 1}
    with pytest.raises(IncompatibleError, match="with one rate alone"):
        ss.simulate(SOFT.damped(1.0), scheme="gauss_dkdkd_rotation", damping_noise="path", **given)
    for scheme in ("exact_rotation", "gauss_dkdkd_midpoint", "verlet_kdk_midpoint"):
        with pytest.warns(DoubtfulRunWarning, match="times the right mean"):
            ss.simulate(SOFT.damped(3.0), scheme=scheme, **given)
        with pytest.raises(IncompatibleError, match="no kicks between free drifts"):
            ss.simulate(SOFT.damped(1.0), scheme=scheme, damping_noise="path", **given)
    # the number is found by one step from rest on dW and one on a; polynomial weights are judged likewise
    rate, rows = 3.0, np.zeros((1, 2, 2))
    rows[0, 0, 0], rows[0, 1, 0], rows[0, 1, 1] = 1.0, 0.5, 1.0
    for scheme, noise in (("gauss_dkdkd_midpoint", "law"), ("gauss_dkdkd", "polynomial"), ("verlet_dz", "polynomial")):
        how = {**given, "scheme": scheme, "damping_noise": noise}
        with pytest.warns(DoubtfulRunWarning, match="times the right mean"):
            p = ss.simulate(FREE.damped(rate), increments=rows, paths=2, **{**how, "q0": 0.0}).p[-1, 0]
        found = (p[0] ** 2 + p[1] ** 2 / 12) * 2 * rate / (1 - np.exp(-2 * rate))
        with pytest.warns(DoubtfulRunWarning, match=f"at rest {found:.5g}"):
            ss.simulate(FREE.damped(rate), **how)
