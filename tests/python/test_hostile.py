# SPDX-License-Identifier: BSD-3-Clause
"""Wrong types and values in every place: the call works, or a message of readable length says what to do."""

import copy
import inspect
import io
import pickle
import sys
import warnings
from concurrent.futures import ProcessPoolExecutor

import numpy as np
import pytest
import symsde as ss
import test_inputs
from conftest import moments_of, paths_of
from symsde.batch import scene
from symsde.cli import command_line

LONGEST = 2100


class Mute:
    """An object whose repr raises."""

    def __repr__(self):
        """Raise."""
        raise RuntimeError("no words")


#: values made anew for every call
HOSTILE = {
    "None": lambda: None,
    "array of no dimension": lambda: np.array(1),
    "text in an array": lambda: np.array("x"),
    "text": lambda: "x",
    "nonsense in UTF-8": lambda: "\ud800",
    "text with an end in it": lambda: "a\0b",
    "bytes": lambda: b"x",
    "long text": lambda: "x" * 100_000,
    "long words": lambda: "word " * 20_000,
    "1.5": lambda: 1.5,
    "-1": lambda: -1,
    "nan": lambda: float("nan"),
    "1j": lambda: 1j,
    "True": lambda: True,
    "thousands of digits": lambda: 10**5000,
    "2^40 columns": lambda: np.broadcast_to(1.0, (1, 2**40)),
    "empty array": lambda: np.array([]),
    "array of objects": lambda: np.array([Mute()], object),
    "object": object,
    "mute": Mute,
    "mute in a list": lambda: [Mute()],
    "mute in a table": lambda: {"a": Mute()},
    "empty list": list,
    "empty table": dict,
    "long list": lambda: ["x" * 100_000],
    "long key": lambda: {"x" * 100_000: 1.0},
    "number as key": lambda: {1: 2},
    "set": lambda: {1, 2},
    "generator": lambda: (x for x in ()),
}
MORE = {"executor", "progress", "max_time", "out", "within"}  #: parameters that the tables lack
NOT_FOR_USERS = {"diagnose.exact_of"}  #: takes an internal object


@pytest.mark.parametrize(("name", "own"), list(test_inputs.cases()))
def test_what_does_not_belong_is_told(name, own, tmp_path, monkeypatch):
    if name in NOT_FOR_USERS:
        return
    monkeypatch.chdir(tmp_path)  # some values are names of folders
    function = dict(test_inputs.public())[name]
    parameters = inspect.signature(function).parameters
    given = {*test_inputs.arguments(name, function, own), *(MORE & {*parameters})}
    for key in sorted(given):
        for what, make in HOSTILE.items():
            arguments = {**test_inputs.arguments(name, function, own), key: make()}
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                try:
                    test_inputs.called(name, arguments)
                except ss.SymsdeError as error:
                    assert len(str(error)) <= LONGEST, f"{key} = {what}"
                except Exception as error:
                    raise AssertionError(f"{key} = {what}: {type(error).__name__}: {error}") from error


RUN = {"q0": 1.0, "p0": 0.0, "step": 0.1, "steps": 4}
KUBO = ss.models.kubo()


def test_a_number_of_a_noise_may_be_an_array():
    wanted = ss.simulate(KUBO, **RUN, paths=2, common_noise=1)
    for given in (np.array(1), np.array([1]), [np.array(1)], (1,)):
        np.testing.assert_array_equal(ss.simulate(KUBO, **RUN, paths=2, common_noise=given).q, wanted.q)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"progress": "x"}, "progress = 'x' is not allowed: give True, False, or a function"),
        ({"executor": 1.5}, "executor = 1.5 takes no work: give an executor of concurrent.futures"),
    ],
)
def test_an_ensemble_says_what_it_cannot_use(arguments, words):
    with pytest.raises(ss.errors.WrongTypeError, match=words):
        ss.ensemble(KUBO, **RUN, **arguments)


def test_an_executor_that_cannot_send_a_function_says_so():
    with ProcessPoolExecutor(1) as pool, pytest.raises(ss.errors.WrongTypeError, match="at the top of a module"):
        ss.ensemble(KUBO, **RUN, observables={"o": lambda q, p: q[0]}, executor=pool)


def test_a_prepared_run_says_that_it_is_no_value():
    run = ss.prepare(KUBO, step=0.1, q0=1.0, p0=0.0)
    for attempt in (pickle.dumps, copy.copy, copy.deepcopy):
        with pytest.raises(ss.errors.WrongTypeError, match="can be neither pickled nor copied: prepare another"):
            attempt(run)


def test_a_sampler_of_a_formula_is_pickled():
    sampler = ss.level_sampler(KUBO, "q**2", q0=1.0, p0=0.0, horizon=1.0)
    again = pickle.loads(pickle.dumps(sampler))
    assert again(1, 50)[0].tolist() == sampler(1, 50)[0].tolist()


class Unread(io.StringIO):
    """A pipe whose reader has gone."""

    def write(self, text):
        """Raise the system's error."""
        raise BrokenPipeError(32, "Broken pipe")


@pytest.mark.parametrize("stderr", ["none", "closed", "unread"])
def test_progress_needs_nobody_who_sees_it(stderr, monkeypatch):
    there = {"none": None, "closed": io.StringIO(), "unread": Unread()}[stderr]
    if stderr == "closed":
        there.close()
    monkeypatch.setattr("sys.stderr", there)
    monkeypatch.setitem(sys.modules, "tqdm.auto", None)  # tqdm's bar treats such a stream in its own way
    wanted = ss.simulate(KUBO, **RUN)
    np.testing.assert_array_equal(ss.simulate(KUBO, **RUN, progress=True).q, wanted.q)
    assert ss.ensemble(KUBO, **RUN, progress=True).n_ok[0] == 1
    assert ss.mlmc(KUBO, "q**2", q0=1.0, p0=0.0, horizon=0.5, abs=0.5, progress=True).reached
    study = {"steps": [4, 8], "schemes": ["midpoint"], "paths": 40, "repeats": 5}
    assert len(ss.work_precision(KUBO, q0=1.0, p0=0.0, **study, progress=True).rows) == 2


SINGULAR = 'H = "p**2/2 + 1/q"\nnoise = ["0.1*q"]\n'


def write_scene(folder, text=SINGULAR, q0="[[0.0, 2.0, 3.0]]", before=""):
    """A scene of three paths, the first of which begins where H is not finite."""
    file = folder / "scene.toml"
    run = f"step = 0.1\nsteps = 4\nq0 = {q0}\np0 = 0.0\npaths = 3\n"
    file.write_text(f"{before}[model]\n{text}[run]\n{run}[output]\npaths = [0, 2]\n", encoding="utf-8")
    return file


def test_a_mark_of_its_encoding_is_no_part_of_a_scene(tmp_path):
    read = scene.load(write_scene(tmp_path, 'name = "kubo"\n', "1.0", before="\ufeff"))
    assert read.model.name == "kubo" and read.text.startswith("[model]")


def test_a_template_is_asked_for_by_name():
    for given in (np.zeros(3), None, 1.5):
        with pytest.raises(ss.errors.WrongTypeError, match="is not a name: give a string"):
            scene.template(given)


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_a_path_that_cannot_begin_fails_alone_whatever_runs_with_it(tmp_path):
    model = ss.model_from_sympy("p**2/2 + 1/q", noise=["0.1*q"])
    start = np.array([[0.0, 2.0, 0.0]])
    options = {"p0": 0.0, "step": 0.1, "steps": 4}
    whole = ss.simulate(model, q0=start, paths=3, **options)
    assert whole.status.tolist() == [3, 0, 3]
    for i in range(3):
        alone = ss.simulate(model, q0=start[:, i : i + 1], first_path=i, **options)
        assert alone.status[0] == whole.status[i]
        np.testing.assert_array_equal(alone.q[..., 0], whole.q[..., i])
    found = scene.load(write_scene(tmp_path))
    assert paths_of(found).status.tolist() == [3, 0] and moments_of(found).n_ok.tolist() == [3, 2, 2, 2, 2]
    with pytest.raises(ss.errors.InvalidArgumentError, match="not finite at q0 = 0"):
        ss.simulate(model, q0=0.0, paths=3, **options)  # one state serves all paths, so no path can begin


def test_points_of_brackets_need_both():
    with pytest.raises(ss.errors.WrongTypeError, match="only one of q and p is given: give both"):
        ss.commutator(KUBO, q=1.0)


def test_a_sentence_keeps_its_beginning_and_its_end():
    with pytest.raises(ss.errors.WrongTypeError) as caught:
        ss.moments(KUBO, **RUN, **{"x" * 100_000: 1})
    assert str(caught.value).startswith("there is no option 'xxx") and str(caught.value).endswith("increments")
    assert str(ss.errors.SceneError("word " * 20_000 + "end")).endswith("word end")


@pytest.mark.parametrize(
    "verb",
    ["", "run", "check", "template", "plot", "expect", "list", "study", "advise --tolerance 1", "slurm",
     "stability", "export --to c", "cite --scheme", "run --shard",
     "merge --out x", "completion"],
)  # fmt: skip
def test_the_command_line_repeats_no_page(verb, capsys):
    try:
        code = command_line.main([*verb.split(), "x" * 100_000])
    except SystemExit as stop:
        code = stop.code
    assert code == 2 and len(capsys.readouterr().err) < 3000
