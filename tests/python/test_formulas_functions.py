# SPDX-License-Identifier: BSD-3-Clause
"""Elementary functions of generated code: ulps against mpmath, bits for every vector width, far arguments."""

import ctypes
import platform
import subprocess
from pathlib import Path

import numpy as np
import pytest
import symsde as ss

pytest.importorskip("sympy")
mpmath = pytest.importorskip("mpmath")

from symsde.model.formulas import compiler, in_numpy  # noqa: E402
from symsde.model.formulas.graph import FUNCTIONS, INNER  # noqa: E402

pytestmark = pytest.mark.optimised

HEADER = Path(compiler.__file__).with_name("lane_functions.h").read_text(encoding="utf-8")
CALLS = {
    "sin": "double s, k; lane_sincos(x[i], &s, &k, FAR, &beyond); y[i] = s;",
    "cos": "double s, k; lane_sincos(x[i], &s, &k, FAR, &beyond); y[i] = k;",
    "pow": "y[i] = lane_pow(x[i], z[i], FAR, &beyond);",
    **{
        x: f"y[i] = lane_{x}(x[i], FAR, &beyond);"
        for x in (*FUNCTIONS, *INNER)
        if x not in ("sin", "cos", "tan", "sqrt")
    },
}
BOUNDS = dict.fromkeys(CALLS, 2.0) | dict.fromkeys(
    ("sin", "cos", "exp", "log", "atan", "pow", "gauss", "log1p"), 1.0
)  # bounds in ulps
BOUNDS |= {"asin": 1.5, "acos": 1.5, "csch": 2.5, "coth": 2.5, "erfc": 3.0, "logcosh": 3.0}
WIDTHS = {"sse2": ["-march=x86-64"], "avx2": ["-march=haswell"], "avx512": ["-march=skylake-avx512"]}
CONTRACTS = "-DCONTRACTS"  # fused products and sums, as in a library built for one machine

if compiler.command() is None:
    pytest.skip("no C compiler", allow_module_level=True)


def program(name):
    """C text that applies one function to whole arrays, like a generated loop."""
    loop = "for (int i = 0; i < n; i++) { " + CALLS[name] + " }"
    return HEADER + (
        "int64_t f(int n, const double *restrict x, const double *restrict z, double *restrict y) {\n"
        "   int64_t beyond = 0;\n"
        + "   " + loop.replace("FAR", "0") + "\n   if (beyond < 0)\n      " + loop.replace("FAR", "1")
        + "\n   return beyond;\n}\n"
    )  # fmt: skip


def function(name, flags=(), contracts=CONTRACTS in compiler.FLAGS):
    """A function applied to whole arrays: values, and whether some argument was far."""
    with pytest.MonkeyPatch.context() as patch:
        usual = [x for x in compiler.FLAGS if x != CONTRACTS]
        patch.setattr(compiler, "FLAGS", (*usual, *flags, *([CONTRACTS] if contracts else [])))
        library = compiler.build(program(name)).library
    library.f.restype = ctypes.c_int64

    def call(x):
        """x: (1 or 2, lane); for pow the second row holds exponents."""
        x = np.ascontiguousarray(x, dtype=float)
        y = np.empty_like(x[0])
        far = library.f(ctypes.c_int(len(y)), *(ctypes.c_void_p(z.ctypes.data) for z in (x[0], x[-1], y)))
        return y, far < 0

    return call


def arguments(name):
    """Ordinary arguments, (1 or 2, lane), spread over the range and near places where formulas change."""
    rng = np.random.default_rng(5)
    small = 10 ** rng.uniform(-300, 0, 300)
    if name == "pow":
        base = [np.exp(rng.uniform(-700, 700, 1500)), rng.uniform(0.5, 2, 1500), 1 + rng.normal(0, 1e-6, 200)]
        exponent = np.concatenate([rng.uniform(-1, 1, 1500), rng.uniform(-1000, 1000, 1500), rng.normal(0, 1e8, 200)])
        return np.array([np.concatenate(base), exponent])
    if name == "log":
        return np.concatenate(
            [np.exp(rng.uniform(-700, 700, 1500)), rng.uniform(0.5, 2, 1500), 1 + rng.normal(0, 1e-6, 200)]
        )[None]
    if name == "acosh":
        return 1 + np.concatenate([[0], rng.uniform(0, 2, 1500), 10 ** rng.uniform(-15.9, 140, 500)])[None]
    if name in ("asin", "acos", "atanh"):
        sizes = [rng.uniform(0, 1, 1500), rng.uniform(0.48, 0.56, 500), small, 1 - 10 ** rng.uniform(-15.9, -1, 300)]
        return np.concatenate([*sizes, -sizes[0], [0.0, 0.5, 1.0 - 2.0**-53]])[None]
    if name in ("asinh", "log1p"):
        low, far = (-3, 1 / small[small > 1e-150]) if name == "asinh" else (-1 + 1e-15, 1 / small)
        return np.concatenate([rng.uniform(low, 3, 1500), small, -small[small < -low], far, [0.0]])[None]
    reach = {"sin": 1e5, "cos": 1e5, "tanh": 25.0, "coth": 25.0, "atan": 40.0, "erf": 7.0, "erfc": 26.0, "gauss": 26.6}
    reach = reach.get(name, 708.0)
    near = np.concatenate(
        [
            rng.uniform(-2, 2, 1500),
            0.625 + rng.normal(0, 1e-8, 100),
            rng.choice([1, 0.66, 2.4142], 300) + rng.normal(0, 1e-4, 300),
            rng.normal(0, 1e-5, 100),
        ]
    )
    turns = np.arange(-200, 200) * np.pi / 4 if reach > 150 else np.arange(-100, 100) * np.log(2) / 8
    found = np.concatenate([rng.uniform(-reach, reach, 1500), near, turns, [reach, -reach]])[None]
    return found[:, found[0] != 0] if name in ("coth", "csch") else found


def ulps(name, x, y):
    """Largest error in units of the last place of the exact result."""
    worst = 0.0
    own = {"gauss": lambda z: mpmath.exp(-z * z), "logcosh": lambda z: mpmath.log(mpmath.cosh(z)), "pow": mpmath.power}
    exact_one = own.get(name) or getattr(mpmath, name)
    with mpmath.workprec(2200 if name == "logcosh" else 200):
        for a, b in zip(x.T.tolist(), y.tolist(), strict=True):
            exact = exact_one(*(mpmath.mpf(z) for z in a))
            unit = np.spacing(abs(float(exact)))
            worst = max(worst, float(abs(mpmath.mpf(b) - exact) / mpmath.mpf(float(unit))))
    return worst


@pytest.mark.parametrize("contracts", [True, False])
@pytest.mark.parametrize(("name", "bound"), BOUNDS.items())
def test_ulps(name, bound, contracts):
    x = arguments(name)
    y, far = function(name, contracts=contracts)(x)
    assert not far
    assert ulps(name, x, y) < bound
    assert ulps(name, x, y * (1 + 1e-15)) > bound  # the twin: an error of five units is found


@pytest.mark.parametrize("name", CALLS)
def test_loops_become_vectors(name, tmp_path):
    """gcc reports the loop over ordinary arguments as vectorised, and not the loop over far ones."""
    version = subprocess.run([*compiler.command(), "--version"], capture_output=True, text=True, check=True).stdout
    if platform.machine() != "x86_64" or "Free Software Foundation" not in version:
        pytest.skip("the report is of gcc on x86-64")
    (tmp_path / "f.c").write_text(program(name))
    words = [*compiler.command(), *compiler.FLAGS, "-fopt-info-vec", "-S", "f.c"]
    told = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=True).stderr
    assert len({line.split(":")[1] for line in told.splitlines() if "loop vectorized" in line}) == 1


@pytest.mark.skipif(platform.machine() != "x86_64", reason="widths of x86-64")
@pytest.mark.parametrize("contracts", [True, False])
@pytest.mark.parametrize("name", CALLS)
def test_bits_do_not_depend_on_the_width_of_vectors(name, contracts):
    """Bits do not depend on the width of vectors; without contraction they do not depend on the processor's
    instructions, either.
    """
    x = arguments(name)
    known = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    if contracts and " fma " not in known:
        pytest.skip("this processor has no operation for a product and a sum")
    expected, _ = function(name, contracts=contracts)(x)
    for width, flags in WIDTHS.items():
        if (width in ("sse2", "avx2") or "avx512dq" in known) and not (contracts and width == "sse2"):
            y, _ = function(name, flags, contracts=contracts)(x)
            assert (y == expected).all(), width
    backwards, _ = function(name, contracts=contracts)(x[:, ::-1][:, :-3])  # reversed lanes have other neighbours
    assert (backwards[::-1] == expected[3:]).all()


FAR = [0.5, 1e5, 1.1e5, -3e7, 1e300, np.inf, -np.inf, np.nan, 5e-324, 1e-310, -1.0, 0.0, 700.0, 720.0, -760.0]
FAR += [1.0, 1.5, -1.5, 1e-300, -0.0, 1e200, -(1 - 2.0**-53), -2.5, 2.0]


@pytest.mark.parametrize("name", CALLS)
def test_far_arguments_are_those_of_the_c_library(name):
    """Results agree outside of the domain, too, where they are NaN; powers are tried for every pair of base and
    exponent.
    """
    x = np.array([FAR] if name != "pow" else np.meshgrid(FAR, [0.5, -0.5, 2.5, 3.0, 0.0, 1e300, np.inf, np.nan]))
    x = x.reshape(len(x), -1)
    y, far = function(name)(x)
    assert far
    with np.errstate(all="ignore"):
        expected = in_numpy._OPERATIONS[name](*x)
    assert (y[expected == 0] == 0).all()
    assert (
        name in ("sin", "log1p") or (np.signbit(y) == np.signbit(expected))[expected == 0].all()
    )  # for -0 lanes give 0
    assert (np.isnan(y) == np.isnan(expected)).all()
    fine = np.isfinite(expected) & (expected != 0)
    np.testing.assert_allclose(y[fine], expected[fine], rtol=4e-16, atol=1e-323)
    assert (y[np.isinf(expected)] == expected[np.isinf(expected)]).all()
    near, _ = function(name)(x[:, :1])
    np.testing.assert_array_equal(y[:1], near)  # far neighbours change no bit of a lane


@pytest.mark.usefixtures("quick_compiler")
def test_factors_below_the_line_are_divided_by_at_once():
    model = ss.model_from_sympy("p**2/2 + q/((1 + q**2)*(2 + cos(q)))", [], q="q", p="p")
    value = model.formula.source.split("of_value(IN, OUT value) {")[1].split("\n}")[0]
    assert value.count(" / ") == 1
