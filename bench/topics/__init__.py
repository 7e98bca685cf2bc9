# SPDX-License-Identifier: BSD-3-Clause
"""One module for each section of docs/performance-tables.md: measure(setting) finds numbers, section(found) writes
text.
"""
