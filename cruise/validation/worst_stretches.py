"""The worst stretches in time: where the error is gathered, longer than a spike and shorter than a regime.

    maximise over [i, j)  sum_(k=i..j-1) (e_k^2 - 2 RMS^2),    then again over what is left

e error in m/s, RMS over all recordings. A stretch grows as long as it pays: its mean squared error is more than twice
that of all time. All such stretches at once, disjoint: W. L. Ruzzo, M. Tompa, Proc. 7th Int. Conf. Intelligent Systems
for Molecular Biology (1999) 234-241 (all maximal scoring subsequences, linear time).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate
from typing import Final

import numpy as np

from cruise.recording import Recording
from cruise.signals import INPUT, OUTPUT
from cruise.validation.quantities import ACCELERATION, RATE, SINCE, Quantity, quantities, short

TIMES: Final = 2.0  # the mean squared error of a stretch is more than so many times that of all time
COUNT: Final = 5
SHORTEST_S: Final = 1.0  # s; a single spike is the sensor's
ONE_SIDED: Final = 0.8  # of the RMS: a mean error that large means that the model errs to one side
UNUSUAL: Final = 1.0  # standard deviations that a signal's mean is off its own, from which it is worth a word
MOVED: Final = 1.0  # standard deviations that a signal moves from the stretch's beginning to its end
WORDS: Final = 3  # signals that a stretch is described by, at most


@dataclass(frozen=True, slots=True)
class Stretch:
    """One stretch: samples `start:stop` of recording number `recording`, its times, its share of the squared error."""

    recording: int
    start: int
    stop: int
    start_s: float
    end_s: float
    error_share: float
    rmse_mps: float
    mean_error_mps: float
    error_words: str  # "the machine is 0.21 m/s slower than predicted"
    signal_words: tuple[str, ...]  # what was unusual, the most unusual first

    @property
    def sentence(self) -> str:
        """What happened, in one line."""
        return ", ".join((self.error_words, *self.signal_words))


def worst_stretches(
    recordings: Sequence[Recording], errors_mps: Sequence[np.ndarray], count: int = COUNT
) -> tuple[Stretch, ...]:
    """At most `count` stretches of the errors (N,) per recording, ranked by their share of the squared error."""
    joined = np.concatenate([error[np.isfinite(error)] for error in errors_mps])
    total = float(joined @ joined)
    if not total > 0.0:
        return ()
    threshold = TIMES * total / len(joined)
    found = []
    for number, (one, error) in enumerate(zip(recordings, errors_mps, strict=True)):
        squared = np.nan_to_num(error**2)
        for start, stop in maximal_stretches(squared - threshold):
            if (stop - start) * one.dt_s >= SHORTEST_S:
                found.append((float(squared[start:stop].sum()), number, start, stop))
    found.sort(reverse=True)
    described = quantities(recordings)
    first = [0, *accumulate(len(one) for one in recordings)]
    return tuple(
        _described(
            recordings[number], errors_mps[number], number, start, stop, energy / total, described, first[number]
        )
        for energy, number, start, stop in found[:count]
    )


def maximal_stretches(scores: np.ndarray) -> list[tuple[int, int]]:
    """All maximal scoring subsequences of `scores` (N,) as start and one past the end, in order (Ruzzo and Tompa)."""
    # start, stop, the running sum before and after, and the place of the nearest earlier one with less before it
    kept: list[tuple[int, int, float, float, int]] = []
    total = 0.0
    for k, score in enumerate(scores.tolist()):
        before, total = total, total + score
        if score <= 0.0:
            continue
        start, place = k, len(kept) - 1
        while True:
            while place >= 0 and kept[place][2] >= before:
                place = kept[place][4]
            if place < 0 or kept[place][3] >= total:
                kept.append((start, k + 1, before, total, place))
                break
            start, _, before, _, earlier = kept[place]
            del kept[place:]
            place = earlier
    return [(start, stop) for start, stop, *_ in kept]


def _described(
    one: Recording,
    error: np.ndarray,
    number: int,
    start: int,
    stop: int,
    share: float,
    described: Sequence[Quantity],
    first: int,
) -> Stretch:
    part = error[start:stop]
    part = part[np.isfinite(part)]
    mean, rmse = float(part.mean()), float(np.sqrt(np.mean(part**2)))
    words = []
    for quantity in described:
        if not quantity.states and quantity.key not in (SINCE, RATE):
            said = _unusual(quantity, slice(first + start, first + stop))
            if said is not None:
                words.append(said)
    words.sort(reverse=True)
    return Stretch(
        recording=number,
        start=start,
        stop=stop,
        start_s=float(one.time_s[start]),
        end_s=float(one.time_s[stop - 1]),
        error_share=share,
        rmse_mps=rmse,
        mean_error_mps=mean,
        error_words=_error_words(mean, rmse),
        signal_words=tuple(text for _, text in words[:WORDS]),
    )


def _error_words(mean: float, rmse: float) -> str:
    if abs(mean) < ONE_SIDED * rmse:
        return f"{rmse:.2g} m/s off to both sides"
    return f"{abs(mean):.2g} m/s {'faster' if mean > 0.0 else 'slower'} than predicted"


def _unusual(quantity: Quantity, samples: slice) -> tuple[float, str] | None:
    """How unusual a quantity is within the stretch, in standard deviations, and in words; None where it isn't."""
    values, all_values = quantity.values[samples], quantity.values
    known = values[np.isfinite(values)]
    spread = float(np.nanstd(all_values))
    if not len(known) or not spread > 0.0:
        return None
    off = (float(known.mean()) - float(np.nanmean(all_values))) / spread
    edge = max(len(known) // 4, 1)
    begins, ends = float(known[:edge].mean()), float(known[-edge:].mean())
    unit = f" {quantity.unit}" if quantity.unit else ""
    moved = (ends - begins) / spread
    if quantity.key != ACCELERATION and abs(moved) >= max(MOVED, abs(off)):
        turn = "rising" if moved > 0.0 else "falling"
        return abs(moved), f"{quantity.words} {turn} from {short(begins)} to {short(ends)}{unit}"
    if abs(off) < UNUSUAL:
        return None
    mean = float(known.mean())
    if quantity.key == ACCELERATION:
        return abs(off), f"{'accelerating' if mean > 0.0 else 'braking'} at {abs(mean):.2g} m/s2"
    if quantity.key == "pitch_deg" and mean * off > 0.0:
        return abs(off), f"{abs(mean):.2g} deg {'uphill' if mean > 0.0 else 'downhill'}"
    level = "high" if off > 0.0 else "low"
    name = {INPUT: "current", OUTPUT: "speed"}.get(quantity.key, quantity.words)
    return abs(off), f"{name} {level} at {short(mean)}{unit}"
