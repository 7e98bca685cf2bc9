# SPDX-License-Identifier: BSD-3-Clause
"""Shapes, states, reports, failures and files of runs; steps and increments."""

import json
import math
import os
import pickle
import re
import subprocess
import sys

import numpy as np
import pytest
import symsde as ss
from symsde.native import abi, handles
from symsde.native import progress as _progress
from symsde.run import options as run_options


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
    run = ss.simulate(model, q0=each[::-1], p0=np.float32(2), **common)  # arrays that are not contiguous, another type
    np.testing.assert_array_equal(run.q[0], each[::-1])
    assert (run.p == 2).all()


def test_times_and_negative_step(kubo):
    there = ss.simulate(kubo, q0=1.0, p0=0.0, t0=2.0, step=0.1, steps=20, seed=3)
    assert there.t[0] == 2.0 and there.t[-1] == 4.0
    dw = ss.increments(kubo, step=0.1, steps=20, seed=3)
    back = ss.simulate(kubo, q0=there.last_q, p0=there.last_p, t0=4.0, step=-0.1, steps=20, increments=-dw[::-1])
    np.testing.assert_allclose(back.q[-1], 1.0, atol=1e-14)


@pytest.mark.parametrize("where", [{}, {"t0": -0.3}, {"t0": 2.0, "first_step": 7}, {"step": -0.07}])
def test_times_are_those_that_the_library_fills_in(kubo, where):
    """Times are computed when read: the bits equal those of moments, also for prepared runs and copies."""
    how = {"q0": 1.0, "p0": 0.0, "step": 0.1, **where}
    run = ss.simulate(kubo, steps=30, save_every=3, **how)
    filled = ss.moments(kubo, steps=30, save_every=3, paths=2, **how).t
    assert "t" not in vars(run) and run.t.shape == (11,)
    assert run.t.tobytes() == filled.tobytes()
    assert run.t is run.t and run.t.flags.writeable
    saved = ss.prepare(kubo, **how).run(30, save_every=3)
    twin = pickle.loads(pickle.dumps(saved))
    assert "t" in vars(twin) and twin.t.tobytes() == filled.tobytes()


@pytest.mark.parametrize(("steps", "together"), [(10, False), (20_000, True)])
@pytest.mark.parametrize("paths", [1, 3])
def test_q_and_p_are_arrays_of_their_own(kubo, steps, together, paths):
    """q and p never overlap, even if both are parts of one block of memory."""
    run = ss.simulate(kubo, q0=1.0, p0=0.0, step=1e-3, steps=steps, paths=paths)
    assert (run.q.base is not None) == together
    assert run.q.flags.c_contiguous and run.p.flags.c_contiguous and not np.shares_memory(run.q, run.p)
    np.testing.assert_allclose(run.q**2 + run.p**2, 1, rtol=1e-11)
    few = ss.simulate(kubo, q0=1.0, p0=0.0, step=1e-3, steps=steps, paths=paths, save_every=steps)
    assert np.array_equal(run.q[-1], few.q[-1]) and np.array_equal(run.p[-1], few.p[-1])


def test_report(kubo, options):
    report = ss.simulate(kubo, **options).report
    assert report.status == 0 and report.outcome == "ok"
    assert report.counters["path_steps"] == 40 * 12
    assert report.counters["normals"] >= 40 * 12
    assert report.versions["version"] == ss.__version__
    assert report.timings["run"] > 0 and report.timings["setup"] > 0 and report.failed == 0
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
    with pytest.warns(ss.PathsFailedWarning, match="1 path failed"):
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
    assert np.abs(half.q_low).max() > 0
    rest = ss.simulate(
        kubo,
        q0=half.last_q,
        p0=half.last_p,
        q0_low=half.q_low,
        p0_low=half.p_low,
        first_step=500,
        steps=500,
        save_every=500,
        **common,
    )
    np.testing.assert_array_equal(rest.last_q, whole.last_q)
    np.testing.assert_array_equal(rest.p_low, whole.p_low)
    assert ss.simulate(kubo, q0=1.0, p0=0.0, step=0.1, steps=1).q_low is None


def test_truncation_is_reported(kubo, options):
    report = ss.simulate(kubo, truncation=(2.0, 1.0), **options).report
    assert 0 < report.lost_variance < 0.05**2


@pytest.mark.parametrize("masses", [3, 5, 16])
@pytest.mark.parametrize("scheme", ["stormer_verlet", "symplectic_euler"])
def test_a_path_alone_fails_as_in_company(masses, scheme):
    """A chain far out of its range overflows in the same step, alone and in a block, and its status says so."""
    common = {"q0": 30.0, "p0": 0.0, "step": 1.5, "steps": 12, "scheme": scheme}
    with pytest.warns(ss.PathsFailedWarning):
        alone, many = (ss.simulate(ss.models.fpu_chain(n=masses), **common, paths=n) for n in (1, 20))
    assert alone.status[0] == many.status[0] == 3 and alone.failed_step[0] == many.failed_step[0] > 0
    np.testing.assert_array_equal(alone.q[:, :, 0], many.q[:, :, 0])


def test_truncation_takes_an_order_and_a_time():
    """Increments end at sqrt(h) sqrt(2 l |log(h/tau)|), a bound that one in 2000 of these increments would exceed."""
    order, time, step = 1.0, 20.0, 0.05
    given = {"step": step, "steps": 1000, "paths": 100}
    cut, whole = (abs(ss.increments(ss.models.kubo(), truncation=x, **given)).max() for x in ((order, time), None))
    bound = math.sqrt(step * 2 * order * math.log(time / step))
    assert cut == pytest.approx(bound, rel=1e-14) and whole > bound


@pytest.mark.parametrize("paths", [1, 3, 100])
@pytest.mark.parametrize("how", [{}, {"refine": 1}, {"refine": -1}, {"first_step": 5}])
def test_few_paths_are_truncated_as_many(paths, how):
    """One in 390 normals is clipped, at any place of a draw: the output of `increments` drives the same run."""
    model, given = ss.models.synchrotron(), {"step": 0.05, "steps": 6400, "paths": paths, "truncation": (0.76, 20.0)}
    dw = ss.increments(model, **given, **how)
    cut = np.isclose(np.abs(dw), np.abs(dw).max(), rtol=1e-14)
    assert all(cut[i::8].any() for i in range(8))
    given |= {"q0": 0.3, "p0": 0.1, "save_every": 100}
    run = ss.simulate(model, **given, **how)
    given |= {"truncation": None, "increments": dw, "first_step": how.get("first_step", 0)}
    driven = ss.simulate(model, **given)
    np.testing.assert_array_equal([run.q, run.p], [driven.q, driven.p])


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


@pytest.mark.parametrize("tqdm", [True, False])
def test_progress_bar(tqdm, user_kubo, capsys, monkeypatch):
    """The progress bar shows all path-steps, begins at zero, ends, and leaves no line; without tqdm there are per
    cents.
    """
    if tqdm:
        pytest.importorskip("tqdm")
    else:
        monkeypatch.setitem(sys.modules, "tqdm.auto", None)
    shares = []
    real = _progress._Bar.__call__

    def told(self, done, total):
        real(self, done, total)
        assert total == 3 * 40_000
        assert self._bar.n == done if tqdm else self._shown == 100 * done // total
        shares.append(done / total)

    monkeypatch.setattr(_progress._Bar, "__call__", told)
    run = ss.simulate(user_kubo, q0=1.0, p0=0.0, step=1e-3, steps=40_000, save_every=1000, paths=3, progress=True)
    assert run.report.status == 0
    shown = capsys.readouterr()
    assert shown.out == ""
    percents = [int(x) for x in re.findall(r"(\d+) ?%", shown.err)]
    assert percents and percents == sorted(percents) and percents[0] <= 100 * shares[0] + 0.5
    assert set(percents) <= {0, *(math.floor(100 * x) for x in shares), *(round(100 * x) for x in shares)}
    assert shares[0] > 0 and shares == sorted(shares) and shares[-1] <= 1
    assert shown.err.endswith("\r") and shown.err.rstrip("\r").rpartition("\r")[2].strip() == ""
    if tqdm:
        bars = [part for part in shown.err.split("\r") if part.strip()]
        assert all("step/s" in bar and "/120k " in bar for bar in bars)


def test_no_progress_no_output(user_kubo, capsys):
    ss.simulate(user_kubo, q0=1.0, p0=0.0, step=1e-3, steps=3000, save_every=1000)
    assert capsys.readouterr() == ("", "")


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


def lattice(sites, sigma, noises_at=None, **declared):
    """Oscillators, each noise in the stiffness of one site."""
    at = list(range(sites)) if noises_at is None else noises_at

    def stiffness(w):
        k = np.repeat(w[:1], sites, axis=0)
        for j, site in enumerate(at):
            k[site] += sigma * w[1 + j]
        return k

    def hessian(t, w, q, p):
        eye = np.eye(sites)[:, :, None]
        return eye * stiffness(w), np.zeros_like(eye * w[0]), eye * w[0]

    def gradient(t, w, q, p):
        return stiffness(w) * q, w[0] * p

    return ss.Model(ndof=sites, nnoise=len(at), gradient=gradient, hessian=hessian, **declared)


@pytest.mark.parametrize("form", ["catalogue", "formula"])
def test_the_frequency_of_a_chain_is_that_of_its_rows(form):
    """The largest row sum of |H_qq| at the initial state, whether the chain offers rows or bands."""
    if form == "catalogue":
        model = ss.models.fpu_chain(n=5, sigma=0.1, beta=0.7)
    else:
        springs = "Sum(p[i]**2/2, i) + Sum((q[i+1]-q[i])**2/2 + beta*(q[i+1]-q[i])**4/4, i)"
        model = ss.model_from_sympy(springs, ["-0.1*q[k]"], params={"beta": 0.7}, n=5, ends="fixed")
    q0 = np.array([0.3, -0.8, 0.5, 1.1, -0.2])
    sums = np.abs(model.hessian(q0, 0.0)[0][:, :, 0]).sum(axis=0)
    (said,) = ss.simulate(model, q0=q0, p0=0.0, step=1.0, steps=1).report.warnings[:1]
    assert float(re.match(r"h\*omega = ([\d.]+)", said)[1]) == pytest.approx(math.sqrt(sums.max()), rel=1e-3)


@pytest.mark.parametrize("bandwidth", [None, 0, 1])
def test_noises_on_different_sites_do_not_add_up(bandwidth):
    """Solvable for certain while sigma |dW|/2 < 1: normals below 2/(sigma sqrt h) = 6.3 here, for any number of
    sites.
    """
    run = {"q0": 1.0, "p0": 0.0, "step": 0.1, "steps": 10, "paths": 3}

    def alarms(*given):
        report = ss.simulate(lattice(*given, separable=True, bandwidth=bandwidth), **run).report
        return [text for text in report.warnings if "so strong that some implicit steps" in text]

    assert alarms(20, 1.0) == []
    (said,) = alarms(20, 2.0)  # 20 noises, 3 paths, 10 steps: 600 erfc(3.162/sqrt 2) = 0.94
    assert "normals above 3.162" in said
    expected = 600 * math.erfc(math.sqrt(5))
    assert float(re.search(r"about ([\d.]+) of them", said)[1]) == pytest.approx(expected, rel=1e-3)
    (said,) = alarms(20, 1.0, [4] * 20)  # all noises on one site do add up
    assert "normals above 0.316" in said


THREADS = """
import symsde as ss
run = ss.simulate(ss.models.kubo(), q0=1.0, p0=0.0, step=0.1, steps=1, paths=64, lanes=8%s)
print(run.report.threads)
"""


def with_threads(value, more=""):
    """Number of threads of a run in a process with this SYMSDE_NUM_THREADS, or the error that the process prints."""
    environment = {**os.environ, "SYMSDE_NUM_THREADS": value, "OMP_NUM_THREADS": "2"}
    code = THREADS % more
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=False)
    return int(done.stdout) if done.returncode == 0 else done.stderr.splitlines()[-1]


def test_threads_by_the_environment():
    assert with_threads("3") == 3 and with_threads(" 4 ") == 4 and with_threads("1024") == 8  # a thread per block
    assert with_threads("3", ", threads=2") == 2  # the option wins
    assert with_threads("") == 2  # OpenMP's number


@pytest.mark.parametrize("value", ["abc", "0", "-2", "1025", "2.5", "3,5", "4x", "1e3", "9" * 40, "2*3", "3 4"])
def test_an_environment_that_names_no_threads_is_refused(value):
    said = with_threads(value)
    assert isinstance(said, str) and said.startswith("symsde.errors.InvalidArgumentError"), said
    assert f'SYMSDE_NUM_THREADS is "{value[:32]}"' in said and "from 1 to 1024" in said


def shaken(**more):
    """H = p^2/2 + q sin t, H_1 = q cos t: steps depend on their time."""
    return ss.Model(
        ndof=1,
        nnoise=1,
        gradient=lambda t, w, q, p: (w[0] * np.sin(t) + w[1] * np.cos(t) + 0 * q, w[0] * p),
        value=lambda t, w, q, p: (w[0] * (p**2 / 2 + q * np.sin(t)) + w[1] * q * np.cos(t))[0],
        separable=True,
        **more,
    )


def test_one_step_begins_at_its_time():
    """The midpoint evaluates H at t + h/2: p falls by h sin(t + h/2) + dw cos(t + h/2)."""
    h, dw = 0.1, 0.3
    for t in (0.0, 0.7, -2.0):
        q, p = ss.step(shaken(), "midpoint", 1.0, 0.5, h, dw, t=t)
        fall = h * math.sin(t + h / 2) + dw * math.cos(t + h / 2)
        assert p[0, 0] == pytest.approx(0.5 - fall, rel=1e-12)
        assert q[0, 0] == pytest.approx(1.0 + h * (0.5 - fall / 2), rel=1e-12)


def test_runs_and_evaluations_take_place_at_their_times():
    model = shaken()
    run = ss.simulate(model, q0=1.0, p0=0.5, t0=0.7, step=0.1, steps=3, first_step=4, increments=np.zeros((3, 1)))
    expected = [0.5]
    for n in (4, 5, 6):
        expected.append(expected[-1] - 0.1 * math.sin(0.7 + 0.1 * (n + 0.5)))
    np.testing.assert_allclose(run.p[:, 0, 0], expected, rtol=1e-13)
    np.testing.assert_allclose(run.t, [1.1, 1.2, 1.3, 1.4], rtol=1e-14)
    assert model.value(2.0, 1.0, [1.0, 0.5], t=0.3)[0] == pytest.approx(0.5 + 2 * math.sin(0.3) + math.cos(0.3))
    assert model.gradient(2.0, 1.0, [1.0, 0.5], t=0.3)[0][0, 0] == pytest.approx(math.sin(0.3) + 0.5 * math.cos(0.3))
    for t0 in (0.0, 0.7):
        energy = ss.moments(model, q0=1.0, p0=0.5, t0=t0, step=0.1, steps=0).mean_energy
        assert energy[0] == pytest.approx(0.125 + math.sin(t0))


def test_derivatives_and_probes_take_place_at_their_times():
    def stiffness(t):
        return 1 + t**2

    model = ss.Model(
        ndof=1,
        nnoise=0,
        gradient=lambda t, w, q, p: (w[0] * stiffness(t) * q, w[0] * p),
        hessian=lambda t, w, q, p: ((w[0] * stiffness(t if t < 1 else 2 * t))[None, None], 0.0, w[0][None, None]),
    )
    assert model.hessian(1.0, 0.0, t=0.5)[0][0, 0, 0] == pytest.approx(1.25)
    model.probe(t=0.5)
    with pytest.raises(ss.errors.FalseTraitError, match=r"(?i)hessian"):
        model.probe(t=1.5)


def test_rounding_that_cycles_ends_an_iteration():
    """A stiff spring that hardens: Newton's corrections stay at a few ulps, and the step still counts as solved."""
    model = ss.Model(
        ndof=1,
        nnoise=1,
        gradient=lambda t, w, q, p: (w[0] * (2000 * q + q**3) - 0.3 * w[1], w[0] * p),
        hessian=lambda t, w, q, p: ((w[0] * (2000 + 3 * q**2))[None], 0 * q[None], (w[0] * np.ones_like(q))[None]),
        separable=True,
        additive=True,
        position_noise=True,
        identity_mass=True,
    )
    run = ss.simulate(model, q0=0.5, p0=1.0, step=0.1, steps=100, scheme="midpoint", paths=32, seed=1)
    counters = run.report.counters
    assert not run.status.any() and counters["failures"] == 0
    assert counters["iterations"] < 12 * counters["path_steps"]  # 7 are taken; 37 if cycles were not recognised


def test_defaults_of_options_are_those_of_the_library():
    """Defaults come from the library, and reading one changes nothing."""
    library = bytes(handles.new(abi.Options, "options"))
    for name, read in run_options.READ.items():
        options = handles.new(abi.Options, "options")
        read(options, name, run_options.DEFAULTS[name])
        assert bytes(options) == library, name


@pytest.mark.parametrize(
    "scheme", ["gauss2", "gauss2_strong32", "gauss2_weak2", "gauss2_strong32_areas", "gauss2_weak2_areas"]
)
@pytest.mark.parametrize("model", [ss.models.synchrotron, ss.models.pendulum, ss.models.driven_pendulum])
def test_the_last_lanes_of_a_block_go_on_as_they_began(model, scheme):
    """Steps in which some of 256 paths iterate longer: these paths have the bits of blocks of eight."""
    how = {"q0": 0.4, "p0": 0.1, "step": 1.2, "steps": 10, "scheme": scheme, "paths": 256, "seed": 3, "threads": 1}
    large, small = (ss.simulate(model(), lanes=lanes, **how) for lanes in (256, 8))
    np.testing.assert_array_equal([large.q, large.p], [small.q, small.p])
    for name in ("path_steps", "normals", "iterations", "solves", "failures"):
        assert large.report.counters[name] == small.report.counters[name]


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_step_that_overflows_is_counted_once(seed):
    """Three gradients are counted for each step, also for the failing step."""
    with pytest.warns(ss.PathsFailedWarning):
        run = ss.simulate(
            ss.models.linear_oscillator(), q0=1.0, p0=0.0, step=3.0, steps=400, scheme="stormer_verlet", seed=seed
        )
    done = run.report.counters["path_steps"]
    assert (run.status == 3).all() and done == run.failed_step.sum()
    assert run.report.counters["gradients"] == 3 * (done + 1)


@pytest.mark.parametrize("scheme", ["midpoint", "gauss2"])
def test_steps_that_damping_solves_are_counted_as_damped(scheme):
    """Newton's iteration jumps back and forth over the kink of log cosh without damping; with damping no step needs
    continuation.
    """
    model = ss.Model(
        ndof=1,
        nnoise=0,
        gradient=lambda t, w, q, p: (w[0] * np.tanh(5 * q), w[0] * p),
        hessian=lambda t, w, q, p: [
            x[None, None] for x in (5 * w[0] / np.cosh(5 * q[0]) ** 2, 0 * q[0], w[0] + 0 * q[0])
        ],
        separable=True,
    )
    run = ss.simulate(model, q0=np.linspace(-1, 2, 30)[None], p0=0.3, step=4.0, steps=4, scheme=scheme, paths=30)
    counters = run.report.counters
    assert counters["damped"] == counters["failures"] > 9 and counters["continued"] == 0 and not run.status.any()


@pytest.mark.parametrize("paths", [1, 20])
def test_a_step_that_neither_sweeps_nor_newton_solve_fails(paths):
    """Two degrees of freedom by gradients alone and too few iterations: every path fails in its first step."""

    def gradient(t, w, q, p):
        s, sin = p[0] ** 2 + p[1] ** 2, np.sin(q[0] * q[1])
        force = [w[0] * (q[0] * s - 5 * sin * q[1]) + 0.5 * w[1], w[0] * (4 * q[1] ** 3 - 5 * sin * q[0])]
        return np.stack(force), w[0] * (1 + q[0] ** 2) * p

    how = {"q0": [0.4, 0.8], "p0": [3.0, 5.0], "step": 2.0, "steps": 8, "paths": paths, "max_iter": 5}
    with pytest.warns(ss.PathsFailedWarning):
        run = ss.simulate(ss.Model(ndof=2, nnoise=1, gradient=gradient), **how)
    assert (run.status == 1).all() and not run.failed_step.any()
    assert np.isnan(run.q[1:]).all() and run.report.counters["failures"] >= paths
