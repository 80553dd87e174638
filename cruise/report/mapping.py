"""Columns under names of their own that may be a signal which cruise knows, and how a file of columns says so."""

from typing import Final

import numpy as np

from cruise.effects import EFFECTS
from cruise.identification.preparation import PRESSED
from cruise.signals import OUTPUT, SIGNALS
from cruise.units import UNITS, entry, spelt
from cruise.usual_names import guessed, words_of
from cruise.validation.diagnose import Diagnosis, Verdict

BRAKE: Final = "brake_pedal"
HARDLY: Final = 0.05  # of the largest value of what may be a brake, from which on it acts


def hints(found: Diagnosis) -> list[str]:
    """What to say of columns that an effect lacked, or that show a brake beside the drive, under names of their own."""
    return [*_lacked(found), *_brakes(found)]


def _brakes(found: Diagnosis) -> list[str]:
    """A brake that no signal of cruise's is: where it acts, the drive does not act alone."""
    recordings = found.study.recordings
    known = any(note.startswith(BRAKE) for one in recordings for note in one.notes)
    if found.verdict is Verdict.NOTHING or known:
        return []
    said = []
    for column in sorted(set(recordings[0].columns) - set(SIGNALS)):
        most = max(float(np.nanmax(one.columns[column])) for one in recordings)
        if {"brake", "brakes"} & words_of(column) and most > 0.0:
            line = entry(column, signal=BRAKE, scale=float(f"{PRESSED / (HARDLY * most):.2g}"))
            said.append(f"if `{column}` is of a brake beside the drive, {line} leaves the speed out where that acts")
    return said


def _lacked(found: Diagnosis) -> list[str]:
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
