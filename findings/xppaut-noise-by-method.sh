#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# XPPAUT 6.11b of Debian 12, `wiener w`. Wants `apt-get update` done once.
# Guess: x' = v, v' = w gives v variance t by every method of `meth=`, or the method is refused; two runs differ.
# Seen: variance of v over t is 1.0 by Euler, Heun (modeuler), backward Euler and Runge-Kutta, 0.82 by Adams (neighbouring
#     increments are correlated by 0.15), 0.68 by symplectic, 0.21 by qualrk, and 0 by gear, 2rb, 5dp, 83dp and cvode: there the
#     equations run without noise. For y' = 0.4 y n Euler gives Ito's mean of ln y, the other three of the good ones that of
#     Stratonovich. Runs without a seed are alike.
# For users of stochastic integrators: the method that one picks for a Hamiltonian system, `symplectic`, gives two thirds of
#     the noise, and those picked for accuracy none, without a word.
. "$(dirname "$0")/debs.sh" xppaut=6.11b+1.dfsg-1.1 libx11-6 libxcb1 libxau6 libxdmcp6 libbsd0 libmd0
run()  # METHOD FILE EQUATIONS..: the columns t, and those of the equations, into FILE
{
    { printf '%s\n' "${@:3}" "@ total=1000,dt=0.05,meth=$1,bounds=1e12,maxstor=30000" done; } > in.ode
    xppaut -silent in.ode > log 2>&1
    mv output.dat "$2"
}
for method in euler modeuler backeul rungekutta adams symplectic qualrk gear 2rb 5dp 83dp cvode; do
    run $method $method "x'=v" "v'=w" "wiener w" "init x=0,v=0"
    case $method in euler|modeuler|backeul|rungekutta) run $method $method.law "y'=0.4*y*n" "wiener n" "init y=1";; esac
done
run euler again "x'=v" "v'=w" "wiener w" "init x=0,v=0"
cmp euler again && echo "XPPAUT 6.11b: two runs have one noise"
python3 - <<'END'
from math import log
from pathlib import Path


def increments(name, column, of=float):
    rows = [[float(text) for text in line.split()] for line in Path(name).read_text().splitlines()]
    assert len(rows) == 20001 and abs(rows[-1][0] - 1000) < 0.01
    return [of(b[column]) - of(a[column]) for a, b in zip(rows, rows[1:])]


seen = {"euler": 1, "modeuler": 1, "backeul": 1, "rungekutta": 1, "adams": 0.82, "symplectic": 0.675, "qualrk": 0.204,
        "gear": 0, "2rb": 0, "5dp": 0, "83dp": 0, "cvode": 0}
for name, wanted in seen.items():
    dv = increments(name, 2)
    squares = sum(d * d for d in dv)
    neighbours = sum(a * b for a, b in zip(dv, dv[1:])) / squares if squares else 0
    print(name, "variance of v over t:", squares / 1000, "correlation of neighbours:", neighbours)
    assert abs(squares / 1000 - wanted) <= 0.05 * wanted
    assert abs(neighbours - (0.15 if name == "adams" else 0)) < 0.04
for name, drift in (("euler", -0.08), ("modeuler", 0), ("backeul", 0), ("rungekutta", 0)):
    mean = sum(increments(name + ".law", 1, log)) / 1000
    print(name, "mean growth of ln y:", mean, "Ito's is -0.08, Stratonovich's 0, standard error 0.0126")
    assert abs(mean - drift) < 0.04
END
