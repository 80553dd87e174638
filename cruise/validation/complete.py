"""Every candidate is judged on the same samples: a signal that is known part of the time only would choose its own.

An effect whose signal is missing where the drive is rough would seem to lower the error. So a signal with holes in more
than a tenth of the time is as good as not recorded, unless the model needs it, and where one of the others has a hole,
the recording has, as it has where a brake or clutch acted. What somebody asks for (lever, buttons) acts through the
current, another reading of the speed, or an engine that the wheels turn, answers to all that moves the machine: they
are no candidates, nor are the pedals.
"""

from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from cruise.identification.explore.two_speeds import two_speeds
from cruise.identification.preparation import driven_alone
from cruise.recording import Recording, listed
from cruise.signals import ASKED, INPUT, OUTPUT, PEDALS
from cruise.validation.readings import other_readings
from cruise.validation.turned import ENGINE, engine_is_turned

SHOWN: Final = 3  # recordings that are named
LEAST_KNOWN: Final = 0.9  # of the time in which current and speed are known
LEFT_OUT: Final = ", left out"  # in a note, between the reason and what follows of it


def _not_everywhere(recordings: Sequence[Recording]) -> list[str]:
    """What some of the recordings lack and others have."""
    names = sorted(set().union(*(one.columns for one in recordings)) - ASKED.union(PEDALS))
    notes = []
    for name in names:
        lacking = [one.source for one in recordings if name not in one.columns]
        more = f" and {len(lacking) - SHOWN} more" if len(lacking) > SHOWN else ""
        if lacking:
            those = "that one" if len(lacking) == 1 else "those"
            notes.append(
                f"{name}: not in {listed(lacking[:SHOWN])}{more}{LEFT_OUT} of all: it can't be blamed beside {those}"
            )
    return notes


def complete(recordings: Sequence[Recording], needed: Collection[str]) -> list[Recording]:
    """The recordings with holes where a signal has one, without the signals that have too many; their notes say so.

    FitError where a pedal is pressed throughout.
    """
    recordings = driven_alone(recordings)
    names = set.intersection(*(set(one.columns) for one in recordings)) - {INPUT, OUTPUT}
    names -= ASKED.union(PEDALS).difference(needed)
    answers = {name: why for name, why in _answers(recordings).items() if name in names.difference(needed)}
    names -= set(answers)
    there = [np.isfinite(one.input) & np.isfinite(one.output) for one in recordings]
    driven = max(sum(int(known.sum()) for known in there), 1)

    def known_in(kept: Collection[str]) -> list[np.ndarray]:
        return [
            known & np.all([np.isfinite(one.columns[name]) for name in kept], axis=0)
            for one, known in zip(recordings, there, strict=True)
        ]

    def share(kept: Collection[str]) -> float:
        return sum(int(known.sum()) for known in known_in(kept)) / driven

    shares = {name: share([name]) for name in names}
    spare = sorted(names.difference(needed), key=lambda name: (shares[name], name))
    notes = _not_everywhere(recordings)
    notes += [f"{name}: {why}{LEFT_OUT}: it is an answer, no cause" for name, why in answers.items()]
    speeds = two_speeds(recordings)
    notes += speeds.words() if speeds is not None else []
    while spare and share(names) < LEAST_KNOWN * share(names.intersection(needed)):
        name = spare.pop(0)
        names.discard(name)
        notes.append(f"{name}: known in {100.0 * shares[name]:.0f} % of the time only{LEFT_OUT}: it can't be blamed")
    result = []
    for one, known in zip(recordings, known_in(names), strict=True):
        columns = {name: values for name, values in one.columns.items() if name in names}
        drive = {INPUT: one.input, OUTPUT: np.where(known, one.output, np.nan)}
        result.append(replace(one, columns={**columns, **drive}, notes=(*one.notes, *notes)))
    return result


def _answers(recordings: Sequence[Recording]) -> dict[str, str]:
    """What the drive itself moves, and how that shows."""
    found = {name: f"goes with {what}" for name, what in other_readings(recordings).items()}
    if engine_is_turned(recordings):
        found |= dict.fromkeys(ENGINE, "the wheels turn the engine, the input hardly tells its turns per metre")
    return found


def why_left_out(name: str, recordings: Sequence[Recording]) -> str:
    """Why a signal was left out of complete recordings, in the words of their notes; empty where it was not."""
    notes = (note.removeprefix(f"{name}: ") for one in recordings for note in one.notes if note.startswith(f"{name}: "))
    return next((note.partition(LEFT_OUT)[0] for note in notes if LEFT_OUT in note), "")
