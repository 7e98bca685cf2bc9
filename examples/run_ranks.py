# SPDX-License-Identifier: BSD-3-Clause
"""Run an MPI program on 1, 2 and 3 ranks and compare the outputs; exit 77 (skipped) without MPI."""

import os
import subprocess
import sys
from pathlib import Path

SKIPPED = 77


def main(launcher: str = "", program: str = "") -> int:
    """Run; 0 if the outputs for all numbers of ranks are equal."""
    if not (launcher and program and Path(launcher).exists()):
        print("skipped: there is no MPI for Fortran with mpi_f08: apt install libopenmpi-dev")
        return SKIPPED
    allowed = {"OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1"}
    allowed |= {"OMPI_MCA_rmaps_base_oversubscribe": "1", "PRTE_MCA_rmaps_default_mapping_policy": ":oversubscribe"}
    printed = []
    for ranks in ("1", "2", "3"):
        command = [launcher, "-n", ranks, program]
        done = subprocess.run(command, env={**os.environ, **allowed}, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            print(f"{' '.join(command)} failed:\n{done.stdout}{done.stderr}")
            return 1
        printed.append(done.stdout)
    print(printed[0], end="")
    if len(set(printed)) > 1 or "the bits of one call" not in printed[0]:
        print("other numbers of ranks print:", *printed[1:], sep="\n")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
