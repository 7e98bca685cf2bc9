! SPDX-License-Identifier: BSD-3-Clause
!> Increments given by the user, one row a step; with refine = l > 0, 2^l finer rows a step, added as a tree.
!>
!> Schemes that need dZ or areas need finer rows: the path is then the polygon through them, whose dZ
!> and areas are exact (its mean-square error against the Brownian path is h^3/(12 4^l) in dZ and
!> h^2/(4 2^l) in an area).
module symsde_noise_prescribed
   use symsde_base_kinds, only: wp, i8
   use symsde_noise_integrals, only: step_integrals, merge_steps
   use symsde_noise_source, only: noise_type, clip_lanes, clip_integrals
   implicit none
   private
   public :: prescribed_noise, new_prescribed_noise

   type, extends(noise_type) :: prescribed_noise
      private
      integer(i8) :: first_path = 0, first_step = 0
      integer :: refine = 0
      real(wp) :: h = 0                             !! step with its sign, for dZ [time]
      real(wp), pointer, contiguous :: dw(:, :, :)  !! (npath or 1, nnoise, nstep*2^refine), the user's array
   contains
      procedure :: fill => fill_prescribed
      procedure :: fill_integrals => fill_prescribed_integrals
   end type prescribed_noise

contains

   !> A source that reads the user's array; path 1 of it is first_path, its first row is first_step.
   subroutine new_prescribed_noise(self, dw, first_path, first_step, refine, h)
      type(prescribed_noise), intent(out) :: self
      real(wp), intent(in), target, contiguous :: dw(:, :, :)  !! increments (npath or 1, nnoise, rows)
      integer(i8), intent(in) :: first_path, first_step
      integer, intent(in) :: refine  !! 0 or more
      real(wp), intent(in), optional :: h  !! step of the run, needed for dZ [time]

      if (present(h)) self%h = h
      self%nnoise = size(dw, 2)
      self%dw => dw
      self%first_path = first_path
      self%first_step = first_step
      self%refine = refine
      allocate (self%silent(self%nnoise), source=.false.)
   end subroutine new_prescribed_noise

   subroutine fill_prescribed(self, nlane, path, pair, w, drawn)
      class(prescribed_noise), intent(in) :: self
      integer, intent(in) :: nlane
      integer(i8), intent(in) :: path(nlane), pair
      real(wp), intent(inout) :: w(nlane, 0:self%nnoise, 0:1)
      integer(i8), intent(inout) :: drawn
      integer(i8) :: row, rows
      integer :: k, half

      rows = 2_i8**self%refine
      do half = 0, 1
         row = (2*pair + half - self%first_step)*rows + 1
         if (row < 1 .or. row + rows - 1 > size(self%dw, 3, i8)) cycle  ! not a step of this run
         do k = 1, self%nnoise
            call sum_rows(self, nlane, path, k, row, rows, w(:, k, half))
            if (self%bound < huge(1.0_wp)) call clip_lanes(nlane, self%bound, w(:, k, half))
         end do
      end do
   end subroutine fill_prescribed

   !> Increments, dZ and areas of the polygon through the rows of a step.
   subroutine fill_prescribed_integrals(self, nlane, path, pair, w, z, area, drawn)
      class(prescribed_noise), intent(in) :: self
      integer, intent(in) :: nlane
      integer(i8), intent(in) :: path(nlane), pair
      real(wp), intent(inout) :: w(nlane, 0:self%nnoise, 0:1)
      real(wp), intent(inout) :: z(nlane, self%nz, 0:1), area(nlane, self%narea, 0:1)
      integer(i8), intent(inout) :: drawn
      type(step_integrals) :: whole
      integer(i8) :: row, rows
      integer :: half

      rows = 2_i8**self%refine
      do half = 0, 1
         row = (2*pair + half - self%first_step)*rows + 1
         if (row < 1 .or. row + rows - 1 > size(self%dw, 3, i8)) cycle  ! not a step of this run
         call polygon(self, nlane, path, row, rows, whole)
         w(:, 1:, half) = whole%w
         z(:, :, half) = whole%z
         area(:, :, half) = whole%a
         if (self%bound < huge(1.0_wp)) &
            call clip_integrals(nlane, self%nnoise, self%nz, self%narea, self%bound, self%h, &
                                w(:, 1:, half), z(:, :, half), area(:, :, half))
      end do
   end subroutine fill_prescribed_integrals

   !> Rows row .. row+rows-1 as one interval; a single row is a straight line: dZ = h dW/2, no area.
   recursive subroutine polygon(self, nlane, path, row, rows, whole)
      class(prescribed_noise), intent(in) :: self
      integer, intent(in) :: nlane
      integer(i8), intent(in) :: path(nlane), row, rows
      type(step_integrals), intent(out) :: whole
      type(step_integrals) :: left, right
      integer :: k

      if (rows > 1) then
         call polygon(self, nlane, path, row, rows/2, left)
         call polygon(self, nlane, path, row + rows/2, rows/2, right)
         call merge_steps(nlane, self%nnoise, left, right, whole)
         return
      end if
      whole%length = self%h/2.0_wp**self%refine
      allocate (whole%w(nlane, self%nnoise), whole%z(nlane, self%nz))
      allocate (whole%a(nlane, self%narea), source=0.0_wp)
      do k = 1, self%nnoise
         call sum_rows(self, nlane, path, k, row, 1_i8, whole%w(:, k))
         if (self%needs_dz) whole%z(:, k) = 0.5_wp*whole%length*whole%w(:, k)
      end do
   end subroutine polygon

   !> Sum of rows row .. row+rows-1 as a balanced binary tree, as the Brownian source adds its draws.
   recursive subroutine sum_rows(self, nlane, path, k, row, rows, dw)
      class(prescribed_noise), intent(in) :: self
      integer, intent(in) :: nlane, k
      integer(i8), intent(in) :: path(nlane), row, rows
      real(wp), intent(out) :: dw(nlane)
      real(wp) :: right(nlane)
      integer :: lane

      if (rows > 1) then
         call sum_rows(self, nlane, path, k, row, rows/2, dw)
         call sum_rows(self, nlane, path, k, row + rows/2, rows/2, right)
         dw = dw + right
      else if (size(self%dw, 1) == 1) then
         dw = self%dw(1, k, row)
      else
         do lane = 1, nlane
            dw(lane) = self%dw(path(lane) - self%first_path + 1, k, row)
         end do
      end if
   end subroutine sum_rows

end module symsde_noise_prescribed
