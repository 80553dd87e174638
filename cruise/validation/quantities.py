"""What a machine was doing at every sample, in quantities by which errors are sorted: recorded ones and derived ones.

    acceleration_k = (mean of y over the second after k - mean of y over the second before k) / (1 s + T)
    rate_k = (u_k - u_(k-n)) / (n T),   n = 1 s / T, whole

y measured speed in m/s, u current in mA, T period in s. y_k itself is left out, so that the noise of the sample whose
error is judged does not sort it. `time since the start` is that of the recording, or since the cruise control was
switched on where that was recorded.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from cruise.model.prediction import lagged
from cruise.recording import Recording
from cruise.signals import INPUT, OUTPUT, SIGNALS
from cruise.validation.means import trailing_mean

OVER_S: Final = 1.0  # s, over which speeds are averaged and changes are taken
STEADY: Final = 0.02  # of the range of a quantity, per second: what changes less is steady
FEW_VALUES: Final = 6  # a column with no more different values has states, such as gears
ENGAGED: Final = "cruise_enable"
RATE, ACCELERATION, SINCE = "rate of current", "acceleration", "time since the start"
TURNS, BRAKING = "change of current", "acceleration or braking"


@dataclass(frozen=True, eq=False)
class Quantity:
    """Values (N,) over all recordings, one after the other, NaN where not known; `states` name those of a discrete one.

    `key` is the column's name, or that of what was derived; `words` and `unit` are how it is spoken of.
    """

    key: str
    words: str
    unit: str
    values: np.ndarray
    states: tuple[tuple[float, str], ...] = ()


def quantities(recordings: Sequence[Recording]) -> list[Quantity]:
    """All that move: input, smoothed speed, every other column, and what is derived from them."""
    names = list(dict.fromkeys(name for one in recordings for name in one.columns))
    found = [
        _column(name, np.concatenate([one.columns.get(name, np.full(len(one), np.nan)) for one in recordings]))
        for name in names
        if name not in (INPUT, OUTPUT)
    ]
    u = np.concatenate([one.input for one in recordings])
    y = np.concatenate([_around(one.output, one.dt_s) for one in recordings])
    rate = np.concatenate([_rate(one.input, one.dt_s) for one in recordings])
    acceleration = np.concatenate([_acceleration(one.output, one.dt_s) for one in recordings])
    since = np.concatenate([_since(one) for one in recordings])
    up_or_down = _turns(rate, STEADY * _range(u))
    faster = _turns(acceleration, STEADY * _range(y))
    found = [
        Quantity(OUTPUT, "speed", "m/s", y),
        Quantity(INPUT, "current", "mA", u),
        Quantity(RATE, RATE, "mA/s", rate),
        Quantity(TURNS, TURNS, "", up_or_down, ((-1.0, "falling"), (0.0, "steady"), (1.0, "rising"))),
        Quantity(ACCELERATION, ACCELERATION, "m/s2", acceleration),
        Quantity(BRAKING, BRAKING, "", faster, ((-1.0, "braking"), (0.0, "steady"), (1.0, "accelerating"))),
        *found,
        Quantity(SINCE, _since_words(recordings), "s", since),
    ]
    return [one for one in found if _moves(one.values)]


def spoken(name: str) -> tuple[str, str]:
    """A column's name in words, and its unit: "engine speed" and "rpm"; an unknown column keeps its name."""
    known = SIGNALS.get(name)
    if known is None:
        return name, ""
    unit = "" if known.unit in ("-", "0/1") else known.unit.replace("degC", "°C")
    words = re.sub(r"_(mps|rpm|deg|kg|c|pct|bar|ma)$", "", name).replace("_", " ")
    return {"pitch": "slope"}.get(words, words), unit


def short(value: float) -> str:
    """A number in three digits, large ones in all of theirs: 15280, 2040, 85.3, 0.228."""
    return f"{value:.0f}" if abs(value) >= 1000.0 else f"{value:.3g}"


def _column(name: str, values: np.ndarray) -> Quantity:
    words, unit = spoken(name)
    different = np.unique(values[np.isfinite(values)])
    few = len(different) <= FEW_VALUES
    states = tuple((float(value), f"{words} {value:g}") for value in different) if few else ()
    return Quantity(name, words, unit, values, states)


def _moves(values: np.ndarray) -> bool:
    known = values[np.isfinite(values)]
    return bool(len(known)) and float(np.ptp(known)) > 0.0


def _range(values: np.ndarray) -> float:
    known = values[np.isfinite(values)]
    return float(np.ptp(np.quantile(known, (0.02, 0.98)))) if len(known) else np.nan


def _turns(rate: np.ndarray, least: float) -> np.ndarray:
    return np.where(np.isfinite(rate), np.where(np.abs(rate) <= least, 0.0, np.sign(rate)), np.nan)


def _count(dt_s: float) -> int:
    return max(round(OVER_S / dt_s), 1)


def _around(speed: np.ndarray, dt_s: float) -> np.ndarray:
    """The mean of the second before and the second after, without the sample itself."""
    before, after = _sides(speed, dt_s)
    return 0.5 * (before + after)


def _rate(current: np.ndarray, dt_s: float) -> np.ndarray:
    count = _count(dt_s)
    return (current - lagged(current, count)) / (count * dt_s)


def _acceleration(speed: np.ndarray, dt_s: float) -> np.ndarray:
    before, after = _sides(speed, dt_s)
    return (after - before) / (_count(dt_s) * dt_s + dt_s)


def _sides(speed: np.ndarray, dt_s: float) -> tuple[np.ndarray, np.ndarray]:
    count = _count(dt_s)
    return lagged(trailing_mean(speed, count), 1), lagged(trailing_mean(speed[::-1], count), 1)[::-1]


def _since(one: Recording) -> np.ndarray:
    time_s = one.time_s - one.time_s[0]
    engaged = one.columns.get(ENGAGED)
    if engaged is None:
        return time_s
    on = engaged > 0.5
    began = np.where(on & ~np.concatenate([[False], on[:-1]]), time_s, np.nan)
    last = np.fmax.accumulate(began)
    return np.where(on, time_s - last, np.nan)


def _since_words(recordings: Sequence[Recording]) -> str:
    return "time since engagement" if all(ENGAGED in one.columns for one in recordings) else SINCE
