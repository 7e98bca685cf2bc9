# SPDX-License-Identifier: BSD-3-Clause
"""Names, tables, notebook views and figures of objects.

html      models, schemes and certificates in notebooks
look      colours, markers and style of all figures
plot      figures of paths, moments and observers
tabular   data frames, and runs and moments in notebooks
values    names of coordinates, momenta, the energy and observables
"""
