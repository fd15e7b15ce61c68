import jax
import numpy as np
import pytest

import jaxsurf as js
from jaxsurf.fitting._debiased import observe
from jaxsurf.fitting.likelihood import fit_likelihood

LAW = js.SelfAffine(alpha=0.5, amplitude=2.0, cutoff=4.0)
GUESS = js.SelfAffine(alpha=0.2, amplitude=1.0, cutoff=6.0)
SIDE = 32


def crops(surfaces, seed=0, law=LAW):
    key = jax.random.key(seed)
    wide = js.sample(law, (4 * SIDE, 4 * SIDE), key=key, batch=surfaces, dtype="float64")
    return np.asarray(wide)[:, :SIDE, :SIDE]


def with_holes():
    x, y = np.mgrid[:SIDE, :SIDE]
    return (np.hypot(x - 8, y - 20) > 4) & (np.hypot(x - 25, y - 6) > 4)


def expected(data, law):
    with jax.enable_x64(True), jax.numpy_dtype_promotion("standard"):  # as `fit_likelihood` does
        return np.asarray(data.observer.expected(law))


def test_expected_periodogram_is_exact():
    """Against the dense covariance matrix of a small map, site by site."""
    shape, around = (10, 12), (20, 24)
    mask = np.ones(shape, bool)
    mask[4, 5] = False
    data = observe(np.random.default_rng(0).normal(size=(1, *shape)), mask, "open", 0.5, 2)
    qx = 2 * np.pi * np.fft.fftfreq(around[0], 0.5)[:, None]
    qy = 2 * np.pi * np.fft.fftfreq(around[1], 0.5)
    q = np.hypot(qx, qy)
    q[0, 0] = 1.0
    law = js.SelfAffine(alpha=0.3, amplitude=2.0)
    with jax.enable_x64(True):
        spectrum = np.array(law(q))
    spectrum[0, 0] = 0.0
    covariance = np.fft.ifft2(spectrum).real / 0.25
    x, y = (grid.ravel() for grid in np.mgrid[: shape[0], : shape[1]])
    dense = covariance[np.subtract.outer(x, x) % around[0], np.subtract.outer(y, y) % around[1]]
    sites, exact = len(x), 0.0
    waves = np.exp(-2j * np.pi * (np.outer(np.arange(10), x) / 10)[:, None, :])
    waves = waves * np.exp(-2j * np.pi * (np.outer(np.arange(7), y) / 12))[None]
    for window, next_site in zip(data.observer.window, (shape[1], 1), strict=True):
        steps = np.zeros((sites, sites))  # rows: the levelled step from each site
        exists = np.flatnonzero(window.ravel() > 0)
        steps[exists, exists], steps[exists, exists + next_site] = -1.0, 1.0
        steps[exists] -= steps[exists].mean(0)
        seen = steps @ dense @ steps.T
        exact = exact + np.einsum("abs,st,abt->ab", waves, seen, waves.conj()).real
    # steps along x and along y, of which the missing site takes two each
    assert data.observer.window.sum() == 9 * 12 - 2 + 10 * 11 - 2
    exact = exact * 0.25 / data.observer.window.sum()
    np.testing.assert_allclose(expected(data, law), exact.ravel()[1:], rtol=1e-9, atol=1e-12)


def test_expected_periodogram_is_what_is_measured_with_a_control():
    data = observe(crops(200), with_holes(), "open", 1.0, 4)
    ratio = data.periodogram.mean(0) / expected(data, LAW)
    count = np.minimum(data.multiplicity, 2) / 2 * 200
    # each mode of 200 maps: chi2 of one a mode, over 527 correlated modes
    assert 0.8 < np.mean((ratio - 1) ** 2 * count) < 1.2
    other = data.periodogram.mean(0) / expected(data, js.SelfAffine(0.45, 2.0, 4.0))
    assert np.mean((other - 1) ** 2 * count) > 1.2


def test_the_plane_does_not_matter():
    heights = crops(1)[0]
    x, y = np.mgrid[:SIDE, :SIDE]
    first = fit_likelihood(heights, GUESS, boundary="open")
    tilted = fit_likelihood(heights + 5.0 + 3 * x - 0.7 * y, GUESS, boundary="open")
    assert tilted.values["alpha"] == pytest.approx(first.values["alpha"], abs=1e-4)
    # the control: on a periodic map the tilt is most of what there is to see
    both = np.stack([heights, heights + 3 * x - 0.7 * y])
    flat, wrong = fit_likelihood(both, js.SelfAffine(0.2), each=True)
    assert wrong.values["amplitude"] > 10 * flat.values["amplitude"]


def test_hidden_heights_do_not_matter():
    heights, mask = crops(1)[0], with_holes()
    spoilt = np.where(mask, heights, np.nan)
    first = fit_likelihood(heights, GUESS, boundary="open", mask=mask)
    second = fit_likelihood(spoilt, GUESS, boundary="open", mask=mask)
    assert first.values == second.values
    assert first.details["errors"] == "sandwich"


def test_open_masked_maps_keep_their_errors():
    fits = fit_likelihood(crops(24), GUESS, boundary="open", mask=with_holes(), each=True)
    alpha = np.array([f.values["alpha"] for f in fits])
    error = np.array([f.stderr["alpha"] for f in fits])
    rmse = np.sqrt(np.mean((alpha - 0.5) ** 2))
    # 24 maps: rms to 15 %, mean to rms/4.9
    assert abs(alpha.mean() - 0.5) < 4 * rmse / np.sqrt(24)
    assert np.median(error) == pytest.approx(rmse, rel=0.6)
    # the control: independent modes on so many sites would claim the periodic map's error
    assert np.median(error) > 1.2 * 1.383 / SIDE


def test_each_map_may_have_its_own_mask():
    heights, holes = crops(2), with_holes()
    masks = np.stack([holes, holes[::-1]])
    fits = fit_likelihood(heights, GUESS, boundary="open", mask=masks, each=True)
    for one, mask, fit in zip(heights, masks, fits, strict=True):
        alone = fit_likelihood(one, GUESS, boundary="open", mask=mask)
        assert fit.values == alone.values
        assert fit.stderr == alone.stderr
    shared = fit_likelihood(heights, GUESS, boundary="open", mask=masks[:1].repeat(2, 0))
    assert shared.details["maps"] == 2
    with pytest.raises(ValueError, match=r"fitted one by one; got .* \(2, 32, 32\) that differ"):
        fit_likelihood(heights, GUESS, boundary="open", mask=masks)


def test_residual_spectrum_of_open_maps_accepts_the_law_and_rejects_another():
    heights = crops(24)
    free = js.SelfAffine(0.2, 1.0, cutoff=6.0)
    right = fit_likelihood(heights, free, boundary="open", mask=with_holes())
    # missing sites make a bin scatter less than it is given credit for: chi2 is at most its dof
    assert right.p_value > 0.01
    wrong = fit_likelihood(heights, js.SelfAffine(0.2), boundary="open", mask=with_holes())
    assert wrong.p_value < 1e-6  # 24 x 32 modes are flat, which this law does not know


def scattered(side):
    return np.random.default_rng(0).uniform(size=(side, side)) > 0.1


def disc(side):
    x, y = np.mgrid[:side, :side]
    return np.hypot(x - side / 3, y - side / 3) > side * np.sqrt(0.1 / np.pi)


@pytest.mark.slow
@pytest.mark.parametrize("hide", [disc, scattered])
@pytest.mark.parametrize(
    # At L = 32 a whole periodic map has 1.46 times the bound if its cutoff, four modes away from
    # q = 0, is unknown; the bound itself leaves no room for edges and holes there.
    ("side", "fixed"),
    [(32, ("cutoff",)), (64, ()), (64, ("cutoff",))],
)
def test_open_masked_maps_come_near_the_bound_of_periodic_ones(side, fixed, hide):
    cutoff = 0.96 * side / 8
    law = js.SelfAffine(0.5, 2.0, cutoff=cutoff)
    guess = js.SelfAffine(0.2, 1.0, cutoff=cutoff if fixed else 12.0)
    x, y = np.mgrid[:side, :side]
    mask = hide(side)
    how = {"boundary": "open", "mask": mask, "fixed": fixed, "each": True}
    fits = []
    for part in range(4):
        key = jax.random.fold_in(jax.random.key(8), part)
        wide = js.sample(law, (4 * side, 4 * side), key=key, batch=100, dtype="float64")
        heights = np.asarray(wide)[:, :side, :side] + 0.3 * x - 0.2 * y
        fits += fit_likelihood(heights, guess, **how)
    assert all(fit.converged for fit in fits)
    alpha = np.array([f.values["alpha"] for f in fits])
    pull = np.abs(alpha - 0.5) / np.array([f.stderr["alpha"] for f in fits])
    rmse = np.sqrt(np.mean((alpha - 0.5) ** 2))
    assert rmse < 1.5 * 1.383 / np.sqrt(mask.sum())
    assert abs(alpha.mean() - 0.5) < 4 * rmse / 20
    # 400 intervals of 68 % cover 68 +- 2.3 %: three of these
    assert 0.61 < np.mean(pull < 1) < 0.75
    # the control: the error of a whole periodic map, claimed here, would cover less
    assert np.mean(np.abs(alpha - 0.5) < 1.383 / side) < 0.68


def test_masked_periodic_maps():
    law = js.SelfAffine(alpha=0.5, amplitude=2.0)
    heights = np.asarray(js.sample(law, (32, 32), key=jax.random.key(5), dtype="float64"))
    mask = np.ones((32, 32), bool)
    mask[10:20, 15:30] = False
    fit = fit_likelihood(np.where(mask, heights, 0.0), js.SelfAffine(0.2), mask=mask)
    assert abs(fit.values["alpha"] - 0.5) < 4 * fit.stderr["alpha"]
    # more than the bound on the whole map; 15 % of it is hidden, with an edge around
    assert 1.383 / 32 < fit.stderr["alpha"] < 2 * 1.383 / 32
