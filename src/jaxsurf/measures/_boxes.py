r"""Mean and central moments in every b x b box of a map, by merging neighbouring boxes.

Two boxes of weights p and 1 - p, means A and B and central moments $A_j$, $B_j$ merge exactly into
one with mean $A + (1-p)\delta$, $\delta = B - A$, and

$$m_k = \sum_j \binom{k}{j} [p A_j (-(1-p)\delta)^{k-j} + (1-p) B_j (p\delta)^{k-j}].$$

Boxes of width 1, 2, 4, ... are doubled, and those of the binary digits of b joined: of order log b
merges along each axis for any b, all positions at once. Unlike differences of running sums nothing
large is ever subtracted, so that float32 keeps its precision in the smallest box of a steep map.

Source: P. Pebay, Sandia Report SAND2008-6212 (2008), Eq. (2.1).
"""

from math import comb
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int

#: Mean and central moments 2, 3, ... of a box, then whether all its sites are valid.
Fields = tuple[Array, ...]


def box_moments(
    one: Array,
    valid: Bool[Array, "x y"] | None,
    b: Int[Array, ""],
    highest: int,
    axes: tuple[int, ...] = (0, 1),
) -> Fields:
    """Fields of the boxes [x, x + b) x [y, y + b) on the torus, at (x, y).

    Arguments:
        one: a map.
        valid: true on valid sites; None for everywhere.
        b: the side of the box in sites, from 1 to the sides of the map.
        highest: the last central moment wanted; 1 for the mean alone.
        axes: along which the box extends; over the others it is one site wide.
    """
    zeros = tuple(jnp.zeros_like(one) for _ in range(highest - 1))
    fields = (one, *zeros) if valid is None else (one, *zeros, valid)
    for axis in axes:
        fields = _boxes_along(fields, b, axis)
    return fields


def _boxes_along(fields: Fields, b: Int[Array, ""], axis: int) -> Fields:
    """Join b neighbouring boxes along one axis."""

    def digit(carry: tuple[Fields, Fields, Array], power: Array) -> tuple[Any, None]:
        block, joined, width = carry
        wanted = (b & power) > 0
        joined = jax.lax.cond(
            wanted,
            lambda: _merged(joined, _shifted(block, width, axis), width, power),
            lambda: joined,
        )
        block = jax.lax.cond(
            b >= 2 * power,
            lambda: _merged(block, _shifted(block, power, axis), power, power),
            lambda: block,
        )
        return (block, joined, width + jnp.where(wanted, power, 0)), None

    powers = 2 ** jnp.arange(fields[0].shape[axis].bit_length(), dtype=jnp.int32)
    start = (fields, fields, jnp.zeros((), jnp.int32))
    return jax.lax.scan(digit, start, powers)[0][1]


def _shifted(fields: Fields, distance: Array, axis: int) -> Fields:
    shift: Any = -distance
    return tuple(jnp.roll(field, shift, axis) for field in fields)


def _merged(first: Fields, second: Fields, sites: Array, more: Array) -> Fields:
    """The fields of two boxes side by side, of `sites` and `more` rows; `sites` may be zero."""
    dtype = first[0].dtype
    p = sites.astype(dtype) / (sites + more).astype(dtype)
    if first[-1].dtype == bool:
        both = jnp.where(sites > 0, first[-1] & second[-1], second[-1])
        return (*_merged(first[:-1], second[:-1], sites, more), both)
    delta = second[0] - first[0]
    left, right = (p - 1) * delta, p * delta

    def about_new_mean(moments: Fields, shift: Array, k: int) -> Array:
        """Sum over j of binom(k, j) m_j shift^(k-j), with m_0 = 1 and m_1 = 0."""
        terms = [comb(k, j) * moments[j - 1] * shift ** (k - j) for j in range(2, k + 1)]
        return sum(terms, shift**k)

    return (
        first[0] - left,
        *(
            p * about_new_mean(first, left, k) + (1 - p) * about_new_mean(second, right, k)
            for k in range(2, len(first) + 1)
        ),
    )
