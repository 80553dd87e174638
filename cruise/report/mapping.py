"""Columns under names of their own that may be a signal which an effect lacked, and how a file of columns says so."""

from collections.abc import Collection, Mapping
from typing import Final

from cruise.effects import EFFECTS
from cruise.signals import OUTPUT, SIGNALS
from cruise.units import UNITS, entry, spelt
from cruise.validation.diagnose import Diagnosis

WORDS: Final[Mapping[str, tuple[str, ...]]] = {
    "pitch_deg": ("pitch", "slope", "incl", "grad", "tilt"),
    "engine_speed_rpm": ("eng", "speed", "rpm"),
    "engine_load_pct": ("eng", "load", "torque"),
    "oil_temperature_c": ("oil", "temp"),
    "line_pressure_bar": ("press", "line"),
    "machine_mass_kg": ("mass", "weight"),
    "wheel_speed_mps": ("wheel", "speed"),
    "gear": ("gear",),
}
"""Parts of the names that loggers give the signals which effects need."""


def likeliest(column: str, signals: Collection[str]) -> str:
    """Which of the signals a column may be by its name: the one of which most words are in it; empty where none is."""
    told = {name: sum(word in column.lower() for word in WORDS.get(name, ())) for name in signals}
    best = max(told, key=lambda name: told[name], default="")
    return best if told.get(best) else ""


def hints(found: Diagnosis) -> list[str]:
    """What to say of the columns that are named for want of an effect, where an effect lacked what they may be."""
    recorded = {OUTPUT, *set.intersection(*(set(one.columns) for one in found.study.recordings))}
    lacking = [one.effect for one in found.refused if one.reason.endswith("is not recorded")]
    lacked = {need for name in lacking for need in EFFECTS[name].needs} - recorded
    said = []
    for column in (name for name in dict.fromkeys((*found.signals, found.beside)) if name and name not in SIGNALS):
        signal = likeliest(column, lacked)
        tried = [f"`{name}`" for name in lacking if signal and set(EFFECTS[name].needs) <= {*recorded, signal}]
        if tried:
            unit = SIGNALS[signal].unit
            scale, offset = UNITS.get(unit, {}).get(spelt(column, unit), (1.0, 0.0))
            line = entry(column, signal=signal, scale=scale, offset=offset)
            meaning = SIGNALS[signal].meaning.partition(";")[0]
            effects = " and ".join(tried)
            said.append(f"if `{column}` is {signal}, the {meaning}, {line} says so; then {effects} can be tried")
    return said
