# SPDX-License-Identifier: BSD-3-Clause
"""Lack of memory: every call ends with a result or a sentence, and the process goes on.

Child processes try limits of their address space (`ulimit -v`), from too little for anything to enough: the library
refuses work beyond the limit, and an allocation that fails nevertheless ends the child and fails the test.
"""

import subprocess
import sys

import numpy as np
import pytest
import symsde as ss
from symsde.native import checks

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="limits of the address space are Linux's")

CHILD = """
import resource, sys, warnings
import numpy as np
import symsde as ss

MEGABYTE = 2**20
HARD = resource.getrlimit(resource.RLIMIT_AS)[1]
threads = int(sys.argv[1])
warnings.simplefilter("ignore")

def address_space():
    with open("/proc/self/statm") as file:
        return int(file.read().split()[0]) * resource.getpagesize()

def attempt(extra, function):
    resource.setrlimit(resource.RLIMIT_AS, (address_space() + extra * MEGABYTE, HARD))
    try:
        function()
        return "ok"
    except ss.errors.IncompatibleError:
        return "incompatible"
    except MemoryError as error:  # the library's OutOfMemoryError is one
        return "refused"
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (HARD, HARD))

def dense(t, w, q, p):
    return w[0] * (q + q.mean(axis=0) ** 3) + 0.1 * w[1], w[0] * p

def calls(model, scheme):
    ndof = model.ndof
    given = {"q0": 0.1, "p0": 0.1, "step": 0.01, "scheme": scheme, "threads": threads}
    yield "simulate", lambda: ss.simulate(model, steps=2, paths=16, lanes=8, **given)
    yield "moments", lambda: ss.moments(model, steps=400, paths=16, lanes=8, **given)
    if threads > 1:  # the rest has none
        return
    yield "step", lambda: ss.step(model, scheme, 0.1, 0.1, 0.01, 0.1)
    yield "increments", lambda: ss.increments(model, step=0.01, steps=10, paths=300, scheme=scheme)
    yield "symplecticity", lambda: ss.diagnose.symplecticity(model, scheme, q=0.1, p=0.1, step=0.01)
    yield "stationary", lambda: ss.diagnose.stationary_path(
        model, scheme, q_start=0.1, q_end=0.11, step=0.01, steps=3, paths=2)
    prepared = ss.prepare(model, q0=0.1, p0=0.1, step=0.01, scheme=scheme, threads=1, paths=16, lanes=8)
    yield "prepared", lambda: prepared.run(2)
    run = ss.simulate(model, steps=3, paths=9, **given)
    yield "action", lambda: ss.diagnose.action(run)
    yield "residual", lambda: ss.diagnose.euler_lagrange_residual(run)
    yield "hessian", lambda: model.hessian(np.full((ndof, 50), 0.1), 0.1)
    yield "commutator", lambda: ss.commutator(model, q=np.full((ndof, 50), 0.1), p=0.1)

models = [ss.models.kubo(), ss.models.henon_heiles(), ss.models.fpu_chain(n=12),
          ss.models.noncommutative_oscillator(), ss.Model(ndof=12, nnoise=1, gradient=dense)]
schemes = ["midpoint", "symplectic_euler", "stormer_verlet", "gauss2", "gauss2_strong32", "midpoint_areas",
           "P1N2Q4Gau", "drift_preserving", "heun", "chin4a"]
for model in models:
    for scheme in schemes:
        try:
            cases = list(calls(model, scheme))
        except ss.errors.IncompatibleError:
            continue
        for name, function in cases:
            outcome = []
            for extra in (1, 7, 9, 10, 12, 16, 24, 40, 90, 200):
                print("at", model.name, scheme, name, extra, flush=True)
                try:
                    outcome.append(attempt(extra, function))
                except ss.errors.MissingOperationError:
                    outcome.append("incompatible")
                if outcome[-1] != "refused":
                    break
            print("done", model.name, scheme, name, outcome[0], outcome[-1], len(outcome), flush=True)
"""


@pytest.mark.parametrize("threads", [1, 2])
def test_every_call_ends_under_any_limit(threads):
    found = subprocess.run([sys.executable, "-c", CHILD, str(threads)], capture_output=True, text=True, check=False)
    lines = found.stdout.splitlines()
    assert found.returncode == 0, (lines[-1:], found.stderr[-1000:])
    done = [line.split() for line in lines if line.startswith("done")]
    assert len(done) > (200 if threads == 1 else 60)
    assert all(line[-2] in ("ok", "incompatible") for line in done), [line for line in done if line[-2] == "refused"]
    assert sum(line[-3] == "refused" for line in done) > len(done) // 2  # the smallest limits do have an effect


G = {"q0": 0.1, "p0": 0.1, "step": 0.01}


@pytest.mark.parametrize(
    "call",
    [
        lambda chain: ss.simulate(chain, steps=2, scheme="P1N2Q4Gau", general=True, **G),
        lambda chain: ss.moments(chain, steps=2, scheme="P1N2Q4Gau", general=True, **G),
        lambda chain: ss.diagnose.symplecticity(chain, "midpoint", q=0.1, p=0.1, step=0.01),
        lambda chain: ss.diagnose.stationary_path(chain, "gauss2", q_start=0.1, q_end=0.2, step=0.01, steps=2),
        lambda chain: ss.diagnose.action(ss.simulate(chain, steps=2, scheme="stormer_verlet", **G)),
    ],
)
def test_sizes_are_judged_before_work_begins(call):
    """A chain of 300000 masses: its dense matrices need 7e11 bytes or more, and the refusal says so at once."""
    with pytest.raises(MemoryError, match=r"needs \d\.\d+e\d+ bytes of memory, more than this process can have: give"):
        call(ss.models.fpu_chain(n=300000))


def test_large_systems_run_where_no_matrix_is_formed():
    chain = ss.models.fpu_chain(n=100000)
    for scheme in ("midpoint", "stormer_verlet", "gauss_dkdkd", "chin4a", "lambda:0.3", "P1N2Q4Gau"):
        assert ss.simulate(chain, steps=2, scheme=scheme, **G).report.outcome == "ok"
    assert np.isfinite(chain.gradient(np.full((100000, 1), 0.1), 0.1)[0]).all()


@pytest.mark.parametrize("bandwidth", [2, 3, 2**31 - 1])
def test_bandwidth_is_below_ndof(bandwidth):
    refusal = f"bandwidth {bandwidth} for 2 degrees of freedom; give 0 to 1"
    with pytest.raises(ss.errors.InvalidArgumentError, match=refusal):
        ss.Model(ndof=2, nnoise=0, gradient=lambda t, w, q, p: (w[0] * q, w[0] * p), bandwidth=bandwidth)


def test_wide_bands_are_judged():
    with pytest.raises(MemoryError, match="bandwidth"):
        ss.Model(ndof=40000, nnoise=0, gradient=lambda t, w, q, p: (w[0] * q, w[0] * p), bandwidth=39000).probe()


def test_codes_of_status_are_32_bits():
    with pytest.raises(ss.errors.InvalidArgumentError, match="code = 4294967296"):
        ss.status_text(2**32)
    assert ss.status_text(0) == "ok"


def test_results_that_a_group_forbids(monkeypatch):
    """A limit of a control group gives a refusal instead of a killed process when arrays are filled
    (test_capi_groups.c has the limits).
    """
    assert checks._left_by_groups() > 0
    monkeypatch.setattr(checks, "_left_by_groups", lambda: 4e9)
    told = r"need 4\.8 GB, more than the 4 GB that this process can have: save"
    with pytest.raises(ss.errors.TooLargeError, match=told):
        ss.simulate(ss.models.kubo(), q0=1.0, p0=0.0, step=0.1, steps=2999, paths=100000, threads=1)
