"""Crossover: alpha and xi come back through a knee, from one measure or several together."""

import numpy as np
import pytest

from jaxsurf import laws, theory
from jaxsurf._grid import radial_bins
from jaxsurf.curve import Curve
from jaxsurf.fitting._crossover_model import curvature_kernel
from jaxsurf.fitting.crossover import _covariance, fit_crossover

ALPHA, XI = 0.4, 16.0
SIDE = (("side", 512.0),)


def bent(v, below, beyond, knee, sharpness):
    return v**below * (1 + (v / knee) ** sharpness) ** ((beyond - below) / sharpness)


def noisy(kind, scale, mean, seed, *, surfaces=20, error=0.02, details=SIDE, units=("sites", "1")):
    """Surfaces whose curves differ by a smooth factor and by independent noise."""
    rng = np.random.default_rng(seed)
    common = rng.normal(0, error, (surfaces, 1))
    noise = rng.normal(0, error, (surfaces, len(scale)))
    return Curve(kind, scale, mean * np.exp(common + noise), details=details, units=units)


def spectrum(seed=0, *, alpha=ALPHA, xi=XI):
    q = radial_bins((512, 512)).scale
    mean = bent(np.pi / q, 2 + 2 * alpha, 0.0, xi, 8.0)
    return noisy("spectrum", q, mean, seed, units=("1/sites", "1"))


def mean_length(seed=1, *, beyond=7 / 4, knee=XI):
    R = np.unique(np.round(1.1 ** np.arange(60)))
    return noisy("mean_length", R, 2.5 * bent(R, 1.3, beyond, knee, 3.0), seed)


def length_tail(seed=2, *, knee=2.5 * XI**1.3):
    s = 5 * 1.1 ** np.arange(80)
    mean = 1.4 * bent(s, -theory.length_tail_exponent(ALPHA), -4 / 7, knee, 2.0)
    return noisy("length_tail", s, mean, seed)


def correlation(seed=3, *, knee=XI):
    r = 1.1 ** np.arange(60)
    return noisy("loop_correlation", r, 0.7 * bent(r, -1.0, -1.25, knee, 4.0), seed)


def curvature(law, seed=4, side=256):
    b = np.unique(np.round(1.25 ** np.arange(18))).astype(int)
    mean = np.asarray(laws.expected_curvature_variance(law, (side, side), b))
    details = (("order", 2), ("direction", "10"), ("side", float(side)))
    return noisy("curvature_moment", b.astype(float), mean, seed, details=details, error=0.01)


def close(fit, **exact):
    for name, value in exact.items():
        name = name.replace("__", "[") + "]" * ("__" in name)
        total = fit.total_error(name)
        assert abs(fit.values[name] - value) < 4 * total, (name, fit)
        assert total < 0.25 * value, (name, fit)  # the control: the knee is really seen


def test_the_spectrum_alone_gives_both():
    fit = fit_crossover(spectrum(), draws=20)
    assert fit.converged
    close(fit, alpha=ALPHA, xi=XI)
    close(fit, **{"sharpness__spectrum": 8.0})
    assert abs(fit.values["xi"] - 1.3 * XI) > 4 * fit.stderr["xi"]


def test_loop_measures_share_alpha_and_xi():
    fit = fit_crossover([mean_length(), length_tail(), correlation()], draws=20)
    assert fit.converged
    assert fit.names[:2] == ("alpha", "xi")
    close(fit, alpha=ALPHA, xi=XI)
    # the length at the knee is that of a loop of radius xi, by the amplitude of <s>(R)
    assert abs(fit.values["amplitude[mean_length]"] - 2.5) < 0.3


def test_each_measure_may_have_its_own_xi_and_knees_bring_them_together():
    curves = [mean_length(knee=3 * XI), correlation()]
    apart = fit_crossover(curves, shared=("alpha",), draws=20)
    close(apart, xi__mean_length=3 * XI, xi__loop_correlation=XI)
    together = fit_crossover(curves, knees={"mean_length": 3.0}, draws=20)
    close(together, xi=XI)
    assert fit_crossover(curves, draws=20).chi2 > together.chi2 + 20  # the control


def test_small_loops_have_a_correction_of_their_own():
    exact = mean_length(seed=7, knee=3 * XI)
    v = np.asarray(exact.scale)
    small = Curve(exact.kind, v, exact.samples * np.exp(0.3 * (v / 5.0) ** -1.0), details=SIDE)
    options = {"knees": {"mean_length": 3.0}, "draws": 20}
    curves = [small, spectrum()]
    fit = fit_crossover(curves, corrections={"mean_length": 1.0}, **options)
    close(fit, alpha=ALPHA, xi=XI, correction__mean_length=0.3)
    assert fit_crossover(curves, **options).chi2 > fit.chi2 + 20  # the control


def test_a_window_without_the_knee_says_nothing_about_it():
    # R is fitted over 5 to 102; the knee at 80 is beyond the lower 4/5 of that, which ends at 56
    curves = [mean_length(knee=80.0, seed=11), spectrum()]
    fit = fit_crossover(curves, shared=("alpha",), draws=20)
    assert fit.converged
    assert "xi[mean_length]" not in fit.details["variants"]["without the largest scales"]
    assert "xi[spectrum]" in fit.details["variants"]["without the largest scales"]
    assert any("without the largest scales the knee of mean_length" in note for note in fit.notes)
    assert fit.systematic["xi[mean_length]"] < 80.0  # was several times xi when it was averaged in


def test_one_wild_draw_is_not_the_error():
    draws = np.random.default_rng(0).normal(size=(200, 2))
    np.testing.assert_array_equal(_covariance(draws), np.cov(draws.T))
    draws[0, 1] = 100.0  # a variance of 50 by itself
    # half the interval of 200 normal numbers is one to 8 %
    assert abs(np.sqrt(_covariance(draws)[1, 1]) - 1.0) < 0.25
    assert np.isinf(_covariance(draws[:1])).all()


def test_a_knee_outside_its_window_is_no_result():
    fit = fit_crossover([mean_length(knee=1e4), spectrum()], shared=("alpha",), draws=20)
    assert not fit.converged
    assert "the knee of mean_length is outside the window" in fit.status


def test_exponents_beyond_the_knee_can_be_free():
    curve = mean_length(beyond=1.6, knee=8.0)
    fit = fit_crossover(curve, beyond="free", draws=20, windows={"mean_length": (1, 200)})
    close(fit, beyond__mean_length=1.6)
    assert abs(fit.values["beyond[mean_length]"] - 7 / 4) > 3 * fit.stderr["beyond[mean_length]"]


def test_the_curvature_is_the_lattice_sum_of_a_sharp_spectrum():
    law = laws.SelfAffine(ALPHA, amplitude=1.0, cutoff=XI)
    fit = fit_crossover(curvature(law), draws=20)
    close(fit, alpha=ALPHA, xi=XI)
    assert fit.stderr["alpha"] < 0.02


@pytest.mark.parametrize("direction", ["10", "11"])
def test_curvature_kernel_agrees_with_the_exact_expectation(direction):
    b = np.array([1, 3, 10])
    step = 2**0.5 if direction == "11" else 1.0
    law = laws.SelfAffine(0.6)
    exact = np.asarray(laws.expected_curvature_variance(law, (64, 64), b, direction))
    details = (("direction", direction), ("side", 64.0))
    curve = Curve("curvature_moment", b * step, np.ones((3, 3)), details=details)
    found = curvature_kernel(curve, b * step)
    assert found is not None
    log_v, kernel = found
    summed = kernel @ (np.exp(log_v) / np.pi) ** 3.2
    # rings 1 % wide: S = q^-3.2 varies by 3.2 % across one, and only its uneven part counts
    np.testing.assert_allclose(summed, exact, rtol=1e-3)


def test_no_lattice_known_means_a_knee_of_its_own():
    b = 1.25 ** np.arange(22)
    curve = noisy("curvature_moment", b, bent(b, 0.8, 0.0, XI, 3.0), 5, details=())
    fit = fit_crossover(curve, draws=20)
    close(fit, alpha=ALPHA, xi=XI)


@pytest.mark.parametrize(
    ("curves", "options", "message"),
    [
        (lambda: [mean_length(), mean_length()], {}, "must be of different kinds"),
        (lambda: Curve("odd", [1.0, 2.0], np.ones((5, 2))), {}, "no crossover is known for"),
        (lambda: [spectrum().resample([0, 1])], {}, "at least 3 surfaces"),
        (
            lambda: [
                mean_length(),
                noisy("loop_correlation", np.arange(1.0, 20), 1, 0, units=("nm", "1")),
            ],
            {},
            "must share the unit of length",
        ),
        (lambda: mean_length(), {"windows": {"mean_length": (10, 12)}}, "at least 3 points"),
        (lambda: mean_length(), {"beyond": "flat"}, "beyond must be one of"),
        (lambda: mean_length(), {"shared": ("tau",)}, "each of shared must be one of"),
        (lambda: mean_length(), {"sharpness": 0.0}, "sharpness must lie in"),
        (
            lambda: mean_length(),
            {"corrections": {"mean_length": 0}},
            "correction exponent of mean_length",
        ),
        (lambda: mean_length(), {"knees": {"mean_length": -1}}, "the knee ratio of mean_length"),
        (lambda: mean_length(), {"start": {"xi": 0}}, "start of xi must lie in"),
        (lambda: mean_length(), {"draws": 1}, "draws must be at least 20"),
    ],
)
def test_misuse_says_value_rule_and_remedy(curves, options, message):
    with pytest.raises(ValueError, match=message):
        fit_crossover(curves(), **options)
