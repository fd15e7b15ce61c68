"""Gradients against finite differences, and what the measures do inside jit and vmap."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads

import jaxsurf as js
from jaxsurf.measures import curvature, differences, patches, smoothing

SCALES = np.array([1, 2, 3], np.int32)
MASK = np.random.default_rng(5).random((8, 10)) > 0.1

MEASURES = {
    "spectrum": js.power_spectrum,
    "windowed spectrum": lambda h: js.power_spectrum(h, boundary="open", mask=MASK),
    "rings": js.height_correlation,
    "open rings": lambda h: js.height_correlation(h, boundary="open", mask=MASK),
    "D_q": lambda h: js.height_correlation(h, SCALES, order=1.5),
    "curvature": lambda h: js.curvature_moment(h, SCALES, order=3, boundary="open"),
    "kurtosis": lambda h: js.curvature_ratio(h, SCALES),
    "patches": lambda h: js.patch_moment(h, SCALES, order=3, mask=MASK),
    "patch skewness": lambda h: js.patch_skewness(h, [2, 3]),
    "smoothed": lambda h: js.smoothed_moment(h, SCALES, order=3, window="gaussian"),
    "smoothed skewness": lambda h: js.smoothed_skewness(h, SCALES),
    "height skewness": lambda h: js.height_skewness(h, mask=MASK),
    "height kurtosis": js.height_kurtosis,
    "line spectrum": js.line_spectrum,
    "line variance": lambda h: js.line_variance(h, [2, 3]),
}


@pytest.mark.parametrize("name", MEASURES)
def test_gradient_in_the_heights_is_that_of_finite_differences(name):
    with jax.enable_x64(True):
        heights = jax.random.normal(jax.random.key(2), (2, 8, 10), jnp.float64)
        # central differences of smooth functions: error of order eps^2 = 1e-8 times the third
        # derivative, below 1e-6 of the gradient
        measure = jax.jit(lambda h: MEASURES[name](h).samples)
        check_grads(measure, (heights,), order=1, modes=["rev"], eps=1e-4, atol=1e-6, rtol=1e-5)


@pytest.mark.parametrize("order", [0.5, 1, 1.5, 2, 3])
def test_gradient_is_finite_where_differences_vanish(order):
    terraces = jnp.floor(jnp.arange(64.0).reshape(8, 8) / 7)
    gradient = jax.grad(lambda h: js.height_correlation(h, SCALES, order=order).samples.sum())
    assert jnp.all(jnp.isfinite(gradient(terraces)))
    flat = jax.grad(lambda h: differences.moments(h, SCALES, orders=(order,))[0].sum())
    assert jnp.all(flat(jnp.ones((1, 8, 8))) == 0)


def test_gradient_is_finite_for_ratios_of_nothing():
    """Skewness of an exact plane: every moment of the curvature is zero."""
    plane = jnp.broadcast_to(jnp.arange(8.0)[:, None], (1, 8, 8))

    def skewness(heights):
        return js.curvature_skewness(heights, SCALES, boundary="open").samples.sum()

    assert skewness(plane) == 0
    assert jnp.all(jnp.isfinite(jax.grad(skewness)(plane)))


EXPECTATIONS = {
    "D_2": lambda law: js.laws.expected_height_correlation(law, (8, 10), [1, 3]),
    "curvature": lambda law: js.laws.expected_curvature_variance(law, (8, 10), [1, 3]),
    "patches": lambda law: js.laws.expected_patch_variance(law, (8, 10), [2, 3]),
    "variance": lambda law: js.laws.expected_variance(law, (8, 10)),
}


@pytest.mark.parametrize("name", EXPECTATIONS)
def test_gradient_of_expectations_in_alpha_amplitude_and_cutoff(name):
    def expectation(alpha, amplitude, cutoff):
        return EXPECTATIONS[name](js.SelfAffine(alpha=alpha, amplitude=amplitude, cutoff=cutoff))

    with jax.enable_x64(True):
        inside = tuple(jnp.asarray(x) for x in (0.4, 1.3, 3.1))
        check_grads(expectation, inside, order=1, modes=["rev"], eps=1e-4, atol=1e-6, rtol=1e-6)
        edge = tuple(jnp.asarray(x) for x in (0.4, 1.3, 2.0))  # pi/2 is a wave number of the grid
        for gradient in jax.jacrev(expectation, argnums=(0, 1, 2))(*edge):
            assert jnp.all(jnp.isfinite(gradient))


@pytest.mark.parametrize("name", ["spectrum", "rings", "curvature", "patches", "smoothed"])
def test_vmap_and_jit_give_what_a_loop_gives(name):
    heights = jax.random.normal(jax.random.key(3), (3, 2, 8, 10))
    stack = jax.jit(jax.vmap(MEASURES[name]))(heights)
    for i in range(3):
        alone = MEASURES[name](heights[i])
        # the same sums in another order: float32 rounding
        np.testing.assert_allclose(stack[i].samples, alone.samples, rtol=2e-5, atol=1e-6)
        np.testing.assert_array_equal(stack[i].weights, alone.weights)


@pytest.mark.parametrize(
    "core",
    [
        lambda h, b: curvature.moments(h, b, orders=(2, 3)),
        lambda h, b: differences.moments(h, b, orders=(1.5,)),
        lambda h, b: patches.moments(h, b, orders=(2, 3)),
        lambda h, b: smoothing.moments(h, b, window="gaussian"),
    ],
    ids=["curvature", "differences", "patches", "smoothing"],
)
def test_other_scales_are_not_compiled_again(core):
    traces = []

    @jax.jit
    def traced(heights, scales):
        traces.append(1)
        return core(heights, scales)

    heights = jax.random.normal(jax.random.key(3), (2, 12, 12))
    first, second = traced(heights, SCALES), traced(heights, SCALES + 2)
    assert len(traces) == 1
    np.testing.assert_allclose(first[0][:, :, 2], second[0][:, :, 0], rtol=1e-6)  # both at b = 3
