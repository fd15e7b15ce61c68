"""Where the likelihood starts: the best of a coarse grid on a binned periodogram.

The likelihood of a law with a cutoff and a noise floor has more than one maximum. A grid over the
law's shape, with the amplitude that suits each, is cheap on a few dozen bins and ends near the
right one.
"""

import dataclasses
from itertools import product
from typing import Any

import jax
import numpy as np
from jaxtyping import Float, Int

from jaxsurf.laws import Law

BINS = 40
ALPHAS = np.arange(-0.8, 1.9, 0.2)
NOISE_SHARES = (0.0, 0.3, 0.8)  # of the spectrum at its short-wave end


def bins_of(
    q: Float[np.ndarray, " mode"], multiplicity: Float[np.ndarray, " mode"], fewest: float
) -> Int[np.ndarray, " mode"]:
    """Bins of |q|, equal in its logarithm and merged until each holds `fewest` modes."""
    edges = np.geomspace(q.min() * (1 - 1e-9), q.max() * (1 + 1e-9), BINS + 1)
    raw = np.clip(np.searchsorted(edges, q, side="right") - 1, 0, BINS - 1)
    count = np.bincount(raw, multiplicity, minlength=BINS)
    label, held, current = np.zeros(BINS, int), 0.0, 0
    for k in range(BINS):
        label[k] = current
        held += count[k]
        if held >= fewest and count[k + 1 :].sum() >= fewest:
            current, held = current + 1, 0.0
    return label[raw]


@jax.jit
def _densities(law: Law, shapes: dict[str, Any], q: Any) -> Any:
    """S(q) of the law with each set of values in place of its own, `[set, bin]`."""
    if not shapes:
        return law(q)[None]
    return jax.vmap(lambda values: dataclasses.replace(law, **values)(q))(shapes)


def start(
    law: Law,
    free: tuple[str, ...],
    bounds: dict[str, tuple[float, float]],
    q: Float[np.ndarray, " mode"],
    periodogram: Float[np.ndarray, "map mode"],
    multiplicity: Float[np.ndarray, " mode"],
    noise_name: str,
) -> list[dict[str, float]]:
    """Starting values by name, for each map."""
    bins = bins_of(q, multiplicity, 8.0)
    weight = np.bincount(bins, multiplicity)
    centre = np.exp(np.bincount(bins, multiplicity * np.log(q)) / weight)
    measured = np.stack([np.bincount(bins, multiplicity * row) / weight for row in periodogram])
    grids: dict[str, Any] = {}
    if "alpha" in free:
        low, high = bounds["alpha"]
        grids["alpha"] = np.append(ALPHAS[(ALPHAS > low) & (ALPHAS < high)], float(law.alpha))  # pyright: ignore[reportAttributeAccessIssue]
    if "cutoff" in free:
        low, high = bounds["cutoff"]
        grids["cutoff"] = np.append(np.geomspace(low * 1.1, high / 1.1, 10), float(law.cutoff))  # pyright: ignore[reportAttributeAccessIssue]
    shapes = [dict(zip(grids, values, strict=True)) for values in product(*grids.values())]
    stacked = {name: np.array([shape[name] for shape in shapes], float) for name in grids}
    with jax.enable_x64(True):
        densities = np.asarray(_densities(jax.tree.map(np.float64, law), stacked, centre))
    found: list[dict[str, float]] = [{} for _ in measured]
    lowest = np.full(len(measured), np.inf)
    top = measured[:, -3:].mean(1, keepdims=True)
    for share in NOISE_SHARES if noise_name in free else (0.0,):
        noise = share * top
        for shape, density in zip(shapes, densities, strict=True):
            scale = np.ones((len(measured), 1))
            if "amplitude" in free:
                signal = np.where(density > density[-1] * 2, 1.0, 0.2) * weight
                part = np.clip(measured - noise, 0.05 * measured, None) / density
                scale = np.exp((signal * np.log(part)).sum(1, keepdims=True) / signal.sum())
            total = scale * density + noise
            cost = (weight * (np.log(total) + measured / total)).sum(1)
            for k in np.flatnonzero(cost < lowest):
                found[k] = (
                    shape
                    | {name: float(getattr(law, name)) for name in free if hasattr(law, name)}
                    | shape
                )
                if "amplitude" in free:
                    found[k]["amplitude"] = float(law.amplitude) * float(scale[k, 0])  # pyright: ignore[reportAttributeAccessIssue]
                if noise_name in free:
                    found[k][noise_name] = float(noise[k, 0])
            lowest = np.minimum(lowest, cost)
    return found
