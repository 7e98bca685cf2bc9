# SPDX-License-Identifier: BSD-3-Clause
"""Sweeps: means by value of a parameter, from paths that run side by side."""

import csv
import warnings

import numpy as np
import pytest
import symsde as ss
from symsde.errors import InvalidArgumentError, PathsFailedWarning, UnknownNameError, WrongShapeError, WrongTypeError
from symsde.run import sweep as module

H, NOISE = "p**2/2 - omega**2*cos(q)", ["s*sin(q)"]
OMEGA, S = np.array([0.7, 1.3, 2.1]), np.array([0.1, 0.4])
RUN = {"q0": 0.5, "p0": 0.2, "step": 0.05, "steps": 20, "save_every": 10, "seed": 5}


def model(**values):
    """Synchrotron oscillations."""
    return ss.model_from_sympy(H, noise=NOISE, params={"omega": 1.0, "s": 0.2} | values)


def one(n=40, *, first_path=0, arrays=True, **values):
    """The run of one value of each parameter."""
    values = {key: np.array([x]) for key, x in values.items()} if arrays else values
    return ss.simulate(model(**values), **RUN, paths=n, first_path=first_path)


def require_means(found, where, run, at=slice(None)):
    """Require that means, variances and errors of a point are those of its paths."""
    for mine, theirs in (
        (found.mean_q, run.q.mean(2)),
        (found.mean_p, run.p.mean(2)),
        (found.var_q, run.q.var(2, ddof=1)),
    ):
        np.testing.assert_allclose(mine[(slice(None), at, *where)], theirs, rtol=1e-11, atol=1e-13)
    n = run.q.shape[2]
    np.testing.assert_allclose(found.mean_energy[(slice(None), *where)], run.energy.mean(1), rtol=1e-12)
    error = run.energy.std(1, ddof=1) / np.sqrt(n)
    np.testing.assert_allclose(found.se_mean_energy[(slice(None), *where)], error, rtol=1e-9, atol=1e-15)
    assert (found.n_ok[(slice(None), *where)] == n).all()


def test_product():
    """Sweeps over all combinations: point k has the paths first_path + 40 k and on, and their bits."""
    found = ss.sweep(model(), {"omega": OMEGA, "s": S}, **RUN, paths=40, first_path=256, keep_paths=True)
    assert found.mean_q.shape == (3, 1, 3, 2) and found.mean_energy.shape == (3, 3, 2) and found.dims == ("omega", "s")
    assert found.q.shape == (3, 1, 3, 2, 40) and found.status.shape == (3, 2, 40)
    for i, omega in enumerate(OMEGA):
        for j, s in enumerate(S):
            run = one(omega=omega, s=s, first_path=256 + 40 * (2 * i + j))
            assert np.array_equal(found.q[:, :, i, j], run.q) and np.array_equal(found.p[:, :, i, j], run.p)
            require_means(found, (i, j), run)
    shifted = one(omega=OMEGA[0], s=S[0], first_path=257)  # the twin: another index, or another value
    assert abs(shifted.q.mean(2) - found.mean_q[:, :, 0, 0]).max() > 1e-4
    wrong = one(omega=OMEGA[0] * 1.01, s=S[0], first_path=256)
    assert abs(wrong.q.mean(2) - found.mean_q[:, :, 0, 0]).max() > 1e-4


def test_any_first_path():
    """Any first path, with paths kept or not: the same bits of means, and the paths that runs alone have."""
    asked = {**RUN, "paths": 40, "first_path": 100}
    kept = ss.sweep(model(), {"omega": OMEGA}, **asked, keep_paths=True)
    found = ss.sweep(model(), {"omega": OMEGA}, **asked)
    for kind in ("mean", "var", "se_mean"):
        assert np.array_equal(found.table(kind), kept.table(kind))
    for i, omega in enumerate(OMEGA):
        run = one(omega=omega, first_path=100 + 40 * i)
        assert np.array_equal(kept.q[:, :, i], run.q) and np.array_equal(kept.p[:, :, i], run.p)
        require_means(found, (i,), run)


def test_zip_and_observables():
    """Sweeps over rows of values; formulas and functions as observables."""
    asked = {"square": "q**2", "sum": lambda q, p: q[0] + p[0]}
    found = ss.sweep(model(), {"omega": OMEGA[:2], "s": S}, **RUN, paths=40, zip=True, observables=asked)
    assert found.dims == ("value",) and found.mean["square"].shape == (3, 2)
    for i in range(2):
        run = one(omega=OMEGA[i], s=S[i], first_path=40 * i)
        require_means(found, (i,), run)
        np.testing.assert_allclose(found.mean["square"][:, i], (run.q[:, 0] ** 2).mean(1), rtol=1e-12)
        np.testing.assert_allclose(found.mean["sum"][:, i], (run.q + run.p)[:, 0].mean(1), rtol=1e-12)


def test_same_noise():
    """With same_noise every value has the noise of the first value's paths, so that differences of means have small
    errors.
    """
    found = ss.sweep(model(), {"s": [0.2, 0.2, 0.201]}, **RUN, paths=40, same_noise=True, keep_paths=True)
    assert np.array_equal(found.q[:, :, 0], found.q[:, :, 1]) and np.array_equal(found.q[:, :, 0], one(s=0.2).q)
    own = ss.sweep(model(), {"s": [0.2, 0.2]}, **RUN, paths=40, keep_paths=True)
    assert not np.array_equal(own.q[:, :, 0], own.q[:, :, 1])
    differences = [np.std(x.q[-1, 0, -1] - x.q[-1, 0, 0]) for x in (found, own)]
    assert differences[0] < 0.02 * differences[1]


@pytest.mark.parametrize("same", [False, True])
def test_parts(monkeypatch, same):
    """Parts of any size change no path, whatever its initial state; means of parts are merged."""
    state = np.linspace(0.1, 0.9, 600)[np.newaxis]
    options = {**RUN, "q0": state, "paths": 600, "same_noise": same, "keep_paths": True}
    whole = ss.sweep(model(), {"omega": OMEGA}, **options)
    assert np.array_equal(whole.q[0, 0], np.broadcast_to(state, (3, 600)))
    for numbers in (1, 6 * 1200, 6 * 1300):  # 256 paths, one value, two values
        monkeypatch.setattr(module, "_NUMBERS", numbers)
        found = ss.sweep(model(), {"omega": OMEGA}, **options)
        assert np.array_equal(found.q, whole.q) and np.array_equal(found.n_ok, whole.n_ok)
        for kind in ("mean", "var", "se_mean"):
            np.testing.assert_allclose(found.table(kind), whole.table(kind), rtol=1e-11, atol=1e-14)


def test_built_in_models_and_functions():
    """Built-in models are made from their formulas, and their paths agree to rounding; functions that return models
    run one value after another.
    """
    omega = np.array([1.0, 2.0, 2.5])
    side_by_side = ss.sweep(ss.models.synchrotron(), {"omega": omega}, **RUN, paths=30, keep_paths=True)
    one_by_one = ss.sweep(ss.models.synchrotron, {"omega": omega}, **RUN, paths=30, keep_paths=True)
    np.testing.assert_allclose(side_by_side.q, one_by_one.q, rtol=1e-12, atol=1e-13)
    chain = ss.sweep(lambda beta: ss.models.fpu_chain(n=4, beta=beta), {"beta": [0.0, 1.0]}, **RUN, paths=3)
    assert chain.mean_q.shape == (3, 4, 2)
    for name in ss.models.names():
        values = ss.models.parameters(name)
        if name == "fpu_chain":
            with pytest.raises(ss.errors.IncompatibleError, match="beta of model fpu_chain cannot differ"):
                ss.models.get(name, beta=[1.0, 2.0])
            continue
        key = list(values)[-1]
        found = ss.models.get(name, **{key: [0.3, 0.6]})
        assert found.name == name and found.paths == 2
        start = {**RUN, "q0": 0.3, "p0": 0.1}
        plain = [
            ss.simulate(ss.models.get(name, **{key: x}), **start, paths=1, first_path=i)
            for i, x in enumerate((0.3, 0.6))
        ]
        run = ss.simulate(found, **start, paths=2)
        np.testing.assert_allclose(run.q, np.concatenate([x.q for x in plain], axis=2), rtol=1e-12, atol=1e-13)
    assert ss.models.kubo().with_parameters(sigma=0.5).parameters == {"a": 1.0, "sigma": 0.5}


def test_failed_paths():
    """Paths that fail are left out of the means of their value, and counted."""
    steep = ss.model_from_sympy("p**2/2 - c*q**4", noise=["0.1*q"], params={"c": 0.0})
    options = {**RUN, "steps": 200, "save_every": 100, "scheme": "stormer_verlet"}
    with pytest.warns(PathsFailedWarning, match="20 paths failed"):
        found = ss.sweep(steep, {"c": [0.0, 50.0]}, **options, paths=20)
    assert found.n_ok[-1].tolist() == [20, 0] and found.report.failed == 20
    assert np.isfinite(found.mean_q[:, :, 0]).all() and np.isnan(found.mean_q[-1, 0, 1])


def test_growing_paths(monkeypatch):
    """Paths that grow beyond all bounds are warned of and counted, in parts and where values run one by one."""
    stiff = ss.model_from_sympy("p**2/2 + k*q**2/2", noise=["0.1*q"], params={"k": 1.0})
    options = {**RUN, "steps": 100, "save_every": 100, "scheme": "stormer_verlet", "paths": 4}
    for given, most in ((stiff, 2**20), (stiff, 4), (lambda k: stiff.with_parameters(k=k), 2**20)):
        monkeypatch.setattr(module, "_PATHS", most)
        with pytest.warns(ss.errors.DoubtfulRunWarning, match="8 paths grew 1e6-fold"):
            found = ss.sweep(given, {"k": [1.0, 1e4, 1e5]}, **options)
        assert found.report.grown == 8 and (found.n_ok == 4).all()


def test_areas():
    """Schemes that halve steps for areas take values one by one, each with its own time scale, unless one is given."""
    model = ss.model_from_sympy("(p**2 + q**2)/2", noise=["a*p**2/2", "b*q**2/2"], params={"a": 0.5, "b": 0.5})
    asked, values = {**RUN, "scheme": "midpoint_areas", "paths": 5}, [0.5, 1.0, 3.0]
    for options in ({}, {"area_time": 6.0}, {"areas": "law"}):
        found = ss.sweep(model, {"b": values}, **asked, **options, keep_paths=True, same_noise=True)
        for i, b in enumerate(values):
            mine = ss.simulate(model.with_parameters(b=[b] if options else b), **asked, **options)
            assert np.array_equal(found.q[:, :, i], mine.q)


def test_stop():
    """A progress function ends the sweep, between two values or within the paths of a value."""
    seen = []
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = ss.sweep(
            lambda s: model(s=s),
            {"s": S},
            **RUN,
            paths=5,
            progress=lambda done, total: seen.append((done, total)) or done >= 100,
        )
    assert found.report.stopped and np.isnan(found.mean_q[-1, 0, 1]) and (seen[-1][1] == 200)


def test_stop_within_values_that_run_together(monkeypatch):
    """What was stopped is left out, beside the values before it, each in its place."""
    monkeypatch.setattr(module, "_PATHS", 400)  # two values at a time, of which a block of 256 paths ends the first
    given = {**RUN, "steps": 1, "save_every": 1, "paths": 200, "threads": 1}
    whole = ss.sweep(model(), {"s": [0.1, 0.2, 0.3, 0.4]}, **given)
    found = ss.sweep(model(), {"s": [0.1, 0.2, 0.3, 0.4]}, **given, progress=lambda done, _: done > 400)
    assert found.report.stopped == 200 and (found.status[:3] == 0).all() and (found.status[3] == -1).all()
    np.testing.assert_array_equal(found.mean_q[..., :3], whole.mean_q[..., :3])
    assert (found.n_ok[:, 3] == 0).all() and np.isnan(found.mean_q[..., 3]).all()


def test_files_and_figures(tmp_path):
    """Files and figures: dimensions of the parameters in xarray, rows of values in tables, a mean with its band."""
    found = ss.sweep(model(), {"omega": OMEGA, "s": S}, **RUN, paths=8, keep_paths=True)
    data = pytest.importorskip("xarray") and found.to_xarray()
    assert data.mean_q.dims == ("time", "dof", "omega", "s") and data.q.dims[-1] == "path"
    chosen = data.mean_q.sel(omega=1.3, s=0.4, t=1.0, dof=1)
    assert float(chosen) == found.mean_q[-1, 0, 1, 1]
    for name in ("a.npz", "a.csv", "a.nc"):
        if name.endswith("nc"):
            pytest.importorskip("netCDF4")
        found.save(tmp_path / name)
    lines = [x for x in (tmp_path / "a.csv").read_text().splitlines() if not x.startswith("#")]
    rows = list(csv.DictReader(lines))
    assert len(rows) == 3 * 6 and rows[-1]["omega"] == "2.1" and rows[-1]["s"] == "0.4"
    assert float(rows[-1]["mean q_1"]) == found.mean_q[-1, 0, 2, 1] and rows[-1]["n_ok"] == "8"
    assert np.array_equal(np.load(tmp_path / "a.npz")["mean_q"], found.mean_q)
    pytest.importorskip("matplotlib")
    found.plot(tmp_path / "a.png", of="energy", over="s")
    assert (tmp_path / "a.png").stat().st_size > 1000
    assert "3 values of omega x 2 values of s, 8 paths each" in repr(found)
    zipped = ss.sweep(model(), {"omega": OMEGA}, **RUN, paths=2, zip=True)
    zipped.plot(tmp_path / "b.png")
    assert zipped.to_xarray().omega.dims == ("value",)


def test_refusals():
    """Wrong arguments are refused with a sentence that says what is allowed."""
    with pytest.raises(UnknownNameError, match=r"omgea.*omega"):
        ss.sweep(model(), {"omgea": OMEGA}, **RUN)
    with pytest.raises(UnknownNameError, match=r"no parameter 'beta': .*lambda beta: ss.thermostat\(model, beta=b"):
        ss.sweep(ss.thermostat(model().with_parameters(s=0.0), gamma=0.1, beta=1.0), {"beta": [1.0, 2.0]}, **RUN)
    with pytest.raises(InvalidArgumentError, match="values is empty"):
        ss.sweep(model(), {}, **RUN)
    with pytest.raises(WrongShapeError, match="values of s have shape"):
        ss.sweep(model(), {"s": [[0.1, 0.2]]}, **RUN)
    with pytest.raises(InvalidArgumentError, match="values of s are not all finite"):
        ss.sweep(model(), {"s": [0.1, np.nan]}, **RUN)
    with pytest.raises(WrongShapeError, match="3 of omega, 2 of s"):
        ss.sweep(model(), {"omega": OMEGA, "s": S}, **RUN, zip=True)
    with pytest.raises(WrongShapeError, match=r"q0 has shape \(1, 3\).*or \(1, 2\)"):
        ss.sweep(model(), {"s": S}, **{**RUN, "q0": np.ones((1, 3))}, paths=2)
    with pytest.raises(WrongTypeError):
        ss.sweep("kubo", {"s": S}, **RUN)
    with pytest.raises(WrongTypeError):
        ss.sweep(lambda s: s, {"s": S}, **RUN)
    with pytest.raises(ss.errors.IncompatibleError, match="increments"):
        ss.sweep(model(), {"s": S}, **RUN, increments=np.zeros((20, 1)))
    with pytest.raises(ss.errors.IncompatibleError, match="parameters of model 'user' cannot be changed"):
        ss.sweep(ss.Model(ndof=1, nnoise=0, gradient=lambda t, w, q, p: (q, p)), {"s": S}, **RUN)
