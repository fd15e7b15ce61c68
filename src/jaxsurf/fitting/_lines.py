r"""Many weighted straight lines at once, and what weights their points deserve.

Source: the misfit, Paule & Mandel, J. Res. Natl. Bur. Stand. 87, 377 (1982); the error from
correlated residuals, Newey & West, Econometrica 55, 703 (1987).
"""

import numpy as np
from jaxtyping import Array, Bool, Float

from jaxsurf.fitting._least_squares import solve_many

Points = Float[np.ndarray, " point"]
PADDING = 32  # points are padded to a multiple of this, so that few shapes are compiled
SMALLEST_ERROR = 1e-9  # of ln y, to divide by: rounding of float64 curves is below it


def fit_lines(
    x: Points, y: Float[np.ndarray, "draw point"], weight: Float[np.ndarray, "draw line point"]
) -> tuple[Float[np.ndarray, "draw line 2"], Bool[np.ndarray, "draw line"]]:
    """Slope and intercept of weighted lines through each draw; and which were determined."""
    draws, lines, points = weight.shape
    square = weight**2
    total = square.sum(-1, keepdims=True)
    total = total + (total == 0)
    centre = (square * x).sum(-1, keepdims=True) / total
    height = (square * y[:, None]).sum(-1, keepdims=True) / total
    pad = ((0, 0), (0, -points % PADDING))
    data = tuple(
        np.pad(np.reshape(part, (draws * lines, points)), pad)
        for part in (x - centre, y[:, None] - height, weight)
    )
    found = solve_many(_departures, np.zeros((draws * lines, 2)), data)
    level, slope = found.values.reshape(draws, lines, 2).transpose(2, 0, 1)
    determined = found.success.reshape(draws, lines) & ((weight > 0).sum(-1) >= 2)
    return np.stack([slope, height[..., 0] + level - slope * centre[..., 0]], -1), determined


def _departures(parameters: Array, data: tuple[Array, Array, Array]) -> Array:
    x, y, weight = data
    return weight * (y - parameters[0] - parameters[1] * x)


def sub_windows(x: Points) -> Float[np.ndarray, "6 point"]:
    """Masks of the whole window, its lower, middle and upper half, and all but either end quarter.

    Each holds two points at least: on a window of few points its nearest ones.
    """
    masks = []
    for low, high in ((0, 1), (0, 1 / 2), (1 / 4, 3 / 4), (1 / 2, 1), (0, 3 / 4), (1 / 4, 1)):
        share = (x - x[0]) / (x[-1] - x[0])
        inside = (share >= low - 1e-9) & (share <= high + 1e-9)
        inside[np.argsort(np.abs(share - (low + high) / 2), kind="stable")[:2]] = True
        masks.append(1.0 * inside)
    return np.stack(masks)


def misfit(x: Points, y: Points, sigma: Points) -> float:
    """The least delta that lets the points lie about a line within hypot(sigma, delta)."""
    variance, dof = 0.0, len(x) - 2
    for _ in range(50):  # Newton from below on a convex function: it cannot overshoot
        weight = 1 / (sigma**2 + variance)
        residual = y - np.polyval(np.polyfit(x, y, 1, w=np.sqrt(weight)), x)
        excess = (weight * residual**2).sum() - dof
        if excess <= 1e-9 * dof:
            break
        variance += excess / (weight**2 * residual**2).sum()
    return float(np.sqrt(variance))


def covariance_from_residuals(
    x: Points, weight: Points, residual: Points
) -> Float[np.ndarray, "2 2"]:
    """Covariance of slope and intercept from one line's residuals, neighbours correlated."""
    points = len(x)
    design = weight[:, None] * np.stack([x, np.ones_like(x)], -1)
    score = design * (weight * residual)[:, None]
    reach = max(1, points // 4)
    meat = score.T @ score
    for lag in range(1, reach + 1):
        product = score[lag:].T @ score[:-lag]
        meat += (1 - lag / (reach + 1)) * (product + product.T)
    bread = np.linalg.inv(design.T @ design)
    return bread @ meat @ bread * points / (points - 2)
