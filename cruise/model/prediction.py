"""Predictions over a recording: h steps ahead from every sample at once, and free runs, with the effects inside.

    y_k = sum_i A_(i,k) y_(k-i) + w_k        p^(h)_k = sum_i A_(i,k) p^(h-i)_(k-i) + w_k ,   p^(0) = y

p^(h)_k is the speed at sample k as predicted h samples before; A (max(na, 1) of them) is what the past speeds do, w the
rest, in m/s. This split exists where no effect reads the speed; it turns the recursion over states into one over whole
arrays. Where one does, every step runs through `Model.apply`. Both give the same numbers.

A machine that stands while no current is asked for may be held by its brakes or by the oil that is shut in, on any
slope: there no load acts that they hold. Whether they do the recording tells: it stands then wherever it was left alone
long enough, and one that is not held rolls, however slowly: what it reads then wanders, and noise does not.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy  # its signal part, slow to load, is loaded where it is first used: the service does without

from cruise.effects.effect import State, Value
from cruise.model.model import Model, ModelState

NO_CURRENT: Final = 0.01  # of the greatest current, up to which none is asked for,
STANDING: Final = 0.05  # and of the greatest speed, up to which a machine stands, sensor noise and all;
NO_CURRENT_MA, STANDING_MPS = 5.0, 0.05  # what sensors read at rest: the greatest, where nothing ever moves
STOPPED_S: Final = 3.0  # s without current after which a machine that is held stands,
MOSTLY: Final = 0.9  # in so much of the time; one that rolls on every slope was seen at 0.6, held ones from 0.95 on,
ROLLS: Final = 0.01  # and one that rolls slowly, of the greatest speed, by so many times what the sensor errs:
SCATTER: Final = 3.0  # one had 10, held ones have 1
ONE_STD: Final = 1.48  # standard deviation of normal noise over its median size


def lagged(values: np.ndarray, lag: int) -> np.ndarray:
    """values_(k - lag) at every k, shape (N,), NaN before the start; a negative lag looks ahead."""
    result = np.empty(len(values))
    if lag >= 0:
        result[:lag] = np.nan
        result[lag:] = values[: max(len(values) - lag, 0)]
    else:
        result[lag:] = np.nan
        result[:lag] = values[-lag:]
    return result


def lags(values: np.ndarray, first: int, last: int) -> tuple[np.ndarray, ...]:
    """`lagged` for every lag from `first` to `last`: views of one array, read-only."""
    padded = np.concatenate([np.full(last, np.nan), values])
    padded.flags.writeable = False
    return tuple(padded[last - lag : last - lag + len(values)] for lag in range(first, last + 1))


def runs(usable: np.ndarray) -> list[slice]:
    """The stretches of `usable` (N,) that are True without a break, in order."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], usable, [False]]).astype(np.int8)))
    return [slice(int(start), int(stop)) for start, stop in zip(edges[::2], edges[1::2], strict=True)]


def standing_held(currents_ma: np.ndarray, speeds_mps: np.ndarray, period_s: float) -> np.ndarray:
    """Where brakes hold a recording's machine, (N,); nowhere, where it does not stand whenever it is left alone."""
    idle = _small(currents_ma, NO_CURRENT, NO_CURRENT_MA)
    still = _small(speeds_mps, STANDING, STANDING_MPS)
    count = max(round(STOPPED_S / period_s), 1)
    alone = np.convolve(idle, np.ones(count))[: len(idle)] > count - 0.5
    alone &= np.isfinite(speeds_mps)
    stands = bool(alone.any()) and float(still[alone].mean()) >= MOSTLY and not _rolls(speeds_mps, alone)
    return idle & still & stands


def _rolls(speeds_mps: np.ndarray, alone: np.ndarray) -> bool:
    """Whether a machine that is left alone moves on and off, however slowly: its sensor would not read that at rest."""
    read = speeds_mps[alone]
    spread_mps = ONE_STD * float(np.median(np.abs(read - np.median(read))))
    steps_mps = np.diff(speeds_mps)[alone[1:] & alone[:-1]]
    noise_mps = ONE_STD * float(np.median(np.abs(steps_mps))) / math.sqrt(2.0) if len(steps_mps) else math.inf
    return spread_mps > max(ROLLS * float(np.nanmax(np.abs(speeds_mps))), SCATTER * noise_mps)


def _small(values: np.ndarray, share: float, least: float) -> np.ndarray:
    """Where values are no more than a share of the greatest, or than `least`; False where they are not known."""
    size = np.abs(values)
    return np.less_equal(size, max(share * np.nanmax(size, initial=0.0), least))


def states_over(
    model: Model, currents_ma: np.ndarray, speeds_mps: np.ndarray, signals: Mapping[str, np.ndarray]
) -> ModelState:
    """The model's state at every sample of a recording, once its current is known and before its speed is.

    Every entry is an array (N,), or a float where it is the same throughout; NaN where the recording doesn't reach
    back far enough or has a hole.
    """
    past, *_ = lags(speeds_mps, 1, 1)
    memory: list[State] = [None] * len(model.effects)
    drives, gain, loads = currents_ma, 1.0, []
    for i, effect in model.command_effects:
        drives, memory[i] = effect.over(drives, past, signals, model.period_s)
    past_drives = lags(drives, 0, max(model.delay + model.nb, 1) - 1)
    yielding = model.yielding(past_drives, signals)
    pace = model.stroke_pace(yielding)
    for i, effect in model.gain_effects:
        gain, memory[i] = effect.over(gain, past, signals, model.period_s)
    for i, effect in model.pacing_effects:
        pace = pace * effect.pace(signals, memory[i])
    for i, effect in model.load_effects:
        load, memory[i] = effect.over(0.0, past, signals, model.period_s)
        loads.append(yielding * load)
    state = ModelState(
        lags(speeds_mps, 1, max(model.na, 1)),
        past_drives,
        gain,
        pace,
        tuple(loads),
        tuple(memory),
    )
    return _braked(model, state, standing_held(currents_ma, speeds_mps, model.period_s))


def _braked(model: Model, state: ModelState, held: np.ndarray) -> ModelState:
    """The state without the loads that brakes hold, where `held`."""
    if not held.any():
        return state
    loads = [
        np.where(held, 0.0, load) if effect.brakes_hold else load
        for (_, effect), load in zip(model.load_effects, state.loads, strict=True)
    ]
    return state._replace(loads=tuple(loads))


@dataclass(frozen=True, slots=True)
class Driven:
    """y_k = sum_i feedback[i]_k y_(k-1-i) + forced_k: feedback floats or (N,), forced (N,) in m/s, NaN in holes."""

    feedback: tuple[Value, ...]
    forced: np.ndarray


def driven(model: Model, state: ModelState, count: int) -> Driven:
    """The model over a recording of `count` samples, split; `state` as `states_over` gives it, no effect reads speed.

    The model is linear in the past speeds: each coefficient is what it says of one speed alone.
    """
    silent = state._replace(speeds=(0.0,) * len(state.speeds))
    forced = np.array(np.broadcast_to(np.asarray(model.next_speed(silent), float), count))
    a, *_ = model.split(model.theta)
    alone = model.with_theta((*a, *(0.0,) * (len(model.theta) - model.na)))
    quiet = silent._replace(drives=(0.0,) * len(state.drives), loads=(0.0,) * len(state.loads))
    units = np.eye(len(state.speeds)).tolist()
    feedback = tuple(alone.next_speed(quiet._replace(speeds=tuple(unit))) for unit in units)
    return Driven(feedback, forced)


def ahead_driven(split: Driven, speeds_mps: np.ndarray, horizon: int, noise: Sequence[np.ndarray] = ()) -> np.ndarray:
    """The speed at every sample as predicted `horizon` samples before, (N,) in m/s, NaN where there was no start.

    `noise[m - 1]` (N,) is what a noise model adds m samples ahead; nothing beyond.
    """
    past = [speeds_mps] * len(split.feedback)
    predicted = split.forced
    for step in range(horizon):
        predicted = split.forced.copy()
        for i, (coefficient, speed) in enumerate(zip(split.feedback, past, strict=True)):
            factor = coefficient[i + 1 :] if isinstance(coefficient, np.ndarray) else coefficient
            predicted[i + 1 :] += factor * speed[: -i - 1]
        predicted[: len(past)] = np.nan
        if step < len(noise):
            predicted += noise[step]
        past = [predicted, *past[:-1]]
    return predicted


def ahead(
    model: Model,
    currents_ma: np.ndarray,
    speeds_mps: np.ndarray,
    signals: Mapping[str, np.ndarray],
    horizon: int,
    noise: Sequence[np.ndarray] = (),
) -> np.ndarray:
    """The speed at every sample as predicted `horizon` samples before, shape (N,) in m/s.

    Currents and signals on the way are the measured ones, speeds are the model's own; `noise[m - 1]` (N,) is what a
    noise model adds m samples ahead. NaN where there was no start. To an effect that compares the ground speed with the
    wheels' (`wheel_slip`, `sensor_bias`), or takes its rate out of the pitch (`grade`, `power_limit`), it is a signal,
    too: of that on the way such a model knows more than one that drives will.
    """
    state = states_over(model, currents_ma, speeds_mps, signals)
    if not model.reads_speed:
        return ahead_driven(driven(model, state, len(speeds_mps)), speeds_mps, horizon, noise)
    return ahead_stepwise(model, state, currents_ma, speeds_mps, signals, horizon, noise)


def ahead_stepwise(
    model: Model,
    state: ModelState,
    currents_ma: np.ndarray,
    speeds_mps: np.ndarray,
    signals: Mapping[str, np.ndarray],
    horizon: int,
    noise: Sequence[np.ndarray] = (),
) -> np.ndarray:
    """`ahead` for any model, from the state at every sample: an array of start points, stepped together."""
    speed = np.empty(0)
    held = standing_held(currents_ma, speeds_mps, model.period_s)
    for step in range(horizon):
        if step:
            state = model.observe(state, speed)
            now = {name: lagged(column, -step) for name, column in signals.items()}
            state = _braked(model, model.apply(state, lagged(currents_ma, -step), now), lagged(held, -step) == 1.0)
        speed = np.broadcast_to(np.asarray(model.next_speed(state), float), len(currents_ma))
        if step < len(noise):
            speed = speed + lagged(noise[step], -step)
    return lagged(speed, horizon - 1)


def starts(usable: np.ndarray, speeds_mps: np.ndarray, na: int) -> list[slice]:
    """Where a free run can go: the runs of `usable` (N,), each from its first sample with `na` measured speeds before.

    A run that has none is left out.
    """
    past = np.ones(len(speeds_mps), dtype=bool)
    for i in range(1, na + 1):
        past &= np.isfinite(lagged(speeds_mps, i))
    found = []
    for run in runs(usable):
        first = np.flatnonzero(past[run])
        if len(first):
            found.append(slice(run.start + int(first[0]), run.stop))
    return found


def run_driven(split: Driven, speeds_mps: np.ndarray) -> np.ndarray:
    """The free run (N,) in m/s: measured speeds only before its first sample; begun again after every hole."""
    result = np.full(len(speeds_mps), np.nan)
    depth = len(split.feedback)
    usable = np.isfinite(split.forced)
    for coefficient in split.feedback:
        usable &= np.isfinite(coefficient)
    fixed = not any(isinstance(coefficient, np.ndarray) for coefficient in split.feedback)
    for run in starts(usable, speeds_mps, depth):
        past = speeds_mps[run.start - depth : run.start][::-1]
        if fixed:
            denominator = np.array([1.0, *(-coefficient for coefficient in split.feedback)])
            memory = scipy.signal.lfiltic([1.0], denominator, past)
            result[run], _ = scipy.signal.lfilter([1.0], denominator, split.forced[run], zi=memory)
            continue
        coefficients = np.column_stack([np.broadcast_to(c, len(speeds_mps))[run] for c in split.feedback]).tolist()
        speeds = past.tolist()
        for k, (row, forced) in enumerate(zip(coefficients, split.forced[run].tolist(), strict=True), run.start):
            speed = forced + sum(a * y for a, y in zip(row, speeds, strict=True))
            speeds = [speed, *speeds[:-1]]
            result[k] = speed
    return result


def run_stepwise(
    model: Model,
    state: ModelState,
    currents_ma: np.ndarray,
    speeds_mps: np.ndarray,
    signals: Mapping[str, np.ndarray],
    copies: int = 1,
) -> np.ndarray:
    """The free run of any model, (N, copies) in m/s: one sample after the other.

    The parameters of `model` may be arrays (copies,): as many models then run side by side.
    """
    result = np.full((len(currents_ma), copies), np.nan)
    columns, offset = model.regression(state._replace(speeds=(0.0,) * len(state.speeds)))
    usable = np.isfinite(offset + sum(columns, start=np.zeros(len(currents_ma))))
    held = standing_held(currents_ma, speeds_mps, model.period_s)
    for run in starts(usable, speeds_mps, len(state.speeds)):
        now = _at(state, run.start)
        now = now._replace(speeds=tuple(np.full(copies, speed) for speed in now.speeds))
        for k in range(run.start, run.stop):
            if k > run.start:
                signals_now = {name: float(column[k]) for name, column in signals.items()}
                now = _braked(model, model.apply(now, float(currents_ma[k]), signals_now), held[k : k + 1])
            result[k] = speed = model.next_speed(now)
            now = model.observe(now, speed)
    return result


def _at(state: ModelState, k: int) -> ModelState:
    """The state at sample k of a recording."""

    def pick(entry: State) -> State:
        if isinstance(entry, tuple):
            return tuple(pick(value) for value in entry)
        return float(entry[k]) if isinstance(entry, np.ndarray) else entry

    return ModelState(*(pick(entry) for entry in state))


def free_run(
    model: Model, currents_ma: np.ndarray, speeds_mps: np.ndarray, signals: Mapping[str, np.ndarray]
) -> np.ndarray:
    """The model's own speeds (N,) in m/s from the first samples on, begun again after holes; NaN where none can be.

    A model that is unstable runs away to infinity, without a warning.
    """
    state = states_over(model, currents_ma, speeds_mps, signals)
    with np.errstate(over="ignore", invalid="ignore"):
        if not model.reads_speed:
            return run_driven(driven(model, state, len(speeds_mps)), speeds_mps)
        return run_stepwise(model, state, currents_ma, speeds_mps, signals)[:, 0]
