# SPDX-License-Identifier: BSD-3-Clause
"""Symplecticity, action, Euler-Lagrange residuals, exact solutions, convergence."""

import numpy as np
import pytest
import symsde as ss


@pytest.mark.parametrize("scheme", ["midpoint", "symplectic_euler", "stormer_verlet", "gauss2", "lobatto3"])
def test_symplectic(scheme):
    points = np.linspace(-1, 1, 24).reshape(2, 12)
    defect = ss.diagnose.symplecticity(ss.models.henon_heiles(), scheme, q=points, p=points[::-1], step=0.2, seed=3)
    assert defect.shape == (12,)
    assert defect.max() < 1e-13


@pytest.mark.parametrize("scheme", ["heun", "euler_maruyama"])
def test_contrasts_are_not_symplectic(scheme):
    defect = ss.diagnose.symplecticity(ss.models.kubo(), scheme, q=1.0, p=0.5, step=0.2, dw=0.3)
    assert defect.max() > 1e-4


def test_euler_lagrange_residuals_and_action():
    run = ss.simulate(ss.models.synchrotron(), q0=0.3, p0=0.0, step=0.02, steps=50, paths=7, seed=2)
    residual = ss.diagnose.euler_lagrange_residual(run)
    assert residual.shape == (4, 7) and residual.max() < 1e-13
    action = ss.diagnose.action(run)
    assert action.shape == (50, 7)
    dw = ss.increments(run.model, step=0.02, steps=50, paths=7, seed=2)
    q, p = ((x[1:, 0] + x[:-1, 0]) / 2 for x in (run.q, run.p))
    hamiltonians = 0.02 * (p**2 / 2 - 4 * np.cos(q)) + dw[:, 0] * 0.2 * np.sin(q) - dw[:, 1] * 0.1 * np.cos(q)
    np.testing.assert_allclose(action, p * np.diff(run.q[:, 0], axis=0) - hamiltonians, rtol=0, atol=1e-15)
    run.q = run.q + 1e-3 * np.sin(np.arange(51.0))[:, None, None]
    assert ss.diagnose.euler_lagrange_residual(run).max() > 1e-5


def test_action_with_refine_and_given_increments(kubo):
    dw = ss.increments(kubo, step=0.01, steps=32, paths=3, seed=2)
    common = {"q0": 1.0, "p0": 0.0, "step": 0.04, "steps": 8, "paths": 3, "refine": 2}
    drawn, given = ss.simulate(kubo, seed=2, **common), ss.simulate(kubo, increments=dw, **common)
    np.testing.assert_array_equal(ss.diagnose.action(drawn), ss.diagnose.action(given))
    assert ss.diagnose.euler_lagrange_residual(given).max() < 1e-14


def test_exact_solution_of_kubo(kubo, options):
    run = ss.simulate(kubo, **options)
    q, p = ss.diagnose.exact(run)
    assert q.shape == run.q.shape
    dw = ss.increments(kubo, step=0.05, steps=40, paths=12, seed=7)
    angle = run.t[-1] + 0.3 * dw[:, 0].sum(axis=0)
    np.testing.assert_allclose(q[-1, 0], np.cos(angle), rtol=0, atol=1e-13)
    np.testing.assert_allclose(p[-1, 0], -np.sin(angle), rtol=0, atol=1e-13)


def test_convergence_against_the_exact_solution(kubo):
    table = ss.convergence(kubo, "midpoint", q0=1.0, p0=0.0, steps=[16, 32, 64, 128], paths=2000, seed=1)
    assert table.reference == "the exact solution"
    assert table.order_low < table.order < table.order_high < table.order_low + 0.2
    assert abs(table.order - 1) < 0.12
    assert (table.low < table.error).all() and (table.error < table.high).all()
    assert "order" in str(table) and len(str(table).splitlines()) == 7


def test_convergence_against_a_finer_path():
    pendulum = ss.models.pendulum()
    common = {"q0": 1.0, "p0": 0.0, "steps": [16, 32, 64], "paths": 1000, "halvings": 4, "seed": 1}
    table = ss.convergence(pendulum, "symplectic_euler", **common)
    assert abs(table.order - 1) < 0.15 and "gauss2" in table.reference
    wrong = ss.convergence(pendulum, "symplectic_euler", correction="none", **common)
    assert wrong.order < 0.5  # converges to another equation


def test_plot(kubo):
    pytest.importorskip("matplotlib")
    axes = ss.convergence(kubo, q0=1.0, p0=0.0, steps=[4, 8], paths=100).plot()
    assert axes.get_xscale() == "log" and axes.get_legend() is not None
