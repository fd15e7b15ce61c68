"""Table I of the paper: loop exponents of Gaussian surfaces against the theory.

For each roughness exponent surfaces are drawn, loops traced through random points, and the three
loop measures fitted by straight lines over the same loops: those of radius 10 < R < 100 at L = 512,
and the same part of the map at other sizes. White noise stands beside them as the percolation limit
(Eq. uncor).
"""

import csv
from collections.abc import Callable
from dataclasses import dataclass, field
from importlib import resources
from typing import Any

import jax
import numpy as np
from jaxtyping import Float

from jaxsurf import theory
from jaxsurf._checks import check_in_range, check_integer, check_shape
from jaxsurf.curve import Curve
from jaxsurf.fitting.fit import Fit
from jaxsurf.fitting.power_law import fit_power_law
from jaxsurf.laws import Law, SelfAffine, WhiteNoise
from jaxsurf.loops.trace import trace_loops
from jaxsurf.surfaces.gaussian import sample

#: The paper fits 10 < R < 100 at L = 512; other sizes use the same share of the map.
WINDOW = (10 / 512, 100 / 512)
WHITE_NOISE = -1.0
#: Name of an exponent -> the curve whose slope it is, and the slope's sign.
EXPONENTS = {
    "2x_l": ("loop_correlation", -1),
    "D_f": ("mean_length", 1),
    "tau-2": ("length_tail", -1),
}
#: Eq. (uncor): white noise at L = 512, by direct fits.
PAPER_WHITE_NOISE = {"2x_l": (1.26, 0.03), "D_f": (1.70, 0.02), "tau-2": (0.565, 0.010)}

Progress = Callable[[float, str], None]


@dataclass(frozen=True)
class Table1Settings:
    """What is simulated; the defaults are the paper's own work.

    Attributes:
        alphas: roughness exponents; -1 stands for white noise.
        sizes: sides L of the maps; the largest gives the direct exponents.
        surfaces: surfaces for each alpha and size.
        points: starting points on each surface.
        seed: of every random number.

    Raises:
        ValueError: an empty list, or a value out of its range.
    """

    alphas: tuple[float, ...] = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0, WHITE_NOISE)
    sizes: tuple[int, ...] = (64, 128, 256, 512)
    surfaces: int = 25
    points: int = 400
    seed: int = 0

    def __post_init__(self):
        if not self.alphas or not self.sizes:
            raise ValueError(
                f"alphas and sizes must not be empty; got {self.alphas} and {self.sizes}. "
                "Leave them out for the paper's own."
            )
        for alpha in self.alphas:
            check_in_range(
                "alpha",
                alpha,
                -1.0,
                2.0,
                closed=(True, False),
                remedy="Rough surfaces have 0 <= alpha <= 1; -1 is white noise.",
            )
        for side in self.sizes:
            check_shape((side, side))
        check_in_range(
            "the largest size",
            max(self.sizes),
            64,
            np.inf,
            remedy="Below 64 sites the fitting window holds too few radii.",
        )
        check_integer("surfaces", self.surfaces, low=2, remedy="Errors need at least two surfaces.")
        check_integer("points", self.points, low=1, remedy="Pass the loops to trace on a surface.")
        check_integer("seed", self.seed, low=0, remedy="Pass any whole number.")


@dataclass(frozen=True)
class Table1Row:
    """One roughness exponent: measured, quoted and predicted values of the three exponents.

    Attributes:
        alpha: roughness exponent, -1 for white noise.
        fits: exponent -> its power-law fit.
        paper: exponent -> (value, error) of the paper's direct column; empty if it has none.
        theory: exponent -> predicted value.
        winding: share of the loops left out because they wind around the map.
    """

    alpha: float
    fits: dict[str, Fit]
    paper: dict[str, tuple[float, float]]
    theory: dict[str, float]
    winding: float

    def value(self, name: str) -> float:
        """The measured exponent, with the sign of its definition."""
        return EXPONENTS[name][1] * self.fits[name].values["exponent"]

    def errors(self, name: str) -> tuple[float, float]:
        """Its statistical and systematic errors."""
        fit = self.fits[name]
        return fit.stderr["exponent"], fit.systematic["exponent"]

    def pull(self, name: str) -> float:
        """Distance from the paper's value in combined standard errors; NaN where it has none."""
        if name not in self.paper:
            return float("nan")
        value, error = self.paper[name]
        return (self.value(name) - value) / float(np.hypot(np.hypot(*self.errors(name)), error))


@dataclass(frozen=True)
class Table1:
    """The reproduced table with everything measured on the way.

    Attributes:
        settings: what was simulated.
        rows: one an alpha.
        curves: (alpha, L) -> kind -> curve, all sizes, kept for finite-size scaling.
        example: heights of one surface of the alpha nearest 0.4 at the largest size.
        example_alpha: its alpha.
    """

    settings: Table1Settings
    rows: tuple[Table1Row, ...]
    curves: dict[tuple[float, int], dict[str, Curve]]
    example: Float[np.ndarray, "x y"] = field(repr=False)
    example_alpha: float

    @property
    def side(self) -> int:
        """The size of the direct columns."""
        return max(self.settings.sizes)

    def to_dict(self) -> dict[str, Any]:
        """Settings, values, errors and fits, ready for JSON."""
        return {
            "settings": vars(self.settings) | {"window": [w * self.side for w in WINDOW]},
            "rows": [
                {
                    "alpha": row.alpha,
                    "winding": row.winding,
                    "exponents": {
                        name: {
                            "value": row.value(name),
                            "statistical": row.errors(name)[0],
                            "systematic": row.errors(name)[1],
                            "paper": row.paper.get(name),
                            "theory": row.theory[name],
                            "fit": row.fits[name].to_dict(),
                        }
                        for name in EXPONENTS
                    },
                }
                for row in self.rows
            ],
        }

    def to_rows(self) -> list[dict[str, float]]:
        """One flat record an alpha, ready for CSV."""
        records = []
        for row in self.rows:
            record = {"alpha": row.alpha}
            for name in EXPONENTS:
                record[name] = row.value(name)
                record[f"{name} statistical"], record[f"{name} systematic"] = row.errors(name)
                record[f"{name} paper"], record[f"{name} paper error"] = row.paper.get(
                    name, (float("nan"), float("nan"))
                )
                record[f"{name} theory"] = row.theory[name]
            records.append(record)
        return records


def reproduce_table1(
    settings: Table1Settings | None = None, *, progress: Progress | None = None
) -> Table1:
    """Draw surfaces, trace loops and fit the direct columns of Table I.

    Arguments:
        settings: what to simulate; the paper's own work if None.
        progress: called with the share of the work done, 0 to 1, and what comes next.

    Returns:
        The table with its curves.

    Source: the paper's Sec. V C, Table I.
    """
    settings = settings or Table1Settings()
    report = progress or (lambda share, text: None)
    # surfaces and loops cost in proportion to the number of sites, about as much at every alpha
    cost = np.array([side**2 for side in settings.sizes], float)
    total, done = cost.sum() * len(settings.alphas), 0.0
    side = max(settings.sizes)
    example_alpha = min(settings.alphas, key=lambda alpha: abs(alpha - 0.4))
    rows, curves, example = [], {}, np.zeros((side, side))
    for alpha in settings.alphas:
        winding = 0.0
        for size, work in zip(settings.sizes, cost, strict=True):
            report(done / total, f"{name_of(alpha)}, L = {size}")
            heights = draw(alpha, size, settings)
            loops = trace_loops(
                heights, settings.points, rng=seeds(alpha, size, settings), correlation=True
            )
            curves[alpha, size] = {
                "mean_length": loops.mean_length(),
                "length_tail": loops.length_tail(),
                "loop_correlation": loops.correlation(),
            }
            if size == side:
                winding = loops.share_winding
                if alpha == example_alpha:
                    example = heights[0]
            done += work
        rows.append(_row(alpha, curves[alpha, side], side, winding))
    report(1.0, "done")
    return Table1(settings, tuple(rows), curves, example, example_alpha)


def draw(alpha: float, size: int, settings: Table1Settings) -> Float[np.ndarray, "surface x y"]:
    """The surfaces of one alpha and size; the same whatever else is simulated."""
    key = jax.random.key(settings.seed)
    for part in seed_words(alpha, size):
        key = jax.random.fold_in(key, part)
    return np.asarray(sample(law_of(alpha), (size, size), key=key, batch=settings.surfaces))


def seeds(alpha: float, size: int, settings: Table1Settings) -> np.random.Generator:
    """The generator of the starting points of one alpha and size."""
    return np.random.default_rng([settings.seed, *seed_words(alpha, size)])


def seed_words(alpha: float, size: int) -> tuple[int, int]:
    """Whole numbers that tell one (alpha, size) from another: alpha in millionths above -1."""
    return round((alpha + 1) * 1e6), size


def law_of(alpha: float) -> Law:
    """The law of a row: white noise at alpha = -1."""
    return WhiteNoise() if alpha == WHITE_NOISE else SelfAffine(alpha)


def name_of(alpha: float) -> str:
    """How a row is called in tables and legends."""
    return "white noise" if alpha == WHITE_NOISE else f"α = {alpha:g}"


def paper_values(alpha: float) -> dict[str, tuple[float, float]]:
    """The paper's direct values and errors at one alpha; empty where it has none."""
    if alpha == WHITE_NOISE:
        return dict(PAPER_WHITE_NOISE)
    columns = {"2x_l": "two_xl", "D_f": "Df", "tau-2": "tau_minus_2"}
    for record in paper_table("table1_gaussian.csv"):
        if abs(record["alpha"] - alpha) < 1e-9:
            return {
                name: (record[f"{column}_direct"], record[f"{column}_direct_err"])
                for name, column in columns.items()
            }
    return {}


def paper_table(name: str) -> list[dict[str, float]]:
    """One of the paper's tables, a record a row."""
    text = (resources.files("jaxsurf.analysis") / "paper" / name).read_text()
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    return [{k: float(v) for k, v in record.items()} for record in csv.DictReader(lines)]


def theory_values(alpha: float) -> dict[str, float]:
    """What the theory predicts: percolation for white noise."""
    exponents = theory.PERCOLATION if alpha == WHITE_NOISE else theory.loop_exponents(alpha)
    return {
        "2x_l": 2 * exponents.correlation_exponent,
        "D_f": exponents.fractal_dimension,
        "tau-2": exponents.length_exponent - 2,
    }


def _row(alpha: float, curves: dict[str, Curve], side: int, winding: float) -> Table1Row:
    low, high = (share * side for share in WINDOW)
    lengths = curves["mean_length"].present()
    # the lengths of loops of these radii, so that all three fits look at the same loops
    s_low, s_high = np.interp([low, high], lengths.scale, lengths.mean)
    windows = {
        "loop_correlation": (low, high),
        "mean_length": (low, high),
        "length_tail": (float(s_low), float(s_high)),
    }
    fits = {
        name: fit_power_law(curves[kind], window=windows[kind], weighting="equal")
        for name, (kind, _) in EXPONENTS.items()
    }
    return Table1Row(alpha, fits, paper_values(alpha), theory_values(alpha), winding)
