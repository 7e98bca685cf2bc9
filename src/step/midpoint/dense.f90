! SPDX-License-Identifier: BSD-3-Clause
!> The eliminated midpoint by matrices, solved across lanes: closed form for one and two unknowns, dense, banded.
!> Also by fixed-point iterations, without matrices.
!>
!> Where more unknowns are not solved at once, or two by differences of gradients, V = -f(base + (h/4) V) is iterated
!> first, in the lanes where the step is mild, by the test of step/stages/fixed_point: a few gradients cost less than
!> one matrix.
!>
!> Private to its family.
module symsde_step_midpoint_dense
   use symsde_base_kinds, only: wp, i8
   use symsde_base_traits, only: dense
   use symsde_base_vectors, only: add_times
   use symsde_model_abstract, only: model_type
   use symsde_solve_newton, only: newton_options, new_newton
   use symsde_step_midpoint_equation, only: midpoint_equation, midpoint_part, solve_by_iterations, position, &
                                            correct_pair
   use symsde_step_hamiltonian_one_step, only: one_step_hamiltonian
   use symsde_solve_fixed_point, only: take_first, take, judge_sweep, most_sweeps, stiff_rate, done
   implicit none
   private
   public :: dense_midpoint, new_dense_midpoint, solve_mildly

   type, extends(midpoint_part) :: dense_midpoint
      private
      integer, public :: band = dense
      logical, public :: iterates = .false.  !! mild steps need no matrix
      logical, public :: pairs = .false.     !! two unknowns by Newton's iteration
      real(wp), public :: too_stiff = stiff_rate  !! contraction from which a step is not mild
      real(wp), allocatable, dimension(:) :: last, change, extent  !! of that iteration (nlane)
      real(wp), allocatable :: kept(:, :)    !! V of the lanes that it solved, while others are (nlane, ndof)
      real(wp), allocatable :: q(:, :)  !! Q (nlane, ndof)
   contains
      procedure :: solve
      procedure :: iterate
      procedure :: find_force
      procedure :: linearise
   end type dense_midpoint

contains

   !> Room for nlane lanes.
   subroutine new_dense_midpoint(self, model, nlane, options)
      type(dense_midpoint), intent(out) :: self
      class(model_type), intent(in) :: model
      integer, intent(in) :: nlane
      type(newton_options), intent(in) :: options

      associate (t => model%traits, n => model%traits%ndof, b => self%band)
         b = t%bandwidth
         if (2*b + 1 >= n) b = dense
         call new_newton(self%newton, nlane, n, options, t%one_solve(b /= dense), b, b, &
                         exact=t%has_hessian_vector .or. (t%has_hessian .and. b == dense))
         allocate (self%q(nlane, n))
         self%iterates = (n > 2 .or. n == 2 .and. t%differences_alone()) .and. options%is_free() .and. &
                         .not. self%newton%affine
         self%pairs = n == 2 .and. b == dense .and. options%is_free()
         if (self%iterates) allocate (self%last(nlane), self%change(nlane), self%extent(nlane), self%kept(nlane, n))
      end associate
   end subroutine new_dense_midpoint

   !> One degree of freedom begins by one pass over the lanes that does the first iteration from V = 0, several by
   !> iterating without matrices.
   subroutine solve(self, ham, eq, w, status)
      class(dense_midpoint), intent(inout) :: self
      type(one_step_hamiltonian), intent(inout) :: ham
      type(midpoint_equation), intent(inout) :: eq
      real(wp), intent(in) :: w(eq%nlane, 0:eq%m)
      integer(i8), intent(inout) :: status(eq%nlane)

      associate (newton => self%newton, quarter => 0.25_wp*eq%h)
         if (self%iterates .and. .not. eq%for_dq) then
            call solve_mildly(self, ham, eq, w, status)
            return
         else if (eq%n > 1 .or. eq%for_dq .or. newton%options%fixed_point > 0) then
            call solve_by_iterations(self, ham, eq, w, status)
            return
         end if
         call self%linearise(ham, eq, w, eq%base(1, 1))
         call newton%first_scalar(quarter, eq%base(1, 1), eq%x, self%q, eq%stiff, status, ham%counters)
         if (eq%stiff) call eq%note_stiff_ratio(quarter*newton%a(:, 1, 1), .true.)
         do while (newton%running)
            if (newton%iteration > 1) call position(eq%nlane, eq%c, eq%base(1, 1), eq%x, self%q)
            call self%linearise(ham, eq, w, self%q)
            call newton%update_scalar(1.0_wp, quarter, eq%x, status, ham%counters)
         end do
      end associate
   end subroutine solve

   !> V by iteration without matrices; in lanes where that does not converge fast, by Newton's from V = 0.
   subroutine solve_mildly(self, ham, eq, w, status)
      class(dense_midpoint), intent(inout) :: self
      type(one_step_hamiltonian), intent(inout) :: ham
      type(midpoint_equation), intent(inout) :: eq
      real(wp), intent(in) :: w(eq%nlane, 0:eq%m)
      integer(i8), intent(inout) :: status(eq%nlane)
      integer(i8) :: outcome(eq%nlane)
      integer :: i

      call sweep_lanes(self, ham, eq, w, status)
      outcome = merge(-1_i8, status, abs(self%last - done) <= 0)
      if (.not. any(outcome == 0)) return
      self%kept = eq%x
      call solve_by_iterations(self, ham, eq, w, outcome)
      do i = 1, eq%n
         eq%x(:, i) = merge(self%kept(:, i), eq%x(:, i), outcome < 0)
      end do
      status = merge(status, outcome, outcome < 0)
      if (.not. eq%stiff) return
      eq%stiff_ratio = merge(0.0_wp, eq%stiff_ratio, outcome < 0)  ! no other lane's first matrix calls a lane stiff
      eq%stiff = any(eq%stiff_ratio > 1)
   end subroutine solve_mildly

   !> Sweeps until every lane is done or has been given up; what becomes of it stands in last.
   subroutine sweep_lanes(self, ham, eq, w, status)
      class(dense_midpoint), intent(inout) :: self
      type(one_step_hamiltonian), intent(inout) :: ham
      type(midpoint_equation), intent(inout) :: eq
      real(wp), intent(in) :: w(eq%nlane, 0:eq%m)
      integer(i8), intent(in) :: status(eq%nlane)
      real(wp), parameter :: gone = -3  ! below done: lanes that are not to be solved
      integer :: sweep, nrunning

      associate (nlane => eq%nlane, n => eq%n, c => ham%counters, force => self%newton%r)
         self%last = merge(0.0_wp, gone, status == 0)
         nrunning = count(status == 0)
         do sweep = 1, most_sweeps
            if (nrunning == 0) exit
            self%change = 0
            self%extent = 0
            if (sweep == 1) then
               call self%find_force(ham, eq, w, eq%base(1, 1), force)
               call take_first(nlane, n, -1.0_wp, force, eq%x, self%change)
            else
               call position(nlane*n, eq%c, eq%base(1, 1), eq%x, self%q)
               call self%find_force(ham, eq, w, self%q, force)
               call take(nlane, n, -1.0_wp, force, self%last, eq%x, self%change, self%extent)
            end if
            c%iterations = c%iterations + nrunning
            call judge_sweep(nlane, sweep, self%too_stiff, self%too_stiff, self%change, self%extent, self%last, &
                             nrunning)
         end do
      end associate
   end subroutine sweep_lanes

   subroutine iterate(self, ham, eq, w, status)
      class(dense_midpoint), intent(inout) :: self
      type(one_step_hamiltonian), intent(inout) :: ham
      type(midpoint_equation), intent(inout) :: eq
      real(wp), intent(in) :: w(eq%nlane, 0:eq%m)
      integer(i8), intent(inout) :: status(eq%nlane)

      associate (newton => self%newton, nlane => eq%nlane, n => eq%n)
         if (eq%starts(newton)) then
            call self%linearise(ham, eq, w, eq%base(1, 1))
            call find_stiff_ratio(self, eq)
         else
            call position(nlane*n, eq%c, eq%base(1, 1), eq%x, self%q)
            call self%linearise(ham, eq, w, self%q)
         end if
         call eq%weigh(1, n, newton%r)
         if (self%pairs) then
            call correct_pair(nlane, 0.25_wp*eq%h, newton%r, newton%a, newton%last, eq%x, newton%step, newton%size)
            call newton%judge(status, ham%counters)
         else if (n == 1) then
            call newton%update_scalar(1.0_wp, 0.25_wp*eq%h, eq%x, status, ham%counters)
         else
            call add_times(nlane*n, 1.0_wp, eq%x, newton%r)
            if (allocated(newton%a)) call matrix_dense(nlane, n, 0.25_wp*eq%h, newton%a)
            if (allocated(newton%bands)) call matrix_banded(nlane, n, self%band, 0.25_wp*eq%h, newton%bands)
            call newton%update(eq%x, status, ham%counters)
         end if
      end associate
   end subroutine iterate

   !> Force at q.
   subroutine find_force(self, ham, eq, w, q, force)
      class(dense_midpoint), intent(inout) :: self
      type(one_step_hamiltonian), intent(inout) :: ham
      type(midpoint_equation), intent(in) :: eq
      real(wp), intent(in) :: w(eq%nlane, 0:eq%m), q(eq%nlane, eq%n)
      real(wp), intent(out) :: force(eq%nlane, eq%n)

      call ham%model%gradient(eq%nlane, eq%n, eq%m, eq%t, w, q, eq%still, hq=force)
      ham%counters%gradients = ham%counters%gradients + eq%nreal
   end subroutine find_force

   !> Force and stiffness at q, in the newton's right-hand side and matrix.
   subroutine linearise(self, ham, eq, w, q)
      class(dense_midpoint), intent(inout) :: self
      type(one_step_hamiltonian), intent(inout) :: ham
      type(midpoint_equation), intent(in) :: eq
      real(wp), intent(in) :: w(eq%nlane, 0:eq%m), q(eq%nlane, eq%n)

      associate (newton => self%newton, nlane => eq%nlane, n => eq%n, m => eq%m, c => ham%counters)
         if (newton%options%fixed_point > 0) then
            call ham%model%gradient(nlane, n, m, eq%t, w, q, eq%still, hq=newton%r)
         else if (self%band == dense) then
            call ham%model%gradient_hessian(nlane, n, m, eq%t, w, q, eq%still, hq=newton%r, hqq=newton%a)
            c%hessians = c%hessians + eq%nreal
         else
            call ham%model%gradient(nlane, n, m, eq%t, w, q, eq%still, hq=newton%r)
            call ham%model%hessian_banded(nlane, n, m, self%band, eq%t, w, q, eq%still, hqq=newton%bands)
            c%hessians = c%hessians + eq%nreal
         end if
         c%gradients = c%gradients + eq%nreal
      end associate
   end subroutine linearise

   !> By the diagonals of the Hessians: where these are positive, h omega stays below 2 sqrt(ndof) in a lane
   !> that they call mild.
   subroutine find_stiff_ratio(self, eq)
      class(dense_midpoint), intent(in) :: self
      type(midpoint_equation), intent(inout) :: eq
      integer :: i

      if (self%newton%options%fixed_point > 0) return
      do i = 1, eq%n
         if (self%band == dense) then
            call eq%note_stiff_ratio(0.25_wp*eq%h*self%newton%a(:, i, i), i == 1)
         else
            call eq%note_stiff_ratio(0.25_wp*eq%h*self%newton%bands(:, 0, i), i == 1)
         end if
      end do
      eq%stiff = any(eq%stiff_ratio > 1)
   end subroutine find_stiff_ratio

   ! ---- kernels ----------------------------------------------------------------------------------

   !> I + c K in place of K
   pure subroutine matrix_dense(nlane, n, c, a)
      integer, intent(in) :: nlane, n
      real(wp), intent(in) :: c
      real(wp), intent(inout) :: a(nlane, n, n)
      integer :: i

      a = c*a
      do i = 1, n
         a(:, i, i) = a(:, i, i) + 1
      end do
   end subroutine matrix_dense

   pure subroutine matrix_banded(nlane, n, b, c, bands)
      integer, intent(in) :: nlane, n, b
      real(wp), intent(in) :: c
      real(wp), intent(inout) :: bands(nlane, -b:b, n)

      bands = c*bands
      bands(:, 0, :) = bands(:, 0, :) + 1
   end subroutine matrix_banded

end module symsde_step_midpoint_dense
