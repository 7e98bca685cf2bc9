# SPDX-License-Identifier: BSD-3-Clause
"""Formulas find the quadratic part of H whose flow stands between kicks, or are told it by split=."""

import pickle

import numpy as np
import pytest
import symsde as ss
from symsde import errors
from symsde.model.formulas import emit_flow
from symsde.model.formulas.formula_scenes import from_table

pytestmark = pytest.mark.usefixtures("quick_compiler")

FIELD = "((p1 + b*q2)**2 + (p2 - b*q1)**2)/2"
STATE = {"q0": [1.0, 0.0], "p0": [0.0, 0.5], "seed": 3, "step": 0.05, "steps": 40, "paths": 20}
VALUES = {"b": 1.5, "s": 0.3}
SPRINGS = "p1**2/2 + p2**2/2 + k*(q1 - q2)**2/2"


def field_of(b, stiffness=0.0):
    square = np.array([[b * b, 0, 0, -b], [0, b * b, b, 0], [0, b, 1, 0], [-b, 0, 0, 1]])
    return square + np.diag([stiffness, stiffness, 0, 0])


@pytest.mark.parametrize(
    ("potential", "stiffness"),
    [
        ("(q1**2 + q2**2)/2 + (q1**4 + q2**4)/4", 1.0),  # bounded motion at rest: kicks by the quartic alone
        ("-(q1**2 + q2**2)/2 + (q1**4 + q2**4)/4", 0.0),  # two wells: kicks by all of it, which vanish in a well
        ("(q1**4 + q2**4)/4", 0.0),
    ],
)
def test_the_split_that_leaves_less_is_taken(potential, stiffness):
    model = ss.model_from_sympy(f"{FIELD} + {potential}", ["s*q1", "s*q2"], params=VALUES)
    np.testing.assert_allclose(model.traits.split, field_of(1.5, stiffness), rtol=1e-14)
    assert model.traits.kicked
    assert model.formula.structure.split == model.traits.split


@pytest.mark.parametrize("noise", [["s*q1", "s*q2"], ["s*sin(q1)", "s*cos(q2)"]])
@pytest.mark.parametrize("scheme", ["gauss_dkdkd", "verlet_kdk", "chin4a", "gauss_dkdkd_strong2"])
@pytest.mark.parametrize(("sign", "motion"), [(1, FIELD), (-1, FIELD), (1, f"b*{FIELD} + 0.3*p1*p2")])
def test_whole_steps_are_those_of_the_library(noise, scheme, sign, motion):
    """Generated steps and the library's, blocks and single paths, and those of a model of functions with this S."""
    potential = "q1**4/4 + cos(q2 - q1)"
    model = ss.model_from_sympy(f"{motion} + {potential}", noise, params=VALUES)
    given = {**STATE, "step": sign * 0.05, "scheme": scheme}
    run, oracle = ss.simulate(model, **given), ss.simulate(model, general=True, **given)
    assert ("whole steps" in run.report.stepper) == (not scheme.endswith("_strong2") or noise[0] == "s*q1")
    assert "kicks between flows of a quadratic part" in oracle.report.stepper
    np.testing.assert_allclose([run.q, run.p], [oracle.q, oracle.p], rtol=0, atol=2e-13)
    one = ss.simulate(model, **given | {"paths": 1}, first_path=7)
    np.testing.assert_array_equal([one.q[:, :, 0], one.p[:, :, 0]], [run.q[:, :, 7], run.p[:, :, 7]])
    assert ss.diagnose.symplecticity(model, scheme, q=[0.6, 0.2], p=[0.3, -0.4], step=0.2)[0] < 5e-14


FAULTS = {  # text of steps by kicks between flows of the quadratic part, the same one per cent off, and its schemes
    ("part * h * D.stiffness", "1.01 * part * h * D.stiffness"): ("gauss_dkdkd", "verlet_kdk", "chin4a"),
    ("FMA(-h * stiffness[i]", "FMA(-1.01 * h * stiffness[i]"): ("chin4a",),
    ("FMA(-h, stiffness[i]", "FMA(-1.01 * h, stiffness[i]"): ("chin4a",),
    ("(1 / 36.0) * k", "(1.01 / 36.0) * k"): ("chin4a",),
    ("FMA(x[i * ROW + DOF + j], old.d[j], a)", "FMA(1.01 * x[i * ROW + DOF + j], old.d[j], a)"): ("verlet_kdk",),
    ("s, 1 / 15.0, far", "s, 1.01 / 15, far"): ("chin4a",),
    ("s, 1 / 12.0, far", "s, 1.01 / 12, far"): ("verlet_kdk",),
}


@pytest.mark.parametrize("change", FAULTS, ids=lambda x: x[0])
def test_wrong_kicks_are_refused(monkeypatch, change):
    """The twin, which the probe of whole steps notices."""
    source = emit_flow.source_of_kicks

    def changed(made):
        text, schemes = source(made)
        assert change[0] in text
        return text.replace(*change), schemes

    monkeypatch.setattr(emit_flow, "source_of_kicks", changed)
    formula = f"b*{FIELD} + 0.3*p1*p2 + q1**4/4 + cos(q2 - q1)"
    model = ss.model_from_sympy(formula, ["s*sin(q1)", "s*cos(q2)"], params=VALUES)
    for scheme in FAULTS[change]:
        with pytest.raises(errors.FalseTraitError, match=f"the whole steps of scheme {scheme} .* are not those"):
            ss.simulate(model, scheme=scheme, **STATE)


def test_other_values_have_a_split_of_their_own():
    formula = f"{FIELD} + k*(q1**4 + q2**4) + cos(q1)"
    values = {**VALUES, "k": 0.4}
    model = ss.model_from_sympy(formula, ["s*q1"], params=values)
    for more in ({"b": 2.0}, {"k": 0.1}, {"b": 1.0}, {"b": 0.0}, {"b": -0.5, "k": 3.0}):
        other, new = model.with_parameters(**more), ss.model_from_sympy(formula, ["s*q1"], params=values | more)
        assert other.traits.split == new.traits.split
        runs = [ss.simulate(x, scheme="gauss_dkdkd", **STATE) for x in (other, new)]
        np.testing.assert_array_equal(runs[0].q, runs[1].q)
    assert model.with_parameters(b=0.0).traits.split is None
    again = pickle.loads(pickle.dumps(model.with_parameters(b=2.0)))
    assert again.traits.split == model.with_parameters(b=2.0).traits.split


def test_parameters_by_path():
    """Arrays may not decide on S, which is that of all paths: where V holds some, split= says S. Then paths have the
    numbers of their own model."""
    k = np.linspace(0.1, 0.4, 20)
    formula = f"{FIELD} + k*q1**4"
    model = ss.model_from_sympy(formula, ["s*q1"], params={**VALUES, "k": k}, split=FIELD)
    run = ss.simulate(model, scheme="gauss_dkdkd", **STATE)
    one = ss.simulate(model.with_parameters(k=float(k[7])), scheme="gauss_dkdkd", **STATE | {"paths": 1}, first_path=7)
    np.testing.assert_allclose(one.q[:, :, 0], run.q[:, :, 7], rtol=0, atol=1e-13)
    for more in ({"b": k}, {"k": k}):
        by_field = ss.model_from_sympy(formula, ["s*q1"], params={"s": 0.3, "k": 0.1, "b": 1.5, **more})
        assert by_field.traits.split is None
        with pytest.raises(errors.IncompatibleError, match="parameters that differ by path"):
            ss.simulate(by_field, scheme="gauss_dkdkd", **STATE)


def test_stiff_springs_by_hand():
    """A spring of frequency 28 at h = .1, taken exactly: the error is that of the soft force, as of a soft spring."""
    formula, noise = f"{SPRINGS} + q1**4/4 + q2**4/4", ["s*q1", "s*q2"]

    def error(stiffness, split):
        model = ss.model_from_sympy(formula, noise, params={"k": stiffness, "s": 0.1}, split=split)
        found = []
        for level in (0, 6):
            steps = 20 * 2**level
            given = {"step": 2 / steps, "steps": steps, "save_every": steps, "refine": 6 - level, "paths": 100}
            run = ss.simulate(model, q0=[0.6, 0.5], p0=[0.0, 0.3], seed=4, scheme="gauss_dkdkd", **given)
            found.append(np.concatenate([run.q[-1], run.p[-1] / np.sqrt(stiffness)]))
        return np.sqrt(((found[0] - found[1]) ** 2).sum(axis=0).mean())

    with pytest.warns(errors.DoubtfulRunWarning, match=r"h\*omega"):
        free = error(400.0, None)
    exact = error(400.0, SPRINGS)  # without a warning
    assert exact < 3e-3 < 0.01 * free, (exact, free)


def test_a_scene_says_the_split():
    table = {"H": f"{SPRINGS} + q1**4/4", "noise": ["s*q1"], "params": {"k": 9.0, "s": 0.1}, "split": SPRINGS}
    second = np.diag([0.0, 0.0, 1.0, 1.0])
    second[:2, :2] = 9 * np.array([[1, -1], [-1, 1]])
    np.testing.assert_array_equal(from_table(table).traits.split, second)
    with pytest.raises(errors.InvalidArgumentError, match="write formulas"):
        from_table(table | {"split": 1.0})


@pytest.mark.parametrize(
    ("split", "told"),
    [
        (f"{SPRINGS} + q1**4", "no quadratic form"), (f"{SPRINGS} + q1", "no quadratic form"),
        (f"{SPRINGS} + t*q1**2", "no quadratic form"), ("p1**2/2", "depends on a momentum"),
        (f"{SPRINGS} + p1**2", "depends on a momentum"), ("x", "not given"),
    ],
)  # fmt: skip
def test_wrong_splits_are_refused(split, told):
    with pytest.raises(errors.InvalidArgumentError, match=told):
        ss.model_from_sympy(f"{SPRINGS} + q1**4/4", ["s*q1"], params={"k": 9.0, "s": 0.1}, split=split)


@pytest.mark.parametrize(
    ("hamiltonian", "noise", "told"),
    [
        ("p1**2*(1 + q2**2)/2 + p2**2/2 + q1*p2", "q1", "not quadratic in what holds momenta.*q_2"),
        ("p1**2/2 + p2**2/2 + q1*p2 + q2**4", "p1*q1", r"the noise 'p1\*q1' holds momenta and does not commute"),
        ("p1**2/2 + p2**2/2 + q1*p2 + p1 + q2**4", "q1", "linear in p alone"),
        ("p1**2/2 + p2**2/2 + cos(t)*q1*p2 + q2**4", "q1", "second derivative by p has t"),
    ],
)
def test_what_is_in_the_way_of_a_split_is_named(hamiltonian, noise, told):
    model = ss.model_from_sympy(hamiltonian, [noise])
    assert model.traits.split is None
    with pytest.raises(errors.IncompatibleError, match=told):
        ss.simulate(model, scheme="gauss_dkdkd", **STATE)


#: sums over sites that hold all momenta, and what H holds beside them
LINES = {
    "springs": ("Sum(p[i]**2/2, i) + k*Sum((q[i+1] - q[i])**2/2, i)", "Sum(q[i]**4/4, i) + Sum(cos(q[i+1] - q[i]), i)"),
    "inertia": ("Sum(p[i]**2/2, i) - k*Sum(p[i]*p[i+1], i)/40 + Sum(q[i]**2, i)", "Sum(q[i]**4/4, i)"),
    "crossed": ("Sum(p[i]**2/2, i) + k*Sum(q[i]*p[i+1], i)/30", "Sum(q[i]**2 + q[i]**4/4, i)"),
}


def written_out(text, n):
    """Sums over q[i], q[i+1], p[i], p[i+1] as terms of n sites with free ends."""
    while "Sum(" in text:
        start = text.index("Sum(")
        stop = text.index(", i)", start)
        body, terms = text[start + 4 : stop], []
        for site in range(1, n + ("i+1" not in body)):
            terms += [body.replace("[i]", str(site)).replace("[i+1]", str(site + 1))]
        text = f"{text[:start]}({' + '.join(terms)}){text[stop + 4 :]}"
    return text


@pytest.mark.parametrize("ends", ["free", "fixed", "periodic"])
@pytest.mark.parametrize("name", LINES)
def test_sums_by_hand(name, ends):
    """S for all ends and values; where nothing couples momenta, only by hand."""
    form, rest = LINES[name]
    given = {"params": {"k": 9.0, "s": 0.2}, "n": 5, "ends": ends}
    model = ss.model_from_sympy(f"{form} + {rest}", "s*sin(q[j])", split=form, **given)
    near = np.roll(np.eye(5), 1, axis=1) if ends == "periodic" else np.eye(5, k=1)
    ties = near - np.eye(5) if ends != "free" else (near - np.eye(5))[:4]
    bonds = ties.T @ ties + (np.diag([1.0, 0, 0, 0, 0]) if ends == "fixed" else 0)
    zero, one = np.zeros((5, 5)), np.eye(5)

    def exact(k):
        if name == "springs":
            return np.block([[k * bonds, zero], [zero, one]])
        if name == "inertia":
            return np.block([[2 * one, zero], [zero, one - k / 40 * (near + near.T)]])
        return np.block([[zero, k / 30 * near], [k / 30 * near.T, one]])

    for k in (9.0, 4.0):
        other = model.with_parameters(k=k)
        np.testing.assert_allclose(other.traits.split, exact(k), rtol=0, atol=1e-14)
        assert other.traits.kicked
    run = ss.simulate(model, **STATE | {"q0": 0.3, "p0": 0.1}, scheme="chin4a")
    assert run.report.stepper == "kicks between flows of a quadratic part"
    if name != "crossed":
        found = ss.model_from_sympy(f"{form} + {rest}", "s*sin(q[j])", **given)
        assert (found.traits.split is None) == (name == "springs")


def test_sums_have_the_split_and_the_steps_of_their_terms():
    form, rest = LINES["crossed"]
    values = {"k": 9.0, "s": 0.2}
    sums = ss.model_from_sympy(f"{form} + {rest}", "s*sin(q[j])", params=values, n=3)
    terms = ss.model_from_sympy(written_out(f"{form} + {rest}", 3), [f"s*sin(q{k})" for k in (1, 2, 3)], params=values)
    np.testing.assert_allclose(sums.traits.split, terms.traits.split, rtol=0, atol=1e-14)
    for scheme in ("gauss_dkdkd", "chin4a"):
        run = {**STATE, "q0": [0.2, 0.3, 0.6], "p0": 0.1, "scheme": scheme}
        kicked, same = ss.simulate(sums, **run), ss.simulate(terms, **run)
        np.testing.assert_allclose([kicked.q, kicked.p], [same.q, same.p], rtol=0, atol=1e-12)


def test_sites_of_several_coordinates_and_numbers_of_their_own():
    """Charges in a field of each site, tied by springs: S is that of the terms, and follows the field."""
    field = np.array([1.5, 0.5, -1.0])
    formula = (
        "Sum(((u[i] + b[i]*y[i])**2 + (v[i] - b[i]*x[i])**2)/2 + x[i]**4/4 + y[i]**2, i) + Sum((x[i+1] - x[i])**2/2, i)"
    )
    sums = ss.model_from_sympy(formula, "s*x[k]", q="x y", p="u v", params={"b": field, "s": 0.3}, n=3, ends="periodic")
    terms = []
    for k, name in enumerate("abc"):
        x, y, u, v, near = f"q{2 * k + 1}", f"q{2 * k + 2}", f"p{2 * k + 1}", f"p{2 * k + 2}", f"q{(2 * k + 2) % 6 + 1}"
        terms += [f"(({u} + {name}*{y})**2 + ({v} - {name}*{x})**2)/2 + {x}**4/4 + {y}**2 + ({near} - {x})**2/2"]
    values = dict(zip("abc", field, strict=True))
    alike = ss.model_from_sympy(" + ".join(terms), ["s*q1", "s*q3", "s*q5"], params={**values, "s": 0.3})
    np.testing.assert_allclose(sums.traits.split, alike.traits.split, rtol=0, atol=1e-14)
    run = {**STATE, "q0": 0.3, "p0": 0.1, "scheme": "gauss_dkdkd"}
    np.testing.assert_allclose(ss.simulate(sums, **run).q, ss.simulate(alike, **run).q, rtol=0, atol=1e-12)
    other = sums.with_parameters(b=2 * field)
    alike = alike.with_parameters(**{x: 2 * y for x, y in values.items()})
    np.testing.assert_allclose(other.traits.split, alike.traits.split, rtol=0, atol=1e-14)


def test_every_pair_of_sites_may_be_coupled():
    form = "Sum(p[i]**2/2, i) + Sum((q[i] - q[j])**2/8, i < j)"
    model = ss.model_from_sympy(f"{form} + Sum(q[i]**4, i)", "s*q[k]", params={"s": 0.2}, n=4, split=form)
    second = np.zeros((8, 8))
    second[:4, :4] = np.eye(4) - 0.25
    second[4:, 4:] = np.eye(4)
    np.testing.assert_allclose(model.traits.split, second, rtol=0, atol=1e-15)


LATTICE = "Sum((q[i]**2 + p[i]**2)**2/4, i) + Sum(e[i]*(q[i]**2 + p[i]**2)/2, i)"
HOPS = "-J*Sum(q[i]*q[i+1] + p[i]*p[i+1], i)"


def test_energies_of_sites_are_in_the_flow_or_in_the_kicks():
    """Either is a pair: both have order 3/2 and keep the norm, and differ by their errors."""
    values = {"e": np.linspace(-1, 1, 5), "J": 0.7, "s": 0.5}
    given = {"noise": "s*(q[k]**2 + p[k]**2)/2", "params": values, "n": 5, "ends": "periodic"}
    found = ss.model_from_sympy(f"{LATTICE} + {HOPS}", **given)
    by_hand = ss.model_from_sympy(f"{LATTICE} + {HOPS}", **given, split=HOPS)
    near = -0.7 * (np.roll(np.eye(5), 1, axis=0) + np.roll(np.eye(5), -1, axis=0))
    np.testing.assert_allclose(by_hand.traits.split, np.kron(np.eye(2), near), rtol=0, atol=1e-15)
    np.testing.assert_allclose(found.traits.split, np.kron(np.eye(2), near + np.diag(values["e"])), rtol=0, atol=1e-15)
    assert found.traits.turned
    assert by_hand.traits.turned
    ends = []
    for model, level in ((found, 9), (by_hand, 9), (by_hand, 5), (by_hand, 4)):
        steps = 2**level
        run = ss.simulate(
            model, q0=np.linspace(0.3, 1.0, 5), p0=0.0, seed=3, step=1 / steps, steps=steps, save_every=steps,
            refine=9 - level, scheme="gauss_dkdkd", paths=40,
        )  # fmt: skip
        norm = (run.q**2 + run.p**2).sum(axis=1)
        assert np.abs(norm - norm[0]).max() < 2e-13
        ends.append(np.concatenate([run.q[-1], run.p[-1]]))
    same, fine, coarse = (np.sqrt(((x - ends[0]) ** 2).sum(axis=0).mean()) for x in ends[1:])
    assert same < 1e-4 < fine < 2e-3
    assert 1.3 < np.log2(coarse / fine) < 2.1


def test_a_scene_says_the_split_of_sums():
    table = {"H": f"{LATTICE} + {HOPS}", "noise": ["s*(q[k]**2 + p[k]**2)/2"], "n": 4, "ends": "free", "split": HOPS}
    table["params"] = {"e": [0.1, 0.2, 0.3, 0.4], "J": 1.0, "s": 0.1}
    near = -np.eye(4, k=1) - np.eye(4, k=-1)
    np.testing.assert_array_equal(from_table(table).traits.split, np.kron(np.eye(2), near))


@pytest.mark.parametrize(
    ("hamiltonian", "noise", "split", "told"),
    [
        ("Sum(p[i]**2/2 + q[i]**4, i)", "q[k]", "Sum(p[i]**2, i)", "give all terms that hold momenta"),
        ("Sum(p[i]**2/2 + q[i]**4, i)", "q[k]", "Sum(p[i]**2/2 + q[i]**4, i)", "no quadratic form"),
        ("Sum(p[i]**2/2 + q[i]**4, i)", "q[k]", "Sum(p[i]**2/2 + t*q[i]**2, i)", "no quadratic form"),
        ("Sum(p[i]**2/2 + q[i]**4, i)", "q[k]", "Sum(q[i], i)**2", "no sum of terms"),
        ("Sum(p[i]**2/2 + q[i]**4, i)", "q[k]", "p1**2/2", "cannot be used"),
        (f"{LATTICE} + {HOPS}", "q[k]", HOPS, r"the noise 'q\[k\]' does not commute"),
        (f"{LATTICE} + {HOPS}", "q[k]**2 + p[k]**2", "Sum(q[i]*q[i+1], i)", "none of the actions"),
    ],
)
def test_wrong_splits_of_sums_are_refused(hamiltonian, noise, split, told):
    with pytest.raises(errors.InvalidArgumentError, match=told):
        ss.model_from_sympy(
            hamiltonian, noise, params={"e": np.ones(8), "J": 1.3} if "J" in hamiltonian else {}, n=8, split=split
        )


@pytest.mark.parametrize(
    ("hamiltonian", "noise", "told"),
    [
        ("Sum(p[i]**2/2 + q[i]*p[i+1] + q[i]**4, i)", "p[k]", r"the noise 'p\[k\]' holds momenta and does not commute"),
        ("Sum((q[i]**2 + p[i]**2)**2 + q[i]*q[i+1], i)", "q[k]", "nothing but functions of the actions"),
    ],
)
def test_what_is_in_the_way_of_a_split_of_sums_is_named(hamiltonian, noise, told):
    model = ss.model_from_sympy(hamiltonian, noise, n=6)
    assert model.traits.split is None
    with pytest.raises(errors.IncompatibleError, match=told):
        ss.simulate(model, scheme="gauss_dkdkd", q0=0.1, p0=0.1, step=0.1, steps=2)


def test_large_lattices_are_not_split():
    """A matrix that couples all of a long chain would take hours."""
    given = {"noise": "q[k]**2 + p[k]**2", "n": 600, "ends": "periodic"}
    formula = "Sum((q[i]**2 + p[i]**2)**2 + q[i]*q[i+1] + p[i]*p[i+1], i)"
    model = ss.model_from_sympy(formula, **given)
    with pytest.raises(errors.IncompatibleError, match="512 degrees of freedom at most, here are 600"):
        ss.simulate(model, scheme="gauss_dkdkd", q0=0.1, p0=0.1, step=0.1, steps=2)
    with pytest.raises(errors.InvalidArgumentError, match="512 are the most"):
        ss.model_from_sympy(formula, **given, split="Sum(q[i]*q[i+1] + p[i]*p[i+1], i)")
