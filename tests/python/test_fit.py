# SPDX-License-Identifier: BSD-3-Clause
"""Fits: exact where there is no noise, derivatives equal to differences, errors as weighted least squares has them."""

import warnings

import numpy as np
import pytest
import symsde as ss
from symsde.errors import (
    DoubtfulRunWarning,
    IncompatibleError,
    InvalidArgumentError,
    UnknownNameError,
    WrongShapeError,
    WrongTypeError,
)
from symsde.run.fit import _Problem
from symsde.run.fit_data import read_data
from symsde.run.setup import make_setup

pytest.importorskip("scipy")

T = np.array([0.0, 0.3, 0.5, 1.1, 2.0])
RUN = {"q0": 1.0, "p0": 0.2, "step": 0.1, "scheme": "stormer_verlet"}


def pendulum(**values):
    """A pendulum with a noise in position."""
    values = {"k": 1.2, "sigma": 0.4} | values
    return ss.model_from_sympy("p**2/2 - k*cos(q)", ["sigma*sin(q)"], params=values)


def pushed(**values):
    """p = a t + s W: a fit of a is linear."""
    values = {"a": 0.3, "s": 0.5} | values
    return ss.model_from_sympy("p**2/2 - a*q", ["-s*q"], params=values)


def measured(model, seed, series, t=T, **run):
    """Series of the model: q and p, (time, series) each."""
    run = RUN | run
    found = ss.simulate(model, **run, steps=round(t[-1] / run["step"]), paths=series, seed=seed)
    at = np.rint(t / run["step"]).astype(int)
    return found.q[at, 0], found.p[at, 0]


@pytest.mark.parametrize("scheme", ["stormer_verlet", "midpoint", "gauss2"])
def test_without_noise(scheme):
    """Data without noise give back parameters and initial state."""
    make = lambda **x: ss.model_from_sympy("p**2/2 - k*cos(q) + a*q**4", params={"k": 1.2, "a": 0.1} | x)  # noqa: E731
    run = RUN | {"scheme": scheme}
    q, p = measured(make(), 1, 1, **run)
    data = {"q": q[:, 0], "k*p + q**2": 1.2 * p[:, 0] + q[:, 0] ** 2}
    start = run | {"q0": 0.9, "p0": 0.3}
    found = ss.fit(make(k=1.4, a=0.2), data, ["a", "q0", "k", "p0"], t=T, **start)
    for name, x in (("a", 0.1), ("q0", 1.0), ("k", 1.2), ("p0", 0.2)):
        assert abs(found.values[name] - x) < 1e-8
    assert found.converged and found.se["k"] < 1e-8 and found.freedom == 6
    assert found.model.parameters["k"] == found.values["k"]


def test_two_degrees_of_freedom():
    """States of several degrees of freedom, names of their columns, and a parameter of a built-in model."""
    make = lambda **x: ss.models.henon_heiles(**{"sigma1": 0.0, "sigma2": 0.0, "alpha": 0.4} | x)  # noqa: E731
    run = {"q0": [0.2, 0.1], "p0": [0.1, 0.2], "step": 0.1, "scheme": "midpoint"}
    truth = ss.simulate(make(), **run, steps=20)
    data = {"q_1": truth.q[4::4, 0, 0], "q_2": truth.q[4::4, 1, 0]}
    t = truth.t[4::4]
    given = run | {"q0": [0.25, 0.05], "paths": 2}
    found = ss.fit(make(alpha=0.5), data, ["alpha", "q0"], t=t, **given)
    assert abs(found.values["q0"] - run["q0"]).max() < 1e-8 and abs(found.values["alpha"] - 0.4) < 1e-8
    assert found.columns == ("alpha", "q0[0]", "q0[1]") and found.covariance.shape == (3, 3)


def problem_of(model, wrt, data, **run):
    """Residuals as functions of theta."""
    given = read_data(data, T, 0.1)
    return _Problem(make_setup(model, **RUN | {"paths": 20, "steps": 1, "seed": 3} | run), given, wrt)


@pytest.mark.parametrize("t0", [0.0, 0.7])
def test_derivatives(t0):
    """Derivatives of means and variances are those of differences with the same noise."""
    s = np.linspace(0.2, 0.5, 20)
    H = "p**2/2 - k*cos(q) + b*sin(t)*q"
    model = ss.model_from_sympy(H, ["s*sin(q)", "0.1*q"], params={"k": 1.2, "s": s, "b": 0.3})
    data = {"q": 0 * T, "var(p)": 0 * T, "k*q*p": 0 * T, "var(b*q)": np.where(T > 0.3, 0.0, np.nan)}
    problem = problem_of(model, ["b", "p0", "k"], data)
    if t0:
        given = read_data(data, T + t0, 0.1)
        problem = _Problem(make_setup(model, **RUN, paths=20, steps=1, t0=t0, first_step=4), given, ["b", "p0", "k"])
    theta = problem.start
    J = problem.jacobian(theta).copy()
    for k, d in enumerate(1e-4 * np.eye(3)):
        pairs = [(n, problem.residuals(theta + n * d) - problem.residuals(theta - n * d)) for n in (1, 2)]
        right = (8 * pairs[0][1] - pairs[1][1]) / 12e-4
        assert abs(J[:, k] - right).max() < 1e-7 * abs(J[:, k]).max()


def test_means_are_those_of_a_run():
    """Means and variances have the values of a run with the seed, at unequal times."""
    problem = problem_of(pendulum(), ["k"], {"q": 0 * T, "var(p)": 0 * T})
    q, p = measured(pendulum(), 3, 20)
    right = np.concatenate((q.mean(axis=1), p.var(axis=1, ddof=1))) / 0.1
    np.testing.assert_allclose(problem.residuals(problem.start), right, rtol=1e-12, atol=1e-13)


def test_linear_errors():
    """A linear fit by formulas: the value, and both parts of its error."""
    t, e = T[1:], np.array([0.1, 0.2, 0.05, 0.3])
    d = 0.4 * t + [0.1, -0.1, 0.02, 0.1]
    run = {"q0": 0.0, "p0": 0.0, "step": 0.1, "paths": 50, "seed": 4}
    found = ss.fit(pushed(), {"p": d}, "a", t=t, errors=e, **run)
    w = measured(pushed(a=0.0), 4, 50, t, **{"q0": 0.0, "p0": 0.0})[1]
    weights = t / e**2 / (t**2 / e**2).sum()
    assert abs(found.values["a"] - weights @ (d - w.mean(axis=1))) < 1e-9
    np.testing.assert_allclose(found.se_data["a"], (t**2 / e**2).sum() ** -0.5, rtol=1e-9)
    noise = (weights @ w).std(ddof=1) / np.sqrt(50)
    np.testing.assert_allclose(found.se_paths["a"], noise, rtol=1e-9)
    np.testing.assert_allclose(found.se["a"], np.hypot(found.se_data["a"], noise), rtol=1e-12)
    np.testing.assert_allclose(found.fitted_se["p"], t * found.se["a"], rtol=1e-9)
    assert found.errors_from == "errors" and found.freedom == 3
    plain = ss.fit(pushed(), {"p": d}, "a", t=t, **run)
    rest = d - w.mean(axis=1) - t * plain.values["a"]
    np.testing.assert_allclose(plain.se_data["a"], np.sqrt((rest**2).sum() / 3 / (t**2).sum()), rtol=1e-6)
    np.testing.assert_allclose(plain.errors["p"], np.sqrt((rest**2).sum() / 3), rtol=1e-6)
    assert plain.errors_from == "residuals"


def test_errors_of_series():
    """Values of series at different times are not independent: the error is that of the weighted mean of series."""
    t = T[1:]
    run = {"q0": 0.0, "p0": 0.0, "scheme": "stormer_verlet"}
    q, p = measured(pushed(a=0.4), 9, 30, t, **run)
    found = ss.fit(pushed(), {"p": p, "-q": -q}, "a", t=t, **run, step=0.1, paths=50)
    series, slope = np.concatenate((p, -q)), np.concatenate((t, -(t**2) / 2))
    e = series.std(axis=1, ddof=1) / np.sqrt(30)
    weights = slope / e**2 / (slope**2 / e**2).sum()
    np.testing.assert_allclose(np.concatenate((found.errors["p"], found.errors["-q"])), e, rtol=1e-12)
    np.testing.assert_allclose(found.se_data["a"], (weights @ series).std(ddof=1) / np.sqrt(30), rtol=1e-9)
    assert found.errors_from == "series" and found.se_data["a"] > 1.3 * (slope**2 / e**2).sum() ** -0.5


def test_recovers():
    """Series of another seed: 24 fits of two parameters have the stated errors. The sum of 48 squares of errors over
    standard errors lies between 15 and 110: fails once in 10^6, if errors are normal; with a spring 8 % off it fails.
    """
    t = np.arange(1, 7) * 0.5
    q, p = measured(pendulum(), 50, 24 * 150, t)
    squares = {1.2: 0.0, 1.3: 0.0}
    for i in range(24):
        one = slice(150 * i, 150 * (i + 1))
        found = ss.fit(
            pendulum(k=1.4, sigma=0.3),
            {"q": q[:, one], "var(p)": p[:, one]},
            ["k", "sigma"],
            t=t,
            paths=100,
            seed=i,
            **RUN,
        )
        for k in squares:
            squares[k] += ((found.values["k"] - k) / found.se["k"]) ** 2
            squares[k] += ((found.values["sigma"] - 0.4) / found.se["sigma"]) ** 2
    assert 15 < squares[1.2] < 110 < squares[1.3]


def test_bounds_and_budget():
    """A bound is kept and told; a fit that does not converge says so."""
    t = T[1:]
    run = {"t": t, "q0": 0.0, "p0": 0.0, "step": 0.1, "paths": 2}
    found = ss.fit(pushed(s=1e-6), {"p": 0.4 * t}, "a", bounds={"a": (None, 0.35)}, **run)
    assert found.at_bound == ("a",) and 0.34 < found.values["a"] <= 0.35 and "(bound)" in repr(found)
    with pytest.warns(DoubtfulRunWarning, match="did not converge in 1 evaluations"):
        found = ss.fit(pendulum(), {"q": t}, "k", max_evaluations=1, **run | {"q0": 1.0})
    assert not found.converged and "NOT converged" in repr(found)


def test_a_trial_that_fails(monkeypatch):
    """A trial whose paths fail, here of the root of a negative number, is a step too far: the search comes back."""
    make = lambda a: ss.model_from_sympy("p**2/2 + sqrt(a)*q**2/2", params={"a": a})  # noqa: E731
    q, _ = measured(make(0.01), 1, 1)
    runs, run = [], _Problem._run
    monkeypatch.setattr(_Problem, "_run", lambda *x: runs.append(run(*x)) or runs[-1])
    found = ss.fit(make(3.0), {"q": q[:, 0]}, "a", t=T, **RUN)
    assert abs(found.values["a"] - 0.01) < 1e-8
    assert any(np.isnan(r).all() for r, *_ in runs) and found.evaluations == len(runs)
    with pytest.raises(IncompatibleError, match="not finite, where the search begins"):
        ss.fit(make(0.0), {"q": q[:, 0]}, "a", t=T, **RUN)


def test_shown(tmp_path):
    """A table, and a figure with a panel for each name."""
    pytest.importorskip("matplotlib")
    t = T[1:]
    data = {"p": 0.4 * t, "q": np.where(t == 0.5, np.nan, 0.2 * t**2)}
    found = ss.fit(pushed(), data, "a", t=t, errors={"p": 0.1, "q": 0.2}, q0=0.0, p0=0.0, step=0.1, paths=20)
    assert np.isnan(found.fitted["q"][1]) and np.isfinite(found.fitted["q"][[0, 2, 3]]).all()
    lines = repr(found).splitlines()
    assert "chi2" in lines[0] and lines[1].split() == ["value", "error", "of", "data", "of", "paths"]
    assert lines[3].split()[0] == "a" and float(lines[3].split()[1]) == pytest.approx(found.values["a"], rel=1e-7)
    assert "<table>" in found._repr_html_()
    page = found.plot(tmp_path / "fit.png")
    assert len(page.axes) == 2 and (tmp_path / "fit.png").exists()
    drawn = page.axes[0].lines[0].get_ydata()
    np.testing.assert_allclose(drawn, found.fitted["p"])
    assert len(found.plot(of="q").axes) == 1
    with pytest.raises(UnknownNameError, match="there is no value 'x'"):
        found.plot(of="x")


def test_refused():
    """Bad input is refused with a sentence."""
    t = T[1:]
    run = RUN | {"paths": 20}
    good = {"q": t}

    def called(model=None, data=good, wrt="k", **more):
        given = {"t": t} | run | more
        return ss.fit(model or pendulum(), data, wrt, **given)

    for given, error, words in (
        ({"wrt": []}, InvalidArgumentError, "wrt is empty"),
        ({"wrt": "kk"}, UnknownNameError, "there are k, sigma"),
        ({"data": {}}, InvalidArgumentError, "data is empty"),
        ({"data": [1.0]}, WrongTypeError, "data = .* is no table"),
        ({"data": {"q": t[:2]}}, WrongShapeError, r"data of q have shape \(2,\)"),
        ({"data": {"q": t * np.inf}}, InvalidArgumentError, "data of q are not finite"),
        ({"data": {"q": t[:, np.newaxis]}}, InvalidArgumentError, "fewer than two"),
        ({"data": {"q": np.ones((4, 3)), "p": np.ones((4, 2))}}, WrongShapeError, "as many series"),
        ({"data": {"q": np.ones((4, 3)), "p": t}}, IncompatibleError, "data of p have no errors"),
        ({"data": {"z": t}}, InvalidArgumentError, "z"),
        ({"data": {"q": np.where(t == 0.3, 1.0, np.nan)}, "wrt": ["k", "sigma"]}, InvalidArgumentError, "fewer than"),
        ({"errors": -1.0}, InvalidArgumentError, "errors of q are not all finite and positive"),
        ({"errors": [1.0, 2.0]}, WrongShapeError, "errors of q have shape"),
        ({"errors": {"p": 1.0}}, InvalidArgumentError, "is no name of the data"),
        ({"data": {"q": np.ones((4, 3))}, "errors": {"q": 1.0}}, InvalidArgumentError, "has series"),
        ({"data": {"q": t, "p": t}, "errors": {"q": 1.0}}, InvalidArgumentError, "errors holds none of p"),
        ({"t": [0.3, 0.2, 0.5, 0.7]}, InvalidArgumentError, "rising order"),
        ({"t": [0.3, 0.34, 0.5, 0.7]}, InvalidArgumentError, r"t holds 0\.34, which is 3\.4 steps"),
        ({"t0": 1.0}, InvalidArgumentError, "steps of 0.1 after t0 = 1"),
        ({"bounds": {"sigma": (0, 1)}}, InvalidArgumentError, "which is not fitted"),
        ({"bounds": {"k": 3.0}}, InvalidArgumentError, "give a pair"),
        ({"bounds": {"k": (3.0, 4.0)}}, InvalidArgumentError, "do not hold its start"),
        ({"paths": 1}, InvalidArgumentError, "paths = 1"),
        ({"q0": np.ones((1, 20)), "wrt": "q0"}, WrongShapeError, "q0 has shape"),
        ({"model": pendulum(k=np.linspace(1, 2, 20))}, InvalidArgumentError, "differs from path to path"),
        ({"save_every": 2}, InvalidArgumentError, "save_every has no meaning"),
        ({"increments": 2}, InvalidArgumentError, "increments has no meaning"),
        ({"compensated": True}, IncompatibleError, "compensated"),
        ({"tolerance": 0.0}, InvalidArgumentError, "tolerance = 0"),
        ({"scheme": "euler_maruyama"}, IncompatibleError, "Ito form"),
    ):
        with pytest.raises(error, match=words), warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            called(**given)


def test_what_data_do_not_determine():
    """A parameter that no datum knows, and two that are one, are refused by name."""
    model = ss.model_from_sympy("p**2/2 - a*b*q + c", params={"a": 0.3, "b": 0.5, "c": 0.2})
    run = {"t": T[1:], "q0": 0.0, "p0": 0.0, "step": 0.1}
    with pytest.raises(IncompatibleError, match="c changes none of the data"):
        ss.fit(model, {"p": T[1:]}, ["a", "c"], **run)
    with pytest.raises(IncompatibleError, match="do not determine a, b"):
        ss.fit(model, {"p": T[1:]}, ["a", "b"], **run)
