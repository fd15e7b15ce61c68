"""Collapse: exponents come back from synthetic curves, with errors that cover them."""

import numpy as np
import pytest

from jaxsurf.curve import Curve
from jaxsurf.fitting.collapse import fit_collapse
from jaxsurf.fitting.collapse_forms import PRESETS, Ansatz
from jaxsurf.fitting.collapse_quality import houdayer_hartmann

D_F, TAIL = 1.3, 0.23
SIZES = (64, 128, 256, 512)


def loop_tails(seed, *, loops=400, surfaces=25, sizes=SIZES, amplitude=0.0, omega=1.0):
    """P_>(s, L) with the noise of sampled loops: each surface's tail is a sum of gamma numbers.

    Independent increments make the points of a tail correlated as those of real tails are, skewed
    where loops are few, and different from surface to surface.
    """
    rng, curves = np.random.default_rng(seed), {}
    for side in sizes:
        s = 20 * 1.1 ** np.arange(80)
        s = s[s < 2 * side**D_F]
        tail = 1.2 * s**-TAIL * np.exp(-1.2 * (s / side**D_F) ** 1.5)
        tail = tail * np.exp(amplitude * (side / sizes[0]) ** -omega)
        steps = -np.diff(tail, append=0.0)
        drawn = rng.gamma(steps * loops, 1.0, (surfaces, len(s))) / loops
        samples = np.cumsum(drawn[:, ::-1], 1)[:, ::-1]
        curves[side] = Curve("length_tail", s, samples, details=(("side", float(side)),))
    return curves


def smooth_curves(kind, function, sizes=SIZES, low=4.0, high=0.5, seed=0):
    """Curves of a known function of (x, L) with independent errors of one in a thousand."""
    rng, curves = np.random.default_rng(seed), {}
    for side in sizes:
        x = np.geomspace(low, high * side, 16)
        noise = rng.normal(1.0, 1e-3 * np.sqrt(10), (10, 16))
        curves[side] = Curve(kind, x, function(x, side) * noise)
    return curves


@pytest.fixture(scope="module")
def tails():
    return loop_tails(3)


@pytest.fixture(scope="module")
def tail_fit(tails):
    return fit_collapse(tails, draws=20)


def test_exponents_of_the_tail_come_back_jointly(tail_fit):
    assert tail_fit.converged
    assert tail_fit.names == ("D_f", "tau_minus_2")
    for name, exact in (("D_f", D_F), ("tau_minus_2", TAIL)):
        assert abs(tail_fit.values[name] - exact) < 4 * tail_fit.stderr[name]  # 1 in 15,000
        assert tail_fit.stderr[name] < 0.03  # the control: 0.1 off would be seen
    np.testing.assert_allclose(np.diag(tail_fit.covariance) ** 0.5, list(tail_fit.stderr.values()))
    assert tail_fit.covariance[0, 1] == tail_fit.covariance[1, 0] != 0.0
    assert 0.3 < tail_fit.chi2 / tail_fit.dof < 2.0  # shrinking inflates errors: below 1


def test_a_draw_is_reproducible(tails, tail_fit):
    again = fit_collapse(tails, draws=20, rng=0)
    other = fit_collapse(tails, draws=20, rng=1)
    assert again.stderr == tail_fit.stderr
    assert other.stderr != tail_fit.stderr
    assert other.values == tail_fit.values


def test_scaled_points_lie_on_the_master_curve(tail_fit):
    master, points = tail_fit.details["master"][0], tail_fit.details["collapsed"][0]
    assert sorted(points) == list(SIZES)
    for part in points.values():
        line = np.interp(np.log(part["X"]), np.log(master["X"]), np.log(master["Y"]))
        pull = (np.log(part["Y"]) - line) / (part["error"] / part["Y"])
        assert np.abs(pull).max() < 5  # 5 standard errors over some 40 points
    assert 0.05 < tail_fit.details["S"] < 3.0
    assert tail_fit.to_dict()["details"]["S"] == tail_fit.details["S"]


def test_a_correction_is_needed_and_found():
    def corrected(x, side):
        return x**1.4 * (1 + x / side) ** -0.7 * np.exp(0.3 * (side / 64) ** -1.0)

    curves = smooth_curves("mean_length", corrected)
    plain = fit_collapse(curves, draws=20, coefficients=10)
    fitted = fit_collapse(curves, correction="size", omega=1.0, draws=20, coefficients=10)
    assert abs(fitted.values["D_f"] - 1.4) < 4 * fitted.stderr["D_f"]
    assert fitted.stderr["D_f"] < 0.01
    assert abs(plain.values["D_f"] - 1.4) > 0.05  # the control: without it the answer is off
    assert plain.details["S"] > 3 * fitted.details["S"]
    assert abs(fitted.details["corrections"][0] - 0.3) < 0.03


def test_omega_can_be_fitted():
    def corrected(x, side):
        return x**1.4 * (1 + x / side) ** -0.7 * np.exp(0.8 * (side / 16) ** -0.8)

    curves = smooth_curves("mean_length", corrected, sizes=(16, 32, 64, 128, 256, 512), low=3)
    fit = fit_collapse(curves, correction="size", omega=None, draws=20, coefficients=10)
    assert fit.converged
    assert abs(fit.values["omega"] - 0.8) < 4 * fit.stderr["omega"]
    assert fit.stderr["omega"] < 0.2


def test_small_scales_have_their_own_correction():
    def corrected(x, side):
        return x**1.4 * (1 + x / side) ** -0.7 * np.exp(-0.5 * (x / 4.0) ** -1.0)

    curves = smooth_curves("mean_length", corrected)
    fit = fit_collapse(curves, correction="scale", omega=1.0, draws=20, coefficients=10)
    assert abs(fit.values["D_f"] - 1.4) < 4 * fit.stderr["D_f"]
    assert abs(fit_collapse(curves, draws=20, coefficients=10).values["D_f"] - 1.4) > 0.02


def test_measures_share_parameters_by_name_and_alpha_by_theory(tails):
    alpha = 0.4  # D_f = 1.3, tau - 2 = 0.6 / 2.6
    lengths = smooth_curves("mean_length", lambda x, side: 2 * x**1.3 * (1 + x / side) ** -0.5)
    both = fit_collapse([lengths, tails], draws=20, coefficients=10)
    assert set(both.names) == {"D_f", "tau_minus_2"}
    assert both.stderr["D_f"] < 0.005  # the sharper measure decides
    shared = fit_collapse([lengths, tails], share_alpha=True, draws=20, coefficients=10)
    assert shared.names == ("alpha",)
    assert abs(shared.values["alpha"] - alpha) < 4 * shared.stderr["alpha"]
    assert shared.stderr["alpha"] < 0.02


def test_time_in_place_of_size():
    z, alpha = 2.0, 0.6

    def grown(x, t):
        return x ** (2 * alpha) * (1 + (x / t ** (1 / z)) ** 2) ** -alpha

    curves = {
        t: Curve("height_correlation", c.scale, c.samples)
        for t, c in smooth_curves("height_correlation", grown, (100, 400, 1600), 2, 0.1).items()
    }
    fit = fit_collapse(curves, versus="time", draws=20, start={"z": 1.5})
    for name, exact in (("alpha", alpha), ("z", z)):
        assert abs(fit.values[name] - exact) < 4 * fit.stderr[name]
        assert fit.stderr[name] < 0.05
    assert fit.details["times"] == [100.0, 400.0, 1600.0]


def test_any_ansatz():
    def mine(x, y, size, p):
        return x * size ** -p["nu"], y * size ** p["beta"]

    curves = smooth_curves("mean_length", lambda x, side: side**-0.25 / (1 + x / side**0.8))
    fit = fit_collapse(curves, mine, start={"nu": 1.0, "beta": 0.0}, draws=20, coefficients=10)
    assert abs(fit.values["nu"] - 0.8) < 4 * fit.stderr["nu"]
    assert abs(fit.values["beta"] - 0.25) < 4 * fit.stderr["beta"]
    assert max(fit.stderr.values()) < 0.02


def test_an_ansatz_that_bends_y_bends_its_errors():
    def shifted(x, y, size, p):
        return x / size, (y - 1.0) * x ** -p["D_f"]

    curves = smooth_curves("mean_length", lambda x, side: 1 + x**1.3 * (1 + x / side) ** -0.5)
    fit = fit_collapse(curves, shifted, start={"D_f": 1.0}, draws=20, coefficients=10)
    assert abs(fit.values["D_f"] - 1.3) < 4 * fit.stderr["D_f"]


def test_curves_that_do_not_overlap_are_not_a_collapse():
    curves = smooth_curves("mean_length", lambda x, side: x**1.3, sizes=(64, 640))
    # the same radii at both sizes: R/L is 0.1 to 0.5 at one, 0.01 to 0.05 at the other
    fit = fit_collapse(curves, window=(6.4, 32), draws=20, coefficients=6)
    assert not fit.converged
    assert "do not overlap" in fit.status


def test_an_exponent_that_the_data_leave_open_is_said_to_be():
    two = loop_tails(1, sizes=(64, 128))
    fit = fit_collapse(two, correction="size", draws=20)
    # a factor of each size's own takes the place of any tau
    assert "undetermined: other values of tau_minus_2 fit as well" in fit.status
    assert fit.stderr["tau_minus_2"] == np.inf
    assert 0 < fit.stderr["D_f"] < 0.2  # the shift along s is still seen
    assert fit_collapse(two, draws=20).converged  # the control


def test_draws_of_one_or_two_surfaces_do_not_break_the_errors():
    curves = {side: curve.resample([0, 1, 2]) for side, curve in loop_tails(4).items()}
    # of three surfaces, 7 draws in 9 hold fewer than three different ones
    fit = fit_collapse(curves, draws=60)
    assert fit.converged
    assert fit.details["draws_failed"] == 0
    assert all(0 < error < np.inf for error in fit.stderr.values())


def test_quality_is_one_for_right_errors_and_grows_with_wrong_exponents():
    rng = np.random.default_rng(5)
    X = np.tile(np.linspace(0, 3, 40), 5)
    size = np.repeat(np.arange(5), 40)
    Y = X + 0.1 * rng.normal(size=200)
    right = houdayer_hartmann(X, Y, np.full(200, 0.1), size)
    # S is a mean of 200 correlated squares: standard deviation near sqrt(2/200) * 1.3 = 0.13
    assert abs(right - 1) < 0.5
    assert houdayer_hartmann(X, Y + 0.2 * size, np.full(200, 0.1), size) > 3
    assert houdayer_hartmann(X + 10 * size, Y, np.full(200, 0.1), size) == np.inf


def _with(curve, **change):
    parts = {"kind": curve.kind, "samples": curve.samples, "units": curve.units} | change
    return Curve(parts["kind"], curve.scale, parts["samples"], units=parts["units"])


@pytest.mark.parametrize(
    ("change", "options", "message"),
    [
        (lambda c: {64: c[64]}, {}, "at least 2 sizes; got \\[64"),
        (lambda c: c | {64: _with(c[64], units=("nm", "1"))}, {}, "must share units"),
        (lambda c: c | {64: _with(c[64], kind="mean_length")}, {}, "must share kind"),
        (lambda c: c | {64: _with(c[64], samples=0 * c[64].samples)}, {}, "at least 3 points"),
        (lambda c: c | {64: c[64].resample([0, 1])}, {}, "at least 3 surfaces"),
        (lambda c: c | {-4: c[64]}, {}, "each size must lie in \\(0, inf\\); got -4"),
        (lambda c: c, {"window": (20, 22)}, "at least 3 points"),
        (lambda c: c, {"correction": "none"}, "correction must be one of"),
        (lambda c: c, {"correction": "size", "omega": -1.0}, "omega must lie in"),
        (lambda c: c, {"versus": "temperature"}, "versus must be one of"),
        (lambda c: c, {"draws": 3}, "draws must be at least 20; got 3"),
        (lambda c: c, {"coefficients": 2}, "coefficients must be at least 6; got 2"),
        (lambda c: c, {"ansatz": lambda x, y, size, p: (x, y)}, "needs starting values"),
        (lambda c: c, {"start": {"D_f": np.nan}}, "must be finite"),
        (lambda c: {s: _with(v, kind="odd") for s, v in c.items()}, {}, "no scaling form is known"),
    ],
)
def test_misuse_says_value_rule_and_remedy(tails, change, options, message):
    with pytest.raises(ValueError, match=message):
        fit_collapse(change(tails), **options)


def test_an_ansatz_without_theory_cannot_share_alpha():
    form = Ansatz("mine", (("nu", 1.0),), lambda x, y, size, p: (x, y))
    with pytest.raises(ValueError, match="share_alpha needs an ansatz"):
        form.sharing_alpha()
    assert PRESETS["length_tail"].sharing_alpha().start == (("alpha", 0.4),)


@pytest.mark.slow
@pytest.mark.parametrize("case", ["plain", "correction"])
def test_68_percent_intervals_cover_68_percent(case):
    data = {"plain": {}, "correction": {"amplitude": 0.3}}[case]
    options = {"plain": {}, "correction": {"correction": "size", "omega": 1.0}}[case]
    pulls, sets = [], 300
    for seed in range(sets):
        fit = fit_collapse(loop_tails(seed, loops=100, **data), draws=100, rng=seed, **options)
        assert fit.converged
        exact = np.array([D_F, TAIL])
        pulls.append((np.array(list(fit.values.values())) - exact) / list(fit.stderr.values()))
    covered = (np.abs(pulls) < 1).mean(0)
    print(f"{case}: D_f {covered[0]:.3f}, tau-2 {covered[1]:.3f} of {sets}")
    # the bar: 68 +- 5 %; its own standard error over 300 sets is 2.7 %
    assert np.all(np.abs(covered - 0.68) < 0.05)
