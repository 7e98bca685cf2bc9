# SPDX-License-Identifier: BSD-3-Clause
"""diffrax (P. Kidger): jitted, all paths at once by vmap, in double precision on the CPU."""

from __future__ import annotations

import os

os.environ.setdefault("XLA_FLAGS", "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1")
os.environ.setdefault("JAX_PLATFORMS", "cpu")

import diffrax
import jax
import jax.numpy as jnp
import numpy as np

from .equations import Problem
from .prepared import Prepared

jax.config.update("jax_enable_x64", True)
VERSION = f"diffrax {diffrax.__version__}, jax {jax.__version__}"
FINE = 4  #: ShARK's own reference has so many times the finest steps


class _Slope(diffrax.AbstractTerm):
    """Drift and noises of a step as one term, with given increments."""

    problem: Problem
    w: jax.Array  #: (step, noise)
    h: float

    def vf(self, t, y, args):
        return y

    def contr(self, t0, t1, **kwargs):
        return self.w[jnp.round(t0 / self.h).astype(int)]

    def prod(self, vf, control):
        dof = self.problem.dof
        return jnp.concatenate(self.problem.slope(jnp, vf[:dof], vf[dof:], self.h, control))


def _solve(problem: Problem, term, solver, steps: int):
    start = jnp.array([*problem.q0, *problem.p0])
    return diffrax.diffeqsolve(
        term, solver, t0=0.0, t1=problem.horizon, dt0=problem.horizon / steps, y0=start,
        saveat=diffrax.SaveAt(t1=True), max_steps=2 * steps, adjoint=diffrax.ForwardMode(),
    ).ys[0]  # fmt: skip


def heun(problem: Problem, steps: int, dw: np.ndarray) -> Prepared:
    """Heun's rule on the increments that all packages get."""
    h = problem.horizon / steps
    given = jnp.asarray(np.ascontiguousarray(dw.transpose(2, 0, 1)))
    many = jax.jit(jax.vmap(lambda w: _solve(problem, _Slope(problem, w, h), diffrax.Heun(), steps)))
    return Prepared(lambda: np.asarray(many(given)).T, dw.shape[2])


def shark(problem: Problem, steps: int, dw: np.ndarray) -> Prepared | None:
    """ShARK (order 3/2 for additive noise) on paths of its own; its error is the distance from its own run at finer
    steps.
    """
    if not problem.additive:
        return None
    dof, keys = problem.dof, jax.random.split(jax.random.PRNGKey(7), dw.shape[2])
    strength = jnp.concatenate([jnp.zeros((dof, dof)), problem.strength * jnp.eye(dof)])
    still = jnp.zeros(problem.noises)

    def drift(t, z, args):
        return jnp.concatenate(problem.slope(jnp, z[:dof], z[dof:], 1.0, still))

    def many(number: int, brownian):
        def one(key):
            noise = diffrax.ControlTerm(lambda t, z, args: strength, brownian(key))
            return _solve(problem, diffrax.MultiTerm(diffrax.ODETerm(drift), noise), diffrax.ShARK(), number)

        return jax.jit(jax.vmap(one))

    def tree(key):
        finest = problem.horizon / (FINE * max(problem.steps))
        return diffrax.VirtualBrownianTree(
            0.0, problem.horizon, tol=finest / 2, shape=(dof,), key=key, levy_area=diffrax.SpaceTimeLevyArea
        )

    def fast(key):
        return diffrax.UnsafeBrownianPath(shape=(dof,), key=key, levy_area=diffrax.SpaceTimeLevyArea)

    few = keys[: max(16, len(keys) // 16)]
    apart = np.asarray(many(steps, tree)(few)) - np.asarray(many(FINE * max(problem.steps), tree)(few))
    error = float(np.sqrt(np.square(apart).sum(axis=1).mean()))
    timed = many(steps, fast)

    def run():
        timed(keys).block_until_ready()

    return Prepared(run, len(keys), error=error)


SCHEMES = {"Heun": heun, "ShARK": shark}
