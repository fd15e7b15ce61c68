"""Pictures of finite-size scaling: collapses as in Figs. 8 and 9, and exponents against size."""

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import ScalarFormatter

from jaxsurf.analysis.finite_size import FiniteSize
from jaxsurf.curve import Curve
from jaxsurf.fitting.fit import Fit
from jaxsurf.report.pictures import COLORS, MARKERS, STYLE, describe_axes, new_figure

#: Curve.kind -> the scaled variables of its preset.
AXES = {
    "mean_length": ("$R/L$", r"$\langle s\rangle\, R^{-D_f}$"),
    "length_tail": ("$s/L^{D_f}$", r"$P_>(s)\, s^{\tau-2}$"),
    "loop_correlation": ("$r/L$", "$G(r)\\, r^{2x_l}$"),
    "spectrum": ("$qL$", r"$S(q)\, q^{2+2\alpha}$"),
    "height_correlation": ("$r/L$", r"$D_2(r)\, r^{-2\alpha}$"),
    "curvature_moment": ("$b/L$", r"$\langle C_b^2\rangle\, b^{-2\alpha}$"),
}


NAMES = {"D_f": "$D_f$", "tau_minus_2": r"$\tau-2$", "two_x_l": "$2x_l$", "alpha": "α", "z": "$z$"}


def finite_size_figures(result: FiniteSize) -> dict[str, Figure]:
    """File name -> figure: the exponents against size, and for each alpha every collapse."""
    figures = {"exponents_against_size": plot_against_size(result)}
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


def plot_against_size(result: FiniteSize) -> Figure:
    """Exponents from each size to the next, and from the collapse, against theory (dashed)."""
    figure = new_figure(8.4, 3.9)
    for number, (name, symbol) in enumerate((("2x_l", "$2x_l$"), ("D_f", "$D_f$"))):
        axes = figure.add_subplot(1, 2, number + 1)
        for index, row in enumerate(result.rows):
            color = COLORS[index % len(COLORS)]
            steps = row.steps[name]
            # a little apart, so that error bars of several alphas can be told from one another
            size = np.array([np.sqrt(step.sizes[0] * step.sizes[1]) for step in steps])
            axes.errorbar(
                size * 1.03 ** (index - len(result.rows) / 2),
                [step.value for step in steps],
                [step.error for step in steps],
                fmt=MARKERS[index % len(MARKERS)],
                color=color,
                elinewidth=0.7,
                label=f"{row.alpha:g}",
                **STYLE,
            )
            axes.axhline(row.theory[name], color=color, linestyle="--", linewidth=0.8)
        axes.set_xscale("log", base=2)
        axes.set_xlabel("$L$ (geometric mean of two sizes) [sites]")
        axes.set_ylabel(symbol)
        axes.tick_params(labelsize=8, which="both", direction="in", top=True, right=True)
        values = [step.value for row in result.rows for step in row.steps[name] if step.error < 0.1]
        known = values + [row.theory[name] for row in result.rows]
        axes.set_ylim(min(known) - 0.06, max(known) + 0.06)
    figure.axes[0].legend(fontsize=7, frameon=False, title="α", title_fontsize=7, ncols=2)
    return figure


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
            after.errorbar(points["X"], points["Y"], points["error"], elinewidth=0.6, **style)
    master = fit.details["master"][measure]
    after.plot(master["X"], master["Y"], "-", color="0.3", linewidth=0.8)
    describe_axes(before, next(iter(curves.values())))
    kind = next(iter(curves.values())).kind
    symbols = AXES.get(kind, ("$X$", "$Y$"))
    after.set_xlabel(symbols[0])
    after.set_ylabel(symbols[1])
    for axes in (before, after):
        axes.set_xscale("log")
        axes.set_yscale("log")
    low, high = after.get_ylim()
    if high < 3 * low:  # within half a decade powers of ten say nothing
        after.yaxis.set_major_formatter(ScalarFormatter())
        after.yaxis.set_minor_formatter(ScalarFormatter())
    after.tick_params(labelsize=8, which="both", direction="in", top=True, right=True)
    before.legend(fontsize=7, frameon=False, title="size", title_fontsize=7)
    _describe_fit(after, fit)
    figure.suptitle(title, fontsize=10)
    return figure


def _describe_fit(axes: Axes, fit: Fit) -> None:
    lines = [
        f"{NAMES.get(name, name)} = {fit.values[name]:.3f} ± {fit.total_error(name):.3f}"
        for name in fit.names
    ]
    lines.append(f"S = {fit.details['S']:.2f}")
    axes.text(0.04, 0.04, "\n".join(lines), transform=axes.transAxes, fontsize=7, va="bottom")
