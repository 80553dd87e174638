"""Columns under names of their own that may be a signal which an effect lacked, and how a file of columns says so."""

from cruise.effects import EFFECTS
from cruise.signals import OUTPUT, SIGNALS
from cruise.units import UNITS, entry, spelt
from cruise.usual_names import guessed
from cruise.validation.diagnose import Diagnosis


def hints(found: Diagnosis) -> list[str]:
    """What to say of the columns that are named for want of an effect, where an effect lacked what they may be."""
    recorded = {OUTPUT, *set.intersection(*(set(one.columns) for one in found.study.recordings))}
    lacking = [one.effect for one in found.refused if not recorded.issuperset(EFFECTS[one.effect].needs)]
    lacked = sorted({need for name in lacking for need in EFFECTS[name].needs} - recorded)
    said = []
    theirs = set(found.study.recordings[0].columns) - set(SIGNALS)
    for column in (name for name in dict.fromkeys((*found.signals, found.beside)) if name in theirs):
        signal = guessed([column], lacked).get(column)
        if signal is None:
            continue
        tried = [f"`{name}`" for name in lacking if set(EFFECTS[name].needs) <= {*recorded, signal}]
        if tried:
            unit = SIGNALS[signal].unit
            scale, offset = UNITS.get(unit, {}).get(spelt(column, unit), (1.0, 0.0))
            line = entry(column, signal=signal, scale=scale, offset=offset)
            meaning = SIGNALS[signal].meaning.partition(";")[0]
            effects = " and ".join(tried)
            said.append(f"if `{column}` is {signal}, the {meaning}, {line} says so; then {effects} can be tried")
    return said
