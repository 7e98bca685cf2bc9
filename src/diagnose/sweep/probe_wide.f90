! SPDX-License-Identifier: BSD-3-Clause
!>    H_j(q, p; theta) of the wide model = H_j(q, p) of the model,      j = 0 .. m
!>
!> The probe of a wide model that a user gives, whose further positions are the parameters theta: its derivatives are
!> probed as those of every user's model, and its gradients by q and p must be those of the model that it widens.
module symsde_diagnose_sweep_probe_wide
   use symsde_base_kinds, only: wp
   use symsde_base_lanes, only: nlane => lane_unit
   use symsde_base_status, only: error_type, raise, false_trait
   use symsde_base_text, only: to_text
   use symsde_model_abstract, only: model_type
   use symsde_model_catalogue_by_name, only: is_built_in
   use symsde_model_probe_traits, only: probe_model
   implicit none
   private
   public :: probe_wide

   real(wp), parameter :: matching = 1.0e-6_wp   !! mismatch, as part of the largest component of H_q, or of H_p

contains

   !> Refuse (false_trait) a wide model with false traits or derivatives, or with other Hamiltonians than the model has
   !> at these parameters, around the initial state of one path. Models that a program derived are not probed.
   subroutine probe_wide(model, wide, t, q0, p0, theta, error)
      class(model_type), intent(in) :: model, wide
      real(wp), intent(in) :: t
      real(wp), intent(in) :: q0(:), p0(:)   !! (ndof)
      real(wp), intent(in) :: theta(:)       !! (nparameter)
      type(error_type), allocatable, intent(inout) :: error
      real(wp), dimension(size(q0) + size(theta)) :: q, p
      integer :: first, n

      if (allocated(error) .or. is_built_in(wide) .or. wide%passed%is_kept()) return
      n = size(q0)
      q(:n) = q0
      q(n + 1:) = theta
      p(:n) = p0
      p(n + 1:) = 0
      call probe_model(wide, t, q, p, error)
      if (.not. model%traits%has_gradient) return
      do first = 0, model%traits%nnoise, nlane
         call compare(model, wide, first, t, q, p, error)
      end do
      call model%clear_failure()
      call wide%clear_failure()
   end subroutine probe_wide

   !> Compare gradients of H_first and those behind it, each in a lane of its own.
   subroutine compare(model, wide, first, t, q0, p0, error)
      class(model_type), intent(in) :: model, wide
      integer, intent(in) :: first
      real(wp), intent(in) :: t, q0(:), p0(:)   !! a state of the wide model
      type(error_type), allocatable, intent(inout) :: error
      real(wp) :: w(nlane, 0:model%traits%nnoise)
      real(wp), dimension(nlane, size(q0)) :: q, p, hq, hp
      real(wp), dimension(nlane, model%traits%ndof) :: own_q, own_p
      integer :: i, j, n

      if (allocated(error)) return
      n = model%traits%ndof
      w = 0
      do j = first, min(first + nlane - 1, model%traits%nnoise)
         w(1 + j - first, j) = 1
      end do
      do i = 1, size(q0)
         q(:, i) = q0(i)
         p(:, i) = p0(i)
      end do
      call model%gradient(nlane, n, model%traits%nnoise, t, w, q(:, :n), p(:, :n), own_q, own_p)
      call wide%gradient(nlane, size(q0), model%traits%nnoise, t, w, q, p, hq, hp)
      do j = first, min(first + nlane - 1, model%traits%nnoise)
         call judge('q', own_q(1 + j - first, :), hq(1 + j - first, :n))
         call judge('p', own_p(1 + j - first, :), hp(1 + j - first, :n))
      end do

   contains

      !> Refuse the largest difference of H_j by q, or by p, unless it is rounding or not finite.
      subroutine judge(half, own, given)
         character(*), intent(in) :: half
         real(wp), intent(in), dimension(:) :: own, given   !! (ndof)
         integer :: i

         i = maxloc(abs(own - given), dim=1)
         if (.not. abs(own(i) - given(i)) > matching*max(maxval(abs(own)), maxval(abs(given)))) return
         call raise(error, false_trait, 'probe_wide', 'dH_'//to_text(j)//'/d'//half//'_'//to_text(i)// &
                    ' of model '''//wide%name//''' is '//to_text(given(i))//' at the initial state and these '// &
                    'parameters, and that of model '''//model%name//''' is '//to_text(own(i))//': give the '// &
                    'parameters of the model, in the order of the further positions, and the same Hamiltonians')
      end subroutine judge

   end subroutine compare

end module symsde_diagnose_sweep_probe_wide
