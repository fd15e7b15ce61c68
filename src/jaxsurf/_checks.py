"""Shared validation: every message says the value, the rule and the remedy.

Checks read concrete values only. Under `jax.jit`, `jax.vmap` or `jax.grad` a value is a tracer that
cannot be read, so shapes and types are still checked and values are not.
"""

from collections.abc import Iterable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

SMALLEST_SIDE = 4


def is_traced(value: Any) -> bool:
    """Whether a value is abstract, so that only its shape and dtype can be read."""
    return isinstance(value, Tracer)


def check_in_range(
    name: str,
    value: Any,
    low: float | int,
    high: float | int,
    *,
    remedy: str,
    closed: tuple[bool, bool] = (True, True),
) -> None:
    """Raise unless every entry of `value` lies between `low` and `high`."""
    if is_traced(value):
        return
    entries = np.asarray(value)
    if entries.dtype == bool or not np.issubdtype(entries.dtype, np.number):
        raise TypeError(f"{name} must be a number; got {value!r}. {remedy}")
    above = entries >= low if closed[0] else entries > low
    below = entries <= high if closed[1] else entries < high
    if not np.all(above & below):
        left, right = "[" if closed[0] else "(", "]" if closed[1] else ")"
        rule = f"{name} must lie in {left}{low:g}, {high:g}{right}"
        raise ValueError(f"{rule}; got {_shown(value)}. {remedy}")


def check_choice(name: str, value: Any, choices: Iterable[str]) -> None:
    """Raise unless `value` is one of the named choices."""
    allowed = sorted(choices)
    if value not in allowed:
        raise ValueError(
            f"{name} must be one of {allowed}; got {value!r}. Pass one of these names."
        )


def check_integer(name: str, value: Any, *, low: int, remedy: str) -> int:
    """Return `value` as an int; raise unless it is a whole number of at least `low`."""
    if isinstance(value, bool | np.bool_) or not isinstance(value, int | np.integer):
        raise TypeError(f"{name} must be an integer; got {value!r}. {remedy}")
    if value < low:
        raise ValueError(f"{name} must be at least {low}; got {value}. {remedy}")
    return int(value)


def check_shape(shape: Any) -> tuple[int, int]:
    """Return a grid shape as two ints; raise unless both sides are at least 4 sites."""
    remedy = f"Pass (Lx, Ly) with both sides at least {SMALLEST_SIDE}."
    if not isinstance(shape, Iterable) or len(sides := tuple(shape)) != 2:
        raise ValueError(f"shape must be two side lengths; got {shape!r}. {remedy}")
    for side in sides:
        check_integer("a side of the grid", side, low=SMALLEST_SIDE, remedy=remedy)
    return int(sides[0]), int(sides[1])


def check_spacing(spacing: Any) -> None:
    """Raise unless the lattice spacing is a positive finite number."""
    check_in_range(
        "spacing",
        spacing,
        0.0,
        np.inf,
        closed=(False, False),
        remedy="Pass the lattice constant in your unit of length, 1.0 for sites.",
    )


def check_key(key: Any) -> None:
    """Raise unless `key` is a typed JAX random key."""
    if not (hasattr(key, "dtype") and jnp.issubdtype(key.dtype, jax.dtypes.prng_key)):
        what = f"an array of {key.dtype}" if hasattr(key, "dtype") else repr(key)
        raise TypeError(f"key must be a typed JAX key; got {what}. Make one by jax.random.key(0).")


def check_heights(heights: Any, *, mask: Any = None, constant: bool = True) -> None:
    """Raise unless `heights` is a real map, or a batch of maps, that can be measured.

    Arguments:
        heights: an array `[..., x, y]`.
        mask: boolean, true on valid sites; heights outside it are not looked at.
        constant: whether a map with all heights equal is refused.
    """
    if not hasattr(heights, "ndim"):
        raise TypeError(
            f"heights must be an array; got {type(heights).__name__}. "
            "Wrap lists with numpy.asarray, and batches of equal maps with numpy.stack."
        )
    if heights.ndim < 2:
        raise ValueError(
            f"heights must be a map [x, y] or a batch [..., x, y]; got shape {heights.shape}. "
            "For a single profile see the line-scan measures."
        )
    if min(heights.shape[-2:]) < SMALLEST_SIDE or heights.size == 0:
        raise ValueError(
            f"a map must have at least {SMALLEST_SIDE} x {SMALLEST_SIDE} sites and a batch at "
            f"least one map; got shape {heights.shape}. Pass a larger map."
        )
    kind = np.dtype(heights.dtype)
    if kind.kind not in "iuf" and kind.name not in ("bfloat16", "float16"):
        raise TypeError(
            f"heights must be real numbers; got dtype {kind}. "
            "Pass the real part, or the modulus, of complex data."
        )
    if mask is not None:
        check_mask(mask, heights.shape)
    if is_traced(heights) or is_traced(mask):
        return
    values = np.asarray(heights)
    if mask is None:
        top, bottom = values.max((-2, -1)), values.min((-2, -1))
    else:
        top = np.where(mask, values, -np.inf).max((-2, -1))
        bottom = np.where(mask, values, np.inf).min((-2, -1))
    if not np.all(np.isfinite(top) & np.isfinite(bottom)):  # a NaN is both highest and lowest
        bad = ~np.isfinite(values) if mask is None else ~np.isfinite(values) & mask
        raise ValueError(
            f"heights must be finite; got {np.count_nonzero(bad)} NaN or infinite among "
            f"{values.size} sites. Pass mask= with False on the missing sites, or fill them."
        )
    if constant and np.any(top <= bottom):
        flat = np.flatnonzero(np.atleast_1d(top <= bottom))[:5].tolist()
        raise ValueError(
            f"heights must vary over a map; got constant heights in surface {flat}. "
            "A flat map has no roughness: leave it out."
        )


def check_mask(mask: Any, shape: tuple[int, ...]) -> None:
    """Raise unless `mask` is boolean and its shape fits the heights'."""
    if not hasattr(mask, "dtype") or np.dtype(mask.dtype) != bool:
        raise TypeError(
            f"mask must be a boolean array, true on valid sites; got {type(mask).__name__} of "
            f"{getattr(mask, 'dtype', 'no dtype')}. Pass e.g. numpy.isfinite(heights)."
        )
    if mask.shape not in (shape, shape[-2:]):
        raise ValueError(
            f"mask must have the shape of the heights, {shape}, or of one map, {shape[-2:]}; "
            f"got {mask.shape}. Pass one boolean a site."
        )
    if not is_traced(mask) and not np.all(np.any(mask, (-2, -1))):
        raise ValueError(
            "mask must leave at least one valid site in every map; got a map without any. "
            "Leave that map out, or turn the mask round: true marks valid sites."
        )


def _shown(value: Any) -> str:
    text = repr(np.asarray(value).tolist())
    return text if len(text) <= 60 else text[:57] + "..."
