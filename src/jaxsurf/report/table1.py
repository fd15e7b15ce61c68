"""Pictures of Table I: the contour plot and the three loop measures, like the paper's figures."""

from matplotlib.figure import Figure

from jaxsurf.analysis.table1 import EXPONENTS, WHITE_NOISE, Table1, name_of, theory_values
from jaxsurf.report.pictures import COLORS, new_figure, plot_contours, plot_curves

TITLES = {
    "2x_l": "Loop correlation function",
    "D_f": "Mean loop length",
    "tau-2": "Cumulative length distribution",
}


def table1_figures(table: Table1) -> dict[str, Figure]:
    """File name -> figure: contours, <s>(R), P_>(s), G(r) and the exponents against theory."""
    side = table.side
    files = {"D_f": "mean_length", "tau-2": "length_tail", "2x_l": "loop_correlation"}
    figures = {
        "contours": plot_contours(
            table.example,
            levels=3,
            title=f"Contour loops, {name_of(table.example_alpha)}, L = {side}",
        )
    }
    for name, file in files.items():
        kind = EXPONENTS[name][0]
        figures[file] = plot_curves(
            {name_of(row.alpha): table.curves[row.alpha, side][kind] for row in table.rows},
            {name_of(row.alpha): row.fits[name] for row in table.rows},
            # the correlation functions lie on top of each other: the paper draws them apart, too
            offset=3.0 if name == "2x_l" else 1.0,
            title=f"{TITLES[name]}, L = {side}",
        )
    figures["exponents"] = exponents_figure(table)
    return figures


def exponents_figure(table: Table1) -> Figure:
    """Measured exponents, the paper's and the theory's against alpha (the paper's Fig. Dfzeta)."""
    figure = new_figure(7.2, 2.9)
    rows = [row for row in table.rows if row.alpha != WHITE_NOISE]
    labels = {"2x_l": r"$2x_l$", "D_f": r"$D_f$", "tau-2": r"$\tau - 2$"}
    for i, (name, symbol) in enumerate(labels.items()):
        axes = figure.add_subplot(1, 3, i + 1)
        alphas = [row.alpha for row in rows]
        axes.plot(
            alphas, [theory_values(a)[name] for a in alphas], "-", color="0.4", label="theory", lw=1
        )
        total = [
            float((row.errors(name)[0] ** 2 + row.errors(name)[1] ** 2) ** 0.5) for row in rows
        ]
        style = {"linewidth": 0, "elinewidth": 0.8, "markersize": 4, "capsize": 2}
        axes.errorbar(
            alphas,
            [row.value(name) for row in rows],
            total,
            fmt="o",
            color=COLORS[0],
            label="this run",
            **style,
        )
        quoted = [row for row in rows if name in row.paper]
        if quoted:
            axes.errorbar(
                [row.alpha + 0.02 for row in quoted],
                [row.paper[name][0] for row in quoted],
                [row.paper[name][1] for row in quoted],
                fmt="s",
                color=COLORS[1],
                markerfacecolor="none",
                label="paper, direct",
                **style,
            )
        axes.set_xlabel(r"$\alpha$")
        axes.set_ylabel(symbol)
        axes.tick_params(labelsize=8, direction="in", top=True, right=True)
    figure.axes[0].legend(fontsize=7, frameon=False)
    return figure
