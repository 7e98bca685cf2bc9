# SPDX-License-Identifier: BSD-3-Clause
"""`symsde selftest`: check in a few seconds that this library computes correctly on this machine."""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from .. import diagnose, models, schemes
from ..errors import SymsdeError
from ..native import cpu, library
from ..native.build import build_info
from ..run.moments import moments
from ..run.simulate import simulate
from ..run.step import increments, step
from ..show import tables
from ..studies.convergence import convergence

HELP = "Check in a few seconds that the installed library computes what it should."
#: dW of two steps of h = 1/4 for three paths with seed 20260101; all machines agree except for the last digits.
_KNOWN = [
    [-0.26431786546106306, 0.6331749988461696, -0.14230216470286533],
    [0.0744672069475869, -0.2072674808496655, 0.763549124834455],
]
_START = {"q0": 1.0, "p0": 0.0}


@dataclass(frozen=True)
class Check:
    """One check: its title, its result, and whether the result is correct."""

    name: str
    found: str
    good: bool


def noise() -> Check:
    """Compare the random generator and its map of counters with recorded numbers."""
    dw = increments(_kubo(), step=0.25, steps=2, paths=3, seed=20260101)
    worst = np.abs(dw[:, 0, :] - _KNOWN).max()
    return Check("noise", f"six increments agree with known numbers to {worst:.0e}", bool(worst < 1e-14))


def one_step() -> Check:
    """A step of midpoint rotates the Kubo oscillator by 2 atan((h + sigma dW)/2)."""
    dw = np.linspace(-0.5, 0.5, 64)
    q, p = step(_kubo(), "midpoint", 1.0, 0.0, 0.1, dw=dw[np.newaxis])
    angle = 2 * np.arctan((0.1 + 0.3 * dw) / 2)
    worst = max(np.abs(q[0] - np.cos(angle)).max(), np.abs(p[0] + np.sin(angle)).max())
    return Check("one step", f"a step of midpoint is a rotation to {worst:.0e}", bool(worst < 1e-14))


def structure() -> Check:
    """A step of a symplectic scheme is symplectic, a step of heun is not."""
    model = models.get("pendulum")
    worst = max(diagnose.symplecticity(model, name)[0] for name in ("midpoint", "stormer_verlet", "gauss2"))
    heun = diagnose.symplecticity(model, "heun")[0]
    return Check(
        "structure",
        f"three schemes are symplectic to {worst:.0e}, Heun to {heun:.0e}",
        bool(worst < 1e-12 and heun > 1e-6),
    )


def order() -> Check:
    """Midpoint has strong order 1, compared with the exact solution on the same Brownian paths."""
    found = convergence(_kubo(), "midpoint", **_START, paths=200, steps=(16, 32, 64, 128))
    return Check("order", f"midpoint converges with order {found.order:.2f}", bool(abs(found.order - 1) < 0.2))


def mean() -> Check:
    """E q(t) = exp(-sigma^2 t/2) cos t of the Kubo oscillator, from 20,000 paths, within six standard errors."""
    found = moments(_kubo(), **_START, step=0.02, steps=100, paths=20_000, seed=1, save_every=100)
    away = (found.mean_q[1, 0] - np.exp(-0.045 * 2) * np.cos(2.0)) / found.se_mean_q[1, 0]
    good = abs(away) < 6 and abs(found.se_mean_q[1, 0] * np.sqrt(20_000) - 0.37) < 0.1
    return Check("mean", f"the mean is {abs(away):.1f} standard errors from the exact one", bool(good))


def resume() -> Check:
    """A run in two parts has the same bits as one run."""
    options = {"step": 0.02, "paths": 33, "seed": 3}
    whole = simulate(_kubo(), **_START, steps=200, save_every=100, **options)
    half = simulate(_kubo(), q0=whole.q[1], p0=whole.p[1], steps=100, save_every=100, first_step=100, **options)
    same = np.array_equal(whole.q[2], half.q[1]) and np.array_equal(whole.p[2], half.p[1])
    return Check(
        "resume",
        "a run in two parts has the bits of one" if same else "a run in two parts has other bits than one",
        bool(same),
    )


def threads() -> Check:
    """Threads and block sizes change no bit."""
    options = {**_START, "step": 0.02, "steps": 100, "paths": 3000, "seed": 4, "save_every": 100}
    one, several = (simulate(_kubo(), threads=n, lanes=lanes, **options) for n, lanes in ((1, 64), (4, 24)))
    same = np.array_equal(one.q, several.q) and np.array_equal(one.p, several.p)
    used = several.report.threads
    found = f"{used} threads compute the bits of one" if same else f"{used} threads compute other bits than one"
    return Check("threads", found, bool(same and one.report.threads == 1))


def variant() -> Check:
    """The loaded library is the chosen one: by SYMSDE_LIBRARY, else the best that the processor can run."""
    found, first = library.found(), library.candidates()[0]
    known = {"midpoint", "stormer_verlet"} <= set(schemes.names())
    levels = [name for name in cpu.LEVELS if f"x86-64-{name}" in str(found)]
    is_wheel = (library.package() / "glibc-hwcaps").is_dir() and "SYMSDE_LIBRARY" not in os.environ
    level = (levels or [cpu.BASELINE])[0] if is_wheel else "no variants"
    text = f"{level}, version {build_info().get('version', '?')}, {found}"
    if is_wheel and found != first:
        text += f", where this processor could have {first}"
    elif is_wheel and not cpu.flags_are_known():
        text += "; what else this processor could run is not known, since there is no /proc/cpuinfo"
    return Check("variant", text, bool(known and not (is_wheel and found != first)))


CHECKS: tuple[Callable[[], Check], ...] = (noise, one_step, structure, order, mean, resume, threads, variant)


def checks() -> Iterator[Check]:
    """Give the results of all checks; a check that raises an error has failed."""
    for check in CHECKS:
        try:
            yield check()
        except SymsdeError as error:
            yield Check(check.__name__.replace("_", " "), str(error), False)


def selftest() -> bool:
    """Print one line for each check of the installed library, and return whether all passed."""
    start, wrong = time.monotonic(), []
    for check in checks():
        cells = ["ok" if check.good else "FAILED", check.name, check.found]
        print(tables.aligned([cells], (-8, -11, 0), ""), flush=True)
        wrong += [] if check.good else [check.name]
    seconds = time.monotonic() - start
    print(f"{len(CHECKS) - len(wrong)} of {len(CHECKS)} checks passed in {seconds:.1f} s")
    return not wrong


def run(_options: argparse.Namespace) -> int:
    """Execute the verb; return 0, or 1 if a check failed."""
    return int(not selftest())


def _kubo():
    return models.kubo(a=1.0, sigma=0.3)
