import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxsurf.fitting import _least_squares
from jaxsurf.fitting._least_squares import least_squares, solve, solve_many

TIMES = np.linspace(0.0, 3.0, 20)


def decay(parameters, data):
    times, values = data
    return values - parameters["height"] * jnp.exp(-parameters["rate"] * times)


def no_minimum(parameters, data):
    return jnp.exp(-parameters) * jnp.ones(3) + 0 * data


START = {"height": 1.0, "rate": 1.0}


def test_recovers_an_exact_decay_in_float64_whatever_the_input():
    values = (2.5 * np.exp(-0.7 * TIMES)).astype(np.float32)
    found = solve(decay, START, (TIMES, values))
    assert found.status == "converged"
    assert found.values["rate"].dtype == np.float64
    # float32 data are exact to 6e-8; float32 arithmetic in the solver would leave about 1e-5
    np.testing.assert_allclose(
        [found.values["height"], found.values["rate"]], [2.5, 0.7], rtol=2e-7
    )


def test_many_problems_agree_with_one_at_a_time():
    rng = np.random.default_rng(3)
    values = 2 * np.exp(-TIMES) + 0.1 * rng.normal(size=(5, 20))
    start = {name: np.ones(5) for name in START}
    together = solve_many(decay, start, (TIMES, values), axes=(None, 0))
    alone = [solve(decay, START, (TIMES, row)).values["rate"] for row in values]
    np.testing.assert_allclose(together.values["rate"], alone, rtol=1e-8)  # solver tolerance 1e-10
    assert together.success.all()


def test_values_are_differentiable_in_the_data():
    def rate(values):
        start = jax.tree.map(jnp.asarray, START)
        return least_squares(decay, start, (jnp.asarray(TIMES), values)).values["rate"]

    with jax.enable_x64(True):
        rng = np.random.default_rng(0)
        values = jnp.asarray(2 * np.exp(-TIMES) + 0.1 * rng.normal(size=20))
        gradient, step = jax.grad(rate)(values), 1e-5
        for point in (0, 7):
            shift = jnp.zeros(20).at[point].set(step)
            slope = (rate(values + shift) - rate(values - shift)) / (2 * step)
            # truncation 1e-10, solver tolerance 1e-10 over a step of 1e-5
            np.testing.assert_allclose(gradient[point], slope, rtol=1e-3, atol=3e-5)
        assert abs(gradient[0]) > 1e-2  # the control: the tolerance could tell it from zero


def test_equal_shapes_compile_once():
    _least_squares._solve_one.clear_cache()
    for seed in range(4):
        solve(decay, START, (TIMES, np.random.default_rng(seed).normal(size=20)))
    assert _least_squares._solve_one._cache_size() == 1
    solve(decay, START, (TIMES[:10], np.ones(10)))
    assert _least_squares._solve_one._cache_size() == 2  # the control: another shape does compile


def test_failures_never_look_like_success():
    broken = solve(decay, START, (TIMES, np.full(20, np.nan)))
    assert not broken.success
    assert "infinite or NaN" in broken.status
    endless = solve(no_minimum, 0.0, 0.0, steps=5)
    assert not endless.success
    assert "not converged after" in endless.status


def test_start_must_be_finite():
    with pytest.raises(ValueError, match="starting values must be finite"):
        solve(decay, START | {"rate": np.nan}, (TIMES, TIMES))
