"""What of the recordings a fit has not seen: blocks of long ones, short ones whole.

A long recording is cut into `count` contiguous blocks; fold i leaves block i out. What remains on either side of it
stays two recordings: a state is never carried across. Where there are many recordings, those too short for blocks are
dealt to the folds whole: filter and horizon leave nothing of what remains of them otherwise. Source: C. Bergmeir, J. M.
Benitez, Information Sciences 191 (2012) 192-213 (blocked cross-validation for time series).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from cruise.recording import MIN_SAMPLES, Recording

FOLDS: Final = 5
SHORTEST_BLOCK_S: Final = 10.0  # s: 3 s of horizon, the paper's filter rings 2 s at either end of what remains


@dataclass(frozen=True, slots=True)
class Fold:
    """What a fit sees, and on which samples it is judged: one slice a recording, empty where there are none."""

    training: tuple[Recording, ...]
    unseen: tuple[slice, ...]


def folds(recordings: Sequence[Recording], count: int = FOLDS) -> list[Fold]:
    """`count` folds over all recordings; every sample is unseen in one of them."""
    result = []
    for i in range(count):
        training, unseen = [], []
        for place, recording in enumerate(recordings):
            block = _block(recording, place, i, count, len(recordings) >= count)
            parts = recording[: block.start], recording[block.stop :]
            training += [part for part in parts if len(part) >= MIN_SAMPLES]
            unseen.append(block)
        result.append(Fold(tuple(training), tuple(unseen)))
    return result


def _block(recording: Recording, place: int, fold: int, count: int, many: bool) -> slice:
    """What the fold leaves out of the recording at `place`."""
    samples = len(recording)
    if many and samples * recording.dt_s < count * SHORTEST_BLOCK_S:
        return slice(0, samples if place % count == fold else 0)
    return slice(samples * fold // count, samples * (fold + 1) // count)
