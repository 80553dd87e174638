"""A swing in the error: something that turns or swings at a pace of its own, and that no recorded signal shows.

    ratio  P(f) / M(f)        share  sum_(|g - f| < f / 6) max(P(g) - M(f), 0) / sum_g P(g)

P power density of the error over the frequency in Hz, M its median within an octave of f either way, f's own band left
out. Noise, soil and the wrong form of an effect are smooth there; what an operator's hand or the ground brings is in
the current or in a signal. Source: P. D. Welch, IEEE Trans. Audio and Electroacoustics 15 (1967) 70-73.
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy import signal

SEGMENT_S: Final = 150.0  # s of one of the pieces whose spectra are averaged, or a quarter of what there is
SLOWEST_HZ: Final = 0.03  # Hz: slower, soil wanders
BAND: Final = 6.0  # of its frequency, half a band: what turns in a field keeps no exact time
NEIGHBOURS: Final = 6  # frequencies of which a median says anything
RATIO: Final = 12.0  # from which something swings: where nothing did, up to 9 were seen in 60 recordings,
SHARE: Final = 0.35  # with so much of the error's power: there up to 0.31
OWN: Final = 3.0  # times the ratio of the current, which may have been moved at that very pace


@dataclass(frozen=True)
class Swing:
    """The strongest swing: its period in s, how far it stands out, and its share of the power."""

    period_s: float = math.nan
    ratio: float = 0.0
    share: float = 0.0

    @property
    def much(self) -> float:
        """How much it is, over what something that swings must be."""
        return min(self.ratio / RATIO, self.share / SHARE)


def swing(error_mps: np.ndarray, current_ma: np.ndarray, period_s: float) -> Swing:
    """The strongest swing of the error (N,) that is not the current's (N,); holes count as no error."""
    frequencies, power = _spectrum(error_mps, period_s)
    _, moved = _spectrum(current_ma, period_s)
    found = [
        Swing(1.0 / frequencies[i], ratio, share)
        for i in range(len(frequencies))
        for ratio, share in [_standing_out(frequencies, power, i)]
        if ratio > OWN * _standing_out(frequencies, moved, i)[0]
    ]
    return max(found, key=lambda one: one.much, default=Swing())


def _spectrum(values: np.ndarray, period_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies (K,) in Hz and power density (K,) from the slowest on."""
    known = np.isfinite(values)
    if known.sum() * period_s < SEGMENT_S:
        return np.zeros(0), np.zeros(0)
    filled = np.where(known, values - values[known].mean(), 0.0)
    segment = min(len(values) // 4, round(SEGMENT_S / period_s))
    frequencies, power = signal.welch(filled, 1.0 / period_s, nperseg=segment, detrend="linear")
    return frequencies[frequencies > SLOWEST_HZ], power[frequencies > SLOWEST_HZ]


def _standing_out(frequencies: np.ndarray, power: np.ndarray, at: int) -> tuple[float, float]:
    """Ratio and share of one frequency."""
    away = np.abs(np.log2(frequencies / frequencies[at]))
    band = np.abs(frequencies - frequencies[at]) < frequencies[at] / BAND
    around = (away < 1.0) & ~band
    if around.sum() < NEIGHBOURS:
        return 0.0, 0.0
    usual = float(np.median(power[around]))
    above = np.maximum(power[band] - usual, 0.0).sum()
    return float(power[at]) / max(usual, 1e-300), float(above / max(power.sum(), 1e-300))
