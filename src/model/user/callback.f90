! SPDX-License-Identifier: BSD-3-Clause
!> A model whose gradient, and optional further operations, are C functions for whole blocks: how it is made, copied,
!> and given parameters that differ by path.
!>
!> In arrays the lane index is fastest: Fortran q(nlane, ndof) is C q[ndof][nlane], w(nlane, 0:nnoise) is w[nham][nlane]
!> with nham = nnoise + 1, and hqp(nlane, i, j) = d2/(dq_i dp_j) is hqp[j][i][nlane]. The functions are called from
!> several threads at once, must compute every lane independently, and mark a lane that fails by NaN. Each function gets
!> a whole block, padded to full vectors; if any_lanes is true, the real lanes alone.
!>
!> What is called at a point stands in callback_point, what a stepper calls for its inner loop in callback_kernels. Do
!> not copy with allocate(source=): two models would own one record. Assignment is safe.
module symsde_model_user_callback
   use, intrinsic :: iso_c_binding, only: c_associated, c_f_procpointer, c_funptr, c_ptr
   use symsde_base_kinds, only: wp, i8
   use symsde_base_lane_paths, only: lane_paths
   use symsde_base_status, only: error_type, raise, missing_operation, out_of_memory
   use symsde_base_text, only: to_text
   use symsde_base_traits, only: model_traits
   use symsde_model_abstract, only: model_type
   use symsde_model_parameters, only: check_traits
   use symsde_model_user_callback_kernels, only: callback_kernels
   use symsde_model_user_parts, only: refuse_declarations
   implicit none
   private
   public :: callback_model, new_callback_model, new_parts_model

   type, extends(callback_kernels) :: callback_model
   contains
      procedure :: set_parameters
      procedure :: set_user
      procedure :: for_paths
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
      call c_f_procpointer(gradient, self%on%gradient)
      if (c_associated(value)) call c_f_procpointer(value, self%on%value)
      if (c_associated(hessian)) call c_f_procpointer(hessian, self%on%hessian)
      if (c_associated(hessian_vector)) call c_f_procpointer(hessian_vector, self%on%hessian_vector)
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
      if (c_associated(value)) call c_f_procpointer(value, self%on%value)
      self%user = user
      call self%failure%begin()
      if (.not. (c_associated(drift) .and. c_associated(kick))) then
         call raise(error, missing_operation, 'new_parts_model', 'model '''//name//''' lacks the function drift or '// &
                    'kick; give both, the exact flows of D and of sum_j w_j K_j')
         return
      end if
      call self%set_parts(drift, kick, error)
   end subroutine new_parts_model

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
      left%on = right%on
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
