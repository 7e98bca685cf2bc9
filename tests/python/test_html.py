# SPDX-License-Identifier: BSD-3-Clause
"""HTML for notebooks: formulas of models, tableaux of schemes, certificates; every number against another source."""

import math
import re

import numpy as np
import pytest
import symsde as ss
from symsde import schemes
from symsde.show import html


def cells(text):
    """Cells of all tables, row by row."""
    rows = re.findall(r"<tr>(.*?)</tr>", text)
    return [re.findall(r"<t[hd]>(.*?)</t[hd]>", row) for row in rows]


def arrays(tableau):
    return {key: value for key, value in vars(tableau).items() if key != "beside"}


@pytest.mark.parametrize(
    ("x", "text"),
    [
        (0.5, "1/2"), (0.0, "0"), (-1 / 6, "-1/6"), (1 / 4 - math.sqrt(3) / 6, "1/4 - √3/6"),
        (0.5 + math.sqrt(15) / 10, "1/2 + √15/10"), (2 / 9 - math.sqrt(15) / 15, "2/9 - √15/15"),
        (-math.sqrt(2) / 3, "-√2/3"), (math.pi, "3.14159"), (0.5 + 1e-9, "0.5"),
    ],
)  # fmt: skip
def test_numbers(x, text):
    assert html.number(x) == text


def test_every_number_of_the_catalogue_is_what_it_says():
    seen = set()
    for name in schemes.names():
        found = schemes.get(name).tableau()
        for x in [] if found is None else np.concatenate([np.ravel(value) for value in arrays(found).values()]):
            text = html.number(x)
            python = re.sub(r"√(\d+)", r"math.sqrt(\1)", text)
            assert abs(eval(python) - x) < (1e-14 if "/" in text or "√" in text else 1e-6), (name, text)
            seen.add(text)
    assert {"1/4 - √3/6", "5/36", "1/2 + √15/10"} <= seen


@pytest.mark.parametrize("name", schemes.names())
def test_a_tableau_makes_its_scheme_again(name):
    scheme = schemes.get(name)
    found = scheme.tableau()
    if scheme.info.form in ("Galerkin", "drifts and kicks"):
        assert found is None
        return
    assert abs(found.alpha.sum() - 1) < 1e-14 and found.a.shape == (scheme.info.nstage,) * 2
    if scheme.info.form == "Euler-Maruyama":
        return
    again = schemes.from_tableau(
        found.a, found.abar, found.alpha, allow_nonsymplectic=True, b=found.b, bbar=found.bbar, beta=found.beta
    )
    assert again.info.symplecticity_residual == scheme.info.symplecticity_residual
    assert again.info.stratonovich_sum == scheme.info.stratonovich_sum
    for key, value in arrays(found).items():
        if key != "c":
            assert (getattr(again.tableau(), key) == value).all(), key
    assert again.tableau().beside == ""


BESIDE = {
    "gauss2_strong32": "brackets added to H: {H_k, H} with dZ, {{H, H_k}, H_k}",
    "gauss2_strong32_areas": "brackets added to H: {H_k, H} with dZ, {H_l, H_k} with areas, {{H, H_k}, H_k}",
    "gauss2_weak2_areas": "brackets added to H: {H_l, H_k} with areas, {{H, H_k}, H_k}, {{H_l, H_k}, H_k}; "
    "three-point increments",
    "gauss2_weak2": "brackets added to H: {{H, H_k}, H_k}; three-point increments",
    "midpoint_areas": "brackets added to H: {H_l, H_k} with areas",
    "midpoint_weak1": "two-point increments",
    **dict.fromkeys(
        ("verlet_dz", "averaged_shift_midpoint", "drift_preserving", "exact_rotation"),
        "what a stepper of its own does around these stages",
    ),
}


@pytest.mark.parametrize("name", schemes.names())
def test_a_tableau_says_what_stands_beside_it(name):
    """If the text mentions a part of the step beside the tableau, the tableau alone gives another step; otherwise it
    gives the same step.
    """
    scheme = schemes.get(name)
    found = scheme.tableau()
    said = BESIDE.get(name, "")
    assert (found.beside if found else "") == said
    assert (f"beside the tableau: {said}>" in repr(scheme)) == bool(said)
    assert (f"not in the tableau: {said}" in scheme._repr_html_()) == bool(said)


@pytest.mark.parametrize(
    ("name", "model"),
    [
        ("gauss2_strong32", "pendulum"), ("gauss2_strong32_areas", "pendulum"), ("gauss2_weak2", "pendulum"),
        ("midpoint_areas", "noncommutative_oscillator"), ("verlet_dz", "fpu_chain"),
        ("averaged_shift_midpoint", "fpu_chain"), ("drift_preserving", "fpu_chain"), ("exact_rotation", "henon_heiles"),
    ],
)  # fmt: skip
def test_the_tableau_alone_makes_another_step(name, model):
    scheme = schemes.get(name)
    found = scheme.tableau()
    alone = schemes.from_tableau(found.a, found.abar, found.alpha, allow_nonsymplectic=True)
    options = {"q0": 0.3, "p0": 0.2, "step": 0.1, "steps": 1, "seed": 2}
    ends = [ss.simulate(ss.models.get(model), scheme=one, **options).q[-1] for one in (scheme, alone)]
    assert not np.allclose(*ends, rtol=1e-9)


def test_the_rows_of_gauss2():
    rows = cells(schemes.get("gauss2")._repr_html_())
    assert rows[1] == ["1/2 - √3/6", "1/4", "1/4 - √3/6"]
    assert rows[2] == ["1/2 + √3/6", "1/4 + √3/6", "1/4"]
    assert rows[3] == ["", "1/2", "1/2"]


def test_schemes_say_their_orders():
    for name in ("midpoint", "chin4a", "P1N2Q2Lob", "heun", "triple"):
        scheme = schemes.triple_jump("midpoint") if name == "triple" else schemes.get(name)
        text = scheme._repr_html_()
        last = cells(text)[-1][1:]
        assert [float(x.replace("-", "0")) for x in last] == [order.value for order in scheme.info.orders.values()]
        assert ("not symplectic" in text) == (not scheme.info.symplectic)


def test_models_show_their_hamiltonians():
    for name in ss.models.names():
        model = ss.models.get(name)
        lines = model._hamiltonians
        assert len(lines) == (2 if name == "fpu_chain" else 1 + model.nnoise), (name, lines)
        assert lines[0].startswith("H = ") and all(line in model._repr_html_() for line in lines if "<" not in line)
    text = ss.models.kubo(a=1.5, sigma=0.25)._repr_html_()
    assert cells(text) == [["a", "sigma"], ["1.5", "0.25"]] and "H_1 = sigma (p^2 + q^2)/2" in text


def test_formulas_are_shown_as_given():
    pytest.importorskip("sympy")
    model = ss.model_from_sympy("p**2/2 + s*q**2", noise=["q"], params={"s": 2.0})
    text = model._repr_html_()
    assert "H = p**2/2 + s*q**2" in text.replace(" * ", "*") and "H_1 = q" in text and "separable" in text


def test_models_of_the_user_do_not_show_built_in_ones():
    model = ss.Model(ndof=1, nnoise=0, gradient=lambda t, w, q, p: (w[0] * q, w[0] * p), name="kubo")
    assert "H = " not in model._repr_html_() and "sigma" not in model._repr_html_()


def test_texts_are_escaped():
    model = ss.Model(ndof=1, nnoise=0, gradient=lambda t, w, q, p: (w[0] * q, w[0] * p), name="<b>&")
    assert "&lt;b&gt;&amp;" in model._repr_html_() and "<b><b>" not in model._repr_html_()


def test_certificates_are_texts():
    text = schemes.get("midpoint").certificate()
    assert isinstance(text, str) and "symplectic" in text
    assert text._repr_html_() == f"<pre>{html.html.escape(text)}</pre>"
