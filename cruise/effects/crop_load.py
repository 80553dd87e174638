"""Crop load: threshing takes torque from the engine that the drive then lacks.

    phi = -(load - r |y| - q |y| dy/dt) / 100 %

load engine torque in percent of the torque available at this speed, y ground speed in m/s; r in % per m/s and q in %
per m2/s3 are what of the load the drive itself makes, rolling and accelerating. Source: sections V.B and VI of Coen et
al. 2005 ("in field conditions, where the engine faces higher loads"); that the loss is proportional to the load is an
assumption of this program.
"""

import math
from dataclasses import dataclass
from typing import ClassVar

from cruise.effects.effect import About, Effect, Parameter, Stage, State, Value, where
from cruise.signals import Signals


@dataclass(frozen=True, slots=True)
class CropLoad(Effect):
    """phi = -(engine_load_pct less the drive's own) / 100, without unit; its coefficient is the speed at full load."""

    name = "crop_load"
    stage = Stage.LOAD
    needs = ("engine_load_pct",)
    reads_speed = True
    parameters: ClassVar = {
        "rolling_pct_per_mps": Parameter("% per m/s", 0.0, 15.0, 0.0, "load that rolling makes: 15 t and 0.06 are 3.5"),
        "inertia_pct_per_m2ps3": Parameter("% per m2/s3", 0.0, 15.0, 0.0, "load that accelerating makes: 15 t are 6"),
    }
    about: ClassVar = About(
        physics="Header, threshing drum and straw chopper hang on the same engine as the drive. When the crop is dense "
        "they take torque, the engine gives way, and the machine loses speed although nobody touched the lever. The "
        "load that the engine reports is the sum of crop and drive: it rises with every command, every acceleration "
        "and every slope, so that it is a consequence of the motion before it is a cause. Believe in this effect only "
        "where the load changes while current and slope do not.",
        equation="phi = -(load - r |y| - q |y| dy/dt) / 100 %",
        source="Coen et al. 2005, sections V.B and VI; the proportionality is an assumption",
        signature="the residual follows minus the engine load, at constant current too and before the speed has moved",
        look_alikes=("power_limit", "engine_droop", "grade", "leakage"),
        experiment="constant current on level ground at 1 m/s, the threshing unit engaged and disengaged, or half and "
        "full cutting width, each for 20 s: the load changes from outside; then a hill with the threshing unit off, "
        "where grade acts and crop_load doesn't",
    )

    rolling_pct_per_mps: float = 0.0
    inertia_pct_per_m2ps3: float = 0.0

    def start(self, like: Value) -> State:
        """The speed in m/s two samples ago, not known yet."""
        return like * math.nan

    def step(self, value: Value, past_speed: Value, signals: Signals, state: State, dt_s: float) -> tuple[Value, State]:
        """What of the present load the drive does not make itself."""
        accel_mps2 = (past_speed - where(state == state, state, past_speed)) / dt_s
        own_pct = abs(past_speed) * (self.rolling_pct_per_mps + self.inertia_pct_per_m2ps3 * accel_mps2)
        return -0.01 * (signals["engine_load_pct"] - own_pct), past_speed
