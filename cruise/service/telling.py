"""What the service says on the bus: its command, the speed it selects and why it let go, how an experiment stands."""

from typing import Final

from cruise.can.codec import Codec
from cruise.can.frame import Frame
from cruise.control.commissioning import Commissioning
from cruise.control.controller import Command
from cruise.control.engagement import Engagement

WHEEL_BASED: Final = 0.0  # ISO 11783-7, SPN 4308: the drive's own speed comes from its gearbox


class Telling:
    """Makes frames; it knows nothing but the codec, whose counters count what is sent."""

    def __init__(self, codec: Codec) -> None:
        self.codec = codec

    def command(self, engagement: Engagement, command: Command, now_s: float) -> Frame:
        """The current for the pump; inactive and 0 mA unless the program drives."""
        active = engagement.state.drives
        values = {
            "pump_current_command_ma": command.current_ma if active else 0.0,
            "command_active": float(active),
        }
        return self.codec.encode("PumpCurrentCommand", values, now_s)

    def speed(self, engagement: Engagement, command: Command, speed_mps: float, now_s: float) -> Frame:
        """The machine selected speed, with limit status and exit reason."""
        values = {
            "machine_selected_speed_mps": speed_mps,
            "speed_source": WHEEL_BASED,
            "exit_reason": float(engagement.exit_reason),
            "limit_status": float(command.limit_status),
        }
        return self.codec.encode("MachineSelectedSpeed", values, now_s)

    def experiment(self, engagement: Engagement, commissioning: Commissioning, now_s: float) -> Frame:
        """Which experiment was begun last, and how far it is."""
        experiment = engagement.experiment
        values = {
            "driven_experiment": float(experiment.number) if experiment else 0.0,
            "experiment_progress": float(commissioning.progress),
            "experiment_left_s": commissioning.left_s(now_s),
        }
        return self.codec.encode("CommissioningStatus", values, now_s)
