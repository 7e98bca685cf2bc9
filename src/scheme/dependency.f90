! SPDX-License-Identifier: BSD-3-Clause
!>    Q_i <- H_p(P_j, Q_j)  where a_ij or b_ij /= 0,          P_i <- H_q(P_j, Q_j)  where abar_ij or bbar_ij /= 0
!>
!> The dependencies between stage values of a tableau: whether a scheme is explicit, and in which order its values are
!> computed. Stage values are the vertices of a graph, numbered i for Q_i and nstage + i for P_i; a value needs the
!> values that its arrows come from. A scheme is explicit if this graph has no cycle.
!>
!> Q_i needs H_p at stage j where a_ij or b_ij is not zero, P_i needs H_q at stage j where abar_ij or bbar_ij is not
!> zero. H_p at stage j needs (Q_j,P_j), but for separable Hamiltonians P_j alone, and H_q then Q_j alone.
module symsde_scheme_dependency
   use symsde_base_kinds, only: wp
   use symsde_scheme_kicks, only: flow_midpoint
   use symsde_scheme_scheme, only: scheme_type, galerkin_form, splitting_form
   implicit none
   private
   public :: is_explicit, evaluation_order, implicit_unknowns

contains

   !> Whether the stages can be computed one after the other.
   pure logical function is_explicit(scheme, separable)
      type(scheme_type), intent(in) :: scheme
      logical, intent(in) :: separable  !! every H_j(q,p) = T_j(p) + U_j(q)
      integer :: order(2*scheme%nstage), known

      ! Kicks and drifts of a separable H are explicit; midpoint steps between kicks are not. Galerkin forms have no
      ! tableau and remain implicit.
      is_explicit = scheme%form == splitting_form .and. separable .and. scheme%kicks%flow /= flow_midpoint
      if (.not. scheme%has_tableau()) return
      call evaluation_order(scheme, separable, order, known)
      is_explicit = known == size(order)
   end function is_explicit

   !> Order the stage values so that each needs earlier values only, i for Q_i and nstage+i for P_i. The first `known`
   !> entries hold these values; all others must be solved for. An explicit scheme has no others.
   pure subroutine evaluation_order(scheme, separable, order, known)
      type(scheme_type), intent(in) :: scheme            !! a scheme not of Galerkin form
      logical, intent(in) :: separable                   !! every H_j(q,p) = T_j(p) + U_j(q)
      integer, intent(out) :: order(2*scheme%nstage)     !! 0 after the first `known` entries
      integer, intent(out) :: known
      logical :: needs(2*scheme%nstage, 2*scheme%nstage), done(2*scheme%nstage)
      integer :: i, before

      needs = dependencies(scheme, separable)
      done = .false.
      order = 0
      known = 0
      before = -1
      ! Append every value whose needs are all in the list, until a pass finds none: on an acyclic graph it finds all.
      do while (known > before)
         before = known
         do i = 1, size(done)
            if (done(i) .or. any(needs(i, :) .and. .not. done)) cycle
            done(i) = .true.
            known = known + 1
            order(known) = i
         end do
      end do
   end subroutine evaluation_order

   !> Number of coupled unknowns for each degree of freedom: a stage value counts if it lies on a cycle of the
   !> dependency graph or between two cycles; equal values count once. For the Galerkin form the momenta at the nodes
   !> and the control points count.
   pure integer function implicit_unknowns(scheme, separable) result(unknowns)
      type(scheme_type), intent(in) :: scheme
      logical, intent(in) :: separable
      logical :: needs(2*scheme%nstage, 2*scheme%nstage)
      logical :: left(2*scheme%nstage), keep(2*scheme%nstage)
      integer :: i, j

      if (.not. scheme%has_tableau()) then
         unknowns = 0
         if (scheme%form == galerkin_form) unknowns = scheme%degree + scheme%nstage
         if (scheme%form == splitting_form .and. scheme%kicks%flow == flow_midpoint) unknowns = 2
         return
      end if
      needs = dependencies(scheme, separable)
      left = .true.
      ! Keep values that need a remaining value and are needed by one. Each pass that changes the set removes at least
      ! one value, so as many passes as values suffice in either direction.
      do i = 1, 2*size(left)  ! first drop values known before the cycles, then after them
         do j = 1, size(left)
            keep(j) = any(needs(j, :) .and. left) .and. any(needs(:, j) .and. left)
         end do
         left = left .and. keep
      end do
      unknowns = 0
      do i = 1, size(left)
         ! The midpoint rule has two unknowns, Q_1 and P_1; stages with equal rows have equal values and count as one.
         if (left(i) .and. .not. repeats(scheme, i, left)) unknowns = unknowns + 1
      end do
   end function implicit_unknowns

   !> needs(i,j): stage value i needs stage value j.
   pure function dependencies(scheme, separable) result(needs)
      type(scheme_type), intent(in) :: scheme
      logical, intent(in) :: separable
      logical :: needs(2*scheme%nstage, 2*scheme%nstage)
      logical :: of_q(scheme%nstage, scheme%nstage), of_p(scheme%nstage, scheme%nstage)
      integer :: r

      r = scheme%nstage
      ! Drift and noise are computed together, so a value needs all that either of them needs.
      of_q = abs(scheme%a) > 0 .or. abs(scheme%b) > 0
      of_p = abs(scheme%abar) > 0 .or. abs(scheme%bbar) > 0
      ! For separable Hamiltonians H_p is a function of P_j alone and H_q of Q_j alone: the blocks on the diagonal, Q
      ! from Q and P from P, are then empty.
      needs(:r, r + 1:) = of_q
      needs(r + 1:, :r) = of_p
      needs(:r, :r) = of_q .and. .not. separable
      needs(r + 1:, r + 1:) = of_p .and. .not. separable
   end function dependencies

   !> Whether an earlier remaining stage value has the same coefficients.
   pure logical function repeats(scheme, i, left)
      type(scheme_type), intent(in) :: scheme
      integer, intent(in) :: i
      logical, intent(in) :: left(:)
      integer :: j, r, k

      r = scheme%nstage
      repeats = .false.
      ! Compare values of Q with values of Q, and of P with P; value k + 1 is the first of the kind of value i.
      do j = 1 + r*((i - 1)/r), i - 1
         if (.not. left(j)) cycle
         k = r*((i - 1)/r)
         if (k == 0) then
            repeats = same(scheme%a(i, :), scheme%a(j, :)) .and. &
                      same(scheme%b(i, :), scheme%b(j, :))
         else
            repeats = same(scheme%abar(i - k, :), scheme%abar(j - k, :)) .and. &
                      same(scheme%bbar(i - k, :), scheme%bbar(j - k, :))
         end if
         if (repeats) return
      end do
   end function repeats

   !> Whether two rows of coefficients are equal but for rounding.
   pure logical function same(x, y)
      real(wp), intent(in) :: x(:), y(:)

      same = all(abs(x - y) < 8*epsilon(1.0_wp))
   end function same

end module symsde_scheme_dependency
