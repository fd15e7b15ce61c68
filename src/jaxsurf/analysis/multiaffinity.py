r"""Multiaffinity: is one exponent enough?

A self-affine surface has one exponent, $D_q(r) \sim r^{\alpha_q}$ with $\alpha_q = q\alpha$
for every q. On a multiaffine one $\alpha_q/q$ falls with q: its large differences, which the high
orders see, scale otherwise than its typical ones. Whether growing surfaces are multiaffine is the
paper's open question; a Gaussian surface is not, whatever its spectrum, since there
$D_q = c_q D_2^{q/2}$.

The exponents are slopes of $\ln D_q$ against $\ln r$ over one window for all orders. They are
strongly correlated, since they come from the same differences, so that the test takes their full
covariance over surfaces: with p contrasts $\delta = \alpha_q/q - \alpha_{q'}/q'$ and n surfaces,
Hotelling's $T^2 = \delta^T C^{-1} \delta$ follows $p(n-1)/(n-p)\, F_{p, n-p}$ if all are equal.

Source: the paper's Sec. II A and Sec. VI; H. Hotelling, Ann. Math. Stat. 2, 360 (1931).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from jaxsurf import _grid
from jaxsurf._checks import check_choice, check_in_range
from jaxsurf.laws import DIRECTIONS
from jaxsurf.measures import _maps
from jaxsurf.measures._stencils import stencil_moments
from jaxsurf.measures.differences import STEPS

MEASURES = {"differences": STEPS["10"], "curvature": (DIRECTIONS["10"],)}


@dataclass(frozen=True, repr=False)
class GeneralisedExponents:
    r"""The exponents $\alpha_q$ of one ensemble, and the test of $\alpha_q = q\alpha$.

    Attributes:
        measure: "differences", D_q(r), or "curvature", the moments of |C_b|.
        orders: the q, ascending.
        exponents: alpha_q, one an order.
        covariance: of the exponents, over surfaces.
        systematic: half the difference between the slopes in the lower and the upper half of the
            window, one an order.
        alpha: the common exponent, the least-variance mean of alpha_q / q; and its standard error.
        p_value: the chance of departures this large from alpha_q = q alpha if it holds.
        window: the scales fitted, in sites.
        surfaces: how many were measured.
    """

    measure: str
    orders: Float[np.ndarray, " order"]
    exponents: Float[np.ndarray, " order"]
    covariance: Float[np.ndarray, "order order"]
    systematic: Float[np.ndarray, " order"]
    alpha: tuple[float, float]
    p_value: float
    window: tuple[float, float]
    surfaces: int

    @property
    def stderr(self) -> Float[np.ndarray, " order"]:
        """Standard errors of the exponents, over surfaces."""
        return np.sqrt(np.diagonal(self.covariance))

    def multiaffine(self, level: float = 0.01) -> bool:
        """Whether alpha_q = q alpha is refused at a level of significance."""
        check_in_range("level", level, 0, 1, closed=(False, False), remedy="Pass e.g. 0.01.")
        return self.p_value < level

    def __repr__(self) -> str:
        lines = [
            f"GeneralisedExponents({self.measure}, {self.surfaces} surfaces, "
            f"{self.window[0]:g}...{self.window[1]:g} sites: alpha = {self.alpha[0]:.4g} "
            f"± {self.alpha[1]:.2g}, p = {self.p_value:.3g} for alpha_q = q alpha)"
        ]
        rows = zip(self.orders, self.exponents, self.stderr, self.systematic, strict=True)
        for q, exponent, error, shift in rows:
            lines.append(
                f"  q = {q:<4g} alpha_q = {exponent:.4f} ± {error:.2g} (statistical) "
                f"± {shift:.2g} (systematic)   alpha_q/q = {exponent / q:.4f}"
            )
        return "\n".join(lines)


def generalised_exponents(
    heights: Any,
    orders: Sequence[float | int] = (0.5, 1, 2, 3, 4),
    *,
    measure: str = "differences",
    window: tuple[float | int, float | int] | None = None,
    boundary: str = "periodic",
    mask: Any = None,
) -> GeneralisedExponents:
    r"""The exponent curve $\alpha_q$ over a range of orders, and a test of multiaffinity.

    $$\langle |h(x + r) - h(x)|^q \rangle \sim r^{\alpha_q}, \qquad \alpha_q = q\alpha\;?$$

    Arguments:
        heights: independent maps of one kind, `[..., x, y]`, at least two more than there are
            orders; cut a single large map into tiles and pass boundary="open".
        orders: two or more q > 0, ascending. High orders rest on few large differences.
        measure: "differences", D_q along {10}; or "curvature", the moments of |C_b|, blind to tilt.
        window: the scales fitted, in sites; None for 2 ... L/8.
        boundary: "periodic", or "open" for maps that do not wrap round.
        mask: true on valid sites, `[x, y]` or the shape of `heights`.

    Returns:
        `GeneralisedExponents`: the exponents with their covariance over surfaces, the common alpha
        and the p-value of alpha_q = q alpha.

    Raises:
        TypeError: heights or mask of the wrong kind.
        ValueError: too few surfaces, orders or scales; arguments out of range.

    Source: Sec. II A; Hotelling (1931).
    """
    check_choice("measure", measure, MEASURES)
    asked = np.asarray(orders, float)
    check_in_range(
        "orders", asked, 0, np.inf, closed=(False, False), remedy="Pass e.g. (0.5, 1, 2, 3, 4)."
    )
    if asked.ndim != 1 or asked.size < 2 or np.any(np.diff(asked) <= 0):
        raise ValueError(
            f"orders must be two or more, ascending; got {orders!r}. Pass e.g. (0.5, 1, 2, 3, 4)."
        )
    side = min(heights.shape[-2:]) if getattr(heights, "ndim", 0) >= 2 else 0
    low, high = window or (2, max(side // 8, 6))
    scales = _grid.default_scales((2 * side, 2 * side), ratio=1.25)
    scales = scales[(scales >= low) & (scales <= high)].astype(np.int32)

    @_maps.in_their_own_dtype
    def measured(heights: Any) -> tuple[Any, Any]:
        maps, valid = _maps.read(heights, mask, boundary=boundary)
        return stencil_moments(
            maps,
            scales,
            valid,
            stencils=MEASURES[measure],
            orders=tuple(orders),
            boundary=boundary,
            absolute=True,
        )

    moments, count = (np.asarray(part, float) for part in measured(heights))
    surfaces = count.shape[0]
    if surfaces < asked.size + 2:
        raise ValueError(
            f"the test needs at least {asked.size + 2} surfaces for {asked.size} orders; got "
            f"{surfaces}. Measure more, or cut a large map into tiles, or ask for fewer orders."
        )
    if len(scales) < 3 or not np.all(count.sum(0) > 0):
        raise ValueError(
            f"the window must hold at least 3 scales with valid sites; got {scales.tolist()} "
            f"within {low:g}...{high:g}. Widen window."
        )
    return _tested(measure, asked, scales.astype(float), moments, count)


def _tested(
    measure: str,
    orders: Float[np.ndarray, " order"],
    scales: Float[np.ndarray, " scale"],
    moments: Float[np.ndarray, "order surface scale"],
    count: Float[np.ndarray, "surface scale"],
) -> GeneralisedExponents:
    """Slopes, their covariance over surfaces, and Hotelling's test."""
    from scipy.special import fdtrc  # kept out of `import jaxsurf`

    weight = count / count.sum(0)
    mean = (weight * moments).sum(1)
    slope = _slope_weights(scales)
    exponents = np.log(mean) @ slope
    # What each surface adds to each exponent, to first order: d ln(mean) = d mean / mean.
    relative = weight * (moments - mean[:, None]) / mean[:, None]
    pulls = relative @ slope
    surfaces = count.shape[0]
    covariance = pulls @ pulls.T * surfaces / (surfaces - 1)
    half = len(scales) // 2 + 1
    lower, upper = (
        np.log(mean[:, part]) @ _slope_weights(scales[part])
        for part in (slice(None, half), slice(-half, None))
    )
    reduced = exponents / orders
    spread = covariance / np.outer(orders, orders)
    contrasts = np.eye(orders.size)[1:] - np.eye(orders.size)[:1]
    departure = contrasts @ reduced
    precision = np.linalg.pinv(contrasts @ spread @ contrasts.T, hermitian=True)
    p, n = departure.size, surfaces
    hotelling = float(departure @ precision @ departure)
    # The least-variance mean, regressing the first alpha_q/q on the contrasts.
    gain = contrasts @ spread[:, 0]
    alpha = reduced[0] - gain @ precision @ departure
    error = np.sqrt(max(spread[0, 0] - gain @ precision @ gain, 0.0))
    return GeneralisedExponents(
        measure=measure,
        orders=orders,
        exponents=exponents,
        covariance=covariance,
        systematic=np.abs(upper - lower) / 2,
        alpha=(float(alpha), float(error)),
        p_value=float(fdtrc(p, n - p, hotelling * (n - p) / (p * (n - 1)))),
        window=(float(scales[0]), float(scales[-1])),
        surfaces=surfaces,
    )


def _slope_weights(scales: Float[np.ndarray, " scale"]) -> Float[np.ndarray, " scale"]:
    """What ln y at each scale counts for in the least-squares slope against ln scale."""
    x = np.log(scales)
    return (x - x.mean()) / np.sum((x - x.mean()) ** 2)
