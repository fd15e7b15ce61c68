r"""Contour loops through random points of a surface (the paper's Appendix C).

A loop lives on the dual lattice, whose points are the centres of plaquettes. Each of its steps
crosses one bond between a site above the level and a site that is not. At a saddle plaquette, whose
signs alternate, the mean of the four heights decides: below the level the sites above it lie inside
the two 90-degree turns, above it outside. The level of a loop is the mean height of the plaquette
it starts in, so that a start at a saddle is undecided: a fair coin takes the level just above or
just below that mean, once for the whole loop.

All walkers of all surfaces step at once. What a walker entering plaquette P does depends on its two
far heights a (left) and b (right), on the plaquette's mean m and on the level c. With sites above
the level on its left it turns

$$\text{left iff } \max(a, \min(b, m)) \le c, \qquad \text{right iff } \min(b, \max(a, m)) > c,$$

and goes straight otherwise. The two thresholds are tabulated for every plaquette and direction of
entry, so that a step is one look-up, two comparisons and one addition.

NumPy alone.
"""

from collections.abc import Iterable
from dataclasses import dataclass
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
)

Heights = Num[Any, "*surface x y"] | Iterable[Num[Any, "*surface x y"]]

SITES_AT_ONCE = 8_000_000  # sites of the maps whose thresholds are held together
WALKERS_AT_ONCE = 16_384
ATTEMPTS = 200  # starts tried before a surface counts as one without contours

# Directions 0 ... 3 are +x, +y, -x, -y. The corners of plaquette (i, j), counterclockwise, are
# (i, j), (i+1, j), (i+1, j+1), (i, j+1). A walker moving in direction d has corner d behind it on
# its right, d + 1 ahead on its right, d + 2 ahead on its left and d + 3 behind it on its left.
STEP_X = np.array([1, 0, -1, 0])
STEP_Y = np.array([0, 1, 0, -1])


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
    limit = max(1, min(SITES_AT_ONCE, 40 * WALKERS_AT_ONCE * SITES_AT_ONCE // points))
    parts = [
        _trace_batch(maps, points, seed, correlation, boundary == "open", spacing)
        for maps in batches(heights, mask, seed, limit)
    ]
    return Loops.join(parts)


@dataclass(frozen=True)
class _Board:
    """The thresholds of every plaquette and direction of a batch of maps with margins.

    The state of a walker is one integer, 4 * plaquette + direction; a step adds `offsets` to it.
    The margin repeats the periodic map, so that walkers need bringing home only every `margin`
    steps.
    """

    table: np.ndarray  # complex: thresholds (left, right) of each state, side by side
    means: np.ndarray  # [surface, x, y] of the plaquettes without margin
    shape: tuple[int, int]  # sites of a map
    padded: tuple[int, int]  # plaquettes of a map with its margin
    margin: int
    outside: np.ndarray | None  # plaquettes with an invalid site, flat, if there are any

    @property
    def row(self) -> int:
        """What one step along x adds to a state."""
        return 4 * self.padded[1]


def _board(maps: Maps, is_open: bool) -> _Board:
    heights, valid = maps.heights, maps.valid
    shape = heights.shape[1], heights.shape[2]
    margin = int(np.clip(min(shape) // 16, 8, 32))
    around = ((0, 0), (margin, margin + 1), (margin, margin + 1))
    if valid is not None or is_open:
        valid = np.ones(heights.shape, bool) if valid is None else valid
        heights = np.where(valid, heights, -np.inf)
        valid = np.pad(valid, around, mode="constant" if is_open else "wrap")
    if is_open:
        heights = np.pad(heights, around, mode="constant", constant_values=-np.inf)
    else:
        heights = np.pad(heights, around, mode="wrap")
    corners = [heights[:, x, y] for x, y in _CORNERS]
    means = ((corners[0] + corners[2]) + (corners[1] + corners[3])) * heights.dtype.type(0.25)
    below = [np.minimum(h, means) for h in corners]
    above = [np.maximum(h, means) for h in corners]
    table = np.empty((*means.shape, 4, 2), heights.dtype)
    for d in range(4):
        left, right = (d + 2) % 4, (d + 1) % 4
        np.maximum(corners[left], below[right], out=table[..., d, 0])
        np.minimum(corners[right], above[left], out=table[..., d, 1])
    outside = None
    if valid is not None:
        inside = [valid[:, x, y] for x, y in _CORNERS]
        outside = ~(inside[0] & inside[1] & inside[2] & inside[3]).ravel()
    inner = slice(margin, -margin)
    pair = np.complex64 if heights.dtype == np.float32 else np.complex128
    return _Board(
        table.view(pair).reshape(-1),
        means[:, inner, inner],
        shape,
        means.shape[1:],
        margin,
        outside,
    )


_LOW, _HIGH = slice(None, -1), slice(1, None)
_CORNERS = ((_LOW, _LOW), (_HIGH, _LOW), (_HIGH, _HIGH), (_LOW, _HIGH))


@dataclass(frozen=True)
class _Starts:
    """Where each loop starts and at what level: site of the plaquette, direction, all flat."""

    surface: np.ndarray
    x: np.ndarray
    y: np.ndarray
    direction: np.ndarray
    mean: np.ndarray
    level: np.ndarray  # a site is above the loop if its height is greater than this
    redrawn: int


def _draws(seed: int, stream: int, first: int, shape: tuple[int, int]) -> np.ndarray:
    """Uniform numbers [surface, point] that depend on the surface's number and not on the batch."""
    bits = np.random.PCG64(np.random.SeedSequence(seed, spawn_key=(stream,)))
    return np.random.Generator(bits.advance(first * shape[1])).random(shape)


def _starts(maps: Maps, board: _Board, points: int, seed: int) -> _Starts:
    """Draw starting plaquettes, again where two heights coincide with the level."""
    surfaces = len(maps.heights)
    sites, side = board.shape[0] * board.shape[1], board.shape[1]
    if board.outside is None:
        allowed = None
        first, count = np.arange(surfaces) * sites, np.full(surfaces, sites)
    else:
        inner = slice(board.margin, -board.margin)
        usable = ~board.outside.reshape(surfaces, *board.padded)[:, inner, inner]
        allowed = np.flatnonzero(usable)
        count = np.count_nonzero(usable, (1, 2))
        first = np.cumsum(count) - count
    heights, means = maps.heights.ravel(), board.means.reshape(-1)
    flat = np.zeros((surfaces, points), np.int64)
    level = np.zeros((surfaces, points), heights.dtype)
    enter = np.zeros((surfaces, points, 4), bool)
    pending = np.ones((surfaces, points), bool)
    redrawn = 0
    for attempt in range(ATTEMPTS):
        place = _draws(seed, 2 + 2 * attempt, maps.first, (surfaces, points))[pending]
        coin = _draws(seed, 3 + 2 * attempt, maps.first, (surfaces, points))[pending] < 0.5
        row = np.nonzero(pending)[0]
        chosen = first[row] + np.floor(place * count[row]).astype(np.int64)
        chosen = chosen if allowed is None else allowed[chosen]
        mean = means[chosen]
        corners = heights[_corner_sites(chosen, board.shape)]
        flat[pending] = chosen
        level[pending] = np.where(coin, mean, np.nextafter(mean, heights.dtype.type(-np.inf)))
        signs = corners > level[pending][:, None]
        enter[pending] = np.roll(signs, 1, 1) & ~signs
        tied = (corners == mean[:, None]).any(1) & (attempt < ATTEMPTS // 2)
        pending[pending] = tied | ~enter[pending].any(1)
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
    second = _draws(seed, 1, maps.first, (surfaces, points)) < 0.5
    last = 3 - np.argmax(enter[..., ::-1], -1)
    direction = np.where(second, last, np.argmax(enter, -1))
    surface, site = np.divmod(flat.ravel(), sites)
    return _Starts(
        surface,
        site // side,
        site % side,
        direction.ravel(),
        means[flat.ravel()],
        level.ravel(),
        redrawn,
    )


def _corner_sites(flat: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """The four sites around each plaquette, counterclockwise, as flat indices [plaquette, 4]."""
    surface, site = np.divmod(flat, shape[0] * shape[1])
    x, y = np.divmod(site, shape[1])
    right, up = (x + 1) % shape[0], (y + 1) % shape[1]
    sites = np.stack([x, right, right, x], 1) * shape[1] + np.stack([y, y, up, up], 1)
    return surface[:, None] * (shape[0] * shape[1]) + sites


@dataclass
class _Walkers:
    """What is known of each walker; one array an attribute, one entry a walker.

    Positions are in the frame of the board; when a walker is brought home by a period, its start
    moves along, so that differences are always those of the unwrapped loop.
    """

    number: np.ndarray  # which start it belongs to
    row: np.ndarray  # what to take off state // board.row to get x
    state: np.ndarray
    target: np.ndarray  # the state that closes the loop
    level: np.ndarray
    x: np.ndarray  # of the start
    y: np.ndarray
    low_x: np.ndarray  # extents, relative to the start
    high_x: np.ndarray
    low_y: np.ndarray
    high_y: np.ndarray
    area: np.ndarray
    steps: np.ndarray

    def keep(self, rows: np.ndarray) -> "_Walkers":
        return _Walkers(*(getattr(self, name)[rows] for name in self.__dataclass_fields__))

    def join(self, other: "_Walkers") -> "_Walkers":
        pairs = ((getattr(self, n), getattr(other, n)) for n in self.__dataclass_fields__)
        return _Walkers(*(np.concatenate(pair) for pair in pairs))


@dataclass
class _Found:
    """The finished loops, in the order of the starts."""

    length: np.ndarray
    radius: np.ndarray
    area: np.ndarray
    winding: np.ndarray
    is_open: np.ndarray


def _enter(board: _Board, starts: _Starts, numbers: np.ndarray) -> _Walkers:
    surface = starts.surface[numbers]
    x, y = starts.x[numbers] + board.margin, starts.y[numbers] + board.margin
    row = surface * board.padded[0]
    state = (row + x) * board.row + 4 * y + starts.direction[numbers]
    zeros = [np.zeros(len(numbers), np.int64) for _ in range(6)]
    return _Walkers(numbers, row, state, state.copy(), starts.level[numbers], x, y, *zeros)


def _walk(
    board: _Board, starts: _Starts, numbers: np.ndarray, pairs: np.ndarray | None, sign: int
) -> _Found:
    """Walk the loops of the given starts; add `sign` times their points to `pairs[surface, r]`."""
    total = len(starts.x)
    found = _Found(
        np.zeros(total, np.int64),
        np.zeros(total, np.int64),
        np.zeros(total, np.int64),
        np.zeros((total, 2), np.int64),
        np.zeros(total, bool),
    )
    walkers = _enter(board, starts, numbers[:WALKERS_AT_ONCE])
    waiting = numbers[WALKERS_AT_ONCE:]
    offsets = _offsets(board)
    while len(walkers.state):
        path = _take_steps(board, offsets, walkers)
        ended, last, winding, is_open = _closings(board, walkers, path)
        if len(ended):
            # A closed walker stands still for the rest of the block.
            still = np.arange(len(path))[:, None] > last
            path[:, ended] = np.where(still, path[last, ended], path[:, ended])
        x, y = _measure(board, walkers, path)
        if pairs is not None:
            _count_pairs(board, walkers, x, y, pairs, sign)
        walkers.steps += len(path) - 1
        if len(ended):
            done = walkers.number[ended]
            found.length[done] = walkers.steps[ended] - (len(path) - 1) + last
            found.radius[done] = np.maximum(
                walkers.high_x[ended] - walkers.low_x[ended],
                walkers.high_y[ended] - walkers.low_y[ended],
            )
            found.winding[done] = winding
            found.is_open[done] = is_open
            trivial = ~is_open & ~winding.any(1)
            found.area[done] = np.where(trivial, walkers.area[ended], 0)
            going = np.ones(len(walkers.state), bool)
            going[ended] = False
            walkers.state = path[-1]
            walkers = walkers.keep(going)
        else:
            walkers.state = path[-1]
        _bring_home(board, walkers)
        if len(waiting) and len(walkers.state) < WALKERS_AT_ONCE // 2:
            free = WALKERS_AT_ONCE - len(walkers.state)
            walkers = walkers.join(_enter(board, starts, waiting[:free]))
            waiting = waiting[free:]
    return found


def _offsets(board: _Board) -> np.ndarray:
    """What a step adds to the state, indexed by direction + 256 * left + 65536 * right."""
    table = np.zeros(4 + 256 + 65536, np.int64)
    for direction in range(4):
        for code, turn in ((0, 0), (256, 1), (65536, -1)):
            new = (direction + turn) % 4
            move = board.row * STEP_X[new] + 4 * STEP_Y[new]
            table[direction + code] = move + new - direction
    return table


def _take_steps(board: _Board, offsets: np.ndarray, walkers: _Walkers) -> np.ndarray:
    """The states [step, walker] of the next `margin` steps, the present one first."""
    path = np.empty((board.margin + 1, len(walkers.state)), np.int64)
    path[0] = walkers.state
    level = walkers.level
    count = len(level)
    found = np.empty(count, board.table.dtype)
    thresholds = found.view(level.dtype)
    left_of, right_of = thresholds[0::2], thresholds[1::2]
    index = np.empty(count, np.int64)
    turns_left, turns_right = index.view(bool)[_SECOND_BYTE::8], index.view(bool)[_THIRD_BYTE::8]
    step = np.empty(count, np.int64)
    table, three = board.table, np.int64(3) * np.ones((), np.int64)
    for now, then in zip(path[:-1], path[1:], strict=True):
        table.take(now, out=found, mode="clip")
        np.bitwise_and(now, three, out=index)
        np.less_equal(left_of, level, out=turns_left)
        np.greater(right_of, level, out=turns_right)
        offsets.take(index, out=step, mode="clip")
        np.add(now, step, out=then)
    return path


_SECOND_BYTE, _THIRD_BYTE = (1, 2) if np.little_endian else (6, 5)


def _closings(
    board: _Board, walkers: _Walkers, path: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Which walkers end within the block, after how many of its steps, and how.

    Returns:
        columns, steps, winding vectors and whether the loop left the map.
    """
    returns = path[1:] == walkers.target
    columns = returns.any(0)
    # Only a loop as wide as the map can wind around it.
    reach = 2 * len(path)
    columns |= walkers.high_x - walkers.low_x + reach >= board.shape[0]
    columns |= walkers.high_y - walkers.low_y + reach >= board.shape[1]
    left_map = None if board.outside is None else board.outside[path[1:] >> 2]
    if left_map is not None:
        columns |= left_map.any(0)
    some = np.flatnonzero(columns)
    states = path[1:, some]
    x, rest = np.divmod(states, board.row)
    away_x = x - walkers.row[some] - walkers.x[some]
    away_y = (rest >> 2) - walkers.y[some]
    closed = (states & 3) == (walkers.target[some] & 3)
    closed &= away_x % board.shape[0] == 0
    closed &= away_y % board.shape[1] == 0
    ends = closed if left_map is None else closed | left_map[:, some]
    ending = ends.any(0)
    first = np.argmax(ends[:, ending], 0)
    column = np.flatnonzero(ending)
    winding = np.stack(
        [away_x[first, column] // board.shape[0], away_y[first, column] // board.shape[1]], 1
    )
    is_open = np.zeros(len(column), bool)
    if left_map is not None:
        is_open = left_map[:, some][first, column]
        winding[is_open] = 0
    return some[ending], first + 1, winding, is_open


def _measure(board: _Board, walkers: _Walkers, path: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Update extents and area; return the positions [step, walker] relative to the starts."""
    x, y = np.divmod(path, board.row)
    x -= walkers.row + walkers.x
    y >>= 2
    y -= walkers.y
    np.maximum(walkers.high_x, x.max(0), out=walkers.high_x)
    np.minimum(walkers.low_x, x.min(0), out=walkers.low_x)
    np.maximum(walkers.high_y, y.max(0), out=walkers.high_y)
    np.minimum(walkers.low_y, y.min(0), out=walkers.low_y)
    walkers.area += np.einsum("tn,tn->n", x[:-1], np.diff(y, axis=0))
    return x[1:], y[1:]


def _count_pairs(
    board: _Board, walkers: _Walkers, x: np.ndarray, y: np.ndarray, pairs: np.ndarray, sign: int
) -> None:
    """Count the points at distance [r, r + 1) from the start, r = 0 and r beyond `pairs` apart."""
    bins = pairs.shape[1]
    distance = np.sqrt(x * x + y * y).astype(np.int64)
    np.minimum(distance, bins - 1, out=distance)
    distance += walkers.row // board.padded[0] * bins
    pairs += sign * np.bincount(distance.ravel(), minlength=pairs.size).reshape(pairs.shape)


def _bring_home(board: _Board, walkers: _Walkers) -> None:
    """Move walkers that stand in the margin by whole periods into the map."""
    x, rest = np.divmod(walkers.state, board.row)
    x -= walkers.row
    y = rest >> 2
    move_x = (x - board.margin) // board.shape[0] * board.shape[0]
    move_y = (y - board.margin) // board.shape[1] * board.shape[1]
    move = board.row * move_x + 4 * move_y
    walkers.state = walkers.state - move
    walkers.target = walkers.target - move
    walkers.x = walkers.x - move_x
    walkers.y = walkers.y - move_y


def _trace_batch(
    maps: Maps, points: int, seed: int, correlation: bool, is_open: bool, spacing: float
) -> Loops:
    board = _board(maps, is_open)
    starts = _starts(maps, board, points, seed)
    surfaces = len(maps.heights)
    pairs = None
    if correlation:  # the last bin collects what is farther than any curve reaches
        pairs = np.zeros((surfaces, max(board.shape) + 1), np.int64)
    everyone = np.arange(len(starts.x))
    found = _walk(board, starts, everyone, pairs, 1)
    left_out = np.flatnonzero(found.is_open | found.winding.any(1))
    if pairs is not None:
        _walk(board, starts, left_out, pairs, -1)  # take back the points of loops that do not count
        pairs[:, 0] = 0
        pairs = pairs[:, :-1]
    return Loops(
        length=found.length,
        radius=found.radius,
        area=found.area,
        winding=found.winding,
        is_open=found.is_open,
        surface=starts.surface,
        level=starts.mean.astype(np.float64),
        surfaces=surfaces,
        shape=board.shape,
        spacing=spacing,
        sampling="points",
        boundary="open" if is_open else "periodic",
        pairs=pairs,
        redrawn=starts.redrawn,
        notes=maps.notes,
    )
