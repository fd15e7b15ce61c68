"""Measures 1-4 of sampled surfaces against the laws' exact lattice expectations.

Every scale must agree within 5 standard errors (1 in 2 million by chance, with up to 40 points a
test), and a law whose alpha is off by 0.05 must not.
"""

import jax
import numpy as np
import pytest

import jaxsurf as js
from jaxsurf import _grid

SHAPE, SURFACES = (64, 48), 300
SIZES = np.array([2, 3, 5, 8, 12])
LAWS = {
    "self-affine": (js.SelfAffine(alpha=0.4), js.SelfAffine(alpha=0.45)),
    "steep": (js.SelfAffine(alpha=1.0), js.SelfAffine(alpha=0.95)),
    "cutoff": (
        js.SelfAffine(alpha=0.4, cutoff=8.0),
        js.SelfAffine(alpha=0.45, cutoff=8.0),
    ),
    "white": (js.WhiteNoise(), js.SelfAffine(alpha=-0.95)),
}


def ring_expectation(law):
    """Mean over each ring of the exact D_2 at its separations."""
    x, y = _grid.separations(SHAPE)
    bins = _grid.separation_bins(SHAPE)
    vectors = np.stack([np.broadcast_to(x, SHAPE), np.broadcast_to(y, SHAPE)], -1).reshape(-1, 2)
    inside = bins.index.ravel() < len(bins.scale)
    exact = js.laws.expected_height_correlation(law, SHAPE, vectors[inside])
    index = bins.index.ravel()[inside]
    return np.bincount(index, np.asarray(exact, float)) / np.bincount(index)


def spectrum_expectation(law):
    """Mean over each ring of the law itself."""
    bins = _grid.radial_bins(SHAPE)
    q = _grid.wave_number(SHAPE)
    q[0, 0] = 1.0
    weight = np.broadcast_to(_grid.mode_multiplicity(SHAPE), q.shape).ravel()
    total = np.bincount(bins.index.ravel(), weight * np.asarray(law(q), float).ravel())
    return total[: len(bins.scale)] / bins.count


MEASURES = {
    "spectrum": (js.power_spectrum, spectrum_expectation),
    "rings": (js.height_correlation, ring_expectation),
    "differences": (
        lambda h: js.height_correlation(h, SIZES),
        lambda law: js.laws.expected_height_correlation(law, SHAPE, SIZES),
    ),
    "curvature 10": (
        lambda h: js.curvature_moment(h, SIZES),
        lambda law: js.laws.expected_curvature_variance(law, SHAPE, SIZES, "10"),
    ),
    "curvature 11": (
        lambda h: js.curvature_moment(h, SIZES, direction="11"),
        lambda law: js.laws.expected_curvature_variance(law, SHAPE, SIZES, "11"),
    ),
    "patches": (
        lambda h: js.patch_moment(h, SIZES),
        lambda law: js.laws.expected_patch_variance(law, SHAPE, SIZES),
    ),
}


@pytest.fixture(scope="module", params=LAWS)
def drawn(request):
    law, wrong = LAWS[request.param]
    return js.sample(law, SHAPE, key=jax.random.key(21), batch=SURFACES), law, wrong


@pytest.mark.parametrize("measure", MEASURES)
def test_ensemble_means_are_the_exact_expectations(drawn, measure):
    heights, law, wrong = drawn
    measured, expectation = MEASURES[measure]
    curve = measured(heights)
    for true, candidate in ((True, law), (False, wrong)):
        exact = np.asarray(expectation(candidate), float)
        worst = np.max(np.abs((np.asarray(curve.mean) - exact) / np.asarray(curve.stderr)))
        assert (worst < 5) == true, (measure, worst)


def test_gaussian_surfaces_have_the_kurtosis_three(drawn):
    heights, _, _ = drawn
    ratio = js.curvature_ratio(heights, SIZES)
    pull = np.asarray((ratio.mean - 3) / ratio.stderr)
    assert np.all(np.abs(pull) < 5), pull
    # the control: heights bent by 30 % of their deviation are no longer Gaussian
    deviation = heights / heights.std((-2, -1), keepdims=True)
    bent = js.curvature_ratio(deviation + 0.3 * deviation**2, SIZES)
    assert np.any(np.abs((bent.mean - 3) / bent.stderr) > 5)


@pytest.mark.parametrize("surfaces", [100, pytest.param(300, marks=pytest.mark.slow)])
def test_open_maps_and_masks_have_the_same_expectations(surfaces):
    """What exists of a periodic surface is as rough as the whole: nothing wraps, nothing leaks."""
    law = js.SelfAffine(alpha=0.7)
    heights = js.sample(law, SHAPE, key=jax.random.key(5), batch=surfaces)
    mask = np.random.default_rng(0).random(SHAPE) > 0.02
    exact = {
        "differences": js.laws.expected_height_correlation(law, SHAPE, SIZES),
        "curvature 10": js.laws.expected_curvature_variance(law, SHAPE, SIZES),
        "patches": js.laws.expected_patch_variance(law, SHAPE, SIZES),
    }
    measures = {
        "differences": lambda h, **how: js.height_correlation(h, SIZES, **how),
        "curvature 10": lambda h, **how: js.curvature_moment(h, SIZES, **how),
        "patches": lambda h, **how: js.patch_moment(h, SIZES, **how),
    }
    spoiled = np.where(mask, heights, np.nan)
    for name, measure in measures.items():
        for how in ({"boundary": "open"}, {"mask": mask}, {"boundary": "open", "mask": mask}):
            curve = measure(spoiled if "mask" in how else heights, **how)
            seen = ~np.asarray(curve.missing)
            # an open map leaves out other pairs along x than along y, so that the mean over both
            # axes is not the laws'; at these scales and this shape by less than a standard error
            pull = np.asarray((curve.mean - exact[name]) / curve.stderr)[seen]
            assert np.all(np.abs(pull) < 5), (name, how, pull)
            assert seen[:3].all()
