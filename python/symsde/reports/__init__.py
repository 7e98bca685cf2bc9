# SPDX-License-Identifier: BSD-3-Clause
"""Reports: studies, stability, the paper, tables, figures and pages."""
