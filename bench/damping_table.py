# SPDX-License-Identifier: BSD-3-Clause
"""The cost of damping: the time of a step of damped momenta over that of the closed system, by scene and scheme.

damping_table.py [--paths N ..] [--schemes NAME ..] [--scenes NAME ..] [--kinds KIND ..] [--repeats N] [--seconds S]:
processor time of a path-step on one thread, damped and closed runs of about S seconds in turn, the least of N of each.
The last column names how the damped step is made, the last line has the median and the largest of all ratios.
"""

import argparse
import statistics
import warnings

import symsde as ss
from scenes import SCENES, library
from timing import ns_of_steps

SCHEMES = ("symplectic_euler", "stormer_verlet", "midpoint", "gauss2", "gauss_dkdkd", "verlet_kdk", "chin4a")
KINDS = {"built-in": lambda scene: scene.model(), "formula": lambda scene: scene.formula()}
RATE = 1e-3  #: so small that states do not decay to denormal numbers, with which processors are slow


def parse() -> argparse.Namespace:
    """Read the arguments of the command."""
    parser = argparse.ArgumentParser(description="Time steps of damped momenta beside those of closed systems.")
    parser.add_argument("--paths", type=int, nargs="+", default=[1000, 1], help="numbers of paths")
    parser.add_argument("--schemes", nargs="+", default=SCHEMES, help="names of schemes")
    parser.add_argument("--scenes", nargs="+", choices=SCENES, default=[x for x in SCENES if SCENES[x].name])
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=list(KINDS))
    parser.add_argument("--repeats", type=int, default=9, help="repeats of each measurement")
    parser.add_argument("--seconds", type=float, default=0.03, help="seconds of a run")
    return parser.parse_args()


def main():
    """Print the table, row by row."""
    warnings.simplefilter("ignore")  # correction terms and failed paths, the same with and without damping
    asked = parse()
    found = []
    print("| scene | kind | scheme | paths | closed, ns | damped / closed | damped step |")
    print("|---" * 7 + "|")
    for name in asked.scenes:
        scene = SCENES[name]
        for kind in asked.kinds:
            closed = KINDS[kind](scene)
            for scheme in asked.schemes:
                for paths in asked.paths:
                    pair = [library(x, scheme, paths, scene.step) for x in (closed.damped(RATE), closed)]
                    try:
                        told = [run(2).report.stepper for run in pair]
                    except ss.errors.SymsdeError:
                        continue  # the scheme does not suit this scene
                    times = ns_of_steps(pair, paths, asked.repeats, asked.seconds)
                    found.append(min(times[0]) / min(times[1]))
                    cells = (name, kind, scheme, paths, f"{min(times[1]):.3g}", f"{found[-1]:.2f}", told[0])
                    print("| " + " | ".join(map(str, cells)) + " |", flush=True)
    print(f"median {statistics.median(found):.3f}, largest {max(found):.2f}")


if __name__ == "__main__":
    main()
