"""Everything that could be missing, tried beside an explanation: fitted jointly, judged, weighed.

What counts is the evidence beside a little of everything and in the held-out errors, against every other candidate.
Consequences of the drive (engine load, line pressure) must explain more than a cause does to be believed.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum, auto
from functools import partial
from typing import Final

import numpy as np

from cruise.effects import EFFECTS
from cruise.validation.background import Background
from cruise.validation.candidates import MEDIATORS, UNNAMED, Candidate, without
from cruise.validation.fitting import Fit
from cruise.validation.foretold import share_told
from cruise.validation.search import Judged, Search, gain, sureness
from cruise.validation.side_by_side import side_by_side
from cruise.validation.slip import slip_mps
from cruise.validation.study import Study

ENOUGH: Final = 60.0  # evidence from which an effect is more than a little of everything
LEAST_GAIN: Final = 0.15  # of the present loss: errors that fall by less than 8 % are not worth a name
MUCH: Final = 0.6  # of the present loss: no background takes so much, so that half the evidence is enough
LEAST_LEFT: Final = 1e-9  # of the loss: what is left of it where there is no noise at all
SURE: Final = 1.5  # standard errors of a held-out gain; a few blocks may hold all of it
BEYOND_DOUBT: Final = 6.0  # standard errors that a background, which has its moments, does not reach
MEDIATED: Final = 0.3  # of the present loss: all that an effect may leave through whose signal every force acts
MORE: Final = 0.8  # of what the best direct cause leaves: with less, and with
BEYOND: Final = 0.04  # of the present loss, that it must take away beyond the best direct cause: forms may be wrong
TOLD_BESIDE: Final = 0.7  # of what it takes away beyond that foretold by what is recorded, it is a cause itself
DIRECT: Final = 0.5  # of what it takes away: with more that a direct cause takes away in its place, it is none
TOLD: Final = 0.35  # of what it takes away: with less that is foretold, a force that nobody recorded acts there
PLAIN: Final = 0.5  # of what the best cause leaves: with less, a consequence of the drive is a cause all the same
ALIKE: Final = 20.0  # evidence below which no form of a model is exact enough to decide,
CLOSE: Final = 0.05  # likewise, of the evidence,
LOOSE: Final = 1.2  # unless the loss decides
FINISHED: Final = 10  # candidates whose fits are carried to their end; the others are far off after a few steps
RESTARTED: Final = 4  # effects that are fitted once more, from another core and from all starts

Show = Callable[[str], None]


class Through(Enum):
    """What stands behind an effect through whose signal every force acts."""

    ITSELF = auto()
    RECORDED = auto()  # another cause, or too little to say: a direct one explains half of what it takes away
    UNRECORDED = auto()  # a force that nobody recorded: nothing foretells what it takes away


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
    unrecorded: str  # the effect in whose signal a force shows that nobody recorded, if there is one
    taken: str = ""  # the effect that was added then


def tried_beside(
    study: Study,
    present: Judged,
    everyone: Sequence[Candidate],
    chosen: Sequence[str],
    rng: np.random.Generator,
    show: Show,
    elsewhere: Sequence[Judged] = (),
) -> Step:
    """Every candidate beside what is there, best first. What is there may be fitted better on the way.

    `elsewhere` are further direct causes: dependences without physics that were tried before.
    """
    search, fits = study.search, _fitted(study.search, present, everyone, chosen, show)
    before = present.fit
    if fits:  # the best fit's core may be a better start for what is there, too
        first = min(range(len(fits)), key=lambda i: fits[i].cost)
        refitted = search.fitted(without(fits[first].explanation, everyone[first].name))
        before = min(before, refitted, key=lambda one: one.cost)
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
    through = {f"{UNNAMED}{signal}" for name in MEDIATORS if name in EFFECTS for signal in EFFECTS[name].needs}
    direct = [one for one in (*others, *elsewhere) if one.candidate not in through]
    unrecorded = ""
    for one in judged:
        if one.candidate in MEDIATORS:
            behind = _through(study, present, one, min([present, *direct], key=lambda other: other.loss))
            credit[one.candidate] = 1.0 if behind is Through.ITSELF else 0.0
            unrecorded = one.candidate if behind is Through.UNRECORDED else unrecorded
        elif one.candidate in named and one.loss < PLAIN * min([present.loss, *causes]):
            credit[one.candidate] = 1.0
    background.settle({name: credit[name] for name in named})
    tried = []
    for one in judged:
        evidence = background.evidence(one.candidate) + held_out(present, one)
        sure = sureness(present, one, rng)
        tried.append(Tried(one.candidate, gain(present, one), evidence, credit[one.candidate], sure, one))
    return Step(present, tuple(sorted(tried, key=counted, reverse=True)), background, unrecorded)


def _fitted(
    search: Search, present: Judged, everyone: Sequence[Candidate], chosen: Sequence[str], show: Show
) -> list[Fit]:
    """A fit of every candidate: a few steps for all, the best to their end, the very best from elsewhere too."""
    fits: list[Fit] = []
    beside = f" beside {', '.join(chosen)}" if chosen else ""
    for one, begun in zip(everyone, side_by_side(partial(search.begun, present.explanation), everyone), strict=True):
        show(f"tried {_in_words(one.name)}{beside}")
        fits.append(begun)
    best = np.argsort([one.cost for one in fits])[:FINISHED].tolist()
    for i, finished in zip(best, side_by_side(search.finished, [fits[i] for i in best]), strict=True):
        show(f"finished {_in_words(everyone[i].name)}")
        fits[i] = finished
    effects = [i for i, one in enumerate(everyone) if not one.name.startswith(UNNAMED)]
    best = sorted(effects, key=lambda i: fits[i].cost)[:RESTARTED]
    again = partial(_from_elsewhere, search, present)
    for i, one in zip(best, side_by_side(again, [(everyone[i], fits[i]) for i in best]), strict=True):
        fits[i] = min(fits[i], one, key=lambda one: one.cost)
    return fits


def _from_elsewhere(search: Search, present: Judged, begun: tuple[Candidate, Fit]) -> Fit:
    """The best fit of a candidate from another core; from all starts, too, where it brings anything so far."""
    candidate, fit = begun
    others = [search.grown_anew(present.explanation, candidate)]
    if fit.cost < (1.0 - LEAST_GAIN) * present.fit.cost:
        others.append(search.grown_from_all(present.explanation, candidate))
    return min(others, key=lambda one: one.cost)


def _through(study: Study, present: Judged, mediator: Judged, direct: Judged) -> Through:
    """What stands behind an effect through whose signal every force acts; `direct` is the best of the other causes."""
    taken = present.loss - mediator.loss
    if mediator.loss > MEDIATED * present.loss:
        return Through.RECORDED

    def told(error_mps: np.ndarray) -> float:
        part_mps = error_mps - mediator.fit.error_mps
        return share_told(study.search.scene, present.fit, part_mps, study.search.blocks)

    in_its_place = present.loss - direct.loss > DIRECT * taken
    alone = in_its_place and direct.candidate.startswith(UNNAMED)  # one recorded signal, and no known effect of it
    beyond = max((1.0 - MORE) * direct.loss, BEYOND * present.loss)
    if not alone and direct.loss - mediator.loss > beyond and told(direct.fit.error_mps) >= TOLD_BESIDE:
        return Through.ITSELF
    if in_its_place:
        return Through.RECORDED
    return Through.ITSELF if told(present.fit.error_mps) >= TOLD else Through.UNRECORDED


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
    return ENOUGH if gain < MUCH else 0.5 * ENOUGH


def enough(one: Tried) -> bool:
    """Whether what a candidate explains is worth naming, sure, and more than a little or beyond doubt."""
    more = one.counted >= asked(one.gain) and one.sureness >= SURE
    return one.gain >= LEAST_GAIN and (more or (one.counted > 0.0 and one.sureness >= BEYOND_DOUBT))


def close(first: Tried, one: Tried) -> bool:
    """Whether the evidence of the first, which has most, is too little more than another's to decide."""
    return one.counted >= first.counted - max(ALIKE, CLOSE * first.counted)


def ahead(mine: Tried, other: Tried) -> float:
    """Evidence for one above that for another, both as they count; where it is close, the loss may say more."""
    more = mine.counted - other.counted
    if not close(max(mine, other, key=counted), min(mine, other, key=counted)):
        return more
    return max(more, ALIKE * math.log(max(other.judged.loss / mine.judged.loss, LEAST_LEFT)) / math.log(LOOSE))


def _in_words(name: str) -> str:
    return f"any dependence on {name.removeprefix(UNNAMED)}" if name.startswith(UNNAMED) else name
