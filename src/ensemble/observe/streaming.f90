! SPDX-License-Identifier: BSD-3-Clause
!> The abstract streaming observer: it keeps one statistic of a run, in memory independent of paths and steps.
!>
!> It gets values of whole blocks: q_1 .. q_n, p_1 .. p_n, the energy if the model has values, the user's observables.
!> It keeps two kinds of data, each of which merges to the same bits in any order:
!>
!> integers, and numbers that belong to single paths (extremes, lists), which `join` merges; a table of means over
!> paths, whose sums merge on the dyadic tree of symsde_ensemble_statistics_path_tree.
!>
!> Every thread has its own copy; the copies share the store, which one thread at a time may change.
module symsde_ensemble_observe_streaming
   use symsde_base_kinds, only: wp, i4, i8
   use symsde_base_laws, only: law_gaussian
   use symsde_ensemble_statistics_comoments, only: pair_count, pair_place, reduce_pair
   use symsde_ensemble_observe_observables, only: observables_type
   use symsde_ensemble_statistics_path_tree, only: moment_node, moment_tree, insert_node, dyadic_pieces, reduce_lanes
   use symsde_model_abstract, only: model_type
   use symsde_step_block_state, only: lane_state
   implicit none
   private
   public :: streaming_observer, observer_request, observed_type, observer_store, observed_run
   public :: means_only, with_pairs, with_errors

   integer, parameter :: means_only = 0, with_pairs = 1, with_errors = 4  !! sums kept beside the means of a table

   !> One observer that a caller requests. Its kind decides which members are used.
   type :: observer_request
      integer :: kind = 0                     !! a parameter of symsde_ensemble_observe_observers
      integer, allocatable :: values(:)       !! numbers of the values observed, q_1 is 1
      real(wp) :: low = 0, high = 0           !! an interval
      integer :: bins = 0                     !! bins, parts or lags
      real(wp), allocatable :: shares(:)      !! 0 .. 1, of quantiles
      integer(i8), allocatable :: paths(:)    !! global indices, ascending
      logical :: absorbs = .false.            !! whether paths that leave end there
      logical :: bridges = .true.             !! whether paths may leave between two steps, too
      integer :: ngroup = 0                   !! groups of paths, each with a statistic of its own; 0: all are one group
      integer(i4), pointer, contiguous :: labels(:) => null()  !! group of each path, from 0; others are in none (npath)
   end type observer_request

   !> Data of a run that observers need.
   type :: observed_run
      integer :: ndof = 0, nvalue = 0, nlane = 0
      integer :: ntime = 0                    !! saved times
      integer(i8) :: first_path = 0, npath = 0
      integer(i8) :: first_step = 0, save_every = 1, seed = 0
      real(wp) :: step = 0                    !! [time]
      integer :: nnoise = 0
      integer :: law = law_gaussian           !! law of the increments drawn
      logical, allocatable :: common(:)       !! noises that all paths share, by the options (nnoise)
      logical :: position_noise = .false., has_value = .false., has_gradient = .true.  !! traits of the model
      class(model_type), pointer :: model => null()  !! the model, for observers that need more than values
      class(observables_type), pointer :: observables => null()  !! the user's values, likewise
   end type observed_run

   !> The results of an observer: they can be merged, and suffice to compute its answer.
   type :: observed_type
      type(observer_request) :: request
      type(observed_run) :: of
      integer(i8), allocatable :: counts(:)
      real(wp), allocatable :: sums(:)        !! of each group: numbers of single paths, then the rows of the table
   end type observed_type

   !> Data of one observer that the threads of a run share.
   type :: observer_store
      integer(i8), allocatable :: counts(:)
      real(wp), allocatable :: singles(:)
      type(moment_tree) :: tree
   end type observer_store

   type, abstract :: streaming_observer
      type(observer_request) :: request
      type(observed_run) :: run
      integer(i8) :: ncount = 0, nsingle = 0           !! integers, and numbers of single paths
      integer :: nrow = 0, ncolumn = 0                 !! rows and columns of the table; 0 = no table
      integer :: kept = means_only                     !! kinds of sums kept: means_only, with_pairs or with_errors
      integer(i8), allocatable :: counts(:)            !! counts of this thread (ncount)
      real(wp), allocatable :: singles(:)              !! numbers of this thread (nsingle)
      type(observer_store), pointer :: store => null()
      integer(i8) :: first = 0                         !! first path of the block
      integer :: nreal = 0
      logical, allocatable :: mine(:)                  !! lanes that are observed; all if not allocated (nlane)
      integer :: npiece = 0, offset(64) = 0, level(64) = 0
      type(moment_node), allocatable :: pieces(:)      !! tables of the pieces of the block
   contains
      procedure, non_overridable :: begin_block
      procedure :: open_block => nothing_before
      procedure(take_interface), deferred :: take
      procedure :: watches_steps => it_does_not
      procedure :: watch => look_away
      procedure :: close_block => nothing_more
      procedure, non_overridable :: end_block
      procedure, non_overridable :: gather
      procedure :: clear => to_zero
      procedure :: join => add_up
      procedure(extent_interface), deferred :: nanswer
      procedure(answer_interface), deferred :: answer
      procedure, non_overridable :: row
      procedure, non_overridable :: numbers
      procedure, non_overridable :: nsum
      procedure, non_overridable :: to_sums
      procedure, non_overridable :: to_table
   end type streaming_observer

   abstract interface
      !> Take the values at saved time number it (1 is t0). Lanes with `counts` true count. The caller may reuse the
      !> arrays afterwards.
      subroutine take_interface(self, it, t, values, counts)
         import :: streaming_observer, wp
         class(streaming_observer), intent(inout) :: self
         integer, intent(in) :: it
         real(wp), intent(in) :: t
         real(wp), intent(in), contiguous :: values(:, :)   !! (nlane, nvalue)
         logical, intent(in), contiguous :: counts(:)       !! (nlane)
      end subroutine take_interface

      !> Number of values in an answer.
      integer(i8) function extent_interface(self)
         import :: streaming_observer, i8
         class(streaming_observer), intent(in) :: self
      end function extent_interface

      !> Compute the answer and its standard errors from results of any number of merged runs.
      subroutine answer_interface(self, counts, sums, values, errors)
         import :: streaming_observer, i8, wp
         class(streaming_observer), intent(in) :: self
         integer(i8), intent(in) :: counts(:)
         real(wp), intent(in) :: sums(:)
         real(wp), intent(out) :: values(:), errors(:)   !! (nanswer)
      end subroutine answer_interface
   end interface

contains

   !> A block of nreal paths from global path `first` on is about to run.
   subroutine begin_block(self, first, nreal, nlane)
      class(streaming_observer), intent(inout) :: self
      integer(i8), intent(in) :: first
      integer, intent(in) :: nreal, nlane

      self%first = first
      self%nreal = nreal
      self%run%nlane = nlane
      if (.not. allocated(self%counts)) then
         allocate (self%counts(self%ncount), self%singles(self%nsingle))
         call self%clear(self%counts, self%singles)
      end if
      call dyadic_pieces(first, nreal, self%npiece, self%offset, self%level)
      if (allocated(self%mine)) call look_at_mine(self)
      call self%open_block()
   end subroutine begin_block

   !> Shrink a block that is one piece to the smallest piece around the observed lanes.
   subroutine look_at_mine(self)
      class(streaming_observer), intent(inout) :: self
      integer :: a, b, half

      if (self%npiece /= 1 .or. .not. any(self%mine)) return
      a = findloc(self%mine, .true., 1) - 1
      b = findloc(self%mine, .true., 1, back=.true.) - 1
      do while (self%level(1) > 0)
         half = 2**(self%level(1) - 1)
         if (a < self%offset(1) + half .and. b >= self%offset(1) + half) return
         if (a >= self%offset(1) + half) self%offset(1) = self%offset(1) + half
         self%level(1) = self%level(1) - 1
      end do
   end subroutine look_at_mine

   !> Clear the data of the block before.
   subroutine nothing_before(self)
      class(streaming_observer), intent(inout) :: self
   end subroutine nothing_before

   !> Make tables for the pieces of a block that has begun; a block left out by a stop needs none.
   subroutine new_pieces(self)
      class(streaming_observer), intent(inout) :: self
      integer :: i

      allocate (self%pieces(self%npiece))
      do i = 1, self%npiece
         associate (piece => self%pieces(i))
            piece%level = self%level(i)
            piece%index = (self%first + self%offset(i))/2_i8**self%level(i)
            allocate (piece%n(self%nrow), source=0.0_wp)
            allocate (piece%mean(self%ncolumn, self%nrow), piece%m2(self%ncolumn, self%nrow), source=0.0_wp)
            if (self%kept > 0) allocate (piece%pairs(self%kept*pair_count(self%ncolumn), self%nrow), source=0.0_wp)
         end associate
      end do
   end subroutine new_pieces

   !> Write numbers of each lane into a row of the table.
   subroutine row(self, irow, x, counts)
      class(streaming_observer), intent(inout) :: self
      integer, intent(in) :: irow
      real(wp), intent(in), contiguous :: x(:, :)       !! (nlane, ncolumn)
      logical, intent(in), contiguous :: counts(:)      !! (nlane)
      integer :: i, j, k, a, b, at

      if (.not. allocated(self%pieces)) call new_pieces(self)
      do i = 1, self%npiece
         a = self%offset(i) + 1
         b = self%offset(i) + 2**self%level(i)
         associate (piece => self%pieces(i))
            do j = 1, self%ncolumn
               call reduce_lanes(self%level(i), x(a:b, j), counts(a:b), piece%n(irow), piece%mean(j, irow), &
                                 piece%m2(j, irow))
               if (self%kept == means_only) cycle
               do k = 1, j
                  at = self%kept*(pair_place(k, j) - 1)
                  call reduce_pair(self%level(i), x(a:b, k), x(a:b, j), counts(a:b), &
                                   piece%pairs(at + 1:at + self%kept, irow))
               end do
            end do
         end associate
      end do
   end subroutine row

   !> Whether the observer needs every step.
   pure logical function it_does_not(self)
      class(streaming_observer), intent(in) :: self

      it_does_not = .false.
   end function it_does_not

   !> Take the state after step number istep of the run; 0 is the first state. Lanes may be retired here.
   subroutine look_away(self, istep, t, state)
      class(streaming_observer), intent(inout) :: self
      integer(i8), intent(in) :: istep
      real(wp), intent(in) :: t
      type(lane_state), intent(inout) :: state
   end subroutine look_away

   !> The block is done: write results that are known only now into the table. This default writes none.
   subroutine nothing_more(self, state)
      class(streaming_observer), intent(inout) :: self
      type(lane_state), intent(in) :: state
   end subroutine nothing_more

   !> Deliver the tables of a block. Called by one thread at a time.
   subroutine end_block(self)
      class(streaming_observer), intent(inout) :: self
      integer :: i

      if (.not. allocated(self%pieces)) return
      do i = 1, self%npiece
         call insert_node(self%store%tree, self%pieces(i))
      end do
      deallocate (self%pieces)
   end subroutine end_block

   !> Deliver results: this thread has no further block. Called by one thread at a time.
   subroutine gather(self)
      class(streaming_observer), intent(inout) :: self

      if (.not. allocated(self%counts)) return
      if (allocated(self%store%counts)) then
         call self%join(self%store%counts, self%store%singles, self%counts, self%singles)
         deallocate (self%counts, self%singles)
      else
         call move_alloc(self%counts, self%store%counts)
         call move_alloc(self%singles, self%store%singles)
      end if
   end subroutine gather

   !> Integers and numbers of single paths before any path.
   subroutine to_zero(self, counts, singles)
      class(streaming_observer), intent(in) :: self
      integer(i8), intent(out) :: counts(:)
      real(wp), intent(out) :: singles(:)

      counts = 0
      singles = 0
   end subroutine to_zero

   !> Add counts and numbers of other paths.
   subroutine add_up(self, counts, singles, more_counts, more_singles)
      class(streaming_observer), intent(in) :: self
      integer(i8), intent(inout) :: counts(:)
      real(wp), intent(inout) :: singles(:)
      integer(i8), intent(in) :: more_counts(:)
      real(wp), intent(in) :: more_singles(:)

      counts = counts + more_counts
   end subroutine add_up

   !> Number of eight-byte numbers that nthread threads hold at most during a run of npath paths.
   real(wp) function numbers(self, npath, nthread)
      class(streaming_observer), intent(in) :: self
      integer(i8), intent(in) :: npath
      integer, intent(in) :: nthread
      real(wp) :: table, pieces, waiting

      table = real(self%nrow, wp)*(row_size(self%ncolumn, self%kept) + self%ncolumn)
      pieces = merge(1, 2*exponent(real(self%run%nlane, wp)), mod(npath, 256_i8) == 0)
      waiting = exponent(real(npath, wp))
      numbers = (nthread + 1)*real(self%ncount + self%nsingle, wp) + (nthread*pieces + waiting + 2)*table
   end function numbers

   !> Numbers in a stored row of the table: n, means, and sums of squares or of all pairs.
   pure integer function row_size(ncolumn, kept)
      integer, intent(in) :: ncolumn, kept

      row_size = 1 + ncolumn + merge(ncolumn, kept*pair_count(ncolumn), kept == means_only)
   end function row_size

   !> Numbers in all stored data except the integers.
   pure integer(i8) function nsum(self)
      class(streaming_observer), intent(in) :: self

      nsum = self%nsingle + int(self%nrow, i8)*row_size(self%ncolumn, self%kept)
   end function nsum

   !> Write numbers of single paths and the table into one array.
   subroutine to_sums(self, singles, table, sums)
      class(streaming_observer), intent(in) :: self
      real(wp), intent(in) :: singles(:)             !! (nsingle)
      type(moment_node), intent(in) :: table         !! empty if no block was run
      real(wp), intent(out) :: sums(:)               !! (nsum)
      integer(i8) :: at
      integer :: i, n

      sums = 0
      sums(:self%nsingle) = singles
      if (.not. allocated(table%n)) return
      n = self%ncolumn
      do i = 1, self%nrow
         at = self%nsingle + int(i - 1, i8)*row_size(n, self%kept)
         sums(at + 1) = table%n(i)
         sums(at + 2:at + 1 + n) = table%mean(:, i)
         if (self%kept == means_only) then
            sums(at + 2 + n:at + 1 + 2*n) = table%m2(:, i)
         else
            sums(at + 2 + n:at + 1 + n + size(table%pairs, 1)) = table%pairs(:, i)
         end if
      end do
   end subroutine to_sums

   !> Make the table, as a node of the tree, from an array of to_sums.
   subroutine to_table(self, sums, table)
      class(streaming_observer), intent(in) :: self
      real(wp), intent(in) :: sums(:)                !! (nsum)
      type(moment_node), intent(out) :: table
      integer(i8) :: at
      integer :: i, j, n, npair

      n = self%ncolumn
      npair = self%kept*pair_count(n)
      allocate (table%n(self%nrow), table%mean(n, self%nrow), table%m2(n, self%nrow))
      if (self%kept > 0) allocate (table%pairs(npair, self%nrow))
      do i = 1, self%nrow
         at = self%nsingle + int(i - 1, i8)*row_size(n, self%kept)
         table%n(i) = sums(at + 1)
         table%mean(:, i) = sums(at + 2:at + 1 + n)
         if (self%kept == means_only) then
            table%m2(:, i) = sums(at + 2 + n:at + 1 + 2*n)
         else
            table%pairs(:, i) = sums(at + 2 + n:at + 1 + n + npair)
            do j = 1, n
               table%m2(j, i) = table%pairs(self%kept*(pair_place(j, j) - 1) + 1, i)
            end do
         end if
      end do
   end subroutine to_table

end module symsde_ensemble_observe_streaming
