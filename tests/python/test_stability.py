# SPDX-License-Identifier: BSD-3-Clause
"""Stiff and extreme cases, the quick sample: all criteria hold, and each fails where a fault is planted."""

import functools

import numpy as np
import pytest
from symsde import cli
from symsde.stability import SCENARIOS, failures, linear, noise, nonlinear, rounding


def test_every_criterion_holds(tmp_path, capsys):
    code = cli.main(["stability", "--quick", "--out", str(tmp_path), "--markdown", str(tmp_path / "page.md")])
    printed = capsys.readouterr().out
    assert "FAILED" not in printed
    assert code == 0
    text = (tmp_path / "page.md").read_text()
    for number in ("S07", "S08", "S09", "S10", "S11", "S12", "S14", "S15", "S16", "S17", "S18", "S20", "S21", "S22",
                   "S24", "S26", "S28"):  # fmt: skip
        assert f"## {number}:" in text
    assert (tmp_path / "figures" / "stability.png").read_bytes().startswith(b"\x89PNG")


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


FAULTS = [
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
    monkeypatch.setattr("symsde.stability.SCENARIOS", (linear.energy_input,))
    assert cli.main(["stability", "--quick", "--out", str(tmp_path)]) == 1
