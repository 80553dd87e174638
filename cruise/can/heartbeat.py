"""Whether another CANopen node is alive: its heartbeat is watched from the first one on.

Source: CiA 301 4.2, 7.2.8.3.2.2 (heartbeat consumer), 7.5.2.16 (object 1016h: node id << 16 | time in ms, 0: nobody).
"""

import math
from typing import Final

from cruise.can.frame import Frame

HEARTBEAT_ID: Final = 0x700
LAST_NODE_ID: Final = 127
HEARTBEAT_CONSUMER: Final = 0x1016
ROUNDING_S: Final = 1e-6  # s, what sums of periods may be off


class HeartbeatConsumer:
    """Watches one node; `watch` may be called at any time with the value of object 1016h."""

    def __init__(self) -> None:
        self.node_id, self.time_s = 0, 0.0
        self._heard_s = math.nan  # NaN: none yet, and nothing is watched

    def watch(self, entry: int) -> None:
        """Take the object's value; another node or another time is watched anew."""
        node_id, time_s = entry >> 16 & 0xFF, 0.001 * (entry & 0xFFFF)
        node_id = node_id if node_id <= LAST_NODE_ID else 0  # such an entry is not used
        if (node_id, time_s) != (self.node_id, self.time_s):
            self.node_id, self.time_s, self._heard_s = node_id, time_s, math.nan

    def receive(self, frame: Frame) -> None:
        """Take any standard data frame in."""
        if self.node_id and frame.arbitration_id == HEARTBEAT_ID + self.node_id and len(frame.data) == 1:
            self._heard_s = frame.timestamp

    def lost(self, now_s: float) -> bool:
        """Return whether a node that was alive no longer is."""
        return self.node_id != 0 and self.time_s > 0.0 and now_s - self._heard_s > self.time_s + ROUNDING_S
