"""One exponent for Gaussian surfaces, more than one for domains with sharp walls."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxsurf as js

ORDERS = (0.5, 1, 2, 3)


@pytest.fixture(scope="module")
def gaussian():
    return js.sample(js.SelfAffine(alpha=0.5), (64, 64), key=jax.random.key(4), batch=60)


@pytest.mark.parametrize("measure", ["differences", "curvature"])
def test_gaussian_surface_has_one_exponent(gaussian, measure):
    found = js.generalised_exponents(gaussian, ORDERS, measure=measure)
    assert not found.multiaffine(0.001)
    # D_q = c_q D_2^(q/2): the exponents agree with q/2 times that of D_2 within their errors
    pull = (found.exponents - np.array(ORDERS) / 2 * found.exponents[2]) / found.stderr
    assert np.all(abs(pull) < 5)
    law = js.SelfAffine(alpha=0.5)
    b = np.array([2, 3, 4, 5, 6, 8])
    expectation = {
        "differences": js.laws.expected_height_correlation,
        "curvature": js.laws.expected_curvature_variance,
    }[measure](law, (64, 64), b)
    exact = np.polyfit(np.log(b), np.log(expectation), 1)[0]
    assert abs(found.exponents[2] - exact) < 5 * found.stderr[2]
    assert abs(found.exponents[2] - exact - 0.1) > 5 * found.stderr[2]  # the control


def test_false_alarms_are_as_rare_as_the_level_says():
    """p-values of self-affine ensembles are uniform: 40 draws, each of 16 surfaces."""
    heights = js.sample(js.SelfAffine(alpha=0.5), (32, 32), key=jax.random.key(9), batch=640)
    p = [
        js.generalised_exponents(part, (1, 2, 3)).p_value
        for part in heights.reshape(40, 16, 32, 32)
    ]
    # binomial: 40 draws at 0.5 are 20 +- 3.2 (5 sigma allowed); at 0.01, 5 or more is 1 in 20,000
    assert 4 < np.sum(np.array(p) < 0.5) < 36
    assert np.sum(np.array(p) < 0.01) < 5


def test_domains_with_walls_are_multiaffine(gaussian):
    """Between flat domains D_q counts walls, proportional to r for every q: alpha_q = 1."""
    smooth = js.sample(
        js.SelfAffine(alpha=1.9, cutoff=24.0), (64, 64), key=jax.random.key(6), batch=60
    )
    found = js.generalised_exponents(jnp.sign(smooth), ORDERS, window=(2, 6))
    assert found.multiaffine(1e-6)
    np.testing.assert_allclose(found.exponents, found.exponents[0], rtol=1e-4)  # |2|^q cancels
    assert "alpha_q" in repr(found)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"orders": (2,)}, "orders must be two or more, ascending"),
        ({"orders": (2, 1)}, "orders must be two or more, ascending"),
        ({"orders": (0, 1)}, r"orders must lie in \(0, inf\)"),
        ({"measure": "spectrum"}, "measure must be one of"),
        ({"window": (5, 5)}, "at least 3 scales"),
        ({"orders": tuple(range(1, 60))}, "needs at least 61 surfaces"),
    ],
)
def test_misuse(gaussian, change, message):
    with pytest.raises(ValueError, match=message):
        js.generalised_exponents(gaussian, **change)
