"""What is written down while driving: one row per command frame, named columns."""

import math
from dataclasses import astuple, dataclass, fields

import numpy as np

from cruise.estimation.gate import Gate
from cruise.plant import Combine
from cruise.service.cruise_node import CruiseNode


@dataclass(frozen=True, slots=True)
class Row:
    """The truth of the virtual combine beside what the service knew and did."""

    time_s: float
    engaged: float
    setpoint_mps: float
    true_speed_mps: float
    true_accel_mps2: float
    reference_mps: float
    command_ma: float
    disturbance_mps: float
    engine_speed_rpm: float
    grade_deg: float
    gate_open: float
    learned_ahead_mps: float
    factory_ahead_mps: float
    persistence_ahead_mps: float
    models_adopted: float


class Trace:
    """Rows of one drive."""

    def __init__(self) -> None:
        self.rows: list[Row] = []

    def add(self, now_s: float, node: CruiseNode, combine: Combine) -> None:
        """Write the present instant down."""
        truth, ahead_mps = combine.truth, node.supervisor.rms_mps
        engaged = node.engagement.state.controls
        self.rows.append(
            Row(
                time_s=now_s,
                engaged=float(engaged),
                setpoint_mps=node.engagement.setpoint_mps if engaged else float("nan"),
                true_speed_mps=truth.ground_speed_mps,
                true_accel_mps2=truth.acceleration_mps2,
                reference_mps=node.command.reference_mps,
                command_ma=node.command.current_ma,
                disturbance_mps=node.command.disturbance_mps,
                engine_speed_rpm=truth.engine_speed_rpm,
                grade_deg=truth.grade_deg,
                gate_open=float(node.learned.gate is Gate.OPEN),
                learned_ahead_mps=ahead_mps.get("learned", math.nan),
                factory_ahead_mps=ahead_mps.get("factory", math.nan),
                persistence_ahead_mps=ahead_mps.get("persistence", math.nan),
                models_adopted=float(node.supervisor.adoptions),
            )
        )

    def columns(self) -> dict[str, np.ndarray]:
        """Every column as an array (N,)."""
        table = np.array([astuple(row) for row in self.rows], float).reshape(len(self.rows), len(fields(Row)))
        return {field.name: table[:, i] for i, field in enumerate(fields(Row))}
