# SPDX-License-Identifier: BSD-3-Clause
"""Results of functions other than runs: numbers, text, files. Clocks count steps."""

import contextlib
import inspect
import io
import itertools
import os
import tempfile
import warnings
from pathlib import Path

import axes
import pytest
import symsde as ss
from clock import WorkClock
from recorded import code, facts
from recorded_runs import MADE, SCHEMES, scheme_of, square
from symsde.answers.expectation import choice
from symsde.run import options as run_options
from test_axes_models import MODELS, compiled


class StepClock(WorkClock):
    """A clock that no rounding changes: a microsecond for each step of a path."""

    def _counting(self, fill):
        def counted(result, *given, **more):
            fill(result, *given, **more)
            self.now += 1e-4 + 1e-6 * result.report.counters["path_steps"] * result.setup.model.ndof

        return counted


@contextlib.contextmanager
def set_apart():
    """A context that works in a folder of its own, with a clock that counts steps; it gives the printed text."""
    before, printed = Path.cwd(), io.StringIO()
    with tempfile.TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patch:
        clock = StepClock(patch)
        patch.setattr("time.perf_counter", lambda: clock.now)
        os.chdir(folder)
        try:
            with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(printed):
                yield printed
        finally:
            os.chdir(before)


def tried(call, *given, **more):
    """The result of a call, or the message of its exception."""
    try:
        return call(*given, **more)
    except (ValueError, ArithmeticError) as error:
        return f"{type(error).__name__}: {error}"


def said_of(call, *given, **more):
    """The message of the exception that a call raises, or a note that it raised none."""
    found = tried(call, *given, **more)
    return found if isinstance(found, str) else "fine"


def asked(call, *given, **more):
    """The numbers, text and warnings of an answer, or the message of a refusal."""
    with set_apart() as printed, warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        found = tried(call, *given, **more)
        kept = [w for w in warned if not issubclass(w.category, ss.errors.DoubtfulRunWarning)]
        told = (str(found), repr(found), printed.getvalue(), *(str(w.message) for w in kept))
    return [*facts(found, rtol=1e-7), code(*told)]


def own_of(kind, ndof, nnoise, time=""):
    """A model whose functions are Python functions."""
    return axes.model_of(axes.ridges_of(kind, ndof, nnoise, time), kind)


def schemes():
    """All information about every scheme."""
    for name in (*SCHEMES, "jump"):
        scheme = ss.schemes.triple_jump("gauss2", "mine") if name == "jump" else scheme_of(name)
        known = scheme.tableau()
        texts = (scheme.certificate(), repr(scheme), scheme._repr_html_())
        yield name, [*facts(scheme.info, known and vars(known)), code(*texts)]


def models():
    """Values, algebra and descriptions of every model, at some points."""
    more = {"formula": compiled("coupled")[0], "own": own_of("any", 2, 3, "both")}
    for name, model in {**{name: x[1] for name, x in MODELS.items()}, **more}.items():
        q, p = axes.start(model.ndof, 3)
        traits = {x: getattr(model.traits, x) for x in dir(model.traits) if x[0] != "_"}
        yield name, [*facts(model.value(q, p, t=0.3), traits), code(repr(model), model._repr_html_())]
        found = [tried(ss.commutator, model, q[:, 0], p[:, 0], 0.2), str(ss.commutator(model))]
        found += [tried(ss.mean_square, model, s, step=0.1, t=0.3) for s in ("gauss2", "heun", "symplectic_euler")]
        yield f"{name}: algebra", facts(found, rtol=1e-7)


def steps():
    """One step from many points, increments, and diagnostics of short runs."""
    sizes = itertools.cycle([(1, 1, -0.1), (2, 3, 0.07), (3, 2, -0.07), (1, 4, 0.1), (2, 1, -0.05), (8, 2, 0.1)])
    catalogue = [name for name in ss.schemes.names() if name not in MADE]
    for i, (name, kind) in enumerate(itertools.product(catalogue, ("kick", "position"))):
        n, m, h = next(sizes)
        model, (q, p), dw = own_of(kind, n, m, axes.AXES["time"][i % 4]), axes.start(n, 3), axes.rows_of(h, 1, 1, m, 3)
        drawn = {"step": h, "steps": 3, "paths": 5, "seed": i, "first_step": i % 5, "refine": i % 3, "scheme": name}
        found = [
            tried(ss.step, model, name, q, p, h, dw[0], t=0.3),
            tried(ss.increments, model, **drawn),
            tried(ss.diagnose.symplecticity, model, name, q=q, p=p, step=h, t=0.2, seed=i),
        ]
        yield (
            f"{name} {kind}",
            facts(*found[:2]) + facts(found[2] if isinstance(found[2], str) else found[2] + 0.1, rtol=1e-7),
        )
    stationary = ("midpoint", "gauss2", "lobatto3", "P1N2Q2Lob", "P2N3Q6Gau", "stormer_verlet", "symplectic_euler")
    for name, (kind, n, m, h) in itertools.product(
        stationary, (("kick", 2, 3, 0.1), ("position", 3, 2, -0.1), ("both", 1, 1, 0.2))
    ):
        model, (q, p) = own_of(kind, n, m, "both"), axes.start(n, 4)
        given = {"step": h, "steps": 4, "paths": 4, "seed": 3}
        run = ss.simulate(model, q0=q, p0=p, scheme=name, t0=0.2, first_step=2, refine=1, **given)
        run.q[2:4] *= 1.01
        examined = (ss.diagnose.action, ss.diagnose.euler_lagrange_residual, ss.diagnose.driving_increments)
        found = [tried(f, run) for f in examined]
        found.append(tried(ss.diagnose.stationary_path, model, name, q_start=q, q_end=run.q[-1], **given))
        yield f"{name} {kind} {h}", facts(*found, rtol=1e-6)
    known = {x: MODELS[x][1] for x in ("kubo", "linear_oscillator", "additive_oscillator")}
    ways = (("midpoint", {}), ("gauss2_strong32", {"refine": 1}), ("heun", {"common_noise": 1, "save_every": 2}))
    for name, (scheme, how) in itertools.product(known, ways):
        q, p = axes.start(1, 5)
        given = {"step": -0.1, "steps": 4, "paths": 5, "scheme": scheme, "first_step": 3, "first_path": 9, "t0": 0.4}
        run = ss.simulate(known[name], q0=q, p0=p, **given, **how)
        yield f"exact {name} {scheme}", facts(ss.diagnose.exact(run))


PLACE = {"q0": 0.7, "p0": 0.2, "horizon": 1.0, "seed": 4, "t0": 0.3}


def seldom(q, p):
    """An event that few paths reach."""
    return (q[0] > 1.9) * 1.0


def answers():
    """Expectations, advice and studies, with a clock that counts steps."""
    kubo, two, chain = ss.models.kubo(0.9, 0.4), ss.models.synchrotron(1.3, 0.5, 0.4), ss.models.fpu_chain(3, 0.8, 0.3)
    known = {"kubo": (kubo, "q**2", "stormer_verlet"), "two": (two, square, "gauss_dkdkd")}
    known["chain"] = (chain, "q1 + p1**2", None)
    for method, (name, (model, f, scheme)) in itertools.product(choice.METHODS, known.items()):
        yield f"expect {method} {name}", asked(ss.expect, model, f, scheme=scheme, method=method, abs=0.02, **PLACE)
    yield "expect any", asked(ss.expect, two, "cos(q)*p", rel=0.1, **PLACE)
    yield "expect seldom", asked(ss.expect, kubo, seldom, abs=0.01, scheme="midpoint", **PLACE)
    for swapped, scheme, model in (
        (False, "midpoint", two),
        (True, "stormer_verlet", kubo),
        (False, "gauss_dkdkd", chain),
    ):
        how = {"scheme": scheme, "antithetic": swapped, **PLACE}
        yield f"mlmc {scheme}", asked(ss.mlmc, model, square, abs=0.03, first=64, levels=5, **how)
        sampler = ss.level_sampler(model, square, steps=2, **how)
        drawn = [(vars(sampler.draw(x, 32).difference), sampler(x, 16)[0], sampler.steps(x)) for x in (0, 1, 2, 1)]
        yield f"levels {scheme}", facts(drawn)
    for want in ("paths", "moments", "invariants"):
        yield f"advise {want}", asked(ss.advise, two, want=want, tolerance=0.02, **PLACE)
    yield "advise kubo", asked(ss.advise, kubo, tolerance=0.01, **PLACE)
    for scheme, model in (("midpoint", two), ("heun", kubo), ("gauss2_strong32", chain), ("symplectic_euler", kubo)):
        yield f"convergence {scheme}", asked(ss.convergence, model, scheme, steps=(4, 8, 16), paths=60, **PLACE)
    study = {"steps": (4, 8, 16), "paths": 60, "repeats": 5, "name": "mine", **PLACE}
    yield "work_precision explicit", asked(ss.work_precision, two, ["chin4a", "heun", "stormer_verlet"], **study)
    yield "work_precision", asked(ss.work_precision, two, invariants={"a": seldom, "b": square}, **study)


BAD = (-1, 0, 2.5, float("nan"), "x", (1, 2), None, [[1.0, 2.0], [3.0]])
KINDS = {
    "Histogram": ("q_1", -1, 1, 5), "Quantiles": ("q_1", (0.5,), 1e-3, 10, 16), "Covariance": (("q_1", "p_2"),),
    "Autocorrelation": ("q_1", 1, 0.0), "Extremes": ("p_1",), "Passage": ("q_1", -1, 1),
}  # fmt: skip
MAKERS = {
    "get": ("midpoint",), "adjoint": ("gauss2",), "triple_jump": ("lobatto3",),
    "from_quadrature": ([0.0, 1.0], [0.5, 0.5], 1), "from_tableau": ([[0.5]], [[0.5]], [1.0]),
    "composition": (["heun", "midpoint"], [0.5, 0.5]),
}  # fmt: skip
ASKED = (
    "horizon",
    "abs",
    "rel",
    "tolerance",
    "steps",
    "paths",
    "levels",
    "scheme",
    "method",
    "want",
    "q0",
    "reference",
)
TEXTS = ("q**", "q1 +* p1", "foo(q1)", "q9", "Sum(q[i])", "q[9]", "", "p1**2/2 + x", "sin(q1", "import os", "t**0.5")


def replaced(given, values):
    """Copies of the arguments, each with one argument replaced."""
    return [[*given[:i], x, *given[i + 1 :]] for i in range(len(given)) for x in values]


def swept():
    """Functions with valid arguments; callers replace each argument in turn."""
    model, scheme = ss.models.henon_heiles(), "midpoint"
    place = {"q0": 0.1, "p0": 0.2, "step": 0.1}
    run = ss.simulate(model, **place, steps=4)
    made = ss.prepare(model, **place)
    at = {"q": 0.1, "p": 0.2, "t": 0.3}
    gradient = lambda t, w, q, p: (q, p)  # noqa: E731
    return {
        "step": (ss.step, {"model": model, "scheme": scheme, "step": 0.1, "dw": 0.1, **at}),
        "increments": (ss.increments, {"model": model, "step": 0.1, "steps": 4}),
        "symplecticity": (ss.diagnose.symplecticity, {"model": model, "scheme": scheme, "step": 0.1, "dw": 0.1, **at}),
        "stationary_path": (
            ss.diagnose.stationary_path,
            {"model": model, "scheme": scheme, "q_start": 0.1, "q_end": 0.3, "step": 0.1, "steps": 2},
        ),
        **{x: (getattr(ss.diagnose, x), {"run": run}) for x in ("action", "exact", "driving_increments")},
        "mean_square": (ss.mean_square, {"model": ss.models.kubo(), "scheme": scheme, "step": 0.1, "t": 0.0}),
        "commutator": (ss.commutator, {"model": model, **at}),
        "value": (model.value, {**at, "w": (1.0, 0.2, 0.3)}),
        "gradient": (model.gradient, {**at, "w": (1.0, 0.2, 0.3)}),
        "reset": (made.reset, {"q0": 0.1, "p0": 0.2, "seed": 3, "first_path": 2, "first_step": 1}),
        "step of a prepared run": (made.step, {"dw": (0.1, 0.2)}),
        "run of a prepared run": (made.run, {"steps": 4, "save_every": 2}),
        "level_sampler": (ss.level_sampler, {"model": ss.models.kubo(), "f": "q", "scheme": scheme, **PLACE}),
        "work_precision": (
            ss.work_precision,
            {"model": ss.models.kubo(), "schemes": [scheme], "steps": (2, 4), "paths": 40, **PLACE},
        ),
        "model_from_sympy": (ss.model_from_sympy, {"H": "p**2/2 + k*q**2", "noise": ["q"], "params": {"k": 1.0}}),
        "Model": (ss.Model, {"ndof": 1, "nnoise": 1, "gradient": gradient}),
        "Paths": (ss.observe.Paths, {"paths": (0, 1), "of": ("q_1",)}),
        "symmetric_composition": (ss.schemes.symmetric_composition, {"scheme": "P2N2Q2Otr", "name": "mine"}),
        "status_text": (ss.status_text, {"code": 1}),
    }


def refusals():
    """Messages for bad input, with their numbers."""
    model, place = ss.models.henon_heiles(), {"q0": 0.1, "p0": 0.2, "step": 0.1, "steps": 4}
    calls = {"simulate": ss.simulate, "moments": ss.moments, "prepare": ss.prepare}
    for name, of in itertools.product(("q0", *run_options.OPTIONS, "q0_low", "increments", "scheme", "unknown"), calls):
        given = place if of != "prepare" else {x: place[x] for x in ("q0", "p0", "step")}
        yield f"{of} {name}", [code([said_of(calls[of], model, **given | {name: x}) for x in (*BAD, 10**30)])]
    for name, given in KINDS.items():
        wrong = [tried(getattr(ss.observe, name), *x) for x in replaced(given, (1e30, *BAD))]
        found = [x if isinstance(x, str) else said_of(ss.moments, model, **place, observers={"a": x}) for x in wrong]
        yield name, [code(found)]
    for name, given in MAKERS.items():
        wrong = replaced(given, (*BAD, "gauss9", [0.3, 0.3], [[0.1]], [1.0]))
        yield name, [code([repr(tried(getattr(ss.schemes, name), *x)) for x in wrong])]
    for name in ss.models.names():
        wrong = [{k: x} for k in (*ss.models.parameters(name), "none") for x in BAD]
        yield name, [code([repr(tried(ss.models.get, name, **x)) for x in wrong])]
    asking = {"expect": ss.expect, "mlmc": ss.mlmc, "convergence": ss.convergence, "advise": ss.advise}
    for of, name in itertools.product(asking, ASKED):
        first = (ss.models.kubo(), "q**2") if of in {"expect", "mlmc"} else (ss.models.kubo(),)
        given = PLACE | ({"tolerance": 0.1} if of == "advise" else {})
        found = [said_of(asking[of], *first, **given | {name: x}) for x in BAD if repr(x) not in {"0", "2.5"}]
        yield f"{of} {name}", [code(found)]
    for of, (call, given) in swept().items():
        known = inspect.signature(call).parameters.values()
        for name in (x.name for x in known if x.kind is not x.VAR_KEYWORD):
            with set_apart():  # "x" may be a folder
                said = [said_of(call, **given | {name: x}) for x in BAD]
            yield f"{of} {name}", [code(said)]
    for text in TEXTS:
        formula = said_of(ss.model_from_sympy, text, ["0.1*q1"])
        yield f"formula {text}", [code(formula, said_of(ss.moments, model, **place, observables={"a": text}))]


GROUPS = (schemes, models, steps, answers, refusals)
