# SPDX-License-Identifier: BSD-3-Clause
"""First passages between two steps: a bridge has the law of its noise, and a shared noise has one bridge."""

import math
import warnings

import numpy as np
import pytest
import symsde as ss
from symsde import observe
from symsde.errors import IncompatibleError

STEPS, BARRIER = 4, 2.0
EXACT = math.erfc(BARRIER / (2 * math.sqrt(2)))  # P(max of 2 W on (0, 1) >= BARRIER)
RUN = {"q0": 0.0, "p0": 0.0, "step": 1 / STEPS, "steps": STEPS, "save_every": STEPS}
DISCRETE = {name: law for name in ss.schemes.names() if (law := ss.schemes.get(name).info.law) != "Gaussian"}


def brownian(noises=1):
    """dq_k = 2 dW_k, which every scheme solves exactly."""
    return ss.Model(
        ndof=noises,
        nnoise=noises,
        gradient=lambda t, w, q, p: (np.zeros_like(q), 2 * w[1:] + 0 * p),
        separable=True,
        additive=True,
        any_lanes=True,
        derived=True,
    )


def passage(model, of="q_1", bridge=True, **options):
    wanted = {"out": observe.Passage(of, high=BARRIER, absorb=False, bridge=bridge)}
    return ss.moments(model, observers=wanted, **{"scheme": "symplectic_euler", **RUN, **options}).observed["out"]


@pytest.mark.parametrize("scheme", sorted(DISCRETE))
def test_discrete_increments_have_no_bridges(scheme):
    """With discrete increments, bridges are refused if noise acts on the value (here p), for any number of paths;
    checks at steps work.
    """
    assert set(DISCRETE.values()) == {"two-point", "three-point"}
    model = ss.models.linear_oscillator()
    for paths in (1, 300):
        with pytest.raises(
            IncompatibleError, match=f"the {DISCRETE[scheme]} increments .* give a scheme with Gaussian"
        ):
            passage(model, "p_1", scheme=scheme, paths=paths)
    assert passage(model, "p_1", scheme=scheme, paths=300, bridge=False).bridged is None
    assert passage(model, "q_1", scheme=scheme, paths=300).bridged is None


def test_bridges_belong_to_points_of_brownian_paths():
    """Given normal increments are points of a path: the law is that of the maximum within 5 sigma (6e-7).

    Also with a weak scheme. The twin: two-point increments, as this scheme would draw them, are off by a fifth.
    """
    rng, paths = np.random.default_rng(8), 20000
    shape = (STEPS, 1, paths)
    normal = math.sqrt(1 / STEPS) * rng.standard_normal(shape)
    for scheme in ("midpoint", "midpoint_weak1"):
        found = passage(brownian(), scheme=scheme, paths=paths, increments=normal)
        assert abs(found.lost[-1] - EXACT) < 5 * found.se_lost[-1] < 0.02
    coins = math.sqrt(1 / STEPS) * rng.choice([-1.0, 1.0], shape)
    twin = passage(brownian(), scheme="midpoint", paths=paths, increments=coins)
    assert abs(twin.lost[-1] - EXACT) > 15 * twin.se_lost[-1]


def test_a_shared_noise_has_one_bridge():
    """Equal paths leave together, with the law of one path: 5 sigma over 1000 seeds (6e-7).

    The twin: with private noises some leave and some stay.
    """
    model, seeds, steps = brownian(), 1000, []
    for seed in range(seeds):
        found = passage(model, paths=3, seed=seed, common_noise=1)
        assert found.n in (0, 3) and len(set(found.step)) <= 1
        steps.extend(found.step[:1])
    share = len(steps) / seeds
    assert abs(share - EXACT) < 5 * math.sqrt(EXACT * (1 - EXACT) / seeds)
    assert passage(model, paths=1000).n not in (0, 1000)


def test_own_noises_have_their_own_bridges():
    """q_1 is moved by a shared noise, q_2 by a private one; bridges of either kind are right in parts and blocks of a
    run, too."""
    model, together = brownian(2), set()
    for seed in range(20):
        options = {"paths": 512, "seed": seed, "common_noise": [1]}
        shared, own = (passage(model, of, **options) for of in ("q_1", "q_2"))
        part = passage(model, "q_1", **{**options, "paths": 256, "first_path": 256})
        assert shared.n in (0, 512) and part.n == shared.n / 2 and set(part.step) == set(shared.step)
        assert 0 < own.n < 512 and own.bridged > 0
        for change in ({"common_noise": []}, {"lanes": 8}):
            again = passage(model, "q_2", **{**options, **change})
            assert np.array_equal(again.path, own.path) and np.array_equal(again.step, own.step)
        together.add((shared.n, shared.bridged))
    assert len(together) == 3  # paths leave never, all at a step, or all between two steps


def test_increments_that_are_given_to_all_may_share_their_bridge():
    """One path's increments given for all paths: with `common_noise` the bridge is shared, too."""
    dw = np.array([[0.6], [-0.1], [0.1], [-0.2]])  # positions 1.2, 1.0, 1.2, 0.8
    apart, together = (passage(brownian(), paths=500, increments=dw, **common) for common in ({}, {"common_noise": 1}))
    assert 0 < apart.n < 500 and together.n in (0, 500)


@pytest.mark.parametrize("paths", [1, 3, 300])
@pytest.mark.parametrize("side", [-1, 1])
@pytest.mark.parametrize("of", ["q_1", "p_1", "sum"])
def test_an_end_is_outside(of, side, paths):
    """A value of 0, 1/2, 1 .. leaves (-1, 1) at the second step, exactly at one of the ends."""
    model = ss.Model(ndof=1, nnoise=0, gradient=lambda t, w, q, p: (-w[0] + 0 * q, w[0] + 0 * p), separable=True)
    shown = {"observables": {"sum": lambda q, p: (q + p)[0] / 2}, "observers": {"out": observe.Passage(of, -1, 1)}}
    run = {"q0": 0.0, "p0": 0.0, "step": side / 2, "steps": 4, "paths": paths, "scheme": "symplectic_euler"}
    found = ss.moments(model, **shown, **run).observed["out"]
    assert found.step.tolist() == [2] * paths and found.count[:, int(side > 0)].tolist() == [0, 0, paths, 0, 0]


@pytest.mark.parametrize("paths", [1, 3, 300])
@pytest.mark.parametrize("absorb", [True, False])
@pytest.mark.parametrize(("end", "edge"), [(0.55, math.inf), (0.55, 0.9), (0.55, 0.55), (0.9, 0.55)])
def test_a_value_that_is_lost_with_its_step(end, edge, absorb, paths):
    """A path whose step fails or whose value is NaN fails, and has then left through neither end.

    q = t; the force is NaN beyond `end`, the value beyond `edge`; every second path begins far below, and passes -4.85
    on its way. A path that has left without being absorbed may fail later, and is then lost.
    """
    model = ss.Model(
        ndof=1,
        nnoise=0,
        gradient=lambda t, w, q, p: (0 * q, np.where(q > end, np.nan, w[0] + 0 * p)),
        separable=True,
    )
    start, doomed = np.zeros((1, paths)), (paths + 1) // 2
    start[0, 1::2] = -5.0
    run = {"p0": 0.0, "step": 0.1, "steps": 12, "save_every": 4, "paths": paths, "scheme": "symplectic_euler"}
    watch = {
        "value": observe.Passage("x", low=-10.0, high=4.0, absorb=absorb),
        "upper": observe.Passage("x", high=-4.85 if absorb else 0.25, absorb=False),
    }
    with pytest.warns(ss.PathsFailedWarning):
        found = ss.moments(
            model,
            q0=start,
            observers=watch,
            observables={"x": lambda q, p: np.where(q[0] > edge, np.nan, q[0])},
            **run,
        )
    value, upper = found.observed["value"], found.observed["upper"]
    assert value.n == 0 and not value.lost.any()
    assert value.there.tolist() == found.n_ok.tolist() == [paths, paths, paths - doomed, paths - doomed]
    assert found.report.failed == doomed and found.failed.tolist()[:2] == [0, 2][: min(doomed, 2)]
    if absorb:  # paths from far below leave at -4.85; the others are beyond it from the start
        assert upper.n == paths and upper.there.tolist() == [paths - doomed, 0, 0, 0]
    else:  # paths leave at 0.3, after three steps, before they fail
        assert upper.n == doomed and set(upper.step) == {3} and upper.there.tolist() == [paths, *[paths - doomed] * 3]
    assert upper.count.sum() == upper.n


@pytest.mark.parametrize("absorb", [True, False])
@pytest.mark.parametrize("lanes", [None, 8, 64])
@pytest.mark.parametrize("of", ["p_1", "q_1"])
def test_what_becomes_of_others_is_nothing_to_a_path(of, lanes, absorb):
    """Every second path ends beyond q = 3 at a different step, or stays: the other paths leave by the same bridges in
    both cases, with rates that differ from path to path."""
    both, turn = (0.3, 0.2), of == "q_1"

    def gradient(t, w, q, p):
        rate = w[1] * (both[0] + both[1] * np.sin(5 * (p if turn else q)))
        ill = np.where(q > 3, np.nan, 0)
        return (ill + 0 * rate, w[0] * (1 + 0 * p) + rate) if turn else (ill + rate, w[0] * (1 + 0 * p))

    model = ss.Model(ndof=1, nnoise=1, gradient=gradient)
    paths, found = 200, []
    for doomed in (True, False):
        q0, p0 = np.linspace(-4.0, -3.0, paths)[None], np.linspace(-0.2, 0.2, paths)[None]
        if doomed:
            q0[:, 1::2] = 2.95 - 0.2 * (np.arange(paths // 2) % 9)
        watch = observe.Passage(of, *((-4.5, -1.5) if turn else (-0.6, 0.6)), absorb=absorb)
        run = {"step": 0.2, "steps": 9, "paths": paths, "lanes": lanes, "threads": 1, "seed": 2, "scheme": "heun"}
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ss.PathsFailedWarning)
            result = ss.moments(model, q0=q0, p0=p0, observers={"out": watch}, **run)
        assert (result.report.failed > 50) == doomed or turn
        out, healthy = result.observed["out"], result.observed["out"].path % 2 == 0
        found.append([x[healthy] for x in (out.path, out.step, out.state)])
    np.testing.assert_equal(found[0], found[1])
    assert 10 < len(found[0][0]) < 100 and out.bridged > 5


def test_steps_after_others_decide_by_numbers_of_their_own():
    """Steps from 100 on with the same increments and states have other bridges; the bridges of a part of a run are
    those of the whole run.
    """
    given = math.sqrt(1 / STEPS) * np.random.default_rng(9).standard_normal((STEPS, 1, 300))
    at = {first: passage(brownian(), paths=300, increments=given, first_step=first) for first in (0, 1, 100)}
    assert len({tuple(found.path) for found in at.values()}) == 3
    whole = passage(brownian(), paths=300, increments=given, save_every=1)
    run = {**RUN, "scheme": "symplectic_euler", "paths": 300, "increments": given, "save_every": 1}
    left = ss.simulate(brownian(), **run)
    later = passage(brownian(), q0=left.q[1], p0=left.p[1], paths=300, increments=given[1:], first_step=1, steps=3,
                    save_every=1)  # fmt: skip
    known = dict(zip(whole.path, whole.step, strict=True))
    after = dict(zip(later.path, later.step, strict=True))
    assert {path: step for path, step in known.items() if step > 1}.items() <= after.items()
