# SPDX-License-Identifier: BSD-3-Clause
"""Fixtures and checks that all tests of the package share."""

import io

import numpy as np
import pytest
import symsde as ss
from clock import WorkClock

A, SIGMA = 1.0, 0.3


def table_of(path):
    """The lines of a table, without those that record when and how it was made."""
    return [line for line in path.read_text(encoding="utf-8").splitlines() if not line.startswith("#")]


def told(path):
    """The values in the comment lines (#) of a table, by name."""
    found, name = {}, ""
    for line in io.StringIO(path.read_text(encoding="utf-8")):
        if line.startswith("#   ") or line == "#\n":
            found[name] += line[4:] or "\n"
        elif line.startswith("# "):
            name, _, value = line[2:].rstrip("\n").partition(":")
            found[name] = value.removeprefix(" ")
    return found


def moments_of(scene):
    """The moments of a scene by one call of the library."""
    found = ss.moments(scene.model, observables=scene.observables, observers=scene.observers, **scene.run)
    found.scene = scene.text
    return found


def paths_of(scene):
    """The paths that a scene saves, computed by one call of the library for all of them."""
    run = ss.simulate(scene.model, **scene.run)
    kept = np.isin(run.path, scene.paths)
    for name in ("path", "q", "p", "status", "failed_step", "last_q", "last_p", "q_low", "p_low"):
        if getattr(run, name) is not None:
            setattr(run, name, getattr(run, name)[..., kept])
    return run


def rotation_gradient(t, w, q, p):
    """Kubo's oscillator as a NumPy function: S = (a w_0 + sigma w_1)(p^2 + q^2)/2."""
    rate = A * w[0] + SIGMA * w[1]
    return rate * q, rate * p


def rotation_hessian(t, w, q, p):
    """Second derivatives of Kubo's oscillator."""
    rate = (A * w[0] + SIGMA * w[1])[None, None, :]
    return rate, np.zeros_like(rate), rate


def rotation_value(t, w, q, p):
    """Values of Kubo's oscillator."""
    return (A * w[0] + SIGMA * w[1]) * (p[0] ** 2 + q[0] ** 2) / 2


@pytest.fixture
def work_clock(monkeypatch):
    """A clock of counted seconds, so that choices by cost are the same on every machine, however busy."""
    return WorkClock(monkeypatch)


def pytest_configure(config):
    """The mark of tests whose formulas are compiled as those of users are."""
    config.addinivalue_line("markers", "optimised: compile formulas with the normal level of optimisation")


@pytest.fixture
def quick_compiler():
    """Compile formulas without the optimiser, in a third of the time, with the same bits: for tests that make many
    models and take few steps."""


@pytest.fixture(autouse=True)
def level_of_optimisation(request, monkeypatch):
    """Compile formulas with -O1, in 0.4 of the time, with the same bits. Tests of lanes, strips and single paths use
    the normal level, by the mark `optimised`, of a test or of its file; the mark of a test counts before that of its
    file."""
    level = "-O1"
    for mark in request.node.iter_markers():
        if mark.name == "optimised":
            return
        if "quick_compiler" in mark.args:
            level = "-O0"
            break
    from symsde.model.formulas import compiler

    monkeypatch.setattr(compiler, "FLAGS", tuple(level if flag == "-O3" else flag for flag in compiler.FLAGS))


@pytest.fixture
def kubo():
    """The built-in model whose functions `user_kubo` repeats."""
    return ss.models.kubo(a=A, sigma=SIGMA)


@pytest.fixture
def user_kubo():
    """Kubo's oscillator with NumPy callables."""
    return ss.Model(
        ndof=1,
        nnoise=1,
        gradient=rotation_gradient,
        hessian=rotation_hessian,
        value=rotation_value,
        separable=True,
        quadratic=True,
        name="user_kubo",
    )


@pytest.fixture
def options():
    """Options of a short run."""
    return {"q0": 1.0, "p0": 0.0, "step": 0.05, "steps": 40, "paths": 12, "seed": 7, "save_every": 10}
