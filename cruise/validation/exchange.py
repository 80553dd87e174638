"""Each chosen effect is exchanged for every other one: those that do as well can't be told apart on the recordings."""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from cruise.effects import EFFECTS
from cruise.validation.candidates import MEDIATORS, UNNAMED, candidates, without
from cruise.validation.judged import sureness
from cruise.validation.laws import ruled_out
from cruise.validation.selection import Selected
from cruise.validation.study import Study
from cruise.validation.tried import (
    ALIKE,
    APART,
    ENOUGH,
    LEAST_GAIN,
    LOOSE,
    Tried,
    ahead,
    asked,
    counted,
    step_of,
)
from cruise.validation.trying import Show, tried_beside

TWIN: Final = 1.05  # of the loss: a look-alike that errs no more can't be told apart,
LIKELY: Final = 0.6  # if there is so much of the evidence for it
RIVALS: Final = 6  # alternatives for which an effect is exchanged once all are together


@dataclass(frozen=True)
class Place:
    """A chosen effect against all others in its place."""

    name: str
    margin: float  # evidence for it above that for the best other, both as they count
    alike: tuple[str, ...]  # effects that do as well


def exchanged(study: Study, name: str, found: Selected, rng: np.random.Generator, show: Show) -> Place:
    """The effect against the best of the others, the rest of the model as it is in the end.

    The one that came last was tried beside that rest already, with all others in its place.
    """
    rest = without(found.final.explanation, name)
    step = step_of(found.steps, name)
    if len(found.chosen) == 1:
        tried = found.steps[0].tried
    elif study.search.plan(rest).slots == study.search.plan(step.before.explanation).slots:
        tried = step.tried
    else:
        before = study.search.judged("", study.search.fitted(rest))
        best = [one.name for one in step.tried if one.name not in found.chosen and not one.name.startswith(UNNAMED)][
            :RIVALS
        ]
        possible, _ = candidates(study.recordings, rest)
        rivals = [one for one in possible if one.name in (name, *best, *MEDIATORS)]
        tried = tried_beside(study, before, rivals, [one for one in found.chosen if one != name], rng, show).tried
    chosen = next(one for one in tried if one.name == name)
    mine = replace(chosen, credit=1.0) if name in MEDIATORS else chosen  # what stands behind it has been weighed
    others = [
        one
        for one in tried
        if one is not chosen and not one.name.startswith(UNNAMED) and not ruled_out(one.name, name, tried)
    ]
    alike = tuple(
        one.name
        for one in others
        if one.gain >= LEAST_GAIN
        and one.counted > max(mine.counted - ALIKE, asked(one.gain))
        and one.compared.loss < LOOSE * mine.compared.loss
        and sureness(one.compared, mine.compared, rng) < APART
    )
    rivals = [one for one in others if one.gain >= LEAST_GAIN]
    twins = [one for one in rivals if _twins(mine, one) and sureness(one.compared, mine.compared, rng) < APART]
    twin = max(twins, key=counted, default=None)
    if twin is not None:  # physics says more than a little evidence
        alike = (twin.name,)
    return Place(name, min((ahead(mine, one) for one in rivals), default=ENOUGH), alike)


def _twins(mine: Tried, other: Tried) -> bool:
    """Whether physics calls the other a look-alike, it errs no more, and evidence for it is not far less."""
    known = other.name in EFFECTS[mine.name].about.look_alikes or mine.name in EFFECTS[other.name].about.look_alikes
    return (
        known
        and other.compared.loss < TWIN * mine.compared.loss
        and other.counted > LIKELY * max(mine.counted, asked(mine.gain))
    )
