r"""What Table II is made from: runs of the single-step model and the curves measured on them.

Times are in sweeps of the local rule. The paper's own unit, an event a site of a rule that refuses
nothing, is about five of them. Smaller sizes run for times in proportion to $L^2$.

Source: the paper's Sec. VI B.
"""

from collections.abc import Callable
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from jaxsurf import _grid
from jaxsurf._checks import check_choice, check_in_range, check_integer
from jaxsurf.analysis.snapshots import pool_snapshots
from jaxsurf.curve import Curve
from jaxsurf.loops.trace import trace_loops
from jaxsurf.measures import curvature
from jaxsurf.measures._ratios import ensemble_ratio
from jaxsurf.measures.fourier import directional_spectrum
from jaxsurf.measures.heights import height_kurtosis, height_skewness
from jaxsurf.surfaces._step_updates import SCHEMES
from jaxsurf.surfaces.single_step import init_single_step, run_single_step

PIECES = 10  # that each part of a run is cut into, for the progress bar


@dataclass(frozen=True)
class Table2Settings:
    """What is simulated; the defaults are as many sweeps as the paper's longest run has steps.

    Eight runs for each p_plus. A sweep of the local rule is shorter than a step of the paper's own,
    whose events are never refused: about a fifth of it.

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
            equilibrate=700, measure=500, snapshots=20, replicas=6, draws=30, seed=seed
        )


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
        "height skewness": [height_skewness(near_zero)],
        "height kurtosis": [height_kurtosis(near_zero)],
    }
    found |= {f"curvature {n}": [curve] for n, curve in _curvatures(near_zero).items()}
    pooled = {name: pool_snapshots(several, replicas) for name, several in found.items()}
    pooled["curvature skewness"] = _skewness(pooled["curvature 2"], pooled["curvature 3"])
    return pooled, loops.share_winding


def _curvatures(maps: Float[np.ndarray, "map x y"]) -> dict[int, Curve]:
    """`curvature_moment` of orders 2 and 3 in one pass, compiled once."""
    side = maps.shape[-1]
    scales = _grid.default_scales((side, side)).astype(np.int32)
    means, count = curvature.moments(jnp.asarray(maps), scales, orders=(2, 3))
    return {
        order: Curve(
            "curvature_moment",
            scales.astype(np.float32),
            mean,
            count,
            details=(("order", order), ("direction", "10"), ("side", float(side))),
        )
        for order, mean in zip((2, 3), means, strict=True)
    }


def _skewness(second: Curve, third: Curve) -> Curve:
    """<C_b^3>/<C_b^2>^(3/2) of the moments of independent runs."""
    weights = np.asarray(second.weights)
    upper, lower = jnp.asarray(third.samples), jnp.asarray(second.samples)
    ratio = ensemble_ratio(upper, lower, jnp.asarray(weights), 1.5)
    return Curve(
        "curvature_skewness",
        second.scale,
        np.asarray(ratio, float),
        weights,
        units=(second.units[0], "1"),
        details=second.details[1:],
    )
