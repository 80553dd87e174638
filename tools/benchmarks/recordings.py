"""Recordings of the virtual combine as the service would have sampled them, and the same as samples."""

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np

from cruise.plant import Combine, Inputs, PlantSettings, SensorReading
from cruise.recording import Recording
from cruise.sampling import SamplingSettings, StreamSampler
from cruise.signals import INPUT, OUTPUT, Sample

CONFIG = Path(__file__).resolve().parents[2] / "config"
PERIOD_S = 0.2  # s, the model's, 5 Hz by default (design)
_NAMES = (INPUT, OUTPUT, "engine_speed_rpm", "gear")


def drive(
    plant: PlantSettings,
    seed: int,
    seconds: float,
    period_s: float = PERIOD_S,
    changes: Sequence[tuple[float, PlantSettings]] = (),
) -> Recording:
    """A commissioning drive on level concrete in second gear: random steps of the current, held 0.6 to 4 s.

    `changes`: from these times in s on it is another machine, its state stays.
    """
    rng = np.random.default_rng(seed)
    combine, sampler = Combine(plant, seed), StreamSampler(SamplingSettings())
    rows, until_s, current_ma, waiting = [], 0.0, 0.0, list(changes)
    for k in range(1, round(seconds / period_s) + 1):
        now_s = k * period_s
        if now_s >= until_s:
            current_ma = float(rng.uniform(450.0, 1050.0))
            until_s = now_s + float(rng.choice([0.6, 1.0, 2.0, 4.0]))
        if waiting and now_s > waiting[0][0]:
            combine.change(waiting.pop(0)[1])
        rpm = 1850.0 + 250.0 * np.sin(now_s / 37.0)
        for reading in combine.advance(Inputs(current_ma, engine_speed_setpoint_rpm=rpm), now_s):
            assert isinstance(reading, SensorReading)
            if reading.name != OUTPUT or reading.sensor == "drive_feedback":
                sampler.push(reading.name, reading.time_s, reading.value)
        rows.append(sampler.sample(now_s, period_s))
    columns = {name: np.array([row[name] for row in rows]) for name in _NAMES}
    time_s = period_s * np.arange(1, len(rows) + 1)
    return Recording(time_s, columns, period_s, f"commissioning drive, seed {seed}", averaged=True)


def parts(recording: Recording, *at_s: float) -> list[Recording]:
    """The recording cut at these times."""
    cuts = [0, *(round(time_s / recording.dt_s) for time_s in at_s), len(recording)]
    return [recording[start:stop] for start, stop in pairwise(cuts)]


def samples(recording: Recording) -> list[Sample]:
    """The recording as the estimator is given it."""
    context = {name: column.tolist() for name, column in recording.context().items()}
    columns = zip(recording.time_s.tolist(), recording.input.tolist(), recording.output.tolist(), strict=True)
    return [
        Sample(time_s, current_ma, speed_mps, {name: column[k] for name, column in context.items()})
        for k, (time_s, current_ma, speed_mps) in enumerate(columns)
    ]
