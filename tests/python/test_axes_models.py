# SPDX-License-Identifier: BSD-3-Clause
"""The built-in models by every scheme that takes them, against its equations by NumPy: blocks, few paths, one path."""

import itertools

import axes
import numpy as np
import pytest
import reference
import symsde as ss
from test_axes_steps import BRACKETS, GALERKIN, KINDS, NO_GENERAL, ROWS, STEPS, TABLEAUS

Q, P, COS = [1, 0], [0, 1], np.pi / 2
OSCILLATOR = [(0, 2, 0.5, 0, 0, Q, 0), (0, 2, 0.5, 0, 0, P, 0)]
DRIVEN = [(0, "sin", -1.44, 0.3, 2.0, Q, COS), (1, 1, -0.4, 0.5, 2.0, Q, 0), (2, "sin", -0.3, 0.5, 2.0, Q, COS)]
#: kind of axes.TRAITS, model, noises, ridges of its Hamiltonians, frequencies that it declares
MODELS = {
    "kubo": ("separable", ss.models.kubo(1.2, 0.5), 1,
             [(j, 2, s / 2, 0, 0, a, 0) for j, s in ((0, 1.2), (1, 0.5)) for a in (Q, P)], None),
    "linear_oscillator": ("kick", ss.models.linear_oscillator(0.7), 1, [*OSCILLATOR, (1, 1, -0.7, 0, 0, Q, 0)], (1.0,)),
    "synchrotron": ("position", ss.models.synchrotron(1.3, 0.5, 0.4), 2,
                    [OSCILLATOR[1], (0, "sin", -1.69, 0, 0, Q, COS), (1, "sin", 0.5, 0, 0, Q, 0),
                     (2, "sin", -0.4, 0, 0, Q, COS)], (1.3,)),
    "additive_oscillator": ("both", ss.models.additive_oscillator(0.4, 0.6), 2,
                            [*OSCILLATOR, (1, 1, 0.4, 0, 0, P, 0), (2, 1, -0.6, 0, 0, Q, 0)], None),
    "pendulum": ("separable", ss.models.pendulum(0.4), 1,
                 [OSCILLATOR[1], (0, "sin", -1, 0, 0, Q, COS), (1, 2, 0.2, 0, 0, Q, 0), (1, 2, 0.2, 0, 0, P, 0)], None),
    "driven_pendulum": ("position", ss.models.driven_pendulum(1.2, 0.3, 2.0, sigma1=0.4, sigma2=0.3, alpha=0.5), 2,
                        [OSCILLATOR[1], *DRIVEN], (1.2,)),
    "driven, additive": ("kick", ss.models.driven_pendulum(1.2, 0.3, 2.0, sigma1=0.4, sigma2=0.0, alpha=0.5), 2,
                         [OSCILLATOR[1], *DRIVEN[:2]], (1.2,)),
    "noncommutative_oscillator": ("separable", ss.models.noncommutative_oscillator(0.6, 0.5), 2,
                                  [*OSCILLATOR, (1, 2, 0.3, 0, 0, P, 0), (2, 2, 0.25, 0, 0, Q, 0)], None),
}  # fmt: skip


def _henon_heiles():
    q, p = np.eye(4)[:2], np.eye(4)[2:]
    cubes = [(q[0] + q[1], 0.8 / 6), (q[0] - q[1], -0.8 / 6), (q[1], -1.6 / 3)]
    found = [(0, 2, 0.5, 0, 0, a, 0) for a in (*q, *p)] + [(0, 3, s, 0, 0, a, 0) for a, s in cubes]
    return [*found, (1, 1, 0.3, 0, 0, q[0], 0), (2, 1, 0.2, 0, 0, q[1], 0)]


def _fpu_chain(n):
    q, p = np.eye(2 * n)[:n], np.eye(2 * n)[n:]
    springs = [b - a for a, b in itertools.pairwise([0 * q[0], *q, 0 * q[0]])]
    found = [(0, 2, 0.5, 0, 0, a, 0) for a in p] + [
        (0, f, s, 0, 0, a, 0) for a in springs for f, s in ((2, 0.5), (4, 0.2))
    ]
    return found + [(k + 1, 1, -0.3, 0, 0, q[k], 0) for k in range(n)]


MODELS["henon_heiles"] = ("kick", ss.models.henon_heiles(0.8, 0.3, 0.2), 2, _henon_heiles(), (1.0, 1.0))
for _n in (1, 2, 3, 5):
    MODELS[f"fpu_chain of {_n}"] = ("kick", ss.models.fpu_chain(_n, 0.8, 0.3), _n, _fpu_chain(_n), None)


def ridges_of(name):
    _, _, nnoise, ridges, _ = MODELS[name]
    found = reference.Ridges(len(ridges[0][5]) // 2, nnoise, ridges)
    if name.startswith("driven"):
        found.phase = np.where(found.j == 0, COS, 0.0)[:, None]
    return found


TURNS = ("exact_rotation", "gauss_dkdkd_rotation")
PAIRS = [
    (x, s) for x, (kind, *_, omega) in MODELS.items() for s in KINDS if kind in KINDS[s] and (omega or s not in TURNS)
]
ROUND = axes.covering(sign=(1, -1), first_step=(0, 7), first_path=(0, 2**31 + 5), size=(0.05, 0.2))
CASES = [(*pair, row) for pair, row in zip(PAIRS, itertools.cycle(ROUND))]


@pytest.mark.parametrize(("name", "scheme", "row"), CASES, ids=[f"{x}-{s}-{axes.ident(row)}" for x, s, row in CASES])
def test_steps_of_built_in_models(name, scheme, row):
    _kind, model, nnoise, _, omega = MODELS[name]
    ridges, paths = ridges_of(name), 40
    h, t0, n = row["size"] * row["sign"], 0.35, ridges.ndof
    q0, p0 = axes.start(n, paths)
    rows = axes.rows_of(h, STEPS, ROWS, nnoise, paths)
    given = {"step": h, "steps": STEPS, "t0": t0, "scheme": scheme, "refine": 2}
    given |= {x: row[x] for x in ("first_step", "first_path")}
    run = ss.simulate(model, q0=q0, p0=p0, paths=paths, increments=rows, **given)
    x = np.concatenate([q0, p0])[:, :5]
    for i in range(STEPS):
        t, drive = t0 + (row["first_step"] + i) * h, reference.polygon(h, rows[ROWS * i : ROWS * (i + 1), :, :5])
        x = reference.step(scheme, ridges, t, drive, x, rotation=omega if scheme in TURNS else None)
        np.testing.assert_allclose(np.concatenate([run.q[i + 1], run.p[i + 1]])[:, :5], x, rtol=0, atol=4e-12)
    runs = [run]
    if scheme not in NO_GENERAL:
        runs.append(ss.simulate(model, q0=q0, p0=p0, paths=paths, increments=rows, general=True, **given))
        np.testing.assert_allclose([runs[1].q, runs[1].p], [run.q, run.p], rtol=0, atol=4e-12)
    for few in (1, 3):
        part = {"q0": q0[:, :few], "p0": p0[:, :few], "paths": few, "increments": rows[:, :, :few]}
        one = ss.simulate(model, **part, **given)
        np.testing.assert_array_equal([one.q, one.p], [run.q[:, :, :few], run.p[:, :, :few]])
    if scheme in TABLEAUS + GALERKIN:
        counts = [x.report.counters for x in runs]
        assert all(x["solves"] <= (1 if model.traits.quadratic else 6) * x["path_steps"] for x in counts)
    if scheme in BRACKETS and scheme.startswith("gauss2") and n == 1:  # second derivatives of brackets, too
        assert (
            run.report.counters["solves"] <= (1 if model.traits.quadratic else 3.1) * run.report.counters["path_steps"]
        )
