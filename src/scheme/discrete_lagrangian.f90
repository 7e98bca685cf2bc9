! SPDX-License-Identifier: BSD-3-Clause
!>    p_n = -dL_h/dq_n,    p_{n+1} = dL_h/dq_{n+1},    L_h ~ ext int (p.q' - H) dt - sum_k int H_k o dW_k
!>
!> From a quadrature to a scheme: the discrete Lagrangian of [WHSB] (49), (53)-(58), (63)-(65), closed by free
!> internal momenta.
!>
!> q_d is a polynomial of degree s through q_n and q_{n+1}, P_i a momentum at the node c_i:
!>
!>    L_h(q_n,q_{n+1}) = ext sum_i alpha_i [P_i . q_d'(c_i) - h H(P_i,q_d(c_i))] - sum_i beta_i sum_k dW_k H_k
!>
!> The variations of this Lagrangian with respect to P_i and to the inner control points q^mu of q_d are the equations
!> of the step:
!>
!>    q_d'(c_i) = h H_p + sum_k (beta_i/alpha_i) dW_k H_k,p   at (P_i, q_d(c_i))
!>    sum_i [alpha_i l_mu'(c_i) P_i - l_mu(c_i) (alpha_i h H_q + sum_k beta_i dW_k H_k,q)] = 0,   0 < mu < s
!>
!> and p_n = -dL_h/dq_n, p_{n+1} = dL_h/dq_{n+1}. With r = s nodes it is a partitioned tableau: with
!> V_i = q_d'(c_i) the stages are Q_i = q_n + sum_j a_ij V_j with a_ij the integral of the j-th
!> Lagrange polynomial from 0 to c_i, and the variations with respect to V_j give P_j (Holm and
!> Tyranowski, BIT 58, 2018; Ober-Bloebaum and Saake, 2015).
!>
!> Why the momenta are free: if P_i were tied to p_n and p_{n+1}, as in the paper, (63)-(65) would be 4n equations for
!> 2n unknowns, which are consistent for one node alone (scheme_from_end_point_rule). With r < s the control points are
!> undetermined. With r > s the q'(c_i) depend on each other, and H_pp must be invertible for the P_i.
module symsde_scheme_discrete_lagrangian
   use symsde_base_contracts, only: contracts_are_executed
   use symsde_base_kinds, only: wp
   use symsde_base_lanes, only: is_finite_lane
   use symsde_base_status, only: error_type, raise, invalid_argument, incompatible, wrong_shape
   use symsde_base_text, only: to_text
   use symsde_scheme_contract, only: require_scheme
   use symsde_scheme_scheme, only: scheme_type, model_needs, tableau_form, galerkin_form, symplectic_conjugate, &
                                   tidy
   use symsde_scheme_quadrature, only: get_quadrature, exactness_degree
   use symsde_scheme_properties, only: declare_properties
   implicit none
   private
   public :: scheme_from_quadrature, scheme_from_end_point_rule, collocation, max_degree

   integer, parameter :: max_degree = 8             !! degree of the polynomial; Gauss 4 integrates it exactly
   real(wp), parameter :: node_distance = 1e-6_wp   !! nodes closer than this count as repeated
   real(wp), parameter :: tolerance = 64*epsilon(1.0_wp)
   character(*), parameter :: place = 'scheme_from_quadrature'

contains

   !> The scheme of a polynomial degree s and a quadrature of r nodes, in any order. r = s gives a
   !> tableau; with own noise weights beta its b_ij = a_ij beta_j/alpha_j and bbar_ij = beta_j -
   !> beta_j a_ji/alpha_i satisfy the four symplecticity conditions identically. r > s gives Galerkin data, for noises
   !> in position, or for any additive noises with the weights of the drift: otherwise nodes would get different
   !> velocities from the noise, and P_i - P_j would be of size dW^2/h. Errors: wrong_shape, invalid_argument (numbers),
   !> incompatible (choices that give no scheme).
   subroutine scheme_from_quadrature(scheme, degree, nodes, weights, name, error, noise_weights)
      type(scheme_type), intent(out) :: scheme
      integer, intent(in) :: degree                      !! s, 1 .. max_degree
      real(wp), intent(in) :: nodes(:)                   !! nodes in [0,1] (nnode)
      real(wp), intent(in) :: weights(:)                 !! weights, with sum one (nnode)
      character(*), intent(in) :: name
      type(error_type), allocatable, intent(inout) :: error
      real(wp), intent(in), optional :: noise_weights(:) !! default: weights (nnode)
      real(wp) :: beta(size(weights))
      integer :: order(size(nodes)), exactness

      call check_numbers(degree, nodes, weights, 'weights', error)
      if (present(noise_weights)) &
         call check_numbers(degree, nodes, noise_weights, 'noise weights', error)
      if (.not. allocated(error)) call check_choice(degree, nodes, weights, error)
      if (allocated(error)) return
      ! The noise has the weights of the drift unless other weights are given.
      beta = weights
      if (present(noise_weights)) beta = noise_weights
      order = ascending(nodes)
      scheme%name = trim(name)
      scheme%reference = 'discrete Lagrangian [WHSB] (49), (53)-(58) with free internal momenta'
      scheme%nstage = size(nodes)
      scheme%degree = degree
      scheme%c = nodes(order)
      scheme%alpha = weights(order)
      scheme%beta = beta(order)
      ! With as many nodes as the degree the velocities V_i = q_d'(c_i) are free, and the scheme is a tableau.
      if (scheme%nstage == degree) then
         call fill_tableau(scheme)
      else
         call fill_galerkin(scheme)
      end if
      ! The polynomial limits the order without noise to 2 s, and the rule to its degree of exactness plus one.
      exactness = exactness_degree(nodes, weights)
      call declare_properties(scheme, min(2*degree, exactness + 1))
      if (contracts_are_executed) call require_scheme(scheme, 'scheme, quadrature')
   end subroutine scheme_from_quadrature

   !> The paper's own recipe (63)-(65) with momenta tied to the end points: node i evaluates the
   !> Hamiltonians at Q_i = (1-c_i) q_n + c_i q_{n+1} and P_i = (1-d_i) p_n + d_i p_{n+1}. Its 4n
   !> equations for 2n unknowns agree only for a single node with d = 1 - c: the family
   !> Q = (1-lambda) q_n + lambda q_{n+1}, P = lambda p_n + (1-lambda) p_{n+1} of [WHSB] (71)-(72),
   !> (89)-(92).
   !> Errors: those of scheme_from_quadrature; incompatible for every other choice, with the reason.
   subroutine scheme_from_end_point_rule(scheme, q_nodes, p_nodes, weights, name, error)
      type(scheme_type), intent(out) :: scheme
      real(wp), intent(in) :: q_nodes(:)  !! c_i (nnode)
      real(wp), intent(in) :: p_nodes(:)  !! d_i (nnode)
      real(wp), intent(in) :: weights(:)  !! (nnode)
      character(*), intent(in) :: name
      type(error_type), allocatable, intent(inout) :: error

      if (size(p_nodes) /= size(q_nodes)) then
         call raise(error, wrong_shape, 'scheme_from_end_point_rule', 'there are '// &
                    to_text(size(q_nodes))//' nodes for q and '//to_text(size(p_nodes))// &
                    ' for p; give as many of one as of the other')
      else if (size(q_nodes) > 1) then
         call raise(error, incompatible, 'scheme_from_end_point_rule', 'with '// &
                    to_text(size(q_nodes))//' nodes whose momenta are tied to p_n and p_{n+1} '// &
                    'the equations (63)-(65) are 4n conditions on 2n unknowns that contradict '// &
                    'each other (the trapezoid in q and p forces q_n = q_{n+1}); use one '// &
                    'node, or scheme_from_quadrature, which leaves the internal momenta free')
      else if (size(q_nodes) == 1) then
         if (.not. abs(q_nodes(1) + p_nodes(1) - 1) <= tolerance) &
            call raise(error, incompatible, 'scheme_from_end_point_rule', 'the node of q is '// &
                       to_text(q_nodes(1))//' and that of p is '//to_text(p_nodes(1))// &
                       '; (63)-(65) agree only if they add up to one: take 1 - '//to_text(q_nodes(1))//' for p')
      end if
      if (allocated(error)) return
      ! One node with a free momentum is the consistent choice: P is then found to be lambda p_n + (1 - lambda)
      ! p_{n+1}.
      call scheme_from_quadrature(scheme, 1, q_nodes, weights, name, error)
   end subroutine scheme_from_end_point_rule

   !> Shapes and numbers of a quadrature.
   subroutine check_numbers(degree, nodes, weights, what, error)
      integer, intent(in) :: degree
      real(wp), intent(in) :: nodes(:), weights(:)
      character(*), intent(in) :: what  !! 'weights' or 'noise weights'
      type(error_type), allocatable, intent(inout) :: error

      if (size(nodes) /= size(weights)) then
         call raise(error, wrong_shape, place, 'there are '//to_text(size(nodes))//' nodes and '// &
                    to_text(size(weights))//' '//what//'; give one weight for each node')
      else if (size(nodes) == 0) then
         call raise(error, wrong_shape, place, 'there are no nodes; give at least one')
      else if (degree < 1 .or. degree > max_degree) then
         call raise(error, invalid_argument, place, 'the degree of the polynomial is '//to_text(degree)// &
                    '; allowed are 1 to '//to_text(max_degree))
      else if (.not. (all(is_finite_lane(nodes)) .and. all(is_finite_lane(weights)))) then
         call raise(error, invalid_argument, place, &
                    'nodes and '//what//' must be finite numbers; one is not')
      else if (any(nodes < 0) .or. any(nodes > 1)) then
         call raise(error, invalid_argument, place, 'the node '// &
                    to_text(nodes(maxloc(abs(nodes - 0.5_wp), dim=1)))// &
                    ' lies outside [0,1]; nodes are fractions of the step')
      else if (smallest_distance(nodes) < node_distance) then
         call raise(error, invalid_argument, place, 'a node is repeated; nodes must differ by at least '// &
                    to_text(node_distance)//': give it once, with the sum of the weights')
      else if (abs(sum(weights) - 1) > tolerance) then
         call raise(error, invalid_argument, place, 'the '//what//' sum to '//to_text(sum(weights))// &
                    '; they must sum to one: divide them by their sum')
      else if (what == 'weights' .and. any(abs(weights) < node_distance)) then
         call raise(error, invalid_argument, place, 'the weight of a node is zero, so that its momentum is '// &
                    'undetermined; leave the node out')
      end if
   end subroutine check_numbers

   !> Degree, number of nodes and exactness must match, or the equations have no solution or inconsistent ones.
   subroutine check_choice(degree, nodes, weights, error)
      integer, intent(in) :: degree
      real(wp), intent(in) :: nodes(:), weights(:)
      type(error_type), allocatable, intent(inout) :: error
      integer :: needed

      needed = degree - 1
      ! sum_i alpha_i q_d'(c_i) must be q_{n+1} - q_n, which requires exactness to degree s - 1; with more nodes than
      ! the degree the first moment, int t dt = 1/2, must be exact, too: it decides whether the Stratonovich equation is
      ! approximated.
      if (size(nodes) > degree) needed = max(needed, 1)
      if (size(nodes) < degree) then
         call raise(error, incompatible, place, 'a polynomial of degree '//to_text(degree)//' with '// &
                    to_text(size(nodes))//' nodes leaves its control points undetermined; use at least '// &
                    to_text(degree)//' nodes or a lower degree')
      else if (exactness_degree(nodes, weights) < needed) then
         call raise(error, incompatible, place, 'the quadrature is exact to degree '// &
                    to_text(exactness_degree(nodes, weights))//', but degree '//to_text(degree)//' with '// &
                    to_text(size(nodes))//' nodes is consistent only with one exact to degree '//to_text(needed)// &
                    '; change the weights or lower the degree')
      end if
   end subroutine check_choice

   !> r = s: a = collocation, abar its symplectic conjugate, noise coefficients from the noise
   !> weights.
   subroutine fill_tableau(scheme)
      type(scheme_type), intent(inout) :: scheme  !! a scheme with c, alpha, beta, nstage
      real(wp) :: a(scheme%nstage, scheme%nstage)
      integer :: i, j

      associate (s => scheme, r => scheme%nstage)
         s%form = tableau_form
         !   a_ij = int_0^{c_i} l_j(t) dt,   abar_ij = alpha_j - alpha_j a_ji/alpha_i
         a = collocation(s%c)
         s%a = tidy(a)
         a = symplectic_conjugate(s%a, s%alpha)
         s%abar = tidy(a)
         allocate (s%b(r, r), s%bbar(r, r))
         do j = 1, r
            do i = 1, r
               ! V_j is the velocity by all Hamiltonians, with the noise weighted by beta_j/alpha_j.
               s%b(i, j) = s%a(i, j)*(s%beta(j)/s%alpha(j))
               s%bbar(i, j) = s%beta(j) - s%beta(j)*s%a(j, i)/s%alpha(i)
            end do
         end do
         s%bbar = tidy(s%bbar)
         ! Equal weights must give equal bits: one gradient a stage then serves drift and noise.
         if (.not. any(abs(s%alpha - s%beta) > 0)) s%bbar = s%abar
      end associate
   end subroutine fill_tableau

   !> r > s: values and slopes of the basis at the nodes. The control points are Chebyshev-Lobatto
   !> points, which begin at 0, end at 1, and are symmetric and well conditioned at every degree.
   subroutine fill_galerkin(scheme)
      type(scheme_type), intent(inout) :: scheme  !! a scheme with c, nstage, degree
      real(wp) :: control(0:scheme%degree)
      integer :: i, mu, s

      s = scheme%degree
      do mu = 0, s/2
         ! The points are (1 - cos(pi mu/s))/2, and are exactly symmetric.
         control(mu) = sin(0.5_wp*acos(-1.0_wp)*mu/s)**2
         control(s - mu) = 1 - control(mu)
      end do
      if (mod(s, 2) == 0) control(s/2) = 0.5_wp
      scheme%form = galerkin_form
      scheme%needs = model_needs(position_noise=.true., additive_will_do=.true., why='it has more nodes than degrees', &
                                 instead='a scheme with as many nodes as its degree, such as midpoint or gauss2')
      allocate (scheme%basis(scheme%nstage, 0:s), scheme%slope(scheme%nstage, 0:s))
      do mu = 0, s
         do i = 1, scheme%nstage
            scheme%basis(i, mu) = lagrange(control, mu + 1, scheme%c(i))
            scheme%slope(i, mu) = lagrange_slope(control, mu + 1, scheme%c(i))
         end do
      end do
   end subroutine fill_galerkin

   !> a_ij = integral of the j-th Lagrange polynomial of the nodes from 0 to c_i, by a Gauss
   !> quadrature that is exact for it.
   function collocation(nodes) result(a)
      real(wp), intent(in) :: nodes(:)  !! nodes, max_degree at most (nstage)
      real(wp) :: a(size(nodes), size(nodes))
      real(wp), allocatable :: x(:), w(:)
      type(error_type), allocatable :: error
      integer :: i, j, k

      ! The integrand has degree r - 1, for which (r + 1)/2 nodes of Gauss are enough. int_0^{c_i} is c_i times a mean
      ! over [0,1], with the nodes c_i x_k.
      call get_quadrature('gauss'//to_text((size(nodes) + 1)/2), x, w, error)
      a = 0
      do j = 1, size(nodes)
         do i = 1, size(nodes)
            do k = 1, size(x)
               a(i, j) = a(i, j) + nodes(i)*w(k)*lagrange(nodes, j, nodes(i)*x(k))
            end do
         end do
      end do
   end function collocation

   !> The j-th Lagrange polynomial of the given points at x.
   pure real(wp) function lagrange(points, j, x) result(value)
      real(wp), intent(in) :: points(:)
      integer, intent(in) :: j
      real(wp), intent(in) :: x
      integer :: k

      value = 1
      do k = 1, size(points)
         if (k /= j) value = value*((x - points(k))/(points(j) - points(k)))
      end do
   end function lagrange

   !> Derivative of the j-th Lagrange polynomial of the given points at x.
   pure real(wp) function lagrange_slope(points, j, x) result(slope)
      real(wp), intent(in) :: points(:)
      integer, intent(in) :: j
      real(wp), intent(in) :: x
      real(wp) :: product
      integer :: k, l

      slope = 0
      do l = 1, size(points)
         if (l == j) cycle
         product = 1/(points(j) - points(l))
         do k = 1, size(points)
            if (k /= j .and. k /= l) product = product*((x - points(k))/(points(j) - points(k)))
         end do
         slope = slope + product
      end do
   end function lagrange_slope

   !> Smallest distance between two of the nodes; 1 for a single one.
   pure real(wp) function smallest_distance(nodes) result(distance)
      real(wp), intent(in) :: nodes(:)
      integer :: i

      distance = 1
      do i = 2, size(nodes)
         distance = min(distance, minval(abs(nodes(:i - 1) - nodes(i))))
      end do
   end function smallest_distance

   !> Positions of the nodes in ascending order, so that reversing the stages means reversing time.
   pure function ascending(nodes) result(order)
      real(wp), intent(in) :: nodes(:)
      integer :: order(size(nodes))
      logical :: left(size(nodes))
      integer :: i

      left = .true.
      do i = 1, size(nodes)
         order(i) = minloc(nodes, dim=1, mask=left)
         left(order(i)) = .false.
      end do
   end function ascending

end module symsde_scheme_discrete_lagrangian
