"""One candidate as it was tried, and when what it explains is enough to be named."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from cruise.validation.background import Background
from cruise.validation.judged import Judged, gain

ENOUGH: Final = 60.0  # evidence from which an effect is more than a little of everything
NEARLY: Final = 6.0 / 7.0  # of it, or of another limit: so near to one, nothing is missing in one case of five
LEAST_GAIN: Final = 0.15  # of the present loss: errors that fall by less than 8 % are not worth a name
MUCH: Final = 0.6  # of the present loss: no background takes so much, so that half the evidence is enough,
FEW: Final = 0.5  # of it: a little of several effects may take less together, so that half as much again is asked
RESISTANCE: Final = frozenset({"coulomb_friction", "rolling_resistance"})  # what soil looks like that nobody recorded:
CARRIED: Final = ("crop_load", 0.5)  # in whose signal it shows, as the engine carries it, too: it needs so much of the
# evidence in any case, where it takes few;
RESISTS: Final = 1.5  # times the evidence, or `ANYHOW`, where such a one takes few and nothing else was found before it
LEAST_LEFT: Final = 1e-9  # of the loss: what is left of it where there is no noise at all
SURE: Final = 1.5  # standard errors of a held-out gain; a few blocks may hold all of it,
RARE: Final = (1.0, 1.25)  # as those of a stop that is seldom reached: fewer, with so many times the evidence
BEYOND_DOUBT: Final = 5.0  # standard errors that a background, which has its moments, does not reach with
SOME: Final = 10.0  # evidence,
ANYHOW: Final = 7.0  # nor so many without
ALL_OF_IT: Final = 0.9  # of what all effects together explain: what takes more of it alone is no little of everything,
WHOLE: Final = (0.25, 2.5)  # where it is that share of the loss and so many standard errors
ALIKE: Final = 20.0  # evidence below which no form of a model is exact enough to decide,
CLOSE: Final = 0.05  # likewise, of the evidence,
LOOSE: Final = 1.2  # unless the loss decides,
APART: Final = 4.0  # or so many standard errors, by which errors are apart whatever the evidence


@dataclass(frozen=True, eq=False)
class Tried:
    """One candidate beside what was there before it."""

    name: str
    gain: float  # G: share of the loss that it takes away
    evidence: float  # for it, beside a little of everything, and from the held-out errors as they are
    credit: float  # share of that which counts against other candidates
    sureness: float  # standard errors of the log ratio of the losses
    judged: Judged
    compared: Judged  # by which it is compared with others: as it was judged, or beside every force

    @property
    def counted(self) -> float:
        """The evidence that counts against other candidates."""
        return self.credit * self.evidence


@dataclass(frozen=True, eq=False)
class Step:
    """One step of the search: what was there, and everything that was tried beside it, best first."""

    before: Judged
    tried: tuple[Tried, ...]
    background: Background
    unrecorded: str  # the effect in whose signal a force shows that nobody recorded, if there is one
    forces: Judged | None  # what was there with every force known, where the candidates are weighed beside that
    refuted: tuple[str, ...]  # those that are no force, where nothing but a force is missing
    mediated: float  # how far from its limits an effect is through whose signal every force acts: 0..1, or below 0
    taken: str = ""  # the effect that was added then


def held_out(without_it: Judged, one: Judged) -> float:
    """Evidence in the held-out errors as they are: a block of time counts as one independent error."""
    return -int(np.count_nonzero(without_it.weight)) * math.log(max(1.0 - gain(without_it, one), LEAST_LEFT))


def step_of(steps: Sequence[Step], name: str) -> Step:
    """The step at which an effect was added; the first for one that was not."""
    return next((step for step in steps if step.taken == name), steps[0])


def tried_in(step: Step, name: str) -> Tried | None:
    """A candidate as it was tried in a step."""
    return next((one for one in step.tried if one.name == name), None)


def counted(one: Tried) -> float:
    return one.counted


def asked(gain: float) -> float:
    """The evidence from which what takes away such a share of the loss is more than a little of everything."""
    if gain < FEW:
        return 1.5 * ENOUGH
    return ENOUGH if gain < MUCH else 0.5 * ENOUGH


def enough(one: Tried) -> bool:
    """Whether what a candidate explains is worth naming, sure, and more than a little or beyond doubt."""
    rare, times = RARE
    more = one.counted >= asked(one.gain) and one.sureness >= SURE
    more |= one.counted >= times * asked(one.gain) and one.sureness >= rare
    least = BEYOND_DOUBT if one.counted >= SOME else ANYHOW
    return one.gain >= LEAST_GAIN and (more or (one.counted > 0.0 and one.sureness >= least))


def asked_alone(one: Tried) -> float:
    """The evidence from which a candidate is named where nothing else was found before it."""
    return asked(one.gain) * (RESISTS if _like_soil(one) else 1.0)


def may_be_soil(one: Tried) -> bool:
    """Whether soil that nobody recorded, as every field has, may pass for what a candidate explains."""
    if one.gain >= FEW or one.sureness >= ANYHOW:
        return False
    carried, share = CARRIED
    if one.name == carried:
        return one.counted < share * asked(one.gain)
    return one.name in RESISTANCE and one.counted < asked_alone(one)


def soil_short(one: Tried) -> float:
    """How far a friction beside other effects is from being beyond doubt (0..1): soil comes and goes."""
    asked_for = one.name in RESISTANCE and one.gain < MUCH
    return max(1.0 - max(one.sureness, 0.0) / BEYOND_DOUBT, 0.0) if asked_for else 0.0


def _like_soil(one: Tried) -> bool:
    return one.name in RESISTANCE and one.gain < FEW


def share_of_all(one: Tried, step: Step) -> float:
    """What a candidate takes away, of what all effects together do."""
    explained = step.before.loss - step.background.noise
    return (step.before.loss - one.judged.loss) / explained if explained > 0.0 else 0.0


def whole(one: Tried, step: Step) -> bool:
    """Whether nearly all that could be explained is what a candidate explains alone, though evidence may be little."""
    gain, sure = WHOLE
    much = one.gain >= gain and one.sureness >= sure and one.counted >= SOME
    return much and share_of_all(one, step) >= ALL_OF_IT


def close(first: Tried, one: Tried) -> bool:
    """Whether the evidence of the first, which has most, is too little more than another's to decide."""
    return one.counted >= first.counted - max(ALIKE, CLOSE * first.counted)


def ahead(mine: Tried, other: Tried) -> float:
    """Evidence for one above that for another, both as they count; where it is close, the loss may say more."""
    more = mine.counted - other.counted
    if not close(max(mine, other, key=counted), min(mine, other, key=counted)):
        return more
    return max(more, ALIKE * math.log(max(other.compared.loss / mine.compared.loss, LEAST_LEFT)) / math.log(LOOSE))
