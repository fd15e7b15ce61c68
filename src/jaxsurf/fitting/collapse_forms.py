r"""Scaling forms for a data collapse: which combinations of x, y and L fall on one curve.

An `Ansatz` maps a measured point (x, y) at size L to scaled coordinates (X, Y) such that, with the
right exponents, $Y = F(X)$ for one master curve F whatever L. The paper's three (Eq. FSSform), the
spectrum's (Eq. hcross) and those of the height correlation and the curvature variance are given;
any other is a function of one's own.

With time in place of size, L stands for $t^{1/z}$ (Eq. dynamical) and z is fitted too.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from jaxsurf import theory

#: (x, y, L, parameters) -> (X, Y), built from operations that JAX can trace.
Transform = Callable[[Any, Any, Any, Mapping[str, Any]], tuple[Any, Any]]


@dataclass(frozen=True)
class Ansatz:
    """A scaling form with its parameters.

    Attributes:
        name: in words, for reports.
        start: (parameter, starting value) pairs.
        transform: (x, y, L, parameters) -> (X, Y).
        of_alpha: alpha -> its exponents by theory, for collapses with one shared alpha; exponents
            it does not name stay free.
    """

    name: str
    start: tuple[tuple[str, float], ...]
    transform: Transform
    of_alpha: Callable[[Any], Mapping[str, Any]] | None = None

    def sharing_alpha(self) -> "Ansatz":
        """The same form with its exponents tied to one alpha by theory."""
        if self.of_alpha is None:
            raise ValueError(
                f"share_alpha needs an ansatz that knows its exponents as functions of alpha; got "
                f"{self.name!r}. Pass Ansatz(..., of_alpha=...) or share_alpha=False."
            )
        return _sharing_alpha(self, self.of_alpha)

    def in_time(self) -> "Ansatz":
        """The same form with t^(1/z) in place of L."""
        return _in_time(self)


@lru_cache(maxsize=64)  # one function object a form, so that it is compiled once
def _sharing_alpha(form: Ansatz, of_alpha: Callable[[Any], Mapping[str, Any]]) -> Ansatz:
    inner = form.transform
    tied = dict(of_alpha(0.4))
    free = tuple(pair for pair in form.start if pair[0] not in (*tied, "alpha"))

    def transform(x: Any, y: Any, size: Any, values: Mapping[str, Any]) -> tuple[Any, Any]:
        return inner(x, y, size, {**values, **of_alpha(values["alpha"])})

    return Ansatz(f"{form.name}, alpha shared", (("alpha", 0.4), *free), transform)


@lru_cache(maxsize=64)
def _in_time(form: Ansatz) -> Ansatz:
    inner = form.transform

    def transform(x: Any, y: Any, time: Any, values: Mapping[str, Any]) -> tuple[Any, Any]:
        return inner(x, y, time ** (1 / values["z"]), values)

    return Ansatz(f"{form.name} in time", (*form.start, ("z", 2.0)), transform, form.of_alpha)


def _mean_length(x: Any, y: Any, size: Any, p: Mapping[str, Any]) -> tuple[Any, Any]:
    return x / size, y * x ** -p["D_f"]


def _length_tail(x: Any, y: Any, size: Any, p: Mapping[str, Any]) -> tuple[Any, Any]:
    return x * size ** -p["D_f"], y * x ** p["tau_minus_2"]


def _loop_correlation(x: Any, y: Any, size: Any, p: Mapping[str, Any]) -> tuple[Any, Any]:
    return x / size, y * x ** p["two_x_l"]


def _spectrum(x: Any, y: Any, size: Any, p: Mapping[str, Any]) -> tuple[Any, Any]:
    return x * size, y * x ** (2 + 2 * p["alpha"])


def _square(x: Any, y: Any, size: Any, p: Mapping[str, Any]) -> tuple[Any, Any]:
    return x / size, y * x ** (-2 * p["alpha"])


#: Curve.kind -> its scaling form.
PRESETS: dict[str, Ansatz] = {
    "mean_length": Ansatz(
        "<s> = R^D_f f(R/L)",
        (("D_f", 1.3),),
        _mean_length,
        lambda alpha: {"D_f": theory.fractal_dimension(alpha)},
    ),
    "length_tail": Ansatz(
        "P_> = s^-(tau-2) f(s/L^D_f)",
        (("D_f", 1.3), ("tau_minus_2", 0.23)),
        _length_tail,
        lambda alpha: {
            "D_f": theory.fractal_dimension(alpha),
            "tau_minus_2": theory.length_tail_exponent(alpha),
        },
    ),
    "loop_correlation": Ansatz(
        "G = r^-2x_l f(r/L)", (("two_x_l", 1.0),), _loop_correlation, lambda alpha: {}
    ),
    "spectrum": Ansatz("S = q^-2(1+alpha) f(qL)", (("alpha", 0.4),), _spectrum, lambda alpha: {}),
    "height_correlation": Ansatz(
        "D_2 = r^2alpha f(r/L)", (("alpha", 0.4),), _square, lambda alpha: {}
    ),
    "curvature_moment": Ansatz(
        "<C^2> = b^2alpha f(b/L)", (("alpha", 0.4),), _square, lambda alpha: {}
    ),
}
