"""May this sample teach? One answer a sample, with the reason when it is no.

What counts as excitation depends on who drives. A person moves the current for reasons of their own: its changes
excite. The controller moves it because the speed deviated: regressing speed on such a current finds the inverse of
the controller, not the drive (Ljung 1999, section 13.4). Only the reference comes from outside the loop then, so only
its changes excite, and none while it gives way to engine or drive: then it, too, follows the speed.
"""

import math
from collections import deque
from enum import StrEnum
from typing import Annotated

import msgspec

from cruise.settings import Positive
from cruise.signals import Sample


class Gate(StrEnum):
    """Open, or the first reason why not."""

    OPEN = "open"
    STALE_SIGNAL = "stale signal"
    WARMING_UP = "warming up"
    OVERRIDDEN = "overridden"
    NEUTRAL = "gear in neutral or reverse"
    GEAR_CHANGE = "gear change"
    STANDING_STILL = "standing still"
    SATURATED = "current at its limit"
    IMPLAUSIBLE = "implausible jump"
    NO_EXCITATION = "no excitation"


class GateSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """When a sample is worth learning from."""

    warm_up_s: Positive = 3.0  # s, the learning filter's own response has passed by then
    gear_settle_s: Positive = 3.0  # s, the drive line has come to rest after a change of gear
    standing_mps: Positive = 0.05  # m/s, slower is standing: friction, not the drive, decides there
    current_max_ma: Positive = 1150.0  # mA, beyond it the swash plate is at its stop
    accel_max_mps2: Positive = 4.0  # m/s2, more is a sensor's jump: the tyres give about 0.4 g
    excitation_min_mps: Positive = 0.08  # m/s, span of the changes that count, ten times the noise of a sample's speed
    # s, over which that span is taken: delay and three time constants of the drive.
    excitation_s: Annotated[float, msgspec.Meta(gt=0, le=60)] = 6.0


class GateKeeper:
    """Remembers what the answer depends on: time since start and gear change, last speed, the last moves."""

    def __init__(self, settings: GateSettings, period_s: float) -> None:
        self.settings = settings
        self.period_s = period_s
        self.restart()

    def restart(self) -> None:
        """Begin anew, after a hole in the signals."""
        self.since_start_s = 0.0
        self.since_gear_s = math.inf
        self.gear = math.nan
        self.speed_mps = math.nan
        self.engaged = False
        self.moves: deque[float] = deque(maxlen=max(round(self.settings.excitation_s / self.period_s), 2))

    def judge(self, sample: Sample, drive_mps: float) -> Gate:
        """The answer for a complete sample; `drive_mps` is the speed that its drive would give in the long run."""
        settings = self.settings
        gear = sample.signals.get("gear", math.nan)
        changed = math.isfinite(self.gear) and math.isfinite(gear) and gear != self.gear
        last_speed_mps, self.speed_mps = self.speed_mps, sample.speed_mps
        self.gear = gear if math.isfinite(gear) else self.gear  # many transmissions show none while they shift
        self.since_start_s += self.period_s
        self.since_gear_s = 0.0 if changed else self.since_gear_s + self.period_s
        excites = self._excites(sample, drive_mps)
        if self.since_start_s < settings.warm_up_s:
            return Gate.WARMING_UP
        if sample.overridden:
            return Gate.OVERRIDDEN
        if gear <= 0.0:  # in reverse the model has no drive either
            return Gate.NEUTRAL
        if self.since_gear_s < settings.gear_settle_s:
            return Gate.GEAR_CHANGE
        if abs(sample.speed_mps) < settings.standing_mps:
            return Gate.STANDING_STILL
        if abs(sample.current_ma) > settings.current_max_ma:
            return Gate.SATURATED
        if abs(sample.speed_mps - last_speed_mps) > settings.accel_max_mps2 * self.period_s:
            return Gate.IMPLAUSIBLE
        if not excites:
            return Gate.NO_EXCITATION
        return Gate.OPEN

    def _excites(self, sample: Sample, drive_mps: float) -> bool:
        move_mps = sample.reference_mps if sample.engaged else drive_mps
        if sample.engaged != self.engaged or math.isnan(move_mps):
            self.moves.clear()
        self.engaged = sample.engaged
        if math.isnan(move_mps):
            return False
        self.moves.append(move_mps)
        return max(self.moves) - min(self.moves) >= self.settings.excitation_min_mps
