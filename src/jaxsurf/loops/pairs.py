r"""G(r) from all pairs of points of every loop.

A traced loop gives the distances from one of its points. A whole level set holds all pairs, far
more than can be counted one by one; but not more than one Fourier transform can hold. Give each
loop an independent random sign and put the signed visits of its points on the dual lattice,

$$f(x) = \sum_\ell \sigma_\ell\, n_\ell(x), \qquad
\langle f * f \rangle_\sigma (r) = \sum_\ell \sum_x n_\ell(x)\, n_\ell(x + r) ,$$

for the cross terms vanish in expectation. Their noise comes mostly from a few long loops, so the
loops are dealt out, longest first, over several such fields, whose autocorrelations are added:
loops of different fields have no cross terms at all, and with a field for each loop the sum is
exact. It is free of bias at distances below half the map, and what noise is left shows in the
scatter between surfaces.

Distances are those on the torus; on an open map the field is padded instead. On open and masked
maps the pairs are counted against those of a loop's point and any plaquette of the valid region,
found by one more transform of the region's indicator, so that G(r) is the chance for sites that
could have been on the loop.

NumPy alone, but for the `Curve` it returns.
"""

import numpy as np

from jaxsurf.curve import Curve
from jaxsurf.loops.loops import Loops
from jaxsurf.loops.maps import check_count, seed_of
from jaxsurf.loops.statistics import (
    BIN_RATIO,
    curve_details,
    loop_weights,
    share_total,
    shell_bins,
)

ROUNDING = 1e-9  # of the transforms, against the weight of all points


def all_pairs_correlation(
    loops: Loops,
    *,
    fields: int = 8,
    rng: np.random.Generator | int = 0,
    lengths: tuple[float | int, float | int] | None = None,
    per: str | None = None,
    share: str = "closed",
    pieces: bool = False,
    ratio: float = BIN_RATIO,
) -> Curve:
    r"""Chance that a site at distance r of a point of a loop is on that loop, over all pairs.

    $$G(r) = \frac{\sum_\ell w_\ell\, g_\ell(r) / s_\ell}{n(r) \sum_\ell w_\ell} \sim r^{-2x_l}$$

    with g the pairs of points at distance [r, r + 1) on a loop of length s and n(r) the sites
    there. Of loops in a narrow range of lengths it is the paper's $G_s(r) \sim r^{-a}$ of a single
    loop.

    Predicted is a = 2 - D_f = (1 + alpha)/2: 0.5, 0.7 and 0.9 at alpha 0, 0.4 and 0.8. Measured at
    L = 512 over 4 < r < 16 (`benchmarks/loops_physics.py single-loop --side 512 --surfaces 12`) it
    is 0.52(1), 0.65(1) and 0.75(4): not 2 x_l, growing with alpha, but at this size below the
    prediction for alpha > 0 by more than its error.

    Arguments:
        loops: from `level_loops(..., paths=True)`.
        fields: how many the loops of a surface are dealt over; a transform each. The noise of the
            cross terms falls at least as their root.
        rng: a Generator, or the seed of one.
        lengths: keep loops with lengths in this range, in units of length.
        per: what an average counts once, as for `mean_length`.
        share: "closed", of the points on the closed loops that are kept, or "all", of the points on
            any; with `lengths` it is then what those loops contribute to G(r).
        pieces: with share="all", also count the pairs on winding loops and on pieces that edges or
            masked sites cut loops into. Closed loops on an open map are the small ones, and their
            G(r) falls far too fast; with the pieces, only pairs joined by way of the outside are
            missing, whose share vanishes with r/L.
        ratio: outer over inner edge of a bin.

    Returns:
        A `Curve` over r < L/2, each surface weighted by what G is a share of, and by nothing where
        a mask leaves no pair at that distance. Its errors, from the scatter between surfaces, hold
        the noise of the signs too.

    Raises:
        ValueError: paths were not kept, no fields, pieces as a share of the closed loops.

    Source: the paper's Eq. (loopcorr), all pairs instead of those with one start.
    """
    fields = check_count("fields", fields)
    if loops.vertices is None:
        raise ValueError(
            "correlation needs the points of each loop; these loops have none. "
            "Call level_loops with paths=True, or trace_loops with correlation=True."
        )
    is_open = loops.boundary == "open"
    sides = loops.shape[0] - is_open, loops.shape[1] - is_open
    if pieces and share != "all":
        raise ValueError(
            f"pieces=True needs share='all', of the points on any loop; got share={share!r}. "
            "Pass share='all', or leave pieces out."
        )
    kept = np.ones(len(loops), bool) if pieces else loops.closed
    if lengths is not None:
        low, high = lengths
        kept &= (loops.length * loops.spacing >= low) & (loops.length * loops.spacing <= high)
    weight, per = loop_weights(loops, per)
    total = share_total(loops, share, per, weight)
    starting = kept if total is None else np.ones_like(kept)
    if total is None:
        total = np.bincount(loops.surface, weight * kept, loops.surfaces).astype(float)
    grid = (2 * sides[0], 2 * sides[1]) if is_open else sides
    bins, scale, sites = shell_bins(min(sides) // 2, ratio)
    samples, weights = np.zeros((2, loops.surfaces, len(scale)))
    order = np.argsort(loops.surface, kind="stable")
    bounds = np.searchsorted(loops.surface[order], np.arange(loops.surfaces + 1))
    first = np.cumsum(loops.length) - loops.length
    seeds = np.random.SeedSequence(seed_of(rng)).spawn(loops.surfaces)
    for surface in range(loops.surfaces):  # one transform at a time: the memory is that of one map
        every = order[bounds[surface] : bounds[surface + 1]]
        here = every[kept[every]]
        if not len(here):
            continue
        label, cell, each = _points_of(loops, here, first, weight, grid)
        field, sign = _dealt(np.random.default_rng(seeds[surface]), loops.length[here], fields)
        pairs = _autocorrelation(cell, np.sqrt(each) * sign[label], field[label], grid)
        fits = total[surface] * sites
        if is_open or loops.valid is not None:
            _, cell, each = _points_of(loops, every[starting[every]], first, weight, grid)
            whole = np.ones(sides) if loops.valid is None else loops.valid[surface]
            fits = _in_shells(_fitting(cell, each, whole[: sides[0], : sides[1]], grid), bins)
        possible = fits > ROUNDING * total[surface]
        samples[surface] = _in_shells(pairs, bins) / np.where(possible, fits, np.inf)
        weights[surface] = total[surface] * possible
    return Curve(
        "loop_correlation",
        scale * loops.spacing,
        samples,
        weights,
        units=("sites" if loops.spacing == 1.0 else "length", "1"),
        details=curve_details(loops, per),
    )


def _points_of(
    loops: Loops,
    chosen: np.ndarray,
    first: np.ndarray,
    weight: np.ndarray,
    grid: tuple[int, ...],
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of all points of the chosen loops: which of these loops, which cell, the weight of each."""
    length = loops.length[chosen]
    label = np.repeat(np.arange(len(chosen)), length)
    point = np.arange(len(label)) + (first[chosen] - np.cumsum(length) + length)[label]
    vertices = np.zeros((0, 2), int) if loops.vertices is None else loops.vertices
    x, y = (vertices[point] % np.array(loops.shape)).T
    return label, x * grid[1] + y, (weight[chosen] / length)[label]


def _dealt(
    rng: np.random.Generator, length: np.ndarray, fields: int
) -> tuple[np.ndarray, np.ndarray]:
    """The field each loop of a surface is put in, longest first in turn, and its random sign."""
    field = np.empty(len(length), int)
    field[np.argsort(-length, kind="stable")] = np.arange(len(length)) % fields
    return field, 2.0 * rng.integers(0, 2, len(length)) - 1


def _autocorrelation(
    cell: np.ndarray, value: np.ndarray, field: np.ndarray, grid: tuple[int, ...]
) -> np.ndarray:
    """The sum over sites of f(x) f(x + r), summed over the fields."""
    power = np.zeros((grid[0], grid[1] // 2 + 1))
    order = np.argsort(field, kind="stable")
    for part in np.split(order, np.flatnonzero(np.diff(field[order])) + 1):
        values = np.bincount(cell[part], value[part], grid[0] * grid[1]).astype(np.float32)
        modes = np.fft.rfft2(values.reshape(grid))
        power += modes.real**2 + modes.imag**2
    return np.fft.irfft2(power, s=grid)


def _fitting(
    cell: np.ndarray, weight: np.ndarray, valid: np.ndarray, grid: tuple[int, ...]
) -> np.ndarray:
    """The weight of points x for which x + r is in the valid region too."""
    points = np.bincount(cell, weight, grid[0] * grid[1]).reshape(grid)
    region = np.zeros(grid)
    region[: valid.shape[0], : valid.shape[1]] = valid
    return np.fft.irfft2(np.conj(np.fft.rfft2(points)) * np.fft.rfft2(region), s=grid)


def _in_shells(field: np.ndarray, bins: np.ndarray) -> np.ndarray:
    """Sum a field of displacements over the shells [r, r + 1) of each bin."""
    away = [np.minimum(np.arange(side), side - np.arange(side)) for side in field.shape]
    shell = np.hypot(away[0][:, None], away[1][None, :]).astype(int)
    index = np.concatenate([[len(bins)], bins, [len(bins)]])[np.minimum(shell, len(bins) + 1)]
    return np.bincount(index.ravel(), field.ravel(), len(bins) + 1)[: bins.max() + 1]
