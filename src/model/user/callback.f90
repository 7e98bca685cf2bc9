! SPDX-License-Identifier: BSD-3-Clause
!> A model whose gradient, and optional further operations, are C functions for whole blocks.
!>
!> In arrays the lane index is fastest: Fortran q(nlane, ndof) is C q[ndof][nlane], w(nlane, 0:nnoise) is w[nham][nlane]
!> with nham = nnoise + 1, and hqp(nlane, i, j) = d2/(dq_i dp_j) is hqp[j][i][nlane]. An unwanted output is a work array
!> whose content is discarded, or NULL for functions that accept NULL: writing to NULL ends the process. The functions
!> are called from several threads at once, must compute every lane independently, and mark a lane that fails by NaN.
!> Outputs are set to NaN before every call, so that lanes which a function does not write fail, too: a function of
!> numba returns 0 in the middle of a block if a lane divides by zero. A nonzero return aborts the run: the outputs of
!> that call become NaN and failure_code() returns the first such code.
!>
!> Each function gets a whole block, padded to full vectors; if any_lanes is true, the real lanes alone. Do not copy
!> with allocate(source=): two models would own one record. Assignment is safe.
module symsde_model_user_callback
   use, intrinsic :: iso_c_binding, only: c_associated, c_f_procpointer, c_funptr, c_null_ptr, c_ptr
   use symsde_base_counters, only: counters_type
   use symsde_base_kinds, only: wp, i4, i8
   use symsde_base_lane_paths, only: lane_paths
   use symsde_base_maps, only: step_map
   use symsde_base_record, only: steps_record
   use symsde_base_status, only: error_type, raise, missing_operation, out_of_memory, incompatible
   use symsde_base_text, only: to_text
   use symsde_base_traits, only: model_traits, strip_lanes
   use symsde_base_vectors, only: copy_numbers => copy
   use symsde_model_abstract, only: model_type, value_missing, hessian_by_differences, hessian_vector_composed, &
                                    force_stiffness_composed
   use symsde_model_kernels, only: kernel_model
   use symsde_model_user_callback_flow, only: user_flows
   use symsde_model_user_callback_functions, only: gradient_callback, value_callback, hessian_callback, &
                                                   hessian_vector_callback, gradient_hessian_callback, &
                                                   third_derivative_callback, squares_callback, &
                                                   pull_callback
   use symsde_model_chain_rows, only: check_chain, chain_rows_callback
   use symsde_model_user_failures, only: failure_record
   use symsde_model_user_outputs, only: little, find_room, spoil
   use symsde_model_user_parts, only: user_parts, refuse_declarations
   use symsde_model_user_path_parameters, only: path_parameters, lane_call
   use symsde_model_user_whole, only: whole_hessian, whole_gradient_hessian
   use symsde_model_parameters, only: check_traits
   implicit none
   private
   public :: callback_model, new_callback_model, new_parts_model

   type, extends(kernel_model) :: callback_model
      private
      type(user_flows) :: flows                  !! whole steps by maps
      type(user_parts) :: parts                  !! exact flows of two parts of H
      procedure(gradient_callback), pointer, nopass :: on_gradient => null()
      procedure(value_callback), pointer, nopass :: on_value => null()
      procedure(hessian_callback), pointer, nopass :: on_hessian => null()
      procedure(hessian_vector_callback), pointer, nopass :: on_hessian_vector => null()
      procedure(gradient_hessian_callback), pointer, nopass :: on_gradient_hessian => null()
      procedure(chain_rows_callback), pointer, nopass :: on_chain_rows => null()
      procedure(third_derivative_callback), pointer, nopass :: on_third_derivative => null()
      procedure(squares_callback), pointer, nopass :: on_squares => null()
      procedure(pull_callback), pointer, nopass :: on_pull => null()
      logical :: null_accepted = .false.         !! unwanted outputs are NULL
      type(c_ptr) :: user = c_null_ptr           !! user pointer of all functions, unless parameters differ by path
      type(path_parameters) :: parameters        !! parameters by path, none by default
      type(failure_record) :: failure            !! first nonzero return
   contains
      procedure :: gradient
      procedure :: value => weighted_value
      procedure :: hessian
      procedure :: hessian_vector
      procedure :: gradient_hessian
      procedure :: has_flow
      procedure :: flow
      procedure :: steps_by_parts
      procedure :: drift
      procedure :: kick
      procedure :: set_parts
      procedure :: set_gradient_hessian
      procedure :: set_flow
      procedure :: chain_rows
      procedure :: force_stiffness
      procedure :: set_chain_rows
      procedure :: third_derivative
      procedure :: set_third_derivative
      procedure :: squares
      procedure :: set_squares
      procedure :: pull
      procedure :: set_pull
      procedure :: accept_null
      procedure :: set_parameters
      procedure :: set_user
      procedure :: for_paths
      procedure :: failure_code
      procedure :: clear_failure
      procedure :: note_failure => note
      procedure, private :: copy
      generic :: assignment(=) => copy
      final :: release
   end type callback_model

contains

   !> Make a model from C functions. The functions given set the traits has_value, has_hessian and
   !> has_hessian_vector. Refuses a missing gradient (missing_operation) and impossible traits (check_traits).
   subroutine new_callback_model(self, name, traits, gradient, value, hessian, hessian_vector, &
                                 user, error)
      type(callback_model), intent(out) :: self
      character(*), intent(in) :: name                !! name for messages and reports
      type(model_traits), intent(in) :: traits        !! traits as declared by the user
      type(c_funptr), intent(in) :: gradient          !! a gradient_callback
      type(c_funptr), intent(in) :: value             !! a value_callback, or c_null_funptr
      type(c_funptr), intent(in) :: hessian           !! a hessian_callback, or c_null_funptr
      type(c_funptr), intent(in) :: hessian_vector    !! a hessian_vector_callback, or c_null_funptr
      type(c_ptr), intent(in) :: user                 !! passed to every function unchanged
      type(error_type), allocatable, intent(inout) :: error

      if (allocated(error)) return
      call check_traits('new_callback_model', name, traits, error)
      if (.not. c_associated(gradient)) &
         call raise(error, missing_operation, 'new_callback_model', 'model '''//name// &
                    ''' has no gradient; give a function for it, all the others are optional')
      if (allocated(error)) return
      self%name = name
      self%traits = traits
      self%traits%has_value = c_associated(value)
      self%traits%has_hessian = c_associated(hessian)
      self%traits%has_hessian_vector = c_associated(hessian_vector)
      call c_f_procpointer(gradient, self%on_gradient)
      if (c_associated(value)) call c_f_procpointer(value, self%on_value)
      if (c_associated(hessian)) call c_f_procpointer(hessian, self%on_hessian)
      if (c_associated(hessian_vector)) call c_f_procpointer(hessian_vector, self%on_hessian_vector)
      self%user = user
      call self%failure%begin()
   end subroutine new_callback_model

   !> Make a model from exact flows of two parts of H and, if given, its values: without gradients, so that only steps
   !> made of the two flows are there. Refuses a missing function (missing_operation), impossible traits (check_traits)
   !> and declarations that only gradients could test (incompatible).
   subroutine new_parts_model(self, name, traits, drift, kick, value, user, error)
      type(callback_model), intent(out) :: self
      character(*), intent(in) :: name                !! name for messages and reports
      type(model_traits), intent(in) :: traits        !! sizes, and bounds if any
      type(c_funptr), intent(in) :: drift             !! a drift_callback
      type(c_funptr), intent(in) :: kick              !! a kick_callback
      type(c_funptr), intent(in) :: value             !! a value_callback, or c_null_funptr
      type(c_ptr), intent(in) :: user                 !! passed to every function unchanged
      type(error_type), allocatable, intent(inout) :: error

      if (allocated(error)) return
      call check_traits('new_parts_model', name, traits, error)
      call refuse_declarations('new_parts_model', name, traits, error)
      if (allocated(error)) return
      self%name = name
      self%traits = traits
      self%traits%has_gradient = .false.
      self%traits%has_value = c_associated(value)
      if (c_associated(value)) call c_f_procpointer(value, self%on_value)
      self%user = user
      call self%failure%begin()
      if (.not. (c_associated(drift) .and. c_associated(kick))) then
         call raise(error, missing_operation, 'new_parts_model', 'model '''//name//''' lacks the function drift or '// &
                    'kick; give both, the exact flows of D and of sum_j w_j K_j')
         return
      end if
      call self%set_parts(drift, kick, error)
   end subroutine new_parts_model

   !> Add exact flows of two parts of H, before the model is used; c_null_funptr for both removes them. Refuses one of
   !> them alone, and to leave a model without gradients with neither (missing_operation).
   subroutine set_parts(self, drift, kick, error)
      class(callback_model), intent(inout) :: self
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

   !> Add a function that computes gradient and Hessian together, before the model is used; it also replaces a missing
   !> Hessian. c_null_funptr removes it.
   subroutine set_gradient_hessian(self, gradient_hessian)
      class(callback_model), intent(inout) :: self
      type(c_funptr), intent(in) :: gradient_hessian  !! a gradient_hessian_callback, or c_null_funptr

      call self%passed%forget()
      nullify (self%on_gradient_hessian)
      if (c_associated(gradient_hessian)) call c_f_procpointer(gradient_hessian, self%on_gradient_hessian)
      self%traits%has_hessian = associated(self%on_hessian) .or. associated(self%on_gradient_hessian)
   end subroutine set_gradient_hessian

   !> Add whole steps by a map, before the model is used; c_null_funptr removes them.
   subroutine set_flow(self, map, take)
      class(callback_model), intent(inout) :: self
      type(step_map), intent(in) :: map
      type(c_funptr), intent(in) :: take  !! a flow_callback, or c_null_funptr

      call self%flows%set(map, take)
      call self%passed%forget()
   end subroutine set_flow

   !> Whether the user gave whole steps by this map.
   pure logical function has_flow(self, map)
      class(callback_model), intent(in) :: self
      type(step_map), intent(in) :: map

      has_flow = self%parts%make(map) .or. self%flows%place_of(map) > 0
   end function has_flow

   !> Whether these whole steps are made of the exact flows of two parts of H, which come before functions of whole
   !> steps.
   pure logical function steps_by_parts(self, map)
      class(callback_model), intent(in) :: self
      type(step_map), intent(in) :: map

      steps_by_parts = self%parts%make(map)
   end function steps_by_parts

   !> The exact flow of D from the time t to t + tau.
   subroutine drift(self, nlane, ndof, t, tau, q, p, qn, pn)
      class(callback_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof
      real(wp), intent(in) :: t, tau, q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out) :: qn(nlane, ndof), pn(nlane, ndof)
      type(lane_call) :: now
      integer(i4) :: code

      now%user = self%user
      code = 0
      if (self%parameters%act) call self%parameters%enter(self%paths, nlane, self%user, now)
      call self%parts%drift(.false., nlane, ndof, t, tau, q, p, now%user, qn, pn, code)
      if (self%parameters%act) call now%leave()
      if (code /= 0) call self%failure%note(code)
   end subroutine drift

   !> The exact flow of sum_j w_j K_j, the K_j being those at the time t.
   subroutine kick(self, nlane, ndof, nnoise, t, w, q, p, qn, pn)
      class(callback_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out) :: qn(nlane, ndof), pn(nlane, ndof)
      type(lane_call) :: now
      integer(i4) :: code

      now%user = self%user
      code = 0
      if (self%parameters%act) call self%parameters%enter(self%paths, nlane, self%user, now)
      call self%parts%kick(.false., nlane, ndof, nnoise, t, w, q, p, now%user, qn, pn, code)
      if (self%parameters%act) call now%leave()
      if (code /= 0) call self%failure%note(code)
   end subroutine kick

   !> Whole steps.
   subroutine flow(self, map, steps, ndof, q, p, qn, pn, status, counters)
      class(callback_model), intent(in) :: self
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

      now%user = self%user
      if (self%parameters%act) call self%parameters%enter(self%paths, steps%nlane, self%user, now)
      if (.not. self%passed%is_kept()) call spoil(size(qn), qn, pn)
      if (self%parts%make(map)) then
         call self%parts%take(self%passed%is_kept(), map, steps, ndof, now%user, q, p, qn, pn, code)
      else
         call self%flows%take(map, steps, ndof, now%user, q, p, qn, pn, status, code)
      end if
      if (self%parameters%act) call now%leave()
      if (code == 0) return
      call self%failure%note(code)
      call spoil(size(qn), qn, pn)
   end subroutine flow

   !> Add a function for rows of force and stiffness, before the model is used; c_null_funptr removes it. Refuses a
   !> model that does not declare such a chain.
   subroutine set_chain_rows(self, chain_rows, error)
      class(callback_model), intent(inout) :: self
      type(c_funptr), intent(in) :: chain_rows  !! a chain_rows_callback, or c_null_funptr
      type(error_type), allocatable, intent(inout) :: error

      if (allocated(error)) return
      call self%passed%forget()
      nullify (self%on_chain_rows)
      self%offers%rows = .false.
      self%offers%rows_of_one = .false.
      if (.not. c_associated(chain_rows)) return
      call check_chain(self%name, self%traits, error)
      if (allocated(error)) return
      call c_f_procpointer(chain_rows, self%on_chain_rows)
      self%offers%rows = .true.
      self%offers%rows_of_one = .true.  ! used only if any_lanes guarantees the same bits
   end subroutine set_chain_rows

   !> Add a function for third derivatives, which nested brackets need, before the model is used; c_null_funptr removes
   !> it.
   subroutine set_third_derivative(self, third_derivative)
      class(callback_model), intent(inout) :: self
      type(c_funptr), intent(in) :: third_derivative  !! a third_derivative_callback, or c_null_funptr

      call self%passed%forget()
      nullify (self%on_third_derivative)
      self%traits%has_third_derivative = c_associated(third_derivative)
      if (self%traits%has_third_derivative) call c_f_procpointer(third_derivative, self%on_third_derivative)
   end subroutine set_third_derivative

   !> Add a function for products of gradients and Hessians of all noises, before the model is used; c_null_funptr
   !> removes it. Refuses a model that does not declare noise in position and the mass one.
   subroutine set_squares(self, squares, error)
      class(callback_model), intent(inout) :: self
      type(c_funptr), intent(in) :: squares  !! a squares_callback, or c_null_funptr
      type(error_type), allocatable, intent(inout) :: error

      if (allocated(error)) return
      call self%passed%forget()
      nullify (self%on_squares)
      self%offers%squares = .false.
      if (.not. c_associated(squares)) return
      if (.not. (self%traits%position_noise .and. self%traits%identity_mass)) then
         call raise(error, incompatible, 'set_squares', "model '"//self%name//"' does not declare position_noise "// &
                    'and identity_mass, which products of gradients of its noises need; declare both, or give no '// &
                    'function')
         return
      end if
      call c_f_procpointer(squares, self%on_squares)
      self%offers%squares = .true.
   end subroutine set_squares

   !> Add a function that takes covectors over several steps, before the model is used; c_null_funptr removes it.
   subroutine set_pull(self, pull)
      class(callback_model), intent(inout) :: self
      type(c_funptr), intent(in) :: pull  !! a pull_callback, or c_null_funptr

      nullify (self%on_pull)
      self%offers%pull = c_associated(pull)
      if (self%offers%pull) call c_f_procpointer(pull, self%on_pull)
   end subroutine set_pull

   !> Declare, before the model is used, that its functions accept NULL for outputs.
   subroutine accept_null(self)
      class(callback_model), intent(inout) :: self

      self%null_accepted = .true.
      call self%passed%forget()
   end subroutine accept_null

   !> Gradient of sum_j w_j H_j.
   subroutine gradient(self, nlane, ndof, nnoise, t, w, q, p, hq, hp)
      class(callback_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional :: hq(nlane, ndof), hp(nlane, ndof)
      real(wp), target :: few(little)
      real(wp), allocatable, target :: more(:)
      real(wp), pointer, contiguous :: unwanted(:)
      type(lane_call) :: now
      integer(i4) :: code

      if (.not. associated(self%on_gradient)) then
         call spoil(nlane*ndof, hq, hp)
         return
      end if
      now%user = self%user
      if (self%parameters%act) call self%parameters%enter(self%paths, nlane, self%user, now)
      if (.not. self%passed%is_kept()) call spoil(nlane*ndof, hq, hp)
      code = out_of_memory
      if (self%null_accepted .or. (present(hq) .and. present(hp))) then
         code = self%on_gradient(nlane, ndof, nnoise + 1, t, w, q, p, hq, hp, now%user)
      else
         call find_room(nlane*ndof, few, more, unwanted)
         if (present(hq) .and. associated(unwanted)) then
            code = self%on_gradient(nlane, ndof, nnoise + 1, t, w, q, p, hq, unwanted, now%user)
         else if (associated(unwanted)) then
            code = self%on_gradient(nlane, ndof, nnoise + 1, t, w, q, p, unwanted, hp, now%user)
         end if
      end if
      if (self%parameters%act) call now%leave()
      if (code == 0) return
      call self%failure%note(code)
      call spoil(nlane*ndof, hq, hp)
   end subroutine gradient

   !> Value of sum_j w_j H_j; NaN if the user gave no function for it.
   subroutine weighted_value(self, nlane, ndof, nnoise, t, w, q, p, value)
      class(callback_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out) :: value(nlane)
      type(lane_call) :: now
      integer(i4) :: code

      if (.not. associated(self%on_value)) then
         call value_missing(self, nlane, ndof, nnoise, t, w, q, p, value)
         return
      end if
      now%user = self%user
      if (self%parameters%act) call self%parameters%enter(self%paths, nlane, self%user, now)
      call spoil(nlane, value)
      code = self%on_value(nlane, ndof, nnoise + 1, t, w, q, p, value, now%user)
      if (self%parameters%act) call now%leave()
      if (code == 0) return
      call self%failure%note(code)
      call spoil(nlane, value)
   end subroutine weighted_value

   !> Blocks of the Hessian of sum_j w_j H_j: from the user's function, else from the joint function, from products
   !> or from differences.
   subroutine hessian(self, nlane, ndof, nnoise, t, w, q, p, hqq, hqp, hpp)
      class(callback_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), dimension(nlane, ndof, ndof), optional :: hqq, hqp, hpp
      type(lane_call) :: now
      integer(i4) :: code

      if (.not. associated(self%on_hessian)) then
         if (associated(self%on_gradient_hessian)) then
            call self%gradient_hessian(nlane, ndof, nnoise, t, w, q, p, hqq=hqq, hqp=hqp, hpp=hpp)
            return
         end if
         call hessian_by_differences(self, nlane, ndof, nnoise, t, w, q, p, hqq, hqp, hpp)
         return
      end if
      now%user = self%user
      if (self%parameters%act) call self%parameters%enter(self%paths, nlane, self%user, now)
      if (self%null_accepted .or. (present(hqq) .and. present(hqp) .and. present(hpp))) then
         call spoil(nlane*ndof**2, hqq, hqp, hpp)
         code = self%on_hessian(nlane, ndof, nnoise + 1, t, w, q, p, hqq, hqp, hpp, now%user)
      else
         call whole_hessian(self%on_hessian, nlane, ndof, nnoise, t, w, q, p, now%user, code, hqq, hqp, hpp)
      end if
      if (self%parameters%act) call now%leave()
      if (code == 0) return
      call self%failure%note(code)
      call spoil(nlane*ndof**2, hqq, hqp, hpp)
   end subroutine hessian

   !> Hessian of sum_j w_j H_j times (vq, vp): from the user's function, else from the Hessian or from differences.
   subroutine hessian_vector(self, nlane, ndof, nnoise, t, w, q, p, vq, vp, uq, up)
      class(callback_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(in) :: vq(nlane, ndof), vp(nlane, ndof)
      real(wp), intent(out) :: uq(nlane, ndof), up(nlane, ndof)
      type(lane_call) :: now
      integer(i4) :: code

      if (.not. associated(self%on_hessian_vector)) then
         call hessian_vector_composed(self, nlane, ndof, nnoise, t, w, q, p, vq, vp, uq, up)
         return
      end if
      now%user = self%user
      if (self%parameters%act) call self%parameters%enter(self%paths, nlane, self%user, now)
      if (.not. self%passed%is_kept()) call spoil(nlane*ndof, uq, up)
      code = self%on_hessian_vector(nlane, ndof, nnoise + 1, t, w, q, p, vq, vp, uq, up, now%user)
      if (self%parameters%act) call now%leave()
      if (code == 0) return
      call self%failure%note(code)
      call spoil(nlane*ndof, uq, up)
   end subroutine hessian_vector

   !> Gradient and Hessian at one point; one after the other if the user offers no joint function.
   subroutine gradient_hessian(self, nlane, ndof, nnoise, t, w, q, p, hq, hp, hqq, hqp, hpp)
      class(callback_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional :: hq(nlane, ndof), hp(nlane, ndof)
      real(wp), intent(out), dimension(nlane, ndof, ndof), optional :: hqq, hqp, hpp
      type(lane_call) :: now
      integer(i4) :: code

      if (.not. associated(self%on_gradient_hessian)) then
         call self%gradient(nlane, ndof, nnoise, t, w, q, p, hq, hp)
         call self%hessian(nlane, ndof, nnoise, t, w, q, p, hqq, hqp, hpp)
         return
      end if
      now%user = self%user
      if (self%parameters%act) call self%parameters%enter(self%paths, nlane, self%user, now)
      if (self%null_accepted .or. (present(hq) .and. present(hp) .and. present(hqq) .and. present(hqp) .and. &
                                   present(hpp))) then
         if (.not. self%passed%is_kept()) then
            call spoil(nlane*ndof, hq, hp)
            call spoil(nlane*ndof**2, hqq, hqp, hpp)
         end if
         code = self%on_gradient_hessian(nlane, ndof, nnoise + 1, t, w, q, p, hq, hp, hqq, hqp, hpp, now%user)
      else
         call whole_gradient_hessian(self%on_gradient_hessian, nlane, ndof, nnoise, t, w, q, p, now%user, code, &
                                     hq, hp, hqq, hqp, hpp)
      end if
      if (self%parameters%act) call now%leave()
      if (code == 0) return
      call self%failure%note(code)
      call spoil(nlane*ndof, hq, hp)
      call spoil(nlane*ndof**2, hqq, hqp, hpp)
   end subroutine gradient_hessian

   !> Rows of force and stiffness of a strip; called only if offers%rows is true.
   subroutine chain_rows(self, ndof, nnoise, first, last, t, w, q, hq, hqq)
      class(callback_model), intent(in) :: self
      integer, intent(in) :: ndof, nnoise, first, last
      real(wp), intent(in) :: t, w(strip_lanes, 0:nnoise)
      real(wp), intent(in) :: q(strip_lanes, first - 1:last + 1)
      real(wp), intent(out) :: hq(strip_lanes, first:last), hqq(strip_lanes, 0:1, first:last)
      type(lane_call) :: now
      integer(i4) :: code

      now%user = self%user
      if (self%parameters%act) call self%parameters%enter(self%paths, strip_lanes, self%user, now)
      if (.not. self%passed%is_kept()) then
         call spoil(size(hq), hq)
         call spoil(size(hqq), hqq)
      end if
      code = self%on_chain_rows(strip_lanes, ndof, nnoise + 1, first - 1, last - 1, t, w, q, hq, hqq, now%user)
      if (self%parameters%act) call now%leave()
      if (code == 0) return
      call self%failure%note(code)
      call spoil(size(hq), hq)
      call spoil(size(hqq), hqq)
   end subroutine chain_rows

   !> Force and upper bands; of one lane by its rows, if the user gave a function for rows.
   subroutine force_stiffness(self, nlane, ndof, nnoise, b, t, w, q, p, hq, hqq)
      class(callback_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      integer, intent(in) :: b   !! bandwidth, traits%bandwidth
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out) :: hq(nlane, ndof), hqq(nlane, 0:b, ndof)
      real(wp), target :: few(little)
      real(wp), allocatable, target :: more(:)
      real(wp), pointer, contiguous :: padded(:)  !! q with the rows before the first and after the last
      type(lane_call) :: now
      integer(i4) :: code

      if (nlane > 1 .or. b /= 1 .or. .not. associated(self%on_chain_rows)) then
         call force_stiffness_composed(self, nlane, ndof, nnoise, b, t, w, q, p, hq, hqq)
         return
      end if
      now%user = self%user
      if (self%parameters%act) call self%parameters%enter(self%paths, 1, self%user, now)
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
         code = self%on_chain_rows(1, ndof, nnoise + 1, 0, ndof - 1, t, w, padded, hq, hqq, now%user)
      end if
      if (self%parameters%act) call now%leave()
      if (code == 0) return
      call self%failure%note(code)
      call spoil(ndof, hq)
      call spoil(2*ndof, hqq)
   end subroutine force_stiffness

   !> Third derivatives of sum_j w_j H_j along two vectors; called only with the trait has_third_derivative.
   subroutine third_derivative(self, nlane, ndof, nnoise, t, w, q, p, aq, ap, bq, bp, uq, up)
      class(callback_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(in) :: aq(nlane, ndof), ap(nlane, ndof), bq(nlane, ndof), bp(nlane, ndof)
      real(wp), intent(out) :: uq(nlane, ndof), up(nlane, ndof)
      type(lane_call) :: now
      integer(i4) :: code

      now%user = self%user
      if (self%parameters%act) call self%parameters%enter(self%paths, nlane, self%user, now)
      call spoil(nlane*ndof, uq, up)
      code = self%on_third_derivative(nlane, ndof, nnoise + 1, t, w, q, p, aq, ap, bq, bp, uq, up, now%user)
      if (self%parameters%act) call now%leave()
      if (code == 0) return
      call self%failure%note(code)
      call spoil(nlane*ndof, uq, up)
   end subroutine third_derivative

   !> Products of gradients and Hessians of all noises; called only if offers%squares is true.
   subroutine squares(self, nlane, ndof, nnoise, t, q, g, w, c, s)
      class(callback_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, q(nlane, ndof)
      real(wp), intent(out) :: g(nlane, ndof)
      real(wp), intent(in), dimension(nlane, 0:nnoise), optional :: w, c
      real(wp), intent(out), optional :: s(nlane, 6)
      type(lane_call) :: now
      integer(i4) :: code

      now%user = self%user
      if (self%parameters%act) call self%parameters%enter(self%paths, nlane, self%user, now)
      call spoil(nlane*ndof, g)
      if (present(s)) call spoil(6*nlane, s)
      code = self%on_squares(nlane, ndof, nnoise + 1, t, q, g, w, c, s, now%user)
      if (self%parameters%act) call now%leave()
      if (code == 0) return
      call self%failure%note(code)
      call spoil(nlane*ndof, g)
      if (present(s)) call spoil(6*nlane, s)
   end subroutine squares

   !> Covectors over several steps; called only if offers%pull is true.
   subroutine pull(self, nlane, ndof, nnoise, nmoving, nstep, t, h, part, dw, q, theta, u, c)
      class(callback_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise, nmoving, nstep
      real(wp), intent(in) :: t, h, part(2), dw(nlane, nnoise, nstep)
      real(wp), intent(in) :: q(nlane, nmoving, 0:nstep), theta(nlane, ndof - nmoving)
      real(wp), intent(inout) :: u(nlane, ndof), c(nlane, nmoving)
      integer(i4) :: code

      code = self%on_pull(nlane, ndof, nnoise + 1, nmoving, nstep, t, h, part, dw, q, theta, u, c, self%user)
      if (code == 0) return
      call self%failure%note(code)
      call spoil(nlane*ndof, u)
      call spoil(nlane*nmoving, c)
   end subroutine pull

   !> The first nonzero code that a function returned since clear_failure; 0 = none.
   integer function failure_code(self) result(code)
      class(callback_model), intent(in) :: self

      code = self%failure%first()
   end function failure_code

   !> Forget a failure before a run.
   subroutine clear_failure(self)
      class(callback_model), intent(in) :: self

      call self%failure%clear()
   end subroutine clear_failure

   !> Keep the first nonzero code. If two threads fail at the same moment, either code may be kept.
   subroutine note(self, code)
      class(callback_model), intent(in) :: self
      integer, intent(in) :: code

      call self%failure%note(int(code, i4))
   end subroutine note

   !> Set parameters that differ by path, before the model is used: row i (nrow, nparameter) is for path first_path + i
   !> of a run, or one row for all paths. The functions then get symsde_lanes of symsde.h in place of the user pointer.
   !> Without rows they get the user pointer again.
   subroutine set_parameters(self, values, error)
      class(callback_model), intent(inout) :: self
      real(wp), intent(in) :: values(:, :)
      type(error_type), allocatable, intent(inout) :: error
      integer :: info

      if (allocated(error)) return
      call self%passed%forget()
      call self%parameters%release()
      self%traits%npath = 0
      self%traits%by_path = size(values) > 0
      if (.not. self%traits%by_path) return
      call self%parameters%set(values, info)
      if (info /= 0) call raise(error, out_of_memory, 'set_parameters', 'no memory for the parameters of '// &
                                to_text(size(values, 1, i8))//' paths')
      if (size(values, 1) > 1) self%traits%npath = size(values, 1, i8)
   end subroutine set_parameters

   !> Set another user pointer, if it is only data for the functions: the results of probes are kept.
   subroutine set_user(self, user)
      class(callback_model), intent(inout) :: self
      type(c_ptr), intent(in) :: user

      self%user = user
   end subroutine set_user

   !> A view of the model that gives the functions the parameters of the paths in its lanes, if parameters differ by
   !> path.
   subroutine for_paths(self, paths, view)
      class(callback_model), intent(in), target :: self
      type(lane_paths), pointer, intent(in) :: paths
      class(model_type), pointer, intent(out) :: view
      type(callback_model), pointer :: told

      nullify (view)
      if (self%parameters%nrow() == 0) return
      allocate (told)
      call take_over(told, self)
      call told%failure%see(self%failure)
      told%paths => paths
      call told%parameters%see_paths()
      view => told
   end subroutine for_paths

   !> Assignment: the copy has the same functions and record of probes, but a separate record of failure.
   subroutine copy(left, right)
      class(callback_model), intent(inout) :: left
      class(callback_model), intent(in) :: right

      call take_over(left, right)
      call left%failure%begin()
   end subroutine copy

   !> Copy everything except the record of failure.
   subroutine take_over(left, right)
      class(callback_model), intent(inout) :: left
      class(callback_model), intent(in) :: right

      left%name = right%name
      left%traits = right%traits
      left%damping = right%damping
      left%forces => right%forces
      left%on_gradient => right%on_gradient
      left%on_value => right%on_value
      left%on_hessian => right%on_hessian
      left%on_hessian_vector => right%on_hessian_vector
      left%on_gradient_hessian => right%on_gradient_hessian
      left%on_chain_rows => right%on_chain_rows
      left%on_third_derivative => right%on_third_derivative
      left%on_squares => right%on_squares
      left%on_pull => right%on_pull
      left%null_accepted = right%null_accepted
      left%offers = right%offers
      left%flows = right%flows
      left%parts = right%parts
      left%user = right%user
      call left%parameters%share(right%parameters)
      call left%passed%share(right%passed)
   end subroutine take_over

   !> Deallocate the records.
   subroutine release(self)
      type(callback_model), intent(inout) :: self

      call self%failure%release()
      call self%parameters%release()
      call self%passed%release()
   end subroutine release

end module symsde_model_user_callback
