r"""Line scans: the spectrum and the variance of profiles, when a profile is all there is.

A profilometer, or the fast axis of a scanning microscope, gives heights along lines. The
one-dimensional spectral density

$$S_1(q) = |\tilde h(q)|^2 / L, \qquad \tilde h(q) = a \sum_x h(x) e^{-iqx},$$

falls as $q^{-(1 + 2\alpha)}$, one power less steeply than that of the surface: averaged over all
lines of a periodic map it is the sum of S over the other component of q. The variance within an
interval of length $L_0$, averaged over its positions, grows as $L_0^{2\alpha}$.

Profiles come as `[x]`, one line of one surface, or `[..., line, x]`, many lines of each surface; a
map is measured along its second axis. Lines of one surface are averaged: they are not independent.

Array-level cores: `line_density`, `interval_variance`.

Source: the paper's Sec. II B, Eq. (roughness-var); Sec. VI B.
"""

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jaxsurf import _grid
from jaxsurf._checks import SMALLEST_SIDE, check_choice, is_traced
from jaxsurf.curve import Curve
from jaxsurf.measures import _maps
from jaxsurf.measures._boxes import box_moments
from jaxsurf.measures._levelling import WINDOWS, window_along
from jaxsurf.measures._maps import Heights, Units


@jax.jit
def line_density(lines: Float[Array, "surface line x"]) -> Float[Array, "surface mode"]:
    """Mean over lines of |h(q)|^2 / L at the modes 0 < q <= pi, for unit spacing.

    At spacing a multiply by a: height^2 length.
    """
    modes = jnp.fft.rfft(lines)[..., 1:]
    return jnp.mean(modes.real**2 + modes.imag**2, -2) / lines.shape[-1]


@partial(jax.jit, static_argnames=("boundary",))
def interval_variance(
    lines: Float[Array, "surface line x"],
    intervals: Int[Array | np.ndarray, " scale"],
    *,
    boundary: str = "open",
) -> tuple[Float[Array, "surface scale"], Float[Array, "surface scale"]]:
    """Mean variance in intervals of so many sites, over lines and positions, and their number."""
    length = lines.shape[-1]

    def at_interval(one: Array, b: Array) -> tuple[Array, Array]:
        variance = box_moments(one, None, b, 2, axes=(1,))[1]
        start = jnp.arange(length, dtype=jnp.int32)
        there = jnp.full(length, True) if boundary == "periodic" else start <= length - b
        count = jnp.sum(there, dtype=one.dtype)
        return jnp.sum(jnp.where(there, jnp.mean(variance, 0), 0)) / count, count * one.shape[0]

    def of_surface(one: Array) -> tuple[Array, Array]:
        step = jax.checkpoint(lambda b: at_interval(one, b))
        return jax.lax.map(step, jnp.asarray(intervals, jnp.int32))

    return jax.lax.map(of_surface, lines)


@_maps.in_their_own_dtype
def line_spectrum(
    heights: Heights,
    *,
    spacing: float = 1.0,
    boundary: str = "open",
    window: str | None = None,
    units: Units = ("sites", "1"),
) -> Curve:
    r"""Spectrum of line scans.

    $$S_1(q) = |\tilde h(q)|^2 / L$$

    A self-affine surface has $S_1(q) \sim q^{-(1 + 2\alpha)}$.

    Arguments:
        heights: one profile `[x]`, or lines `[..., line, x]` of one surface or more; the dtype is
            kept.
        spacing: lattice constant along the line.
        boundary: "open": the straight line that fits a profile best is taken out and the window
            applied; or "periodic".
        window: of open profiles: "hann" (if None), "hamming", "blackman" or "none".
        units: of length and of height.

    Returns:
        A `Curve` over q at every mode up to pi/a, in height^2 length, one sample a surface.

    Raises:
        TypeError: heights of the wrong kind.
        ValueError: an unknown boundary or window; heights not finite, too short or constant.

    Source: Eq. (power) in one dimension.
    """
    lines = _read_lines(heights, boundary, spacing)
    check_choice("window", window or "none", WINDOWS)
    if boundary == "periodic" and window not in (None, "none"):
        raise ValueError(
            f"window must be None for periodic profiles, which have no ends; got {window!r}. "
            'Pass boundary="open" for profiles that do not wrap round.'
        )
    length = lines.shape[-1]
    if boundary == "open":
        fade = window_along(length, window or "hann")
        fade = jnp.asarray(fade / np.sqrt(np.mean(fade**2)), lines.dtype)
        lines = _without_line(lines) * fade[None, None, :]
    else:
        lines = lines - jnp.mean(lines, -1, keepdims=True)
    mode = np.arange(1, length // 2 + 1)
    standing_for = np.where(2 * mode == length, 1.0, 2.0) * lines.shape[-2]
    samples = line_density(lines) * float(spacing)
    height, unit = _maps.power_of(units[1], 2), units[0]
    return Curve(
        "line_spectrum",
        2 * np.pi * mode / (length * spacing),
        samples,
        jnp.broadcast_to(jnp.asarray(standing_for, lines.dtype)[None, :], samples.shape),
        units=(f"1/{unit}", _maps.product_of(height, unit)),
        details=(("side", length * float(spacing)),),
    )


@_maps.in_their_own_dtype
def line_variance(
    heights: Heights,
    intervals: Any = None,
    *,
    spacing: float = 1.0,
    boundary: str = "open",
    units: Units = ("sites", "1"),
) -> Curve:
    r"""Variance of line scans within an interval, averaged over its positions.

    $$w^2(L_0) = \langle \overline{(h - \bar h)^2} \rangle_{L_0} \sim L_0^{2\alpha}$$

    Arguments:
        heights: one profile `[x]`, or lines `[..., line, x]` of one surface or more; the dtype is
            kept.
        intervals: L_0 in sites, ascending, 1 <= L_0 <= L; None for 2 ... L/4. Any values without
            recompilation.
        spacing: lattice constant along the line.
        boundary: "open", or "periodic" for profiles that wrap round.
        units: of length and of height.

    Returns:
        A `Curve` over L_0, in height^2, one sample a surface; the variance is about the interval's
        own mean and divided by its number of sites.

    Raises:
        TypeError: heights of the wrong kind.
        ValueError: intervals or boundary out of range; heights not finite, too short or constant.

    Source: Eq. (roughness-var) in one dimension.
    """
    lines = _read_lines(heights, boundary, spacing)
    length = lines.shape[-1]
    if intervals is None:
        sizes = np.maximum(_grid.default_scales((length, length))[1:], 2).astype(np.int32)
    else:
        sizes = _maps.check_scales("intervals", intervals, low=1, high=length, limit="L")
    mean, count = interval_variance(lines, sizes, boundary=boundary)
    return Curve(
        "line_variance",
        sizes * float(spacing),
        mean,
        count,
        units=(units[0], _maps.power_of(units[1], 2)),
        details=(("side", length * float(spacing)),),
    )


def _without_line(lines: Float[Array, "surface line x"]) -> Float[Array, "surface line x"]:
    """Each profile minus the straight line that fits it best."""
    x = jnp.asarray(np.linspace(-1, 1, lines.shape[-1]), lines.dtype)[None, None, :]
    rest = lines - jnp.mean(lines, -1, keepdims=True)
    return rest - jnp.sum(rest * x, -1, keepdims=True) / jnp.sum(x * x) * x


def _read_lines(heights: Any, boundary: str, spacing: Any) -> Float[Array, "surface line x"]:
    """Check profiles and give them axes of surfaces and lines."""
    _maps.check_common(boundary, spacing)
    if not hasattr(heights, "ndim") or heights.ndim == 0 or heights.size == 0:
        raise TypeError(
            f"heights must be a profile [x] or lines [..., line, x]; got {heights!r}. "
            "Wrap lists with numpy.asarray."
        )
    if np.dtype(heights.dtype).kind not in "iuf":
        raise TypeError(f"heights must be real numbers; got dtype {heights.dtype}. Pass real ones.")
    if heights.shape[-1] < SMALLEST_SIDE:
        raise ValueError(
            f"a profile must have at least {SMALLEST_SIDE} sites; got shape {heights.shape}. "
            "Pass a longer one."
        )
    lines = jnp.asarray(heights, _maps.dtype_for(heights))
    lines = lines.reshape(1, 1, -1) if lines.ndim == 1 else lines.reshape(-1, *lines.shape[-2:])
    if not is_traced(lines):
        values = np.asarray(lines)
        if not np.all(np.isfinite(values)):
            bad = int(np.count_nonzero(~np.isfinite(values)))
            raise ValueError(
                f"heights must be finite; got {bad} NaN or infinite among {values.size} sites. "
                "Cut the profile there, or fill them."
            )
        if np.any(np.ptp(values, (-2, -1)) == 0):
            raise ValueError(
                "heights must vary along a surface's lines; got constant heights. A flat profile "
                "has no roughness: leave it out."
            )
    return lines
