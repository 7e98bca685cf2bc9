! SPDX-License-Identifier: BSD-3-Clause
!> Exact flows of two parts of H that a user gives, and the steps that are made of them. With H = D + K_0, K_k = H_k and
!> {K_i, K_j} = 0 for all i, j = 0 .. m, D and the K_j any functions of (q, p),
!>
!>    drift(t, tau)   the flow of D from t to t + tau           kick(t, w)   the flow of sum_j w_j K_j, taken at t
!>
!>    two_kicks_map           drift((1 - g) h/2) kick(h/2, w_2k) drift(g h) kick(h/2, w_1k) drift((1 - g) h/2)
!>                            w_ik = W_k/2 +- sqrt(3) a_k,  + for i = 1,   a_k = dZ_k/h - W_k/2,   g = 1/sqrt(3)
!>    drift_kick_drift_map    drift(h/2) kick(h, W_k) drift(h/2)
!>
!> the right factor first. The proof of strong order 3/2 of the first one, and of weak order 2 of the second one, asks
!> for nothing but the brackets above (docs/method/explicit.md): kicks need not be functions of q, nor D quadratic.
!> Other schemes of kicks add brackets {K_i, {K_j, D}}, which two flows do not tell.
!>
!> Private to its family.
module symsde_model_user_parts
   use, intrinsic :: iso_c_binding, only: c_associated, c_double, c_f_procpointer, c_funptr, c_int, c_ptr
   use symsde_base_functionals, only: path_dz
   use symsde_base_kinds, only: wp, i4
   use symsde_base_maps, only: step_map, two_kicks_map, drift_kick_drift_map
   use symsde_base_record, only: steps_record
   use symsde_base_status, only: error_type, raise, incompatible, out_of_memory
   use symsde_base_traits, only: model_traits
   use symsde_model_user_outputs, only: little, find_room, spoil
   implicit none
   private
   public :: user_parts, refuse_declarations

   abstract interface
      !> The flow of D over the time tau, of either sign, from the time t on.
      function drift_callback(nlane, ndof, t, tau, q, p, qn, pn, user) bind(c) result(code)
         import :: c_int, c_double, c_ptr
         integer(c_int), value :: nlane, ndof
         real(c_double), value :: t, tau
         real(c_double), intent(in) :: q(nlane, ndof), p(nlane, ndof)
         real(c_double), intent(out) :: qn(nlane, ndof), pn(nlane, ndof)
         type(c_ptr), value :: user
         integer(c_int) :: code  !! 0 = ok
      end function drift_callback

      !> The flow of sum_j w_j K_j over one unit of time, the K_j being those at the time t.
      function kick_callback(nlane, ndof, nham, t, w, q, p, qn, pn, user) bind(c) result(code)
         import :: c_int, c_double, c_ptr
         integer(c_int), value :: nlane, ndof, nham
         real(c_double), value :: t
         real(c_double), intent(in) :: w(nlane, nham)
         real(c_double), intent(in) :: q(nlane, ndof), p(nlane, ndof)
         real(c_double), intent(out) :: qn(nlane, ndof), pn(nlane, ndof)
         type(c_ptr), value :: user
         integer(c_int) :: code  !! 0 = ok
      end function kick_callback
   end interface

   !> The two functions of a model: both, or none.
   type :: user_parts
      private
      procedure(drift_callback), pointer, nopass :: on_drift => null()
      procedure(kick_callback), pointer, nopass :: on_kick => null()
   contains
      procedure :: set
      procedure :: make
      procedure :: drift
      procedure :: kick
      procedure :: take
   end type user_parts

contains

   !> Refuse declarations about Hamiltonians that only gradients could test, of a model without them (incompatible).
   subroutine refuse_declarations(place, name, traits, error)
      character(*), intent(in) :: place, name
      type(model_traits), intent(in) :: traits
      type(error_type), allocatable, intent(inout) :: error
      character(:), allocatable :: declared

      declared = ''
      if (traits%separable) declared = 'separable'
      if (traits%additive) declared = 'additive'
      if (traits%position_noise) declared = 'position_noise'
      if (traits%quadratic) declared = 'quadratic'
      if (traits%diagonal_mass) declared = 'diagonal_mass'
      if (traits%constant_mass) declared = 'constant_mass'
      if (traits%identity_mass) declared = 'identity_mass'
      if (traits%bandwidth >= 0) declared = 'bandwidth'
      if (allocated(traits%rotation)) declared = 'rotation'
      if (allocated(traits%silent)) declared = 'silent'
      if (traits%touches%are_given()) declared = 'touches'
      if (len(declared) > 0) &
         call raise(error, incompatible, place, "model '"//name//"' has flows of two parts of H and no gradient, "// &
                    'and declares '//declared//', which nothing could test and no step would use: leave it out, '// &
                    'or give a gradient, too')
   end subroutine refuse_declarations

   !> Set both functions; c_null_funptr for both removes them.
   subroutine set(self, drift, kick)
      class(user_parts), intent(inout) :: self
      type(c_funptr), intent(in) :: drift, kick

      nullify (self%on_drift, self%on_kick)
      if (.not. c_associated(drift)) return
      call c_f_procpointer(drift, self%on_drift)
      call c_f_procpointer(kick, self%on_kick)
   end subroutine set

   !> Whether steps by this map are made of the two flows.
   pure logical function make(self, map)
      class(user_parts), intent(in) :: self
      type(step_map), intent(in) :: map

      make = associated(self%on_drift) .and. any(map%equation == [two_kicks_map, drift_kick_drift_map]) .and. &
             .not. (map%damped .or. map%corrected .or. map%products)
   end function make

   !> From (q, p) to (qn, pn) by the flow of D. `sure`: the function is known to write all outputs.
   subroutine drift(self, sure, nlane, ndof, t, tau, q, p, user, qn, pn, code)
      class(user_parts), intent(in) :: self
      logical, intent(in) :: sure
      integer, intent(in) :: nlane, ndof
      real(wp), intent(in) :: t, tau, q(nlane, ndof), p(nlane, ndof)
      type(c_ptr), intent(in) :: user
      real(wp), intent(out) :: qn(nlane, ndof), pn(nlane, ndof)
      integer(i4), intent(inout) :: code   !! the first code that is not 0 is kept

      if (code == 0) then
         if (.not. sure) call spoil(nlane*ndof, qn, pn)
         code = self%on_drift(nlane, ndof, t, tau, q, p, qn, pn, user)
      end if
      if (code /= 0) call spoil(nlane*ndof, qn, pn)
   end subroutine drift

   !> From (q, p) to (qn, pn) by the flow of sum_j w_j K_j.
   subroutine kick(self, sure, nlane, ndof, nnoise, t, w, q, p, user, qn, pn, code)
      class(user_parts), intent(in) :: self
      logical, intent(in) :: sure
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      type(c_ptr), intent(in) :: user
      real(wp), intent(out) :: qn(nlane, ndof), pn(nlane, ndof)
      integer(i4), intent(inout) :: code   !! the first code that is not 0 is kept

      if (code == 0) then
         if (.not. sure) call spoil(nlane*ndof, qn, pn)
         code = self%on_kick(nlane, ndof, nnoise + 1, t, w, q, p, qn, pn, user)
      end if
      if (code /= 0) call spoil(nlane*ndof, qn, pn)
   end subroutine kick

   !> Take the steps of a map in all lanes. No flow is merged with that of the next step, so that the bits are those of
   !> single steps.
   subroutine take(self, sure, map, steps, ndof, user, q, p, qn, pn, code)
      class(user_parts), intent(in) :: self
      logical, intent(in) :: sure
      type(step_map), intent(in) :: map
      type(steps_record), intent(in) :: steps
      integer, intent(in) :: ndof
      type(c_ptr), intent(in) :: user
      real(wp), intent(in) :: q(steps%nlane, ndof), p(steps%nlane, ndof)
      real(wp), intent(out) :: qn(steps%nlane, ndof, steps%nstep/steps%every)
      real(wp), intent(out) :: pn(steps%nlane, ndof, steps%nstep/steps%every)
      integer(i4), intent(out) :: code
      real(wp), target :: few(little)
      real(wp), allocatable, target :: more(:)
      real(wp), pointer, contiguous :: room(:)
      integer :: n, m

      n = steps%nlane*ndof
      m = steps%nlane*(steps%nnoise + 1)
      call find_room(4*n + 2*m, few, more, room)
      code = out_of_memory
      if (.not. associated(room)) return
      code = 0
      call walk(self, sure, map, steps, ndof, user, q, p, room(1:n), room(n + 1:2*n), room(2*n + 1:3*n), &
                room(3*n + 1:4*n), room(4*n + 1:4*n + m), room(4*n + m + 1:4*n + 2*m), qn, pn, code)
   end subroutine take

   !> The same in given memory: states (x, y) and (u, v) take turns, from step to step, too.
   subroutine walk(self, sure, map, steps, ndof, user, q, p, x, y, u, v, w1, w2, qn, pn, code)
      class(user_parts), intent(in) :: self
      logical, intent(in) :: sure
      type(step_map), intent(in) :: map
      type(steps_record), intent(in) :: steps
      integer, intent(in) :: ndof
      type(c_ptr), intent(in) :: user
      real(wp), intent(in) :: q(steps%nlane, ndof), p(steps%nlane, ndof)
      real(wp), intent(out), dimension(steps%nlane, ndof) :: x, y, u, v
      real(wp), intent(out), dimension(steps%nlane, 0:steps%nnoise) :: w1, w2
      real(wp), intent(out) :: qn(steps%nlane, ndof, steps%nstep/steps%every)
      real(wp), intent(out) :: pn(steps%nlane, ndof, steps%nstep/steps%every)
      integer(i4), intent(inout) :: code
      integer :: s

      x = q
      y = p
      do s = 1, steps%nstep
         if (mod(s, 2) == 1) then
            call step(self, sure, map, steps, s, ndof, user, w1, w2, x, y, u, v, code)
            if (mod(s, steps%every) == 0) then
               qn(:, :, s/steps%every) = u
               pn(:, :, s/steps%every) = v
            end if
         else
            call step(self, sure, map, steps, s, ndof, user, w1, w2, u, v, x, y, code)
            if (mod(s, steps%every) == 0) then
               qn(:, :, s/steps%every) = x
               pn(:, :, s/steps%every) = y
            end if
         end if
      end do
   end subroutine walk

   !> Step s of the map, from (x, y) to (u, v).
   subroutine step(self, sure, map, steps, s, ndof, user, w1, w2, x, y, u, v, code)
      class(user_parts), intent(in) :: self
      logical, intent(in) :: sure
      type(step_map), intent(in) :: map
      type(steps_record), intent(in) :: steps
      integer, intent(in) :: s, ndof
      type(c_ptr), intent(in) :: user
      real(wp), intent(out), dimension(steps%nlane, 0:steps%nnoise) :: w1, w2
      real(wp), intent(inout), dimension(steps%nlane, ndof) :: x, y
      real(wp), intent(out), dimension(steps%nlane, ndof) :: u, v
      integer(i4), intent(inout) :: code
      real(wp), parameter :: distance = sqrt(1/3.0_wp), first = 0.5_wp*(1 - distance)
      real(wp) :: t

      associate (n => steps%nlane, m => steps%nnoise, h => steps%h)
         t = steps%t + (s - 1)*h
         if (map%equation == two_kicks_map) then
            call weigh(n, m, steps, s, w1, w2)
            call self%drift(sure, n, ndof, t, first*h, x, y, user, u, v, code)
            call self%kick(sure, n, ndof, m, t + first*h, w1, u, v, user, x, y, code)
            call self%drift(sure, n, ndof, t + first*h, distance*h, x, y, user, u, v, code)
            call self%kick(sure, n, ndof, m, t + (1 - first)*h, w2, u, v, user, x, y, code)
            call self%drift(sure, n, ndof, t + (1 - first)*h, first*h, x, y, user, u, v, code)
         else
            w1 = steps%w(:, :, s)
            call self%drift(sure, n, ndof, t, 0.5_wp*h, x, y, user, u, v, code)
            call self%kick(sure, n, ndof, m, t + 0.5_wp*h, w1, u, v, user, x, y, code)
            call self%drift(sure, n, ndof, t + 0.5_wp*h, 0.5_wp*h, x, y, user, u, v, code)
         end if
      end associate
   end subroutine step

   !> VEC The weights of both kicks of step s. If all noises are silent no dZ is drawn, and all dW are zero.
   pure subroutine weigh(nlane, nnoise, steps, s, w1, w2)
      integer, intent(in) :: nlane, nnoise, s
      type(steps_record), intent(in) :: steps
      real(wp), intent(out), dimension(nlane, 0:nnoise) :: w1, w2
      real(wp), parameter :: root = sqrt(3.0_wp)
      real(wp) :: a
      integer :: k, lane

      w1(:, 0) = 0.5_wp*steps%h
      w2(:, 0) = 0.5_wp*steps%h
      if (.not. associated(steps%of(path_dz)%x)) then
         w1(:, 1:) = 0
         w2(:, 1:) = 0
         return
      end if
      associate (w => steps%w, dz => steps%of(path_dz)%x)
         do k = 1, nnoise
            do lane = 1, nlane
               a = dz(lane, k, s)/steps%h - 0.5_wp*w(lane, k, s)
               w1(lane, k) = 0.5_wp*w(lane, k, s) + (root*a)
               w2(lane, k) = 0.5_wp*w(lane, k, s) - (root*a)
            end do
         end do
      end associate
   end subroutine weigh

end module symsde_model_user_parts
