"""How much of what a candidate explains counts: none of it where it is known to stand in for something else.

A consequence of the drive (engine load, line pressure) has less than a cause from the beginning (`candidates.py`). What
stands here takes from one candidate what the others that were tried beside the same explanation show to be theirs.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from cruise.effects.power_limit import PowerLimit
from cruise.validation.candidates import MEDIATORS, UNNAMED, Candidate, EffectCandidate
from cruise.validation.explanation import RINGS
from cruise.validation.judged import Judged, gain
from cruise.validation.search import AT_BOUND, Search
from cruise.validation.slope import PITCH
from cruise.validation.tried import LEAST_GAIN, LOOSE, RESISTANCE

OF_BOTH_SPEEDS: Final = frozenset({"wheel_slip", "sensor_bias"})  # read the difference of wheel and ground speed
OF_THE_SLOPE: Final = 0.3  # of what a grade takes away, that a curve of the slope must take, too: one took 0.8 or more
SURE_OF_SLIP: Final = 1.5  # standard errors: slip had 0.3 or more in 16 drives of 17, a bias -1.6 or less in 6 of 7
AS_MUCH: Final = 0.9  # of what the one takes away, that the other must take for it to be the other
PLAIN: Final = 0.5  # of what the best cause leaves: with less, a consequence of the drive is a cause all the same
LATER: Final = 1.2  # times what lies between current and speed: seven limits had at most 0.5 s, and what was none had
# 1.4 to 2 s in four drives of eight
HOLDING: Final = ("crop_load",)  # holds the machine back as dry friction does, by the mean of its signal alone:
OWN: Final = 0.25  # of what it takes away, that friction must leave for the signal to say anything,
OWN_TOLD: Final = 0.15  # and this share must be left where the pressure tells what of the signal the drive moves


def credits_of(
    search: Search, present: Judged, judged: Sequence[Judged], everyone: Sequence[Candidate], chosen: Sequence[str]
) -> dict[str, float]:
    """The share (0..1) of its evidence that counts, of every candidate; `chosen` are the effects found so far."""
    credit = {one.name: one.credit for one in everyone}
    held = min((one.loss for one in judged if one.candidate in RESISTANCE), default=present.loss)
    causes = [one.loss for one in judged if credit[one.candidate] == 1.0 and one.candidate not in MEDIATORS]
    for one in judged:
        if not one.candidate.startswith(UNNAMED) and one.loss < PLAIN * min([present.loss, *causes]):
            credit[one.candidate] = 1.0
        if one.candidate in HOLDING and gain(present, one) >= LEAST_GAIN:
            told = _by_pressure(search, present, one, everyone)
            if not of_its_own(present.loss, one.loss, told.loss, held):
                credit[one.candidate] = 0.0
    if stands_in_for_dead_time(search, judged) or not rings(judged):
        credit["resonance"] = 0.0
    if takes_acceleration_for_slope(present, judged):
        credit["grade"] = 0.0
    credit |= dict.fromkeys(taken_for_the_other(search, present, judged), 0.0)
    if not OF_BOTH_SPEEDS.isdisjoint(chosen):  # what one leaves of the difference that both read is its own form
        credit |= dict.fromkeys(OF_BOTH_SPEEDS, 0.0)
    return credit


def stands_in_for_dead_time(search: Search, judged: Sequence[Judged]) -> bool:
    """Whether a resonance needs all the dead time that there may be, and more of it leaves hardly more, or is not to be
    had."""
    found = {one.candidate: one for one in judged}
    resonance = found.get("resonance")
    if resonance is None:
        return False
    delay = found.get("transport_delay", resonance)
    core, most_s = resonance.explanation.core, search.most_delay_s(resonance.explanation)
    late = core.delay_s > (1.0 - AT_BOUND) * most_s
    return late and delay.loss < LOOSE * resonance.loss


def rings(judged: Sequence[Judged]) -> bool:
    """Whether a resonance, if one is tried, swings back by a sixth or more: else a response is quick and then slow."""
    damping = [one.explanation.core.damping for one in judged if one.candidate == "resonance"]
    return all(one < RINGS for one in damping)


def lingers(one: Judged) -> bool:
    """Whether it is a limit of the power that the machine follows later than it follows the current.

    Nothing does that. Soil and loads that the pressure shows, too, are what is fitted so.
    """
    if one.candidate != PowerLimit.name:
        return False
    late_s, effects = LATER * one.explanation.core.behind_s, one.explanation.effects
    return any(isinstance(it, PowerLimit) and "follow_s" not in it.idle and it.follow_s > late_s for it in effects)


def taken_for_the_other(search: Search, present: Judged, judged: Sequence[Judged]) -> tuple[str, ...]:
    """Slip where the two speeds differ by a bias, or the bias where they differ by slip, if the other takes as much.

    Both read the same difference, and follow it however it comes about.
    """
    if abs(search.sure_of_slip) < SURE_OF_SLIP:
        return ()
    it, other = ("wheel_slip", "sensor_bias") if search.sure_of_slip > 0.0 else ("sensor_bias", "wheel_slip")
    taken = {one.candidate: present.loss - one.loss for one in judged}
    return (other,) if it in taken and taken[it] > AS_MUCH * taken.get(other, math.inf) else ()


def takes_acceleration_for_slope(present: Judged, judged: Sequence[Judged]) -> bool:
    """Whether a grade explains what the pitch sensor shows of the machine's swinging: any curve of the slope itself,
    which has no acceleration in it, takes away far less."""
    found = {one.candidate: present.loss - one.loss for one in judged}
    slope = found.get(f"{UNNAMED}{PITCH}")
    return slope is not None and "grade" in found and slope < OF_THE_SLOPE * found["grade"]


def _by_pressure(search: Search, present: Judged, one: Judged, everyone: Sequence[Candidate]) -> Judged:
    """A candidate as it is where line pressure says what of its signal the drive moves itself, if that is recorded."""
    candidate = next(candidate for candidate in everyone if candidate.name == one.candidate)
    if not isinstance(candidate, EffectCandidate) or len(candidate.told) == 1:
        return one
    return search.judged(one.candidate, search.grown(present.explanation, replace(candidate, told=candidate.told[:1])))


def of_its_own(before: float, one: float, told: float, held: float) -> bool:
    """Whether a signal says something of its own, beyond soil that shows in it and what holds the machine back anyhow.

    Losses: without it, with it, with it less what the pressure tells of the drive, with friction alone.
    """
    taken = before - told
    return taken >= OWN_TOLD * (before - one) and held - told >= OWN * taken
