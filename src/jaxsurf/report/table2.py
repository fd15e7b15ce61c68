"""Pictures of Table II, like the paper's Figs. 12 to 16, and the collapse of its FSS columns."""

import numpy as np
from matplotlib.figure import Figure

from jaxsurf.analysis.table2 import Table2, Table2Row
from jaxsurf.curve import Curve
from jaxsurf.report.pictures import COLORS, MARKERS, describe_axes, new_figure, plot_curves

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
    """The second moment on log-log axes and the third, whose sign matters, on linear ones."""
    figure = new_figure(7.2, 3.4)
    plot_curves(
        _of(table, "curvature 2"),
        {_name(row): row.entries["alpha C2"].fit for row in table.rows},
        axes=figure.add_subplot(1, 2, 1),
        title=f"Second moment of the curvature, L = {table.side}",
    )
    axes = figure.add_subplot(1, 2, 2)
    for i, (name, curve) in enumerate(_of(table, "curvature 3").items()):
        axes.errorbar(
            curve.scale,
            curve.mean,
            curve.stderr,
            fmt=MARKERS[i % len(MARKERS)],
            color=COLORS[i % len(COLORS)],
            markersize=3,
            elinewidth=0.6,
            label=name,
        )
    axes.axhline(0.0, color="0.6", linewidth=0.8)
    axes.set_xscale("log")
    describe_axes(axes, next(iter(_of(table, "curvature 3").values())))
    axes.set_title("Third moment", fontsize=9)
    axes.legend(fontsize=7, frameon=False)
    return figure


def _collapses(table: Table2) -> Figure:
    """P_>(s) of all sizes on one curve, a panel a p_plus, like the paper's Fig. 9."""
    figure = new_figure(2.5 * len(table.rows) + 0.5, 2.9)
    for number, row in enumerate(table.rows):
        axes = figure.add_subplot(1, len(table.rows), number + 1)
        details = row.entries["tau-2 FSS"].fit.details
        for i, (size, points) in enumerate(details["collapsed"][0].items()):
            axes.errorbar(
                points["X"],
                points["Y"],
                points["error"],
                fmt=MARKERS[i % len(MARKERS)],
                color=COLORS[i % len(COLORS)],
                markersize=3,
                elinewidth=0.6,
                label=f"L = {size:g}",
            )
        master = details["master"][0]
        axes.plot(master["X"], np.asarray(master["Y"]), "-", color="0.3", linewidth=0.8)
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_xlabel(r"$s / L^{D_f}$")
        axes.set_ylabel(r"$s^{\tau - 2} P_>(s)$")
        axes.set_title(_name(row), fontsize=9)
        axes.tick_params(labelsize=8, which="both", direction="in", top=True, right=True)
    figure.axes[0].legend(fontsize=7, frameon=False)
    return figure
