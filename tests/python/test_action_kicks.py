# SPDX-License-Identifier: BSD-3-Clause
"""Kicks by functions of the actions (q_k^2 + p_k^2)/2 between exact flows of a quadratic coupling: every plane
(q_k, p_k) turns by an angle of its own."""

import warnings

import axes
import numpy as np
import pytest
import reference
import symsde as ss
from symsde import errors

#: hopping and pairing of three sites, an on-site squeeze and a frequency
COUPLED = np.array(
    [
        [0.7, 0.4, 0.0, 0.3, -0.5, 0.2],
        [0.4, 0.1, -0.6, 0.1, 0.0, 0.3],
        [0.0, -0.6, 0.4, 0.0, -0.2, 0.0],
        [0.3, 0.1, 0.0, 0.9, 0.2, 0.1],
        [-0.5, 0.0, -0.2, 0.2, 0.3, -0.6],
        [0.2, 0.3, 0.0, 0.1, -0.6, 0.4],
    ]
)
STRENGTH = np.array([[0.6, -0.2, 0.1], [0.3, 0.5, 0.0], [-0.1, 0.2, 0.4], [0.2, 0.0, -0.5]])  #: u_k of four noises
NODES = (0.5 - np.sqrt(3) / 6, 0.5 + np.sqrt(3) / 6)


class Spins:
    """H = z.S z/2 + sum_i I_i^2/2 + cos(I_1 I_2), and noises K_k = sin(u_k.I) cos t + .2 u_k.I, each a
    function of several actions."""

    def __init__(self, second=COUPLED, strength=STRENGTH):
        self.second, self.strength = second, strength
        self.ndof, self.nnoise = len(second) // 2, len(strength)

    def angles(self, t, w, q, p):
        """dK/dI_i of the weighted sum without the quadratic part, (ndof, lane)."""
        action = (q**2 + p**2) / 2
        theta = w[0] * action
        turn = w[0] * np.sin(action[0] * action[1])
        theta[0] -= turn * action[1]
        theta[1] -= turn * action[0]
        slope = np.cos(t) * np.cos(self.strength @ action) + 0.2
        return theta + self.strength.T @ (w[1:] * slope)

    def gradient(self, t, w, q, p):
        theta = self.angles(t, w, q, p)
        hq, hp = np.split(self.second @ np.concatenate([q, p]) * w[0], 2)
        return hq + theta * q, hp + theta * p

    def model(self, **traits):
        given = {"split": self.second, "kicks": "actions"}
        return ss.Model(ndof=self.ndof, nnoise=self.nnoise, gradient=self.gradient, **given | traits)

    def step(self, t, drive, x, rates=0.0):
        """gauss_dkdkd with complex numbers psi = q + i p, which a kick multiplies by exp(-i theta)."""
        n, h, before = self.ndof, drive.h, 0.0
        field = np.concatenate([self.second[n:], -self.second[:n]]) - np.diag(
            [*np.zeros(n), *np.broadcast_to(rates, n)]
        )
        a = drive.z / h - drive.w / 2
        for node, sign in zip(NODES, (1, -1), strict=True):
            x = reference.exponential((node - before) * h * field) @ x
            w = np.concatenate([np.full_like(a[:1], h / 2), drive.w / 2 + sign * np.sqrt(3) * a])
            psi = (x[:n] + 1j * x[n:]) * np.exp(-1j * self.angles(t + node * h, w, x[:n], x[n:]))
            x, before = np.concatenate([psi.real, psi.imag]), node
        return reference.exponential((1 - before) * h * field) @ x


class Ring(Spins):
    """i dpsi_k = -(psi_{k-1} + psi_{k+1}) dt + |psi_k|^2 psi_k dt + s psi_k o dW_k on a ring."""

    def __init__(self, n=6, s=0.6):
        hop = np.zeros((n, n))
        for k in range(n):
            hop[k, (k + 1) % n] = hop[(k + 1) % n, k] = -1
        super().__init__(np.kron(np.eye(2), hop), s * np.eye(n))

    def angles(self, t, w, q, p):
        return w[0] * (q**2 + p**2) + self.strength @ w[1:]


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("rates", [None, (0.7, 0.2, 0.4)], ids=["closed", "damped"])
def test_steps_are_those_of_the_equations(sign, rates):
    h, steps, rows, paths = 0.2 * sign, 3, 4, 5
    spins = Spins()
    model = spins.model() if rates is None else spins.model().damped(rates)
    q0, p0 = axes.start(3, paths)
    q0[1, 2] = p0[1, 2] = 0  # a site at rest has no angle
    dw = axes.rows_of(h, steps, rows, 4, paths)
    given = {"step": h, "steps": steps, "scheme": "gauss_dkdkd", "refine": 2}
    run = ss.simulate(model, q0=q0, p0=p0, paths=paths, increments=dw, **given)
    x = np.concatenate([q0, p0])
    for n in range(steps):
        drive = reference.polygon(h, dw[rows * n : rows * (n + 1)])
        x = spins.step(n * h, drive, x, rates=0.0 if rates is None else rates)
        np.testing.assert_allclose(np.concatenate([run.q[n + 1], run.p[n + 1]]), x, rtol=0, atol=5e-14)
    one = ss.simulate(model, q0=q0[:, 3:4], p0=p0[:, 3:4], paths=1, increments=dw[:, :, 3:4], **given)
    np.testing.assert_array_equal([one.q[:, :, 0], one.p[:, :, 0]], [run.q[:, :, 3], run.p[:, :, 3]])


def test_strong_orders_and_norm_of_a_ring():
    """The ring of another program: its errors over 300 paths, slopes that fall from 1.78 to 1.56, its norm to 9e-14;
    300 fixed paths are within a tenth of the law of the errors."""
    ring, levels, paths = Ring(), range(3, 8), 300
    q0 = np.linspace(0.3, 1.0, 6)

    def last(level):
        given = {"step": 2.0**-level, "steps": 2**level, "save_every": 2**level, "refine": 12 - level}
        run = ss.simulate(ring.model(), q0=q0, p0=0 * q0, seed=3, paths=paths, scheme="gauss_dkdkd", **given)
        norm = (run.q**2 + run.p**2).sum(axis=1)
        assert np.abs(norm - norm[0]).max() < 2e-13
        return np.concatenate([run.q[-1], run.p[-1]])

    exact = last(12)
    found = np.array([np.sqrt(((last(k) - exact) ** 2).sum(axis=0).mean()) for k in levels])
    slopes = np.log2(found[:-1] / found[1:])
    np.testing.assert_allclose(found, [7.1e-3, 2.1e-3, 6.7e-4, 2.2e-4, 7.4e-5], rtol=0.1)
    assert 1.68 < slopes[0] < 1.88
    assert 1.48 < slopes[-1] < 1.64


def test_steps_are_symplectic():
    q, p = [0.6, 0.2, -0.5], [0.3, -0.4, 0.1]
    residual = ss.diagnose.symplecticity(Spins().model(), "gauss_dkdkd", q=q, p=p, step=0.2)
    assert residual[0] < 1e-12, residual


def test_what_is_refused():
    spins = Spins()
    given = {"q0": [0.6, 0.2, -0.5], "p0": [0.3, -0.4, 0.1], "step": 0.1, "steps": 2}
    for scheme in ("chin4a", "verlet_kdk", "gauss_dkdkd_strong2", "chin4a_strong2"):
        with pytest.raises(errors.IncompatibleError, match=r"brackets \{K_i, \{K_j, D\}\}.*use gauss_dkdkd"):
            ss.simulate(spins.model(), scheme=scheme, **given)
    with pytest.raises(errors.IncompatibleError, match="trait position_noise"):
        ss.simulate(spins.model(split=None, kicks="positions"), scheme="gauss_dkdkd", **given)
    for other in (COUPLED + np.diag([0.1, 0, 0, 0, 0, 0]), COUPLED + 0.1):
        with pytest.raises(errors.FalseTraitError, match=r"\{\(q\^2 \+ p\^2\)/2, H_0 - D\}"):
            ss.simulate(spins.model(split=other), scheme="gauss_dkdkd", **given)
    uneven = Spins()
    uneven.gradient = lambda t, w, q, p: [
        x + w[1] * y for x, y in zip(spins.gradient(t, w, q, p), (1, 0 * q), strict=True)
    ]
    with pytest.raises(errors.FalseTraitError, match=r"\{\(q\^2 \+ p\^2\)/2, H_1\}"):
        ss.simulate(uneven.model(), scheme="gauss_dkdkd", **given)
    with pytest.raises(errors.InvalidArgumentError, match="without split"):
        spins.model(split=None)
    with pytest.raises(errors.UnknownNameError, match="kicks = 'momenta'"):
        spins.model(kicks="momenta")
    pushed = spins.model().forced(lambda q, p, t: -q, position_force=True)
    with pytest.raises(errors.IncompatibleError, match="do not commute with a force"):
        ss.simulate(pushed, scheme="gauss_dkdkd", **given)


def test_long_steps_of_turns_need_no_warning():
    """Drift and turns are exact at any h: the step is short while the slower of the two is. Midpoint is warned of."""
    how = {"q0": [0.5, 0.2, -0.4], "p0": [0.1, 0.3, 0.2], "step": 2.0, "steps": 1, "paths": 4, "seed": 1}
    with warnings.catch_warnings():
        warnings.simplefilter("error", errors.DoubtfulRunWarning)
        ss.simulate(Spins().model(), scheme="gauss_dkdkd", **how)
    with pytest.warns(errors.DoubtfulRunWarning, match=r"h\*omega"):
        ss.simulate(Spins().model(), scheme="midpoint", **how)
