r"""Moments of the heights of whole maps: is the distribution lopsided, are its tails too heavy?

$$m_q = \langle (h - \bar h)^q \rangle, \qquad \text{skewness} = m_3/m_2^{3/2}, \qquad
  \text{excess kurtosis} = m_4/m_2^2 - 3$$

The mean is over the sites of all surfaces, the mean height $\bar h$ each surface's own. Both
numbers are zero for Gaussian heights on any lattice, however few modes carry the variance, because
the moments, and not the ratios of each surface, are averaged. The skewness changes sign with the
heights and vanishes if $h \to -h$ is a symmetry; growth that is not in equilibrium breaks it, and
then $p_+$ and $1 - p_+$ of the single-step model have opposite skewness and the same kurtosis.

There is one scale, the map itself, so each is a curve of a single point at the map's smaller side;
on smaller scales see `patch_skewness`, on coarser maps `smoothed_skewness`.

Source: the paper's Secs. II and VI; M. Plischke, Z. Racz and D. Liu, Phys. Rev. B 35, 3485 (1987).
"""

from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jaxsurf.curve import Curve
from jaxsurf.measures import _maps
from jaxsurf.measures._maps import Heights, Units
from jaxsurf.measures._ratios import ensemble_ratio


def moments(
    heights: Float[Array, "surface x y"],
    mask: Bool[Array, "surface x y"] | None = None,
    *,
    orders: tuple[int, ...] = (2,),
) -> tuple[Float[Array, "order surface"], Float[Array, " surface"]]:
    """Central moments of each map, and the number of sites behind them.

    Arguments:
        heights: maps; finite outside the mask.
        mask: true on valid sites.
        orders: the moments q.
    """
    valid = jnp.ones_like(heights) if mask is None else mask.astype(heights.dtype)
    count = valid.sum((-2, -1))
    # about the first height of each map first: a mean far from zero would cost float32 its digits
    near = (heights - heights[:, :1, :1]) * valid
    mean = near.sum((-2, -1)) / count
    centred = (near - mean[:, None, None]) * valid
    return jnp.stack([(centred**q).sum((-2, -1)) / count for q in orders]), count


def height_skewness(
    heights: Heights,
    *,
    spacing: float = 1.0,
    mask: Any = None,
    units: Units = ("sites", "1"),
) -> Curve:
    r"""Skewness of the heights: zero if h -> -h is a symmetry.

    $$\langle (h - \bar h)^3 \rangle / \langle (h - \bar h)^2 \rangle^{3/2}$$

    Arguments:
        heights: maps `[..., x, y]`, each a surface; the dtype is kept. Whether they are periodic
            does not matter.
        spacing: lattice constant; the curve's scale is in its unit.
        mask: true on valid sites, `[x, y]` or the shape of `heights`.
        units: of length and of height.

    Returns:
        A `Curve` of one point, at the map's smaller side: `mean[0]` is the ratio of the ensemble's
        moments and `stderr[0]` its error over surfaces. Its samples are jackknife pseudo-values
        (see `_ratios`), one a surface. Looks at one growing surface are not independent: pool them
        with `jaxsurf.analysis.snapshots.pool_snapshots`.

    Raises:
        TypeError: heights or mask of the wrong kind.
        ValueError: heights not finite or constant.

    Source: the paper's Sec. II; Table III, measure 7 at b = 1.

    >>> import jax
    >>> heights = jax.random.exponential(jax.random.key(0), (8, 64, 64))  # exactly 2
    >>> curve = height_skewness(heights)
    >>> bool(abs(curve.mean[0] - 2) < 3 * curve.stderr[0]), bool(curve.stderr[0] < 0.05)
    (True, True)
    """
    return _standardised(heights, "height_skewness", 3, 0.0, spacing, mask, units)


def height_kurtosis(
    heights: Heights,
    *,
    spacing: float = 1.0,
    mask: Any = None,
    units: Units = ("sites", "1"),
) -> Curve:
    r"""Excess kurtosis of the heights: zero if they are Gaussian.

    $$\langle (h - \bar h)^4 \rangle / \langle (h - \bar h)^2 \rangle^2 - 3$$

    Arguments:
        heights: maps `[..., x, y]`, each a surface; the dtype is kept. Whether they are periodic
            does not matter.
        spacing: lattice constant; the curve's scale is in its unit.
        mask: true on valid sites, `[x, y]` or the shape of `heights`.
        units: of length and of height.

    Returns:
        A `Curve` of one point, as that of `height_skewness`.

    Raises:
        TypeError: heights or mask of the wrong kind.
        ValueError: heights not finite or constant.

    Source: the paper's Sec. II.
    """
    return _standardised(heights, "height_kurtosis", 4, 3.0, spacing, mask, units)


@_maps.in_their_own_dtype
def _standardised(
    heights: Heights,
    kind: str,
    order: int,
    gaussian: float,
    spacing: float,
    mask: Any,
    units: Units,
) -> Curve:
    """m_order / m_2^(order/2) less its value for Gaussian heights."""
    maps, valid = _maps.read(heights, mask, spacing=spacing)
    found, count = moments(maps, valid, orders=(order, 2))
    ratio = ensemble_ratio(found[0, :, None], found[1, :, None], count[:, None], order / 2)
    side = _maps.side(maps, spacing)
    return Curve(
        kind,
        jnp.asarray([side[1]], maps.dtype),
        ratio - gaussian,
        count[:, None],
        units=(units[0], "1"),
        details=(side,),
    )
