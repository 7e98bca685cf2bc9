# SPDX-License-Identifier: BSD-3-Clause
"""One bad path among good ones, callbacks that fail, singular matrices."""

from __future__ import annotations

import ctypes

import numpy as np

import symsde as ss

from ..expectations import Expectations
from .nonlinear import residual
from .scenario import EPS, moments, simulate
from .systems import inverted, quartic

SINGULAR, NONFINITE = 2, 3  #: status of a path
BAD = 137  #: index of the bad path


def overflow(quick: bool) -> Expectations:
    """One path at 1e100 .. 1e308 among 10^4 in a quartic potential."""
    result = Expectations("overflow", "One overflowing path among 10^4, midpoint and stormer_verlet")
    paths, steps = 10**4, 5
    start = np.linspace(-1, 1, paths)
    for scheme in ("midpoint", "stormer_verlet"):
        common = {"p0": 0.5, "step": 0.1, "steps": steps, "paths": paths, "scheme": scheme, "threads": 1}
        healthy = simulate(quartic(), q0=start[None], **common)
        for size in (1e100, 1e154, 1e200, 1e308):
            ill = start.copy()
            ill[BAD] = size
            run = simulate(quartic(), q0=ill[None], **common)
            name = f"{scheme}, q0 = {size:.0e}"
            _ill(result, name, run, size, common)
            others = np.arange(paths) != BAD
            same = np.array_equal(run.q[:, :, others], healthy.q[:, :, others])
            told = run.report.failed == (run.status[BAD] != 0)
            result.same(name, "the other paths have the same bits, and are ok", bool(same and told), True)
    _means(result, start, size=1e308, common=common)
    return result


def _ill(result: Expectations, name: str, run, size: float, common: dict) -> None:
    """Expect the bad path to fail at its first step, or its step to be the solution."""
    status, step = int(run.status[BAD]), int(run.failed_step[BAD])
    text, passed = f"{ss.status_text(status)} at step {step}", status == NONFINITE and step == 0
    if status == 0 and common["scheme"] == "midpoint":
        error = residual(size, common["step"], run.q[1, 0, BAD], run.p[1, 0, BAD], p0=common["p0"])
        text, passed = f"solved, residual {error:.0e}", error <= 4 * EPS
    result.expect(name, "its status", text, "not finite at step 0, or solved to 4 eps", passed)


def _means(result: Expectations, start: np.ndarray, size: float, common: dict) -> None:
    """Expect moments over the paths that are ok, and the right number of them."""
    ill = start.copy()
    ill[BAD] = size
    found = moments(quartic(), q0=ill[None], save_every=common["steps"], **common)
    run = simulate(quartic(), q0=ill[None], save_every=common["steps"], **common)
    mean = np.delete(run.q[-1, 0], BAD).mean()
    result.at_most("moments", "mean of q over the paths that are ok", abs(found.mean_q[-1, 0] - mean), 1e-14)
    told = [int(found.n_ok[-1]), found.failed.tolist(), found.report.failed]
    result.same("moments", "paths that count, failed paths, their number", told, [start.size - 1, [BAD], 1])


def labelled(fault, first: float):
    """Pendulum in dof 1; dof 2 is constant, and where it is 1 the callback fails from the time `first` on."""

    def gradient(t, w, q, p):
        hq, hp = np.stack([w[0] * np.sin(q[0]), 0 * q[1]]), np.stack([w[0] * p[0], 0 * p[1]])
        if t > first:
            fault(hq, q[1] == 1)
        return hq, hp

    return ss.Model(ndof=2, nnoise=0, gradient=gradient, separable=True)


def _spoil(value: float):
    def fault(hq, lanes):
        hq[0, lanes] = value

    return fault


def _raise(hq, lanes):
    raise ZeroDivisionError("planted")


def callbacks(quick: bool) -> Expectations:
    """Test callbacks that return NaN or Inf for one lane at step 1, 2 or 1000, return a code, or raise."""
    result = Expectations("callbacks", "Callbacks that fail")
    h, paths, bad = 0.01, 64, 17
    label = np.zeros((2, paths))
    label[0] = np.linspace(-1, 1, paths)
    common = {"p0": 0.0, "step": h, "paths": paths, "threads": 4}
    for k in (1, 2, 200 if quick else 1000):
        steps = k + 3
        healthy = simulate(labelled(_spoil(0.0), np.inf), q0=label, steps=steps, **common)
        for value in (np.nan, np.inf):
            ill = label.copy()
            ill[1, bad] = 1.0
            run = simulate(labelled(_spoil(value), (k - 1) * h), q0=ill, steps=steps, **common)
            found = int(run.status[bad]), int(run.failed_step[bad])
            right = found == (NONFINITE, k - 1) and run.report.failed == 1
            text = f"{np.flatnonzero(run.status).tolist()}, {found[1]}, {ss.status_text(found[0])}"
            result.expect(f"{value} at step {k}", "path, step, status", text,
                          f"[{bad}], {k - 1}, not a finite number; others untouched",
                          right and _untouched(run, healthy, bad))  # fmt: skip
    told = _outcome(lambda: simulate(labelled(_raise, 0.0), q0=label, steps=3, **common))
    result.same("raises in Python", "exception that the caller gets", told, "ZeroDivisionError: planted")
    told = _outcome(lambda: simulate(_coded(7), q0=0.0, p0=0.0, step=h, steps=3))
    result.same("returns code 7 in C", "exception that the caller gets", told.partition(":")[0], "CallbackError")
    return result


def _untouched(run, healthy, bad: int) -> bool:
    """Whether dof 1 of all other paths has the bits of a run without a fault."""
    others = np.arange(run.q.shape[2]) != bad
    return np.array_equal(run.q[:, 0, others], healthy.q[:, 0, others])


def _outcome(action) -> str:
    try:
        action()
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    return "no error"


def _coded(code: int) -> ss.Model:
    """A model whose compiled gradient returns a code; its first call returns 0, so that the model is accepted."""
    array = ctypes.POINTER(ctypes.c_double)
    integers = [ctypes.c_int] * 3
    kind = ctypes.CFUNCTYPE(ctypes.c_int, *integers, ctypes.c_double, *[array] * 5, ctypes.c_void_p)
    return ss.Model(ndof=1, nnoise=0, gradient=kind(lambda *_: code))


def singular_matrices(quick: bool) -> Expectations:
    """Singular matrices must be distinguished from matrices with NaN."""
    result = Expectations("singular_matrices", "Singular and NaN matrices of 20 degrees of freedom")
    for scheme in ("midpoint", "gauss2"):
        run = simulate(chain_of(20, nan_after=0.45), q0=0.1, p0=0.1, step=0.1, steps=9, scheme=scheme, paths=8,
                       general=True)  # fmt: skip
        found, steps = set(run.status.tolist()), set(run.failed_step.tolist())
        right = found <= {SINGULAR, NONFINITE} and steps <= {4, 5}
        result.expect(f"{scheme}, Hessian NaN from step 5 on", "status of every path", _texts(found),
                      "not finite or singular, there", right)  # fmt: skip
        finite = bool(np.isfinite(run.last_q).all() and np.isfinite(run.q[:5]).all())
        result.same(f"{scheme}, Hessian NaN from step 5 on", "last good states are finite", finite, True)
    run = simulate(inverted(20, 0.5), q0=0.1, p0=0.1, step=0.5, steps=2, paths=8)
    found = set(run.status.tolist())
    result.expect("midpoint, 1 + h^2 U''/4 = 0", "status of every path", _texts(found),
                  "singular or not finite, at step 0",
                  found <= {SINGULAR, NONFINITE} and set(run.failed_step.tolist()) == {0})  # fmt: skip
    run = simulate(chain_of(20), q0=0.1, p0=0.1, step=0.1, steps=9, paths=8, scheme="gauss2", general=True)
    used = run.report.counters["pivoted_solves"]
    result.at_least("gauss2, sound run", "solves with exchanges of rows, general stepper", used, 1)
    result.same("gauss2, sound run", "paths that fail", run.report.failed, 0)
    return result


def _texts(found: set[int]) -> str:
    return ", ".join(ss.status_text(status) for status in sorted(found))


def chain_of(n: int, nan_after: float = np.inf) -> ss.Model:
    """n pendulums coupled to their mean by springs; the Hessian is NaN after a given time."""

    def gradient(t, w, q, p):
        return w[0] * (np.sin(q) + q - q.mean(axis=0)), w[0] * p

    def hessian(t, w, q, p):
        lanes = q.shape[1]
        qq = np.zeros((n, n, lanes)) - w[0] / n
        qq[np.arange(n), np.arange(n)] += w[0] * (np.cos(q) + 1)
        if t > nan_after:
            qq[3, 2] = np.nan
        pp = np.zeros((n, n, lanes))
        pp[np.arange(n), np.arange(n)] = w[0]
        return qq, np.zeros((n, n, lanes)), pp

    return ss.Model(ndof=n, nnoise=0, gradient=gradient, hessian=hessian, separable=True, identity_mass=True)
