! SPDX-License-Identifier: BSD-3-Clause
!> Implicit midpoint for H = p.p/2 + U(q) with noise in position or additive: the momenta are eliminated.
!>
!>    p_{n+1} = p_n - Hhat_q(Q),   q_{n+1} = q_n + h (p_n + p_{n+1})/2 + g,   Q = (q_n + q_{n+1})/2
!>
!> ([WHSB] (82)-(83) for the synchrotron), g the constant part of Hhat_p from additive noise. The unknown
!> is V = p_{n+1} - p_n, half as many as in general:  V + Hhat_q(q_n + (h p_n + g)/2 + h V/4) = 0.
!>
!> Where a frequency is fast, (h omega)^2/4 > 1, dq = h (p_n + V/2) + g would cancel and lose h omega ulps of
!> q a step. In such lanes Newton goes on from there with dq as the unknown:
!>
!>    dq - (h p_n + g) + (h/2) Hhat_q(q_n + dq/2) = 0,   dp = 2 (dq - h p_n - g)/h
!>
!> with the same matrix. A lane is called stiff by its own first Hessian, never by its neighbours'.
module symsde_step_midpoint
   use symsde_base_kinds, only: wp, i8
   use symsde_base_traits, only: dense
   use symsde_model_abstract, only: model_type
   use symsde_scheme_scheme, only: correction_none
   use symsde_solve_newton, only: newton_type, newton_options, new_newton
   use symsde_step_one_step_hamiltonian, only: new_one_step_hamiltonian
   use symsde_step_stepper, only: stepper_type
   implicit none
   private
   public :: midpoint_stepper, new_midpoint_stepper, fits_midpoint_stepper

   type, extends(stepper_type) :: midpoint_stepper
      private
      type(newton_type) :: newton
      integer :: band = dense
      real(wp), allocatable :: base(:, :)  !! q_n + (h p_n + g)/2 (nlane, ndof)
      real(wp), allocatable :: drift(:, :) !! h p_n + g (nlane, ndof)
      real(wp), allocatable :: qs(:, :)    !! Q (nlane, ndof)
      integer(i8), allocatable :: rests(:) !! 0 in the lanes that are stiff and ok, -1 in the others (nlane)
      real(wp), allocatable :: zero(:, :)  !! p = 0, where the constant part of Hhat_p is read (nlane, ndof)
   contains
      procedure :: increment
   end type midpoint_stepper

contains

   !> Whether the elimination of the momenta is valid for this model.
   pure logical function fits_midpoint_stepper(model)
      class(model_type), intent(in) :: model

      associate (t => model%traits)
         fits_midpoint_stepper = t%identity_mass .and. (t%position_noise .or. t%additive .or. t%nnoise == 0)
      end associate
   end function fits_midpoint_stepper

   !> A midpoint stepper for blocks of nlane lanes.
   subroutine new_midpoint_stepper(self, model, nlane, options)
      type(midpoint_stepper), intent(out) :: self
      class(model_type), intent(in), target :: model
      integer, intent(in) :: nlane
      type(newton_options), intent(in) :: options
      integer :: n, b

      n = model%traits%ndof
      b = model%traits%bandwidth
      if (2*b + 1 >= n) b = dense
      self%name = 'midpoint, momenta eliminated'
      self%band = b
      call new_one_step_hamiltonian(self%ham, model, nlane, correction_none, 0.0_wp)
      call new_newton(self%newton, nlane, n, options, model%traits%one_solve(b /= dense), b, b, &
                      exact=model%traits%has_hessian_vector .or. (model%traits%has_hessian .and. b == dense))
      allocate (self%base(nlane, n), self%drift(nlane, n), self%qs(nlane, n), self%zero(nlane, n))
      allocate (self%rests(nlane), source=-1_i8)
      self%zero = 0
   end subroutine new_midpoint_stepper

   subroutine increment(self, t, w, q, p, dq, dp, status)
      class(midpoint_stepper), intent(inout) :: self
      real(wp), intent(in) :: t, w(self%ham%nlane, 0:self%ham%nnoise)
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      real(wp), intent(out) :: dq(self%ham%nlane, self%ham%ndof), dp(self%ham%nlane, self%ham%ndof)
      integer(i8), intent(inout) :: status(self%ham%nlane)
      real(wp) :: h, tm
      integer :: nstiff
      logical :: shifted

      associate (nlane => self%ham%nlane, n => self%ham%ndof, newton => self%newton)
         h = w(1, 0)
         tm = t + 0.5_wp*h
         shifted = .not. self%ham%model%traits%position_noise .and. self%ham%nnoise > 0
         if (shifted) then
            call self%ham%gradient(tm, w, q, self%zero, hp=dp)
            call free_flight_with_shift(nlane*n, h, p, q, dp, self%drift, self%base)
         else
            call free_flight(nlane*n, h, p, q, self%base)
         end if
         if (n == 1 .and. newton%options%fixed_point == 0) then
            call solve_one(self, h, tm, w, p, dp, nstiff, status)
         else
            call solve_many(self, h, tm, w, p, dp, nstiff, status)
         end if
         if (shifted) then
            call position_increment_with_shift(nlane*n, h, self%drift, dp, dq)
         else
            call position_increment(nlane*n, h, p, dp, dq)
         end if
      end associate
      if (nstiff == 0) return
      if (.not. shifted) self%drift = h*p
      call solve_stiff(self, h, tm, w, q, p, dq, dp, status)
   end subroutine increment

   !> Newton for V, one degree of freedom.
   subroutine solve_one(self, h, tm, w, p, v, nstiff, status)
      type(midpoint_stepper), intent(inout) :: self
      real(wp), intent(in) :: h, tm, w(self%ham%nlane, 0:self%ham%nnoise), p(self%ham%nlane, 1)
      real(wp), intent(out) :: v(self%ham%nlane, 1)
      integer, intent(out) :: nstiff
      integer(i8), intent(inout) :: status(self%ham%nlane)
      logical :: steep

      nstiff = 0
      associate (newton => self%newton)
         call self%ham%gradient_hessian(tm, w, self%base, p, hq=newton%r, hqq=newton%a)
         call newton%first_scalar(0.25_wp*h, self%base, v, self%qs, steep, status, self%ham%counters)
         if (steep) call find_stiff(self, h, nstiff)
         do while (newton%running)
            if (newton%iteration > 1) call position(self%ham%nlane, h, self%base, v, self%qs)
            call self%ham%gradient_hessian(tm, w, self%qs, p, hq=newton%r, hqq=newton%a)
            call newton%update_scalar(1.0_wp, 0.25_wp*h, v, status, self%ham%counters)
         end do
      end associate
   end subroutine solve_one

   !> Newton for V, or a fixed number of iterations.
   subroutine solve_many(self, h, tm, w, p, v, nstiff, status)
      type(midpoint_stepper), intent(inout) :: self
      real(wp), intent(in) :: h, tm, w(self%ham%nlane, 0:self%ham%nnoise), p(self%ham%nlane, self%ham%ndof)
      real(wp), intent(out) :: v(self%ham%nlane, self%ham%ndof)
      integer, intent(out) :: nstiff
      integer(i8), intent(inout) :: status(self%ham%nlane)

      nstiff = 0
      v = 0
      associate (nlane => self%ham%nlane, n => self%ham%ndof, newton => self%newton)
         call newton%start(status)
         do while (newton%running)
            call position(nlane*n, h, self%base, v, self%qs)
            call linearise(self, h, tm, w, p, v)
            if (newton%iteration == 0 .and. newton%options%fixed_point == 0) call find_stiff(self, h, nstiff)
            if (n == 1) then
               call newton%update_scalar(1.0_wp, 0.25_wp*h, v, status, self%ham%counters)
            else
               call newton%update(v, status, self%ham%counters)
            end if
         end do
      end associate
   end subroutine solve_many

   !> Which lanes are stiff, by the diagonal of the matrix of the first iteration.
   subroutine find_stiff(self, h, nstiff)
      type(midpoint_stepper), intent(inout) :: self
      real(wp), intent(in) :: h
      integer, intent(out) :: nstiff
      integer :: i

      associate (nlane => self%ham%nlane, n => self%ham%ndof, newton => self%newton)
         self%rests = -1
         if (n == 1) then
            call mark_stiff(nlane, 0.0_wp, 0.25_wp*h, newton%a(:, 1, 1), self%rests)
         else if (self%band == dense) then
            do i = 1, n
               call mark_stiff(nlane, 1.0_wp, 1.0_wp, newton%a(:, i, i), self%rests)
            end do
         else
            do i = 1, n
               call mark_stiff(nlane, 1.0_wp, 1.0_wp, newton%bands(:, 0, i), self%rests)
            end do
         end if
         nstiff = count(self%rests == 0)
      end associate
   end subroutine find_stiff

   !> Newton for dq in the stiff lanes, from what V gave.
   subroutine solve_stiff(self, h, tm, w, q, p, dq, dp, status)
      type(midpoint_stepper), intent(inout) :: self
      real(wp), intent(in) :: h, tm, w(self%ham%nlane, 0:self%ham%nnoise)
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      real(wp), intent(inout) :: dq(self%ham%nlane, self%ham%ndof), dp(self%ham%nlane, self%ham%ndof)
      integer(i8), intent(inout) :: status(self%ham%nlane)

      associate (nlane => self%ham%nlane, n => self%ham%ndof, newton => self%newton)
         where (status /= 0) self%rests = -1
         call newton%start(self%rests)
         do while (newton%running)
            call halfway(nlane*n, q, dq, self%qs)
            call linearise(self, h, tm, w, p, self%zero)
            call position_residual(nlane*n, h, self%drift, newton%r)
            if (n == 1) then
               call newton%update_scalar(1.0_wp, 0.25_wp*h, dq, self%rests, self%ham%counters)
            else
               newton%r = dq + newton%r
               call newton%update(dq, self%rests, self%ham%counters)
            end if
         end do
         call take_stiff(nlane, n, h, self%rests, self%drift, dq, dp)
         where (self%rests > 0) status = self%rests
      end associate
   end subroutine solve_stiff

   !> Residual V + Hhat_q(Q) and matrix I + (h/4) Hhat_qq(Q).
   subroutine linearise(self, h, tm, w, p, v)
      type(midpoint_stepper), intent(inout) :: self
      real(wp), intent(in) :: h, tm, w(self%ham%nlane, 0:self%ham%nnoise)
      real(wp), intent(in) :: p(self%ham%nlane, self%ham%ndof), v(self%ham%nlane, self%ham%ndof)

      associate (nlane => self%ham%nlane, n => self%ham%ndof, newton => self%newton)
         if (newton%options%fixed_point > 0) then
            call self%ham%gradient(tm, w, self%qs, p, hq=newton%r)
         else if (self%band == dense) then
            call self%ham%gradient_hessian(tm, w, self%qs, p, hq=newton%r, hqq=newton%a)
            if (n == 1) return  ! the scalar update takes force and slope as they are
            call matrix_dense(nlane, n, h, newton%a)
         else
            call self%ham%gradient_hessian_banded(self%band, tm, w, self%qs, p, hq=newton%r, hqq=newton%bands)
            call matrix_banded(nlane, n, self%band, h, newton%bands)
         end if
         if (n > 1) call residual(nlane*n, v, newton%r)
      end associate
   end subroutine linearise

   ! ---- kernels ----------------------------------------------------------------------------------

   !> VEC
   pure subroutine free_flight(n, h, p, q, base)
      integer, intent(in) :: n
      real(wp), intent(in) :: h, p(n), q(n)
      real(wp), intent(out) :: base(n)
      integer :: i

      do i = 1, n
         base(i) = q(i) + 0.5_wp*(h*p(i))
      end do
   end subroutine free_flight

   !> VEC
   pure subroutine free_flight_with_shift(n, h, p, q, g, drift, base)
      integer, intent(in) :: n
      real(wp), intent(in) :: h, p(n), q(n), g(n)
      real(wp), intent(out) :: drift(n), base(n)
      integer :: i

      do i = 1, n
         drift(i) = h*p(i) + g(i)
         base(i) = q(i) + 0.5_wp*drift(i)
      end do
   end subroutine free_flight_with_shift

   !> VEC Q = base + h V/4
   pure subroutine position(n, h, base, v, qs)
      integer, intent(in) :: n
      real(wp), intent(in) :: h, base(n), v(n)
      real(wp), intent(out) :: qs(n)
      integer :: i

      do i = 1, n
         qs(i) = base(i) + 0.25_wp*h*v(i)
      end do
   end subroutine position

   !> VEC
   pure subroutine residual(n, v, r)
      integer, intent(in) :: n
      real(wp), intent(in) :: v(n)
      real(wp), intent(inout) :: r(n)
      integer :: i

      do i = 1, n
         r(i) = v(i) + r(i)
      end do
   end subroutine residual

   !> VEC dq = h (p + dp/2)
   pure subroutine position_increment(n, h, p, dp, dq)
      integer, intent(in) :: n
      real(wp), intent(in) :: h, p(n), dp(n)
      real(wp), intent(out) :: dq(n)
      integer :: i

      do i = 1, n
         dq(i) = h*(p(i) + 0.5_wp*dp(i))
      end do
   end subroutine position_increment

   !> VEC dq = h (p + dp/2) + g
   pure subroutine position_increment_with_shift(n, h, drift, dp, dq)
      integer, intent(in) :: n
      real(wp), intent(in) :: h, drift(n), dp(n)
      real(wp), intent(out) :: dq(n)
      integer :: i

      do i = 1, n
         dq(i) = drift(i) + 0.5_wp*h*dp(i)
      end do
   end subroutine position_increment_with_shift

   !> rests = 0 where offset is exceeded by scale*slope by more than one: (h omega)^2/4 > 1.
   pure subroutine mark_stiff(nlane, offset, scale, slope, rests)
      integer, intent(in) :: nlane
      real(wp), intent(in) :: offset, scale, slope(nlane)
      integer(i8), intent(inout) :: rests(nlane)
      integer :: lane

      do lane = 1, nlane
         rests(lane) = merge(0_i8, rests(lane), scale*slope(lane) - offset > 1)
      end do
   end subroutine mark_stiff

   !> Q = q + dq/2
   pure subroutine halfway(n, q, dq, qs)
      integer, intent(in) :: n
      real(wp), intent(in) :: q(n), dq(n)
      real(wp), intent(out) :: qs(n)
      integer :: i

      do i = 1, n
         qs(i) = q(i) + 0.5_wp*dq(i)
      end do
   end subroutine halfway

   !> (h/2) Hhat_q - (h p + g), from Hhat_q in r.
   pure subroutine position_residual(n, h, drift, r)
      integer, intent(in) :: n
      real(wp), intent(in) :: h, drift(n)
      real(wp), intent(inout) :: r(n)
      integer :: i

      do i = 1, n
         r(i) = 0.5_wp*h*r(i) - drift(i)
      end do
   end subroutine position_residual

   !> dp = 2 (dq - drift)/h in the lanes that were solved for dq.
   pure subroutine take_stiff(nlane, n, h, rests, drift, dq, dp)
      integer, intent(in) :: nlane, n
      real(wp), intent(in) :: h, drift(nlane, n), dq(nlane, n)
      integer(i8), intent(in) :: rests(nlane)
      real(wp), intent(inout) :: dp(nlane, n)
      integer :: lane, i

      do i = 1, n
         do lane = 1, nlane
            dp(lane, i) = merge(2*(dq(lane, i) - drift(lane, i))/h, dp(lane, i), rests(lane) == 0)
         end do
      end do
   end subroutine take_stiff

   pure subroutine matrix_dense(nlane, n, h, a)
      integer, intent(in) :: nlane, n
      real(wp), intent(in) :: h
      real(wp), intent(inout) :: a(nlane, n, n)  !! Hessian in, matrix out
      integer :: i

      a = 0.25_wp*h*a
      do i = 1, n
         a(:, i, i) = a(:, i, i) + 1
      end do
   end subroutine matrix_dense

   pure subroutine matrix_banded(nlane, n, b, h, bands)
      integer, intent(in) :: nlane, n, b
      real(wp), intent(in) :: h
      real(wp), intent(inout) :: bands(nlane, -b:b, n)  !! Hessian in, matrix out

      bands = 0.25_wp*h*bands
      bands(:, 0, :) = bands(:, 0, :) + 1
   end subroutine matrix_banded

end module symsde_step_midpoint
