# SPDX-License-Identifier: BSD-3-Clause
"""Levy areas on the path and in law: orders in every unit of time, and refusals."""

import numpy as np
import pytest
import symsde as ss
from symsde import errors

SCHEMES = ("midpoint_areas", "gauss2_strong32_areas")


def noncommuting(unit: float) -> ss.Model:
    """H = p^2/2 - cos q, H_1 = -0.8 cos p, H_2 = 0.3 q^2 in another unit of time: H times unit, noises times
    sqrt(unit).
    """
    root = np.sqrt(unit)

    def gradient(t, w, q, p):
        return unit * w[0] * np.sin(q) + 0.6 * root * w[2] * q, unit * w[0] * p + 0.8 * root * w[1] * np.sin(p)

    def hessian(t, w, q, p):
        hqq, hpp = unit * w[0] * np.cos(q) + 0.6 * root * w[2], unit * w[0] + 0.8 * root * w[1] * np.cos(p)
        return hqq[None], 0 * hqq[None], hpp[None]

    return ss.Model(ndof=1, nnoise=2, gradient=gradient, hessian=hessian, separable=True)


def final(model: ss.Model, scheme: str, level: int, unit: float = 1.0, *, paths: int, **options: object) -> np.ndarray:
    """State (q, p) of every path after 2^level steps to the time 1/unit."""
    steps = 2**level
    given = {"q0": 0.4, "p0": 0.7, "seed": 3, "paths": paths, "step": 1 / steps / unit, "steps": steps}
    run = ss.simulate(model, scheme=scheme, save_every=steps, **given, **options)
    assert not run.status.any()
    return np.stack([run.q[-1, 0], run.p[-1, 0]])


def rms(difference: np.ndarray) -> float:
    return float(np.sqrt((difference**2).sum(axis=0).mean()))


@pytest.mark.parametrize("options", [{}, {"areas": "law"}])
@pytest.mark.parametrize("scheme", SCHEMES)
def test_areas_do_not_depend_on_the_unit_of_time(scheme: str, options: dict):
    """The same states in any unit of time."""
    same = final(noncommuting(1.0), scheme, 4, paths=30, **options)
    for unit in (1e-3, 1e3):
        assert np.allclose(final(noncommuting(unit), scheme, 4, unit, paths=30, **options), same, rtol=0, atol=1e-10)


def test_the_time_scale_says_how_finely_areas_follow_the_path():
    """A time scale that is too small gives one parabola a step; with a larger time scale areas are nearer to the areas
    of the path.
    """
    model = noncommuting(1.0)
    exact = final(model, "midpoint_areas", 4, paths=60, area_time=1e4)
    apart = [rms(final(model, "midpoint_areas", 4, paths=60, area_time=tau) - exact) for tau in (1e-3, 8.0, 200.0)]
    assert apart[0] > 2 * apart[1] > 8 * apart[2] > 0


@pytest.mark.parametrize("unit", [1e-3, 1e3])
def test_areas_by_the_path_give_strong_order_one_at_refine_zero(unit: float):
    """Steps with areas as drawn are compared with halved steps on the same path. Slopes measured in each unit: 0.97
    and 1.01; 0.54 without areas.
    """
    model = noncommuting(unit)
    levels, halvings = [2, 3, 4], 4
    apart = {scheme: [] for scheme in (*SCHEMES, "midpoint")}
    for level in levels:
        exact = final(model, "gauss2_strong32_areas", level + halvings, unit, paths=80, refine=-halvings)
        for scheme, found in apart.items():
            found.append(rms(final(model, scheme, level, unit, paths=80) - exact))
    slopes = {scheme: -np.polyfit(levels, np.log2(found), 1)[0] for scheme, found in apart.items()}
    assert all(abs(slopes[scheme] - 1) < 0.2 for scheme in SCHEMES), slopes
    assert slopes["midpoint"] < 0.7, slopes


def distance_of_laws(one: np.ndarray, other: np.ndarray) -> float:
    """Wasserstein distance of order two between two samples (2, path) in the plane, over eight directions."""
    angles = np.arange(8) * np.pi / 8
    seen = [np.stack([np.cos(a) * x[0] + np.sin(a) * x[1] for a in angles]) for x in (one, other)]
    return float(np.sqrt(np.mean((np.sort(seen[0]) - np.sort(seen[1])) ** 2)))


def test_areas_in_law_give_order_one_in_law():
    """The part of a step that dW does not determine, x minus midpoint's x for the same dW, has the right law. The
    distance of its law from the law for finer steps on other paths, whose areas follow the path, is 0.030, 0.016,
    0.0079, slope 0.97. With area_time so small that each step is one parabola: 0.049, 0.034, 0.023, slope 0.57.
    """
    model = ss.models.noncommutative_oscillator(s1=1.0, s2=1.0)
    levels, finer, many = [2, 3, 4], 3, {"paths": 2**13}
    apart = {"law": [], "parabola": []}
    for level in levels:
        draws = {"area_time": 16 * 12 / 2 ** (level + finer), "first_path": 2**20, **many}  # 16 pieces a fine step
        given = final(model, "gauss2_strong32_areas", level + finer, **draws)
        given -= final(model, "midpoint", level, refine=finer, first_path=2**20, **many)
        plain = final(model, "midpoint", level, **many)
        for name, options in (("law", {"areas": "law"}), ("parabola", {"area_time": 1e-3})):
            found = final(model, "gauss2_strong32_areas", level, **many, **options) - plain
            apart[name].append(distance_of_laws(found, given))
    slopes = {name: -np.polyfit(levels, np.log2(found), 1)[0] for name, found in apart.items()}
    assert slopes["law"] > 0.8 and slopes["parabola"] < 0.72, (slopes, apart)
    assert apart["law"][-1] < 0.6 * apart["parabola"][-1], apart


@pytest.mark.parametrize(
    ("scheme", "options", "words"),
    [
        ("midpoint_areas", {"areas": "law", "refine": -1}, ["refine = -1", "no path"]),
        ("midpoint_areas", {"areas": "law", "area_time": 2.0}, ["area_time = 2", "one of the two"]),
        ("midpoint", {"areas": "law"}, ["midpoint", "draws none", "midpoint_areas"]),
        ("midpoint_areas", {"areas": "law", "refine": 1, "increments": np.zeros((8, 2))}, ["prescribed", "law"]),
        ("midpoint_areas", {"areas": "lwa"}, ["areas = 'lwa'", "law"]),
    ],
)
def test_areas_in_law_are_refused_where_they_make_no_sense(scheme: str, options: dict, words: list[str]):
    with pytest.raises(errors.SymsdeError) as refused:
        ss.simulate(ss.models.noncommutative_oscillator(), q0=0.4, p0=0.7, scheme=scheme, step=0.1, steps=4, **options)
    assert all(word in str(refused.value) for word in words), refused.value


def test_areas_in_law_are_accepted_where_the_model_needs_none():
    given = {"q0": 0.4, "p0": 0.7, "scheme": "midpoint_areas", "step": 0.1, "steps": 4, "seed": 2}
    law, path = (ss.simulate(ss.models.synchrotron(), areas=areas, **given) for areas in ("law", "path"))
    assert (law.q == path.q).all()
    assert law.setup.attributes()["options"] != path.setup.attributes()["options"]


def test_runs_with_areas_in_law_share_paths_and_resume():
    """With refine = l, areas are merged from the areas of finer steps; threads and the index of the first step change
    no bit."""
    model = ss.models.noncommutative_oscillator()
    given = {"scheme": "gauss2_strong32_areas", "areas": "law", "paths": 300}
    fine = final(model, "midpoint_areas", 9, areas="law", paths=300)
    apart = [
        rms(final(model, "midpoint_areas", level, areas="law", paths=300, refine=9 - level) - fine) for level in (4, 5)
    ]
    assert 1.6 < apart[0] / apart[1] < 2.5
    whole = ss.simulate(model, q0=0.4, p0=0.7, step=0.1, steps=6, seed=3, threads=2, **given)
    rest = ss.simulate(model, q0=whole.q[3], p0=whole.p[3], step=0.1, steps=3, first_step=3, t0=0.3, seed=3, **given)
    assert (rest.q[-1] == whole.q[-1]).all()
