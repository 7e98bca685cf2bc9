# SPDX-License-Identifier: BSD-3-Clause
"""A path has the same bits however the run is divided."""

import numpy as np
import pytest
import symsde as ss

PATHS = 700
COMMON = {"p0": 0.1, "step": 0.05, "seed": 11}


def models():
    return [
        ss.models.kubo(),
        ss.models.synchrotron(),
        ss.models.pendulum(),
        ss.models.henon_heiles(),
    ]


def bits(run):
    return run.q.tobytes() + run.p.tobytes()


@pytest.mark.parametrize("model", models(), ids=lambda m: m.name)
@pytest.mark.parametrize("scheme", ["midpoint", "symplectic_euler", "gauss2"])
def test_threads_and_lanes(model, scheme):
    common = {"q0": 0.3, "steps": 20, "save_every": 5, "paths": PATHS, "scheme": scheme, **COMMON}
    reference = bits(ss.simulate(model, threads=1, **common))
    for threads in (2, 3):
        assert bits(ss.simulate(model, threads=threads, **common)) == reference
    for lanes in (8, 64, 256, 1000):
        assert bits(ss.simulate(model, lanes=lanes, **common)) == reference


@pytest.mark.parametrize("model", models(), ids=lambda m: m.name)
def test_subsets_of_paths(model):
    common = {"q0": 0.3, "steps": 20, **COMMON}
    whole = ss.simulate(model, paths=PATHS, **common)
    for first, count in ((0, 1), (3, 50), (255, 2), (699, 1)):
        part = ss.simulate(model, first_path=first, paths=count, **common)
        np.testing.assert_array_equal(part.q, whole.q[:, :, first : first + count])
        np.testing.assert_array_equal(part.p, whole.p[:, :, first : first + count])


def test_refine_nests():
    model = ss.models.synchrotron()
    fine = ss.increments(model, step=0.01, steps=64, paths=9, seed=2)
    for level in (1, 2, 3):
        n = 2**level
        coarse = ss.increments(model, step=0.01 * n, steps=64 // n, paths=9, seed=2, refine=level)
        total = fine
        for _ in range(level):
            total = total[0::2] + total[1::2]
        np.testing.assert_array_equal(coarse, total)
    coarse = {"q0": 0.3, "p0": 0.0, "step": 0.04, "steps": 16, "paths": 9, "seed": 2, "refine": 2}
    given = ss.simulate(model, increments=fine, **coarse)
    np.testing.assert_array_equal(given.q, ss.simulate(model, **coarse).q)


def test_bridge_keeps_the_increments():
    model = ss.models.kubo()
    whole = ss.increments(model, step=0.1, steps=8, paths=5, seed=4)
    halves = ss.increments(model, step=0.05, steps=16, paths=5, seed=4, refine=-1)
    np.testing.assert_allclose(halves[0::2] + halves[1::2], whole, rtol=0, atol=1e-15)
    assert np.abs(halves[0::2] - whole / 2).max() > 0.01


def test_resume():
    model = ss.models.synchrotron()
    common = {"paths": 33, **COMMON}
    whole = ss.simulate(model, q0=0.3, steps=41, **common)
    first = ss.simulate(model, q0=0.3, steps=17, **common)
    rest = ss.simulate(model, q0=first.last_q, steps=24, first_step=17, **{**common, "p0": first.last_p})
    np.testing.assert_array_equal(rest.q, whole.q[17:])
    np.testing.assert_array_equal(rest.t, whole.t[17:])


def test_saving_less_often_changes_nothing():
    common = {"q0": 0.3, "steps": 40, "paths": 20, **COMMON}
    every, some = (ss.simulate(ss.models.kubo(), save_every=n, **common) for n in (1, 8))
    np.testing.assert_array_equal(every.q[::8], some.q)


def test_moments_do_not_depend_on_threads():
    common = {"q0": 0.3, "steps": 20, "paths": PATHS, **COMMON}
    one, two, lanes = (
        ss.moments(ss.models.kubo(), **common, **o) for o in ({"threads": 1}, {"threads": 2}, {"lanes": 8})
    )
    for other in (two, lanes):
        np.testing.assert_array_equal(one.mean_q, other.mean_q)
        np.testing.assert_array_equal(one.var_p, other.var_p)


def test_seeds_differ():
    common = {"step": 0.1, "steps": 100, "paths": 1}
    a, b, c = (ss.increments(ss.models.kubo(), seed=s, **common) for s in (0, 1, 2**64 - 1))
    assert not (a == b).any() and not (a == c).any()
