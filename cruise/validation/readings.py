"""Another reading of the speed goes with whatever moves the machine, and would look like the cause of all of it.

    s_k = a_g + b_g y_(k-m) + e_k,   R^2 = 1 - sum_k e_k^2 / sum_k (s_k - mean_g s)^2

s a column, y the measured speed in m/s, or its size (not every sensor tells forward from backward), g the gear, m a lag
within a second either way. A column without a meaning of ours for which R^2 is above 0.9 at some lag is an answer, no
cause. On drives of the virtual combine a satellite receiver that is heard once a second, late by another one and lost
at times, reaches 0.92, the turns of a shaft 0.99; what moves for reasons of its own 0.75 at most: the driver slows
down where the header is lifted.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np

from cruise.model.prediction import lagged
from cruise.recording import Recording
from cruise.signals import OUTPUT, SIGNALS

ALL_OF_IT: Final = 0.9  # of the variance of a column
LATEST_S: Final = 1.0
STEP_S: Final = 0.2  # between the lags that are tried, and between the samples that are looked at
SAME: Final = 1e-12  # of its squares, a spread that is rounding


def other_readings(recordings: Sequence[Recording]) -> list[str]:
    """The columns that all recordings have, without a meaning of ours, that are nearly all explained by the speed."""
    names = set.intersection(*(set(one.columns) for one in recordings)) - set(SIGNALS)
    if not names:
        return []
    every = [max(round(STEP_S / one.dt_s), 1) for one in recordings]
    seen = [
        {name: values[::each] for name, values in one.columns.items()}
        for one, each in zip(recordings, every, strict=True)
    ]
    geared = all("gear" in one.columns for one in recordings)
    gears = np.concatenate([one["gear"] if geared else np.zeros(len(one[OUTPUT])) for one in seen])
    speeds = []
    for lag_s in np.arange(-LATEST_S, LATEST_S + 0.5 * STEP_S, STEP_S):
        late = [
            lagged(part[OUTPUT], round(lag_s / (each * one.dt_s)))
            for one, each, part in zip(recordings, every, seen, strict=True)
        ]
        speeds += [np.concatenate(late), np.abs(np.concatenate(late))]

    def explained(name: str) -> float:
        values = np.concatenate([one[name] for one in seen])
        return max(_share(values, speed, gears) for speed in speeds)

    return sorted(name for name in names if explained(name) > ALL_OF_IT)


def _share(values: np.ndarray, speeds_mps: np.ndarray, gears: np.ndarray) -> float:
    """R^2, a line for every gear."""
    known = np.isfinite(values) & np.isfinite(speeds_mps) & np.isfinite(gears)
    whole, told = 0.0, 0.0
    for gear in np.unique(gears[known]):
        mine = known & (gears == gear)
        s, y = values[mine] - values[mine].mean(), speeds_mps[mine] - speeds_mps[mine].mean()
        whole += float(s @ s)
        told += float(s @ y) ** 2 / max(float(y @ y), SAME)
    return told / whole if whole > SAME * float(np.sum(values[known] ** 2)) else 0.0
