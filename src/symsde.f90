! SPDX-License-Identifier: BSD-3-Clause
!> symsde: symplectic integration of stochastic Hamiltonian systems
!>
!>    dp = -H_q dt - sum_k H_{k,q} o dW_k,   dq = H_p dt + sum_k H_{k,p} o dW_k     (Stratonovich)
!>
!> All names that a program needs, from one module. Nothing is defined here; names too short to share a scope with a
!> user's own get a prefix.
!>
!>    use symsde
!>    type(kubo_model) :: model
!>    type(scheme_type) :: scheme
!>    type(paths_type) :: run
!>    type(error_type), allocatable :: error
!>    call new_kubo(model, a=1.0_wp, sigma=0.3_wp, error=error)
!>    call get_scheme(scheme, 'midpoint', error)
!>    call simulate(model, scheme, run_options(step=0.02_wp, nstep=5000_i8, npath=1000_i8, seed=1_i8), &
!>                  q0=[1.0_wp], p0=[0.0_wp], run=run, error=error)
!>    if (allocated(error)) print '(a)', error%message
module symsde
   ! kinds, errors, traits
   use symsde_base_kinds, only: wp, i4, i8
   use symsde_base_status, only: error_type, status_text, status_ok
   use symsde_base_status, only: status_invalid_argument => invalid_argument, status_incompatible => incompatible
   use symsde_base_status, only: status_unknown_name => unknown_name, status_wrong_shape => wrong_shape
   use symsde_base_status, only: status_too_large => too_large, status_false_trait => false_trait
   use symsde_base_status, only: status_null_handle => null_handle, status_out_of_memory => out_of_memory
   use symsde_base_status, only: status_missing_operation => missing_operation, status_not_converged => not_converged
   use symsde_base_status, only: status_singular => singular, status_nonfinite => nonfinite
   use symsde_base_status, only: status_callback_failed => callback_failed, status_stopped => stopped
   use symsde_base_status, only: status_paths_failed => paths_failed, status_absorbed => absorbed
   use symsde_base_traits, only: model_traits, dense_hessian => dense
   use symsde_base_version, only: library_version
   ! models: the type to extend, the built-in ones, one by name, one from C functions
   use symsde_model_abstract, only: model_type
   use symsde_base_damping, only: damping_type, new_damping, noise_of_scheme, noise_law2, noise_law3, noise_path, &
                                  noise_polynomial
   use symsde_base_rates, only: rate_type
   use symsde_base_traits, only: force_traits
   use symsde_model_forces, only: force_type
   use symsde_model_catalogue_additive_oscillator, only: additive_oscillator_model, new_additive_oscillator
   use symsde_model_catalogue_driven_pendulum, only: driven_pendulum_model, new_driven_pendulum
   use symsde_model_catalogue_fpu_chain, only: fpu_chain_model, new_fpu_chain
   use symsde_model_catalogue_henon_heiles, only: henon_heiles_model, new_henon_heiles
   use symsde_model_catalogue_kubo, only: kubo_model, new_kubo
   use symsde_model_catalogue_linear_oscillator, only: linear_oscillator_model, new_linear_oscillator
   use symsde_model_catalogue_noncommutative_oscillator, only: noncommutative_oscillator_model, &
                                                               new_noncommutative_oscillator
   use symsde_model_catalogue_pendulum, only: pendulum_model, new_pendulum
   use symsde_model_catalogue_synchrotron, only: synchrotron_model, new_synchrotron
   use symsde_model_catalogue_by_name, only: get_model, model_names, parameter_names, parameter_defaults
   use symsde_model_catalogue_by_path, only: get_model_by_path
   use symsde_model_kernels, only: kernel_model, kernel_offers
   use symsde_model_user_callback, only: callback_model, new_callback_model, new_parts_model
   use symsde_model_views_thermostat, only: thermostat_model, new_thermostat
   use symsde_model_probe_traits, only: probe_model
   ! sincos_lanes(n, x, sine, cosine), for users' models: arrays of any length n at once, several times as fast as the
   ! intrinsics lane by lane; within 1 ulp for |x| <= 1e5, with the same bits on every processor with fused
   ! multiply-add, and the intrinsics beyond. Each result depends on its own x alone
   use symsde_base_sincos, only: sincos_lanes
   ! schemes: by name, from a quadrature, from a tableau, and their certificates
   use symsde_scheme_scheme, only: scheme_type, tableau_form, galerkin_form, ito_form, symplectic_conjugate
   use symsde_scheme_scheme, only: correction_auto, correction_none, correction_mean, correction_increments
   use symsde_scheme_catalogue, only: get_scheme, scheme_names, scheme_families
   use symsde_scheme_quadrature, only: get_quadrature
   use symsde_scheme_discrete_lagrangian, only: scheme_from_quadrature, scheme_from_end_point_rule
   use symsde_scheme_tableau, only: scheme_from_tableau
   use symsde_scheme_composition, only: adjoint_scheme, composed_scheme, symmetric_composition, triple_jump
   use symsde_scheme_certificate, only: certificate_type, certificate, certificate_text
   use symsde_scheme_orders, only: order_type, additive_noise, commutative_noise, general_noise, commuting_flows, &
                                   weak_order, evidence_none, evidence_claimed, evidence_derived
   ! runs
   use symsde_noise_states, only: draw_states, normal_states, uniform_states
   use symsde_base_counters, only: counters_type
   use symsde_ensemble_monitor, only: monitor_type
   use symsde_ensemble_statistics_merge, only: merge_moments, moment_errors
   use symsde_ensemble_observe_observables, only: observables_type
   use symsde_ensemble_observe_observed, only: merge_observed, observed_answer
   use symsde_ensemble_observe_observers, only: observe_histogram, observe_quantiles, observe_covariance, &
                                                observe_autocorrelation, observe_extremes, observe_passage, &
                                                observe_paths, observe_means
   use symsde_ensemble_observe_streaming, only: observer_request, observed_type
   use symsde_ensemble_options, only: run_options
   use symsde_ensemble_run_prepared, only: prepared_run, prepare
   use symsde_ensemble_run_report, only: run_report
   use symsde_ensemble_run_simulate, only: paths_type, moments_type, simulate, moments
   ! diagnostics
   use symsde_diagnose_action, only: discrete_action, action_gradient, euler_lagrange_residual
   use symsde_diagnose_commutator, only: commutator_type, commutator
   use symsde_diagnose_boundary_value, only: stationary_path
   use symsde_diagnose_exact, only: exact_solution
   use symsde_diagnose_gradients, only: gradients_type, tangents_type, path_gradients, path_tangents
   use symsde_diagnose_invariants, only: invariant_drift, quadratic_invariant
   use symsde_diagnose_sweep_path_function, only: path_function
   use symsde_diagnose_symplecticity, only: symplecticity_defect, tangent_map
   implicit none
   public
end module symsde
