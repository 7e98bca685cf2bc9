# SPDX-License-Identifier: BSD-3-Clause
"""The gradients of adjoint.py by diffrax, in an interpreter that has it: adjoint_package.py FILE.

The answer is written to FILE: version, and ns of a path-step for each way. Heun's rule, all paths at once by vmap,
jitted, in double precision on one thread; on UnsafeBrownianPath, or VirtualBrownianTree where the way needs it. "jax
scan" is a loop of one's own over drawn increments, differentiated in reverse.
"""

import json
import os
import sys
import time
from pathlib import Path

os.environ |= {"OMP_NUM_THREADS": "1", "JAX_PLATFORMS": "cpu"}
os.environ["XLA_FLAGS"] = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"
if __name__ == "__main__":
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})  # all threads share one processor

STEPS, PATHS, STEP, START, VALUES = 1000, 1000, 0.01, (0.7, 0.3), (1.3, 0.4)


def main(file: str, paths: int = PATHS) -> None:
    """Measure every way."""
    import diffrax  # noqa: PLC0415
    import jax  # noqa: PLC0415
    import jax.numpy as jnp  # noqa: PLC0415

    jax.config.update("jax_enable_x64", True)
    keys = jax.random.split(jax.random.PRNGKey(1), paths)

    def tree(key):
        return diffrax.VirtualBrownianTree(0.0, STEP * STEPS, tol=STEP / 2, shape=(1,), key=key)

    def fast(key):
        return diffrax.UnsafeBrownianPath(shape=(1,), key=key)

    def value(theta, noise, adjoint):
        k, sigma = theta
        terms = diffrax.MultiTerm(
            diffrax.ODETerm(lambda t, z, args: jnp.stack([z[1], -k * jnp.sin(z[0])])),
            diffrax.ControlTerm(lambda t, z, args: jnp.stack([0.0, -sigma * jnp.cos(z[0])])[:, None], noise),
        )
        ys = diffrax.diffeqsolve(
            terms, diffrax.Heun(), 0.0, STEP * STEPS, STEP, jnp.array(START), saveat=diffrax.SaveAt(t1=True),
            max_steps=2 * STEPS, adjoint=adjoint,
        ).ys  # fmt: skip
        return ys[-1, 0] ** 2

    def by_scan(theta):
        k, sigma = theta

        def force(q, dw):
            return -k * STEP * jnp.sin(q) - sigma * dw * jnp.cos(q)

        def step(z, dw):
            q, p = z
            there, then = q + STEP * p, p + force(q, dw)
            return (q + 0.5 * STEP * (p + then), p + 0.5 * (force(q, dw) + force(there, dw))), None

        def one(key):
            dw = jnp.sqrt(STEP) * jax.random.normal(key, (STEPS,), dtype=jnp.float64)
            return jax.lax.scan(step, START, dw)[0][0] ** 2

        return jax.vmap(one)(keys).mean()

    def mean(theta, path, adjoint):
        return jax.vmap(lambda key: value(theta, path(key), adjoint))(keys).mean()

    ways = {
        "RecursiveCheckpointAdjoint": jax.jit(jax.grad(lambda x: mean(x, tree, diffrax.RecursiveCheckpointAdjoint()))),
        "DirectAdjoint": jax.jit(jax.grad(lambda x: mean(x, tree, diffrax.DirectAdjoint()))),
        "ForwardMode": jax.jit(jax.jacfwd(lambda x: mean(x, fast, diffrax.ForwardMode()))),
        "jax scan": jax.jit(jax.grad(by_scan)),
    }
    found, theta = {}, jnp.array(VALUES)
    for name, way in ways.items():
        way(theta).block_until_ready()  # compile
        begin = time.process_time()
        way(theta).block_until_ready()
        found[name] = 1e9 * (time.process_time() - begin) / (STEPS * paths)
    version = f"diffrax {diffrax.__version__}, jax {jax.__version__}"
    Path(file).write_text(json.dumps({"version": version, "ns": found}))


if __name__ == "__main__":
    main(sys.argv[1], *map(int, sys.argv[2:]))
