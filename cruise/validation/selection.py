"""Stepwise selection: the best effect is added while it brings enough; what it makes superfluous is dropped again."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from cruise.effects import EFFECTS, Stage
from cruise.validation.background import DYNAMICS, STRUCTURAL
from cruise.validation.candidates import MEDIATORS, UNNAMED, Refused, candidates, unnamed, without
from cruise.validation.curves import acts_through, curve_with_the_word, effects_are_more, of_the_same
from cruise.validation.judged import Judged, gain, sureness
from cruise.validation.laws import ruled_out
from cruise.validation.mediator import one_for_all
from cruise.validation.search import Search
from cruise.validation.study import Study
from cruise.validation.tried import (
    ALL_OF_IT,
    ANYHOW,
    BEYOND_DOUBT,
    ENOUGH,
    FEW,
    LEAST_GAIN,
    LOOSE,
    NEARLY,
    SOME,
    SURE,
    Step,
    Tried,
    asked,
    asked_alone,
    close,
    counted,
    enough,
    held_out,
    may_be_soil,
    share_of_all,
    soil_short,
    tried_in,
    whole,
)
from cruise.validation.trying import Show, tried_beside

LEAST_IN_ALL: Final = 0.3  # of the loss: what takes no more in all is the little of everything that a machine has
FURTHER: Final = 75.0  # evidence from which a further effect is one, as no form of the first is exact,
LEAST_FURTHER: Final = 0.25  # likewise, of the present loss,
LEAST_SHARE: Final = 0.04  # and of the loss before the effect that was found last, whose form may be as wrong;
LEAST_DYNAMIC: Final = 0.1  # the same share for two that change the dynamics, where no core's form is exact, either,
LEAST_COMMAND: Final = 0.12  # for what acts on the command beside hysteresis, of which no form is exact, either,
LEAST_STRUCTURAL: Final = 0.15  # for one of the core's own structure, where it takes less than most, or is in doubt;
PLAINLY: Final = (12.0, 0.3, 0.1)  # or evidence times gain, where it takes more of both: no wrong form leaves so much
MOST: Final = 0.5  # of the present loss: what takes more, and beyond doubt or nearly all there is, may be any share
MOST_OF_IT: Final = 0.5  # of what effects leave above the noise, that a curve must take to show them as substitutes
SUPERFLUOUS: Final = 0.5  # of ENOUGH: what an effect must still bring beside the others
HOPEFUL: Final = (10.0, 2)  # evidence from which an effect that is not enough may be one of two, and how many may
MOST_EFFECTS: Final = 4
MOST_STEPS: Final = 8  # two effects that drop each other would go on for ever, and so would a search begun anew


@dataclass(frozen=True, eq=False)
class Selected:
    """Every step of the selection and what came of it."""

    steps: tuple[Step, ...]
    chosen: tuple[str, ...]  # names of effects, in order, or of one curve
    final: Judged
    refused: tuple[Refused, ...]
    curve_margin: float = 0.0  # evidence, or what stands for it, by which the curve has the word
    beside: str = ""  # signal of a curve that takes as much as a further effect, where the effects are needed beside it

    @property
    def curved(self) -> bool:
        """Whether a curve without physics has the word."""
        return bool(self.chosen) and self.chosen[0].startswith(UNNAMED)

    @property
    def unrecorded(self) -> bool:
        """Whether it is a force that nobody recorded; `final` has the effect through whose signal it shows."""
        return bool(self.steps[0].unrecorded)


def selected(study: Study, rng: np.random.Generator, show: Show) -> Selected:
    """Add the best effect while it brings enough; after each, drop what it makes superfluous.

    A curve without physics has the word in the end where there is much more evidence for it than for all effects
    together, or as much and it leaves far less of the error, never where they or any other leave less; or where it
    takes as much of what they leave as a further effect would have to, and they are superfluous beside it.
    """
    search, present = study.search, study.search.all_freed(study.base)
    steps: list[Step] = []
    chosen: list[str] = []
    refused: list[Refused] = []
    for left in reversed(range(MOST_STEPS)):
        if len(chosen) == MOST_EFFECTS:
            break
        possible, cannot = candidates(study.recordings, present.explanation)
        refused = cannot
        curves = unnamed(study.recordings, present.explanation)
        step = tried_beside(study, present, [*possible, *curves], chosen, rng, show, ends=True)
        renewed = search.plan(step.before.explanation).slots != search.plan(present.explanation).slots
        present = step.before
        steps.append(step)
        if step.unrecorded and not chosen:
            break
        if renewed:  # what stood in for a better core, or for another shape of an effect, is superfluous now
            needed, other = _needed(search, steps[0], chosen, present, chosen)
            better = other.loss < steps[0].before.loss / LOOSE  # else nothing is renewed but a shape of an effect
            if needed != chosen and (needed or (better and left)):
                chosen, present, steps = needed, other, steps if needed else []
                continue
        named = [one for one in step.tried if not one.name.startswith(UNNAMED)]
        before = steps[-2].before if chosen else present
        worthy = [one for one in named if (_further(one, step, before, chosen) if chosen else _first(one, step))]
        pair = None
        if not worthy:
            pair = _behind(study, step, chosen, rng, show) if chosen else _pair(study, step, rng, show)
        if not worthy and pair is None:
            nearly = [one for one in named if _first(replace(one, evidence=one.evidence / NEARLY), step)]
            worthy = _in_its_curve(step, before, chosen) if chosen else nearly
        held, soil = chosen, False
        if pair is not None:
            steps[-1:] = [replace(step, taken=pair.first.name), replace(pair.step, taken=pair.second.name)]
            chosen, present = [*chosen, pair.first.name, pair.second.name], pair.second.judged
        elif worthy:
            told = [one for one in worthy if not (chosen and _may_be_soil(one, step))]
            likely, soil = told or worthy, not told  # which it is unless one cause stands for all forces
            best = _best(likely, chosen)
            steps[-1] = replace(step, taken=best.name)
            chosen, present = _needed(search, steps[0], [*chosen, best.name], best.judged, chosen)
        else:
            break
        back = one_for_all(search, steps, chosen, present)
        if back is None and soil:
            steps[-1], chosen, present = step, held, step.before
            break
        if back is not None:
            steps = [*steps[: back.place], back.step]
            there = [one.taken for one in steps if one.taken in back.judged.explanation.names]
            there = list(dict.fromkeys(there))
            chosen, present = _needed(search, steps[0], there, back.judged, there[:-1])
    if chosen and _is_little(steps[0], present):
        steps, chosen, present = [replace(steps[0], taken="")], [], steps[0].before
    if steps[0].unrecorded:
        shows = next(one for one in steps[0].tried if one.name == steps[0].unrecorded)
        return Selected(tuple(steps), (), shows.judged, tuple(refused))
    last = steps[-1] if chosen and steps[-1].before is present else None
    curve, margin = curve_with_the_word(steps[0], together(steps[0], present, chosen) if chosen else 0.0, present)
    if curve is not None and last is not None and effects_are_more(curve, chosen, last):
        curve = None
    beside = ""
    if curve is None and last is not None:
        more = _left_over(chosen, last, steps[-2].before)
        alone = tried_in(steps[0], more.name) if more is not None else None
        if more is not None and alone is not None and alone.judged.loss < LOOSE * more.judged.loss:
            curve, margin = alone, more.counted - asked(more.gain)
        elif more is not None:
            beside = more.name.removeprefix(UNNAMED)
        else:
            beside = _witness_of_the_rest(last)
    if curve is not None:
        return Selected(tuple(steps), (curve.name,), curve.judged, tuple(refused), margin)
    return Selected(tuple(steps), tuple(chosen), present, tuple(refused), beside=beside)


def _best(likely: Sequence[Tried], chosen: Sequence[str]) -> Tried:
    """The one that leaves least of those with as much evidence as the first.

    Where nobody has evidence enough and nothing has been found yet, it is the one that leaves clearly less than that.
    """
    best = min((one for one in likely if close(likely[0], one)), key=lambda one: one.compared.loss)
    least = min(likely, key=lambda one: one.compared.loss)
    doubtful = not chosen and likely[0].counted < asked_alone(likely[0])
    return least if doubtful and LOOSE * least.compared.loss < best.compared.loss else best


def _needed(
    search: Search, first: Step, chosen: list[str], present: Judged, doubted: Sequence[str]
) -> tuple[list[str], Judged]:
    """What of the doubted is still needed beside the others, and the model with only that."""
    for name in doubted:
        other = search.judged("", search.fitted(without(present.explanation, name)))
        held = [one for one in chosen if one != name]
        if together(first, present, chosen) - together(first, other, held) < SUPERFLUOUS * ENOUGH:
            chosen, present = held, other
    return chosen, present


def _is_little(first: Step, last: Judged) -> bool:
    """Whether all that was found takes no more than the little of everything that a machine has."""
    return last.loss > (1.0 - LEAST_IN_ALL) * first.before.loss


def _first(one: Tried, step: Step) -> bool:
    return (enough(one) or whole(one, step) or _hidden_by_a_force(one, step)) and not may_be_soil(one)


def _hidden_by_a_force(one: Tried, step: Step) -> bool:
    """Whether it takes enough of what is left where every force is known, though one that is missing hides it here."""
    if step.forces is None or EFFECTS[one.name].stage is Stage.LOAD:
        return False
    return one.counted >= FURTHER and enough(replace(one, gain=gain(step.forces, one.compared)))


def _further(one: Tried, step: Step, before: Judged, chosen: Sequence[str]) -> bool:
    """Whether it is more than a wrong form of what is there; `before` is without the effect that was added last."""
    share = (step.before.loss - one.judged.loss) / before.loss
    rest = _takes_all(one, step)
    rough = one.name in DYNAMICS or one.name in MEDIATORS  # a core's form leaves as much, and soil shows there
    hidden = rest and one.gain >= MOST and not rough  # a far larger one hid it
    if soil_short(one) > 0.0 or (share < least_share(one, chosen) and not hidden):
        return False
    if any(ruled_out(one.name, name, step.tried) for name in chosen):  # what is left is the form of that
        return False
    return _takes_most(one) or _takes_plainly(one, share, rest) or _takes_with_evidence(one, step)


def _takes_all(one: Tried, step: Step) -> bool:
    """Nearly all that could be explained at all, beyond doubt."""
    return one.sureness >= BEYOND_DOUBT and share_of_all(one, step) >= ALL_OF_IT


def _takes_most(one: Tried) -> bool:
    """More of what is left than any wrong form leaves; a core's form may be as wrong as that."""
    return one.gain >= MOST and one.sureness >= ANYHOW and one.counted >= SOME and one.name not in DYNAMICS


def _takes_plainly(one: Tried, share: float, rest: bool) -> bool:
    """So much of what is left, and of what was, or all that could be explained, that little evidence is enough."""
    evidence, least, much = PLAINLY
    plainly = one.gain >= least and one.sureness >= SURE and (share >= much or rest)
    return plainly and one.counted * one.gain >= evidence


def _may_be_soil(one: Tried, step: Step) -> bool:
    """Whether it is a force for which little speaks but what it takes, and that is not all that could be explained.

    Soil that nobody recorded shows as any of them, and a little of each as any other.
    """
    told = _takes_all(one, step) or _takes_most(one) or _takes_with_evidence(one, step)
    return EFFECTS[one.name].stage is Stage.LOAD and not told


def _takes_with_evidence(one: Tried, step: Step) -> bool:
    """A share that counts, with more evidence than the first effect needs.

    Where every force is known, its share is that of what is left there: a force that is missing, too, hides no other.
    """
    share = one.gain if step.forces is None else max(one.gain, gain(step.forces, one.compared))
    sure = enough(one) or (one.gain >= LEAST_GAIN and one.sureness >= SURE)
    return sure and one.counted >= FURTHER and share >= LEAST_FURTHER


def least_share(one: Tried, chosen: Sequence[str]) -> float:
    """What a further effect must take away, of the loss before the effect that was found last."""
    if one.name in DYNAMICS and not DYNAMICS.isdisjoint(chosen):
        return LEAST_DYNAMIC
    if "hysteresis" in chosen and one.name in EFFECTS and EFFECTS[one.name].stage is Stage.COMMAND:
        return LEAST_COMMAND
    if one.name in STRUCTURAL:
        return LEAST_DYNAMIC if one.gain >= MOST and one.sureness >= BEYOND_DOUBT else LEAST_STRUCTURAL
    return LEAST_SHARE


@dataclass(frozen=True, eq=False)
class _Pair:
    """Two effects of which none is enough alone; `step` tried the second beside the first."""

    first: Tried
    step: Step
    second: Tried


def _pair(study: Study, alone: Step, rng: np.random.Generator, show: Show) -> _Pair | None:
    """The two effects that are enough together, where none is alone: each hides what the other explains.

    Enough is evidence, as ever, or that each takes so surely from what the other leaves as no background does.
    """
    least, most = HOPEFUL
    named = [one for one in alone.tried if not one.name.startswith(UNNAMED)]
    hopeful = [one for one in named if one.counted >= least and one.gain >= LEAST_GAIN][:most]
    found: list[tuple[float, _Pair]] = []
    for first in hopeful:
        possible, _ = candidates(study.recordings, first.judged.explanation)
        step = tried_beside(study, first.judged, possible, [first.name], rng, show)
        for second in (one for one in step.tried if one.name not in MEDIATORS and one.counted > 0.0):
            both = together(alone, second.judged, [first.name, second.name])
            other = next(one for one in named if one.name == second.name)
            gained = 1.0 - second.judged.loss / alone.before.loss
            more = both >= ENOUGH and both - max(first.counted, other.counted) >= 0.5 * ENOUGH
            needed = both >= SOME and min(second.sureness, sureness(other.judged, second.judged, rng)) >= ANYHOW
            if gained >= FEW and (more or needed):
                found.append((both, _Pair(first, step, second)))
    return max(found, key=lambda one: one[0])[1] if found else None


def _behind(study: Study, step: Step, chosen: Sequence[str], rng: np.random.Generator, show: Show) -> _Pair | None:
    """The two effects that a far larger one hides: too little of what was there each, together nearly all that is left.

    No form of the larger one is exact, but what that leaves goes by its own signals: these two act through others.
    """
    known = {signal for name in chosen for signal in acts_through(name)}
    first = next((one for one in step.tried if _elsewhere(one, known) and _takes_with_evidence(one, step)), None)
    if first is None or len(chosen) + 2 > MOST_EFFECTS:
        return None
    possible, _ = candidates(study.recordings, first.judged.explanation)
    beside = tried_beside(study, first.judged, possible, [*chosen, first.name], rng, show)
    known |= acts_through(first.name)
    sure = [one for one in beside.tried if one.gain >= MOST and one.sureness >= BEYOND_DOUBT]
    second = next((one for one in sure if _elsewhere(one, known)), None)
    explained = step.before.loss - beside.background.noise
    if second is None or step.before.loss - second.judged.loss < ALL_OF_IT * explained:
        return None
    return _Pair(first, beside, second)


def _elsewhere(one: Tried, known: Collection[str]) -> bool:
    """Whether an effect acts through other signals than those, no soil and through none that the drive itself moves."""
    if one.name.startswith(UNNAMED) or one.name in DYNAMICS or one.name in MEDIATORS:
        return False
    return one.credit == 1.0 and soil_short(one) == 0.0 and acts_through(one.name).isdisjoint(known)


def _left_over(chosen: Sequence[str], last: Step, before: Judged) -> Tried | None:
    """The curve that takes as much of what the effects leave as a further effect would have to, and most of it.

    No form is exact: what an effect leaves to its own signals, or all of them to everybody, may be its own; what they
    leave to another signal is not theirs. What the drive itself moves has no say, as soil that nobody recorded shows
    there, too. Where the curve does as well alone, they were its substitutes; else they are needed, and something else
    is missing as well. `before` is without the last effect.
    """
    known = {signal for name in chosen for signal in acts_through(name)}
    curves = [
        one
        for one in last.tried
        if one.name.startswith(UNNAMED) and one.credit == 1.0 and one.name.removeprefix(UNNAMED) not in known
    ]
    best = max(curves, key=counted, default=None)
    if best is None or not _further(best, last, before, chosen):
        return None
    left = last.before.loss - last.background.noise
    return best if last.before.loss - best.judged.loss >= MOST_OF_IT * left else None


def _in_its_curve(step: Step, before: Judged, chosen: Sequence[str]) -> list[Tried]:
    """Effects that take most of what a curve takes which is none of those found, and through its signal.

    Beside a larger effect, whose form is not exact, they leave too much to be named by themselves. That something
    depends on the signal the curve has shown; what they take of it has the physics.
    """
    curve = _left_over(chosen, step, before)
    if curve is None:
        return []
    signal = curve.name.removeprefix(UNNAMED)
    of_it = [one for one in step.tried if not one.name.startswith(UNNAMED) and of_the_same(one.name, signal)]
    sure = [one for one in of_it if enough(one) and one.counted >= FURTHER and soil_short(one) == 0.0]
    return [one for one in sure if one.gain >= MOST_OF_IT * curve.gain]


def _witness_of_the_rest(last: Step) -> str:
    """The signal through which every force acts, where it shows one that nobody recorded, and most of what is left."""
    shows = tried_in(last, last.unrecorded)
    if shows is None:
        return ""
    left = last.before.loss - last.background.noise
    most = last.before.loss - shows.judged.loss >= MOST_OF_IT * left
    return next(iter(EFFECTS[last.unrecorded].needs)) if most else ""


def together(first: Step, one: Judged, names: Sequence[str]) -> float:
    """Evidence for several effects at once, against the model as it was first."""
    return first.background.evidence_of(one.fit, names) + held_out(first.before, one)
