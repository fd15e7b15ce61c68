"""Gaussian surfaces: reproducible, of the right spectrum, and refusing what makes no sense."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxsurf as js
from jaxsurf._grid import mode_multiplicity, wave_number

KEY = jax.random.key(20)


def measured_spectrum(h, spacing=1.0):
    area = h.shape[-1] * h.shape[-2] * spacing**2
    return np.abs(np.fft.rfft2(np.asarray(h, float)) * spacing**2) ** 2 / area


@pytest.mark.parametrize(("side_x", "side_y"), [(4, 4), (5, 4), (4, 7), (13, 12), (9, 9)])
def test_exact_spectrum_is_met_mode_by_mode(side_x, side_y):
    h = js.sample(js.SelfAffine(0.3, 2.0), (side_x, side_y), key=KEY, spectrum="exact", spacing=0.5)
    q = wave_number((side_x, side_y), 0.5)
    q[0, 0] = 1.0
    expected = 2.0 * q**-2.6
    expected[0, 0] = 0.0
    # float32 transforms of at most 169 heights
    np.testing.assert_allclose(measured_spectrum(h, 0.5), expected, rtol=1e-4, atol=1e-9)


@pytest.mark.parametrize("shape", [(16, 16), (15, 18), (16, 13), (9, 9)])
def test_expected_spectrum_and_its_scatter(shape):
    n = 4000
    h = js.sample(js.SelfAffine(0.4), shape, key=KEY, batch=n)
    spectrum = measured_spectrum(h)
    q = wave_number(shape)
    q[0, 0] = 1.0
    ratio = spectrum / q**-2.8
    assert np.abs(ratio[:, 0, 0]).max() < 1e-9  # float32 zero squared
    # |h|^2 of a mode is exponential (variance 1); of its own mirror image chi^2_1 (variance 2)
    own = (np.arange(shape[0]) * 2 % shape[0] == 0)[:, None] & (
        np.arange(shape[1] // 2 + 1) * 2 % shape[1] == 0
    )
    variance = np.where(own, 2.0, 1.0)
    pull = (ratio.mean(0) - 1) / np.sqrt(variance / n)
    # about 150 modes, 5 standard errors: 1 in 10^4 by chance under this fixed key
    assert np.abs(pull.ravel()[1:]).max() < 5
    # variance of an estimated variance: (kurtosis - 1)/n, 8/n for exponential, 14/n for chi^2_1
    scatter = ratio.var(0, ddof=1) / variance
    assert np.abs((scatter.ravel()[1:] - 1) / np.sqrt(14 / n)).max() < 5
    # the control: alpha off by 0.05 moves the longest waves by q^-0.1
    wrong = spectrum / q**-2.9
    pulls = (wrong.mean(0) - 1) / np.sqrt(variance / n)
    assert np.abs(pulls.ravel()[1:]).max() > 5


@pytest.mark.parametrize(
    "law", [js.SelfAffine(0.0), js.SelfAffine(0.4, 2.0, 10.0), js.SelfAffine(1.0), js.WhiteNoise()]
)
def test_variance_and_correlations_agree_with_the_exact_expectations(law):
    shape, n = (48, 40), 400
    h = np.asarray(js.sample(law, shape, key=KEY, batch=n), float)
    lags = [1, 2, 5, 11, 20]
    samples = np.stack([((np.roll(h, r, 1) - h) ** 2).mean((1, 2)) for r in lags], 1)

    def pulls(law):
        exact = np.asarray(js.laws.expected_height_correlation(law, shape, [(r, 0) for r in lags]))
        return (samples.mean(0) - exact) / (samples.std(0, ddof=1) / np.sqrt(n))

    assert np.abs(pulls(law)).max() < 5
    if isinstance(law, js.SelfAffine):  # the control
        off = js.SelfAffine(law.alpha + 0.05, law.amplitude, law.cutoff)
        assert np.abs(pulls(off)).max() > 5


def test_heights_are_gaussian_and_independent_between_surfaces():
    h = np.asarray(js.sample(js.WhiteNoise(), (32, 32), key=KEY, batch=200)).reshape(200, -1)
    skewness, kurtosis = (h**3).mean(), (h**4).mean()
    n = h.size
    assert abs(skewness) < 5 * np.sqrt(15 / n)
    assert abs(kurtosis - 3 * (h**2).mean() ** 2) < 5 * np.sqrt(96 / n)
    cross = (h[:-1] * h[1:]).mean()
    assert abs(cross) < 5 / np.sqrt(n)


def test_same_key_same_surface_whatever_the_batch():
    law = js.SelfAffine(0.5)
    few = js.sample(law, (16, 12), key=KEY, batch=3)
    many = js.sample(law, (16, 12), key=KEY, batch=7)
    np.testing.assert_array_equal(few, many[:3])
    np.testing.assert_array_equal(js.sample(law, (16, 12), key=jax.random.fold_in(KEY, 2)), many[2])
    assert not np.allclose(many[0], many[1])


def test_vmap_over_alpha_and_keys_gives_the_same_surfaces_as_a_loop():
    alphas, keys = jnp.array([0.0, 0.4, 1.0]), jax.random.split(KEY, 3)

    def draw(alpha, key):
        return js.sample(js.SelfAffine(alpha), (16, 15), key=key, batch=2)

    together = jax.vmap(draw)(alphas, keys)
    for i in range(3):
        alone = draw(alphas[i], keys[i])
        # the same float32 operations, possibly in another order inside the batched transform
        np.testing.assert_allclose(together[i], alone, rtol=1e-5, atol=1e-5)


def test_gradient_with_respect_to_the_law():
    with jax.enable_x64(True):

        def roughness(alpha):
            h = js.sample(js.SelfAffine(alpha, 1.0, 3.0), (8, 9), key=KEY, dtype="float64")
            return (h**4).sum()

        slope = (roughness(0.4 + 1e-6) - roughness(0.4 - 1e-6)) / 2e-6
        np.testing.assert_allclose(jax.grad(roughness)(0.4), slope, rtol=1e-6)


def test_dtype_is_as_asked_whatever_the_global_setting():
    law = js.SelfAffine(0.5)
    assert js.sample(law, (8, 8), key=KEY).dtype == jnp.float32
    double = js.sample(law, (8, 8), key=KEY, dtype=jnp.float64, batch=2)
    assert double.dtype == np.float64
    assert np.abs(np.asarray(double) - np.asarray(double).astype(np.float32)).max() > 0
    assert jnp.zeros(()).dtype == jnp.float32  # and the setting is untouched
    with jax.enable_x64(True):
        assert js.sample(law, (8, 8), key=KEY).dtype == np.float64
        assert js.sample(law, (8, 8), key=KEY, dtype="float32").dtype == np.float32


def test_values_do_not_recompile():
    from jaxsurf.surfaces.gaussian import _draw

    js.sample(js.SelfAffine(0.11, 1.0, 3.0), (8, 10), key=KEY)
    before = _draw._cache_size()
    js.sample(js.SelfAffine(0.77, 2.0, 2.0), (8, 10), key=jax.random.key(1))
    assert _draw._cache_size() == before


def test_mode_multiplicity_counts_the_full_zone():
    for shape in ((8, 8), (7, 9), (5, 12)):
        assert mode_multiplicity(shape).sum() * shape[0] == shape[0] * shape[1]


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"key": jax.random.PRNGKey(0)}, TypeError, "key must be a typed JAX key; got an array of"),
        ({"key": 3}, TypeError, r"Make one by jax.random.key\(0\)"),
        ({"law": 0.4}, TypeError, "law must be a spectral law; got 0.4"),
        ({"shape": (16,)}, ValueError, "shape must be two side lengths"),
        ({"shape": (16, 3)}, ValueError, "at least 4; got 3"),
        ({"shape": (-16, 16)}, ValueError, "at least 4; got -16"),
        ({"shape": (16.0, 16)}, TypeError, "must be an integer; got 16.0"),
        ({"batch": 0}, ValueError, "batch must be at least 1; got 0"),
        ({"spacing": 0.0}, ValueError, r"spacing must lie in \(0, inf\); got 0.0"),
        ({"spectrum": "random"}, ValueError, r"spectrum must be one of \['exact', 'expected'\]"),
        ({"dtype": "int32"}, ValueError, "dtype must be float32 or float64; got 'int32'"),
        (
            {"law": js.SelfAffine(0.4, 1.0, 8.0)},
            ValueError,
            "cutoff must be positive and below L/2 = 8; got 8.0. Pass cutoff=None",
        ),
    ],
)
@pytest.mark.usefixtures("as_a_user")
def test_misuse(change, error, message):
    arguments = {"law": js.SelfAffine(0.4), "shape": (16, 16), "key": KEY} | change
    law, shape = arguments.pop("law"), arguments.pop("shape")
    with pytest.raises(error, match=message):
        js.sample(law, shape, **arguments)
