! SPDX-License-Identifier: BSD-3-Clause
!> The probe of rates of damping that are functions: their declarations must hold at the points.
!>
!>    gamma(q, t) >= 0           unless gain is allowed
!>    of time alone              gamma(q, t) = gamma(q', t)
!>    of position alone          gamma(q, t) = gamma(q, t')
!>    lane by lane               a lane alone among others has the rates that it has among its likes
!>
!> Private to its family.
module symsde_model_probe_damping
   use symsde_base_damping, only: door_of_gain
   use symsde_base_kinds, only: wp
   use symsde_base_status, only: error_type, raise, false_trait, invalid_argument
   use symsde_base_text, only: to_text
   use symsde_model_probe_points, only: probe_points, nlane, npoint
   implicit none
   private
   public :: probe_damping

   real(wp), parameter :: vanishing = 1.0e-6_wp  !! rates are compared to six digits

contains

   !> Refuse rates that one of these tests refutes. Points with rates that are not finite are passed over.
   subroutine probe_damping(points, error)
      type(probe_points), intent(in) :: points
      type(error_type), allocatable, intent(inout) :: error
      real(wp), allocatable, dimension(:, :) :: rate, other, q
      integer :: n, lane, i, code

      if (allocated(error) .or. points%model%damping%is_constant()) return
      associate (varying => points%model%damping%varying, ndof => points%ndof, t => points%t)
         n = merge(1, ndof, varying%one)
         allocate (rate(nlane, n), other(nlane, n))
         q = points%q
         call varying%find(nlane, ndof, n, t, q, rate, code)
         if (code == 0 .and. .not. points%model%damping%gain) then
            do i = 1, n
               do lane = 1, npoint
                  if (.not. rate(lane, i) < 0 .or. allocated(error)) cycle
                  call raise(error, invalid_argument, 'probe_damping', 'the damping of model '//points%model%name// &
                             ' has the negative rate '//to_text(rate(lane, i))//' at '//points%place(lane, i, i)// &
                             ', which would make momenta grow: give rates of zero or more, or '//door_of_gain)
               end do
            end do
         end if
         if (.not. varying%of_time .and. code == 0) then
            call varying%find(nlane, ndof, n, t + 1 + 0.37_wp*abs(t), q, other, code)
            call compare('depends on position alone, and its rates change with time')
         end if
         q = spread(points%q(2, :), 1, nlane)
         if (code == 0) call varying%find(nlane, ndof, n, t, q, other, code)
         if (.not. varying%of_position) then
            call compare('depends on time alone, and its rates change with position')
         else if (code == 0) then
            do i = 1, n
               rate(:, i) = rate(2, i)
            end do
            call compare('is computed lane by lane, and it mixes lanes')
         end if
      end associate
      if (code /= 0) call points%model%note_failure(code)

   contains

      !> Refuse the rates if they differ from those compared.
      subroutine compare(what)
         character(*), intent(in) :: what
         integer :: j, k

         if (code /= 0) return
         do j = 1, n
            do k = 1, npoint
               if (.not. abs(other(k, j) - rate(k, j)) > vanishing*abs(rate(k, j)) .or. allocated(error)) cycle
               call raise(error, false_trait, 'probe_damping', 'the damping of model '//points%model%name// &
                          ' is said to be what '//what//': '//to_text(rate(k, j))//' and '//to_text(other(k, j))// &
                          '; say what it depends on')
            end do
         end do
      end subroutine compare

   end subroutine probe_damping

end module symsde_model_probe_damping
