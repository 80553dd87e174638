"""J1939 identifiers and the part of a parameter's raw values that carries a measurement.

    id = priority << 26 | pgn << 8 | source address        (PDU2 format: PDU format byte of the PGN >= 240)

Sources: SAE J1939-21, 5.2 (identifier) and 5.3 (PDU2), SAE J1939-71, 5.1.4, table 1 (transmitted signal ranges) and
table 2 (discrete parameters).
"""

from typing import Final

NULL_ADDRESS: Final = 0xFE  # SAE J1939-81: sender without an address; used where no address is set
PGN_MASK: Final = 0x03FFFF00  # extended data page, data page, PDU format, group extension: neither priority nor source
PDU2: Final = 0xF0  # from this PDU format on the PGN holds all 16 low bits and the frame goes to everybody

_DISCRETE_LAST_VALID: Final = {2: 0b01, 3: 0b110, 4: 0b1101, 6: 61}
"""Bits to the highest state of a discrete parameter; above it are "error" and "not available"."""


def identifier(pgn: int, priority: int, source_address: int) -> int:
    """Return the 29-bit identifier of a PDU2 message."""
    return priority << 26 | pgn << 8 | source_address


def pgn_of(arbitration_id: int) -> int:
    """Return the parameter group number of a PDU2 identifier."""
    return (arbitration_id & PGN_MASK) >> 8


def is_broadcast(pgn: int) -> bool:
    """Return whether a PGN has PDU2 format; in PDU1 its low byte would be the destination."""
    return (pgn >> 8) & 0xFF >= PDU2


def priority_of(arbitration_id: int) -> int:
    """Return the priority, 0 (highest) to 7."""
    return arbitration_id >> 26 & 0x7


def last_valid(bits: int) -> int:
    """Return the highest raw value of a `bits` wide parameter that is a measurement: 0xFA, 0xFAFF, 0xFAFFFF, ...

    Raises ValueError for a width that J1939-71 gives no such range for.
    """
    if bits in _DISCRETE_LAST_VALID:
        return _DISCRETE_LAST_VALID[bits]
    if bits in (8, 16, 24, 32):
        return (0xFB << (bits - 8)) - 1
    raise ValueError(f"SAE J1939-71 has no range of valid values for {bits} bits")


def not_available(bits: int) -> int:
    """Return the raw value for "not available": all ones."""
    return (1 << bits) - 1
