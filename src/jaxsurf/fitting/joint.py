r"""Do independent measures agree? One alpha from many curves of the same surfaces.

Each measure gives its own $\alpha_m$ through its exponent, by a straight line or through the knee.
The measures share surfaces, so their estimates go up and down together; drawing whole surfaces
again, the same ones for every measure, gives their covariance V. The joint estimate is the
combination of least variance, $\hat\alpha = \sum_m (V^{-1} 1)_m \alpha_m / (1^T V^{-1} 1)$, and

$$\chi^2 = \sum_{ml} (\alpha_m - \hat\alpha)\, V^{-1}_{ml}\, (\alpha_l - \hat\alpha)$$

with one degree of freedom less than measures says whether they agree. V contains the systematic
errors of the measures, which are their own: without them every window would be a contradiction.

Source: the paper's Sec. VIII, "independent measurements"; Lyons, Gibaut & Clifford, Nucl. Instrum.
Meth. A 270, 110 (1988) for the combination.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from jaxsurf import theory
from jaxsurf._checks import check_choice, check_integer
from jaxsurf.curve import Curve
from jaxsurf.fitting._collapse_data import Limits
from jaxsurf.fitting._resample import bootstrap_counts, resampled_means
from jaxsurf.fitting.crossover import fit_crossover
from jaxsurf.fitting.fit import Fit
from jaxsurf.fitting.power_law import fit_power_law

#: kind -> (exponent, order of the moment) -> (alpha, |d alpha / d exponent|).
_ALPHA: dict[str, Callable[[float, float], tuple[float, float]]] = {
    "mean_length": lambda e, _: tuple(theory.alpha_from_fractal_dimension(e, 1.0)),
    "length_tail": lambda e, _: tuple(theory.alpha_from_length_tail(-e, 1.0)),
    "spectrum": lambda e, _: (-e / 2 - 1, 0.5),
    "directional_spectrum": lambda e, _: (-e / 2 - 1, 0.5),
    "curvature_moment": lambda e, order: (e / order, 1 / order),
    "height_correlation": lambda e, order: (e / order, 1 / order),
    "patch_moment": lambda e, order: (e / order, 1 / order),
}
#: Correlated surfaces make V nearly singular; no measure's weight is let below this share of it.
_RIDGE = 1e-6


def fit_joint(
    curves: Sequence[Curve],
    *,
    through: str = "power_law",
    windows: Mapping[str, Limits] | None = None,
    draws: int = 400,
    rng: np.random.Generator | int = 0,
) -> Fit:
    r"""The roughness exponent from several measures of the same surfaces, and whether they agree.

    $$\hat\alpha = \frac{1^T V^{-1} \alpha}{1^T V^{-1} 1}, \qquad
      \chi^2 = (\alpha - \hat\alpha)^T V^{-1} (\alpha - \hat\alpha)$$

    Arguments:
        curves: two or more, of different kinds, row i of each measured on surface i.
        through: "power_law" for straight lines; "crossover" for surfaces with a correlation length,
            which is then estimated jointly too.
        windows: kind -> (low, high) in its scale's unit; the default of the kind where missing.
        draws: how many times surfaces are drawn again, 50 or more.
        rng: a seed or a generator of the draws.

    Returns:
        A `Fit` of "alpha" and each measure's own "alpha[kind]" (and "xi", "xi[kind]"). `chi2` and
        `dof` test that all measures have one alpha, with statistical and systematic errors;
        `details["chi2_statistical"]` has the statistical errors alone.

    Raises:
        ValueError: fewer than two curves, two of a kind, different numbers of surfaces, fewer
            surfaces than measures and three, or a kind that carries no alpha.

    Source: the paper's abstract and Sec. VIII.
    """
    given = _checked(curves)
    check_choice("through", through, ("power_law", "crossover"))
    check_integer("draws", draws, low=50, remedy="400 draws give a covariance to 5 %.")
    rng = np.random.default_rng(rng)
    if through == "crossover":
        return _through_crossover(given, windows, draws, rng)
    seed, surfaces = int(rng.integers(2**31)), given[0].surfaces
    fits, own, systematic, shifts = [], [], [], []
    counts = bootstrap_counts(surfaces, draws, rng)
    for curve in given:
        window = (windows or {}).get(curve.kind)
        fit = fit_power_law(curve, window=window, weighting="equal", rng=seed)
        to_alpha, order = _ALPHA[curve.kind], float(curve.detail("order", 2))
        alpha, slope = to_alpha(fit.values["exponent"], order)
        fits.append(fit)
        own.append(alpha)
        systematic.append(abs(slope) * fit.systematic.get("exponent", 0.0))
        exponents = _drawn_exponents(curve.window(*fit.details["window"]), counts)
        shifts.append([to_alpha(e, order)[0] for e in exponents])
    statistical = np.atleast_2d(np.cov(np.array(shifts))) * surfaces / (surfaces - 1)
    names = [f"alpha[{curve.kind}]" for curve in given]
    result = combine(np.array(own), statistical, np.array(systematic), surfaces)
    bad = [fit.status for fit in fits if not fit.converged]
    return _fit(
        "joint alpha of " + ", ".join(curve.kind for curve in given),
        {"alpha": (names, np.array(own), statistical, np.array(systematic), result)},
        status=bad[0] if bad else "converged",
        details={
            "surfaces": given[0].surfaces,
            "draws": draws,
            "windows": {c.kind: f.details["window"] for c, f in zip(given, fits, strict=True)},
        },
    )


def combine(
    values: Float[np.ndarray, " measure"],
    statistical: Float[np.ndarray, "measure measure"],
    systematic: Float[np.ndarray, " measure"],
    surfaces: int | None = None,
) -> dict[str, Any]:
    """The combination of least variance of correlated estimates, and the chi2 of their agreement.

    Arguments:
        values: one estimate a measure.
        statistical: their statistical covariance.
        systematic: their systematic errors, each its own.
        surfaces: how many the covariance comes from. The inverse of a covariance from n surfaces is
            too large by $(n-1)/(n-m-2)$ for m measures, and chi2 with it, which is put right
            (Hartlap, Simon & Schneider 2007); None for a known covariance.

    Returns:
        "weights" (summing to one), "value", "stderr", "systematic", "chi2", "chi2_statistical".
    """
    measures = len(values)
    right = 1.0 if surfaces is None else max(surfaces - measures - 2, 1) / (surfaces - 1)
    ridge = _RIDGE * np.diag(np.diag(statistical))
    total = statistical + np.diag(systematic**2) + ridge
    inverse = np.linalg.inv(total)
    weights = inverse.sum(0) / inverse.sum()
    value = float(weights @ values)
    away = values - value
    inner = np.linalg.inv(statistical + ridge)
    best = float(inner.sum(0) @ values / inner.sum())
    return {
        "weights": weights,
        "value": value,
        "stderr": float(np.sqrt(weights @ statistical @ weights)),
        "systematic": float(np.sqrt(np.sum((weights * systematic) ** 2))),
        "chi2": right * float(away @ inverse @ away),
        "chi2_statistical": right * float((values - best) @ inner @ (values - best)),
    }


def _checked(curves: Sequence[Curve]) -> list[Curve]:
    if isinstance(curves, Curve) or len(curves) < 2:
        raise ValueError(
            "a joint fit needs at least two curves; got "
            f"{1 if isinstance(curves, Curve) else len(curves)}. Use fit_power_law for one."
        )
    given = list(curves)
    kinds = [curve.kind for curve in given]
    if silent := [kind for kind in kinds if kind not in _ALPHA]:
        raise ValueError(
            f"{silent} carries no alpha: its exponent is the same for all or unknown; the kinds "
            f"that do are {sorted(_ALPHA)}. Leave it out."
        )
    if len(set(kinds)) < len(kinds):
        raise ValueError(f"curves must be of different kinds; got {kinds}. Join equal ones first.")
    if len(counts := {curve.surfaces for curve in given}) > 1:
        raise ValueError(
            f"curves must be of the same surfaces, row by row; got {sorted(counts)} surfaces. "
            "Measure every curve on the same maps."
        )
    if given[0].surfaces < len(given) + 3:
        raise ValueError(
            f"the covariance between {len(given)} measures needs at least {len(given) + 3} "
            f"surfaces; got {given[0].surfaces}. Measure more, or cut the map into parts."
        )
    return given


def _drawn_exponents(
    curve: Curve, counts: Float[np.ndarray, "draw surface"] | np.ndarray
) -> Float[np.ndarray, " draw"]:
    """The straight-line exponent of each draw, points of equal weight."""
    means, present = resampled_means(curve, counts)
    usable = (present & (means > 0)).all(0)
    log_x = np.log(np.asarray(curve.scale, float)[usable])
    line = (log_x - log_x.mean()) / np.sum((log_x - log_x.mean()) ** 2)
    return np.log(means[:, usable]) @ line


def _through_crossover(
    curves: list[Curve],
    windows: Mapping[str, Limits] | None,
    draws: int,
    rng: np.random.Generator,
) -> Fit:
    fit = fit_crossover(curves, shared=(), windows=windows, draws=draws, rng=rng)
    parts = {}
    for name in ("alpha", "xi"):
        names = [f"{name}[{curve.kind}]" for curve in curves]
        rows = [fit.names.index(each) for each in names]
        own = np.array([fit.values[each] for each in names])
        spread = np.array([fit.systematic.get(each, 0.0) for each in names])
        statistical = fit.covariance[np.ix_(rows, rows)]
        parts[name] = (
            names,
            own,
            statistical,
            spread,
            combine(own, statistical, spread, curves[0].surfaces),
        )
    return _fit(
        "joint alpha and xi of " + ", ".join(curve.kind for curve in curves),
        parts,
        status=fit.status,
        details={
            "draws": draws,
            "windows": fit.details["windows"],
            "fitted": fit.details["fitted"],
        },
    )


def _fit(
    model: str, parts: dict[str, tuple[Any, ...]], *, status: str, details: dict[str, Any]
) -> Fit:
    """Joint values first, each measure's own after, with one covariance over all of them."""
    names, values, systematic, blocks = [], [], [], []
    extra: dict[str, Any] = {"weights": {}, "chi2_statistical": {}}
    chi2, dof = 0.0, 0
    for name, (own_names, own, statistical, spread, joint) in parts.items():
        names += [name, *own_names]
        values += [joint["value"], *own]
        systematic += [joint["systematic"], *spread]
        linear = np.vstack([joint["weights"], np.eye(len(own))])
        blocks.append(linear @ statistical @ linear.T)
        extra["weights"][name] = dict(zip(own_names, joint["weights"].tolist(), strict=True))
        extra["chi2_statistical"][name] = joint["chi2_statistical"]
        chi2, dof = chi2 + joint["chi2"], dof + len(own) - 1
    covariance = np.zeros((len(names), len(names)))
    first = 0
    for block in blocks:
        covariance[first : first + len(block), first : first + len(block)] = block
        first += len(block)
    return Fit(
        model=model,
        values=dict(zip(names, map(float, values), strict=True)),
        stderr=dict(zip(names, np.sqrt(np.diag(covariance)).tolist(), strict=True)),
        covariance=covariance,
        chi2=chi2,
        dof=dof,
        systematic=dict(zip(names, map(float, systematic), strict=True)),
        status=status,
        details={**details, **extra},
    )
