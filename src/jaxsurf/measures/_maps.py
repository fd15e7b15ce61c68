"""What every measure does with its arguments first: one batch axis, one dtype, one mask.

A measure keeps the dtype it is given. Where JAX's 64-bit mode is off, float64 heights are measured
in 64 bits all the same and the curve comes back as NumPy arrays, since JAX could not hold it.
"""

from collections.abc import Callable
from functools import wraps
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, Shaped

from jaxsurf._checks import (
    check_choice,
    check_heights,
    check_integer,
    check_spacing,
    is_traced,
)

BOUNDARIES = ("periodic", "open")

#: Heights `[..., x, y]` as a user may give them; `read` checks what they are.
Heights = Shaped[Array | np.ndarray, "..."]
Units = tuple[str, str]

Result = TypeVar("Result")


def in_their_own_dtype(measure: Callable[..., Result]) -> Callable[..., Result]:
    """Run a measure of float64 heights in 64 bits, whatever JAX's global setting."""

    @wraps(measure)
    def measured(heights: Any, *args: Any, **kwargs: Any) -> Result:
        wide = getattr(heights, "dtype", None) == np.float64 and not is_traced(heights)
        if not wide or jax.config.read("jax_enable_x64"):
            return measure(heights, *args, **kwargs)
        with jax.enable_x64(True):
            return jax.tree.map(np.asarray, measure(heights, *args, **kwargs))

    return measured


def read(
    heights: Any,
    mask: Any = None,
    *,
    boundary: str = "periodic",
    spacing: Any = 1.0,
    constant: bool = True,
) -> tuple[Float[Array, "surface x y"], Bool[Array, "surface x y"] | None]:
    """Check the arguments that all measures share; return the maps along one batch axis.

    Heights of missing sites come back as zero, so that no NaN can spread from them.
    """
    check_heights(heights, mask=mask, constant=constant)
    check_common(boundary, spacing)
    maps = jnp.asarray(heights, dtype_for(heights))
    shape = (-1, *maps.shape[-2:])
    if mask is None:
        return maps.reshape(shape), None
    valid = jnp.broadcast_to(jnp.asarray(mask), maps.shape).reshape(shape)
    maps = maps.reshape(shape)
    return jnp.where(valid, maps, jnp.zeros_like(maps)), valid


def check_common(boundary: str, spacing: Any) -> None:
    """Raise unless the boundary is known and the spacing positive."""
    check_choice("boundary", boundary, BOUNDARIES)
    check_spacing(spacing)


def dtype_for(heights: Any) -> Any:
    """The dtype to measure in: the heights' own, but whole numbers and half precision widen."""
    kind = np.dtype(heights.dtype)
    return jnp.zeros(()).dtype if kind.kind in "iu" or kind.itemsize < 4 else None


def check_scales(name: str, scales: Any, *, low: int, high: int, limit: str) -> np.ndarray | Array:
    """Return whole ascending scales; raise unless all lie between `low` and `high` sites."""
    if is_traced(scales):
        return jnp.asarray(scales, jnp.int32)
    values = np.atleast_1d(np.asarray(scales))
    remedy = f"Pass whole numbers of sites from {low} to {high}."
    if values.ndim != 1 or values.size == 0:
        raise ValueError(f"{name} must be one list of scales; got shape {values.shape}. {remedy}")
    if values.dtype == bool or not np.issubdtype(values.dtype, np.number):
        raise TypeError(f"{name} must be whole numbers; got {scales!r}. {remedy}")
    if not np.all(values == np.round(values)):
        raise ValueError(f"{name} must be whole numbers; got {values.tolist()}. {remedy}")
    if bad := [int(b) for b in values if not low <= b <= high]:
        raise ValueError(f"{name} must lie in [{low}, {limit} = {high}]; got {bad[:5]}. {remedy}")
    if np.any(np.diff(values) <= 0):
        raise ValueError(
            f"{name} must ascend without repeats; got {values.tolist()}. Pass numpy.unique of them."
        )
    return values.astype(np.int32)


def check_order(order: Any, *, low: int = 1) -> int:
    """Return the order of a moment; raise unless it is a whole number of at least `low`."""
    return check_integer("order", order, low=low, remedy="Pass 2 for the variance.")


def rolled(
    one: Shaped[Array, "x y"],
    dx: int | Int[Array, ""],
    dy: int | Int[Array, ""],
) -> Shaped[Array, "x y"]:
    """The map seen from a site (dx, dy) further on, on the torus: h(x + d) at x."""
    shift: Any = (-dx, -dy)
    return jnp.roll(one, shift, (0, 1))


def side(maps: Shaped[Array, "..."], spacing: Any) -> tuple[str, float]:
    """The map's smaller side in units of length, as one of a curve's details."""
    return "side", min(maps.shape[-2:]) * float(spacing)


def power_of(unit: str, exponent: float | int) -> str:
    """The unit of a power: "nm" and 2 give "nm^2"; pure numbers stay pure."""
    if unit == "1" or exponent == 0:
        return "1"
    return unit if exponent == 1 else f"{unit}^{exponent:g}"


def product_of(*units: str) -> str:
    """The unit of a product, pure numbers left out."""
    return " ".join(unit for unit in units if unit != "1") or "1"
