# SPDX-License-Identifier: BSD-3-Clause
"""Figure 4.1: synchrotron oscillations (73)-(74), three computations on one Brownian path.

The midpoint rule (82)-(83); the formula that the paper prints after (83) as "a highly accurate simulation of the true
solution", at the same step; and the midpoint rule at a step 64 times finer. The paper's formula computes
q_{n+1} = q_n + h p_n first and evaluates the forces of p_{n+1} at q_{n+1}: it is the adjoint symplectic Euler scheme
(lambda = 1), which has the same strong order 1 as the midpoint rule, so only the fine path can judge the two.
"""

import numpy as np

import symsde as ss

from ...show import look
from .experiment import Experiment, panels

OMEGA, SIGMA1, SIGMA2 = 2.0, 0.2, 0.1
STEP, TIME, LEVELS = 0.02, 100.0, 6
STEPS = round(TIME / STEP)
START = {"q0": 0.0, "p0": 0.0}
SHOWN = 0.2  # difference in q below which two curves of Figure 4.1 look equal


def run(quick):
    """Test ten seeds, the nature of the reference formula, and the accuracy of 100 fixed-point iterations."""
    seeds = list(range(1, 4 if quick else 11))
    parameters = {
        "omega": OMEGA, "sigma1": SIGMA1, "sigma2": SIGMA2, **START, "step": STEP, "time": TIME,
        "finer": 2**LEVELS, "seeds": seeds, "many_paths": 64 if quick else 1000,
        "many_paths_seed": 1000,
    }  # fmt: skip
    title = (
        f"Figure 4.1: synchrotron, sigma1 = {SIGMA1}, sigma2 = {SIGMA2}, omega = {OMEGA:g}, h = {STEP}, t in [0, 100]"
    )
    experiment = Experiment("figure_4_1", title, seed=seeds[0], parameters=parameters)
    model = ss.models.synchrotron(omega=OMEGA, sigma1=SIGMA1, sigma2=SIGMA2)
    _seeds(experiment, model, seeds)
    _many_paths(experiment, model, parameters["many_paths"])
    _reference_formula(experiment, model)
    _iterations(experiment, model)
    return experiment


def simulate(model, seed, scheme="midpoint", finer=0, **options):
    """q(t) at the multiples of STEP, computed with step STEP/2^finer on the Brownian path of this seed."""
    return ss.simulate(
        model, **START, step=STEP / 2**finer, steps=STEPS * 2**finer, save_every=2**finer, scheme=scheme,
        seed=seed, refine=LEVELS - finer, paths=1, **options,
    )  # fmt: skip


def reference(dw, q=0.0, p=0.0):
    """Run the formula printed after (83): q, p (step + 1,) for increments (step, noise)."""
    path = [(q, p)]
    for dw1, dw2 in dw:
        q = q + STEP * p
        p = p - STEP * OMEGA**2 * np.sin(q) - (SIGMA1 * np.cos(q) * dw1 + SIGMA2 * np.sin(q) * dw2)
        path.append((q, p))
    return np.array(path).T


def _seeds(experiment, model, seeds):
    rows = []
    for seed in seeds:
        fine = simulate(model, seed, finer=LEVELS).q[:, 0, 0]
        midpoint = simulate(model, seed).q[:, 0, 0]
        formula = simulate(model, seed, "symplectic_euler_adjoint").q[:, 0, 0]
        smaller = simulate(model, seed, finer=3).q[:, 0, 0]
        rows.append(
            {
                "seed": seed,
                "midpoint_fine": np.abs(midpoint - fine).max(),
                "reference_fine": np.abs(formula - fine).max(),
                "midpoint_reference": np.abs(midpoint - formula).max(),
                "midpoint_eighth_fine": np.abs(smaller - fine).max(),
                "largest_q": np.abs(fine).max(),
            }
        )
        if seed == seeds[0]:
            t = STEP * np.arange(STEPS + 1)
            experiment.curves |= {"t": t, "midpoint": midpoint, "formula": formula, "fine": fine}
    experiment.numbers["seeds"] = rows
    _judge(experiment, rows)


def _judge(experiment, rows):
    columns = {key: np.array([row[key] for row in rows]) for key in rows[0]}
    for key, text in (
        ("midpoint_fine", "midpoint - fine"),
        ("reference_fine", "reference formula - fine"),
        ("midpoint_reference", "midpoint - reference formula"),
        ("midpoint_eighth_fine", "midpoint at h/8 - fine"),
    ):
        values = columns[key]
        summary = f"{np.min(values):.3f} {np.median(values):.3f} {np.max(values):.3f}"
        experiment.report("Figure 4.1", f"max|dq|, {text}", summary, f"least, median, most of {len(rows)}")
    close = columns["midpoint_fine"] <= SHOWN
    experiment.report("Figure 4.1", f"seeds with max|dq| <= {SHOWN}", f"{close.sum()} of {close.size}")
    median = np.median(columns["midpoint_fine"])
    experiment.between("Figure 4.1", "median of max|dq|, midpoint - fine", median, 0.001, SHOWN)
    experiment.numbers |= {"seeds_within_bound": int(close.sum()), "bound": SHOWN}


def _many_paths(experiment, model, paths):
    """Measure how often two computations of a path separate; paths that separate have large amplitudes, where phases
    drift.
    """
    every = 5
    coarse, smaller, fine = (
        ss.simulate(
            model, **START, step=STEP / 2**finer, steps=STEPS * 2**finer, save_every=every * 2**finer,
            scheme="midpoint", seed=experiment.parameters["many_paths_seed"], refine=LEVELS - finer, paths=paths,
        ).q[:, 0]
        for finer in (0, 3, LEVELS)
    )  # fmt: skip
    differences = np.abs(coarse - fine).max(axis=0)
    quantiles = np.quantile(differences, (0.5, 0.9, 0.99))
    text = " ".join(f"{value:.3f}" for value in quantiles)
    experiment.report("Figure 4.1", f"max|dq|, midpoint - fine, {paths} paths", text, "50 %, 90 %, 99 % quantile")
    apart = {f"above_{bound:g}": np.mean(differences > bound) for bound in (0.1, SHOWN, 1.0)}
    text = ", ".join(f"{100 * share:.1f} %" for share in apart.values())
    experiment.report("Figure 4.1", f"paths with max|dq| > 0.1, {SHOWN}, 1", text, "not all are small")
    experiment.between("Figure 4.1", f"share of paths with max|dq| <= {SHOWN}", 1 - apart[f"above_{SHOWN}"], 0.5, 1)
    # order 1 of the noise predicts 8; over seeds the median of 64 paths is 8.0 +- 0.9
    gain = np.median(differences / np.abs(smaller - fine).max(axis=0))
    experiment.between("(82)-(83)", "gain of a step 8 times smaller, in the median", gain, 4, 16)
    experiment.curves["differences"] = np.sort(differences)
    experiment.numbers["many_paths"] = {
        "paths": paths,
        "gain_of_an_eighth": gain,
        "quantiles_50_90_99": quantiles,
        **apart,
    }


def _reference_formula(experiment, model):
    """Compare the printed formula with symplectic_euler_adjoint from each state anew, so that round-off cannot grow."""
    adjoint = simulate(model, 1, "symplectic_euler_adjoint")
    q, p = adjoint.q[:, 0, 0], adjoint.p[:, 0, 0]
    dw = ss.increments(model, step=STEP, steps=STEPS, paths=1, seed=1, refine=LEVELS)[:, :, 0]
    q1 = q[:-1] + STEP * p[:-1]
    p1 = p[:-1] - STEP * OMEGA**2 * np.sin(q1) - (SIGMA1 * np.cos(q1) * dw[:, 0] + SIGMA2 * np.sin(q1) * dw[:, 1])
    one_step = max(np.abs(q1 - q[1:]).max(), np.abs(p1 - p[1:]).max())
    whole = np.abs(reference(dw)[0] - q).max()
    experiment.at_most("after (83)", "reference formula = adjoint (lambda = 1), a step", one_step, 1e-14)
    experiment.at_most("after (83)", "  the same over the whole path, seed 1", whole, 1e-8)
    experiment.numbers |= {"reference_is_adjoint_step": one_step, "reference_is_adjoint_path": whole}


def _iterations(experiment, model):
    """Compare Newton with the paper's 100 fixed-point iterations: the path, the work, the time."""
    newton, fixed = simulate(model, 1), simulate(model, 1, fixed_point=100)
    gap = np.abs(newton.q - fixed.q).max()
    experiment.at_most("(82)-(83)", "max|dq|, Newton - 100 fixed-point iterations", gap, 1e-8)
    work = {"newton": _work(model, 0), "fixed_point_100": _work(model, 100)}
    experiment.between("(82)-(83)", "Newton iterations a step", work["newton"]["iterations"], 1, 5)
    experiment.near("(82)-(83)", "the paper's iterations a step", work["fixed_point_100"]["iterations"], 100, 1e-9)
    ratio = work["fixed_point_100"]["nanoseconds"] / work["newton"]["nanoseconds"]
    for key, text in (("newton", "Newton"), ("fixed_point_100", "100 iterations")):
        experiment.report("(82)-(83)", f"time of a step, one core, {text}", f"{work[key]['nanoseconds']:.0f} ns")
    experiment.at_least("(82)-(83)", "run time, fixed-point / Newton", ratio, 3)
    needed, differences = _fixed_point_convergence(model)
    experiment.between("(82)-(83)", "fixed-point iterations to round-off", needed, 2, 12)
    experiment.numbers |= {
        "newton_fixed_point_difference": gap, "work": work, "time_ratio": ratio,
        "fixed_point_differences": differences, "fixed_point_iterations_needed": needed,
    }  # fmt: skip


def _work(model, fixed_point):
    steps, paths = (2000, 256) if fixed_point == 0 else (200, 256)
    computed = ss.moments(
        model, **START, step=STEP, steps=steps, save_every=steps, scheme="midpoint", paths=paths, seed=1,
        threads=1, fixed_point=fixed_point,
    )  # fmt: skip
    report = computed.report
    counts = {name: report.counters[name] / (steps * paths) for name in ("iterations", "gradients", "hessians")}
    return counts | {"nanoseconds": report.timings["run"] / (steps * paths) * 1e9, "stepper": report.stepper}


def _fixed_point_convergence(model):
    """One step from scattered states: difference of k iterations from 100 iterations, and the first k at round-off."""
    rng = np.random.default_rng(1)
    q0, p0 = rng.uniform(-3, 3, (1, 256)), rng.uniform(-4, 4, (1, 256))
    options = {"q0": q0, "p0": p0, "step": STEP, "steps": 1, "scheme": "midpoint", "paths": 256, "seed": 1}
    final = ss.simulate(model, fixed_point=100, **options).p[-1]
    differences = [np.abs(ss.simulate(model, fixed_point=k, **options).p[-1] - final).max() for k in range(1, 13)]
    needed = 1 + next((k for k, difference in enumerate(differences) if difference <= 1e-15), len(differences))
    return needed, differences


def draw(experiment, directory):
    """Draw q(t) of the first seed, the differences of ten seeds, and those of many paths."""
    mosaic = [["path", "path"], ["seeds", "many"]]
    with panels(directory / "figure_4_1.png", mosaic, height=4.2, width_ratios=[1.4, 1]) as axes:
        _draw_path(axes["path"], experiment.curves)
        _draw_seeds(axes["seeds"], experiment.numbers["seeds"])
        axis, differences = axes["many"], experiment.curves["differences"]
        count = differences.size
        axis.loglog(differences, (count - np.arange(count)) / count, color=look.BLUE)
        axis.axvline(SHOWN, color=look.GREY, ls="--", lw=0.9)
        axis.set(xlabel=r"$\max_t |q-q_{h/64}|$", ylabel="share of paths above", ylim=(0.8 / count, 1.3))


def _draw_path(axis, curves):
    axis.plot(curves["t"], curves["fine"], color=look.BLACK, lw=2.2, alpha=0.35, label="midpoint, $h/64$")
    axis.plot(curves["t"], curves["midpoint"], color=look.BLUE, lw=0.9, label="midpoint (82)-(83)")
    axis.plot(curves["t"], curves["formula"], "-.", color=look.VERMILION, lw=0.9, label="formula after (83)")
    top = 1.6 * np.abs(curves["fine"]).max()
    axis.set(xlabel="$t$", ylabel="$q$", xlim=(0, TIME), ylim=(-0.75 * top, top))
    axis.legend(ncols=3, loc="upper center")


def _draw_seeds(axis, rows):
    seeds = [row["seed"] for row in rows]
    for key, marker, colour, text in (
        ("midpoint_fine", "o", look.BLUE, "midpoint"),
        ("reference_fine", "x", look.VERMILION, "after (83)"),
        ("midpoint_eighth_fine", "s", look.GREEN, "midpoint, $h/8$"),
    ):
        axis.semilogy(seeds, [row[key] for row in rows], marker, color=colour, label=text)
    axis.axhline(SHOWN, color=look.GREY, ls="--", lw=0.9)
    axis.set(xlabel="seed", ylabel=r"$\max_t |q-q_{h/64}|$", xticks=seeds, ylim=(5e-4, 60))
    axis.legend(ncols=2, loc="upper center", columnspacing=0.8, handletextpad=0.1)
