r"""The Whittle likelihood of a periodogram, minimised within bounds.

Given expected periodogram $f_k$ at each mode k, independent modes have

$$-\ln p = \sum_k \frac{m_k}{2} \left[\ln f_k + \frac{I_k}{f_k}\right] + \text{const},$$

with $m_k$ the modes of the full zone behind entry k, mirror images counted. On a periodic Gaussian
map this is the exact likelihood. Elsewhere it is a quasi-likelihood: right on average if f is the
exact expectation, with errors from the sandwich $F^{-1} J F^{-1}$ of its curvature
$F = \sum_k \frac{m_k}{2} \nabla\ln f_k \nabla\ln f_k^T$ and the variance J of its gradient.

The one module that uses jaxopt, for its bounded minimiser.

Source: P. Whittle, J. R. Stat. Soc. B 15, 125 (1953).
"""

import dataclasses
import warnings
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxsurf.laws import Law

NOISE = "noise_floor"
STEPS = 40  # of the minimiser in each of its rounds
GRADIENT = 1e-3  # stop where every parameter is within about this many standard errors
SCAN = 3.0  # standard errors to either side over which a parameter with kinks is scanned
SMOOTH = ("alpha", "amplitude", NOISE)  # no kinks in these: no scan


class Model(eqx.Module):
    """A law with some of its fields free, and perhaps a white noise floor.

    Parameters live on a line: positive ones as logarithms, the others, and the noise, as they are.
    """

    law: Law
    noise_scale: Any
    free: tuple[str, ...] = eqx.field(static=True)
    logarithmic: tuple[bool, ...] = eqx.field(static=True)

    def values(self, parameters: Float[Array | np.ndarray, " parameter"]) -> dict[str, Any]:
        """The parameters by name, in their own units."""
        exp = np.exp if isinstance(parameters, np.ndarray) else jnp.exp
        logs = zip(self.free, self.logarithmic, parameters, strict=True)
        values = {name: exp(p) if is_log else p for name, is_log, p in logs}
        if NOISE in values:
            values[NOISE] = values[NOISE] * self.noise_scale
        return values

    def density(self, parameters: Float[Array, " parameter"], q: Any) -> Any:
        """S(q) of the law and the noise at these parameters."""
        values = self.values(parameters)
        noise = values.pop(NOISE, None)
        density = dataclasses.replace(self.law, **values)(q)
        return density if noise is None else density + noise


class AllModes(eqx.Module):
    """A periodic map: the expected periodogram is the law itself, at each distinct |q|."""

    q: Float[Array | np.ndarray, " mode"]
    broadening: float = eqx.field(static=True, default=1.0)  # modes are independent

    def expected(self, density: Any) -> Float[Array, " mode"]:
        """The mean of the periodogram, given S(q) as a function."""
        return density(self.q)

    def rough_spectrum(
        self, periodogram: Float[np.ndarray, "map mode"]
    ) -> Float[np.ndarray, "map mode"]:
        """The periodogram itself, to start from."""
        return periodogram

    def gradient_variances(self, model: Model, found: Any, maps: int) -> list[None]:
        """None: the modes are independent, and the Fisher information is exact."""
        return [None] * len(found.deviance)


class Periodogram(NamedTuple):
    """What a likelihood is made of.

    Attributes:
        q: |q| of each entry.
        periodogram: one row a map.
        multiplicity: modes of the full zone behind each entry.
        observer: gives the expectation from S(q).
        maps: how many maps each row stands for.
    """

    q: Float[np.ndarray, " mode"]
    periodogram: Float[np.ndarray, "map mode"]
    multiplicity: Float[np.ndarray, " mode"]
    observer: Any
    maps: int = 1


class Minimum(eqx.Module):
    """Where the likelihood is largest, for each map.

    Attributes:
        parameters: on the line, see `Model`.
        expected: the expected periodogram there.
        slopes: derivatives of its logarithm by the parameters.
        deviance: the negative log likelihood there, without constants.
        gain: the most it falls a tenth of a standard error away; not positive at a minimum, even
            one at a kink.
    """

    parameters: Float[Array | np.ndarray, "*map parameter"]
    expected: Float[Array | np.ndarray, "*map mode"]
    slopes: Float[Array | np.ndarray, "*map mode parameter"]
    deviance: Float[Array | np.ndarray, "*map"]
    gain: Float[Array | np.ndarray, "*map"]


def minimise(
    model: Model,
    observer: Any,
    periodogram: Float[np.ndarray, "map mode"],
    multiplicity: Float[np.ndarray, " mode"],
    start: Float[np.ndarray, "map parameter"],
    low: Float[np.ndarray, " parameter"],
    high: Float[np.ndarray, " parameter"],
) -> Minimum:
    """Maximise the likelihood of each map, compiled once for all maps of a shape."""
    with warnings.catch_warnings():
        # DESIGN keeps the unmaintained jaxopt for this; its users need not hear of it each time
        warnings.filterwarnings("ignore", "JAXopt is no longer maintained", DeprecationWarning)
        import jaxopt  # noqa: F401  (0.3 s that `import jaxsurf` can spare)
    found = _minimise(model, observer, periodogram, multiplicity, start, low, high)
    return jax.tree.map(np.asarray, found)


@eqx.filter_jit
def _minimise(model, observer, periodogram, multiplicity, start, low, high):
    from jaxopt import LBFGSB

    def expected(parameters):
        return observer.expected(lambda q: model.density(parameters, q))

    def slopes_at(parameters):
        return jax.jacfwd(lambda p: jnp.log(expected(p)))(parameters)

    def covariance(parameters):
        slopes = slopes_at(parameters)
        curvature = slopes.T @ (0.5 * multiplicity[:, None] * slopes)
        diagonal = jnp.diag(curvature)
        unit = 1 / jnp.sqrt(jnp.where(diagonal > 0, diagonal, 1.0))
        correlation = curvature * unit[:, None] * unit
        ridge = 1e-9 * jnp.eye(len(unit))
        return unit, jnp.linalg.inv(correlation + ridge) * unit[:, None] * unit

    def cost(scaled, measured, centre, unit):
        f = expected(centre + unit * scaled)
        return 0.5 * jnp.sum(multiplicity * (jnp.log(f) + measured / f))

    # Backtracking: a zooming line search takes ten times as long to compile and gains nothing here.
    solver = LBFGSB(
        cost,
        maxiter=STEPS,
        tol=GRADIENT,
        linesearch="backtracking",
        maxls=15,
        history_size=5,
        implicit_diff=False,
    )

    scanned = [k for k, name in enumerate(model.free) if name not in SMOOTH]

    def one(arguments):
        measured, begin = arguments

        def run(point):
            unit, _ = covariance(point)
            bounds = ((low - point) / unit, (high - point) / unit)
            found, _ = solver.run(
                jnp.zeros_like(point), bounds=bounds, measured=measured, centre=point, unit=unit
            )
            return jnp.clip(point + unit * found, low, high)

        def at(point):
            return cost(jnp.zeros_like(point), measured, point, jnp.ones_like(point))

        def best(point, others):
            tried = jnp.concatenate([point[None], jnp.clip(others, low, high)])
            values = jax.lax.map(at, tried)
            return tried[jnp.argmin(jnp.where(jnp.isnan(values), jnp.inf, values))]

        def round_(_, point):
            point = run(point)
            for k in scanned:
                _, square = covariance(point)
                along = square[:, k] / jnp.sqrt(square[k, k])  # the others follow to first order
                point = best(point, point + jnp.linspace(-SCAN, SCAN, 25)[:, None] * along)
            return point

        # the second round starts with the right unit of each parameter, the third from the scan
        rounds = 3 if scanned else 2
        point = jax.lax.fori_loop(0, rounds, round_, jnp.clip(begin, low, high))
        unit, _ = covariance(point)
        value = at(point)
        tenths = 0.1 * jnp.concatenate([jnp.diag(unit), -jnp.diag(unit)])
        near = jax.lax.map(at, jnp.clip(point + tenths, low, high))
        return Minimum(point, expected(point), slopes_at(point), value, value - near.min())

    # One map after the other: maps differ in their number of steps, and under vmap each would wait
    # for the slowest and pay for both sides of every branch (measured: a hundred times slower).
    return jax.lax.map(one, (periodogram, start))


def fisher(
    slopes: Float[np.ndarray, "mode parameter"], multiplicity: Float[np.ndarray, " mode"]
) -> Float[np.ndarray, "parameter parameter"]:
    """The curvature of the Whittle likelihood, expected at the parameters."""
    return slopes.T @ (0.5 * multiplicity[:, None] * slopes)
