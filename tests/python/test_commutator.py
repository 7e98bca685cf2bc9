# SPDX-License-Identifier: BSD-3-Clause
"""ss.commutator tells commutative from non-commutative noises; increments of weak schemes."""

import itertools

import numpy as np
import pytest
import symsde as ss


def test_classes_of_noise():
    kubo = ss.commutator(ss.models.kubo())
    assert kubo.commutative and kubo.flows_commute
    synchrotron = ss.commutator(ss.models.synchrotron())
    assert synchrotron.commutative and not synchrotron.flows_commute
    mixed = ss.commutator(ss.models.noncommutative_oscillator(s1=0.5, s2=0.5))
    assert not mixed.commutative and mixed.noise > 0.1
    assert "order" in str(mixed)


# Functions of u = q + p all commute, since both terms of their bracket are zero by themselves.
OF_SUM = {
    "sine and cosine": [(np.cos, lambda u: -np.sin(u)), (lambda u: -np.sin(u), lambda u: -np.cos(u))],
    "three": [
        (np.cos, lambda u: -np.sin(u)),
        (lambda u: 3 * u**2, lambda u: 6 * u),
        (lambda u: np.exp(u / 2) / 2, lambda u: np.exp(u / 2) / 4),
    ],
}


def model_of_sum(noises, hessian, strength=0.0):
    """H = (p^2 + q^2)/2, noises f_k(q + p) given by f_k', f_k''; strength*q^2/2 is added to the last noise."""
    last = len(noises)

    def gradient(t, w, q, p):
        u = q + p
        slope = sum(w[k + 1] * first(u) for k, (first, _) in enumerate(noises))
        return w[0] * q + slope + strength * w[last] * q, w[0] * p + slope

    def blocks(t, w, q, p):
        u = q + p
        curve = sum(w[k + 1] * second(u) for k, (_, second) in enumerate(noises))
        return w[0] + curve + strength * w[last], curve, w[0] + curve

    def dense(t, w, q, p):
        return tuple(block[np.newaxis] for block in blocks(t, w, q, p))

    def product(t, w, q, p, vq, vp):  # noqa: PLR0917 - as the library calls it
        qq, qp, pp = blocks(t, w, q, p)
        return qq * vq + qp * vp, qp * vq + pp * vp

    given = {"by hand": {"hessian": dense}, "by products": {"hessian_vector": product}, "by differences": {}}[hessian]
    return ss.Model(ndof=1, nnoise=last, gradient=gradient, **given)


@pytest.mark.parametrize("hessian", ["by hand", "by differences", "by products"])
@pytest.mark.parametrize("noises", OF_SUM.values(), ids=OF_SUM)
def test_noises_that_are_functions_of_one_sum_commute(noises, hessian):
    found = ss.commutator(model_of_sum(noises, hessian))
    assert found.commutative and not found.flows_commute
    assert found.noise < (1e-9 if hessian == "by differences" else 1e-14)


@pytest.mark.parametrize("hessian", ["by hand", "by differences", "by products"])
@pytest.mark.parametrize("strength", [1e-2, 1e-4])
@pytest.mark.parametrize("noises", OF_SUM.values(), ids=OF_SUM)
def test_noises_that_nearly_commute_do_not(noises, strength, hessian):
    found = ss.commutator(model_of_sum(noises, hessian, strength))
    assert not found.commutative
    assert strength / 100 < found.noise < 10 * strength  # in proportion to the size of the term that does not commute


@pytest.mark.parametrize(
    ("noises", "one", "two"), [(m, *pair) for m in (2, 3, 5) for pair in itertools.combinations(range(1, m + 1), 2)]
)
def test_the_only_pair_that_does_not_commute_is_named(noises, one, two):
    """H_one = q_1^2/2 and H_two = p_1^2/2 beside functions of q_2."""

    def gradient(t, w, q, p):
        hq, hp = w[0] * q, w[0] * p
        hq[0] += w[one] * q[0]
        hp[0] += w[two] * p[0]
        hq[1] += sum(w[j] * np.cos(q[1]) for j in range(1, noises + 1) if j not in {one, two})
        return hq, hp

    found = ss.commutator(ss.Model(ndof=2, nnoise=noises, gradient=gradient, separable=True))
    assert not found.commutative and f"the noises {one} and {two} do not commute" in found.text


def test_a_large_linear_part_is_not_taken_for_a_bracket():
    """Differences of a gradient of size 1e6 give its Hessian to 1e-5 only, which is no evidence of a bracket."""

    def gradient(t, w, q, p):
        slope = 1e6 * (w[1] + 0.5 * w[2]) + w[1] * (q + p) / 2 + w[2] * np.cos(q + p) / 3
        return w[0] * q + slope, w[0] * p + slope

    assert ss.commutator(ss.Model(ndof=1, nnoise=2, gradient=gradient)).commutative


def test_chains_commute_by_their_traits():
    """All noises are functions of positions, so they commute exactly."""
    found = ss.commutator(ss.models.fpu_chain(n=8, beta=1.0, sigma=0.5))
    assert found.commutative and found.noise == 0 and not found.flows_commute


@pytest.mark.parametrize("hessian", ["by hand", "by differences", "by products"])
def test_noise_that_changes_in_time_does_not_commute_with_the_drift(hessian):
    """H_1 = sigma(t) (p^2 + q^2)/2: increments alone give order 1 with any scheme."""
    still = ss.commutator(rotation_in_time(hessian, lambda t: 0.5))
    assert still.flows_commute and "3 from gauss3" in still.text
    found = ss.commutator(rotation_in_time(hessian, lambda t: 0.5 + 0.4 * np.sin(4 * t)))
    assert found.commutative and not found.flows_commute and found.drift > 0.1
    assert "gauss3" not in found.text
    slowly = ss.commutator(rotation_in_time(hessian, lambda t: 0.5 + 1e-4 * t))
    assert not slowly.flows_commute and 1e-5 < slowly.drift < 1e-3


def rotation_in_time(hessian, sigma):
    """H = (p^2 + q^2)/2, H_1 = sigma(t) H."""

    def rate(t, w):
        return w[0] + sigma(t) * w[1]

    given = {
        "by hand": {"hessian": lambda t, w, q, p: tuple(f * rate(t, w)[None, None] for f in (1.0, 0.0, 1.0))},
        "by products": {"hessian_vector": lambda t, w, q, p, vq, vp: (rate(t, w) * vq, rate(t, w) * vp)},
        "by differences": {},
    }[hessian]
    return ss.Model(ndof=1, nnoise=1, gradient=lambda t, w, q, p: (rate(t, w) * q, rate(t, w) * p), **given)


@pytest.mark.parametrize("sigma", [0.0, 0.4])
def test_the_order_on_noise_in_time_is_the_one_told(sigma):
    """gauss2 against the rotation by t + int sigma dW on finer increments: order 2 if `commutator` promises it, else
    1."""
    model = rotation_in_time("by hand", lambda t: 0.5 + sigma * np.sin(4 * t))
    paths, levels, finest = 200, (4, 5, 6), 11
    dw = ss.increments(model, step=2.0**-finest, steps=2**finest, paths=paths, seed=3)[:, 0]
    middle = (np.arange(2**finest) + 0.5) / 2**finest
    angle = 1 + ((0.5 + sigma * np.sin(4 * middle))[:, None] * dw).sum(axis=0)
    errors = []
    for level in levels:
        run = ss.simulate(model, q0=1.0, p0=0.0, step=2.0**-level, steps=2**level, save_every=2**level, paths=paths,
                          seed=3, refine=finest - level, scheme="gauss2")  # fmt: skip
        errors.append(np.sqrt(np.mean((run.q[-1, 0] - np.cos(angle)) ** 2)))
    order = np.log2(errors[0] / errors[-1]) / (levels[-1] - levels[0])
    told = 2.0 if ss.commutator(model).flows_commute else 1.0
    assert abs(order - told) < 0.3, order


def test_points_must_fit():
    with pytest.raises(ss.errors.WrongShapeError, match="q"):
        ss.commutator(ss.models.kubo(), q=np.zeros((2, 3)), p=np.zeros((2, 3)))
    with pytest.raises(ss.errors.WrongTypeError, match="model"):
        ss.commutator("kubo")


def test_increments_have_the_law_of_the_scheme():
    model = ss.models.synchrotron()
    h = 0.25
    dw = ss.increments(model, step=h, steps=6, paths=200, seed=5, scheme="gauss2_weak2")
    assert set(np.unique(np.round(dw, 12))) == set(np.round([-np.sqrt(3 * h), 0, np.sqrt(3 * h)], 12))
    run = ss.simulate(model, q0=1.0, p0=0.0, step=h, steps=6, paths=200, seed=5, scheme="midpoint_weak1")
    signs = ss.increments(model, step=h, steps=6, paths=200, seed=5, scheme="midpoint_weak1")
    assert np.allclose(np.abs(signs), np.sqrt(h))
    again = ss.simulate(model, q0=1.0, p0=0.0, step=h, steps=6, paths=200, increments=signs, scheme="midpoint_weak1")
    assert np.array_equal(run.q, again.q)


def test_rounding_of_a_large_gradient_is_no_bracket():
    """H_1 = 1e6 q, H_2 = 1e6 p with gradients that are 1e6 but for rounding: differences show rounding alone."""

    def gradient(t, w, q, p):
        one, two = (np.sin(3 * x) ** 2 + np.cos(3 * x) ** 2 for x in (q + 2 * p, 2 * q - p))
        return w[0] * q + 1e6 * w[1] * one, w[0] * p + 1e6 * w[2] * two

    found = ss.commutator(ss.Model(ndof=1, nnoise=2, gradient=gradient))
    assert found.commutative and 0 < found.noise < 1e-6


def test_brackets_by_hand():
    """s p^2/2 and s q^2/2 at q = 1, p = 1: the gradient of their bracket is s^2 (q, p), products with fields both
    s^2; sigma(t) of noise in time from .5 to .500193."""
    found = ss.commutator(ss.models.noncommutative_oscillator(s1=0.5, s2=0.5), q=1.0, p=1.0)
    assert found.noise == pytest.approx(0.5, rel=1e-12)
    slowly = ss.commutator(rotation_in_time("by hand", lambda t: 0.5 + 1e-4 * t))
    assert slowly.drift == pytest.approx(1.93e-4 / 1.000193, rel=1e-6)


def test_the_orders_that_are_told():
    """The orders reported for every class of noise agree with the schemes' certificates."""
    silent = ss.Model(ndof=1, nnoise=0, gradient=lambda t, w, q, p: (w[0] * q, w[0] * p))
    told = {
        silent: "no noise: the order without noise of the scheme",
        ss.models.kubo(): "all flows commute: strong order 1 from midpoint, 2 from gauss2, 3 from gauss3, with "
        "increments alone",
        ss.models.synchrotron(): "the noises commute: strong order 1 from every consistent scheme with increments "
        "alone, 3/2 from gauss_dkdkd, 2 from gauss_dkdkd_strong2 with dZ; weak order 2 from gauss2_weak2",
        ss.models.noncommutative_oscillator(): "the noises 1 and 2 do not commute: strong order 1/2 with increments "
        "alone, 1 from midpoint_areas with areas; weak order 1, 2 from gauss2_weak2_areas",
    }
    for model, text in told.items():
        assert str(ss.commutator(model)) == text
    names = ("gauss2_strong32", "midpoint_areas", "gauss2_weak2", "gauss_dkdkd", "gauss_dkdkd_strong2")
    orders = {name: ss.schemes.get(name).info.orders for name in names}
    assert [orders[name]["commutative"].value for name in names[3:]] == [1.5, 2]
    assert orders["gauss2_strong32"]["commutative"].value == 1.5 and orders["midpoint_areas"]["general"].value == 1
    assert orders["gauss2_weak2"]["weak"].value == ss.schemes.get("gauss2_weak2_areas").info.orders["weak"].value == 2


def test_the_orders_of_kicks_are_told_where_these_fit():
    """Of a charge in a magnetic field, phases of two sites, and a pendulum whose noise holds momenta."""
    field = "(p1 + q2)**2/2 + (p2 - q1)**2/2 + q1**4/4"
    phases = "p1*p2 + q1*q2 + (p1**2 + q1**2)**2"
    told = {
        (field, "q1"): ", 2 from gauss_dkdkd with dZ; ",
        (field, "q1**2"): ", 3/2 from gauss_dkdkd, 2 from gauss_dkdkd_strong2 with dZ; ",
        (phases, "p2**2 + q2**2"): ", 3/2 from gauss_dkdkd, 2 from gauss_dkdkd_strong2 with dZ; ",
        (phases, "(p2**2 + q2**2)**2"): ", 3/2 from gauss_dkdkd with dZ; ",
        ("p1**2/2 - cos(q1) + p2**2/2", "p1**2 + q1**2"): ", 3/2 from gauss2_strong32 with dZ; ",
    }
    for (h, noise), text in told.items():
        assert text in str(ss.commutator(ss.model_from_sympy(h, [noise], q="q1 q2", p="p1 p2")))


@pytest.mark.parametrize("second", [2, 1])
def test_noises_that_touch_no_common_degree_of_freedom_commute(second):
    """H_1 = q_1^2/2 and H_2 = p_k^2/2, by their traits for k = 2; for k = 1 they meet, and do not."""

    def gradient(t, w, q, p):
        hq, hp = w[0] * q, w[0] * p
        hq[0] += w[1] * q[0]
        hp[second - 1] += w[2] * p[second - 1]
        return hq, hp

    found = ss.commutator(ss.Model(ndof=2, nnoise=2, gradient=gradient, touches=[[1], [second]]))
    assert found.commutative == (second == 2) and (found.noise == 0) == (second == 2)


def test_brackets_that_overflow_are_no_evidence_of_commuting():
    def gradient(t, w, q, p):
        return w[0] * q + 1e200 * w[1] * q, w[0] * p + 1e200 * w[2] * p

    def hessian(t, w, q, p):
        return tuple(np.broadcast_to(x, (1, 1, q.shape[1])) for x in (w[0] + 1e200 * w[1], 0.0, w[0] + 1e200 * w[2]))

    found = ss.commutator(ss.Model(ndof=1, nnoise=2, gradient=gradient, hessian=hessian))
    assert not found.commutative and found.noise == np.finfo(float).max
