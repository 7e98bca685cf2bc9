! SPDX-License-Identifier: BSD-3-Clause
!>    S = sum_j w_j H_j,    g = grad S = (S_q, S_p),    Dg = Hess S = (Hess S)^T
!>
!> The probe of properties that every gradient must have, whatever is declared: it is the gradient of a weighted sum of
!> Hamiltonians, computed in each lane independently.
!>
!>    lane by lane       the gradient of a lane is the same whether all lanes differ or are equal
!>    linear in w        g(0) = 0 and g(w + 2 v) = g(w) + 2 g(v)
!>    of a Hamiltonian   u.(Dg v) = v.(Dg u): the derivative Dg of a gradient is symmetric
!>
!> A model without one of these properties would run, but its results would not obey Hamiltonian equations. The
!> probe takes fourteen gradients in all, whatever the numbers of degrees of freedom and noises: five for lanes and
!> weights, and nine for the symmetry.
!> The five have the weights w, the weights of one lane in all lanes, 0, v and w + 2 v; the nine are one gradient of the
!> sum, for its size, and eight for two products, each by two differences of two gradients.
module symsde_model_probe_gradient
   use symsde_base_kinds, only: wp, i8, unwritten_bits
   use symsde_base_status, only: error_type, raise, false_trait
   use symsde_base_text, only: to_text
   use symsde_model_probe_points, only: probe_points, nlane, npoint, finding, generic, worst, largest_component
   implicit none
   private
   public :: probe_gradient

   character(*), parameter :: here = 'probe_model'
   ! Gradients are compared to six digits, second derivatives by differences to four.
   real(wp), parameter :: vanishing = 1.0e-6_wp  !! differences below this part of the gradient count as rounding
   real(wp), parameter :: matching = 1.0e-4_wp   !! relative mismatch of second derivatives
   integer, parameter :: largest_search = 64     !! ndof up to which the wrong entry is searched

contains

   !> Test the gradient of a model at the points. A gradient that fails is refused (false_trait) with the numbers that
   !> refute it.
   subroutine probe_gradient(points, error)
      type(probe_points), intent(inout) :: points
      type(error_type), allocatable, intent(inout) :: error
      real(wp), allocatable :: w(:, :), v(:, :)             !! weights, different in every lane (nlane, 0:nnoise)
      real(wp), allocatable :: gq(:, :), gp(:, :)           !! gradient at the points with weights w (nlane, ndof)
      real(wp) :: scale(nlane)
      integer :: k, lane

      if (allocated(error)) return
      ! No weight is zero, and the weights of all lanes differ, so that a term with the weight of another lane shows.
      allocate (w, v, mold=points%w)
      do k = 0, points%nnoise
         do lane = 1, nlane
            w(lane, k) = generic(k + 1, 20 + lane)
            v(lane, k) = generic(k + 1, 40 + lane)
         end do
      end do
      ! The outputs hold 0 before this call and 0.7 before all others, so that an output that the model does not write
      ! shows.
      call ask(points, points%q, points%p, w, 0.0_wp, gq, gp, error)
      call largest_component(points%ndof, gq, gp, scale)
      call probe_lanes(points, w, gq, gp, scale, error)
      call probe_weights(points, w, v, gq, gp, scale, error)
      ! Test the symmetry of a single sum of all Hamiltonians first: one test, however many noises there are.
      call points%take_all()
      call probe_symmetry(points, error)
   end subroutine probe_gradient

   !> Call the model's gradient with given states and weights. The outputs hold the number `before` at the call,
   !> another number in the first call than in later ones, so that an unwritten output shows as a difference. The
   !> inputs must come back unchanged.
   subroutine ask(points, q, p, w, before, gq, gp, error)
      type(probe_points), intent(in) :: points
      real(wp), intent(in) :: q(nlane, points%ndof), p(nlane, points%ndof), w(nlane, 0:points%nnoise)
      real(wp), intent(in) :: before
      real(wp), allocatable, intent(out) :: gq(:, :), gp(:, :)  !! (nlane, ndof)
      type(error_type), allocatable, intent(inout) :: error
      real(wp), allocatable :: own_q(:, :), own_p(:, :), own_w(:, :)

      ! The model gets copies, which are compared with the originals afterwards.
      allocate (own_q, source=q)
      allocate (own_p, source=p)
      allocate (own_w, source=w)
      allocate (gq, gp, mold=q)
      gq = before
      gp = before
      call points%model%gradient(nlane, points%ndof, points%nnoise, points%t, own_w, own_q, own_p, gq, gp)
      ! Both comparisons are false for NaN: states at which a model is not finite are skipped.
      if (any(own_q < q .or. own_q > q) .or. any(own_p < p .or. own_p > p) .or. any(own_w < w .or. own_w > w)) &
         call raise(error, false_trait, here, "the gradient of model '"//points%model%name//"' writes into q, p or "// &
                    'w, which are its inputs: work on copies of them')
      call refuse_unwritten(points, gq, gp, error)
   end subroutine ask

   !> Refuse a callback that leaves an output as it was before the call.
   subroutine refuse_unwritten(points, gq, gp, error)
      type(probe_points), intent(in) :: points
      real(wp), intent(in), dimension(nlane, points%ndof) :: gq, gp
      type(error_type), allocatable, intent(inout) :: error
      type(finding) :: bad
      integer :: i, lane

      if (points%model%failure_code() /= 0) return  ! the callback has failed; its own error is reported
      do i = 1, points%ndof
         do lane = 1, nlane
            if (allocated(error)) return
            bad = finding(lane, 0, i)
            if (transfer(gp(lane, i), 0_i8) == unwritten_bits) bad%half = 2
            if (transfer(gq(lane, i), 0_i8) == unwritten_bits) bad%half = 1
            if (bad%half > 0) call refuse(points, 'leaves dS/d'//trim(component(bad))//' unwritten', &
                                          lane, i, 'write all of every output', error)
         end do
      end do
   end subroutine refuse_unwritten

   !> Give one lane's state and weights to all lanes: each must then have the gradient that this lane had among
   !> others.
   subroutine probe_lanes(points, w, gq, gp, scale, error)
      type(probe_points), intent(in) :: points
      real(wp), intent(in) :: w(nlane, 0:points%nnoise), scale(nlane)
      real(wp), intent(in) :: gq(nlane, points%ndof), gp(nlane, points%ndof)
      type(error_type), allocatable, intent(inout) :: error
      integer, parameter :: one = 2  !! a lane that is neither the first nor the last
      real(wp), allocatable :: aq(:, :), ap(:, :), sq(:, :), sp(:, :)
      type(finding) :: bad
      integer :: lane

      if (allocated(error)) return
      ! Give all lanes the state and the weights of lane `one`.
      call ask(points, spread(points%q(one, :), 1, nlane), spread(points%p(one, :), 1, nlane), &
               spread(w(one, :), 1, nlane), 0.7_wp, aq, ap, error)
      if (allocated(error)) return
      allocate (sq, sp, mold=aq)
      do lane = 1, nlane
         sq = 0
         sp = 0
         sq(one, :) = aq(lane, :) - gq(one, :)
         sp(one, :) = ap(lane, :) - gp(one, :)
         call worst(sq, sp, scale, vanishing, bad)
         ! The difference of each lane is judged with the scale of lane `one`.
         if (bad%lane > 0) exit
      end do
      if (bad%lane == 0) return
      associate (alone => merge(gq(one, bad%i), gp(one, bad%i), bad%half == 1), &
                 alike => merge(aq(lane, bad%i), ap(lane, bad%i), bad%half == 1))
         call refuse(points, 'mixes lanes: dS/d'//trim(component(bad))//' is '// &
                     to_text(alone)//' where the other lanes hold other paths, and '//to_text(alike)// &
                     ' where they hold the same', one, bad%i, 'compute each lane from its own w, q and p, '// &
                     'never sum over lanes, and write all of every output', error)
      end associate
   end subroutine probe_lanes

   !> Test that S = sum_j w_j H_j is linear in its weights: the gradient is zero for zero weights, and additive in the
   !> weights.
   subroutine probe_weights(points, w, v, gq, gp, scale, error)
      type(probe_points), intent(in) :: points
      real(wp), intent(in) :: w(nlane, 0:points%nnoise), v(nlane, 0:points%nnoise), scale(nlane)
      real(wp), intent(in) :: gq(nlane, points%ndof), gp(nlane, points%ndof)  !! gradient with weights w
      type(error_type), allocatable, intent(inout) :: error
      character(*), parameter :: remedy = 'give every term of H_j the weight w[j], in its own lane'
      real(wp), allocatable :: aq(:, :), ap(:, :), bq(:, :), bp(:, :)
      real(wp) :: other(nlane)
      type(finding) :: bad

      if (allocated(error)) return
      !   g(0) = 0
      call ask(points, points%q, points%p, 0*w, 0.7_wp, aq, ap, error)
      if (allocated(error)) return
      call worst(aq, ap, scale, vanishing, bad)
      if (bad%lane > 0) then
         call refuse(points, 'is not zero where all weights are: dS/d'//trim(component(bad))//' = '// &
                     to_text(merge(aq(bad%lane, bad%i), ap(bad%lane, bad%i), bad%half == 1)), bad%lane, bad%i, &
                     remedy, error)
         return
      end if
      call ask(points, points%q, points%p, v, 0.7_wp, aq, ap, error)
      call largest_component(points%ndof, aq, ap, other)
      call ask(points, points%q, points%p, w + 2*v, 0.7_wp, bq, bp, error)
      if (allocated(error)) return
      !   g(w) + 2 g(v) against g(w + 2 v)
      aq = gq + 2*aq
      ap = gp + 2*ap
      call worst(bq - aq, bp - ap, scale + 2*other, vanishing, bad)
      if (bad%lane == 0) return
      call refuse(points, 'is not linear in the weights: dS/d'//trim(component(bad))//' is '// &
                  to_text(merge(bq(bad%lane, bad%i), bp(bad%lane, bad%i), bad%half == 1))//' with w + 2 v, and '// &
                  to_text(merge(aq(bad%lane, bad%i), ap(bad%lane, bad%i), bad%half == 1))// &
                  ' as that with w and twice that with v', bad%lane, bad%i, remedy, error)
   end subroutine probe_weights

   !> Test that the derivative of the gradient of the sum is symmetric. Two directions without zeros decide; only if
   !> they refute symmetry, search the wrong pair of entries.
   subroutine probe_symmetry(points, error)
      type(probe_points), intent(inout) :: points
      type(error_type), allocatable, intent(inout) :: error
      real(wp), allocatable, dimension(:, :) :: vq, vp, uq, up, xq, xp  !! (nlane, ndof)
      real(wp), dimension(nlane) :: one_way, other_way, scale, other, size_of
      integer :: i, lane

      if (allocated(error)) return
      ! v is one direction, the direction of the points is another; neither has zeros, so that every entry of Dg
      ! contributes.
      allocate (vq, vp, mold=points%zero)
      do i = 1, points%ndof
         vq(:, i) = generic(i, 11)
         vp(:, i) = generic(i, 17)
      end do
      !   (uq, up) = Dg u and (xq, xp) = Dg v, with u the direction of the points
      call points%product(points%vq, points%vp, uq, up, scale)
      call points%product(vq, vp, xq, xp, other)
      !   v.(Dg u) and u.(Dg v)
      one_way = sum(vq*uq, dim=2) + sum(vp*up, dim=2)
      other_way = sum(points%vq*xq, dim=2) + sum(points%vp*xp, dim=2)
      ! size_of is the sum of the sizes of the terms; it is not finite if one of the scales is not.
      size_of = sum(abs(vq*uq), dim=2) + sum(abs(vp*up), dim=2) + 0*(scale + other)
      do lane = 1, npoint
         if (min(scale(lane), other(lane)) < 0) cycle  ! no verdict: a difference is unreliable
         ! Points where a number is NaN are skipped too.
         if (.not. abs(one_way(lane) - other_way(lane)) > matching*size_of(lane)) cycle
         call blame(points, lane, one_way(lane), other_way(lane), error)
         return
      end do
   end subroutine probe_symmetry

   !> Refuse the gradient, and name the Hamiltonian and the pair of derivatives that differ most at a point. In systems
   !> too large for this search, the message gives the result of the two directions. If no pair clearly differs, nothing
   !> is refused.
   subroutine blame(points, lane, one_way, other_way, error)
      type(probe_points), intent(inout) :: points
      integer, intent(in) :: lane
      real(wp), intent(in) :: one_way, other_way
      type(error_type), allocatable, intent(inout) :: error
      character(*), parameter :: remedy = 'correct its signs and terms: it is (dS/dq, dS/dp) in this order, of q '// &
                                 'and p in this order'
      character(len=16) :: x, y
      type(finding) :: row, column
      real(wp) :: there, back
      integer :: k

      ! The search takes 2 ndof products for each sum, by differences.
      if (points%ndof > largest_search) then
         call refuse(points, 'is that of no Hamiltonian: its derivative is not symmetric, along two directions it '// &
                     'is '//to_text(one_way)//' and '//to_text(other_way), lane, 1, remedy, error)
         return
      end if
      ! Test each Hamiltonian separately, to name the one that is not symmetric.
      do k = 0, points%last_sum()
         call points%take_sum(k)
         call worst_pair(points, lane, row, column, there, back)
         if (row%lane == 0) cycle
         x = component(row)
         y = component(column)
         call refuse(points, 'is that of no Hamiltonian: the derivative of d'//points%sum_name//'/d'//trim(x)// &
                     ' by '//trim(y)//' is '//to_text(there)//', and of d'//points%sum_name//'/d'//trim(y)//' by '// &
                     trim(x)//' '//to_text(back), lane, row%i, remedy, error)
         return
      end do
   end subroutine blame

   !> Find the second derivative of the sum that differs most from the derivative with exchanged variables, if the
   !> difference is clear.
   subroutine worst_pair(points, lane, row, column, there, back)
      type(probe_points), intent(in) :: points
      integer, intent(in) :: lane
      type(finding), intent(out) :: row, column    !! row%lane = 0: no clear difference
      real(wp), intent(out) :: there, back         !! the two derivatives
      real(wp) :: d(2*points%ndof, 2*points%ndof)
      integer :: n, at(2)

      n = points%ndof
      ! d(i,j) - d(j,i) = 0 for a Hamiltonian
      call derivative(points, lane, d)
      ! Report the pair of variables with the largest asymmetry.
      at = maxloc(abs(d - transpose(d)))
      there = d(at(1), at(2))
      back = d(at(2), at(1))
      if (.not. abs(there - back) > matching*maxval(abs(d))) return
      ! Variables are numbered q first: past n they are momenta.
      row = finding(lane, merge(1, 2, at(1) <= n), merge(at(1), at(1) - n, at(1) <= n))
      column = finding(lane, merge(1, 2, at(2) <= n), merge(at(2), at(2) - n, at(2) <= n))
   end subroutine worst_pair

   !> All second derivatives at one point, d(i,j) = d(dS/dx_i)/dx_j, x = (q, p).
   subroutine derivative(points, lane, d)
      type(probe_points), intent(in) :: points
      integer, intent(in) :: lane
      real(wp), intent(out) :: d(2*points%ndof, 2*points%ndof)
      real(wp), allocatable :: uq(:, :), up(:, :)
      integer :: i, half

      associate (n => points%ndof)
         do half = 1, 2
            do i = 1, n
               call points%row_of_hessian(finding(lane, half, i), uq, up)
               ! The product with a unit vector is a column of d, even if the matrix is not symmetric.
               d(:n, (half - 1)*n + i) = uq(lane, :)
               d(n + 1:, (half - 1)*n + i) = up(lane, :)
            end do
         end do
      end associate
   end subroutine derivative

   !> The name of the component of a finding, such as q_1.
   pure character(len=16) function component(found) result(text)
      type(finding), intent(in) :: found

      text = merge('q_', 'p_', found%half == 1)//to_text(found%i)
   end function component

   !> Refuse the gradient in one sentence: what is wrong with it, at which point, and what to do.
   subroutine refuse(points, what, lane, i, remedy, error)
      type(probe_points), intent(in) :: points
      character(*), intent(in) :: what, remedy  !! what is wrong, and the remedy
      integer, intent(in) :: lane, i            !! the point, and the degree of freedom for the message
      type(error_type), allocatable, intent(inout) :: error

      call raise(error, false_trait, here, "the gradient of model '"//points%model%name//"' "//what//', at '// &
                 points%place(lane, i, i)//' with S = sum_j w[j] H_j; '//remedy)
   end subroutine refuse

end module symsde_model_probe_gradient
