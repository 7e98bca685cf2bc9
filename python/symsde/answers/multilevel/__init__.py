# SPDX-License-Identifier: BSD-3-Clause
"""Multilevel Monte Carlo: `mlmc`, and the samplers of its levels for drivers of one's own."""
