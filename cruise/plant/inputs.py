"""What acts on the virtual combine from outside: the driver, the command on the bus and the field."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Inputs:
    """Inputs, held until the next ones.

    `rolling_resistance` is the paper's beta: 0.02 on concrete, 0.05 on stubble, 0.12 on soft soil (ASAE D497).
    `crop_power_kw` is what threshing takes at rated engine speed, `grain_flow_kgps` what enters the bin (5 to 15 kg/s
    in wheat), `brake` the pedal's travel 0..1, `gear` 0 (neutral) to 4. `implement_drag_n` resists the motion, as a
    header that pushes through crop does (0 to 10 kN); `pull_n` acts whatever the motion, as wind does (+ backward).
    """

    pump_current_ma: float
    engine_speed_setpoint_rpm: float = 2100.0
    gear: int = 2
    grade_deg: float = 0.0
    rolling_resistance: float = 0.02
    crop_power_kw: float = 0.0
    grain_flow_kgps: float = 0.0
    brake: float = 0.0
    clutch: bool = False
    implement_drag_n: float = 0.0
    pull_n: float = 0.0
