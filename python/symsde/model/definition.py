# SPDX-License-Identifier: BSD-3-Clause
"""Models: Hamiltonians H_0 = H, H_1 .. H_m with their traits."""

from __future__ import annotations

import ctypes
import functools
import types
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from ..errors import IncompatibleError, SymsdeError, WrongShapeError, WrongTypeError
from ..native import abi, callbacks, checks, handles
from ..native.signals import held
from ..show import html
from ..show.values import numbered
from . import built_in, user_handles
from .forces import given_forces
from .named import require_names
from .open_system import OpenSystem, copied, damped_again, forced_again
from .split import KICKS, Split, handle_with_split, kicks_of, second_derivatives
from .traits import FLAGS, Traits, arguments, declared, of_library

#: built-in model -> texts of H, H_1 .., as in the docstring of its function in `symsde.models`
HAMILTONIANS: dict[str, Sequence[str]] = {}


class Model(OpenSystem):
    """A stochastic Hamiltonian system of your own (Stratonovich). All quantities are dimensionless.

        dp = -H_q dt - sum_k H_{k,q} o dW_k        dq = H_p dt + sum_k H_{k,p} o dW_k     [WHSB] (3)-(4)

    Each function evaluates the weighted sum S = sum_j w[j] H_j of the Hamiltonians H_0 = H, H_1 .. H_m for many lanes
    at once. A lane is a path; compute each lane independently of the others.

    - ``gradient(t, w, q, p) -> (S_q, S_p)`` is required, unless ``drift`` and ``kick`` are given.
    - ``value(t, w, q, p) -> S`` returns the shape (lane,).
    - ``hessian(t, w, q, p) -> (S_qq, S_qp, S_pp)`` returns shapes (dof, dof, lane). ``S_qp[j, i]`` is the derivative by
      q_i and p_j.
    - ``hessian_vector(t, w, q, p, vq, vp) -> (S_qq vq + S_qp vp, S_pq vq + S_pp vp)``
    - ``gradient_hessian(t, w, q, p) -> (S_q, S_p, S_qq, S_qp, S_pp)`` computes both at one point, for models in which
      they share work. It also replaces a ``hessian`` that is not given.
    - ``third_derivative(t, w, q, p, aq, ap, bq, bp) -> (uq, up)`` is the gradient of a^T S'' b for two vectors a and b.
      With it the nested brackets of ``gauss2_strong32`` and related schemes are exact. Without it they are approximated
      by differences of gradients.
    - ``chain_rows`` must be compiled (`symsde_chain_rows` in symsde.h). It gives rows of the force and of the
      tridiagonal stiffness of a chain H = p.p/2 + U(q) with noise in position or additive noise. With it ``midpoint``
      is as fast on your chain as on the built-in one.

    w has the shape (nnoise + 1, lane); q, p, vq, vp, aq .. bp and gradients have the shape (dof, lane). A lane fails if
    its result is NaN. All numbers are float64, and results of other real types are converted. A gradient computed in
    float32 keeps its error of 1e-7. Newton's iteration cannot get below this error, and neither can differences of such
    a gradient.

    The functions are Python functions of NumPy arrays; runs then use one thread unless you ask for more. Or they are
    compiled functions with the C signature in symsde.h: a ``numba.cfunc`` (see `numba_signature`), a ctypes function
    pointer, or a ``scipy.LowLevelCallable``. Compiled functions write all their outputs. With ``accepts_null`` the
    pointers of unwanted outputs are NULL, and the function need not compute these.

    ``flows`` maps names of schemes to compiled functions with the signature ``symsde_flow``, which compute whole steps,
    several in one call. ``"symplectic_euler, corrected"`` and ``"symplectic_euler_adjoint, corrected"`` are steps with
    the increments form of the correction, the others are without correction. ``"midpoint, damped"`` and the like are
    steps of momenta damped by one rate, with gamma h as ``functionals[5][0]``. A run with such a scheme calls nothing
    else. Before the run these steps are compared with the library's own, and refused if they differ.

    ``drift(t, tau, q, p) -> (q, p)`` and ``kick(t, w, q, p) -> (q, p)`` are the exact flows of two parts of
    H = D + K_0: that of D from t to t + tau, and that of sum_j w[j] K_j over one unit of time, K_k = H_k being those at
    t, all of which commute, {K_i, K_j} = 0. ``gauss_dkdkd`` (strong order 3/2) and ``verlet_dkd_weak2`` are made of
    them, whatever D and the K_j are. They are probed, and compared with the gradient if there is one. Without a
    gradient, all that takes derivatives of H is refused, and traits are not declared.

    ``any_lanes`` says that the results of a lane have the same bits for any number of lanes. The functions are then
    called with the paths alone where lanes that fill a vector would be half of all lanes or more (whole steps: with a
    single path). This makes one path up to eight times as fast. numba functions are checked automatically (no fastmath,
    no SVML); for others, declare it.

    ``split`` is a matrix S of second derivatives, (2 dof, 2 dof), by q and then by p. It says H = z.S z/2 + V(q) with
    z = (q, p), and any coupling of q and p. Then ``gauss_dkdkd``, ``verlet_kdk``, ``chin4a`` and their _strong2 take
    the quadratic part exactly, by the matrix exp(h J S), and kick by V and noises in position. H_p is compared with S;
    S_qq is a choice, since V is what remains. With ``kicks="actions"`` what remains of H and every H_k are functions of
    the actions (q_k^2 + p_k^2)/2 instead, as in lattices of nonlinear Schroedinger equations with noise of phases:
    ``gauss_dkdkd`` then turns every plane (q_k, p_k) by an angle. ``kicks="phases"`` says that every H_k is linear in
    the actions, too: ``gauss_dkdkd_strong2`` then has strong order 2, by brackets that are bonds of the quadratic part.

    The other arguments declare traits, see `Traits`; silent holds the numbers k of noises with H_k = 0, and touches a
    list of numbers i = 1 .. ndof for each noise, as in [[1], [2], [2, 3]]. With it schemes form nothing over pairs of
    noises that touch different degrees of freedom; with a mass that is not one it needs diagonal_mass. Runs probe the
    traits and refuse a false one by name (`FalseTraitError`). Where no trait is declared, runs say which ones hold at
    the probed points and what they would save. ``traits="probed"`` declares these: separable, quadratic, the mass,
    additive, position_noise and bands, as differences of gradients at three points around q = 1 .. 2, p = 0.5 .. 1.5 do
    not refute them. A probe can refute a trait and proves none: H = p^2/2 + |q - 5| q is quadratic by it. ``derived``
    says that a program derived the functions from formulas and that nothing they read ever changes. Then they are not
    probed before every run, but once for each power of two that the size of state and time reaches (flows: also that of
    the step). Without a Hessian, it is approximated by differences of gradients. An exception in a Python function
    stops the run and is raised again.

    ``force`` and ``noise_force`` are forces that act beside the Hamiltonians, functions of (q, p, t). See `forced`,
    which does so for any model.

    ``damping`` damps the momenta, dp_i = .. - gamma_i p_i dt: one rate [1/time], or one for each degree of freedom; or
    it is friction on velocities, by a matrix, or a function of (q, t); negative rates, which feed energy in, need
    ``allow_gain``. See `damped`, which does so for any model.
    """

    #: (q0, p0, t0) -> refuses an initial state of all paths, (dof, 1), from which no run can begin. Set by models of
    #: formulas
    check_start: Callable[[np.ndarray, np.ndarray, float], None] | None = None
    _split: Split | None = None  #: second derivatives of a quadratic part of H, as declared to the library
    _kicks: str = KICKS[0]  #: what kicks beside a quadratic part depend on
    _coordinates: tuple[str, ...] = ()  #: the model's own names of coordinates and momenta, if it has any
    _hamiltonians: Sequence[str] = ()  #: texts "H = ..", "H_1 = .." if they are known

    @checks.hinted()
    def __init__(
        self,
        *,
        ndof: int,
        nnoise: int,
        gradient: Any = None,
        value: Any = None,
        hessian: Any = None,
        hessian_vector: Any = None,
        gradient_hessian: Any = None,
        third_derivative: Any = None,
        chain_rows: Any = None,
        drift: Any = None,
        kick: Any = None,
        separable: bool = False,
        additive: bool = False,
        position_noise: bool = False,
        quadratic: bool = False,
        identity_mass: bool = False,
        constant_mass: bool = False,
        diagonal_mass: bool = False,
        bandwidth: int | None = None,
        max_frequency: float = 0.0,
        noise_lipschitz: float = 0.0,
        rotation: Any = None,
        silent: Any = (),
        touches: Any = None,
        traits: str | None = None,
        split: Any = None,
        kicks: str = KICKS[0],
        accepts_null: bool = False,
        flows: Mapping[str, Any] | None = None,
        any_lanes: bool | None = None,
        derived: bool = False,
        damping: Any = None,
        allow_gain: bool = False,
        force: Any = None,
        force_derivative: Any = None,
        noise_force: Any = None,
        noise_force_derivative: Any = None,
        position_force: bool = False,
        position_noise_force: bool = False,
        force_bandwidth: int | None = None,
        name: str = "user",
    ):
        """Make the model; see the class for the arguments."""
        told = declared(
            ndof=ndof, nnoise=nnoise, bandwidth=bandwidth, max_frequency=max_frequency,
            noise_lipschitz=noise_lipschitz, rotation=rotation, silent=silent, touches=touches,
            separable=separable, additive=additive, position_noise=position_noise, quadratic=quadratic,
            identity_mass=identity_mass, constant_mass=constant_mass, diagonal_mass=diagonal_mass,
        )  # fmt: skip
        parted = second_derivatives(split, told.ndof)
        kicks = kicks_of(kicks, parted)
        functions = {
            "gradient": gradient,
            "value": value,
            "hessian": hessian,
            "hessian_vector": hessian_vector,
            "gradient_hessian": gradient_hessian,
            "third_derivative": third_derivative,
            "chain_rows": chain_rows,
            "drift": drift,
            "kick": kick,
        }
        kinds = user_handles.kinds_of(functions)
        self.in_python = "Python" in kinds  #: whether some callback is a Python function
        flows = user_handles.checked_flows(flows, drift is not None)
        kinds |= {"compiled"} if flows else set()
        if any_lanes is None:
            any_lanes = callbacks.takes_any_lanes([*functions.values(), *flows.values()])
        any_lanes = checks.flag("any_lanes", any_lanes) and "Python" not in kinds
        derived, gains = checks.flag("derived", derived), checks.flag("allow_gain", allow_gain)
        given = {**functions, **arguments(told), "split": parted, "kicks": kicks}
        given |= {"derived": derived, "name": name, "traits": traits}
        self._remade = None if "compiled" in kinds else (Model._of_user, (given,))
        accepts_null = checks.flag("accepts_null", accepts_null) or "compiled" not in kinds
        make = functools.partial(user_handles.of_user, checks.name_of("name", name), told, functions, accepts_null)
        if flows or any_lanes:
            make = functools.partial(user_handles.with_flows, make, flows, any_lanes)
        if derived:
            make = functools.partial(user_handles.derived, make)
        if parted is not None:
            make = functools.partial(handle_with_split, make, parted, kicks)
            self._split, self._kicks = parted, kicks
        if traits is not None:
            checks.choice("traits", traits, ("probed",))
            make = functools.partial(user_handles.with_probed_traits, make, told.ndof)
        self._adopt(make, name, {})
        forces = given_forces(
            force, force_derivative, noise_force, noise_force_derivative, position_force, position_noise_force,
            force_bandwidth,
        )  # fmt: skip
        if forces:
            self._force(copied(self), forces)
        if damping is not None:
            self._damp(copied(self), damping, gains)

    @classmethod
    def builtin(cls, name: str, parameters: Mapping[str, Any]) -> Model:
        """A built-in model by name; `symsde.models` has one function for each. Where a parameter is an array (path,)
        it is made from its formulas."""
        if built_in.go_by_path(checks.table("parameters", parameters)):
            return built_in.of_formulas(name, parameters)
        known = {key: checks.number(key, value) for key, value in checks.table("parameters", parameters).items()}
        self = cls.__new__(cls)
        self.in_python = False
        self._remade = (Model.builtin, (name, known))
        self._adopt(functools.partial(user_handles.builtin, checks.name_of("name", name), known), name, known)
        self._hamiltonians = HAMILTONIANS.get(name, ())
        return self

    @classmethod
    def _of_user(cls, given: dict[str, Any]) -> Model:
        """A model from the arguments that another one was made with."""
        return cls(**given)

    def _adopt(self, make: Callable[[], handles.Handle], name: str, parameters: dict[str, float]) -> None:
        """Create the model's handles by `make` when they are needed."""
        self._handles = handles.Pool(make)
        self.name: str = name
        self._parameters: dict[str, float] = parameters
        self.traits = self._read_traits()

    def with_parameters(self, **values: Any) -> Model:
        """The same model with other values of some parameters: numbers, or arrays (path,) with one for each path.

        For built-in models and models from formulas. With an array a built-in model is made from its formulas, and has
        the same paths to rounding. In a heat bath with gamma the noise follows the masses (`symsde.thermostat`).
        """
        if self._bathed:
            return self._bathed_again(lambda bare: bare.with_parameters(**values))
        if self._remade is None or self._remade[0] != Model.builtin:
            raise IncompatibleError(
                f"parameters of model {self.name!r} cannot be changed: make it again, from a model with other values"
            )
        for name in values:
            checks.choice("parameter", name, list(self._parameters))
        self._require_own_friction()
        made = Model.builtin(self.name, {**self._parameters, **values})
        if self._forces:
            made = made._with_forces(self._forces)
        return made.damped(self.damping, allow_gain=True) if self.damping else made

    def __reduce__(self) -> tuple:
        """Pickle as the arguments: another process makes the model again, if it finds the functions by name."""
        if self._closed is not None:
            if self._varying:
                require_names(self.name, [self._varying.function])
            return damped_again, (self._closed, self._damping, self._bath, self._fluctuating, self._bathed)
        if self._unforced is not None and self._remade is self._unforced._remade:  # not those of formulas
            require_names(self.name, self._forces.functions().values())
            return forced_again, (self._unforced, self._forces, self._bath, self._fluctuating, self._bathed)
        if self._remade is None:
            raise WrongTypeError(
                f"model {self.name!r} holds compiled functions, whose addresses mean nothing in another process: "
                "make the model where it is used"
            )
        if isinstance(given := self._remade[1][0], dict):
            require_names(self.name, given.values())
        return self._remade

    def _read_traits(self) -> Traits:
        given = handles.new(abi.Traits, "traits")
        self.call("model_traits", ctypes.byref(given))
        return of_library(given, self._split, self._kicks)

    def __copy__(self) -> Model:
        """A model never changes: a copy is the model itself."""
        return self

    def __deepcopy__(self, _memo: dict) -> Model:
        """A model never changes: a copy is the model itself."""
        return self

    @property
    def parameters(self) -> Mapping[str, Any]:
        """Values of the parameters, to be read: numbers, arrays (path,), or tuples with a number for each site. A model
        never changes."""
        return types.MappingProxyType(self._parameters)

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of the coordinates and then of the momenta in results and files: q_1 .., p_1 .. or the model's own."""
        return self._coordinates or numbered(self.traits.ndof)

    @property
    def paths(self) -> int:
        """The number of paths for which there are values of parameters, one for each path; 0 = any number."""
        return max((x.size for x in self._parameters.values() if isinstance(x, np.ndarray) and x.size > 1), default=0)

    def _part(self, where: slice | np.ndarray) -> Model:
        """The model of some paths of a run, by their places in it; the same where no parameter goes by path."""
        return self._bathed_again(lambda bare: bare._part(where)) if self.paths and self._bathed else self

    ndof = property(lambda self: self.traits.ndof, doc="Degrees of freedom.")
    nnoise = property(lambda self: self.traits.nnoise, doc="Noises.")

    def __repr__(self) -> str:
        """Name and parameters of the model."""
        parameters = ", ".join(f"{key}={html.told(value)}" for key, value in self.parameters.items())
        text = parameters or f"ndof={self.ndof}, nnoise={self.nnoise}"
        if self.has_friction:
            text += f", friction ({self.ndof}, {self.ndof})"
        if self._varying:
            text += f", damping={', '.join(self._varying.told())}"
        rates = () if self.has_friction or self._varying else self.damping
        for key, numbers in (("damping", rates), ("bath at beta", self._bath)):
            if numbers:
                text += f", {key}=" + (f"{numbers[0]:g}" if len(set(numbers)) == 1 else str(list(numbers)))
        return f"{self.name}({text}{', forced' if self._forces else ''})"

    def _repr_html_(self) -> str:
        """Hamiltonians, parameters and traits for notebooks."""
        return html.model(self, self._hamiltonians, [flag for flag in FLAGS if getattr(self.traits, flag)])

    def call(self, name: str, *arguments, allow: tuple[int, ...] = ()) -> int:
        """Call the library with a handle of this model and the arguments; exceptions of callbacks are raised."""
        if self.in_python:
            with held():
                return self._call(name, arguments, allow)
        return self._call(name, arguments, allow)

    def _call(self, name: str, arguments: tuple, allow: tuple[int, ...]) -> int:
        handle, refusal = self._handles.take(), None
        try:
            try:
                status = handles.call(name, handle.pointer, *arguments, allow=allow)
            except SymsdeError as error:
                refusal = error
            handle.failures.raise_stored()
        finally:
            self._handles.give(handle)
        if refusal is not None:
            raise refusal
        return status

    def value(self, q, p, w=None, t: float = 0.0) -> np.ndarray:
        """sum_j w[j] H_j at many points, shape (path,). Without w it is H.

        q, p: a number, (dof,) or (dof, path); w: (nnoise + 1,) or (nnoise + 1, path).
        """
        q, p, w, npath = self._points(q, p, w)
        out = np.empty(npath)
        self._evaluate("value", npath, t, w, q, p, out)
        return out

    def gradient(self, q, p, w=None, t: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives of sum_j w[j] H_j by q and by p: two arrays (dof, path)."""
        q, p, w, npath = self._points(q, p, w)
        out = np.empty((self.ndof, npath)), np.empty((self.ndof, npath))
        self._evaluate("gradient", npath, t, w, q, p, *out)
        return out

    def hessian(self, q, p, w=None, t: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Second derivatives qq, qp, pp of sum_j w[j] H_j: three arrays (dof, dof, path).

        qp[j, i] is the derivative by q_i and p_j.
        """
        q, p, w, npath = self._points(q, p, w)
        checks.room((3, self.ndof, self.ndof, npath), "Hessians")
        out = tuple(np.empty((self.ndof, self.ndof, npath)) for _ in range(3))
        self._evaluate("hessian", npath, t, w, q, p, *out)
        return out

    def probe(self, q0=1.0, p0=0.5, t: float = 0.0) -> None:
        """Check declared traits and Hessians at three points around (q0, p0). FalseTraitError names a false one."""
        q, p = checks.state("q0", q0, self.ndof, 1), checks.state("p0", p0, self.ndof, 1)
        address = checks.address
        self.call("model_probe", checks.number("t", t), address(q), address(p))

    def _evaluate(self, operation, npath, t, w, *arrays) -> None:
        addresses = [checks.address(a) for a in (w, *arrays)]
        self.call(f"model_{operation}", npath, checks.number("t", t), *addresses)

    def _points(self, q, p, w):
        """Points and weights with one column for each path."""
        npath = checks.columns(q=q, p=p)
        q, p = (checks.points(name, x, self.ndof, npath) for name, x in (("q", q), ("p", p)))
        if w is None:
            w = np.zeros(self.nnoise + 1)
            w[0] = 1
        w = checks.real_array("w", w)
        w = w[:, np.newaxis] if w.ndim == 1 else w
        if w.ndim != 2 or w.shape[0] != self.nnoise + 1 or w.shape[1] not in (1, npath):
            raise WrongShapeError(
                f"w has shape {w.shape}: give ({self.nnoise + 1},) or ({self.nnoise + 1}, {npath}), "
                "one weight for each Hamiltonian H_0 .. H_m"
            )
        return q, p, checks.full(w, npath), npath


def fits_files(name: str) -> bool:
    """Whether a name is valid for columns and variables of files."""
    return bool(name) and name.isprintable() and not set("/#") & set(name) and name == name.strip()


def require_unforced(model: Model, what: str) -> None:
    """Refuse a model with forces for results that only systems without them have."""
    if model._forces:
        raise IncompatibleError(
            f"forces act on model {model.name}, and {what} of systems without them alone: use the model without forces"
        )


def require_closed(model: Model, what: str) -> None:
    """Refuse a damped model, and one with forces, for results that only closed systems have."""
    require_unforced(model, what)
    if model.damping:
        raise IncompatibleError(
            f"model {model.name} is damped, and {what} of closed systems alone: use the model without damping"
        )


def require_model(model: object) -> None:
    """Refuse an object that is no model."""
    if not isinstance(model, Model):
        raise WrongTypeError(
            f"model = {checks.shown(model)} is not a model: give symsde.models.<name>(...) or symsde.Model(...)"
        )
