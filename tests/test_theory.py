"""The exponents against each other: scaling relations, special values, inverses, gradients."""

import inspect

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jaxsurf import theory

ALPHAS = st.floats(-1.0, 1.99)


@given(ALPHAS)
def test_hyperscaling_and_sum_rule(alpha):
    D_f, tau, x_l = theory.loop_exponents(alpha)
    # float64 arithmetic on numbers of order one: a few units in the last place, over 3 - alpha >= 1
    np.testing.assert_allclose(D_f * (tau - 1), 2 - alpha, atol=1e-14)
    np.testing.assert_allclose(D_f * (3 - tau), 2 - 2 * x_l, atol=1e-14)


@given(ALPHAS, st.floats(0.0, 0.9))
def test_general_relations_obey_the_same_two_identities(alpha, x_l):
    D_f = theory.fractal_dimension_general(alpha, x_l)
    if abs(D_f) < 1e-3:  # tau diverges with 1/D_f; no loop has dimension zero
        return
    tau = theory.length_exponent_general(alpha, x_l)
    np.testing.assert_allclose(D_f * (tau - 1), 2 - alpha, atol=1e-11)
    np.testing.assert_allclose(D_f * (3 - tau), 2 - 2 * x_l, atol=1e-11)


@given(ALPHAS)
def test_named_combinations(alpha):
    D_f, tau, x_l = theory.loop_exponents(alpha)
    np.testing.assert_allclose(theory.length_tail_exponent(alpha), tau - 2, atol=1e-14)
    np.testing.assert_allclose(theory.radius_tail_exponent(alpha), D_f * (tau - 2), atol=1e-14)
    np.testing.assert_allclose(theory.fractal_dimension_general(alpha, 0.5), D_f, atol=1e-14)
    np.testing.assert_allclose(theory.length_exponent_general(alpha, 0.5), tau, atol=1e-14)
    # 2 (tau_ZO - 1) = D_f (tau - 1), islands being two-dimensional (Sec. IV B)
    np.testing.assert_allclose(2 * (theory.island_exponent(alpha) - 1), D_f * (tau - 1), atol=1e-13)


def test_percolation_is_the_general_relation_at_minus_three_quarters():
    percolation = theory.PERCOLATION
    # alpha = -3/4 in D_f (tau - 1) = 2 - alpha is not exact for hulls: 7/4 * 11/7 = 11/4 it is
    assert percolation.fractal_dimension * (percolation.length_exponent - 1) == pytest.approx(
        2 - (-3 / 4), abs=1e-15
    )
    assert percolation.fractal_dimension * (3 - percolation.length_exponent) == pytest.approx(
        2 - 2 * percolation.correlation_exponent - 0.0, abs=1e-15
    )
    assert theory.fractal_dimension_general(
        -3 / 4, percolation.correlation_exponent
    ) == pytest.approx(percolation.fractal_dimension, abs=1e-15)
    assert theory.length_exponent_general(
        -3 / 4, percolation.correlation_exponent
    ) == pytest.approx(percolation.length_exponent, abs=1e-15)
    # x_l is the one that differs: with 1/2 in its place D_f would not be that of percolation
    assert theory.correlation_exponent(-3 / 4) != percolation.correlation_exponent
    assert theory.fractal_dimension(-3 / 4) != pytest.approx(7 / 4, abs=0.1)


def test_tabled_values():
    # the theory columns of the paper's Table I, and the two ends where D_f is exact
    assert theory.fractal_dimension(0.0) == 1.5
    assert theory.length_tail_exponent(0.0) == pytest.approx(1 / 3, abs=1e-15)
    assert theory.length_tail_exponent(0.4) == pytest.approx(0.6 / 2.6, abs=1e-15)
    assert theory.fractal_dimension(1.0) == 1.0
    assert theory.fractal_dimension(1.0) == theory.level_set_dimension(1.0)
    assert theory.length_exponent(1.0) == 2.0
    assert theory.radius_tail_exponent(0.5) == 0.25  # Sec. V C 3
    assert theory.fractal_dimension_isichenko(0.0) == pytest.approx(10 / 7)  # and not 3/2
    assert theory.spectrum_exponent(0.4) == pytest.approx(-2.8)


@given(st.floats(-0.99, 1.99))
def test_inverses(alpha):
    assert theory.alpha_from_fractal_dimension(theory.fractal_dimension(alpha)) == pytest.approx(
        alpha, abs=1e-13
    )
    assert theory.alpha_from_length_exponent(theory.length_exponent(alpha)) == pytest.approx(
        alpha, abs=1e-12
    )
    assert theory.alpha_from_correlation(2 * alpha) == pytest.approx(alpha, abs=1e-15)


@pytest.mark.parametrize(
    ("inverse", "value"),
    [
        (theory.alpha_from_fractal_dimension, 1.35),
        (theory.alpha_from_length_exponent, 2.24),
        (theory.alpha_from_length_tail, 0.24),
        (theory.alpha_from_correlation, 0.7),
    ],
)
def test_error_propagation_is_the_derivative(inverse, value):
    slope = (inverse(value + 1e-6) - inverse(value - 1e-6)) / 2e-6
    estimate = inverse(value, stderr=0.01)
    assert estimate.value == inverse(value)
    # central differences: error of order eps^2 + 1e-16/eps = 1e-10, relative
    assert estimate.stderr == pytest.approx(abs(slope) * 0.01, rel=1e-8)


def test_the_papers_two_small_errors():
    # Table II: p = 0.3 and 0.5 quote 0.05; tau's own errors 0.02 make it larger
    for tail in (0.35, 0.36):
        assert theory.alpha_from_length_tail(tail, 0.02).stderr > 0.09


def test_scaling_forms_join_percolation():
    for alpha in (0.0, 0.4, 0.9):
        D_f, tau, x_l = theory.loop_exponents(alpha)
        forms = theory.SCALING_FORMS
        expected = {
            "mean_length": 7 / 4 - D_f,
            # P ~ s^-(tau-1) f with f ~ v^(tau - 18/7); the tail has the same power
            "length_tail": tau - 18 / 7,
            "loop_correlation": 2 * x_l - 5 / 4,
            "spectrum": 2 * (1 + alpha),
            "curvature_moment": -2 * alpha,
        }
        for kind, power in expected.items():
            assert forms[kind].crossover_power(alpha) == pytest.approx(power, abs=1e-14)
        assert forms["length_tail"].scale_dimension(alpha) == D_f


def test_arrays_and_gradients():
    alpha = jnp.array([0.0, 0.4, 1.0])
    np.testing.assert_allclose(theory.fractal_dimension(alpha), [1.5, 1.3, 1.0], rtol=1e-6)
    np.testing.assert_allclose(theory.length_exponent(np.array([0.0, 1.0])), [7 / 3, 2.0])
    gradient = jax.grad(jax.jit(theory.length_exponent))(0.4)
    # d tau / d alpha = -2 / (3 - alpha)^2, float32
    assert float(gradient) == pytest.approx(-2 / 2.6**2, rel=1e-5)


@pytest.mark.parametrize("alpha", [-1.01, 2.0, 7, np.array([0.4, 2.5])])
def test_alpha_out_of_range(alpha):
    with pytest.raises(ValueError, match=r"alpha must lie in \[-1, 2\); got"):
        theory.fractal_dimension(alpha)


def test_every_public_function_names_its_equation():
    for name in theory.__all__:
        item = getattr(theory, name)
        if inspect.isfunction(item):
            assert any(word in item.__doc__ for word in ("Eq.", "Sec.", "$", "together")), name
