"""The elements every picture is made of: a map with its contour loops, and curves with their fits.

Figures are plain `matplotlib.figure.Figure` objects: no window opens, no global state changes, and
a notebook with `%matplotlib inline` shows what a function returns.
"""

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jaxsurf.curve import SYMBOLS, Curve
from jaxsurf.fitting.fit import Fit

COLORS = ("#00468b", "#b8321a", "#2e7d32", "#7b4aa0", "#b07d00", "#006d77", "#8a1c5c", "#555555")
MARKERS = "osD^v<>P"
STYLE = {"linewidth": 0.9, "markersize": 3.5, "markerfacecolor": "none", "capsize": 1.5}


def new_figure(width: float = 5.2, height: float = 4.0) -> Figure:
    """An empty figure of a journal column's width, laid out without overlaps."""
    return Figure(figsize=(width, height), layout="constrained", dpi=150)


def label(symbol: str, unit: str) -> str:
    """An axis label with its unit: "$r$ [sites]", powers raised; a pure number has none."""
    raised = re.sub(r"\^(-?[\d.]+)", r"$^{\1}$", unit)
    return symbol if unit in ("", "1") else f"{symbol} [{raised}]"


def plot_curves(
    curves: Mapping[str, Curve],
    fits: Mapping[str, Fit] | None = None,
    *,
    axes: Axes | None = None,
    offset: float = 1.0,
    title: str = "",
) -> Figure:
    """Curves of one kind on log-log axes, with error bars and the fitted power laws.

    Arguments:
        curves: name for the legend -> curve.
        fits: name -> a power-law fit, drawn as a line over its window.
        axes: where to draw; a new figure if None.
        offset: factor between successive curves, to tell coinciding ones apart; said in the legend.
        title: above the axes.

    Returns:
        The figure drawn on.
    """
    if axes is None:
        axes = new_figure().add_subplot()
    for i, (name, curve) in enumerate(curves.items()):
        shift = offset**i
        color = COLORS[i % len(COLORS)]
        shown = curve.present()
        scale, mean = np.asarray(shown.scale), np.asarray(shown.mean, float)
        error = np.asarray(shown.stderr, float) if shown.surfaces > 1 else np.zeros_like(mean)
        positive = mean > 0
        # an error bar that reaches zero has no lower end on logarithmic paper
        lower = np.minimum(error, 0.99 * np.abs(mean))
        axes.errorbar(
            scale[positive],
            shift * mean[positive],
            shift * np.stack([lower, error])[:, positive],
            fmt=MARKERS[i % len(MARKERS)],
            color=color,
            elinewidth=0.6,
            label=name if shift == 1 else f"{name} (×{shift:g})",
            **STYLE,
        )
        if fits and name in fits:
            fit = fits[name]
            low, high = fit.details["window"]
            x = np.geomspace(low, high, 50)
            y = shift * fit.values["amplitude"] * x ** fit.values["exponent"]
            axes.plot(x, y, "-", color=color, linewidth=1.2)
    axes.set_xscale("log")
    axes.set_yscale("log")
    drawn = [offset**i * np.asarray(curve.mean) for i, curve in enumerate(curves.values())]
    positive = np.concatenate([values[values > 0] for values in drawn])
    if positive.size:  # long error bars of the last points must not squeeze the curves
        axes.set_ylim(bottom=positive.min() / 2)
    describe_axes(axes, next(iter(curves.values())))
    axes.set_title(title, fontsize=9)
    axes.legend(fontsize=7, frameon=False)
    return _figure_of(axes)


def describe_axes(axes: Axes, curve: Curve) -> None:
    """Label the axes with a curve's symbols and units."""
    symbols = SYMBOLS.get(curve.kind, ("scale", curve.kind))
    axes.set_xlabel(label(symbols[0], curve.units[0]))
    order = curve.detail("order")
    value = symbols[1] if order is None else symbols[1].replace("^q", f"^{{{order}}}")
    axes.set_ylabel(label(value, curve.units[1]))
    axes.tick_params(labelsize=8, which="both", direction="in", top=True, right=True)


def guide(
    axes: Axes, exponent: float, *, start: tuple[float, float], end: float, name: str
) -> None:
    """A dashed line of a given slope, for the eye."""
    x = np.array([start[0], end])
    axes.plot(x, start[1] * (x / start[0]) ** exponent, "--", color="0.4", linewidth=0.9)
    axes.annotate(
        name,
        (x[1], start[1] * (x[1] / x[0]) ** exponent),
        textcoords="offset points",
        xytext=(4, 0),
        fontsize=7,
        color="0.3",
        va="center",
    )


def plot_contours(
    heights: Any,
    *,
    levels: int | Sequence[float] = 7,
    spacing: float = 1.0,
    unit: str = "sites",
    height_unit: str = "1",
    title: str = "",
    shaded: bool = False,
) -> Figure:
    """Contour loops of a map, as in the paper's Fig. 1, on request over its shaded heights.

    Arguments:
        heights: `[x, y]`, NaN where missing.
        levels: how many equally spaced levels, or the levels themselves.
        spacing: lattice constant.
        unit: of the spacing.
        height_unit: of the heights.
        title: above the map.
        shaded: whether the heights are shown in grey under the loops.

    Returns:
        The figure.
    """
    values = np.ma.masked_invalid(np.asarray(heights, float))
    if isinstance(levels, int):
        low, high = np.percentile(values.compressed(), [2, 98])
        levels = list(np.linspace(low, high, levels + 2)[1:-1])
    rows, columns = values.shape
    figure = new_figure(4.6 if not shaded else 5.2, 4.6 * min(max(columns / rows, 0.5), 1.6))
    axes = figure.add_subplot()
    x, y = np.arange(rows) * spacing, np.arange(columns) * spacing
    if shaded:
        image = axes.pcolormesh(x, y, values.T, cmap="Greys_r", shading="nearest", rasterized=True)
        bar = figure.colorbar(image, shrink=0.8)
        bar.set_label(label("$h$", height_unit), fontsize=8)
        bar.ax.tick_params(labelsize=7)
    axes.contour(
        x,
        y,
        values.T,
        levels=levels,
        linewidths=0.4,
        linestyles="solid",
        colors=COLORS[1] if shaded else "black",
    )
    axes.set_aspect("equal")
    axes.set_xlabel(label("$x$", unit))
    axes.set_ylabel(label("$y$", unit))
    axes.tick_params(labelsize=8)
    axes.set_title(title, fontsize=9)
    return figure


def _figure_of(axes: Axes) -> Figure:
    figure = axes.get_figure(root=True)
    if figure is None:
        raise ValueError("axes must belong to a figure; got axes that were removed.")
    return figure
