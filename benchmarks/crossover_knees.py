"""Where each loop measure has its knee, in units of xi: the numbers KNEES of analysis/crossover.py.

Measured at xi = 8 and 32 on maps of the same 32 correlation lengths as those of the paper's
Fig. 11, whose xi = 16 lies halfway between on a logarithmic scale and is not used. The knees drift
with xi, that of P_> from 1.02 to 0.87, so each is also given an error for that.
Run: python benchmarks/crossover_knees.py
"""

import numpy as np

from jaxsurf.analysis.crossover import CORRECTIONS, MEASURES, CrossoverSettings, measure_crossover
from jaxsurf.curve import concatenate
from jaxsurf.fitting.crossover import fit_crossover

ALPHA, SIDES_PER_XI = 0.4, 32
#: Relative error of a knee for being measured at half or twice the xi of the figure.
DRIFT = 0.1
SURFACES = {8: 160, 32: 40}


def knees(cutoff: int, surfaces: int) -> tuple[np.ndarray, np.ndarray]:
    """Knee over xi of each loop measure, and its error, the xi of the curvature taken as xi."""
    parts = []
    for seed in range(surfaces // 20):
        settings = CrossoverSettings(
            alpha=ALPHA,
            cutoff=cutoff,
            side=SIDES_PER_XI * cutoff,
            surfaces=20,
            seed=1000 * cutoff + seed,
        )
        parts.append(measure_crossover(settings, cutoff))
    curves = [concatenate([part[kind] for part in parts]) for kind in MEASURES]
    fit = fit_crossover(curves, shared=("alpha",), corrections=CORRECTIONS, draws=40)
    print(fit, flush=True)
    names = [f"xi[{kind}]" for kind in MEASURES[1:]]
    values = np.array([fit.values[name] for name in names]) / cutoff
    return values, np.array([fit.stderr[name] for name in names]) / cutoff


def main() -> None:
    found = {cutoff: knees(cutoff, surfaces) for cutoff, surfaces in SURFACES.items()}
    for cutoff, (values, errors) in found.items():
        for kind, value, error in zip(MEASURES[1:], values, errors, strict=True):
            print(f"xi = {cutoff:>2}  {kind:<17} {value:.3f} +- {error:.3f}")
    values, errors = (np.array([part[i] for part in found.values()]) for i in (0, 1))
    weights = 1 / ((errors / values) ** 2 + DRIFT**2)
    mean = np.exp((weights * np.log(values)).sum(0) / weights.sum(0))
    error = weights.sum(0) ** -0.5
    print("KNEES =", {k: round(float(v), 3) for k, v in zip(MEASURES[1:], mean, strict=True)})
    print(
        "KNEE_ERRORS =", {k: round(float(v), 3) for k, v in zip(MEASURES[1:], error, strict=True)}
    )


if __name__ == "__main__":
    main()
