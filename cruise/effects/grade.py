"""Grade: on a slope, a part of the machine's weight pulls along the ground.

    phi = -h p (1 + s (m / m_0 - 1)) (1 + q (|v| / v_0 - 1)),   h = d downhill (p v < 0), else 1
    p = g_n sin(alpha) - r dv/dt, through a low-pass of tau

alpha pitch (+ uphill), g_n = 9.81 m/s2, p slope less acceleration in m/s2, seen through a low-pass of tau in s, r what
of the acceleration the pitch sensor takes for slope (`pull` in steps); m mass in kg (m_0 where it is not measured), m_0
= 15000 kg, s share of the mass; q how far the loss grows with the speed (`stroke`), v_0 = 1.5 m/s, v measured speed in
m/s through the same low-pass, + forward; h = d downhill: what a slope does there over what it does uphill, where a
brake valve holds the machine back. Source: equations 2 and 9 and Table VI of Coen et al. 2005: F_G = m g sin(alpha).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Final

import numpy as np

from cruise.effects.effect import EMPTY_KG, GRAVITY_MPS2, About, Effect, Parameter, Stage, State, Value, where
from cruise.effects.low_pass import followed_across, followed_over, held_over
from cruise.effects.pull import pull, unknown
from cruise.effects.stroke import STROKE_SHARE, factor
from cruise.signals import OUTPUT, Signals

REVERSE_MPS: Final = -0.05  # m/s: less is the noise of a machine that stands, and counts as forward


@dataclass(frozen=True, slots=True)
class Grade(Effect):
    """phi = -pull (1 + mass_share (m / 15000 kg - 1)) (1 + stroke_share (|v| / 1.5 m/s - 1)), in m/s2.

    Downhill, downhill_share of it.
    """

    name = "grade"
    stage = Stage.LOAD
    needs = ("pitch_deg",)
    helps = ("machine_mass_kg", OUTPUT)
    brakes_hold = True
    spare = ("stroke_share", "downhill_share")
    parameters: ClassVar = {
        "mass_share": Parameter("-", 0.0, 1.0, 0.0, "how far the loss grows with the mass; 1 is in proportion"),
        "acceleration_share": Parameter("-", 0.0, 1.0, 0.0, "how far the sensor takes acceleration for slope"),
        "filter_s": Parameter("s", 0.0, 4.0, 0.0, "time constant through which the slope is seen"),
        "stroke_share": STROKE_SHARE,
        "downhill_share": Parameter("-", 0.0, 2.0, 1.0, "what a slope does downhill, over what it does uphill"),
    }
    about: ClassVar = About(
        physics="Uphill, the component of the weight along the slope pulls the machine back; downhill it pushes. The "
        "hydrostat answers the force with pressure, and pressure costs speed through leakage and the engine's droop: "
        "the softer the drive, the more of the force shows in the speed, and the more of the mass with it. Where the "
        "pressure pushes the swash plate back, more is lost at a great stroke than at a small one; where a valve "
        "brakes, a slope speeds the machine up less than it slows it down. A pitch sensor reads acceleration as slope "
        "(1 m/s2 looks like 5.8 degrees), so that a part of every start and stop is in the pitch too: slope that "
        "lasts is evidence, pitch during a change of speed is not.",
        equation="phi = -(9.81 m/s2 sin(alpha) - r dv/dt) (1 + s (m / 15000 kg - 1)) (1 + q (|v| / 1.5 m/s - 1)), "
        "through a low-pass of tau; d of it downhill",
        source="Coen et al. 2005, equations 2 and 9, Table VI (90 % of the DC gain at +3.3 deg)",
        signature="the residual follows -sin(pitch) slowly, at any speed and current, and changes sign with the "
        "direction of the slope",
        look_alikes=("sensor_bias", "crop_load", "leakage", "rolling_resistance"),
        experiment="constant current over a hill of at least 3 degrees, up and back down the same way at the same "
        "speed, each for 20 s or more: grade changes its sign, every other load keeps it; again with a full bin for "
        "the share of the mass, and at twice the speed for that of the stroke",
    )

    mass_share: float = 0.0
    acceleration_share: float = 0.0
    filter_s: float = 0.0
    stroke_share: float = 0.0
    downhill_share: float = 1.0

    def start(self, like: Value) -> State:
        """What `pull` remembers: nothing yet."""
        return unknown(like)

    def step(self, value: Value, past_speed: Value, signals: Signals, state: State, dt_s: float) -> tuple[Value, State]:
        """The pull of the slope, for the present mass."""
        mass_kg = signals.get("machine_mass_kg", EMPTY_KG)
        mass_kg = where(mass_kg == mass_kg, mass_kg, EMPTY_KG)  # NaN: not measured
        _, before_mps, _ = state
        pull_mps2, state = pull(signals, state, self.acceleration_share, self.filter_s, dt_s)
        return self._load(pull_mps2, mass_kg, before_mps), state

    def _load(self, pull_mps2: Value, mass_kg: Value, speed_mps: Value) -> Value:
        """phi in m/s2."""
        downhill = (pull_mps2 < 0.0) ^ (speed_mps < REVERSE_MPS)  # a speed that is not known is forward
        pull_mps2 = pull_mps2 * where(downhill, self.downhill_share, 1.0)
        return -pull_mps2 * (1.0 + self.mass_share * (mass_kg / EMPTY_KG - 1.0)) * factor(self.stroke_share, speed_mps)

    def over(
        self, values: Value, past_speeds: np.ndarray, signals: Mapping[str, np.ndarray], dt_s: float
    ) -> tuple[Value, State]:
        """The whole recording by two filters: the shape is looked for in long recordings."""
        pitch_deg = signals["pitch_deg"]
        measured_mps = np.asarray(signals.get(OUTPUT, np.full(len(pitch_deg), np.nan)), float)
        slope_mps2 = followed_over(GRAVITY_MPS2 * np.sin(np.radians(pitch_deg)), self.filter_s, dt_s)
        followed_mps = held_over(followed_across(measured_mps, self.filter_s, dt_s))
        accel_mps2 = np.nan_to_num(np.diff(followed_mps, prepend=np.nan) / dt_s)
        mass_kg = np.asarray(signals.get("machine_mass_kg", EMPTY_KG), float)
        mass_kg = np.where(np.isfinite(mass_kg), mass_kg, EMPTY_KG)
        before_mps2 = np.concatenate([[0.0], accel_mps2[:-1]])
        pull_mps2 = slope_mps2 - self.acceleration_share * before_mps2
        phi = self._load(pull_mps2, mass_kg, np.concatenate([[np.nan], followed_mps[:-1]]))
        return phi, (slope_mps2, followed_mps, accel_mps2)
