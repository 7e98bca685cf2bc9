# SPDX-License-Identifier: BSD-3-Clause
"""Gradients by the exact adjoint of every step, beside the forward run and beside other packages."""

import datetime
from functools import partial

import numpy as np
import symsde as ss
from symsde.studies.pages import wrapped
from timing import in_turn

from . import machine
from .strong import numba_version
from .tools import ABSENT, Setting, asked, at_most, table

PEERS = {"diffrax": "adjoint_package.py", "torchsde": "adjoint_torchsde.py"}  #: package -> program of bench/peers
K, SIGMA, START, STEP = 1.3, 0.4, {"q0": 0.7, "p0": 0.3}, 0.01
STEPS, PATHS = 1000, 1000
SCHEMES = ("stormer_verlet", "gauss_dkdkd", "chin4a", "midpoint", "gauss2")
FORWARD = {"stormer_verlet": 2.7}  #: forward runs that a gradient may take
#: row -> share of its time that the library's stormer_verlet may take
SHARES = {
    "numba, by hand": 1.0,
    "diffrax RecursiveCheckpointAdjoint": 1 / 40,
    "torchsde adjoint, reversible_heun": 1 / 40,
    "torchsde adjoint, midpoint": 1 / 40,
}
SITES = 64  #: of the chain, whose gradients by a number for each spring and by one for all are compared


def model() -> ss.Model:
    """The noisy pendulum."""
    return ss.model_from_sympy("p**2/2 - k*cos(q)", ["sigma*sin(q)"], params={"k": K, "sigma": SIGMA})


def measure(setting: Setting) -> dict:
    """All rows, in ns of a path-step; peers that are absent are left out."""
    runs = {}
    for scheme in SCHEMES:
        how = {**START, "step": STEP, "steps": STEPS, "paths": PATHS, "seed": 1, "threads": 1, "scheme": scheme}
        runs[scheme] = partial(ss.gradient, model(), "q**2", ["k", "sigma"], **how)
        runs[f"{scheme} forward"] = partial(ss.simulate, model(), **how, save_every=STEPS)
    if numba_version():
        from peers import adjoint  # noqa: PLC0415

        start = START["q0"], START["p0"]
        runs["numba, by hand"] = partial(adjoint.run, np.random.default_rng(1), *start, K, SIGMA, STEP, STEPS, PATHS)
    for run in runs.values():
        run()  # compile
    times = in_turn(runs.values(), max(3, setting.repeats))
    found = {name: 1e9 * min(x) / (STEPS * PATHS) for name, x in zip(runs, times, strict=True)}
    versions = [*numba_version()]
    for package, program in PEERS.items():
        if peer := asked(setting, program):
            found |= {name if name == "jax scan" else f"{package} {name}": ns for name, ns in peer["ns"].items()}
            versions.append(peer["version"])
    told = {"date": datetime.date.today().isoformat(), "cpu": machine.describe(setting)["cpu"]}
    return {**told, "versions": versions, "ns": found, "sites": of_sites(max(3, setting.repeats))}


def chain(springs: float | np.ndarray) -> ss.Model:
    """A chain of Fermi, Pasta, Ulam and Tsingou with one spring constant, or one for each spring."""
    k = "k[i]" if np.ndim(springs) else "k"
    energy = f"Sum(p[i]**2/2, i) + Sum({k}*(q[i+1]-q[i])**2/2 + beta*(q[i+1]-q[i])**4/4, i)"
    given = {"n": SITES, "ends": "periodic", "params": {"k": springs, "beta": 0.25, "sigma": 0.1}}
    return ss.model_from_sympy(energy, noise=["sigma*q[j]"], **given)


def of_sites(repeats: int) -> dict[str, float]:
    """Seconds of gradients of the chain by two parameters, and by all springs; q0 and p0 beside."""
    q0 = np.sin(2 * np.pi * np.arange(SITES) / SITES)
    how = {"q0": q0, "p0": 0.0, "step": 0.05, "steps": 200, "paths": 256, "seed": 1, "threads": 1}
    how["scheme"] = "stormer_verlet"
    names = {"two": (chain(1.0), ["k", "beta"]), "springs": (chain(np.ones(SITES)), ["k"])}
    runs = [partial(ss.gradient, model, "q_1**2", [*wrt, "q0", "p0"], **how) for model, wrt in names.values()]
    for run in runs:
        run()  # compile
    return {name: min(x) for name, x in zip(names, in_turn(runs, repeats), strict=True)}


ABOUT = """$d/dk$ and $d/d\\sigma$ of $E\\,q(T)^2$ for the noisy pendulum, $H = p^2/2 - k \\cos q$ and
$H_1 = \\sigma \\sin q$, by formula: 1000 steps of 1000 paths, ns of processor time for a step of a path on one thread,
the least of repeats. *Forward* is the run without derivatives. In numba the adjoint of stormer_verlet is written by
hand, with -ffast-math (`bench/peers/adjoint.py`); diffrax steps Heun's rule, as a loop of one's own in jax does,
torchsde the rule of its row. *Share* is the time of the library's stormer_verlet over that of the row."""
CHAIN = """A chain of {sites} sites by `stormer_verlet`, derivatives by q0 and p0 and by {sites} spring constants:
{ratio} of the time with two parameters ({target})."""


def section(found: dict) -> str:
    """Write the section."""
    ns, cells = found["ns"], []
    for scheme in SCHEMES:
        over = ns[scheme] / ns[f"{scheme} forward"]
        judged = at_most(over, FORWARD.get(scheme))
        cells.append([f"symsde {scheme}", *figures(ns[scheme], ns[f"{scheme} forward"], over), "", *judged])
    for name in ns:
        if name.partition(" ")[0] not in SCHEMES:
            share = ns["stormer_verlet"] / ns[name]
            cells.append([name, f"{ns[name]:.3g}", "", "", f"{share:.2g}", *at_most(share, SHARES.get(name))])
    heads = ["gradient", "ns of a path-step", "forward", "gradient/forward", "share", "target", ""]
    measured_with = ", ".join(found["versions"]) or f"peers: {ABSENT}"
    about = wrapped(f"{ABOUT} Measured on {found['date']}, {found['cpu']}: {measured_with}.")
    ratio = found["sites"]["springs"] / found["sites"]["two"]
    target, met = at_most(ratio, 1.3)
    beside = CHAIN.format(sites=SITES, ratio=f"{ratio:.3g}", target=f"target {target}: {met}")
    return "\n\n".join(["## Gradients", about, table(heads, cells), wrapped(beside)])


def figures(*numbers: float) -> list[str]:
    """Numbers with three digits."""
    return [f"{x:.3g}" for x in numbers]
