"""Scaling in time: linear growth, whose exponents are exact, must come out; then misuse."""

import jax
import numpy as np
import pytest

import jaxsurf as js
from jaxsurf.analysis.time_scaling import loops_in_time, scale_in_time, width_in_time

TIMES = {"edwards-wilkinson": 2.0 ** np.arange(2, 9), "mullins-herring": 4.0 ** np.arange(2, 8)}
EXACT = {"edwards-wilkinson": (0.0, 2.0), "mullins-herring": (1.0, 4.0)}
COEFFICIENT = {"edwards-wilkinson": 0.25, "mullins-herring": 0.1}


def grown(equation):
    times = TIMES[equation]
    return js.grow_linear(
        (96, 96),
        equation=equation,
        time=float(times[-1]),
        snapshots=times,
        batch=12,
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
    result = scale_in_time(
        grown(equation), TIMES[equation], draws=20, progress=lambda share, text: said.append(share)
    )
    found = result.exponents
    assert result.collapse.converged
    for name, exact in (("alpha", alpha), ("z", z), ("beta", alpha / z)):
        value, *errors = found[name]
        # 4 errors, each known to 20 % from 12 surfaces and 20 draws
        assert abs(value - exact) < 4 * np.hypot(*errors), name
    # the controls: the other equation's exponents would fail the same bound
    other = EXACT["mullins-herring" if alpha == 0 else "edwards-wilkinson"]
    assert abs(found["alpha"][0] - other[0]) > 4 * np.hypot(*found["alpha"][1:])
    assert abs(found["z"][0] - other[1]) > 4 * np.hypot(*found["z"][1:])
    assert said[0] == 0.0
    assert said[-1] == 1.0
    assert said == sorted(said)
    if equation == "mullins-herring":  # the width is a pure power, w^2 ~ t^(1/2)
        value, statistical, _ = found["beta of the width"]
        assert abs(value - 0.25) < 4 * statistical
        assert statistical < 0.01
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
    windows = {"mean_length": (10, 64), "length_tail": (60, 1500), "loop_correlation": (10, 64)}
    exact = {"mean_length": 7 / 4, "length_tail": -4 / 7, "loop_correlation": -5 / 4}
    for kind, window in windows.items():
        young = js.fit_power_law(early[kind], window=window, weighting="equal", draws=50)
        old = js.fit_power_law(late[kind], window=window, weighting="equal", draws=50)
        # xi = 0.5, and R starts at 20 xi, where the correction R^(-3/4) is below a tenth
        assert (
            abs(young.values["exponent"] - exact[kind]) < 4 * young.total_error("exponent") + 0.03
        )
        # the control: once xi = 45, the loops are those of alpha = 0, D_f = 3/2, 1/3 and 1
        assert abs(old.values["exponent"] - exact[kind]) > 4 * old.stderr["exponent"], kind


@pytest.mark.usefixtures("as_a_user")
@pytest.mark.parametrize(
    ("shape", "times", "options", "message"),
    [
        ((4, 8, 8), [1, 2, 4, 8], {}, r"must be \[time, surface, x, y\]"),
        ((3, 4, 8, 8), [1, 2, 4, 8], {}, "with a snapshot for each time"),
        ((4, 4, 8, 8), [0, 1, 2, 4], {}, "times must be positive and ascending"),
        ((4, 4, 8, 8), [1, 2, 4, 3], {}, "times must be positive and ascending"),
        ((4, 4, 8, 8), [1, 2, 4, 8], {"window": (2, 8)}, "at least 4 times must lie in the window"),
    ],
)
def test_misuse_says_value_rule_and_remedy(shape, times, options, message):
    heights = np.random.default_rng(0).normal(size=shape)
    with pytest.raises(ValueError, match=message):
        scale_in_time(heights, times, **options)
