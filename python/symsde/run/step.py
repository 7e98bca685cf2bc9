# SPDX-License-Identifier: BSD-3-Clause
"""One step with given increments, for many points at once; and the increments that drive a run."""

from __future__ import annotations

import ctypes
from typing import Any, Unpack

import numpy as np

from ..model.definition import Model
from ..native import abi, checks
from ..native.checks import address
from ..native.progress import Monitor
from ..schemes import Scheme, as_scheme
from .options import PathOptions, make_options
from .setup import make_setup
from .simulate import Run

_DECIDED = {"q0": "give q", "p0": "give p", "t0": "give t", "steps": "it makes one", "increments": "give dw"}
_DECIDED |= {"paths": "the points are those of q, p and dw", "save_every": "it makes one step"}
_DECIDED |= {"save_at": "it makes one step"}
_DECIDED |= {"progress": "it makes one step"}


@checks.hinted(*PathOptions.__annotations__)
def step(  # noqa: PLR0917 - the step reads like its formula
    model: Model,
    scheme: str | Scheme,
    q: Any,
    p: Any,
    step: float,
    dw: Any = 0.0,
    t: float = 0.0,
    **options: Unpack[PathOptions],
) -> tuple[np.ndarray, np.ndarray]:
    """The state after one step of size `step` from (q, p) with increments dw: two arrays (dof, point).

    q, p: a number, (dof,) or (dof, point); dw: a number, (noise,) or (noise, point); t: time before the step. Options
    are those of `simulate` (correction, general, fixed_point, ...). A point whose step fails is NaN.
    """
    checks.not_given("step", options, _DECIDED)
    alone = type(q) is type(p) is type(dw) is float  # the usual case of a loop in user code
    points = 1 if alone else checks.columns(q=q, p=p, dw=dw)
    setup = make_setup(model, scheme=scheme, q0=q, p0=p, step=step, steps=1, t0=t, paths=points, **options)
    setup.increments = checks.state("dw", dw, model.nnoise, points, kept=False)[np.newaxis]
    run = Run(setup)
    run.fill(progress=False)
    return run.q[1], run.p[1]


def increments_at(model: Model, dw: Any, points: int) -> np.ndarray:
    """Increments as C-contiguous (noise, point) from a number, (noise,) or (noise, point)."""
    if not isinstance(model, Model):
        return np.zeros((0, points))  # making the options refuses other values by name
    return checks.points("dw", dw, model.nnoise, points)


@checks.hinted()
def increments(
    model: Model,
    *,
    step: float,
    steps: int,
    paths: int = 1,
    seed: int = 0,
    refine: int = 0,
    first_path: int = 0,
    first_step: int = 0,
    truncation: tuple[float, float] | None = None,
    scheme: str | Scheme = "midpoint",
) -> np.ndarray:
    """The increments dW that drive a run of the scheme with these options of `simulate`, shape (step, noise, path)."""
    options = make_options(
        model,
        step=step,
        steps=steps,
        paths=paths,
        seed=seed,
        refine=refine,
        first_path=first_path,
        first_step=first_step,
        truncation=truncation,
    )
    return of_options(model, options, as_scheme(scheme))


def of_options(model: Model, options, scheme: Scheme) -> np.ndarray:
    """Increments of a run of the scheme, (step, noise, path)."""
    shape = (options.steps, model.nnoise, options.paths)
    checks.room(shape, "increments (step, noise, path)")
    dw = np.empty(shape)
    with Monitor(progress=False) as monitor:
        chosen = abi.Options.from_buffer_copy(options)
        chosen.progress = monitor.callback
        model.call("increments", scheme._handle.pointer, ctypes.byref(chosen), address(dw), allow=(abi.STOPPED,))
    return dw
