"""The slip that wheel and ground speed show without any model: how much of the speed it takes, in m/s.

    v_g = c_0 + c_1 v_w + c_2 dv_w/dt + slip,   over means of 2 s, less what noise leaves in them

c_0, c_1 tyre radius and offset of the sensors, c_2 the time by which one is later than the other. Only slip and a
biased sensor make the two differ otherwise, so that an explanation without either has to call all of it a little.
"""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from cruise.recording import Recording
from cruise.signals import OUTPUT

WHEEL: Final = "wheel_speed_mps"
MEAN_S: Final = 2.0  # s
FEWEST: Final = 20  # means, below which nothing is said


def slip_mps(recordings: Sequence[Recording]) -> float:
    """RMS in m/s; 0 where the wheels' speed is not recorded, or where the sensors' noise may be all of it."""
    rows, ground, scatter, size = [], [], [], 1
    for one in recordings:
        if WHEEL not in one.columns:
            return 0.0
        size = max(round(MEAN_S / one.dt_s), 2)
        count = len(one) // size
        wheel, lost = (
            values[: count * size].reshape(count, size)
            for values in (one.columns[WHEEL], one.columns[OUTPUT] - one.columns[WHEEL])
        )
        known = np.isfinite(lost).all(axis=1)
        wheel, lost = wheel[known], lost[known]
        rows.append(np.column_stack([np.ones(len(wheel)), wheel.mean(axis=1), wheel[:, -1] - wheel[:, 0]]))
        ground.append(lost.mean(axis=1))
        scatter.append(np.diff(lost, axis=1).ravel())
    columns, lost = np.concatenate(rows), np.concatenate(ground)
    if len(lost) < FEWEST:
        return 0.0
    rest = lost - columns @ np.linalg.lstsq(columns, lost, rcond=None)[0]
    noise = 0.5 * float(np.mean(np.concatenate(scatter) ** 2)) / size
    return math.sqrt(max(float(np.mean(rest**2)) - noise, 0.0))
