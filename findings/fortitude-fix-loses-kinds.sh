#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# fortitude-lint 0.10.0 (PyPI), gfortran 12.2.0 of Debian 12. Wants `apt-get update` done once.
# Guess: `check --select S262 --fix --unsafe-fixes`, which parts arrays from scalars and is called unsafe as it may lose comments,
#     keeps the types.
# Seen: the arrays lose their kind or length: `real(dp) :: x, y(3)` becomes `real(dp) :: x` and `real :: y(3)`, integer(8) becomes
#     integer, character(10) one letter. It compiles, and 1/3 is 0.333333343.
# For users of stochastic integrators: a library of kinds computes its arrays in single precision after such a fix, and results
#     differ in the eighth digit.
. "$(dirname "$0")/debs.sh" {gfortran-12,gcc-12,libgcc-12-dev,libgfortran-12-dev}=12.2.0-14+deb12u1 \
   {libgfortran5,libquadmath0}=12.2.0-14+deb12u1 libisl23=0.25-1.1 libmpc3=1.3.1-1 libmpfr6=4.2.0-1
python3 -m venv --without-pip venv
python3 -m pip --python venv/bin/python install --quiet --disable-pip-version-check --root-user-action=ignore fortitude-lint==0.10.0
cat > third.f90 <<'END'
program third
   use, intrinsic :: iso_fortran_env, only: dp => real64
   implicit none
   real(dp) :: x, y(3)
   integer(8) :: seed, seeds(2)
   character(len=10) :: name, names(2)

   x = 1.0_dp/3.0_dp
   y = x
   seed = 7
   seeds = seed
   name = 'midpoint'
   names = name
   print *, x, y(1), kind(seeds), len(names)
end program third
END
run() { gfortran-12 -w third.f90 -o third; ./third | tr -s ' '; }
venv/bin/fortitude --version
gfortran-12 --version | grep '12\.2\.0'
before=$(run)
venv/bin/fortitude check --select S262 --fix third.f90 > log || true
safe=$(run)
venv/bin/fortitude check --select S262 --fix --unsafe-fixes third.f90 > log || true
after=$(run)
grep '::' third.f90
echo "before: $before; after --fix: $safe; after --unsafe-fixes: $after"
[ "$before" = " 0.33333333333333331 0.33333333333333331 8 10" ] && [ "$safe" = "$before" ]
[ "$after" = " 0.33333333333333331 0.333333343 4 1" ]
grep -q '^ *real :: y(3)$' third.f90
