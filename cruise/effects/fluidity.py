"""How thin hydraulic oil is: F = exp((T - 50 degC) / 33 K), the fluidity over that at 50 degC.

T oil temperature in degC. Viscosity falls by 3 % per kelvin: the line of Walther (ASTM D341) through ISO VG 46 of
viscosity index 100 (46 and 6.8 mm2/s at 40 and 100 degC) falls by 4.0 %/K at 50 degC, 2.7 %/K at 80 degC, 3.1 %/K in
the mean from 50 to 90 degC.
"""

import math
from typing import Final

import numpy as np

from cruise.effects.effect import Value

REFERENCE_C: Final = 50.0  # degC, at which makers state volumetric efficiencies; here F = 1
THINNING_K: Final = 33.0  # K in which VG 46 thins by the factor e, mean of 40 to 105 degC; VG 32: 34, VG 68: 30


def fluidity(oil_temperature_c: Value, power: Value = 1.0) -> Value:
    """F to a power, elementwise."""
    warmth = power * (oil_temperature_c - REFERENCE_C) / THINNING_K
    return np.exp(warmth) if isinstance(warmth, np.ndarray) else math.exp(warmth)
