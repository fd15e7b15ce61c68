r"""The least-squares problem of a collapse: exponents only, the master curves projected out.

Residuals are $W (\ln Y - \sum_k c_k B_k(\ln X))$, W the whitening of the data's errors. At given
exponents the coefficients are linear and `project_out` removes them, so the solver sees two or
three parameters whatever the number of knots.
"""

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jaxsurf.fitting._least_squares import Solution, least_squares
from jaxsurf.fitting._spline import project_out, smoothness_rows, spline_basis
from jaxsurf.fitting.collapse_forms import Transform

#: Points are padded to a multiple of this, so that few shapes are compiled.
PADDING = 64
#: The solver stops when exponents move by less; thousands of times below their errors.
TOLERANCE, STEPS = 1e-6, 100
#: A parameter is part of a direction that the data leave open if it has this share in it.
LARGEST_SHARE = 0.3
CORRECTIONS = ("size", "scale", "both")
SCALES = {"size": ("size",), "scale": ("scale",), "both": ("size", "scale")}


@dataclass(frozen=True)
class CollapseProblem:
    """Residuals(parameters, data); hashable, so that one problem is compiled once.

    Attributes:
        transforms: the scaling form of each measure.
        names: the fitted parameters, in the order of the vector.
        coefficients: of each measure's spline.
        correction: None, or which correction terms stand beside the spline.
    """

    transforms: tuple[Transform, ...]
    names: tuple[str, ...]
    coefficients: int
    correction: str | None

    def __call__(
        self, vector: Float[Array, " parameter"], data: Mapping[str, Any]
    ) -> Float[Array, " row"]:
        """Whitened residuals with the best master curves at these exponents."""
        return self.profile(vector, data)[0]

    def profile(self, vector: Any, data: Mapping[str, Any]) -> tuple[Any, Any, Any, Any]:
        """Residuals, linear coefficients, ln X and ln Y at these exponents."""
        log_X, log_Y = self.scaled(vector, data)
        columns, rows = [], []
        for index in range(len(self.transforms)):
            mine = data["measure"] == index
            basis = spline_basis(log_X, data["use"] & mine, self.coefficients)
            columns.append(jnp.where(mine[:, None], basis, 0.0))
            rows.append(smoothness_rows(self.coefficients))
        omega = vector[self.names.index("omega")] if "omega" in self.names else data["omega"]
        for name in SCALES[self.correction] if self.correction else ():
            term = data[name] ** -omega / data[f"smallest_{name}"] ** -omega
            for index in range(len(self.transforms)):
                columns.append(jnp.where(data["measure"] == index, term, 0.0)[:, None])
        design = data["whitening"] @ jnp.concatenate(columns, 1)
        smooth = jax.scipy.linalg.block_diag(*rows)
        spare = jnp.zeros((smooth.shape[0], design.shape[1] - smooth.shape[1]))
        design = jnp.concatenate([design, jnp.concatenate([smooth, spare], 1)])
        target = jnp.concatenate([data["whitening"] @ log_Y, jnp.zeros(smooth.shape[0])])
        residuals, coefficients = project_out(design, target)
        return residuals, coefficients, log_X, log_Y

    def scaled(self, vector: Any, data: Mapping[str, Any]) -> tuple[Any, Any]:
        """The logarithms of X and Y of every point."""
        values = {name: vector[i] for i, name in enumerate(self.names)}
        log_X, log_Y = jnp.zeros_like(data["log_y"]), jnp.zeros_like(data["log_y"])
        for index, transform in enumerate(self.transforms):
            X, Y = transform(data["scale"], jnp.exp(data["log_y"]), data["size"], values)
            mine = data["measure"] == index
            log_X = jnp.where(mine, jnp.log(jnp.where(mine, X, 1.0)), log_X)
            log_Y = jnp.where(mine, jnp.log(jnp.where(mine, Y, 1.0)), log_Y)
        return log_X, log_Y

    def solve(self, start: np.ndarray, data: Mapping[str, Any]) -> Solution:
        """The best exponents."""
        with float64():
            return jax.tree.map(np.asarray, _solve(self, np.asarray(start), _padded(data)))

    def solve_all(
        self, start: np.ndarray, problems: Iterable[Mapping[str, Any]]
    ) -> tuple[Float[np.ndarray, "draw parameter"], Bool[np.ndarray, " draw"]]:
        """The best exponents of many data sets, and which succeeded.

        One after the other: each stops when it is done, and nothing more is compiled.
        """
        found = [self.solve(start, data) for data in problems]
        return np.stack([f.values for f in found]), np.array([bool(f.success) for f in found])


def _padded(data: Mapping[str, Any]) -> dict[str, Any]:
    """The data with points of no weight, belonging to no measure, at the end."""
    points = len(data["log_y"])
    spare = -points % PADDING
    fills = {"log_y": 0.0, "scale": 1.0, "size": 1.0, "measure": -1, "use": False}
    padded = {**data, "whitening": np.pad(data["whitening"], (0, spare))}
    for name, fill in fills.items():
        padded[name] = np.pad(data[name], (0, spare), constant_values=fill)
    return padded


@contextmanager
def float64() -> Iterator[None]:
    """Float64 under any JAX settings of the caller's; also a decorator."""
    with (
        jax.enable_x64(True),
        jax.numpy_rank_promotion("allow"),
        jax.numpy_dtype_promotion("standard"),
    ):
        yield


@float64()
def profile(problem: CollapseProblem, vector: Any, data: Mapping[str, Any]) -> Any:
    """`CollapseProblem.profile` compiled, with NumPy results."""
    residuals, coefficients, log_X, log_Y = _profile(problem, vector, _padded(data))
    points = len(data["log_y"])
    return tuple(
        np.asarray(part) for part in (residuals, coefficients, log_X[:points], log_Y[:points])
    )


@float64()
def covariance(problem: CollapseProblem, vector: Any, data: Mapping[str, Any]) -> np.ndarray:
    """The covariance of the exponents if the whitening is right: the inverse of J^T J."""
    slope = np.asarray(_jacobian(problem, vector, _padded(data)))
    return np.linalg.pinv(slope.T @ slope)


@float64()
def undetermined(
    problem: CollapseProblem, vector: np.ndarray, data: Mapping[str, Any]
) -> Bool[np.ndarray, " parameter"]:
    """Which parameters may change by themselves, or by one, without a change in chi2 of one.

    Such a parameter stays where it started, in every refit, so that neither the solver nor the
    spread of refits can tell.
    """
    size = np.maximum(1.0, np.abs(vector))
    slope = np.asarray(_jacobian(problem, vector, _padded(data))) * size[None, :]
    curvature, direction = np.linalg.eigh(slope.T @ slope)
    loose = curvature < 1.0
    return np.asarray((np.abs(direction[:, loose]) > LARGEST_SHARE).any(1))


@float64()
def slopes(problem: CollapseProblem, vector: Any, data: Mapping[str, Any]) -> np.ndarray:
    """D ln Y / d ln y of every point."""
    return np.asarray(_slopes(problem, vector, _padded(data)))[: len(data["log_y"])]


@float64()
def master_curve(u: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
    """Y of the spline with these coefficients, spread over the range of u = ln X."""
    use = jnp.ones(len(u), bool)
    return np.exp(np.asarray(spline_basis(jnp.asarray(u), use, len(coefficients))) @ coefficients)


@partial(jax.jit, static_argnums=0)
def _solve(problem: CollapseProblem, start: Any, data: Mapping[str, Any]) -> Solution:
    return least_squares(problem, start, data, steps=STEPS, tolerance=TOLERANCE)


@partial(jax.jit, static_argnums=0)
def _profile(problem: CollapseProblem, vector: Any, data: Mapping[str, Any]) -> Any:
    return problem.profile(vector, data)


@partial(jax.jit, static_argnums=0)
def _jacobian(problem: CollapseProblem, vector: Any, data: Mapping[str, Any]) -> Any:
    return jax.jacfwd(lambda v: problem(v, data))(vector)


@partial(jax.jit, static_argnums=0)
def _slopes(problem: CollapseProblem, vector: Any, data: Mapping[str, Any]) -> Any:
    def scaled(log_y: Any) -> Any:
        return problem.scaled(vector, {**data, "log_y": log_y})[1]

    return jax.jvp(scaled, (data["log_y"],), (jnp.ones_like(data["log_y"]),))[1]
