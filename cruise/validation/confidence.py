"""How sure a verdict is: the least margin by which anything in the search might have gone the other way."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from cruise.effects import EFFECTS
from cruise.validation.candidates import MEDIATORS, UNNAMED
from cruise.validation.foretold import CHANCE, LEAST_TOLD, Foretold
from cruise.validation.judged import Judged, noise_in
from cruise.validation.selection import FURTHER, LEAST_FURTHER, LEAST_IN_ALL, Selected, least_share
from cruise.validation.tried import (
    ALL_OF_IT,
    BEYOND_DOUBT,
    ENOUGH,
    NEARLY,
    Step,
    Tried,
    asked,
    asked_alone,
    enough,
    share_of_all,
    soil_short,
    step_of,
    tried_in,
    whole,
)

LEAST_FORETOLD: Final = 0.15  # of the first loss, that the catch-all must foretell for something to be missing,
LEAST_BESIDE: Final = 0.25  # and of what the named effects explain, for them to be no more than substitutes
LEAST_UNTOLD: Final = 3.5  # RMS of the error over the noise, from which no soil explains it where nothing foretells it
MOMENT_S: Final = 3.0  # s of a window of the error,
FEWEST: Final = 0.05  # of which so many, the worst, hold of its square
MOST_THERE: Final = 0.5  # at most where nothing is missing: noise has 0.1 there, soil up to 0.28;
SEEN: Final = 1.5  # RMS of the error over the noise, likewise: with less it is hardly there
MOST_LEFT: Final = 0.6  # of what could be explained: with less, it may be the wrong form of what was found,
ABOVE: Final = 4.0  # loss over the noise, likewise
CURVES: Final[Mapping[str, tuple[float, float]]] = {
    "nothing": (15.0, 2.5),
    "measured": (8.0, 1.4),
    "inferred": (4.0, 1.2),
    "smooth": (13.0, 1.05),
    "several": (7.0, 0.8),
    "ambiguous": (1.2, 0.7),
    "unlisted": (18.0, 0.7),
}
"""M and k of every kind of answer, by hand between those that some 400 drives of the virtual combine have given and
those that fit best to the answers on 491 drives of five independent simulators: each has 9 to 85 of these. Fitted to
two simulators, the Brier score of a third falls by 0.008 to 0.025. That of several effects was lowered after 49 such
answers on three later simulators and the virtual combine, of which 0.49 were right at a stated mean of 0.68, and raised
half the way after 32 that a later search gave on four others and there, of which 29 were right at a mean of 0.71."""
SMOOTH: Final = frozenset({"coulomb_friction", "rolling_resistance", "quadratic_gain", "wheel_slip", "sensor_bias"})
"""Effects without a threshold, a stop, a memory or a signal of their own: over the range that was driven many other
effects bend much the same way, and they are what is named where such a one is in no table."""
OWN: Final = frozenset({"engine_speed_rpm", "engine_load_pct", "gear", "oil_temperature_c", "pitch_deg"})
"""Signals of one effect's own cause: an effect that none of them shows is inferred from current and speed, or from
what trends along."""
LEFT: Final = 0.8
"""X. Of 34 answers of one effect on four simulators that left 0.2 or more, 20 were right at a stated mean of 0.80; of
80 that left less, 77 at 0.91; in the virtual combine's field 10 of 13. Leaving one simulator out, the Brier score of
its answers with effects falls by 0.001 to 0.014 for three of them, and rises by 0.012 for one."""
LEAST_MARGIN: Final = 1.0  # where another does better in its place: seldom right, and not never


def excess(hidden: Foretold, base: Judged, final: Judged, white_mps: float = 0.0) -> float:
    """What the catch-all foretells, over what it has to for something unlisted to be missing.

    Of white noise nobody foretells anything: what counts is the share of the rest.
    """
    white = noise_in(hidden.left, white_mps)
    least = max(LEAST_FORETOLD * (max(base.loss, hidden.left) - white), LEAST_BESIDE * (base.loss - final.loss))
    rest = hidden.share * hidden.left / (hidden.left - white) if hidden.left > 0.0 else hidden.share
    return min(rest / CHANCE, hidden.share / LEAST_TOLD, hidden.loss / least)


def in_moments(error_mps: np.ndarray, period_s: float) -> float:
    """How much of the squared error stands in the worst twentieth of the time.

    Noise and soil are everywhere; a stop or a limit that is seldom reached errs there and nowhere else.
    """
    errors = error_mps[np.isfinite(error_mps)]
    window = max(round(MOMENT_S / period_s), 1)
    count = len(errors) // window
    few = math.floor(FEWEST * count)
    if not few or not errors.any():
        return 0.0
    squares = np.sort(np.square(errors[: count * window]).reshape(count, window).sum(axis=1))
    return float(squares[-few:].sum() / squares.sum())


def untold(found: Selected, drift: float, period_s: float) -> float:
    """How much of an error nothing explains or foretells, over what it may be where nothing more is missing.

    Without effects that is its RMS over the noise, or how much of it stands in few moments; beside effects what they
    leave of all that could be explained, (L - s^2) / (L_0 - s^2), L loss, s^2 noise: what leaves most of it is not what
    is missing. Of that the `drift` in m2/s2 that a clock foretells is taken away first: soil has that, and hides no
    effect that explains the rest.
    """
    noise = found.steps[-1].background.noise
    if not found.chosen:
        times, there = math.sqrt(found.final.loss / noise), in_moments(found.final.fit.error_mps, period_s)
        return max(times / LEAST_UNTOLD, min(there / MOST_THERE, times / SEEN))
    loss, before = (max(one.loss - drift, 0.0) for one in (found.final, found.steps[0].before))
    left = (loss - noise) / max(before - noise, noise)
    return min(max(left, 0.0) / MOST_LEFT, loss / noise / ABOVE)


def answer_of(verdict: str, effects: Sequence[str]) -> str:
    """The kind of an answer, as `CURVES` knows it: several effects are one answer, and seldom all right."""
    if verdict != "missing":
        return verdict
    if len(effects) > 1:
        return "several"
    if OWN & set(EFFECTS[effects[0]].needs):
        return "measured"
    return "smooth" if effects[0] in SMOOTH else "inferred"


def confidence_of(margin: float, answer: str, left: float = 0.0) -> float:
    """Confidence of a margin m, 1 / (1 + (M / m)^k) / (1 + (x / X)^2); M, k and X as blind trials have it.

    `left` is x, how near what is left beside the effects is to something else that is missing (`LeftOver.missing`).
    """
    half, steepness = CURVES[answer]
    return 1.0 / (1.0 + (half / max(margin, LEAST_MARGIN)) ** steepness) / (1.0 + (max(left, 0.0) / LEFT) ** 2)


def margin_of_the_end(found: Selected) -> float:
    """Evidence by which the search was short of going on or of ending earlier; for a curve, by which it has a say."""
    if found.curved:
        return found.curve_margin
    taken = [(step, tried_in(step, name)) for name in found.chosen for step in [step_of(found.steps, name)]]
    over = [_over(one, step) for step, one in taken if one is not None and one.sureness < BEYOND_DOUBT]
    mediated = [ENOUGH * step.mediated for step in found.steps if step.taken in MEDIATORS]
    return max(min([*_short(found), *over, *mediated], default=ENOUGH), LEAST_MARGIN)


def _over(one: Tried, step: Step) -> float:
    """Evidence by which an effect is more than asked, or what stands for it where it takes nearly all."""
    rest = (share_of_all(one, step) - ALL_OF_IT) / (1.0 - ALL_OF_IT)
    more, least = (one.counted - share * asked(one.gain) for share in (1.0, NEARLY))
    return max(more, 0.5 * least, ENOUGH * min(rest, 1.0) if whole(one, step) else 0.0)


def _short(found: Selected) -> list[float]:
    """By how much all that was tried last was short of being one effect more, in evidence or what is worth as much."""
    last = found.steps[-1]
    evidence, least = (FURTHER, LEAST_FURTHER) if found.chosen else (ENOUGH, LEAST_IN_ALL)
    rest = [one for one in last.tried if one.name not in found.chosen and not one.name.startswith(UNNAMED)]
    asks = [FURTHER if found.chosen else asked_alone(one) for one in rest]
    short = [
        max(1.0 - one.counted / least_evidence, 1.0 - max(one.gain, 0.0) / least)
        for one, least_evidence in zip(rest, asks, strict=True)
    ]
    if not found.chosen and last.mediated < 0.0:  # it is all but named
        nearly = (one for one in last.tried if one.name in MEDIATORS and enough(replace(one, credit=1.0)))
        short += [-last.mediated for _ in nearly]
    if found.chosen and not last.taken:
        loss = found.steps[-2].before.loss
        shares = [(last.before.loss - one.judged.loss) / loss / least_share(one, found.chosen) for one in rest]
        short = [
            max(so_far, 1.0 - share, soil_short(one)) for so_far, share, one in zip(short, shares, rest, strict=True)
        ]
    return [evidence * one for one in short]
