# SPDX-License-Identifier: BSD-3-Clause
"""The scenes of the benchmarks: each entry of `SCENES` states equations and parameters once.

From an entry come the model of the catalogue, the same model by its formulas, and the functions of a loop in numba or
NumPy: `mass`, `force` and `slope` of the one-step Hamiltonian S = sum_j w_j H_j = mass p^2/2 + U(q).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from types import SimpleNamespace

import numpy as np
import symsde as ss


@dataclass(frozen=True)
class Scene:
    """H, its noises, and parameters that differ from the catalogue's."""

    name: str  #: name in the catalogue; "" if the catalogue does not have the model
    H: str
    noises: tuple[str, ...]
    parameters: Mapping[str, float] = field(default_factory=dict)
    step: float = 0.02
    sites: int = 0  #: number of sites, for formulas about sites
    ends: str = "free"
    by_sites: Callable | None = None  #: makes force(w, t, q, f), a loop over sites, from parameters

    @property
    def values(self) -> dict[str, float]:
        """All parameters, with the catalogue's defaults."""
        return {**(ss.models.get(self.name).parameters if self.name else {}), **self.parameters}

    @property
    def ndof(self) -> int:
        """Degrees of freedom."""
        return self.sites or (2 if "q2" in self.H else 1)

    @property
    def nnoise(self) -> int:
        """Number of noises."""
        return self.sites if "[k]" in self.noises[0] else len(self.noises)

    def model(self) -> ss.Model:
        """The model from the catalogue."""
        return ss.models.get(self.name, **self.parameters, **({"n": self.sites} if self.sites else {}))

    def formula(self) -> ss.Model:
        """The same model from formulas, as a user writes it."""
        values = {name: value for name, value in self.values.items() if name != "n"}
        about = {"n": self.sites, "ends": self.ends} if self.sites else {}
        return ss.model_from_sympy(self.H, list(self.noises), params=values, **about)

    def of(self, **changes) -> Scene:
        """The same scene with other parameters, or for other sites."""
        sites = changes.pop("sites", self.sites)
        return replace(self, sites=sites, parameters={**self.parameters, **changes})

    def functions(self, library: str = "math", compiled: Callable = lambda function: function) -> SimpleNamespace:
        """mass(w), force(w, t, q) and slope(w, t, q), which gives the force and its derivative; with several degrees of
        freedom force(w, t, q, f), which writes the forces into f. Sine and cosine come from `library`: math or numpy.
        """
        if self.by_sites:
            force = self.by_sites(**{name: value for name, value in self.values.items() if name != "n"})
            return SimpleNamespace(mass=compiled(lambda w: w[0]), force=compiled(force))
        return _written(self, library, compiled)


def _written(scene: Scene, library: str, compiled: Callable) -> SimpleNamespace:
    """The functions of formulas without sums: derivatives by sympy, written as Python."""
    import sympy  # noqa: PLC0415 - peers in other interpreters do not have it
    from sympy.printing.numpy import NumPyPrinter  # noqa: PLC0415
    from sympy.printing.pycode import PythonCodePrinter  # noqa: PLC0415

    n, values = scene.ndof, scene.values
    qs, ps = (sympy.symbols([x] if n == 1 else [f"{x}{i + 1}" for i in range(n)]) for x in "qp")
    names = {str(x): x for x in (*qs, *ps, sympy.Symbol("t"), *map(sympy.Symbol, values))}
    weights = [sympy.Symbol(f"w[{k}]") for k in range(1 + len(scene.noises))]
    exact = {name: sympy.Rational(repr(float(value))) for name, value in values.items()}
    parts = [sympy.sympify(text, locals=names, rational=True).subs(exact) for text in (scene.H, *scene.noises)]
    total = sum(w * part for w, part in zip(weights, parts, strict=True))
    mass = sympy.diff(total, ps[0], 2)
    assert all(sympy.simplify(sympy.diff(total, p) - mass * p) == 0 for p in ps), f"{scene.name}: not mass p^2/2 + U(q)"
    written = {q: sympy.Symbol("q" if n == 1 else f"q[{i}]") for i, q in enumerate(qs)}
    force = [(-sympy.diff(total, q)).subs(written) for q in qs]
    printer = NumPyPrinter() if library == "numpy" else PythonCodePrinter()

    def gathered(x):  # grouped by common subexpressions in q, as a person would write
        return sympy.collect(sympy.expand(x), [*x.atoms(sympy.sin, sympy.cos), *written.values()]) if n == 1 else x

    def function(arguments: str, results: list, ending: str) -> Callable:
        common, results = sympy.cse([gathered(x) for x in results])
        lines = [f"{symbol} = {printer.doprint(value)}" for symbol, value in common]
        lines.append(ending.format(*map(printer.doprint, results)))
        space = {"math": math, "numpy": np}
        exec("\n    ".join([f"def function({arguments}):", *lines]), space)
        return compiled(space["function"])

    found = SimpleNamespace(mass=function("w", [mass], "return {}"))
    if n > 1:
        into = ", ".join(f"f[{i}]" for i in range(n)) + " = " + ", ".join(["{}"] * n)
        found.force = function("w, t, q, f", force, into)
        return found
    derivative = sympy.diff(force[0], written[qs[0]])
    found.force = function("w, t, q", force, "return {}")
    found.slope = function("w, t, q", [force[0], derivative], "return {}, {}")
    found.linear = not derivative.has(written[qs[0]])
    return found


def chain_force(beta: float, sigma: float) -> Callable:
    """Masses between fixed ends, springs of force r + beta r^3."""

    def force(w, t, q, f):
        n = len(q)
        before = q[0] * (1 + beta * q[0] * q[0])
        for i in range(n):
            r = -q[i] if i == n - 1 else q[i + 1] - q[i]
            after = r * (1 + beta * r * r)
            f[i] = w[0] * (after - before) + sigma * w[i + 1]
            before = after

    return force


def ring_force(sigma: float) -> Callable:
    """A ring of phi^4, with the noise sigma q^2 at each site."""

    def force(w, t, q, f):
        n = len(q)
        before = q[0] - q[n - 1]
        for i in range(n):
            after = (q[0] if i == n - 1 else q[i + 1]) - q[i]
            f[i] = w[0] * (after - before - q[i] * (1 + q[i] * q[i])) - 2 * sigma * q[i] * w[i + 1]
            before = after

    return force


def rotators_force(strength: float, N: float) -> Callable:
    """Rotators in the field of their mean, with two sums over sites."""

    def force(w, t, q, f):
        cosines, x, y = np.empty_like(q), 0.0, 0.0
        for i in range(len(q)):
            f[i], cosines[i] = math.sin(q[i]), math.cos(q[i])
            x, y = x + cosines[i], y + f[i]
        for i in range(len(q)):
            f[i] = -w[0] * (q[i] + (f[i] * x - cosines[i] * y) / N) + strength * w[1]

    return force


SPRINGS = "Sum(p[i]**2/2, i) + Sum((q[i+1]-q[i])**2/2 + beta*(q[i+1]-q[i])**4/4, i)"
RING = "Sum(p[i]**2/2, i) + Sum(q[i]**2/2 + q[i]**4/4 + (q[i+1]-q[i])**2/2, i)"
ROTATORS = "Sum(p[i]**2/2, i) + Sum(q[i]**2/2, i) - (Sum(cos(q[i]), i)**2 + Sum(sin(q[i]), i)**2)/(2*N)"
DRIVEN = "p**2/2 - omega**2*(1 + epsilon*cos(nu*t))*cos(q)"
HENON_HEILES = "(p1**2 + p2**2 + q1**2 + q2**2)/2 + alpha*(q1**2*q2 - q2**3/3)"
QUIET = {"sigma1": 1e-4, "sigma2": 1e-4}  #: noise so weak that no path escapes in a long run

SCENES = {
    "kubo": Scene("kubo", "a*(p**2 + q**2)/2", ("sigma*(p**2 + q**2)/2",)),
    "linear_oscillator": Scene("linear_oscillator", "(p**2 + q**2)/2", ("-sigma*q",)),
    "additive_oscillator": Scene("additive_oscillator", "(p**2 + q**2)/2", ("sigma*p", "-gamma*q")),
    "noncommutative_oscillator": Scene(
        "noncommutative_oscillator",
        "(p**2 + q**2)/2",
        ("s1*p**2/2", "s2*q**2/2"),
        step=1e-6,  # the solution grows without bound
    ),
    "synchrotron": Scene("synchrotron", "p**2/2 - omega**2*cos(q)", ("sigma1*sin(q)", "-sigma2*cos(q)")),
    "pendulum": Scene("pendulum", "p**2/2 - cos(q)", ("sigma*(p**2 + q**2)/2",)),
    "driven_pendulum": Scene(
        "driven_pendulum", DRIVEN, ("-sigma1*(1 + alpha*sin(nu*t))*q", "-sigma2*(1 + alpha*sin(nu*t))*cos(q)")
    ),
    "henon_heiles": Scene("henon_heiles", HENON_HEILES, ("sigma1*q1", "sigma2*q2"), QUIET),
    "fpu_chain": Scene(  # noise so weak that the chain hardly heats in a long run
        "fpu_chain", SPRINGS, ("-sigma*q[k]",), {"sigma": 1e-3}, 0.05, sites=64, ends="fixed", by_sites=chain_force
    ),
    "phi4_ring": Scene("", RING, ("sigma*q[k]**2",), {"sigma": 0.1}, sites=64, ends="periodic", by_sites=ring_force),
    "mean_field": Scene(
        "", ROTATORS, ("-strength*Sum(q[i], i)",), {"strength": 0.03, "N": 16}, sites=16, by_sites=rotators_force
    ),
    "noisy_oscillator": Scene("", "(p**2 + q**2)/2", ("-0.1*q",)),
}


def library(model: ss.Model, scheme: str, paths: int, step: float, **how) -> Callable[[int], ss.Run]:
    """Runs of the library with so many steps from (0.2, 0) on one thread, which save the last state alone."""

    def run(steps: int) -> ss.Run:
        more = {"q0": 0.2, "p0": 0.0, "save_every": steps} | how
        return ss.simulate(model, step=step, steps=steps, scheme=scheme, paths=paths, threads=1, **more)

    return run


def wave(n: int) -> np.ndarray:
    """The slowest wave between fixed ends; 1 for one degree of freedom."""
    return np.sin(np.pi * np.arange(1, n + 1) / (n + 1))
