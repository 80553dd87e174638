"""Grade: on a slope, a part of the machine's weight pulls along the ground.

    phi = -(g_n sin(alpha) - r dv/dt) (1 + s (m / m_0 - 1))

alpha pitch in degrees (+ uphill) as the sensor shows it, g_n = 9.81 m/s2, dv/dt acceleration in m/s2, which the sensor
takes for slope with the share r, m mass in kg (m_0 where it is not measured), m_0 = 15000 kg, s share of the mass; both
shares without unit. Source: equations 2 and 9 and Table VI of Coen et al. 2005: F_G = m g sin(alpha).
"""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from cruise.effects.effect import EMPTY_KG, GRAVITY_MPS2, About, Effect, Parameter, Stage, State, Value, where
from cruise.signals import Signals


@dataclass(frozen=True, slots=True)
class Grade(Effect):
    """phi = -(9.81 sin(pitch) - acceleration_share dv/dt) (1 + mass_share (m / 15000 kg - 1)), in m/s2."""

    name = "grade"
    stage = Stage.LOAD
    needs = ("pitch_deg",)
    helps = ("machine_mass_kg",)
    reads_speed = True
    parameters: ClassVar = {
        "mass_share": Parameter("-", 0.0, 1.0, 0.0, "how far the loss grows with the mass; 1 is in proportion"),
        "acceleration_share": Parameter("-", 0.0, 1.0, 0.0, "how far the sensor takes acceleration for slope"),
    }
    about: ClassVar = About(
        physics="Uphill, the component of the weight along the slope pulls the machine back; downhill it pushes. The "
        "hydrostat answers the force with pressure, and pressure costs speed through leakage and the engine's droop: "
        "the softer the drive, the more of the force shows in the speed, and the more of the mass with it. A pitch "
        "sensor reads acceleration as slope (1 m/s2 looks like 5.8 degrees), so that a part of every start and stop "
        "is in the pitch too: slope that lasts is evidence, pitch during a change of speed is not.",
        equation="phi = -(9.81 m/s2 sin(alpha) - r dv/dt) (1 + s (m / 15000 kg - 1))",
        source="Coen et al. 2005, equations 2 and 9, Table VI (90 % of the DC gain at +3.3 deg)",
        signature="the residual follows -sin(pitch) slowly, at any speed and current, and changes sign with the "
        "direction of the slope",
        look_alikes=("sensor_bias", "crop_load", "leakage", "rolling_resistance"),
        experiment="constant current over a hill of at least 3 degrees, up and back down the same way at the same "
        "speed, each for 20 s or more: grade changes its sign, every other load keeps it; again with a full bin for "
        "the share of the mass",
    )

    mass_share: float = 0.0
    acceleration_share: float = 0.0

    def start(self, like: Value) -> State:
        """The speed in m/s two samples ago, not known yet."""
        return like * math.nan

    def step(self, value: Value, past_speed: Value, signals: Signals, state: State, dt_s: float) -> tuple[Value, State]:
        """The pull of the slope, for the present mass."""
        pitch_deg = signals["pitch_deg"]
        mass_kg = signals.get("machine_mass_kg", EMPTY_KG)
        mass_kg = where(mass_kg == mass_kg, mass_kg, EMPTY_KG)  # NaN: not measured
        sine = np.sin(np.radians(pitch_deg)) if isinstance(pitch_deg, np.ndarray) else math.sin(math.radians(pitch_deg))
        accel_mps2 = (past_speed - where(state == state, state, past_speed)) / dt_s
        slope_mps2 = GRAVITY_MPS2 * sine - self.acceleration_share * accel_mps2
        return -slope_mps2 * (1.0 + self.mass_share * (mass_kg / EMPTY_KG - 1.0)), past_speed
