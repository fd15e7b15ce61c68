"""The maps that loops are drawn on: checked, dithered where heights repeat, cut at open edges.

A contour at level c separates the sites above it, h > c, from the others. Heights that repeat make
that ill-defined, so that maps of heights in steps are dithered; see `dither`.

NumPy alone.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Num

from jaxsurf.loops.dither import Steps, described, dithered, steps_of

Heights = Num[Any, "*surface x y"] | Iterable[Num[Any, "*surface x y"]]
SMALLEST_SIDE = 4
UNCLEAR = "heights repeat, but on no common step: not dithered; pass step= if they have one"
BOUNDARIES = ("periodic", "open")


@dataclass(frozen=True)
class Maps:
    """A batch of maps ready for contouring.

    An open map gets a rim of one invalid row and column and is periodic from then on.

    Attributes:
        heights: `[surface, x, y]`, float32 or float64, dithered if need be; -inf where invalid.
        valid: which sites may be used, or None for all.
        shape: sites of a map, without the rim.
        first: the number of the first surface of the batch among all surfaces.
        notes: what was done to the heights, in words.
    """

    heights: Float[np.ndarray, "surface x y"]
    valid: Bool[np.ndarray, "surface x y"] | None
    shape: tuple[int, int]
    first: int
    notes: tuple[str, ...]


def batches(
    heights: Any, mask: Any, seed: int, boundary: str, limit: int, step: float | None = None
) -> Iterator[Maps]:
    """Split maps into batches of at most `limit` sites (one map at least), checked and dithered.

    Arguments:
        heights: an array `[x, y]` or `[surface, x, y]`, or an iterable of such arrays, which is
            read one array at a time.
        mask: None, or boolean, true on valid sites, of the shape of one map or of all of them.
        seed: what the dither is drawn from; surface k gets the same draw in any batch.
        boundary: "periodic" or "open".
        limit: sites in a batch.
        step: of the heights, or None to look for it.
    """
    noise = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(0,)))
    first = 0
    for stack in _grouped(heights, limit):
        valid = _checked_mask(mask, stack.shape, first)
        _check_finite(stack, valid, first)
        if step is None:
            found = steps_of(stack, valid)
        else:
            found = _given_steps(stack, valid, step, first)
        notes = (UNCLEAR,) if found.is_unclear.any() else ()
        # the precision of a map must not depend on the maps around it
        ends = np.flatnonzero(np.diff(2 * (found.step > 0) + found.is_whole)) + 1
        for part in np.split(np.arange(len(stack)), ends):
            run = slice(int(part[0]), int(part[-1]) + 1)
            maps, said = stack[run], notes
            if found.step[run.start] > 0:
                maps = dithered(maps, found.step[run], noise)
                said = (*notes, described(found.step[run], bool(found.is_whole[run.start])))
            kept = None if valid is None else valid[run]
            maps, kept = _closed_off(maps, kept, boundary == "open")
            shape = stack.shape[1], stack.shape[2]
            yield Maps(maps, kept, shape, first + run.start, said)
        first += len(stack)
    if first == 0:
        raise ValueError(
            "heights must hold at least one map; got none. Pass [x, y] or [surface, x, y]."
        )


def _grouped(heights: Any, limit: int) -> Iterator[np.ndarray]:
    """Stacks of maps of at most `limit` sites, or one map, of one floating-point type each."""
    waiting: list[np.ndarray] = []
    kind = None
    for block in _blocks(heights):
        stack = _checked_stack(block)
        if stack.dtype.kind in "iu":
            stack = stack.astype(np.float64)
        elif stack.dtype.itemsize < 4:
            stack = stack.astype(np.float32)
        if kind is not None and stack.shape[1:] != kind[0]:
            raise ValueError(
                f"all maps must have one shape; got {kind[0]} and then {stack.shape[1:]}. "
                "Trace maps of different shapes in separate calls."
            )
        step = max(1, limit // (stack.shape[1] * stack.shape[2]))
        if kind is not None and kind != (stack.shape[1:], stack.dtype):
            yield np.concatenate(waiting)
            waiting = []
        kind = stack.shape[1:], stack.dtype
        for start in range(0, len(stack), step):
            part = stack[start : start + step]
            if waiting and sum(map(len, waiting)) + len(part) > step:
                yield np.concatenate(waiting)
                waiting = []
            waiting.append(part)
    if waiting:
        yield waiting[0] if len(waiting) == 1 else np.concatenate(waiting)


def whole_plaquettes(valid: Bool[np.ndarray, "surface x y"]) -> Bool[np.ndarray, "surface x y"]:
    """Which plaquettes of periodic maps have four valid sites."""
    pair = valid & np.roll(valid, -1, 1)
    return pair & np.roll(pair, -1, 2)


def check_choice(name: str, value: Any, choices: Iterable[str]) -> None:
    """Raise unless `value` is one of the named choices."""
    allowed = sorted(choices)
    if value not in allowed:
        raise ValueError(
            f"{name} must be one of {allowed}; got {value!r}. Pass one of these names."
        )


def check_count(name: str, value: Any) -> int:
    """Return `value` as an int; raise unless it is a whole number of at least 1."""
    if isinstance(value, bool | np.bool_) or not isinstance(value, int | np.integer):
        raise TypeError(f"{name} must be an integer; got {value!r}. Pass 1 or more.")
    if value < 1:
        raise ValueError(f"{name} must be at least 1; got {value}. Pass 1 or more.")
    return int(value)


def check_spacing(spacing: Any) -> float:
    """Return the lattice spacing as a float; raise unless it is positive and finite."""
    value = float(spacing)
    if not 0 < value < np.inf:
        raise ValueError(
            f"spacing must be positive and finite; got {spacing!r}. "
            "Pass the lattice constant in your unit of length, 1.0 for sites."
        )
    return value


def check_step(step: Any) -> float | None:
    """Return the step of the heights as a float, or None; raise unless positive and finite."""
    if step is not None and not 0 < float(step) < np.inf:
        raise ValueError(
            f"step must be positive and finite; got {step!r}. Leave it out to have it looked for."
        )
    return None if step is None else float(step)


def seed_of(rng: Any) -> int:
    """One integer that everything random in a call is derived from."""
    if isinstance(rng, np.random.Generator):
        return int(rng.integers(2**63))
    if isinstance(rng, int | np.integer) and not isinstance(rng, bool) and rng >= 0:
        return int(rng)
    raise TypeError(
        f"rng must be a numpy.random.Generator or an integer >= 0; got {rng!r}. "
        "Pass rng=0, or numpy.random.default_rng(0)."
    )


def _blocks(heights: Any) -> Iterator[Any]:
    if hasattr(heights, "ndim"):
        yield heights
    elif isinstance(heights, Iterable) and not isinstance(heights, str | bytes | dict):
        for block in heights:
            if not hasattr(block, "ndim"):
                raise TypeError(
                    "heights must be an array or hold arrays; got an iterable of "
                    f"{type(block).__name__}. Wrap nested lists with numpy.asarray."
                )
            yield block
    else:
        raise TypeError(
            f"heights must be an array; got {type(heights).__name__}. "
            "Pass [x, y], [surface, x, y], or an iterable of such arrays."
        )


def _checked_stack(block: Any) -> np.ndarray:
    heights = np.asarray(block)
    if heights.ndim not in (2, 3):
        raise ValueError(
            f"heights must be a map [x, y] or a batch [surface, x, y]; got shape {heights.shape}. "
            "Reshape further batch axes into one."
        )
    if heights.dtype.kind not in "iuf" and heights.dtype.name != "bfloat16":
        raise TypeError(
            f"heights must be real numbers; got dtype {heights.dtype}. "
            "Pass the real part, or the modulus, of complex data."
        )
    if min(heights.shape[-2:]) < SMALLEST_SIDE or heights.size == 0:
        raise ValueError(
            f"a map must have at least {SMALLEST_SIDE} x {SMALLEST_SIDE} sites; got shape "
            f"{heights.shape}. Pass a larger map."
        )
    return heights[None] if heights.ndim == 2 else heights


def _checked_mask(mask: Any, shape: tuple[int, ...], first: int) -> np.ndarray | None:
    if mask is None:
        return None
    given = np.asarray(mask)
    if given.dtype != bool:
        raise TypeError(
            f"mask must be boolean, true on valid sites; got dtype {given.dtype}. "
            "Pass e.g. numpy.isfinite(heights)."
        )
    if given.shape == shape[1:]:
        part = np.broadcast_to(given, shape)
    elif given.ndim == 3 and given.shape[1:] == shape[1:] and len(given) >= first + shape[0]:
        part = given[first : first + shape[0]]
    else:
        raise ValueError(
            f"mask must have the shape of one map, {shape[1:]}, or of all of them; "
            f"got {given.shape}. Pass one boolean a site."
        )
    whole = part[:, :-1, :-1] & part[:, 1:, :-1] & part[:, 1:, 1:] & part[:, :-1, 1:]
    if not (usable := whole.any((1, 2))).all():
        raise ValueError(
            "mask must leave at least one plaquette of four valid sites; it leaves none in surface "
            f"{first + int(np.argmin(usable))}. Leave that surface out, or mask less."
        )
    return part


def _closed_off(
    heights: np.ndarray, valid: np.ndarray | None, is_open: bool
) -> tuple[np.ndarray, np.ndarray | None]:
    if valid is None and not is_open:
        return heights, None
    if valid is None:
        valid = np.ones(heights.shape, bool)
    if is_open:
        rim = ((0, 0), (0, 1), (0, 1))
        heights, valid = np.pad(heights, rim), np.pad(valid, rim)
    return np.where(valid, heights, -np.inf), valid


def _check_finite(heights: np.ndarray, valid: np.ndarray | None, first: int) -> None:
    if valid is None:  # NaN is its own maximum
        sites = heights.reshape(len(heights), -1)
        top, bottom = sites.max(1), sites.min(1)
        finite, flat = bool(np.all(np.isfinite(top) & np.isfinite(bottom))), top == bottom
    else:
        finite = bool(np.all(np.isfinite(heights), where=valid))
        sites, used = heights.reshape(len(heights), -1), valid.reshape(len(heights), -1)
        one = np.take_along_axis(sites, used.argmax(1)[:, None], 1)
        flat = ((sites == one) | ~used).all(1)
    if not finite:
        used = True if valid is None else valid
        bad = int(np.count_nonzero(~np.isfinite(heights) & used))
        raise ValueError(
            f"heights must be finite; got {bad} NaN or infinite among {heights.size} sites. "
            "Pass mask= with False on the missing sites, or fill them."
        )
    if flat.any():
        raise ValueError(
            "heights must vary over a map; got constant heights in surface "
            f"{first + int(np.argmax(flat))}. A flat map has no contours: leave it out."
        )


def _given_steps(heights: np.ndarray, valid: np.ndarray | None, step: float, first: int) -> Steps:
    """The same step for each surface, if their heights reach farther than that."""
    for index, each in enumerate(heights):
        used = each if valid is None else each[valid[index]]
        if not step <= (reach := float(np.ptp(used))):
            raise ValueError(
                f"step must be at most the range of the heights, {reach:.3g} in surface "
                f"{first + index}; got {step:.3g}. Leave it out to have it looked for."
            )
    neither = np.zeros(len(heights), bool)
    return Steps(np.full(len(heights), step), neither, neither)
