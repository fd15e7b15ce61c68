"""The one least-squares solver behind every fit: Levenberg-Marquardt in float64.

A fit is a module-level function `residuals(parameters, data)`, already divided by the errors. It is
compiled once for each set of shapes, whatever the numbers, so a loop over windows, sizes or draws
should keep its shapes and put weight zero on what it leaves out.

Source: `optimistix.least_squares`; its implicit derivatives pass through `least_squares`.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Bool, Float, Int

Residuals = Callable[[Any, Any], Float[Array, "..."]]
RTOL, ATOL = 1e-10, 1e-12
CONVERGED = "converged"


class Solution(eqx.Module):
    """Where a least-squares solver stopped; with leading axes if it solved many problems.

    Attributes:
        values: the parameters, in the structure of the starting values.
        chi2: the sum of squared residuals there.
        steps: how many steps it took.
        finished: the solver met its tolerance.
        finite: values and chi2 are finite.
    """

    values: Any
    chi2: Float[Array | np.ndarray, "*problem"]
    steps: Int[Array | np.ndarray, "*problem"]
    finished: Bool[Array | np.ndarray, "*problem"]
    finite: Bool[Array | np.ndarray, "*problem"]

    @property
    def success(self) -> Bool[Array | np.ndarray, "*problem"] | np.bool_:
        """Finished at finite values."""
        return self.finished & self.finite

    @property
    def status(self) -> str:
        """What a `Fit` says of a single problem: "converged", or what happened and what to do."""
        if not bool(self.finite):
            return (
                "failed: the residuals became infinite or NaN. Check the data for zeros and the "
                "starting values for being far off, or narrow the window."
            )
        if not bool(self.finished):
            return (
                f"not converged after {int(self.steps)} steps. Start nearer to the solution, fix a "
                "parameter, or widen the window: the data may not determine all parameters."
            )
        return CONVERGED


def least_squares(
    residuals: Residuals, start: Any, data: Any, *, steps: int = 256, tolerance: float = RTOL
) -> Solution:
    """Minimise the sum of squared `residuals(parameters, data)`; for use under jit, vmap and grad.

    Arguments:
        residuals: parameters, data -> an array of residuals, in standard errors.
        start: starting values, a pytree of arrays.
        data: whatever `residuals` needs, a pytree of arrays.
        steps: give up after so many.
        tolerance: stop when parameters and residuals change by a smaller share than this.

    Returns:
        A `Solution` whose values have implicit derivatives in `data`. It never raises: look at
        `success`.

    Source: Levenberg-Marquardt, `optimistix.LevenbergMarquardt`.
    """
    solver = optx.LevenbergMarquardt(rtol=tolerance, atol=tolerance * ATOL / RTOL)
    found = optx.least_squares(residuals, solver, start, data, max_steps=steps, throw=False)
    chi2 = jnp.sum(residuals(found.value, data) ** 2)
    leaves = [jnp.all(jnp.isfinite(leaf)) for leaf in (*jax.tree.leaves(found.value), chi2)]
    finished = found.result == optx.RESULTS.successful
    return Solution(
        found.value, chi2, jnp.asarray(found.stats["num_steps"]), finished, jnp.stack(leaves).all()
    )


def solve(residuals: Residuals, start: Any, data: Any, *, steps: int = 256) -> Solution:
    """As `least_squares`, compiled, in float64 whatever JAX's settings, with NumPy results.

    Raises:
        ValueError: a starting value that is not finite.
    """
    return _in_float64(_solve_one, residuals, start, data, None, steps)


def solve_many(
    residuals: Residuals, start: Any, data: Any, *, axes: Any = 0, steps: int = 256
) -> Solution:
    """Many problems of one shape at once: `start` has a leading axis, `data` as `axes` says.

    Arguments:
        residuals: as in `least_squares`, for one problem.
        start: starting values, one set a problem.
        data: whatever `residuals` needs.
        axes: the axis of `data` to map over, as in `jax.vmap`; None for what is shared.
        steps: give up after so many.

    Returns:
        A `Solution` with a leading axis.
    """
    return _in_float64(_solve_all, residuals, start, data, _Axes(axes), steps)


class _Axes:
    """A pytree of axes made hashable, to be a static argument."""

    def __init__(self, tree: Any):
        leaves, shape = jax.tree.flatten(tree, is_leaf=lambda leaf: leaf is None)
        self.tree, self._token = tree, (tuple(leaves), shape)

    def __hash__(self) -> int:
        return hash(self._token)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Axes) and self._token == other._token


@partial(jax.jit, static_argnames=("residuals", "axes", "steps"))
def _solve_one(start, data, *, residuals, axes, steps):
    return least_squares(residuals, start, data, steps=steps)


@partial(jax.jit, static_argnames=("residuals", "axes", "steps"))
def _solve_all(start, data, *, residuals, axes, steps):
    one = partial(least_squares, residuals, steps=steps)
    return jax.vmap(one, in_axes=(0, axes.tree))(start, data)


def _in_float64(solver, residuals, start, data, axes, steps) -> Solution:
    start, data = jax.tree.map(_as_float64, (start, data))
    if not all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(start)):
        raise ValueError(f"starting values must be finite; got {start}. Pass other ones.")
    with (
        jax.enable_x64(True),
        jax.numpy_rank_promotion("allow"),
        jax.numpy_dtype_promotion("standard"),
    ):
        found = solver(start, data, residuals=residuals, axes=axes, steps=steps)
        return jax.tree.map(np.asarray, found)


def _as_float64(leaf: Any) -> np.ndarray:
    array = np.asarray(leaf)
    return array.astype(np.float64) if array.dtype.kind == "f" else array
