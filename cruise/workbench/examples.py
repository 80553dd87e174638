"""The bundled recordings: driven by the virtual combine with a fixed seed when they are first opened, then kept.

One machine is linear but for a slope that its drive feels; its twin feels none; the third is the virtual combine as it
stands, for an hour.
"""

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from msgspec.structs import replace

from cruise.csv_file import write_csv
from cruise.plant import Combine, Inputs, PlantSettings, SensorReading
from cruise.plant.engine import EngineSettings
from cruise.plant.line import LineSettings
from cruise.plant.pump import PumpSettings
from cruise.plant.sensors import SensorsSettings
from cruise.plant.settings import LINEAR
from cruise.plant.vehicle import TransmissionSettings, VehicleSettings
from cruise.recording import Recording
from cruise.sampling import SamplingSettings, StreamSampler
from cruise.signals import CONTEXT, INPUT, OUTPUT

VERSION: Final = 1  # of what is drawn below: another one makes other files
RATE_HZ: Final = 20.0  # of the paper's recordings
STANDSTILL_S: Final = 2.0  # s, the engine has settled
HILL_DEG: Final = 6.0  # of the fields that machines still work
UNEVEN_DEG: Final = 0.6  # of a field that is called level
SHOWN: Final = tuple(name for name in CONTEXT if name != "line_pressure_bar")  # few machines measure it
FAST_SENSOR: Final = "drive_feedback"  # whose speed it is; the radar shows one too

# A worn pump that leaks, so that the drive gives way to a force at all; an engine that no load slows; a pitch sensor
# with a gyroscope, which does not take acceleration for slope.
WORN: Final = PlantSettings(
    effects=replace(LINEAR, rolling_resistance=0),
    pump=PumpSettings(servo_lag_s=0.3, transport_delay_s=0.35),
    engine=EngineSettings(
        inertia_kgm2=1e5, governor_gain_nm_per_radps=1e6, governor_integral_nm_per_rad=1e6, drag_torque_nm=1e6
    ),
    line=LineSettings(leakage_lpm_per_100bar=24.0),
    transmission=TransmissionSettings(gear_ratio=(116.0, 65.0, 37.0, 21.0)),
    vehicle=VehicleSettings(viscous_drag_n_per_mps=1200.0),
    sensors=SensorsSettings(pitch_inertia_share=0.0),
)


@dataclass(frozen=True)
class Example:
    """One bundled recording."""

    name: str  # of its file
    title: str
    words: str
    seconds: float
    seed: int
    machine: PlantSettings


EXAMPLES: Final = (
    Example(
        "sometimes-slow",
        "Sometimes slow",
        "Eight minutes on a hilly field. Some days the machine does not reach its speed, and nobody knows why: one "
        "physical effect is hidden in this drive.",
        480.0,
        9,
        WORN,
    ),
    Example(
        "nothing-hidden",
        "Nothing hidden",
        "The same drive over the same hills with a drive that does not feel them. A good tool says that nothing is "
        "missing.",
        480.0,
        9,
        replace(WORN, effects=replace(WORN.effects, grade=0)),
    ),
    Example(
        "one-hour",
        "An hour in the field",
        "The whole virtual combine for one hour at 20 Hz, 72,000 samples: dead zone, curved characteristic, hysteresis "
        "and all the rest at once.",
        3600.0,
        11,
        PlantSettings(),
    ),
)


def path_of(example: Example, folder: Path) -> Path:
    """Where the recording of an example is kept."""
    return folder / f"v{VERSION}" / f"{example.name}.csv"


def make(example: Example, folder: Path, show: Callable[[str], None] = lambda text: None) -> Path:
    """The file of an example, driven now unless it is there already."""
    path = path_of(example, folder)
    if path.exists():
        return path
    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=path.parent) as mine:  # another may make it at the same time
        part = Path(mine) / path.name
        write_csv(drive(example, show), part)
        part.replace(path)  # whole or not there
    return path


def drive(example: Example, show: Callable[[str], None] = lambda text: None) -> Recording:
    """Drive the machine of an example over its course, sampled as the service samples: means over 1 / 20 Hz."""
    rng = np.random.default_rng(example.seed)
    count = round(example.seconds * RATE_HZ)
    time_s = np.arange(1, count + 1) / RATE_HZ
    current_ma = _currents(rng, time_s)
    grade_deg = _hills(rng, time_s)
    combine = Combine(example.machine, example.seed)
    sampler = StreamSampler(SamplingSettings(), (INPUT, OUTPUT, *SHOWN))
    streams, rows = sampler.streams, []
    combine.advance(Inputs(pump_current_ma=0.0), STANDSTILL_S)
    for k, (end_s, current, grade) in enumerate(
        zip(time_s.tolist(), current_ma.tolist(), grade_deg.tolist(), strict=True)
    ):
        if k % round(60 * RATE_HZ) == 0:
            show(f"driving minute {k // round(60 * RATE_HZ) + 1} of {example.seconds / 60:.0f}")
        inputs = Inputs(pump_current_ma=current, grade_deg=grade)
        for reading in combine.advance(inputs, STANDSTILL_S + end_s):
            assert isinstance(reading, SensorReading)
            if reading.name in streams and (reading.name != OUTPUT or reading.sensor == FAST_SENSOR):
                streams[reading.name].push(reading.time_s, reading.value)
        rows.append(sampler.sample(STANDSTILL_S + end_s, 1.0 / RATE_HZ))
    shown = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    return Recording(time_s, shown, 1.0 / RATE_HZ, example.name, averaged=True)


def _currents(rng: np.random.Generator, time_s: np.ndarray) -> np.ndarray:
    """Steps, and ramps between the same levels in turn, in mA: forward over the whole range, with stops."""
    levels = rng.uniform(420.0, 1100.0, len(time_s)) * (rng.uniform(size=len(time_s)) > 0.1)
    corners_s = np.cumsum(rng.uniform(3.0, 14.0, len(time_s)))
    number = np.searchsorted(corners_s, time_s)
    steps, ramps = levels[number], np.interp(time_s, corners_s, [*levels[1:].tolist(), 0.0])
    return np.where(np.floor(time_s / 60.0) % 2 == 0, steps, ramps)


def _hills(rng: np.random.Generator, time_s: np.ndarray) -> np.ndarray:
    """The slope in degrees: mostly level, a hill to climb twice a minute."""
    corners_s, slopes_deg = [0.0], [0.0]
    while corners_s[-1] < time_s[-1]:
        hill_deg = HILL_DEG * rng.uniform(0.7, 1.0)
        for pause_s, slope_deg in ((rng.uniform(20, 40), 0.0), (3.0, 1.0), (rng.uniform(4, 10), 1.0), (3.0, 0.0)):
            corners_s.append(corners_s[-1] + pause_s)
            slopes_deg.append(hill_deg * slope_deg)
    uneven_deg = np.interp(time_s, np.arange(0.0, time_s[-1] + 8.0, 4.0), rng.uniform(-1, 1, int(time_s[-1] / 4) + 2))
    return np.interp(time_s, corners_s, slopes_deg) + UNEVEN_DEG * uneven_deg
