# SPDX-License-Identifier: BSD-3-Clause
"""The plan of a study's measurements, checked before any long work begins."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypedDict

import numpy as np

from .. import diagnose
from ..errors import IncompatibleError, InvalidArgumentError, MissingOperationError, SymsdeError
from ..model.commutator import commutator
from ..model.definition import Model
from ..native import checks
from ..run import provenance
from ..run.moments import try_out
from ..run.setup import make_setup
from ..run.simulate import simulate
from ..run.states.law import States
from ..schemes import Scheme, as_scheme
from .coupled import halvings

BATCHES = 20  #: number of groups of paths; the scatter between groups gives the interval of an order
LEAST_REPEATS = 5
NEAR = 3  #: halvings from the finest step to a reference of higher order than the scheme that it judges
PLAIN = 5  #: number of halvings to a reference of higher order, for a scheme of order one
FAR = 6  #: number of halvings to a reference that may have the order of the scheme, or is the scheme itself
AREAS = 4  #: number of halvings, in place of FAR, if the reference draws areas: each halving costs four times as much
SMALL = 4  #: largest number of degrees of freedom for which a scheme with dense Newton is an affordable reference
_COMPARED = ("midpoint", "symplectic_euler", "stormer_verlet", "gauss2", "heun")


class StudyOptions(TypedDict, total=False):
    """Options of `simulate` that are common to all runs of a study."""

    t0: float
    seed: int
    correction: str
    truncation: tuple[float, float] | None
    compensated: bool
    threads: int | None


OPTIONS = tuple(StudyOptions.__annotations__)


@dataclass(frozen=True)
class Reference:
    """The reference that paths are compared with: the exact solution, or a scheme with more steps."""

    scheme: str  #: "exact", or the name of a scheme
    steps: int  #: number of the finest steps that the study draws, or of steps of the reference scheme

    def __str__(self) -> str:
        """The reference in words."""
        return "exact solution" if self.scheme == "exact" else f"{self.scheme}, {checks.counted(self.steps, 'step')}"


@dataclass
class Plan:
    """A checked study; every run of it uses the Brownian paths drawn at `draws` steps."""

    model: Model
    schemes: list[Scheme]
    steps: list[int]  #: numbers of steps, ascending
    horizon: float
    paths: int
    q0: Any
    p0: Any
    options: dict[str, Any]  #: options of `simulate`
    references: dict[str, Reference]  #: reference of each scheme, by name
    draws: int  #: number of the finest steps of the Brownian paths
    repeats: int
    interval: float | None  #: relative half width that the intervals of the strong errors should have
    name: str
    invariants: dict[str, Any] = field(default_factory=dict)
    said: dict[str, str] = field(default_factory=dict)  #: facts for the head of tables, given by the caller
    refused: dict[str, str] = field(default_factory=dict)  #: schemes that do not fit or failed, and the reason

    def reference_run(self, scheme: str, steps: int):
        """Compute a reference on the shared paths, without truncation and with the correction that the scheme needs."""
        return self.run(scheme, steps, shared=True, correction="auto", truncation=None)

    def run(self, scheme: str | Scheme, steps: int, *, shared: bool, paths: int | None = None, **more):
        """Integrate to the horizon: on the shared paths, or with increments of its own step."""
        refine = halvings(self.draws, steps) if shared else 0
        options = {"refine": refine, **self.options, **more}
        with checks.unwarned():  # failed paths are counted and shown instead
            return simulate(
                self.model, q0=self.q0, p0=self.p0, scheme=scheme, step=self.horizon / steps, steps=steps,
                save_every=steps, paths=self.paths if paths is None else paths, **options,
            )  # fmt: skip

    def about(self) -> dict[str, str]:
        """What all points have in common, as text for tables."""
        start = {"q0": self.q0, "p0": self.p0}
        shape = self.model.ndof, self.paths
        return {
            "model": self.model.name,
            "parameters": json.dumps(dict(self.model.parameters)),
            **({"hamiltonians": json.dumps(self.model.formula.hamiltonians)} if hasattr(self.model, "formula") else {}),
            **{name: provenance.numbers_of(checks.state(name, x, *shape)) for name, x in start.items()},
            "horizon": repr(self.horizon),
            "draws": f"{self.draws} steps to the horizon",
            "options": json.dumps(self.options),
            **self.said,
        }

    def set_up(self, scheme: str | Scheme, steps: int, paths: int) -> None:
        """Set a run up like `run`, but take no step."""
        options = {**self.options, "q0": self.q0, "p0": self.p0, "paths": paths, "threads": 1}
        simulate(self.model, scheme=scheme, step=self.horizon / steps, steps=0, **options)


def default_schemes(model: Model) -> list[str]:
    """Schemes that a study compares by default; includes splittings of order four if the model consists of drifts
    and kicks.
    """
    if not isinstance(model, Model):
        return [*_COMPARED]
    if not model.traits.has_gradient:
        return ["gauss_dkdkd"]
    return [*_COMPARED, *(("gauss_dkdkd", "chin4a") if model._kicked else ("gauss_dkdkd",) if model._turned else ())]


def check_options(options: Mapping[str, Any]) -> None:
    """Refuse options that the runs do not have."""
    for key in options:
        if key not in OPTIONS:
            raise checks.no_option(key, OPTIONS)


def make_plan(
    model: Model,
    *,
    q0: Any,
    p0: Any,
    schemes: Sequence[str | Scheme] | None,
    steps: Sequence[int],
    horizon: float,
    paths: int,
    reference: str = "auto",
    reference_steps: int | None = None,
    repeats: int = 7,
    interval: float | None = None,
    invariants: dict[str, Any] | None = None,
    name: str | None = None,
    about: Mapping[str, str] | None = None,
    **options: Any,
) -> Plan:
    """Check all arguments; every refusal is a sentence and comes before the first long run."""
    check_options(options)
    counts = check_steps(steps)
    horizon = checks.finite("horizon", horizon)
    if horizon <= 0:
        raise InvalidArgumentError(f"horizon = {horizon:g} is not allowed: give a time above 0")
    chosen = _schemes(default_schemes(model) if schemes is None else schemes)
    repeats = checks.integer("repeats", repeats, (1, 1000))
    if repeats < LEAST_REPEATS:
        raise InvalidArgumentError(
            f"repeats = {repeats} is too few for a median with its spread: give at least {LEAST_REPEATS}"
        )
    named = getattr(model, "name", "model") if name is None else name
    q0, p0 = _drawn(model, q0, p0, paths, options)
    plan = Plan(
        model=model, schemes=chosen, steps=counts, horizon=horizon, paths=check_paths(paths, interval),
        q0=checks.own(q0), p0=checks.own(p0), options={key: checks.fixed(x) for key, x in options.items()},
        references={}, draws=counts[-1], repeats=repeats, interval=interval, name=checks.name_of("name", named),
        invariants=_invariants(invariants), said=checks.own(checks.table("about", {} if about is None else about)),
    )  # fmt: skip
    _try_out(plan)
    _try_invariants(plan)
    for scheme in plan.schemes:
        plan.references[scheme.name] = _reference(plan, scheme, reference, reference_steps)
    plan.draws = max([counts[-1], *(r.steps for r in plan.references.values())])
    return plan


def _drawn(model: Model, q0: Any, p0: Any, paths: int, options: Mapping[str, Any]) -> tuple[Any, Any]:
    """Initial states with arrays (dof, path) in the place of laws: all runs of a study begin at them."""
    if not (isinstance(q0, States) or isinstance(p0, States)):
        return q0, p0
    given = {key: options[key] for key in ("seed", "t0") if key in options}
    setup = make_setup(model, q0=q0, p0=p0, step=1.0, steps=0, paths=check_paths(paths, None), **given)
    return setup.q0, setup.p0


def _invariants(given: object) -> dict[str, Any]:
    """The invariants: functions f(q, p) by name."""
    if given is None:
        return {}
    if not isinstance(given, dict) or not all(callable(function) for function in given.values()):
        raise InvalidArgumentError(
            f"invariants = {checks.shown(given)} is not allowed: give a dict of names and functions f(q, p)"
        )
    return dict(given)


def _try_invariants(plan: Plan) -> None:
    """Refuse invariants that are not finite at the initial states, and invariants that mix paths."""
    start = [checks.state(name, x, plan.model.ndof, plan.paths) for name, x in (("q0", plan.q0), ("p0", plan.p0))]
    q, p = (checks.full(x, max(x.shape[1] for x in start)) for x in start)
    for name, function in plan.invariants.items():
        values = np.asarray(function(q, p))
        if values.shape != q.shape[1:] or values.dtype.kind not in "fiu" or not np.isfinite(values).all():
            raise InvalidArgumentError(
                f"the invariant {name!r} returned {checks.shown(values)} of {values.dtype} for q and p of shape "
                f"{q.shape}, (dof, path), at the initial states: give f(q, p) that returns one finite number a path"
            )
    if plan.invariants:
        try_out(plan.model, plan.invariants, q0=q[:, :1], p0=p[:, :1], step=plan.horizon / plan.steps[-1])


def check_steps(steps: Sequence[int]) -> list[int]:
    """Numbers of steps, ascending; each must be the largest divided by a power of two."""
    if isinstance(steps, str) or not isinstance(steps, Sequence):
        raise InvalidArgumentError(f"steps = {checks.shown(steps)} is not a list: give numbers such as [16, 32, 64]")
    counts = sorted({checks.integer("steps", n, (1, 2**40)) for n in steps})
    if len(counts) < 2:
        raise InvalidArgumentError(f"steps = {checks.shown(steps)} has one level: give at least two, as [16, 32]")
    for n in counts:
        if counts[-1] % n:
            raise InvalidArgumentError(
                f"steps: {n} is not a whole divisor of {counts[-1]}, so that its steps would not end where the finer "
                "ones do: give numbers such as 16, 32, 64"
            )
        if (counts[-1] // n).bit_count() != 1:
            raise InvalidArgumentError(
                f"steps: {n} is not {counts[-1]} divided by a power of two, so the Brownian paths cannot be shared: "
                "give numbers such as 16, 32, 64"
            )
    return counts


def check_paths(paths: int, interval: float | None) -> int:
    """Require enough paths for 20 groups, and for the requested interval."""
    count = checks.integer("paths", paths, (1, 2**47))
    if count < 2 * BATCHES:
        raise InvalidArgumentError(
            f"paths = {count} is too few: intervals come from {BATCHES} groups of paths, give at least {2 * BATCHES}"
        )
    if interval is None:
        return count
    width = checks.finite("interval", interval)
    if width <= 0:
        raise InvalidArgumentError(f"interval = {width:g} is not allowed: give a relative half width such as 0.1")
    # relative error of the root mean square of normal errors: 1.96 sqrt(kurtosis - 1)/(2 sqrt(n)), kurtosis 3
    needed = math.ceil((1.96 / (math.sqrt(2) * width)) ** 2)
    if count < needed:
        raise InvalidArgumentError(
            f"paths = {count} is too few for intervals of {100 * width:g} %: even normal errors need {needed} paths; "
            "give more paths or a wider interval"
        )
    return count


def uses_integrals(scheme: Scheme) -> bool:
    """Whether the scheme uses more than increments: dZ or areas."""
    return scheme.info.uses_dz or scheme.info.uses_areas


def _schemes(schemes: Sequence[str | Scheme]) -> list[Scheme]:
    if isinstance(schemes, str) or not isinstance(schemes, Sequence) or not schemes:
        raise InvalidArgumentError(
            f"schemes = {checks.shown(schemes)} is not a list of schemes: give names such as ['midpoint', 'gauss2']"
        )
    chosen = [as_scheme(scheme) for scheme in schemes]
    names = [scheme.name for scheme in chosen]
    for scheme in chosen:
        if names.count(scheme.name) > 1:
            raise InvalidArgumentError(f"schemes: {scheme.name} is there twice: give each scheme once")
    return chosen


def _try_out(plan: Plan) -> None:
    """Set every run up without taking a step. Schemes that do not fit are left out, with the reason; if none fits, the
    first refusal is raised.
    """
    first = None
    for scheme in list(plan.schemes):
        try:
            _try_scheme(plan, scheme)
        except SymsdeError as error:
            leave_out(plan, scheme, error)
            first = first or error
    if first and not plan.schemes:
        raise first


def _try_scheme(plan: Plan, scheme: Scheme) -> None:
    """Refuse a scheme that does not fit at some step."""
    if scheme.info.law != "Gaussian":
        raise InvalidArgumentError(
            f"scheme {scheme.name} draws two- or three-point increments, which follow no Brownian path, so it has no "
            "strong error: leave it out of the study"
        )
    for n in plan.steps:
        try:
            plan.set_up(scheme, n, plan.paths)
        except SymsdeError as error:
            error.args = (f"{scheme.name} with {n} steps: {error}",)
            raise


def leave_out(plan: Plan, scheme: Scheme, error: SymsdeError) -> None:
    """Go on without a scheme, and keep the reason."""
    plan.schemes.remove(scheme)
    plan.refused[scheme.name] = str(error)


def _reference(plan: Plan, scheme: Scheme, wanted: str, steps: int | None) -> Reference:
    """The reference of a scheme."""
    finest = plan.steps[-1]
    wanted = checks.name_of("reference", wanted)
    if wanted == "exact" and not _has_exact(plan):
        raise InvalidArgumentError(f"reference = 'exact': {plan.model.name} has no exact solution, give 'auto'")
    if wanted == "exact" or (wanted == "auto" and _has_exact(plan)):
        if steps is not None and wanted == "exact":
            raise InvalidArgumentError("reference_steps is for a scheme: the exact solution needs none, leave it out")
        return Reference("exact", finest)
    name = _better(plan, scheme) if wanted == "auto" else as_scheme(wanted).name
    extra = _halvings_of(scheme, as_scheme(name))
    count = finest << extra if steps is None else checks.integer("reference_steps", steps, (1, 2**40))
    if count <= finest or count % finest or (count // finest).bit_count() != 1:
        raise InvalidArgumentError(
            f"reference_steps = {count} is not finer than the finest steps = {finest} by a power of two: give "
            f"{2 * finest}, {4 * finest}, ..."
        )
    return Reference(name, count)


def _halvings_of(scheme: Scheme, reference: Scheme) -> int:
    """Halvings from the finest step to a reference; more if its order may be equal to that of the scheme."""
    if not uses_integrals(reference):
        return PLAIN
    if not uses_integrals(scheme):
        return NEAR
    return AREAS if reference.info.uses_areas else FAR


def _has_exact(plan: Plan) -> bool:
    try:
        diagnose.exact(plan.run("midpoint", 1, shared=False, correction="auto", truncation=None))
    except (MissingOperationError, IncompatibleError):  # IncompatibleError: of damped models
        return False
    return True


def _better(plan: Plan, scheme: Scheme) -> str:
    """The best affordable reference on the Brownian paths of a scheme."""
    model = plan.model
    commutative = model._noise_commutes
    if model.ndof <= SMALL and model._kicked:
        return "gauss_dkdkd_strong2" if scheme.name == "chin4a_strong2" else "chin4a_strong2"
    if model.damping or model._forces or model._turned:
        return _better_open(model, commutative)
    if model.ndof > SMALL:
        shifts = model.traits.additive and model.traits.position_noise and model.traits.identity_mass
        return "verlet_dz" if shifts else "stormer_verlet" if model.traits.separable else "midpoint"
    if not model.nnoise or commutator(model, t=plan.options.get("t0", 0.0)).flows_commute:
        return "gauss4"  # strong order 4 for such models, by increments alone
    if commutative:
        return "gauss2_strong32"
    return "gauss2_strong32_areas"


def _better_open(model: Model, commutative: bool) -> str:
    """The best affordable reference for damped models, which schemes with brackets of H and with shifts refuse, and
    for models with forces, which areas refuse, too, and kicks where forces depend on p; or of kicks by functions of the
    actions, whose drifts hold all that is stiff.
    """
    if model._turned and model.traits.phased and not model.damping:
        return "gauss_dkdkd_strong2"
    if model._kicked or model._turned:
        return "gauss_dkdkd"
    if model.has_friction or model.ndof > SMALL:
        return "midpoint"
    if commutative or model._forces or model._varying or len(set(model.damping)) > 1 or commutator(model).commutative:
        return "gauss2"
    return "midpoint_areas"
