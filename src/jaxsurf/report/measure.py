"""Pictures of one measured map: its contour loops and its curves with their straight lines."""

from pathlib import Path

import numpy as np
from matplotlib import cbook
from matplotlib.figure import Figure

from jaxsurf.analysis.measure import ROADS, MapMeasurement
from jaxsurf.io.heightmap import HeightMap
from jaxsurf.report.pictures import new_figure, plot_contours, plot_curves

TITLES = {
    "spectrum": "Spectrum",
    "curvature variance": "Curvature variance",
    "loop dimension D_f": "Mean loop length",
    "loop lengths tau-2": "Cumulative length distribution",
}


def measure_figures(measurement: MapMeasurement) -> dict[str, Figure]:
    """File name -> figure: the map with contour loops, and the four curves with their fits."""
    surface = measurement.surface
    figures = {
        "map": plot_contours(
            surface.heights,
            spacing=surface.spacing,
            unit=surface.length_unit,
            height_unit=surface.height_unit,
            title=surface.source,
            shaded=True,
        )
    }
    panels = new_figure(7.2, 5.8)
    for i, (name, road) in enumerate(measurement.roads.items()):
        kind = ROADS[name][0]
        value, statistical, systematic = road.alpha
        words = f"α = {value:.3f} ± {statistical:.2g} ± {systematic:.2g}"
        plot_curves(
            {words: measurement.curves[kind]},
            {words: road.fit},
            axes=panels.add_subplot(2, 2, i + 1),
            title=TITLES[name],
        )
    figures["curves"] = panels
    return figures


def demo_map() -> HeightMap:
    """The sample landscape that comes with matplotlib: the Jacksboro fault, in metres."""
    path = Path(cbook.get_sample_data("jacksboro_fault_dem.npz", asfileobj=False))
    with np.load(path, allow_pickle=False) as archive:
        elevation = archive["elevation"].astype(float)
        # three arc seconds of latitude; those of longitude are a fifth shorter at 36 degrees north
        spacing = float(archive["dy"]) * 3600
    return HeightMap(elevation, spacing, "arcsec", "m", "Jacksboro fault (matplotlib sample)")
