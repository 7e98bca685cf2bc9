# SPDX-License-Identifier: BSD-3-Clause
"""The figure of weak orders: second moments of the non-commuting oscillator to t = 1, without sampling.

Means over one step are finite sums: of Gauss-Hermite nodes where increments are Gaussian (`symsde.mean_square`), of the
law where a scheme has one of its own (`measure_orders`). Their powers are compared with exp(T G).
"""

import sys
from pathlib import Path

import numpy as np
import symsde as ss
from symsde.show import look

COUNTS = (4, 8, 16, 32, 64, 128)
STRENGTH = 0.8
SCHEMES = ("midpoint", "stormer_verlet", "gauss2", "gauss2_weak2_areas")
EXTRAPOLATED = (("midpoint", 1), ("gauss2_weak2_areas", 2))  #: by Talay and Tubaro, from this order
WORDS = "{scheme}, h and h/2"


def compute() -> dict:
    """{curve: errors}, and their steps."""
    sys.path.insert(0, str(Path(__file__).resolve().parent))
    import measure_orders  # noqa: PLC0415 - it wants numba, drawing does not

    make, noises = measure_orders.CROSSED[0]
    model, exact = make(), measure_orders.generator_map(noises)
    powers = {}
    for scheme in SCHEMES:
        for count in (*COUNTS, 2 * COUNTS[-1]):
            powers[scheme, count] = np.linalg.matrix_power(_of_step(measure_orders, model, scheme, 1 / count), count)
    curves = {scheme: [_apart(powers[scheme, count], exact) for count in COUNTS] for scheme in SCHEMES}
    for scheme, order in EXTRAPOLATED:
        fine, coarse = ([powers[scheme, k * count] for count in COUNTS] for k in (2, 1))
        better = [a + (a - b) / (2**order - 1) for a, b in zip(fine, coarse, strict=True)]
        curves[WORDS.format(scheme=scheme)] = [_apart(x, exact) for x in better]
    return {"steps": COUNTS, "strength": STRENGTH, "curves": curves}


def _of_step(measure, model, scheme: str, h: float) -> np.ndarray:
    """E A x A of (1, q, p), or E M x M of (q, p)."""
    if ss.schemes.get(scheme).info.crosses_noises:
        return measure.mean_map(model, scheme, h)
    return ss.mean_square(model, scheme, step=h).matrix


def _apart(found: np.ndarray, exact: np.ndarray) -> float:
    """The largest error of a second moment of (q, p)."""
    rows = [4, 5, 7, 8]  # of products of q and p among those of (1, q, p)
    if len(found) == len(exact):
        found = found[np.ix_(rows, rows)]
    return float(f"{np.abs(found - exact[np.ix_(rows, rows)]).max():.4e}")


def save(path, data: dict) -> None:
    """Errors against the step, with lines of order one and two."""
    h = 1 / np.array(data["steps"])
    with look.drawing(path, 4.6, 3.8, 160) as page:
        axis = page.subplots()
        for name, errors in data["curves"].items():
            scheme, _, more = name.partition(",")
            style = look.of_scheme(scheme) | ({"ls": "--", "mfc": "none"} if more else {})
            slope = np.log2(errors[-2] / errors[-1])
            axis.plot(h, errors, label=f"{name}: slope {slope:.2f}", ms=5, **style)
        axis.set(xscale="log", yscale="log", xlabel="$h$", ylabel="largest error of E $q^2$, $qp$, $p^2$ at $t=1$")
        axis.legend(fontsize=7)
