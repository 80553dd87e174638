"""Which effect is missing: nothing, one or more of the table, something unlisted, or two that look alike.

Every candidate is fitted jointly with the core and judged on held-out blocks, at least 3 s ahead. What counts is how
far the error falls, against every other candidate, the curves without physics among them. Consequences of the drive
(engine load, line pressure) must explain more than a cause does to be believed.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

import numpy as np

from cruise.effects import EFFECTS
from cruise.validation.candidates import FLEXIBLE, Candidate, Refused, candidates, unnamed, without
from cruise.validation.search import Judged, gain, sureness
from cruise.validation.study import Study

SEED: Final = 20051  # of the bootstrap
LEAST_GAIN: Final = 0.15  # of the present loss: errors that fall by less than 8 % are a little of everything
LEAST_SHARE: Final = 0.01  # of the first loss, for every further effect
LEAST_FURTHER: Final = 0.25  # of the present loss, for every further effect: the form of the first is never exact
SURE: Final = 1.6  # standard errors of a held-out gain that is large already; a few blocks may hold all of it
DOUBTED: Final = 1.4  # times LEAST_GAIN, which a consequence of the drive must bring after what is taken off its gain
KEEP: Final = 0.5  # of LEAST_GAIN: what an effect must still bring beside the others
MOST_EFFECTS: Final = 4
ALIKE: Final = 0.03  # log of the ratio of two losses below which no form of a model is exact enough to decide
HALF_MARGIN: Final = 0.06  # margin taken to be as often right as wrong: by eye, not yet by tools/blind_trial calibrate
STEEPNESS: Final = 1.3  # likewise
LEAST_MARGIN: Final = 0.006  # where another does better in its place: seldom right, and not never
SILENCE: Final = 6.0  # weight of the distance to LEAST_GAIN, which is short, beside the margins between effects
FINISHED: Final = 10  # candidates whose fits are carried to their end; the others are far off after a few steps
RESTARTED: Final = 3  # of them, that are fitted once more from another core
EACH: Final = 0.93  # of what several effects explain together that counts, for each after the first
RIVALS: Final = 6  # alternatives for which an effect is exchanged once all are together
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
    counted: float  # of it, what counts against other candidates
    sureness: float  # standard errors of the log ratio of the losses
    judged: Judged


@dataclass(frozen=True, eq=False)
class Step:
    """One step of the search: what was there, and everything that was tried beside it, best first."""

    before: Judged
    tried: tuple[Tried, ...]


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
    refused: tuple[Refused, ...]
    study: Study


Show = Callable[[str], None]


def diagnose(study: Study, show: Show = lambda text: None) -> Diagnosis:
    """Search, decide, and rank."""
    rng = np.random.default_rng(SEED)
    base, steps, chosen, final, refused = _forward(study, rng, show)
    named = tuple(name for name in chosen if not name.startswith(UNNAMED))
    unlisted = bool(chosen) and chosen[0].startswith(UNNAMED)
    places = () if unlisted else tuple(_place(study, name, steps, chosen, final, rng, show) for name in named)
    alike = tuple((one.name, *one.alike) for one in places if one.alike)
    margin = min((one.margin for one in places), default=_margin_of_silence(steps[0], unlisted))
    confidence = confidence_of(margin)
    ranking = _ranking(base, steps[0], named, confidence)
    verdict, effects, signals, words = Verdict.MISSING, named, (), ""
    if not chosen:
        verdict = Verdict.NOTHING
    elif unlisted:
        verdict, effects = Verdict.UNLISTED, ()
        signals = tuple(name.removeprefix(UNNAMED) for name in chosen if name.startswith(UNNAMED))
        words = _vary(signals)
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
        refused=tuple(refused),
        study=study,
    )


def confidence_of(margin: float) -> float:
    """Confidence of a margin m, 1 / (1 + (M / m)^k); M and k are set by eye until blind trials have fitted them."""
    return 1.0 / (1.0 + (HALF_MARGIN / max(margin, LEAST_MARGIN)) ** STEEPNESS)


def _forward(
    study: Study, rng: np.random.Generator, show: Show
) -> tuple[Judged, tuple[Step, ...], list[str], Judged, list[Refused]]:
    """Add the best effect while it brings enough; after each, drop what it makes superfluous.

    A curve without physics that did better than the best effect is kept in mind: it has the word in the end, unless
    the effects together explain as much as it counts.
    """
    search, base = study.search, study.base
    present, steps, chosen = base, [], []
    refused: list[Refused] = []
    credit: dict[str, float] = {}
    curve: Tried | None = None
    while len(chosen) < MOST_EFFECTS:
        possible, cannot = candidates(study.recordings, present.explanation)
        refused = refused or cannot
        curves = unnamed(study.recordings, present.explanation) if not steps else []
        everyone: list[Candidate] = [*possible, *curves]
        fits = []
        for candidate in everyone:
            show(f"trying {_in_words(candidate.name)}" + (f" beside {', '.join(chosen)}" if chosen else ""))
            fits.append(search.begun(present.explanation, candidate))
        for i in np.argsort([one.cost for one in fits])[:FINISHED].tolist():
            show(f"finishing {_in_words(everyone[i].name)}")
            fits[i] = search.finished(fits[i])
        for i in np.argsort([one.cost for one in fits])[:RESTARTED].tolist():
            other = search.grown_anew(present.explanation, everyone[i])
            fits[i] = min(fits[i], other, key=lambda one: one.cost)
        if not steps:
            search.learn_disturbance(present.fit, fits)
            base = present = search.judged("", present.fit)
        tried = []
        for candidate, one in zip(everyone, fits, strict=True):
            judged = search.judged(candidate.name, one)
            mine = gain(present, judged)
            tried.append(Tried(candidate.name, mine, mine * candidate.credit, sureness(present, judged, rng), judged))
        tried.sort(key=lambda one: -one.counted)
        steps.append(Step(present, tuple(tried)))
        if tried and tried[0].name.startswith(UNNAMED) and _enough(tried[0]):
            curve = tried[0]
        best = next((one for one in tried if not one.name.startswith(UNNAMED)), None)
        if best is None or not _enough(best):
            break
        small = best.gain < LEAST_FURTHER or present.loss - best.judged.loss < LEAST_SHARE * base.loss
        if chosen and small:
            break
        chosen.append(best.name)
        credit[best.name] = next(one.credit for one in everyone if one.name == best.name)
        present = best.judged
        for name in [name for name in chosen[:-1] if credit[name] <= credit[best.name]]:
            # A consequence never drops a cause.
            other = search.judged("", search.fitted(without(present.explanation, name)))
            if gain(other, present) < KEEP * LEAST_GAIN:
                chosen.remove(name)
                present = other
    if curve is not None:
        together = gain(base, present) * math.prod((credit[name] for name in chosen), start=1.0)
        if not chosen or together * EACH ** (len(chosen) - 1) < curve.counted:
            return base, tuple(steps), [curve.name], curve.judged, refused
    return base, tuple(steps), chosen, present, refused


def _enough(one: Tried) -> bool:
    """Whether what a candidate explains is worth naming, and sure."""
    doubted = one.gain > 0.0 and one.counted < FLEXIBLE * one.gain
    bar = DOUBTED * LEAST_GAIN if doubted else FLEXIBLE * LEAST_GAIN
    return one.gain >= LEAST_GAIN and one.counted >= bar and one.sureness >= SURE


@dataclass(frozen=True)
class Place:
    """A chosen effect against all others in its place."""

    name: str
    margin: float  # log of the loss of the best other over its own, both as they count
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
        mine, others = steps[0].tried[0], steps[0].tried[1:]
    else:
        search = study.search
        rest = without(final.explanation, name)
        before = search.judged("", search.fitted(rest))
        step = next(one for one in steps if any(tried.name == name for tried in one.tried))
        best = [one.name for one in step.tried if one.name not in chosen][:RIVALS]
        possible, _ = candidates(study.recordings, rest)
        everyone: list[Candidate] = [*possible, *unnamed(study.recordings, rest)]
        trials = []
        for candidate in everyone:
            if candidate.name != name and candidate.name not in best:
                continue
            if candidate.name != name:
                show(f"trying {_in_words(candidate.name)} in place of {name}")
            judged = final if candidate.name == name else search.judged(candidate.name, search.grown(rest, candidate))
            part = gain(before, judged)
            trials.append(Tried(candidate.name, part, part * candidate.credit, sureness(before, judged, rng), judged))
        mine = next(one for one in trials if one.name == name)
        others = tuple(sorted((one for one in trials if one is not mine), key=lambda one: -one.counted))
    margins = {one.name: math.log((1.0 - one.counted) / (1.0 - mine.counted)) for one in others}
    alike = tuple(
        one.name
        for one in others
        if not one.name.startswith(UNNAMED) and one.gain >= LEAST_GAIN and margins[one.name] < ALIKE
    )
    return Place(name, min(margins.values(), default=1.0), alike)


def _margin_of_silence(first: Step, unlisted: bool) -> float:
    """The margin of a verdict that names no effect: to the threshold, or to the best effect."""
    if unlisted:
        mine = first.tried[0]
        best = max((one.counted for one in first.tried if not one.name.startswith(UNNAMED)), default=0.0)
        return math.log((1.0 - best) / (1.0 - mine.counted))
    room = math.log((1.0 - first.tried[0].gain) / (1.0 - LEAST_GAIN)) if first.tried else 1.0
    return max(SILENCE * room, HALF_MARGIN)  # a gain that is large and not sure: as likely as not


def _ranking(base: Judged, first: Step, chosen: Sequence[str], confidence: float) -> tuple[Ranked, ...]:
    before = math.sqrt(base.loss)
    named = [one for one in first.tried if not one.name.startswith(UNNAMED)]
    weights = {one.name: math.exp(min(one.counted, 1.0) / ALIKE) for one in named}
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
