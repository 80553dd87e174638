"""Rolling resistance: the ground gives way under the wheels, in proportion to the weight on them.

    phi = -g_n (m / m_0) tanh(v / v_c)

m mass in kg, m_0 = 15000 kg, g_n = 9.81 m/s2, v speed one sample ago in m/s, v_c speed in m/s at which the resistance
has built up. Source: equation 8 of Coen et al. 2005, F_F = beta m g; ASAE D497 gives beta = 0.02 on concrete to 0.12 on
soft soil. The tanh in place of the sign is a common regularisation, here for speeds that cross zero between samples.
"""

from dataclasses import dataclass
from typing import ClassVar

from cruise.effects.effect import EMPTY_KG, GRAVITY_MPS2, About, Effect, Parameter, Stage, State, Value, tanh
from cruise.signals import Signals


@dataclass(frozen=True, slots=True)
class RollingResistance(Effect):
    """phi = -9.81 (m / 15000 kg) tanh(v / crossover_mps), in m/s2, against the direction of travel."""

    name = "rolling_resistance"
    stage = Stage.LOAD
    needs = ("machine_mass_kg",)
    reads_speed = True
    parameters: ClassVar = {
        "crossover_mps": Parameter("m/s", 0.02, 1.0, 0.2, "speed at which three quarters of the resistance are there"),
    }
    about: ClassVar = About(
        physics="Tyre and soil are deformed in front of the axle and give back less behind it. The loss is a force "
        "against the direction of travel, proportional to the weight and nearly independent of the speed; soft soil "
        "takes up to six times what concrete takes. The machine slows down as its bin fills.",
        equation="phi = -9.81 m/s2 (m / 15000 kg) tanh(v / v_c)",
        source="Coen et al. 2005, equation 8; coefficients in ASAE D497",
        signature="the residual is negative forward and positive in reverse, and grows in magnitude with the mass",
        look_alikes=("coulomb_friction", "sensor_bias", "grade", "crop_load", "oil_temperature"),
        experiment="the same level way at the same constant current with an empty and with a full bin (at least 3 t "
        "apart), each in both directions, within a quarter of an hour so that the oil stays as warm: only "
        "rolling_resistance follows the mass",
    )

    crossover_mps: float = 0.2

    def step(self, value: Value, past_speed: Value, signals: Signals, state: State, dt_s: float) -> tuple[Value, State]:
        """The resistance against the past speed, for the present mass."""
        weight_mps2 = GRAVITY_MPS2 / EMPTY_KG * signals["machine_mass_kg"]
        return -weight_mps2 * tanh(past_speed / self.crossover_mps), state
