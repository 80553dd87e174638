"""Rolling resistance: the ground gives way under the wheels, in proportion to the weight on them.

    phi_k = -g_n (m / m_0 - s) (1 + b |v|) x_k,   x_k = clip(h x_(k-1) + v / v_c, -1, 1)

m mass in kg, m_0 = 15000 kg, g_n = 9.81 m/s2, v speed one sample ago in m/s, b rise in s/m with the speed, s share of
the resistance at m_0 that the rest of the model holds already, v_c speed in m/s at which all of it is there within a
sample, x share of the resistance that acts: at rest whatever balances the drive, by the memory h = exp(-T / 0.9 s) of
the samples before. Source: equation 8 of Coen et al. 2005, F_F = beta m g;
ASAE D497 gives beta = 0.02 on concrete to 0.12 on soft soil; SAE J2452 (a tyre's loss rises as a + b v + c v^2);
P. Dahl, AIAA Journal 14 (1976) 1675-1682 (what is held before it rolls).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from cruise.effects.effect import (
    EMPTY_KG,
    GRAVITY_MPS2,
    About,
    Effect,
    Parameter,
    Stage,
    State,
    Value,
    dry,
    dry_over,
    where,
)
from cruise.signals import Signals


@dataclass(frozen=True, slots=True)
class RollingResistance(Effect):
    """phi = -9.81 (m / 15000 kg - s) (1 + b |v|) x, in m/s2, x the share that acts, against the direction of travel."""

    name = "rolling_resistance"
    stage = Stage.LOAD
    needs = ("machine_mass_kg",)
    reads_speed = True
    parameters: ClassVar = {
        "crossover_mps": Parameter("m/s", 0.01, 0.5, 0.5, "speed at which the resistance is there within a sample"),
        "rise_per_mps": Parameter("s/m", 0.0, 0.3, 0.0, "share by which it rises with each m/s of the speed"),
        "held_share": Parameter("-", 0.0, 1.0, 0.0, "share of it at 15000 kg that the rest of the model holds already"),
    }
    about: ClassVar = About(
        physics="Tyre and soil are deformed in front of the axle and give back less behind it. The loss is a force "
        "against the direction of travel, proportional to the weight and rising little with the speed; soft soil takes "
        "up to six times what concrete takes. The machine slows down as its bin fills.",
        equation="phi = -9.81 m/s2 (m / 15000 kg - s) (1 + b |v|) x,  x_k = clip(h x_(k-1) + v / v_c, -1, 1)",
        source="Coen et al. 2005, equation 8; coefficients in ASAE D497; Dahl, AIAA Journal 14 (1976)",
        signature="the residual is negative forward and positive in reverse, and grows in magnitude with the mass",
        look_alikes=("coulomb_friction", "sensor_bias", "grade", "crop_load", "oil_temperature"),
        experiment="the same level way at the same constant current with an empty and with a full bin (at least 3 t "
        "apart), each in both directions, within a quarter of an hour so that the oil stays as warm: only "
        "rolling_resistance follows the mass",
    )

    crossover_mps: float = 0.2
    rise_per_mps: float = 0.0
    held_share: float = 0.0

    def start(self, like: Value) -> State:
        """Share that acts: none so far."""
        return like * 0.0

    def step(self, value: Value, past_speed: Value, signals: Signals, state: State, dt_s: float) -> tuple[Value, State]:
        """The resistance against the past speed, for the present mass."""
        share = dry(past_speed, self.crossover_mps, state, dt_s)
        return -self._weight_mps2(past_speed, signals) * share, where(share == share, share, 0.0)

    def over(
        self, values: Value, past_speeds: np.ndarray, signals: Mapping[str, np.ndarray], dt_s: float
    ) -> tuple[Value, State]:
        """The whole recording at once, but for the share that acts."""
        shares, held = dry_over(past_speeds, self.crossover_mps, dt_s)
        return -self._weight_mps2(past_speeds, signals) * shares, held

    def _weight_mps2(self, past_speed: Value, signals: Signals) -> Value:
        rise = 1.0 + self.rise_per_mps * abs(past_speed)
        return GRAVITY_MPS2 * (signals["machine_mass_kg"] / EMPTY_KG - self.held_share) * rise
