"""Slow steady ramps of the current, as a recording holds them: the slope of the current, smoothed, keeps its size."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy import signal

from cruise.identification.explore.pieces import Piece, pieces
from cruise.model.prediction import runs
from cruise.recording import Recording

WINDOW_S: Final = 4.0  # s, over which the slope of the current is looked at
SHORTEST_RAMP_S: Final = 10.0  # s, ten times the drive's lag
SMALLEST_SPAN: Final = 0.2  # of the whole range of the current: less is no curve
STEADY: Final = 0.3  # a slope within this part of the ramp's median slope is steady
STRAIGHT: Final = 0.02  # of its span, by which a ramp may depart from a straight line (RMS)


@dataclass(frozen=True, slots=True)
class Ramp:
    """One steady ramp of the current."""

    source: str
    start_s: float
    stop_s: float
    rate_ma_per_s: float


def ramps(recordings: Sequence[Recording]) -> list[Ramp]:
    """Return the slow steady ramps of the current in all recordings."""
    return [ramp for _, ramp in ramps_with_samples(recordings)]


def ramps_with_samples(recordings: Sequence[Recording]) -> list[tuple[Piece, Ramp]]:
    """Return each ramp with its samples."""
    whole = [(recording.source, piece) for recording in recordings for piece in pieces([recording])]
    if not whole:
        return []
    range_ma = float(np.ptp(np.concatenate([piece.current_ma for _, piece in whole])))
    found = []
    for source, piece in whole:
        for start, stop in _stretches(piece, range_ma):
            part = slice(start, stop)
            time_s = piece.start_s + piece.dt_s * np.arange(start, stop)
            rate, level = np.polyfit(time_s - time_s[0], piece.current_ma[part], 1)
            straight = level + rate * (time_s - time_s[0])
            span_ma = abs(float(straight[-1] - straight[0]))
            departure_ma = float(np.sqrt(np.mean((piece.current_ma[part] - straight) ** 2)))
            if span_ma < SMALLEST_SPAN * range_ma or departure_ma > STRAIGHT * span_ma:
                continue
            samples = Piece(float(time_s[0]), piece.dt_s, piece.current_ma[part], piece.speed_mps[part])
            found.append((samples, Ramp(source, float(time_s[0]), float(time_s[-1]), float(rate))))
    return found


def _stretches(piece: Piece, range_ma: float) -> list[tuple[int, int]]:
    """Return the longest steady part of every stretch in which the current keeps moving one way."""
    size = max(round(WINDOW_S / piece.dt_s) | 1, 5)
    shortest = round(SHORTEST_RAMP_S / piece.dt_s)
    if len(piece) < max(size, shortest) or range_ma == 0.0:
        return []
    smooth = np.asarray(signal.savgol_filter(piece.current_ma, size, 1))
    slope = np.asarray(signal.savgol_filter(piece.current_ma, size, 1, deriv=1, delta=piece.dt_s))
    noise_ma = 1.4826 * float(np.median(np.abs(piece.current_ma - smooth)))
    # 4 standard errors of a slope through `size` noisy samples, and never slower than the range in half an hour.
    least = 4.0 * noise_ma * np.sqrt(12.0 / size**3) / piece.dt_s + range_ma / 1800.0
    found = []
    for sign in (1.0, -1.0):
        for run in runs(sign * slope > least):
            if run.stop - run.start < shortest:
                continue
            steady = np.abs(slope[run] / np.median(slope[run]) - 1.0) <= STEADY
            longest = max(runs(steady), key=lambda part: part.stop - part.start, default=slice(0, 0))
            if longest.stop - longest.start >= shortest:
                found.append((run.start + longest.start, run.start + longest.stop))
    return sorted(found)
