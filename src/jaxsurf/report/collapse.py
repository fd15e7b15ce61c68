"""Pictures of a data collapse: curves of several sizes before and after, as in Figs. 8 and 9."""

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jaxsurf.analysis.finite_size import FiniteSize
from jaxsurf.curve import Curve
from jaxsurf.fitting.fit import Fit
from jaxsurf.report.pictures import COLORS, describe_axes, new_figure

MARKERS = "o^vs*D<>"


def finite_size_figures(result: FiniteSize) -> dict[str, Figure]:
    """File name -> figure: for each alpha the collapse of every loop measure."""
    figures = {}
    for row in result.rows:
        curves = result.curves[row.alpha]
        for name, kinds in (
            ("loops", ("mean_length", "length_tail")),
            ("correlation", ("loop_correlation",)),
        ):
            for number, kind in enumerate(kinds):
                figures[f"collapse_{kind}_alpha_{row.alpha:g}"] = plot_collapse(
                    curves[kind], row.fits[name], measure=number, title=f"α = {row.alpha:g}"
                )
    return figures


def plot_collapse(
    curves: Mapping[int, Curve] | Mapping[float, Curve],
    fit: Fit,
    *,
    measure: int = 0,
    title: str = "",
) -> Figure:
    """Curves of several sizes (left) and the same on one master curve (right).

    Arguments:
        curves: {size: Curve} as given to `fit_collapse`.
        fit: its result.
        measure: which of several measures collapsed together.
        title: over the picture.
    """
    figure = new_figure(8.4, 3.9)
    before, after = figure.add_subplot(1, 2, 1), figure.add_subplot(1, 2, 2)
    for number, (size, curve) in enumerate(sorted(curves.items())):
        style = {
            "color": COLORS[number % len(COLORS)],
            "marker": MARKERS[number % len(MARKERS)],
            "markersize": 3,
            "linewidth": 0,
            "label": f"{size:g}",
        }
        present = curve.present()
        scale, mean = np.asarray(present.scale), np.asarray(present.mean)
        before.plot(scale[mean > 0], mean[mean > 0], **style)
        points = fit.details["collapsed"][measure].get(float(size))
        if points is not None:
            after.plot(points["X"], points["Y"], **style)
    master = fit.details["master"][measure]
    after.plot(master["X"], master["Y"], "-", color="0.3", linewidth=0.8)
    describe_axes(before, next(iter(curves.values())))
    after.set_xlabel("X")
    after.set_ylabel("Y")
    for axes in (before, after):
        axes.set_xscale("log")
        axes.set_yscale("log")
    before.legend(fontsize=7, frameon=False, title="size", title_fontsize=7)
    _describe_fit(after, fit)
    figure.suptitle(title, fontsize=10)
    return figure


def _describe_fit(axes: Axes, fit: Fit) -> None:
    lines = [f"{name} = {fit.values[name]:.3f} ± {fit.total_error(name):.3f}" for name in fit.names]
    lines.append(f"S = {fit.details['S']:.2f}")
    axes.text(0.04, 0.04, "\n".join(lines), transform=axes.transAxes, fontsize=7, va="bottom")
