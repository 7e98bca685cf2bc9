#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# SymPy 1.14.0 (PyPI), ccode and fcode, with the C compiler of the machine.
# Guess: the C that is written for a formula computes its value in double precision.
# Seen: 2**70*x is written with an integer that no type of C holds: the compiler warns, and the value at x = 1 is 0. coth(x)
#     is written as a quotient of sums of exponentials: NaN at x = 800, where it is 1. fcode writes the same for Fortran.
# For users of stochastic integrators: parameters put in as exact integers, and tails, are wrong in generated code although
#     the formula is right; evaluate to floating point first and compare with the formula at large arguments.
. "$(dirname "$0")/venv.sh" sympy==1.14.0 mpmath==1.3.0
python - <<'END'
import subprocess

import sympy as sp

x = sp.Symbol("x", real=True)
print("SymPy", sp.__version__)


def value(formula, at):
    with open("value.c", "w") as file:
        file.write("#include <math.h>\n#include <stdio.h>\nint main(void)\n{\n"
                   f"    volatile double x = {at};\n    printf(\"%g\", (double)({sp.ccode(formula)}));\n}}\n")
    subprocess.run(["cc", "value.c", "-o", "value", "-lm"], check=True, capture_output=True)
    return subprocess.run(["./value"], check=True, capture_output=True, text=True).stdout


cases = (2**70 * x, 1.0, "0", 2.0**70), (sp.coth(x), 800.0, "-nan nan", 1.0), (x**2 / 2, 3.0, "4.5", 4.5)
for formula, at, wanted, meant in cases:
    found = value(formula, at)
    print(formula, "at", at, ":", sp.ccode(formula), "=", found, "for", meant)
    assert found in wanted.split()
END
