# SPDX-License-Identifier: BSD-3-Clause
"""Means of models inside of torch and jax: their derivatives come from the discrete adjoint of every step."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from types import ModuleType
from typing import Any, NamedTuple, Unpack

import numpy as np

from ..errors import IncompatibleError, InvalidArgumentError, WrongShapeError, WrongTypeError
from ..model.definition import Model, require_model
from ..native import checks
from ..native.files import optional
from .gradient import gradient, names_of, refuse_compensated
from .options import RunOptions
from .setup import make_setup

_STATES = ("q0", "p0")


class PathDerivative(NamedTuple):
    """A function of the path and its derivative, as `gradient` takes them."""

    f: Callable  #: f(t, q, p) -> (path,)
    df: Callable  #: df(t, q, p) -> (fq, fp), (time, dof, path) each


class JaxDerivative(PathDerivative):
    """Such a pair that calls jax, which must not be called again from inside of jax."""


def torch_derivative(f: Callable) -> PathDerivative:
    """f and its derivative by torch, for `gradient`: f(t, q, p) -> (path,) is a function of tensors of torch.

        found = ss.gradient(model, ss.torch_derivative(lambda t, q, p: q[1:, 0].square().mean(0)), ["sigma"], ..)

    t is (time,), q and p are (time, dof, path), in double precision. Value i may depend on path i alone.
    """
    torch = optional("torch", "torch")
    _require_function(f)

    def value(t, q, p):
        with torch.no_grad():
            return _tensor_of(torch, f(*map(torch.as_tensor, (t, q, p)))).numpy()

    def derivative(t, q, p):
        with torch.enable_grad():
            state = [torch.tensor(x, requires_grad=True) for x in (q, p)]
            total = _tensor_of(torch, f(torch.as_tensor(t), *state)).sum()
            if not total.requires_grad:
                return np.zeros_like(q), np.zeros_like(p)
            found = torch.autograd.grad(total, state, allow_unused=True)
        return tuple(np.zeros_like(q) if x is None else x.numpy() for x in found)

    return PathDerivative(value, derivative)


def _require_function(f: Any) -> None:
    """Refuse what is no function of (t, q, p)."""
    if not callable(f):
        raise WrongTypeError(f"f = {checks.shown(f)} is no function: give f(t, q, p) -> (path,)")
    checks.takes("f", f, "t", "q", "p")


def _tensor_of(torch: ModuleType, found: Any) -> Any:
    if not isinstance(found, torch.Tensor):
        raise WrongTypeError(f"f returned {checks.shown(found)}: return a tensor of torch, (path,)")
    return found


def jax_derivative(f: Callable) -> PathDerivative:
    """f and its derivative by jax, for `gradient`: f(t, q, p) -> (path,) is a function of arrays of jax.

        found = ss.gradient(model, ss.jax_derivative(lambda t, q, p: (q[1:, 0] ** 2).mean(0)), ["sigma"], ..)

    t is (time,), q and p are (time, dof, path), in double precision. Value i may depend on path i alone.
    """
    jax = optional("jax", "jax")
    _require_function(f)
    slopes = jax.grad(lambda t, q, p: f(t, q, p).sum(), argnums=(1, 2))

    def in_double(function: Callable) -> Callable:
        def call(t, q, p):
            with _double(jax):
                return function(*map(jax.numpy.asarray, (t, q, p)))

        return call

    value, derivative = in_double(f), in_double(slopes)
    return JaxDerivative(lambda *x: np.asarray(value(*x)), lambda *x: tuple(map(np.asarray, derivative(*x))))


def _double(jax: ModuleType) -> Any:
    """Double precision for a while; older versions have it elsewhere."""
    return jax.enable_x64(True) if hasattr(jax, "enable_x64") else jax.experimental.enable_x64(True)


class _Call:
    """E f, or f of each path, as a function of parameters and initial states."""

    def __init__(self, model: Model, f: Any, wrt: Any, given: dict[str, Any], *, by_path: bool):
        require_model(model)
        self.names, self.known = names_of(wrt, model)
        if not self.names:
            raise InvalidArgumentError('wrt is empty: give names, as ["sigma", "q0"]')
        refuse_compensated(given)
        setup = make_setup(model, **given)
        self.model, self.f, self.given, self.by_path = model, f, given, checks.flag("by_path", by_path)
        self.paths, self.ndof = setup.paths, model.ndof
        self.known_as = dict(zip((x for x in self.names if x not in _STATES), self.known, strict=True))

    def in_order(self, given: tuple, named: dict[str, Any]) -> list[Any]:
        """The values of a call, in the order of wrt."""
        left = [name for name in self.names[len(given) :] if name in named]
        if len(given) > len(self.names) or [*self.names[: len(given)], *left] != self.names or len(left) < len(named):
            raise WrongTypeError(
                f"the function takes {', '.join(self.names)}: give each once, in this order or by name"
            )
        return [*given, *(named[name] for name in left)]

    def shapes(self, name: str) -> tuple[tuple[int, ...], ...]:
        """Allowed shapes of a value."""
        n = self.ndof
        if name in _STATES:
            return (), (n,), (n, 1), (n, self.paths)
        sites = self.sites(name)
        return ((sites,),) if sites else ((), (1,), (self.paths,))

    def sites(self, name: str) -> int:
        """The number of sites for which a parameter has numbers; 0 if it has none."""
        value = self.model.parameters.get(self.known_as.get(name))
        return len(value) if isinstance(value, tuple) else 0

    def rows(self, name: str) -> tuple[int, ...]:
        """The shape of derivatives of each path."""
        many = self.ndof if name in _STATES else self.sites(name)
        return (many, self.paths) if many else (self.paths,)

    def check(self, name: str, shape: Sequence[int]) -> None:
        """Refuse a value of another shape."""
        if tuple(shape) not in self.shapes(name):
            told = " or ".join(map(str, dict.fromkeys(self.shapes(name))))
            raise WrongShapeError(f"{name} has shape {tuple(shape)}: give {told}")

    def run(self, values: Sequence[np.ndarray]) -> tuple[np.ndarray, ...]:
        """E f or f of each path; and derivatives of f of each path, (path,) or (dof, path) for each name."""
        given, parameters = dict(self.given), {}
        for name, x in zip(self.names, values, strict=True):
            array = np.array(x, dtype=float)
            self.check(name, array.shape)
            if name in _STATES:
                given[name] = array
            else:
                parameters[name] = float(array.reshape(())) if array.shape in ((), (1,)) else array
        model = self.model.with_parameters(**parameters) if parameters else self.model
        found = gradient(model, self.f, self.names, **given)
        value = found.f if self.by_path else np.asarray(found.value)
        return value, *(found.by_path[name] for name in self.names)

    def pulled(self, rows: Any, weight: Any, shape: tuple[int, ...]) -> Any:
        """Derivatives of sum_i weight_i f_i, or of weight E f, by a value of this shape; arrays of any package."""
        each = rows * (weight if self.by_path else weight / self.paths)
        if shape == each.shape:
            return each
        return (each.sum() if not shape or len(each.shape) == 1 else each.sum(-1)).reshape(shape)


@checks.hinted(*RunOptions.__annotations__)
def torch_function(
    model: Model,
    f: Any,
    wrt: str | Sequence[str] = _STATES,
    *,
    q0: Any,
    p0: Any,
    step: float,
    steps: int,
    by_path: bool = False,
    **options: Unpack[RunOptions],
) -> Callable:
    """E f(path) as a function of tensors of torch, through which backward() goes.

        mean = ss.torch_function(model, "q**2", ["k", "sigma"], q0=1.0, p0=0.0, step=0.05, steps=200, paths=1000)
        loss = (mean(k, sigma) - 0.3) ** 2
        loss.backward()                      # k.grad, sigma.grad

    The function takes the values of wrt in their order, or by name: of parameters a number or (path,), or (site,)
    where the model has one for each site, of q0 and p0 a number, (dof,) or (dof, path). It is a
    `torch.autograd.Function`, whose backward pass is the discrete adjoint of every step (`gradient`). Every call has
    the noise of the seed, so E f is a smooth function. It can be differentiated once. Computed on the processor in
    double precision, returned on the device of the first value.

    - f: a formula, or a pair of functions, as for `gradient`; `torch_derivative` makes one
    - by_path: return f of each path, (path,), instead of the mean
    - the other arguments are those of `gradient`; q0 and p0 that are not in wrt stay as they are
    """
    torch = optional("torch", "torch")
    call = _Call(model, f, wrt, {"q0": q0, "p0": p0, "step": step, "steps": steps, **options}, by_path=by_path)
    function = _torch_class(torch)

    def mean(*given, **named):
        values = call.in_order(given, named)
        return function.apply(
            call, *(x if torch.is_tensor(x) else torch.tensor(x, dtype=torch.float64) for x in values)
        )

    return mean


@functools.cache
def _torch_class(torch: ModuleType) -> Any:
    """The function of torch."""

    class PathMean(torch.autograd.Function):
        @staticmethod
        def forward(ctx, call, *values):
            value, *rows = call.run([x.detach().cpu().numpy() for x in values])
            ctx.call, ctx.rows = call, rows
            ctx.like = [(x.shape, x.dtype, x.device) for x in values]
            kind = functools.reduce(torch.promote_types, [x.dtype for x in values])
            kind = kind if kind.is_floating_point else torch.float64
            return torch.as_tensor(value).to(dtype=kind, device=values[0].device)

        @staticmethod
        @torch.autograd.function.once_differentiable
        def backward(ctx, weight):
            weight = weight.detach().cpu().double().numpy()
            found = [ctx.call.pulled(x, weight, tuple(like[0])) for x, like in zip(ctx.rows, ctx.like, strict=True)]
            return None, *(
                torch.as_tensor(np.ascontiguousarray(x)).to(dtype=like[1], device=like[2])
                for x, like in zip(found, ctx.like, strict=True)
            )

    return PathMean


@checks.hinted(*RunOptions.__annotations__)
def jax_function(
    model: Model,
    f: Any,
    wrt: str | Sequence[str] = _STATES,
    *,
    q0: Any,
    p0: Any,
    step: float,
    steps: int,
    by_path: bool = False,
    **options: Unpack[RunOptions],
) -> Callable:
    """E f(path) as a function of arrays of jax, for jax.grad and jax.jit.

        mean = ss.jax_function(model, "q**2", ["k", "sigma"], q0=1.0, p0=0.0, step=0.05, steps=200, paths=1000)
        jax.grad(mean, argnums=(0, 1))(1.0, 0.4)

    The function takes the values of wrt in their order, or by name: of parameters a number or (path,), or (site,)
    where the model has one for each site, of q0 and p0 a number, (dof,) or (dof, path). It is a `jax.custom_vjp` around
    `jax.pure_callback`: the reverse derivative is the discrete adjoint of every step (`gradient`); jax.vmap runs one
    value after the other. Every call has the noise of the seed, so E f is a smooth function. It can be differentiated
    once. Computed in double precision, returned in the precision of jax: single, unless
    jax.config.update("jax_enable_x64", True) was called.

    - f: a formula, or a pair of functions of NumPy, as for `gradient`; a function of jax cannot be called from inside
      of jax
    - by_path: return f of each path, (path,), instead of the mean
    - the other arguments are those of `gradient`; q0 and p0 that are not in wrt stay as they are
    """
    jax = optional("jax", "jax")
    if isinstance(f, JaxDerivative):
        raise IncompatibleError(
            "f calls jax, and would be called from inside of jax, where it may wait for ever: give a formula, or a "
            "pair of functions of NumPy"
        )
    call = _Call(model, f, wrt, {"q0": q0, "p0": p0, "step": step, "steps": steps, **options}, by_path=by_path)

    def host(kind, *values):
        return tuple(np.asarray(x, kind) for x in call.run([np.asarray(x) for x in values]))

    def forward(*values):
        kind = jax.numpy.result_type(float)
        for name, x in zip(call.names, values, strict=True):
            call.check(name, jax.numpy.shape(x))
        rows = [call.rows(name) for name in call.names]
        shapes = [(call.paths,) if call.by_path else (), *rows]
        out = tuple(jax.ShapeDtypeStruct(x, kind) for x in shapes)
        value, *rows = jax.pure_callback(functools.partial(host, kind), out, *values, vmap_method="sequential")
        return value, (tuple(rows), values)

    def backward(kept, weight):
        rows, values = kept
        return tuple(
            call.pulled(x, weight, jax.numpy.shape(v)).astype(jax.numpy.result_type(v))
            for x, v in zip(rows, values, strict=True)
        )

    mean = jax.custom_vjp(lambda *values: forward(*values)[0])
    mean.defvjp(forward, backward)
    return lambda *given, **named: mean(*map(jax.numpy.asarray, call.in_order(given, named)))
