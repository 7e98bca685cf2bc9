# SPDX-License-Identifier: BSD-3-Clause
"""Mean-square stability over omega h and sigma sqrt(h): what schemes add to the growth of second moments in a step."""

from __future__ import annotations

import functools
from pathlib import Path

import numpy as np
from symsde.answers.mean_square import mean_square
from symsde.errors import SymsdeError
from symsde.models import kubo, linear_oscillator
from symsde.schemes import names
from symsde.show import look
from symsde.studies.stability.systems import noisy_spring, soft

SCHEMES = ("symplectic_euler", "stormer_verlet", "midpoint", "gauss2", "heun")
STABLE = 0.01  #: log of the growth beyond the exact one, in a step, up to which a scheme counts as stable
TOLD = (0.01, 0.1, 0.32)  #: sigma sqrt(h) of the table of all schemes
_OMEGA = np.geomspace(0.05, 3.2, 25)  #: omega h
_SIGMA = np.geomspace(0.01, 1.0, 17)  #: sigma sqrt(h), with sigma in units of omega


EQUATIONS = {
    "additive noise, H_1 = -sigma q": linear_oscillator,
    "noise on the stiffness, H_1 = sigma q^2/2": lambda sigma: noisy_spring(1.0, sigma),
    "noise on the mass, H_1 = sigma p^2/2": soft,
    "Kubo, H_1 = sigma (p^2 + q^2)/2": lambda sigma: kubo(1.0, sigma),
}


def compute() -> dict:
    """Excess of every scheme and equation, (sigma, omega); infinite as null."""
    maps = []
    for equation, make in EQUATIONS.items():
        for scheme in SCHEMES:
            rows = [[_excess(make, scheme, x, y) for x in _OMEGA] for y in _SIGMA]
            maps.append({"equation": equation, "scheme": scheme, "excess": rows, "stable_up_to": _limits(rows)})
    limits = {name: {equation: _longest(make, name) for equation, make in EQUATIONS.items()} for name in names()}
    grid = {"omega_h": _OMEGA.tolist(), "sigma_sqrt_h": _SIGMA.tolist(), "told_at": TOLD}
    return {**grid, "stable": STABLE, "maps": maps, "limits": limits}


def _longest(make, scheme: str) -> list[float] | None:
    """At each of TOLD, the largest omega h of the map below which every step is stable; None: a model is refused."""
    rows = [[_excess(make, scheme, x, y) for x in _OMEGA] for y in TOLD]
    return None if all(x is None for row in rows for x in row) else _limits(rows)


def _excess(make, scheme: str, omega_h: float, sigma_sqrt_h: float) -> float | None:
    """With omega = 1 the step is omega h, and sigma is sigma sqrt(h) over the root of that."""
    return _found(make, scheme, omega_h, 1.0 if make is linear_oscillator else sigma_sqrt_h / np.sqrt(omega_h))


@functools.cache
def _found(make, scheme: str, omega_h: float, sigma: float) -> float | None:
    try:
        found = mean_square(make(sigma), scheme, step=omega_h).excess
    except SymsdeError:
        return None
    return float(f"{found:.4e}") if np.isfinite(found) else None


def _limits(rows: list[list[float | None]]) -> list[float]:
    """For each sigma sqrt(h), the largest omega h below which every step is stable; 0 = none."""
    limits = []
    for row in rows:
        good = [x is not None and x <= STABLE for x in row]
        last = next((i for i, ok in enumerate(good) if not ok), len(good))
        limits.append(float(f"{_OMEGA[last - 1]:.4g}") if last else 0.0)
    return limits


def save(path: Path, data: dict) -> None:
    """Draw the excess with the line up to which schemes are stable."""
    x, y = np.array(data["omega_h"]), np.array(data["sigma_sqrt_h"])
    rows = list(dict.fromkeys(one["equation"] for one in data["maps"]))
    with look.drawing(path, 9.5, 7.6, 110) as page:
        axes = page.subplots(len(rows), len(SCHEMES), sharex=True, sharey=True)
        for one in data["maps"]:
            here = axes[rows.index(one["equation"]), SCHEMES.index(one["scheme"])]
            excess = np.nan_to_num(np.array(one["excess"], dtype=float), nan=1e3)
            shown = np.log10(np.clip(excess, 1e-6, 1e1))
            image = here.pcolormesh(x, y, shown, vmin=-6, vmax=1, cmap="magma_r", shading="nearest", rasterized=True)
            here.contour(x, y, excess, [data["stable"]], colors=look.BLUE, linewidths=1.2)
            here.set(xscale="log", yscale="log")
            here.grid(False)
            if one["equation"] == rows[0]:
                here.set_title(one["scheme"])
            if one["scheme"] == SCHEMES[0]:
                here.set_ylabel(one["equation"].split(",")[0] + "\n$\\sigma\\sqrt{h}$")
            if one["equation"] == rows[-1]:
                here.set_xlabel(r"$\omega h$")
        page.colorbar(image, ax=axes, label="log$_{10}$ of what a step adds to log E$|z|^2$", shrink=0.7)
