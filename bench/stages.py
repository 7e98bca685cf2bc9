# SPDX-License-Identifier: BSD-3-Clause
"""Time implicit schemes of several stages beside the midpoint rule.

stages.py REPEATS: all schemes of a scene in turn, one thread, processor time. Lines:
    stages SCENE NDOF H SCHEME ns_per_path_step(least) ratio_to_midpoint iterations lapack_solves
    growth NDOF SCHEME ns_per_path_step_and_site(least)
Chains begin from a smooth wave; steps are those at which h times the fastest frequency of small waves, 2, is mild (0.2,
0.5) and stiff (10).
"""

import sys
import time
import warnings

import numpy as np
import symsde as ss

warnings.simplefilter("ignore")

SCHEMES = ("midpoint", "gauss2", "gauss3", "lobatto3", "gauss2_strong32")
STIFF = ("midpoint", "gauss2", "gauss3", "gauss2_strong32")  # lobatto3 is unstable there
SITES = (2, 4, 8, 16, 64)
LONG = (64, 256, 1024, 4096)
LASTING = 200.0  # the longest time: noise heats, and steps that are mild in the beginning are not for ever


def chain(n):
    """A chain of n sites and where it begins."""
    i = np.arange(n)
    return ss.models.fpu_chain(n=n, beta=1.0, sigma=0.1), 0.3 * np.sin(0.7 * i + 0.3), 0.3 * np.cos(1.3 * i)


def scenes():
    """Name, model, beginning and steps."""
    yield "synchrotron", (ss.models.synchrotron(), 0.5, 0.2), (0.1, 0.25)
    yield "driven_pendulum", (ss.models.driven_pendulum(), 0.5, 0.2), (0.02, 0.1)
    yield "pendulum", (ss.models.pendulum(), 0.5, 0.2), (0.02, 0.1)
    yield "henon_heiles", (ss.models.henon_heiles(alpha=0.1), np.array([0.3, 0.2]), np.array([0.1, 0.3])), (0.1, 0.5)
    for n in SITES:
        yield "fpu_chain", chain(n), (0.1, 0.25, 5.0)


def run(scene, scheme, h, steps, paths):
    """Processor time of a path-step in ns, and the report."""
    model, q, p = scene
    start = time.process_time()
    r = ss.simulate(model, q0=q, p0=p, scheme=scheme, step=h, steps=steps, paths=paths, save_every=steps, threads=1)
    return 1e9 * (time.process_time() - start) / (steps * paths), r.report


def least(scene, schemes, h, paths, repeats):
    """The least time of every scheme, all in turn, and their reports."""
    times, reports = dict.fromkeys(schemes, float("inf")), {}
    slowest = max(run(scene, scheme, h, 10, paths)[0] for scheme in schemes)
    steps = int(min(2000, LASTING / h, max(10, 3e7 / (slowest * paths))))
    for _ in range(repeats):
        for scheme in schemes:
            ns, reports[scheme] = run(scene, scheme, h, steps, paths)
            times[scheme] = min(times[scheme], ns)
    return times, reports


def main():
    """Print all lines."""
    repeats = int(sys.argv[1]) if len(sys.argv) > 1 else 7
    for name, scene, steps in scenes():
        for h in steps:
            schemes = SCHEMES if h < 1 else STIFF
            times, reports = least(scene, schemes, h, 256, repeats)
            for scheme in schemes[1:]:
                c = reports[scheme].counters
                ratio = times[scheme] / times["midpoint"]
                iterations = c["iterations"] / c["path_steps"]
                n = np.size(scene[1])
                print("stages", name, n, h, scheme, times[scheme], ratio, iterations, c["lapack_solves"], flush=True)
    for n in LONG:
        times, _ = least(chain(n), SCHEMES[:4], 0.25, 16, max(3, repeats // 2))
        for scheme in SCHEMES[:4]:
            print("growth", n, scheme, times[scheme] / n, flush=True)


if __name__ == "__main__":
    main()
