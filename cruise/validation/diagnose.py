"""Which effect is missing: nothing, one or more of the table, something unlisted, or two that look alike.

Every candidate is fitted jointly with the core and judged on held-out blocks, at least 3 s ahead. What counts is how
far the error falls, against every other candidate, the curves without physics among them. Consequences of the drive
(engine load, line pressure) must explain more than a cause does to be believed. In the end a catch-all tells "nothing"
from "unlisted": much of an error that the recorded signals foretell, and all known effects don't, has a cause.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

import numpy as np

from cruise.effects import EFFECTS
from cruise.validation.background import Background
from cruise.validation.candidates import MEDIATORS, Candidate, Refused, candidates, unnamed, without
from cruise.validation.foretold import CHANCE, Foretold, foretold
from cruise.validation.search import Judged, gain, sureness
from cruise.validation.slip import slip_mps
from cruise.validation.study import Study

SEED: Final = 20051  # of the bootstrap
ENOUGH: Final = 60.0  # evidence from which an effect is more than a little of everything,
FURTHER: Final = 75.0  # and a further one, as no form of the first is exact
LEAST_GAIN: Final = 0.15  # of the present loss: errors that fall by less than 8 % are not worth a name
LEAST_LEFT: Final = 1e-9  # of the loss: what is left of it where there is no noise at all
LEAST_SHARE: Final = 0.01  # of the first loss, for every further effect
LEAST_FURTHER: Final = 0.25  # of the present loss, for every further effect: the form of the first is never exact
SURE: Final = 1.6  # standard errors of a held-out gain; a few blocks may hold all of it
BEYOND_DOUBT: Final = 6.0  # standard errors that a background, which has its moments, does not reach
LEAST_CURVED: Final = 0.45  # of the loss, that a free curve must explain to have the word
CURVED: Final = (60.0, 0.05)  # evidence, and share of it, by which a free curve must exceed all effects
MEDIATED: Final = 0.3  # of what the best cause leaves: all that a signal may leave through which every force acts
LEAST_FORETOLD: Final = 0.1  # of the first loss, that the catch-all must foretell for something to be missing,
LEAST_BESIDE: Final = 0.5  # and of what the named effects explain, for them to be no more than substitutes
PLAIN: Final = 0.5  # of what the best cause leaves: with less, a consequence of the drive is a cause all the same
SUPERFLUOUS: Final = 0.5  # of ENOUGH: what an effect must still bring beside the others
MOST_EFFECTS: Final = 4
MOST_STEPS: Final = 8  # two effects that drop each other would go on for ever
ALIKE: Final = 20.0  # evidence below which no form of a model is exact enough to decide,
CLOSE: Final = 0.05  # likewise, of the evidence,
LOOSE: Final = 1.2  # unless the loss decides
HALF_MARGIN: Final = 2.0  # margin as often right as wrong: tools/blind_trial calibrate, 145 drives of both tiers
STEEPNESS: Final = 0.44  # likewise
LEAST_MARGIN: Final = 1.0  # where another does better in its place: seldom right, and not never
FINISHED: Final = 10  # candidates whose fits are carried to their end; the others are far off after a few steps
RESTARTED: Final = 3  # of them, that are fitted once more from another core
RIVALS: Final = 6  # alternatives for which an effect is exchanged once all are together
FARTHEST: Final = -50.0  # exponent of the share of doubt that falls on a candidate
UNNAMED: Final = "unnamed:"


class Verdict(StrEnum):
    """What the recordings say."""

    MISSING = "missing"
    NOTHING = "nothing"
    UNLISTED = "unlisted"
    AMBIGUOUS = "ambiguous"


@dataclass(frozen=True, eq=False)
class Tried:
    """One candidate beside what was there before it."""

    name: str
    gain: float  # G: share of the loss that it takes away
    evidence: float  # for it, beside a little of everything, and from the held-out errors as they are
    credit: float  # share of that which counts against other candidates
    sureness: float  # standard errors of the log ratio of the losses
    judged: Judged

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
    refused: tuple[Refused, ...]
    study: Study

    @property
    def explained(self) -> bool:
        """Whether the verdict comes with a model that errs less: with effects, or with a curve of a signal."""
        return bool(self.effects) or self.final is not self.base


Show = Callable[[str], None]


def diagnose(study: Study, show: Show = lambda text: None) -> Diagnosis:
    """Search, decide, and rank."""
    rng = np.random.default_rng(SEED)
    steps, chosen, final, refused = _forward(study, rng, show)
    base = steps[0].before
    named = tuple(name for name in chosen if not name.startswith(UNNAMED))
    show("what the recorded signals still foretell")
    hidden = _hidden(study, steps[-1], final)
    curved = bool(chosen) and chosen[0].startswith(UNNAMED)
    excess = _excess(hidden, base, final)
    unlisted = curved or excess > 1.0
    places = () if unlisted else tuple(_place(study, name, steps, chosen, final, rng, show) for name in named)
    alike = tuple((one.name, *one.alike) for one in places if one.alike)
    if excess > 1.0:
        margin = ENOUGH * (excess - 1.0)
    else:
        margin = min([*(one.margin for one in places), _margin_of_the_end(steps, chosen)])
        margin = margin if curved else min(margin, ENOUGH * (1.0 - excess))
    confidence = confidence_of(margin)
    ranking = _ranking(base, steps[0], named, confidence)
    verdict, effects, signals, words = Verdict.MISSING, named, (), ""
    if unlisted:
        verdict, effects = Verdict.UNLISTED, ()
        signals, final = ((chosen[0].removeprefix(UNNAMED),), final) if curved else (hidden.signals, base)
        words = _vary(signals)
    elif not chosen:
        verdict = Verdict.NOTHING
    elif len(named) == 1 and alike:
        verdict, effects = Verdict.AMBIGUOUS, alike[0]
        words = " ".join(f"{name}: {EFFECTS[name].about.experiment}." for name in effects)
    else:
        words = EFFECTS[named[0]].about.experiment
    return Diagnosis(
        verdict=verdict,
        effects=effects,
        signals=signals,
        ranking=ranking,
        look_alikes=alike,
        next_experiment=words,
        confidence=confidence,
        margin=margin,
        steps=steps,
        base=base,
        final=final,
        hidden=hidden,
        refused=tuple(refused),
        study=study,
    )


def _hidden(study: Study, last: Step, final: Judged) -> Foretold:
    """What the catch-all finds beside the final model; nothing where no step looked beside it."""
    if last.before is not final:  # an unnamed curve, or as many effects as are looked for
        return Foretold(0.0, 0.0, ())
    known = [one for one in last.tried if not one.name.startswith(UNNAMED) and one.name not in MEDIATORS]
    return foretold(study.search.scene, final.fit, [one.judged.fit for one in known], study.search.blocks)


def _excess(hidden: Foretold, base: Judged, final: Judged) -> float:
    """What the catch-all foretells, over what it has to for something unlisted to be missing."""
    least = max(LEAST_FORETOLD * base.loss, LEAST_BESIDE * (base.loss - final.loss))
    return min(hidden.share / CHANCE, hidden.loss / least)


def confidence_of(margin: float) -> float:
    """Confidence of a margin m, 1 / (1 + (M / m)^k); M and k as blind trials have it."""
    return 1.0 / (1.0 + (HALF_MARGIN / max(margin, LEAST_MARGIN)) ** STEEPNESS)


def _forward(
    study: Study, rng: np.random.Generator, show: Show
) -> tuple[tuple[Step, ...], list[str], Judged, list[Refused]]:
    """Add the best effect while it brings enough; after each, drop what it makes superfluous.

    A curve without physics for which there is much more evidence than for all effects together has the word in the end.
    """
    search, present = study.search, study.base
    steps: list[Step] = []
    chosen: list[str] = []
    refused: list[Refused] = []
    while len(chosen) < MOST_EFFECTS and len(steps) < MOST_STEPS:
        possible, cannot = candidates(study.recordings, present.explanation)
        refused = refused or cannot
        curves = unnamed(study.recordings, present.explanation) if not steps else []
        step = _tried(study, present, [*possible, *curves], chosen, rng, show)
        present = step.before
        steps.append(step)
        enough = [one for one in step.tried if not one.name.startswith(UNNAMED) and _enough(one)]
        if not enough:
            break
        best = min((one for one in enough if _close(enough[0], one)), key=lambda one: one.judged.loss)
        small = (
            best.counted < FURTHER
            or best.gain < LEAST_FURTHER
            or present.loss - best.judged.loss < LEAST_SHARE * steps[0].before.loss
        )
        if chosen and small:
            break
        chosen.append(best.name)
        present = best.judged
        for name in chosen[:-1]:
            other = search.judged("", search.fitted(without(present.explanation, name)))
            held = [one for one in chosen if one != name]
            if _together(steps[0], present, chosen) - _together(steps[0], other, held) < SUPERFLUOUS * ENOUGH:
                chosen.remove(name)
                present = other
    curve = max((one for one in steps[0].tried if one.name.startswith(UNNAMED)), key=_counted, default=None)
    if curve is not None and curve.gain >= LEAST_CURVED and _enough(curve):
        named = [one.counted for one in steps[0].tried if not one.name.startswith(UNNAMED)]
        together = _together(steps[0], present, chosen) if chosen else 0.0
        if max(together, *named) < curve.counted - _curved(curve):
            return tuple(steps), [curve.name], curve.judged, refused
    return tuple(steps), chosen, present, refused


def _tried(
    study: Study,
    present: Judged,
    everyone: Sequence[Candidate],
    chosen: Sequence[str],
    rng: np.random.Generator,
    show: Show,
) -> Step:
    """Every candidate beside what is there, best first. What is there may be fitted better on the way."""
    search, fits = study.search, []
    for candidate in everyone:
        show(f"trying {_in_words(candidate.name)}" + (f" beside {', '.join(chosen)}" if chosen else ""))
        fits.append(search.begun(present.explanation, candidate))
    for i in np.argsort([one.cost for one in fits])[:FINISHED].tolist():
        show(f"finishing {_in_words(everyone[i].name)}")
        fits[i] = search.finished(fits[i])
    for i in np.argsort([one.cost for one in fits])[:RESTARTED].tolist():
        other = search.grown_anew(present.explanation, everyone[i])
        fits[i] = min(fits[i], other, key=lambda one: one.cost)
    before = present.fit
    if fits:  # the best fit's core may be a better start for what is there, too
        best = min(range(len(fits)), key=lambda i: fits[i].cost)
        again = search.fitted(without(fits[best].explanation, everyone[best].name))
        before = min(before, again, key=lambda one: one.cost)
    if not chosen:
        search.learn_disturbance(before, fits)
    if not chosen or before is not present.fit:
        present = search.judged("", before)
    judged = [search.judged(candidate.name, one) for candidate, one in zip(everyone, fits, strict=True)]
    named = [one.name for one in everyone if not one.name.startswith(UNNAMED)]
    background = Background(
        before,
        {candidate.name: one for candidate, one in zip(everyone, fits, strict=True)},
        search.disturbance,
        [name for name in named if name not in MEDIATORS],
        (slip_mps(study.recordings), frozenset({"wheel_slip", "sensor_bias"})),
    )
    credit = {one.name: one.credit for one in everyone}
    others = [one for one in judged if one.candidate not in MEDIATORS]
    causes = [one.loss for one in others if credit[one.candidate] == 1.0]
    for one in judged:
        if one.candidate in MEDIATORS:
            direct = [other.loss for other in others if other.candidate in named or credit[other.candidate] == 1.0]
            if one.loss > MEDIATED * min([present.loss, *direct]):
                credit[one.candidate] = 0.0
        elif one.candidate in named and one.loss < PLAIN * min([present.loss, *causes]):
            credit[one.candidate] = 1.0
    background.settle({name: credit[name] for name in named})
    tried = []
    for one in judged:
        evidence = background.evidence(one.candidate) + _held_out(present, one)
        sure = sureness(present, one, rng)
        tried.append(Tried(one.candidate, gain(present, one), evidence, credit[one.candidate], sure, one))
    return Step(present, tuple(sorted(tried, key=_counted, reverse=True)), background)


def _held_out(without_it: Judged, one: Judged) -> float:
    """Evidence in the held-out errors as they are: a block of time counts as one independent error."""
    return -int(np.count_nonzero(without_it.weight)) * math.log(max(1.0 - gain(without_it, one), LEAST_LEFT))


def _together(first: Step, one: Judged, names: Sequence[str]) -> float:
    """Evidence for several effects at once, against the model as it was first."""
    return first.background.evidence_of(one.fit, names) + _held_out(first.before, one)


def _counted(one: Tried) -> float:
    return one.counted


def _curved(one: Tried) -> float:
    return CURVED[0] + CURVED[1] * one.counted


def _enough(one: Tried) -> bool:
    """Whether what a candidate explains is worth naming, sure, and more than a little or beyond doubt."""
    more = one.counted >= ENOUGH and one.sureness >= SURE
    return one.gain >= LEAST_GAIN and (more or (one.counted > 0.0 and one.sureness >= BEYOND_DOUBT))


def _close(first: Tried, one: Tried) -> bool:
    """Whether the evidence of the first, which has most, is too little more than another's to decide."""
    return one.counted >= first.counted - max(ALIKE, CLOSE * first.counted)


def _ahead(mine: Tried, other: Tried) -> float:
    """Evidence for one above that for another, both as they count; where it is close, the loss may say more."""
    counted = mine.counted - other.counted
    if not _close(max(mine, other, key=_counted), min(mine, other, key=_counted)):
        return counted
    return max(counted, ALIKE * math.log(max(other.judged.loss / mine.judged.loss, LEAST_LEFT)) / math.log(LOOSE))


@dataclass(frozen=True)
class Place:
    """A chosen effect against all others in its place."""

    name: str
    margin: float  # evidence for it above that for the best other, both as they count
    alike: tuple[str, ...]  # effects that do as well


def _place(
    study: Study,
    name: str,
    steps: Sequence[Step],
    chosen: Sequence[str],
    final: Judged,
    rng: np.random.Generator,
    show: Show,
) -> Place:
    """The effect against the best of the others, the rest of the model as it is in the end."""
    if len(chosen) == 1:
        tried = steps[0].tried
    else:
        rest = without(final.explanation, name)
        before = study.search.judged("", study.search.fitted(rest))
        step = next(one for one in steps if any(tried.name == name for tried in one.tried))
        best = [one.name for one in step.tried if one.name not in chosen and not one.name.startswith(UNNAMED)][:RIVALS]
        possible, _ = candidates(study.recordings, rest)
        rivals = [one for one in possible if one.name in (name, *best)]
        tried = _tried(study, before, rivals, [one for one in chosen if one != name], rng, show).tried
    mine = next(one for one in tried if one.name == name)
    others = [one for one in tried if one is not mine and not one.name.startswith(UNNAMED)]
    alike = tuple(
        one.name
        for one in others
        if one.gain >= LEAST_GAIN
        and one.counted > max(mine.counted - ALIKE, ENOUGH)
        and one.judged.loss < LOOSE * mine.judged.loss
    )
    rivals = [one for one in others if one.gain >= LEAST_GAIN]
    return Place(name, min((_ahead(mine, one) for one in rivals), default=ENOUGH), alike)


def _margin_of_the_end(steps: Sequence[Step], chosen: Sequence[str]) -> float:
    """Evidence by which the search was short of going on or of ending earlier; for a curve, by which it has a say."""
    last = steps[-1].tried
    named = [one.counted for one in steps[0].tried if not one.name.startswith(UNNAMED)]
    if chosen and chosen[0].startswith(UNNAMED):
        mine = next(one for one in steps[0].tried if one.name == chosen[0])
        return mine.counted - _curved(mine) - max(named, default=0.0)
    enough, least = (FURTHER, LEAST_FURTHER) if chosen else (ENOUGH, LEAST_GAIN)
    rest = [one for one in last if one.name not in chosen and not one.name.startswith(UNNAMED)]
    short = [max(enough - one.counted, enough * (1.0 - max(one.gain, 0.0) / least)) for one in rest]
    found = [next(one for step in steps for one in step.tried if one.name == name) for name in chosen]
    over = [one.counted - ENOUGH for one in found if one.sureness < BEYOND_DOUBT]
    return max(min([*short, *over], default=enough), LEAST_MARGIN)


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


def _in_words(name: str) -> str:
    return f"any dependence on {name.removeprefix(UNNAMED)}" if name.startswith(UNNAMED) else name


def _vary(signals: Sequence[str]) -> str:
    return f"hold everything else and move {' and '.join(signals)} alone, slowly and in steps, over the whole range"
