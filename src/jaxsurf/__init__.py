"""jaxsurf: how rough is a surface, and can the answer be believed?

The library is one sentence: law -> surface -> measure -> curve -> fit -> report.
"""

from jaxsurf import laws as laws
from jaxsurf import theory as theory
from jaxsurf.curve import Curve as Curve
from jaxsurf.curve import concatenate as concatenate
from jaxsurf.fitting.fit import Fit as Fit
from jaxsurf.laws import SelfAffine as SelfAffine
from jaxsurf.laws import WhiteNoise as WhiteNoise
from jaxsurf.surfaces.gaussian import sample as sample

__version__ = "0.1.0"
