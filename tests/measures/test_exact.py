"""Identities and hand-derived values: they hold to rounding, not on average."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import jaxsurf as js

ROUNDING = {"rtol": 1e-9, "atol": 1e-11}  # float64 sums of up to 10^4 terms of order one


def rough(seed=0, shape=(2, 24, 30)):
    """Skewed heights without any symmetry, in float64."""
    return np.random.default_rng(seed).standard_gamma(2.0, shape)


def along(wave, shape):
    return np.broadcast_to(np.asarray(wave)[:, None], shape)[None]


def test_curvature_is_a_sum_of_height_correlations():  # Eq. (curv2)
    heights = rough()
    b = np.array([1, 2, 3, 5, 7])
    curvature = js.curvature_moment(heights, b).samples
    corners = js.height_correlation(heights, b, direction="11").samples
    near = js.height_correlation(heights, b, direction="10").samples
    far = js.height_correlation(heights, 2 * b[2 * b <= 12], direction="10").samples
    n = far.shape[1]
    expected = 16 * near - 4 * corners
    np.testing.assert_allclose(curvature[:, :n], expected[:, :n] - 2 * far, **ROUNDING)


def test_parseval():
    heights = rough(1, (3, 17, 22))
    spectrum = js.power_spectrum_map(heights, spacing=0.5)
    area = 17 * 22 * 0.25
    np.testing.assert_allclose(spectrum.values.sum((1, 2)) / area, heights.var((1, 2)), **ROUNDING)


@pytest.mark.parametrize("shape", [(16, 24), (15, 21), (24, 15)])
def test_height_correlation_from_the_spectrum_and_from_the_differences(shape):
    heights, spacing = rough(2, (2, *shape)), 0.5
    spectrum = js.power_spectrum_map(heights, spacing=spacing)
    correlation = js.height_correlation_map(heights, spacing=spacing)
    area = shape[0] * shape[1] * spacing**2
    for r in [(1, 0), (0, 1), (3, -2), (-5, 7)]:
        phase = spectrum.q_x[:, None] * r[0] + spectrum.q_y[None, :] * r[1]
        from_spectrum = 2 / area * (spectrum.values * (1 - np.cos(spacing * phase))).sum((1, 2))
        differences = np.roll(heights, (-r[0], -r[1]), (1, 2)) - heights
        at = (
            np.argmin(abs(correlation.x - spacing * r[0])),
            np.argmin(abs(correlation.y - spacing * r[1])),
        )
        by_transform = correlation.values[:, at[0], at[1]]
        np.testing.assert_allclose(from_spectrum, (differences**2).mean((1, 2)), **ROUNDING)
        np.testing.assert_allclose(by_transform, from_spectrum, **ROUNDING)


def test_rings_average_the_map_of_separations():
    heights = rough(3)
    full = js.height_correlation_map(heights)
    rings = js.height_correlation(heights)
    length = np.hypot(full.x[:, None], full.y[None, :])
    # the first rings hold one length each: 4 neighbours at 1, 4 at sqrt 2, 4 at 2
    for ring, r in enumerate([1, 2**0.5, 2]):
        there = np.isclose(length, r)
        assert rings.weights[0, ring] == 4 * 24 * 30
        np.testing.assert_allclose(
            rings.samples[:, ring], full.values[:, there].mean(1), **ROUNDING
        )
    inside = (length > 0) & (length <= 12)  # every separation up to L/2 is in some ring
    total = (rings.weights * rings.samples).sum(1) / (24 * 30)
    np.testing.assert_allclose(total, full.values[:, inside].sum(1), **ROUNDING)


def test_ring_means_of_the_spectrum_keep_the_power_inside_the_zone():
    heights = rough(4)
    full = js.power_spectrum_map(heights)
    curve = js.power_spectrum(heights)
    q = np.hypot(full.q_x[:, None], full.q_y[None, :])
    inside = (q > 0) & (q <= np.pi * (1 + 1e-9))
    total = (curve.weights * curve.samples).sum(1)
    np.testing.assert_allclose(total, full.values[:, inside].sum(1), **ROUNDING)
    assert curve.weights[0].sum() == inside.sum()
    assert not np.any(curve.missing)


def test_patches_interpolate_between_the_difference_and_the_whole_map():
    heights = rough(5, (2, 20, 20))
    whole = js.patch_moment(heights, [20], order=3).samples[:, 0]
    centred = heights - heights.mean((1, 2), keepdims=True)
    np.testing.assert_allclose(whole, (centred**3).mean((1, 2)), **ROUNDING)
    # the variance of four sites is the mean over their 12 ordered pairs (and 4 selves), halved
    near, corner = (js.height_correlation(heights, [1], direction=d) for d in ("10", "11"))
    four = (8 * near.samples + 4 * corner.samples) / 32
    np.testing.assert_allclose(js.patch_moment(heights, [2]).samples, four, **ROUNDING)
    assert np.all(js.patch_moment(heights, [1]).samples == 0)


def test_variance_splits_into_patches_and_smoothed_heights():
    heights, b = rough(6), [1, 2, 5, 12]
    inside, between = js.patch_moment(heights, b), js.smoothed_moment(heights, b)
    total = np.broadcast_to(heights.var((1, 2))[:, None], (2, 4))
    np.testing.assert_allclose(inside.samples + between.samples, total, **ROUNDING)


def test_line_spectrum_is_the_surface_spectrum_summed_over_the_other_axis():
    heights, spacing = rough(7, (2, 16, 20)), 0.5
    full = js.power_spectrum_map(heights, spacing=spacing)
    lines = js.line_spectrum(heights, spacing=spacing, boundary="periodic")
    summed = full.values.sum(1) / (16 * spacing)
    zero = 10
    np.testing.assert_allclose(lines.samples[:, :-1], summed[:, zero + 1 :], **ROUNDING)
    np.testing.assert_allclose(lines.samples[:, -1], summed[:, 0], **ROUNDING)  # q = -pi and pi


def test_line_variance_of_pairs_is_a_quarter_of_the_difference():
    profile = rough(8, (50,))
    variance = js.line_variance(profile, [1, 2]).samples[0]
    np.testing.assert_allclose(variance, [0, (np.diff(profile) ** 2).mean() / 4], **ROUNDING)


def test_plane_wave():
    side, mode, b = 48, 3, np.array([1, 2, 5, 8])
    heights = along(np.cos(2 * np.pi * mode * np.arange(side) / side), (side, side))
    phase = 2 * np.pi * mode * b / side
    curvature = js.curvature_moment(heights, b, order=4).mean
    # C_b = (2 cos(qb) - 2) h, <cos^4> = 3/8, <cos^2> = 1/2
    np.testing.assert_allclose(curvature, 3 / 8 * (2 * np.cos(phase) - 2) ** 4, **ROUNDING)
    ratio = js.curvature_ratio(heights, b)
    np.testing.assert_allclose(ratio.mean, 1.5, **ROUNDING)
    # along x, D_2 = 1 - cos(qr); along y, 0
    correlation = js.height_correlation(heights, b, direction="10").mean
    np.testing.assert_allclose(correlation, (1 - np.cos(phase)) / 2, **ROUNDING)
    spectrum = js.directional_spectrum(heights)["10"]
    power = np.zeros(side // 2)
    power[mode - 1] = side**2 / 4  # |h~| = N/2 at q and at -q
    np.testing.assert_allclose(spectrum.mean, power, **ROUNDING)
    quarter = np.pi * mode / side
    window = np.sin(b * quarter) / (b * np.sin(quarter))
    smoothed = js.smoothed_moment(heights, b).mean
    np.testing.assert_allclose(smoothed, window**2 / 2, **ROUNDING)


def test_checkerboard():
    x, y = np.indices((12, 16))
    heights = (-1.0) ** (x + y)[None]
    b = np.arange(1, 7)
    odd = b % 2 == 1
    np.testing.assert_allclose(js.curvature_moment(heights, b).mean, 64 * odd, **ROUNDING)
    assert np.all(js.curvature_moment(heights, b, direction="11").mean == 0)
    correlation = js.height_correlation(heights, b, order=3, direction="10").mean
    np.testing.assert_allclose(correlation, 8 * odd, **ROUNDING)
    patches = js.patch_moment(heights, b).mean  # the mean of an odd patch is 1/b^2 up or down
    np.testing.assert_allclose(patches, np.where(odd, 1 - 1.0 / b**4, 1), **ROUNDING)
    diagonal = js.directional_spectrum(heights)["11"]
    assert diagonal.scale.shape == (2,)  # on 12 x 16 the diagonal holds 4 modes and their mirrors
    np.testing.assert_allclose(diagonal.mean, [0, 12 * 16], **ROUNDING)
    assert diagonal.count[1] == 1  # (pi, pi) is its own mirror image


def test_quadratic_surface():
    x, y = np.indices((20, 24)).astype(float)
    heights = (0.5 * x**2 + 1.5 * y**2 + 3 * x - y + 2)[None]
    b = np.array([1, 2, 4, 9])
    # second differences of a parabola are constant: C_b = 2 b^2 (1/2 + 3/2) in either direction set
    for direction, factor in (("10", 4), ("11", 8)):
        curvature = js.curvature_moment(heights, b, order=3, direction=direction, boundary="open")
        np.testing.assert_allclose(curvature.mean, (factor * b**2) ** 3.0, rtol=1e-12)
    skew = js.curvature_skewness(heights, b, boundary="open")
    np.testing.assert_allclose(skew.mean, 1, rtol=1e-12)
    tilted = js.height_correlation((2 * x + 0 * y)[None], b, direction="10", boundary="open")
    along_x, along_y = (20 - b) * 24, 20 * (24 - b)
    np.testing.assert_allclose(
        tilted.mean, (2 * b) ** 2 * along_x / (along_x + along_y), rtol=1e-12
    )


@pytest.mark.parametrize(
    ("surfaces", "off"), [(40, 0.2), pytest.param(400, 0.06, marks=pytest.mark.slow)]
)
def test_white_noise_has_the_moments_of_its_heights(surfaces, off):
    """<C^2> = 20, <C^4> = 3 * 20^2, skewness -60/20^1.5 times that of independent heights."""
    key = jax.random.key(3)
    shape, b = (surfaces, 64, 60), [1, 2, 5]
    normal = jax.random.normal(key, shape)
    skewed = jax.random.exponential(key, shape) - 1  # variance 1, skewness 2
    for measured, exact in [
        (js.curvature_moment(normal, b), 20),
        (js.curvature_moment(normal, b, order=4), 1200),
        (js.curvature_ratio(normal, b), 3),
        (js.curvature_skewness(skewed, b), -60 / 20**1.5 * 2),
        (js.curvature_moment(skewed, b, order=3), -60 * 2),
    ]:
        pull = np.asarray((measured.mean - exact) / measured.stderr)
        assert np.all(abs(pull) < 5), (measured, pull)  # 5 standard errors: 1 in 2 million
        wrong = np.asarray((measured.mean - (1 + off) * exact) / measured.stderr)
        assert np.all(abs(wrong) > 5), (measured, wrong)


@settings(max_examples=4, deadline=None)
@given(
    sides=st.sampled_from([(8, 13), (9, 6)]),  # each shape compiles anew
    seed=st.integers(0, 1000),
    shift=st.tuples(st.integers(-9, 9), st.integers(-9, 9)),
)
def test_symmetries_of_every_measure(sides, seed, shift):
    heights = rough(seed, (1, *sides))
    measures = {
        "even": lambda h: js.height_correlation(h, [1, 3], order=1.5).samples,
        "rings": lambda h: js.height_correlation(h).samples,
        "spectrum": lambda h: js.power_spectrum(h).samples,
        "odd curvature": lambda h: js.curvature_moment(h, [1, 3], order=3).samples,
        "odd patch": lambda h: js.patch_moment(h, [2, 3], order=3).samples,
        "odd smooth": lambda h: js.smoothed_moment(h, [2, 3], order=3).samples,
    }
    for name, measure in measures.items():
        value = measure(heights)
        for same in (
            np.roll(heights, shift, (1, 2)),
            heights[:, ::-1],
            heights.swapaxes(1, 2),
            heights + 4.0,
        ):
            np.testing.assert_allclose(measure(same), value, rtol=1e-7, atol=1e-9, err_msg=name)
        sign = -1 if name.startswith("odd") else 1
        np.testing.assert_allclose(measure(-heights), sign * value, rtol=1e-7, atol=1e-9)


def test_custom_offsets_are_a_second_difference():
    heights = rough(9)
    curve = js.curvature_moment(heights, [1, 4], offsets=[[0, 1], [0, -1]], spacing=0.5)
    for i, b in enumerate([1, 4]):
        second = np.roll(heights, b, 2) + np.roll(heights, -b, 2) - 2 * heights
        np.testing.assert_allclose(curve.samples[:, i], (second**2).mean((1, 2)), **ROUNDING)
    np.testing.assert_allclose(curve.scale, [0.5, 2.0])


def test_dtype_and_batch_are_kept():
    heights = rough(10, (2, 3, 16, 16))
    wide, narrow = (
        js.curvature_moment(heights, [1]),
        js.curvature_moment(jnp.asarray(heights, jnp.float32), [1]),
    )
    assert wide.samples.dtype == np.float64
    assert narrow.samples.dtype == np.float32
    assert wide.surfaces == 6
    one = js.patch_moment(heights[1, 2], [3]).samples
    np.testing.assert_array_equal(one[0], js.patch_moment(heights, [3]).samples[5])
    whole = js.height_correlation(np.arange(16).reshape(4, 4) % 5)  # whole numbers are measured too
    assert whole.samples.dtype == np.float32
