from dataclasses import replace

import numpy as np
import pytest

from jaxsurf.loops.levels import level_loops
from jaxsurf.loops.pairs import all_pairs_correlation
from jaxsurf.loops.statistics import shell_bins


def brute_force(loops, sides, is_open, share="closed"):
    """G(r) by counting every pair of points of every closed loop, one surface."""
    bins, scale, _ = shell_bins(min(sides) // 2, 1.1)
    pairs, fits = np.zeros((2, len(scale)))
    every = np.stack(np.meshgrid(*map(np.arange, sides), indexing="ij"), -1).reshape(-1, 2)

    def count(into, points, others, weight):
        away = np.abs(points[:, None] - others[None])
        if not is_open:
            away = np.minimum(away, np.array(sides) - away)
        shell = np.hypot(*np.moveaxis(away, -1, 0)).astype(int).ravel()
        shell = shell[(shell >= 1) & (shell < min(sides) // 2)]
        np.add.at(into, bins[shell - 1], weight)

    for k in np.flatnonzero(loops.closed | (share == "all")):
        path = loops.path(k) if loops.is_open[k] else loops.path(k)[:-1]
        points = np.floor(path).astype(int) % np.array(loops.shape)
        weight = loops.weight[k]
        if loops.closed[k]:
            count(pairs, points, points, weight)
        count(fits, points, every, weight)
    return pairs / fits


def smooth_map(seed, shape):
    h = np.random.default_rng(seed).standard_normal(shape)
    return sum(np.roll(h, (i, j), (0, 1)) for i in range(3) for j in range(3))


@pytest.mark.parametrize("share", ["closed", "all"])
@pytest.mark.parametrize("boundary", ["periodic", "open"])
def test_a_field_for_each_loop_gives_every_pair_exactly(boundary, share):
    h = smooth_map(3, (32, 27))
    loops = level_loops(h, 3, boundary=boundary, paths=True)
    is_open = boundary == "open"
    expected = brute_force(loops, tuple(s - is_open for s in h.shape), is_open, share)
    curve = all_pairs_correlation(loops, fields=len(loops), share=share)
    # the fields are in single precision: relative rounding of 1e-7, a few thousand terms
    np.testing.assert_allclose(curve.samples[0], expected, rtol=1e-3, atol=1e-6)
    assert 10 < np.count_nonzero(loops.closed) < len(loops), "some loops make the shares differ"


@pytest.mark.parametrize("fields", [1, 4])
def test_signs_scatter_around_every_pair(fields):
    h = smooth_map(4, (32, 32))
    loops = level_loops(h, 3, rng=0, paths=True)
    expected = brute_force(loops, h.shape, False)
    curves = np.array([loops.correlation(fields=fields, rng=k).samples[0] for k in range(100)])
    error = curves.std(0, ddof=1) / 10 + 1e-6  # and single precision
    assert np.all(np.abs(curves.mean(0) - expected) < 5 * error)
    # the control: points of all loops alike, without signs, are seen to be something else
    one = replace(
        loops.select(loops.closed), length=np.array([loops.length[loops.closed].sum()]), **ONE_LOOP
    )
    unsigned = all_pairs_correlation(one).samples[0]
    assert np.any(np.abs(unsigned - expected) > 10 * error)


ONE_LOOP = {
    "radius": np.array([1]),
    "area": np.array([0]),
    "winding": np.zeros((1, 2), int),
    "is_open": np.zeros(1, bool),
    "surface": np.array([0]),
    "level": np.array([0.0]),
    "weight": np.array([1.0]),
    "centroid": None,
}


def test_lengths_select_loops_and_per_weighs_them():
    h = smooth_map(5, (40, 40))
    loops = level_loops(h, 4, rng=0, paths=True)
    short = loops.correlation(lengths=(4, 12), rng=1)
    np.testing.assert_array_equal(
        short.samples, loops.select(loops.length <= 12).correlation(rng=1).samples
    )
    r = short.scale
    assert np.all(np.abs(short.mean[r > 6]) < 0.01), "loops of at most 12 steps reach 5 sites"
    one = level_loops(h, 10, placement="points", rng=0, paths=True).correlation(rng=1)
    assert one.detail("per") == "point"
    assert np.all(one.weights == 10 - 0 * one.weights) or np.all(one.weights <= 10)


def test_same_surface_same_answer_whatever_the_batch():
    h = np.stack([smooth_map(k, (20, 20)) for k in range(3)])
    together = level_loops(h, 3, rng=0, paths=True)
    alone = level_loops(h[0], 3, rng=0, paths=True)
    np.testing.assert_allclose(
        together.correlation(rng=2).samples[0], alone.correlation(rng=2).samples[0], rtol=1e-6
    )


def test_misuse_says_value_rule_and_remedy():
    h = smooth_map(0, (12, 12))
    with pytest.raises(ValueError, match="paths=True"):
        level_loops(h, 2).correlation()
    mask = np.ones((12, 12), bool)
    mask[3, 3] = False
    with pytest.raises(ValueError, match="some plaquettes are masked"):
        level_loops(h, 2, mask=mask, paths=True).correlation()
    with pytest.raises(ValueError, match="fields must be at least 1; got 0"):
        level_loops(h, 2, paths=True).correlation(fields=0)
    empty = level_loops(h, [1e9], paths=True).correlation()
    assert empty.count.sum() == 0
