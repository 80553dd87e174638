"""Units of a file's columns: which their names say, and how values in them become values in this project's units."""

import re
from typing import Final, Literal

FULL_MA: Final = 1000.0  # mA, what an input that is a share of all is taken to be of
UNITS: Final[dict[str, dict[str, tuple[float, float]]]] = {
    "s": {"s": (1.0, 0.0), "ms": (1e-3, 0.0), "us": (1e-6, 0.0)},
    "mA": {
        "mA": (1.0, 0.0),
        "A": (1000.0, 0.0),
        "%": (0.01 * FULL_MA, 0.0),
        "V": (0.1 * FULL_MA, 0.0),
        "share": (FULL_MA, 0.0),
    },
    "m/s": {"m/s": (1.0, 0.0), "km/h": (1 / 3.6, 0.0), "mm/s": (1e-3, 0.0), "mph": (0.44704, 0.0)},
    "rpm": {"rpm": (1.0, 0.0), "1/s": (60.0, 0.0), "rad/s": (9.549297, 0.0)},
    "deg": {"deg": (1.0, 0.0), "rad": (57.29578, 0.0), "%": (0.5729578, 0.0)},
    "kg": {"kg": (1.0, 0.0), "t": (1000.0, 0.0)},
    "degC": {"degC": (1.0, 0.0), "K": (1.0, -273.15), "degF": (5 / 9, -160 / 9)},
    "bar": {"bar": (1.0, 0.0), "kPa": (0.01, 0.0), "psi": (0.0689476, 0.0)},
}
"""Units of a file by the unit of the signal: scale and offset."""
InputUnit = Literal["", "mA", "per cent", "V or tenths of all", "A or a share of all"]
"""What the size of an input tells of its unit; empty where its name or the settings say it, or it hardly ever moves."""
MA_PER_UNIT: Final[dict[InputUnit, float]] = {
    "mA": 1.0,
    "per cent": 0.01 * FULL_MA,
    "V or tenths of all": 0.1 * FULL_MA,
    "A or a share of all": FULL_MA,
}
"""Those that an input may be in, the ones of greater numbers first."""
SPELT: Final = {
    "pct": "%", "percent": "%", "mps": "m/s", "kmh": "km/h", "kph": "km/h", "mmps": "mm/s", "rps": "1/s", "hz": "1/s",
    "mps2": "m/s2", "m/s²": "m/s2",
    "amps": "A", "radps": "rad/s", "c": "degC", "f": "degF", "°c": "degC", "°f": "degF", "°": "deg", "1/min": "rpm",
} | {unit.lower(): unit for units in UNITS.values() for unit in units}  # fmt: skip
"""Units by how the last word of a column's name spells them."""


def apart(name: str) -> tuple[str, str]:
    """A name without its unit, and the unit: what its last word spells, or what stands in square brackets; or empty."""
    before, last = re.split(r"(?:[\s_.(\[]+|^)(?=[^\s_.(\[]*$)", name.rstrip(")] "), maxsplit=1)
    unit = SPELT.get(last.lower(), last if name.rstrip().endswith("]") else "")
    return (before, unit) if before and unit else (name, "")


def unit_of(cell: str) -> str:
    """The unit that a cell is, with or without brackets, if it is a known one; else empty."""
    return SPELT.get(cell.strip("[]() ").lower(), "")


def spelt(name: str, unit: str) -> str:
    """The unit in which a name says that a column is, if one for `unit`, of a time its first word too; else empty."""
    found = apart(name)[1]
    if unit == "s" and not found:
        found = name.partition("_")[0].lower()
    return found if found in UNITS.get(unit, (unit,)) else ""


def bracketed(name: str) -> bool:
    """Whether a name ends in brackets: what stands there is a unit, and no coil A or share of something."""
    return name.rstrip().endswith((")", "]"))


def entry(name: str, scale: float = 1.0, offset: float = 0.0, signal: str = "") -> str:
    """What the file of columns has to say of one of them."""
    key = name if re.fullmatch(r"[A-Za-z][\w.]*", name) else f'"{name}"'
    meant = [f"signal: {signal}"] * bool(signal)
    meant += [f"scale: {scale:.6g}"] * (scale != 1.0 or not signal)
    meant += [f"offset: {offset:.6g}"] * bool(offset)
    return f"columns: {{{key}: {{{', '.join(meant)}}}}} in the file of --columns"
