"""Pictures of growth: what is drawn is what was measured."""

import numpy as np
import pytest

from jaxsurf.analysis.growth_in_time import GrowthSettings, reproduce_growth
from jaxsurf.report.growth import growth_figures


@pytest.fixture(scope="module")
def growth():
    settings = GrowthSettings(
        side=64, last=16, first=1, replicas=5, points=60, draws=20, scheme="sublattice"
    )
    return reproduce_growth(settings)


def test_every_picture_is_drawn_and_saved(growth, tmp_path):
    figures = growth_figures(growth)
    assert set(figures) == {"growth", "growth_loops"}
    for name, figure in figures.items():
        figure.savefig(tmp_path / f"{name}.png")
        assert len(figure.axes) == 4
        for axes in figure.axes:
            assert axes.get_xlabel()
            assert axes.get_ylabel()
            assert (axes.get_xscale(), axes.get_yscale()) == ("log", "log")


def test_the_scaled_loops_are_those_measured(growth):
    axes = growth_figures(growth)["growth_loops"].axes[3]
    z = growth.scaling.exponents["z"][0]
    x, y = np.asarray(axes.lines[2].get_xydata()).T  # the third time, t = 4
    curve = growth.loops[4.0]["loop_correlation"]
    r = x * 4 ** (1 / z)
    scale, mean = np.asarray(curve.scale), np.asarray(curve.mean)
    # r G(r), exact but for rounding
    np.testing.assert_allclose(y / r, np.interp(r, scale, mean), rtol=1e-6)
