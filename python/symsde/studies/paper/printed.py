# SPDX-License-Identifier: BSD-3-Clause
"""Equations of the examples as the paper prints them, each as left side minus right side.

All take h, increments dw (noise, point), the ends of a step, (q, p) at t_n and t_{n+1}, and the model's coefficients.
"""

import numpy as np

WRONG = "(80), second print"


def kubo(h, dw, start, end, *, a, sigma):
    """(66)-(68), and (69)-(70), which the paper derives from them by a division that the scheme does not need."""
    (q, p), (q1, p1) = start, end
    x = a * h + sigma * dw[0]
    return {
        "(66)": x / 2 * (p1 + p) - (q1 - q),
        "(67)": (p1 + p) / 2 + x / 4 * (q1 + q) - p,
        "(68)": (p1 + p) / 2 - x / 4 * (q1 + q) - p1,
        "(69)": q1 - q + x**2 / 4 * (q1 + q) - p * x,
        "(70)": q1 - q - x**2 / 4 * (q1 + q) - p1 * x,
    }


def synchrotron(h, dw, start, end, *, omega, sigma1, sigma2):
    """(79)-(81); (80) is printed twice, the second time with a wrong cosine."""
    (q, p), (q1, p1) = start, end
    mean = (p1 + p) / 2
    sine = (h * omega**2 + sigma2 * dw[1]) / 2 * np.sin((q1 + q) / 2)
    cosine = sigma1 * dw[0] / 2 * np.cos((q1 + q) / 2)
    return {
        "(79)": mean - (q1 - q) / h,
        "(80)": mean - (p - sine - cosine),
        WRONG: mean - (p - sine - sigma1 * dw[0] / 2 * np.cos(q / 2)),
        "(81)": mean - (p1 + sine + cosine),
    }


def two_noises(h, dw, start, end, *, sigma, gamma):
    """(89)-(90)."""
    (q, p), (q1, p1) = start, end
    return {"(89)": p1 - (p - h * q + gamma * dw[1]), "(90)": q1 - (q + h * p1 + sigma * dw[0])}


def two_noises_adjoint(h, dw, start, end, *, sigma, gamma):
    """(91)-(92), the adjoint of (89)-(90): end points exchanged, time and noise reversed."""
    (q, p), (q1, p1) = start, end
    backwards = two_noises(-h, -dw, end, start, sigma=sigma, gamma=gamma)
    return {
        "(91)": p1 - (p - h * q1 + gamma * dw[1]),
        "(92)": q1 - (q + h * p + sigma * dw[0]),
        **{f"adjoint of {equation}": -residual for equation, residual in backwards.items()},
    }
