r"""Spectral laws S(q), and what they imply exactly on a lattice.

A law says how much height fluctuation there is at each wave number; with independent Gaussian
modes it says everything about a surface. On a given periodic grid the mean of every quadratic
measure is a finite sum over the grid's modes, $(1/A) \sum_q S(q) K(q)$, with a kernel K that
depends on the measure alone. Those sums are what measurements are compared with: no continuum
limit, no lattice or finite-size correction is left out.

Kernels are formed as $2\sin^2$ rather than $1 - \cos$, so that float32 is enough: nothing cancels.

Source: the paper's Sec. V A, Eqs. (hqvar-2), (hq_var_cut), (struc2), (curv2), (roughness-var).
"""

from abc import abstractmethod
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from jaxsurf import _grid
from jaxsurf._checks import check_choice, check_in_range, check_shape, check_spacing

#: Offsets of the curvature, in sites (the paper's two sets of M = 4).
DIRECTIONS = {"10": ((1, 0), (0, 1), (-1, 0), (0, -1)), "11": ((1, 1), (1, -1), (-1, -1), (-1, 1))}


class Law(eqx.Module):
    """A spectral density S(|q|): a pytree whose fields can be differentiated and vmapped."""

    @abstractmethod
    def __call__(self, q: Any) -> Any:
        """S(q) at wave numbers q > 0, in height^2 length^2."""


class SelfAffine(Law):
    r"""Self-affine spectrum, flat below a cutoff (Eq. hq_var_cut).

    $$S(q) = A\, \max(|q|, \pi/\xi_q)^{-2(1 + \alpha)}$$

    Arguments:
        alpha: roughness exponent, -1 <= alpha < 2; 0 to 1 for rough self-affine surfaces.
        amplitude: A > 0, in height^2 length^(-2 alpha).
        cutoff: xi_q > 0 in units of length; None for a surface without one. The knee seen in
            real space lies near xi_q but is not xi_q.

    Raises:
        ValueError: alpha, amplitude or cutoff outside its range.

    >>> SelfAffine(alpha=0.5)(2.0)
    Array(0.125, dtype=float32)
    """

    alpha: ArrayLike
    amplitude: ArrayLike = 1.0
    cutoff: ArrayLike | None = None

    def __check_init__(self):
        if isinstance(self.alpha, str) or isinstance(self.amplitude, str):
            raise TypeError(f"alpha and amplitude must be numbers; got {self!r}.")
        check_in_range(
            "alpha",
            self.alpha,
            -1.0,
            2.0,
            closed=(True, False),
            remedy="Rough self-affine surfaces have 0 <= alpha <= 1, white noise alpha = -1.",
        )
        check_in_range(
            "amplitude",
            self.amplitude,
            0.0,
            np.inf,
            closed=(False, False),
            remedy="It multiplies S(q); pass 1.0 for the paper's surfaces.",
        )
        if self.cutoff is not None:
            check_in_range(
                "cutoff",
                self.cutoff,
                0.0,
                np.inf,
                closed=(False, False),
                remedy="Pass cutoff=None for a surface without one.",
            )

    def __call__(self, q: Any) -> Any:
        """S(q) at wave numbers q > 0, in height^2 length^2."""
        q = jnp.asarray(q)
        if self.cutoff is not None:
            q = jnp.maximum(q, jnp.asarray(jnp.pi / self.cutoff, q.dtype))
        alpha, amplitude = jnp.asarray(self.alpha, q.dtype), jnp.asarray(self.amplitude, q.dtype)
        return amplitude * q ** (-2 * (1 + alpha))


class WhiteNoise(Law):
    r"""Independent heights: $S(q) = \sigma^2 a^2$, the same at every wave number.

    Arguments:
        amplitude: S > 0 in height^2 length^2; on unit spacing the variance of a height.

    >>> float(expected_variance(WhiteNoise(), (32, 32)))  # the mean of the map is taken out
    0.9990234375
    """

    amplitude: ArrayLike = 1.0

    def __check_init__(self):
        check_in_range(
            "amplitude",
            self.amplitude,
            0.0,
            np.inf,
            closed=(False, False),
            remedy="It is the variance of a height times the area of a site.",
        )

    def __call__(self, q: Any) -> Any:
        """S at wave numbers q > 0, in height^2 length^2."""
        q = jnp.asarray(q)
        return jnp.broadcast_to(jnp.asarray(self.amplitude, q.dtype), q.shape)


def check_cutoff_fits(law: Law, shape: tuple[int, int], spacing: float) -> None:
    """Raise if the law's cutoff is not shorter than half the map."""
    cutoff = getattr(law, "cutoff", None)
    if cutoff is None:
        return
    half = min(shape) * spacing / 2
    try:
        check_in_range("cutoff", cutoff, 0.0, half, closed=(False, False), remedy="")
    except ValueError:
        raise ValueError(
            f"cutoff must be positive and below L/2 = {half:g}; got {cutoff}. "
            "Pass cutoff=None for a surface without one, or a larger shape."
        ) from None


def spectrum_on_grid(
    law: Law, shape: tuple[int, int], *, spacing: float = 1.0, dtype: Any = None
) -> Float[Array, "x half"]:
    """S(q) on the modes of `rfft2`, the q = 0 mode zero, in height^2 length^2.

    Arguments:
        law: any spectral law.
        shape: (Lx, Ly) in sites.
        spacing: lattice constant.
        dtype: of the result; JAX's default float if None.
    """
    q = _grid.wave_number(shape, spacing)
    q[0, 0] = 1.0  # the zero mode carries nothing; a harmless wave number keeps gradients finite
    density = law(jnp.asarray(q, dtype or jnp.zeros(()).dtype))
    return density.at[0, 0].set(0.0)


def expected_variance(
    law: Law, shape: tuple[int, int], *, spacing: float = 1.0
) -> Float[Array, ""]:
    r"""Exact mean of the variance of a map, $(1/A) \sum_{q\ne 0} S(q)$, in height^2.

    Arguments:
        law: any spectral law.
        shape: (Lx, Ly) in sites.
        spacing: lattice constant.

    Source: Sec. II B.
    """
    check_shape(shape)
    check_spacing(spacing)
    weighted = _weighted_spectrum(law, shape, spacing)
    return weighted.sum()


def expected_height_correlation(
    law: Law, shape: tuple[int, int], separations: Any, *, spacing: float = 1.0
) -> Float[Array, " separation"]:
    r"""Exact mean of the height correlation, $D_2(r) = (2/A) \sum_q S(q)(1 - \cos q\cdot r)$.

    Arguments:
        law: any spectral law; the result is differentiable in its fields.
        shape: (Lx, Ly) in sites.
        separations: vectors r = (x, y), `[separation, 2]`, or lengths along {10}, `[separation]`
            (the mean of both axes), in sites; any values without recompilation.
        spacing: lattice constant.

    Returns:
        D_2 at each separation, in height^2.

    Raises:
        ValueError: separations that are neither lengths nor vectors.

    Source: Eq. (struc2), with the sign and factor of the convention in `_grid`.

    >>> expected_height_correlation(WhiteNoise(), (32, 32), [1, 5])
    Array([2., 2.], dtype=float32)
    """
    check_shape(shape)
    check_spacing(spacing)
    vectors = np.asarray(separations, float)
    if vectors.ndim == 1:
        along = np.stack([vectors, np.zeros_like(vectors)], -1)
        both = np.stack([along, along[:, ::-1]], 1)
    elif vectors.ndim == 2 and vectors.shape[1] == 2:
        both = vectors[:, None]
    else:
        raise ValueError(
            "separations must be lengths [n] or vectors [n, 2] in sites; got shape "
            f"{vectors.shape}. Pass e.g. [1, 2, 4] or [[1, 0], [1, 1]]."
        )
    half_angle = _half_angles(shape)

    def factors(axis: int) -> tuple[np.ndarray, np.ndarray]:
        angle = both[..., axis, None] * half_angle[axis]
        return 2 * np.sin(angle) ** 2, np.sin(2 * angle)

    (u_x, s_x), (u_y, s_y) = factors(0), factors(1)
    weighted = _weighted_spectrum(law, shape, spacing)
    tables = [jnp.asarray(t, weighted.dtype) for t in (u_x, s_x, u_y, s_y)]
    return jax.lax.map(lambda t: _height_correlation(weighted, *t), tuple(tables))


def _height_correlation(weighted: Array, u_x: Array, s_x: Array, u_y: Array, s_y: Array) -> Array:
    """Sum of 2 S (1 - cos(a + b)), with 1 - cos(a + b) = u_a + u_b - u_a u_b + s_a s_b."""
    kernel = u_x[:, :, None] + u_y[:, None, :] - u_x[:, :, None] * u_y[:, None, :]
    return 2 * jnp.mean(((kernel + s_x[:, :, None] * s_y[:, None, :]) * weighted[None]).sum((1, 2)))


def expected_curvature_variance(
    law: Law,
    shape: tuple[int, int],
    scales: Any,
    direction: str = "10",
    *,
    spacing: float = 1.0,
) -> Float[Array, " scale"]:
    r"""Exact mean of $C_b^2$, $(1/A) \sum_q S(q) |\sum_m (e^{i b q\cdot e_m} - 1)|^2$.

    Arguments:
        law: any spectral law; the result is differentiable in its fields.
        shape: (Lx, Ly) in sites.
        scales: offsets b in sites, any positive values without recompilation.
        direction: "10" or "11"; along "11" the offset (b, b) has length sqrt(2) b.
        spacing: lattice constant.

    Returns:
        The mean square curvature at each scale, in height^2.

    Raises:
        ValueError: a scale that is not positive, an unknown direction.

    Source: Eq. (curv_def), (curv2).

    >>> expected_curvature_variance(WhiteNoise(), (32, 32), [1, 3])
    Array([20., 20.], dtype=float32)
    """
    check_shape(shape)
    check_spacing(spacing)
    check_choice("direction", direction, DIRECTIONS)
    b = _positive("scales", scales)
    half_x, half_y = _half_angles(shape)
    weighted = _weighted_spectrum(law, shape, spacing)
    u_x = jnp.asarray(2 * np.sin(b[:, None] * half_x) ** 2, weighted.dtype)
    u_y = jnp.asarray(2 * np.sin(b[:, None] * half_y) ** 2, weighted.dtype)

    def one(tables: tuple[Array, Array]) -> Array:
        x, y = tables[0][:, None], tables[1][None, :]
        symbol = 2 * (x + y) if direction == "10" else 4 * (x + y - x * y)
        return (weighted * symbol**2).sum()

    return jax.lax.map(one, (u_x, u_y))


def expected_patch_variance(
    law: Law, shape: tuple[int, int], sizes: Any, *, spacing: float = 1.0
) -> Float[Array, " size"]:
    r"""Exact mean of the variance inside b x b patches, $(1/A) \sum_q S(q) (1 - |W_b(q)|^2)$.

    $W_b$ is the transform of the patch, $\sin(b q_x a/2)/(b \sin(q_x a/2))$ times the like in y.
    The variance is that about the patch's own mean, divided by b^2.

    Arguments:
        law: any spectral law; the result is differentiable in its fields.
        shape: (Lx, Ly) in sites.
        sizes: sides b of the patches in sites, whole numbers >= 1.
        spacing: lattice constant.

    Returns:
        The mean variance at each size, in height^2.

    Raises:
        ValueError: a size below 1 or beyond the map.

    Source: Eq. (roughness-var).

    >>> expected_patch_variance(WhiteNoise(), (32, 32), [1, 2])
    Array([0.  , 0.75], dtype=float32)
    """
    check_shape(shape)
    check_spacing(spacing)
    b = _positive("sizes", sizes)
    check_in_range(
        "sizes", b, 1, min(shape), remedy=f"A patch must fit in the map of {shape} sites."
    )
    weighted = _weighted_spectrum(law, shape, spacing)
    tables = [
        jnp.asarray(_one_minus_window(b[:, None], half), weighted.dtype)
        for half in _half_angles(shape)
    ]

    def one(pair: tuple[Array, Array]) -> Array:
        x, y = pair[0][:, None], pair[1][None, :]
        return (weighted * (x + y - x * y)).sum()

    return jax.lax.map(one, tuple(tables))


def _one_minus_window(b: np.ndarray, half_angle: np.ndarray) -> np.ndarray:
    """1 - [sin(b t) / (b sin t)]^2 along one axis, t = q a / 2; zero at t = 0."""
    sine = np.sin(half_angle)
    window = np.where(sine == 0, 1.0, np.sin(b * half_angle) / (b * np.where(sine == 0, 1, sine)))
    return 1 - window**2


def _half_angles(shape: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Half the phase q_x a and q_y a of each mode from one site to the next."""
    q_x, q_y = _grid.wave_numbers(shape)
    return q_x[:, 0] / 2, q_y[0] / 2


def _weighted_spectrum(law: Law, shape: tuple[int, int], spacing: float) -> Float[Array, "x half"]:
    """S(q)/A on the modes of `rfft2`, each counted with its mirror image."""
    check_cutoff_fits(law, shape, spacing)
    density = spectrum_on_grid(law, shape, spacing=spacing)
    area = shape[0] * shape[1] * spacing**2
    multiplicity = jnp.asarray(_grid.mode_multiplicity(shape) / area, density.dtype)
    return density * multiplicity[None, :]


def _positive(name: str, scales: Any) -> np.ndarray:
    values = np.atleast_1d(np.asarray(scales, float))
    check_in_range(
        name,
        values,
        0,
        np.inf,
        closed=(False, False),
        remedy="Pass whole numbers of sites from 1 up.",
    )
    return values
