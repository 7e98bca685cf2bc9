# SPDX-License-Identifier: BSD-3-Clause
"""Warnings about doubtful runs: before the first step, after a run whose paths grew beyond all bounds, and about
passages that absorb paths and so remove them from other results."""

import dataclasses
import warnings
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
import symsde as ss
from symsde import errors
from symsde.batch import scene as scenes
from symsde.cli.command_line import main

ROOT = Path(__file__).resolve().parents[2]
UNSTABLE = {"q0": 1.0, "p0": 0.0, "step": 10.0, "steps": 100, "scheme": "stormer_verlet"}  # h omega = 10
HOP = ss.observe.Passage("q_1", low=-1.0)
OSCILLATING = {"q0": 1.0, "p0": 0.0, "step": 0.05, "steps": 200, "seed": 4, "save_every": 50}

SCENE = """
[model]
name = "linear_oscillator"
[run]
q0 = 1.0
p0 = 0.0
step = 10.0
steps = 60
paths = 300
scheme = "stormer_verlet"
"""

PASSAGE = """
[[observe]]
name = "hop"
kind = "passage"
of = "q_1"
low = -1.0
"""


@pytest.mark.parametrize(("scheme", "asks"), [("stormer_verlet", False), ("midpoint", True)])
def test_noise_is_measured_where_steps_solve_equations(scheme, asks):
    """Its bound is that of implicit equations: explicit steps do not pay for the Hessian of each noise."""

    def calls(**declared):
        seen = []

        def gradient(t, w, q, p):
            seen.append(1)
            return w[0] * q + w[1] * np.cos(q), w[0] * p

        model = ss.Model(ndof=1, nnoise=1, gradient=gradient, separable=True, position_noise=True, **declared)
        ss.simulate(model, q0=0.3, p0=0.1, step=0.01, steps=1, scheme=scheme)
        return len(seen)

    assert (calls() > calls(noise_lipschitz=1e-3)) == asks


def said(call):
    """The sentences of doubt that a call warns of, and the result of the call."""
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        result = call()
    return [str(x.message) for x in found if issubclass(x.category, errors.DoubtfulRunWarning)], result


def grown(sentences):
    """The warnings about growth."""
    return [text for text in sentences if "grew 1e6-fold" in text]


@pytest.mark.parametrize("paths", [1, 5, 300])
def test_an_unstable_step_is_warned_of_before_and_after(paths):
    """Python gives all of `report.warnings`, and the warning about growth, at the caller's line, in any units."""
    model = ss.models.linear_oscillator()
    for call in (ss.simulate, ss.moments):
        sentences, found = said(lambda call=call: call(model, paths=paths, **UNSTABLE))
        assert len(found.report.warnings) == 2
        assert "h*omega = 10" in sentences[0]
        assert tuple(sentences[:-1]) == found.report.warnings
        assert found.report.grown == paths
        assert f"{paths} grew 1e6-fold" in str(found.report)
        assert grown(sentences) == sentences[-1:]
    with pytest.warns(errors.DoubtfulRunWarning) as caught:
        ss.simulate(model, **UNSTABLE)
    assert {x.filename for x in caught} == {__file__}


def test_a_warning_made_an_error_comes_before_the_run():
    """If warnings are errors, no step is taken, and the exception holds no run."""
    steps = []
    with warnings.catch_warnings():
        warnings.simplefilter("error", errors.DoubtfulRunWarning)
        for call in (ss.simulate, ss.moments):
            with pytest.raises(errors.DoubtfulRunWarning, match=r"h\*omega = 10") as stop:
                call(ss.models.linear_oscillator(), progress=lambda done, total: steps.append(done), **UNSTABLE)
            assert stop.value.partial is None
        with pytest.raises(errors.DoubtfulRunWarning, match=r"h\*omega = 10"):
            ss.prepare(ss.models.linear_oscillator(), "stormer_verlet", step=10.0, q0=1.0, p0=0.0)
    assert not steps


def test_prepared_runs():
    """Doubts are warned of by `prepare`, growth by the call in which it happens."""
    sentences, run = said(
        lambda: ss.prepare(ss.models.linear_oscillator(), "stormer_verlet", step=10.0, q0=1.0, p0=0.0, paths=3)
    )
    assert "h*omega = 10" in sentences[0]
    sentences, saved = said(lambda: run.run(40, save_every=40))
    assert grown(sentences) == sentences
    assert saved.report.grown == 3
    sentences, saved = said(lambda: run.run(4))
    assert (sentences, saved.report.grown) == ([], 0)  # a call has too few steps to judge growth


@pytest.mark.parametrize("q_unit", [1.0, 1e-12, 1e9])
@pytest.mark.parametrize("p_unit", [1.0, 1e15, 1e-6])
def test_growth_knows_no_units(q_unit, p_unit):
    """The same motion in other units, stable and unstable: H = a p^2/2 + b q^2/2 with a = q_unit/p_unit = 1/b."""
    a = q_unit / p_unit
    model = ss.model_from_sympy("a*p**2/2 + q**2/2/a", params={"a": a})
    how = {"q0": q_unit, "p0": 0.0, "steps": 100, "scheme": "stormer_verlet"}
    for step, count in ((0.1, 0), (1.99, 0), (2.5, 1)):
        assert said(lambda step=step: ss.simulate(model, step=step, **how))[1].report.grown == count


def test_growth_is_beyond_a_million():
    """H = q p: q grows alone; H = (p^2 - q^2)/2: both grow, after the first tenth of the run by exp(0.9 t)."""
    saddle = ss.model_from_sympy("p**2/2 - q**2/2")
    how = {"q0": 1e-3, "p0": 1e-3, "steps": 1000, "scheme": "gauss2"}
    for rate, count in ((13.6, 0), (14.0, 1)):  # log(1e6) = 13.8
        sentences, run = said(lambda rate=rate: ss.simulate(saddle, step=rate / 900, **how))
        assert np.isclose(run.q[-1, 0, 0] / run.q[100, 0, 0], np.exp(rate), rtol=1e-6)
        assert (run.report.grown, len(grown(sentences))) == (count, count)
    one = ss.model_from_sympy("q*p")
    assert said(lambda: ss.simulate(one, q0=1.0, p0=1.0, step=0.03, steps=1000))[1].report.grown == 0


def test_from_rest():
    """From rest, noise or a force moves paths without counting as growth, however long the run."""
    shaken, pushed = ss.models.linear_oscillator(), ss.model_from_sympy("p**2/2 - q")
    for model in (shaken, pushed):
        for paths, steps in ((1, 10), (300, 1000), (1, 100_000)):
            how = {"q0": 0.0, "p0": 0.0, "step": 0.05, "steps": steps, "save_every": steps, "paths": paths}
            sentences, run = said(lambda model=model, how=how: ss.simulate(model, seed=2, **how))
            assert (sentences, run.report.grown) == ([], 0)


def test_growth_does_not_depend_on_blocks_and_threads():
    """The same count for any block width and number of threads, and with narrower blocks for the remaining paths."""
    model = ss.model_from_sympy("p**2/2 - k*q**2/2", params={"k": 1.0})
    q0 = np.where(np.arange(700) % 7 == 3, 1.0, 0.0)[np.newaxis]
    how = {"q0": q0, "p0": 0.0, "step": 0.05, "steps": 400, "paths": 700, "seed": 1, "save_every": 400}
    counts = {
        said(lambda more=(lanes, threads): ss.simulate(model, lanes=more[0], threads=more[1], **how))[1].report.grown
        for lanes in (8, 64, 256, None)
        for threads in (1, 3)
    }
    assert counts == {100}


def test_shards_merge_the_count():
    """An ensemble in shards gives the count of one run, and warns once."""
    model = ss.models.linear_oscillator()
    how = {**UNSTABLE, "paths": 700, "save_every": 100}
    sentences, whole = said(lambda: ss.moments(model, **how))
    with ThreadPoolExecutor(2) as executor:
        others, merged = said(lambda: ss.ensemble(model, shard_paths=256, executor=executor, **how))
    assert merged.report.grown == whole.report.grown == 700
    assert others == sentences


def test_scenes_say_it(tmp_path, capsys):
    """`symsde check` and `symsde run`, also with --quiet, tell doubts of an unstable step, and none of a stable one;
    saved paths, too.
    """
    file = tmp_path / "scene.toml"
    file.write_text(SCENE + "save_every = 20\n[output]\npaths = [0, 5]\n", encoding="utf-8")
    assert main(["check", str(file)]) == 0
    assert "warning    h*omega = 10 " in capsys.readouterr().out
    assert main(["run", str(file), "--out", str(tmp_path / "out"), "--quiet"]) == 0
    told = capsys.readouterr().err
    assert "symsde: h*omega = 10 " in told
    assert "symsde: 300 paths grew 1e6-fold" in told
    file.write_text(SCENE.replace("10.0", "0.1") + "save_every = 20\n", encoding="utf-8")
    assert main(["check", str(file)]) == 0
    assert "warning" not in capsys.readouterr().out
    assert main(["run", str(file), "--out", str(tmp_path / "fine"), "--quiet"]) == 0
    assert not capsys.readouterr().err


@pytest.mark.parametrize("file", sorted((ROOT / "examples").rglob("*.toml")), ids=lambda path: path.stem)
def test_scenes_of_the_examples_have_no_doubts(file):
    """No example scene has doubts, with few of its paths."""
    found = scenes.load(file)
    run = {**found.run, "paths": 8}
    steps = int(run["steps"])
    sentences, _ = said(lambda: ss.simulate(found.model, **{**run, "save_every": steps}))
    assert not sentences


def test_absorbed_paths_are_told():
    """The repr, the remarks and a warning before the run say that paths are absorbed; a passage that does not absorb
    warns of nothing.
    """
    model = ss.models.linear_oscillator()
    sentences, found = said(lambda: ss.moments(model, observers={"hop": HOP}, paths=500, **OSCILLATING))
    lost = found.observed["hop"].n
    assert 0 < lost < 500
    assert found.n_ok[-1] == 500 - lost
    assert f"500 paths, {lost} absorbed by hop, {500 - lost} left, ok" in repr(found)
    assert any(text.startswith(f"hop: {lost} paths left and ended there") for text in found.remarks())
    assert any(text.startswith("a passage absorbs: moments") for text in sentences)
    assert "a passage absorbs" in str(found.report)
    going = dataclasses.replace(HOP, absorb=False)
    sentences, found = said(lambda: ss.moments(model, observers={"hop": going}, paths=500, **OSCILLATING))
    assert "absorbed" not in repr(found) + str(sentences) + str(found.report) + str(found.remarks())


@pytest.mark.parametrize(
    "beside",
    [
        {"observers": {"x": ss.observe.Histogram("q_1", -2, 2)}},
        {"observables": {"r": "q**2 + p**2"}},
    ],
)
@pytest.mark.parametrize("call", [ss.moments, ss.ensemble])
def test_absorb_unsaid_beside_other_results(call, beside):
    """A warning at the caller's line names absorb=; none if absorb is given, or if the passage is the only result."""
    model = ss.models.linear_oscillator()
    others = {"observables": beside.get("observables")}
    for absorb, is_said in ((None, False), (True, True), (False, True)):
        hop = ss.observe.Passage("q_1", low=-1.0, absorb=absorb)
        wanted = {"hop": hop, **beside.get("observers", {})}
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            found = call(model, observers=wanted, paths=300, **others, **OSCILLATING)
        told = [x for x in caught if issubclass(x.category, errors.UnsaidAbsorbWarning)]
        assert len(told) == (0 if is_said else 1)
        assert all("absorb=" in str(x.message) and "0.2" in str(x.message) and x.filename == __file__ for x in told)
        assert (found.n_ok[-1] < 300) == (absorb is not False)
    with warnings.catch_warnings():
        warnings.simplefilter("error", errors.UnsaidAbsorbWarning)
        call(model, observers={"hop": HOP}, paths=300, **OSCILLATING)


def test_absorb_unsaid_in_scenes(tmp_path, capsys):
    """A scene that does not say whether a passage absorbs gets the warning if it has another observer, an observable
    or saved paths.
    """
    text = SCENE.replace("10.0", "0.2") + "save_every = 20\n{}\n" + PASSAGE + "{}"
    file = tmp_path / "scene.toml"
    cases = [("", "", False), ("[output]\npaths = [1]", "", True), ("[observables]\nr = 'q**2'", "", True)]
    cases += [
        ("", '[[observe]]\nkind = "extremes"\nof = "p_1"\n', True),
        ("[output]\npaths = [1]", "absorb = true\n", False),
    ]
    for number, (before, after, warned) in enumerate(cases):
        file.write_text(text.format(before, after), encoding="utf-8")
        assert main(["check", str(file)]) == 0
        assert ("absorb=True" in capsys.readouterr().out) == warned
        assert main(["run", str(file), "--out", str(tmp_path / f"out{number}"), "--quiet"]) == 0
        told = capsys.readouterr().err
        assert ("hop: absorb is not said" in told) == warned
        assert "a passage absorbs: moments" in told
