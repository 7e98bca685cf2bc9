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

from . import diagnose, errors, models, observe, schemes
from ._callbacks import numba_signature, numba_sincos
from ._handles import status_text
from ._selftest import selftest
from ._setup import build_info
from .advise.advise import Advice, advise
from .batch.ensemble import ensemble
from .batch.opened import OpenRun, open_run
from .commutator import Commutator, commutator
from .convergence import Convergence, convergence
from .errors import BudgetWarning, NotANumberWarning, PathsFailedWarning, ReferenceWarning, SymsdeError
from .expect.answer import Alternative, Answer
from .expect.expect import expect
from .formulas import FormulaModel, model_from_sympy
from .mean_square import MeanSquare, mean_square
from .mlmc.answer import Multilevel
from .mlmc.mlmc import mlmc
from .mlmc.sampler import LevelSampler, level_sampler
from .model import Model, Traits
from .moments import Moments, moments
from .prepared import PreparedRun, prepare
from .report import Report
from .schemes import Scheme
from .simulate import Run, simulate
from .step import increments, step
from .study import WorkPrecision, work_precision

__version__ = build_info()["version"]

__all__ = [
    "Advice",
    "Alternative",
    "Answer",
    "BudgetWarning",
    "Commutator",
    "Convergence",
    "FormulaModel",
    "LevelSampler",
    "MeanSquare",
    "Model",
    "Moments",
    "Multilevel",
    "NotANumberWarning",
    "OpenRun",
    "PathsFailedWarning",
    "PreparedRun",
    "ReferenceWarning",
    "Report",
    "Run",
    "Scheme",
    "SymsdeError",
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
    "increments",
    "level_sampler",
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
    "status_text",
    "step",
    "work_precision",
]
