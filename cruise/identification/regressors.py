"""The rows of the least squares problem that recordings give a model, in stretches without a hole.

    y_k - offset_k = x_k . theta + e_k ,     filtered:  F(y - offset)_k = F(x)_k . theta + F(e)_k

x_k (n,) and offset_k are the model's own regression of sample k, so that what is fitted is what estimator and
controller use. F is a zero-phase filter; it acts on the finished columns and on the target alike, because it does not
commute with the effects inside the columns (Coen et al. 2005, section IV.B filters input and output). The ends of a
stretch, over which the filter settles, stay in: F is linear there too, and they hold nearly all that is known of what
lies above the cut-off. Single parameters then scatter four times less (three taps at 20 Hz); what a few such rows weigh
is in the standard errors.
"""

import difflib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from cruise.effects.effect import Value
from cruise.model.model import Model, ModelState
from cruise.model.prediction import runs, states_over
from cruise.recording import Recording

Smooth = Callable[[np.ndarray], np.ndarray]
"""A zero-phase linear filter along axis 0 with a gain of 1 at 0 Hz; a stretch too short for it comes back as NaN."""

BLOCK: Final = 8192  # samples at a time: what is computed on the way stays in the cache, measured three times as fast
SAMPLES_PER_PARAMETER: Final = 3  # fewer rows and the residual says nothing about the noise
UNCHANGED: Final = 1e-9  # relative; what a filter leaves of a constant by rounding is less
SAME_PERIOD: Final = 1e-5  # relative; a model's delay of 60 s is then right to 0.6 ms


class FitError(ValueError):
    """The recording can't determine the parameters; the message says why and what to do."""


@dataclass(frozen=True, eq=False)
class Rows:
    """Columns (N, n), stored by columns, and target (N,) in m/s; `pieces` are the stretches without a hole."""

    names: tuple[str, ...]
    matrix: np.ndarray
    target: np.ndarray
    pieces: tuple[slice, ...]


def checked_signals(model: Model, recording: Recording) -> dict[str, np.ndarray]:
    """The signals of a recording that the model needs or can use; FitError where one lacks or the period differs."""
    absent = model.missing(recording.columns)
    if absent:
        near = [name for one in absent for name in difflib.get_close_matches(one, recording.columns, n=1, cutoff=0.85)]
        hint = f"did you mean {', '.join(near)}? " if near else ""
        raise FitError(
            f"{recording.source}: the model needs {', '.join(absent)}, which the recording does not hold: {hint}"
            "record it, or leave out the effect that needs it"
        )
    if abs(recording.dt_s - model.period_s) > SAME_PERIOD * model.period_s:
        raise FitError(
            f"{recording.source} is sampled every {recording.dt_s:g} s, the model runs every {model.period_s:g} s: "
            "resample the recording to the model's period"
        )
    used = dict.fromkeys(name for effect in model.effects for name in effect.uses)
    return {name: recording.columns[name] for name in used if name in recording.columns}


def state_over(model: Model, recording: Recording) -> ModelState:
    """The model's state at every sample of a recording, entries (N,)."""
    return states_over(model, recording.input, recording.output, checked_signals(model, recording))


def model_columns(model: Model, recording: Recording) -> tuple[np.ndarray, np.ndarray]:
    """Columns (n, N) and target (N,) of every sample, NaN where there is no row."""
    state = state_over(model, recording)
    matrix, target = np.empty((len(model.theta), len(recording))), np.empty(len(recording))
    for start in range(0, len(recording), BLOCK):
        block = slice(start, start + BLOCK)
        columns, offset = model.regression(_cut(state, block))
        for row, column in zip(matrix, columns, strict=True):
            row[block] = column
        target[block] = recording.output[block] - offset
    return matrix, target


def _cut(state: ModelState, block: slice) -> ModelState:
    """What a regression needs of the state, at some of its samples."""

    def at(value: Value) -> Value:
        return value[block] if isinstance(value, np.ndarray) else value

    speeds, drives, loads = (tuple(map(at, values)) for values in (state.speeds, state.drives, state.loads))
    return ModelState(speeds, drives, at(state.gain), at(state.pace), loads, ())


def rows_over(
    names: Sequence[str],
    columns: Callable[[Recording], tuple[np.ndarray, np.ndarray]],
    recordings: Sequence[Recording],
    smooth: Smooth | None = None,
) -> Rows:
    """The rows of all recordings, one after the other and never joined; `columns` as `model_columns` gives them.

    Raises FitError where there is no recording, none is long enough, or the input says nothing.
    """
    if not recordings:
        raise FitError("no recording is long enough: record for longer")
    matrices, targets, pieces, count, raw = [], [], [], 0, 0
    for recording in recordings:
        matrix, target = columns(recording)
        usable = runs(np.isfinite(target) & np.isfinite(matrix).all(axis=0))
        raw += sum(run.stop - run.start for run in usable)
        for run in usable:
            part, goal = matrix[:, run], target[run]
            if smooth is not None:
                part, goal = _smoothed(part, goal, smooth)
            if len(goal):
                pieces.append(slice(count, count + len(goal)))
                count += len(goal)
                matrices.append(part)
                targets.append(goal)
    if count < SAMPLES_PER_PARAMETER * len(names):
        lost = f" ({raw} before the filter, for which stretches without a hole are too short)" if count < raw else ""
        raise FitError(f"{count} usable samples for {len(names)} parameters: record for longer{lost}")
    one = len(matrices) == 1
    joined = matrices[0] if one else np.concatenate(matrices, axis=1)
    return Rows(tuple(names), joined.T, targets[0] if one else np.concatenate(targets), tuple(pieces))


def model_rows(model: Model, recordings: Sequence[Recording], smooth: Smooth | None = None) -> Rows:
    """The rows of a model; FitError as `rows_over`, or where the current or the drive signal never changes."""
    rows = rows_over(model.parameter_names, lambda recording: model_columns(model, recording), recordings, smooth)
    if model.nb:
        check_excitation(recordings, rows.matrix[:, model.na : model.na + model.nb])
    return rows


def check_excitation(recordings: Sequence[Recording], drives: np.ndarray) -> None:
    """FitError where the current, or what the effects leave of it (N, any) in mA, is the same throughout."""
    joined = np.concatenate([part.input[np.isfinite(part.input)] for part in recordings])
    if np.ptp(joined) <= UNCHANGED * np.abs(joined).max():
        raise FitError(
            f"the input does not excite the drive: the current is {joined[0]:g} mA throughout; "
            "drive steps of different size"
        )
    if np.all(np.ptp(drives, axis=0) <= UNCHANGED * np.abs(drives).max()):
        raise FitError(
            f"the input does not excite the drive: the current changes from {joined.min():g} to "
            f"{joined.max():g} mA, but the effects leave a drive signal that never does; "
            "drive beyond the dead zone and below saturation, or correct the effects' shapes"
        )


def _smoothed(part: np.ndarray, goal: np.ndarray, smooth: Smooth) -> tuple[np.ndarray, np.ndarray]:
    """Columns (n, M) and target of one stretch, filtered; a constant column as it is."""
    together = smooth(np.column_stack([part.T, goal]))
    result, target = np.ascontiguousarray(together[:, :-1].T), together[:, -1]
    constant = np.ptp(part, axis=1) == 0.0
    result[constant] = part[constant]
    if np.isfinite(target).all() and np.isfinite(result).all():
        return result, target
    return result[:, :0], target[:0]


def smoothed_runs(values: np.ndarray, smooth: Smooth) -> np.ndarray:
    """`values` (N,) filtered in each of its stretches without a hole, ends included."""
    result = np.full(len(values), np.nan)
    for run in runs(np.isfinite(values)):
        result[run] = smooth(values[run])
    return result
