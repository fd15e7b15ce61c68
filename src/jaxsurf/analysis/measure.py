"""One real map by four roads: alpha from the spectrum, the curvature, and two loop measures.

The map has edges, so nothing wraps around: the spectrum is levelled and windowed, curvatures use
the pairs that exist, and loops that leave the map are set aside. One map is one sample; what its
four quarters say apart is the only honest measure of how far another map of the same surface might
differ, so each statistical error is the scatter between quarters, halved.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from jaxsurf import theory
from jaxsurf._checks import check_heights, check_integer
from jaxsurf.curve import Curve
from jaxsurf.fitting._window import default_window
from jaxsurf.fitting.fit import Fit
from jaxsurf.fitting.power_law import FEWEST_POINTS, fit_power_law
from jaxsurf.io.heightmap import HeightMap
from jaxsurf.io.levelling import level
from jaxsurf.loops.trace import trace_loops
from jaxsurf.measures.curvature import curvature_moment
from jaxsurf.measures.fourier import power_spectrum

#: Measure -> (kind of curve, alpha and its derivative from the slope).
ROADS = {
    "spectrum": ("spectrum", lambda slope: theory.Estimate(-slope / 2 - 1, 0.5)),
    "curvature variance": (
        "curvature_moment",
        lambda slope: theory.alpha_from_correlation(slope, 1.0),
    ),
    "loop dimension D_f": (
        "mean_length",
        lambda slope: theory.alpha_from_fractal_dimension(slope, 1.0),
    ),
    "loop lengths tau-2": (
        "length_tail",
        lambda slope: theory.alpha_from_length_tail(-slope, 1.0),
    ),
}


@dataclass(frozen=True)
class Road:
    """What one measure says.

    Attributes:
        slope: of the curve on log-log paper, with statistical and systematic error.
        alpha: the roughness exponent it implies, with statistical and systematic error.
        fit: the straight line on the whole map.
    """

    slope: tuple[float, float, float]
    alpha: tuple[float, float, float]
    fit: Fit


@dataclass(frozen=True)
class MapMeasurement:
    """Roughness of one map.

    Attributes:
        surface: the levelled map.
        roads: measure -> what it says.
        curves: kind -> curve of the whole map.
        share_open: share of the loops set aside because they leave the map.
        notes: what was done to the heights, in words.
    """

    surface: HeightMap
    roads: dict[str, Road]
    curves: dict[str, Curve]
    share_open: float
    notes: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Values, errors and fits, ready for JSON."""
        names = ("value", "statistical", "systematic")
        return {
            "source": self.surface.source,
            "sites": self.surface.heights.shape,
            "spacing": self.surface.spacing,
            "units": (self.surface.length_unit, self.surface.height_unit),
            "share_open": self.share_open,
            "notes": self.notes,
            "measures": {
                name: {
                    "slope": dict(zip(names, road.slope, strict=True)),
                    "alpha": dict(zip(names, road.alpha, strict=True)),
                    "fit": road.fit.to_dict(),
                }
                for name, road in self.roads.items()
            },
        }


def measure_map(surface: HeightMap, *, points: int = 1000, seed: int = 0) -> MapMeasurement:
    """Measure alpha of one map with edges by four independent roads.

    Arguments:
        surface: at least 64 x 64 sites, missing ones left out; its plane is taken out first.
        points: starting points of loops on the whole map; its quarters get as many each.
        seed: of the starting points.

    Returns:
        The four estimates of alpha with their curves.

    Raises:
        ValueError: a map smaller than 64 x 64, constant, or with too few valid sites.

    Source: the paper's Sec. VII.
    """
    check_heights(surface.heights, mask=surface.valid)
    check_integer("points", points, low=1, remedy="The paper traces 1000 loops on its image.")
    if min(surface.heights.shape) < 64:
        raise ValueError(
            "a map to measure must have at least 64 x 64 sites, or its quarters cannot be fitted; "
            f"got {surface.heights.shape}. Pass a larger map."
        )
    levelled = level(surface)
    curves, share_open, notes = _curves(levelled, points, seed)
    quarters = [_curves(level(part), points, seed)[0] for part in _quarters(surface)]
    roads = {}
    for name, (kind, to_alpha) in ROADS.items():
        fit = fit_power_law(curves[kind], window=_window(curves[kind]))
        slopes = [
            fit_power_law(part, window=fit.details["window"]).values["exponent"]
            for part in (_fittable(quarter[kind], fit.details["window"]) for quarter in quarters)
            if part is not None
        ]
        if len(slopes) == 4:  # four quarters make one map: its error is half their scatter
            statistical = float(np.std(slopes, ddof=1) / 2)
        else:
            statistical = fit.stderr["exponent"]
            notes += (
                f"{name}: only {len(slopes)} of 4 quarters have enough points in the window; its "
                "statistical error is that of the straight line, a lower bound",
            )
        slope = (fit.values["exponent"], statistical, fit.systematic["exponent"])
        value, derivative = to_alpha(slope[0])
        spread = abs(float(derivative))
        alpha = (float(value), spread * slope[1], spread * slope[2])
        roads[name] = Road(slope, alpha, fit)
    return MapMeasurement(levelled, roads, curves, share_open, notes)


def _window(curve: Curve) -> tuple[float, float]:
    """The default window, ended where a small map has no loops left."""
    low, high = default_window(curve)
    measured = curve.present()
    gone = np.asarray(measured.scale)[np.asarray(measured.mean) <= 0]
    return low, min([high, *(gone[gone > low] * (1 - 1e-9))])


def _fittable(curve: Curve, window: tuple[float, float]) -> Curve | None:
    """The part of a quarter's curve inside the window; None if no line can be put through it."""
    part = curve.window(*window)
    positive = np.asarray(part.mean) > 0
    return part if len(part.scale) >= FEWEST_POINTS and positive.all() else None


def _curves(
    surface: HeightMap, points: int, seed: int
) -> tuple[dict[str, Curve], float, tuple[str, ...]]:
    heights, valid = surface.heights.astype(float), surface.valid
    length, height = surface.length_unit, surface.height_unit
    how = {
        "spacing": surface.spacing,
        "boundary": "open",
        "mask": None if valid.all() else valid,
    }
    loops = trace_loops(heights, points, rng=seed, **how)
    curves = {
        "spectrum": power_spectrum(heights, units=(length, height), **how),
        "curvature_moment": curvature_moment(heights, units=(length, height), **how),
        "mean_length": loops.mean_length().in_units(length, length),
        "length_tail": loops.length_tail().in_units(length, "1"),
    }
    return curves, loops.share_open, loops.notes


def _quarters(surface: HeightMap) -> list[HeightMap]:
    middle = [n // 2 for n in surface.heights.shape]
    return [
        surface.with_heights(np.ascontiguousarray(half))
        for rows in np.split(surface.heights, [middle[0]], 0)
        for half in np.split(rows, [middle[1]], 1)
    ]
