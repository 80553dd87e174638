"""Crop load: threshing takes torque from the engine that the drive then lacks.

    phi_k = -c |c / c_0|^(p - 1) x_k (1 + q_s (|y| / v_0 - 1)),   x_k = clip(h x_(k-1) + y / y_c, -1, 1)
    c = (load - l_0 - r |y| - q y dy/dt - k (dp y - p_0 |y|)) / 100 %, and where c_1 > 0, max(c - c_1, 0) in its place

c share of the engine's torque that crop takes, p power of it that is felt: 1 for a governor that gives way in
proportion, more for an engine that lugs the more the more it carries, the same at c_0 = 0.3. load engine torque in
percent of the torque available at this speed, y ground speed in m/s; l_0 in % is what engine, drum and fans take while
nothing is cut, r in % per m/s and q in % per m2/s3 are what of the load the drive itself makes, rolling and
accelerating, or k in % per bar m/s where the line pressure dp in bar (+ driving forward) is recorded, which shows soil,
too; k and p_0, pressure in bar along the motion while nothing holds the machine, are told by the signals alone; what is
taken so is felt through a low-pass of tau in s; c_1 is what the governor takes without giving way; x share of the loss
that acts, as of any dry resistance (coulomb_friction), y_c speed in m/s at which all of it is there within a sample, h
= exp(-T / 0.9 s) its memory: crop holds the machine back whichever way it goes and moves none that stands; q_s how far
the loss grows with the speed (`stroke`, v_0 = 1.5 m/s), 1 where the pump turns as much more slowly as the engine gives
way. Source: sections V.B and VI of Coen et al. 2005 ("in field conditions, where the engine faces higher loads"); the
power of the load is an assumption of this program.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Final

import numpy as np

from cruise.effects.effect import About, Effect, Parameter, Stage, State, Value, dry, dry_over, where
from cruise.effects.low_pass import followed, followed_across, held_over, share
from cruise.effects.stroke import STROKE_SHARE, factor
from cruise.signals import Signals

USUAL: Final = 0.3  # of the torque, c_0


@dataclass(frozen=True, slots=True)
class CropLoad(Effect):
    """phi = -(engine_load_pct less idle's and the drive's) / 100, or a power of it, against the motion.

    Its coefficient is in m/s.
    """

    name = "crop_load"
    stage = Stage.LOAD
    needs = ("engine_load_pct",)
    helps = ("line_pressure_bar",)
    reads_speed = True
    instead = ("traction_pct_per_bar_mps", "rest_bar", "onset_pct")
    told_by = ("line_pressure_bar",)
    spare = ("exponent", "onset_pct", "stroke_share")
    parameters: ClassVar = {
        "idle_pct": Parameter("%", 0.0, 60.0, 0.0, "load while nothing is cut: engine, drum and fans by themselves"),
        "rolling_pct_per_mps": Parameter("% per m/s", 0.0, 15.0, 0.0, "load that rolling makes: 15 t and 0.06 are 3.5"),
        "inertia_pct_per_m2ps3": Parameter("% per m2/s3", 0.0, 15.0, 0.0, "load that accelerating makes: 15 t are 6"),
        "traction_pct_per_bar_mps": Parameter(
            "% per bar m/s", 0.0, 5.0, 0.0, "load that the drive's pressure makes; 0: it goes by rolling and inertia"
        ),
        "rest_bar": Parameter("bar", -400.0, 400.0, 0.0, "pressure while nothing holds the machine"),
        "filter_s": Parameter("s", 0.0, 2.0, 0.0, "time constant in which the drive follows the crop"),
        "crossover_mps": Parameter("m/s", 0.01, 0.5, 0.5, "speed at which the loss is there within a sample"),
        "exponent": Parameter("-", 1.0, 2.5, 1.0, "power of the load that is felt; 1 is in proportion"),
        "onset_pct": Parameter("%", 0.0, 80.0, 0.0, "load that the governor takes without giving way; 0: it gives way"),
        "stroke_share": STROKE_SHARE,
    }
    about: ClassVar = About(
        physics="Header, threshing drum and straw chopper hang on the same engine as the drive. When the crop is dense "
        "they take torque, the engine gives way, and the machine loses speed although nobody touched the lever. The "
        "load that the engine reports is the sum of crop, drive and what runs empty: it rises with every command, "
        "every acceleration and every slope, so that it is a consequence of the motion before it is a cause. Believe "
        "in this effect only where the load changes while current and slope do not. What the crop takes, it takes from "
        "a machine that moves, in reverse too: no load of the engine pushes a standing machine backwards. Where the "
        "pump turns more slowly with the engine, a fast machine loses more than a slow one.",
        equation="phi = -c |c / 0.3|^(p - 1) x (1 + q_s (|y| / 1.5 m/s - 1)), through a low-pass of tau,  c = (load - "
        "l_0 - r |y| - q y dy/dt - k (dp y - p_0 |y|)) / 100 %,  x 1 forward, -1 in reverse, fading at rest",
        source="Coen et al. 2005, sections V.B and VI; the power is an assumption",
        signature="the residual follows minus the engine load, at constant current too and before the speed has moved",
        look_alikes=("power_limit", "engine_droop", "grade", "leakage"),
        experiment="constant current on level ground at 1 m/s, the threshing unit engaged and disengaged, or half and "
        "full cutting width, each for 20 s: the load changes from outside; then a hill with the threshing unit off, "
        "where grade acts and crop_load doesn't",
    )

    idle_pct: float = 0.0
    rolling_pct_per_mps: float = 0.0
    inertia_pct_per_m2ps3: float = 0.0
    traction_pct_per_bar_mps: float = 0.0
    rest_bar: float = 0.0
    filter_s: float = 0.0
    crossover_mps: float = 0.2
    exponent: float = 1.0
    onset_pct: float = 0.0
    stroke_share: float = 0.0

    def start(self, like: Value) -> State:
        """Speed in m/s two samples ago and the share that is taken, not known yet; the share that acts: none so far."""
        return like * math.nan, like * math.nan, like * 0.0

    def step(self, value: Value, past_speed: Value, signals: Signals, state: State, dt_s: float) -> tuple[Value, State]:
        """What of the present load the drive does not make itself."""
        before_mps, felt, held = state
        acting = dry(past_speed, self.crossover_mps, held, dt_s)
        now = self._taken(past_speed, before_mps, signals, dt_s)
        taken = followed(felt, now, share(self.filter_s, dt_s))
        loss = -taken * acting * factor(self.stroke_share, past_speed)
        return loss, (past_speed, where(taken == taken, taken, felt), where(acting == acting, acting, 0.0))

    def over(
        self, values: Value, past_speeds: np.ndarray, signals: Mapping[str, np.ndarray], dt_s: float
    ) -> tuple[Value, State]:
        """The whole recording at once, but for the share that acts."""
        before_mps = np.concatenate([past_speeds[:1], past_speeds[:-1]])
        now = self._taken(past_speeds, before_mps, signals, dt_s)
        shares, held = dry_over(past_speeds, self.crossover_mps, dt_s)
        taken = followed_across(now, self.filter_s, dt_s)
        return -taken * shares * factor(self.stroke_share, past_speeds), (past_speeds, held_over(taken), held)

    def _taken(self, past_speed: Value, before_mps: Value, signals: Signals, dt_s: float) -> Value:
        """What is felt of the load less what runs empty, rolls and accelerates."""
        accel_mps2 = (past_speed - where(before_mps == before_mps, before_mps, past_speed)) / dt_s
        way_mps = abs(past_speed)
        by_bar = signals.get("line_pressure_bar", math.nan) * past_speed - self.rest_bar * way_mps
        by_bar = where(by_bar == by_bar, by_bar, 0.0)  # NaN: not measured
        own_pct = self.idle_pct + self.rolling_pct_per_mps * way_mps + self.traction_pct_per_bar_mps * by_bar
        own_pct = own_pct + self.inertia_pct_per_m2ps3 * past_speed * accel_mps2
        taken = 0.01 * (signals["engine_load_pct"] - own_pct)
        beyond = taken - 0.01 * self.onset_pct
        taken = where((self.onset_pct > 0.0) * (beyond < 0.0), 0.0, beyond)
        return taken * (abs(taken) / USUAL) ** (self.exponent - 1.0)
