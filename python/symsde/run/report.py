# SPDX-License-Identifier: BSD-3-Clause
"""Reports of runs."""

from __future__ import annotations

import dataclasses
import functools
import json
from dataclasses import dataclass

from ..errors import DoubtfulRunWarning, PathsFailedWarning
from ..native import abi, checks, handles
from ..native.build import build_info
from ..show import tables
from . import provenance
from .setup import Setup


@dataclass(frozen=True)
class Report:
    """How a run was computed: stepper, what was left out, counters, failures, timings and versions."""

    outcome: str  #: ok, or the reason why the run ended
    status: int  #: status code of the outcome; 0 = ok
    stepper: str  #: the stepper that the traits chose
    correction: str  #: the correction that was used
    damping: str  #: damping of the momenta, and the friction on velocities that it is; "" for a closed system
    left_out: tuple[str, ...]  #: computations that were skipped because they were not needed
    warnings: tuple[str, ...]  #: problems found before the run, with numbers
    #: functionals of the path besides dW: dZ, areas, K, J; for refine < 0 they determine the path
    functionals: tuple[str, ...]
    counters: dict[str, int]  #: path_steps, normals, gradients, hessians, iterations, solves, ...
    failed: int  #: number of paths that failed
    stopped: int  #: number of paths that a stop cut short
    grown: int  #: number of paths that are ok, but whose q and p both grew 1e6-fold after a tenth of the steps
    threads: int
    lanes: int  #: lanes of a block; 1 where few paths are taken one by one
    lost_variance: float  #: variance that truncation takes from a normal number
    timings: dict[str, float]  #: seconds of setup and run
    lapack: str  #: name of the LAPACK that solved systems, which affects last bits; "" if none did
    versions: dict[str, str]  #: versions of the library, its compiler and options
    #: of a model in a heat bath: kinetic and configurational temperature at the end, and where momenta stand; else ""
    temperature: str = ""

    def __str__(self) -> str:
        """The report as a table, one line for each entry."""
        counted = ", ".join(f"{name.replace('_', ' ')} {n}" for name, n in self.counters.items() if n)
        times = {"set up": self.timings["setup"], "run": self.timings["run"]}  # a prepared run is set up earlier
        lines = {
            "outcome": self.outcome,
            "stepper": self.stepper,
            "correction": self.correction,
            **({"damping": self.damping} if self.damping else {}),
            **({"temperature": self.temperature} if self.temperature else {}),
            "left out": "; ".join(self.left_out) or "nothing",
            **({"driven by": " and ".join(("dW", *self.functionals))} if self.functionals else {}),
            "counters": counted,
            **({"LAPACK": self.lapack} if self.lapack else {}),
            "warnings": "; ".join(self.warnings) or "none",
            "paths": f"{self.failed} failed, {self.stopped} stopped"
            + (f", {self.grown} grew 1e6-fold" if self.grown else ""),
            "threads": f"{self.threads}, {checks.counted(self.lanes, 'lane')} a block",
            "seconds": ", ".join(f"{time:.3g} to {what}" for what, time in times.items() if time) or "0",
            "version": self.versions.get("version", "?"),
        }
        return tables.facts(lines.items())


class Reported:
    """A result with a report. The report is made on first use, since making it takes as long as some runs."""

    setup: Setup
    scene: str = ""  #: text of the scene of the run, if there is one
    _reported: abi.Report | None = None

    def _keep_report(self, given: abi.Report) -> None:
        """Keep the report of the C interface, unless the library refused the run."""
        if given.threads:
            self._reported = given

    def _warn_of_failures(self) -> None:
        """Warn if paths failed."""
        if self._reported.failed:
            checks.warn(
                f"{checks.counted(self._reported.failed, 'path')} failed: they are NaN from there on and left out of "
                "moments; see status and failed_step",
                PathsFailedWarning,
            )
        warn_of_growth(self._reported.grown)

    @property
    def title(self) -> str:
        """Model and scheme."""
        return f"{self.setup.model.name} by {self.setup.scheme.name}"

    def attributes(self) -> dict[str, str]:
        """Origin of the result as text for files: setup, paths, time, command."""
        report, paths, made = self.report, self.setup.paths, provenance.made()
        return {
            "title": self.title,
            "paths_asked": str(paths),
            "paths_ok": str(paths - report.failed - report.stopped),
            "seed": str(self.setup.options.seed),
            **self.setup.attributes(),
            **provenance.start_of(self.setup),
            "Conventions": "CF-1.11",
            "report": json.dumps({**dataclasses.asdict(report), "timings": provenance.seconds(report.timings)}),
            "source": f"symsde {report.versions.get('version', '?')}",
            "history": f"{made['date']} {made['command']}".strip(),
            **made,
            **({"scene": self.scene} if self.scene else {}),
        }

    @functools.cached_property
    def report(self) -> Report:
        """How the run was computed: stepper, what was left out, counters, failures, timings and versions."""
        report = dataclasses.replace(make_report(self._reported), temperature=self._temperature())
        repeated = self.setup.repeated_noise()
        return dataclasses.replace(report, warnings=(*report.warnings, repeated)) if repeated else report

    def _temperature(self) -> str:
        """What the report tells of the temperatures of a bath."""
        return ""


def of_growth(grown: int) -> str:
    """A warning about paths that grew beyond all bounds; empty if none did."""
    if not grown:
        return ""
    return (
        f"{checks.counted(grown, 'path')} grew 1e6-fold, in q and in p, beyond the largest of the start and of the "
        "state after a tenth of the steps: if the equations do not do that, the step is unstable; take a smaller one, "
        "or midpoint"
    )


def warn_of_growth(grown: int) -> None:
    """Warn if paths grew beyond all bounds."""
    if text := of_growth(grown):
        checks.warn(text, DoubtfulRunWarning)


def filled(result: Reported | None) -> Reported | None:
    """The result if the library has filled its arrays, however the run ended; else None."""
    has_report = result is not None and (result._reported is not None or "report" in result.__dict__)
    return result if has_report else None


def read_report(text: str) -> Report:
    """Read a report from its form in files; entries that an older version did not write are None."""
    given = json.loads(text)
    fields = {field.name: given.get(field.name) for field in dataclasses.fields(Report)}
    return Report(**{name: tuple(x) if isinstance(x, list) else x for name, x in fields.items()})


def make_report(given: abi.Report) -> Report:
    """Convert a report of the C interface."""
    left_out = given.left_out.decode("utf-8", "replace")
    return Report(
        outcome=handles.status_text(given.status),
        status=given.status,
        stepper=given.stepper.decode("utf-8", "replace"),
        correction=abi.CORRECTIONS[given.correction],
        damping=given.damping.decode("utf-8", "replace"),
        left_out=tuple(part for part in left_out.split("; ") if part),
        warnings=tuple(given.warnings.decode("utf-8", "replace").splitlines()),
        functionals=tuple(given.functionals.decode("utf-8", "replace").split(" and ")) if given.functionals else (),
        counters={name: getattr(given, name) for name in abi.COUNTERS},
        failed=given.failed,
        stopped=given.stopped,
        grown=given.grown,
        threads=given.threads,
        lanes=given.lanes,
        lost_variance=given.lost_variance,
        timings={"setup": given.seconds_setup, "run": given.seconds_run},
        lapack=given.lapack.decode("utf-8", "replace"),
        versions=build_info(),
    )
