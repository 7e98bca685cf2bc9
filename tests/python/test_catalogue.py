# SPDX-License-Identifier: BSD-3-Clause
"""Models and schemes by name, their parameters, traits and certificates."""

import inspect
import itertools
import re
import subprocess
import sys

import numpy as np
import pytest
import symsde as ss
from symsde.studies import catalogue

SCHEMES = [
    "midpoint",
    "symplectic_euler",
    "symplectic_euler_adjoint",
    "stormer_verlet",
    "gauss2",
    "lobatto3",
    "heun",
    "euler_maruyama",
]


def test_every_model_has_a_function_with_the_library_s_defaults():
    assert len(ss.models.names()) == 9
    for name in ss.models.names():
        function = getattr(ss.models, name)
        defaults = {key: p.default for key, p in inspect.signature(function).parameters.items()}
        assert defaults == ss.models.parameters(name)
        model = function()
        assert model.name == name
        assert "H = " in function.__doc__
        assert model.traits.has_value


@pytest.mark.parametrize("name", ss.models.names())
def test_bounds_that_models_declare_hold(name):
    """Declared bounds hold: frequencies of H, and the norm of the Hessians of all noises together, for any signs."""
    given = {key: 3 if key == "n" else 0.8 * x + 0.1 for key, x in ss.models.parameters(name).items()}
    signed = [key for key in given if key != "n"]
    for signs in itertools.product((1, -1), repeat=len(signed)):
        model = ss.models.get(name, **{**given, **{key: s * given[key] for key, s in zip(signed, signs, strict=True)}})
        n, rng = model.ndof, np.random.default_rng(1)
        q, p = np.concatenate([np.zeros((2, n, 1)), rng.uniform(-3, 3, (2, n, 40))], axis=2)
        for t in np.linspace(0, 7, 9):
            norms = []
            for j in range(model.nnoise + 1):
                w = np.eye(model.nnoise + 1)[j][:, np.newaxis] * np.ones(41)
                qq, qp, pp = (np.moveaxis(x, 2, 0) for x in model.hessian(q, p, w, t))
                whole = np.concatenate(
                    [np.concatenate([qq, qp], axis=1), np.concatenate([qp.transpose(0, 2, 1), pp], axis=1)], axis=2
                )
                turned = np.concatenate([whole[:, n:], -whole[:, :n]], axis=1)
                norms.append(np.abs(np.linalg.eigvals(turned)).max() if j == 0 else np.linalg.norm(whole, 2, (1, 2)))
            if (most := model.traits.max_frequency) > 0:
                assert norms[0] <= most * (1 + 1e-9), (signs, t)
            if (most := model.traits.noise_lipschitz) > 0:
                assert sum(norms[1:]).max() <= most * (1 + 1e-9), (signs, t)


def test_traits_of_a_chain():
    model = ss.models.fpu_chain(n=5)
    assert (model.ndof, model.nnoise, model.traits.bandwidth) == (5, 5, 1)
    assert model.traits.additive and model.traits.identity_mass and not model.traits.quadratic


def test_get_keeps_defaults():
    model = ss.models.get("kubo", a=2.0)
    assert model.parameters == {"a": 2.0, "sigma": 0.3}
    assert repr(model) == "kubo(a=2, sigma=0.3)"


def test_hamiltonians_of_the_synchrotron():
    model = ss.models.synchrotron(omega=2.0, sigma1=0.2, sigma2=0.1)
    q, p = np.array([[0.3, -1.2]]), np.array([[0.7, 0.4]])
    expected = [p**2 / 2 - 4 * np.cos(q), 0.2 * np.sin(q), -0.1 * np.cos(q)]
    for j in range(3):
        weights = np.eye(3)[j]
        np.testing.assert_allclose(model.value(q, p, weights), expected[j][0], rtol=1e-15)
    hq, hp = model.gradient(q, p)
    np.testing.assert_allclose(hq, 4 * np.sin(q), rtol=1e-14)
    np.testing.assert_array_equal(hp, p)
    hqq, hqp, hpp = model.hessian(q, p, [1.0, 0.5, 2.0])
    slope = 4 * np.cos(q) - 0.1 * np.sin(q) + 0.2 * np.cos(q)
    np.testing.assert_allclose(hqq[0], slope, rtol=1e-14)
    np.testing.assert_array_equal(hqp, 0)
    np.testing.assert_array_equal(hpp, 1)


@pytest.mark.parametrize("name", SCHEMES)
def test_schemes(name):
    assert name in ss.schemes.names()
    scheme = ss.schemes.get(name)
    assert scheme.name == name
    assert scheme.info.symplectic == (name not in {"heun", "euler_maruyama"})
    assert name in repr(scheme)
    assert len(scheme.certificate().splitlines()) >= 3


def test_families():
    assert ss.schemes.get("lambda:0.25").info.correction_coefficient == 0.25
    assert ss.schemes.get("dirk:0.25").info.nstage == 2


def test_galerkin_schemes_are_those_whose_rule_has_the_order_in_the_name():
    """PsNrQu: degree s <= r nodes, and u is the order of the rule with r nodes; other digits name no scheme."""
    has_order = {"Gau": lambda r: 2 * r, "Lob": lambda r: 2 * r - 2, "Otr": lambda r: 2 if r == 2 else 0}
    for s, r, u, rule in itertools.product(range(6), range(6), range(10), has_order):
        name = f"P{s}N{r}Q{u}{rule}"
        if 1 <= s <= r <= 4 and u == has_order[rule](r) > 0:
            assert ss.schemes.get(name).name == name
        else:
            with pytest.raises(ss.errors.SymsdeError):
                ss.schemes.get(name)


def test_scheme_from_quadrature_is_gauss2(kubo, options):
    root = np.sqrt(3) / 6
    scheme = ss.schemes.from_quadrature([0.5 - root, 0.5 + root], [0.5, 0.5], degree=2, name="mine")
    assert scheme.name == "mine" and scheme.info.degree == 2
    mine, known = (ss.simulate(kubo, scheme=s, **options).q for s in (scheme, "gauss2"))
    np.testing.assert_allclose(mine, known, rtol=0, atol=1e-13)


def test_a_scheme_is_known_by_its_coefficients():
    """A tableau under any name runs by a model's whole steps for its coefficients."""
    known = ss.schemes.get("lobatto3").tableau()
    how = {"q0": 0.3, "p0": 0.1, "step": 0.05, "steps": 40, "paths": 20, "correction": "none"}
    for factor, same in ((1.0, True), (1.01, False)):
        a = known.a.copy()
        a[1, 0] *= factor
        mine = ss.schemes.from_tableau(a, known.abar, known.alpha, "mine", allow_nonsymplectic=True)
        for model in (ss.models.kubo(), ss.models.linear_oscillator()):
            own, theirs = (ss.simulate(model, scheme=scheme, **how) for scheme in (mine, "lobatto3"))
            assert "whole steps of lobatto3" in theirs.report.stepper
            assert (own.report.stepper == theirs.report.stepper) == np.array_equal(own.q, theirs.q) == same


def test_scheme_from_tableau(kubo, options):
    scheme = ss.schemes.from_tableau([[0.5]], [[0.5]], [1.0])
    assert scheme.info.keeps_quadratic
    mine, known = (ss.simulate(kubo, scheme=s, **options).q for s in (scheme, "midpoint"))
    np.testing.assert_allclose(mine, known, rtol=0, atol=1e-13)
    heun = ([[0.0, 0.0], [1.0, 0.0]], [[0.0, 0.0], [1.0, 0.0]], [0.5, 0.5])
    with pytest.raises(ValueError, match="symplectic"):
        ss.schemes.from_tableau(*heun)
    assert not ss.schemes.from_tableau(*heun, allow_nonsymplectic=True).info.symplectic


def test_noise_weights_of_its_own(kubo, options):
    root = np.sqrt(3) / 6
    nodes, weights = [0.5 - root, 0.5 + root], [0.5, 0.5]
    same = ss.schemes.from_quadrature(nodes, weights, 2, noise_weights=weights)
    np.testing.assert_array_equal(
        ss.simulate(kubo, scheme=same, **options).q,
        ss.simulate(kubo, scheme=ss.schemes.from_quadrature(nodes, weights, 2), **options).q,
    )
    own = ss.schemes.from_quadrature(nodes, weights, 2, noise_weights=[0.25, 0.75])
    assert own.info.symplectic and own.info.correction_coefficient == 0  # Gauss nodes: consistent with any weights
    assert ss.diagnose.symplecticity(kubo, own, step=0.2, dw=0.3).max() < 1e-13
    with pytest.raises(ss.errors.WrongShapeError, match="1 noise weights"):
        ss.schemes.from_quadrature(nodes, weights, 2, noise_weights=[1.0])
    with pytest.raises(ValueError, match="noise weights sum"):
        ss.schemes.from_quadrature(nodes, weights, 2, noise_weights=[0.5, 0.6])


def test_nodes_that_share_a_slope_want_noise_in_position_or_their_weights(options):
    """Schemes with more nodes than degree accept noise that moves q if it is additive and has the drift's weights."""
    moved = ss.models.additive_oscillator(sigma=0.3)
    shared, own = (
        ss.schemes.from_quadrature([0.0, 1.0], [0.5, 0.5], 1, noise_weights=weights) for weights in (None, [0.25, 0.75])
    )
    assert not ss.simulate(moved, scheme=shared, **options).status.any()
    assert not ss.simulate(ss.models.linear_oscillator(), scheme=own, **options).status.any()
    with pytest.raises(ss.errors.IncompatibleError, match=r"depends on q alone .* share their weights"):
        ss.simulate(moved, scheme=own, **options)


def test_tableau_with_noise_of_its_own():
    half, one = [[0.5]], [1.0]
    assert ss.schemes.from_tableau(half, half, one, b=half, bbar=half, beta=one).info.keeps_quadratic
    with pytest.raises(ValueError, match="symplectic"):
        ss.schemes.from_tableau(half, half, one, b=[[0.4]])
    mixed = ss.schemes.from_tableau(half, half, one, b=[[0.4]], bbar=[[0.6]], allow_nonsymplectic=True)
    assert not mixed.info.symplectic
    with pytest.raises(ss.errors.WrongShapeError, match="bbar"):
        ss.schemes.from_tableau(half, half, one, bbar=one)
    with pytest.raises(ss.errors.WrongShapeError, match="beta"):
        ss.schemes.from_tableau(half, half, one, beta=[0.5, 0.5])


def test_schemes_from_schemes(kubo, options):
    pairs = {
        "symplectic_euler_adjoint": ss.schemes.adjoint("symplectic_euler"),
        "stormer_verlet": ss.schemes.symmetric_composition(ss.schemes.get("symplectic_euler")),
        "dirk:0.25": ss.schemes.composition(["midpoint", "midpoint"], [0.25, 0.75], name="two"),
    }
    for name, made in pairs.items():
        mine, known = (ss.simulate(kubo, scheme=s, **options).q for s in (made, name))
        np.testing.assert_allclose(mine, known, rtol=0, atol=1e-13)
    jump = ss.schemes.triple_jump("midpoint", name="Yoshida")
    assert jump.name == "Yoshida" and jump.info.nstage == 3 and jump.info.keeps_quadratic
    assert jump.info.order_noise_free == 4
    assert re.search(r"order without noise +2\n", ss.schemes.get("midpoint").certificate())
    assert pairs["stormer_verlet"].name == "symplectic_euler_symmetric"
    with pytest.raises(ValueError, match="not symmetric"):
        ss.schemes.triple_jump("symplectic_euler")
    with pytest.raises(ValueError, match="more of the path"):
        ss.schemes.adjoint("verlet_dz")
    with pytest.raises(ss.errors.WrongShapeError, match="2 parts and 1 fractions"):
        ss.schemes.composition(["midpoint", "midpoint"], [1.0])


@pytest.mark.parametrize("base", ["midpoint", "stormer_verlet", "gauss2", "lobatto3", "gauss3", "jump"])
def test_a_triple_jump_cancels_the_first_error_of_its_base(base):
    """The base's error of order r is proportional to h^(r+1): fractions g, 1 - 2 g, g with 2 g^(r+1) + (1 - 2
    g)^(r+1) = 0.
    """
    known = ss.schemes.triple_jump("midpoint") if base == "jump" else ss.schemes.get(base)
    found = ss.schemes.triple_jump(known)
    order, alpha = known.info.order_noise_free, known.tableau().alpha
    shares = found.tableau().alpha.reshape(3, -1) / alpha
    np.testing.assert_allclose(shares, [[g] * len(alpha) for g in shares[:, 0]], rtol=1e-12)
    assert shares[1, 0] < 0 and np.ptp(shares[[0, 2]]) < 1e-12 and found.info.order_noise_free == order + 2
    assert shares[:, 0].sum() == pytest.approx(1, rel=1e-13)
    assert (shares[:, 0] ** (order + 1)).sum() == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize(
    ("name", "order"), [("verlet_dz", 2), ("averaged_shift_midpoint", 1.5), ("drift_preserving", 1)]
)
def test_schemes_for_additive_noise(name, order):
    scheme = ss.schemes.get(name)
    assert scheme.info.orders["additive"].value == order and scheme.info.orders["commutative"].value == 0
    assert "needs                   additive noise" in scheme.certificate()
    run = ss.simulate(ss.models.henon_heiles(), q0=0.1, p0=0.0, step=0.1, steps=10, paths=5, scheme=scheme)
    assert (run.status == 0).all()
    with pytest.raises(ValueError, match="additive"):
        ss.simulate(ss.models.kubo(), q0=1.0, p0=0.0, step=0.1, steps=10, scheme=scheme)


def test_versions():
    info = ss.build_info()
    assert ss.__version__ == info["version"]
    assert "GCC" in info["compiler"]


def test_import_is_light():
    code = "import sys, symsde; print(*[m for m in ('matplotlib', 'xarray', 'numba', 'tqdm') if m in sys.modules])"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.split() == []


def test_library_not_found():
    code = "import symsde"
    found = subprocess.run(
        [sys.executable, "-c", code],
        env={**__import__("os").environ, "SYMSDE_LIBRARY": "/nowhere/libsymsde.so"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert found.returncode == 1
    assert "/nowhere/libsymsde.so" in found.stderr and "./bootstrap build" in found.stderr


def central_motion():
    """H = p.p/2 + |q|^4/4 + |q|^2/2 with H_1 = 0.3 |q|^2/2 + 0.1 |p|^2/2 in the plane: angular momentum is kept."""

    def gradient(t, w, q, p):
        return (w[0] * (1 + (q**2).sum(axis=0)) + 0.3 * w[1]) * q, (w[0] + 0.1 * w[1]) * p

    def hessian(t, w, q, p):
        unit = np.eye(2)[:, :, np.newaxis]
        qq = (w[0] * (1 + (q**2).sum(axis=0)) + 0.3 * w[1]) * unit + 2 * w[0] * q[:, np.newaxis] * q[np.newaxis]
        return qq, 0 * qq, (w[0] + 0.1 * w[1]) * unit

    def value(t, w, q, p):
        radius, speed = (q**2).sum(axis=0), (p**2).sum(axis=0)
        return w[0] * (speed / 2 + radius**2 / 4 + radius / 2) + w[1] * (0.15 * radius + 0.05 * speed)

    functions = {"gradient": gradient, "hessian": hessian, "value": value}
    return ss.Model(ndof=2, nnoise=1, separable=True, **functions)


def test_bilinear_invariants_are_kept_where_the_certificate_says_so():
    """Angular momentum over 50 steps: kept to rounding by every scheme that claims it, and lost by the others."""
    model = central_motion()
    for name in (*ss.schemes.names(), "lambda:0.3", "dirk:0.25"):
        scheme = ss.schemes.get(name)
        if scheme.info.form in {"Galerkin", "drifts and kicks"} or scheme.info.structure_evidence == "claimed":
            continue  # this scheme refuses this noise
        run = ss.simulate(model, q0=[1.0, 0.2], p0=[-0.3, 0.8], step=0.1, steps=50, scheme=scheme, paths=8, seed=2)
        momentum = run.q[:, 0] * run.p[:, 1] - run.q[:, 1] * run.p[:, 0]
        lost = np.abs(momentum - momentum[0]).max()
        assert (lost < 1e-12) == scheme.info.keeps_bilinear, (name, lost)
        assert scheme.info.keeps_bilinear or lost > 1e-4, (name, lost)
    assert not ss.schemes.get("stormer_verlet").info.keeps_quadratic
    assert ss.schemes.get("stormer_verlet").info.keeps_bilinear


def test_a_scheme_says_what_its_orders_rest_on():
    evidence = {name: ss.schemes.get(name).info.orders["additive"].evidence for name in ss.schemes.names()}
    assert evidence["midpoint"] == evidence["lobatto4"] == evidence["heun"] == "derived"
    assert evidence["gauss2_strong32"] == evidence["verlet_dz"] == evidence["euler_maruyama"] == "claimed"
    assert evidence["gauss2_weak2"] == "none"
    claimed = {name for name in ss.schemes.names() if ss.schemes.get(name).info.structure_evidence == "claimed"}
    assert claimed == {"verlet_dz", "averaged_shift_midpoint", "drift_preserving", "exact_rotation"}
    mine = ss.schemes.from_tableau([[0.5]], [[0.5]], [1.0], name="midpoint")  # a name has no measurements
    assert mine.info.orders["additive"].evidence == "derived" and mine.info.orders["additive"].measured is None
    assert "not measured" in mine.certificate() and "measured 1.0" in ss.schemes.get("midpoint").certificate()


@pytest.mark.parametrize(
    ("name", "expected"),
    [("heun", (0.25, 0.5, 0.0)), ("symplectic_euler", (0.0, 1.0, 1.0)), ("dirk:0.25", (0.0, 0.5, 0.0)),
     ("lambda:0.3", (0.0, 0.4, 0.4)), ("midpoint", (0.0, 0.0, 0.0))],
)  # fmt: skip
def test_residuals_of_structure(name, expected):
    """Residuals by hand: the largest |alpha_i a_ij + alpha_j a_ji - alpha_i alpha_j|, |alpha_j - a_-i,-j - a_ij|, |a -
    abar|."""
    info = ss.schemes.get(name).info
    found = info.symplecticity_residual, info.symmetry_residual, info.quadratic_residual
    assert found == pytest.approx(expected, abs=1e-15)


def test_coefficients_of_a_tableau_are_those_given():
    """One stage, noise alone: Q = q + b x P, P = p - bbar x Q with x = sigma dW; then q + x P and p - x Q."""
    b, bbar, x, q, p = 0.4, 0.7, 0.3, 1.0, 0.5
    half = [[0.5]]
    scheme = ss.schemes.from_tableau(half, half, [1.0], b=[[b]], bbar=[[bbar]], beta=[1.0], allow_nonsymplectic=True)
    found = ss.step(ss.models.kubo(a=0.0, sigma=1.0), scheme, q, p, 0.1, x, correction="none")
    stage_q = (q + b * x * p) / (1 + b * bbar * x**2)
    stage_p = p - bbar * x * stage_q
    np.testing.assert_allclose(np.ravel(found), [q + x * stage_p, p - x * stage_q], rtol=1e-12)


def test_certificates_mark_what_their_coefficients_do_not_prove():
    """The certificate of a scheme with a stepper of its own shows no number of a tableau that the stepper does not
    use.
    """
    claimed = [name for name in ss.schemes.names() if ss.schemes.get(name).info.structure_evidence == "claimed"]
    assert {"averaged_shift_midpoint", "drift_preserving", "exact_rotation", "verlet_dz"} <= set(claimed)
    for name in ss.schemes.names():
        lines = catalogue.certified(ss.schemes.get(name))
        for label in ("symplectic", "symmetric", "quadratic invariants"):
            assert ("claimed" in lines[label]) == (name in claimed), (name, label)
        assert name not in claimed or not re.search(r"\d\.\d", lines["symplectic"] + lines["symmetric"]), name


def test_the_name_that_moments_have_in_c():
    assert ss.compute_moments is ss.moments
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        ss.nothing  # noqa: B018
