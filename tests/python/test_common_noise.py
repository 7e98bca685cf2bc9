# SPDX-License-Identifier: BSD-3-Clause
"""Noises that all paths share have the bits of path 0 in every path: runs, moments, shards, prepared and exact runs."""

import numpy as np
import pytest
import symsde as ss
from symsde import diagnose, errors

MODEL = ss.models.synchrotron()
RUN = {"q0": 0.4, "p0": 0.2, "step": 0.05, "steps": 40, "seed": 7}


def shared(plain: np.ndarray, of_first: np.ndarray, noises: list[int]) -> np.ndarray:
    """Increments (step, noise, path) in which these noises are those of path 0."""
    result = plain.copy()
    for k in noises:
        result[:, k - 1] = of_first[:, k - 1, :1]
    return result


@pytest.mark.parametrize("refine", [0, 2, -1])
@pytest.mark.parametrize("noises", [[1], [2], [1, 2]])
@pytest.mark.parametrize("paths", [1, 3, 300])
def test_increments_of_path_0_in_every_path(noises, refine, paths):
    options = {**RUN, "paths": paths, "first_path": 500, "refine": refine}
    plain = diagnose.driving_increments(ss.simulate(MODEL, **options))
    first = diagnose.driving_increments(ss.simulate(MODEL, **{**options, "first_path": 0, "paths": 1}))
    run = ss.simulate(MODEL, **options, common_noise=noises)
    given = diagnose.driving_increments(run)
    np.testing.assert_array_equal(given, shared(plain, first, noises))
    again = ss.simulate(MODEL, **{**options, "refine": 0}, increments=given)
    np.testing.assert_array_equal(run.q, again.q)


def test_more_noises_than_are_drawn_at_once():
    """Noises of one's own beside common ones, which came before them in the same places of the generator."""
    model, noises = ss.models.fpu_chain(n=100), list(range(1, 65))
    options = {"q0": 0.1, "p0": 0.0, "step": 0.05, "steps": 2, "seed": 7, "paths": 3, "first_path": 500}
    plain = diagnose.driving_increments(ss.simulate(model, **options))
    first = diagnose.driving_increments(ss.simulate(model, **{**options, "first_path": 0, "paths": 1}))
    given = diagnose.driving_increments(ss.simulate(model, **options, common_noise=noises))
    np.testing.assert_array_equal(given, shared(plain, first, noises))


@pytest.mark.parametrize("scheme", ["gauss2_strong32", "chin4a", "midpoint_areas", "gauss2_weak2"])
def test_a_part_of_the_paths_has_the_bits_of_the_whole(scheme):
    model = ss.models.noncommutative_oscillator() if scheme == "midpoint_areas" else MODEL
    options = {**RUN, "scheme": scheme, "common_noise": [2]}
    whole = ss.simulate(model, **options, paths=300)
    part = ss.simulate(model, **options, first_path=290, paths=5, lanes=8, threads=1)
    np.testing.assert_array_equal(part.q, whole.q[:, :, 290:295])
    private = ss.simulate(model, **{**options, "common_noise": ()}, paths=300)
    assert (whole.q[-1, 0, 1:] != private.q[-1, 0, 1:]).all() and (whole.q[:, :, 0] == private.q[:, :, 0]).all()


def test_the_last_of_64_noises():
    """Every noise is common, up to the largest index: all paths are equal."""
    run = ss.simulate(
        ss.models.fpu_chain(n=64), q0=0.1, p0=0.0, step=0.05, steps=2, paths=3, common_noise=list(range(1, 65))
    )
    np.testing.assert_array_equal(run.q, np.repeat(run.q[:, :, :1], 3, axis=2))


def test_moments_and_shards():
    options = {**RUN, "common_noise": [1], "paths": 1000, "save_every": 20}
    runs, mean = ss.simulate(MODEL, **options), ss.moments(MODEL, **options)
    np.testing.assert_allclose(mean.mean_q[:, 0], runs.q[:, 0].mean(axis=1), rtol=1e-12)
    assert (mean.mean_q[-1] != ss.moments(MODEL, **{**options, "common_noise": ()}).mean_q[-1]).all()
    pieces = ss.ensemble(MODEL, **options, shard_paths=256)
    np.testing.assert_array_equal(pieces.mean_q, mean.mean_q)


def test_prepared_runs():
    options = {key: value for key, value in RUN.items() if key != "steps"}
    run = ss.prepare(MODEL, **options, paths=20, common_noise=[2])
    run.step()
    run.run(39)
    whole = ss.simulate(MODEL, **RUN, paths=20, common_noise=[2])
    np.testing.assert_array_equal(run.q, whole.q[-1])


def test_a_shared_additive_noise_moves_all_paths_alike():
    """H = (p^2+q^2)/2 with H_2 = -q: differences of paths do not depend on W_2, and neither do differences of exact
    solutions."""
    model = ss.models.additive_oscillator(sigma=0.3, gamma=1.0)
    starts = {"q0": [[0.0, 1.0, 2.0]], "p0": [[0.0, 0.0, 0.0]]}
    both = ss.simulate(model, **{**RUN, **starts}, paths=3, common_noise=[1, 2])
    for x in (both.q, diagnose.exact(both)[0]):
        np.testing.assert_allclose(x[:, 0, 2] - x[:, 0, 1], x[:, 0, 1] - x[:, 0, 0], rtol=0, atol=1e-12)
    one = diagnose.exact(ss.simulate(model, **RUN, paths=3, common_noise=[2]))[0]
    assert abs((one[-1, 0, 2] - one[-1, 0, 1]) - (one[-1, 0, 1] - one[-1, 0, 0])) > 1e-3
    error = np.abs(both.q - diagnose.exact(both)[0]).max()
    assert error < 0.05  # the midpoint's error at h = 0.05


def test_several_particles_in_one_noisy_field():
    """The spread of an ensemble given a common noise is that of one realisation, not of all realisations."""
    model = ss.models.linear_oscillator(sigma=1.0)
    options = {**RUN, "steps": 400, "save_every": 400, "paths": 2000}
    private = ss.moments(model, **options)
    common = ss.moments(model, **options, common_noise=1)
    assert common.var_q[-1, 0] < 1e-20
    assert private.var_q[-1, 0] > 1


@pytest.mark.parametrize("given", [1, (1, 1), [np.int64(1)] * 3, np.array([1.0, 1.0]), {1}])
def test_a_noise_may_be_named_again(given):
    """`common_noise` as a list, tuple or array: the same bits, and the same words in files."""
    once, found = (ss.simulate(MODEL, **RUN, paths=3, common_noise=x) for x in ([1], given))
    np.testing.assert_array_equal(found.q, once.q)
    assert found.attributes()["options"] == once.attributes()["options"]


@pytest.mark.parametrize(
    ("given", "error", "words"),
    [
        ([3], errors.InvalidArgumentError, "common_noise holds 3, and the model has 2 noises, counted from 1"),
        ([0], errors.InvalidArgumentError, "common_noise holds 0: noises count from 1"),
        ([65], errors.InvalidArgumentError, "common_noise holds 65: .* among the first 64"),
        (["1"], errors.WrongTypeError, "common_noise"),
        ([1.5], errors.WrongTypeError, "common_noise"),
        (None, errors.WrongTypeError, "common_noise"),
    ],
)
def test_what_is_no_noise_gets_a_sentence(given, error, words):
    with pytest.raises(error, match=words):
        ss.simulate(MODEL, **RUN, common_noise=given)
