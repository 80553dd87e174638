"""The messages that the program lives on: what each must hold, whoever's DBC file describes it.

Where a signal starts, its scale and its offset are the DBC file's matter; that it is there, its width, and what it
means together with others are this table's. Speeds of ISO 11783-7 are a magnitude and a direction:

    v = s |v|,    s = +1 for direction 1 (forward), -1 for direction 0 (reverse)

Sources: SAE J1939-71, ISO 11783-7; config/cruise.dbc names them for each signal.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final, Literal

Role = Literal["cruise", "operator_panel", "engine", "transmission", "machine", "slope_sensor"]
Own = Literal[
    "drive_feedback", "machine_state", "pump_current_command", "commissioning_request", "commissioning_status"
]

CRC: Final = "crc"  # signal of our own messages, byte 1
FAST_MESSAGE: Final = "DriveFeedback"  # speed and current that the model lives on; other messages only add context
COUNTER: Final = "alive_counter"  # signal of our own messages, low half of byte 2
REVERSE: Final = 0  # states of the direction SPNs, ISO 11783-7 A.10
FORWARD: Final = 1
OPEN: Final = 3  # not available; 2 is "error"


@dataclass(frozen=True, slots=True)
class Direction:
    """The signal that holds the sign of `speed`, and the sign where the sender leaves it open (NaN: none known)."""

    speed: str
    signal: str
    sign_if_open: float = math.nan


@dataclass(frozen=True, slots=True)
class Contract:
    """One message: who sends it, its PGN (or which of the settable ones), its signals with their width in bits."""

    name: str
    sender: Role
    signals: Mapping[str, int] = field(hash=False)
    pgn: int | None = None
    own: Own | None = None
    direction: Direction | None = None


CONTRACTS: Final = (
    Contract("EEC1", "engine", {"engine_speed_rpm": 16}, pgn=61444),
    Contract("EEC2", "engine", {"engine_load_pct": 8}, pgn=61443),
    Contract("ETC2", "transmission", {"gear": 8}, pgn=61445),
    Contract(
        "WBSD",
        "machine",
        {"wheel_speed_mps": 16, "wheel_direction": 2},
        pgn=65096,
        direction=Direction("wheel_speed_mps", "wheel_direction"),
    ),
    Contract(
        "GBSD",
        "machine",
        {"ground_speed_mps": 16, "ground_direction": 2},
        pgn=65097,
        direction=Direction("ground_speed_mps", "ground_direction"),
    ),
    Contract("SSI2", "slope_sensor", {"pitch_deg": 24}, pgn=61481),
    Contract("VF", "machine", {"oil_temperature_c": 8}, pgn=65128),
    Contract(
        "CCVS",
        "operator_panel",
        {
            "cruise_enable": 2,
            "brake_pedal": 2,
            "clutch_pedal": 2,
            "cruise_set": 2,
            "cruise_coast": 2,
            "cruise_resume": 2,
            "cruise_accelerate": 2,
        },
        pgn=65265,
    ),
    Contract(
        "MachineSelectedSpeedCommand",
        "operator_panel",
        {"setpoint_mps": 16, "setpoint_direction": 2},
        pgn=64835,
        # A panel that leaves the direction open asks for the one in which the machine drives; cruise drives forward.
        direction=Direction("setpoint_mps", "setpoint_direction", sign_if_open=1.0),
    ),
    Contract(
        "MachineSelectedSpeed",
        "cruise",
        {
            "machine_selected_speed_mps": 16,
            "machine_selected_direction": 2,
            "speed_source": 3,
            "limit_status": 3,
            "exit_reason": 6,
        },
        pgn=61474,
        direction=Direction("machine_selected_speed_mps", "machine_selected_direction"),
    ),
    Contract("DriveFeedback", "transmission", {"ground_speed_mps": 16, "pump_current_ma": 16}, own="drive_feedback"),
    Contract(
        "MachineState",
        "machine",
        {"lever_pct": 16, "machine_mass_kg": 16, "line_pressure_bar": 16},
        own="machine_state",
    ),
    Contract(
        "PumpCurrentCommand",
        "cruise",
        {"pump_current_command_ma": 16, "command_active": 2},
        own="pump_current_command",
    ),
    Contract("CommissioningRequest", "operator_panel", {"requested_experiment": 8}, own="commissioning_request"),
    Contract(
        "CommissioningStatus",
        "cruise",
        {"driven_experiment": 8, "experiment_progress": 8, "experiment_left_s": 16},
        own="commissioning_status",
    ),
)
"""Every message that a DBC file needs to have. Those with `own` are protected and hold CRC and COUNTER besides."""
