r"""Walking: all walkers of all maps follow their contours in lockstep.

A walker keeps the sites above its level on its left. What it does on entering a plaquette depends
on the two far heights a (left) and b (right), on the plaquette's mean m and on its level c: it
turns

$$\text{left iff } \max(a, \min(b, m)) \le c, \qquad \text{right iff } \min(b, \max(a, m)) > c,$$

and goes straight otherwise; the mean matters at saddles alone. The two thresholds are tabulated for
every plaquette and direction of entry, so that a step is one look-up, two comparisons and one
addition for as many walkers as there are. Everything else (extents, area, distances, whether a
loop has closed) is worked out for a block of steps at a time.

NumPy alone.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np

from jaxsurf.loops.maps import whole_plaquettes

WALKERS_AT_ONCE = 2048  # a block of their steps fits the cache
PLAQUETTES_AT_ONCE = 16384  # plaquettes whose thresholds are worked out together, likewise

# Directions 0 ... 3 are +x, +y, -x, -y. The corners of plaquette (i, j), counterclockwise, are
# (i, j), (i+1, j), (i+1, j+1), (i, j+1). A walker moving in direction d has corner d behind it on
# its right, d + 1 ahead on its right, d + 2 ahead on its left and d + 3 behind it on its left.
STEP_X = np.array([1, 0, -1, 0])
STEP_Y = np.array([0, 1, 0, -1])


@dataclass(frozen=True)
class Board:
    """The thresholds of every plaquette and direction of a batch of periodic maps with margins.

    The state of a walker is one integer, 4 * plaquette + direction; a step adds an offset to it.
    The margin repeats the map, so that walkers need bringing home only after a block of steps.
    """

    table: np.ndarray  # complex: thresholds (left, right) of each state, side by side
    outside: np.ndarray | None  # plaquettes with an invalid site, flat, if there are any
    surfaces: int
    shape: tuple[int, int]  # sites of a map
    padded: tuple[int, int]  # plaquettes of a map with its margin
    margin: int

    @property
    def row(self) -> int:
        """What one step along x adds to a state."""
        return 4 * self.padded[1]

    @property
    def block(self) -> int:
        """Steps taken at once: within the margin, and too few to pass two images of one place."""
        return min(self.margin, *(side - 1 for side in self.shape))


def lay_out(heights: np.ndarray, valid: np.ndarray | None) -> Board:
    """Tabulate the thresholds of maps `[surface, x, y]`; invalid sites are at -inf."""
    surfaces, *shape = heights.shape
    margin = int(np.clip(min(shape) // 16, 8, 32))
    padded = (shape[0] + 2 * margin, shape[1] + 2 * margin)
    row, column = (np.arange(-margin, side + margin + 1) % side for side in shape)
    table = np.empty((surfaces, *padded, 4, 2), heights.dtype)
    step = max(1, PLAQUETTES_AT_ONCE // padded[1])
    for surface, start in product(range(surfaces), range(0, padded[0], step)):
        sites = heights[surface].take(row[start : start + step + 1], 0).take(column, 1)
        low, high = sites[:-1], sites[1:]
        around = (low[:, :-1], high[:, :-1], high[:, 1:], low[:, 1:])
        corners = [np.ascontiguousarray(each) for each in around]
        means = mean_height(*corners)
        part = table[surface, start : start + step]
        for d in range(4):
            left, right = corners[(d + 2) % 4], corners[(d + 1) % 4]
            np.maximum(left, np.minimum(right, means), out=part[:, :, d, 0])
            np.minimum(right, np.maximum(left, means), out=part[:, :, d, 1])
    outside = None
    if valid is not None:
        outside = ~whole_plaquettes(valid).take(row[:-1], 1).take(column[:-1], 2).ravel()
    pair = np.complex64 if heights.dtype == np.float32 else np.complex128
    table = table.view(pair).reshape(-1)
    return Board(table, outside, surfaces, (shape[0], shape[1]), padded, margin)


def mean_height(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray) -> np.ndarray:
    """The mean of a plaquette's corners in cyclic order, rounded alike wherever that starts."""
    return ((a + c) + (b + d)) * a.dtype.type(0.25)


@dataclass(frozen=True)
class Starts:
    """Where each loop starts and at what level, one entry a loop; x and y are plaquettes."""

    surface: np.ndarray
    x: np.ndarray
    y: np.ndarray
    direction: np.ndarray
    level: np.ndarray  # a site is above the loop if its height is greater than this


@dataclass
class Found:
    """The finished loops, in the order of the starts."""

    length: np.ndarray
    radius: np.ndarray
    area: np.ndarray
    winding: np.ndarray
    is_open: np.ndarray


def walk(
    board: Board, starts: Starts, numbers: np.ndarray, pairs: np.ndarray | None, sign: int
) -> Found:
    """Walk the loops of the given starts; add `sign` times their points to `pairs[surface, r]`."""
    total = len(starts.x)
    found = Found(
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
        states = np.subtract(path, walkers.base, dtype=np.int32, casting="unsafe")
        x, y = _positions(board, walkers, states)
        box = _Box.around(x[1:], y[1:])
        ended, last, winding, is_open = _endings(board, walkers, path, states, box)
        if len(ended):
            # A loop that has ended stands still for the rest of the block.
            rows = np.minimum(np.arange(len(path))[:, None], last)
            x[:, ended], y[:, ended] = x[rows, ended], y[rows, ended]
            box.replace(ended, _Box.around(x[:, ended], y[:, ended]))
        walkers.box.grow(box)
        swept = y[1:] - y[:-1]
        swept *= x[:-1]
        walkers.area += np.add.reduce(swept, 0, np.int32)
        if pairs is not None:
            _count_pairs(board, walkers, x[1:], y[1:], pairs, sign)
        _bring_home(board, walkers, path[-1], x[-1], y[-1])
        if len(ended):
            done = walkers.number[ended]
            found.length[done] = walkers.steps[ended] + last
            found.radius[done] = np.where(winding.any(1), 0, walkers.box.size[ended])
            found.winding[done] = winding
            found.is_open[done] = is_open
            found.area[done] = np.where(is_open | winding.any(1), 0, walkers.area[ended])
            going = np.ones(len(path[0]), bool)
            going[ended] = False
            walkers = walkers.keep(going)
        walkers.steps += board.block
        if len(waiting) and len(walkers.state) < WALKERS_AT_ONCE:
            free = WALKERS_AT_ONCE - len(walkers.state)
            walkers = walkers.join(_enter(board, starts, waiting[:free]))
            waiting = waiting[free:]
    return found


@dataclass
class _Box:
    """The extents of each walker's path, relative to its start."""

    low_x: np.ndarray
    high_x: np.ndarray
    low_y: np.ndarray
    high_y: np.ndarray

    @staticmethod
    def around(x: np.ndarray, y: np.ndarray) -> "_Box":
        return _Box(x.min(0), x.max(0), y.min(0), y.max(0))

    @property
    def size(self) -> np.ndarray:
        """The larger side."""
        return np.maximum(self.high_x - self.low_x, self.high_y - self.low_y)

    def grow(self, other: "_Box") -> None:
        np.minimum(self.low_x, other.low_x, out=self.low_x)
        np.maximum(self.high_x, other.high_x, out=self.high_x)
        np.minimum(self.low_y, other.low_y, out=self.low_y)
        np.maximum(self.high_y, other.high_y, out=self.high_y)

    def replace(self, rows: np.ndarray, other: "_Box") -> None:
        for name in ("low_x", "high_x", "low_y", "high_y"):
            getattr(self, name)[rows] = getattr(other, name)


@dataclass
class _Walkers:
    """What is known of each walker; one array an attribute, one entry a walker.

    Positions are in the frame of the board; when a walker is brought home by a period, its start
    moves along, so that differences are always those of the unwrapped loop.
    """

    number: np.ndarray  # which start it belongs to
    base: np.ndarray  # the first state of its surface
    state: np.ndarray
    direction: np.ndarray  # of the start
    level: np.ndarray
    x: np.ndarray  # of the start
    y: np.ndarray
    area: np.ndarray
    steps: np.ndarray
    box: _Box

    def keep(self, rows: np.ndarray) -> "_Walkers":
        box = _Box(*(each[rows] for each in vars(self.box).values()))
        arrays = {name: each[rows] for name, each in vars(self).items() if name != "box"}
        return _Walkers(**arrays, box=box)

    def join(self, other: "_Walkers") -> "_Walkers":
        pairs = zip(vars(self.box).values(), vars(other.box).values(), strict=True)
        box = _Box(*map(np.concatenate, pairs))
        pairs = {
            name: (each, vars(other)[name]) for name, each in vars(self).items() if name != "box"
        }
        return _Walkers(**{name: np.concatenate(pair) for name, pair in pairs.items()}, box=box)


def _enter(board: Board, starts: Starts, numbers: np.ndarray) -> _Walkers:
    x, y = starts.x[numbers] + board.margin, starts.y[numbers] + board.margin
    base = starts.surface[numbers] * (board.padded[0] * board.row)
    direction = starts.direction[numbers]
    state = base + x * board.row + 4 * y + direction
    nothing = np.zeros(len(numbers), np.int64)
    box = _Box(*(np.zeros(len(numbers), np.int32) for _ in range(4)))
    level = starts.level[numbers]
    return _Walkers(numbers, base, state, direction, level, x, y, nothing, nothing.copy(), box)


def _offsets(board: Board) -> np.ndarray:
    """What a step adds to the state, indexed by direction + 256 * left + 65536 * right."""
    table = np.zeros(4 + 256 + 65536, np.int64)
    for direction in range(4):
        for code, turn in ((0, 0), (256, 1), (65536, -1)):
            new = (direction + turn) % 4
            move = board.row * STEP_X[new] + 4 * STEP_Y[new]
            table[direction + code] = move + new - direction
    return table


def _take_steps(board: Board, offsets: np.ndarray, walkers: _Walkers) -> np.ndarray:
    """The states [step, walker] of the next block of steps, the present one first."""
    path = np.empty((board.block + 1, len(walkers.state)), np.int64)
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


def _positions(
    board: Board, walkers: _Walkers, states: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Where the unwrapped loops are, [step, walker], relative to their starts."""
    x = states // np.int32(board.row)
    y = states - x * np.int32(board.row)
    y >>= 2
    x -= walkers.x.astype(np.int32)
    y -= walkers.y.astype(np.int32)
    return x, y


def _endings(
    board: Board, walkers: _Walkers, path: np.ndarray, states: np.ndarray, box: "_Box"
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Which walkers end within the block, after how many of its steps, and how.

    Returns:
        columns, steps, winding vectors and whether the loop left the map.
    """
    # A loop can close only where the block's box holds its start or a periodic image of it.
    period_x, period_y = board.shape
    image_x, image_y = box.high_x // period_x, box.high_y // period_y
    near = (image_x * period_x >= box.low_x) & (image_y * period_y >= box.low_y)
    start = walkers.direction.astype(np.int64)
    start += (walkers.x + image_x * period_x) * board.row
    start += (walkers.y + image_y * period_y) * 4
    ends = states[1:] == start.astype(np.int32)
    if board.outside is None:
        column = np.flatnonzero(ends.any(0) & near)
        first = np.argmax(ends[:, column], 0)
        is_open = np.zeros(len(column), bool)
    else:
        left_map = board.outside.take(path[1:] >> 2)
        ends &= near
        ends |= left_map
        column = np.flatnonzero(ends.any(0))
        first = np.argmax(ends[:, column], 0)
        is_open = left_map[first, column]
    winding = np.stack([image_x[column], image_y[column]], 1)
    winding[is_open] = 0
    return column, first + 1, winding, is_open


def _count_pairs(
    board: Board, walkers: _Walkers, x: np.ndarray, y: np.ndarray, pairs: np.ndarray, sign: int
) -> None:
    """Count the points at distance [r, r + 1) from the start, r = 0 and r beyond `pairs` apart."""
    bins = pairs.shape[1]
    x, y = x.astype(np.float64), y.astype(np.float64)
    distance = np.sqrt(x * x + y * y).astype(np.int64)
    np.minimum(distance, bins - 1, out=distance)
    distance += walkers.base // (board.row * board.padded[0]) * bins
    pairs += sign * np.bincount(distance.ravel(), minlength=pairs.size).reshape(pairs.shape)


def _bring_home(
    board: Board, walkers: _Walkers, state: np.ndarray, x: np.ndarray, y: np.ndarray
) -> None:
    """Put walkers where they have come to, moved by whole periods into the map."""
    at_x, at_y = x + walkers.x - board.margin, y + walkers.y - board.margin
    move_x = at_x // board.shape[0] * board.shape[0]
    move_y = at_y // board.shape[1] * board.shape[1]
    walkers.state = state - (board.row * move_x + 4 * move_y)
    walkers.x = walkers.x - move_x
    walkers.y = walkers.y - move_y
