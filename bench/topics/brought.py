# SPDX-License-Identifier: BSD-3-Clause
"""Closed scenes that users bring beside loops in numba: the time to a strong error, and of a step of one scheme."""

import datetime
import functools
import math
import time
import warnings
from functools import partial

import numpy as np
import symsde as ss
from symsde.studies.pages import wrapped
from timing import in_turn

from .strong import numba_version, rms, steps_to, told_steps
from .tools import ABSENT, Setting, at_most, table

ERRORS = (1e-3, 1e-5)
SCHEMES = ("midpoint", "stormer_verlet", "gauss_dkdkd", "gauss_dkdkd_strong2", "chin4a", "chin4a_strong2")
#: a scheme for the reference, the first that the scene allows
REFERENCES = ("chin4a_strong2", "chin4a", "gauss_dkdkd_strong2", "gauss2_strong32")
FINEST, COUNTS = 8192, (16, 32, 64, 128, 256, 512, 1024)
STEPS, LATTICE = 512, 16  #: steps of runs that are timed; degrees of freedom from which they have fewer paths
SINGLE = 2**15  #: steps times degrees of freedom of a path that is timed alone
SAME = {"stormer_verlet": "Strang", "gauss_dkdkd": "Gauss"}  #: scheme -> the loop with as many kicks
#: (scene, loop) -> share of its time that the library may take for each error; 1 for all others
TARGETS = {
    ("magnetic field", "Gauss"): (1.2, 1.2),
    ("Schroedinger lattice of 16", "Heun"): (1 / 15, None),
    ("Schroedinger lattice of 16", "Strang"): (1 / 40, None),
}


@functools.cache
def model(scene: str) -> ss.Model:
    """The library's model, by formula."""
    from peers import brought  # noqa: PLC0415

    where = brought.SCENES[scene]
    return ss.model_from_sympy(where.H, list(where.noise), **where.more)


def paths_of(scene: str) -> int:
    """Paths for errors: as many as make 128 degrees of freedom, at least 16."""
    from peers import brought  # noqa: PLC0415

    return max(16, 128 // brought.SCENES[scene].dof)


def end(scene: str, scheme: str, steps: int, paths: int, **more) -> np.ndarray:
    """Final states of the library, (2 dof, path)."""
    from peers import brought  # noqa: PLC0415

    where = brought.SCENES[scene]
    run = ss.simulate(model(scene), scheme=scheme, q0=where.q0, p0=where.p0, step=where.horizon / steps, steps=steps,
                      paths=paths, save_every=steps, seed=3, threads=1, **more)  # fmt: skip
    return np.concatenate([run.q[-1], run.p[-1]])


def alone(scene: str, scheme: str) -> tuple[functools.partial, int]:
    """A run of one path, which goes on with the steps of the others, and its number of steps."""
    from peers import brought  # noqa: PLC0415

    where = brought.SCENES[scene]
    steps, step = SINGLE // where.dof, where.horizon / STEPS
    how = {"q0": where.q0, "p0": where.p0, "step": step, "steps": steps, "save_every": steps, "threads": 1}
    return partial(ss.simulate, model(scene), scheme=scheme, paths=1, seed=3, **how), steps


def allowed(scene: str, schemes: tuple[str, ...]) -> list[str]:
    """The schemes that run the scene."""

    def runs(scheme: str) -> bool:
        try:
            end(scene, scheme, COUNTS[-1], 1)
        except ss.SymsdeError:
            return False
        return True

    return [scheme for scheme in schemes if runs(scheme)]


def measure(setting: Setting) -> dict:
    """All rows; without numba there are none."""
    warnings.simplefilter("ignore")  # large steps are meant
    rows, advice = [], []
    if numba_version():
        from peers import brought  # noqa: PLC0415

        rows = [row for scene in brought.SCENES for row in measured(scene, setting)]
        advice = [advised(scene, error) for scene in brought.SCENES for error in ERRORS]
    told = {"date": datetime.date.today().isoformat(), "versions": numba_version()}
    return {**told, "rows": rows, "advice": advice}


def advised(scene: str, error: float) -> dict:
    """What `ss.advise` says for an error, and in how many seconds."""
    from peers import brought  # noqa: PLC0415

    where, begin = brought.SCENES[scene], time.process_time()
    found = ss.advise(model(scene), q0=where.q0, p0=where.p0, horizon=where.horizon, tolerance=error)
    took = time.process_time() - begin
    return {"scene": scene, "error": error, "scheme": found.scheme, "steps": found.steps, "seconds": took}


def measured(scene: str, setting: Setting) -> list[dict]:
    """Errors by number of steps and ns of a path-step, of the library's schemes and of the loops."""
    from peers import brought  # noqa: PLC0415

    where, paths = brought.SCENES[scene], paths_of(scene)
    known = end(scene, allowed(scene, REFERENCES)[0], FINEST, paths)
    found, runs, many = [], [], (1024 if where.dof < LATTICE else 256) // (8 if setting.quick else 1)
    for scheme in allowed(scene, SCHEMES):
        errors = {n: rms(end(scene, scheme, n, paths, refine=(FINEST // n).bit_length() - 1) - known) for n in COUNTS}
        found.append({"scene": scene, "package": "symsde", "scheme": scheme, "errors": errors})
        runs.append((partial(end, scene, scheme, STEPS, many), many * STEPS))
    ours = {row["scheme"]: row["errors"] for row in found}
    generator = np.random.default_rng(1)
    for name in where.loops:  # the library's kicks are the loop's, to rounding
        errors = ours["gauss_dkdkd"] if name == "Gauss" and "gauss_dkdkd" in ours else theirs(scene, name, known)
        found.append({"scene": scene, "package": "numba", "scheme": name, "errors": errors})
        run = partial(brought.loop(name, where), generator, where.q0, where.p0, where.horizon / STEPS, STEPS)
        run(1)
        runs.append((partial(run, many // 8), many // 8 * STEPS))
    runs += [alone(scene, row["scheme"]) for row in found if row["package"] == "symsde"]
    times = in_turn([run for run, _ in runs], 1 if setting.quick else max(3, setting.repeats))
    for row, seconds, (_, size) in zip(found, times[len(found) :], runs[len(found) :], strict=False):
        row["alone"] = 1e9 * min(seconds) / size
    for row, seconds, (_, size) in zip(found, times, runs, strict=False):
        row["ns"] = 1e9 * min(seconds) / size
        row["to"] = [steps_to(row["errors"], error) for error in ERRORS]
        row["us"] = [1e-3 * row["ns"] * math.ceil(steps) for steps, _ in row["to"]]
    return found


def theirs(scene: str, name: str, known: np.ndarray) -> dict[int, float]:
    """Errors of a loop on the library's increments dW. Gauss takes integrals dZ of its own, and is compared with its
    run of the finest steps.
    """
    from peers import brought  # noqa: PLC0415

    where, found = brought.SCENES[scene], {}
    how = {"step": where.horizon / FINEST, "steps": FINEST, "paths": paths_of(scene), "seed": 3}
    dw = ss.increments(model(scene), **how)
    means = np.random.default_rng(2).normal(dw / 2, math.sqrt(how["step"] / 12))  # dZ/h, of W(s) - W(t) over a step
    if name == "Gauss":
        known = brought.given(name, where, kicks(dw, means))
    for n in COUNTS:
        w, mean = (x.reshape(n, FINEST // n, *x.shape[1:]) for x in (dw, means))
        noise = w.sum(axis=1)
        if name == "Gauss":
            noise = kicks(noise, (np.cumsum(w, axis=1) - w + mean).mean(axis=1))
        found[n] = rms(brought.given(name, where, noise) - known)
    return found


def kicks(dw: np.ndarray, mean: np.ndarray) -> np.ndarray:
    """Weights of the noises at both of Gauss' nodes, those of the first before those of the second."""
    a = math.sqrt(3) * (mean - dw / 2)
    return np.concatenate([dw / 2 + a, dw / 2 - a], axis=1)


# ---- words ---------------------------------------------------------------------------------------------------------


ABOUT = """Closed scenes of `bench/peers/brought.py`, by formula, up to $T = 4$: a double well with noises $q$ and
$q^2$; two Duffing oscillators with three noises; three bodies in a plane; a $\\phi^4$ ring of 64 with noise
$0.1\\,q_k^2$ at each site; a charge in a magnetic field with additive noise; a discrete nonlinear Schrödinger ring of
16 with phase noise at each site. Loops are what an expert writes in numba, with -ffast-math: one kick with dW between
exact drifts (Strang), two kicks with dZ (Gauss), Heun's rule for the ring. Times are those of the processor on one
thread."""
STEPS_TOLD = """*Steps* are those for a root mean square error in $(q, p)$ at $T$, by a power law between measured
errors, or beyond them (*), on the same paths. *Share* is the time of the library's best scheme over that of the row."""

ONE_SCHEME = """Each scheme by itself, ns of a path-step of all the paths and of one path alone. *Loop* is the one in
numba with as many kicks, path after path."""


def section(found: dict) -> str:
    """Write the section."""
    measured_with = ", ".join(found["versions"]) or f"numba: {ABSENT}"
    return "\n\n".join([
        "## Scenes that users bring",
        wrapped(f"{ABOUT} Measured on {found['date']}: {measured_with}."),
        wrapped(STEPS_TOLD),
        *(strong_table(found["rows"], i) for i in range(len(ERRORS))),
        wrapped(ONE_SCHEME),
        scheme_table(found["rows"]),
        "`ss.advise`, which tries schemes on few paths:",
        advice_table(found["advice"]),
    ])  # fmt: skip


def strong_table(rows: list[dict], i: int) -> str:
    """The table of times to an error: the library's best scheme and all loops; loops have a target."""
    cells = []
    for scene in dict.fromkeys(row["scene"] for row in rows):
        here = [row for row in rows if row["scene"] == scene]
        best = min((row for row in here if row["package"] == "symsde"), key=lambda row: row["us"][i])
        for row in [best, *(row for row in here if row["package"] != "symsde")]:
            share = best["us"][i] / row["us"][i]
            target = None if row is best else TARGETS.get((scene, row["scheme"]), (1, 1))[i]
            name, times = f"{row['package']} {row['scheme']}", (f"{row['ns']:.3g}", f"{row['us'][i]:.3g}")
            cells.append([scene, name, told_steps(*row["to"][i]), *times, f"{share:.2g}", *at_most(share, target)])
    heads = ["scene", "scheme", f"steps to {ERRORS[i]:g}", "ns of a path-step", "us of a path", "share", "target", ""]
    return table(heads, cells)


def scheme_table(rows: list[dict]) -> str:
    """The table of path-steps of each scheme of the library, beside the loop with as many kicks."""
    loops = {(row["scene"], row["scheme"]): row["ns"] for row in rows if row["package"] != "symsde"}
    cells = []
    for row in (row for row in rows if row["package"] == "symsde"):
        loop = loops.get((row["scene"], SAME.get(row["scheme"])))
        beside = ["", ""] if loop is None else [f"{loop:.3g}", f"{row['ns'] / loop:.2g}"]
        cells.append([row["scene"], row["scheme"], f"{row['ns']:.3g}", f"{row['alone']:.3g}", *beside])
    return table(["scene", "scheme", "paths [ns]", "one path [ns]", "loop [ns]", "paths / loop"], cells)


def advice_table(advice: list[dict]) -> str:
    """The table of what is advised, and of the time that it takes."""
    heads = ["scene", "error", "scheme", "steps", "seconds"]
    return table(heads, [[x["scene"], f"{x['error']:g}", x["scheme"], str(x["steps"]), f"{x['seconds']:.2g}"]
                         for x in advice])  # fmt: skip
