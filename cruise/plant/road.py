"""The undulation of the ground: slopes that no one set and that no road is without.

    alpha(x) = s sqrt(2 / K) sum_k cos(2 pi x / L_k + p_k),    k = 1..K

alpha slope [deg] at travelled distance x [m], s its standard deviation [deg], L_k wavelengths [m] spaced evenly in
log between the longest and the shortest, p_k phases that the seed draws. Waves shorter than the wheelbase are
straddled. Source: ISO 8608 (unevenness of roads falls with the square of the wave number, so that slopes are nearly
white over distance).
"""

from dataclasses import dataclass
from math import cos, pi, sqrt
from typing import Self

import numpy as np
from msgspec import Struct

from cruise.plant.bounds import NotNegative, Positive

WAVES = 12


class RoadSettings(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How uneven the ground is."""

    undulation_deg: NotNegative = 0.0  # standard deviation of the slope; concrete roads 0.1..0.5, fields 0.5..2
    longest_wave_m: Positive = 60.0  # 30..200
    shortest_wave_m: Positive = 4.0  # the wheelbase of combines: 3.5..4.5


@dataclass(frozen=True, slots=True)
class Road:
    """One stretch of ground: its waves [rad/m] with their phases [rad], and the height of each [deg]."""

    waves: tuple[tuple[float, float], ...]
    amplitude_deg: float

    @classmethod
    def of(cls, settings: RoadSettings, seed: int) -> Self:
        """The ground that a seed draws; level where there is no undulation."""
        if settings.undulation_deg == 0.0:
            return cls((), 0.0)
        lengths_m = np.geomspace(settings.longest_wave_m, settings.shortest_wave_m, WAVES)
        phases = np.random.default_rng([seed, WAVES]).uniform(0.0, 2.0 * pi, WAVES)
        waves = tuple(zip((2.0 * pi / lengths_m).tolist(), phases.tolist(), strict=True))
        return cls(waves, settings.undulation_deg * sqrt(2.0 / WAVES))

    def slope_deg(self, travel_m: float) -> float:
        """Slope [deg] at a travelled distance [m]."""
        return self.amplitude_deg * sum(cos(wave * travel_m + phase) for wave, phase in self.waves)
