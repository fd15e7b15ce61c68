"""Skewness and kurtosis of the heights: hand-made maps, known distributions, then symmetries."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxsurf as js
from jaxsurf.measures.heights import moments

BOTH = (js.height_skewness, js.height_kurtosis)


def test_one_peak_on_a_flat_map():
    # one site of n at 1, the others at 0: p = 1/n of a coin, whose moments are known
    p = 1 / 32
    heights = np.zeros((4, 8))
    heights[2, 3] = 1.0
    skew, excess = (measure(heights) for measure in BOTH)
    # float64: rounding of sums of 32 terms
    np.testing.assert_allclose(skew.mean, [(1 - 2 * p) / np.sqrt(p * (1 - p))], rtol=1e-12)
    np.testing.assert_allclose(excess.mean, [(1 - 6 * p * (1 - p)) / (p * (1 - p))], rtol=1e-12)
    assert (skew.kind, excess.kind) == ("height_skewness", "height_kurtosis")
    assert skew.scale.tolist() == [4.0]
    assert js.height_skewness(heights, spacing=0.5).scale.tolist() == [2.0]
    # a step up and a step down, half and half, has no skewness and the least possible kurtosis
    coin = np.indices((4, 8)).sum(0) % 2 * 1.0
    assert [float(measure(coin).mean[0]) for measure in BOTH] == [0.0, -2.0]


def test_the_ensemble_is_one_distribution():
    """Surfaces of unlike roughness: moments are averaged over them before the ratio is taken."""
    heights = (
        np.random.default_rng(0).gamma(2.0, size=(40, 12, 10))
        * np.linspace(1, 3, 40)[:, None, None]
    )
    centred = heights - heights.mean((1, 2), keepdims=True)
    second, third, fourth = ((centred**q).mean() for q in (2, 3, 4))
    exact = third / second**1.5, fourth / second**2 - 3
    for measure, value in zip(BOTH, exact, strict=True):
        curve = measure(heights)
        # the jackknife moves the plain ratio by its bias, far below an error
        assert abs(curve.mean[0] - value) < 0.3 * curve.stderr[0]
        own = np.mean([measure(one).mean[0] for one in heights])
        assert abs(own - value) > 0.3 * curve.stderr[0]  # the control: a mean of ratios is not it


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_known_distributions(dtype):
    rng = np.random.default_rng(1)
    shape = (60, 48, 52)
    cases = [  # heights, skewness, excess kurtosis
        (rng.normal(size=shape), 0.0, 0.0),
        (rng.gamma(4.0, size=shape), 1.0, 1.5),
        (-rng.gamma(4.0, size=shape), -1.0, 1.5),
        (rng.uniform(size=shape), 0.0, -1.2),
    ]
    for heights, *exact in cases:
        for measure, value in zip(BOTH, exact, strict=True):
            curve = measure(heights.astype(dtype))
            assert curve.samples.dtype == dtype
            # 4.5 errors: 1 in 150,000 for each of 16
            assert abs(curve.mean[0] - value) < 4.5 * curve.stderr[0], (measure.__name__, value)
            # the control: errors are 0.003 to 0.06, so a value off by 0.4 would be seen
            assert abs(curve.mean[0] - value - 0.4) > 4.5 * curve.stderr[0]


def test_gaussian_surfaces_are_gaussian_however_few_modes_carry_them():
    # alpha = 1: one map of 32 x 32 is ruled by four modes, and its own kurtosis is far from 0
    heights = js.sample(js.SelfAffine(alpha=1.0), (32, 32), key=jax.random.key(3), batch=2000)
    for measure in BOTH:
        curve = measure(heights)
        assert abs(curve.mean[0]) < 4.5 * curve.stderr[0]
        assert curve.stderr[0] < 0.05
    own = [js.height_kurtosis(one).mean[0] for one in heights[:40]]
    assert np.mean(own) < -0.2  # the control: ratios of single maps are biased


@pytest.mark.parametrize("mask_shape", [(12, 10), (9, 12, 10)])
def test_symmetries_and_masks(mask_shape):
    rng = np.random.default_rng(4)
    heights = rng.gamma(1.5, size=(9, 12, 10))
    mask = rng.random(mask_shape) > 0.3
    for measure, sign in zip(BOTH, (-1, 1), strict=True):
        plain = measure(heights, mask=mask).samples
        # float64 identities: rounding only
        same = {"rtol": 1e-9, "atol": 1e-9}
        np.testing.assert_allclose(measure(-heights, mask=mask).samples, sign * plain, **same)
        np.testing.assert_allclose(measure(7 * heights + 40, mask=mask).samples, plain, **same)
        hidden = np.where(mask, heights, np.nan)
        np.testing.assert_array_equal(measure(hidden, mask=mask).samples, plain)
        unmasked = measure(heights).samples
        assert np.abs(unmasked - plain).max() > 1e-3  # the control: the mask matters
    count = js.height_skewness(heights, mask=mask).weights[:, 0]
    np.testing.assert_array_equal(count, np.broadcast_to(mask, heights.shape).sum((1, 2)))


def test_the_smoothed_skewness_of_the_raw_map():
    heights = np.random.default_rng(5).gamma(2.0, size=(6, 16, 16))
    raw = js.smoothed_skewness(heights, [1])
    np.testing.assert_allclose(js.height_skewness(heights).samples, raw.samples, rtol=1e-9)


def test_a_map_far_from_zero_keeps_its_digits():
    heights = np.random.default_rng(6).exponential(size=(4, 32, 32)).astype(np.float32)
    far = heights + np.float32(2**14)  # steps of 2^-9 there: relative 0.002 of the heights
    near = np.asarray(js.height_skewness(heights).samples)
    np.testing.assert_allclose(js.height_skewness(far).samples, near, rtol=0.01)


def test_inside_jit_and_vmap():
    heights = jax.random.exponential(jax.random.key(7), (3, 5, 8, 8))
    stacked = jax.jit(jax.vmap(lambda h: js.height_kurtosis(h)))(heights)
    alone = js.height_kurtosis(heights[1])
    # float32 rounding of sums of 64 terms, fourth powers
    np.testing.assert_allclose(stacked[1].samples, alone.samples, rtol=1e-4)
    assert moments(jnp.ones((2, 4, 4)), orders=(2, 3))[0].shape == (2, 2)
