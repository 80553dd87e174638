"""A CANopen node by hand-written bytes of CiA 301: what it is told, and what it says."""

from pathlib import Path

from cruise.can.frame import Frame
from cruise.can.node import CanopenNode, CanopenSettings, NodeStatus

EDS = Path(__file__).parents[2] / "config" / "cruise.eds"
STATUS = NodeStatus(ground_speed_mps=-1.5, followed_setpoint_mps=2.0, pump_current_ma=-612.35, engagement_state=2.0)
START, STOP, PRE_OPERATIONAL, RESET = "0111", "0211", "8011", "8111"  # for node 17 = 0x11


def node() -> CanopenNode:
    return CanopenNode.load(EDS, CanopenSettings(node_id=0x11))


def frame(identifier: int, data: str, time_s: float = 0.0) -> Frame:
    return Frame(arbitration_id=identifier, is_extended_id=False, data=bytes.fromhex(data), timestamp=time_s)


def sent(end: CanopenNode, now_s: float, status: NodeStatus = STATUS) -> list[tuple[int, str]]:
    frames = end.tick(now_s, status)
    assert all(f.timestamp == now_s and not f.is_extended_id for f in frames)
    return [(f.arbitration_id, f.data.hex()) for f in frames]


def started() -> CanopenNode:
    end = node()
    end.tick(0.0, STATUS)
    end.receive(frame(0, START))
    return end


def values(end: CanopenNode, received: Frame) -> dict[str, float]:
    return {reading.name: reading.value for reading in end.receive(received)}


def answered(end: CanopenNode, request: str) -> str:
    end.receive(frame(0x611, request, time_s=1.0))
    return next(data for identifier, data in sent(end, 1.0) if identifier == 0x591)
