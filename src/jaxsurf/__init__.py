"""jaxsurf: how rough is a surface, and can the answer be believed?

The library is one sentence: law -> surface -> measure -> curve -> fit -> report.
"""

from jaxsurf import laws as laws
from jaxsurf import theory as theory
from jaxsurf.curve import Curve as Curve
from jaxsurf.curve import concatenate as concatenate
from jaxsurf.fitting.fit import Fit as Fit
from jaxsurf.fitting.power_law import fit_power_law as fit_power_law
from jaxsurf.laws import SelfAffine as SelfAffine
from jaxsurf.laws import WhiteNoise as WhiteNoise
from jaxsurf.measures.curvature import curvature_moment as curvature_moment
from jaxsurf.measures.fourier import directional_spectrum as directional_spectrum
from jaxsurf.measures.fourier import power_spectrum as power_spectrum
from jaxsurf.surfaces.gaussian import sample as sample

__version__ = "0.1.0"
