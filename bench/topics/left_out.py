# SPDX-License-Identifier: BSD-3-Clause
"""Computations that runs leave out, by their counters."""

import symsde as ss

from .tools import Setting, table, words

COUNTERS = {
    "normals": "normals",
    "gradients": "gradients",
    "hessians": "Hessians",
    "iterations": "iterations",
    "solves": "solves",
}
#: claim -> the counters that it fixes, for a step of a path
CLAIMS = {
    "explicit_calls_no_solver": {"iterations": 0, "solves": 0, "hessians": 0},
    "Ito_drift_calls_no_solver": {"iterations": 0, "solves": 0, "hessians": 1},  # counts of the Ito drift
    "sigma_zero_draws_nothing": {"normals": 0},
    "one_noise_silent_draws_one": {"normals": 1},
    "linear_iterates_once": {"iterations": 1, "solves": 1},
}
#: claim, model, scheme, and parameters
ROWS = (
    ("explicit_calls_no_solver", "additive_oscillator", "symplectic_euler", {}),
    ("explicit_calls_no_solver", "additive_oscillator", "symplectic_euler_adjoint", {}),
    ("explicit_calls_no_solver", "synchrotron", "symplectic_euler", {}),
    ("explicit_calls_no_solver", "synchrotron", "stormer_verlet", {}),
    ("explicit_calls_no_solver", "fpu_chain", "stormer_verlet", {}),
    ("explicit_calls_no_solver", "kubo", "heun", {}),
    ("Ito_drift_calls_no_solver", "kubo", "euler_maruyama", {}),
    ("sigma_zero_draws_nothing", "kubo", "midpoint", {"sigma": 0}),
    ("sigma_zero_draws_nothing", "linear_oscillator", "midpoint", {"sigma": 0}),
    ("sigma_zero_draws_nothing", "synchrotron", "midpoint", {"sigma1": 0, "sigma2": 0}),
    ("sigma_zero_draws_nothing", "pendulum", "symplectic_euler", {"sigma": 0}),
    ("sigma_zero_draws_nothing", "fpu_chain", "midpoint", {"sigma": 0}),
    ("one_noise_silent_draws_one", "synchrotron", "midpoint", {"sigma1": 0}),
    ("linear_iterates_once", "kubo", "midpoint", {}),
    ("linear_iterates_once", "linear_oscillator", "midpoint", {}),
    ("linear_iterates_once", "additive_oscillator", "gauss2", {}),
    ("linear_iterates_once", "fpu_chain", "midpoint", {"beta": 0}),
)
RUN = {"q0": 0.1, "p0": 0.0, "step": 0.02, "steps": 10, "paths": 260, "threads": 1}  #: a full block and a padded one


def measure(_setting: Setting) -> list[dict]:
    """Read the counters of every row and compare them with the claim."""
    found = []
    for claim, model, scheme, parameters in ROWS:
        counters = ss.simulate(ss.models.get(model, **parameters), scheme=scheme, **RUN).report.counters
        each = {name: counters[name] / counters["path_steps"] for name in COUNTERS}
        holds = all(each[name] == count for name, count in CLAIMS[claim].items())
        row = {"claim": claim, "model": model, "scheme": scheme, "counts": list(each.values())}
        found.append(row | {"verdict": "ok" if holds else "FAILED"})
    return found


def section(found: list[dict]) -> str:
    """Write the section."""
    rows = [
        [words(c["claim"]), c["model"], c["scheme"], *(f"{count:g}" for count in c["counts"]), c["verdict"]]
        for c in found
    ]
    heads = ["claim", "model", "scheme", *COUNTERS.values(), "verdict"]
    return (
        "## What is left out\n\n"
        "The counters show, for a step of a path, what the library skips because a problem does not need it.\n\n"
        + table(heads, rows)
    )
