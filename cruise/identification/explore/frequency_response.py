"""Frequency response from current to speed, with coherence, confidence band, cut-off, bump and low-frequency lag.

    H(f) = S_uy(f) / S_uu(f),    C(f) = |S_uy|^2 / (S_uu S_yy),    s(f) = sqrt((1 - C) / (2 (n - 1) C))

H gain [m/s per mA] (H1, noise on the output), S spectra averaged over Hann windows with half overlap [unit^2/Hz], C
coherence [-], s standard error of the gain relative to the gain, and of the phase in rad [-], n number of independent
windows: K windows that overlap count as K^2 / sum_ij c_(i-j), c the squared correlation of two shifted windows [-].
Before the averaging the speed is moved back by the delay and the phase forward again, since a window that holds the
cause but not the effect makes gain and coherence too small.

Source: J.S. Bendat, A.G. Piersol, Random Data, 4th ed. 2010, sections 6.1.4, 9.2.3 and 9.2.4 (equation 9.90 for s, n
there; n - 1 makes Student's t with 2 (n - 1) degrees of freedom exact for Gaussian data), 11.5 (overlap, windows);
G.C. Carter, Proc. IEEE 75 (1987) 236 for the alignment.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy import optimize, signal, stats

from cruise.identification.explore.at_rest import at_rest
from cruise.identification.explore.pieces import Estimate, NotPossible, Piece, pieces, unmoved
from cruise.model.prediction import runs
from cruise.recording import Recording
from cruise.sampling import FloatArray

LONGEST_SEGMENT_S: Final = 20.0  # s, resolves 0.05 Hz: a twentieth of the drive's cut-off
SHORTEST_SEGMENT_S: Final = 3.5  # s, about five delays of the drive
WANTED_SEGMENTS: Final = 10  # shorten the windows until there are so many: the gain is then known to 1 dB at C = 0.9
FEWEST_SEGMENTS: Final = 4
LEAST_USED: Final = 0.7  # of the samples: many short recordings count for more than the resolution of a few long ones
FEWEST_BINS: Final = 16  # samples in a window
CONFIDENCE: Final = 0.95
RELIABLE_STD: Final = 0.25  # greatest relative standard error of a gain that says something: a band of about +- 4 dB
HALF_POWER_DB: Final = 10.0 * math.log10(0.5)
NEIGHBOURS: Final = 1.0 + 2.0 * (4.0 / 9.0 + 1.0 / 36.0)  # variance of a mean over Hann bins: correlated 4/9 and 1/36
PLATEAU: Final = 5.0  # lowest frequencies that a cut-off has to be above: else no low-frequency level is seen
MOSTLY: Final = 0.8  # of the bins below a cut-off have to be reliable
NARROW: Final = 1.12  # factor in frequency to either side, over which the gain is smoothed to see where it falls
WIDE: Final = 1.3  # and over which a straight line describes its fall
WIDEST: Final = 2.0  # factor between the ends of the 95 % interval: a cut-off known less well is none
SMALLEST_BUMP_DB: Final = 1.0  # dB, less is within what a smooth roll-off of another order could explain
BUMP_BINS: Final = 3  # neighbouring bins that have to stand out: by chance about once in a hundred responses
TREND_STD_DB: Final = 0.5  # dB, how well a smooth roll-off describes any drive: keeps sharp bins from ruling the trend


@dataclass(frozen=True, slots=True)
class Cutoff:
    """The frequency at which the gain is 3 dB below its low-frequency level, with its 95 % interval."""

    frequency_hz: float
    low_hz: float
    high_hz: float


@dataclass(frozen=True, slots=True)
class Bump:
    """A local maximum of the gain above its falling trend."""

    frequency_hz: float
    height_db: float


@dataclass(frozen=True, eq=False)
class FrequencyResponse:
    """The response at `frequency_hz` (M,); gains in dB are relative to the low-frequency gain, the 0 dB level."""

    frequency_hz: FloatArray
    gain_mps_per_ma: FloatArray
    gain_db: FloatArray
    gain_low_db: FloatArray
    gain_high_db: FloatArray
    phase_deg: FloatArray
    coherence: FloatArray
    low_frequency_gain_mps_per_ma: float
    reliable_to_hz: float
    cutoff: Cutoff | None
    bump: Bump | None
    lag_s: Estimate
    segment_s: float
    segments: int
    independent_segments: float

    def words(self) -> list[str]:
        """Return what the response says, in sentences."""
        top_hz = self.frequency_hz[-1]
        lag = self.lag_s
        later = f", {lag.value:.2f} +- {lag.std:.2f} s later" if math.isfinite(lag.value) else ""
        said = [
            f"{self.segments} windows of {self.segment_s:.3g} s; at low frequency 100 mA change the speed by "
            f"{100.0 * self.low_frequency_gain_mps_per_ma:.3g} m/s{later}"
        ]
        if self.cutoff is None:
            said.append(
                f"no cut-off found: the gain shows no clear level and fall of 3 dB from {self.frequency_hz[0]:.2g} to "
                f"{self.reliable_to_hz:.2g} Hz"
            )
        else:
            at = self.cutoff
            said.append(
                f"the drive passes up to {at.frequency_hz:.2f} Hz (-3 dB, 95 %: {at.low_hz:.2f}..{at.high_hz:.2f} Hz)"
            )
            upper_hz = min(3.0 * at.frequency_hz, self.reliable_to_hz)
            if self.bump is not None:
                said.append(f"a bump of {self.bump.height_db:.1f} dB stands out at {self.bump.frequency_hz:.2f} Hz")
            elif upper_hz > at.frequency_hz:
                said.append(f"no bump stands out of the band between {at.frequency_hz:.2f} and {upper_hz:.2f} Hz")
        above = self.coherence[self.frequency_hz > self.reliable_to_hz]
        if len(above):
            said.append(
                f"nothing can be said above {self.reliable_to_hz:.2g} Hz: coherence {np.median(above):.2f} there"
            )
        else:
            said.append(f"the response is known up to {top_hz:.2g} Hz, half the sampling rate")
        return said


@dataclass(frozen=True, eq=False)
class _Spectra:
    """Averaged spectra (M,) of input and output and the cross-spectrum; windows, and independent ones among them."""

    frequency_hz: FloatArray
    s_uu: FloatArray
    s_yy: FloatArray
    s_uy: np.ndarray
    segments: int
    independent: float


def frequency_response(recordings: Sequence[Recording], delay_s: float = 0.0) -> FrequencyResponse | NotPossible:
    """Estimate the frequency response over all windows of all recordings, the speed aligned by `delay_s`."""
    whole = pieces(recordings)
    nothing = unmoved(whole)
    if nothing is not None:
        return nothing
    dt_s = whole[0].dt_s
    shift = max(round(delay_s / dt_s), 0)
    size = _segment_size(whole, shift)
    if size is None:
        need_s = SHORTEST_SEGMENT_S * (FEWEST_SEGMENTS + 1) / 2 + delay_s
        return NotPossible(
            f"too short for a frequency response: the longest whole piece has {max(p.duration_s for p in whole):.3g} "
            f"s; drive `cruise experiment white_noise` for minutes, {need_s:.2g} s at least"
        )
    spectra = _averages(whole, size, shift)
    frequency_hz, independent = spectra.frequency_hz, spectra.independent
    tiny = np.finfo(float).tiny  # a frequency that a computed signal does not hold at all
    aligned = spectra.s_uy / np.maximum(spectra.s_uu, tiny)
    coherence = np.abs(spectra.s_uy) ** 2 / np.maximum(spectra.s_uu * spectra.s_yy, tiny)
    coherence = np.clip(coherence, 1e-12, 1.0 - 1e-12)
    relative_std = _relative_std(coherence, independent)
    trusted = _reliable(coherence, relative_std, independent)
    if not trusted.any():
        return NotPossible(
            f"coherence of {np.median(coherence):.2f} in {spectra.segments} windows: no gain is known anywhere; "
            "drive `cruise experiment white_noise` for longer, or with a larger amplitude"
        )
    reliable_to_hz = float(frequency_hz[trusted][-1])
    gain = np.abs(aligned)
    log_gain = np.log(np.maximum(gain, tiny))
    # Weights of the neighbourhood: those of a bin itself would favour the gains that chance made large.
    weight = np.where(trusted, 1.0 / np.maximum(_relative_std(_smooth(coherence), independent), 1e-6) ** 2, 0.0)
    quantile = float(stats.t.ppf(0.5 + CONFIDENCE / 2.0, 2.0 * (independent - 1.0)))
    excited = spectra.s_uu > 0.05 * _smooth(spectra.s_uu)  # between the lines of a multisine there is nothing to trust
    inverted = _backwards(aligned, weight)
    upright = -aligned if inverted else aligned
    level, lag_s = _slowest(frequency_hz, upright, weight, trusted, shift * dt_s)
    cutoff = _cutoff(frequency_hz, log_gain - level.value, weight, level.std, quantile)
    if cutoff is not None and np.mean(trusted[excited & (frequency_hz < cutoff.frequency_hz)]) < MOSTLY:
        cutoff = None  # chance may then have chosen the bins that are left
    gain_db = _decibel(log_gain - level.value)
    with np.errstate(divide="ignore"):
        low_db = gain_db + 20.0 * np.log10(np.maximum(1.0 - quantile * relative_std, 0.0))
        high_db = gain_db + 20.0 * np.log10(1.0 + quantile * relative_std)
    bump = None
    if cutoff is not None:
        bump = _bump(frequency_hz, gain_db, low_db, _decibel(relative_std), trusted, cutoff.frequency_hz)
    phase_rad = np.unwrap(np.angle(upright))
    return FrequencyResponse(
        frequency_hz=frequency_hz,
        gain_mps_per_ma=gain,
        gain_db=gain_db,
        gain_low_db=low_db,
        gain_high_db=high_db,
        phase_deg=np.degrees(phase_rad) - 180.0 * inverted - 360.0 * frequency_hz * shift * dt_s,
        coherence=coherence,
        low_frequency_gain_mps_per_ma=math.exp(level.value) * (-1.0 if inverted else 1.0),
        reliable_to_hz=reliable_to_hz,
        cutoff=cutoff,
        bump=bump,
        lag_s=lag_s,
        segment_s=size * dt_s,
        segments=spectra.segments,
        independent_segments=independent,
    )


def _segment_size(whole: Sequence[Piece], shift: int) -> int | None:
    """Return the samples of the longest window that gives enough of them and leaves little out, None if none does."""
    steps = round(2.0 * math.log2(LONGEST_SEGMENT_S / SHORTEST_SEGMENT_S)) + 1
    lengths_s = np.geomspace(LONGEST_SEGMENT_S, SHORTEST_SEGMENT_S, steps)
    sizes = [max(round(length_s / whole[0].dt_s), FEWEST_BINS) for length_s in lengths_s]
    lengths = [len(piece) - shift for piece in whole]
    usable = sum(length for length in lengths if length >= sizes[-1])
    for wanted, share in ((WANTED_SEGMENTS, LEAST_USED), (FEWEST_SEGMENTS, 0.0)):
        for size in sizes:
            segments = sum(_count(length, size) for length in lengths)
            if segments >= wanted and sum(length for length in lengths if length >= size) >= share * usable:
                return size
    return None


def _count(samples: int, size: int) -> int:
    return max((samples - size // 2) // (size - size // 2), 0)


def _averages(whole: Sequence[Piece], size: int, shift: int) -> _Spectra:
    """Average the windows of all pieces."""
    dt_s, half = whole[0].dt_s, size // 2
    window = np.asarray(signal.get_window("hann", size), dtype=float)
    overlap = (float(window[size - half :] @ window[:half]) / float(window @ window)) ** 2
    s_uu, s_yy = np.zeros(half + 1), np.zeros(half + 1)
    s_uy = np.zeros(half + 1, dtype=complex)
    segments, pairs = 0, 0.0
    for piece in whole:
        count = _count(len(piece) - shift, size)
        if not count:
            continue
        u, y = piece.current_ma[: len(piece) - shift], piece.speed_mps[shift:]
        s_uu += count * signal.welch(u, 1.0 / dt_s, "hann", size, half)[1]
        s_yy += count * signal.welch(y, 1.0 / dt_s, "hann", size, half)[1]
        s_uy += count * signal.csd(u, y, 1.0 / dt_s, "hann", size, half)[1]
        segments += count
        pairs += count + 2.0 * (count - 1) * overlap
    inner = slice(1, (size + 1) // 2)  # at 0 is the mean, at half the sampling rate no phase
    frequency_hz = np.fft.rfftfreq(size, dt_s)[inner]
    return _Spectra(
        frequency_hz,
        s_uu[inner] / segments,
        s_yy[inner] / segments,
        s_uy[inner] / segments,
        segments,
        segments**2 / pairs,
    )


def _reliable(coherence: FloatArray, relative_std: FloatArray, independent: float) -> np.ndarray:
    """Return which bins say something: their gain is known well, and so is that of most of their neighbours."""
    by_chance = 1.0 - (1.0 - CONFIDENCE) ** (1.0 / (independent - 1.0))  # Bendat & Piersol: C of unrelated signals
    known = ((relative_std < RELIABLE_STD) & (coherence > by_chance)).astype(float)
    return (known > 0.0) & (_smooth(known) > 0.5)


def _relative_std(coherence: FloatArray, independent: float) -> FloatArray:
    return np.sqrt((1.0 - coherence) / (2.0 * (independent - 1.0) * coherence))


def _smooth(values: FloatArray) -> FloatArray:
    """Return the running mean over five bins."""
    return np.convolve(values, np.ones(5), "same") / np.convolve(np.ones(len(values)), np.ones(5), "same")


def _backwards(aligned: np.ndarray, weight: FloatArray) -> bool:
    """Whether more current makes the machine slower, by the lowest frequencies that are known."""
    low = np.flatnonzero(weight > 0.0)[:3]
    return float(np.sum(weight[low] * np.real(aligned[low]))) < 0.0


def _slowest(
    frequency_hz: FloatArray, upright: np.ndarray, weight: FloatArray, trusted: np.ndarray, aligned_s: float
) -> tuple[Estimate, Estimate]:
    """Return log gain and lag of slow changes; where too few bins are known the lowest gain, and no lag."""
    at, std = frequency_hz[trusted], 1.0 / np.sqrt(weight[trusted])
    found = at_rest(at, upright[trusted], std, NEIGHBOURS)
    if found is None:
        return Estimate(math.log(abs(upright[trusted][0])), float(std[0])), Estimate(math.nan, math.nan)
    level, left_s = found
    return level, Estimate(aligned_s + left_s.value, left_s.std)


def _decibel(log_ratio: FloatArray) -> FloatArray:
    return log_ratio * (20.0 / math.log(10.0))


def _cutoff(
    f_hz: FloatArray, log_ratio: FloatArray, weight: FloatArray, level_std: float, quantile: float
) -> Cutoff | None:
    """Return where the straight line, log gain over log frequency, through the bins around the crossing is at -3 dB."""
    known = np.flatnonzero(weight > 0.0)
    if len(known) < 4:
        return None
    f_hz, log_ratio, weight = f_hz[known], log_ratio[known], weight[known]
    around = (f_hz > f_hz[:, None] / NARROW) & (f_hz < f_hz[:, None] * NARROW)
    around |= np.abs(np.subtract.outer(np.arange(len(f_hz)), np.arange(len(f_hz)))) < 2
    smooth = (around @ (weight * log_ratio)) / (around @ weight)
    half_power = HALF_POWER_DB * math.log(10.0) / 20.0
    below = smooth < half_power
    crossings = np.flatnonzero(below[1:-1] & below[2:] & ~below[:-2]) + 1
    if not len(crossings):
        return None
    at = int(crossings[0])
    near = np.abs(np.log(f_hz / f_hz[at])) < math.log(WIDE)
    near[max(at - 2, 0) : at + 2] = True
    x, y, w = np.log(f_hz[near] / f_hz[at]), log_ratio[near], weight[near]
    basis = np.column_stack([np.ones_like(x), x])
    intercept, slope = np.linalg.solve(basis.T @ (w[:, None] * basis), basis.T @ (w * y))
    if slope >= 0.0:
        return None
    cross = (half_power - intercept) / slope
    if not np.min(x) - 0.5 < cross < np.max(x) + 0.5:  # a line that flat has no crossing here
        return None
    centre_hz = float(f_hz[at]) * math.exp(cross)
    # Where the curve may first fall below, and where it must have: a slope would miss that chance makes it fall early.
    margin = quantile * np.sqrt(NEIGHBOURS / (around @ weight) + level_std**2)
    maybe, surely = np.flatnonzero(smooth - margin < half_power), np.flatnonzero(smooth + margin < half_power)
    surely = surely[surely >= at]
    if not len(surely):
        return None
    low_hz = min(_between(f_hz, smooth - margin - half_power, int(maybe[0])), centre_hz)
    high_hz = max(_between(f_hz, smooth + margin - half_power, int(surely[0])), centre_hz)
    clear = high_hz < WIDEST * low_hz and centre_hz >= PLATEAU * f_hz[0]
    return Cutoff(centre_hz, low_hz, high_hz) if clear else None


def _between(f_hz: FloatArray, height: FloatArray, at: int) -> float:
    """Return where the height falls through 0 between the bin before `at` and `at`."""
    if at == 0 or height[at - 1] <= 0.0:
        return float(f_hz[at])
    return float(f_hz[at] + (f_hz[at] - f_hz[at - 1]) * height[at] / (height[at - 1] - height[at]))


def _bump(
    f_hz: FloatArray, gain_db: FloatArray, low_db: FloatArray, std_db: FloatArray, trusted: np.ndarray, cutoff_hz: float
) -> Bump | None:
    """Return the highest run of bins whose band lies above the trend L - 10 q log10(1 + (f / f_0)^p), if there is one.

    The trend holds every Butterworth low-pass and every chain of equal lags; bins that stand out don't shape it.
    """
    use = trusted & (f_hz < 4.0 * cutoff_hz)
    inside = use & (f_hz > cutoff_hz) & (f_hz < 3.0 * cutoff_hz)
    keep, found = use.copy(), None
    for _ in range(3):
        if keep.sum() < 6:
            return None
        above = gain_db - _trend(f_hz, gain_db, std_db, keep, cutoff_hz)
        standing = [
            run for run in runs(inside & (low_db > gain_db - above)) if run.stop - run.start >= BUMP_BINS
        ]  # the lower edge of the band is above the trend
        if not standing:
            return None
        highest = max(standing, key=lambda run: float(np.sum(above[run])))
        peak = highest.start + int(np.argmax(above[highest]))
        found = Bump(float(f_hz[peak]), float(np.mean(above[max(peak - 1, 0) : peak + 2])))
        whole = next(run for run in runs(above > 0.0) if run.start <= peak < run.stop)
        keep = use.copy()
        keep[whole] &= f_hz[whole] <= cutoff_hz
    return found if found is not None and found.height_db >= SMALLEST_BUMP_DB else None


def _trend(f_hz: FloatArray, gain_db: FloatArray, std_db: FloatArray, keep: np.ndarray, cutoff_hz: float) -> FloatArray:
    scale = np.hypot(std_db[keep], TREND_STD_DB)

    def trend(p: FloatArray, at_hz: FloatArray) -> FloatArray:
        level_db, log_f_0, log_power, log_order = p
        return level_db - 10.0 * math.exp(log_order) * np.log10(
            1.0 + np.exp(np.clip(math.exp(log_power) * (np.log(at_hz) - log_f_0), -50.0, 50.0))
        )

    fitted = optimize.least_squares(
        lambda p: (trend(p, f_hz[keep]) - gain_db[keep]) / scale,
        [0.0, math.log(cutoff_hz), math.log(2.0), 0.0],
        bounds=(
            [-6.0, math.log(cutoff_hz / 4.0), 0.0, math.log(0.2)],
            [6.0, math.log(cutoff_hz * 4.0), math.log(16.0), math.log(8.0)],
        ),
        loss="soft_l1",
    )
    return trend(fitted.x, f_hz)
