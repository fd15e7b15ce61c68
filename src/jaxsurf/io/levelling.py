r"""Levelling: taking the tilt of the sample out of a map.

An image of a surface is tilted against the instrument, and a tilt of one part in a thousand
outweighs all the roughness of a good film at long scales. The plane (or the polynomial) that fits
the valid sites best is subtracted.
"""

import numpy as np
from jaxtyping import Float

from jaxsurf.io.heightmap import HeightMap


def level(surface: HeightMap, *, degree: int = 1) -> HeightMap:
    r"""Subtract the least-squares polynomial of a map.

    $$h(x, y) \to h(x, y) - \sum_{i + j \le n} c_{ij} x^i y^j$$

    Arguments:
        surface: a map; missing sites (NaN) stay missing and do not count.
        degree: n, 0 for the mean, 1 for the plane, 2 for the bow of a scanner.

    Returns:
        The levelled map, of zero mean over its valid sites.

    Raises:
        ValueError: a degree other than 0, 1, 2, 3; fewer valid sites than coefficients.

    >>> tilted = HeightMap(np.arange(24.0).reshape(4, 6))
    >>> float(abs(level(tilted).heights).max()) < 1e-12
    True
    """
    if degree not in (0, 1, 2, 3):
        raise ValueError(
            f"degree must be 0, 1, 2 or 3; got {degree!r}. "
            "Higher polynomials take the roughness out with the tilt."
        )
    terms = _polynomials(surface.heights.shape, degree)
    valid = surface.valid
    if valid.sum() < 4 * len(terms):
        raise ValueError(
            f"levelling by degree {degree} needs at least {4 * len(terms)} valid sites; got "
            f"{int(valid.sum())}. Pass a lower degree or a map with fewer missing sites."
        )
    coefficients, *_ = np.linalg.lstsq(terms[:, valid].T, surface.heights[valid], rcond=None)
    return surface.with_heights(surface.heights - np.tensordot(coefficients, terms, 1))


def _polynomials(shape: tuple[int, ...], degree: int) -> Float[np.ndarray, "term x y"]:
    """x^i y^j on [-1, 1]^2, where the normal equations are well conditioned."""
    x, y = (np.linspace(-1, 1, n) for n in shape)
    return np.stack(
        [np.multiply.outer(x**i, y**j) for i in range(degree + 1) for j in range(degree + 1 - i)]
    )
