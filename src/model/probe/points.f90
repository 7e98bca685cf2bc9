! SPDX-License-Identifier: BSD-3-Clause
!>    Hess S v ~ (g(x + e v) - g(x - e v))/(2 e),     g = grad S,   S = sum_j w_j H_j,   x = (q, p)
!>    e = eps^(1/3) max(1, |x|)  and  e = eps^(1/3)/4:  trusted where both agree
!>
!> The points, sums and directions of a probe, and differences with a test of their reliability.
!>
!> Every model has gradients, and second differences of values would lose more digits. A central difference has the
!> truncation error e^2 and the rounding error eps/e; e = eps^(1/3) makes their sum smallest. Two steps are needed since
!> the model's unit of length is unknown: if they disagree, neither is trusted.
!>
!> Three points are probed at once, one per lane: the initial state and two displaced from it by fixed pseudo-random
!> amounts of order one. All further lanes repeat the last point. Nothing here is random: the same model is always
!> probed in the same way.
!>
!> Private to its family.
module symsde_model_probe_points
   use symsde_base_kinds, only: wp
   use symsde_base_lanes, only: nlane => lane_unit
   use symsde_base_text, only: to_text
   use symsde_model_abstract, only: model_type, difference_along, default_step
   implicit none
   private
   public :: no_verdict, probe_points, new_probe_points, nlane, npoint, finding, generic, worst, largest_entry, &
             largest_component, too_far

   ! Three points distinguish a constant from a function that takes the same value twice by accident.
   integer, parameter :: npoint = 3          !! lanes 1 .. npoint are different points
   integer, parameter :: probed_alone = 16   !! noises probed one by one; all further ones in one sum
   ! This displacement, relative to the state, is large enough for terms of higher degree to show, and small enough that
   ! a user's functions are probably defined there.
   real(wp), parameter :: displacement = 0.3_wp
   real(wp), parameter :: no_verdict = -1     !! scale of lanes that are not judged
   real(wp), parameter :: too_far = 1.0e6_wp  !! state at which a step of 1e-6 has no digits left

   type :: probe_points
      class(model_type), pointer :: model => null()
      integer :: ndof = 0, nnoise = 0
      real(wp) :: t = 0
      real(wp), allocatable :: q(:, :), p(:, :)    !! the points (nlane, ndof)
      real(wp), allocatable :: w(:, :)             !! weights of the probed sum (nlane, 0:nnoise)
      real(wp), allocatable :: vq(:, :), vp(:, :)  !! a direction without zeros (nlane, ndof)
      real(wp), allocatable :: zero(:, :)          !! the zero direction
      real(wp) :: slope(nlane) = 0                 !! largest component of the gradient of the sum
      character(:), allocatable :: sum_name        !! name of the probed sum, for messages
   contains
      procedure :: last_sum
      procedure :: take_sum
      procedure :: take_all
      procedure :: gradient
      procedure :: product
      procedure :: row_of_hessian
      procedure :: slope_of_values
      procedure :: entry_name
      procedure :: place
   end type probe_points

   !> A quantity that should vanish but does not: at a point, in one component of q (half 1) or p (half 2).
   type :: finding
      integer :: lane = 0  !! 0 = nothing found
      integer :: half = 1
      integer :: i = 0
   end type finding

contains

   !> Make the points around an initial state.
   subroutine new_probe_points(self, model, t, q0, p0)
      type(probe_points), intent(out) :: self
      class(model_type), intent(in), target :: model
      real(wp), intent(in) :: t, q0(:), p0(:)
      integer :: i, lane

      self%model => model
      self%ndof = model%traits%ndof
      self%nnoise = model%traits%nnoise
      self%t = t
      associate (n => self%ndof)
         allocate (self%q(nlane, n), self%p(nlane, n), self%vq(nlane, n), self%vp(nlane, n))
         allocate (self%w(nlane, 0:self%nnoise), self%zero(nlane, n))
      end associate
      self%zero = 0
      do i = 1, self%ndof
         ! The direction is the same at all points; states differ in every coordinate.
         self%vq(:, i) = generic(i, 0)
         self%vp(:, i) = generic(i, 5)
         self%q(1, i) = q0(i)
         self%p(1, i) = p0(i)
         do lane = 2, npoint
            self%q(lane, i) = displaced(q0(i), i, lane)
            self%p(lane, i) = displaced(p0(i), i, lane + 5)
         end do
         ! Models are called with nlane lanes; lanes past the points repeat the last point.
         self%q(npoint + 1:, i) = self%q(npoint, i)
         self%p(npoint + 1:, i) = self%p(npoint, i)
      end do
   end subroutine new_probe_points

   !> The coordinate x, displaced by a pseudo-random part of its size, or of one if it is smaller. The numbers are
   !> fixed, so that a refusal can be repeated.
   pure real(wp) function displaced(x, i, salt)
      real(wp), intent(in) :: x
      integer, intent(in) :: i, salt

      displaced = x + displacement*max(1.0_wp, abs(x))*generic(i, salt)
   end function displaced

   !> A number of size 1/2 to 1 and of either sign, equidistributed over i, so that sums of such multiples do not vanish
   !> by accident.
   pure real(wp) function generic(i, salt)
      integer, intent(in) :: i, salt
      real(wp), parameter :: golden = 0.618033988749894848_wp, silver = 0.414213562373095049_wp

      ! Multiples of two irrational numbers are taken modulo one; the sign follows from another combination of them.
      generic = 0.5_wp + 0.5_wp*fraction_of(i*golden + salt*silver)
      if (fraction_of(i*silver + salt*golden) < 0.5_wp) generic = -generic
   end function generic

   !> The fractional part of a number >= 0; modulo(x, 1) is a call, which takes ten times as long.
   pure real(wp) function fraction_of(x)
      real(wp), intent(in) :: x

      fraction_of = x - aint(x)
   end function fraction_of

   !> Sums are numbered from 0; sum 0 is H_0, the following ones are of noises.
   pure integer function last_sum(self)
      class(probe_points), intent(in) :: self

      !   0: H,    1 .. 16: H_1 .. H_16,    17: a sum of H_17 .. H_m
      last_sum = min(self%nnoise, probed_alone + 1)
   end function last_sum

   !> Probe sum k from now on: H_k alone, or all noises past the first sixteen together.
   subroutine take_sum(self, k)
      class(probe_points), intent(inout) :: self
      integer, intent(in) :: k  !! number of the sum, 0 .. last_sum()

      self%w = 0
      if (k <= probed_alone) then
         self%w(:, k) = 1
         self%sum_name = 'H_'//to_text(k)
      else
         call mix(self, k)
      end if
      call find_slope(self)
   end subroutine take_sum

   !> Probe one sum of all Hamiltonians from now on.
   subroutine take_all(self)
      class(probe_points), intent(inout) :: self

      self%w = 0
      call mix(self, 0)
      call find_slope(self)
   end subroutine take_all

   !> Find the size of the gradient of the sum, which is the scale for every product.
   subroutine find_slope(self)
      type(probe_points), intent(inout) :: self
      real(wp), allocatable :: hq(:, :), hp(:, :)

      call self%gradient(hq, hp, self%slope)
   end subroutine find_slope

   !> Give all Hamiltonians from H_first on nonzero weights, and name their sum for messages.
   subroutine mix(self, first)
      type(probe_points), intent(inout) :: self
      integer, intent(in) :: first
      integer :: k

      do k = first, self%nnoise
         ! The weights are of size 1/2 to 1 and irregular, so that no Hamiltonian compensates the violation of another.
         self%w(:, k) = generic(k + 1, 1)
      end do
      self%sum_name = '(a sum of H_'//to_text(first)//' .. H_'//to_text(self%nnoise)//')'
   end subroutine mix

   !> The gradient of the sum at the points, and its size there.
   subroutine gradient(self, hq, hp, scale)
      class(probe_points), intent(in) :: self
      real(wp), allocatable, intent(out) :: hq(:, :), hp(:, :)  !! (nlane, ndof)
      real(wp), intent(out) :: scale(nlane)                     !! largest component of the gradient

      allocate (hq(nlane, self%ndof), hp(nlane, self%ndof))
      call self%model%gradient(nlane, self%ndof, self%nnoise, self%t, self%w, self%q, self%p, &
                               hq, hp)
      call largest_component(self%ndof, hq, hp, scale)
   end subroutine gradient

   !> The Hessian of the sum times (vq, vp), by differences of gradients with two steps, one in proportion to the state
   !> and one not. A difference is trusted only if both agree: lanes in which they disagree, or whose state is too large
   !> for the second step, get the scale no_verdict.
   !>
   !> The first difference alone costs half, and most products refute nothing. So callers may first pass sure = .false.,
   !> and compute both differences only if the first one refutes a trait: a trait that the first difference does not
   !> refute is not refuted by both, either.
   subroutine product(self, vq, vp, uq, up, scale, sure)
      class(probe_points), intent(in) :: self
      real(wp), intent(in) :: vq(nlane, self%ndof), vp(nlane, self%ndof)
      real(wp), allocatable, intent(out) :: uq(:, :), up(:, :)  !! (nlane, ndof)
      real(wp), intent(out) :: scale(nlane)  !! size that an entry of the product is compared with
      logical, intent(in), optional :: sure  !! .false.: first difference only
      real(wp), parameter :: agreement = 1.0e-5_wp
      real(wp), allocatable :: xq(:, :), xp(:, :)
      real(wp), dimension(nlane) :: apart, state, step

      call largest_component(self%ndof, self%q, self%p, state)
      step = default_step*max(1.0_wp, state)
      ! This step suits functions that vary over the length of the state.
      call difference(self, step, vq, vp, uq, up)
      call largest_component(self%ndof, uq, up, scale)
      ! An entry is compared with the largest entry of the product, or with the gradient over the length of the state if
      ! that is larger. For a linear sum all entries are rounding, and the gradient alone gives a scale.
      scale = max(scale, self%slope/max(1.0_wp, state)) + 0*(scale + self%slope)
      if (present(sure)) then
         if (.not. sure) return
      end if
      step = default_step/4
      ! This step suits functions that vary over lengths of one, such as sines far from the origin.
      call difference(self, step, vq, vp, xq, xp)
      ! Compute how far the two differences are apart.
      xq = uq - xq
      xp = up - xp
      call largest_component(self%ndof, xq, xp, apart)
      ! The condition is written so that NaN gives no verdict.
      where (.not. (apart <= agreement*scale .and. state <= too_far)) scale = no_verdict
   end subroutine product

   !> The Hessian of the sum times (vq, vp), by one difference with a separate step in every lane.
   subroutine difference(self, step, vq, vp, uq, up)
      type(probe_points), intent(in) :: self
      real(wp), intent(in) :: step(nlane), vq(nlane, self%ndof), vp(nlane, self%ndof)
      real(wp), allocatable, intent(out) :: uq(:, :), up(:, :)

      allocate (uq, up, mold=self%zero)
      call difference_along(self%model, nlane, self%ndof, self%nnoise, step, self%t, self%w, &
                            self%q, self%p, vq, vp, uq, up)
   end subroutine difference

   !> The largest component of a pair of vectors, lane by lane; not finite if any component is not.
   pure subroutine largest_component(ndof, xq, xp, size)
      integer, intent(in) :: ndof
      real(wp), intent(in) :: xq(nlane, ndof), xp(nlane, ndof)
      real(wp), intent(out) :: size(nlane)
      real(wp) :: poison(nlane)
      integer :: i

      size = 0
      poison = 0
      do i = 1, ndof
         size = max(size, abs(xq(:, i)), abs(xp(:, i)))
         poison = poison + 0*xq(:, i) + 0*xp(:, i)  ! max may ignore NaN
      end do
      size = size + poison
   end subroutine largest_component

   !> The component of (uq, up) that is largest relative to the scale of its lane, if it exceeds the tolerance;
   !> found%lane = 0 if none does. Components that are not finite are skipped, and so are lanes whose scale is not
   !> finite or is no_verdict. For a scale of zero any nonzero component exceeds the tolerance.
   pure subroutine worst(uq, up, scale, tolerance, found)
      real(wp), intent(in) :: uq(:, :), up(:, :)  !! (nlane, ndof)
      real(wp), intent(in) :: scale(nlane), tolerance
      type(finding), intent(out) :: found
      real(wp) :: excess
      integer :: i, lane

      ! excess is the largest ratio so far, which the next component must exceed.
      excess = tolerance
      do i = 1, size(uq, 2)
         do lane = 1, npoint
            ! This skips no_verdict, which is negative, and NaN.
            if (.not. scale(lane) >= 0) cycle
            if (abs(uq(lane, i)) > excess*scale(lane)) then
               ! tiny replaces a scale of zero, for which any nonzero number is too large.
               found = finding(lane, 1, i)
               excess = abs(uq(lane, i))/max(scale(lane), tiny(excess))
            end if
            if (abs(up(lane, i)) > excess*scale(lane)) then
               found = finding(lane, 2, i)
               excess = abs(up(lane, i))/max(scale(lane), tiny(excess))
            end if
         end do
      end do
   end subroutine worst

   !> The largest entry of a row (uq, up) at one point.
   pure function largest_entry(lane, uq, up) result(column)
      integer, intent(in) :: lane
      real(wp), intent(in) :: uq(:, :), up(:, :)  !! (nlane, ndof)
      type(finding) :: column
      integer :: iq, ip

      iq = maxloc(abs(uq(lane, :)), dim=1)
      ip = maxloc(abs(up(lane, :)), dim=1)
      column = finding(lane, 1, iq)
      if (abs(up(lane, ip)) > abs(uq(lane, iq))) column = finding(lane, 2, ip)
   end function largest_entry

   !> The row of the Hessian of the sum to which a component belongs, by its product with a unit vector. This product is
   !> the column, which equals the row, since the Hessian is symmetric.
   subroutine row_of_hessian(self, row, uq, up)
      class(probe_points), intent(in) :: self
      type(finding), intent(in) :: row
      real(wp), allocatable, intent(out) :: uq(:, :), up(:, :)  !! (nlane, ndof)
      real(wp), allocatable :: unit(:, :)
      real(wp) :: scale(nlane)

      allocate (unit, source=self%zero)
      ! The vector is the unit vector of q_i or of p_i at all points.
      unit(:, row%i) = 1
      if (row%half == 1) call self%product(unit, self%zero, uq, up, scale)
      if (row%half == 2) call self%product(self%zero, unit, uq, up, scale)
   end subroutine row_of_hessian

   !> The rate at which the values of the sum change along the direction (vq, vp), by central differences with two steps
   !> as in `product`, and the size of the values. `apart` is huge if the state is too large for the second step.
   subroutine slope_of_values(self, slope, apart, values)
      class(probe_points), intent(in) :: self
      real(wp), intent(out) :: slope(nlane)   !! the rate by the first step
      real(wp), intent(out) :: apart(nlane)   !! difference from the rate by the second step
      real(wp), intent(out) :: values(nlane)  !! size of the values
      real(wp), dimension(nlane) :: state, step, other

      call largest_component(self%ndof, self%q, self%p, state)
      step = default_step*max(1.0_wp, state)
      call slope_with(self, step, slope, values)
      step = default_step/4
      call slope_with(self, step, other, values)
      ! If the two steps disagree, callers do not judge.
      apart = abs(slope - other)
      where (.not. state <= too_far) apart = huge(apart)
   end subroutine slope_of_values

   !> The rate by one central difference, and the larger size of the two subtracted values.
   subroutine slope_with(self, step, slope, values)
      type(probe_points), intent(in) :: self
      real(wp), intent(in) :: step(nlane)
      real(wp), intent(out) :: slope(nlane), values(nlane)
      real(wp), allocatable :: x(:, :), y(:, :)
      real(wp) :: lower(nlane)
      integer :: i, sign

      allocate (x, y, mold=self%zero)
      !   (S(x + e v) - S(x - e v))/(2 e)
      do sign = -1, 1, 2
         do i = 1, self%ndof
            x(:, i) = self%q(:, i) + sign*step*self%vq(:, i)
            y(:, i) = self%p(:, i) + sign*step*self%vp(:, i)
         end do
         call self%model%value(nlane, self%ndof, self%nnoise, self%t, self%w, x, y, values)
         ! Keep the lower end while `values` is filled with the upper end.
         if (sign < 0) lower = values
      end do
      slope = (values - lower)/(2*step)
      values = max(abs(values), abs(lower))
   end subroutine slope_with

   !> A degree of freedom of a point in words, such as q_2 = 0.5, p_2 = 1.
   pure character(len=80) function coordinates(i, q, p) result(text)
      integer, intent(in) :: i
      real(wp), intent(in) :: q, p

      text = 'q_'//to_text(i)//' = '//to_text(q)//', p_'//to_text(i)//' = '//to_text(p)
   end function coordinates

   !> The result of `place`, padded with blanks: `place` takes its length from this text.
   pure character(len=192) function padded_place(self, lane, i, j) result(text)
      class(probe_points), intent(in) :: self
      integer, intent(in) :: lane, i, j

      text = coordinates(i, self%q(lane, i), self%p(lane, i))
      if (j /= i) text = trim(text)//', '//coordinates(j, self%q(lane, j), self%p(lane, j))
   end function padded_place

   !> The result of `entry_name`, padded with blanks: `entry_name` takes its length from this text.
   pure character(len=128) function padded_entry(sum_name, row, column) result(text)
      character(*), intent(in) :: sum_name
      type(finding), intent(in) :: row, column

      text = 'd2'//sum_name//'/d'//variable(row%half)//'_'//to_text(row%i)//'d'//variable(column%half)
      if (column%i > 0) text = trim(text)//'_'//to_text(column%i)
   end function padded_entry

   !> The name of a second derivative of the sum, such as d2H_1/dq_1dp_2; column 0 means the whole row.
   pure function entry_name(self, row, column) result(text)
      class(probe_points), intent(in) :: self
      type(finding), intent(in) :: row, column
      character(len=len_trim(padded_entry(self%sum_name, row, column))) :: text

      text = padded_entry(self%sum_name, row, column)
   end function entry_name

   !> The position of a point in words: its coordinates in the degrees of freedom i and j, given once if i = j.
   pure function place(self, lane, i, j) result(text)
      class(probe_points), intent(in) :: self
      integer, intent(in) :: lane, i, j
      character(len=len_trim(padded_place(self, lane, i, j))) :: text

      text = padded_place(self, lane, i, j)
   end function place

   !> The letter of one half of the phase space, q or p.
   pure character(len=1) function variable(half)
      integer, intent(in) :: half

      variable = merge('q', 'p', half == 1)
   end function variable

end module symsde_model_probe_points
