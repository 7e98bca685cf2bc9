# SPDX-License-Identifier: BSD-3-Clause
"""Helpers of the scenarios: runs without warnings about failures, and the words of warnings."""

from __future__ import annotations

import numpy as np

import symsde as ss

from ...native import checks

EPS = float(np.finfo(float).eps)


quiet = checks.unwarned()  #: suppresses warnings about failed paths, which scenarios examine
simulate, moments = quiet(ss.simulate), quiet(ss.moments)


def says(report, words: str) -> bool:
    """Whether the warnings before a run contain these words."""
    return any(words in warning for warning in report.warnings)
