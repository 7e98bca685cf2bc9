# SPDX-License-Identifier: BSD-3-Clause
"""Moments equal those of the saved paths."""

import csv
import warnings

import numpy as np
import pytest
import symsde as ss
from conftest import table_of


def test_equal_to_those_of_saved_paths(options):
    model = ss.models.henon_heiles()
    options |= {"q0": 0.1, "paths": 600}
    observables = {"last": lambda q, p: p[1], "r": lambda q, p: np.hypot(q[0], q[1])}
    found = ss.moments(model, observables=observables, **options)
    run = ss.simulate(model, **options)
    assert found.mean_q.shape == (5, 2) and found.mean_energy.shape == found.mean["r"].shape == (5,)
    energy = np.array([model.value(q, p) for q, p in zip(run.q, run.p, strict=True)])
    radius = np.hypot(run.q[:, 0], run.q[:, 1])
    pairs = [
        (found.mean_q, found.var_q, found.se_mean_q, run.q),
        (found.mean_p, found.var_p, found.se_mean_p, run.p),
        (found.mean_energy, found.var_energy, found.se_mean_energy, energy),
        (found.mean["r"], found.var["r"], found.se_mean["r"], radius),
    ]
    for mean, variance, error, values in pairs:
        np.testing.assert_allclose(mean, values.mean(axis=-1), rtol=1e-12, atol=1e-15)
        np.testing.assert_allclose(variance, values.var(axis=-1, ddof=1), rtol=1e-11, atol=1e-24)
        np.testing.assert_allclose(error, np.sqrt(variance / 600), rtol=1e-13)
    assert (found.n_ok == 600).all() and found.failed.size == 0


def test_failed_paths_are_left_out():
    model = ss.models.henon_heiles()
    start = np.full((2, 300), 0.1)
    start[:, [5, 270]] = 20.0
    common = {"q0": start, "p0": 0.0, "step": 0.1, "steps": 60, "paths": 300, "scheme": "stormer_verlet"}
    with pytest.warns(ss.PathsFailedWarning, match="2 paths failed"):
        found = ss.moments(model, first_path=512, **common)
    np.testing.assert_array_equal(found.failed, [517, 782])
    assert (found.failed_status > 0).all() and (found.failed_step > 0).all()
    assert found.n_ok[0] == 300 and found.n_ok[-1] == 298 and found.report.failed == 2
    with pytest.warns(ss.PathsFailedWarning):
        run = ss.simulate(model, first_path=512, **common)
    good = run.q[-1][:, run.status == 0]
    np.testing.assert_allclose(found.mean_q[-1], good.mean(axis=1), rtol=1e-12)


@pytest.mark.parametrize(("lanes", "threads"), [(8, 1), (64, 1), (8, 2), (None, 1)])
def test_python_observables_are_asked_for_many_times_at_once(lanes, threads):
    """A block hands several saved times to the function at once, failed lanes, too: the bits are those of q itself."""
    model = ss.models.henon_heiles()
    start = np.full((2, 50), 0.1)
    start[:, [5, 41]] = [[0.2, 20.0]]
    sizes = []

    def first(q, p):
        sizes.append(q.shape)
        return q[0]

    how = {"q0": start, "p0": 0.0, "step": 0.1, "steps": 60, "paths": 50, "scheme": "stormer_verlet", "lanes": lanes}
    with pytest.warns(ss.PathsFailedWarning, match="1 path failed"):
        found = ss.moments(model, observables={"first": first, "other": lambda q, p: p[1] + 0}, threads=threads, **how)
    for kind in ("mean", "var", "se_mean"):
        np.testing.assert_array_equal(getattr(found, kind)["first"], getattr(found, f"{kind}_q")[:, 0])
        np.testing.assert_array_equal(getattr(found, kind)["other"], getattr(found, f"{kind}_p")[:, 1])
    block = found.report.lanes
    del sizes[:3]  # calls of the probe
    assert sum(n for _, n in sizes) == -(-50 // block) * block * 61
    assert max(n for _, n in sizes) <= 4096 and len(sizes) == -(-50 // block)


@pytest.mark.parametrize("paths", [1, 3, 20, 300])
@pytest.mark.parametrize("every", [1, 2])
@pytest.mark.parametrize("ends", ["all", "absorbed", "some"])
def test_observables_of_paths_that_all_end_early(paths, every, ends):
    """States kept until the last path of a block ended are still evaluated: the means are those of saved paths."""

    def gradient(t, w, q, p):
        return np.where(q > 1.3, np.nan, -w[0] * q + 0.1 * w[1]), w[0] * p

    model = ss.Model(ndof=1, nnoise=1, gradient=gradient)
    start = np.linspace(0.9, 1.1, paths)[None]
    if ends == "some":
        start[:, :1] = -9.0
    how = {"q0": start, "p0": 0.3, "step": 0.1, "steps": 20, "save_every": every, "paths": paths, "scheme": "heun"}
    watch = {"out": ss.observe.Passage("q", high=1.2)} if ends == "absorbed" else {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # warnings of failed paths, and of times without any ok path
        found = ss.moments(model, observables={"a": lambda q, p: q[0] ** 2}, observers=watch, **how)
        run = ss.simulate(model, **{**how, "save_every": 1})
        q = run.q[:, 0]
        if ends == "absorbed":
            q = np.where(np.maximum.accumulate(q, axis=0) < 1.2, q, np.nan)
        values = q[::every] ** 2
        mean = np.nanmean(np.where(np.isfinite(values), values, np.nan), axis=1)
    counts = np.isfinite(values).sum(axis=1)
    np.testing.assert_array_equal(found.n_ok, counts)
    np.testing.assert_allclose(found.mean["a"], mean, rtol=1e-12)
    assert counts[0] == paths and counts[-1] == (1 if ends == "some" else 0)


def test_growth_of_energy():
    """E(p^2 + q^2)/2 = sigma^2 t/2 (24), times the midpoint's factor 1/(1 + h^2/4); five standard errors: 6e-7."""
    found = ss.moments(
        ss.models.linear_oscillator(sigma=1.0), q0=0.0, p0=0.0, step=0.1, steps=100, paths=20000, save_every=100
    )
    expected = 0.5 * 10 / (1 + 0.1**2 / 4)
    assert abs(found.mean_energy[-1] - expected) < 5 * found.se_mean_energy[-1] < 0.3
    assert abs(found.mean_energy[-1] - 0.9 * expected) > 5 * found.se_mean_energy[-1]


def test_one_path_has_no_variance(kubo):
    found = ss.moments(kubo, q0=1.0, p0=0.0, step=0.1, steps=5)
    assert np.isnan(found.var_q).all() and np.isfinite(found.mean_q).all()


def test_model_without_value():
    model = ss.Model(ndof=1, nnoise=0, gradient=lambda t, w, q, p: (w[0] * q, w[0] * p))
    found = ss.moments(model, q0=1.0, p0=0.0, step=0.1, steps=5, paths=3)
    assert found.columns() == ["q_1", "p_1"]
    for name in ("mean_energy", "var_energy", "se_mean_energy"):
        with pytest.raises(ss.errors.MissingOperationError, match="no energies of user"):
            getattr(found, name)


def test_files(kubo, options, tmp_path):
    found = ss.moments(kubo, observables={"I": lambda q, p: q[0] ** 2 + p[0] ** 2}, **options)
    found.save(tmp_path / "moments.csv")
    rows = list(csv.reader(table_of(tmp_path / "moments.csv")))
    assert rows[0][:4] == ["t", "n_ok", "mean q_1", "mean p_1"] and "se_mean I" in rows[0]
    assert len(rows) == 6 and float(rows[3][2]) == found.mean_q[2, 0]
    found.save(tmp_path / "moments.npz")
    with np.load(tmp_path / "moments.npz") as read:
        np.testing.assert_array_equal(read["mean_I"], found.mean["I"])
    pytest.importorskip("xarray")
    assert found.to_xarray().mean_energy.dims == ("time",)
