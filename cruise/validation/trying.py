"""Everything that could be missing, tried beside an explanation: fitted jointly, judged, weighed.

What counts is the evidence beside a little of everything and in the held-out errors, against every other candidate.
Consequences of the drive (engine load, line pressure) must explain more than a cause does to be believed. Where line
pressure is recorded, what it says of forces decides between those that act as one and those that don't.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from types import MappingProxyType
from typing import Final, NamedTuple

import numpy as np

from cruise.effects import EFFECTS, Stage
from cruise.signals import INPUT
from cruise.validation.background import STRUCTURAL, Background
from cruise.validation.candidates import MEDIATORS, UNNAMED, Candidate, EffectCandidate, with_effect, without
from cruise.validation.credit import OF_BOTH_SPEEDS, credits_of, lingers
from cruise.validation.explanation import Explanation
from cruise.validation.fitting import Fit
from cruise.validation.judged import Judged, gain, sureness
from cruise.validation.laws import law_of
from cruise.validation.mediator import (
    SHOWN,
    SILENT,
    Said,
    Through,
    behind,
    least_of_a_force,
    leaves_room,
    may_be_needed,
    needed,
    refuted,
    weighed,
)
from cruise.validation.search import Search
from cruise.validation.side_by_side import side_by_side
from cruise.validation.study import Study
from cruise.validation.told import told_shapes
from cruise.validation.tried import LEAST_GAIN, Step, Tried, counted, held_out

FREED: Final = 0.3  # of the cost, that an effect must take away for its spare shape to be tried,
ELSEWHERE: Final = 0.3  # of the current's range: in any case where a gain turns the drive so far from no current
ASTRAY: Final = 2.0  # times the cost without an effect, beyond which no fit of it is one: at neutral it takes nothing
HOPELESS: Final = (0.99, 10.0)  # of the cost without it, and times the best effect's: no other start mends as much
MOVED: Final = 0.03  # of the cost, by which a better core makes all be tried anew from it
ONLY_NOISE: Final = 1.25  # of the white part of the speed: what leaves no more leaves no effect the quarter it needs,
WHITE: Final = 0.9  # where its own past foretells no more of it than the rest

Show = Callable[[str], None]


class Effort(NamedTuple):
    """How many candidates are fitted with care, those that are best after a few steps; the others are far off."""

    finished: int  # effects that are carried to their end,
    curves: int  # and dependences without physics
    restarted: (
        int  # effects that are fitted once more, from another core and from all starts; the best curve at first, too
    )


THOROUGH: Final = Effort(8, 4, 4)
QUICK: Final = Effort(4, 2, 0)  # beside the mediator, where the model is not taken from


def tried_beside(
    study: Study,
    present: Judged,
    everyone: Sequence[Candidate],
    chosen: Sequence[str],
    rng: np.random.Generator,
    show: Show,
    effort: Effort = THOROUGH,
    known: Mapping[str, Fit] = MappingProxyType({}),
    ends: bool = False,
) -> Step:
    """Every candidate beside what is there, best first. What is there may be fitted better on the way.

    `known` are fits of candidates that were found on another way. One that `ends` tries nothing beside what leaves
    nothing but noise.
    """
    search = study.search
    if chosen and effort is THOROUGH:  # what was missing may have hidden that the core, or a shape of an effect, is
        present = search.all_freed(search.sufficient(search.grounded(of_the_best_kind(study, present))))
    if chosen and ends and leaves_only_noise(study, present):
        return Step(present, (), Background(present.fit, {}, search.disturbance), "", None, (), 0.0)
    fits = _fitted(search, present, everyone, chosen, show, effort, known)
    before = present.fit
    if fits:  # the best fit's core may be a better start for what is there, too
        first = min(range(len(fits)), key=lambda i: fits[i].cost)
        refitted = search.fitted(without(fits[first].explanation, everyone[first].name))
        before = min(before, refitted, key=lambda one: one.cost)
    if before.cost < (1.0 - MOVED) * present.fit.cost:  # all others stand where the core was
        found = {candidate.name: one for candidate, one in zip(everyone, fits, strict=True)}
        return tried_beside(study, search.judged("", before), everyone, chosen, rng, show, effort, found, ends)
    if not chosen:
        search.learn_disturbance(before, fits)
    if not chosen or before is not present.fit:
        present = search.judged("", before)
    pairs = [(candidate.name, one) for candidate, one in zip(everyone, fits, strict=True)]
    judged = [
        _fitted_to_nothing(search, present, one) if one.fit.cost > ASTRAY * before.cost else one
        for one in side_by_side(lambda pair: search.judged(*pair), pairs)
    ]
    named = [one.name for one in everyone if not one.name.startswith(UNNAMED)]
    background = Background(
        before,
        {candidate.name: one for candidate, one in zip(everyone, fits, strict=True)},
        search.disturbance,
        [name for name in named if name not in MEDIATORS],
        (search.slip_mps, OF_BOTH_SPEEDS),
    )
    credit = credits_of(search, present, judged, everyone, chosen)
    alone = [
        Tried(one.candidate, gain(present, one), 0.0, credit[one.candidate], sureness(present, one, rng), one, one)
        for one in judged
    ]
    said = _said(study, present, alone, everyone, chosen, rng, show)
    credit |= dict.fromkeys(MEDIATORS, 1.0 if said.through is Through.ITSELF else 0.0)
    background.settle([name for name in named if credit[name] > 0.0])
    credit |= dict.fromkeys(said.refuted, 0.0)
    tried = [
        replace(
            one,
            evidence=background.evidence(one.name) + held_out(present, one.judged),
            credit=credit[one.name],
        )
        for one in alone
    ]
    weighty = [weighed(one, said.beside.get(one.name)) for one in tried]
    weighty = [replace(one, credit=0.0) if lingers(one.judged) else one for one in weighty]
    tried = sorted(weighty, key=counted, reverse=True)
    unrecorded = said.name if said.through is Through.UNRECORDED else ""
    return Step(present, tuple(tried), background, unrecorded, said.forces, said.refuted, said.margin)


def leaves_only_noise(study: Study, present: Judged) -> bool:
    """Whether an explanation errs by about the white part of the measured speed, and whitely.

    Far less of an error says that it is no floor (`noise_in`); a little less is chance.
    """
    floor, white = study.white_mps**2, present.white_loss >= WHITE * present.loss
    return white and floor / ONLY_NOISE <= present.loss <= ONLY_NOISE * floor


def _fitted_to_nothing(search: Search, present: Judged, one: Judged) -> Judged:
    """A candidate whose fit went astray, at its neutral values beside the explanation as it is: that errs no more."""
    explanation = replace(present.explanation, structural=one.explanation.structural)
    for effect in one.explanation.effects:
        if effect.name not in explanation.names:
            neutral = {name: bound.neutral for name, bound in effect.parameters.items()}
            explanation = with_effect(explanation, effect.reshaped(**neutral))
    plan, fit = search.plan(explanation), present.fit
    there = {(slot.owner, slot.name): i for i, slot in enumerate(plan.slots)}
    places = [there[slot.owner, slot.name] for slot in fit.layout.slots]

    def beside_it(vector: np.ndarray) -> np.ndarray:
        whole = plan.vector.copy()
        whole[places] = vector
        return whole

    slopes = np.zeros((len(fit.error_mps), len(plan.slots)), np.float32)
    slopes[:, places] = fit.jacobian
    kept = Fit(plan, beside_it(fit.vector), fit.error_mps, slopes, fit.cost)
    return replace(present, candidate=one.candidate, fit=kept, folds=tuple(map(beside_it, present.folds)))


def of_the_best_kind(study: Study, present: Judged) -> Judged:
    """The same with every effect that may be of one kind or another as the one that errs least beside the others.

    A detent and overlap are told apart only once what else is missing is there.
    """
    for effect in present.explanation.effects:
        bare = without(present.explanation, effect.name)
        ways = told_shapes(effect.name, study.recordings)
        for told in ways if len(ways) > 1 else ():
            if any(getattr(effect, name) != value for name, value in told):
                other = study.search.grown(bare, EffectCandidate(effect.name, told=(told,)))
                present = min(present, study.search.judged(present.candidate, other), key=lambda one: one.loss)
    return present


def _said(
    study: Study,
    present: Judged,
    alone: Sequence[Tried],
    everyone: Sequence[Candidate],
    chosen: Sequence[str],
    rng: np.random.Generator,
    show: Show,
) -> Said:
    """What line pressure says of the candidates, where it is recorded; nothing beside what it explains itself."""
    mediator = next((one for one in alone if one.name in MEDIATORS), None)
    if mediator is None:
        return SILENT
    room = mediator.gain >= SHOWN and leaves_room(present, mediator.judged, study.white_mps)
    if room and any(may_be_needed(one) for one in alone):
        others = [one for one in everyone if one.name not in MEDIATORS]
        known = _known(study.search, mediator, [one for one in alone if may_be_needed(one)], everyone)
        names = [*chosen, mediator.name]
        step = tried_beside(study, mediator.judged, others, names, rng, show, effort=QUICK, known=known)
        beside = {one.name: one for one in step.tried}
        force = least_of_a_force(present, alone)
        if any(needed(present, step.before, one, beside[one.name], force) for one in alone if one is not mediator):
            return Said(mediator.name, Through.RECORDED, 0.0, step.before, beside, ())
    no_forces = refuted(mediator.judged, alone) if mediator.gain >= SHOWN else ()
    through = {*MEDIATORS, *(f"{UNNAMED}{signal}" for signal in EFFECTS[mediator.name].needs)}
    moved = {one.name for one in alone if one.name.startswith(UNNAMED) and one.credit < 1.0}  # by the drive itself
    direct = [one.judged for one in alone if one.credit > 0.0 and one.name not in {*no_forces, *through, *moved}]
    best = min([present, *direct], key=lambda one: one.loss)
    through_it, margin = behind(study, present, mediator.judged, best, chosen)
    if through_it is Through.COMMANDED:  # what acts on the command moves the pressure, too
        return SILENT
    return Said(mediator.name, through_it, margin, None, {}, no_forces)


def _known(search: Search, mediator: Tried, alone: Sequence[Tried], everyone: Sequence[Candidate]) -> dict[str, Fit]:
    """Fits of candidates beside the mediator, from where they stand without it."""
    through = next(one for one in everyone if one.name == mediator.name)
    fits = side_by_side(partial(_grown_by, search, through), [one.judged.explanation for one in alone])
    return {one.name: fit for one, fit in zip(alone, fits, strict=True)}


def _grown_by(search: Search, candidate: Candidate, explanation: Explanation) -> Fit:
    return search.begun(explanation, candidate)


def _fitted(
    search: Search,
    present: Judged,
    everyone: Sequence[Candidate],
    chosen: Sequence[str],
    show: Show,
    effort: Effort,
    known: Mapping[str, Fit],
) -> list[Fit]:
    """A fit of every candidate: a few steps for all, the best to their end, the very best from elsewhere too."""
    fits: list[Fit] = []
    beside = f" beside {', '.join(chosen)}" if chosen else ""
    bent = [name for name in present.explanation.names if law_of(name) == INPUT and name not in chosen]
    begin = partial(_begun, search, present.explanation, bent)
    for one, begun in zip(everyone, side_by_side(begin, everyone), strict=True):
        show(f"tried {_in_words(one.name)}{beside}")
        fits.append(min(begun, known.get(one.name, begun), key=lambda fit: fit.cost))
    ranked = sorted(range(len(fits)), key=lambda i: fits[i].cost)
    curves = [i for i in ranked if everyone[i].name.startswith(UNNAMED)]
    effects = [i for i in ranked if i not in curves]
    best = [*effects[: effort.finished], *curves[: effort.curves]]
    for i, finished in zip(best, side_by_side(search.finished, [fits[i] for i in best]), strict=True):
        show(f"finished {_in_words(everyone[i].name)}{beside}")
        fits[i] = finished
    best = sorted(effects, key=lambda i: fits[i].cost)[: effort.restarted]
    if not chosen:  # where a curve may get the word
        best += sorted(curves, key=lambda i: fits[i].cost)[: min(effort.restarted, 1)]
    little, times = HOPELESS
    most = min([little * present.fit.cost, *(times * fits[i].cost for i in effects)])
    best = [i for i in best if fits[i].cost <= most]
    if effort.restarted and present.explanation.core.servo_hz:  # which may ring in the place of what else does
        best += [i for i in effects if everyone[i].name in STRUCTURAL and i not in best]
    again = partial(_from_elsewhere, search, present)
    for i, one in zip(best, side_by_side(again, [(everyone[i], fits[i]) for i in best]), strict=True):
        show(f"begun elsewhere: {_in_words(everyone[i].name)}{beside}")
        fits[i] = min(fits[i], one, key=lambda one: one.cost)
    elsewhere = _stands_elsewhere(search, present)
    better = [
        i
        for i in effects
        if fits[i].cost < (1.0 - FREED) * present.fit.cost
        or (elsewhere and EFFECTS[everyone[i].name].stage is Stage.GAIN)
    ]
    least = min((one.cost for one in fits), default=0.0)
    for i, one in zip(
        better, side_by_side(partial(_freed, search, least), [(everyone[i], fits[i]) for i in better]), strict=True
    ):
        fits[i] = one
    return fits


def _begun(search: Search, explanation: Explanation, bent: Sequence[str], candidate: Candidate) -> Fit:
    """A few steps; of a law of current or speed, those too beside which the model's own laws begin anew."""
    begun = search.begun(explanation, candidate)
    if not bent or not law_of(candidate.name):
        return begun
    return min(begun, search.begun_straight(explanation, candidate, bent), key=lambda fit: fit.cost)


def _stands_elsewhere(search: Search, present: Judged) -> bool:
    """Whether the machine stands far from no current: a gain takes little or nothing where it turns it about none."""
    core, current_ma = present.explanation.core, search.scene.current_ma
    range_ma = float(np.nanmax(current_ma) - np.nanmin(current_ma))
    return abs(present.explanation.offset_mps) > ELSEWHERE * range_ma * abs(core.gain_mps_per_ma)


def _freed(search: Search, least: float, found: tuple[Candidate, Fit]) -> Fit:
    candidate, fit = found
    return search.freed(fit, candidate.name, least)


def _from_elsewhere(search: Search, present: Judged, begun: tuple[Candidate, Fit]) -> Fit:
    """The best fit of a candidate from another core; from all starts, too, where it brings anything so far."""
    candidate, fit = begun
    others = [search.grown_anew(present.explanation, candidate)]
    if fit.cost < (1.0 - LEAST_GAIN) * present.fit.cost:
        others.append(search.grown_from_all(present.explanation, candidate))
    return min(others, key=lambda one: one.cost)


def _in_words(name: str) -> str:
    return f"any dependence on {name.removeprefix(UNNAMED)}" if name.startswith(UNNAMED) else name
