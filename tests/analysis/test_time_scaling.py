"""Scaling in time: linear growth, whose exponents are exact, must come out; then misuse."""

import jax
import numpy as np
import pytest

import jaxsurf as js
from jaxsurf.analysis.time_scaling import (
    loops_in_time,
    scale_in_time,
    width_in_time,
    width_increments,
)
from jaxsurf.curve import Curve

TIMES = {"edwards-wilkinson": 2.0 ** np.arange(2, 9), "mullins-herring": 4.0 ** np.arange(2, 8)}
EXACT = {"edwards-wilkinson": (0.0, 2.0), "mullins-herring": (1.0, 4.0)}
COEFFICIENT = {"edwards-wilkinson": 0.25, "mullins-herring": 0.1}


def grown(equation):
    times = TIMES[equation]
    return js.grow_linear(
        (128, 128),
        equation=equation,
        time=float(times[-1]),
        snapshots=times,
        batch=24,
        key=jax.random.key(1),
        coefficient=COEFFICIENT[equation],
    )


@pytest.mark.parametrize(
    "equation",
    ["mullins-herring", pytest.param("edwards-wilkinson", marks=pytest.mark.slow)],
)
def test_linear_growth_has_its_exact_exponents(equation):
    alpha, z = EXACT[equation]
    said = []
    times = TIMES[equation]
    result = scale_in_time(
        grown(equation),
        times,
        ratio=times[1] / times[0],
        draws=20,
        progress=lambda share, text: said.append(share),
    )
    found = result.exponents
    assert result.collapse.converged
    for name, exact in (("alpha", alpha), ("z", z), ("beta", alpha / z)):
        value, *errors = found[name]
        # 4 errors, each known to 20 % from 24 surfaces and 20 draws
        assert abs(value - exact) < 4 * np.hypot(*errors), name
    # the controls: the other equation's exponents would fail the same bound
    other = EXACT["mullins-herring" if alpha == 0 else "edwards-wilkinson"]
    assert abs(found["alpha"][0] - other[0]) > 6 * np.hypot(*found["alpha"][1:])
    assert abs(found["z"][0] - other[1]) > 6 * np.hypot(*found["z"][1:])
    assert said[0] == 0.0
    assert said[-1] == 1.0
    assert said == sorted(said)
    value, *errors = found["beta of the width"]  # of its increments, t^(1/2) or constant
    assert abs(value - alpha / z) < 4 * np.hypot(*errors)
    assert abs(value - 0.25 + alpha / z) > 6 * errors[0]  # the control
    if equation == "mullins-herring":
        # and the knee moves as the exact correlation length does, up to one constant factor
        ratios = {t: xi / (0.2 * t) ** 0.25 for t, (xi, _) in result.correlation_length.items()}
        late = [ratio for t, ratio in ratios.items() if t >= 1024]
        assert len(late) >= 2
        # errors of xi are 4 to 8 %; half the true z would change the ratio by 2^(1/2) a step
        assert max(late) / min(late) < 1.25


def test_width_is_the_variance_of_each_map():
    heights = np.random.default_rng(0).normal(size=(3, 5, 8, 8)) + 1000.0
    curve = width_in_time(heights, [1, 2, 4])
    assert (curve.kind, curve.surfaces) == ("width", 5)
    # float32 heights of order one: relative error 1e-6
    np.testing.assert_allclose(curve.samples, heights.var((-2, -1)).T, rtol=1e-4)
    np.testing.assert_array_equal(curve.scale, [1, 2, 4])


def test_increments_of_the_width_do_without_its_constant():
    times = np.array([1.0, 2, 3, 4, 6, 8, 12, 16])
    growing = np.linspace(0.5, 1.5, 5)[:, None] * times**0.48
    width = Curve("width", times, 0.7 + growing)
    gain = width_increments(width)
    assert (gain.kind, gain.detail("ratio"), gain.surfaces) == ("width_increment", 2.0, 5)
    np.testing.assert_array_equal(gain.scale, [1, 2, 3, 4, 6, 8])
    # exact but for rounding: a pure power of t, whatever the constant
    np.testing.assert_allclose(gain.mean, (2**0.48 - 1) * gain.scale**0.48, rtol=1e-12)
    assert js.fit_power_law(gain).values["exponent"] == pytest.approx(0.48, abs=1e-9)
    assert js.fit_power_law(width).values["exponent"] < 0.4  # the control: w^2 itself is flatter
    np.testing.assert_array_equal(width_increments(width, 4).scale, [1, 2, 3, 4])
    # the pairs (2, 3), (4, 6), (8, 12)
    np.testing.assert_array_equal(width_increments(width, 1.5).scale, [2, 4, 8])


@pytest.mark.parametrize(
    ("ratio", "message"),
    [(1.0, r"ratio must lie in \(1, inf\); got 1.0"), (7, "must stand in the ratio 7; got")],
)
def test_increments_need_two_times_in_the_ratio(ratio, message):
    width = Curve("width", np.array([1.0, 2.0, 4.0]), np.ones((3, 3)))
    with pytest.raises(ValueError, match=message):
        width_increments(width, ratio)


def test_loops_of_every_time_and_surface():
    heights = js.grow_single_step(
        (32, 32), p_plus=0.1, sweeps=4, snapshots=[1, 4], batch=3, key=jax.random.key(0)
    )
    found = loops_in_time(heights, [1, 4], points=50, rng=0)
    assert list(found) == [1.0, 4.0]
    for curves in found.values():
        assert set(curves) == {"mean_length", "length_tail", "loop_correlation"}
        assert all(curve.surfaces == 3 for curve in curves.values())
    again = loops_in_time(heights, [1, 4], points=50, rng=0)
    np.testing.assert_array_equal(
        found[4.0]["length_tail"].samples, again[4.0]["length_tail"].samples
    )


def slopes(curves, low, high):
    """Exponent, its total and its statistical error, of each loop measure; s ~ R^(7/4)."""
    windows = {
        "mean_length": (low, high),
        "length_tail": (low**1.75, high**1.75),
        "loop_correlation": (low, high),
    }
    fits = {
        kind: js.fit_power_law(curves[kind], window=window, weighting="equal", draws=50)
        for kind, window in windows.items()
    }
    return {
        kind: (fit.values["exponent"], fit.total_error("exponent"), fit.stderr["exponent"])
        for kind, fit in fits.items()
    }


PERCOLATION = {"mean_length": 7 / 4, "length_tail": -4 / 7, "loop_correlation": -5 / 4}


@pytest.mark.slow
def test_loops_beyond_the_correlation_length_are_percolation_hulls():
    times = [0.5, 4096.0]
    heights = js.grow_linear(
        (256, 256),
        equation="edwards-wilkinson",
        time=times[-1],
        snapshots=times,
        batch=16,
        key=jax.random.key(2),
        coefficient=0.25,
    )
    early, late = loops_in_time(heights, times, points=1500, rng=3).values()
    young, old = slopes(early, 10, 64), slopes(late, 10, 64)
    for kind, exact in PERCOLATION.items():
        # xi = 0.5, and R starts at 20 xi, where the correction R^(-3/4) is below a tenth
        assert abs(young[kind][0] - exact) < 4 * young[kind][1] + 0.03
        # the control: once xi = 45, the loops are those of alpha = 0, D_f = 3/2, 1/3 and 1
        assert abs(old[kind][0] - exact) > 4 * old[kind][2], kind


@pytest.mark.slow
def test_early_loops_of_the_single_step_model_are_those_of_white_noise():
    shape, times = (512, 512), [4, 128]
    heights = js.grow_single_step(
        shape, p_plus=0.1, sweeps=times[-1], batch=8, snapshots=times, key=jax.random.key(4)
    )
    early, late = loops_in_time(heights, times, points=3000, rng=5).values()
    noise = js.sample(js.WhiteNoise(), shape, key=jax.random.key(6), batch=8)
    (white,) = loops_in_time(noise[None], [1], points=3000, rng=7).values()
    found, reference = (slopes(c, 40, 128) for c in (early, white))
    for kind, exact in PERCOLATION.items():
        value, error, _ = found[kind]
        # On a map of this size white noise itself is off percolation's exponents by up to 0.15, so
        # it is the reference; xi is 2 to 3 sites, and the correction (R/xi)^(-3/4) leaves 0.05.
        assert abs(value - reference[kind][0]) < 3 * np.hypot(error, reference[kind][1]) + 0.05
        assert abs(reference[kind][0] - exact) < 3 * reference[kind][1] + 0.15
    # the control: at t = 128, xi = 23, loops about as large are those of a rough surface; 0.1 is
    # six errors of either slope
    inside, of_noise = slopes(late, 8, 32), slopes(white, 8, 32)
    for kind in ("mean_length", "length_tail"):
        assert abs(inside[kind][0] - of_noise[kind][0]) > 0.1, kind


@pytest.mark.usefixtures("as_a_user")
@pytest.mark.parametrize(
    ("shape", "times", "options", "message"),
    [
        ((4, 8, 8), [1, 2, 4, 8], {}, r"must be \[time, surface, x, y\]"),
        ((3, 4, 8, 8), [1, 2, 4, 8], {}, "with a snapshot for each time"),
        ((4, 4, 8, 8), [0, 1, 2, 4], {}, "times must be positive and ascending"),
        ((4, 4, 8, 8), [1, 2, 4, 3], {}, "times must be positive and ascending"),
        ((5, 4, 8, 8), [1, 2, 4, 8, 16], {"window": (2, 16)}, "at least 5 times must lie in the"),
        ((5, 4, 8, 8), [1, 2, 4, 8, 17], {}, "with 4 pairs in the ratio 2; got"),
        ((5, 4, 8, 8), [1, 2, 4, 8, 16], {"ratio": 3}, "must stand in the ratio 3; got"),
    ],
)
def test_misuse_says_value_rule_and_remedy(shape, times, options, message):
    heights = np.random.default_rng(0).normal(size=shape)
    with pytest.raises(ValueError, match=message):
        scale_in_time(heights, times, **options)
