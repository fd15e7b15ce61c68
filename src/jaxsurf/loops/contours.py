"""Whole level sets: every contour loop of a map at a level, in order along each loop.

The nodes of a level set are its crossed bonds, each of which enters one plaquette. A plaquette
holds no node, one, or at a saddle two, and each node has one successor: the bond by which the
contour leaves that plaquette. Loops are the cycles of this permutation.

They are put in order by one depth-first search in compiled code (`scipy.sparse.csgraph`), on this
graph. Each node leads to its successor. A chain of extra nodes leads first to a node that may be
the first of its loop in the order of the map, then to the next link of the chain. The search
follows a loop all around before it falls back on the chain, so that nodes come out loop by loop,
each loop in its own order and from its first node; and whatever is wanted of a loop is a running
sum or extremum along one flat array. The first plaquette of a loop touches neither row nor column
before it, so that the contour turns there around its far corner; near the seams of a periodic map
anything may be.

NumPy and SciPy alone.
"""

from dataclasses import dataclass

import numpy as np

from jaxsurf.loops.walk import STEP_X, STEP_Y, mean_height

# A plaquette's code has one bit for each corner above the level: 1 for (i, j), 2 for (i, j+1), 4
# for (i+1, j), 8 for (i+1, j+1).
_CORNER_BITS = (1, 4, 8, 2)  # of the corners counterclockwise, as in `walk`
SADDLES = (6, 9)


def _exits() -> np.ndarray:
    """The direction in which a contour, sites above on its left, leaves a plaquette."""
    table = np.zeros(16, np.int8)
    for code in range(16):
        above = [bool(code & bit) for bit in _CORNER_BITS]
        out = [d for d in range(4) if above[(d + 2) % 4] and not above[(d + 1) % 4]]
        table[code] = out[0] if len(out) == 1 else 0
    return table


_EXITS = _exits()
_MAY_BE_FIRST = np.isin(np.arange(16), (7, 8, *SADDLES))  # that contours turn around far corners


@dataclass(frozen=True)
class Contours:
    """The loops of a stack of level sets, end to end.

    Attributes:
        start: where each loop begins in the flat arrays; one more entry for the end.
        step_x: the step along x taken from each plaquette to the next.
        step_y: likewise along y.
        cell: the plaquette of each node, an index into the padded stack; see `plaquettes`.
        padded: plaquettes of one map, a ring of copies around it included.
    """

    start: np.ndarray
    step_x: np.ndarray
    step_y: np.ndarray
    cell: np.ndarray
    padded: tuple[int, int]

    def plaquettes(self, nodes: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Which level set, x and y the plaquettes of the given nodes have."""
        board, cell = np.divmod(self.cell[nodes], self.padded[0] * self.padded[1])
        x, y = np.divmod(cell, self.padded[1])
        return board, x - 1, y - 1


def contour(heights: np.ndarray, which: np.ndarray, levels: np.ndarray) -> Contours:
    """Every loop of several level sets of periodic maps.

    Arguments:
        heights: maps `[surface, x, y]`.
        which: the surface of each level set.
        levels: the level of each; sites above are those higher than it.
    """
    side_x, side_y = heights.shape[1:]
    cell, codes = _crossed(heights, which, levels)
    padded = side_x + 2, side_y + 2
    is_saddle = (codes == SADDLES[0]) | (codes == SADDLES[1])
    saddle = np.flatnonzero(is_saddle)
    # A saddle has two nodes in a row: a strand entered in direction 0 or 1, and one in 2 or 3.
    strands = np.ones(len(cell), np.int32)
    strands[saddle] = 2
    number = np.cumsum(strands, dtype=np.int32) - strands
    node = np.empty(len(which) * padded[0] * padded[1], np.int32)
    node[cell] = number
    ring = node.reshape(len(which), *padded)  # the ring around each map repeats its other side
    ring[:, 0], ring[:, -1] = ring[:, side_x], ring[:, 1]
    ring[:, :, 0], ring[:, :, -1] = ring[:, :, side_y], ring[:, :, 1]

    which_cell = np.repeat(np.arange(len(cell)), strands)
    cell, codes, is_saddle = (each.take(which_cell) for each in (cell, codes, is_saddle))
    leave = _EXITS.take(codes)
    first = number[saddle]
    _resolve_saddles(heights, which, levels, padded, cell[first], codes[first], first, leave)
    move = padded[1] * STEP_X + STEP_Y
    successor = node.take(cell + move.take(leave), mode="clip")
    successor += is_saddle[successor] & (leave >= 2)

    order, start = _cycles(successor, _possible_firsts(cell, codes, padded))
    leave = leave.take(order)
    step_x = STEP_X.astype(np.int32).take(leave)
    step_y = STEP_Y.astype(np.int32).take(leave)
    return Contours(start, step_x, step_y, cell.take(order), (padded[0], padded[1]))


def _crossed(
    heights: np.ndarray, which: np.ndarray, levels: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The plaquettes that contours cross, as cells of the padded stack, and their codes.

    Most plaquettes have all corners on one side: they are told apart eight at a time, as bits.
    """
    side_x, side_y = heights.shape[1:]
    above = np.empty((len(which), side_x + 1, side_y + 1), bool)
    for board, surface, level in zip(above, which, levels, strict=True):
        np.greater(heights[surface], level, out=board[:-1, :-1])
    above[:, -1], above[:, :, -1] = above[:, 0], above[:, :, 0]
    low = np.packbits(above[:, :, :-1], axis=-1, bitorder="little")  # corners (i, j)
    high = low >> 1  # corners (i, j+1)
    last = high[..., -1] | ((low[..., 0] & 1) << ((side_y - 1) % 8))
    high.reshape(-1)[:-1] |= low.reshape(-1)[1:] << 7
    high[..., -1] = last
    every, some = low & high, low | high
    mixed = (some[:, :-1] | some[:, 1:]) ^ (every[:, :-1] & every[:, 1:])
    byte = np.flatnonzero(mixed != 0)  # of booleans, the fast way
    bits = np.unpackbits(mixed.reshape(-1)[byte].view(np.uint8), bitorder="little")
    bit = np.flatnonzero(bits.view(bool))
    row, column = np.divmod(byte, mixed.shape[2])
    board = row // side_x
    within = (bit >> 3, bit & 7)
    site = ((row + board) * (side_y + 1) + 8 * column)[within[0]] + within[1]
    cell = ((row + 2 * board + 1) * (side_y + 2) + 8 * column + 1)[within[0]] + within[1]
    signs = above.reshape(-1).view(np.uint8)
    codes = signs[site]
    for corner, offset in ((1, 1), (2, side_y + 1), (3, side_y + 2)):
        codes |= signs.take(site + offset, mode="clip") << corner
    return cell, codes


def _resolve_saddles(
    heights: np.ndarray,
    which: np.ndarray,
    levels: np.ndarray,
    padded: tuple[int, ...],
    cell: np.ndarray,
    codes: np.ndarray,
    first: np.ndarray,
    leave: np.ndarray,
) -> None:
    """Write the exits of both strands of each saddle, by the mean of its four heights."""
    board, place = np.divmod(cell, padded[0] * padded[1])
    x, y = np.divmod(place, padded[1])
    x, y, surface = x - 1, y - 1, which[board]
    right, up = (x + 1) % heights.shape[1], (y + 1) % heights.shape[2]
    mean = mean_height(
        heights[surface, x, y],
        heights[surface, right, y],
        heights[surface, right, up],
        heights[surface, x, up],
    )
    turn = np.where(mean > levels[board], -1, 1)  # a centre above joins the sites above
    enter = np.where(codes == SADDLES[0], 0, 1)
    leave[first] = (enter + turn) % 4
    leave[first + 1] = (enter + 2 + turn) % 4


def _possible_firsts(cell: np.ndarray, codes: np.ndarray, padded: tuple[int, ...]) -> np.ndarray:
    """Nodes among which each loop has its first, in the order of nodes."""
    row = cell // padded[1]  # divisions by one number are fast, remainders are not
    edge = cell - row * padded[1] == 1
    edge |= row - row // padded[0] * padded[0] == 1
    return np.flatnonzero(_MAY_BE_FIRST.take(codes) | edge)


def _cycles(successor: np.ndarray, firsts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The nodes of a permutation cycle by cycle, and where each cycle begins and the last ends."""
    nodes, links = len(successor), len(firsts)
    if nodes == 0:
        return np.zeros(0, np.int64), np.zeros(1, np.int64)
    chain = np.empty((links, 2), np.int32)
    chain[:, 0] = firsts
    chain[:, 1] = np.arange(nodes + 1, nodes + links + 1)
    edges = np.concatenate([successor, chain.reshape(-1)[:-1]])  # the last link has none to follow
    ends = np.concatenate(
        [np.arange(nodes + 1), np.arange(nodes + 2, nodes + 2 * links + 1, 2)], dtype=np.int32
    )
    ends[-1] = len(edges)
    size = nodes + links
    from scipy.sparse import csr_array  # kept out of `import jaxsurf`
    from scipy.sparse.csgraph import depth_first_order

    graph = csr_array((np.ones(len(edges)), edges, ends), shape=(size, size))
    order = depth_first_order(graph, nodes, return_predecessors=False)
    is_link = order >= nodes
    begins = is_link[:-1] & ~is_link[1:]
    start = np.flatnonzero(begins) + 1
    start -= np.cumsum(is_link)[start]
    return order[~is_link], np.append(start, nodes)
