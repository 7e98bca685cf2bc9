#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# gfortran 12.2.0 and OpenCoarrays 2.10.1 (Debian 12) with mpich 5.0.2 (PyPI): random_init, one image.
# Guess: `call random_init(.false., .false.)`, by which serial programs ask for a seed by chance, gives other numbers in each run,
#     whatever -fcoarray is.
# Seen: with -fcoarray=single it does. With -fcoarray=lib it gives the numbers of random_init(.true., .true.), in every run. Only
#     random_init(.false., .true.) is by chance in both.
# For users of stochastic integrators: compiled for coarrays, a program that asks for chance has the same paths in every task.
. "$(dirname "$0")/debs.sh" {gfortran-12,gcc-12,libgcc-12-dev,libgfortran-12-dev}=12.2.0-14+deb12u1 \
   {libgfortran5,libquadmath0}=12.2.0-14+deb12u1 libisl23=0.25-1.1 libmpc3=1.3.1-1 libmpfr6=4.2.0-1 \
   libcoarrays-mpich-dev=2.10.1-1+b1
python3 -m venv --without-pip venv
python3 -m pip --python venv/bin/python install --quiet --no-compile --disable-pip-version-check --root-user-action=ignore \
   mpich==5.0.2
cat > draw.f90 <<'END'
program draw
   implicit none
   real :: x(4)
   integer :: i

   do i = 1, 4
      call random_init(repeatable=i < 3, image_distinct=mod(i, 2) == 1)
      call random_number(x(i))
   end do
   print '(4f12.8)', x
end program draw
END
gfortran-12 -fcoarray=single draw.f90 -o single
gfortran-12 -fcoarray=lib draw.f90 -o lib "$here/usr/lib/x86_64-linux-gnu/open-coarrays/mpich/lib/libcaf_mpich.a" \
   -L"$here/venv/lib" -l:libmpi.so.12
export LD_LIBRARY_PATH="$here/venv/lib:$LD_LIBRARY_PATH"
gfortran-12 --version | head -1
gfortran-12 --version | grep -q '12\.2\.0'
echo "first number after random_init(T, T), (T, F), (F, T), (F, F)"
for program in single lib; do
   "./$program" > first
   "./$program" > second
   sed "s/^/$program/" first second
   paste -d' ' first second > "$program.out"
done
awk '{exit !($1 == $2 && $1 == $5 && $3 != $7 && $4 != $8 && $4 != $1)}' single.out
awk '{exit !($1 == $2 && $1 == $5 && $3 != $7 && $4 == $8 && $4 == $1)}' lib.out
