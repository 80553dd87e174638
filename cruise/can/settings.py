"""Settings of the bus: where it is, who is who on it, and what our own frames are called there."""

from typing import Annotated, Literal

import msgspec

Address = Annotated[int, msgspec.Meta(ge=0, le=253)]  # SAE J1939-81; 254 and 255 are no senders
ProprietaryPgn = Annotated[int, msgspec.Meta(ge=0xFF00, le=0xFFFF)]  # SAE J1939-21: proprietary B
DataId = Annotated[int, msgspec.Meta(ge=0, le=0xFFFF)]
Channel = Annotated[str, msgspec.Meta(min_length=1)]
BusKind = Literal["virtual", "socketcan"]


class SourceAddresses(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Who sends what; a frame from another address is refused. null takes a message from any address.

    Sources: SAE J1939 table B2 (global preferred addresses), ISO 11783-5 (tractor ECU), unless stated otherwise.
    """

    cruise: Address | None = 0x11  # cruise control
    operator_panel: Address | None = 0x31  # cab controller, primary
    engine: Address | None = 0x00  # engine 1
    transmission: Address | None = 0x03  # transmission 1; also the drive's electronics
    machine: Address | None = 0xF0  # tractor ECU; speeds, oil, mass
    slope_sensor: Address | None = 0xE2  # 226, as in the DBC file of the MV5 inclinometer

    def __post_init__(self) -> None:
        others = msgspec.structs.asdict(self)
        ours = others.pop("cruise")
        same = [name for name, address in others.items() if ours is not None and address == ours]
        if same:
            raise ValueError(
                f"cruise and {' and '.join(same)} have the same address, {ours:#04x}; give cruise one of its own"
            )


class ProprietaryPgns(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Where our own messages are among the 256 that J1939 leaves to the makers (proprietary B)."""

    drive_feedback: ProprietaryPgn = 0xFF10
    machine_state: ProprietaryPgn = 0xFF11
    pump_current_command: ProprietaryPgn = 0xFF12
    commissioning_request: ProprietaryPgn = 0xFF13
    commissioning_status: ProprietaryPgn = 0xFF14

    def __post_init__(self) -> None:
        pgns = msgspec.structs.astuple(self)
        if len(set(pgns)) < len(pgns):
            raise ValueError("two messages with the same PGN; give each its own")


class DataIds(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What goes into the CRC of our own messages without being sent (AUTOSAR E2E profile 1); both ends need the same.

    The low bytes differ too, so that no two messages agree in either byte of their id.
    """

    drive_feedback: DataId = 0x1C10
    machine_state: DataId = 0x2C11
    pump_current_command: DataId = 0x3C12
    commissioning_request: DataId = 0x4C13
    commissioning_status: DataId = 0x5C14

    def __post_init__(self) -> None:
        data_ids = msgspec.structs.astuple(self)
        if len(set(data_ids)) < len(data_ids):
            raise ValueError("two messages with the same data id could be taken for each other; give each its own")


class NameSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Who we are to other J1939 controllers: the parts of our NAME (SAE J1939-81, 4.2)."""

    identity_number: Annotated[int, msgspec.Meta(ge=0, lt=2**21)] = 0  # serial number
    manufacturer_code: Annotated[int, msgspec.Meta(ge=0, lt=2**11)] = 0  # the integrator's, assigned by SAE
    ecu_instance: Annotated[int, msgspec.Meta(ge=0, lt=2**3)] = 0
    function_instance: Annotated[int, msgspec.Meta(ge=0, lt=2**5)] = 0
    function: Annotated[int, msgspec.Meta(ge=0, lt=2**8)] = 14  # table B11: cruise control
    vehicle_system: Annotated[int, msgspec.Meta(ge=0, lt=2**7)] = 0
    vehicle_system_instance: Annotated[int, msgspec.Meta(ge=0, lt=2**4)] = 0
    industry_group: Annotated[int, msgspec.Meta(ge=0, lt=2**3)] = 2  # agricultural and forestry


class CanSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The bus and everything on it that a machine may need otherwise."""

    bus: BusKind = "virtual"  # virtual: within one process; socketcan: a real or virtual interface of the kernel
    channel: Channel = "can0"  # name of the interface, or any name for the virtual bus
    bitrate_bps: Annotated[int, msgspec.Meta(ge=10_000, le=1_000_000)] = 250_000
    """bit/s; ISO 11783-2 has 250000. It is set with `ip link`, not by this program, which only names it in errors."""
    addresses: SourceAddresses = SourceAddresses()
    name: NameSettings = NameSettings()
    pgns: ProprietaryPgns = ProprietaryPgns()
    data_ids: DataIds = DataIds()
    max_counter_step: Annotated[int, msgspec.Meta(ge=1, le=7)] = 3
    """Step of the alive counter up to which a frame is taken (AUTOSAR MaxDeltaCounter); 3: two frames may be lost.
    From 8 on a frame that is too old could not be told from one that is too new."""
