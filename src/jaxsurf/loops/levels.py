r"""All contour loops of whole level sets.

Where `trace_loops` follows the loops through random points, `level_loops` finds every loop of a
level. Levels may be given, or placed on each surface in one of four ways:

- `"equal"`: n equally spaced levels whose common phase is drawn at random, so that every height is
  as likely as any other. Averages over such loops, weighted by length, are those of the paper's
  contour plots (Sec. III).
- `"quantiles"`: at the (i + 1/2)/n quantiles of the heights; one such level is the median.
- `"points"`: at the mean heights of n random plaquettes, the very ones `trace_loops` would start
  from with the same `rng`; each loop's weight is the number of those starts on it, so that
  averages are those of Appendix C, loop for loop.
- `"half-integers"`: at every half-integer, for integer heights of growth models. Sites are then
  never near the level and the dither decides saddles exactly at it, nothing else. A plaquette's
  mean, by contrast, is often a height that many sites have, and there the dither decides on which
  side each of them lies. Exponents agree, amplitudes do not: on the single-step model at p = 1/2
  loops of one radius are a few per cent longer at half-integer levels, and fewer points are on long
  loops (`benchmarks/loops_physics.py half-integers`).

NumPy and SciPy alone.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Bool

from jaxsurf.loops.contours import Contours, contour
from jaxsurf.loops.loops import Loops
from jaxsurf.loops.maps import (
    BOUNDARIES,
    Heights,
    Maps,
    batches,
    check_choice,
    check_count,
    check_spacing,
    check_step,
    seed_of,
    whole_plaquettes,
)
from jaxsurf.loops.starts import draw_starts, uniform_draws
from jaxsurf.loops.walk import STEP_X, STEP_Y, Starts

PLACEMENTS = ("equal", "half-integers", "points", "quantiles")
SITES_AT_ONCE = 1 << 18  # of the level sets contoured together; their codes fit the cache
MAP_SITES_AT_ONCE = 8_000_000  # of the maps looked at together


def level_loops(
    heights: Heights,
    levels: int | Any = 8,
    *,
    placement: str = "equal",
    rng: np.random.Generator | int = 0,
    boundary: str = "periodic",
    mask: Bool[Any, "*surfaces x y"] | None = None,
    spacing: float | int = 1.0,
    step: float | int | None = None,
    paths: bool = False,
) -> Loops:
    """Find every loop of whole level sets of each surface.

    Loops that wind around a periodic map are kept but marked, and so are the pieces into which the
    edge of an open map or invalid sites cut a loop; the statistics leave both out.

    Arguments:
        heights: maps `[x, y]` or `[surface, x, y]`, or an iterable of such arrays that is read one
            array at a time. Heights in steps are dithered, and the result says so.
        levels: how many levels on each surface, or the levels themselves, in the heights' unit. A
            level outside the heights gives no loops; one equal to a height is moved by a rounding
            unit, up or down by a coin, and the result says so.
        placement: "equal", "quantiles", "points" or "half-integers" (see the module), if `levels`
            is a number; half-integers are all taken.
        rng: a Generator, or the seed of one: the phase of equal levels, the points, dither.
        boundary: "periodic", or "open" for a map with edges.
        mask: true on valid sites; loops that touch an invalid one are open.
        spacing: lattice constant, the unit of length of the curves.
        step: of the heights, in their unit, if they come in steps (counts of a converter times a
            scale). If None it is looked for; heights in steps are dithered.
        paths: also keep the ordered points of each loop, see `Loops.path`; needed for
        `correlation`.

    Returns:
        `Loops`, each loop once, surface by surface and level by level.

    Raises:
        ValueError: heights that are not finite, constant, smaller than 4 x 4, of unequal shapes or
            not maps; fewer than one level, a level that is not finite; half-integer levels of
            heights that are not integers; a mask that leaves no plaquette.
        TypeError: complex heights, an `rng` that is neither a Generator nor an integer.

    Source: the paper's Secs. II and III; the connectivity is that of its Appendix C.

    >>> heights = np.zeros((8, 9))
    >>> heights[2:4, 3:6] = 1.0  # an island of 2 x 3 sites
    >>> island = level_loops(heights, [0.5])
    >>> island.length, island.radius, island.area
    (array([10]), array([3]), array([6]))
    """
    check_choice("boundary", boundary, BOUNDARIES)
    check_choice("placement", placement, PLACEMENTS)
    spacing = check_spacing(spacing)
    if isinstance(levels, int | np.integer | bool):
        count, given = check_count("levels", levels), None
    else:
        count, given = 0, _checked_levels(levels)
    seed = seed_of(rng)
    parts = []
    for maps in batches(heights, mask, seed, boundary, MAP_SITES_AT_ONCE, check_step(step)):
        placed = _given(maps, given) if given is not None else _PLACE[placement](maps, count, seed)
        if given is not None or placement == "quantiles":
            placed = _off_the_heights(maps, placed, seed)
        found = _batch_loops(maps, placed, boundary, spacing, paths)
        if mask is not None and maps.valid is not None:
            valid = whole_plaquettes(maps.valid)[:, : maps.shape[0], : maps.shape[1]]
            found = replace(found, valid=valid)
        parts.append(found)
    return Loops.join(parts)


@dataclass(frozen=True)
class _Placed:
    """The levels of a batch of maps, one entry a level set.

    Attributes:
        which: the surface of each.
        levels: sites above are those higher than this.
        weight: the interval of height each level stands for.
        starts: of placement "points", the point each level set was placed by.
    """

    which: np.ndarray
    levels: np.ndarray
    weight: np.ndarray
    sampling: str = "levels"
    starts: Starts | None = None
    notes: tuple[str, ...] = ()


def _checked_levels(levels: Any) -> np.ndarray:
    values = np.asarray(levels)
    if values.dtype.kind not in "iuf" or values.ndim != 1:
        raise TypeError(
            f"levels must be a number of levels or a list of heights; got {levels!r}. "
            "Pass e.g. levels=8 or levels=[0.0, 0.5]."
        )
    if values.size == 0 or not np.all(np.isfinite(values)):
        raise ValueError(
            f"levels must be one or more finite heights; got {levels!r}. Leave NaN levels out."
        )
    return np.unique(values.astype(float))


def _given(maps: Maps, values: np.ndarray) -> _Placed:
    return _everywhere(maps, np.broadcast_to(values, (len(maps.heights), len(values))))


def _everywhere(maps: Maps, levels: np.ndarray) -> _Placed:
    """Level sets from levels [surface, level]; a level stands for the heights nearest to it."""
    weight = np.gradient(levels, axis=1) if levels.shape[1] > 1 else np.ones_like(levels)
    which = np.repeat(np.arange(len(levels)), levels.shape[1])
    return _Placed(which, levels.ravel().astype(maps.heights.dtype), weight.ravel())


def _valid_heights(maps: Maps) -> Iterator[np.ndarray]:
    for index, heights in enumerate(maps.heights):
        yield heights if maps.valid is None else heights[maps.valid[index]]


def _equal(maps: Maps, count: int, seed: int) -> _Placed:
    bottom, top = np.array([(h.min(), h.max()) for h in _valid_heights(maps)], float).T
    interval = (top - bottom) / count
    phase = uniform_draws(seed, 1, maps.first, (len(maps.heights), 1))
    levels = bottom[:, None] + interval[:, None] * (np.arange(count) + phase)
    placed = _everywhere(maps, levels)
    return replace(placed, weight=interval[placed.which])


def _quantiles(maps: Maps, count: int, seed: int) -> _Placed:
    shares = (np.arange(count) + 0.5) / count
    return _everywhere(maps, np.array([np.quantile(h, shares) for h in _valid_heights(maps)]))


def _half_integers(maps: Maps, count: int, seed: int) -> _Placed:
    if not any("whole-number" in note for note in maps.notes):
        raise ValueError(
            "half-integer levels need integer heights; these are not whole numbers. "
            "Use placement='equal', or divide the heights by their step and round."
        )
    ranges = [np.rint([h.min(), h.max()]) for h in _valid_heights(maps)]
    levels = [np.arange(low, high) + 0.5 for low, high in ranges]
    which = np.repeat(np.arange(len(levels)), [len(each) for each in levels])
    flat = np.concatenate(levels)
    return _Placed(which, flat.astype(maps.heights.dtype), np.ones(len(flat)))


def _points(maps: Maps, count: int, seed: int) -> _Placed:
    starts = draw_starts(maps, count, seed).starts
    weight = np.ones(len(starts.level))
    return _Placed(starts.surface, starts.level, weight, "levels through points", starts)


_PLACE = {
    "equal": _equal,
    "quantiles": _quantiles,
    "half-integers": _half_integers,
    "points": _points,
}


def _off_the_heights(maps: Maps, placed: _Placed, seed: int) -> _Placed:
    """Take levels that equal a height just above or just below it, by a coin."""
    hit = np.array(
        [
            np.any(maps.heights[surface] == level)
            for surface, level in zip(placed.which, placed.levels, strict=True)
        ],
        bool,
    )
    if not hit.any():
        return placed
    levels = placed.levels.copy()
    coins = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(2, maps.first)))
    down = hit & (coins.random(len(hit)) < 0.5)
    levels[down] = np.nextafter(levels[down], -np.inf)
    said = f"{np.count_nonzero(hit)} levels equal to a height moved by a rounding unit"
    return replace(placed, levels=levels, notes=(*placed.notes, said))


def _batch_loops(maps: Maps, placed: _Placed, boundary: str, spacing: float, paths: bool) -> Loops:
    sites = maps.heights.shape[1] * maps.heights.shape[2]
    step = max(1, SITES_AT_ONCE // sites)
    whole = None if maps.valid is None else whole_plaquettes(maps.valid)
    parts = [
        _loops_of(maps, placed, slice(start, start + step), whole, boundary, spacing, paths)
        for start in range(0, max(len(placed.which), 1), step)
    ]
    surfaces = len(maps.heights)
    count = np.full(surfaces, sites) if whole is None else np.count_nonzero(whole, (1, 2))
    return replace(
        Loops.together(parts),
        level_sets=np.bincount(placed.which, minlength=surfaces),
        plaquettes=count,
        notes=maps.notes + placed.notes,
    )


def _loops_of(
    maps: Maps,
    placed: _Placed,
    part: slice,
    whole: np.ndarray | None,
    boundary: str,
    spacing: float,
    paths: bool,
) -> Loops:
    which, levels = placed.which[part], placed.levels[part]
    found = contour(maps.heights, which, levels)
    entered = None if placed.starts is None else _entered_at(found, placed.starts, part)
    is_open = np.zeros(len(found.start) - 1, bool)
    if whole is not None:
        found, is_open, entered = _cut(found, whole, which, entered)
    first, end = found.start[:-1], found.start[1:] - 1
    x, y = np.cumsum(found.step_x, dtype=np.int32), np.cumsum(found.step_y, dtype=np.int32)
    at_x, at_y = x - found.step_x, y - found.step_y  # where each node is; (x, y) is where it leads
    shape = np.array(maps.heights.shape[1:])
    winding = np.stack([x[end] - at_x[first], y[end] - at_y[first]], 1) // shape
    winding[is_open] = 0
    trivial = ~(is_open | winding.any(1))
    swept = np.cumsum(at_x * found.step_y, dtype=np.int64)
    area = swept[end] - swept[first] + (at_x * found.step_y)[first]
    board, start_x, start_y = found.plaquettes(first)
    from_x, from_y = start_x - at_x[first], start_y - at_y[first]
    centroid = np.stack(
        [_means(at_x, found.start) + from_x + 0.5, _means(at_y, found.start) + from_y + 0.5], 1
    )
    radius = np.maximum(_extent(at_x, first), _extent(at_y, first))
    length = np.diff(found.start)
    vertices = None
    if paths:
        shift = np.repeat(np.stack([from_x, from_y], 1), length, 0)
        vertices = (np.stack([at_x, at_y], 1) + shift).astype(np.int32)
    return Loops(
        length=length,
        radius=np.where(winding.any(1), 0, radius),
        area=np.where(trivial, area, 0),
        winding=winding,
        is_open=is_open,
        surface=which[board],
        level=levels[board].astype(np.float64),
        weight=_sums(entered, found.start) if entered is not None else placed.weight[part][board],
        centroid=centroid * spacing,
        surfaces=len(maps.heights),
        shape=maps.shape,
        spacing=spacing,
        sampling=placed.sampling,
        boundary=boundary,
        vertices=vertices,
    )


def _extent(at: np.ndarray, first: np.ndarray) -> np.ndarray:
    """How far each loop reaches along one axis."""
    if len(first) == 0:
        return np.zeros(0, np.int64)
    reach = np.maximum.reduceat(at, first) - np.minimum.reduceat(at, first)
    return reach.astype(np.int64)


def _sums(values: np.ndarray, start: np.ndarray) -> np.ndarray:
    """The sum of integers over each loop."""
    return np.add.reduceat(values, start[:-1], dtype=np.int64).astype(np.float64)


def _means(values: np.ndarray, start: np.ndarray) -> np.ndarray:
    return _sums(values, start) / np.diff(start)


def _entered_at(found: Contours, starts: Starts, part: slice) -> np.ndarray:
    """Which node of each level set is the start it was placed by."""
    x, y = starts.x[part], starts.y[part]
    boards = np.arange(len(x)) * (found.padded[0] * found.padded[1])
    target = boards + (x + 1) * found.padded[1] + y + 1
    node = np.flatnonzero(np.isin(found.cell, target))
    before = node - 1
    loop = np.searchsorted(found.start, node, side="right") - 1
    opens = node == found.start[loop]
    before[opens] = found.start[loop[opens] + 1] - 1
    direction = starts.direction[part][found.plaquettes(node)[0]]
    is_start = (found.step_x[before] == STEP_X[direction]) & (
        found.step_y[before] == STEP_Y[direction]
    )
    entered = np.zeros(len(found.cell), np.int64)
    entered[node[is_start]] = 1
    return entered


def _cut(
    found: Contours, whole: np.ndarray, which: np.ndarray, entered: np.ndarray | None
) -> tuple[Contours, np.ndarray, np.ndarray | None]:
    """Cut loops where they touch an invalid site; also say which of the pieces were cut."""
    nodes = np.arange(len(found.cell))
    board, x, y = found.plaquettes(nodes)
    outside = ~whole[which[board], x, y]
    length = np.diff(found.start)
    touching = _sums(outside, found.start) > 0
    # Turn each such loop until it begins outside, so that no piece spans its seam.
    first_outside = np.full(len(length), 0)
    loop = np.repeat(np.arange(len(length)), length)
    hits = np.flatnonzero(outside)
    first_outside[loop[hits[::-1]]] = hits[::-1] - found.start[loop[hits[::-1]]]
    place = nodes - found.start[loop]
    order = found.start[loop] + (place + first_outside[loop]) % length[loop]
    outside = outside[order]
    begins = np.zeros(len(nodes), bool)
    begins[found.start[:-1]] = True
    begins[1:] |= outside[1:] != outside[:-1]
    kept = ~outside
    start = np.flatnonzero(begins[kept])
    is_open = touching[loop[kept][start]]
    order = order[kept]
    pieces = Contours(
        np.append(start, len(order)),
        found.step_x[order],
        found.step_y[order],
        found.cell[order],
        found.padded,
    )
    return pieces, is_open, None if entered is None else entered[order]
