"""One map by four roads: a known alpha is recognised, and tilts and holes do not matter."""

import jax
import numpy as np
import pytest

import jaxsurf as js
from jaxsurf.analysis.measure import ROADS, measure_map
from jaxsurf.io.heightmap import HeightMap


def surface(alpha, seed=0, side=256):
    # a quarter of a periodic map: its edges do not match, as those of an image
    key = jax.random.key(seed)
    whole = js.sample(js.SelfAffine(alpha), (2 * side, 2 * side), key=key)
    return np.asarray(whole, float)[:side, :side]


@pytest.fixture(scope="module")
def measured():
    x = np.arange(256.0)
    tilted = surface(0.7) + 0.05 * x[:, None] - 0.02 * x[None, :]
    return measure_map(HeightMap(tilted, 2.0, "nm", "pm", "test"), points=400)


def test_alpha_is_found_by_every_road(measured):
    for name, road in measured.roads.items():
        value, statistical, systematic = road.alpha
        # within 3 total errors, which a wrong alpha of 0 is not for the two sharpest roads
        assert abs(value - 0.7) < 3 * np.hypot(statistical, systematic), name
        assert statistical > 0
    for name in ("spectrum", "curvature variance"):
        value, statistical, systematic = measured.roads[name].alpha
        assert value > 3 * np.hypot(statistical, systematic), name


def test_a_smoother_surface_has_a_larger_alpha(measured):
    rough = measure_map(HeightMap(surface(0.2)), points=200)
    for name in ("spectrum", "curvature variance", "loop dimension D_f"):
        assert rough.roads[name].alpha[0] < measured.roads[name].alpha[0] - 0.2, name


def test_units_and_records(measured):
    assert measured.curves["spectrum"].units == ("1/nm", "pm^2 nm^2")
    assert measured.curves["mean_length"].units == ("nm", "nm")
    record = measured.to_dict()
    assert set(record["measures"]) == set(ROADS)
    assert record["units"] == ("nm", "pm")
    assert 0 < measured.share_open < 1


def test_missing_sites_are_left_out():
    heights = surface(0.7, side=128)
    whole = measure_map(HeightMap(heights), points=100)
    heights[60:64, 50:60] = np.nan
    holed = measure_map(HeightMap(heights), points=100)
    for name in ("spectrum", "curvature variance"):
        apart = abs(holed.roads[name].alpha[0] - whole.roads[name].alpha[0])
        # 40 of 16,384 sites: the pairs left give the same curve to a few per cent
        assert apart < 0.1, name


@pytest.mark.parametrize(
    ("heights", "message"),
    [
        (np.zeros((64, 64)), "heights must vary"),
        (np.random.default_rng(0).normal(size=(20, 64)), "at least 64 x 64 sites"),
    ],
)
def test_misuse(heights, message):
    with pytest.raises(ValueError, match=message):
        measure_map(HeightMap(heights))
