# SPDX-License-Identifier: BSD-3-Clause
"""One module a section of docs/performance-tables.md: measure(setting) finds numbers, section(found) writes them."""
