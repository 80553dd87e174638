"""Is the data sound: gaps, jitter, clipping, stuck values, outliers, noise, and whether the input hangs on the output.

    u_k = sum_i g_i u_(k-i) + sum_j h_j y_(k-j) + e_k,    F = ((R_0 - R) / m) / (R / (N - n - m - 1))

u current, y speed without their means, R residual sum of squares with and R_0 without the m past speeds, n past
currents, N samples. Where the past speed tells something about the next current that the past current doesn't
(Granger), someone has closed a loop: an operator who watches the speed, or a controller. A large N makes any F
significant, so that the speed must also explain a share of what was left.

Source: C.W.J. Granger, Econometrica 37 (1969) 424; L. Ljung, System Identification, 2nd ed. 1999, sections 13.4
(feedback) and 14.1 (outliers, missing data); R.K. Pearson, Mining Imperfect Data (2005), section 2.1 (Hampel filter).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy import ndimage, signal, stats

from cruise.identification.explore.cross_correlation import CrossCorrelation
from cruise.identification.explore.pieces import NotPossible, Piece, centred, pieces, unmoved
from cruise.identification.explore.two_speeds import TwoSpeeds, two_speeds
from cruise.model.prediction import runs
from cruise.recording import Recording, notes_of
from cruise.sampling import FloatArray

GAP_STEPS: Final = 1.5  # of the typical step: a longer one is a gap, not jitter
AT_EXTREME: Final = 1e-3  # of the range: nearer to the extreme is at it
CLIPPED_SHARE: Final = 0.01
COARSE_SHARE: Final = 0.02  # of the range of the speed: of larger digits each holds for a while, and at the top
SAME_DIGITS: Final = 6  # of a speed in m/s: what differs beyond is how a file was rounded
STUCK_S: Final = 1.0  # s
MOVED: Final = 0.05  # of the range of the current: more has moved the input
HAMPEL_SAMPLES: Final = 5  # window of the running median: sees spikes of one or two samples
HAMPEL_STD: Final = 6.0  # robust standard deviations; 3 is usual for Gaussian residuals, those of a drive have tails
FEEDBACK_DT_S: Final = 0.1  # s, ten samples a second are enough for anyone who watches a speed
OUTPUT_MEMORY_S: Final = 1.0
INPUT_MEMORY_S: Final = 4.0  # longer, or what the speed remembers of an old current passes for feedback
FEEDBACK_P: Final = 1e-3
FEEDBACK_SHARE: Final = 0.01  # of the unexplained variance of the current
REST_S: Final = 3.0  # s, after which the speed has settled
ROUNDING_MPS: Final = 1e-9  # what a difference of two equal readings may be
FEWEST_AT_REST: Final = 50


@dataclass(frozen=True, slots=True)
class Jitter:
    """Steps between raw time stamps, gaps left out."""

    typical_step_s: float
    std_s: float
    largest_s: float

    def words(self) -> list[str]:
        """Return the jitter as a sentence."""
        share = 100.0 * self.std_s / self.typical_step_s
        if self.largest_s < 1e-6 * self.typical_step_s:
            return [f"sampling steps of {1e3 * self.typical_step_s:.4g} ms do not vary"]
        return [
            f"sampling steps of {1e3 * self.typical_step_s:.4g} ms vary by {1e3 * self.std_s:.2g} ms ({share:.1f} %), "
            f"{1e3 * self.largest_s:.2g} ms at most"
        ]


@dataclass(frozen=True, slots=True)
class Stuck:
    """The longest stretch in which the speed shows one value while the current moves."""

    start_s: float
    duration_s: float
    speed_mps: float


@dataclass(frozen=True, slots=True)
class Feedback:
    """Whether past speeds tell the next current: F test, and the share of what is left that they explain.

    `before_share`: part of the correlations of current with earlier speed outside their bound, 0.05 by chance.
    """

    f_statistic: float
    p_value: float
    explained_share: float
    before_share: float | None

    @property
    def found(self) -> bool:
        """Whether the test is significant and the effect is more than a trace."""
        return self.p_value < FEEDBACK_P and self.explained_share > FEEDBACK_SHARE

    def words(self) -> list[str]:
        """Return the verdict as a sentence."""
        numbers = f"F test p = {self.p_value:.2g}, {100.0 * self.explained_share:.1f} % explained"
        if self.found:
            return [
                f"the input hangs on the output ({numbers}): someone closes the loop, correlations and spectra are "
                "biased; drive with the controller off and without an eye on the speed"
            ]
        return [f"no feedback from speed to current ({numbers})"]


@dataclass(frozen=True, slots=True)
class Noise:
    """Noise of the measured speed, and how it was found."""

    std_mps: float
    how: str


@dataclass(frozen=True, eq=False)
class Quality:
    """What is wrong with the data, in numbers."""

    samples: int
    lost_samples: int
    longest_gap_s: float
    pieces: int
    notes: tuple[str, ...]
    jitter: Jitter | NotPossible
    input_share_at_low: float
    input_share_at_high: float
    output_share_at_low: float
    output_share_at_high: float
    output_digit_mps: float  # the least step between two speeds
    output_digit_share: float  # of the range of the speed
    stuck: Stuck | None
    outliers: int
    outlier_times_s: FloatArray
    feedback: Feedback | NotPossible
    noise: Noise | None
    two_speeds: TwoSpeeds | None

    def words(self) -> list[str]:
        """Return what is wrong, in sentences."""
        said = []
        if self.lost_samples:
            said.append(
                f"{self.lost_samples} of {self.samples} samples lack current or speed, up to {self.longest_gap_s:.3g} "
                f"s on end: {self.pieces} whole pieces are left"
            )
        else:
            said.append(f"no gap in {self.samples} samples")
        said += self.jitter.words()
        coarse = self.output_digit_share > COARSE_SHARE
        if coarse:
            said.append(
                f"the speed comes in steps of {self.output_digit_mps:.2g} m/s, {100.0 * self.output_digit_share:.0f} % "
                "of its range, and a smaller answer is not seen: record it with more digits, or by another sensor"
            )
        elif self.output_share_at_high > CLIPPED_SHARE:
            said.append(
                f"the speed is at its highest value in {100.0 * self.output_share_at_high:.1f} % of the samples: the "
                "sensor clips, or the drive is at its stop"
            )
        if self.stuck is not None and self.stuck.duration_s >= STUCK_S:
            stands = "it stands still (dead zone), or" if self.stuck.speed_mps == 0.0 else "the sensor hangs, or"
            stands = f"its steps are that coarse, {stands}" if coarse else stands
            said.append(
                f"the speed stays at {self.stuck.speed_mps:.3g} m/s for {self.stuck.duration_s:.3g} s from "
                f"t={self.stuck.start_s:.6g} s while the current moves: {stands} its frames repeat"
            )
        if self.outliers:
            times = ", ".join(f"{time_s:.6g}" for time_s in self.outlier_times_s[:5])
            said.append(f"{self.outliers} outliers of the speed, at t={times} s{' ...' * (self.outliers > 5)}")
        said += self.feedback.words()
        if self.noise is not None:
            said.append(f"noise of the speed: {self.noise.std_mps:.2g} m/s ({self.noise.how})")
        return said + (self.two_speeds.words() if self.two_speeds is not None else [])


def quality(
    recordings: Sequence[Recording],
    correlation: CrossCorrelation | NotPossible | None = None,
    raw_times_s: Sequence[FloatArray] = (),
) -> Quality | NotPossible:
    """Examine all recordings; `raw_times_s` are their time stamps before they were put on a grid, where known."""
    whole = pieces(recordings)
    if not whole:
        return NotPossible("no sample has both current and speed: record both")
    samples = sum(len(recording) for recording in recordings)
    gaps = [
        (hole.stop - hole.start) * recording.dt_s
        for recording in recordings
        for hole in runs(~(np.isfinite(recording.input) & np.isfinite(recording.output)))
    ]
    current_ma = np.concatenate([piece.current_ma for piece in whole])
    speed_mps = np.concatenate([piece.speed_mps for piece in whole])
    outlier_times_s = _outliers(whole)
    digit_mps = float(np.min(np.diff(np.unique(speed_mps.round(SAME_DIGITS))), initial=math.inf))
    digit_mps = digit_mps if math.isfinite(digit_mps) else 0.0  # a speed that never moves has none
    return Quality(
        samples=samples,
        lost_samples=samples - len(speed_mps),
        longest_gap_s=max(gaps, default=0.0),
        pieces=len(whole),
        notes=tuple(notes_of(recordings)),
        jitter=jitter(raw_times_s),
        input_share_at_low=_share_at(current_ma, -1.0),
        input_share_at_high=_share_at(current_ma, 1.0),
        output_share_at_low=_share_at(speed_mps, -1.0),
        output_share_at_high=_share_at(speed_mps, 1.0),
        output_digit_mps=digit_mps,
        output_digit_share=digit_mps / float(np.ptp(speed_mps)) if digit_mps else 0.0,
        stuck=_stuck(whole, MOVED * float(np.ptp(current_ma))),
        outliers=len(outlier_times_s),
        outlier_times_s=outlier_times_s,
        feedback=feedback(recordings, correlation),
        noise=_noise(whole),
        two_speeds=two_speeds(recordings),
    )


def jitter(raw_times_s: Sequence[FloatArray]) -> Jitter | NotPossible:
    """Return how raw time stamps (N,) of each recording jitter, or that there are none, or of different rates."""
    steps = [np.diff(times_s) for times_s in raw_times_s if len(times_s) > 2]
    if not steps:
        return NotPossible("jitter can't be seen: the recording is on a uniform grid, its raw time stamps are gone")
    medians_s = [float(np.median(of_one)) for of_one in steps]
    if max(medians_s) > GAP_STEPS * min(medians_s):
        return NotPossible(
            f"the recordings have sampling steps of {1e3 * min(medians_s):.4g} to {1e3 * max(medians_s):.4g} ms: "
            "explore them one by one to see their jitter"
        )
    joined = np.concatenate(steps)
    median_s = float(np.median(joined))
    joined = joined[(joined <= GAP_STEPS * median_s) & (joined >= 0.0)]
    typical_s = float(np.mean(joined))
    return Jitter(typical_s, float(np.std(joined)), float(np.max(np.abs(joined - typical_s))))


def feedback(
    recordings: Sequence[Recording], correlation: CrossCorrelation | NotPossible | None = None
) -> Feedback | NotPossible:
    """Test whether the past speed tells the next current (Granger)."""
    whole = pieces(recordings)
    nothing = unmoved(whole)
    if nothing is not None:
        return nothing
    before = None
    if isinstance(correlation, CrossCorrelation):
        before = float(np.mean(np.abs(correlation.before) > correlation.bound))
    every = max(round(FEEDBACK_DT_S / whole[0].dt_s), 1)
    dt_s = every * whole[0].dt_s
    m, n = max(round(OUTPUT_MEMORY_S / dt_s), 1), max(round(INPUT_MEMORY_S / dt_s), 1)
    fewest = 5 * (n + m + 1)
    # Each experiment has an input of its own kind; only those that are too short for a test of their own share one.
    each = [pieces([recording]) for recording in recordings]
    shared = [piece for group in each if _usable(group, every, n) < fewest for piece in group]
    groups = [group for group in (*each, shared) if _usable(group, every, n) >= fewest]
    if not groups:
        return NotPossible(
            f"too short to see feedback: {fewest * dt_s + INPUT_MEMORY_S:.0f} s without a gap are needed"
        )
    tests = [test for test in (_granger(group, every, n, m) for group in groups) if test is not None]
    if not tests:
        return NotPossible("feedback can't be judged: the current repeats itself exactly")
    # The strongest of several tests: each p-value counts as often as there are tests (Bonferroni).
    tests = [replace(test, p_value=min(test.p_value * len(tests), 1.0), before_share=before) for test in tests]
    return min(tests, key=lambda test: (not test.found, test.p_value, -test.explained_share))


def _usable(group: Sequence[Piece], every: int, lags: int) -> int:
    return sum(max(len(piece) // every - lags, 0) for piece in group)


def _granger(group: Sequence[Piece], every: int, n: int, m: int) -> Feedback | None:
    """Test whether m past speeds explain the current beyond n past currents; None if those leave nothing."""
    group = [piece for piece in group if len(piece) // every > n]
    u = centred([_decimated(piece.current_ma, every) for piece in group])
    y = centred([_decimated(piece.speed_mps, every) for piece in group])
    target = np.concatenate([part[n:] for part in u])
    past_u = np.concatenate([_past(part, n, n) for part in u])
    past_y = np.concatenate([_past(part, m, n) for part in y])
    ones = np.ones((len(target), 1))
    without = _left(np.hstack([ones, past_u]), target)
    within = _left(np.hstack([ones, past_u, past_y]), target)
    if without <= 1e-8 * float(target @ target):  # a current that its own past gives completely
        return None
    freedom = len(target) - n - m - 1
    ratio = ((without - within) / m) / max(within / freedom, 1e-300)
    return Feedback(float(ratio), float(stats.f.sf(ratio, m, freedom)), 1.0 - within / without, None)


def _decimated(values: FloatArray, every: int) -> FloatArray:
    return values[: len(values) // every * every].reshape(-1, every).mean(axis=1)


def _past(values: FloatArray, lags: int, start: int) -> FloatArray:
    """Return the columns values_(k-1) ... values_(k-lags) for k from `start` on."""
    return np.column_stack([values[start - lag : len(values) - lag] for lag in range(1, lags + 1)])


def _left(matrix: FloatArray, target: FloatArray) -> float:
    solution = np.linalg.lstsq(matrix, target, rcond=None)[0]
    return float(np.sum((target - matrix @ solution) ** 2))


def _share_at(values: FloatArray, sign: float) -> float:
    high = float(np.max(sign * values))
    return float(np.mean(sign * values >= high - AT_EXTREME * float(np.ptp(values))))


def _stuck(whole: Sequence[Piece], moved_ma: float) -> Stuck | None:
    longest = None
    for piece in whole:
        for run in runs(np.diff(piece.speed_mps) == 0.0):
            duration_s = (run.stop + 1 - run.start) * piece.dt_s
            if longest is not None and duration_s <= longest.duration_s:
                continue
            if np.ptp(piece.current_ma[run.start : run.stop + 1]) > moved_ma > 0.0:
                start_s = piece.start_s + run.start * piece.dt_s
                longest = Stuck(start_s, duration_s, float(piece.speed_mps[run.start]))
    return longest


def _outliers(whole: Sequence[Piece]) -> FloatArray:
    """Return the times in s of spikes: further from the running median than noise, and than the surroundings move."""
    long = [piece for piece in whole if len(piece) >= HAMPEL_SAMPLES]
    residuals = [piece.speed_mps - ndimage.median_filter(piece.speed_mps, HAMPEL_SAMPLES) for piece in long]
    joined = np.abs(np.concatenate([*residuals, np.zeros(0)]))
    # A speed at rest has no residual at all: the scale is that of the samples that move, never below the resolution.
    moving = joined[joined > 0.0]
    if not len(moving):
        return np.zeros(0)
    limit = HAMPEL_STD * 1.4826 * float(np.median(moving))
    times_s = [
        piece.start_s
        + piece.dt_s * np.flatnonzero((np.abs(residual) > limit) & (np.abs(residual) > _surroundings(piece.speed_mps)))
        for piece, residual in zip(long, residuals, strict=True)
    ]
    return np.concatenate(times_s)


def _surroundings(values: FloatArray) -> FloatArray:
    """Return the range of the values three to five samples away on both sides: what moves that much may also turn."""
    padded = np.pad(values, 5, mode="reflect" if len(values) > 5 else "edge")
    others = np.lib.stride_tricks.sliding_window_view(padded, 11)[:, [0, 1, 2, 8, 9, 10]]
    return np.ptp(others, axis=1)


def _noise(whole: Sequence[Piece]) -> Noise | None:
    """Return the noise of the speed: from its differences while the current rests, else from its spectrum's end."""
    moved_ma = 0.02 * float(np.ptp(np.concatenate([piece.current_ma for piece in whole])))
    settle = round(REST_S / whole[0].dt_s)
    differences = []
    for piece in whole:
        if len(piece) <= settle + 1:
            continue
        high = ndimage.maximum_filter1d(piece.current_ma, settle + 1, origin=settle // 2)
        low = ndimage.minimum_filter1d(piece.current_ma, settle + 1, origin=settle // 2)
        # A wheel that stands still has no pulses and no noise.
        rests = (high - low <= moved_ma)[1:] & (np.arange(1, len(piece)) >= settle) & (piece.speed_mps[1:] != 0.0)
        differences.append(np.diff(piece.speed_mps)[rests])
    steps = np.concatenate(differences) if differences else np.zeros(0)
    if len(steps) >= FEWEST_AT_REST:
        return Noise(_from_steps(np.abs(steps)), "differences while the current rests")
    longest = max(whole, key=len)
    if len(longest) < FEWEST_AT_REST:
        return None
    rate_hz = 1.0 / longest.dt_s
    frequency_hz, density = signal.welch(longest.speed_mps, rate_hz, "hann", min(256, len(longest)))
    floor = float(np.median(density[frequency_hz > 0.375 * rate_hz]))
    return Noise(math.sqrt(floor * rate_hz / 2.0), "spectrum above three quarters of half the sampling rate")


def _from_steps(steps_mps: FloatArray) -> float:
    """Return the noise whose differences are these (N,): their median, but where that is one or two digits their mean.

    A reading of resolution q is off by q / sqrt(12) at least in the mean square, though it does not move at all.
    """
    moved = steps_mps[steps_mps > ROUNDING_MPS]
    digit_mps = float(moved.min()) if len(moved) else 0.0
    robust_mps = 1.4826 * float(np.median(steps_mps)) / math.sqrt(2.0)
    if digit_mps < 0.5 * robust_mps:
        return robust_mps
    clipped = np.minimum(steps_mps, 3.0 * digit_mps)
    return max(math.sqrt(float(np.mean(clipped**2)) / 2.0), digit_mps / math.sqrt(12.0))
