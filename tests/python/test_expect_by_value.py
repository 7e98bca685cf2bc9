# SPDX-License-Identifier: BSD-3-Clause
"""Answers for each value of parameters: arrays, files, folders, scenes, and what is refused."""

import csv
import math

import numpy as np
import pytest
import symsde as ss
from symsde.answers.expectation import watch
from symsde.cli.command_line import main
from symsde.errors import IncompatibleError, InvalidArgumentError, UnknownNameError, WrongTypeError

PLACE = {"q0": 1.0, "p0": 0.0, "horizon": 1.0, "abs": 0.02, "scheme": "stormer_verlet", "method": "plain"}
SIGMA = np.array([0.1, 0.5, 0.9])

pytestmark = pytest.mark.usefixtures("quick_compiler")


def exact(sigma, a=1.0):
    """E q of the oscillator of Kubo at t = 1."""
    return np.exp(-np.square(sigma) / 2) * np.cos(a)


def test_values_and_files(tmp_path):
    """An answer for each value holds the exact mean, within two half widths, and is that of the model with the number;
    files have a dimension for the parameter.
    """
    model = ss.models.kubo(sigma=SIGMA)
    found = ss.expect(model, "q", groups="sigma", **PLACE)
    assert found.reached and found.dims == ("sigma",) and found.parameters["sigma"].tolist() == SIGMA.tolist()
    assert (np.abs(found.value - exact(SIGMA)) < 2 * found.half_width).all() and (found.half_width <= 0.02).all()
    assert found.value[0] - found.value[2] > 0.1 and found.points()[1] == {"sigma": 0.5}
    assert (found.low == [x.interval[0] for x in found.answers]).all() and set(found.method) == {"plain"}
    data = found.to_xarray()
    assert data["mean"].dims == ("sigma",) and float(data["high"].sel(sigma=0.9)) == found.high[2]
    found.save(tmp_path / "found.csv")
    rows = csv.DictReader(x for x in (tmp_path / "found.csv").read_text().splitlines() if not x.startswith("#"))
    assert [(float(x["sigma"]), float(x["mean"])) for x in rows] == list(zip(SIGMA, found.value, strict=True))
    found.save(tmp_path / "found.npz")
    with np.load(tmp_path / "found.npz") as data:
        assert np.array_equal(data["low"], found.low) and np.array_equal(data["sigma"], SIGMA)
    assert "0.9" in str(found) and "3 answers" in repr(found)


@pytest.mark.usefixtures("work_clock")
def test_answers_are_those_of_one_value():
    """Every answer has the bits of the answer for its value alone, if times do not decide."""
    model = ss.models.kubo(sigma=SIGMA)
    found = ss.expect(model, "q", groups="sigma", **PLACE)
    for k, sigma in enumerate(SIGMA):
        assert found.value[k] == ss.expect(model.with_parameters(sigma=sigma), "q", **PLACE).value


def test_two_parameters():
    """Two parameters make a product, or go together; parameters enter f."""
    product = ss.models.kubo(a=[1.0, 1.0, 2.0, 2.0], sigma=[0.1, 0.5, 0.5, 0.1])
    found = ss.expect(product, "a*q", groups=("a", "sigma"), **PLACE)
    a, sigma = np.meshgrid([1.0, 2.0], [0.1, 0.5], indexing="ij")
    assert found.value.shape == (2, 2) and (np.abs(found.value - a * exact(sigma, a)) < 2 * found.half_width).all()
    rows = ss.expect(ss.models.kubo(a=[1.0, 2.0], sigma=[0.1, 0.5]), "q", groups=["a", "sigma"], **PLACE)
    assert rows.dims == ("value",) and rows.to_xarray()["a"].dims == ("value",)
    assert (np.abs(rows.value - exact([0.1, 0.5], np.array([1.0, 2.0]))) < 2 * rows.half_width).all()


def test_folders(tmp_path):
    """A folder for each value keeps its work: a second call draws nothing."""
    model = ss.models.kubo(sigma=SIGMA)
    first = ss.expect(model, "q", groups="sigma", out=tmp_path, **PLACE)
    assert sorted(x.name for x in tmp_path.iterdir()) == ["value-1", "value-2", "value-3"]
    shards = {x: x.stat().st_mtime_ns for x in tmp_path.rglob("*") if "shard" in str(x)}
    again = ss.expect(model, "q", groups="sigma", out=tmp_path, **PLACE)
    assert np.array_equal(first.value, again.value)
    assert shards == {x: x.stat().st_mtime_ns for x in tmp_path.rglob("*") if "shard" in str(x)}


def test_stop():
    """A progress function that returns True leaves later values out; it hears of the whole."""
    heard = []

    def tell(done, total):
        heard.append((done, total))
        return done > 1000

    found = ss.expect(ss.models.kubo(sigma=SIGMA), "q", groups="sigma", progress=tell, **PLACE)
    assert heard[-1][1] == 3000 and 1000 < heard[-1][0] <= 2000
    assert found.answers[2] is None and math.isnan(found.value[2]) and not found.reached
    assert found.paths[2] == 0 and "not reached" in str(found) and not math.isnan(found.value[0])


@pytest.mark.usefixtures("work_clock")
def test_time_is_shared(monkeypatch):
    """max_time is for all values: each begins with its part of what is left."""
    given = []
    plain = watch.Watch.__init__

    def noted(self, max_time, progress):
        given.append(max_time)
        plain(self, max_time, progress)

    monkeypatch.setattr(watch.Watch, "__init__", noted)
    ss.expect(ss.models.kubo(sigma=SIGMA), "q", groups="sigma", max_time=300.0, **PLACE)
    whole, *parts = given
    assert whole == 300 and len(parts) == 3 and 90 < parts[0] <= 100 and parts[2] > parts[1] > parts[0]


@pytest.mark.usefixtures("work_clock")
def test_ctrl_c():
    """The exception has the answers until then."""
    model, calls, last = ss.models.kubo(sigma=SIGMA), [], [math.inf]

    def f(q, _p):
        calls.append(1)
        if len(calls) > last[0]:
            raise KeyboardInterrupt
        return q[0]

    whole = ss.expect(model.with_parameters(sigma=SIGMA[0]), f, **PLACE)
    last[0] = len(calls) + 3 * len(calls) // 2
    with pytest.raises(KeyboardInterrupt) as stop:
        ss.expect(model, f, groups="sigma", **PLACE)
    found = stop.value.partial
    assert isinstance(found, ss.Answers) and found.value[0] == whole.value and math.isnan(found.value[2])


def test_scene(tmp_path, capsys):
    """Ranges of a scene have an answer for each value."""
    scene = tmp_path / "scene.toml"
    scene.write_text(
        '[model]\nname = "kubo"\nsigma = {from = 0.1, to = 0.5, count = 2}\n[run]\nstep = 0.1\nsteps = 10\npaths = 2\n'
        'q0 = 1.0\np0 = 0.0\n[expect]\nf = "q"\nabs = 0.02\nscheme = "stormer_verlet"\n'
    )
    assert main(["expect", str(scene), "--quiet"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [x.partition(":")[0] for x in lines] == ["E q, sigma = 0.1", "E q, sigma = 0.5"]
    for line, sigma in zip(lines, (0.1, 0.5), strict=True):
        assert abs(float(line.partition(":")[2].split("[")[0]) - exact(sigma)) < 0.04
    assert main(["expect", str(scene)]) == 0
    assert "half width" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("given", "kind", "word"),
    [
        ("b", UnknownNameError, "the parameter of groups"),
        ([0, 1, 2], WrongTypeError, "labels of paths mean nothing"),
        ([], WrongTypeError, "name of a parameter"),
        (3, WrongTypeError, "name of a parameter"),
        ("a", IncompatibleError, "parameter sigma .* has an array of values, too"),
    ],
)
def test_refusals(given, kind, word):
    """Refuses groups with a sentence."""
    with pytest.raises(kind, match=word):
        ss.expect(ss.models.kubo(sigma=SIGMA), "q", groups=given, **PLACE)


def test_refused_without_groups():
    """Answers for one value refuse arrays, and say how to get one for each."""
    model, place = ss.models.kubo(sigma=SIGMA), {"q0": 1.0, "p0": 0.0, "horizon": 1.0}
    for ask in (
        lambda: ss.expect(model, "q", abs=0.1, **place),
        lambda: ss.mlmc(model, "q", abs=0.1, **place),
        lambda: ss.level_sampler(model, "q", **place),
        lambda: ss.advise(model, tolerance=0.1, **place),
        lambda: ss.mean_square(model, step=0.1),
    ):
        with pytest.raises(IncompatibleError, match=r"array of values of sigma.*groups='sigma' to `expect`"):
            ask()
    clash = ss.model_from_sympy("p**2/2 + error*q**2/2", noise=["0.1*q"], params={"error": [1.0, 2.0]})
    with pytest.raises(InvalidArgumentError, match="rename it"):
        ss.expect(clash, "q", groups="error", **PLACE)
