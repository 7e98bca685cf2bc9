! SPDX-License-Identifier: BSD-3-Clause
!> The probe of forces: the declarations of a model's forces must hold at the points.
!>
!>    linear in w        f(0) = 0 and f(w + 2 v) = f(w) + 2 f(v),     f = sum_j w_j F_j
!>    lane by lane       the force of a lane is the same whether all lanes differ or are equal
!>    in position        f(q, p) = f(q, p') if forces are declared to depend on q and t alone
!>    bandwidth          component i of f stays the same where q_j and p_j change with |i-j| > b
!>    derivatives        (f(x + e v) - f(x - e v))/(2 e) = f_q vq + f_p vp if derivatives are given, where x has digits
!>                       for the step
!>
!> Private to its family.
module symsde_model_probe_forces
   use symsde_base_kinds, only: wp
   use symsde_base_status, only: error_type, raise, false_trait
   use symsde_base_text, only: to_text
   use symsde_model_forces, only: force_difference
   use symsde_model_probe_points, only: probe_points, nlane, npoint, generic, too_far
   implicit none
   private
   public :: probe_forces

   ! Forces are compared to six digits, their derivatives by differences to four.
   real(wp), parameter :: vanishing = 1.0e-6_wp, matching = 1.0e-4_wp

contains

   !> Refuse forces (false_trait) that one of these tests refutes. Points at which forces are not finite are skipped.
   subroutine probe_forces(points, error)
      type(probe_points), intent(in) :: points
      type(error_type), allocatable, intent(inout) :: error
      character(*), parameter :: weigh = ': give F the weight w[0], and f_k the weight w[k]'
      real(wp), allocatable :: w(:, :), v(:, :)
      real(wp), allocatable, dimension(:, :) :: f, g, is, q, p
      integer :: k, lane, code

      if (allocated(error) .or. .not. associated(points%model%forces)) return
      associate (n => points%ndof, m => points%nnoise, t => points%t, model => points%model)
         allocate (w(nlane, 0:m), v(nlane, 0:m))
         allocate (f(nlane, n), g(nlane, n), is(nlane, n))
         w = 0
         call model%force(nlane, n, m, t, w, points%q, points%p, is)
         f = 0
         call judge(points, is, f, f, 'is not zero where all weights are'//weigh, error)
         do k = 0, m
            do lane = 1, nlane
               w(lane, k) = generic(k + 1, 20 + lane)
               v(lane, k) = generic(k + 1, 40 + lane)
            end do
         end do
         call probe_position(points, w, v, error)
         call probe_bandwidth(points, w, error)
         call model%force(nlane, n, m, t, w, points%q, points%p, f)
         call model%force(nlane, n, m, t, v, points%q, points%p, g)
         v = w + 2*v
         call model%force(nlane, n, m, t, v, points%q, points%p, is)
         g = f + 2*g
         call judge(points, is, g, f, 'is not linear in the weights'//weigh, error)
         q = spread(points%q(2, :), 1, nlane)
         p = spread(points%p(2, :), 1, nlane)
         v = spread(w(2, :), 1, nlane)
         call model%force(nlane, n, m, t, v, q, p, is)
         g = spread(f(2, :), 1, nlane)
         call judge(points, is, g, g, 'mixes lanes: compute each lane from its own w, q and p', error)
         if (.not. model%traits%forces%has_derivative .or. allocated(error)) return
         call force_difference(model%forces, nlane, n, m, t, w, points%q, points%p, points%vq, points%vp, g, code)
         call model%force_along(nlane, n, m, t, w, points%q, points%p, points%vq, points%vp, is)
         do lane = 1, nlane
            if (.not. max(maxval(abs(points%q(lane, :))), maxval(abs(points%p(lane, :)))) <= too_far) &
               g(lane, :) = is(lane, :)
         end do
         call judge(points, is, g, f, 'has derivatives that differences refute: correct them, or give none', error, &
                    matching)
      end associate
   end subroutine probe_forces

   !> If F, the f_k or both are declared to depend on q and t alone, they must be the same at other momenta.
   subroutine probe_position(points, w, v, error)
      type(probe_points), intent(in) :: points
      real(wp), intent(in) :: w(nlane, 0:points%nnoise), v(nlane, 0:points%nnoise)
      type(error_type), allocatable, intent(inout) :: error
      real(wp) :: only(nlane, 0:points%nnoise)

      associate (traits => points%model%traits%forces)
         if (traits%drift .and. traits%drift_in_position) then
            only = 0
            only(:, 0) = w(:, 0)
            call compare_momenta(points, only, 'F', error)
         end if
         if (traits%noise .and. traits%noise_in_position) then
            only = v
            only(:, 0) = 0
            call compare_momenta(points, only, 'f_k', error)
         end if
      end associate
   end subroutine probe_position

   !> A declared bandwidth must hold for the first component, the last and those between, in turn at the points.
   subroutine probe_bandwidth(points, w, error)
      type(probe_points), intent(in) :: points
      real(wp), intent(in) :: w(nlane, 0:points%nnoise)
      type(error_type), allocatable, intent(inout) :: error
      real(wp), allocatable, dimension(:, :) :: f, g, q, p
      integer :: i, near(2), turn

      associate (x => points, b => points%model%traits%forces%bandwidth)
         if (b < 0) return
         allocate (f, g, mold=x%q)
         call x%model%force(nlane, x%ndof, x%nnoise, x%t, w, x%q, x%p, f)
         do turn = 0, 4
            i = 1 + (turn*(x%ndof - 1))/4
            near = [max(1, i - b), min(x%ndof, i + b)]
            q = x%q + 0.5_wp*x%vq
            p = x%p + 0.5_wp*x%vp
            q(:, near(1):near(2)) = x%q(:, near(1):near(2))
            p(:, near(1):near(2)) = x%p(:, near(1):near(2))
            call x%model%force(nlane, x%ndof, x%nnoise, x%t, w, q, p, g)
            g(:, :i - 1) = f(:, :i - 1)
            g(:, i + 1:) = f(:, i + 1:)
            call judge(points, g, f, f, 'reaches beyond its bandwidth (force_bandwidth): give a larger one, or none', &
                       error)
         end do
      end associate
   end subroutine probe_bandwidth

   !> Compare a force at two momenta.
   subroutine compare_momenta(points, w, name, error)
      type(probe_points), intent(in) :: points
      real(wp), intent(in) :: w(nlane, 0:points%nnoise)
      character(*), intent(in) :: name
      type(error_type), allocatable, intent(inout) :: error
      real(wp), allocatable, dimension(:, :) :: f, g, p

      allocate (f, g, mold=points%q)
      p = points%p + 0.5_wp*points%vp
      associate (x => points)
         call x%model%force(nlane, x%ndof, x%nnoise, x%t, w, x%q, x%p, f)
         call x%model%force(nlane, x%ndof, x%nnoise, x%t, w, x%q, p, g)
      end associate
      call judge(points, g, f, f, 'declares that '//name//' depends on q and t alone, and it changes with p: say '// &
                 'that it does', error)
   end subroutine compare_momenta

   !> Refuse if a component differs from what it should be. The scale is the largest size at the points: at one of them
   !> a force and its derivatives may vanish, while differences leave a remainder.
   subroutine judge(points, is, should, beside, what, error, within)
      type(probe_points), intent(in) :: points
      real(wp), intent(in), dimension(nlane, points%ndof) :: is, should, beside
      character(*), intent(in) :: what
      type(error_type), allocatable, intent(inout) :: error
      real(wp), intent(in), optional :: within
      real(wp) :: relative, scale, size_of
      integer :: lane, i

      if (allocated(error)) return
      relative = vanishing
      if (present(within)) relative = within
      scale = -1
      do lane = 1, npoint
         size_of = maxval(abs(should(lane, :))) + maxval(abs(beside(lane, :))) + 0*sum(is(lane, :))
         if (size_of <= huge(size_of)) scale = max(scale, size_of)  ! skips NaN
      end do
      if (scale < 0) return  ! no point has a finite force
      do lane = 1, npoint
         do i = 1, points%ndof
            if (.not. abs(is(lane, i) - should(lane, i)) > relative*scale) cycle
            call raise(error, false_trait, 'probe_model', "the force on model '"//points%model%name//"' "//what// &
                       '; component '//to_text(i)//' is '//to_text(is(lane, i))//' and should be '// &
                       to_text(should(lane, i))//' at '//points%place(lane, i, i))
            return
         end do
      end do
   end subroutine judge

end module symsde_model_probe_forces
