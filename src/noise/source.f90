! SPDX-License-Identifier: BSD-3-Clause
!> The abstract noise source: it answers which increments drive these paths in this step.
!>
!> The answer is written into the weights of the one-step Hamiltonian: w(:,0) is the step size and
!> belongs to the caller, w(:,k) = dW_k is filled here. Steps come in pairs 2j, 2j+1, because two words of
!> the generator make the normals of both; a source fills the weights of the two steps at once, and of several
!> pairs at once where it can do better that way.
!>
!> Schemes beyond strong order one ask for more than increments (needs_dz, needs_areas); they call
!> fill_integrals, which gives the same path's dZ and areas beside its increments.
module symsde_noise_source
   use symsde_base_kinds, only: wp, i8
   use symsde_base_laws, only: area_count
   implicit none
   private
   public :: noise_type, clip_lanes, clip_integrals, fill_one_by_one

   type, abstract :: noise_type
      integer :: nnoise = 0                  !! m, number of noises
      logical, allocatable :: silent(:)      !! noises for which nothing is drawn: dW_k = 0 (nnoise)
      real(wp) :: bound = huge(1.0_wp)       !! truncation: |dW_k| <= bound [sqrt(time)]
      logical :: needs_dz = .false.          !! dZ_k is asked for
      logical :: needs_areas = .false.       !! A_kl is asked for
      integer :: nz = 0                      !! columns of dZ: nnoise, or 0
      integer :: narea = 0                   !! columns of areas: nnoise(nnoise-1)/2, or 0
   contains
      procedure(fill_interface), deferred :: fill
      procedure(integrals_interface), deferred :: fill_integrals
      procedure :: fill_ahead => fill_one_by_one
      procedure :: ask
   end type noise_type

   abstract interface
      !> Increments of the steps 2*pair and 2*pair+1 of the given paths.
      subroutine fill_interface(self, nlane, path, pair, w, drawn)
         import :: noise_type, wp, i8
         class(noise_type), intent(in) :: self
         integer, intent(in) :: nlane
         integer(i8), intent(in) :: path(nlane)  !! global path of each lane
         integer(i8), intent(in) :: pair         !! pair of steps, counted from step 0
         real(wp), intent(inout) :: w(nlane, 0:self%nnoise, 0:1) !! w(:,k,0), w(:,k,1) = dW_k of the two steps
         integer(i8), intent(inout) :: drawn     !! normals drawn for one path, added to
      end subroutine fill_interface

      !> Increments, dZ and areas of the steps 2*pair and 2*pair+1; what is not asked for has extent 0.
      !>
      !>    dZ_k = int (W_k(s) - W_k(t)) ds,   A_kl = 1/2 int (W_k o dW_l - W_l o dW_k)  at area_index(k,l)
      subroutine integrals_interface(self, nlane, path, pair, w, z, area, drawn)
         import :: noise_type, wp, i8
         class(noise_type), intent(in) :: self
         integer, intent(in) :: nlane
         integer(i8), intent(in) :: path(nlane), pair
         real(wp), intent(inout) :: w(nlane, 0:self%nnoise, 0:1)
         real(wp), intent(inout) :: z(nlane, self%nz, 0:1)        !! dZ_k [time^(3/2)]
         real(wp), intent(inout) :: area(nlane, self%narea, 0:1)  !! A_kl, k < l [time]
         integer(i8), intent(inout) :: drawn
      end subroutine integrals_interface
   end interface

contains

   !> Increments of npair pairs of steps at once; lanes past nreal repeat lane nreal.
   !> Default: one pair after the other.
   subroutine fill_one_by_one(self, nlane, nreal, path, pair, npair, w, drawn)
      class(noise_type), intent(in) :: self
      integer, intent(in) :: nlane, nreal
      integer(i8), intent(in) :: path(nlane), pair  !! the first pair
      integer, intent(in) :: npair
      real(wp), intent(inout) :: w(nlane, 0:self%nnoise, 0:2*npair - 1)
      integer(i8), intent(inout) :: drawn           !! for one path, in all pairs
      integer :: j

      do j = 0, npair - 1
         call self%fill(nlane, path, pair + j, w(:, :, 2*j:2*j + 1), drawn)
      end do
   end subroutine fill_one_by_one

   !> Clip increments to [-bound, bound]; applied to the summed increment of the level in use.
   pure subroutine clip_lanes(n, bound, dw)
      integer, intent(in) :: n
      real(wp), intent(in) :: bound
      real(wp), intent(inout) :: dw(n)
      integer :: i

      do i = 1, n
         dw(i) = min(max(dw(i), -bound), bound)
      end do
   end subroutine clip_lanes

   !> Truncate a step whose dW_k is not yet clipped: dW_k to the bound, H_k = dZ_k/h - dW_k/2 to the same
   !> number of its standard deviations, areas to bound^2/2, beyond which they are less likely than dW_k
   !> beyond its bound.
   pure subroutine clip_integrals(nlane, nnoise, nz, narea, bound, h, w, z, area)
      integer, intent(in) :: nlane, nnoise, nz, narea
      real(wp), intent(in) :: bound, h                  !! bound of dW [sqrt(time)], step with its sign [time]
      real(wp), intent(inout) :: w(nlane, nnoise), z(nlane, nz), area(nlane, narea)
      real(wp) :: shape(nlane)
      integer :: k

      do k = 1, nnoise
         if (nz > 0) then
            shape = z(:, k)/h - 0.5_wp*w(:, k)
            call clip_lanes(nlane, bound/sqrt(12.0_wp), shape)
         end if
         call clip_lanes(nlane, bound, w(:, k))
         if (nz > 0) z(:, k) = h*(0.5_wp*w(:, k) + shape)
      end do
      do k = 1, narea
         call clip_lanes(nlane, 0.5_wp*bound**2, area(:, k))
      end do
   end subroutine clip_integrals

   !> Ask for dZ and areas beside the increments.
   subroutine ask(self, needs_dz, needs_areas)
      class(noise_type), intent(inout) :: self
      logical, intent(in) :: needs_dz, needs_areas

      self%needs_dz = needs_dz
      self%needs_areas = needs_areas
      self%nz = merge(self%nnoise, 0, needs_dz)
      self%narea = merge(area_count(self%nnoise), 0, needs_areas)
   end subroutine ask

end module symsde_noise_source
