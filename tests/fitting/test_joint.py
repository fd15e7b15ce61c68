"""Joint fit: the combination of least variance, and whether measures agree."""

import numpy as np
import pytest

from jaxsurf import theory
from jaxsurf.curve import Curve
from jaxsurf.fitting.joint import combine, fit_joint

ALPHA = 0.4
SLOPES = {
    "spectrum": -2 * (1 + ALPHA),
    "curvature_moment": 2 * ALPHA,
    "mean_length": theory.fractal_dimension(ALPHA),
    "length_tail": -theory.length_tail_exponent(ALPHA),
}
WINDOWS = dict.fromkeys(SLOPES, (1, 100))


def curves(seed, *, off=0.0, surfaces=40, error=0.05):
    """Straight lines whose slopes go up and down together from surface to surface."""
    rng = np.random.default_rng(seed)
    x = np.geomspace(1, 100, 15)
    tilt = rng.normal(0, 0.02, surfaces)
    made = []
    for kind, slope in SLOPES.items():
        own = slope + (off if kind == "mean_length" else 0.0) + np.sign(slope) * tilt
        noise = rng.normal(0, error, (surfaces, len(x)))
        # the mean of exp(tilt ln x) is not exp(0): taken off, or the measures would really disagree
        rise = (0.02 * np.log(x)) ** 2 / 2
        samples = np.exp(own[:, None] * np.log(x) + noise - rise)
        made.append(Curve(kind, x, samples, details=(("order", 2),)))
    return made


def test_combination_against_hand_computed_values():
    # two independent estimates 1 and 3 with errors 1 and 2: weights 4/5 and 1/5
    found = combine(np.array([1.0, 3.0]), np.diag([1.0, 4.0]), np.zeros(2))
    np.testing.assert_allclose(found["weights"], [0.8, 0.2], rtol=1e-5)
    np.testing.assert_allclose(found["value"], 1.4, rtol=1e-5)
    np.testing.assert_allclose(found["stderr"], np.sqrt(0.8), rtol=1e-5)
    np.testing.assert_allclose(found["chi2"], 4 / 5, rtol=1e-5)
    # systematic errors take part in the weights and stay apart in the result
    wider = combine(np.array([1.0, 3.0]), np.diag([1.0, 4.0]), np.array([np.sqrt(3.0), 0.0]))
    np.testing.assert_allclose(wider["weights"], [0.5, 0.5], rtol=1e-5)
    np.testing.assert_allclose(wider["chi2"], 4 / 8, rtol=1e-5)
    np.testing.assert_allclose(wider["systematic"], np.sqrt(3) / 2, rtol=1e-5)


def test_measures_that_agree():
    fit = fit_joint(curves(0), windows=WINDOWS)
    assert fit.converged
    assert fit.names == ("alpha", *(f"alpha[{kind}]" for kind in SLOPES))
    assert abs(fit.values["alpha"] - ALPHA) < 4 * fit.total_error("alpha")
    assert fit.stderr["alpha"] < 0.02
    assert fit.dof == 3
    assert fit.p_value > 1e-3
    # surfaces tilt all measures: alpha from <s> falls as alpha from the curvature rises
    i, j = fit.names.index("alpha[curvature_moment]"), fit.names.index("alpha[mean_length]")
    assert fit.covariance[i, j] < -0.3 * fit.stderr[fit.names[i]] * fit.stderr[fit.names[j]]
    assert sum(fit.details["weights"]["alpha"].values()) == pytest.approx(1.0)


def test_a_measure_that_disagrees_is_seen():
    fit = fit_joint(curves(0, off=0.15), windows=WINDOWS)
    assert fit.details["chi2_statistical"]["alpha"] > 30
    assert fit.p_value < 0.01


def test_consistency_chi2_follows_its_distribution():
    # 30 ensembles: the mean of chi2(3) has standard error sqrt(6/30) = 0.45
    found = [
        fit_joint(curves(seed), windows=WINDOWS, rng=seed).details["chi2_statistical"]["alpha"]
        for seed in range(30)
    ]
    assert abs(np.mean(found) - 3.0) < 4 * 0.45


def test_through_the_knee_alpha_and_xi_together():
    rng = np.random.default_rng(3)
    x = 1.1 ** np.arange(50)
    factors = np.exp(rng.normal(0, 0.02, (30, 1)))
    made = []
    for kind, below in (("height_correlation", 0.8), ("patch_moment", 0.8)):
        mean = x**below * (1 + (x / 12) ** 3) ** (-below / 3)
        noise = np.exp(rng.normal(0, 0.02, (30, len(x))))
        made.append(Curve(kind, x, mean * factors * noise))
    fit = fit_joint(made, through="crossover", draws=50)
    assert fit.converged
    for name, exact in (("alpha", 0.4), ("xi", 12.0)):
        assert abs(fit.values[name] - exact) < 4 * fit.total_error(name)
        assert fit.total_error(name) < 0.1 * exact
    assert fit.dof == 2


@pytest.mark.slow
def test_heights_and_loops_of_one_gaussian_ensemble_agree():
    import jax

    import jaxsurf as js

    def measured(alpha, seed):
        heights = js.sample(js.SelfAffine(alpha), (512, 512), key=jax.random.key(seed), batch=25)
        loops = js.level_loops(np.asarray(heights), 32, rng=seed)
        spectrum, curvature = js.power_spectrum(heights), js.curvature_moment(heights)
        return [spectrum, curvature], [loops.mean_length(), loops.length_tail()]

    of_heights, of_loops = measured(0.4, 0)
    fit = fit_joint([*of_heights, *of_loops])
    print(fit, fit.details["chi2_statistical"])
    assert fit.converged
    assert abs(fit.values["alpha"] - 0.4) < 2 * fit.total_error("alpha")
    assert fit.total_error("alpha") < 0.03
    assert fit.p_value > 0.01
    # the control: loops of other surfaces, of alpha = 0.8, are seen not to belong to these heights
    other = fit_joint([*of_heights, *measured(0.8, 1)[1]])
    print(other)
    assert other.p_value < 0.01


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (lambda c: c[:1], "at least two curves; got 1"),
        (lambda c: [c[0], c[0]], "must be of different kinds"),
        (lambda c: [c[0], Curve("loop_correlation", c[0].scale, c[0].samples)], "carries no alpha"),
        (lambda c: [c[0], c[1].resample(range(10))], "must be of the same surfaces"),
        (lambda c: [c[0].resample([0, 1]), c[1].resample([0, 1])], "needs at least 5 surfaces"),
    ],
)
def test_misuse_says_value_rule_and_remedy(given, message):
    with pytest.raises(ValueError, match=message):
        fit_joint(given(curves(0)))
