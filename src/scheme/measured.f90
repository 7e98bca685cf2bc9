! SPDX-License-Identifier: BSD-3-Clause
!> Orders as they were measured, of the schemes of the catalogue. Written by docs/generate.py from docs/measured.json,
!> the work of docs/measure_orders.py; do not edit.
module symsde_scheme_measured
   use symsde_base_kinds, only: wp
   use symsde_base_text, only: name_length
   use symsde_scheme_orders, only: order_type, norder, additive_noise, commutative_noise, general_noise, &
                                   commuting_flows, weak_order
   implicit none
   private
   public :: add_measurements

   type :: measurement
      character(len=name_length) :: scheme
      integer :: class            !! of noise, or weak
      character(len=26) :: problem
      real(wp) :: order
      real(wp) :: half_width      !! of the 95 % interval; of weak orders what the last two slopes differ by
      real(wp) :: floor           !! error of the reference over the smallest error that counts
   end type measurement

   type(measurement), parameter :: additive(33) = [ &
                                   measurement('midpoint', additive_noise, 'fpu_chain', &
                                               1.001_wp, 0.011_wp, 0.0_wp), &
                                   measurement('symplectic_euler', additive_noise, 'fpu_chain', &
                                               1.002_wp, 0.008_wp, 0.0_wp), &
                                   measurement('symplectic_euler_adjoint', additive_noise, 'fpu_chain', &
                                               0.999_wp, 0.005_wp, 0.0_wp), &
                                   measurement('stormer_verlet', additive_noise, 'fpu_chain', &
                                               1.0_wp, 0.012_wp, 0.0_wp), &
                                   measurement('gauss2', additive_noise, 'fpu_chain', &
                                               0.995_wp, 0.012_wp, 0.0_wp), &
                                   measurement('gauss3', additive_noise, 'fpu_chain', &
                                               0.995_wp, 0.012_wp, 0.0_wp), &
                                   measurement('gauss4', additive_noise, 'fpu_chain', &
                                               0.995_wp, 0.012_wp, 0.0_wp), &
                                   measurement('lobatto2', additive_noise, 'fpu_chain', &
                                               1.0_wp, 0.012_wp, 0.0_wp), &
                                   measurement('lobatto2_swapped', additive_noise, 'fpu_chain', &
                                               1.002_wp, 0.012_wp, 0.0_wp), &
                                   measurement('lobatto3', additive_noise, 'fpu_chain', &
                                               0.995_wp, 0.012_wp, 0.0_wp), &
                                   measurement('lobatto3_swapped', additive_noise, 'fpu_chain', &
                                               0.995_wp, 0.012_wp, 0.0_wp), &
                                   measurement('lobatto4', additive_noise, 'fpu_chain', &
                                               0.995_wp, 0.012_wp, 0.0_wp), &
                                   measurement('lobatto4_swapped', additive_noise, 'fpu_chain', &
                                               0.995_wp, 0.012_wp, 0.0_wp), &
                                   measurement('P1N2Q2Lob', additive_noise, 'fpu_chain', &
                                               1.0_wp, 0.012_wp, 0.0_wp), &
                                   measurement('P1N2Q2Otr', additive_noise, 'fpu_chain', &
                                               1.0_wp, 0.011_wp, 0.0_wp), &
                                   measurement('P1N2Q4Gau', additive_noise, 'fpu_chain', &
                                               0.998_wp, 0.012_wp, 0.0_wp), &
                                   measurement('P1N3Q4Lob', additive_noise, 'fpu_chain', &
                                               0.998_wp, 0.012_wp, 0.0_wp), &
                                   measurement('P2N2Q2Lob', additive_noise, 'fpu_chain', &
                                               1.0_wp, 0.012_wp, 0.0_wp), &
                                   measurement('P2N2Q2Otr', additive_noise, 'fpu_chain', &
                                               1.033_wp, 0.012_wp, 0.0_wp), &
                                   measurement('P2N3Q4Lob', additive_noise, 'fpu_chain', &
                                               0.995_wp, 0.012_wp, 0.0_wp), &
                                   measurement('P2N3Q6Gau', additive_noise, 'fpu_chain', &
                                               0.995_wp, 0.012_wp, 0.0_wp), &
                                   measurement('P2N4Q6Lob', additive_noise, 'fpu_chain', &
                                               0.995_wp, 0.012_wp, 0.0_wp), &
                                   measurement('gauss2_strong32', additive_noise, 'fpu_chain', &
                                               2.003_wp, 0.01_wp, 0.0_wp), &
                                   measurement('gauss2_strong32_areas', additive_noise, 'fpu_chain', &
                                               2.003_wp, 0.01_wp, 0.0_wp), &
                                   measurement('midpoint_areas', additive_noise, 'fpu_chain', &
                                               1.001_wp, 0.011_wp, 0.0_wp), &
                                   measurement('verlet_dz', additive_noise, 'fpu_chain', &
                                               1.999_wp, 0.007_wp, 0.0_wp), &
                                   measurement('averaged_shift_midpoint', additive_noise, 'fpu_chain', &
                                               1.995_wp, 0.002_wp, 0.0_wp), &
                                   measurement('drift_preserving', additive_noise, 'fpu_chain', &
                                               0.993_wp, 0.009_wp, 0.0_wp), &
                                   measurement('exact_rotation', additive_noise, 'henon_heiles', &
                                               1.028_wp, 0.008_wp, 0.0_wp), &
                                   measurement('heun', additive_noise, 'fpu_chain', &
                                               1.018_wp, 0.012_wp, 0.0_wp), &
                                   measurement('euler_maruyama', additive_noise, 'fpu_chain', &
                                               1.034_wp, 0.003_wp, 0.0_wp), &
                                   measurement('dirk:0.25', additive_noise, 'fpu_chain', &
                                               0.997_wp, 0.012_wp, 0.0_wp), &
                                   measurement('lambda:0.3', additive_noise, 'fpu_chain', &
                                               0.986_wp, 0.013_wp, 0.0_wp)]
   type(measurement), parameter :: commutative(30) = [ &
                                   measurement('midpoint', commutative_noise, 'pendulum', &
                                               1.03_wp, 0.01_wp, 0.0_wp), &
                                   measurement('symplectic_euler', commutative_noise, 'pendulum', &
                                               0.993_wp, 0.003_wp, 0.0_wp), &
                                   measurement('symplectic_euler_adjoint', commutative_noise, 'pendulum', &
                                               1.001_wp, 0.003_wp, 0.0_wp), &
                                   measurement('stormer_verlet', commutative_noise, 'pendulum', &
                                               1.042_wp, 0.011_wp, 0.0_wp), &
                                   measurement('gauss2', commutative_noise, 'pendulum', &
                                               0.988_wp, 0.009_wp, 0.0_wp), &
                                   measurement('gauss3', commutative_noise, 'pendulum', &
                                               0.988_wp, 0.01_wp, 0.0_wp), &
                                   measurement('gauss4', commutative_noise, 'pendulum', &
                                               0.988_wp, 0.01_wp, 0.0_wp), &
                                   measurement('lobatto2', commutative_noise, 'pendulum', &
                                               1.042_wp, 0.011_wp, 0.0_wp), &
                                   measurement('lobatto2_swapped', commutative_noise, 'pendulum', &
                                               1.042_wp, 0.01_wp, 0.0_wp), &
                                   measurement('lobatto3', commutative_noise, 'pendulum', &
                                               0.988_wp, 0.01_wp, 0.0_wp), &
                                   measurement('lobatto3_swapped', commutative_noise, 'pendulum', &
                                               0.988_wp, 0.01_wp, 0.0_wp), &
                                   measurement('lobatto4', commutative_noise, 'pendulum', &
                                               0.988_wp, 0.01_wp, 0.0_wp), &
                                   measurement('lobatto4_swapped', commutative_noise, 'pendulum', &
                                               0.988_wp, 0.01_wp, 0.0_wp), &
                                   measurement('P1N2Q2Lob', commutative_noise, 'synchrotron', &
                                               0.993_wp, 0.017_wp, 0.0_wp), &
                                   measurement('P1N2Q2Otr', commutative_noise, 'synchrotron', &
                                               0.994_wp, 0.017_wp, 0.0_wp), &
                                   measurement('P1N2Q4Gau', commutative_noise, 'synchrotron', &
                                               0.993_wp, 0.017_wp, 0.0_wp), &
                                   measurement('P1N3Q4Lob', commutative_noise, 'synchrotron', &
                                               0.993_wp, 0.017_wp, 0.0_wp), &
                                   measurement('P2N2Q2Lob', commutative_noise, 'pendulum', &
                                               1.042_wp, 0.011_wp, 0.0_wp), &
                                   measurement('P2N2Q2Otr', commutative_noise, 'pendulum', &
                                               1.048_wp, 0.011_wp, 0.0_wp), &
                                   measurement('P2N3Q4Lob', commutative_noise, 'synchrotron', &
                                               0.991_wp, 0.018_wp, 0.0_wp), &
                                   measurement('P2N3Q6Gau', commutative_noise, 'synchrotron', &
                                               0.991_wp, 0.018_wp, 0.0_wp), &
                                   measurement('P2N4Q6Lob', commutative_noise, 'synchrotron', &
                                               0.991_wp, 0.018_wp, 0.0_wp), &
                                   measurement('gauss2_strong32', commutative_noise, 'pendulum', &
                                               1.494_wp, 0.01_wp, 0.0_wp), &
                                   measurement('gauss2_strong32_areas', commutative_noise, 'pendulum', &
                                               1.494_wp, 0.01_wp, 0.0_wp), &
                                   measurement('midpoint_areas', commutative_noise, 'pendulum', &
                                               1.03_wp, 0.01_wp, 0.0_wp), &
                                   measurement('exact_rotation', commutative_noise, 'synchrotron', &
                                               0.991_wp, 0.014_wp, 0.0_wp), &
                                   measurement('heun', commutative_noise, 'pendulum', &
                                               1.037_wp, 0.011_wp, 0.0_wp), &
                                   measurement('euler_maruyama', commutative_noise, 'pendulum', &
                                               0.61_wp, 0.014_wp, 0.0_wp), &
                                   measurement('dirk:0.25', commutative_noise, 'pendulum', &
                                               1.019_wp, 0.01_wp, 0.0_wp), &
                                   measurement('lambda:0.3', commutative_noise, 'pendulum', &
                                               0.993_wp, 0.003_wp, 0.0_wp)]
   type(measurement), parameter :: general(22) = [ &
                                   measurement('midpoint', general_noise, 'noncommutative_oscillator', &
                                               0.517_wp, 0.029_wp, 0.0_wp), &
                                   measurement('symplectic_euler', general_noise, 'noncommutative_oscillator', &
                                               0.576_wp, 0.033_wp, 0.0_wp), &
                                   measurement('symplectic_euler_adjoint', general_noise, 'noncommutative_oscillator', &
                                               0.587_wp, 0.034_wp, 0.0_wp), &
                                   measurement('stormer_verlet', general_noise, 'noncommutative_oscillator', &
                                               0.513_wp, 0.027_wp, 0.0_wp), &
                                   measurement('gauss2', general_noise, 'noncommutative_oscillator', &
                                               0.506_wp, 0.027_wp, 0.0_wp), &
                                   measurement('gauss3', general_noise, 'noncommutative_oscillator', &
                                               0.506_wp, 0.027_wp, 0.0_wp), &
                                   measurement('gauss4', general_noise, 'noncommutative_oscillator', &
                                               0.506_wp, 0.027_wp, 0.0_wp), &
                                   measurement('lobatto2', general_noise, 'noncommutative_oscillator', &
                                               0.513_wp, 0.027_wp, 0.0_wp), &
                                   measurement('lobatto2_swapped', general_noise, 'noncommutative_oscillator', &
                                               0.507_wp, 0.024_wp, 0.0_wp), &
                                   measurement('lobatto3', general_noise, 'noncommutative_oscillator', &
                                               0.506_wp, 0.027_wp, 0.0_wp), &
                                   measurement('lobatto3_swapped', general_noise, 'noncommutative_oscillator', &
                                               0.506_wp, 0.027_wp, 0.0_wp), &
                                   measurement('lobatto4', general_noise, 'noncommutative_oscillator', &
                                               0.506_wp, 0.027_wp, 0.0_wp), &
                                   measurement('lobatto4_swapped', general_noise, 'noncommutative_oscillator', &
                                               0.506_wp, 0.027_wp, 0.0_wp), &
                                   measurement('P2N2Q2Lob', general_noise, 'noncommutative_oscillator', &
                                               0.513_wp, 0.027_wp, 0.0_wp), &
                                   measurement('P2N2Q2Otr', general_noise, 'noncommutative_oscillator', &
                                               0.537_wp, 0.023_wp, 0.0_wp), &
                                   measurement('gauss2_strong32', general_noise, 'noncommutative_oscillator', &
                                               0.492_wp, 0.028_wp, 0.0_wp), &
                                   measurement('gauss2_strong32_areas', general_noise, 'noncommutative_oscillator', &
                                               1.044_wp, 0.038_wp, 0.0_wp), &
                                   measurement('midpoint_areas', general_noise, 'noncommutative_oscillator', &
                                               1.017_wp, 0.023_wp, 0.0_wp), &
                                   measurement('heun', general_noise, 'noncommutative_oscillator', &
                                               0.509_wp, 0.024_wp, 0.0_wp), &
                                   measurement('euler_maruyama', general_noise, 'noncommutative_oscillator', &
                                               0.539_wp, 0.025_wp, 0.0_wp), &
                                   measurement('dirk:0.25', general_noise, 'noncommutative_oscillator', &
                                               0.51_wp, 0.028_wp, 0.0_wp), &
                                   measurement('lambda:0.3', general_noise, 'noncommutative_oscillator', &
                                               0.519_wp, 0.031_wp, 0.0_wp)]
   type(measurement), parameter :: commuting(22) = [ &
                                   measurement('midpoint', commuting_flows, 'kubo', &
                                               1.034_wp, 0.01_wp, 0.0_wp), &
                                   measurement('symplectic_euler', commuting_flows, 'kubo', &
                                               0.996_wp, 0.004_wp, 0.0_wp), &
                                   measurement('symplectic_euler_adjoint', commuting_flows, 'kubo', &
                                               0.999_wp, 0.002_wp, 0.0_wp), &
                                   measurement('stormer_verlet', commuting_flows, 'kubo', &
                                               1.057_wp, 0.013_wp, 0.0_wp), &
                                   measurement('gauss2', commuting_flows, 'kubo', &
                                               2.073_wp, 0.024_wp, 0.0_wp), &
                                   measurement('gauss3', commuting_flows, 'kubo', &
                                               3.076_wp, 0.047_wp, 0.0_wp), &
                                   measurement('gauss4', commuting_flows, 'kubo', &
                                               4.114_wp, 0.209_wp, 0.0_wp), &
                                   measurement('lobatto2', commuting_flows, 'kubo', &
                                               1.057_wp, 0.013_wp, 0.0_wp), &
                                   measurement('lobatto2_swapped', commuting_flows, 'kubo', &
                                               1.043_wp, 0.011_wp, 0.0_wp), &
                                   measurement('lobatto3', commuting_flows, 'kubo', &
                                               2.072_wp, 0.023_wp, 0.0_wp), &
                                   measurement('lobatto3_swapped', commuting_flows, 'kubo', &
                                               2.089_wp, 0.029_wp, 0.0_wp), &
                                   measurement('lobatto4', commuting_flows, 'kubo', &
                                               3.08_wp, 0.053_wp, 0.0_wp), &
                                   measurement('lobatto4_swapped', commuting_flows, 'kubo', &
                                               3.068_wp, 0.045_wp, 0.0_wp), &
                                   measurement('P2N2Q2Lob', commuting_flows, 'kubo', &
                                               1.057_wp, 0.013_wp, 0.0_wp), &
                                   measurement('P2N2Q2Otr', commuting_flows, 'kubo', &
                                               1.048_wp, 0.011_wp, 0.0_wp), &
                                   measurement('gauss2_strong32', commuting_flows, 'kubo', &
                                               2.073_wp, 0.024_wp, 0.0_wp), &
                                   measurement('gauss2_strong32_areas', commuting_flows, 'kubo', &
                                               2.073_wp, 0.024_wp, 0.0_wp), &
                                   measurement('midpoint_areas', commuting_flows, 'kubo', &
                                               1.034_wp, 0.01_wp, 0.0_wp), &
                                   measurement('heun', commuting_flows, 'kubo', &
                                               1.038_wp, 0.01_wp, 0.0_wp), &
                                   measurement('euler_maruyama', commuting_flows, 'kubo', &
                                               0.61_wp, 0.018_wp, 0.0_wp), &
                                   measurement('dirk:0.25', commuting_flows, 'kubo', &
                                               1.037_wp, 0.01_wp, 0.0_wp), &
                                   measurement('lambda:0.3', commuting_flows, 'kubo', &
                                               0.993_wp, 0.002_wp, 0.0_wp)]
   type(measurement), parameter :: weak(35) = [ &
                                   measurement('midpoint', weak_order, 'linear_oscillator', &
                                               1.0_wp, 0.0_wp, 0.0_wp), &
                                   measurement('symplectic_euler', weak_order, 'linear_oscillator', &
                                               1.0_wp, 0.0_wp, 0.0_wp), &
                                   measurement('symplectic_euler_adjoint', weak_order, 'linear_oscillator', &
                                               1.0_wp, 0.0_wp, 0.0_wp), &
                                   measurement('stormer_verlet', weak_order, 'linear_oscillator', &
                                               1.0_wp, 0.0_wp, 0.0_wp), &
                                   measurement('gauss2', weak_order, 'linear_oscillator', &
                                               1.0_wp, 0.0_wp, 0.0_wp), &
                                   measurement('gauss3', weak_order, 'linear_oscillator', &
                                               1.0_wp, 0.0_wp, 0.0_wp), &
                                   measurement('gauss4', weak_order, 'linear_oscillator', &
                                               1.0_wp, 0.0_wp, 0.0_wp), &
                                   measurement('lobatto2', weak_order, 'linear_oscillator', &
                                               1.0_wp, 0.0_wp, 0.0_wp), &
                                   measurement('lobatto2_swapped', weak_order, 'linear_oscillator', &
                                               1.0_wp, 0.0_wp, 0.0_wp), &
                                   measurement('lobatto3', weak_order, 'linear_oscillator', &
                                               1.0_wp, 0.0_wp, 0.0_wp), &
                                   measurement('lobatto3_swapped', weak_order, 'linear_oscillator', &
                                               1.0_wp, 0.0_wp, 0.0_wp), &
                                   measurement('lobatto4', weak_order, 'linear_oscillator', &
                                               1.0_wp, 0.0_wp, 0.0_wp), &
                                   measurement('lobatto4_swapped', weak_order, 'linear_oscillator', &
                                               1.0_wp, 0.0_wp, 0.0_wp), &
                                   measurement('P1N2Q2Lob', weak_order, 'linear_oscillator', &
                                               1.0_wp, 0.0_wp, 0.0_wp), &
                                   measurement('P1N2Q2Otr', weak_order, 'linear_oscillator', &
                                               1.0_wp, 0.0_wp, 0.0_wp), &
                                   measurement('P1N2Q4Gau', weak_order, 'linear_oscillator', &
                                               1.0_wp, 0.0_wp, 0.0_wp), &
                                   measurement('P1N3Q4Lob', weak_order, 'linear_oscillator', &
                                               1.0_wp, 0.0_wp, 0.0_wp), &
                                   measurement('P2N2Q2Lob', weak_order, 'linear_oscillator', &
                                               1.0_wp, 0.0_wp, 0.0_wp), &
                                   measurement('P2N2Q2Otr', weak_order, 'linear_oscillator', &
                                               1.0_wp, 0.0_wp, 0.0_wp), &
                                   measurement('P2N3Q4Lob', weak_order, 'linear_oscillator', &
                                               1.0_wp, 0.0_wp, 0.0_wp), &
                                   measurement('P2N3Q6Gau', weak_order, 'linear_oscillator', &
                                               1.0_wp, 0.0_wp, 0.0_wp), &
                                   measurement('P2N4Q6Lob', weak_order, 'linear_oscillator', &
                                               1.0_wp, 0.0_wp, 0.0_wp), &
                                   measurement('gauss2_strong32', weak_order, 'linear_oscillator', &
                                               1.0_wp, 0.0_wp, 0.0_wp), &
                                   measurement('gauss2_strong32_areas', weak_order, 'linear_oscillator', &
                                               1.0_wp, 0.0_wp, 0.0_wp), &
                                   measurement('gauss2_weak2', weak_order, 'linear_oscillator', &
                                               1.0_wp, 0.0_wp, 0.0_wp), &
                                   measurement('midpoint_areas', weak_order, 'linear_oscillator', &
                                               1.0_wp, 0.0_wp, 0.0_wp), &
                                   measurement('midpoint_weak1', weak_order, 'linear_oscillator', &
                                               1.0_wp, 0.0_wp, 0.0_wp), &
                                   measurement('verlet_dz', weak_order, 'linear_oscillator', &
                                               1.0_wp, 0.0_wp, 0.0_wp), &
                                   measurement('averaged_shift_midpoint', weak_order, 'linear_oscillator', &
                                               1.0_wp, 0.0_wp, 0.0_wp), &
                                   measurement('drift_preserving', weak_order, 'linear_oscillator', &
                                               1.0_wp, 0.0_wp, 0.0_wp), &
                                   measurement('exact_rotation', weak_order, 'linear_oscillator', &
                                               1.0_wp, 0.0_wp, 0.0_wp), &
                                   measurement('heun', weak_order, 'linear_oscillator', &
                                               1.0_wp, 0.0_wp, 0.0_wp), &
                                   measurement('euler_maruyama', weak_order, 'linear_oscillator', &
                                               1.0_wp, 0.0_wp, 0.0_wp), &
                                   measurement('dirk:0.25', weak_order, 'linear_oscillator', &
                                               1.0_wp, 0.0_wp, 0.0_wp), &
                                   measurement('lambda:0.3', weak_order, 'linear_oscillator', &
                                               1.0_wp, 0.0_wp, 0.0_wp)]
   type(measurement), parameter :: found(*) = [additive, commutative, general, commuting, weak]

contains

   !> Put what was measured of a scheme of the catalogue beside its orders.
   pure subroutine add_measurements(order, name)
      type(order_type), intent(inout) :: order(norder)
      character(*), intent(in) :: name
      integer :: i

      do i = 1, size(found)
         if (found(i)%scheme /= name) cycle
         associate (o => order(found(i)%class))
            o%problem = found(i)%problem
            o%measured = found(i)%order
            o%half_width = found(i)%half_width
            o%floor = found(i)%floor
         end associate
      end do
   end subroutine add_measurements

end module symsde_scheme_measured
