! SPDX-License-Identifier: BSD-3-Clause
!> Increments given by the user, one row per step; with refine = l > 0, 2^l finer rows per step, added as a tree.
!>
!> Schemes that use functionals need them as further columns beside the increments: dW_1 .. dW_m, dZ_1 .. dZ_m, and K_1
!> .. K_m of each row; or they need finer rows: the path is then the polygon through the rows, whose functionals are
!> exact (the mean-square error against the Brownian path is h^3/(12 4^l) in dZ and h^2/(4 2^l) in an area). Finer rows
!> with functionals merge to those of the step. The noise of decaying momenta, D = (dW - E)/gamma, takes further columns
!> of E_k = int exp(-gamma u) dW_k, u being the time to the end of the row; without them, or where gamma times the row
!> is so small that E and dW have too many digits in common, D is that of the cubic with this dW, dZ and K.
!>
!> The first row belongs to step first_step; step n has the rows
!>
!>    (n - first_step) 2^l + 1  ..  (n - first_step + 1) 2^l.
!>
!> Requests are for pairs of steps counted from step 0, so a pair may reach beyond the rows at both ends: steps without
!> rows are left as they are in the store.
module symsde_noise_prescribed
   use symsde_base_contracts, only: contracts_are_executed
   use symsde_base_functionals, only: nfunctional, path_decay
   use symsde_base_interrupt, only: interrupt_type
   use symsde_base_kinds, only: wp, i8
   use symsde_base_record, only: step_request, step_store
   use symsde_noise_contract, only: require_request, require_filled
   use symsde_noise_functionals, only: path_interval, new_path_interval, shape_values, decay_values, &
                                       merge_intervals, clip_increments, clip_interval
   use symsde_noise_given, only: given_increments
   use symsde_noise_source, only: noise_type
   implicit none
   private
   public :: prescribed_noise, new_prescribed_noise

   !> Smallest gamma h of a row whose E is used: below it rounding of (dW - E)/gamma exceeds what E tells beyond K.
   real(wp), parameter :: least_decay = 3e-5_wp

   type, extends(noise_type) :: prescribed_noise
      private
      integer(i8) :: first_path = 0, first_step = 0
      integer :: refine = 0
      real(wp) :: h = 0                             !! step with its sign, for dZ [time]
      type(given_increments) :: dw                  !! (npath or 1, nnoise or up to four times as many, nstep*2^refine)
   contains
      procedure :: fill => fill_prescribed
   end type prescribed_noise

contains

   !> Make a source that reads the user's memory: its path 1 is first_path, its first row is first_step. Nothing is
   !> copied: it must live as long as the source.
   subroutine new_prescribed_noise(self, dw, first_path, first_step, refine, h, nnoise)
      type(prescribed_noise), intent(out) :: self
      !> (npath or 1, columns, rows), with nnoise columns of dW, then as many of dZ, of K, and of E, if given
      type(given_increments), intent(in) :: dw
      integer(i8), intent(in) :: first_path, first_step
      integer, intent(in) :: refine  !! 0 or more
      real(wp), intent(in), optional :: h  !! step of the run, needed for dZ [time]
      integer, intent(in), optional :: nnoise  !! m; all columns are increments if absent

      ! Without functionals no length is needed.
      if (present(h)) self%h = h
      ! The number of columns does not determine m if dZ or K are among them, so nnoise must then be given.
      self%nnoise = int(dw%extent(2))
      if (present(nnoise)) self%nnoise = nnoise
      self%dw = dw
      self%first_path = first_path
      self%first_step = first_step
      self%refine = refine
      allocate (self%silent(self%nnoise), source=.false.)
      allocate (self%common(self%nnoise), source=.false.)
   end subroutine new_prescribed_noise

   !> Fill the steps of a request from the user's memory. Nothing is drawn, so the interrupt is not checked; it is set
   !> where a number is not finite: such rows drive no step.
   subroutine fill_prescribed(self, request, store, drawn, interrupt)
      class(prescribed_noise), intent(in) :: self
      type(step_request), intent(in) :: request
      type(step_store), intent(inout) :: store
      integer(i8), intent(out) :: drawn
      class(interrupt_type), intent(inout), target, optional :: interrupt
      integer(i8) :: row, rows
      integer :: i, first, last
      logical :: finite

      if (contracts_are_executed) call require_request(self, request, store)
      drawn = 0
      finite = .true.
      rows = 2_i8**self%refine
      row = (2*request%pair - self%first_step)*rows + 1
      ! Rows of the run; row is that of the request's first step, and may be negative. Steps before the first row or
      ! after the last are skipped.
      first = int(max(0_i8, (rows - row)/rows))
      last = int(min(2_i8*request%npair, (self%dw%extent(3) + 1 - row)/rows)) - 1
      ! The array holds none of these steps.
      if (last < first) return
      ! With one row per step and no functional, all steps are copied at once, otherwise one by one.
      row = row + first*rows
      if (self%asked%is_empty() .and. rows == 1) then
         call take_rows(self, request%nlane, request%path, 1, self%nnoise, row, last - first + 1, 1, &
                        store%w(1, 0, first), finite)
         ! The bound of a truncated run holds for given increments, too.
         if (self%bound < huge(1.0_wp)) then
            do i = first, last
               call clip_increments(request%nlane*self%nnoise, self%bound, store%w(:, 1:, i))
            end do
         end if
      else
         do i = first, last
            ! Rows of a step follow those of the step before.
            call fill_step(self, request%nlane, request%path, row, rows, i, store, finite)
            row = row + rows
         end do
      end if
      if (present(interrupt)) interrupt%wanted = interrupt%wanted .or. .not. finite
      if (contracts_are_executed) call require_filled(self, request, store, first, last, interrupt)
   end subroutine fill_prescribed

   !> Make the increments of one step, the sum of its rows, and functionals of the polygon through the rows, truncated
   !> as those of a Brownian source.
   subroutine fill_step(self, nlane, path, row, rows, i, store, finite)
      class(prescribed_noise), intent(in) :: self
      integer, intent(in) :: nlane, i
      integer(i8), intent(in) :: path(nlane), row, rows
      type(step_store), intent(inout) :: store
      logical, intent(inout) :: finite
      type(path_interval) :: whole
      integer :: k, f

      if (self%asked%is_empty()) then
         do k = 1, self%nnoise
            call sum_rows(self, nlane, path, k, row, rows, store%w(:, k, i), finite)
         end do
         if (self%bound < huge(1.0_wp)) call clip_increments(nlane*self%nnoise, self%bound, store%w(:, 1:, i))
         return
      end if
      ! Functionals need the path through the rows, not only the sum.
      call polygon(self, nlane, path, row, rows, whole, finite)
      if (self%bound < huge(1.0_wp)) call clip_interval(nlane, self%nnoise, self%bound, whole)
      store%w(:, 1:, i) = whole%w
      do f = 1, nfunctional
         if (self%asked%has(f)) store%of(f)%x(:, :, i) = whole%of(f)%x
      end do
   end subroutine fill_step

   !> Merge rows row .. row+rows-1 to one interval, by halves. A single row is given by dW, and by dZ and K if present.
   !> Without dZ it is a straight line: H = 0, so that dZ = h dW/2, and its area is zero.
   recursive subroutine polygon(self, nlane, path, row, rows, whole, finite)
      class(prescribed_noise), intent(in) :: self
      integer, intent(in) :: nlane
      integer(i8), intent(in) :: path(nlane), row, rows
      type(path_interval), intent(out) :: whole
      logical, intent(inout) :: finite
      type(path_interval) :: left, right
      real(wp) :: hh(nlane, self%nnoise), kk(nlane, self%nnoise)
      integer :: f

      if (rows > 1) then
         call polygon(self, nlane, path, row, rows/2, left, finite)
         call polygon(self, nlane, path, row + rows/2, rows/2, right, finite)
         ! The left half comes first, and functionals merge in this order.
         call merge_intervals(nlane, self%nnoise, self%asked, left, right, whole)
         return
      end if
      call new_path_interval(whole, nlane, self%nnoise, self%h/2.0_wp**self%refine, self%asked)
      hh = 0
      ! K is zero unless given.
      kk = 0
      associate (m => self%nnoise)
         call take_rows(self, nlane, path, 1, m, row, 1, 0, whole%w, finite)
         if (self%dw%extent(2) > m) then
            ! hh holds dZ first, then H = dZ/h - dW/2.
            call take_rows(self, nlane, path, m + 1, m, row, 1, 0, hh, finite)
            hh = hh/whole%length - 0.5_wp*whole%w
         end if
         ! K is used as given; without K the row is a parabola, and without dZ, too, a straight line.
         if (self%dw%extent(2) > 2*m) call take_rows(self, nlane, path, 2*m + 1, m, row, 1, 0, kk, finite)
      end associate
      do f = 1, nfunctional
         if (f == path_decay .and. self%asked%has(f)) then
            call find_decay(self, nlane, path, row, hh, kk, whole, finite)
         else if (self%asked%has(f)) then
            call shape_values(f, self%asked, nlane, self%nnoise, whole%length, whole%w, hh, x=whole%of(f)%x, kk=kk)
         end if
      end do
   end subroutine polygon

   !> D of a row, by its E if that is given and tells more than dW, H and K.
   subroutine find_decay(self, nlane, path, row, hh, kk, whole, finite)
      class(prescribed_noise), intent(in) :: self
      integer, intent(in) :: nlane
      integer(i8), intent(in) :: path(nlane), row
      real(wp), intent(in) :: hh(nlane, self%nnoise), kk(nlane, self%nnoise)
      type(path_interval), intent(inout) :: whole
      logical, intent(inout) :: finite

      associate (m => self%nnoise, x => whole%of(path_decay)%x)
         if (self%dw%extent(2) > 3*m .and. abs(whole%rate*whole%length) > least_decay) then
            call take_rows(self, nlane, path, 3*m + 1, m, row, 1, 0, x, finite)
            x = (whole%w - x)/whole%rate
         else
            call decay_values(nlane, m, whole%length, whole%rate, whole%w, hh, kk, x)
         end if
      end associate
   end subroutine find_decay

   !> Sum rows row .. row+rows-1 of noise k as a balanced binary tree, as the Brownian source adds its draws: its
   !> increments, written out and read as rows, give the same bits.
   recursive subroutine sum_rows(self, nlane, path, k, row, rows, dw, finite)
      class(prescribed_noise), intent(in) :: self
      integer, intent(in) :: nlane, k
      integer(i8), intent(in) :: path(nlane), row, rows
      real(wp), intent(out) :: dw(nlane)
      logical, intent(inout) :: finite
      real(wp) :: right(nlane)

      if (rows > 1) then
         call sum_rows(self, nlane, path, k, row, rows/2, dw, finite)
         call sum_rows(self, nlane, path, k, row + rows/2, rows/2, right, finite)
         ! Sums are formed by halves, like the tree of noise/levels.
         dw = dw + right
      else
         call take_rows(self, nlane, path, k, 1, row, 1, 0, dw, finite)
      end if
   end subroutine sum_rows

   !> Copy columns column .. column+n-1 of nrow rows to dw (nlane, n, nrow), behind `lead` columns that are left alone.
   subroutine take_rows(self, nlane, path, column, n, row, nrow, lead, dw, finite)
      class(prescribed_noise), intent(in) :: self
      integer, intent(in) :: nlane, column, n, nrow
      integer(i8), intent(in) :: path(nlane), row  !! padding repeats the last
      integer, intent(in) :: lead                  !! columns before those that are written
      real(wp), intent(inout) :: dw(nlane, 1 - lead:n, nrow)
      logical, intent(inout) :: finite
      integer(i8) :: here(nlane)

      ! A single path in the array serves all lanes.
      here = merge(1_i8, path - self%first_path + 1, self%dw%extent(1) == 1)
      call self%dw%take(nlane, here, column, n, row, nrow, lead, dw, finite)
   end subroutine take_rows

end module symsde_noise_prescribed
