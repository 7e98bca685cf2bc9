# SPDX-License-Identifier: BSD-3-Clause
"""docs/which-scheme.md, and its tables: from the candidates of `symsde.advise` and the measurements in docs/figures."""

import json
from pathlib import Path

import symsde as ss
import typeset
from symsde.answers.advice import advise
from symsde.native.checks import counted
from symsde.show.tables import markdown
from symsde.studies.study import of_data, study_words

FIGURES = Path(__file__).with_name("figures")
TOLERANCES = (1e-1, 1e-2, 1e-3, 1e-5)
KINDS = {
    "commuting flows": ("kubo",),
    "additive": ("linear_oscillator", "additive_oscillator", "henon_heiles", "fpu_chain"),
    "additive, stiff": ("stiff_chain",),
    "in position": ("synchrotron", "driven_pendulum"),
    "one noise, in p": ("pendulum",),
    "does not commute": ("noncommutative_oscillator",),
}
USE = {
    "midpoint": "the first choice: any model, any noise, stiff or not; keeps every quadratic invariant",
    "symplectic_euler": "separable models with noise in position or additive: the cheapest step",
    "symplectic_euler_adjoint": "the adjoint of symplectic_euler: for compositions and checks",
    "stormer_verlet": "separable models that are not stiff: explicit (leapfrog), second order without noise",
    "gauss2": "flows that commute (Kubo), or little noise: order 4 without noise",
    "gauss3": "as gauss2 for small tolerances: order 6 without noise",
    "gauss4": "as gauss3 at tolerances near rounding: order 8 without noise",
    "lobatto2": "stormer_verlet as a tableau",
    "lobatto2_swapped": "the same with q and p exchanged",
    "lobatto3": "little noise, if you want stages at the ends of a step; order 4 without noise",
    "lobatto3_swapped": "the same with q and p exchanged",
    "lobatto4": "as lobatto3 with order 6 without noise",
    "lobatto4_swapped": "the same with q and p exchanged",
    "gauss2_strong32": "paths under commuting noise at small tolerances: order 3/2, with dZ",
    "gauss2_strong32_areas": "paths at small tolerances under any noise: order 1 if it does not commute, else 3/2",
    "gauss2_weak2": "means under commuting noise, no paths: weak order 2 with three-point increments",
    "gauss2_weak2_areas": "means under any noise, no paths: weak order 2, three-point increments, two-point areas",
    "midpoint_areas": "paths under noise that does not commute: order 1 instead of 1/2, with areas",
    "midpoint_weak1": "means, no paths: bounded two-point increments, so implicit steps always have a solution",
    "verlet_dz": "additive noise on momenta, separable: explicit, strong order 2, with dZ",
    "averaged_shift_midpoint": "additive noise on q and p, or stiff: strong order 3/2, with dZ",
    "drift_preserving": "the exact growth of E H under additive noise; not symplectic",
    "exact_rotation": "a stiff linear part whose frequencies are declared, noise in position: explicit at any h omega",
    "gauss_dkdkd": "H = p.M^-1 p/2 + U(q) or linear p-q coupling, noise in position: explicit, orders 2 and 3/2",
    "verlet_kdk": "velocity Verlet (leapfrog) with dZ: as gauss_dkdkd, with kicks at the ends of the step",
    "chin4a": "H = p.M^-1 p/2 + U(q), noise in position, small tolerances or long horizons: the cheapest measured",
    "gauss_dkdkd_strong2": "as gauss_dkdkd with strong order 2 for every noise in position",
    "verlet_kdk_strong2": "as verlet_kdk with strong order 2 for every noise in position",
    "chin4a_strong2": "the most accurate explicit paths under noise in position: a reference for others",
    "gauss_dkdkd_rotation": "as gauss_dkdkd around the exact flow of a stiff linear part",
    "gauss_dkdkd_midpoint": "any H, noise in position, stiff or not: strong order 3/2 with three midpoint steps",
    "verlet_kdk_midpoint": "H = p.M^-1 p/2 + U(q), noise in position, stiff: as gauss_dkdkd, with one midpoint step",
    "verlet_dkd_weak2": "means, no paths, noise in position: weak order 2 with one force a step and three-point dW",
    "heun": "comparison only: not symplectic, its second moments grow",
    "euler_maruyama": "comparison only: not symplectic, second moments grow, strong order 1/2",
    "dirk:0.25": "two midpoint steps of unequal length: comparisons within the family",
    "lambda:0.3": "between the two Euler schemes: shows what the correction of one-sided schemes does",
}
GALERKIN = "a Galerkin scheme of the action: variational experiments; if r = s, it is a tableau of the rows above"


#: asked on the first screen, in this order: the question, the problem where the answer is yes, the scheme, and why
FIRST = (
    (
        "Do the noises not commute,\nand do the paths count?",
        "noises that do not commute, and the paths themselves count",
        "gauss2_strong32_areas",
        "strong order one instead of 1/2, by the areas between noises",
    ),
    (
        "Do all flows commute, or is\nthere hardly any noise?",
        "flows that commute (Kubo), or hardly any noise",
        "gauss2",
        "order four without noise",
    ),
    (
        "Is it stiff, or\nnot separable?",
        "stiff, or not separable",
        "midpoint",
        "stable at every step, for every kind of noise; the first choice if you are in doubt",
    ),
    (
        "Noise in position alone, and\npaths to errors below 0.01?",
        "H = p.p/2 + U(q), noise in position alone, small errors of paths",
        "chin4a",
        "the longest step for a given error",
    ),
    ("", "separable, all other cases", "stormer_verlet", "explicit, the cheapest step"),
)


def page():
    """The page: one screen, then how to go on."""
    rows = [[problem, f"`{name}`", why] for _, problem, name, why in FIRST]
    table = markdown(["your problem", "scheme", "because"], rows)
    return typeset.markdown("\n".join([_HEAD, table, _MEASURE, _BY_WANT]))


def picture():
    """What the picture of the first screen shows: questions from top to bottom, and the schemes of the answers."""
    return {"step": 1.0, "questions": [[question, name] for question, _, name, _ in FIRST]}


def tables():
    """The page of all tables."""
    studies = {path.stem.partition("precision-")[2]: _study(path) for path in FIGURES.glob("work-precision-*.json")}
    return typeset.markdown(
        "\n".join(
            [
                *(_TABLES, _BY_NOISE, _noise_table(studies)),
                *(_BY_HORIZON, _horizons(_data("horizons"))),
                *(_BY_STIFFNESS, _stiffness(_data("mean-square"))),
                *("## Orders and invariants\n", _wants()),
                *("## Every scheme in a line\n", _uses()),
            ]
        )
    )


def _data(stem):
    return json.loads((FIGURES / f"{stem}.json").read_text(encoding="utf-8"))


def _study(path):
    return of_data(json.loads(path.read_text(encoding="utf-8")))


def _noise_table(studies):
    rows, tried = [], []
    for kind, scenes in KINDS.items():
        for scene in scenes:
            study = studies[scene]
            usable = [r for r in study.rows if r["status"] == "ok" and ss.schemes.get(r["scheme"]).info.symplectic]
            cells = [_cell(scene, study_words.cheapest(usable, tolerance)) for tolerance in TOLERANCES]
            rows.append([kind, f"{scene}, to t = {study.horizon:g}", *cells])
            tried.append([kind, f"`{study.model}`", _candidates(study.model)])
    missing = set(studies) - {scene for scenes in KINDS.values() for scene in scenes}
    if missing:
        raise ValueError(f"scenes without a kind of noise: {', '.join(sorted(missing))}")
    measured = markdown(["noise", "measured on", *(f"paths to {x:g}" for x in TOLERANCES)], rows)
    return f"{measured}\nWhat `ss.advise` tries on these models:\n\n" + markdown(["noise", "model", "schemes"], tried)


def _candidates(text):
    """What advise tries on a model, by its repr."""
    name, _, parameters = text.partition("(")
    given = dict(item.split("=") for item in parameters.rstrip(")").split(", "))
    model = ss.models.get(name, **{key: float(value) for key, value in given.items()})
    return ", ".join(advise.scheme_names(model))


def _cell(scene, found):
    if not found:
        return f"[-](work-precision-tables.md#{scene})"
    best = found[0]
    text = f"{best['scheme']}, h = {best['h']:.3g}, {1e6 * best['seconds']:.3g} us"
    return f"[{text}](work-precision-tables.md#{scene})"


def _horizons(data):
    rows = []
    for want in dict.fromkeys(row["want"] for row in data["rows"]):
        for horizon in sorted({row["horizon"] for row in data["rows"]}):
            here = [r for r in data["rows"] if r["want"] == want and r["horizon"] == horizon and r["microseconds"]]
            kept = [r for r in here if r["scheme"] != "taylor15" and ss.schemes.get(r["scheme"]).info.symplectic]
            best = min(kept, key=lambda row: row["microseconds"], default=None)
            factors = [_factor(here, name, best) for name in ("heun", "taylor15")]
            text = f"{best['scheme']}, {counted(best['steps'], 'step')}, {best['microseconds']:.3g} us" if best else "-"
            rows.append([want, f"{horizon:g}", f"[{text}](expect.md#as-the-horizon-grows)", *factors])
    head = ["wanted", "horizon", "cheapest symplectic scheme", "Heun's rule", "Taylor's rule of order 1.5"]
    return markdown(head, rows)


def _factor(rows, name, best):
    """What a plain rule takes beside the best."""
    found = next((row for row in rows if row["scheme"] == name), None)
    if not found or not best:
        return "-"
    return f"{float('%.2g' % (found['microseconds'] / best['microseconds'])):g} times as much"


def _stiffness(data):
    """Largest omega h up to which every shorter step grows no more than the limit, of every scheme; alike ones share a
    row."""
    rows = {}
    for name, found in data["limits"].items():
        cells = tuple("-" if limits is None else _longest(data, limits) for limits in found.values())
        rows.setdefault(cells, []).append(f"`{name}`")
    equations = [equation.split(",")[0] for equation in next(iter(data["limits"].values()))]
    return markdown(["schemes", *equations], [[", ".join(names), *cells] for cells, names in rows.items()])


def _longest(data, limits):
    """'1.9, 1.6, 0.8': for the strengths that are told; one number where they are the same."""
    end = data["omega_h"][-1]
    texts = ["all" if x >= end else f"{x:.2g}" if x else "none" for x in limits]
    text = texts[0] if len(set(texts)) == 1 else ", ".join(texts)
    return f"[{text}](expect.md#mean-square-stability)"


def _wants():
    rows = []
    for name in ss.schemes.names():
        info = ss.schemes.get(name).info
        if info.form == "Galerkin":
            continue
        kept = "quadratic ones" if info.keeps_quadratic else "q^T D p" if info.keeps_bilinear else "none"
        values = [info.orders[kind].value for kind in ("additive", "commutative", "general", "weak")]
        orders = [f"[{value:g}](schemes.md#orders)" if value else "-" for value in values]
        rows.append([f"`{name}`", *orders, kept, "yes" if info.symplectic else "no"])
    return markdown(["scheme", "additive", "commuting", "general", "weak order", "invariants kept", "symplectic"], rows)


def _uses():
    rows = []
    for name in (*ss.schemes.names(), "dirk:0.25", "lambda:0.3"):
        text = USE.get(name) or (GALERKIN if name.startswith("P") else None)
        if text is None:
            raise ValueError(f"docs/which_scheme.py says of {name} nothing: add its line to USE")
        rows.append([f"`{name}`", text])
    return markdown(["scheme", "use it for"], rows)


_HEAD = """\
<!-- Generated by docs/generate.py; do not edit. -->

# Which scheme for my problem

If the model is stiff or not separable, take **midpoint**. Otherwise take **stormer_verlet**, or **chin4a** if you want
the paths themselves to small errors. A model is *separable* if H and its noises are sums of a function of q and one of
p; it is *stiff* if its fastest frequency is much faster than the motion that you look at.

![A way through the schemes by four questions](figures/which-scheme.png)

"""
_MEASURE = """\
In magnetic fields and rotating frames H is not separable, nor on lattices with noise of phases. Yet symsde alternates
there between two exact flows: take **gauss_dkdkd**, or **chin4a** for small errors in fields ([Magnetic
fields](formulas.md#magnetic-fields-rotating-frames-stiff-springs),
[Lattices](formulas.md#lattices-with-noise-of-phases)).

chin4a is an explicit scheme for H = p.p/2 + U(q) with noise in position alone. It does as stormer_verlet does, kicks
and drifts in turn, but it also uses the gradient of the squared force, and draws the integrals of the noise over a
step beside its increments (S. A. Chin 1997; [Explicit schemes](method/explicit.md)). A step takes three to five times
as long as one of stormer_verlet, and may be much longer for the same error.

## Measured on your model

```python
import symsde as ss

print(ss.advise(ss.models.synchrotron(), q0=1.0, p0=0.0, horizon=4.0, tolerance=1e-3))
```

`ss.advise` tries the schemes that suit the [traits](words.md#trait) of the model (what is known about its
Hamiltonians), with three steps on the same Brownian paths. For each it finds the longest step that keeps the
tolerance, and then it takes the cheapest ([Scheme and step for a
tolerance](expect.md#scheme-and-step-for-a-tolerance)). `want="moments"` and
`want="invariants"` ask for other errors.
"""
_TABLES = """\
<!-- Generated by docs/generate.py; do not edit. -->

# Which scheme: the tables

These tables were measured on the built-in models; each number links to its measurement. [Which scheme for my
problem](which-scheme.md) is the short way.
"""
_BY_NOISE = """\
## By noise, for paths

Each cell gives the cheapest symplectic scheme that keeps the tolerance, its step, and the time of a path on one thread,
in microseconds (us a path). A tolerance is kept if the 95 % bound of the root mean square error of the paths at the end
is within it. A dash means that no measured scheme keeps it at a measured step.
"""
_BY_HORIZON = """\
## By horizon

The model is a synchrotron with little noise; for the invariant law it is the Kubo oscillator. Schemes that are not
symplectic cost about the same over one period, and more and more over longer times. A dash means that no affordable
step keeps the tolerance, or that it was not measured.
"""
_BY_STIFFNESS = """\
## By stiffness

The table gives the largest omega h, where omega is the fastest frequency, up to which a step adds less than 1 % to the
growth of the second moments of linear equations. The three numbers are for sigma sqrt(h) = 0.01, 0.1 and 0.32; one
number holds for all three. "all" means up to 3.2; a dash means that the scheme does not take this noise.
[Stability](stability.md#how-long-a-step-may-be) gives the limits without noise. A step beyond omega h = 1 may be
stable, but it does not resolve the motion: `report.warnings` says so.
"""
_BY_WANT = """\
## By what is wanted

- **Paths**: the strong order for your kind of noise counts
  ([cheapest schemes by noise](which-scheme-tables.md#by-noise-for-paths),
  [orders](which-scheme-tables.md#orders-and-invariants)).
- **Means**: the weak order counts. But the cost of sampling matters more often than the step, see [an answer with an
  error bar](expect.md).
- **Long times**: schemes that are not symplectic cost more and more
  ([by horizon](which-scheme-tables.md#by-horizon)).
- **Stiff systems**: [the longest step](which-scheme-tables.md#by-stiffness) of every scheme.
- **Invariants**: schemes with equal tableaux for q and p keep quadratic invariants to rounding (norms, Casimirs,
  p^2 + q^2 of the Kubo oscillator). Every symplectic scheme here keeps q^T D p (angular momentum).

[Every scheme in a line](which-scheme-tables.md#every-scheme-in-a-line) says what each one is for.
"""
