! SPDX-License-Identifier: BSD-3-Clause
!> The exact flow of a linear field, over the time tau,
!>
!>    z' = A z,   z = (q, p)          z <- z + X z,   X = exp(tau A) - 1,   2 ndof rows and columns
!>
!> as of a quadratic part D = z.S z/2 of H, A = J S: J S = (S_pq, S_pp; -S_qq, -S_qp), with decays of momenta, or of
!> oscillators that a matrix of friction couples. X is symplectic to rounding if A = J S.
!>
!> X is a Taylor sum for a time tau/2^k and k doublings, X <- 2 X + X X, once for all steps of one size: of every group
!> of degrees of freedom that A couples by itself, so that no lane multiplies more of them than are coupled. Entries
!> below rounding are left out, and with them all that is far apart in a long chain: those of q beside others of q, and
!> those of p, which have another unit, beside others of p. Four rows that share most of their columns are multiplied
!> together, since a lane is loaded once for all of them.
module symsde_step_open_linear_flow
   use symsde_base_damping, only: damping_type
   use symsde_base_kinds, only: wp
   use symsde_base_matrices, only: exponential_less_one
   use symsde_base_vectors, only: add_times, copy
   implicit none
   private
   public :: linear_flow, new_linear_flow, hamiltonian_field, damped_field, find_groups

   real(wp), parameter :: negligible = scale(1.0_wp, -64)  !! entries, as part of the largest of one unit in their row

   integer, parameter :: together = 4  !! rows, and columns, of one pass over the lanes

   !> Rows of X, and the columns in which some of them have an entry.
   type :: row_group
      integer :: nrow = 0
      integer :: row(together) = 0
      integer, allocatable :: column(:)     !! (column)
      real(wp), allocatable :: entry(:, :)  !! X (together, column)
   end type row_group

   type :: linear_flow
      private
      real(wp), allocatable :: field(:, :)       !! A (2 ndof, 2 ndof)
      integer, allocatable :: group(:)           !! number of the group of each degree of freedom (ndof)
      real(wp), allocatable :: duration(:)       !! tau of each leg, whose matrix follows (nleg)
      integer, allocatable :: from(:, :)         !! row i has the entries from(i)+1 .. from(i+1) (2 ndof + 1, nleg)
      integer, allocatable :: column(:, :)       !! their columns (4 ndof^2, nleg)
      real(wp), allocatable :: entry(:, :)       !! and values, X (4 ndof^2, nleg)
      type(row_group), allocatable :: groups(:, :)  !! the same by rows that are multiplied together (ndof/2 + 1, nleg)
   contains
      procedure :: move
      procedure :: rows
   end type linear_flow

contains

   !> Allocate for nleg durations of a step.
   pure subroutine new_linear_flow(self, field, nleg)
      type(linear_flow), intent(out) :: self
      real(wp), intent(in) :: field(:, :)   !! A [1/time], rows of q before those of p (2 ndof, 2 ndof)
      integer, intent(in) :: nleg
      integer :: n

      n = size(field, 1)
      self%field = field
      allocate (self%group(n/2))
      call find_groups(n/2, field, self%group)
      allocate (self%duration(nleg), source=0.0_wp)
      allocate (self%from(n + 1, nleg), self%column(n**2, nleg), source=0)
      allocate (self%entry(n**2, nleg), source=0.0_wp)
      allocate (self%groups((n + together - 1)/together, nleg))
   end subroutine new_linear_flow

   !> J S, the field of D = z.S z/2.
   pure function hamiltonian_field(s) result(field)
      real(wp), intent(in) :: s(:, :)   !! second derivatives, by q and then by p (2 ndof, 2 ndof)
      real(wp) :: field(size(s, 1), size(s, 1))
      integer :: n

      n = size(s, 1)/2
      field(:n, :) = s(n + 1:, :)
      field(n + 1:, :) = -s(:n, :)
   end function hamiltonian_field

   !> The same with momenta that decay, by rates, or by a matrix of friction where S_qp = 0.
   pure function damped_field(s, damping) result(field)
      real(wp), intent(in) :: s(:, :)   !! second derivatives, by q and then by p (2 ndof, 2 ndof)
      type(damping_type), intent(in) :: damping
      real(wp) :: field(size(s, 1), size(s, 1))
      integer :: n, i

      n = size(s, 1)/2
      field = hamiltonian_field(s)
      if (allocated(damping%rate)) then
         do i = 1, n
            field(n + i, n + i) = field(n + i, n + i) - damping%rate(i)
         end do
      else if (allocated(damping%friction)) then
         field(n + 1:, n + 1:) = field(n + 1:, n + 1:) - matmul(damping%friction, s(n + 1:, n + 1:))
      end if
   end function damped_field

   !> Number the groups of degrees of freedom that a matrix couples, by q or by p: group(i) is the least number of a
   !> degree of freedom that is tied to i.
   pure subroutine find_groups(ndof, a, group)
      integer, intent(in) :: ndof
      real(wp), intent(in) :: a(2*ndof, 2*ndof)
      integer, intent(out) :: group(ndof)
      integer :: i, j, k, first, last

      group = [(i, i=1, ndof)]
      do j = 1, ndof
         do i = 1, ndof
            if (group(i) == group(j)) cycle
            if (max(abs(a(i, j)), abs(a(ndof + i, j)), abs(a(i, ndof + j)), abs(a(ndof + i, ndof + j))) <= 0) cycle
            first = min(group(i), group(j))
            last = max(group(i), group(j))
            do k = 1, ndof
               if (group(k) == last) group(k) = first
            end do
         end do
      end do
   end subroutine find_groups

   !> Move (q + dq, p + dp) over the time tau, leg `leg` of the step.
   pure subroutine move(self, leg, tau, nlane, ndof, q, p, dq, dp)
      class(linear_flow), intent(inout) :: self
      integer, intent(in) :: leg, nlane, ndof
      real(wp), intent(in) :: tau                                   !! duration with its sign [time]
      real(wp), intent(in) :: q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(inout) :: dq(nlane, ndof), dp(nlane, ndof)
      real(wp) :: z(nlane, 2*ndof), moved(nlane, together)
      integer :: g, i, k

      if (abs(tau - self%duration(leg)) > 0) call set_leg(self, leg, tau)
      z(:, :ndof) = q + dq
      z(:, ndof + 1:) = p + dp
      if (nlane == 1) then
         call move_alone(self%groups(:, leg), ndof, z, dq, dp)
         return
      end if
      do g = 1, size(self%groups, 1)
         associate (rows => self%groups(g, leg))
            do i = 1, rows%nrow
               if (rows%row(i) <= ndof) call copy(nlane, dq(:, rows%row(i)), moved(:, i))
               if (rows%row(i) > ndof) call copy(nlane, dp(:, rows%row(i) - ndof), moved(:, i))
            end do
            if (rows%nrow < together) moved(:, rows%nrow + 1:) = 0
            do k = 1, size(rows%column) - together + 1, together
               call add_columns(nlane, rows%entry(:, k:k + together - 1), z(:, rows%column(k)), &
                                z(:, rows%column(k + 1)), z(:, rows%column(k + 2)), z(:, rows%column(k + 3)), &
                                moved(:, 1), moved(:, 2), moved(:, 3), moved(:, 4))
            end do
            do k = k, size(rows%column)
               do i = 1, rows%nrow
                  call add_times(nlane, rows%entry(i, k), z(:, rows%column(k)), moved(:, i))
               end do
            end do
            do i = 1, rows%nrow
               if (rows%row(i) <= ndof) call copy(nlane, moved(:, i), dq(:, rows%row(i)))
               if (rows%row(i) > ndof) call copy(nlane, moved(:, i), dp(:, rows%row(i) - ndof))
            end do
         end associate
      end do
   end subroutine move

   !> Rows of X side by side for a single path, with the bits of a lane of many. Rows that a group lacks have number 0.
   pure subroutine move_alone(groups, ndof, z, dq, dp)
      type(row_group), intent(in) :: groups(:)
      integer, intent(in) :: ndof
      real(wp), intent(in) :: z(2*ndof)
      real(wp), intent(inout) :: dq(ndof), dp(ndof)
      real(wp) :: d(0:2*ndof), moved(together)
      integer :: g, i, k

      d(0) = 0
      d(1:ndof) = dq
      d(ndof + 1:) = dp
      do g = 1, size(groups)
         associate (row => groups(g)%row, column => groups(g)%column, entry => groups(g)%entry)
            moved = d(row)
            do k = 1, size(column)
               do i = 1, together
                  moved(i) = moved(i) + entry(i, k)*z(column(k))
               end do
            end do
            d(row) = moved
         end associate
      end do
      dq = d(1:ndof)
      dp = d(ndof + 1:)
   end subroutine move_alone

   !> X over the time tau, leg `leg` of the step, row after row: x(j, i) is the entry of row i and column j.
   pure subroutine rows(self, leg, tau, x)
      class(linear_flow), intent(inout) :: self
      integer, intent(in) :: leg
      real(wp), intent(in) :: tau
      real(wp), intent(out) :: x(size(self%field, 1), size(self%field, 1))
      integer :: i, k

      if (abs(tau - self%duration(leg)) > 0) call set_leg(self, leg, tau)
      x = 0
      do i = 1, size(x, 2)
         do k = self%from(i, leg) + 1, self%from(i + 1, leg)
            x(self%column(k, leg), i) = self%entry(k, leg)
         end do
      end do
   end subroutine rows

   !> Compute X for a leg: group by group, and then its entries row by row. In a row the position and the momentum of
   !> one degree of freedom stand together.
   pure subroutine set_leg(self, leg, tau)
      type(linear_flow), intent(inout) :: self
      integer, intent(in) :: leg
      real(wp), intent(in) :: tau
      real(wp) :: change(size(self%field, 1), size(self%field, 1))
      integer :: ndof, i, j, k, n

      self%duration(leg) = tau
      ndof = size(self%group)
      change = 0
      do i = 1, ndof
         if (self%group(i) == i) call move_group(ndof, self%group, i, self%field, tau, change)
      end do
      call leave_out(ndof, change)
      n = 0
      do i = 1, 2*ndof
         self%from(i, leg) = n
         do j = 1, ndof
            do k = j, ndof + j, ndof
               if (abs(change(i, k)) <= 0) cycle
               n = n + 1
               self%column(n, leg) = k
               self%entry(n, leg) = change(i, k)
            end do
         end do
      end do
      self%from(2*ndof + 1, leg) = n
      call find_rows(2*ndof, change, self%groups(:, leg))
   end subroutine set_leg

   !> Let entries of X vanish that are below rounding.
   pure subroutine leave_out(ndof, change)
      integer, intent(in) :: ndof
      real(wp), intent(inout) :: change(2*ndof, 2*ndof)
      real(wp) :: least
      integer :: i, j

      do j = 0, ndof, ndof
         do i = 1, 2*ndof
            associate (x => change(i, j + 1:j + ndof))
               least = negligible*maxval(abs(x))
               if ((i > ndof) .eqv. (j > 0)) least = max(negligible, least)  ! beside the state itself
               where (abs(x) <= least) x = 0
            end associate
         end do
      end do
   end subroutine leave_out

   !> Form groups of rows: a row takes those with the fewest entries in further columns, as rows of a band beside each
   !> other, and rows of q and p that hop to every second site.
   pure subroutine find_rows(n, change, groups)
      integer, intent(in) :: n
      real(wp), intent(in) :: change(n, n)      !! X
      type(row_group), intent(inout) :: groups(:)
      logical :: there(n, n), taken(n), union(n)
      integer :: g, i, j, k, next, fewest, cost

      do i = 1, n
         there(:, i) = abs(change(i, :)) > 0
      end do
      taken = .false.
      do g = 1, size(groups)
         associate (rows => groups(g))
            rows%nrow = 0
            rows%row = 0
            union = .false.
            do k = 1, together
               next = 0
               fewest = huge(fewest)
               do i = 1, n
                  if (taken(i)) cycle
                  cost = count(there(:, i) .neqv. union)
                  if (cost >= fewest .and. next > 0) cycle
                  next = i
                  fewest = cost
                  if (k == 1) exit
               end do
               if (next == 0) exit
               taken(next) = .true.
               union = union .or. there(:, next)
               rows%nrow = k
               rows%row(k) = next
            end do
            rows%column = pack([(j, j=1, n)], union)
            rows%entry = spread([(0.0_wp, j=1, together)], 2, size(rows%column))
            do k = 1, rows%nrow
               do j = 1, size(rows%column)
                  if (there(rows%column(j), rows%row(k))) rows%entry(k, j) = change(rows%row(k), rows%column(j))
               end do
            end do
         end associate
      end do
   end subroutine find_rows

   !> The rows and columns of X that belong to one group.
   pure subroutine move_group(ndof, group, number, field, tau, change)
      integer, intent(in) :: ndof, group(ndof), number
      real(wp), intent(in) :: field(2*ndof, 2*ndof), tau
      real(wp), intent(inout) :: change(2*ndof, 2*ndof)
      real(wp), allocatable :: own(:, :), x(:, :)
      integer :: place(2*ndof), i, j, n

      n = 0
      do i = 1, 2*ndof
         if (group(merge(i, i - ndof, i <= ndof)) /= number) cycle
         n = n + 1
         place(n) = i
      end do
      allocate (own(n, n), x(n, n))
      do j = 1, n
         do i = 1, n
            own(i, j) = field(place(i), place(j))
         end do
      end do
      call exponential_less_one(n, own, tau, x)
      do j = 1, n
         do i = 1, n
            change(place(i), place(j)) = x(i, j)
         end do
      end do
   end subroutine move_group

   ! ---- kernels ----------------------------------------------------------------------------------

   !> VEC Add four columns of a matrix, times x of each, to four rows, one product after the other.
   pure subroutine add_columns(n, e, x1, x2, x3, x4, y1, y2, y3, y4)
      integer, intent(in) :: n
      real(wp), intent(in) :: e(together, together)   !! e(row, column)
      real(wp), intent(in), dimension(n) :: x1, x2, x3, x4
      real(wp), intent(inout), dimension(n) :: y1, y2, y3, y4
      real(wp) :: a1, a2, a3, a4
      integer :: i

      do i = 1, n
         a1 = y1(i) + e(1, 1)*x1(i)
         a2 = y2(i) + e(2, 1)*x1(i)
         a3 = y3(i) + e(3, 1)*x1(i)
         a4 = y4(i) + e(4, 1)*x1(i)
         a1 = a1 + e(1, 2)*x2(i)
         a2 = a2 + e(2, 2)*x2(i)
         a3 = a3 + e(3, 2)*x2(i)
         a4 = a4 + e(4, 2)*x2(i)
         a1 = a1 + e(1, 3)*x3(i)
         a2 = a2 + e(2, 3)*x3(i)
         a3 = a3 + e(3, 3)*x3(i)
         a4 = a4 + e(4, 3)*x3(i)
         y1(i) = a1 + e(1, 4)*x4(i)
         y2(i) = a2 + e(2, 4)*x4(i)
         y3(i) = a3 + e(3, 4)*x4(i)
         y4(i) = a4 + e(4, 4)*x4(i)
      end do
   end subroutine add_columns

end module symsde_step_open_linear_flow
