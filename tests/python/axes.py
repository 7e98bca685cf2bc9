# SPDX-License-Identifier: BSD-3-Clause
"""Axes along which faults may hide, a covering design over them, and models with m noises and n degrees of freedom."""

import functools
import itertools
import random

import numpy as np
import reference
import symsde as ss

#: the axes that suites vary, with their values
AXES = {
    "sign": (1, -1),
    "time": ("", "H", "noise", "both"),  # which Hamiltonians depend on time
    "nnoise": (1, 2, 3, 4),
    "ndof": (1, 2, 3),
    "first_step": (0, 7),
    "first_path": (0, 2**31 + 5),
}

TRAITS = {
    "kick": {"additive": True, "position_noise": True, "separable": True, "identity_mass": True},
    "both": {"additive": True},
    "moved": {"additive": True, "separable": True, "identity_mass": True},
    "position": {"position_noise": True, "separable": True, "identity_mass": True},
    "mass": {"position_noise": True, "separable": True, "constant_mass": True},
    "any": {"position_noise": True},
    "separable": {"separable": True, "identity_mass": True},
    "coupled": {},
    "quadratic": {"quadratic": True},
}


def covering(**axes):
    """Rows (dicts) such that every pair of values of any two axes occurs; the same rows in every call."""
    return [dict(row) for row in _covering(tuple(axes.items()))]


@functools.cache
def _covering(axes):
    names, chance = [name for name, _ in axes], random.Random(1)
    left = {((x, a), (y, b)) for (x, xs), (y, ys) in itertools.combinations(axes, 2) for a in xs for b in ys}
    chosen = []
    while left:
        first = min(left, key=repr)
        best, most = None, 0
        for _ in range(30):
            row = {name: chance.choice(values) for name, values in axes} | dict(first)
            met = left & set(itertools.combinations(((name, row[name]) for name in names), 2))
            if len(met) > most:
                best, most, gone = row, len(met), met
        chosen.append(tuple(best.items()))
        left -= gone
    return chosen


def ident(row):
    """Name of a row in the output of pytest."""
    return "-".join(str(x) or "still" for x in row.values())


def ridges_of(kind, ndof, nnoise, time=""):
    """H and H_1 .. H_m of a kind of TRAITS as Ridges: nonlinear where the kind allows, with all degrees of freedom
    coupled.
    """
    units = np.eye(2 * ndof)
    q, p = units[:ndof], units[ndof:]
    swing = {"H": (0.5, 2.3), "noise": (0.6, 3.1)}
    moves = {what: x if time in {what, "both"} else (0, 0) for what, x in swing.items()}

    def mixed(k, places):
        return sum(np.cos(1.3 * k + 0.7 * i) * x for i, x in enumerate(places))

    found, both = [], np.concatenate([q, p])
    for i in range(ndof):
        found += [(0, 2, 0.5 + 0.1 * i, *moves["H"], q[i], 0)] if kind == "quadratic" else [(0, 2, 0.5, 0, 0, q[i], 0)]
        found.append((0, 2, 0.5, 0, 0, p[i] + (0.4 * p[i - 1] if kind in {"mass", "any"} and i else 0), 0))
        if kind in {"both", "any", "coupled"}:
            found.append((0, "sin", 0.3, *moves["H"], mixed(i, both), 0.2))
        if kind == "quadratic":
            found.append((0, 2, 0.1, *moves["H"], mixed(i, both), 0))
        else:
            around = q[i] - 0.6 * q[i - 1] if i else q[0]
            found += [(0, "sin", 0.7, *moves["H"], around, 0.4 * i), (0, 4, 0.05, 0, 0, around, 0)]
    for k in range(1, nnoise + 1):
        at_q, at_p, at_all = (mixed(k, x) for x in (q, p, both))
        shapes = {
            "kick": [(1, 0.6, at_q)],
            "both": [(1, 0.6, at_all)],
            "moved": [(1, 0.6, at_all)],
            "position": [("sin", 0.4, at_q), (2, 0.2, at_q)],
            "separable": [("sin", 0.4, at_q), ("sin", 0.3, at_p)],
            "coupled": [("sin", 0.4, at_all), (2, 0.1, mixed(k + 1, both))],
            "quadratic": [(2, 0.2, at_all), (1, 0.1, at_q)],
        }
        for f, s, a in shapes[{"mass": "position", "any": "position"}.get(kind, kind)]:
            found.append((k, f, s, *moves["noise"], a, 0.3 * k))
    return reference.Ridges(ndof, nnoise, found)


def chain_of(kind, ndof, nnoise, reach, time=""):
    """The same with couplings between sites up to `reach` apart: q_i is coupled to p_{i-1}, but p_i not to q_{i-1}."""
    units = np.eye(2 * ndof)
    q, p, none = units[:ndof], units[ndof:], np.zeros(2 * ndof)
    moves = {what: x if time in {what, "both"} else (0, 0) for what, x in (("H", (0.5, 2.3)), ("noise", (0.6, 3.1)))}
    found, mixes = [], kind in {"both", "any", "coupled", "quadratic"}
    for i in range(ndof):
        q1, p1 = (q[i - 1], p[i - 1]) if i else (none, none)
        q2 = q[i - reach] if i >= reach else none
        around = q[i] - 0.6 * q1 - 0.3 * q2
        found += [(0, 2, 0.5, 0, 0, p[i] + (0.4 * p1 if kind in {"mass", "any"} else 0), 0), (0, 2, 0.5, 0, 0, q[i], 0)]
        if kind == "quadratic":
            found += [(0, 2, 0.3, *moves["H"], around, 0), (0, 2, 0.2, *moves["H"], q[i] + 0.8 * p1, 0)]
        else:
            found += [(0, "sin", 0.7, *moves["H"], around, 0.4 * i), (0, 4, 0.05, 0, 0, around, 0)]
            found += [(0, "sin", 0.4, *moves["H"], q[i] + 0.8 * p1, 0.2)] if mixes else []
    for k in range(1, nnoise + 1):
        i = k % ndof
        at_all = q[i] + 0.7 * p[i - 1] if i else q[0] + 0.3 * p[0]
        shapes = {
            **{x: [(1, 0.6, q[i])] for x in ("kick", "quadratic")},
            **{x: [(1, 0.6, at_all)] for x in ("both", "moved")},
            "separable": [("sin", 0.4, q[i]), ("sin", 0.3, p[i])],
            "coupled": [("sin", 0.4, at_all), (2, 0.1, at_all)],
        }
        at_q = [("sin", 0.4, q[i] - 0.5 * q[i - 1] if i else q[0]), (2, 0.2, q[i])]
        found += [(k, f, s, *moves["noise"], a, 0.3 * k) for f, s, a in shapes.get(kind, at_q)]
    return reference.Ridges(ndof, nnoise, found)


def rotation_of(kind, ndof):
    """Frequencies of the linear part that all models here with an identity mass have."""
    return (1.0,) * ndof if TRAITS[kind].get("identity_mass") else None


def model_of(ridges, kind, *, third=True, silent=(), bandwidth=None):
    """The Ridges as a model of the library; with third=False nested brackets are differences."""
    functions = {x: getattr(ridges, x) for x in ("value", "gradient", "hessian", "hessian_vector")}
    if third:
        functions["third_derivative"] = ridges.third_derivative
    return ss.Model(
        ndof=ridges.ndof,
        nnoise=ridges.nnoise,
        rotation=rotation_of(kind, ridges.ndof),
        derived=True,
        silent=silent,
        bandwidth=bandwidth,
        **functions,
        **TRAITS[kind],
    )


#: forces along the axis `force`: what they depend on, and whether forces go with noises, too
FORCES = ("curl", "curls", "drag", "all")


def pulls_of(force, ndof, nnoise):
    """Pulls of reference.Forced: no gradients where there are two degrees of freedom; `drag` and `all` have p."""
    units, n = np.eye(2 * ndof), ndof
    found = []
    for i in range(n):
        near = units[(i + 1) % n] - 0.5 * units[i]
        if force in {"drag", "all"}:
            near = near + 0.8 * units[n + i]
        found.append((0, np.eye(n)[i], 0.6 - 0.2 * i, near, 0.3 * i, 0.9))
        if force in {"drag", "all"}:
            found.append((0, np.eye(n)[i], -0.5, units[n + i], 0.0, 0.0))
    for k in range(1, nnoise + 1) if force in {"curls", "all"} else ():
        i = k % n
        near = units[(i + 1) % n] + 0.4 * units[i] + (0.5 * units[n + i] if force == "all" else 0)
        found.append((k, np.eye(n)[i], 0.35, near, 0.4 * k, 0.7))
    return found


def start(ndof, paths):
    """Initial states q, p (dof, path), different for every path."""
    i = np.arange(1, ndof * paths + 1).reshape(ndof, paths)
    return 0.7 * np.sin(1.7 * i), 0.6 * np.cos(1.1 * i)


def rows_of(step, steps, rows, nnoise, paths):
    """Increments of steps that are divided into rows, (steps*rows, noise, path)."""
    normals = np.random.default_rng(1).standard_normal((steps * rows, nnoise, paths))
    return normals * np.sqrt(abs(step) / rows)


def philox(seed, path, draw, purpose, noise=0):
    """Four words of Philox4x32-10, shape (4, ..), at level 0 of the counter map (docs/method/noise.md)."""
    path, draw = (np.asarray(x, np.uint64) for x in (path, draw))
    low, word = np.uint64(0xFFFFFFFF), np.uint64(32)
    c = [path & low, (path >> word) + ((draw >> word) << np.uint64(16)), draw & low, np.uint64(noise + (purpose << 26))]
    c = np.array(np.broadcast_arrays(*c))
    for i in range(10):
        key = [np.uint64((x + i * y) & 0xFFFFFFFF) for x, y in ((seed, 0x9E3779B9), (seed >> 32, 0xBB67AE85))]
        one, two = c[0] * np.uint64(0xD2511F53), c[2] * np.uint64(0xCD9E8D57)
        c = np.array([(two >> word) ^ c[1] ^ key[0], two & low, (one >> word) ^ c[3] ^ key[1], one & low])
    return c


def passages(model, run, of, low, high):
    """The step in which each path left (low, high), -1 if never, by a step or a bridge; the run saved every step.

    of: index of the value in (q, p). A bridge is decided by the number with purpose 9 of this path and step.
    """
    x = np.concatenate([run.q, run.p], axis=1)
    first, h = run.setup.options.first_step, run.setup.options.step
    when = np.where((x[0, of] <= low) | (x[0, of] >= high), first, -1)
    for i in range(1, len(x)):
        a, b = x[i - 1, of], x[i, of]
        g = model.derivative(1, run.t[i - 1], x[i - 1])[1:]
        rate = ((np.einsum("ab,kbl->kal", model.turn, g)[:, of]) ** 2).sum(axis=0)
        with np.errstate(divide="ignore", over="ignore"):
            chance = sum(np.exp(-2 * c * d / (rate * abs(h))) for c, d in ((a - low, b - low), (high - a, high - b)))
        words = philox(run.setup.options.seed, run.path, first + i - 1, 9, of + 1).astype(float)
        outside = (b <= low) | (b >= high)
        leaves = outside | ((words[0] * 2.0**32 + words[1] + 0.5) * 2.0**-64 < chance)
        when = np.where((when < 0) & leaves, first + i, when)
    return when
