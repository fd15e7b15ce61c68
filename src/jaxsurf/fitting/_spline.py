r"""The master curve of a collapse: a cubic spline in log-log, linear in its coefficients.

Uniform cubic B-splines $\beta_3$ over the range of $u = \ln X$, so that $\ln Y = \sum_k c_k
\beta_3(t - k + 1)$ with $t$ running from 0 to the number of intervals. For given exponents the
$c_k$ follow by linear least squares; `project_out` removes them exactly, which leaves a
least-squares problem in the exponents alone (variable projection; Golub & Pereyra 1973).
"""

import jax.numpy as jnp
from jax.scipy.linalg import cho_factor, cho_solve
from jaxtyping import Array, Bool, Float

#: Weight of the second differences of the coefficients: it only decides what the data leave open.
RIDGE = 1e-4
#: Added to the normal matrix, whose diagonal is one.
TINY = 1e-13


def spline_basis(
    u: Float[Array, " point"], use: Bool[Array, " point"], coefficients: int
) -> Float[Array, "point coefficient"]:
    """Cubic B-splines at `u`, spread evenly between the smallest and largest `u` in use."""
    low = jnp.min(jnp.where(use, u, jnp.inf))
    high = jnp.max(jnp.where(use, u, -jnp.inf))
    t = (jnp.clip(u, low, high) - low) / (high - low) * (coefficients - 3)
    distance = jnp.abs(t[:, None] - jnp.arange(-1.0, coefficients - 1.0)[None, :])
    near = 2 / 3 - distance**2 + distance**3 / 2
    far = jnp.clip(2 - distance, 0.0, None) ** 3 / 6
    return jnp.where(distance < 1, near, far)


def smoothness_rows(coefficients: int) -> Float[Array, "row coefficient"]:
    """Second differences of the coefficients, scaled by `RIDGE`."""
    identity = jnp.eye(coefficients)
    return RIDGE * (identity[2:] - 2 * identity[1:-1] + identity[:-2])


def project_out(
    design: Float[Array, "row coefficient"], target: Float[Array, " row"]
) -> tuple[Float[Array, " row"], Float[Array, " coefficient"]]:
    """The part of `target` no combination of the design's columns can reach, and the best one."""
    length = jnp.sqrt(jnp.sum(design**2, 0) + 1e-30)
    columns = design / length[None, :]
    # Normal equations of columns of length one: a sixth of the time of a QR with its derivative
    # here, and the same answer to rounding, since the smoothness rows keep them well conditioned.
    matrix = columns.T @ columns + TINY * jnp.eye(columns.shape[1])
    amount = cho_solve(cho_factor(matrix), columns.T @ target)
    return target - columns @ amount, amount / length
