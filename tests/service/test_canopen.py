"""A CANopen panel on the same bus: its setpoint and switch count where the settings say so, NMT stop means neutral."""

import msgspec
import pytest

from cruise.can.bus import open_bus
from cruise.can.codec import Codec
from cruise.can.frame import Frame
from cruise.cli.places import CONFIG
from cruise.control.engagement import ExitReason, State
from cruise.plant import Combine, PlantSettings
from cruise.service import settings as service_settings
from cruise.service.combine_node import CombineNode
from cruise.service.course import OperatorRow
from cruise.service.cruise_node import CruiseNode
from cruise.service.loop import Lockstep
from cruise.service.operator_node import OperatorNode

STOP_S = 30.0
ROWS = (
    OperatorRow(at_s=0.5, cruise_enable=1.0, setpoint_mps=1.9),  # the J1939 panel asks for another speed
    OperatorRow(at_s=2.0, over_s=4.0, lever_pct=55.0),
    OperatorRow(at_s=12.0, press="resume"),
)


class CanopenPanel:
    """Starts the node, then sends setpoint 1.2 m/s and switch on (RPDO 1 of node 17), and stops the node at STOP_S."""

    period_s = 0.1

    def __init__(self) -> None:
        self.heard: dict[int, list[tuple[float, bytes]]] = {}

    def receive(self, frame: Frame) -> None:
        if not frame.is_extended_id:
            self.heard.setdefault(frame.arbitration_id, []).append((frame.timestamp, bytes(frame.data)))

    def tick(self, now_s: float) -> list[Frame]:
        def frame(identifier: int, data: bytes) -> Frame:
            return Frame(now_s, identifier, is_extended_id=False, data=data)

        if abs(now_s - 1.0) < 0.05:
            return [frame(0x000, bytes([1, 17]))]
        if abs(now_s - STOP_S) < 0.05:
            return [frame(0x000, bytes([2, 17]))]
        return [frame(0x211, (1200).to_bytes(2, "little") + b"\x01")]


@pytest.fixture(scope="module")
def drive():
    settings = service_settings.load(CONFIG / "cruise.yaml")
    can = msgspec.structs.replace(settings.can, bus="virtual", channel="canopen")
    settings = msgspec.structs.replace(settings, can=can, setpoint_from="canopen")
    node, panel = CruiseNode.load(settings), CanopenPanel()
    combine = Combine(PlantSettings(), 3)
    machine = CombineNode(combine, Codec.load(settings.database, can), (), ROWS)
    operator = OperatorNode(Codec.load(settings.database, can), ROWS)
    buses = [open_bus(can) for _ in range(4)]
    loop = Lockstep(list(zip((machine, operator, panel, node), buses, strict=True)))
    loop.run(STOP_S - 0.2)
    before = (node.engagement.state, node.engagement.setpoint_mps, combine.truth.ground_speed_mps)
    loop.run(STOP_S + 0.2)
    yield node, panel, before
    for bus in buses:
        bus.close()


def test_it_drives_at_the_canopen_setpoint(drive):
    _, _, (state, setpoint_mps, speed_mps) = drive
    assert state is State.ENGAGED
    assert setpoint_mps == pytest.approx(1.2)
    assert speed_mps == pytest.approx(1.2, abs=0.06)


def test_heartbeat_and_status_are_on_the_bus(drive):
    _, panel, _ = drive
    beats = panel.heard[0x711]
    assert {data[0] for _, data in beats} >= {0x00, 0x7F, 0x05}  # boot-up, pre-operational or operational
    status = [data for time_s, data in panel.heard[0x191] if time_s < STOP_S - 1.0]
    assert int.from_bytes(status[-1][2:4], "little") == pytest.approx(1200, abs=1)


def test_nmt_stop_means_neutral(drive):
    node, _, _ = drive
    assert node.engagement.state is State.OFF
    assert node.engagement.exit_reason is ExitReason.RELEASED
    assert node.command.current_ma == 0.0
