r"""Curve: the one currency between measuring and fitting.

A curve is a function of scale, measured once on each surface. Surfaces are the independent things,
so means, errors and covariances are all taken over surfaces; points of one curve are correlated and
nothing here pretends otherwise.

A sample may carry a weight, the number of things it averages over (loops in a bin, valid pairs).
The mean is then the ratio estimator $\bar y = \sum_i w_i y_i / \sum_i w_i$ and its covariance
$n/(n-1) \sum_i w_i w'_i (y_i - \bar y)(y'_i - \bar y') / (\sum w \sum w')$, which with equal
weights are the ordinary ones.
"""

from collections.abc import Iterable, Sequence
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

#: kind -> (symbol of the scale, symbol of the value), as the paper writes them.
SYMBOLS: dict[str, tuple[str, str]] = {
    "spectrum": (r"$q$", r"$S(q)$"),
    "directional_spectrum": (r"$q$", r"$S(q)$"),
    "line_spectrum": (r"$q$", r"$S_1(q)$"),
    "line_variance": (r"$L_0$", r"$w^2(L_0)$"),
    "height_correlation": (r"$r$", r"$D_2(r)$"),
    "curvature_moment": (r"$b$", r"$\langle C_b^q \rangle$"),
    "curvature_ratio": (r"$b$", r"$\langle C_b^4\rangle/\langle C_b^2\rangle^2$"),
    "curvature_skewness": (r"$b$", r"$\langle C_b^3\rangle/\langle C_b^2\rangle^{3/2}$"),
    "patch_moment": (r"$b$", r"$\langle (h-\bar h_b)^q \rangle_b$"),
    "patch_skewness": (r"$b$", r"$m_3/m_2^{3/2}$"),
    "smoothed_moment": (r"$b$", r"$\langle (H_b-\bar h)^q \rangle$"),
    "smoothed_skewness": (r"$b$", r"skewness of $H_b$"),
    "height_skewness": (r"$L$", r"skewness of $h$"),
    "height_kurtosis": (r"$L$", r"excess kurtosis of $h$"),
    "width": (r"$t$", r"$w^2(t)$"),
    "width_increment": (r"$t$", r"$w^2(2t) - w^2(t)$"),
    "mean_length": (r"$R$", r"$\langle s \rangle(R)$"),
    "length_tail": (r"$s$", r"$P_>(s)$"),
    "loop_correlation": (r"$r$", r"$G(r)$"),
    "open_share": (r"$R$", r"open share"),
    "area_tail": (r"$A$", r"$N(>A)$"),
    "area_distribution": (r"$A$", r"$n(A)$"),
    "perimeter_of_area": (r"$A$", r"$\langle s \rangle(A)$"),
}

Values = Float[Array | np.ndarray, "*stack surface scale"]


class Curve(eqx.Module):
    """A measured function of scale: one row of samples a surface.

    A pytree: its arrays can be differentiated and vmapped, and a vmapped curve has a leading stack
    axis on each array (take one of the stack by `curve[i]`).

    Attributes:
        kind: which measure, e.g. "spectrum" or "curvature_moment"; a key of `SYMBOLS`.
        scale: where it was measured, ascending, in `units[0]`.
        samples: one row a surface, in `units[1]`; zero where the weight is zero.
        weights: what each sample counts for in the mean; zero marks a missing sample.
        units: of the scale and of the value.
        details: what else a reader or a fit must know, as (name, value) pairs: the order of a
            moment, the direction, "side" (the map's smaller side, in the scale's unit of length).

    Raises:
        ValueError: arrays whose shapes do not fit each other.
    """

    kind: str = eqx.field(static=True)
    scale: Float[Array | np.ndarray, "*stack scale"]
    samples: Values
    weights: Values
    units: tuple[str, str] = eqx.field(static=True)
    details: tuple[tuple[str, Any], ...] = eqx.field(static=True)

    def __init__(
        self,
        kind: str,
        scale: Any,
        samples: Any,
        weights: Any = None,
        *,
        units: tuple[str, str] = ("sites", "1"),
        details: Iterable[tuple[str, Any]] = (),
    ):
        samples = samples if hasattr(samples, "ndim") else np.asarray(samples, float)
        scale = scale if hasattr(scale, "ndim") else np.asarray(scale, float)
        if samples.ndim < 2 or scale.shape[-1:] != samples.shape[-1:]:
            raise ValueError(
                "samples must be [surface, scale] and scale [scale]; got "
                f"{samples.shape} and {scale.shape}. Put one row of samples a surface."
            )
        if weights is None:
            weights = (jnp if _is_jax(samples) else np).ones_like(samples)
        if weights.shape != samples.shape:
            raise ValueError(
                f"weights must have the shape of samples, {samples.shape}; got {weights.shape}. "
                "Pass one weight a sample, zero where it is missing."
            )
        self.kind = kind
        self.scale = scale
        self.samples = samples
        self.weights = weights
        self.units = units
        self.details = tuple(details)

    @property
    def surfaces(self) -> int:
        """The number of surfaces measured."""
        return self.samples.shape[-2]

    @property
    def count(self) -> Float[Array | np.ndarray, "*stack scale"]:
        """The total weight behind each point; zero where the scale is missing."""
        return self.weights.sum(-2)

    @property
    def missing(self) -> Bool[Array | np.ndarray, "*stack scale"]:
        """True at scales that no surface has a sample for."""
        return self.count == 0

    @property
    def mean(self) -> Float[Array | np.ndarray, "*stack scale"]:
        """The weighted mean over surfaces; zero, with `count` zero, where the scale is missing."""
        return (self.weights * self.samples).sum(-2) / self._safe_count()

    @property
    def stderr(self) -> Float[Array | np.ndarray, "*stack scale"]:
        """The standard error of `mean` from the scatter between surfaces (two or more)."""
        pull = self._pulls()
        return ((pull**2).sum(-2) * self._inflation()) ** 0.5

    def covariance(self) -> Float[Array | np.ndarray, "*stack scale scale"]:
        """The covariance matrix of `mean` from the scatter between surfaces (two or more)."""
        pull = self._pulls()
        return pull.swapaxes(-1, -2) @ pull * self._inflation()

    def detail(self, name: str, default: Any = None) -> Any:
        """One of `details` by its name."""
        return dict(self.details).get(name, default)

    def window(self, low: float | int, high: float | int) -> "Curve":
        """The part of the curve with low <= scale <= high, missing scales left out."""
        keep = np.asarray((self.scale >= low) & (self.scale <= high) & ~self.missing)
        return self._with(self.scale[keep], self.samples[:, keep], self.weights[:, keep])

    def present(self) -> "Curve":
        """The curve without its missing scales."""
        return self.window(-np.inf, np.inf)

    def in_units(self, scale: str, value: str) -> "Curve":
        """The same numbers with their units named, e.g. "nm" for both."""
        return Curve(
            self.kind,
            self.scale,
            self.samples,
            self.weights,
            units=(scale, value),
            details=self.details,
        )

    def resample(self, surfaces: Sequence[int] | np.ndarray) -> "Curve":
        """The curve of the given surfaces, repeats allowed: a bootstrap draw or a jackknife."""
        rows = np.asarray(surfaces)
        return self._with(self.scale, self.samples[rows], self.weights[rows])

    def __getitem__(self, index: int) -> "Curve":
        """One curve of a vmapped stack."""
        if self.samples.ndim < 3:
            raise TypeError(
                "this Curve is not a stack: use .samples[i] for the samples of surface i."
            )
        return self._with(self.scale[index], self.samples[index], self.weights[index])

    def __repr__(self) -> str:
        if not all(hasattr(x, "shape") for x in (self.scale, self.samples)):
            return f"Curve({self.kind!r}, ...)"
        extra = "".join(f", {name}={value}" for name, value in self.details)
        head = f"Curve({self.kind!r}{extra}: "
        if self.samples.ndim != 2 or not _is_concrete(self.samples):
            return head + f"samples {self.samples.shape})"
        body = f"{self.surfaces} surface{'s' * (self.surfaces != 1)} x {len(self.scale)} scales"
        if len(self.scale):
            body += f" {float(self.scale[0]):.4g}...{float(self.scale[-1]):.4g} {self.units[0]}"
        if gone := int(np.count_nonzero(np.asarray(self.missing))):
            shown = ", ".join(
                f"{s:.4g}" for s in np.asarray(self.scale)[np.asarray(self.missing)][:4]
            )
            body += f"; {gone} missing (nothing to average): {shown}{', ...' * (gone > 4)}"
        return head + body + ")"

    def _repr_html_(self) -> str:
        """A table of scale, mean and error for notebooks."""
        if self.samples.ndim != 2 or not _is_concrete(self.samples):
            return f"<code>{repr(self)}</code>"
        errors = np.asarray(self.stderr) if self.surfaces > 1 else np.full(len(self.scale), np.nan)
        columns = zip(
            np.asarray(self.scale),
            np.asarray(self.mean),
            errors,
            np.asarray(self.count),
            strict=True,
        )
        rows = "".join(
            f"<tr><td>{s:.4g}</td><td>{'missing' if c == 0 else f'{m:.5g}'}</td>"
            f"<td>{'' if c == 0 or np.isnan(e) else f'{e:.2g}'}</td><td>{c:.6g}</td></tr>"
            for s, m, e, c in columns
        )
        names = SYMBOLS.get(self.kind, ("scale", "value"))
        return (
            f"<details open><summary><code>{repr(self)}</code></summary><table><thead><tr>"
            f"<th>{names[0]} [{self.units[0]}]</th><th>{names[1]} [{self.units[1]}]</th>"
            f"<th>standard error</th><th>count</th></tr></thead><tbody>{rows}</tbody></table>"
            "</details>"
        )

    def _with(self, scale: Any, samples: Any, weights: Any) -> "Curve":
        return Curve(self.kind, scale, samples, weights, units=self.units, details=self.details)

    def _safe_count(self) -> Any:
        count = self.count
        xp = jnp if _is_jax(count) else np
        return xp.where(count == 0, xp.ones_like(count), count)

    def _pulls(self) -> Any:
        centred = self.samples - self.mean[..., None, :]
        return self.weights * centred / self._safe_count()[..., None, :]

    def _inflation(self) -> float:
        if self.surfaces < 2:
            raise ValueError(
                "an error over surfaces needs at least 2 of them; got 1. "
                "Measure more surfaces, or cut the map into quarters."
            )
        return self.surfaces / (self.surfaces - 1)


def concatenate(curves: Sequence[Curve]) -> Curve:
    """One curve over the surfaces of all the given ones, which must share kind, scales and units.

    Arguments:
        curves: batches of one measurement.

    Returns:
        A `Curve` whose rows are theirs, in order.

    Raises:
        ValueError: no curves, or curves of different kinds, scales, units or details.
    """
    if not curves:
        raise ValueError("curves must not be empty; got []. Pass the batches to join.")
    first = curves[0]
    for other in curves[1:]:
        for name in ("kind", "units", "details"):
            if getattr(other, name) != getattr(first, name):
                raise ValueError(
                    f"curves to join must share {name}; got {getattr(first, name)!r} and "
                    f"{getattr(other, name)!r}. Join only batches of one measurement."
                )
        if other.scale.shape != first.scale.shape or not np.allclose(other.scale, first.scale):
            raise ValueError(
                f"curves to join must share their scales; got {first!r} and {other!r}. "
                "Measure every batch at the same scales."
            )
    samples = [c.samples for c in curves]
    join = jnp.concatenate if any(map(_is_jax, samples)) else np.concatenate
    return first._with(first.scale, join(samples, -2), join([c.weights for c in curves], -2))


def _is_jax(array: Any) -> bool:
    return not isinstance(array, np.ndarray)


def _is_concrete(array: Any) -> bool:
    from jaxsurf._checks import is_traced

    return not is_traced(array)
