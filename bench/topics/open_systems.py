# SPDX-License-Identifier: BSD-3-Clause
"""Damped systems beside other packages: the time to a strong error, and to a bias of the stationary law."""

import datetime
import functools
import itertools
import math
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context

import numpy as np
import symsde as ss
from symsde.studies.pages import wrapped
from timing import in_turn

from .memory import TARGET as MEMORY
from .python_calls import grown
from .strong import numba_version, rms, steps_to, told_steps
from .tools import ABSENT, Setting, asked, at_most, table

WELL = "p**2/2 + q**4/4 - q**2/2"
STRONG, BIAS = 1e-4, 1e-3  #: errors to reach
SHARE = 1 / 8  #: share of a peer's time that the library may take for a strong error
BIASED = {"numba BAOAB": 0.5, "OpenMM": 0.2}  #: share of a peer's time that the library may take for the bias
DAMPED = 1.1  #: bound of the time of a damped path-step over that of an undamped one
Q2 = 1.0417972  #: <q^2> at temperature one
OURS = ("chin4a", "gauss_dkdkd")
NAMES = {"double well": "double well", "fpu64": "FPU chain of 64"}
#: scene -> paths for errors; steps of the reference, of our schemes and of splittings; paths for times of ours and of
#: loops
SIZES = {
    "double well": (512, 4096, (32, 64, 128, 256, 512), (256, 1024, 4096), 16384, 256),
    "fpu64": (64, 2048, (64, 128, 256, 512), (256, 1024, 2048), 512, 16),
}
#: scheme -> steps h at which the bias is measured; BAOAB is the library's own, which agrees with the loop to rounding
BIAS_STEPS = {"word:BAOAB": (0.4, 0.2), "gauss_dkdkd": (0.3, 0.15), "chin4a": (0.5, 0.4)}


@functools.cache
def damped(scene: str) -> ss.Model:
    """The model of a scene with gamma = beta = 1."""
    return (
        ss.thermostat(ss.model_from_sympy(WELL), beta=1.0, gamma=1.0) if scene == "double well" else chain().damped(1.0)
    )


def chain() -> ss.Model:
    """64 masses, with the noise of a bath of gamma = beta = 1."""
    return ss.models.fpu_chain(n=64, sigma=math.sqrt(2))


def measure(setting: Setting) -> dict:
    """All rows; peers that are absent are left out."""
    known = {name: asked(setting, "langevin_package.py", name) for name in ("diffrax", "openmm")}
    rows = [row for scene in NAMES for row in strong(scene, known["diffrax"], setting)]
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        memory = {name: pool.submit(growth, name == "damped").result() for name in ("closed", "damped")}
    return {
        "date": datetime.date.today().isoformat(),
        "versions": [*(x["version"] for x in known.values() if x), *numba_version()],
        "absent": [name for name, x in known.items() if not x] + ["numba"] * (not numba_version()),
        "strong": rows,
        "bias": biased(known["openmm"], rows, setting),
        "damped": beside_closed(setting),
        "memory": memory,
    }


# ---- strong errors -------------------------------------------------------------------------------------------------


def strong(scene: str, diffrax: dict | None, setting: Setting) -> list[dict]:
    """Steps to the error, ns of a path-step and us of a path, of the library and of all peers."""
    found, runs = [], {}
    paths, many = SIZES[scene][4:]
    for scheme, errors in our_errors(scene).items():
        steps = math.ceil(steps_to(errors, STRONG)[0])
        found.append({"scene": scene, "package": "symsde", "scheme": scheme, "errors": errors})
        runs[scheme] = partial(end, scene, scheme, steps, paths), paths * steps
    if numba_version():
        from peers import langevin  # noqa: PLC0415

        where, generator, steps = langevin.SCENES[scene], np.random.default_rng(1), 1000 if scene == "fpu64" else 5000
        for name, errors in their_errors(scene).items():
            found.append({"scene": scene, "package": "numba", "scheme": name, "errors": errors})
            run = langevin.loop(name, where)
            loop = partial(run, generator, where.q0, where.p0, where.horizon / steps, steps)
            loop(1)
            runs[name] = partial(loop, many), many * steps
    times = in_turn([run for run, _ in runs.values()], max(3, setting.repeats))
    for row, seconds, (_, size) in zip(found, times, runs.values(), strict=True):
        row["ns"] = 1e9 * min(seconds) / size
    for row in (diffrax or {"rows": []})["rows"]:
        if row["scene"] == scene:
            errors = {int(n): x for n, x in row["errors"].items()}
            found.append({**row, "package": "diffrax", "errors": errors})
    for row in found:
        row["steps"], row["beyond"] = steps_to(row["errors"], STRONG)
        row["us"] = 1e-3 * row["ns"] * math.ceil(row["steps"])
    return found


def end(scene: str, scheme: str, steps: int, paths: int, **more) -> np.ndarray:
    """Final states of the library, (2 dof, path)."""
    start = (1.0, 0.0) if scene == "double well" else (np.sin(np.pi * np.arange(1, 65) / 65), 0.0)
    run = ss.simulate(damped(scene), scheme=scheme, q0=start[0], p0=start[1], step=4.0 / steps, steps=steps,
                      paths=paths, save_every=steps, seed=3, threads=1, **more)  # fmt: skip
    return np.concatenate([run.q[-1], run.p[-1]])


def our_errors(scene: str) -> dict[str, dict[int, float]]:
    """Errors by number of steps, against chin4a at many steps on the same paths."""
    paths, finest, counts = SIZES[scene][:3]
    known = end(scene, "chin4a", finest, paths)
    return {
        scheme: {n: rms(end(scene, scheme, n, paths, refine=(finest // n).bit_length() - 1) - known) for n in counts}
        for scheme in OURS
    }


def their_errors(scene: str) -> dict[str, dict[int, float]]:
    """Errors of the splittings, on the same increments against chin4a; errors of UBU against its own run at many
    steps.
    """
    from peers import langevin  # noqa: PLC0415

    paths, finest, _, counts = SIZES[scene][:4]
    where = langevin.SCENES[scene]
    known = end(scene, "chin4a", finest, paths)
    dw = ss.increments(damped(scene), step=4.0 / finest, steps=finest, paths=paths, seed=3)
    found: dict[str, dict[int, float]] = {"BAOAB": {}, "Strang": {}, "UBU": {}}
    for n in counts:
        summed = dw.reshape(n, finest // n, *dw.shape[1:]).sum(axis=1)
        for name in ("BAOAB", "Strang"):
            found[name][n] = rms(langevin.given(name, where, summed) - known)
    length, (_, _, a, b, c) = 2.0 / finest, langevin.flight(2.0 / finest)
    x, y = np.random.default_rng(5).normal(size=(2, 2 * finest, where.dof, paths))
    noise = np.stack([a * x, b * x + c * y], axis=1)
    known = langevin.given("UBU", where, noise)
    while len(noise) > 2 * min(SIZES[scene][2]):
        noise, length = langevin.flights(noise, length), 2 * length
        if len(noise) // 2 in SIZES[scene][2]:
            found["UBU"][len(noise) // 2] = rms(langevin.given("UBU", where, noise) - known)
    return found


# ---- bias ----------------------------------------------------------------------------------------------------------


def bias_of(scheme: str, step: float, blocks: int) -> tuple[float, float]:
    """Relative bias of <q^2> and its standard error: means of differences to chin4a with a quarter of the step, on the
    same paths, over times from 20 to 60.
    """
    steps, every = round(60 / step / 20) * 20, round(60 / step / 20)
    means = []
    for block in range(blocks):
        runs = [
            ss.simulate(damped("double well"), scheme=name, q0=1.0, p0=0.0, step=step / n, steps=steps * n,
                        save_every=every * n, paths=20_000, seed=block, refine=refine)
            for name, n, refine in ((scheme, 1, 2), ("chin4a", 4, 0))
        ]  # fmt: skip
        coarse, fine = (np.where(run.status == 0, run.q[8:, 0] ** 2, 0.0) for run in runs)
        means.append(float((coarse - fine).mean() / Q2))
    return float(np.mean(means)), float(np.std(means, ddof=1) / math.sqrt(blocks))


def biased(openmm: dict | None, rows: list[dict], setting: Setting) -> list[dict]:
    """Step for the bias, and ns of a walker and unit of time."""
    ns = {("numba", "BAOAB"): None} | {
        (x["package"], x["scheme"]): x["ns"] for x in rows if x["scene"] == "double well"
    }
    found, step_of = [], {}
    for scheme, steps in BIAS_STEPS.items():
        measured = {h: bias_of(scheme, h, 4 if setting.quick else 60) for h in steps}
        by_count = {1 / h: abs(x) for h, (x, _) in measured.items()}
        step_of[scheme] = 1 / steps_to(by_count, BIAS)[0]
        package = ("numba", "BAOAB") if "word" in scheme else ("symsde", scheme)
        if package in ns:
            found.append({"package": package[0], "scheme": package[1], "bias": measured, "ns": ns[package]})
            found[-1]["step"] = step_of[scheme]
    for row in (openmm or {"rows": []})["rows"]:
        bias = {row["step"]: (row["q2"] / Q2 - 1, row["error"] / Q2)} if "q2" in row else {}
        step = step_of["word:BAOAB"]
        found.append({"package": "OpenMM", "scheme": row["scheme"], "bias": bias, "ns": row["ns"], "step": step})
    for row in found:
        row["cost"] = row["ns"] / row["step"]
    return found


# ---- damped beside closed ------------------------------------------------------------------------------------------


def beside_closed(setting: Setting) -> list[dict]:
    """ns of a path-step of the damped model and of the closed one with the same noise, in turn."""
    closed = {"double well": ss.model_from_sympy(WELL, ["-s*q"], params={"s": math.sqrt(2)}), "fpu64": chain()}
    found = []
    for (scene, bare), scheme in itertools.product(closed.items(), OURS):
        paths, steps = (16384, 100) if scene == "double well" else (512, 50)
        start = {"q0": 1.0 if scene == "double well" else 0.0, "p0": 0.0, "step": 0.04, "threads": 1, "seed": 3}
        runs = [
            partial(ss.simulate, model, scheme=scheme, steps=steps, save_every=steps, paths=paths, **start)
            for model in (bare, bare.damped(1.0))
        ]
        for run in runs:
            run()
        ns = [1e9 * min(times) / (paths * steps) for times in in_turn(runs, max(7, setting.repeats))]
        found.append({"scene": scene, "scheme": scheme, "closed": ns[0], "damped": ns[1]})
    return found


def growth(is_damped: bool) -> float:
    """MB by which the peak memory grows in moments of 1,000,000 paths, after a run of few paths."""
    model = ss.models.pendulum().damped(1.0) if is_damped else ss.models.pendulum()
    how = {"q0": 1.0, "p0": 0.0, "step": 0.02, "scheme": "midpoint", "threads": 1, "steps": 20, "save_every": 10}
    ss.moments(model, paths=512, **how)
    return grown(lambda: ss.moments(model, paths=10**6, **how))[0] / 2**20


# ---- words ---------------------------------------------------------------------------------------------------------


ABOUT = """Langevin's equation with $\\gamma = \\beta = 1$ up to $T = 4$: a double well, $U = q^4/4 - q^2/2$ from
$(1, 0)$, and the FPU chain of 64 masses from its slowest wave. Times are those of the processor on one thread. The
loops of `bench/peers/langevin.py` are what an expert writes in numba, with -ffast-math."""
STEPS = """*Steps* are those for a root mean square error of $10^{-4}$ in $(q, p)$ at $T$, by a power law between
measured errors, or beyond them (*). Errors of the library, of BAOAB and of Strang's splitting are those on the same
paths; UBU and diffrax's schemes are compared with their own finest run. *Share* is the time of the library's best
scheme over that of the row."""
BIASES = """*Bias* is that of $\\langle q^2\\rangle$ in the double well at rest, relative. It was measured at two steps,
as the mean difference from chin4a with a quarter of the step on the same paths, and gives the step for $10^{-3}$. BAOAB
and OpenMM's LangevinMiddle have one law of positions, and so one step. OpenMM draws its own noise: it has no row
above."""
GROWTH = "By how much moments of 1000000 paths of a pendulum make the peak memory of a process grow:"


def section(found: dict) -> str:
    """Write the section."""
    absent = f"; {', '.join(found['absent'])}: {ABSENT}" if found["absent"] else ""
    measured = f"Measured on {found['date']}: {', '.join(found['versions'])}{absent}."
    memory = [f"{found['memory'][name]:.2f} MB {name}" for name in ("damped", "closed")]
    parts = [
        "## Damped systems beside other packages",
        wrapped(f"{ABOUT} {measured}"),
        wrapped(STEPS),
        strong_table(found["strong"]),
        wrapped(BIASES),
        bias_table(found["bias"]),
        "A path-step of a damped model beside that of the closed one with the same noise:",
        closed_table(found["damped"]),
        wrapped(f"{GROWTH} {', '.join(memory)}; {MEMORY:g} MB is allowed."),
    ]
    return "\n\n".join(parts)


def strong_table(rows: list[dict]) -> str:
    """The table of times to the strong error; rows of peers have a target."""
    cells = []
    for scene, title in NAMES.items():
        here = [row for row in rows if row["scene"] == scene]
        best = min(row["us"] for row in here if row["package"] == "symsde")
        for row in sorted(here, key=lambda row: row["us"]):
            share = best / row["us"]
            verdict = ["", ""] if row["package"] == "symsde" else at_most(share, SHARE)
            name, told = f"{row['package']} {row['scheme']}", told_steps(row["steps"], row["beyond"])
            cells.append([title, name, told, f"{row['ns']:.3g}", f"{row['us']:.3g}", f"{share:.2g}", *verdict])
    return table(["scene", "scheme", "steps", "ns of a path-step", "us of a path", "share", "target", ""], cells)


def bias_table(rows: list[dict]) -> str:
    """The table of times to the bias."""
    ours = min(row["cost"] for row in rows if row["package"] == "symsde")
    cells = []
    for row in sorted(rows, key=lambda row: row["cost"]):
        bias = "; ".join(f"{1e3 * x:+.2f} +- {1e3 * s:.2f} at {h:g}" for h, (x, s) in row["bias"].items())
        name = f"{row['package']} {row['scheme']}"
        target = next((most for key, most in BIASED.items() if name.startswith(key)), None)
        share = ours / row["cost"]
        verdict = at_most(share, target)
        cells.append(
            [name, bias, f"{row['step']:.3f}", f"{row['ns']:.3g}", f"{row['cost']:.3g}", f"{share:.2g}", *verdict]
        )
    heads = ["scheme", "1000 x bias", "step", "ns of a step", "ns of a walker and unit of time", "share", "target", ""]
    return table(heads, cells)


def closed_table(rows: list[dict]) -> str:
    """The table of damped and closed steps."""
    cells = []
    for row in rows:
        ratio, target = row["damped"] / row["closed"], DAMPED if row["scheme"] == "chin4a" else None
        numbers = f"{row['closed']:.3g}", f"{row['damped']:.3g}", f"{ratio:.2f}"
        cells.append([NAMES[row["scene"]], row["scheme"], *numbers, *at_most(ratio, target)])
    return table(["scene", "scheme", "closed [ns]", "damped [ns]", "ratio", "target", ""], cells)
