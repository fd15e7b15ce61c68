"""Pictures of Table II, like the paper's Figs. 12 to 16, and the collapse of its FSS columns."""

import numpy as np
from matplotlib.figure import Figure

from jaxsurf.analysis.table2 import Table2, Table2Row
from jaxsurf.curve import Curve
from jaxsurf.report.pictures import (
    COLORS,
    MARKERS,
    STYLE,
    describe_axes,
    new_figure,
    plot_curves,
)

SHIFT = 0.1  # between the spectra of successive p_plus, as in the paper


def table2_figures(table: Table2) -> dict[str, Figure]:
    """File name -> figure: spectra, C^2 and C^3, <s>(R), P_>(s), and the collapse of P_>(s)."""
    side = table.side
    return {
        "spectrum": _spectra(table),
        "curvature": _curvatures(table),
        "mean_length": plot_curves(
            _of(table, "mean_length"),
            {_name(row): row.entries["D_f direct"].fit for row in table.rows},
            title=f"Mean loop length, L = {side}",
        ),
        "length_tail": plot_curves(
            _of(table, "length_tail"),
            {_name(row): row.entries["tau-2 direct"].fit for row in table.rows},
            title=f"Cumulative length distribution, L = {side}",
        ),
        "collapse": _collapses(table),
    }


def _name(row: Table2Row) -> str:
    return f"$p_+$ = {row.p_plus:g}"


def _of(table: Table2, curve: str) -> dict[str, Curve]:
    return {_name(row): table.curves[row.p_plus, table.side][curve] for row in table.rows}


def _spectra(table: Table2) -> Figure:
    """S(q) along [10], filled, and [11], open, as the paper's Fig. 12."""
    figure = plot_curves(
        _of(table, "spectrum 10"),
        {_name(row): row.entries["alpha spectrum"].fit for row in table.rows},
        offset=SHIFT,
        title=f"Spectrum along [10] (filled) and [11] (open), L = {table.side}",
    )
    axes = figure.axes[0]
    for name, fill in (("spectrum 10", None), ("spectrum 11", "none")):
        for i, curve in enumerate(_of(table, name).values()):
            axes.plot(
                curve.scale,
                SHIFT**i * curve.mean,
                MARKERS[i % len(MARKERS)],
                color=COLORS[i % len(COLORS)],
                markerfacecolor=fill,
                markersize=3.5,
            )
    return figure


def _curvatures(table: Table2) -> Figure:
    """The second moment on log-log axes; the third and its ratio, whose signs matter, on linear."""
    figure = new_figure(10.4, 3.4)
    plot_curves(
        _of(table, "curvature 2"),
        {_name(row): row.entries["alpha C2"].fit for row in table.rows},
        axes=figure.add_subplot(1, 3, 1),
        title=f"(a) Second moment of the curvature, L = {table.side}",
    )
    for place, (name, title) in enumerate(
        (("curvature 3", "(b) Third moment"), ("curvature skewness", "(c) Skewness"))
    ):
        axes = figure.add_subplot(1, 3, 2 + place)
        for i, (label, curve) in enumerate(_of(table, name).items()):
            axes.errorbar(
                curve.scale,
                curve.mean,
                curve.stderr,
                fmt=MARKERS[i % len(MARKERS)],
                color=COLORS[i % len(COLORS)],
                elinewidth=0.6,
                label=label,
                **STYLE,
            )
        axes.axhline(0.0, color="0.6", linewidth=0.8)
        axes.set_xscale("log")
        describe_axes(axes, next(iter(_of(table, name).values())))
        axes.set_title(title, fontsize=9)
        axes.legend(fontsize=7, frameon=False)
    return figure


def _collapses(table: Table2) -> Figure:
    """<s>(R) and P_>(s) of all sizes on one curve each, a column a p_plus, like Figs. 8 and 9."""
    kinds = table.rows[0].entries["tau-2 FSS"].fit.details["kinds"]
    figure = new_figure(2.6 * len(table.rows) + 0.6, 2.6 * len(kinds))
    labels = {
        "mean_length": (r"$R / L$", r"$R^{-D_f} \langle s \rangle$"),
        "length_tail": (r"$s / L^{D_f}$", r"$s^{\tau - 2} P_>(s)$"),
    }
    for number, row in enumerate(table.rows):
        details = row.entries["tau-2 FSS"].fit.details
        for measure, (across, up) in enumerate(labels[kind] for kind in kinds):
            place = measure * len(table.rows) + number + 1
            axes = figure.add_subplot(len(kinds), len(table.rows), place)
            for i, (size, points) in enumerate(details["collapsed"][measure].items()):
                axes.errorbar(
                    points["X"],
                    points["Y"],
                    points["error"],
                    fmt=MARKERS[i % len(MARKERS)],
                    color=COLORS[i % len(COLORS)],
                    elinewidth=0.6,
                    label=f"L = {size:g}",
                    **STYLE,
                )
            master = details["master"][measure]
            axes.plot(master["X"], np.asarray(master["Y"]), "-", color="0.3", linewidth=0.8)
            axes.set_xscale("log")
            axes.set_yscale("log")
            axes.set_xlabel(across)
            axes.set_ylabel(up)
            axes.tick_params(labelsize=8, which="both", direction="in", top=True, right=True)
            if measure == 0:
                axes.set_title(_name(row), fontsize=9)
    figure.axes[0].legend(fontsize=7, frameon=False)
    return figure
