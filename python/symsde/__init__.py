# SPDX-License-Identifier: BSD-3-Clause
"""symsde: symplectic integration of stochastic Hamiltonian systems (Stratonovich).

    dp = -H_q dt - sum_k H_{k,q} o dW_k        dq = H_p dt + sum_k H_{k,p} o dW_k

    import symsde as ss
    model = ss.models.kubo(a=1.0, sigma=0.3)
    run = ss.simulate(model, q0=1.0, p0=0.0, step=0.02, steps=5000, paths=1000, seed=1, save_every=50)
    run.t, run.q, run.p                      # (time,), (time, dof, path), (time, dof, path)

Everything is dimensionless. The path is the last axis of every array. [WHSB] in the documentation is the
paper "Dynamics and variational integrators of stochastic Hamiltonian systems" with its equation numbers.
"""

import importlib
import warnings
from collections.abc import Callable
from types import ModuleType

from . import diagnose, errors, models, observe, schemes, states
from .answers.advice.advise import Advice, advise
from .answers.coupled import LevelSampler, level_sampler
from .answers.expectation.answer import Alternative, Answer, Multilevel
from .answers.expectation.by_value import Answers
from .answers.expectation.expect import expect
from .answers.expectation.mlmc import mlmc
from .answers.mean_square import MeanSquare, mean_square
from .batch.ensemble import ensemble
from .batch.opened import OpenRun, load, open_run
from .cli.selftest import selftest
from .errors import (
    BudgetWarning,
    NotANumberWarning,
    PathsFailedWarning,
    ReferenceWarning,
    RepeatedNoiseWarning,
    SymsdeError,
)
from .model.commutator import Commutator, commutator
from .model.definition import Model
from .model.formulas import FormulaModel, model_from_sympy
from .model.thermostat import thermostat
from .model.traits import Traits
from .native.build import build_info
from .native.callbacks import numba_signature, numba_sincos
from .native.handles import status_text
from .run.fit import Fit, fit
from .run.gradient import Gradient, gradient
from .run.hooks import jax_derivative, jax_function, torch_derivative, torch_function
from .run.moments import Moments, moments
from .run.prepared import PreparedRun, prepare
from .run.report import Report
from .run.simulate import Run, simulate
from .run.step import increments, step
from .run.sweep import Sweep, sweep
from .run.tangent import Lyapunov, Tangent, lyapunov, tangent
from .schemes import Scheme
from .studies.convergence import Convergence, convergence
from .studies.study import WorkPrecision, work_precision

_MOVED = {"scene": "symsde.batch.scene", "stability": "symsde.studies.stability", "study": "symsde.studies.study"}


def __getattr__(name: str) -> ModuleType | Callable:
    """Resolve the old names of modules that have moved, until 0.2, with a warning that gives the new name. C and C++
    call `moments` compute_moments, since moments is a type in their header; the C name works here too.
    """
    if name == "compute_moments":
        return moments
    if name not in _MOVED:
        raise AttributeError(f"module 'symsde' has no attribute {name!r}")
    warnings.warn(f"symsde.{name} is now {_MOVED[name]}: import that", DeprecationWarning, stacklevel=2)
    return importlib.import_module(_MOVED[name])


def __dir__() -> list[str]:
    """The names that users call, without modules and helpers that only this package needs."""
    return sorted(__all__)


__version__ = build_info()["version"]

__all__ = [
    "Advice",
    "Alternative",
    "Answer",
    "Answers",
    "BudgetWarning",
    "Commutator",
    "Convergence",
    "Fit",
    "FormulaModel",
    "Gradient",
    "LevelSampler",
    "Lyapunov",
    "MeanSquare",
    "Model",
    "Moments",
    "Multilevel",
    "NotANumberWarning",
    "OpenRun",
    "PathsFailedWarning",
    "PreparedRun",
    "ReferenceWarning",
    "RepeatedNoiseWarning",
    "Report",
    "Run",
    "Scheme",
    "Sweep",
    "SymsdeError",
    "Tangent",
    "Traits",
    "WorkPrecision",
    "__version__",
    "advise",
    "build_info",
    "commutator",
    "convergence",
    "diagnose",
    "ensemble",
    "errors",
    "expect",
    "fit",
    "gradient",
    "increments",
    "jax_derivative",
    "jax_function",
    "level_sampler",
    "load",
    "lyapunov",
    "mean_square",
    "mlmc",
    "model_from_sympy",
    "models",
    "moments",
    "numba_signature",
    "numba_sincos",
    "observe",
    "open_run",
    "prepare",
    "schemes",
    "selftest",
    "simulate",
    "states",
    "status_text",
    "step",
    "sweep",
    "tangent",
    "thermostat",
    "torch_derivative",
    "torch_function",
    "work_precision",
]
