"""Predictions over a recording: h steps ahead from every sample at once, with the effects inside the recursion."""

from collections.abc import Mapping

import numpy as np

from cruise.effects import over
from cruise.effects.effect import State
from cruise.model.model import Model, ModelState


def lagged(values: np.ndarray, lag: int) -> np.ndarray:
    """values_(k - lag) at every k, shape (N,), NaN before the start; a negative lag looks ahead."""
    result = np.full(len(values), np.nan)
    if lag >= 0:
        result[lag:] = values[: max(len(values) - lag, 0)]
    else:
        result[:lag] = values[-lag:]
    return result


def states_over(
    model: Model, currents_ma: np.ndarray, speeds_mps: np.ndarray, signals: Mapping[str, np.ndarray]
) -> ModelState:
    """The model's state at every sample of a recording, once its current is known and before its speed is.

    Every entry is an array (N,); NaN where the recording doesn't reach back far enough or has a hole.
    """
    past = lagged(speeds_mps, 1)
    memory: list[State] = [None] * len(model.effects)
    drives, gain, pace, loads = currents_ma, np.ones(len(past)), np.ones(len(past)), []
    for i, effect in model.command_effects:
        drives, memory[i] = over(effect, drives, past, signals, model.period_s)
    for i, effect in model.gain_effects:
        gain, memory[i] = over(effect, gain, past, signals, model.period_s)
    for effect in model.pacing_effects:
        pace = pace * effect.pace(signals)
    for i, effect in model.load_effects:
        load, memory[i] = over(effect, 0.0, past, signals, model.period_s)
        loads.append(load)
    return ModelState(
        tuple(lagged(speeds_mps, i + 1) for i in range(max(model.na, 1))),
        tuple(lagged(drives, j) for j in range(model.delay + model.nb)),
        gain,
        pace,
        tuple(loads),
        tuple(memory),
    )


def ahead(
    model: Model,
    currents_ma: np.ndarray,
    speeds_mps: np.ndarray,
    signals: Mapping[str, np.ndarray],
    horizon: int,
) -> np.ndarray:
    """The speed at every sample as predicted `horizon` samples before, shape (N,) in m/s.

    Currents and signals on the way are the measured ones, speeds are the model's own. NaN where there was no start.
    """
    state = states_over(model, currents_ma, speeds_mps, signals)
    speed = model.next_speed(state)
    for step in range(1, horizon):
        state = model.observe(state, speed)
        now = {name: lagged(column, -step) for name, column in signals.items()}
        state = model.apply(state, lagged(currents_ma, -step), now)
        speed = model.next_speed(state)
    return lagged(np.asarray(speed, float), horizon - 1)
