r"""Moments of the heights inside b x b patches: how rough is the surface at most b across?

$$m_q(b) = \langle \overline{(h - \bar h_b)^q} \rangle$$

The inner mean is over one patch, about the patch's own mean $\bar h_b$; the outer one over all
positions of the patch, not over a few tiles. The variance of a self-affine surface grows as
$m_2 \sim b^{2\alpha}$; the third moment as $b^{3\alpha}$ unless $h \to -h$ is a symmetry, when it
vanishes; the skewness $m_3/m_2^{3/2}$ has no dimension.

Array-level core: `moments`, several orders in one pass.

Source: the paper's Sec. II B, Eq. (roughness-var); Table III.
"""

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from jaxsurf import _grid
from jaxsurf.curve import Curve
from jaxsurf.measures import _maps
from jaxsurf.measures._boxes import box_moments
from jaxsurf.measures._maps import Heights, Units
from jaxsurf.measures._ratios import ensemble_ratio


@partial(jax.jit, static_argnames=("orders", "boundary"))
def moments(
    heights: Float[Array, "surface x y"],
    sizes: Int[Array | np.ndarray, " scale"],
    mask: Bool[Array, "surface x y"] | None = None,
    *,
    orders: tuple[int, ...] = (2,),
    boundary: str = "periodic",
) -> tuple[Float[Array, "order surface scale"], Float[Array, "surface scale"]]:
    """Central moments in patches, averaged over positions, and the numbers of positions.

    Arguments:
        heights: maps; finite outside the mask.
        sizes: sides b of the patches in sites; any values without recompilation.
        mask: true on valid sites; only patches without a missing site count.
        orders: the moments q >= 2, computed in one pass.
        boundary: "open" uses only the patches inside the map.
    """

    def at_size(one: Array, valid: Array | None, b: Array) -> tuple[Array, Array]:
        fields = box_moments(one, valid, b, max(orders))
        wanted = jnp.stack([jnp.mean(fields[q - 1]) for q in orders])
        if valid is None and boundary == "periodic":
            return wanted, jnp.asarray(one.size, one.dtype)
        inside = jnp.ones(one.shape, bool) if valid is None else fields[-1]
        if boundary == "open":
            inside = inside & boxes_inside((one.shape[0], one.shape[1]), b)
        count = jnp.sum(inside, dtype=one.dtype)
        total = jnp.stack([jnp.sum(jnp.where(inside, fields[q - 1], 0)) for q in orders])
        return total / jnp.maximum(count, 1), count

    def of_map(one: tuple[Array, ...]) -> tuple[Array, Array]:
        valid = one[1] if len(one) == 2 else None
        step = jax.checkpoint(lambda b: at_size(one[0], valid, b))
        return jax.lax.map(step, jnp.asarray(sizes, jnp.int32))

    mean, count = jax.lax.map(of_map, (heights,) if mask is None else (heights, mask))
    return jnp.moveaxis(mean, 2, 0), count


def boxes_inside(shape: tuple[int, int], b: Int[Array, ""]) -> Bool[Array, "x y"]:
    """Whether the box [x, x + b) x [y, y + b) lies on the map."""
    x, y = (jnp.arange(side, dtype=jnp.int32) <= side - b for side in shape)
    return x[:, None] & y[None, :]


@_maps.in_their_own_dtype
def patch_moment(
    heights: Heights,
    sizes: Any = None,
    *,
    order: int = 2,
    spacing: float = 1.0,
    boundary: str = "periodic",
    mask: Any = None,
    units: Units = ("sites", "1"),
) -> Curve:
    r"""Central moment of the heights in b x b patches, averaged over all positions.

    $$m_q(b) = \langle \overline{(h - \bar h_b)^q} \rangle \sim b^{q\alpha}$$

    Arguments:
        heights: maps `[..., x, y]`, each a surface; the dtype is kept.
        sizes: sides b in sites, ascending, 1 <= b <= L; None for 2 ... L/4. Any values without
            recompilation. In a patch of one site every moment is zero.
        order: the moment q >= 2; 2 is the variance (divided by b^2, not b^2 - 1).
        spacing: lattice constant; the curve's scale is in its unit.
        boundary: "periodic", or "open" for maps that do not wrap round.
        mask: true on valid sites, `[x, y]` or the shape of `heights`. Only patches without a
            missing site count.
        units: of length and of height.

    Returns:
        A `Curve` over b, in height^q, differentiable in the heights. Its weights are the numbers of
        positions averaged over; a size without any has count zero.

    Raises:
        TypeError: heights or mask of the wrong kind.
        ValueError: sizes, order or boundary out of range; heights not finite.

    Source: Eq. (roughness-var), Table III.

    >>> import jax
    >>> heights = jax.random.normal(jax.random.key(0), (4, 64, 64))
    >>> patch_moment(heights, [2, 4, 8])
    Curve('patch_moment', order=2, side=64.0: 4 surfaces x 3 scales 2...8 sites)
    """
    order = _maps.check_order(order, low=2)
    maps, valid = _maps.read(heights, mask, boundary=boundary, spacing=spacing)
    b = _sizes(sizes, maps.shape)
    mean, count = moments(maps, b, valid, orders=(order,), boundary=boundary)
    return Curve(
        "patch_moment",
        b * float(spacing),
        mean[0],
        count,
        units=(units[0], _maps.power_of(units[1], order)),
        details=(("order", order), _maps.side(maps, spacing)),
    )


@_maps.in_their_own_dtype
def patch_skewness(
    heights: Heights,
    sizes: Any = None,
    *,
    spacing: float = 1.0,
    boundary: str = "periodic",
    mask: Any = None,
    units: Units = ("sites", "1"),
) -> Curve:
    r"""Skewness of the heights in b x b patches: zero if h -> -h is a symmetry.

    $$m_3(b) / m_2(b)^{3/2}$$

    Arguments:
        heights: maps `[..., x, y]`, each a surface; the dtype is kept.
        sizes: sides b in sites, ascending, 2 <= b <= L; None for 2 ... L/4.
        spacing: lattice constant; the curve's scale is in its unit.
        boundary: "periodic", or "open" for maps that do not wrap round.
        mask: true on valid sites, `[x, y]` or the shape of `heights`.
        units: of length and of height.

    Returns:
        A `Curve` whose mean is the ratio of the ensemble's moments; its samples are jackknife
        pseudo-values (see `_ratios`), one a surface.

    Raises:
        TypeError: heights or mask of the wrong kind.
        ValueError: sizes or boundary out of range; heights not finite.

    Source: Table III.
    """
    maps, valid = _maps.read(heights, mask, boundary=boundary, spacing=spacing)
    b = _sizes(sizes, maps.shape, low=2)
    mean, count = moments(maps, b, valid, orders=(3, 2), boundary=boundary)
    return Curve(
        "patch_skewness",
        b * float(spacing),
        ensemble_ratio(mean[0], mean[1], count, 1.5),
        count,
        units=(units[0], "1"),
        details=(_maps.side(maps, spacing),),
    )


def _sizes(sizes: Any, shape: tuple[int, ...], low: int = 1) -> np.ndarray | Array:
    if sizes is None:
        return np.maximum(_grid.default_scales((shape[-2], shape[-1]))[1:], 2).astype(np.int32)
    return _maps.check_scales("sizes", sizes, low=low, high=min(shape[-2:]), limit="L")
