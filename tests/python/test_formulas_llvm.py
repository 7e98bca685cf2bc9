# SPDX-License-Identifier: BSD-3-Clause
"""LLVM in the compiler's place: the same bits as by the C compiler, whatever is generated; vectors; sentences."""

import re
from pathlib import Path

import numpy as np
import pytest
import symsde as ss
from symsde import errors
from symsde.batch import scene

pytest.importorskip("sympy")
pytest.importorskip("llvmlite", reason="llvmlite is not installed: pip install llvmlite")

from symsde.model.formulas import compiler, formula_observables
from symsde.model.formulas.llvm import engine, llvm_text

if compiler.command() is None:
    pytest.skip("no C compiler to compare with", allow_module_level=True)

GALLERY = sorted((Path(__file__).parents[2] / "examples" / "gallery").glob("*.toml"))
FUNCTIONS = "(1 + p**2)**a + cosh(q) + asinh(p)*erf(q) + acosh(2+q**2)*atan(q) + log(2+sin(q))*exp(-q**2) + atanh(q/9)"
MODELS = {
    "functions": {"H": FUNCTIONS, "noise": ["a*sin(q)*acos(q/9)", "asin(q/9)*tanh(p)"], "params": {"a": 0.7}},
    "three": {"H": "(p1**2+p2**2+p3**2)/2 + exp(q1-q2) + exp(q2-q3) + exp(q3-q1)", "noise": ["q1*q2/9"]},
    "mixed": {"H": "p**2/2 + q*p + q**2*sqrt(1+p**2)", "noise": ["q*p/9"]},
    "chain": {"H": "Sum(p[i]**2/2, i) + Sum(cosh(q[i+1]-q[i]), i)", "noise": ["-q[k]/9"], "n": 19, "ends": "fixed"},
    "rotators": {"H": "Sum(p[i]**2/2, i) - Sum(cos(q[i]), i)**2/9 + Sum(q[i]*p[i+1], i)/9", "n": 9, "ends": "periodic"},
}
RUN = {"q0": 0.4, "p0": 0.3, "step": 0.02, "steps": 12, "seed": 3, "save_every": 4}


@pytest.fixture
def no_compiler(monkeypatch):
    """As on a machine without one; what was read before is read again."""

    def leave_out():
        monkeypatch.setattr(compiler, "command", lambda: None)
        formula_observables._read.cache_clear()

    yield leave_out
    formula_observables._read.cache_clear()


@pytest.mark.parametrize("paths", [1, 45])
@pytest.mark.parametrize("name", MODELS)
def test_the_same_bits_as_by_the_c_compiler(name, paths, no_compiler):
    """Through whole steps, rows, products, dense Hessians; of far lanes, too."""
    known = ss.model_from_sympy(**MODELS[name])
    no_compiler()
    mine = ss.model_from_sympy(**MODELS[name])
    assert (known.formula.backend, mine.formula.backend) == ("C", "LLVM")
    assert mine.formula.source == known.formula.source and mine.traits == known.traits
    for scheme in ("midpoint", "stormer_verlet", "gauss2", "chin4a"):
        if scheme in ("stormer_verlet", "chin4a") and not known.traits.separable:
            continue
        if scheme == "chin4a" and not (known.traits.identity_mass and known.traits.additive):
            continue
        for general in (False, True):
            run, plain = (
                ss.simulate(x, scheme=scheme, **RUN, paths=paths, general=general and scheme != "chin4a")
                for x in (mine, known)
            )
            assert run.report.stepper == plain.report.stepper
            np.testing.assert_array_equal(run.q, plain.q)
            np.testing.assert_array_equal(run.p, plain.p)
    rng = np.random.default_rng(2)
    q, p = rng.normal(size=(2, known.ndof, 37))
    q[0, :3] = 800, np.nan, np.inf
    w = rng.normal(size=(known.nnoise + 1, 37))
    for call in ("value", "gradient", "hessian"):
        for a, b in zip(np.atleast_1d(getattr(mine, call)(q, p, w)), getattr(known, call)(q, p, w), strict=False):
            np.testing.assert_array_equal(a, b)
    assert np.isfinite(known.value(q, p, w)[3:]).all()


@pytest.mark.parametrize("file", GALLERY, ids=lambda x: x.stem)
def test_scenes_of_the_gallery(file, no_compiler):
    known = scene.load(file)
    no_compiler()
    mine = scene.load(file)
    assert mine.model.formula.backend == "LLVM"
    few = {"paths": 3, "steps": 10, "save_every": 5}
    run, plain = (ss.simulate(x.model, **{**x.run, **few}) for x in (mine, known))
    np.testing.assert_array_equal(run.q, plain.q)
    np.testing.assert_array_equal(run.p, plain.p)


def test_observables_with_sums_and_parameters_that_compile_nothing(no_compiler):
    given = {"H": "p**2/2 - a*cos(q)", "noise": ["sin(q)/9"], "params": {"a": 0.7}}
    wanted = {"r": "a*q**2 + log(2 + p)", "s": "Sum(cos(q[i])*p[i], i)**2"}
    known = ss.moments(ss.model_from_sympy(**given), observables=wanted, **RUN, paths=300)
    no_compiler()
    first = ss.model_from_sympy(**given)
    mine = ss.moments(first, observables=wanted, **RUN, paths=300)
    for name in wanted:
        np.testing.assert_array_equal(mine.mean[name], known.mean[name])
    other = first.with_parameters(a=0.8)
    assert other.formula.seconds_compilation == 0 and other.formula.file == "" and not other.in_python
    assert ss.moments(other, **RUN, paths=300).mean_q[-1] != mine.mean_q[-1]


def test_loops_over_lanes_become_vectors():
    """Divisions and square roots of the functions that are inlined, which no other loop holds."""
    model = ss.model_from_sympy(**MODELS["functions"])
    made = str(engine.optimised(model.formula.source, engine.this_machine()))
    assert len(re.findall(r"fdiv <\d+ x double>", made)) > 100
    assert re.search(r"@llvm.sqrt.v\d+f64", made)


def test_what_is_not_read_gets_a_sentence():
    for source in ("int f(int n) { goto end; }", "int f(int n) { return m; }", "union x { int a; };"):
        with pytest.raises(errors.InvalidArgumentError, match=r"generated code holds '.*', which llvm does not read"):
            llvm_text.translated(source)


OPERATIONS = """
#include <stddef.h>
#include <stdint.h>
#define MORE
#define EVEN_MORE
#define SCALE 7
#define TWICE(x) ((x) + (x))
#if defined MORE && defined EVEN_MORE
enum { SIZE = 3, NEXT, LAST = 2 * NEXT };
#else
enum { SIZE = 1 };
#endif
typedef struct { double a[SIZE], b; int64_t c; } both;
static const double table[2][2] = {{1.5, -2}, {0x1p-3, 4e2}};
static both changed(both x, double *more) {
   x.a[1] -= 1;
   *more += x.b;
   return x;
}
int formula_numbers(int n, double x, double *y) {
   both s;
   for (int k = 0; k < SIZE; k++)
      s.a[k] = k;
   s.b = x, s.c = -8;
   const both t = changed(s, y);
   enum { few = 2, SIZE_HERE = few + SIZE };
   const double zero[SIZE_HERE] = {0.5}, *none = n > 9 ? y : NULL;
#if SCALE
   y[0] += zero[0] + zero[SIZE_HERE - 1] + (none == NULL ? few : 0);
#endif
   y[1] = t.a[1] + s.a[1] + t.c + LAST;
   y[2] = table[1][0] * TWICE(table[0][1] + n);
   y[3] = (double)(s.c >> 1) + (double)((uint64_t)s.c >> 60) + (s.c / 3) + (s.c % 3) + (n ^ 5) + (~n & 6) + !n;
   y[4] = n > 2 && x < 0 ? 1 : n == 4 || x > 9 ? 2 : 3;
   int left = n;
   for (; left > 0; left--) {
      if (left == 3)
         continue;
      y[5] += left;
      if (left == 2)
         break;
   }
   y[6] = (unsigned)n * sizeof(both) + sizeof x;
   double *const z = y + 7, *end = &z[2];
   end[-1] = -x / 4, *z = x != x ? 7 : +x;
   return n < 0 ? -1 : s.c == -8;
}
"""


@pytest.mark.parametrize("n", [3, 4])
@pytest.mark.parametrize("x", [-2.5, 9.5, np.nan])
def test_operations_are_those_of_c(n, x):
    """Also those whose order, sign or width hardly a formula shows."""
    import ctypes

    found = []
    for made in (
        compiler.build(OPERATIONS).library,
        engine.Library(OPERATIONS),
    ):
        y = np.zeros(9)
        function = ctypes.cast(
            made.formula_numbers, ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_int, ctypes.c_double, ctypes.c_void_p)
        )
        found.append((function(n, x, y.ctypes.data), y))
    assert found[0][0] == found[1][0]
    np.testing.assert_array_equal(found[0][1], found[1][1])
