# SPDX-License-Identifier: BSD-3-Clause
"""Certificates of schemes in a heat bath: contraction, harmonic law, free particles, against closed forms."""

import math

import numpy as np
import pytest
import symsde as ss
from symsde.errors import IncompatibleError, InvalidArgumentError


@pytest.mark.parametrize("z", [0.05, 0.5, 3.0])
def test_words(z):
    """Closed forms of BAOAB and OBABO; z/2 coth(z/2) of free diffusion."""
    step, omega = 0.4, 1.5
    x = (step * omega) ** 2 / 4
    for word, q2, p2 in (("BAOAB", 1, 1 - x), ("OBABO", 1 / (1 - x), 1)):
        law = ss.diagnose.bath_law(f"word:{word}", step=step, gamma=z / step, omega=omega)
        assert "exp(-gamma h)" in law.contraction
        assert law.defect < 1e-9
        np.testing.assert_allclose(
            (law.q_squared, law.q_p, law.p_squared, law.free_temperature), (q2, 0, p2, 1), rtol=0, atol=1e-11
        )
    law = ss.diagnose.bath_law("word:BAOAB", step=step, gamma=z / step)
    assert abs(law.free_diffusion / ((z / 2) / math.tanh(z / 2)) - 1) < 1e-11


def test_kicks_and_midpoint():
    """The numbers of damped kicks at omega = gamma = 1, h = 1/2; midpoint has z/sinh z of the right temperature."""
    expected = {
        "verlet_kdk": (1.0221002310236824, -0.0221002310236824, 0.9600306707450751),
        "gauss_dkdkd": (1.0057668918470486, -0.000271503399757, 1.011855939830468),
        "chin4a": (0.9997965958401762, 0.000183864866367, 0.9994036074421323),
    }
    for scheme, moments in expected.items():
        law = ss.diagnose.bath_law(scheme, step=0.5, gamma=1.0)
        np.testing.assert_allclose((law.q_squared, law.q_p, law.p_squared), moments, rtol=0, atol=2e-13)
        assert abs(law.free_temperature - 1) < 1e-13
        assert abs(law.free_diffusion - 1) < 1e-13
        assert law.defect < 1e-9
        assert "exp(-gamma h) = 0.606530659713, exactly" in str(law)
    law = ss.diagnose.bath_law("midpoint", step=0.5, gamma=1.0)
    assert abs(law.free_temperature - 0.5 / math.sinh(0.5)) < 1e-13
    assert law.defect < 1e-9


def test_refusals():
    """Numbers that are none, schemes without damped steps, steps that grow."""
    for wrong in ({"step": 0.0}, {"gamma": -1.0}, {"omega": 0.0}):
        with pytest.raises(InvalidArgumentError, match="give a number above zero"):
            ss.diagnose.bath_law("chin4a", **{"step": 0.1, "gamma": 1.0, **wrong})
    with pytest.raises(IncompatibleError, match="is damped, and scheme gauss_dkdkd_midpoint"):
        ss.diagnose.bath_law("gauss_dkdkd_midpoint", step=0.1, gamma=1.0)
    with pytest.raises(IncompatibleError, match=r"steps of word:BAOAB grow at omega h = 3, gamma h = 0.1"):
        ss.diagnose.bath_law("word:BAOAB", step=1.0, gamma=0.1, omega=3.0)
