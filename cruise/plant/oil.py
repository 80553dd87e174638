"""The hydraulic oil: viscosity, stiffness and warming.

    viscosity    lg lg(nu + 0.7) = a - b lg T                                       (Walther)
    stiffness    1 / K = 1 / K_oil + phi (p_0 / p)^(1/n) / (n p)                    (oil with air bubbles)
    warming      C dT/dt = P_idle + P_line - G (T - T_ambient)

nu kinematic viscosity [mm2/s], T absolute temperature [K], a and b from the viscosities at 40 and 100 degC;
K bulk modulus [Pa], phi share of free air at p_0 = 1.013 bar [-], n polytropic exponent [-], p absolute pressure [Pa];
C heat capacity of oil and iron [J/K], G cooling [W/K], P losses at idle and in the line [W].

Source: ASTM D341 (Walther); H.E. Merritt, Hydraulic Control Systems (1967), ch. 2; ISO 3448 grade VG 46.
"""

from dataclasses import dataclass
from math import log10
from typing import Self

from msgspec import Struct

from cruise.plant.bounds import NotNegative, Positive

ATMOSPHERE_PA = 101325.0
KELVIN_AT_0_C = 273.15


class OilSettings(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Oil, its air and its cooling."""

    viscosity_40c_mm2ps: Positive = 46.0  # ISO VG 46: 41.4..50.6; transmission oils 32..68
    viscosity_100c_mm2ps: Positive = 6.8  # VG 46 with viscosity index 100: 6.5..9
    bulk_modulus_bar: Positive = 13000.0  # mineral oil at 50 degC 14000..18000, with hoses 8000..14000
    free_air_share: NotNegative = 0.01  # at atmospheric pressure: 0.002..0.03
    polytropic_exponent: Positive = 1.3  # fast changes 1.4, slow ones 1.0
    start_temperature_c: float = 55.0  # warmed up; cold start 5..20
    ambient_temperature_c: float = 25.0  # harvest: 15..38
    heat_capacity_j_per_k: Positive = 130e3  # 50 l oil (1.9 kJ/kg K) and 80 kg of iron: 80e3..250e3
    idle_loss_w: NotNegative = 5000.0  # churning in pump and motor, charge pump: 2e3..8e3
    cooling_w_per_k: NotNegative = 190.0  # cooler with its fan: 100..500


@dataclass(frozen=True, slots=True)
class Oil:
    """The oil's two laws with their constants worked out."""

    walther_intercept: float
    walther_slope: float
    oil_compliance_per_pa: float
    air_factor: float
    air_exponent: float

    @classmethod
    def of(cls, settings: OilSettings) -> Self:
        """The laws of an oil: Walther's line through its two viscosities, and 1/K = 1/K_oil + factor p^exponent."""
        lg_40, lg_100 = (log10(log10(nu + 0.7)) for nu in (settings.viscosity_40c_mm2ps, settings.viscosity_100c_mm2ps))
        lg_kelvin_40, lg_kelvin_100 = log10(40.0 + KELVIN_AT_0_C), log10(100.0 + KELVIN_AT_0_C)
        slope = (lg_40 - lg_100) / (lg_kelvin_100 - lg_kelvin_40)
        exponent = settings.polytropic_exponent
        return cls(
            walther_intercept=lg_40 + slope * lg_kelvin_40,
            walther_slope=slope,
            oil_compliance_per_pa=1e-5 / settings.bulk_modulus_bar,
            air_factor=settings.free_air_share / exponent * ATMOSPHERE_PA ** (1.0 / exponent),
            air_exponent=-1.0 - 1.0 / exponent,
        )

    def viscosity_mm2ps(self, temperature_c: float) -> float:
        """Kinematic viscosity [mm2/s] at a temperature [degC]."""
        lg_kelvin = log10(temperature_c + KELVIN_AT_0_C)
        return 10.0 ** (10.0 ** (self.walther_intercept - self.walther_slope * lg_kelvin)) - 0.7

    def compliance_per_pa(self, absolute_pa: float) -> float:
        """Compliance 1 / K [1/Pa] of the oil with its air at an absolute pressure [Pa]."""
        return self.oil_compliance_per_pa + self.air_factor * absolute_pa**self.air_exponent


def advance(settings: OilSettings, temperature_c: float, loss_w: float, step_s: float) -> float:
    """Oil temperature [degC] a time `step_s` later under a loss in the line [W]; explicit: it takes minutes."""
    heat_w = settings.idle_loss_w + loss_w
    heat_w -= settings.cooling_w_per_k * (temperature_c - settings.ambient_temperature_c)
    return temperature_c + step_s * heat_w / settings.heat_capacity_j_per_k
