! SPDX-License-Identifier: BSD-3-Clause
!> Counts of the work of a run, summed over paths: they prove which operations were spared.
module symsde_base_counters
   use symsde_base_kinds, only: i8
   implicit none
   private
   public :: counters_type, add_counters

   !> Every count is in units of one path: a gradient of a block of 200 paths counts 200.
   type :: counters_type
      integer(i8) :: steps = 0            !! path-steps, before a path failed, was absorbed or stopped
      integer(i8) :: normals = 0          !! normal deviates drawn for these steps, by pairs of steps
      integer(i8) :: gradients = 0        !! gradients of a weighted sum of Hamiltonians
      integer(i8) :: hessians = 0         !! Hessians of a weighted sum
      integer(i8) :: hessian_vectors = 0  !! Hessian-vector products
      integer(i8) :: iterations = 0       !! Newton or fixed-point iterations, each until its own lane was done
      integer(i8) :: solves = 0           !! linear systems solved
      integer(i8) :: pivoted_solves = 0   !! solves with exchanges of rows
      integer(i8) :: lapack_solves = 0    !! solves by LAPACK, with exchanges of rows
      integer(i8) :: failures = 0         !! path-steps that Newton from zero increments did not solve
      integer(i8) :: damped = 0           !! failures that shortened corrections of Newton solved
      integer(i8) :: continued = 0        !! failures that continuation in the increments solved
   end type counters_type

contains

   !> total = total + part, or total - part
   pure subroutine add_counters(total, part, sign)
      type(counters_type), intent(inout) :: total
      type(counters_type), intent(in) :: part
      integer, intent(in), optional :: sign  !! 1 if absent, or -1
      integer :: s

      s = 1
      if (present(sign)) s = sign
      total%steps = total%steps + s*part%steps
      total%normals = total%normals + s*part%normals
      total%gradients = total%gradients + s*part%gradients
      total%hessians = total%hessians + s*part%hessians
      total%hessian_vectors = total%hessian_vectors + s*part%hessian_vectors
      total%iterations = total%iterations + s*part%iterations
      total%solves = total%solves + s*part%solves
      total%pivoted_solves = total%pivoted_solves + s*part%pivoted_solves
      total%lapack_solves = total%lapack_solves + s*part%lapack_solves
      total%failures = total%failures + s*part%failures
      total%damped = total%damped + s*part%damped
      total%continued = total%continued + s*part%continued
   end subroutine add_counters

end module symsde_base_counters
