"""Which effect is missing: nothing, one or more of the table, something unlisted, or two that look alike.

Every candidate is fitted jointly with the core and judged on held-out blocks, at least 3 s ahead. What counts is how
far the error falls, against every other candidate, the curves without physics among them. Consequences of the drive
(engine load, line pressure) must explain more than a cause does to be believed. In the end a catch-all tells "nothing"
from "unlisted": much of an error that the recorded signals foretell, and all known effects don't, has a cause; so has
an error far above the noise that nothing foretells, or one that swings at a pace of its own. A dead time that changes
has its name, too, though no constant delay is a model of it.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Final

import numpy as np

from cruise.effects import EFFECTS
from cruise.validation.candidates import MEDIATORS, UNNAMED, Refused
from cruise.validation.confidence import (
    MOST_THERE,
    answer_of,
    confidence_of,
    excess,
    in_moments,
    margin_of_the_end,
    untold,
)
from cruise.validation.dead_time import DeadTime, dead_time
from cruise.validation.exchange import exchanged
from cruise.validation.foretold import Foretold, foretold
from cruise.validation.search import Judged
from cruise.validation.selection import Selected, selected
from cruise.validation.study import Study
from cruise.validation.swing import Swing, swing
from cruise.validation.tried import ALIKE, ENOUGH, Step
from cruise.validation.trying import Show

SEED: Final = 20051  # of the bootstrap
RECORD_MORE: Final = (
    "record what else could move the machine, such as slope, load, wind or soil, and drive the same again"
)
AGAIN: Final = (
    "drive the moments again in which the error stands (`cruise compare` marks them), longer and more often, and "
    "record what else could act there"
)
SWINGS: Final = "look for what turns or swings once in {period_s:.1f} s, on the machine or behind it, and record that"
DELAY: Final = "transport_delay"
LATE: Final = (
    "record when every command is sent and when the current follows it, and what could keep it or the valve waiting, "
    "such as the load of the bus"
)
TWO: Final = 2  # effects between which an ambiguous verdict asks for an experiment, though more may look alike
FARTHEST: Final = -50.0  # exponent of the share of doubt that falls on a candidate


class Verdict(StrEnum):
    """What the recordings say."""

    MISSING = "missing"
    NOTHING = "nothing"
    UNLISTED = "unlisted"
    AMBIGUOUS = "ambiguous"


@dataclass(frozen=True)
class Ranked:
    """An effect's line in the ranking: held-out RMS, at least `horizon_s` ahead, without and with it."""

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
    hidden: Foretold  # what the catch-all still finds beside them
    swing_s: float  # period of what swings where nothing else is found; or NaN
    dead_time: DeadTime | None  # how it changes, beside what else is found
    beside: str  # signal on which much of what the effects leave depends, in a way that none describes; or empty
    refused: tuple[Refused, ...]
    study: Study

    @property
    def worth_adding(self) -> tuple[str, ...]:
        """The effects with which the model errs less: all but a dead time that changes, which no constant delay is."""
        return tuple(name for name in self.effects if self.dead_time is None or name != DELAY)

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
        silent = excess(self.hidden, self.base, self.final) <= 1.0
        return self.verdict is Verdict.UNLISTED and not self.explained and silent

    @property
    def momentary(self) -> bool:
        """Whether nothing recorded shows what is missing, and it acts in few moments only."""
        there = in_moments(self.final.fit.error_mps, self.study.period_s)
        return self.untold and not self.steps[0].taken and there > MOST_THERE and math.isnan(self.swing_s)


def diagnose(study: Study, show: Show = lambda text: None) -> Diagnosis:
    """Search, decide, and rank."""
    rng = np.random.default_rng(SEED)
    found = selected(study, rng, show)
    base, final = found.steps[0].before, found.final
    named = () if found.curved else found.chosen
    show("what the recorded signals still foretell")
    hidden = _hidden(study, found)
    over = excess(hidden, base, final)
    silent = not (found.curved or found.unrecorded or over > 1.0)
    late = _late(study, found) if silent else None
    heard = silent and late is None
    error_mps, current_ma = final.fit.error_mps, study.search.scene.current_ma
    swings = swing(error_mps, current_ma, study.period_s) if heard and not named else Swing()
    alone = max(untold(found, hidden.drift, study.period_s), swings.much) if heard else 0.0
    unlisted = found.curved or found.unrecorded or max(over, alone) > 1.0
    places = () if unlisted else tuple(exchanged(study, name, found, rng, show) for name in named)
    alike = tuple((one.name, *one.alike) for one in places if one.alike)
    if max(over, alone) > 1.0:
        margin = ENOUGH * (max(over, alone) - 1.0)
    else:
        margin = min([*(one.margin for one in places), margin_of_the_end(found)])
        margin = margin if found.curved else min(margin, ENOUGH * (1.0 - max(over, alone)))
    if late is not None:
        margin = min(ENOUGH * (1.0 - 1.0 / late.much), margin if named else math.inf)
    verdict, effects, signals, words = Verdict.MISSING, named, (), ""
    if unlisted:
        verdict, effects = Verdict.UNLISTED, ()
        if found.unrecorded:
            signals = EFFECTS[found.steps[0].unrecorded].needs
            words = _record(signals)
        elif found.curved:
            signals = (found.chosen[0].removeprefix(UNNAMED),)
            words = _vary(signals)
        else:
            signals, final = () if alone > 1.0 else hidden.signals, base
            words = _vary(signals) if signals else RECORD_MORE
            words = SWINGS.format(period_s=swings.period_s) if swings.much > 1.0 else words
    elif late is not None:
        effects, words = (*named, DELAY), LATE
    elif not named:
        verdict = Verdict.NOTHING
    elif len(named) == 1 and alike:
        verdict, effects, final = Verdict.AMBIGUOUS, *_likeliest(alike[0], found)
        words = " ".join(f"{name}: {EFFECTS[name].about.experiment}." for name in effects)
    else:
        words = EFFECTS[named[0]].about.experiment
    confidence = confidence_of(margin, answer_of(verdict, effects))
    said = Diagnosis(
        verdict=verdict,
        effects=effects,
        signals=signals,
        ranking=_ranking(base, found.steps[0], effects if late else named, confidence),
        look_alikes=alike,
        next_experiment=words,
        confidence=confidence,
        margin=margin,
        steps=found.steps,
        base=base,
        final=final,
        hidden=hidden,
        swing_s=swings.period_s if swings.much > 1.0 else math.nan,
        dead_time=late,
        beside=found.beside if effects else "",
        refused=found.refused,
        study=study,
    )
    return replace(said, next_experiment=AGAIN) if said.momentary else said


def _late(study: Study, found: Selected) -> DeadTime | None:
    """How the dead time changes beside what was found, if it does and the model's own delay is a constant."""
    scene, error_mps = study.search.scene, found.final.fit.error_mps
    late = dead_time(error_mps, scene.speed_mps - error_mps, scene.parts, study.period_s)
    return late if late.much > 1.0 and DELAY not in found.final.explanation.structural else None


def _likeliest(alike: Sequence[str], found: Selected) -> tuple[tuple[str, ...], Judged]:
    """The two of those that look alike for which there is most evidence, and the model with the one that errs less."""
    tried = {one.name: one for one in found.steps[0].tried}
    two = sorted(alike, key=lambda name: tried[name].counted, reverse=True)[:TWO]
    two.sort(key=lambda name: tried[name].compared.loss)
    return tuple(two), found.final if alike[0] in two else tried[two[0]].judged


def _hidden(study: Study, found: Selected) -> Foretold:
    """What the catch-all finds beside the final model; nothing where no step looked beside it."""
    last, final = found.steps[-1], found.final
    if last.before is not final:  # an unnamed curve, or as many effects as are looked for
        return Foretold(0.0, 0.0, ())
    known = [one for one in last.tried if not one.name.startswith(UNNAMED) and one.name not in MEDIATORS]
    return foretold(study.search.scene, final.fit, [one.judged.fit for one in known], study.search.blocks)


def _ranking(base: Judged, first: Step, chosen: Sequence[str], confidence: float) -> tuple[Ranked, ...]:
    before = math.sqrt(base.loss)
    named = [one for one in first.tried if not one.name.startswith(UNNAMED)]
    most = max((one.counted for one in named), default=0.0)
    weights = {one.name: math.exp(max((one.counted - most) / ALIKE, FARTHEST)) for one in named}
    total = sum(weights.values())
    lines = []
    for one in named:
        mine = confidence if one.name in chosen else (1.0 - confidence) * weights[one.name] / total
        lines.append(Ranked(one.name, before, math.sqrt(one.judged.loss), mine))
    return tuple(lines)


def _vary(signals: Sequence[str]) -> str:
    return f"hold everything else and move {' and '.join(signals)} alone, slowly and in steps, over the whole range"


def _record(signals: Sequence[str]) -> str:
    return f"record what else pushes or holds the machine while {' and '.join(signals)} moves, such as wind or soil"
