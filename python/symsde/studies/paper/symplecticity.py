# SPDX-License-Identifier: BSD-3-Clause
"""Change of area by one step, and p^2+q^2 in the long run, for every scheme and for non-symplectic ones; Kubo
oscillator.

The Kubo oscillator is linear, so a step is a 2 x 2 matrix. It is measured three times: as det M - 1 of the images of
two unit vectors, by the library's own diagnostic, and path by path against matrices written down in kubo_maps.py.
"""

from dataclasses import dataclass
from functools import partial

import numpy as np

import symsde as ss

from ...show import look
from . import kubo_maps
from .experiment import Experiment, panels

A, SIGMA, SEED = 1.0, 0.5, 8
STEP, STEPS, PATHS = 0.05, 2000, 20
DEFECT_STEP, POINTS = 0.1, 10_000


@dataclass
class Case:
    """One line of the table: how to run the scheme, its matrix (h, dW) -> M, and the expectations."""

    label: str
    scheme: str
    matrix: object
    symplectic: bool = True
    keeps: float = np.inf  # bound of max |I/I0 - 1| over the run
    options: dict | None = None


def _x(h, dw):
    return A * h + SIGMA * dw


def _tableau(name):
    return lambda h, dw: kubo_maps.tableau(name, _x(h, dw))


def _one_sided(matrix, correction):
    square = {"none": lambda h, dw: 0 * dw, "mean": lambda h, dw: h + 0 * dw, "increments": lambda h, dw: dw**2}
    return lambda h, dw: matrix(_x(h, dw), SIGMA**2 / 2 * square[correction](h, dw))


def _cases():
    """All schemes, symplectic and not, with their expected defects."""
    exact = 1e-10  # round-off of 2000 steps, with a margin
    cases = [
        Case("midpoint", "midpoint", _tableau("midpoint"), keeps=exact),
        Case("Gauss 2", "gauss2", _tableau("gauss2"), keeps=exact),
        Case("Lobatto 3", "lobatto3", _tableau("lobatto3"), keeps=2e-3),
        Case("Stoermer-Verlet", "stormer_verlet", _tableau("stormer_verlet"), keeps=0.3),
    ]
    for label, scheme, matrix in (
        ("sympl. Euler", "symplectic_euler", kubo_maps.symplectic_euler),
        ("adjoint", "symplectic_euler_adjoint", kubo_maps.symplectic_euler_adjoint),
    ):
        for correction in ("none", "mean", "increments"):
            options = {"correction": correction}
            cases.append(Case(f"{label}, {correction}", scheme, _one_sided(matrix, correction), options=options))
    cases += [
        Case("Heun", "heun", lambda h, dw: kubo_maps.heun(_x(h, dw)), symplectic=False),
        Case("Euler-Maruyama", "euler_maruyama", _euler_maruyama, symplectic=False),
    ]
    for count in (3, 10):
        matrix = partial(_fixed_point, count)
        options = {"fixed_point": count}
        cases.append(Case(f"midpoint, {count} iterations", "midpoint", matrix, symplectic=False, options=options))
    return cases


def _euler_maruyama(h, dw):
    return kubo_maps.euler_maruyama(_x(h, dw), SIGMA**2 / 2 * h)


def _fixed_point(count, h, dw):
    return kubo_maps.fixed_point_midpoint(_x(h, dw), count)


def run(quick):
    """Compute the table, line by line."""
    points = 1000 if quick else POINTS
    parameters = {
        "a": A, "sigma": SIGMA, "step": STEP, "steps": STEPS, "paths": PATHS, "defect_step": DEFECT_STEP,
        "defect_points": points,
    }  # fmt: skip
    title = f"Symplecticity and p^2+q^2, Kubo oscillator, sigma = {SIGMA:g}"
    experiment = Experiment("symplecticity", title, seed=SEED, parameters=parameters)
    model = ss.models.kubo(a=A, sigma=SIGMA)
    dw = ss.increments(model, step=STEP, steps=STEPS, paths=PATHS, seed=SEED)
    kicks = ss.increments(model, step=DEFECT_STEP, steps=1, paths=points, seed=SEED)
    table = {}
    for case in _cases():
        table[case.label] = _measure(experiment, model, case, dw, kicks)
        _expect(experiment, case, table[case.label])
    _expect_agreement(experiment, table)
    experiment.numbers["table"] = table
    return experiment


def _measure(experiment, model, case, dw, kicks):
    options = case.options or {}
    columns = [
        ss.step(model, case.scheme, q, p, DEFECT_STEP, dw=kicks[0], **options) for q, p in ((1.0, 0.0), (0.0, 1.0))
    ]
    images = np.stack([np.stack([q[0], p[0]], axis=-1) for q, p in columns], axis=-1)
    matrices = case.matrix(DEFECT_STEP, kicks[0, 0])
    defect = np.sqrt(np.mean(np.square(kubo_maps.determinant_defect(images))))
    row = {
        "det_defect": defect,
        "det_defect_expected": np.sqrt(np.mean(np.square(kubo_maps.determinant_defect(matrices)))),
        "step_difference": np.abs(images - matrices).max(),
    }
    if "fixed_point" not in options:
        found = ss.diagnose.symplecticity(model, case.scheme, q=0.6, p=-0.8, step=DEFECT_STEP, dw=kicks[0], **options)
        row["tangent_defect"] = np.sqrt(np.mean(np.square(found)))
    return row | _long_run(experiment, model, case, dw, options)


def _long_run(experiment, model, case, dw, options):
    computed = ss.simulate(
        model, q0=1.0, p0=0.0, step=STEP, steps=STEPS, scheme=case.scheme, paths=PATHS, increments=dw, **options
    )
    invariant = computed.q[:, 0] ** 2 + computed.p[:, 0] ** 2
    q, p = kubo_maps.follow(case.matrix(STEP, dw[:, 0]), 1.0, 0.0)
    size = np.sqrt(invariant.max())
    experiment.curves[case.label] = computed.t, invariant.mean(axis=1)
    return {
        "mean_final": invariant[-1].mean(),
        "mean_final_expected": (q[-1] ** 2 + p[-1] ** 2).mean(),
        "max_deviation": np.abs(invariant - 1).max(),
        "path_difference": np.hypot(computed.q[:, 0] - q, computed.p[:, 0] - p).max() / size,
    }


def _expect(experiment, case, row):
    """Add two checks: the area, and p^2+q^2 against the matrices on the same path."""
    text = f"{case.label}: rms |det M - 1|"
    if case.symplectic:
        experiment.at_most("(6), Theorem 3.2", text, row["det_defect"], 1e-14)
    else:
        tolerance = 1e-12 + 1e-9 * row["det_defect_expected"]
        experiment.near("(6) violated", text, row["det_defect"], row["det_defect_expected"], tolerance)
    experiment.near(
        "",
        "  mean I(T)/I0, I = p^2+q^2",
        row["mean_final"],
        row["mean_final_expected"],
        1e-9 * row["mean_final_expected"],
    )
    if np.isfinite(case.keeps):
        experiment.at_most("", "  max |I/I0 - 1|", row["max_deviation"], case.keeps)
    else:
        experiment.report("", "  max |I/I0 - 1|", f"{row['max_deviation']:.2g}")


def _expect_agreement(experiment, table):
    """Expect the three measurements to agree."""
    rows = table.values()
    steps = max(row["step_difference"] for row in rows)
    states = max(row["path_difference"] for row in rows)
    tangents = max(abs(row["tangent_defect"] - row["det_defect"]) for row in rows if "tangent_defect" in row)
    experiment.at_most("", "all: one step - matrix", steps, 1e-14)
    experiment.at_most("", "all: states - matrices, over sqrt(max I)", states, 1e-11)
    experiment.at_most("(6)", "all: ss.diagnose.symplecticity - |det M - 1|", tangents, 1e-13)


SHOWN = {  # the curves of the first figure: label, scheme, line, width
    "Euler-Maruyama": ("Euler-Maruyama", "euler_maruyama", "--", 1.1),
    "Heun": ("Heun", "heun", "-.", 1.1),
    "sympl. Euler, none": ("symplectic Euler, uncorrected", "symplectic_euler", ":", 1.3),
    "sympl. Euler, increments": ("symplectic Euler, corrected", "symplectic_euler", "-", 1.1),
    "midpoint": ("midpoint", "midpoint", "-", 2.6),
    "Stoermer-Verlet": ("Störmer-Verlet", "stormer_verlet", "--", 1.1),
}


def draw(experiment, directory):
    """Draw area and invariant of all schemes; and the means over time separately, as the project's first figure."""
    table = experiment.numbers["table"]
    with panels(directory / "symplecticity.png", [["defect", "invariant"]], height=3.6, sharey=True) as axes:
        labels = list(table)[::-1]
        for row, label in enumerate(labels):
            symplectic = table[label]["det_defect_expected"] < 1e-14
            colour, marker = (look.BLUE, "o") if symplectic else (look.VERMILION, "X")
            axes["defect"].plot(max(table[label]["det_defect"], 1e-17), row, marker, color=colour)
            axes["invariant"].plot(table[label]["max_deviation"], row, marker, color=colour)
        names = [label.replace("Stoermer", "Störmer") for label in labels]
        axes["defect"].set(xscale="log", xlabel=r"rms $|\det M-1|$", xlim=(3e-18, 1), yticks=range(len(labels)))
        axes["defect"].set_yticklabels(names, fontsize=7)
        axes["invariant"].set(xscale="log", xlabel=r"$\max\,|I/I_0-1|,\ I=p^2+q^2$")
    draw_invariant(experiment.curves, directory / "kubo_invariant.png", pdf=True)


def invariant_curves():
    """The curves of the first figure, each (t, mean of (p^2+q^2)/(p0^2+q0^2)) at every tenth time."""
    return {
        label: [values[::10] for values in curve] for label, curve in run(quick=True).curves.items() if label in SHOWN
    }


def draw_invariant(curves, path, pdf=False):
    """Draw the mean of the invariant over time under six schemes; curves: {label of SHOWN: (t, mean)}."""
    with panels(path, [["invariant"]], width=4.6, height=3.0, pdf=pdf) as axes:
        axis = axes["invariant"]
        for key, (label, scheme, line, width) in SHOWN.items():
            t, mean = curves[key]
            axis.semilogy(t, mean, line, color=look.colour(scheme), lw=width, label=label)
        axis.set(xlabel="$t$", ylabel=r"mean of $(p^2+q^2)/(p_0^2+q_0^2)$", xlim=(0, STEP * STEPS), ylim=(0.5, 300))
        axis.legend(loc="upper left")
