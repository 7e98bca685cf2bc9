# SPDX-License-Identifier: BSD-3-Clause
"""Increments of the caller, in any order of memory: large arrays are read where they are."""

import itertools

import numpy as np
import pytest
import symsde as ss

STEPS, STEP = 96, 0.02
CASES = [
    (ss.models.pendulum(), "stormer_verlet", {}),
    (ss.models.fpu_chain(n=8), "stormer_verlet", {}),
    (ss.models.synchrotron(), "gauss2", {}),
    (ss.models.synchrotron(), "midpoint", {"refine": 1}),
    (ss.models.synchrotron(), "gauss2_strong32", {"truncation": (3, 1.0)}),
]


def drawn(case: tuple, paths: int) -> np.ndarray:
    """Increments (row, noise, path), with dZ as further columns where the scheme takes it."""
    model, scheme, options = case
    rows, wide = STEPS << options.get("refine", 0), 2 if "strong" in scheme else 1
    dw = np.random.default_rng(3).normal(0, np.sqrt(STEP * STEPS / rows), (rows, model.nnoise * wide, paths))
    dw[:, model.nnoise :] *= 0.3 * STEP
    return dw


def run(case: tuple, increments: object, paths: int, function=ss.simulate, **more: object) -> ss.Run:
    """A run of a case."""
    model, scheme, options = case
    how = {"step": STEP, "steps": STEPS, "q0": 0.3, "p0": 0.0, "save_every": STEPS // 2, **options, **more}
    return function(model, scheme=scheme, paths=paths, increments=increments, **how)


def in_order(dw: np.ndarray, order: tuple[int, ...]) -> np.ndarray:
    """A view (row, noise, path) of the same numbers, whose axes lie in memory in this order."""
    return np.ascontiguousarray(dw.transpose(order)).transpose(np.argsort(order))


def ways(dw: np.ndarray) -> dict[str, np.ndarray]:
    """The same numbers as they may lie in memory."""
    found = {f"axes {order}": in_order(dw, order) for order in itertools.permutations(range(3))}
    found["Fortran"] = np.asfortranarray(dw)
    for axis in range(3):  # every other row, noise, path of a larger array
        found[f"strided {axis}"] = np.repeat(dw, 2, axis)[(slice(None),) * axis + (slice(1, None, 2),)]
    found["part of paths"] = np.concatenate([dw + 7, dw, dw + 9], axis=2)[..., dw.shape[2] : 2 * dw.shape[2]]
    found["reversed"] = dw[::-1].copy()[::-1]
    found["unaligned"] = np.frombuffer(b"x" + dw.tobytes(), np.uint8)[1:].view(np.float64).reshape(dw.shape)
    found["swapped bytes"] = dw.astype(">f8")
    found["read-only"] = dw.copy()
    found["read-only"].flags.writeable = False
    return found


@pytest.mark.parametrize("paths", [1, 3, 70, 300])
@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case[0].name} {case[1]}")
def test_bits_do_not_depend_on_the_order_of_memory(case, paths):
    dw = drawn(case, paths)
    expected = run(case, dw, paths)
    assert (expected.status == 0).all()
    for name, given in ways(dw).items():
        np.testing.assert_array_equal(given, dw, err_msg=name)
        for more in ({}, {"lanes": 8}, {"threads": 2}):
            found = run(case, given, paths, **more)
            for x, y in ((found.q, expected.q), (found.last_p, expected.last_p)):
                assert (x == y).all(), (name, more)
    part = in_order(dw, (2, 0, 1))[..., paths // 2 :]  # paths have the bits of all of them
    assert (run(case, part, part.shape[2]).q == expected.q[..., paths // 2 :]).all()


@pytest.mark.parametrize("paths", [3, 300])
def test_one_path_for_all_is_not_repeated(paths):
    case = CASES[0]
    one = drawn(case, 1)
    expected = run(case, np.repeat(one, paths, 2), paths).q
    for given in (one, one[..., 0], np.broadcast_to(one, (*one.shape[:2], paths)), in_order(one, (2, 1, 0))):
        assert (run(case, given, paths).q == expected).all()


def test_single_precision_is_converted():
    case, dw = CASES[0], drawn(CASES[0], 70).astype(np.float32)
    assert (run(case, dw, 70).q == run(case, dw.astype(float), 70).q).all()


def test_large_arrays_are_not_copied(tmp_path):
    case, dw = CASES[0], drawn(CASES[0], 300)
    for given in (dw, in_order(dw, (2, 0, 1)), dw[::2].repeat(2, 0)[::1]):
        assert np.shares_memory(run(case, given, 300).setup.increments, given)
    small = dw[..., :3].copy()
    assert not np.shares_memory(run(case, small, 3).setup.increments, small)
    np.ascontiguousarray(dw.transpose(2, 0, 1)).tofile(tmp_path / "dw")
    mapped = np.memmap(tmp_path / "dw", np.float64, "r", shape=(300, STEPS, 1)).transpose(1, 2, 0)
    assert (run(case, mapped, 300).q == run(case, dw, 300).q).all()


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 0, 1), (2, 1, 0)])
@pytest.mark.parametrize("paths", [1, 70, 300])
def test_the_first_number_that_is_not_finite_is_named(order, paths):
    for case, row, column, path in ((CASES[1], 40, 5, paths // 2), (CASES[3], 2 * STEPS - 1, 1, paths - 1)):
        for bad in (np.nan, np.inf, -np.inf):
            dw = in_order(drawn(case, paths), order)
            dw[row, column, path] = bad
            if path + 1 < paths:
                dw[row - 1, column, path + 1] = bad  # earlier, of a later path
            step = 5 + (row >> case[2].get("refine", 0))
            who = f"step {step} of path {256 + path}" if paths > 1 else f"step {step} of all paths"
            words = rf"not finite, the first one in {who} \(column {column + 1}, counted from 1\): give finite numbers"
            for function in (ss.simulate, ss.moments):
                for more in ({}, {"lanes": 8, "threads": 2}):
                    with pytest.raises(ss.errors.InvalidArgumentError, match=words):
                        run(case, dw, paths, function=function, first_path=256, first_step=5, **more)


def test_what_is_refused_does_not_depend_on_paths_that_failed():
    case = CASES[1]
    for path in (0, 77):
        dw = drawn(case, 300)
        dw[4, 0, path] = 1e200  # the path fails here
        with pytest.warns(ss.errors.PathsFailedWarning):
            assert run(case, dw, 300).failed_step[path] > 0
        dw[90, 0, path] = np.nan
        for more in ({}, {"lanes": 8}, {"threads": 2}):
            with pytest.raises(ss.errors.InvalidArgumentError, match=f"step 90 of path {path} "):
                run(case, dw, 300, **more)
        alone = dw[..., path : path + 1].repeat(8, 2)  # all paths of the block have failed before
        with pytest.raises(ss.errors.InvalidArgumentError, match="step 90 of path 0 "):
            run(case, alone, 8)


def test_a_prepared_run_that_refuses_stays_where_it_is():
    model, scheme, _ = CASES[1]
    for paths in (1, 70):
        prepared = ss.prepare(model, scheme, step=STEP, q0=0.3, p0=0.0, paths=paths)
        dw = in_order(drawn(CASES[1], paths), (2, 0, 1))
        first = prepared.run(STEPS, STEPS, increments=dw)
        assert (first.last_q == run(CASES[1], dw, paths).last_q).all()
        spoilt = dw.copy()
        spoilt[50, 3, -1] = np.nan
        with pytest.raises(ss.errors.InvalidArgumentError, match=f"step {STEPS + 50} of"):
            prepared.run(STEPS, STEPS, increments=spoilt)
        assert prepared.next_step == STEPS
        assert (prepared.q == first.last_q).all()


def test_increments_changed_after_the_run_are_not_analysed():
    model = ss.models.linear_oscillator()
    dw = np.random.default_rng(1).normal(0, 0.1, (200, 1, 40))
    found = ss.simulate(model, q0=1.0, p0=0.0, step=0.01, steps=200, paths=40, increments=dw)
    for order in ((0, 1, 2), (2, 0, 1)):
        same = ss.simulate(model, q0=1.0, p0=0.0, step=0.01, steps=200, paths=40, increments=in_order(dw, order))
        for function in (ss.diagnose.exact, ss.diagnose.action):
            for x, y in zip(np.atleast_1d(function(same)), np.atleast_1d(function(found)), strict=True):
                np.testing.assert_array_equal(x, y)
    dw[-1] *= 1.01
    for function in (ss.diagnose.exact, ss.diagnose.action):
        with pytest.raises(ss.errors.IncompatibleError, match="changed since"):
            function(found)


def test_derivatives_take_increments_in_any_order():
    case = CASES[0]
    for paths in (1, 70):
        dw = drawn(case, paths)
        how = {"scheme": case[1], "q0": 0.3, "p0": 0.1, "step": STEP, "steps": STEPS, "paths": paths}
        expected = ss.tangent(case[0], increments=dw, **how).matrix
        slopes = ss.gradient(case[0], "q**2", wrt=["q0", "p0"], increments=dw, **how)
        for order in itertools.permutations(range(3)):
            given = in_order(dw, order)
            assert (ss.tangent(case[0], increments=given, **how).matrix == expected).all()
            again = ss.gradient(case[0], "q**2", wrt=["q0", "p0"], increments=given, **how)
            assert str(again) == str(slopes)
