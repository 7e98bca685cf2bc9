! SPDX-License-Identifier: BSD-3-Clause
!> Initial states drawn from a law, as a function of seed and path alone:
!>
!>    (q, p) = centre + factor z,    z = (z_1 .. z_2n)
!>
!> with z_i of q_i and z_(n+i) of p_i. A normal law has standard normal numbers, so that factor factor^T is the
!> covariance; a uniform law has numbers between -1 and 1. The numbers of degree of freedom i are a pair of one draw of
!> the generator: the normals of fine steps 0 and 1 of a stream of their own, or two uniforms. The counter is
!> (seed, path, draw 0, noise i - 1, level = stream, purpose), see symsde_noise_philox. No noise of a run has these
!> purposes, so states are independent of what drives the paths. A path has the same state in every run, in any part
!> of it, and for any number of degrees of freedom the same z_i and z_(n+i).
module symsde_noise_states
   use symsde_base_kinds, only: wp, i8
   use symsde_base_status, only: error_type, raise, invalid_argument, wrong_shape
   use symsde_base_text, only: to_text
   use symsde_noise_normal, only: normal_pairs, uniform_open_lanes
   use symsde_noise_philox, only: philox_lanes, purpose_normal_state, purpose_uniform_state
   implicit none
   private
   public :: draw_states, normal_states, uniform_states

   integer, parameter :: normal_states = 1   !! standard normal numbers z
   integer, parameter :: uniform_states = 2  !! numbers z between -1 and 1

   integer, parameter :: nlane = 256           !! paths at a time
   integer, parameter :: most_dof = 2**20      !! noises of the counter
   integer, parameter :: most_streams = 64     !! levels of the counter
   integer(i8), parameter :: most_paths = 2_i8**48

contains

   !> Draw the states of the paths first_path .. first_path + npath - 1. A factor of one column holds deviations: then
   !> coordinates are independent, and component i is centre(i) + factor(i, 1) z_i. Streams are independent of each
   !> other; stream 0 is that of states, the others are free for further variables.
   subroutine draw_states(law, seed, first_path, centre, factor, q, p, error, stream)
      integer, intent(in) :: law                !! normal_states or uniform_states
      integer(i8), intent(in) :: seed           !! the 64-bit key
      integer(i8), intent(in) :: first_path     !! global index of the first path, 0 .. 2**48-1
      real(wp), intent(in), contiguous :: centre(:)          !! (2*ndof), of q and then p
      real(wp), intent(in), contiguous :: factor(:, :)       !! (2*ndof, 2*ndof or 1)
      real(wp), intent(out), contiguous :: q(:, :), p(:, :)  !! (npath, ndof)
      type(error_type), allocatable, intent(inout) :: error
      integer, intent(in), optional :: stream   !! 0 .. 63
      integer :: chosen

      if (allocated(error)) return
      chosen = 0
      if (present(stream)) chosen = stream
      call check(law, first_path, centre, factor, q, p, chosen, error)
      if (allocated(error)) return
      call draw(law, seed, first_path, chosen, size(q, 2), size(q, 1, i8), size(factor, 2), centre, factor, q, p)
   end subroutine draw_states

   !> Refuse shapes that do not fit, and numbers beyond the counter.
   subroutine check(law, first_path, centre, factor, q, p, stream, error)
      integer, intent(in) :: law, stream
      integer(i8), intent(in) :: first_path
      real(wp), intent(in) :: centre(:), factor(:, :), q(:, :), p(:, :)  ! see draw_states
      type(error_type), allocatable, intent(inout) :: error
      integer :: n

      n = 2*size(q, 2)
      if (law /= normal_states .and. law /= uniform_states) then
         call raise(error, invalid_argument, 'draw_states', 'law = '//to_text(law)// &
                    ': give 1, normal, or 2, uniform')
      else if (stream < 0 .or. stream >= most_streams) then
         call raise(error, invalid_argument, 'draw_states', 'stream = '//to_text(stream)//': give 0 .. 63')
      else if (first_path < 0 .or. first_path > most_paths - size(q, 1, i8)) then
         call raise(error, invalid_argument, 'draw_states', 'first_path = '//to_text(first_path)// &
                    ': give paths between 0 and 2**48 - 1')
      else if (n < 2 .or. n > 2*most_dof .or. size(p, 1, i8) /= size(q, 1, i8) .or. size(p, 2) /= size(q, 2) .or. &
               size(centre) /= n .or. size(factor, 1) /= n .or. &
               (size(factor, 2) /= 1 .and. size(factor, 2) /= n)) then
         call raise(error, wrong_shape, 'draw_states', &
                    'states of '//to_text(n/2)//' degrees of freedom: q and p have the shape (path, dof), the '// &
                    'centre has 2 dof numbers, the factor as many rows, and as many columns or one')
      end if
   end subroutine check

   !> Draw states of checked arguments, 256 paths at a time.
   subroutine draw(law, seed, first_path, stream, ndof, npath, ncolumn, centre, factor, q, p)
      integer, intent(in) :: law, stream, ndof
      integer(i8), intent(in) :: seed, first_path, npath
      integer, intent(in) :: ncolumn                     !! 1 or 2*ndof
      real(wp), intent(in) :: centre(2*ndof), factor(2*ndof, ncolumn)
      real(wp), intent(out) :: q(npath, ndof), p(npath, ndof)
      real(wp), allocatable :: z(:, :)                   !! (nlane, 2*ndof)
      real(wp) :: x(nlane)
      integer(i8) :: path(nlane), first
      integer :: i, lane, n

      allocate (z(nlane, 2*ndof))
      do first = 0, npath - 1, nlane
         n = int(min(int(nlane, i8), npath - first))
         do lane = 1, nlane
            ! Lanes beyond the last path repeat it, so that all loops over lanes have one length.
            path(lane) = first_path + min(first + lane - 1, npath - 1)
         end do
         do i = 1, ndof
            call numbers(law, seed, path, i - 1, stream, z(1, i), z(1, ndof + i))
         end do
         do i = 1, 2*ndof
            call combine(ndof, ncolumn, i, centre(i), factor, z, x)
            if (i <= ndof) then
               q(first + 1:first + n, i) = x(:n)
            else
               p(first + 1:first + n, i - ndof) = x(:n)
            end if
         end do
      end do
   end subroutine draw

   !> The two numbers z of a degree of freedom.
   subroutine numbers(law, seed, path, noise, stream, of_q, of_p)
      integer, intent(in) :: law, noise, stream
      integer(i8), intent(in) :: seed, path(nlane)
      real(wp), intent(out) :: of_q(nlane), of_p(nlane)
      integer(i8) :: words(nlane, 4)

      if (law == normal_states) then
         call normal_pairs(nlane, seed, path, 0_i8, noise, stream, purpose_normal_state, of_q, of_p)
      else
         call philox_lanes(nlane, seed, path, 0_i8, noise, stream, purpose_uniform_state, words)
         call uniform_open_lanes(nlane, words, of_q, of_p)
         of_q = 2*of_q - 1
         of_p = 2*of_p - 1
      end if
   end subroutine numbers

   !> Component i: x = centre + sum_j factor(i, j) z_j, with j ascending.
   pure subroutine combine(ndof, ncolumn, i, centre, factor, z, x)
      integer, intent(in) :: ndof, ncolumn, i
      real(wp), intent(in) :: centre, factor(2*ndof, ncolumn), z(nlane, 2*ndof)
      real(wp), intent(out) :: x(nlane)
      integer :: j, lane

      x = centre
      if (ncolumn == 1) then
         x = x + factor(i, 1)*z(:, i)
      else
         do j = 1, ncolumn
            if (abs(factor(i, j)) <= 0) cycle
            do lane = 1, nlane
               x(lane) = x(lane) + factor(i, j)*z(lane, j)
            end do
         end do
      end if
   end subroutine combine

end module symsde_noise_states
