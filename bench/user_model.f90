! SPDX-License-Identifier: BSD-3-Clause
!> The synchrotron as a user writes it in Fortran, with the public module alone.
!>
!>    H = p^2/2 - omega^2 cos q,   H_1 = sigma1 sin q,   H_2 = -sigma2 cos q
module bench_user_model
   use, intrinsic :: iso_c_binding, only: c_char, c_int, c_int64_t
   use symsde, only: wp, model_type, model_traits, sincos_lanes, scheme_type, get_scheme, run_options, paths_type, &
                     simulate, error_type
   implicit none
   private
   public :: user_synchrotron, run_user_model

   type, extends(model_type) :: user_synchrotron
      real(wp) :: omega = 2, sigma1 = 0.2_wp, sigma2 = 0.1_wp
   contains
      procedure :: gradient
      procedure :: hessian
      procedure :: gradient_hessian
   end type user_synchrotron

contains

   subroutine gradient(self, nlane, ndof, nnoise, t, w, q, p, hq, hp)
      class(user_synchrotron), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional :: hq(nlane, ndof), hp(nlane, ndof)

      call self%gradient_hessian(nlane, ndof, nnoise, t, w, q, p, hq=hq, hp=hp)
   end subroutine gradient

   subroutine hessian(self, nlane, ndof, nnoise, t, w, q, p, hqq, hqp, hpp)
      class(user_synchrotron), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional :: hqq(nlane, ndof, ndof), hqp(nlane, ndof, ndof), hpp(nlane, ndof, ndof)

      call self%gradient_hessian(nlane, ndof, nnoise, t, w, q, p, hqq=hqq, hqp=hqp, hpp=hpp)
   end subroutine hessian

   !> Gradient and Hessian with one call of sine and cosine; an implicit scheme calls this in every iteration.
   subroutine gradient_hessian(self, nlane, ndof, nnoise, t, w, q, p, hq, hp, hqq, hqp, hpp)
      class(user_synchrotron), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional :: hq(nlane, ndof), hp(nlane, ndof)
      real(wp), intent(out), optional :: hqq(nlane, ndof, ndof), hqp(nlane, ndof, ndof), hpp(nlane, ndof, ndof)
      real(wp) :: sine(nlane), cosine(nlane)

      if (present(hq) .or. present(hqq)) call sincos_lanes(nlane, q(:, 1), sine, cosine)
      if (present(hq)) &
         hq(:, 1) = (self%omega**2*w(:, 0) + self%sigma2*w(:, 2))*sine + self%sigma1*w(:, 1)*cosine
      if (present(hqq)) &
         hqq(:, 1, 1) = (self%omega**2*w(:, 0) + self%sigma2*w(:, 2))*cosine - self%sigma1*w(:, 1)*sine
      if (present(hp)) hp(:, 1) = w(:, 0)*p(:, 1)
      if (present(hqp)) hqp = 0
      if (present(hpp)) hpp(:, 1, 1) = w(:, 0)
   end subroutine gradient_hessian

   !> nstep steps of npath paths from (1, 0) on one thread; returns final positions, and 0 if the run succeeded.
   integer(c_int) function run_user_model(nname, name, step, npath, nstep, q) bind(c)
      integer(c_int), intent(in), value :: nname
      character(kind=c_char), intent(in) :: name(nname)  !! name of the scheme
      real(wp), intent(in), value :: step
      integer(c_int64_t), intent(in), value :: npath, nstep
      real(wp), intent(out) :: q(npath)
      type(user_synchrotron) :: model
      type(scheme_type) :: scheme
      type(run_options) :: options
      type(paths_type) :: run
      type(error_type), allocatable :: error
      character(len=nname) :: text

      run_user_model = 1
      model%name = 'own synchrotron'
      model%traits = model_traits(ndof=1, nnoise=2, separable=.true., position_noise=.true., identity_mass=.true., &
                                  has_hessian=.true.)
      text = transfer(name, text)
      call get_scheme(scheme, text, error)
      if (allocated(error)) return
      options%step = step
      options%npath = npath
      options%nstep = nstep
      options%save_every = nstep
      options%seed = 1
      options%nthread = 1
      call simulate(model, scheme, options, [1.0_wp], [0.0_wp], run, error)
      if (allocated(error)) return
      q = run%last_q(:, 1)
      run_user_model = 0
   end function run_user_model

end module bench_user_model
