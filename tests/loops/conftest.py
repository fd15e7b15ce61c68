"""A contour follower that takes one plaquette at a time, to hold the fast ones against."""

from types import SimpleNamespace

import numpy as np
import pytest

STEPS = ((1, 0), (0, 1), (-1, 0), (0, -1))


def corners(x, y):
    return ((x, y), (x + 1, y), (x + 1, y + 1), (x, y + 1))


def mean_height(h, x, y):
    a, b, c, d = (h[i % h.shape[0], j % h.shape[1]] for i, j in corners(x, y))
    return ((a + c) + (b + d)) * h.dtype.type(0.25)


def bond(x, y, d, shape):
    """The bond crossed on entering plaquette (x, y) in direction d, as two sites."""
    pair = (corners(x, y)[(d + 3) % 4], corners(x, y)[d])
    return frozenset((i % shape[0], j % shape[1]) for i, j in pair)


def scalar_loop(h, level, x, y, d):
    """Follow one loop, one plaquette at a time, by the rules as the paper words them.

    Returns the unwrapped plaquettes, the first one repeated, the bonds crossed, and the states.
    """

    def above(i, j):
        return h[i % h.shape[0], j % h.shape[1]] > level

    path, bonds, states = [], [], []
    while True:
        path.append((x, y))
        states.append((x % h.shape[0], y % h.shape[1], d))
        bonds.append(bond(x, y, d, h.shape))
        sites = corners(x, y)
        far_left, far_right = above(*sites[(d + 2) % 4]), above(*sites[(d + 1) % 4])
        if far_left and not far_right:
            turn = 0
        elif not far_left and not far_right:
            turn = 1
        elif far_left and far_right:
            turn = -1
        else:  # a saddle: a centre above the level joins the sites above it
            turn = -1 if mean_height(h, x, y) > level else 1
        d = (d + turn) % 4
        x, y = x + STEPS[d][0], y + STEPS[d][1]
        if (x % h.shape[0], y % h.shape[1], d) == states[0]:
            return path + [(x, y)], bonds, states


def summary(path, shape):
    """Length, radius, area and winding of an unwrapped closed path."""
    x, y = np.array(path).T
    winding = ((x[-1] - x[0]) // shape[0], (y[-1] - y[0]) // shape[1])
    radius = max(np.ptp(x), np.ptp(y)) if winding == (0, 0) else 0
    area = int(np.sum(x[:-1] * np.diff(y))) if winding == (0, 0) else 0
    return len(path) - 1, int(radius), area, *map(int, winding)


def all_loops(h, level):
    """Every loop of a level set as (path, bonds), found from each crossed bond not yet seen."""
    above = h > level
    seen, loops = set(), []
    for x in range(h.shape[0]):
        for y in range(h.shape[1]):
            for d in range(4):
                (i, j), (k, m) = corners(x, y)[(d + 3) % 4], corners(x, y)[d]
                left, right = (
                    above[i % h.shape[0], j % h.shape[1]],
                    above[k % h.shape[0], m % h.shape[1]],
                )
                if left and not right and (x, y, d) not in seen:
                    path, bonds, states = scalar_loop(h, level, x, y, d)
                    seen.update(states)
                    loops.append((path, bonds))
    return loops


@pytest.fixture(scope="session")
def scalar():
    return SimpleNamespace(loop=scalar_loop, loops=all_loops, summary=summary)
