"""What happens to training data before a fit: the zero-phase low-pass filter of the paper, the sampling period, pedals.

    |H(f)|^2 = 1 / (1 + (tan(pi f T) / tan(pi f_c T))^(2 n)),   run forward and backward: gain |H|^2, no phase

f_c = 1 Hz, n = 10, T period in s, in second-order sections. It acts on the finished regressor columns and on the target
alike (it does not commute with the effects). Source: section IV.B of Coen et al. 2005; A. V. Oppenheim, R. W. Schafer,
Discrete-Time Signal Processing, 3rd ed., section 7.3.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, Final

import msgspec
import numpy as np
from scipy import signal

from cruise.identification.regressors import SAME_PERIOD, UNCHANGED, FitError, Smooth
from cruise.recording import Recording, resample, too_slow
from cruise.settings import Positive
from cruise.signals import OUTPUT, PEDALS

RINGING_S = 3.0  # s times Hz: periods of the cut-off over which a 10th-order filter, run twice, rings to below 1 %

PRESSED: Final = 0.5  # of a pedal's 0 or 1, as in the service
RECOVERS_S: Final = 2.0  # s after a pedal is let go until the machine moves as the drive alone moves it


class PreparationSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How recordings become training data."""

    period_s: Positive = 0.2  # s, lowest rate of production machines (section II.B of the paper)
    cutoff_hz: Annotated[float, msgspec.Meta(ge=0)] = 1.0  # Hz, what the controller may use; 0: no filter
    order: Annotated[int, msgspec.Meta(ge=1, le=20)] = 10  # of the filter that is run twice


def smoother(settings: PreparationSettings, period_s: float) -> Smooth | None:
    """The filter for data of this period; None where there is none, or nothing above the cut-off to take away."""
    if settings.cutoff_hz == 0.0 or settings.cutoff_hz >= 0.5 / period_s:
        return None
    sections = np.asarray(signal.butter(settings.order, settings.cutoff_hz, fs=1.0 / period_s, output="sos"))
    ends = 3 * (settings.order + 1)  # samples by which a stretch goes on at both ends, turned about them
    steady = signal.sosfilt_zi(sections)  # scipy's sosfiltfilt works this out in each call, which is most of its time
    shortest = max(int(RINGING_S / settings.cutoff_hz / period_s), ends + 1)

    def once(values: np.ndarray) -> np.ndarray:
        begun = steady.reshape(*steady.shape, *[1] * (values.ndim - 1)) * values[:1]
        return signal.sosfilt(sections, values, axis=0, zi=begun)[0]

    def smooth(values: np.ndarray) -> np.ndarray:
        if len(values) <= shortest:
            return np.full(np.shape(values), np.nan)
        along = np.pad(values, [(ends, ends), *[(0, 0)] * (values.ndim - 1)], "reflect", reflect_type="odd")
        return once(once(along)[::-1])[::-1][ends:-ends]

    return smooth


def at_period(recordings: Sequence[Recording], period_s: float) -> list[Recording]:
    """All recordings on the grid of one period, `driven_alone`. FitError where one is too slow, or no speed changes."""
    prepared = []
    for recording in driven_alone(recordings):
        slow = too_slow(recording.dt_s, period_s)
        if slow:
            raise FitError(f"{recording.source} is {slow}: give --period {recording.dt_s:g} or more, or record faster")
        same = abs(recording.dt_s - period_s) <= SAME_PERIOD * period_s
        prepared.append(recording if same else resample(recording, period_s))
    speeds = np.concatenate([one.output[np.isfinite(one.output)] for one in prepared])
    if len(speeds) and np.ptp(speeds) <= UNCHANGED * np.abs(speeds).max():
        raise FitError(
            f"the speed is {speeds[0]:g} m/s throughout, there is nothing to identify: "
            "drive the machine, or choose another column with --output"
        )
    return prepared


def driven_alone(recordings: Sequence[Recording]) -> list[Recording]:
    """The recordings without the speed where brake or clutch acted beside the drive, and until that is over.

    Their notes say so. FitError where no speed is left.
    """
    left = [_driven_alone(one) for one in recordings]
    if any(_known(one) for one in recordings) and not any(_known(one) for one in left):
        pedals = " or ".join(name for name in PEDALS if any(name in one.columns for one in recordings))
        raise FitError(
            f"{pedals} is pressed wherever the speed is known, so that nothing shows what the drive does alone: "
            "record a drive without, or take the column out if 1 does not mean pressed"
        )
    return left


def _driven_alone(one: Recording) -> Recording:
    known = np.isfinite(one.output)
    pressed = {name: one.columns[name] > PRESSED for name in PEDALS if name in one.columns}
    used = [name for name, there in pressed.items() if (there & known).any()]
    if not used:
        return one
    any_of_them = np.any([pressed[name] for name in used], axis=0)
    recovering = np.convolve(any_of_them, np.ones(round(RECOVERS_S / one.dt_s) + 1))[: len(one)] > 0.5
    note = (
        f"{' and '.join(used)}: pressed for {any_of_them.sum() * one.dt_s:.3g} s: the drive does not act alone there, "
        f"the speed is left out until {RECOVERS_S:g} s after"
    )
    columns = {**one.columns, OUTPUT: np.where(recovering, np.nan, one.output)}
    return replace(one, columns=columns, notes=(*one.notes, note))


def _known(one: Recording) -> bool:
    return bool(np.isfinite(one.output).any())


def filter_in_words(settings: PreparationSettings) -> str:
    """What happened to the training data."""
    if smoother(settings, settings.period_s) is not None:
        return f"filtered at {settings.cutoff_hz:g} Hz"
    return "not filtered" if settings.cutoff_hz == 0.0 else f"not filtered, nothing is above {settings.cutoff_hz:g} Hz"
