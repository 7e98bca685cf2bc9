# SPDX-License-Identifier: BSD-3-Clause
"""Messages about damped models: reports, notebooks, doubts before the first step, and folders that refuse to
continue with another damping.
"""

import re
import warnings
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import symsde as ss
from symsde import errors
from symsde.cli import command_line

pytestmark = pytest.mark.usefixtures("quick_compiler")

RATE = 0.8
WELL = ss.model_from_sympy("p**2/2 + q**4/4 - q**2/2", noise=["-s*q"], params={"s": 1.4})
FREE = ss.model_from_sympy("p**2/2", noise=["-q"])
PAIR = ss.model_from_sympy("(p1**2 + p2**2)/2 + q1*q2", noise=["-0.3*q1", "-0.3*q2"])
HEAVY = ss.model_from_sympy("p1**2/2 + p2**2/6 + q1*q2", noise=["-0.3*q1"])
MIXED = ss.model_from_sympy("p**2/2 + cos(q)*(1 + p**2/8)", noise=["0.4*q*p"])
GIVEN = {"q0": 0.7, "p0": 0.3, "step": 0.05, "steps": 4, "seed": 5}

SCENE = """
[model]
name = "linear_oscillator"
{damping}
[run]
step = 0.1
steps = 20
save_every = 10
paths = 1500
q0 = 1.0
p0 = 0.0
scheme = "gauss_dkdkd"
[output]
paths = [0, 700]
"""


def doubts(call):
    """The sentences of doubt about damping in a call's warnings, and the result of the call."""
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        result = call()
    texts = [str(x.message) for x in found if issubclass(x.category, errors.DoubtfulRunWarning)]
    return [text for text in texts if text.startswith("gamma*h = ")], result


def test_reports_say_that_energy_is_fed_in():
    """Where momenta may grow, no report says that the form or volume shrinks."""
    for model, told in (
        (WELL.damped(-0.3, allow_gain=True), "dp = .. + 0.3 p dt, so that dp^dq grows by one factor"),
        (PAIR.damped([-0.5, 2.0], allow_gain=True), "-0.5 to 2, which changes volume alone by one factor"),
        (PAIR.damped(np.diag([-0.5, 2.0]), allow_gain=True), "by a matrix, which changes volume alone by one factor"),
    ):
        assert ss.simulate(model, **GIVEN).report.damping.endswith(told)


@pytest.mark.parametrize(
    ("model", "told"),
    [
        (WELL, ""),
        (WELL.damped(RATE), "dp = .. - 0.8 p dt, so that dp^dq shrinks by one factor"),
        (WELL.damped(RATE).forced(lambda q, p, t: -0.1 * q), "dp = .. - 0.8 p dt"),
        (PAIR.damped([0.5, 2.0]), "gamma_i = 0.5 to 2, which shrinks volume alone by one factor"),
        (HEAVY.damped(RATE), "shrinks by one factor; on velocities the friction is rate times mass"),
        (MIXED.damped(RATE), "shrinks by one factor; of momenta, which is not friction on velocities"),
    ],
)
def test_reports_and_notebooks_say_what_is_damped(model, told):
    """Reports of runs, prepared runs, moments, shards and files name the damping of momenta, and the friction on
    velocities that it amounts to.
    """
    report = ss.simulate(model, **GIVEN).report
    assert report.damping.endswith(told) and bool(report.damping) == bool(told)
    assert ("damping    dp" in str(report)) == bool(told)
    assert ss.moments(model, **GIVEN).report.damping == report.damping
    with ThreadPoolExecutor(1) as executor:
        parts = ss.ensemble(model, shard_paths=256, executor=executor, **{**GIVEN, "paths": 600})
    assert parts.report.damping == report.damping
    page = model._repr_html_()
    assert ("- γ p dt" in page) == ("damping γ = " in page) == bool(told)
    for rate in model.damping:
        assert re.search(rf"damping γ = .*\b{rate:g}\b", page)


def test_reports_know_schemes_that_keep_no_factor():
    """Heun's rule has no factor of dp ^ dq, with or without damping."""
    report = ss.simulate(WELL.damped(RATE), **{**GIVEN, "scheme": "heun"}).report
    assert report.damping == "dp = .. - 0.8 p dt, of which the scheme keeps no factor"


def test_a_file_keeps_what_was_damped(tmp_path):
    """A loaded report equals the saved one."""
    run = ss.simulate(WELL.damped(RATE), **GIVEN)
    run.save(tmp_path / "run.nc")
    assert ss.load(tmp_path / "run.nc").report.damping == run.report.damping


@pytest.mark.parametrize("scheme", ["midpoint", "gauss2", "stormer_verlet", "symplectic_euler_adjoint", "lobatto3"])
def test_a_doubtful_temperature_is_told_with_its_number(scheme):
    """A free particle's step from rest with dW = 1 shows which part of the noise the step keeps: the number in the
    doubt.
    """
    how = {"q0": 0.0, "p0": 0.0, "step": 1.0, "steps": 1, "scheme": scheme, "increments": np.ones((1, 1))}
    for z in (0.251, 1.0, 8.0):
        sentences, run = doubts(lambda z=z: ss.simulate(FREE.damped(z), **how))
        ratio = 2 * z * run.p[-1, 0, 0] ** 2 / (1 - np.exp(-2 * z))
        assert len(sentences) == (abs(ratio - 1) > 0.01), (z, ratio)
        if sentences:
            assert sentences == list(run.report.warnings)
            told = float(re.search(r"a free particle at rest (\S+) times the right mean of p\^2", sentences[0])[1])
            assert told == pytest.approx(ratio, rel=1e-5)


def test_where_doubts_begin():
    """The midpoint rule's doubts begin at gamma h = 1/4; there are none without noise, with noise of momenta, or
    with kicks of constant noise.
    """
    how = {"q0": 0.1, "p0": 0.0, "steps": 1}

    def told(model, rate, scheme="midpoint", step=1.0):
        return len(doubts(lambda: ss.simulate(model.damped(rate, allow_gain=True), step=step, scheme=scheme, **how))[0])

    assert [told(FREE, z) for z in (0.249, 0.251)] == [0, 1]
    assert [told(FREE, 0.249 * k, step=1 / k) for k in (0.01, 100.0)] == [0, 0]
    assert [told(FREE, 0.251 * k, step=1 / k) for k in (0.01, 100.0)] == [1, 1]
    assert told(FREE, -1.0) == told(FREE, 1.0, step=-1.0) == 0
    assert told(ss.model_from_sympy("p**2/2"), 1.0) == told(ss.models.kubo(a=0.1, sigma=0.1), 1.0) == 0
    assert told(ss.models.linear_oscillator(sigma=0.0), 1.0) == 0
    assert [told(FREE, 1.0, scheme) for scheme in ("gauss_dkdkd", "verlet_kdk", "chin4a")] == [0, 0, 0]
    assert [told(PAIR, z, "gauss_dkdkd") for z in ([2.0, 2.0], [2.0, 2.5], [0.1, 0.2])] == [0, 0, 0]
    uneven = ss.model_from_sympy("(p1**2 + p2**2)/2", noise=["-sin(q1)", "-q2"])
    assert [told(uneven, z, "gauss_dkdkd") for z in ([2.0, 2.0], [2.0, 2.5], [0.1, 0.2])] == [0, 1, 0]


@pytest.mark.parametrize("scheme", ["gauss_dkdkd", "verlet_kdk", "verlet_dz"])
@pytest.mark.parametrize(
    ("noise", "s", "count"),
    [
        (["-s*q1", "-q2"], 1.0, 0),
        (["-s*q1", "-exp(-t)*q2"], 1.0, 1),
        (["-s*q1 - q2"], 1.0, 1),
        (["-s*q1", "-q2"], [1.0, 1.5], 1),
    ],
    ids=["constant", "in time", "of one noise", "by path"],
)
def test_noise_that_lacks_its_law_is_told(noise, s, count, scheme):
    """Unequal rates: what dW and a of a step give p_1 from rest, whose mean square is to be (1 - exp(-2 z))/2z."""
    model = ss.model_from_sympy("(p1**2 + p2**2)/2", noise, params={"s": s}).damped([2.0, 0.5])

    def pushed(dw, a):
        columns = np.zeros((1, 2 * model.nnoise))
        columns[0, 0], columns[0, model.nnoise] = dw, a + dw / 2
        how = {"q0": 0.0, "p0": 0.0, "step": 1.0, "steps": 1, "paths": np.size(s), "increments": columns}
        sentences, run = doubts(lambda: ss.simulate(model, scheme=scheme, **how))
        return sentences, run.p[-1, 0, 0] ** 2

    (sentences, by_w), (again, by_a) = pushed(1, 0), pushed(0, 1)
    ratio = (by_w + by_a / 12) * 4 / (1 - np.exp(-4))
    assert len(sentences) == count and sentences == again
    told = [float(re.search(r"at rest (\S+) times the right mean", text)[1]) for text in sentences] or [1.0]
    assert told == pytest.approx([ratio], rel=1e-5)


def test_kicks_that_blow_up_are_told():
    """The schemes of two kicks, such as gauss_dkdkd, are warned of beyond gamma h = 19; the last kick of other
    schemes is at the end of the step.
    """
    for scheme, z, is_told in (("gauss_dkdkd", 18.5, 0), ("gauss_dkdkd", 19.5, 1), ("gauss_dkdkd_strong2", 19.5, 1),
                               ("verlet_kdk", 30.0, 0), ("chin4a", 30.0, 0)):  # fmt: skip
        sentences, _ = doubts(lambda z=z, scheme=scheme: ss.simulate(FREE.damped(z), scheme=scheme, q0=0.0, p0=0.0,
                                                                     step=1.0, steps=1))  # fmt: skip
        assert len(sentences) == is_told, (scheme, z)
        assert all(f"too large for {scheme}, whose last kick comes 0.211" in text for text in sentences)
    with warnings.catch_warnings(), pytest.raises(errors.DoubtfulRunWarning, match="become large and opposite"):
        warnings.simplefilter("error", errors.DoubtfulRunWarning)
        ss.prepare(FREE.damped(25.0), "gauss_dkdkd", q0=0.0, p0=0.0, step=1.0)


def test_scenes_say_doubts_of_damping(tmp_path, capsys):
    """`symsde check` prints the doubts about damping."""
    file = tmp_path / "scene.toml"
    file.write_text(SCENE.format(damping="damping = 250.0"), encoding="utf-8")
    assert command_line.main(["check", str(file)]) == 0
    assert "warning    gamma*h = 25 of the damping is too large for gauss_dkdkd" in capsys.readouterr().out


@pytest.mark.parametrize("other", ["damping = 0.9", "damping = [0.8000001]", ""])
def test_a_folder_does_not_go_on_with_another_damping(other, tmp_path, capsys):
    """A folder refuses another damping by name, with both values; with the first damping the run goes on, and two parts
    of different damping do not merge."""
    first, second = (tmp_path / f"{name}.toml" for name in ("first", "second"))
    first.write_text(SCENE.format(damping="damping = 0.8"), encoding="utf-8")
    second.write_text(SCENE.format(damping=other), encoding="utf-8")

    def run(scene, part, out):
        return command_line.main(["run", str(scene), "--out", str(tmp_path / out), "--shard", part, "--shard-paths",
                                  "256", "--quiet"])  # fmt: skip

    assert run(first, "1/2", "out") == 0
    assert run(second, "2/2", "out") == command_line.BAD_INPUT
    told = capsys.readouterr().err
    assert "holds another run: " in told and "damping" in told and "0.8" in told
    assert run(second, "2/2", "other") == 0
    folders = [str(tmp_path / name) for name in ("out", "other")]
    assert command_line.main(["merge", *folders, "--out", str(tmp_path / "all"), "--quiet"]) == command_line.BAD_INPUT
    assert "hold parts of different runs: " in capsys.readouterr().err
    assert run(first, "2/2", "out") == 0


def test_orders_that_are_told_are_of_schemes_that_run():
    """`commutator` of damped models names no scheme that refuses them, and does not say that all flows commute."""
    noncommutative = ss.models.noncommutative_oscillator()
    for model in (WELL, ss.models.synchrotron(), ss.models.kubo(), noncommutative):
        found = ss.commutator(model.damped(RATE))
        assert not found.flows_commute and found.commutative == ss.commutator(model).commutative
        for scheme in set(re.findall(r"\b(?:midpoint|gauss)\w*", found.text)):
            if "dkdkd" not in scheme or model.traits.position_noise:
                assert ss.simulate(model.damped(RATE), scheme=scheme, **GIVEN).report.status == 0
    assert "3/2 from gauss_dkdkd, 2 from gauss_dkdkd_strong2" in ss.commutator(ss.models.synchrotron()).text
