# SPDX-License-Identifier: BSD-3-Clause
"""Expectations with an interval: the question, trials of schemes, the choice of a method, the work."""
