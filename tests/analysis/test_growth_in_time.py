"""A course of growth: everything measured on the way, its records, and misuse."""

import json

import numpy as np
import pytest

from jaxsurf.analysis.growth_in_time import GrowthSettings, reproduce_growth
from jaxsurf.fitting.power_law import fit_power_law

# Sublattice updates: the fastest to compile and to run; what is tested here is the path.
SMALL = GrowthSettings(
    side=64, last=16, first=1, replicas=5, points=60, draws=20, scheme="sublattice"
)


@pytest.fixture(scope="module")
def growth():
    said = []
    growth = reproduce_growth(SMALL, progress=lambda share, text: said.append((share, text)))
    assert said[0] == (0.0, "growing to t = 1")
    assert said[-1] == (1.0, "done")
    assert all(a[0] <= b[0] + 1e-9 for a, b in zip(said[:-1], said[1:], strict=True))
    return growth


def test_everything_is_measured_at_every_time(growth):
    times = [1.0, 2.0, 4.0, 8.0, 16.0]
    assert SMALL.times.tolist() == times
    assert list(growth.scaling.times) == list(growth.loops) == times
    assert growth.scaling.increments.scale.tolist() == times[:-1]
    for curve in (growth.scaling.width, growth.skewness, growth.kurtosis):
        assert curve.scale.tolist() == times
        assert curve.surfaces == SMALL.replicas
    assert growth.skewness.kind == "height_skewness"
    assert set(growth.white_noise) == {"mean_length", "length_tail", "loop_correlation"}
    assert np.all(np.diff(growth.scaling.width.mean[1:]) > 0)  # the surface roughens
    assert growth.beyond == {}  # on 64 x 64 sites no loop is far beyond xi and far below L


def test_heights_that_evaporate_are_lopsided(growth):
    late = float(growth.skewness.mean[-1]), float(growth.skewness.stderr[-1])
    assert late[0] > 4 * late[1]
    assert late[0] < 0.6


def test_records_are_plain(growth):
    plain = json.loads(json.dumps(growth.to_dict()))
    assert plain["settings"]["scheme"] == "sublattice"
    assert plain["exponents"]["z"][0] == growth.scaling.exponents["z"][0]
    rows = growth.to_rows()
    assert [row["t"] for row in rows] == [1.0, 2.0, 4.0, 8.0, 16.0]
    assert rows[2]["w2"] == float(growth.scaling.width.mean[2])
    gained = rows[3]["w2"] - rows[2]["w2"]
    assert rows[2]["w2(2t)-w2(t)"] == pytest.approx(gained)
    assert np.isnan(rows[-1]["w2(2t)-w2(t)"])


@pytest.mark.slow
def test_early_loops_are_those_of_white_noise():
    settings = GrowthSettings(side=256, last=64, first=2, replicas=8, draws=30, scheme="sublattice")
    growth = reproduce_growth(settings)
    assert 1.0 in growth.beyond
    for kinds in growth.beyond.values():
        for kind, (grown, white) in kinds.items():
            # the correction (R/xi)^(-3/4), up to 1/8 of the slope, is in the window's error
            error = np.hypot(np.hypot(*grown[1:]), np.hypot(*white[1:]))
            assert abs(grown[0] - white[0]) < 3 * error, kind
    # the control: in the window of t = 1 the surface of t = 64 has other loops, and errors tell
    late, noise = (
        fit_power_law(curve["mean_length"], window=(16.0, 64.0), weighting="equal", draws=30)
        for curve in (growth.loops[64.0], growth.white_noise)
    )
    apart = noise.values["exponent"] - late.values["exponent"]
    assert apart > 5 * np.hypot(noise.stderr["exponent"], late.stderr["exponent"])


@pytest.mark.usefixtures("as_a_user")
@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"model": "ballistic"}, "model must be one of"),
        ({"p_plus": 1.5}, r"p_plus must lie in \[0, 1\]; got 1.5"),
        ({"side": 32}, "side must be at least 64; got 32"),
        ({"last": 8}, "last must be at least 16; got 8"),
        ({"last": 100}, "last must be a power of 2; got 100"),
        ({"first": 32}, r"first must lie in \[1, 16\]; got 32"),
        ({"first": 0}, "first must be at least 1; got 0"),
        ({"replicas": 4}, "replicas must be at least 5; got 4"),
        ({"points": 0}, "points must be at least 1; got 0"),
        ({"draws": 5}, "draws must be at least 20; got 5"),
        ({"scheme": "parallel"}, "scheme must be one of"),
        ({"seed": -1}, "seed must be at least 0; got -1"),
    ],
)
def test_misuse_says_value_rule_and_remedy(change, message):
    with pytest.raises(ValueError, match=message):
        GrowthSettings(**change)


def test_an_odd_side_is_refused_before_anything_grows():
    with pytest.raises(ValueError, match="side of the single-step model must be even; got 65"):
        GrowthSettings(side=65)
    assert GrowthSettings(model="mullins-herring", side=65).side == 65
