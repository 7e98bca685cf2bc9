! SPDX-License-Identifier: BSD-3-Clause
!> The abstract model: a stochastic Hamiltonian system, evaluated as weighted sums of its Hamiltonians.
!>
!> A model contains H_0 = H, H_1 .. H_m and its traits, and nothing about schemes, noise or solvers. A scheme needs only
!> value, gradient, Hessian and third derivatives of S(q,p) = sum_j w_j H_j(q,p), with different weights in every lane:
!> with w = (h, dW_1, .., dW_m), S is the random Hamiltonian of one step of
!>
!>    dp = -H_q dt - sum_k H_{k,q} o dW_k,   dq = H_p dt + sum_k H_{k,p} o dW_k     [WHSB] (3)-(4)
!>
!> (Stratonovich, everything dimensionless). Damping of the momenta and forces (model/forces) may stand beside these.
!> Optional fast operations, for the inner loops of single steppers, are in
!> model/kernels. Each lane must be computed from its own numbers alone; and, if the model differs from path to path,
!> from the path of the lane (for_paths). Procedures are called from several threads at once: compile your own models
!> with -fopenmp or -frecursive, or gfortran may make their large local arrays static.
module symsde_model_abstract
   use symsde_base_damping, only: damping_type
   use symsde_base_kinds, only: wp
   use symsde_base_lane_paths, only: lane_paths
   use symsde_base_probe_record, only: probe_record
   use symsde_base_status, only: error_type, raise, incompatible, missing_operation
   use symsde_base_traits, only: model_traits, force_traits
   use symsde_model_forces, only: force_type
   implicit none
   private
   public :: model_type, difference_along, difference_default, default_step
   ! Default operations, for models that offer an operation only under some conditions.
   public :: value_missing, hessian_by_differences, hessian_vector_composed, force_stiffness_composed

   !> Step of a central difference, relative to the larger of the state and one.
   real(wp), parameter :: default_step = epsilon(1.0_wp)**(1.0_wp/3)

   !> A model does not change after its construction: all threads share it, and it is intent(in) wherever it is used.
   type, abstract :: model_type
      type(model_traits) :: traits
      character(:), allocatable :: name  !! name for messages and reports
      type(damping_type) :: damping      !! damping of the momenta; none by default
      class(force_type), pointer :: forces => null()  !! forces beside the Hamiltonians, or null; they outlive the model
      type(probe_record) :: passed       !! probes that need not be repeated
      type(lane_paths), pointer :: paths => null()  !! paths of the lanes, in a view made by for_paths
   contains
      procedure(gradient_interface), deferred :: gradient
      procedure :: value => value_missing
      procedure :: hessian => hessian_by_differences
      procedure :: hessian_vector => hessian_vector_composed
      procedure :: gradient_hessian => gradient_hessian_composed
      procedure :: hessian_banded => hessian_banded_by_differences
      procedure :: force_stiffness => force_stiffness_composed
      procedure :: third_derivative => third_derivative_missing
      procedure :: for_paths => same_for_all
      procedure :: failure_code => never_failed
      procedure :: clear_failure => nothing_to_clear
      procedure :: note_failure => nothing_to_note
      procedure :: set_forces
      procedure :: refuse_forces
      procedure :: refuse_paths
      procedure :: require_gradient
      procedure :: calls_users
      procedure :: force
      procedure :: force_derivative
      procedure :: force_along
      procedure :: force_bands
   end type model_type

   abstract interface
      !> Gradient of sum_j w_j H_j; an absent output need not be computed.
      subroutine gradient_interface(self, nlane, ndof, nnoise, t, w, q, p, hq, hp)
         import :: model_type, wp
         class(model_type), intent(in) :: self
         integer, intent(in) :: nlane, ndof, nnoise
         real(wp), intent(in) :: t                          !! time [time]
         real(wp), intent(in) :: w(nlane, 0:nnoise)         !! weights of H_0 .. H_m
         real(wp), intent(in) :: q(nlane, ndof), p(nlane, ndof)
         real(wp), intent(out), optional :: hq(nlane, ndof) !! d/dq
         real(wp), intent(out), optional :: hp(nlane, ndof) !! d/dp
      end subroutine gradient_interface
   end interface

contains

   !> Value of sum_j w_j H_j. This default is for models without values: traits%has_value is false.
   subroutine value_missing(self, nlane, ndof, nnoise, t, w, q, p, value)
      use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan
      class(model_type), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out) :: value(nlane)

      value = ieee_value(1.0_wp, ieee_quiet_nan)
   end subroutine value_missing

   !> Blocks of the Hessian of sum_j w_j H_j; hqp(:,i,j) = d2/(dq_i dp_j). Default: products with the unit vectors if
   !> the model has products, else central differences of gradients.
   subroutine hessian_by_differences(self, nlane, ndof, nnoise, t, w, q, p, hqq, hqp, hpp)
      class(model_type), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional :: hqq(nlane, ndof, ndof)
      real(wp), intent(out), optional :: hqp(nlane, ndof, ndof)
      real(wp), intent(out), optional :: hpp(nlane, ndof, ndof)
      real(wp), allocatable :: vq(:, :), vp(:, :), uq(:, :), up(:, :)
      integer :: j

      allocate (vq(nlane, ndof), vp(nlane, ndof), uq(nlane, ndof), up(nlane, ndof))
      vq = 0
      vp = 0
      do j = 1, ndof
         if (present(hqq)) then
            vq(:, j) = 1
            call product_along(self, nlane, ndof, nnoise, t, w, q, p, vq, vp, uq, up)
            hqq(:, :, j) = uq
            vq(:, j) = 0
         end if
         if (present(hqp) .or. present(hpp)) then
            vp(:, j) = 1
            call product_along(self, nlane, ndof, nnoise, t, w, q, p, vq, vp, uq, up)
            if (present(hqp)) hqp(:, :, j) = uq
            if (present(hpp)) hpp(:, :, j) = up
            vp(:, j) = 0
         end if
      end do
      if (present(hqq)) call symmetrise(nlane, ndof, hqq)
      if (present(hpp)) call symmetrise(nlane, ndof, hpp)
   end subroutine hessian_by_differences

   !> Product of the Hessian of sum_j w_j H_j with (vq, vp). Default: from an analytic Hessian if the model has one,
   !> else the central difference of gradients along the vector.
   subroutine hessian_vector_composed(self, nlane, ndof, nnoise, t, w, q, p, vq, vp, uq, up)
      class(model_type), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(in) :: vq(nlane, ndof), vp(nlane, ndof)
      real(wp), intent(out) :: uq(nlane, ndof), up(nlane, ndof)
      real(wp), allocatable :: hqq(:, :, :), hqp(:, :, :), hpp(:, :, :)
      integer :: i, j

      if (.not. self%traits%has_hessian) then
         call difference_default(self, nlane, ndof, nnoise, t, w, q, p, vq, vp, uq, up)
         return
      end if
      allocate (hqq(nlane, ndof, ndof), hqp(nlane, ndof, ndof), hpp(nlane, ndof, ndof))
      call self%hessian(nlane, ndof, nnoise, t, w, q, p, hqq, hqp, hpp)
      uq = 0
      up = 0
      do j = 1, ndof
         do i = 1, ndof
            uq(:, i) = uq(:, i) + hqq(:, i, j)*vq(:, j) + hqp(:, i, j)*vp(:, j)
            up(:, i) = up(:, i) + hqp(:, j, i)*vq(:, j) + hpp(:, i, j)*vp(:, j)
         end do
      end do
   end subroutine hessian_vector_composed

   !> Gradient and Hessian at one point, as Newton iterations need them. Default: one after the other; models in which
   !> the two share work (sin and cos of one argument) override it.
   subroutine gradient_hessian_composed(self, nlane, ndof, nnoise, t, w, q, p, hq, hp, &
                                        hqq, hqp, hpp)
      class(model_type), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional :: hq(nlane, ndof), hp(nlane, ndof)
      real(wp), intent(out), optional :: hqq(nlane, ndof, ndof), hqp(nlane, ndof, ndof)
      real(wp), intent(out), optional :: hpp(nlane, ndof, ndof)

      call self%gradient(nlane, ndof, nnoise, t, w, q, p, hq, hp)
      call self%hessian(nlane, ndof, nnoise, t, w, q, p, hqq, hqp, hpp)
   end subroutine gradient_hessian_composed

   !> Bands of the Hessian blocks: hqq(:,d,i) = d2/(dq_i dq_{i+d}), hqp(:,d,i) = d2/(dq_i dp_{i+d}). Entries outside the
   !> matrix are zero. Default: a single product gives every (2b+1)-th column at once, analytically if the model has
   !> products, else by a central difference.
   subroutine hessian_banded_by_differences(self, nlane, ndof, nnoise, b, t, w, q, p, hqq, hqp, hpp)
      class(model_type), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      integer, intent(in) :: b   !! bandwidth, traits%bandwidth
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional :: hqq(nlane, -b:b, ndof)
      real(wp), intent(out), optional :: hqp(nlane, -b:b, ndof)
      real(wp), intent(out), optional :: hpp(nlane, -b:b, ndof)
      real(wp), allocatable :: v(:, :), zero(:, :), uq(:, :), up(:, :)
      integer :: colour

      allocate (v(nlane, ndof), zero(nlane, ndof), uq(nlane, ndof), up(nlane, ndof))
      zero = 0
      if (present(hqq)) hqq = 0
      if (present(hqp)) hqp = 0
      if (present(hpp)) hpp = 0
      do colour = 1, min(2*b + 1, ndof)
         v = 0
         v(:, colour:ndof:2*b + 1) = 1
         if (present(hqq)) then
            call product_along(self, nlane, ndof, nnoise, t, w, q, p, v, zero, uq, up)
            call scatter(nlane, ndof, b, colour, uq, hqq)
         end if
         if (present(hqp) .or. present(hpp)) then
            call product_along(self, nlane, ndof, nnoise, t, w, q, p, zero, v, uq, up)
            if (present(hqp)) call scatter(nlane, ndof, b, colour, uq, hqp)
            if (present(hpp)) call scatter(nlane, ndof, b, colour, up, hpp)
         end if
      end do
   end subroutine hessian_banded_by_differences

   !> Gradient in q and upper bands of the qq block: hqq(:,d,i) = d2/(dq_i dq_{i+d}), 0 <= d <= b; entries outside the
   !> matrix are not defined. Default: one after the other; chains override it with a single pass.
   subroutine force_stiffness_composed(self, nlane, ndof, nnoise, b, t, w, q, p, hq, hqq)
      class(model_type), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      integer, intent(in) :: b   !! bandwidth, traits%bandwidth
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out) :: hq(nlane, ndof), hqq(nlane, 0:b, ndof)
      real(wp), allocatable :: bands(:, :, :)

      allocate (bands(nlane, -b:b, ndof))
      call self%gradient(nlane, ndof, nnoise, t, w, q, p, hq=hq)
      call self%hessian_banded(nlane, ndof, nnoise, b, t, w, q, p, hqq=bands)
      hqq = bands(:, 0:b, :)
   end subroutine force_stiffness_composed

   !> The gradient of a^T S'' b, S = sum_j w_j H_j, for vectors a = (aq, ap) and b: third derivatives along both
   !> vectors, which make nested brackets exact. This default is for models without third derivatives:
   !> traits%has_third_derivative is false.
   subroutine third_derivative_missing(self, nlane, ndof, nnoise, t, w, q, p, aq, ap, bq, bp, uq, up)
      use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan
      class(model_type), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(in) :: aq(nlane, ndof), ap(nlane, ndof), bq(nlane, ndof), bp(nlane, ndof)
      real(wp), intent(out) :: uq(nlane, ndof), up(nlane, ndof)

      uq = ieee_value(1.0_wp, ieee_quiet_nan)
      up = ieee_value(1.0_wp, ieee_quiet_nan)
   end subroutine third_derivative_missing

   !> The model for one runner, used by one thread at a time: a view that reads from `paths`, at every call, which paths
   !> the lanes are. The view belongs to the caller; model and `paths` must outlive it. Where the model is itself a view
   !> of an inner model, the new view contains a view of the inner model for the same paths. Probes before a run call
   !> the model itself, which then has the parameters of some path. This default is for models that are the same for all
   !> paths: there is no view.
   subroutine same_for_all(self, paths, view)
      class(model_type), intent(in), target :: self
      type(lane_paths), pointer, intent(in) :: paths
      class(model_type), pointer, intent(out) :: view   !! a view with its component `paths` set, or null

      nullify (view)
   end subroutine same_for_all

   !> Replace the forces that act beside the Hamiltonians.
   subroutine set_forces(self, forces)
      class(model_type), intent(inout) :: self
      class(force_type), intent(in), pointer :: forces   !! forces, or null

      self%forces => forces
      self%traits%forces = force_traits()
      if (associated(forces)) self%traits%forces = forces%traits
      self%traits%forces%bandwidth = min(self%traits%forces%bandwidth, self%traits%ndof - 1)
      ! A noise whose H_k vanishes still has to be drawn where a force f_k goes with it.
      if (self%traits%forces%noise .and. allocated(self%traits%silent)) deallocate (self%traits%silent)
      call self%passed%forget()
   end subroutine set_forces

   !> Whether functions of users act beside the Hamiltonians: forces, or rates of damping.
   pure logical function calls_users(self)
      class(model_type), intent(in) :: self

      calls_users = associated(self%forces) .or. .not. self%damping%is_constant()
   end function calls_users

   !> Refuse a model on which forces act (incompatible), in procedures that know systems without them alone.
   subroutine refuse_forces(self, place, what, error)
      class(model_type), intent(in) :: self
      character(*), intent(in) :: place   !! the procedure
      character(*), intent(in) :: what    !! the quantity that only systems without forces have
      type(error_type), allocatable, intent(inout) :: error

      if (associated(self%forces) .and. .not. allocated(error)) &
         call raise(error, incompatible, place, 'forces act on model '//self%name//', and '//what//' is that of a '// &
                    'system without them: use the model without forces')
   end subroutine refuse_forces

   !> Refuse a model whose paths have parameters of their own (incompatible), in procedures that evaluate one model for
   !> all paths.
   subroutine refuse_paths(self, place, what, error)
      class(model_type), intent(in) :: self
      character(*), intent(in) :: place   !! the procedure
      character(*), intent(in) :: what    !! the quantity that is computed for one model
      type(error_type), allocatable, intent(inout) :: error

      if (self%traits%npath > 0 .and. .not. allocated(error)) &
         call raise(error, incompatible, place, 'parameters of model '//self%name//' differ from path to path, and '// &
                    what//' is found for one model: give the parameters of one path')
   end subroutine refuse_paths

   !> Refuse a model without gradients, of which flows of two parts of H are all that is given (missing_operation).
   subroutine require_gradient(self, place, what, error)
      class(model_type), intent(in) :: self
      character(*), intent(in) :: place   !! the procedure
      character(*), intent(in) :: what    !! what takes gradients
      type(error_type), allocatable, intent(inout) :: error

      if (self%traits%has_gradient .or. allocated(error)) return
      call raise(error, missing_operation, place, 'model '//self%name//' gives flows of two parts of H (drift, '// &
                 'kick) and no gradient, which '//what//' takes: give it a gradient, too')
   end subroutine require_gradient

   !> Fhat = sum_j w_j F_j; zero without forces. An error code of the forces is kept like that of the model's own
   !> functions.
   subroutine force(self, nlane, ndof, nnoise, t, w, q, p, f)
      class(model_type), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out) :: f(nlane, ndof)
      integer :: code

      f = 0
      if (.not. associated(self%forces)) return
      call self%forces%find(nlane, ndof, nnoise, t, w, q, p, f, code)
      if (code /= 0) call self%note_failure(code)
   end subroutine force

   !> fq(:, i, j) = dFhat_i/dq_j and fp(:, i, j) = dFhat_i/dp_j, where forces act.
   subroutine force_derivative(self, nlane, ndof, nnoise, t, w, q, p, fq, fp)
      class(model_type), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out) :: fq(nlane, ndof, ndof), fp(nlane, ndof, ndof)
      integer :: code

      call self%forces%derivative(nlane, ndof, nnoise, t, w, q, p, fq, fp, code)
      if (code /= 0) call self%note_failure(code)
   end subroutine force_derivative

   !> The derivative of Fhat along (vq, vp), where forces act.
   subroutine force_along(self, nlane, ndof, nnoise, t, w, q, p, vq, vp, u)
      class(model_type), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(in) :: vq(nlane, ndof), vp(nlane, ndof)
      real(wp), intent(out) :: u(nlane, ndof)
      integer :: code

      call self%forces%along(nlane, ndof, nnoise, t, w, q, p, vq, vp, u, code)
      if (code /= 0) call self%note_failure(code)
   end subroutine force_along

   !> Bands of the derivatives of Fhat (model/forces), where forces act and have a bandwidth of b at most.
   subroutine force_bands(self, nlane, ndof, nnoise, b, t, w, q, p, fq, fp)
      class(model_type), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise, b
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out) :: fq(nlane, -b:b, ndof), fp(nlane, -b:b, ndof)
      integer :: code

      call self%forces%bands(nlane, ndof, nnoise, b, t, w, q, p, fq, fp, code)
      if (code /= 0) call self%note_failure(code)
   end subroutine force_bands

   !> The first nonzero return code of a user callback since clear_failure; 0 = none. Built-in models never fail.
   integer function never_failed(self) result(code)
      class(model_type), intent(in) :: self

      code = 0
   end function never_failed

   !> Forget a failure before a run. Built-in models have no failures.
   subroutine nothing_to_clear(self)
      class(model_type), intent(in) :: self
   end subroutine nothing_to_clear

   !> Keep the first code that forces returned for an error. Built-in models keep none: paths fail where forces are NaN.
   subroutine nothing_to_note(self, code)
      class(model_type), intent(in) :: self
      integer, intent(in) :: code
   end subroutine nothing_to_note

   !> The Hessian times a vector, for the defaults above: analytic if the model has products.
   subroutine product_along(self, nlane, ndof, nnoise, t, w, q, p, vq, vp, uq, up)
      class(model_type), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(in) :: vq(nlane, ndof), vp(nlane, ndof)
      real(wp), intent(out) :: uq(nlane, ndof), up(nlane, ndof)

      if (self%traits%has_hessian_vector) then
         call self%hessian_vector(nlane, ndof, nnoise, t, w, q, p, vq, vp, uq, up)
      else
         call difference_default(self, nlane, ndof, nnoise, t, w, q, p, vq, vp, uq, up)
      end if
   end subroutine product_along

   !> Central difference of the gradient of sum_j w_j H_j along (vq, vp): its Hessian times the
   !> vector.
   subroutine difference_along(self, nlane, ndof, nnoise, step, t, w, q, p, vq, vp, uq, up)
      class(model_type), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: step(nlane)  !! displacement of the component that moves most
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(in) :: vq(nlane, ndof), vp(nlane, ndof)
      real(wp), intent(out) :: uq(nlane, ndof), up(nlane, ndof)
      real(wp) :: largest(nlane)
      integer :: i

      largest = 0
      do i = 1, ndof
         largest = max(largest, abs(vq(:, i)), abs(vp(:, i)))
      end do
      largest = step/(largest + merge(0.0_wp, 1.0_wp, largest > 0)) ! a sum: compilers may evaluate both of two divisors
      call difference_by(self, nlane, ndof, nnoise, largest, t, w, q, p, vq, vp, uq, up)
   end subroutine difference_along

   !> Central difference along (vq, vp) with a step for smooth models: eps^(1/3) times the larger of |x_i| and one,
   !> which balances truncation and rounding. No component moves further than its own step, so that degrees of freedom
   !> of different size have accurate derivatives.
   subroutine difference_default(self, nlane, ndof, nnoise, t, w, q, p, vq, vp, uq, up)
      class(model_type), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(in) :: vq(nlane, ndof), vp(nlane, ndof)
      real(wp), intent(out) :: uq(nlane, ndof), up(nlane, ndof)
      real(wp) :: largest(nlane)
      integer :: i

      largest = 0
      do i = 1, ndof
         largest = max(largest, abs(vq(:, i))/max(1.0_wp, abs(q(:, i))), abs(vp(:, i))/max(1.0_wp, abs(p(:, i))))
      end do
      largest = default_step/(largest + merge(0.0_wp, 1.0_wp, largest > 0))
      call difference_by(self, nlane, ndof, nnoise, largest, t, w, q, p, vq, vp, uq, up)
   end subroutine difference_default

   !> The gradient at x + e v minus the gradient at x - e v.
   subroutine difference_by(self, nlane, ndof, nnoise, e, t, w, q, p, vq, vp, uq, up)
      class(model_type), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: e(nlane)
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(in) :: vq(nlane, ndof), vp(nlane, ndof)
      real(wp), intent(out) :: uq(nlane, ndof), up(nlane, ndof)
      real(wp), allocatable :: qe(:, :), pe(:, :), lower_q(:, :), lower_p(:, :)
      integer :: i

      allocate (qe(nlane, ndof), pe(nlane, ndof), lower_q(nlane, ndof), lower_p(nlane, ndof))
      do i = 1, ndof
         qe(:, i) = q(:, i) - e*vq(:, i)
         pe(:, i) = p(:, i) - e*vp(:, i)
      end do
      call self%gradient(nlane, ndof, nnoise, t, w, qe, pe, lower_q, lower_p)
      do i = 1, ndof
         qe(:, i) = q(:, i) + e*vq(:, i)
         pe(:, i) = p(:, i) + e*vp(:, i)
      end do
      call self%gradient(nlane, ndof, nnoise, t, w, qe, pe, uq, up)
      do i = 1, ndof
         uq(:, i) = (uq(:, i) - lower_q(:, i))/(2*e)
         up(:, i) = (up(:, i) - lower_p(:, i))/(2*e)
      end do
   end subroutine difference_by

   pure subroutine symmetrise(nlane, ndof, a)
      integer, intent(in) :: nlane, ndof
      real(wp), intent(inout) :: a(nlane, ndof, ndof)
      integer :: i, j

      do j = 2, ndof
         do i = 1, j - 1
            a(:, i, j) = 0.5_wp*(a(:, i, j) + a(:, j, i))
            a(:, j, i) = a(:, i, j)
         end do
      end do
   end subroutine symmetrise

   !> Distribute the product with a coloured sum of unit vectors over the bands: each of its entries belongs to one
   !> column of this colour.
   pure subroutine scatter(nlane, ndof, b, colour, u, bands)
      integer, intent(in) :: nlane, ndof, b, colour
      real(wp), intent(in) :: u(nlane, ndof)
      real(wp), intent(inout) :: bands(nlane, -b:b, ndof)
      integer :: i, j

      do j = colour, ndof, 2*b + 1
         do i = max(1, j - b), min(ndof, j + b)
            bands(:, j - i, i) = u(:, i)
         end do
      end do
   end subroutine scatter

end module symsde_model_abstract
