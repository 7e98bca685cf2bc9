# SPDX-License-Identifier: BSD-3-Clause
"""Given increments with dZ and K beside dW have the effect of a polygon of finer rows, or are refused."""

import numpy as np
import pytest
import symsde as ss

STEPS, FINE, PATHS, STEP = 3, 8, 5, 0.25
TWO = ss.models.synchrotron(omega=2.0, sigma1=0.8, sigma2=0.5)
START = {"q0": 1.0, "p0": 0.3, "step": STEP, "steps": STEPS, "paths": PATHS}


def polygon(parts):
    """Finer rows (step*part, noise, path), and dW, dZ, K of steps divided into `parts` parts, by hand."""
    rows = np.random.default_rng(5).normal(0.0, np.sqrt(STEP / FINE), (STEPS * FINE, 2, PATHS))
    number = FINE // parts
    w = rows.reshape(STEPS * parts, number, 2, PATHS)
    ends = np.arange(number + 1) / number
    area = ends**3 / 3 - ends**2 / 2 + ends / 6  # integral of s^2 - s + 1/6
    dz = np.einsum("j,ijnp->inp", 1 - (ends[1:] + ends[:-1]) / 2, w) * STEP / parts
    k = np.einsum("j,ijnp->inp", np.diff(area) * number / 2, w)
    return rows, w.sum(axis=1), dz, k


@pytest.mark.parametrize(("scheme", "columns"), [("gauss2_strong32", 2), ("gauss_dkdkd", 2), ("chin4a", 3)])
@pytest.mark.parametrize("parts", [1, 2])
def test_columns_drive_as_the_polygon_does(scheme, columns, parts):
    """Values by hand against the library's merging; with parts = 2, two rows a step are merged with their dZ and K."""
    rows, *known = polygon(parts)
    given = np.concatenate(known[:columns], axis=1)
    fine = ss.simulate(TWO, scheme=scheme, increments=rows, refine=3, **START)
    run = ss.simulate(TWO, scheme=scheme, increments=given, refine=parts - 1, **START)
    np.testing.assert_allclose([run.q, run.p], [fine.q, fine.p], rtol=0, atol=2e-14)
    one = ss.simulate(TWO, scheme=scheme, increments=given[:, :, 2], refine=parts - 1, **START)
    np.testing.assert_array_equal(one.q[:, :, 0], run.q[:, :, 2])
    for column in range(columns):  # each column matters
        other = given.copy()
        other[:, 2 * column] *= 1.1
        moved = ss.simulate(TWO, scheme=scheme, increments=other, refine=parts - 1, **START)
        assert np.abs(moved.q[-1] - run.q[-1]).max() > 1e-6


def test_a_prepared_run_takes_them():
    """A prepared run and `simulate` have the same bits."""
    given = np.concatenate(polygon(1)[1:], axis=1)
    whole = ss.simulate(TWO, scheme="chin4a", increments=given, **START)
    prepared = ss.prepare(TWO, "chin4a", q0=1.0, p0=0.3, step=STEP, paths=PATHS)
    parts = [prepared.run(1, increments=given[:1]), prepared.run(2, increments=given[1:])]
    np.testing.assert_array_equal(np.concatenate([parts[0].q, parts[1].q[1:]]), whole.q)


@pytest.mark.parametrize(
    ("scheme", "columns", "words"),
    [
        ("midpoint", 2, "4 columns for 2 noises, among them dZ, and scheme midpoint takes none"),
        ("gauss_dkdkd", 3, "among them K, and scheme gauss_dkdkd takes none"),
        ("chin4a", 2, "needs K"),
        ("chin4a", 1, "needs dZ and K"),
        ("gauss_dkdkd", 1, r"dZ and K as more columns \(all dW, all dZ, all K\)"),
        ("chin4a_strong2", 3, "needs J"),
        ("midpoint", 5, "columns beyond the noises are as many of dZ, of K, and of E"),
        ("midpoint", 1.5, "8 noises|3 noises"),
    ],
)
def test_columns_that_do_not_fit_get_a_sentence(scheme, columns, words):
    given = np.zeros((STEPS, int(2 * columns), PATHS))
    with pytest.raises(ValueError, match=words):
        ss.simulate(TWO, scheme=scheme, increments=given, **START)


def test_columns_that_are_not_finite_get_a_sentence():
    given = np.zeros((STEPS, 4, PATHS))
    given[1, 3, 0] = np.nan
    with pytest.raises(ValueError, match="not finite"):
        ss.simulate(TWO, scheme="gauss_dkdkd", increments=given, **START)


@pytest.mark.parametrize("scheme", ["midpoint", "gauss2_strong32", "chin4a"])
@pytest.mark.parametrize("refine", [-3, -2, 1])
def test_increments_have_their_variance_at_every_refinement(scheme, refine):
    """The variance is tested for each noise within 6 sigma of 144000 normals; two of the schemes also draw and halve
    dZ and K.
    """
    drawn = ss.increments(TWO, scheme=scheme, step=STEP, steps=8, paths=9000, refine=refine, seed=3)
    dw = drawn.reshape(8, -1, 2, 9000).sum(axis=1)
    n = dw[:, 0].size
    for row in dw.swapaxes(0, 1):
        assert np.mean(row**2) / STEP == pytest.approx(1, abs=6 * np.sqrt(2 / n))
    pairs = dw[1:] * dw[:-1]
    assert abs(pairs.mean()) / STEP < 6 / np.sqrt(pairs.size) and abs(
        (dw[:, 0] * dw[:, 1]).mean()
    ) / STEP < 6 / np.sqrt(n)


@pytest.mark.parametrize("scheme", ["midpoint", "gauss2", "stormer_verlet"])
@pytest.mark.parametrize("general", [False, True])
@pytest.mark.parametrize("paths", [1, PATHS, 70])
def test_what_is_given_is_cut_as_what_is_drawn(scheme, general, paths):
    """In a truncated run dW beyond the bound is set to the bound."""
    how = {"scheme": scheme, "truncation": (1.0, 30.0), "general": general, **START, "paths": paths}
    cut = np.sqrt(2 * np.log(30 / STEP) * STEP)
    given = np.random.default_rng(6).normal(0.0, 1.5 * cut, (STEPS, 2, paths))
    runs = [ss.simulate(TWO, increments=dw, **how) for dw in (given, given.clip(-cut, cut))]
    np.testing.assert_allclose([runs[0].q, runs[0].p], [runs[1].q, runs[1].p], rtol=0, atol=1e-12)
    assert np.abs(given).max() > cut and np.isfinite(runs[0].q).all()
