"""Which effect is missing: nothing, one or more of the table, something unlisted, or two that look alike.

Every candidate is fitted jointly with the core and judged on held-out blocks, at least 3 s ahead. What counts is how
far the error falls, against every other candidate, the curves without physics among them. Consequences of the drive
(engine load, line pressure) must explain more than a cause does to be believed. In the end a catch-all tells "nothing"
from "unlisted": much of an error that the recorded signals foretell, and all known effects don't, has a cause; so has
an error far above the noise that nothing foretells, or one that swings at a pace of its own. A dead time that changes
has its name, too, though no constant delay is a model of it.
"""

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from cruise.validation.candidates import UNNAMED, Refused
from cruise.validation.confidence import MOST_THERE, answer_of, confidence_of, in_moments
from cruise.validation.exchange import exchanged
from cruise.validation.judged import Judged
from cruise.validation.left_over import DELAY, LeftOver, left_over
from cruise.validation.selection import selected
from cruise.validation.study import Study
from cruise.validation.tried import ALIKE, Step
from cruise.validation.trying import Show
from cruise.validation.verdict import Answer, Verdict, answered, unlisted

SEED: Final = 20051  # of the bootstrap
AGAIN: Final = (
    "drive the moments again in which the error stands (`cruise compare` marks them), longer and more often, and "
    "record what else could act there"
)
FARTHEST: Final = -50.0  # exponent of the share of doubt that falls on a candidate


@dataclass(frozen=True)
class Ranked:
    """An effect's line in the ranking: held-out RMS, at least `horizon_s` ahead, without and with it.

    The effects of the verdict have its confidence, look-alikes share it, all others share what is left of 1.
    """

    effect: str
    error_before_mps: float
    error_after_mps: float
    confidence: float


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """The verdict with everything that led to it."""

    verdict: Verdict
    effects: tuple[str, ...]
    signals: tuple[str, ...]
    ranking: tuple[Ranked, ...]
    look_alikes: tuple[tuple[str, ...], ...]
    next_experiment: str
    confidence: float
    margin: float  # what the confidence comes from
    steps: tuple[Step, ...]
    base: Judged
    final: Judged  # with the effects that were chosen, an unnamed dependence too
    left: LeftOver  # what stands in the error beside them
    beside: str  # signal on which much of what the effects leave depends, in a way that none describes; or empty
    refused: tuple[Refused, ...]
    study: Study

    @property
    def worth_adding(self) -> tuple[str, ...]:
        """The effects with which the model errs less: all but a dead time that changes, which no constant delay is."""
        return tuple(name for name in self.effects if self.left.dead_time is None or name != DELAY)

    @property
    def explained(self) -> bool:
        """Whether the verdict comes with a model that errs less: with effects, or with a curve of a signal.

        A dead time that changes has a name, and no such model.
        """
        return self.final is not self.base

    @property
    def unrecorded(self) -> bool:
        """Whether it is a force that nobody recorded, which shows in a signal through which every force acts."""
        return bool(self.steps[0].unrecorded) and self.verdict is Verdict.UNLISTED

    @property
    def untold(self) -> bool:
        """Whether nothing recorded shows what is missing: the error is far above the noise, nothing foretells it."""
        return self.verdict is Verdict.UNLISTED and not self.explained and self.left.silent

    @property
    def momentary(self) -> bool:
        """Whether nothing recorded shows what is missing, and it acts in few moments only."""
        there = in_moments(self.final.fit.error_mps, self.study.period_s)
        return self.untold and not self.steps[0].taken and there > MOST_THERE and math.isnan(self.left.swing_s)


def diagnose(study: Study, show: Show = lambda text: None) -> Diagnosis:
    """Search, decide, and rank."""
    rng = np.random.default_rng(SEED)
    found = selected(study, rng, show)
    show("what the recorded signals still foretell")
    left = left_over(study, found)
    named = () if unlisted(found, left) else found.chosen
    places = [exchanged(study, name, found, rng, show) for name in named]
    answer = answered(found, left, places)
    beside = left.missing if answer.verdict is Verdict.MISSING and found.chosen else 0.0
    confidence = confidence_of(answer.margin, answer_of(answer.verdict, answer.effects), beside)
    base, first = found.steps[0].before, found.steps[0]
    said = Diagnosis(
        verdict=answer.verdict,
        effects=answer.effects,
        signals=answer.signals,
        ranking=_ranking(base, first, answer, confidence),
        look_alikes=tuple((one.name, *one.alike) for one in places if one.alike),
        next_experiment=answer.next_experiment,
        confidence=confidence,
        margin=answer.margin,
        steps=found.steps,
        base=base,
        final=answer.final,
        left=left,
        beside=found.beside if answer.effects else "",
        refused=found.refused,
        study=study,
    )
    return replace(said, next_experiment=AGAIN) if said.momentary else said


def _ranking(base: Judged, first: Step, answer: Answer, confidence: float) -> tuple[Ranked, ...]:
    before = math.sqrt(base.loss)
    named = [one for one in first.tried if not one.name.startswith(UNNAMED)]
    most = max((one.counted for one in named), default=0.0)
    weights = {one.name: math.exp(max((one.counted - most) / ALIKE, FARTHEST)) for one in named}
    total = sum(weights.values())
    each = confidence / len(answer.effects) if answer.verdict is Verdict.AMBIGUOUS else confidence
    lines = []
    for one in named:
        mine = each if one.name in answer.effects else (1.0 - confidence) * weights[one.name] / total
        lines.append(Ranked(one.name, before, math.sqrt(one.judged.loss), mine))
    return tuple(lines)
