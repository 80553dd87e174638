"""What is said of a search: the first of these answers that holds, and how far it is from any other.

a force that nobody recorded; a curve of a signal that no effect is; what such a curve shows, though it takes little;
something else that no effect is; a dead time that changes; nothing; two effects that look alike; the effects that were
found
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from cruise.effects import EFFECTS
from cruise.validation.candidates import UNNAMED
from cruise.validation.confidence import margin_of_the_end
from cruise.validation.curves import curve_that_shows
from cruise.validation.exchange import Place
from cruise.validation.judged import Judged
from cruise.validation.left_over import DELAY, LeftOver, of_an_effect
from cruise.validation.selection import Selected
from cruise.validation.tried import ENOUGH, NEARLY
from cruise.validation.unnamed import SPEED

RECORD_MORE: Final = (
    "record what else could move the machine, such as slope, load, wind or soil, and drive the same again"
)
SWINGS: Final = "look for what turns or swings once in {period_s:.1f} s, on the machine or behind it, and record that"
LATE: Final = (
    "record when every command is sent and when the current follows it, and what could keep it or the valve waiting, "
    "such as the load of the bus"
)
TWO: Final = 2  # effects between which an ambiguous verdict asks for an experiment, though more may look alike


class Verdict(StrEnum):
    """What the recordings say."""

    MISSING = "missing"
    NOTHING = "nothing"
    UNLISTED = "unlisted"
    AMBIGUOUS = "ambiguous"


@dataclass(frozen=True, eq=False)
class Answer:
    """What is said, the model that comes with it, and what to drive or to record next."""

    verdict: Verdict
    margin: float  # what its confidence comes from
    final: Judged
    next_experiment: str = ""
    effects: tuple[str, ...] = ()
    signals: tuple[str, ...] = ()


def answered(found: Selected, left: LeftOver, places: Sequence[Place]) -> Answer:
    """The first answer that holds; `places` say of every effect that was found what would do as well there."""
    rules = (_unrecorded, _curve, _shown, _unlisted, _late, _nothing, _look_alikes, _missing)
    answers = (rule(found, left, places) for rule in rules)
    return next(one for one in answers if one is not None)


def unlisted(found: Selected, left: LeftOver) -> bool:
    """Whether something is missing that is none of the effects."""
    return found.curved or found.unrecorded or left.missing > _limit(found)


def _limit(found: Selected) -> float:
    """Of `LeftOver.missing`: an error that is nearly too large to be nothing, and that no effect explains, is not."""
    return 1.0 if found.chosen else NEARLY


def _margin(found: Selected, left: LeftOver, places: Sequence[Place] = ()) -> float:
    """The least evidence by which anything in the search, or in what it leaves, might have gone the other way."""
    if left.missing > _limit(found):
        return ENOUGH * (left.missing - _limit(found))
    margin = min([*(one.margin for one in places), margin_of_the_end(found)])
    return margin if found.curved else min(margin, ENOUGH * (1.0 - left.missing))


def _unrecorded(found: Selected, left: LeftOver, places: Sequence[Place]) -> Answer | None:
    if not found.unrecorded:
        return None
    signals = EFFECTS[found.steps[0].unrecorded].needs
    words = f"record what else pushes or holds the machine while {' and '.join(signals)} moves, such as wind or soil"
    return Answer(Verdict.UNLISTED, _margin(found, left), found.final, words, signals=signals)


def _curve(found: Selected, left: LeftOver, places: Sequence[Place]) -> Answer | None:
    if not found.curved:
        return None
    signals = (found.chosen[0].removeprefix(UNNAMED),)
    return Answer(Verdict.UNLISTED, _margin(found, left), found.final, _vary(signals), signals=signals)


def _shown(found: Selected, left: LeftOver, places: Sequence[Place]) -> Answer | None:
    """An error that is far too large, that nothing foretells and no swing is, but that a curve of a signal shows."""
    silent = left.missing > _limit(found) and left.silent and math.isnan(left.swing_s) and not found.chosen
    curve = curve_that_shows(found.steps[0]) if silent else None
    if curve is None:
        return None
    signals = (curve.name.removeprefix(UNNAMED),)
    return Answer(Verdict.UNLISTED, _margin(found, left), curve.judged, _vary(signals), signals=signals)


def _unlisted(found: Selected, left: LeftOver, places: Sequence[Place]) -> Answer | None:
    """What the recorded signals foretell, or what swings, or an error that is far too large."""
    if left.missing <= _limit(found):
        return None
    signals = () if left.silent else left.hidden.signals
    words = _vary(signals) if signals else RECORD_MORE
    if not math.isnan(left.swing_s):
        words = SWINGS.format(period_s=left.swing_s)
    return Answer(Verdict.UNLISTED, _margin(found, left), found.steps[0].before, words, signals=signals)


def _late(found: Selected, left: LeftOver, places: Sequence[Place]) -> Answer | None:
    if left.dead_time is None or of_an_effect(left.dead_time, found.chosen):
        return None
    margin = min(ENOUGH * (1.0 - 1.0 / left.dead_time.much), _margin(found, left, places) if found.chosen else math.inf)
    words = _vary((left.dead_time.signal,)) if left.dead_time.signal else LATE
    return Answer(Verdict.MISSING, margin, found.final, words, (*found.chosen, DELAY))


def _nothing(found: Selected, left: LeftOver, places: Sequence[Place]) -> Answer | None:
    return None if found.chosen else Answer(Verdict.NOTHING, _margin(found, left, places), found.final)


def _look_alikes(found: Selected, left: LeftOver, places: Sequence[Place]) -> Answer | None:
    """One effect, and others that explain as much in its place: the two for which there is most evidence.

    The first is the one that the final model holds: the effect that was found, or else the one that leaves less.
    """
    if len(places) != 1 or not places[0].alike:
        return None
    alike = (places[0].name, *places[0].alike)
    tried = {one.name: one for one in found.steps[0].tried}
    two = sorted(alike, key=lambda name: tried[name].counted, reverse=True)[:TWO]
    two.sort(key=lambda name: (name != alike[0], tried[name].compared.loss))
    final = found.final if alike[0] in two else tried[two[0]].judged
    words = " ".join(f"{name}: {EFFECTS[name].about.experiment}." for name in two)
    return Answer(Verdict.AMBIGUOUS, _margin(found, left, places), final, words, tuple(two))


def _missing(found: Selected, left: LeftOver, places: Sequence[Place]) -> Answer:
    words = EFFECTS[found.chosen[0]].about.experiment
    return Answer(Verdict.MISSING, _margin(found, left, places), found.final, words, found.chosen)


def _vary(signals: Sequence[str]) -> str:
    names = ["the speed" if name == SPEED else name for name in signals]
    return f"hold everything else and move {' and '.join(names)} alone, slowly and in steps, over the whole range"
