"""Courses in time that show what the memory of a gain or a load does: one for each effect that has one."""

from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np

from cruise.signals import OUTPUT

SPEED: Final = "speed"  # stands for the speed one sample before among the names of signals
PERIOD_S: Final = 0.05  # s


class Course(NamedTuple):
    """What an effect is given over time, sampled every `period_s`."""

    title: str
    speed_mps: np.ndarray
    signals: Mapping[str, np.ndarray]
    instead: tuple[str, ...]  # inputs of which a picture at a constant value would say less
    period_s: float = PERIOD_S
    shows: str = ""  # what is drawn in grey beside the effect, in its unit
    shown: np.ndarray | None = None

    @property
    def time_s(self) -> np.ndarray:
        """Time of each sample in s."""
        return self.period_s * np.arange(len(self.speed_mps))


def _over(seconds: float, period_s: float = PERIOD_S) -> np.ndarray:
    return period_s * np.arange(round(seconds / period_s))


def _reversal(speed_mps: float) -> Course:
    """From rest up to a speed within 3 s and down again, 2 s of rest, and as quickly up in reverse."""
    speeds = np.interp(_over(12.0), [1.0, 4.0, 7.0, 9.0, 12.0], [0.0, speed_mps, 0.0, 0.0, -speed_mps])
    title = f"{speed_mps:g} m/s at 4 s, at rest from 7 to 9 s, then in reverse"
    return Course(title, speeds, {OUTPUT: speeds}, (SPEED,))


def _bias() -> Course:
    """A sensor of ground speed that shows 0.3 m/s more from one moment on, until the machine stops and after."""
    time_s = _over(100.0)
    difference_mps = np.where(time_s < 10.0, 0.0, 0.3)
    wheel_mps = np.where(time_s < 90.0, 1.5, 0.0)
    return Course(
        "ground speed reads 0.3 m/s more from 10 s on; the machine stops at 90 s",
        wheel_mps,
        {OUTPUT: wheel_mps + difference_mps, "wheel_speed_mps": wheel_mps},
        ("wheel_speed_mps", OUTPUT),
        shows="ground speed - wheel speed (m/s)",
        shown=difference_mps,
    )


def _slip() -> Course:
    """Wheels that turn at one speed while the soil gives way under them for some seconds."""
    time_s = _over(8.0)
    wheel_mps = np.full(len(time_s), 2.0)
    ground_mps = wheel_mps * np.interp(time_s, [1.0, 1.3, 5.0, 5.3], [1.0, 0.75, 0.75, 1.0])
    return Course(
        "wheels at 2 m/s, which slip by 25 % from 1 to 5 s",
        ground_mps,
        {OUTPUT: ground_mps, "wheel_speed_mps": wheel_mps},
        (SPEED, OUTPUT),
        shows="ground speed - wheel speed (m/s)",
        shown=ground_mps - wheel_mps,
    )


def _hill() -> Course:
    """A hill, then level ground on which the machine speeds up and the sensor takes that for a slope."""
    time_s = _over(24.0)
    pitch_deg = np.where((time_s >= 1.0) & (time_s < 9.0), 6.0, 0.0)
    speed_mps = np.interp(time_s, [17.0, 19.0], [1.0, 3.0])
    return Course(
        "6 degrees uphill from 1 to 9 s; level and faster by 1 m/s2 from 17 to 19 s",
        speed_mps,
        {OUTPUT: speed_mps, "pitch_deg": pitch_deg},
        (OUTPUT,),
    )


def _climb() -> Course:
    """Up a hill at one speed, and faster while still on it."""
    time_s = _over(16.0)
    speed_mps = np.interp(time_s, [8.0, 10.0], [2.0, 4.0])
    return Course(
        "10 degrees uphill from 1 s on, faster by 1 m/s2 from 8 to 10 s",
        speed_mps,
        {OUTPUT: speed_mps, "pitch_deg": np.where(time_s >= 1.0, 10.0, 0.0)},
        (OUTPUT,),
    )


def _pressed() -> Course:
    """The same pressure at one speed, and faster."""
    time_s = _over(10.0)
    speed_mps = np.interp(time_s, [5.0, 7.0], [1.0, 3.0])
    pressure_bar = np.where(time_s >= 1.0, 150.0, 0.0)
    signals = {OUTPUT: speed_mps, "line_pressure_bar": pressure_bar}
    return Course("150 bar from 1 s on, faster by 1 m/s2 from 5 to 7 s", speed_mps, signals, (OUTPUT,))


def _threshing() -> Course:
    """The threshing unit engaged and disengaged again, at one current."""
    time_s = _over(12.0)
    load_pct = np.where((time_s >= 1.0) & (time_s < 7.0), 95.0, 30.0)
    return Course("engine load 95 % from 1 to 7 s", np.full(len(time_s), 1.5), {"engine_load_pct": load_pct}, ())


def _shifted() -> Course:
    """Second gear, third, and second again, all under way."""
    time_s = _over(12.0)
    gear = np.where((time_s >= 2.0) & (time_s < 7.0), 3.0, 2.0)
    return Course("second gear, third from 2 to 7 s", np.full(len(time_s), 1.5), {"gear": gear}, ())


COURSES: Final = {
    "gear_ratio": _shifted(),
    "engine_droop": _threshing(),
    "coulomb_friction": _reversal(0.3),
    "rolling_resistance": _reversal(0.3),
    "crop_load": _reversal(1.5),
    "sensor_bias": _bias(),
    "wheel_slip": _slip(),
    "grade": _hill(),
    "leakage": _pressed(),
    "power_limit": _climb(),
}
