# SPDX-License-Identifier: BSD-3-Clause
"""A model of one's own at the speed of the built-in ones: its functions compiled by numba.

H = p^2/2 - cos q, H_1 = sigma sin q: the pendulum of own_model.py, shaken sideways. Needs numba.
"""

import sys
from time import process_time

import numpy as np
import symsde as ss

try:
    import numba
except ImportError:
    print("skipped: numba is not installed; pip install numba")
    sys.exit(77)

SIGMA = 0.3
sincos = ss.numba_sincos()  # the library's own, several times as fast as math.sin lane by lane


# Arrays are pointers: w is (1 + noise, lane), q, p, hq and hp are (dof, lane), the lane fastest. Write all outputs.
# error_model="numpy": a division by zero gives inf in that lane; otherwise numba leaves the function in the middle.
@numba.cfunc(ss.numba_signature("gradient"), error_model="numpy")
def gradient(nlane, ndof, nham, t, w, q, p, hq, hp, user):  # noqa: PLR0917 - the C signature
    """Gradient of w[0] H + w[1] H_1 for a block of paths."""
    sine, cosine = np.empty(nlane), np.empty(nlane)
    sincos(nlane, q, sine.ctypes, cosine.ctypes)
    for i in range(nlane):
        h, dw = w[i], w[nlane + i]
        hq[i] = h * sine[i] + dw * SIGMA * cosine[i]
        hp[i] = h * p[i]
    return 0


@numba.cfunc(ss.numba_signature("hessian"), error_model="numpy")
def hessian(nlane, ndof, nham, t, w, q, p, hqq, hqp, hpp, user):  # noqa: PLR0917
    """Second derivatives; without this function they are approximated by differences of gradients."""
    sine, cosine = np.empty(nlane), np.empty(nlane)
    sincos(nlane, q, sine.ctypes, cosine.ctypes)
    for i in range(nlane):
        h, dw = w[i], w[nlane + i]
        hqq[i] = h * cosine[i] - dw * SIGMA * sine[i]
        hqp[i] = 0.0
        hpp[i] = h
    return 0


def slow_gradient(t, w, q, p):
    """The same gradient as a NumPy function."""
    return w[0] * np.sin(q) + w[1] * SIGMA * np.cos(q), w[0] * p


traits = {"ndof": 1, "nnoise": 1, "separable": True, "position_noise": True, "identity_mass": True}
compiled = ss.Model(gradient=gradient, hessian=hessian, name="compiled", **traits)
plain = ss.Model(gradient=slow_gradient, name="plain", **traits)

scene = {"q0": 1.0, "p0": 0.0, "step": 0.05, "steps": 200, "paths": 20_000, "seed": 3, "save_every": 200, "threads": 1}
means = {}
for model in (compiled, plain):
    begin = process_time()
    found = ss.moments(model, **scene)
    seconds = process_time() - begin
    means[model.name] = found.mean_q[-1, 0]
    print(f"E q = {found.mean_q[-1, 0]:.6f} +- {found.se_mean_q[-1, 0]:.6f} at t = 10.0: {model.name}, {seconds:.2f} s")
assert abs(means["compiled"] - means["plain"]) < 1e-9

# A function with another signature is refused. It would compute nonsense or end the process.
wrong = numba.cfunc("float64(float64)")(lambda x: x)
try:
    ss.Model(gradient=wrong, **traits)
except ss.errors.WrongTypeError as error:
    print(f"refused: {error}")
