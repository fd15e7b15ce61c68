r"""Straight lines on log-log paper, with errors that can be believed.

A measure of a self-affine surface is a power of scale, $y = A x^e$, over a window. The exponent is
fitted by least squares of $\ln y$ on $\ln x$ with weights $1/(\sigma^2 + \delta^2)$, where $\sigma$
is the scatter between surfaces and $\delta$ the misfit, the least that the points must be allowed
for a line to pass through them. Where the line fits, the sharper points count more; where the local
slope drifts, all points of the window count the same.

Points of one curve are correlated, so no error comes from the number of points: the statistical
error resamples whole surfaces, and the systematic error is the spread over sub-windows: the largest
departure of the exponent in the window's lower, middle and upper half, or in the window less either
end quarter. A sub-window has fewer points and scatters more, so where nothing drifts the spread is
an upper bound; subtracting the expected scatter would make it zero as often as not, and erratic.

Source: the paper's Sec. V A 3 ("direct" fits), Table I; the bootstrap, Davison & Hinkley, Bootstrap
Methods and their Application (1997).
"""

from typing import Any

import numpy as np
from jaxtyping import Float

from jaxsurf._checks import check_choice, check_integer
from jaxsurf.curve import Curve
from jaxsurf.fitting import _lines
from jaxsurf.fitting._least_squares import CONVERGED
from jaxsurf.fitting._resample import bootstrap_counts, pulls, resampled_means, shrunk_covariance
from jaxsurf.fitting._window import WAVE_KINDS, default_window
from jaxsurf.fitting.fit import Fit

WEIGHTINGS = ("errors", "equal")
FEWEST_POINTS = 4
FEWEST_DRAWS = 20
NAMES = ("exponent", "amplitude")
WHOLE, HALVES = 0, (1, 3)  # of the sub-windows


def fit_power_law(
    curve: Curve,
    *,
    window: tuple[float | int, float | int] | None = None,
    weighting: str = "errors",
    draws: int = 200,
    rng: np.random.Generator | int = 0,
) -> Fit:
    r"""Exponent and amplitude of $y = A x^e$ in a window, with statistical and systematic errors.

    Arguments:
        curve: one curve of any kind whose mean is positive in the window.
        window: (low, high) in the scale's unit, ends included; None for the default of the curve's
            kind. `details["window"]` of the result says which it was.
        weighting: "errors" for the weights above; "equal" for the plain straight line.
        draws: bootstrap draws over surfaces.
        rng: seed or generator of the draws; the same seed gives the same errors.

    Returns:
        A `Fit` of "exponent" e, the slope with its sign, and "amplitude" A, the value at x = 1.
        `stderr` is the scatter over bootstrap draws of surfaces; of one surface alone, that of its
        points about the line, and a note says so. `systematic` is the largest departure
        of a sub-window's value from the whole window's. `chi2` is that of the best line given the
        points' covariance over surfaces, shrunk (`details["shrinkage"]`), and without degrees of
        freedom below 3 surfaces.

    Raises:
        TypeError: something that is not one `Curve`.
        ValueError: fewer than 4 points in the window, a mean that is not positive there, a window
            whose ends are not in order, fewer than 20 draws.

    Source: Sec. V A 3.

    >>> scale = np.array([1.0, 2.0, 4.0, 8.0, 16.0])
    >>> curve = Curve("curvature_moment", scale, 3 * scale**0.8 * np.ones((5, 1)))
    >>> fit = fit_power_law(curve, window=(1, 16))
    >>> round(fit.values["exponent"], 6), round(fit.values["amplitude"], 6)
    (0.8, 3.0)
    """
    _check_one(curve)
    check_choice("weighting", weighting, WEIGHTINGS)
    check_integer("draws", draws, low=FEWEST_DRAWS, remedy="200 give an error to 5 %.")
    low, high = default_window(curve) if window is None else _ordered(window)
    part = _in_float64(curve.window(low, high))
    mean = np.asarray(part.mean, float)
    _check_points(curve, part, mean, (low, high))
    x, y = np.log(np.asarray(part.scale, float)), np.log(mean)

    relative = pulls(part) / mean
    sigma = _scatter(part, relative)
    delta = _lines.misfit(x, y, sigma) if weighting == "errors" else None
    weight = np.ones_like(x) if delta is None else 1 / np.hypot(sigma, delta)
    weight = weight / weight.max()

    counts = bootstrap_counts(part.surfaces, draws if part.surfaces > 1 else 0, rng)
    drawn, present = resampled_means(part, counts)
    present = present & (drawn > 0)
    # the sub-windows of the mean and the whole window of each draw, in one call of the solver
    windows = _lines.sub_windows(x)
    lines, determined = _lines.fit_lines(
        x,
        np.vstack([np.tile(y, (len(windows), 1)), np.log(np.where(present, drawn, 1.0))]),
        (np.vstack([windows, present]) * weight)[:, None],
    )
    centre, redrawn = np.split(lines[:, 0], [len(windows)])
    determined, usable = np.split(determined[:, 0], [len(windows)])
    spans = [(present * windows[half]).sum(1) >= 2 for half in HALVES]
    scatter = redrawn[usable & np.all(spans, 0)]
    exponent, log_amplitude = centre[WHOLE]
    amplitude = np.exp(log_amplitude)
    if part.surfaces > 1:
        covariance = _covariance(scatter, part.surfaces)
    else:
        residual = y - exponent * x - log_amplitude
        covariance = _lines.covariance_from_residuals(x, weight, residual)
    systematic = np.abs(centre[WHOLE + 1 :] - centre[WHOLE]).max(0)

    slopes = np.array([1.0, amplitude])  # d(e, A) / d(e, ln A)
    covariance = covariance * np.outer(slopes, slopes)
    chi2, dof, shrinkage = _goodness(x, y, relative)
    return Fit(
        model=f"power law of {curve.kind}",
        values=_named(np.array([exponent, amplitude])),
        stderr=_named(np.sqrt(np.diag(covariance))),
        systematic=_named(systematic * slopes),
        covariance=covariance,
        chi2=chi2,
        dof=dof,
        status=_status(bool(determined.all()), covariance, len(scatter), len(counts)),
        details={
            "window": (float(low), float(high)),
            "window_from": "default" if window is None else "given",
            "points": len(x),
            "surfaces": part.surfaces,
            "weighting": weighting,
            "misfit": delta,
            "sub_window_exponents": tuple(centre[WHOLE + 1 :, 0].tolist()),
            "draws": len(scatter),
            "shrinkage": shrinkage,
            "units": curve.units,
        },
        notes=_notes(part.surfaces),
    )


def _covariance(values: Float[np.ndarray, "draw value"], surfaces: int) -> np.ndarray:
    """Covariance over bootstrap draws, which scatter by (n-1)/n too little."""
    centred = values - values.mean(0)
    return centred.T @ centred / max(len(values) - 1, 1) * surfaces / (surfaces - 1)


def _scatter(part: Curve, relative: np.ndarray) -> np.ndarray:
    """Standard error of ln y at each point, as far as the number of surfaces tells it."""
    if part.surfaces > 2:
        sigma = np.sqrt(np.diag(shrunk_covariance(relative)[0]))
    elif part.surfaces == 1 and part.kind in WAVE_KINDS:
        # the modes of one map are independent, and each counts twice, as q and -q
        sigma = np.sqrt(2 / np.asarray(part.count, float))
    else:
        sigma = np.full(len(part.scale), np.sqrt((relative**2).mean()))
    return np.maximum(sigma, _lines.SMALLEST_ERROR)


def _goodness(
    x: np.ndarray, y: np.ndarray, relative: np.ndarray
) -> tuple[float, int, dict[str, float] | None]:
    """The least chi2 of a line through points of this covariance; no dof below 3 surfaces."""
    if len(relative) < 3:
        return 0.0, 0, None
    covariance, shrinkage = shrunk_covariance(relative)
    floor = _lines.SMALLEST_ERROR**2
    root = np.linalg.cholesky(covariance + floor * np.eye(len(x)))
    design = np.linalg.solve(root, np.stack([x, np.ones_like(x)], -1))
    target = np.linalg.solve(root, y)
    left = target - design @ np.linalg.lstsq(design, target)[0]
    return float(left @ left), len(x) - 2, shrinkage


def _in_float64(curve: Curve) -> Curve:
    # in rows: a sum in another order differs in the last digit
    parts = (curve.scale, curve.samples, curve.weights)
    arrays = (np.array(part, float, order="C") for part in parts)
    return Curve(curve.kind, *arrays, units=curve.units, details=curve.details)


def _named(values: np.ndarray) -> dict[str, float]:
    return dict(zip(NAMES, values.tolist(), strict=True))


def _notes(surfaces: int) -> tuple[str, ...]:
    if surfaces == 1:
        return (
            "one surface: the error is the scatter of its points about the line, a lower bound; "
            "measure more surfaces, or cut the map into parts",
        )
    if surfaces < 8:
        return (f"the errors come from {surfaces} surfaces only and are themselves rough",)
    return ()


def _status(determined: bool, covariance: np.ndarray, used: int, drawn: int) -> str:
    if not determined or not np.all(np.isfinite(covariance)):
        return "failed: the points do not determine a line. Widen the window."
    if used < drawn / 2:
        return (
            f"failed: only {used} of {drawn} bootstrap draws of the surfaces have enough points in "
            "both halves of the window. Move the window to where more surfaces have samples."
        )
    return CONVERGED


def _check_one(curve: Any) -> None:
    if not isinstance(curve, Curve):
        raise TypeError(
            f"curve must be a Curve; got {type(curve).__name__}. Measure one, e.g. by "
            "js.power_spectrum(h), or wrap columns as Curve(kind, scale, samples)."
        )
    if curve.samples.ndim != 2:
        raise TypeError(
            f"curve must be one curve; got a stack of samples {curve.samples.shape}. "
            "Fit them one by one: [fit_power_law(curve[i]) for i in range(n)]."
        )


def _ordered(window: Any) -> tuple[float, float]:
    try:
        low, high = (float(end) for end in window)
    except (TypeError, ValueError):
        raise TypeError(f"window must be (low, high); got {window!r}. Pass two numbers.") from None
    if not low < high:
        raise ValueError(f"window must be (low, high) with low < high; got {window!r}. Swap them.")
    return low, high


def _check_points(curve: Curve, part: Curve, mean: np.ndarray, window: tuple[float, float]) -> None:
    where = f"window ({window[0]:.4g}, {window[1]:.4g}) {curve.units[0]}"
    if len(mean) < FEWEST_POINTS:
        have = curve.present().scale
        span = f"{have[0]:.4g} ... {have[-1]:.4g}" if len(have) else "nowhere"
        raise ValueError(
            f"a power law needs at least {FEWEST_POINTS} points in its window; got {len(mean)} in "
            f"{where}, of {len(have)} points at {span}. Pass a wider window=, or measure at more "
            "scales."
        )
    if not np.all(np.isfinite(mean)):
        raise ValueError(
            f"{curve.kind} must be finite to be fitted; got NaN or infinity in {where}. "
            "Look for missing data in the measurement, or leave those scales out by window=."
        )
    if not np.all(mean > 0):
        bad = np.asarray(part.scale)[mean <= 0][:4].tolist()
        raise ValueError(
            f"a power law needs positive means; got {curve.kind} zero or below at scales {bad} in "
            f"{where}. Pass a window= where it is positive; a measure of both signs, such as an "
            "odd moment, has no power law."
        )
