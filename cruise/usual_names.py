"""What columns of files are usually called: which signal each may be by its name alone."""

import difflib
import re
from typing import Final

from cruise.signals import INPUT, OUTPUT, SIGNALS
from cruise.units import UNITS, apart

TIME: Final = "time_s"
USUAL: Final[dict[str, tuple[str, ...]]] = {
    TIME: ("time", "time stamp", "timestamp", "t"),
    INPUT: ("pump current", "pump i", "solenoid current", "valve current", "current", "i"),
    OUTPUT: ("ground speed", "vehicle speed", "gps speed", "radar speed", "vehicle v", "gps v", "speed", "v"),
    "wheel_speed_mps": ("wheel speed", "wheel v"),
    "engine_speed_rpm": ("engine speed", "engine rpm", "engine n", "rpm", "n"),
    "gear": ("actual gear", "current gear", "gear index", "gear number", "gear"),
    "pitch_deg": ("pitch angle", "slope angle", "pitch", "slope", "incline"),
    "machine_mass_kg": ("machine mass", "vehicle mass", "mass", "weight"),
    "oil_temperature_c": ("oil temperature", "oil t", "temperature"),
    "engine_load_pct": ("engine load", "load"),
    "line_pressure_bar": ("line pressure", "hst pressure", "drive pressure", "pressure"),
}
"""What columns are usually called: a word of its own is the whole name, several are among those of the name."""
SHORT: Final = {
    "eng": "engine", "motor": "engine", "temp": "temperature", "spd": "speed", "velocity": "speed", "veh": "vehicle",
    "curr": "current", "press": "pressure",
}  # fmt: skip
WANTED: Final = frozenset({"command", "cmd", "setpoint", "set", "target", "desired", "requested", "reference", "ref"})
"""Words of what somebody asks for, which is not what was measured."""


def guessed(names: list[str], meanings: list[str]) -> dict[str, str]:
    """What each column may be by its name alone, its own or a usual one or one nearly spelt so; each meaning once."""
    found = {name: name for name in names if name in meanings}
    usual = [(set(said.split()), meaning) for meaning, all_said in USUAL.items() for said in all_said]
    for said, meaning in sorted(usual, key=lambda one: -len(one[0])):
        for name in names:
            taken = name in found or meaning in found.values() or meaning not in meanings
            if not taken and _called(name, said) and apart(name)[1] in ("", *units_of(meaning)):
                found[name] = meaning
    for meaning in meanings:
        free = [name for name in names if name not in found and name not in SIGNALS]
        alike = difflib.get_close_matches(meaning, free, n=1, cutoff=0.75)
        if alike and meaning not in found.values():
            found[alike[0]] = meaning
    return found


def unit_of(meaning: str) -> str:
    """The unit in which the project has this meaning; empty for none."""
    return "s" if meaning == TIME else SIGNALS[meaning].unit if meaning in SIGNALS else ""


def units_of(meaning: str) -> list[str]:
    """The units in which a file may have it, the project's own first."""
    unit = unit_of(meaning)
    return list(UNITS.get(unit, {unit or "-": (1.0, 0.0)}))


def _called(name: str, said: set[str]) -> bool:
    """Whether a column has this usual name, and is no column of cruise's own and nothing that somebody asks for."""
    words = words_of(name)
    if name in SIGNALS or words & WANTED:
        return False
    return said == words if len(said) == 1 else said <= words


def words_of(name: str) -> set[str]:
    """The words of a name without its unit, written out."""
    bare = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", apart(name)[0])
    return {SHORT.get(one, one) for one in re.split(r"[\W_]+", bare.lower()) if one}
