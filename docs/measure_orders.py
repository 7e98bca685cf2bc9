# SPDX-License-Identifier: BSD-3-Clause
"""Measure the orders that schemes have, by class of noise, into docs/measured.json.

    .venv/bin/python docs/measure_orders.py [SCHEME ..]

Schemes that are named are measured alone, and the others keep what is known of them.

Strong orders: root-mean-square distances at T = 1 on common Brownian paths, fitted over the steps that stand out from
the reference, as `symsde.convergence` does: the exact solution for Kubo, else a scheme of higher order eight times
finer, or 64 times finer where it may be of the same order; its own error is kept beside the order. Models that refuse
a scheme are followed by the next one of the class. Steps are sums of finer draws there; schemes whose areas matter are
measured on steps as they are drawn (refine = 0), against the same path halved (refine < 0), so that what is left of an
area counts, too.

Weak orders: second moments of linear problems, without sampling. The increments of one step have a discrete law, the
scheme's own or Gauss-Hermite nodes of the Gaussian one, so the mean of the step's map on products of two coordinates is
a finite sum; its powers are compared with exp(T G), G the generator on these products.
"""

import itertools
import json
import math
import sys
from pathlib import Path

import numba
import numpy as np
import symsde as ss
from symsde.answers.coupled import end, halvings, rms, squares
from symsde.answers.coupled_errors import References, measure, strong_error
from symsde.answers.error_plan import make_plan
from symsde.studies.study import orders

FILE = Path(__file__).with_name("measured.json")
FAMILIES = ("dirk:0.25", "lambda:0.3")
STATE = {"q0": 0.9, "p0": 0.4, "seed": 11, "horizon": 1.0}
NODES = 12  # of Gauss and Hermite
FINER = 32  # steps of a path halved
TWO_POINT, THREE_POINT = ((-1, 1), (0.5, 0.5)), ((-np.sqrt(3), 0, np.sqrt(3)), (1 / 6, 2 / 3, 1 / 6))
LAWS = {
    "midpoint_weak1": TWO_POINT,
    **dict.fromkeys(("gauss2_weak2", "gauss2_weak2_areas", "verlet_dkd_weak2"), THREE_POINT),
}


def tilted_pendulum():
    """H = p^2/2 - cos q with H_1 = p/2, H_2 = 3 q/10: additive noise in q and p, and no bracket is constant."""

    @numba.cfunc(ss.numba_signature("gradient"))
    def gradient(nlane, ndof, nham, t, w, q, p, hq, hp, user):  # noqa: PLR0917 - as the library calls it
        rate, x, y = (numba.carray(w, (nham, nlane)), numba.carray(q, nlane), numba.carray(p, nlane))
        force, speed = numba.carray(hq, nlane), numba.carray(hp, nlane)
        for i in range(nlane):
            if force.ctypes.data != 0:
                force[i] = rate[0, i] * math.sin(x[i]) + 0.3 * rate[2, i]
            if speed.ctypes.data != 0:
                speed[i] = rate[0, i] * y[i] + 0.5 * rate[1, i]
        return 0

    @numba.cfunc(ss.numba_signature("hessian_vector"))
    def product(nlane, ndof, nham, t, w, q, p, vq, vp, uq, up, user):  # noqa: PLR0917
        rate, x = numba.carray(w, (nham, nlane)), numba.carray(q, nlane)
        first, second = numba.carray(vq, nlane), numba.carray(vp, nlane)
        to_first, to_second = numba.carray(uq, nlane), numba.carray(up, nlane)
        for i in range(nlane):
            to_first[i] = rate[0, i] * math.cos(x[i]) * first[i]
            to_second[i] = rate[0, i] * second[i]
        return 0

    @numba.cfunc(ss.numba_signature("value"))
    def value(nlane, ndof, nham, t, w, q, p, h, user):  # noqa: PLR0917
        rate, x, y = (numba.carray(w, (nham, nlane)), numba.carray(q, nlane), numba.carray(p, nlane))
        result = numba.carray(h, nlane)
        for i in range(nlane):
            result[i] = (
                rate[0, i] * (y[i] ** 2 / 2 - math.cos(x[i])) + 0.5 * rate[1, i] * y[i] + 0.3 * rate[2, i] * x[i]
            )
        return 0

    traits = {"separable": True, "additive": True, "identity_mass": True}
    functions = {"gradient": gradient, "hessian_vector": product, "value": value}
    return ss.Model(ndof=1, nnoise=2, name="tilted_pendulum", **functions, **traits)


ACCURATE = "gauss2_strong32_areas"
# class of noise: problems in turn, numbers of steps, paths
STRONG = {
    "additive": (
        [tilted_pendulum, lambda: ss.models.fpu_chain(n=1, beta=1.0, sigma=1.0), ss.models.henon_heiles],
        [8, 16, 32, 64, 128, 256], 800,
    ),
    "commutative": (
        [lambda: ss.models.pendulum(sigma=0.5), lambda: ss.models.synchrotron(omega=1.0, sigma1=2.0, sigma2=1.0)],
        [8, 16, 32, 64, 128, 256], 800,
    ),
    "general": ([lambda: ss.models.noncommutative_oscillator(s1=1.0, s2=1.0)], [4, 8, 16, 32, 64], 400),
    "commuting": ([lambda: ss.models.kubo(a=1.0, sigma=0.5)], [8, 16, 32, 64, 128, 256], 800),
}  # fmt: skip


def strong(kind, names, paths=None):
    """{scheme: order for a class of noise as a dict}; schemes that every model of the class refuses are left out."""
    problems, steps, all_paths = STRONG[kind]
    paths = paths or all_paths
    found = {}
    for make in problems:
        model = make()
        chosen = [name for name in names if name not in found and fits(model, name)]
        if not chosen:
            continue
        plan = make_plan(model, schemes=chosen, steps=steps, paths=paths, **STATE)
        references = References(plan)
        for scheme in plan.schemes:
            as_drawn = kind == "general" and scheme.info.uses_areas
            if as_drawn:  # the longest step, h = 1/4, is far from small for an expansion in h: slopes 0.7 and 0.6
                rows = [{"h": 1 / n, **as_it_is_drawn(plan, scheme, n)} for n in steps[1:]]
            else:
                rows = [{"h": 1 / n, **measure(plan, scheme, n, references)} for n in steps]
            rows = [{**row, "status": orders.judge(row)} for row in rows]
            reference = f"{ACCURATE}, {FINER} steps a step" if as_drawn else plan.references[scheme.name]
            found[scheme.name] = entry(model.name, reference, rows)
            print(f"{scheme.name:26s} {kind:12s} {found[scheme.name]}", flush=True)
    return {name: row for name, row in found.items() if row is not None}


def as_it_is_drawn(plan, scheme, n):
    """Errors of n steps at refine = 0, against the same path halved."""
    fine, half = (
        end(plan.run(ACCURATE, finer, shared=False, refine=-halvings(finer, n)))
        for finer in (FINER * n, FINER * n // 2)
    )
    square = squares(end(plan.run(scheme, n, shared=False)), fine)
    return {"failed": 0, "ref_error": rms(squares(fine, half)), **strong_error(square, fine)}


def fits(model, name):
    """Whether the model takes the scheme."""
    try:
        ss.simulate(model, q0=0.9, p0=0.4, scheme=name, step=0.125, steps=0)
    except (ss.errors.IncompatibleError, ss.errors.InvalidArgumentError):
        return False
    return True


def entry(problem, reference, rows):
    """What is kept of one measurement; None where rounding leaves fewer than two steps."""
    order = orders.fitted(rows)
    if order.points < 2:
        return None
    floor = max(row["ref_error"] / row["err_strong"] for row in rows if row["status"] == "ok")
    numbers = {"order": round(order.value, 3), "half_width": round(order.half, 3)}
    return {
        "problem": problem,
        **numbers,
        "reference": str(reference),
        "floor": float(f"{floor:.1e}"),
    }


# ---- weak orders --------------------------------------------------------------------------------

SPIN = np.array([[0.0, 0, 0], [0, 0, 1], [0, -1, 0]])  # of (1, q, p): the oscillator
STRENGTH = 0.8
MIDDLES = (np.arange(4) + 0.5) / 4
# four straight rows that make every dW, H = int (1/2 - s) dW and K = int (s^2 - s + 1/6) dW /2
QUARTERS = np.linalg.pinv(np.stack([np.ones(4), 0.5 - MIDDLES, (MIDDLES**2 - MIDDLES + 1 / 6 + 1 / 192) / 2]))


def noise_matrix(row, column, value):
    """The matrix of dW in d(1, q, p)."""
    matrix = np.zeros((3, 3))
    matrix[row, column] = value
    return matrix


LINEAR = [
    (lambda: ss.models.noncommutative_oscillator(s1=0.0, s2=STRENGTH), [noise_matrix(2, 1, -STRENGTH)]),
    (lambda: ss.models.linear_oscillator(sigma=1.0), [noise_matrix(2, 0, 1.0)]),
]
CROSSED = [  # for schemes whose weak order is that of every noise: two that do not commute
    (
        lambda: ss.models.noncommutative_oscillator(s1=STRENGTH, s2=STRENGTH),
        [noise_matrix(1, 2, STRENGTH), noise_matrix(2, 1, -STRENGTH)],
    ),
]


def drives(noises, scheme, h):
    """Every way in which a step may be driven: rows (row, noise), probability. The noise that acts is the last one."""
    roots, weights = np.polynomial.hermite_e.hermegauss(NODES)
    gauss = tuple(roots), tuple(weights / weights.sum())
    law = LAWS.get(scheme, gauss)
    shapes = gauss if scheme not in LAWS else ((0.0,), (1.0,))
    stt_areas = gauss if scheme.startswith("chin4a") else ((0.0,), (1.0,))
    for (x, u), (y, v), (z, w) in itertools.product(*(zip(*each, strict=True) for each in (law, shapes, stt_areas))):
        rows = np.zeros((4, noises))
        rows[:, -1] = QUARTERS @ (np.sqrt(h / np.array([1, 12, 720])) * (x, y, z))
        yield rows, u * v * w


def crossed_drives(law, h):
    """Two noises of a law with areas +-h/2: a square that has the area, then a straight line."""
    side = math.sqrt(h / 2)
    for (x, u), (y, v), sign in itertools.product(zip(*law, strict=True), zip(*law, strict=True), (-1, 1)):
        square = side * np.array([(1, 0), (0, sign), (-1, 0), (0, -sign)])
        yield np.concatenate([square, np.tile((x, y), (4, 1)) * math.sqrt(h) / 4]), u * v / 2


def mean_map(model, scheme, h):
    """Mean over one step of A (x) A, for the scheme's map A of (1, q, p): (9, 9)."""
    crossed = ss.schemes.get(scheme).info.crosses_noises
    points = list(crossed_drives(LAWS[scheme], h) if crossed else drives(model.nnoise, scheme, h))
    starts = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    rows = np.repeat(np.stack([rows for rows, _ in points], axis=-1), 3, axis=-1)
    q0, p0 = (np.tile(starts[:, k], len(points))[np.newaxis] for k in (0, 1))
    refine = len(rows).bit_length() - 1
    run = ss.simulate(
        model, q0=q0, p0=p0, scheme=scheme, step=h, steps=1, paths=q0.shape[1], increments=rows, refine=refine
    )
    ends = np.stack([run.q[-1, 0], run.p[-1, 0]]).reshape(2, len(points), 3)
    total = np.zeros((9, 9))
    for i, (_, weight) in enumerate(points):
        shift, first, second = ends[:, i].T
        step = np.array([[1.0, 0, 0], *np.stack([shift, first - shift, second - shift], axis=1)])
        total += weight * np.kron(step, step)
    return total


def exponential(matrix):
    """exp of a small matrix by scaling and its series."""
    scaled, result, term = matrix / 256, np.eye(len(matrix)), np.eye(len(matrix))
    for k in range(1, 20):
        term = term @ scaled / k
        result += term
    return np.linalg.matrix_power(result, 256)


def weak(scheme):
    """Weak order of a scheme, and how much the last two local slopes differ; none where J is sampled, whose law
    given straight rows is another.
    """
    if scheme.endswith("_strong2"):
        return None
    for make, noises in CROSSED if ss.schemes.get(scheme).info.crosses_noises else LINEAR:
        model = make()
        exact = generator_map(noises)
        counts = [16, 32, 64, 128]
        try:
            maps = [np.linalg.matrix_power(mean_map(model, scheme, 1.0 / n), n) for n in counts]
        except (ss.errors.IncompatibleError, ss.errors.InvalidArgumentError):
            continue
        errors = np.array([np.abs(found - exact).max() for found in maps])
        slopes = np.diff(np.log2(errors)) / -1
        if errors[-1] < 1e-12:
            return None  # exact for linear problems: nothing is measured
        found = {"problem": model.name, "order": round(float(slopes[-1]), 3)}
        return found | {
            "half_width": round(float(abs(slopes[-1] - slopes[-2])), 3),
            "reference": "exp(T L)",
            "floor": 0.0,
        }
    return None


def generator_map(noises):
    """exp(T G) of the products of two coordinates, T = 1; the squares of the noises are the Stratonovich drift."""
    unit = np.eye(3)
    drift = SPIN + sum(noise @ noise for noise in noises) / 2
    return exponential(np.kron(drift, unit) + np.kron(unit, drift) + sum(np.kron(noise, noise) for noise in noises))


# ---- all of them --------------------------------------------------------------------------------


def main() -> None:
    """Measure every scheme of the catalogue, or those that are named."""
    every = [*ss.schemes.names(), *FAMILIES]
    names = sys.argv[1:] or every
    if unknown := set(names) - set(every):
        sys.exit(f"no schemes of the catalogue: {', '.join(sorted(unknown))}")
    known = json.loads(FILE.read_text(encoding="utf-8")) if sys.argv[1:] else {}
    found = {name: {} if name in names else known.get(name, {}) for name in every}
    for kind in STRONG:
        able = [name for name in names if ss.schemes.get(name).info.orders[kind].value > 0]
        for name, row in strong(kind, able).items():
            found[name][kind] = row
    for name in names:
        row = weak(name)
        if row is not None:
            found[name]["weak"] = row
    lines = (f" {json.dumps(name)}: {json.dumps(rows)}" for name, rows in found.items())
    FILE.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")


if __name__ == "__main__":
    main()
