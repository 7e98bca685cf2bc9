# SPDX-License-Identifier: BSD-3-Clause
"""Moments and observers of groups of paths, by values of parameters or by labels."""

import csv

import numpy as np
import pytest
import symsde as ss
from symsde import observe
from symsde.batch import scene
from symsde.errors import (
    IncompatibleError,
    InvalidArgumentError,
    NotSavedWarning,
    PathsFailedWarning,
    SceneError,
    UnknownNameError,
    WrongShapeError,
    WrongTypeError,
)

N = 700
RUN = {"q0": 1.0, "p0": 0.0, "step": 0.1, "steps": 20, "save_every": 10, "seed": 1, "paths": N}
LABELS = {
    "some": np.arange(N) // 256,
    "uneven": np.arange(N) // 100,
    "turns": np.arange(N) % 3,
    "drawn": np.random.default_rng(1).integers(0, 90, N),
    "far apart": np.where(np.arange(N) % 2, 2**62, -5),
    "below zero": np.arange(N, dtype=np.int8) // 8 - 3,
}


def kinds():
    """Observers of every kind."""
    return {
        "h": observe.Histogram("q_1", -1, 1, 8),
        "u": observe.Quantiles("p_1", shares=[0.2, 0.5]),
        "c": observe.Covariance(("q_1", "p_1")),
        "a": observe.Autocorrelation("q_1", 1),
        "e": observe.Extremes("p_1"),
        "x": observe.Passage("q_1", low=-0.45, high=2, absorb=False),
        "w": observe.Paths((3, 500), ("q_1",)),
    }


def same(one, other, **close):
    """Whether the arrays of two results of an observer are equal, or close."""
    mine, theirs = one.variables("x"), other.variables("x")
    for key, (_, x) in mine.items():
        if np.asarray(x).dtype.kind in "OU":
            continue
        if close:
            np.testing.assert_allclose(x, theirs[key][1], **close, err_msg=key)
        else:
            np.testing.assert_array_equal(x, theirs[key][1], err_msg=key)


@pytest.mark.parametrize("name", LABELS)
def test_means_of_saved_paths(name):
    """Means, variances and numbers of each group are those of its saved paths."""
    labels = LABELS[name]
    found = ss.moments(ss.models.kubo(), groups=labels, observables={"r": "q_1**2"}, **RUN).by_group
    run = ss.simulate(ss.models.kubo(), **RUN)
    assert found.dims == ("group",) and found.parameters["group"].tolist() == np.unique(labels).tolist()
    for k, label in enumerate(np.unique(labels)):
        mine = labels == label
        assert (found.n_ok[:, k] == np.count_nonzero(mine)).all()
        np.testing.assert_allclose(found.mean_q[:, 0, k], run.q[:, 0, mine].mean(1), rtol=1e-12, atol=1e-14)
        np.testing.assert_allclose(found.mean["r"][:, k], (run.q[:, 0, mine] ** 2).mean(1), rtol=1e-12)
        if mine.sum() > 1:
            np.testing.assert_allclose(found.var_p[:, 0, k], run.p[:, 0, mine].var(1, ddof=1), rtol=1e-10, atol=1e-14)


@pytest.mark.parametrize("lanes", [None, 8, 24])
def test_bits_of_a_run_alone(lanes):
    """Groups that begin at a multiple of 256 have the bits of a run of their paths alone, with observers of every
    kind; the moments of all paths do not depend on groups.
    """
    options = {**RUN, "lanes": lanes, "threads": 2}
    all_paths = ss.moments(ss.models.kubo(), groups=LABELS["some"], observers=kinds(), **options)
    for kind in ("mean", "var", "se_mean"):
        assert np.array_equal(all_paths.table(kind), ss.moments(ss.models.kubo(), **options).table(kind))
    found = all_paths.by_group
    for k in range(3):
        here = {**RUN, "first_path": 256 * k, "paths": min(256, N - 256 * k)}
        alone = ss.moments(ss.models.kubo(), observers=kinds(), **here)
        assert np.array_equal(found.mean_p[..., k], alone.mean_p)
        assert np.array_equal(found.var_energy[..., k], alone.var_energy)
        for name, result in alone.observed.items():
            same(found.observed[name][k], result)


@pytest.mark.parametrize("name", LABELS)
def test_observers_of_all_groups(name):
    """The results of all groups together are those of a run without groups."""
    found = ss.moments(ss.models.kubo(), groups=LABELS[name], observers=kinds(), **RUN)
    plain = ss.moments(ss.models.kubo(), observers=kinds(), **RUN)
    for key, result in plain.observed.items():
        same(found.observed[key], result, rtol=1e-11, atol=1e-13)


def test_absorbed_paths():
    """Paths absorbed by the passage of their group leave all other results."""
    asked = {"x": observe.Passage("q_1", low=-0.45, high=2, absorb=True)}
    plain = ss.moments(ss.models.kubo(), observers=asked, **RUN)
    found = ss.moments(ss.models.kubo(), groups=LABELS["turns"], observers=asked, **RUN)
    assert np.array_equal(found.n_ok, plain.n_ok) and 0 < plain.n_ok[-1] < N
    assert sum(x.n for x in found.by_group.observed["x"]) == plain.observed["x"].n
    assert np.array_equal(found.by_group.n_ok.sum(axis=1), plain.n_ok)


def test_parameters():
    """Groups by one parameter, by two that make a product, and by two that go together; unequal times."""
    omega, sigma = np.tile([1.0, 2.0], 350), np.repeat([0.1, 0.2], 350)
    model = ss.models.kubo().with_parameters(a=omega, sigma=sigma)
    one = ss.moments(model, groups="a", **RUN).by_group
    assert one.dims == ("a",) and one.parameters["a"].tolist() == [1, 2] and one.mean_q.shape == (3, 1, 2)
    two = ss.moments(model, groups=("a", "sigma"), **RUN).by_group
    assert two.dims == ("a", "sigma") and two.mean_q.shape == (3, 1, 2, 2)
    run = ss.simulate(model, **RUN)
    for i, a in enumerate((1.0, 2.0)):
        for j, s in enumerate((0.1, 0.2)):
            np.testing.assert_allclose(two.mean_q[:, 0, i, j], run.q[:, 0, (omega == a) & (sigma == s)].mean(1), 1e-12)
    rows = ss.moments(ss.models.kubo().with_parameters(a=omega, sigma=omega / 4), groups=["a", "sigma"], **RUN).by_group
    assert rows.dims == ("value",) and rows.points() == [{"a": 1.0, "sigma": 0.25}, {"a": 2.0, "sigma": 0.5}]
    uneven = {key: x for key, x in RUN.items() if key != "save_every"} | {"save_at": [0.0, 0.3, 2.0]}
    some = ss.moments(model, groups="a", **uneven).by_group
    assert np.array_equal(some.mean_q[[0, 2]], one.mean_q[[0, 2]]) and np.allclose(some.t, [0.0, 0.3, 2.0])


def test_failed_paths():
    """Failed paths count in no group from then on."""
    steep = ss.model_from_sympy("p**2/2 - c*q**4", noise=["0.1*q"], params={"c": np.repeat([0.0, 50.0], 20)})
    options = {**RUN, "steps": 200, "save_every": 100, "scheme": "stormer_verlet", "paths": 40}
    with pytest.warns(PathsFailedWarning):
        found = ss.moments(steep, groups="c", **options).by_group
    assert found.n_ok[-1].tolist() == [20, 0] and np.isnan(found.mean_q[-1, 0, 1])


def test_files(tmp_path):
    """Files have a dimension for the groups; tables a row for each time and group."""
    moments = ss.moments(ss.models.kubo(), groups=LABELS["turns"], observers={"h": kinds()["h"]}, **RUN)
    found = moments.by_group
    data = found.to_xarray()
    assert data["mean_q"].dims == ("time", "dof", "group") and data["h_share"].dims[0] == "group"
    assert np.array_equal(data["h_share"], [x.share for x in found.observed["h"]])
    with pytest.warns(NotSavedWarning, match="results of the observers h"):
        found.save(tmp_path / "groups.csv")
    lines = [x for x in (tmp_path / "groups.csv").read_text().splitlines() if not x.startswith("#")]
    assert len(lines) == 10 and lines[0].startswith("t,group,n_ok,mean q_1")
    plain = ss.moments(ss.models.kubo(), groups=LABELS["turns"], **RUN).by_group
    swept = ss.sweep(ss.models.kubo(), {"a": [1.0, 2.0]}, keep_paths=True, **RUN | {"paths": 4})
    for suffix in ("csv", "npz", "nc"):
        for kind, result in (("groups", plain), ("swept", swept)):
            result.save(tmp_path / f"{kind}.{suffix}")
            with pytest.raises(SceneError, match="moments of each value or group"):
                ss.load(tmp_path / f"{kind}.{suffix}")
    moments.save(tmp_path / "all.npz")
    again = ss.load(tmp_path / "all.npz").by_group
    assert np.array_equal(again.table("se_mean"), found.table("se_mean"))
    told, known = ({**x.attributes(), "date": "", "history": ""} for x in (again, found))  # the clock goes on
    assert told == known


def test_exit_times_in_files(tmp_path):
    """Shares that have left are columns of tables; lists of exits, of another length in each group, are filled up."""
    asked = {"x": kinds()["x"], "e": kinds()["e"]}
    found = ss.moments(ss.models.kubo(), groups=LABELS["uneven"], observers=asked, **RUN).by_group
    exits = found.observed["x"]
    with pytest.warns(NotSavedWarning, match="observers x, e"):
        found.save(tmp_path / "groups.csv")
    lines = [x for x in (tmp_path / "groups.csv").read_text().splitlines() if not x.startswith("#")]
    rows = list(csv.DictReader(lines))
    assert [float(x["x_lost"]) for x in rows[-7:]] == [x.lost[-1] for x in exits] != [exits[0].lost[-1]] * 7
    assert [float(x["e_mean_lowest"]) for x in rows[-7:]] == [x.mean_lowest[-1] for x in found.observed["e"]]
    data = found.to_xarray()
    longest = max(x.path.size for x in exits)
    assert data["x_path"].dims == ("group", "x_listed") and data["x_path"].shape == (7, longest)
    assert {x.path.size for x in exits} > {longest}
    for k, x in enumerate(exits):
        n = x.path.size
        assert np.array_equal(data["x_path"][k, :n], x.path) and (data["x_path"][k, n:] == -1).all()
        assert np.array_equal(data["x_state"][k, :n], x.state) and np.isnan(data["x_state"][k, n:]).all()
        assert data["x_mean"].sel(group=k, x_coordinate="q_1") == x.mean["q_1"]


@pytest.mark.parametrize(
    ("given", "kind", "word"),
    [
        ("b", UnknownNameError, "the parameter of groups"),
        (["a", "b"], UnknownNameError, "the parameter of groups"),
        (np.arange(5), WrongShapeError, r"groups have shape \(5,\): give \(path,\), labels of 700 paths"),
        (np.zeros(N), WrongTypeError, "whole numbers"),
        (np.full(N, 2**63, np.uint64), InvalidArgumentError, "below 2"),
        (3.5, WrongTypeError, "whole numbers"),
        ([[1], [2, 3]], WrongShapeError, "nested sequence of unequal lengths"),
    ],
)
def test_refusals(given, kind, word):
    """Refuses groups with a sentence."""
    with pytest.raises(kind, match=word):
        ss.moments(ss.models.kubo(), groups=given, **RUN)


def test_names_of_files():
    """Refuses groups and sweeps of a parameter whose name files need for something else."""
    model = ss.model_from_sympy("p**2/2 + dof*q**2/2", noise=["0.1*q"], params={"dof": np.repeat([1.0, 2.0], 350)})
    with pytest.raises(InvalidArgumentError, match="rename it"):
        ss.moments(model, groups="dof", **RUN)
    with pytest.raises(InvalidArgumentError, match="rename it"):
        ss.sweep(model, {"dof": [1.0, 2.0]}, **RUN)


def test_parameters_of_sites(tmp_path):
    """Refuses values by path of a parameter that has a number for each site, even for as many paths as sites."""
    formulas = {"H": "Sum(p[i]**2/(2*m[i]) + q[i]**2/2, i)", "noise": ["0.1*Sum(q[i], i)"], "n": 3}
    model = ss.model_from_sympy(**formulas, params={"m": [1.0, 2.0, 3.0]})
    run = {"q0": 1.0, "p0": 0.0, "step": 0.1, "steps": 2}
    with pytest.raises(IncompatibleError, match="a number for each site"):
        ss.sweep(model, {"m": [1.0, 2.0, 3.0]}, **run)
    with pytest.raises(IncompatibleError, match="a number for each site"):
        ss.moments(model, groups="m", paths=3, **run)
    file = tmp_path / "scene.toml"
    file.write_text(
        f'[model]\nH = "{formulas["H"]}"\nnoise = ["0.1*Sum(q[i], i)"]\nn = 3\n'
        "params = {m = {from = 1.0, to = 3.0, count = 3}}\n"
        "[run]\nq0 = 1.0\np0 = 0.0\nstep = 0.1\nsteps = 2\npaths = 3\n[output]\nmoments = true\n"
    )
    with pytest.raises(SceneError, match="the same for all paths: give a number, or a list with one for each site"):
        scene.load(file)
