"""The time of one control step with estimator and supervisor, on one pinned core, and whether the memory grows.

A frame is what the service computes of it: the observer, the programme and the inversion at 20 Hz, learning at 5 Hz
with the models in the shadow, their proof and what is adopted. The samples are those of a drive of the virtual combine,
replayed; the setpoint changes every 10 s. Memory is counted in blocks that Python has allocated, after the first round
and after the last: counting costs nothing, where tracing every allocation would take four times the drive, and one
object kept in 1,000 frames shows. 20 hours take about four minutes.
"""

import gc
import os
import sys
from dataclasses import replace
from time import perf_counter_ns

import numpy as np

from cruise import settings
from cruise.control.controller import Controller, ControlSettings
from cruise.control.proof import ProofSettings
from cruise.estimation.estimator import EstimatorSettings
from cruise.estimation.supervision import SupervisionSettings
from cruise.model import files
from cruise.plant import PlantSettings
from cruise.service.learning import Learning
from cruise.signals import Sample

from .figures import Figure, Part
from .recordings import CONFIG, drive, samples

SEED = 12
SECONDS = 120.0  # s of driving, replayed
HOURS = 20.0  # simulated, over which the memory is watched
FRAMES = 20000  # timed
LATEST_US = 500.0
GROWTH_BLOCKS = 1500.0  # a model that is proving itself keeps its predictions: up to 1,000, come and gone
SETPOINTS_MPS = (1.2, 1.6, 1.0, 1.4)


class Step:
    """One frame after the other, round and round the drive."""

    def __init__(self, seconds: float) -> None:
        control = ControlSettings()
        model = files.load(CONFIG / "factory_model.yaml")
        plant = settings.load(CONFIG / "plant.yaml", PlantSettings)
        self.given = samples(drive(plant, SEED, seconds, control.frame_s))
        self.controller = Controller(model, control)
        self.learning = Learning(model, self.controller, EstimatorSettings(), SupervisionSettings(), ProofSettings())
        self.frame_s, self.every = control.frame_s, self.controller.frames
        self.k = 0

    def __call__(self) -> None:
        """A frame, with learning where a period of the model ends."""
        sample = self.given[self.k % len(self.given)]
        time_s = self.k * self.frame_s
        if self.k % self.every == 0:
            self.learning.learn(self._at(sample, time_s))
        self.controller.step(sample, SETPOINTS_MPS[int(time_s / 10.0) % len(SETPOINTS_MPS)])
        self.k += 1

    def _at(self, sample: Sample, time_s: float) -> Sample:
        return replace(sample, time_s=time_s, engaged=True, reference_mps=self.controller.reference.speed_mps)


def measure(seconds: float = SECONDS, frames: int = FRAMES, hours: float = HOURS) -> Part:
    """Time the frames, then watch the memory."""
    step = Step(seconds)
    for _ in range(len(step.given)):
        step()
    times_us = _timed(step, frames)
    grown = growth(step, round(hours * 3600.0 / step.frame_s))
    p50, p99 = np.quantile(times_us, [0.5, 0.99]).tolist()
    figures = (
        Figure("step_p50_us", p50, "us", "control step with estimator and supervisor, p50"),
        Figure("step_p99_us", p99, "us", "control step with estimator and supervisor, p99", LATEST_US),
        Figure("step_max_us", float(times_us.max()), "us", "control step with estimator and supervisor, max"),
        Figure("growth_blocks", grown, "1", f"blocks allocated more after {hours:g} simulated hours", GROWTH_BLOCKS),
    )
    return Part(figures, (SEED,), (f"{frames} frames of {step.frame_s:g} s timed, pinned to one core, collector off",))


def _timed(step: Step, frames: int) -> np.ndarray:
    """Times (frames,) in us on the last of the cores that are ours."""
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {max(cores)})
    times_us = np.zeros(frames)
    gc.collect()
    gc.disable()
    try:
        for k in range(frames):
            begin_ns = perf_counter_ns()
            step()
            times_us[k] = 1e-3 * (perf_counter_ns() - begin_ns)
    finally:
        gc.enable()
        os.sched_setaffinity(0, cores)
    return times_us


def growth(step: Step, frames: int) -> float:
    """How many blocks are allocated more at the end than at the beginning, both between two rounds of the drive."""

    def allocated() -> int:
        gc.collect()
        return sys.getallocatedblocks()

    for _ in range(len(step.given)):
        step()
    before = allocated()
    for _ in range(frames):
        step()
    return float(allocated() - before)
