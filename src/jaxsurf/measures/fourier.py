r"""The spectrum of a map: how much height fluctuation there is at each wave number.

$$S(q) = |\tilde h(q)|^2 / A, \qquad \tilde h(q) = a^2 \sum_x h(x) e^{-iq\cdot x}$$

A self-affine surface has $S(q) \sim q^{-2(1+\alpha)}$. It is averaged over rings of |q|
(`power_spectrum`) or read along one lattice direction (`directional_spectrum`), the check that a
lattice model is isotropic. The convention is that of `_grid`.

A map that does not wrap round has a step at its edges, whose spectrum falls as $q^{-2}$ and hides
any steeper one. Its plane is taken out and its heights fade to zero at the edges; dividing by the
mean square of the window keeps the density. Missing sites are windowed to zero likewise.

Array-level cores: `density` (the 2-D map), `radial`.

Source: the paper's Sec. II B, Eq. (power); Sec. V B, Fig. 16.
"""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jaxsurf import _grid
from jaxsurf._checks import check_choice, is_traced
from jaxsurf.curve import Curve
from jaxsurf.measures import _maps
from jaxsurf.measures._levelling import (
    WINDOWS,
    centred_on_valid,
    check_plane,
    levelled_and_windowed,
)
from jaxsurf.measures._maps import Heights, Units


class SpectrumMap(NamedTuple):
    """S over the whole zone: q_x and q_y ascending, in 1/length, and the values `[..., x, y]`."""

    q_x: Any
    q_y: Any
    values: Any


@jax.jit
def density(heights: Float[Array, "surface x y"]) -> Float[Array, "surface x half"]:
    r"""$|\tilde h(q)|^2 / A$ on the modes of `rfft2`, for unit spacing.

    At spacing a multiply by a^2: heights^2 length^2.
    """
    modes = jnp.fft.rfft2(heights)
    return (modes.real**2 + modes.imag**2) / (heights.shape[-2] * heights.shape[-1])


@partial(jax.jit, static_argnames=("shape",))
def radial(
    spectrum: Float[Array, "surface x half"], *, shape: tuple[int, int]
) -> Float[Array, "surface bin"]:
    """Means of a 2-D spectrum over the rings of `_grid.radial_bins(shape)`."""
    bins = _grid.radial_bins(shape)
    share = _grid.mode_multiplicity(shape) / np.append(bins.count, np.inf)[bins.index]
    weighted = spectrum * jnp.asarray(share[None], spectrum.dtype)
    # Modes first, surfaces last: each scattered row is one contiguous vector of surfaces.
    rows = weighted.reshape(spectrum.shape[0], -1).T
    index = jnp.asarray(bins.index.ravel(), jnp.int32)
    return jax.ops.segment_sum(rows, index, len(bins.scale) + 1)[:-1].T


@_maps.in_their_own_dtype
def power_spectrum(
    heights: Heights,
    *,
    spacing: float = 1.0,
    boundary: str = "periodic",
    window: str | None = None,
    mask: Any = None,
    units: Units = ("sites", "1"),
) -> Curve:
    r"""Spectrum S(q) averaged over rings of |q|.

    $$S(q) = |\tilde h(q)|^2 / A$$

    A self-affine surface has $S(q) \sim q^{-2(1 + \alpha)}$.

    Arguments:
        heights: maps `[..., x, y]`, each a surface; the dtype is kept.
        spacing: lattice constant.
        boundary: "periodic", or "open" for maps that do not wrap round: the plane is taken out and
            the window applied.
        window: of an open map: "hann" (if None), "hamming", "blackman" or "none".
        mask: true on valid sites, `[x, y]` or the shape of `heights`. Missing sites are windowed to
            zero, which blurs the spectrum over the inverse size of the holes.
        units: of length and of height.

    Returns:
        A `Curve` over |q|, up to the zone's edge pi/a, in height^2 length^2; its weights are the
        numbers of modes in each ring, and rings without modes are left out.

    Raises:
        TypeError: heights or mask of the wrong kind.
        ValueError: an unknown boundary or window, a window for a periodic map; heights not finite.

    Source: Eq. (power), with the factor 1/A.

    >>> import jax
    >>> heights = jax.random.normal(jax.random.key(0), (25, 64, 64))
    >>> spectrum = power_spectrum(heights)  # white noise of unit variance: S = 1
    >>> bool(abs(spectrum.mean[-1] - 1) < 0.05)
    True
    """
    maps, valid = _maps.read(heights, mask, boundary=boundary, spacing=spacing)
    shape = (maps.shape[-2], maps.shape[-1])
    spectrum = radial(density(_prepared(maps, valid, boundary, window)), shape=shape)
    bins = _grid.radial_bins(shape)
    weights = jnp.broadcast_to(jnp.asarray(bins.count, maps.dtype)[None, :], spectrum.shape)
    return Curve(
        "spectrum",
        bins.scale / spacing,
        spectrum * spacing**2,
        weights,
        units=_units(units),
        details=_details(shape, spacing, boundary, window),
    )


@_maps.in_their_own_dtype
def directional_spectrum(
    heights: Heights,
    *,
    spacing: float = 1.0,
    boundary: str = "periodic",
    window: str | None = None,
    mask: Any = None,
    units: Units = ("sites", "1"),
) -> dict[str, Curve]:
    r"""Spectrum S(q) along the directions (1,0), (0,1), (1,1) and (1,-1) of reciprocal space.

    The four agree where the surface is isotropic.

    Arguments:
        heights: maps `[..., x, y]`, each a surface; the dtype is kept.
        spacing: lattice constant.
        boundary: "periodic", or "open": levelled and windowed as in `power_spectrum`.
        window: of an open map: "hann" (if None), "hamming", "blackman" or "none".
        mask: true on valid sites.
        units: of length and of height.

    Returns:
        One `Curve` over |q| for each of "10", "01", "11" and "1-1", in height^2 length^2. On a map
        that is not square the diagonals hold only the modes that lie on them exactly.

    Raises:
        TypeError: heights or mask of the wrong kind.
        ValueError: an unknown boundary or window; heights not finite.

    Source: Sec. V B, Fig. 16.
    """
    maps, valid = _maps.read(heights, mask, boundary=boundary, spacing=spacing)
    shape = (maps.shape[-2], maps.shape[-1])
    spectrum = density(_prepared(maps, valid, boundary, window)) * spacing**2
    length = _grid.wave_number(shape, spacing)
    details = _details(shape, spacing, boundary, window)
    curves = {}
    for direction, (along_x, along_y) in _line_modes(shape).items():
        samples = spectrum[:, along_x, along_y]
        own_mirror = (2 * along_x % shape[0] == 0) & (2 * along_y % shape[1] == 0)
        modes = np.where(own_mirror, 1.0, 2.0)
        curves[direction] = Curve(
            "directional_spectrum",
            length[along_x, along_y],
            samples,
            jnp.broadcast_to(jnp.asarray(modes, maps.dtype)[None, :], samples.shape),
            units=_units(units),
            details=(("direction", direction), *details),
        )
    return curves


@_maps.in_their_own_dtype
def power_spectrum_map(
    heights: Heights,
    *,
    spacing: float = 1.0,
    boundary: str = "periodic",
    window: str | None = None,
    mask: Any = None,
) -> SpectrumMap:
    r"""Spectrum S(q) at every wave number of the zone: is the surface isotropic?

    $$S(q) = |\tilde h(q)|^2 / A$$

    Arguments:
        heights: maps `[..., x, y]`; the dtype is kept.
        spacing: lattice constant.
        boundary: "periodic", or "open": levelled and windowed as in `power_spectrum`.
        window: of an open map: "hann" (if None), "hamming", "blackman" or "none".
        mask: true on valid sites.

    Returns:
        A `SpectrumMap`, q = 0 in the middle, in height^2 length^2; differentiable in the heights.

    Raises:
        TypeError: heights or mask of the wrong kind.
        ValueError: an unknown boundary or window; heights not finite.

    Source: Eq. (power), with the factor 1/A.
    """
    maps, valid = _maps.read(heights, mask, boundary=boundary, spacing=spacing)
    shape = (maps.shape[-2], maps.shape[-1])
    half = density(_prepared(maps, valid, boundary, window)) * spacing**2
    # S(-q) = S(q): the columns q_y < 0 are mirror images of those that `rfft2` keeps.
    mirrored = jnp.roll(half[:, ::-1, 1 : (shape[1] + 1) // 2][:, :, ::-1], 1, 1)
    full = jnp.fft.fftshift(jnp.concatenate([half, mirrored], -1), (-2, -1))
    q_x, q_y = (2 * np.pi * np.fft.fftshift(np.fft.fftfreq(n, spacing)) for n in shape)
    return SpectrumMap(q_x, q_y, full.reshape(heights.shape))


def _line_modes(shape: tuple[int, int]) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Indices into `rfft2` of the modes 0 < |q| <= pi/a along each of the four directions."""
    x, y = np.arange(1, shape[0] // 2 + 1), np.arange(1, shape[1] // 2 + 1)
    common = np.gcd(*shape)
    step = np.arange(1, common // 2 + 1)
    diagonal_x, diagonal_y = step * (shape[0] // common), step * (shape[1] // common)
    return {
        "10": (x, np.zeros_like(x)),
        "01": (np.zeros_like(y), y),
        "11": (diagonal_x, diagonal_y),
        "1-1": (-diagonal_x % shape[0], diagonal_y),
    }


def _prepared(
    maps: Float[Array, "surface x y"],
    valid: Bool[Array, "surface x y"] | None,
    boundary: str,
    window: str | None,
) -> Float[Array, "surface x y"]:
    """The maps as they enter the Fourier transform."""
    check_choice("window", window or "none", WINDOWS)
    if boundary == "periodic" and window not in (None, "none"):
        raise ValueError(
            f"window must be None for a periodic map, which has no edges; got {window!r}. "
            'Pass boundary="open" for a map that does not wrap round.'
        )
    if boundary == "open" and valid is not None and not is_traced(valid):
        check_plane(np.asarray(valid))
    if boundary == "open":
        return levelled_and_windowed(maps, valid, window or "hann")
    if valid is None:
        return maps - maps.mean((-2, -1), keepdims=True)  # rounding errors scale with the mean
    return centred_on_valid(maps, valid)


def _units(units: Units) -> Units:
    length, height = units
    return f"1/{length}", _maps.product_of(_maps.power_of(height, 2), _maps.power_of(length, 2))


def _details(
    shape: tuple[int, int], spacing: float, boundary: str, window: str | None
) -> tuple[tuple[str, Any], ...]:
    edges = () if boundary == "periodic" else (("window", window or "hann"),)
    return (*edges, ("side", min(shape) * float(spacing)))
