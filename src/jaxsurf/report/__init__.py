"""Pictures and pages; the only room that imports matplotlib."""

from jaxsurf.report.pictures import plot_contours as plot_contours
from jaxsurf.report.pictures import plot_curves as plot_curves
