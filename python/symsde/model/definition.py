# SPDX-License-Identifier: BSD-3-Clause
"""Models: Hamiltonians H_0 = H, H_1 .. H_m with their traits."""

from __future__ import annotations

import ctypes
import functools
import itertools
import types
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from ..errors import IncompatibleError, InvalidArgumentError, SymsdeError, WrongShapeError, WrongTypeError
from ..native import abi, checks, handles
from ..native import callbacks as _callbacks
from ..native.signals import held
from ..show import html
from . import built_in
from .forces import Forces, handle_with
from .named import require_names
from .rates import Rates, rates_of
from .rates import handle_with as handle_with_rates

#: traits that are true or false; each names a property of the Hamiltonians
FLAGS = ("separable", "additive", "position_noise", "quadratic", "identity_mass", "constant_mass", "diagonal_mass")
#: one rate [1/time] for each degree of freedom, rows of a matrix of friction [mass/time], or functions
Damping = tuple[float, ...] | tuple[tuple[float, ...], ...] | Rates
#: built-in model -> texts of H, H_1 .., as in the docstring of its function in `symsde.models`
HAMILTONIANS: dict[str, Sequence[str]] = {}
_KNOWN = ("has_value", "has_hessian", "has_hessian_vector")


@dataclass(frozen=True)
class Traits:
    """Properties that a model declares of its Hamiltonians H_0 = H, H_1 .. H_m; they decide what is skipped."""

    ndof: int  #: degrees of freedom
    nnoise: int  #: number m of noises
    separable: bool  #: every H_j = T_j(p) + U_j(q)
    additive: bool  #: every H_k, k >= 1, is linear in (q, p)
    position_noise: bool  #: every H_k, k >= 1, depends on q alone
    quadratic: bool  #: every H_j is a polynomial of degree two at most
    identity_mass: bool  #: H = p.p/2 + U(q)
    constant_mass: bool  #: H = p.M^-1 p/2 + U(q) with a constant matrix M
    diagonal_mass: bool  #: this matrix is diagonal
    bandwidth: int | None  #: bandwidth of every block of the Hessian; None = dense
    max_frequency: float  #: bound of the frequencies of H; 0 = not declared
    noise_lipschitz: float  #: Lipschitz constant of the noise; 0 = not declared
    #: frequencies omega_i of the stiff linear part, H = p.p/2 + sum_i omega_i^2 q_i^2/2 + V(q); None = not declared
    rotation: tuple[float, ...] | None
    silent: tuple[int, ...]  #: noises k whose H_k is zero: nothing is drawn for them
    #: for each noise the degrees of freedom i = 1 .. ndof of which q_i or p_i occur in H_k; None = not declared
    touches: tuple[tuple[int, ...], ...] | None
    has_value: bool  #: the Hamiltonians can be evaluated
    has_hessian: bool  #: Hessians are analytic
    has_hessian_vector: bool  #: products of Hessian and vector are analytic

    @property
    def kicked(self) -> bool:
        """Whether the noise depends on position and the mass is constant, as schemes of drifts and kicks need."""
        return self.position_noise and (self.identity_mass or self.constant_mass)


class ModelHandle(handles.Handle):
    """A handle of a model, and the exceptions of the callbacks of its calls."""

    def __init__(self, pointer: ctypes.c_void_p, keep_alive: object, failures: _callbacks.Failures):
        """Own the handle `pointer`."""
        super().__init__("model", pointer, keep_alive)
        self.failures = failures


class Model:
    """A stochastic Hamiltonian system of your own (Stratonovich). All quantities are dimensionless.

        dp = -H_q dt - sum_k H_{k,q} o dW_k        dq = H_p dt + sum_k H_{k,p} o dW_k     [WHSB] (3)-(4)

    Each function evaluates the weighted sum S = sum_j w[j] H_j of the Hamiltonians H_0 = H, H_1 .. H_m for many lanes
    at once. A lane is a path; compute each lane independently of the others.

    - ``gradient(t, w, q, p) -> (S_q, S_p)`` is required.
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

    ``any_lanes`` says that the results of a lane have the same bits for any number of lanes. The functions are then
    called with the paths alone, without lanes that fill a vector (whole steps: with a single path). This makes one path
    eight times as fast. numba functions are checked automatically (no fastmath, no SVML); for others, declare it.

    The other arguments declare traits, see `Traits`; silent holds the numbers k of noises with H_k = 0, and touches a
    list of numbers i = 1 .. ndof for each noise, as in [[1], [2], [2, 3]]. With it schemes form nothing over pairs of
    noises that touch different degrees of freedom; with a mass that is not one it needs diagonal_mass. Runs probe the
    traits and refuse a false one by name (`FalseTraitError`). ``derived`` says that a program derived the functions
    from formulas and that nothing they read ever changes. Then they are not probed before every run, but once for each
    power of two that the size of state and time reaches (flows: also that of the step). Without a Hessian, it is
    approximated by differences of gradients. An exception in a Python function stops the run and is raised again.

    ``force`` and ``noise_force`` are forces that act beside the Hamiltonians, functions of (q, p, t). See `forced`,
    which does so for any model.

    ``damping`` damps the momenta, dp_i = .. - gamma_i p_i dt: one rate [1/time], or one for each degree of freedom; or
    it is friction on velocities, by a matrix, or a function of (q, t). See `damped`, which does so for any model.
    """

    #: (q0, p0, t0) -> refuses an initial state of all paths, (dof, 1), from which no run can begin. Set by models of
    #: formulas
    check_start: Callable[[np.ndarray, np.ndarray, float], None] | None = None
    _damping: Damping = ()  #: rates of the momenta, or rows of a matrix of friction; empty for a closed system
    _forces: Forces = Forces()  #: what acts beside the Hamiltonians
    _fluctuating: bool = False  #: whether thermostat found its friction from its noises, for these values alone
    _derives_bath: bool = False  #: whether that friction is a formula, which holds for other values, too
    _unforced: Model | None = None  #: for a model with forces the same model without them
    _closed: Model | None = None  #: for a damped model the same model without damping
    _bath: tuple[float, ...] = ()  #: beta of a heat bath, one or one for each degree of freedom; empty without one
    _coordinates: tuple[str, ...] = ()  #: the model's own names of coordinates and momenta, if it has any
    _hamiltonians: Sequence[str] = ()  #: texts "H = ..", "H_1 = .." if they are known

    @checks.hinted()
    def __init__(
        self,
        *,
        ndof: int,
        nnoise: int,
        gradient: Any,
        value: Any = None,
        hessian: Any = None,
        hessian_vector: Any = None,
        gradient_hessian: Any = None,
        third_derivative: Any = None,
        chain_rows: Any = None,
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
        accepts_null: bool = False,
        flows: Mapping[str, Any] | None = None,
        any_lanes: bool | None = None,
        derived: bool = False,
        damping: Any = None,
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
        declared = {
            "separable": separable,
            "additive": additive,
            "position_noise": position_noise,
            "quadratic": quadratic,
            "identity_mass": identity_mass,
            "constant_mass": constant_mass,
            "diagonal_mass": diagonal_mass,
        }
        traits = handles.new(abi.Traits, "traits")
        traits.ndof = checks.integer("ndof", ndof, checks.INT32)
        traits.nnoise = checks.integer("nnoise", nnoise, checks.INT32)
        traits.bandwidth = -1 if bandwidth is None else checks.integer("bandwidth", bandwidth, checks.INT32)
        traits.max_frequency = checks.number("max_frequency", max_frequency)
        traits.noise_lipschitz = checks.number("noise_lipschitz", noise_lipschitz)
        frequencies = _frequencies(rotation, traits.ndof)  # referenced until the library has copied them
        traits.rotation = frequencies
        flags = _silent(silent, traits.nnoise)
        traits.silent = flags
        supports = _supports(touches, traits.nnoise, traits.ndof)
        traits.touches_from, traits.touches = supports
        for trait, given in declared.items():
            setattr(traits, trait, checks.flag(trait, given))
        functions = {
            "gradient": gradient,
            "value": value,
            "hessian": hessian,
            "hessian_vector": hessian_vector,
            "gradient_hessian": gradient_hessian,
            "third_derivative": third_derivative,
            "chain_rows": chain_rows,
        }
        kinds = _kinds(functions)
        self.in_python = "Python" in kinds  #: whether some callback is a Python function
        flows = _checked_flows(flows)
        kinds |= {"compiled"} if flows else set()
        if any_lanes is None:
            any_lanes = _callbacks.takes_any_lanes([*functions.values(), *flows.values()])
        any_lanes = checks.flag("any_lanes", any_lanes) and "Python" not in kinds
        derived = checks.flag("derived", derived)
        given = {**functions, **_public(traits), "derived": derived, "name": name}
        self._remade = None if "compiled" in kinds else (Model._of_user, (given,))
        accepts_null = checks.flag("accepts_null", accepts_null) or "compiled" not in kinds
        make = functools.partial(_user_handle, checks.name_of("name", name), traits, functions, accepts_null)
        if flows or any_lanes:
            make = functools.partial(_with_flows, make, flows, any_lanes)
        if derived:
            make = functools.partial(_derived, make)
        self._adopt(make, name, {})
        forces = _forces(
            force, force_derivative, noise_force, noise_force_derivative, position_force, position_noise_force,
            force_bandwidth,
        )  # fmt: skip
        if forces:
            self._force(_copied(self), forces)
        if damping is not None:
            self._damp(_copied(self), damping, allow_gain=False)

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
        self._adopt(functools.partial(_builtin_handle, checks.name_of("name", name), known), name, known)
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
        self.traits: Traits = self._read_traits()

    def with_parameters(self, **values: Any) -> Model:
        """The same model with other values of some parameters: numbers, or arrays (path,) with one for each path.

        For built-in models and models from formulas. With an array a built-in model is made from its formulas, and has
        the same paths to rounding.
        """
        if self._remade is None or self._remade[0] != Model.builtin:
            raise IncompatibleError(
                f"parameters of model {self.name!r} cannot be changed: make it again, from a model with other values"
            )
        for name in values:
            checks.choice("the parameter", name, list(self._parameters))
        self._require_own_friction()
        made = Model.builtin(self.name, {**self._parameters, **values})
        if self._forces:
            made = made._with_forces(self._forces)
        return made.damped(self.damping, allow_gain=True) if self.damping else made

    def _require_own_friction(self) -> None:
        """Refuse to change parameters if the friction was computed from the noises and masses of the present ones."""
        if self._fluctuating:
            raise IncompatibleError(
                f"the friction of model {self.name} belongs to its noises and masses, and so to these parameters: "
                "change the parameters of the model without friction, then call thermostat"
            )

    @property
    def damping(self) -> Damping:
        """Rates gamma_i of the momenta [1/time], one for each degree of freedom, or rows of a matrix of friction on
        velocities [mass/time], or `Rates` that are functions; () for a closed system."""
        return self._damping

    def damped(self, damping, *, allow_gain: bool = False, each: bool = False) -> Self:
        """The same model with damped momenta: dp_i = -H_q dt - gamma_i p_i dt - sum_k H_{k,q} o dW_k.

        It is the force F = -gamma p of the paper, [WHSB] (9)-(17). damping: one rate gamma [1/time] for all degrees of
        freedom, or rates (dof,). They multiply p and not velocities: with H = p.M^-1 p/2 + U the friction on q' is
        gamma_i m_i, and where H has other terms in p, it is no friction on velocities at all. A rate of zero damps
        nothing, and all zero give the closed model. A negative rate feeds energy in and needs allow_gain.

        Friction on velocities is a symmetric matrix Gamma (dof, dof) [mass/time], dp = .. - Gamma M^-1 p dt, for models
        with H = p.M^-1 p/2 + U and a constant M (`identity_mass` or `constant_mass`); rates g_i are diag(g_i m_i). Its
        eigenvalues must not be negative without allow_gain. It shrinks volume by exp(-h tr Gamma M^-1), and no dp ^ dq
        as a whole.

        Rates that change are a function of (q, t), of (q) or of (t), by these names, with q of shape (dof, lane). It
        returns (lane,), one rate for all momenta, or with each=True (dof, lane). Models from formulas take formulas,
        "g0*(1 + q**2)" or a list with one for each momentum, and a compiled function has the signature symsde_damping
        of symsde.h. A path fails where a rate is negative without allow_gain. A step shrinks dp ^ dq by
        exp(-int gamma dt) where gamma depends on time alone, and otherwise volume by a factor that depends on the path.

        With one rate a step multiplies dp ^ dq by exp(-gamma h), to rounding, for every increment: it is conformally
        symplectic, and `diagnose.symplecticity` measures the distance from that factor. Runs take tableaux (midpoint,
        gauss2, stormer_verlet ..; of several stages between two half decays where the damping is a matrix or a
        function, with order two without noise) and free drifts with kicks (gauss_dkdkd, verlet_kdk, chin4a and their
        _strong2). Other schemes, brackets of H, exact solutions and actions are refused (IncompatibleError).
        """
        closed = self._closed or self
        other = _copied(closed)
        other._bath = ()  # another friction is that of no bath, or of another one
        other._damp(closed, damping, checks.flag("allow_gain", allow_gain), each)
        return other if other.damping else closed

    @property
    def _kicked(self) -> bool:
        """Whether drifts and kicks fit: their traits, and forces of positions alone."""
        return self.traits.kicked and self._forces.in_position

    @property
    def _noise_commutes(self) -> bool:
        """Whether the fields of all noises commute, by what is declared of them and of their forces."""
        if self.nnoise < 2:
            return True
        if self._forces.noise_force is not None:
            return self.traits.position_noise and self._forces.noise_force_in_position
        return self.traits.additive or self.traits.position_noise

    @property
    def has_friction(self) -> bool:
        """Whether `damping` is a matrix of friction on velocities."""
        return isinstance(self._damping, tuple) and bool(self._damping) and isinstance(self._damping[0], tuple)

    def _damped_from(self, _rates: np.ndarray) -> Callable[[], ModelHandle]:
        """The function that makes the handles to be damped by these rates."""
        return self._handles.made

    @property
    def _varying(self) -> Rates | None:
        """Rates that are functions, if there are any."""
        return self._damping if isinstance(self._damping, Rates) else None

    def _told_damping(self) -> Any:
        """Damping in types of JSON."""
        return self._varying.told() if self._varying else self._damping

    def _damp(self, closed: Model, damping, allow_gain: bool, each: bool = False) -> None:
        """Turn this model into the damped form of a closed model."""
        if (varying := rates_of(damping, each, allow_gain, self.ndof)) is not None:
            self._handles = handles.Pool(functools.partial(handle_with_rates, closed._handles.made, varying, self.ndof))
            self._damping, self._closed = varying, closed
            self.in_python = self.in_python or varying.in_python
            return
        rates = np.array(np.atleast_1d(checks.real_array("damping", damping)))  # a copy: callers may change it
        if rates.shape not in ((1,), (self.ndof,), (self.ndof, self.ndof)):
            raise WrongShapeError(
                f"damping has shape {rates.shape}: give a number, or ({self.ndof},), one rate for each p, or "
                f"({self.ndof}, {self.ndof}), a symmetric matrix of friction on velocities"
            )
        if rates.ndim == 2 and closed.paths:
            _require_one_mass(closed)
        self._handles = handles.Pool(functools.partial(_damped_handle, closed._damped_from(rates), rates, allow_gain))
        if rates.ndim == 2:
            self._damping = tuple(tuple(map(float, row)) for row in rates) if rates.any() else ()
        else:
            self._damping = tuple(float(x) for x in np.broadcast_to(rates, self.ndof)) if rates.any() else ()
        self._closed = closed if self._damping else None

    @checks.hinted()
    def forced(
        self,
        force: Any = None,
        *,
        force_derivative: Any = None,
        noise_force: Any = None,
        noise_force_derivative: Any = None,
        position_force: bool = False,
        position_noise_force: bool = False,
        force_bandwidth: int | None = None,
    ) -> Self:
        """The same model with forces beside its Hamiltonians, in place of those that it has:

            dq = H_p dt + sum_k H_{k,p} o dW_k,    dp = (-H_q + F) dt + sum_k (-H_{k,q} + f_k) o dW_k

        - force: F(q, p, t), momentum/time (dof, lane) from q and p (dof, lane). Its work is F.dq, [WHSB] (9)-(17)
        - noise_force: f(q, p, t), (noise, dof, lane), whose row k goes with dW_k. Noises may have H_k = 0
        - force_derivative, noise_force_derivative: two arrays, derivatives by q and by p, (dof, dof, lane) or (noise,
          dof, dof, lane); [.., j, i, :] is that of component i by q_j or p_j. Without them Newton's iteration takes
          differences
        - force_bandwidth: b, where no component i of a force depends on q_j or p_j with |i - j| > b, as 0 for drag on
          each degree of freedom. Implicit steps of chains then solve equations with bands, as they do without forces
        - position_force, position_noise_force: whether F, and every f_k, depend on q and t alone; then separable models
          keep their explicit schemes

        Compiled functions (``numba_signature('force')``, symsde.h) write w[0] F, or the sum of w[k] f_k, instead. Steps
        obey the discrete Lagrange-d'Alembert principle: they are the scheme's own with -Hhat_q + h F + sum_k dW_k f_k
        in place of -Hhat_q. Tableaux execute them (midpoint, gauss2, symplectic_euler, stormer_verlet ..), with strong
        order 1 where the noises' fields commute. Schemes of kicks, brackets, areas under forces f_k, and exact
        solutions are refused (IncompatibleError). For F = -gamma p take `damped`, whose steps keep the exact factor.
        """
        forces = _forces(
            force, force_derivative, noise_force, noise_force_derivative, position_force, position_noise_force,
            force_bandwidth,
        )  # fmt: skip
        return self._with_forces(forces)

    def _rubbed_by_noises(self, beta: float) -> Model:
        """The model with the force -beta/2 sum_k H_k,q (H_k,q . H_p) of its noises in position, a friction.

        Then exp(-beta H) is stationary: d(q, p) = X_H dt - beta/2 sum_k {H, H_k} X_k dt + sum_k X_k o dW_k.
        """
        return self.forced(_FrictionOfNoises(self, beta))

    def _with_forces(self, forces: Forces) -> Self:
        """The same model with these forces in place of those that it has."""
        undamped = self._closed or self
        free = undamped._unforced or undamped
        other = free
        if forces:
            other = _copied(free)
            other._force(free, forces)
        if not self.damping:
            return other
        other = other.damped(self._asked, allow_gain=True)
        return other._in_bath(self._bath, self._fluctuating) if self._bath else other

    def _in_bath(self, beta: tuple[float, ...], fluctuating: bool) -> Self:
        """This new model, with what is known of the bath that its friction and noises are."""
        self._bath, self._fluctuating = beta, fluctuating
        return self

    @property
    def _asked(self) -> np.ndarray | Rates:
        """What was asked for as damping."""
        return self._varying or np.array(self.damping or (0.0,))

    def _force(self, free: Model, forces: Forces) -> None:
        """Be the form of a model on which forces act."""
        self._handles = handles.Pool(functools.partial(handle_with, free._handles.made, forces, free.nnoise))
        self._forces, self._unforced = forces, free
        self.in_python = self.in_python or forces.in_python
        self.traits = self._read_traits()

    def __reduce__(self) -> tuple:
        """Pickle as the arguments: another process makes the model again, if it finds the functions by name."""
        if self._closed is not None:
            if self._varying:
                require_names(self.name, [self._varying.function])
            return _damped_again, (self._closed, self._damping, self._bath, self._fluctuating)
        if self._unforced is not None and self._remade is self._unforced._remade:  # not those of formulas
            require_names(self.name, self._forces.functions().values())
            return _forced_again, (self._unforced, self._forces, self._bath, self._fluctuating)
        if self._remade is None:
            raise WrongTypeError(
                f"model {self.name!r} holds compiled functions, whose addresses mean nothing in another process: "
                "make the model where it is used"
            )
        if isinstance(given := self._remade[1][0], dict):
            require_names(self.name, given.values())
        return self._remade

    def __copy__(self) -> Model:
        """A model never changes: a copy is the model itself."""
        return self

    def __deepcopy__(self, _memo: dict) -> Model:
        """A model never changes: a copy is the model itself."""
        return self

    def _read_traits(self) -> Traits:
        given = handles.new(abi.Traits, "traits")
        self.call("model_traits", ctypes.byref(given))
        flags = {name: bool(getattr(given, name)) for name in (*FLAGS, *_KNOWN)}
        return Traits(
            ndof=given.ndof,
            nnoise=given.nnoise,
            bandwidth=None if given.bandwidth < 0 else given.bandwidth,
            max_frequency=given.max_frequency,
            noise_lipschitz=given.noise_lipschitz,
            rotation=tuple(given.rotation[: given.ndof]) if given.rotation else None,
            silent=tuple(k + 1 for k in range(given.nnoise) if given.silent and given.silent[k]),
            touches=_lists_of(given),
            **flags,
        )

    @property
    def parameters(self) -> Mapping[str, Any]:
        """Values of the parameters, to be read: numbers, or arrays (path,). A model never changes."""
        return types.MappingProxyType(self._parameters)

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of the coordinates and then of the momenta in results and files: q_1 .., p_1 .. or the model's own."""
        return self._coordinates or tuple(f"{x}_{i + 1}" for x in "qp" for i in range(self.ndof))

    @property
    def paths(self) -> int:
        """The number of paths for which there are values of parameters, one for each path; 0 = any number."""
        return max((x.size for x in self._parameters.values() if np.ndim(x) and x.size > 1), default=0)

    def _part(self, _where: slice | np.ndarray) -> Model:
        """The model of some paths of a run, by their places in it; the same where no parameter goes by path."""
        return self

    ndof = property(lambda self: self.traits.ndof, doc="Degrees of freedom.")
    nnoise = property(lambda self: self.traits.nnoise, doc="Noises.")

    def __repr__(self) -> str:
        """Name and parameters of the model."""
        parameters = ", ".join(f"{key}={html.told(value)}" for key, value in self.parameters.items())
        what = parameters or f"ndof={self.ndof}, nnoise={self.nnoise}"
        if self.has_friction:
            what += f", friction ({self.ndof}, {self.ndof})"
        if self._varying:
            what += f", damping={', '.join(self._varying.told())}"
        rates = () if self.has_friction or self._varying else self.damping
        for key, numbers in (("damping", rates), ("bath at beta", self._bath)):
            if numbers:
                what += f", {key}=" + (f"{numbers[0]:g}" if len(set(numbers)) == 1 else str(list(numbers)))
        return f"{self.name}({what}{', forced' if self._forces else ''})"

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

    def _evaluate(self, what, npath, t, w, *arrays) -> None:
        addresses = [checks.address(a) for a in (w, *arrays)]
        self.call(f"model_{what}", npath, checks.number("t", t), *addresses)

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


def _copied(model: Model) -> Model:
    """The same model as another object, with the same handles."""
    other = object.__new__(type(model))
    other.__dict__.update(model.__dict__)
    return other


def _forces(force, derivative, noise_force, noise_derivative, *declared) -> Forces:
    """Forces from the arguments of `Model.forced`."""
    *in_position, bandwidth = declared
    flags = (checks.flag(x, y) for x, y in zip(("position_force", "position_noise_force"), in_position, strict=True))
    if bandwidth is not None:
        bandwidth = checks.integer("force_bandwidth", bandwidth, checks.INT32)
        if bandwidth < 0:
            raise InvalidArgumentError(
                f"force_bandwidth = {bandwidth}: give the largest |i - j| of q_j or p_j on which a component i of a "
                "force depends, or nothing"
            )
    return Forces(force, derivative, noise_force, noise_derivative, *flags, bandwidth)


def _require_one_mass(model: Model) -> None:
    """Refuse a matrix of friction where masses go by path: the library has one matrix Gamma M^-1 for all paths."""
    origin = np.zeros((model.ndof, model.paths))
    for unit in np.eye(model.ndof):
        velocity = model.gradient(origin, origin + unit[:, np.newaxis])[1]
        if np.any(velocity != velocity[:, :1]):
            raise IncompatibleError(
                f"masses of model {model.name} differ from path to path, and a matrix of friction needs one mass for "
                "all paths: give rates, or a model for each mass"
            )


@dataclass(frozen=True)
class _FrictionOfNoises:
    """A force of a model's own noises, which pickles where the model does."""

    model: Model
    beta: float

    def __call__(self, q: np.ndarray, p: np.ndarray, t: float) -> np.ndarray:
        weights = np.eye(self.model.nnoise + 1)
        velocity = self.model.gradient(q, p, weights[0], t)[1]
        noises = (k for k in range(1, self.model.nnoise + 1) if k not in self.model.traits.silent)
        gradients = (self.model.gradient(q, p, weights[k], t)[0] for k in noises)
        return -self.beta / 2 * sum(g * (g * velocity).sum(axis=0) for g in gradients)


def _forced_again(free: Model, forces: Forces, *bath: Any) -> Model:
    """A model with forces from what pickle kept of it."""
    other = _copied(free)
    other._force(free, forces)
    return other._in_bath(*bath)


def _damped_again(closed: Model, rates: Damping, *bath: Any) -> Model:
    """Make a damped model again from its pickle."""
    return closed.damped(rates, allow_gain=True)._in_bath(*bath)


def _damped_handle(make: Callable[[], ModelHandle], rates: np.ndarray, allow_gain: bool) -> ModelHandle:
    """Make a handle of a model with damped momenta."""
    handle = make()
    given = (ctypes.c_double * rates.size)(*rates.flat)
    if rates.ndim == 2:
        handles.call("model_set_friction", handle.pointer, given, int(allow_gain))
    else:
        handles.call("model_set_damping", handle.pointer, rates.size, given, int(allow_gain))
    return handle


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


def _frequencies(rotation, ndof: int):
    """One frequency for each degree of freedom as a C array, or None."""
    if rotation is None:
        return None
    values = checks.real_array("rotation", rotation)
    if values.shape != (ndof,):
        raise WrongShapeError(f"rotation has shape {values.shape}: give ({ndof},), one frequency for each q_i")
    return (ctypes.c_double * ndof)(*values)


def _silent(silent, nnoise: int):
    """Numbers k = 1 .. nnoise of noises as one flag for each in C, or None."""
    several = checks.items(silent)
    if several is None:
        raise WrongTypeError(f"silent = {checks.shown(silent)} is no list: give numbers of noises, as in [1, 3]")
    chosen = [checks.integer("silent", k) for k in several]
    for k in chosen:
        if not 1 <= k <= nnoise:
            raise InvalidArgumentError(f"silent holds {k}: the noises are 1 to {nnoise}")
    return (ctypes.c_int32 * nnoise)(*(k + 1 in chosen for k in range(nnoise))) if chosen else None


def _supports(touches, nnoise: int, ndof: int):
    """Lists of degrees of freedom 1 .. ndof, one for each noise, as two C arrays; None, None without them."""
    if touches is None:
        return None, None
    several = checks.items(touches)
    if several is not None and len(several) != nnoise:
        raise WrongShapeError(f"touches has {len(several)} lists: give {nnoise}, one for each noise")
    for x in several or ():
        if (count := len(x) if isinstance(x, Sequence) else getattr(x, "size", 0)) > ndof:
            raise WrongShapeError(f"touches has a list of {count} numbers: name each of {ndof} degrees of freedom once")
    lists = [None] if several is None else [checks.items(x) for x in several]
    if None in lists:
        raise WrongTypeError(
            f"touches = {checks.shown(touches)} is no list of lists: give for each noise the numbers of the degrees of "
            "freedom that it touches, as in [[1], [2]]"
        )
    lists = [[checks.integer("touches", i) for i in several] for several in lists]
    for i in (i for several in lists for i in several):
        if not 1 <= i <= ndof:
            raise InvalidArgumentError(f"touches holds {i}: the degrees of freedom are 1 to {ndof}")
    places = np.cumsum([0, *map(len, lists)])
    return (ctypes.c_int32 * (nnoise + 1))(*places), (ctypes.c_int32 * max(1, places[-1]))(*itertools.chain(*lists))


def _lists_of(traits: abi.Traits) -> tuple[tuple[int, ...], ...] | None:
    """What each noise touches, from the C arrays."""
    if not traits.touches_from:
        return None
    places = traits.touches_from[: traits.nnoise + 1]
    every = traits.touches[: places[-1]] if places[-1] else []
    return tuple(tuple(every[a:b]) for a, b in itertools.pairwise(places))


def _public(traits: abi.Traits) -> dict[str, Any]:
    """Declared traits as the arguments of `Model`."""
    given = {name: bool(getattr(traits, name)) for name in FLAGS}
    given |= {name: getattr(traits, name) for name in ("ndof", "nnoise", "max_frequency", "noise_lipschitz")}
    given["bandwidth"] = None if traits.bandwidth < 0 else traits.bandwidth
    given["rotation"] = list(traits.rotation[: traits.ndof]) if traits.rotation else None
    given["silent"] = [k + 1 for k in range(traits.nnoise) if traits.silent and traits.silent[k]]
    given["touches"] = _lists_of(traits)
    return given


def _builtin_handle(name: str, parameters: Mapping[str, float]) -> ModelHandle:
    """A handle of a built-in model."""
    count = len(parameters)
    keys = (ctypes.c_char_p * count)(*(handles.encode(key) for key in parameters))
    values = (ctypes.c_double * count)(*parameters.values())
    pointer = ctypes.c_void_p()
    handles.call("model_get", handles.encode(name), count, keys, values, ctypes.byref(pointer))
    return ModelHandle(pointer, None, _callbacks.Failures())


def _user_handle(name: str, traits: abi.Traits, functions: dict[str, Any], accepts_null: bool) -> ModelHandle:
    """A handle of a user's model, with callbacks that store their exceptions for this handle alone."""
    failures = _callbacks.Failures()
    (*callbacks, joint, third, rows), user = _all_callbacks(functions, failures)
    pointer = ctypes.c_void_p()
    handles.call("model_new", handles.encode(name), ctypes.byref(traits), *callbacks, user, ctypes.byref(pointer))
    handle = ModelHandle(pointer, (callbacks, joint, third, rows, tuple(functions.values())), failures)
    if joint:
        handles.call("model_set_gradient_hessian", pointer, joint)
    if third:
        handles.call("model_set_third_derivative", pointer, third)
    if rows:
        handles.call("model_set_chain_rows", pointer, rows)
    if accepts_null:
        handles.call("model_accept_null", pointer)
    return handle


def _checked_flows(flows: Mapping[str, Any] | None) -> dict[str, Any]:
    """Check whole steps by scheme; functions that are not compiled are refused."""
    given = checks.table("flows", {} if flows is None else flows)
    for scheme, function in given.items():
        if _callbacks.compiled("flow", function) is None:
            raise WrongTypeError(
                f"flows[{scheme!r}] = {checks.shown(function)} is not compiled: give a numba cfunc of "
                "symsde.numba_signature('flow'), a ctypes function pointer or a LowLevelCallable"
            )
    return given


def _with_flows(make: Callable[[], ModelHandle], flows: dict[str, Any], any_lanes: bool) -> ModelHandle:
    """A handle of a user's model that defines whole steps, or whose functions take any number of lanes."""
    handle = make()
    handle.flows = []  # must live as long as the handle
    for scheme, function in flows.items():
        callback, _ = _callbacks.compiled("flow", function)
        handle.flows.append((callback, function))
        handles.call("model_set_flow", handle.pointer, handles.encode(scheme), callback)
    if any_lanes:
        handles.call("model_accept_any_lanes", handle.pointer)
    return handle


def _derived(make: Callable[[], ModelHandle]) -> ModelHandle:
    """A handle of a user's model that remembers which probes it passed."""
    handle = make()
    handles.call("model_set_derived", handle.pointer)
    return handle


def _kinds(functions: dict[str, Any]) -> set[str]:
    """The kinds of functions, Python or compiled; refuses anything else."""
    if functions["gradient"] is None:
        raise WrongTypeError("gradient is None: give the gradient of the weighted sum of the Hamiltonians")
    kinds = set()
    for kind, function in functions.items():
        if function is None:
            continue
        if _callbacks.compiled(kind, function) is not None:
            kinds.add("compiled")
        elif callable(function) and kind == "chain_rows":
            raise WrongTypeError(
                "chain_rows is a Python function: it would be called for every few rows of every iteration; "
                "compile it, or leave it out"
            )
        elif callable(function):
            checks.takes(kind, function, "t", "w", *_callbacks.VECTORS[kind])
            kinds.add("Python")
        else:
            raise WrongTypeError(
                f"{kind} = {checks.shown(function)} cannot be called: give a function, a numba cfunc, "
                "a ctypes function pointer or a LowLevelCallable"
            )
    return kinds


def _all_callbacks(functions: dict[str, Any], failures: _callbacks.Failures):
    """Callbacks in the order of the C interface, and their user pointer."""
    callbacks, users = [], set()
    for kind, function in functions.items():
        ready = None if function is None else _callbacks.compiled(kind, function)
        if function is None:
            callbacks.append(abi.CALLBACKS[kind]())
        elif ready is not None:
            callbacks.append(ready[0])
            users.add(ready[1])
        else:
            callbacks.append(_callbacks.from_python(kind, function, failures))
    users.discard(None)
    if len(users) > 1:
        raise IncompatibleError("the compiled functions have different user data: a model has room for one pointer")
    return callbacks, (users.pop() if users else None)
