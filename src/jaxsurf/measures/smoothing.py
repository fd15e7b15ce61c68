r"""Moments of the smoothed height: is the surface still skewed when seen from further away?

$$H_b(x) = \sum_d w_b(d)\, h(x + d), \qquad \langle (H_b - \bar h)^q \rangle$$

The window w_b is a box of b x b sites, or a Gaussian of the same root mean square width,
$\sigma^2 = (b^2 - 1)/12$ along each axis, cut off at 3 sigma; either way b = 1 is the raw map. The
skewness of H_b is zero at every b if $h \to -h$ is a symmetry (Kleban's measure). Moments are taken
about the mean of the map, $\bar h$.

Array-level core: `moments`, several orders in one pass.

Source: the paper's Sec. II D, Table III.
"""

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from jaxsurf import _grid
from jaxsurf._checks import check_choice
from jaxsurf.curve import Curve
from jaxsurf.measures import _maps
from jaxsurf.measures._boxes import box_moments
from jaxsurf.measures._maps import Heights, Units
from jaxsurf.measures._ratios import ensemble_ratio
from jaxsurf.measures.patches import boxes_inside

WINDOWS = ("box", "gaussian")
CUT = 3.0  # the Gaussian window ends at so many standard deviations


@partial(jax.jit, static_argnames=("orders", "window", "boundary"))
def moments(
    heights: Float[Array, "surface x y"],
    sizes: Int[Array | np.ndarray, " scale"],
    mask: Bool[Array, "surface x y"] | None = None,
    *,
    orders: tuple[int, ...] = (2,),
    window: str = "box",
    boundary: str = "periodic",
) -> tuple[Float[Array, "order surface scale"], Float[Array, "surface scale"]]:
    """Moments of H_b about the mean of the map, and the numbers of positions behind them.

    Arguments:
        heights: maps; finite outside the mask.
        sizes: b in sites; any values without recompilation.
        mask: true on valid sites; only windows without a missing site count.
        orders: the moments q, computed in one pass.
        window: "box" or "gaussian".
        boundary: "open" uses only the windows inside the map.
    """
    smooth = _gaussian if window == "gaussian" else _box

    def at_size(one: Array, valid: Array | None, b: Array) -> tuple[Array, Array]:
        smoothed, reach = smooth(one, b)
        present = _present(valid, (one.shape[0], one.shape[1]), reach, boundary)
        if present is None:
            return jnp.stack([jnp.mean(smoothed**q) for q in orders]), jnp.asarray(
                one.size, one.dtype
            )
        smoothed = jnp.where(present, smoothed, 0)
        count = jnp.sum(present, dtype=one.dtype)
        return jnp.stack([jnp.sum(smoothed**q) for q in orders]) / jnp.maximum(count, 1), count

    def of_map(one: tuple[Array, ...]) -> tuple[Array, Array]:
        valid = one[1] if len(one) == 2 else None
        step = jax.checkpoint(lambda b: at_size(one[0], valid, b))
        return jax.lax.map(step, jnp.asarray(sizes, jnp.int32))

    if mask is None:
        maps = (heights - jnp.mean(heights, (-2, -1), keepdims=True),)
    else:
        count = jnp.maximum(jnp.sum(mask, (-2, -1), keepdims=True), 1).astype(heights.dtype)
        maps = (
            jnp.where(mask, heights - jnp.sum(heights, (-2, -1), keepdims=True) / count, 0),
            mask,
        )
    mean, count = jax.lax.map(of_map, maps)
    return jnp.moveaxis(mean, 2, 0), count


def _box(one: Float[Array, "x y"], b: Int[Array, ""]) -> tuple[Array, Array]:
    """Box averages at the first site of each box, and the side of the window."""
    return box_moments(one, None, b, 1)[0], b


def _gaussian(one: Float[Array, "x y"], b: Int[Array, ""]) -> tuple[Array, Array]:
    """Gaussian averages at the first site of each window, and the side of the window."""
    variance = (b.astype(one.dtype) ** 2 - 1) / 12
    reach = jnp.floor(CUT * jnp.sqrt(variance)).astype(jnp.int32)
    modes = jnp.fft.rfft2(one)
    for axis, side in enumerate(one.shape):
        distance = jnp.asarray(np.minimum(np.arange(side), side - np.arange(side)), jnp.int32)
        fall = jnp.exp(-(distance.astype(one.dtype) ** 2) / (2 * jnp.where(b > 1, variance, 1)))
        kernel = jnp.where(distance <= reach, fall, 0)
        factor = jnp.fft.fft(kernel / jnp.sum(kernel)).real[: modes.shape[axis]]
        modes = modes * jnp.expand_dims(factor.astype(modes.dtype), 1 - axis)
    smoothed = jnp.fft.irfft2(modes, s=(one.shape[0], one.shape[1]))
    return _maps.rolled(smoothed, reach, reach), 2 * reach + 1


def _present(
    valid: Bool[Array, "x y"] | None,
    shape: tuple[int, int],
    reach: Int[Array, ""],
    boundary: str,
) -> Bool[Array, "x y"] | None:
    """Where the window holds only sites that exist: None for everywhere."""
    present = None
    if valid is not None:
        present = box_moments(jnp.zeros(shape), valid, reach, 1)[-1]
    if boundary == "open":
        inside = boxes_inside(shape, reach)
        present = inside if present is None else present & inside
    return present


@_maps.in_their_own_dtype
def smoothed_moment(
    heights: Heights,
    sizes: Any = None,
    *,
    order: int = 2,
    window: str = "box",
    spacing: float = 1.0,
    boundary: str = "periodic",
    mask: Any = None,
    units: Units = ("sites", "1"),
) -> Curve:
    r"""Moment of the height smoothed over a window of size b.

    $$\langle (H_b - \bar h)^q \rangle, \qquad H_b(x) = \sum_d w_b(d)\, h(x + d)$$

    Arguments:
        heights: maps `[..., x, y]`, each a surface; the dtype is kept.
        sizes: b in sites, ascending, 1 <= b <= L/2; None for 1 ... L/4. Any values without
            recompilation.
        order: the moment q >= 1.
        window: "box", b x b sites; or "gaussian", of the same root mean square width.
        spacing: lattice constant; the curve's scale is in its unit.
        boundary: "periodic", or "open" for maps that do not wrap round.
        mask: true on valid sites, `[x, y]` or the shape of `heights`. Only windows without a
            missing site count.
        units: of length and of height.

    Returns:
        A `Curve` over b, in height^q, differentiable in the heights. Its weights are the numbers of
        windows averaged over; a size without any has count zero.

    Raises:
        TypeError: heights or mask of the wrong kind.
        ValueError: sizes, order, window or boundary out of range; heights not finite.

    Source: Table III.
    """
    order = _maps.check_order(order)
    maps, b, mean, count = _measured(heights, sizes, (order,), window, spacing, boundary, mask)
    return Curve(
        "smoothed_moment",
        b * float(spacing),
        mean[0],
        count,
        units=(units[0], _maps.power_of(units[1], order)),
        details=(("order", order), ("window", window), _maps.side(maps, spacing)),
    )


@_maps.in_their_own_dtype
def smoothed_skewness(
    heights: Heights,
    sizes: Any = None,
    *,
    window: str = "box",
    spacing: float = 1.0,
    boundary: str = "periodic",
    mask: Any = None,
    units: Units = ("sites", "1"),
) -> Curve:
    r"""Skewness of the smoothed height: zero if h -> -h is a symmetry.

    $$\langle (H_b - \bar h)^3 \rangle / \langle (H_b - \bar h)^2 \rangle^{3/2}$$

    Arguments:
        heights: maps `[..., x, y]`, each a surface; the dtype is kept.
        sizes: b in sites, ascending, 1 <= b <= L/2; None for 1 ... L/4.
        window: "box", b x b sites; or "gaussian", of the same root mean square width.
        spacing: lattice constant; the curve's scale is in its unit.
        boundary: "periodic", or "open" for maps that do not wrap round.
        mask: true on valid sites, `[x, y]` or the shape of `heights`.
        units: of length and of height.

    Returns:
        A `Curve` whose mean is the ratio of the ensemble's moments; its samples are jackknife
        pseudo-values (see `_ratios`), one a surface.

    Raises:
        TypeError: heights or mask of the wrong kind.
        ValueError: sizes, window or boundary out of range; heights not finite.

    Source: Table III.
    """
    maps, b, mean, count = _measured(heights, sizes, (3, 2), window, spacing, boundary, mask)
    return Curve(
        "smoothed_skewness",
        b * float(spacing),
        ensemble_ratio(mean[0], mean[1], count, 1.5),
        count,
        units=(units[0], "1"),
        details=(("window", window), _maps.side(maps, spacing)),
    )


def _measured(
    heights: Heights,
    sizes: Any,
    orders: tuple[int, ...],
    window: str,
    spacing: float,
    boundary: str,
    mask: Any,
) -> tuple[Array, Any, Array, Array]:
    """The maps, the sizes, and what `moments` makes of them."""
    maps, valid = _maps.read(heights, mask, boundary=boundary, spacing=spacing)
    check_choice("window", window, WINDOWS)
    if sizes is None:
        b = _grid.default_scales((maps.shape[-2], maps.shape[-1])).astype(np.int32)
    else:
        half = min(maps.shape[-2:]) // 2
        b = _maps.check_scales("sizes", sizes, low=1, high=half, limit="L/2")
    mean, count = moments(maps, b, valid, orders=orders, window=window, boundary=boundary)
    return maps, b, mean, count
