! SPDX-License-Identifier: BSD-3-Clause
!> The stepper of models that define whole steps of a scheme themselves (model_type%flow):
!>
!>    (q_{n+1}, p_{n+1}) = Phi(q_n, p_n; t_n, h, dW_1 .. dW_m),      nstep times in one call
!>
!> Phi is the map of the scheme for the one-step Hamiltonian h H + sum_k dW_k H_k, with the correction of one-sided
!> schemes where the name of the flow ends in `corrected`. The model solves the equations of a step, in closed form or
!> by an iteration of its own. This stepper finds the name of the flow that serves a task, sorts out failures, and
!> makes increments for callers that want these. A flow agrees with the general stepper to rounding, and gives the
!> bits of single steps (tests/verification/test_whole.pf).
!>
!> A flow is looked for in this order:
!>
!>    1. by the scheme's name in the catalogue, which for four of them is found from their coefficients (usual_name);
!>    2. among all names of the catalogue, where users have given one of its schemes another name;
!>    3. for quadratic models once more among the four, where the scheme's brackets vanish for the model.
!>
!> Midpoint, the Euler pair and Verlet go by their coefficients, since users reach them in many ways: from a
!> quadrature, as a tableau, or under a name of their own.
module symsde_step_flow_model_flow
   use symsde_base_kinds, only: wp, i8
   use symsde_base_laws, only: law_gaussian
   use symsde_base_counters, only: counters_type
   use symsde_base_record, only: step_record, steps_record
   use symsde_base_status, only: error_type
   use symsde_base_text, only: name_length
   use symsde_scheme_catalogue, only: get_scheme, scheme_names
   use symsde_model_kernels, only: kernel_model, kernels_of, corrected
   use symsde_scheme_scheme, only: scheme_type, correction_none, correction_increments, tableau_form, &
                                   splitting_form, frame_none
   use symsde_step_block_state, only: lane_state, passed_states
   use symsde_step_hamiltonian_one_step, only: new_one_step_hamiltonian
   use symsde_step_stepper, only: stepper_type, stepper_task
   implicit none
   private
   public :: model_flow_stepper, find_flow, name_of_flow

   character(len=name_length), parameter :: four(4) = [character(len=name_length) :: & !&
      'midpoint', 'symplectic_euler', 'symplectic_euler_adjoint', 'stormer_verlet'] !&

   type, extends(stepper_type) :: model_flow_stepper
      private
      character(:), allocatable :: scheme   !! as the model knows it
      integer, public :: max_iter = 0
      integer(i8), allocatable :: status(:)   !! of the lanes, as the model leaves it (nlane)
   contains
      procedure :: make
      procedure :: advance
      procedure :: increment
      procedure :: flow
   end type model_flow_stepper

contains

   !> Find the flow that serves a task, if there is one, once for all of its steppers: to look for it costs as much as
   !> to make one. A given number of fixed-point iterations is not what a model's own solution makes, and increments to
   !> their own last place cannot be had from its states: such tasks are left to other steppers. Of the corrections the
   !> increments form alone has flows. A flow that is meant for the scheme comes first. Where equations are linear, so
   !> that a step has one root, the steps of one of the four also serve discrete increments, and schemes whose brackets
   !> vanish for the model.
   subroutine find_flow(task)
      type(stepper_task), intent(inout) :: task
      character(:), allocatable :: name, ending   !! what stands behind the name of a scheme that is corrected
      class(kernel_model), pointer :: fast
      logical :: found

      fast => kernels_of(task%model)
      if (.not. associated(fast)) return
      if (task%newton%fixed_point /= 0 .or. task%as_increments .or. task%general) return
      ending = ''
      if (task%correction /= correction_none) then
         if (task%correction /= correction_increments .or. .not. task%scheme%is_euler_pair()) return
         ending = corrected
      end if
      call name_of_flow(task%scheme, name)
      found = fast%has_flow(name//ending)
      ! A name alone proves nothing: where the scheme is none of the four, its coefficients, law and brackets must be
      ! those of the catalogue's scheme of this name. Failing that, its tableau may stand in the catalogue under
      ! another name.
      if (usual_name(task%scheme, task%scheme%brackets%are_added()) == '') then
         if (found) found = is_of_catalogue(task%scheme, name)
         if (.not. found .and. task%scheme%has_tableau()) call find_by_coefficients(task, name, found)
      else
         ! One of the four: its flow is meant for Gaussian increments. Others take it where equations are linear and
         ! have one root.
         found = found .and. (task%scheme%law == law_gaussian .or. task%model%traits%quadratic)
      end if
      if (.not. found) then
         ! The third attempt: brackets count as none where the model's traits make them vanish. For models that are not
         ! quadratic the name is left blank.
         name = trim(merge(usual_name(task%scheme, task%has_brackets()), usual_name(task%scheme, .true.), &
                           task%model%traits%quadratic))
         found = name /= '' .and. fast%has_flow(name//ending)
      end if
      if (found) task%flow = name//ending
   end subroutine find_flow

   !> The name of the flow, the bound of its solver's iterations, and what the report says of it. A plain flow is
   !> explicit where the stages of its scheme are, and where it is a splitting. A path by itself is taken as a block
   !> of one lane.
   subroutine make(self, task)
      class(model_flow_stepper), intent(inout) :: self
      type(stepper_task), intent(in) :: task
      logical :: plain

      plain = task%correction == correction_none
      self%scheme = task%flow
      self%name = 'whole steps of '//self%scheme//' by the model'
      if (.not. plain) &
         self%name = 'whole corrected steps of '//task%flow(:len(task%flow) - len(corrected))//' by the model'
      self%max_iter = task%newton%max_iter
      self%most_single = 1
      self%explicit = plain .and. (task%follows .or. task%scheme%form == splitting_form)
      self%one_solve = task%model%traits%one_solve(.false.) .and. .not. self%explicit
      call new_one_step_hamiltonian(self%ham, task%model, task%nlane, correction_none, 0.0_wp)  ! corrected by the flow
   end subroutine make

   !> Of the model's flows, that of the catalogue's scheme with this tableau: nothing depends on what users call it.
   subroutine find_by_coefficients(task, name, found)
      type(stepper_task), intent(in) :: task
      character(:), allocatable, intent(inout) :: name
      logical, intent(out) :: found
      character(len=name_length), allocatable :: known(:)
      class(kernel_model), pointer :: fast
      integer :: i

      found = .false.
      fast => kernels_of(task%model)
      known = scheme_names()
      do i = 1, size(known)
         ! The coefficients of the four have been compared. Whether the model has such a flow is asked first: it costs
         ! less than to make the scheme.
         if (any(four == known(i)) .or. .not. fast%has_flow(known(i))) cycle
         found = is_of_catalogue(task%scheme, trim(known(i)))
         if (.not. found) cycle
         name = trim(known(i))
         return
      end do
   end subroutine find_by_coefficients

   !> The name by which a model is asked for the flow of a scheme: that of the catalogue for the four that are known
   !> by their coefficients, else the name that the scheme bears.
   subroutine name_of_flow(scheme, name)
      type(scheme_type), intent(in) :: scheme
      character(:), allocatable, intent(out) :: name

      name = trim(usual_name(scheme, scheme%brackets%are_added()))
      if (name == '') name = scheme%name
   end subroutine name_of_flow

   !> The name in the catalogue of one of the four (midpoint, the two of the Euler pair, Verlet), known by its
   !> coefficients; blank for others and where brackets are added to the Hamiltonian, or a frame stands around the
   !> tableau.
   pure character(len=name_length) function usual_name(scheme, has_brackets) result(name)
      type(scheme_type), intent(in) :: scheme
      logical, intent(in) :: has_brackets

      name = ''
      if (scheme%form /= tableau_form .or. scheme%frame /= frame_none .or. has_brackets) return
      if (scheme%is_midpoint()) then
         name = four(1)
      else if (scheme%is_euler_pair()) then
         name = merge(four(3), four(2), scheme%a(1, 1) > 0.5_wp)
      else if (is_verlet(scheme)) then
         name = four(4)
      end if
   end function usual_name

   !> Whether a scheme is the one that the catalogue has under this name: users may name theirs as they like.
   !> Coefficients are equal in every bit, the nodes c up to the rounding of the sums of a that users' nodes are.
   logical function is_of_catalogue(scheme, name)
      type(scheme_type), intent(in) :: scheme
      character(*), intent(in) :: name
      type(scheme_type) :: known
      type(error_type), allocatable :: error

      is_of_catalogue = .false.
      call get_scheme(known, name, error)
      if (allocated(error)) return
      if (known%form /= scheme%form .or. known%frame /= scheme%frame .or. known%nstage /= scheme%nstage) return
      if (known%law /= scheme%law) return
      associate (a => known%brackets, b => scheme%brackets)
         if (any([a%single, a%areas, a%nested, a%crossed] .neqv. [b%single, b%areas, b%nested, b%crossed])) return
      end associate
      is_of_catalogue = .true.
      if (.not. known%has_tableau()) return
      is_of_catalogue = all(abs(known%a - scheme%a) <= 0) .and. all(abs(known%abar - scheme%abar) <= 0) .and. &
                        all(abs(known%b - scheme%b) <= 0) .and. all(abs(known%bbar - scheme%bbar) <= 0) .and. &
                        all(abs(known%alpha - scheme%alpha) <= 0) .and. all(abs(known%beta - scheme%beta) <= 0) .and. &
                        all(abs(known%c - scheme%c) <= 8*epsilon(1.0_wp))  ! of a user's, sums of a
   end function is_of_catalogue

   !> Whether the scheme is half a kick, a drift, and half a kick: a = (0, 0; 1/2, 1/2), abar = (1/2, 0; 1/2, 0),
   !> alpha = (1/2, 1/2), c = (0, 1), the tableau of Lobatto IIIA-IIIB of two stages (Stormer-Verlet).
   pure logical function is_verlet(scheme)
      type(scheme_type), intent(in) :: scheme
      real(wp), parameter :: a(2, 2) = reshape([0.0_wp, 0.5_wp, 0.0_wp, 0.5_wp], [2, 2])

      is_verlet = .false.
      if (scheme%nstage /= 2 .or. .not. scheme%noise_coefficients_equal()) return
      is_verlet = all(abs(scheme%a - a) <= 0) .and. all(abs(scheme%abar(:, 1) - 0.5_wp) <= 0) .and. &
                  all(abs(scheme%abar(:, 2)) <= 0) .and. all(abs(scheme%alpha - 0.5_wp) <= 0) .and. &
                  all(abs(scheme%c - [0, 1]) <= 0)
   end function is_verlet

   !> Several steps from (q, p), nlane x ndof, to the states (qn, pn) after every steps%every-th of them, side by side
   !> in the last index. The counters of the Hamiltonian are the model's to fill.
   subroutine flow(self, steps, q, p, qn, pn, status)
      class(model_flow_stepper), intent(inout) :: self
      type(steps_record), intent(in) :: steps
      real(wp), intent(in) :: q(steps%nlane, self%ham%ndof), p(steps%nlane, self%ham%ndof)
      real(wp), intent(out) :: qn(steps%nlane, self%ham%ndof, steps%nstep/steps%every)
      real(wp), intent(out) :: pn(steps%nlane, self%ham%ndof, steps%nstep/steps%every)
      integer(i8), intent(inout) :: status(steps%nlane)

      associate (ham => self%ham)
         call ham%fast%flow(self%scheme, steps, ham%ndof, q, p, qn, pn, status, ham%counters)
      end associate
   end subroutine flow

   !> Several steps of the model at once, as far as no lane fails. Of several steps it is not known in which one a
   !> lane failed, so they are taken again one by one until it does. Then the lane is where it was before that step,
   !> others have taken it, and ntaken is its number.
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

      before = self%ham%counters
      nout = steps%nstep/steps%every
      steps%max_iter = self%max_iter
      ! The model writes its states where observers will be shown them (passed), and statuses apart from those of the
      ! block, so that the block keeps its own until the states have been judged.
      self%status = state%status
      call self%flow(steps, state%q, state%p, passed%q, passed%p, self%status)
      call state%judge(steps%nreal, nout, self%status, passed%q, passed%p, sound)
      failed = .not. sound
      ntaken = steps%nstep
      passed%n = nout
      if (sound) then
         ! All went well: the last of the states becomes that of the block.
         call state%take_first(state%nlane, passed%q(1, 1, nout), passed%p(1, 1, nout))
      else if (steps%nstep == 1) then
         ! In a single step a lane has failed. The others take their states; the step is put into `record` with room
         ! for increments, by which a rescue may try the lane again (step/implicit/rescue).
         passed%n = 0
         call self%make_room()
         call steps%show(1, self%record)
         call state%take_sound(self%status, passed%q, passed%p)
      else
         ! In one of several steps a lane has failed. This procedure calls itself for each step alone, with room for
         ! one state.
         self%ham%counters = before  ! no step counts twice, however many went together
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
   end subroutine advance

   !> One step as an increment, for those who ask for one: the last place is that of the states.
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
      ! The model writes the new states where the increments are to stand, and the old ones are taken off.
      call self%flow(steps, q, p, dq, dp, status)
      dq = dq - q
      dp = dp - p
   end subroutine increment

end module symsde_step_flow_model_flow
