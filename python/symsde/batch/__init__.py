# SPDX-License-Identifier: BSD-3-Clause
"""Runs as folders of shards: they survive kills, resume, share their work, and merge to the bits of one run.

A run is cut into pieces (`plan`), each a pure function of the scene and its path indices. What is computed of a piece
(`work`) becomes a shard (`shard_file`) in the folder of the run (`folder`), whole or not at all. Whoever finds all
shards there puts the results together (`results`), the moments on the dyadic tree of the library (`tree`).
"""
