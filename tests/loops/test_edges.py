"""Open maps as crops of periodic ones, whose loops are the truth."""

import numpy as np
import pytest

from jaxsurf.loops.levels import level_loops
from jaxsurf.loops.statistics import open_share
from jaxsurf.loops.trace import trace_loops


def rough(count, side, alpha, seed=0):
    rng = np.random.default_rng(seed)
    q = np.hypot(*np.meshgrid(np.fft.fftfreq(side), np.fft.rfftfreq(side), indexing="ij"))
    q[0, 0] = np.inf
    noise = np.fft.rfft2(rng.standard_normal((count, side, side)))
    return np.fft.irfft2(noise * q ** (-1 - alpha), s=(side, side)).astype(np.float32)


@pytest.fixture(scope="module")
def truth_and_crops():
    h = rough(12, 256, 0.4)
    levels = np.linspace(-0.5, 0.5, 3) * h.std()
    crops = h.reshape(12, 4, 64, 4, 64).transpose(0, 1, 3, 2, 4).reshape(-1, 64, 64)
    return level_loops(h, levels), level_loops(crops, levels, boundary="open")


def test_edge_correction_brings_crops_to_the_periodic_truth(truth_and_crops):
    whole, crops = truth_and_crops
    # number of loops per level set and area at each radius, whole and cropped, corrected or not
    found = {}
    for name, loops, side, weight in (
        ("whole", whole, 256, 1),
        ("crops", crops, 63, 1),
        ("corrected", crops, 63, 1 / (1 - np.minimum(crops.radius, 62) / 63) ** 2),
    ):
        weight = np.broadcast_to(weight, len(loops))[loops.closed]
        count = np.zeros((loops.surfaces, 70))
        small = loops.radius[loops.closed] < 70
        rows = loops.surface[loops.closed][small], loops.radius[loops.closed][small]
        np.add.at(count, rows, weight[small])
        groups = count.reshape(12, -1, 70).mean(1) / side**2
        cumulative = (
            np.cumsum(groups[:, ::-1], 1)[:, ::-1][:, 8:33] - groups[:, 33:].sum(1)[:, None]
        )
        found[name] = cumulative.mean(0), cumulative.std(0, ddof=1) / np.sqrt(12)
    error = np.hypot(found["whole"][1], found["corrected"][1])
    assert np.all(np.abs(found["whole"][0] - found["corrected"][0]) < 4 * error)
    # the control: without the correction a third of the loops with 8 <= R <= 32 is missing
    assert found["crops"][0][0] < 0.8 * found["whole"][0][0]


def test_corrected_curves_use_those_weights(truth_and_crops):
    _, crops = truth_and_crops
    plain, corrected = crops.length_tail(), crops.length_tail(edge_correction=True)
    kept = crops.closed
    weight = (crops.weight * crops.length / (1 - crops.radius / 63) ** 2)[kept]
    expected = weight[crops.length[kept] > 101].sum() / weight.sum()
    at = np.flatnonzero(corrected.scale >= 101)[0]
    longer = weight[crops.length[kept] > corrected.scale[at]].sum() / weight.sum()
    assert corrected.mean[at] == pytest.approx(longer)
    assert expected > 0
    assert corrected.mean[at] > plain.mean[at], "long loops fit in fewer places"
    a, b = crops.mean_length(), crops.mean_length(edge_correction=True)
    np.testing.assert_allclose(a.mean[:5], b.mean[:5])  # one radius a bin: the weight cancels
    with pytest.raises(ValueError, match="edge_correction is for open maps"):
        truth_and_crops[0].mean_length(edge_correction=True)


def test_corrected_tail_of_traced_loops_agrees_with_the_periodic_truth():
    h = rough(40, 256, 0.6, seed=3)
    crops = h[:, 20:148, 50:178]
    whole = trace_loops(h, 400, rng=0)
    whole = whole.select(whole.radius < 64).length_tail()
    cut = trace_loops(crops, 400, rng=0, boundary="open")
    cut = cut.select(cut.radius < 64)
    corrected, plain = cut.length_tail(edge_correction=True), cut.length_tail()
    window = (whole.scale > 20) & (whole.scale < 200)
    common = [np.flatnonzero(window), np.searchsorted(corrected.scale, whole.scale[window])]
    a, b, c = whole.mean[common[0]], corrected.mean[common[1]], plain.mean[common[1]]
    error = np.hypot(whole.stderr[common[0]], corrected.stderr[common[1]])
    # boxes that are not square fit a little more often than (1 - R/L)^2 says: 3 % beside the errors
    assert np.all(np.abs(a - b) < 4 * error + 0.03 * a)
    assert np.all((a - c)[-5:] > 3 * error[-5:]), "uncorrected, long loops are missing"


def test_open_share(truth_and_crops):
    whole, crops = truth_and_crops
    share = open_share(crops)
    assert np.all(open_share(whole).mean == 0)
    assert share.kind == "open_share"
    small, large = share.mean[share.scale < 3], share.mean[(share.scale > 40) & ~share.missing]
    assert np.all(small < 0.25)
    assert np.all(large > 0.6)
    total = crops.length[crops.is_open].sum() / crops.length.sum()
    # pieces of a single plaquette have no radius and are in no bin
    kept = crops.radius > 0
    weighted = (share.mean * share.count).sum() / share.count.sum()
    assert weighted == pytest.approx(
        (crops.weight * crops.length * crops.is_open)[kept].sum()
        / (crops.weight * crops.length)[kept].sum()
    )
    assert total > weighted
    with pytest.raises(ValueError, match="needs whole level sets"):
        open_share(trace_loops(np.eye(8) + np.arange(8), 5, rng=0, boundary="open"))
