! SPDX-License-Identifier: BSD-3-Clause
!> The equations of implicit stages in a few lanes of a block, and their fixed-point iteration
!>
!>    F_i <- Hhat_q(Q_i, P_i),   C_i <- Hhat_p(Q_i, P_i) - kappa P_i     stage after stage:
!>
!> the equations are in equations.inc, the iteration is in fixed_point.inc. Lanes that are done keep their slopes while
!> others continue, so new slopes are stored separately (hq, hp), and copied lane by lane.
!>
!> Private to its family.
module symsde_step_stages_equations
   use symsde_base_damping, only: damping_type
   use symsde_base_functionals, only: functional_set, nfunctional, path_dz, path_areas
   use symsde_base_kinds, only: wp, i8
   use symsde_base_lanes, only: slice_lanes
   use symsde_base_record, only: step_record, step_store, new_step_store
   use symsde_base_vectors, only: scale
   use symsde_model_abstract, only: model_type
   use symsde_scheme_scheme, only: scheme_type, correction_none
   use symsde_solve_fixed_point, only: take_first, take, judge_sweep, most_sweeps, done, left
   use symsde_step_hamiltonian_mass, only: constant_mass, new_constant_mass
   use symsde_step_hamiltonian_noise_shift, only: noise_shift, new_noise_shift
   use symsde_step_hamiltonian_one_step, only: one_step_hamiltonian, new_one_step_hamiltonian
   use symsde_step_stages_groups, only: stage_plan, stage_group, new_stage_plan
   use symsde_step_stages_slope_sums, only: add_slopes, sum_slopes => add_slopes, place_two
   use symsde_step_stages_sweeps_ahead, only: sweeps_ahead, new_sweeps_ahead
   implicit none
   private
   public :: stage_equations, new_stage_equations, iterate_group, solved, slow, stiff, untried

   include 'equations.inc'
   include 'fixed_point.inc'

   ! ---- parts that differ between a block and a single path ---------------------------------------

   !> Number of lanes of a part of the block.
   pure integer function lanes(self)
      class(stage_equations), intent(in) :: self

      lanes = self%ham%nlane
   end function lanes

   !> Copy weights and functionals of the lanes from `first` on, since the arrays of the block have more rows than this
   !> part. w and step point to the copies.
   subroutine take_step(self, first, step)
      type(stage_equations), intent(inout), target :: self
      integer, intent(in) :: first
      type(step_record), intent(in), target :: step
      real(wp), pointer, contiguous :: x(:, :)  ! a name that gfortran 12 recognises as contiguous
      integer :: f

      x => step%w
      call slice_lanes(size(x, 1), size(x, 2), first - 1, lanes(self), x, self%store%w)
      ! Functionals that no bracket uses have no array in the store, and are not copied.
      do f = 1, nfunctional
         if (.not. allocated(self%store%of(f)%x)) cycle
         x => step%of(f)%x
         call slice_lanes(size(x, 1), size(x, 2), first - 1, lanes(self), x, self%store%of(f)%x)
      end do
      self%store%h = step%h
      call self%store%show(0, step%t, self%shown)
      self%step => self%shown
      self%t = step%t
      self%w(1:, 0:) => self%store%w(:, :, 0)
   end subroutine take_step

   !> One sweep: for each stage of the group, in order, compute its point from the newest slopes, and F_i (and C_i)
   !> there. change and extent are the largest change and the largest slope of each lane over all stages.
   subroutine sweep_stages(self, group, sweep)
      type(stage_equations), intent(inout) :: self
      type(stage_group), intent(in) :: group
      integer, intent(in) :: sweep
      integer :: m

      associate (nlane => lanes(self), n => self%ham%ndof)
         do m = 1, group%nmember
            associate (i => group%stage(m))
               ! From the second sweep on all slopes of the group are known, and the full coefficients apply.
               call self%place(i, min(sweep, 2))
               ! F_i and C_i at the new points of all lanes; below, lanes that are done keep their old slopes.
               call self%evaluate(i, self%hq, self%hp)
               ! The first sweep has no previous slope: the change is the slope itself.
               if (sweep == 1) then
                  call take_first(nlane, n, 1.0_wp, self%hq, self%f(:, :, i), self%change)
                  if (.not. self%eliminated) call take_first(nlane, n, 1.0_wp, self%hp, self%c(:, :, i), self%change)
               else
                  call take(nlane, n, 1.0_wp, self%hq, self%last, self%f(:, :, i), self%change, self%extent)
                  if (.not. self%eliminated) &
                     call take(nlane, n, 1.0_wp, self%hp, self%last, self%c(:, :, i), self%change, self%extent)
               end if
            end associate
         end do
      end associate
   end subroutine sweep_stages

   !> Judge after a sweep which lanes are done, left, or given up: solve/fixed_point decides by change and extent of
   !> each lane. The group is not used, since the sweep has combined both over all of its stages.
   subroutine judge(self, group, sweep, too_slow, too_stiff, nrunning)
      type(stage_equations), intent(inout) :: self
      type(stage_group), intent(in) :: group
      integer, intent(in) :: sweep
      real(wp), intent(in) :: too_slow, too_stiff
      integer, intent(out) :: nrunning

      call judge_sweep(lanes(self), sweep, too_slow, too_stiff, self%change, self%extent, self%last, nrunning)
   end subroutine judge

end module symsde_step_stages_equations
