# SPDX-License-Identifier: BSD-3-Clause
"""The results of one experiment of the paper, and its figures: half a page wide, as a PNG with a PDF beside it."""

from dataclasses import dataclass, field
from functools import partial

import symsde as ss

from ...show import look
from ..expectations import Expectations


@dataclass
class Experiment(Expectations):
    """One experiment: its expectations by equations of the paper; parameters and `numbers` go to results.json."""

    seed: int = 0
    parameters: dict = field(default_factory=dict)
    numbers: dict = field(default_factory=dict)


panels = partial(look.panels, width=5.5, dpi=200, pdf=True)  # width in inches, dots per inch


def strong_order(experiment, about, case, model, scheme, *, paths, levels, time, seed, **start):
    """Measure errors at 2^level steps on the same paths against the exact solution, and expect order one."""
    steps = [2**level for level in levels]
    found = ss.convergence(model, scheme, horizon=time, steps=steps, paths=paths, seed=seed, reference="exact", **start)
    text = f"strong order, 95 % interval +- {found.order_high - found.order:.3f}, {len(steps)} steps{case}"
    experiment.near(about, text, found.order, 1.0, 0.05)
    return {
        "order": found.order, "order_interval": [found.order_low, found.order_high], "order_steps": found.step,
        "order_rms_errors": found.error,
    }  # fmt: skip
