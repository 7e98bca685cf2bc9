# SPDX-License-Identifier: BSD-3-Clause
"""Models: Hamiltonians with their traits, from functions or from formulas."""
