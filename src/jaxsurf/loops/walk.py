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

import numpy as np

WALKERS_AT_ONCE = 2048  # a block of their steps fits the cache
PLAQUETTES_AT_ONCE = 8192  # plaquettes whose thresholds are worked out together, likewise

# Directions 0 ... 3 are +x, +y, -x, -y. The corners of plaquette (i, j), counterclockwise, are
# (i, j), (i+1, j), (i+1, j+1), (i, j+1). A walker moving in direction d has corner d behind it on
# its right, d + 1 ahead on its right, d + 2 ahead on its left and d + 3 behind it on its left.
STEP_X = np.array([1, 0, -1, 0])
STEP_Y = np.array([0, 1, 0, -1])


@dataclass(frozen=True)
class Board:
    """The thresholds of every plaquette and direction of a batch of periodic maps with margins.

    The state of a walker is one integer, 4 * plaquette + direction; a step adds an offset to it.
    The margin repeats the map, so that walkers need bringing home only every `margin` steps.
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


def lay_out(heights: np.ndarray, valid: np.ndarray | None) -> Board:
    """Tabulate the thresholds of maps `[surface, x, y]`; invalid sites are at -inf."""
    surfaces, *shape = heights.shape
    margin = int(np.clip(min(shape) // 16, 8, 32))
    padded = (shape[0] + 2 * margin, shape[1] + 2 * margin)
    row = np.arange(surfaces)[:, None] * shape[0]
    near = (row + np.arange(-margin, padded[0] - margin) % shape[0]).ravel()
    far = (row + np.arange(1 - margin, padded[0] - margin + 1) % shape[0]).ravel()
    column = np.arange(-margin, padded[1] - margin + 1) % shape[1]
    rows = heights.reshape(-1, shape[1])
    table = np.empty((len(near), padded[1], 4, 2), heights.dtype)
    step = max(1, PLAQUETTES_AT_ONCE // padded[1])
    for start in range(0, len(near), step):
        part = slice(start, start + step)
        low, high = rows[near[part]][:, column], rows[far[part]][:, column]
        corners = np.stack([low[:, :-1], high[:, :-1], high[:, 1:], low[:, 1:]])
        means = mean_height(*corners)
        below, above = np.minimum(corners, means), np.maximum(corners, means)
        for d in range(4):
            left, right = (d + 2) % 4, (d + 1) % 4
            np.maximum(corners[left], below[right], out=table[part, :, d, 0])
            np.minimum(corners[right], above[left], out=table[part, :, d, 1])
    outside = None
    if valid is not None:
        sites = valid.reshape(-1, shape[1])
        whole = sites[near] & sites[far]
        outside = ~(whole[:, column[:-1]] & whole[:, column[1:]]).ravel()
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
        x, y = _positions(board, walkers, path)
        box = _Box.around(x[1:], y[1:])
        ended, last, winding, is_open = _endings(board, walkers, path, x, y, box)
        if len(ended):
            # A loop that has ended stands still for the rest of the block.
            rows = np.minimum(np.arange(len(path))[:, None], last)
            x[:, ended], y[:, ended] = x[rows, ended], y[rows, ended]
            box.replace(ended, _Box.around(x[:, ended], y[:, ended]))
        walkers.box.grow(box)
        walkers.area += np.einsum("tn,tn->n", x[:-1], np.diff(y, axis=0))
        if pairs is not None:
            _count_pairs(board, walkers, x[1:], y[1:], pairs, sign)
        walkers.state = path[-1]
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
        walkers.steps += board.margin
        _bring_home(board, walkers)
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


def _positions(board: Board, walkers: _Walkers, path: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where the unwrapped loops are, [step, walker], relative to their starts."""
    states = (path - walkers.base).astype(np.int32)
    x = states // np.int32(board.row)
    y = states - x * np.int32(board.row)
    y >>= 2
    x -= walkers.x.astype(np.int32)
    y -= walkers.y.astype(np.int32)
    return x, y


def _endings(
    board: Board, walkers: _Walkers, path: np.ndarray, x: np.ndarray, y: np.ndarray, box: "_Box"
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Which walkers end within the block, after how many of its steps, and how.

    Returns:
        columns, steps, winding vectors and whether the loop left the map.
    """
    # A loop can close only where the block's box holds its start or a periodic image of it.
    may_end = box.high_x // board.shape[0] > (box.low_x - 1) // board.shape[0]
    may_end &= box.high_y // board.shape[1] > (box.low_y - 1) // board.shape[1]
    left_map = None if board.outside is None else board.outside[path[1:] >> 2]
    if left_map is not None:
        may_end |= left_map.any(0)
    some = np.flatnonzero(may_end)
    away_x, away_y = x[1:, some], y[1:, some]
    ends = (path[1:, some] & 3) == walkers.direction[some]
    ends &= (away_x % board.shape[0] == 0) & (away_y % board.shape[1] == 0)
    if left_map is not None:
        ends |= left_map[:, some]
    column = np.flatnonzero(ends.any(0))
    first = np.argmax(ends[:, column], 0)
    winding = np.stack(
        [away_x[first, column] // board.shape[0], away_y[first, column] // board.shape[1]], 1
    )
    is_open = np.zeros(len(column), bool)
    if left_map is not None:
        is_open = left_map[first, some[column]]
        winding[is_open] = 0
    return some[column], first + 1, winding, is_open


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


def _bring_home(board: Board, walkers: _Walkers) -> None:
    """Move walkers that stand in the margin by whole periods into the map."""
    x, rest = np.divmod(walkers.state - walkers.base, board.row)
    move_x = (x - board.margin) // board.shape[0] * board.shape[0]
    move_y = ((rest >> 2) - board.margin) // board.shape[1] * board.shape[1]
    walkers.state = walkers.state - (board.row * move_x + 4 * move_y)
    walkers.x = walkers.x - move_x
    walkers.y = walkers.y - move_y
