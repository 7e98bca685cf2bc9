#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# gfortran 12.2.0 (Debian 12) writing by es14.6, read by numpy 2.4.6 and pandas 3.1.1 (PyPI), awk and sort -g of the machine.
# Guess: numbers of a column are read as they are, or the reader says that it cannot.
# Seen: below 1e-99 Fortran drops the letter, 5.148200-131, as its standard says. awk reads 5.1482 and sort -g puts it last,
#     silently; genfromtxt reads NaN, silently; pandas makes the whole column text; loadtxt refuses it, and names the row.
# For users of stochastic integrators: tails of densities, weights and gaps to an invariant reach 1e-100: write es15.6e3, or
#     binary files.
. "$(dirname "$0")/debs.sh" {gfortran-12,gcc-12,libgcc-12-dev,libgfortran-12-dev}=12.2.0-14+deb12u1 \
   {libgfortran5,libquadmath0}=12.2.0-14+deb12u1 libisl23=0.25-1.1 libmpc3=1.3.1-1 libmpfr6=4.2.0-1
cat > tail.f90 <<'END'
program tail
   implicit none
   integer :: i

   do i = 0, 3
      print '(i2, 1x, es14.6)', i, exp(-100d0*i)
   end do
end program tail
END
gfortran-12 tail.f90 -o tail
./tail > table
gfortran-12 --version | head -1
gfortran-12 --version | grep -q '12\.2\.0'
grep -q '5\.148200-131$' table
awk=$(awk '$1 == 3 {print $2 + 0}' table) last=$(sort -g -k 2 table | tail -1 | cut -c 1-2)
echo "awk reads $awk; row that sort -g takes for the largest: $last"
[ "$awk" = 5.1482 ] && [ "$last" -eq 3 ]
python3 -m venv --without-pip venv
python3 -m pip --python venv/bin/python install --quiet --no-compile --disable-pip-version-check --root-user-action=ignore \
   numpy==2.4.6 pandas==3.1.1
venv/bin/python -W error - <<'END'
import numpy as np
import pandas as pd

print("numpy", np.__version__, "pandas", pd.__version__)
read = np.genfromtxt("table")[:, 1]
column = pd.read_csv("table", sep=r"\s+", header=None)[1]
try:
    np.loadtxt("table")
    refused = ""
except ValueError as error:
    refused = str(error)
print("genfromtxt", read, "pandas", column.dtype, "loadtxt:", refused)
assert np.isnan(read[3]) and (read[:3] > 0).all() and not pd.api.types.is_numeric_dtype(column) and "row 3" in refused
END
