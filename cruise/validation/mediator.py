"""Line pressure as a witness: it shows every force that the drive feels, and nothing that acts on the command.

    present + mediator + candidate   against   present + mediator

The effect through whose signal every force acts (`MEDIATORS`) explains them all, recorded or not, whether or not it is
itself what is missing. So it is no cause to be named lightly, but beside it everybody's force is known: soil that no
signal shows is no longer noise, and a dead zone is no longer taken for dry friction. What still takes much away there
is needed whatever the forces are, and is weighed there. Where nothing does, whatever is missing is a force, and what
acts on the command, the gain or a sensor is refuted. Where the current alone foretells what the signal shows, nothing
is refuted: a limit of the rate takes pressure as well, and friction beside it would pass for all there is. Where no
slope is recorded, every ground has a force that nothing foretells: then the effect is named all the same, for what the
force costs is what the model lacks. On a machine whose forces don't show in that signal nothing of this holds, and
nothing is lost: every force is still needed beside it.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum, auto
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np

from cruise.effects import EFFECTS, Stage
from cruise.signals import INPUT
from cruise.validation.candidates import MEDIATORS, UNNAMED, EffectCandidate, candidates, without
from cruise.validation.foretold import share_told
from cruise.validation.judged import Judged, noise_in
from cruise.validation.search import Search
from cruise.validation.slope import PITCH
from cruise.validation.study import Study
from cruise.validation.tried import LEAST_GAIN, LOOSE, RESISTANCE, SURE, Step, Tried, counted, enough
from cruise.validation.unnamed import SPEED

SHOWN: Final = 0.05  # of the present loss: with less in its signal, it says nothing of the others
NEEDED: Final = 40.0  # evidence beside it from which something is needed whatever the forces are,
NEEDED_SHARE: Final = 0.05  # and of the present loss
MEDIATED: Final = 0.27  # of the present loss: all that an effect may leave through whose signal every force acts
NOISY: Final = 0.65  # likewise, where no other cause takes away more than
LONELY: Final = 0.35  # of what it does, and no effect has been found yet: then noise is most of what it leaves,
LONELIER: Final = 0.25  # and less where it leaves more than the next: soil does, beside a little of everything,
UNSEEN: Final = 0.4  # and no more than so much, where it is a force that nobody recorded
MORE: Final = 0.8  # of what the best direct cause leaves: with less, and with
BEYOND: Final = 0.04  # of the present loss, that it must take away beyond the best direct cause: forms may be wrong
TOLD_BESIDE: Final = 0.7  # of what it takes away beyond that foretold by what is recorded, it is a cause itself
DIRECT: Final = 0.5  # of what it takes away: with more that a direct cause takes away in its place, it is none,
NAMELESS: Final = 0.8  # or a curve without physics, where nothing else has been found,
ALONE: Final = (0.65, 0.9)  # or that its signal alone foretells, and of what all signals do, if no effect knows it
FORCES: Final = 2  # that such an effect may stand for, where it errs hardly more than all of them
LEFT_BY_MANY: Final = 0.7  # of what all recorded forces leave together: with less, and while they take no more than
BY_MANY: Final = 0.87  # of what it takes away, it is the one cause of them all
IN_PROPORTION: Final = (0.8, 1.2)  # powers of the pressure beyond which it is no force that shows there,
SURELY: Final = 2.0  # by so many standard errors
BY_COMMAND: Final = 0.9  # of what all signals foretell, that the current alone does where it is the drive's answer that
# shows: an unmodelled limit of its rate had 1.0 or more, leakage 0.8 or less on 13 drives with slopes
TOLD: Final = 0.35  # of what it takes away: with less that is foretold, a force that nobody recorded acts there
BY_FORCE: Final = frozenset({"wheel_slip"})  # no force, and as large as the force that the wheels pass on


class Through(Enum):
    """What stands behind an effect through whose signal every force acts."""

    ITSELF = auto()
    RECORDED = auto()  # another cause, or too little to say: a direct one explains half of what it takes away
    UNRECORDED = auto()  # a force that nobody recorded: nothing foretells what it takes away
    COMMANDED = auto()  # the command: all of it is how the drive answers, which takes pressure as well


def behind(
    study: Study, present: Judged, mediator: Judged, direct: Judged, chosen: Sequence[str]
) -> tuple[Through, float]:
    """What stands behind the mediator, and how far from its limits it is: 0..1, below 0 where it is nearly the cause.

    `direct` is the best of the other causes, `chosen` are those that were found so far.
    """
    one = _Against(study, present, mediator, direct, not chosen)
    through = one.through()
    none_yet = not any(EFFECTS[name].stage is Stage.LOAD for name in chosen)
    if through is Through.RECORDED and none_yet and _has_a_signal_of_its_own(direct.candidate):
        many = max(
            _more_than_many(study.search, present, mediator, direct), _by_a_power(study.search, mediator, direct)
        )
        return (Through.ITSELF, many) if many > 0.0 else (through, one.short)
    if through in (Through.ITSELF, Through.RECORDED) and one.commanded:
        return Through.COMMANDED, 0.0
    return through, one.short if through is Through.RECORDED else one.margin


def _more_than_many(search: Search, present: Judged, mediator: Judged, direct: Judged) -> float:
    """How far the mediator is from leaving as much as all recorded forces do together (0..1), where they tell part.

    What takes speed by the pressure takes it by every force in it, each by as much as it shows; the forces that are
    recorded take part of that, be it each for itself, and what nobody recorded is left. A force that is missing is
    taken by itself, and soil beside it is little of what is left; that is why what soil looks like is no such force.
    """
    most = DIRECT * present.loss + (1.0 - DIRECT) * mediator.loss
    if mediator.loss > MEDIATED * present.loss or direct.loss > most or mediator.loss >= LEFT_BY_MANY * direct.loss:
        return 0.0
    many = _forces_together(search, present)
    if present.loss - many.loss > BY_MANY * (present.loss - mediator.loss):
        return 0.0
    return max(1.0 - mediator.loss / (LEFT_BY_MANY * many.loss), 0.0)


def _by_a_power(search: Search, mediator: Judged, direct: Judged) -> float:
    """How far the mediator is from leaving as much as the direct cause (0..1), where a power of the pressure acts.

    A force costs speed in proportion to itself, and so to the pressure in which it shows; oil leaks by the root of it
    through whatever is sharp, and by more than it where the pressure widens the gaps.
    """
    (root, more), (exponent, std) = IN_PROPORTION, _exponent(search, mediator)
    in_proportion = root <= exponent + SURELY * std and exponent - SURELY * std <= more
    return 0.0 if in_proportion else max(1.0 - mediator.loss / (LEFT_BY_MANY * direct.loss), 0.0)


def _exponent(search: Search, mediator: Judged) -> tuple[float, float]:
    """The power of the pressure by which the mediator goes, and its standard error."""
    fit = mediator.fit
    owners = [(slot.owner, slot.name) for slot in fit.layout.slots]
    place = owners.index((mediator.candidate, "exponent"))
    return float(fit.vector[place]), math.sqrt(search.covariance(fit)[place, place])


def _forces_together(search: Search, present: Judged) -> Judged:
    """The explanation with all recorded forces, each beside those before it."""
    possible, _ = candidates(search.scene.recordings, present.explanation)
    for one in possible:
        if EFFECTS[one.name].stage is Stage.LOAD and one.name not in MEDIATORS:
            beside = search.judged(one.name, search.grown(present.explanation, one))
            present = min(present, beside, key=lambda judged: judged.loss)
    return present


@dataclass(frozen=True, eq=False)
class _Against:
    """The mediator held against the best of the other causes alone; `first` where nothing has been found yet."""

    study: Study
    present: Judged
    mediator: Judged
    direct: Judged
    first: bool

    @property
    def left(self) -> float:
        """Share of the present loss that the mediator leaves."""
        return self.mediator.loss / self.present.loss

    @property
    def instead(self) -> float:
        """Share of what the mediator takes away that the direct cause takes away in its place."""
        return (self.present.loss - self.direct.loss) / (self.present.loss - self.mediator.loss)

    @property
    def margin(self) -> float:
        """How far it is from leaving too much, for which less is asked where no other cause explains much."""
        lonely = LONELY if self.left <= UNSEEN else LONELIER
        return max(1.0 - self.left / MEDIATED, 1.0 - self.instead / lonely if self.first else 0.0)

    @property
    def short(self) -> float:
        """The margin where it is below zero, if all that is in its way is that others explain a little too much."""
        noisy = self.first and MEDIATED < self.left <= NOISY and self.foretold >= TOLD
        return min(self.margin, 0.0) if noisy else 0.0

    @cached_property
    def foretold(self) -> float:
        """R^2 of what it takes away from the present error, by all signals."""
        return self.told(self.present.fit.error_mps)

    @property
    def commanded(self) -> bool:
        """Whether much is foretold, and the current alone does it: no slope, load or soil has a part in it."""
        if self.foretold < TOLD:
            return False
        return self.told(self.present.fit.error_mps, INPUT) >= BY_COMMAND * self.foretold

    def told(self, error_mps: np.ndarray, by: str = "") -> float:
        """R^2 that signals foretell of what it takes away from an error, all of them or `by` one."""
        part_mps, search = error_mps - self.mediator.fit.error_mps, self.study.search
        return share_told(search.scene, self.present.fit, part_mps, search.blocks, by)

    def through(self) -> Through:
        """What stands behind the mediator."""
        if self.left > NOISY:
            return Through.RECORDED
        if self.left > MEDIATED:
            return self._beside_noise()
        if self._another_cause():
            return Through.RECORDED
        beyond = max((1.0 - MORE) * self.direct.loss, BEYOND * self.present.loss)
        if self.direct.loss - self.mediator.loss > beyond and self.told(self.direct.fit.error_mps) >= TOLD_BESIDE:
            return Through.ITSELF
        by_force = self.instead if _has_a_signal_of_its_own(self.direct.candidate) else 0.0
        recorded = by_force >= TOLD or self.foretold >= TOLD
        return Through.ITSELF if recorded else self._untold()

    def _beside_noise(self) -> Through:
        """Where noise is most of what it leaves: it has to be lonely."""
        if self.margin <= 0.0:
            return Through.RECORDED
        if self.foretold >= TOLD:
            return Through.ITSELF
        return self._untold() if self.left <= UNSEEN else Through.RECORDED

    def _another_cause(self) -> bool:
        """Whether a direct cause, or a curve of a signal that no effect knows, takes enough of its place."""
        nameless = self.first and self.direct.candidate.startswith(UNNAMED)
        if self.instead > (NAMELESS if nameless else DIRECT):
            return True
        signal = self.direct.candidate.removeprefix(UNNAMED)
        if not (nameless and self.instead > DIRECT and unknown(signal)):
            return False
        least, most = ALONE  # the curve's form may be wrong
        return self.told(self.present.fit.error_mps, signal) >= max(least, most * self.foretold)

    def _untold(self) -> Through:
        """Where nothing foretells the force: where no slope is recorded, any slope is such a one."""
        pitched = all(PITCH in one.columns for one in self.study.recordings)
        return Through.UNRECORDED if pitched else Through.ITSELF


def _has_a_signal_of_its_own(name: str) -> bool:
    """Whether it is a recorded force, or a curve of its signal, and none of those that soil looks like."""
    if name.startswith(UNNAMED):
        return any(_has_a_signal_of_its_own(one) and name[len(UNNAMED) :] in EFFECTS[one].needs for one in EFFECTS)
    return name in EFFECTS and EFFECTS[name].stage is Stage.LOAD and name not in (*RESISTANCE, *MEDIATORS)


def unknown(signal: str) -> bool:
    """Whether it is a recorded signal of which no effect of the table knows."""
    return signal not in (INPUT, SPEED) and not any(signal in effect.needs for effect in EFFECTS.values())


class Back(NamedTuple):
    """The step to which the search goes back, with what is taken there instead."""

    place: int
    step: Step
    judged: Judged


def one_for_all(search: Search, steps: Sequence[Step], chosen: Sequence[str], present: Judged) -> Back | None:
    """The effect through whose signal every force acts, in the place of several forces, where it errs hardly more.

    One cause is likelier than two or three that happen to act in just the proportion in which they show there.
    """
    forces = [name for name in chosen if EFFECTS[name].stage is Stage.LOAD]
    place = next((i for i, one in enumerate(steps) if one.taken in forces), 0)
    mediator = next((one for one in steps[place].tried if one.name in MEDIATORS), None)
    if len(forces) < FORCES or mediator is None or mediator.name in chosen:
        return None
    explanation = present.explanation
    for name in forces:
        explanation = without(explanation, name)
    alone = search.judged(mediator.name, search.grown(explanation, EffectCandidate(mediator.name)))
    taken = replace(mediator, credit=1.0)
    if alone.loss >= LOOSE * present.loss or not enough(taken):
        return None
    tried = sorted((taken if one is mediator else one for one in steps[place].tried), key=counted, reverse=True)
    margin = 1.0 - alone.loss / (LOOSE * present.loss)
    step = replace(steps[place], tried=tuple(tried), taken=mediator.name, mediated=margin)
    return Back(place, step, mediator.judged)


@dataclass(frozen=True, eq=False)
class Said:
    """What the mediator's signal says of all that was tried beside the same explanation."""

    name: str  # of the mediator
    through: Through
    margin: float  # how far from its limits it is: 0..1, below 0 where it is nearly the cause
    forces: Judged | None  # the explanation with every force known, where something else is needed beside that,
    beside: Mapping[str, Tried]  # and everything as tried there
    refuted: tuple[str, ...]  # those that are no force, where nothing else is needed


SILENT: Final = Said("", Through.RECORDED, 0.0, None, {}, ())


def may_be_needed(alone: Tried) -> bool:
    """Whether a candidate is no force and explains so much alone that it is worth trying beside the mediator."""
    return _no_force(alone.name) and alone.gain >= LEAST_GAIN and alone.sureness >= SURE


def leaves_room(present: Judged, mediator: Judged, white_mps: float) -> bool:
    """Whether the mediator leaves so much above the white part of the speed that anything may be `needed` beside it."""
    left = mediator.loss - noise_in(mediator.loss, white_mps)
    return left >= max(LEAST_GAIN * mediator.loss, NEEDED_SHARE * present.loss)


def needed(present: Judged, mediator: Judged, alone: Tried, beside: Tried, force: float) -> bool:
    """Whether a candidate that is no force is needed whatever the forces are; tried alone and beside the mediator.

    `force` is the least loss that a force leaves alone: one that leaves no more than both is all there is, and dry
    friction that sticks is such a one.
    """
    weighty = beside.counted >= NEEDED and beside.gain >= LEAST_GAIN and beside.sureness >= SURE
    brings = mediator.loss - beside.judged.loss
    matters = brings >= NEEDED_SHARE * present.loss and force > beside.judged.loss
    return may_be_needed(alone) and weighty and matters


def refuted(mediator: Judged, alone: Sequence[Tried]) -> tuple[str, ...]:
    """What is no force, while the mediator leaves hardly more: nothing that is no force is needed beside it.

    A curve of a signal that only such effects read is none, either; a slope is a force, whoever reads it; and what goes
    with the force, as slip does, shows in the pressure as well.
    """
    none = (one for one in alone if _no_force(one.name) or _curve_of_no_force(one.name))
    return tuple(one.name for one in none if one.name not in BY_FORCE and mediator.loss < LOOSE * one.judged.loss)


def weighed(alone: Tried, beside: Tried | None) -> Tried:
    """A candidate with the weight that it has beside the mediator, if something is needed there."""
    if beside is None:
        return alone
    return replace(
        alone,
        evidence=beside.evidence,
        credit=beside.credit,
        sureness=beside.sureness,
        compared=beside.judged,
    )


def least_of_a_force(present: Judged, alone: Sequence[Tried]) -> float:
    """The least loss that a force of the table leaves, beside the mediators."""
    forces = (one for one in alone if not one.name.startswith(UNNAMED) and one.name not in MEDIATORS)
    return min((one.judged.loss for one in forces if not _no_force(one.name)), default=present.loss)


def _no_force(name: str) -> bool:
    return not name.startswith(UNNAMED) and EFFECTS[name].stage is not Stage.LOAD


def _curve_of_no_force(name: str) -> bool:
    signal = name.removeprefix(UNNAMED)
    stages = {effect.stage for effect in EFFECTS.values() if signal in effect.needs}
    return name.startswith(UNNAMED) and signal != PITCH and bool(stages) and Stage.LOAD not in stages
