import numpy as np
import pytest

from jaxsurf.loops.areas import area_distribution, area_tail, perimeter_of_area
from jaxsurf.loops.levels import level_loops
from jaxsurf.loops.trace import trace_loops


def blocks():
    """A map with square islands of sides 1, 2, 3 on a sea, and a lake of side 2 in a plain."""
    h = np.zeros((24, 20))
    for (x, y), side in (((2, 2), 1), ((2, 8), 2), ((8, 3), 3)):
        h[x : x + side, y : y + side] = 1.0
    h[14:22, 3:13] = 1.0
    h[16:18, 6:8] = 0.0
    return h + 1e-3 * np.random.default_rng(0).random(h.shape)


def test_areas_of_squares():
    loops = level_loops(blocks(), [0.5], spacing=0.5)
    assert sorted(loops.area) == [-4, 1, 4, 9, 80]
    tail = area_tail(loops)
    searched = 24 * 20 * 0.25
    np.testing.assert_allclose(tail.scale[:3], np.array([1.5, 2.5, 3.5]) * 0.25)
    np.testing.assert_allclose(tail.samples[0, :3], np.array([4, 4, 4]) / searched)
    assert area_tail(loops, side="hills").samples[0, 2] * searched == pytest.approx(3)
    assert area_tail(loops, side="pits").samples[0, 2] * searched == pytest.approx(1)
    assert tail.samples[0, -1] == 0
    assert tail.units == ("length^2", "1/length^2")
    density = area_distribution(loops)
    assert density.samples[0, 0] * searched * 0.25 == pytest.approx(1)  # area 1, one loop
    assert density.samples[0, 3] * searched * 0.25 == pytest.approx(2)  # areas 4 and -4
    coast = perimeter_of_area(loops, side="hills")
    assert coast.samples[0, 0] == pytest.approx(4 * 0.5)
    assert coast.samples[0, 3] == pytest.approx(8 * 0.5)


def test_tail_is_the_sum_of_the_distribution():
    h = np.random.default_rng(1).standard_normal((5, 64, 64))
    loops = level_loops(h, 4, rng=0)
    tail, density = area_tail(loops), area_distribution(loops)
    # area 1 alone is in the first bin: what is left is larger than 1.5
    every = np.array([np.sum(loops.closed & (loops.surface == k)) for k in range(5)]) / (
        4 * 64 * 64
    )
    np.testing.assert_allclose(tail.samples[:, 0], every - density.samples[:, 0])


def test_hulls_of_percolation_have_the_amplitude_of_cardy_and_ziff():
    # White noise at its median: A N(>A) tends to 1 / (8 sqrt(3) pi) for hills and for pits alike.
    exact = 1 / (8 * np.sqrt(3) * np.pi)
    h = np.random.default_rng(5).standard_normal((40, 256, 256)).astype(np.float32)
    loops = level_loops(h, 1, placement="quantiles")
    for side, amplitude in (("hills", exact), ("pits", exact), ("both", 2 * exact)):
        curve = area_tail(loops, side=side).window(30.0, 100.0)
        product, error = curve.mean * curve.scale, curve.stderr * curve.scale
        assert np.all(np.abs(product - amplitude) < 5 * error + 0.02 * amplitude)
        assert np.all(error < 0.06 * amplitude)  # the control: an amplitude off by a third is seen
        assert np.all(np.abs(product - 4 / 3 * amplitude) > 5 * error)


def test_misuse_says_value_rule_and_remedy():
    h = blocks()
    with pytest.raises(ValueError, match="side must be one of .*got 'left'"):
        area_tail(level_loops(h, 2), side="left")
    with pytest.raises(ValueError, match="needs whole level sets"):
        area_tail(trace_loops(h, 5, rng=0))
    with pytest.raises(ValueError, match="needs whole level sets"):
        area_distribution(level_loops(h, 3, placement="points"))
