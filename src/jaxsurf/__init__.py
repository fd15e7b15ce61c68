"""jaxsurf: how rough is a surface, and can the answer be believed?

The library is one sentence: law -> surface -> measure -> curve -> fit -> report.
"""

from jaxsurf import laws as laws
from jaxsurf import theory as theory
from jaxsurf.analysis.fit_loops import fit_loops as fit_loops
from jaxsurf.analysis.multiaffinity import GeneralisedExponents as GeneralisedExponents
from jaxsurf.analysis.multiaffinity import generalised_exponents as generalised_exponents
from jaxsurf.analysis.time_scaling import loops_in_time as loops_in_time
from jaxsurf.analysis.time_scaling import scale_in_time as scale_in_time
from jaxsurf.analysis.time_scaling import width_in_time as width_in_time
from jaxsurf.analysis.time_scaling import width_increments as width_increments
from jaxsurf.curve import Curve as Curve
from jaxsurf.curve import concatenate as concatenate
from jaxsurf.fitting.collapse import fit_collapse as fit_collapse
from jaxsurf.fitting.collapse_forms import Ansatz as Ansatz
from jaxsurf.fitting.crossover import fit_crossover as fit_crossover
from jaxsurf.fitting.fit import Fit as Fit
from jaxsurf.fitting.joint import fit_joint as fit_joint
from jaxsurf.fitting.likelihood import fit_likelihood as fit_likelihood
from jaxsurf.fitting.local_exponents import local_exponents as local_exponents
from jaxsurf.fitting.power_law import fit_power_law as fit_power_law
from jaxsurf.io.heightmap import HeightMap as HeightMap
from jaxsurf.io.levelling import level as level
from jaxsurf.io.readers import read_heights as read_heights
from jaxsurf.laws import SelfAffine as SelfAffine
from jaxsurf.laws import WhiteNoise as WhiteNoise
from jaxsurf.loops.areas import area_distribution as area_distribution
from jaxsurf.loops.areas import area_tail as area_tail
from jaxsurf.loops.areas import perimeter_of_area as perimeter_of_area
from jaxsurf.loops.levels import level_loops as level_loops
from jaxsurf.loops.loops import Loops as Loops
from jaxsurf.loops.pairs import all_pairs_correlation as all_pairs_correlation
from jaxsurf.loops.statistics import open_share as open_share
from jaxsurf.loops.trace import trace_loops as trace_loops
from jaxsurf.measures.bands import spectrum_band as spectrum_band
from jaxsurf.measures.curvature import curvature_moment as curvature_moment
from jaxsurf.measures.curvature import curvature_ratio as curvature_ratio
from jaxsurf.measures.curvature import curvature_skewness as curvature_skewness
from jaxsurf.measures.differences import height_correlation as height_correlation
from jaxsurf.measures.differences import height_correlation_map as height_correlation_map
from jaxsurf.measures.fourier import directional_spectrum as directional_spectrum
from jaxsurf.measures.fourier import power_spectrum as power_spectrum
from jaxsurf.measures.fourier import power_spectrum_map as power_spectrum_map
from jaxsurf.measures.heights import height_kurtosis as height_kurtosis
from jaxsurf.measures.heights import height_skewness as height_skewness
from jaxsurf.measures.lines import line_spectrum as line_spectrum
from jaxsurf.measures.lines import line_variance as line_variance
from jaxsurf.measures.patches import patch_moment as patch_moment
from jaxsurf.measures.patches import patch_skewness as patch_skewness
from jaxsurf.measures.smoothing import smoothed_moment as smoothed_moment
from jaxsurf.measures.smoothing import smoothed_skewness as smoothed_skewness
from jaxsurf.surfaces.gaussian import sample as sample
from jaxsurf.surfaces.linear_growth import LinearGrowth as LinearGrowth
from jaxsurf.surfaces.linear_growth import grow_linear as grow_linear
from jaxsurf.surfaces.single_step import SingleStep as SingleStep
from jaxsurf.surfaces.single_step import grow_single_step as grow_single_step
from jaxsurf.surfaces.single_step import init_single_step as init_single_step
from jaxsurf.surfaces.single_step import load_single_step as load_single_step
from jaxsurf.surfaces.single_step import run_single_step as run_single_step
from jaxsurf.surfaces.single_step import step_single_step as step_single_step

__version__ = "0.1.0"
