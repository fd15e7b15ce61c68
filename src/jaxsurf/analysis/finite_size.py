r"""The "FSS" columns of Table I: loop exponents from collapses over several sizes.

For each roughness exponent, whole level sets of surfaces of several sizes give
$\langle s\rangle(R, L)$, $P_>(s, L)$ and $G(r, L)$. The first two are collapsed together with one
$D_f$ and their covariance, the third by itself, each with a correction $x^{-\omega}$ for the
lattice (Eq. FSSform).

Loops that wind around the map are no loops of the plane and are left out of all three, but their
length still counts in the total that $P_>$ and G are shares of. Without them in the total both
would be too large by a factor $1 + O(L^{-(1-\alpha)/2})$, which falls so slowly with L that no
collapse tells it from a smaller exponent.

Source: the paper's Sec. V C, Table I, Figs. 8 and 9.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import jax
import numpy as np

from jaxsurf._checks import check_in_range, check_integer, check_shape
from jaxsurf.analysis.table1 import (
    WHITE_NOISE,
    Table1,
    law_of,
    name_of,
    paper_table,
    theory_values,
)
from jaxsurf.curve import Curve, concatenate
from jaxsurf.fitting.collapse import fit_collapse
from jaxsurf.fitting.fit import Fit
from jaxsurf.fitting.local_exponents import LocalExponent, local_exponents
from jaxsurf.loops.levels import level_loops
from jaxsurf.loops.pairs import all_pairs_correlation
from jaxsurf.surfaces.gaussian import sample

Progress = Callable[[float, str], None]
KINDS = ("mean_length", "length_tail", "loop_correlation")
#: Exponent -> the collapse it comes from, and its name there.
COLUMNS = {
    "2x_l": ("correlation", "two_x_l"),
    "D_f": ("loops", "D_f"),
    "tau-2": ("loops", "tau_minus_2"),
}
#: Exponent -> the measure that shows it from size to size, and its sign there.
STEPS = {"2x_l": ("loop_correlation", -1.0), "D_f": ("mean_length", 1.0)}
#: kind -> smallest scale, and largest in units of L (None: up to where loops run out).
WINDOWS: dict[str, tuple[float, float | None]] = {
    "mean_length": (8.0, 0.4),
    "length_tail": (80.0, None),
    "loop_correlation": (4.0, 0.4),
}
#: Sites simulated at once; memory is some 200 bytes a site.
_BATCH_SITES = 2**22


@dataclass(frozen=True)
class FiniteSizeSettings:
    """What is simulated.

    Attributes:
        alphas: roughness exponents.
        sizes: sides L of the maps, three or more.
        sites: sites of all maps of one size together, which sets how many there are.
        fewest: at least so many maps of each size, and
        most: at most.
        levels: level sets of each map.
        omega: exponent of the correction to scaling.
        draws: bootstrap draws of each collapse.
        seed: of every random number.

    Raises:
        ValueError: a value out of its range.
    """

    alphas: tuple[float | int, ...] = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0)
    sizes: tuple[int, ...] = (64, 128, 256, 512, 1024, 2048)
    sites: int = 2**26
    fewest: int = 12
    most: int = 8000
    levels: int = 8
    omega: float | int = 1.0
    draws: int = 100
    seed: int = 0

    def __post_init__(self):
        _check_alphas(self.alphas)
        if len(self.sizes) < 3:
            raise ValueError(f"sizes must be three or more; got {self.sizes}. Add another size.")
        for side in self.sizes:
            check_shape((side, side))
        for alpha in self.alphas:
            check_in_range("alpha", alpha, -1.0, 1.0, remedy="Rough surfaces have 0 to 1.")
        check_integer("sites", self.sites, low=1, remedy="2**26 take two minutes an alpha.")
        check_integer("fewest", self.fewest, low=5, remedy="Covariances need at least 5 surfaces.")
        check_integer("most", self.most, low=self.fewest, remedy="It limits small sizes.")
        check_integer("levels", self.levels, low=1, remedy="8 are nearly independent.")
        check_integer("draws", self.draws, low=20, remedy="100 give errors to 7 %.")
        check_integer("seed", self.seed, low=0, remedy="Pass any whole number.")

    def surfaces(self, side: int) -> int:
        """How many maps of one size."""
        return int(np.clip(self.sites // side**2, self.fewest, self.most))


@dataclass(frozen=True)
class FiniteSizeRow:
    """One roughness exponent: the collapses, and the paper's FSS values beside theory's.

    Attributes:
        alpha: roughness exponent.
        fits: "loops" (D_f and tau-2 together) and "correlation" (2x_l).
        paper: exponent -> (value, error) of the paper's FSS column; empty if it has none.
        theory: exponent -> predicted value.
        steps: "2x_l" and "D_f" from each size to the next, at a fixed share of the map.
    """

    alpha: float
    fits: dict[str, Fit]
    paper: dict[str, tuple[float, float]]
    theory: dict[str, float]
    steps: dict[str, tuple[LocalExponent, ...]]

    def value(self, name: str) -> float:
        """The exponent from the collapse."""
        fit, inner = COLUMNS[name]
        return self.fits[fit].values[inner]

    def errors(self, name: str) -> tuple[float, float]:
        """Its statistical and systematic errors."""
        fit, inner = COLUMNS[name]
        return self.fits[fit].stderr[inner], self.fits[fit].systematic.get(inner, 0.0)

    def pull(self, name: str) -> float:
        """Distance from theory in total errors."""
        return (self.value(name) - self.theory[name]) / float(np.hypot(*self.errors(name)))

    def relations(self) -> dict[str, tuple[float, float]]:
        r"""How far the measured exponents are from obeying the scaling relations, with errors.

        $$D_f(\tau - 1) = 2 - \alpha, \qquad D_f(3 - \tau) = 2 - 2x_l$$

        They hold whatever $x_l$ is, whereas theory's values take $2x_l = 1$ as well: where they
        close and $2x_l$ is not 1, it is that conjecture which fails. The errors of $2x_l$, from
        another collapse, are added as if independent; those of $D_f$ and $\tau$ jointly.

        Source: the paper's Eqs. (scaling2), (scaling1) and (loopcorr-conj).
        """
        x, fractal, tail = (self.value(name) for name in COLUMNS)
        loops = self.fits["loops"]
        systematic = [loops.systematic.get(name, 0.0) for name in ("D_f", "tau_minus_2")]
        order = [loops.names.index(name) for name in ("D_f", "tau_minus_2")]
        covariance = loops.covariance[np.ix_(order, order)] + np.diag(np.square(systematic))

        def error(*slopes: float) -> float:
            return float(np.sqrt(np.array(slopes) @ covariance @ np.array(slopes)))

        return {
            "D_f (tau - 1) - (2 - alpha)": (
                fractal * (1 + tail) - (2 - self.alpha),
                error(1 + tail, fractal),
            ),
            "D_f (3 - tau) - (2 - 2x_l)": (
                fractal * (1 - tail) - (2 - x),
                float(np.hypot(error(1 - tail, -fractal), np.hypot(*self.errors("2x_l")))),
            ),
        }

    def nearer(self, name: str) -> bool | None:
        """Whether this value is nearer to theory than the paper's; None where it has none."""
        if name not in self.paper:
            return None
        ours = abs(self.value(name) - self.theory[name])
        return bool(ours < abs(self.paper[name][0] - self.theory[name]))


@dataclass(frozen=True)
class FiniteSize:
    """The FSS columns with everything measured on the way.

    Attributes:
        settings: what was simulated; None if the curves were given.
        rows: one an alpha.
        curves: alpha -> kind -> L -> curve.
    """

    settings: FiniteSizeSettings | None
    rows: tuple[FiniteSizeRow, ...]
    curves: dict[float, dict[str, dict[int, Curve]]]

    def to_dict(self) -> dict[str, Any]:
        """Settings, values, errors and fits, ready for JSON."""
        return {
            "settings": None if self.settings is None else vars(self.settings),
            "windows": WINDOWS,
            "rows": [
                {
                    "alpha": row.alpha,
                    "exponents": {
                        name: {
                            "value": row.value(name),
                            "statistical": row.errors(name)[0],
                            "systematic": row.errors(name)[1],
                            "paper": row.paper.get(name),
                            "theory": row.theory[name],
                        }
                        for name in COLUMNS
                    },
                    "fits": {name: fit.to_dict() for name, fit in row.fits.items()},
                    "relations": row.relations(),
                    "steps": {
                        name: [vars(step) for step in steps] for name, steps in row.steps.items()
                    },
                }
                for row in self.rows
            ],
        }

    def to_rows(self) -> list[dict[str, float]]:
        """One flat record an alpha, ready for CSV."""
        records = []
        for row in self.rows:
            record: dict[str, float] = {"alpha": row.alpha}
            for name in COLUMNS:
                record[f"{name} fss"] = row.value(name)
                record[f"{name} statistical"], record[f"{name} systematic"] = row.errors(name)
                paper = row.paper.get(name, (float("nan"), float("nan")))
                record[f"{name} paper"], record[f"{name} paper error"] = paper
                record[f"{name} theory"] = row.theory[name]
            records.append(record)
        return records


def reproduce_finite_size(
    settings: FiniteSizeSettings | None = None, *, progress: Progress | None = None
) -> FiniteSize:
    """Simulate level sets of several sizes and collapse their loop measures.

    Arguments:
        settings: what to simulate; sizes to 2048 if None.
        progress: called with the share of the work done, 0 to 1, and what comes next.

    Returns:
        The FSS columns with their curves and fits.

    Source: the paper's Sec. V C, Table I.
    """
    settings = settings or FiniteSizeSettings()
    report = progress or (lambda share, text: None)
    cost = {side: settings.surfaces(side) * side**2 for side in settings.sizes}
    total, done = sum(cost.values()) * len(settings.alphas), 0
    curves: dict[float, dict[str, dict[int, Curve]]] = {}
    rows = []
    for alpha in map(float, settings.alphas):
        curves[alpha] = {kind: {} for kind in KINDS}
        for side in settings.sizes:
            report(done / total, f"{name_of(alpha)}, L = {side}")
            for kind, curve in measure_size(alpha, side, settings).items():
                curves[alpha][kind][side] = curve
            done += cost[side]
        report(done / total, f"{name_of(alpha)}, collapse")
        rows.append(collapse_row(alpha, curves[alpha], omega=settings.omega, draws=settings.draws))
    report(1.0, "done")
    return FiniteSize(settings, tuple(rows), curves)


def collapse_table1(
    table: Table1, *, draws: int = 100, progress: Progress | None = None
) -> FiniteSize:
    """The FSS columns from the direct table's own curves: the paper's sizes and statistics.

    These are loops traced from random points of some 25 surfaces a size, with P_> and G as shares
    of the closed loops, as in the paper; too few for errors below some hundredths.

    Arguments:
        table: from `reproduce_table1`, with three sizes or more.
        draws: bootstrap draws of each collapse.
        progress: called with the share of the work done, 0 to 1, and what comes next.

    Raises:
        ValueError: a table of fewer than three sizes, or of white noise alone.

    Source: the paper's Sec. V C, Table I.
    """
    report = progress or (lambda share, text: None)
    sizes = table.settings.sizes
    if len(sizes) < 3:
        raise ValueError(
            f"finite-size scaling needs three sizes or more; got {sizes}. "
            "Make the table with Table1Settings(sizes=(64, 128, 256, 512))."
        )
    alphas = [float(alpha) for alpha in table.settings.alphas if alpha != WHITE_NOISE]
    _check_alphas(alphas)
    curves = {
        alpha: {kind: {side: table.curves[alpha, side][kind] for side in sizes} for kind in KINDS}
        for alpha in alphas
    }
    rows = []
    for number, alpha in enumerate(alphas):
        report(number / len(alphas), f"{name_of(alpha)}, collapse")
        rows.append(collapse_row(alpha, curves[alpha], draws=draws))
    report(1.0, "done")
    return FiniteSize(None, tuple(rows), curves)


def measure_size(alpha: float, side: int, settings: FiniteSizeSettings) -> dict[str, Curve]:
    """The three loop measures of whole level sets of all maps of one size."""
    key = jax.random.key(settings.seed)
    for part in (round((alpha + 1) * 1e6), side):
        key = jax.random.fold_in(key, part)
    parts: dict[str, list[Curve]] = {kind: [] for kind in KINDS}
    surfaces = settings.surfaces(side)
    chunk = max(1, _BATCH_SITES // side**2)
    for first in range(0, surfaces, chunk):
        batch = min(chunk, surfaces - first)
        inner = jax.random.fold_in(key, first)
        heights = np.asarray(sample(law_of(alpha), (side, side), key=inner, batch=batch))
        rng = np.random.default_rng([settings.seed, round((alpha + 1) * 1e6), side, first])
        loops = level_loops(heights, settings.levels, rng=rng, paths=True)
        parts["mean_length"].append(loops.mean_length())
        parts["length_tail"].append(loops.length_tail(share="all"))
        parts["loop_correlation"].append(all_pairs_correlation(loops, rng=rng, share="all"))
    return {kind: concatenate(several) for kind, several in parts.items()}


def collapse_row(
    alpha: float,
    curves: Mapping[str, Mapping[int, Curve]],
    *,
    omega: float | int = 1.0,
    draws: int = 100,
) -> FiniteSizeRow:
    """Collapse the three loop measures of one alpha, from any curves by kind and size.

    Arguments:
        alpha: roughness exponent.
        curves: kind -> {L: Curve}, e.g. those kept in `Table1.curves`.
        omega: exponent of the correction to scaling.
        draws: bootstrap draws.
    """

    def window(curve: Curve, size: float) -> tuple[float, float]:
        low, high = WINDOWS[curve.kind]
        return low, np.inf if high is None else high * size

    options: dict[str, Any] = {
        "window": window,
        "correction": "scale",
        "omega": omega,
        "draws": draws,
        "coefficients": 12,
    }
    theory = theory_values(alpha)
    start = {"D_f": theory["D_f"], "tau_minus_2": theory["tau-2"]}
    fits = {
        "loops": fit_collapse(
            [curves["mean_length"], curves["length_tail"]], start=start, **options
        ),
        "correlation": fit_collapse(curves["loop_correlation"], **options),
    }
    steps = {
        name: tuple(
            replace(step, value=sign * step.value) for step in local_exponents(curves[kind])
        )
        for name, (kind, sign) in STEPS.items()
    }
    return FiniteSizeRow(alpha, fits, _paper_values(alpha), theory, steps)


def _check_alphas(alphas: Sequence[float | int]) -> None:
    if not alphas:
        raise ValueError(
            "finite-size scaling needs a surface with alpha from 0 to 1; got none. White noise has "
            "no such column: add e.g. 0.4."
        )


def _paper_values(alpha: float) -> dict[str, tuple[float, float]]:
    if alpha == WHITE_NOISE:
        return {}
    columns = {"2x_l": "two_xl", "D_f": "Df", "tau-2": "tau_minus_2"}
    for record in paper_table("table1_gaussian.csv"):
        if abs(record["alpha"] - alpha) < 1e-9:
            return {
                name: (record[f"{column}_fss"], record[f"{column}_fss_err"])
                for name, column in columns.items()
            }
    return {}
