! SPDX-License-Identifier: BSD-3-Clause
!> The steps of step/explicit/lone_tableau with one degree of freedom whose model has terms: nothing else is asked of
!> it, and no number leaves the registers but through the terms.
module symsde_step_explicit_lone_swing
   use symsde_base_kinds, only: wp
   use symsde_base_sincos, only: sincos_one
   use symsde_base_traits, only: model_traits
   use symsde_model_abstract, only: angle_terms
   use symsde_step_explicit_evaluation_order, only: evaluation_order, to_q, to_p
   use symsde_step_lone, only: few_of
   use symsde_step_explicit_lone_tableau, only: lone_explicit, kick_drift, drift_kick, kick_drift_kick, &
                                                drift_kick_drift, two_slopes, by_plan
   implicit none
   private
   public :: lone_swing, new_lone_explicit

   type, extends(lone_explicit) :: lone_swing
      logical :: ito = .false.   !! one slope has an Ito drift
      type(angle_terms), allocatable, private :: noises(:)  !! of each H_k by itself (m)
   contains
      procedure :: take
   end type lone_swing

contains

   !> Steps of a kind for models with such traits: by terms where there are any.
   subroutine new_lone_explicit(self, kind, traits, plan)
      class(lone_explicit), allocatable, intent(out) :: self
      integer, intent(in) :: kind
      type(model_traits), intent(in) :: traits
      type(evaluation_order), intent(in), optional :: plan  !! none: one slope
      type(lone_swing), allocatable :: swing

      if (traits%has_angle_terms .or. traits%has_linear_terms) then
         allocate (swing)
         swing%ito = .not. traits%correction_vanishes()
         swing%most = merge(4, 2, traits%autonomous)  ! one more takes 1.15 to 1.2 of the time
         call move_alloc(swing, self)
      else
         allocate (self)
         self%most = few_of(traits%ndof, merge(3, 2, traits%ndof > 1), 6)
      end if
      self%kind = kind
      self%ngradient = 1
      if (.not. present(plan)) return
      self%plan = plan
      self%ngradient = size(plan%order)
      self%shares = size(plan%order) == 3  ! with one force
      self%c(:min(2, plan%nstage)) = plan%c(:min(2, plan%nstage))
   end subroutine new_lone_explicit

   subroutine take(self, t, h, w, q, p, dq, dp, taken)
      class(lone_swing), intent(inout) :: self
      real(wp), intent(in) :: t, h, w(0:self%m), q(self%n), p(self%n)
      real(wp), intent(out) :: dq(self%n), dp(self%n)
      logical, intent(out) :: taken

      taken = .true.
      self%counters%gradients = self%counters%gradients + self%ngradient
      if (self%kind == by_plan) then
         if (.not. allocated(self%f)) allocate (self%f(1, self%plan%nstage), self%v(1, self%plan%nstage))
         call follow(self, self%plan, t, h, w, q(1), p(1), self%f, self%v, dq(1), dp(1))
      else
         call swing(self, t, h, w, q(1), p(1), dq(1), dp(1))
      end if
   end subroutine take

   !> What one step adds to q and p.
   subroutine swing(self, t, h, w, q, p, dq, dp)
      type(lone_swing), intent(inout) :: self
      real(wp), intent(in) :: t, h, w(0:self%m)
      real(wp), value :: q, p
      real(wp), intent(out) :: dq, dp
      type(angle_terms) :: terms
      real(wp) :: f, second, v, x, y, sine, cosine
      logical :: moves  ! the terms do, with time

      moves = .not. self%model%traits%autonomous
      call self%model%angle(self%m, t + self%c(1)*h, w, terms)
      select case (self%kind)
      case (kick_drift)
         call find_force(self, terms, q, sine, cosine, f)
         dp = -f
         dq = terms%e*(p - f) + terms%f
      case (drift_kick)
         dq = terms%e*p + terms%f
         call find_force(self, terms, q + dq, sine, cosine, f)
         dp = -f
      case (kick_drift_kick)
         call find_force(self, terms, q, sine, cosine, f)
         y = p - 0.5_wp*f
         v = terms%e*y + terms%f
         if (moves) call self%model%angle(self%m, t + self%c(2)*h, w, terms)
         second = terms%e*y + terms%f
         x = q + 0.5_wp*v
         x = x + 0.5_wp*second
         dq = 0.5_wp*v + 0.5_wp*second
         dp = -0.5_wp*f
         call find_force(self, terms, x, sine, cosine, f)
         dp = dp - 0.5_wp*f
      case (drift_kick_drift)
         v = terms%e*p + terms%f
         x = q + 0.5_wp*v
         call find_force(self, terms, x, sine, cosine, f)
         if (self%shares) then
            y = p - f
            dp = -f
         else
            call self%model%angle(self%m, t + self%c(2)*h, w, terms)
            second = terms%a*sine + (terms%b*cosine + (terms%c*x + terms%d))
            y = p - 0.5_wp*f
            y = y - 0.5_wp*second
            dp = -0.5_wp*f - 0.5_wp*second
         end if
         dq = 0.5_wp*v + 0.5_wp*(terms%e*y + terms%f)
      case (two_slopes)
         call find_force(self, terms, q, sine, cosine, f)
         v = terms%e*p + terms%f
         x = q + v
         y = p - f
         if (moves) call self%model%angle(self%m, t + self%c(2)*h, w, terms)
         call find_force(self, terms, x, sine, cosine, second)
         dq = 0.5_wp*v + 0.5_wp*(terms%e*y + terms%f)
         dp = -0.5_wp*f - 0.5_wp*second
      case default
         call find_force(self, terms, q, sine, cosine, f)
         dq = terms%e*p + terms%f
         dp = 0.0_wp - f
         if (self%ito) call add_ito_drift(self, t, 0.5_wp*abs(h), q, p, sine, cosine, dq, dp)
      end select
   end subroutine swing

   !> The same by the plan.
   subroutine follow(self, plan, t, h, w, q, p, f, v, dq, dp)
      type(lone_swing), intent(inout) :: self
      type(evaluation_order), intent(in) :: plan
      real(wp), intent(in) :: t, h, w(0:self%m)
      real(wp), value :: q, p
      real(wp), intent(inout), dimension(plan%nstage) :: f, v  !! room
      real(wp), intent(out) :: dq, dp
      type(angle_terms) :: terms
      real(wp) :: sine, cosine
      integer :: i, k

      do k = 1, size(plan%order)
         i = plan%order(k)%stage
         if (k == 1 .or. .not. self%model%traits%autonomous) call self%model%angle(self%m, t + plan%c(i)*h, w, terms)
         if (plan%order(k)%force) call find_force(self, terms, sum_of(plan, to_q, i, v, q), sine, cosine, f(i))
         if (plan%order(k)%velocity) v(i) = terms%e*sum_of(plan, to_p, i, f, p) + terms%f
      end do
      dq = sum_of(plan, to_q, 0, v)
      dp = sum_of(plan, to_p, 0, f)
   end subroutine follow

   !> One number of add_slopes (step/explicit/evaluation_order).
   pure real(wp) function sum_of(plan, kind, k, slope, start) result(total)
      type(evaluation_order), intent(in) :: plan
      integer, intent(in) :: kind, k
      real(wp), intent(in) :: slope(plan%nstage)
      real(wp), intent(in), optional :: start
      integer :: j, first

      associate (stage => plan%stage(:, k, kind), c => plan%weight(:, k, kind))
         first = merge(1, 2, present(start))
         if (present(start)) then
            total = start
         else
            total = (c(1)*slope(stage(1)))
         end if
         !GCC$ novector
         do j = first, plan%many(k, kind)
            total = total + c(j)*slope(stage(j))
         end do
      end associate
   end function sum_of

   !> Hhat_q, and the sine and the cosine of an angle; of what is none they have no weight.
   subroutine find_force(self, terms, x, sine, cosine, f)
      type(lone_swing), intent(in) :: self
      type(angle_terms), intent(in) :: terms
      real(wp), value :: x
      real(wp), intent(out) :: sine, cosine, f

      if (self%model%traits%has_angle_terms) then
         sine = sincos_one(x, cosine)
         f = terms%a*sine + (terms%b*cosine + (terms%c*x + terms%d))
      else
         sine = 0
         cosine = 0
         f = terms%c*x + terms%d
      end if
   end subroutine find_force

   !> half sum_k (u_p, -u_q) with u = Hess H_k (H_{k,p}, -H_{k,q}), from the terms of each H_k.
   subroutine add_ito_drift(self, t, half, q, p, sine, cosine, dq, dp)
      type(lone_swing), intent(inout) :: self
      real(wp), intent(in) :: t, half, q, p, sine, cosine
      real(wp), intent(inout) :: dq, dp
      real(wp) :: force, velocity
      integer :: k

      if (.not. allocated(self%noises)) call find_noises(self, t)
      do k = 1, self%m
         associate (of => self%noises(k))
            force = of%a*sine + (of%b*cosine + (of%c*q + of%d))
            velocity = of%e*p + of%f
            dq = dq - half*(of%e*force)
            dp = dp - half*((of%a*cosine + (of%c - of%b*sine))*velocity)
         end associate
      end do
      self%counters%gradients = self%counters%gradients + self%m
      self%counters%hessians = self%counters%hessians + self%m
   end subroutine add_ito_drift

   !> The terms of each noise, which do not depend on time: of noise in position, which might, there is no Ito drift.
   subroutine find_noises(self, t)
      type(lone_swing), intent(inout) :: self
      real(wp), intent(in) :: t
      real(wp) :: unit(0:self%m)
      integer :: k

      allocate (self%noises(self%m))
      do k = 1, self%m
         unit = 0
         unit(k) = 1
         call self%model%angle(self%m, t, unit, self%noises(k))
      end do
   end subroutine find_noises

end module symsde_step_explicit_lone_swing
