"""AUTOSAR E2E profile 1, variant 1A: a CRC and an alive counter in our own frames, a data id in the CRC only.

    byte 0: CRC-8 SAE J1850 over both bytes of the data id, then bytes 1..n; byte 1, low half: counter 0..14
    step = (received - last) mod 15;    0: repeated,    1..max_step: taken,    else: jumped

The library computes and checks the CRC and increments the counter; what to make of the counter is decided here.

Source: AUTOSAR FO R20-11, E2E Protocol Specification (document 849), profile 1: E2E_P01Protect, E2E_P01Check.
"""

from typing import Final

from e2e import p01

from cruise.can.frame import FrameFault

COUNTS: Final = 15  # states of the counter; 15 itself is not one of them
_LOW_HALF: Final = 0x0F


def protect(data: bytearray, data_id: int, last_counter: int) -> int:
    """Write the counter after `last_counter` and the CRC into `data`, in place, and return the counter."""
    data[1] = data[1] & ~_LOW_HALF | last_counter
    p01.e2e_p01_protect(data, data_id, data_id_mode=p01.E2E_P01_DATAID_BOTH)
    return data[1] & _LOW_HALF


def fault_of(data: bytearray, data_id: int, last_counter: int | None, max_step: int) -> FrameFault | None:
    """Return what is wrong with a protected frame, given the counter of the last intact one (None: first frame)."""
    if not p01.e2e_p01_check(data, data_id, data_id_mode=p01.E2E_P01_DATAID_BOTH):
        return FrameFault.BAD_CRC  # counter 15 too: the library takes it for one
    if last_counter is None:
        return None
    step = (counter_of(data) - last_counter) % COUNTS
    if step == 0:
        return FrameFault.COUNTER_REPEATED
    return None if step <= max_step else FrameFault.COUNTER_JUMPED


def counter_of(data: bytearray) -> int:
    """Return the alive counter in a protected frame."""
    return data[1] & _LOW_HALF
