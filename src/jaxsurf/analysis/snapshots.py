"""Many looks at one growing surface make one sample, not many.

Snapshots of a run are correlated in time, so an error may only be taken between independent runs.
A curve measured on all snapshots of all runs is pooled here into one row a run.
"""

from collections.abc import Sequence

import numpy as np

from jaxsurf._checks import check_integer
from jaxsurf.curve import Curve


def pool_snapshots(curves: Curve | Sequence[Curve], surfaces: int) -> Curve:
    """One row a surface out of the rows of its snapshots, by their weighted mean.

    Arguments:
        curves: one curve, or several at the same scales, whose rows are snapshots of surfaces: row
            i belongs to surface i modulo `surfaces`, as in heights `[snapshot, surface, x, y]`.
        surfaces: how many independent surfaces there are.

    Returns:
        A `Curve` of kind, units and details of the first, in float64.

    Raises:
        ValueError: rows that are not a whole number of snapshots; curves at different scales.
    """
    several = [curves] if isinstance(curves, Curve) else list(curves)
    check_integer("surfaces", surfaces, low=1, remedy="Pass how many runs there were.")
    first = several[0]
    scale = np.asarray(first.scale, float)
    samples, weights = [], []
    for curve in several:
        if curve.surfaces % surfaces:
            raise ValueError(
                f"rows must be snapshots times surfaces; got {curve.surfaces} rows for {surfaces} "
                "surfaces. Measure every snapshot of every surface."
            )
        if curve.scale.shape != scale.shape or not np.allclose(np.asarray(curve.scale), scale):
            raise ValueError(
                f"curves to pool must share their scales; got {first!r} and {curve!r}. "
                "Measure all of them at the same scales."
            )
        shape = (-1, surfaces, len(scale))
        samples.append(np.asarray(curve.samples, float).reshape(shape))
        weights.append(np.asarray(curve.weights, float).reshape(shape))
    y, w = np.concatenate(samples), np.concatenate(weights)
    total = w.sum(0)
    mean = (w * y).sum(0) / np.where(total > 0, total, 1.0)
    return Curve(first.kind, scale, mean, total, units=first.units, details=first.details)
