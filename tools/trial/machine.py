"""The machine of a trial: the virtual combine, what its drive feels of the course, and what its sensors show.

The base machine is the virtual combine with every effect off, so that dead time, a first-order lag of the servo, the
inertia of the mass and viscous drag are left, all linear: an engine that nothing slows, a linear valve without friction
or stop, gears that are all the second, level ground, oil whose leakage does not depend on its temperature. It leaks
more than a new one and drives in a fast gear, since a stiff hydrostatic drive would hold its speed against any force.

Felt and shown are two things. Context signals move in every recording; what the drive feels of them is decided here,
field by field. An engine whose speed the drive does not feel is shown by a second engine of the same make, which
carries the true load of the drive and of the crop but turns no pump.
"""

from dataclasses import dataclass, field
from typing import Final

import numpy as np
from msgspec.structs import replace

from cruise.plant import PlantSettings
from cruise.plant.engine import EngineSettings
from cruise.plant.line import LineSettings
from cruise.plant.pump import PumpSettings
from cruise.plant.sensors import DriveFeedbackSettings, SensorSettings, SensorsSettings
from cruise.plant.settings import LINEAR, SECOND
from cruise.plant.vehicle import TransmissionSettings, VehicleSettings

from .course import RATED_RPM, Course, FloatArray
from .trial import PERIOD_S, Trial

STREAM: Final = 2
STEPS: Final = 3  # of the plant in a sample: 17 ms, a sixth of the fastest lag
STIFF: Final = 1e4  # inertia and governor of the base machine's engine over the real ones: no load slows it

OFF: Final = replace(LINEAR, gear_ratio=0)
"""Off is what bends or depends on a context signal; the rest is linear or set by the inputs."""

# The trial reads the machine's state itself, at its own instants; the plant's sensors would only take time.
SELDOM: Final = SensorSettings(rate_hz=0.1)
RARE: Final = SensorsSettings(
    drive_feedback=DriveFeedbackSettings(rate_hz=5.0),
    ground_speed_mps=SELDOM,
    wheel_speed_mps=SELDOM,
    engine_speed_rpm=SELDOM,
    engine_load_pct=SELDOM,
    gear=SELDOM,
    pitch_deg=SELDOM,
    oil_temperature_c=SELDOM,
    machine_mass_kg=SELDOM,
    line_pressure_bar=SELDOM,
)


@dataclass
class Machine:
    """What an effect may change. Arrays hold one value a sample; `felt` acts on the drive, `shown` is measured."""

    settings: PlantSettings
    felt_rpm: FloatArray  # set speed of the engine that turns the pump
    felt_grade_deg: FloatArray
    felt_grain_kg: FloatArray
    rolling_resistance: FloatArray
    implement_drag_n: FloatArray
    pull_n: FloatArray
    wheel_radius_share: FloatArray
    bias_mps: FloatArray  # of the ground speed sensor
    shown_rpm: FloatArray  # set speed of the engine that is shown, while that is not the one that turns the pump
    shown_grade_deg: FloatArray
    one_engine: bool = False  # the engine that is shown turns the pump
    ripple_n: float = 0.0  # pull of something that turns with the wheels,
    ripple_wave_m: float = 5.0  # once in this travel
    unrecorded: set[str] = field(default_factory=set)  # columns that this machine has no sensor for


def base(trial: Trial, course: Course) -> Machine:
    """The machine without any effect, its numbers drawn from the trial's seed."""
    rng = trial.rng(STREAM)
    transmission = TransmissionSettings()
    scale = rng.uniform(60.0, 75.0) / transmission.gear_ratio[SECOND]
    settings = PlantSettings(
        step_s=PERIOD_S / STEPS,
        effects=OFF,
        pump=PumpSettings(servo_lag_s=rng.uniform(0.25, 0.5), transport_delay_s=rng.uniform(0.2, 0.5)),
        engine=_stiff(EngineSettings()),
        line=LineSettings(leakage_lpm_per_100bar=rng.uniform(15.0, 25.0)),
        transmission=replace(transmission, gear_ratio=tuple(scale * ratio for ratio in transmission.gear_ratio)),
        vehicle=VehicleSettings(viscous_drag_n_per_mps=rng.uniform(800.0, 1600.0)),
        sensors=RARE,
    )
    none = np.zeros(len(course.time_s))
    return Machine(
        settings=settings,
        felt_rpm=none + RATED_RPM,
        felt_grade_deg=none,
        felt_grain_kg=none,
        rolling_resistance=none,
        implement_drag_n=course.brake_n,
        pull_n=none,
        wheel_radius_share=none + 1.0,
        bias_mps=none,
        shown_rpm=course.rpm,
        shown_grade_deg=course.grade_deg,
    )


def _stiff(engine: EngineSettings) -> EngineSettings:
    return replace(
        engine,
        inertia_kgm2=STIFF * engine.inertia_kgm2,
        governor_gain_nm_per_radps=STIFF * engine.governor_gain_nm_per_radps,
        governor_integral_nm_per_rad=STIFF * engine.governor_integral_nm_per_rad,
        drag_torque_nm=STIFF * engine.drag_torque_nm,
    )
