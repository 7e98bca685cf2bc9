# SPDX-License-Identifier: BSD-3-Clause
"""Runs: one call of the library, or a prepared run, and their results."""
