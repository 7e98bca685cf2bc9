# SPDX-License-Identifier: BSD-3-Clause
"""Every experiment of the paper [WHSB] with one command, `symsde paper`: a table, results.json and figures.

[WHSB] is "Dynamics and variational integrators of stochastic Hamiltonian systems"; numbers in parentheses are its
equations. One module an experiment, each with `run(quick)` and `draw(experiment, directory)`; they use the public
interface of symsde only, so that each can be read as an example.
"""

import json
from time import perf_counter

import symsde as ss

from .. import _files
from . import euler_lagrange, figure_4_1, figure_4_2, kubo, linear_oscillator, symplecticity
from .experiment import plain
from .table import print_block, print_summary

EXPERIMENTS = (kubo, linear_oscillator, figure_4_1, figure_4_2, symplecticity, euler_lagrange)


def run(out, quick=False):
    """Run all experiments, write into the directory `out`, print the table; 0, or 1 if an expectation failed."""
    with _files.folder(out) as directory:
        return _run(directory, quick)


def _run(directory, quick):
    build = _build()
    print(f"symsde {build['version']}, {build['compiler']}: the experiments of [WHSB]{' (quick)' if quick else ''}")
    begin = perf_counter()
    experiments = []
    for module in EXPERIMENTS:
        start = perf_counter()
        experiment = module.run(quick)
        module.draw(experiment, directory)
        print_block(experiment, perf_counter() - start)
        experiments.append(experiment)
    results = {experiment.name: _record(experiment, build, quick) for experiment in experiments}
    text = json.dumps(plain(results), indent=1, allow_nan=False) + "\n"
    _files.replace(directory / "results.json", lambda part: part.write_text(text, encoding="utf-8"))
    print_summary(experiments, directory, perf_counter() - begin)
    return int(any(check.passed is False for experiment in experiments for check in experiment.checks))


def _record(experiment, build, quick):
    return {
        "seed": experiment.seed,
        **build,
        "quick": quick,
        "parameters": experiment.parameters,
        **experiment.numbers,
        "checks": [vars(check) for check in experiment.checks],
    }


def _build():
    """Version and compiler of the library that computed the numbers."""
    info = ss.build_info()
    return {"version": info["version"], "compiler": info["compiler"]}
