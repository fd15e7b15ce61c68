"""Heights that come in steps: found, dithered by a thousandth of the step, and said so."""

import numpy as np
import pytest

from jaxsurf.loops.dither import DITHER, steps_of
from jaxsurf.loops.levels import level_loops
from jaxsurf.loops.maps import batches
from jaxsurf.loops.trace import trace_loops


def smooth(seed=0, side=48):
    h = np.random.default_rng(seed).standard_normal((side, side))
    return sum(np.roll(h, (i, j), (0, 1)) for i in range(4) for j in range(4))


def counts(bits, seed=0):
    h = smooth(seed)
    return np.rint((h - h.min()) / np.ptp(h) * (2**bits - 1))


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize(
    ("scale", "zero"), [(0.0371, 0.0), (0.0371, -12.3), (1e-9, 2e-8), (7.5, 3)]
)
def test_step_of_a_scaled_image(scale, zero, dtype):
    h = (counts(8) * scale + zero).astype(dtype)
    found = steps_of(h[None], None)
    # 255 steps from rounded heights: each is off by eps |h| at most
    rounding = float(np.finfo(dtype).eps * np.abs(h).max())
    assert found.step[0] == pytest.approx(scale, abs=4 * rounding)
    assert not found.is_unclear[0]
    maps = next(batches(h, None, 0, "periodic", 10**6))
    noise = maps.heights[0] - h
    assert noise.std() == pytest.approx(DITHER * scale, rel=0.1)  # 2304 draws: 1.5 % error
    assert f"steps of {scale:.2g}" in maps.notes[0]


def test_a_scale_changes_nothing():
    # a power of two, so that no height is rounded anew: the very same loops
    whole = trace_loops(counts(6), 60, rng=0)
    scaled = trace_loops(counts(6) / 64 + 0.25, 60, rng=0)
    assert "whole-number" in whole.notes[0]
    assert "steps of 0.016" in scaled.notes[0]
    np.testing.assert_array_equal(whole.length, scaled.length)
    np.testing.assert_array_equal(whole.area, scaled.area)


def test_heights_without_steps_are_left_alone():
    h = smooth()
    assert steps_of(h[None].astype(np.float32), None).step[0] == 0
    maps = next(batches(h, None, 0, "periodic", 10**6))
    assert maps.notes == ()
    np.testing.assert_array_equal(maps.heights[0], h)


def test_repeated_heights_without_a_common_step_are_said():
    h = np.round(np.exp(0.2 * counts(5) / 4), 12)  # 32 heights, no two alike far apart
    found = steps_of(h[None], None)
    assert found.step[0] == 0
    assert found.is_unclear[0]
    loops = trace_loops(h, 30, rng=0)
    assert "no common step" in loops.notes[0]
    given = trace_loops(h, 30, rng=0, step=0.01)
    assert given.notes == ("dithered heights in steps of 0.01: Gaussian noise of 1e-05 added",)


def test_masked_sites_do_not_hide_the_step():
    h = 0.5 * counts(6) + 0.2
    mask = np.ones(h.shape, bool)
    mask[3:6, 3:9] = False
    h[~mask] = np.random.default_rng(1).standard_normal(18)
    assert steps_of(h[None], mask[None]).step[0] == pytest.approx(0.5)
    assert steps_of(h[None], None).step[0] == 0, "the control: with them there is none"


@pytest.mark.parametrize("scale", [1.0, 0.5])
def test_the_first_rows_may_be_masked(scale):
    h, mask = scale * counts(6), np.ones((48, 48), bool)
    h[:10], mask[:10] = np.nan, False
    assert steps_of(h[None], mask[None]).step[0] == scale


def test_same_loops_whatever_maps_are_beside():
    h = np.stack([smooth(1), 0.1 * counts(8, 2), smooth(3), counts(8, 4), 0.3 * counts(8, 5)])
    together = level_loops(h, 3, rng=0)
    one_by_one = level_loops(list(h), 3, rng=0)
    np.testing.assert_array_equal(together.length, one_by_one.length)
    np.testing.assert_array_equal(together.level, one_by_one.level)
    assert sum("steps of" in note for note in together.notes) == 2
    assert sum("whole-number" in note for note in together.notes) == 1
    alone = level_loops(h[0], 3, rng=0)
    np.testing.assert_array_equal(alone.length, together.length[together.surface == 0])


@pytest.mark.parametrize("step", [0, -1.0, float("nan"), 1e9])
@pytest.mark.parametrize("find", [trace_loops, level_loops])
def test_misuse_says_value_rule_and_remedy(find, step):
    with pytest.raises(ValueError, match="step must be .* got .* Leave it out"):
        find(smooth(), 4, rng=0, step=step)
