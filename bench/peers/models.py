# SPDX-License-Identifier: BSD-3-Clause
"""The same five problems as scenes, and as models of symsde."""

from __future__ import annotations

from scenes import SCENES

from .equations import MASSES, NOISE, OMEGA, SIGMA, SIGMA1, SIGMA2, SMALL

OF_PROBLEMS = {
    "kubo": SCENES["kubo"].of(a=1.0, sigma=SIGMA),
    "synchrotron": SCENES["synchrotron"].of(omega=OMEGA, sigma1=SIGMA1, sigma2=SIGMA2),
    "additive": SCENES["linear_oscillator"].of(sigma=1.0),
    "henon_heiles": SCENES["henon_heiles"].of(sigma1=SMALL, sigma2=SMALL),
    "fpu64": SCENES["fpu_chain"].of(sites=MASSES, sigma=NOISE),
}
MODELS = {name: scene.model() for name, scene in OF_PROBLEMS.items()}
