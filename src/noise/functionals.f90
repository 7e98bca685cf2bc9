! SPDX-License-Identifier: BSD-3-Clause
!> The law of each functional of the path: its value on the finest intervals, how those of neighbouring
!> intervals merge, how far a truncated run lets it go. Everything that is particular to one functional and
!> not its name (base/functionals) stands here.
!>
!> A finest interval is a parabola with its dW and its H = dZ/h - dW/2. On it
!>
!>    dZ_k = h (dW_k/2 + H_k),   A_kl = H_k dW_l - H_l dW_k
!>
!> and neighbouring intervals merge by
!>
!>    dW = dW_1 + dW_2,  dZ = dZ_1 + dZ_2 + h_2 dW_1,  A_kl = A_1 + A_2 + (dW_k1 dW_l2 - dW_l1 dW_k2)/2
module symsde_noise_functionals
   use symsde_base_functionals, only: functional_set, functional_count, area_index, nfunctional, path_dz, path_areas
   use symsde_base_kinds, only: wp
   implicit none
   private
   public :: path_interval, new_path_interval, parabola_values, merge_intervals, clip_increments, clip_interval

   type :: interval_values
      real(wp), allocatable :: x(:, :)     !! (nlane, functional_count); not allocated where not asked for
   end type interval_values

   !> One interval of the path in every lane.
   type :: path_interval
      real(wp) :: length = 0               !! with its sign [time]
      real(wp), allocatable :: w(:, :)     !! dW_k (nlane, nnoise)
      type(interval_values) :: of(nfunctional)
   end type path_interval

contains

   !> Room for an interval; the caller gives dW and values.
   pure subroutine new_path_interval(self, nlane, nnoise, length, asked)
      type(path_interval), intent(out) :: self
      integer, intent(in) :: nlane, nnoise
      real(wp), intent(in) :: length
      type(functional_set), intent(in) :: asked
      integer :: f

      self%length = length
      allocate (self%w(nlane, nnoise))
      do f = 1, nfunctional
         if (asked%has(f)) allocate (self%of(f)%x(nlane, functional_count(f, nnoise)))
      end do
   end subroutine new_path_interval

   !> Values of a functional on the parabola with dW and H.
   pure subroutine parabola_values(functional, nlane, nnoise, length, w, hh, x)
      integer, intent(in) :: functional, nlane, nnoise
      real(wp), intent(in) :: length, w(nlane, nnoise), hh(nlane, nnoise)
      real(wp), intent(out) :: x(nlane, functional_count(functional, nnoise))
      integer :: k, l

      select case (functional)
      case (path_areas)
         do l = 2, nnoise
            do k = 1, l - 1
               x(:, area_index(k, l)) = hh(:, k)*w(:, l) - hh(:, l)*w(:, k)
            end do
         end do
      case default  ! path_dz
         x = length*(0.5_wp*w + hh)
      end select
   end subroutine parabola_values

   !> Two neighbouring intervals as one.
   pure subroutine merge_intervals(nlane, nnoise, left, right, whole)
      integer, intent(in) :: nlane, nnoise
      type(path_interval), intent(in) :: left, right
      type(path_interval), intent(out) :: whole
      type(functional_set) :: asked
      integer :: f, k

      do f = 1, nfunctional
         asked%has(f) = allocated(left%of(f)%x)
      end do
      call new_path_interval(whole, nlane, nnoise, left%length + right%length, asked)
      whole%w = left%w + right%w
      if (asked%has(path_dz)) then
         do k = 1, nnoise
            whole%of(path_dz)%x(:, k) = (left%of(path_dz)%x(:, k) + right%of(path_dz)%x(:, k)) &
                                        + right%length*left%w(:, k)
         end do
      end if
      if (asked%has(path_areas)) &
         call merge_areas(nlane, nnoise, left%w, right%w, left%of(path_areas)%x, right%of(path_areas)%x, &
                          whole%of(path_areas)%x)
   end subroutine merge_intervals

   pure subroutine merge_areas(nlane, nnoise, w1, w2, a1, a2, a)
      integer, intent(in) :: nlane, nnoise
      real(wp), intent(in) :: w1(nlane, nnoise), w2(nlane, nnoise)
      real(wp), intent(in) :: a1(nlane, functional_count(path_areas, nnoise))
      real(wp), intent(in) :: a2(nlane, functional_count(path_areas, nnoise))
      real(wp), intent(out) :: a(nlane, functional_count(path_areas, nnoise))
      integer :: k, l, kl, lane

      do l = 2, nnoise
         do k = 1, l - 1
            kl = area_index(k, l)
            do lane = 1, nlane
               a(lane, kl) = (a1(lane, kl) + a2(lane, kl)) &
                             + 0.5_wp*(w1(lane, k)*w2(lane, l) - w1(lane, l)*w2(lane, k))
            end do
         end do
      end do
   end subroutine merge_areas

   !> Clip increments to [-bound, bound]; applied to the summed increment of the level in use.
   pure subroutine clip_increments(n, bound, dw)
      integer, intent(in) :: n
      real(wp), intent(in) :: bound
      real(wp), intent(inout) :: dw(n)
      integer :: i

      do i = 1, n
         dw(i) = min(max(dw(i), -bound), bound)
      end do
   end subroutine clip_increments

   !> Truncate a step: dW_k to the bound, H_k = dZ_k/h - dW_k/2 to the same number of its standard
   !> deviations, areas to bound^2/2, beyond which they are less likely than dW_k beyond its bound.
   pure subroutine clip_interval(nlane, nnoise, bound, step)
      integer, intent(in) :: nlane, nnoise
      real(wp), intent(in) :: bound                 !! of dW [sqrt(time)]
      type(path_interval), intent(inout) :: step
      real(wp) :: shape(nlane)
      integer :: k

      do k = 1, nnoise
         if (allocated(step%of(path_dz)%x)) then
            shape = step%of(path_dz)%x(:, k)/step%length - 0.5_wp*step%w(:, k)
            call clip_increments(nlane, bound/sqrt(12.0_wp), shape)
         end if
         call clip_increments(nlane, bound, step%w(:, k))
         if (allocated(step%of(path_dz)%x)) step%of(path_dz)%x(:, k) = step%length*(0.5_wp*step%w(:, k) + shape)
      end do
      if (allocated(step%of(path_areas)%x)) &
         call clip_increments(size(step%of(path_areas)%x), 0.5_wp*bound**2, step%of(path_areas)%x)
   end subroutine clip_interval

end module symsde_noise_functionals
