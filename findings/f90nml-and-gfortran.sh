#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# f90nml 1.5.0 (PyPI) and gfortran 12.2.0 (Debian 12): one namelist, read by both.
# Guess: what gfortran takes as a namelist f90nml reads to the same values.
# Seen: a complex number whose second part has a sign is text to f90nml, "(1.5, -2.0)", without it a number. Where a subscript
#     starts a list, `k(2) = 1, 2, 3`, gfortran fills k(2:4), f90nml keeps the first value and warns. `.t` is text, `t` is
#     true; `1q-3` is a list of 1, "q" and -3. Omitted exponents (1.5+3), repeats and nulls are read alike.
# For users of stochastic integrators: a table of runs that Python makes of the namelists of a Fortran program can differ from
#     what was run: look at types, write subscripts as ranges and logical values in words.
. "$(dirname "$0")/debs.sh" {gfortran-12,gcc-12,libgcc-12-dev,libgfortran-12-dev}=12.2.0-14+deb12u1 \
   {libgfortran5,libquadmath0}=12.2.0-14+deb12u1 libisl23=0.25-1.1 libmpc3=1.3.1-1 libmpfr6=4.2.0-1
cat > reader.f90 <<'END'
program reader
   implicit none
   double precision :: h = 0, k(4) = 0
   logical :: quiet = .false.
   complex(kind(1d0)) :: z = (0, 0)
   namelist /run/ h, k, quiet, z

   read (*, nml=run)
   print '(7(es10.3, 1x), l1)', h, k, z, quiet
end program reader
END
gfortran-12 reader.f90 -o reader
gfortran-12 --version | head -1
gfortran-12 --version | grep -q '12\.2\.0'
python3 -m venv --without-pip venv
python3 -m pip --python venv/bin/python install --quiet --disable-pip-version-check --root-user-action=ignore f90nml==1.5.0
venv/bin/python -W ignore - <<'END'
import subprocess

import f90nml

print("f90nml", f90nml.__version__)
ZERO = dict(h=0.0, k=[0.0] * 4, z=0j, quiet=False)


def gfortran(group):
    words = subprocess.run(["./reader"], input=group, capture_output=True, text=True, check=True).stdout.split()
    numbers = [float(word) for word in words[:7]]
    return dict(h=numbers[0], k=numbers[1:5], z=complex(*numbers[5:7]), quiet=words[7] == "T")


for text, name, by_gfortran, by_f90nml in (
    ("h = 1.5+3", "h", 1500.0, 1500.0),
    ("k = 2*0.5, 2*", "k", [0.5, 0.5, 0.0, 0.0], [0.5, 0.5, None, None]),
    ("k(2:4) = 1, 2, 3", "k", [0.0, 1.0, 2.0, 3.0], [1, 2, 3]),
    ("k(2) = 1, 2, 3", "k", [0.0, 1.0, 2.0, 3.0], [1]),
    ("z = (1.5, 2.0)", "z", 1.5 + 2j, 1.5 + 2j),
    ("z = (1.5, -2.0)", "z", 1.5 - 2j, "(1.5, -2.0)"),
    ("quiet = t", "quiet", True, True),
    ("quiet = .t", "quiet", True, ".t"),
    ("h = 1q-3", "h", 1e-3, [1, "q", -3]),
):
    group = f"&run\n {text}\n/\n"
    read, parsed = gfortran(group), f90nml.reads(group)["run"][name]
    print(f"{text:18}", "gfortran", read[name], "f90nml", repr(parsed))
    assert read == ZERO | {name: by_gfortran}, read
    assert parsed == by_f90nml and type(parsed) is type(by_f90nml), parsed
END
