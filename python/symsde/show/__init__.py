# SPDX-License-Identifier: BSD-3-Clause
"""Names, tables, notebook views and figures of objects.

html      models, schemes and certificates in notebooks
look      the one writer of figures: colours, markers, style, files
plot      figures of paths, moments and observers
tables    the one writer of tables
tabular   data frames, and runs and moments in notebooks
values    names of coordinates, momenta, the energy and observables
"""
