"""What the drive itself shows, under a name of its own, would look like the cause of all that moves the machine.

    s_k = a_g + b_g z_(k-m) + e_k,   R^2 = 1 - sum_k e_k^2 / sum_k (s_k - mean_g s)^2

s a column, z the measured speed y in m/s, or its size (not every sensor tells forward from backward), or its change
over a second, g the gear, m a lag within a second either way. A column without a meaning of ours for which R^2 is above
0.9 at some lag is another reading of the speed, an answer, no cause; above 0.7 where z is the change. On drives of the
virtual combine a satellite receiver that is heard once a second, late by another one and lost at times, reaches 0.92,
the turns of a shaft 0.99; what moves for reasons of its own 0.75 at most: the driver slows down where the header is
lifted. The sensors of acceleration of two cars reach 0.77 to 0.94; what is named so, or has its unit, needs no R^2.

So is what stands between input and speed, such as the position of a valve: a column of which its means over bins of the
input up to a second before, those of other minutes, tell more than 0.9. On an excavator, a motorcycle and a car pilot
pressures, valves, and the pressure in the manifold reach 0.91 to 0.99; on 12 drives of the virtual combine a header
that the driver lifts 0.83.
"""

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from cruise.model.prediction import lagged
from cruise.recording import Recording
from cruise.signals import INPUT, OUTPUT, SIGNALS
from cruise.units import apart
from cruise.validation.bins import bin_of, mean_there

ALL_OF_IT: Final = 0.9  # of the variance of a column
MOST_OF_IT: Final = 0.7  # the same, of one that shows the acceleration: the difference of a speed is noisy
OVER_S: Final = 1.0  # over which a change of the speed is taken
LATEST_S: Final = 1.0
STEP_S: Final = 0.2  # between the lags that are tried, and between the samples that are looked at
ACCELERATION: Final = re.compile(r"(?<![a-z])(?:acc|accel|acceleration|accelerometer)(?![a-z])", re.IGNORECASE)
BLOCK_S: Final = 60.0  # of time, of which every second one says what the others hold
SAME: Final = 1e-12  # of its squares, a spread that is rounding


def other_readings(recordings: Sequence[Recording]) -> dict[str, str]:
    """What the columns without a meaning of ours go with that nearly all of the drive's own motion, or input, tells."""
    names = set.intersection(*(set(one.columns) for one in recordings)) - set(SIGNALS)
    if not names:
        return {}
    drive = _drive_of(recordings, names)
    told = {name: drive.tells(name) for name in sorted(names)}
    return {name: what for name, what in told.items() if what}


@dataclass(frozen=True, eq=False)
class _Drive:
    """Columns (N,) over all recordings, one after the other, and motion and input at all lags, each (N,)."""

    columns: Mapping[str, np.ndarray]
    gears: np.ndarray
    blocks: np.ndarray
    speeds: Sequence[np.ndarray]
    changes: Sequence[np.ndarray]
    inputs: Sequence[np.ndarray]

    def tells(self, name: str) -> str:
        """With what of the drive's own a column goes, or nothing."""
        values = self.columns[name]
        if max(_share(values, one, self.gears) for one in self.speeds) > ALL_OF_IT:
            return "the ground speed itself"
        if _is_acceleration(name) or max(_share(values, one, self.gears) for one in self.changes) > MOST_OF_IT:
            return "the change of the ground speed"
        return "the input itself" if max(_told(values, one, self.blocks) for one in self.inputs) > ALL_OF_IT else ""


def _drive_of(recordings: Sequence[Recording], names: Collection[str]) -> _Drive:
    every = [max(round(STEP_S / one.dt_s), 1) for one in recordings]
    periods_s = [each * one.dt_s for one, each in zip(recordings, every, strict=True)]
    thinned = [
        {name: values[::each] for name, values in one.columns.items()}
        for one, each in zip(recordings, every, strict=True)
    ]

    def late(name: str, lag_s: float) -> np.ndarray:
        return np.concatenate(
            [lagged(one[name], round(lag_s / dt_s)) for one, dt_s in zip(thinned, periods_s, strict=True)]
        )

    lags_s = np.arange(-LATEST_S, LATEST_S + 0.5 * STEP_S, STEP_S)
    speeds = [late(OUTPUT, lag_s) for lag_s in lags_s]
    changes = [late(OUTPUT, lag_s - 0.5 * OVER_S) - late(OUTPUT, lag_s + 0.5 * OVER_S) for lag_s in lags_s]
    inputs = [late(INPUT, lag_s) for lag_s in lags_s if lag_s > -0.5 * STEP_S]
    times = [np.arange(len(one[OUTPUT])) * dt_s for one, dt_s in zip(thinned, periods_s, strict=True)]
    geared = all("gear" in one for one in thinned)
    return _Drive(
        {name: np.concatenate([one[name] for one in thinned]) for name in names},
        np.concatenate([one["gear"] if geared else np.zeros(len(one[OUTPUT])) for one in thinned]),
        np.concatenate(times) // BLOCK_S,
        [*speeds, *map(np.abs, speeds)],
        changes,
        [*inputs, *(np.mean(inputs[: count + 1], axis=0) for count in range(1, len(inputs)))],
    )


def _is_acceleration(name: str) -> bool:
    return apart(name)[1] == "m/s2" or bool(ACCELERATION.search(name.replace("_", " ")))


def _told(values: np.ndarray, current: np.ndarray, blocks: np.ndarray) -> float:
    """R^2 of the means over bins of the input, those of every second block of time by the others: no drift is told."""
    known = np.isfinite(values) & np.isfinite(current)
    if not known.any():
        return 0.0
    s, cell, even = values[known], bin_of(current[known]), blocks[known] % 2 == 0
    told = np.where(even, mean_there(cell, s, ~even), mean_there(cell, s, even))
    spread = float(np.sum((s - s.mean()) ** 2))
    return 1.0 - float(np.sum((s - told) ** 2)) / spread if spread > SAME * float(np.sum(s**2)) else 0.0


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
