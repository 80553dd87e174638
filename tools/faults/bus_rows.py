"""Faults of the bus: frames that do not come, come too late, too often, out of order, damaged or from somebody else."""

from random import Random
from typing import Final

from . import traffic
from .bed import CRUISE, MACHINE, PANEL, Fault
from .row import COMMAND, COUNTER, MODEL, NONE, OWN, RATE, THREE, TIME_OUT, FaultRow


def _lost(message: str) -> FaultRow:
    return FaultRow(
        f"{message} lost", "no frame of it arrives", TIME_OUT, lambda r: traffic.Lost(r, 1.0, (message,)), message
    )


def _late(rng: Random) -> Fault:
    late_s = rng.uniform(0.05, 0.4)
    return traffic.Late(rng, late_s, late_s, ("DriveFeedback",))


def _babble(rng: Random) -> Fault:
    return traffic.Babbling(rng, rng.uniform(0.0, 0.7))


def _rpm(rng: Random) -> dict[str, float]:
    return {"engine_speed_rpm": rng.uniform(900.0, 2600.0)}


def _speed(rng: Random) -> dict[str, float]:
    return {"ground_speed_mps": rng.uniform(0.0, 4.0), "pump_current_ma": rng.uniform(0.0, 1200.0)}


def _buttons(rng: Random) -> dict[str, float]:
    pressed = {"cruise_accelerate": float(rng.random() < 0.7)}
    pressed["cruise_coast"] = 1.0 - pressed["cruise_accelerate"]
    others = ("cruise_set", "cruise_resume", "brake_pedal", "clutch_pedal")
    return pressed | dict.fromkeys(others, 0.0) | {"cruise_enable": 1.0}


BUS: Final = (
    *(_lost(message) for message in traffic.NEEDED),
    FaultRow("frames lost", "30 to 90 % of all frames", TIME_OUT, lambda r: traffic.Lost(r, r.uniform(0.3, 0.9))),
    FaultRow("frames late", "the drive's frames come 0.05 to 0.4 s late", MODEL, lambda r: _late(r)),
    FaultRow(
        "frames late and mixed", "all come up to 0.3 s late, out of order", COUNTER, lambda r: traffic.Late(r, 0.0, 0.3)
    ),
    FaultRow(
        "frames repeated",
        "every frame comes twice",
        f"{COUNTER}; {RATE}",
        lambda r: traffic.Repeated(r.choice((0.01, 0.1, 0.5))),
    ),
    FaultRow(
        "frames swapped",
        "two in a row in the wrong order",
        COUNTER,
        lambda r: traffic.Swapped("DriveFeedback", "MachineState", "EEC1"),
    ),
    FaultRow(
        "traffic played back",
        "a stretch of the past over and over",
        f"{COUNTER}; noise that comes again",
        lambda r: traffic.Replayed(r.randrange(5, 40)),
    ),
    FaultRow(
        "bits flipped", "in 5 to 100 % of all frames", COUNTER, lambda r: traffic.Damaged(r, r.uniform(0.05, 1.0))
    ),
    FaultRow(
        "bits of an unprotected message flipped",
        "in 5 to 50 % of engine speed, gear or panel",
        MODEL,
        lambda r: traffic.Damaged(r, r.uniform(0.05, 0.5), messages=(r.choice(("EEC1", "ETC2", "CCVS")),)),
    ),
    FaultRow(
        "frames cut off", "fewer bytes than the message has", "length", lambda r: traffic.Damaged(r, 1.0, cut=True)
    ),
    FaultRow("babbling node", "strange frames in plenty, others are lost", TIME_OUT, lambda r: _babble(r)),
    FaultRow(
        "bus-off of the service", "it hears nobody and nobody hears it", TIME_OUT, lambda r: traffic.Silent(CRUISE)
    ),
    FaultRow("bus-off of the machine", "the machine is cut off", TIME_OUT, lambda r: traffic.Silent(MACHINE)),
    FaultRow("operator lost", "the panel is cut off", TIME_OUT, lambda r: traffic.Silent(PANEL), "CCVS"),
    FaultRow("short circuit", "nobody hears anybody", TIME_OUT, lambda r: traffic.Silent(CRUISE, MACHINE, PANEL)),
    FaultRow(
        "drive feedback from a stranger",
        "wrong address",
        "source address",
        lambda r: traffic.Stranger("DriveFeedback", _speed(r)),
    ),
    FaultRow(
        "drive feedback forged, CRC unknown",
        "lies beside the truth",
        COUNTER,
        lambda r: traffic.Forged("DriveFeedback", _speed(r), intact=False),
    ),
    FaultRow(
        "drive feedback forged, CRC known",
        "lies beside the truth",
        COUNTER,
        lambda r: traffic.Forged("DriveFeedback", _speed(r)),
    ),
    FaultRow(
        "drive feedback forged, alone",
        "lies instead of the truth",
        f"{THREE}; {COMMAND}",
        lambda r: traffic.Forged("DriveFeedback", _speed(r), alone=True),
    ),
    FaultRow(
        "engine speed inserted", "lies beside the truth", f"{RATE}; inertia", lambda r: traffic.Forged("EEC1", _rpm(r))
    ),
    FaultRow(
        "gear inserted",
        "lies beside the truth",
        f"{RATE}; no shift without clutch",
        lambda r: traffic.Forged("ETC2", {"gear": float(r.randint(0, 4))}),
    ),
    FaultRow(
        "buttons inserted",
        "accelerate or coast is pressed beside the panel",
        RATE,
        lambda r: traffic.Forged("CCVS", _buttons(r)),
    ),
    FaultRow(
        "setpoint inserted",
        "another beside the panel's",
        f"{RATE}; two that take turns",
        lambda r: traffic.Forged("MachineSelectedSpeedCommand", {"setpoint_mps": r.uniform(0.5, 5.0)}),
    ),
    FaultRow(
        "setpoint masqueraded",
        "another instead of the panel's",
        NONE,
        lambda r: traffic.Forged("MachineSelectedSpeedCommand", {"setpoint_mps": r.uniform(0.5, 5.0)}, alone=True),
        bounded=True,
    ),
    FaultRow(
        "command forged",
        "another node commands the pump",
        f"{OWN}; {COMMAND}",
        lambda r: traffic.Forged(
            "PumpCurrentCommand", {"pump_current_command_ma": r.uniform(0, 1200), "command_active": 1}
        ),
    ),
)
