# SPDX-License-Identifier: BSD-3-Clause
"""ss.commutator: commutative and non-commutative noises told apart, and the increments of weak schemes."""

import numpy as np
import pytest
import symsde as ss


def test_classes_of_noise():
    kubo = ss.commutator(ss.models.kubo())
    assert kubo.commutative and kubo.flows_commute
    synchrotron = ss.commutator(ss.models.synchrotron())
    assert synchrotron.commutative and not synchrotron.flows_commute
    mixed = ss.commutator(ss.models.noncommutative_oscillator(s1=0.5, s2=0.5))
    assert not mixed.commutative and mixed.noise > 0.1
    assert "order" in str(mixed)


def test_points_must_fit():
    with pytest.raises(ss.errors.WrongShapeError, match="q"):
        ss.commutator(ss.models.kubo(), q=np.zeros((2, 3)), p=np.zeros((2, 3)))
    with pytest.raises(ss.errors.WrongTypeError, match="model"):
        ss.commutator("kubo")


def test_increments_have_the_law_of_the_scheme():
    model = ss.models.synchrotron()
    h = 0.25
    dw = ss.increments(model, step=h, steps=6, paths=200, seed=5, scheme="gauss2_weak2")
    assert set(np.unique(np.round(dw, 12))) == set(np.round([-np.sqrt(3 * h), 0, np.sqrt(3 * h)], 12))
    run = ss.simulate(model, q0=1.0, p0=0.0, step=h, steps=6, paths=200, seed=5, scheme="midpoint_weak1")
    signs = ss.increments(model, step=h, steps=6, paths=200, seed=5, scheme="midpoint_weak1")
    assert np.allclose(np.abs(signs), np.sqrt(h))
    again = ss.simulate(model, q0=1.0, p0=0.0, step=h, steps=6, paths=200, increments=signs, scheme="midpoint_weak1")
    assert np.array_equal(run.q, again.q)
