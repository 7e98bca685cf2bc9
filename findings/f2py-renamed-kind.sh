#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# f2py of numpy 2.4.6 (PyPI).
# Guess: `use iso_c_binding, only: dp => c_double` makes real(dp) an array of double precision, as real(c_double) does.
# Seen: the wrapper that f2py writes for real(dp) takes an array of single precision ('f'), without a warning; the same
#     routine with real(c_double) takes double ('d'). Only the written wrapper is looked at here; it is not compiled.
# For users of stochastic integrators: a gradient in modern Fortran, wrapped so, is called with numbers of the wrong size; name
#     the kind c_double itself, or give a file .f2py_f2cmap, and read the docstring of the wrapper.
. "$(dirname "$0")/venv.sh" numpy==2.4.6
write() {
   sed "s/KIND/$2/; s/NAME/$3/g" > "$1.f90" <<'END'
subroutine force(n, q, f)
   use iso_c_binding, only: KIND
   implicit none
   integer, intent(in) :: n
   real(NAME), intent(in) :: q(n)
   real(NAME), intent(out) :: f(n)
   f = -q
end subroutine force
END
   python -m numpy.f2py "$1.f90" -m "$1" > "$1.log" 2>&1
   grep -q -i "warning.*kind" "$1.log" && exit 1
   grep -o "q : input rank-1 array('.')" "$1module.c" | sort -u
}
renamed=$(write renamed "dp => c_double" dp)
direct=$(write direct c_double c_double)
python -c 'import numpy; print("numpy", numpy.__version__)'
echo "real(dp): $renamed; real(c_double): $direct"
[ "$renamed" = "q : input rank-1 array('f')" ]
[ "$direct" = "q : input rank-1 array('d')" ]
