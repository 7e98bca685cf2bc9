# SPDX-License-Identifier: BSD-3-Clause
"""Shapes, states, reports, failures and files of runs; steps and increments."""

import json

import numpy as np
import pytest
import symsde as ss


def test_shapes(options):
    model = ss.models.henon_heiles()
    run = ss.simulate(model, **{**options, "q0": 0.1})
    assert run.t.shape == (5,)
    assert run.q.shape == run.p.shape == (5, 2, 12)
    assert run.status.shape == run.failed_step.shape == run.path.shape == (12,)
    assert run.last_q.shape == run.last_p.shape == (2, 12)
    np.testing.assert_array_equal(run.t, 10 * 0.05 * np.arange(5))
    assert not run.status.any() and (run.failed_step == -1).all()
    np.testing.assert_array_equal(run.q[-1], run.last_q)
    assert "henon_heiles" in repr(run) and "12 paths" in repr(run)


def test_arrays_are_those_of_the_library(kubo, options):
    run = ss.simulate(kubo, **options)
    for array in (run.t, run.q, run.p, run.status):
        assert array.flags.c_contiguous and array.flags.owndata and array.flags.writeable


def test_initial_states():
    model = ss.models.henon_heiles()
    common = {"step": 0.1, "steps": 0, "paths": 3}
    each = np.arange(6.0).reshape(2, 3)
    run = ss.simulate(model, q0=each, p0=[0.5, 0.25], **common)
    np.testing.assert_array_equal(run.q[0], each)
    np.testing.assert_array_equal(run.p[0], [[0.5] * 3, [0.25] * 3])
    assert run.q.shape == (1, 2, 3)
    run = ss.simulate(model, q0=each[::-1], p0=np.float32(2), **common)  # not contiguous, another type
    np.testing.assert_array_equal(run.q[0], each[::-1])
    assert (run.p == 2).all()


def test_times_and_negative_step(kubo):
    there = ss.simulate(kubo, q0=1.0, p0=0.0, t0=2.0, step=0.1, steps=20, seed=3)
    assert there.t[0] == 2.0 and there.t[-1] == 4.0
    dw = ss.increments(kubo, step=0.1, steps=20, seed=3)
    back = ss.simulate(kubo, q0=there.last_q, p0=there.last_p, t0=4.0, step=-0.1, steps=20, increments=-dw[::-1])
    np.testing.assert_allclose(back.q[-1], 1.0, atol=1e-14)


def test_report(kubo, options):
    report = ss.simulate(kubo, **options).report
    assert report.status == 0 and report.outcome == "ok"
    assert report.counters["path_steps"] == 40 * 12
    assert report.counters["normals"] >= 40 * 12
    assert report.versions["version"] == ss.__version__
    assert report.timings["run"] >= 0 and report.failed == 0
    assert "stepper" in str(report)
    quiet = ss.simulate(ss.models.kubo(sigma=0.0), **options).report
    assert quiet.counters["normals"] == 0
    assert any("no noise" in text for text in quiet.left_out)


def test_increments_drive_a_run(kubo, options):
    dw = ss.increments(kubo, step=0.05, steps=40, paths=12, seed=7)
    assert dw.shape == (40, 1, 12)
    given, drawn = ss.simulate(kubo, increments=dw, **options), ss.simulate(kubo, **options)
    np.testing.assert_array_equal(given.q, drawn.q)
    for_all = ss.simulate(kubo, increments=dw[:, :, 3], **options)
    np.testing.assert_array_equal(for_all.q[:, :, 0], drawn.q[:, :, 3])
    np.testing.assert_array_equal(for_all.q[:, :, 11], drawn.q[:, :, 3])


def test_step_is_the_cayley_transform(kubo):
    theta = np.array([[0.2, -0.4, 1.0]])
    q, p = ss.step(kubo, "midpoint", [[1.0, 0.5, 0.0]], 0.25, 0.1, (theta - 0.1) / 0.3)
    half = theta / 2
    expected = ((1 - half**2) * np.array([[1.0, 0.5, 0.0]]) + 2 * half * 0.25) / (1 + half**2)
    np.testing.assert_allclose(q, expected, rtol=1e-14)
    assert q.shape == p.shape == (1, 3)
    q, p = ss.step(ss.models.henon_heiles(), "midpoint", [0.1, 0.2], 0.0, 0.1, [0.0, 0.1])
    assert q.shape == (2, 1)


def test_failed_paths_are_counted_and_nan():
    model = ss.models.henon_heiles()
    start = np.array([[0.1, 20.0], [0.1, 20.0]])
    with pytest.warns(ss.PathsFailedWarning, match="1 paths failed"):
        run = ss.simulate(model, q0=start, p0=0.0, step=0.1, steps=100, paths=2, scheme="stormer_verlet", seed=1)
    assert run.report.failed == 1 and run.report.outcome == "some paths failed"
    assert run.status[0] == 0 and run.status[1] > 0
    assert ss.status_text(run.status[1])
    failed = run.failed_step[1]
    assert 0 <= failed < 100
    assert np.isfinite(run.q[: failed + 1, :, 1]).all() and np.isnan(run.q[failed + 1 :, :, 1]).all()
    assert np.isfinite(run.last_q).all()
    np.testing.assert_array_equal(run.last_q[:, 1], run.q[failed, :, 1])
    alone = ss.simulate(model, q0=start[:, :1], p0=0.0, step=0.1, steps=100, scheme="stormer_verlet", seed=1)
    np.testing.assert_array_equal(alone.q[:, :, 0], run.q[:, :, 0])


def test_compensated_resume(kubo):
    common = {"step": 1e-3, "paths": 4, "seed": 5, "compensated": True}
    whole = ss.simulate(kubo, q0=1.0, p0=0.0, steps=1000, save_every=500, **common)
    half = ss.simulate(kubo, q0=1.0, p0=0.0, steps=500, save_every=500, **common)
    assert np.abs(half.low_q).max() > 0
    rest = ss.simulate(
        kubo,
        q0=half.last_q,
        p0=half.last_p,
        q0_low=half.low_q,
        p0_low=half.low_p,
        first_step=500,
        steps=500,
        save_every=500,
        **common,
    )
    np.testing.assert_array_equal(rest.last_q, whole.last_q)
    np.testing.assert_array_equal(rest.low_p, whole.low_p)
    assert ss.simulate(kubo, q0=1.0, p0=0.0, step=0.1, steps=1).low_q is None


def test_truncation_is_reported(kubo, options):
    report = ss.simulate(kubo, truncation=(2.0, 1.0), **options).report
    assert 0 < report.lost_variance < 0.05**2


def test_fixed_point_agrees_with_newton(options):
    model = ss.models.synchrotron()
    newton, fixed = (ss.simulate(model, fixed_point=n, **options).q for n in (0, 100))
    np.testing.assert_allclose(newton, fixed, rtol=0, atol=1e-13)


def test_progress_is_told_and_may_stop(user_kubo):
    told = []

    def progress(done, total):
        told.append((done, total))
        return len(told) == 3

    run = ss.simulate(user_kubo, q0=1.0, p0=0.0, step=1e-3, steps=10**6, save_every=1000, progress=progress)
    assert len(told) == 3 and told[0][0] < told[2][0] < told[2][1] == 10**6
    assert run.report.outcome == "stopped on request" and run.report.stopped == 1
    assert np.isfinite(run.q[0]).all() and np.isnan(run.q[-1]).all()


def test_progress_bar(user_kubo, capsys):
    run = ss.simulate(user_kubo, q0=1.0, p0=0.0, step=1e-3, steps=3000, save_every=1000, progress=True)
    assert run.report.status == 0


def test_netcdf(kubo, options, tmp_path):
    xarray = pytest.importorskip("xarray")
    pytest.importorskip("netCDF4")
    run = ss.simulate(kubo, first_path=100, **options)
    data = run.to_xarray()
    assert data.q.dims == ("time", "dof", "path")
    assert int(data.path[0]) == 100
    assert np.shares_memory(data.q.values, run.q)
    run.save(tmp_path / "run.nc")
    with xarray.open_dataset(tmp_path / "run.nc") as read:
        np.testing.assert_array_equal(read.q, run.q)
        np.testing.assert_array_equal(read.time, run.t)
        assert read.attrs["model"] == "kubo" and json.loads(read.attrs["options"])["seed"] == 7
        assert read.attrs["symsde_version"] == ss.__version__
    assert [path.name for path in tmp_path.iterdir()] == ["run.nc"]


def test_npz(kubo, options, tmp_path):
    run = ss.simulate(kubo, **options)
    run.save(tmp_path / "run.npz")
    with np.load(tmp_path / "run.npz") as read:
        np.testing.assert_array_equal(read["q"], run.q)
        assert json.loads(str(read["attributes"]))["scheme"] == "midpoint"
    with pytest.raises(ValueError, match=r"run\.xls.*\.nc or \.npz"):
        run.save(tmp_path / "run.xls")
