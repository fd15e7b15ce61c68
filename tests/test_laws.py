"""Laws and their lattice expectations: against direct sums, each other, finite differences."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import jaxsurf as js
from jaxsurf import laws

LAWS = [
    js.SelfAffine(0.4),
    js.SelfAffine(1.0, 2.5),
    js.SelfAffine(0.0, 1.0, 5.0),
    js.WhiteNoise(3.0),
]
SHAPE = (16, 21)


def full_zone_sum(law, shape, kernel, spacing=1.0):
    """(1/A) sum over every mode of the full zone, one by one in float64."""
    q_x = 2 * np.pi * np.fft.fftfreq(shape[0], spacing)[:, None]
    q_y = 2 * np.pi * np.fft.fftfreq(shape[1], spacing)[None, :]
    q = np.hypot(q_x, q_y)
    q[0, 0] = 1.0
    with jax.enable_x64(True):
        density = np.array(law(q))
    density[0, 0] = 0.0
    return (density * kernel(q_x * spacing, q_y * spacing)).sum() / (
        shape[0] * shape[1] * spacing**2
    )


def window(b, q):
    return np.abs(np.exp(1j * np.multiply.outer(np.arange(b), q)).mean(0)) ** 2


@pytest.mark.parametrize("law", LAWS, ids=repr)
@pytest.mark.parametrize("spacing", [1.0, 0.25])
def test_expectations_are_the_sums_over_modes(law, spacing):
    if getattr(law, "cutoff", None) is not None:
        law = js.SelfAffine(law.alpha, law.amplitude, law.cutoff * spacing)
    # float32 sums of 336 positive terms: relative error below 336 * 6e-8 = 2e-5
    rtol = 2e-5
    total = full_zone_sum(law, SHAPE, lambda x, y: 1.0, spacing)
    np.testing.assert_allclose(laws.expected_variance(law, SHAPE, spacing=spacing), total, rtol)
    vectors = [(1, 0), (0, 3), (2, -5), (16, 21)]
    exact = [
        full_zone_sum(law, SHAPE, lambda x, y: 2 * (1 - np.cos(x * u + y * v)), spacing)  # noqa: B023
        for u, v in vectors
    ]
    found = laws.expected_height_correlation(law, SHAPE, vectors, spacing=spacing)
    np.testing.assert_allclose(found, exact, rtol, atol=1e-6 * total)
    for b in (1, 2, 5):
        for direction, offsets in laws.DIRECTIONS.items():

            def curvature(x, y):
                symbol = sum(np.exp(1j * b * (x * u + y * v)) - 1 for u, v in offsets)  # noqa: B023
                return np.abs(symbol) ** 2

            found = laws.expected_curvature_variance(law, SHAPE, [b], direction, spacing=spacing)
            np.testing.assert_allclose(found, [full_zone_sum(law, SHAPE, curvature, spacing)], rtol)
        patch = full_zone_sum(
            law,
            SHAPE,
            lambda x, y, b=b: 1 - window(b, x[:, 0])[:, None] * window(b, y[0]),
            spacing,
        )
        found = laws.expected_patch_variance(law, SHAPE, [b], spacing=spacing)
        np.testing.assert_allclose(found, [patch], rtol, atol=1e-6 * total)


@pytest.mark.parametrize("law", LAWS, ids=repr)
def test_curvature_variance_from_height_correlations(law):
    # <C^2> = 16 D2(b) - 4 D2(sqrt2 b) - 2 D2(2b) on a square map (Eq. curv2)
    for b in (1, 3):
        one, diagonal, two = laws.expected_height_correlation(
            law, (32, 32), [(b, 0), (b, b), (2 * b, 0)]
        )
        # three float32 sums that partly cancel at alpha = 1, of which one in 1e4 remains
        np.testing.assert_allclose(
            laws.expected_curvature_variance(law, (32, 32), [b])[0],
            16 * one - 4 * diagonal - 2 * two,
            rtol=2e-4,
        )


def test_patch_as_large_as_the_map_has_the_maps_variance():
    law = js.SelfAffine(0.6)
    np.testing.assert_allclose(
        laws.expected_patch_variance(law, (16, 16), [16]),
        [laws.expected_variance(law, (16, 16))],
        rtol=1e-5,  # float32
    )


def test_continuum_limit_of_the_height_correlation():
    # D2(r) = r^{2 alpha} Gamma(1-alpha) / (pi alpha 2^{2 alpha + 1} Gamma(1 + alpha)), DESIGN 2
    from math import gamma, pi

    alpha, r = 0.5, np.array([16.0, 24.0, 32.0])
    exact = (
        r ** (2 * alpha) * gamma(1 - alpha) / (pi * alpha * 2 ** (2 * alpha + 1) * gamma(1 + alpha))
    )
    found = np.asarray(laws.expected_height_correlation(js.SelfAffine(alpha), (2048, 2048), r))
    # lattice: missing |q| > pi, a constant of order 1/(4 pi) of D2(16) = 1.3; periods: (r/L) = 1 %
    np.testing.assert_allclose(np.diff(found), np.diff(exact), rtol=0.04)
    wrong = r ** (2 * alpha + 0.2) * gamma(1 - alpha) / (pi * alpha * 2 ** (2 * alpha + 1))
    assert not np.allclose(np.diff(found), np.diff(wrong), rtol=0.04)


def test_cutoff_is_flat_and_continuous():
    law = js.SelfAffine(0.4, 2.0, 16.0)
    q = np.array([1e-3, np.pi / 32, np.pi / 16, np.pi / 15.9, 1.0])
    plain = js.SelfAffine(0.4, 2.0)(q)
    found = law(q)
    np.testing.assert_allclose(found[:3], [plain[2]] * 3, rtol=1e-6)
    np.testing.assert_allclose(found[3:], plain[3:], rtol=1e-6)


@jax.jit
def all_expectations(fields):
    """One long curve of every expectation, as a function of (alpha, amplitude, cutoff)."""
    law = js.SelfAffine(fields[0], fields[1], fields[2])
    return jnp.concatenate(
        [
            laws.expected_height_correlation(law, (16, 16), [1, 5]),
            laws.expected_curvature_variance(law, (16, 16), [1, 4], "11"),
            laws.expected_patch_variance(law, (16, 16), [2, 7]),
            laws.expected_variance(law, (16, 16))[None],
        ]
    )


derivative = jax.jit(jax.jacfwd(all_expectations))


@settings(max_examples=25, deadline=None)
@given(st.floats(-0.5, 1.2), st.floats(0.5, 3.0), st.floats(2.2, 6.7))
def test_gradients_match_finite_differences(alpha, amplitude, cutoff):
    # away from pi/cutoff = |q| of a mode, where S(q) has a corner
    kinks = np.abs(np.pi / np.unique(js._grid.wave_number((16, 16))[1:]) - cutoff)
    assume(kinks.min() > 1e-3)
    with jax.enable_x64(True):
        fields = jnp.array([alpha, amplitude, cutoff])
        exact = derivative(fields)
        eps = 1e-6
        for i in range(3):
            step = eps * jnp.eye(3)[i]
            slope = (all_expectations(fields + step) - all_expectations(fields - step)) / (2 * eps)
            # central differences in float64: eps^2 + 1e-16/eps, times curves up to 1e3
            np.testing.assert_allclose(exact[:, i], slope, rtol=1e-6, atol=1e-6)


def test_gradient_is_finite_at_the_cutoff_edge():
    edge = np.pi / js._grid.wave_number((16, 16))[0, 2]  # exactly a mode's wave number
    gradient = jax.grad(lambda c: laws.expected_variance(js.SelfAffine(0.4, 1.0, c), (16, 16)))(
        edge
    )
    assert np.isfinite(gradient)
    assert gradient > 0  # a longer cutoff leaves more height


def test_vmap_over_laws():
    alphas = jnp.linspace(0.0, 1.0, 5)
    curves = jax.vmap(
        lambda a: laws.expected_curvature_variance(js.SelfAffine(a), (32, 32), [1, 2, 4])
    )(alphas)
    for alpha, row in zip(alphas, curves, strict=True):
        one = laws.expected_curvature_variance(js.SelfAffine(alpha), (32, 32), [1, 2, 4])
        np.testing.assert_allclose(row, one, rtol=1e-6)  # the same float32 sums, batched


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: js.SelfAffine(2.0), r"alpha must lie in \[-1, 2\); got 2.0. Rough"),
        (lambda: js.SelfAffine(-1.2), r"alpha must lie in \[-1, 2\); got -1.2"),
        (lambda: js.SelfAffine(float("nan")), "alpha must lie"),
        (lambda: js.SelfAffine(jnp.array([0.1, 3.0])), "alpha must lie"),
        (lambda: js.SelfAffine(0.4, 0.0), r"amplitude must lie in \(0, inf\); got 0.0"),
        (lambda: js.SelfAffine(0.4, 1.0, -3.0), "cutoff.*got -3.0. Pass cutoff=None"),
        (lambda: js.SelfAffine(0.4, 1.0, 0.0), "cutoff.*got 0.0. Pass cutoff=None"),
        (lambda: js.WhiteNoise(-1.0), "amplitude must lie"),
        (
            lambda: laws.expected_variance(js.SelfAffine(0.4, 1.0, 300.0), (512, 512)),
            r"cutoff must be positive and below L/2 = 256; got 300.0. Pass cutoff=None",
        ),
        (lambda: laws.expected_variance(js.WhiteNoise(), (3, 8)), "at least 4"),
        (lambda: laws.expected_variance(js.WhiteNoise(), (-8, 8)), "at least 4; got -8"),
        (
            lambda: laws.expected_curvature_variance(js.WhiteNoise(), (8, 8), [0]),
            r"scales must lie in \(0, inf\)",
        ),
        (
            lambda: laws.expected_curvature_variance(js.WhiteNoise(), (8, 8), [1], "12"),
            "direction must be one of",
        ),
        (
            lambda: laws.expected_patch_variance(js.WhiteNoise(), (8, 8), [9]),
            r"sizes must lie in \[1, 8\]; got \[9.0\]",
        ),
        (
            lambda: laws.expected_height_correlation(js.WhiteNoise(), (8, 8), np.ones((2, 3))),
            "separations must be lengths",
        ),
    ],
)
@pytest.mark.usefixtures("as_a_user")
def test_misuse(make, message):
    with pytest.raises(ValueError, match=message):
        make()


@pytest.mark.usefixtures("as_a_user")
def test_wrong_types():
    with pytest.raises(TypeError, match="alpha and amplitude must be numbers"):
        js.SelfAffine("0.4")
    with pytest.raises(TypeError, match="side of the grid must be an integer"):
        laws.expected_variance(js.WhiteNoise(), (8.5, 8))


def test_a_law_without_a_spectrum_cannot_be_made():
    class Nothing(laws.Law):
        pass

    with pytest.raises(TypeError, match="abstract"):
        Nothing()
