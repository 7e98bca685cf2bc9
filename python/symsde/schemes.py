# SPDX-License-Identifier: BSD-3-Clause
"""Schemes by name, from a quadrature of the action, from your own tableau, or composed of other schemes."""

from __future__ import annotations

import ctypes
import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from .errors import MissingOperationError, UnknownNameError, WrongShapeError, WrongTypeError
from .native import abi, checks
from .native import handles as _handles
from .show import html

_FORMS = {1: "tableau", 2: "Galerkin", 3: "Euler-Maruyama", 4: "drifts and kicks"}
_EVIDENCE = ("none", "claimed", "derived")
_LAWS = ("Gaussian", "three-point", "two-point")
_EXPLICIT = ("never", "separable models", "every model")
ORDERS = ("additive", "commutative", "general", "commuting", "weak")  #: keys of SchemeInfo.orders


@dataclass(frozen=True)
class Measured:
    """A measured order: the slope of the error over the step."""

    order: float
    #: half width of the 95 % interval of the slope; for weak orders (no sampling) the difference of the last two
    #: slopes
    half_width: float
    floor: float  #: error of the reference over the smallest error used; 0 = exact


@dataclass(frozen=True)
class Order:
    """An order of convergence and its evidence."""

    value: float  #: order; 0 = the scheme does not converge, or is not designed for such noise
    evidence: str  #: derived, from the coefficients that are executed; claimed; none
    measured: Measured | None  #: results on the problem named in the certificate; None = not measured


@dataclass(frozen=True)
class SchemeInfo:
    """Properties of a scheme: derived from its coefficients, claimed, or measured."""

    name: str
    reference: str
    form: str  #: tableau, Galerkin, Euler-Maruyama, or drifts and kicks
    nstage: int
    degree: int  #: degree of the polynomial; 0 = the scheme is not made from a quadrature
    symplectic: bool
    symmetric: bool
    keeps_quadratic: bool  #: whether quadratic invariants are kept exactly
    keeps_bilinear: bool  #: whether invariants q^T D p, such as angular momentum, are kept exactly
    #: evidence for the four properties above: derived, or claimed (schemes with a special stepper)
    structure_evidence: str
    symplecticity_residual: float  #: residual of the conditions on the coefficients; 0 = they hold
    symmetry_residual: float
    quadratic_residual: float
    stratonovich_sum: float  #: beta^T b e; 1/2 = consistent
    correction_coefficient: float  #: 1/2 - lambda; 0 = needs no correction
    correction_needed: bool
    correction_exists: bool
    orders: dict[str, Order]  #: strong orders: additive, commutative, general, commuting (flows); weak order: weak
    order_noise_free: int
    uses_dz: bool
    uses_areas: bool
    uses_stt_area: bool  #: whether the scheme uses K, the space-time-time Levy area
    uses_magnus: bool  #: whether the scheme uses J, the second Magnus term of the kicks
    uses_nested_bracket: bool  #: whether the scheme uses {{H, H_k}, H_k}
    crosses_noises: bool  #: whether the scheme also uses {{H_l, H_k}, H_k}: its weak order then holds for every noise
    law: str  #: law of the increments: Gaussian, three-point or two-point
    explicit_for: str  #: never, separable models, every model
    gradients_per_step: int  #: number of gradients in a step; for implicit schemes in each iteration
    unknowns: int  #: unknowns of the solver for each degree of freedom
    unknowns_if_separable: int


@dataclass(frozen=True)
class Tableau:
    """Coefficients of a partitioned Runge-Kutta scheme, as `from_tableau` takes them; row i belongs to stage i."""

    c: np.ndarray  #: (stage,), nodes
    a: np.ndarray  #: (stage, stage), coefficients of q
    abar: np.ndarray  #: (stage, stage), coefficients of p
    alpha: np.ndarray  #: (stage,), weights
    b: np.ndarray  #: (stage, stage), coefficients of q for the noise
    bbar: np.ndarray  #: (stage, stage), coefficients of p for the noise
    beta: np.ndarray  #: (stage,), weights of the noise
    beside: str  #: operations of the scheme besides the tableau; if empty, from_tableau makes the same scheme


class Certificate(str):
    """The text of a certificate; notebooks show its lines."""

    __slots__ = ()

    def _repr_html_(self) -> str:
        """The text as preformatted HTML."""
        return html.text(self)


class Scheme:
    """A scheme as data; made by `get`, `from_quadrature` or `from_tableau`."""

    def __init__(self, pointer: ctypes.c_void_p, made: tuple):
        """Own the handle `pointer`, `made` by a function from arguments."""
        self._handle = _handles.Handle("scheme", pointer)
        self._made = made
        self.info: SchemeInfo = self._read_info()

    def _read_info(self) -> SchemeInfo:
        given = _handles.new(abi.SchemeInfo, "scheme_info")
        _handles.call("scheme_get_info", self._handle.pointer, ctypes.byref(given))
        made = ("orders", "crosses_noises")
        fields = {name: getattr(given, name) for name in SchemeInfo.__dataclass_fields__ if name not in made}
        fields["crosses_noises"] = fields["uses_nested_bracket"] > 1
        for name in ("name", "reference"):
            fields[name] = fields[name].decode("utf-8", "replace")
        for name, kind in SchemeInfo.__annotations__.items():
            if kind == "bool":
                fields[name] = bool(fields[name])
        fields["form"] = _FORMS.get(fields["form"], str(fields["form"]))
        fields["structure_evidence"] = _EVIDENCE[fields["structure_evidence"]]
        fields["law"] = _LAWS[fields["law"]]
        fields["explicit_for"] = _EXPLICIT[fields["explicit_for"]]
        fields["orders"] = {key: _order(given, i) for i, key in enumerate(ORDERS)}
        return SchemeInfo(**fields)

    @property
    def name(self) -> str:
        """Name of the scheme."""
        return self.info.name

    def certificate(self) -> Certificate:
        """What is proved, claimed and measured about the scheme, as text. `info` holds the same as values."""
        return Certificate(_handles.text("scheme_certificate", self._handle.pointer, has_error=True))

    def tableau(self) -> Tableau | None:
        """The coefficients; None for schemes without a tableau: Galerkin schemes, and drifts and kicks.

        Some schemes add brackets to the Hamiltonian (gauss2_strong32); others put the tableau between further maps,
        such as a rotation or kicks (verlet_dz, exact_rotation). The tableau does not contain these additions; its
        `beside` names them. For such schemes `from_tableau` makes another scheme.
        """
        size = self.info.nstage
        arrays = [np.empty((size,) * rank) for rank in (1, 2, 2, 1, 2, 2, 1)]
        try:
            _handles.call("scheme_tableau", self._handle.pointer, *map(checks.address, arrays))
        except MissingOperationError:
            return None
        return Tableau(*arrays, self._beside())

    def _beside(self) -> str:
        """Operations of the scheme that its tableau does not contain."""
        info = self.info
        if info.form != "tableau":
            return ""
        if info.structure_evidence == "claimed":
            return "what a stepper of its own does around these stages"
        brackets = {
            "{H_k, H} with dZ": info.uses_dz,
            "{H_l, H_k} with areas": info.uses_areas,
            "{{H, H_k}, H_k}": info.uses_nested_bracket,
            "{{H_l, H_k}, H_k}": info.crosses_noises,
        }
        added = ", ".join(name for name, used in brackets.items() if used)
        parts = [f"brackets added to H: {added}"] * bool(added) + [f"{info.law} increments"] * (info.law != "Gaussian")
        return "; ".join(parts)

    def _repr_html_(self) -> str:
        """Show structure, tableau and orders in notebooks."""
        return html.scheme(self)

    def __reduce__(self) -> tuple:
        """Pickle as the function and arguments that made the scheme."""
        return self._made

    def __copy__(self) -> Scheme:
        """A scheme never changes: a copy is the scheme itself."""
        return self

    def __deepcopy__(self, _memo: dict) -> Scheme:
        """A scheme never changes: a copy is the scheme itself."""
        return self

    def __repr__(self) -> str:
        """The scheme in one line."""
        kind = "symplectic" if self.info.symplectic else "not symplectic"
        beside = self._beside()
        more = f"; beside the tableau: {beside}" if beside else ""
        return f"<scheme {self.name}: {self.info.form}, {checks.counted(self.info.nstage, 'stage')}, {kind}{more}>"


def _order(given: abi.SchemeInfo, i: int) -> Order:
    """One order of the struct of the C interface."""
    numbers = (given.measured_order[i], given.measured_half_width[i], given.measured_floor[i])
    measured = None if np.isnan(numbers[0]) else Measured(*numbers)
    return Order(given.order[i], _EVIDENCE[given.order_evidence[i]], measured)


def names() -> list[str]:
    """Names of the catalogue. `get` also knows families with a parameter: 'dirk:0.25', 'lambda:0.3', 'word:BAOAB'."""
    return _handles.text("scheme_names").split()


def get(name: str) -> Scheme:
    """A scheme of the catalogue; UnknownNameError names the nearest."""
    pointer = ctypes.c_void_p()
    try:
        _handles.call("scheme_get", _handles.encode(checks.name_of("scheme", name)), ctypes.byref(pointer))
    except UnknownNameError as error:
        if "scheme_names()" not in str(error):
            raise
        raise checks.none_such("scheme", name, names()) from None
    return Scheme(pointer, (get, (name,)))


def from_word(word: str) -> Scheme:
    """A splitting for damped models, written as a word that is read from left to right: "BAOAB", "OBABO", "ABOBA", ..

    A is the drift q <- q + tau M^-1 p, B the kick p <- p - tau U_q, O damping with noise, p <- exp(-gamma tau) p +
    noise of its exact law; tau is h divided by the number of that letter. There are one or two O. Their noise is made
    of the increments of the path, for two O also of dZ: paths converge with strong order one, and no further normal
    numbers are drawn. Words that read the same from behind have weak order two. The name in scenes, C and Fortran is
    "word:BAOAB". Needs noise in position and a constant mass, and one rate of damping. InvalidArgumentError says why a
    text is no word.
    """
    return get(f"word:{checks.name_of('word', word)}")


def as_scheme(scheme: str | Scheme) -> Scheme:
    """A scheme given as an object or by name."""
    return scheme if isinstance(scheme, Scheme) else _by_name(checks.name_of("scheme", scheme))


@functools.lru_cache(maxsize=256)
def _by_name(name: str) -> Scheme:
    """A scheme by name, cached: a scheme never changes, so runs share it."""
    return get(name)


def from_quadrature(nodes, weights, degree: int, name: str | None = None, noise_weights=None) -> Scheme:
    """The symplectic scheme that follows from a quadrature of the action, [WHSB] (49), (53)-(58).

    nodes, weights: (node,) on the unit interval; degree: of the polynomials, at most the number of nodes;
    noise_weights: (node,), if the noise has weights of its own. IncompatibleError or InvalidArgumentError say why a
    quadrature gives no scheme.
    """
    nodes, weights = (_vector(key, x) for key, x in (("nodes", nodes), ("weights", weights)))
    own = None if noise_weights is None else _vector("noise_weights", noise_weights)
    degree = checks.integer("degree", degree, checks.INT32)
    for what, given in (("weights", weights), ("noise weights", own)):
        if given is not None and len(given) != len(nodes):
            raise WrongShapeError(
                f"there are {len(nodes)} nodes and {len(given)} {what}: give one weight for each node"
            )
    pointer = ctypes.c_void_p()
    _handles.call(
        "scheme_from_quadrature",
        len(nodes),
        *(checks.address(x) for x in (nodes, weights, own)),
        degree,
        _name(name),
        ctypes.byref(pointer),
    )
    return Scheme(pointer, (from_quadrature, (nodes, weights, degree, name, own)))


def from_tableau(  # noqa: PLR0917 - a tableau reads like its formula
    a,
    abar,
    alpha,
    name: str | None = None,
    allow_nonsymplectic: bool = False,
    b=None,
    bbar=None,
    beta=None,
) -> Scheme:
    """The partitioned Runge-Kutta scheme with these coefficients: a for q, abar for p.

    a, abar: (stage, stage), row i belongs to stage i; alpha: (stage,); b, bbar, beta: coefficients of the noise, by
    default the same. A tableau that is not symplectic is refused unless you pass `allow_nonsymplectic`.
    """
    alpha = _vector("alpha", alpha)
    size = len(alpha)
    matrices = [_matrix(key, value, size) for key, value in (("a", a), ("abar", abar))]
    own = [None if value is None else _matrix(key, value, size) for key, value in (("b", b), ("bbar", bbar))]
    noise_weights = None if beta is None else _vector("beta", beta)
    if noise_weights is not None and len(noise_weights) != size:
        raise WrongShapeError(f"beta has {len(noise_weights)} weights: give {size}, one for each weight in alpha")
    pointer = ctypes.c_void_p()
    _handles.call(
        "scheme_from_tableau",
        size,
        *(checks.address(x) for x in (*matrices, alpha, *own, noise_weights)),
        _name(name),
        checks.flag("allow_nonsymplectic", allow_nonsymplectic),
        ctypes.byref(pointer),
    )
    arguments = (*matrices, alpha, name, allow_nonsymplectic, *own, noise_weights)
    return Scheme(pointer, (from_tableau, arguments))


def adjoint(scheme: str | Scheme, name: str | None = None) -> Scheme:
    """The adjoint: the inverse of a step back in time. The adjoint of symplectic_euler is symplectic_euler_adjoint."""
    return _derived(adjoint, scheme, name)


def symmetric_composition(scheme: str | Scheme, name: str | None = None) -> Scheme:
    """Half a step of a scheme, then half a step of its adjoint. From symplectic_euler this makes stormer_verlet."""
    return _derived(symmetric_composition, scheme, name)


def triple_jump(scheme: str | Scheme, name: str | None = None) -> Scheme:
    """Three steps of a symmetric scheme, the second one backwards; raises the order without noise by two."""
    return _derived(triple_jump, scheme, name)


def composition(parts: Sequence[str | Scheme], fractions, name: str = "composition") -> Scheme:
    """Steps of several schemes one after the other, each with its fraction of the step and of the increments.

    fractions: (part,), with the sum one.
    """
    if isinstance(parts, str) or not isinstance(parts, Sequence):
        raise WrongTypeError(f"parts = {checks.shown(parts)} is not a list of schemes: give names or schemes")
    chain = [as_scheme(part) for part in parts]
    gamma = _vector("fractions", fractions)
    if len(chain) != len(gamma):
        raise WrongShapeError(f"there are {len(chain)} parts and {len(gamma)} fractions: give one for each part")
    handles = (ctypes.c_void_p * len(chain))(*(part._handle.pointer for part in chain))
    pointer = ctypes.c_void_p()
    _handles.call("scheme_compose", len(chain), handles, checks.address(gamma), _name(name), ctypes.byref(pointer))
    return Scheme(pointer, (composition, (chain, gamma, name)))


def _derived(maker: Callable[..., Scheme], scheme: str | Scheme, name: str | None) -> Scheme:
    """A scheme derived from another one by the library's function that has the name of `maker`."""
    base = as_scheme(scheme)
    pointer = ctypes.c_void_p()
    own = None if name is None else _name(name)
    _handles.call(f"scheme_{maker.__name__}", base._handle.pointer, own, ctypes.byref(pointer))
    return Scheme(pointer, (maker, (base, name)))


def _matrix(key: str, value: object, size: int) -> np.ndarray:
    matrix = np.array(checks.real_array(key, value), order="C")
    if matrix.shape != (size, size):
        raise WrongShapeError(f"{key} has shape {matrix.shape}: give {(size, size)}, one row for each weight in alpha")
    return matrix


def _vector(key: str, value: object) -> np.ndarray:
    array = np.array(checks.real_array(key, value), order="C")
    if array.ndim != 1 or array.size == 0:
        raise WrongShapeError(f"{key} has shape {array.shape}: give a list of at least one number")
    return array


def _name(name: str | None) -> bytes:
    return _handles.encode("user" if name is None else checks.name_of("name", name))
