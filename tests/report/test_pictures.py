"""Pictures carry their units, their fits and every surface they claim to show."""

import numpy as np
import pytest

from jaxsurf.curve import SYMBOLS, Curve
from jaxsurf.fitting.power_law import fit_power_law
from jaxsurf.report.pictures import label, plot_contours, plot_curves


def curve(kind="mean_length", factor=1.0):
    scale = np.geomspace(1, 100, 20)
    noise = np.random.default_rng(0).normal(size=(6, 20))
    return Curve(
        kind, scale, factor * scale**1.5 * np.exp(0.1 * noise), units=("nm", "nm^2"), details=()
    )


def test_labels_carry_units():
    assert label("$r$", "sites") == "$r$ [sites]"
    assert label("$P$", "1") == "$P$"
    assert label("$S$", "m^2 nm^-1.5") == "$S$ [m$^{2}$ nm$^{-1.5}$]"


@pytest.mark.parametrize("kind", SYMBOLS)
def test_axes_say_what_is_drawn(kind, tmp_path):
    figure = plot_curves({"a": curve(kind)})
    axes = figure.axes[0]
    assert axes.get_xlabel() == label(SYMBOLS[kind][0], "nm")
    assert axes.get_ylabel() == label(SYMBOLS[kind][1], "nm^2")
    figure.savefig(tmp_path / "a.png")  # the mathematics of the labels is well formed


def test_the_fit_is_drawn_over_its_window():
    data = curve()
    fit = fit_power_law(data, window=(3.0, 30.0))
    figure = plot_curves({"a": data}, {"a": fit})
    line = figure.axes[0].lines[-1]
    assert line.get_xdata()[[0, -1]] == pytest.approx([3.0, 30.0])
    assert line.get_ydata()[0] == pytest.approx(
        fit.values["amplitude"] * 3.0 ** fit.values["exponent"]
    )


def test_an_offset_is_said_in_the_legend():
    figure = plot_curves({"a": curve(), "b": curve(factor=2.0)}, offset=10.0)
    texts = [text.get_text() for text in figure.axes[0].get_legend().get_texts()]
    assert texts == ["a", "b (×10)"]


@pytest.mark.parametrize("shaded", [False, True])
def test_contours_of_a_map_with_missing_sites(shaded, tmp_path):
    heights = np.random.default_rng(1).normal(size=(20, 30))
    heights[3, 4] = np.nan
    figure = plot_contours(heights, spacing=0.5, unit="nm", height_unit="pm", shaded=shaded)
    assert figure.axes[0].get_xlabel() == "$x$ [nm]"
    assert len(figure.axes) == 1 + shaded
    figure.savefig(tmp_path / "a.png")
