# SPDX-License-Identifier: BSD-3-Clause
"""
Error against run time
======================

To choose a scheme, compare what a path costs at a given error. This figure is measured while the
site is built. The page :doc:`/work-precision` has such figures for the built-in models, measured
on a quiet machine.
"""

import matplotlib.pyplot as plt
import symsde as ss
from symsde.show.look import of_scheme, readable

schemes = ("midpoint", "stormer_verlet", "gauss_dkdkd", "chin4a", "heun")
study = ss.work_precision(
    ss.models.synchrotron(),
    q0=1.0,
    p0=0.0,
    horizon=4.0,
    steps=[16, 32, 64],
    schemes=schemes,
    paths=200,
    seed=1,
)
for scheme in schemes:
    rows = [row for row in study.rows if row["scheme"] == scheme]
    times, errors = [1e6 * row["seconds"] for row in rows], [row["err_strong"] for row in rows]
    plt.loglog(times, errors, label=scheme, **of_scheme(scheme))
plt.xlabel("microseconds a path")
plt.ylabel("root mean square error")
readable([plt.gca()])
plt.legend()

# %%
# At the same step, the fourth-order splitting has a far smaller error than the others:

finest = {row["scheme"]: row["err_strong"] for row in study.rows if row["steps"] == 64}
assert finest["chin4a"] < 0.1 * finest["midpoint"]
