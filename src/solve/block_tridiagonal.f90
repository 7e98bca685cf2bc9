! SPDX-License-Identifier: BSD-3-Clause
!> Newton corrections for two or three stages of a chain: matrices C (x) I + diag(K_1, .., K_s), one per lane, without
!> pivoting.
!>
!> C is an s x s matrix, the same for all sites and lanes; K_m is the symmetric tridiagonal stiffness at stage m, its
!> diagonal k(lane, 0, at, m) and the entries right of it, k(lane, 1, at, m). With the unknowns of a site as neighbours
!> the matrix is block tridiagonal: C + diag(K_m(i,i)) on the diagonal, E_i = diag(K_m(i,i+1)) beside it. Downwards,
!> site after site,
!>
!>    S_i = C + diag(K_m(i,i)) - E_{i-1} S_{i-1}^{-1} E_{i-1},   r_i = S_i^{-1} (g_i + f_i - E_{i-1} r_{i-1})
!>
!> and then upwards
!>
!>    d_i = r_i - S_i^{-1} E_i d_{i+1},   g_i <- g_i - C d_i
!>
!> with g the slopes and g + f their residual. S_i^{-1} E_i is kept as `factor` and r_i as `rhs`. A block is inverted
!> by its minors, which takes one division a site.
!>
!> A lane is trusted while all principal minors of its blocks are positive; a NaN is not. The minors are positive if
!> every K_m is positive semidefinite and the stages can be scaled so that C has a positive definite symmetric part, as
!> for Gauss schemes: then so have the reduced blocks S_i, and no entry grows.
!>
!> Strips of lanes are eliminated together, as in solve/tridiagonal. Sites may come in several parts, as the rows of K
!> are computed; site_above passes data from one part to the next. The way upwards takes all sites at once.
!>
!> The unknowns are corrections d of the stage positions, which are not kept: stages need the slopes g, which are
!> corrected by C d directly. Two and three stages have kernels of their own, with scalars instead of small matrices.
module symsde_solve_block_tridiagonal
   use symsde_base_kinds, only: wp
   use symsde_base_traits, only: strip_lanes
   implicit none
   private
   public :: eliminate_down_blocks, correct_up_blocks, site_above, new_site_above

   !> Data that a site passes to the next: S^{-1} E with its block S and the block E = diag(beside) right of it; the
   !> diagonal of E; and its reduced right-hand side.
   type :: site_above
      real(wp), allocatable :: factor(:, :, :)   !! S^{-1} E (strip_lanes, s, s)
      real(wp), allocatable :: beside(:, :)      !! (strip_lanes, s)
      real(wp), allocatable :: rhs(:, :)         !! eliminated (strip_lanes, s)
      real(wp) :: trusted(strip_lanes) = 1         !! 1 for trusted lanes, else 0
   contains
      procedure :: start
   end type site_above

contains

   !> Make room for s stages, and begin a chain.
   pure subroutine new_site_above(self, s)
      type(site_above), intent(out) :: self
      integer, intent(in) :: s

      allocate (self%factor(strip_lanes, s, s), self%beside(strip_lanes, s), self%rhs(strip_lanes, s))
      call self%start()
   end subroutine new_site_above

   !> Begin a chain: the first site has no site above it, and every lane is trusted.
   pure subroutine start(self)
      class(site_above), intent(inout) :: self

      self%factor = 0
      self%beside = 0
      self%rhs = 0
      self%trusted = 1
   end subroutine start

   !> Eliminate sites first .. last, with residuals g + f and matrices as at the head of this file, after the sites
   !> above them. f and k hold these sites alone, from index 1 on, while g, factor and rhs hold all n sites.
   pure subroutine eliminate_down_blocks(s, n, first, last, capacity, c, g, f, k, above, factor, rhs)
      integer, intent(in) :: s                                   !! stages: 2 or 3
      integer, intent(in) :: n, first, last                      !! sites
      integer, intent(in) :: capacity !! sites that f and k have room for: last - first + 1 or more
      real(wp), intent(in) :: c(s, s)
      real(wp), intent(in) :: g(strip_lanes, s, n)
      real(wp), intent(in) :: f(strip_lanes, capacity, s), k(strip_lanes, 0:1, capacity, s)
      type(site_above), intent(inout) :: above
      real(wp), intent(inout) :: factor(strip_lanes, s, s, n)    !! S^{-1} E of every site
      real(wp), intent(inout) :: rhs(strip_lanes, s, n)          !! S^{-1} L^{-1} residual

      ! Pass the parts of `above` separately, so that the kernels have arrays of constant bounds.
      if (s == 2) then
         call eliminate_pairs(n, first, last, capacity, c, g, f, k, above%factor, above%beside, above%rhs, &
                              above%trusted, factor, rhs)
      else
         call eliminate_triples(n, first, last, capacity, c, g, f, k, above%factor, above%beside, above%rhs, &
                                above%trusted, factor, rhs)
      end if
   end subroutine eliminate_down_blocks

   !> Solve for d upwards and correct g by C d in running lanes, with the sizes (strip_lanes) of the correction C d
   !> and of the slopes.
   pure subroutine correct_up_blocks(s, n, c, factor, rhs, last, g, step, size)
      integer, intent(in) :: s, n
      real(wp), intent(in) :: c(s, s), factor(strip_lanes, s, s, n), rhs(strip_lanes, s, n)
      real(wp), intent(in) :: last(strip_lanes)                  !! negative in lanes that are done or failed
      real(wp), intent(inout) :: g(strip_lanes, s, n)
      real(wp), intent(out) :: step(strip_lanes), size(strip_lanes)

      if (s == 2) then
         call correct_pairs(n, c, factor, rhs, last, g, step, size)
      else
         call correct_triples(n, c, factor, rhs, last, g, step, size)
      end if
   end subroutine correct_up_blocks

   ! ---- kernels ----------------------------------------------------------------------------------

   !> VEC Eliminate two stages, S = (a11, a12; a21, a22), downwards through sites first .. last. above, beside and r
   !> are S^{-1} E, the diagonal of E, and S^{-1} times the right-hand side: on entry of the site above, then of
   !> this site.
   pure subroutine eliminate_pairs(n, first, last, capacity, c, g, f, k, above, beside, r, trusted, factor, rhs)
      integer, intent(in) :: n, first, last, capacity
      real(wp), intent(in) :: c(2, 2), g(strip_lanes, 2, n)
      real(wp), intent(in) :: f(strip_lanes, capacity, 2), k(strip_lanes, 0:1, capacity, 2)
      real(wp), intent(inout) :: above(strip_lanes, 2, 2), beside(strip_lanes, 2), r(strip_lanes, 2)
      real(wp), intent(inout) :: trusted(strip_lanes)
      real(wp), intent(inout) :: factor(strip_lanes, 2, 2, n), rhs(strip_lanes, 2, n)
      real(wp) :: a11, a12, a21, a22, b1, b2, det, inverse, right1, right2, least
      integer :: i, at, lane

      do i = first, last
         ! place of site i in f and k
         at = i - first + 1
         do lane = 1, strip_lanes
            ! S_i: the block of this site less E_{i-1} times (S^{-1} E)_{i-1} of the site above.
            a11 = c(1, 1) + k(lane, 0, at, 1) - beside(lane, 1)*above(lane, 1, 1)
            a12 = c(1, 2) - beside(lane, 1)*above(lane, 1, 2)
            a21 = c(2, 1) - beside(lane, 2)*above(lane, 2, 1)
            a22 = c(2, 2) + k(lane, 0, at, 2) - beside(lane, 2)*above(lane, 2, 2)
            ! The residual g + f of this site, less E_{i-1} r_{i-1}.
            b1 = g(lane, 1, i) + f(lane, at, 1) - beside(lane, 1)*r(lane, 1)
            b2 = g(lane, 2, i) + f(lane, at, 2) - beside(lane, 2)*r(lane, 2)
            det = a11*a22 - a12*a21
            inverse = 1/det
            ! The principal minors are a11, a22 and the determinant, whose sign is the sign of its inverse.
            ! Comparisons with NaN are false, so a lane with NaN is not trusted.
            least = merge(a11, a22, a11 < a22)
            least = merge(least, inverse, least < inverse)
            trusted(lane) = merge(trusted(lane), 0.0_wp, least > 0)
            ! r_i = S^{-1} b by Cramer's rule.
            r(lane, 1) = (a22*b1 - a12*b2)*inverse
            r(lane, 2) = (a11*b2 - a21*b1)*inverse
            ! From here on this site plays the part of the site above: E_i replaces E_{i-1}.
            beside(lane, 1) = k(lane, 1, at, 1)
            beside(lane, 2) = k(lane, 1, at, 2)
            ! S^{-1} E: its column m is column m of S^{-1} times E_mm.
            right1 = beside(lane, 1)*inverse
            right2 = beside(lane, 2)*inverse
            above(lane, 1, 1) = a22*right1
            above(lane, 2, 1) = -a21*right1
            above(lane, 1, 2) = -a12*right2
            above(lane, 2, 2) = a11*right2
            factor(lane, 1, 1, i) = above(lane, 1, 1)
            factor(lane, 2, 1, i) = above(lane, 2, 1)
            factor(lane, 1, 2, i) = above(lane, 1, 2)
            factor(lane, 2, 2, i) = above(lane, 2, 2)
            ! Keep the right-hand side for the pass upwards.
            rhs(lane, 1, i) = r(lane, 1)
            rhs(lane, 2, i) = r(lane, 2)
         end do
      end do
   end subroutine eliminate_pairs

   !> VEC Two stages: d upwards from the last site, and g <- g - C d in running lanes. Sizes are sums over the stages
   !> of a site, the largest of all sites.
   pure subroutine correct_pairs(n, c, factor, rhs, last, g, step, size)
      integer, intent(in) :: n
      real(wp), intent(in) :: c(2, 2), factor(strip_lanes, 2, 2, n), rhs(strip_lanes, 2, n), last(strip_lanes)
      real(wp), intent(inout) :: g(strip_lanes, 2, n)
      real(wp), intent(out) :: step(strip_lanes), size(strip_lanes)
      real(wp), dimension(strip_lanes) :: d1, d2, largest, extent, rests
      real(wp) :: e1, e2, change1, change2, new1, new2
      integer :: lane, i

      d1 = 0
      d2 = 0
      largest = 0
      extent = 0
      rests = last
      do i = n, 1, -1
         do lane = 1, strip_lanes
            ! d_i = r_i - (S_i^{-1} E_i) d_{i+1}; below the last site d is zero.
            e1 = rhs(lane, 1, i) - (factor(lane, 1, 1, i)*d1(lane) + factor(lane, 1, 2, i)*d2(lane))
            e2 = rhs(lane, 2, i) - (factor(lane, 2, 1, i)*d1(lane) + factor(lane, 2, 2, i)*d2(lane))
            d1(lane) = e1
            d2(lane) = e2
            ! g <- g - C d_i.
            change1 = c(1, 1)*e1 + c(1, 2)*e2
            change2 = c(2, 1)*e1 + c(2, 2)*e2
            ! Lanes that are done or failed keep their slopes.
            new1 = merge(g(lane, 1, i) - change1, g(lane, 1, i), rests(lane) >= 0)
            new2 = merge(g(lane, 2, i) - change2, g(lane, 2, i), rests(lane) >= 0)
            g(lane, 1, i) = new1
            g(lane, 2, i) = new2
            ! The sizes at this site, sums over its stages.
            change1 = abs(change1) + abs(change2)
            new1 = abs(new1) + abs(new2)
            ! a NaN spreads from site to site in d, and this comparison keeps it
            largest(lane) = merge(largest(lane), change1, change1 <= largest(lane))
            extent(lane) = merge(extent(lane), new1, new1 <= extent(lane))
         end do
      end do
      step = largest
      size = extent
   end subroutine correct_pairs

   !> VEC Three stages, as eliminate_pairs, with S = (a_pq) of three rows. Its nine minors serve the inverse, the
   !> determinant and the test: m11, m33, a11 and the determinant are the principal minors whose signs are tested.
   pure subroutine eliminate_triples(n, first, last, capacity, c, g, f, k, above, beside, r, trusted, factor, rhs)
      integer, intent(in) :: n, first, last, capacity
      real(wp), intent(in) :: c(3, 3), g(strip_lanes, 3, n)
      real(wp), intent(in) :: f(strip_lanes, capacity, 3), k(strip_lanes, 0:1, capacity, 3)
      real(wp), intent(inout) :: above(strip_lanes, 3, 3), beside(strip_lanes, 3), r(strip_lanes, 3)
      real(wp), intent(inout) :: trusted(strip_lanes)
      real(wp), intent(inout) :: factor(strip_lanes, 3, 3, n), rhs(strip_lanes, 3, n)
      real(wp) :: a11, a12, a13, a21, a22, a23, a31, a32, a33, m11, m12, m13, m21, m22, m23, m31, m32, m33
      real(wp) :: b1, b2, b3, inverse, right1, right2, right3, least
      integer :: i, at, lane

      do i = first, last
         ! place of site i in f and k
         at = i - first + 1
         do lane = 1, strip_lanes
            ! S_i, as for two stages.
            a11 = c(1, 1) + k(lane, 0, at, 1) - beside(lane, 1)*above(lane, 1, 1)
            a12 = c(1, 2) - beside(lane, 1)*above(lane, 1, 2)
            a13 = c(1, 3) - beside(lane, 1)*above(lane, 1, 3)
            a21 = c(2, 1) - beside(lane, 2)*above(lane, 2, 1)
            a22 = c(2, 2) + k(lane, 0, at, 2) - beside(lane, 2)*above(lane, 2, 2)
            a23 = c(2, 3) - beside(lane, 2)*above(lane, 2, 3)
            a31 = c(3, 1) - beside(lane, 3)*above(lane, 3, 1)
            a32 = c(3, 2) - beside(lane, 3)*above(lane, 3, 2)
            a33 = c(3, 3) + k(lane, 0, at, 3) - beside(lane, 3)*above(lane, 3, 3)
            ! The residual g + f, less E_{i-1} r_{i-1}.
            b1 = g(lane, 1, i) + f(lane, at, 1) - beside(lane, 1)*r(lane, 1)
            b2 = g(lane, 2, i) + f(lane, at, 2) - beside(lane, 2)*r(lane, 2)
            b3 = g(lane, 3, i) + f(lane, at, 3) - beside(lane, 3)*r(lane, 3)
            ! minors: m_pq is the cofactor of a_qp
            m11 = a22*a33 - a23*a32
            m12 = a13*a32 - a12*a33
            m13 = a12*a23 - a13*a22
            m21 = a23*a31 - a21*a33
            m22 = a11*a33 - a13*a31
            m23 = a13*a21 - a11*a23
            m31 = a21*a32 - a22*a31
            m32 = a12*a31 - a11*a32
            m33 = a11*a22 - a12*a21
            ! The determinant by the first row of S.
            inverse = 1/(a11*m11 + a12*m21 + a13*m31)
            ! The principal minors: m11 of rows 2 and 3, m33 of rows 1 and 2, a11, and the determinant by its inverse.
            least = merge(m11, m33, m11 < m33)
            least = merge(least, a11, least < a11)
            least = merge(least, inverse, least < inverse)
            trusted(lane) = merge(trusted(lane), 0.0_wp, least > 0)
            ! r_i = S^{-1} b, with the inverse m times 1/det.
            r(lane, 1) = (m11*b1 + m12*b2 + m13*b3)*inverse
            r(lane, 2) = (m21*b1 + m22*b2 + m23*b3)*inverse
            r(lane, 3) = (m31*b1 + m32*b2 + m33*b3)*inverse
            ! This site becomes the site above.
            beside(lane, 1) = k(lane, 1, at, 1)
            right1 = beside(lane, 1)*inverse
            beside(lane, 2) = k(lane, 1, at, 2)
            right2 = beside(lane, 2)*inverse
            beside(lane, 3) = k(lane, 1, at, 3)
            right3 = beside(lane, 3)*inverse
            ! S^{-1} E: column m of the inverse times E_mm.
            above(lane, 1, 1) = m11*right1
            above(lane, 2, 1) = m21*right1
            above(lane, 3, 1) = m31*right1
            above(lane, 1, 2) = m12*right2
            above(lane, 2, 2) = m22*right2
            above(lane, 3, 2) = m32*right2
            above(lane, 1, 3) = m13*right3
            above(lane, 2, 3) = m23*right3
            above(lane, 3, 3) = m33*right3
            ! Keep the numbers of this site that the way upwards needs.
            factor(lane, 1, 1, i) = above(lane, 1, 1)
            factor(lane, 2, 1, i) = above(lane, 2, 1)
            factor(lane, 3, 1, i) = above(lane, 3, 1)
            factor(lane, 1, 2, i) = above(lane, 1, 2)
            factor(lane, 2, 2, i) = above(lane, 2, 2)
            factor(lane, 3, 2, i) = above(lane, 3, 2)
            factor(lane, 1, 3, i) = above(lane, 1, 3)
            factor(lane, 2, 3, i) = above(lane, 2, 3)
            factor(lane, 3, 3, i) = above(lane, 3, 3)
            rhs(lane, 1, i) = r(lane, 1)
            rhs(lane, 2, i) = r(lane, 2)
            rhs(lane, 3, i) = r(lane, 3)
         end do
      end do
   end subroutine eliminate_triples

   !> VEC Three stages, as correct_pairs: d_i = r_i - (S_i^{-1} E_i) d_{i+1} upwards, and g <- g - C d_i.
   pure subroutine correct_triples(n, c, factor, rhs, last, g, step, size)
      integer, intent(in) :: n
      real(wp), intent(in) :: c(3, 3), factor(strip_lanes, 3, 3, n), rhs(strip_lanes, 3, n), last(strip_lanes)
      real(wp), intent(inout) :: g(strip_lanes, 3, n)
      real(wp), intent(out) :: step(strip_lanes), size(strip_lanes)
      real(wp), dimension(strip_lanes) :: d1, d2, d3, largest, extent, rests
      real(wp) :: e1, e2, e3, change1, change2, change3, new1, new2, new3
      integer :: lane, i

      d1 = 0
      d2 = 0
      d3 = 0
      largest = 0
      extent = 0
      rests = last
      do i = n, 1, -1
         do lane = 1, strip_lanes
            ! d_i = r_i - (S_i^{-1} E_i) d_{i+1}.
            e1 = rhs(lane, 1, i) - (factor(lane, 1, 1, i)*d1(lane) + factor(lane, 1, 2, i)*d2(lane) &
                                    + factor(lane, 1, 3, i)*d3(lane))
            e2 = rhs(lane, 2, i) - (factor(lane, 2, 1, i)*d1(lane) + factor(lane, 2, 2, i)*d2(lane) &
                                    + factor(lane, 2, 3, i)*d3(lane))
            e3 = rhs(lane, 3, i) - (factor(lane, 3, 1, i)*d1(lane) + factor(lane, 3, 2, i)*d2(lane) &
                                    + factor(lane, 3, 3, i)*d3(lane))
            d1(lane) = e1
            d2(lane) = e2
            d3(lane) = e3
            ! g <- g - C d_i in running lanes.
            change1 = c(1, 1)*e1 + c(1, 2)*e2 + c(1, 3)*e3
            change2 = c(2, 1)*e1 + c(2, 2)*e2 + c(2, 3)*e3
            change3 = c(3, 1)*e1 + c(3, 2)*e2 + c(3, 3)*e3
            new1 = merge(g(lane, 1, i) - change1, g(lane, 1, i), rests(lane) >= 0)
            new2 = merge(g(lane, 2, i) - change2, g(lane, 2, i), rests(lane) >= 0)
            new3 = merge(g(lane, 3, i) - change3, g(lane, 3, i), rests(lane) >= 0)
            g(lane, 1, i) = new1
            g(lane, 2, i) = new2
            g(lane, 3, i) = new3
            ! A NaN fails every comparison, and stays the largest from there on.
            change1 = abs(change1) + abs(change2) + abs(change3)
            new1 = abs(new1) + abs(new2) + abs(new3)
            largest(lane) = merge(largest(lane), change1, change1 <= largest(lane))
            extent(lane) = merge(extent(lane), new1, new1 <= extent(lane))
         end do
      end do
      step = largest
      size = extent
   end subroutine correct_triples

end module symsde_solve_block_tridiagonal
