#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# MDAnalysis 2.11.0 with netCDF4 1.7.5.1 (PyPI): XTC, TRR and AMBER's NetCDF.
# Guess: frames every 0.002 ps have increasing times after 50 ns, as in memory.
# Seen: in all three formats a time is a number of single precision, which has steps of 0.0039 ps there: frames two by two have
#     one time, and their distances are 0 and 0.0039.
# For users of stochastic integrators: correlations at short lags from a late part of a run, and merging of files by time, are
#     wrong. Frames have to be told apart by their steps.
. "$(dirname "$0")/venv.sh" MDAnalysis==2.11.0 netCDF4==1.7.5.1.post1 numpy==2.4.6 scipy==1.17.1
python -W ignore - <<'END'
import MDAnalysis
import numpy as np

source = MDAnalysis.Universe.empty(2, trajectory=True)
source.dimensions = [9, 9, 9, 90, 90, 90]
times = 50000 + 0.002 * np.arange(8)
print("MDAnalysis", MDAnalysis.__version__, "written", times)
for kind in ("XTC", "TRR", "NCDF"):
    with MDAnalysis.Writer(f"a.{kind}", 2, format=kind) as writer:
        for count, time in enumerate(times):
            source.trajectory.ts.time, source.trajectory.ts.frame = time, count
            writer.write(source.atoms)
    reader = MDAnalysis.Universe.empty(2)
    reader.load_new(f"a.{kind}", format=kind)
    found = np.array([float(frame.time) for frame in reader.trajectory])
    print(kind, found)
    assert len(found) == 8 and len(set(found)) < 8 and abs(found - times).max() < 0.002
END
