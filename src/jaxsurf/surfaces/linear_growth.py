r"""Linear growth from a flat start, solved exactly mode by mode: a control for growth analyses.

$$\partial_t h = -\nu (-\nabla^2)^{z/2} h + \eta, \qquad
  \langle \eta(x,t)\, \eta(x',t') \rangle = 2 D\, \delta(x - x')\, \delta(t - t')$$

Edwards-Wilkinson growth (evaporation, gravity) has z = 2 and Mullins-Herring growth (surface
diffusion) z = 4. Every Fourier mode is an Ornstein-Uhlenbeck process of its own, so at time t the
surface is Gaussian with

$$S(q, t) = \frac{D}{\nu |q|^z} \left(1 - e^{-2\nu |q|^z t}\right),$$

self-affine with $\alpha = (z - 2)/2$, 0 or 1, up to $\xi(t) = (2\nu t)^{1/z}$ and flat beyond: the
dynamic exponent is exact, and no time step is made that is not exact.

Source: the paper's Sec. IV F, Eqs. (dynamical), (hcross); S. F. Edwards and D. R. Wilkinson, Proc.
R. Soc. Lond. A 381, 17 (1982); W. W. Mullins, J. Appl. Phys. 28, 333 (1957).
"""

from collections.abc import Iterable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float, Key, Num

from jaxsurf import _grid
from jaxsurf._checks import (
    check_choice,
    check_in_range,
    check_integer,
    check_key,
    check_shape,
    check_spacing,
)
from jaxsurf.laws import Law
from jaxsurf.surfaces.gaussian import _random_modes

#: Equation -> its dynamic exponent z.
EQUATIONS = {"edwards-wilkinson": 2, "mullins-herring": 4}


class LinearGrowth(Law):
    r"""Spectrum of a linearly growing surface, $S = D (1 - e^{-2\nu|q|^z t}) / (\nu |q|^z)$.

    Arguments:
        time: t > 0 since the flat start; infinity for the stationary surface.
        dynamic_exponent: z > 0; 2 is Edwards-Wilkinson, 4 Mullins-Herring.
        coefficient: nu > 0, in length^z / time.
        noise: D > 0, in height^2 length^2 / time.

    Raises:
        ValueError: an argument outside its range.

    >>> import jax.numpy as jnp
    >>> law = LinearGrowth(time=jnp.inf, dynamic_exponent=4.0)
    >>> float(law(2.0))
    0.0625
    """

    time: ArrayLike
    dynamic_exponent: ArrayLike = 2.0
    coefficient: ArrayLike = 1.0
    noise: ArrayLike = 1.0

    def __check_init__(self):
        for name in ("time", "dynamic_exponent", "coefficient", "noise"):
            check_in_range(
                name,
                getattr(self, name),
                0.0,
                np.inf,
                closed=(False, name == "time"),
                remedy="Growth starts flat at time 0 and goes on for a positive time.",
            )

    def __call__(self, q: Any) -> Any:
        """S(q) at wave numbers q > 0, in height^2 length^2."""
        q = jnp.asarray(q)
        time, z, nu, noise = (
            jnp.asarray(x, q.dtype)
            for x in (self.time, self.dynamic_exponent, self.coefficient, self.noise)
        )
        rate = nu * q**z
        return noise / rate * -jnp.expm1(-2 * rate * time)

    @property
    def alpha(self) -> Any:
        """Roughness exponent below the correlation length, (z - 2)/2."""
        return (self.dynamic_exponent - 2) / 2

    @property
    def correlation_length(self) -> Any:
        r"""Where the spectrum turns flat, $\xi(t) = (2 \nu t)^{1/z}$."""
        return (2 * self.coefficient * self.time) ** (1 / self.dynamic_exponent)


def grow_linear(
    shape: tuple[int, int],
    *,
    equation: str,
    time: float | int,
    key: Key[Array, ""],
    batch: int | None = None,
    snapshots: Iterable[float | int] | Num[np.ndarray, " time"] | None = None,
    coefficient: float | int = 1.0,
    noise: float | int = 1.0,
    spacing: float | int = 1.0,
) -> Float[Array, "..."]:
    r"""Periodic surfaces grown by a linear equation from a flat start, exact at any time.

    $$\tilde h_q(t + s) = e^{-\nu |q|^z s}\, \tilde h_q(t) + \sqrt{A\, S(q, s)}\, \zeta_q$$

    Arguments:
        shape: (Lx, Ly) in sites, each at least 4.
        equation: "edwards-wilkinson" or "mullins-herring".
        time: how long to grow, positive.
        key: randomness; surface i is the same whatever the batch.
        batch: number of independent surfaces; None for one without a batch axis.
        snapshots: ascending positive times at which to keep the heights; None for the end only.
        coefficient: nu, in length^z / time.
        noise: D, in height^2 length^2 / time.
        spacing: lattice constant, in the unit of length of nu and D.

    Returns:
        Heights `[batch, x, y]` of zero mean at the end; with snapshots, those at the snapshots of
        one course of growth, `[snapshot, batch, x, y]`.

    Raises:
        ValueError: an unknown equation, a time or a coefficient that is not positive, snapshots
            that are not ascending or lie beyond the run.
        TypeError: a key that is not a typed JAX key.

    Source: the paper's Eq. (hcross) with f(u) known exactly.

    >>> import jax
    >>> grow_linear((32, 32), equation="edwards-wilkinson", time=9.0, key=jax.random.key(0)).shape
    (32, 32)
    """
    shape = check_shape(shape)
    check_choice("equation", equation, EQUATIONS)
    check_key(key)
    check_spacing(spacing)
    for name, value in (("time", time), ("coefficient", coefficient), ("noise", noise)):
        remedy = "Growth starts flat at time 0."
        check_in_range(name, value, 0.0, np.inf, closed=(False, False), remedy=remedy)
    if batch is not None:
        check_integer("batch", batch, low=1, remedy="Pass None for a single surface.")
    times = np.array([time] if snapshots is None else list(snapshots), float)
    if not len(times) or np.any(np.diff(times, prepend=0.0) <= 0) or times[-1] > time:
        raise ValueError(
            f"snapshots must be ascending times within the run, 0 to {time:g}; got "
            f"{times.tolist()}. Leave out time 0, where the surface is flat, and grow for longer."
        )
    z = EQUATIONS[equation]
    waits = jnp.asarray(np.diff(times, prepend=0.0), jnp.zeros(()).dtype)
    law = LinearGrowth(1.0, float(z), float(coefficient), float(noise))
    heights = _grow(key, waits, law, shape, 1 if batch is None else batch, float(spacing))
    heights = heights[:, 0] if batch is None else heights
    return heights[-1] if snapshots is None else heights


@partial(jax.jit, static_argnames=("shape", "batch", "spacing"))
def _grow(key, waits, law, shape, batch, spacing):
    q = _grid.wave_number(shape, spacing)
    q[0, 0] = 1.0  # the mean height stays zero; any wave number will do there
    q = jnp.asarray(q, waits.dtype)
    moving = jnp.ones(q.shape, q.dtype).at[0, 0].set(0.0)
    # the plain transform of the heights has the variance of h~ over a^4
    sites = shape[0] * shape[1] / spacing**2

    def one(key):
        def grow(modes, wait_and_number):
            wait, number = wait_and_number
            added = LinearGrowth(wait, law.dynamic_exponent, law.coefficient, law.noise)
            root = jnp.sqrt(added(q) * sites) * moving
            decay = jnp.exp(-law.coefficient * q**law.dynamic_exponent * wait)
            real, imaginary = _random_modes(jax.random.fold_in(key, number), shape, str(q.dtype))
            modes = modes[0] * decay + real * root, modes[1] * decay + imaginary * root
            return modes, jnp.fft.irfft2(jax.lax.complex(*modes), s=shape)

        flat = jnp.zeros_like(q), jnp.zeros_like(q)
        return jax.lax.scan(grow, flat, (waits, jnp.arange(len(waits))))[1]

    grown = jax.lax.map(lambda i: one(jax.random.fold_in(key, i)), jnp.arange(batch))
    return jnp.swapaxes(grown, 0, 1)
