! SPDX-License-Identifier: BSD-3-Clause
!> Warnings before a run begins: sentences with numbers about steps and noises that are probably too large.
!>
!> Bounds that the model declares (max_frequency, noise_lipschitz) are used as declared; otherwise bounds are estimated
!> from Hessians at the initial state of the first path, and the sentences call them estimates. Where parameters go by
!> path, the path with the largest estimate counts.
!>
!> Private to its family.
module symsde_ensemble_run_warnings
   use symsde_base_damping, only: damping_type
   use symsde_base_kinds, only: wp, i8
   use symsde_base_text, only: add => append_line, to_text
   use symsde_base_traits, only: model_traits, dense
   use symsde_ensemble_options, only: run_options, time_rounding, latest_time
   use symsde_model_abstract, only: model_type
   use symsde_model_kernels, only: kernel_offers, offers_of
   use symsde_model_probe_one_path, only: one_path
   use symsde_scheme_damped, only: temperature_of_weights
   use symsde_scheme_scheme, only: scheme_type, frame_rotation, splitting_form
   use symsde_step_open_kick_law, only: has_law
   use symsde_step_open_linear_noise, only: gives_linear_law
   implicit none
   private
   public :: set_up_warnings

   integer, parameter :: largest_dense = 64  !! degrees of freedom up to which a dense Hessian is read
   integer, parameter :: most_noises = 1024  !! noises up to which each Hessian is read, with weights for all noises

   integer(i8), parameter :: most_looked_at = 4096  !! paths with parameters of their own that are looked at

   !> Bounds that the warnings use, and their origin.
   type :: bounds_type
      real(wp) :: frequency = 0   !! largest frequency of H [1/time]
      real(wp) :: lipschitz = 0   !! Lipschitz constant of the noise [1/sqrt(time)]
      integer :: nnoise = 0       !! number of noises whose Hessians do not vanish
      logical :: on_some_paths = .false. !! whether this constant is that of some paths
      logical :: turns = .false.         !! whether steps turn planes: the frequency is that of the slower part of H
      character(:), allocatable :: frequency_source, lipschitz_source
   end type bounds_type

contains

   !> Collect the warnings, one per line; the text is empty without warnings.
   subroutine set_up_warnings(model, nlane, scheme, options, explicit, q0, p0, lost_variance, text)
      class(model_type), intent(in), target :: model
      integer, intent(in) :: nlane               !! lanes of a call of the model: 1 if the model takes any number
      type(scheme_type), intent(in) :: scheme
      type(run_options), intent(in) :: options
      logical, intent(in) :: explicit            !! whether the step calls no solver
      real(wp), intent(in) :: q0(:), p0(:)       !! initial state of the first path (ndof)
      real(wp), intent(in) :: lost_variance      !! variance that a normal loses by truncation
      character(:), allocatable, intent(out) :: text
      real(wp), dimension(nlane, size(q0)) :: q, p
      type(bounds_type) :: bounds

      text = ''
      call spread_state(nlane, size(q0), q0, p0, q, p)
      call find_largest_bounds(model, scheme, nlane, options%t0, q, p, .not. explicit, bounds)
      call warn_of_frequency(text, scheme, model%traits%quadratic, abs(options%step), explicit, bounds)
      if (.not. explicit) call warn_of_noise(text, options, bounds)
      call warn_of_damping(text, scheme, model, model%traits, model%damping, options, nlane, q)
      if (lost_variance > 1e-3_wp) call add(text, 'truncation loses '//to_text(100*lost_variance)// &
                                            ' % of the variance of every increment')
      if (time_rounding(options) > 0.01_wp) &
         call add(text, 'times near '//to_text(latest_time(options))//' are off by up to '// &
                  to_text(100*time_rounding(options))//' % of a step by rounding: take a longer step, or a t0 near 0')
      if (.not. options%compensated) call warn_of_rounding(text, model, nlane, options, q, p)
   end subroutine set_up_warnings

   !> Warn of a step too long for the fastest oscillation: compare h omega with the stability limit of explicit steps,
   !> with the value that resolves an oscillation, and with the value above which implicit equations may have more than
   !> one solution.
   subroutine warn_of_frequency(text, scheme, quadratic, h, explicit, bounds)
      character(:), allocatable, intent(inout) :: text
      type(scheme_type), intent(in) :: scheme
      logical, intent(in) :: quadratic, explicit
      real(wp), intent(in) :: h
      type(bounds_type), intent(in) :: bounds
      real(wp) :: x
      character(:), allocatable :: value, factor

      if (scheme%frame == frame_rotation) return  ! the scheme integrates the declared frequencies exactly
      x = h*bounds%frequency
      if (.not. x > 1) return  ! making texts takes longer than a short run
      value = 'h*omega = '//to_text(x)//' (omega '//bounds%frequency_source//')'
      if (bounds%turns) then
         call add(text, value//' exceeds 1: steps alternate between a coupling of planes (q, p) and turns of '// &
                  'them, and even the slower of the two goes through an angle above one in each, so that phases '// &
                  'are wrong: take a smaller step')
         return
      end if
      if (explicit .and. x >= 1.8_wp) call add(text, value//' is near or above 2, the stability limit of '// &
                                               'explicit symplectic steps: take a smaller step or midpoint')
      factor = ''  ! factor of the midpoint's energy input, exact for linear oscillators with additive noise
      if (scheme%is_midpoint()) &
         factor = ' (by the factor 1/(1+(h*omega)^2/4) = '//to_text(1/(1 + 0.25_wp*x**2))//')'
      call add(text, value//' exceeds 1: the fastest oscillations are under-resolved, their phases '// &
               'and the energy that noise puts into them are wrong'//factor)
      if (.not. explicit .and. .not. quadratic .and. 0.25_wp*x**2 >= 1) &
         call add(text, '(h*omega)^2/4 = '//to_text(0.25_wp*x**2)//' is at least 1: the implicit equations '// &
                  'may have several solutions, and Newton finds one of them')
   end subroutine warn_of_frequency

   !> Warn of noise so strong that implicit equations may be unsolvable. With the Lipschitz constant L of the noise they
   !> are solvable while L |dW|/2 < 1; the warning gives the expected number of larger increments in the run.
   subroutine warn_of_noise(text, options, bounds)
      character(:), allocatable, intent(inout) :: text
      type(run_options), intent(in) :: options
      type(bounds_type), intent(in) :: bounds
      real(wp) :: cut, probability, expected

      if (.not. bounds%lipschitz > 0) return
      cut = 2/(bounds%lipschitz*sqrt(abs(options%step)))  ! bound of increments, in standard deviations
      probability = erfc(cut/sqrt(2.0_wp))
      expected = probability*real(bounds%nnoise, wp)*real(options%npath, wp)*real(options%nstep, wp)
      if (options%truncation > 0) then
         if (sqrt(2*options%truncation*abs(log(abs(options%step)/options%truncation_time))) < cut) return
      end if
      if (expected > 1e-3_wp) call add(text, 'noise of Lipschitz constant '//to_text(bounds%lipschitz)//' ('// &
                                       bounds%lipschitz_source//') is so strong that some implicit steps '// &
                                       'may have no solution, or the wrong one: those with normals above '// &
                                       to_text(cut)//', '//merge('up to', 'about', bounds%on_some_paths)//' '// &
                                       to_text(expected)//' of them in this run; take a '// &
                                       'smaller step or truncate')
   end subroutine warn_of_noise

   !> Warn if noise in position does not give damped momenta the right temperature. Most schemes are judged by the
   !> temperature of a free particle. Kicks with dZ and one rate of damping have the exact law and are judged by their
   !> size: if momenta decay for many decay times after the last kick, they keep only noise of that time, and only large
   !> and opposite kicks reproduce its law.
   subroutine warn_of_damping(text, scheme, model, traits, damping, options, nlane, q)
      character(:), allocatable, intent(inout) :: text
      type(scheme_type), intent(in) :: scheme
      class(model_type), intent(in) :: model
      type(model_traits), intent(in) :: traits
      type(damping_type), intent(in) :: damping
      type(run_options), intent(in) :: options
      integer, intent(in) :: nlane
      real(wp), intent(in) :: q(nlane, traits%ndof)   !! the first position, in all lanes
      real(wp), parameter :: short = 0.25_wp      ! gamma h up to which the order of the scheme describes its errors
      real(wp), parameter :: most = 0.01_wp       ! largest relative error of the mean of p^2
      real(wp), parameter :: longest = 4          ! largest number of decay times after the last kick
      real(wp) :: z, ratio, last
      integer :: i

      ! Noise and decay of a word, and of gjf, have the law of the bath for every gamma h.
      if (.not. (damping%acts() .and. traits%position_noise .and. traits%nnoise > 0)) return
      if (scheme%kicks%is_word() .or. scheme%kicks%rational) return
      if (.not. damping%is_constant()) return  ! the temperature is unknown
      if (allocated(traits%silent)) then
         if (all(traits%silent)) return
      end if
      if (allocated(damping%rate)) then
         z = maxval(damping%rate)*options%step
      else if (traits%identity_mass) then
         ! No eigenvalue of a matrix that is larger is known without work, nor the mass of the model.
         z = 0
         do i = 1, traits%ndof
            z = max(z, damping%friction(i, i)*options%step)
         end do
      else
         return
      end if
      if (.not. z > short) return
      if (has_law(scheme, damping, options%damping_noise)) then
         last = 1
         if (scheme%form == splitting_form) last = scheme%kicks%c(size(scheme%kicks%c))
         if ((1 - last)*z > longest) &
            call add(text, 'gamma*h = '//to_text(z)//' of the damping is too large for '//scheme%name// &
                     ', whose last kick comes '//to_text(1 - last)//' h before the end of the step: kicks by '// &
                     'noise become large and opposite; take verlet_kdk or chin4a, or a smaller step')
         return
      end if
      if (gives_linear_law(model, scheme, options%damping_noise, options%t0, options%step, nlane, q)) return
      ratio = temperature_of_weights(scheme, z)
      if (abs(ratio - 1) > most) &
         call add(text, 'gamma*h = '//to_text(z)//' of the damping is large for '//scheme%name// &
                  ': the noise gives a free particle at rest '//to_text(ratio)//' times the right mean of p^2; '// &
                  'take a smaller step, or kicks with one rate (gauss_dkdkd), whose noise has the exact law')
   end subroutine warn_of_damping

   !> Warn if the increments of the drift are below the rounding error of the state, so that sums lose them.
   subroutine warn_of_rounding(text, model, nlane, options, q, p)
      character(:), allocatable, intent(inout) :: text
      class(model_type), intent(in) :: model
      integer, intent(in) :: nlane
      type(run_options), intent(in) :: options
      real(wp), intent(in), dimension(nlane, model%traits%ndof) :: q, p  !! the first state, in all lanes
      real(wp) :: w(nlane, 0:model%traits%nnoise)
      real(wp), dimension(nlane, model%traits%ndof) :: hq, hp
      real(wp) :: largest, state

      if (.not. model%traits%has_gradient) return
      call look_at(0, w)
      call model%gradient(nlane, model%traits%ndof, model%traits%nnoise, options%t0, w, q, p, hq, hp)
      largest = abs(options%step)*max(maxval(abs(hq(1, :))), maxval(abs(hp(1, :))))
      state = max(maxval(abs(q(1, :))), maxval(abs(p(1, :))))
      if (largest > 0 .and. largest < epsilon(1.0_wp)*state) &
         call add(text, 'increments of the drift, '//to_text(largest)//', are below the rounding of the state, '// &
                  to_text(epsilon(1.0_wp)*state)//': ask for compensated summation')
   end subroutine warn_of_rounding

   !> Find the largest bounds of all paths, or of as many as are looked at, at equal distances: those of the path with
   !> the highest frequency, and of the one with the strongest noise.
   subroutine find_largest_bounds(model, scheme, nlane, t, q, p, implicit, bounds)
      class(model_type), intent(in), target :: model
      type(scheme_type), intent(in) :: scheme
      integer, intent(in) :: nlane
      real(wp), intent(in) :: t
      real(wp), intent(in), dimension(nlane, model%traits%ndof) :: q, p  !! the first state, in all lanes
      logical, intent(in) :: implicit   !! whether steps solve equations: else noise needs no bound
      type(bounds_type), intent(out) :: bounds
      type(one_path) :: path
      type(bounds_type) :: here
      integer(i8) :: i, n, place

      call path%begin(model)
      call find_bounds(path%model, scheme, nlane, t, q, p, implicit, bounds)
      n = min(path%count, most_looked_at)
      do i = 1, n - 1
         place = i*(path%count - 1)/(n - 1)
         call path%look_at(place, 1)
         call find_bounds(path%model, scheme, nlane, t, q, p, implicit, here)
         if (here%frequency > bounds%frequency) then
            bounds%frequency = here%frequency
            bounds%frequency_source = here%frequency_source//' with the parameters of value '//to_text(place + 1)
         end if
         if (abs(here%lipschitz - bounds%lipschitz) > 0) bounds%on_some_paths = .true.
         if (here%lipschitz > bounds%lipschitz) then
            bounds%lipschitz = here%lipschitz
            bounds%nnoise = here%nnoise
            bounds%lipschitz_source = here%lipschitz_source//' with the parameters of value '//to_text(place + 1)
         end if
      end do
      call path%finish()
   end subroutine find_largest_bounds

   !> Find the bounds: declared bounds, else row sums of Hessians at the initial state. Row sums of all noises are added
   !> for each row, and the largest row counts: noises on different sites of a lattice do not add up. Rows of forces and
   !> of velocities are measured in the unit of p/q in which those of H are equal. With more than
   !> most_noises noises there is no estimate. Where the scheme takes a quadratic part of H exactly, the frequency is
   !> that of the rest; where it turns planes between, that of the slower of the two.
   subroutine find_bounds(model, scheme, nlane, t, q, p, implicit, bounds)
      class(model_type), intent(in) :: model
      type(scheme_type), intent(in) :: scheme
      integer, intent(in) :: nlane
      real(wp), intent(in) :: t
      real(wp), intent(in), dimension(nlane, model%traits%ndof) :: q, p  !! the first state, in all lanes
      logical, intent(in) :: implicit   !! whether steps solve equations: else noise needs no bound
      type(bounds_type), intent(out) :: bounds
      real(wp) :: sums(model%traits%ndof, 3), rows(model%traits%ndof, 2)  ! sums of hqq, hqp, hpp; rows of q, p
      real(wp) :: unit, force, velocity   ! of p/q; largest row sums of H
      integer :: k
      logical :: looked, by_part, known

      by_part = scheme%needs%quadratic_will_do .and. allocated(model%traits%quadratic_part)
      bounds%frequency = model%traits%max_frequency
      if (by_part) bounds%frequency = 0
      bounds%lipschitz = model%traits%noise_lipschitz
      bounds%frequency_source = 'declared'
      bounds%lipschitz_source = 'declared'
      bounds%nnoise = model%traits%nnoise
      if (.not. model%traits%has_gradient) return
      bounds%turns = by_part .and. model%traits%kicks_of_actions
      known = bounds%frequency > 0 .or. bounds%turns
      if (bounds%turns) then
         bounds%frequency_source = 'of the slower part of H, estimated at the initial state'
         bounds%frequency = slower_turn(model, nlane, size(sums, 1), t, q, p)
      end if
      if (.not. known) then
         bounds%frequency_source = 'estimated at the initial state'
         call row_sums(model, nlane, size(sums, 1), t, 0, q, p, sums, looked, by_part)
         if (looked) bounds%frequency = maxval(sums(:, 2)) + sqrt(maxval(sums(:, 1)))*sqrt(maxval(sums(:, 3)))
      end if
      if (.not. implicit .or. bounds%lipschitz > 0 .or. model%traits%additive .or. model%traits%nnoise == 0 .or. &
          model%traits%nnoise > most_noises) return
      bounds%lipschitz_source = 'estimated at the initial state'
      bounds%nnoise = 0
      unit = 1
      if (known .or. by_part) call row_sums(model, nlane, size(sums, 1), t, 0, q, p, sums, looked)
      if (looked) then
         force = maxval(sums(:, 1))
         velocity = maxval(sums(:, 3))
         if (min(force, velocity) > 0) unit = sqrt(force)/sqrt(velocity)
      end if
      rows = 0
      do k = 1, model%traits%nnoise
         call row_sums(model, nlane, size(sums, 1), t, k, q, p, sums, looked)
         if (.not. looked) return
         if (maxval(sums) > 0) bounds%nnoise = bounds%nnoise + 1
         rows(:, 1) = rows(:, 1) + sums(:, 1)/unit + sums(:, 2)
         rows(:, 2) = rows(:, 2) + sums(:, 3)*unit + sums(:, 2)
      end do
      bounds%lipschitz = maxval(rows)
   end subroutine find_bounds

   !> The lower of two rates in H = D + K, K a function of the actions I_k: the largest row sum of D without what
   !> commutes with actions, e_k I_k, and the largest angular velocity K_,k = (q_k K_q_k + p_k K_p_k)/(2 I_k). Where
   !> either is 0, steps are exact.
   real(wp) function slower_turn(model, nlane, n, t, q, p)
      class(model_type), intent(in) :: model
      integer, intent(in) :: nlane, n
      real(wp), intent(in) :: t, q(nlane, n), p(nlane, n)
      real(wp) :: w(nlane, 0:model%traits%nnoise), hq(nlane, n), hp(nlane, n), action, coupling, turn
      integer :: i

      call look_at(0, w)
      call model%gradient(nlane, n, model%traits%nnoise, t, w, q, p, hq, hp)
      coupling = 0
      turn = 0
      associate (S => model%traits%quadratic_part)
         do i = 1, n
            coupling = max(coupling, sum(abs(S(:, i))) - abs(S(i, i)) + abs(S(i, i) - S(i + n, i + n))/2, &
                           sum(abs(S(:, i + n))) - abs(S(i + n, i + n)) + abs(S(i, i) - S(i + n, i + n))/2)
            action = (q(1, i)**2 + p(1, i)**2)/2
            if (action > 0) turn = max(turn, abs(q(1, i)*(hq(1, i) - along(S(:, i))) + &
                                                 p(1, i)*(hp(1, i) - along(S(:, i + n))))/(2*action))
         end do
      end associate
      slower_turn = min(coupling, turn)

   contains

      !> The derivative of D along a column of S.
      pure real(wp) function along(column)
         real(wp), intent(in) :: column(:)

         along = dot_product(column(:n), q(1, :)) + dot_product(column(n + 1:), p(1, :))
      end function along

   end function slower_turn

   !> Sums of absolute values along the rows of the Hessian blocks of H_k: in q, mixed, and in p. For the mixed block,
   !> which separable models do not have, take the larger of row sum and column sum. by_part: without D_qq and D_qp of
   !> the model's quadratic part.
   subroutine row_sums(model, nlane, n, t, k, q, p, sums, looked, by_part)
      class(model_type), intent(in) :: model
      integer, intent(in) :: nlane, n, k
      real(wp), intent(in) :: t, q(nlane, n), p(nlane, n)
      real(wp), intent(out) :: sums(n, 3)
      logical, intent(out) :: looked   !! false if the Hessian is too large to read
      logical, intent(in), optional :: by_part
      real(wp) :: w(nlane, 0:model%traits%nnoise)
      real(wp), allocatable :: aqq(:, :, :), aqp(:, :, :), app(:, :, :), column(:)
      type(kernel_offers) :: offers
      integer :: m, b, i, d
      logical :: parted

      parted = .false.
      if (present(by_part)) parted = by_part
      offers = offers_of(model)
      sums = 0
      m = model%traits%nnoise
      b = model%traits%bandwidth
      looked = b /= dense .or. n <= largest_dense
      if (.not. looked) return
      call look_at(k, w)
      if (offers%rows_of_one .and. .not. parted) then  ! H = p.p/2 + U(q)
         call sum_rows(model, nlane, n, m, t, w, q, p, sums(:, 1))
         if (k == 0) sums(:, 3) = 1
         return
      end if
      if (b == dense) then
         allocate (aqq(nlane, n, n), app(nlane, n, n))
         if (.not. model%traits%separable) allocate (aqp(nlane, n, n))
         call model%hessian(nlane, n, m, t, w, q, p, aqq, aqp, app)
         if (parted) then
            aqq(1, :, :) = aqq(1, :, :) - model%traits%quadratic_part(:n, :n)
            if (allocated(aqp)) aqp = 0
         end if
         sums(:, 1) = sum(abs(aqq(1, :, :)), dim=2)
         sums(:, 3) = sum(abs(app(1, :, :)), dim=2)
         if (allocated(aqp)) sums(:, 2) = max(sum(abs(aqp(1, :, :)), dim=1), sum(abs(aqp(1, :, :)), dim=2))
      else
         allocate (aqq(nlane, -b:b, n), app(nlane, -b:b, n))
         if (.not. model%traits%separable) allocate (aqp(nlane, -b:b, n))
         call model%hessian_banded(nlane, n, m, b, t, w, q, p, aqq, aqp, app)
         if (parted) then
            do i = 1, n
               do d = max(1 - i, -b), min(n - i, b)
                  aqq(1, d, i) = aqq(1, d, i) - model%traits%quadratic_part(i, i + d)
               end do
            end do
            if (allocated(aqp)) aqp = 0
         end if
         call sum_bands(nlane, 2*b + 1, n, aqq, sums(:, 1))
         call sum_bands(nlane, 2*b + 1, n, app, sums(:, 3))
         if (.not. allocated(aqp)) return
         sums(:, 2) = sum(abs(aqp(1, :, :)), dim=1)
         allocate (column(1 - b:n + b), source=0.0_wp)
         do i = 1, n
            column(i - b:i + b) = column(i - b:i + b) + abs(aqp(1, :, i))
         end do
         sums(:, 2) = max(sums(:, 2), column(1:n))
      end if
   end subroutine row_sums

   !> Row sums of the block in q for a chain that gives its rows in one pass: reading all bands would take longer than
   !> steps.
   subroutine sum_rows(model, nlane, n, m, t, w, q, p, sums)
      class(model_type), intent(in) :: model
      integer, intent(in) :: nlane, n, m
      real(wp), intent(in) :: t, w(nlane, 0:m), q(nlane, n), p(nlane, n)
      real(wp), intent(out) :: sums(n)
      real(wp) :: bands(nlane, 0:1, n), hq(nlane, n)
      integer :: i

      call model%force_stiffness(nlane, n, m, 1, t, w, q, p, hq, bands)
      do i = 1, n
         sums(i) = abs(bands(1, 0, i))
      end do
      do i = 1, n - 1
         sums(i) = sums(i) + abs(bands(1, 1, i))
         sums(i + 1) = sums(i + 1) + abs(bands(1, 1, i))
      end do
   end subroutine sum_rows

   !> Weights that select H_k alone.
   pure subroutine look_at(k, w)
      integer, intent(in) :: k
      real(wp), intent(out), contiguous :: w(:, 0:)

      w = 0
      w(:, k) = 1
   end subroutine look_at

   !> Copy a state to all lanes. The dummy arrays have explicit bounds, as in sum_bands.
   pure subroutine spread_state(nlane, n, q0, p0, q, p)
      integer, intent(in) :: nlane, n
      real(wp), intent(in) :: q0(:), p0(:)     !! (n)
      real(wp), intent(out) :: q(nlane, n), p(nlane, n)
      integer :: i, lane

      do i = 1, n
         !GCC$ novector  ! most have one lane
         do lane = 1, nlane
            q(lane, i) = q0(i)
            p(lane, i) = p0(i)
         end do
      end do
   end subroutine spread_state

   !> Row sums over the bands of the first lane. The dummy arrays have explicit bounds: for a small chain, array
   !> sections take as long as its steps.
   pure subroutine sum_bands(nlane, nband, n, a, sums)
      integer, intent(in) :: nlane, nband, n
      real(wp), intent(in) :: a(nlane, nband, n)
      real(wp), intent(out) :: sums(:)   !! (n)
      integer :: i, d

      do i = 1, n
         sums(i) = 0
         do d = 1, nband
            sums(i) = sums(i) + abs(a(1, d, i))
         end do
      end do
   end subroutine sum_bands

end module symsde_ensemble_run_warnings
