! SPDX-License-Identifier: BSD-3-Clause
!>    {F,G} = F_q.G_p - F_p.G_q,     grad {F,G} = Hess F V_G - Hess G V_F,     V_G = (G_p, -G_q)
!>
!> Find by brackets at sample points whether the noises of a model commute, and which order to expect.
!>
!>    {H_k,H_l} constant for all k, l    commutative noises: increments alone reach strong order 1, dZ 3/2
!>    {H,H_k} constant for all k, and    the drift commutes too: the flow is that of H t + sum_k H_k W_k
!>    no H_k changes in time
!>
!> The gradient follows from {F,G} = grad F . V_G with V_G = J grad G: differentiating F gives Hess F V_G,
!> differentiating G gives (J Hess G)^T grad F = -Hess G J grad F = -Hess G V_F. Two Hessian-vector products suffice; no
!> third derivative is needed.
!>
!> A bracket is constant if its gradient Hess F V_G - Hess G V_F vanishes (V: the Hamiltonian field). The gradient is
!> divided by |Hess F| |V_G| + |Hess G| |V_F|, the largest among the points, and not by the two products, which may both
!> vanish up to rounding, as for sin(q+p) and cos(q+p). The norms are those of products with the field under changes of
!> sign, which do not all cancel at once. Numbers below 1e-6 are rounding, or the error of differences if the model has
!> no analytic Hessian. Noise that changes in time, H_k = sigma(t) I, does not commute with the drift: in the phase
!> space with time the bracket is {H,H_k} - H_{k,t}. Points can refute commutation, not prove it.
!>
!> Pairs of noises in position, and of noises that touch no common degree of freedom, commute as they stand.
!>
!> Forces (model/forces) are added to the fields, and their derivatives to the products: the test then asks whether the
!> Lie brackets of the fields vanish.
module symsde_diagnose_commutator
   use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_positive_inf
   use symsde_base_kinds, only: wp, i8
   use symsde_base_memory, only: require_memory
   use symsde_base_status, only: error_type, raise, wrong_shape
   use symsde_base_text, only: to_text
   use symsde_ensemble_monitor, only: monitor_type, stop_if_wanted
   use symsde_base_traits, only: model_traits
   use symsde_model_abstract, only: model_type, default_step
   use symsde_model_probe_one_path, only: one_path
   use symsde_scheme_catalogue, only: get_scheme
   use symsde_scheme_needs, only: find_missing
   use symsde_scheme_scheme, only: scheme_type
   implicit none
   private
   public :: commutator_type, commutator

   real(wp), parameter :: vanishing = 1e-6_wp  !! relative size below which a gradient counts as zero
   real(wp), parameter :: later(3) = [0.0137_wp, 0.61_wp, 1.93_wp] !! times after t at which H_k may have changed [time]
   integer, parameter :: npattern = 8          !! number of changes of sign
   integer(i8), parameter :: most_paths = 64   !! paths with parameters of their own that are looked at

   !> Sample points, and the time.
   type :: sample_points
      integer :: n = 0
      real(wp) :: t = 0
      real(wp), allocatable :: q(:, :), p(:, :)  !! (n, ndof)
   end type sample_points

   type :: commutator_type
      real(wp) :: noise = 0             !! largest relative |grad {H_k,H_l}|
      real(wp) :: drift = 0             !! largest relative |grad {H,H_k}|, or change of grad H_k in time
      integer :: k = 0, l = 0           !! pair of noises with the largest noise gradient
      logical :: commutative = .true.   !! the noises commute at all points
      logical :: flows_commute = .true. !! the noises commute with each other and with the drift
      character(:), allocatable :: text !! which order to expect, of which scheme
   end type commutator_type

contains

   !> Brackets at the points (q, p) and time t; where parameters go by path, the largest of all paths, or of as many as
   !> are looked at, at equal distances. Errors: wrong_shape; stopped, by the monitor, which is called before each
   !> bracket.
   subroutine commutator(model, t, q, p, result, error, monitor)
      class(model_type), intent(in), target :: model
      real(wp), intent(in) :: t                  !! time [time]
      real(wp), intent(in) :: q(:, :), p(:, :)   !! sample points (npoint, ndof)
      type(commutator_type), intent(out) :: result
      type(error_type), allocatable, intent(inout) :: error
      class(monitor_type), intent(inout), optional :: monitor
      type(sample_points) :: points
      type(one_path) :: path
      integer(i8) :: i, n, done, nbracket

      call model%require_gradient('commutator', 'a bracket of Hamiltonians', error)
      if (allocated(error)) return
      if (any(shape(q) /= shape(p)) .or. size(q, 2) /= model%traits%ndof .or. size(q, 1) < 1) then
         call raise(error, wrong_shape, 'commutator', 'q is ('//to_text(size(q, 1))//','//to_text(size(q, 2))// &
                    ') and p ('//to_text(size(p, 1))//','//to_text(size(p, 2))//'); both must be (npoint,'// &
                    to_text(model%traits%ndof)//') with at least one point')
         return
      end if
      call require_memory(size(q, 1)*(20.0_wp*model%traits%ndof + 4.0_wp*model%traits%nnoise &
                                      + merge(3.0_wp*real(model%traits%ndof, wp)**2, 0.0_wp, &
                                              model%traits%has_hessian .and. .not. model%traits%has_hessian_vector)), &
                          'the brackets at '//to_text(size(q, 1))//' points', 'give fewer points', 'commutator', error)
      if (allocated(error)) return
      ! The points are lanes of one call of the model.
      points%n = size(q, 1)
      points%t = t
      allocate (points%q, source=q)
      allocate (points%p, source=p)
      done = 0
      call path%begin(model)
      n = min(path%count, most_paths)
      nbracket = n*model%traits%nnoise*(model%traits%nnoise + 1)/2
      do i = 0, n - 1
         if (i > 0) call path%look_at(i*(path%count - 1)/(n - 1), 1)
         call add_brackets(path%model, points, done, nbracket, result, error, monitor)
         if (allocated(error)) exit
      end do
      call path%finish()
      if (allocated(error)) return
      result%commutative = result%noise <= vanishing
      ! Damping does not commute with any noise but those that move nothing.
      result%flows_commute = result%commutative .and. result%drift <= vanishing .and. .not. model%damping%acts()
      call expect_orders(model%traits%nnoise, model%damping%acts(), associated(model%forces), &
                         model%traits%forces%in_position(), model%traits, result)
   end subroutine commutator

   !> Let a result have the brackets of this model where they are larger than those of models before.
   subroutine add_brackets(model, points, done, nbracket, result, error, monitor)
      class(model_type), intent(in) :: model
      type(sample_points), intent(in) :: points
      integer(i8), intent(inout) :: done
      integer(i8), intent(in) :: nbracket
      type(commutator_type), intent(inout) :: result
      type(error_type), allocatable, intent(inout) :: error
      class(monitor_type), intent(inout), optional :: monitor
      real(wp) :: size_kl
      integer :: j, k

      do k = 1, model%traits%nnoise
         ! j = 0 is the drift H, paired with every noise; j > 0 are the pairs of noises.
         do j = 0, k - 1
            call stop_if_wanted(monitor, done, nbracket, 'commutator', error)
            if (allocated(error)) return
            done = done + 1
            if (j > 0) then
               if (are_apart(model%traits, j, k)) cycle
            end if
            size_kl = relative_gradient(model, points, j, k)
            if (j == 0) then
               result%drift = max(result%drift, size_kl)
               ! Keep the pair that commutes least, for the message.
            else if (size_kl > result%noise .or. result%k == 0) then
               result%noise = size_kl
               result%k = j
               result%l = k
            end if
         end do
         ! In the phase space with time the bracket is {H,H_k} - H_k,t; each of the two terms must vanish by
         ! itself.
         result%drift = max(result%drift, change_in_time(model, points, k))
      end do
   end subroutine add_brackets

   !> Whether the traits say that the bracket of two noises vanishes: both are functions of q, or they touch no common
   !> degree of freedom.
   pure logical function are_apart(traits, k, l)
      type(model_traits), intent(in) :: traits
      integer, intent(in) :: k, l
      integer :: i

      are_apart = traits%position_noise .and. traits%forces%noise_in_position
      if (are_apart .or. traits%forces%noise .or. .not. traits%touches%are_given()) return
      associate (from => traits%touches%from, dof => traits%touches%dof)
         are_apart = .not. any([(any(dof(from(k) + 1:from(k + 1)) == dof(i)), i=from(l) + 1, from(l + 1))])
      end associate
   end function are_apart

   !> Largest |Hess F V_G - Hess G V_F| over the points for F = H_j, G = H_k, relative to the largest
   !> |Hess F| |V_G| + |Hess G| |V_F|.
   real(wp) function relative_gradient(model, points, j, k) result(relative)
      class(model_type), intent(in) :: model
      type(sample_points), intent(in) :: points
      integer, intent(in) :: j, k
      real(wp), dimension(points%n, model%traits%ndof) :: fq, fp, gq, gp, aq, ap, bq, bp
      real(wp) :: difference, scale
      integer :: pattern

      ! (fq, fp) is V_F and (gq, gp) is V_G, F = H_j and G = H_k.
      call field(model, points, j, points%t, fq, fp)
      call field(model, points, k, points%t, gq, gp)
      ! The scale is the sum of the rounding of both products, but at least their largest size under changes of sign.
      scale = floor_of_differences(model, points, fq, fp)*largest(gq, gp) &
              + floor_of_differences(model, points, gq, gp)*largest(fq, fp)
      difference = 0
      do pattern = 1, npattern
         !   a = Hess F V_G,   b = Hess G V_F
         call product_with(model, points, j, gq, gp, pattern, aq, ap)
         call product_with(model, points, k, fq, fp, pattern, bq, bp)
         ! The first pattern gives the bracket itself; all patterns give the size of the products.
         if (pattern == 1) difference = largest(aq - bq, ap - bp)
         scale = max(scale, largest(aq, ap) + largest(bq, bp))
      end do
      relative = 0
      ! For linear Hamiltonians both are zero, so they commute. A value that is not finite counts as not commuting.
      if (scale > 0) relative = difference/scale
      if (.not. difference + scale <= huge(scale)) relative = huge(relative)
   end function relative_gradient

   !> The field V = (H_p, -H_q) of H_j at the time t, to which a force is added.
   subroutine field(model, points, j, t, vq, vp)
      class(model_type), intent(in) :: model
      type(sample_points), intent(in) :: points
      integer, intent(in) :: j
      real(wp), intent(in) :: t
      real(wp), intent(out), dimension(points%n, model%traits%ndof) :: vq, vp
      real(wp) :: w(points%n, 0:model%traits%nnoise), f(points%n, model%traits%ndof)

      w = 0
      w(:, j) = 1
      call model%gradient(points%n, model%traits%ndof, model%traits%nnoise, t, w, points%q, points%p, vp, vq)
      ! gradient has put H_p into vq and H_q into vp.
      vp = -vp
      if (.not. associated(model%forces)) return
      call model%force(points%n, model%traits%ndof, model%traits%nnoise, t, w, points%q, points%p, f)
      vp = vp + f
   end subroutine field

   !> The Hessian of H_j times (vq, vp), minus the derivative of the force along this vector, in the q part. The
   !> components of the vector change sign by a pattern: the first pattern changes none, the second the momenta.
   subroutine product_with(model, points, j, vq, vp, pattern, uq, up)
      class(model_type), intent(in) :: model
      type(sample_points), intent(in) :: points
      integer, intent(in) :: j, pattern
      real(wp), intent(in), dimension(points%n, model%traits%ndof) :: vq, vp
      real(wp), intent(out), dimension(points%n, model%traits%ndof) :: uq, up
      real(wp) :: w(points%n, 0:model%traits%nnoise)
      real(wp), dimension(points%n, model%traits%ndof) :: sq, sp, f
      integer :: i

      w = 0
      w(:, j) = 1
      sq = vq
      sp = vp
      if (pattern == 2) sp = -vp
      if (pattern > 2) then
         do i = 1, model%traits%ndof
            ! The signs are irregular over the degrees of freedom but the same in every call, so that results repeat.
            sq(:, i) = sign(1.0_wp, sin(real(i*(2*pattern - 1), wp)))*vq(:, i)
            sp(:, i) = sign(1.0_wp, cos(real(i*(3*pattern - 2), wp)))*vp(:, i)
         end do
      end if
      associate (s => points)
         call model%hessian_vector(s%n, model%traits%ndof, model%traits%nnoise, s%t, w, s%q, s%p, sq, sp, uq, up)
         if (.not. associated(model%forces)) return
         call model%force_along(s%n, model%traits%ndof, model%traits%nnoise, s%t, w, s%q, s%p, sq, sp, f)
         uq = uq - f
      end associate
   end subroutine product_with

   !> The error of a product by differences, for a vector of size one, due to rounding of the gradient (fq, fp). A
   !> bracket above 1e6 times this error counts as nonzero. Zero if products are analytic.
   pure real(wp) function floor_of_differences(model, points, fq, fp) result(size_at_least)
      class(model_type), intent(in) :: model
      type(sample_points), intent(in) :: points
      real(wp), dimension(:, :), intent(in) :: fq, fp   !! (npoint, ndof)

      size_at_least = 0
      if ((model%traits%has_hessian .or. model%traits%has_hessian_vector) .and. &
          (model%traits%forces%has_derivative .or. .not. model%traits%forces%act())) return
      ! A difference of gradients of size |f|, over the step default_step times the state, has the error eps |f|/step.
      size_at_least = epsilon(1.0_wp)*largest(fq, fp)/(default_step*max(1.0_wp, largest(points%q, points%p))*vanishing)
   end function floor_of_differences

   !> Largest change of grad H_k from t to some later times, relative to its size; times at which the model is not
   !> finite or fails are skipped.
   real(wp) function change_in_time(model, points, k) result(relative)
      class(model_type), intent(in) :: model
      type(sample_points), intent(in) :: points
      integer, intent(in) :: k
      real(wp), dimension(points%n, model%traits%ndof) :: fq, fp, gq, gp
      real(wp) :: change, scale
      integer :: i

      relative = 0
      call field(model, points, k, points%t, fq, fp)
      ! The three times have no common period: a noise whose period is one of them still changes at the others.
      do i = 1, size(later)
         call field(model, points, k, points%t + later(i), gq, gp)
         change = largest(gq - fq, gp - fp)
         scale = largest(fq, fp) + largest(gq, gp)
         if (scale > 0 .and. scale <= huge(scale)) relative = max(relative, change/scale)
      end do
   end function change_in_time

   !> The largest absolute entry; infinite if one is NaN.
   pure real(wp) function largest(xq, xp)
      real(wp), intent(in) :: xq(:, :), xp(:, :)   !! (npoint, ndof)

      largest = max(maxval(abs(xq)), maxval(abs(xp)))
      ! maxval may ignore NaN.
      if (.not. all(abs(xq) <= huge(largest)) .or. .not. all(abs(xp) <= huge(largest))) &
         largest = ieee_value(largest, ieee_positive_inf)
   end function largest

   !> Write which orders to expect.
   subroutine expect_orders(nnoise, damped, forced, of_positions, traits, c)
      integer, intent(in) :: nnoise
      logical, intent(in) :: damped   !! damped: schemes with brackets of H, or for means alone, do not run
      logical, intent(in) :: forced   !! forced: schemes with brackets of Hamiltonians do not run
      logical, intent(in) :: of_positions  !! forces depend on (q, t) alone, and kicks take them
      type(model_traits), intent(in) :: traits
      type(commutator_type), intent(inout) :: c
      character(:), allocatable :: orders

      ! Report the strongest result that holds; each case implies the cases before it.
      if (nnoise == 0) then
         c%text = 'no noise: the order without noise of the scheme'
      else if (c%flows_commute) then
         c%text = 'all flows commute: strong order 1 from midpoint, 2 from gauss2, 3 from gauss3, with increments alone'
      else if (c%commutative .and. forced) then
         c%text = 'the noises commute, with their forces: strong order 1 from every consistent tableau with '// &
                  'increments alone'
         if (of_positions) c%text = c%text//'; where H = p.M^-1 p/2 + U(q) and noise is in position, 3/2 from '// &
                                    'gauss_dkdkd with dZ, 2 from gauss_dkdkd_strong2'
      else if (forced) then
         c%text = 'the noises '//to_text(c%k)//' and '//to_text(c%l)//' do not commute, with their forces: strong '// &
                  'order 1/2 with increments alone, 1 from midpoint_areas where no force goes with a noise'
      else if (c%commutative .and. damped) then
         c%text = 'the noises commute: strong order 1 from midpoint with increments alone; where H = p.M^-1 p/2 + '// &
                  'U(q) and noise is in position, 3/2 from gauss_dkdkd with dZ, 2 from gauss_dkdkd_strong2'
      else if (damped) then
         c%text = 'the noises '//to_text(c%k)//' and '//to_text(c%l)//' do not commute: strong order 1/2 with '// &
                  'increments alone, 1 from midpoint_areas with areas where all rates of damping are equal'
      else if (c%commutative) then
         call find_orders(traits, orders)
         c%text = 'the noises commute: strong order 1 from every consistent scheme with increments alone, '// &
                  orders//' with dZ; weak order 2 from gauss2_weak2'
      else
         c%text = 'the noises '//to_text(c%k)//' and '//to_text(c%l)//' do not commute: strong order 1/2 with '// &
                  'increments alone, 1 from midpoint_areas with areas; weak order 1, 2 from gauss2_weak2_areas'
      end if
   end subroutine expect_orders

   !> The higher strong orders, by kicks where the traits allow these.
   subroutine find_orders(traits, orders)
      type(model_traits), intent(in) :: traits
      character(:), allocatable, intent(out) :: orders

      orders = '3/2 from gauss2_strong32'
      if (.not. suits('gauss_dkdkd', traits)) return
      orders = '3/2 from gauss_dkdkd'
      if (traits%additive) then
         orders = '2 from gauss_dkdkd'
      else if (suits('gauss_dkdkd_strong2', traits)) then
         orders = orders//', 2 from gauss_dkdkd_strong2'
      end if
   end subroutine find_orders

   !> Whether a scheme finds all that it needs.
   logical function suits(name, traits)
      character(*), intent(in) :: name
      type(model_traits), intent(in) :: traits
      type(scheme_type) :: scheme
      type(error_type), allocatable :: error
      character(:), allocatable :: missing

      call get_scheme(scheme, name, error)
      call find_missing(scheme, traits, missing)
      suits = .not. (allocated(error) .or. allocated(missing))
   end function suits

end module symsde_diagnose_commutator
