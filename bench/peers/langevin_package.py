# SPDX-License-Identifier: BSD-3-Clause
"""Langevin's equation by diffrax and OpenMM, in an interpreter that has them: langevin_package.py diffrax|openmm FILE.

The answer is written to FILE. diffrax 0.7 has ALIGN, ShOULD and QUICSORT for it. Errors are measured on diffrax's own
paths (VirtualBrownianTree) against its own finest run, times with its faster UnsafeBrownianPath, all paths at once by
vmap. OpenMM draws its own noise, and stands in rows of bias alone; its positions are those of BAOAB. Walkers are the
coordinates of particles in an external potential; times are those of OpenMM's platforms in double precision (Reference)
and on one thread (CPU).
"""

import json
import math
import os
import sys
import time
from pathlib import Path

os.environ |= {"OMP_NUM_THREADS": "1", "OPENMM_CPU_THREADS": "1", "JAX_PLATFORMS": "cpu"}
os.environ["XLA_FLAGS"] = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"
if __name__ == "__main__":
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})  # all threads share one processor

HORIZON, MASSES = 4.0, 64
#: scene -> numbers of steps, number of steps of the reference, numbers of paths for errors and for times
STEPS = {"double well": ((16, 32, 64, 128), 512, 256, 1024), "fpu64": ((32, 64, 128), 256, 16, 64)}


def seconds_of(run, repeats=3):
    """Least processor time of warm runs."""
    run()
    found = []
    for _ in range(repeats):
        begin = time.process_time()
        run()
        found.append(time.process_time() - begin)
    return min(found)


def by_diffrax() -> dict:
    """Errors by number of steps, and ns of a path-step."""
    import diffrax  # noqa: PLC0415
    import jax  # noqa: PLC0415
    import jax.numpy as jnp  # noqa: PLC0415

    jax.config.update("jax_enable_x64", True)

    def chain(q, _):
        r = jnp.diff(q, prepend=0.0, append=0.0)
        return -jnp.diff(r + r**3)

    wave = jnp.sin(jnp.pi * jnp.arange(1, MASSES + 1) / (MASSES + 1))
    scenes = {"double well": (lambda q, _: q**3 - q, jnp.ones(1)), "fpu64": (chain, wave)}
    found = {"version": f"diffrax {diffrax.__version__}, jax {jax.__version__}", "rows": []}
    for scene, (slope, q0) in scenes.items():
        counts, finest, few, many = STEPS[scene]
        for scheme, area in (
            (diffrax.ALIGN, diffrax.SpaceTimeLevyArea),
            (diffrax.ShOULD, diffrax.SpaceTimeTimeLevyArea),
            (diffrax.QUICSORT, diffrax.SpaceTimeTimeLevyArea),
        ):

            def ends(path, most, scheme=scheme, slope=slope, q0=q0):
                def one(key, step):
                    drift = diffrax.UnderdampedLangevinDriftTerm(1.0, 1.0, slope)
                    noise = diffrax.UnderdampedLangevinDiffusionTerm(1.0, 1.0, path(key))
                    ys = diffrax.diffeqsolve(
                        diffrax.MultiTerm(drift, noise), scheme(0.1), 0.0, HORIZON, step,
                        (q0, jnp.zeros_like(q0)), saveat=diffrax.SaveAt(t1=True), max_steps=2 * most,
                        adjoint=diffrax.ForwardMode(),
                    ).ys  # fmt: skip
                    return jnp.concatenate([x[-1] for x in ys])

                return jax.jit(jax.vmap(one, in_axes=(0, None)))

            def tree(key, area=area, q0=q0, finest=finest):
                return diffrax.VirtualBrownianTree(
                    0.0, HORIZON, tol=HORIZON / finest / 2, shape=q0.shape, key=key, levy_area=area
                )

            def fast(key, area=area, q0=q0):
                return diffrax.UnsafeBrownianPath(shape=q0.shape, key=key, levy_area=area)

            keys = jax.random.split(jax.random.PRNGKey(1), many)
            slow, timed = ends(tree, finest), ends(fast, counts[1])
            known = slow(keys[:few], HORIZON / finest)
            errors = {}
            for steps in counts:
                apart = slow(keys[:few], HORIZON / steps) - known
                errors[steps] = float(jnp.sqrt((apart**2).sum(axis=1).mean()))
            seconds = seconds_of(lambda run=timed, keys=keys, n=counts[1]: run(keys, HORIZON / n).block_until_ready())
            found["rows"].append(
                {"scene": scene, "scheme": scheme.__name__, "errors": errors, "ns": 1e9 * seconds / (many * counts[1])}
            )
    return found


def by_openmm() -> dict:
    """ns of a walker's step in the double well on each platform, and <q^2> with its error at one step."""
    import numpy as np  # noqa: PLC0415
    import openmm  # noqa: PLC0415

    particles, steps = 8000, 200
    kelvin = 1 / (8.31446261815324e-3)  # kT = 1 kJ/mol; gamma = 1/ps, masses 1 dalton
    found = {"version": f"OpenMM {openmm.Platform.getOpenMMVersion()}", "rows": []}
    for platform in ("Reference", "CPU"):
        system = openmm.System()
        field = openmm.CustomExternalForce("(x^4 + y^4 + z^4)/4 - (x^2 + y^2 + z^2)/2")
        for i in range(particles):
            system.addParticle(1.0)
            field.addParticle(i)
        system.addForce(field)
        step = 0.3
        scheme = openmm.LangevinMiddleIntegrator(kelvin, 1.0, step)
        scheme.setRandomNumberSeed(7)
        properties = {"Threads": "1"} if platform == "CPU" else {}
        context = openmm.Context(system, scheme, openmm.Platform.getPlatformByName(platform), properties)
        context.setPositions(np.ones((particles, 3)))
        scheme.step(60)
        seconds = seconds_of(lambda scheme=scheme: scheme.step(steps))
        means = []
        for _ in range(40 if platform == "Reference" else 0):
            scheme.step(10)
            x = context.getState(getPositions=True).getPositions(asNumpy=True)
            means.append(float((np.asarray(x.value_in_unit(openmm.unit.nanometer)) ** 2).mean()))
        row = {"scheme": f"LangevinMiddle, {platform}", "ns": 1e9 * seconds / (3 * particles * steps)}
        if means:
            row |= {"step": step, "q2": float(np.mean(means)), "error": float(np.std(means) / math.sqrt(len(means)))}
        found["rows"].append(row)
    return found


if __name__ == "__main__":
    Path(sys.argv[2]).write_text(json.dumps({"diffrax": by_diffrax, "openmm": by_openmm}[sys.argv[1]]()))
