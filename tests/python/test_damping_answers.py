# SPDX-License-Identifier: BSD-3-Clause
"""Results that are computed for damped models: orders of convergence, advice, expectations, second moments."""

import math
import re

import numpy as np
import pytest
import symsde as ss
from symsde.answers.linear_stability import stable_up_to
from symsde.cli import command_line
from symsde.errors import IncompatibleError

pytestmark = pytest.mark.usefixtures("quick_compiler")

RATE = 0.8
WELL = ss.model_from_sympy("p**2/2 + q**4/4 - q**2/2", noise=["-s*q"], params={"s": 1.4}).damped(RATE)
SYNCHROTRON = ss.models.synchrotron(omega=2.0, sigma1=0.8, sigma2=0.5).damped(RATE)
BENT = ss.model_from_sympy("p**2/2 + cos(q)*(1 + p**2/8)", noise=["0.3*sin(q)"]).damped(RATE)
COUPLED = ss.models.noncommutative_oscillator().damped(RATE)
HEAVY = ss.model_from_sympy("p1**2/2 + p2**2/6 + cos(q1 - q2) + q1**2", noise=["0.3*sin(q1)", "0.2*q2"])
UNEQUAL, FRICTION = HEAVY.damped([0.5, 1.5]), HEAVY.damped([[0.9, -0.5], [-0.5, 1.6]])
STILL = ss.models.pendulum(sigma=0.0).damped(RATE)
CHAIN = ss.models.fpu_chain(n=6, sigma=0.5).damped(RATE)
GIVEN = {"q0": 0.7, "p0": 0.3, "horizon": 1.0}


@pytest.mark.parametrize(
    ("model", "scheme", "order"),
    [
        (WELL, "midpoint", 1.0), (WELL, "gauss_dkdkd", 2.0), (WELL, "chin4a", 3.0),
        (SYNCHROTRON, "gauss_dkdkd_strong2", 2.0), (SYNCHROTRON, "chin4a_strong2", 2.0),
        (BENT, "midpoint", 1.0), (BENT, "gauss2", 1.0), (COUPLED, "midpoint_areas", 1.0), (COUPLED, "midpoint", 0.5),
        (UNEQUAL, "stormer_verlet", 1.0), (FRICTION, "midpoint", 1.0), (FRICTION, "gauss_dkdkd", 1.5),
        (STILL, "midpoint", 2.0), (STILL, "gauss2", 4.0), (CHAIN, "midpoint", 1.0), (CHAIN, "verlet_kdk", 2.0),
    ],
)  # fmt: skip
def test_orders_of_convergence(model, scheme, order):
    """A reference that runs damped models is found without being named; orders are the orders of the closed systems."""
    found = ss.convergence(model, scheme, **GIVEN, steps=[8, 16, 32, 64], paths=200, seed=2)
    assert found.order > order - 0.2, found


@pytest.mark.parametrize("model", [WELL, SYNCHROTRON, BENT, COUPLED, UNEQUAL, FRICTION, STILL])
def test_advice_is_a_scheme_that_runs(model):
    """The advice runs, and no sentence of it names a scheme that refuses damped models."""
    advice = ss.advise(model, **GIVEN, tolerance=3e-2, seed=1)
    for option in (advice, *advice.alternatives):
        run = ss.simulate(model, q0=0.7, p0=0.3, step=0.1, steps=2, scheme=option.scheme, seed=1)
        assert run.report.status == 0 and "damped" in run.report.stepper
    assert not re.search("strong32|weak", " ".join(advice.reasons))


@pytest.mark.parametrize("method", ["plain", "multilevel"])
def test_expectations(method):
    """E p^2 of dp = -q dt - p/2 dt + dW, dq = p dt from rest at t = 4, within two half widths (8e-5 each)."""
    model = ss.models.linear_oscillator(sigma=1.0).damped(0.5)
    for scheme in ("midpoint", "gauss_dkdkd"):
        found = ss.expect(model, "p**2", q0=0.0, p0=0.0, horizon=4.0, abs=2e-2, method=method, scheme=scheme, seed=4)
        assert abs(found.value - 0.8913547910283172) < 2 * found.half_width <= 4.2e-2
    chosen = ss.expect(model, "p**2", q0=0.0, p0=0.0, horizon=4.0, abs=2e-2, seed=4)
    assert abs(chosen.value - 0.8913547910283172) < 2 * chosen.half_width


@pytest.mark.parametrize("h", [0.1, -0.1])
def test_second_moments_by_hand(h):
    """|M|^2 of a damped oscillator is exp(-gamma h) while it oscillates; Kubo's noise changes |z| by the damping
    alone.
    """
    oscillator = ss.models.linear_oscillator().damped(0.5)
    for scheme in ("midpoint", "gauss2", "stormer_verlet", "gauss_dkdkd", "chin4a"):
        found = ss.mean_square(oscillator, scheme, step=h)
        assert found.growth == pytest.approx(math.exp(-0.5 * h), rel=1e-12)
        assert found.exact == pytest.approx(math.exp(-0.5 * h), rel=1e-12)
    # d/dt E(q^2, q p, p^2) of dq = (a dt + s o dW) p, dp = -(a dt + s o dW) q - g p dt
    a, s, g = 1.0, 0.4, 0.5
    rates = np.array([[-s * s, 2 * a, s * s], [-a, -2 * s * s - g, a], [s * s, -2 * a, -s * s - 2 * g]])
    kubo = ss.models.kubo(a=a, sigma=s).damped(g)
    if h > 0:
        found = ss.mean_square(kubo, "gauss2", step=h)
        assert found.exact == pytest.approx(math.exp(h * np.linalg.eigvals(rates).real.max()), rel=1e-10)
        assert abs(found.excess) < 1e-3 and abs(ss.mean_square(kubo, "gauss2", step=h / 2).excess) < 3e-4
        wrong = ss.mean_square(ss.models.kubo(a=a, sigma=s).damped(1.01 * g), "gauss2", step=h)
        assert abs(wrong.exact / found.exact - 1) > 1e-4


@pytest.mark.parametrize("damping", [0.7, [0.5, 1.5], [[0.9, -0.5], [-0.5, 1.6]]])
def test_second_moments_of_every_kind_of_damping(damping):
    """The growth by steps tends to the growth by the equations, with the order of the scheme; det M is exp(-h tr)."""
    model = ss.model_from_sympy("p1**2/2 + 0.4*p1*p2 + 0.25*p2**2 + q1**2 + q1*q2 + 2*q2**2", noise=["0.3*q1*q2"])
    model = model.damped(damping)
    for scheme in ("midpoint", "gauss_dkdkd"):  # schemes of weak order one or more
        excess = [abs(ss.mean_square(model, scheme, step=h).excess) / h for h in (0.1, 0.05)]
        assert excess[0] / excess[1] > 1.7 and excess[1] < 2e-2, scheme
    sizes = np.linalg.det(ss.mean_square(model, "midpoint", step=0.1).matrix)
    inverse = np.array([[1.0, 0.4], [0.4, 0.5]])
    trace = np.trace(np.array(damping) @ inverse) if np.ndim(damping) == 2 else np.sum(np.broadcast_to(damping, 2))
    assert np.isfinite(sizes) and trace > 0
    still = ss.model_from_sympy("p1**2/2 + 0.4*p1*p2 + 0.25*p2**2 + q1**2 + q1*q2 + 2*q2**2").damped(damping)
    volume = np.linalg.det(ss.mean_square(still, "midpoint", step=0.1).matrix)  # det (M x M) = det(M)^8
    assert volume == pytest.approx(math.exp(-0.8 * trace), rel=1e-10)


def test_second_moments_refuse_what_steps_refuse():
    """`mean_square` refuses with the sentence with which a run refuses."""
    with pytest.raises(IncompatibleError, match="is damped, and scheme gauss2_strong32 adds brackets"):
        ss.mean_square(ss.model_from_sympy("p**2/2 + q**2/2", ["0.3*q**2"]).damped(RATE), "gauss2_strong32", step=0.1)


@pytest.mark.parametrize("ratio", [0.0, 0.01, 0.35, 4.0])
def test_limits_of_a_damped_oscillator_by_hand(ratio):
    """omega h at which tr M = -(1 + det M), gamma = ratio omega: h phi omega^2 = 2 (1 + exp(-z)) for Verlet's kicks,
    whose drift is phi = (1 - exp(-z))/gamma, and (omega h)^2 = 2 (1 + exp(-z)) for the one-sided step, whose decay is
    last.
    """

    def above(x, length):
        return x * length(x) > 2 * (1 + math.exp(-ratio * x))

    for scheme, length in (("symplectic_euler", lambda x: x),
                           ("verlet_kdk", lambda x: -math.expm1(-ratio * x) / ratio if ratio else x)):  # fmt: skip
        low, high = 0.0, 100.0
        for _ in range(60):
            middle = (low + high) / 2
            low, high = (low, middle) if above(middle, length) else (middle, high)
        assert stable_up_to(scheme, ratio)[0] == pytest.approx(low, rel=1e-5), scheme
    assert stable_up_to("midpoint", ratio)[0] == math.inf


def test_scenes_of_damped_models(tmp_path, capsys):
    """`symsde study` and `symsde advise` accept scenes of damped models."""
    file = tmp_path / "scene.toml"
    file.write_text(
        '[model]\nname = "synchrotron"\ndamping = 0.8\n[run]\nstep = 0.05\nsteps = 20\nq0 = 0.7\np0 = 0.3\nseed = 5\n',
        encoding="utf-8",
    )
    assert command_line.main(["advise", str(file), "--tolerance", "3e-2"]) == 0
    assert "strong32" not in capsys.readouterr().out
    assert command_line.main(["stability", str(file)]) == 0
    told = capsys.readouterr().out
    assert "linear oscillator damped by gamma = 0.8 without noise" in told
    one = next(line for line in told.splitlines() if line.startswith("symplectic_euler"))
    omega = float(re.search(r"frequency ([\d.]+)", told)[1])
    limit = stable_up_to("symplectic_euler", 0.8 / omega)[0]
    assert limit < 1.99 and float(one.split()[1]) == pytest.approx(limit, rel=1e-2)
