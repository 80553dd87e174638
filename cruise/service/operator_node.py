"""The scripted operator's panel on the bus: switch, buttons, pedals, the speed and the experiment asked for."""

import math

from cruise.can.codec import Codec
from cruise.can.frame import Frame
from cruise.service.course import OperatorRow, pressed, value_at


class OperatorNode:
    """The panel: `tick` every `period_s`. It listens to nobody."""

    period_s = 0.1

    def __init__(self, codec: Codec, rows: tuple[OperatorRow, ...]) -> None:
        self.codec = codec
        self.rows = rows

    def receive(self, frame: Frame) -> None:
        """Nothing on the bus concerns the panel."""

    def tick(self, now_s: float) -> list[Frame]:
        """Buttons and setpoint as they stand."""
        buttons = {
            f"cruise_{name}": float(pressed(self.rows, name, now_s))
            for name in ("set", "resume", "accelerate", "coast")
        }
        switches = {
            name: float(value_at(self.rows, name, 0.0, now_s) > 0.5)
            for name in ("cruise_enable", "brake_pedal", "clutch_pedal")
        }
        setpoint_mps = value_at(self.rows, "setpoint_mps", math.nan, now_s)
        frames = [
            self.codec.encode("CCVS", buttons | switches, now_s),
            self.codec.encode("MachineSelectedSpeedCommand", {"setpoint_mps": setpoint_mps}, now_s),
        ]
        asked = value_at(self.rows, "requested_experiment", math.nan, now_s)
        if math.isfinite(asked):
            frames.append(self.codec.encode("CommissioningRequest", {"requested_experiment": asked}, now_s))
        return frames
