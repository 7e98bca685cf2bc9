# SPDX-License-Identifier: BSD-3-Clause
"""Every experiment of the paper [WHSB] with one command, `symsde paper`: a table, results.json and figures.

[WHSB] is "Dynamics and variational integrators of stochastic Hamiltonian systems"; numbers in parentheses are its
equations. One module an experiment, each with `run(quick)` and `draw(experiment, directory)`; they use the public
interface of symsde only, so that each can be read as an example.
"""

from functools import partial
from time import perf_counter

from ...native import files
from ...native.build import build_info
from .. import expectations, pages
from . import euler_lagrange, figure_4_1, figure_4_2, kubo, linear_oscillator, symplecticity

EXPERIMENTS = (kubo, linear_oscillator, figure_4_1, figure_4_2, symplecticity, euler_lagrange)
HEADING = """\
[WHSB]: L. Wang, J. Hong, R. Scherer, F. Bai, Int. J. Numer. Anal. Model. 6 (2009) 586-602. The first column names its
equations. "within 4.9 s.e." allows 4.9 standard errors of a mean; with the verdict "-" a number is shown only."""


def run(out, quick=False):
    """Run all experiments, write into the directory `out`, and print the table; return 0, or 1 if an expectation
    failed.
    """
    with files.folder(out) as directory:
        return _run(directory, quick)


def _run(directory, quick):
    print(f"{pages.made_by()}: every experiment of the paper [WHSB]{', with fewer paths (quick)' if quick else ''}")
    print(HEADING)
    begin = perf_counter()
    experiments = expectations.carry_out((partial(_one, x, quick, directory) for x in EXPERIMENTS), "equations")
    results = {experiment.name: _record(experiment, quick) for experiment in experiments}
    files.replace_text(directory / "results.json", files.json_text(results, digits=None, indent=1))
    print(f"\nwritten to {directory}: results.json and the figures; {perf_counter() - begin:.0f} s")
    print(expectations.summary(experiments))
    return int(expectations.count(experiments, False) > 0)


def _one(module, quick, directory):
    """Run one experiment, and draw its figure."""
    experiment = module.run(quick)
    module.draw(experiment, directory)
    return experiment


def _record(experiment, quick):
    """The entry of an experiment in results.json."""
    keys = ("equations", "quantity", "measured", "expected", "passed")
    return {
        "seed": experiment.seed,
        **{key: build_info()[key] for key in ("version", "compiler")},
        "quick": quick,
        "parameters": experiment.parameters,
        **experiment.numbers,
        "checks": [dict(zip(keys, vars(check).values(), strict=True)) for check in experiment.checks],
    }
