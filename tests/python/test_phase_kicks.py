# SPDX-License-Identifier: BSD-3-Clause
"""Noises of phases, linear in the actions (q_k^2 + p_k^2)/2: their brackets with a quadratic coupling are its bonds."""

import itertools

import axes
import numpy as np
import pytest
import reference
import symsde as ss
from symsde import errors
from test_action_kicks import STRENGTH, Spins

pytestmark = pytest.mark.usefixtures("quick_compiler")

SCHEMES = ("gauss_dkdkd_strong2", "verlet_kdk", "verlet_kdk_strong2")
#: a factor of single terms of the reference -> the fault that it plants
FAULTS = {"one site": (1.01, 1, 1), "two sites": (1, 1.01, 1), "on site": (1, 1, 1.01)}
HALVES = {"gauss": ((3 - np.sqrt(3)) / 6, (3 + np.sqrt(3)) / 6), "verlet": (0.0, 1.0)}  #: nodes


class Phases(Spins):
    """H = z.S z/2 + sum_i I_i^2/2 + cos(I_1 I_2), and noises K_k = (1 + .5 cos t) u_k.I."""

    def angles(self, t, w, q, p):
        action = (q**2 + p**2) / 2
        theta = w[0] * action
        turn = w[0] * np.sin(action[0] * action[1])
        theta[0] -= turn * action[1]
        theta[1] -= turn * action[0]
        return theta + (1 + 0.5 * np.cos(t)) * self.strength.T @ w[1:]

    def model(self, **traits):
        return super().model(**{"kicks": "phases"} | traits)

    def step(self, scheme, t, drive, x, fault=(1, 1, 1)):
        """A step with two kicks of half of H - D each, between halves of the brackets."""
        h, n = drive.h, self.ndof
        nodes, gamma = HALVES[scheme.split("_")[0]], np.sqrt(3) if scheme.startswith("gauss") else 1.0
        a = drive.z / h - drive.w / 2
        w = [drive.w / 2 + sign * gamma * a for sign in (1, -1)]
        outer = (w[0][:, None] * w[1] + w[1][:, None] * w[0]) / 2
        d = h * (nodes[1] - nodes[0]) * outer - drive.magnus
        if not scheme.endswith("_strong2"):
            d = np.eye(len(a))[:, :, None] * h * abs(h) / 6 + 0 * d
        u = (1 + 0.5 * np.cos(t + h / 2)) * self.strength
        halves = [self.flows_of_brackets(u, d[:, :, lane] / 2, fault) for lane in range(x.shape[1])]
        field, before = turned(self.second), 0.0
        x = np.stack([product(flows) @ x[:, lane] for lane, flows in enumerate(halves)], axis=1)
        for node, wi in zip(nodes, w, strict=True):
            x = reference.exponential((node - before) * h * field) @ x
            psi = x[:n] + 1j * x[n:]
            weights = np.concatenate([np.full_like(a[:1], h / 2), wi])
            psi = psi * np.exp(-1j * self.angles(t + node * h, weights, x[:n], x[n:]))
            x, before = np.concatenate([psi.real, psi.imag]), node
        x = reference.exponential((1 - before) * h * field) @ x
        return np.stack([product(flows[::-1]) @ x[:, lane] for lane, flows in enumerate(halves)], axis=1)

    def flows_of_brackets(self, u, d, fault):
        """exp of the fields of (1/2) sum_kl D_kl {K_k, {K_l, X}} for each bond X in its order, by products of matrices
        alone; u (noise, site), d (noise, noise)."""
        flows = []
        for i, j, bond in bonds_of(self.second):
            total = 0
            for k, m in itertools.product(range(len(u)), repeat=2):
                for at, other in itertools.product({i, j}, repeat=2):
                    one, two = (np.diag(np.tile(np.arange(self.ndof) == x, 2).astype(float)) for x in (at, other))
                    factor = fault[2] if i == j else fault[0] if at == other else fault[1]
                    term = bracket(one, bracket(two, bond))
                    total = total + factor * d[k, m] * u[k, at] * u[m, other] / 2 * term
            flows.append(reference.exponential(turned(total)))
        return flows


def product(flows):
    """The flows one after the other."""
    total = np.eye(len(flows[0]))
    for flow in flows:
        total = flow @ total
    return total


def turned(second):
    """The matrix of the field of z.second z/2."""
    n = len(second) // 2
    return np.concatenate([second[n:], -second[:n]])


def bracket(a, b):
    """{z.a z/2, z.b z/2}, as second derivatives."""
    return a @ turned(b) - b @ turned(a)


def bonds_of(second):
    """Sites i <= j and the part of z.second z/2 of each bond: what a common rotation of both keeps, and the rest."""
    n = len(second) // 2
    turn = turned(np.eye(2 * n))
    for j in range(n):
        for i in range(j + 1):
            at = np.array([[x % n, y % n] in ([i, j], [j, i]) for x in range(2 * n) for y in range(2 * n)])
            part = np.where(at.reshape(2 * n, 2 * n), second, 0)
            hopping, pairing = ((part + sign * turn.T @ part @ turn) / 2 for sign in (1, -1))
            yield from ((i, j, x) for x in ([hopping, pairing] if i < j else [pairing]) if np.abs(x).max() > 0)


def differences(scheme, *, sign=1, fault=(1, 1, 1), strength=STRENGTH, **traits):
    """Largest differences of the library's steps from those of the equations, step by step."""
    h, steps, rows, paths = 0.2 * sign, 3, 4, 5
    phases = Phases(strength=strength)
    q0, p0 = axes.start(3, paths)
    q0[1, 2] = p0[1, 2] = 0  # a site at rest is coupled to others
    dw = axes.rows_of(h, steps, rows, 4, paths)
    given = {"step": h, "steps": steps, "scheme": scheme, "refine": 2}
    run = ss.simulate(phases.model(**traits), q0=q0, p0=p0, paths=paths, increments=dw, **given)
    x, found = np.concatenate([q0, p0]), []
    for n in range(steps):
        x = phases.step(scheme, n * h, reference.polygon(h, dw[rows * n : rows * (n + 1)]), x, fault)
        found.append(np.abs(np.concatenate([run.q[n + 1], run.p[n + 1]]) - x).max() / max(1, np.abs(x).max()))
    one = ss.simulate(phases.model(**traits), q0=q0[:, 3:4], p0=p0[:, 3:4], paths=1, increments=dw[:, :, 3:4], **given)
    np.testing.assert_array_equal([one.q[:, :, 0], one.p[:, :, 0]], [run.q[:, :, 3], run.p[:, :, 3]])
    return found


TOUCHED = [[i + 1 for i in range(3) if row[i]] for row in STRENGTH]


@pytest.mark.parametrize("touches", [None, TOUCHED], ids=["all", "touches"])
@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("scheme", SCHEMES)
def test_steps_are_those_of_the_equations(scheme, sign, touches):
    """Hopping, pairing and squeezing of three sites, noises of several sites in time; brackets by products of matrices,
    their flows by exponentials of matrices."""
    assert max(differences(scheme, sign=sign, touches=touches)) < 2e-14


@pytest.mark.parametrize("scheme", SCHEMES)
def test_flows_of_bonds_are_exact_in_long_steps(scheme):
    """Noises of 30 times the strength: pairing stretches by exp(theta) with theta above one, where a series to
    theta^11, which serves short steps, errs by 6e-7."""
    assert differences(scheme, strength=30 * STRENGTH)[0] < 1e-13


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("scheme", SCHEMES)
def test_faults_of_a_hundredth_are_noticed(scheme, fault):
    """Of each kind of term, by more than 1e8 times the difference that a right step may have."""
    assert max(differences(scheme, fault=FAULTS[fault])) > 5e-6


class PhaseRing:
    """i dpsi_k = -(c_k psi_{k+1} + c_{k-1} psi_{k-1}) dt + |psi_k|^2 psi_k dt + s_k psi_k o dW_k."""

    TEXT = "Sum((q[i]**2 + p[i]**2)**2/4 - c[i]*(q[i]*q[i+1] + p[i]*p[i+1]), i)"

    def __init__(self, n=6):
        self.n = n
        self.c, self.s = 0.8 + 0.3 * np.cos(np.arange(n)), 0.6 + 0.2 * np.sin(3.0 * np.arange(n))

    def model(self, nonlinear=""):
        params = {"c": self.c, "s": self.s}
        noise = "s[k]*(q[k]**2 + p[k]**2)/2" + nonlinear
        return ss.model_from_sympy(self.TEXT, [noise], n=self.n, ends="periodic", params=params)


def test_strong_orders_of_a_ring():
    """Slopes of errors over 300 paths, whose standard error in other scenes is 0.02: bounds are five of these off. All
    levels take J of the finest one; the norm stays."""
    model, levels = PhaseRing().model(), range(4, 8)
    q0 = np.linspace(0.3, 1.0, 6)

    def last(scheme, level):
        given = {"step": 2.0**-level, "steps": 2**level, "save_every": 2**level, "refine": 11 - level}
        run = ss.simulate(model, q0=q0, p0=0.3 - q0, seed=3, paths=300, scheme=scheme, **given)
        norm = (run.q**2 + run.p**2).sum(axis=1)
        assert np.abs(norm - norm[0]).max() < 2e-13
        return np.concatenate([run.q[-1], run.p[-1]])

    exact, error = last("gauss_dkdkd_strong2", 11), {}
    for scheme in ("gauss_dkdkd", *SCHEMES):
        found = [np.sqrt(((last(scheme, k) - exact) ** 2).sum(axis=0).mean()) for k in levels]
        error[scheme] = (-np.polyfit(levels, np.log2(found), 1)[0], found[-1])
    assert 1.9 < error["gauss_dkdkd_strong2"][0] < 2.1
    assert 1.9 < error["verlet_kdk_strong2"][0] < 2.1
    assert 1.5 < error["gauss_dkdkd"][0] < 1.7
    assert 1.6 < error["verlet_kdk"][0] < 1.8
    assert error["gauss_dkdkd_strong2"][1] < 0.4 * error["gauss_dkdkd"][1]


def test_single_steps_have_their_order_without_finer_ones():
    """J from four quarters of a step is that of finer levels but for a part of it of order h^2 that is never exact:
    errors at one level are little larger."""
    model, q0 = PhaseRing().model(), np.linspace(0.3, 1.0, 6)
    found = []
    for scheme in ("gauss_dkdkd_strong2", "gauss_dkdkd"):
        given = {"q0": q0, "p0": 0.3 - q0, "seed": 5, "paths": 300}
        coarse = ss.simulate(model, scheme=scheme, step=2.0**-5, steps=32, save_every=32, **given)
        fine = ss.simulate(
            model, scheme="gauss_dkdkd_strong2", step=2.0**-8, steps=256, save_every=256, refine=-3, **given
        )
        found.append(np.sqrt(((coarse.q[-1] - fine.q[-1]) ** 2).sum(axis=0).mean()))
    assert found[0] < 0.5 * found[1]


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("refine", [0, 2, -1])
def test_paths_have_their_bits_alone_and_going_on(scheme, refine):
    model = PhaseRing(5).model()
    given = {"q0": 0.3, "p0": 0.1, "step": 0.1, "seed": 4, "scheme": scheme, "refine": refine}
    block = ss.simulate(model, paths=80, steps=20, **given)
    for path in (0, 79):
        alone = ss.simulate(model, paths=1, first_path=path, steps=20, **given)
        assert np.array_equal(block.q[:, :, path], alone.q[:, :, 0])
    first = ss.simulate(model, paths=80, steps=8, **given)
    assert np.array_equal(first.extend(12).last_q, block.last_q)


def test_strengths_differ_from_path_to_path():
    drift = "(q1**2 + p1**2)**2/4 - q1*q2 - p1*p2 + 0.3*(q1*p2 - p1*q2) + 0.2*q1*q2 + 0.1*q1*p1"
    noises = ["s*(q1**2 + p1**2)/2", "0.2*(q1**2 + p1**2) - 0.4*s*(q2**2 + p2**2)"]
    given = {"q0": [0.3, 0.7], "p0": 0.1, "step": 0.1, "steps": 9, "seed": 3, "scheme": "gauss_dkdkd_strong2"}
    s = np.linspace(0.1, 0.9, 9)
    block = ss.simulate(ss.model_from_sympy(drift, noises, params={"s": s}), paths=9, **given)
    for path in range(9):
        model = ss.model_from_sympy(drift, noises, params={"s": s[path]})
        assert model.traits.kicks == "phases"
        alone = ss.simulate(model, paths=1, first_path=path, **given)
        np.testing.assert_allclose(block.q[:, :, path], alone.q[:, :, 0], rtol=0, atol=1e-13)


def test_work_and_pairs_grow_with_bonds():
    """J takes eight normals of each noise and step, and strengths one gradient of all noises together beside those of
    two kicks. Pairs are those of bonds: tests/test_base_bonds.pf counts them."""
    for n in (16, 256):
        model = PhaseRing(n).model()
        how = {"q0": 0.3, "p0": 0.1, "step": 0.1, "steps": 8, "paths": 16, "scheme": "gauss_dkdkd_strong2"}
        counters = ss.simulate(model, threads=1, **how).report.counters
        assert counters["normals"] == 8 * n * 8 * 16
        assert counters["gradients"] == 3 * 8 * 16


def test_steps_are_symplectic():
    q, p = [0.6, 0.2, -0.5], [0.3, -0.4, 0.1]
    for scheme in SCHEMES:
        assert ss.diagnose.symplecticity(Phases().model(), scheme, q=q, p=p, step=0.2)[0] < 1e-12


def test_formulas_know_noises_of_phases():
    assert PhaseRing().model().traits.kicks == "phases"
    assert PhaseRing().model("+ 0.1*(q[k]**2 + p[k]**2)**2").traits.kicks == "actions"
    given = {"split": "Sum(-q[i]*q[i+1] - p[i]*p[i+1], i)", "n": 3, "ends": "periodic"}
    drift = "Sum((q[i]**2 + p[i]**2)**2/4 - q[i]*q[i+1] - p[i]*p[i+1], i)"
    for noise, kicks in (("cos(t)*(q[k]**2 + p[k]**2)", "phases"), ("sin(q[k]**2 + p[k]**2)", "actions")):
        assert ss.model_from_sympy(drift, [noise], **given).traits.kicks == kicks
        two = {"split": "q1*q2 + p1*p2"} if noise[0] == "c" else {}
        single = noise.replace("[k]", "1")
        assert ss.model_from_sympy("q1*q2 + p1*p2 + (q1**2 + p1**2)**2", [single], **two).traits.kicks == kicks


def test_what_is_refused():
    given = {"q0": [0.6, 0.2, -0.5], "p0": [0.3, -0.4, 0.1], "step": 0.1, "steps": 2}
    for scheme in ("chin4a", "chin4a_strong2"):
        with pytest.raises(errors.IncompatibleError, match=r"kicks by functions of q.*use gauss_dkdkd"):
            ss.simulate(Phases().model(), scheme=scheme, **given)
    for scheme in SCHEMES:
        with pytest.raises(errors.IncompatibleError, match=r"linear in the actions.*strong order 3/2 stays"):
            ss.simulate(Spins().model(), scheme=scheme, **given)
        with pytest.raises(errors.IncompatibleError, match="of decays of momenta are none: use gauss_dkdkd"):
            ss.simulate(Phases().model().damped(0.3), scheme=scheme, **given)
        ss.simulate(Spins(strength=STRENGTH[:0]).model(), scheme=scheme, **given)  # without noise
    with pytest.raises(errors.FalseTraitError, match=r"phase_noise.*kicks by functions of the actions alone"):
        ss.simulate(Spins().model(kicks="phases"), scheme="gauss_dkdkd", **given)


def test_still_sites_have_no_bonds():
    """Without a coupling, or where noises turn both sites of hopping alike, nothing is added."""
    given = {"q0": [0.6, 0.2], "p0": [0.3, -0.4], "step": 0.1, "steps": 5, "paths": 3, "seed": 2}
    hop = "q1*q2 + p1*p2"
    even = "q1**2 + p1**2 + q2**2 + p2**2"
    for drift, noise in ((even, "q1**2 + p1**2"), (hop, even)):
        model = ss.model_from_sympy(f"{drift} + (q1**2 + p1**2)**2/4", [noise], split=drift)
        one, two = (ss.simulate(model, scheme=x, **given).q for x in ("gauss_dkdkd", "gauss_dkdkd_strong2"))
        np.testing.assert_allclose(one, two, rtol=0, atol=1e-14)
