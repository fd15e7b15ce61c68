r"""Finite-size scaling: exponents and master curve fitted together.

Measured at several sizes L, a curve with a scaling form falls on one master curve,
$Y = F(X)$, once x and y are scaled with the right powers. F is a cubic spline in log-log whose
coefficients are eliminated at each step, so the exponents come out jointly with their covariance.
On request the master curve carries correction terms,

$$\ln Y = \ln F(X) + a L^{-\omega} + b\, x^{-\omega},$$

of which the first is seen by sizes and the second by scales. Statistical errors come from fitting
surfaces drawn again; systematic ones from leaving out sizes and scales, and from changing the
spline and omega. The goodness of fit is chi2 with the data's covariance, and Houdayer-Hartmann's S.

Source: the paper's Eqs. (FSSform), (hcross) and Sec. V B.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from jaxsurf._checks import check_choice, check_in_range, check_integer
from jaxsurf.curve import Curve
from jaxsurf.fitting import _collapse_solve as solver
from jaxsurf.fitting._collapse_data import Stack, Window, stack_curves, systematic_errors
from jaxsurf.fitting._collapse_solve import CORRECTIONS, SCALES, CollapseProblem
from jaxsurf.fitting.collapse_forms import PRESETS, Ansatz, Transform
from jaxsurf.fitting.collapse_quality import houdayer_hartmann
from jaxsurf.fitting.fit import Fit

#: A spline coefficient for each so much of ln X, and at least and at most so many.
COEFFICIENT_WIDTH, FEWEST, MOST = 0.6, 6, 24

Curves = Mapping[Any, Curve] | Sequence[Mapping[Any, Curve]]
Form = Ansatz | Transform
Number = float | int


def fit_collapse(
    curves: Curves,
    ansatz: Form | Sequence[Form] | None = None,
    *,
    start: Mapping[str, Number] | None = None,
    window: Window = None,
    correction: str | None = None,
    omega: Number | None = 1.0,
    versus: str = "size",
    share_alpha: bool = False,
    coefficients: int | None = None,
    draws: int = 200,
    rng: np.random.Generator | int = 0,
) -> Fit:
    r"""Collapse curves measured at several sizes, or times, onto one master curve.

    $$\ln Y = \sum_k c_k B_k(\ln X), \qquad (X, Y) = \text{ansatz}(x, y, L, \text{parameters})$$

    Arguments:
        curves: {size: Curve}, sizes in the scale's unit of length; or several such mappings, one a
            measure, fitted together. Parameters of the same name are shared between measures.
            Curves of one size with equally many rows are taken to come from the same surfaces.
        ansatz: the scaling form, one a measure; by default the preset of the curves' kind. A plain
            function (x, y, L, parameters) -> (X, Y), traceable by JAX, needs `start`.
        start: starting values by name, replacing those of the ansatz.
        window: (low, high) in the scale's unit, or a function (curve, size) -> (low, high).
        correction: "size", "scale" or "both" adds $a L^{-\omega}$, $b x^{-\omega}$ or both to
            $\ln Y$, with amplitudes of their own for each measure.
        omega: the exponent of the correction; None fits it, which the data must be able to carry.
        versus: "size", or "time" for $t^{1/z}$ in place of L, with z fitted.
        share_alpha: tie the exponents of every measure to one alpha by theory.
        coefficients: of the spline of each measure, 6 or more; chosen from the data by default.
        draws: how many times surfaces are drawn again, 20 or more.
        rng: a generator or a seed for the draws.

    Returns:
        A `Fit` over the parameters (and "omega" if fitted). Its details hold the sizes, the quality
        "S", the refits behind the systematic errors, and the scaled points and master curves.

    Raises:
        ValueError: fewer than two sizes, curves of different kinds or units, too few surfaces or
            points, an unknown choice, or a start without all parameters.

    Source: the paper's Eq. (FSSform); Houdayer & Hartmann (2004) for S.
    """
    measures = _measures(curves)
    check_choice("versus", versus, ("size", "time"))
    check_integer("draws", draws, low=20, remedy="200 draws give errors to 5 %.")
    if correction is not None:
        check_choice("correction", correction, CORRECTIONS)
    if omega is not None:
        check_in_range(
            "omega", omega, 0.0, np.inf, closed=(False, False), remedy="Pass None to fit it."
        )
    forms = _forms(measures, ansatz, start, versus, share_alpha)
    values: dict[str, float] = {}
    for form in forms:
        values.update(form.start)
    values.update(start or {})
    if correction is not None and omega is None:
        values.setdefault("omega", 1.0)
    begin = np.array([float(value) for value in values.values()])
    if not np.all(np.isfinite(begin)):
        raise ValueError(f"starting values must be finite; got {values}. Pass other ones.")
    stack = stack_curves(measures, window)
    whole = np.ones(len(stack.x), bool)
    transforms = tuple(form.transform for form in forms)
    probe = CollapseProblem(transforms, tuple(values), FEWEST, correction)
    count = coefficients or _coefficient_count(probe, begin, stack, _data(stack, whole, omega))
    check_integer("coefficients", count, low=FEWEST, remedy="Leave it out to have it chosen.")
    problem = CollapseProblem(transforms, tuple(values), count, correction)

    data, found = _solve(problem, stack, whole, omega, begin)
    best = found.values
    slope = solver.slopes(problem, best, data)
    stacks = stack.bootstrap(draws, np.random.default_rng(rng))
    refits, good = problem.solve_all(best, (_data(drawn, whole, omega, slope) for drawn in stacks))
    statistical = np.atleast_2d(np.cov(refits[good].T)) if good.sum() > 1 else None
    variants = _variants(problem, stack, data, best, omega)
    sizes = sorted({float(size) for one in measures for size in one})
    status = _status(found, good, values, best, problem, data)
    if statistical is None:
        statistical = np.full((len(best),) * 2, np.inf)
    if found.success and (open_ := solver.undetermined(problem, best, data)).any():
        names = ", ".join(np.array(list(values))[open_])
        status = (
            f"undetermined: other values of {names} fit as well, and what is shown is where the "
            "fit started. Leave out the correction, or add sizes: with a correction for size two "
            "sizes fix no exponent of y."
        )
        statistical[open_, :] = statistical[:, open_] = 0.0
        statistical[open_, open_] = np.inf
    return Fit(
        model="collapse: " + "; ".join(form.name for form in forms),
        values=dict(zip(values, best.tolist(), strict=True)),
        stderr=dict(zip(values, np.sqrt(np.diag(statistical)).tolist(), strict=True)),
        covariance=statistical,
        chi2=float(found.chi2),
        dof=int(len(stack.x) - len(best) - _linear_count(problem)),
        systematic=systematic_errors(variants, tuple(values), best),
        status=status,
        details={
            "kinds": tuple(next(iter(one.values())).kind for one in measures),
            versus + "s": sizes,
            "points": len(stack.x),
            "coefficients": count,
            "correction": correction,
            "omega": omega if correction is not None else None,
            "draws": draws,
            "draws_failed": int((~good).sum()),
            "variants": {
                name: dict(zip(values, v.tolist(), strict=True)) for name, v, _ in variants
            },
            **_picture(problem, stack, data, best, len(measures)),
        },
    )


def _measures(curves: Curves) -> list[dict[float, Curve]]:
    several = [curves] if isinstance(curves, Mapping) else list(curves)
    if not several or not all(isinstance(one, Mapping) for one in several):
        raise TypeError(
            "curves must be {size: Curve} or a sequence of such mappings; got "
            f"{type(curves).__name__}. Pass e.g. {{64: P64, 128: P128}}."
        )
    for one in several:
        if len(one) < 2:
            raise ValueError(
                f"a collapse needs at least 2 sizes; got {sorted(one)}. Measure another size, or "
                "use fit_power_law for a single one."
            )
        for size in one:
            check_in_range(
                "each size", size, 0.0, np.inf, closed=(False, False), remedy="Pass {size: Curve}."
            )
        for name in ("kind", "units"):
            if len(found := {getattr(curve, name) for curve in one.values()}) > 1:
                raise ValueError(
                    f"curves of one measure must share {name}; got {sorted(map(str, found))}. "
                    "Convert them, or pass each measure as a mapping of its own."
                )
    if len(lengths := {next(iter(one.values())).units[0] for one in several}) > 1 and not any(
        next(iter(one.values())).kind == "spectrum" for one in several
    ):
        raise ValueError(
            f"measures to collapse together must share the unit of scale; got {sorted(lengths)}. "
            "Measure all of them with one spacing."
        )
    return [{float(size): curve for size, curve in one.items()} for one in several]


def _forms(
    measures: list[dict[float, Curve]],
    ansatz: Form | Sequence[Form] | None,
    start: Mapping[str, Number] | None,
    versus: str,
    share_alpha: bool,
) -> list[Ansatz]:
    kinds = [next(iter(one.values())).kind for one in measures]
    if ansatz is None:
        if unknown := [kind for kind in kinds if kind not in PRESETS]:
            raise ValueError(
                f"no scaling form is known for {unknown}; known are {sorted(PRESETS)}. "
                "Pass ansatz=(x, y, L, parameters) -> (X, Y) with start=."
            )
        given: list[Any] = [PRESETS[kind] for kind in kinds]
    else:
        given = list(ansatz) if isinstance(ansatz, Sequence) else [ansatz] * len(measures)
    if len(given) != len(measures):
        raise ValueError(
            f"ansatz must be one a measure; got {len(given)} for {len(measures)} measures. "
            "Pass a single one to use it for all."
        )
    forms = []
    for form in given:
        if not isinstance(form, Ansatz):
            if not start:
                raise ValueError(
                    "a function as ansatz needs starting values; got start=None. "
                    "Pass start={'nu': 1.0, ...} with every parameter it reads."
                )
            form = Ansatz(getattr(form, "__name__", "user's form"), tuple(start.items()), form)
        form = form.sharing_alpha() if share_alpha else form
        forms.append(form.in_time() if versus == "time" else form)
    return forms


def _data(
    stack: Stack, use: Bool[np.ndarray, " point"], omega: Number | None, slope: Any = None
) -> dict[str, Any]:
    slope = np.ones(len(stack.x)) if slope is None else slope
    return {
        "log_y": stack.log_y,
        "scale": stack.x,
        "size": stack.size,
        "measure": stack.measure,
        "use": use,
        "whitening": stack.whitening(use, slope),
        "omega": 1.0 if omega is None else float(omega),
        "smallest_scale": stack.x.min(),
        "smallest_size": stack.size.min(),
    }


def _solve(
    problem: CollapseProblem,
    stack: Stack,
    use: Bool[np.ndarray, " point"],
    omega: Number | None,
    start: Float[np.ndarray, " parameter"],
) -> tuple[dict[str, Any], Any]:
    """Solve, and once more if the form bends the errors (d ln Y / d ln y is not one)."""
    data = _data(stack, use, omega)
    found = problem.solve(start, data)
    slope = solver.slopes(problem, found.values, data)
    if np.any(np.abs(slope - 1) > 1e-9) and np.all(np.isfinite(slope)):
        data["whitening"] = stack.whitening(use, slope)
        found = problem.solve(found.values, data)
    return data, found


def _coefficient_count(problem: CollapseProblem, start: Any, stack: Stack, data: Any) -> int:
    log_X = solver.profile(problem, start, data)[2]
    ranges, points = [], []
    for index in range(len(problem.transforms)):
        mine = log_X[stack.measure == index]
        ranges.append(np.ptp(mine))
        points.append(len(mine))
    wanted = 3 + int(np.ceil(max(ranges) / COEFFICIENT_WIDTH))
    return int(np.clip(min(wanted, min(points) // 3), FEWEST, MOST))


def _linear_count(problem: CollapseProblem) -> int:
    terms = len(SCALES[problem.correction]) if problem.correction else 0
    return len(problem.transforms) * (problem.coefficients + terms)


def _variants(
    problem: CollapseProblem, stack: Stack, data: dict[str, Any], best: Any, omega: Number | None
) -> list[tuple[str, Any, Any]]:
    """Refits with one choice changed: name, values, variance beyond that of the best fit."""
    own = np.diag(solver.covariance(problem, best, data))
    choices: list[tuple[str, CollapseProblem, Any, float | None]] = []
    sizes = np.unique(stack.size)
    if len(sizes) > 2:
        choices.append((f"without {sizes[0]:g}", problem, stack.size > sizes[0], omega))
    if len(sizes) > 4:
        choices.append(
            (f"without {sizes[0]:g}, {sizes[1]:g}", problem, stack.size > sizes[1], omega)
        )
    position = stack.position()
    choices.append(("upper 3/4 of scales", problem, position >= 0.25, omega))
    choices.append(("lower 3/4 of scales", problem, position <= 0.75, omega))
    if problem.correction and omega is not None:
        whole = np.ones(len(stack.x), bool)
        for factor in (0.7, 1.4):
            choices.append((f"omega {omega * factor:.3g}", problem, whole, omega * factor))
    results = []
    for name, changed, use, at_omega in choices:
        if len(stack.x[use]) <= len(best) + _linear_count(changed):
            continue
        varied, found = _solve(changed, stack, use, at_omega, best)
        if found.success:
            spread = np.diag(solver.covariance(changed, found.values, varied))
            results.append((name, found.values, np.clip(spread - own, 0.0, None)))
    return results


def _status(
    found: Any, good: Any, values: Any, best: Any, problem: CollapseProblem, data: dict[str, Any]
) -> str:
    if not found.success:
        return found.status
    if good.mean() < 0.9:
        return (
            f"unstable: {int((~good).sum())} of {len(good)} bootstrap refits failed. Fix omega, "
            "leave out a correction, or add surfaces."
        )
    at = dict(zip(values, best, strict=True))
    if at.get("omega", 1.0) <= 0:
        return f"omega came out at {at['omega']:.3g}, not positive: no such correction. Fix omega."
    if at.get("z", 1.0) <= 0:
        return f"z came out at {at['z']:.3g}, not positive. Start nearer, or check the times."
    log_X = solver.profile(problem, best, data)[2]
    for index in range(len(problem.transforms)):
        ends = [
            (log_X[rows].min(), log_X[rows].max())
            for size in np.unique(data["size"])
            if (rows := (data["size"] == size) & (data["measure"] == index)).any()
        ]
        ends.sort()
        if all(later[0] > earlier[1] for earlier, later in zip(ends, ends[1:], strict=False)):
            return (
                "the scaled curves do not overlap, so any exponents would do. Widen the window, "
                "add sizes in between, or start nearer."
            )
    return "converged"


def _picture(
    problem: CollapseProblem, stack: Stack, data: dict[str, Any], best: Any, measures: int
) -> dict[str, Any]:
    """S, and the scaled points and master curve of each measure, corrections taken off."""
    residuals, linear, log_X, log_Y = solver.profile(problem, best, data)
    count = problem.coefficients
    terms = linear[measures * count :]
    omega = best[problem.names.index("omega")] if "omega" in problem.names else data["omega"]
    for number, amount in enumerate(terms):
        name = SCALES[problem.correction or "size"][number // measures]
        term = data[name] ** -omega / data[f"smallest_{name}"] ** -omega
        log_Y = log_Y - np.where(stack.measure == number % measures, amount * term, 0.0)
    error = stack.stderr()
    quality, collapsed, masters = [], [], []
    for index in range(measures):
        rows = stack.measure == index
        quality.append(houdayer_hartmann(log_X[rows], log_Y[rows], error[rows], stack.size[rows]))
        collapsed.append(
            {
                float(size): {
                    "X": np.exp(log_X[at]),
                    "Y": np.exp(log_Y[at]),
                    "error": np.exp(log_Y[at]) * error[at],
                }
                for size in np.unique(stack.size[rows])
                if (at := rows & (stack.size == size)).any()
            }
        )
        u = np.linspace(log_X[rows].min(), log_X[rows].max(), 200)
        curve = solver.master_curve(u, linear[index * count : (index + 1) * count])
        masters.append({"X": np.exp(u), "Y": curve})
    return {
        "S": float(np.mean(quality)),
        "corrections": terms.tolist(),
        "collapsed": collapsed,
        "master": masters,
    }
