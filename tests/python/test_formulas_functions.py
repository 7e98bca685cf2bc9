# SPDX-License-Identifier: BSD-3-Clause
"""Elementary functions of generated code: ulps against mpmath, bits for every width of vectors, far arguments."""

import ctypes
import platform
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("sympy")
mpmath = pytest.importorskip("mpmath")

from symsde.formulas import compiler  # noqa: E402

HEADER = Path(compiler.__file__).with_name("lane_functions.h").read_text(encoding="utf-8")
CALLS = {
    "sin": "double s, k; lane_sincos(x[i], &s, &k, FAR, &beyond); y[i] = s;",
    "cos": "double s, k; lane_sincos(x[i], &s, &k, FAR, &beyond); y[i] = k;",
    **{name: f"y[i] = lane_{name}(x[i], FAR, &beyond);" for name in ("exp", "log", "tanh", "sinh", "cosh", "atan")},
}
BOUNDS = {"sin": 1.0, "cos": 1.0, "exp": 1.0, "log": 1.0, "tanh": 2.0, "sinh": 2.0, "cosh": 2.0, "atan": 1.0}  # ulps
WIDTHS = {"sse2": ["-march=x86-64"], "avx2": ["-march=haswell"], "avx512": ["-march=skylake-avx512"]}
CONTRACTS = "-DCONTRACTS"  # products and sums as one operation, as a library that is built for one machine has them

if compiler.command() is None:
    pytest.skip("no C compiler", allow_module_level=True)


def function(name, flags=(), contracts=CONTRACTS in compiler.FLAGS):
    """One of the functions on whole arrays: values, and whether some argument was far."""
    loop = "for (int i = 0; i < n; i++) { " + CALLS[name] + " }"
    text = HEADER + (
        "int64_t f(int n, const double *restrict x, double *restrict y) {\n   int64_t beyond = 0;\n"
        + "   " + loop.replace("FAR", "0") + "\n   if (beyond < 0)\n      " + loop.replace("FAR", "1")
        + "\n   return beyond;\n}\n"
    )  # fmt: skip
    with pytest.MonkeyPatch.context() as patch:
        usual = [x for x in compiler.FLAGS if x != CONTRACTS]
        patch.setattr(compiler, "FLAGS", (*usual, *flags, *([CONTRACTS] if contracts else [])))
        library = compiler.build(text).library
    library.f.restype = ctypes.c_int64

    def call(x):
        x = np.ascontiguousarray(x, dtype=float)
        y = np.empty_like(x)
        far = library.f(ctypes.c_int(len(x)), ctypes.c_void_p(x.ctypes.data), ctypes.c_void_p(y.ctypes.data))
        return y, far < 0

    return call


def arguments(name):
    """Ordinary arguments: spread over the range, and where the formulas change."""
    rng = np.random.default_rng(5)
    if name == "log":
        return np.concatenate(
            [np.exp(rng.uniform(-700, 700, 1500)), rng.uniform(0.5, 2, 1500), 1 + rng.normal(0, 1e-6, 200)]
        )
    reach = {"sin": 1e5, "cos": 1e5, "exp": 708.0, "tanh": 25.0, "sinh": 708.0, "cosh": 708.0, "atan": 40.0}[name]
    near = np.concatenate(
        [
            rng.uniform(-2, 2, 1500),
            0.625 + rng.normal(0, 1e-8, 100),
            rng.choice([1, 0.66, 2.4142], 300) + rng.normal(0, 1e-4, 300),
            rng.normal(0, 1e-5, 100),
        ]
    )
    turns = np.arange(-200, 200) * np.pi / 4 if reach > 150 else np.arange(-100, 100) * np.log(2) / 8
    return np.concatenate([rng.uniform(-reach, reach, 1500), near, turns, [reach, -reach]])


def ulps(name, x, y):
    """Largest error in units of the last place of the exact result."""
    worst = 0.0
    with mpmath.workprec(200):
        for a, b in zip(x.tolist(), y.tolist(), strict=True):
            exact = getattr(mpmath, name)(mpmath.mpf(a))
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
    assert ulps(name, x, y * (1 + 6e-16)) > bound  # the measure sees three units


@pytest.mark.skipif(platform.machine() != "x86_64", reason="widths of x86-64")
@pytest.mark.parametrize("contracts", [True, False])
@pytest.mark.parametrize("name", CALLS)
def test_bits_do_not_depend_on_the_width_of_vectors(name, contracts):
    """Nor, without contraction, on what the processor can."""
    x = arguments(name)
    known = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    if contracts and " fma " not in known:
        pytest.skip("this processor has no operation for a product and a sum")
    expected, _ = function(name, contracts=contracts)(x)
    for width, flags in WIDTHS.items():
        if (width in ("sse2", "avx2") or "avx512dq" in known) and not (contracts and width == "sse2"):
            y, _ = function(name, flags, contracts=contracts)(x)
            assert (y == expected).all(), width
    backwards, _ = function(name, contracts=contracts)(x[::-1][:-3])  # other lanes beside it
    assert (backwards[::-1] == expected[3:]).all()


@pytest.mark.parametrize("name", CALLS)
def test_far_arguments_are_those_of_the_c_library(name):
    x = np.array(
        [0.5, 1e5, 1.1e5, -3e7, 1e300, np.inf, -np.inf, np.nan, 5e-324, 1e-310, -1.0, 0.0, 700.0, 720.0, -760.0]
    )
    y, far = function(name)(x)
    assert far
    with np.errstate(all="ignore"):
        expected = getattr(np, {"atan": "arctan"}.get(name, name))(x)
    assert (np.isnan(y) == np.isnan(expected)).all()
    fine = np.isfinite(expected) & (expected != 0)
    np.testing.assert_allclose(y[fine], expected[fine], rtol=4e-16, atol=1e-323)
    assert (y[np.isinf(expected)] == expected[np.isinf(expected)]).all()
    near, _ = function(name)(x[:1])
    assert y[0] == near[0]  # neighbours that are far change nothing
