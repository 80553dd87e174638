"""Blocks of the recordings that a fit has not seen.

Every recording is cut into `folds` contiguous blocks; fold i leaves block i of each out. What remains on either side
of a block stays two recordings: a state is never carried across. Source: C. Bergmeir, J. M. Benitez, Information
Sciences 191 (2012) 192-213 (blocked cross-validation for time series).
"""

from collections.abc import Sequence
from dataclasses import dataclass

from cruise.recording import MIN_SAMPLES, Recording

FOLDS = 5


@dataclass(frozen=True, slots=True)
class Fold:
    """What a fit sees, and what it is judged on."""

    training: tuple[Recording, ...]
    unseen: tuple[Recording, ...]


def folds(recordings: Sequence[Recording], count: int = FOLDS) -> list[Fold]:
    """`count` folds over all recordings; the start and end of every block are samples, so each is judged once."""
    result = []
    for i in range(count):
        training, unseen = [], []
        for recording in recordings:
            start, stop = (len(recording) * j // count for j in (i, i + 1))
            training += [part for part in (recording[:start], recording[stop:]) if len(part) >= MIN_SAMPLES]
            unseen += [recording[start:stop]] if stop - start >= MIN_SAMPLES else []
        result.append(Fold(tuple(training), tuple(unseen)))
    return result
