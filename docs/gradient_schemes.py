# SPDX-License-Identifier: BSD-3-Clause
"""Which schemes have exact derivatives, by kind of noise, or why not: the table of docs/gradients.md.

`tests/python/test_gradient_schemes.py` compares the derivatives of every cell with differences.
"""

import functools
import re

import symsde as ss
from symsde.errors import SymsdeError
from symsde.show.tables import markdown

CLASSES = {"additive": "-sigma*q", "position": "sigma*sin(q)", "general": "sigma*q*p"}
RUN = {"q0": 0.7, "p0": 0.3, "step": 0.1, "steps": 10, "paths": 4, "seed": 3}
EXACT = "exact"


@functools.cache
def model(noise, k=1.3, sigma=0.4):
    """An oscillator, nonlinear, with one noise."""
    return ss.model_from_sympy("p**2/2 + k*q**2/2 + q**4/8", [CLASSES[noise]], params={"k": k, "sigma": sigma})


def cell(scheme, noise):
    """Whether derivatives are exact; "-" where the scheme takes no such noise; or why there are none."""
    run = RUN | {"scheme": scheme}
    try:
        ss.simulate(model(noise), **run)
    except SymsdeError:
        return "-"
    try:
        ss.gradient(model(noise), "q**2", ["k", "sigma", "q0"], **run)
    except SymsdeError as refusal:
        why = re.search(r"is known: (?:scheme \w+ )?(.*?);", str(refusal))
        return why[1] if why else str(refusal)
    return EXACT


def parts():
    """The table of the page."""
    rows = [[f"`{scheme}`", *(cell(scheme, noise) for noise in CLASSES)] for scheme in ss.schemes.names()]
    return {"schemes": markdown(["scheme", "additive", "in position", "in p, too"], rows).strip()}
