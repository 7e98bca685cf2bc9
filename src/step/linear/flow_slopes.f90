! SPDX-License-Identifier: BSD-3-Clause
!>    H_p = S_pq q + S_pp p  for every theta,   so   d/dtheta_k H_p = S_k,pq q + S_k,pp p,      S_k = dS/dtheta_k
!>
!> The probe of how linear flows between kicks change with parameters, as a wide model tells it: products of its Hessian
!> with the directions theta_k, at states z = e_j that have one coordinate alone, are columns of S_k. Two blocks are
!> compared each with its own size, so that no unit of length, time or theta_k matters. S_k,qq is a choice like S_qq,
!> since V = H - D is the remainder: any choice gives the derivative of the runs in which S_qq changes so.
!>
!> Private to its family.
module symsde_step_linear_flow_slopes
   use symsde_base_kinds, only: wp
   use symsde_base_lanes, only: nlane => lane_unit
   use symsde_base_status, only: error_type, raise, false_trait
   use symsde_base_text, only: to_text
   use symsde_model_abstract, only: model_type
   implicit none
   private
   public :: probe_slopes

   real(wp), parameter :: matching = 1.0e-6_wp              !! mismatch, as part of the largest entry of a block
   real(wp), parameter :: rounding = 64*epsilon(1.0_wp)     !! the same, as part of S/theta_k
   real(wp), parameter :: later = 0.37_wp                   !! a second time, at which the slopes must be the same

contains

   !> Refuse (false_trait) slopes that are not those of the wide model's velocities. Entries that are not finite in its
   !> Hessian are skipped.
   subroutine probe_slopes(wide, second, slopes, theta, t, error)
      class(model_type), intent(in) :: wide
      real(wp), intent(in) :: second(:, :)      !! S (2 ndof, 2 ndof)
      real(wp), intent(in) :: slopes(:, :, :)   !! S_k (2 ndof, 2 ndof, nparameter)
      real(wp), intent(in) :: theta(:)          !! parameters (nparameter)
      real(wp), intent(in) :: t
      type(error_type), allocatable, intent(inout) :: error
      real(wp) :: found(size(second, 1)/2, size(second, 1))
      integer :: k, pass, n

      n = size(second, 1)/2
      do k = 1, size(slopes, 3)
         do pass = 0, 1
            if (allocated(error)) exit
            call find_columns(wide, n, k, theta, t + pass*later, found)
            call compare('q', found(:, :n), slopes(n + 1:, :n, k), second(n + 1:, :n))
            call compare('p', found(:, n + 1:), slopes(n + 1:, n + 1:, k), second(n + 1:, n + 1:))
         end do
      end do
      call wide%clear_failure()  ! a user's function may fail at these states

   contains

      !> Compare a block of S_k with what the Hessian says; s: the block of S, whose rounding is that of S_k.
      subroutine compare(half, x, told, s)
         character(*), intent(in) :: half
         real(wp), intent(in), dimension(:, :) :: x, told, s   !! (ndof, ndof)
         real(wp) :: most
         integer :: at(2)

         at = maxloc(abs(x - told), mask=abs(x) <= huge(1.0_wp))
         if (any(at == 0)) return
         associate (y => x(at(1), at(2)), z => told(at(1), at(2)))
            most = matching*max(abs(y), maxval(abs(told)))
            if (abs(theta(k)) > 0) most = most + rounding*maxval(abs(s/theta(k)))
            if (abs(y - z) > most) &
               call raise(error, false_trait, 'check_flow_slopes', "model '"//wide%name//"' tells that d2H/(dp_"// &
                          to_text(at(1))//' d'//half//'_'//to_text(at(2))//') changes with parameter '//to_text(k)// &
                          ' by '//to_text(z)//', and its Hessian says by '//to_text(y)//': correct the slopes of '// &
                          'flows, or the Hessian')
         end associate
      end subroutine compare

   end subroutine probe_slopes

   !> d/dtheta_k H_p at the states e_j, whose columns stand in the lanes of a block.
   subroutine find_columns(wide, n, k, theta, t, found)
      class(model_type), intent(in) :: wide
      integer, intent(in) :: n, k
      real(wp), intent(in) :: theta(:), t
      real(wp), intent(out) :: found(n, 2*n)
      real(wp), dimension(nlane, n + size(theta)) :: q, p, vq, vp, uq, up
      real(wp) :: w(nlane, 0:wide%traits%nnoise)
      integer :: first, j

      w = 0
      w(:, 0) = 1
      vq = 0
      vq(:, n + k) = 1
      vp = 0
      do first = 1, 2*n, nlane
         q = 0
         p = 0
         q(:, n + 1:) = spread(theta, 1, nlane)
         do j = first, min(first + nlane - 1, 2*n)
            if (j <= n) q(j - first + 1, j) = 1
            if (j > n) p(j - first + 1, j - n) = 1
         end do
         call wide%hessian_vector(nlane, size(q, 2), wide%traits%nnoise, t, w, q, p, vq, vp, uq, up)
         do j = first, min(first + nlane - 1, 2*n)
            found(:, j) = up(j - first + 1, :n)
         end do
      end do
   end subroutine find_columns

end module symsde_step_linear_flow_slopes
