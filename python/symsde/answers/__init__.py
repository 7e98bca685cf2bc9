# SPDX-License-Identifier: BSD-3-Clause
"""Answers with an interval: expectations, levels, advice, mean squares."""
