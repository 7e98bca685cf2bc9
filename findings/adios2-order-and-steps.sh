#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# adios2 2.12.1.1001 (PyPI), Python's Stream and FileReader.
# Guess: arrays are written as they are indexed, or refused; `read` of a variable of four steps gives four.
# Seen: the memory is written as it lies: of [0 1 2; 3 4 5] in Fortran's order comes [0 3 1; 4 2 5], of every second element of
#     0..5 come 0, 1, 2. `read` gives the first step only, also of scalars, and steps asked for come one behind the other in one
#     row, without an axis of steps.
# For users of stochastic integrators: states (q, path) of a Fortran program, or every tenth row of a path, are stored in another
#     order, silently; np.ascontiguousarray before `write` keeps them.
. "$(dirname "$0")/venv.sh" adios2==2.12.1.1001 numpy==2.4.6
python - 2> /dev/null <<'END'
import adios2
import numpy as np

table, row = np.arange(6.0).reshape(2, 3), np.arange(6.0)
written = {"fortran": np.asfortranarray(table), "second": row[::2], "c": table, "copy": np.ascontiguousarray(row[::2])}
with adios2.Stream("arrays.bp", "w") as stream:
    for name, a in written.items():
        stream.write(name, a, list(a.shape), [0] * a.ndim, list(a.shape))
with adios2.FileReader("arrays.bp") as file:
    back = {name: file.read(name) for name in written}
print("adios2", adios2.__version__)
for name, a in written.items():
    print(name, "written", a.tolist(), "read", back[name].tolist())
assert back["fortran"].tolist() == [[0, 3, 1], [4, 2, 5]] and back["second"].tolist() == [0, 1, 2]
assert np.array_equal(back["c"], table) and np.array_equal(back["copy"], row[::2])

with adios2.Stream("path.bp", "w") as stream:
    for i in range(4):
        stream.begin_step()
        stream.write("t", 0.5 * i)
        stream.write("q", np.full(3, 1.0 * i), [3], [0], [3])
        stream.end_step()
with adios2.FileReader("path.bp") as file:
    steps = file.available_variables()["q"]["AvailableStepsCount"]
    t, q, all_q = file.read("t"), file.read("q"), file.read("q", step_selection=[0, 4])
print("four steps, as told:", steps, "t:", np.ravel(t), "q:", q, "q of steps 0 to 3:", all_q)
assert steps == "4" and np.ravel(t).tolist() == [0] and q.tolist() == [0, 0, 0] and all_q.shape == (12,)
END
