"""Engine droop: the diesel gives way under load, and the pump's flow with it, where its speed is not recorded.

    g = max(1 - delta max(L_f - L_0, 0) / 100, 0.2),   L_f through a low-pass of tau

L engine torque in percent of the torque available at this speed, delta share of the speed that is lost from none to
full load, L_0 in % load up to which the governor holds the speed, tau s in which the crankshaft follows its load.
Source: ISO 3046-4 (speed droop of a governed engine); SAE J1939-71, SPN 92 (the signal). Electronic governors hold 0 to
5 %, mechanical ones up to 8 %; more is an engine that is lugged down its full-load curve.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Final

import numpy as np

from cruise.effects.effect import About, Effect, Parameter, Stage, State, Value, clip, where
from cruise.effects.low_pass import followed, followed_over, share
from cruise.signals import Signals

STALLED: Final = 0.2  # share of the speed below which no diesel turns


@dataclass(frozen=True, slots=True)
class EngineDroop(Effect):
    """g = 1 - droop_share max(engine_load_pct - onset_pct, 0) / 100, through a low-pass."""

    name = "engine_droop"
    stage = Stage.GAIN
    needs = ("engine_load_pct",)
    stands_for = ("engine_speed_rpm",)
    parameters: ClassVar = {
        "droop_share": Parameter("-", 0.0, 1.5, 0.0, "share of the engine speed that is lost from none to full load"),
        "onset_pct": Parameter("%", 0.0, 90.0, 0.0, "load up to which the governor holds the speed"),
        "filter_s": Parameter("s", 0.0, 2.0, 0.0, "time constant in which the crankshaft follows its load"),
    }
    about: ClassVar = About(
        physics="A governor with droop lets the engine settle at a lower speed the more torque is asked of it, and an "
        "engine at its limit falls down its full-load curve. The pump turns with the crankshaft, so that the machine "
        "slows down by the same share, whatever took the torque: crop in the threshing drum, a slope, the drive "
        "itself. Once the engine speed is recorded, engine_speed says the same from the cause itself.",
        equation="g = 1 - delta max(L - L_0, 0) / 100 %, L through a low-pass of tau",
        source="ISO 3046-4 (speed droop); SAE J1939-71, SPN 92",
        signature="the residual is proportional to minus speed times engine load, at standstill there is none",
        look_alikes=("engine_speed", "power_limit", "crop_load", "speed_droop", "grade"),
        experiment="constant current at 1.5 m/s on level ground, the unloading auger or the threshing unit engaged for "
        "30 s and disengaged again, then the same at 0.5 m/s: the loss of speed falls to a third with droop and stays "
        "with a load force. The drive must not move the load itself, so no step of current meanwhile",
    )

    droop_share: float = 0.0
    onset_pct: float = 0.0
    filter_s: float = 0.0

    def start(self, like: Value) -> State:
        """L_f in %, not known yet."""
        return like * math.nan

    def step(self, value: Value, past_speed: Value, signals: Signals, state: State, dt_s: float) -> tuple[Value, State]:
        """The gain so far, less what the engine has given way."""
        now_pct = signals["engine_load_pct"]
        felt_pct = followed(state, now_pct, share(self.filter_s, dt_s))
        return value * self._gain(felt_pct), where(felt_pct == felt_pct, felt_pct, state)

    def over(
        self, values: Value, past_speeds: np.ndarray, signals: Mapping[str, np.ndarray], dt_s: float
    ) -> tuple[Value, State]:
        """The whole recording by a filter, where it has no hole."""
        now_pct = signals["engine_load_pct"]
        if not np.isfinite(now_pct).all():
            return Effect.over(self, values, past_speeds, signals, dt_s)
        felt_pct = followed_over(now_pct, self.filter_s, dt_s)
        return values * self._gain(felt_pct), felt_pct

    def _gain(self, felt_pct: Value) -> Value:
        return clip(1.0 - 0.01 * self.droop_share * clip(felt_pct - self.onset_pct, 0.0, math.inf), STALLED, 1.0)
