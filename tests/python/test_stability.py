# SPDX-License-Identifier: BSD-3-Clause
"""Stiff and extreme cases, the quick sample: all criteria hold, and each fails for a planted fault."""

import contextlib
import functools
import math
import re

import numpy as np
import pytest
import symsde as ss
from symsde.answers import linear_stability
from symsde.cli import command_line
from symsde.show import look
from symsde.studies.expectations import Expectations
from symsde.studies.stability import (
    SCENARIOS,
    bifurcation,
    failures,
    limits,
    linear,
    long_time,
    noise,
    nonlinear,
    rounding,
    stability_page,
)


def test_every_criterion_holds(tmp_path, capsys):
    code = command_line.main(["stability", "--quick", "--out", str(tmp_path), "--markdown", str(tmp_path / "page.md")])
    printed = capsys.readouterr().out
    assert "FAILED" not in printed
    assert code == 0
    page, text = ((tmp_path / name).read_text() for name in ("page.md", "page-tables.md"))
    heads = [line for line in text.splitlines() if re.match(r"## \d", line)]
    assert [head.partition(".")[0] for head in heads] == [f"## {n}" for n in range(1, len(SCENARIOS) + 1)]
    begin = page.partition("<!-- end first")[0]
    assert [begin.count(f"| `{name}` | ") for name in limits.FIRST] == [1] * 5 and "![Growth of" in begin
    first, last = page.index("<!-- begin limits"), page.index("![Energy over a long time]")
    assert first < last and "verdict" not in page
    met = len(re.findall(r"\| ok \|$", text, re.MULTILINE))
    assert f"{met} of {met} expectations are met (quick sample)." in " ".join(text.split()) and "**FAILED**" not in text
    assert f"{met} expectations met, 0 failed" in printed
    for name in ("stability", "long-time"):
        assert (tmp_path / "figures" / f"{name}.png").read_bytes().startswith(b"\x89PNG")


@pytest.fixture(autouse=True)
def _nothing_remembered():
    """Clear remembered limits, so that a test with a fault and one without do not share them."""
    limits.stable_up_to.cache_clear()
    yield
    limits.stable_up_to.cache_clear()


def times(factor):
    return lambda real: lambda *arguments: factor * real(*arguments)


def options(**changed):
    """Replace options of the simulations of a scenario."""
    return lambda real: lambda model, **given: real(model, **{**given, **changed})


def with_huge_states_clipped(real):
    def simulate(model, **given):
        if np.ndim(given["q0"]) == 2:
            given["q0"] = np.clip(given["q0"], -1, 1)
        return real(model, **given)

    return simulate


def replaced(value):
    return lambda real: value


def lost_late():
    """A run that is not finite from t = 0.5 on."""
    return ss.Model(ndof=1, nnoise=0, gradient=lambda t, w, q, p: (w[0] * (q if t < 0.5 else np.nan * q), w[0] * p))


FAULTS = [
    (limits.stability_limits, linear_stability, "step_matrix", lambda real: lambda scheme, x: real(scheme, 1.001 * x)),
    (limits.stability_limits, limits, "rate", times(1.05)),
    (limits.stability_limits, linear_stability, "is_stable", replaced(lambda matrix: bool(np.abs(matrix).max() < 2))),
    (limits.stability_limits, limits, "sizes", lambda real: lambda scheme, x, **n: real("heun", x, **n)),
    (bifurcation.bifurcations, bifurcation, "trace_of_cycle", times(1.01)),
    (bifurcation.bifurcations, bifurcation, "cycle_of_kicks", lambda real: lambda name, x: real(name, 1.001 * x)),
    (
        bifurcation.bifurcations,
        bifurcation,
        "others",
        lambda real: lambda name, scheme, x: real(name, scheme.replace("midpoint", "gauss_dkdkd"), x),
    ),
    (bifurcation.bifurcations, bifurcation, "ROOM", replaced(0.75)),
    (bifurcation.bifurcations, bifurcation, "lost", replaced(lambda scheme, part: [])),
    (
        bifurcation.bifurcations,
        bifurcation,
        "fixed_points",
        lambda real: lambda *given, step, **more: real(*given, step=1.02 * step, **more),
    ),
    (long_time.long_time, long_time, "CONTRASTS", replaced(())),
    (long_time.long_time, long_time, "energy_change", lambda real: lambda scheme, n: real("heun", n)),
    (long_time.long_time, long_time, "energy_change", lambda real: lambda scheme, n: real("midpoint", n)),
    (long_time.long_time, long_time, "kubo_change", lambda real: lambda scheme, n: real("heun", n)),
    (long_time.long_time, long_time, "kubo_change", lambda real: lambda scheme, n: real("midpoint", n)),
    (linear.fast_mode, linear, "simulate", options(scheme="stormer_verlet")),
    (linear.energy_input, linear, "midpoint_factor", times(1.01)),
    (linear.euler_limit, linear, "euler_factor", times(1.01)),
    (linear.euler_limit, linear, "overflow_step", lambda real: lambda *given: real(*given) + 1),
    (
        linear.resonances,
        linear,
        "simulate",
        lambda real: lambda model, **given: real(model, **{**given, "scheme": "heun"}),
    ),
    (nonlinear.quartic_steps, nonlinear, "MOST", replaced(40)),
    (nonlinear.quartic_steps, nonlinear, "residual", lambda real: lambda q0, h, q, p: real(q0, 1.01 * h, q, p)),
    (nonlinear.several_roots, nonlinear, "says", lambda real: lambda report, text: real(report, "under-resolved")),
    (
        noise.stiff_multiplicative,
        noise,
        "noisy_spring",
        lambda real: lambda stiffness, sigma: real(1.01 * stiffness, sigma),
    ),
    (noise.no_noise, noise, "STILL", replaced(1e-13)),
    (noise.vanishing_noise, noise, "TINY", replaced((1e-11,))),
    (noise.squeezing, noise, "sign_probability", times(1.1)),
    (noise.squeezing, noise, "simulate", options(truncation=None)),
    (noise.truncation, noise, "lost_variance", times(1.01)),
    (noise.truncation, noise, "REFUSED", replaced((0.09,))),
    (rounding.invariant_drift, rounding, "RULES", replaced({"Newton, plain": {"fixed_point": 4}})),
    (rounding.nonlinear_drift, rounding, "simulate", options(fixed_point=4)),
    (rounding.tiny_steps, rounding, "simulate", options(step=1.01e-16)),
    (rounding.round_trip, rounding, "simulate", options(scheme="heun")),
    (failures.overflow, failures, "simulate", with_huge_states_clipped),
    (failures.callbacks, failures, "labelled", lambda real: lambda fault, first: real(fault, first + 0.01)),
    (failures.singular_matrices, failures, "chain_of", lambda real: lambda n, nan_after=0: real(n)),
    (failures.singular_matrices, failures, "inverted", replaced(lambda *_: lost_late())),
]


@pytest.mark.parametrize(("scenario", "module", "name", "fault"), FAULTS)
@pytest.mark.filterwarnings("ignore:.*encountered.*:RuntimeWarning")
def test_a_planted_fault_fails(scenario, module, name, fault, monkeypatch):
    monkeypatch.setattr(module, name, fault(getattr(module, name)))
    assert not all(check.passed for check in scenario(True).checks)


def test_every_scenario_has_a_planted_fault():
    assert {fault[0] for fault in FAULTS} == set(SCENARIOS)


def test_a_failed_criterion_is_the_exit_code(tmp_path, monkeypatch):
    monkeypatch.setattr(linear, "midpoint_factor", functools.partial(lambda x: 1.01))
    monkeypatch.setattr("symsde.studies.stability.SCENARIOS", (linear.energy_input,))
    assert command_line.main(["stability", "--quick", "--out", str(tmp_path)]) == 1


SYMPLECTIC_EULER = np.log(np.roots([1, 2.2**2 - 2, 1]) ** 2).max() / 2  # eigenvalues of trace 2 - x^2 at x = 2.2
LIMITS = [  # scheme, omega h where it grows, log of the growth there, omega h where it is stable again
    ("midpoint", math.inf, math.inf, 0.0, math.inf),
    ("gauss_dkdkd_rotation", math.inf, math.inf, 0.0, math.inf),
    ("gauss_dkdkd_midpoint", math.inf, math.inf, 0.0, math.inf),
    ("verlet_kdk_midpoint", math.inf, math.inf, 0.0, math.inf),
    ("verlet_dkd_weak2", 2.0, 2.2, SYMPLECTIC_EULER, math.inf),
    ("stormer_verlet", 2.0, 2.2, SYMPLECTIC_EULER, math.inf),
    ("symplectic_euler_adjoint", 2.0, 2.2, SYMPLECTIC_EULER, math.inf),
    ("lobatto3", math.sqrt(8), 1.1 * math.sqrt(8), None, math.inf),
    ("heun", 0.0, 0.1, math.log(1 + 0.1**4 / 4) / 2, math.inf),
    ("euler_maruyama", 0.0, 0.1, math.log(1 + 0.1**2) / 2, math.inf),
]


@pytest.mark.parametrize(("scheme", "omega_h", "beyond", "rate", "again"), LIMITS)
def test_limits_are_those_by_hand(scheme, omega_h, beyond, rate, again):
    found = limits.limit(scheme)
    assert found.omega_h == pytest.approx(omega_h, rel=2e-6) and found.again == again
    assert found.beyond == pytest.approx(beyond, rel=1e-5)
    if rate is not None:
        assert found.rate == pytest.approx(rate, rel=1e-4, abs=1e-12)


def test_a_window_of_instability_ends():
    """Lobatto's quadrature with four nodes is unstable in a narrow window alone; traces on both sides are known."""
    found = limits.limit("lobatto4")
    assert found.omega_h < found.beyond < found.again < 1.1 * found.omega_h
    traces = [np.trace(limits.step_matrix("lobatto4", x)) for x in (0.999 * found.omega_h, found.beyond, found.again)]
    assert abs(traces[0]) < 2 < abs(traces[1]) and abs(traces[2]) <= 2


def test_the_first_table():
    found = [limits.Limit("midpoint", math.inf, math.inf, 0.0), limits.Limit("midpoint_areas", math.inf, math.inf, 0.0)]
    found += [limits.Limit("lobatto4", 3.1131, 3.14, 0.025, 3.16), limits.Limit("heun", 0.0, 0.1, 1.2e-5)]
    turn = 2 * math.atan(1.5)
    assert limits.table(found) == [
        ["`midpoint`, `midpoint_areas`", "yes", "every step",
         f"nothing blows up; at omega h = 3 a step turns by {turn:.2f} in place of 3.00"],
        ["`lobatto4`", "yes", "3.113", "n steps grow by exp(0.025 n) at omega h = 3.14; stable again from 3.16"],
        ["`heun`", "no", "no step", "n steps grow by exp(1.2e-05 n) at omega h = 0.1"],
    ]  # fmt: skip


def test_the_long_time_figure(tmp_path, monkeypatch):
    """Curves are those of the scenario, in the colours of their schemes."""
    curves = long_time.long_time(True).curves
    kept = {}
    real = look.panels

    @contextlib.contextmanager
    def panels(*arguments, **options):
        with real(*arguments, **options) as axes:
            yield axes
            kept.update(axes)

    monkeypatch.setattr(look, "panels", panels)
    long_time.save(tmp_path / "x.png", curves)
    for axis, time, prefix in (("energy", "t", ""), ("kubo", "kubo_t", "kubo_")):
        drawn, _ = kept[axis].get_legend_handles_labels()  # crosses have no legend entry
        for line, scheme in zip(drawn, long_time.SCHEMES, strict=True):
            change = curves[prefix + scheme]
            assert line.get_color() == look.colour(scheme) and line.get_label() == scheme
            np.testing.assert_allclose(line.get_xdata(), curves[time][change < 1e3])
            np.testing.assert_allclose(line.get_ydata(), np.maximum(change[change < 1e3], 1e-17))


def test_what_failed_is_said_with_its_cause(tmp_path, monkeypatch):
    monkeypatch.setattr(stability_page.stability_figure, "save", lambda *_: None)
    good, bad = Expectations("good", "Good"), Expectations("bad", "Bad", if_failed="A known cause.")
    good.same("one", "first", 1, 1)
    bad.same("two", "second", 3, 4)
    stability_page.write(tmp_path / "page.md", [good, bad], False)
    text = (tmp_path / "page-tables.md").read_text()
    assert "1 of 2 expectations are met" in text and "(quick" not in text and f"symsde {ss.__version__}" in text
    assert text.index("## 1. Good") < text.index("## 2. Bad") < text.index("A known cause.")
