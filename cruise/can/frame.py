"""What travels on the bus: a frame, and the named ways in which one can be useless."""

from enum import StrEnum

import can

Frame = can.Message
"""One CAN frame; `timestamp` in s on the clock of whoever runs the loop."""


class FrameFault(StrEnum):
    """Why a frame was not taken. Where there is a fault, there are no readings; in a log a counter may have jumped."""

    UNKNOWN = "unknown"  # not one of our messages; the bus is full of such frames, this is no error
    ERROR_FRAME = "error_frame"  # the controller reports a fault on the wire
    REMOTE_FRAME = "remote_frame"  # a request without data; J1939-21 does not use them
    WRONG_SOURCE = "wrong_source"  # our message from another address than the one set: masquerade, or a wrong setting
    TOO_SHORT = "too_short"  # fewer bytes than the message has
    BAD_CRC = "bad_crc"  # damaged, or protected with another data id
    COUNTER_REPEATED = "counter_repeated"  # the sender stands still, or a frame was played back
    COUNTER_JUMPED = "counter_jumped"  # more frames in a row were lost than set; the next one in order is taken again
