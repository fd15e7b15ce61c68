import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxsurf as js
from jaxsurf.fitting import _whittle
from jaxsurf.fitting.likelihood import fit_likelihood

GUESS = js.SelfAffine(alpha=0.7, amplitude=1.0)
BOUND = 1.383  # sqrt(1 / (2 L^2 var ln|q|)) over the square zone: the Cramer-Rao bound times L


def maps(alpha, side, surfaces, cutoff=None, seed=0, amplitude=2.0):
    law = js.SelfAffine(alpha=alpha, amplitude=amplitude, cutoff=cutoff)
    heights = js.sample(
        law, (side, side), key=jax.random.key(seed), batch=surfaces, dtype="float64"
    )
    return np.asarray(heights)


@pytest.fixture(scope="module")
def fits():
    return fit_likelihood(maps(0.4, 64, 400), GUESS, each=True)


def column(fits, name):
    return np.array([[f.values[name], f.stderr[name]] for f in fits]).T


def test_error_is_the_cramer_rao_bound_and_is_kept(fits):
    assert all(f.converged for f in fits)
    alpha, error = column(fits, "alpha")
    rmse = np.sqrt(np.mean((alpha - 0.4) ** 2))
    # the bound on 64 x 64 modes is 1.395/L; 400 values know their rms to 3.5 %
    assert rmse < 1.1 * BOUND / 64
    np.testing.assert_allclose(error, 1.395 / 64, rtol=2e-3)  # the form is known: so is its error
    assert abs(alpha.mean() - 0.4) < 2 * rmse / 20
    assert abs(alpha.mean() - 0.41) > 2 * rmse / 20  # the control: a bias of 0.01 would show
    pull = np.abs(alpha - 0.4) / error
    # 400 intervals of 68 % cover 68 +- 2.3 %, of 95 % cover 95 +- 1.1 %
    assert 0.61 < np.mean(pull < 1) < 0.75
    assert 0.92 < np.mean(pull < 1.96) < 0.98


def test_residual_spectrum_accepts_the_law_and_rejects_another(fits):
    chi2, dof = np.mean([f.chi2 for f in fits]), fits[0].dof
    # chi2 averaged over 400 maps: dof +- sqrt(2 dof / 400) = 0.3; bins are nearly normal
    assert abs(chi2 - dof) < 1.5
    bent = maps(0.4, 64, 1, cutoff=4.0)[0]  # 200 modes flat, which the guess does not know
    assert fit_likelihood(bent, GUESS).p_value < 1e-6
    q, ratio, error = fit_likelihood(bent, GUESS).details["residual_spectrum"]
    assert ratio[0] < 1 - 3 * error[0]  # and it says where: less power than the law at long waves
    assert np.all(np.diff(q) > 0)


def test_agrees_with_a_brute_force_maximum():
    heights = maps(0.6, 32, 1)[0]
    fit = fit_likelihood(heights, GUESS)
    qx = 2 * np.pi * np.fft.fftfreq(32)
    q = np.hypot(qx[:, None], qx).ravel()[1:]
    measured = (np.abs(np.fft.fft2(heights)) ** 2 / 1024).ravel()[1:]

    def cost(alpha):
        shape = q ** (-2 - 2 * alpha)
        amplitude = np.mean(measured / shape)
        return np.sum(np.log(amplitude * shape)), amplitude

    grid = np.linspace(0.0, 1.4, 14001)
    best = grid[np.argmin([cost(alpha)[0] for alpha in grid])]
    # grid of 1e-4; the minimiser stops within 1e-3 of an error of 0.04
    assert fit.values["alpha"] == pytest.approx(best, abs=3e-4)
    assert fit.values["amplitude"] == pytest.approx(cost(best)[1], rel=3e-3)


def test_all_parameters_at_once():
    heights = maps(0.4, 256, 2, cutoff=15.3)
    heights = heights + 0.1 * np.random.default_rng(0).normal(size=heights.shape)
    truth = {"alpha": 0.4, "amplitude": 2.0, "cutoff": 15.3, "noise_floor": 0.01}
    fit = fit_likelihood(heights, js.SelfAffine(0.8, 1.0, cutoff=40.0), noise=True)
    assert fit.converged
    assert tuple(fit.values) == tuple(truth)
    pulls = np.array([(fit.values[n] - v) / fit.stderr[n] for n, v in truth.items()])
    assert np.all(np.abs(pulls) < 4), pulls
    # the control: without the noise floor the short waves tilt alpha by many errors
    without = fit_likelihood(heights, js.SelfAffine(0.8, 1.0, cutoff=15.3), fixed=("cutoff",))
    assert without.values["alpha"] < 0.4 - 5 * fit.stderr["alpha"]
    assert fit.details["maps"] == 2


def test_a_cutoff_has_the_highest_of_many_maxima_and_the_width_of_the_whole_likelihood():
    """Against the likelihood on a fine grid of cutoffs, the law known otherwise."""
    heights = maps(0.4, 48, 4, cutoff=7.3)
    law = js.SelfAffine(0.4, 2.0, cutoff=5.0)
    fits = fit_likelihood(heights, law, fixed=("alpha", "amplitude"), each=True)
    qx = 2 * np.pi * np.fft.fftfreq(48)
    q = np.hypot(qx[:, None], qx).ravel()[1:]
    logs = np.linspace(np.log(4.0), np.log(13.0), 4001)
    densities = 2.0 * np.maximum(q, np.pi * np.exp(-logs[:, None])) ** -2.8
    for one, fit in zip(heights, fits, strict=True):
        measured = (np.abs(np.fft.fft2(one)) ** 2 / 48**2).ravel()[1:]
        cost = 0.5 * np.sum(np.log(densities) + measured / densities, 1)
        weight = np.exp(cost.min() - cost) / np.sum(np.exp(cost.min() - cost))
        mean = weight @ logs
        width = np.sqrt(weight @ (logs - mean) ** 2)
        # the walk ends 3e-3 errors from the top; the steps are a sixth of an error
        assert -fit.details["log_likelihood"] < cost.min() + 1e-3
        assert fit.values["cutoff"] == pytest.approx(np.exp(logs[cost.argmin()]), rel=0.01)
        assert fit.stderr["cutoff"] / fit.values["cutoff"] == pytest.approx(width, rel=0.05)


@pytest.mark.slow
def test_all_four_intervals_cover():
    truth = {"alpha": 0.5, "amplitude": 2.0, "cutoff": 7.7, "noise_floor": 0.02}
    heights = maps(0.5, 64, 1200, cutoff=7.7, seed=3)
    heights = heights + np.sqrt(0.02) * np.random.default_rng(3).normal(size=heights.shape)
    guess = js.SelfAffine(0.8, 1.0, cutoff=12.0)
    fits = fit_likelihood(heights, guess, noise=True, each=True)
    for name, exact in truth.items():
        value, error = column(fits, name)
        # 1200 intervals of 68 % cover 68 +- 1.35 %: three of these are the bar of 4 points
        assert abs(np.mean(np.abs(value - exact) < error) - 0.6827) < 0.04, name
    # the control: without the noise floor alpha is tilted by more than its error
    value, error = column(fit_likelihood(heights[:200], guess, each=True), "alpha")
    assert np.mean(np.abs(value - 0.5) < error) < 0.3


def test_surfaces_together_know_more_than_one():
    heights = maps(0.2, 32, 9)
    together = fit_likelihood(heights, GUESS)
    alone = fit_likelihood(heights[:1], GUESS, each=True)[0]
    # the Fisher information adds up: a third of the error from nine maps
    assert together.stderr["alpha"] == pytest.approx(alone.stderr["alpha"] / 3, rel=1e-3)


def test_units_and_rectangles():
    law = js.SelfAffine(alpha=0.5, amplitude=3.0)
    heights = js.sample(law, (48, 90), key=jax.random.key(3), spacing=0.25, dtype="float64")
    fine = fit_likelihood(heights, GUESS, spacing=0.25)
    coarse = fit_likelihood(1e-9 * np.asarray(heights), GUESS)
    assert abs(fine.values["alpha"] - 0.5) < 4 * fine.stderr["alpha"]
    assert abs(fine.values["amplitude"] - 3.0) < 4 * fine.stderr["amplitude"]
    # heights in other units and lengths in sites: the same alpha, A ~ h^2 a^(-2 alpha)
    assert coarse.values["alpha"] == pytest.approx(fine.values["alpha"], abs=1e-4)
    scaled = 1e-18 * fine.values["amplitude"] * 0.25 ** (2 * fine.values["alpha"])
    assert coarse.values["amplitude"] == pytest.approx(scaled, rel=1e-3)


def test_white_noise_and_fixed_fields():
    heights = np.random.default_rng(1).normal(size=(32, 32)) * 3
    white = fit_likelihood(heights, js.WhiteNoise())
    assert white.values["amplitude"] == pytest.approx(heights.var(), rel=3e-3)  # 1/N from q = 0
    assert white.stderr["amplitude"] == pytest.approx(9 * np.sqrt(2) / 32, rel=0.2)
    held = fit_likelihood(maps(0.4, 32, 1), js.SelfAffine(0.4), fixed=("alpha",))
    assert tuple(held.values) == ("amplitude",)


def test_a_fit_at_its_bound_says_so():
    fit = fit_likelihood(maps(0.8, 32, 1)[0], js.SelfAffine(0.3), bounds={"alpha": (0.0, 0.7)})
    assert "at its bound: alpha = 0.7" in fit.status
    assert not fit.converged
    assert fit.values["alpha"] == 0.7


def test_global_settings_do_not_matter():
    heights = maps(0.4, 32, 1)[0]
    first = fit_likelihood(heights, GUESS)
    with jax.enable_x64(True):
        second = fit_likelihood(heights, GUESS)
    assert first.values == second.values
    assert jnp.zeros(()).dtype == jnp.float32


def test_one_shape_compiles_once():
    fit_likelihood(maps(0.4, 32, 1)[0], GUESS)
    before = _whittle._minimise._cached._cache_size()
    for seed in (1, 2):
        guess = js.SelfAffine(alpha=0.1 * seed, amplitude=3.0)
        fit_likelihood(maps(0.6, 32, 1, seed=seed)[0], guess)
    assert _whittle._minimise._cached._cache_size() == before


@pytest.mark.usefixtures("as_a_user")
@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"law": 0.4}, TypeError, "law must be a spectral law; got 0.4"),
        (
            {"fixed": ("beta",)},
            ValueError,
            r"fixed must name fields of the law, .*; got \['beta'\]",
        ),
        ({"fixed": ("alpha", "amplitude")}, ValueError, "something must be left to fit"),
        ({"bounds": {"cutoff": (1, 2)}}, ValueError, "bounds must name free parameters"),
        ({"bounds": {"alpha": (0.9, 0.1)}}, ValueError, "low < high; got"),
        (
            {"bounds": {"alpha": (0.0, 0.5)}},
            ValueError,
            r"starting value of alpha must lie in \[0, 0.5\]",
        ),
        ({"law": js.SelfAffine(0.5, cutoff=20.0)}, ValueError, "starting value of cutoff"),
        ({"law": js.WhiteNoise(), "noise": True}, ValueError, "cannot be told from WhiteNoise"),
        ({"boundary": "closed"}, ValueError, "boundary must be one of"),
        ({"heights": np.zeros((16, 16))}, ValueError, "heights must vary"),
        ({"heights": np.full((16, 16), np.nan)}, ValueError, "heights must be finite"),
        ({"spacing": 0.0}, ValueError, "spacing must lie in"),
        ({"boundary": "open", "surround": 1}, ValueError, "surround must be at least 2; got 1"),
        ({"boundary": "open", "heights": np.eye(8)}, ValueError, "64 pairs of valid neighbours"),
    ],
)
def test_misuse_says_value_rule_and_remedy(change, error, message):
    arguments = {"heights": maps(0.4, 16, 1)[0], "law": GUESS} | change
    with pytest.raises(error, match=message):
        fit_likelihood(**arguments)
