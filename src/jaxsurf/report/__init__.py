"""Pictures and pages; the only room that imports matplotlib."""

from importlib.util import find_spec

if find_spec("matplotlib") is None:
    raise ModuleNotFoundError(
        "pictures need matplotlib, which is not installed. "
        "Install it by: pip install 'jaxsurf[plot]'"
    )

from jaxsurf.report.pictures import plot_contours as plot_contours
from jaxsurf.report.pictures import plot_curves as plot_curves
