! SPDX-License-Identifier: BSD-3-Clause
!>    x = F_s(z),    F'u ~ (F(z + e u) - F(z - e u))/(2 e),    d/ds F_s(z) ~ (8 (F_e - F_-e) - (F_2e - F_-2e))/(12 e)
!>
!> Motions by one of two flows that a user gives, over s units of time or of weights, and their derivatives.
!>
!> How long is a step, in the units of a model, nobody says. So the time of a drift, the weight of K_0 and that of the
!> noises are each made such that a state moves by about a twentieth of its size, and half of it by half.
!>
!> Private to its family.
module symsde_model_probe_parts_motion
   use symsde_base_kinds, only: wp
   use symsde_model_kernels, only: kernel_model
   use symsde_model_probe_points, only: nlane, npoint, largest_component
   implicit none
   private
   public :: place_type, flow_type, scale_of, moves_by, move, size_of, derive, find_area, find_rate, &
             rounding_of_rate

   real(wp), parameter :: wanted = 0.05_wp      !! motion, in sizes of the state
   real(wp), parameter :: short = 2.0_wp**(-10) !! part of the time or weights over which a rate is found
   real(wp), parameter :: rounding_of_rate = 16*epsilon(1.0_wp)/short   !! of a state of size one

   type :: place_type
      real(wp), allocatable :: q(:, :), p(:, :)   !! (nlane, ndof)
   end type place_type

   !> What is probed: the drift, over tau, or the kick by weights.
   type :: flow_type
      class(kernel_model), pointer :: model => null()
      real(wp) :: t = 0, tau = 0
      real(wp), allocatable :: w(:)   !! (0:nnoise); not allocated = drift
   end type flow_type

contains

   !> The time, or factor of the weights, by which the flow moves a state by about `wanted`, and half of which moves it
   !> by half as much; 1 if nothing moves.
   real(wp) function scale_of(flow, z) result(s)
      type(flow_type), intent(in) :: flow
      type(place_type), intent(in) :: z
      integer, parameter :: most = 60
      real(wp), parameter :: endless = 1e18_wp
      real(wp) :: far, near
      integer :: i

      s = 1
      do i = 1, most
         far = moves_by(flow, s, z)
         if (.not. far <= huge(far)) then
            s = s/64
         else if (far > 2*wanted) then
            s = s*max(1e-3_wp, wanted/far)
         else if (far < 0.5_wp*wanted) then
            s = s*min(1e3_wp, wanted/max(far, tiny(far)))
            if (s > endless) exit
         else
            near = moves_by(flow, 0.5_wp*s, z)
            if (abs(2*near - far) <= 0.5_wp*far) return
            s = s/64
         end if
      end do
      s = 1
   end function scale_of

   !> Largest motion of a finite lane by a flow, in sizes of its state; not finite if no lane is.
   real(wp) function moves_by(flow, s, z) result(motion)
      type(flow_type), intent(in) :: flow
      real(wp), intent(in) :: s
      type(place_type), intent(in) :: z
      type(place_type) :: x
      real(wp), dimension(nlane) :: by, from
      logical :: some
      integer :: lane

      call move(flow, s, z, x)
      x%q = x%q - z%q
      x%p = x%p - z%p
      call largest_component(size(z%q, 2), x%q, x%p, by)
      from = size_of(z)
      motion = 0
      some = .false.
      do lane = 1, npoint
         if (.not. by(lane) <= huge(1.0_wp)) cycle
         some = .true.
         motion = max(motion, by(lane)/from(lane))
      end do
      if (.not. some) motion = by(1)
   end function moves_by

   !> The size of the state of each lane, at least one.
   function size_of(z) result(from)
      type(place_type), intent(in) :: z
      real(wp) :: from(nlane)

      call largest_component(size(z%q, 2), z%q, z%p, from)
      from = max(1.0_wp, from)
   end function size_of

   !> The state after the flow over s units of its time or weights.
   subroutine move(flow, s, z, x, later)
      type(flow_type), intent(in) :: flow
      real(wp), intent(in) :: s
      type(place_type), intent(in) :: z
      type(place_type), intent(out) :: x
      real(wp), intent(in), optional :: later   !! how much later than the probe's time it begins
      real(wp), allocatable :: w(:, :)
      real(wp) :: t
      integer :: k

      t = flow%t
      if (present(later)) t = t + later
      associate (n => size(z%q, 2))
         allocate (x%q(nlane, n), x%p(nlane, n))
         if (.not. allocated(flow%w)) then
            call flow%model%drift(nlane, n, t, s*flow%tau, z%q, z%p, x%q, x%p)
         else
            allocate (w(nlane, 0:size(flow%w) - 1))
            do k = 0, size(flow%w) - 1
               w(:, k) = s*flow%w(k)
            end do
            call flow%model%kick(nlane, n, size(flow%w) - 1, t, w, z%q, z%p, x%q, x%p)
         end if
      end associate
   end subroutine move

   !> The area of two displacements, lane by lane, and the sum of the sizes of its terms.
   pure subroutine find_area(u, v, area, scale)
      type(place_type), intent(in) :: u, v
      real(wp), intent(out), dimension(nlane) :: area, scale
      integer :: i

      area = 0
      scale = 0
      do i = 1, size(u%q, 2)
         area = area + (u%q(:, i)*v%p(:, i) - u%p(:, i)*v%q(:, i))
         scale = scale + (abs(u%q(:, i)*v%p(:, i)) + abs(u%p(:, i)*v%q(:, i)))
      end do
   end subroutine find_area

   !> The derivative of the flow along a direction, by a central difference.
   subroutine derive(flow, step, z, u, x)
      type(flow_type), intent(in) :: flow
      real(wp), intent(in) :: step
      type(place_type), intent(in) :: z, u
      type(place_type), intent(out) :: x
      type(place_type) :: from, ahead, behind
      real(wp) :: e(nlane)
      integer :: i

      e = size_of(z)
      e = step*e
      from = z
      do i = 1, size(z%q, 2)
         from%q(:, i) = z%q(:, i) + e*u%q(:, i)
         from%p(:, i) = z%p(:, i) + e*u%p(:, i)
      end do
      call move(flow, 1.0_wp, from, ahead)
      do i = 1, size(z%q, 2)
         from%q(:, i) = z%q(:, i) - e*u%q(:, i)
         from%p(:, i) = z%p(:, i) - e*u%p(:, i)
      end do
      call move(flow, 1.0_wp, from, behind)
      x = z
      do i = 1, size(z%q, 2)
         x%q(:, i) = (ahead%q(:, i) - behind%q(:, i))/(2*e)
         x%p(:, i) = (ahead%p(:, i) - behind%p(:, i))/(2*e)
      end do
   end subroutine derive

   !> The rate at which a flow begins, per unit of its time or weights, by a difference of fourth order.
   subroutine find_rate(flow, z, x)
      type(flow_type), intent(in) :: flow
      type(place_type), intent(in) :: z
      type(place_type), intent(out) :: x
      real(wp), parameter :: e = short
      type(place_type) :: a, b, c, d

      call move(flow, 2*e, z, a)
      call move(flow, e, z, b)
      call move(flow, -e, z, c)
      call move(flow, -2*e, z, d)
      x%q = (8*(b%q - c%q) - (a%q - d%q))/(12*e)
      x%p = (8*(b%p - c%p) - (a%p - d%p))/(12*e)
   end subroutine find_rate

end module symsde_model_probe_parts_motion
