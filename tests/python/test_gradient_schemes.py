# SPDX-License-Identifier: BSD-3-Clause
"""Every scheme has derivatives that are right to 1e-9 of differences, or is refused with a reason."""

import sys
from pathlib import Path

import numpy as np
import pytest
import symsde as ss

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "docs"))
import gradient_schemes as table

STENCIL = ((1, 3 / 4), (2, -3 / 20), (3, 1 / 60))  #: a central difference of sixth order
SIZE = 3e-3


def squares(noise, run, **values):
    """q^2 of each path at the end, by the run itself."""
    return ss.simulate(table.model(noise, **values), **run).last_q[0] ** 2


def difference(noise, name, run):
    """The derivative of q^2 of each path by a parameter or by q0."""
    total = 0
    for k, weight in STENCIL:
        for sign in (1, -1):
            moved = sign * k * SIZE
            if name == "q0":
                found = squares(noise, run | {"q0": run["q0"] + moved})
            else:
                found = squares(noise, run, **{name: {"k": 1.3, "sigma": 0.4}[name] + moved})
            total = total + sign * weight * found / SIZE
    return total


@pytest.mark.parametrize("scheme", ss.schemes.names())
def test_exact_or_refused(scheme):
    """For all kinds of noise gradients equal differences of runs, and tangent maps have the derivatives of the
    gradients.
    """
    for noise in table.CLASSES:
        said = table.cell(scheme, noise)
        if said != table.EXACT:
            assert said == "-" or len(said) > 20, said
            continue
        run = table.RUN | {"scheme": scheme}
        found = ss.gradient(table.model(noise), "q**2", ["k", "sigma", "q0"], **run)
        assert np.array_equal(found.f, squares(noise, run))
        for name in ("k", "sigma", "q0"):
            right = difference(noise, name, run)
            assert abs(found.by_path[name].ravel() - right).max() < 1e-9 * abs(right).max(), (noise, name)
        maps = ss.tangent(table.model(noise), ["k", "sigma"], **run)
        for name, x in (("k", maps.by["k"][0]), ("sigma", maps.by["sigma"][0]), ("q0", maps.matrix[0, 0])):
            np.testing.assert_allclose(2 * maps.q[0] * x, found.by_path[name].ravel(), rtol=1e-10)
        if ss.schemes.get(scheme).info.symplectic:
            assert maps.defect().max() < 1e-13


def test_some_are_exact():
    """The table has schemes with exact derivatives, not refusals alone."""
    cells = {scheme: table.cell(scheme, "position") for scheme in ("stormer_verlet", "midpoint", "gauss2", "lobatto4")}
    assert set(cells.values()) == {table.EXACT}
