# SPDX-License-Identifier: BSD-3-Clause
"""Fixed points and cycles of the map of a step, against results worked out by hand."""

import cmath
import math

import numpy as np
import pytest
import symsde as ss
from symsde.studies.stability import bifurcation, fixed_points, one_step_map
from symsde.studies.stability.systems import double_well


@pytest.mark.parametrize("box", [(2.0, 0.5), (0.1, 30.0)])
def test_starts_are_everywhere_in_the_box(box):
    cells, _, _ = np.histogram2d(*one_step_map._starts(box), bins=4, range=[(-x, x) for x in box])
    assert cells.min() > 0


def test_multipliers_of_a_turn():
    """Midpoint rotates by 2 atan(h/2) about rest; Heun's multipliers have modulus (1 + h^4/4)^(1/2)."""
    pendulum, h = ss.models.pendulum(sigma=0.0), 0.7
    for scheme, expected, stable in (
        ("midpoint", cmath.exp(2j * math.atan(h / 2)), True),
        ("stormer_verlet", complex(1 - h**2 / 2, math.sqrt(1 - (1 - h**2 / 2) ** 2)), True),
        ("heun", complex(1 - h**2 / 2, h), False),
    ):
        rest = [x for x in fixed_points(pendulum, scheme, step=h, box=(2, 2)) if abs(x.q) < 1]
        assert len(rest) == 1 and abs(rest[0].q) + abs(rest[0].p) < 1e-8
        found = max(rest[0].multipliers, key=lambda one: one.imag)
        assert found == pytest.approx(expected, abs=1e-8)
        assert rest[0].stable is stable and not rest[0].spurious and rest[0].period == 1


def test_the_cycle_of_kicks_doubles_the_period_at_two():
    """The cycle q = -q' has sin q/q = 4/h^2: it exists from h = 2 on, and is stable until cos q = 0, h = sqrt(2 pi)."""
    pendulum = ss.models.pendulum(sigma=0.0)
    for h, count in ((1.99, 0), (2.02, 2), (2.49, 2)):
        cycles = fixed_points(pendulum, "stormer_verlet", step=h, period=2, box=(3, 3))
        assert len(cycles) == count
        for point in cycles:
            assert math.sin(point.q) / point.q == pytest.approx(4 / h**2, abs=1e-9)
            assert point.stable and point.spurious and point.period == 2
    beyond = fixed_points(pendulum, "stormer_verlet", step=2.53, period=2, box=(3, 3))
    known = bifurcation.cycle_of_kicks("pendulum", 2.53)
    assert not next(x for x in beyond if abs(x.q - known) < 1e-6).stable


def test_a_cycle_beside_rest_is_of_the_scheme():
    """Just above h = 2 the cycle is so near rest, q = sqrt(6 (h - 2)), that its small force could pass for
    equilibrium.
    """
    cycles = fixed_points(ss.models.pendulum(sigma=0.0), "stormer_verlet", step=2 + 5e-5, period=2, box=(30, 30))
    near = [x for x in cycles if abs(x.q) < 1]
    assert [x.q for x in near] == pytest.approx([-math.sqrt(3e-4), math.sqrt(3e-4)], rel=1e-4)
    assert all(x.spurious for x in near)


@pytest.mark.parametrize("scheme", ["midpoint", "gauss2"])
@pytest.mark.parametrize("h", [0.7, 1.6])
def test_midpoint_and_gauss_rest_where_the_equation_does(scheme, h):
    """Midpoint and gauss2 rest in the wells and on the hill of the double well; the multipliers at the hill are
    real.
    """
    found = fixed_points(double_well(), scheme, step=h, box=(2, 2))
    assert [round(x.q, 6) for x in found] == [-1.0, 0.0, 1.0] and not any(x.spurious for x in found)
    assert [x.stable for x in found] == [True, False, True]


def test_orbits_of_the_hardening_spring_are_lost_before_the_limit():
    """Verlet from q = 1 loses its orbits early: linear theory allows h = 2, but the frequency at q = 1 is twice that
    at rest.
    """
    assert bifurcation.stays_up_to("stormer_verlet", 1.0) == pytest.approx(0.9, abs=0.06)
    assert bifurcation.lost("symplectic_euler", 0.75) and not bifurcation.lost("symplectic_euler", 0.65)


def test_a_box_has_a_width_and_a_height():
    """The double well has equilibria q = -1, 0, 1: a tall and narrow box contains one of them."""
    found = [fixed_points(double_well(), "midpoint", step=0.7, box=box) for box in ((0.5, 2), (2, 0.5))]
    assert [[round(x.q, 6) for x in points] for points in found] == [[0.0], [-1.0, 0.0, 1.0]]


def test_the_table_says_what_was_found():
    """The table's wording of numbers: none, up to, all; from."""
    curves = {
        "stays": {name: [0.0, 0.9, 3.35] for name in bifurcation.SCHEMES},
        "appears": {"hardening spring": dict.fromkeys(bifurcation.SCHEMES, 0.494),
                    "pendulum": dict.fromkeys(bifurcation.SCHEMES, None)},
        "moments": dict.fromkeys(bifurcation.SCHEMES, None) | {"midpoint": 3.3, "gauss2": 3.35},
    }  # fmt: skip
    rows = {row[0]: row[1:] for row in bifurcation.table(curves)}
    assert rows["`stormer_verlet`"] == ["2", "none", "up to 0.9", "all", "from 0.49", "none up to 3.4", "-"]
    assert rows["`midpoint`"][0] == "every step" and rows["`heun`"][0] == "no step"
    assert rows["`midpoint`"][-1] == "up to 3.3" and rows["`gauss2`"][-1] == "all"
    assert len(bifurcation.HEAD) == 8


@pytest.mark.parametrize(
    ("change", "error", "words"),
    [
        ({"model": ss.models.henon_heiles()}, ss.errors.IncompatibleError, "one degree of freedom"),
        ({"model": ss.models.pendulum(sigma=0.5)}, ss.errors.IncompatibleError, "strength zero"),
        ({"model": 3}, ss.errors.WrongTypeError, "is no model"),
        ({"step": 0.0}, ss.errors.InvalidArgumentError, "step = 0"),
        ({"step": math.nan}, ss.errors.InvalidArgumentError, "step"),
        ({"period": 0}, ss.errors.InvalidArgumentError, "period = 0"),
        ({"period": 1.5}, ss.errors.InvalidArgumentError, "integer"),
        ({"box": (1, -1)}, ss.errors.InvalidArgumentError, "positive"),
        ({"box": 3}, ss.errors.InvalidArgumentError, "positive"),
        ({"box": ("a", "b")}, ss.errors.InvalidArgumentError, "positive"),
        ({"box": (1, np.inf)}, ss.errors.InvalidArgumentError, "positive"),
        ({"scheme": "verlet"}, ss.errors.UnknownNameError, "verlet"),
    ],
)
def test_misuse_gets_a_sentence(change, error, words):
    given = {"model": ss.models.pendulum(sigma=0.0), "scheme": "midpoint", "step": 0.1, **change}
    with pytest.raises(error, match=words):
        fixed_points(given.pop("model"), given.pop("scheme"), **given)
