"""An engine that the wheels turn, as through a clutch and gears: its speed is an answer of the drive, no cause.

    r_k = ln(n_k / |y_k|),   told = 1 - var(r | bins of u_(k-m) and gear) / var(r)

n engine speed in rpm, y ground speed in m/s, u the input, a mean over a second, m a lag of up to 3 s. How many turns of
its engine a metre takes is what the current of a hydrostatic drive sets: it tells 0.83 to 0.99 of r on 149 drives of
two other simulators and the virtual combine, with engines from idle to rated speed. Of two cars with gears the pedal
tells 0.07 to 0.36, and the ratio moves by 0.29 to 0.39 beside that (0.20 at most of the others). So where less than
half is told and more than a fifth is left, the engine's speed is no cause, nor is its load: it is what the pedal asked
for.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np

from cruise.model.prediction import lagged
from cruise.recording import Recording
from cruise.validation.bins import BINS, bin_of, mean_there
from cruise.validation.means import trailing_mean

ENGINE: Final = ("engine_speed_rpm", "engine_load_pct")
TOLD: Final = 0.5  # of the variance of the ratio
VARIED: Final = 0.2  # standard deviation of the logarithm of the ratio, beside what the input tells
LATEST_S: Final = 3.0
OVER_S: Final = 1.0  # of the input, a mean: a drive takes about as long to follow
STEP_S: Final = 0.2  # between the samples that are looked at, and the lags
DRIVING: Final = 0.1  # of the largest speed: below, a ratio says nothing
FEW: Final = 100  # samples


def engine_is_turned(recordings: Sequence[Recording]) -> bool:
    """Whether these recordings show an engine whose speed follows the wheels, whatever the input is."""
    if not all(ENGINE[0] in one.columns for one in recordings):
        return False
    ratio, inputs, gears = [], [], []
    largest = max(
        (float(np.nanmax(np.abs(one.output))) for one in recordings if np.isfinite(one.output).any()), default=0.0
    )
    for one in recordings:
        each = max(round(STEP_S / one.dt_s), 1)
        speed, engine = np.abs(one.output[::each]), one.columns[ENGINE[0]][::each]
        driving = (speed > DRIVING * largest) & (engine > 0.0)
        ratio.append(np.log(np.where(driving, engine, np.nan) / np.where(driving, speed, np.nan)))
        mean = trailing_mean(one.input, max(round(OVER_S / one.dt_s), 1))
        lags = range(max(round(LATEST_S / (each * one.dt_s)), 0) + 1)
        inputs.append([lagged(mean[::each], lag) for lag in lags])
        gears.append(one.columns["gear"][::each] if "gear" in one.columns else np.zeros(len(speed)))
    r, gear = np.concatenate(ratio), np.concatenate(gears)
    known = np.isfinite(r) & np.isfinite(gear)
    if np.count_nonzero(known) < FEW:
        return False
    lags = min(len(one) for one in inputs)
    left = min(_left(r, np.concatenate([one[lag] for one in inputs]), gear, known) for lag in range(lags))
    return left > VARIED**2 and left > (1.0 - TOLD) * float(np.var(r[known]))


def _left(ratio: np.ndarray, current: np.ndarray, gear: np.ndarray, known: np.ndarray) -> float:
    """The variance of the ratio beside its means over bins of the input, for every gear."""
    known = known & np.isfinite(current)
    if not known.any():
        return np.inf
    cell = bin_of(current[known]) + BINS * np.unique(gear[known], return_inverse=True)[1]
    return float(np.mean((ratio[known] - mean_there(cell, ratio[known])) ** 2))
