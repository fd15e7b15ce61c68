r"""Table II of the paper: the single-step model at three strengths of growth.

Surfaces of each $p_+$ and size are grown from flat, left to equilibrate, and looked at many times;
all snapshots of a run make one sample. From the largest size come the direct columns, straight
lines on $\langle C_b^2\rangle$, on the spectrum along four directions, on $\langle s\rangle(R)$
and on $P_>(s)$; from the collapse of $P_>(s)$ over all sizes the finite-size-scaling (FSS) columns,
$D_f$ and $\tau - 2$ together, and each of them inverted to alpha.

Times are in sweeps of the local rule. The paper's own unit, an event a site of a rule that refuses
nothing, is about five of them. Smaller sizes run for times in proportion to $L^2$.

Source: the paper's Sec. VI, Table II, Figs. 12-16.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np
from jaxtyping import Int

from jaxsurf import theory
from jaxsurf._checks import check_choice, check_in_range, check_integer
from jaxsurf.analysis.snapshots import pool_snapshots
from jaxsurf.analysis.table1 import Progress, paper_table
from jaxsurf.curve import Curve
from jaxsurf.fitting.collapse import fit_collapse
from jaxsurf.fitting.fit import Fit
from jaxsurf.fitting.power_law import fit_power_law
from jaxsurf.loops.trace import trace_loops
from jaxsurf.measures.curvature import curvature_moment
from jaxsurf.measures.fourier import directional_spectrum
from jaxsurf.surfaces._step_updates import SCHEMES
from jaxsurf.surfaces.single_step import init_single_step, run_single_step

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
SMALLEST_LENGTH = 20.0  # shorter loops do not scale: left out of the collapse
PIECES = 10  # that each part of a run is cut into, for the progress bar


@dataclass(frozen=True)
class Table2Settings:
    """What is simulated; the defaults are the paper's longest run, eight times for each p_plus.

    Attributes:
        p_plus: chances of deposition.
        sizes: sides L of the maps, even; the largest gives the direct columns.
        equilibrate: sweeps from flat before the first look, at the largest size.
        measure: sweeps during which the surfaces are looked at, at the largest size.
        snapshots: how many looks, equally spaced; a multiple of 10.
        replicas: independent runs for each p_plus and size.
        points: starting points of contour loops on each snapshot.
        draws: of the bootstrap behind the errors of the FSS columns.
        scheme: of updates; see `jaxsurf.surfaces.single_step`.
        seed: of every random number.

    Raises:
        ValueError: an empty list, or a value out of its range.
    """

    p_plus: tuple[float, ...] = (0.1, 0.3, 0.5)
    sizes: tuple[int, ...] = (32, 64, 128)
    equilibrate: int = 12_000
    measure: int = 10_000
    snapshots: int = 100
    replicas: int = 8
    points: int = 100
    draws: int = 200
    scheme: str = "random-sequential"
    seed: int = 0

    def __post_init__(self):
        if not self.p_plus or len(set(self.sizes)) < 2:
            raise ValueError(
                "Table II needs a p_plus and two sizes or more, for finite-size scaling; "
                f"got {self.p_plus} and {self.sizes}. Leave them out for the paper's own."
            )
        check_in_range("p_plus", self.p_plus, 0, 1, remedy="It is the probability of deposition.")
        for side in self.sizes:
            check_integer("a size", side, low=16, remedy="Smaller maps have no scaling range.")
            if side % 2:
                raise ValueError(f"sizes must be even; got {side}. Steps of +-1 must close.")
        check_in_range(
            "the largest size",
            max(self.sizes),
            64,
            np.inf,
            remedy="Below 64 sites the fitting windows hold too few scales.",
        )
        check_integer("equilibrate", self.equilibrate, low=1, remedy="Pass sweeps before the data.")
        check_integer("snapshots", self.snapshots, low=PIECES, remedy="Pass how often to look.")
        if self.snapshots % PIECES:
            raise ValueError(
                f"snapshots must be a multiple of {PIECES}; got {self.snapshots}. Pass e.g. 100."
            )
        check_integer(
            "measure",
            self.measure,
            low=self.snapshots,
            remedy="A sweep or more must pass between two snapshots.",
        )
        check_integer("replicas", self.replicas, low=3, remedy="Errors are taken between runs.")
        check_integer("points", self.points, low=1, remedy="Pass the loops to trace on a snapshot.")
        check_integer("draws", self.draws, low=20, remedy="200 draws give errors to 5 %.")
        check_integer("seed", self.seed, low=0, remedy="Pass any whole number.")
        check_choice("scheme", self.scheme, SCHEMES)

    @staticmethod
    def quick(seed: int = 0) -> "Table2Settings":
        """The whole path in about a minute; the errors say what it is worth."""
        return Table2Settings(
            equilibrate=800, measure=600, snapshots=20, replicas=6, draws=30, seed=seed
        )


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
        winding: share of the loops left out because they wind around the largest map.
    """

    p_plus: float
    entries: dict[str, Entry]
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
            longest run for every p_plus.
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
        rows.append(Table2Row(p_plus, _entries(p_plus, of_size, settings.draws), winding))
    report(1.0, "done")
    return Table2(settings, tuple(rows), curves)


def grow(
    p_plus: float, side: int, settings: Table2Settings, report: Callable[[float, str], None]
) -> Int[np.ndarray, "snapshot replica x y"]:
    """The snapshots of one p_plus and size; the same whatever else is simulated."""
    key = jax.random.key(settings.seed)
    for word in (round(p_plus * 1e6), side):
        key = jax.random.fold_in(key, word)
    shorter = (side / max(settings.sizes)) ** 2
    every = max(int(settings.measure * shorter) // settings.snapshots, 1)
    # Grown in pieces of as many snapshots, so that the run is compiled once and its progress seen.
    looks = settings.snapshots // PIECES
    settling = max(round(settings.equilibrate * shorter / (PIECES * looks)), 1)
    pieces = [settling] * PIECES + [every] * PIECES
    state = init_single_step(
        (side, side), p_plus=p_plus, batch=settings.replicas, scheme=settings.scheme
    )
    seen, done = [], 0
    for number, interval in enumerate(pieces):
        settled = number >= PIECES
        report(done / (looks * sum(pieces)), "collecting data" if settled else "equilibrating")
        sweeps = interval * looks
        state, kept = run_single_step(key, state, sweeps=sweeps, snapshots=interval)
        done += sweeps
        if settled:
            seen.append(np.asarray(kept))
    return np.concatenate(seen)


def measure(
    heights: Int[np.ndarray, "snapshot replica x y"], p_plus: float, settings: Table2Settings
) -> tuple[dict[str, Curve], float]:
    """All curves of one p_plus and size, a row a run, and the share of winding loops."""
    replicas, side = heights.shape[1], heights.shape[-1]
    maps = heights.reshape(-1, side, side)
    rng = np.random.default_rng([settings.seed, round(p_plus * 1e6), side])
    loops = trace_loops(maps, settings.points, rng=rng)
    # growth has carried the maps far from zero, which float32 need not know
    near_zero = (maps - maps[:, :1, :1]).astype(np.float32)
    spectra = directional_spectrum(near_zero)
    found: dict[str, list[Curve]] = {
        "spectrum 10": [spectra["10"], spectra["01"]],
        "spectrum 11": [spectra["11"], spectra["1-1"]],
        "mean_length": [loops.mean_length()],
        "length_tail": [loops.length_tail()],
    }
    for order in (2, 3):
        found[f"curvature {order}"] = [curvature_moment(near_zero, order=order)]
    pooled = {name: pool_snapshots(several, replicas) for name, several in found.items()}
    return pooled, loops.share_winding


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
    collapse = fit_collapse(
        {size: of_size["length_tail"] for size, of_size in curves.items()},
        window=(SMALLEST_LENGTH, np.inf),
        draws=draws,
    )
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


def _without_points(fit: dict[str, Any]) -> dict[str, Any]:
    """A fit's record without the scaled points, which follow from the curves."""
    kept = {k: v for k, v in fit["details"].items() if k not in ("collapsed", "master")}
    return fit | {"details": kept}
