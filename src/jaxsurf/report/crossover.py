"""Pictures of the percolation crossover, the four panels of the paper's Fig. 11."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jaxsurf.analysis.crossover import MEASURES, Crossover
from jaxsurf.report.pictures import COLORS, describe_axes, new_figure

LENGTHS = {"curvature_moment": "b", "mean_length": "R", "loop_correlation": "r"}


def crossover_figures(result: Crossover) -> dict[str, Figure]:
    """File name -> figure: the four measures with and without the cutoff, and the fitted knees."""
    figure = new_figure(8.6, 7.0)
    for place, kind in enumerate(MEASURES):
        _panel(figure.add_subplot(2, 2, place + 1), result, kind, "abcd"[place])
    settings, joint = result.settings, result.joint
    figure.suptitle(
        f"α = {settings.alpha:g}, ξ_q = {settings.cutoff:g}, L = {settings.side}: fitted "
        f"α = {joint.values['alpha']:.3f} ± {joint.total_error('alpha'):.3f}, "
        f"ξ = {joint.values['xi']:.2f} ± {joint.total_error('xi'):.2f}",
        fontsize=10,
    )
    return {"crossover": figure}


def _panel(axes: Axes, result: Crossover, kind: str, letter: str) -> None:
    for name, marker, color in (("without", "o", "0.6"), ("cutoff", "^", COLORS[0])):
        curve = result.curves[name][kind].present()
        scale, mean = np.asarray(curve.scale), np.asarray(curve.mean)
        error = np.asarray(curve.stderr)
        shown = (mean > 0) & (error < 0.5 * mean)
        axes.errorbar(
            scale[shown],
            mean[shown],
            error[shown],
            fmt=marker,
            color=color,
            markersize=3,
            linewidth=0,
            elinewidth=0.7,
            label="no cutoff" if name == "without" else "cutoff",
        )
    fitted = result.separate.details["fitted"][kind]
    axes.plot(fitted["scale"], fitted["value"], "-", color=COLORS[1], linewidth=1.2, label="fit")
    axes.set_xscale("log")
    axes.set_yscale("log")
    describe_axes(axes, result.curves["cutoff"][kind])
    row = next(row for row in result.to_rows() if row["measure"] == kind)
    error = np.hypot(row["xi statistical"], row["xi systematic"])
    axes.set_title(f"({letter}) ξ = {row['xi']:.1f} ± {error:.1f}", fontsize=9)
    if kind in LENGTHS:
        axes.axvline(result.settings.cutoff, color="0.4", linewidth=0.7, linestyle=":")
    axes.legend(fontsize=7, frameon=False)
