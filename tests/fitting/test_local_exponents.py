import numpy as np
import pytest

from jaxsurf.curve import Curve
from jaxsurf.fitting.local_exponents import local_exponents

SHARES = np.geomspace(0.01, 0.6, 40)


def curve_of(size, exponent, factors=(1.0,) * 4, kind="mean_length"):
    """y = L^p f(x/L) with a master curve that is no power law, times a factor of each surface."""
    master = SHARES**1.1 * np.exp(-((2 * SHARES) ** 2))
    samples = size**exponent * np.outer(factors, master)
    return Curve(kind, size * SHARES, samples, np.ones_like(samples), units=("sites", "sites"))


@pytest.mark.parametrize("exponent", [-1.0, 0.0, 1.3])
def test_the_master_curve_drops_out(exponent):
    steps = local_exponents({size: curve_of(size, exponent) for size in (512, 64, 256)})
    assert [step.sizes for step in steps] == [(64.0, 256.0), (256.0, 512.0)]
    for step in steps:
        assert step.value == pytest.approx(exponent, abs=1e-10)  # float64 arithmetic alone
        assert step.error == pytest.approx(0.0, abs=1e-12)


def test_a_correction_to_scaling_shows_as_a_drift():
    def corrected(size):
        curve = curve_of(size, 1.3)
        samples = np.asarray(curve.samples) * (1 - size**-0.8)
        return Curve("mean_length", curve.scale, samples, np.ones_like(samples), units=curve.units)

    sizes = (64, 128, 256)
    steps = local_exponents({size: corrected(size) for size in sizes})
    drift = np.diff(np.log1p(-(np.array(sizes, float) ** -0.8))) / np.log(2)
    assert [step.value - 1.3 for step in steps] == pytest.approx(list(drift), abs=1e-10)


def test_errors_are_the_scatter_over_ensembles():
    rng = np.random.default_rng(4)
    found = [
        local_exponents(
            {size: curve_of(size, 1.0, 1 + 0.1 * rng.normal(size=30)) for size in (64, 128)}
        )[0]
        for _ in range(300)
    ]
    pulls = np.array([(step.value - 1.0) / step.error for step in found])
    # 300 pulls: their spread is known to 4 %, their mean to 0.06; 4 standard errors of each
    assert pulls.std() == pytest.approx(1.0, abs=0.16)
    assert abs(pulls.mean()) < 0.24
    wrong = np.array([(step.value - 1.05) / step.error for step in found])
    assert abs(wrong.mean()) > 0.24  # the control: an exponent off by 0.05 would be seen


@pytest.mark.parametrize(
    ("curves", "shares", "message"),
    [
        ({64: curve_of(64, 1.0)}, (0.05, 0.3), "at least 2 sizes; got"),
        ({64: curve_of(64, 1.0), 128: curve_of(128, 1.0)}, (0.3, 0.1), "0 < low < high"),
        ({64: curve_of(64, 1.0), 128: curve_of(128, 1.0)}, (0.7, 0.9), "needs two positive points"),
    ],
)
def test_misuse_says_value_rule_and_remedy(curves, shares, message):
    with pytest.raises(ValueError, match=message):
        local_exponents(curves, shares=shares)
