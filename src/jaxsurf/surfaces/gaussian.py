r"""Gaussian surfaces: independent Fourier modes with the variance a law prescribes.

A Gaussian surface is fully specified by S(q). Each mode is drawn on its own,
$\langle |\tilde h(q)|^2 \rangle = A\, S(q)$ with the q = 0 mode zero, and one inverse real
transform gives the heights. Unlike random midpoint displacement the result is statistically the
same at every site and isotropic beyond a few lattice constants.

Source: the paper's Sec. V A, Eq. (hqvar-2).
"""

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxsurf import _grid
from jaxsurf._checks import (
    check_choice,
    check_integer,
    check_key,
    check_shape,
    check_spacing,
)
from jaxsurf.laws import Law, check_cutoff_fits, spectrum_on_grid

SPECTRA = ("expected", "exact")


def sample(
    law: Law,
    shape: tuple[int, int],
    *,
    key: Any,
    batch: int | None = None,
    spacing: float = 1.0,
    spectrum: str = "expected",
    dtype: Any = None,
) -> Float[Array, "*batch x y"]:
    r"""Draw periodic Gaussian surfaces with a given spectral law.

    $$h(x) = \frac{1}{A} \sum_q \tilde h(q) e^{iq\cdot x}, \qquad
      \langle |\tilde h(q)|^2 \rangle = A\, S(q)$$

    Arguments:
        law: any spectral law; the heights are differentiable in its fields, and `jax.vmap` over
            laws and keys gives the same surfaces as a loop.
        shape: (Lx, Ly) in sites, each at least 4; odd sizes are welcome.
        key: typed JAX key. Surface i of a batch comes from `fold_in(key, i)`, so it is the same
            whatever the batch size.
        batch: number of surfaces; None for a single map without a batch axis.
        spacing: lattice constant a, in the law's unit of length.
        spectrum: "expected", the modes' amplitudes random so that S(q) is met on average (Gaussian
            heights, the paper's surfaces); or "exact", only the phases random, so that every
            surface has |h(q)|^2/A = S(q) mode by mode.
        dtype: float32 or float64, whatever JAX's global setting; None for JAX's default.

    Returns:
        Heights `[x, y]`, or `[batch, x, y]`, of zero mean.

    Raises:
        TypeError: a key that is not typed, a law that is none.
        ValueError: a shape, batch, spacing, spectrum or dtype out of range; a cutoff beyond L/2.

    Source: Sec. V A.

    >>> import jax
    >>> from jaxsurf import SelfAffine
    >>> sample(SelfAffine(alpha=0.4), (64, 48), key=jax.random.key(0), batch=3).shape
    (3, 64, 48)
    """
    if not isinstance(law, Law):
        raise TypeError(
            f"law must be a spectral law; got {law!r}. Pass e.g. SelfAffine(alpha=0.4)."
        )
    shape = check_shape(shape)
    check_key(key)
    check_spacing(spacing)
    check_choice("spectrum", spectrum, SPECTRA)
    check_cutoff_fits(law, shape, spacing)
    if batch is not None:
        batch = check_integer(
            "batch", batch, low=1, remedy="Pass the number of surfaces, or None for a single map."
        )
    if dtype is not None and np.dtype(dtype) not in (np.float32, np.float64):
        raise ValueError(
            f"dtype must be float32 or float64; got {dtype!r}. Cast the heights after."
        )
    if dtype is not None and np.dtype(dtype) == np.float64:
        with jax.enable_x64(True):
            return _draw(law, key, shape, batch, float(spacing), spectrum, "float64")
    default = "float32" if dtype is not None else str(jnp.zeros(()).dtype)
    return _draw(law, key, shape, batch, float(spacing), spectrum, default)


@partial(jax.jit, static_argnames=("shape", "batch", "spacing", "spectrum", "dtype"))
def _draw(
    law: Law,
    key: Any,
    shape: tuple[int, int],
    batch: int | None,
    spacing: float,
    spectrum: str,
    dtype: str,
) -> Float[Array, "*batch x y"]:
    density = spectrum_on_grid(law, shape, spacing=spacing, dtype=dtype)
    # |h~|^2 = A S is |H|^2 = N S / a^2 for the plain transform H = sum h e^{-iqx} of N sites.
    root = jnp.sqrt(density * (shape[0] * shape[1] / spacing**2))
    modes = _random_phases if spectrum == "exact" else _random_modes

    def one(key: Any) -> Array:
        real, imaginary = modes(key, shape, dtype)
        return jnp.fft.irfft2(jax.lax.complex(real * root, imaginary * root), s=shape)

    if batch is None:
        return one(key)
    # One surface at a time: the transforms stay in cache and the memory is that of the result.
    return jax.lax.map(lambda i: one(jax.random.fold_in(key, i)), jnp.arange(batch))


def _random_modes(key: Any, shape: tuple[int, int], dtype: str) -> tuple[Array, Array]:
    """Real and imaginary parts of independent complex normals of unit variance, one a mode.

    The inverse transform reads only the Hermitian part of the columns q_y = 0 and q_y = pi, which
    halves their variance; sqrt(2) restores it.
    """
    half = shape[1] // 2 + 1
    parts = jax.random.normal(key, (2, shape[0], half), dtype)
    weight = jnp.asarray(np.sqrt(1.0 / _grid.mode_multiplicity(shape)), dtype)
    return parts[0] * weight[None, :], parts[1] * weight[None, :]


def _random_phases(key: Any, shape: tuple[int, int], dtype: str) -> tuple[Array, Array]:
    """Cosine and sine of the phases of white noise, which have the symmetry of a real map."""
    noise = jnp.fft.rfft2(jax.random.normal(key, shape, dtype))
    length = jnp.abs(noise)
    return noise.real / length, noise.imag / length
