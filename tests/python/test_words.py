# SPDX-License-Identifier: BSD-3-Clause
"""Splittings as words, word:BAOAB: steps letter by letter, harmonic laws, free diffusion, orders, bits, refusals."""

import math

import numpy as np
import pytest
import symsde as ss
from symsde.errors import IncompatibleError, InvalidArgumentError
from test_thermostat import linear_step, stationary

WORDS = ("BAOAB", "OBABO", "ABOBA", "OABAO")
OSCILLATOR = ss.model_from_sympy("p**2/2 + k*q**2/2", params={"k": 2.25})
WELL = ss.model_from_sympy("p**2/2 + q**4/4 - q**2/2")


def columns(word):
    """Number of functionals of the path that drive a step: dW, and dZ for two O."""
    return word.count("O")


def by_letters(word, step, state, noise, *, force, mass, gamma, sigma):
    """A step of a word by NumPy alone."""
    (q, p), (dw, a) = state, noise
    share = {letter: step / word.count(letter) for letter in "ABO"}
    halves = iter([dw] if word.count("O") == 1 else [dw / 2 + math.sqrt(3) * a, dw / 2 - math.sqrt(3) * a])
    for letter in word:
        if letter == "A":
            q = q + share["A"] * p / mass
        elif letter == "B":
            p = p + share["B"] * force(q)
        else:
            z = gamma * share["O"]
            p = np.exp(-z) * p + sigma(q) * next(halves) * math.sqrt(-math.expm1(-2 * z) / (2 * z))
    return q, p


@pytest.mark.parametrize("word", [*WORDS, "OBA", "BABAOABAB", "AOBOA"])
@pytest.mark.parametrize("noise", ["-s*q", "-s*sin(q)"])
def test_a_step_is_its_letters(word, noise):
    """The library's step consists of the steps of its letters, for 300 paths, a mass, nonlinear noise, both signs of
    h.
    """
    s, mass, gamma = 0.7, 2.5, 1.3
    model = ss.model_from_sympy("p**2/(2*m) - cos(q)", noise=[noise], params={"s": s, "m": mass}).damped(gamma)
    rng = np.random.default_rng(1)
    q, p = rng.normal(size=(2, 1, 300))
    for step in (0.4, -0.3):
        dw, a = rng.normal(size=(2, 300)) * np.array([[0.6], [0.2]])
        increments = np.array([[dw, step * (a + dw / 2)]])[:, : columns(word)]
        run = ss.simulate(
            model, q0=q, p0=p, paths=300, step=step, steps=1, scheme=f"word:{word}", increments=increments
        )
        sigma = (lambda x: s) if noise == "-s*q" else (lambda x: s * np.cos(x))
        laws = {"force": lambda x: -np.sin(x), "mass": mass, "gamma": gamma, "sigma": sigma}
        exact = by_letters(word, step, (q[0], p[0]), (dw, a), **laws)
        np.testing.assert_allclose(run.q[1, 0], exact[0], rtol=0, atol=1e-14)
        np.testing.assert_allclose(run.p[1, 0], exact[1], rtol=0, atol=1e-14)


@pytest.mark.parametrize("gamma", [0.01, 1.0, 30.0])
@pytest.mark.parametrize("step", [0.2, 0.8])
def test_harmonic_laws(step, gamma):
    """omega^2 <q^2>, <q p>, <p^2> at beta = 1, exact in h, for every gamma."""
    x = step**2 * 2.25 / 4
    expected = {"BAOAB": (1, 1 - x), "ABOBA": (1, 1 / (1 - x)), "OBABO": (1 / (1 - x), 1), "OABAO": (1 - x, 1)}
    for word, (q2, p2) in expected.items():
        bath = ss.thermostat(OSCILLATOR, beta=1.0, gamma=gamma)
        found = stationary(bath, f"word:{word}", step, columns(word))
        np.testing.assert_allclose(np.array(found) * (2.25, 1, 1), (q2, 0, p2), rtol=0, atol=1e-11)
        wrong = stationary(ss.thermostat(OSCILLATOR, beta=1.01, gamma=gamma), f"word:{word}", step, columns(word))
        assert abs(wrong[2] / p2 - 1) > 5e-3


@pytest.mark.parametrize("z", [1e-3, 0.5, 4.0, 12.0])
def test_free_particles(z):
    """<p^2> = 1/beta in every word for every gamma h; BAOAB diffuses (z/2) coth(z/2) times as fast as it should."""
    step = 0.5
    free = ss.thermostat(ss.model_from_sympy("p**2/2"), beta=1.0, gamma=z / step)
    for word in WORDS:
        m, noise = linear_step(free, f"word:{word}", step, columns(word))
        assert abs(m[1, 1] - math.exp(-z)) < 1e-15
        assert abs(m[1, 1] ** 2 + (noise[1] ** 2).sum() - 1) < 1e-13
    m, noise = linear_step(free, "word:BAOAB", step, 1)
    # q + m_qp p/(1 - m_pp) moves by its noise alone: its variance is the diffusion, exactly 2 h/(beta gamma)
    moved = noise[0] + m[0, 1] / (1 - m[1, 1]) * noise[1]
    ratio = (moved**2).sum() / (2 * step / (z / step))
    assert abs(ratio / ((z / 2) / math.tanh(z / 2)) - 1) < 1e-10


@pytest.mark.parametrize("word", WORDS)
def test_orders(word):
    """Strong order one on the path that chin4a follows; the form shrinks by exp(-gamma h)."""
    bath = ss.thermostat(WELL, beta=1.0, gamma=1.0)
    errors = []
    given = {"q0": 0.7, "p0": 0.3, "paths": 200, "seed": 3}
    fine = ss.simulate(bath, step=1 / 1024, steps=1024, save_every=1024, scheme="chin4a", **given)
    for k in (4, 7):
        run = ss.simulate(
            bath, step=2.0**-k, steps=2**k, save_every=2**k, refine=10 - k, scheme=f"word:{word}", **given
        )
        errors.append(np.sqrt(np.mean((run.q[-1] - fine.q[-1]) ** 2 + (run.p[-1] - fine.p[-1]) ** 2)))
    slope = np.log2(errors[0] / errors[1]) / 3
    assert 0.85 < slope < 1.25, slope
    dw = np.full((1, 1), 0.1)
    defect = ss.diagnose.symplecticity(bath, f"word:{word}", q=0.3, p=-0.4, step=0.3, dw=dw)
    assert defect.max() < 1e-11
    scheme = ss.schemes.from_word(word)
    assert scheme.name == f"word:{word}"
    assert (scheme.info.symplectic, scheme.info.symmetric) == (True, True)
    assert [scheme.info.orders[x].value for x in ("additive", "commutative", "weak")] == [1, 1, 2]


@pytest.mark.parametrize("word", WORDS)
def test_a_path_has_its_bits(word):
    """A path has the same bits in blocks and alone, damped and closed, with several degrees of freedom; a closed
    word is Verlet's step with noise.
    """
    closed = ss.models.fpu_chain(n=5, sigma=0.3)
    given = {"q0": 0.1, "p0": 0.3, "step": 0.05, "steps": 40, "save_every": 10, "seed": 5, "scheme": f"word:{word}"}
    for model in (ss.thermostat(WELL, beta=2.0, gamma=0.5), closed, closed.damped(0.7)):
        many = ss.simulate(model, paths=300, threads=2, **given)
        for path in (0, 299):
            alone = ss.simulate(model, paths=1, first_path=path, threads=1, **given)
            np.testing.assert_array_equal(many.q[..., path], alone.q[..., 0])
            np.testing.assert_array_equal(many.p[..., path], alone.p[..., 0])
    quiet = ss.models.fpu_chain(n=5, sigma=0.0)
    verlet = "verlet_kdk" if "BAB" in word or word == "BAOAB" else "verlet_dkd_weak2"
    found = ss.simulate(quiet, **given)
    other = ss.simulate(quiet, **{**given, "scheme": verlet})
    np.testing.assert_allclose(found.p, other.p, rtol=0, atol=1e-13)


def test_refusals():
    """Refused: texts that are no word, and models that a word does not fit."""
    for bad in ("", "BAB", "BOB", "AOA", "BAOAOAOB", "baoab", "BAO AB", "BAXAB", "BAOAB" * 6):
        with pytest.raises(InvalidArgumentError, match=r"is no word of a splitting: write .* as word:BAOAB|is empty"):
            ss.schemes.get(f"word:{bad}")
    given = {"q0": 0.1, "p0": 0.3, "step": 0.05, "steps": 4, "scheme": "word:BAOAB"}
    pair = ss.models.henon_heiles(sigma1=0.0, sigma2=0.0).damped([0.1, 0.2])
    with pytest.raises(IncompatibleError, match="is a word, whose noise has one law for all momenta, that of one rate"):
        ss.simulate(pair, **given)
    with pytest.raises(IncompatibleError, match="scheme word:BAOAB needs noise that depends on q alone"):
        ss.simulate(ss.models.kubo().damped(0.1), **given)


def test_a_word_recommends_what_damped_models_take():
    model = ss.model_from_sympy("p**2/2 + q**2/2", noise=["0.1*p*q"], damping=0.5)
    with pytest.raises(IncompatibleError, match=r"needs noise that depends on q alone.*: use midpoint \("):
        ss.simulate(model, scheme="word:BAOAB", q0=0.1, p0=0.0, step=0.1, steps=1)
    ss.simulate(model, scheme="midpoint", q0=0.1, p0=0.0, step=0.1, steps=1)
