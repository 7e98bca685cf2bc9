# SPDX-License-Identifier: BSD-3-Clause
"""What acts beside the Hamiltonians of a model: damping, friction, forces, and the bath that they make with noises."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, Self

import numpy as np

from ..errors import IncompatibleError, WrongShapeError
from ..native import checks, handles
from .forces import Forces, FrictionOfNoises, given_forces, handle_with
from .rates import Damping, Rates, handle_with_numbers, rates_of, require_one_mass
from .rates import handle_with as handle_with_rates
from .traits import Traits
from .user_handles import ModelHandle


class OpenSystem:
    """What models have beside their Hamiltonians. A model never changes: each procedure gives another one."""

    name: str
    in_python: bool  #: whether some callback is a Python function
    traits: Traits
    _handles: handles.Pool
    _damping: Damping = ()  #: rates of the momenta, or rows of a matrix of friction; empty for a closed system
    _forces: Forces = Forces()  #: what acts beside the Hamiltonians
    _fluctuating: str = ""  #: what thermostat found, for these values alone: "friction" of noises, or "noises"
    _derives_bath: bool = False  #: whether that friction is a formula, which holds for other values, too
    _unforced: Self | None = None  #: for a model with forces the same model without them
    _closed: Self | None = None  #: for a damped model the same model without damping
    _bath: tuple[float, ...] = ()  #: beta of a heat bath, one or one for each degree of freedom; empty without one
    _bathed: tuple | None = None  #: how a bath with gamma was made: a function, the model without it, gamma and beta

    def _require_own_friction(self) -> None:
        """Refuse to change parameters if the friction was computed from the noises and masses of the present ones."""
        if self._fluctuating:
            raise IncompatibleError(
                f"the friction of model {self.name} belongs to its noises and masses, and so to these parameters: "
                "change the parameters of the model without friction, then call thermostat"
            )

    def _bathed_again(self, change: Callable[[Self], Self]) -> Self:
        """The bath with the same gamma and beta around a changed model; its noises know the masses of that."""
        make, bare, gamma, beta = self._bathed
        other = make(change(bare), gamma, beta)
        return other if self._forces == bare._forces else other._with_forces(self._forces)

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
        _strong2). Other schemes, brackets of H and actions are refused (IncompatibleError).
        """
        closed = self._closed or self
        other = copied(closed)
        other._bath = ()  # another friction is that of no bath, or of another one
        other._damp(closed, damping, checks.flag("allow_gain", allow_gain), each)
        return other if other.damping else closed

    @property
    def _kicked(self) -> bool:
        """Whether drifts and kicks fit: their traits, and forces of positions alone."""
        return self.traits.kicked and self._forces.in_position

    @property
    def _turned(self) -> bool:
        """Whether kicks by functions of the actions fit, or flows of two parts of H are all that is given; neither
        commutes with forces."""
        return (self.traits.turned or not self.traits.has_gradient) and not self._forces

    @property
    def _noise_commutes(self) -> bool:
        """Whether the fields of all noises commute, by what is declared of them and of their forces."""
        if self.nnoise < 2:
            return True
        if self._forces.noise_force is not None:
            return self.traits.position_noise and self._forces.noise_force_in_position
        return self.traits.additive or self.traits.position_noise or self.traits.has_parts

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

    def _damp(self, closed: Self, damping, allow_gain: bool, each: bool = False) -> None:
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
            require_one_mass(closed)
        self._handles = handles.Pool(
            functools.partial(handle_with_numbers, closed._damped_from(rates), rates, allow_gain)
        )
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
        """The same model with forces beside its Hamiltonians, in place of all that it has, those in formulas, too:

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
        forces = given_forces(
            force, force_derivative, noise_force, noise_force_derivative, position_force, position_noise_force,
            force_bandwidth,
        )  # fmt: skip
        return self._without_written_forces()._with_forces(forces)

    def _without_written_forces(self) -> Self:
        """This model, without the forces that stand in its formulas."""
        return self

    def _rubbed_by_noises(self, beta: float) -> Self:
        """The model with the force -beta/2 sum_k H_k,q (H_k,q . H_p) of its noises in position, a friction.

        Then exp(-beta H) is stationary: d(q, p) = X_H dt - beta/2 sum_k {H, H_k} X_k dt + sum_k X_k o dW_k.
        """
        return self.forced(FrictionOfNoises(self, beta))

    def _with_forces(self, forces: Forces) -> Self:
        """The same model with these forces in place of those that it has."""
        undamped = self._closed or self
        free = undamped._unforced or undamped
        other = free
        if forces:
            other = copied(free)
            other._force(free, forces)
        if not self.damping:
            return other
        other = other.damped(self._asked, allow_gain=True)
        return other._in_bath(self._bath, self._fluctuating, self._bathed) if self._bath else other

    def _with_constant_forces(self, _strengths: np.ndarray) -> Self | None:
        """This model with noises -s_i q_i behind its own, if that is faster than what the library adds."""
        return None

    def _in_bath(self, beta: tuple[float, ...], fluctuating: str, bathed: tuple | None = None) -> Self:
        """This new model, with what is known of the bath that its friction and noises are."""
        self._bath, self._fluctuating, self._bathed = beta, fluctuating, bathed
        return self

    @property
    def _asked(self) -> np.ndarray | Rates:
        """What was asked for as damping."""
        return self._varying or np.array(self.damping or (0.0,))

    def _force(self, free: Self, forces: Forces) -> None:
        """Be the form of a model on which forces act."""
        self._handles = handles.Pool(functools.partial(handle_with, free._handles.made, forces, free.nnoise))
        self._forces, self._unforced = forces, free
        self.in_python = self.in_python or forces.in_python
        self.traits = self._read_traits()


def copied(model: OpenSystem) -> Any:
    """The same model as another object, with the same handles."""
    other = object.__new__(type(model))
    other.__dict__.update(model.__dict__)
    return other


def forced_again(free: OpenSystem, forces: Forces, *bath: Any) -> Any:
    """A model with forces from what pickle kept of it."""
    other = copied(free)
    other._force(free, forces)
    return other._in_bath(*bath)


def damped_again(closed: OpenSystem, rates: Damping, *bath: Any) -> Any:
    """Make a damped model again from its pickle."""
    return closed.damped(rates, allow_gain=True)._in_bath(*bath)
