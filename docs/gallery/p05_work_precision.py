# SPDX-License-Identifier: BSD-3-Clause
"""
Error against run time
======================

What a path costs that is right to a given error: the measure that counts when a scheme is chosen. The curve
of the catalogue's models, measured in quiet, is on the page :doc:`/work-precision`; this one is measured
while the site is built.
"""

import matplotlib.pyplot as plt
import symsde as ss
from symsde.look import of_scheme

schemes = ("midpoint", "stormer_verlet", "gauss_dkdkd", "chin4a", "heun")
study = ss.work_precision(
    ss.models.synchrotron(), q0=1.0, p0=0.0, horizon=4.0, steps=[16, 32, 64], schemes=schemes, paths=200, seed=1
)
for scheme in schemes:
    rows = [row for row in study.rows if row["scheme"] == scheme]
    plt.loglog([1e6 * r["seconds"] for r in rows], [r["err_strong"] for r in rows], label=scheme, **of_scheme(scheme))
plt.xlabel("microseconds a path")
plt.ylabel("root mean square error")
plt.legend()

# %%
# At one step, the fourth-order kicks are far below the others:

finest = {row["scheme"]: row["err_strong"] for row in study.rows if row["steps"] == 64}
assert finest["chin4a"] < 0.1 * finest["midpoint"]
