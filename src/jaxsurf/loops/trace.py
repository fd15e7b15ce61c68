r"""Contour loops through random points of a surface (the paper's Appendix C).

A loop lives on the dual lattice, whose points are the centres of plaquettes. Each of its steps
crosses one bond between a site above the level and a site that is not. At a saddle plaquette, whose
signs alternate, the mean of the four heights decides: below the level the sites above it lie inside
the two 90-degree turns, above it outside. The level of a loop is the mean height of the plaquette
it starts in, so that a start at a saddle is undecided: a fair coin takes the level just above or
just below that mean, once for the whole loop.

NumPy alone.
"""

from collections.abc import Iterable
from typing import Any

import numpy as np
from jaxtyping import Bool, Num

from jaxsurf.loops.loops import Loops
from jaxsurf.loops.maps import (
    BOUNDARIES,
    Maps,
    batches,
    check_choice,
    check_count,
    check_spacing,
    seed_of,
    whole_plaquettes,
)
from jaxsurf.loops.walk import Starts, lay_out, mean_height, walk

Heights = Num[Any, "*surface x y"] | Iterable[Num[Any, "*surface x y"]]

SITES_AT_ONCE = 8_000_000  # of the maps whose thresholds are held together
ATTEMPTS = 200  # starts tried before a surface counts as one without contours


def trace_loops(
    heights: Heights,
    points: int = 400,
    *,
    rng: np.random.Generator | int,
    correlation: bool = False,
    boundary: str = "periodic",
    mask: Bool[Any, "*surface x y"] | None = None,
    spacing: float = 1.0,
) -> Loops:
    r"""Trace the contour loop through each of many random points of each surface.

    A point is a plaquette drawn uniformly and the level is that plaquette's mean height, so a loop
    is found in proportion to its length and to the inverse of the gradient along it. Loops that
    wind around a periodic map, or run into the edge of an open one, are kept but marked, and the
    statistics leave them out.

    Arguments:
        heights: maps `[x, y]` or `[surface, x, y]`, or an iterable of such arrays that is read one
            array at a time. Integer heights are dithered, and the result says so.
        points: starting points on each surface.
        rng: a Generator, or the seed of one.
        correlation: also count the points of each loop at each distance from its start, for G(r).
        boundary: "periodic", or "open" for a map with edges.
        mask: true on valid sites; loops that touch an invalid one are open.
        spacing: lattice constant, the unit of length of the curves.

    Returns:
        `Loops`, one entry a starting point, surface by surface.

    Raises:
        ValueError: heights that are not finite, constant, smaller than 4 x 4 or not maps; `points`
            below 1; a mask that leaves no plaquette; a map on which no start can be found.
        TypeError: complex heights, an `rng` that is neither a Generator nor an integer.

    Source: the paper's Appendix C, with the start at a saddle decided by a coin.
    """
    points = check_count("points", points)
    spacing = check_spacing(spacing)
    check_choice("boundary", boundary, BOUNDARIES)
    seed = seed_of(rng)
    parts = [
        _trace_batch(maps, points, seed, correlation, boundary, spacing)
        for maps in batches(heights, mask, seed, boundary, SITES_AT_ONCE)
    ]
    return Loops.join(parts)


def _trace_batch(
    maps: Maps, points: int, seed: int, correlation: bool, boundary: str, spacing: float
) -> Loops:
    starts, level, redrawn = _draw_starts(maps, points, seed)
    board = lay_out(maps.heights, maps.valid)
    pairs = None
    if correlation:  # the last bin collects what is farther than any curve reaches
        pairs = np.zeros((len(maps.heights), max(maps.shape) + 1), np.int64)
    everyone = np.arange(len(starts.x))
    found = walk(board, starts, everyone, pairs, 1)
    if pairs is not None:  # take back the points of the loops that do not count
        left_out = np.flatnonzero(found.is_open | found.winding.any(1))
        walk(board, starts, left_out, pairs, -1)
        pairs = np.concatenate([np.zeros_like(pairs[:, :1]), pairs[:, 1:-1]], 1)
    return Loops(
        length=found.length,
        radius=found.radius,
        area=found.area,
        winding=found.winding,
        is_open=found.is_open,
        surface=starts.surface,
        level=level,
        surfaces=len(maps.heights),
        shape=maps.shape,
        spacing=spacing,
        sampling="points",
        boundary=boundary,
        pairs=pairs,
        redrawn=redrawn,
        notes=maps.notes,
    )


def _draw_starts(maps: Maps, points: int, seed: int) -> tuple[Starts, np.ndarray, int]:
    """Draw starting plaquettes, again where two heights coincide with the level.

    Returns:
        The starts, their levels (the plaquettes' means), and how many were drawn again.
    """
    surfaces, *sides = maps.heights.shape
    places = None if maps.valid is None else np.flatnonzero(whole_plaquettes(maps.valid))
    if places is None:
        first, count = (
            np.arange(surfaces) * (sides[0] * sides[1]),
            np.full(surfaces, sides[0] * sides[1]),
        )
    else:
        count = np.bincount(places // (sides[0] * sides[1]), minlength=surfaces)
        first = np.cumsum(count) - count
    heights = maps.heights.ravel()
    plaquette = np.zeros((surfaces, points), np.int64)
    mean = np.zeros((surfaces, points), heights.dtype)
    level = np.zeros((surfaces, points), heights.dtype)
    entries = np.zeros((surfaces, points, 4), bool)
    pending = np.ones((surfaces, points), bool)
    redrawn = 0
    for attempt in range(ATTEMPTS):
        place = _draws(seed, 2 + 2 * attempt, maps.first, pending.shape)[pending]
        coin = _draws(seed, 3 + 2 * attempt, maps.first, pending.shape)[pending] < 0.5
        row = np.nonzero(pending)[0]
        chosen = first[row] + np.floor(place * count[row]).astype(np.int64)
        chosen = chosen if places is None else places[chosen]
        corners = heights[_corner_sites(chosen, sides[0], sides[1])]
        means = mean_height(*corners)
        # Sites above the level are those higher than it: moving the level by one rounding unit
        # decides a saddle whose mean it is, and nothing else.
        levels = np.where(coin, means, np.nextafter(means, heights.dtype.type(-np.inf)))
        above = corners > levels
        enters = np.roll(above, 1, 0) & ~above  # in which directions the contour enters
        plaquette[pending], mean[pending], level[pending] = chosen, means, levels
        entries[pending] = enters.T
        tied = (corners == means).any(0) & (attempt < ATTEMPTS // 2)
        pending[pending] = tied | ~enters.any(0)
        if not pending.any():
            break
        redrawn += int(np.count_nonzero(pending))
    else:
        raise ValueError(
            f"no contour found through {ATTEMPTS} random plaquettes of surface "
            f"{maps.first + int(np.argmax(pending.any(1)))}: nearly all its heights are equal. "
            "Leave that surface out, or mask its flat parts."
        )
    # At a saddle two strands of the level pass; either is the start with equal chance.
    second = _draws(seed, 1, maps.first, pending.shape) < 0.5
    direction = np.where(second, 3 - np.argmax(entries[..., ::-1], -1), np.argmax(entries, -1))
    surface, place = np.divmod(plaquette.ravel(), sides[0] * sides[1])
    x, y = np.divmod(place, sides[1])
    starts = Starts(surface, x, y, direction.ravel(), level.ravel())
    return starts, mean.ravel().astype(np.float64), redrawn


def _draws(seed: int, stream: int, first: int, shape: tuple[int, ...]) -> np.ndarray:
    """Uniform numbers [surface, point] that depend on the surface's number and not on the batch."""
    bits = np.random.PCG64(np.random.SeedSequence(seed, spawn_key=(stream,)))
    return np.random.Generator(bits.advance(first * shape[1])).random(shape)


def _corner_sites(plaquette: np.ndarray, side_x: int, side_y: int) -> np.ndarray:
    """The four sites around each plaquette, counterclockwise, as flat indices [4, plaquette]."""
    surface, place = np.divmod(plaquette, side_x * side_y)
    x, y = np.divmod(place, side_y)
    right, up = (x + 1) % side_x, (y + 1) % side_y
    sites = np.stack([x, right, right, x]) * side_y + np.stack([y, y, up, up])
    return surface * (side_x * side_y) + sites
