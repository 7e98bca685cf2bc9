# SPDX-License-Identifier: BSD-3-Clause
"""Generated C where there is no compiler: translated for LLVM, which llvmlite brings.

words        words of a text, macros expanded
types        types and values of the C that is read
instructions, expressions, function     one function, as its words are read
text         a whole text
engine       compiled functions, in this process
"""
