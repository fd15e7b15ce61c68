"""The windows of a crossover fit: which scales it uses, and what other windows say.

A fit through a knee must see the knee. So a refit to fewer scales counts for a measure only if the
measure's knee is still among them; extrapolated knees scatter over orders of magnitude.
"""

from typing import Any, NamedTuple

import numpy as np

from jaxsurf.curve import Curve
from jaxsurf.fitting import _crossover_model as solver
from jaxsurf.fitting._collapse_data import Stack, systematic_errors
from jaxsurf.fitting._crossover_model import CrossoverModel

#: kind -> window in units of L (lengths R, b, r: low in sites, high in L); s and q follow.
_LOW = {"mean_length": 5.0, "loop_correlation": 3.0}
_HIGH = {"mean_length": 0.2, "loop_correlation": 0.1}
#: Refits leave out this share of each curve's range, in the logarithm of the scale.
LEFT_OUT = 0.2


class Varied(NamedTuple):
    """What refits to fewer scales found.

    Attributes:
        systematic: parameter -> shift beyond chance; absent if no refit saw the knee it needs.
        values: refit -> parameter -> value.
        notes: which knees a refit lost.
    """

    systematic: dict[str, float]
    values: dict[str, dict[str, float]]
    notes: tuple[str, ...]


def default_window(curve: Curve) -> tuple[float, float]:
    """From a few sites to a share of the map's side, where curves say how wide the map is."""
    side = curve.detail("side")
    first, last = float(curve.scale[0]), float(curve.scale[-1])
    if side is None:
        return first, last
    if curve.kind == "spectrum":
        return 3 * np.pi / side, last / 4
    if curve.kind == "length_tail":
        return 5 * first, 1.5 * side
    return max(_LOW.get(curve.kind, 3.0) * first, first), _HIGH.get(curve.kind, 0.25) * side


def used_windows(stack: Stack, kinds: tuple[str, ...]) -> dict[str, tuple[float, float]]:
    """Smallest and largest scale in use of each measure."""
    return {
        kind: (
            float(stack.x[stack.measure == index].min()),
            float(stack.x[stack.measure == index].max()),
        )
        for index, kind in enumerate(kinds)
    }


def out_of_sight(
    model: CrossoverModel, vector: np.ndarray, data: dict[str, Any], use: np.ndarray
) -> list[str]:
    """The measures whose knee is not between the smallest and the largest scale in use."""
    lost = []
    for index, kind in enumerate(model.kinds):
        seen = data["log_v"][use & (data["measure"] == index)]
        if not seen.min() < solver.log_knee(model, kind, vector, data) < seen.max():
            lost.append(kind)
    return lost


def vary_windows(
    model: CrossoverModel,
    stack: Stack,
    data: dict[str, Any],
    best: np.ndarray,
    slopes: np.ndarray,
) -> Varied:
    """Refit without the smallest and without the largest scales of every curve.

    What a refit says of a measure whose knee it lost is left out, and all of a refit without knees.

    Arguments:
        model: the fitted model.
        stack: its points.
        data: what its residuals need.
        best: the fitted parameters.
        slopes: derivatives of the reported values, from `solver.reported`.
    """
    own = np.diag(solver.covariance(model, best, data))
    names, reported, _ = solver.reported(model, best)
    position = stack.position()
    variants, values, notes = [], {}, []
    seen = {name: False for name in names}
    for end, use in (
        ("smallest", position >= LEFT_OUT),
        ("largest", position <= 1 - LEFT_OUT),
    ):
        if use.sum() <= len(best):
            continue
        varied = {**data, "whitening": stack.whitening(use, np.ones(len(stack.x)))}
        found = solver.solve(model, best, varied)
        lost = out_of_sight(model, found.values, data, use)
        if not found.success or len(lost) == len(model.kinds):
            continue
        spread = np.diag(solver.covariance(model, found.values, varied))
        excess = np.clip(spread - own, 0.0, None) * slopes**2
        blind = np.array([any(name.endswith(f"[{kind}]") for kind in lost) for name in names])
        at = solver.reported(model, found.values)[1]
        title = f"without the {end} scales"
        variants.append((title, np.where(blind, reported, at), excess))
        values[title] = {n: float(v) for n, v, b in zip(names, at, blind, strict=True) if not b}
        seen = {n: seen[n] or not b for n, b in zip(names, blind, strict=True)}
        if lost:
            notes.append(f"{title} the knee of {', '.join(lost)} is lost and its refit left out")
    systematic = systematic_errors(variants, names, reported)
    return Varied({n: v for n, v in systematic.items() if seen[n]}, values, tuple(notes))
