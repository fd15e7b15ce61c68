import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jaxsurf.loops import levels as levels_module
from jaxsurf.loops.levels import level_loops
from jaxsurf.loops.trace import trace_loops


def rows(loops):
    """Length, radius, area and winding of each loop, sorted."""
    columns = [loops.length, loops.radius, loops.area, *loops.winding.T]
    return sorted(map(tuple, np.column_stack(columns).tolist()))


def random_map(rng, trial):
    """White noise, or smoother, so that loops are longer and wind more often."""
    h = rng.standard_normal(tuple(rng.integers(4, 24, 2)))
    if trial % 3:
        h = sum(np.roll(h, (i, j), (0, 1)) for i in range(3) for j in range(3))
    return h


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_agrees_with_a_scalar_tracer_loop_by_loop(dtype, scalar):
    rng = np.random.default_rng(11)
    saddles = windings = 0
    for trial in range(120):
        h = random_map(rng, trial).astype(dtype)
        level = float(np.quantile(h, rng.random()))
        level = float(dtype(level)) + (1e-3 if level in h else 0)
        expected = scalar.loops(h, dtype(level))
        loops = level_loops(h, [level], paths=True)
        assert rows(loops) == sorted(scalar.summary(path, h.shape) for path, _ in expected)
        crossed = np.sum((h > level) != np.roll(h > level, 1, 0))
        crossed += np.sum((h > level) != np.roll(h > level, 1, 1))
        assert loops.length.sum() == crossed, "every crossed bond is in one loop"
        # the points themselves: each loop's path is one of the scalar tracer's, up to where it
        # starts
        paths = {frozenset((x % h.shape[0], y % h.shape[1]) for x, y in p) for p, _ in expected}
        for k in range(len(loops)):
            points = np.rint(loops.path(k) - 0.5).astype(int)
            assert np.all(np.abs(np.diff(points, axis=0)).sum(1) == 1)
            np.testing.assert_array_equal(points[-1] - points[0], loops.winding[k] * h.shape)
            assert frozenset(map(tuple, (points % h.shape).tolist())) in paths
            if loops.closed[k]:
                np.testing.assert_allclose(loops.centroid[k], loops.path(k)[:-1].mean(0))
                assert loops.radius[k] == np.ptp(points, 0).max()
        windings += loops.winding.any(1).sum()
        saddles += sum(len(set(p)) < len(p) - 1 for p, _ in expected)
    assert saddles > 50
    assert windings > 25


@given(st.integers(4, 30), st.integers(4, 30), st.integers(0, 2**32 - 1))
@settings(max_examples=40, deadline=None)
def test_symmetries_are_exact(lx, ly, seed):
    h = np.random.default_rng(seed).standard_normal((lx, ly))
    expected = rows(level_loops(h, [0.3]))

    def same(other, change, level=0.3):
        assert sorted(change(*row) for row in rows(level_loops(other, [level]))) == expected

    same(-h, lambda s, r, a, wx, wy: (s, r, -a, -wx, -wy), -0.3)
    same(np.roll(h, (3, -2), (0, 1)), lambda s, r, a, wx, wy: (s, r, a, wx, wy))
    same(h.T, lambda s, r, a, wx, wy: (s, r, a, -wy, -wx))
    same(np.rot90(h, -1), lambda s, r, a, wx, wy: (s, r, a, -wy, wx))


def test_loops_are_those_traced_through_the_same_points():
    h = np.random.default_rng(0).standard_normal((3, 24, 31))
    for options in ({}, {"boundary": "open"}):
        traced = trace_loops(h, 60, rng=5, **options)
        found = level_loops(h, 60, placement="points", rng=5, **options)
        assert set(np.unique(found.weight)) == {0, 1}
        assert found.weight.sum() == len(traced)
        through = found.select(found.weight > 0)
        names = ("length", "radius", "area", "winding", "surface")
        closed = traced.closed
        np.testing.assert_array_equal(through.closed, closed)
        for name in names:
            np.testing.assert_array_equal(
                getattr(through, name)[closed], getattr(traced, name)[closed]
            )
        for measure in ("mean_length", "length_tail"):
            a, b = getattr(traced, measure)(), getattr(found, measure)()
            np.testing.assert_allclose(a.samples, b.samples, atol=1e-12)


def test_length_weighted_averages_agree_with_traced_ones():
    rng = np.random.default_rng(1)
    h = rng.standard_normal((48, 32, 32))
    h = h + np.roll(h, 1, 1) + np.roll(h, 1, 2)
    found = level_loops(h, 6, rng=0)
    traced = trace_loops(h, 300, rng=0, level="uniform")
    differences = {}
    for per in ("length", "loop"):
        for measure in ("mean_length", "length_tail"):
            a = getattr(found, measure)(per=per).window(1.0, 12.0)
            b = getattr(traced, measure)(per=per).window(1.0, 12.0)
            error = np.hypot(a.stderr, b.stderr)  # zero at R = 1, where every loop has length 4
            assert np.all(np.abs(a.mean - b.mean) <= 5 * error), (per, measure)
            differences[per, measure] = a.mean
    # the control: loops counted in another way are well apart
    a, b = differences["length", "length_tail"], differences["loop", "length_tail"]
    assert np.all(np.abs(a - b) > 0.1)


def test_placements():
    h = np.random.default_rng(2).standard_normal((2, 20, 20))
    quantiles = level_loops(h, 1, placement="quantiles")
    np.testing.assert_allclose(np.unique(quantiles.level), np.sort(np.median(h, (1, 2))))
    equal = level_loops(h, 5, rng=1)
    for k in range(2):
        levels = np.unique(equal.level[equal.surface == k])
        np.testing.assert_allclose(np.diff(levels), np.ptp(h[k]) / 5)
        np.testing.assert_allclose(equal.weight[equal.surface == k], np.ptp(h[k]) / 5)
    assert np.array_equal(equal.level_sets, [5, 5])
    phases = [level_loops(h, 5, rng=seed).level.min() for seed in range(3)]
    assert len(set(phases)) == 3
    given_levels = level_loops(h, np.array([0.0, 0.5, 2.0]))
    np.testing.assert_allclose(np.unique(given_levels.weight), [0.5, 1.0, 1.5])


def test_half_integer_levels_see_no_dither():
    heights = np.cumsum(np.where(np.arange(18) < 9, 1, -1))[:, None] + np.zeros((18, 16), int)
    heights = heights + (np.arange(16) % 2) * np.where(np.arange(18) % 2, 1, -1)[:, None]
    half = level_loops(heights, 1, placement="half-integers", rng=0)
    assert "dithered" in repr(half)
    assert np.all(np.unique(half.level) % 1 == 0.5)
    # signs, and with them the length of each level set, do not depend on the dither
    for seed in range(3):
        again = level_loops(heights, 1, placement="half-integers", rng=seed)
        np.testing.assert_array_equal(
            np.bincount(np.round(half.level * 2).astype(int), half.length),
            np.bincount(np.round(again.level * 2).astype(int), again.length),
        )
    with pytest.raises(ValueError, match="need integer heights"):
        level_loops(heights + 0.3, 1, placement="half-integers")


def test_same_loops_whatever_the_batch(monkeypatch):
    h = np.random.default_rng(0).standard_normal((5, 21, 18))
    for placement in ("equal", "quantiles", "points"):
        whole = level_loops(h, 7, placement=placement, rng=3, paths=True)
        with monkeypatch.context() as patch:
            patch.setattr(levels_module, "SITES_AT_ONCE", 1000)
            patch.setattr(levels_module, "MAP_SITES_AT_ONCE", 800)
            pieces = level_loops(list(h), 7, placement=placement, rng=3, paths=True)
        for name in ("length", "radius", "area", "winding", "level", "weight", "surface"):
            np.testing.assert_array_equal(getattr(whole, name), getattr(pieces, name))
        for name in ("centroid", "vertices", "level_sets", "plaquettes"):
            np.testing.assert_array_equal(getattr(whole, name), getattr(pieces, name))


def open_pieces(h, level, scalar, valid):
    """Closed loops and open pieces as (length, radius, is open), by cutting scalar loops."""
    found = []
    padded = np.where(valid, h, -np.inf)
    padded = np.pad(padded, ((0, 1), (0, 1)), constant_values=-np.inf)
    inside = np.pad(valid, ((0, 1), (0, 1)))
    whole = inside & np.roll(inside, -1, 0)
    whole = whole & np.roll(whole, -1, 1)
    for path, _ in scalar.loops(padded, level):
        points = path[:-1]
        good = [bool(whole[x % whole.shape[0], y % whole.shape[1]]) for x, y in points]
        if all(good):
            found.append((len(points), int(np.ptp(points, 0).max()), False))
            continue
        turn = good.index(False)
        points, good = points[turn:] + points[:turn], good[turn:] + good[:turn]
        if turn:  # a loop on the torus of map and rim may have moved by a period: none does here
            assert path[0] == path[-1]
        piece = []
        for point, ok in zip([*points, None], [*good, False], strict=True):
            if ok:
                piece.append(point)
            elif piece:
                found.append((len(piece), int(np.ptp(piece, 0).max()), True))
                piece = []
    return sorted(found)


def test_open_maps_and_masks_cut_loops(scalar):
    rng = np.random.default_rng(4)
    opened = 0
    for trial in range(60):
        h = random_map(rng, trial)
        valid = rng.random(h.shape) > (0.0 if trial % 2 else 0.05)
        if not (valid[:-1, :-1] & valid[1:, :-1] & valid[:-1, 1:] & valid[1:, 1:]).any():
            continue
        level = float(np.median(h[valid])) + 1e-6
        mask = None if valid.all() else valid
        gaps = np.where(valid, h, np.nan)
        loops = level_loops(gaps, [level], boundary="open", mask=mask, paths=True)
        got = sorted(zip(loops.length.tolist(), loops.radius.tolist(), loops.is_open, strict=True))
        assert got == open_pieces(h, level, scalar, valid)
        assert not loops.winding.any()
        assert np.all(loops.area[loops.is_open] == 0)
        opened += loops.is_open.sum()
        if len(loops):
            assert loops.vertices.min() >= 0
            assert np.all(loops.vertices.max(0) <= np.array(h.shape) - 2)
    assert opened > 200


def test_levels_outside_the_heights_give_no_loops():
    h = np.random.default_rng(0).standard_normal((2, 8, 8))
    for options in ({}, {"boundary": "open"}, {"paths": True}):
        none = level_loops(h, [100.0, -100.0], **options)
        assert len(none) == 0
        assert none.surfaces == 2
        assert none.share_winding == 0
        assert np.all(none.level_sets == 2)
        assert none.mean_length().count.sum() == 0
        assert none.length_tail().count.sum() == 0
        assert "0 of whole level sets" in repr(none)
    some = level_loops(h, [0.0, 100.0])
    np.testing.assert_array_equal(some.length, level_loops(h, [0.0]).length)


def test_levels_equal_to_heights_are_moved_and_said_so():
    h = np.random.default_rng(0).standard_normal((40, 12, 12))
    h[:, 3, 4] = 0.0
    loops = level_loops(h, [0.0], rng=0)
    assert "moved by a rounding unit" in repr(loops)
    moved = np.unique(loops.level)
    assert len(moved) == 2, "up on some surfaces, down on others"
    assert np.all(np.abs(moved) < 1e-300)
    assert "moved" not in repr(level_loops(h, [0.1]))


@pytest.mark.parametrize("smooth", [8, 16])
def test_agrees_with_contourpy_where_there_is_no_saddle(smooth):
    contourpy = pytest.importorskip("contourpy")
    rng = np.random.default_rng(smooth)
    x = np.arange(64) * 2 * np.pi / 64
    h = np.zeros((64, 64))
    for _ in range(12):  # long waves, so that no plaquette is a saddle
        i, j = rng.integers(-5, 6, 2)
        h += rng.standard_normal() * np.cos(i * x[:, None] + j * x[None, :] + rng.random() * 6)
    level = 0.3 * h.std()
    lines = contourpy.contour_generator(z=h.T).lines(level)  # contourpy's x is our first axis
    closed = [line for line in lines if np.array_equal(line[0], line[-1])]
    ours = level_loops(h, [level], boundary="open", paths=True)
    mine = ours.select(ours.closed)
    assert len(mine) == len(closed) > 1
    for k in range(len(mine)):
        points = mine.path(k)
        near = [
            line
            for line in closed
            if np.max(np.min(np.hypot(*(points[:, None] - line[None]).T), 0)) < 1.0
        ]
        assert len(near) == 1
        # one point of contourpy a crossed bond, one step of ours a crossed bond
        assert len(near[0]) - 1 == mine.length[k]
        shoelace = np.sum(near[0][:-1, 0] * np.diff(near[0][:, 1]))
        # areas differ by at most half a plaquette a step
        assert abs(abs(shoelace) - abs(mine.area[k])) <= 0.5 * mine.length[k]


HEIGHTS = np.random.default_rng(0).standard_normal((2, 8, 8))


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"heights": np.where(HEIGHTS > 2, np.nan, HEIGHTS)}, ValueError, "Pass mask= with False"),
        (
            {"heights": [HEIGHTS[0], HEIGHTS[0, :6]]},
            ValueError,
            r"one shape; got \(8, 8\) and then",
        ),
        ({"heights": HEIGHTS + 1j}, TypeError, "real numbers"),
        ({"heights": 0 * HEIGHTS}, ValueError, "constant heights"),
        ({"mask": np.zeros((8, 8), bool)}, ValueError, "leaves none in surface 0"),
        ({"levels": 0}, ValueError, "levels must be at least 1; got 0"),
        ({"levels": [np.nan]}, ValueError, "finite heights; got"),
        ({"levels": []}, ValueError, "one or more finite heights"),
        ({"levels": "all"}, TypeError, "a number of levels or a list"),
        ({"levels": [[0.0]]}, TypeError, "a number of levels or a list"),
        ({"placement": "random"}, ValueError, "placement must be one of"),
        ({"boundary": "free"}, ValueError, "boundary must be one of"),
        ({"rng": "seed"}, TypeError, "rng must be"),
        ({"spacing": -1.0}, ValueError, "spacing must be positive"),
    ],
)
@pytest.mark.usefixtures("as_a_user")
def test_misuse_says_value_rule_and_remedy(change, error, message):
    arguments = {"heights": HEIGHTS, "levels": 3} | change
    with pytest.raises(error, match=message):
        level_loops(**arguments)
