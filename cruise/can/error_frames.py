"""What the CAN controller reports of itself in error frames: the state of its fault confinement.

    active -> warning (96 errors) -> passive (128 errors) -> off (256 errors; the controller no longer takes part)

Sources: ISO 11898-1, fault confinement; Linux, include/uapi/linux/can/error.h and networking/can.rst.
"""

from enum import StrEnum
from typing import Final

from cruise.can.frame import Frame

_CONTROLLER: Final = 0x004  # class in the identifier: problem of the controller, details in byte 1
_BUS_OFF: Final = 0x040
_RESTARTED: Final = 0x100
_WARNING: Final = 0x0C  # receiving, sending
_PASSIVE: Final = 0x30
_ACTIVE: Final = 0x40  # recovered to error active


class BusHealth(StrEnum):
    """How much the controller still takes part in the bus."""

    ACTIVE = "active"
    WARNING = "warning"
    PASSIVE = "passive"
    OFF = "off"  # nothing is sent or received until it is restarted (`ip link set can0 type can restart-ms 100`)
    LOST = "lost"  # the interface went down or away


def health_after(before: BusHealth, frame: Frame) -> BusHealth:
    """Return the state once an error frame has come; most of them tell of single errors and leave it as it was."""
    if frame.arbitration_id & _BUS_OFF:
        return BusHealth.OFF
    if frame.arbitration_id & _RESTARTED:
        return BusHealth.ACTIVE
    if not frame.arbitration_id & _CONTROLLER or len(frame.data) < 2:
        return before
    detail = frame.data[1]
    if detail & _PASSIVE:
        return BusHealth.PASSIVE
    if detail & _WARNING:
        return BusHealth.WARNING
    return BusHealth.ACTIVE if detail & _ACTIVE else before
