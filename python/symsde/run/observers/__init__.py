# SPDX-License-Identifier: BSD-3-Clause
"""Observers of a run: requests, the arrays that the library fills, and results."""
