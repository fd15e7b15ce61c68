"""Starting points of traced loops: random plaquettes and the levels of the loops through them.

The level is the plaquette's own mean, so that a start at a saddle is undecided; a fair coin takes
the level just above or just below that mean, once for the whole loop, which keeps h -> -h and
reversal symmetries of the ensemble. Alternatively the level is uniform between the plaquette's
lowest and highest height.

NumPy alone.
"""

from dataclasses import dataclass

import numpy as np

from jaxsurf.loops.maps import Maps, whole_plaquettes
from jaxsurf.loops.walk import Starts, mean_height

ATTEMPTS = 200  # starts tried before a surface counts as one without contours


@dataclass(frozen=True)
class Drawn:
    """Starting points with what is remembered of how they were drawn, one entry a start.

    Attributes:
        starts: where the walks begin.
        height: the level, as drawn.
        weight: the plaquette's range of heights times its strands at the level. Averages over loops
            with this weight are those over whole level sets, weighted by length: exactly so if the
            level was uniform in that range, and nearly if it was the mean.
        redrawn: how many starts were drawn again.
    """

    starts: Starts
    height: np.ndarray
    weight: np.ndarray
    redrawn: int


def draw_starts(maps: Maps, points: int, seed: int, level: str = "mean") -> Drawn:
    """Draw starting plaquettes, again where a height coincides with the level.

    Arguments:
        maps: the maps.
        points: starts on each.
        seed: of the draws, which depend on a surface's number and not on the batch.
        level: "mean" or "uniform", of the four heights.
    """
    surfaces, *sides = maps.heights.shape
    sites = sides[0] * sides[1]
    places = None if maps.valid is None else np.flatnonzero(whole_plaquettes(maps.valid))
    if places is None:
        first, count = np.arange(surfaces) * sites, np.full(surfaces, sites)
    else:
        count = np.bincount(places // sites, minlength=surfaces)
        first = np.cumsum(count) - count
    heights = maps.heights.ravel()
    plaquette = np.zeros((surfaces, points), np.int64)
    height, threshold = np.zeros((2, surfaces, points), heights.dtype)
    weight = np.zeros((surfaces, points))
    entries = np.zeros((surfaces, points, 4), bool)
    pending = np.ones((surfaces, points), bool)
    redrawn = 0
    for attempt in range(ATTEMPTS):
        place = uniform_draws(seed, 2 + 2 * attempt, maps.first, pending.shape)[pending]
        chance = uniform_draws(seed, 3 + 2 * attempt, maps.first, pending.shape)[pending]
        row = np.nonzero(pending)[0]
        chosen = first[row] + np.floor(place * count[row]).astype(np.int64)
        chosen = chosen if places is None else places[chosen]
        corners = heights[_corner_sites(chosen, sides[0], sides[1])]
        reach = np.ptp(corners, 0)
        if level == "mean":
            # Sites above are those higher than the threshold: moving it by one rounding unit
            # decides a saddle whose mean it is, and nothing else.
            drawn = mean_height(*corners)
            below = np.nextafter(drawn, heights.dtype.type(-np.inf))
            limit = np.where(chance < 0.5, drawn, below)
        else:
            limit = drawn = corners.min(0) + reach * chance.astype(heights.dtype)
        above = corners > limit
        enters = np.roll(above, 1, 0) & ~above  # in which directions the contour enters
        plaquette[pending], height[pending], threshold[pending] = chosen, drawn, limit
        weight[pending], entries[pending] = reach * enters.sum(0), enters.T
        tied = (corners == drawn).any(0) & (attempt < ATTEMPTS // 2)
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
    second = uniform_draws(seed, 1, maps.first, pending.shape) < 0.5
    direction = np.where(second, 3 - np.argmax(entries[..., ::-1], -1), np.argmax(entries, -1))
    surface, place = np.divmod(plaquette.ravel(), sites)
    x, y = np.divmod(place, sides[1])
    starts = Starts(surface, x, y, direction.ravel(), threshold.ravel())
    return Drawn(starts, height.ravel().astype(np.float64), weight.ravel(), redrawn)


def uniform_draws(seed: int, stream: int, first: int, shape: tuple[int, ...]) -> np.ndarray:
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
