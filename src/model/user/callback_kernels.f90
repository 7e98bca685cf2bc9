! SPDX-License-Identifier: BSD-3-Clause
!> Kernels by a user's C functions (model/kernels): rows of a chain, products of all noises, covectors over several
!> steps, whole steps by maps, and exact flows of two parts of H.
!>
!> Private to its family.
module symsde_model_user_callback_kernels
   use, intrinsic :: iso_c_binding, only: c_associated, c_f_procpointer, c_funptr
   use symsde_base_counters, only: counters_type
   use symsde_base_kinds, only: wp, i4, i8
   use symsde_base_maps, only: step_map
   use symsde_base_record, only: steps_record
   use symsde_base_status, only: error_type, raise, missing_operation, out_of_memory, incompatible
   use symsde_base_traits, only: strip_lanes
   use symsde_base_vectors, only: copy_numbers => copy
   use symsde_model_abstract, only: force_stiffness_composed
   use symsde_model_chain_rows, only: check_chain
   use symsde_model_user_callback_flow, only: user_flows
   use symsde_model_user_callback_point, only: callback_point
   use symsde_model_user_outputs, only: little, find_room, spoil
   use symsde_model_user_parts, only: user_parts
   use symsde_model_user_path_parameters, only: lane_call
   implicit none
   private
   public :: callback_kernels

   type, abstract, extends(callback_point) :: callback_kernels
      type(user_flows) :: flows   !! whole steps by maps
      type(user_parts) :: parts   !! exact flows of two parts of H
   contains
      procedure :: chain_rows
      procedure :: force_stiffness
      procedure :: squares
      procedure :: pull
      procedure :: has_flow
      procedure :: flow
      procedure :: steps_by_parts
      procedure :: drift
      procedure :: kick
      procedure :: set_chain_rows
      procedure :: set_squares
      procedure :: set_pull
      procedure :: set_flow
      procedure :: set_parts
   end type callback_kernels

contains

   !> Add a function for rows of force and stiffness, before the model is used; c_null_funptr removes it. Refuses a
   !> model that does not declare such a chain.
   subroutine set_chain_rows(self, chain_rows, error)
      class(callback_kernels), intent(inout) :: self
      type(c_funptr), intent(in) :: chain_rows  !! a chain_rows_callback, or c_null_funptr
      type(error_type), allocatable, intent(inout) :: error

      if (allocated(error)) return
      call self%passed%forget()
      nullify (self%on%chain_rows)
      self%offers%rows = .false.
      self%offers%rows_of_one = .false.
      if (.not. c_associated(chain_rows)) return
      call check_chain(self%name, self%traits, error)
      if (allocated(error)) return
      call c_f_procpointer(chain_rows, self%on%chain_rows)
      self%offers%rows = .true.
      self%offers%rows_of_one = .true.  ! used only if any_lanes guarantees the same bits
   end subroutine set_chain_rows

   !> Add a function for products of gradients and Hessians of all noises, before the model is used; c_null_funptr
   !> removes it. Refuses a model that does not declare noise in position and the mass one.
   subroutine set_squares(self, squares, error)
      class(callback_kernels), intent(inout) :: self
      type(c_funptr), intent(in) :: squares  !! a squares_callback, or c_null_funptr
      type(error_type), allocatable, intent(inout) :: error

      if (allocated(error)) return
      call self%passed%forget()
      nullify (self%on%squares)
      self%offers%squares = .false.
      if (.not. c_associated(squares)) return
      if (.not. (self%traits%position_noise .and. self%traits%identity_mass)) then
         call raise(error, incompatible, 'set_squares', "model '"//self%name//"' does not declare position_noise "// &
                    'and identity_mass, which products of gradients of its noises need; declare both, or give no '// &
                    'function')
         return
      end if
      call c_f_procpointer(squares, self%on%squares)
      self%offers%squares = .true.
   end subroutine set_squares

   !> Add a function that takes covectors over several steps, before the model is used; c_null_funptr removes it.
   subroutine set_pull(self, pull)
      class(callback_kernels), intent(inout) :: self
      type(c_funptr), intent(in) :: pull  !! a pull_callback, or c_null_funptr

      nullify (self%on%pull)
      self%offers%pull = c_associated(pull)
      if (self%offers%pull) call c_f_procpointer(pull, self%on%pull)
   end subroutine set_pull

   !> Add whole steps by a map, before the model is used; c_null_funptr removes them.
   subroutine set_flow(self, map, take)
      class(callback_kernels), intent(inout) :: self
      type(step_map), intent(in) :: map
      type(c_funptr), intent(in) :: take  !! a flow_callback, or c_null_funptr

      call self%flows%set(map, take)
      call self%passed%forget()
   end subroutine set_flow

   !> Add exact flows of two parts of H, before the model is used; c_null_funptr for both removes them. Refuses one of
   !> them alone, and to leave a model without gradients with neither (missing_operation).
   subroutine set_parts(self, drift, kick, error)
      class(callback_kernels), intent(inout) :: self
      type(c_funptr), intent(in) :: drift, kick  !! a drift_callback and a kick_callback, or c_null_funptr
      type(error_type), allocatable, intent(inout) :: error

      if (allocated(error)) return
      if ((c_associated(drift) .neqv. c_associated(kick)) .or. &
          .not. (c_associated(drift) .or. self%traits%has_gradient)) then
         call raise(error, missing_operation, 'set_parts', "model '"//self%name//"' needs both functions, drift "// &
                    'and kick: give both, or, where the model has a gradient, none')
         return
      end if
      call self%parts%set(drift, kick)
      self%traits%has_parts = c_associated(drift)
      call self%passed%forget()
   end subroutine set_parts

   !> Rows of force and stiffness of a strip; called only if offers%rows is true.
   subroutine chain_rows(self, ndof, nnoise, first, last, t, w, q, hq, hqq)
      class(callback_kernels), intent(in) :: self
      integer, intent(in) :: ndof, nnoise, first, last
      real(wp), intent(in) :: t, w(strip_lanes, 0:nnoise)
      real(wp), intent(in) :: q(strip_lanes, first - 1:last + 1)
      real(wp), intent(out) :: hq(strip_lanes, first:last), hqq(strip_lanes, 0:1, first:last)
      type(lane_call) :: now
      integer(i4) :: code

      call self%begin_call(strip_lanes, now)
      if (.not. self%passed%is_kept()) then
         call spoil(size(hq), hq)
         call spoil(size(hqq), hqq)
      end if
      code = self%on%chain_rows(strip_lanes, ndof, nnoise + 1, first - 1, last - 1, t, w, q, hq, hqq, now%user)
      call self%end_call(now, code)
      if (code == 0) return
      call spoil(size(hq), hq)
      call spoil(size(hqq), hqq)
   end subroutine chain_rows

   !> Force and upper bands; of one lane by its rows, if the user gave a function for rows.
   subroutine force_stiffness(self, nlane, ndof, nnoise, b, t, w, q, p, hq, hqq)
      class(callback_kernels), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      integer, intent(in) :: b   !! bandwidth, traits%bandwidth
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out) :: hq(nlane, ndof), hqq(nlane, 0:b, ndof)
      real(wp), target :: few(little)
      real(wp), allocatable, target :: more(:)
      real(wp), pointer, contiguous :: padded(:)  !! q with the rows before the first and after the last
      type(lane_call) :: now
      integer(i4) :: code

      if (nlane > 1 .or. b /= 1 .or. .not. associated(self%on%chain_rows)) then
         call force_stiffness_composed(self, nlane, ndof, nnoise, b, t, w, q, p, hq, hqq)
         return
      end if
      call self%begin_call(1, now)
      call find_room(ndof + 2, few, more, padded)
      code = out_of_memory
      if (associated(padded)) then
         padded(1) = 0
         call copy_numbers(ndof, q, padded(2:ndof + 1))
         padded(ndof + 2) = 0
         if (.not. self%passed%is_kept()) then
            call spoil(ndof, hq)
            call spoil(2*ndof, hqq)
         end if
         code = self%on%chain_rows(1, ndof, nnoise + 1, 0, ndof - 1, t, w, padded, hq, hqq, now%user)
      end if
      call self%end_call(now, code)
      if (code == 0) return
      call spoil(ndof, hq)
      call spoil(2*ndof, hqq)
   end subroutine force_stiffness

   !> Products of gradients and Hessians of all noises; called only if offers%squares is true.
   subroutine squares(self, nlane, ndof, nnoise, t, q, g, w, c, s)
      class(callback_kernels), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, q(nlane, ndof)
      real(wp), intent(out) :: g(nlane, ndof)
      real(wp), intent(in), dimension(nlane, 0:nnoise), optional :: w, c
      real(wp), intent(out), optional :: s(nlane, 6)
      type(lane_call) :: now
      integer(i4) :: code

      call self%begin_call(nlane, now)
      call spoil(nlane*ndof, g)
      if (present(s)) call spoil(6*nlane, s)
      code = self%on%squares(nlane, ndof, nnoise + 1, t, q, g, w, c, s, now%user)
      call self%end_call(now, code)
      if (code == 0) return
      call spoil(nlane*ndof, g)
      if (present(s)) call spoil(6*nlane, s)
   end subroutine squares

   !> Covectors over several steps; called only if offers%pull is true.
   subroutine pull(self, nlane, ndof, nnoise, nmoving, nstep, t, h, part, dw, q, theta, u, c)
      class(callback_kernels), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise, nmoving, nstep
      real(wp), intent(in) :: t, h, part(2), dw(nlane, nnoise, nstep)
      real(wp), intent(in) :: q(nlane, nmoving, 0:nstep), theta(nlane, ndof - nmoving)
      real(wp), intent(inout) :: u(nlane, ndof), c(nlane, nmoving)
      integer(i4) :: code

      code = self%on%pull(nlane, ndof, nnoise + 1, nmoving, nstep, t, h, part, dw, q, theta, u, c, self%user)
      if (code == 0) return
      call self%failure%note(code)
      call spoil(nlane*ndof, u)
      call spoil(nlane*nmoving, c)
   end subroutine pull

   !> Whether the user gave whole steps by this map.
   pure logical function has_flow(self, map)
      class(callback_kernels), intent(in) :: self
      type(step_map), intent(in) :: map

      has_flow = self%parts%make(map) .or. self%flows%place_of(map) > 0
   end function has_flow

   !> Whether these whole steps are made of the exact flows of two parts of H, which come before functions of whole
   !> steps.
   pure logical function steps_by_parts(self, map)
      class(callback_kernels), intent(in) :: self
      type(step_map), intent(in) :: map

      steps_by_parts = self%parts%make(map)
   end function steps_by_parts

   !> Whole steps.
   subroutine flow(self, map, steps, ndof, q, p, qn, pn, status, counters)
      class(callback_kernels), intent(in) :: self
      type(step_map), intent(in) :: map
      type(steps_record), intent(in) :: steps
      integer, intent(in) :: ndof
      real(wp), intent(in) :: q(steps%nlane, ndof), p(steps%nlane, ndof)
      real(wp), intent(out) :: qn(steps%nlane, ndof, steps%nstep/steps%every)
      real(wp), intent(out) :: pn(steps%nlane, ndof, steps%nstep/steps%every)
      integer(i8), intent(inout) :: status(steps%nlane)
      type(counters_type), intent(inout) :: counters
      type(lane_call) :: now
      integer(i4) :: code

      call self%begin_call(steps%nlane, now)
      if (.not. self%passed%is_kept()) call spoil(size(qn), qn, pn)
      if (self%parts%make(map)) then
         call self%parts%take(self%passed%is_kept(), map, steps, ndof, now%user, q, p, qn, pn, code)
      else
         call self%flows%take(map, steps, ndof, now%user, q, p, qn, pn, status, code)
      end if
      call self%end_call(now, code)
      if (code /= 0) call spoil(size(qn), qn, pn)
   end subroutine flow

   !> The exact flow of D from the time t to t + tau.
   subroutine drift(self, nlane, ndof, t, tau, q, p, qn, pn)
      class(callback_kernels), intent(in) :: self
      integer, intent(in) :: nlane, ndof
      real(wp), intent(in) :: t, tau, q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out) :: qn(nlane, ndof), pn(nlane, ndof)
      type(lane_call) :: now
      integer(i4) :: code

      call self%begin_call(nlane, now)
      code = 0
      call self%parts%drift(.false., nlane, ndof, t, tau, q, p, now%user, qn, pn, code)
      call self%end_call(now, code)
   end subroutine drift

   !> The exact flow of sum_j w_j K_j, the K_j being those at the time t.
   subroutine kick(self, nlane, ndof, nnoise, t, w, q, p, qn, pn)
      class(callback_kernels), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out) :: qn(nlane, ndof), pn(nlane, ndof)
      type(lane_call) :: now
      integer(i4) :: code

      call self%begin_call(nlane, now)
      code = 0
      call self%parts%kick(.false., nlane, ndof, nnoise, t, w, q, p, now%user, qn, pn, code)
      call self%end_call(now, code)
   end subroutine kick

end module symsde_model_user_callback_kernels
