"""Pictures of Table II from curves made by hand: what is drawn is what the table holds."""

import numpy as np
import pytest

from jaxsurf.analysis.table2 import COLUMNS, Entry, Table2, Table2Row, Table2Settings
from jaxsurf.curve import Curve
from jaxsurf.fitting.fit import Fit
from jaxsurf.report.table2 import table2_figures

SCALE = np.geomspace(1, 32, 8)


def curve(kind, power, **details):
    rows = SCALE**power * np.array([[1.0], [1.1], [0.9]])
    return Curve(kind, SCALE, rows, details=tuple(details.items()))


@pytest.fixture
def table():
    points = {size: {"X": SCALE / size, "Y": SCALE, "error": 0.1 * SCALE} for size in (64.0, 128.0)}
    master = {"X": SCALE, "Y": SCALE}
    fit = Fit(
        "made by hand",
        {"exponent": 1.0, "amplitude": 2.0},
        {"exponent": 0.1, "amplitude": 0.1},
        np.eye(2),
        1.0,
        1,
        details={
            "window": (2.0, 16.0),
            "kinds": ("mean_length", "length_tail"),
            "collapsed": [points, points],
            "master": [master, master],
        },
    )
    entries = {name: Entry(1.0, 0.1, 0.0, fit, None) for name in COLUMNS}
    curves = {
        "spectrum 10": curve("directional_spectrum", -2.0),
        "spectrum 11": curve("directional_spectrum", -2.0),
        "curvature 2": curve("curvature_moment", 0.6, order=2),
        "curvature 3": curve("curvature_moment", 1.0, order=3),
        "mean_length": curve("mean_length", 1.4),
        "curvature skewness": curve("curvature_skewness", 0.1),
        "length_tail": curve("length_tail", -0.3),
    }
    rows = tuple(Table2Row(p, entries, (0.2, 0.01), (0.1, 0.02), 0.05) for p in (0.1, 0.5))
    return Table2(Table2Settings(), rows, {(p, 128): curves for p in (0.1, 0.5)})


def test_every_picture_is_drawn_and_saved(table, tmp_path):
    figures = table2_figures(table)
    assert set(figures) == {"spectrum", "curvature", "mean_length", "length_tail", "collapse"}
    for name, figure in figures.items():
        figure.savefig(tmp_path / f"{name}.png")
        assert all(axes.get_xlabel() and axes.get_ylabel() for axes in figure.axes)


def test_spectra_are_set_apart_and_the_third_moment_keeps_its_sign(table):
    figures = table2_figures(table)
    legend = [t.get_text() for t in figures["spectrum"].axes[0].get_legend().get_texts()]
    assert legend == ["$p_+$ = 0.1", "$p_+$ = 0.5 (×0.1)"]
    assert figures["curvature"].axes[0].get_yscale() == "log"
    assert figures["curvature"].axes[1].get_yscale() == "linear"
    assert figures["curvature"].axes[2].get_yscale() == "linear"
    titles = [axes.get_title() for axes in figures["collapse"].axes]
    assert titles == ["$p_+$ = 0.1", "", "$p_+$ = 0.5", ""]
