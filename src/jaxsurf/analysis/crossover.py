r"""Fig. 11 of the paper: surfaces with a correlation length, and the knee in four measures.

Gaussian surfaces with a flat spectrum below $\pi/\xi_q$ beside ones without a cutoff. Up to the
knee all measures follow the self-affine exponents, beyond it those of percolation. One alpha and
one xi are fitted through the knees of $\langle C_b^2\rangle$, $\langle s\rangle(R)$, $P_>(s)$ and
$G(r)$; each measure's own xi stands beside them, and a chi2 says whether they agree.

A knee is where two straight lines meet, and they meet at another length in each loop measure:
`KNEES` are those lengths over xi, which for Gaussian surfaces with this law are pure numbers as far
as lattice and size do not matter. What is left of these is part of xi's systematic error.

P_> and G are shares of all contour length, winding loops included; beside a cutoff of L/32 that
is the paper's choice to 1 %.

Source: the paper's Sec. V D, Eqs. (hq_var_cut), (scross), Fig. 11.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np

from jaxsurf import theory
from jaxsurf._checks import check_in_range, check_integer, check_shape
from jaxsurf.curve import Curve
from jaxsurf.fitting.crossover import fit_crossover
from jaxsurf.fitting.fit import Fit
from jaxsurf.fitting.joint import combine
from jaxsurf.fitting.power_law import fit_power_law
from jaxsurf.laws import SelfAffine
from jaxsurf.loops.trace import trace_loops
from jaxsurf.measures.curvature import curvature_moment
from jaxsurf.measures.fourier import power_spectrum
from jaxsurf.surfaces.gaussian import sample

Progress = Callable[[float, str], None]
MEASURES = ("curvature_moment", "mean_length", "length_tail", "loop_correlation")
#: Knee over xi at alpha = 0.4, measured at xi = 8 and 32 by benchmarks/crossover_knees.py, and the
#: relative error of that, half of it the drift between the two.
KNEES = {"mean_length": 4.812, "length_tail": 0.945, "loop_correlation": 1.067}
KNEE_ERRORS = {"mean_length": 0.159, "length_tail": 0.075, "loop_correlation": 0.078}
#: Exponent of the correction of <s>(R) at small R, which is known to a site or so.
CORRECTIONS = {"mean_length": 1.0}
#: Scales beyond the knee, in units of xi, for plain exponents there.
BEYOND = {
    "mean_length": (5.0, 12.5),
    "length_tail": (2.0, 8.0),
    "loop_correlation": (2.0, 8.0),
}


@dataclass(frozen=True)
class CrossoverSettings:
    """What is simulated; the defaults are the paper's Fig. 11.

    Attributes:
        alpha: roughness exponent.
        cutoff: xi_q, in sites.
        side: L of the maps.
        surfaces: surfaces with and without the cutoff.
        points: starting points on each surface.
        draws: bootstrap draws of each fit.
        seed: of every random number.

    Raises:
        ValueError: a value out of its range.
    """

    alpha: float | int = 0.4
    cutoff: float | int = 16.0
    side: int = 512
    surfaces: int = 25
    points: int = 400
    draws: int = 100
    seed: int = 0

    def __post_init__(self):
        check_shape((self.side, self.side))
        check_in_range("alpha", self.alpha, 0.0, 1.0, remedy="Rough surfaces have 0 to 1.")
        check_in_range(
            "cutoff",
            self.cutoff,
            4.0,
            self.side / 16,
            remedy="The knee needs scales on both sides: 4 sites to L/16.",
        )
        check_integer("surfaces", self.surfaces, low=5, remedy="Covariances need at least 5.")
        check_integer("points", self.points, low=1, remedy="Pass the loops to trace on a surface.")
        check_integer("draws", self.draws, low=20, remedy="100 give errors to 7 %.")
        check_integer("seed", self.seed, low=0, remedy="Pass any whole number.")


@dataclass(frozen=True)
class Crossover:
    """The reproduced figure.

    Attributes:
        settings: what was simulated.
        curves: "cutoff" and "without" -> kind -> curve.
        joint: one alpha and one xi through all knees.
        separate: one alpha, a xi for each measure.
        beyond: kind -> straight line beyond the knee, of the loop measures with the cutoff.
        agreement: chi2 and degrees of freedom of the four xi being one.
    """

    settings: CrossoverSettings
    curves: dict[str, dict[str, Curve]]
    joint: Fit
    separate: Fit
    beyond: dict[str, Fit]
    agreement: tuple[float, int]

    def to_rows(self) -> list[dict[str, Any]]:
        """One flat record a measure, ready for CSV."""
        records = []
        for kind in MEASURES:
            name = f"xi[{kind}]"
            record: dict[str, Any] = {
                "measure": kind,
                "xi": self.separate.values[name],
                "xi statistical": self.separate.stderr[name],
                "xi systematic": _systematic_of_xi(self.separate, kind),
            }
            if kind in self.beyond:
                fit = self.beyond[kind]
                record["exponent beyond"] = fit.values["exponent"]
                record["statistical"] = fit.stderr["exponent"]
                record["systematic"] = fit.systematic["exponent"]
                record["percolation"] = PERCOLATION[kind]
            records.append(record)
        return records

    def to_dict(self) -> dict[str, Any]:
        """Settings, fits and the agreement of the four xi, ready for JSON."""
        return {
            "settings": vars(self.settings)
            | {
                "knees": KNEES,
                "knee errors": KNEE_ERRORS,
                "corrections": CORRECTIONS,
                "beyond": BEYOND,
            },
            "joint": self.joint.to_dict(),
            "separate": self.separate.to_dict(),
            "beyond": {kind: fit.to_dict() for kind, fit in self.beyond.items()},
            "agreement": {"chi2": self.agreement[0], "dof": self.agreement[1]},
        }


#: Slopes of the loop measures beyond the knee (Eq. perc_results).
PERCOLATION = {"mean_length": 7 / 4, "length_tail": -4 / 7, "loop_correlation": -5 / 4}


def reproduce_crossover(
    settings: CrossoverSettings | None = None, *, progress: Progress | None = None
) -> Crossover:
    """Draw surfaces with and without a cutoff, measure them and fit the knees.

    Arguments:
        settings: what to simulate; the paper's Fig. 11 if None.
        progress: called with the share of the work done, 0 to 1, and what comes next.

    Returns:
        The curves of both ensembles and the fits.

    Source: the paper's Sec. V D, Fig. 11.
    """
    settings = settings or CrossoverSettings()
    report = progress or (lambda share, text: None)
    curves = {}
    for number, (name, cutoff) in enumerate((("cutoff", settings.cutoff), ("without", None))):
        report(0.3 * number, f"surfaces and loops, {name}")
        curves[name] = measure_crossover(settings, cutoff)
    measured = [curves["cutoff"][kind] for kind in MEASURES]
    options: dict[str, Any] = {
        "knees": KNEES,
        "corrections": CORRECTIONS,
        "draws": settings.draws,
        "rng": settings.seed,
    }
    report(0.6, "one xi through all knees")
    joint = fit_crossover(measured, **options)
    report(0.8, "a xi for each measure")
    separate = fit_crossover(measured, shared=("alpha",), **options)
    beyond = {
        kind: fit_power_law(
            curves["cutoff"][kind], window=_beyond(kind, settings, curves["cutoff"])
        )
        for kind in PERCOLATION
    }
    report(1.0, "done")
    return Crossover(settings, curves, joint, separate, beyond, _agreement(separate))


def measure_crossover(settings: CrossoverSettings, cutoff: float | int | None) -> dict[str, Curve]:
    """Spectrum, curvature and the three loop measures of one ensemble."""
    key = jax.random.fold_in(jax.random.key(settings.seed), 0 if cutoff is None else 1)
    law = SelfAffine(settings.alpha, cutoff=cutoff)
    shape = (settings.side, settings.side)
    heights = np.asarray(sample(law, shape, key=key, batch=settings.surfaces))
    rng = np.random.default_rng([settings.seed, 0 if cutoff is None else 1])
    loops = trace_loops(heights, settings.points, rng=rng, correlation=True)
    return {
        "spectrum": power_spectrum(heights),
        "curvature_moment": curvature_moment(heights),
        "mean_length": loops.mean_length(),
        "length_tail": loops.length_tail(share="all"),
        "loop_correlation": loops.correlation(share="all"),
    }


def _beyond(
    kind: str, settings: CrossoverSettings, curves: dict[str, Curve]
) -> tuple[float, float]:
    """The window beyond the knee; for lengths, those of loops of these radii."""
    low, high = (share * settings.cutoff for share in BEYOND[kind])
    if kind != "length_tail":
        return low, high
    lengths = curves["mean_length"].present()
    s_low, s_high = np.interp([low, high], np.asarray(lengths.scale), np.asarray(lengths.mean))
    return float(s_low), float(s_high)


def _agreement(separate: Fit) -> tuple[float, int]:
    names = [f"xi[{kind}]" for kind in MEASURES]
    rows = [separate.names.index(name) for name in names]
    found = combine(
        np.array([separate.values[name] for name in names]),
        separate.covariance[np.ix_(rows, rows)],
        np.array([_systematic_of_xi(separate, kind) for kind in MEASURES]),
    )
    return found["chi2"], len(names) - 1


def _systematic_of_xi(separate: Fit, kind: str) -> float:
    """What windows that see the knee, and the error of the knee's ratio, leave open of xi."""
    name = f"xi[{kind}]"
    ratio = separate.values[name] * KNEE_ERRORS.get(kind, 0.0)
    if kind == "length_tail":  # its knee is a length, xi^D_f
        ratio /= theory.fractal_dimension(separate.values["alpha"])
    return float(np.hypot(separate.systematic.get(name, 0.0), ratio))
