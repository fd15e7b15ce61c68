r"""Statistics of contour loops: the measures 10 to 12 of the paper's Table III.

- $\langle s\rangle(R) \sim R^{D_f}$, the mean length of loops of radius R;
- $P_>(s) \sim s^{-(\tau-2)}$, the share of points whose loop is longer than s;
- $G(r) \sim r^{-2x_l}$, the chance that a site at distance r of a point is on the same loop.

Lengths are even and radii whole, and ratio-1.1 bins are narrower than that spacing where curves are
most precise. So a bin is made of the values that can occur: R = 1, 2, 3, ...; the tail is taken
between admissible lengths, at odd s; and a shell of G(r) is divided by the number of lattice sites
it holds, which tends to $2\pi r$.

Loops that wind or are open are left out. An average counts each loop in one of three ways:
`per="point"`, through a random point (length over gradient); `per="length"`, in proportion to
length; `per="loop"`, each loop once.

What P_> and G are shares of is a choice too: `share="closed"`, of the closed loops' length, as in
the paper; or `share="all"`, of all contour length, loops that wind or are open included. On a map
of side L a share of about $L^{-(1-\alpha)/2}$ is left out, so that the first are too large by a
factor which hardly falls with L, and for comparing sizes the second are wanted.

Source: the paper's Eqs. (Ds-R), (PS), (loopcorr) and Appendix C.
"""

from functools import lru_cache
from typing import Any

import numpy as np

from jaxsurf.curve import Curve
from jaxsurf.loops.loops import Loops
from jaxsurf.loops.maps import check_choice

BIN_RATIO = 1.1
SHARES = ("closed", "all")


def mean_length(
    loops: Loops,
    *,
    per: str | None = None,
    edge_correction: bool = False,
    ratio: float = BIN_RATIO,
) -> Curve:
    r"""Mean length of loops of radius R, in logarithmic bins of the whole numbers R.

    $$\langle s \rangle(R) \sim R^{D_f}, \qquad D_f = (3 - \alpha)/2$$

    Arguments:
        loops: the loops of one or more surfaces.
        per: what an average counts once, "point", "length" or "loop"; by default "point" for loops
            through random points and "length" for whole level sets.
        edge_correction: on an open map, count each loop for the places it would have fitted in on
            an endless one: 1 over (1 - R/L) squared.
        ratio: upper over lower edge of a bin.

    Returns:
        A `Curve` over R, weighted by the loops (or the contour length) behind each sample.

    Source: the paper's Eq. (Ds-R).
    """
    weight, per = loop_weights(loops, per)
    weight = _refitted(loops, weight) if edge_correction else weight
    closed = loops.closed
    bins, scale = whole_number_bins(max(loops.shape), ratio)
    radius = loops.radius[closed]
    inside = radius < len(bins)
    cell = loops.surface[closed][inside] * len(scale) + bins[radius[inside]]
    size = loops.surfaces * len(scale)
    weight, length = weight[closed][inside], loops.length[closed][inside]
    count = _summed(cell, weight, size).reshape(loops.surfaces, -1)
    total = _summed(cell, weight * length, size).reshape(loops.surfaces, -1)
    samples = total / np.where(count > 0, count, 1.0) * loops.spacing
    unit = length_unit(loops)
    return Curve(
        "mean_length",
        scale * loops.spacing,
        samples,
        count,
        units=(unit, unit),
        details=curve_details(loops, per),
    )


def length_tail(
    loops: Loops,
    *,
    per: str | None = None,
    share: str = "closed",
    edge_correction: bool = False,
    ratio: float = BIN_RATIO,
) -> Curve:
    r"""Share of points whose loop is longer than s.

    $$P_>(s) = \sum_{s' > s} P(s') \sim s^{-(\tau - 2)}, \qquad \tau - 1 = (4 - 2\alpha)/(3 -
    \alpha)$$

    Taken at odd s, halfway between the lengths that can occur, where the sum is closest to an
    integral. Its points are strongly correlated; fit them with `Curve.covariance`.

    Arguments:
        loops: the loops of one or more surfaces.
        per: as for `mean_length`; with "loop" the tail is that of the loops, s^-(tau - 1).
        share: "closed", of the points on closed loops, or "all", of the points on any.
        edge_correction: as for `mean_length`.
        ratio: of successive values of s.

    Returns:
        A `Curve` over s, each surface weighted by what its tail is a share of; zero beyond the
        longest closed loop.

    Source: the paper's Eqs. (PS) and (taudef).
    """
    weight, per = loop_weights(loops, per)
    everything = share_total(loops, share, per, weight)
    weight = _refitted(loops, weight) if edge_correction else weight
    closed = loops.closed
    longest = loops.shape[0] * loops.shape[1]
    steps = int(np.log(longest / 5) / np.log(ratio)) + 1
    scale = np.unique(2 * np.round((5 * ratio ** np.arange(steps) - 1) / 2) + 1)
    cell = np.searchsorted(scale, loops.length[closed])  # how many of the s are exceeded
    cell += loops.surface[closed] * (len(scale) + 1)
    size = loops.surfaces * (len(scale) + 1)
    count = _summed(cell, weight[closed], size).reshape(loops.surfaces, -1)
    among_closed = count.sum(1, keepdims=True)
    longer = among_closed - np.cumsum(count, 1)[:, :-1]
    total = among_closed if everything is None else everything[:, None]
    samples = np.maximum(longer, 0.0) / np.where(total > 0, total, 1.0)
    return Curve(
        "length_tail",
        scale * loops.spacing,
        samples,
        np.broadcast_to(total, samples.shape).copy(),
        units=(length_unit(loops), "1"),
        details=curve_details(loops, per),
    )


def correlation(loops: Loops, *, share: str = "closed", ratio: float = BIN_RATIO) -> Curve:
    r"""Chance that a site at distance r of a point is on the loop through that point.

    $$G(r) = \frac{g(r)}{n(r)} \sim r^{-2x_l}$$

    g(r) counts the points of the unwrapped loop at distance [r, r + 1) of its start, per start, and
    n(r), close to $\pi(2r + 1)$, the sites of the dual lattice there; r = 0 is left out. Shells are
    merged into logarithmic bins, and the scale is the geometric mean distance of a bin's sites.

    Arguments:
        loops: from `trace_loops(..., correlation=True)`.
        share: per start on a closed loop, "closed", or per start on any, "all".
        ratio: outer over inner edge of a bin.

    Returns:
        A `Curve` over r up to the larger side; each surface weighted by its starts.

    Raises:
        ValueError: pairs were not counted.

    Source: the paper's Eq. (loopcorr), Appendix C.
    """
    if loops.pairs is None:
        raise ValueError(
            "correlation needs the pairs counted during tracing; these loops have none. "
            "Trace with correlation=True; selected loops lose them."
        )
    bins, scale, sites = shell_bins(loops.pairs.shape[1], ratio)
    counted = np.zeros((loops.surfaces, len(scale)))
    np.add.at(counted.T, bins, loops.pairs[:, 1:].T)
    everything = share_total(loops, share, "point", np.ones(len(loops)))
    if everything is None:
        everything = np.bincount(loops.surface[loops.closed], minlength=loops.surfaces)
    starts = everything.astype(float)[:, None]
    samples = counted / sites / np.where(starts > 0, starts, 1.0)
    return Curve(
        "loop_correlation",
        scale * loops.spacing,
        samples,
        np.broadcast_to(starts, samples.shape).copy(),
        units=(length_unit(loops), "1"),
        details=curve_details(loops, "point"),
    )


def loop_weights(loops: Loops, per: str | None) -> tuple[np.ndarray, str]:
    """What each loop counts for, given how it was found and what is to count once."""
    per = per or ("length" if loops.sampling == "levels" else "point")
    length = np.maximum(loops.length, 1).astype(float)
    weights = {
        ("points", "point"): np.ones_like(length),
        ("points", "length"): loops.weight,
        ("points", "loop"): loops.weight / length,
        ("levels", "length"): loops.weight * length,
        ("levels", "loop"): loops.weight,
        ("levels through points", "point"): loops.weight,
    }
    if (loops.sampling, per) not in weights:
        allowed = sorted(p for s, p in weights if s == loops.sampling)
        raise ValueError(
            f"per must be one of {allowed} for loops sampled by {loops.sampling}; got {per!r}. "
            "Use trace_loops, or level_loops with another placement of the levels."
        )
    return weights[loops.sampling, per], per


def share_total(loops: Loops, share: str, per: str, weight: np.ndarray) -> np.ndarray | None:
    """The weight of all loops of each surface if shares are of that; None for the closed ones."""
    check_choice("share", share, SHARES)
    if share == "closed":
        return None
    if per == "loop":
        raise ValueError(
            "share='all' is of all contour length, by per='point' or 'length'; got per='loop'. "
            "A loop cut by an edge is none or several: count loops among the closed ones."
        )
    return _summed(loops.surface, weight, loops.surfaces)


def _summed(cell: np.ndarray, weight: np.ndarray, size: int) -> np.ndarray:
    """The weight in each cell, as floats even where there is none at all."""
    return np.bincount(cell, weight, size).astype(float)


def open_share(loops: Loops, *, ratio: float = BIN_RATIO) -> Curve:
    r"""The share of contour length in pieces cut by edges or invalid sites, by their radius.

    $$\sum_{\text{open}} s \Big/ \sum_{\text{all}} s \quad \text{at each } R$$

    This is what the statistics of closed loops leave out; where it is large they are biased towards
    the loops that happened to fit.

    Arguments:
        loops: whole level sets of open or masked maps.
        ratio: upper over lower edge of a bin.

    Returns:
        A `Curve` over R, weighted by contour length.

    Raises:
        ValueError: loops through points, whose open pieces are walked in part only.
    """
    if loops.sampling == "points":
        raise ValueError(
            "open_share needs whole level sets; these are loops through points, walked only as far "
            "as the first edge. Use level_loops, or Loops.share_open for the share of starts."
        )
    bins, scale = whole_number_bins(max(loops.shape), ratio)
    kept = (loops.radius > 0) & (loops.radius < len(bins))
    cell = loops.surface[kept] * len(scale) + bins[loops.radius[kept]]
    length = (loops.weight * loops.length)[kept]
    size = loops.surfaces * len(scale)
    count = _summed(cell, length, size).reshape(loops.surfaces, -1)
    cut = _summed(cell, length * loops.is_open[kept], size).reshape(loops.surfaces, -1)
    return Curve(
        "open_share",
        scale * loops.spacing,
        cut / np.where(count > 0, count, 1.0),
        count,
        units=(length_unit(loops), "1"),
        details=curve_details(loops, "length"),
    )


def _refitted(loops: Loops, weight: np.ndarray) -> np.ndarray:
    """Weights divided by the share of positions in which a loop of that radius fits on the map."""
    if loops.boundary != "open":
        raise ValueError(
            "edge_correction is for open maps; these loops are of a periodic one, where all fit. "
            "Leave it out, or trace with boundary='open'."
        )
    fits = np.prod([1 - loops.radius / (side - 1) for side in loops.shape], axis=0)
    return weight / np.where(loops.closed, fits, 1.0)


def curve_details(loops: Loops, per: str) -> tuple[tuple[str, Any], ...]:
    """What every curve of loops says of itself."""
    side = min(loops.shape) * loops.spacing
    return (("side", side), ("sampling", loops.sampling), ("per", per))


def length_unit(loops: Loops) -> str:
    """The unit of lengths: sites, or that of the spacing."""
    return "sites" if loops.spacing == 1.0 else "length"


@lru_cache(maxsize=64)
def whole_number_bins(largest: int, ratio: float) -> tuple[np.ndarray, np.ndarray]:
    """The bin of each whole number 0 ... largest (0 has none: -1), and the geometric means."""
    numbers = np.arange(1, largest + 1)
    raw = np.floor(np.log(numbers) / np.log(ratio) + 1e-9).astype(int)
    kept, bins = np.unique(raw, return_inverse=True)
    scale = np.exp(np.bincount(bins, np.log(numbers)) / np.bincount(bins, minlength=len(kept)))
    return np.concatenate([[-1], bins]), scale


@lru_cache(maxsize=64)
def shell_bins(shells: int, ratio: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The bin of each shell [r, r + 1) for r = 1 ... shells - 1, scales and sites of the bins."""
    side = np.arange(-shells, shells + 1)
    distance = np.hypot(side[:, None], side[None, :]).ravel()
    distance = distance[(distance >= 1) & (distance < shells)]
    shell = distance.astype(int)
    bins = whole_number_bins(shells - 1, ratio)[0][1:]
    sites = np.bincount(bins[shell - 1])
    scale = np.exp(np.bincount(bins[shell - 1], np.log(distance)) / sites)
    return bins, scale, sites
