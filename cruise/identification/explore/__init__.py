"""What recordings say before any model is fitted: frequency response, delay, static curve, excitation and quality."""

from cruise.identification.explore.cross_correlation import CrossCorrelation, cross_correlation
from cruise.identification.explore.excitation import Excitation, excitation
from cruise.identification.explore.exploration import ANALYSES, Exploration, explore
from cruise.identification.explore.frequency_response import Bump, Cutoff, FrequencyResponse, frequency_response
from cruise.identification.explore.pieces import Estimate, NotPossible
from cruise.identification.explore.quality import Feedback, Jitter, Noise, Quality, Stuck, feedback, jitter, quality
from cruise.identification.explore.ramps import Ramp, ramps
from cruise.identification.explore.static_curve import StaticCurve, static_curve

__all__ = [
    "ANALYSES",
    "Bump",
    "CrossCorrelation",
    "Cutoff",
    "Estimate",
    "Excitation",
    "Exploration",
    "Feedback",
    "FrequencyResponse",
    "Jitter",
    "Noise",
    "NotPossible",
    "Quality",
    "Ramp",
    "StaticCurve",
    "Stuck",
    "cross_correlation",
    "excitation",
    "explore",
    "feedback",
    "frequency_response",
    "jitter",
    "quality",
    "ramps",
    "static_curve",
]
