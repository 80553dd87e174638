"""The state of the virtual combine, whole and visible, and the truth that is read from it."""

from collections import deque
from dataclasses import dataclass

from cruise.plant.inputs import Inputs
from cruise.plant.sensors import SensorState


@dataclass(slots=True)
class State:
    """Everything that the next step depends on beside settings and inputs; a deep copy of it is a saved machine."""

    step: int
    inputs: Inputs
    coil_current_ma: float
    coil_history_ma: deque[float]
    spool_current_ma: float
    spool_friction: float
    swash: float
    pump_flow_m3ps: float
    line_pressure_pa: float
    ground_speed_mps: float
    travel_m: float
    wheel_speed_mps: float
    acceleration_mps2: float
    shaft_speed_radps: float
    shaft_per_travel_radpm: float
    engine_speed_radps: float
    engine_torque_nm: float
    engine_load_pct: float
    governor_nm: float
    oil_temperature_c: float
    grain_kg: float
    history: deque[tuple[float, ...]]
    sensors: list[SensorState]


@dataclass(frozen=True, slots=True)
class Truth:
    """What no sensor shows: the machine as it is at `time_s`."""

    time_s: float
    pump_current_ma: float
    swash: float
    pump_flow_lpm: float
    line_pressure_bar: float
    ground_speed_mps: float
    acceleration_mps2: float
    wheel_speed_mps: float
    motor_speed_rpm: float
    engine_speed_rpm: float
    engine_torque_nm: float
    engine_load_pct: float
    oil_temperature_c: float
    machine_mass_kg: float
    gear: int
    grade_deg: float
    pitch_deg: float
