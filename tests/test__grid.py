"""The convention: wave numbers, multiplicities and bins add up to the whole zone."""

import numpy as np
import pytest

from jaxsurf import _grid

SHAPES = [(8, 8), (9, 12), (12, 9), (7, 5)]


@pytest.mark.parametrize("shape", SHAPES)
def test_multiplicities_count_every_mode_once(shape):
    full = np.fft.fft2(np.random.default_rng(0).normal(size=shape))
    half = full[:, : shape[1] // 2 + 1]
    multiplicity = _grid.mode_multiplicity(shape)
    assert multiplicity.sum() * shape[0] == shape[0] * shape[1]
    np.testing.assert_allclose((multiplicity * abs(half) ** 2).sum(), (abs(full) ** 2).sum())


def test_wave_numbers_scale_with_the_spacing_and_fill_the_zone():
    q_x, q_y = _grid.wave_numbers((6, 8), spacing=0.5)
    np.testing.assert_allclose(q_x[:, 0], 2 * np.pi / 3 * np.array([0, 1, 2, -3, -2, -1]))
    np.testing.assert_allclose(q_y[0], np.pi / 2 * np.arange(5))
    assert _grid.wave_number((6, 8), 0.5).max() == pytest.approx(np.hypot(1, 1) * 2 * np.pi)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("corners", [False, True])
def test_radial_bins_hold_every_mode_of_the_zone(shape, corners):
    bins = _grid.radial_bins(shape, corners=corners)
    q = _grid.wave_number(shape)
    weight = np.broadcast_to(_grid.mode_multiplicity(shape), q.shape)
    reach = np.pi * (np.sqrt(2) if corners else 1) * (1 + 1e-9)
    assert bins.count.sum() == weight[(q > 0) & (q <= reach)].sum()
    assert np.all(bins.count > 0)
    assert np.all(np.diff(bins.scale) > 0)
    for i, scale in enumerate(bins.scale):  # the geometric mean of what is inside
        inside = bins.index == i
        mean = np.exp(np.average(np.log(q[inside]), weights=weight[inside]))
        assert scale == pytest.approx(mean)
        assert q[inside].max() / q[inside].min() <= _grid.BIN_RATIO * (1 + 1e-9)


@pytest.mark.parametrize("shape", SHAPES)
def test_separation_bins_hold_every_separation_up_to_half_the_map(shape):
    bins = _grid.separation_bins(shape)
    x, y = _grid.separations(shape)
    r = np.hypot(x, y)
    assert bins.count.sum() == np.count_nonzero((r > 0) & (r <= min(shape) / 2))
    assert bins.scale[0] == pytest.approx(1)
    assert bins.count[0] == 4


def test_edges_grow_by_the_ratio_and_reach_the_end():
    edges = _grid.logarithmic_edges(1.0, 10.0)
    np.testing.assert_allclose(edges[1:] / edges[:-1], 1.1)
    assert edges[-2] < 10 <= edges[-1]


@pytest.mark.parametrize("side", [4, 7, 8, 64, 512])
def test_default_scales_are_whole_and_end_at_a_quarter(side):
    scales = _grid.default_scales((side, side + 3))
    assert scales[0] == 1
    assert scales[-1] == max(side // 4, 1)
    assert np.all(np.diff(scales) > 0)
