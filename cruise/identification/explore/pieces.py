"""What every analysis starts from: the whole pieces of recordings, and the ways to say that data don't tell.

A piece is a stretch of one recording in which input and output were measured throughout: gaps split, nothing is joined.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from cruise.model.prediction import runs
from cruise.recording import Recording, RecordingError
from cruise.sampling import FloatArray

CONSTANT: Final = 1e-9  # relative spread below which a signal is constant: rounding of double precision, with room


@dataclass(frozen=True, slots=True)
class NotPossible:
    """An analysis that these data don't allow: `reason` says why and what to drive instead."""

    reason: str

    def words(self) -> list[str]:
        """Return the reason as the only sentence."""
        return [self.reason]


@dataclass(frozen=True, slots=True)
class Estimate:
    """An estimated figure and its standard error, in the unit of the field's name."""

    value: float
    std: float


@dataclass(frozen=True, eq=False)
class Piece:
    """Current in mA and speed in m/s, both (N,) and finite, from `start_s` on in steps of `dt_s`."""

    start_s: float
    dt_s: float
    current_ma: FloatArray
    speed_mps: FloatArray

    def __len__(self) -> int:
        return len(self.current_ma)

    @property
    def duration_s(self) -> float:
        """The time in s that the samples cover."""
        return len(self) * self.dt_s


def pieces(recordings: Sequence[Recording]) -> list[Piece]:
    """Return all whole pieces of all recordings, in order; raises RecordingError where the sampling periods differ."""
    found = []
    for recording in recordings:
        if not math.isclose(recording.dt_s, recordings[0].dt_s, rel_tol=1e-3):
            raise RecordingError(
                f"{recording.source} is sampled every {recording.dt_s:g} s, {recordings[0].source} every "
                f"{recordings[0].dt_s:g} s: give --period {max(one.dt_s for one in recordings):g} for all of them"
            )
        whole = np.isfinite(recording.input) & np.isfinite(recording.output)
        for part in runs(whole):
            start_s = float(recording.time_s[part.start])
            found.append(Piece(start_s, recording.dt_s, recording.input[part], recording.output[part]))
    return found


def centred(parts: Sequence[FloatArray]) -> list[FloatArray]:
    """Return the arrays, each without its own mean: experiments may differ in theirs."""
    return [part - np.mean(part) for part in parts]


def unmoved(whole: Sequence[Piece]) -> NotPossible | None:
    """Return why nothing dynamic can be found in these pieces, or None where input and output move."""
    if not whole:
        return NotPossible("no sample has both current and speed: record both")
    if _constant([piece.current_ma for piece in whole]):
        return NotPossible("the current is constant: drive `cruise experiment white_noise`, or steps")
    if _constant([piece.speed_mps for piece in whole]):
        return NotPossible(
            "the speed is constant while the current moves: see to its sensor, or choose another column with --output"
        )
    return None


def _constant(parts: Sequence[FloatArray]) -> bool:
    joined = np.concatenate(parts)
    return bool(np.ptp(joined) <= CONSTANT * np.max(np.abs(joined)))
