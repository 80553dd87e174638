"""How small the error of any model of these signals could be, bracketed from the data alone.

From below, the white part of the measured speed. What is white in it nobody predicts, from whatever past:

    sigma^2 >= exp(mean over f of log S(f)) >= min over f of S(f), times the bandwidth     (Szegoe, Kolmogorov)

S(f) in m2/s2/Hz is the spectrum of the speed without what the current explains (a distributed lag of the current and
of two hinges of it, which follow a curved drive). Inertia keeps drive and soil out of the highest frequencies, so that
the level there is the sensor's. It counts only where it is flat: a spectrum that still falls at its end bounds white
noise from above, and then there is no bound from below. Nor is there one where a model leaves less: the drive is then
as fast as the samples, and its own motion fills the spectrum. Sensor noise that is coloured counts with its white part
only: the bound is then low, never wrong.

From above, what a flexible model leaves (ridge regression, then gradient boosting) that was given everything: the
model's prediction, the current on the way, every recorded signal that can be a cause, and speed and errors as known at
the start; out of fold, so that what it merely remembers does not count. Where that is no gain, it is what the model
itself leaves. Between the two lies what nothing recorded announces (soil), or what it did not find.

Sources: P. J. Brockwell, R. A. Davis, Time Series: Theory and Methods, 2nd ed. 1991, section 5.8 (Kolmogorov's
formula); P. D. Welch, IEEE Trans. Audio Electroacoustics 15 (1967) 70; G. Ke et al., NeurIPS 2017 (boosting on
histograms).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy import signal
from sklearn.ensemble import HistGradientBoostingRegressor
from sklearn.impute import SimpleImputer
from sklearn.linear_model import Ridge
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from threadpoolctl import threadpool_limits

from cruise.identification.held_out import folds
from cruise.model.prediction import lagged, runs
from cruise.recording import COARSER, SAME_STEP, Recording
from cruise.signals import SIGNALS
from cruise.validation.blocks import block_numbers, bootstrap
from cruise.validation.means import trailing_mean

CAUSES: Final = ("engine_speed_rpm", "gear", "pitch_deg", "machine_mass_kg", "oil_temperature_c")
"""Signals that the drive does not move at once. What answers to the speed (load, pressure, wheels) shows its noise."""

SEGMENT: Final = 64  # samples a spectrum is taken over: 32 bins, and a piece of 3.2 s at 20 Hz is enough
BIN_BAND: Final = 4  # bins that make one band: 8 bands up to the Nyquist frequency
FLAT: Final = 0.25  # relative; the mean over a period colours white noise by up to 0.14 (trapezoids share an end)
FEWEST_FLAT: Final = 3  # bands, 3/8 of the frequencies: a spectrum that falls passes 25 % in less
MEMORY_S: Final = 3.0  # s, lags of the current that may explain the speed
WIDER: Final = 0.15  # of a lag: how wide the span is over which the answer is taken for constant
LAGS_S: Final = (0.2, 0.4, 0.6, 1.0, 1.5, 2.0, 3.0, 5.0)  # s, at which the flexible model is shown the current
PAST_S: Final = (1.0, 3.0, 10.0)  # s, over which it is shown means of the errors known at the start
Z_95: Final = 1.96
APART: Final = 4.2  # 3 sqrt(2): standard deviations by which two equal levels differ by chance, at most
WINDOWED: Final = 4.0  # relative variance of a level from n samples is 4/n, measured on white noise; plain ones: 2/n
RIDGE: Final = 1.0  # of standardised columns: against those that are nearly alike, nothing beside thousands of samples
TREES: Final = 100  # of 12 leaves at a rate of 0.06: enough for what a straight line leaves
SEED: Final = 1


@dataclass(frozen=True, slots=True)
class Bound:
    """An error in m/s with its 95 % interval."""

    value_mps: float
    low_mps: float
    high_mps: float


@dataclass(frozen=True, slots=True)
class NoiseFloor:
    """Between what the error of any model `horizon_s` ahead lies: `white` below (None: not known), `reached` above."""

    white: Bound | None
    white_at_most_mps: float  # what white noise the spectrum leaves room for, flat or not; NaN where too short
    from_hz: float  # the band whose level is the white part
    to_hz: float
    reached: Bound | None  # None where the recordings are too short for it
    samples: int  # that `reached` was judged on

    @property
    def between_mps(self) -> float:
        """Slow disturbance that no recorded signal announces, or a dependence that was not found."""
        if self.white is None or self.reached is None:
            return np.nan
        return float(np.sqrt(max(self.reached.value_mps**2 - self.white.value_mps**2, 0.0)))


def noise_floor(
    native: Sequence[Recording],
    recordings: Sequence[Recording],
    predicted_mps: Sequence[np.ndarray],
    horizon: int,
) -> NoiseFloor:
    """The floor of errors `horizon` samples ahead; `native` as measured, `recordings` at the model's period."""
    known = _levels(native, recordings)
    flat = [level for level in known if level.flat]
    best = max(flat or known, key=lambda level: level.std_mps, default=None)
    reached, samples = _reached(recordings, predicted_mps, horizon)
    if best is None:
        return NoiseFloor(None, np.nan, np.nan, np.nan, reached, samples)
    factor = np.exp(0.5 * Z_95 * best.relative_std)
    white = Bound(best.std_mps, best.std_mps / factor, best.std_mps * factor) if best.flat else None
    at_most_mps = best.std_mps
    if reached is not None:
        at_most_mps = min(at_most_mps, reached.high_mps)
        if white is not None and white.low_mps > reached.high_mps:
            white = None
    return NoiseFloor(white, at_most_mps, best.from_hz, best.to_hz, reached, samples)


def white_mps(native: Sequence[Recording], recordings: Sequence[Recording]) -> float:
    """The white part of the measured speed in m/s, without what the drive moves in the spectrum; 0 where not known."""
    return min((level.std_mps for level in _levels(native, recordings) if level.flat), default=0.0)


@dataclass(frozen=True, slots=True)
class _Level:
    std_mps: float  # of white noise of this level, in samples of the model's period
    relative_std: float  # of its square
    from_hz: float
    to_hz: float
    flat: bool


def _levels(native: Sequence[Recording], recordings: Sequence[Recording]) -> list[_Level]:
    """Those at the model's period and, where that is longer, as measured."""
    period_s = recordings[0].dt_s
    levels = [_white_part(recordings, period_s)]
    alike = all(abs(one.dt_s - native[0].dt_s) <= SAME_STEP * one.dt_s for one in native)
    if alike and native[0].dt_s * COARSER < period_s:
        levels.append(_white_part(native, period_s))
    return [level for level in levels if level is not None]


def _white_part(recordings: Sequence[Recording], period_s: float) -> _Level | None:
    """The lowest level of the spectrum that the current does not explain; None where data are too short."""
    spectrum, count = _unexplained(recordings)
    if spectrum is None:
        return None
    dt_s = recordings[0].dt_s
    bands = spectrum[1 : 1 + (len(spectrum) - 1) // BIN_BAND * BIN_BAND].reshape(-1, BIN_BAND).mean(axis=1)
    if len(bands) < FEWEST_FLAT:
        return None
    scatter = np.sqrt(WINDOWED / count * len(bands))
    windows = np.lib.stride_tricks.sliding_window_view(bands, FEWEST_FLAT)
    lowest = int(np.argmin(windows.mean(axis=1)))
    base = windows[lowest]
    flat = bool(base.max() - base.min() <= max(FLAT, APART * scatter) * base.mean())
    alike = bands <= (1.0 + max(0.5 * FLAT, scatter)) * base.mean()
    alike[lowest : lowest + FEWEST_FLAT] = True
    run = next(run for run in runs(alike) if run.start <= lowest < run.stop)
    level = float(bands[run].mean())
    variance = level * 0.5 / dt_s
    ratio = period_s / dt_s
    each = ratio if recordings[0].averaged else ratio - 0.5  # trapezoids over a period have half weight at its ends
    averaged = each / ratio**2 if ratio > COARSER else 1.0
    step_hz = BIN_BAND / (SEGMENT * dt_s)
    return _Level(
        std_mps=float(np.sqrt(variance * averaged)),
        relative_std=float(np.sqrt(WINDOWED / count * len(bands) / (run.stop - run.start))),
        from_hz=run.start * step_hz,
        to_hz=run.stop * step_hz,
        flat=flat,
    )


def _unexplained(recordings: Sequence[Recording]) -> tuple[np.ndarray | None, int]:
    """One-sided spectrum (SEGMENT / 2 + 1,) in m2/s2/Hz, and the samples behind it.

    Speed and current enter as differences: slow parts would leak into the high frequencies. What differencing does to
    the spectrum is divided out.
    """
    dt_s = recordings[0].dt_s
    spans = _spans(round(MEMORY_S / dt_s))
    joined = np.concatenate([one.input[np.isfinite(one.input)] for one in recordings])
    hinges = np.quantile(joined, (1 / 3, 2 / 3))
    rows, targets = [], []
    for one in recordings:
        u, y = one.input, one.output
        bent = [u, *(np.maximum(u - hinge, 0.0) for hinge in hinges)]
        columns = np.column_stack([lagged(v, first) - lagged(v, last) for v in bent for first, last in spans])
        change = np.diff(y, prepend=np.nan)
        for run in runs(np.isfinite(change) & np.isfinite(columns).all(axis=1)):
            if run.stop - run.start >= SEGMENT:
                rows.append(columns[run])
                targets.append(change[run])
    count = sum(map(len, targets))
    size = 3 * len(spans)
    if count < 2 * size + SEGMENT:
        return None, 0
    matrix, target = np.concatenate(rows), np.concatenate(targets)
    scale = np.sqrt(np.mean(matrix**2, axis=0))
    matrix = matrix / np.where(scale > 0.0, scale, 1.0)
    ridge = 1e-9 * count * np.eye(size)  # against columns that never move; far below any noise
    theta = np.linalg.solve(matrix.T @ matrix + ridge, matrix.T @ target)
    total, segments = np.zeros(SEGMENT // 2 + 1), 0
    for part, goal in zip(rows, targets, strict=True):
        rest = goal - part @ (theta / np.where(scale > 0.0, scale, 1.0))
        number = (len(rest) - SEGMENT) // (SEGMENT // 2) + 1
        _, density = signal.welch(rest, 1.0 / dt_s, nperseg=SEGMENT, detrend="constant")
        density[-1] *= 2.0  # of the one-sided spectrum, the Nyquist frequency alone is not doubled
        total += number * density
        segments += number
    frequency = np.arange(SEGMENT // 2 + 1) / SEGMENT
    difference = 4.0 * np.sin(np.pi * np.maximum(frequency, 0.5 / SEGMENT)) ** 2
    return total / segments / difference * count / (count - size), count


def _spans(memory: int) -> list[tuple[int, int]]:
    """Lags in spans [first, last) that grow with the lag: the current's change over each is one regressor.

    A regressor a lag would follow the noise too, and most of it at high frequencies, where differences are largest.
    """
    spans, first = [], 0
    while first <= memory:
        spans.append((first, first + 1 + int(WIDER * first)))
        first = spans[-1][1]
    return spans


def _reached(
    recordings: Sequence[Recording], predicted_mps: Sequence[np.ndarray], horizon: int
) -> tuple[Bound | None, int]:
    """RMS of what ridge regression and gradient boosting leave of the model's error out of fold, or of that error."""
    names = [name for name in CAUSES if any(name in one.columns for one in recordings)]
    errors = [one.output - speed for one, speed in zip(recordings, predicted_mps, strict=True)]
    shown = [_features(one, p, e, names, horizon) for one, p, e in zip(recordings, predicted_mps, errors, strict=True)]
    left = [np.full(len(one), np.nan) for one in recordings]
    for fold in folds(recordings):
        known = [np.isfinite(error) for error in errors]
        for mask, unseen in zip(known, fold.unseen, strict=True):
            if unseen.stop > unseen.start:  # nor what overlaps with the unseen block
                mask[max(unseen.start - horizon, 0) : unseen.stop + horizon] = False
        if sum(int(mask.sum()) for mask in known) < 10 * shown[0].shape[1]:
            return None, 0
        matrix = np.concatenate([x[mask] for x, mask in zip(shown, known, strict=True)])
        target = np.concatenate([e[mask] for e, mask in zip(errors, known, strict=True)])
        predict = _flexible(matrix, target)
        for k, unseen in enumerate(fold.unseen):
            if unseen.stop > unseen.start:
                left[k][unseen] = errors[k][unseen] - predict(shown[k][unseen])
    joined, own = np.concatenate(left), np.concatenate(errors)
    known = np.isfinite(joined)
    if not known.any():
        return None, 0
    values = min(joined[known] ** 2, own[known] ** 2, key=np.mean)
    draws = np.sqrt(bootstrap(values, block_numbers(recordings, horizon)[known]))
    low, high = np.quantile(draws, (0.025, 0.975))
    return Bound(float(np.sqrt(values.mean())), float(low), float(high)), len(values)


def _flexible(matrix: np.ndarray, target: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """Ridge regression of `target` (N,) on `matrix` (N, n), and gradient boosting of what it leaves; to be called."""
    seen = np.isfinite(matrix).any(axis=0)  # in short pieces no error is known at the start of any prediction
    matrix = matrix[:, seen]
    linear = make_pipeline(SimpleImputer(), StandardScaler(), Ridge(alpha=RIDGE)).fit(matrix, target)
    boosted = HistGradientBoostingRegressor(
        max_iter=TREES, learning_rate=0.06, max_leaf_nodes=12, l2_regularization=1.0, random_state=SEED
    )
    with threadpool_limits(1):  # two threads that wait for each other cost more than they bring
        boosted.fit(matrix, target - linear.predict(matrix))

    def predict(shown: np.ndarray) -> np.ndarray:
        with threadpool_limits(1):
            return linear.predict(shown[:, seen]) + boosted.predict(shown[:, seen])

    return predict


def _features(
    one: Recording, predicted: np.ndarray, error: np.ndarray, names: Sequence[str], horizon: int
) -> np.ndarray:
    """What the flexible model is shown (N, n): no measured speed and no error after the start of the prediction."""
    lags = [round(lag_s / one.dt_s) for lag_s in LAGS_S]
    columns = [predicted, lagged(one.output, horizon), one.input, *(lagged(one.input, lag) for lag in lags)]
    for name in names:
        value = one.columns.get(name, np.full(len(one), np.nan))
        columns += [value, trailing_mean(value, round(1.0 / one.dt_s)), trailing_mean(value, horizon)]
    known = lagged(error, horizon)
    columns += [known, *(trailing_mean(known, round(past_s / one.dt_s)) for past_s in PAST_S)]
    return np.column_stack(columns)


def causes_in(recordings: Sequence[Recording]) -> tuple[str, ...]:
    """The recorded signals that `reached` was shown beside current and speed."""
    return tuple(name for name in CAUSES if name in SIGNALS and any(name in one.columns for one in recordings))
