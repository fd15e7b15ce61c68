r"""The crossover's model: its parameters, their values, and the solver.

See `crossover` for the equations. Lengths, amplitudes and sharpness are fitted by their logarithms
(the sharpness between two bounds), so that no step of the solver makes them negative.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxsurf import theory
from jaxsurf.fitting._collapse_solve import float64
from jaxsurf.fitting._least_squares import Solution, least_squares

#: Sharpness runs between these; at the upper end the knee is a corner to the eye.
BLUNTEST, SHARPEST = 0.3, 30.0
#: Kinds whose exponent below the knee depends on alpha, and how (in v, growing with length).
BELOW = {
    "mean_length": theory.fractal_dimension,
    "length_tail": lambda alpha: -theory.length_tail_exponent(alpha),
    "loop_correlation": lambda alpha: -2 * theory.LOOP_CORRELATION + 0 * alpha,
    "spectrum": lambda alpha: 2 + 2 * alpha,
    "curvature_moment": lambda alpha: 2 * alpha,
    "height_correlation": lambda alpha: 2 * alpha,
    "patch_moment": lambda alpha: 2 * alpha,
}
BEYOND = {
    "mean_length": theory.PERCOLATION.fractal_dimension,
    "length_tail": 2 - theory.PERCOLATION.length_exponent,
    "loop_correlation": -2 * theory.PERCOLATION.correlation_exponent,
}


@dataclass(frozen=True)
class CrossoverModel:
    """Residuals(parameters, data) of a set of measures; hashable, compiled once.

    Attributes:
        kinds: the measures, in the order of the stack.
        names: the parameters, in the order of the vector: "alpha", "log_xi" (or one a measure, as
            "log_xi[mean_length]"), and for each measure its log amplitude, sharpness, beyond.
    """

    kinds: tuple[str, ...]
    names: tuple[str, ...]

    def __call__(self, vector: Float[Array, " parameter"], data: Mapping[str, Any]) -> Any:
        """Whitened residuals."""
        return data["whitening"] @ (data["log_y"] - self.log_y(vector, data))

    def log_y(self, vector: Any, data: Mapping[str, Any]) -> Any:
        """Logarithm of the model at each point."""
        found = jnp.zeros_like(data["log_y"])
        for index, kind in enumerate(self.kinds):
            below, beyond, log_knee, sharpness, amplitude = self._measure(kind, vector, data)
            u = data["log_v"] - log_knee
            mine = amplitude + below * data["log_v"]
            mine += (beyond - below) / sharpness * jnp.logaddexp(0.0, sharpness * u)
            found = jnp.where(data["measure"] == index, mine, found)
        return found

    def _measure(self, kind: str, vector: Any, data: Mapping[str, Any]) -> tuple[Any, ...]:
        def value(name: str, default: Any = None) -> Any:
            for candidate in (f"{name}[{kind}]", name):
                if candidate in self.names:
                    return vector[self.names.index(candidate)]
            return default

        alpha, log_knee = value("alpha", 0.0), value("log_xi")
        below = BELOW[kind](alpha)
        if kind == "length_tail":
            amplitude = 0.0
            if "log_amplitude[mean_length]" in self.names:
                amplitude = vector[self.names.index("log_amplitude[mean_length]")]
            log_knee = log_knee * theory.fractal_dimension(alpha) + amplitude
        shape = value("shape")
        sharpness = data["sharpness"] if shape is None else _sharpness(shape)
        beyond = value("beyond", BEYOND.get(kind, 0.0))
        return below, beyond, log_knee, sharpness, value("log_amplitude")


def solve(model: CrossoverModel, start: np.ndarray, data: Mapping[str, Any]) -> Solution:
    """The best parameters, compiled, in float64, with NumPy results."""
    with float64():
        return jax.tree.map(np.asarray, _solve(model, start, dict(data)))


@float64()
def log_y(model: CrossoverModel, vector: np.ndarray, data: Mapping[str, Any]) -> np.ndarray:
    """`CrossoverModel.log_y` compiled, with NumPy results."""
    return np.asarray(_log_y(model, vector, dict(data)))


@float64()
def covariance(model: CrossoverModel, vector: np.ndarray, data: Mapping[str, Any]) -> np.ndarray:
    """The covariance of the parameters if the whitening is right: the inverse of J^T J."""
    return np.asarray(_covariance(model, vector, dict(data)))


def reported(
    model: CrossoverModel, vector: np.ndarray
) -> tuple[tuple[str, ...], np.ndarray, np.ndarray]:
    """Names, values and derivatives of what is reported: xi and amplitudes themselves."""
    names, values, slopes = [], [], []
    for name, number in zip(model.names, vector, strict=True):
        if name.startswith("log_"):
            number = np.exp(number)
            slope = number
        elif name.startswith("shape"):
            with float64():
                before, number = number, float(_sharpness(number))
            share = 1 / (1 + np.exp(-before))
            slope = number * np.log(SHARPEST / BLUNTEST) * share * (1 - share)
        else:
            slope = 1.0
        names.append(name.removeprefix("log_").replace("shape", "sharpness"))
        values.append(number)
        slopes.append(slope)
    return tuple(names), np.array(values), np.array(slopes)


def _sharpness(shape: Any) -> Any:
    """Sharpness from an unbounded number: logistic in ln n."""
    low, high = np.log(BLUNTEST), np.log(SHARPEST)
    return jnp.exp(low + (high - low) / (1 + jnp.exp(-shape)))


@partial(jax.jit, static_argnums=0)
def _solve(model: CrossoverModel, start: Any, data: Mapping[str, Any]) -> Solution:
    return least_squares(model, start, data, steps=200, tolerance=1e-7)


@partial(jax.jit, static_argnums=0)
def _log_y(model: CrossoverModel, vector: Any, data: Mapping[str, Any]) -> Any:
    return model.log_y(vector, data)


@partial(jax.jit, static_argnums=0)
def _covariance(model: CrossoverModel, vector: Any, data: Mapping[str, Any]) -> Any:
    jacobian = jax.jacfwd(lambda v: model(v, data))(vector)
    return jnp.linalg.pinv(jacobian.T @ jacobian, hermitian=True)
