r"""The crossover's model: its parameters, their values, and the solver.

See `crossover` for the equations. Lengths, amplitudes and the sharpness n are fitted by their
logarithms, so no parameter has a bound. The curvature variance follows exactly from a spectrum with
a knee, so it is not given a knee of its own but summed over the map's modes.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxsurf import _grid, theory
from jaxsurf.curve import Curve
from jaxsurf.fitting._collapse_solve import float64
from jaxsurf.fitting._least_squares import Solution, least_squares

#: ln n is given a pull towards ln 4 with this error: nothing where data show the knee's shape, but
#: a corner, which no n is sharp enough for, does not run off to infinity.
TYPICAL_SHARPNESS, SHARPNESS_ERROR = 4.0, 3.0
#: A sharp knee makes a long narrow valley: many steps, each cheap. The tolerance is hundreds of
#: times below the errors.
STEPS, TOLERANCE = 800, 1e-5
#: Bins of wave number for the lattice sums: S varies little within.
_Q_RATIO = 1.01
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
            "log_xi[mean_length]"), and for each measure its log amplitude, log sharpness, beyond.
        on_lattice: measures computed from the spectrum by `curvature_kernel`.
    """

    kinds: tuple[str, ...]
    names: tuple[str, ...]
    on_lattice: tuple[str, ...] = ()

    def __call__(self, vector: Float[Array, " parameter"], data: Mapping[str, Any]) -> Any:
        """Whitened residuals, and those of the sharpness from its typical value."""
        residuals = data["whitening"] @ (data["log_y"] - self.log_y(vector, data))
        shapes = [i for i, name in enumerate(self.names) if name.startswith("log_sharpness")]
        pull = (vector[np.array(shapes, int)] - np.log(TYPICAL_SHARPNESS)) / SHARPNESS_ERROR
        return jnp.concatenate([residuals, pull])

    def log_y(self, vector: Any, data: Mapping[str, Any]) -> Any:
        """Logarithm of the model at each point."""
        found = jnp.zeros_like(data["log_y"])
        for index, kind in enumerate(self.kinds):
            below, beyond, log_knee, blunt, amplitude = self.bend(kind, vector, data)
            if kind in self.on_lattice:  # below and beyond are those of S, summed over modes
                modes = _bent(data["log_mode"], below, beyond, log_knee, blunt)
                top = jnp.max(modes)
                mine = amplitude + top + jnp.log(data["kernel"] @ jnp.exp(modes - top))
            else:
                mine = amplitude + _bent(data["log_v"], below, beyond, log_knee, blunt)
            if (correction := self.value("correction", kind, vector)) is not None:
                mine += correction * jnp.exp(data["log_above"] * -data["omega"][index])
            found = jnp.where(data["measure"] == index, mine, found)
        return found

    def value(self, name: str, kind: str, vector: Any, default: Any = None) -> Any:
        """A parameter of one measure, its own or the shared one."""
        for candidate in (f"{name}[{kind}]", name):
            if candidate in self.names:
                return vector[self.names.index(candidate)]
        return default

    def bend(self, kind: str, vector: Any, data: Mapping[str, Any]) -> tuple[Any, ...]:
        """Exponents below and beyond, log knee, 1/n and log amplitude of one measure."""
        alpha = self.value("alpha", kind, vector, 0.0)
        log_knee = self.value("log_xi", kind, vector)
        below = BELOW["spectrum" if kind in self.on_lattice else kind](alpha)
        if kind == "length_tail":
            log_knee = log_knee * theory.fractal_dimension(alpha)
            log_knee += self.value("log_amplitude", "mean_length", vector, 0.0)
        log_knee += data["log_ratio"][self.kinds.index(kind)]
        blunt = jnp.exp(-self.value("log_sharpness", kind, vector, data["log_sharpness"]))
        beyond = self.value("beyond", kind, vector, BEYOND.get(kind, 0.0))
        return below, beyond, log_knee, blunt, self.value("log_amplitude", kind, vector)


def _bent(log_v: Any, below: Any, beyond: Any, log_knee: Any, blunt: Any) -> Any:
    """Logarithm of v^below [1 + (v / knee)^n]^((beyond - below)/n), with 1/n the bluntness."""
    return below * log_v + (beyond - below) * blunt * jnp.logaddexp(0.0, (log_v - log_knee) / blunt)


def curvature_kernel(
    curve: Curve, scales: Float[np.ndarray, " scale"]
) -> tuple[Float[np.ndarray, " mode"], Float[np.ndarray, "scale mode"]] | None:
    r"""What each ring of wave numbers adds to the curvature variance on the map's lattice.

    $$\langle C_b^2\rangle = \frac1A \sum_q S(q) \left[4 - 2\cos(b\, q\cdot e_1) -
      2\cos(b\, q\cdot e_2)\right]^2$$

    Returns:
        Ring radii as v = pi/q, and the matrix that takes S on the rings to the variance; None if
        the curve does not know its map's side or direction.
    """
    side, direction = curve.detail("side"), curve.detail("direction")
    if curve.kind != "curvature_moment" or side is None or direction not in ("10", "11"):
        return None
    step = np.sqrt(2.0) if direction == "11" else 1.0
    spacing = curve.detail("spacing") or float(np.asarray(curve.scale)[0]) / step
    shape = (round(side / spacing),) * 2
    q_x, q_y = _grid.wave_numbers(shape, spacing)
    q = np.hypot(q_x, q_y).ravel()
    multiplicity = np.broadcast_to(_grid.mode_multiplicity(shape), (shape[0], q_y.size)).ravel()
    ring = np.zeros(len(q), int)
    ring[1:] = 1 + np.floor(np.log(q[1:] / q[1:].min()) / np.log(_Q_RATIO)).astype(int)
    _, ring = np.unique(ring, return_inverse=True)
    ring = ring - 1  # the zero mode is no ring
    count = np.bincount(ring[1:], multiplicity[1:])
    log_q = np.bincount(ring[1:], (multiplicity * np.log(np.where(q > 0, q, 1.0)))[1:]) / count
    rows = []
    for b in scales / step:
        if direction == "10":
            sums = 2 * np.cos(b * q_x) + 2 * np.cos(b * q_y)
        else:
            sums = 4 * np.cos(b * q_x) * np.cos(b * q_y)
        kernel = (multiplicity * ((4 - sums) ** 2).ravel())[1:]
        rows.append(np.bincount(ring[1:], kernel) / side**2)
    return np.log(np.pi) - log_q, np.array(rows)


def solve(model: CrossoverModel, start: np.ndarray, data: Mapping[str, Any]) -> Solution:
    """The best parameters, compiled, in float64, with NumPy results."""
    with float64():
        return jax.tree.map(np.asarray, _solve(model, start, dict(data)))


@float64()
def log_y(model: CrossoverModel, vector: np.ndarray, data: Mapping[str, Any]) -> np.ndarray:
    """`CrossoverModel.log_y` compiled, with NumPy results."""
    return np.asarray(_log_y(model, vector, dict(data)))


@float64()
def log_knee(
    model: CrossoverModel, kind: str, vector: np.ndarray, data: Mapping[str, Any]
) -> float:
    """Logarithm of the scale v at the knee of one measure."""
    return float(model.bend(kind, vector, data)[2])


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
        else:
            slope = 1.0
        names.append(name.removeprefix("log_"))
        values.append(number)
        slopes.append(slope)
    return tuple(names), np.array(values), np.array(slopes)


@partial(jax.jit, static_argnums=0)
def _solve(model: CrossoverModel, start: Any, data: Mapping[str, Any]) -> Solution:
    return least_squares(model, start, data, steps=STEPS, tolerance=TOLERANCE)


@partial(jax.jit, static_argnums=0)
def _log_y(model: CrossoverModel, vector: Any, data: Mapping[str, Any]) -> Any:
    return model.log_y(vector, data)


@partial(jax.jit, static_argnums=0)
def _covariance(model: CrossoverModel, vector: Any, data: Mapping[str, Any]) -> Any:
    jacobian = jax.jacfwd(lambda v: model(v, data))(vector)
    return jnp.linalg.pinv(jacobian.T @ jacobian, hermitian=True)
