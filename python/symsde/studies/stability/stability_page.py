# SPDX-License-Identifier: BSD-3-Clause
"""Tables and figures of docs/stability.md and, with every expectation, of docs/stability-tables.md."""

from __future__ import annotations

from pathlib import Path

from ...show.tables import markdown
from .. import expectations
from ..expectations import Expectations
from ..pages import Page, made_by, wrapped
from . import bifurcation, limits, long_time, stability_figure

COMMAND = "symsde stability --markdown docs/stability.md"
MET = (
    "{met} of {total} expectations are met{quick}. A mean of random numbers is as expected if it is within {allowed:g} "
    "standard errors; one correct mean in a million then fails. Measured with {made_by}."
)


def write(target: Path, found: list[Expectations], quick: bool) -> None:
    """Write the parts of the page, and of the page of all checks beside it, with their figures."""
    page, appendix = Page(target, COMMAND), Page(target.with_stem(f"{target.stem}-tables"), COMMAND)
    curves = {part.name: part.curves for part in found if part.curves}
    figure = page.figure("step-limits", limits.growth(), limits.save, "Growth of an oscillator in a step")
    page.put("first", figure, markdown(limits.HEAD, limits.table(limits.limits(limits.FIRST))))
    if "stability_limits" in curves:
        rows = limits.table(curves.pop("stability_limits")["limits"])
        page.put("limits", markdown(limits.HEAD, rows))
    if "bifurcations" in curves:
        kept = curves.pop("bifurcations")
        words = "Fixed points and cycles of a step that the equation does not have"
        figure = page.figure("fixed-points", kept, bifurcation.save, words)
        page.put("orbits", markdown(bifurcation.HEAD, bifurcation.table(kept)), figure)
    if "long_time" in curves:
        words = "Energy over a long time"
        page.put("long-time", page.figure("long-time", curves.pop("long_time"), long_time.save, words))
    met, failed = expectations.count(found, True), expectations.count(found, False)
    facts = {"quick": " (quick sample)" if quick else "", "allowed": expectations.STANDARD_ERRORS, "made_by": made_by()}
    appendix.put("met", wrapped(MET.format(met=met, total=met + failed, **facts)))
    appendix.put("figure", appendix.figure("stability", curves, stability_figure.save, "Expected and measured"))
    sections = [(f"## {n}. {part.title}", expectations.section(part, "case")) for n, part in enumerate(found, 1)]
    appendix.put("checks", *(text for section in sections for text in section))
    page.write()
    appendix.write()
