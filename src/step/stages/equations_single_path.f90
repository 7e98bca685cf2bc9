! SPDX-License-Identifier: BSD-3-Clause
!> The equations of implicit stages for a single path, and their fixed-point iteration: equations.inc and
!> fixed_point.inc with one lane, F_i <- Hhat_q(Q_i, P_i) and C_i <- Hhat_p(Q_i, P_i) - kappa P_i stage after stage.
!>
!> Nothing is copied that a single lane does not need: the step is used through pointers, the model writes new slopes
!> over the old ones, and a sweep is judged once, at its end, against the slopes kept in `was`. Sums include the slopes
!> of all stages: unknown slopes are zero, and irrelevant slopes have the coefficient zero.
!>
!> Private to its family.
module symsde_step_stages_equations_single_path
   use symsde_base_damping, only: damping_type
   use symsde_base_functionals, only: functional_set, path_dz, path_areas
   use symsde_base_kinds, only: wp, i8
   use symsde_base_lanes, only: slice_lanes
   use symsde_base_record, only: step_record, step_store, new_step_store
   use symsde_base_vectors, only: scale
   use symsde_model_abstract, only: model_type
   use symsde_scheme_scheme, only: scheme_type, correction_none
   use symsde_solve_fixed_point_single_path, only: take_alone, sweep_verdict, most_sweeps, done, left
   use symsde_step_hamiltonian_mass, only: constant_mass, new_constant_mass
   use symsde_step_hamiltonian_noise_shift, only: noise_shift, new_noise_shift
   use symsde_step_hamiltonian_one_step, only: one_step_hamiltonian, new_one_step_hamiltonian
   use symsde_step_stages_groups, only: stage_plan, stage_group, new_stage_plan
   use symsde_step_stages_slope_sums, only: add_slopes, sum_slopes => weigh_slopes, place_two
   use symsde_step_stages_sweeps_ahead, only: sweeps_ahead, new_sweeps_ahead
   implicit none
   private
   public :: stage_equations, new_stage_equations, iterate_group, solved, slow, stiff, untried

   include 'equations.inc'
   include 'fixed_point.inc'

   ! ---- parts that differ between a single path and a block ---------------------------------------

   !> One lane, which the compiler knows.
   pure integer function lanes(self)
      class(stage_equations), intent(in) :: self

      lanes = 1
   end function lanes

   !> Point to weights and functionals of the path. Its slopes are set to zero, because weigh_slopes adds all of them:
   !> an old slope that is NaN would spoil the sum even with coefficient zero.
   subroutine take_step(self, first, step)
      type(stage_equations), intent(inout) :: self
      integer, intent(in) :: first
      type(step_record), intent(in), target :: step

      ! Neither weights nor functionals are copied: the record lives as long as the step.
      self%step => step
      self%t = step%t
      self%w => step%w
      call set_zero(size(self%f), self%f)
      if (.not. self%eliminated) call set_zero(size(self%c), self%c)
   end subroutine take_step

   !> x = 0 for n numbers of any shape: slopes of all stages as one vector.
   pure subroutine set_zero(n, x)
      integer, intent(in) :: n
      real(wp), intent(out) :: x(n)

      x = 0
   end subroutine set_zero

   !> One sweep: the new slopes of the group's stages, each written over the old one, which `judge` has kept in `was`. A
   !> path that is done takes no further sweep, so that nothing must be preserved.
   subroutine sweep_stages(self, group, sweep)
      type(stage_equations), intent(inout) :: self
      type(stage_group), intent(in) :: group
      integer, intent(in) :: sweep
      integer :: m

      associate (s => group%nmember, n => self%ham%ndof, c => self%ham%counters)
         ! b has the coefficients of the first sweep or of later ones. C is no unknown in this case.
         if (self%eliminated .and. .not. allocated(self%mass)) then
            call sweep_positions(self%ham, n, self%plan%nstage, self%ham%nnoise, s, group%stage, self%times, &
                                 self%w, self%p, self%b(:, :, min(sweep, 2)), self%base, self%qs, self%f)
            c%gradients = c%gradients + s
            return
         end if
         ! If momenta are not eliminated, or there is a mass, points are computed and evaluated as in a block.
         do m = 1, s
            associate (i => group%stage(m))
               ! The newest slopes of this sweep are used immediately.
               call self%place(i, min(sweep, 2))
               if (self%eliminated) then
                  call self%evaluate(i, self%f(:, :, i))
               else
                  call self%evaluate(i, self%f(:, :, i), self%c(:, :, i))
               end if
            end associate
         end do
      end associate
   end subroutine sweep_stages

   !> `place` and `evaluate` for every stage of a group, if momenta are eliminated by an identity mass. All data are
   !> arguments of known shape, with b(:, i) = -kappa B_ik of stage i, so that gcc keeps them in registers.
   subroutine sweep_positions(ham, n, s, m, nmember, stage, times, w, p, b, base, x, f)
      type(one_step_hamiltonian), intent(in) :: ham
      integer, intent(in) :: n, s, m, nmember, stage(nmember)
      real(wp), intent(in) :: times(s), w(0:m), p(n), b(s, s), base(n, s)
      real(wp), intent(inout) :: x(n), f(n, s)
      integer :: k, i

      do k = 1, nmember
         i = stage(k)
         ! Q_i, and the new F_i, which replaces the old one.
         call sum_slopes(n, s, i, b(1, i), f, base(1, i), x)
         call ham%bare_gradient(1, times(i), w, x, p, hq=f(1, i))
      end do
   end subroutine sweep_positions

   !> Judge whether the path is done after a sweep, left, or given up. The largest change is over all slopes of the
   !> group, against those in `was`, which are then updated. Stages with consecutive numbers are contiguous in memory,
   !> and are compared with their last slopes as one vector.
   subroutine judge(self, group, sweep, too_slow, too_stiff, nrunning)
      type(stage_equations), intent(inout) :: self
      type(stage_group), intent(in) :: group
      integer, intent(in) :: sweep
      real(wp), intent(in) :: too_slow, too_stiff
      integer, intent(out) :: nrunning
      integer :: m, together

      ! `together` is how many stages are compared as one vector: all of the group, or one.
      associate (n => self%ham%ndof, s => group%nmember, d => self%change(1), x => self%extent(1))
         together = merge(s, 1, group%stage(s) - group%stage(1) == s - 1)
         do m = 1, s, together
            associate (i => group%stage(m))
               call take_alone(n*together, sweep == 1, self%f(1, 1, i), self%was(1, i, 1), d, x)
               if (.not. self%eliminated) &
                  call take_alone(n*together, sweep == 1, self%c(1, 1, i), self%was(1, i, 2), d, x)
            end associate
         end do
         self%last(1) = sweep_verdict(sweep, too_slow, too_stiff, d, x, self%last(1))
      end associate
      ! The one lane is running, or `last` shows how it has ended.
      nrunning = merge(1, 0, self%last(1) >= 0)
   end subroutine judge

end module symsde_step_stages_equations_single_path
