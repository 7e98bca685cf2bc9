! SPDX-License-Identifier: BSD-3-Clause
!>    int_0^1 f(t) dt  ~  sum_i alpha_i f(c_i),     0 <= c_1 < c_2 < .. <= 1,     sum_i alpha_i = 1
!>
!> Named quadratures on [0,1], the choice from which a scheme is built ([WHSB] (49), (62)). The nodes become the times
!> of the stages and the weights the factors of the Hamiltonians in the discrete Lagrangian
!> (scheme/discrete_lagrangian). With R nodes the rules of Gauss are exact to degree 2R - 1, those of Radau to 2R - 2,
!> of Lobatto to 2R - 3: every end point among the nodes costs one degree. All have closed forms, so no iteration is
!> needed.
module symsde_scheme_quadrature
   use symsde_base_kinds, only: wp
   use symsde_base_status, only: error_type, raise, unknown_name
   use symsde_base_text, only: name_length, nearest_names
   implicit none
   private
   public :: get_quadrature, quadrature_names, exactness_degree

   character(len=name_length), parameter :: all_names(16) = [character(len=name_length) :: & !&
      'rectangle_left', 'rectangle_right', 'midpoint', 'trapezoid', 'open_trapezoid', & !&
      'gauss1', 'gauss2', 'gauss3', 'gauss4', 'lobatto2', 'lobatto3', 'lobatto4', & !&
      'radau_left2', 'radau_left3', 'radau_right2', 'radau_right3'] !&
   ! An exact rule misses a moment only by rounding of nodes and weights.
   real(wp), parameter :: tolerance = 64*epsilon(1.0_wp)  !! bound of a moment that should vanish

contains

   !> Names that get_quadrature knows; gaussR is exact to degree 2R-1, radau to 2R-2, lobatto to
   !> 2R-3.
   pure function quadrature_names() result(names)
      character(len=name_length) :: names(size(all_names))

      names = all_names
   end function quadrature_names

   !> Nodes, ascending, and weights of a named quadrature on [0,1].
   !> Errors: unknown_name, with the nearest names.
   subroutine get_quadrature(name, nodes, weights, error)
      character(*), intent(in) :: name                       !! a name of quadrature_names()
      real(wp), allocatable, intent(out) :: nodes(:)         !! (nnode)
      real(wp), allocatable, intent(out) :: weights(:)       !! (nnode)
      type(error_type), allocatable, intent(inout) :: error
      character(len=name_length) :: names(size(all_names))

      select case (name)
      case ('rectangle_left')
         nodes = [0.0_wp]
         weights = [1.0_wp]
      case ('rectangle_right')
         nodes = [1.0_wp]
         weights = [1.0_wp]
         ! With one node the two rectangles give the Euler pair: Hhat at (q_n, p_{n+1}) and at (q_{n+1}, p_n).
      case ('trapezoid')
         nodes = [0.0_wp, 1.0_wp]
         weights = [0.5_wp, 0.5_wp]
         ! The trapezoid has the nodes and weights of lobatto2, and is known by both names.
      case ('open_trapezoid')
         nodes = [1.0_wp/3.0_wp, 2.0_wp/3.0_wp]
         weights = [0.5_wp, 0.5_wp]
         ! The nodes 1/3 and 2/3 with equal weights are exact to degree one only.
      case ('midpoint', 'gauss1', 'gauss2', 'gauss3', 'gauss4')
         call gauss(name, nodes, weights)
      case ('lobatto2', 'lobatto3', 'lobatto4')
         call lobatto(name, nodes, weights)
      case ('radau_left2', 'radau_left3', 'radau_right2', 'radau_right3')
         call radau(name, nodes, weights)
      case default
         allocate (nodes(0), weights(0))
         names = all_names
         call raise(error, unknown_name, 'get_quadrature', &
                    "there is no quadrature '"//trim(name)// &
                    "'; allowed are, the nearest first: "//nearest_names(name, names))
      end select
   end subroutine get_quadrature

   !> Gauss-Legendre: zeros of the Legendre polynomials, moved to [0,1].
   pure subroutine gauss(name, nodes, weights)
      character(*), intent(in) :: name
      real(wp), allocatable, intent(out) :: nodes(:), weights(:)
      real(wp) :: x, y, w

      select case (name)
      case ('gauss2')
         ! The nodes on [-1,1] are the zeros of P_2(x) = (3 x^2 - 1)/2.
         x = sqrt(1.0_wp/3.0_wp)
         ! Move nodes from [-1,1] to [0,1], t = (1 + x)/2, and halve the weights.
         nodes = 0.5_wp + 0.5_wp*x*[-1.0_wp, 1.0_wp]
         weights = [0.5_wp, 0.5_wp]
      case ('gauss3')
         ! The nodes on [-1,1] are the zeros of P_3(x) = (5 x^3 - 3 x)/2.
         x = sqrt(3.0_wp/5.0_wp)
         nodes = 0.5_wp + 0.5_wp*x*[-1.0_wp, 0.0_wp, 1.0_wp]
         weights = [5.0_wp, 8.0_wp, 5.0_wp]/18
      case ('gauss4')
         ! P_4(x) = (35 x^4 - 30 x^2 + 3)/8 has the zeros x^2 = (3 +- 2 sqrt(6/5))/7.
         w = sqrt(6.0_wp/5.0_wp)
         x = sqrt((3 + 2*w)/7)
         y = sqrt((3 - 2*w)/7)
         nodes = 0.5_wp + 0.5_wp*(x*[-1.0_wp, 0.0_wp, 0.0_wp, 1.0_wp] + &
                                  y*[0.0_wp, -1.0_wp, 1.0_wp, 0.0_wp])
         w = sqrt(30.0_wp)
         ! The outer nodes have the smaller weights, (18 - sqrt 30)/72.
         weights = (18 + w*[-1.0_wp, 1.0_wp, 1.0_wp, -1.0_wp])/72
      case default
         nodes = [0.5_wp]
         weights = [1.0_wp]
      end select
   end subroutine gauss

   !> Gauss-Lobatto: both end points are nodes.
   pure subroutine lobatto(name, nodes, weights)
      character(*), intent(in) :: name
      real(wp), allocatable, intent(out) :: nodes(:), weights(:)
      real(wp) :: x

      select case (name)
      case ('lobatto3')
         ! This is Simpson's rule.
         nodes = [0.0_wp, 0.5_wp, 1.0_wp]
         weights = [1.0_wp, 4.0_wp, 1.0_wp]/6
      case ('lobatto4')
         ! The inner nodes are the zeros of P_3', at +- 1/sqrt 5 on [-1,1].
         x = sqrt(1.0_wp/5.0_wp)
         nodes = 0.5_wp*([0.0_wp, 1.0_wp, 1.0_wp, 2.0_wp] + x*[0.0_wp, -1.0_wp, 1.0_wp, 0.0_wp])
         weights = [1.0_wp, 5.0_wp, 5.0_wp, 1.0_wp]/12
      case default
         nodes = [0.0_wp, 1.0_wp]
         weights = [0.5_wp, 0.5_wp]
      end select
   end subroutine lobatto

   !> Gauss-Radau: one end point, left or right, is a node.
   pure subroutine radau(name, nodes, weights)
      character(*), intent(in) :: name
      real(wp), allocatable, intent(out) :: nodes(:), weights(:)
      real(wp) :: x

      x = sqrt(6.0_wp)
      ! The right rules are the left rules reversed, c_i -> 1 - c_i.
      select case (name)
      case ('radau_left2')
         ! Since int t^2 dt = 1/3 = (3/4) (2/3)^2, the rule is exact to degree two.
         nodes = [0.0_wp, 2.0_wp/3.0_wp]
         weights = [0.25_wp, 0.75_wp]
      case ('radau_right2')
         nodes = [1.0_wp/3.0_wp, 1.0_wp]
         weights = [0.75_wp, 0.25_wp]
      case ('radau_left3')
         nodes = ([0.0_wp, 6.0_wp, 6.0_wp] + x*[0.0_wp, -1.0_wp, 1.0_wp])/10
         weights = ([4.0_wp, 16.0_wp, 16.0_wp] + x*[0.0_wp, 1.0_wp, -1.0_wp])/36
      case default
         nodes = ([4.0_wp, 4.0_wp, 10.0_wp] + x*[-1.0_wp, 1.0_wp, 0.0_wp])/10
         weights = ([16.0_wp, 16.0_wp, 4.0_wp] + x*[-1.0_wp, 1.0_wp, 0.0_wp])/36
      end select
   end subroutine radau

   !> Largest d such that polynomials up to degree d are integrated exactly over [0,1]; -1 if the weights do not sum
   !> to one. Tested on Legendre's polynomials, whose moments vanish without cancellation; d is at most 2 nnode - 1.
   pure integer function exactness_degree(nodes, weights) result(degree)
      real(wp), intent(in) :: nodes(:)    !! (nnode)
      real(wp), intent(in) :: weights(:)  !! (nnode)
      real(wp) :: x(size(nodes)), older(size(nodes)), old(size(nodes)), new(size(nodes))
      integer :: k

      degree = -1
      if (.not. abs(sum(weights) - 1) <= tolerance) return
      ! Legendre's polynomials P_k(x), x = 2 t - 1, have vanishing moments for k > 0: a rule is exact to degree d if the
      ! sums over its nodes vanish for k = 1 .. d.
      x = 2*nodes - 1
      ! older and old are P_{k-1} and P_k at the nodes.
      older = 1
      old = x
      do k = 1, 2*size(nodes)
         degree = k - 1
         if (.not. abs(dot_product(weights, old)) <= tolerance) return
         ! (k + 1) P_{k+1} = (2 k + 1) x P_k - k P_{k-1}
         new = ((2*k + 1)*x*old - k*older)/(k + 1)
         older = old
         old = new
      end do
   end function exactness_degree

end module symsde_scheme_quadrature
