# SPDX-License-Identifier: BSD-3-Clause
"""Runs as folders of shards: they survive kills, resume, share their work, and merge to the bits of one run.

A run is cut into pieces. The result of a piece depends only on the scene and on the path indices of the piece. It
becomes a shard in the folder of the run; a shard is written as a whole or not at all. The first process that finds all
shards puts the results together.

ensemble         moments of a large ensemble on any executor
scene            the description of a run in a TOML file
by_path          values of parameters that differ from path to path
named_functions  Python functions that a scene names
pieces           how a run is cut into pieces
scene_pieces     a scene with its pieces
share            the pieces of one task of n
ranks            the pieces of one rank of MPI
claims           which process works on which piece
dispatch         pieces computed by threads or an executor
execute          one piece, computed
longer           moments of more steps from kept last states
stop             when to end: a signal, or the time that was given
run_progress     progress of all pieces together
dry              steps, files, memory and time of a run before it begins
folder           the folder of a run
growth           more paths, steps, observers or saved times in the folder of a run
manifest         which run a folder holds
computed         model, scheme and functions of a run, identified by their values
numerics         what the last bits of a run depend on
shard_file       a shard as a file
tree             moments merged on the dyadic tree of the library
merged_results   results of a run from its shards
opened           a folder, finished or not, as objects
error_check      the same paths at half the step
"""
