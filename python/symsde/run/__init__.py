# SPDX-License-Identifier: BSD-3-Clause
"""Runs: one call of the library, or a prepared one, and what it gives."""
