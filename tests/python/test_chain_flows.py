# SPDX-License-Identifier: BSD-3-Clause
"""Whole steps of chains, generated or built in: the general stepper's to ulps, with the same bits in any blocks."""

import numpy as np
import pytest
import symsde as ss

pytest.importorskip("sympy")

from symsde.model.formulas import compiler, emit_chain_flow

if compiler.command() is None:
    pytest.skip("no C compiler", allow_module_level=True)

pytestmark = pytest.mark.optimised

FREE = "Sum(p[i]**2/2, i)"
CHAINS = {  # potential, noises, ends, sites
    "phi4": ("Sum(q[i]**2/2 + q[i]**4/4 + a*(q[i+1]-q[i])**2/2, i)", ["b*q[k]**2"], "periodic", 7),
    "springs": ("Sum((q[i+1]-q[i])**2/2 + a*(q[i+1]-q[i])**4/4, i)", ["-b*q[k]"], "fixed", 9),
    "open": ("Sum(q[i]**4/4, i) + Sum(a*(q[i+1]-q[i])**4/4, i)", ["b*q[k]**3", "Sum(b*q[i], i)"], "free", 9),
    "angles": ("Sum(1 - cos(q[i]) + a*(q[i+1]-q[i])**2/2, i)", ["b*cos(q[k])", "b*sin(q[k])"], "fixed", 9),
}
SCHEMES = (*emit_chain_flow.TABLEAUX, *emit_chain_flow.KICKS)
DRAWN = ("phi4", "springs")  # with one noise at each site, nonlinear and linear
OF_CHAINS = [(x, s) for x in (*CHAINS, "built in") for s in (*SCHEMES, *(emit_chain_flow.DRAWN if x in DRAWN else ()))]
RUN = {"p0": 0.3, "step": 0.05, "steps": 9, "seed": 3, "correction": "none"}


def chain(name: str) -> ss.Model:
    if name == "built in":
        return ss.models.fpu_chain(n=9, beta=0.7, sigma=0.3)
    potential, noise, ends, n = CHAINS[name]
    return ss.model_from_sympy(f"{FREE} + {potential}", noise, params={"a": 0.7, "b": 0.3}, n=n, ends=ends)


@pytest.mark.parametrize("rate", [0.0, 0.8])
@pytest.mark.parametrize(("name", "scheme"), OF_CHAINS)
def test_steps_are_those_of_the_general_stepper(name, scheme, rate):
    """Nine steps of 21 paths agree to rounding; a path alone, narrow blocks and other saves have the same bits."""
    model = chain(name).damped(rate)
    run = {**RUN, "scheme": scheme, "q0": np.linspace(0.1, 0.5, model.ndof)}
    whole, plain = (ss.simulate(model, **run, paths=21, general=g) for g in (False, True))
    assert whole.report.stepper == f"whole steps of {scheme} by the model" + (", damped" if rate else "")
    for x, y in ((whole.q, plain.q), (whole.p, plain.p)):
        np.testing.assert_allclose(x, y, rtol=0, atol=30 * np.spacing(np.abs(y).max()))
    alone = ss.simulate(model, **run, paths=1, first_path=20)
    np.testing.assert_array_equal(alone.p[:, :, 0], whole.p[:, :, 20])
    other = ss.simulate(model, **run, paths=21, save_every=9, lanes=8, threads=2)
    np.testing.assert_array_equal(other.q[-1], whole.q[-1])


@pytest.mark.parametrize(("n", "most"), [(4, 2), (8, 3), (64, 4)])
def test_few_paths_of_long_chains_go_one_by_one(n, most):
    """A block of eight lanes takes two to six times one path, so few paths go one by one, more of long chains."""
    model, run = ss.models.fpu_chain(n=n, sigma=0.3), {**RUN, "scheme": "stormer_verlet", "q0": 0.1}
    few, block = (ss.simulate(model, **run, paths=paths) for paths in (most, most + 1))
    assert (few.report.lanes, block.report.lanes) == (1, 8)
    np.testing.assert_array_equal(few.p, block.p[:, :, :most])


@pytest.mark.parametrize(
    ("scheme", "more", "lanes"),
    [("chin4a", {}, 8), ("gauss_dkdkd", {}, 8), ("gauss_dkdkd", {"refine": 1}, 64), ("chin4a_strong2", {}, 64)],
)
def test_blocks_of_long_chains_are_one_strip_wide(scheme, more, lanes):
    """But where J or finer increments are drawn for many lanes together. Paths have the bits of wide blocks."""
    potential, noise, ends, _ = CHAINS["phi4"]
    model = ss.model_from_sympy(f"{FREE} + {potential}", noise, params={"a": 0.7, "b": 0.3}, n=33, ends=ends)
    run = {**RUN, "scheme": scheme, "q0": np.linspace(0.1, 0.5, 33), "paths": 70, **more}
    chosen, wide = ss.simulate(model, **run), ss.simulate(model, **run, lanes=64)
    assert chosen.report.lanes == lanes
    np.testing.assert_array_equal(chosen.p, wide.p)


@pytest.mark.parametrize("scheme", ["gauss_dkdkd", "chin4a"])
def test_long_chains_are_the_built_in_ones(scheme):
    """A path alone computes its rows side by side, 256 at a time; states agree with those of the catalogue's chain."""
    potential, noise, ends, _ = CHAINS["springs"]
    model = ss.model_from_sympy(f"{FREE} + {potential}", noise, params={"a": 0.7, "b": 0.3}, n=300, ends=ends)
    run = {**RUN, "scheme": scheme, "q0": np.linspace(0.1, 0.5, 300) ** 2}
    alone, block = (ss.simulate(model, **run, paths=n) for n in (1, 9))
    np.testing.assert_array_equal(alone.p[:, :, 0], block.p[:, :, 0])
    known = ss.simulate(ss.models.fpu_chain(n=300, beta=0.7, sigma=0.3), **run, paths=9)
    np.testing.assert_allclose(block.p, known.p, rtol=0, atol=1e-14)


@pytest.mark.parametrize("paths", [1, 9])
def test_far_arguments_take_exact_functions(paths):
    """Angles beyond the range of the inlined sine are computed again, and change no other lane."""
    model = chain("angles")
    q0 = np.full((model.ndof, paths), 0.3)
    q0[4, -1] = 3e5
    run = {**RUN, "scheme": "gauss_dkdkd", "paths": paths}
    whole, plain = (ss.simulate(model, q0=q0, **run, general=g) for g in (False, True))
    np.testing.assert_allclose(whole.p, plain.p, rtol=1e-9, atol=1e-12)
    near = ss.simulate(model, q0=0.3, **run)
    np.testing.assert_array_equal(whole.p[:, :, : paths - 1], near.p[:, :, : paths - 1])


@pytest.mark.parametrize(
    ("noise", "n", "schemes"),
    [(["Sum(b*q[i]**2, i)"], 9, (*emit_chain_flow.TABLEAUX, "gauss_dkdkd")), (["b*q[k]"], 2049, ()), ([], 9, ())],
)
def test_other_chains_go_other_ways(noise, n, schemes):
    """Noises that meet have products that single rows do not know; longer chains leave the cache."""
    params = {"a": 0.7, "b": 0.3} if noise else {"a": 0.7}
    model = ss.model_from_sympy(f"{FREE} + {CHAINS['phi4'][0]}", noise or None, params=params, n=n)
    assert tuple(emit_chain_flow.flows(model._chain)) == tuple(schemes)
    run = ss.simulate(model, **RUN, q0=0.3, scheme="chin4a")
    assert not run.report.stepper.startswith("whole steps")


@pytest.mark.parametrize("name", [x for x in CHAINS if x not in DRAWN])
def test_pairs_of_noises_are_left_to_the_library(name):
    """J of several noises at a site, or of a noise at all sites, has a column for each pair that meets."""
    run = ss.simulate(chain(name), **RUN, q0=0.3, scheme="gauss_dkdkd_strong2")
    assert not run.report.stepper.startswith("whole steps")


@pytest.mark.parametrize("scheme", ["verlet_kdk", "verlet_kdk_strong2"])
def test_flows_of_a_quadratic_part_take_the_place_of_drifts(scheme):
    """Whole steps of kicks have drifts by p alone, and are not offered where a part of H is split off."""
    form = f"{FREE} + Sum((q[i+1]-q[i])**2/2, i)"
    model = ss.model_from_sympy(f"{form} + Sum(q[i]**4/4, i)", "0.3*q[k]**2", n=4, split=form)
    run = ss.simulate(model, **RUN, q0=0.3, scheme=scheme)
    assert run.report.stepper == "kicks between flows of a quadratic part"
