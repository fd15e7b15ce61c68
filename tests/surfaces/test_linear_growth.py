"""Linear growth: the exact spectrum at every time, its limits, then misuse."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxsurf as js
from jaxsurf import _grid

GROW = partial(js.grow_linear, (32, 24), key=jax.random.key(3))
Z = {"edwards-wilkinson": 2.0, "mullins-herring": 4.0}


def mode_density(heights, spacing):
    """S of every mode, [surface, x, half]."""
    h = np.asarray(heights, float)
    area = h.shape[-2] * h.shape[-1] * spacing**2
    return np.abs(np.fft.rfft2(h) * spacing**2) ** 2 / area


def test_spectrum_limits():
    q = jnp.array([0.1, 1.0, 3.0])
    for z in (2.0, 4.0):
        early = js.LinearGrowth(1e-6, z, 0.5, 3.0)
        np.testing.assert_allclose(early(q), 2 * 3.0 * 1e-6, rtol=1e-3)  # random deposition, 2 D t
        late = js.LinearGrowth(np.inf, z, 0.5, 3.0)
        np.testing.assert_allclose(late(q), 3.0 / (0.5 * q**z), rtol=1e-5)
        assert late.alpha == (z - 2) / 2
    law = js.LinearGrowth(8.0, 4.0, 2.0)
    assert law.correlation_length == pytest.approx(32**0.25)
    # at q = 1/xi the exponent is -1: S = (1 - 1/e) of the stationary value
    at_knee = law(1 / law.correlation_length) / js.LinearGrowth(np.inf, 4.0, 2.0)(
        1 / law.correlation_length
    )
    assert float(at_knee) == pytest.approx(1 - np.exp(-1), rel=1e-5)


@pytest.mark.parametrize("equation", list(Z))
def test_every_mode_has_the_exact_variance_at_every_time(equation):
    surfaces, spacing, nu, noise, times = 400, 0.5, 0.05, 2.0, [0.3, 1.0, 7.0]
    grown = GROW(
        equation=equation,
        time=7.0,
        batch=surfaces,
        snapshots=times,
        coefficient=nu,
        noise=noise,
        spacing=spacing,
    )
    assert grown.shape == (3, surfaces, 32, 24)
    q = _grid.wave_number((32, 24), spacing)
    for time, heights in zip(times, grown, strict=True):
        density = mode_density(heights, spacing)
        assert np.abs(density[:, 0, 0]).max() < 1e-6  # the mean height stays zero
        law = js.LinearGrowth(time, Z[equation], nu, noise)
        expected = np.asarray(law(jnp.asarray(np.where(q > 0, q, 1.0))))
        ratio = (density.mean(0) / expected).ravel()[1:]
        # a mode is exponentially distributed, so each ratio has error 1/sqrt(surfaces), self-
        # conjugate modes sqrt(2) of it; the mean over the modes has it / sqrt(modes)
        assert abs(ratio.mean() - 1) < 5 / np.sqrt(surfaces * ratio.size)
        assert np.abs(ratio - 1).max() < 6 * np.sqrt(2 / surfaces)
        wrong = np.asarray(js.LinearGrowth(1.2 * time, Z[equation], nu, noise)(jnp.asarray(q[1:])))
        off = (density.mean(0)[1:] / wrong).ravel()
        changed = np.abs(wrong / expected[1:] - 1).ravel() > 0.05
        if changed.sum() > 20:  # the control: a time off by 20 % shows where modes still grow
            assert abs(off[changed].mean() - 1) > 5 / np.sqrt(surfaces * changed.sum())


def test_snapshots_belong_to_one_course_of_growth():
    # Slow modes at t = 2 remember t = 1: correlation e^{-nu q^2} sqrt(S(1)/S(2)), from the OU law.
    surfaces = 600
    early, late = GROW(equation="edwards-wilkinson", time=2.0, snapshots=[1.0, 2.0], batch=surfaces)
    first, second = (np.fft.rfft2(np.asarray(h, float))[:, 1, 0] for h in (early, late))
    q = 2 * np.pi / 32
    spectrum = [1 - np.exp(-2 * q**2 * t) for t in (1.0, 2.0)]
    expected = np.exp(-(q**2)) * np.sqrt(spectrum[0] / spectrum[1])
    measured = np.mean(first * second.conj()).real / np.sqrt(
        np.mean(np.abs(first) ** 2) * np.mean(np.abs(second) ** 2)
    )
    # 5 errors of a correlation coefficient of complex pairs, (1 - rho^2)/sqrt(2 n)
    error = (1 - expected**2) / np.sqrt(2 * surfaces)
    assert abs(measured - expected) < 5 * error
    assert abs(measured) > 5 / np.sqrt(surfaces)  # the control: not independent draws


def test_a_surface_is_the_same_whatever_the_batch():
    grow = partial(GROW, equation="mullins-herring", time=3.0)
    np.testing.assert_array_equal(grow(batch=3)[:2], grow(batch=2))
    np.testing.assert_array_equal(grow(batch=2)[0], grow())
    assert not np.array_equal(grow(batch=2)[0], grow(batch=2)[1])


def test_law_samples_and_has_gradients():
    def variance(t):
        return js.laws.expected_variance(js.LinearGrowth(t), (16, 16))

    with jax.enable_x64(True):
        # central differences of a smooth function: relative error of order 1e-8
        step = 1e-4
        slope = (variance(3.0 + step) - variance(3.0 - step)) / (2 * step)
        assert float(jax.grad(variance)(3.0)) == pytest.approx(float(slope), rel=1e-6)
    heights = js.sample(js.LinearGrowth(3.0), (16, 16), key=jax.random.key(0), batch=2000)
    samples = np.asarray(heights).var((1, 2))
    error = samples.std() / np.sqrt(len(samples))
    assert abs(samples.mean() - float(variance(3.0))) < 4.5 * error
    assert abs(samples.mean() - float(variance(4.5))) > 4.5 * error  # the control


GOOD = {"shape": (8, 8), "equation": "edwards-wilkinson", "time": 2.0, "key": jax.random.key(0)}


@pytest.mark.usefixtures("as_a_user")
@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"equation": "kpz"}, ValueError, "equation must be one of .* got 'kpz'"),
        ({"time": 0.0}, ValueError, r"time must lie in \(0, inf\); got 0.0"),
        ({"noise": -1.0}, ValueError, r"noise must lie in \(0, inf\); got -1.0"),
        ({"shape": (8, 3)}, ValueError, "must be at least 4; got 3"),
        ({"batch": 0}, ValueError, "batch must be at least 1; got 0"),
        ({"snapshots": [1.0, 3.0]}, ValueError, "within the run, 0 to 2; got"),
        ({"snapshots": [0.0, 1.0]}, ValueError, "Leave out time 0"),
        ({"snapshots": [1.0, 0.5]}, ValueError, "must be ascending"),
        ({"key": 0}, TypeError, "key must be a typed JAX key; got 0"),
    ],
)
def test_misuse_says_value_rule_and_remedy(change, error, message):
    with pytest.raises(error, match=message):
        js.grow_linear(**(GOOD | change))


@pytest.mark.usefixtures("as_a_user")
def test_law_refuses_times_before_the_start():
    with pytest.raises(ValueError, match=r"time must lie in \(0, inf\]; got -1.0"):
        js.LinearGrowth(-1.0)
