! SPDX-License-Identifier: BSD-3-Clause
!>    Hess S v ~ (g(x + e v) - g(x - e v))/(2 e),   g = grad S,   S = H, H_k or a sum: zero where a trait says so
!>
!> The probe tests declarations of a model by differences of its gradients at three points, and refuses a false one by
!> name with the numbers that refute it. Directions without zeros decide, which takes some tens of gradients for any
!> number of degrees of freedom; only then the wrong entry is searched. A declaration that is false only far from the
!> initial state is not detected.
module symsde_model_probe_traits
   use symsde_base_kinds, only: wp
   use symsde_base_memory, only: require_memory
   use symsde_base_status, only: error_type, raise, false_trait, wrong_shape
   use symsde_base_text, only: to_text
   use symsde_base_traits, only: model_traits
   use symsde_model_abstract, only: model_type
   use symsde_model_kernels, only: kernel_model, kernels_of
   use symsde_model_parameters, only: check_traits
   use symsde_model_probe_damping, only: probe_damping
   use symsde_model_probe_derivatives, only: probe_derivatives, probe_derivatives_of_all, largest_dense
   use symsde_model_probe_forces, only: probe_forces
   use symsde_model_probe_gradient, only: probe_gradient
   use symsde_model_probe_mass, only: compare_mass, compare_quadratic, compare_turns
   use symsde_model_probe_parts, only: probe_parts
   use symsde_model_probe_points, only: no_verdict, probe_points, new_probe_points, nlane, npoint, finding, worst, &
                                        largest_entry
   use symsde_model_probe_rows, only: probe_rows
   use symsde_model_probe_squares, only: probe_squares
   use symsde_model_probe_supports, only: probe_supports
   implicit none
   private
   public :: probe_model, find_traits

   character(*), parameter :: here = 'probe_model'
   real(wp), parameter :: vanishing = 1.0e-6_wp  !! entries below this part of the largest count as zero

contains

   !> Test gradient, declared traits and offered derivatives of a model around an initial state. Refuses impossible
   !> traits (check_traits), a state of the wrong shape (wrong_shape), a gradient that belongs to no sum of
   !> Hamiltonians, and traits or derivatives that gradients refute (false_trait). Skips points where the model is not
   !> finite; decided: whether it is finite at the state.
   subroutine probe_model(model, t, q0, p0, error, decided)
      class(model_type), intent(in) :: model
      real(wp), intent(in) :: t, q0(:), p0(:)  !! initial time, and state of one path (ndof)
      type(error_type), allocatable, intent(inout) :: error
      logical, intent(out), optional :: decided
      type(probe_points) :: points
      class(kernel_model), pointer :: rows
      integer :: k

      if (present(decided)) decided = .false.
      if (allocated(error)) return
      call check_traits(here, model%name, model%traits, error)
      if (size(q0) /= model%traits%ndof .or. size(p0) /= model%traits%ndof) &
         call raise(error, wrong_shape, here, 'the initial state has '//to_text(size(q0))// &
                    ' positions and '//to_text(size(p0))//' momenta; model '''//model%name// &
                    ''' needs '//to_text(model%traits%ndof)//' of each')
      call require_memory(probe_numbers(model%traits), 'the probe of model '''//model%name//'''', 'give a smaller '// &
                          'system, or a smaller bandwidth', here, error)
      if (allocated(error)) return
      call new_probe_points(points, model, t, q0, p0)
      rows => kernels_of(model)
      if (model%traits%has_parts .and. associated(rows)) call probe_parts(points, rows, error, decided)
      if (.not. model%traits%has_gradient) then
         call model%clear_failure()
         return
      end if
      call probe_gradient(points, error)
      call probe_forces(points, error)
      call probe_damping(points, error)
      do k = 0, points%last_sum()
         call points%take_sum(k)
         call probe_traits(points, model%traits, k, error)
      end do
      if (model%traits%touches%are_given()) call probe_supports(points, vanishing, error)
      call points%take_all()
      if (model%traits%bandwidth >= 0) call probe_bandwidth(points, model%traits%bandwidth, error)
      do k = 0, points%last_sum()
         call points%take_sum(k)
         call probe_derivatives(points, model%traits, k, error)
      end do
      call points%take_all()
      call probe_derivatives_of_all(points, error)
      if (associated(rows)) then
         if (rows%offers%rows) call probe_rows(points, rows, error)
         if (rows%offers%squares) call probe_squares(points, rows, error)
      end if
      if (present(decided)) decided = points%slope(1) <= huge(1.0_wp)
      call model%clear_failure()  ! a user's function may fail at a displaced point
   end subroutine probe_model

   !> Most numbers of eight bytes that a probe holds: vectors, and Hessians if these are probed.
   pure real(wp) function probe_numbers(traits)
      type(model_traits), intent(in) :: traits
      real(wp) :: n, b

      n = traits%ndof
      b = traits%bandwidth
      probe_numbers = nlane*(60*n + 12.0_wp*traits%nnoise)
      if (b >= 0) probe_numbers = probe_numbers + nlane*6*(2*b + 1)*n
      if (n <= largest_dense) probe_numbers = probe_numbers + nlane*9*n**2
   end function probe_numbers

   !> Test the declarations about the Hamiltonians themselves, each trait by its own probe.
   subroutine probe_traits(points, traits, k, error)
      type(probe_points), intent(inout) :: points
      type(model_traits), intent(in) :: traits
      integer, intent(in) :: k  !! number of the sum; 0 is H
      type(error_type), allocatable, intent(inout) :: error

      if (allocated(error)) return
      if (k == 0 .and. traits%has_constant_mass()) call probe_mass(points, traits, error)
      if (traits%kicks_of_actions) then
         call probe_turns(points, k, error)
      else if (k == 0 .and. allocated(traits%quadratic_part)) then
         call probe_quadratic_part(points, error)
      end if
      if (k > 0 .and. traits%position_noise) call probe_position_noise(points, error)
      if (k > 0 .and. traits%additive) call probe_additive(points, error)
      if (traits%separable) call probe_separable(points, error)
      if (traits%quadratic) call probe_quadratic(points, 'quadratic', error)
      if (k > 0 .and. traits%phase_noise) call probe_quadratic(points, 'phase_noise', error)
      if (k > 0 .and. allocated(traits%silent)) call probe_silent(points, k, error)  ! last: it changes the sum
   end subroutine probe_traits

   !> The traits of a model, and those beside them that no gradient refutes at the points around a state: a probe can
   !> refute a trait, and proves none. decided: whether the gradient is finite at all points; else nothing is added.
   !> Traits with numbers are not looked for, but for a bandwidth of at most `widest` where it leaves most entries out.
   subroutine find_traits(model, t, q0, p0, found, decided)
      class(model_type), intent(in) :: model
      real(wp), intent(in) :: t, q0(:), p0(:)  !! time, and state of one path (ndof)
      type(model_traits), intent(out) :: found
      logical, intent(out) :: decided
      integer, parameter :: widest = 3
      type(probe_points) :: points
      type(model_traits) :: one
      integer :: b

      found = model%traits
      call new_probe_points(points, model, t, q0, p0)
      call points%take_all()
      decided = all(points%slope(:npoint) >= 0 .and. points%slope(:npoint) <= huge(1.0_wp))
      if (decided) then
         one = model_traits(separable=.true.)
         found%separable = found%separable .or. holds(one)
         one = model_traits(quadratic=.true.)
         found%quadratic = found%quadratic .or. holds(one)
         one = model_traits(identity_mass=.true.)
         found%identity_mass = found%identity_mass .or. (.not. found%has_constant_mass() .and. holds(one))
         one = model_traits(constant_mass=.true.)
         found%constant_mass = found%constant_mass .or. (.not. found%identity_mass .and. holds(one))
         one%diagonal_mass = .true.
         found%diagonal_mass = found%diagonal_mass .or. (found%constant_mass .and. holds(one))
         one = model_traits(additive=.true.)
         found%additive = found%additive .or. (points%nnoise > 0 .and. holds(one))
         one = model_traits(position_noise=.true.)
         found%position_noise = found%position_noise .or. (points%nnoise > 0 .and. holds(one))
         call points%take_all()
         do b = 0, widest
            if (found%bandwidth >= 0 .or. 4*b >= points%ndof - 1) exit
            if (has_bands(b)) found%bandwidth = b
         end do
      end if
      call model%clear_failure()  ! a user's function may fail at a displaced point

   contains

      !> Whether no sum refutes a declaration.
      logical function holds(declared)
         type(model_traits), intent(in) :: declared
         type(error_type), allocatable :: refuted
         integer :: k

         do k = 0, points%last_sum()
            call points%take_sum(k)
            call probe_traits(points, declared, k, refuted)
         end do
         holds = .not. allocated(refuted)
      end function holds

      logical function has_bands(width)
         integer, intent(in) :: width
         type(error_type), allocatable :: refuted

         call probe_bandwidth(points, width, refuted)
         has_bands = .not. allocated(refuted)
      end function has_bands

   end subroutine find_traits

   !> For identity_mass the probe tests H_p = p, for constant_mass H_p = M^-1 p with some constant M, or a diagonal one.
   subroutine probe_mass(points, traits, error)
      type(probe_points), intent(in) :: points
      type(model_traits), intent(in) :: traits
      type(error_type), allocatable, intent(inout) :: error
      character(:), allocatable :: trait, quantity
      type(finding) :: bad
      real(wp) :: x

      call compare_mass(points, traits, vanishing, trait, bad, quantity, x)
      if (bad%lane > 0) call refuse(points, trait, quantity, x, bad%lane, bad%i, bad%i, error)
   end subroutine probe_mass

   !> Velocities must be those of the declared quadratic part, H_p = S_pq q + S_pp p.
   subroutine probe_quadratic_part(points, error)
      type(probe_points), intent(in) :: points
      type(error_type), allocatable, intent(inout) :: error
      type(finding) :: bad
      real(wp) :: x

      if (allocated(error)) return
      call compare_quadratic(points, vanishing, bad, x)
      if (bad%lane > 0) &
         call raise(error, false_trait, here, 'model '''//points%model%name//''' declares a quadratic part of H '// &
                    '(split) that holds all momenta, but dH_0/dp_'//to_text(bad%i)//' minus its own derivative = '// &
                    to_text(x)//' at '//points%place(bad%lane, bad%i, bad%i)//'; give the second derivatives of H '// &
                    'by p, and by q and p, or declare none')
   end subroutine probe_quadratic_part

   !> What a declared quadratic part leaves of H, and every noise, must be a function of the actions.
   subroutine probe_turns(points, k, error)
      type(probe_points), intent(in) :: points
      integer, intent(in) :: k  !! number of the sum; 0 is H
      type(error_type), allocatable, intent(inout) :: error
      type(finding) :: bad
      real(wp) :: x

      if (allocated(error)) return
      call compare_turns(points, k == 0, vanishing, bad, x)
      if (bad%lane > 0) call refuse(points, 'kicks', '{(q^2 + p^2)/2, '//points%sum_name// &
                                    trim(merge(' - D', '    ', k == 0))//'} of degree of freedom '//to_text(bad%i), x, &
                                    bad%lane, bad%i, bad%i, error)
   end subroutine probe_turns

   !> Noises declared silent must have zero gradient, H_k = 0; if a sum has several noises, the sum of the silent ones
   !> is tested.
   subroutine probe_silent(points, k, error)
      type(probe_points), intent(inout) :: points
      integer, intent(in) :: k
      type(error_type), allocatable, intent(inout) :: error
      real(wp), allocatable :: hq(:, :), hp(:, :)
      real(wp) :: scale(nlane)
      type(finding) :: bad
      integer :: last, j

      last = merge(points%nnoise, k, k == points%last_sum())  ! the last sum may contain several noises
      if (.not. any(points%model%traits%silent(k:last))) return
      do j = k, last
         if (.not. points%model%traits%silent(j)) points%w(:, j) = 0
      end do
      call points%gradient(hq, hp, scale)
      call worst(hq, hp, scale, vanishing, bad)
      if (bad%lane == 0) return
      if (bad%half == 2) hq = hp
      call refuse(points, 'silent', 'd'//points%sum_name//merge('/dq_', '/dp_', bad%half == 1)// &
                  to_text(bad%i), hq(bad%lane, bad%i), bad%lane, bad%i, bad%i, error)
   end subroutine probe_silent

   !> If position_noise is declared, a noise must not depend on p: H_{k,p} = 0.
   subroutine probe_position_noise(points, error)
      type(probe_points), intent(in) :: points
      type(error_type), allocatable, intent(inout) :: error
      real(wp), allocatable :: hq(:, :), hp(:, :)
      real(wp) :: scale(nlane)
      type(finding) :: bad

      call points%gradient(hq, hp, scale)
      hq = 0
      call worst(hq, hp, scale, vanishing, bad)
      if (bad%lane == 0) return
      call refuse(points, 'position_noise', 'd'//points%sum_name//'/dp_'//to_text(bad%i), &
                  hp(bad%lane, bad%i), bad%lane, bad%i, bad%i, error)
   end subroutine probe_position_noise

   !> If additive is declared, H_k must be linear, so that its Hessian vanishes.
   subroutine probe_additive(points, error)
      type(probe_points), intent(in) :: points
      type(error_type), allocatable, intent(inout) :: error
      real(wp), allocatable :: uq(:, :), up(:, :)
      real(wp) :: scale(nlane)
      type(finding) :: row
      integer :: pass

      ! Pass 1 takes one difference of gradients. If it refutes the trait, pass 2 takes two differences: the trait is
      ! refused only if they agree and refute it, too.
      do pass = 1, 2
         call points%product(points%vq, points%vp, uq, up, scale, pass == 2)
         call worst(uq, up, scale, vanishing, row)
         if (row%lane == 0) return
      end do
      call points%row_of_hessian(row, uq, up)
      call refuse_entry(points, 'additive', row, uq, up, error)
   end subroutine probe_additive

   !> If separable is declared, the mixed derivatives d2/(dq dp) must vanish.
   subroutine probe_separable(points, error)
      type(probe_points), intent(in) :: points
      type(error_type), allocatable, intent(inout) :: error
      real(wp), allocatable :: uq(:, :), up(:, :)
      real(wp) :: scale(nlane)
      type(finding) :: row
      integer :: pass

      do pass = 1, 2
         call points%product(points%zero, points%vp, uq, up, scale, pass == 2)
         up = 0
         call worst(uq, up, scale, vanishing, row)
         if (row%lane == 0) return
      end do
      call points%row_of_hessian(row, uq, up)
      uq = 0
      call refuse_entry(points, 'separable', row, uq, up, error)
   end subroutine probe_separable

   !> If quadratic is declared, the Hessian must be the same at all points: all are compared with the first two.
   subroutine probe_quadratic(points, trait, error)
      type(probe_points), intent(in) :: points
      character(*), intent(in) :: trait  !! that says so
      type(error_type), allocatable, intent(inout) :: error
      real(wp), allocatable :: uq(:, :), up(:, :), dq(:, :), dp(:, :)
      real(wp) :: scale(nlane), spread(nlane)
      type(finding) :: row, column
      integer :: from

      call points%product(points%vq, points%vp, uq, up, scale)
      do from = 1, npoint - 1
         call subtract_point(points%ndof, from, uq, up, dq, dp)
         spread = max(scale, scale(from)) + 0*(scale + scale(from))
         where (min(scale, scale(from)) < 0) spread = no_verdict
         call worst(dq, dp, spread, vanishing, row)
         if (row%lane > 0) exit
      end do
      if (row%lane == 0) return
      call points%row_of_hessian(row, uq, up)
      call subtract_point(points%ndof, from, uq, up, dq, dp)
      column = largest_entry(row%lane, dq, dp)
      if (column%half == 2) dq = dp
      call refuse(points, trait, points%entry_name(row, column)// &
                  ' minus its value at ('//points%place(from, row%i, column%i)//')', &
                  dq(row%lane, column%i), row%lane, row%i, column%i, error)
   end subroutine probe_quadratic

   !> The product at all points minus its value at the point `from`.
   subroutine subtract_point(ndof, from, uq, up, dq, dp)
      integer, intent(in) :: ndof, from
      real(wp), intent(in) :: uq(nlane, ndof), up(nlane, ndof)
      real(wp), allocatable, intent(out) :: dq(:, :), dp(:, :)
      integer :: i

      allocate (dq(nlane, ndof), dp(nlane, ndof))
      do i = 1, ndof
         dq(:, i) = uq(:, i) - uq(from, i)
         dp(:, i) = up(:, i) - up(from, i)
      end do
   end subroutine subtract_point

   !> If a bandwidth b is declared, entries with |i-j| > b must vanish. Columns a stride apart are probed together: in
   !> rows farther than b from all of them the product must vanish. Three strides are tried, with at most 32 sets of
   !> columns each, so that the cost does not grow with the system.
   subroutine probe_bandwidth(points, b, error)
      type(probe_points), intent(in) :: points
      integer, intent(in) :: b
      type(error_type), allocatable, intent(inout) :: error
      integer, parameter :: most = 32
      integer, parameter :: factor(3) = [4, 5, 7]
      integer :: stride, k, set, nset, first

      if (b >= points%ndof - 1) return
      do k = 1, size(factor)
         stride = factor(k)*(b + 1) + k - 1  ! an entry missed by one stride is usually found by another
         nset = min(stride, points%ndof, most)
         do set = 0, nset - 1
            if (allocated(error)) return
            first = 1 + (set*min(stride, points%ndof))/nset
            call probe_columns(points, b, first, stride, error)
         end do
      end do
   end subroutine probe_bandwidth

   !> Probe the columns first, first + stride, .. of the four blocks: the product must vanish in rows far from all of
   !> them.
   subroutine probe_columns(points, b, first, stride, error)
      type(probe_points), intent(in) :: points
      integer, intent(in) :: b, first, stride
      type(error_type), allocatable, intent(inout) :: error
      real(wp), allocatable :: v(:, :), uq(:, :), up(:, :)
      real(wp) :: scale(nlane)
      type(finding) :: row
      integer :: half, pass

      allocate (v, mold=points%zero)
      v = 0
      v(:, first::stride) = points%vq(:, first::stride)
      do half = 1, 2
         do pass = 1, 2
            if (half == 1) call points%product(v, points%zero, uq, up, scale, pass == 2)
            if (half == 2) call points%product(points%zero, v, uq, up, scale, pass == 2)
            call clear_bands(points%ndof, b, first, stride, uq, up)
            call worst(uq, up, scale, vanishing, row)
            if (row%lane == 0) exit
         end do
         if (row%lane == 0) cycle
         call points%row_of_hessian(row, uq, up)
         call clear_bands(points%ndof, b, row%i, points%ndof, uq, up)
         call refuse_entry(points, 'bandwidth', row, uq, up, error)
         return
      end do
   end subroutine probe_columns

   !> Set to zero the rows within b of the columns first, first + stride, .., where entries are allowed.
   pure subroutine clear_bands(ndof, b, first, stride, uq, up)
      integer, intent(in) :: ndof, b, first, stride
      real(wp), intent(inout) :: uq(nlane, ndof), up(nlane, ndof)
      integer :: j

      do j = first, ndof, stride
         uq(:, max(1, j - b):min(ndof, j + b)) = 0
         up(:, max(1, j - b):min(ndof, j + b)) = 0
      end do
   end subroutine clear_bands

   !> Refuse a trait and name the largest entry of a row of the Hessian, which should vanish.
   subroutine refuse_entry(points, trait, row, uq, up, error)
      type(probe_points), intent(in) :: points
      character(*), intent(in) :: trait
      type(finding), intent(in) :: row
      real(wp), intent(in) :: uq(:, :), up(:, :)  !! the row (nlane, ndof)
      type(error_type), allocatable, intent(inout) :: error
      type(finding) :: column
      real(wp) :: x

      column = largest_entry(row%lane, uq, up)
      if (column%half == 1) x = uq(row%lane, column%i)
      if (column%half == 2) x = up(row%lane, column%i)
      call refuse(points, trait, points%entry_name(row, column), x, row%lane, row%i, column%i, error)
   end subroutine refuse_entry

   !> Refuse a trait (false_trait) because a quantity that should be zero is not; the message gives its value and
   !> place.
   subroutine refuse(points, trait, quantity, x, lane, i, j, error)
      type(probe_points), intent(in) :: points
      character(*), intent(in) :: trait, quantity  !! name of the trait, name of the quantity
      real(wp), intent(in) :: x                !! value of the quantity
      integer, intent(in) :: lane, i, j        !! the point, and the degrees of freedom for the message
      type(error_type), allocatable, intent(inout) :: error
      character(:), allocatable :: declared, remedy

      declared = trait
      remedy = 'set '//trait//' to false'
      if (trait == 'bandwidth') then
         declared = trait//' '//to_text(points%model%traits%bandwidth)
         remedy = 'declare a larger one, or none'
      else if (trait == 'phase_noise') then
         remedy = 'declare kicks by functions of the actions alone'
      end if
      call raise(error, false_trait, here, 'model '''//points%model%name//''' declares '// &
                 declared//', but '//quantity//' = '//to_text(x)//' at '//points%place(lane, i, j)// &
                 '; '//remedy//', or correct the gradient')
   end subroutine refuse

end module symsde_model_probe_traits
