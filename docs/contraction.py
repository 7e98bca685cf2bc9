# SPDX-License-Identifier: BSD-3-Clause
"""The figure of docs/method/open-systems.md: what a step of a damped pendulum multiplies dp ^ dq by.

Factors are determinants of tangent maps, by differences of the library's own steps without noise at sixteen states.
"""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import symsde as ss
from symsde.show import look

STEP, SHIFT = 0.5, 1e-5
RATES = np.linspace(0.1, 3.0, 30) / STEP  #: z = gamma h up to 3
STATES = np.stack(np.meshgrid(np.linspace(-2.8, 2.8, 4), np.linspace(-1.5, 1.5, 4))).reshape(2, -1)  #: (q or p, point)
#: curve -> schemes, and whether friction is a force
CURVES = {
    "damping=, all symplectic schemes": (("midpoint", "gauss2", "stormer_verlet", "gauss_dkdkd", "chin4a"), False),
    "force, lobatto2": (("lobatto2",), True),
    "force, symplectic_euler": (("symplectic_euler",), True),
    "force, midpoint": (("midpoint",), True),
    "damping=, heun": (("heun",), False),
}
COLOURS = {"damping=, all symplectic schemes": look.BLACK, "force, lobatto2": look.colour("stormer_verlet"),
           "force, symplectic_euler": look.colour("symplectic_euler"), "force, midpoint": look.colour("midpoint"),
           "damping=, heun": look.colour("heun")}  # fmt: skip


def compute() -> dict:
    """For each curve the least and the largest factor over exp(-gamma h), by gamma h."""
    found = {}
    for curve, (schemes, forced) in CURVES.items():
        shares = np.array([[factors(x, rate, forced) * np.exp(rate * STEP) for x in schemes] for rate in RATES])
        found[curve] = [[float(f"{x:.7g}") for x in shares.min(axis=(1, 2))],
                        [float(f"{x:.7g}") for x in shares.max(axis=(1, 2))]]  # fmt: skip
    return {"z": [round(float(rate) * STEP, 12) for rate in RATES], "curves": found}


def factors(scheme: str, rate: float, forced: bool) -> np.ndarray:
    """Determinants of the tangent maps of a step, at each state."""
    bare = ss.models.pendulum(sigma=0.0)
    model = bare.forced(lambda q, p, t: -rate * p) if forced else bare.damped(rate)
    moved = [STATES + sign * SHIFT * np.eye(2)[:, [axis]] for axis in (0, 1) for sign in (1, -1)]
    starts = np.concatenate(moved, axis=1)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # gamma h is large on purpose
        run = ss.simulate(model, scheme=scheme, q0=starts[:1], p0=starts[1:], step=STEP, steps=1, paths=starts.shape[1],
                          threads=1)  # fmt: skip
    ends = np.stack([run.q[-1, 0], run.p[-1, 0]]).reshape(2, 2, 2, -1)
    by = (ends[:, :, 0] - ends[:, :, 1]) / (2 * SHIFT)  # (of q or p, by q or p, state)
    return by[0, 0] * by[1, 1] - by[0, 1] * by[1, 0]


def save(path: Path, data: dict) -> None:
    """Curves, and bands where the factor depends on the state."""
    with look.drawing(path, 5.0, 3.6, 160) as page:
        axes = page.subplots()
        for name, (low, high) in data["curves"].items():
            axes.plot(data["z"], high, color=COLOURS[name], label=name, zorder=4 if "all" in name else 2)
            if max(b - a for a, b in zip(low, high, strict=True)) > 1e-6:
                axes.plot(data["z"], low, color=COLOURS[name])
                axes.fill_between(data["z"], low, high, color=COLOURS[name], alpha=0.25, lw=0)
        axes.set(xlabel=r"$\gamma h$", ylabel=r"factor of $dp\wedge dq$, over $e^{-\gamma h}$", ylim=(-1, 3))
        axes.legend(fontsize=7, loc="lower left")
