"""Bad input: every message says the value, the rule and the remedy; missing scales are reported."""

import jax
import numpy as np
import pytest

import jaxsurf as js

HEIGHTS = np.random.default_rng(1).normal(size=(2, 16, 20))
MASK = np.ones((16, 20), bool)


@pytest.mark.parametrize(
    ("measure", "change", "message"),
    [
        (js.curvature_moment, {"scales": [0, 1]}, r"scales must lie in \[1, L/2 = 8\]; got \[0\]"),
        (js.curvature_moment, {"scales": [9]}, r"scales must lie in \[1, L/2 = 8\]; got \[9\]"),
        (js.curvature_moment, {"scales": [1.5]}, "scales must be whole numbers"),
        (js.curvature_moment, {"scales": [2, 1]}, "scales must ascend without repeats"),
        (js.curvature_moment, {"scales": []}, "scales must be one list"),
        (js.curvature_moment, {"order": 0}, "order must be at least 1; got 0"),
        (js.curvature_moment, {"direction": "12"}, "direction must be one of"),
        (js.curvature_moment, {"offsets": [[1, 0]]}, "offsets must sum to zero"),
        (js.curvature_moment, {"offsets": [1, -1]}, r"offsets must be whole vectors \[M, 2\]"),
        (js.curvature_ratio, {"scales": [99]}, "scales must lie in"),
        (js.height_correlation, {"order": 0}, r"order must lie in \(0, inf\); got 0"),
        (js.height_correlation, {"order": -1}, r"order must lie in \(0, inf\); got -1"),
        (js.height_correlation, {"direction": "radial", "order": 3}, "must have order 2"),
        (js.height_correlation, {"separations": [11]}, "separations must lie in"),
        (js.patch_moment, {"order": 1}, "order must be at least 2; got 1"),
        (js.patch_moment, {"sizes": [17]}, r"sizes must lie in \[1, L = 16\]"),
        (js.patch_skewness, {"sizes": [1]}, r"sizes must lie in \[2, L = 16\]"),
        (js.smoothed_moment, {"window": "hat"}, "window must be one of"),
        (js.smoothed_skewness, {"sizes": [9]}, r"sizes must lie in \[1, L/2 = 8\]"),
        (js.power_spectrum, {"window": "hann"}, "window must be None for a periodic map"),
        (js.power_spectrum, {"window": "hat", "boundary": "open"}, "window must be one of"),
        (js.power_spectrum, {"boundary": "closed"}, "boundary must be one of"),
        (js.power_spectrum, {"spacing": 0.0}, r"spacing must lie in \(0, inf\)"),
        (js.power_spectrum, {"mask": MASK[:5]}, "mask must have the shape of the heights"),
        (js.power_spectrum, {"mask": MASK.astype(int)}, "mask must be a boolean array"),
        (js.patch_moment, {"mask": ~MASK}, "mask must leave at least one valid site"),
        (js.line_spectrum, {"window": "hann", "boundary": "periodic"}, "window must be None"),
        (js.line_variance, {"intervals": [21]}, r"intervals must lie in \[1, L = 20\]"),
    ],
)
def test_arguments_out_of_range(measure, change, message):
    with pytest.raises((ValueError, TypeError), match=message):
        measure(HEIGHTS, **change)


ALL = [
    js.power_spectrum,
    js.directional_spectrum,
    js.power_spectrum_map,
    js.height_correlation,
    js.height_correlation_map,
    js.curvature_moment,
    js.curvature_ratio,
    js.curvature_skewness,
    js.patch_moment,
    js.patch_skewness,
    js.smoothed_moment,
    js.smoothed_skewness,
    js.height_skewness,
    js.height_kurtosis,
]


@pytest.mark.parametrize("measure", ALL)
@pytest.mark.parametrize(
    ("heights", "message"),
    [
        (np.where(np.arange(320).reshape(16, 20) == 7, np.nan, HEIGHTS), "finite; got 2 NaN"),
        (np.ones((16, 20)), "heights must vary"),
        (HEIGHTS[0, 0], "heights must be a map"),
        (HEIGHTS[:, :3], "at least 4 x 4 sites"),
        (HEIGHTS + 1j, "heights must be real numbers"),
    ],
    ids=["NaN", "constant", "profile", "small", "complex"],
)
def test_heights_that_cannot_be_measured(measure, heights, message):
    with pytest.raises((ValueError, TypeError), match=message):
        measure(heights)


@pytest.mark.parametrize("measure", [js.line_spectrum, js.line_variance])
def test_profiles_that_cannot_be_measured(measure):
    with pytest.raises(ValueError, match="heights must be finite; got 1"):
        measure(np.array([1.0, np.inf, 2, 3, 4]))
    with pytest.raises(ValueError, match="heights must vary"):
        measure(np.ones(20))
    with pytest.raises(ValueError, match="at least 4 sites"):
        measure(np.arange(3.0))
    with pytest.raises(TypeError, match="heights must be real"):
        measure(np.ones(20, complex))


def test_levelling_needs_sites_off_one_line():
    diagonal = np.eye(16, 20, dtype=bool)
    with pytest.raises(ValueError, match="not on one line"):
        js.power_spectrum(HEIGHTS, boundary="open", mask=diagonal)


def test_missing_scales_are_reported_and_never_nan():
    mask = np.zeros((16, 20), bool)
    mask[:6, :7] = True  # nothing further apart than 5 sites along x, 6 along y
    spoiled = np.where(mask, HEIGHTS, np.nan)
    how = {"boundary": "open", "mask": mask}
    for curve, present in [
        (js.curvature_moment(spoiled, [1, 2, 3, 4], **how), [True, True, False, False]),
        (js.curvature_ratio(spoiled, [1, 2, 3, 4], **how), [True, True, False, False]),
        (js.height_correlation(spoiled, [1, 5, 6, 7], **how), [True, True, True, False]),
        (js.patch_moment(spoiled, [2, 6, 7, 8], **how), [True, True, False, False]),
        (js.patch_skewness(spoiled, [2, 6, 7, 8], **how), [True, True, False, False]),
        (js.smoothed_moment(spoiled, [1, 6, 7, 8], **how), [True, True, False, False]),
        (js.smoothed_skewness(spoiled, [1, 6, 7, 8], **how), [True, True, False, False]),
    ]:
        assert (~curve.missing).tolist() == present, curve
        assert np.all(np.isfinite(curve.samples)), curve
        assert np.all(curve.samples[:, curve.missing] == 0)
        assert "missing" in repr(curve)
    corner = np.zeros_like(mask)
    corner[:4, :4] = True  # no two sites further apart than 3 sqrt 2
    rings = js.height_correlation(spoiled, boundary="open", mask=corner)
    assert np.all(np.isfinite(rings.samples))
    # eight rings up to (2, 3); then one of (4, 0) and (4, 1), without pairs; then that of (3, 3)
    assert np.flatnonzero(~rings.missing).tolist() == [*range(8), 9]
    assert np.all(np.isfinite(js.power_spectrum(spoiled, **how).samples))


def test_masked_heights_are_never_looked_at():
    mask = np.random.default_rng(0).random((16, 20)) > 0.2
    wild = np.where(mask, HEIGHTS, 1e30)
    for measure in ALL:
        one, other = (measure(heights, mask=mask) for heights in (wild, HEIGHTS))
        for a, b in zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True):
            np.testing.assert_array_equal(a, b)
