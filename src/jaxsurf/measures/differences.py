r"""The height correlation: how far apart in height are two sites at distance r?

$$D_q(r) = \langle |h(x + r) - h(x)|^q \rangle$$

For a self-affine surface $D_q(r) \sim r^{\alpha_q}$ with $\alpha_q = q\alpha$; a bending
$\alpha_q$ is the mark of a multiaffine one. $D_2$ is the Fourier partner of the spectrum,
$D_2(r) = (2/A) \sum_q S(q) (1 - \cos q\cdot r)$.

Over rings of |r|, D_2 comes from two Fourier transforms and counts every pair of sites. Along {10}
or {11} any D_q comes from the differences themselves, to relative rounding accuracy; the transforms
leave an absolute error of about the dtype's precision times the variance. That matters only in
float32 and for steep maps: at alpha = 1 and r = 1 it is 0.1 % of D_2 for L = 512 and 2 % for
L = 2048. Pass float64 there.

With an open boundary or a mask only the pairs that exist are counted. Their squared differences sum
to $\sum m m' (h - h')^2$, three correlations of the mask, the heights and their squares, on a map
padded so that nothing wraps round.

Array-level cores: `moments` (along lattice directions), `correlation_map` (every separation).

Source: the paper's Sec. II B, Eqs. (struc), (struc2); Sec. II D, Table III.
"""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from jaxsurf import _grid
from jaxsurf._checks import check_choice, check_in_range
from jaxsurf.curve import Curve
from jaxsurf.measures import _maps
from jaxsurf.measures._maps import Heights, Units
from jaxsurf.measures._stencils import Stencil, stencil_moments

#: The steps whose differences are pooled along {10} and along {11}.
STEPS: dict[str, tuple[Stencil, ...]] = {
    "10": (((1, 0),), ((0, 1),)),
    "11": (((1, 1),), ((1, -1),)),
}


class CorrelationMap(NamedTuple):
    """D_2 at every separation up to half the map: x and y ascending, in units of length.

    Attributes:
        x: separations along the first axis.
        y: separations along the second axis.
        values: D_2(x, y) in height^2, `[..., x, y]`; zero where there is no pair.
        pairs: the number of pairs behind each value.
    """

    x: Any
    y: Any
    values: Any
    pairs: Any


def moments(
    heights: Float[Array, "surface x y"],
    separations: Int[Array | np.ndarray, " scale"],
    mask: Bool[Array, "surface x y"] | None = None,
    *,
    orders: tuple[float | int, ...] = (2,),
    direction: str = "10",
    boundary: str = "periodic",
) -> tuple[Float[Array, "order surface scale"], Float[Array, "surface scale"]]:
    r"""Means of $|\Delta h|^q$ along lattice directions, and the numbers of pairs in them.

    Arguments:
        heights: maps; finite outside the mask.
        separations: r in steps of the direction; any values without recompilation.
        mask: true on valid sites.
        orders: any q > 0, computed in one pass.
        direction: "10" pools both axes, "11" both diagonals.
        boundary: "open" uses only the pairs inside the map.
    """
    return stencil_moments(
        heights,
        separations,
        mask,
        stencils=STEPS[direction],
        orders=tuple(orders),
        boundary=boundary,
        absolute=True,
    )


@partial(jax.jit, static_argnames=("boundary",))
def correlation_map(
    heights: Float[Array, "surface x y"],
    mask: Bool[Array, "surface x y"] | None = None,
    *,
    boundary: str = "periodic",
) -> tuple[Float[Array, "surface x y"], Float[Array, "#surface x y"]]:
    """D_2 and the number of pairs at every separation, in the order of `_grid.separations`.

    Separations are at most half a side also with an open boundary. Zero where there is no pair.
    """
    shape = (heights.shape[-2], heights.shape[-1])
    if mask is None and boundary == "periodic":
        centred = heights - jnp.mean(heights, (-2, -1), keepdims=True)
        power = _power(jnp.fft.rfft2(centred))
        covariance = jnp.fft.irfft2(power, s=shape) / (shape[0] * shape[1])
        pairs = jnp.full((1, *shape), shape[0] * shape[1], heights.dtype)
        return 2 * (covariance[:, :1, :1] - covariance), pairs
    padded = shape
    if boundary == "open":
        padded = (_padded_side(shape[0]), _padded_side(shape[1]))
    valid = jnp.ones((1, *shape), bool) if mask is None else mask
    pairs = jax.lax.map(lambda m: _pairs(m, padded), valid).astype(heights.dtype)

    def of_map(one: tuple[Array, Array]) -> Array:
        weight = one[1].astype(heights.dtype)
        mean = jnp.sum(weight * one[0]) / jnp.maximum(jnp.sum(weight), 1)
        h = weight * (one[0] - mean)
        # One map at a time: of a batch only the result is ever held.
        h_q, h2_q, m_q = (jnp.fft.rfft2(f, s=padded) for f in (h, h * h, weight))
        mixed = m_q.real * h2_q.real + m_q.imag * h2_q.imag
        return _cropped(jnp.fft.irfft2(2 * (mixed - _power(h_q)), s=padded), shape)

    squares = jax.lax.map(of_map, (heights, jnp.broadcast_to(valid, heights.shape)))
    return jnp.where(pairs > 0, squares / jnp.maximum(pairs, 1), 0), pairs


def _power(modes: Array) -> Array:
    return modes.real**2 + modes.imag**2


def _padded_side(side: int) -> int:
    """A side on which separations up to half the map do not wrap round, quick to transform."""
    from scipy.fft import next_fast_len  # kept out of `import jaxsurf`

    return int(np.asarray(next_fast_len(side + side // 2, real=True)))


def _pairs(valid: Bool[Array, "x y"], padded: tuple[int, ...]) -> Array:
    """The exact number of pairs of valid sites at each separation.

    In 64 bits, whatever the heights' dtype: float32 transforms miscount beyond 10^7 pairs, and a
    separation without any pair must be told from one with a single pair.
    """
    shape = (valid.shape[0], valid.shape[1])
    with jax.enable_x64(True):
        modes = jnp.fft.rfft2(valid.astype(jnp.float64), s=padded)
        pairs = jnp.round(_cropped(jnp.fft.irfft2(_power(modes), s=padded), shape))
        return pairs.astype(jnp.float32)


def _cropped(
    field: Float[Array, "padded_x padded_y"], shape: tuple[int, int]
) -> Float[Array, "x y"]:
    """The entries of a padded map at the separations of `_grid.separations(shape)`."""
    for axis, side in enumerate(shape):
        if field.shape[axis] > side:
            low, high = side // 2, side - side // 2  # -L/2 ... -1 and 0 ... L/2 - 1
            field = jnp.concatenate(
                [
                    jax.lax.slice_in_dim(field, 0, high, axis=axis),
                    jax.lax.slice_in_dim(field, field.shape[axis] - low, None, axis=axis),
                ],
                axis,
            )
    return field


@partial(jax.jit, static_argnames=("shape",))
def ring_means(
    values: Float[Array, "surface x y"],
    pairs: Float[Array, "#surface x y"],
    *,
    shape: tuple[int, int],
) -> tuple[Float[Array, "surface bin"], Float[Array, "surface bin"]]:
    """Means over the rings of `_grid.separation_bins`, each separation weighted by its pairs."""
    bins = _grid.separation_bins(shape)
    index = jnp.asarray(bins.index.ravel(), jnp.int32)

    def ring_sums(field: Array) -> Array:
        rows = field.reshape(field.shape[0], -1).T
        return jax.ops.segment_sum(rows, index, len(bins.scale) + 1)[:-1].T

    # Shares of the map's own number of sites, not pairs, are summed: nothing large in float32.
    sites = shape[0] * shape[1]
    total = ring_sums(pairs / sites)
    safe = jnp.where(total > 0, total, 1)
    means = ring_sums(values * (pairs / sites)) / safe
    return means, jnp.broadcast_to(total * sites, means.shape)


@_maps.in_their_own_dtype
def height_correlation(
    heights: Heights,
    separations: Any = None,
    *,
    order: float | int = 2,
    direction: str | None = None,
    spacing: float = 1.0,
    boundary: str = "periodic",
    mask: Any = None,
    units: Units = ("sites", "1"),
) -> Curve:
    r"""Height correlation function.

    $$D_q(r) = \langle |h(x + r) - h(x)|^q \rangle$$

    A self-affine surface has $D_q(r) \sim r^{q\alpha}$.

    Arguments:
        heights: maps `[..., x, y]`, each a surface; the dtype is kept.
        separations: r in sites, ascending, 1 <= r <= L/2, along a direction; None for 1 ... L/4.
            Any values without recompilation. Rings have the separations of the grid.
        order: any real q > 0. Where a difference is zero the gradient is zero.
        direction: "radial", rings of |r| up to L/2 (order 2 only); "10", both axes; "11", both
            diagonals, where r steps (r, r) have length sqrt(2) r. None takes rings if they can be
            had and no separations are given.
        spacing: lattice constant; the curve's scale is in its unit.
        boundary: "periodic", or "open" for maps that do not wrap round.
        mask: true on valid sites, `[x, y]` or the shape of `heights`.
        units: of length and of height.

    Returns:
        A `Curve` over r, in height^q, differentiable in the heights. Its weights are the numbers of
        pairs averaged over; a separation without any has count zero.

    Raises:
        TypeError: heights or mask of the wrong kind.
        ValueError: separations, order, direction or boundary out of range; rings of an order other
            than 2; heights not finite.

    Source: Eqs. (struc), (struc2), Table III.

    >>> import jax
    >>> heights = jax.random.normal(jax.random.key(0), (4, 64, 64))
    >>> D = height_correlation(heights)  # independent heights of unit variance: D_2 = 2
    >>> bool(abs(D.mean[-1] - 2) < 0.05)
    True
    """
    check_in_range(
        "order", order, 0, np.inf, closed=(False, False), remedy="Pass 2 for the usual D_2(r)."
    )
    maps, valid = _maps.read(heights, mask, boundary=boundary, spacing=spacing)
    if direction is None:
        direction = "radial" if order == 2 and separations is None else "10"
    check_choice("direction", direction, ("radial", *STEPS))
    if direction == "radial":
        if order != 2 or separations is not None:
            raise ValueError(
                'direction "radial" must have order 2 and the separations of the grid; got order '
                f'{order!r} and separations {separations!r}. Pass direction="10" or "11".'
            )
        shape = (maps.shape[-2], maps.shape[-1])
        mean, count = ring_means(*correlation_map(maps, valid, boundary=boundary), shape=shape)
        scale = _grid.separation_bins(shape).scale * spacing
    else:
        r = _separations(separations, maps.shape)
        means, count = moments(
            maps, r, valid, orders=(order,), direction=direction, boundary=boundary
        )
        mean, scale = means[0], r * (spacing * (2**0.5 if direction == "11" else 1.0))
    return Curve(
        "height_correlation",
        scale,
        mean,
        count,
        units=(units[0], _maps.power_of(units[1], order)),
        details=(("order", order), ("direction", direction), _maps.side(maps, spacing)),
    )


@_maps.in_their_own_dtype
def height_correlation_map(
    heights: Heights, *, spacing: float = 1.0, boundary: str = "periodic", mask: Any = None
) -> CorrelationMap:
    r"""The height correlation at every separation up to half the map: is the surface isotropic?

    $$D_2(r) = \langle [h(x + r) - h(x)]^2 \rangle$$

    Arguments:
        heights: maps `[..., x, y]`; the dtype is kept.
        spacing: lattice constant.
        boundary: "periodic", or "open" for maps that do not wrap round.
        mask: true on valid sites, `[x, y]` or the shape of `heights`.

    Returns:
        A `CorrelationMap`, r = 0 in the middle; differentiable in the heights.

    Raises:
        TypeError: heights or mask of the wrong kind.
        ValueError: boundary or spacing out of range; heights not finite.

    Source: Eq. (struc).
    """
    maps, valid = _maps.read(heights, mask, boundary=boundary, spacing=spacing)
    values, pairs = correlation_map(maps, valid, boundary=boundary)
    x, y = _grid.separations((maps.shape[-2], maps.shape[-1]))
    return CorrelationMap(
        np.sort(x[:, 0]) * spacing,
        np.sort(y[0]) * spacing,
        jnp.fft.fftshift(values, (-2, -1)).reshape(heights.shape),
        jnp.broadcast_to(jnp.fft.fftshift(pairs, (-2, -1)), values.shape).reshape(heights.shape),
    )


def _separations(separations: Any, shape: tuple[int, ...]) -> np.ndarray | Array:
    if separations is None:
        return _grid.default_scales((shape[-2], shape[-1])).astype(np.int32)
    half = min(shape[-2:]) // 2
    return _maps.check_scales("separations", separations, low=1, high=half, limit="L/2")
