# SPDX-License-Identifier: BSD-3-Clause
"""Generated whole steps: equal to the general stepper to ulps, the same bits in blocks, statuses, twins."""

import platform
import re
import subprocess
import warnings

import numpy as np
import pytest
import symsde as ss
from symsde import errors

pytest.importorskip("sympy")

from symsde.model.formulas import compiler, emit_flow

if compiler.command() is None:
    pytest.skip("no C compiler", allow_module_level=True)

pytestmark = pytest.mark.optimised

ALL = ("symplectic_euler", "symplectic_euler_adjoint", "stormer_verlet", "midpoint", "gauss2")
ONE_SOLVE = ALL[:4]  #: q and p meet in products of both alone
KINETIC = "(p1**2 + p2**2 + p3**2)/2"
NOISES = ["b*q2*p1 - q2", "b*p1*p3"]
MODELS = {  # H, noises, schemes with generated steps
    "kubo": ("a*(p**2 + q**2)/2", ["b*(p**2 + q**2)/2"], ALL),
    "mixed": ("p**2/2 + a*q*p + q**2/2", ["b*q*p"], ONE_SOLVE),
    "shaken": ("p**2/2 + a*q*p + q**2/2 + a*q", ["b*q*p", "b*p - q"], ONE_SOLVE),
    "pushed in both": ("p**2/2 + p + q**2 + a*q", ["p + q"], ALL),
    "pushed": ("p**2 + q**2/2", ["b*p", "a*q"], ALL),
    "magnetic": ("(p - a*q**2)**2/2 + cos(q)", ["b*q*p"], ALL[3:4]),
    "pendulum": ("p**2/2 - cos(q)", ["b*(p**2 + q**2)/2"], ALL),
    "relativistic": ("(1 + p**2)**a + a*cosh(q)", ["b*sin(q)", "b*p"], ALL),
    "one equation": ("p**2/2 - a*cos(q)", ["b*sin(q)"], ALL),
    "several": ("(p1**2 + a*p1*p2 + p2**2)/2 + q1**2*q2 + q1**2 + q2**2", ["b*q1", "b*p2**2"], ALL),
    "three": (f"{KINETIC} + exp(q1 - q2) + exp(q2 - q3) + exp(q3 - q1)", ["b*q1*q2"], ALL),
    "field": ("((p1 + a*q2)**2 + (p2 - a*q1)**2)/2 + cos(q1) + q2**4", ["b*q1", "b*sin(q2)"], ONE_SOLVE),
    "frame": ("(p1**2 + p2**2)/2 + a*(q1*p2 - q2*p1) + q1**2 + p1*q1", ["b*q1*p2", "b*q2**2"], ONE_SOLVE),
    "sheared": (f"{KINETIC} + p2**4 + a*(q1*p2 + 2*q3*p1) + q1**4 + q2**2 + 2*q3**2", NOISES, ONE_SOLVE),
    "curved": ("((p1 + a*q2**2)**2 + (p2 - q1)**2)/2 + q1**4", ["b*q1", "b*cos(q2)"], ALL[3:4]),
    "two angles": ("(p1**2 + p2**2)/2 - cos(q1) - a*cos(q2 - q1)", ["b*sin(q1)"], ALL),
}
PARAMS = {"a": 0.7, "b": 0.3}
RUN = {"q0": 0.4, "p0": 0.3, "step": 0.05, "seed": 5, "correction": "none"}


def model(name: str, **values: float) -> ss.Model:
    H, noise, _ = MODELS[name]
    return ss.model_from_sympy(H, noise, params={**PARAMS, **values})


FURTHER = {name: emit_flow.FURTHER["stormer_verlet" not in schemes :] for name, (*_, schemes) in MODELS.items()}
CASES = [(name, scheme) for name, (*_, schemes) in MODELS.items() for scheme in (*schemes, *FURTHER[name])]


@pytest.mark.parametrize(("name", "scheme"), CASES)
def test_steps_are_those_of_the_general_stepper(name, scheme):
    """Generated steps equal the general stepper's to rounding after 37 steps of 85 paths; single paths, small blocks
    and single steps have the same bits.
    """
    mine = model(name)
    run = ss.simulate(mine, scheme=scheme, **RUN, steps=37, paths=85)
    assert run.report.stepper == f"whole steps of {scheme} by the model"
    plain = ss.simulate(mine, scheme=scheme, **RUN, steps=37, paths=85, general=True)
    for x, y in ((run.q, plain.q), (run.p, plain.p)):
        np.testing.assert_allclose(x, y, rtol=0, atol=30 * np.spacing(np.abs(y).max()))
    alone = ss.simulate(mine, scheme=scheme, **RUN, steps=37, paths=1, first_path=84)
    np.testing.assert_array_equal(alone.q[:, :, 0], run.q[:, :, 84])
    other = ss.simulate(mine, scheme=scheme, **RUN, steps=37, paths=85, save_every=37, lanes=16, threads=2)
    np.testing.assert_array_equal(other.p[-1], run.p[-1])


CLOSED = {name for name, (*_, schemes) in MODELS.items() if schemes == ONE_SOLVE}  #: explicit steps, closed alone
BY_THEMSELVES = [x for x in CASES if x[0] not in CLOSED or x[1] in ("midpoint", "heun")]
DAMPED = [x for x in BY_THEMSELVES if x[0] not in ("mixed", "pushed", "magnetic", "one equation", "three")]


@pytest.mark.parametrize(("name", "scheme"), DAMPED)
@pytest.mark.filterwarnings("ignore:gamma\\*h = 0.4:symsde.errors.DoubtfulRunWarning")
def test_damped_steps_are_those_of_the_general_stepper(name, scheme):
    """Whole steps decay by themselves, in blocks, alone and one by one, with z = gamma h = .4."""
    run = {**RUN, "scheme": scheme, "steps": 37}
    mine = model(name).damped(8.0)
    whole, plain = (ss.simulate(mine, **run, paths=85, general=g) for g in (False, True))
    assert whole.report.stepper == f"whole steps of {scheme} by the model, damped"
    for x, y in ((whole.q, plain.q), (whole.p, plain.p)):
        np.testing.assert_allclose(x, y, rtol=0, atol=30 * np.spacing(np.abs(y).max()))
    alone = ss.simulate(mine, **run, paths=1, first_path=84)
    np.testing.assert_array_equal(alone.q[:, :, 0], whole.q[:, :, 84])
    other = ss.simulate(mine, **run, paths=85, save_every=37, lanes=16, threads=2)
    np.testing.assert_array_equal(other.p[-1], whole.p[-1])


@pytest.mark.parametrize("rates", [(2.0, 2.0), (2.0, 3.0)])
@pytest.mark.parametrize("scheme", ["midpoint", "gauss2"])
def test_unequal_rates_take_steps_between_decays_or_decaying_tableaux(rates, scheme):
    """Whole steps take one rate only; the code of damped steps serves all values of parameters and of rates."""
    mine = model("several").damped(rates).with_parameters(b=0.1)
    run = {**RUN, "scheme": scheme, "steps": 9}
    whole, plain = (ss.simulate(mine, **run, paths=9, general=g) for g in (False, True))
    by_model = whole.report.stepper == f"whole steps of {scheme} by the model, damped"
    assert by_model == (scheme == "midpoint" or rates[0] == rates[1])
    np.testing.assert_allclose(whole.p, plain.p, rtol=0, atol=1e-14)


def test_closed_formulas_compile_no_damped_steps(tmp_path, monkeypatch):
    """Damped steps are a file of their own, compiled with the first damped model and for all rates."""
    monkeypatch.setenv("SYMSDE_CACHE", str(tmp_path))
    closed = ss.model_from_sympy("p**2/2 + q**2", ["0.125*q"])
    assert len(list(tmp_path.glob("**/*.so"))) == 1
    for rate in (0.5, 0.25):
        damped = closed.damped(rate)
        assert len(list(tmp_path.glob("**/*.so"))) == 2
    assert damped.damped(0.0).formula is closed.formula


@pytest.mark.parametrize("save_every", [40, 160])
@pytest.mark.parametrize("name", ["kubo", "pushed", "pendulum"])
def test_a_path_alone_goes_on_with_the_noise_of_its_steps(name, save_every):
    """Runs have more steps than are drawn at once, and saved points at any place among these steps."""
    run = {**RUN, "scheme": "midpoint", "steps": 320, "save_every": save_every}
    alone, three = (ss.simulate(model(name), **run, paths=n) for n in (1, 3))
    np.testing.assert_array_equal(alone.q[:, :, 0], three.q[:, :, 0])
    np.testing.assert_array_equal(alone.p[:, :, 0], three.p[:, :, 0])


CORRECTED = {  # H, noises, schemes of the pair whose corrected steps are generated
    "kubo": (*MODELS["kubo"][:2], ALL[:2]),
    "pendulum": (*MODELS["pendulum"][:2], ALL[:2]),
    "in two noises": ("p**2/2 + q**4", ["b*p**2/2", "b*q**2/2"], ALL[:2]),
    "pushed": ("p**2/2 + cos(q)", ["b*(p**2/2 + q**2/2 + p - a*q)"], ALL[:2]),
    "two": ("(p1**2 + p2**2)/2 + q1**2 + q2**4", ["b*(p1*p2 + q1**2 + 2*q1*q2 + p1)", "b*p2**2 - q2"], ALL[:2]),
    "slopes of sines": ("(p1**2 + p2**2)/2 + q1**2", ["b*sin(q1 - q2)", "b*(p1 + p1*p2)"], ALL[:1]),
    "relativistic": (*MODELS["relativistic"][:2], ALL[:1]),
    "light": ("sqrt(1 + p**2) + q**2", ["b*(sqrt(1 + p**2) + q**2)"], ALL[1:2]),
    "both": ("p**2/2 + q**2", ["b*(p**4 + q**4)"], ()),
    "other components": (*MODELS["several"][:2], ()),
}


def corrected(name: str) -> tuple[ss.Model, tuple[str, ...]]:
    H, noise, schemes = CORRECTED[name]
    return ss.model_from_sympy(H, noise, params={k: v for k, v in PARAMS.items() if k in H + "".join(noise)}), schemes


@pytest.mark.parametrize("name", CORRECTED)
def test_corrected_steps_are_those_of_the_general_stepper(name):
    """The corrected Euler pair is generated if the end of a step is explicit, and not for other noises."""
    mine, schemes = corrected(name)
    run = {**RUN, "correction": "auto", "steps": 37}
    for scheme in ALL[:2]:
        whole, plain = (ss.simulate(mine, scheme=scheme, **run, paths=85, general=g) for g in (False, True))
        assert (whole.report.stepper == f"whole corrected steps of {scheme} by the model") == (scheme in schemes)
        for x, y in ((whole.q, plain.q), (whole.p, plain.p)):
            np.testing.assert_allclose(x, y, rtol=0, atol=60 * np.spacing(np.abs(y).max()))
        alone = ss.simulate(mine, scheme=scheme, **run, paths=1, first_path=84)
        np.testing.assert_array_equal(alone.q[:, :, 0], whole.q[:, :, 84])
        none = ss.simulate(mine, scheme=scheme, **{**run, "correction": "none"}, paths=85)
        assert scheme not in schemes or np.abs(none.q - whole.q).max() > 1e-4


@pytest.mark.parametrize("name", CORRECTED)
@pytest.mark.usefixtures("quick_compiler")
def test_damped_corrected_steps_are_those_of_the_general_stepper(name):
    """The same with damping, in all lanes."""
    closed, schemes = corrected(name)
    run = {**RUN, "correction": "auto", "steps": 37, "paths": 85}
    for scheme in ALL[:2]:
        whole, plain = (ss.simulate(closed.damped(8.0), scheme=scheme, **run, general=g) for g in (False, True))
        assert whole.report.stepper.startswith("whole corrected steps of ") == (scheme in schemes)
        for x, y in ((whole.q, plain.q), (whole.p, plain.p)):
            np.testing.assert_allclose(x, y, rtol=0, atol=60 * np.spacing(np.abs(y).max()))


@pytest.mark.parametrize("scheme", ALL[:2])
@pytest.mark.usefixtures("quick_compiler")
def test_wrong_corrections_are_refused(monkeypatch, scheme):
    """The twin: a correction one per cent off."""
    whole = emit_flow._text
    assert "0.5 * a[" in whole("corrected")
    monkeypatch.setattr(emit_flow, "_text", lambda x: whole(x).replace("0.5 * a[", "0.505 * a["))
    with pytest.raises(errors.FalseTraitError, match=f"the whole steps of scheme {scheme} .* are not those"):
        ss.simulate(model("kubo"), scheme=scheme, **{**RUN, "correction": "auto"}, steps=3)


KICKED = {  # H, noises, whether the mass is constant and noise is in position
    "well": ("p**2/2 + q**4/4 - a*q**2/2", ["b*q"], True),
    "two noises": ("p**2/3 + q**4/4", ["b*q", "a*q**2/2"], True),
    "angle": ("p**2/2 - a*cos(q)", ["b*sin(q)"], True),
    "coupled": ("(p1**2 + a*p1*p2 + p2**2)/2 + q1**2*q2 + q1**2 + q2**2", ["b*q1*q2", "q2", "b*q1**3"], True),
    "of three": (f"{KINETIC} + exp(q1 - q2) + exp(q2 - q3) + exp(q3 - q1)", ["b*q1*q2"], True),
    "in momenta": ("p**2/2 + cos(q)", ["b*p"], False),
    "closed": ("p**2/2 + cos(q)", [], False),
}
KICKS = [(name, scheme) for name, (*_, has_kicks) in KICKED.items() if has_kicks for scheme in emit_flow.KICKS]


def kicked(name: str) -> ss.Model:
    H, noise, _ = KICKED[name]
    return ss.model_from_sympy(H, noise, params=PARAMS)


@pytest.mark.parametrize("scheme", emit_flow.KICKS)
@pytest.mark.usefixtures("quick_compiler")
def test_kicks_of_silent_noises(scheme):
    """For noises of strength zero nothing is drawn, and whole steps by a model read what is drawn."""
    silent = kicked("well").with_parameters(b=0.0)
    closed = ss.model_from_sympy(KICKED["well"][0], params={"a": PARAMS["a"]})
    for paths in (1, 3):
        ours, plain = (ss.simulate(x, **RUN, scheme=scheme, steps=20, paths=paths) for x in (silent, closed))
        np.testing.assert_allclose(ours.q, plain.q, rtol=0, atol=1e-13)


@pytest.mark.parametrize("rate", [0.0, 8.0, -1.0])
@pytest.mark.parametrize(("name", "scheme"), KICKS)
def test_kicks_are_those_of_the_general_stepper(name, scheme, rate):
    """Closed and damped: equal to rounding, with the bits of blocks in single paths, small blocks and single steps."""
    mine = kicked(name).damped(rate, allow_gain=True)
    run = {**RUN, "scheme": scheme, "steps": 130}
    whole, plain = (ss.simulate(mine, **run, paths=131, general=g) for g in (False, True))
    name = f"whole steps of {scheme} by the model" + (", damped" if rate else "")
    assert whole.report.stepper == name
    for x, y in ((whole.q[:38], plain.q[:38]), (whole.p[:38], plain.p[:38])):
        np.testing.assert_allclose(x, y, rtol=0, atol=60 * np.spacing(np.abs(y).max()))
    for paths, first, how in (
        (1, 130, {}),
        (1, 0, {"save_every": 65}),
        (3, 128, {"save_every": 13}),
        (20, 100, {"lanes": 8}),
    ):
        other = ss.simulate(mine, **run, paths=paths, first_path=first, **how)
        np.testing.assert_array_equal(other.q[-1], whole.q[-1, :, first : first + paths])
        np.testing.assert_array_equal(other.p[-1], whole.p[-1, :, first : first + paths])


@pytest.mark.parametrize("name", [name for name, (*_, has_kicks) in KICKED.items() if has_kicks])
def test_one_kick_between_drifts(name):
    """The step of another scheme, by increments of three points; none where drifts turn by a quadratic part."""
    mine, run = kicked(name), {**RUN, "scheme": "verlet_dkd_weak2", "steps": 37}
    whole, plain = (ss.simulate(mine, **run, paths=20, general=g) for g in (False, True))
    assert whole.report.stepper == "whole steps of verlet_dkd_weak2 by the model"
    for x, y in ((whole.q, plain.q), (whole.p, plain.p)):
        np.testing.assert_allclose(x, y, rtol=0, atol=30 * np.spacing(np.abs(y).max()))
    alone = ss.simulate(mine, **run, paths=1, first_path=19)
    np.testing.assert_array_equal(alone.q[:, :, 0], whole.q[:, :, 19])


@pytest.mark.parametrize("scheme", emit_flow.KICKS)
@pytest.mark.usefixtures("quick_compiler")
def test_linear_noises_leave_no_products(scheme):
    """A scheme that samples products of noises takes the steps of the one that does not, if there are none."""
    run = {**RUN, "scheme": f"{scheme}_strong2", "steps": 37, "paths": 20}
    for noise, has_steps in (("b*q", True), ("b*q**2", False)):
        mine = ss.model_from_sympy("p**2/2 + q**4/4", [noise], params={"b": 0.3})
        whole, plain = (ss.simulate(mine, **run, general=g) for g in (False, True))
        assert ("whole steps" in whole.report.stepper) == has_steps
        np.testing.assert_allclose(whole.q, plain.q, rtol=0, atol=60 * np.spacing(1.0))


@pytest.mark.usefixtures("quick_compiler")
def test_one_kick_between_rotations_is_no_drift():
    H, noise, _ = KICKED["well"]
    split = ss.model_from_sympy(f"{H} + 2*q**2", noise, params=PARAMS, split="p**2/2 + 2*q**2")
    steps = ss.simulate(split, **RUN, scheme="verlet_dkd_weak2", steps=3).report.stepper
    assert steps == "kicks between flows of a quadratic part"


@pytest.mark.parametrize("name", KICKED)
def test_which_kicks_are_generated(name):
    """Not with noise in momenta, nor without noise."""
    source = kicked(name).formula.source
    assert [f"formula_flow_{s}(" in source for s in emit_flow.KICKS] == [KICKED[name][-1]] * len(emit_flow.KICKS)


CHANGES = {  # of the text of kicks, by one per cent, and who has them
    ("{0.5, 0.5, 1.73", "{0.5, 0.5, 1.75"): ("angle", "gauss_dkdkd", 0.0),
    ("{0.5, 0.5, 1, ", "{0.5, 0.5, 1.01, "): ("well", "verlet_kdk", 0.0),
    ("0.211324", "0.213324"): ("angle", "gauss_dkdkd", 0.0),
    ("FMA(-8, b, ", "FMA(-8.1, b, "): ("well", "chin4a", 0.0),
    ("(1 / 36.0) * k", "(1 / 36.4) * k"): ("coupled", "chin4a", 0.0),
    ("FMA(law[6 + j], b", "FMA(1.01 * law[6 + j], b"): ("well", "chin4a", 8.0),
    ("s, 1 / 15.0, far", "s, 1 / 15.2, far"): ("two noises", "chin4a", 0.0),
    ("s, 1 / 12.0, far", "s, 1 / 12.1, far"): ("two noises", "verlet_kdk", 8.0),
    ("kick_at(LANE_OF, s, 1, 0.5, far)", "kick_at(LANE_OF, s, 1.01, 0.5, far)"): ("well", "lobatto2_swapped", 0.0),
    ("FMA(0.5, v[k] + u[k]", "FMA(0.505, v[k] + u[k]"): ("angle", "heun", 0.0),
    ("FMA(0.5, fade.whole, 1)", "FMA(0.505, fade.whole, 1)"): ("well", "lobatto2_swapped", 8.0),
    ("f[k] = FMA(fade.whole, f[k]", "f[k] = FMA(1.01 * fade.whole, f[k]"): ("angle", "heun", 8.0),
    ("-0.5 * dw", "-0.505 * dw"): ("angle", "gauss_dkdkd", 8.0),
    ("-f.leg[i] / z", "-1.01 * f.leg[i] / z"): ("angle", "gauss_dkdkd", 8.0),
    (", lost[2], lost[3]}", ", 1.01 * lost[2], lost[3]}"): ("well", "verlet_kdk", 8.0),
}


@pytest.mark.parametrize("change", CHANGES, ids=lambda x: x[0])
@pytest.mark.usefixtures("quick_compiler")
def test_wrong_kicks_are_refused(monkeypatch, change):
    """The twin: coefficients one per cent off."""
    name, scheme, rate = CHANGES[change]
    source = emit_flow.source
    monkeypatch.setattr(emit_flow, "source", lambda made, **how: source(made, **how).replace(*change))
    mine = kicked(name).damped(rate)
    with pytest.raises(errors.FalseTraitError, match=f"the whole steps of scheme {scheme} .* are not those"):
        ss.simulate(mine, scheme=scheme, **RUN, steps=3)


LOSSES = {  # text of the damped steps, what makes it wrong by one per cent, and the schemes that it decays in
    ("0.5 * part, fade.whole", "0.505 * part, fade.whole"): ("stormer_verlet",),
    (".whole = lost[2]", ".whole = 1.01 * lost[2]"): (*ALL[:3], "gauss2", "lobatto2_swapped", "heun"),
    (".half = lost[3]", ".half = 1.01 * lost[3]"): ("midpoint",),
    (".d = {lost[0]", ".d = {1.01 * lost[0]"): ("gauss2",),
    ("f.b[i] = 0.5", "f.b[i] = 0.505"): ("gauss2",),
    ("gauss2_a[1][0] * left[1]", "1.01 * gauss2_a[1][0] * left[1]"): ("gauss2",),
}


@pytest.mark.parametrize("change", LOSSES, ids=lambda x: x[0])
@pytest.mark.parametrize("name", ["kubo", "pendulum", "several"])
@pytest.mark.usefixtures("quick_compiler")
def test_wrong_losses_are_refused(monkeypatch, name, change):
    """Damped steps whose loss of momentum is one per cent off are refused."""
    source = emit_flow.source

    def changed(made, **how):
        whole = source(made, **how)
        assert (change[0] in whole) == how.get("damped", False)
        return whole.replace(*change)

    monkeypatch.setattr(emit_flow, "source", changed)
    mine = model(name).damped(4.0)
    for scheme in LOSSES[change]:
        with pytest.raises(errors.FalseTraitError, match=f"the whole steps of scheme {scheme} .* are not those"):
            ss.simulate(mine, scheme=scheme, **RUN, steps=3)


COUPLINGS = {  # text of steps where q and p meet, the same one per cent off, and who has them
    ("FMA(ab, hqp", "FMA(1.01 * ab, hqp"): ("field", ALL[:3]),
    ("drift_at(LANE_OF, s, 1, 0.5", "drift_at(LANE_OF, s, 1, 0.505"): ("sheared", ["stormer_verlet"]),
    ("fall_at(LANE_OF, s, 0.5, 1,", "fall_at(LANE_OF, s, 0.505, 1,"): ("field", ["stormer_verlet"]),
    ("drift_at(LANE_OF, s, 0.5, 1,", "drift_at(LANE_OF, s, 0.5, 1.01,"): ("shaken", ["lobatto2_swapped"]),
    ("drift_at(LANE_OF, s, 1, 1,", "drift_at(LANE_OF, s, 1, 1.01,"): ("frame", ["symplectic_euler_adjoint"]),
    ("i * down + j * across", "j * down + i * across"): ("sheared", ALL[:3]),  # the other matrix
    ("FMA(0.5, hqp[k * DOF + i]", "FMA(0.505, hqp[k * DOF + i]"): ("frame", ["midpoint"]),
    ("FMA(-0.5, hqp[i * DOF + k]", "FMA(-0.505, hqp[i * DOF + k]"): ("frame", ["midpoint"]),
}


@pytest.mark.parametrize("change", COUPLINGS, ids=lambda x: x[0])
@pytest.mark.usefixtures("quick_compiler")
def test_wrong_couplings_are_refused(monkeypatch, change):
    """The twin of the steps of models whose q and p meet."""
    name, schemes = COUPLINGS[change]
    source = emit_flow.source
    monkeypatch.setattr(emit_flow, "source", lambda made, **how: source(made, **how).replace(*change))
    mine = model(name)
    assert change[1] in mine.formula.source
    for scheme in schemes:
        with pytest.raises(errors.FalseTraitError, match=f"the whole steps of scheme {scheme} .* are not those"):
            ss.simulate(mine, scheme=scheme, **RUN, steps=3)


@pytest.mark.parametrize("name", MODELS)
def test_what_is_generated(name):
    schemes = (*MODELS[name][-1], *FURTHER[name])
    mine = model(name)
    assert tuple(s for s in (*ALL, *emit_flow.FURTHER) if f"formula_flow_{s}(" in mine.formula.source) == schemes


@pytest.mark.parametrize("H", ["p**2/2 + q**2*cos(t)/2", "+".join(f"p{i}**2*q{i}" for i in range(1, 6))])
def test_time_and_many_coordinates_have_none(H):
    mine = ss.model_from_sympy(H)
    assert "formula_flow" not in mine.formula.source


@pytest.mark.parametrize("name", ["kubo", "pendulum", "relativistic", "several"])
def test_loops_over_lanes_become_vectors(name, tmp_path):
    """A scalar loop would be right, but several times slower: gcc's report, line by line, must call loops
    vectorised.
    """
    version = subprocess.run([*compiler.command(), "--version"], capture_output=True, text=True, check=True).stdout
    if platform.machine() != "x86_64" or "Free Software Foundation" not in version:
        pytest.skip("the report is of gcc on x86-64")
    source = model(name).formula.source
    (tmp_path / "formula.c").write_text(source)
    words = [
        *compiler.command(),
        *compiler.FLAGS,
        "-fopt-info-vec",
        "-fopt-info-vec-missed",
        "-dx",  # stop after vectorisation
        "-S",
        "formula.c",
    ]
    told = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=True).stderr
    vectors = {int(line.split(":")[1]) for line in told.splitlines() if "loop vectorized" in line}
    left = {int(line.split(":")[1]) for line in told.splitlines() if "couldn't vectorize loop" in line}
    function, loops = "", {}
    for number, line in enumerate(source.splitlines(), 1):
        if begin := re.match(r"(?:INLINE|LANE \w+) (\w+_(?:in_lanes|derivatives|corrections|sweeps))\(", line):
            function = begin[1]
        elif line.startswith("   for (int i = 0; i < lanes;") and function:
            loops[function], function = number, ""
    wanted = {f"{scheme}_in_lanes" for scheme in (*ALL[:3], *emit_flow.FURTHER)}
    wanted |= {f"{scheme}_corrected_in_lanes" for scheme in CORRECTED.get(name, ((),))[-1]}
    passes = ("derivatives", "corrections")
    wanted |= (
        {"midpoint_in_lanes", "gauss2_in_lanes"} if name == "kubo" else {f"{x}_{y}" for x in ALL[3:] for y in passes}
    )
    wanted |= {"gauss2_sweeps"} if name == "several" else set()
    assert loops.keys() == wanted
    assert {name for name, number in loops.items() if number in vectors} == wanted
    assert not [x for x, number in loops.items() if x.endswith("corrections") and number in left]  # nor the last loop


def test_parameters_are_given_when_it_runs():
    mine, other = model("pendulum"), model("pendulum").with_parameters(b=0.1)
    assert other.formula.file == mine.formula.file
    for scheme in ("stormer_verlet", "midpoint"):
        run, plain = (ss.simulate(other, scheme=scheme, **RUN, steps=20, general=g) for g in (False, True))
        np.testing.assert_allclose(run.q, plain.q, rtol=0, atol=1e-14)
        assert abs(run.q[-1, 0, 0] - ss.simulate(mine, scheme=scheme, **RUN, steps=20).q[-1, 0, 0]) > 1e-4


@pytest.mark.parametrize("scheme", ["stormer_verlet", "midpoint", "gauss2"])
def test_a_far_path_changes_no_other(scheme):
    """One path has arguments beyond the inlined sine's range: it agrees with the general stepper, and other paths
    keep their bits.
    """
    mine = model("pendulum")
    starts = np.full((1, 40), 0.4)
    near = ss.simulate(mine, scheme=scheme, **{**RUN, "q0": starts}, steps=20, paths=40)
    starts[0, 7] = 3e17  # q is so large that it does not move; p shows the force
    far = ss.simulate(mine, scheme=scheme, **{**RUN, "q0": starts}, steps=20, paths=40)
    plain = ss.simulate(mine, scheme=scheme, **{**RUN, "q0": starts}, steps=20, paths=40, general=True)
    others = [i for i in range(40) if i != 7]
    np.testing.assert_array_equal(far.q[:, :, others], near.q[:, :, others])
    np.testing.assert_allclose(far.p[:, :, 7], plain.p[:, :, 7], rtol=1e-12)
    alone = ss.simulate(mine, scheme=scheme, **{**RUN, "q0": 3e17}, steps=20, paths=1, first_path=7)
    np.testing.assert_array_equal(alone.p[:, :, 0], far.p[:, :, 7])


@pytest.mark.parametrize("scheme", ["symplectic_euler", "stormer_verlet", "chin4a", "midpoint", "gauss2"])
def test_far_paths_of_one_vector_have_the_bits_of_a_block(scheme):
    """Eight paths keep their states in registers over many steps; two are beyond the inlined sine's range, where all of
    these steps are taken again. They have the bits of a block of forty.
    """
    mine, q0 = model("one equation"), np.linspace(0.1, 0.9, 40)[None, :].copy()
    q0[0, 2:5:2] = 3e17  # q does not move; p shows the force
    few = ss.simulate(mine, **{**RUN, "q0": q0[:, :8], "scheme": scheme}, steps=50, save_every=10, paths=8)
    wide = ss.simulate(mine, **{**RUN, "q0": q0, "scheme": scheme}, steps=50, save_every=10, paths=40)
    np.testing.assert_array_equal(few.q, wide.q[:, :, :8])
    np.testing.assert_array_equal(few.p, wide.p[:, :, :8])


@pytest.mark.parametrize("scheme", (*ALL, *emit_flow.FURTHER))
def test_angles_below_an_eighth_of_a_turn_alone(scheme):
    """A single path reduces small angles by a shorter way, with the bits of a block."""
    starts = np.array([[0.0, -0.0, 0.78, 0.7851, 0.7855, 0.82, -0.785, 2.0, 3e5]])
    run = {**RUN, "scheme": scheme, "steps": 20}
    block = ss.simulate(model("pendulum"), **{**run, "q0": starts}, paths=9)
    for i in range(9):
        alone = ss.simulate(model("pendulum"), **{**run, "q0": starts[:, [i]]}, paths=1, first_path=i)
        np.testing.assert_array_equal(alone.q[:, :, 0], block.q[:, :, i])
        np.testing.assert_array_equal(alone.p[:, :, 0], block.p[:, :, i])


FAR = [*(("one equation", scheme) for scheme in (*ALL, *emit_flow.FURTHER)), ("two angles", "gauss2")]


@pytest.mark.parametrize(("name", "scheme"), FAR)
def test_forces_of_far_paths_are_those_of_the_c_library(name, scheme):
    """Beyond 2^52 the inlined sine has no angle; q does not move there, and p gets the C library's force."""
    made = model(name)
    starts = np.linspace(0.9e17, 1.1e17, 20)[None, :] * np.ones((made.ndof, 1))
    run = {**RUN, "q0": starts, "scheme": scheme, "steps": 10, "paths": 20}
    mine, plain = (ss.simulate(made, **run, general=g) for g in (False, True))
    assert np.abs(plain.p[-1] - plain.p[0]).max() > 0.2
    np.testing.assert_allclose(mine.p, plain.p, rtol=0, atol=1e-12)


def test_a_far_path_of_two_angles_changes_no_other():
    """Sweeps leave a far path to Newton's iteration, however its neighbours are solved."""
    mine = model("two angles")
    starts = np.full((2, 40), 0.4)
    run = {**RUN, "scheme": "gauss2", "steps": 20, "paths": 40}
    near = ss.simulate(mine, **{**run, "q0": starts})
    starts[:, 7] = 3e5
    far, plain = (ss.simulate(mine, **{**run, "q0": starts}, general=g) for g in (False, True))
    others = [i for i in range(40) if i != 7]
    np.testing.assert_array_equal(far.q[:, :, others], near.q[:, :, others])
    np.testing.assert_allclose(far.q[:, :, 7], plain.q[:, :, 7], rtol=1e-12)
    alone = ss.simulate(mine, **{**run, "q0": starts[:, [7]], "paths": 1}, first_path=7)
    np.testing.assert_array_equal(alone.q[:, :, 0], far.q[:, :, 7])


@pytest.mark.parametrize("name", ["several", "three", "two angles"])
@pytest.mark.parametrize("step", [0.3, 1.5, 6.0])
def test_lanes_that_sweeps_leave_are_solved_by_newton(name, step):
    """Steps of h omega up to 10, in which sweeps solve some paths and leave others: equal to the general stepper's,
    independent of other paths, and none is rescued.
    """
    mine = model(name)
    starts = np.linspace(-0.05, 0.05, 30)[None, :] * np.ones((mine.ndof, 1))
    run = {**RUN, "q0": starts, "p0": 0.02, "step": step, "steps": 6, "scheme": "gauss2"}
    whole, plain = (ss.simulate(mine, **run, paths=30, general=g) for g in (False, True))
    np.testing.assert_array_equal(whole.status, 0)
    assert whole.report.counters["damped"] == whole.report.counters["continued"] == 0
    for x, y in ((whole.q, plain.q), (whole.p, plain.p)):
        np.testing.assert_allclose(x, y, rtol=0, atol=300 * np.spacing(np.abs(y).max()))
    for i in (0, 9, 29):
        alone = ss.simulate(mine, **{**run, "q0": starts[:, [i]]}, paths=1, first_path=i)
        np.testing.assert_array_equal(alone.q[:, :, 0], whole.q[:, :, i])


def test_paths_fail_as_they_do_without():
    """A potential without a minimum: the same paths fail in the same steps as nonfinite."""
    mine = ss.model_from_sympy("p**2/2 - q**6", ["sigma*q"], params={"sigma": 1.0})
    run = {**RUN, "scheme": "stormer_verlet", "step": 0.1, "steps": 60, "paths": 50}
    with pytest.warns(errors.PathsFailedWarning):
        mine, plain = (ss.simulate(mine, **run, general=g) for g in (False, True))
    assert mine.report.stepper.startswith("whole steps")
    assert (mine.status == 3).any()
    np.testing.assert_array_equal(mine.status != 0, plain.status != 0)
    np.testing.assert_array_equal(mine.failed_step, plain.failed_step)


def test_paths_fail_alike_in_any_block():
    """Equations without a nearby solution: the outcome of a path does not depend on its neighbours."""
    mine = ss.model_from_sympy("p**2/2 + sigma*p**2*q**2 - q**6", ["sigma*q"], params={"sigma": 1.0})
    run = {**RUN, "scheme": "midpoint", "step": 0.1, "steps": 60}
    with pytest.warns(errors.PathsFailedWarning):
        whole = ss.simulate(mine, **run, paths=50)
        small = ss.simulate(mine, **run, paths=50, lanes=8)
        alone = [ss.simulate(mine, **run, paths=1, first_path=i) for i in range(10)]
    assert whole.report.stepper.startswith("whole steps")
    assert set(whole.status) >= {0} and (whole.status != 0).sum() > 5
    for other, first in ((small, 0), *((run, i) for i, run in enumerate(alone))):
        some = slice(first, first + len(other.status))
        np.testing.assert_array_equal(other.status, whole.status[some])
        np.testing.assert_array_equal(other.failed_step, whole.failed_step[some])
        np.testing.assert_array_equal(other.q, whole.q[:, :, some])


def test_steep_steps_keep_their_digits():
    """Steps with h omega = 10 to 1000, where elimination of momenta loses digits, equal the general stepper's to
    1e-14.
    """
    mine = ss.model_from_sympy("p**2/2 + k**2*q**2/2 + q**4/4", ["0.01*q"], params={"k": 1000.0})
    for step in (0.01, 0.1, 1.0):
        run = {"q0": 0.3, "p0": 200.0, "step": step, "steps": 20, "paths": 20}
        mine_run, plain = (ss.simulate(mine, **run, general=g) for g in (False, True))
        assert mine_run.report.stepper.startswith("whole steps")
        np.testing.assert_allclose(mine_run.q, plain.q, rtol=0, atol=1e-14)


def test_equations_with_several_solutions_are_no_wrong_steps():
    """Steps of ten turns: the solution that is found depends on the iteration, so a difference is not a wrong step."""
    mine = ss.model_from_sympy("p**2/2 - k**2*cos(q)", ["0.01*q"], params={"k": 1000.0})
    for step in (0.01, 1.0):
        run = {"q0": 0.3, "p0": 200.0, "step": step, "steps": 10, "seed": 1}
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", errors.PathsFailedWarning)
            whole, alone = ss.simulate(mine, **run, paths=20), ss.simulate(mine, **run, paths=1, first_path=7)
        np.testing.assert_array_equal(alone.q[:, :, 0], whole.q[:, :, 7])


def test_iterations_are_bounded():
    """One iteration does not solve a nonlinear equation, here or in the general stepper."""
    mine = model("pendulum")
    with pytest.warns(errors.PathsFailedWarning):
        run = ss.simulate(mine, scheme="midpoint", **RUN, steps=3, paths=9, max_iter=1)
    assert (run.status == 1).all() and (run.failed_step == 0).all()


@pytest.mark.parametrize(
    ("text", "old", "new", "scheme"),
    [
        ("steps", "LANE_OF, s, 0.5, far", "LANE_OF, s, 0.505, far", "stormer_verlet"),
        ("steps", "drift(LANE_OF, s, 1, far)", "drift(LANE_OF, s, 1.01, far)", "symplectic_euler"),
        ("midpoint_eliminated", "0.25 * hpp[k", "0.2525 * hpp[k", "midpoint"),
        ("gauss2", "{0.5386751345948129, 0.25}", "{0.5386751345948129, 0.2525}", "gauss2"),
        ("gauss2_swept", "{0.34150635094610965, ", "{0.34492141445557075, ", "gauss2"),
        ("gauss2_swept", "0.7886751345948129}", "0.7965618859407610}", "gauss2"),
        ("gauss2_swept", "{0.39433756729740643, ", "{0.39828094297038050, ", "gauss2"),
    ],
)
@pytest.mark.usefixtures("quick_compiler")
def test_wrong_steps_are_refused(monkeypatch, text, old, new, scheme):
    """The twin: one coefficient one per cent off."""
    whole = emit_flow._text
    assert old in whole(text)
    monkeypatch.setattr(emit_flow, "_text", lambda x: whole(x).replace(old, new) if x == text else whole(x))
    with pytest.raises(errors.FalseTraitError, match=f"the whole steps of scheme {scheme} .* are not those"):
        ss.simulate(model("several" if text == "gauss2_swept" else "pendulum"), scheme=scheme, **RUN, steps=3)


@pytest.mark.parametrize("state", [(0.3, 0.0), (0.6, -1.0), (1.0, -1.0)])
def test_another_root_of_a_stiff_step_is_no_fault(state):
    """A double well at h = 6, where the equations have several roots: the steps find another root than the general
    stepper.
    """
    well = ss.model_from_sympy("p**2/2 + q**4/4 - q**2/2", noise=["-0.2*q"], q=["q"], p=["p"])
    run = ss.simulate(
        well, q0=state[0], p0=state[1], step=6.0, steps=1, scheme="midpoint", increments=np.full((1, 1), 0.5)
    )
    q, p = run.q[:, 0, 0], run.p[:, 0, 0]
    middle, size = q.mean(), 1 + np.abs(q).max() ** 3
    assert "whole steps" in run.report.stepper and not run.status.any()
    assert abs(q[1] - q[0] - 6 * p.mean()) < 1e-12 * size
    assert abs(p[1] - p[0] + 6 * (middle**3 - middle) - 0.2 * 0.5) < 1e-12 * size


CANCELS = {  # separable after cancellation: the separable form
    "(p+q)*(p-q)/2 + cos(q)": "p**2/2 - q**2/2 + cos(q)",
    "(p+q)**2/2 - p*q + sin(q)": "p**2/2 + q**2/2 + sin(q)",
    "(p+q)**4/12 - p**3*q/3 - p**2*q**2/2 - p*q**3/3 + p**2/2": "p**4/12 + p**2/2 + q**4/12",
    "(p+sin(q))*(p-sin(q))/2 + q**2": "p**2/2 - sin(q)**2/2 + q**2",
    "p*(cosh(q)**2 - sinh(q)**2) + p**2/2 + q**2": "p + p**2/2 + q**2",
    "a*(p+a*q)**2/2 - p*q*a**2": "a*p**2/2 + a**3*q**2/2",
    "(p1+q2)*(p1-q2)/2 + p2**2/2 + cos(q1)": "p1**2/2 - q2**2/2 + p2**2/2 + cos(q1)",
    "(p1+q1)**2/2 + (p2-q2)**2/2 - p1*q1 + p2*q2 + q1*q2": "(p1**2 + q1**2 + p2**2 + q2**2)/2 + q1*q2",
}


@pytest.mark.usefixtures("quick_compiler")
@pytest.mark.parametrize("written", CANCELS)
@pytest.mark.parametrize("noise", [(), "(p+q)**2/20 - p**2/20 - p*q/10"])
def test_separable_after_cancellation(written, noise):
    """Terms that cancel are not computed: their rounding would couple the halves of a step and change bits of whole
    steps.
    """
    noise = noise.replace("q", "q1").replace("p", "p1") if noise and "q1" in written else noise
    params = {"a": 1.7} if "a*" in written else None
    mine, short = (ss.model_from_sympy(h, noise, params=params) for h in (written, CANCELS[written]))
    assert mine.traits == short.traits and mine.traits.separable
    for x in (0.1, 3.3):
        run = {"q0": x, "p0": 0.2 + x / 2, "paths": 3, "steps": 6, "seed": 2, "correction": "none"}
        for scheme in ALL[:4]:
            for h in (0.1, 0.3):
                found, plain = (ss.simulate(m, scheme=scheme, step=h, **run) for m in (mine, short))
                np.testing.assert_allclose(found.q, plain.q, rtol=1e-9, atol=1e-9)


@pytest.mark.usefixtures("quick_compiler")
def test_a_branch_does_not_cancel():
    """The derivative of these terms by p is zero, but one has two signs and the other is NaN for p < 0."""
    turned = ss.model_from_sympy("q*(atan(p/q) + atan(q/p)) + p**2/2")
    np.testing.assert_allclose([turned.gradient(1.0, p)[0][0, 0] for p in (1.0, -1.0)], [np.pi / 2, -np.pi / 2])
    half = ss.model_from_sympy("q*(log(p**2) - 2*log(p)) + p**2/2")
    np.testing.assert_array_equal([half.gradient(1.0, p)[0][0, 0] for p in (1.0, -1.0)], [0.0, np.nan])
