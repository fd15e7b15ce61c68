import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jaxsurf.loops import starts as starts_module
from jaxsurf.loops import trace as trace_module
from jaxsurf.loops import walk as walk_module
from jaxsurf.loops.loops import Loops
from jaxsurf.loops.maps import Maps, seed_of
from jaxsurf.loops.starts import draw_starts
from jaxsurf.loops.trace import trace_loops


def traced(h, points, rng, **options):
    """The loops of one map together with where they started."""
    seed = seed_of(rng)
    starts = draw_starts(Maps(h[None], None, h.shape, 0, ()), points, seed).starts
    return trace_loops(h, points, rng=rng, **options), starts


def row(loops, k):
    return (
        int(loops.length[k]),
        int(loops.radius[k]),
        int(loops.area[k]),
        int(loops.winding[k, 0]),
        int(loops.winding[k, 1]),
    )


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_agrees_with_a_scalar_tracer_loop_by_loop(dtype, scalar):
    rng = np.random.default_rng(5)
    seen_saddle = seen_winding = 0
    for trial in range(150):
        shape = tuple(rng.integers(4, 24, 2))
        h = rng.standard_normal(shape)
        if trial % 3 == 1:  # smoother, so that loops are longer and wind more often
            h = sum(np.roll(h, (i, j), (0, 1)) for i in range(3) for j in range(3))
        if trial % 3 == 2:
            h = np.cumsum(h, 0) - np.linspace(0, 1, shape[0])[:, None] * np.sum(h, 0)
        loops, starts = traced(h.astype(dtype), 12, trial)
        for k in range(12):
            where = (starts.x[k], starts.y[k], starts.direction[k])
            path, bonds, _ = scalar.loop(h.astype(dtype), starts.level[k], *map(int, where))
            assert row(loops, k) == scalar.summary(path, shape)
            assert len(set(bonds)) == len(bonds), "a bond was crossed twice"
            seen_saddle += len({(x % shape[0], y % shape[1]) for x, y in path}) < len(path) - 1
            seen_winding += bool(loops.winding[k].any())
    assert seen_saddle > 100
    assert seen_winding > 100


def ensemble(loops):
    """The loops as a sorted list, whatever their order."""
    return sorted(row(loops, k) + (float(loops.level[k]),) for k in range(len(loops)))


def all_starts(h):
    """The loop through every plaquette that is no saddle at its own level: a set without chance."""
    x, y = np.divmod(np.arange(h.size), h.shape[1])
    around = h.ravel()[starts_module._corner_sites(np.arange(h.size), *h.shape)]
    level = walk_module.mean_height(*around)
    enter = np.roll(around > level, 1, 0) & (around <= level)
    plain = enter.sum(0) == 1
    x, y, level, enter = x[plain], y[plain], level[plain], enter[:, plain]
    starts = walk_module.Starts(np.zeros_like(x), x, y, enter.argmax(0), level)
    found = walk_module.walk(walk_module.lay_out(h[None], None), starts, np.arange(len(x)), None, 1)
    return x, y, np.column_stack([found.length, found.radius, found.area, found.winding])


@given(st.integers(4, 20), st.integers(4, 20), st.integers(0, 2**32 - 1))
@settings(max_examples=40, deadline=None)
def test_symmetries_are_exact(lx, ly, seed):
    h = np.random.default_rng(seed).standard_normal((lx, ly))
    x, y, loops = all_starts(h)
    table = dict(zip(zip(x.tolist(), y.tolist(), strict=True), loops.tolist(), strict=True))

    def compare(other, place, change):
        px, py, found = all_starts(other)
        moved = {
            (int(a), int(b)): change(v)
            for a, b, v in zip(*place(px, py), found.tolist(), strict=True)
        }
        assert moved == table

    # h -> -h: the same loops walked backwards around pits instead of hills
    compare(-h, lambda x, y: (x, y), lambda v: [v[0], v[1], -v[2], -v[3], -v[4]])
    compare(np.roll(h, (3, -2), (0, 1)), lambda x, y: ((x - 3) % lx, (y + 2) % ly), lambda v: v)
    # transposition is a reflection: with the hill kept on the left, windings change sides and sign
    compare(h.T, lambda x, y: (y, x), lambda v: [v[0], v[1], v[2], -v[4], -v[3]])
    # rot90(h, -1)[i, j] = h[lx - 1 - j, i]: a vector (dx, dy) becomes (dy, -dx)
    compare(
        np.rot90(h, -1),
        lambda x, y: ((lx - 2 - y) % lx, x),
        lambda v: [v[0], v[1], v[2], -v[4], v[3]],
    )


def test_a_single_hill_and_a_single_pit():
    h = np.zeros((6, 7)) + np.arange(42).reshape(6, 7) * 1e-3
    for sign in (1, -1):
        bump = h.copy()
        bump[2, 3] = 10.0 * sign
        loops = trace_loops(bump, 300, rng=0)
        around = np.abs(loops.level) > 1
        assert around.sum() > 5
        assert set(loops.length[around]) == {4}
        assert set(loops.radius[around]) == {1}
        assert set(loops.area[around]) == {sign}


def test_same_loops_whatever_the_batch(monkeypatch):
    h = np.random.default_rng(0).standard_normal((7, 33, 40))
    whole = trace_loops(h, 50, rng=3, correlation=True)
    integers = np.round(3 * h).astype(int)
    dithered = trace_loops(integers, 50, rng=3)
    as_list = trace_loops(list(h), 50, rng=3)
    monkeypatch.setattr(trace_module, "SITES_AT_ONCE", 3000)
    monkeypatch.setattr(walk_module, "WALKERS_AT_ONCE", 17)
    pieces = trace_loops(h, 50, rng=3, correlation=True)
    for name in ("length", "radius", "area", "winding", "surface", "level", "pairs"):
        np.testing.assert_array_equal(getattr(whole, name), getattr(pieces, name))
    np.testing.assert_array_equal(whole.length, as_list.length)
    np.testing.assert_array_equal(dithered.length, trace_loops(integers, 50, rng=3).length)
    assert not np.array_equal(whole.length, trace_loops(h, 50, rng=4).length)


def test_pairs_are_those_of_the_closed_loops_unwrapped(scalar):
    h = np.random.default_rng(1).standard_normal((14, 11))
    h = h + np.roll(h, 1, 0) + np.roll(h, 1, 1)
    loops, starts = traced(h, 200, 7, correlation=True)
    assert loops.winding.any(), "the test must see loops whose points are taken back"
    expected = np.zeros(14, int)
    for k in np.flatnonzero(loops.closed):
        path, _, _ = scalar.loop(h, starts.level[k], starts.x[k], starts.y[k], starts.direction[k])
        away = np.hypot(*(np.array(path[1:-1]) - path[0]).T)
        expected += np.bincount(away.astype(int)[(away >= 1) & (away < 14)], minlength=14)
    np.testing.assert_array_equal(loops.pairs[0], expected)


def test_the_coin_at_a_saddle_is_fair():
    # Starts at a saddle must leave heights and minus heights alike: equal hills and pits.
    h = np.random.default_rng(2).standard_normal((40, 64, 64))
    loops, starts = traced(h[0], 20000, 0)
    share = np.mean(starts.level != loops.level)  # any start tosses the coin
    assert abs(share - 0.5) < 5 * 0.5 / np.sqrt(20000)
    many = trace_loops(h, 500, rng=1)
    hills = np.array([np.mean(many.area[many.surface == k] > 0) for k in range(40)])
    # 5 standard errors of the share of hills over surfaces
    assert abs(hills.mean() - 0.5) < 5 * hills.std(ddof=1) / np.sqrt(40)


def test_open_maps_and_masks_set_loops_aside():
    rng = np.random.default_rng(3)
    big = rng.standard_normal((60, 60))
    big = sum(np.roll(big, (i, j), (0, 1)) for i in range(4) for j in range(4))
    h = big[10:42, 5:40]
    loops = trace_loops(h, 400, rng=0, boundary="open")
    assert 0 < loops.share_open < 1
    assert not loops.winding.any()
    assert np.all(loops.area[loops.is_open] == 0)
    # a mask on a periodic map and an open map see the same closed loops
    mask = np.zeros((60, 60), bool)
    mask[10:42, 5:40] = True
    masked = trace_loops(big, 400, rng=0, mask=mask)
    np.testing.assert_array_equal(masked.is_open, loops.is_open)
    for name in ("length", "radius", "area", "level"):
        values = getattr(loops, name)[loops.closed], getattr(masked, name)[loops.closed]
        np.testing.assert_array_equal(*values)
    with_gaps = np.where(mask, big, np.nan)
    np.testing.assert_array_equal(
        trace_loops(with_gaps, 400, rng=0, mask=mask).length, masked.length
    )


@pytest.mark.parametrize("dtype", [np.int32, np.float64])
def test_whole_number_heights_are_dithered_and_said_so(dtype):
    h = np.random.default_rng(0).integers(0, 4, (16, 16)).astype(dtype)
    loops = trace_loops(h, 100, rng=0)
    assert "dithered" in repr(loops)
    assert np.all(loops.length % 2 == 0)
    assert np.all(loops.length >= 4)
    # levels are means of four whole numbers, up to the dither
    assert np.max(np.abs(4 * loops.level - np.round(4 * loops.level))) < 0.05
    smooth = np.random.default_rng(1).standard_normal((16, 16))
    assert "dithered" not in repr(trace_loops(h + smooth, 100, rng=0))


def test_starts_where_heights_coincide_are_drawn_again():
    h = np.random.default_rng(0).standard_normal((12, 12))
    h[:8] = 0.25  # two thirds of the plaquettes are flat
    loops = trace_loops(h, 60, rng=0)
    assert loops.redrawn > 50
    assert "redrawn" in repr(loops)
    flat = np.zeros((400, 400))
    flat[0, 0] = 0.25
    flat[0, 1] = 0.6  # no multiple of a step that 0.25 is one of: not dithered
    with pytest.raises(ValueError, match="no contour found through .* nearly all its heights"):
        trace_loops(flat, 400, rng=0)


def test_a_generator_is_used_up_and_an_integer_is_not():
    h = np.random.default_rng(0).standard_normal((16, 16))
    rng = np.random.default_rng(1)
    first, second = trace_loops(h, 40, rng=rng), trace_loops(h, 40, rng=rng)
    assert not np.array_equal(first.level, second.level)
    again = trace_loops(h, 40, rng=np.random.default_rng(1))
    np.testing.assert_array_equal(first.level, again.level)


def test_jax_arrays_are_taken():
    import jax

    h = jax.random.normal(jax.random.key(0), (2, 16, 16))
    np.testing.assert_array_equal(
        trace_loops(h, 30, rng=0).length, trace_loops(np.asarray(h), 30, rng=0).length
    )


def test_maps_may_come_one_by_one_and_of_several_kinds():
    rng = np.random.default_rng(0)
    smooth = rng.standard_normal((3, 16, 16))
    whole = rng.integers(0, 5, (2, 16, 16))
    loops = trace_loops(iter([*smooth, *whole.astype(np.int32)]), 30, rng=0)
    assert loops.surfaces == 5
    assert "dithered" in repr(loops)
    alone = trace_loops(smooth, 30, rng=0)
    np.testing.assert_array_equal(loops.length[: len(alone)], alone.length)
    assert np.array_equal(np.unique(loops.surface), np.arange(5))


def test_loops_join_and_select():
    h = np.random.default_rng(0).standard_normal((4, 16, 16))
    first, second = trace_loops(h[:2], 30, rng=0), trace_loops(h[2:], 30, rng=1)
    both = Loops.join([first, second])
    assert both.surfaces == 4
    assert set(both.surface) == {0, 1, 2, 3}
    np.testing.assert_array_equal(both.select(both.surface >= 2).length, second.length)
    with pytest.raises(ValueError, match="share shape"):
        Loops.join([first, trace_loops(h[:, :8], 3, rng=0)])
    with pytest.raises(ValueError, match="must not be empty"):
        Loops.join([])
    assert "<table>" in first._repr_html_()


HEIGHTS = np.random.default_rng(0).standard_normal((2, 8, 8))


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"heights": np.where(HEIGHTS > 2, np.nan, HEIGHTS)}, ValueError, "finite; got .* NaN"),
        (
            {"heights": np.where(HEIGHTS > 2, np.inf, HEIGHTS)},
            ValueError,
            "finite; got .* infinite",
        ),
        ({"heights": HEIGHTS + 1j}, TypeError, "real numbers; got dtype complex128"),
        ({"heights": HEIGHTS[0, 0]}, ValueError, r"map \[x, y\].*got shape \(8,\)"),
        ({"heights": HEIGHTS[None]}, ValueError, r"got shape \(1, 2, 8, 8\)"),
        ({"heights": HEIGHTS[:, :3]}, ValueError, r"at least 4 x 4 sites; got shape \(2, 3, 8\)"),
        ({"heights": 0 * HEIGHTS}, ValueError, "constant heights in surface 0"),
        ({"heights": []}, ValueError, "at least one map; got none"),
        ({"heights": 3.0}, TypeError, "must be an array; got float"),
        ({"heights": [[1.0, 2.0]]}, TypeError, "must be an array or hold arrays"),
        (
            {"heights": [HEIGHTS[0], HEIGHTS[0, :6]]},
            ValueError,
            r"one shape; got \(8, 8\) and then",
        ),
        ({"points": 0}, ValueError, "points must be at least 1; got 0"),
        ({"points": -3}, ValueError, "points must be at least 1; got -3"),
        ({"points": 2.5}, TypeError, "points must be an integer; got 2.5"),
        ({"rng": 0.5}, TypeError, "rng must be a numpy.random.Generator or an integer"),
        ({"rng": -1}, TypeError, "rng must be"),
        ({"boundary": "free"}, ValueError, "boundary must be one of .*got 'free'"),
        ({"spacing": 0.0}, ValueError, "spacing must be positive and finite; got 0.0"),
        ({"mask": np.ones((8, 8))}, TypeError, "mask must be boolean"),
        ({"mask": np.ones((8, 7), bool)}, ValueError, "mask must have the shape"),
        ({"mask": np.zeros((8, 8), bool)}, ValueError, "leave at least one plaquette"),
    ],
)
@pytest.mark.usefixtures("as_a_user")
def test_misuse_says_value_rule_and_remedy(change, error, message):
    arguments = {"heights": HEIGHTS, "points": 5, "rng": 0} | change
    with pytest.raises(error, match=message):
        trace_loops(**arguments)
