#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# signac 2.4.1 (PyPI).
# Guess: parameters that Python takes for equal, {"T": 1} and {"T": 1.0}, or {"x": 0.0} and {"x": -0.0}, are one job.
# Seen: they are two, in two folders; but a search for {"T": 1} finds both, and `groupby` puts them into one group.
# For users of stochastic integrators: a sweep that is made once by range and once by linspace runs twice, and an average over
#     a group counts those twice, with the same seed.
. "$(dirname "$0")/venv.sh" signac==2.4.1
python - <<'END'
from importlib.metadata import version

import signac

project = signac.init_project(".")
for point in ({"T": 1}, {"T": 1.0}, {"T": 2.0}, {"T": 0.0}, {"T": -0.0}):
    project.open_job(point).init()
groups = [(key, len(list(jobs))) for key, jobs in project.groupby("T")]
print("signac", version("signac"), "jobs", len(project), "groups", groups)
print("found for T = 1:", [job.sp() for job in project.find_jobs({"T": 1})])
print("identities:", [project.open_job({"T": value}).id[:8] for value in (1, 1.0, 0.0, -0.0)])
assert len(project) == 5 and groups == [(0.0, 2), (1, 2), (2.0, 1)] and len(project.find_jobs({"T": 1})) == 2
END
