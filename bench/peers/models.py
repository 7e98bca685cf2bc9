# SPDX-License-Identifier: BSD-3-Clause
"""The same five problems as models of symsde."""

from __future__ import annotations

import symsde as ss

from . import equations as eq

MODELS = {
    "kubo": ss.models.kubo(a=1.0, sigma=eq.SIGMA),
    "synchrotron": ss.models.synchrotron(eq.OMEGA, eq.SIGMA1, eq.SIGMA2),
    "additive": ss.models.linear_oscillator(sigma=1.0),
    "henon_heiles": ss.models.henon_heiles(alpha=1.0, sigma1=eq.SMALL, sigma2=eq.SMALL),
    "fpu64": ss.models.fpu_chain(n=eq.MASSES, beta=1.0, sigma=eq.NOISE),
}
