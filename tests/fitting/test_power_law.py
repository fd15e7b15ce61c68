import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jaxsurf.curve import Curve
from jaxsurf.fitting import _least_squares
from jaxsurf.fitting.power_law import fit_power_law

SCALE = np.geomspace(1.0, 100.0, 21)
EVERYTHING = (1.0, 100.0)


def curve_of(log_samples, kind="mean_length", weights=None, **details):
    return Curve(kind, SCALE, np.exp(log_samples), weights, details=tuple(details.items()))


def tilted(surfaces=25, seed=0, spread=0.05, exponent=1.3):
    """Each surface an exact power law of its own exponent: the points are fully correlated."""
    slopes = exponent + spread * np.random.default_rng(seed).normal(size=(surfaces, 1))
    return curve_of(np.log(3.0) + slopes * np.log(SCALE)), slopes[:, 0]


@given(exponent=st.floats(-4, 4), log_amplitude=st.floats(-5, 5), surfaces=st.integers(1, 5))
@settings(max_examples=20, deadline=None, derandomize=True)
def test_exact_power_law(exponent, log_amplitude, surfaces):
    line = exponent * np.log(SCALE) + log_amplitude
    fit = fit_power_law(curve_of(np.tile(line, (surfaces, 1))), window=EVERYTHING)
    # solver tolerance 1e-10 on values of order one, times the lever arm ln 100
    assert fit.values["exponent"] == pytest.approx(exponent, abs=1e-8)
    assert np.log(fit.values["amplitude"]) == pytest.approx(log_amplitude, abs=1e-8)
    assert fit.converged
    assert fit.stderr["exponent"] < 1e-8
    assert fit.systematic["exponent"] < 1e-8


def test_a_common_factor_moves_the_amplitude_and_not_the_exponent():
    rng = np.random.default_rng(1)
    factors = 0.1 * rng.normal(size=(40, 1))
    fit = fit_power_law(curve_of(1.3 * np.log(SCALE) + factors), window=EVERYTHING, draws=2000)
    assert fit.stderr["exponent"] < 1e-8
    expected = fit.values["amplitude"] * np.exp(factors).std(ddof=1) / np.exp(factors).mean()
    # 2000 draws give a standard error to 1.6 %; 5 of these
    assert fit.stderr["amplitude"] == pytest.approx(expected / np.sqrt(40), rel=0.08)


def test_error_is_the_scatter_of_the_surfaces_own_exponents():
    curve, slopes = tilted(spread=0.01)
    fit = fit_power_law(curve, window=EVERYTHING, draws=2000)
    expected = slopes.std(ddof=1) / 5
    # 1.6 % from the draws (times 5); log of a mean against mean of logs: of order the spread^2
    assert fit.stderr["exponent"] == pytest.approx(expected, rel=0.09)
    # the control: points taken as independent, with the same scatter, would say far less
    scatter = np.log(curve.samples).std(0, ddof=1) / 5
    weight = 1 / np.maximum(scatter, scatter.max() / 100) ** 2
    x = np.log(SCALE) - (weight * np.log(SCALE)).sum() / weight.sum()
    assert (weight * x**2).sum() ** -0.5 < 0.7 * expected


def test_covariance_holds_both_parameters():
    curve, _ = tilted(spread=0.01)
    fit = fit_power_law(curve, window=(10, 100), draws=400)
    np.testing.assert_allclose(
        np.sqrt(np.diag(fit.covariance)), [fit.stderr["exponent"], fit.stderr["amplitude"]]
    )
    # all surfaces agree at x = 1, so the amplitude is known far better than x = 10 ... 100 alone
    # would tell, had its draws not gone together with the exponent's
    assert fit.stderr["amplitude"] < 0.1 * fit.stderr["exponent"] * np.log(10) * 3


def test_sub_windows_show_a_drifting_slope():
    x = np.log(SCALE)
    bent = 1.2 * x + 0.02 * x**2
    fit = fit_power_law(curve_of(np.tile(bent, (4, 1))), window=EVERYTHING, weighting="equal")
    half = x[:11]
    drift = np.polyfit(x, bent, 1)[0] - np.polyfit(half, 1.2 * half + 0.02 * half**2, 1)[0]
    assert drift == pytest.approx(0.02 * np.log(100) / 2)  # half of the slope's change, 0.046
    # the halves are the farthest apart of the sub-windows, and lie symmetrically
    assert fit.systematic["exponent"] == pytest.approx(drift, rel=1e-6)
    assert fit.stderr["exponent"] < 1e-8
    assert fit.details["misfit"] is None


def test_spread_over_sub_windows_is_steady_and_bounds_scatter_without_drift():
    rng = np.random.default_rng(5)
    systematic, statistical = [], []
    for _ in range(30):
        noise = 0.3 * rng.normal(size=(20, 21))
        fit = fit_power_law(curve_of(1.3 * np.log(SCALE) + noise), window=EVERYTHING, draws=100)
        systematic.append(fit.systematic["exponent"])
        statistical.append(fit.stderr["exponent"])
    # half the points and half the arm: each half scatters by sqrt(8) statistical errors, less what
    # it shares with the whole, and the largest of five is some 2.5
    assert 1.5 < np.mean(systematic) / np.mean(statistical) < 4
    assert np.std(systematic) < 0.7 * np.mean(systematic)
    assert min(systematic) > 0


def test_coverage_with_correlated_points():
    rng = np.random.default_rng(11)
    walk = np.tril(np.ones((21, 21))) * 0.05  # a random walk along the curve: strongly correlated
    pulls = []
    for _ in range(60):
        noise = rng.normal(size=(25, 21)) @ walk.T
        fit = fit_power_law(curve_of(1.3 * np.log(SCALE) + noise), window=EVERYTHING, draws=100)
        pulls.append((fit.values["exponent"] - 1.3) / fit.stderr["exponent"])
    # the rms of 60 pulls is known to 9 %, and 25 surfaces give each error to 14 %: 1 +- 4 x 0.1
    assert 0.65 < np.sqrt(np.mean(np.square(pulls))) < 1.4


def test_misfit_equalises_the_weights_where_the_line_does_not_fit():
    x = np.log(SCALE)
    rng = np.random.default_rng(2)
    bent = 1.2 * x + 0.05 * x**2 + np.geomspace(1e-3, 1e-1, 21) * rng.normal(size=(50, 21))
    fit = fit_power_law(curve_of(bent), window=EVERYTHING)
    plain = fit_power_law(curve_of(bent), window=EVERYTHING, weighting="equal")
    # the points scatter by 0.06 about the best line, their errors are 1e-4 to 1e-2
    assert 0.03 < fit.details["misfit"] < 0.1
    assert fit.values["exponent"] == pytest.approx(plain.values["exponent"], abs=0.01)
    assert fit.values["exponent"] > 1.2 + 0.05 * 2  # pure 1/sigma^2 would stay near the lower end


def test_chi2_accepts_a_line_and_rejects_a_kink():
    rng = np.random.default_rng(7)
    walk = np.tril(np.ones((21, 21))) * 0.02
    line, kink = [], []
    for _ in range(20):
        samples = 1.3 * np.log(SCALE) + rng.normal(size=(200, 21)) @ walk.T
        line.append(fit_power_law(curve_of(samples), window=EVERYTHING, draws=20).chi2)
        samples[:, 10:] += 0.012
        kink.append(fit_power_law(curve_of(samples), window=EVERYTHING, draws=20).chi2)
    # chi2 of 19 degrees of freedom averaged over 20 sets: 19 +- 1.4; the covariance of 200 surfaces
    # inflates it by 200/(200 - 21); 5 standard errors
    assert 12 < np.mean(line) < 28
    assert np.mean(kink) > 60  # the kink of 0.012 is 8 errors of one step


def test_weights_enter_as_a_ratio():
    rng = np.random.default_rng(3)
    weights = rng.integers(0, 5, size=(8, 21)).astype(float)
    samples = 1.3 * np.log(SCALE) + 0.1 * rng.normal(size=(8, 21))
    curve = curve_of(samples, weights=weights)
    fit = fit_power_law(curve, window=EVERYTHING, weighting="equal")
    exact = np.polyfit(np.log(SCALE), np.log(curve.mean), 1)[0]
    assert fit.values["exponent"] == pytest.approx(exact, abs=1e-9)
    # replicate the draws by hand
    draws = np.random.default_rng(0).multinomial(8, np.full(8, 1 / 8), size=200)
    slopes = []
    for counts in draws:
        drawn = curve.resample(np.repeat(np.arange(8), counts)).present()
        slopes.append(np.polyfit(np.log(drawn.scale), np.log(drawn.mean), 1)[0])
    expected = np.std(slopes, ddof=1) * np.sqrt(8 / 7)
    assert fit.stderr["exponent"] == pytest.approx(expected, rel=1e-6)


def test_missing_scales_are_left_out():
    weights = np.ones((5, 21))
    weights[:, [3, 9]] = 0.0
    samples = np.tile(2 * np.log(SCALE), (5, 1))
    samples[:, [3, 9]] = 50.0
    fit = fit_power_law(curve_of(samples, weights=weights), window=EVERYTHING)
    assert fit.values["exponent"] == pytest.approx(2.0, abs=1e-8)
    assert fit.details["points"] == 19


def test_one_surface_says_that_its_error_is_a_lower_bound():
    rng = np.random.default_rng(4)
    fit = fit_power_law(
        curve_of(1.3 * np.log(SCALE) + 0.1 * rng.normal(size=(1, 21))), window=EVERYTHING
    )
    x = np.log(SCALE) - np.log(SCALE).mean()
    # independent scatter of 0.1: the textbook error, estimated from 21 points
    assert fit.stderr["exponent"] == pytest.approx(0.1 / np.sqrt((x**2).sum()), rel=0.6)
    assert fit.stderr["exponent"] > 0
    assert "one surface" in repr(fit)
    assert "lower bound" in repr(fit)
    assert fit.dof == 0
    assert fit.p_value == 1.0


def test_global_settings_and_array_kind_do_not_matter():
    curve, _ = tilted()
    single = Curve("mean_length", jnp.asarray(SCALE), jnp.asarray(curve.samples))
    rounded = Curve("mean_length", np.asarray(single.scale), np.asarray(single.samples))
    fits = [fit_power_law(rounded, window=EVERYTHING), fit_power_law(single, window=EVERYTHING)]
    with jax.enable_x64(True):
        fits.append(fit_power_law(rounded, window=EVERYTHING))
    for fit in fits[1:]:  # float64 throughout, though a different order of summation may round
        assert fit.values["exponent"] == pytest.approx(fits[0].values["exponent"], rel=1e-12)
        assert fit.stderr["exponent"] == pytest.approx(fits[0].stderr["exponent"], rel=1e-9)
    assert jnp.zeros(()).dtype == jnp.float32  # and the caller's setting is as it was


def test_seed_makes_the_errors():
    curve, _ = tilted()
    first, again, other = (fit_power_law(curve, window=EVERYTHING, rng=r) for r in (1, 1, 2))
    assert first.stderr == again.stderr
    assert first.values == other.values
    assert first.stderr != other.stderr


def test_many_fits_compile_little():
    _least_squares._solve_all.clear_cache()
    for points in (21, 19, 15, 9):
        curve, _ = tilted(seed=points)
        fit_power_law(curve, window=(1.0, SCALE[points - 1] * 1.01))
    assert _least_squares._solve_all._cache_size() == 1


@pytest.mark.parametrize(
    ("kind", "scale", "expected"),
    [
        ("mean_length", np.arange(1.0, 512), (10, 102.4)),  # the paper's window
        ("curvature_moment", np.arange(1.0, 128), (4, 64)),
        ("spectrum", 2 * np.pi / 512 * np.arange(1, 257), (4 * np.pi / 512, np.pi / 4)),
        ("height_correlation", np.arange(1.0, 128), (4, 64)),
    ],
)
def test_default_window_is_reported(kind, scale, expected):
    samples = np.tile(scale**1.5, (3, 1))
    fit = fit_power_law(Curve(kind, scale, samples, details=(("side", 512.0),)))
    np.testing.assert_allclose(fit.details["window"], expected, rtol=1e-6)
    assert fit.details["window_from"] == "default"
    small = fit_power_law(Curve(kind, scale, samples, details=(("side", 40.0),)))
    low, high = small.details["window"]
    assert high / low > 3.9  # on a small map the lower end gives way
    assert high < expected[1] or kind == "spectrum"


def test_default_window_is_in_the_unit_of_the_scale():
    scale = 0.5 * np.arange(1.0, 128)
    curve = Curve(
        "curvature_moment",
        scale,
        np.tile(scale, (3, 1)),
        units=("nm", "nm^2"),
        details=(("side", 256.0),),
    )
    np.testing.assert_allclose(fit_power_law(curve).details["window"], (2, 32))


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        (
            {"window": (3.0, 3.1)},
            ValueError,
            "needs at least 4 points in its window; got 0 in window",
        ),
        ({"window": (30.0, 3.0)}, ValueError, "low < high; got"),
        ({"window": 3.0}, TypeError, r"window must be \(low, high\); got 3.0"),
        ({"draws": 3}, ValueError, "draws must be at least 20; got 3"),
        ({"weighting": "best"}, ValueError, "weighting must be one of"),
        ({"curve": np.ones(5)}, TypeError, "curve must be a Curve; got ndarray"),
        (
            {"curve": Curve("spectrum", SCALE, np.zeros((3, 21)))},
            ValueError,
            "needs positive means",
        ),
        (
            {"curve": Curve("spectrum", SCALE, np.full((3, 21), np.nan))},
            ValueError,
            "must be finite to be fitted",
        ),
        (
            {"curve": Curve("spectrum", SCALE, np.ones((3, 21)), np.zeros((3, 21)))},
            ValueError,
            "of 0 points at nowhere",
        ),
        (
            {"curve": Curve("spectrum", np.ones((2, 21)), np.ones((2, 3, 21)))},
            TypeError,
            "one curve; got a stack",
        ),
    ],
)
@pytest.mark.usefixtures("as_a_user")
def test_misuse_says_value_rule_and_remedy(change, error, message):
    arguments = {"curve": tilted()[0], "window": EVERYTHING} | change
    with pytest.raises(error, match=message):
        fit_power_law(**arguments)


def test_draws_that_lack_points_are_left_out_and_too_many_fail_openly():
    weights = np.zeros((6, 21))
    weights[:, :3] = 1.0
    line = np.tile(np.log(SCALE), (6, 1))
    weights[0] = 1.0  # one surface alone carries the upper scales: (5/6)^6 = 33 % of draws lack it
    fit = fit_power_law(curve_of(line, weights=weights), window=EVERYTHING)
    assert 110 < fit.details["draws"] < 160
    assert fit.converged
    weights[0, :11] = 0.0  # and now another carries the lower half alone
    weights[2:] = 0.0
    fit = fit_power_law(curve_of(line, weights=weights), window=EVERYTHING)
    assert "bootstrap draws" in fit.status  # both must be drawn: 1 - 2 (5/6)^6 + (4/6)^6 = 42 %
    assert not fit.converged
