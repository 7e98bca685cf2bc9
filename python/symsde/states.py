# SPDX-License-Identifier: BSD-3-Clause
"""Initial states drawn from a law, by seed and path, in the place of q0, of p0, or of both.

    bunch = ss.states.normal(mean=0.0, sd=0.1)
    run = ss.simulate(model, q0=bunch, p0=bunch, step=0.05, steps=200, paths=1000, seed=1)
    q, p = bunch.draw(model, paths=1000, seed=1)       # the same states as arrays, (dof, path)

One law given as q0 and p0 draws both together. The state of a path is a function of the law, the seed and the index of
the path: any threads, shards and first_path give the same bits, and no noise depends on it.
"""

from .run.states.affine import normal, uniform
from .run.states.beam import canonical, matched
from .run.states.formula import formula
from .run.states.law import States
from .run.states.table import table

__all__ = ["States", "canonical", "formula", "matched", "normal", "table", "uniform"]
