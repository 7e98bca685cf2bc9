# SPDX-License-Identifier: BSD-3-Clause
"""Helpers that the scenarios share: runs whose failures are looked at, and words of warnings."""

from __future__ import annotations

import functools
import warnings

import numpy as np

import symsde as ss

EPS = float(np.finfo(float).eps)


def quiet(function):
    """Failed paths are what is looked at here, not warned of."""

    @functools.wraps(function)
    def called(*arguments, **options):
        with warnings.catch_warnings():
            for said in ss.errors.OF_RUNS:
                warnings.simplefilter("ignore", said)
            return function(*arguments, **options)

    return called


simulate, moments = quiet(ss.simulate), quiet(ss.moments)


def says(report, words: str) -> bool:
    """Whether a run was warned of something before it began."""
    return any(words in warning for warning in report.warnings)
