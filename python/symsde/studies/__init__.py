# SPDX-License-Identifier: BSD-3-Clause
"""Measurements of schemes: convergence, error against run time, stiff and extreme cases, the paper's experiments.

convergence   strong errors over the step
study         error against run time of schemes
stability     stiff and extreme cases
paper         the experiments of the paper
expectations  expected values of numbers, and whether results meet them
pages         tables, and the parts of pages that programs write
catalogue     tables of the built-in models and schemes
"""
