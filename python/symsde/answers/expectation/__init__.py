# SPDX-License-Identifier: BSD-3-Clause
"""Expectations with an interval: what is asked, what is tried, what is chosen."""
