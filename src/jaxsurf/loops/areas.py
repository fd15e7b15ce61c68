r"""Areas that contour loops enclose: islands, lakes and their coasts.

A loop around a hill encloses an island of that height, one around a pit a lake. On a self-affine
surface their number falls as

$$N(>A) \sim A^{-(\tau_{ZO} - 1)}, \qquad \tau_{ZO} = 2 - \alpha/2,$$

and their coasts grow as $\langle s \rangle (A) \sim A^{D_f/2}$. For the hulls of critical
percolation, the median level of white noise, N(>A) A tends to $1/(8\sqrt{3}\pi)$ for hills and as
much for pits (J. Cardy and R. Ziff, J. Stat. Phys. 110, 1 (2003)).

Areas are whole numbers of plaquettes; as for lengths, what is larger is counted halfway between.

NumPy alone, but for the `Curve` they return.
"""

import numpy as np

from jaxsurf.curve import Curve
from jaxsurf.loops.loops import Loops
from jaxsurf.loops.maps import check_choice
from jaxsurf.loops.statistics import (
    BIN_RATIO,
    curve_details,
    length_unit,
    loop_weights,
    whole_number_bins,
)

SIDES = ("both", "hills", "pits")


def area_tail(loops: Loops, *, side: str = "both", ratio: float = BIN_RATIO) -> Curve:
    r"""The number of loops per unit area that enclose more than A.

    $$N(>A) \sim A^{-(1 - \alpha/2)}$$

    Arguments:
        loops: from `level_loops`; an average over its level sets.
        side: "hills", "pits" or "both".
        ratio: of successive areas.

    Returns:
        A `Curve` over A (units of length squared), in 1/area, each surface weighted by its level
        sets.

    Raises:
        ValueError: loops that are not whole level sets, or an unknown side.

    Source: Olami & Zeitak's islands, as in the paper's Sec. IV; Cardy & Ziff (2003) for the
    amplitude at percolation.
    """
    kept = _enclosing(loops, side)
    largest = loops.shape[0] * loops.shape[1]
    steps = int(np.log(largest / 1.5) / np.log(ratio)) + 1
    scale = np.unique(np.floor(1.5 * ratio ** np.arange(steps)) + 0.5)
    cell = np.searchsorted(scale, np.abs(loops.area[kept]))
    cell += loops.surface[kept] * (len(scale) + 1)
    size = loops.surfaces * (len(scale) + 1)
    count = np.bincount(cell, minlength=size).reshape(loops.surfaces, -1)
    larger = count.sum(1, keepdims=True) - np.cumsum(count, 1)[:, :-1]
    return _per_area(loops, "area_tail", scale, larger, side)


def area_distribution(loops: Loops, *, side: str = "both", ratio: float = BIN_RATIO) -> Curve:
    r"""The number of loops per unit area that enclose A, per unit of A.

    $$n(A) \sim A^{-\tau_{ZO}}, \qquad \tau_{ZO} = 2 - \alpha/2$$

    Arguments:
        loops: from `level_loops`; an average over its level sets.
        side: "hills", "pits" or "both".
        ratio: upper over lower edge of a bin of whole areas.

    Returns:
        A `Curve` over A (units of length squared), in 1/area squared.

    Raises:
        ValueError: loops that are not whole level sets, or an unknown side.
    """
    kept = _enclosing(loops, side)
    bins, scale = whole_number_bins(loops.shape[0] * loops.shape[1], ratio)
    values = np.bincount(bins[1:], minlength=len(scale))
    cell = loops.surface[kept] * len(scale) + bins[np.abs(loops.area[kept])]
    count = np.bincount(cell, minlength=loops.surfaces * len(scale)).reshape(loops.surfaces, -1)
    density = count / values / loops.spacing**2
    return _per_area(loops, "area_distribution", scale, density, side)


def perimeter_of_area(
    loops: Loops, *, side: str = "both", per: str = "loop", ratio: float = BIN_RATIO
) -> Curve:
    r"""Mean length of the loops that enclose A.

    $$\langle s \rangle(A) \sim A^{D_f/2}$$

    Arguments:
        loops: of any sampling.
        side: "hills", "pits" or "both".
        per: what an average counts once, as for `mean_length`.
        ratio: upper over lower edge of a bin of whole areas.

    Returns:
        A `Curve` over A (units of length squared), in units of length.
    """
    check_choice("side", side, SIDES)
    weight, per = loop_weights(loops, per)
    kept = loops.closed & _on_side(loops, side)
    bins, scale = whole_number_bins(loops.shape[0] * loops.shape[1], ratio)
    cell = loops.surface[kept] * len(scale) + bins[np.abs(loops.area[kept])]
    size, length = loops.surfaces * len(scale), loops.length[kept]
    count = np.bincount(cell, weight[kept], size).astype(float).reshape(loops.surfaces, -1)
    total = np.bincount(cell, weight[kept] * length, size).astype(float)
    samples = total.reshape(count.shape) / np.where(count > 0, count, 1.0) * loops.spacing
    unit = length_unit(loops)
    return Curve(
        "perimeter_of_area",
        scale * loops.spacing**2,
        samples,
        count,
        units=(f"{unit}^2", unit),
        details=(*curve_details(loops, per), ("loops", side)),
    )


def _on_side(loops: Loops, side: str) -> np.ndarray:
    return {"both": loops.area != 0, "hills": loops.area > 0, "pits": loops.area < 0}[side]


def _enclosing(loops: Loops, side: str) -> np.ndarray:
    check_choice("side", side, SIDES)
    if loops.sampling != "levels" or loops.level_sets is None:
        raise ValueError(
            "a number of loops per area needs whole level sets; these are loops sampled by "
            f"{loops.sampling}. Use level_loops, not with placement='points'."
        )
    return loops.closed & _on_side(loops, side)


def _per_area(loops: Loops, kind: str, scale: np.ndarray, count: np.ndarray, side: str) -> Curve:
    if loops.level_sets is None or loops.plaquettes is None:
        raise ValueError("these loops do not say what was searched. Use those of level_loops.")
    sets = loops.level_sets[:, None].astype(float)
    searched = sets * loops.plaquettes[:, None] * loops.spacing**2
    unit = length_unit(loops)
    return Curve(
        kind,
        scale * loops.spacing**2,
        count / searched,
        np.broadcast_to(sets, count.shape).copy(),
        units=(f"{unit}^2", f"1/{unit}^{2 if kind == 'area_tail' else 4}"),
        details=(*curve_details(loops, "loop"), ("loops", side)),
    )
