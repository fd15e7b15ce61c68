import numpy as np
import pytest

from jaxsurf.curve import Curve
from jaxsurf.fitting._resample import bootstrap_counts, pulls, resampled_means, shrunk_covariance


def weighted_curve(surfaces=6, points=4, seed=1):
    rng = np.random.default_rng(seed)
    weights = rng.integers(0, 4, size=(surfaces, points)).astype(float)
    weights[1:, 0] = 0.0  # a scale that only one surface has
    samples = np.where(weights > 0, rng.normal(size=(surfaces, points)), 0.0)
    return Curve("mean_length", np.arange(1.0, points + 1), samples, weights)


def test_counts_draw_as_many_surfaces_as_there_are():
    counts = bootstrap_counts(7, 50, 3)
    assert counts.shape == (50, 7)
    np.testing.assert_array_equal(counts.sum(1), 7)
    np.testing.assert_array_equal(counts, bootstrap_counts(7, 50, np.random.default_rng(3)))
    assert (counts != bootstrap_counts(7, 50, 4)).any()


def test_a_draw_is_the_mean_of_the_resampled_curve():
    curve = weighted_curve()
    counts = bootstrap_counts(6, 20, 0)
    means, present = resampled_means(curve, counts)
    for row, mean, there in zip(counts, means, present, strict=True):
        drawn = curve.resample(np.repeat(np.arange(6), row))
        np.testing.assert_allclose(mean, drawn.mean, rtol=1e-12)
        np.testing.assert_array_equal(there, ~drawn.missing)
    assert not present.all()  # weights of zero do leave some draws without a sample


def test_pulls_give_the_covariance_of_the_curve():
    curve = weighted_curve()
    np.testing.assert_allclose(pulls(curve).T @ pulls(curve), curve.covariance(), rtol=1e-12)


def correlated(surfaces, points=12, seed=0):
    distance = np.abs(np.subtract.outer(np.arange(points), np.arange(points)))
    exact = 0.8**distance * np.outer(1 + np.arange(points), 1 + np.arange(points))
    rng = np.random.default_rng(seed)
    samples = rng.multivariate_normal(np.zeros(points), exact, size=surfaces)
    return Curve("spectrum", np.arange(1.0, points + 1), samples), exact / surfaces


@pytest.mark.parametrize("surfaces", [3, 6, 10])
def test_covariance_from_few_surfaces_can_be_inverted(surfaces):
    shrunk, shares = shrunk_covariance(pulls(correlated(surfaces)[0]))
    plain = correlated(surfaces)[0].covariance()
    assert np.linalg.matrix_rank(plain) < 12
    eigenvalues = np.linalg.eigvalsh(shrunk)
    assert eigenvalues[0] > 1e-3 * eigenvalues[-1]
    assert 0 < shares["correlations"] <= 1


def test_shrinking_is_nearer_to_the_truth_and_ends_there():
    errors = []
    for seed in range(40):
        curve, exact = correlated(8, seed=seed)
        shrunk = shrunk_covariance(pulls(curve))[0]
        errors.append([np.linalg.norm(shrunk - exact), np.linalg.norm(curve.covariance() - exact)])
    assert np.mean(errors, 0)[0] < np.mean(errors, 0)[1]
    curve, exact = correlated(20000)
    shrunk, shares = shrunk_covariance(pulls(curve))
    # entries of a covariance from 20000 surfaces are good to 1 %, 5 standard errors
    np.testing.assert_allclose(shrunk, exact, rtol=0.05, atol=0.05 * np.abs(exact).max() / 12)
    assert max(shares.values()) < 0.01


def test_two_surfaces_have_no_covariance():
    with pytest.raises(ValueError, match="needs at least 3 of them; got 2"):
        shrunk_covariance(pulls(correlated(2)[0]))
