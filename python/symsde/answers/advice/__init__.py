# SPDX-License-Identifier: BSD-3-Clause
"""Advice from short runs: the scheme and the step to take."""
