! SPDX-License-Identifier: BSD-3-Clause
!> The inputs of a step of a block: time, step, weights, and functionals of the path.
!>
!> A noise source fills a store of several steps at once (steps come in pairs, because two words of the generator give
!> the normals of both). A stepper gets one step of the store: a record of pointers, so that nothing is copied.
module symsde_base_record
   use symsde_base_functionals, only: functional_set, nfunctional
   use symsde_base_kinds, only: wp, i8
   implicit none
   private
   public :: step_record, steps_record, step_decays, step_store, step_request, new_step_store, describe_step_store
   public :: lost_over

   !> The values of one functional in one step, and in all steps of a store.
   type :: functional_values
      real(wp), pointer, contiguous :: x(:, :) => null()  !! (nlane, count_of)
   end type functional_values

   type :: functional_steps
      real(wp), allocatable :: x(:, :, :)  !! (nlane, count_of, 0:capacity-1)
   end type functional_steps

   !> One step. The record points into a store, and is valid as long as the store.
   type :: step_record
      real(wp) :: t = 0                                   !! t_n, when the step begins [time]
      real(wp) :: h = 0                                   !! the step, with its sign [time]
      real(wp), pointer, contiguous :: w(:, :) => null()  !! h, dW_1 .. dW_m (nlane, 0:nnoise)
      type(functional_values) :: of(nfunctional) = functional_values()  !! of(path_dz)%x, ..; null unless asked for
   end type step_record

   !> The values of one functional in several steps.
   type :: functional_run
      real(wp), pointer, contiguous :: x(:, :, :) => null()  !! (nlane, count_of, nstep)
   end type functional_run

   !> How damping by one rate changes whole steps, with z = gamma h. In a map of one stage momenta are multiplied before
   !> the step of the closed system and again after it, in two multiplications, as if each step were taken alone. In
   !> verlet_map momenta are multiplied by exp(-z) between the stages, and the drift is by (1 + exp(-z))/2 p; in the
   !> swapped map the kick is by (1 + exp(-z))/2 times the force. Between kicks a drift over tau moves q by p (1 -
   !> exp(-gamma tau))/gamma and multiplies p by exp(-gamma tau).
   type :: step_decays
      real(wp) :: z = 0
      real(wp) :: before = 0, after = 0          !! exp(-c z) - 1 and exp(-(1 - c) z) - 1, c being the node of the stage
      integer :: nkick = 2                       !! kicks between drifts, three at most in the catalogue's schemes
      real(wp), dimension(3) :: beta = 0, gamma = 0, eta = 0 !! their parts of dW_k, dZ_k/h - dW_k/2 and K_k
      real(wp), dimension(5) :: lost = 0, left = 0   !! exp(-c z) - 1 and exp(-c z) for the parts c in lost_over
   end type step_decays

   !> The first node of Gauss, the distance of both, a step, its half, and the second node.
   real(wp), parameter :: lost_over(5) = [0.5_wp - sqrt(3.0_wp)/6, sqrt(3.0_wp)/3, 1.0_wp, 0.5_wp, &
                                          0.5_wp + sqrt(3.0_wp)/6]

   !> Several consecutive steps, for a model that computes them itself. The model returns the states after every
   !> `every`-th step. The record is valid as long as the arrays that it points to.
   type :: steps_record
      integer :: nlane = 0, nnoise = 0
      integer :: nreal = 0                                   !! lanes beyond are padding, and need not be computed
      integer :: nstep = 0                                   !! a multiple of every
      integer :: most = 0                                    !! largest number of steps of such a record
      logical :: by_weights = .false. !! whether steps depend on the weights alone, without functionals
      integer :: every = 1
      real(wp) :: t = 0                                      !! beginning of the first step [time]
      real(wp) :: t0 = 0                                     !! beginning of step 0 of the run [time]
      integer(i8) :: first = 0                               !! absolute number of the first step
      real(wp) :: h = 0                                      !! each step, with its sign [time]
      integer :: max_iter = 0                                !! bound of a solver's iterations in a step
      type(step_decays) :: decays                            !! decays of maps of damped models
      !> Flows between kicks of a model with a quadratic part z.S z/2: for each drift the rows of exp(tau J S) - 1, and
      !> the rows of S_qq behind them; else null.
      real(wp), pointer, contiguous :: turns(:) => null()
      real(wp), pointer, contiguous :: w(:, :, :) => null()  !! h, dW_1 .. dW_m (nlane, 0:nnoise, nstep)
      type(functional_run) :: of(nfunctional) = functional_run()  !! of(path_dz)%x, ..; null unless asked for
   contains
      procedure :: show => show_one
      procedure :: leave_one
   end type steps_record

   !> Several consecutive steps.
   type :: step_store
      integer :: nlane = 0, nnoise = 0
      integer :: capacity = 0                       !! steps that fit, an even number
      integer :: ring = 0                           !! steps whose weights are held; later ones replace them
      real(wp) :: h = 0                         !! length of every step [time]
      type(functional_set) :: asked             !! the functionals that are filled
      real(wp), allocatable :: w(:, :, :)       !! weights h, dW_1 .. dW_m (nlane, 0:nnoise, 0:ring-1)
      type(functional_steps) :: of(nfunctional)
      real(wp), allocatable :: work(:)          !! numbers that a source keeps no longer than a request
   contains
      procedure :: make_room
      procedure :: show
      procedure :: show_several
   end type step_store

   !> The paths and steps of a request to a source.
   type :: step_request
      integer :: nlane = 0
      integer :: nreal = 0                 !! number of real lanes; lanes beyond repeat the last
      integer(i8), allocatable :: path(:)  !! global path of each lane (nlane)
      integer(i8) :: pair = 0              !! the steps 2 pair, 2 pair + 1, .. , counted from step 0
      integer :: npair = 1                 !! pairs of steps
   end type step_request

contains

   !> Allocate steps of nlane lanes: all zero except h.
   subroutine new_step_store(self, nlane, nnoise, capacity, h, asked, ring)
      type(step_store), intent(out) :: self
      integer, intent(in) :: nlane, nnoise
      integer, intent(in) :: capacity           !! steps, an even number
      real(wp), intent(in) :: h             !! step with its sign [time]
      type(functional_set), intent(in) :: asked
      integer, intent(in), optional :: ring     !! steps whose weights are held at once; all by default

      call describe_step_store(self, nlane, nnoise, capacity, h, asked)
      if (present(ring)) self%ring = ring
      call self%make_room()
   end subroutine new_step_store

   !> Describe a store; its arrays are allocated at first use.
   subroutine describe_step_store(self, nlane, nnoise, capacity, h, asked)
      type(step_store), intent(out) :: self
      integer, intent(in) :: nlane, nnoise, capacity
      real(wp), intent(in) :: h
      type(functional_set), intent(in) :: asked

      self%nlane = nlane
      self%nnoise = nnoise
      self%capacity = capacity
      self%ring = capacity
      self%h = h
      self%asked = asked
   end subroutine describe_step_store

   !> Allocate the arrays, unless they are allocated: zero except for h.
   subroutine make_room(self)
      class(step_store), intent(inout) :: self
      integer :: i, ncolumn

      if (allocated(self%w)) return
      allocate (self%w(self%nlane, 0:self%nnoise, 0:self%ring - 1))
      call set_to(self%h, self%nlane, self%nnoise + 1, self%ring, self%w)
      do i = 1, nfunctional
         if (.not. self%asked%has(i)) cycle
         ncolumn = self%asked%count_of(i, self%nnoise)
         allocate (self%of(i)%x(self%nlane, ncolumn, 0:self%capacity - 1))
         call set_to(0.0_wp, self%nlane, ncolumn, self%capacity, self%of(i)%x)
      end do
   end subroutine make_room

   !> Zero except for the first column, by explicit bounds: for one lane `source` would set each number by a call.
   pure subroutine set_to(first, nlane, ncolumn, nstep, x)
      real(wp), intent(in) :: first
      integer, intent(in) :: nlane, ncolumn, nstep
      real(wp), intent(out) :: x(nlane*ncolumn, nstep)
      integer :: i, n

      do n = 1, nstep
         do i = 1, nlane*ncolumn
            x(i, n) = merge(first, 0.0_wp, i <= nlane)
         end do
      end do
   end subroutine set_to

   !> Make a record of step i of the store; the step begins at time t.
   subroutine show(self, i, t, step)
      class(step_store), intent(in), target :: self
      integer, intent(in) :: i                !! 0 .. capacity-1
      real(wp), intent(in) :: t
      type(step_record), intent(inout) :: step  !! the record shown before, or a new one
      integer :: f

      step%t = t
      step%h = self%h
      step%w(1:, 0:) => self%w(:, :, mod(i, self%ring))
      if (self%asked%is_empty()) return
      do f = 1, nfunctional
         if (self%asked%has(f)) step%of(f)%x => self%of(f)%x(:, :, i)
      end do
   end subroutine show

   !> Point to steps i .. i+nstep-1 of the store; the first begins at time t.
   subroutine show_several(self, i, nstep, t, steps)
      class(step_store), intent(in), target :: self
      integer, intent(in) :: i                !! 0 .. capacity-nstep
      integer, intent(in) :: nstep
      real(wp), intent(in) :: t
      type(steps_record), intent(inout) :: steps
      integer :: f

      steps%nlane = self%nlane
      steps%nnoise = self%nnoise
      steps%nstep = nstep
      steps%most = self%capacity
      steps%t = t
      steps%h = self%h
      steps%w(1:, 0:, 1:) => self%w(:, :, i:i + nstep - 1)
      steps%by_weights = self%asked%is_empty()
      if (steps%by_weights) return
      do f = 1, nfunctional
         if (self%asked%has(f)) steps%of(f)%x => self%of(f)%x(:, :, i:i + nstep - 1)
      end do
   end subroutine show_several

   !> Step k of several, as a record of its own. Its time is t0 + n h, never accumulated.
   subroutine show_one(self, k, step)
      class(steps_record), intent(in) :: self
      integer, intent(in) :: k                  !! 1 .. nstep
      type(step_record), intent(inout) :: step  !! the record of these steps shown before, or a new one
      integer :: f

      step%t = self%t0 + real(self%first + k - 1, wp)*self%h
      step%h = self%h
      step%w(1:, 0:) => self%w(:, :, k)
      if (self%by_weights) return
      do f = 1, nfunctional
         if (associated(self%of(f)%x)) step%of(f)%x => self%of(f)%x(:, :, k)
      end do
   end subroutine show_one

   !> Make `one` point to the k-th of several steps.
   subroutine leave_one(self, k, one)
      class(steps_record), intent(in) :: self
      integer, intent(in) :: k                 !! 1 .. nstep
      type(steps_record), intent(out) :: one
      integer :: f

      one = self
      one%nstep = 1
      one%every = 1
      one%first = self%first + k - 1
      one%t = self%t0 + real(one%first, wp)*self%h
      one%w(1:, 0:, 1:) => self%w(:, :, k:k)
      do f = 1, nfunctional
         if (associated(self%of(f)%x)) one%of(f)%x => self%of(f)%x(:, :, k:k)
      end do
   end subroutine leave_one

end module symsde_base_record
