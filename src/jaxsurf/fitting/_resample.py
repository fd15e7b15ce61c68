r"""Errors over surfaces: the bootstrap, and covariances from few surfaces.

Surfaces are the independent things, points of one curve are not. So a bootstrap draw takes whole
surfaces, with repeats, and a weighted mean is resampled as the ratio it is,
$\sum_i n_i w_i y_i / \sum_i n_i w_i$ with $n_i$ the times that surface $i$ was drawn.

A covariance matrix from fewer surfaces than points cannot be inverted; it is shrunk, its variances
towards their median and its correlations towards zero, each by the share that minimises the
expected squared error.

Source: Schaefer & Strimmer, Stat. Appl. Genet. Mol. Biol. 4, 32 (2005); Opgen-Rhein & Strimmer,
ibid. 6, 9 (2007).
"""

import numpy as np
from jaxtyping import Bool, Float, Int

from jaxsurf.curve import Curve

Matrix = Float[np.ndarray, "point point"]


def bootstrap_counts(
    surfaces: int, draws: int, rng: np.random.Generator | int
) -> Int[np.ndarray, "draw surface"]:
    """How often each surface occurs in each bootstrap draw; every row sums to `surfaces`."""
    share = np.full(surfaces, 1.0 / surfaces)
    return np.random.default_rng(rng).multinomial(surfaces, share, size=draws)


def resampled_means(
    curve: Curve, counts: Int[np.ndarray, "draw surface"]
) -> tuple[Float[np.ndarray, "draw scale"], Bool[np.ndarray, "draw scale"]]:
    """The weighted mean of each draw, and where the draw has a sample at all.

    Arguments:
        curve: one curve (no stack axis).
        counts: from `bootstrap_counts`; curves from the same surfaces must share it, so that their
            draws go together.

    Returns:
        Means, zero where there is no sample, and the mask of those that exist.
    """
    samples, weights = np.asarray(curve.samples, float), np.asarray(curve.weights, float)
    total = counts @ weights
    present = total > 0
    return np.divide(counts @ (weights * samples), total, where=present, out=total * 0.0), present


def pulls(curve: Curve) -> Float[np.ndarray, "surface scale"]:
    """Each surface's share in the error of the mean: their sums of products are its covariance."""
    samples, weights = np.asarray(curve.samples, float), np.asarray(curve.weights, float)
    total = weights.sum(0)
    total = total + (total == 0)
    mean = (weights * samples).sum(0) / total
    surfaces = len(samples)
    return weights * (samples - mean) / total * np.sqrt(surfaces / max(surfaces - 1, 1))


def shrunk_covariance(
    pull: Float[np.ndarray, "surface point"],
) -> tuple[Matrix, dict[str, float]]:
    """The covariance of means, from each surface's share in their errors, fit to be inverted.

    Arguments:
        pull: as from `pulls`, divided by the mean for the covariance of logarithms; columns of
            several curves side by side for the covariance between measures.

    Returns:
        The covariance, and the shares shrunk: "variances" towards their median, "correlations"
        towards zero; 0 is the plain estimate, 1 the target alone.

    Raises:
        ValueError: fewer than three surfaces.
    """
    surfaces, points = pull.shape
    if surfaces < 3:
        raise ValueError(
            f"a covariance over surfaces needs at least 3 of them; got {surfaces}. "
            "Measure more surfaces, or cut the map into parts."
        )
    pull = pull * np.sqrt((surfaces - 1) / surfaces)
    variance = surfaces / (surfaces - 1) * (pull**2).sum(0)
    noise = surfaces / (surfaces - 1) ** 3 * ((surfaces * pull**2 - (pull**2).sum(0)) ** 2).sum(0)
    variances = _share(noise.sum(), ((variance - np.median(variance)) ** 2).sum())
    sigma = np.sqrt(variances * np.median(variance) + (1 - variances) * variance)

    scaled = pull / np.sqrt((pull**2).sum(0).clip(min=np.finfo(float).tiny)) * np.sqrt(surfaces)
    correlation = scaled.T @ scaled / surfaces
    products = (scaled**2).T @ scaled**2 / surfaces - correlation**2
    off = ~np.eye(points, dtype=bool)
    correlations = _share(products[off].sum() / (surfaces - 1), (correlation[off] ** 2).sum())
    shrunk = (1 - correlations) * correlation
    np.fill_diagonal(shrunk, 1.0)
    shares = {"variances": variances, "correlations": correlations}
    return shrunk * np.outer(sigma, sigma), shares


def _share(noise: float, spread: float) -> float:
    """The shrinkage that minimises the expected squared error, between 0 and 1."""
    return float(min(1.0, noise / spread)) if spread > 0 else 1.0
