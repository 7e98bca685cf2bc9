! SPDX-License-Identifier: BSD-3-Clause
!> With D_t,tau = drift(t, tau), the flow of D, and K_w = kick(t, w), the flow of sum_j w_j K_j over one unit of time:
!>
!>    D_{t+s,s'} D_t,s = D_t,s+s'        D_{t+s,-s} D_t,s = 1        K_v K_w = K_{v+w}        K_{-w} K_w = 1
!>    omega(F'u, F'v) = omega(u, v)  of both,   omega(u, v) = u_q.v_p - u_p.v_q
!>    d/ds D_t,s + d/ds K_{s e_0} = J grad H,    d/ds K_{s e_k} = J grad H_k     at s = 0, where there are gradients
!>
!> The probe of exact flows of two parts of H that a user gives. Kicks by weights v and w make one by v + w, for generic
!> weights of all Hamiltonians, only if each is a flow and all of them commute: {K_i, K_j} = 0. Where they do not, the
!> pair (i, j) is looked for and named.
!>
!> Private to its family.
module symsde_model_probe_parts
   use symsde_base_kinds, only: wp, unwritten_bits
   use symsde_base_status, only: error_type, raise, false_trait
   use symsde_base_text, only: to_text
   use symsde_model_kernels, only: kernel_model
   use symsde_model_abstract, only: default_step
   use symsde_model_probe_parts_motion, only: place_type, flow_type, scale_of, moves_by, move, size_of, derive, &
                                              find_area, find_rate, rounding_of_rate
   use symsde_model_probe_points, only: no_verdict, probe_points, nlane, npoint, finding, generic, worst, &
                                        largest_component
   implicit none
   private
   public :: probe_parts

   real(wp), parameter :: exact = 1e-9_wp       !! error of a flow, in sizes of the state: a part of 2e-8 of the motion
   real(wp), parameter :: vanishing = 1e-6_wp   !! the same of derivatives by differences
   real(wp), parameter :: split = 0.7_wp        !! second time of two, in units of the first

contains

   !> Refuse (false_trait) two functions that are not exact flows of D and of a commuting family, nor of the model's
   !> Hamiltonians. Points where a result is not finite are skipped.
   subroutine probe_parts(points, model, error, decided)
      type(probe_points), intent(inout) :: points
      class(kernel_model), intent(in), target :: model
      type(error_type), allocatable, intent(inout) :: error
      logical, intent(out), optional :: decided   !! whether both flows are finite at the initial state
      type(place_type) :: z
      type(flow_type) :: drift, kick, other
      real(wp) :: scale(0:points%nnoise)
      integer :: k

      if (present(decided)) decided = .false.
      if (allocated(error)) return
      z%q = points%q
      z%p = points%p
      drift%model => model
      drift%t = points%t
      drift%tau = 1  ! the time that is scaled
      drift%tau = scale_of(drift, z)
      kick%model => model
      kick%t = points%t
      allocate (kick%w(0:points%nnoise), source=0.0_wp)
      kick%w(0) = 1
      scale(0) = scale_of(kick, z)
      kick%w(0) = 0
      do k = 1, points%nnoise
         kick%w(k) = generic(k + 1, 1)
      end do
      if (points%nnoise > 0) scale(1:) = scale_of(kick, z)
      ! Weights of size 1/2 to 1 in units of their scales, none of which compensates another.
      do k = 0, points%nnoise
         kick%w(k) = scale(k)*generic(k + 1, 2)
      end do
      other = kick
      do k = 0, points%nnoise
         other%w(k) = scale(k)*generic(k + 1, 3)
      end do
      call require_outputs(points, drift, z, 'drift', error)
      call require_outputs(points, kick, z, 'kick', error)
      call probe_lanes(points, kick, z, error)
      call probe_drift(points, drift, z, error)
      call probe_kicks(points, kick, other, scale, z, error)
      call probe_area(points, drift, z, 'drift', error)
      call probe_area(points, kick, z, 'kick', error)
      if (model%traits%has_gradient) call probe_generators(points, drift, scale, z, error)
      if (present(decided)) decided = moves_by(drift, 1.0_wp, z) <= huge(1.0_wp) .and. &
                                      moves_by(kick, 1.0_wp, z) <= huge(1.0_wp)
   end subroutine probe_parts

   !> Refuse a function that leaves an output as it was before the call, or writes into its inputs.
   subroutine require_outputs(points, flow, z, name, error)
      type(probe_points), intent(in) :: points
      type(flow_type), intent(in) :: flow
      type(place_type), intent(in) :: z
      character(*), intent(in) :: name
      type(error_type), allocatable, intent(inout) :: error
      type(place_type) :: x
      integer :: i

      if (allocated(error)) return
      call move(flow, 1.0_wp, z, x)
      if (flow%model%failure_code() /= 0) return  ! the function has failed; its own error is reported
      if (any(z%q < points%q .or. z%q > points%q) .or. any(z%p < points%p .or. z%p > points%p)) &
         call refuse(points, name//' writes into q or p, which are its inputs', finding(1, 1, 1), &
                     'a function that works on copies', error)
      do i = 1, points%ndof
         if (is_unwritten(x%q(1, i))) call refuse_output('q', i)
         if (is_unwritten(x%p(1, i))) call refuse_output('p', i)
      end do

   contains

      subroutine refuse_output(half, i)
         character(*), intent(in) :: half
         integer, intent(in) :: i

         if (.not. allocated(error)) &
            call refuse(points, name//' does not write '//half//'_'//to_text(i)//' of the new state', &
                        finding(1, 1, i), 'a function that writes all outputs, also what it does not change', error)
      end subroutine refuse_output

   end subroutine require_outputs

   !> Whether a number is as it was before a function was called.
   pure logical function is_unwritten(x)
      real(wp), intent(in) :: x

      is_unwritten = transfer(x, unwritten_bits) == unwritten_bits
   end function is_unwritten

   !> A kick must read the weights of each lane: lanes with weights of their own move as all lanes with these weights.
   subroutine probe_lanes(points, kick, z, error)
      type(probe_points), intent(in) :: points
      type(flow_type), intent(in) :: kick
      type(place_type), intent(in) :: z
      type(error_type), allocatable, intent(inout) :: error
      real(wp), parameter :: part(npoint) = [0.8_wp, 0.5_wp, 0.9_wp]
      real(wp) :: w(nlane, 0:points%nnoise)
      type(place_type) :: x, y, same
      integer :: lane

      if (allocated(error)) return
      w = spread(kick%w, 1, nlane)
      x = z
      y = z
      do lane = 1, npoint
         w(lane, :) = part(lane)*kick%w
         call move(kick, part(lane), z, same)
         y%q(lane, :) = same%q(lane, :)
         y%p(lane, :) = same%p(lane, :)
      end do
      call kick%model%kick(nlane, points%ndof, points%nnoise, kick%t, w, z%q, z%p, x%q, x%p)
      call compare(points, x, y, z, 'kick by weights that differ from lane to lane', 'with the same weights in all '// &
                   'lanes', 'a function that takes for each lane its own weights w[j][lane]', error)
   end subroutine probe_lanes

   !> A drift after a drift is a drift, and its inverse.
   subroutine probe_drift(points, drift, z, error)
      type(probe_points), intent(in) :: points
      type(flow_type), intent(in) :: drift
      type(place_type), intent(in) :: z
      type(error_type), allocatable, intent(inout) :: error
      type(place_type) :: x, y, far

      call move(drift, 1.0_wp, z, x)
      call move(drift, split, x, y, drift%tau)
      call move(drift, 1 + split, z, far)
      call compare(points, y, far, z, 'drift over tau = '//to_text(drift%tau)//' and then over '// &
                   to_text(split*drift%tau), 'drift over their sum', 'the exact flow of D; where only steps '// &
                   'towards it are known, many shorter steps of it inside, until this holds to 1e-9 of a state', error)
      call move(drift, -1.0_wp, x, y, drift%tau)
      call compare(points, y, z, z, 'drift over tau = '//to_text(drift%tau)// &
                   ' and back', 'before', 'the exact flow of D for tau of either sign', error)
   end subroutine probe_drift

   !> A kick after a kick is the kick by the sum of their weights, and its inverse.
   subroutine probe_kicks(points, kick, other, scale, z, error)
      type(probe_points), intent(in) :: points
      type(flow_type), intent(in) :: kick, other
      real(wp), intent(in) :: scale(0:points%nnoise)
      type(place_type), intent(in) :: z
      type(error_type), allocatable, intent(inout) :: error
      type(error_type), allocatable :: refuted
      type(place_type) :: x, y

      if (allocated(error)) return
      call probe_sum(points, kick, other, z, 'all H_j', refuted)
      if (allocated(refuted)) then
         call name_pair(points, kick, scale, z, error)
         if (.not. allocated(error)) call move_alloc(refuted, error)
      end if
      call move(kick, 1.0_wp, z, x)
      call move(kick, -1.0_wp, x, y)
      call compare(points, y, z, z, 'kick by w and then by -w', 'before', &
                   'the exact flow of sum_j w_j K_j for weights of either sign', error)
   end subroutine probe_kicks

   subroutine probe_sum(points, kick, other, z, weights, error)
      type(probe_points), intent(in) :: points
      type(flow_type), intent(in) :: kick, other
      type(place_type), intent(in) :: z
      character(*), intent(in) :: weights
      type(error_type), allocatable, intent(inout) :: error
      type(flow_type) :: both
      type(place_type) :: x, y, far

      both = kick
      both%w = kick%w + other%w
      call move(kick, 1.0_wp, z, x)
      call move(other, 1.0_wp, x, y)
      call move(both, 1.0_wp, z, far)
      call compare(points, y, far, z, 'kick by weights w of '//weights//' and then by weights v', 'kick by w + v', &
                   'the exact flow of sum_j w_j K_j', error)
   end subroutine probe_sum

   !> Refuse the first pair of Hamiltonians, or a single one, whose kicks are no flows of a commuting family.
   subroutine name_pair(points, kick, scale, z, error)
      type(probe_points), intent(in) :: points
      type(flow_type), intent(in) :: kick
      real(wp), intent(in) :: scale(0:points%nnoise)
      type(place_type), intent(in) :: z
      type(error_type), allocatable, intent(inout) :: error
      integer, parameter :: most = 17   !! Hamiltonians tried in pairs
      type(flow_type) :: a, b
      type(place_type) :: x, y, far
      integer :: i, j

      a = kick
      b = kick
      do j = 0, min(points%nnoise, most)
         do i = 0, j
            a%w = 0
            b%w = 0
            a%w(i) = scale(i)
            b%w(j) = split*scale(j)
            if (i == j) then
               call probe_sum(points, a, b, z, 'K_'//to_text(j)//' alone', error)
            else
               call move(a, 1.0_wp, z, x)
               call move(b, 1.0_wp, x, y)
               call move(b, 1.0_wp, z, x)
               call move(a, 1.0_wp, x, far)
               call compare(points, y, far, z, 'kick by K_'//to_text(i)//' and then by K_'//to_text(j), &
                            'in the other order', 'kicks K_j that commute, {K_i, K_j} = 0, and put what does '// &
                            'not into D', error)
               call probe_sum(points, a, b, z, 'K_'//to_text(i)//', v of K_'//to_text(j)//',', error)
            end if
            if (allocated(error)) return
         end do
      end do
   end subroutine name_pair

   !> Refuse (false_trait) two states that should be equal, by the component that differs most.
   subroutine compare(points, x, y, z, how, other, remedy, error)
      type(probe_points), intent(in) :: points
      type(place_type), intent(in) :: x, y, z
      character(*), intent(in) :: how, other, remedy
      type(error_type), allocatable, intent(inout) :: error
      type(finding) :: bad
      real(wp), allocatable :: dq(:, :), dp(:, :)   !! (nlane, ndof)
      real(wp) :: given, right, by(nlane), scale(nlane)

      if (allocated(error)) return
      dq = x%q - y%q
      dp = x%p - y%p
      call largest_component(points%ndof, dq, dp, by)
      scale = size_of(z)
      where (.not. by <= huge(1.0_wp)) scale = no_verdict   ! a state that is not finite
      call worst(dq, dp, scale, exact, bad)
      if (bad%lane == 0) return
      associate (l => bad%lane, i => bad%i)
         given = merge(x%q(l, i), x%p(l, i), bad%half == 1)
         right = merge(y%q(l, i), y%p(l, i), bad%half == 1)
         call refuse(points, how//' gives '//merge('q_', 'p_', bad%half == 1)//to_text(i)//' = '//to_text(given)// &
                     ', and not '//to_text(right)//' as '//other//', a difference of '//to_text(given - right), bad, &
                     remedy, error)
      end associate
   end subroutine compare

   !> The flow must keep the area omega of two directions, in two planes, by differences with two steps (probe/points).
   subroutine probe_area(points, flow, z, name, error)
      type(probe_points), intent(in) :: points
      type(flow_type), intent(in) :: flow
      type(place_type), intent(in) :: z
      character(*), intent(in) :: name
      type(error_type), allocatable, intent(inout) :: error
      real(wp), parameter :: agreement = 1e-5_wp
      real(wp), dimension(nlane) :: before, after, again, scale, ignored
      type(place_type) :: u, v, a, b
      integer :: plane, i, lane

      if (allocated(error)) return
      u = z
      v = z
      do plane = 1, 2
         do i = 1, points%ndof
            u%q(:, i) = generic(i, plane)
            u%p(:, i) = generic(i, plane + 2)
            v%q(:, i) = generic(i, plane + 4)
            v%p(:, i) = generic(i, plane + 6)
         end do
         call find_area(u, v, before, scale)
         call derive(flow, default_step, z, u, a)
         call derive(flow, default_step, z, v, b)
         call find_area(a, b, after, scale)
         call derive(flow, default_step/4, z, u, a)
         call derive(flow, default_step/4, z, v, b)
         call find_area(a, b, again, ignored)
         do lane = 1, npoint
            ! Where states are far from one, what two steps differ by is most of the error of the longer one.
            if (.not. abs(after(lane) - again(lane)) <= agreement*scale(lane)) cycle
            if (abs(after(lane) - before(lane)) <= vanishing*scale(lane) + 2*abs(after(lane) - again(lane))) cycle
            call refuse(points, name//' changes the area u_q.v_p - u_p.v_q of two displacements u, v from '// &
                        to_text(before(lane))//' to '//to_text(after(lane)), finding(lane, 1, 1), 'a symplectic '// &
                        'map, which flows of Hamiltonians are', error)
            return
         end do
      end do
   end subroutine probe_area

   !> The rates at which both flows begin must be the fields of the model's Hamiltonians.
   subroutine probe_generators(points, drift, scale, z, error)
      type(probe_points), intent(inout) :: points
      type(flow_type), intent(in) :: drift
      real(wp), intent(in) :: scale(0:points%nnoise)
      type(place_type), intent(in) :: z
      type(error_type), allocatable, intent(inout) :: error
      type(flow_type) :: kick
      type(place_type) :: x, y
      real(wp), allocatable :: hq(:, :), hp(:, :)
      real(wp) :: slope(nlane), blur(nlane)
      type(finding) :: bad
      integer :: k

      if (allocated(error)) return
      kick = drift
      allocate (kick%w(0:points%nnoise))
      do k = 0, points%last_sum()
         call points%take_sum(k)
         kick%w = points%w(1, :)*scale
         call find_rate(kick, z, x)
         x%q = x%q/scale(min(k, points%nnoise))
         x%p = x%p/scale(min(k, points%nnoise))
         if (k == 0) then
            call find_rate(drift, z, y)
            x%q = x%q + y%q/drift%tau
            x%p = x%p + y%p/drift%tau
         end if
         ! In a lane that moves far less than others, as one at small positions, the difference has no digits.
         blur = size_of(z)
         blur = blur*(rounding_of_rate/vanishing)
         call points%gradient(hq, hp, slope)
         slope = slope + blur/abs(scale(min(k, points%nnoise)))
         if (k == 0) slope = slope + blur/abs(drift%tau)
         y%q = x%q - hp
         y%p = x%p + hq
         call worst(y%q, y%p, slope, vanishing, bad)
         if (bad%lane == 0) cycle
         associate (l => bad%lane, i => bad%i)
            call refuse(points, 'd'//merge('q_', 'p_', bad%half == 1)//to_text(i)//'/ds at the beginning of '// &
                        trim(merge('drift and kick by H_0', 'kick by noises       ', k == 0))//' = '// &
                        to_text(merge(x%q(l, i), x%p(l, i), bad%half == 1))//', and not '// &
                        to_text(merge(hp(l, i), -hq(l, i), bad%half == 1))//' by the gradient of '//points%sum_name, &
                        bad, 'flows of these Hamiltonians, or their gradient', error)
         end associate
         return
      end do
   end subroutine probe_generators

   !> Refuse two functions that do not have a property.
   subroutine refuse(points, violation, bad, remedy, error)
      type(probe_points), intent(in) :: points
      character(*), intent(in) :: violation, remedy
      type(finding), intent(in) :: bad
      type(error_type), allocatable, intent(inout) :: error

      call raise(error, false_trait, 'probe_model', 'model '''//points%model%name//''' gives flows of two parts '// &
                 'of H, but '//violation//', at '//points%place(bad%lane, bad%i, bad%i)//'; give '//remedy)
   end subroutine refuse

end module symsde_model_probe_parts
