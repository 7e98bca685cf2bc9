# SPDX-License-Identifier: BSD-3-Clause
"""Measure the strong orders that schemes claim, by class of noise, into python/symsde/measured.json.

Root-mean-square distance at T = 1 from a reference on the same Brownian paths, seven steps that halve, slopes of 20
batches of paths: their mean and its 95 % half-width. The reference is exact for Kubo, elsewhere a scheme of higher
order at an eighth of the finest step. Schemes that a model refuses are tried on the next one of the class; steps whose
errors are rounding are left out.
"""

import json
from pathlib import Path

import numpy as np
import symsde as ss
from symsde import tables

FILE = Path(ss.__file__).with_name("measured.json")
BATCHES, LEVELS, SEED, STATE = 20, 7, 11, {"q0": 0.9, "p0": 0.4}
T95 = 2.093  # Student, 19 degrees of freedom
ROUNDING = 1e-13

# class of noise: problems (model, parameters), coarsest level, reference and how many levels finer, paths
CLASSES = {
    "additive noise": (
        [("fpu_chain", {"n": 1, "beta": 1.0, "sigma": 1.0}), ("henon_heiles", {})],
        3, "gauss2_strong32", 3, 1000,
    ),
    "commutative": (
        [("pendulum", {"sigma": 0.5}), ("synchrotron", {"omega": 1.0, "sigma1": 2.0, "sigma2": 1.0})],
        3, "gauss2_strong32", 3, 1000,
    ),
    "general": ([("noncommutative_oscillator", {"s1": 1.0, "s2": 1.0})], 2, "gauss2_strong32_areas", 3, 400),
    "commuting flows": ([("kubo", {"a": 1.0, "sigma": 0.5})], 3, None, 0, 1000),
}  # fmt: skip
references = {}


def final_state(model, scheme, level, finest, paths):
    """States (2, path) at T = 1 after 2^level steps, on the paths of the finest level."""
    options = {"step": 2.0**-level, "steps": 2**level, "save_every": 2**level, "refine": finest - level}
    run = ss.simulate(model, scheme=scheme, seed=SEED, paths=paths, **STATE, **options)
    return run, np.stack([run.q[-1, 0], run.p[-1, 0]])


def reference_of(name, parameters, kind, finest):
    """The reference of a problem, computed once."""
    _, _, scheme, _, paths = CLASSES[kind]
    if (name, kind) not in references:
        model = ss.models.get(name, **parameters)
        run, state = final_state(model, scheme or "midpoint", finest, finest, paths)
        if scheme is None:
            state = np.stack([x[-1, 0] for x in ss.diagnose.exact(run)])
        references[name, kind] = state
    return references[name, kind]


def measure(scheme, kind, paths=None):
    """(problem, order, half-width), or None where every model of the class refuses the scheme."""
    problems, coarsest, _, finer, all_paths = CLASSES[kind]
    finest = coarsest + LEVELS - 1 + finer
    paths = paths or all_paths
    for name, parameters in problems:
        model = ss.models.get(name, **parameters)
        levels = np.arange(coarsest, coarsest + LEVELS)
        try:
            states = [final_state(model, scheme, int(level), finest, paths)[1] for level in levels]
        except ss.errors.IncompatibleError:
            continue
        squares = np.square(np.stack(states) - reference_of(name, parameters, kind, finest)[:, :paths]).sum(axis=1)
        squares = squares[:, np.isfinite(squares).all(axis=0)]
        seen = squares.mean(axis=1) > ROUNDING**2
        batches = np.array_split(squares[seen], BATCHES, axis=1)
        slopes = [np.polyfit(-levels[seen], np.log2(batch.mean(axis=1)) / 2, 1)[0] for batch in batches]
        return name, float(np.mean(slopes)), float(T95 * np.std(slopes, ddof=1) / np.sqrt(BATCHES))
    return None


def measure_missing():
    """Measure every claim that the file lacks, and forget schemes that are gone."""
    known = json.loads(FILE.read_text(encoding="utf-8")) if FILE.exists() else {}
    found = {}
    for name in (*ss.schemes.names(), *tables.FAMILIES):
        claims = tables.strong_orders(tables.certified(ss.schemes.get(name)))
        found[name] = known.get(name, {})
        for kind in claims:
            if claims[kind] > 0 and kind not in found[name]:
                row = measure(name, kind)
                found[name][kind] = row and [row[0], round(row[1], 3), round(row[2], 3)]
                print(f"{name:26s} {kind:16s} {found[name][kind]}", flush=True)
    lines = (f" {json.dumps(name)}: {json.dumps(row)}" for name, row in found.items())
    FILE.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")


if __name__ == "__main__":
    measure_missing()
