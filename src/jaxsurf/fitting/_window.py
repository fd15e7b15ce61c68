r"""Where a measure scales: the default window of a straight-line fit.

Near the lattice spacing the grid shows, near the side of the map its finite size does; between them
a self-affine surface has its power law. Where to stop is a choice, so each fit reports its window
and how the answer moves over it.
"""

from dataclasses import dataclass

import numpy as np

from jaxsurf.curve import Curve

WAVE_KINDS = ("spectrum", "directional_spectrum", "line_spectrum")
NARROWEST = 4.0  # a window spans at least this ratio where the map allows it


@dataclass(frozen=True)
class _Rule:
    """From `low` sites to `high` times the side of the map."""

    low: float
    high: float
    first: float = 1.0  # the smallest scale of the measure, in sites: how the spacing is known


#: kind -> rule; other kinds measured at a separation have DEFAULT.
RULES = {
    "mean_length": _Rule(10.0, 0.2),  # the paper's 10 < R < 100 at L = 512
    "length_tail": _Rule(20.0, 0.4, 4.0),  # steps: loops of radius near 5 sites to 0.1 L
    "loop_correlation": _Rule(4.0, 0.08),
}
DEFAULT = _Rule(4.0, 0.125)


def default_window(curve: Curve) -> tuple[float, float]:
    """The window that a fit of this curve takes if none is given, in the scale's unit.

    Real-space measures start a few sites above the lattice and end well below the side of the map;
    spectra take wavelengths from 8 sites to half the side. On small maps the lower end gives way,
    so that the window spans a factor of 4.
    """
    scale = np.asarray(curve.scale, float)[~np.asarray(curve.missing)]
    if len(scale) == 0:
        return 0.0, np.inf
    side = curve.detail("side")
    if curve.kind in WAVE_KINDS:
        lowest = 4 * np.pi / side if side else 2 * scale[0]
        highest = scale[-1] / 4
        return float(lowest), float(max(highest, min(NARROWEST * lowest, scale[-1])))
    rule = RULES.get(curve.kind, DEFAULT)
    in_sites = curve.units[0] in ("sites", "steps")
    spacing = curve.detail("spacing") or (1.0 if in_sites else scale[0] / rule.first)
    high = rule.high * side if side else scale[-1]
    return float(max(min(rule.low * spacing, high / NARROWEST), scale[0])), float(high)
