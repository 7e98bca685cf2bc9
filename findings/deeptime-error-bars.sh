#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# deeptime 0.5.0 (PyPI): BayesianMSM with `count_mode="effective"`.
# Guess: intervals of 95 % for the slow time scale of a chain of two states hold the true one nearly as often, at any lag: the
#     chain is Markov's, and effective counts are there for these intervals.
# Seen: at lag 1, 39 of 40 hold it; at lag 20 (time scale 49.5) 22 and 25 of 40 in two runs: the error bar is less than half of the
#     true scatter.
# For users of stochastic integrators: error bars of escape times by this way are too small by a factor of two; independent paths
#     give honest ones.
. "$(dirname "$0")/venv.sh" deeptime==0.5.0 numpy==2.2.6 scipy==1.17.1 scikit-learn==1.9.1
python -W ignore - <<'END'
from importlib.metadata import version

import numpy as np
from deeptime.markov import TransitionCountEstimator
from deeptime.markov.msm import BayesianMSM

rng, p, count = np.random.default_rng(1), 0.01, 40
due = -1 / np.log(1 - 2 * p)


def judge(lag):
    bars, best, held = [], [], 0
    for _ in range(count):
        chain = (np.cumsum(rng.random(20000) < p) % 2).astype(int)
        counts = TransitionCountEstimator(lagtime=lag, count_mode="effective").fit(chain).fetch_model()
        found = BayesianMSM(n_samples=50).fit(counts).fetch_model()
        times = np.array([sample.timescales()[0] for sample in found.samples])
        low, high = np.quantile(times, [0.025, 0.975])
        bars.append(times.std())
        best.append(found.prior.timescales()[0])
        held += low < due < high
    ratio = np.std(best) / np.mean(bars)
    print("lag", lag, "held", held, "of", count, "mean", np.mean(best), "true", due)
    print("    error bar", np.mean(bars), "scatter over it", ratio)
    return held, ratio


print("deeptime", version("deeptime"))
held, ratio = judge(1)
assert held >= 34 and ratio < 1.4
held, ratio = judge(20)
assert held <= 32 and ratio > 1.4
END
