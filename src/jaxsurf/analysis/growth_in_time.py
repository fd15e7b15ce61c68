r"""A surface growing out of a flat start, looked at on the way: the paper's future direction.

Snapshots at t = 1, 2, 4, ... of one course of growth give the width and its increments, the
spectra and their collapse in $q\,t^{1/z}$, the correlation length $\xi(t)$, the skewness of the
heights, and the contour loops. Loops shorter than $\xi(t)$ are those of the rough surface, longer
ones the hulls of percolation clusters (Eqs. (scross), (perc_results)), of which the earliest
snapshots hold most.

How near loops come to percolation's exponents on a map of this size is not known by theory: white
noise on maps of the same size, whose loops are percolation hulls at every scale, is traced in the
same way and stands beside.

Source: the paper's Secs. IV F and VII B.
"""

from dataclasses import dataclass
from typing import Any

import jax
import numpy as np

from jaxsurf import theory
from jaxsurf._checks import check_choice, check_in_range, check_integer, check_shape
from jaxsurf.analysis.table1 import Progress
from jaxsurf.analysis.time_scaling import TimeScaling, loops_in_time, scale_in_time
from jaxsurf.curve import Curve
from jaxsurf.fitting.power_law import fit_power_law
from jaxsurf.laws import WhiteNoise
from jaxsurf.measures.heights import height_kurtosis, height_skewness
from jaxsurf.surfaces.gaussian import sample
from jaxsurf.surfaces.linear_growth import EQUATIONS, grow_linear
from jaxsurf.surfaces.single_step import SCHEMES, init_single_step, run_single_step

#: What may grow; the linear equations are the controls, with exponents known exactly.
MODELS = ("single-step", *EQUATIONS)
#: Coefficient nu of the linear equations, small enough for xi to start at a lattice constant.
COEFFICIENTS = {"edwards-wilkinson": 0.25, "mullins-herring": 0.05}
#: Loop measure -> the exponent of its curve beyond xi(t).
PERCOLATION = {
    "mean_length": theory.PERCOLATION.fractal_dimension,
    "length_tail": 2 - theory.PERCOLATION.length_exponent,
    "loop_correlation": -2 * theory.PERCOLATION.correlation_exponent,
}
BEYOND = 16.0  # loops are called longer than xi(t) from so many t^(1/z) on
LARGEST_RADIUS = 0.25  # in units of L


@dataclass(frozen=True)
class GrowthSettings:
    """What is grown and looked at.

    Attributes:
        model: "single-step", "edwards-wilkinson" or "mullins-herring".
        p_plus: chance of deposition of the single-step model.
        side: L of the maps; even for the single-step model.
        last: the last time, a power of 2; snapshots are at 1, 2, 4, ..., `last`.
        first: the first time that the exponents are fitted to.
        replicas: independent surfaces.
        points: starting points of contour loops on each snapshot.
        draws: of the bootstraps.
        scheme: of updates of the single-step model.
        seed: of every random number.

    Raises:
        ValueError: a value out of its range.
    """

    model: str = "single-step"
    p_plus: float | int = 0.1
    side: int = 512
    last: int = 256
    first: int = 8
    replicas: int = 8
    points: int = 2000
    draws: int = 50
    scheme: str = "random-sequential"
    seed: int = 0

    def __post_init__(self):
        check_choice("model", self.model, MODELS)
        check_in_range("p_plus", self.p_plus, 0, 1, remedy="It is the probability of deposition.")
        check_shape((self.side, self.side))
        check_integer("side", self.side, low=64, remedy="Smaller maps have no scaling range.")
        if self.model == "single-step" and self.side % 2:
            raise ValueError(
                f"side of the single-step model must be even; got {self.side}. Steps of +-1 must "
                "close around the map: use an even side."
            )
        check_integer("last", self.last, low=16, remedy="Pass a power of 2, e.g. 256.")
        if self.last & (self.last - 1):
            raise ValueError(f"last must be a power of 2; got {self.last}. Pass e.g. 256.")
        remedy = "Five times or more are needed: pass at most last/16."
        check_integer("first", self.first, low=1, remedy=remedy)
        check_in_range("first", self.first, 1, self.last // 16, remedy=remedy)
        check_integer("replicas", self.replicas, low=5, remedy="Errors are taken between surfaces.")
        check_integer("points", self.points, low=1, remedy="Pass the loops to trace on a snapshot.")
        check_integer("draws", self.draws, low=20, remedy="50 draws give errors to 10 %.")
        check_choice("scheme", self.scheme, SCHEMES)
        check_integer("seed", self.seed, low=0, remedy="Pass any whole number.")

    @property
    def times(self) -> np.ndarray:
        """Of the snapshots: 1, 2, 4, ..."""
        return 2 ** np.arange(self.last.bit_length())


@dataclass(frozen=True)
class Growth:
    """A course of growth and what was measured on it.

    Attributes:
        settings: what was grown.
        scaling: width, spectra, their collapse in time, and the exponents.
        loops: time -> loop measures.
        white_noise: the loop measures of white noise on maps of the same size.
        skewness: of the heights over time, one row a surface.
        kurtosis: their excess kurtosis.
        beyond: time -> loop measure -> (exponent beyond xi(t), statistical, systematic error) and
            the same of white noise in the same window; only times at which a factor of 2 or more
            of radii is left.
    """

    settings: GrowthSettings
    scaling: TimeScaling
    loops: dict[float, dict[str, Curve]]
    white_noise: dict[str, Curve]
    skewness: Curve
    kurtosis: Curve
    beyond: dict[float, dict[str, tuple[tuple[float, float, float], tuple[float, float, float]]]]

    def to_dict(self) -> dict[str, Any]:
        """Settings, exponents and fits, ready for JSON."""
        details = self.scaling.collapse.details
        kept = {k: v for k, v in details.items() if k not in ("collapsed", "master")}
        return {
            "settings": vars(self.settings),
            "exponents": self.scaling.exponents,
            "rows": self.to_rows(),
            "beyond": {
                f"{time:g}": {
                    kind: {"growth": grown, "white noise": white, "percolation": PERCOLATION[kind]}
                    for kind, (grown, white) in kinds.items()
                }
                for time, kinds in self.beyond.items()
            },
            "fits": {
                "collapse": self.scaling.collapse.to_dict() | {"details": kept},
                "beta": self.scaling.beta.to_dict(),
            },
        }

    def to_rows(self) -> list[dict[str, float]]:
        """One flat record a time, ready for CSV."""
        nothing = (float("nan"), float("nan"))
        increments, width = self.scaling.increments, self.scaling.width
        gained = {
            float(t): (float(mean), float(error))
            for t, mean, error in zip(
                increments.scale, increments.mean, increments.stderr, strict=True
            )
        }
        records = []
        for i, time in enumerate(self.scaling.times):
            record: dict[str, float] = {"t": time}
            pairs = {
                "w2": (float(width.mean[i]), float(width.stderr[i])),
                "w2(2t)-w2(t)": gained.get(time, nothing),
                "xi": self.scaling.correlation_length.get(time, nothing),
                "skewness": (float(self.skewness.mean[i]), float(self.skewness.stderr[i])),
                "kurtosis": (float(self.kurtosis.mean[i]), float(self.kurtosis.stderr[i])),
            }
            for name, (value, error) in pairs.items():
                record |= {name: value, f"{name} error": error}
            records.append(record)
        return records


def reproduce_growth(
    settings: GrowthSettings | None = None, *, progress: Progress | None = None
) -> Growth:
    """Grow surfaces from flat, look at them at t = 1, 2, 4, ..., and measure how they roughen.

    Arguments:
        settings: what to grow; the single-step model at p_plus = 0.1 if None.
        progress: called with the share of the work done, 0 to 1, and what comes next.

    Returns:
        The course of growth with its exponents and curves.

    Source: the paper's Secs. IV F and VII B.
    """
    settings = settings or GrowthSettings()
    report = progress or (lambda share, text: None)
    times = settings.times
    heights = _grow(settings, lambda share, text: report(0.4 * share, text))

    def scaled(share: float, text: str) -> None:
        report(0.4 + 0.35 * share, text)

    window = (float(settings.first), float(settings.last))
    scaling = scale_in_time(heights, times, window=window, draws=settings.draws, progress=scaled)
    # growth may carry the maps far from zero, which float32 need not know
    near_zero = (heights - heights[..., :1, :1]).astype(np.float32)
    skewness, kurtosis = (
        _over_time([measure(maps) for maps in near_zero], times)
        for measure in (height_skewness, height_kurtosis)
    )
    loops: dict[float, dict[str, Curve]] = {}
    for number, (time, maps) in enumerate(zip(times.tolist(), heights, strict=True)):
        report(0.75 + 0.2 * number / len(times), f"loops at t = {time}")
        rng = np.random.default_rng([settings.seed, time])
        loops |= loops_in_time(maps[None], [time], points=settings.points, rng=rng)
    report(0.95, "loops of white noise")
    shape = (settings.side, settings.side)
    key = jax.random.fold_in(jax.random.key(settings.seed), _NOISE)
    noise = sample(WhiteNoise(), shape, key=key, batch=settings.replicas)
    rng = np.random.default_rng([settings.seed, 0])
    (white,) = loops_in_time(noise[None], [1], points=settings.points, rng=rng).values()
    beyond = _beyond(loops, white, scaling.collapse.values["z"], settings)
    report(1.0, "done")
    return Growth(settings, scaling, loops, white, skewness, kurtosis, beyond)


_GROW, _NOISE = 0, 1  # names of the two uses of the key


def _grow(settings: GrowthSettings, report: Progress) -> np.ndarray:
    """Snapshots `[time, surface, x, y]`."""
    key = jax.random.fold_in(jax.random.key(settings.seed), _GROW)
    shape = (settings.side, settings.side)
    report(0.0, "growing to t = 1")
    if settings.model != "single-step":
        grown = grow_linear(
            shape,
            equation=settings.model,
            time=float(settings.last),
            snapshots=settings.times.astype(float),
            batch=settings.replicas,
            key=key,
            coefficient=COEFFICIENTS[settings.model],
        )
        return np.asarray(grown)
    state = init_single_step(
        shape, p_plus=settings.p_plus, batch=settings.replicas, scheme=settings.scheme
    )
    seen, now = [], 0
    for time in settings.times.tolist():
        report(now / settings.last, f"growing to t = {time}")
        state, _ = run_single_step(key, state, sweeps=time - now)
        seen.append(np.asarray(state.heights))
        now = time
    return np.stack(seen)


def _over_time(curves: list[Curve], times: np.ndarray) -> Curve:
    """One curve over time out of curves of a single point."""
    samples, weights = (
        np.concatenate([np.asarray(getattr(curve, name), float) for curve in curves], 1)
        for name in ("samples", "weights")
    )
    kind, details = curves[0].kind, curves[0].details
    return Curve(kind, times.astype(float), samples, weights, units=("time", "1"), details=details)


def _beyond(
    loops: dict[float, dict[str, Curve]],
    white: dict[str, Curve],
    z: float,
    settings: GrowthSettings,
) -> dict[float, dict[str, Any]]:
    """Slopes of the loop measures beyond xi(t), and those of white noise there."""
    found: dict[float, dict[str, Any]] = {}
    high = LARGEST_RADIUS * settings.side
    for time, curves in loops.items():
        low = BEYOND * time ** (1 / z)
        if 2 * low > high:
            break
        found[time] = {}
        for kind, curve in curves.items():
            power = PERCOLATION["mean_length"] if kind == "length_tail" else 1.0  # s ~ R^(7/4)
            window = (low**power, high**power)
            fits = [
                fit_power_law(one, window=window, weighting="equal", draws=settings.draws)
                for one in (curve, white[kind])
            ]
            found[time][kind] = tuple(
                (fit.values["exponent"], fit.stderr["exponent"], fit.systematic["exponent"])
                for fit in fits
            )
    return found
