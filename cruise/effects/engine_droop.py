"""Engine droop: the diesel gives way under load, and the pump's flow with it, where its speed is not recorded.

    g = 1 - delta x / 100, from 0.2 to 1.8,   x = max(L_f - L_0, 0) less what the governor has made up for
    L_f is L through a low-pass of tau, what has been made up for is max(L_f - L_0, 0) through one of 1 / r

L engine torque in percent of the torque available at this speed, L_f what the crankshaft has felt of it, x what slows
it down, delta share of the speed that is lost from none to full load, L_0 in % load up to which the governor holds the
speed, tau s in which the crankshaft follows its load, r 1/s at which an isochronous governor brings the speed back; 0
where it doesn't. Source: ISO 3046-4 (speed droop of a governed engine); SAE J1939-71, SPN 92 (the signal). Electronic
governors hold 0 to 5 %, mechanical ones up to 8 %; more is an engine that is lugged down its full-load curve.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Final

import numpy as np

from cruise.effects.effect import About, Effect, Parameter, Stage, State, Value, clip, where
from cruise.effects.low_pass import followed, followed_across, held_over, share
from cruise.signals import Signals

STALLED: Final = 0.2  # share of the speed below which no diesel turns


@dataclass(frozen=True, slots=True)
class EngineDroop(Effect):
    """g = 1 - droop_share (L_f beyond onset_pct) / 100, L_f the low-passed load, less what has been made up for."""

    name = "engine_droop"
    stage = Stage.GAIN
    needs = ("engine_load_pct",)
    stands_for = ("engine_speed_rpm",)
    spare = ("recovery_per_s",)
    parameters: ClassVar = {
        "droop_share": Parameter("-", 0.0, 1.5, 0.0, "share of the engine speed that is lost from none to full load"),
        "onset_pct": Parameter("%", 0.0, 90.0, 0.0, "load up to which the governor holds the speed"),
        "filter_s": Parameter("s", 0.0, 2.0, 0.0, "time constant in which the crankshaft follows its load"),
        "recovery_per_s": Parameter("1/s", 0.0, 0.5, 0.0, "pace at which the governor brings the speed back; 0: never"),
    }
    about: ClassVar = About(
        physics="A governor with droop lets the engine settle at a lower speed the more torque is asked of it, and an "
        "engine at its limit falls down its full-load curve. The pump turns with the crankshaft, so that the machine "
        "slows down by the same share, whatever took the torque: crop in the threshing drum, a slope, the drive "
        "itself. A governor with an integral part brings the speed back within some seconds, so that only changes of "
        "the load are felt, and one that loses its load is quicker for a while. Once the engine speed is recorded, "
        "engine_speed says the same from the cause itself; a droop beside it is one that the recorded speed does not "
        "show, as of a belt that slips, or where it is what the governor was told.",
        equation="g = 1 - delta x / 100 %,  x = max(L - L_0, 0), L through a low-pass of tau, less itself through one "
        "of 1 / r",
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
    recovery_per_s: float = 0.0

    def start(self, like: Value) -> State:
        """L_f in % and what has been made up for in %: not known yet."""
        return like * math.nan, like * math.nan

    def step(self, value: Value, past_speed: Value, signals: Signals, state: State, dt_s: float) -> tuple[Value, State]:
        """The gain so far, less what the engine has given way."""
        before_pct, made_up_pct = state
        felt_pct = followed(before_pct, signals["engine_load_pct"], share(self.filter_s, dt_s))
        over_pct = self._over(felt_pct)
        known = over_pct == over_pct
        made_up_pct = where(known, followed(made_up_pct, over_pct, -np.expm1(-self.recovery_per_s * dt_s)), made_up_pct)
        return value * self._gain(over_pct, made_up_pct), (where(known, felt_pct, before_pct), made_up_pct)

    def over(
        self, values: Value, past_speeds: np.ndarray, signals: Mapping[str, np.ndarray], dt_s: float
    ) -> tuple[Value, State]:
        """The whole recording by a filter."""
        felt_pct = followed_across(signals["engine_load_pct"], self.filter_s, dt_s)
        over_pct = self._over(felt_pct)
        recovery_s = 1.0 / self.recovery_per_s if self.recovery_per_s else math.inf
        made_up_pct = held_over(followed_across(over_pct, recovery_s, dt_s))
        return values * self._gain(over_pct, made_up_pct), (held_over(felt_pct), made_up_pct)

    def _over(self, felt_pct: Value) -> Value:
        """Load in % that the governor does not hold."""
        return clip(felt_pct - self.onset_pct, 0.0, math.inf)

    def _gain(self, over_pct: Value, made_up_pct: Value) -> Value:
        lacking_pct = over_pct - made_up_pct * (self.recovery_per_s > 0.0)
        return clip(1.0 - 0.01 * self.droop_share * lacking_pct, STALLED, 2.0 - STALLED)
