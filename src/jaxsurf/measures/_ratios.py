r"""Ratios of moments, such as a kurtosis, with an honest error over surfaces.

The ratio wanted is that of ensemble means, $R = \langle u \rangle / \langle v \rangle^p$. The
mean of each surface's own ratio is something else: at large scales a surface holds few independent
patches, its v fluctuates, and the mean ratio is biased. The samples kept are therefore the
jackknife's pseudo-values

$$R_i = R + \frac{W - w_i}{w_i} (R - R_{-i}), \qquad W = \sum_i w_i,$$

with $R_{-i}$ the ratio without surface i: their mean is R corrected for its leading bias, their
scatter gives its standard error, and for a linear R they are the surfaces' own values. A single
surface keeps its own ratio. For one ensemble measure it in one call: pseudo-values of separate
batches know only their own batch.

Source: B. Efron, The Jackknife, the Bootstrap and Other Resampling Plans (1982), Ch. 2.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

Samples = Float[Array, "surface scale"]


def ensemble_ratio(upper: Samples, lower: Samples, weight: Samples, power: float) -> Samples:
    """Pseudo-values of <upper>/<lower>^power; zero where the weight or <lower> is zero."""
    total = jnp.sum(weight, 0, keepdims=True)
    sums = [jnp.sum(weight * m, 0, keepdims=True) for m in (upper, lower)]
    whole = _ratio(sums[0], sums[1], total, power)
    rest = total - weight
    without = [s - weight * m for s, m in zip(sums, (upper, lower), strict=True)]
    alone = (rest <= 0) | (weight <= 0)
    left_out = _ratio(without[0], without[1], jnp.where(alone, 1, rest), power)
    factor = jnp.where(alone, 0, rest / jnp.where(alone, 1, weight))
    return jnp.where(weight > 0, whole + factor * (whole - left_out), 0)


def _ratio(upper: Array, lower: Array, total: Array, power: float) -> Array:
    """(upper/total) / (lower/total)^power, zero where `lower` is not positive."""
    safe_total = jnp.where(total > 0, total, 1)
    bad = lower <= 0
    mean_lower = jnp.where(bad, 1, lower / safe_total)
    return jnp.where(bad, 0, upper / safe_total / mean_lower**power)
