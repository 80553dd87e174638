"""The reference: the setpoint as a machine can follow it, with bounded acceleration and jerk.

    |dv/dt| <= A,   |d2v/dt2| <= J,   dv/dt -> sign(e) min(A, sqrt(J |e|))   with e = setpoint - v

The square root is the acceleration from which half the allowed jerk still brings v to the setpoint without passing it
(with jerk J the remaining way would be a^2 / 2 J; a^2 / J leaves a margin). Time is an argument.
"""

import math
from collections import deque
from itertools import islice

import msgspec

from cruise.settings import Positive


class ReferenceSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How briskly the machine may be asked to change its speed."""

    accel_mps2: Positive = 0.5  # m/s2, half the limit of 1.0: the rest is kept for disturbances
    jerk_mps3: Positive = 0.8  # m/s3, comfortable for a standing person (ISO 2631-1 speaks of 0.5 to 2)


class Reference:
    """Follows the setpoint: `speed_mps` and `accel_mps2` are all its state, and the way ahead follows from them."""

    def __init__(self, settings: ReferenceSettings) -> None:
        self.settings = settings
        self.speed_mps = 0.0
        self.accel_mps2 = 0.0
        self._ahead: deque[tuple[float, float]] = deque()  # the way to the setpoint as far as it was looked at
        self._towards = (math.nan, math.nan)  # the setpoint and the step of this way

    def reset(self, speed_mps: float) -> None:
        """Begin from the machine's own speed."""
        self.speed_mps, self.accel_mps2 = speed_mps, 0.0
        self._ahead.clear()

    def step(self, setpoint_mps: float, dt_s: float) -> float:
        """The reference speed dt_s later."""
        self.speed_mps, self.accel_mps2 = self._way(setpoint_mps, dt_s, 1)[0]
        self._ahead.popleft()
        return self.speed_mps

    def preview(self, setpoint_mps: float, dt_s: float, count: int) -> list[float]:
        """The next `count` reference speeds if the setpoint stays; changes nothing."""
        return [speed for speed, _ in islice(self._way(setpoint_mps, dt_s, count), count)]

    def _way(self, setpoint: float, dt: float, count: int) -> deque[tuple[float, float]]:
        """At least `count` points of the way: what was looked at before is not computed again."""
        ahead = self._ahead
        if self._towards != (setpoint, dt):
            ahead.clear()
            self._towards = (setpoint, dt)
        speed, accel = ahead[-1] if ahead else (self.speed_mps, self.accel_mps2)
        while len(ahead) < count:
            speed, accel = self._on(speed, accel, setpoint, dt)
            ahead.append((speed, accel))
        return ahead

    def _on(self, speed: float, accel: float, setpoint: float, dt: float) -> tuple[float, float]:
        error = setpoint - speed
        wanted = math.copysign(min(self.settings.accel_mps2, math.sqrt(self.settings.jerk_mps3 * abs(error))), error)
        step = self.settings.jerk_mps3 * dt
        accel += min(max(wanted - accel, -step), step)
        after = speed + accel * dt
        there = abs(error) <= step * dt or (setpoint - after) * error < 0.0
        if there and abs(accel) <= step:  # else it passes a setpoint that came too close, and turns back
            return setpoint, 0.0
        return after, accel
