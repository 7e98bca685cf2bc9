! SPDX-License-Identifier: BSD-3-Clause
!> The stepper of models that define whole steps of a scheme themselves (model_type%flow):
!>
!>    (q_{n+1}, p_{n+1}) = Phi(q_n, p_n; t_n, h, dW_1 .. dW_m),      nstep times in one call
!>
!> Phi is the map of the scheme for the one-step Hamiltonian h H + sum_k dW_k H_k, with the correction of one-sided
!> schemes if the map is `corrected`. The model solves the equations of a step, in closed form or by an iteration of its
!> own. This stepper finds the map for a task, handles failures, and makes increments for callers that need them. A flow
!> agrees with the general stepper to rounding, and gives the bits of single steps (tests/verification/test_whole.pf).
!>
!> If momenta are damped by one rate, the map decays as base/record says: its decay factors are computed when h changes,
!> and handed to the model with the steps.
!>
!> A flow is searched in this order:
!>
!> 1. by the map of the scheme, which for four schemes is found from the coefficients (known_map);
!> 2. among the maps of the catalogue, since users may have renamed one of its schemes;
!> 3. for quadratic models again among the four, if the scheme's brackets vanish for the model.
module symsde_step_flow_model_flow
   use symsde_base_contracts, only: contracts_are_executed
   use symsde_base_kinds, only: wp, i8
   use symsde_base_laws, only: law_gaussian
   use symsde_base_counters, only: counters_type
   use symsde_base_maps, only: step_map, other_map, euler_map, euler_adjoint_map, verlet_map, midpoint_map
   use symsde_base_damping, only: decay_less_one, noise_of_scheme
   use symsde_base_record, only: step_record, steps_record, step_decays, lost_over
   use symsde_base_text, only: name_length
   use symsde_scheme_catalogue, only: scheme_names
   use symsde_scheme_kicks, only: kicks_type
   use symsde_model_abstract, only: model_type
   use symsde_model_catalogue_by_name, only: is_built_in
   use symsde_model_kernels, only: kernel_model, kernels_of
   use symsde_scheme_scheme, only: correction_none, correction_increments, splitting_form, tableau_form
   use symsde_step_block_state, only: lane_state, passed_states
   use symsde_step_contract, only: require_steps, require_taken
   use symsde_step_flow_scheme_map, only: map_of, named_map, known_map, is_of_catalogue
   use symsde_step_hamiltonian_one_step, only: new_one_step_hamiltonian
   use symsde_step_open_kick_law, only: give_law
   use symsde_step_open_linear_flow, only: linear_flow, new_linear_flow, hamiltonian_field
   use symsde_step_stepper, only: stepper_type, stepper_task, few_of
   implicit none
   private
   public :: model_flow_stepper, find_flow

   integer, parameter :: four(4) = [euler_map, euler_adjoint_map, verlet_map, midpoint_map]  !! found by coefficients

   type, extends(stepper_type) :: model_flow_stepper
      private
      type(step_map) :: map
      integer, public :: max_iter = 0
      integer, public :: correction = correction_none
      integer(i8), allocatable :: status(:)   !! status of the lanes as set by the model (nlane)
      real(wp) :: rate = 0                    !! rate of a damped map
      real(wp) :: node = 0                    !! c of its first stage
      type(kicks_type), allocatable :: kicks  !! kicks of a splitting, without decays
      real(wp) :: h = 0                       !! length of the step for which decays were computed
      type(step_decays) :: decays
      type(linear_flow), allocatable :: drifts !! flows of a quadratic part between kicks
      real(wp), allocatable :: place(:)        !! beginnings of these drifts and their end, as parts of the step
      real(wp), allocatable :: turns(:)        !! the same as numbers, as in base/record
   contains
      procedure :: make
      procedure :: advance
      procedure :: increment
      procedure :: flow
   end type model_flow_stepper

contains

   !> Find the flow that serves a task, if there is one: the flow of a damped map if one rate damps the momenta, else
   !> the flow of the closed system, which serves between decays (step/open/damped).
   subroutine find_flow(task)
      type(stepper_task), intent(inout) :: task

      if (task%damping%acts() .and. task%damping%is_scalar() .and. task%damping_noise == noise_of_scheme) &
         call find_map(task, .true.)
      if (.not. allocated(task%flow)) call find_map(task, .false.)
   end subroutine find_flow

   !> Find the map of a flow that serves a task, if there is one, once for all of its steppers: the search costs as much
   !> as making a stepper. A model's own solution does not have a given number of fixed-point iterations, and its states
   !> do not give increments to their last digit: other steppers execute such tasks. Flows exist only for the increments
   !> form of the correction. A flow defined for the scheme comes first. If equations are linear, so that a step has one
   !> root, the steps of one of the four also serve discrete increments, and schemes whose brackets vanish for the
   !> model.
   subroutine find_map(task, damped)
      type(stepper_task), intent(inout) :: task
      logical, intent(in) :: damped
      type(step_map) :: map
      class(kernel_model), pointer :: fast
      logical :: found, corrected

      fast => kernels_of(task%model)
      if (.not. associated(fast) .or. associated(task%model%forces)) return
      if (task%newton%fixed_point /= 0 .or. task%as_increments .or. task%general) return
      ! Flows read the functionals of their scheme, of which none are drawn if all noises are silent. Steps made of two
      ! flows of parts of H do without them.
      if (allocated(task%model%traits%silent)) then
         if (all(task%model%traits%silent) .and. .not. (task%scheme%asks%is_empty() .or. task%model%traits%has_parts)) &
            return
      end if
      corrected = task%correction /= correction_none
      if (corrected) then
         if (task%correction /= correction_increments .or. .not. task%scheme%is_euler_pair()) return
      end if
      call map_of(task%scheme, map)
      map%corrected = corrected
      map%damped = damped
      if (damped .and. task%drifts_by_part()) return
      found = fast%has_flow(map)
      ! A name alone proves nothing: unless the scheme is one of the four, its coefficients, law and brackets must be
      ! those of the catalogue's scheme of this name. Otherwise its tableau may be in the catalogue under another name.
      if (is_one_of_four(known_map(task%scheme, task%scheme%brackets%are_added()))) then
         ! Flows are defined for Gaussian increments. Other laws may use them if equations are linear and have one root.
         found = found .and. (task%scheme%law == law_gaussian .or. task%model%traits%quadratic)
      else
         if (found) found = is_of_catalogue(task%scheme, trim(map%label))
         if (.not. found .and. task%scheme%has_tableau()) call find_by_coefficients(task, map, found)
      end if
      if (.not. found .and. task%model%traits%quadratic) then
         ! The third attempt: ignore brackets that vanish by the model's traits.
         map = known_map(task%scheme, task%has_brackets())
         map%corrected = corrected
         map%damped = damped
         found = is_one_of_four(map) .and. fast%has_flow(map)
      end if
      if (found) task%flow = map
   end subroutine find_map

   !> Whether known_map has found the scheme to be one of the four.
   pure logical function is_one_of_four(map)
      type(step_map), intent(in) :: map

      is_one_of_four = map%equation /= other_map
   end function is_one_of_four

   !> Set the map of the flow, the bound of its solver's iterations, and the description for the report. A plain flow is
   !> explicit if the stages of its scheme are, or if it is a splitting. A single path is executed as a block of one
   !> lane.
   subroutine make(self, task)
      class(model_flow_stepper), intent(inout) :: self
      type(stepper_task), intent(in) :: task
      logical :: plain

      plain = task%correction == correction_none
      self%map = task%flow
      self%correction = task%correction
      self%name = 'whole steps of '//trim(self%map%label)//' by the model'
      if (.not. plain) self%name = 'whole corrected steps of '//trim(self%map%label)//' by the model'
      if (self%map%damped) then
         self%name = self%name//', damped'
         self%rate = task%damping%rate(1)
         if (task%scheme%form == tableau_form) self%node = task%scheme%c(1)
         if (task%scheme%form == splitting_form) self%kicks = task%scheme%kicks
      end if
      associate (fast => kernels_of(task%model))
         if (fast%steps_by_parts(self%map)) then
            self%name = 'kicks and drifts by the model''s own flows'
         else if (task%drifts_by_part()) then
            call make_drifts(self, task)
         end if
      end associate
      self%max_iter = task%newton%max_iter
      self%most_single = paths_alone(task%model)
      self%explicit = plain .and. (task%follows .or. task%scheme%form == splitting_form)
      self%one_solve = task%model%traits%one_solve(.false.) .and. .not. self%explicit
      call new_one_step_hamiltonian(self%ham, task%model, task%nlane, correction_none, 0.0_wp)  ! added by the flow
   end subroutine make

   !> Up to how many paths are faster one by one. Alone, a path of a chain computes its sites side by side. With one
   !> path more, single paths take 0.8 to 1.3 of the time of a block, whose flows are faster if they are generated.
   pure integer function paths_alone(model)
      class(model_type), intent(in) :: model

      associate (n => model%traits%ndof)
         paths_alone = few_of(n, 1, 3)
         if (is_built_in(model)) paths_alone = few_of(n, min(3, 1 + n/4), 4)
      end associate
   end function paths_alone

   !> The flows of a quadratic part between the kicks of a scheme.
   subroutine make_drifts(self, task)
      class(model_flow_stepper), intent(inout) :: self
      type(stepper_task), intent(in) :: task

      allocate (self%drifts)
      self%place = [0.0_wp, task%scheme%kicks%c, 1.0_wp]
      associate (s => task%model%traits%quadratic_part, n => size(self%place) - 1)
         call new_linear_flow(self%drifts, hamiltonian_field(s), n)
         allocate (self%turns(n*size(s) + size(s)/4), source=0.0_wp)
         self%turns(n*size(s) + 1:) = pack(s(:size(s, 1)/2, :size(s, 1)/2), .true.)
      end associate
   end subroutine make_drifts

   !> Among the model's flows find that of the catalogue's scheme with this tableau; the user's name of the scheme does
   !> not matter.
   subroutine find_by_coefficients(task, map, found)
      type(stepper_task), intent(in) :: task
      type(step_map), intent(inout) :: map
      logical, intent(out) :: found
      character(len=name_length), allocatable :: known(:)
      class(kernel_model), pointer :: fast
      type(step_map) :: other
      integer :: i

      found = .false.
      fast => kernels_of(task%model)
      known = scheme_names()
      do i = 1, size(known)
         ! The coefficients of the four have been compared already. First test whether the model has such a flow, which
         ! costs less than making the scheme.
         other = named_map(known(i))
         other%damped = map%damped
         if (any(other%equation == four) .or. .not. fast%has_flow(other)) cycle
         found = is_of_catalogue(task%scheme, trim(other%label))
         if (.not. found) cycle
         map = other
         return
      end do
   end subroutine find_by_coefficients

   !> Take several steps from (q, p), nlane x ndof, to the states (qn, pn) after every steps%every-th step, consecutive
   !> in the last index. The model fills the counters of the Hamiltonian.
   subroutine flow(self, steps, q, p, qn, pn, status)
      class(model_flow_stepper), intent(inout), target :: self
      type(steps_record), intent(inout) :: steps   !! the decays and the drifts of its steps are set here
      real(wp), intent(in) :: q(steps%nlane, self%ham%ndof), p(steps%nlane, self%ham%ndof)
      real(wp), intent(out) :: qn(steps%nlane, self%ham%ndof, steps%nstep/steps%every)
      real(wp), intent(out) :: pn(steps%nlane, self%ham%ndof, steps%nstep/steps%every)
      integer(i8), intent(inout) :: status(steps%nlane)

      if (self%map%damped) then
         if (abs(steps%h - self%h) > 0) call find_decays(self, steps%h)
         steps%decays = self%decays
      end if
      if (allocated(self%drifts)) then
         if (abs(steps%h - self%h) > 0) call find_drifts(self, steps%h)
         steps%turns => self%turns
      end if
      associate (ham => self%ham)
         call ham%fast%flow(self%map, steps, ham%ndof, q, p, qn, pn, status, ham%counters)
      end associate
      nullify (steps%turns)
   end subroutine flow

   !> The flows of the quadratic part in steps of the length h, with its sign.
   subroutine find_drifts(self, h)
      type(model_flow_stepper), intent(inout) :: self
      real(wp), intent(in) :: h
      integer :: i, n

      self%h = h
      n = 4*self%ham%ndof**2
      do i = 1, size(self%place) - 1
         call self%drifts%rows(i, (self%place(i + 1) - self%place(i))*h, self%turns((i - 1)*n + 1:i*n))
      end do
   end subroutine find_drifts

   !> The decays of steps of the length h, with its sign.
   subroutine find_decays(self, h)
      type(model_flow_stepper), intent(inout) :: self
      real(wp), intent(in) :: h
      type(kicks_type) :: kicks
      integer :: i

      self%h = h
      self%decays = step_decays(z=self%rate*h)
      ! Here, once for all steps, since exponentials take as long as steps, and flows are called for a few steps.
      !GCC$ novector  ! the last bits of a vector exponential depend on the width of registers
      do i = 1, size(lost_over)
         self%decays%lost(i) = decay_less_one(lost_over(i)*self%decays%z)
         self%decays%left(i) = exp(-lost_over(i)*self%decays%z)
      end do
      if (.not. allocated(self%kicks)) then
         self%decays%before = decay_less_one(self%node*self%decays%z)
         self%decays%after = decay_less_one((1 - self%node)*self%decays%z)
      else
         kicks = self%kicks
         call give_law(kicks, self%kicks, self%decays%z, noise_of_scheme)
         associate (n => size(kicks%c), d => self%decays)
            d%nkick = n
            d%beta(:n) = kicks%beta
            d%gamma(:n) = kicks%gamma
            d%eta(:n) = kicks%eta
         end associate
      end if
   end subroutine find_decays

   !> Take several steps of the model at once, unless a lane fails. It is not known in which of the steps a lane failed,
   !> so the steps are repeated one by one until it does. Then the lane is at the beginning of that step, all other
   !> lanes are at its end, and ntaken is its number.
   recursive subroutine advance(self, steps, state, passed, ntaken, failed)
      class(model_flow_stepper), intent(inout) :: self
      type(steps_record), intent(inout) :: steps
      type(lane_state), intent(inout) :: state
      type(passed_states), intent(inout) :: passed
      integer, intent(out) :: ntaken
      logical, intent(out) :: failed
      type(counters_type) :: before
      type(passed_states) :: one
      type(steps_record) :: single
      integer :: nout
      logical :: sound

      if (contracts_are_executed) call require_steps(steps, state)
      before = self%ham%counters
      nout = steps%nstep/steps%every
      steps%max_iter = self%max_iter
      ! The model writes its states where observers will see them (passed), and separate statuses, so that the block
      ! keeps its own until the states have been judged.
      self%status = state%status
      call self%flow(steps, state%q, state%p, passed%q, passed%p, self%status)
      call state%judge(steps%nreal, nout, self%status, passed%q, passed%p, sound)
      failed = .not. sound
      ntaken = steps%nstep
      passed%n = nout
      if (sound) then
         ! No lane failed: the last of the states becomes that of the block.
         call state%take_first(state%nlane, passed%q(1, 1, nout), passed%p(1, 1, nout))
      else if (steps%nstep == 1) then
         ! A lane has failed in a single step. All other lanes accept their states; arrays for increments are allocated,
         ! by which a rescue may try the lane again (step/implicit/rescue).
         passed%n = 0
         call self%make_room()
         call steps%show(1, self%record)
         call state%take_sound(self%status, passed%q, passed%p)
      else
         ! A lane has failed in one of several steps. Call this procedure for each step alone, with one state.
         self%ham%counters = before  ! no step is counted twice
         passed%n = 0
         allocate (one%q(state%nlane, state%ndof, 1), one%p(state%nlane, state%ndof, 1))
         do ntaken = 1, steps%nstep
            call steps%leave_one(ntaken, single)
            call self%advance(single, state, one, nout, failed)
            if (failed) exit
            if (mod(ntaken, steps%every) == 0) call passed%put(state)
         end do
         ntaken = min(ntaken, steps%nstep)
      end if
      if (contracts_are_executed) call require_taken(steps, state, passed, ntaken, failed)
   end subroutine advance

   !> One step as an increment, for callers that need one: its precision is that of states.
   subroutine increment(self, step, q, p, dq, dp, status)
      class(model_flow_stepper), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      real(wp), intent(out) :: dq(self%ham%nlane, self%ham%ndof), dp(self%ham%nlane, self%ham%ndof)
      integer(i8), intent(inout) :: status(self%ham%nlane)
      type(steps_record) :: steps
      integer :: f

      steps = steps_record(nlane=self%ham%nlane, nnoise=self%ham%nnoise, nreal=self%ham%nreal, nstep=1, t=step%t, &
                           h=step%h, max_iter=self%max_iter)
      steps%w(1:steps%nlane, 0:steps%nnoise, 1:1) => step%w
      do f = 1, size(step%of)
         if (associated(step%of(f)%x)) steps%of(f)%x(1:steps%nlane, 1:size(step%of(f)%x, 2), 1:1) => step%of(f)%x
      end do
      ! The model writes the new states into the increments, and the old states are subtracted.
      call self%flow(steps, q, p, dq, dp, status)
      dq = dq - q
      dp = dp - p
   end subroutine increment

end module symsde_step_flow_model_flow
