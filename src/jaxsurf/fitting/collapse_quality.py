r"""How good a collapse is: Houdayer and Hartmann's S.

$$S = \frac{1}{N} \sum_{ij} \frac{(y_{ij} - Y_{ij})^2}{dy_{ij}^2 + dY_{ij}^2}$$

$Y_{ij}$ is where the other sizes put the master curve at the place of point j of size i: a straight
line through the two points of each other size that enclose it. A good collapse has S near 1, less
where points of one curve are strongly correlated; it needs no model of the master curve.

Source: Houdayer & Hartmann, Phys. Rev. B 70, 014418 (2004), Eqs. (B1)-(B5).
"""

import numpy as np
from jaxtyping import Float, Shaped


def houdayer_hartmann(
    X: Float[np.ndarray, " point"],  # noqa: N803
    Y: Float[np.ndarray, " point"],  # noqa: N803
    error: Float[np.ndarray, " point"],
    size: Shaped[np.ndarray, " point"],
) -> float:
    """The quality S of scaled points; NaN-free, infinite if no two sizes overlap.

    Arguments:
        X: scaled abscissae (any monotonic coordinate; logarithms for power laws).
        Y: scaled ordinates, in the same kind of coordinate.
        error: standard errors of Y.
        size: which size each point belongs to.

    Returns:
        S, the mean over the points that some other size encloses.
    """
    curves = {value: np.flatnonzero(size == value) for value in np.unique(size)}
    curves = {value: rows[np.argsort(X[rows])] for value, rows in curves.items()}
    terms = []
    for point in range(len(X)):
        near: list[int] = []
        for value, rows in curves.items():
            if value == size[point] or not X[rows[0]] <= X[point] <= X[rows[-1]]:
                continue
            right = int(np.clip(np.searchsorted(X[rows], X[point]), 1, len(rows) - 1))
            near += [rows[right - 1], rows[right]]
        if not near:
            continue
        weight = 1 / error[near] ** 2
        total, mean_X = weight.sum(), np.average(X[near], weights=weight)
        spread = (weight * (X[near] - mean_X) ** 2).sum()
        slope = (weight * (X[near] - mean_X) * Y[near]).sum() / spread
        away = X[point] - mean_X
        master = np.average(Y[near], weights=weight) + slope * away
        variance = 1 / total + away**2 / spread
        terms.append((Y[point] - master) ** 2 / (error[point] ** 2 + variance))
    return float(np.mean(terms)) if terms else float("inf")
