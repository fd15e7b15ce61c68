r"""Scale-dependent curvature: the second difference of the heights at scale b.

The second derivative of a self-affine surface is dominated by the lattice. Replacing it by a second
difference over a distance b,

$$C_b(x) = \sum_m [h(x + b e_m) - h(x)],$$

with M offsets that sum to zero, gives a field blind to the mean and the tilt of the map. Its
variance carries the roughness exponent, $\langle C_b^2 \rangle \sim b^{2\alpha}$; its odd moments
the up/down asymmetry that no quadratic measure can see; and if the heights are Gaussian
$\langle C_b^4 \rangle/\langle C_b^2 \rangle^2 = 3$.

Array-level core: `moments`, several orders in one pass.

Source: the paper's Sec. II C, Eqs. (curv_def), (curv_scale), (curv2), (curv4).
"""

from typing import Any

import numpy as np
from jaxtyping import Array, Bool, Float, Int

from jaxsurf import _grid
from jaxsurf._checks import check_choice
from jaxsurf.curve import Curve
from jaxsurf.laws import DIRECTIONS
from jaxsurf.measures import _maps
from jaxsurf.measures._maps import Heights, Units
from jaxsurf.measures._ratios import ensemble_ratio
from jaxsurf.measures._stencils import Stencil, stencil_moments


def moments(
    heights: Float[Array, "surface x y"],
    scales: Int[Array | np.ndarray, " scale"],
    mask: Bool[Array, "surface x y"] | None = None,
    *,
    orders: tuple[int, ...] = (2,),
    offsets: Stencil = DIRECTIONS["10"],
    boundary: str = "periodic",
) -> tuple[Float[Array, "order surface scale"], Float[Array, "surface scale"]]:
    r"""Means of $C_b^q$ over the sites where C_b exists, and the number of those sites.

    Arguments:
        heights: maps; finite outside the mask.
        scales: b in sites; any values without recompilation.
        mask: true on valid sites.
        orders: the moments q, computed in one pass.
        offsets: the M vectors e_m, in sites at b = 1; they must sum to zero.
        boundary: "open" uses only the sites whose M neighbours lie inside the map.
    """
    return stencil_moments(
        heights,
        scales,
        mask,
        stencils=(tuple(offsets),),
        orders=tuple(orders),
        boundary=boundary,
        absolute=False,
    )


@_maps.in_their_own_dtype
def curvature_moment(
    heights: Heights,
    scales: Any = None,
    *,
    order: int = 2,
    direction: str = "10",
    offsets: Any = None,
    spacing: float = 1.0,
    boundary: str = "periodic",
    mask: Any = None,
    units: Units = ("sites", "1"),
) -> Curve:
    r"""Moment of the scale-dependent curvature.

    $$\langle C_b^q \rangle, \qquad C_b(x) = \sum_m [h(x + b e_m) - h(x)]$$

    A self-affine surface has $\langle C_b^q \rangle \sim b^{q\alpha}$ for even q; odd moments
    vanish if h -> -h is a symmetry; $\langle C_b^4 \rangle = 3 \langle C_b^2 \rangle^2$ if the
    heights are Gaussian.

    Arguments:
        heights: maps `[..., x, y]`, each a surface; the dtype is kept.
        scales: offsets b in sites, ascending, 1 <= b <= L/2; None for 1 ... L/4. Any values without
            recompilation.
        order: the moment q >= 1.
        direction: "10" or "11"; along "11" the offset (b, b) has length sqrt(2) b, which is the
            curve's scale.
        offsets: the vectors e_m in place of a direction, whole numbers `[M, 2]` that sum to zero.
            The curve's scale is b times their root mean square length.
        spacing: lattice constant; the curve's scale is in its unit.
        boundary: "periodic", or "open" for maps that do not wrap round.
        mask: true on valid sites, `[x, y]` or the shape of `heights`.
        units: of length and of height.

    Returns:
        A `Curve` over the offset length, in height^q, differentiable in the heights. Its weights
        are the numbers of sites averaged over; a scale without any has count zero.

    Raises:
        TypeError: heights or mask of the wrong kind.
        ValueError: scales, order, direction, offsets or boundary out of range; heights not finite.

    Source: Eqs. (curv_def), (curv_scale), (curv4).

    >>> import jax
    >>> heights = jax.random.normal(jax.random.key(0), (3, 64, 64))
    >>> curvature_moment(heights, [1, 2, 4])
    Curve('curvature_moment', order=2, direction=10, side=64.0: 3 surfaces x 3 scales 1...4 sites)
    """
    order = _maps.check_order(order)
    maps, valid = _maps.read(heights, mask, boundary=boundary, spacing=spacing)
    stencil, name = _stencil(direction, offsets)
    b = _scales(scales, maps.shape, stencil)
    mean, count = moments(maps, b, valid, orders=(order,), offsets=stencil, boundary=boundary)
    return Curve(
        "curvature_moment",
        b * (spacing * _length(stencil)),
        mean[0],
        count,
        units=(units[0], _maps.power_of(units[1], order)),
        details=(("order", order), ("direction", name), _maps.side(maps, spacing)),
    )


def curvature_ratio(heights: Heights, scales: Any = None, **options: Any) -> Curve:
    r"""Fourth moment of the curvature over the square of the second: 3 for Gaussian heights.

    $$\langle C_b^4 \rangle / \langle C_b^2 \rangle^2$$

    Arguments:
        heights: maps `[..., x, y]`, each a surface.
        scales: offsets b in sites, as in `curvature_moment`.
        options: direction, offsets, spacing, boundary, mask and units of `curvature_moment`.

    Returns:
        A `Curve` whose mean is the ratio of the ensemble's moments; its samples are jackknife
        pseudo-values (see `_ratios`), one a surface.

    Raises:
        TypeError: heights or mask of the wrong kind.
        ValueError: as `curvature_moment`.

    Source: Eq. (curv4).
    """
    return _standardised(heights, scales, kind="curvature_ratio", upper=4, **options)


def curvature_skewness(heights: Heights, scales: Any = None, **options: Any) -> Curve:
    r"""Skewness of the curvature: zero if h -> -h is a symmetry.

    $$\langle C_b^3 \rangle / \langle C_b^2 \rangle^{3/2}$$

    Its sign may change with b; report the curve, not a sign.

    Arguments:
        heights: maps `[..., x, y]`, each a surface.
        scales: offsets b in sites, as in `curvature_moment`.
        options: direction, offsets, spacing, boundary, mask and units of `curvature_moment`.

    Returns:
        A `Curve` whose mean is the ratio of the ensemble's moments; its samples are jackknife
        pseudo-values (see `_ratios`), one a surface.

    Raises:
        TypeError: heights or mask of the wrong kind.
        ValueError: as `curvature_moment`.

    Source: Eq. (curv_scale), Table III.
    """
    return _standardised(heights, scales, kind="curvature_skewness", upper=3, **options)


@_maps.in_their_own_dtype
def _standardised(
    heights: Heights,
    scales: Any,
    *,
    kind: str,
    upper: int,
    direction: str = "10",
    offsets: Any = None,
    spacing: float = 1.0,
    boundary: str = "periodic",
    mask: Any = None,
    units: Units = ("sites", "1"),
) -> Curve:
    """<C^upper>/<C^2>^(upper/2)."""
    maps, valid = _maps.read(heights, mask, boundary=boundary, spacing=spacing)
    stencil, name = _stencil(direction, offsets)
    b = _scales(scales, maps.shape, stencil)
    mean, count = moments(maps, b, valid, orders=(upper, 2), offsets=stencil, boundary=boundary)
    return Curve(
        kind,
        b * (spacing * _length(stencil)),
        ensemble_ratio(mean[0], mean[1], count, upper / 2),
        count,
        units=(units[0], "1"),
        details=(("direction", name), _maps.side(maps, spacing)),
    )


def _stencil(direction: str, offsets: Any) -> tuple[Stencil, str]:
    """The offsets e_m as tuples of ints, and what to call them."""
    if offsets is None:
        check_choice("direction", direction, DIRECTIONS)
        return DIRECTIONS[direction], direction
    vectors = np.asarray(offsets)
    remedy = "Pass e.g. [[1, 0], [-1, 0]] for the second difference along one axis."
    if vectors.ndim != 2 or vectors.shape[1] != 2 or not np.all(vectors == np.round(vectors)):
        raise ValueError(f"offsets must be whole vectors [M, 2]; got {offsets!r}. {remedy}")
    if np.any(vectors.sum(0) != 0) or not np.any(vectors):
        raise ValueError(f"offsets must sum to zero and not all vanish; got {offsets!r}. {remedy}")
    return tuple((int(dx), int(dy)) for dx, dy in vectors), "offsets"


def _scales(scales: Any, shape: tuple[int, ...], stencil: Stencil) -> np.ndarray | Array:
    if scales is None:
        reach = max(abs(step) for e in stencil for step in e)
        standard = _grid.default_scales((shape[-2], shape[-1]))
        return standard[standard * reach <= max(min(shape[-2:]) // 2, reach)].astype(np.int32)
    return _maps.check_scales("scales", scales, low=1, high=min(shape[-2:]) // 2, limit="L/2")


def _length(stencil: Stencil) -> float:
    """Root mean square length of the offsets at b = 1, in sites."""
    return float(np.sqrt(np.mean(np.sum(np.square(stencil), -1))))
