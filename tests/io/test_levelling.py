"""Levelling takes exactly the polynomials out, and nothing else."""

import numpy as np
import pytest

from jaxsurf.io.heightmap import HeightMap
from jaxsurf.io.levelling import level

X, Y = np.meshgrid(np.arange(12.0), np.arange(9.0), indexing="ij")


@pytest.mark.parametrize(
    ("degree", "polynomial"),
    [(0, 5 + 0 * X), (1, 3 * X - 2 * Y + 1), (2, X**2 - X * Y), (3, X**3 - Y**3 + X * X * Y)],
)
def test_polynomials_vanish(degree, polynomial):
    # float64 least squares of 108 sites on orthogonal-like functions: errors of a few eps
    scale = np.abs(polynomial).max()
    assert np.abs(level(HeightMap(polynomial), degree=degree).heights).max() < 1e-13 * scale
    if degree:  # the control: one degree less leaves something
        assert np.abs(level(HeightMap(polynomial), degree=degree - 1).heights).max() > 1e-3


def test_a_wave_survives_and_missing_sites_do_not_count():
    wave = np.cos(2 * np.pi * X / 3)  # a whole number of periods, orthogonal to any plane in x, y
    wave = wave - wave.mean()
    tilted = wave + 4 * Y - 7
    missing = tilted.copy()
    missing[3:6, 4] = np.nan
    np.testing.assert_allclose(
        level(HeightMap(tilted)).heights, level(HeightMap(wave)).heights, atol=1e-12
    )
    found = level(HeightMap(missing))
    assert np.isnan(found.heights[3:6, 4]).all()
    assert abs(np.nanmean(found.heights)) < 1e-13


def test_misuse():
    with pytest.raises(ValueError, match="degree must be 0, 1, 2 or 3; got 4"):
        level(HeightMap(X), degree=4)
    almost_empty = np.full((6, 6), np.nan)
    almost_empty[:2, :2] = 1.0
    with pytest.raises(ValueError, match="at least 12 valid sites; got 4"):
        level(HeightMap(almost_empty))
