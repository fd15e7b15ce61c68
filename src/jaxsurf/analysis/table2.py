r"""Table II of the paper: the single-step model at three strengths of growth.

Surfaces of each $p_+$ and size are grown from flat, left to equilibrate, and looked at many times;
all snapshots of a run make one sample. From the largest size come the direct columns, straight
lines on $\langle C_b^2\rangle$, on the spectrum along four directions, on $\langle s\rangle(R)$
and on $P_>(s)$; from the collapse of $\langle s\rangle(R)$ and $P_>(s)$ over all sizes the columns
of finite-size scaling (FSS), $D_f$ and $\tau - 2$ together, and each of them inverted to alpha.
The collapse carries the lattice's corrections $R^{-1}$ and $s^{-1}$, as those of Table I do:
without them surfaces at $p_+ = 1/2$, whose loops must have $D_f = 3/2$, come out at 1.43.

How far growth is from the symmetry $h \to -h$ of equilibrium is beside the table: skewness and
excess kurtosis of the heights, and the skewness of the curvature as a curve over b.

Source: the paper's Sec. VI, Table II, Figs. 12-16.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from jaxsurf import theory
from jaxsurf.analysis.table1 import Progress, paper_table
from jaxsurf.analysis.table2_runs import Table2Settings as Table2Settings
from jaxsurf.analysis.table2_runs import grow, measure
from jaxsurf.curve import Curve
from jaxsurf.fitting.collapse import fit_collapse
from jaxsurf.fitting.fit import Fit
from jaxsurf.fitting.power_law import fit_power_law

#: Column -> its name in the paper's table.
COLUMNS = {
    "alpha C2": "alpha_C2",
    "alpha spectrum": "alpha_spectrum",
    "D_f direct": "Df_direct",
    "D_f FSS": "Df_fss",
    "alpha D_f": "alpha_from_Df",
    "tau-2 direct": "tau_minus_2_direct",
    "tau-2 FSS": "tau_minus_2_fss",
    "alpha tau": "alpha_from_tau",
}
#: Fitting windows as shares of the largest side, 3 < b < 24, 10 < R < 100, 50 < s < 500 at L = 128.
WINDOWS = {
    "curvature_moment": (3 / 128, 24 / 128),
    "mean_length": (10 / 128, 100 / 128),
    "length_tail": (50 / 128, 500 / 128),
}
LARGEST_Q = 0.5  # beyond, the lattice bends the spectrum whatever the size
#: kind -> smallest scale of the collapse, and largest in units of L (None: where loops run out).
FSS_WINDOWS: dict[str, tuple[float, float | None]] = {
    "mean_length": (6.0, 0.7),
    "length_tail": (40.0, None),
}


@dataclass(frozen=True)
class Entry:
    """One cell of the table.

    Attributes:
        value: measured.
        statistical: its error between runs.
        systematic: how far it moves with the fitting window or the sizes taken.
        fit: where it comes from.
        paper: the paper's value and error, propagated anew where the column is derived; None if it
            has none.
    """

    value: float
    statistical: float
    systematic: float
    fit: Fit
    paper: tuple[float, float] | None

    @property
    def error(self) -> float:
        """Both errors, in quadrature."""
        return float(np.hypot(self.statistical, self.systematic))

    @property
    def pull(self) -> float:
        """Distance from the paper's value in combined standard errors; NaN where it has none."""
        if self.paper is None:
            return float("nan")
        return (self.value - self.paper[0]) / float(np.hypot(self.error, self.paper[1]))


@dataclass(frozen=True)
class Table2Row:
    """One p_plus.

    Attributes:
        p_plus: chance of deposition.
        entries: column -> cell.
        skewness: of the heights at the largest size, and its error between runs.
        kurtosis: their excess kurtosis, and its error.
        winding: share of the loops left out because they wind around the largest map.
    """

    p_plus: float
    entries: dict[str, Entry]
    skewness: tuple[float, float]
    kurtosis: tuple[float, float]
    winding: float


@dataclass(frozen=True)
class Table2:
    """The reproduced table with everything measured on the way.

    Attributes:
        settings: what was simulated.
        rows: one a p_plus.
        curves: (p_plus, L) -> name -> curve, one row of samples a run.
    """

    settings: Table2Settings
    rows: tuple[Table2Row, ...]
    curves: dict[tuple[float, int], dict[str, Curve]]

    @property
    def side(self) -> int:
        """The size of the direct columns."""
        return max(self.settings.sizes)

    def to_dict(self) -> dict[str, Any]:
        """Settings, values, errors and fits, ready for JSON."""
        return {
            "settings": vars(self.settings),
            "rows": [
                {
                    "p_plus": row.p_plus,
                    "skewness": row.skewness,
                    "kurtosis": row.kurtosis,
                    "winding": row.winding,
                    "columns": {
                        name: {
                            "value": entry.value,
                            "statistical": entry.statistical,
                            "systematic": entry.systematic,
                            "paper": entry.paper,
                            "pull": entry.pull,
                            "fit": _without_points(entry.fit.to_dict()),
                        }
                        for name, entry in row.entries.items()
                    },
                }
                for row in self.rows
            ],
        }

    def to_rows(self) -> list[dict[str, float]]:
        """One flat record a p_plus, ready for CSV."""
        records = []
        for row in self.rows:
            record = {"p_plus": row.p_plus}
            record["skewness"], record["skewness error"] = row.skewness
            record["kurtosis"], record["kurtosis error"] = row.kurtosis
            for name, entry in row.entries.items():
                paper = entry.paper or (float("nan"), float("nan"))
                record |= {
                    name: entry.value,
                    f"{name} statistical": entry.statistical,
                    f"{name} systematic": entry.systematic,
                    f"{name} paper": paper[0],
                    f"{name} paper error": paper[1],
                }
            records.append(record)
        return records


def reproduce_table2(
    settings: Table2Settings | None = None, *, progress: Progress | None = None
) -> Table2:
    """Grow surfaces, measure them and fit every column of Table II.

    Arguments:
        settings: what to simulate; `Table2Settings.quick()` for a first look; if None, the paper's
            longest run, in sweeps, for every p_plus.
        progress: called with the share of the work done, 0 to 1, and what comes next.

    Returns:
        The table with its curves.

    Source: the paper's Sec. VI, Table II.
    """
    settings = settings or Table2Settings()
    report = progress or (lambda share, text: None)
    # a sweep costs in proportion to the sites, and the sweeps grow like L^2
    total = sum(side**4 for side in settings.sizes) * len(settings.p_plus)
    done = 0.0
    rows, curves = [], {}
    for p_plus in settings.p_plus:
        winding = 0.0
        for side in settings.sizes:
            name = f"p₊ = {p_plus:g}, L = {side}"
            share = side**4 / total

            def part(inner: float, what: str, name=name, share=share, done=done) -> None:
                report(0.98 * (done + 0.9 * share * inner), f"{name}: {what}")

            heights = grow(p_plus, side, settings, part)
            part(1.0, "measuring")
            curves[p_plus, side], wound = measure(heights, p_plus, settings)
            winding = wound if side == max(settings.sizes) else winding
            done += share
        report(0.98 * done, f"p₊ = {p_plus:g}: fitting")
        of_size = {side: curves[p_plus, side] for side in settings.sizes}
        largest = of_size[max(settings.sizes)]
        skewness, kurtosis = (
            (float(curve.mean[0]), float(curve.stderr[0]))
            for curve in (largest["height skewness"], largest["height kurtosis"])
        )
        entries = _entries(p_plus, of_size, settings.draws)
        rows.append(Table2Row(p_plus, entries, skewness, kurtosis, winding))
    report(1.0, "done")
    return Table2(settings, tuple(rows), curves)


def merge_scales(curves: list[Curve]) -> Curve:
    """One curve over the scales of several that were measured on the same surfaces."""
    scale = np.concatenate([curve.scale for curve in curves])
    order = np.argsort(scale, kind="stable")
    samples = np.concatenate([curve.samples for curve in curves], 1)[:, order]
    weights = np.concatenate([curve.weights for curve in curves], 1)[:, order]
    return Curve(curves[0].kind, scale[order], samples, weights, units=curves[0].units)


def paper_entry(p_plus: float, column: str) -> tuple[float, float] | None:
    """The paper's value and error; errors of alpha are propagated anew from the FSS columns."""
    for record in paper_table("table2_single_step.csv"):
        if abs(record["p_plus"] - p_plus) < 1e-9:
            break
    else:
        return None
    name = COLUMNS[column]
    value, error = record[name], record[f"{name}_err"]
    if column == "alpha D_f":
        error = 2 * record["Df_fss_err"]
    if column == "alpha tau":
        tail, of_tail = record["tau_minus_2_fss"], record["tau_minus_2_fss_err"]
        error = theory.alpha_from_length_tail(tail, of_tail)[1]
    return value, float(error)


def _entries(p_plus: float, curves: dict[int, dict[str, Curve]], draws: int) -> dict[str, Entry]:
    side = max(curves)
    largest = curves[side]
    windows = {kind: (low * side, high * side) for kind, (low, high) in WINDOWS.items()}

    def line(curve: Curve, window: tuple[float, float]) -> Fit:
        return fit_power_law(curve, window=window, weighting="equal")

    of_c2 = line(largest["curvature 2"], windows["curvature_moment"])
    directions = merge_scales([largest["spectrum 10"], largest["spectrum 11"]])
    of_spectrum = fit_power_law(directions, window=(0.99 * 2 * np.pi / side, LARGEST_Q))
    of_length = line(largest["mean_length"], windows["mean_length"])
    of_tail = line(largest["length_tail"], windows["length_tail"])
    of_sizes = []
    for kind, (low, high) in FSS_WINDOWS.items():
        # <s>(R) of a size must reach over a factor of 3 in R to say anything
        sizes = [size for size in curves if high is None or high * size > 3 * low]
        if len(sizes) > 1:
            of_sizes.append({size: curves[size][kind] for size in sizes})
    collapse = fit_collapse(of_sizes, window=_fss_window, correction="scale", draws=draws)
    cells: dict[str, tuple[Fit, str, Any]] = {
        "alpha C2": (of_c2, "exponent", lambda slope: (slope / 2, 0.5)),
        "alpha spectrum": (of_spectrum, "exponent", lambda slope: (-slope / 2 - 1, 0.5)),
        "D_f direct": (of_length, "exponent", lambda slope: (slope, 1.0)),
        "D_f FSS": (collapse, "D_f", lambda value: (value, 1.0)),
        "alpha D_f": (collapse, "D_f", lambda v: theory.alpha_from_fractal_dimension(v, 1.0)),
        "tau-2 direct": (of_tail, "exponent", lambda slope: (-slope, 1.0)),
        "tau-2 FSS": (collapse, "tau_minus_2", lambda value: (value, 1.0)),
        "alpha tau": (collapse, "tau_minus_2", lambda v: theory.alpha_from_length_tail(v, 1.0)),
    }
    entries = {}
    for column, (fit, name, to_value) in cells.items():
        value, derivative = to_value(fit.values[name])
        statistical = derivative * fit.stderr[name]
        systematic = derivative * fit.systematic.get(name, 0.0)
        paper = paper_entry(p_plus, column)
        entries[column] = Entry(float(value), float(statistical), float(systematic), fit, paper)
    return entries


def _fss_window(curve: Curve, size: float) -> tuple[float, float]:
    low, high = FSS_WINDOWS[curve.kind]
    return low, np.inf if high is None else high * size


def _without_points(fit: dict[str, Any]) -> dict[str, Any]:
    """A fit's record without the scaled points, which follow from the curves."""
    kept = {k: v for k, v in fit["details"].items() if k not in ("collapsed", "master")}
    return fit | {"details": kept}
