"""A curve without physics, held against the effects: whether it has the word instead of them."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from cruise.effects import EFFECTS, Stage
from cruise.signals import INPUT, OUTPUT
from cruise.validation.candidates import MEDIATORS, UNNAMED
from cruise.validation.judged import Judged, sureness
from cruise.validation.laws import SEED, law_of
from cruise.validation.mediator import MEDIATED, unknown
from cruise.validation.tried import (
    APART,
    ENOUGH,
    LEAST_GAIN,
    LOOSE,
    SURE,
    Step,
    Tried,
    counted,
    enough,
)
from cruise.validation.unnamed import SPEED

LEAST_CURVED: Final = 0.45  # of the loss, that a free curve must explain to have the word,
PLAINLY_CURVED: Final = (0.3, 180.0, 5.0)  # or so much, with evidence and standard errors that no soil has
CURVED: Final = (60.0, 0.05)  # evidence, and share of it, by which a free curve must exceed all effects
FAR: Final = 0.25  # of what all effects leave above the noise: a curve that leaves less has the word, and
LESS: Final = 0.7  # of what they leave in all, with as much evidence; clearly less, with more,
ABOUT: Final = 0.1  # which is as much while it differs by no more than this share
CLEARLY: Final = 0.6  # of what the best effect leaves where every force is known: all that a curve may leave there
SAME_SIGNAL: Final = 0.85  # of what a curve takes away: an effect of the same signal that takes as much is the curve
OF_THE_CURRENT: Final = 0.98  # the same of the current, of which there are many laws that are much alike
WHITE: Final = 1.05  # of the noise: a curve that leaves no more, where the effects surely do, has left nothing out,
WHITE_GAIN: Final = 0.3  # and takes so much of the loss
WITNESS: Final = "wheel_speed_mps"  # shows all that happens between wheel and ground, whatever the cause:
WITNESSED: Final = 0.85  # of the evidence for what reads it, from which a cause that leaves no more is the cause


def curve_with_the_word(first: Step, chosen: float, present: Judged) -> tuple[Tried | None, float]:
    """The curve without physics that has the word, if one has, and by which margin.

    `chosen` is the evidence for the effects together, `present` the model with them. Soil that nobody recorded, which
    every field has, shows in what the drive itself moves: such a curve has to leave as little as `MEDIATED` asks of it.
    """
    curves = [one for one in first.tried if one.name.startswith(UNNAMED) and enough(one)]
    best = max((one for one in curves if _curves(one)), key=counted, default=None)
    white = [one for one in curves if _leaves_nothing(one, first, chosen, present)]
    tried = [*sorted(white, key=lambda one: one.compared.loss), *([best] if best is not None else [])]
    margins = ((one, _margin(one, first, chosen, present, one in white)) for one in tried)
    return next(((one, margin) for one, margin in margins if margin > 0.0), (None, 0.0))


def curve_that_shows(first: Step) -> Tried | None:
    """The curve for which there is far more evidence than for any effect, though it takes too little to have the word.

    What acts in few moments, as a stop does that is seldom reached, takes no more. Where something is missing all the
    same, and nothing foretells it, this is what it depends on.
    """
    curves = [one for one in first.tried if one.name.startswith(UNNAMED) and one.credit == 1.0 and enough(one)]
    best = max(curves, key=counted, default=None)
    effects = max((one.counted for one in first.tried if not one.name.startswith(UNNAMED)), default=0.0)
    if best is None or best.gain < PLAINLY_CURVED[0]:
        return None
    return best if best.counted * (1.0 - CURVED[1]) - CURVED[0] > effects else None


def _margin(curve: Tried, first: Step, chosen: float, present: Judged, all_of_it: bool) -> float:
    """By which margin a curve has the word; none above 0 where it hasn't. `all_of_it`: it leaves nothing but noise."""
    named = [one for one in first.tried if not one.name.startswith(UNNAMED)]
    left = present.loss
    if curve.judged.loss >= left:
        return 0.0
    direct = [one.compared.loss for one in named if one.name not in MEDIATORS and one.sureness >= SURE]
    mine = curve.name.removeprefix(UNNAMED)
    witnessed = unknown(mine) and _witnessed(named, curve)
    most = 1.0 if witnessed or all_of_it else 1.0 / LOOSE if curve.credit == 1.0 else MEDIATED
    if first.forces is not None:  # soil, too
        most, left = CLEARLY, min(direct, default=left)
    if curve.compared.loss >= min([most * left, *direct]):
        return 0.0
    effects = max([chosen, *(one.counted for one in named if one.gain >= LEAST_GAIN)])
    margin = curve.counted - CURVED[0] - CURVED[1] * curve.counted - effects
    noise = first.background.noise
    less = 1.0 if all_of_it else 1.0 / LOOSE if curve.counted >= (1.0 + ABOUT) * effects else LESS
    if effects <= (1.0 + ABOUT) * curve.counted and curve.compared.loss < less * left and left > noise:
        margin = max(margin, ENOUGH * (1.0 - max(curve.compared.loss - noise, 0.0) / (FAR * (left - noise))))
    if witnessed and curve.counted >= WITNESSED * effects:
        margin = max(margin, ENOUGH * (curve.counted / effects - WITNESSED) / (1.0 - WITNESSED))
    return 0.0 if any(_is_the_curve(one, curve, first) for one in named) else margin


def _is_the_curve(one: Tried, curve: Tried, first: Step) -> bool:
    """Whether an effect takes so much of what a curve of its own signal takes that it is the curve, in its own form."""
    mine = curve.name.removeprefix(UNNAMED)
    by_current = law_of(one.name) == mine == INPUT
    if not by_current and not of_the_same(one.name, mine):
        return False
    taken = (first.before.loss - one.judged.loss) / (first.before.loss - curve.judged.loss)
    return enough(one) and taken >= (OF_THE_CURRENT if by_current else SAME_SIGNAL)


def _leaves_nothing(curve: Tried, first: Step, chosen: float, present: Judged) -> bool:
    """Whether it leaves nothing but noise, where the effects, if there are any, surely leave more.

    Soil that nobody recorded is in no curve, so that less of the error is enough.
    """
    white = curve.compared.loss <= WHITE * first.background.noise
    more = white and curve.credit == 1.0 and curve.gain >= WHITE_GAIN
    return more and (not chosen or _clearly(curve, present))


def _clearly(one: Tried, present: Judged) -> bool:
    """Whether it leaves less than the model with the effects, whatever the evidence."""
    return sureness(present, one.judged, np.random.default_rng(SEED)) >= APART


def effects_are_more(curve: Tried, chosen: Sequence[str], last: Step) -> bool:
    """Whether a curve of a signal through which the effects act errs less only by a little of something else.

    What that is, such as dry friction in a curve of the current that knows the direction, need not be enough to be
    named beside them. Where the curve leaves nothing but noise, one more of them has to leave no more.
    """
    known = {signal for name in chosen for signal in acts_through(name)}
    named = [one for one in last.tried if not one.name.startswith(UNNAMED) and one.credit > 0.0]
    least = min((one.judged.loss for one in named), default=last.before.loss)
    white = curve.compared.loss <= WHITE * last.background.noise
    return curve.name.removeprefix(UNNAMED) in known and least < (WHITE if white else LOOSE) * curve.judged.loss


def _witnessed(named: Sequence[Tried], curve: Tried) -> bool:
    """Whether all effects that could stand in the curve's place read the witness, and leave no less."""
    rivals = [one for one in named if one.counted >= WITNESSED * curve.counted and one.gain >= LEAST_GAIN]
    return bool(rivals) and all(
        WITNESS in EFFECTS[one.name].needs and one.compared.loss >= curve.compared.loss for one in rivals
    )


def of_the_same(name: str, signal: str) -> bool:
    """Whether an effect of the table is a law of this recorded signal, or of the model's speed and no recorded one."""
    return law_of(name) == SPEED if signal == SPEED else signal in EFFECTS[name].needs and signal != OUTPUT


def _curves(one: Tried) -> bool:
    """Whether a free curve explains enough to have the word."""
    least, evidence, sure = PLAINLY_CURVED
    plainly = one.gain >= least and one.counted >= evidence and one.sureness >= sure
    return plainly or one.gain >= LEAST_CURVED


def acts_through(name: str) -> frozenset[str]:
    """The signals that an effect of the table reads, the current and the model's speed among them."""
    kind = EFFECTS[name]
    signals = {INPUT} if kind.stage in (Stage.COMMAND, Stage.DYNAMICS) else set()
    return frozenset({*signals, *kind.needs} | ({SPEED} if kind.reads_speed or OUTPUT in kind.needs else set()))
