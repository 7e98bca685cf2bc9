# SPDX-License-Identifier: BSD-3-Clause
"""A sweep of Kubo's oscillator by jax and by diffrax, in an interpreter that has them: sweep_package.py FILE.

The answer is written to FILE: version, and seconds of each way. Heun's rule for 1,000 values of sigma, 100 paths each,
and 200 steps, all at once by vmap, jitted, in double precision on one thread; means of q at the end are kept.
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

VALUES, PATHS, STEPS, STEP, A = 1000, 100, 200, 0.05, 1.0


def main(file: str, values: int = VALUES) -> None:
    """Measure both ways."""
    import diffrax  # noqa: PLC0415
    import jax  # noqa: PLC0415
    import jax.numpy as jnp  # noqa: PLC0415

    jax.config.update("jax_enable_x64", True)
    sigmas = jnp.linspace(0.5, 1.5, values)
    keys = jax.random.split(jax.random.PRNGKey(1), values * PATHS).reshape(values, PATHS, -1)
    start = jnp.array([1.0, 0.0])

    def turn(z):
        return jnp.stack([z[1], -z[0]])

    def by_scan(sigma, key):
        """dz = turn(z) (a dt + sigma o dW) by a loop of one's own."""
        dw = jnp.sqrt(STEP) * jax.random.normal(key, (STEPS,), dtype=jnp.float64)

        def step(z, dw):
            angle = A * STEP + sigma * dw
            k = angle * turn(z)
            return z + 0.5 * (k + angle * turn(z + k)), None

        return jax.lax.scan(step, start, dw)[0][0]

    def by_diffrax(sigma, key):
        noise = diffrax.UnsafeBrownianPath(shape=(), key=key)
        terms = diffrax.MultiTerm(
            diffrax.ODETerm(lambda t, z, args: A * turn(z)),
            diffrax.ControlTerm(lambda t, z, args: sigma * turn(z), noise),
        )
        return diffrax.diffeqsolve(
            terms, diffrax.Heun(), 0.0, STEP * STEPS, STEP, start, saveat=diffrax.SaveAt(t1=True), max_steps=2 * STEPS,
            adjoint=diffrax.ForwardMode(),
        ).ys[-1, 0]  # fmt: skip

    found, kept = {}, {}
    for name, path in (("jax scan", by_scan), ("diffrax", by_diffrax)):
        many = jax.jit(jax.vmap(lambda s, k, path=path: jax.vmap(lambda key: path(s, key))(k).mean()))
        kept[name] = many(sigmas, keys).block_until_ready()  # compile
        begin = time.process_time()
        many(sigmas, keys).block_until_ready()
        found[name] = time.process_time() - begin
    exact = jnp.exp(-0.5 * sigmas**2 * STEP * STEPS) * jnp.cos(A * STEP * STEPS)
    for name, means in kept.items():
        if not abs(float((means - exact).mean())) < 0.02:
            raise ValueError(f"{name} has other means than Kubo's oscillator")
    version = f"diffrax {diffrax.__version__}, jax {jax.__version__}"
    Path(file).write_text(json.dumps({"version": version, "seconds": found}))


if __name__ == "__main__":
    main(sys.argv[1], *map(int, sys.argv[2:]))
