# SPDX-License-Identifier: BSD-3-Clause
"""What the Python package adds to a call."""

import importlib.util

from .tools import ABSENT, Setting, at_most, lines_of_python, spread, table

ADDED = 1.0  # ms of a call
STEPS = {
    "ss.simulate_of_one_step": 40.0,
    "ss.step": 40.0,
    "prepared_run.step()": 10.0,
    "prepared_run.step(dw)": 10.0,
}  # us
OBSERVED = 17.6  # ns a path-step with every step saved and an observable in Python: twice a loop in numba
GROWN = 1.05  # peak memory over the size of the results


def measure(setting: Setting) -> list[list[str]]:
    """Time calls and look at the memory; nothing where NumPy is missing."""
    if importlib.util.find_spec("numpy") is None:
        return []
    return lines_of_python("python_calls.py", setting.build, max(5, setting.repeats))


def section(found: list[list[str]]) -> str:
    """Write the section."""
    if not found:
        return f"## Calls from Python\n\nNumPy: {ABSENT}."
    calls, steps, observed, memory = [], [], [], []
    for words in found:
        numbers = [float(word) for word in words[2:]]
        if words[0] == "step":
            steps.append([words[1].replace("_", " "), f"{numbers[0]:.1f}", *at_most(numbers[0], STEPS[words[1]])])
        elif words[0] == "observed":
            target = at_most(numbers[0], OBSERVED) if words[1].endswith("observable") else ["", ""]
            observed.append([words[1].replace("_", " "), f"{numbers[0]:.1f}", *target])
        elif words[0] == "call":
            added = [f"{numbers[0]:.3f}", *at_most(numbers[0], ADDED)]
            calls.append([words[1], spread(numbers[1:4]), spread(numbers[4:7]), *added])
        else:
            ratio = [f"{numbers[1]:.3f}", *at_most(numbers[1], GROWN)]
            memory.append([words[1].replace("_", " "), f"{numbers[0]:.0f}", *ratio])
    return (
        "## Calls from Python\n\n"
        "The table gives ms of processor time for a run of one path and one step. Runs alternate with a call of the C "
        "interface that was prepared beforehand.\n\n"
        + table(["function", "from Python [ms]", "C interface [ms]", "added [ms]", "target", ""], calls)
        + "\n\n"
        "The next table gives µs of processor time for one step of one path (kubo, midpoint), the least of all "
        "repeats.\n\n" + table(["call", "time [µs]", "target", ""], steps) + "\n\n"
        "The next table gives ns for a step of a path, for moments of 1000 paths (kubo, midpoint) over 500 steps.\n\n"
        + table(["what is saved", "time [ns]", "target", ""], observed)
        + "\n\n"
        "The last table gives the growth of the peak memory of the process in a large run, divided by the size of the "
        "arrays that it returns. A ratio of 1 means that memory holds the results once, and nothing else that is large."
        "\n\n" + table(["run", "returned [MB]", "growth of peak / returned", "target", ""], memory)
    )
