! SPDX-License-Identifier: BSD-3-Clause
!> An upper bound of the memory of a step, computed from scheme and traits before anything is allocated.
!>
!> With n degrees of freedom, m noises, s stages and 2 n s unknowns a block of nlane lanes holds, in numbers of eight
!> bytes, at most
!>
!>    nlane lane + once + rescue,
!>    lane   = (60 + 16 s) n + (14 + 2 s) (m + 1) + a small matrix,  and what the solver needs:
!>             dense         unknowns^2 + 6 n^2
!>             banded        12 ((b + 1) s + 1) unknowns + 6 (2 b + 1) n   with b diagonals beside the main one
!>             by products   66 unknowns + 65^2
!>
!> Stages count twice if noise has its own coefficients. These are upper bounds: vectors of the system's size, and for
!> each lane of an implicit scheme the matrix of its unknowns, dense or by bands, with the blocks of the Hessian. They
!> are derived from the allocations of the modules of each family: a new array there may require a larger number here.
!> tests/python/test_memory.py runs models and schemes under a limit of memory and detects a bound that is too low; a
!> bound that is too high refuses large systems unnecessarily.
module symsde_step_memory
   use symsde_base_damping, only: damping_type
   use symsde_base_kinds, only: wp
   use symsde_base_lanes, only: lane_unit
   use symsde_base_status, only: error_type
   use symsde_base_supports, only: noise_pairs
   use symsde_base_traits, only: model_traits
   use symsde_scheme_catalogue, only: get_scheme
   use symsde_scheme_kicks, only: flow_midpoint
   use symsde_scheme_scheme, only: scheme_type, bracket_terms, galerkin_form, ito_form, splitting_form, &
                                   frame_none
   use symsde_step_explicit_tableau, only: explicit_fits
   use symsde_step_hamiltonian_brackets, only: active_brackets
   use symsde_step_implicit_newton_krylov, only: pays_by_products
   use symsde_step_open_damped, only: damped_fits
   use symsde_step_stages_forced, only: forced_stages_fit
   use symsde_step_stages_stepper, only: fits_stages
   use symsde_step_stepper, only: stepper_task
   implicit none
   private
   public :: step_memory, find_step_memory

   !> Numbers of eight bytes that a stepper holds at most, as reals, since their squares exceed integers.
   type :: step_memory
      real(wp) :: lane = 0     !! numbers for each lane
      real(wp) :: once = 0     !! numbers for the one lane that is solved alone
      real(wp) :: rescue = 0   !! numbers to try failed lanes again
   contains
      procedure :: numbers
   end type step_memory

   integer, parameter :: vectors = 60            !! most vectors of the length of q in a lane
   integer, parameter :: small_matrix = 2048     !! most numbers of a small matrix in elimination
   integer, parameter :: krylov_vectors = 65     !! vectors of GMRES
   integer, parameter :: most_legs = 4           !! drifts of a step, each with three matrices of friction
   integer, parameter :: most_rescued = 512      !! unknowns up to which failed lanes are tried again

contains

   !> Find the largest memory of the steppers of a task, with the memory of a call of the model. Recursive, since
   !> the drift of a splitting may be a midpoint step, with its own stepper.
   recursive subroutine find_step_memory(task, memory)
      type(stepper_task), intent(in) :: task
      type(step_memory), intent(out) :: memory
      type(step_memory) :: more
      type(bracket_terms) :: active
      type(scheme_type), target :: midpoint
      type(stepper_task) :: flow
      type(error_type), allocatable :: error
      real(wp) :: n, m, stages, unknowns

      associate (t => task%model%traits, scheme => task%scheme)
         n = t%ndof
         m = t%nnoise
         stages = scheme%nstage
         ! Slopes of drift and noise are kept apart.
         if (.not. scheme%noise_coefficients_equal() .and. m > 0) stages = 2*stages
         active = active_brackets(scheme%brackets, t)
         memory%lane = (vectors + 16*stages)*n + (14 + 2*stages)*(m + 1) + small_matrix
         ! One area A_kl for every pair of noises.
         if (active%areas) memory%lane = memory%lane + m*(m - 1)/2
         if (t%bandwidth < 0 .and. t%has_hessian .and. .not. t%has_hessian_vector) &
            memory%lane = memory%lane + 3*n**2  ! blocks of the Hessian, from which products are computed
         if (allocated(task%damping%friction)) memory%once = memory%once + (3*most_legs + 8)*n**2
         if (.not. task%damping%is_constant()) memory%lane = memory%lane + 6*n  ! rates at three nodes, and two states
         if (scheme%form == splitting_form) then  ! it has no separate oracle
            if (.not. t%noise_is_constant() .and. scheme%kicks%samples) &
               memory%lane = memory%lane + meetings(t)  ! D_kl
         else if (task%general .or. active%are_added() .or. .not. (scheme%form == ito_form .or. task%follows)) then
            call add_matrices(task, active%are_added(), stages, memory)
         end if
         unknowns = 2*n*stages
         if (scheme%form == splitting_form .and. scheme%kicks%flow == flow_midpoint) then  ! which has its own stepper
            call get_scheme(midpoint, 'midpoint', error)
            flow = task
            flow%scheme => midpoint
            call find_step_memory(flow, more)
            memory = step_memory(memory%lane + more%lane, memory%once + more%once, more%rescue)
         else if (unknowns <= most_rescued .and. task%newton%fixed_point == 0 .and. &
                  (task%general .or. .not. explicit_fits(task))) then  ! a general stepper of eight lanes
            memory%rescue = lane_unit*(unknowns**2 + 6*n**2 + 8*unknowns) + 2*unknowns**2
         end if
      end associate
   end subroutine find_step_memory

   !> Number of pairs of noises k <= l that meet.
   pure real(wp) function meetings(traits)
      type(model_traits), intent(in) :: traits
      type(noise_pairs) :: pairs

      call traits%find_meetings(pairs)
      meetings = 0.5_wp*traits%nnoise*(traits%nnoise + 1.0_wp)
      if (allocated(pairs%k)) meetings = size(pairs%k)
   end function meetings

   !> Numbers of eight bytes that a stepper of nlane lanes and its rescue hold.
   pure real(wp) function numbers(self, nlane)
      class(step_memory), intent(in) :: self
      integer, intent(in) :: nlane

      numbers = nlane*self%lane + self%once + self%rescue
   end function numbers

   !> Add the matrices of an implicit step: of every lane, and of the one lane that is solved alone. If by_parts, a
   !> special stepper takes the step, which may keep bands or use products; the oracle has a dense matrix. The cases are
   !> those of the header: fewer unknowns of a Galerkin scheme, bands, products, else dense matrices.
   subroutine add_matrices(task, brackets, stages, memory)
      type(stepper_task), intent(in) :: task
      logical, intent(in) :: brackets    !! whether brackets are added to the Hamiltonian
      real(wp), intent(in) :: stages     !! stages of drift and noise together
      type(step_memory), intent(inout) :: memory
      real(wp) :: n, b, unknowns
      type(damping_type) :: damping
      logical :: by_parts

      associate (t => task%model%traits, scheme => task%scheme, lane => memory%lane, once => memory%once)
         n = t%ndof
         b = t%reach()
         unknowns = 2*n*stages
         ! Whether the factory would choose a special stepper: stages, midpoint, or the stepper of a frame.
         damping = task%damping
         if (damped_fits(task)) damping = damping_type()  ! the closed system's step stands between decays
         by_parts = fits_stages(task%model, scheme, task%newton, damping) .and. &
                    (brackets .or. .not. abs(scheme%correction_coefficient()) > 0 .or. t%correction_vanishes())
         by_parts = .not. task%general .and. (by_parts .or. forced_stages_fit(task) .or. &
                                              scheme%is_midpoint() .and. .not. brackets .or. &
                                              scheme%needs%additive .or. scheme%frame /= frame_none)
         if (scheme%form == galerkin_form) then
            unknowns = (scheme%nstage + scheme%degree)*n
         else if (by_parts .and. b >= 0 .and. 2*b + 1 < n) then
            lane = lane + 12*((b + 1)*stages + 1)*unknowns + 6*(2*b + 1)*n
            once = once + (6*(b + 1)*stages + 8)*unknowns
            return
         else if (by_parts .and. pays_by_products(t, t%ndof) .and. task%newton%fixed_point == 0) then
            lane = lane + krylov_vectors*(unknowns + krylov_vectors) + unknowns
            return
         end if
         lane = lane + 6*n**2
         ! Sweeps form no matrix of the unknowns.
         if (task%newton%fixed_point > 0) return
         lane = lane + unknowns**2
         once = once + 2*unknowns**2
      end associate
   end subroutine add_matrices

end module symsde_step_memory
