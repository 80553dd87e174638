"""From a DBC file to what the codec needs of each message; a file that lacks something is refused with the reason.

A signal has to be unsigned, little-endian and not multiplexed, as every SPN of SAE J1939-71 and ISO 11783-7 is; what
is signed has an offset. It has to be in the unit of the vocabulary, and in this program's own messages to hold the
whole range there: a speed in km/h would be taken for one in m/s, and a current that doesn't fit could not be sent.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import cantools
from cantools.database.can import Database, Message
from cantools.database.can.signal import Signal
from cantools.database.errors import Error as DatabaseError

from cruise.can import j1939
from cruise.can.messages import CONTRACTS, COUNTER, CRC, Contract, Direction
from cruise.can.settings import CanSettings
from cruise.settings import SettingsError
from cruise.signals import SIGNALS

FRAME_BYTES: Final = 8
_SPELLINGS: Final = {"°C": "degC", "°": "deg", "1/min": "rpm", "min-1": "rpm", "percent": "%"}
_NO_UNIT: Final = ("-", "0/1")
_PROTECTION: Final = {CRC: (0, 8), COUNTER: (8, 4)}  # start bit and width, E2E profile 1A


@dataclass(frozen=True, slots=True)
class Field:
    """One signal in its message: value = scale * raw + offset, a measurement up to `last_valid` within [low, high]."""

    name: str
    scale: float
    offset: float
    last_valid: int
    low: float
    high: float


@dataclass(frozen=True, slots=True, eq=False)
class Layout:
    """One message of the DBC file under the settings: identifier, sender (None: anybody), protection, signals.

    `fields` are the signals with a value of their own: neither direction nor protection.
    """

    name: str
    arbitration_id: int
    source_address: int | None
    data_id: int | None
    message: Message
    fields: tuple[Field, ...]
    direction: Direction | None
    blank: dict[str, int]
    """Raw value of every signal for "not available"."""


@dataclass(frozen=True, slots=True, eq=False)
class Described:
    """A DBC file: the messages that are the contracts', all others, and why those with a contract's name are others."""

    layouts: tuple[Layout, ...]
    others: tuple[Message, ...]
    problems: tuple[str, ...]


def layouts(path: str | Path, settings: CanSettings) -> tuple[Layout, ...]:
    """Read the DBC file and return a layout for every contract, in their order.

    Raises SettingsError, with every problem of the file, one a line, and what to do about it.
    """
    database = _read(Path(path))
    problems = [problem for contract in CONTRACTS for problem in _problems(contract, database)]
    read: list[Layout] = []
    if not problems:
        read = [_layout(contract, database.get_message_by_name(contract.name), settings) for contract in CONTRACTS]
        problems = [problem for one in read if one.data_id is not None for problem in _too_narrow(one)]
    if problems:
        raise SettingsError("\n".join(f"{path}: {problem}" for problem in problems))
    return tuple(read)


def described(path: str | Path, settings: CanSettings) -> Described:
    """Read any DBC file: one of a machine that has never heard of this program, too.

    Raises SettingsError for a file that can't be read.
    """
    database = _read(Path(path))
    known, problems = [], []
    for contract in CONTRACTS:
        wrong = next(_problems(contract, database), None)
        if wrong is None:
            known.append(contract)
        elif any(message.name == contract.name for message in database.messages):
            problems.append(wrong)
    ours = {contract.name for contract in known}
    return Described(
        tuple(_layout(contract, database.get_message_by_name(contract.name), settings) for contract in known),
        tuple(message for message in database.messages if message.name not in ours),
        tuple(problems),
    )


def _read(path: Path) -> Database:
    try:
        database = cantools.database.load_file(path, database_format="dbc", strict=True)
    except FileNotFoundError as error:
        raise SettingsError(f"{path}: no such file; give the path of the CAN database (config/cruise.dbc)") from error
    except OSError as error:
        raise SettingsError(f"{path}: cannot be read: {error.strerror}") from error
    except (DatabaseError, ValueError, LookupError) as error:
        raise SettingsError(f"{path}: not a DBC file that can be used: {error}") from error
    assert isinstance(database, Database)
    return database


def _problems(contract: Contract, database: Database) -> Iterator[str]:
    message = next((message for message in database.messages if message.name == contract.name), None)
    if message is None:
        yield f"message {contract.name}: missing; add it (BO_) as config/cruise.dbc has it"
        return
    if not message.is_extended_frame or not j1939.is_broadcast(j1939.pgn_of(message.frame_id)):
        yield f"message {contract.name}: not a J1939 broadcast; give it a 29-bit identifier with a PDU2 PGN"
    elif contract.pgn is not None and j1939.pgn_of(message.frame_id) != contract.pgn:
        pgn = j1939.pgn_of(message.frame_id)
        yield f"message {contract.name}: PGN {pgn}, expected {contract.pgn}; correct the identifier (BO_)"
    if message.length != FRAME_BYTES:
        yield f"message {contract.name}: {message.length} bytes long, expected {FRAME_BYTES}; correct the length (BO_)"
    signals = {signal.name: signal for signal in message.signals}
    widths = {**contract.signals, **({name: bits for name, (_, bits) in _PROTECTION.items()} if contract.own else {})}
    for name in widths | signals:
        problem = _signal_problem(signals.get(name), name, widths.get(name), contract)
        if problem:
            yield f"message {contract.name}, signal {name}: {problem}"


def _signal_problem(signal: Signal | None, name: str, bits: int | None, contract: Contract) -> str | None:
    """Return what is wrong with a signal; one that the contract does not know (`bits` None) may be there, if plain."""
    if signal is None:
        return "missing; add it (SG_) as config/cruise.dbc has it"
    if bits is not None and signal.length != bits:
        return f"{signal.length} bits wide, expected {bits}; correct the width (SG_)"
    if (
        signal.byte_order != "little_endian"
        or signal.is_signed
        or signal.is_float
        or signal.is_multiplexer
        or signal.multiplexer_ids
    ):
        return "not a plain unsigned little-endian signal; write it as @1+, with an offset for what is negative"
    if contract.own and name in _PROTECTION and signal.start != _PROTECTION[name][0]:
        return f"starts at bit {signal.start}, E2E profile 1 has it at bit {_PROTECTION[name][0]}; move it (SG_)"
    if signal.conversion.scale <= 0:
        return f"its scale is {signal.conversion.scale:g}; give it one above 0 (SG_)"
    unit = SIGNALS[name].unit if name in SIGNALS else "-"
    given = _SPELLINGS.get(signal.unit or "", signal.unit or "")
    if unit not in _NO_UNIT and given not in ("", unit):
        return f"its unit is {signal.unit}, expected {unit}; give scale and offset of a value in {unit} (SG_)"
    return None


def _too_narrow(layout: Layout) -> Iterator[str]:
    """What a message can't hold of the ranges of its signals."""
    for field in layout.fields:
        least, most = field.offset, field.offset + field.scale * field.last_valid
        low, high = (bound if math.isfinite(bound) else least for bound in (field.low, field.high))
        if least > low or most < high:
            yield (
                f"message {layout.name}, signal {field.name}: holds {least:g} to {most:g} {SIGNALS[field.name].unit}, "
                f"has to hold {low:g} to {high:g}; correct scale and offset (SG_)"
            )


def _layout(contract: Contract, message: Message, settings: CanSettings) -> Layout:
    source: int | None = getattr(settings.addresses, contract.sender)
    pgn: int = getattr(settings.pgns, contract.own) if contract.own else j1939.pgn_of(message.frame_id)
    address = j1939.NULL_ADDRESS if source is None else source
    plain = contract.direction.signal if contract.direction else None
    return Layout(
        name=contract.name,
        arbitration_id=j1939.identifier(pgn, j1939.priority_of(message.frame_id), address),
        source_address=source,
        data_id=getattr(settings.data_ids, contract.own) if contract.own else None,
        message=message,
        fields=tuple(_field(message.get_signal_by_name(name)) for name in contract.signals if name != plain),
        direction=contract.direction,
        blank={signal.name: j1939.not_available(signal.length) for signal in message.signals},
    )


def _field(signal: Signal) -> Field:
    known = SIGNALS.get(signal.name)
    return Field(
        name=signal.name,
        scale=float(signal.conversion.scale),
        offset=float(signal.conversion.offset),
        last_valid=j1939.last_valid(signal.length),
        low=known.low if known else -float("inf"),
        high=known.high if known else float("inf"),
    )
