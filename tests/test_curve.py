"""Curve: means, errors and covariances over surfaces; missing scales; joining and cutting."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxsurf as js

RNG = np.random.default_rng(3)
SCALE = np.array([1.0, 2.0, 4.0])


def curve(surfaces=6, weights=None, **how):
    return js.Curve("spectrum", SCALE, RNG.normal(2, 1, (surfaces, 3)), weights, **how)


def test_with_equal_weights_the_errors_are_the_ordinary_ones():
    c = curve(weights=np.full((6, 3), 7.0))
    np.testing.assert_allclose(c.mean, c.samples.mean(0))
    np.testing.assert_allclose(c.stderr, c.samples.std(0, ddof=1) / np.sqrt(6))
    np.testing.assert_allclose(c.covariance(), np.cov(c.samples.T) / 6)
    np.testing.assert_allclose(c.count, 42)


def test_weights_make_the_mean_that_of_everything_counted():
    weights = np.array([[1.0], [3.0]]) * np.ones((2, 3))
    c = js.Curve("spectrum", SCALE, np.array([[1.0] * 3, [5.0] * 3]), weights)
    np.testing.assert_allclose(c.mean, (1 + 3 * 5) / 4)
    # n/(n-1) sum w^2 (y - mean)^2 / W^2 = 2 (9 + 9) / 16
    np.testing.assert_allclose(c.stderr, np.sqrt(2 * (9 + 9) / 16))
    np.testing.assert_allclose(np.diagonal(c.covariance()), c.stderr**2)


def test_standard_error_of_unequal_weights_covers_the_truth():
    """Surfaces of unequal counts: the mean of 2000 repeats scatters as its error says."""
    weights = RNG.uniform(0.5, 3, (2000, 40, 1))
    samples = RNG.normal(size=(2000, 40, 1)) / np.sqrt(weights)
    stack = js.Curve("spectrum", np.ones((2000, 1)), samples, weights)
    scatter, claimed = stack.mean.std(), np.sqrt((stack.stderr**2).mean())
    # relative error of a deviation from 2000 draws 1.6 %, bias of order 1/40; 5 sigma and that
    assert claimed == pytest.approx(scatter, rel=0.08 + 0.025)
    assert claimed != pytest.approx(1.2 * scatter, rel=0.08 + 0.025)


def test_missing_scales_have_mean_and_count_zero_and_are_listed():
    weights = np.ones((6, 3)) * np.array([1, 0, 1])
    c = curve(weights=weights)
    assert c.missing.tolist() == [False, True, False]
    assert c.mean[1] == 0
    assert c.stderr[1] == 0
    assert "1 missing (nothing to average): 2" in repr(c)
    assert "missing" in c._repr_html_()
    np.testing.assert_array_equal(c.present().scale, [1, 4])
    np.testing.assert_array_equal(c.window(2, 9).scale, [4])


def test_window_resample_and_details():
    c = curve(details=[("order", 2), ("side", 64.0)], units=("nm", "nm^2"))
    assert c.detail("order") == 2
    assert c.detail("none", 5) == 5
    assert c.window(1, 2).units == ("nm", "nm^2")
    np.testing.assert_array_equal(c.resample([1, 1, 3]).samples, c.samples[[1, 1, 3]])


def test_joined_batches_are_the_whole_ensemble():
    whole = curve(7)
    parts = [whole.resample(range(3)), whole.resample(range(3, 7))]
    joined = js.concatenate(parts)
    np.testing.assert_allclose(joined.mean, whole.mean)
    np.testing.assert_allclose(joined.covariance(), whole.covariance())


def test_a_curve_can_be_differentiated_and_vmapped():
    samples = jnp.arange(12.0).reshape(2, 2, 3)
    stack = jax.vmap(lambda s: js.Curve("spectrum", jnp.asarray(SCALE, s.dtype), s))(samples)
    np.testing.assert_allclose(stack[1].mean, samples[1].mean(0))
    assert stack.surfaces == 2
    gradient = jax.grad(lambda s: js.Curve("spectrum", SCALE, s).mean.sum())(samples[0])
    np.testing.assert_allclose(gradient, 0.5)
    assert "samples (2, 2, 3)" in repr(stack)


@pytest.mark.parametrize(
    ("make", "error", "message"),
    [
        (lambda: js.Curve("spectrum", SCALE, np.ones(3)), ValueError, "one row of samples"),
        (lambda: js.Curve("spectrum", SCALE, np.ones((2, 4))), ValueError, r"\(2, 4\) and \(3,\)"),
        (
            lambda: js.Curve("spectrum", SCALE, np.ones((2, 3)), np.ones(3)),
            ValueError,
            "one weight a sample",
        ),
        (lambda: curve(1).stderr, ValueError, "at least 2 of them; got 1"),
        (lambda: curve()[0], TypeError, "not a stack"),
        (lambda: js.concatenate([]), ValueError, "must not be empty"),
        (lambda: js.concatenate([curve(), curve().window(1, 2)]), ValueError, "share their scales"),
        (
            lambda: js.concatenate([curve(), curve(units=("nm", "1"))]),
            ValueError,
            "must share units",
        ),
    ],
)
def test_misuse(make, error, message):
    with pytest.raises(error, match=message):
        make()
