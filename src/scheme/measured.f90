! SPDX-License-Identifier: BSD-3-Clause
!> Orders as they were measured, of the schemes of the catalogue. Written by docs/generate.py from docs/measured.json,
!> the work of docs/measure_orders.py, and docs/damping_orders.json, that of docs/damping_orders.py; do not edit.
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
      integer :: class            !! class of the noise, or weak
      character(len=26) :: problem
      real(wp) :: order
      real(wp) :: half_width      !! half of the 95 % interval; for weak orders, difference of the last two slopes
      real(wp) :: floor           !! error of the reference over the smallest error that counts
   end type measurement

   !> Strong orders with one rate of damping, with additive noise and with noise in position; 0: refused.
   type :: damped_measurement
      character(len=name_length) :: scheme
      real(wp) :: order(2)
   end type damped_measurement

   type(measurement), parameter :: additive(42) = [ &
                                   measurement('midpoint', additive_noise, 'tilted_pendulum', &
                                               1.012_wp, 0.012_wp, 0.001_wp), &
                                   measurement('symplectic_euler', additive_noise, 'tilted_pendulum', &
                                               1.002_wp, 0.005_wp, 0.0003_wp), &
                                   measurement('symplectic_euler_adjoint', additive_noise, 'tilted_pendulum', &
                                               1.001_wp, 0.005_wp, 0.0003_wp), &
                                   measurement('stormer_verlet', additive_noise, 'tilted_pendulum', &
                                               1.016_wp, 0.012_wp, 0.0011_wp), &
                                   measurement('gauss2', additive_noise, 'tilted_pendulum', &
                                               1.014_wp, 0.012_wp, 0.0011_wp), &
                                   measurement('gauss3', additive_noise, 'tilted_pendulum', &
                                               1.014_wp, 0.012_wp, 0.0011_wp), &
                                   measurement('gauss4', additive_noise, 'tilted_pendulum', &
                                               1.014_wp, 0.012_wp, 0.0011_wp), &
                                   measurement('lobatto2', additive_noise, 'tilted_pendulum', &
                                               1.016_wp, 0.012_wp, 0.0011_wp), &
                                   measurement('lobatto2_swapped', additive_noise, 'tilted_pendulum', &
                                               1.017_wp, 0.012_wp, 0.001_wp), &
                                   measurement('lobatto3', additive_noise, 'tilted_pendulum', &
                                               1.014_wp, 0.012_wp, 0.0011_wp), &
                                   measurement('lobatto3_swapped', additive_noise, 'tilted_pendulum', &
                                               1.014_wp, 0.012_wp, 0.0011_wp), &
                                   measurement('lobatto4', additive_noise, 'tilted_pendulum', &
                                               1.014_wp, 0.012_wp, 0.0011_wp), &
                                   measurement('lobatto4_swapped', additive_noise, 'tilted_pendulum', &
                                               1.014_wp, 0.012_wp, 0.0011_wp), &
                                   measurement('P1N2Q2Lob', additive_noise, 'tilted_pendulum', &
                                               1.016_wp, 0.012_wp, 0.0011_wp), &
                                   measurement('P1N2Q2Otr', additive_noise, 'tilted_pendulum', &
                                               1.012_wp, 0.012_wp, 0.0011_wp), &
                                   measurement('P1N2Q4Gau', additive_noise, 'tilted_pendulum', &
                                               1.013_wp, 0.012_wp, 0.0011_wp), &
                                   measurement('P1N3Q4Lob', additive_noise, 'tilted_pendulum', &
                                               1.013_wp, 0.012_wp, 0.0011_wp), &
                                   measurement('P2N2Q2Lob', additive_noise, 'tilted_pendulum', &
                                               1.016_wp, 0.012_wp, 0.0011_wp), &
                                   measurement('P2N2Q2Otr', additive_noise, 'tilted_pendulum', &
                                               1.022_wp, 0.011_wp, 0.0011_wp), &
                                   measurement('P2N3Q4Lob', additive_noise, 'tilted_pendulum', &
                                               1.014_wp, 0.012_wp, 0.0011_wp), &
                                   measurement('P2N3Q6Gau', additive_noise, 'tilted_pendulum', &
                                               1.014_wp, 0.012_wp, 0.0011_wp), &
                                   measurement('P2N4Q6Lob', additive_noise, 'tilted_pendulum', &
                                               1.014_wp, 0.012_wp, 0.0011_wp), &
                                   measurement('gauss2_strong32', additive_noise, 'tilted_pendulum', &
                                               1.522_wp, 0.027_wp, 0.0053_wp), &
                                   measurement('gauss2_strong32_areas', additive_noise, 'tilted_pendulum', &
                                               1.522_wp, 0.027_wp, 0.0053_wp), &
                                   measurement('midpoint_areas', additive_noise, 'tilted_pendulum', &
                                               1.012_wp, 0.012_wp, 4.7e-05_wp), &
                                   measurement('verlet_dz', additive_noise, 'fpu_chain', &
                                               1.994_wp, 0.012_wp, 9.9e-05_wp), &
                                   measurement('averaged_shift_midpoint', additive_noise, 'tilted_pendulum', &
                                               1.615_wp, 0.02_wp, 0.0055_wp), &
                                   measurement('drift_preserving', additive_noise, 'fpu_chain', &
                                               0.991_wp, 0.015_wp, 3.1e-05_wp), &
                                   measurement('exact_rotation', additive_noise, 'henon_heiles', &
                                               1.018_wp, 0.009_wp, 2.4e-05_wp), &
                                   measurement('gauss_dkdkd', additive_noise, 'fpu_chain', &
                                               1.997_wp, 0.015_wp, 3.5e-08_wp), &
                                   measurement('verlet_kdk', additive_noise, 'fpu_chain', &
                                               2.003_wp, 0.003_wp, 9.2e-09_wp), &
                                   measurement('chin4a', additive_noise, 'fpu_chain', &
                                               3.003_wp, 0.02_wp, 3e-05_wp), &
                                   measurement('gauss_dkdkd_strong2', additive_noise, 'fpu_chain', &
                                               1.997_wp, 0.015_wp, 3.5e-08_wp), &
                                   measurement('verlet_kdk_strong2', additive_noise, 'fpu_chain', &
                                               2.003_wp, 0.003_wp, 9.2e-09_wp), &
                                   measurement('chin4a_strong2', additive_noise, 'fpu_chain', &
                                               3.013_wp, 0.028_wp, 0.088_wp), &
                                   measurement('gauss_dkdkd_rotation', additive_noise, 'henon_heiles', &
                                               2.0_wp, 0.004_wp, 1.2e-08_wp), &
                                   measurement('gauss_dkdkd_midpoint', additive_noise, 'fpu_chain', &
                                               1.99_wp, 0.011_wp, 3.3e-08_wp), &
                                   measurement('verlet_kdk_midpoint', additive_noise, 'fpu_chain', &
                                               1.991_wp, 0.003_wp, 7.8e-09_wp), &
                                   measurement('heun', additive_noise, 'tilted_pendulum', &
                                               1.017_wp, 0.012_wp, 0.0011_wp), &
                                   measurement('euler_maruyama', additive_noise, 'tilted_pendulum', &
                                               1.003_wp, 0.004_wp, 0.00027_wp), &
                                   measurement('dirk:0.25', additive_noise, 'tilted_pendulum', &
                                               1.013_wp, 0.012_wp, 0.0011_wp), &
                                   measurement('lambda:0.3', additive_noise, 'tilted_pendulum', &
                                               1.005_wp, 0.011_wp, 0.00061_wp)]
   type(measurement), parameter :: commutative(39) = [ &
                                   measurement('midpoint', commutative_noise, 'pendulum', &
                                               1.043_wp, 0.017_wp, 0.0011_wp), &
                                   measurement('symplectic_euler', commutative_noise, 'pendulum', &
                                               0.995_wp, 0.004_wp, 0.00018_wp), &
                                   measurement('symplectic_euler_adjoint', commutative_noise, 'pendulum', &
                                               1.0_wp, 0.005_wp, 0.00016_wp), &
                                   measurement('stormer_verlet', commutative_noise, 'pendulum', &
                                               1.056_wp, 0.012_wp, 0.0012_wp), &
                                   measurement('gauss2', commutative_noise, 'pendulum', &
                                               1.001_wp, 0.02_wp, 0.0032_wp), &
                                   measurement('gauss3', commutative_noise, 'pendulum', &
                                               1.001_wp, 0.02_wp, 0.0032_wp), &
                                   measurement('gauss4', commutative_noise, 'pendulum', &
                                               1.001_wp, 0.02_wp, 0.0032_wp), &
                                   measurement('lobatto2', commutative_noise, 'pendulum', &
                                               1.056_wp, 0.012_wp, 0.0012_wp), &
                                   measurement('lobatto2_swapped', commutative_noise, 'pendulum', &
                                               1.063_wp, 0.024_wp, 0.00078_wp), &
                                   measurement('lobatto3', commutative_noise, 'pendulum', &
                                               1.0_wp, 0.02_wp, 0.0032_wp), &
                                   measurement('lobatto3_swapped', commutative_noise, 'pendulum', &
                                               1.001_wp, 0.02_wp, 0.0032_wp), &
                                   measurement('lobatto4', commutative_noise, 'pendulum', &
                                               1.001_wp, 0.02_wp, 0.0032_wp), &
                                   measurement('lobatto4_swapped', commutative_noise, 'pendulum', &
                                               1.001_wp, 0.02_wp, 0.0032_wp), &
                                   measurement('P1N2Q2Lob', commutative_noise, 'synchrotron', &
                                               1.001_wp, 0.027_wp, 0.003_wp), &
                                   measurement('P1N2Q2Otr', commutative_noise, 'synchrotron', &
                                               0.998_wp, 0.026_wp, 0.003_wp), &
                                   measurement('P1N2Q4Gau', commutative_noise, 'synchrotron', &
                                               0.999_wp, 0.026_wp, 0.003_wp), &
                                   measurement('P1N3Q4Lob', commutative_noise, 'synchrotron', &
                                               0.999_wp, 0.026_wp, 0.003_wp), &
                                   measurement('P2N2Q2Lob', commutative_noise, 'pendulum', &
                                               1.056_wp, 0.012_wp, 0.0012_wp), &
                                   measurement('P2N2Q2Otr', commutative_noise, 'pendulum', &
                                               1.071_wp, 0.024_wp, 0.00035_wp), &
                                   measurement('P2N3Q4Lob', commutative_noise, 'synchrotron', &
                                               0.997_wp, 0.024_wp, 0.0031_wp), &
                                   measurement('P2N3Q6Gau', commutative_noise, 'synchrotron', &
                                               0.997_wp, 0.024_wp, 0.0031_wp), &
                                   measurement('P2N4Q6Lob', commutative_noise, 'synchrotron', &
                                               0.997_wp, 0.024_wp, 0.0031_wp), &
                                   measurement('gauss2_strong32', commutative_noise, 'pendulum', &
                                               1.514_wp, 0.021_wp, 0.0053_wp), &
                                   measurement('gauss2_strong32_areas', commutative_noise, 'pendulum', &
                                               1.514_wp, 0.021_wp, 0.0053_wp), &
                                   measurement('midpoint_areas', commutative_noise, 'pendulum', &
                                               1.043_wp, 0.017_wp, 5e-05_wp), &
                                   measurement('exact_rotation', commutative_noise, 'synchrotron', &
                                               0.997_wp, 0.017_wp, 0.0024_wp), &
                                   measurement('gauss_dkdkd', commutative_noise, 'synchrotron', &
                                               1.513_wp, 0.026_wp, 3.6e-07_wp), &
                                   measurement('verlet_kdk', commutative_noise, 'synchrotron', &
                                               1.578_wp, 0.031_wp, 2.7e-07_wp), &
                                   measurement('chin4a', commutative_noise, 'synchrotron', &
                                               1.506_wp, 0.029_wp, 9.8e-07_wp), &
                                   measurement('gauss_dkdkd_strong2', commutative_noise, 'synchrotron', &
                                               1.981_wp, 0.024_wp, 5.4e-06_wp), &
                                   measurement('verlet_kdk_strong2', commutative_noise, 'synchrotron', &
                                               1.987_wp, 0.014_wp, 1.9e-06_wp), &
                                   measurement('chin4a_strong2', commutative_noise, 'synchrotron', &
                                               2.469_wp, 0.035_wp, 0.023_wp), &
                                   measurement('gauss_dkdkd_rotation', commutative_noise, 'synchrotron', &
                                               1.512_wp, 0.025_wp, 3.6e-07_wp), &
                                   measurement('gauss_dkdkd_midpoint', commutative_noise, 'synchrotron', &
                                               1.512_wp, 0.025_wp, 3.6e-07_wp), &
                                   measurement('verlet_kdk_midpoint', commutative_noise, 'synchrotron', &
                                               1.589_wp, 0.032_wp, 2.7e-07_wp), &
                                   measurement('heun', commutative_noise, 'pendulum', &
                                               1.043_wp, 0.021_wp, 0.00064_wp), &
                                   measurement('euler_maruyama', commutative_noise, 'pendulum', &
                                               0.606_wp, 0.02_wp, 2.8e-05_wp), &
                                   measurement('dirk:0.25', commutative_noise, 'pendulum', &
                                               1.035_wp, 0.014_wp, 0.002_wp), &
                                   measurement('lambda:0.3', commutative_noise, 'pendulum', &
                                               0.997_wp, 0.005_wp, 0.00047_wp)]
   type(measurement), parameter :: general(22) = [ &
                                   measurement('midpoint', general_noise, 'noncommutative_oscillator', &
                                               0.485_wp, 0.037_wp, 0.017_wp), &
                                   measurement('symplectic_euler', general_noise, 'noncommutative_oscillator', &
                                               0.601_wp, 0.038_wp, 0.017_wp), &
                                   measurement('symplectic_euler_adjoint', general_noise, 'noncommutative_oscillator', &
                                               0.684_wp, 0.054_wp, 0.016_wp), &
                                   measurement('stormer_verlet', general_noise, 'noncommutative_oscillator', &
                                               0.484_wp, 0.036_wp, 0.017_wp), &
                                   measurement('gauss2', general_noise, 'noncommutative_oscillator', &
                                               0.489_wp, 0.04_wp, 0.017_wp), &
                                   measurement('gauss3', general_noise, 'noncommutative_oscillator', &
                                               0.488_wp, 0.04_wp, 0.017_wp), &
                                   measurement('gauss4', general_noise, 'noncommutative_oscillator', &
                                               0.488_wp, 0.04_wp, 0.017_wp), &
                                   measurement('lobatto2', general_noise, 'noncommutative_oscillator', &
                                               0.484_wp, 0.036_wp, 0.017_wp), &
                                   measurement('lobatto2_swapped', general_noise, 'noncommutative_oscillator', &
                                               0.511_wp, 0.046_wp, 0.017_wp), &
                                   measurement('lobatto3', general_noise, 'noncommutative_oscillator', &
                                               0.488_wp, 0.04_wp, 0.017_wp), &
                                   measurement('lobatto3_swapped', general_noise, 'noncommutative_oscillator', &
                                               0.488_wp, 0.04_wp, 0.017_wp), &
                                   measurement('lobatto4', general_noise, 'noncommutative_oscillator', &
                                               0.488_wp, 0.04_wp, 0.017_wp), &
                                   measurement('lobatto4_swapped', general_noise, 'noncommutative_oscillator', &
                                               0.488_wp, 0.04_wp, 0.017_wp), &
                                   measurement('P2N2Q2Lob', general_noise, 'noncommutative_oscillator', &
                                               0.484_wp, 0.036_wp, 0.017_wp), &
                                   measurement('P2N2Q2Otr', general_noise, 'noncommutative_oscillator', &
                                               0.551_wp, 0.046_wp, 0.017_wp), &
                                   measurement('gauss2_strong32', general_noise, 'noncommutative_oscillator', &
                                               0.462_wp, 0.04_wp, 0.0093_wp), &
                                   measurement('gauss2_strong32_areas', general_noise, 'noncommutative_oscillator', &
                                               1.009_wp, 0.059_wp, 0.057_wp), &
                                   measurement('midpoint_areas', general_noise, 'noncommutative_oscillator', &
                                               1.019_wp, 0.059_wp, 0.051_wp), &
                                   measurement('heun', general_noise, 'noncommutative_oscillator', &
                                               0.491_wp, 0.042_wp, 0.019_wp), &
                                   measurement('euler_maruyama', general_noise, 'noncommutative_oscillator', &
                                               0.465_wp, 0.03_wp, 0.013_wp), &
                                   measurement('dirk:0.25', general_noise, 'noncommutative_oscillator', &
                                               0.486_wp, 0.042_wp, 0.019_wp), &
                                   measurement('lambda:0.3', general_noise, 'noncommutative_oscillator', &
                                               0.493_wp, 0.039_wp, 0.019_wp)]
   type(measurement), parameter :: commuting(21) = [ &
                                   measurement('midpoint', commuting_flows, 'kubo', &
                                               1.056_wp, 0.014_wp, 0.0_wp), &
                                   measurement('symplectic_euler', commuting_flows, 'kubo', &
                                               0.992_wp, 0.003_wp, 0.0_wp), &
                                   measurement('symplectic_euler_adjoint', commuting_flows, 'kubo', &
                                               1.003_wp, 0.004_wp, 0.0_wp), &
                                   measurement('stormer_verlet', commuting_flows, 'kubo', &
                                               1.095_wp, 0.024_wp, 0.0_wp), &
                                   measurement('gauss2', commuting_flows, 'kubo', &
                                               2.143_wp, 0.044_wp, 0.0_wp), &
                                   measurement('gauss3', commuting_flows, 'kubo', &
                                               3.313_wp, 0.108_wp, 0.0_wp), &
                                   measurement('lobatto2', commuting_flows, 'kubo', &
                                               1.095_wp, 0.024_wp, 0.0_wp), &
                                   measurement('lobatto2_swapped', commuting_flows, 'kubo', &
                                               1.064_wp, 0.013_wp, 0.0_wp), &
                                   measurement('lobatto3', commuting_flows, 'kubo', &
                                               2.139_wp, 0.039_wp, 0.0_wp), &
                                   measurement('lobatto3_swapped', commuting_flows, 'kubo', &
                                               2.182_wp, 0.049_wp, 0.0_wp), &
                                   measurement('lobatto4', commuting_flows, 'kubo', &
                                               3.357_wp, 0.111_wp, 0.0_wp), &
                                   measurement('lobatto4_swapped', commuting_flows, 'kubo', &
                                               3.294_wp, 0.103_wp, 0.0_wp), &
                                   measurement('P2N2Q2Lob', commuting_flows, 'kubo', &
                                               1.095_wp, 0.024_wp, 0.0_wp), &
                                   measurement('P2N2Q2Otr', commuting_flows, 'kubo', &
                                               1.071_wp, 0.013_wp, 0.0_wp), &
                                   measurement('gauss2_strong32', commuting_flows, 'kubo', &
                                               2.143_wp, 0.044_wp, 0.0_wp), &
                                   measurement('gauss2_strong32_areas', commuting_flows, 'kubo', &
                                               2.143_wp, 0.044_wp, 0.0_wp), &
                                   measurement('midpoint_areas', commuting_flows, 'kubo', &
                                               1.056_wp, 0.014_wp, 0.0_wp), &
                                   measurement('heun', commuting_flows, 'kubo', &
                                               1.062_wp, 0.015_wp, 0.0_wp), &
                                   measurement('euler_maruyama', commuting_flows, 'kubo', &
                                               0.654_wp, 0.028_wp, 0.0_wp), &
                                   measurement('dirk:0.25', commuting_flows, 'kubo', &
                                               1.06_wp, 0.015_wp, 0.0_wp), &
                                   measurement('lambda:0.3', commuting_flows, 'kubo', &
                                               0.991_wp, 0.002_wp, 0.0_wp)]
   type(measurement), parameter :: weak(43) = [ &
                                   measurement('midpoint', weak_order, 'noncommutative_oscillator', &
                                               1.014_wp, 0.013_wp, 0.0_wp), &
                                   measurement('symplectic_euler', weak_order, 'noncommutative_oscillator', &
                                               1.001_wp, 0.001_wp, 0.0_wp), &
                                   measurement('symplectic_euler_adjoint', weak_order, 'noncommutative_oscillator', &
                                               1.001_wp, 0.001_wp, 0.0_wp), &
                                   measurement('stormer_verlet', weak_order, 'noncommutative_oscillator', &
                                               1.036_wp, 0.033_wp, 0.0_wp), &
                                   measurement('gauss2', weak_order, 'noncommutative_oscillator', &
                                               1.011_wp, 0.01_wp, 0.0_wp), &
                                   measurement('gauss3', weak_order, 'noncommutative_oscillator', &
                                               1.011_wp, 0.01_wp, 0.0_wp), &
                                   measurement('gauss4', weak_order, 'noncommutative_oscillator', &
                                               1.011_wp, 0.01_wp, 0.0_wp), &
                                   measurement('lobatto2', weak_order, 'noncommutative_oscillator', &
                                               1.036_wp, 0.033_wp, 0.0_wp), &
                                   measurement('lobatto2_swapped', weak_order, 'noncommutative_oscillator', &
                                               2.0_wp, 0.0_wp, 0.0_wp), &
                                   measurement('lobatto3', weak_order, 'noncommutative_oscillator', &
                                               1.01_wp, 0.01_wp, 0.0_wp), &
                                   measurement('lobatto3_swapped', weak_order, 'noncommutative_oscillator', &
                                               1.011_wp, 0.01_wp, 0.0_wp), &
                                   measurement('lobatto4', weak_order, 'noncommutative_oscillator', &
                                               1.011_wp, 0.01_wp, 0.0_wp), &
                                   measurement('lobatto4_swapped', weak_order, 'noncommutative_oscillator', &
                                               1.011_wp, 0.01_wp, 0.0_wp), &
                                   measurement('P1N2Q2Lob', weak_order, 'noncommutative_oscillator', &
                                               1.036_wp, 0.033_wp, 0.0_wp), &
                                   measurement('P1N2Q2Otr', weak_order, 'noncommutative_oscillator', &
                                               1.016_wp, 0.015_wp, 0.0_wp), &
                                   measurement('P1N2Q4Gau', weak_order, 'noncommutative_oscillator', &
                                               1.021_wp, 0.02_wp, 0.0_wp), &
                                   measurement('P1N3Q4Lob', weak_order, 'noncommutative_oscillator', &
                                               1.021_wp, 0.02_wp, 0.0_wp), &
                                   measurement('P2N2Q2Lob', weak_order, 'noncommutative_oscillator', &
                                               1.036_wp, 0.033_wp, 0.0_wp), &
                                   measurement('P2N2Q2Otr', weak_order, 'noncommutative_oscillator', &
                                               1.076_wp, 0.066_wp, 0.0_wp), &
                                   measurement('P2N3Q4Lob', weak_order, 'noncommutative_oscillator', &
                                               1.01_wp, 0.01_wp, 0.0_wp), &
                                   measurement('P2N3Q6Gau', weak_order, 'noncommutative_oscillator', &
                                               1.011_wp, 0.01_wp, 0.0_wp), &
                                   measurement('P2N4Q6Lob', weak_order, 'noncommutative_oscillator', &
                                               1.011_wp, 0.01_wp, 0.0_wp), &
                                   measurement('gauss2_strong32', weak_order, 'noncommutative_oscillator', &
                                               3.011_wp, 0.011_wp, 0.0_wp), &
                                   measurement('gauss2_strong32_areas', weak_order, 'noncommutative_oscillator', &
                                               3.011_wp, 0.011_wp, 0.0_wp), &
                                   measurement('gauss2_weak2', weak_order, 'noncommutative_oscillator', &
                                               1.998_wp, 0.002_wp, 0.0_wp), &
                                   measurement('gauss2_weak2_areas', weak_order, 'noncommutative_oscillator', &
                                               1.997_wp, 0.003_wp, 0.0_wp), &
                                   measurement('midpoint_areas', weak_order, 'noncommutative_oscillator', &
                                               1.014_wp, 0.013_wp, 0.0_wp), &
                                   measurement('midpoint_weak1', weak_order, 'noncommutative_oscillator', &
                                               1.014_wp, 0.013_wp, 0.0_wp), &
                                   measurement('verlet_dz', weak_order, 'linear_oscillator', &
                                               1.999_wp, 0.001_wp, 0.0_wp), &
                                   measurement('averaged_shift_midpoint', weak_order, 'linear_oscillator', &
                                               2.0_wp, 0.0_wp, 0.0_wp), &
                                   measurement('drift_preserving', weak_order, 'linear_oscillator', &
                                               1.001_wp, 0.001_wp, 0.0_wp), &
                                   measurement('exact_rotation', weak_order, 'linear_oscillator', &
                                               1.002_wp, 0.002_wp, 0.0_wp), &
                                   measurement('gauss_dkdkd', weak_order, 'noncommutative_oscillator', &
                                               2.0_wp, 0.0_wp, 0.0_wp), &
                                   measurement('verlet_kdk', weak_order, 'noncommutative_oscillator', &
                                               2.0_wp, 0.0_wp, 0.0_wp), &
                                   measurement('chin4a', weak_order, 'noncommutative_oscillator', &
                                               3.011_wp, 0.011_wp, 0.0_wp), &
                                   measurement('gauss_dkdkd_rotation', weak_order, 'linear_oscillator', &
                                               3.994_wp, 0.006_wp, 0.0_wp), &
                                   measurement('gauss_dkdkd_midpoint', weak_order, 'noncommutative_oscillator', &
                                               2.0_wp, 0.0_wp, 0.0_wp), &
                                   measurement('verlet_kdk_midpoint', weak_order, 'noncommutative_oscillator', &
                                               1.999_wp, 0.001_wp, 0.0_wp), &
                                   measurement('verlet_dkd_weak2', weak_order, 'noncommutative_oscillator', &
                                               2.0_wp, 0.0_wp, 0.0_wp), &
                                   measurement('heun', weak_order, 'noncommutative_oscillator', &
                                               2.017_wp, 0.016_wp, 0.0_wp), &
                                   measurement('euler_maruyama', weak_order, 'noncommutative_oscillator', &
                                               1.003_wp, 0.003_wp, 0.0_wp), &
                                   measurement('dirk:0.25', weak_order, 'noncommutative_oscillator', &
                                               1.012_wp, 0.012_wp, 0.0_wp), &
                                   measurement('lambda:0.3', weak_order, 'noncommutative_oscillator', &
                                               1.0_wp, 0.003_wp, 0.0_wp)]
   type(measurement), parameter :: found(*) = [additive, commutative, general, commuting, weak]
   type(damped_measurement), parameter :: damped(36) = [ &
                                          damped_measurement('midpoint', [1.06_wp, 1.09_wp]), &
                                          damped_measurement('symplectic_euler', [1.04_wp, 0.99_wp]), &
                                          damped_measurement('symplectic_euler_adjoint', [0.99_wp, 1.02_wp]), &
                                          damped_measurement('stormer_verlet', [1.1_wp, 1.09_wp]), &
                                          damped_measurement('gauss2', [1.07_wp, 1.08_wp]), &
                                          damped_measurement('gauss3', [1.07_wp, 1.08_wp]), &
                                          damped_measurement('gauss4', [1.07_wp, 1.08_wp]), &
                                          damped_measurement('lobatto2', [1.1_wp, 1.09_wp]), &
                                          damped_measurement('lobatto2_swapped', [1.08_wp, 1.09_wp]), &
                                          damped_measurement('lobatto3', [1.07_wp, 1.08_wp]), &
                                          damped_measurement('lobatto3_swapped', [1.07_wp, 1.08_wp]), &
                                          damped_measurement('lobatto4', [1.07_wp, 1.08_wp]), &
                                          damped_measurement('lobatto4_swapped', [1.07_wp, 1.08_wp]), &
                                          damped_measurement('P1N2Q2Lob', [1.1_wp, 1.09_wp]), &
                                          damped_measurement('P1N2Q2Otr', [1.07_wp, 1.08_wp]), &
                                          damped_measurement('P1N2Q4Gau', [1.07_wp, 1.08_wp]), &
                                          damped_measurement('P1N3Q4Lob', [1.07_wp, 1.08_wp]), &
                                          damped_measurement('P2N2Q2Lob', [1.1_wp, 1.09_wp]), &
                                          damped_measurement('P2N2Q2Otr', [1.09_wp, 1.11_wp]), &
                                          damped_measurement('P2N3Q4Lob', [1.07_wp, 1.08_wp]), &
                                          damped_measurement('P2N3Q6Gau', [1.07_wp, 1.08_wp]), &
                                          damped_measurement('P2N4Q6Lob', [1.07_wp, 1.08_wp]), &
                                          damped_measurement('midpoint_areas', [1.06_wp, 1.09_wp]), &
                                          damped_measurement('verlet_dz', [2.06_wp, 0.0_wp]), &
                                          damped_measurement('drift_preserving', [1.05_wp, 0.0_wp]), &
                                          damped_measurement('exact_rotation', [1.05_wp, 0.99_wp]), &
                                          damped_measurement('gauss_dkdkd', [1.93_wp, 1.7_wp]), &
                                          damped_measurement('verlet_kdk', [1.99_wp, 1.96_wp]), &
                                          damped_measurement('chin4a', [3.0_wp, 1.47_wp]), &
                                          damped_measurement('gauss_dkdkd_strong2', [1.93_wp, 2.03_wp]), &
                                          damped_measurement('verlet_kdk_strong2', [1.99_wp, 2.01_wp]), &
                                          damped_measurement('chin4a_strong2', [3.0_wp, 2.58_wp]), &
                                          damped_measurement('gauss_dkdkd_rotation', [1.96_wp, 1.67_wp]), &
                                          damped_measurement('gauss_dkdkd_midpoint', [2.03_wp, 1.88_wp]), &
                                          damped_measurement('verlet_kdk_midpoint', [2.0_wp, 1.98_wp]), &
                                          damped_measurement('heun', [1.11_wp, 1.12_wp])]

contains

   !> Enter the measurements of a scheme of the catalogue into its orders.
   pure subroutine add_measurements(order, damped_order, name)
      type(order_type), intent(inout) :: order(norder)
      real(wp), intent(inout) :: damped_order(2)
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
      do i = 1, size(damped)
         if (damped(i)%scheme == name) damped_order = damped(i)%order
      end do
   end subroutine add_measurements

end module symsde_scheme_measured
