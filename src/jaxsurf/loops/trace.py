r"""Contour loops through random points of a surface (the paper's Appendix C).

A loop lives on the dual lattice, whose points are the centres of plaquettes. Each of its steps
crosses one bond between a site above the level and a site that is not. At a saddle plaquette, whose
signs alternate, the mean of the four heights decides: below the level the sites above it lie inside
the two 90-degree turns, above it outside. The level of a loop is the mean height of the plaquette
it starts in, so that a start at a saddle is undecided: a fair coin takes the level just above or
just below that mean, once for the whole loop.

NumPy alone.
"""

from typing import Any

import numpy as np
from jaxtyping import Bool

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
)
from jaxsurf.loops.starts import draw_starts
from jaxsurf.loops.walk import lay_out, walk

SITES_AT_ONCE = 8_000_000  # of the maps whose thresholds are held together
LEVELS = ("mean", "uniform")


def trace_loops(
    heights: Heights,
    points: int = 400,
    *,
    rng: np.random.Generator | int,
    level: str = "mean",
    correlation: bool = False,
    boundary: str = "periodic",
    mask: Bool[Any, "*surfaces x y"] | None = None,
    spacing: float | int = 1.0,
    step: float | int | None = None,
) -> Loops:
    r"""Trace the contour loop through each of many random points of each surface.

    A point is a plaquette drawn uniformly and the level is that plaquette's mean height, so a loop
    is found in proportion to its length and to the inverse of the gradient along it. Loops that
    wind around a periodic map, or run into the edge of an open one, are kept but marked, and the
    statistics leave them out.

    Arguments:
        heights: maps `[x, y]` or `[surface, x, y]`, or an iterable of such arrays that is read one
            array at a time. Heights in steps are dithered, and the result says so.
        points: starting points on each surface.
        rng: a Generator, or the seed of one.
        level: "mean", of the plaquette's four heights, as the paper has it; or "uniform" between
            the lowest and the highest of them, with which averages `per="length"` are exactly
            those over whole level sets.
        correlation: also count the points of each loop at each distance from its start, for G(r).
        boundary: "periodic", or "open" for a map with edges.
        mask: true on valid sites; loops that touch an invalid one are open.
        spacing: lattice constant, the unit of length of the curves.
        step: of the heights, in their unit, if they come in steps (counts of a converter times a
            scale). If None it is looked for; heights in steps are dithered.

    Returns:
        `Loops`, one entry a starting point, surface by surface.

    Raises:
        ValueError: heights that are not finite, constant, smaller than 4 x 4 or not maps; `points`
            below 1; a mask that leaves no plaquette; a map on which no start can be found.
        TypeError: complex heights, an `rng` that is neither a Generator nor an integer.

    Source: the paper's Appendix C, with the start at a saddle decided by a coin.

    >>> heights = np.random.default_rng(0).standard_normal((3, 64, 64))
    >>> loops = trace_loops(heights, points=100, rng=0)
    >>> len(loops), int(loops.length.min())
    (300, 4)
    """
    points = check_count("points", points)
    spacing = check_spacing(spacing)
    check_choice("boundary", boundary, BOUNDARIES)
    check_choice("level", level, LEVELS)
    seed = seed_of(rng)
    parts = [
        _trace_batch(maps, points, seed, level, correlation, boundary, spacing)
        for maps in batches(heights, mask, seed, boundary, SITES_AT_ONCE, check_step(step))
    ]
    return Loops.join(parts)


def _trace_batch(
    maps: Maps,
    points: int,
    seed: int,
    level: str,
    correlation: bool,
    boundary: str,
    spacing: float,
) -> Loops:
    drawn = draw_starts(maps, points, seed, level)
    starts = drawn.starts
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
        level=drawn.height,
        weight=drawn.weight,
        surfaces=len(maps.heights),
        shape=maps.shape,
        spacing=spacing,
        sampling="points",
        boundary=boundary,
        pairs=pairs,
        redrawn=drawn.redrawn,
        notes=maps.notes,
    )
