# SPDX-License-Identifier: BSD-3-Clause
"""Arguments are copied: a caller may change every array, list and table after a call without any effect.

Every public function and method is found by its signature. A parameter takes its value from the tables below by its
name, or its default; a new parameter without either fails the test.
"""

import contextlib
import dataclasses
import inspect
import json
import pickle
import warnings

import numpy as np
import pytest
import sympy
import symsde as ss
from symsde.answers.coupled import Draw

OMITTED = object()  #: value of a parameter that another case gives, or that cannot be changed
PATHS, STEPS = 3, 8
STATE = np.array([[0.9, 1.1, 1.3]])
KUBO = ss.models.kubo(a=1.0, sigma=0.3)
LINEAR = ss.models.linear_oscillator(sigma=0.1)
FORMULA = ss.model_from_sympy("p**2/2 + k*q**2/2", noise=["s*q"], params={"k": 2.0, "s": 0.1})


def gradient(t, w, q, p):
    """Kubo's oscillator."""
    rate = w[0] + 0.3 * w[1]
    return rate * q, rate * p


def two_noises(t, w, q, p):
    """An oscillator of frequency 2 with a noise in position, and a silent one."""
    return w[0] * 4 * q + 0.1 * w[1], w[0] * p


def energy(q, p):
    """Energy of an oscillator."""
    return (q[0] ** 2 + p[0] ** 2) / 2


def prepared():
    """A prepared run, compensated so that low parts can be given."""
    return ss.prepare(KUBO, "midpoint", step=0.05, q0=STATE, p0=0.1 * STATE, paths=PATHS, compensated=True)


#: values of parameters by name, for every function
VALUES = {
    "model": KUBO,
    "scheme": "midpoint",
    "f": "q**2",
    "q0": STATE,
    "p0": 0.1 * STATE,
    "q": STATE,
    "p": 0.1 * STATE,
    "w": np.array([1.0, 0.5]),
    "t": 0.5,
    "by": "tangent",
    "step": 0.05,
    "steps": STEPS,
    "horizon": 0.5,
    "paths": PATHS,
    "dw": np.array([[0.1, -0.2, 0.3]]),
    "seed": 7,
    "truncation": (8, 4.0),
    "threads": 1,
    "lanes": 8,
    "save_at": OMITTED,
    "observables": {"r": "q_1**2 + p_1**2", "e": energy},
    "observers": {"h": ss.observe.Histogram("q_1", -3, 3, 6), "c": ss.observe.Covariance(["q_1", "p_1"])},
    "groups": np.array([4, 0, 4]),
    "progress": OMITTED,
    "damping": np.array([0.5]),
    "allow_gain": True,
    "force": lambda q, p, t: -p,
    "force_derivative": lambda q, p, t: (0 * q[None], 0 * q[None] - 1),
    "noise_force": lambda q, p, t: np.array([q**2]),
    "noise_force_derivative": lambda q, p, t: (2 * q[None, None], 0 * q[None, None]),
    "position_force": False,
    "position_noise_force": True,
    "force_bandwidth": 0,
    "name": "own",
    "out": OMITTED,
    "max_time": OMITTED,
    "level": 1,
    "count": 64,
    "sample": 8,
    "rel": OMITTED,
    "code": 0,
}
HEAT = ss.moments(
    KUBO, q0=STATE, p0=0.1 * STATE, step=0.05, steps=STEPS, paths=PATHS, observables=ss.observe.temperature(KUBO)
)
RUN = ss.simulate(KUBO, q0=STATE, p0=0.1 * STATE, step=0.05, steps=STEPS, paths=PATHS, scheme="gauss2")
ONE_STATE = {"q0": np.array([1.0]), "p0": np.array([0.2])}
LOW = {"q0_low": 1e-17 * STATE, "p0_low": 1e-17 * STATE}
INCREMENTS = 0.1 * np.cos(np.arange(2.0 * STEPS * PATHS)).reshape(2 * STEPS, 1, PATHS)
DRIVEN = {"increments": INCREMENTS, "refine": 1, "common_noise": OMITTED, "truncation": OMITTED}
DRAWN = {
    "increments": OMITTED,
    "area_time": OMITTED,
    "q0_low": OMITTED,
    "p0_low": OMITTED,
    "common_noise": (1,),
    "fixed_point": 2,
}
STUDY = {**ONE_STATE, "paths": 40, "steps": [8, 16], "reference": "gauss2", "reference_steps": 64}
TABLEAU = {"a": [[0.5]], "abar": [[0.5]], "alpha": [1.0], "b": [[0.5]], "bbar": [[0.5]], "beta": [1.0]}
MADE = {
    "ndof": 1,
    "nnoise": 2,
    "gradient": two_noises,
    "silent": [2],
    "touches": [[1], [1]],
    "diagonal_mass": True,
    "rotation": np.array([2.0]),
    "split": np.diag([0.5, 1.0]),
    "kicks": "positions",
    "traits": "probed",
    "bandwidth": 0,
    "separable": True,
    "quadratic": True,
    "identity_mass": True,
    "additive": True,
    "position_noise": True,
    "max_frequency": 2.0,
    "noise_lipschitz": 0.0,
    "noise_force": lambda q, p, t: np.array([q, q**2]),
    "noise_force_derivative": OMITTED,
    **dict.fromkeys(("value", "hessian", "hessian_vector", "gradient_hessian", "third_derivative"), OMITTED),
    **dict.fromkeys(("chain_rows", "flows", "any_lanes", "drift", "kick"), OMITTED),
}
CHAIN = {"H": "Sum(p[i]**2/2 + k*q[i]**2/2, i)", "noise": ["s*q[i]"], "n": 3, "params": {"k": 2.0, "s": 0.1}}
CHAIN |= {"force": OMITTED, "noise_force": OMITTED, "split": OMITTED}
TOLD = {"H": "x**2/2*k + y**2/2", "noise": ["s*x", "s*y"], "q": ["x"], "p": ["y"], "params": {"k": 2.0, "s": 0.1}}
TOLD |= {"force": ["-s*y**3"], "noise_force": [["s*y"], ["0"]], "split": OMITTED}
VALUES["run"] = RUN
#: cases by function that differ from these tables; further entries are options
OWN = {
    "simulate": [
        {**DRIVEN, **LOW, "compensated": True, "area_time": OMITTED},
        DRAWN,
        {**DRAWN, "save_at": np.array([0.05, 0.2, 0.4]), "fixed_point": 0},
    ],
    "moments": [{"paths": PATHS, "common_noise": (1,)}, {"paths": PATHS, "increments": INCREMENTS[::2]}],
    "ensemble": [
        {"paths": PATHS, "executor": OMITTED, "shard_paths": 256, "common_noise": (1,), "truncation": (8, 4.0)}
    ],
    "gradient": [
        {"paths": PATHS, "wrt": ["a", "q0"], "common_noise": (1,), "truncation": (8, 4.0)},
        {"paths": PATHS, "wrt": ["p0"], "increments": INCREMENTS[::2]},
    ],
    "fit": [
        {
            **ONE_STATE,
            "data": {"q": np.array([1.0, 0.9])},
            "wrt": ["a"],
            "t": np.array([0.05, 0.15]),
            "errors": np.array([0.1, 0.2]),
            "bounds": {"a": [0.5, 2.0]},
            "tolerance": 1e-6,
            "max_evaluations": 4,
            "paths": PATHS,
            "common_noise": (1,),
            "truncation": (8, 4.0),
        }
    ],
    **{
        f"{package}_function": [{"paths": PATHS, "wrt": ["a"], "common_noise": (1,), "truncation": (8, 4.0)}]
        for package in ("torch", "jax")
    },
    **{f"{package}_derivative": [{"f": lambda t, q, p: q[-1, 0]}] for package in ("torch", "jax")},
    "tangent": [{"paths": PATHS, "wrt": ["a"], "common_noise": (1,), "truncation": (8, 4.0)}],
    "lyapunov": [{"paths": PATHS, "count": 2, "common_noise": (1,), "truncation": (8, 4.0)}],
    "prepare": [
        {"common_noise": (1,), "truncation": (8, 4.0), "paths": PATHS},
        {"compensated": True, **LOW, "paths": 3},
    ],
    "diagnose.exact_moments": [{**ONE_STATE, "t": [0.5, 1.0], "covariance": np.eye(2)}],
    "diagnose.bath_law": [{"gamma": 0.5, "omega": 2.0}, {"scheme": "lobatto2", "gamma": 0.5, "friction": "force"}],
    "schemes.from_word": [{"word": "BAOAB"}],
    "thermostat": [
        {"model": ss.models.kubo(sigma=0.0), "beta": np.array([2.0]), "gamma": np.array([0.5])},
        {"model": ss.models.linear_oscillator(), "beta": np.array(2.0), "gamma": OMITTED},
    ],
    "level_sampler": [{**ONE_STATE, "steps": 4, "antithetic": True, "truncation": (8, 4.0)}],
    "expect": [
        {**ONE_STATE, "abs": 0.3, "method": "plain", "truncation": (8, 4.0), "groups": OMITTED},
        {**ONE_STATE, "model": FORMULA, "abs": 0.3, "method": "plain", "groups": ("k",)},
    ],
    "mlmc": [{**ONE_STATE, "abs": 0.3, "steps": 4, "truncation": (8, 4.0)}],
    "advise": [{**ONE_STATE, "model": LINEAR, "tolerance": 0.1}],
    "convergence": [{**STUDY, "truncation": (8, 4.0)}],
    "work_precision": [
        {
            **STUDY,
            "schemes": ["midpoint", "heun"],
            "invariants": {"e": energy},
            "about": {"x": "y"},
            "repeats": 5,
            "interval": 0.5,
        }
    ],
    "model_from_sympy": [
        {**TOLD, "t": sympy.Symbol("t"), "invariants": ["x"], "n": OMITTED},
        {**CHAIN, "q": OMITTED, "p": OMITTED, "t": OMITTED, "invariants": OMITTED},
    ],
    "Model": [MADE],
    "numba_signature": [{"kind": "gradient"}],
    "models.get": [{"name": "kubo", "sigma": 0.2}],
    "models.parameters": [{"name": "kubo"}],
    "models.fpu_chain": [{"n": 4}],
    "schemes.get": [{"name": "midpoint"}],
    "Model.probe": [ONE_STATE],
    "diagnose.exact_of": [{"setup": RUN.setup}],
    "schemes.from_quadrature": [
        {"nodes": np.array([0.0, 1.0]), "weights": np.array([0.5, 0.5]), "degree": 1, "noise_weights": [0.5, 0.5]}
    ],
    "schemes.from_tableau": [TABLEAU, {key: np.array(x) for key, x in TABLEAU.items()}],
    "schemes.composition": [{"parts": ["midpoint", "gauss2"], "fractions": np.array([0.25, 0.75])}],
    "diagnose.stationary_path": [
        {
            "q_start": STATE,
            "q_end": 0.5 * STATE,
            "increments": INCREMENTS[::2],
            "step": 0.05,
            "steps": STEPS,
            "paths": 3,
            "guess_q": np.ones((STEPS + 1, 1, 3)),
            "guess_p": np.ones((STEPS + 1, 1, 3)),
        }
    ],
    "states.normal": [{"mean": np.array([0.5]), "sd": np.array([0.2])}, {"cov": np.array([[1.0, 0.5], [0.5, 2.0]])}],
    "states.uniform": [{"low": np.array([-1.0]), "high": np.array([2.0])}],
    "states.matched": [
        {
            "emittance": np.array([0.1]),
            "beta": np.array([2.0]),
            "alpha": np.array([0.3]),
            "q": np.array([0.1]),
            "p": 0.1,
        }
        | {"step": OMITTED, "scheme": OMITTED},
        {"emittance": 0.1, "beta": OMITTED, "alpha": OMITTED, "q": 0.0, "p": 0.0},
    ],
    "states.canonical": [{"beta": 2.0}],
    "states.formula": [{"variables": {"a": 2.0, "b": ss.states.normal(0.0, 1.0)}, "q": ["a*b"], "p": ["b"]}],
    "states.table": [{"rows": np.arange(6.0).reshape(3, 2), "drawn": True}],
    "States.draw": [{"letters": "qp", "first_path": 3}],
    "observe.Histogram": [{"of": "q_1", "low": -1.0, "high": 1.0, "bins": 4}],
    "observe.Quantiles": [{"of": "q_1", "shares": np.array([0.2, 0.5])}],
    "observe.Covariance": [{"of": ["q_1", "p_1"]}],
    "observe.Autocorrelation": [{"of": "q_1", "lags": 2}],
    "observe.Extremes": [{"of": "q_1"}],
    "observe.Passage": [
        {"of": "q_1", "within": OMITTED, "low": -2.0, "high": 2.0, "absorb": False},
        {"of": "q_1", "within": 2.0, "absorb": True},
    ],
    "observe.temperatures": [{"found": HEAT}],
    "observe.Paths": [{"paths": [0, 2], "of": ["q_1"]}, {"paths": np.array([0, 2]), "of": ["q_1"]}],
    "Model.builtin": [{"name": "kubo", "parameters": {"a": 1.0, "sigma": 0.3}}],
    "Model.with_parameters": [{"sigma": 0.2}],
    "FormulaModel.with_parameters": [{"k": 3.0}],
    "sweep": [{"model": FORMULA, "values": {"k": np.array([2.0, 3.0])}, "observables": {"e": energy}}],
    "PreparedRun.reset": [{**LOW, "first_path": 3, "first_step": 2}],
    "PreparedRun.run": [{"increments": INCREMENTS[::2]}],
}
#: objects of methods; functions of a run get a run that saved every step
SUBJECTS = {
    "Model": lambda: KUBO,
    "FormulaModel": lambda: FORMULA,
    "PreparedRun": prepared,
    "States": lambda: ss.states.normal(0.5, 0.2),
    "LevelSampler": lambda: ss.level_sampler(KUBO, "q**2", **ONE_STATE, horizon=0.5, steps=4),
}
#: methods that only the library calls, or that write and keep nothing
NOT_CALLED = {"call", "check_start", "fill", "fill_from_sums", "plot", "told", "save", "table", "resume"}
CLOCKED = {"expect", "mlmc", "advise", "work_precision"}  #: results that hold seconds
#: packages that a function needs beyond those of the tests
PACKAGES = {f"{x}_{kind}": x for x in ("torch", "jax") for kind in ("function", "derivative")}
RESULTS = (
    "Run Moments PreparedRun LevelSampler OpenRun Sweep schemes.Scheme Scheme FormulaModel open_run load Advice "
    "Alternative Answer Answers Commutator Convergence MeanSquare Multilevel Report Traits WorkPrecision "
    "observe.Observed observe.Observer states.States"
)


def public():
    """Names and functions of all public callables with arguments."""
    modules = ("models", "schemes", "diagnose", "observe", "states")
    for prefix, where in {"": ss, **{f"{x}.": getattr(ss, x) for x in modules}}.items():
        own = [
            x for x, thing in vars(where).items() if getattr(thing, "__module__", "") == where.__name__ and x[0] != "_"
        ]
        for name in getattr(where, "__all__", own):
            thing = getattr(where, name)
            made = inspect.isclass(thing) and (issubclass(thing, Exception) or dataclasses.is_dataclass(thing))
            made &= not (prefix == "observe." and name not in ("Observed", "Observer"))
            if callable(thing) and not made and prefix + name not in RESULTS.split() and name != "Certificate":
                yield prefix + name, thing
    for name, make in SUBJECTS.items():
        for method, thing in inspect.getmembers(type(make()), callable):
            inherited = name == "FormulaModel" and method not in vars(ss.FormulaModel)
            if (method[0] != "_" or method == "__call__") and method not in NOT_CALLED and not inherited:
                yield f"{name}.{method}", thing


def cases():
    """Name and function with its arguments, once for each case."""
    for name, function in public():
        parameters = inspect.signature(function).parameters.values()
        if [x for x in parameters if x.name != "self"]:
            for i, own in enumerate(OWN.get(name, [{}])):
                yield pytest.param(name, own, id=f"{name}-{i}" if i else name)


def arguments(name, function, own):
    """The arguments of a case, all of which the caller can change; an argument missing from the tables fails."""
    given = dict(own)
    for x in inspect.signature(function).parameters.values():
        if x.name == "self" or x.kind in (x.VAR_KEYWORD, x.VAR_POSITIONAL):
            continue
        default = OMITTED if x.default in (None, (), x.empty) else x.default
        value = given.setdefault(x.name, VALUES.get(x.name, default))
        covered = any(case.get(x.name, VALUES.get(x.name, OMITTED)) is not OMITTED for case in OWN.get(name, [{}]))
        assert value is not OMITTED or covered or x.name in VALUES or x.name in own, f"{name}: no value for {x.name}"
    return {key: loose(value) for key, value in given.items() if value is not OMITTED}


def loose(value):
    """The same values in changeable form: a list for a tuple, an array without dimension for a number."""
    if isinstance(value, dict):
        return {key: loose(x) for key, x in value.items()}
    if isinstance(value, list | tuple):
        return [loose(x) for x in value]
    return np.array(value) if isinstance(value, int | float | np.ndarray) and not isinstance(value, bool) else value


def change(value):
    """Change an object in place, of whatever type."""
    if isinstance(value, np.ndarray):
        value[...] = 3 * value + 1
    elif isinstance(value, dict | list):
        for x in list(value.values() if isinstance(value, dict) else value):
            change(x)
        value.clear()


def called(name, given):
    """The result of a function, or the object together with its method's result."""
    owner, _, method = name.rpartition(".")
    if owner in SUBJECTS:
        subject = ss.Model if method == "builtin" else SUBJECTS[owner]()
        return subject, getattr(subject, method)(**given)
    where = getattr(ss, owner) if owner else ss
    return None, getattr(where, method)(**given)


def seen(x):
    """All visible contents of a result, and its behaviour when used."""
    if isinstance(x, np.ndarray):
        return (x.shape, str(x.dtype), x.tobytes())
    if isinstance(x, dict | list | tuple):
        items = x.items() if isinstance(x, dict) else x
        return (type(x).__name__, *map(seen, items))
    for kind, look in LOOKS.items():
        if isinstance(x, kind):
            return look(x)
    if dataclasses.is_dataclass(x):
        return (type(x).__name__, *(seen(getattr(x, field.name)) for field in dataclasses.fields(x)))
    return repr(x) if isinstance(x, bool | int | float | str | bytes | None | np.generic) else type(x).__name__


def model_seen(model):
    """Values of a model and of its pickle, and its formulas."""
    found = [repr(model), seen(model.parameters | {}), seen(model.traits)]
    models = [model]
    with contextlib.suppress(ss.SymsdeError):
        models.append(pickle.loads(pickle.dumps(model)))
    if isinstance(model, ss.FormulaModel):
        models.append(model.with_parameters())
        found.append(model.formula.hamiltonians)
        first = "x" if "x" in model.formula.hamiltonians[0] else "q_1"
        options = {"q0": 1.0, "p0": 0.2, "step": 0.1, "steps": 2, "observables": {"o": f"k*{first}"}}
        found.append(seen(ss.moments(model, **options).mean))
    for one in models:
        q = np.linspace(0.5, 1.5, 2 * one.ndof).reshape(one.ndof, 2)
        found.append(seen(one.gradient(q, q / 2, np.ones(one.nnoise + 1), 0.25)))
        found.append(seen(ss.simulate(one, q0=q[:, 0], p0=q[:, 1], step=0.1, steps=2).q))
    return found


def run_seen(run):
    """Arrays and attributes of a run, and diagnostics of it."""
    found = [seen(x) for x in (run.t, run.q, run.p, run.status, run.last_q, run.path, attributes(run))]
    for look in ("exact", "action", "euler_lagrange_residual", "driving_increments"):
        with contextlib.suppress(ss.SymsdeError):
            found.append(seen(getattr(ss.diagnose, look)(run)))
    return found


def attributes(result):
    """Attributes without the date, the command and seconds."""
    found = {key: x for key, x in result.attributes().items() if key not in ("history", "date", "command", "host")}
    return {**found, "report": {**json.loads(found["report"]), "timings": None}}


def moments_seen(found):
    """Tables, observers and attributes."""
    observed = [seen(x.variables(name)) for name, x in found.observed.items()]
    return [*(seen(found.table(kind)) for kind in ("mean", "var", "se_mean")), seen(attributes(found)), observed]


def sweep_seen(found):
    """Values and tables."""
    return [seen(found.parameters), *(seen(found.table(kind)) for kind in ("mean", "var", "se_mean"))]


def gradient_seen(found):
    """Values and derivatives of each path."""
    return [seen(x) for x in (found.f, found.value, found.values, found.by_path)]


def tangent_seen(found):
    """Tangent maps."""
    return [seen(x) for x in (found.matrix, found.by, found.q)]


def lyapunov_seen(found):
    """Exponents of each path."""
    return [seen(x) for x in (found.exponents, found.by_path)]


def prepared_seen(run):
    """States from the present step on, and after a reset."""
    first = run_seen(run.run(2))
    run.reset()
    return [first, run_seen(run.run(4, save_every=2)), seen(run.q)]


def draw_seen(draw):
    """A draw without its seconds."""
    return [seen(x) for x in (draw.difference, draw.fine, draw.coarse, draw.failed)]


def sampler_seen(sampler):
    """New samples of a sampler."""
    return [seen(sampler(level, 16)[0]) for level in (0, 1)]


def scheme_seen(scheme):
    """Coefficients and a step of a scheme and of its pickle."""
    again = pickle.loads(pickle.dumps(scheme))
    return [
        (str(x.certificate()), seen(x.tableau()), seen(ss.step(LINEAR, x, 1.0, 0.2, 0.1, 0.1))) for x in (scheme, again)
    ]


def observer_seen(observer):
    """Fields of an observer, and its records of a run."""
    options = {"q0": STATE, "p0": STATE, "paths": PATHS, "step": 0.1, "steps": 4}
    found = ss.moments(KUBO, **options, observers={"x": observer})
    return [repr(observer), hash(observer), moments_seen(found)]


def law_seen(law):
    """Numbers of a law, and states that it draws."""
    return [seen(law.told()), seen(law.draw(KUBO, PATHS)), seen(ss.simulate(KUBO, q0=law, p0=law, step=0.1, steps=2).q)]


LOOKS = {
    ss.Model: model_seen,
    ss.states.States: law_seen,
    ss.Run: run_seen,
    ss.Moments: moments_seen,
    ss.Sweep: sweep_seen,
    ss.Gradient: gradient_seen,
    ss.Tangent: tangent_seen,
    ss.Lyapunov: lyapunov_seen,
    ss.PreparedRun: prepared_seen,
    ss.LevelSampler: sampler_seen,
    Draw: draw_seen,
    ss.Scheme: scheme_seen,
    ss.observe.Observer: observer_seen,
}


@pytest.mark.parametrize(("name", "own"), list(cases()))
def test_nothing_changes_with_the_arguments(name, own):
    if name in PACKAGES:
        pytest.importorskip(PACKAGES[name])
    function = dict(public())[name]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        untouched, changed = (arguments(name, function, own) for _ in range(2))
        subject, result = called(name, changed)
        assert seen(changed) == seen(untouched), "the call changed what it was given"
        if name in CLOCKED:
            before = pickle.dumps(result)
            change(changed)
            assert pickle.dumps(result) == before
            return
        for value in changed.values():
            change(value)
        expected = called(name, untouched)
        if name == "LevelSampler.__call__":  # sums, not seconds
            result, expected = result[0], (expected[0], expected[1][0])
        assert [seen(subject), seen(result)] == [seen(x) for x in expected]


@pytest.mark.parametrize("name", ["simulate", "moments", "ensemble", "convergence"])
def test_nothing_changes_while_it_runs(name):
    todo = []

    def changing(t, w, q, p):
        while todo:
            change(todo.pop())
        return gradient(t, w, q, p)

    model = ss.Model(ndof=1, nnoise=1, gradient=changing, separable=True, quadratic=True)
    own = {**OWN[name][0], "model": model}
    function = getattr(ss, name)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        untouched, changed = (arguments(name, function, own) for _ in range(2))
        expected = function(**untouched)
        todo += [x for key, x in changed.items() if np.shape(x) or isinstance(x, dict)]
        assert seen(function(**changed)) == seen(expected)
    assert not todo
