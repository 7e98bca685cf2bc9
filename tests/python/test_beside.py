# SPDX-License-Identifier: BSD-3-Clause
"""Statements of docs/beside.md about symsde, on points where packages differ; the page names each of these tests.

False alarms: the three tests of random numbers allow five standard errors, 6e-7 for each number.
"""

import re
from pathlib import Path

import numpy as np
import pytest
import symsde as ss
from symsde.errors import InvalidArgumentError

ROOT = Path(__file__).parents[2]
RING = ss.models.synchrotron()  # two noises
RUN = {"q0": 0.7, "p0": 0.1, "step": 0.1, "steps": 20, "seed": 3, "paths": 7}


def kicked(noises=1, strength=1.0):
    """A model with p_k = p_k(0) + strength W_k and constant q, for which every scheme is exact."""
    return ss.Model(
        ndof=noises,
        nnoise=noises,
        gradient=lambda t, w, q, p: (-strength * w[1:] + 0 * q, np.zeros_like(p)),
        separable=True,
        additive=True,
        position_noise=True,
        any_lanes=True,
    )


def same(one, other):
    return np.array_equal(one.q, other.q) and np.array_equal(one.p, other.p)


def test_threads_and_the_number_of_paths_change_no_bit():
    run = ss.simulate(RING, **RUN)
    for threads in (1, 2, 3):
        many = ss.simulate(RING, **RUN | {"paths": 700}, threads=threads)
        assert np.array_equal(many.q[..., :7], run.q) and np.array_equal(many.p[..., :7], run.p)
    assert np.array_equal(ss.simulate(RING, **RUN | {"paths": 2}, first_path=5).q, run.q[..., 5:])


def test_the_seed_alone_chooses_the_noise():
    """NumPy's generator and earlier runs do not matter, and NumPy's generator is left unchanged."""
    np.random.seed(1)
    before = np.random.get_state()[1].copy()
    first = ss.simulate(RING, **RUN)
    assert np.array_equal(np.random.get_state()[1], before)
    np.random.seed(2)
    ss.simulate(RING, **RUN | {"seed": 4})
    assert same(ss.simulate(RING, **RUN), first) and not same(ss.simulate(RING, **RUN | {"seed": 4}), first)


def test_neighbouring_seeds_are_unrelated():
    """First increments of seeds 0, 1, 2, .. have variance 1 and no correlation with those of the next seed; each of
    the 64 bits of a seed counts. Weak generators fail: one too wide, one that shares noise with the next seed, one
    whose paths share noise, one that takes 32 bits of a seed.
    """
    model, count, paths = kicked(), 300, 100

    def first(seed):
        return ss.simulate(model, q0=0.0, p0=0.0, step=1.0, steps=1, paths=paths, seed=seed).p[1, 0]

    def related(draw):
        z = np.array([draw(seed) for seed in range(count)])
        found = {
            "variance": abs((z**2).mean() - 1) > 5 * np.sqrt(2 / z.size),
            "next seed": abs((z[1:] * z[:-1]).mean()) > 5 / np.sqrt(z[1:].size),
            "one seed": abs(z.mean(axis=1).var() * paths - 1) > 5 * np.sqrt(2 / count),
            "bits": len({draw(5 ^ 2**bit if bit < 64 else 5)[0] for bit in range(65)}) < 65,
        }
        return {name for name, fails in found.items() if fails}

    assert not related(first)
    assert related(lambda seed: 1.1 * first(seed)) == {"variance"}
    assert related(lambda seed: (first(seed) + first(seed + 1)) / np.sqrt(2)) == {"next seed"}
    assert related(lambda seed: np.sqrt(0.91) * first(seed) + 0.3 * first(seed)[0]) == {"one seed"}
    assert related(lambda seed: first(seed % 2**32)) == {"bits"}


def test_the_first_kick_is_whole():
    """The first kick is a whole one: half a kick would give a quarter or a half of the variance, a uniform force
    another kurtosis.
    """
    paths, h, sigma = 200_000, 0.1, 0.7
    run = ss.simulate(
        ss.models.linear_oscillator(sigma=sigma),
        q0=0.0,
        p0=0.0,
        step=h,
        steps=1,
        paths=paths,
        scheme="symplectic_euler",
    )
    z = run.p[1, 0] / (sigma * np.sqrt(h))
    assert abs(z.var() - 1) < 5 * np.sqrt(2 / paths)
    assert abs(np.mean(z**4) / z.var() ** 2 - 3) < 5 * np.sqrt(24 / paths)


def test_save_every_that_does_not_divide_is_refused():
    with pytest.raises(InvalidArgumentError, match="multiple of save_every"):
        ss.simulate(RING, **RUN | {"steps": 10}, save_every=3)


def test_times_are_steps():
    """Times are t0 + n h to a rounding or two, backward too; a sum of steps would be less exact."""
    for step in (0.1, -0.1):
        run = ss.simulate(RING, **RUN | {"step": step, "steps": 10_000}, save_every=1000, t0=0.3)
        exact = 0.3 + np.arange(0, 10_001, 1000) * step
        assert (abs(run.t - exact) <= np.spacing(abs(exact))).all()
        assert abs(np.cumsum([0.3] + [step] * 10_000)[-1] - exact[-1]) > 10 * np.spacing(abs(exact[-1]))


def test_a_run_in_pieces_is_the_run():
    whole = ss.simulate(RING, **RUN | {"steps": 40})
    first = ss.simulate(RING, **RUN)
    more = first.extend(20)
    assert np.array_equal(more.q, whole.q[20:]) and np.array_equal(more.p, whole.p[20:])
    start = {"q0": first.q[-1], "p0": first.p[-1], "first_step": 20}
    assert np.array_equal(ss.simulate(RING, **RUN | start).q[-1], whole.q[-1])


def test_states_between_steps_are_on_the_path():
    """With half the step and refine=-1 the path is the same at whole steps, and the variance of W after the first half
    step is 1/2."""
    paths = 200_000
    options = {"q0": 0.0, "p0": 0.0, "paths": paths, "scheme": "symplectic_euler"}
    whole = ss.simulate(kicked(), step=1.0, steps=1, **options)
    halves = ss.simulate(kicked(), step=0.5, steps=2, refine=-1, **options)
    np.testing.assert_allclose(halves.p[2], whole.p[1], rtol=0, atol=1e-14)
    assert abs(halves.p[1, 0].var() - 0.5) < 5 * 0.5 * np.sqrt(2 / paths)


def test_schemes_and_further_noises_leave_the_increments_as_they_are():
    """W(T) is the same for schemes that draw more functionals, and W_1 does not depend on a second noise."""
    options = {"q0": 0.0, "p0": 0.0, "step": 0.1, "steps": 5, "paths": 4, "seed": 1}
    ends = [
        ss.simulate(kicked(), scheme=name, **options).p[-1]
        for name in ("midpoint", "symplectic_euler", "gauss2_strong32")
    ]
    for end in ends[1:]:
        np.testing.assert_allclose(end, ends[0], rtol=0, atol=1e-14)
    two = ss.simulate(kicked(2), **options).p[-1]
    np.testing.assert_allclose(two[0], ends[0][0], rtol=0, atol=1e-14)


def test_increments_are_differences_of_the_path():
    """Given increments are dW, not dW/dt and not normals of variance one."""
    dw = np.array([[0.3], [-0.5], [0.1]])[..., None]
    run = ss.simulate(kicked(), q0=0.0, p0=0.0, step=0.01, steps=3, increments=dw)
    np.testing.assert_allclose(run.p[:, 0, 0], [0.0, 0.3, -0.2, -0.1], atol=1e-15)


def test_momenta_stand_at_the_time_of_positions():
    """Halving the step quarters leapfrog's error of p; momenta half a step earlier would halve their error."""
    errors = []
    for steps in (50, 100):
        run = ss.simulate(
            ss.models.linear_oscillator(sigma=0.0), q0=1.0, p0=0.0, step=5 / steps, steps=steps, scheme="stormer_verlet"
        )
        errors.append(abs(run.p[-1, 0, 0] + np.sin(5.0)))
    assert 3.8 < errors[0] / errors[1] < 4.2


def test_equations_are_those_of_stratonovich():
    """Kubo's oscillator keeps q^2 + p^2 in the Stratonovich sense; in Ito's it would grow by sigma^2 dt."""
    run = ss.simulate(ss.models.kubo(sigma=0.5), q0=1.0, p0=0.0, step=0.05, steps=100, paths=5)
    assert abs(run.q**2 + run.p**2 - 1).max() < 1e-12


def test_damping_is_a_rate_of_momenta():
    """Without force p falls by exp(-gamma t) for any mass, and q comes to rest a distance p/(gamma m) away."""
    body = ss.model_from_sympy("p**2/(2*m)", params={"m": 3.0}, damping=0.5)
    run = ss.simulate(body, q0=0.0, p0=1.0, step=0.1, steps=30, scheme="gauss_dkdkd")
    assert abs(run.p[-1, 0, 0] - np.exp(-1.5)) < 1e-14
    assert abs(run.q[-1, 0, 0] - (1 - np.exp(-1.5)) / 1.5) < 1e-14


def test_the_page_names_these_tests():
    page = (ROOT / "docs" / "beside.md").read_text(encoding="utf-8")
    named = set(re.findall(r"`(test_\w+)`", page))
    assert named == {name for name in globals() if name.startswith("test_")} - {"test_the_page_names_these_tests"}
