r"""Moments of a finite difference at scale b, the engine of the curvature and of the differences.

A stencil is a list of offsets e_m; its field is $F_b(x) = \sum_m [h(x + b e_m) - h(x)]$. The
moments of F_b are averaged over the sites where it exists: all of a periodic map, the sites whose
neighbours lie inside an open one, the sites that are valid with all their neighbours under a mask.

One map and one scale are in work at a time, so that the memory is that of a few maps whatever the
number of surfaces and scales; the backward pass makes the fields again instead of keeping them.
"""

from functools import partial, reduce

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from jaxsurf.measures import _maps

Stencil = tuple[tuple[int, int], ...]


@partial(jax.jit, static_argnames=("stencils", "orders", "boundary", "absolute"))
def stencil_moments(
    heights: Float[Array, "surface x y"],
    scales: Int[Array | np.ndarray, " scale"],
    mask: Bool[Array, "surface x y"] | None,
    *,
    stencils: tuple[Stencil, ...],
    orders: tuple[float | int, ...],
    boundary: str,
    absolute: bool,
) -> tuple[Float[Array, "order surface scale"], Float[Array, "surface scale"]]:
    """Means of F_b^q, or |F_b|^q, pooled over the stencils, and the number of terms in them."""

    def at_scale(one: Array, valid: Array | None, b: Array) -> tuple[Array, Array]:
        totals, count = jnp.zeros(len(orders), one.dtype), jnp.zeros((), one.dtype)
        for stencil in stencils:
            field = _field(one, b, stencil)
            present = where_present(valid, (one.shape[0], one.shape[1]), b, stencil, boundary)
            if present is None:
                count = count + one.size
            else:
                field = jnp.where(present, field, jnp.zeros_like(field))
                count = count + jnp.sum(present, dtype=one.dtype)
            power = absolute_power if absolute else integer_power
            totals = totals + jnp.stack([jnp.sum(power(field, q)) for q in orders])
        return totals / jnp.maximum(count, 1), count

    def of_map(one: tuple[Array, ...]) -> tuple[Array, Array]:
        valid = one[1] if len(one) == 2 else None
        step = jax.checkpoint(lambda b: at_scale(one[0], valid, b))
        return jax.lax.map(step, jnp.asarray(scales, jnp.int32))

    mean, count = jax.lax.map(of_map, (heights,) if mask is None else (heights, mask))
    return jnp.moveaxis(mean, 2, 0), count


def integer_power(field: Float[Array, "..."], order: float | int) -> Float[Array, "..."]:
    """F^q for a whole number q."""
    return field ** int(order)


def absolute_power(field: Float[Array, "..."], order: float | int) -> Float[Array, "..."]:
    """|F|^q for any q > 0, with gradient zero where F is zero."""
    if order == int(order):
        return (field if order % 2 == 0 else jnp.abs(field)) ** int(order)
    zero = field == 0
    return jnp.where(zero, 0, jnp.abs(jnp.where(zero, 1, field)) ** order)


def _field(one: Float[Array, "x y"], b: Int[Array, ""], stencil: Stencil) -> Float[Array, "x y"]:
    """Sum over m of h(x + b e_m) - h(x) on the torus."""
    neighbours = [_maps.rolled(one, b * dx, b * dy) for dx, dy in stencil]
    return reduce(jnp.add, neighbours) - len(stencil) * one


def where_present(
    valid: Bool[Array, "x y"] | None,
    shape: tuple[int, int],
    b: Int[Array, ""],
    stencil: Stencil,
    boundary: str,
) -> Bool[Array, "x y"] | None:
    """Where F_b exists: None for everywhere."""
    present = valid
    if valid is not None:
        neighbours = [_maps.rolled(valid, b * dx, b * dy) for dx, dy in stencil]
        present = reduce(jnp.logical_and, neighbours, valid)
    if boundary == "open":
        inside = _inside(shape, b, stencil)
        present = inside if present is None else present & inside
    return present


def _inside(shape: tuple[int, int], b: Int[Array, ""], stencil: Stencil) -> Bool[Array, "x y"]:
    """Whether all the neighbours of a site lie on the map."""
    along = []
    for axis in (0, 1):
        at = jnp.arange(shape[axis], dtype=jnp.int32)
        low = b * -min(0, *(e[axis] for e in stencil))
        high = shape[axis] - b * max(0, *(e[axis] for e in stencil))
        along.append((at >= low) & (at < high))
    return along[0][:, None] & along[1][None, :]
