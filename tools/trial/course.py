"""The course: what the driver and the field do over time, drawn from a seed; not what the drive feels of it.

Clean: white noise, steps and ramps of the current; every context signal moves for itself, slowly against the drive and
often against the recording. Field: an operator's slow lever with long holds, headlands and gear changes at a stop; the
context signals trend together, as the bin fills while the oil warms.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from .trial import PERIOD_S, Trial

FloatArray = npt.NDArray[np.floating[Any]]
STREAM: Final = 1
FULL_MA: Final = 1150.0  # mA, the plant's full stroke
GRAIN_KG: Final = 6700.0  # the plant's bin
RATED_RPM: Final = 2100.0


@dataclass(frozen=True)
class Course:
    """One value a sample of 20 Hz; each holds over the period that ends at `time_s`."""

    time_s: FloatArray
    current_ma: FloatArray
    gear: npt.NDArray[np.int64]
    grade_deg: FloatArray
    rpm: FloatArray
    crop_kw: FloatArray
    grain_kg: FloatArray
    oil_c: FloatArray
    soil: FloatArray  # -1..1, how heavily the soil rolls; nobody measures it
    header_mm: FloatArray
    wind: FloatArray  # -1..1; nobody measures it
    tyre_bar: FloatArray  # a central inflation system changes it
    brake_n: FloatArray  # of the service brake, which resists the motion


def draw(trial: Trial) -> Course:
    """The course of a trial: the same for every size of its effects."""
    return {"clean": _clean, "field": _field}[trial.tier](trial)


def wander(
    rng: np.random.Generator, time_s: FloatArray, low: float, high: float, hold_s: tuple[float, float]
) -> FloatArray:
    """Straight lines between random values, whose times lie `hold_s` apart."""
    knots_s = _knots(rng, time_s, hold_s)
    return np.interp(time_s, knots_s, rng.uniform(low, high, len(knots_s)))


def held(
    rng: np.random.Generator, time_s: FloatArray, low: float, high: float, hold_s: tuple[float, float], rise_s: float
) -> FloatArray:
    """Random values held for `hold_s`, with a ramp of `rise_s` from one to the next."""
    knots_s = _knots(rng, time_s, hold_s)
    values = rng.uniform(low, high, len(knots_s))
    corners_s = np.column_stack((knots_s[1:], knots_s[1:] + rise_s)).ravel()
    return np.interp(time_s, corners_s, np.repeat(values, 2)[1:-1])


def _knots(rng: np.random.Generator, time_s: FloatArray, hold_s: tuple[float, float]) -> FloatArray:
    count = int(time_s[-1] / hold_s[0]) + 3
    return np.concatenate(([-hold_s[1]], -hold_s[1] + np.cumsum(rng.uniform(*hold_s, count))))


def _grid(trial: Trial) -> FloatArray:
    return PERIOD_S * np.arange(1, round(trial.seconds / PERIOD_S) + 1)


def _clean(trial: Trial) -> Course:
    rng, time_s = trial.rng(STREAM), _grid(trial)
    warm_s, start_c, end_c = rng.uniform(150.0, 500.0), rng.uniform(15.0, 30.0), rng.uniform(65.0, 80.0)
    fan_c = wander(rng, time_s, -9.0, 9.0, (40.0, 120.0))  # the cooler's fan comes and goes
    return Course(
        time_s=time_s,
        current_ma=_test_signals(rng, time_s),
        gear=_gears(rng, time_s),
        grade_deg=wander(rng, time_s, -5.0, 5.0, (8.0, 40.0)),
        rpm=held(rng, time_s, 1650.0, RATED_RPM, (15.0, 50.0), rng.uniform(1.0, 8.0)),
        crop_kw=held(rng, time_s, 0.0, 110.0, (6.0, 40.0), rng.uniform(0.5, 4.0)),
        grain_kg=_bin(rng, time_s, (60.0, 160.0)),
        oil_c=end_c + (start_c - end_c) * np.exp(-time_s / warm_s) + fan_c,
        soil=wander(rng, time_s, -1.0, 1.0, (10.0, 60.0)),
        header_mm=held(rng, time_s, 50.0, 700.0, (10.0, 50.0), 1.5),
        wind=wander(rng, time_s, -1.0, 1.0, (4.0, 20.0)),
        tyre_bar=held(rng, time_s, 1.2, 2.4, (30.0, 90.0), 15.0),
        brake_n=np.zeros(len(time_s)),
    )


def _test_signals(rng: np.random.Generator, time_s: FloatArray) -> FloatArray:
    """White noise, steps and ramps in turn, each 25 to 70 s, with stops, and some steps and ramps in reverse."""
    current_ma, begin = np.zeros(len(time_s)), 0
    forms: list[Callable[[np.random.Generator, int], FloatArray]] = []
    while begin < len(time_s):
        forms = forms or list(rng.permutation(np.array([_white, _steps, _ramps])))
        count = min(round(rng.uniform(25.0, 70.0) / PERIOD_S), len(time_s) - begin)
        current_ma[begin : begin + count] = forms.pop()(rng, count)
        begin += count
    return current_ma


def _white(rng: np.random.Generator, count: int) -> FloatArray:
    """Independent values over a random part of the range, each held for 1, 4 or 10 samples."""
    hold = int(rng.choice([1, 4, 10]))
    middle_ma, half_ma = rng.uniform(450.0, 800.0), rng.uniform(250.0, 600.0)
    values_ma = rng.uniform(middle_ma - half_ma, middle_ma + half_ma, count // hold + 1)
    return np.repeat(values_ma, hold)[:count].clip(0.0, FULL_MA)


def _levels(rng: np.random.Generator, count: int) -> FloatArray:
    """Currents over the whole range, an eighth of them none, an eighth in reverse."""
    kind = rng.uniform(size=count)
    forward_ma, reverse_ma = rng.uniform(100.0, FULL_MA, count), rng.uniform(-500.0, -100.0, count)
    return np.where(kind < 0.125, 0.0, np.where(kind < 0.25, reverse_ma, forward_ma))


def _steps(rng: np.random.Generator, count: int) -> FloatArray:
    holds = rng.integers(round(0.6 / PERIOD_S), round(7.0 / PERIOD_S), count)
    return np.repeat(_levels(rng, count), holds)[:count]


def _ramps(rng: np.random.Generator, count: int) -> FloatArray:
    corners = np.concatenate(([0], np.cumsum(rng.integers(round(3.0 / PERIOD_S), round(20.0 / PERIOD_S), count))))
    return np.interp(np.arange(count), corners, _levels(rng, len(corners)))


def _gears(rng: np.random.Generator, time_s: FloatArray) -> npt.NDArray[np.int64]:
    """Gears 1 to 3, more often 2, each for 20 to 90 s, changed on the move."""
    gear, begin, now = np.full(len(time_s), 2, dtype=np.int64), 0, 2
    while begin < len(time_s):
        count = round(rng.uniform(20.0, 90.0) / PERIOD_S)
        gear[begin : begin + count] = now
        begin += count
        now = int(rng.choice([one for one in (1, 2, 3) if one != now]))
    return gear


def _bin(rng: np.random.Generator, time_s: FloatArray, fill_s: tuple[float, float]) -> FloatArray:
    """Grain in the bin [kg]: it fills, and is emptied within 25 s, again and again."""
    corners_s, grain_kg = [0.0], [rng.uniform(0.0, 0.5) * GRAIN_KG]
    while corners_s[-1] < time_s[-1]:
        corners_s.append(corners_s[-1] + rng.uniform(*fill_s))
        grain_kg.append(rng.uniform(0.6, 1.0) * GRAIN_KG)
        corners_s.append(corners_s[-1] + 25.0)
        grain_kg.append(rng.uniform(0.0, 0.15) * GRAIN_KG)
    return np.interp(time_s, corners_s, grain_kg)


def _field(trial: Trial) -> Course:
    rng, time_s = trial.rng(STREAM), _grid(trial)
    working, current_ma, gear = _operator(rng, time_s)
    end_c, warm_s = rng.uniform(60.0, 75.0), rng.uniform(250.0, 600.0)
    start_c = rng.uniform(15.0, 30.0)
    filled = np.cumsum(working) / max(1.0, float(np.sum(working)))
    height_m = wander(rng, time_s, 0.6, 1.0, (30.0, 90.0))
    rpm_low = rng.uniform(1700.0, 1850.0)
    # The engine is raised for threshing and lowered for the turn, not at once and not always by the same.
    rpm = np.where(working, RATED_RPM, rpm_low) - 60.0 * wander(rng, time_s, 0.0, 1.0, (20.0, 60.0))
    return Course(
        time_s=time_s,
        current_ma=current_ma,
        gear=gear,
        grade_deg=wander(rng, time_s, -4.0, 4.0, (20.0, 80.0)),
        rpm=smooth(rpm, 2.0),
        crop_kw=smooth(90.0 * working * height_m, 3.0),
        grain_kg=GRAIN_KG * (rng.uniform(0.0, 0.2) + rng.uniform(0.6, 0.8) * filled),
        oil_c=end_c + (start_c - end_c) * np.exp(-time_s / warm_s) + wander(rng, time_s, -2.0, 2.0, (60.0, 120.0)),
        soil=wander(rng, time_s, -1.0, 1.0, (15.0, 60.0)),
        header_mm=smooth(np.where(working, wander(rng, time_s, 80.0, 250.0, (10.0, 40.0)), 700.0), 1.0),
        wind=wander(rng, time_s, -1.0, 1.0, (4.0, 20.0)),
        tyre_bar=held(rng, time_s, 1.2, 2.4, (30.0, 90.0), 15.0),
        brake_n=np.zeros(len(time_s)),
    )


def smooth(values: FloatArray, lag_s: float) -> FloatArray:
    """First-order lag over samples of 20 Hz, at rest before the first."""
    share, now, out = PERIOD_S / (lag_s + PERIOD_S), float(values[0]), np.empty(len(values))
    for k, value in enumerate(values.tolist()):
        now += share * (value - now)
        out[k] = now
    return out


def _operator(
    rng: np.random.Generator, time_s: FloatArray
) -> tuple[npt.NDArray[np.bool_], FloatArray, npt.NDArray[np.int64]]:
    """Passes of 40 to 110 s at trimmed speeds, each with a headland: slow down, turn, sometimes reverse or stop."""
    corners_s, lever_ma, works, gears, now = [0.0], [0.0], [False], [2], 2

    def to(current_ma: float, move_s: float, hold_s: float, work: bool) -> None:
        for span_s in (move_s, hold_s):
            corners_s.append(corners_s[-1] + span_s)
            lever_ma.append(current_ma)
            works.append(work)
            gears.append(now)

    while corners_s[-1] < time_s[-1]:
        base_ma, pass_end_s = rng.uniform(500.0, 950.0), corners_s[-1] + rng.uniform(40.0, 110.0)
        while corners_s[-1] < pass_end_s:
            trimmed_ma = min(max(base_ma + rng.uniform(-160.0, 160.0), 250.0), FULL_MA)
            to(trimmed_ma, rng.uniform(1.0, 4.0), rng.uniform(4.0, 20.0), True)
        to(rng.uniform(250.0, 450.0), rng.uniform(2.0, 4.0), rng.uniform(4.0, 10.0), False)
        if rng.uniform() < 0.35:
            to(0.0, 2.0, 1.5, False)
            to(-rng.uniform(250.0, 500.0), 1.5, rng.uniform(3.0, 6.0), False)
        if rng.uniform() < 0.6:
            to(0.0, rng.uniform(1.5, 3.0), 4.0, False)
            now = int(rng.choice([one for one in (1, 2, 3) if one != now]))
            to(0.0, 0.1, rng.uniform(1.0, 3.0), False)
    index = np.searchsorted(corners_s, time_s, side="left").clip(max=len(corners_s) - 1)
    current_ma = smooth(np.interp(time_s, corners_s, lever_ma), 0.3)
    return np.array(works)[index], current_ma, np.array(gears, dtype=np.int64)[index]
