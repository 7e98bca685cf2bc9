# SPDX-License-Identifier: BSD-3-Clause
"""Damped paths with angles beyond the range of inlined sines: their bits anywhere, and forces of the C library."""

import numpy as np
import pytest
import symsde as ss
from symsde.errors import FalseTraitError
from symsde.model.formulas import compiler, emit_flow

if compiler.command() is None:
    pytest.skip("no C compiler", allow_module_level=True)

pytestmark = [
    pytest.mark.usefixtures("quick_compiler"),
    pytest.mark.filterwarnings("ignore:increments of the drift:symsde.errors.DoubtfulRunWarning"),
]

PENDULUM = ss.model_from_sympy("p**2/2 - 1.3*cos(q)", noise=["0.4*sin(q)", "-0.3*q"])
TWO = ss.model_from_sympy("(p1**2 + p2**2)/2 - 1.3*cos(q1 - q2) - sin(q2)", noise=["0.4*sin(q1)", "0.2*cos(q2)"])
RING = ss.model_from_sympy(
    "Sum(p[i]**2/2 - cos(q[i])/2, i) - Sum(cos(q[i+1] - q[i]), i)", noise=["-0.4*sin(q[k])"], n=5, ends="periodic"
)
FORCED = ss.model_from_sympy("p**2/2 - cos(q)", noise=["0.4*sin(q)"], force="0.3*sin(3*q)", noise_force=["0.1*cos(q)"])
MODELS = {
    "formula": PENDULUM.damped(0.3),
    "built-in": ss.models.synchrotron().damped(0.3),
    "in time": ss.models.driven_pendulum().damped(0.3),
    "two": TWO.damped(0.3),
    "two rates": TWO.damped([0.2, 0.5]),
    "matrix": TWO.damped([[0.5, 0.1], [0.1, 0.4]]),
    "rate of the place": PENDULUM.damped("0.2 + 0.1*sin(q)"),
    "ring": RING.damped(0.3),
    "forces": FORCED.damped(0.3),
}
SCHEMES = ("symplectic_euler", "stormer_verlet", "lobatto2_swapped", "heun", "midpoint", "gauss2", "lobatto3",
           "gauss_dkdkd", "chin4a")  # fmt: skip
FAR = [(name, scheme) for name in MODELS for scheme in SCHEMES if scheme != "chin4a" or name != "rate of the place"]


def starts(ndof):
    """Angles that are near, beyond 1e5, where inlined sines end, on both sides of it, and beyond 1e16."""
    near, around, far = np.linspace(-2, 2, 17), -np.linspace(99999.7, 100000.3, 9), np.geomspace(1e4, 1e6, 9)
    q0 = np.random.default_rng(3).permutation([*near, *around, *far, *np.linspace(0.9e17, 1.1e17, 5)])
    return q0 * (1 + 0.1 * np.arange(ndof)[:, None])


@pytest.mark.parametrize(("name", "scheme"), FAR)
def test_far_paths_have_their_bits_anywhere(name, scheme):
    """In a block of 40, alone and in parts of it a path has the same bits, and the oracle's numbers to rounding."""
    model = MODELS[name]
    q0, run = starts(model.ndof), {"p0": 0.1, "step": 0.05, "steps": 6, "seed": 5, "scheme": scheme}
    whole = ss.simulate(model, q0=q0, paths=40, **run)
    assert np.isfinite(whole.p).all() and np.abs(whole.p[-1] - whole.p[0]).min(axis=0).max() > 0.01
    for a, b in ((0, 1), (7, 8), (20, 24), (3, 40), (33, 40), *((k, k + 1) for k in range(34, 40))):
        part = ss.simulate(model, q0=q0[:, a:b], paths=b - a, first_path=a, **run)
        np.testing.assert_array_equal(part.q, whole.q[:, :, a:b])
        np.testing.assert_array_equal(part.p, whole.p[:, :, a:b])
    if scheme not in ("gauss_dkdkd", "chin4a"):
        plain = ss.simulate(model, q0=q0, paths=40, **run, general=True)
        np.testing.assert_allclose(whole.p, plain.p, rtol=0, atol=1e-8)


GROWING = "p1**2/2 + p2**2/4 - 1.3*cos(q1 - q2) - sin(q2)", ["0.4*sin(q1)", "0.2*cos(q2)*q1"]


@pytest.mark.parametrize("q", [9e4, 1e6, 1e9])
@pytest.mark.parametrize("rate", [0.0, 0.3])
def test_steps_of_far_paths_are_not_called_false(rate, q):
    """Where the last digits of an angle move a force that grows with it, whole steps differ by rounding alone."""
    for scheme in ("stormer_verlet", "gauss_dkdkd", "chin4a"):
        model = ss.model_from_sympy(*GROWING).damped(rate)
        run = ss.simulate(model, q0=[q, 1.1 * q], p0=0.1, paths=1, step=0.05, steps=6, seed=5, scheme=scheme)
        assert run.report.stepper.startswith(f"whole steps of {scheme} by the model")


@pytest.mark.parametrize("q", [10.0, 9e4])
def test_false_steps_of_far_paths_are_refused(monkeypatch, q):
    """The twin: a drift that is one per cent too long is found beside roundings that large angles amplify."""
    whole, old = emit_flow._text, "drift_at(LANE_OF, s, 1, 0.5, far)"
    assert old in whole("steps")
    monkeypatch.setattr(emit_flow, "_text", lambda x: whole(x).replace(old, old.replace("1,", "1.01,")))
    with pytest.raises(FalseTraitError, match=r"the whole steps of scheme stormer_verlet .* are not those"):
        ss.simulate(ss.model_from_sympy(*GROWING), q0=[q, 1.1 * q], p0=0.1, step=0.05, steps=6, scheme="stormer_verlet")


@pytest.mark.parametrize("q", [0.3, 1e9, 1e17])
def test_derivatives_of_forces_are_compared_where_differences_tell(q):
    """Beyond 1e6 a difference of forces has no digits, and says nothing of derivatives; nearby it does."""
    given = {"force": lambda q, p, t: np.sin(3 * q)}
    right, wrong = (lambda q, p, t, k=k: (k * np.cos(3 * q)[None], 0 * q[None]) for k in (3, 3.03))
    run = {"q0": q, "p0": 0.1, "step": 0.05, "steps": 2, "scheme": "midpoint"}
    ss.simulate(ss.models.pendulum().forced(**given, force_derivative=right), **run)
    false = ss.models.pendulum().forced(**given, force_derivative=wrong)
    if q > 1:
        ss.simulate(false, **run)
    else:
        with pytest.raises(FalseTraitError, match="derivatives that differences refute"):
            ss.simulate(false, **run)
