import jax
import numpy as np
import pytest

import jaxsurf as js
from jaxsurf.analysis import fit_loops as room
from jaxsurf.analysis.fit_loops import expected_statistics, fit_loops, loop_statistics


def maps(alpha, surfaces, side=64, seed=99, law=None):
    law = law or js.SelfAffine(alpha)
    return np.asarray(js.sample(law, (side, side), key=jax.random.key(seed), batch=surfaces))


@pytest.mark.parametrize("alpha", [0.0, 0.2, 0.6])
def test_no_bias_where_the_straight_line_has_one(alpha):
    fit = fit_loops(maps(alpha, 24))
    assert fit.converged
    error = fit.total_error("alpha")
    assert abs(fit.values["alpha"] - alpha) < 4 * error
    assert error < 0.03
    # the control: D_f read off the same slope is off by many of these errors
    assert abs(3 - 2 * fit.details["slope"] - alpha) > 4 * error or alpha == 0.6  # there by chance


def test_open_maps_are_matched_to_open_maps():
    wide = maps(0.4, 24, side=128)
    crops = wide[:, :64, :64]
    fit = fit_loops(crops, boundary="open")
    assert fit.converged
    assert abs(fit.values["alpha"] - 0.4) < 4 * fit.total_error("alpha")
    # the control: as periodic maps, their cut loops make them what no periodic map is
    assert not fit_loops(crops, boundary="periodic").values["alpha"] == fit.values["alpha"]


def test_quoted_error_is_the_scatter_of_single_maps():
    heights = maps(0.4, 24)
    fits = [fit_loops(one) for one in heights]
    values = np.array([fit.values["alpha"] for fit in fits])
    # 24 values know their scatter to 15 %; the levels' phase is the same for all
    assert fits[0].stderr["alpha"] == pytest.approx(values.std(ddof=1), rel=0.6)
    together = fit_loops(heights)
    assert together.stderr["alpha"] == pytest.approx(fits[0].stderr["alpha"] / 24**0.5, rel=0.2)


@pytest.mark.parametrize("boundary", ["periodic", "open"])
@pytest.mark.parametrize("side", [64, 128, 256, 512])
def test_expectations_fall_with_alpha_at_every_shipped_size(side, boundary, tmp_path):
    expected = expected_statistics(side, boundary, cache=tmp_path)
    assert list(tmp_path.iterdir()) == []  # nothing was simulated
    alphas = np.linspace(0.0, 1.1, 30)
    found = np.array([room._polynomials(expected.mean, alpha) for alpha in alphas])
    assert np.all(np.diff(found, axis=0) < 0)
    for alpha in alphas:
        assert np.all(np.diag(expected.whitening(alpha)) > 0)


def test_whitening_undoes_the_covariance_of_the_table():
    covariance = np.array([[4.0, 1.0, 0.5], [1.0, 2.0, 0.6], [0.5, 0.6, 1.0]])
    rows = tuple(
        (a, 64.0, 1.3 - a, -a, -2 * a, *(covariance[i, j] for i, j in room.PAIRS))
        for a in room.ALPHAS
    )
    whitening = room._smooth(rows).whitening(0.4)
    np.testing.assert_allclose(whitening @ covariance @ whitening.T, np.eye(3), atol=1e-9)


def test_units_of_height_do_not_matter():
    heights = maps(0.4, 2)
    np.testing.assert_allclose(loop_statistics(1e3 * heights), loop_statistics(heights), rtol=1e-6)


def test_statistics_of_a_comb_are_known():
    # ridges of one site: every level inside makes two straight lines each, all of which wind
    comb = np.random.default_rng(0).uniform(0, 1e-6, (32, 32))  # else steps are dithered
    comb[::4] += 0.5
    assert np.isnan(loop_statistics(comb[None])).all()
    comb[2, 5] += 0.5  # one island more: its loop of 4 steps beside 16 lines of 32
    np.testing.assert_allclose(
        loop_statistics(comb[None])[0, 1:], np.log(4 / (4 + 16 * 32)), rtol=1e-6
    )


def test_other_sizes_are_simulated_once_and_cached(tmp_path, monkeypatch):
    calls = []

    def simulated(side, boundary):
        calls.append((side, boundary))
        variances = [1e-4 if i == j else 0.0 for i, j in room.PAIRS]
        return [
            dict(
                zip(
                    room.COLUMNS,
                    (boundary, side, a, 64, 1.4 - 0.3 * a, -1 - a, -0.5 - a, *variances),
                    strict=True,
                )
            )
            for a in room.ALPHAS
        ]

    monkeypatch.setattr(room, "simulate_statistics", simulated)
    for _ in range(2):
        expected = expected_statistics(40, "open", cache=tmp_path)
    assert calls == [(40, "open")]
    assert [file.name for file in tmp_path.iterdir()] == ["loop_statistics_open_40.csv"]
    np.testing.assert_allclose(room._polynomials(expected.mean, 1.0), [1.1, -2, -1.5], atol=1e-6)


def test_a_map_beyond_the_table_says_so():
    rng = np.random.default_rng(0)
    fit = fit_loops(rng.normal(size=(64, 64)))  # white noise: loops of percolation
    assert "at its bound" in fit.status
    assert not fit.converged


def test_a_map_that_is_smooth_at_a_few_sites_is_told_from_a_rough_one():
    heights = maps(0.4, 4, side=128)
    q = np.hypot(np.fft.fftfreq(128)[:, None], np.fft.rfftfreq(128)[None])
    smooth = np.fft.irfft2(np.fft.rfft2(heights) * np.exp(-((q / 0.1) ** 2)), s=(128, 128))
    fit = fit_loops(smooth)
    assert not fit.converged
    assert fit_loops(heights).converged  # the control


@pytest.mark.slow
def test_bars_of_single_maps_at_512():
    for alpha in (0.0, 0.2, 0.4, 0.6, 0.8, 1.0):
        fits = [fit_loops(maps(alpha, 1, side=512, seed=1000 + i), rng=i) for i in range(60)]
        values = np.array([fit.values["alpha"] for fit in fits])
        errors = np.array([fit.total_error("alpha") for fit in fits])
        rmse = np.sqrt(np.mean((values - alpha) ** 2))
        covered = np.mean(np.abs(values - alpha) < errors)
        print(f"{alpha}: bias {values.mean() - alpha:+.4f}, rmse {rmse:.4f}, {covered:.2f} held")
        assert abs(values.mean() - alpha) <= 0.01
        assert rmse <= (0.04 if 0.1 < alpha < 0.9 else 0.06)
        # the bar is 7 %; of 60 maps the share itself has an error of 6 %
        assert abs(covered - 0.68) < 0.07 + 2 * 0.06


@pytest.mark.parametrize(
    ("heights", "boundary", "message"),
    [
        (np.random.default_rng(0).normal(size=(64, 32)), "periodic", "needs square maps"),
        (np.random.default_rng(0).normal(size=(16, 16)), "periodic", "must be at least 32; got 16"),
        (np.random.default_rng(0).normal(size=(64, 64)), "half", "boundary must be one of"),
        (np.zeros((64, 64)), "periodic", "heights must vary"),
        (np.eye(64)[:1].repeat(64, 0), "periodic", "surfaces \\[0\\] have none"),
    ],
)
def test_misuse_says_value_rule_and_remedy(heights, boundary, message):
    with pytest.raises(ValueError, match=message):
        fit_loops(heights, boundary=boundary)
