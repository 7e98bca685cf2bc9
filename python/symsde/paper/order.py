# SPDX-License-Identifier: BSD-3-Clause
"""The order of a scheme from errors at several steps, with its confidence interval."""

import numpy as np

BATCHES = 20
STUDENT = 2.093  # 97.5 % point of Student's t with BATCHES - 1 degrees of freedom


def rms(errors):
    """Root mean square over the paths, the last axis."""
    return np.sqrt(np.mean(np.square(errors), axis=-1))


def fitted_order(steps, errors):
    """Slope of log(rms error) against log(step) and the half width of its 95 % interval.

    errors: (step, path). The interval comes from the scatter of the slope between BATCHES groups of paths, so that it
    holds for steps that share their Brownian paths, where errors at different steps are correlated.
    """
    usable = errors.shape[1] // BATCHES * BATCHES
    slopes = [_slope(steps, rms(group)) for group in np.split(errors[:, :usable], BATCHES, axis=1)]
    return _slope(steps, rms(errors)), STUDENT * np.std(slopes, ddof=1) / np.sqrt(BATCHES)


def _slope(steps, errors):
    return np.polyfit(np.log(steps), np.log(errors), 1)[0]
