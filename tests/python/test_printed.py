# SPDX-License-Identifier: BSD-3-Clause
"""Printed text and reports hold the computed numbers: tables are parsed, judges are tried on both sides of a bound."""

import ctypes
import dataclasses
import logging
import re
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import symsde as ss
from symsde.answers.advice.advise import Advice, Option
from symsde.answers.expectation.answer import Alternative, Answer, Level, Multilevel, Rate
from symsde.batch import dry, run_progress
from symsde.batch.execute import Task
from symsde.batch.pieces import Piece
from symsde.cli import command_line
from symsde.cli.run_command import print_moments
from symsde.errors import MissingPackageError
from symsde.native import abi, files
from symsde.run import report
from symsde.show import look
from symsde.studies.paper import figure_4_1
from symsde.studies.paper.experiment import Experiment
from symsde.studies.stability.scenario import says


def test_every_member_of_a_report():
    """A struct whose members all differ arrives in Python with each value in its place."""
    given = abi.Report(status=6, correction=2, failed=11, stopped=12, threads=13, lanes=16)
    given.lost_variance, given.seconds_setup, given.seconds_run = 0.015, 1.25, 2.5
    given.stepper, given.left_out, given.warnings = b"a stepper", b"one; two", b"first\nsecond"
    given.functionals, given.lapack, given.damping = b"dZ and K", b"somebody's 1.2", b"dp = .. - p dt"
    for i, name in enumerate(abi.COUNTERS):
        setattr(given, name, 100 + i)
    result = report.Reported()
    result.setup = SimpleNamespace(repeated_noise=lambda: "third")
    result._keep_report(given)
    with pytest.warns(ss.PathsFailedWarning, match="^11 paths failed"):
        result._warn_of_failures()
    found = result.report
    expected = {"outcome": "some paths failed", "status": 6, "stepper": "a stepper", "correction": "mean"}
    expected |= {
        "left_out": ("one", "two"),
        "warnings": ("first", "second", "third"),
        "failed": 11,
        "stopped": 12,
        "grown": 0,
    }
    expected |= {"functionals": ("dZ", "K"), "lapack": "somebody's 1.2", "damping": "dp = .. - p dt", "temperature": ""}
    expected |= {"threads": 13, "lanes": 16, "lost_variance": 0.015, "timings": {"setup": 1.25, "run": 2.5}}
    names = ["path_steps", "normals", "gradients", "hessians", "hessian_vectors", "iterations", "solves"]
    names += ["lapack_solves", "failures", "damped", "continued", "pivoted_solves"]
    expected |= {"counters": {name: 100 + i for i, name in enumerate(names)}, "versions": ss.build_info()}
    assert vars(found) == expected
    lines = {line[:11].strip(): line[11:] for line in str(found).splitlines()}
    assert lines["outcome"] == "some paths failed" and lines["stepper"] == "a stepper"
    assert (
        lines["correction"] == "mean"
        and lines["left out"] == "one; two"
        and lines["warnings"] == "first; second; third"
    )
    assert lines["counters"] == ", ".join(f"{name.replace('_', ' ')} {100 + i}" for i, name in enumerate(names))
    assert lines["driven by"] == "dW and dZ and K"
    assert lines["LAPACK"] == "somebody's 1.2" and lines["damping"] == "dp = .. - p dt"
    assert lines["paths"] == "11 failed, 12 stopped" and lines["threads"] == "13, 16 lanes a block"
    assert lines["seconds"] == "1.25 to set up, 2.5 to run" and lines["version"] == ss.__version__
    resumed = dataclasses.replace(found, timings={"setup": 0.0, "run": 2.5})
    assert str(resumed).splitlines()[-2] == "seconds    2.5 to run"
    assert "13, 1 lane a block" in str(dataclasses.replace(found, lanes=1))


def test_counters_and_times_of_a_run_that_is_known():
    """Counters of a known run: one normal for each step of a path."""
    given = ss.simulate(
        ss.models.pendulum(), q0=1.0, p0=0.0, step=0.01, steps=4000, paths=256, threads=1, scheme="stormer_verlet"
    ).report
    assert given.counters["path_steps"] == given.counters["normals"] == 4000 * 256
    assert given.timings["run"] > 0 and given.timings["setup"] > 0
    assert given.status == 0 and given.threads == 1 and given.failed == given.stopped == 0


@pytest.fixture(scope="module")
def moments():
    run = {"q0": [0.1, 0.2], "p0": [0.0, 0.1], "step": 0.05, "steps": 200, "save_every": 5, "paths": 300}
    return ss.moments(
        ss.models.henon_heiles(sigma1=0.02, sigma2=0.01), observables={"product": lambda q, p: q[0] * p[1]}, **run
    )


def test_the_table_of_moments(moments, capsys):
    print_moments(moments)
    head, *lines = capsys.readouterr().out.splitlines()
    assert head.split() == ["t", "paths", "mean", "q_1", "mean", "p_1", "mean", "energy", "mean", "product"]
    assert len(lines) == 11
    times = dict(zip(moments.t.tolist(), range(len(moments.t)), strict=True))
    rows = [line.replace("+-", " ").split() for line in lines]
    assert [float(row[0]) for row in rows] == pytest.approx(np.linspace(0, 10, 11))
    for row in rows:
        i = next(i for t, i in times.items() if abs(t - float(row[0])) < 1e-9)
        expected = [moments.n_ok[i], moments.mean_q[i, 0], moments.se_mean_q[i, 0], moments.mean_p[i, 0]]
        expected += [moments.se_mean_p[i, 0], moments.mean_energy[i], moments.se_mean_energy[i]]
        expected += [moments.mean["product"][i], moments.se_mean["product"][i]]
        for text, value in zip(row[1:], expected, strict=True):
            assert float(text) == pytest.approx(value, rel=0.051, abs=1e-12), (row, text, value)
        for text, value in zip(row[2::2], expected[1::2], strict=True):
            assert float(text) == pytest.approx(value, rel=6e-5, abs=1e-12)


def test_the_last_time_is_always_shown(kubo, capsys):
    print_moments(ss.moments(kubo, q0=1.0, p0=0.0, step=0.1, steps=23, paths=3))
    lines = capsys.readouterr().out.splitlines()[1:]
    assert len(lines) <= 12 and float(lines[-1].split()[0]) == pytest.approx(2.3)


def test_one_line_about_a_result(moments, kubo):
    assert repr(moments) == (
        "<moments of henon_heiles(alpha=1, sigma1=0.02, sigma2=0.01) by midpoint: q_1, q_2, p_1, p_2, energy, product "
        "at 41 times from 0 to 10, 300 paths, ok>"
    )
    run = ss.simulate(kubo, q0=1.0, p0=0.0, t0=1.0, step=0.5, steps=4, save_every=2, paths=7, scheme="gauss2")
    assert repr(run) == (
        "<run of kubo(a=1, sigma=0.3) by gauss2: 3 times from 1 to 3, 1 degree of freedom, 7 paths, ok>"
    )
    assert repr(ss.schemes.get("heun")) == "<scheme heun: tableau, 2 stages, not symplectic>"


def test_the_table_of_convergence(kubo):
    found = ss.convergence(kubo, "midpoint", q0=1.0, p0=0.0, steps=[8, 16, 32], paths=100, seed=3)
    head, names, *rows, last = str(found).splitlines()
    assert head == "midpoint on kubo(a=1, sigma=0.3), 100 paths, against the exact solution"
    assert names.split() == ["steps", "h", "error", "95", "%", "interval"]
    for i, row in enumerate(rows):
        n, h, error, low, _, high = row.split()
        assert int(n) == found.steps[i] and float(h) == pytest.approx(found.step[i], rel=1e-4)
        assert float(error) == pytest.approx(found.error[i], rel=1e-4)
        assert float(low) == pytest.approx(found.low[i], rel=1e-3)
        assert float(high) == pytest.approx(found.high[i], rel=1e-3)
    assert last == f"order {found.order:.3f}, {found.order_low:.3f} .. {found.order_high:.3f}"
    assert found.order_high - found.order == pytest.approx(found.order - found.order_low)


def test_convergence_is_drawn_as_it_is(kubo):
    pytest.importorskip("matplotlib")
    found = ss.convergence(kubo, "midpoint", q0=1.0, p0=0.0, steps=[8, 16, 32], paths=100, seed=3)
    (bars,) = found.plot().axes[0].containers
    np.testing.assert_array_equal(bars[0].get_xdata(), found.step)
    np.testing.assert_array_equal(bars[0].get_ydata(), found.error)
    ends = np.array(bars[2][0].get_segments())[:, :, 1]
    np.testing.assert_allclose(ends, np.stack([found.low, found.high], axis=1), rtol=1e-12)
    assert bars.get_label() == f"midpoint: order {found.order:.2f}"
    assert {"color": bars[0].get_color(), "marker": bars[0].get_marker()} == look.of_scheme("midpoint")


@pytest.mark.parametrize("low, high", [(0.011, 0.7), (0.012, 1.3), (0.2, 0.7), (1e-7, 2e-4), (1e-12, 10.0)])
def test_logarithmic_axes_have_at_least_two_labels(low, high):
    figure = pytest.importorskip("matplotlib.figure").Figure()
    axes = figure.subplots()
    axes.set(xscale="log", yscale="log", xlim=(low, high), ylim=(low, high))
    look.readable(figure.axes)
    for axis in (axes.xaxis, axes.yaxis):
        ticks = axis.get_majorticklocs()
        labels = zip(ticks, axis.get_major_formatter().format_ticks(ticks), strict=True)
        seen = [label for at, label in labels if label and low <= at <= high]
        assert len(seen) >= 2, seen


def test_lists_say_what_the_library_says(capsys):
    assert command_line.main(["list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    for name in ss.models.names():
        (line,) = [line for line in lines if line.startswith(f"  {name}(")]
        pairs = dict(pair.split("=") for pair in line.strip()[len(name) + 1 : -1].split(", "))
        assert {key: float(value) for key, value in pairs.items()} == ss.models.parameters(name)
    for name in ss.schemes.names():
        info = ss.schemes.get(name).info
        (line,) = [line for line in lines if line.split()[:1] == [name]]
        assert ("not symplectic" in line) == (not info.symplectic)
        strong = [info.orders[kind].value for kind in ("additive", "commutative", "general")]
        orders = re.search(r"(?:strong order (\S+) / (\S+) / (\S+), +)?weak order (\S+)  ", line).groups()
        assert [float(x) for x in orders if x is not None] == [
            *(strong if any(strong) else ()),
            info.orders["weak"].value,
        ]
        assert line.endswith(info.reference)


def test_info_lists_versions_and_packages(capsys):
    assert command_line.main(["info"]) == 0
    lines = dict(line.split(": ", 1) for line in capsys.readouterr().out.splitlines())
    whole = ss.build_info()
    for key in whole.keys() - {"compile options"}:
        assert lines[key] == whole[key]
    told, known = lines["compile options"].split(), whole["compile options"].split()
    assert [word for word in known if word in told] == told and any(word.startswith("-O") for word in told)
    assert all(word.startswith("-m") for word in known if word not in told)
    assert lines["numpy"] == "yes" and lines["python"].count(".") == 2


def test_warnings_are_searched_for_words():
    assert says(SimpleNamespace(warnings=("a noise", "b")), "noise")
    assert not says(SimpleNamespace(warnings=("a noise",)), "drift")


def test_status_texts():
    texts = {code: ss.status_text(code) for code in range(-9, 7)}
    assert len(set(texts.values())) == 16 and texts[0] == "ok" and texts[5] == "stopped on request"
    assert "unknown" in ss.status_text(99).lower()
    for code, kind in ss.errors._BY_CODE.items():
        error = ss.errors.from_code(code, "a sentence")
        assert type(error) is kind and error.code == code and str(error) == "a sentence"
    assert type(ss.errors.from_code(3, "x")) is ss.errors.NumericalError
    assert ss.errors.from_code(3, "x").code == 3


def test_texts_longer_than_any_buffer():
    """A text that does not fit the first buffer is requested again."""
    from symsde.native import handles

    sizes = []

    class Library:
        @staticmethod
        def symsde_long(buffer, size, needed):
            sizes.append(size)
            text = b"x" * 3000
            ctypes.memmove(buffer, text[: size - 1] + b"\0", min(size, 3001))
            ctypes.cast(needed, ctypes.POINTER(ctypes.c_size_t))[0] = 3001
            return 0

    before = handles.library
    handles.library = Library
    try:
        assert handles.text("long") == "x" * 3000
    finally:
        handles.library = before
    assert sizes == [1024, 3001]


@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash")
def test_completion_in_a_shell(capsys, monkeypatch):
    """A shell with the script completes verbs and options; without shtab a message says what to install."""
    pytest.importorskip("shtab")
    assert command_line.main(["completion", "bash"]) == 0
    script = capsys.readouterr().out
    ask = 'COMP_WORDS=(symsde "$@"); COMP_CWORD=$#; _shtab_symsde; echo "${COMPREPLY[@]}"'

    def completed(*words):
        command = ["bash", "-c", f"{script}\n{ask}", "bash", *words]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()

    assert completed("sel") == ["selftest"]
    assert sorted(completed("st")) == ["stability", "study"]
    assert sorted(completed("plot", "--o")) == ["--of", "--out"]
    monkeypatch.setitem(sys.modules, "shtab", None)
    assert command_line.main(["completion", "zsh"]) == command_line.BAD_INPUT
    said = capsys.readouterr().err
    assert f"pip install '.[completion]' in {Path(__file__).parents[2]}" in said or "'symsde[completion]'" in said


def test_how_a_missing_package_is_installed(tmp_path, monkeypatch):
    """In a source tree the message names the tree, elsewhere the installed package."""
    place = tmp_path / "python" / "symsde" / "native" / "files.py"
    monkeypatch.setattr(files, "__file__", str(place))
    with pytest.raises(MissingPackageError, match=r"^none is not installed: pip install 'symsde\[sympy\]'$"):
        files.optional("none", "sympy")
    (tmp_path / "pyproject.toml").touch()
    with pytest.raises(MissingPackageError, match=r"pip install '\.\[xarray\]' in .*, or save as \.npz$"):
        files.optional("none", "xarray")


def test_a_mean_is_printed_with_its_own_error_and_bias():
    """An answer and a multilevel estimate whose members all differ."""
    rest = {"alternatives": (), "reached": True, "why": "because", "notes": ()}
    one = Answer(2.0, (1.5, 2.5), 0.25, 0.03, "plain", "heun", 0.125, 777, 4.5, 0.75, **rest)
    lines = str(one).splitlines()
    assert lines[0] == "2 +- 0.5, 95 %: standard error 0.25, bias 0.03"
    assert lines[1] == "plain by heun, h = 0.125, 777 paths, 4.5 s of the processor (0.75 s for the pilot)"
    level = Level(8, 500, 0.5, 0.1, 0.25, 3.5, 0.6, 0.7, 0.875, 0.0115, 0)
    rates = {"alpha": Rate(1.0, 0.1), "beta": Rate(2.0, 0.2), "gamma": Rate(3.0, 0.3)}
    several = Multilevel(2.0, (1.5, 2.5), 0.25, 0.03, "heun", (level,), **rates, reached=True, notes=(), cost=4.5)
    lines = str(several).splitlines()
    assert lines[0].startswith("2 +- 0.5 (95 %: standard error 0.25, bias 0.03), multilevel heun, 4.5 s")
    assert lines[1].split()[-3:] == ["us", "a", "path"]
    assert lines[2].split() == ["0", "8", "500", "5.0000e-01", "2.50e-01", "3.5", "0.88", "23"]
    assert lines[3] == "alpha 1.00 +- 0.10, beta 2.00 +- 0.20, gamma 3.00 +- 0.30"


def test_an_answer_lists_what_else_there_was():
    others = tuple(Alternative(f"way {i}", "heun", 0.25 * i, 1.5 * i) for i in range(1, 11))
    rest = {"alternatives": others, "reached": True, "why": "because", "notes": ("a doubt",)}
    lines = str(Answer(2.0, (1.5, 2.5), 0.25, 0.03, "plain", "heun", 0.125, 777, 4.5, 0.75, **rest)).splitlines()
    assert lines[2:5] == ["because", "a doubt", "others, as the pilot reckons:"] and len(lines) == 5 + 8
    assert lines[6].split() == ["way", "2", "heun", "h", "=", "0.5", "3", "s"]


def test_advice_is_printed_with_its_own_step_and_cost():
    others = tuple(Option(f"scheme_{i}", 10 * i, 0.25 * i, 1.5e-6 * i) for i in range(1, 11))
    lines = str(Advice("heun", 0.125, 40, 2.5e-6, ("one", "two"), others)).splitlines()
    assert lines[:4] == ["heun, h = 0.125 (40 steps), 2.5 us a path", "- one", "- two", "others:"]
    assert lines[5].split() == ["scheme_2", "h", "=", "0.5", "3", "us", "a", "path"] and len(lines) == 4 + 8


def test_sizes_and_times_in_words():
    sizes = {"999 bytes": 999, "1.5 kB": 1500, "25 MB": 2.5e7, "3 GB": 3e9, "40 TB": 4e13}
    assert [dry._bytes(x) for x in sizes.values()] == list(sizes)
    times = {"1.5 seconds": 1.5, "1.2e+02 seconds": 119, "2.5 minutes": 150, "119.0 minutes": 7140, "3.0 hours": 10800,
             "47.0 hours": 169200, "3.0 days": 259200}  # fmt: skip
    assert [dry._time(x) for x in times.values()] == list(times)


@pytest.mark.parametrize(("kind", "disk", "memory"), [("paths", 32 * 5, 16 * 5 * (2 + 3)), ("moments", 0, 0)])
def test_memory_and_disk_of_a_dry_run(monkeypatch, kind, disk, memory):
    """With 5 saved times: every path, q and p, is in a shard and in the results; memory is twice their size plus three
    times each thread's work. Moments take as much for many paths as for few."""
    monkeypatch.setattr(dry, "_rate", lambda task, piece: 100.0)
    run = {"q0": 0.1, "p0": 0.0, "step": 0.1, "steps": 4, "threads": 1}
    few, many = (
        dry.need(Task(ss.models.kubo(), {**run, "paths": n}), [Piece("x", kind, 0, n, 4 * n)], n, 5)
        for n in (256, 1024)
    )
    assert (many.disk - few.disk) / 768 == disk and (many.memory - few.memory) / 768 == memory
    assert f"memory     about {dry._bytes(many.memory)}\ndisk       about {dry._bytes(many.disk)}\n" in str(many)
    assert (
        0 < few.disk < 1e6 and 5e7 < few.memory < 1e8 and str(few).startswith("path-steps 1024\nshards     1, of 256")
    )


def test_a_dry_run_compares_disk_with_what_is_free(monkeypatch, tmp_path):
    """A dry run tells the free space of the future folder's disk, also while the folder and its parents do not
    exist.
    """
    monkeypatch.setattr(dry, "_rate", lambda task, piece: 100.0)
    task = Task(ss.models.kubo(), {"q0": 0.1, "p0": 0.0, "step": 0.1, "steps": 4, "threads": 1, "paths": 256})
    asked = []
    for free, words in {2e9: ", 2 GB are free\n", 1e3: ", but 1 kB are free: save fewer paths or less often"}.items():
        monkeypatch.setattr(
            dry.shutil, "disk_usage", lambda place, n=free: asked.append(place) or SimpleNamespace(free=n)
        )
        found = dry.need(task, [Piece("x", "paths", 0, 256, 1024)], 256, 5, tmp_path / "not" / "there")
        assert f"disk       about {dry._bytes(found.disk)}{words}" in str(found)
    assert asked == [tmp_path, tmp_path]
    monkeypatch.undo()
    assert 0 < dry._free(tmp_path) < 1e18


@pytest.mark.parametrize(("threads", "pieces", "seconds"), [(1, 4, 40.0), (2, 4, 20.0), (6, 3, 5.0), (8, 2, 2.5)])
def test_the_time_of_a_dry_run_is_that_of_all_threads(monkeypatch, threads, pieces, seconds):
    """Pieces of 10 seconds on one thread; if there are fewer pieces than threads, threads share them."""
    monkeypatch.setattr(dry, "_rate", lambda task, piece: 100.0)
    run = {"q0": 0.1, "p0": 0.0, "step": 0.1, "steps": 4, "paths": 256 * pieces, "threads": threads}
    task = Task(ss.models.kubo(), run)
    cut = [Piece(f"m{i}", "moments", 256 * i, 256, 1000) for i in range(pieces)]
    found = dry.need(task, [*cut[1:], Piece("p", "paths", 0, 256, 1000)], 256, 5)
    assert found.seconds == pytest.approx(seconds) and found.path_steps == 1000 * pieces
    assert found.shards == pieces and found.workers == min(threads, pieces)
    assert (
        f"time       about {seconds:.2g} seconds here, {found.workers} shard{'s' * (found.workers > 1)} at a time"
        in str(found)
    )


@pytest.mark.parametrize(("found", "left"), [(0, 60), (15, 150)])
def test_progress_tells_the_time_that_is_left(found, left, monkeypatch, caplog):
    """If a quarter of the work takes 20 seconds, 60 are left. If 15 of the quarter's 25 parts were found finished,
    the other 10 took the 20 seconds, and the remaining 75 take 150.
    """
    now = [100.0]
    monkeypatch.setattr(run_progress.time, "monotonic", lambda: now[0])
    with caplog.at_level(logging.INFO, logger="symsde"):
        lines = run_progress.display(False, found)
        now[0] += 20.0
        lines(25, 100)
    assert caplog.messages == [f"25 % of 100 path-steps, about {left} s left"]


def test_least_median_and_most_of_the_seeds():
    """Three seeds whose mean differs from their median."""
    experiment = Experiment("figure_4_1", "a title")
    keys = ("midpoint_fine", "reference_fine", "midpoint_reference", "midpoint_eighth_fine")
    figure_4_1._judge(experiment, [{key: (i + 1) * x for i, key in enumerate(keys)} for x in (0.09, 0.01, 0.02)])
    rows = [row for row in experiment.checks if "least, median, most" in str(row)]
    assert [re.findall(r"\d\.\d{3}", str(row))[:3] for row in rows] == [
        [f"{i * x:.3f}" for x in (0.01, 0.02, 0.09)] for i in (1, 2, 3, 4)
    ]
