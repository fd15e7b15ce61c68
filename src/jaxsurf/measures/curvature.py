r"""Scale-dependent curvature: the second difference of the heights at scale b.

The second derivative of a self-affine surface is dominated by the lattice. Replacing it by a second
difference over a distance b,

$$C_b(x) = \sum_m [h(x + b e_m) - h(x)],$$

with M offsets that sum to zero, gives a field blind to the mean and the tilt of the map. Its
variance carries the roughness exponent, $\langle C_b^2 \rangle \sim b^{2\alpha}$; its odd moments
the up/down asymmetry that no quadratic measure can see; and if the heights are Gaussian
$\langle C_b^4 \rangle/\langle C_b^2 \rangle^2 = 3$.

`moments` is the array-level core: several orders in one pass, one map and one scale at a time, so
that the memory does not grow with the number of scales.

Source: the paper's Sec. II C, Eqs. (curv_def), (curv_scale), (curv2), (curv4).
"""

from functools import partial, reduce
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from jaxsurf import _grid
from jaxsurf._checks import check_choice
from jaxsurf.curve import Curve
from jaxsurf.laws import DIRECTIONS
from jaxsurf.measures import _maps
from jaxsurf.measures._maps import Heights, Units

Offsets = tuple[tuple[int, int], ...]


@partial(jax.jit, static_argnames=("orders", "offsets", "boundary"))
def moments(
    heights: Float[Array, "surface x y"],
    scales: Int[Array | np.ndarray, " scale"],
    mask: Bool[Array, "surface x y"] | None = None,
    *,
    orders: tuple[int, ...] = (2,),
    offsets: Offsets = DIRECTIONS["10"],
    boundary: str = "periodic",
) -> tuple[Float[Array, "order surface scale"], Float[Array, "surface scale"]]:
    r"""Means of $C_b^q$ over the sites where C_b exists, and the number of those sites.

    Arguments:
        heights: maps; finite outside the mask.
        scales: b in sites; any values without recompilation.
        mask: true on valid sites.
        orders: the moments q, computed in one pass.
        offsets: the M vectors e_m, in sites at b = 1; they must sum to zero.
        boundary: "open" uses only the sites whose M neighbours lie inside the map.
    """
    scales = jnp.asarray(scales, jnp.int32)
    dtype = heights.dtype

    def at_scale(one: Array, valid: Array | None, b: Array) -> tuple[Array, Array]:
        curvature = _neighbours(one, b, offsets) - len(offsets) * one
        present = _present(valid, one.shape, b, offsets, boundary)
        if present is None:
            count = jnp.asarray(one.size, dtype)
        else:
            curvature = jnp.where(present, curvature, jnp.zeros_like(curvature))
            count = jnp.sum(present, dtype=dtype)
        total = [jnp.sum(curvature**q) for q in orders]
        return jnp.stack(total) / jnp.maximum(count, 1), count

    def of_map(one: tuple[Array, ...]) -> tuple[Array, Array]:
        valid = one[1] if len(one) == 2 else None
        # The rolled maps of one scale are made again in the backward pass, not kept.
        step = jax.checkpoint(lambda b: at_scale(one[0], valid, b))
        return jax.lax.map(step, scales)

    mean, count = jax.lax.map(of_map, (heights,) if mask is None else (heights, mask))
    return jnp.moveaxis(mean, 2, 0), count


def _neighbours(one: Float[Array, "x y"], b: Int[Array, ""], offsets: Offsets) -> Array:
    """Sum over m of h(x + b e_m) on the torus."""
    shifted = [_maps.rolled(one, b * dx, b * dy) for dx, dy in offsets]
    return sum(shifted[1:], shifted[0])


def _present(
    valid: Array | None, shape: tuple[int, ...], b: Array, offsets: Offsets, boundary: str
) -> Array | None:
    """Where C_b exists: None for everywhere."""
    present = valid
    if valid is not None:
        neighbours = [_maps.rolled(valid, b * dx, b * dy) for dx, dy in offsets]
        present = reduce(jnp.logical_and, neighbours, valid)
    if boundary == "open":
        inside = _inside(shape, b, offsets)
        present = inside if present is None else present & inside
    return present


def _inside(shape: tuple[int, ...], b: Array, offsets: Offsets) -> Bool[Array, "x y"]:
    """Whether all the neighbours of a site lie on the map."""
    along = []
    for axis in (0, 1):
        at = jnp.arange(shape[axis], dtype=jnp.int32)
        low = b * -min(0, *(e[axis] for e in offsets))
        high = shape[axis] - b * max(0, *(e[axis] for e in offsets))
        along.append((at >= low) & (at < high))
    return along[0][:, None] & along[1][None, :]


@_maps.in_their_own_dtype
def curvature_moment(
    heights: Heights,
    scales: Any = None,
    *,
    order: int = 2,
    direction: str = "10",
    spacing: float = 1.0,
    boundary: str = "periodic",
    mask: Any = None,
    units: Units = ("sites", "1"),
) -> Curve:
    r"""Moment of the scale-dependent curvature.

    $$\langle C_b^q \rangle, \qquad C_b(x) = \sum_m [h(x + b e_m) - h(x)]$$

    A self-affine surface has $\langle C_b^q \rangle \sim b^{q\alpha}$ for even q; odd moments
    vanish if h -> -h is a symmetry; $\langle C_b^4 \rangle = 3 \langle C_b^2 \rangle^2$ if the
    heights are Gaussian.

    Arguments:
        heights: maps `[..., x, y]`, each a surface; the dtype is kept.
        scales: offsets b in sites, ascending, 1 <= b <= L/2; None for 1 ... L/4. Any values without
            recompilation.
        order: the moment q >= 1.
        direction: "10" or "11"; along "11" the offset (b, b) has length sqrt(2) b, which is the
            curve's scale.
        spacing: lattice constant; the curve's scale is in its unit.
        boundary: "periodic", or "open" for maps that do not wrap round.
        mask: true on valid sites, `[x, y]` or the shape of `heights`.
        units: of length and of height.

    Returns:
        A `Curve` over the offset length, in height^q, differentiable in the heights. Its weights
        are the numbers of sites averaged over; a scale without any has count zero.

    Raises:
        TypeError: heights or mask of the wrong kind.
        ValueError: scales, order, direction or boundary out of range; heights not finite.

    Source: Eqs. (curv_def), (curv_scale), (curv4).

    >>> import jax
    >>> heights = jax.random.normal(jax.random.key(0), (3, 64, 64))
    >>> curvature_moment(heights, [1, 2, 4])
    Curve('curvature_moment', order=2, direction=10, side=64.0: 3 surfaces x 3 scales 1...4 sites)
    """
    maps, valid = _maps.read(heights, mask, boundary=boundary, spacing=spacing)
    check_choice("direction", direction, DIRECTIONS)
    order = _maps.check_order(order)
    scales = _scales(scales, maps.shape)
    mean, count = moments(
        maps, scales, valid, orders=(order,), offsets=DIRECTIONS[direction], boundary=boundary
    )
    return Curve(
        "curvature_moment",
        _offset_length(scales, direction, spacing),
        mean[0],
        count,
        units=(units[0], _maps.power_of(units[1], order)),
        details=_details(maps.shape, spacing, order=order, direction=direction),
    )


def _scales(scales: Any, shape: tuple[int, ...]) -> np.ndarray | Array:
    if scales is None:
        return _grid.default_scales((shape[-2], shape[-1])).astype(np.int32)
    return _maps.check_scales("scales", scales, low=1, high=min(shape[-2:]) // 2, limit="L/2")


def _offset_length(scales: Any, direction: str, spacing: float) -> Any:
    """The length b |e_m| of the offsets, in units of length."""
    return scales * (spacing * float(np.hypot(*DIRECTIONS[direction][0])))


def _details(shape: tuple[int, ...], spacing: float, **what: Any) -> tuple[tuple[str, Any], ...]:
    return (*what.items(), ("side", _maps.side(shape, spacing)))
