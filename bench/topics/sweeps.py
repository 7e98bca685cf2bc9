# SPDX-License-Identifier: BSD-3-Clause
"""Times of many values of a parameter, of initial states drawn from laws, and of fits.

Sweeps: 1,000 values of 100 paths and 200 steps beside a run of 100,000 paths of one value, and beside the loop of
`loops.py` whose parameter differs by path, and other packages. Values one by one: 1,000 models of 10 paths and 20
steps, made and run.
Draws: ns of a number beside those of NumPy's Generator. Fits: a fit beside as many runs of moments.
"""

import loops
import numpy as np
import symsde as ss
from scenes import SCENES
from timing import least

from .tools import ABSENT, Setting, asked, at_least, at_most, table

VALUES, PATHS = np.linspace(0.5, 1.5, 1000), 100
HOW = {"q0": 1.0, "p0": 0.0, "step": 0.05, "seed": 1, "threads": 1}
RUN = {**HOW, "steps": 200, "save_every": 200}
#: row -> scene, scheme, name of the swept parameter, how often faster than the loop it has to be
SWEPT = {
    "Kubo midpoint": ("kubo", "midpoint", "sigma", 2.5),
    "synchrotron midpoint": ("synchrotron", "midpoint", "sigma1", 4.0),
    "synchrotron Stormer-Verlet": ("synchrotron", "stormer_verlet", "sigma1", None),
}
BODIES = "(p1**2+p2**2+p3**2+p4**2+p5**2+p6**2)/2" + "".join(
    f" - k/sqrt((q{i}-q{j})**2 + (q{i + 1}-q{j + 1})**2 + 0.1)" for i, j in ((1, 3), (1, 5), (3, 5))
)  #: three bodies in a plane
ONE_VALUE = 1.1  # times a run of as many paths of one value
ONE_BY_ONE = 0.1  # s
MADE = 30.0  # us


def swept(name: str, repeats: int) -> list[list]:
    """Seconds of a sweep by formula and by built-in model, of one value, and of the loop."""
    scene, scheme, parameter, target = SWEPT[name]
    scene = SCENES[scene]
    strength, paths = scene.values[parameter], VALUES.size * PATHS
    generator, one = np.random.default_rng(1), np.array([1.0])
    loop = loops.loop_by_path(scene, scheme)
    found = []
    for kind, model in (("formula", scene.formula()), ("built-in", scene.model())):
        ways = {
            "sweep": lambda m=model: ss.sweep(m, {parameter: strength * VALUES}, paths=PATHS, scheme=scheme, **RUN),
            "one": lambda m=model: ss.moments(m, paths=paths, scheme=scheme, **RUN),
            "loop": lambda: loop(generator, one, 0 * one, RUN["step"], RUN["steps"], np.repeat(VALUES, PATHS)),
        }
        for way in ways.values():
            way()
        took = least(ways, repeats)
        found.append([f"{name}, {kind}", took["sweep"], took["one"], took["loop"], target])
    return found


def one_by_one(repeats: int) -> dict[str, float]:
    """Seconds of models made and run value by value, and of making them."""
    short, ways = {**HOW, "steps": 20, "save_every": 20, "paths": 10}, {}
    for kind, model in (("formula", SCENES["kubo"].formula()), ("built-in", SCENES["kubo"].model())):
        at = model.with_parameters(a=1.1)

        def run(call, m=at):
            for sigma in VALUES:
                call(m.with_parameters(sigma=sigma), **short)

        def make(m=at):
            for sigma in VALUES:
                m.with_parameters(sigma=sigma)

        ways |= {f"simulate, {kind}": lambda r=run: r(ss.simulate), f"moments, {kind}": lambda r=run: r(ss.moments)}
        ways[f"with_parameters, {kind}"] = make
    bodies = ss.model_from_sympy(BODIES, params={"k": 1.0})
    ways["with_parameters, 3 bodies by formula"] = lambda: [bodies.with_parameters(k=k) for k in VALUES]
    for way in ways.values():
        way()
    return least(ways, repeats)


def drawn(repeats: int) -> dict[str, float]:
    """ns of a drawn number, q or p of a path."""
    paths, model = 1_000_000, ss.models.kubo()
    generator = np.random.default_rng(1)
    laws = {
        "normal": ss.states.normal(0.0, 0.1),
        "uniform": ss.states.uniform(-1.0, 1.0),
        "canonical": ss.states.canonical(2.0),
        "formula": ss.states.formula({"a": ss.states.uniform(0.0, 6.0)}, q="cos(a)", p="sin(a)"),
    }
    ways = {name: lambda law=law: law.draw(model, paths, seed=1) for name, law in laws.items()}
    ways["NumPy's Generator, normal"] = lambda: generator.normal(0.0, 0.1, (2, paths))
    for way in ways.values():
        way()
    return {name: 1e9 * x / (2 * paths) for name, x in least(ways, repeats).items()}


def fitted(repeats: int) -> list[list]:
    """Seconds of fits, their runs, and seconds of as many runs of moments."""
    t = np.arange(1, 41) * 0.25
    found = []
    for name, H, noise, names in (
        ("pendulum, k and sigma", "p**2/2 - k*cos(q)", ["sigma*sin(q)"], ["k", "sigma"]),
        ("oscillator, k, sigma and q0", "p**2/2 + k*q**2/2", ["-sigma*q"], ["k", "sigma", "q0"]),
    ):
        true = ss.model_from_sympy(H, noise=noise, params={"k": 1.2, "sigma": 0.3})
        start = true.with_parameters(k=1.0, sigma=0.2)
        run = {"p0": 0.0, "step": 0.05, "paths": 2000, "threads": 1, "scheme": "stormer_verlet"}
        data = ss.moments(true, **{**run, "paths": 20000, "steps": 200, "save_every": 5}, q0=1.0, seed=7)
        given = {"q": data.mean_q[1:, 0], "p": data.mean_p[1:, 0], "var(p)": data.var_p[1:, 0]}

        def fit(m=start, d=given, n=names, r=run):
            return ss.fit(m, d, n, t=t, q0=0.9, **r)

        runs = fit().evaluations

        def forward(m=start, r=run, n=runs):
            for _ in range(n):
                ss.moments(m, **r, steps=200, save_every=5, q0=1.0)

        took = least({"fit": fit, "runs": forward}, repeats)
        found.append([name, runs, took["fit"], took["runs"]])
    return found


def measure(setting: Setting) -> dict:
    """Time sweeps, single values, draws and fits."""
    repeats = 2 if setting.quick else max(3, setting.repeats)
    return {
        "swept": [row for name in SWEPT for row in swept(name, repeats)],
        "one by one": one_by_one(repeats),
        "drawn": drawn(repeats),
        "fitted": fitted(repeats),
        "peers": asked(setting, "sweep_package.py"),
    }


def section(found: dict) -> str:
    """Write the section."""
    sweeps, by_loop = [], []
    for name, sweep, one, loop, target in found["swept"]:
        sweeps.append(
            [name, f"{1e3 * sweep:.1f}", f"{1e3 * one:.1f}", f"{sweep / one:.2f}", *at_most(sweep / one, ONE_VALUE)]
        )
        by_loop.append([name, f"{1e3 * loop:.1f}", f"{loop / sweep:.2f}", *at_least(loop / sweep, target)])
    single = []
    for name, seconds in found["one by one"].items():
        most = MADE if name.startswith("with_parameters") else 1e3 * ONE_BY_ONE
        limit = at_most(1e3 * seconds, None if "bodies" in name else most)
        single.append([name, f"{1e3 * seconds:.1f}", *limit])
    draws = [[name, f"{ns:.1f}"] for name, ns in found["drawn"].items()]
    fits = [[name, str(runs), f"{fit:.3f}", f"{fit / forward:.2f}"] for name, runs, fit, forward in found["fitted"]]
    return (
        "## Sweeps, initial states and fits\n\n"
        "The table gives ms of processor time of `ss.sweep` over 1,000 values of a parameter with 100 paths each, 200 "
        "steps, and of moments of 100,000 paths of one value.\n\n"
        + table(["sweep", "time [ms]", "one value [ms]", "ratio", "target", ""], sweeps)
        + "\n\nThe next table compares these sweeps with the loop in numba whose parameter differs by path.\n\n"
        + table(["sweep", "loop [ms]", "loop / sweep", "target", ""], by_loop)
        + beside_packages(found)
        + "\n\nThe next table gives ms of 1,000 values of the oscillator of Kubo one by one: models made by "
        "`with_parameters`, and run with 10 paths and 20 steps; of the models alone this is µs of each.\n\n"
        + table(["call", "time [ms]", "target", ""], single)
        + "\n\nThe next table gives ns of a number of initial states that are drawn from a law, 1,000,000 paths.\n\n"
        + table(["law", "time [ns]"], draws)
        + "\n\nThe last table gives seconds of a fit of means and variances at 40 times, 2,000 paths, 200 steps. Runs "
        "are those of the search, with their exact derivatives; the ratio is to as many runs of moments.\n\n"
        + table(["fit", "runs", "time [s]", "fit / runs of moments"], fits)
    )


def beside_packages(found: dict) -> str:
    """The table of other packages, beside the sweep of Kubo's oscillator by formula."""
    if not found["peers"]:
        return f"\n\ndiffrax: {ABSENT}."
    ours = next(sweep for name, sweep, *_ in found["swept"] if name == "Kubo midpoint, formula")
    rows = [[f"{name}, Heun", f"{1e3 * x:.0f}", f"{x / ours:.1f}"] for name, x in found["peers"]["seconds"].items()]
    about = f"The same sweep of the oscillator of Kubo by {found['peers']['version']}, all paths at once:"
    return f"\n\n{about}\n\n" + table(["package", "time [ms]", "over the sweep by formula"], rows)
