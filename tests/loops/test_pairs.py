from dataclasses import replace

import numpy as np
import pytest

from jaxsurf.loops.levels import level_loops
from jaxsurf.loops.pairs import all_pairs_correlation
from jaxsurf.loops.statistics import shell_bins


def brute_force(loops, sides, is_open, share="closed", pieces=False):
    """G(r) by counting every pair of points of every loop, one surface."""
    bins, scale, _ = shell_bins(min(sides) // 2, 1.1)
    pairs, fits = np.zeros((2, len(scale)))
    valid = np.ones(sides, bool) if loops.valid is None else loops.valid[0]
    every = np.argwhere(valid[: sides[0], : sides[1]])

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
        if loops.closed[k] or pieces:
            count(pairs, points, points, weight)
        count(fits, points, every, weight)
    return pairs / fits


def smooth_map(seed, shape):
    h = np.random.default_rng(seed).standard_normal(shape)
    return sum(np.roll(h, (i, j), (0, 1)) for i in range(3) for j in range(3))


def masks(shape):
    """No mask; a disc and a bar masked."""
    x, y = np.ogrid[: shape[0], : shape[1]]
    return {"whole": None, "masked": ((x - 9) ** 2 + (y - 12) ** 2 > 25) & (x != 25)}


@pytest.mark.parametrize(("share", "pieces"), [("closed", False), ("all", False), ("all", True)])
@pytest.mark.parametrize("mask", ["whole", "masked"])
@pytest.mark.parametrize("boundary", ["periodic", "open"])
def test_a_field_for_each_loop_gives_every_pair_exactly(boundary, mask, share, pieces):
    h = smooth_map(3, (32, 27))
    loops = level_loops(h, 3, boundary=boundary, mask=masks(h.shape)[mask], paths=True)
    is_open = boundary == "open"
    sides = tuple(s - is_open for s in h.shape)
    expected = brute_force(loops, sides, is_open, share, pieces)
    curve = all_pairs_correlation(loops, fields=len(loops), share=share, pieces=pieces)
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


def test_sites_behind_the_mask_are_not_counted():
    h = smooth_map(3, (32, 27))
    loops = level_loops(h, 3, mask=masks(h.shape)["masked"], paths=True)
    ours = all_pairs_correlation(loops, fields=len(loops))
    every = all_pairs_correlation(replace(loops, valid=None), fields=len(loops))
    near = ours.scale < 6  # the loops reach no farther
    # a tenth of the plaquettes is masked, fewer next to loops that do not touch the mask
    assert np.all(ours.samples[0, near] > 1.01 * every.samples[0, near])


def test_pieces_make_up_for_the_loops_that_edges_cut():
    side = np.fft.fftfreq(256)
    q = np.hypot(side[:, None], side[None, :])
    q[0, 0] = np.inf
    noise = np.fft.fft2(np.random.default_rng(0).standard_normal((8, 256, 256)))
    h = np.fft.ifft2(noise * q**-1.4).real  # alpha = 0.4
    levels = np.array([-0.3, 0.3]) * h.std()
    whole = level_loops(h, levels, paths=True).correlation(share="all", pieces=True)
    crops = h.reshape(8, 4, 64, 4, 64).transpose(0, 1, 3, 2, 4).reshape(-1, 64, 64)
    cut = level_loops(crops, levels, boundary="open", paths=True)
    near = np.flatnonzero((whole.scale > 2) & (whole.scale < 9))
    scale, truth = whole.scale[near], whole.mean[near]
    found = cut.correlation(share="all", pieces=True)
    error = np.hypot(found.stderr[near], whole.stderr[near])
    # pairs joined by way of the outside are missing, a share of order r / 63
    assert np.all(np.abs(found.mean[near] - truth) < scale / 63 * truth + 4 * error)
    closed = cut.correlation(share="all").mean[near]
    assert np.all(truth - closed > 2 * (scale / 63 * truth + 4 * error)), "the control"


def test_distances_that_a_mask_leaves_without_pairs_weigh_nothing():
    h = smooth_map(6, (40, 40))
    mask = np.zeros((40, 40), bool)
    mask[5:17, 5:17] = True  # 11 plaquettes across: distances to 14.1
    curve = level_loops(h, 6, rng=0, mask=mask, paths=True).correlation()
    assert np.all((curve.weights[0] > 0) == (curve.scale < 15))
    assert np.all(curve.samples[0][curve.scale > 15] == 0)


@pytest.mark.parametrize("boundary", ["periodic", "open"])
def test_one_mask_serves_every_map(boundary):
    h = np.stack([smooth_map(k, (24, 24)) for k in range(2)])
    mask = masks((24, 24))["masked"]
    options = {"boundary": boundary, "paths": True}
    together = level_loops(h, [0.5], mask=mask, **options)
    each = level_loops(list(h), [0.5], mask=np.stack([mask, mask]), **options)
    np.testing.assert_array_equal(together.valid, each.valid)
    alone = level_loops(h[1], [0.5], mask=mask, **options).correlation(fields=200)
    np.testing.assert_allclose(
        together.correlation(fields=200).samples[1], alone.samples[0], rtol=1e-3, atol=1e-6
    )  # single precision, as above, and a field for each loop


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
    with pytest.raises(ValueError, match="pieces=True needs share='all'.* got share='closed'"):
        level_loops(h, 2, paths=True).correlation(pieces=True)
    with pytest.raises(ValueError, match="fields must be at least 1; got 0"):
        level_loops(h, 2, paths=True).correlation(fields=0)
    empty = level_loops(h, [1e9], paths=True).correlation()
    assert empty.count.sum() == 0
