# SPDX-License-Identifier: BSD-3-Clause
"""Laws of initial states, drawn by seed and path.

law      what all laws have in common, and the numbers that the library draws
affine   normal and uniform states
beam     states of a matched beam and of a heat bath, from the quadratic part of H
formula  formulas of drawn variables
table    rows of a table
named    laws by name, as scenes give them
"""
