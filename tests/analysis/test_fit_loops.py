import jax
import numpy as np
import pytest

import jaxsurf as js
from jaxsurf.analysis import fit_loops as room
from jaxsurf.analysis.fit_loops import expected_slopes, fit_loops, loop_slopes


def maps(alpha, surfaces, side=64, seed=99):
    law = js.SelfAffine(alpha)
    return np.asarray(js.sample(law, (side, side), key=jax.random.key(seed), batch=surfaces))


@pytest.mark.parametrize("alpha", [0.0, 0.2])  # at 0.6 the line is right by chance
def test_no_bias_where_the_straight_line_has_one(alpha):
    fit = fit_loops(maps(alpha, 24))
    assert fit.converged
    error = fit.total_error("alpha")
    assert abs(fit.values["alpha"] - alpha) < 4 * error
    # the control: D_f read off the same slope is off by many of these errors
    assert abs(3 - 2 * fit.details["slope"] - alpha) > 4 * error


def test_quoted_error_is_the_scatter_of_single_maps():
    heights = maps(0.4, 24)
    fits = [fit_loops(one) for one in heights]
    values = np.array([fit.values["alpha"] for fit in fits])
    # 24 values know their scatter to 15 %; the levels' phase is the same for all
    assert fits[0].stderr["alpha"] == pytest.approx(values.std(ddof=1), rel=0.6)
    together = fit_loops(heights)
    assert together.stderr["alpha"] == pytest.approx(fits[0].stderr["alpha"] / 24**0.5, rel=0.2)


def test_expected_slope_falls_with_alpha_at_every_shipped_size():
    for side in (64, 128, 256, 512):
        slopes = np.polyval(expected_slopes(side, "periodic").mean, np.linspace(-0.1, 1.1, 30))
        assert np.all(np.diff(slopes) < 0)


def test_units_of_height_do_not_matter():
    heights = maps(0.4, 2)
    np.testing.assert_allclose(loop_slopes(1e3 * heights), loop_slopes(heights), rtol=1e-6)


def test_other_sizes_are_simulated_once_and_cached(tmp_path, monkeypatch):
    calls = []

    def simulated(side, boundary):
        calls.append((side, boundary))
        return [
            dict(zip(room.COLUMNS, (boundary, side, a, 1.4 - 0.3 * a, 0.02, 64), strict=True))
            for a in room.ALPHAS
        ]

    monkeypatch.setattr(room, "simulate_slopes", simulated)
    for _ in range(2):
        expected = expected_slopes(40, "open", cache=tmp_path)
    assert calls == [(40, "open")]
    assert [file.name for file in tmp_path.iterdir()] == ["loop_slopes_open_40.csv"]
    np.testing.assert_allclose(np.polyval(expected.mean, [0.0, 1.0]), [1.4, 1.1], atol=1e-6)


def test_a_map_beyond_the_table_says_so():
    rng = np.random.default_rng(0)
    fit = fit_loops(rng.normal(size=(64, 64)))  # white noise: slopes of percolation
    assert "at its bound" in fit.status
    assert not fit.converged


@pytest.mark.parametrize(
    ("heights", "boundary", "message"),
    [
        (np.random.default_rng(0).normal(size=(64, 32)), "periodic", "needs square maps"),
        (np.random.default_rng(0).normal(size=(16, 16)), "periodic", "must be at least 32; got 16"),
        (np.random.default_rng(0).normal(size=(64, 64)), "half", "boundary must be one of"),
        (np.zeros((64, 64)), "periodic", "heights must vary"),
    ],
)
def test_misuse_says_value_rule_and_remedy(heights, boundary, message):
    with pytest.raises(ValueError, match=message):
        fit_loops(heights, boundary=boundary)
