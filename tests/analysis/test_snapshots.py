"""Pooling snapshots: one row a run, weighted as its snapshots are."""

import numpy as np
import pytest

from jaxsurf.analysis.snapshots import pool_snapshots
from jaxsurf.curve import Curve

SCALE = np.array([1.0, 2.0])


def test_rows_are_weighted_means_of_the_snapshots():
    samples = np.array([[1.0, 10.0], [2.0, 20.0], [3.0, 30.0], [4.0, 40.0]])
    weights = np.array([[1.0, 1.0], [1.0, 0.0], [3.0, 1.0], [1.0, 0.0]])
    pooled = pool_snapshots(Curve("length_tail", SCALE, samples, weights), 2)
    np.testing.assert_allclose(pooled.samples, [[2.5, 20.0], [3.0, 0.0]])
    np.testing.assert_allclose(pooled.weights, [[4.0, 2.0], [2.0, 0.0]])
    # the mean over everything is untouched
    np.testing.assert_allclose(pooled.mean[0], (weights * samples).sum(0)[0] / weights.sum(0)[0])


def test_repeated_snapshots_do_not_sharpen_the_error():
    rng = np.random.default_rng(0)
    once = Curve("length_tail", SCALE, rng.normal(size=(20, 2)))
    often = Curve("length_tail", SCALE, np.tile(once.samples, (5, 1)))
    np.testing.assert_allclose(pool_snapshots(often, 20).stderr, once.stderr)
    assert np.all(often.stderr < 0.6 * once.stderr)  # the control: taken as independent they would


def test_several_curves_pool_together():
    a = Curve("directional_spectrum", SCALE, np.ones((4, 2)), details=(("direction", "10"),))
    b = Curve("directional_spectrum", SCALE, 3 * np.ones((4, 2)), details=(("direction", "01"),))
    np.testing.assert_allclose(pool_snapshots([a, b], 2).samples, 2 * np.ones((2, 2)))


def test_misuse():
    curve = Curve("length_tail", SCALE, np.ones((5, 2)))
    with pytest.raises(ValueError, match="got 5 rows for 2 surfaces"):
        pool_snapshots(curve, 2)
    with pytest.raises(ValueError, match="must share their scales"):
        pool_snapshots([curve, Curve("length_tail", SCALE * 2, np.ones((5, 2)))], 5)
