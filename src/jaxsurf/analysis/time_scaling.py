r"""Roughness that grows with time: alpha, beta and z from snapshots of growth out of a flat start.

A growing surface is self-affine up to a correlation length $\xi(t) \sim t^{1/z}$ and flat beyond,
so its width grows as $w^2(L, t) \sim t^{2\beta}$, $\beta = \alpha/z$, until $\xi$ reaches L. All
of it is in one statement,

$$S(q, t) = q^{-2(1+\alpha)} f(q\, t^{1/z}),$$

so the collapse of the spectra of all times gives alpha and z together, and beta from them. The
knee of each spectrum gives $\xi(t)$ by itself, and the width gives beta by itself. On a lattice it
holds an intrinsic part of the smallest scales, $w^2 = w_i^2 + A t^{2\beta}$, which hides the power
for decades; in the increment

$$w^2(2t) - w^2(t) = A (2^{2\beta} - 1)\, t^{2\beta}$$

it cancels exactly, so beta is fitted to that. Beyond $\xi(t)$ heights are independent, and contour
loops there are hulls of percolation clusters.

Source: the paper's Sec. IV F, Eqs. (dynamical), (hcross), (scross); F. Family and T. Vicsek, J.
Phys. A 18, L75 (1985); J. Kertesz and D. E. Wolf, J. Phys. A 21, 747 (1988), on intrinsic width.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Array, Float, Num

from jaxsurf._checks import check_heights, check_in_range
from jaxsurf.curve import Curve
from jaxsurf.fitting.collapse import fit_collapse
from jaxsurf.fitting.crossover import fit_crossover
from jaxsurf.fitting.fit import Fit
from jaxsurf.fitting.power_law import fit_power_law
from jaxsurf.loops.trace import trace_loops
from jaxsurf.measures.fourier import power_spectrum

Times = Sequence[float | int] | Num[np.ndarray, " time"]

LARGEST_Q = 0.8  # beyond, the lattice bends the spectrum
DITHER = 1.0  # of whole-numbered heights before their loops are traced, in steps


@dataclass(frozen=True)
class TimeScaling:
    """How a surface roughens, and the exponents that say so.

    Attributes:
        times: of the snapshots.
        width: w^2 over time, one row a surface.
        increments: of w^2 from t to `ratio` t, one row a surface.
        spectra: time -> S(q), one row a surface.
        beta: power law of `increments`; its "exponent" is 2 beta.
        collapse: of the spectra, with "alpha" and "z".
        knees: time -> crossover fit of its spectrum, with "xi".
    """

    times: tuple[float, ...]
    width: Curve
    increments: Curve
    spectra: dict[float, Curve]
    beta: Fit
    collapse: Fit
    knees: dict[float, Fit]

    @property
    def exponents(self) -> dict[str, tuple[float, float, float]]:
        """alpha, z and beta = alpha/z of the collapse, and beta of the width's increments.

        Each with its statistical and systematic error; those of alpha/z follow from the two
        exponents', the statistical with their covariance.
        """
        fit = self.collapse
        alpha, z = fit.values["alpha"], fit.values["z"]
        gradient = np.array([1 / z if n == "alpha" else -alpha / z**2 for n in fit.names])
        shifts = [fit.systematic.get(n, 0.0) * g for n, g in zip(fit.names, gradient, strict=True)]
        found = {
            name: (fit.values[name], fit.stderr[name], fit.systematic.get(name, 0.0))
            for name in ("alpha", "z")
        }
        statistical = float(np.sqrt(gradient @ fit.covariance @ gradient))
        found["beta"] = (alpha / z, statistical, float(np.hypot(*shifts)))
        width = (self.beta.values, self.beta.stderr, self.beta.systematic)
        value, error, moved = (float(of.get("exponent", 0.0)) / 2 for of in width)
        found["beta of the width"] = (value, error, moved)
        return found

    @property
    def correlation_length(self) -> dict[float, tuple[float, float]]:
        """Time -> xi and its statistical error, of the crossover fits that converged."""
        return {
            time: (fit.values["xi"], fit.stderr["xi"])
            for time, fit in self.knees.items()
            if fit.converged
        }


def width_in_time(heights: Num[Array | np.ndarray, "time surface x y"], times: Times) -> Curve:
    r"""Squared width $w^2 = \langle (h - \bar h)^2 \rangle$ of whole maps over time.

    Arguments:
        heights: snapshots of growing surfaces.
        times: of the snapshots, ascending.

    Returns:
        A `Curve` of kind "width" over time, one row a surface.

    Source: the paper's Sec. IV F.
    """
    maps, moments = _checked(heights, times)
    centred = maps - maps.mean((-2, -1), keepdims=True)
    width = (centred**2).mean((-2, -1)).T
    return Curve("width", moments, width, units=("time", "1"), details=(("side", _side(maps)),))


def width_increments(width: Curve, ratio: float | int = 2.0) -> Curve:
    r"""How much the squared width gains from t to a multiple of t: free of any constant.

    $$w^2(t) = w_i^2 + A t^{2\beta} \quad \Rightarrow \quad
      w^2(\rho t) - w^2(t) = A (\rho^{2\beta} - 1)\, t^{2\beta}$$

    The intrinsic width $w_i$, which a lattice surface has at its smallest scales from the first
    sweeps on, cancels exactly, whereas in $w^2$ itself it outlives several decades of time.

    Arguments:
        width: of `width_in_time`.
        ratio: rho > 1; every time t of the curve whose multiple is there too gives a point.

    Returns:
        A `Curve` of kind "width_increment" over t, one row a surface.

    Raises:
        ValueError: a ratio not above 1, or without any two times that far apart.

    Source: J. Kertesz and D. E. Wolf, J. Phys. A 21, 747 (1988), on the intrinsic width.

    >>> times = np.array([1.0, 2.0, 4.0, 8.0])
    >>> width = Curve("width", times, np.array([0.7]) + 0.1 * times[None] ** 0.5)
    >>> gain = width_increments(width)
    >>> gain.scale.tolist(), (gain.mean[1:] / gain.mean[:-1]).round(6).tolist()
    ([1.0, 2.0, 4.0], [1.414214, 1.414214])
    """
    check_in_range(
        "ratio", ratio, 1, np.inf, closed=(False, False), remedy="Pass 2 for w^2(2t) - w^2(t)."
    )
    times, samples = np.asarray(width.scale, float), np.asarray(width.samples, float)
    earlier, later = np.nonzero(np.isclose(times[None, :], ratio * times[:, None], rtol=1e-6))
    if not len(earlier):
        raise ValueError(
            f"two times must stand in the ratio {ratio:g}; got {times.tolist()}. "
            "Take snapshots at t, 2t, 4t, ..., or pass their ratio."
        )
    gains = samples[:, later] - samples[:, earlier]
    details = (*width.details, ("ratio", float(ratio)))
    return Curve("width_increment", times[earlier], gains, units=width.units, details=details)


def scale_in_time(
    heights: Num[Array | np.ndarray, "time surface x y"],
    times: Times,
    *,
    window: tuple[float, float] | None = None,
    largest_q: float = LARGEST_Q,
    ratio: float | int = 2.0,
    draws: int = 100,
    progress: Callable[[float, str], None] | None = None,
) -> TimeScaling:
    r"""Exponents of growth from snapshots of many surfaces out of a flat start.

    $$S(q, t) = q^{-2(1 + \alpha)} f(q\, t^{1/z}), \qquad w^2(\rho t) - w^2(t) \sim t^{2\beta}$$

    Arguments:
        heights: periodic maps, from `grow_single_step(..., snapshots=times)` or `grow_linear`.
        times: of the snapshots, ascending, best by factors of 2.
        window: the times that the fits look at; None for all.
        largest_q: the largest wave number of the collapse, in 1/sites.
        ratio: rho of the increments, see `width_increments`.
        draws: of the bootstraps over surfaces.
        progress: called with the share of the work done, 0 to 1, and what comes next.

    Returns:
        The exponents and all curves.

    Raises:
        ValueError: fewer than 5 times in the window, or 4 pairs of them in the given ratio; fewer
            than 3 surfaces; times that are not ascending and positive, heights that do not fit
            them.

    Source: the paper's Eqs. (dynamical), (hcross).
    """
    report = progress or (lambda share, text: None)
    maps, moments = _checked(heights, times)
    low, high = window or (moments[0], moments[-1])
    inside = (moments >= low) & (moments <= high)
    report(0.0, "width and spectra")
    width = width_in_time(maps, moments)
    increments = width_increments(width, ratio)
    latest = float(high) / float(ratio)
    pairs = (increments.scale >= low) & (increments.scale <= latest)
    if inside.sum() < 5 or pairs.sum() < 4:
        raise ValueError(
            f"at least 5 times must lie in the window, with 4 pairs in the ratio {ratio:g}; got "
            f"{moments[inside].tolist()} in {(float(low), float(high))}. Take snapshots at 1, 2, "
            "4, 8, 16, ..., or pass their ratio."
        )
    spectra = {float(t): _in_float64(power_spectrum(h)) for t, h in zip(moments, maps, strict=True)}
    chosen = {t: spectra[t] for t in moments[inside].tolist()}
    beta = fit_power_law(increments, window=(float(low), latest), draws=draws)
    report(0.1, "collapse")
    collapse = fit_collapse(chosen, versus="time", window=(0.0, float(largest_q)), draws=draws)
    knees = {}
    for number, (time, spectrum) in enumerate(chosen.items()):
        report(0.4 + 0.6 * number / len(chosen), f"correlation length at t = {time:g}")
        start = {"alpha": float(np.clip(collapse.values["alpha"], 0.05, 0.95))}
        limits = {"spectrum": (0.0, float(largest_q))}
        knees[time] = fit_crossover(spectrum, windows=limits, start=start, draws=draws)
    report(1.0, "done")
    return TimeScaling(tuple(moments.tolist()), width, increments, spectra, beta, collapse, knees)


def loops_in_time(
    heights: Num[Array | np.ndarray, "time surface x y"],
    times: Times,
    *,
    points: int = 400,
    rng: np.random.Generator | int,
) -> dict[float, dict[str, Curve]]:
    r"""Contour loop statistics at each time: self-affine up to xi(t), percolation beyond.

    $$\langle s \rangle = R^{D_f} f(R/t^{1/z}), \qquad f(u) \to u^{7/4 - D_f} \text{ as } u \to
    \infty$$

    and likewise for $P_>(s)$, which turns to $s^{-4/7}$, and $G(r)$, which turns to $r^{-5/4}$.

    Percolation's exponents are those of an average over levels, a few of which are near the
    percolating one. Soon after a flat start whole-numbered heights have a handful of levels only,
    all the same on every surface, and maybe none near it: how far loops reach would depend on
    where the mean height stands between two steps. They are therefore dithered by a whole step,
    more than elsewhere. The noise has the spectrum 1, that of single-step heights beyond xi(t) is
    8 after 8 sweeps and 50 after 32: long loops are those of the heights, loops of a few sites are
    not.

    Arguments:
        heights: periodic maps, from `grow_single_step(..., snapshots=times)` or `grow_linear`.
        times: of the snapshots, ascending.
        points: starting points on each map.
        rng: a generator, or a seed.

    Returns:
        Time -> "mean_length", "length_tail" and "loop_correlation", one row a surface; each of
        them a mapping for `fit_collapse(..., versus="time")`.

    Raises:
        ValueError: times that are not ascending and positive, heights that do not fit them.

    Source: the paper's Eqs. (scross), (perc_results).
    """
    maps, moments = _checked(heights, times)
    generator = np.random.default_rng(rng)
    curves = {}
    for time, surfaces in zip(moments.tolist(), maps, strict=True):
        if np.asarray(heights).dtype.kind in "iu":
            noise = generator.standard_normal(surfaces.shape, np.float32)
            surfaces = surfaces + np.float32(DITHER) * noise
        loops = trace_loops(surfaces, points, rng=generator, correlation=True)
        curves[time] = {
            "mean_length": loops.mean_length(),
            "length_tail": loops.length_tail(share="all"),
            "loop_correlation": loops.correlation(share="all"),
        }
    return curves


def _checked(heights: Any, times: Any) -> tuple[Any, Float[np.ndarray, " time"]]:
    moments = np.asarray(list(times), float)
    if np.ndim(heights) != 4 or len(heights) != len(moments):
        raise ValueError(
            "heights must be [time, surface, x, y] with a snapshot for each time; got shape "
            f"{np.shape(heights)} for {len(moments)} times. Grow with snapshots=times and batch=."
        )
    if not np.all(np.diff(moments, prepend=0.0) > 0):
        raise ValueError(
            f"times must be positive and ascending; got {moments.tolist()}. "
            "Leave out the flat start."
        )
    check_in_range("times", moments, 0, np.inf, closed=(False, False), remedy="Pass finite times.")
    check_heights(heights)
    maps = np.asarray(heights)
    # growth may carry the maps far from zero, which float32 need not know
    return (maps - maps[..., :1, :1]).astype(np.float32), moments


def _side(maps: Any) -> float:
    return float(min(maps.shape[-2:]))


def _in_float64(curve: Curve) -> Curve:
    return Curve(
        curve.kind,
        np.asarray(curve.scale, float),
        np.asarray(curve.samples, float),
        np.asarray(curve.weights, float),
        units=curve.units,
        details=curve.details,
    )
