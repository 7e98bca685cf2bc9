! SPDX-License-Identifier: BSD-3-Clause
!> Exact steps of linear equations with constant noise, damped or closed, along the path of a run:
!>
!>    dz = (A z + b_0) dt + sum_k b_k dW_k,      z_{n+1} = exp(hA) z_n + int exp(uA) b_0 du + xi
!>
!> xi = sum_k int exp(uA) b_k dW_k is normal. Given dW_k, H_k = dZ_k/h - dW_k/2 and K_k its mean is a linear form of
!> these, and the rest has a covariance of its own (noise/linear_law), which is drawn by as many normals as z has
!> components: by other ones for noises that all paths share. So the solution has the exact law jointly with dW, dZ and
!> K, whichever of these a scheme uses.
module symsde_diagnose_linear_steps
   use symsde_base_kinds, only: wp, i8
   use symsde_base_matrices, only: exponential_less_one
   use symsde_base_vectors, only: add_times
   use symsde_noise_linear_law, only: integrate_noise, remainder_of_noise, factorise
   use symsde_noise_oscillator_law, only: oscillator_draws
   implicit none
   private
   public :: linear_steps, new_linear_steps

   type :: linear_steps
      private
      integer :: n = 0                              !! components of z = (q, p)
      real(wp), allocatable :: change(:, :)         !! exp(hA) - 1, and the effect of b_0 as last column (n, n + 1)
      real(wp), allocatable :: known(:, :, :)       !! coefficients of dW_k, H_k and K_k (n, nnoise, 3)
      real(wp), allocatable :: own(:, :)            !! factor of the rest of each path's own noises (n, n)
      real(wp), allocatable :: common(:, :)         !! and of noises that all paths share
   contains
      procedure :: take
   end type linear_steps

contains

   !> Steps of length h for the fields (A_j, b_j; 0, 0), of which A_k = 0 for k >= 1.
   subroutine new_linear_steps(self, n, m, field, h, common)
      type(linear_steps), intent(out) :: self
      integer, intent(in) :: n, m                   !! components of z, and noises
      real(wp), intent(in) :: field(n + 1, n + 1, 0:m), h
      logical, intent(in) :: common(m)              !! noises that all paths share
      real(wp) :: a(n, n), b(n, m), flow(n, n), c(n, n), scaling(n), change(n + 1, n + 1), velocity
      integer :: i, k

      self%n = n
      call exponential_less_one(n + 1, field(:, :, 0), h, change)
      self%change = change(:n, :)
      ! (q/(h v), p) with v about the velocity of p = 1, so that the matrix of a step is small where the step is short
      scaling = 1
      do i = 1, n/2
         velocity = maxval(abs(field(i, n/2 + 1:n, 0)))
         if (velocity > 0) scaling(i) = scale(1.0_wp, exponent(velocity) - 1)
         scaling(i) = h*scaling(i)
      end do
      do i = 1, n
         a(:, i) = h*field(:n, i, 0)*scaling(i)/scaling
      end do
      do k = 1, m
         b(:, k) = field(:n, n + 1, k)/scaling
      end do
      allocate (self%known(n, m, 3))
      call integrate_noise(n, m, a, b, flow, c, self%known)
      do i = 1, n
         self%known(i, :, :) = scaling(i)*self%known(i, :, :)
      end do
      call find_factor(n, m, a, b, .not. common, scaling*sqrt(abs(h)), self%own)
      call find_factor(n, m, a, b, common, scaling*sqrt(abs(h)), self%common)
   end subroutine new_linear_steps

   !> A factor of the covariance of the rest of some noises; not allocated if there are none.
   subroutine find_factor(n, m, a, b, chosen, scaling, factor)
      integer, intent(in) :: n, m
      real(wp), intent(in) :: a(n, n), b(n, m), scaling(n)
      logical, intent(in) :: chosen(m)
      real(wp), allocatable, intent(out) :: factor(:, :)
      real(wp) :: of(n, m), means(n, m, 3), flow(n, n), c(n, n), rest(n, n)
      integer :: pivot(n), rank, i, k

      if (.not. any(chosen)) return
      of = 0
      do k = 1, m
         if (chosen(k)) of(:, k) = b(:, k)
      end do
      call integrate_noise(n, m, a, of, flow, c, means)
      call remainder_of_noise(n, m, a, of, c, means, rest)
      allocate (factor(n, n))
      call factorise(n, rest, factor, pivot, rank)
      do i = 1, n
         factor(i, :) = scaling(i)*factor(i, :)
      end do
   end subroutine find_factor

   !> One step of every lane.
   subroutine take(self, nlane, ndof, nnoise, seed, path, step, w, shape, stt_area, q, p)
      class(linear_steps), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      integer(i8), intent(in) :: seed, path(nlane), step      !! global paths, absolute step
      real(wp), intent(in), dimension(nlane, nnoise) :: w, shape, stt_area   !! dW_k, H_k and K_k
      real(wp), intent(inout), dimension(nlane, ndof) :: q, p
      real(wp) :: z(nlane, self%n), dz(nlane, self%n)
      integer(i8) :: zero(nlane)
      integer :: i, j, k

      z(:, :ndof) = q
      z(:, ndof + 1:) = p
      zero = 0
      do i = 1, self%n
         dz(:, i) = self%change(i, self%n + 1)
         do j = 1, self%n
            call add_times(nlane, self%change(i, j), z(:, j), dz(:, i))
         end do
         do k = 1, nnoise
            call add_times(nlane, self%known(i, k, 1), w(:, k), dz(:, i))
            call add_times(nlane, self%known(i, k, 2), shape(:, k), dz(:, i))
            call add_times(nlane, self%known(i, k, 3), stt_area(:, k), dz(:, i))
         end do
      end do
      if (allocated(self%own)) call add_rest(self%own, path, 0)
      if (allocated(self%common)) call add_rest(self%common, zero, ndof)
      q = q + dz(:, :ndof)
      p = p + dz(:, ndof + 1:)

   contains

      !> Add the rest, by two normals of every degree of freedom.
      subroutine add_rest(factor, from, before)
         real(wp), intent(in) :: factor(self%n, self%n)
         integer(i8), intent(in) :: from(nlane)
         integer, intent(in) :: before   !! numbers of draws that come before
         real(wp) :: xi(nlane, 2)
         integer :: d, r

         do d = 1, ndof
            call oscillator_draws(nlane, seed, from, step, before + d, xi(:, 1), xi(:, 2))
            do r = 1, self%n
               call add_times(nlane, factor(r, 2*d - 1), xi(:, 1), dz(:, r))
               call add_times(nlane, factor(r, 2*d), xi(:, 2), dz(:, r))
            end do
         end do
      end subroutine add_rest

   end subroutine take

end module symsde_diagnose_linear_steps
