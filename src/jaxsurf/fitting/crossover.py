r"""The crossover from self-affine to percolation scaling, fitted through the knee.

Up to a correlation length xi a surface is self-affine; beyond it heights are independent and
contour loops are hulls of percolation clusters. Each measure follows one power of scale on either
side, joined smoothly:

$$y = A\, v^{p(\alpha)} \left[1 + (v/v_\xi)^n\right]^{(p_\infty - p(\alpha))/n},$$

v the scale ($\pi/q$ for the spectrum, so that the knee of $S$ lies at $q = \pi/\xi$), p the
exponent below the knee by theory, $p_\infty$ that of percolation (zero for S and $D_2$), n the
fitted sharpness. $v_\xi = k\,\xi$, and for $P_>(s)$ the length of a loop of that radius, $s_\xi =
k\,a\,\xi^{D_f}$, with a the amplitude of $\langle s\rangle(R)$ where that curve is fitted too and 1
where it is not. The ratio k, 1 unless given, is a number of order one that belongs to the measure:
the knee is where two straight lines meet, and they meet at another length in each. The curvature
variance needs no k: it is the lattice sum of a spectrum with its knee at xi.

Loops of a few sites are not yet scale-free: $\langle s\rangle(6)$ is some 8 % above its power law,
many errors. On request a measure carries a factor $\exp[c\,(v/v_{\min})^{-\omega}]$, c fitted.

Source: the paper's Eqs. (hcross), (scross), (perc_results) and Sec. V D.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from jaxsurf._checks import check_choice, check_in_range, check_integer
from jaxsurf.curve import Curve
from jaxsurf.fitting import _crossover_model as solver
from jaxsurf.fitting._collapse_data import Limits, Stack, stack_curves
from jaxsurf.fitting._crossover_model import BELOW, BEYOND, CrossoverModel, curvature_kernel
from jaxsurf.fitting._crossover_windows import (
    default_window,
    out_of_sight,
    used_windows,
    vary_windows,
)
from jaxsurf.fitting._least_squares import Solution
from jaxsurf.fitting.fit import Fit

#: Of a normal distribution the ratio is 1, and 100 draws know it to 10 %.
HEAVY = 1.5


def fit_crossover(
    curves: Curve | Sequence[Curve],
    *,
    shared: Sequence[str] = ("alpha", "xi"),
    beyond: str = "percolation",
    sharpness: float | int | None = None,
    corrections: Mapping[str, float | int] | None = None,
    knees: Mapping[str, float | int] | None = None,
    windows: Mapping[str, Limits] | None = None,
    start: Mapping[str, float | int] | None = None,
    draws: int = 200,
    rng: np.random.Generator | int = 0,
) -> Fit:
    r"""Roughness exponent and correlation length from curves that bend at the correlation length.

    $$y = A\, v^{p(\alpha)} [1 + (v/v_\xi)^n]^{(p_\infty - p(\alpha))/n}$$

    Arguments:
        curves: a curve or several of one ensemble, at most one of a kind: spectrum,
            curvature_moment, height_correlation and patch_moment (order 2), mean_length,
            length_tail, loop_correlation. Curves with equally many rows are taken to come from the
            same surfaces, and their covariance is kept.
        shared: which of "alpha" and "xi" all curves have in common; the others are fitted for each,
            as "xi[mean_length]".
        beyond: "percolation" fixes the exponents above the knee by theory, "free" fits them, as
            "beyond[mean_length]".
        sharpness: n of every measure, or None to fit each, as "sharpness[mean_length]".
        corrections: kind -> the exponent omega of its correction at small scales, whose amplitude
            is fitted, as "correction[mean_length]"; none where missing.
        knees: kind -> the ratio k of its knee to xi; 1 where missing.
        windows: kind -> (low, high) in its scale's unit; where missing, the scales between the
            lattice and the map's side.
        start: starting values of "alpha" and "xi".
        draws: how many times surfaces are drawn again, 20 or more.
        rng: a generator or a seed for the draws.

    Returns:
        A `Fit` with "alpha", "xi" in the unit of length, and for each measure its amplitude and
        sharpness; from the curvature, amplitude and sharpness of the spectrum behind it. The
        systematic error is the shift when a fifth of the scales is left out at either end, unless
        that leaves a knee out of sight: then its measure does not count, and a note says so.

    Raises:
        ValueError: two curves of a kind, a kind without a known crossover, curves of different
            units of length, too few points or surfaces, starting values out of range.

    Source: the paper's Eq. (scross) and Fig. 11.
    """
    given = _checked_curves(curves)
    check_choice("beyond", beyond, ("percolation", "free"))
    check_integer("draws", draws, low=20, remedy="200 draws give errors to 5 %.")
    for name in shared:
        check_choice("each of shared", name, ("alpha", "xi"))
    if sharpness is not None:
        check_in_range("sharpness", sharpness, 0.1, 100.0, remedy="Pass None to fit it.")
    for kind, omega in (corrections or {}).items():
        check_in_range(
            f"the correction exponent of {kind}",
            omega,
            0.0,
            np.inf,
            closed=(False, False),
            remedy="Leave a kind out for no correction.",
        )
    for kind, ratio in (knees or {}).items():
        check_in_range(
            f"the knee ratio of {kind}",
            ratio,
            0.0,
            np.inf,
            closed=(False, False),
            remedy="It is a number near 1.",
        )
    kinds = tuple(curve.kind for curve in given)
    if kinds == ("loop_correlation",):
        shared = tuple(name for name in shared if name != "alpha")
    chosen = windows or {}
    stack = stack_curves(
        [{1.0: curve} for curve in given],
        lambda curve, _: chosen.get(curve.kind) or default_window(curve),
    )
    fixed = _fixed(given, stack, sharpness, corrections or {}, knees or {})
    on_lattice = ("curvature_moment",) if "kernel" in fixed else ()
    parameters = _names(kinds, shared, beyond, sharpness is None, tuple(corrections or ()))
    model = CrossoverModel(kinds, parameters, on_lattice)
    data = _data(stack, fixed)
    begin = _start(model, data, start or {})
    found = solver.solve(model, begin, data)
    best = found.values
    refits = [
        solver.solve(model, best, _data(drawn, fixed))
        for drawn in stack.bootstrap(draws, np.random.default_rng(rng))
    ]
    good = np.array([bool(refit.success) for refit in refits])
    names, values, jacobian = solver.reported(model, best)
    spread = np.array([refit.values for refit in refits])
    covariance = _covariance(spread[good]) * np.outer(jacobian, jacobian)
    varied = vary_windows(model, stack, data, best, jacobian)
    return Fit(
        model="crossover: " + ", ".join(kinds),
        values=dict(zip(names, values.tolist(), strict=True)),
        stderr=dict(zip(names, np.sqrt(np.diag(covariance)).tolist(), strict=True)),
        covariance=covariance,
        chi2=float(found.chi2),
        # each sharpness brings a residual of its own, its distance from the typical one
        dof=int(len(stack.x) - sum("sharpness" not in name for name in names)),
        systematic=varied.systematic,
        status=_status(found, good, dict(zip(names, values, strict=True)), model, best, data),
        notes=varied.notes,
        details={
            "kinds": kinds,
            "shared": tuple(shared),
            "beyond": beyond,
            "windows": used_windows(stack, kinds),
            "points": len(stack.x),
            "draws": draws,
            "draws_failed": int((~good).sum()),
            "variants": varied.values,
            "fitted": _fitted(model, best, stack, kinds, data),
        },
    )


def _checked_curves(curves: Curve | Sequence[Curve]) -> list[Curve]:
    given = [curves] if isinstance(curves, Curve) else list(curves)
    if not given or not all(isinstance(curve, Curve) for curve in given):
        raise TypeError(f"curves must be a Curve or several; got {type(curves).__name__}.")
    kinds = [curve.kind for curve in given]
    if unknown := [kind for kind in kinds if kind not in BELOW]:
        raise ValueError(
            f"no crossover is known for {unknown}; known are {sorted(BELOW)}. Leave them out."
        )
    if len(set(kinds)) < len(kinds):
        raise ValueError(
            f"curves must be of different kinds; got {kinds}. Join batches of one kind by "
            "jaxsurf.concatenate, and fit different ensembles one at a time."
        )
    for curve in given:
        if curve.kind in ("curvature_moment", "patch_moment", "height_correlation") and (
            curve.detail("order", 2) != 2
        ):
            raise ValueError(
                f"{curve.kind} must be of order 2; got order {curve.detail('order')}. "
                "Pass the second moment."
            )
    lengths = {c.units[0].removeprefix("1/") for c in given if c.kind != "spectrum"}
    if len(lengths) > 1:
        raise ValueError(
            f"curves to fit together must share the unit of length; got {sorted(lengths)}. "
            "Measure all of them with one spacing."
        )
    return given


def _names(
    kinds: tuple[str, ...],
    shared: Sequence[str],
    beyond: str,
    fit_sharpness: bool,
    corrected: tuple[str, ...],
) -> tuple[str, ...]:
    names: list[str] = []
    for name, inner in (("alpha", "alpha"), ("xi", "log_xi")):
        if name in shared:
            names.append(inner)
        else:
            names += [
                f"{inner}[{kind}]"
                for kind in kinds
                if not (name == "alpha" and kind == "loop_correlation")
            ]
    for kind in kinds:
        names.append(f"log_amplitude[{kind}]")
        if fit_sharpness:
            names.append(f"log_sharpness[{kind}]")
        if beyond == "free":
            names.append(f"beyond[{kind}]")
        if kind in corrected:
            names.append(f"correction[{kind}]")
    return tuple(names)


def _fixed(
    curves: list[Curve],
    stack: Stack,
    sharpness: float | int | None,
    corrections: Mapping[str, float | int],
    knees: Mapping[str, float | int],
) -> dict[str, Any]:
    """What the model needs that no draw changes."""
    waves = np.array([curve.kind == "spectrum" for curve in curves])[stack.measure]
    log_x = np.log(stack.x)
    log_v = np.where(waves, np.log(np.pi) - log_x, log_x)
    lowest = np.array([log_v[stack.measure == index].min() for index in range(len(curves))])
    fixed: dict[str, Any] = {
        "log_v": log_v,
        "log_above": log_v - lowest[stack.measure],
        "omega": [float(corrections.get(curve.kind, 1.0)) for curve in curves],
        "measure": stack.measure,
        "log_sharpness": 0.0 if sharpness is None else np.log(float(sharpness)),
        "log_ratio": np.log([float(knees.get(curve.kind, 1.0)) for curve in curves]),
    }
    for index, curve in enumerate(curves):
        rows = stack.measure == index
        if (found := curvature_kernel(curve, stack.x[rows])) is not None:
            fixed["log_mode"], kernel = found
            fixed["kernel"] = np.ones((len(stack.x), kernel.shape[1]))
            fixed["kernel"][rows] = kernel
    return fixed


def _data(stack: Stack, fixed: dict[str, Any]) -> dict[str, Any]:
    whole = np.ones(len(stack.x), bool)
    whitening = stack.whitening(whole, np.ones(len(stack.x)))
    return {**fixed, "log_y": stack.log_y, "whitening": whitening}


def _start(
    model: CrossoverModel, data: dict[str, Any], given: Mapping[str, float | int]
) -> Float[np.ndarray, " parameter"]:
    """The best of a coarse grid of alpha and xi, each amplitude at its mean residual."""
    for name in given:
        check_choice("each start", name, ("alpha", "xi"))
    if "xi" in given:
        check_in_range(
            "the start of xi",
            given["xi"],
            0.0,
            np.inf,
            closed=(False, False),
            remedy="Pass xi > 0.",
        )
    lengths = data["log_v"][np.isin(data["measure"], _of_length(model.kinds))]
    low, high = (lengths.min(), lengths.max()) if len(lengths) else (0.0, 3.0)
    grid_xi = [np.log(given["xi"])] if "xi" in given else np.linspace(low, high, 9)[1:-1]
    grid_alpha = [given["alpha"]] if "alpha" in given else [0.1, 0.4, 0.7, 0.95]
    best, lowest = np.zeros(len(model.names)), np.inf
    for log_xi in grid_xi:
        for alpha in grid_alpha:
            vector = np.array([_first_guess(name, alpha, log_xi) for name in model.names])
            for _ in range(2):  # the knee of P_> depends on the amplitude of <s>
                misfit = data["log_y"] - solver.log_y(model, vector, data)
                for index, kind in enumerate(model.kinds):
                    place = model.names.index(f"log_amplitude[{kind}]")
                    vector[place] += misfit[data["measure"] == index].mean()
            misfit = data["log_y"] - solver.log_y(model, vector, data)
            chi2 = float(np.sum((data["whitening"] @ misfit) ** 2))
            if chi2 < lowest:
                best, lowest = vector, chi2
    return best


def _of_length(kinds: tuple[str, ...]) -> list[int]:
    return [index for index, kind in enumerate(kinds) if kind != "length_tail"]


def _first_guess(name: str, alpha: float, log_xi: float) -> float:
    if name.startswith("alpha"):
        return alpha
    if name.startswith("log_xi"):
        return log_xi
    if name.startswith("log_sharpness"):
        return 1.0
    if name.startswith("beyond"):
        return float(BEYOND.get(name[7:-1], 0.0))
    return 0.0


def _covariance(draws: np.ndarray) -> np.ndarray:
    """Covariance of the fitted parameters over the draws, infinite if there are too few.

    Where a curve barely shows its knee a few draws lie far off, and their squares would be all of
    the variance. An error more than `HEAVY` times half the interval that holds 68 % of the draws
    is replaced by that.
    """
    if len(draws) < 2:
        return np.full((draws.shape[1],) * 2, np.inf)
    covariance = np.atleast_2d(np.cov(draws.T))
    deviation = np.sqrt(np.diag(covariance))
    low, high = np.quantile(draws, [0.16, 0.84], axis=0)
    share = (high - low) / 2 / np.where(deviation > 0, deviation, 1.0)
    narrower = np.where(share * HEAVY < 1.0, share, 1.0)
    return covariance * np.outer(narrower, narrower)


def _status(
    found: Solution,
    good: np.ndarray,
    values: dict[str, float],
    model: CrossoverModel,
    best: np.ndarray,
    data: dict[str, Any],
) -> str:
    if not found.success:
        return found.status
    if good.mean() < 0.9:
        return (
            f"unstable: {int((~good).sum())} of {len(good)} bootstrap refits failed. Fix the "
            "sharpness, share alpha and xi, or add surfaces."
        )
    for name, value in values.items():
        if name.startswith("xi") and not np.isfinite(value):
            return f"{name} is not finite: no knee. Use fit_power_law, or widen the window."
    if lost := out_of_sight(model, best, data, np.ones(len(data["log_y"]), bool)):
        return (
            f"the knee of {', '.join(lost)} is outside the window of its curve, so xi is not seen "
            "there. Widen windows=, leave the curve out, or use fit_power_law."
        )
    return "converged"


def _fitted(
    model: CrossoverModel, best: np.ndarray, stack: Stack, kinds: tuple[str, ...], data: Any
) -> dict[str, dict[str, np.ndarray]]:
    """The fitted line of each measure, for pictures."""
    line = np.exp(solver.log_y(model, best, data))
    return {
        kind: {"scale": stack.x[stack.measure == i], "value": line[stack.measure == i]}
        for i, kind in enumerate(kinds)
    }
