r"""Exponents of contour loops as functions of the roughness exponent alpha, and back.

Two scaling relations and a conjecture carry everything. Hyperscaling $D_f (\tau - 1) = 2 - \alpha$
(Eq. scaling2), the sum rule $D_f (3 - \tau) = 2 - 2 x_l$ (Eq. scaling1), and the super-universal
$x_l = 1/2$ (Eq. loopcorr-conj) give $D_f = (3 - \alpha)/2$ and
$\tau - 1 = (4 - 2\alpha)/(3 - \alpha)$. Beyond the correlation length loops are hulls of
percolation clusters, whatever alpha is (Eq. perc_results).

Every function takes a number or an array (NumPy or JAX, differentiable) and returns the like, for
-1 <= alpha < 2, where alpha = -1 is white noise. The two scaling relations hold for percolation
hulls too, which sit at alpha = -3/4; only their x_l = 5/8 is not the conjectured 1/2.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

__all__ = [
    "LOOP_CORRELATION",
    "PERCOLATION",
    "SCALING_FORMS",
    "Estimate",
    "LoopExponents",
    "ScalingForm",
    "alpha_from_correlation",
    "alpha_from_fractal_dimension",
    "alpha_from_length_exponent",
    "alpha_from_length_tail",
    "correlation_exponent",
    "fractal_dimension",
    "fractal_dimension_general",
    "fractal_dimension_isichenko",
    "island_exponent",
    "length_exponent",
    "length_exponent_general",
    "length_tail_exponent",
    "level_set_dimension",
    "loop_exponents",
    "radius_tail_exponent",
    "spectrum_exponent",
]

#: x_l = 1/2, conjectured for every alpha, exact at alpha = 0 and 1 (Eq. loopcorr-conj).
LOOP_CORRELATION = 0.5


class LoopExponents(NamedTuple):
    """The three geometrical exponents of a loop ensemble."""

    fractal_dimension: Any
    length_exponent: Any
    correlation_exponent: Any


#: Hulls of critical percolation clusters: D_f = 7/4, tau = 18/7, x_l = 5/8 (Eq. perc_results).
PERCOLATION = LoopExponents(7 / 4, 18 / 7, 5 / 8)


class Estimate(NamedTuple):
    """A value with its standard error."""

    value: Any
    stderr: Any


def fractal_dimension(alpha: Any) -> Any:
    r"""Fractal dimension of a contour loop, $D_f = (3 - \alpha)/2$ (Eq. Df-alpha).

    >>> fractal_dimension(0.4)
    1.3
    """
    return (3 - _checked(alpha)) / 2


def length_exponent(alpha: Any) -> Any:
    r"""Exponent of loop lengths, $\tau = 1 + (4 - 2\alpha)/(3 - \alpha)$ (Eq. Df-alpha).

    The number of loops of length s falls as $\tilde P(s) \sim s^{-\tau}$.
    """
    return 1 + (4 - 2 * _checked(alpha)) / (3 - alpha)


def length_tail_exponent(alpha: Any) -> Any:
    r"""Exponent of $P_>(s) \sim s^{-(\tau - 2)}$ at a random point: $(1-\alpha)/(3-\alpha)$."""
    return (1 - _checked(alpha)) / (3 - alpha)


def correlation_exponent(alpha: Any) -> Any:
    r"""Loop correlation exponent $x_l = 1/2$ in $G(r) \sim r^{-2 x_l}$ (Eq. loopcorr-conj)."""
    return 0 * _checked(alpha) + LOOP_CORRELATION


def loop_exponents(alpha: Any) -> LoopExponents:
    """D_f, tau and x_l of a self-affine Gaussian surface together."""
    return LoopExponents(
        fractal_dimension(alpha), length_exponent(alpha), correlation_exponent(alpha)
    )


def fractal_dimension_general(alpha: Any, x_l: Any) -> Any:
    r"""$D_f = 2 - x_l - \alpha/2$ before the conjecture on x_l (Eq. results1)."""
    return 2 - x_l - _checked(alpha) / 2


def length_exponent_general(alpha: Any, x_l: Any) -> Any:
    r"""$\tau = 1 + (2 - \alpha)/(2 - x_l - \alpha/2)$ before the conjecture (Eq. results2)."""
    return 1 + (2 - _checked(alpha)) / fractal_dimension_general(alpha, x_l)


def level_set_dimension(alpha: Any) -> Any:
    r"""Dimension of a whole level set, all its loops together, $D = 2 - \alpha$ (Eq. man)."""
    return 2 - _checked(alpha)


def island_exponent(alpha: Any) -> Any:
    r"""Exponent of island areas, $\tau_{ZO} = 2 - \alpha/2$ (Olami & Zeitak; Sec. IV B)."""
    return 2 - _checked(alpha) / 2


def radius_tail_exponent(alpha: Any) -> Any:
    r"""$D_f (\tau - 2) = (1 - \alpha)/2$: power of R in the chance of a wider loop (Sec. V C)."""
    return (1 - _checked(alpha)) / 2


def fractal_dimension_isichenko(alpha: Any) -> Any:
    r"""Isichenko's approximate $D_f = (10 - 3\alpha)/7$ (Eq. isichdim), wrong at alpha = 0."""
    return (10 - 3 * _checked(alpha)) / 7


def spectrum_exponent(alpha: Any) -> Any:
    r"""Exponent of the spectrum, $S(q) \sim q^{-2(1+\alpha)}$ (Eq. hqvar), as a negative power."""
    return -2 * (1 + _checked(alpha))


def alpha_from_fractal_dimension(D_f: Any, stderr: Any = None) -> Any:  # noqa: N803
    r"""Roughness exponent from a loop's fractal dimension, $\alpha = 3 - 2 D_f$ (Eq. Df-alpha).

    Arguments:
        D_f: fractal dimension.
        stderr: its standard error; given, an `Estimate` with $\sigma_\alpha = 2\sigma$ is returned.

    >>> alpha_from_fractal_dimension(1.35, stderr=0.02)
    Estimate(value=0.2999999999999998, stderr=0.04)
    """
    return _propagate(3 - 2 * D_f, 2, stderr)


def alpha_from_length_exponent(tau: Any, stderr: Any = None) -> Any:
    r"""Roughness exponent from tau: $\alpha = (1 - 3t)/(1 - t)$, $t = \tau - 2$ (Eq. Df-alpha).

    With `stderr` given an `Estimate` is returned, its error $2\sigma/(1-t)^2$ (two of the paper's
    Table II are smaller than that).
    """
    return alpha_from_length_tail(tau - 2, stderr)


def alpha_from_length_tail(tail: Any, stderr: Any = None) -> Any:
    r"""Roughness exponent from $t = \tau - 2$, the exponent of $P_>(s)$ (Eq. Df-alpha)."""
    return _propagate((1 - 3 * tail) / (1 - tail), 2 / (1 - tail) ** 2, stderr)


def alpha_from_correlation(slope: Any, stderr: Any = None) -> Any:
    r"""Roughness exponent from the slope of $\ln D_2$ or $\ln\langle C_b^2\rangle$, $2\alpha$."""
    return _propagate(slope / 2, 0.5, stderr)


@dataclass(frozen=True)
class ScalingForm:
    r"""A measure whose power law is cut at a length, $y = x^p f(x / \xi^d)$ (Eq. scross).

    Attributes:
        kind: the `Curve.kind` it describes.
        exponent: alpha -> p, the power below the cut.
        scale_dimension: alpha -> d, so that x is compared with xi^d (or L^d).
        percolation: the power above the cut when xi is a correlation length.
    """

    kind: str
    exponent: Callable[[Any], Any]
    scale_dimension: Callable[[Any], Any]
    percolation: float

    def crossover_power(self, alpha: Any) -> Any:
        """The power f must take at infinity to join the percolation exponent (Sec. IV F 1)."""
        return self.percolation - self.exponent(alpha)


#: Eq. FSSform and Eq. scross. P_> is written with its own exponent -(tau - 2); the spectrum in q.
SCALING_FORMS: dict[str, ScalingForm] = {
    form.kind: form
    for form in (
        ScalingForm("mean_length", fractal_dimension, lambda alpha: 0 * alpha + 1.0, 7 / 4),
        ScalingForm("length_tail", lambda a: -length_tail_exponent(a), fractal_dimension, -4 / 7),
        ScalingForm(
            "loop_correlation",
            lambda a: -2 * correlation_exponent(a),
            lambda alpha: 0 * alpha + 1.0,
            -5 / 4,
        ),
        ScalingForm("spectrum", spectrum_exponent, lambda alpha: 0 * alpha - 1.0, 0.0),
        ScalingForm(
            "curvature_moment", lambda a: 2 * _checked(a), lambda alpha: 0 * alpha + 1.0, 0.0
        ),
    )
}


def _propagate(value: Any, derivative: Any, stderr: Any) -> Any:
    return value if stderr is None else Estimate(value, abs(derivative) * stderr)


def _checked(alpha: Any) -> Any:
    """`alpha` itself, once seen to lie in [-1, 2) if it can be read."""
    try:
        outside = bool(((alpha < -1) | (alpha >= 2)).any()) if hasattr(alpha, "any") else None
    except Exception as error:  # a JAX tracer cannot be read; anything else is not ours to hide
        if "Tracer" not in type(error).__name__:
            raise
        return alpha
    if outside is None:
        outside = not -1 <= alpha < 2
    if outside:
        raise ValueError(
            f"alpha must lie in [-1, 2); got {alpha}. "
            "Rough self-affine surfaces have 0 <= alpha <= 1, white noise alpha = -1."
        )
    return alpha
