# SPDX-License-Identifier: BSD-3-Clause
"""The catalogues as tables in Markdown, parts of docs/models.md and docs/schemes.md: all entries come from the
library."""

from __future__ import annotations

import re

from .. import models, schemes
from ..model.traits import FLAGS
from ..show.tables import markdown

# One member of each family whose names contain a number.
FAMILIES = {
    "dirk:0.25": "`dirk:C`, 0 < C < 1: a midpoint step of length C h, then one of length (1 - C) h",
    "word:BAOAB": "`word:W`, W of the letters A (drift), B (kick) and O (damping with noise): a splitting of damped "
    "systems, [as a word](heat-baths.md#words)",
    "lambda:0.3": "`lambda:X`, 0 <= X <= 1: P = X p_n + (1 - X) p_{n+1}, Q = (1 - X) q_n + X q_{n+1}",
}


def models_parts() -> dict[str, str]:
    """The built-in models: Hamiltonians, parameters with defaults, traits, equations of the paper."""
    rows, sections = [], []
    for name in models.names():
        model = models.get(name)
        text = (getattr(models, name).__doc__ or "").strip()
        given = [key.replace("_", " ") for key in FLAGS if getattr(model.traits, key)]
        if model.traits.bandwidth is not None:
            given.append(f"bandwidth {model.traits.bandwidth}")
        if model.traits.rotation is not None:
            given.append("rotation " + " ".join(f"{omega:g}" for omega in model.traits.rotation))
        parameters = ", ".join(f"{key} = {value:g}" for key, value in models.parameters(name).items())
        sizes = f"{model.ndof}", f"{model.nnoise}"
        rows.append([f"[`{name}`](#{name})", _equations(text), parameters, *sizes, ", ".join(given)])
        sections.append(f"## {name}\n\n" + "\n".join(line.strip() for line in text.splitlines()) + "\n")
    header = [
        "model",
        "equations of the paper",
        "parameters and defaults",
        "degrees of freedom",
        "noises",
        "traits for these defaults",
    ]
    return {"models": "\n".join([markdown(header, rows), *sections])}


def schemes_parts() -> dict[str, str]:
    """The catalogue of schemes: orders by class of noise, structure, cost, references."""
    found = [(name, schemes.get(name)) for name in (*schemes.names(), *FAMILIES)]
    facts = {name: scheme.info for name, scheme in found}
    families = "\n".join(f"- {text}" for text in FAMILIES.values())
    return {
        "orders": _orders(facts), "structure": _structure(found), "families": families,
        "references": _references(facts),
    }  # fmt: skip


def certified(scheme: schemes.Scheme) -> dict[str, str]:
    """The lines of a scheme's certificate by their labels."""
    lines = (line for line in scheme.certificate().splitlines() if line.strip())
    return {line[:24].strip(): line[24:].strip() for line in lines}


def _orders(facts: dict[str, schemes.SchemeInfo]) -> str:
    rows = []
    for name, info in facts.items():
        cells = [_order(order) for order in info.orders.values()]
        if info.uses_nested_bracket and not info.crosses_noises:
            cells[-1] += ", general 1"
        rows.append([f"`{name}`", *cells, f"{info.order_noise_free}"])
    return markdown(["scheme", "additive", "commutative", "general", "flows commute", "weak", "no noise"], rows)


def _order(order: schemes.Order) -> str:
    """The order as text, such as '1.5* (1.52 ± 0.02)': a star marks a claimed order; the measured one has its
    interval.
    """
    if not order.value:
        return "-"
    star = "*" if order.evidence == "claimed" else ""
    if order.measured is None:
        return f"{order.value:g}{star}"
    floor = f"; {order.measured.floor:.0e}" if order.measured.floor else ""
    return f"{order.value:g}{star} ({order.measured.order:.2f} ± {order.measured.half_width:.2f}{floor})"


def _structure(found: list[tuple[str, schemes.Scheme]]) -> str:
    rows = []
    for name, scheme in found:
        info = scheme.info
        star = "*" if info.structure_evidence == "claimed" else ""
        rows.append(
            [
                f"`{name}`",
                f"{info.form}, {info.nstage}",
                _yes(info.symplectic) + star,
                _yes(info.symmetric) + star,
                ("quadratic" if info.keeps_quadratic else "bilinear" if info.keeps_bilinear else "none") + star,
                f"{info.correction_coefficient:g}" if info.correction_coefficient else "-",
                _extras(info),
                re.split("[:;]", certified(scheme).get("needs", "-"))[0],
                info.explicit_for
                + (", without correction" if info.correction_exists and info.explicit_for != "never" else ""),
                _cost(info),
            ]
        )
    header = ["scheme", "form, stages", "symplectic", "symmetric", "invariants kept", "correction"]
    return markdown([*header, "beside dW", "model must have", "explicit", "gradients; unknowns"], rows)


def _extras(info: schemes.SchemeInfo) -> str:
    """Operations and draws that a step needs besides Gaussian increments."""
    integrals = {"dZ": info.uses_dz, "areas": info.uses_areas, "K": info.uses_stt_area, "J": info.uses_magnus}
    found = [word for word, used in integrals.items() if used]
    found += ["nested bracket"] * (info.uses_nested_bracket and not info.crosses_noises)
    found += ["nested brackets, those of noises, too"] * info.crosses_noises
    found += [f"{info.law} increments"] * (info.law != "Gaussian")
    return ", ".join(found) or "-"


def _cost(info: schemes.SchemeInfo) -> str:
    """The cost as text, such as '2; 4 (3)': gradients per iteration; unknowns per degree of freedom (separable
    models).
    """
    if info.explicit_for == "every model":
        return f"{info.gradients_per_step}"
    separable = f" ({info.unknowns_if_separable})" if info.unknowns_if_separable != info.unknowns else ""
    return f"{info.gradients_per_step}; {info.unknowns}{separable}"


def _references(facts: dict[str, schemes.SchemeInfo]) -> str:
    return markdown(["scheme", "reference"], [[f"`{name}`", info.reference] for name, info in facts.items()])


def _equations(text: str) -> str:
    """The equations of the paper that the first line of a docstring names."""
    found = re.match(r"[^\n]*(\[WHSB\] \(\d+\)(?:-\(\d+\))?)", text)
    return found[1] if found else "-"


def _yes(truth: bool) -> str:
    return "yes" if truth else "no"
