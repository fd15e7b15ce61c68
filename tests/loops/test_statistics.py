import numpy as np
import pytest

from jaxsurf.loops.loops import Loops
from jaxsurf.loops.statistics import correlation, shell_bins, whole_number_bins
from jaxsurf.loops.trace import trace_loops


def made(length, radius, surface, *, surfaces=2, winding=None, sampling="points", **more):
    """Loops with the given sizes, for curves whose every number can be checked by hand."""
    count = len(length)
    return Loops(
        length=np.array(length),
        radius=np.array(radius),
        area=np.zeros(count, int),
        winding=np.zeros((count, 2), int) if winding is None else np.array(winding),
        is_open=np.zeros(count, bool),
        surface=np.array(surface),
        level=np.zeros(count),
        weight=np.ones(count),
        surfaces=surfaces,
        shape=(64, 64),
        sampling=sampling,
        **more,
    )


LENGTH, RADIUS, SURFACE = [4, 8, 12, 4, 100], [1, 2, 2, 1, 40], [0, 0, 0, 1, 1]
WINDING = [[0, 0]] * 4 + [[1, 0]]


def test_mean_length_by_hand():
    curve = made(LENGTH, RADIUS, SURFACE, winding=WINDING).mean_length()
    assert curve.scale[:4] == pytest.approx([1, 2, 3, 4])  # no empty bins between whole numbers
    np.testing.assert_allclose(curve.samples[:, :2], [[4, 10], [4, 0]])
    np.testing.assert_allclose(curve.weights[:, :2], [[1, 2], [1, 0]])
    assert curve.count[2:].sum() == 0, "the winding loop is left out"
    assert curve.detail("side") == 64
    assert curve.detail("sampling") == "points"


def test_ways_to_count_a_loop():
    # two loops of radius 2, lengths 8 and 12: per point 10, per loop weights 1/8 and 1/12
    points = made(LENGTH, RADIUS, SURFACE, winding=WINDING)
    assert points.mean_length(per="point").samples[0, 1] == pytest.approx(10)
    assert points.mean_length(per="loop").samples[0, 1] == pytest.approx(2 / (1 / 8 + 1 / 12))
    levels = made(LENGTH, RADIUS, SURFACE, winding=WINDING, sampling="levels")
    assert levels.mean_length().samples[0, 1] == pytest.approx((64 + 144) / 20)
    assert levels.mean_length(per="loop").samples[0, 1] == pytest.approx(10)
    with pytest.raises(ValueError, match="per must be one of .* got 'point'"):
        levels.mean_length(per="point")
    with pytest.raises(ValueError, match="sampled by levels; got 'gradient'"):
        levels.length_tail(per="gradient")


def test_length_tail_by_hand():
    curve = made(LENGTH, RADIUS, SURFACE, winding=WINDING).length_tail()
    assert np.all(curve.scale % 2 == 1), "between the lengths that can occur"
    assert list(curve.scale[:5]) == [5, 7, 9, 11, 13]
    np.testing.assert_allclose(curve.samples[0, :5], [2 / 3, 2 / 3, 1 / 3, 1 / 3, 0])
    np.testing.assert_allclose(curve.samples[1], 0)
    np.testing.assert_allclose(curve.weights[:, 0], [3, 1])


def test_shares_of_all_contour_length():
    sizes = {"winding": WINDING, "sampling": "levels"}
    loops = made(LENGTH, RADIUS, SURFACE, **sizes)
    closed, of_all = loops.length_tail(), loops.length_tail(share="all")
    # surface 0 has closed loops only; surface 1 four steps of them out of 104
    np.testing.assert_allclose(of_all.samples[0], closed.samples[0])
    loops = made([4, 8, 12, 4, 100], RADIUS, [0, 0, 0, 0, 0], surfaces=1, **sizes)
    np.testing.assert_allclose(
        loops.length_tail(share="all").samples[0, :5], np.array([20, 20, 12, 12, 0]) / 128
    )
    assert loops.length_tail(share="all").weights[0, 0] == 128
    pairs = np.zeros((1, 64), int)
    pairs[0, 1] = 16
    points = made(LENGTH, RADIUS, [0] * 5, surfaces=1, winding=WINDING, pairs=pairs)
    assert points.correlation().samples[0, 0] == pytest.approx(16 / 8 / 4)
    assert points.correlation(share="all").samples[0, 0] == pytest.approx(16 / 8 / 5)
    with pytest.raises(ValueError, match="share must be one of .* got 'winding'"):
        points.length_tail(share="winding")
    with pytest.raises(ValueError, match="of all contour length.* got per='loop'"):
        points.length_tail(share="all", per="loop")


def test_power_law_tail_is_unbiased_at_small_s():
    # P(s) of even s with an exactly known tail: P_>(s) = (s / 3)^(-1/3) at odd s
    rng = np.random.default_rng(0)
    s = 2 * np.floor((3 * rng.random(200_000) ** -3.0 - 1) / 2) + 2  # the even s around s +- 1
    s = np.minimum(s, 1e6).astype(int)
    loops = made(s, np.ones_like(s), np.arange(len(s)) % 20, surfaces=20)
    curve = loops.length_tail().window(5.0, 500.0)
    pull = (curve.mean - (curve.scale / 3) ** (-1 / 3)) / curve.stderr
    assert np.all(np.abs(pull) < 5)
    shifted = (curve.mean - ((curve.scale + 1) / 3) ** (-1 / 3)) / curve.stderr
    assert np.abs(shifted[0]) > 5, "evaluated at even s it would be biased"


def test_bins_hold_each_whole_number_once():
    bins, scale = whole_number_bins(300, 1.1)
    assert bins[0] == -1
    assert np.all(np.diff(bins[1:]) >= 0)
    assert np.array_equal(np.unique(bins[1:]), np.arange(len(scale)))
    assert np.all(np.diff(scale) > 0)


def test_shells_hold_each_lattice_site_once():
    bins, scale, sites = shell_bins(40, 1.1)
    side = np.arange(-41, 42)
    away = np.hypot(side[:, None], side[None, :])
    assert sites.sum() == np.count_nonzero((away >= 1) & (away < 40))
    assert sites[0] == 8  # four at distance 1 and four at sqrt 2
    assert scale[0] == pytest.approx(2**0.25)
    last = np.flatnonzero(bins == bins[-1]) + 1
    ring = np.pi * (40**2 - last[0] ** 2)
    # Gauss' circle problem: each circle's count is off by less than r^(2/3) = 12 sites
    assert sites[-1] == pytest.approx(ring, abs=24)


def test_correlation_by_hand():
    pairs = np.zeros((2, 64), int)
    pairs[0, 1], pairs[1, 1], pairs[1, 2] = 16, 24, 6
    curve = made(LENGTH, RADIUS, SURFACE, winding=WINDING, pairs=pairs).correlation()
    # 8 sites at distance [1, 2), 16 in [2, 3); starts that count: 3 and 1
    np.testing.assert_allclose(curve.samples[:, 0], [16 / 8 / 3, 24 / 8 / 1])
    assert curve.samples[1, 1] == pytest.approx(6 / shell_bins(64, 1.1)[2][1])
    np.testing.assert_allclose(curve.weights[:, 0], [3, 1])
    with pytest.raises(ValueError, match="correlation=True"):
        correlation(made(LENGTH, RADIUS, SURFACE))


def test_spacing_sets_the_units():
    h = np.random.default_rng(0).standard_normal((3, 32, 32))
    one = trace_loops(h, 60, rng=0, correlation=True)
    other = trace_loops(h, 60, rng=0, correlation=True, spacing=0.5)
    for measure in ("mean_length", "length_tail", "correlation"):
        a, b = getattr(one, measure)(), getattr(other, measure)()
        np.testing.assert_allclose(b.scale, 0.5 * a.scale)
        np.testing.assert_allclose(b.samples, a.samples * (0.5 if measure == "mean_length" else 1))
        assert (a.units[0], b.units[0]) == ("sites", "length")
        assert b.detail("side") == 16
