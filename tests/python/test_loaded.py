# SPDX-License-Identifier: BSD-3-Clause
"""Results are loaded from a file unchanged, or the file says which results it lacks."""

import dataclasses
import json
import warnings

import numpy as np
import pytest
import symsde as ss
from symsde import observe
from symsde.cli import command_line

START = np.full((2, 300), 0.3)
START[:, 0] = 20.0  # this path fails in the first steps
RUN = {"q0": START, "p0": 0.1, "step": 0.1, "steps": 40, "save_every": 10, "paths": 300, "scheme": "stormer_verlet"}
OBSERVERS = {
    "hist": observe.Histogram("q_1", -1, 1, 8),
    "mid": observe.Quantiles("energy", (0.25, 0.5), low=1e-3, high=10),
    "cov": observe.Covariance(("q_1", "p_2")),
    "along": observe.Autocorrelation("q_1", lags=3, about=0.1),
    "far": observe.Extremes("p_1"),
    "loss": observe.Passage("q_1", high=0.5, absorb=False),
    "own": observe.Passage("r", low=-1.0, high=0.4, absorb=False),
    "some": observe.Paths((3, 5)),
}
NOT_FILED = {
    "hist": ["kept"], "cov": ["kept"], "along": ["kept"], "far": ["kept"], "loss": ["kept"], "own": ["kept"],
    "some": ["kept"], "mid": ["kept", "counts", "edges", "below", "above", "not_a_number"],
}  # fmt: skip


@pytest.fixture(scope="module")
def model():
    return ss.models.henon_heiles(sigma1=0.2)


@pytest.fixture(scope="module")
def run(model):
    with pytest.warns(ss.PathsFailedWarning):
        return ss.simulate(model, compensated=True, **RUN)


@pytest.fixture(scope="module")
def moments(model):
    with pytest.warns(ss.PathsFailedWarning):
        return ss.moments(model, observables={"r": "q1*q1"}, observers=OBSERVERS, **RUN)


@pytest.fixture(params=["nc", "npz"])
def ending(request):
    if request.param == "nc":
        pytest.importorskip("netCDF4")
    return request.param


def same(found, known, where):
    """Assert that both have one type and are equal to the last bit."""
    assert type(found) is type(known), where
    if isinstance(known, dict):
        assert list(found) == list(known), where
        found, known = list(found.values()), list(known.values())
    if isinstance(known, np.ndarray):
        assert (found.dtype, found.shape) == (known.dtype, known.shape), where
    np.testing.assert_array_equal(found, known, err_msg=where)


def test_observers_come_back(moments, ending, tmp_path):
    """Every observer's result comes back, except parts that the file declares missing."""
    moments.save(tmp_path / f"m.{ending}")
    loaded = ss.load(tmp_path / f"m.{ending}")
    assert list(loaded.observed) == list(OBSERVERS)
    assert {observer.KIND for observer in OBSERVERS.values()} == set(observe_kinds())
    for name, known in moments.observed.items():
        found = loaded.observed[name]
        assert repr(found) == repr(known) and found.observer == known.observer and found.remarks() == known.remarks()
        for key, value in vars(known).items():
            if key in NOT_FILED[name]:
                with pytest.raises(
                    AttributeError, match=f"files of results do not hold {key} of {known.observer.KIND}"
                ):
                    getattr(found, key)
            elif key not in ("observer", "_is_derived"):
                same(getattr(found, key), value, f"{name}.{key}")
    assert loaded.remarks() == moments.remarks() and len(loaded.remarks()) == 1
    with pytest.raises(AttributeError, match="'HistogramResult' object has no attribute 'nothing'"):
        _ = loaded.observed["hist"].nothing


def observe_kinds():
    """All kinds of observers."""
    wanted = (getattr(observe, name) for name in observe.__all__)
    return [kind.KIND for kind in wanted if getattr(kind, "KIND", "")]


def test_observers_that_came_back_are_drawn(moments, ending, tmp_path):
    pytest.importorskip("matplotlib")
    moments.save(tmp_path / f"m.{ending}")
    loaded = ss.load(tmp_path / f"m.{ending}")
    for name, known in moments.observed.items():
        assert loaded.observed[name].plot().get_suptitle() == known.plot().get_suptitle()
    assert command_line.main(["plot", str(tmp_path / f"m.{ending}"), "--of", "loss"]) == 0
    assert (tmp_path / "m-observed-loss.png").exists()


def test_moments_come_back(moments, ending, tmp_path):
    moments.save(tmp_path / f"m.{ending}")
    loaded = ss.load(tmp_path / f"m.{ending}")
    for name in ("m2", "failed", "failed_status", "failed_step", "t", "n_ok", "mean", "var_q"):
        same(getattr(loaded, name), getattr(moments, name), name)
    assert loaded.failed.tolist() == [0] and loaded.doubts() == moments.doubts()
    assert loaded.report == moments.report and str(loaded.report) == str(moments.report)


def test_runs_come_back(run, ending, tmp_path):
    """Runs come back with last states, from which they continue, reports, and energy if it was observed."""
    run.save(tmp_path / f"r.{ending}")
    loaded = ss.load(tmp_path / f"r.{ending}")
    for name in ("t", "q", "p", "path", "status", "failed_step", "last_q", "last_p", "q_low", "p_low"):
        same(getattr(loaded, name), getattr(run, name), name)
    assert loaded.report == run.report and not loaded.has_energy
    with pytest.raises(ss.errors.MissingOperationError, match=r"holds q and p, and no energies: look at run\.energy"):
        _ = loaded.energy
    _ = run.energy
    run.save(tmp_path / f"r.{ending}")
    loaded = ss.load(tmp_path / f"r.{ending}")
    assert loaded.has_energy
    same(loaded.energy, run.energy, "energy")
    assert loaded.columns() == run.columns()
    del run.energy


def test_a_run_without_low_parts_has_none(model, tmp_path):
    ss.simulate(model, q0=0.1, p0=0.0, step=0.1, steps=2).save(tmp_path / "r.npz")
    assert ss.load(tmp_path / "r.npz").q_low is None


def test_a_table_says_what_it_cannot_hold(moments, model, tmp_path):
    with pytest.warns(
        ss.errors.NotSavedWarning, match=r"m\.csv: a table of times cannot hold .* observers hist, mid, cov"
    ):
        moments.save(tmp_path / "m.csv")
    assert "# not in this table: a table of times cannot hold the results of the observers hist, mid" in (
        tmp_path / "m.csv"
    ).read_text(encoding="utf-8")
    loaded = ss.load(tmp_path / "m.csv")
    assert loaded.report == moments.report and loaded.remarks() == moments.remarks()
    for name in ("observed", "failed", "failed_status", "failed_step", "m2"):
        with pytest.raises(AttributeError, match=rf"m\.csv is a table of times, which cannot hold {name}: save"):
            getattr(loaded, name)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ss.moments(model, q0=0.1, p0=0.0, step=0.1, steps=2).save(tmp_path / "plain.csv")
    assert ss.load(tmp_path / "plain.csv").observed == {}


def test_seconds_are_left_out_where_files_are_to_be_made_again(run, monkeypatch, tmp_path):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "86400")
    for name in ("first.npz", "second.npz"):
        run.save(tmp_path / name)
    assert (tmp_path / "first.npz").read_bytes() == (tmp_path / "second.npz").read_bytes()
    timings = ss.load(tmp_path / "first.npz").report.timings
    assert timings == {"setup": 0.0, "run": 0.0} and run.report.timings["run"] > 0


def older(file, target, leave):
    """A file as an older version wrote it: without these variables and attributes."""
    with np.load(file) as data:
        found = {name: data[name] for name in data.files if name not in leave}
    told = json.loads(str(found.pop("attributes")))
    told = {key: text for key, text in told.items() if key not in leave}
    np.savez(target, **found, attributes=np.array(json.dumps(told)))


def test_older_files_are_read(run, moments, tmp_path):
    """Old files give their contents, and say what is missing."""
    moments.save(tmp_path / "m.npz")
    older(tmp_path / "m.npz", tmp_path / "old.npz", {"report", "m2", "hist_share", "hist_se_share", "loss_mean"})
    found = ss.load(tmp_path / "old.npz")
    same(found.mean_q, moments.mean_q, "mean_q")
    same(found.observed["hist"].density, moments.observed["hist"].density, "density")
    for where, name in ((found, "m2"), (found, "report"), (found.observed["hist"], "share")):
        with pytest.raises(AttributeError, match=f"does not hold {name}: an older version has written it"):
            getattr(where, name)
    run.save(tmp_path / "r.npz")
    older(tmp_path / "r.npz", tmp_path / "old.npz", {"report", "last_q", "last_p"})
    found = ss.load(tmp_path / "old.npz")
    same(found.q, run.q, "q")
    with pytest.raises(AttributeError, match="does not hold last_q: an older version has written it"):
        _ = found.last_q
    text = "# title: kubo by midpoint\n# seed: 1\nt,n_ok,mean q_1,mean p_1,var q_1,var p_1,se_mean q_1,se_mean p_1\r\n"
    (tmp_path / "old.csv").write_bytes(f"{text}0.0,8,1.0,0.0,nan,0.5,0.1,0.2\r\n".encode())
    found = ss.load(tmp_path / "old.csv")
    assert found.columns() == ["q_1", "p_1"] and np.isnan(found.var_q[0, 0]) and found.se_mean_p[0, 0] == 0.2


def test_a_report_of_another_version_is_read(run):
    """In a report of another version missing entries are None, and unknown entries are dropped."""
    told = {**json.loads(run.attributes()["report"]), "unheard": 3}
    del told["lanes"]
    found = ss.run.report.read_report(json.dumps(told))
    assert found == dataclasses.replace(run.report, lanes=None)
