#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# gfortran 12.2.0 (Debian 12), random_number under OpenMP.
# Guess: `call random_seed(put=seed)` before a parallel region starts the same numbers again in all its threads, so that three
#     runs of one ensemble in a program are equal.
# Seen: only the thread that calls random_seed starts again. The other three of four go on in their own sequences: thread 0
#     has one number three times, threads 1 to 3 have three numbers each. The whole program, run twice, is equal.
# For users of stochastic integrators: a hand-written ensemble that resets the seed for each step size compares paths of
#     different noise, except those of the first thread.
. "$(dirname "$0")/debs.sh" {gfortran-12,gcc-12,libgcc-12-dev,libgfortran-12-dev}=12.2.0-14+deb12u1 \
   {libgfortran5,libgomp1,libquadmath0}=12.2.0-14+deb12u1 \
   libisl23=0.25-1.1 libmpc3=1.3.1-1 libmpfr6=4.2.0-1
cat > seeds.f90 <<'END'
program seeds
   use omp_lib, only: omp_get_thread_num
   implicit none
   integer :: n, run
   integer, allocatable :: seed(:)
   double precision :: drawn(0:3)

   call random_seed(size=n)
   allocate (seed(n))
   seed = 42
   do run = 1, 3
      call random_seed(put=seed)
      !$omp parallel num_threads(4)
      call random_number(drawn(omp_get_thread_num()))
      !$omp end parallel
      print '(4f20.16)', drawn
   end do
end program seeds
END
gfortran-12 --version | head -1
gfortran-12 -fopenmp seeds.f90 -o seeds
./seeds | tee first
./seeds > second
cmp first second
gfortran-12 --version | grep -q '12\.2\.0'
awk '{for (i = 1; i <= 4; i++) if (!seen[i, $i]++) different[i]++}
     END {print "different numbers of threads 0 to 3:", different[1], different[2], different[3], different[4]
          exit !(different[1] == 1 && different[2] == 3 && different[3] == 3 && different[4] == 3)}' first
