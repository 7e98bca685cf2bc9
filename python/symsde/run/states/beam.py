# SPDX-License-Identifier: BSD-3-Clause
"""Normal states whose covariance follows from H: a matched beam, and the canonical law of a heat bath."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...errors import IncompatibleError, InvalidArgumentError, WrongShapeError, WrongTypeError
from ...model.definition import Model
from ...native import checks
from ...schemes import Scheme, as_scheme
from ..step import step as one_step
from ..tangent import tangent
from .law import NORMAL, States, drawn, require_numbers, root_of

_SAME = 1e-9  #: relative difference of numbers that count as equal
_APART = 1e-6  #: difference of phases below which two modes count as one
_GOLDEN = 0.6180339887498949
_POINTS = 9  #: states at which the Hessian is looked at


class Matched(States):
    """States of a matched beam; see `matched`."""

    def __init__(
        self, emittance: Any, twiss: tuple[Any, Any], centre: tuple[Any, Any], of_map: tuple, seed: int | None
    ):
        """Check what does not depend on the model."""
        super().__init__(seed)
        self._emittance = checks.own(checks.real_array("emittance", emittance))
        self._beta, self._alpha = (
            x if x is None else np.array(checks.real_array(name, x))
            for name, x in zip(("beta", "alpha"), twiss, strict=True)
        )
        self._centre = tuple(np.array(checks.real_array(name, x)) for name, x in zip("qp", centre, strict=True))
        self._step, self._scheme = of_map
        if not (np.isfinite(self._emittance).all() and (self._emittance >= 0).all()):
            raise InvalidArgumentError("emittance of states.matched: give finite numbers, zero or above")
        if self._beta is None and self._alpha is not None:
            raise WrongTypeError("alpha of states.matched goes with beta: give both, or neither for those of the model")
        if self._beta is not None and self._step is not None:
            raise WrongTypeError(
                "states.matched takes beta and alpha, or the step and scheme whose map they follow from"
            )
        if self._scheme is not None and self._step is None:
            raise WrongTypeError("scheme of states.matched goes with step: give both, or neither for the flow of H")
        if self._beta is not None and not (np.isfinite(self._beta).all() and (self._beta > 0).all()):
            raise InvalidArgumentError("beta of states.matched: give finite numbers above zero")
        if self._alpha is not None and not np.isfinite(self._alpha).all():
            raise InvalidArgumentError("alpha of states.matched: give finite numbers")

    def told(self) -> dict[str, Any]:
        """See `States`."""
        of_map = {} if self._step is None else {"step": self._step, "scheme": self._scheme.name}
        q, p = self._centre
        return self._told("matched", emittance=self._emittance, beta=self._beta, alpha=self._alpha, q=q, p=p, **of_map)

    def covariance(self, model: Model, t: float = 0.0) -> np.ndarray:
        """The covariance of q_1 .. and then p_1 .., (2 dof, 2 dof)."""
        n = model.ndof
        emittance = _each("emittance", self._emittance, n)
        if self._beta is None:
            require_numbers(model, "matched")
            planes = _modes(self._linear(model, t))
        else:
            zero = np.zeros(()) if self._alpha is None else self._alpha
            planes = _twiss(_each("beta", self._beta, n), _each("alpha", zero, n))
        return sum(e * v @ v.T for e, v in zip(emittance, planes, strict=True))

    def _linear(self, model: Model, t: float) -> np.ndarray:
        """The linearised map of a step, or the generator of the flow, at the centre, (2 dof, 2 dof)."""
        n = model.ndof
        q, p = (checks.state(name, x, n, 1) for name, x in zip("qp", self._centre, strict=True))
        if self._step is None:
            if _far(np.concatenate(model.gradient(q, p, t=t)), model.hessian(q, p, t=t)):
                raise _no_rest("H_q and H_p do not vanish")
            qq, qp, pp = (x[..., 0] for x in model.hessian(q, p, t=t))
            return np.block([[qp, pp], [-qq, -qp.T]])
        still = np.zeros((1, model.nnoise))
        found = one_step(model, self._scheme, q, p, self._step, still[0], t)
        if np.abs(np.concatenate(found) - np.concatenate((q, p))).max() > _SAME * max(1.0, np.abs([q, p]).max()):
            raise _no_rest("a step without noise moves it")
        run = {"q0": q, "p0": p, "t0": t, "step": self._step, "steps": 1, "scheme": self._scheme}
        return tangent(model, increments=still, **run).matrix[..., 0]

    def _draw(self, model: Model, t: float, seed: int, where: tuple[int, int], letters: str) -> tuple:
        centre = np.concatenate([_each(x, y, model.ndof) for x, y in zip("qp", self._centre, strict=True)])
        return drawn(NORMAL, seed, where, centre, root_of(self.covariance(model, t)))


class Canonical(States):
    """States of a heat bath; see `canonical`."""

    def __init__(self, beta: float, seed: int | None):
        """Check beta."""
        super().__init__(seed)
        self._beta = checks.finite("beta", beta)
        if self._beta <= 0:
            raise InvalidArgumentError(f"beta = {beta:g}: give 1/kT, a number above zero")

    def told(self) -> dict[str, Any]:
        """See `States`."""
        return self._told("canonical", beta=self._beta)

    def _draw(self, model: Model, t: float, seed: int, where: tuple[int, int], letters: str) -> tuple:
        require_numbers(model, "canonical")
        n = model.ndof
        centre, factor = np.zeros(2 * n), np.zeros((2 * n, 2 * n))
        for letter in letters:
            rows = slice(0, n) if letter == "q" else slice(n, 2 * n)
            stiffness, rest = _quadratic(model, t, letter)
            centre[rows] = rest
            factor[rows, rows] = root_of(np.linalg.inv(stiffness) / self._beta)
        return drawn(NORMAL, seed, where, centre, factor)


def _each(name: str, value: np.ndarray, ndof: int) -> np.ndarray:
    """A number, or (dof,), as (dof,)."""
    if value.shape not in ((), (ndof,)):
        raise WrongShapeError(f"{name} of initial states has shape {value.shape}: give a number, or ({ndof},)")
    return np.broadcast_to(value, (ndof,))


def _far(gradient: np.ndarray, hessian: tuple[np.ndarray, ...]) -> bool:
    """Whether a gradient is no rounding error, each component beside its own derivatives."""
    qq, qp, pp = (np.abs(x[..., 0]) for x in hessian)
    stiffness = np.block([[qq, qp], [qp.T, pp]]).max(axis=1)
    return bool((np.abs(gradient[:, 0]) > _SAME * stiffness).any())


def _no_rest(why: str) -> InvalidArgumentError:
    return InvalidArgumentError(
        f"states.matched: {why} at the centre: give q and p of a state at rest, about which the beam is matched"
    )


def _twiss(beta: np.ndarray, alpha: np.ndarray) -> list[np.ndarray]:
    """For each plane the vectors (2 dof, 2) whose squares are its covariance for emittance one."""
    n, found = len(beta), []
    for i in range(n):
        v = np.zeros((2 * n, 2))
        v[i, 0] = np.sqrt(beta[i])
        v[n + i] = -alpha[i] / np.sqrt(beta[i]), 1 / np.sqrt(beta[i])
        found.append(v)
    return found


def _modes(linear: np.ndarray) -> list[np.ndarray]:
    """The vectors of every mode of a linear map or generator, that of plane i at place i.

    Planes that do not meet have beta and alpha by the traceless part [[a, b], [c, -a]] of their 2 x 2 block: with
    w^2 = -a^2 - b c, beta = |b|/w and alpha = a sign(b)/w. Others have eigenvectors x + i y with x^T J y = 1.
    """
    n = len(linear) // 2
    scale = np.abs(linear).max()
    blocks = np.array([linear[np.ix_((i, n + i), (i, n + i))] for i in range(n)])
    alone = np.zeros_like(linear)
    for i, block in enumerate(blocks):
        alone[np.ix_((i, n + i), (i, n + i))] = block
    if np.abs(linear - alone).max() <= _SAME * scale:
        a, b, c = (blocks[:, 0, 0] - blocks[:, 1, 1]) / 2, blocks[:, 0, 1], blocks[:, 1, 0]
        square = -(a**2) - b * c
        if (square <= (_SAME * scale) ** 2).any():
            raise _unstable()
        w = np.sqrt(square)
        return _twiss(np.abs(b) / w, a * np.sign(b) / w)
    values, vectors = np.linalg.eig(linear)
    j = np.block([[np.zeros((n, n)), np.eye(n)], [-np.eye(n), np.zeros((n, n))]])
    turning = np.abs(values.imag) > _SAME * scale
    # Eigenvalues of maps are on the unit circle, those of generators on the imaginary axis.
    sizes = np.minimum(np.abs(np.abs(values) - 1), np.abs(values.real) / scale)
    pairs = [k for k in range(2 * n) if values[k].imag > 0]
    apart = min((abs(values[k] - values[m]) for k in pairs for m in pairs if k < m), default=np.inf)
    if not turning.all() or sizes.max() > _APART or len(pairs) != n:
        raise _unstable()
    if apart < _APART * scale:
        raise IncompatibleError(
            "states.matched: two coupled modes have one frequency, so that no ellipse is theirs alone"
        )
    found, shares = [], np.empty((n, n))
    for row, k in enumerate(pairs):
        x, y = vectors[:, k].real, vectors[:, k].imag
        area = x @ j @ y
        x, y = (x, y) if area > 0 else (y, x)
        found.append(np.stack((x, y), axis=1) / np.sqrt(abs(area)))
        shares[row] = np.abs(found[-1][:n, 0] * found[-1][n:, 1] - found[-1][n:, 0] * found[-1][:n, 1])
    order: dict[int, int] = {}
    while len(order) < n:  # the clearest mode takes its plane first
        row, plane = np.unravel_index(np.argmax(shares), shares.shape)
        order[int(plane)] = int(row)
        shares[row], shares[:, plane] = -1, -1
    return [found[order[i]] for i in range(n)]


def _unstable() -> IncompatibleError:
    return IncompatibleError(
        "states.matched: motion about the centre is no oscillation in every plane, so that no ellipse is matched: give "
        "another centre, a smaller step, or beta and alpha"
    )


def _quadratic(model: Model, t: float, letter: str) -> tuple[np.ndarray, np.ndarray]:
    """The constant Hessian of H in q or in p, (dof, dof), and where its gradient vanishes, (dof,)."""
    n = model.ndof
    k = np.arange(1, 2 * n * _POINTS + 1).reshape(2 * n, _POINTS)
    x = (2 * np.modf(k * _GOLDEN)[0] - 1) * np.repeat([0.1, 1.0, 4.0], _POINTS // 3)
    q, p = x[:n], x[n:]
    qq, qp, pp = model.hessian(q, p, t=t)
    own, place = (qq, 0) if letter == "q" else (pp, 1)
    # Numbers are judged beside the diagonal of their row and column: coordinates have units of their own.
    of_q, of_p = (np.sqrt(np.abs(np.einsum("iik->ik", x)).max(axis=1)) for x in (qq, pp))
    deviations = of_q if letter == "q" else of_p
    with np.errstate(invalid="ignore"):  # infinite ones are refused below
        scale = np.outer(deviations, deviations)
        changes = np.abs(own - own[..., :1]).max(axis=2)
    what = "the potential" if letter == "q" else "the kinetic energy"
    if not np.isfinite(own).all() or not own.any() or (changes > _SAME * scale).any():
        raise IncompatibleError(
            f"states.canonical draws {letter} where H is quadratic in it, and {what} of model {model.name} is not: "
            f"give {letter}0 by another law, or let a run in a heat bath come to its equilibrium"
        )
    if (np.abs(qp).max(axis=2) > _SAME * np.outer(of_q, of_p)).any():
        raise IncompatibleError(
            f"states.canonical draws q and p independently, and H of model {model.name} has terms with both: give "
            "another law, or let a run in a heat bath come to its equilibrium"
        )
    stiffness = own[..., 0]
    if (np.diag(stiffness) <= 0).any() or np.linalg.eigvalsh(stiffness / scale).min() <= _SAME:
        raise IncompatibleError(
            f"states.canonical: exp(-beta H) of model {model.name} has no normal law of {letter}, since {what} does "
            f"not grow in every direction: give {letter}0 by another law"
        )
    gradient = model.gradient(q, p, t=t)[place][:, 0]
    return stiffness, (q, p)[place][:, 0] - np.linalg.solve(stiffness, gradient)


def matched(
    emittance: Any,
    *,
    beta: Any = None,
    alpha: Any = None,
    q: Any = 0.0,
    p: Any = 0.0,
    step: float | None = None,
    scheme: str | Scheme | None = None,
    seed: int | None = None,
) -> Matched:
    """A matched Gaussian beam: its ellipse in every plane (q_i, p_i) stays as it is, as far as motion is linear.

        bunch = ss.states.matched(0.01)
        ss.simulate(ring, q0=bunch, p0=bunch, step=0.1, steps=2000, paths=4000)

    <q^2> = emittance beta, <q p> = -emittance alpha, <p^2> = emittance (1 + alpha^2)/beta about the centre q, p.

    - emittance: root of the determinant of the covariance, a number or (dof,), of each plane, or of the mode that has
      most of it if planes are coupled
    - beta, alpha: Twiss parameters, a number or (dof,). Without them they are those of the run's model at the centre:
      of the flow of H, or, given step and scheme ("midpoint" unless given), of the linearised map of a noiseless step
    - q, p: the centre, a state at rest unless beta is given
    - seed: 0 .. 2^64 - 1, by default the run's

    IncompatibleError: motion about the centre is unstable, or two coupled modes have one frequency.
    """
    if step is not None:
        step = checks.finite("step", step)
        scheme = as_scheme("midpoint" if scheme is None else scheme)
    return Matched(emittance, (beta, alpha), (q, p), (step, scheme), seed)


def canonical(beta: float, *, seed: int | None = None) -> Canonical:
    """The canonical law exp(-beta H) of a heat bath, beta = 1/kT, of a Hamiltonian that is quadratic.

        rest = ss.states.canonical(beta=2.0)
        ss.simulate(model, q0=rest, p0=rest, step=0.05, steps=200, paths=1000)
        ss.simulate(pendulum, q0=0.5, p0=rest, step=0.05, steps=200, paths=1000)     # p alone

    As p0 it draws p with the masses of H, as q0 it draws q of a quadratic potential. An H that is not quadratic in what
    is drawn, or has terms in q and p together, is refused with an IncompatibleError: by its Hessian at nine states near
    and far from the origin, at the time of the start.

    seed: 0 .. 2^64 - 1, by default the run's.
    """
    return Canonical(beta, seed)
