# SPDX-License-Identifier: BSD-3-Clause
"""Files hold the computed results: every variable of every file is read back; names, full disks, pickles, copies."""

import copy
import csv
import datetime
import json
import math
import os
import pickle
import socket
import subprocess
import sys
from multiprocessing.reduction import ForkingPickler

import numpy as np
import pytest
import symsde as ss
from conftest import rotation_gradient, rotation_value, table_of, told
from symsde.cli import command_line
from symsde.errors import WrongTypeError
from symsde.native.files import json_text

START = np.full((2, 300), 0.1)
START[:, [5, 270]] = 20.0  # these two paths escape
RUN = {"q0": START, "p0": [0.05, -0.03], "t0": 2.0, "step": 0.1, "steps": 60, "save_every": 20, "paths": 300}
RUN |= {"scheme": "stormer_verlet", "seed": 11, "first_path": 512, "first_step": 3}


@pytest.fixture(scope="module")
def run():
    with pytest.warns(ss.PathsFailedWarning, match="2 paths failed"):
        return ss.simulate(ss.models.henon_heiles(alpha=1.1), **RUN)


@pytest.fixture(scope="module")
def moments():
    observables = {"last": lambda q, p: p[1], "R^2 [%]": lambda q, p: 100 * (q[0] ** 2 + q[1] ** 2)}
    with pytest.warns(ss.PathsFailedWarning, match="2 paths failed"):
        return ss.moments(ss.models.henon_heiles(alpha=1.1), observables=observables, **RUN)


def read(path):
    """Variables and attributes of a .nc or .npz file."""
    if path.suffix == ".nc":
        xarray = pytest.importorskip("xarray")
        pytest.importorskip("netCDF4")
        with xarray.open_dataset(path) as data:
            return {name: data[name].to_numpy() for name in data.variables}, dict(data.attrs)
    with np.load(path) as data:
        found = {name: data[name] for name in data.files}
    found["time"] = found.pop("t")
    return found, json.loads(str(found.pop("attributes")))


def check_attributes(given):
    """The attributes suffice to repeat the run."""
    assert given["model"] == "henon_heiles" and given["scheme"] == "stormer_verlet"
    assert json.loads(given["parameters"]) == {"alpha": 1.1, "sigma1": 0.1, "sigma2": 0.1}
    assert given["increments"] == "Brownian"
    options = json.loads(given["options"])
    for name in ("t0", "step", "steps", "save_every", "paths", "seed", "first_path", "first_step"):
        assert options[name] == RUN[name], name
    assert (options["refine"], options["correction"], options["truncation"]) == (0, "auto", 0)
    assert not options["compensated"] and not options["general"] and options["fixed_point"] == 0
    for key, value in ss.build_info().items():
        assert given[f"symsde_{key.replace(' ', '_')}"] == value
    assert given["seed"] == "11" and given["paths_asked"] == "300" and given["paths_ok"] == "298"
    assert given["Conventions"] == "CF-1.11" and given["source"] == f"symsde {ss.__version__}"
    when, _, command = given["history"].partition(" ")
    assert datetime.datetime.fromisoformat(when).tzinfo is not None and "pytest" in command


@pytest.mark.parametrize(
    "asked",
    [
        {"common_noise": [2], "refine": -1, "compensated": True, "first_path": 5, "max_iter": 7, "seed": 2**60},
        {"scheme": "midpoint_areas", "areas": "law", "common_noise": [1, 2], "first_step": 3, "general": True},
        {"scheme": "symplectic_euler", "correction": "mean", "fixed_point": 30, "t0": -0.5, "area_time": 0.25},
    ],
)
def test_options_are_told_as_they_were_asked_for(asked):
    run = ss.simulate(ss.models.henon_heiles(), q0=0.1, p0=0.0, step=0.1, steps=2, **asked)
    told = json.loads(run.attributes()["options"])
    assert {name: told[name] for name in asked if name != "scheme"} == {x: y for x, y in asked.items() if x != "scheme"}


def test_every_variable_says_what_it_is(run, moments):
    """Variables have descriptions and units, as the CF conventions ask."""
    pytest.importorskip("xarray")
    for data in (run.to_xarray(), moments.to_xarray()):
        assert all(variable.attrs["units"] == "1" for variable in data.variables.values())
        assert all(variable.attrs["long_name"] for variable in data.variables.values())
    told = {name: variable.attrs["long_name"] for name, variable in run.to_xarray().variables.items()}
    assert told == {
        "time": "time", "path": "global index of the path", "q": "coordinates", "p": "momenta",
        "status": "status of the path, 0 = ok", "failed_step": "absolute step that failed, -1 = none",
        "t": "time", "dof": "degree of freedom", "last_q": "coordinates of the last good state",
        "last_p": "momenta of the last good state",
    }  # fmt: skip
    assert moments.to_xarray()["se_mean_q"].attrs["long_name"] == "standard error of the mean of coordinates"
    assert moments.to_xarray()["mean_energy"].attrs["long_name"] == "mean of energy"


@pytest.mark.parametrize("ending", ["nc", "npz"])
def test_a_file_of_paths_holds_the_run(run, ending, tmp_path):
    assert run.status[5] > 0 and run.failed_step[5] > 3 and run.failed_step[5] != run.status[5]
    run.save(tmp_path / f"run.{ending}")
    assert os.listdir(tmp_path) == [f"run.{ending}"]
    found, attributes = read(tmp_path / f"run.{ending}")
    expected = {"time": run.t, "path": run.path, "q": run.q, "p": run.p}
    expected |= {"status": run.status, "failed_step": run.failed_step, "last_q": run.last_q, "last_p": run.last_p}
    expected |= {"t": run.t, "dof": [1, 2]} if ending == "nc" else {}
    assert set(found) == set(expected)
    for name, values in expected.items():
        np.testing.assert_array_equal(found[name], values, err_msg=name)
    check_attributes(attributes)


def test_numbers_as_json():
    """Numbers have seven digits, or all digits; values that are not finite are null."""
    data = {"x": np.array([1 / 3, math.inf]), 2: (True, np.int64(12345678), None)}
    assert json_text(data) == '{"x": [0.3333333, null], "2": [true, 12345678, null]}\n'
    assert json_text(data, digits=None).startswith('{"x": [0.3333333333333333, null]')


def moments_by_hand(run):
    """Means, variances and errors of every value from saved paths, without failed ones, which are NaN."""
    model = run.model
    values = {"q_1": run.q[:, 0], "q_2": run.q[:, 1], "p_1": run.p[:, 0], "p_2": run.p[:, 1]}
    values["energy"] = np.array([model.value(q, p) for q, p in zip(run.q, run.p, strict=True)])
    values["last"], values["R^2 [%]"] = run.p[:, 1], 100 * (run.q[:, 0] ** 2 + run.q[:, 1] ** 2)
    n_ok = np.isfinite(run.q[:, 0]).sum(axis=1)
    table = {"n_ok": n_ok}
    for name, x in values.items():
        table[f"mean {name}"] = np.nanmean(x, axis=1)
        table[f"var {name}"] = np.nanvar(x, axis=1, ddof=1)
        table[f"se_mean {name}"] = np.sqrt(table[f"var {name}"] / n_ok)
    return table


def test_a_table_of_moments_holds_the_moments(run, moments, tmp_path):
    moments.save(tmp_path / "moments.csv")
    names, *rows = csv.reader(table_of(tmp_path / "moments.csv"))
    check_attributes(told(tmp_path / "moments.csv"))
    found = dict(zip(names, np.array(rows, dtype=float).T, strict=True))
    assert len(names) == len(set(names))
    expected = {"t": run.t, **moments_by_hand(run)}
    assert set(found) == set(expected)
    assert expected["n_ok"].tolist() == [300, 298, 298, 298]
    for name, values in expected.items():
        np.testing.assert_allclose(found[name], values, rtol=1e-9, atol=1e-12, err_msg=name)
    for kind in ("mean", "var", "se_mean"):  # to the last bit
        np.testing.assert_array_equal(found[f"{kind} p_2"], getattr(moments, f"{kind}_p")[:, 1])
        np.testing.assert_array_equal(found[f"{kind} last"], getattr(moments, kind)["last"])


@pytest.mark.parametrize("ending", ["nc", "npz"])
def test_a_file_of_moments_holds_the_moments(run, moments, ending, tmp_path):
    moments.save(tmp_path / f"moments.{ending}")
    found, attributes = read(tmp_path / f"moments.{ending}")
    by_hand = moments_by_hand(run)
    variances = [by_hand[name] for name in by_hand if name.startswith("var ")]
    expected = {"time": run.t, "n_ok": by_hand["n_ok"], "failed": [517, 782]}
    expected["m2"] = np.stack(variances, axis=1) * (by_hand["n_ok"][:, np.newaxis] - 1)
    expected |= {"failed_status": run.status[[5, 270]], "failed_step": run.failed_step[[5, 270]]}
    expected |= {"t": run.t, "dof": [1, 2]} if ending == "nc" else {}
    for kind in ("mean", "var", "se_mean"):
        for x in "qp":
            expected[f"{kind}_{x}"] = np.stack([by_hand[f"{kind} {x}_{i}"] for i in (1, 2)], axis=1)
        expected |= {f"{kind}_{name}": by_hand[f"{kind} {name}"] for name in ("energy", "last", "R^2 [%]")}
    assert set(found) == set(expected)
    for name, values in expected.items():
        np.testing.assert_allclose(found[name], values, rtol=1e-9, atol=1e-12, err_msg=name)
    check_attributes(attributes)


def test_dimensions_of_datasets(run, moments):
    pytest.importorskip("xarray")
    paths, means = run.to_xarray(), moments.to_xarray()
    assert paths.q.dims == paths.p.dims == ("time", "dof", "path")
    assert paths.status.dims == paths.failed_step.dims == ("path",)
    assert means.mean_q.dims == ("time", "dof") and means.se_mean_energy.dims == means["var_last"].dims == ("time",)
    assert float(paths.sel(path=517).failed_step) == run.failed_step[5]


def test_prescribed_increments_are_said(kubo, tmp_path):
    found = ss.simulate(kubo, q0=1.0, p0=0.0, step=0.1, steps=2, increments=np.zeros((2, 1)))
    found.save(tmp_path / "run.npz")
    assert read(tmp_path / "run.npz")[1]["increments"] == "prescribed"


@pytest.mark.parametrize("name", ["q", "p", "energy", "q_1", "p_12"])
def test_names_of_observables_that_are_taken(name, kubo, options):
    with pytest.raises(ss.errors.InvalidArgumentError, match=f"{name!r}.*taken.*give another"):
        ss.moments(kubo, observables={name: lambda q, p: q[0]}, **options)


@pytest.mark.parametrize("name", ["", "a/b", " a", "a\n", "\0", "n#"])
def test_names_of_observables_that_files_cannot_hold(name, kubo, options):
    with pytest.raises(ss.errors.InvalidArgumentError, match="cannot be a name in a file"):
        ss.moments(kubo, observables={name: lambda q, p: q[0]}, **options)


def test_names_of_observables_are_text(kubo, options):
    with pytest.raises(ss.errors.WrongTypeError, match="name of an observable = 3"):
        ss.moments(kubo, observables={3: lambda q, p: q[0]}, **options)


@pytest.mark.parametrize("target", [None, 3, 2.5, b"x.csv"])
def test_save_wants_a_path(target, run, moments):
    for result in (run, moments):
        with pytest.raises(ss.errors.InvalidArgumentError, match="is no path: give the name of a file"):
            result.save(target)


def test_endings_are_named(run, moments, tmp_path):
    with pytest.raises(ss.errors.InvalidArgumentError, match=r"run\.xls.*\.nc or \.npz"):
        run.save(tmp_path / "run.xls")
    with pytest.raises(ss.errors.InvalidArgumentError, match=r"moments\.xls.*\.csv, \.nc or \.npz"):
        moments.save(tmp_path / "moments.xls")
    assert os.listdir(tmp_path) == []


FULL = """
import resource, signal, sys
import symsde as ss
made = {make}(ss.models.kubo(), q0=1.0, p0=0.0, step=0.01, steps=4000, paths=4)
made.save(sys.argv[1] + "/before.{ending}")
resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))
try:
    made.save(sys.argv[1] + "/after.{ending}")
except OSError as error:
    print(type(error).__name__, error)
"""


@pytest.mark.parametrize("ending", ["csv", "npz", "nc"])
def test_a_full_disk_is_an_oserror_and_leaves_nothing(ending, tmp_path):
    """A full disk is imitated by a limit of 20 kB a file."""
    if ending == "nc":
        pytest.importorskip("netCDF4")
    code = FULL.format(make="ss.moments" if ending == "csv" else "ss.simulate", ending=ending)
    command = [sys.executable, "-c", code, str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("NotWrittenError") and f"after.{ending}" in done.stdout
    assert os.listdir(tmp_path) == [f"before.{ending}"]


def same(one, other):
    """Equal arrays, reports and setups."""
    for name in ("t", "q", "p", "path", "status", "failed_step", "last_q", "last_p"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)
    assert one.report == other.report and repr(one) == repr(other)
    assert one.setup.attributes() == other.setup.attributes()


@pytest.mark.parametrize("twin", [copy.copy, copy.deepcopy, lambda x: pickle.loads(pickle.dumps(x))])
def test_runs_models_and_schemes_can_be_copied_and_pickled(twin, run, moments):
    same(twin(run), run)
    other = twin(moments)
    for name in ("t", "n_ok", "mean_q", "var_p", "se_mean_energy", "failed", "failed_status", "failed_step"):
        np.testing.assert_array_equal(getattr(other, name), getattr(moments, name), err_msg=name)
    assert other.mean.keys() == moments.mean.keys()
    assert np.shares_memory(other.mean_q, other.to_arrays()[0])
    root = np.sqrt(3) / 6
    made = [
        ss.schemes.get("lambda:0.3"),
        ss.schemes.from_quadrature([0.5 - root, 0.5 + root], [0.5, 0.5], 2, "mine", noise_weights=[0.25, 0.75]),
        ss.schemes.from_tableau([[0.5]], [[0.5]], [1.0], "half", b=[[0.4]], bbar=[[0.6]], allow_nonsymplectic=True),
        ss.schemes.adjoint("symplectic_euler"),
        ss.schemes.symmetric_composition("symplectic_euler", "both"),
        ss.schemes.triple_jump("midpoint"),
        ss.schemes.composition(["midpoint", "gauss2"], [0.25, 0.75], name="two"),
    ]
    for scheme in made:
        known = twin(scheme)
        assert known.info == scheme.info and known.certificate() == scheme.certificate()
        free = {"correction": "none"} if scheme.name == "half" else {}
        one, two = (ss.step(ss.models.kubo(), s, 1.0, 0.2, 0.1, 0.3, **free) for s in (scheme, known))
        np.testing.assert_array_equal(one, two)


def test_a_model_of_the_user_can_be_pickled():
    declared = {"separable": True, "quadratic": True, "bandwidth": 0, "max_frequency": 1.5, "noise_lipschitz": 0.25}
    model = ss.Model(ndof=1, nnoise=1, gradient=rotation_gradient, value=rotation_value, name="mine", **declared)
    known = pickle.loads(pickle.dumps(model))
    assert known.traits == model.traits and known.name == "mine" and known.in_python
    assert known.value(1.0, 2.0) == model.value(1.0, 2.0)
    assert copy.deepcopy(model) is model
    stiff = ss.Model(ndof=1, nnoise=0, gradient=free, identity_mass=True, separable=True, rotation=[2.0])
    assert pickle.loads(pickle.dumps(stiff)).traits.rotation == (2.0,)


def free(t, w, q, p):
    return 4.0 * w[0] * q, w[0] * p


def test_pickles_of_lambdas_are_refused_with_a_sentence():
    """Pickles of a model with lambdas, and of its results; picklers that write code, like cloudpickle, accept them."""
    own = ss.Model(ndof=1, nnoise=0, gradient=lambda t, w, q, p: (w[0] * q, w[0] * p), separable=True)
    found = ss.simulate(own, q0=1.0, p0=0.0, step=0.1, steps=2)
    for thing in (own, found, ss.moments(own, q0=1.0, p0=0.0, step=0.1, steps=2)):
        for dumps in (pickle.dumps, pickle._dumps, ForkingPickler.dumps):
            with pytest.raises(
                WrongTypeError, match=r"holds the function .*<lambda>, which pickle cannot find by name"
            ):
                dumps(thing)
        assert copy.copy(thing) is not None and copy.deepcopy(thing) is not None
    cloudpickle = pytest.importorskip("numba.cloudpickle")
    again = pickle.loads(cloudpickle.dumps(found))
    np.testing.assert_array_equal(again.q, found.q)
    assert again.model.traits == own.traits


def test_compiled_functions_cannot_be_pickled():
    from symsde.native.abi import CALLBACKS

    pointer = CALLBACKS["gradient"](lambda *_: 0)
    model = ss.Model(ndof=1, nnoise=0, gradient=pointer, name="mine")
    with pytest.raises(ss.errors.WrongTypeError, match="'mine' holds compiled functions"):
        pickle.dumps(model)
    assert copy.copy(model) is copy.deepcopy(model) is model


@pytest.mark.parametrize("kind", ["a pipe", "a socket", "a device"])
def test_what_is_no_file_is_refused_before_it_is_opened(kind, tmp_path, capsys):
    """Opening a pipe waits for a writer, and reading /dev/zero never ends: both must be refused without opening."""
    made = {".toml": tmp_path / "x.toml", ".csv": tmp_path / "x.csv", "manifest": tmp_path / "run" / "manifest.json"}
    (tmp_path / "run").mkdir()
    for path in made.values():
        if kind == "a pipe":
            os.mkfifo(path)
        elif kind == "a device":
            path.symlink_to("/dev/zero")
        else:
            os.chdir(path.parent)  # paths of sockets must be short
            socket.socket(socket.AF_UNIX).bind(path.name)
    for verb in ("check", "run", "expect", "study"):
        assert command_line.main([verb, str(made[".toml"])]) == command_line.BAD_INPUT
        assert f"x.toml cannot be read: it is {kind}, give a file" in capsys.readouterr().err
    for given in (["study", "--all", str(tmp_path)], ["plot", str(made[".csv"])], ["plot", str(tmp_path / "run")]):
        assert command_line.main(given) in (command_line.BAD_INPUT, command_line.NOT_WRITTEN)
        assert f"it is {kind}, give a file" in capsys.readouterr().err
    with pytest.raises(ss.errors.SceneError, match=f"x.toml cannot be read: it is {kind}"):
        ss.batch.scene.load(made[".toml"])
