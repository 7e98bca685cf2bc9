# SPDX-License-Identifier: BSD-3-Clause
"""include/symsde.h in ctypes: structs, callback types and one table of functions.

Arrays are passed as addresses (c_void_p), and None is NULL.
"""

from __future__ import annotations

import ctypes
from ctypes import (
    CFUNCTYPE,
    POINTER,
    Structure,
    c_char,
    c_char_p,
    c_double,
    c_int,
    c_int32,
    c_int64,
    c_size_t,
    c_uint64,
    c_void_p,
)

MESSAGE_SIZE = 1024
MAX_FAILED_LISTED = 1000
OK, NOT_CONVERGED, SINGULAR, NONFINITE, CALLBACK_FAILED, STOPPED, PATHS_FAILED, ABSORBED = range(8)
INVALID_ARGUMENT = -1
MISSING_OPERATION = -9
CORRECTIONS = ("auto", "none", "mean", "increments")
AREAS = ("path", "law")
DAMPING_NOISES = ("law", "law2", "law3", "path", "polynomial")


class Error(Structure):
    """struct symsde_error."""

    _fields_ = (("code", c_int32), ("message", c_char * MESSAGE_SIZE))


class Traits(Structure):
    """struct symsde_traits."""

    _fields_ = (
        ("struct_size", c_size_t),
        *((name, c_int32) for name in ("ndof", "nnoise", "separable", "additive")),
        *((name, c_int32) for name in ("position_noise", "quadratic", "identity_mass", "bandwidth")),
        *((name, c_int32) for name in ("has_value", "has_hessian", "has_hessian_vector")),
        ("max_frequency", c_double),
        ("noise_lipschitz", c_double),
        ("rotation", POINTER(c_double)),
        ("silent", POINTER(c_int32)),
        ("constant_mass", c_int32),
        ("diagonal_mass", c_int32),
        ("touches_from", POINTER(c_int32)),
        ("touches", POINTER(c_int32)),
        ("has_gradient", c_int32),
        ("has_parts", c_int32),
    )


ORDERS = 5  # SYMSDE_ORDERS


class SchemeInfo(Structure):
    """struct symsde_scheme_info."""

    _fields_ = (
        ("struct_size", c_size_t),
        *((name, c_int32) for name in ("form", "nstage", "degree")),
        *((name, c_int32) for name in ("symplectic", "symmetric", "keeps_quadratic", "keeps_bilinear")),
        ("structure_evidence", c_int32),
        *((name, c_double) for name in ("symplecticity_residual", "symmetry_residual", "quadratic_residual")),
        *((name, c_double) for name in ("stratonovich_sum", "correction_coefficient")),
        *((name, c_int32) for name in ("correction_needed", "correction_exists")),
        ("order", c_double * ORDERS),
        ("order_evidence", c_int32 * ORDERS),
        ("order_noise_free", c_int32),
        *((name, c_double * ORDERS) for name in ("measured_order", "measured_half_width", "measured_floor")),
        *((name, c_int32) for name in ("uses_dz", "uses_areas", "uses_stt_area", "uses_magnus")),
        *((name, c_int32) for name in ("uses_nested_bracket", "law")),
        *((name, c_int32) for name in ("explicit_for", "gradients_per_step", "unknowns", "unknowns_if_separable")),
        ("name", c_char * 64),
        ("reference", c_char * 256),
    )


# int f(int64_t done, int64_t total, void *user)
Progress = CFUNCTYPE(c_int, c_int64, c_int64, c_void_p)
Warn = CFUNCTYPE(c_int, c_char_p, c_void_p)


class Options(Structure):
    """struct symsde_options."""

    _fields_ = (
        ("struct_size", c_size_t),
        ("step", c_double),
        ("steps", c_int64),
        ("paths", c_int64),
        ("seed", c_uint64),
        ("t0", c_double),
        *((name, c_int64) for name in ("save_every", "first_path", "first_step")),
        ("refine", c_int32),
        ("correction", c_int32),
        ("truncation", c_double),
        ("truncation_time", c_double),
        *((name, c_int32) for name in ("compensated", "general", "max_iter", "fixed_point")),
        ("lanes", c_int32),
        ("threads", c_int32),
        ("progress", Progress),
        ("progress_user", c_void_p),
        ("area_time", c_double),
        ("areas", c_int32),
        ("common_noise", c_uint64),
        ("noise_paths", c_int64),
        ("damping_noise", c_int32),
        ("row_paths", c_int64),
    )

    def __reduce__(self) -> tuple:
        """Support pickle and copies: numbers are copied, progress functions are not."""
        numbers = [name for name, *_ in self._fields_ if not name.startswith("progress")]
        return _made, (Options, {name: getattr(self, name) for name in numbers})


def _made(struct: type[Structure], members: dict) -> Structure:
    """A struct with these members."""
    return struct(**members)


class Input(Structure):
    """struct symsde_input."""

    _fields_ = (
        ("struct_size", c_size_t),
        ("q0", c_void_p),
        ("p0", c_void_p),
        ("q0_paths", c_int64),
        ("p0_paths", c_int64),
        ("increments", c_void_p),
        *((f"increment_{name}", c_int64) for name in ("rows", "noises", "paths")),
        ("q0_low", c_void_p),
        ("p0_low", c_void_p),
        ("progress", Progress),
        ("progress_user", c_void_p),
        ("warn", Warn),
        ("warn_user", c_void_p),
        ("increment_strides", c_void_p),
    )


COUNTERS = (
    "path_steps",
    "normals",
    "gradients",
    "hessians",
    "hessian_vectors",
    "iterations",
    "solves",
    "lapack_solves",
    "failures",
    "damped",
    "continued",
    "pivoted_solves",
)


class Report(Structure):
    """struct symsde_report."""

    _fields_ = (
        ("struct_size", c_size_t),
        ("status", c_int32),
        ("correction", c_int32),
        *((name, c_int64) for name in COUNTERS[:-1]),
        ("failed", c_int64),
        ("stopped", c_int64),
        ("threads", c_int32),
        ("lanes", c_int32),
        *((name, c_double) for name in ("lost_variance", "seconds_setup", "seconds_run")),
        ("stepper", c_char * 64),
        ("left_out", c_char * 512),
        ("warnings", c_char * 2048),
        ("functionals", c_char * 32),
        ("pivoted_solves", c_int64),
        ("lapack", c_char * 128),
        ("grown", c_int64),
        ("damping", c_char * 192),
    )


class Paths(Structure):
    """struct symsde_paths."""

    _fields_ = (
        ("struct_size", c_size_t),
        *((name, c_void_p) for name in ("t", "q", "p", "status", "failed_step")),
        *((name, c_void_p) for name in ("last_q", "last_p", "q_low", "p_low")),
    )


class State(Structure):
    """struct symsde_state."""

    _fields_ = (
        ("struct_size", c_size_t),
        *((name, c_void_p) for name in ("q", "p", "q_low", "p_low", "status", "failed_step")),
        ("paths", c_int64),
        ("ndof", c_int32),
        ("nnoise", c_int32),
        ("next_step", c_int64),
        ("t", c_double),
    )


# The callbacks; the last argument of each is `void *user`. All arrays are double.
_block = (c_int, c_int, c_int, c_int, c_double, c_void_p, c_void_p, c_void_p)
CALLBACKS = {
    "gradient": CFUNCTYPE(*_block, c_void_p, c_void_p, c_void_p),
    "value": CFUNCTYPE(*_block, c_void_p, c_void_p),
    "hessian": CFUNCTYPE(*_block, c_void_p, c_void_p, c_void_p, c_void_p),
    "hessian_vector": CFUNCTYPE(*_block, c_void_p, c_void_p, c_void_p, c_void_p, c_void_p),
    "gradient_hessian": CFUNCTYPE(*_block, c_void_p, c_void_p, c_void_p, c_void_p, c_void_p, c_void_p),
    "third_derivative": CFUNCTYPE(*_block, *(c_void_p,) * 7),
    "force": CFUNCTYPE(*_block, c_void_p, c_void_p),
    "force_derivative": CFUNCTYPE(*_block, c_void_p, c_void_p, c_void_p),
    "damping": CFUNCTYPE(c_int, c_int, c_int, c_int, c_double, c_void_p, c_void_p, c_void_p),
    "flow": CFUNCTYPE(c_int, *(c_int,) * 6, c_double, c_double, *(c_void_p,) * 8),
}
CALLBACKS["chain_rows"] = CFUNCTYPE(
    *(c_int,) * 6, c_double, *(c_void_p,) * 5
)  # int f(nlane, ndof, nham, first, last, t, w, q, hq, hqq, user)
CALLBACKS["squares"] = CFUNCTYPE(
    *(c_int,) * 4, c_double, *(c_void_p,) * 6
)  # int f(nlane, ndof, nham, t, q, g, w, c, s, user)
CALLBACKS["drift"] = CFUNCTYPE(
    c_int, c_int, c_int, c_double, c_double, *(c_void_p,) * 5
)  # int f(nlane, ndof, t, tau, q, p, qn, pn, user)
CALLBACKS["kick"] = CFUNCTYPE(
    *(c_int,) * 4, c_double, *(c_void_p,) * 6
)  # int f(nlane, ndof, nham, t, w, q, p, qn, pn, user)
CALLBACKS["pull"] = CFUNCTYPE(
    *(c_int,) * 6, c_double, c_double, *(c_void_p,) * 7
)  # int f(nlane, ndof, nham, nmoving, nstep, t, h, part, dw, q, theta, u, c, user)
Observables = CFUNCTYPE(c_int, c_int, c_int, c_double, c_void_p, c_void_p, c_void_p, c_void_p)

PathFunction = CFUNCTYPE(c_int, c_int64, *(c_int,) * 4, *(c_void_p,) * 8)


class Moments(Structure):
    """struct symsde_moments."""

    _fields_ = (
        ("struct_size", c_size_t),
        *((name, c_void_p) for name in ("t", "n_ok", "mean", "variance", "se_mean")),
        ("nobservable", c_int32),
        ("observables", Observables),
        ("observables_user", c_void_p),
        ("nfailed_listed", c_int64),
        ("failed", c_int64 * MAX_FAILED_LISTED),
        ("failed_status", c_int32 * MAX_FAILED_LISTED),
        ("failed_step", c_int64 * MAX_FAILED_LISTED),
        ("m2", c_void_p),
        ("observables_lanes", c_int32),
        ("nobserver", c_int32),
        ("observers", c_void_p),
        ("paths", c_void_p),
    )


#: members of enum symsde_observer_kind, from 1 on
OBSERVERS = ("histogram", "quantiles", "covariance", "autocorrelation", "extremes", "passage", "paths", "means")


class Observer(Structure):
    """struct symsde_observer."""

    _fields_ = (
        ("struct_size", c_size_t),
        ("kind", c_int32),
        ("nvalue", c_int32),
        ("values", c_void_p),
        ("low", c_double),
        ("high", c_double),
        ("bins", c_int32),
        ("nshare", c_int32),
        ("shares", c_void_p),
        ("npath", c_int64),
        ("paths", c_void_p),
        ("absorbs", c_int32),
        ("bridges", c_int32),
        ("counts", c_void_p),
        ("sums", c_void_p),
        ("ngroup", c_int64),
        ("labels", c_void_p),
    )


_handle = c_void_p
_handle_out = POINTER(c_void_p)
_error = POINTER(Error)
_options = POINTER(Options)
_input = POINTER(Input)
_text = (c_char_p, c_size_t, POINTER(c_size_t))
_points = (_handle, c_int64, c_double, c_void_p, c_void_p, c_void_p)
_run = (_handle, _handle, _options)
_derived = (_handle, c_char_p, _handle_out, _error)
_residual = (*_run, c_void_p, c_void_p, c_void_p, c_void_p, _error)


def _arrays(count: int) -> tuple:
    """Types of this many array arguments, each of which may be NULL."""
    return (c_void_p,) * count


# name without symsde_ -> argument types; every function returns int
FUNCTIONS = {
    "status_text": (c_int, *_text),
    "version": _text,
    "build_info": _text,
    "memory_left": (POINTER(c_double), _error),
    "traits_init": (POINTER(Traits),),
    "model_names": _text,
    "model_parameters": (c_char_p, *_text, _error),
    "model_get": (c_char_p, c_int, POINTER(c_char_p), POINTER(c_double), _handle_out, _error),
    "model_get_by_path": (c_char_p, c_int, POINTER(c_char_p), c_int64, POINTER(c_double), _handle_out, _error),
    "model_new": (
        c_char_p,
        POINTER(Traits),
        *(CALLBACKS[kind] for kind in ("gradient", "value", "hessian", "hessian_vector")),
        c_void_p,
        _handle_out,
        _error,
    ),
    "model_new_parts": (
        c_char_p,
        POINTER(Traits),
        *(CALLBACKS[kind] for kind in ("drift", "kick", "value")),
        c_void_p,
        _handle_out,
        _error,
    ),
    "model_set_parts": (_handle, CALLBACKS["drift"], CALLBACKS["kick"], _error),
    "model_set_gradient_hessian": (_handle, CALLBACKS["gradient_hessian"], _error),
    "model_set_chain_rows": (_handle, CALLBACKS["chain_rows"], _error),
    "model_set_squares": (_handle, CALLBACKS["squares"], _error),
    "model_set_pull": (_handle, CALLBACKS["pull"], _error),
    "model_set_third_derivative": (_handle, CALLBACKS["third_derivative"], _error),
    "model_accept_null": (_handle, _error),
    "model_set_flow": (_handle, c_char_p, CALLBACKS["flow"], _error),
    "model_accept_any_lanes": (_handle, _error),
    "model_set_derived": (_handle, _error),
    "model_set_parameters": (_handle, c_int, c_int64, c_void_p, _error),
    "model_set_action_kicks": (_handle, c_int, _error),
    "model_set_quadratic_part": (_handle, POINTER(c_double), _error),
    "model_set_flow_slopes": (_handle, c_int, c_void_p, c_void_p, _error),
    "model_with_user": (_handle, c_void_p, c_void_p, _handle_out, _error),
    "model_set_damping": (_handle, c_int, POINTER(c_double), c_int, _error),
    "model_set_damping_function": (_handle, CALLBACKS["damping"], c_int, c_int, c_int, c_void_p, _error),
    "model_set_friction": (_handle, POINTER(c_double), c_int, _error),
    "model_thermostat": (_handle, c_int, POINTER(c_double), c_int, POINTER(c_double), _error),
    "model_set_force": (_handle, CALLBACKS["force"], CALLBACKS["force_derivative"], c_int, c_void_p, _error),
    "model_set_noise_force": (_handle, CALLBACKS["force"], CALLBACKS["force_derivative"], c_int, c_void_p, _error),
    "model_set_force_bandwidth": (_handle, c_int, _error),
    "model_delete": (_handle_out,),
    "model_traits": (_handle, POINTER(Traits), _error),
    "model_probe": (_handle, c_double, c_void_p, c_void_p, _error),
    "model_set_probed_traits": (_handle, c_double, c_void_p, c_void_p, _error),
    "model_value": (*_points, c_void_p, _error),
    "model_gradient": (*_points, c_void_p, c_void_p, _error),
    "model_hessian": (*_points, c_void_p, c_void_p, c_void_p, _error),
    "sincos": (c_int, *_arrays(3)),
    "scheme_info_init": (POINTER(SchemeInfo),),
    "scheme_names": _text,
    "scheme_get": (c_char_p, _handle_out, _error),
    "scheme_from_quadrature": (c_int, *_arrays(3), c_int, c_char_p, _handle_out, _error),
    "scheme_from_tableau": (c_int, *_arrays(6), c_char_p, c_int, _handle_out, _error),
    "scheme_adjoint": _derived,
    "scheme_symmetric_composition": _derived,
    "scheme_triple_jump": _derived,
    "scheme_compose": (c_int, _handle_out, c_void_p, c_char_p, _handle_out, _error),
    "scheme_delete": (_handle_out,),
    "scheme_get_info": (_handle, POINTER(SchemeInfo), _error),
    "scheme_certificate": (_handle, *_text, _error),
    "scheme_tableau": (_handle, *_arrays(7), _error),
    "options_init": (_options,),
    "options_check": (_options, _error),
    "input_init": (_input,),
    "report_init": (POINTER(Report),),
    "paths_init": (POINTER(Paths),),
    "saved_times": (_options, c_void_p, _error),
    "simulate": (*_run, _input, POINTER(Paths), POINTER(Report), _error),
    "path_gradient": (
        _handle,
        *_run,
        _input,
        c_int,
        c_int64,
        c_void_p,
        PathFunction,
        *_arrays(6),
        POINTER(Report),
        _error,
    ),
    "path_tangent": (
        _handle,
        *_run,
        _input,
        c_int,
        c_int64,
        c_void_p,
        c_int,
        c_int64,
        *_arrays(6),
        POINTER(Report),
        _error,
    ),
    "moments_init": (POINTER(Moments),),
    "compute_moments": (*_run, _input, POINTER(Moments), POINTER(Report), _error),
    "merge_moments": (c_int64, c_int64, *_arrays(6), _error),
    "moment_errors": (c_int64, c_int64, *_arrays(5), _error),
    "observer_init": (POINTER(Observer),),
    "observer_sizes": (_handle, _options, c_int, POINTER(Observer), c_void_p, _error),
    "observer_merge": (_handle, _options, c_int, POINTER(Observer), POINTER(Observer), _error),
    "observer_answer": (_handle, _options, c_int, POINTER(Observer), c_void_p, c_void_p, _error),
    "state_init": (POINTER(State),),
    "run_new": (*_run, _input, _handle_out, _error),
    "run_advance": (_handle, c_int64, c_int64, _input, POINTER(Paths), _error),
    "run_resume": (_handle, _input, POINTER(Paths), _error),
    "run_reset": (_handle, _input, c_uint64, c_int64, c_int64, _error),
    "run_state": (_handle, POINTER(State), _error),
    "run_report": (_handle, POINTER(Report), _error),
    "run_delete": (_handle_out,),
    "draw_states": (c_int, c_uint64, c_int, c_int64, c_int64, c_int, c_int, *_arrays(4), _error),
    "increments": (*_run, c_void_p, _error),
    "symplecticity": (*_run, c_int64, c_void_p, c_void_p, c_void_p, c_void_p, _error),
    "discrete_action": _residual,
    "euler_lagrange_residual": _residual,
    "stationary_path": (*_run, *_arrays(8), _error),
    "commutator": (_handle, c_double, c_int64, *_arrays(4), c_char_p, c_size_t, Progress, c_void_p, _error),
    "exact_solution": (_handle, _handle, _options, _input, c_void_p, c_void_p, _error),
}


def declare(library: ctypes.CDLL) -> None:
    """Set the types of every function of the table; AttributeError if the library lacks one."""
    for name, argtypes in FUNCTIONS.items():
        function = getattr(library, f"symsde_{name}")
        function.restype = c_int
        function.argtypes = argtypes
