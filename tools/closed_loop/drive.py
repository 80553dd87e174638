"""Drives the virtual combine over a course, without the bus: plant, the service's sampler, a driver, frame by frame.

Errors are of the true speed. The reference is the feasible one for the operator's setpoint, the same for every driver,
begun from the true speed at the engagement and delayed by the machine's own dead time.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np

from cruise.control.reference import Reference, ReferenceSettings
from cruise.plant import Combine, PlantSettings, SensorReading
from cruise.sampling import SamplingSettings, StreamSampler
from cruise.signals import CONTEXT, INPUT, OUTPUT, Sample

from .courses import Course

FRAME_S: Final = 0.05
APPROACH_S: Final = 20.0  # s driven by hand before the course begins
LIFT_MA: Final = 120.0  # mA beyond the approach's current and back: the spool's friction then stands on one side
SETTLED_S: Final = 8.0  # s after the engagement that count for nothing

Ripple = Callable[[float], float]


class Driver(Protocol):
    """What turns samples into currents, a frame at a time; setpoint None while a person drives."""

    def step(self, sample: Sample, setpoint_mps: float | None) -> float: ...


@dataclass(frozen=True, eq=False)
class Driven:
    """One drive at the rate of the frames; arrays (N,), from the engagement on."""

    time_s: np.ndarray
    setpoint_mps: np.ndarray
    reference_mps: np.ndarray  # delayed by the dead time
    speed_mps: np.ndarray
    current_ma: np.ndarray
    engine_rpm: np.ndarray

    @property
    def settled(self) -> np.ndarray:
        """Where the engagement is over."""
        return self.time_s > SETTLED_S

    @property
    def since_change_s(self) -> np.ndarray:
        """Time since the setpoint changed last, infinite before the first change."""
        changes = np.flatnonzero(np.diff(self.setpoint_mps, prepend=self.setpoint_mps[0]) != 0.0)
        since = np.full(len(self.time_s), np.inf)
        for start in changes:
            since[start:] = np.arange(len(since) - start) * FRAME_S
        return since


def drive(course: Course, plant: PlantSettings, driver: Driver, seed: int, ripple: Ripple | None = None) -> Driven:
    """Drive one course; `ripple` is added to the speed that the driver sees, over time in s."""
    machine = course.machine(plant)
    combine = Combine(machine, seed)
    names = (INPUT, OUTPUT, *CONTEXT)
    sampler = StreamSampler(SamplingSettings(), names)
    target = Reference(ReferenceSettings())
    dead = round(machine.pump.transport_delay_s * machine.effects.transport_delay / FRAME_S)
    current_ma, references, rows = 0.0, [], []
    for k in range(1, round((APPROACH_S + course.seconds) / FRAME_S) + 1):
        now_s = k * FRAME_S - APPROACH_S
        for reading in combine.advance(course.inputs(current_ma, now_s), k * FRAME_S):
            assert isinstance(reading, SensorReading)
            if reading.name == OUTPUT:
                if reading.sensor == "drive_feedback":
                    added = ripple(reading.time_s - APPROACH_S) if ripple else 0.0
                    sampler.push(OUTPUT, reading.time_s, reading.value + added)
            else:
                sampler.push(reading.name, reading.time_s, reading.value)
        means = sampler.sample(k * FRAME_S, FRAME_S)
        signals = {name: means[name] for name in (*CONTEXT, OUTPUT)}
        engaged = now_s > 0.0
        sample = Sample(k * FRAME_S, means[INPUT], means[OUTPUT], signals, engaged=engaged)
        speed_mps = combine.truth.ground_speed_mps
        setpoint_mps = course.setpoint_mps(now_s)
        if not engaged:
            driver.step(sample, None)
            current_ma = _by_hand(course.begin.current_ma, now_s)
            target.reset(speed_mps)
            references = [speed_mps] * dead
            continue
        references.append(target.step(setpoint_mps, FRAME_S))
        current_ma = driver.step(sample, setpoint_mps)
        truth = combine.truth
        rows.append((now_s, setpoint_mps, references[-1 - dead], speed_mps, current_ma, truth.engine_speed_rpm))
    return Driven(*np.array(rows).T)


def _by_hand(current_ma: float, now_s: float) -> float:
    """Up to the current, beyond it and back to it."""
    beyond = LIFT_MA * math.exp(-0.5 * ((now_s + 0.6 * APPROACH_S) / 2.0) ** 2)
    return min(current_ma, 150.0 * (now_s + APPROACH_S)) + beyond


def rms(values: Sequence[np.ndarray]) -> float:
    """Root of the mean over courses of the mean square within each."""
    return math.sqrt(float(np.mean([np.mean(one**2) for one in values]))) if values else math.nan
