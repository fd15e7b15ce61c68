r"""Exponents between one size and the next, at a fixed share of the map.

If $y(x, L) = L^{p} f(x/L)$, then at any fixed $x/L$ the exponent

$$p(L_1 \to L_2) = \frac{\ln y(uL_2, L_2) - \ln y(uL_1, L_1)}{\ln L_2/L_1}$$

knows nothing of the master curve f: neither its shape nor the largest scales of the map enter.
What is left is how far p still moves from size to size, the corrections to scaling themselves. A
collapse gives one number for all sizes; these show whether it stands still.

$\ln y$ is averaged over a range of $\ln u$, with the errors of the surfaces through it.

Source: the paper's Eq. (FSSform) at constant scaled variable.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from jaxsurf.curve import Curve
from jaxsurf.fitting._resample import pulls

#: The shares u = x/L averaged over: above the lattice for L >= 64, below half the map.
SHARES = (0.05, 0.3)


@dataclass(frozen=True)
class LocalExponent:
    """The exponent between two neighbouring sizes.

    Attributes:
        sizes: the two, smaller first.
        value: p, with the sign of y's own growth.
        error: its statistical standard error; steps that share a size are anticorrelated.
    """

    sizes: tuple[float, float]
    value: float
    error: float


def local_exponents(
    curves: Mapping[int, Curve] | Mapping[float, Curve],
    *,
    shares: tuple[float | int, float | int] = SHARES,
) -> tuple[LocalExponent, ...]:
    r"""Exponents between successive sizes at fixed x/L.

    $$p = \Delta \langle \ln y(uL, L) \rangle_{\ln u} / \Delta \ln L$$

    Arguments:
        curves: {L: Curve}, sizes in the scale's unit of length.
        shares: range of u = x/L averaged over.

    Returns:
        One `LocalExponent` a pair of neighbouring sizes; e.g. D_f from `mean_length`, and -2x_l
        from `loop_correlation`.

    Raises:
        ValueError: fewer than two sizes, a range that is none, or a curve that has fewer than two
            positive points in it.

    Example:
        >>> import numpy as np
        >>> scale = np.geomspace(2.0, 64.0, 30)
        >>> curves = {
        ...     size: Curve("mean_length", scale, np.tile(scale**1.3, (4, 1)), np.ones((4, 30)),
        ...                 units=("sites", "sites"))
        ...     for size in (64, 128)
        ... }
        >>> round(local_exponents(curves)[0].value, 4)
        1.3
    """
    low, high = shares
    if not 0 < low < high:
        raise ValueError(
            f"shares must be a range 0 < low < high of x/L; got {shares}. Pass e.g. {SHARES}."
        )
    if len(curves) < 2:
        raise ValueError(
            f"local exponents need at least 2 sizes; got {sorted(curves)}. Measure another size."
        )
    sizes = sorted(float(size) for size in curves)
    by_size = {float(size): curve for size, curve in curves.items()}
    levels = [_level(by_size[size], size, (float(low), float(high))) for size in sizes]
    steps = []
    for (one, (before, of_before)), (two, (after, of_after)) in pairwise(
        zip(sizes, levels, strict=True)
    ):
        distance = np.log(two / one)
        value = (after - before) / distance
        error = np.hypot(of_before, of_after) / distance
        steps.append(LocalExponent((one, two), float(value), float(error)))
    return tuple(steps)


def _level(curve: Curve, size: float, shares: Sequence[float]) -> tuple[float, float]:
    """The mean of ln y over a range of ln(x/L), and its standard error over surfaces."""
    scale, mean = np.asarray(curve.scale, float), np.asarray(curve.mean, float)
    usable = (scale > 0) & (mean > 0)
    inside = usable & (scale >= shares[0] * size) & (scale <= shares[1] * size)
    if inside.sum() < 2:
        raise ValueError(
            f"each curve needs two positive points at x/L in {tuple(shares)}; got {inside.sum()} "
            f"for {curve.kind} at L = {size:g}. Widen shares or add surfaces."
        )
    weight = _averaging(np.log(scale[usable] / size), *np.log(shares).tolist())
    pull = pulls(curve)[:, usable] / mean[usable] @ weight
    return float(weight @ np.log(mean[usable])), float(np.sqrt((pull**2).sum()))


def _averaging(
    u: Float[np.ndarray, " point"], low: float, high: float
) -> Float[np.ndarray, " point"]:
    """Weights w such that w @ y is the mean from low to high of y interpolated linearly in u."""
    at = np.linspace(low, high, 400)
    return np.stack([np.interp(at, u, hat) for hat in np.eye(len(u))]).mean(1)
