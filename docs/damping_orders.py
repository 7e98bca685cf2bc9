# SPDX-License-Identifier: BSD-3-Clause
"""Strong orders of every scheme for every kind of damping, or why it is refused: the table of docs/damping.md.

    .venv/bin/python docs/damping_orders.py      measures, writes docs/damping_orders.json, then the page

Errors are those of 40 paths over 8 and 32 steps to the same time, against chin4a_strong2 at 1024 steps on the same
paths; an order is the slope between the two. `tests/python/test_damping_orders.py` measures all pairs again.
"""

import functools
import json
import sys
import warnings
from pathlib import Path

import numpy as np
import symsde as ss
from symsde.show.tables import markdown

TARGET = Path(__file__).with_name("damping_orders.json")
KINDS = {"one rate": 0.8, "rates": [0.5, 1.5], "matrix": [[0.9, -0.5], [-0.5, 1.6]],
         "gamma(t)": "0.8 + 0.7*sin(3*t)",
         "gamma_i(q, t)": ["1 + 0.8*sin(q1 - q2 + t)", "0.5 + 0.4*cos(q2 + 2*t)"]}  # fmt: skip
CLASSES = {
    "additive": ("-0.5*q1", "-0.4*q2 + 0.1*q1"),
    "position": ("0.3*sin(q1) + 0.1*q2", "0.2*q1*q2"),
}
COARSE, FINE, FINEST, PATHS = 3, 5, 10, 40  #: powers of two: steps of the two errors and of the reference
#: H, and one with a linear part that turns each degree of freedom, for schemes that need its frequencies
H = "(p1**2 + p2**2)/2 + cos(q1 - q2) + q1**4/4 + q2**2"
_TURNED = "(p1**2 + p2**2)/2 + q1**2/2 + q2**2 + q1**4/4 + q1**2*q2**2/2"
_BY_FREQUENCY = ("exact_rotation", "gauss_dkdkd_rotation")


def formula_for(scheme):
    """The Hamiltonian that a scheme is measured on."""
    return _TURNED if scheme in _BY_FREQUENCY else H


@functools.cache
def model(kind, noises, formula=H):
    """Two degrees of freedom, coupled and nonlinear, of mass one."""
    return ss.model_from_sympy(formula, noise=list(CLASSES[noises])).damped(KINDS[kind])


def ends(kind, noises, formula, scheme, power):
    """Final states of a scheme at 2^power steps."""
    steps = 2**power
    run = ss.simulate(model(kind, noises, formula), scheme=scheme, q0=[0.7, -0.2], p0=0.3, step=1 / steps, seed=3,
                      steps=steps, save_every=steps, paths=PATHS, refine=FINEST - power, threads=1)  # fmt: skip
    return np.concatenate([run.q[-1], run.p[-1]])


@functools.cache
def reference(kind, noises, formula):
    """States that others are compared with."""
    return ends(kind, noises, formula, "chin4a_strong2", FINEST)


def measured(scheme, kind, noises):
    """The slope of errors, or the sentence with which a scheme is refused, from its name on."""
    how = kind, noises, formula_for(scheme)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            found = [ends(*how, scheme, power) - reference(*how) for power in (COARSE, FINE)]
        except ss.errors.IncompatibleError as error:
            said = str(error).partition(f"scheme {scheme} ")[2]
            return said.partition(":")[0].partition(";")[0]
    coarse, fine = (np.sqrt(np.mean(np.sum(x**2, axis=0))) for x in found)
    return round(float(np.log2(coarse / fine)) / (FINE - COARSE), 2)


def measure():
    """All pairs of scheme and kind, with both classes of noise."""
    return {
        scheme: {kind: {noises: measured(scheme, kind, noises) for noises in CLASSES} for kind in KINDS}
        for scheme in ss.schemes.names()
    }


def parts():
    """Of the page: orders of the schemes that run, and reasons of those that are refused for every kind."""
    rows, refused = [], {}
    for scheme, kinds in json.loads(TARGET.read_text(encoding="utf-8")).items():
        cells = [_cell(kind) for kind in kinds.values()]
        if set(cells) == {"refused"}:
            refused.setdefault(kinds["one rate"]["additive"], []).append(scheme)
        else:
            rows.append([f"`{scheme}`", *cells])
    head = ["scheme", *(f"`{kind}`" if "gamma" in kind else kind for kind in KINDS)]
    reasons = [f"- {', '.join(f'`{x}`' for x in schemes)}: {reason}" for reason, schemes in refused.items()]
    return {"schemes": "\n\n".join((markdown(head, rows).strip(), "Refused for every kind:", "\n".join(reasons)))}


def _cell(kind):
    """The orders of a scheme for one kind of damping."""
    if isinstance(kind["additive"], str):
        return "refused"
    return ", ".join("-" if isinstance(x, str) else f"{x:.1f}" for x in kind.values())


if __name__ == "__main__":
    TARGET.write_text(json.dumps(measure(), indent=1) + "\n", encoding="utf-8")
    import generate

    sys.exit(generate.main())
