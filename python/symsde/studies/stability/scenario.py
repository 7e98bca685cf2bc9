# SPDX-License-Identifier: BSD-3-Clause
"""Helpers of the scenarios: runs without warnings about failures, and the words of warnings."""

from __future__ import annotations

import functools
import warnings

import numpy as np

import symsde as ss

EPS = float(np.finfo(float).eps)


def quiet(function):
    """Decorate a scenario: suppress warnings about failed paths, which the scenario examines."""

    @functools.wraps(function)
    def called(*arguments, **options):
        with warnings.catch_warnings():
            for said in ss.errors.OF_RUNS:
                warnings.simplefilter("ignore", said)
            return function(*arguments, **options)

    return called


simulate, moments = quiet(ss.simulate), quiet(ss.moments)


def says(report, words: str) -> bool:
    """Whether the warnings before a run contain these words."""
    return any(words in warning for warning in report.warnings)
