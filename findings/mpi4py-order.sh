#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# mpi4py 4.1.2 with mpich 5.0.2 (PyPI).
# Guess: a collective call from an array in Fortran's order into one in C's order keeps the element [i, j] in its place, or is
#     refused.
# Seen: it does neither: the elements go over in the order of memory, so that the result holds the right numbers in wrong
#     places, silently, in Allreduce, Gather and Recv; two arrays in one order are right, and so is the lower-case allreduce.
# For users of stochastic integrators: arrays that come from Fortran or from a transpose (paths behind, degrees in front) are
#     such arrays, and mean and variance over all elements do not show it: make them contiguous before they are sent.
. "$(dirname "$0")/venv.sh" mpi4py==4.1.2 mpich==5.0.2 numpy==2.4.6
python - <<'END'
import mpi4py
import numpy as np
from mpi4py import MPI

world = MPI.COMM_WORLD
print("mpi4py", mpi4py.__version__, MPI.Get_library_version().split("\n")[0])
sent = np.asfortranarray(np.arange(6.0).reshape(2, 3))
reduced, gathered, received = np.zeros((2, 3)), np.zeros((1, 2, 3)), np.zeros((2, 3))
world.Allreduce(sent, reduced)
world.Gather(sent, gathered, root=0)
request = world.Isend(sent, 0)
world.Recv(received, 0)
request.wait()
same, lower = np.zeros((2, 3)), world.allreduce(sent)
world.Allreduce(np.ascontiguousarray(sent), same)
print("sent\n", sent, "\nAllreduce\n", reduced, "\nGather\n", gathered[0], "\nRecv\n", received)
scrambled = np.array([[0.0, 3.0, 1.0], [4.0, 2.0, 5.0]])
assert (reduced == scrambled).all() and (gathered[0] == scrambled).all() and (received == scrambled).all()
assert (same == sent).all() and (lower == sent).all()
END
